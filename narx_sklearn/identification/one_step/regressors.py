"""Candidate regressors of a recording, produced block by block and never held as a whole."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from narx_sklearn.identification.records.record import CHUNK_ROWS, ArrayRecord, Block
from narx_sklearn.model.kernels import NO_STEP, term_columns
from narx_sklearn.model.recording import Layout, Recording, lay_out
from narx_sklearn.model.terms import TermLibrary

BLOCK_ROWS = 2048  # a block of a few hundred columns stays in the second-level cache


class ProductPlan(NamedTuple):
    """How to form the terms of a library with one product each.

    Row ``t`` is row ``parents[t]`` (-1: none) times the variable at ``steps[t]`` in the flattened data.
    Prefixes that the library itself lacks are formed too; ``wanted`` are the rows of its own terms.
    """

    steps: np.ndarray
    parents: np.ndarray
    wanted: np.ndarray

    @classmethod
    @lru_cache(maxsize=16)  # the same few libraries are planned for every piece of a record
    def of(cls, library: TermLibrary, channels: tuple[str, ...]) -> "ProductPlan":
        """Plan the products of ``library`` over the named channels."""
        table = library.table(channels)
        distance = table.channels - table.lags * len(channels)
        position: dict[tuple[int, ...], int] = {}
        steps: list[int] = []
        parents: list[int] = []

        def row_of(factors: tuple[int, ...]) -> int:
            if factors not in position:
                parent = row_of(factors[:-1]) if len(factors) > 1 else -1
                position[factors] = len(steps)
                steps.append(distance[factors[-1]] if factors else NO_STEP)
                parents.append(parent)
            return position[factors]

        wanted = [row_of(tuple(row[row >= 0])) for row in table.factors]
        return cls(
            np.array(steps, dtype=np.int64),
            np.array(parents, dtype=np.int64),
            np.array(wanted, dtype=np.int64),
        )


@dataclass(frozen=True)
class Candidates:
    """A library of candidate terms together with the recording they are evaluated on.

    Attributes
    ----------
    library : TermLibrary
        The candidate terms, in the columns' order.
    layout : Layout
        Channels of the recording, with origin and scale.
    recording : Recording
        Measured channels, shifted and scaled.
    rows : ndarray of int
        Samples at which every candidate and every output is known.
    """

    library: TermLibrary
    layout: Layout
    recording: Recording
    rows: np.ndarray

    @classmethod
    def of(cls, library: TermLibrary, layout: Layout, recording: Recording) -> "Candidates":
        """Find the samples at which all of ``library`` and the outputs are known."""
        table = library.table(layout.channels)
        rows = recording.rows(table.channels, table.lags, targets=range(len(layout.outputs)))
        return cls(library, layout, recording, rows)

    @classmethod
    def in_block(cls, library: TermLibrary, layout: Layout, block: Block) -> "Candidates":
        """Lay a block out and find the samples of its own at which all is known."""
        found = cls.of(library, layout, lay_out(layout, block.X, block.y, block.sessions))
        return cls(library, layout, found.recording, found.rows[found.rows >= block.n_past])

    @property
    def n_rows(self) -> int:
        """Number of usable samples."""
        return self.rows.size

    @property
    def n_columns(self) -> int:
        """Number of candidate terms and outputs."""
        return len(self.library) + len(self.layout.outputs)

    @property
    def targets(self) -> np.ndarray:
        """Outputs at the usable samples, shape (n_rows, n_outputs), shifted and scaled."""
        return self.recording.data[self.rows, : len(self.layout.outputs)]

    def restrict(self, library: TermLibrary) -> "Candidates":
        """Return other terms on the same samples."""
        return Candidates(library, self.layout, self.recording, self.rows)

    def every(self, step: int) -> "Candidates":
        """Return the same terms on every ``step``-th usable sample."""
        return Candidates(self.library, self.layout, self.recording, self.rows[::step])

    def blocks(self, size: int = BLOCK_ROWS) -> Iterator[np.ndarray]:
        """Yield the regressors and then the outputs as rows of an array, shape (n_terms + n_outputs, size).

        The array is used again for the next block; copy what is to be kept.
        """
        plan = ProductPlan.of(self.library, self.layout.channels)
        n_outputs = len(self.layout.outputs)
        flat = self.recording.data.reshape(-1)
        n_channels = len(self.layout.channels)
        products = np.empty((plan.steps.size, size))
        in_place = np.array_equal(plan.wanted, np.arange(plan.steps.size))
        block = np.empty((len(self.library) + n_outputs, size))
        for begin in range(0, self.n_rows, size):
            rows = self.rows[begin : begin + size]
            if in_place:
                term_columns(flat, n_channels, rows, plan.steps, plan.parents, block)
            else:
                term_columns(flat, n_channels, rows, plan.steps, plan.parents, products)
                np.take(products, plan.wanted, axis=0, out=block[: len(self.library)], mode="clip")
            for i in range(n_outputs):
                block[len(self.library) + i, : rows.size] = self.recording.data[rows, i]
            yield block[:, : rows.size]

    def matrix(self) -> np.ndarray:
        """Return all regressors at once, shape (n_rows, n_terms): for small problems and tests."""
        n_terms = len(self.library)
        Psi = np.empty((self.n_rows, n_terms))
        begin = 0
        for block in self.blocks():
            Psi[begin : begin + block.shape[1]] = block[:n_terms].T
            begin += block.shape[1]
        return Psi


def reach_of(library: TermLibrary, layout: Layout) -> int:
    """Return how many samples back the terms read, what phi regressors read included."""
    reach = {p.name: p.reach for p in layout.phi}
    return max((v.lag + reach.get(v.signal, 0) for v in library.variables), default=0)


def remembers_all(layout: Layout) -> bool:
    """Tell whether a phi regressor depends on the whole past of its session."""
    return any(p.has_memory for p in layout.phi)


def chunks(
    library: TermLibrary, layout: Layout, X: np.ndarray, y: np.ndarray, sessions=None, size: int = CHUNK_ROWS
) -> Iterator[Candidates]:
    """Yield the candidates of a long recording piece by piece, each sample once.

    Consecutive pieces overlap by the longest lag, so that no regressor is lost at an edge. phi regressors
    that remember further back need the whole recording, which is then one piece.
    """
    record = Block(X, y, None if sessions is None else np.asarray(sessions), 0, 0)
    step = max(X.shape[0], 1) if remembers_all(layout) else size
    for block in record.split(step, reach_of(library, layout)):
        yield Candidates.in_block(library, layout, block)


def candidates_of(library: TermLibrary, layout: Layout, record: ArrayRecord) -> Iterator[Candidates]:
    """Yield the candidates of the blocks of a record in memory."""
    for block in record.blocks(reach_of(library, layout), remembers_all(layout)):
        yield Candidates.in_block(library, layout, block)

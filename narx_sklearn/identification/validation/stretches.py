"""The factors of long stretches of a record, from which the spread of parameters is told."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np

from narx_sklearn._threads import single_threaded_blas
from narx_sklearn.identification.one_step.factor import Factor, compress
from narx_sklearn.identification.one_step.procedure import merge_parts
from narx_sklearn.identification.one_step.regressors import Candidates, reach_of, remembers_all
from narx_sklearn.identification.one_step.uncertainty import OneStepScores, n_stretches
from narx_sklearn.identification.records.record import Block, Record
from narx_sklearn.model.recording import Layout
from narx_sklearn.model.terms import TermLibrary


def stretch_factors(
    library: TermLibrary, layout: Layout, record: Record, *, shortest: float | None = None
) -> list[Factor]:
    """Return the factors of a few long stretches of the record, equal in usable samples.

    With ``shortest`` given there are fewer where they would be shorter than that, one at least.
    """
    reach, whole = reach_of(library, layout), remembers_all(layout)
    found = record.map(partial(usable_in_block, library, layout), reach=reach, whole=whole)
    usable = np.array([n for _, n in found], dtype=int)
    n_samples = int(usable.sum())
    count = n_stretches(n_samples)
    if shortest is not None:
        count = max(min(count, int(n_samples / shortest)), 1)
    # stretch w holds the usable samples i with i * count // n_samples == w
    edges = [-(-w * n_samples // count) for w in range(count + 1)]
    done = {first: int(d) for (first, _), d in zip(found, np.cumsum(usable) - usable, strict=True)}
    parts = record.total(
        partial(stretches_of_block, library, layout, edges, done), merge_parts, reach=reach, whole=whole
    )
    empty = Factor.empty(len(library), len(layout.outputs))
    return [parts.get(w, empty) for w in range(count)]


def usable_in_block(library: TermLibrary, layout: Layout, block: Block) -> tuple[int, int]:
    """Return where a block begins and how many of its samples have all lagged values."""
    return block.first, Candidates.in_block(library, layout, block).n_rows


def stretches_of_block(
    library: TermLibrary, layout: Layout, edges: list[int], done: dict[int, int], block: Block
) -> dict[int, Factor]:
    """Return the factors of the parts of stretches that lie in a block."""
    candidates = Candidates.in_block(library, layout, block)
    begin = done[block.first]
    found = {}
    with single_threaded_blas():
        for w, (a, b) in enumerate(pairwise(edges)):
            rows = candidates.rows[max(a - begin, 0) : max(b - begin, 0)]
            if rows.size:
                found[w] = compress([replace(candidates, rows=rows)])
    return found


def scores_on_factors(
    factors: Sequence[Factor], theta: np.ndarray, output: int, n_samples: int
) -> OneStepScores:
    """Return what `one_step_scores` sums over stretches, from the stretches' factors.

    A factor has the inner products of its samples: Psi'Psi = R'R, and Psi'xi = R'(r - R theta) with r the
    output's column. ``n_samples`` is how many samples they stand for together.
    """
    left = [f.target(output) - f.Psi @ theta for f in factors]
    power = sum(float(r @ r) for r in left)
    return OneStepScores(
        np.array([f.Psi.T @ f.Psi for f in factors]),
        np.array([f.Psi.T @ r for f, r in zip(factors, left, strict=True)]),
        float(np.sqrt(power / max(n_samples - theta.size, 1))),
    )

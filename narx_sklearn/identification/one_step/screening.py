"""Forward selection by error reduction ratio over large libraries, one pass over the data per term."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from numbers import Integral

import numpy as np
from threadpoolctl import ThreadpoolController

from narx_sklearn.identification.one_step._products import SumPlan, term_values, weighted_sums
from narx_sklearn.identification.one_step.regressors import Candidates
from narx_sklearn.identification.one_step.selection import COLLINEARITY, EXACT
from narx_sklearn.identification.structure.constraints import LinearConstraints
from narx_sklearn.model.terms import TermLibrary

__all__ = ["ScreenPath", "screen_terms", "screening_cost"]

CHUNK_ROWS = 8192  # samples a thread takes at a time; fixed, so that sums do not depend on the threads
BATCH = 16  # contenders orthogonalised explicitly at a time
EPS = np.finfo(float).eps
SUM_ERROR = 256 * EPS  # bound on the rounding of a sum by `weighted_sums`, relative to the two norms
EXACT_ERROR = 4 * EPS  # rounding of an explicit orthogonalisation, relative to the norm before it
NONE = np.empty(0, dtype=np.int64)  # no terms
REFRESH = 1e-2  # fall of the residual after which its inner products are summed anew


@dataclass(frozen=True, eq=False)
class ScreenPath:
    """Order in which forward selection takes the terms, and how it got there.

    Attributes
    ----------
    order : ndarray of int, shape (n_selected,)
        Indices into the library, the most significant term first.
    err : ndarray, shape (n_selected,)
        Error reduction ratio of each, relative to the output's energy ``y'y``; dimensionless.
    collinear : ndarray of int
        Candidates found to be linear combinations of those chosen before (or zero), in ascending order.
    n_passes : int
        Sums of the whole library against one signal.
    n_verified : int
        Columns orthogonalised explicitly, the chosen ones included.
    stopped_at : {"n_terms", "explained", "exhausted"}
        Why it ended: as many terms as asked for; a residual of nothing but rounding; no candidate left
        that is independent of the chosen ones.
    """

    order: np.ndarray
    err: np.ndarray
    collinear: np.ndarray
    n_passes: int
    n_verified: int
    stopped_at: str


def screen_terms(
    candidates: Candidates,
    n_terms: int,
    *,
    output: int = 0,
    constraints: LinearConstraints | None = None,
    n_threads: int | None = None,
) -> ScreenPath:
    r"""Order the most significant candidates by forward orthogonal least squares, without a regressor matrix.

    At each step the term with the largest error reduction ratio is taken,

    .. math:: \mathrm{ERR}_l = \frac{(w_l^T r)^2}{(w_l^T w_l)(y^T y)},

    where :math:`w_l` is what is left of candidate `l` after the chosen terms are projected out, and `r`
    what is left of the output `y`. For libraries of hundreds to thousands of terms on long recordings; for
    small ones, or where many models are wanted from one pass, the triangular factor serves better.

    Parameters
    ----------
    candidates : Candidates
        The library and the recording.
    n_terms : int
        Terms to select, at least 1; fewer are returned where fewer are independent.
    output : int, default=0
        Which of the recording's outputs to explain.
    constraints : LinearConstraints, default=None
        Constraints on the parameters. The terms they name are taken for granted and not ordered; the others
        explain what the best parameters of those, under the constraints, leave of the output.
    n_threads : int or None, default=None
        Threads that share the samples; None uses every processor this process may use. The result is the
        same, to the last bit, for any number.

    Returns
    -------
    ScreenPath
        Order, error reduction ratios, and how the selection ended.

    Raises
    ------
    ValueError
        If `n_terms` or `n_threads` is less than 1, `output` is none of the outputs, no sample is usable,
        or the output is zero throughout.
    TypeError
        If one of them is not an integer.

    See Also
    --------
    screening_cost : Arithmetic operations this takes.

    Notes
    -----
    A pass sums all candidates against the newest orthonormal column `q`. That downdates every
    :math:`w_l^T w_l` and :math:`w_l^T r`, with a bound on the rounding of each. Wherever the bounds leave
    open which candidate leads, the contenders are orthogonalised explicitly and decided on those numbers,
    so that the order is that of a Householder factorisation even where lagged signals are nearly equal.
    Candidates equal to rounding are decided by the order of the library. Memory beyond the recording is
    one column of doubles per selected term.

    References
    ----------
    S. Chen, S. A. Billings, W. Luo (1989), "Orthogonal least squares methods and their application to
    non-linear system identification", Int. J. Control 50(5); Abreu (2021),
    eqs. (2.40)-(2.43).

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification.one_step.regressors import Candidates
    >>> from narx_sklearn.identification.one_step.screening import screen_terms
    >>> from narx_sklearn.model import TermLibrary
    >>> from narx_sklearn.model.recording import Layout, lay_out
    >>> u = np.random.default_rng(0).normal(size=(500, 1))
    >>> y = np.roll(u, 1, axis=0) ** 3 + 0.5 * np.roll(u, 2, axis=0)
    >>> layout = Layout.of(("y",), ("u",), ())
    >>> library = TermLibrary.polynomial(["u[k-1]", "u[k-2]", "u[k-3]"], degree=3)
    >>> path = screen_terms(Candidates.of(library, layout, lay_out(layout, u, y)), 5)
    >>> [str(library[i]) for i in path.order], path.stopped_at
    (['u[k-1]^3', 'u[k-2]'], 'explained')
    >>> print(f"{path.err.sum():.12f}")
    1.000000000000
    """
    _check(candidates, n_terms, output, n_threads)
    y = candidates.targets[:, output]
    with _start_sweep(candidates, n_threads) as sweep:
        if constraints is None or not len(constraints):
            return _select(sweep, y, n_terms)
        y, granted = _granted(candidates, y, constraints)
        return _select(sweep, y, n_terms, constraints.terms, granted)


def screening_cost(n_rows: int, library: TermLibrary, n_terms: int) -> float:
    """Estimate the floating-point operations of `screen_terms`, to compare with a factorisation's.

    Parameters
    ----------
    n_rows : int
        Usable samples.
    library : TermLibrary
        Candidate terms.
    n_terms : int
        Terms to select.

    Returns
    -------
    float
        Operations; loading a variable, forming a product or starting a run of sums counts as the
        operations that take as long. Orthogonalising more contenders than the chosen terms, which
        depends on the data, is left out.

    Examples
    --------
    >>> from narx_sklearn.identification.one_step.screening import screening_cost
    >>> from narx_sklearn.model import TermLibrary
    >>> library = TermLibrary.polynomial([f"y[k-{lag}]" for lag in range(1, 13)], degree=3)
    >>> len(library), screening_cost(100_000, library, 15) < 0.1 * 2 * 100_000 * len(library) ** 2
    (455, True)
    """
    a_pass = SumPlan.of(library, tuple(sorted(library.signals))).operations
    n_passes = n_terms + 1  # norms and numerators, then one for every term but the last
    orthogonalised = 4 * n_terms * (n_terms + 1)  # two projections and two updates by the chosen columns
    return float(n_rows) * (n_passes * a_pass + orthogonalised)


def _check(candidates: Candidates, n_terms: int, output: int, n_threads: int | None) -> None:
    """Refuse arguments that no selection can be made with."""
    for name, value in (("n_terms", n_terms), ("output", output), ("n_threads", n_threads)):
        if not isinstance(value, Integral) and not (name == "n_threads" and value is None):
            raise TypeError(f"{name} must be an integer, got {value!r} of type {type(value).__name__}.")
    if n_terms < 1:
        raise ValueError(f"n_terms must be at least 1, got {n_terms}.")
    if n_threads is not None and n_threads < 1:
        raise ValueError(f"n_threads must be at least 1 (or None for every processor), got {n_threads}.")
    n_outputs = len(candidates.layout.outputs)
    if not 0 <= output < n_outputs:
        raise ValueError(f"output must be between 0 and {n_outputs - 1}, one of the outputs, got {output}.")
    if len(candidates.library) == 0:
        raise ValueError("The library holds no candidate terms. Give at least one.")
    if candidates.n_rows == 0:
        raise ValueError(
            f"No sample is usable: every one misses a value within the longest lag "
            f"({candidates.library.max_lag}). Pass a longer recording, or shorten the lags."
        )
    if not candidates.targets[:, output].any():
        raise ValueError(
            f"The output {candidates.layout.outputs[output]!r} is zero at all {candidates.n_rows} usable "
            "samples (after its origin was subtracted), so no term can reduce its error. Check the recording."
        )


class _Sweep:
    """All visits to the data: chunks of samples, shared among threads, merged in the order of the chunks."""

    def __init__(self, candidates: Candidates, over_chunks: Callable):
        self.candidates = candidates
        self.over_chunks = over_chunks
        self.n_terms = len(candidates.library)
        layout = candidates.layout
        self.plan = SumPlan.of(candidates.library, layout.channels)
        self.data = candidates.recording.data.reshape(-1), len(layout.channels)
        n_chunks = -(-candidates.n_rows // CHUNK_ROWS)
        edges = np.linspace(0, candidates.n_rows, n_chunks + 1).astype(np.int64)
        self.chunks = [slice(*pair) for pair in pairwise(edges)]

    def sum(self, contributions: Callable[[slice], np.ndarray]) -> np.ndarray:
        """Return the sum of ``contributions(chunk)`` over all chunks."""
        return np.add.reduce(list(self.over_chunks(contributions, self.chunks)), axis=0)

    def inner_products(self, chunk: slice, weight: np.ndarray, squared: bool = False) -> np.ndarray:
        """Return the chunk's sums of all candidates (or of their squares) times ``weight``."""
        plan = self.plan
        totals = np.zeros(plan.n_sums)
        rows = self.candidates.rows[chunk]
        weighted_sums(*self.data, rows, weight, squared, plan.steps, plan.products, plan.runs, totals)
        return totals[plan.slots]

    def columns(self, chunk: slice, indices: np.ndarray) -> np.ndarray:
        """Return the chunk's part of the candidates at ``indices``, shape (n_indices, rows)."""
        rows = self.candidates.rows[chunk]
        columns = np.empty((indices.size, rows.size))
        term_values(*self.data, rows, self.plan.steps, self.plan.factors[indices], columns)
        return columns


@cache
def _thread_pools() -> ThreadpoolController:
    """Find the numerical libraries in this process; looking for them takes milliseconds."""
    return ThreadpoolController()


@contextmanager
def _start_sweep(candidates: Candidates, n_threads: int | None) -> Iterator[_Sweep]:
    """Open the threads, with one BLAS thread in each, and close them."""
    n_threads = 1 if candidates.n_rows <= CHUNK_ROWS else n_threads or _usable_processors()
    with _thread_pools().limit(limits=1, user_api="blas"):
        if n_threads == 1:
            yield _Sweep(candidates, map)
        else:
            with ThreadPoolExecutor(n_threads) as pool:
                yield _Sweep(candidates, pool.map)


def _usable_processors() -> int:
    """Count the processors this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Standing:
    """What is known of every candidate's ``w'w`` and ``w'r``, with bounds on the rounding in each."""

    def __init__(self, norms: np.ndarray, numerators: np.ndarray, energy: float):
        self.norm = np.sqrt(norms)  # of the whole column: the unit of every rounding error
        self.left = norms  # w'w
        self.left_error = SUM_ERROR * norms
        self.renew(numerators, energy)
        self.alive = norms > 0.0

    def renew(self, numerators: np.ndarray, residual_energy: float) -> None:
        """Take ``w'r`` from a fresh sum."""
        self.numerator = numerators  # w'r
        self.numerator_error = SUM_ERROR * self.norm * np.sqrt(residual_energy)

    def project_out(self, along: np.ndarray, gain: float) -> None:
        """Downdate by the products ``p'q`` with a new orthonormal column, and by ``gain = q'r``."""
        error = SUM_ERROR * self.norm
        self.left = self.left - along**2
        self.left_error = self.left_error + (2.0 * np.abs(along) + error) * error
        self.numerator = self.numerator - gain * along
        self.numerator_error = self.numerator_error + abs(gain) * error

    def settle(self, indices: np.ndarray, left: np.ndarray, numerator: np.ndarray, energy: float) -> None:
        """Take the explicit numbers of the candidates at ``indices``; drop the collinear ones."""
        error = EXACT_ERROR * self.norm[indices]
        self.left[indices] = left
        self.left_error[indices] = 2.0 * error * np.sqrt(left)
        self.numerator[indices] = numerator
        self.numerator_error[indices] = error * np.sqrt(energy)
        self.alive[indices[np.sqrt(left) <= COLLINEARITY * self.norm[indices]]] = False

    def bounds(self, energy: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the lowest and highest reduction of the residual's energy each candidate may bring."""
        size = np.abs(self.numerator)
        room = self.left - self.left_error
        with np.errstate(divide="ignore", invalid="ignore"):  # zero columns, and no room
            smallest = np.maximum(size - self.numerator_error, 0.0) ** 2 / (self.left + self.left_error)
            largest = np.where(room > 0.0, (size + self.numerator_error) ** 2 / room, energy)
        gone = ~self.alive
        smallest[gone] = largest[gone] = -1.0
        return np.minimum(smallest, energy), np.minimum(largest, energy)


class _Basis:
    """The chosen columns, orthonormalised, and what they leave of the output."""

    def __init__(self, sweep: _Sweep, y: np.ndarray, capacity: int):
        self.sweep = sweep
        self.columns = np.empty((capacity, y.size))
        self.products = np.empty((capacity, sweep.n_terms))  # p'q of every candidate with every column
        self.slips = np.empty(capacity)  # q'r that rounding left in the residual
        self.size = 0
        self.residual = y.copy()
        self.energy = float(y @ y)

    def examine(self, indices: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Orthogonalise candidates explicitly; a single one is kept as the column that comes next.

        Returns their ``w'w``, their ``w'r``, and what the products ``p'q`` missed of each projection,
        shape (n_indices, size), to be projected out once more.
        """
        chosen, known = self.columns[: self.size], self.products[: self.size, indices].T
        newest = self.columns[self.size : self.size + 1]

        def contribution(chunk: slice) -> np.ndarray:
            left = self.sweep.columns(chunk, indices)
            left -= known @ chosen[:, chunk]
            if indices.size == 1:
                newest[:, chunk] = left
            energy = np.einsum("ij,ij->i", left, left)
            return np.column_stack([energy, left @ self.residual[chunk], left @ chosen[:, chunk].T])

        sums = self.sweep.sum(contribution)
        missed = sums[:, 2:]
        return np.maximum(sums[:, 0] - (missed**2).sum(axis=1), 0.0), sums[:, 1], missed

    def grant(self, column: np.ndarray) -> tuple[np.ndarray, float, np.ndarray] | None:
        """Make a given ``column`` one of the basis, as `append`; None if it depends on those before."""
        chosen = self.columns[: self.size]
        left = column.copy()
        for _ in range(2):  # twice is enough for orthogonality to rounding
            left -= (chosen @ left) @ chosen
        norm = float(np.linalg.norm(left))
        if norm <= COLLINEARITY * np.linalg.norm(column):
            return None
        self.columns[self.size] = left
        return self.append(norm, float(left @ self.residual) / norm, np.zeros(self.size), True)

    def append(self, norm: float, gain: float, missed: np.ndarray, renew: bool):
        """Make the candidate examined last a column ``q`` and take ``gain`` times it off the residual.

        Returns ``p'q`` of all candidates, the exact gain ``q'r``, and all ``p'r`` (None without ``renew``).
        """
        chosen, newest = self.columns[: self.size], self.columns[self.size]

        def contribution(chunk: slice) -> np.ndarray:
            q, residual = newest[chunk], self.residual[chunk]
            q -= missed @ chosen[:, chunk]
            q /= norm
            residual -= gain * q
            weights = (q, residual) if renew else (q,)
            products = [self.sweep.inner_products(chunk, weight) for weight in weights]
            return np.concatenate([[residual @ residual, q @ residual], *products])

        energy, slip, *_ = sums = self.sweep.sum(contribution)
        products = sums[2:].reshape(-1, self.sweep.n_terms)
        self.products[self.size] = products[0]
        self.slips[self.size] = slip
        self.size += 1
        self.energy = float(energy)
        # r is orthogonal to the columns up to the slips, and p'r is meant for the part that is
        renewed = products[1] - self.slips[: self.size] @ self.products[: self.size] if renew else None
        return products[0], gain + slip, renewed


def _granted(
    candidates: Candidates, y: np.ndarray, constraints: LinearConstraints
) -> tuple[np.ndarray, np.ndarray]:
    """Return the output less what the constraints fix, and the columns that they leave free, as rows."""
    named = candidates.restrict(candidates.library.subset(list(constraints.terms))).matrix()
    fixed, free = constraints.restrict(list(constraints.terms)).solution_space()
    return y - named @ fixed, (named @ free).T


def _select(
    sweep: _Sweep,
    y: np.ndarray,
    n_terms: int,
    named: np.ndarray = NONE,
    granted: np.ndarray | None = None,
) -> ScreenPath:
    """Run the forward selection of `screen_terms`, without the ``named`` terms, after ``granted`` columns."""
    y = np.ascontiguousarray(y)
    granted = np.empty((0, y.size)) if granted is None else granted
    one = np.ones(y.size)

    def first_sums(chunk: slice) -> np.ndarray:
        return np.stack(
            [sweep.inner_products(chunk, one[chunk], True), sweep.inner_products(chunk, y[chunk])]
        )

    norms, numerators = sweep.sum(first_sums)
    n_passes, n_verified = 2, 0
    wanted = min(n_terms, sweep.n_terms - named.size)
    basis = _Basis(sweep, y, min(wanted + len(granted), y.size + 1))
    total = basis.energy
    standing = _Standing(norms, numerators, total)
    for column in granted:
        taken = basis.grant(column)
        if taken is not None:
            standing.project_out(*taken[:2])
            standing.renew(taken[2], basis.energy)
            n_passes += 2
    standing.alive[named] = False
    fresh = basis.energy
    order: list[int] = []
    err: list[float] = []
    stopped_at = "n_terms"
    while True:
        index, missed, n_examined = _leader(standing, basis)
        n_verified += n_examined
        if index is None:
            stopped_at = "exhausted"
            break
        norm = np.sqrt(standing.left[index])
        gain = standing.numerator[index] / norm
        order.append(index)
        err.append(gain**2 / total)
        standing.alive[index] = False
        if len(order) == wanted:
            break
        renew = basis.energy - gain**2 < REFRESH**2 * fresh
        along, gain, renewed = basis.append(norm, gain, missed, renew)
        n_passes += 1 + renew
        if basis.energy <= EXACT * total:
            stopped_at = "explained"
            break
        standing.project_out(along, gain)
        if renewed is not None:
            fresh = basis.energy
            standing.renew(renewed, fresh)
    collinear = np.setdiff1d(np.flatnonzero(~standing.alive), [*order, *named])
    return ScreenPath(
        np.array(order, dtype=np.int64), np.array(err), collinear, int(n_passes), n_verified, stopped_at
    )


def _leader(standing: _Standing, basis: _Basis) -> tuple[int | None, np.ndarray, int]:
    """Find the candidate that reduces the residual most, the lowest index of those equal to rounding.

    Returns it (None: no independent candidate is left), what `_Basis.examine` found missing of its
    projection, and how many columns were examined. The leader is the one examined last, and alone.
    """
    settled = np.zeros(standing.alive.size, dtype=bool)
    n_examined = 0
    while standing.alive.any():
        lowest, highest = standing.bounds(basis.energy)
        contenders = np.flatnonzero(standing.alive & (highest >= lowest.max()))
        unsettled = contenders[~settled[contenders]]
        decided = unsettled.size == 0
        batch = (
            contenders[:1] if decided else unsettled[np.argsort(-highest[unsettled], kind="stable")[:BATCH]]
        )
        left, numerator, missed = basis.examine(batch)
        n_examined += batch.size
        standing.settle(batch, left, numerator, basis.energy)
        settled[batch] = True
        if decided or (contenders.size == 1 and standing.alive[batch[0]]):
            return int(batch[0]), missed[0], n_examined
    return None, np.empty(0), n_examined

"""States read back from what an output function makes of them: another unit, a difference, a sum."""

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.simulators.addresses import equation_address, equation_at, row_of, write
from narx_sklearn.discrepancy.simulators.simulator import Simulator

ALIKE = 1e-9  # of an output's terms, which a sum that is one leaves to rounding
CERTAIN = 1e-6  # of a state, that outputs may leave open
BALANCED = 8  # times, each by the root of what is out of balance
OTHER = 1.01  # times a parameter, with which an output may be another one
ASKEW = 0.7548776662466927  # steps on, each another share of one: no two states move together


@njit(nogil=True, cache=True)
def _write_rows(address, x, u, p, written):
    """Write what an output function makes of each row of its arguments."""
    output = equation_at(address)
    for k in range(x.shape[0]):
        write(output, row_of(x, k), row_of(u, k), p, row_of(written, k))


def states_read(simulator: Simulator, u: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the states that outputs tell, (n, n_states); NaN for the others.

    Outputs count that are sums of states, each times something that neither states nor parameters change.

    Parameters
    ----------
    u, y : ndarray of shape (n, n_inputs), (n, n_outputs)
        Inputs and outputs at the same samples.
    """
    n, n_states = len(u), len(simulator.states)
    read = np.full((n, n_states), np.nan)
    _, output = simulator._equations()
    address, p = equation_address(output), simulator._coefficients(simulator.nominal)
    u = np.require(u, dtype=float, requirements=["C", "W"])

    def outputs(x, p=p, rate=0.0):
        seen = np.tile(np.concatenate([x, np.full(n_states if simulator.sees_rates else 0, rate)]), (n, 1))
        written = np.full((n, len(simulator.outputs)), np.nan)
        _write_rows(address, seen, u, np.require(p, dtype=float, requirements=["C", "W"]), written)
        return written

    x0 = simulator.x0
    size = np.where(x0 == 0, 1.0, np.abs(x0))
    aside = size * (1.0 + np.arange(1, n_states + 1) * ASKEW % 1.0)
    try:
        at_first = outputs(x0)
        slopes = np.stack([(outputs(x0 + step) - at_first) / step.sum() for step in np.diag(size)], axis=2)
        terms = np.abs(at_first) + np.abs(slopes) @ aside
        there, behind = outputs(x0 + aside), outputs(x0 - aside)
        others = outputs(x0 + aside, p * OTHER), outputs(x0 + aside, rate=1.0)
    except Exception:  # by a function that such states make no sense to
        return read
    with np.errstate(invalid="ignore"):
        is_sum = np.abs(there - at_first - slopes @ aside) <= ALIKE * terms
        for same, as_this in ((at_first + at_first - there, behind), *((there, other) for other in others)):
            is_sum &= np.abs(as_this - same) <= ALIKE * terms
    told = np.flatnonzero(is_sum.all(axis=0))
    if not told.size or not n:
        return read
    return _solved(slopes[:, told], y[:, told] - at_first[:, told]) + x0


def _solved(slopes: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return what sums of states, (n, n_outputs), tell of them, (n, n_states); NaN where one is missing.

    Units may differ by any factor, so rows and columns are balanced first (Ruiz 2001, RAL-TR-2001-034).
    """
    lengths = np.abs(slopes).max(axis=0)  # of each sum, and then of each state in them
    row, column = np.ones((slopes.shape[1], 1)), np.ones(slopes.shape[2])
    for _ in range(BALANCED):
        left = np.sqrt(lengths / row / column)
        of_row, of_column = left.max(axis=1, keepdims=True), left.max(axis=0)
        row *= np.where(of_row > 0, of_row, 1.0)
        column *= np.where(of_column > 0, of_column, 1.0)
    inverse = np.linalg.pinv(slopes / row / column, rcond=CERTAIN)
    certain = np.einsum("nji,nij->nj", inverse, slopes / row / column) > 1.0 - CERTAIN
    needed = np.abs(inverse) > CERTAIN
    missing = np.any(needed & ~np.isfinite(y)[:, None, :], axis=2)
    x = np.einsum("nji,ni->nj", inverse, np.where(np.isfinite(y), y, 0.0) / row[:, 0]) / column
    return np.where(certain & ~missing, x, np.nan)

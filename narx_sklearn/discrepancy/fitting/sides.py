"""Initial states that nobody measured, looked for from several sides where a fit from one side is poor.

A sensor that reads a square, a size or the cosine of an angle tells as little of the side on which a machine
is as no sensor at all. A fit goes down to the valley in which it begins, and may end in a mirrored one.
"""

import numpy as np
from scipy.stats import chi2

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit_states
from narx_sklearn.discrepancy.fitting.start import ITERATIONS, fit_initial_states
from narx_sklearn.discrepancy.simulators.simulator import Windows, covered

RARELY = 1e-3  # of the windows of noise alone leave so much that they are looked into
PLACES = 16  # of those visited, from which windows may begin


def from_other_sides(problem: Problem, found: Fit, tolerated: float = 1.0) -> Fit:
    """Return a fit of the initial states, windows that keep more than noise begun from other sides too.

    These sides are the state on the other side of zero, that which a run reaches from the last window
    before it that is not poor, and the best of those visited. Only states that are not measured move there.

    Parameters
    ----------
    found : Fit
        From one side.
    tolerated : float, default=1.0
        Cost of a sample that is noise; 0 looks from all sides whatever the first fit leaves.
    """
    windows = problem.windows
    known = problem.simulator.known_states(problem.u, problem.y, windows.first, windows.began)
    hidden = ~np.isfinite(known) & problem.simulator.free_states
    for side in (_mirrored, _reached, _visited):
        costs = _by_window(problem, found.model)
        counts = problem.weighted.sum(axis=(1, 2))
        poor = (counts > 0) & (costs > tolerated * chi2.isf(RARELY, np.maximum(counts, 1)))
        moved = hidden & poor[:, None]
        if not moved.any():
            break
        start = side(problem, found.model, poor)
        start = np.where(moved & np.isfinite(start), start, found.model.x0)
        found = _better_of(problem, found, fit_initial_states(problem, start))
    return found


def _mirrored(problem: Problem, model: Model, poor: np.ndarray) -> np.ndarray:
    """Return states on the other side of zero."""
    return -model.x0


def _reached(problem: Problem, model: Model, poor: np.ndarray) -> np.ndarray:
    """Return states that runs reach which are begun anew in no poor window that follows on another."""
    windows, x = problem.windows, np.full((len(problem.u), model.x0.shape[1]), np.nan)
    follows = np.zeros(windows.count, dtype=bool)
    follows[1:] = (windows.first[1:] == windows.last[:-1]) & (windows.began[1:] == windows.began[:-1])
    begins = np.flatnonzero(~(poor & follows))
    ends = np.append(begins[1:], windows.count) - 1
    through = Windows(windows.first[begins], windows.last[ends], windows.fresh[begins], windows.began[begins])
    x = problem.over(through).run(model._replace(x0=model.x0[begins])).x
    return x[windows.first]


def _visited(problem: Problem, model: Model, poor: np.ndarray) -> np.ndarray:
    """Return, of some states that the windows' runs visit, the one from which each poor window fits best."""
    x = problem.run(model).x[covered(problem.windows)]
    x = x[np.isfinite(x).all(axis=1)]
    best, least = model.x0, np.full(poor.size, np.inf)
    for place in x[np.linspace(0, len(x) - 1, min(PLACES, len(x))).astype(int)]:
        costs = _by_window(problem, model._replace(x0=np.where(poor[:, None], place, model.x0)))
        best = np.where((costs < least)[:, None], place, best)
        least = np.minimum(costs, least)
    return best


def _better_of(problem: Problem, one: Fit, other: Fit) -> Fit:
    """Return a fit whose windows begin as in the better of two."""
    better = _by_window(problem, other.model) < _by_window(problem, one.model)
    if not better.any():
        return one
    x0 = np.where(better[:, None], other.model.x0, one.model.x0)
    both = fit_states(problem, other.model._replace(x0=x0), iterations=ITERATIONS)
    return min(one, other, both, key=lambda found: found.cost)


def _by_window(problem: Problem, model: Model) -> np.ndarray:
    """Return the cost of each window, infinite where its run is lost."""
    with np.errstate(over="ignore", invalid="ignore"):
        residual = problem.residual(problem.run(model))
        return np.nan_to_num(np.einsum("wt,wt->w", residual, residual), nan=np.inf)

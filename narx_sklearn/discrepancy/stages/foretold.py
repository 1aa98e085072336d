"""Do laws foretell what is missing from one half of a record in the other? Stand-ins do not."""

from itertools import permutations

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit, fit_states

HALVES = 2  # of a record, the windows in order of time
FORETOLD = 0.25  # share of what is left of the other half, that laws take off which are no stand-ins


def are_foretelling(problem: Problem, base: Model, told: Model) -> bool:
    """Tell whether laws say much of the half of a record that they were not fitted to.

    What a course of its own does beside them needs none: it is fitted to the half that it describes.
    """
    return bool(share_foretold(problem, base, told) > FORETOLD)


def share_foretold(problem: Problem, base: Model, told: Model) -> float:
    """Return the share of squares that laws take off in the half of a record that they were not fitted to.

    Both models are fitted to either half, and judged on the other with its initial states alone; outputs
    count in deviations of their noise. Below zero where laws leave more; NaN where there are no two halves,
    or a run diverges.

    Parameters
    ----------
    base, told : Model
        Without and with the laws, over the problem's windows.
    """
    count = problem.windows.count
    half = np.arange(count) * HALVES // count
    halves = [problem.only(half == k) for k in range(HALVES)]
    if not all(part.seen.any() for part in halves):
        return np.nan
    left = np.zeros(2)
    for fitted, judged in permutations(halves):
        for k, model in enumerate((base, told)):
            found = fit_states(judged, fit(fitted, model).model)
            off = judged.left_over(found.model) / problem.noise.sigma
            left[k] += np.sum(off**2) if np.isfinite(found.cost) else np.nan
    return float(1.0 - left[1] / left[0])

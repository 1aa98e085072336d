"""Choices judged fold by fold, of which those that can no longer win are not judged any further.

Errors only add up: a choice whose errors on some folds are already larger than all those of a better one
stays behind it whatever the other folds say (a race with exact bounds; Maron and Moore 1994 race with bounds
that hold by chance).
"""

from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager

import numpy as np
from joblib import Parallel, delayed

__all__ = ["race"]

# judges the choices of a group of which a mask says so: scores and numbers of terms, one each
Judge = Callable[[int, np.ndarray], tuple[np.ndarray, np.ndarray]]


def race(
    open_fold: Callable[[int], AbstractContextManager[Judge]],
    weights: np.ndarray,
    shape: tuple[int, int],
    *,
    kept: int = 1,
    slack: float = 1.0,
    n_jobs: int | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return what choices score on folds, NaN where a choice was out of the race by then.

    All are judged on the heaviest fold. The groups that lead there go through all folds at once, so that
    there is something to be worse than, and the others follow fold by fold.

    Parameters
    ----------
    open_fold : callable
        Makes a fold ready, and returns what judges choices on it.
    weights : ndarray of shape (n_folds,)
        Weights of the folds, of sum one.
    shape : tuple of two int
        Number of groups, which are judged at once, and of choices in each.
    kept : int, default=1
        How many groups, by their best choice, must be judged on all folds.
    slack : float, default=1.0
        How many times the errors of the last of these another choice may reach and stay.
    n_jobs : int, default=None
        Threads over groups.

    Returns
    -------
    scores, counts : ndarray of shape (n_groups, n_choices, n_folds)
        R² of the free run, and numbers of terms.

    Examples
    --------
    >>> from contextlib import nullcontext
    >>> import numpy as np
    >>> from narx_sklearn.identification.cross_validation.race import race
    >>> table = np.array([[[0.9, 0.8]], [[0.2, 0.9]]])  # scores of two groups of one choice on two folds
    >>> def open_fold(f):
    ...     return nullcontext(lambda g, asked: (table[g, asked, f], np.ones(asked.sum())))
    >>> race(open_fold, np.array([0.5, 0.5]), (2, 1))[0][:, 0]
    array([[0.9, 0.8],
           [0.2, nan]])
    """
    n_groups, n_choices = shape
    scores = np.full((n_groups, n_choices, len(weights)), np.nan)
    counts = scores.copy()

    def judge(f: int, groups: Iterable[int], running: np.ndarray) -> None:
        asked = [(int(g), running[g] & np.isnan(scores[g, :, f])) for g in groups]
        asked = [(g, which) for g, which in asked if which.any()]
        if not asked:
            return
        with open_fold(f) as judge_group:
            judged = Parallel(n_jobs=n_jobs, prefer="threads")(delayed(judge_group)(*one) for one in asked)
        for (g, which), (found, n_terms) in zip(asked, judged, strict=True):
            scores[g, which, f], counts[g, which, f] = found, n_terms

    def errors() -> np.ndarray:
        return np.nansum(weights * (1.0 - scores), axis=2)

    running = np.ones(shape, dtype=bool)
    first, *others = np.argsort(-weights, kind="stable").tolist()
    judge(first, range(n_groups), running)
    if kept < n_groups:
        leaders = np.argsort(errors().min(axis=1), kind="stable")[:kept]
        for f in others:
            judge(f, leaders, running)
    for f in others:
        complete = np.where(np.isnan(scores).any(axis=2), np.inf, errors()).min(axis=1)
        worst_kept = np.sort(complete)[min(kept, n_groups) - 1]
        running &= errors() <= slack * worst_kept
        judge(f, range(n_groups), running)
    return scores, counts

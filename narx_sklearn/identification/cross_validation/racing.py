"""A race over folds: what has made more errors than a better choice makes in all is judged no further.

No fold takes an error back, so that what is left out could not have won, whatever the folds to come said.
"""

from collections.abc import Callable

import numpy as np

__all__ = ["race", "room_of_a_standard_error"]

# sums of the same errors in another order differ by less than this share
ROUNDING = 1e-9


def room_of_a_standard_error(weights: np.ndarray) -> float:
    """Return how many times the errors of a choice those within a standard error of it may reach.

    The largest standard error that scores of a given mean over folds of these weights can have is that of a
    choice whose errors all lie in one fold; see `Judged.standard_error`.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification.cross_validation.racing import room_of_a_standard_error
    >>> round(room_of_a_standard_error(np.full(4, 0.25)), 6)  # 1 + sqrt(0.75)
    1.866025
    """
    squares = weights**2
    return 1.0 + float(np.sqrt(((1.0 - weights) ** 2 + squares.sum() - squares).max()))


def race(
    judge: Callable[[int, np.ndarray], tuple[np.ndarray, np.ndarray]],
    weights: np.ndarray,
    shape: tuple[int, int],
    *,
    kept: int = 1,
    room: float = 1.0,
    whole: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Return what choices score on every fold, NaN on folds that they did not reach.

    All are judged on the fold of the largest weight. The structures that lead there go through all the
    others first, and set the mark that the rest must not miss.

    Parameters
    ----------
    judge : callable
        Takes a fold and a mask of choices, shape ``shape``, returns their scores and numbers of terms as two
        arrays of that shape, of which only what the mask asks for is read.
    weights : ndarray of shape (n_folds,)
        Weights of the folds, of sum one.
    shape : tuple of int
        Number of structures, and of sizes of each.
    kept : int, default=1
        Number of structures that must come out as they would without a race, each by its best size.
    room : float, default=1.0
        How many times the errors of the last of these a choice may reach, and go on.
    whole : bool, default=False
        Whether all sizes of a structure go on as long as one of them does.

    Returns
    -------
    scores : ndarray of shape (n_structures, n_sizes, n_folds)
        Scores, at most 1.
    counts : ndarray of the same shape
        Numbers of terms.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification.cross_validation.racing import race
    >>> table = np.array([[0.9, 0.9], [0.1, 0.95], [0.8, 0.1]])[:, None]  # of three structures on two folds
    >>> judge = lambda fold, wanted: (table[:, :, fold], np.ones((3, 1)))
    >>> race(judge, np.array([0.5, 0.5]), (3, 1))[0][:, 0]
    array([[0.9, 0.9],
           [0.1, nan],
           [0.8, 0.1]])
    """
    scores = np.full((*shape, len(weights)), np.nan)
    counts = scores.copy()

    def go(fold: int, asked: np.ndarray) -> None:
        asked = asked & np.isnan(scores[..., fold])
        if asked.any():
            for store, found in zip((scores, counts), judge(fold, asked), strict=True):
                store[asked, fold] = found[asked]

    first, *others = np.argsort(-weights, kind="stable").tolist()
    every = np.ones(shape, dtype=bool)
    go(first, every)
    leading = np.zeros(shape, dtype=bool)
    leading[np.argsort(-scores[..., first].max(axis=1), kind="stable")[:kept]] = True
    for fold in others:
        go(fold, leading)
    for fold in others:
        errors = np.nansum(weights * (1.0 - scores), axis=-1)
        complete = np.where(np.isnan(scores).any(axis=-1), np.inf, errors).min(axis=1)
        mark = room * np.sort(complete)[min(kept, shape[0]) - 1]
        within = errors <= mark * (1.0 + ROUNDING)
        go(fold, every & within.any(axis=1, keepdims=True) if whole else within)
    return scores, counts

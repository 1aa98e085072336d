"""What choices score on held-out folds, and what that makes of them together."""

from typing import NamedTuple

import numpy as np

__all__ = ["Judged", "fold_weights"]


def fold_weights(scatter: np.ndarray) -> np.ndarray:
    """Return the share that each fold has in what the outputs do, from sums of squares (n_folds, n_outputs).

    An R² divides by what its own fold does: where the output hardly moves, a small error makes it hugely
    negative, and the mean over folds would be that fold's alone. Weighted so it is the R² of all held-out
    errors together.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification.cross_validation.judged import fold_weights
    >>> fold_weights(np.array([[3.0], [1.0]])).tolist()
    [0.75, 0.25]
    """
    total = scatter.sum(axis=0)
    moving = total > 0.0
    if not moving.any():
        return np.full(len(scatter), 1.0 / len(scatter))
    return (scatter[:, moving] / total[moving]).mean(axis=1)


class Judged(NamedTuple):
    """Choices of a search and what each scored.

    Attributes
    ----------
    choices : list of dict
        Parameters of the regressor.
    scores : ndarray of shape (n_choices, n_folds)
        Held-out R² of the free run, NaN on folds that a choice did not reach in a race.
    counts : ndarray of shape (n_choices, n_folds)
        Numbers of terms, NaN there too.
    weights : ndarray of shape (n_folds,)
        Weights of the folds, of sum one; see `fold_weights`.
    """

    choices: list[dict]
    scores: np.ndarray
    counts: np.ndarray
    weights: np.ndarray

    @property
    def pooled(self) -> np.ndarray:
        """R² of each choice over all folds together, NaN where some were not reached."""
        return self.scores @ self.weights

    @property
    def standard_error(self) -> np.ndarray:
        """Standard error of that; of folds of one weight their deviation over the root of their number."""
        return np.sqrt((self.scores - self.pooled[:, None]) ** 2 @ self.weights**2)

    @property
    def n_reached(self) -> np.ndarray:
        """Number of folds on which each choice was judged."""
        return np.isfinite(self.scores).sum(axis=1)

    @property
    def within_reach(self) -> np.ndarray:
        """What each would score over all folds together if it made no error on those it did not reach."""
        return 1.0 - np.nansum(self.weights * (1.0 - self.scores), axis=1)

    def followed_by(self, others: "Judged") -> "Judged":
        """Return these choices and then the others."""
        return Judged(
            self.choices + others.choices,
            np.vstack([self.scores, others.scores]),
            np.vstack([self.counts, others.counts]),
            self.weights,
        )

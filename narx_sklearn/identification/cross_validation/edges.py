"""Where the best choice lies at the edge of the grid, and lies there for a reason."""

import numpy as np

from narx_sklearn.identification.cross_validation.judged import Judged

__all__ = ["clear_edges"]

GROWING = ("output_lags", "input_lags", "degree")  # with which a model can do more
# standard errors of a difference that chance rarely makes, the usual two
CLEAR = 2.0


def clear_edges(judged: Judged, best: int) -> dict[str, int]:
    """Return the parameters of which the best choice has the largest value of the grid, and needs it.

    It needs it where the best of what has smaller values is worse by more than two standard errors of
    the difference over the folds, or was left out of a race. Grids that hold lists of lags have no edge.

    Parameters
    ----------
    judged : Judged
        Choices of the same kind, all of the grid or all refined.
    best : int
        Which is the best of them.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification.cross_validation.edges import clear_edges
    >>> from narx_sklearn.identification.cross_validation.judged import Judged
    >>> grid = [{"output_lags": n, "degree": d} for n in (1, 2) for d in (1, 2)]
    >>> scores = np.array([[0.50, 0.52], [0.51, 0.51], [0.90, 0.92], [0.93, 0.91]])
    >>> clear_edges(Judged(grid, scores, np.ones((4, 2)), np.full(2, 0.5)), 3)
    {'output_lags': 2}
    """
    found = {}
    for name in (name for name in GROWING if name in judged.choices[best]):
        values = [choice[name] for choice in judged.choices]
        if not all(isinstance(value, int | np.integer) for value in values):
            continue
        smaller = np.flatnonzero(np.array(values) < values[best])
        if values[best] < max(values) or not smaller.size:
            continue
        complete = smaller[np.isfinite(judged.pooled[smaller])]
        if complete.size:
            rival = complete[np.argmax(judged.pooled[complete])]
            gain = judged._replace(scores=(judged.scores[best] - judged.scores[rival])[None])
            if not gain.pooled[0] > CLEAR * gain.standard_error[0]:
                continue
        found[name] = int(values[best])
    return found

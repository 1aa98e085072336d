"""Play operator: lost motion of a given radius."""

import numpy as np
from numba import njit

from narx_sklearn.model.operators import play_step
from narx_sklearn.physics._checks import check_signal

__all__ = ["play"]


@njit(cache=True, nogil=True)
def _play_run(u, radii, state):
    """Return the states of all plays along u, shape (n_samples, n_radii), from ``state`` on."""
    states = np.empty((u.size, radii.size))
    for j in range(radii.size):
        w = state[j]
        for k in range(u.size):
            w = play_step(w, u[k], radii[j])
            states[k, j] = w
    return states


def check_radii(radii) -> np.ndarray:
    """Return radii as a float vector, not negative, or raise."""
    radii = np.atleast_1d(np.asarray(radii, dtype=float))
    if radii.ndim != 1 or radii.size == 0 or not np.all(np.isfinite(radii)) or np.any(radii < 0):
        raise ValueError(f"radii must be finite numbers of 0 or more, got {radii.tolist()}.")
    return radii


def play(u, radii, *, initial_state=None) -> np.ndarray:
    """Run play operators over a signal.

    ``w[k] = max(min(u[k] + r, w[k-1]), u[k] - r)``: the output stays while the input moves inside the play
    and is dragged along outside. It depends on values of the input, not on their rate, and remembers
    reversals; sums of plays make hysteresis with minor loops.

    Parameters
    ----------
    u : array-like of shape (n_samples,)
        Input.
    radii : float or array-like of shape (n_radii,)
        Half the lost motion of each play, in the unit of `u`, 0 or more; with 0 the output is the input.
    initial_state : float, array-like of shape (n_radii,) or None, default=None
        Outputs before the first sample, in the unit of `u`; None means 0 (no history).

    Returns
    -------
    ndarray of shape (n_samples, n_radii)
        Output of each play at the present sample; its last row is the state to go on from.

    Raises
    ------
    ValueError
        If a radius is negative or not finite, or `initial_state` has another length than `radii`.

    See Also
    --------
    PrandtlIshlinskiiOperator : Weighted sum of plays.

    References
    ----------
    Abreu (2021), eq. (2.7).

    Examples
    --------
    >>> from narx_sklearn.physics import play
    >>> play([0, 2, 1, -1], [0, 1])[:, 1].tolist()
    [0.0, 1.0, 1.0, 0.0]
    """
    u, radii = check_signal(u), check_radii(radii)
    state = np.zeros(radii.size) if initial_state is None else np.asarray(initial_state, dtype=float)
    if state.ndim > 1 or state.size not in (1, radii.size) or not np.all(np.isfinite(state)):
        raise ValueError(
            f"initial_state must be one finite number or one for each of the {radii.size} radii, got "
            f"{state.tolist()}."
        )
    return _play_run(u, radii, np.array(np.broadcast_to(state, radii.shape)))

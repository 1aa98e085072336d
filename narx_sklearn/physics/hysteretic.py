"""Deng and Tan's hysteretic operator."""

from numbers import Integral

import numpy as np
from numba import njit

from narx_sklearn.model.operators import hysteretic_state_size, hysteretic_step
from narx_sklearn.physics._checks import check_signal

__all__ = ["hysteretic_operator"]


@njit(cache=True, nogil=True)
def _hysteretic_run(u, state):
    """Return the operator's output along u, and the state after it."""
    state = state.copy()
    h = np.empty(u.size)
    for k in range(u.size):
        h[k] = hysteretic_step(state, u[k])
    return h, state


def hysteretic_operator(u, *, memory: int = 16) -> np.ndarray:
    """Run Deng and Tan's hysteretic operator over a signal.

    ``h[k] = |arctan(u[k] - u_ext)| (u[k] - u_ext) + h_ext``, where ``(u_ext, h_ext)`` are the input and the
    output at the dominant extremum before sample k, both 0 at the beginning. As one more signal beside the
    input it makes hysteresis single-valued, so that a polynomial can describe it.

    Parameters
    ----------
    u : array-like of shape (n_samples,)
        Input. The operator takes its unit as it comes: scale the input so that its changes are about 1.
    memory : int, default=16
        Extrema remembered. With 1, only the last reversal counts; with more, a minor loop that closes is
        forgotten and the branch it had interrupted goes on. When more are open, the oldest is dropped.

    Returns
    -------
    ndarray of shape (n_samples,)
        Output, which depends on the present and past inputs.

    Raises
    ------
    ValueError
        If `memory` is less than 1.
    TypeError
        If `memory` is no integer.

    Notes
    -----
    The reference says that the coordinates of an extremum are kept, and used again when the input returns
    to it, without saying how many are kept. Here those are kept that a Preisach operator would keep, so the
    operator wipes out closed loops. The start, input and output 0, counts as the first
    extremum.

    References
    ----------
    Deng and Tan (2009), Sensors and Actuators A 149, 254-262; Abreu (2021), eq. (2.55), Remark 2.8
    and Example 2.8.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.physics import hysteretic_operator
    >>> t = 0.02 * np.arange(700)
    >>> h = hysteretic_operator(2.5 * np.sin(1.5 * t) + 4 * np.sin(0.5 * t))
    >>> round(float(h.max()), 3)
    6.471
    """
    if not isinstance(memory, Integral) or isinstance(memory, bool):
        raise TypeError(f"memory must be an integer, got {memory!r}.")
    if memory < 1:
        raise ValueError(f"memory={memory} keeps no extremum; pass at least 1.")
    return _hysteretic_run(check_signal(u), np.zeros(hysteretic_state_size(int(memory))))[0]

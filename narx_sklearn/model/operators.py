"""One-sample kernels of the elements with memory or direction: play, hysteretic operator, signs.

Each kernel advances one element by one input sample, so that a free run can call it inside its own loop.
A state that is one number goes in and comes out; a state that is an array is written in place, and an array
of zeros is always the virgin state (input 0, output 0, no history).
"""

import numpy as np
from numba import njit

# Layout of the hysteretic operator's state: four scalars, then one (input, output) pair for each extremum.
_U, _H, _DIRECTION, _TOP, _PAIRS = 0, 1, 2, 3, 4


@njit(cache=True, nogil=True)
def play_step(w, u, r):
    """Return the next state of the play operator of radius r, `max(min(u + r, w), u - r)`.

    Thesis eq. (2.7): inside the play the state w stays, outside it is dragged along by u.
    """
    return max(min(u + r, w), u - r)


@njit(cache=True, nogil=True)
def sign(x):
    """Return 1.0, -1.0 or 0.0, the sign of x (thesis eq. (2.2))."""
    if x > 0.0:
        return 1.0
    if x < 0.0:
        return -1.0
    return 0.0


@njit(cache=True, nogil=True)
def smooth_sign(x, eps):
    """Return `tanh(x / eps)`: the sign of x, smoothed over a width eps > 0 (unit of x)."""
    return np.tanh(x / eps)


@njit(cache=True, nogil=True)
def polynomial(coef, u):
    """Return `coef[0] + coef[1] u + coef[2] u^2 + ...` by Horner's rule; 0.0 without coefficients."""
    value = 0.0
    for i in range(coef.shape[0] - 1, -1, -1):
        value = value * u + coef[i]
    return value


@njit(cache=True, nogil=True)
def asymmetric_sign(d, u, loading, unloading, threshold):
    """Return the multi-valued function of thesis eqs. (2.56) and (2.66) with polynomial branches.

    d is the change of the input (its first difference), u the input. Where `d > threshold` the value is the
    polynomial `loading` in u, where `d < -threshold` the polynomial `unloading`, otherwise 0.0. With
    loading = [1], unloading = [-1] and threshold = 0 this is the sign of d; (2.66) has [0, 1] and [-1].
    """
    if d > threshold:
        return polynomial(loading, u)
    if d < -threshold:
        return polynomial(unloading, u)
    return 0.0


def hysteretic_state_size(memory):
    """Return the length of the state of a hysteretic operator that remembers `memory` >= 1 extrema."""
    return _PAIRS + 2 * memory


@njit(cache=True, nogil=True)
def _arctan_branch(distance):
    return abs(np.arctan(distance)) * distance


@njit(cache=True, nogil=True)
def hysteretic_step(state, u):
    """Advance the hysteretic operator of thesis eq. (2.55) by one sample; `state` is written.

    Returns `h = |arctan(u - u_ext)| (u - u_ext) + h_ext`, where (u_ext, h_ext) is the dominant extremum next
    to u. `state` has `hysteretic_state_size(memory)` elements: last input, last output, last direction (-1,
    0, 1), index of the newest remembered extremum, then the extrema as pairs (input, output), oldest first.

    At a reversal the last sample is remembered as an extremum. Reaching an extremum again closes the loop
    begun there: the pair that formed it is forgotten (wiping out), and the branch that the loop had
    interrupted continues. When more than `memory` extrema are open, the oldest is forgotten; with
    `memory` = 1 only the last reversal counts.
    """
    if u == state[_U]:
        return state[_H]
    direction = 1.0 if u > state[_U] else -1.0
    top = int(state[_TOP])
    if direction * state[_DIRECTION] < 0.0:
        if _PAIRS + 2 * (top + 1) < state.shape[0]:
            top += 1
        else:
            for i in range(_PAIRS, _PAIRS + 2 * top):
                state[i] = state[i + 2]
        state[_PAIRS + 2 * top] = state[_U]
        state[_PAIRS + 2 * top + 1] = state[_H]
    # The loop begun at the last but one extremum closes where u reaches that extremum.
    while top >= 1 and direction * (u - state[_PAIRS + 2 * (top - 1)]) >= 0.0:
        if top >= 2:
            top -= 2
        else:  # the outermost extremum is passed: only the one opposite remains dominant
            state[_PAIRS] = state[_PAIRS + 2]
            state[_PAIRS + 1] = state[_PAIRS + 3]
            top = 0
    h = _arctan_branch(u - state[_PAIRS + 2 * top]) + state[_PAIRS + 2 * top + 1]
    state[_U] = u
    state[_H] = h
    state[_DIRECTION] = direction
    state[_TOP] = top
    return h

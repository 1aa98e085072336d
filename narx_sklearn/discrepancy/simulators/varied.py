"""Equations in which a parameter depends on a signal: it is another one at every place where it stands.

    p_j -> p_j factor(w, theta),   w a weighted sum of the inputs and states at that moment

The kernel hands an equation one vector of parameters, and knows nothing of this: behind the simulator's own
stand, for each such effect, the index of the parameter, the effect's strength, the weights of the signal and
theta. An equation so wrapped takes them off, and calls the one inside with the parameter as it is then. The
kernel knows one thing only: which of the values, strengths, are zero but for a while.
"""

from collections.abc import Iterable
from functools import lru_cache
from typing import Any

import numpy as np
from numba import carray, njit

from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.simulators.addresses import EQUATION

KEPT = 128  # wrapped equations remembered


def varied(
    equations: tuple[Any, Any], p: np.ndarray, effects: Iterable[tuple[PlacedEffect, float]], n_states: int
) -> tuple[Any, Any, np.ndarray, np.ndarray]:
    """Return right-hand side and output with parameters that depend on signals, and what they read.

    Last what acts for a while only, (n, 5): where its strength stands, the strength, between which times, and
    whether these are along the record.

    Parameters
    ----------
    equations : (compiled right-hand side, compiled output)
    p : ndarray of shape (n_parameters,)
        The parameters that are to vary.
    effects : iterable of (PlacedEffect, float)
        Effects and their strengths; those at other ports than parameters count for nothing.
    """
    equation, output = equations
    timed = []
    for placed, strength in effects:
        if placed.port.is_parameter:
            factor = compiled_factor(placed.effect.factor)
            equation, output = (
                _wrapped(inner, factor, n_states, placed.n_theta) for inner in (equation, output)
            )
            if placed.passes:
                timed.append([p.size + 1, strength, *placed.during])
            p = np.concatenate([p, [placed.port.index, strength], placed.second, placed.theta])
    return equation, output, p, np.array(timed, dtype=float).reshape(-1, 5)


@lru_cache(maxsize=KEPT)
def compiled_factor(function: Any):
    """Return an effect's factor compiled: from disk when it was declared so, else anew."""
    return function if hasattr(function, "py_func") else njit(nogil=True, error_model="numpy")(function)


@lru_cache(maxsize=KEPT)
def _wrapped(equation: Any, factor: Any, n_states: int, n_theta: int):
    """Return an equation that reads a parameter with its factor; the last values of ``p`` say which."""

    def write(x, u, p, written, n_x, n_u, n_p, n_written):
        own = carray(p, (n_p,))
        begin = n_p - (2 + n_u + n_states + n_theta)
        at, weights = int(own[begin]), begin + 2
        signal = 0.0
        for i in range(n_u):
            if own[weights + i] != 0.0:
                signal += own[weights + i] * u[i]
        for i in range(n_states):
            if own[weights + n_u + i] != 0.0:
                signal += own[weights + n_u + i] * x[i]
        constant = own[at]
        own[at] = constant * (1.0 + own[begin + 1] * (factor(signal, own[n_p - n_theta :]) - 1.0))
        equation(x, u, p, written, n_x, n_u, begin, n_written)
        own[at] = constant  # the vector belongs to one run alone

    return njit(EQUATION, error_model="numpy", nogil=True)(write)

"""Outputs that repeat how fast a speed changes: an accelerometer's, which feels what is not simulated too.

Whoever writes such an output copies the right-hand side of that speed, ``h_i(x, u, p) = a f_j(x, u, p)``. A
force that is found in the equation would not show in the copy; as a rate that the output reads it does.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.simulators.addresses import EQUATION

POINTS, ENOUGH = 12, 6  # points at which outputs are held against rates, and that have to be finite
MOVED = 0.3  # of a parameter, from point to point
SAME = 1e-9  # relative difference of what is the same
KEPT = 64  # outputs remembered


class Acceleration(NamedTuple):
    """An output that is how fast a speed changes, in its unit."""

    output: int
    state: int  # the speed
    factor: float


def find_accelerations(
    rates: Callable, outputs: Callable, sizes: tuple[int, int, int], p: np.ndarray
) -> tuple[Acceleration, ...]:
    """Return the outputs that are a constant times the rate of a state, which another state integrates.

    What only flows is no speed: where nothing is its integral, an output may be one of several flows. And
    what no parameter moves may be like a rate by chance: how far a spring is drawn of a body of mass one.

    Parameters
    ----------
    rates, outputs : callable
        ``f(x, u, p)`` and ``h(x, u, p)``, returning arrays.
    sizes : (int, int, int)
        Numbers of states, inputs and outputs.
    p : ndarray of shape (n_parameters,)
        Values that the parameters have about.
    """
    n_states, n_inputs, n_outputs = sizes
    rng = np.random.default_rng(0)
    x, u = rng.normal(size=(POINTS, n_states)), rng.normal(size=(POINTS, n_inputs))
    others = p * rng.uniform(1.0 - MOVED, 1.0 + MOVED, size=(POINTS, p.size))
    f, h, before = (np.full((POINTS, n), np.nan) for n in (n_states, n_outputs, n_outputs))
    for k in range(POINTS):
        try:
            f[k], h[k] = rates(x[k], u[k], others[k].copy()), outputs(x[k], u[k], others[k].copy())
            before[k] = outputs(x[k], u[k], p.copy())
        except Exception:  # where a machine never goes, anything may happen
            continue
    good = np.isfinite(f).all(axis=1) & np.isfinite(h).all(axis=1)
    if good.sum() < ENOUGH:
        return ()
    f, h, x = f[good], h[good], x[good]
    moved = np.flatnonzero(np.any(h != before[good], axis=0)).tolist()
    speeds = [j for j in range(n_states) if any(_factor(f[:, i], x[:, j]) for i in range(n_states) if i != j)]
    found = ((i, j, _factor(h[:, i], f[:, j])) for i in moved for j in speeds)
    return tuple(Acceleration(i, j, factor) for i, j, factor in found if factor)


def _factor(one: np.ndarray, other: np.ndarray) -> float:
    """Return how many times another signal one is at all points; 0 where it is no constant times that."""
    size = other @ other
    factor = (one @ other) / size if size > 0 else 0.0
    return float(factor) if np.allclose(one, factor * other, rtol=SAME, atol=0.0) else 0.0


@lru_cache(maxsize=KEPT)
def with_accelerations(output: Any, found: tuple[Acceleration, ...], n_states: int):
    """Return a compiled output that reads accelerations from the rates, which stand after the states."""
    into, of = (np.array([getattr(one, name) for one in found]) for name in ("output", "state"))
    factors = np.array([one.factor for one in found])

    def write(x, u, p, written, n_x, n_u, n_p, n_written):
        output(x, u, p, written, n_states, n_u, n_p, n_written)
        for k in range(into.size):
            written[into[k]] = factors[k] * x[n_states + of[k]]

    return njit(EQUATION, error_model="numpy", nogil=True)(write)

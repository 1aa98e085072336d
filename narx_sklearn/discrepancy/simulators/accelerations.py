"""Outputs that repeat how fast a speed changes: an accelerometer's, which feels what is not simulated too.

Whoever writes such an output copies the right-hand side of that speed, ``h_i(x, u, p) = a f_j(x, u, p) + b``
with b a constant, or of parameters alone: on an axis that rises it feels its weight as well. A force that is
found in the equation would not show in the copy; as a rate that the output reads it does.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.simulators.addresses import EQUATION

POINTS, ENOUGH = 12, 6  # points at which outputs are held against rates, and finite ones; more than unknowns
MOVED = 0.3  # of a parameter, from point to point
SAME = 1e-9  # relative difference of what is the same
KEPT = 64  # outputs remembered


class Acceleration(NamedTuple):
    """An output that is how fast a speed changes, in its unit, but for what goes with parameters alone."""

    output: int
    state: int  # the speed
    factor: float
    offset: float = 0.0
    weights: tuple[float, ...] = ()  # of parameters, by which it is off further


def find_accelerations(
    rates: Callable, outputs: Callable, sizes: tuple[int, int, int], p: np.ndarray
) -> tuple[Acceleration, ...]:
    """Return the outputs that are a constant times the rate of a state, which another state integrates.

    They may be off by a constant, and by a constant times each parameter. What only flows is no speed: where
    nothing is its integral, an output may be one of several flows. And a rate that parameters do no more than
    shift may be like an output by chance: how far a spring is drawn of a body of mass one.

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
    n_points = POINTS + 2 * p.size
    rng = np.random.default_rng(0)
    x, u = rng.normal(size=(n_points, n_states)), rng.normal(size=(n_points, n_inputs))
    others = p * rng.uniform(1.0 - MOVED, 1.0 + MOVED, size=(n_points, p.size))
    f, before, h = (np.full((n_points, n), np.nan) for n in (n_states, n_states, n_outputs))
    for k in range(n_points):
        try:
            f[k], h[k] = rates(x[k], u[k], others[k].copy()), outputs(x[k], u[k], others[k].copy())
            before[k] = rates(x[k], u[k], p.copy())
        except Exception:  # where a machine never goes, anything may happen
            continue
    good = np.isfinite(f).all(axis=1) & np.isfinite(h).all(axis=1) & np.isfinite(before).all(axis=1)
    if good.sum() < ENOUGH + p.size:
        return ()
    f, before, h, x, shares = f[good], before[good], h[good], x[good], others[good] / p
    speeds = [
        j
        for j in range(n_states)
        if any(_factor(f[:, i], x[:, j]) for i in range(n_states) if i != j)
        and _shares_of(f[:, j] - before[:, j], (shares - 1.0).T) is None
    ]
    found = []
    for i in range(n_outputs):
        for j in speeds:
            parts = _shares_of(h[:, i], np.vstack([f[:, j], np.ones(len(f)), shares.T]))
            if parts is not None and parts[0]:
                factor, offset, *weights = parts
                found.append(Acceleration(i, j, factor, offset, tuple((np.array(weights) / p).tolist())))
    return tuple(found)


def _factor(one: np.ndarray, other: np.ndarray) -> float:
    """Return how many times another signal one is at all points; 0 where it is no constant times that."""
    parts = _shares_of(one, other[None])
    return 0.0 if parts is None else parts[0]


def _shares_of(one: np.ndarray, others: np.ndarray) -> list[float] | None:
    """Return of how much of each other signal one is the sum at all points; None where it is none."""
    sizes = np.linalg.norm(others, axis=1)
    columns = others.T / np.where(sizes > 0.0, sizes, 1.0)
    parts = np.linalg.lstsq(columns, one)[0]
    size = np.linalg.norm(one)
    if np.max(np.abs(columns @ parts - one), initial=0.0) > SAME * size:
        return None
    parts[np.abs(parts) <= SAME * size] = 0.0
    return (parts / np.where(sizes > 0.0, sizes, 1.0)).tolist()


@lru_cache(maxsize=KEPT)
def with_accelerations(output: Any, found: tuple[Acceleration, ...], n_states: int):
    """Return a compiled output that reads accelerations from the rates, which stand after the states."""
    into, of = (np.array([getattr(one, name) for one in found]) for name in ("output", "state"))
    factors, offsets = (np.array([getattr(one, name) for one in found]) for name in ("factor", "offset"))
    weights = np.array([one.weights for one in found])

    def write(x, u, p, written, n_x, n_u, n_p, n_written):
        output(x, u, p, written, n_states, n_u, n_p, n_written)
        for k in range(into.size):
            off = offsets[k]
            for m in range(weights.shape[1]):
                off += weights[k, m] * p[m]
            written[into[k]] = factors[k] * x[n_states + of[k]] + off

    return njit(EQUATION, error_model="numpy", nogil=True)(write)

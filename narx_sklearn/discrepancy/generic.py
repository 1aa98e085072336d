"""A force of unknown shape: what physics outside the catalogue would look like.

A broken line through a few knots competes with the named effects at every port. When it explains clearly
more than any of them, something is missing that has no name here, and its curve is already drawn.
"""

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.hypotheses import Hypothesis, _arguments
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulator import Simulator
from narx_sklearn.discrepancy.structure import Structure
from narx_sklearn.physics.effects import Effect, EffectParameter

KNOTS = 7
CODE = "unnamed_curve"


@njit(nogil=True, cache=True)
def _broken_line(value, theta):
    """Return the broken line through (knot_i, theta_i), constant beyond the ends."""
    low, high = theta[KNOTS], theta[KNOTS + 1]
    place = (value - low) / (high - low) * (KNOTS - 1)
    if not place > 0:
        return theta[0]
    if place >= KNOTS - 1:
        return theta[KNOTS - 1]
    i = int(place)
    return theta[i] + (place - i) * (theta[i + 1] - theta[i])


@njit(nogil=True, cache=True)
def _force(argument, rate, own, second, time, step, z, theta, dz):
    return _broken_line(argument, theta)


def _transform(signal, second, dt, theta, first):
    knots = np.linspace(theta[KNOTS], theta[KNOTS + 1], KNOTS)
    return signal + np.interp(signal, knots, theta[:KNOTS])


def curve_hypotheses(simulator: Simulator, structure: Structure, u: np.ndarray, x: np.ndarray, y: np.ndarray):
    """Return an unnamed curve for each port and argument, its knots spread over what the run visits."""
    found = []
    for i in np.flatnonzero(structure.inputs.any(axis=0)).tolist():
        found.append(_at(Port("input", int(i)), (), simulator.inputs[i], u[:, i]))
    for i, signal in enumerate(simulator.outputs):
        found.append(_at(Port("output", i), (), signal, y[:, i]))
    for i in np.flatnonzero(~structure.kinematic).tolist():
        seen = set()
        for kind in ("own", "position", "any"):
            for weights, name, unit in _arguments(kind, int(i), simulator, structure):
                if weights in seen:
                    continue
                seen.add(weights)
                found.append(_at(Port("state", int(i)), weights, (name, unit), x @ np.array(weights)))
    return [hypothesis for hypothesis in found if hypothesis is not None]


def _at(port: Port, weights, signal, values) -> Hypothesis | None:
    values = values[np.isfinite(values)]
    if values.size == 0 or np.ptp(values) <= 0:
        return None
    low, high = np.quantile(values, [0.005, 0.995])
    if not high > low:
        return None
    parameters = tuple(EffectParameter(f"f{i + 1}", "{port}") for i in range(KNOTS))
    parameters += (EffectParameter("from", "{arg}", low, low), EffectParameter("to", "{arg}", high, high))
    effect = Effect(
        code=CODE,
        title="a curve that the catalogue does not hold",
        sentence="Something acts here that depends on this signal in a way none of the known effects does.",
        equation="f(x), a broken line",
        parameters=parameters,
        starts=_none,
        force=_force,
        transform=_transform,
        amplitude=None,
    )
    starts = np.zeros((KNOTS, KNOTS + 2))
    starts[:, :KNOTS] = np.eye(KNOTS)
    starts[:, KNOTS:] = low, high
    placed = PlacedEffect(
        effect,
        port,
        weights,
        theta=tuple(np.r_[np.zeros(KNOTS), low, high]),
        argument_name=signal[0],
        argument_unit=signal[1],
    )
    return Hypothesis(placed, starts)


def _none(setting):
    return np.empty((0, KNOTS + 2))

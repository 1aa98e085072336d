"""Heat that is radiated: a loss by the fourth power of an absolute temperature."""

import re
from dataclasses import replace

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.places import Argument, placed_at, weights_of
from narx_sklearn.discrepancy.search.unnamed.kinds import RADIATED, unnamed_law
from narx_sklearn.discrepancy.simulators.simulator import Signal, Simulator
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.model.units import ZEROS, scale_to
from narx_sklearn.physics.effects import Effect, EffectParameter

ROOM = 293.15  # K: where a rise is counted from, a room is as good as anything
ABSOLUTE = 150.0  # K; what is never colder is not counted from a room
HOTTEST = 5000.0  # K
TYPICAL = 300.0  # K, at which a coefficient is told
COLDER = 200.0  # K, by which what is radiated to may be colder, or warmer, than what was measured
NAMED = re.compile(r"T(_|\d|$)|temp", re.IGNORECASE)  # of a temperature without a unit


@njit(nogil=True, cache=True)
def _to_surroundings(argument, rate, own, second, time, step, z, theta, dz):
    hot, cold = max(argument + theta[2], 0.0), theta[1]
    return -theta[0] * (hot**4 - cold**4) / (4.0 * TYPICAL**3)


@njit(nogil=True, cache=True)
def _to_what_is_measured(argument, rate, own, second, time, step, z, theta, dz):
    hot, cold = max(argument + theta[2], 0.0), max(second + theta[3] - theta[1], 0.0)
    return -theta[0] * (hot**4 - cold**4) / (4.0 * TYPICAL**3)


def radiation_hypotheses(
    simulator: Simulator, structure: Structure, u: np.ndarray, x: np.ndarray
) -> list[Hypothesis]:
    """Return heat that is radiated for each state that is a temperature, to its surroundings or to an input.

    Parameters
    ----------
    u : ndarray of shape (n_samples, n_inputs)
        Inputs: a temperature among them may be that of what is radiated to, or near to it.
    x : ndarray of shape (n_samples, n_states)
        States of a run.
    """
    n_states, n_inputs = len(simulator.states), len(simulator.inputs)
    around = [
        (j, zero) for j in range(n_inputs) if (zero := zero_of(simulator.inputs[j], u[:, j])) is not None
    ]
    found = []
    for i in np.flatnonzero(~structure.kinematic).tolist():
        signal = simulator.states[i]
        zero = zero_of(signal, x[:, i])
        if zero is None:
            continue
        own = Argument(weights_of(n_states, {i: 1.0}), *signal)
        # a rise is counted from its surroundings
        cold, bounds = (ROOM, (ROOM, ROOM)) if zero == ROOM else (float(x[:, i].min()) + zero, (0.0, HOTTEST))
        law = _law("s", EffectParameter("s", "K", *bounds), zero)
        placed = placed_at(law, Port("state", i), own)
        found.append(Hypothesis.untuned(placed, np.array([[1.0, cold, zero]])))
        for j, its_zero in around:
            law = _law("w", EffectParameter("d", "K", -COLDER, COLDER), zero, its_zero)
            to = replace(
                placed_at(law, Port("state", i), own),
                second=weights_of(n_inputs + n_states, {j: 1.0}),
                second_name=simulator.inputs[j].name,
                second_unit=simulator.inputs[j].unit,
            )
            found.append(Hypothesis.untuned(to, np.array([[1.0, 0.0, zero, its_zero]])))
    return found


def zero_of(signal: Signal, values: np.ndarray) -> float | None:
    """Return what is added to a temperature to make it absolute, K; None for what is none.

    A signal in kelvin that comes near zero is a rise above its surroundings. Without a unit its name and
    range tell.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.search.unnamed.radiation import zero_of
    >>> from narx_sklearn.discrepancy.simulators.simulator import Signal
    >>> zero_of(Signal("plate", "K"), np.array([290.0, 360.0])), zero_of(Signal("plate", "degC"), np.zeros(2))
    (0.0, 273.15)
    >>> zero_of(Signal("rise", "K"), np.array([0.0, 60.0])), zero_of(Signal("level", "m"), np.ones(2))
    (293.15, None)
    >>> zero_of(Signal("T_plate", ""), np.array([290.0, 360.0])), zero_of(Signal("T_plate", ""), np.zeros(2))
    (0.0, None)
    """
    low, high = float(np.min(values)), float(np.max(values))
    is_absolute = low > ABSOLUTE and high < HOTTEST
    if signal.unit:
        zero = ZEROS.get(signal.unit, 0.0) or (0.0 if is_absolute else ROOM)
        return zero if scale_to(signal.unit, "K") == 1.0 and low + zero > 0 else None
    return 0.0 if is_absolute and NAMED.match(signal.name) else None


def _law(cold: str, colder: EffectParameter, *zeros: float) -> Effect:
    """Return the law of what is radiated to surroundings s, or to what is measured, w, and colder by d."""
    names = ("x0", "w0")
    fixed = tuple(EffectParameter(n, "K", zero, zero) for n, zero in zip(names, zeros, strict=False))
    strength = EffectParameter("a", "{port}/K", 0.0)
    to = "s" if cold == "s" else "(w + w0 - d)"
    force = _to_surroundings if cold == "s" else _to_what_is_measured
    equation = f"-a ((x + x0)^4 - {to}^4) / (4 (300 K)^3)"
    return unnamed_law(RADIATED, equation, [], (strength, colder, *fixed), force, amplitude=0)

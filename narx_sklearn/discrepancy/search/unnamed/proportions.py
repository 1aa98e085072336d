"""What acts in proportion to a signal, for a while or by turns: a parameter that changed, or pulsates."""

from collections.abc import Iterator

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.places import Argument, moving
from narx_sklearn.discrepancy.search.unnamed.kinds import BY_TURNS, LINE, PULSE
from narx_sklearn.discrepancy.search.unnamed.linear import linear_hypothesis
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.physics.effects import EffectParameter
from narx_sklearn.physics.effects._series import by_pieces, rates_along, time_since


@njit(nogil=True, cache=True)
def _proportional(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * argument


def _gained(signal, second, dt, theta, first):
    return signal * (1.0 + theta[0])


@njit(nogil=True, cache=True)
def _pulsating(argument, rate, own, second, time, step, z, theta, dz):
    turned = 2.0 * np.pi * theta[2] * time
    return (theta[0] * np.cos(turned) + theta[1] * np.sin(turned)) * argument


def _pulsated(signal, second, dt, theta, first):
    turned = 2.0 * np.pi * theta[2] * time_since(first, signal.size, dt)
    return signal * (1.0 + theta[0] * np.cos(turned) + theta[1] * np.sin(turned))


def _early_and_late(signal, second, dt, theta, first):
    turned = 2.0 * np.pi * theta[2] * time_since(first, signal.size, dt)
    rate = by_pieces(rates_along, signal, first, dt)
    return signal + (theta[0] * np.cos(turned) + theta[1] * np.sin(turned)) * rate


def line_hypotheses(simulator: Simulator, structure: Structure) -> list[Hypothesis]:
    """Return a force in proportion to a signal, for each port and argument.

    One that always acts is a matter of the simulator's own parameters; for a while, it is a change of them.
    """
    return [
        linear_hypothesis(LINE, "k x", ["k"], (), _proportional, port, argument, unit, _gained)
        for port, argument, unit in _proportions(simulator, structure)
    ]


def pulse_hypotheses(simulator: Simulator, structure: Structure, frequencies: tuple[float, float]):
    """Return a force in proportion to a signal that comes and goes, for each port and argument.

    What is read may be early and late by turns.

    Parameters
    ----------
    frequencies : (float, float)
        Between which it does, Hz; it begins in the middle.
    """
    frequency = (EffectParameter("f", "Hz", *frequencies),)
    wave = "(a cos(2 pi f t) + b sin(2 pi f t))"
    found = [
        linear_hypothesis(
            PULSE, f"{wave} x", ["a", "b"], frequency, _pulsating, port, argument, unit, _pulsated
        )
        for port, argument, unit in _proportions(simulator, structure)
    ]
    equation = f"s + {wave} ds/dt"
    for i, signal in enumerate(simulator.outputs):
        place = Port("output", i), Argument((), *signal)
        found.append(
            linear_hypothesis(
                BY_TURNS, equation, ["a", "b"], frequency, _pulsating, *place, "s", _early_and_late
            )
        )
    return found


def _proportions(simulator: Simulator, structure: Structure) -> Iterator[tuple[Port, Argument, str]]:
    """Yield what a force in proportion may be in proportion to, with its port and the factor's unit."""
    for i in np.flatnonzero(structure.inputs.any(axis=0)).tolist():
        yield Port("input", i), Argument((), *simulator.inputs[i]), "-"
    for i in np.flatnonzero(~structure.kinematic).tolist():
        for argument in moving(i, simulator, structure):
            yield Port("state", i), argument, "{port}/({arg})"
    for i, signal in enumerate(simulator.outputs):
        yield Port("output", i), Argument((), *signal), "-"

"""What ripples with an angle or a position: a gain by which a signal comes in, or what a sensor reads.

The flow of a pump by the angle of its rotor, a motor's torque by that of its windings, a screw's pitch by its
place; what an encoder reads, by that of its disc.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.places import Argument, placed_at, weights_of
from narx_sklearn.discrepancy.search.unnamed.kinds import RIPPLED, RIPPLED_READING, unnamed_law
from narx_sklearn.discrepancy.search.unnamed.linear import linear_hypothesis
from narx_sklearn.discrepancy.simulators.simulator import Signal, Simulator
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.model.units import scale_to
from narx_sklearn.physics.effects import EffectParameter

TURN = 2 * np.pi
A_TURN = np.arange(1.0, 17.0)  # waves tried of what turns round: whole, since it repeats
A_RUN = np.arange(2.0, 17.0)  # the same over all that a run visits: what is not seen twice is no ripple
WITHIN = 0.75  # of the way to the next number of waves, to which a reading's may go from one
PHASES = (0.0, TURN / 4)


@njit(nogil=True, cache=True)
def _rippled(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * second * np.sin(theta[1] * argument + theta[2])


@njit(nogil=True, cache=True)
def _two_harmonics(value, theta):
    turned = theta[4] * value
    once = theta[0] * np.cos(turned) + theta[1] * np.sin(turned)
    return once + theta[2] * np.cos(2.0 * turned) + theta[3] * np.sin(2.0 * turned)


@njit(nogil=True, cache=True)
def _misread(argument, rate, own, second, time, step, z, theta, dz):
    return _two_harmonics(argument, theta)


def _read(signal, second, dt, theta, first):
    return signal + _two_harmonics(signal, theta)


def reading_hypotheses(simulator: Simulator, y: np.ndarray) -> list[Hypothesis]:
    """Return a reading that ripples with what is measured, for each output and number of waves.

    Parameters
    ----------
    y : ndarray of shape (n_samples, n_outputs)
        Outputs of a run.
    """
    found = []
    for i, (name, unit) in enumerate(simulator.outputs):
        scale = scale_to(unit, "rad") if unit else None
        waves = _waves(y[:, i] * (scale or 1.0), "rad" if scale is not None else "") * (scale or 1.0)
        for wave in waves:
            near = WITHIN * (waves[1] - waves[0])
            shape = (EffectParameter("N", "1/({arg})", wave - near, wave + near),)
            law = linear_hypothesis(
                RIPPLED_READING,
                "s + a cos(N s) + b sin(N s) + c cos(2 N s) + d sin(2 N s)",
                ["a", "b", "c", "d"],
                shape,
                _misread,
                Port("output", i),
                Argument((), name, unit),
                transform=_read,
            )
            spared = replace(law.placed, effect=replace(law.placed.effect, spare=(2, 3)))
            found.append(law._replace(placed=spared))
    return found


def ripple_hypotheses(simulator: Simulator, structure: Structure, x: np.ndarray) -> list[Hypothesis]:
    """Return a gain that ripples, for each state equation, what enters it, and each angle or position.

    Parameters
    ----------
    x : ndarray of shape (n_samples, n_states)
        States of a run.
    """
    shape = EffectParameter("N", "1/({arg})", 0.0), EffectParameter("p", "rad", -TURN, TURN)
    law = unnamed_law(RIPPLED, "a w sin(N x + p)", ["a"], shape, _rippled, "{port}/({second})", amplitude=0)
    law = replace(law, phase=2)
    n_inputs, n_states = len(simulator.inputs), len(simulator.states)
    found = []
    for i in np.flatnonzero(~structure.kinematic).tolist():
        for place in _places(simulator, structure):
            values = x @ np.array(place.weights)
            waves = _waves(values, place.unit)
            if not waves.size:
                continue
            starts = np.array([[1.0, wave, phase] for wave in waves for phase in PHASES])
            # between half a wave a run, which is any curve, and what samples of it no longer tell
            limits = (-np.inf, np.inf), (waves[0] / 2, 2 * waves[-1]), (-TURN, TURN)
            for j, signal in _entering(i, simulator, structure):
                if j >= n_inputs and place.weights[j - n_inputs]:
                    continue
                placed = placed_at(law, Port("state", i), place)
                placed = replace(
                    placed,
                    second=weights_of(n_inputs + n_states, {j: 1.0}),
                    second_name=signal.name,
                    second_unit=signal.unit,
                    limits=limits,
                )
                found.append(Hypothesis.untuned(placed, starts))
    return found


def _places(simulator: Simulator, structure: Structure) -> Iterator[Argument]:
    """Yield the angles, in radians, and positions: states that nothing draws back to where they were.

    An angle by its unit is one in any case.
    """
    for j, (name, unit) in enumerate(simulator.states):
        scale = scale_to(unit, "rad") if unit else None
        drawn = structure.slope[j, j] != 0.0 and not simulator.discrete
        if scale is None and (drawn or structure.partner[j] >= 0):
            continue
        weights = weights_of(len(simulator.states), {j: 1.0 if scale is None else scale})
        yield Argument(weights, name, unit if scale is None else "rad")


def _waves(values: np.ndarray, unit: str) -> np.ndarray:
    """Return wave numbers to begin with, ascending; none where nothing moves."""
    reach = np.ptp(values)
    if not reach > 0:
        return np.empty(0)
    return A_TURN if unit == "rad" and reach > TURN else TURN / reach * A_RUN


def _entering(i: int, simulator: Simulator, structure: Structure) -> Iterator[tuple[int, Signal]]:
    """Yield what enters a state equation: numbers among the inputs and then the states, and the signals."""
    n_inputs = len(simulator.inputs)
    for j in np.flatnonzero(structure.inputs[i]).tolist():
        yield j, simulator.inputs[j]
    for j in np.flatnonzero(structure.states[i]).tolist():
        yield n_inputs + j, simulator.states[j]

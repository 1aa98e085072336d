"""Sums of a state and its rate that equations have: what a controller puts out, what a coupling passes on.

Neither is a signal of the simulator, and yet something may act on it: a limit of the controller's output, a
clearance in the coupling.
"""

from collections.abc import Iterable
from dataclasses import replace
from itertools import permutations
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.simulators.simulator import Signal, Simulator

ALIKE = 1e-6  # relative difference below which a slope counts as the same
OPPOSED = 1e-4  # of slopes by two positions, that they may differ by where their difference alone counts


class Sum(NamedTuple):
    """A state and its rate as other equations have them: always in the sum ``x + T x'``, times something.

    Of a controller x is the integral of an error, T the integral time, and the sum its output over the gain
    of the integral. Of a spring with a damper x is how far two bodies have parted, or a base is ahead, T the
    ratio of their constants, and the sum what passes between them over the stiffness.
    """

    state: int  # which those equations would have otherwise, were something added to the sum
    time: float  # T [s]
    own: tuple[float, ...]  # (n_inputs + n_states,) weights of inputs and states in x
    rate: tuple[float, ...]  # the same in x'
    through: int = -1  # the input that equations would have otherwise, `state` the first of them; -1 for none

    @property
    def weights(self) -> tuple[float, ...]:
        """Weights of inputs and states in the sum, (n_inputs + n_states,)."""
        return tuple((np.array(self.own) + self.time * np.array(self.rate)).tolist())

    @property
    def place(self) -> tuple:
        """Where it is, and what it is made of, whatever the weights are."""
        return self.state, self.through, tuple(weight != 0.0 for weight in self.weights)

    def called(self, simulator: Simulator) -> str:
        """Return the sum in words: "twist + 0.001 s x its rate"."""
        signals = (*simulator.inputs, *simulator.states)
        name = self._at(simulator).name
        at = len(simulator.inputs) + self.state if self.through < 0 else self.through
        for j in np.flatnonzero(self.own).tolist():
            if self.own[j] < 0:
                name = difference_in_words(name, -self.own[j], signals[j].name)
            elif j != at:
                name = f"{name} + {self.own[j]:.4g} x {signals[j].name}"
        if not self.time:
            return name
        if self.through < 0:
            return f"{name} + {self.time:.4g} s x its rate"
        return name + "".join(
            f" - {-self.time * self.rate[j]:.4g} s x {signals[j].name}" for j in np.flatnonzero(self.rate)
        )

    def _at(self, simulator: Simulator) -> Signal:
        """Return the signal that equations would have otherwise."""
        return simulator.states[self.state] if self.through < 0 else simulator.inputs[self.through]

    def under(self, placed: PlacedEffect, simulator: Simulator) -> PlacedEffect:
        """Return an effect at the state as one on what other equations have of it, which is this sum."""
        name, unit = self.called(simulator), self._at(simulator).unit
        return replace(
            placed,
            through=self.through,
            handed_on=True,
            second=self.weights,
            argument_name=name,
            argument_unit=unit,
            second_name=name,
            second_unit=unit,
        )


def difference_in_words(one: str, ratio: float, other: str) -> str:
    """Return what a signal is ahead of some times another one: "motor - 80 x link"."""
    return f"{one} - {other}" if abs(ratio - 1.0) < OPPOSED else f"{one} - {ratio:.4g} x {other}"


@np.errstate(divide="ignore", invalid="ignore")
def find_controllers(
    of_states: np.ndarray, of_inputs: np.ndarray, states: np.ndarray, inputs: np.ndarray
) -> tuple[Sum, ...]:
    """Find the states that integrate an error, which other equations have in the same sum as that state.

    The integral of what a reference and signals differ by, with constant weights, drives equations that the
    reference enters too. How much more of the error they have than of the integral is the integral time.
    Where other inputs come to all of them in proportion, they may be put out with it, fed forward: then both
    sums are returned, without and with them.

    Parameters
    ----------
    of_states : ndarray of shape (n_points, n_states, n_states)
        Slopes of the rates at some points of a run.
    of_inputs : ndarray of shape (n_points, n_states, n_inputs)
        The same for inputs.
    states, inputs : ndarray of bool, of shape (n_states, n_states) and (n_states, n_inputs)
        Which equation depends on what.
    """
    found = []
    for s in np.flatnonzero(inputs.any(axis=1) & states.any(axis=1) & ~np.diag(states)).tolist():
        error = np.column_stack([of_inputs[:, s], of_states[:, s]])
        if np.any(np.ptp(error, axis=0) > ALIKE * np.abs(error).max()):
            continue
        driven = np.flatnonzero(states[:, s])
        times = [
            of_inputs[:, i, j] / (of_inputs[:, s, j] * of_states[:, i, s])
            for i in driven
            for j in np.flatnonzero(inputs[s])
        ]
        time = _one_ratio(times)
        if time is not None and time > 0.0:
            own = np.eye(error.shape[1])[inputs.shape[1] + s]
            found.append(Sum(s, time, tuple(own.tolist()), tuple(error.mean(axis=0).tolist())))
            for j in np.flatnonzero(~inputs[s]).tolist():
                own[j] = _one_ratio([of_inputs[:, i, j] / of_states[:, i, s] for i in driven]) or 0.0
            if np.count_nonzero(own) > 1:
                found.append(found[-1]._replace(own=tuple(own.tolist())))
    return tuple(found)


@np.errstate(divide="ignore", invalid="ignore")
def find_couplings(
    slopes: np.ndarray,
    depends: np.ndarray,
    kinematic: np.ndarray,
    twists: Iterable[tuple[int, int, int]],
    rates: Iterable[tuple[int, int, float]],
    n_inputs: int,
) -> tuple[Sum, ...]:
    """Find where two bodies feel nothing of each other but how far, and how fast, they have parted.

    Parameters
    ----------
    slopes : ndarray of shape (n_points, n_states, n_states)
        Of the rates, at some points of a run.
    depends : ndarray of bool, of shape (n_states, n_states)
        Which equation depends on which state.
    kinematic : ndarray of bool, of shape (n_states,)
    twists : iterable of (int, int, int)
        States that count how far two others have parted: (state, the one ahead, the other).
    rates : iterable of (int, int, float)
        States that another one integrates: (velocity, position, the factor in which it does).
    """
    found: dict[tuple[int, ...], Sum] = {}
    for parted, at, velocities, is_sure in _partings(slopes, depends, kinematic, twists, list(rates)):
        rate = slopes.mean(axis=0).T @ parted  # of the parting, by states
        times = [
            depends[i, j] * slopes[:, i, j] / (rate[j] * slopes[:, i, at])
            for i, j in (velocities, velocities[::-1])
        ]
        time = _one_ratio(times)
        if time is not None and (time > 0.0 or (is_sure and time == 0.0)):
            own, rate_of_it = ((*[0.0] * n_inputs, *weights.tolist()) for weights in (parted, rate))
            found.setdefault(tuple(sorted(velocities)), Sum(at, time, own, rate_of_it))
    return tuple(found.values())


@np.errstate(divide="ignore", invalid="ignore")
def find_errors(
    of_states: np.ndarray,
    of_inputs: np.ndarray,
    driven: np.ndarray,
    kinematic: np.ndarray,
    rates: Iterable[tuple[int, int, float]],
    controllers: Iterable[Sum],
) -> tuple[Sum, ...]:
    """Find where equations have an input and a state only as what they differ by, times a gain.

    So does a controller without an integral put it out, the difference of a reference and a position; what
    it takes off that by a speed no equation tells from a friction, so both sums are returned, with and
    without. A state that only follows the input is none.

    Parameters
    ----------
    of_states, of_inputs : ndarray
        As of `find_controllers`.
    driven : ndarray of bool, of shape (n_states, n_inputs)
        Which equation depends on which input.
    kinematic : ndarray of bool, of shape (n_states,)
    rates : iterable of (int, int, float)
        States that another one integrates: (velocity, position, the factor in which it does).
    controllers : iterable of Sum
        Those with an integral, which tell what they put out.
    """
    n_inputs, n_states = driven.shape[1], driven.shape[0]
    told = np.zeros(n_inputs, dtype=bool)
    for of in controllers:
        told |= np.array(of.weights[:n_inputs]) != 0.0
    found = []
    for j in np.flatnonzero(~told).tolist():
        at = np.flatnonzero(driven[:, j] & ~kinematic)
        if not at.size:
            continue
        gain = of_inputs[:, at, j]
        for k in np.flatnonzero(~driven[:, j]).tolist():
            if np.all(np.abs(of_states[:, at, k] + gain) <= OPPOSED * np.abs(gain)):
                own, rate = np.zeros((2, n_inputs + n_states))
                own[[j, n_inputs + k]] = 1.0, -1.0
                found.append(Sum(int(at[0]), 0.0, tuple(own.tolist()), tuple(rate.tolist()), through=j))
                for velocity in (v for v, position, _ in rates if position == k):
                    time = _one_ratio([-of_states[:, at, velocity] / gain])
                    if time is not None and time > 0.0:
                        rate[n_inputs + velocity] = -1.0
                        found.append(found[-1]._replace(time=time, rate=tuple(rate.tolist())))
    return tuple(found)


def _partings(slopes, depends, kinematic, twists, rates):
    """Yield how far two bodies have parted, that nothing but the two feels.

    That is as weights of states, (n_states,); then the state that counts it for both, the velocities of the
    two, and whether both equations agree on it. Of two positions one body may feel its own besides: then the
    other's counts.
    """
    n = slopes.shape[1]
    for twist, ahead, other in twists:
        if _felt(depends, kinematic, twist) == sorted((ahead, other)):
            yield np.eye(n)[twist], twist, (ahead, other), True
    for (v, a, _), (w, b, _) in permutations(rates, 2):
        if _felt(depends, kinematic, a) != sorted((v, w)) or not depends[v, b]:
            continue
        by_a, by_b = slopes[:, [v, w], a], slopes[:, [v, w], b]
        ratio = -by_b / by_a
        if ratio[:, 0].min() > 0 and np.ptp(ratio[:, 0]) <= OPPOSED * ratio[:, 0].max():
            alike = np.ptp(ratio) <= OPPOSED * np.abs(ratio).max()
            yield np.eye(n)[a] - ratio[:, 0].mean() * np.eye(n)[b], a, (v, w), bool(alike)


def _felt(depends: np.ndarray, kinematic: np.ndarray, state: int) -> list[int]:
    """Return the equations that depend on a state, but for those that say what it is."""
    return np.flatnonzero(depends[:, state] & ~kinematic).tolist()


def _one_ratio(ratios: list[np.ndarray]) -> float | None:
    """Return a ratio of slopes that is the same in all equations and at all points; None where it is not."""
    values = np.array(ratios)
    if not (values.size and np.all(np.isfinite(values))):
        return None
    return float(values.mean()) if np.ptp(values) <= OPPOSED * np.abs(values).max() else None

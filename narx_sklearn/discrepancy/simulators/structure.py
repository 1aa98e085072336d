"""What the simulator's equations say about themselves: kinematics, who drives whom, which inputs are used."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulators.linearise import central_differences
from narx_sklearn.discrepancy.simulators.simulator import Signal, Simulator, evaluate
from narx_sklearn.discrepancy.simulators.sums import Sum, find_controllers, find_couplings, find_errors
from narx_sklearn.model.units import may_be_alike

POINTS = 6  # states of the run at which derivatives are compared
STEP = 1e-4  # of a signal's motion: far above rounding, and kinematics are straight lines
ALIKE = 1e-6  # relative difference below which a derivative counts as the same
MOVED = 0.3  # of a parameter, that may move where a state rests
UNEVEN = 0.01  # relative difference above which an input's gain is another one elsewhere
MOSTLY = 0.5  # of the samples


class Probed(NamedTuple):
    """A point at which derivatives were taken, and the differences that they were taken over."""

    x: np.ndarray  # (n_states,)
    u: np.ndarray  # (n_inputs,)
    x_steps: np.ndarray  # (n_states,)
    u_steps: np.ndarray  # (n_inputs,)


class Structure(NamedTuple):
    """Dependencies found numerically along a run."""

    partner: tuple[int, ...]  # state -> the state that is its integral, up to a factor; -1 for none
    kinematic: np.ndarray  # (n_states,) bool: a definition (x' = v), where no physics can be missing
    states: np.ndarray  # (n_states, n_states) bool: equation i depends on state j
    slope: np.ndarray  # (n_states, n_states) mean of that dependence
    inputs: np.ndarray  # (n_states, n_inputs) bool: equation i depends on input j
    parameters: np.ndarray  # (n_states, n_parameters) bool: equation i depends on parameter j
    gain: np.ndarray  # (n_states, n_inputs) mean of that dependence
    varies: np.ndarray  # (n_states, n_inputs) bool: that depends on the states, as where an inertia does
    read: np.ndarray  # (n_outputs, n_inputs + n_states) bool: signals of which an output is made
    follows: np.ndarray  # (n_states,) bool: comes to rest where inputs say, whatever the parameters are
    paced: np.ndarray  # (n_states,) bool: goes where others say, as fast as a parameter of its own says
    uneven: np.ndarray  # (n_inputs,) bool: acts more or less by its own size, by states or by other inputs
    stepped: np.ndarray  # (n_inputs,) bool: stays from most samples to the next, as nothing in a loop does
    controllers: tuple[Sum, ...] = ()  # what those among the equations put out
    couplings: tuple[Sum, ...] = ()  # what passes between two bodies that feel nothing else of each other
    errors: tuple[Sum, ...] = ()  # what controllers without an integral put out
    probed: Probed | None = None  # one of the points at which all of this was found

    @property
    def shown(self) -> np.ndarray:
        """States that an output is made of, (n_states,) bool."""
        return np.any(self.read[:, self.inputs.shape[1] :], axis=0)

    def in_motion_with(self, states: np.ndarray) -> np.ndarray:
        """Tell which states are of one motion with some of those given, (n_states,) bool, and those.

        A motion is a position with its rate, and the rate of that.
        """
        found = states.copy()
        for _ in self.partner:
            for rate, position in enumerate(self.partner):
                if position >= 0 and found[rate] != found[position]:
                    found[rate] = found[position] = True
        return found

    @property
    def twists(self) -> list[tuple[int, int, int]]:
        """Kinematic states that count how far two others have parted: (state, the one ahead, the other)."""
        found = []
        for i in np.flatnonzero(self.kinematic).tolist():
            sources = np.flatnonzero(self.states[i]).tolist()
            if len(sources) == 2:
                ahead, other = sorted(sources, key=lambda j: -self.slope[i, j])
                found.append((i, ahead, other))
        return found

    @property
    def rates(self) -> tuple[tuple[int, int, float], ...]:
        """States that another one integrates, as (velocity, position, the factor in which it does)."""
        return tuple(
            (velocity, position, float(self.slope[position, velocity]))
            for velocity, position in enumerate(self.partner)
            if position >= 0 and self.kinematic[position] and not self.inputs[position].any()
        )

    @property
    def sums(self) -> tuple[Sum, ...]:
        """What comes to other equations in a sum of a state and its rate."""
        return self.controllers + self.couplings + self.errors

    @property
    def handed_on(self) -> list[int]:
        """States that only follow an input, as an actuator does its command, and drive other equations.

        They follow it as far as it goes, or by a gain and as fast as a parameter says, as an amplifier does.
        """
        others = self.states & ~np.eye(len(self.partner), dtype=bool)
        drives = np.any(others & ~self.kinematic[:, None], axis=0)
        alone = self.inputs.any(axis=1) & ~others.any(axis=1)
        return np.flatnonzero((self.follows | (self.paced & alone)) & drives).tolist()

    def geared(self, one: int, other: int) -> float:
        """Return how many times as fast one of two coupled states goes as the other; 1 if unknown."""
        for of in self.couplings:
            for weights in (of.own, of.rate):
                one_by, other_by = (weights[self.inputs.shape[1] + state] for state in (one, other))
                if one_by * other_by < 0:
                    return -other_by / one_by
        return 1.0

    @property
    def channels(self) -> np.ndarray:
        """Inputs that no equation uses: measured channels that may still matter."""
        return np.flatnonzero(~self.inputs.any(axis=0))

    def share_equation(self, one: Port, other: Port) -> bool:
        """Tell whether what enters at two ports comes together in one equation."""
        return bool(self._equations(one) & self._equations(other))

    def _equations(self, port: Port) -> set[Port]:
        if port.kind in ("state", "output"):
            return {port}
        enters = self.parameters if port.is_parameter else self.inputs
        return {Port("state", int(i)) for i in np.flatnonzero(enters[:, port.index])}


@np.errstate(over="ignore", invalid="ignore")  # along a run that is about to be lost
def find_structure(simulator: Simulator, x: np.ndarray, u: np.ndarray) -> Structure:
    """Probe the right-hand side along a run, x (n_samples, n_states) and u (n_samples, n_inputs)."""
    n = len(simulator.states)
    good = np.flatnonzero(np.all(np.isfinite(x), axis=1) & np.all(np.isfinite(u), axis=1))
    points = good[np.linspace(0, good.size - 1, POINTS).astype(int)] if good.size else np.zeros(0, int)
    x_size = np.maximum(np.nanstd(x, axis=0), 1e-6 * np.maximum(np.nanmax(np.abs(x), axis=0), 1e-6))
    u_size = np.maximum(np.nanstd(u, axis=0), 1e-6 * np.maximum(np.nanmax(np.abs(u), axis=0), 1e-6))
    p = simulator.nominal
    p_size = np.where(p != 0, np.abs(p), 1.0)
    f, Jx, Ju, Jp, elsewhere, Jy = [], [], [], [], [], []
    for k, other in zip(points, np.roll(points, 1), strict=True):
        at_x, at_u = simulator.switches.clear_of(x[k], STEP * x_size), u[k]

        def rates(x=at_x, u=at_u, p=None):
            return evaluate(simulator, x, u, p)[0]

        def outputs(signals, at_u=at_u):
            return evaluate(simulator, signals[at_u.size :], signals[: at_u.size])[1]

        size = np.concatenate([u_size, x_size])
        f.append(rates())
        Jy.append(central_differences(outputs, np.concatenate([at_u, at_x]), STEP * size) * size)
        Jx.append(central_differences(lambda v, rates=rates: rates(x=v), at_x, STEP * x_size))
        Ju.append(central_differences(lambda v, rates=rates: rates(u=v), at_u, STEP * u_size))
        Jp.append(central_differences(lambda v, rates=rates: rates(p=v), p, STEP * p_size))
        elsewhere.append(central_differences(lambda v, rates=rates: rates(u=v), u[other], STEP * u_size))
    f, Jx, Ju, Jp, elsewhere, Jy = (np.nan_to_num(np.array(J)) for J in (f, Jx, Ju, Jp, elsewhere, Jy))
    weight = np.abs(Jx) * x_size
    largest = np.concatenate([weight, np.abs(Ju) * u_size], axis=2).max(axis=(0, 2), initial=0.0)
    depends = weight.max(axis=0, initial=0.0) > ALIKE * np.maximum(largest, 1e-300)[:, None]
    driven = (np.abs(Ju) * u_size).max(axis=0, initial=0.0) > ALIKE * np.maximum(largest, 1e-300)[:, None]
    of_parameters = np.zeros((n, p.size), dtype=bool)
    if len(Jp):
        of_parameters[:] = np.abs(Jp).max(axis=0) > 0
    tuned = np.abs(Jp).max(axis=(0, 2), initial=0.0) > 0
    spread = np.ptp(Jx, axis=0) <= ALIKE * np.abs(Jx).max(axis=0, initial=0.0)
    slopes = Jx.mean(axis=0) if len(Jx) else np.zeros((n, n))
    kinematic = np.zeros(n, dtype=bool)
    partner = [-1] * n
    for i in range(n):
        sources = np.flatnonzero(depends[i])
        if i in sources or not spread[i, sources].all():
            continue
        if driven[i].any() and not _is_relative(i, sources, Jx[:, i], Ju[:, i], simulator):
            continue
        if sources.size == 1:
            kinematic[i] = not tuned[i]
            if not simulator.discrete and partner[sources[0]] < 0:
                partner[int(sources[0])] = i
        elif sources.size == 2 and not simulator.discrete:
            kinematic[i] = not tuned[i] and _is_twist(i, sources, slopes, simulator.states)
    if simulator.discrete:  # what a map only remembers is no place for physics
        kinematic |= ~simulator.free_states
    gain = Ju.mean(axis=0) if len(Ju) else np.zeros((n, u.shape[1]))
    varies, uneven = np.zeros(gain.shape, dtype=bool), np.zeros(u.shape[1], dtype=bool)
    if len(Ju):
        most = np.abs(Ju).max(axis=0)
        of_states, moved = (
            np.abs(elsewhere - Ju).max(axis=0) <= UNEVEN * most,
            np.ptp(Ju, axis=0) > UNEVEN * most,
        )
        varies, uneven = of_states & moved, (driven & moved).any(axis=0)
    read = np.zeros((len(simulator.outputs), u.shape[1] + n), dtype=bool)
    if len(Jy):
        felt = np.abs(Jy).max(axis=0)
        read = felt > ALIKE * felt.max(axis=1, keepdims=True)
    none = np.zeros(n, dtype=bool)
    stepped = np.count_nonzero(u[1:] == u[:-1], axis=0) > MOSTLY * len(u[1:])
    told = depends, slopes, driven, of_parameters, gain, varies, read, none, none, uneven, stepped
    found = Structure(tuple(partner), kinematic, *told)
    if simulator.discrete or not points.size:
        return found
    alone = np.diag(depends) & (depends.sum(axis=1) == 1) & driven.any(axis=1) & ~kinematic
    follows = none.copy()
    follows[alone] = _rests_where_told(simulator, x[points], u[points], np.flatnonzero(alone))
    probed = Probed(at_x, at_u, STEP * x_size, STEP * u_size)
    paced = _are_paced(f, Jx, Jp, p) & ~kinematic
    return _with_sums(found._replace(follows=follows, paced=paced, probed=probed), Jx, Ju)


def _with_sums(found: Structure, of_states: np.ndarray, of_inputs: np.ndarray) -> Structure:
    """Return a structure with the sums that its equations have, from slopes of the rates at some points."""
    n_inputs = of_inputs.shape[2]
    controllers = find_controllers(of_states, of_inputs, found.states, found.inputs)
    return found._replace(
        controllers=controllers,
        errors=find_errors(of_states, of_inputs, found.inputs, found.kinematic, found.rates, controllers),
        couplings=find_couplings(
            of_states, found.states, found.kinematic, found.twists, found.rates, n_inputs
        ),
    )


@dataclass(frozen=True)
class Sums:
    """Sums of a state and its rate that equations have, whatever their parameters are.

    Parameters
    ----------
    simulator : Simulator
    structure : Structure
        Found along a run of it.
    """

    simulator: Simulator
    structure: Structure

    def at(self, p: np.ndarray) -> dict[tuple, Sum]:
        """Return the sums by their places."""
        found, probed = self.structure, self.structure.probed
        if probed is None or not found.sums:
            return {}

        def rates(x=probed.x, u=probed.u):
            return evaluate(self.simulator, x, u, p)[0]

        of_states = central_differences(lambda x: rates(x=x), probed.x, probed.x_steps)
        of_inputs = central_differences(lambda u: rates(u=u), probed.u, probed.u_steps)
        there = _with_sums(found, np.nan_to_num(of_states)[None], np.nan_to_num(of_inputs)[None])
        return {of.place: of for of in there.sums}

    def under(self, effects: Sequence[PlacedEffect], p: np.ndarray) -> tuple[PlacedEffect, ...]:
        """Return effects, those on such a sum with the one that equations with these parameters have."""
        if not any(effect.is_on_sum for effect in effects):
            return tuple(effects)
        there = self.at(p)
        found = ((effect, there.get(effect.of_sum) if effect.is_on_sum else None) for effect in effects)
        return tuple(effect if of is None else of.under(effect, self.simulator) for effect, of in found)


def _rests_where_told(simulator: Simulator, x: np.ndarray, u: np.ndarray, states: np.ndarray) -> np.ndarray:
    """Tell of which states, each alone in its equation, no parameter moves the rest.

    A lag of unit gain is such: its parameter says how soon the state is there, not where. What a store holds
    at rest depends on what flows in and on how it leaks.
    """
    p = simulator.nominal
    told = np.ones(states.size, dtype=bool)
    for at_x, at_u in zip(x, u, strict=True):
        aside = np.array(at_x)
        aside[states] += np.where(at_x[states] == 0, 1.0, at_x[states])

        def rests(p, at_x=at_x, at_u=at_u, aside=aside):
            rates, there = (evaluate(simulator, v, at_u, p)[0][states] for v in (at_x, aside))
            return at_x[states] - rates * (aside - at_x)[states] / (there - rates)

        with np.errstate(all="ignore"):
            here = rests(p)
            for other in p + np.diag(np.where(p == 0, 1.0, MOVED * p)):
                told &= np.abs(rests(other) - here) <= STEP * (np.abs(here) + np.abs(at_x[states]))
    return told


def _are_paced(f: np.ndarray, of_states: np.ndarray, of_parameters: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Tell which states go where others say, ``(g - x)/T`` or ``w (g - x)``, whatever g is.

    Rates ``f`` (n_points, n_states) and their slopes by states and by parameters. What is in proportion to an
    inertia or a capacity, and held back by something else, is no such state.
    """
    own = np.diagonal(of_states, axis1=1, axis2=2)[:, :, None]
    by_pace = p * of_parameters  # (n_points, n_states, n_parameters)
    size = np.abs(f).max(axis=0)[:, None]
    found = np.zeros((f.shape[1], p.size), dtype=bool)
    for pace, way in ((-1.0 / np.where(p == 0, np.inf, p), -1.0), (-p, 1.0)):
        is_own = np.abs(own - pace).max(axis=0) <= STEP * np.abs(pace)
        is_all = np.abs(by_pace - way * f[:, :, None]).max(axis=0) <= STEP * size
        found |= is_own & is_all & (size > 0) & (p != 0)
    return np.any(found, axis=1)


def _is_relative(i: int, sources: np.ndarray, of_states, of_inputs, simulator: Simulator) -> bool:
    """Tell whether a state counts how far a body has moved from a base, whose speed is an input.

    Slopes ``of_states`` (n_points, n_states) and ``of_inputs`` (n_points, n_inputs) are those of its rate.
    """
    inputs = np.flatnonzero(np.abs(of_inputs).max(axis=0, initial=0.0) > 0)
    if sources.size != 1 or inputs.size != 1 or not simulator.states[i].unit:
        return False
    j, base = int(sources[0]), int(inputs[0])
    speed = f"{simulator.states[i].unit}/s"
    are_speeds = all(
        s.unit and may_be_alike(speed, s.unit) for s in (simulator.states[j], simulator.inputs[base])
    )
    together = of_states[:, j] + of_inputs[:, base]
    return are_speeds and bool(np.all(np.abs(together) <= STEP * np.abs(of_states[:, j])))


def _is_twist(i: int, sources: np.ndarray, slopes: np.ndarray, states: Sequence[Signal]) -> bool:
    """Tell whether a state counts how far two bodies have parted, whose speeds it holds back and drives.

    What flows into a store and out of it does not: of a level something may be lost.
    """
    unit = states[i].unit
    are_speeds = all(not unit or may_be_alike(f"{unit}/s", states[j].unit) for j in sources)
    apart, held = slopes[i, sources], slopes[sources, i]
    return bool(are_speeds and np.prod(apart) < 0 and np.all(apart * held < 0))

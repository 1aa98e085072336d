"""Where an effect may act on a simulator: at which port, and on which signals it depends there."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulators.simulator import Signal, Simulator
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.simulators.sums import Sum, difference_in_words
from narx_sklearn.model.units import is_per_time, may_be_alike, rate_of, scale_to, tidy_unit
from narx_sklearn.physics.effects import PARAMETER, Effect

OF_CIRCUITS = {"A", "kA", "mA", "uA", "C", "V", "kV", "mV", "T", "mT", "Wb"}
OF_MOTION = ("motion", "surfaces")
NO_LEVELS = ("K", "A", "rad")  # what they measure is not how full something is


class Argument(NamedTuple):
    """What a force in a state equation may depend on."""

    weights: tuple[float, ...]  # of the states; empty for the signal at an input or output
    name: str
    unit: str
    pushed_back: int = -1  # the equation of a neighbour that the force acts against, if it lies between two
    ratio: float = 0.0  # in which the simulator's own coupling pushes that one back
    is_twist: bool = False  # a state of its own says how far the two have parted


def placements(effect: Effect, simulator: Simulator, structure: Structure) -> list[PlacedEffect]:
    """Return the places at which an effect could act on a simulator."""
    places = []
    if "input" in effect.ports:
        for i in np.flatnonzero(structure.inputs.any(axis=0)).tolist():
            if structure.uneven[i] or not effect.is_offset:
                places.append(placed_at(effect, Port("input", i), Argument((), *simulator.inputs[i])))
    if "output" in effect.ports:
        for i, signal in enumerate(simulator.outputs):
            places.append(placed_at(effect, Port("output", i), Argument((), *signal)))
    if "state" in effect.ports:
        for i in np.flatnonzero(~structure.kinematic).tolist():
            if effect.met_on == "levels" and _holds_no_level(i, simulator, structure):
                continue
            for found in arguments(effect.argument, i, simulator, structure):
                argument = _in_unit_of(effect, found)
                if argument is None:
                    continue
                odd = _is_odd(effect, i, simulator, structure, argument.is_twist)
                placed = replace(placed_at(effect, Port("state", i), argument), odd=odd)
                places += [placed, *beside_inputs(placed, simulator, structure)]
            if simulator.discrete and effect.argument == "own" and effect.met_on in OF_MOTION:
                places += _on_the_move(effect, i, simulator, structure)
    if effect.following is not None:
        for i in np.flatnonzero(structure.follows | structure.paced).tolist():
            places.append(at_state(effect, i, simulator))
    all_of_it = [
        replace(
            placed,
            second=weights,
            second_name=name,
            second_unit=unit,
            onward=onward,
            odd=placed.odd or _is_of_its_rate(placed, weights, structure),
        )
        for placed in places
        for weights, name, unit in _seconds(placed, simulator, structure)
        for onward in _onward(placed, simulator, structure)
    ]
    return all_of_it + _behind(effect, simulator, structure) + _in_readings(effect, simulator, structure)


def parameter_placements(
    effect: Effect, simulator: Simulator, structure: Structure
) -> Iterator[PlacedEffect]:
    """Yield an effect at every parameter of a simulator that reads its parameters, with every signal.

    These are the inputs and states, and how far neighbours are apart and how fast they part. An output may
    need the parameter to be known: it is no signal on which that could depend.
    """
    if PARAMETER not in effect.ports or not simulator.reads_parameters:
        return
    own = (*simulator.inputs, *simulator.states)
    signals = [(weights_of(len(own), {i: 1.0}), *own[i]) for i in range(len(own))]
    signals += [
        ((0.0,) * len(simulator.inputs) + stretch.weights, stretch.name, stretch.unit)
        for stretch in _apart(simulator, structure)
    ]
    for j in np.flatnonzero(simulator.nominal != 0).tolist():
        for weights, name, unit in signals:
            yield PlacedEffect(
                effect,
                Port(PARAMETER, j),
                second=weights,
                argument_name=name,
                argument_unit=unit,
                second_name=name,
                second_unit=unit,
            )


def _apart(simulator: Simulator, structure: Structure) -> list[Argument]:
    """Return how far neighbours are apart and how fast they part, each once, from one of the two."""
    found: list[Argument] = []
    for i in np.flatnonzero(~structure.kinematic).tolist():
        for argument in moving(i, simulator, structure):
            way = np.array(argument.weights)
            known = any(np.linalg.matrix_rank(np.array([way, other.weights])) < 2 for other in found)
            if np.count_nonzero(way) > 1 and not known:
                found.append(argument)
    return found


def _in_readings(effect: Effect, simulator: Simulator, structure: Structure) -> list[PlacedEffect]:
    """Return the places of an effect in outputs on one of the signals of which these are made.

    What is read may as well be ahead of what it should be as behind.
    """
    if not effect.read_as:
        return []
    own = effect.parameters
    either_way = (p._replace(lower=-np.inf) if k == effect.amplitude else p for k, p in enumerate(own))
    read = replace(effect, equation=effect.read_as, parameters=tuple(either_way))
    outputs = range(len(simulator.outputs))
    return [read_from(read, i, j, simulator) for i in outputs for j, _ in parts_read(i, simulator, structure)]


def parts_read(i: int, simulator: Simulator, structure: Structure) -> Iterator[tuple[int, Signal]]:
    """Yield the signals of which an output is made, and which of all they are, where these are several."""
    read = np.flatnonzero(structure.read[i])
    signals = (*simulator.inputs, *simulator.states)
    for j in read.tolist() if read.size > 1 else ():
        yield j, signals[j]


def read_from(effect: Effect, i: int, j: int, simulator: Simulator) -> PlacedEffect:
    """Return an effect in an output on one of the signals of which that is made."""
    signals = (*simulator.inputs, *simulator.states)
    name, unit = signals[j]
    placed = placed_at(replace(effect, second="feed"), Port("output", i), Argument((), name, unit))
    return replace(placed, second=weights_of(len(signals), {j: 1.0}), second_name=name, second_unit=unit)


def placed_at(effect: Effect, port: Port, argument: Argument) -> PlacedEffect:
    """Return an effect at a port, pushing back where it lies between two neighbours."""
    weights, name, unit, back, ratio, _ = argument
    at = PlacedEffect(effect, port, weights, argument_name=name, argument_unit=unit)
    return at if back < 0 else replace(at, onward=back, share=ratio)


def _behind(effect: Effect, simulator: Simulator, structure: Structure) -> list[PlacedEffect]:
    """Return the places of an effect on what passes from some equations to others.

    What acts on an input is met behind an actuator or a controller too, whose integral, if it has one, may
    follow what is left; all else in a coupling. Outputs that are made of the same may have it too, as a
    flow has what a stem does.
    """

    def on(sums: Iterable[Sum]) -> list[PlacedEffect]:
        return [of.under(at_state(effect, of.state, simulator), simulator) for of in sums]

    if effect.put_out is not None:
        return on(structure.controllers + structure.errors)
    if effect.handed_on is None:
        return []
    if "input" not in effect.ports:
        places = on(structure.couplings)
        places = [p if structure.shown[p.port.index] else _counted_from_zero(p) for p in places]
    else:
        places = [replace(at_state(effect, i, simulator), handed_on=True) for i in structure.handed_on]
        for of, placed in zip(structure.controllers, on(structure.controllers), strict=True):
            places += [placed, replace(placed, onward=of.state, share=1.0 / of.time)]
        places += on(structure.errors)
    return [seen for placed in places for seen in seen_or_not(placed, structure)]


def seen_or_not(placed: PlacedEffect, structure: Structure) -> list[PlacedEffect]:
    """Return an effect on what is handed on, and the same as outputs that are made of that have it too.

    An output that is made of a state, but not of all that comes in a sum with it, shows the state.
    """
    read = structure.read
    made_of_it = read[read[:, structure.inputs.shape[1] + placed.port.index]]
    sums = np.array(placed.second if placed.second else np.zeros(read.shape[1])) != 0
    may_be_seen = made_of_it.size > 0 and made_of_it[:, sums].all() and placed.through < 0
    return [placed, replace(placed, is_seen=True)] if may_be_seen else [placed]


def at_state(effect: Effect, i: int, simulator: Simulator) -> PlacedEffect:
    """Return an effect at a state equation that depends on that state alone."""
    return placed_at(effect, Port("state", i), alone(i, simulator))


def _counted_from_zero(placed: PlacedEffect) -> PlacedEffect:
    """Return an effect on a parting that nothing shows, counted from zero: from where, no record tells."""
    limits = [
        (0.0, 0.0) if p.unit == "{arg}" and p.lower < 0 else (p.lower, p.upper)
        for p in placed.effect.parameters
    ]
    return replace(placed, limits=tuple(limits))


def alone(i: int, simulator: Simulator) -> Argument:
    """Return a state as what a force depends on."""
    return Argument(weights_of(len(simulator.states), {i: 1.0}), *simulator.states[i])


def beside_inputs(placed: PlacedEffect, simulator: Simulator, structure: Structure) -> Iterator[PlacedEffect]:
    """Yield the places of a force on a motion beside each input that the equations turn into a motion alike.

    Where bodies move together, a force on one of them turns up in the equations of all, as an input does;
    and where an inertia changes, so does what a force adds to the rate, as what an input adds.
    """
    i = placed.port.index
    if simulator.discrete or placed.effect.after or placed.effect.onward:
        return
    if not _is_speed(i, simulator, structure):
        return
    if placed.effect.argument == "any" or np.count_nonzero(placed.weights) > 1 or placed.onward >= 0:
        return  # what acts between two bodies has its place
    for j in np.flatnonzero(structure.gain[i] > 0).tolist():
        if structure.varies[i, j] or np.count_nonzero(structure.inputs[:, j] & ~structure.kinematic) > 1:
            yield replace(placed, through=j)


def _on_the_move(effect: Effect, i: int, simulator: Simulator, structure: Structure):
    """Yield the place of a force on what moves in a map: it depends on the rate, from the last two values."""
    for before in np.flatnonzero(structure.kinematic & structure.states[:, i]).tolist():
        if structure.states[before].sum() == 1 and simulator.free_states[before]:
            name, unit = simulator.states[i]
            weights = weights_of(len(simulator.states), {i: 1 / simulator.dt, before: -1 / simulator.dt})
            rate = Argument(weights, rate_of(name), tidy_unit(f"{unit}/s") if unit else "")
            yield replace(placed_at(effect, Port("state", i), rate), inertial=True)


def _in_unit_of(effect: Effect, argument: Argument) -> Argument | None:
    """Return an argument in a unit that the effect asks for: degrees in radians. None for none."""
    if not (argument.unit and effect.argument_units) or argument.unit in effect.argument_units:
        return argument
    for unit in effect.argument_units:
        scale = scale_to(argument.unit, unit)
        if scale is not None:
            return argument._replace(weights=tuple(scale * weight for weight in argument.weights), unit=unit)
    return None


def _is_speed(i: int, simulator: Simulator, structure: Structure) -> bool:
    """Tell whether a state is one that another one integrates, or is counted per second."""
    return structure.partner[i] >= 0 or is_per_time(simulator.states[i].unit)


def _holds_no_level(i: int, simulator: Simulator, structure: Structure) -> bool:
    """Tell whether a state cannot be how full something is."""
    unit = simulator.states[i].unit
    return _is_speed(i, simulator, structure) or any(scale_to(unit, other) is not None for other in NO_LEVELS)


def _is_odd(effect: Effect, i: int, simulator: Simulator, structure: Structure, is_twist: bool) -> bool:
    """Tell whether an effect is of another kind of machine than a state equation.

    Motion is a state that another one integrates, or one counted per time; without units all is possible,
    but beside states or outputs that have one a state without is a number, as a state of charge is. A spring
    needs a position, which a speed alone does not have unless its argument is a twist.
    """
    unit, has_position = simulator.states[i].unit, is_twist or structure.partner[i] >= 0
    without_units = not any(signal.unit for signal in (*simulator.states, *simulator.outputs))
    moves = _is_speed(i, simulator, structure) or without_units
    lacks_position = effect.argument == "position" and is_per_time(unit) and not has_position
    slides = effect.met_on == "surfaces" and unit in OF_CIRCUITS
    return (
        effect.met_at is not None or slides or (effect.met_on in OF_MOTION and (lacks_position or not moves))
    )


def _seconds(placed: PlacedEffect, simulator: Simulator, structure: Structure):
    """Yield (weights, name, unit) of the second arguments that an effect may have at its place."""
    kind, i = placed.effect.second, placed.port.index
    n_inputs = len(simulator.inputs)
    if kind in (None, "drive", "feed"):
        yield (), "", ""
    signals = (*simulator.inputs, *simulator.states)
    for j in _second_signals(placed, structure):
        if placed.port != Port("input", j):
            yield weights_of(len(signals), {j: 1.0}), *signals[j]
    if kind == "alike" and placed.port.kind == "output":
        yield from _alike(placed, simulator, structure)
    if kind == "drive":
        for weights, name, unit in _neighbours(i, simulator, structure):
            yield (*[0.0] * n_inputs, *weights), name, unit


def _second_signals(placed: PlacedEffect, structure: Structure) -> list[int]:
    """Return the inputs, and behind them the states, that alone may be an effect's second argument."""
    match placed.effect.second:
        case "channel":
            return _others(placed, structure) + _unfelt(placed, structure)
        case "input":
            return np.flatnonzero(structure.inputs.any(axis=0)).tolist()
        case "drive" | "feed" if placed.port.kind == "state":
            return _feeds(placed, structure)
        case "other" if placed.port.kind == "output":
            recorded = np.concatenate([np.ones(structure.inputs.shape[1], dtype=bool), structure.shown])
            return np.flatnonzero(_unread(placed, structure) & recorded).tolist()
    return []


def _alike(placed: PlacedEffect, simulator: Simulator, structure: Structure):
    """Yield (weights, name, unit) of the signals that an output may as well show: in a unit like its own."""
    unit = simulator.outputs[placed.port.index].unit
    signals = (*simulator.inputs, *simulator.states)
    for j in np.flatnonzero(_unread(placed, structure)).tolist():
        scale = scale_to(signals[j].unit, unit) if signals[j].unit and unit else None
        if scale is not None:
            yield weights_of(len(signals), {j: scale}), signals[j].name, unit


def _unread(placed: PlacedEffect, structure: Structure) -> np.ndarray:
    """Tell which signals, (n_inputs + n_states,), the output at a port is not made of, nor of their motion.

    An input that drives and may be a controller's has an output's noise in it: what the output has of it no
    record tells. What a controller adds up no sensor feels.
    """
    n_inputs = structure.inputs.shape[1]
    inputs = structure.stepped.copy()
    inputs[structure.channels] = True
    inputs &= ~structure.read[placed.port.index, :n_inputs]
    other = ~structure.in_motion_with(structure.read[placed.port.index, n_inputs:])
    other[[of.state for of in structure.controllers]] = False
    return np.concatenate([inputs, other])


def _is_of_its_rate(placed: PlacedEffect, second: tuple[float, ...], structure: Structure) -> bool:
    """Tell whether another signal, that a sensor may feel, drives what it shows: so does one that is late."""
    if placed.effect.second != "other":
        return False
    n_inputs = structure.inputs.shape[1]
    felt = np.concatenate([structure.inputs, structure.states], axis=1)
    read = np.flatnonzero(structure.read[placed.port.index, n_inputs:])
    return bool(felt[read][:, np.flatnonzero(second)].any())


def _unfelt(placed: PlacedEffect, structure: Structure) -> list[int]:
    """Return the states that may drive an equation though it does not say so, counted behind the inputs.

    They are those of other motions than the equation feels, of which an output shows something.
    """
    if placed.port.kind != "state" or placed.effect.argument != "none":
        return []
    felt = structure.states[placed.port.index].copy()
    felt[placed.port.index] = True
    told = structure.in_motion_with(structure.shown) & ~structure.in_motion_with(felt)
    return (np.flatnonzero(told) + structure.inputs.shape[1]).tolist()


def _feeds(placed: PlacedEffect, structure: Structure) -> list[int]:
    """Return the inputs of a state equation that may stand in the place of an effect's argument.

    Where that may be any state, once; and of what enters this equation alone the input itself tells the gain.
    """
    i = placed.port.index
    driving = np.flatnonzero(structure.inputs[i]).tolist()
    if placed.effect.argument != "any":
        return driving
    if not placed.weights[i]:
        return []
    entered = structure.inputs.sum(axis=0) + structure.read[:, : structure.inputs.shape[1]].sum(axis=0)
    return [j for j in driving if entered[j] > 1]


def _others(placed: PlacedEffect, structure: Structure) -> list[int]:
    """Return the inputs that may act where the simulator has none of them: other signals than its own drive.

    They are the measured channels that it does not use. Where it has several drives each may pull at the
    others' axes too, and their gains may follow each other, as where they share a supply.
    """
    channels = structure.channels
    if structure.inputs.shape[1] - channels.size < 2:
        return channels.tolist()
    if placed.port.kind == "input":
        return list(range(structure.inputs.shape[1]))
    if placed.port.kind == "state" and placed.effect.argument == "none":
        return np.flatnonzero(~structure.inputs[placed.port.index]).tolist()
    return channels.tolist()


def _neighbours(i: int, simulator: Simulator, structure: Structure):
    """Yield (weights, name, unit) of the states that push equation ``i`` from outside.

    That is the stretch towards a neighbour, and every state that is no matter of motion relative to one.
    """
    own = {i, structure.partner[i]}
    opposed = {state: _opposed(i, state, simulator, structure) for state in own if state >= 0}
    if structure.partner[i] >= 0:
        for j in opposed[structure.partner[i]]:
            yield _stretch(structure.partner[i], j, simulator, structure)
    taken = own.union(*opposed.values())
    for j in np.flatnonzero(structure.states[i]).tolist():
        if j not in taken:
            yield weights_of(len(simulator.states), {j: 1.0}), *simulator.states[j]


def _onward(placed: PlacedEffect, simulator: Simulator, structure: Structure) -> list[int]:
    """Return the equations to which a share of what an effect takes away may go on; -1 for none.

    It is a share of what is counted in one unit: a level does not spill into a speed.
    """
    if not placed.effect.onward or placed.port.kind != "state":
        return [placed.onward]
    i = placed.port.index
    unit = simulator.states[i].unit
    fed = [j for j in range(structure.kinematic.size) if j != i and structure.states[j, i]]
    return [
        -1,
        *(j for j in fed if not structure.kinematic[j] and may_be_alike(unit, simulator.states[j].unit)),
    ]


def arguments(kind: str, i: int, simulator: Simulator, structure: Structure) -> Iterator[Argument]:
    """Yield what a force in state equation ``i`` may depend on.

    What acts between two neighbours is told at the one that it moves more.
    """
    n = len(simulator.states)
    partner = structure.partner[i]
    if kind == "none":
        yield Argument(weights_of(n, {i: 1.0}), *simulator.states[i])
        return
    if kind == "any":
        for j in range(n):
            if not (structure.kinematic[j] and simulator.discrete):
                yield Argument(weights_of(n, {j: 1.0}), *simulator.states[j])
        return
    own = i if kind == "own" or partner < 0 else partner
    yield Argument(weights_of(n, {own: 1.0}), *simulator.states[own])
    for j in _opposed(i, own, simulator, structure):
        back, ratio = _pushed_back(i, own, j, structure)
        stretch = _stretch(own, j, simulator, structure)
        if back < 0:
            yield Argument(*stretch)
        elif (ratio, i) < (1.0, back) or own not in _opposed(back, j, simulator, structure):
            yield Argument(*stretch, back, ratio)
    if kind == "position":
        yield from _twisted(i, simulator, structure)


def moving(i: int, simulator: Simulator, structure: Structure) -> Iterator[Argument]:
    """Yield all that a force in state equation ``i`` may depend on, each once."""
    seen = set()
    for kind in ("own", "position", "any"):
        for argument in arguments(kind, i, simulator, structure):
            if argument.weights not in seen:
                seen.add(argument.weights)
                yield argument


def _twisted(i: int, simulator: Simulator, structure: Structure) -> Iterator[Argument]:
    """Yield the states that say how far a body is ahead of a neighbour, which their force pushes back."""
    for twist, ahead, other in structure.twists:
        if i == ahead and structure.states[i, twist]:
            about = weights_of(len(simulator.states), {twist: 1.0}), *simulator.states[twist]
            ratio = -structure.slope[other, twist] / structure.slope[i, twist]
            pushed_back = (other, float(ratio)) if ratio > 0 else (-1, 0.0)
            yield Argument(*about, *pushed_back, is_twist=True)


def _pushed_back(i: int, own: int, j: int, structure: Structure) -> tuple[int, float]:
    """Return the equation in which neighbour ``j`` feels state ``own`` of equation ``i``, and how much more.

    What couples two bodies acts on both, in the ratio of their inertias; so does what flows between stores.
    Through a gear it is as many times more as the one turns faster. -1 where the neighbour does not feel it.
    """
    back = j if own == i else next((k for k, of in enumerate(structure.partner) if of == j), -1)
    if back < 0 or not structure.states[back, own]:
        return -1, 0.0
    ratio = structure.geared(own, j) * structure.slope[back, own] / structure.slope[i, j]
    return (back, float(ratio)) if ratio > 0 else (-1, 0.0)


def _opposed(i: int, own: int, simulator: Simulator, structure: Structure) -> list[int]:
    """Return the states that equation ``i`` feels in the opposite sense of one of its own: neighbours.

    They are of one unit. Where nobody told units, they are those that are pushed back: a pressure that moves
    a body, and feels nothing of it, is no speed.
    """
    if simulator.discrete or not structure.states[i, own]:
        return []

    def is_alike(j: int) -> bool:
        unit = simulator.states[own].unit
        alike = simulator.states[j].unit == unit
        return alike and (bool(unit) or _pushed_back(i, own, j, structure)[0] >= 0)

    return [
        j
        for j in np.flatnonzero(structure.states[i]).tolist()
        if j != own
        and structure.kinematic[j] == structure.kinematic[own]
        and structure.slope[i, j] * structure.slope[i, own] < 0
        and is_alike(j)
    ]


def _stretch(
    own: int, j: int, simulator: Simulator, structure: Structure
) -> tuple[tuple[float, ...], str, str]:
    """Return (weights, name, unit) of how far a state is ahead of a neighbour's, behind a gear or not."""
    ratio, signal = structure.geared(own, j), simulator.states[own]
    name = difference_in_words(signal.name, ratio, simulator.states[j].name)
    return weights_of(len(simulator.states), {own: 1.0, j: -ratio}), name, signal.unit


def weights_of(n: int, entries: dict) -> tuple[float, ...]:
    """Return a weighted sum of n signals as its weights, zero but for the entries."""
    weights = [0.0] * n
    for index, value in entries.items():
        weights[index] = value
    return tuple(weights)


def odd_if_coupled(placed: PlacedEffect, structure: Structure) -> PlacedEffect:
    """Return a law as odd where it brings a state into an equation that has nothing of it yet.

    Equations that are known say what goes into which; where a law fits in two of them about as well, it is
    that which has its signals already. What an equation moves is at home in it.
    """
    if placed.port.kind != "state":
        return placed
    i = placed.port.index
    has = structure.states[i].copy()
    has[[i, structure.partner[i]] if structure.partner[i] >= 0 else [i]] = True
    needs = np.array(placed.weights) != 0
    if placed.second:
        needs = needs | (np.array(placed.second)[-has.size :] != 0)
    return replace(placed, odd=bool(np.any(needs & ~has)))

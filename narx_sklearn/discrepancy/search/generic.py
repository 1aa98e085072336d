"""A force of unknown shape: what physics outside the catalogue would look like.

A broken line through a few knots competes with the named effects at every port; in state equations a power
does, and a product of two states; wherever something moves, a polynomial in position and rate does, and one
in which an input's gain depends on them. When one explains clearly more than any of the names, something is
missing that has none, and its curve is already drawn.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from itertools import combinations, permutations

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.broken_line import (
    KNOTS,
    ends_of,
    force_of_line,
    knots_as_parameters,
    line_added,
)
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis, counted_from_means
from narx_sklearn.discrepancy.search.places import (
    Argument,
    arguments,
    beside_inputs,
    moving,
    placed_at,
    weights_of,
)
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.physics.effects import CATALOGUE, Effect, EffectParameter, Power, no_start
from narx_sklearn.physics.effects._series import by_pieces, time_since

CURVE, SURFACE, DRIVEN = "unnamed_curve", "unnamed_surface", "unnamed_driven_surface"
LINE, PULSE, BY_TURNS = "unnamed_line", "unnamed_pulse", "unnamed_pulsating_delay"
PRODUCT, WITH_SQUARE = "unnamed_product", "unnamed_product_with_square"
ODD_POWER, EVEN_POWER, INVERSE = "unnamed_odd_power", "unnamed_even_power", "unnamed_inverse_power"
DAMPED = "damped_beyond"  # no finding, but another form of a law that acts beyond a gap
STORED, STORED_BY_SQUARE = "unnamed_storage", "unnamed_storage_by_square"
VARYING = "unnamed_dependence"  # of a parameter
ONE_PLACE = "unnamed_force_near_one_place"
WORKED, WORKED_BY_SQUARE = "unnamed_gain_after_work", "unnamed_gain_after_square"  # a gain that remembers
TWO_SPEEDS, LOOP = "unnamed_lag_of_two_speeds", "unnamed_loop_of_a_reading"
BY_RATE, BUILDS_UP = "unnamed_reading_by_rate", "unnamed_reading_that_builds_up"
UNNAMED = (
    CURVE,
    SURFACE,
    DRIVEN,
    LINE,
    PULSE,
    BY_TURNS,
    PRODUCT,
    WITH_SQUARE,
    ODD_POWER,
    EVEN_POWER,
    INVERSE,
    STORED,
    STORED_BY_SQUARE,
    VARYING,
    WORKED,
    WORKED_BY_SQUARE,
    TWO_SPEEDS,
    LOOP,
    BY_RATE,
    BUILDS_UP,
    ONE_PLACE,
)
TITLES = {
    CURVE: "a curve that the catalogue does not hold",
    DAMPED: "a damping that the catalogue does not hold",
    SURFACE: "a force of position and rate that the catalogue does not hold",
    DRIVEN: "a law of position, rate and input that the catalogue does not hold",
    LINE: "a parameter that changed",
    PULSE: "a parameter that pulsates",
    BY_TURNS: "a reading that is early and late by turns",
    PRODUCT: "a product of two signals that the catalogue does not hold",
    WITH_SQUARE: "a product with a square that the catalogue does not hold",
    ODD_POWER: "a power that the catalogue does not hold",
    EVEN_POWER: "a power that the catalogue does not hold",
    STORED: "an inertia, or whatever takes up what drives this equation, that changes",
    STORED_BY_SQUARE: "an inertia, or whatever takes up what drives this equation, that changes",
    INVERSE: "an inverse power that the catalogue does not hold",
    VARYING: "a change that is not simulated",
    WORKED: "a gain that depends on what went before",
    WORKED_BY_SQUARE: "a gain that depends on what went before",
    TWO_SPEEDS: "a lag that is slower one way",
    LOOP: "a reading that depends on where it last turned",
    BY_RATE: "a reading that is off by how fast it moves",
    BUILDS_UP: "a reading in which errors build up",
    ONE_PLACE: "a force near one place",
}
SENTENCES = {
    DAMPED: "What is hit gives way.",
    CURVE: "Something acts here that depends on this signal in a way none of the known effects does.",
    SURFACE: "Something acts here that depends on position and rate as none of the known effects does.",
    DRIVEN: "What is moved here takes up its forces in another way at another position or rate, as where its "
    "inertia changes.",
    LINE: "Something grows in proportion to this signal, as if a parameter were another meanwhile.",
    PULSE: "Something grows in proportion to this signal and comes and goes at one frequency, as if a "
    "parameter pulsated. When it does is known for this recording only.",
    BY_TURNS: "What is read is of a little earlier and later by turns, at one frequency, as where two clocks "
    "do not run alike. When it is which is known for this recording only.",
    PRODUCT: "What acts here grows in proportion to two signals at once, as where the one carries the other.",
    WITH_SQUARE: "What acts here grows with one signal and with the square of another, as what a turn throws "
    "outwards.",
    ODD_POWER: "What acts here grows as a power of this signal, another one than the known effects'.",
    EVEN_POWER: "What acts here grows as a power of this signal, another one than the known effects'.",
    STORED: "What drives this equation, all of it, moves more or less by this signal, as where an inertia, a "
    "cross-section, a capacity or an inductance is not constant.",
    STORED_BY_SQUARE: "What drives this equation, all of it, moves more or less as this signal goes from one "
    "point, either way: as where an inertia, a capacity or an inductance is not constant.",
    VARYING: "What the simulation has as a constant changes with a signal, wherever it stands in the "
    "equations.",
    ONE_PLACE: "Something acts near one value of this signal and hardly elsewhere, as a detent, a magnet or "
    "a rough spot does.",
    WORKED: "What goes through here is weaker, or stronger, the harder it worked shortly before, as where a "
    "supply sags.",
    WORKED_BY_SQUARE: "What goes through here is weaker, or stronger, the more power it took shortly before, "
    "as where something warms up.",
    TWO_SPEEDS: "The signal arrives smoothed, one way more than the other, as where something fills faster "
    "than it empties.",
    LOOP: "What is read depends on where it last turned, however slowly it goes, as of a core that stays "
    "magnetised.",
    BY_RATE: "What is read is off as long as it moves, by how fast it does.",
    BUILDS_UP: "What is read misses, or gains, something at some speeds and keeps that, as what counts turns "
    "or adds up a flow does.",
    INVERSE: "What acts here falls off as a power of this signal, as what acts over a distance does. Nearer "
    "to zero than this recording came it is taken to stay as it is there.",
}
ENDS = ("x from", "{arg}"), ("x to", "{arg}"), ("v from", "{arg}/s"), ("v to", "{arg}/s")  # of what was seen
ANYWHERE = (-1e30, 1e30, -1e30, 1e30)  # while it is fitted
POWERS = (1.5, 12.0)  # exponents: with less it is hardly more than a line
INVERSES = (0.5, 6.0)  # the same of what falls off
HALF = 0.5  # by which an exponent may be off and the law still be of a power's name
CUBE, SQUARE = Power(3.0, odd=True), Power(2.0, odd=False)  # with which a free power begins
POINTS = EffectParameter("r", "{arg}"), EffectParameter("c", "{second}")  # from which a product is counted
MONOMIALS = {"x2": "x^2", "xv": "x v", "v2": "v^2", "x3": "x^3", "x2v": "x^2 v", "xv2": "x v^2", "v3": "v^3"}
OF_INPUT = {"ux": "u x", "ux2": "u x^2", "uv": "u v", "uv2": "u v^2"}
TERMS = {SURFACE: MONOMIALS, DRIVEN: MONOMIALS | OF_INPUT}  # of a polynomial, by the names of coefficients


@njit(nogil=True, cache=True)
def _surface(argument, rate, own, second, time, step, z, theta, dz):
    """Return the polynomial of second and third degree in position and rate, in units of their sizes."""
    x, v = min(max(argument, theta[9]), theta[10]), min(max(rate, theta[11]), theta[12])
    return _polynomial(x / theta[7], v / theta[8], theta)


@njit(nogil=True, cache=True)
def _driven_surface(argument, rate, own, second, time, step, z, theta, dz):
    """Return the same, and an input's gain of second degree in position and rate."""
    x = min(max(argument, theta[14]), theta[15]) / theta[11]
    v, u = min(max(rate, theta[16]), theta[17]) / theta[12], second / theta[13]
    gain = theta[7] * x + theta[8] * x * x + theta[9] * v + theta[10] * v * v
    return _polynomial(x, v, theta) + gain * u


@njit(nogil=True, cache=True)
def _polynomial(x, v, theta):
    squares = theta[0] * x * x + theta[1] * x * v + theta[2] * v * v
    return squares + theta[3] * x**3 + theta[4] * x * x * v + theta[5] * x * v * v + theta[6] * v**3


@njit(nogil=True, cache=True)
def _damped_beyond(argument, rate, own, second, time, step, z, theta, dz):
    """Return what damps a motion beyond a gap."""
    return 0.0 if theta[1] < argument < theta[2] else -theta[0] * rate


@njit(nogil=True, cache=True)
def _proportional(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * argument


def _gained(signal, second, dt, theta, first):
    return signal * (1.0 + theta[0])


@njit(nogil=True, cache=True)
def _product_with_square(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * (argument - theta[1]) * (second - theta[2]) ** 2


@njit(nogil=True, cache=True)
def _pulsating(argument, rate, own, second, time, step, z, theta, dz):
    turned = 2.0 * np.pi * theta[2] * time
    return (theta[0] * np.cos(turned) + theta[1] * np.sin(turned)) * argument


def _pulsated(signal, second, dt, theta, first):
    turned = 2.0 * np.pi * theta[2] * time_since(first, signal.size, dt)
    return signal * (1.0 + theta[0] * np.cos(turned) + theta[1] * np.sin(turned))


def _early_and_late(signal, second, dt, theta, first):
    turned = 2.0 * np.pi * theta[2] * time_since(first, signal.size, dt)
    rate = by_pieces(rate_of, signal, first, dt)
    return signal + (theta[0] * np.cos(turned) + theta[1] * np.sin(turned)) * rate


def rate_of(values: np.ndarray, dt: float) -> np.ndarray:
    """Return how fast each column of a piece of signals moves at its samples."""
    return np.gradient(values, dt, axis=0) if len(values) > 1 else np.zeros_like(values)


@njit(nogil=True, cache=True)
def _odd_power(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * np.sign(argument) * np.abs(argument / theta[2]) ** theta[1]


@njit(nogil=True, cache=True)
def _even_power(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * np.abs(argument / theta[2]) ** theta[1]


@njit(nogil=True, cache=True)
def _inverse_power(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * (theta[2] / max(np.abs(argument), theta[2])) ** theta[1]


def placed_powers(simulator: Simulator, structure: Structure, x: np.ndarray) -> list[PlacedEffect]:
    """Return a force that goes as a power, for each state equation and argument that moves, either way.

    Where the argument stays on one side of zero the force may fall off as a power too.
    """
    found = []
    for i in np.flatnonzero(~structure.kinematic).tolist():
        for argument in moving(i, simulator, structure):
            values = x @ np.array(argument.weights)
            far, (low, high) = np.abs(values).max(), ends_of(values)
            if not far > 0:
                continue
            laws = [(power_effect(power, far), power.exponent, far) for power in (CUBE, SQUARE)]
            if low * high > 0:
                near = min(abs(low), abs(high))
                laws.append((inverse_power(near), SQUARE.exponent, near))
            for effect, exponent, size in laws:
                placed = placed_at(effect, Port("state", i), argument)
                placed = placed.at((0.0, exponent, size, *[placed.share] * placed.reacts))
                found += [placed, *beside_inputs(placed, simulator, structure)]
    return found


def inverse_power(nearest: float) -> Effect:
    """Return a force that falls off as a power, as strong as it says at the nearest to zero that was seen."""
    return Effect(
        code=INVERSE,
        title=TITLES[INVERSE],
        sentence=SENTENCES[INVERSE],
        equation="a (nearest / |x|)^n",
        parameters=(
            EffectParameter("a", "{port}"),
            EffectParameter("n", "-", *INVERSES),
            EffectParameter("nearest", "{arg}", nearest, nearest),
        ),
        starts=no_start,
        force=_inverse_power,
    )


def power_effect(power: Power, size: float) -> Effect:
    """Return a force that goes as a power, as strong as it says where its argument has a size."""
    code = ODD_POWER if power.odd else EVEN_POWER
    return Effect(
        code=code,
        title=TITLES[code],
        sentence=SENTENCES[code],
        equation="a sgn(x) |x / size|^n" if power.odd else "a |x / size|^n",
        parameters=(
            EffectParameter("a", "{port}"),
            EffectParameter("n", "-", *POWERS),
            EffectParameter("size", "{arg}", size, size),
        ),
        starts=no_start,
        force=_odd_power if power.odd else _even_power,
    )


def with_free_power(placed: PlacedEffect, power: Power, size: float) -> PlacedEffect:
    """Return the law of an effect that goes as a power, with that power free, for an argument of a size."""
    effect, theta = placed.effect, np.array(placed.theta)
    strength = effect.force(size, 0.0, 0.0, 0.0, 0.0, 1.0, np.zeros(1), theta, np.zeros(1))
    freed = replace(placed, effect=power_effect(power, size), limits=())
    return freed.at((strength, power.exponent, size, *placed.onward_theta))


def damped_beyond(placed: PlacedEffect) -> Hypothesis | None:
    """Return what damps a motion where an effect acts on it, if that is beyond a gap: a stop gives way.

    A spring alone gives all back (Hunt and Crossley 1975, Coefficient of Restitution Interpreted as Damping
    in Vibroimpact).
    """
    if placed.effect.acts_in is None or placed.port.kind != "state":
        return None
    spans = placed.effect.acts_in(placed.own_theta)
    if len(spans) != 2 or np.isfinite([spans[0][0], spans[1][1]]).any():
        return None
    gap = spans[0][1], spans[1][0]
    fixed = [EffectParameter(name, "{arg}", at, at) for name, at in zip(("from", "to"), gap, strict=True)]
    law = unnamed_law(DAMPED, "-d dx/dt beyond the gap", ["d"], fixed, _damped_beyond, "({port}) s/({arg})")
    begun = replace(placed, effect=law, limits=()).at((0.0, *gap, *placed.onward_theta))
    start = np.array(begun.theta)
    start[0] = 1.0
    return Hypothesis.untuned(begun, start[None])


def line_hypotheses(simulator: Simulator, structure: Structure) -> list[Hypothesis]:
    """Return a force in proportion to a signal, for each port and argument.

    One that always acts is a matter of the simulator's own parameters; for a while, it is a change of them.
    """
    return [
        _unnamed(LINE, "k x", ["k"], (), _proportional, port, argument, unit)
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
        _unnamed(PULSE, f"{wave} x", ["a", "b"], frequency, _pulsating, port, argument, unit)
        for port, argument, unit in _proportions(simulator, structure)
    ]
    equation = f"s + {wave} ds/dt"
    for i, signal in enumerate(simulator.outputs):
        place = Port("output", i), Argument((), *signal)
        found.append(_unnamed(BY_TURNS, equation, ["a", "b"], frequency, _pulsating, *place, "s"))
    return found


def product_hypotheses(simulator: Simulator, structure: Structure, x: np.ndarray) -> list[Hypothesis]:
    """Return a force in proportion to two states, or one of them squared, for each state equation and pair.

    What moves along with a flow is of the first kind, what is thrown outwards of the second. Working points
    begin at the means of a run's states ``x`` (n, n_states); what stands still there is in no pair, and what
    a position and its own rate do is a matter of the polynomials.
    """
    product = _of_two(
        PRODUCT, "k (x - r) (w - c)", CATALOGUE["bilinear_input"].force, "{port}/(({arg}) ({second}))"
    )
    with_square = _of_two(
        WITH_SQUARE, "k (x - r) (w - c)^2", _product_with_square, "{port}/(({arg}) ({second})^2)"
    )
    n_inputs, n_states = len(simulator.inputs), len(simulator.states)
    found = []
    for i in np.flatnonzero(~structure.kinematic).tolist():
        of_one_motion = {weights_of(n_states, {j: 1.0}) for j in (i, structure.partner[i]) if j >= 0}
        signals = [
            a for a in arguments("any", i, simulator, structure) if np.ptp(x @ np.array(a.weights)) > 0
        ]
        pairs = [(product, pair) for pair in combinations(signals, 2)]
        pairs += [(with_square, pair) for pair in permutations(signals, 2)]
        for law, (one, other) in pairs:
            if {one.weights, other.weights} == of_one_motion:
                continue
            found.append(counted_from_means(law, i, (one, other), x, n_inputs, amplitude=1.0))
    return found


def _of_two(code: str, equation: str, force, unit: str) -> Effect:
    """Return a law of two signals, each counted from a working point."""
    return replace(unnamed_law(code, equation, ["k"], POINTS, force, unit), amplitude=0, references=(1, 2))


def _proportions(simulator: Simulator, structure: Structure) -> Iterator[tuple[Port, Argument, str]]:
    """Yield what a force in proportion may be in proportion to, with its port and the factor's unit."""
    for i in np.flatnonzero(structure.inputs.any(axis=0)).tolist():
        yield Port("input", i), Argument((), *simulator.inputs[i]), "-"
    for i in np.flatnonzero(~structure.kinematic).tolist():
        for argument in moving(i, simulator, structure):
            yield Port("state", i), argument, "{port}/({arg})"


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


def curve_hypotheses(simulator: Simulator, structure: Structure, u: np.ndarray, x: np.ndarray, y: np.ndarray):
    """Return an unnamed curve for each place and argument, its knots spread over what the run visits."""
    found = []
    for i in np.flatnonzero(structure.inputs.any(axis=0)).tolist():
        found.append(_at(Port("input", int(i)), Argument((), *simulator.inputs[i]), u[:, i]))
    for i, signal in enumerate(simulator.outputs):
        found.append(_at(Port("output", i), Argument((), *signal), y[:, i]))
        found += _read(Port("output", i), simulator, structure, np.column_stack([u, x]))
    for i in np.flatnonzero(~structure.kinematic).tolist():
        port = Port("state", i)
        for argument in moving(i, simulator, structure):
            found.append(_at(port, argument, x @ np.array(argument.weights)))
        if structure.partner[i] >= 0:
            for argument in arguments("position", i, simulator, structure):
                position = x @ np.array(argument.weights)
                found.append(_of_motion(port, argument, position, simulator.dt))
                for j in np.flatnonzero(structure.inputs[i]).tolist():
                    found.append(_driven(port, argument, position, simulator, j, u[:, j]))
    known = [hypothesis for hypothesis in found if hypothesis is not None]
    return known + [
        hypothesis._replace(placed=beside)
        for hypothesis in known
        if hypothesis.placed.port.kind == "state"
        for beside in beside_inputs(hypothesis.placed, simulator, structure)
    ]


def _at(port: Port, argument: Argument, values: np.ndarray) -> Hypothesis | None:
    values = values[np.isfinite(values)]
    if values.size == 0 or np.ptp(values) <= 0:
        return None
    low, high = ends_of(values)
    if not high > low:
        return None
    fixed = knots_as_parameters(np.linspace(low, high, KNOTS))
    names = [f"f{i + 1}" for i in range(KNOTS)]
    return _unnamed(CURVE, "f(x), a broken line", names, fixed, force_of_line, port, argument)


def _read(
    port: Port, simulator: Simulator, structure: Structure, signals: np.ndarray
) -> Iterator[Hypothesis | None]:
    """Yield a curve of each signal of which an output is made, where these are several.

    What one of them adds need not be in proportion to it, as what a current takes off a voltage.
    """
    read = np.flatnonzero(structure.read[port.index]).tolist()
    if len(read) < 2:
        return
    for j in read:
        signal = [*simulator.inputs, *simulator.states][j]
        found = _at(port, Argument((), *signal), signals[:, j])
        if found is not None:
            fed = replace(found.placed.effect, second="feed", equation="f(w), a broken line")
            weights = weights_of(signals.shape[1], {j: 1.0})
            yield found._replace(
                placed=replace(
                    found.placed, effect=fed, second=weights, second_name=signal.name, second_unit=signal.unit
                )
            )


def _of_motion(port: Port, argument: Argument, position: np.ndarray, dt: float) -> Hypothesis | None:
    sizes = _sizes_of_motion(position, dt)
    if not min(sizes) > 0:
        return None
    equation = "f(x, v), of second and third degree"
    return _unnamed(SURFACE, equation, MONOMIALS, _fixed(sizes), _surface, port, argument)


def _driven(
    port: Port, argument: Argument, position: np.ndarray, simulator: Simulator, j: int, drive: np.ndarray
) -> Hypothesis | None:
    finite = np.abs(drive[np.isfinite(drive)])
    sizes = *_sizes_of_motion(position, simulator.dt), float(finite.max(initial=0.0))
    if not min(sizes) > 0:
        return None
    equation = "f(x, v) + u g(x, v), of second and third degree"
    found = _unnamed(
        DRIVEN, equation, (*MONOMIALS, *OF_INPUT), _fixed(sizes), _driven_surface, port, argument
    )
    name, unit = simulator.inputs[j]
    weights = weights_of(len(simulator.inputs) + len(simulator.states), {j: 1.0})
    driven = replace(found.placed, second=weights, second_name=name, second_unit=unit)
    return found._replace(placed=driven)


def without_terms(placed: PlacedEffect, dropped: Collection[int]) -> PlacedEffect:
    """Return a polynomial with some of its terms dropped for good; its equation tells those left.

    Where none is left with the input, it is one of position and rate.
    """
    terms = TERMS[placed.effect.code]
    kept = {name: power for j, (name, power) in enumerate(terms.items()) if j not in dropped}
    if placed.effect.code == DRIVEN and not kept.keys() & OF_INPUT.keys():
        placed = _without_input(placed)
    signals = "x, v and u" if placed.effect.code == DRIVEN else "x and v"
    equation = " + ".join(f"{name} {power}" for name, power in kept.items())
    effect = replace(placed.effect, equation=f"{equation}, {signals} over their sizes")
    gone = [j for j in dropped if j < len(TERMS[placed.effect.code])]
    return replace(placed, effect=effect).with_zeros(gone)


def _without_input(placed: PlacedEffect) -> PlacedEffect:
    """Return a polynomial in position, rate and input without the input."""
    n, n_of_input = len(MONOMIALS), len(OF_INPUT)
    sizes = placed.theta[n + n_of_input :][:2]
    effect = unnamed_law(SURFACE, "", MONOMIALS, _fixed(sizes), _surface)
    rest = placed.onward_theta
    alone = replace(placed, effect=effect, second=(), second_name="", second_unit="", limits=())
    return alone.at((*placed.theta[:n], *sizes, *ANYWHERE, *rest))


def _sizes_of_motion(position: np.ndarray, dt: float) -> tuple[float, float]:
    speed = np.abs(np.diff(position[np.isfinite(position)])) / dt
    return float(np.ptp(position)) / 2, float(np.quantile(speed, 0.98)) if speed.size else 0.0


def _fixed(sizes: tuple[float, ...]) -> tuple[EffectParameter, ...]:
    kinds = ("size of x", "{arg}"), ("size of v", "{arg}/s"), ("size of u", "{second}")
    told = [*zip(kinds, sizes, strict=False), *zip(ENDS, ANYWHERE, strict=True)]
    return tuple(EffectParameter(name, unit, value, value) for (name, unit), value in told)


def held_beyond(placed: PlacedEffect, ends: Sequence[float]) -> PlacedEffect:
    """Return a polynomial that stays as it is at the ends of the positions and rates it was seen over.

    Its powers may throw a louder motion anywhere.

    Parameters
    ----------
    ends : list of float
        Least and largest position, and rate.
    """
    n, after = len(placed.effect.parameters) - len(ENDS), len(placed.effect.parameters)
    fixed = (EffectParameter(name, unit, end, end) for (name, unit), end in zip(ENDS, ends, strict=True))
    effect = replace(placed.effect, parameters=(*placed.effect.parameters[:n], *fixed))
    limits = placed.limits and (*placed.limits[:n], *((end, end) for end in ends), *placed.limits[after:])
    theta = (*placed.theta[:n], *ends, *placed.theta[after:])
    return replace(placed, effect=effect, limits=limits).at(theta)


def _unnamed(
    code: str, equation: str, names, fixed, force, port: Port, argument: Argument, unit: str = "{port}"
) -> Hypothesis:
    """Return the hypothesis of a force that is linear in its named coefficients; others keep their bounds."""
    n = len(names)
    placed = placed_at(unnamed_law(code, equation, names, fixed, force, unit), port, argument)
    scale = [(parameter.lower + parameter.upper) / 2 for parameter in fixed] + [placed.share] * placed.reacts
    starts = np.column_stack([np.eye(n), np.tile(scale, (n, 1))])
    begun = placed.at(np.r_[np.zeros(n), scale])
    return Hypothesis.untuned(begun, starts)


def is_unnamed(placed: PlacedEffect) -> bool:
    """Tell whether a finding of it has no name."""
    return placed.effect.code in UNNAMED


def unnamed_law(code: str, equation: str, names, fixed, force, unit: str = "{port}") -> Effect:
    """Return a law without a name, of named coefficients; others keep their bounds."""
    transforms = {CURVE: line_added, LINE: _gained, PULSE: _pulsated, BY_TURNS: _early_and_late}
    return Effect(
        code=code,
        title=TITLES[code],
        sentence=SENTENCES[code],
        equation=equation,
        parameters=(*(EffectParameter(name, unit) for name in names), *fixed),
        starts=no_start,  # they are told where it is placed, not taken from a setting
        force=force,
        transform=transforms.get(code),
        amplitude=None,
    )

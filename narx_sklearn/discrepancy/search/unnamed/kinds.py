"""Which laws without a name there are, and what is said of each."""

from typing import NamedTuple

from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.physics.effects import Effect, EffectParameter, no_start

CURVE, SURFACE, DRIVEN = "unnamed_curve", "unnamed_surface", "unnamed_driven_surface"
LINE, PULSE, BY_TURNS = "unnamed_line", "unnamed_pulse", "unnamed_pulsating_delay"
PRODUCT, WITH_SQUARE = "unnamed_product", "unnamed_product_with_square"
ODD_POWER, EVEN_POWER, INVERSE = "unnamed_odd_power", "unnamed_even_power", "unnamed_inverse_power"
DAMPED = "damped_beyond"  # no finding, but another form of a law that acts beyond a gap
STORED, STORED_BY_SQUARE = "unnamed_storage", "unnamed_storage_by_square"
VARYING, CHANGED = "unnamed_dependence", "unnamed_change"  # of a parameter
ONE_PLACE, STEP = "unnamed_force_near_one_place", "unnamed_force_that_steps"
RADIATED = "unnamed_radiation"
RIPPLED, RIPPLED_READING = "unnamed_gain_that_ripples", "unnamed_reading_that_ripples"
WORKED, WORKED_BY_SQUARE = "unnamed_gain_after_work", "unnamed_gain_after_square"  # a gain that remembers
AFTER_WORK, AFTER_SQUARE = "unnamed_coefficient_after_work", "unnamed_coefficient_after_square"
TWO_SPEEDS, LOOP = "unnamed_lag_of_two_speeds", "unnamed_loop_of_a_reading"
SWITCHED, SWITCHED_GAIN = "unnamed_switch", "unnamed_gain_that_switches"
BY_RATE, BUILDS_UP = "unnamed_reading_by_rate", "unnamed_reading_that_builds_up"


class Words(NamedTuple):
    """What is said of a law."""

    title: str
    sentence: str


WORDS = {
    CURVE: Words(
        "a curve that the catalogue does not hold",
        "Something acts here that depends on this signal in a way none of the known effects does.",
    ),
    SURFACE: Words(
        "a force of position and rate that the catalogue does not hold",
        "Something acts here that depends on position and rate as none of the known effects does.",
    ),
    DRIVEN: Words(
        "a law of position, rate and input that the catalogue does not hold",
        "What is moved here takes up its forces in another way at another position or rate, as where "
        "its inertia changes.",
    ),
    LINE: Words(
        "a parameter that changed",
        "Something grows in proportion to this signal, as if a parameter were another meanwhile.",
    ),
    PULSE: Words(
        "a parameter that pulsates",
        "Something grows in proportion to this signal and comes and goes at one frequency, as if a "
        "parameter pulsated. When it does is known for this recording only.",
    ),
    BY_TURNS: Words(
        "a reading that is early and late by turns",
        "What is read is of a little earlier and later by turns, at one frequency, as where two "
        "clocks do not run alike. When it is which is known for this recording only.",
    ),
    PRODUCT: Words(
        "a product of two signals that the catalogue does not hold",
        "What acts here grows in proportion to two signals at once, as where the one carries the other.",
    ),
    WITH_SQUARE: Words(
        "a product with a square that the catalogue does not hold",
        "What acts here grows with one signal and with the square of another, as what a turn throws "
        "outwards.",
    ),
    ODD_POWER: Words(
        "a power that the catalogue does not hold",
        "What acts here grows as a power of this signal, another one than the known effects'.",
    ),
    EVEN_POWER: Words(
        "a power that the catalogue does not hold",
        "What acts here grows as a power of this signal, another one than the known effects'.",
    ),
    INVERSE: Words(
        "an inverse power that the catalogue does not hold",
        "What acts here falls off as a power of this signal, as what acts over a distance does. "
        "Nearer to zero than this recording came it is taken to stay as it is there.",
    ),
    STORED: Words(
        "an inertia, or whatever takes up what drives this equation, that changes",
        "What drives this equation, all of it, moves more or less by this signal, as where an "
        "inertia, a cross-section, a capacity or an inductance is not constant.",
    ),
    STORED_BY_SQUARE: Words(
        "an inertia, or whatever takes up what drives this equation, that changes",
        "What drives this equation, all of it, moves more or less as this signal goes from one point,"
        " either way: as where an inertia, a capacity or an inductance is not constant.",
    ),
    VARYING: Words(
        "a change that is not simulated",
        "What the simulation has as a constant changes with a signal, wherever it stands in the equations.",
    ),
    CHANGED: Words(
        "a parameter that changed",
        "What the simulation has as a constant is another one meanwhile, wherever it stands in the "
        "equations.",
    ),
    WORKED: Words(
        "a gain that depends on what went before",
        "What goes through here is weaker, or stronger, the harder it worked shortly before, as where"
        " a supply sags.",
    ),
    WORKED_BY_SQUARE: Words(
        "a gain that depends on what went before",
        "What goes through here is weaker, or stronger, the more power it took shortly before, as "
        "where something warms up.",
    ),
    AFTER_WORK: Words(
        "a coefficient that depends on what went before",
        "What acts here in proportion to this signal is weaker, or stronger, the more the signal moved "
        "shortly before, as where something is stirred thin and sets again.",
    ),
    AFTER_SQUARE: Words(
        "a coefficient that depends on what went before",
        "What acts here in proportion to this signal is weaker, or stronger, the more power it took shortly "
        "before, as where a resistance warms up.",
    ),
    TWO_SPEEDS: Words(
        "a lag that is slower one way",
        "The signal arrives smoothed, one way more than the other, as where something fills faster "
        "than it empties.",
    ),
    LOOP: Words(
        "a reading that depends on where it last turned",
        "What is read depends on where it last turned, however slowly it goes, as of a core that "
        "stays magnetised.",
    ),
    SWITCHED: Words(
        "a switch with hysteresis",
        "Something jumps here when this signal passes one threshold, and jumps back only when it passes "
        "another, as a relay, a thermostat or a spring that snaps over does.",
    ),
    SWITCHED_GAIN: Words(
        "a gain that switches with hysteresis",
        "What is in proportion to this signal here jumps when it passes one threshold, and back only when "
        "it passes another, as where a valve opens late and closes late.",
    ),
    BY_RATE: Words(
        "a reading that is off by how fast it moves",
        "What is read is off as long as it moves, by how fast it does.",
    ),
    BUILDS_UP: Words(
        "a reading in which errors build up",
        "What is read misses, or gains, something at some speeds and keeps that, as what counts turns"
        " or adds up a flow does.",
    ),
    ONE_PLACE: Words(
        "a force near one place",
        "Something acts near one value of this signal and hardly elsewhere, as a detent, a magnet or "
        "a rough spot does.",
    ),
    STEP: Words(
        "a force that steps at one place",
        "Something acts from one value of this signal on and not before, as of a spring that is preloaded"
        " either way and brings back what it holds, or of one that engages there.",
    ),
    RADIATED: Words(
        "heat that is radiated",
        "What is lost here goes as the fourth power of the absolute temperature; its coefficient at 300 K "
        "is a.",
    ),
    RIPPLED: Words(
        "a gain that ripples with an angle or a position",
        "What one signal brings in here goes up and down with the other, as the flow of a pump or the "
        "torque of a motor does within a turn.",
    ),
    RIPPLED_READING: Words(
        "a reading that ripples with what is measured",
        "What is read is too high and too low by turns as what is measured goes on, at any speed, as of a "
        "disc that does not run true or a scale whose lines are read unevenly.",
    ),
    DAMPED: Words(
        "a damping that the catalogue does not hold",
        "What is hit gives way.",
    ),
}
UNNAMED = tuple(code for code in WORDS if code != DAMPED)


def is_unnamed(placed: PlacedEffect) -> bool:
    """Tell whether a finding of it has no name."""
    return placed.effect.code in UNNAMED


def unnamed_law(
    code: str, equation: str, names, fixed, force, unit: str = "{port}", transform=None, amplitude=None
) -> Effect:
    """Return a law without a name, of named coefficients; others keep their bounds."""
    return Effect(
        code=code,
        title=WORDS[code].title,
        sentence=WORDS[code].sentence,
        equation=equation,
        parameters=(*(EffectParameter(name, unit) for name in names), *fixed),
        starts=no_start,  # they are told where it is placed, not taken from a setting
        force=force,
        transform=transform,
        amplitude=amplitude,
    )

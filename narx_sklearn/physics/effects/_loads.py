"""Loads: weight, cogging, drag, outflow, and what other signals bring in."""

import numpy as np

from narx_sklearn.model.phi import Phi
from narx_sklearn.physics.effects._curves import of_difference, of_level
from narx_sklearn.physics.effects._effect import Effect, EffectParameter, Power, Setting, at_least
from narx_sklearn.physics.effects._kernel import kernel
from narx_sklearn.physics.effects._starts import (
    DRY,
    grid,
    in_proportion_to_second,
    lines_in_angle,
    quantiles,
    scaled,
    spread,
    working_points,
)

SMALLEST_TURN = 0.05  # rad: below it the sine of an angle is the angle
QUARTER = 0.5 * np.pi
TURN = 2 * np.pi
OF_LEVELS = ("m", "dm", "cm", "mm", "in", "ft", "m^3", "dm^3", "cm^3", "l", "L", "%")  # how full it is
MOSTLY = (0.02, 0.98)  # quantiles between which a motion mostly is
MOST_WAVES, FEWER_WAVES = 100, 40  # looked for in a turn or along a way, and in less than a turn
WAVES = np.concatenate([np.arange(1.0, 8.0, 0.5), np.arange(8.0, 17.0)])  # in the range of the angle


@kernel
def _gravity(argument, rate, own, second, time, step, z, theta, dz):
    return -theta[0] * np.sin(argument + theta[1])


def _gravity_starts(setting: Setting) -> np.ndarray:
    """The angle counted from hanging, and from level."""
    if _turn(setting) < SMALLEST_TURN:
        return np.empty((0, 2))
    return scaled(setting, grid([1.0], [0.0, QUARTER]), lambda row: np.sin(setting.argument + row[1]))


def _turn(setting: Setting) -> float:
    low, high = quantiles(setting.argument, [0.0, 1.0])
    return high - low if high > low else 0.0


def _comes_round(setting: Setting) -> bool:
    """Tell whether the argument is an angle that goes through more than a turn, as no length does."""
    return setting.turns and _turn(setting) > TURN


@kernel
def _ripple(angle, N, p, r, q):
    first, second = np.sin(N * angle + p), 2.0 * N * angle + p
    return first if r == 0.0 and q == 0.0 else first + r * np.sin(second) + q * np.cos(second)


@kernel
def _cogging(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * _ripple(argument, theta[1], theta[2], theta[3], theta[4])


def _ripple_of_level(level, N, p, r, q):
    return np.sin(N * level + p) + r * np.sin(2.0 * N * level + p) + q * np.cos(2.0 * N * level + p)


def _cogging_starts(setting: Setting) -> np.ndarray:
    """Wave numbers close enough that none falls between two, and those that the residual shows best.

    Over more than a turn of an angle they are whole numbers, since the load repeats with it.
    """
    low, high = quantiles(setting.argument, MOSTLY)
    if not high > low:
        return np.empty((0, 5))
    whole, slowest = _comes_round(setting), _slowest_ripple(setting)
    # a fifth of the width of a line apart, so that none is missed
    fine = np.arange(1.0, MOST_WAVES + 1)
    if not whole:
        fine = TURN / _turn(setting) * np.arange(1.0, FEWER_WAVES if setting.turns else MOST_WAVES, 0.2)
    coarse = TURN / (high - low) * WAVES
    coarse = np.unique(np.maximum(np.round(coarse), 1.0)) if whole else coarse[coarse >= slowest]
    fine = fine[fine >= slowest]
    return scaled(
        setting,
        grid([1.0], np.union1d(coarse, lines_in_angle(setting, fine, 3)), [0.0, QUARTER], [0.0], [0.0]),
        lambda row: _ripple_of_level(setting.argument, *row[1:]),
    )


def _cogging_limits(setting: Setting) -> np.ndarray:
    return at_least(5, 1, _slowest_ripple(setting))


def _slowest_ripple(setting: Setting) -> float:
    """Return the least wave number: one a turn, or one where the motion mostly is and two in all of it.

    A wave that is not seen to come again is no ripple, but any curve that rises and falls.
    """
    low, high = quantiles(setting.argument, MOSTLY)
    if not high > low:
        return 0.0
    turn = _turn(setting)
    slowest = max(TURN / (high - low), 2 * TURN / turn)
    return min(slowest, 1.0) if _comes_round(setting) else slowest


@kernel
def _constant_load(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0]


def _constant_load_starts(setting: Setting) -> np.ndarray:
    size = 0.1 * spread(setting.own)
    return grid([size]) if size > 0 else np.empty((0, 1))


@kernel
def _quadratic_drag(argument, rate, own, second, time, step, z, theta, dz):
    return -theta[0] * argument * abs(argument)


def _quadratic_drag_starts(setting: Setting) -> np.ndarray:
    return scaled(setting, grid([1.0]), lambda row: setting.argument * np.abs(setting.argument))


def _drag_of_difference(now, before):
    return (now - before) * np.abs(now - before)


@kernel
def _root_outflow(argument, rate, own, second, time, step, z, theta, dz):
    head = max(argument + theta[2], 0.0)
    # near empty, one step takes no more than there is: the root's slope is infinite there
    return -min(theta[0] * head ** theta[1], head / step)


def _outflow_of_level(level, n, h0):
    return np.maximum(level + h0, 0.0) ** n


def _root_outflow_starts(setting: Setting) -> np.ndarray:
    low, high = quantiles(setting.argument, [0.0, 1.0])
    if not high > 0 or low < -0.1 * high:  # no level of anything
        return np.empty((0, 3))
    rows = np.array([[1.0, 0.5, 0.0], [1.0, 0.5, 0.2 * high], [1.0, 0.7, 0.0], [1.0, 1.5, 0.0]])
    return scaled(setting, rows, lambda row: _outflow_of_level(setting.argument, *row[1:]))


def _root_outflow_limits(setting: Setting) -> np.ndarray:
    """Keep the opening under the level nearly always: above one that is not it overflows."""
    lowest = quantiles(setting.argument, [DRY])[0]
    return at_least(3, 2, -lowest)


@kernel
def _bilinear_input(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * (second - theta[2]) * (argument - theta[1])


def _bilinear_input_starts(setting: Setting) -> np.ndarray:
    if setting.second is None or spread(setting.second) == 0 or spread(setting.argument) == 0:
        return np.empty((0, 3))
    return scaled(
        setting,
        grid([1.0], working_points(setting.argument), working_points(setting.second)),
        lambda row: (setting.second - row[2]) * (setting.argument - row[1]),
    )


@kernel
def _coupling(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * (second - theta[1])


@kernel
def _quadratic_coupling(argument, rate, own, second, time, step, z, theta, dz):
    beyond = second - theta[1]
    return theta[0] * beyond * abs(beyond)


def _quadratic_coupling_starts(setting: Setting) -> np.ndarray:
    if setting.second is None or spread(setting.second) == 0:
        return np.empty((0, 2))
    rows = grid([1.0], working_points(setting.second)[:1])
    return scaled(setting, rows, lambda row: (setting.second - row[1]) * np.abs(setting.second - row[1]))


def _gravity_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_level("weight", _ripple_of_level, (1.0, theta[1], 0.0, 0.0), argument)


def _cogging_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_level("ripple", _ripple_of_level, theta[1:], argument)


def _quadratic_drag_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_difference("drag", _drag_of_difference, (), argument)


def _root_outflow_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_level("outflow", _outflow_of_level, theta[1:], argument)


LOADS = (
    Effect(
        code="gravity",
        title="Weight",
        sentence="Weight pulls it down, more or less with the angle.",
        equation="-G sin(x + q0), with G = m g l/J; q0 = 0 where x = 0 hangs down, pi/2 where it is level",
        parameters=(EffectParameter("G", "{port}"), EffectParameter("q0", "rad", -np.pi, np.pi)),
        starts=_gravity_starts,
        force=_gravity,
        argument="position",
        argument_units=("rad",),
        lookalikes=("cubic_stiffness", "cogging", "constant_load"),
        holds=("constant_load", "linear_stiffness", "cubic_stiffness", "quadratic_stiffness"),
        separate_by="a slow full turn",
        source="Spong, Hutchinson and Vidyasagar 2006, Robot Modeling and Control, sec. 7.3",
        phi=_gravity_phi,
    ),
    Effect(
        code="cogging",
        title="Cogging",
        sentence="The torque ripples with the angle, at any speed.",
        equation="a (sin(N x + p) + r sin(2 N x + p) + q cos(2 N x + p))",
        parameters=(
            EffectParameter("a", "{port}"),
            EffectParameter("N", "1/({arg})", 0.0),
            EffectParameter("p", "rad", -TURN, TURN),
            EffectParameter("r", "-", -1.0, 1.0),
            EffectParameter("q", "-", -1.0, 1.0),
        ),
        starts=_cogging_starts,
        limits=_cogging_limits,
        force=_cogging,
        argument="position",
        argument_units=("rad", "m", "mm", "um"),
        phase=2,
        form=4,
        lookalikes=("periodic_disturbance", "gravity"),
        holds=("constant_load", "gravity", "cubic_stiffness", "quadratic_stiffness"),
        separate_by="turning at two speeds",
        source="Holtz and Springob 1996, IEEE Trans. Ind. Electron. 43(2), sec. II",
        phi=_cogging_phi,
    ),
    Effect(
        code="constant_load",
        title="Constant load",
        sentence="Something pushes, or leaks, with a force that stays the same.",
        equation="F",
        parameters=(EffectParameter("F", "{port}"),),
        starts=_constant_load_starts,
        force=_constant_load,
        argument="none",
        lookalikes=("sensor_bias", "asymmetric_friction", "gravity", "additive_drift"),
        separate_by="another operating point",
        source="Ljung 1999, System Identification, sec. 14.1",
        narx_terms="the constant",
    ),
    Effect(
        code="quadratic_drag",
        title="Drag of a fluid",
        sentence="A force opposes the motion with the square of its speed.",
        equation="-c2 v |v|",
        parameters=(EffectParameter("c2", "{port}/({arg})^2", 0.0),),
        starts=_quadratic_drag_starts,
        force=_quadratic_drag,
        met_on="motion",
        lookalikes=("viscous_damping",),
        power=Power(2.0, odd=True),
        separate_by="a free decay, or two amplitudes",
        source="Morison, O'Brien, Johnson and Schaaf 1950, J. Petrol. Technol. 2(5), drag term",
        phi=_quadratic_drag_phi,
    ),
    Effect(
        code="root_outflow",
        title="Outflow through an opening",
        sentence="It drains through an opening, the faster the fuller it is, but not in proportion.",
        equation="-a max(x + h0, 0)^n; n = 1/2 is Torricelli's law",
        parameters=(
            EffectParameter("a", "{port}/({arg})^n", 0.0),
            EffectParameter("n", "-", 0.2, 3.0),
            EffectParameter("h0", "{arg}"),
        ),
        starts=_root_outflow_starts,
        limits=_root_outflow_limits,
        force=_root_outflow,
        met_on="levels",
        lookalikes=("sensor_bias", "constant_load", "overflow"),
        holds=("constant_load", "linear_stiffness", "quadratic_stiffness"),
        native_units=OF_LEVELS,  # what a level loses, it loses through an opening
        separate_by="draining from full to empty",
        source="Schoukens and Noel 2017, IFAC-PapersOnLine 50(1), sec. 4; Torricelli 1644",
        phi=_root_outflow_phi,
    ),
    Effect(
        code="bilinear_input",
        title="Gain that depends on the state",
        sentence="How strongly the input acts depends on the state.",
        equation="b (u - c) (x - r)",
        parameters=(
            EffectParameter("b", "{port}/(({arg}) ({second}))"),
            EffectParameter("r", "{arg}"),
            EffectParameter("c", "{second}"),
        ),
        references=(1, 2),
        starts=_bilinear_input_starts,
        force=_bilinear_input,
        argument="any",
        second="input",
        lookalikes=("input_saturation", "gain_drift"),
        holds=("constant_load", "viscous_damping", "linear_stiffness"),
        separate_by="steps at several operating points",
        source="Mohler 1991, Nonlinear Systems, vol. 2: Applications to Bilinear Control, ch. 1",
        narx_terms="u[k-1]*y[k-1] and u[k-1]",
    ),
    Effect(
        code="coupling",
        title="Coupling to another measured signal",
        sentence="Another measured signal drives it too.",
        equation="b (w - reference), with w the other signal",
        parameters=(EffectParameter("b", "{port}/({second})"), EffectParameter("reference", "{second}")),
        references=(1,),
        starts=in_proportion_to_second,
        force=_coupling,
        argument="none",
        second="channel",
        lookalikes=("additive_drift", "temperature_gain"),
        separate_by="varying that signal alone",
        source="Ljung 1999, System Identification, sec. 4.2 (measured disturbances)",
        narx_terms="that signal as a further input, and the constant",
    ),
    Effect(
        code="quadratic_coupling",
        title="Drive by the square of another measured signal",
        sentence="Another measured signal drives it too, by its square, the way it goes, as wind does.",
        equation="b (w - r) |w - r|, with w the other signal",
        parameters=(EffectParameter("b", "{port}/({second})^2"), EffectParameter("r", "{second}")),
        references=(1,),
        starts=_quadratic_coupling_starts,
        force=_quadratic_coupling,
        argument="none",
        second="channel",
        lookalikes=("coupling", "additive_drift"),
        separate_by="varying that signal alone, at two amplitudes",
        source="Morison, O'Brien, Johnson and Schaaf 1950, J. Petrol. Technol. 2(5), drag term of a flow",
        narx_terms="the square of that signal as a further input, with its sign",
    ),
)

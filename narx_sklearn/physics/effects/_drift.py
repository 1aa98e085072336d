"""What comes with time or with nothing at all: drift, bias, a line in the spectrum."""

import numpy as np

from narx_sklearn.physics.effects._effect import Effect, EffectParameter, Setting, at_least, at_most
from narx_sklearn.physics.effects._kernel import kernel
from narx_sklearn.physics.effects._series import time_since
from narx_sklearn.physics.effects._starts import (
    grid,
    lines_in_time,
    record_length,
    scaled,
    spread,
    time_looked_at,
    working_points,
)

FEWEST_PERIODS = 3  # in a record: fewer are drift
STRAIGHT = 30.0  # records in one time constant, of which a record shows a straight line, to 2 %
SETTLED = 30.0  # time constants in a record, of which it shows another gain and an offset
SHAPES = np.array(  # T in record lengths, b, c
    [
        [0.05, 0.0, 0.0],  # a warm-up early in the record
        [0.3, 0.0, 0.0],  # one over all of it
        [3.0, 0.0, 0.0],  # nearly a ramp
        [1.0, 2.0, -6.0],  # there and back again
        [1.0, 20.0, -15.0],  # slow at first
    ]
)


@kernel
def _warmed(time, T):
    """Return 1 - exp(-t/T), and a straight line of slope 1/T where T is beyond all bounds."""
    return -np.expm1(-time / T) if T > 0.0 else (1.0 if time > 0.0 else 0.0)


def warmed_along(time: np.ndarray, T: float) -> np.ndarray:
    """Return the same at many times."""
    return -np.expm1(-time / T) if T > 0 else (time > 0).astype(float)


@kernel
def _gain_drift(argument, rate, own, second, time, step, z, theta, dz):
    signal = argument if np.isnan(second) else second
    return theta[0] * _warmed(time, theta[1]) * (signal - theta[2])


def _gain_drift_transform(signal, second, dt, theta, first):
    warmed = warmed_along(time_since(first, signal.size, dt), theta[1])
    return signal + theta[0] * warmed * (signal - theta[2])


def _gain_drift_starts(setting: Setting) -> np.ndarray:
    """A gain that settles within the record, and one that goes on and on; about zero and about the mean."""
    signal = setting.argument if setting.second is None else setting.second
    if spread(signal) == 0:  # a drift then, which is additive
        return np.empty((0, 3))
    times = np.array([0.3, 3.0]) * record_length(setting)
    return scaled(
        setting,
        grid([1.0], times, working_points(signal)),
        lambda row: warmed_along(setting.time, row[1]) * (signal - row[2]),
    )


def _gain_drift_limits(setting: Setting) -> np.ndarray:
    """Keep the time constant to those of which a record shows how the gain goes.

    Of a longer one and a size it tells nothing but their ratio; a shorter one is another gain and an offset.
    """
    whole = time_looked_at(setting)
    limits = at_most(3, 1, STRAIGHT * whole)
    limits[1, 0] = whole / SETTLED
    return limits


@kernel
def _temperature_gain(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * (second - theta[1]) * (argument - theta[2])


def _temperature_gain_transform(signal, second, dt, theta, first):
    return signal + theta[0] * (second - theta[1]) * (signal - theta[2])


def _temperature_gain_starts(setting: Setting) -> np.ndarray:
    if setting.second is None or spread(setting.second) == 0 or spread(setting.argument) == 0:
        return np.empty((0, 3))
    return scaled(
        setting,
        grid([1.0], working_points(setting.second)[-1:], working_points(setting.argument)),
        lambda row: (setting.second - row[1]) * (setting.argument - row[2]),
    )


@kernel
def _additive_drift(argument, rate, own, second, time, step, z, theta, dz):
    q = _warmed(time, theta[1])
    return theta[0] * q * (1.0 + q * (theta[2] + q * theta[3]))


def _shape_of_drift(time, T, b, c):
    q = warmed_along(time, T)
    return q * (1.0 + q * (b + q * c))


def _additive_drift_transform(signal, second, dt, theta, first):
    return signal + theta[0] * _shape_of_drift(time_since(first, signal.size, dt), *theta[1:4])


def _additive_drift_starts(setting: Setting) -> np.ndarray:
    rows = np.column_stack([np.ones(len(SHAPES)), SHAPES])
    rows[:, 1] *= record_length(setting)
    return scaled(setting, rows, lambda row: _shape_of_drift(setting.time, *row[1:]))


def _bias_transform(signal, second, dt, theta, first):
    return signal + theta[0]


def _bias_starts(setting: Setting) -> np.ndarray:
    size = 0.1 * spread(setting.own)
    return grid([size]) if size > 0 else np.empty((0, 1))


@kernel
def _periodic(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * np.sin(theta[1] * time + theta[2])


def _periodic_transform(signal, second, dt, theta, first):
    return signal + theta[0] * np.sin(theta[1] * time_since(first, signal.size, dt) + theta[2])


def _periodic_starts(setting: Setting) -> np.ndarray:
    """The strongest lines of the residual; without it a coarse grid, which finds strong lines only.

    A frequency must be known to a fraction of one period in a record before a fit can improve it.
    """
    frequencies = lines_in_time(setting, 2)
    if frequencies.size == 0:
        slowest = 2 * np.pi * FEWEST_PERIODS / max(record_length(setting), setting.dt)
        fastest = 0.2 * np.pi / setting.dt
        if slowest >= fastest:
            return np.empty((0, 3))
        frequencies = np.geomspace(slowest, fastest, 3)
    rows = grid([1.0], frequencies, [0.0, 0.5 * np.pi])
    return scaled(setting, rows, lambda row: np.sin(row[1] * setting.time + row[2]))


def _periodic_limits(setting: Setting) -> np.ndarray:
    """Periods enough in the time looked at; fewer are drift."""
    return at_least(3, 1, 2 * np.pi * FEWEST_PERIODS / time_looked_at(setting))


DRIFT = (
    Effect(
        code="gain_drift",
        title="Drifting gain",
        sentence="The gain changes slowly with time, and may settle.",
        equation="s + a q (s - r) at an input; a q (x - r), a drifting coefficient, in a state equation, or "
        "a q (u - r) of what drives it; q = 1 - exp(-t/T), nearly t/T where T is long",
        parameters=(
            EffectParameter("a", "{port}/({arg})"),
            EffectParameter("T", "s", 0.0),
            EffectParameter("r", "{arg}"),
        ),
        references=(2,),
        starts=_gain_drift_starts,
        limits=_gain_drift_limits,
        force=_gain_drift,
        transform=_gain_drift_transform,
        output_port=False,
        argument="any",
        second="feed",
        lookalikes=("additive_drift", "temperature_gain", "bilinear_input"),
        separate_by="the same segment at the start, in the middle and at the end",
        source="Ljung 1999, System Identification, sec. 11.1 (slowly varying parameters)",
        narx_terms="time as a further input: t[k]*u[k-1]",
    ),
    Effect(
        code="temperature_gain",
        title="Gain that follows another measured signal",
        sentence="The gain changes with a measured condition, temperature for one.",
        equation="s + a (w - reference) (s - r) at an input; a (w - reference) (x - r) in a state equation, "
        "with w the measured signal",
        parameters=(
            EffectParameter("a", "{port}/(({arg}) ({second}))"),
            EffectParameter("reference", "{second}"),
            EffectParameter("r", "{arg}"),
        ),
        references=(1, 2),
        starts=_temperature_gain_starts,
        force=_temperature_gain,
        transform=_temperature_gain_transform,
        output_port=False,
        argument="any",
        second="channel",
        lookalikes=("gain_drift", "coupling"),
        separate_by="the same segment at several values of that signal",
        source="Rugh and Shamma 2000, Automatica 36(10), sec. 2 (scheduling on a measured signal)",
        narx_terms="that signal as a further input, times u[k-1]",
    ),
    Effect(
        code="additive_drift",
        title="Additive drift",
        sentence="It wanders off by itself, whatever the input does.",
        equation="a (q + b q^2 + c q^3), added; q = 1 - exp(-t/T), nearly t/T where T is long; a warm-up has "
        "b = c = 0",
        parameters=(
            EffectParameter("a", "{port}"),
            EffectParameter("T", "s", 0.0),
            EffectParameter("b", "-"),
            EffectParameter("c", "-"),
        ),
        starts=_additive_drift_starts,
        force=_additive_drift,
        transform=_additive_drift_transform,
        input_port=False,
        argument="none",
        met_at="output",
        lookalikes=("gain_drift", "sensor_bias", "creep", "constant_load", "coupling"),
        holds=("sensor_bias", "constant_load"),
        separate_by="holding the input at zero, or a second sensor",
        source="Ljung 1999, System Identification, sec. 14.1",
        narx_terms="time as a further input: t[k], t[k]^2, t[k]^3",
    ),
    Effect(
        code="sensor_bias",
        title="Sensor offset",
        sentence="The sensor does not show zero at zero.",
        equation="s + b; in a state equation the same is a constant_load",
        parameters=(EffectParameter("b", "{port}"),),
        starts=_bias_starts,
        transform=_bias_transform,
        input_port=False,
        lookalikes=("constant_load", "additive_drift", "root_outflow"),
        separate_by="another operating point, or a second sensor",
        source="Ljung 1999, System Identification, sec. 14.1",
        narx_terms="the constant",
    ),
    Effect(
        code="input_offset",
        title="Offset of an input",
        sentence="What drives it is off by a fixed amount, as where a pressure is counted from another zero.",
        equation="s + b",
        parameters=(EffectParameter("b", "{port}"),),
        starts=_bias_starts,
        transform=_bias_transform,
        output_port=False,
        is_offset=True,
        lookalikes=("constant_load", "scale_error", "gain_drift"),
        separate_by="another operating point",
        source="Ljung 1999, System Identification, sec. 14.1",
        narx_terms="that signal times what it acts with, and the constant",
    ),
    Effect(
        code="periodic_disturbance",
        title="Periodic disturbance",
        sentence="Something else swings at a fixed frequency.",
        equation="A sin(w t + p)",
        parameters=(
            EffectParameter("A", "{port}"),
            EffectParameter("w", "rad/s", 0.0),
            EffectParameter("p", "rad", -2 * np.pi, 2 * np.pi),
        ),
        starts=_periodic_starts,
        limits=_periodic_limits,
        force=_periodic,
        transform=_periodic_transform,
        input_port=False,
        argument="none",
        phase=2,
        lookalikes=("cogging", "extra_mode"),
        separate_by="a constant input, and another speed",
        source="Bodson and Douglas 1997, Automatica 33(12), sec. 2",
        narx_terms="sin(w t) and cos(w t) as further inputs",
    ),
)

"""What comes with time or with nothing at all: drift, bias, a line in the spectrum."""

import numpy as np

from narx_sklearn.physics.effects._effect import Effect, EffectParameter, Setting
from narx_sklearn.physics.effects._kernel import kernel
from narx_sklearn.physics.effects._series import time_since
from narx_sklearn.physics.effects._starts import grid, lines_in_time, record_length, scaled, spread

FEWEST_PERIODS = 3  # in a record: fewer are drift


@kernel
def _gain_drift(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * argument * time


def _gain_drift_transform(signal, second, dt, theta, first):
    return signal * (1.0 + theta[0] * time_since(first, signal.size, dt))


def _gain_drift_starts(setting: Setting) -> np.ndarray:
    if spread(setting.argument) == 0:  # a ramp then, which is additive drift
        return np.empty((0, 1))
    return scaled(setting, grid([1.0]), lambda row: setting.argument * setting.time)


@kernel
def _temperature_gain(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * argument * second


def _temperature_gain_transform(signal, second, dt, theta, first):
    return signal * (1.0 + theta[0] * second)


def _temperature_gain_starts(setting: Setting) -> np.ndarray:
    if setting.second is None or spread(setting.second) == 0 or spread(setting.argument) == 0:
        return np.empty((0, 1))
    return scaled(setting, grid([1.0]), lambda row: setting.argument * setting.second)


@kernel
def _warming(time, T):
    """Return 1 - exp(-t/T), and a straight line of slope 1/T where T is beyond all bounds."""
    return -np.expm1(-time / T) if T > 0.0 else (1.0 if time > 0.0 else 0.0)


@kernel
def _additive_drift(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * _warming(time, theta[1])


def _additive_drift_transform(signal, second, dt, theta, first):
    time = time_since(first, signal.size, dt)
    return signal + theta[0] * (-np.expm1(-time / theta[1]) if theta[1] > 0 else (time > 0))


def _additive_drift_starts(setting: Setting) -> np.ndarray:
    """A warm-up early in the record, one over all of it, and nearly a ramp."""
    length = record_length(setting)
    rows = grid([1.0], np.array([0.05, 0.3, 3.0]) * length)
    return scaled(setting, rows, lambda row: -np.expm1(-setting.time / row[1]))


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


DRIFT = (
    Effect(
        code="gain_drift",
        title="Drifting gain",
        sentence="The gain changes slowly with time.",
        equation="s (1 + a t) at an input; a x t, a drifting coefficient, in a state equation",
        parameters=(EffectParameter("a", "{port}/({arg} s)"),),
        starts=_gain_drift_starts,
        force=_gain_drift,
        transform=_gain_drift_transform,
        output_port=False,
        argument="any",
        lookalikes=("additive_drift", "temperature_gain", "bilinear_input"),
        separate_by="the same segment at the start, in the middle and at the end",
        source="Ljung 1999, System Identification, sec. 11.1 (slowly varying parameters)",
        narx_terms="time as a further input: t[k]*u[k-1]",
    ),
    Effect(
        code="temperature_gain",
        title="Gain that follows another measured signal",
        sentence="The gain changes with a measured condition, temperature for one.",
        equation="s (1 + a w) at an input; a x w in a state equation, with w the measured signal",
        parameters=(EffectParameter("a", "{port}/({arg} {second})"),),
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
        equation="b (1 - exp(-t/T)), added; nearly b t/T where T is long",
        parameters=(EffectParameter("b", "{port}"), EffectParameter("T", "s", 0.0)),
        starts=_additive_drift_starts,
        force=_additive_drift,
        transform=_additive_drift_transform,
        input_port=False,
        argument="none",
        lookalikes=("gain_drift", "sensor_bias", "creep", "constant_load", "coupling"),
        separate_by="holding the input at zero, or a second sensor",
        source="Ljung 1999, System Identification, sec. 14.1",
        narx_terms="time as a further input",
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
        force=_periodic,
        transform=_periodic_transform,
        input_port=False,
        argument="none",
        lookalikes=("cogging", "extra_mode"),
        separate_by="a constant input, and another speed",
        source="Bodson and Douglas 1997, Automatica 33(12), sec. 2",
        narx_terms="sin(w t) and cos(w t) as further inputs",
    ),
)

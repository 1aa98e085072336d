"""A sensor that does not show what there is: coarse, or stuck."""

import numpy as np

from narx_sklearn.model.phi import Phi
from narx_sklearn.physics.effects._curves import of_level
from narx_sklearn.physics.effects._effect import Effect, EffectParameter, Setting
from narx_sklearn.physics.effects._starts import grid, spread, telling

FEW = 0.25  # distinct values a sample, below which a signal is taken to be quantised


def _steps(level, q):
    return q * np.round(level / q) if q > 0 else level


def _quantisation_transform(signal, second, dt, theta, first):
    return _steps(signal, theta[0])


def _quantisation_starts(setting: Setting) -> np.ndarray:
    """The step between the measured values where they are few, else shares of the spread."""
    if spread(setting.argument) == 0:
        return np.empty((0, 1))
    shares = np.array([0.03, 0.1, 0.3]) * spread(setting.argument)
    return telling(setting, grid([*_step_of(_measured(setting)), *shares]), _quantisation_transform)


def _measured(setting: Setting) -> np.ndarray:
    return np.empty(0) if setting.residual is None else setting.argument + setting.residual


def _step_of(values: np.ndarray) -> list[float]:
    values = values[np.isfinite(values)]
    size = spread(values)
    if size == 0:
        return []
    distinct = np.unique(np.round(values / (1e-6 * size)))  # equal but for rounding counts as equal
    if not 2 < distinct.size < FEW * values.size:
        return []
    return [1e-6 * size * float(np.median(np.diff(distinct)))]


def _stuck_transform(signal, second, dt, theta, first):
    """Hold the value at t0, interpolated between samples so that it varies smoothly with t0."""
    time = np.arange(signal.size) * dt
    good = np.isfinite(signal)
    if not good.any():
        return np.array(signal, dtype=float)
    held = np.interp(theta[0], time[good], signal[good])
    return np.where(good & (time >= theta[0]) & (time < theta[0] + theta[1]), held, signal)


def _stuck_starts(setting: Setting) -> np.ndarray:
    """The longest stretch where the measurement stands still and the simulation moves; else three guesses."""
    if spread(setting.argument) == 0:
        return np.empty((0, 2))
    found = _standstill(_measured(setting), setting.argument, setting.dt)
    length = setting.argument.size * setting.dt
    rows = found if len(found) else grid(np.array([0.2, 0.45, 0.7]) * length, [0.1 * length])
    return telling(setting, rows, _stuck_transform)


def _standstill(measured: np.ndarray, simulated: np.ndarray, dt: float) -> np.ndarray:
    if measured.size < 3:
        return np.empty((0, 2))
    still = np.abs(np.diff(measured)) <= 1e-9 * spread(measured)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
    begin, end = edges[::2], edges[1::2]
    if begin.size == 0:
        return np.empty((0, 2))
    moves = [np.ptp(simulated[a : b + 1]) for a, b in zip(begin, end, strict=True)]
    worst = int(np.argmax(moves))
    if not moves[worst] > 0.1 * spread(simulated):
        return np.empty((0, 2))
    return np.array([[begin[worst] * dt, (end[worst] - begin[worst] + 1) * dt]])


def _quantisation_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_level("steps", _steps, theta, argument)


SENSOR = (
    Effect(
        code="quantisation",
        title="Coarse steps",
        sentence="The sensor shows whole steps only.",
        equation="q round(s/q)",
        parameters=(EffectParameter("q", "{port}", 0.0),),
        starts=_quantisation_starts,
        transform=_quantisation_transform,
        input_port=False,
        amplitude=None,
        lookalikes=("stuck_sensor", "valve_stiction"),
        separate_by="counting the distinct values, and a small dither",
        source="Widrow and Kollar 2008, Quantization Noise, ch. 1",
        phi=_quantisation_phi,
    ),
    Effect(
        code="stuck_sensor",
        title="Stuck sensor",
        sentence="For a while the sensor shows the same value.",
        equation="s(t0) for t0 <= t < t0 + D, with t from the beginning of the record",
        parameters=(EffectParameter("t0", "s", 0.0), EffectParameter("D", "s", 0.0)),
        starts=_stuck_starts,
        transform=_stuck_transform,
        input_port=False,
        amplitude=None,
        lookalikes=("valve_stiction", "quantisation", "sensor_clip"),
        separate_by="a small dither, or a second sensor",
        source="Isermann 2006, Fault-Diagnosis Systems, sec. 2.5",
        narx_terms="none: leave these samples out",
    ),
)

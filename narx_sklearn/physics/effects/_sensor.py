"""A sensor that does not show what there is: of another scale, coarse, stuck, or shown another signal too."""

import numpy as np
from scipy.signal import lfilter
from scipy.stats import median_abs_deviation

from narx_sklearn.model.phi import Phi
from narx_sklearn.physics.effects._curves import of_level
from narx_sklearn.physics.effects._effect import Effect, EffectParameter, Setting
from narx_sklearn.physics.effects._series import SHORTEST_HOLD, held_runs
from narx_sklearn.physics.effects._starts import (
    ORDINARY,
    grid,
    in_proportion_to_second,
    spread,
    telling,
    working_points,
)

FARTHEST = 4.0  # noise deviations that a reading which is held may be off
HALF = 0.5  # of a sample, so that which samples are held does not depend on rounding
SPIKE = 2  # samples that may all be one
LASTING = 0.2  # of what a hold explains, that others must, where they are not many times the noise
SETTLED = 5  # rounds in which both ends of a stretch are settled, at most
BEST = 3  # of the values scanned that are kept
LEVELS = 2**16  # on which a signal's values are gathered; steps of less than eight of them are not looked for
LOOKED_AT = 20  # of the best steps, that are tried as they are
LONGEST_MEMORY = 0.99  # of noise, share of a sample that the next one keeps
FEW = 0.25  # distinct values a sample, below which a signal is taken to be quantised


def _scaled_transform(signal, second, dt, theta, first):
    return signal + theta[0] * (signal - theta[1])


def _scaled_starts(setting: Setting) -> np.ndarray:
    if spread(setting.argument) == 0:
        return np.empty((0, 2))
    return grid([ORDINARY], working_points(setting.argument)[:1])


def _cross_transform(signal, second, dt, theta, first):
    return signal + theta[0] * (second - theta[1])


def _between_transform(signal, second, dt, theta, first):
    return signal + theta[0] * (second - signal)


def _between_starts(setting: Setting) -> np.ndarray:
    if setting.second is None or spread(setting.second - setting.argument) == 0:
        return np.empty((0, 1))
    return grid([ORDINARY, 4 * ORDINARY])


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


def _quantisation_scan(setting: Setting, residual: np.ndarray) -> tuple[np.ndarray, int]:
    """Look for a line in the residual along the signal: steps q leave a saw tooth of that period.

    Its first harmonic is -(q/pi) sin(2 pi s/q). All periods come from one transform of the residual, gathered
    over the signal's levels; their inverses are so close that no level is missed by more than an eighth.
    Both are seen as an autoregression of one lag leaves them, since noise may have a memory; what that leaves
    of a harmonic, the signal's increments tell in the same way.
    """
    signal, n = setting.argument, setting.argument.size
    size, reach = spread(signal), float(np.max(np.abs(signal), initial=0.0))
    if size == 0 or not np.all(np.isfinite(residual) & np.isfinite(signal)):
        return np.empty((0, 1)), 0
    number = np.arange(1, LEVELS)  # of steps in eight times the reach

    def lines(values: np.ndarray, weights: np.ndarray | None, number: np.ndarray) -> np.ndarray:
        """Return the sum of weights times exp(-2 pi i v/q) for each number of steps."""
        at = np.round((values / reach + 1.0) * (LEVELS // 2)).astype(np.int64)
        gathered = np.bincount(at, weights, LEVELS + 1)[:LEVELS]
        return np.fft.rfft(gathered, 4 * LEVELS)[number] * np.exp(0.25j * np.pi * (number % 8))

    memory = _memory(residual)
    whitening = [1.0, -memory], [1.0]
    left = lfilter(*whitening, residual - residual.mean())
    along = lines(signal, left - memory * np.append(left[1:], 0.0), number).imag
    together = lines(np.diff(signal) / 2.0, None, 2 * number).real  # of a harmonic and the next sample's
    squares = 0.5 * ((1.0 + memory**2) * n - 2.0 * memory * together)
    height = 8.0 * reach / number / np.pi
    gain = np.where(number * size > 8.0 * reach, 2.0 * height * along - squares * height**2, 0.0)
    found = []
    for j in np.argsort(-gain)[:LOOKED_AT]:
        q = 8.0 * reach / number[j]
        change = lfilter(*whitening, _steps(signal, q) - signal)
        length = change @ change
        share = change @ left / length if length > 0 else 0.0
        if gain[j] > 0 and 0.5 < share < 1.5:
            found.append((float(share**2 * length), float(q)))
    best = [q for _, q in sorted(found, reverse=True)[:BEST]]
    return np.array(best).reshape(-1, 1), number.size


def _memory(residual: np.ndarray) -> float:
    """Return how much of one sample the next one keeps."""
    r = residual - residual.mean()
    return float(np.clip(r[1:] @ r[:-1] / (r @ r), 0.0, LONGEST_MEMORY)) if r.any() else 0.0


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
    """Hold the value at the sample of t0, and what the reading was off there."""
    time = np.arange(signal.size) * dt
    begin = theta[0] - HALF * dt
    held = np.isfinite(signal) & (time >= begin) & (time < begin + theta[1])
    if not held.any():
        return np.array(signal, dtype=float)
    return np.where(held, signal[np.argmax(held)] + theta[2], signal)


def _stuck_starts(setting: Setting) -> np.ndarray:
    if spread(setting.argument) == 0:
        return np.empty((0, 3))
    length = setting.argument.size * setting.dt
    shares = np.array([0.2, 0.45, 0.7])
    return telling(setting, grid(shares * length, [0.1 * length], [0.0]), _stuck_transform)


def _stuck_limits(setting: Setting) -> np.ndarray:
    """Take the time from a reading that repeats to the last digit, and let it hold its noise too.

    One that has noise still is the signal.
    """
    limits = np.tile([0.0, np.inf], (3, 1))
    limits[2] = 0.0
    repeated = _repeated(setting)
    if repeated is not None and setting.residual is not None:
        most = FARTHEST * float(median_abs_deviation(setting.residual, scale="normal"))
        reach = np.array([0.0, 0.0, most])
        limits = np.column_stack([repeated - reach, repeated + reach])
    return limits


def _repeated(setting: Setting) -> np.ndarray | None:
    """Return the parameters that the longest stretch of repeated values tells; None without one."""
    measured = _measured(setting)
    runs = held_runs(measured) if measured.size else []
    if not runs:
        return None
    start, stop = max(runs, key=lambda run: run[1] - run[0])
    return _row(setting, start, stop, measured[start] - setting.argument[start])


def _row(setting: Setting, start: int, stop: int, off: float) -> np.ndarray:
    began = setting.time if setting.elapsed is None else setting.elapsed
    return np.array([began[start], (stop - start) * setting.dt, off])


def _stuck_scan(setting: Setting, residual: np.ndarray) -> tuple[np.ndarray, int]:
    """Hold the simulated value from every sample on, for lengths that grow by a third; settle both ends.

    Where measured values repeat to the last digit, those are the ends.
    """
    simulated, measured = setting.argument, setting.argument + residual
    n = measured.size
    if n < 4 * SHORTEST_HOLD or not np.all(np.isfinite(measured)):
        return np.empty((0, 3)), 0
    repeated = _repeated(setting)
    if repeated is not None:
        return repeated[None, :], 1
    level = measured.mean()  # about it, so that the squares do not cancel
    missed, first, second = (
        np.cumsum(np.append(0.0, values))
        for values in (residual**2, measured - level, (measured - level) ** 2)
    )

    def gains(begin, end) -> np.ndarray:
        held = simulated[begin] - level
        missed_held = (
            second[end] - second[begin] - 2 * held * (first[end] - first[begin]) + (end - begin) * held**2
        )
        return missed[end] - missed[begin] - missed_held

    found, tried = [], 0
    noise = median_abs_deviation(residual, scale="normal")
    size = SHORTEST_HOLD
    while size < n // 2:
        begin = np.arange(n - size)
        gain = gains(begin, begin + size)
        best = int(np.argmax(gain))
        found.append((float(gain[best]), best, best + size))
        tried += begin.size
        size += max(1, size // 3)
    found.sort(reverse=True)
    rows = []
    for most, first_held, after in found[:BEST]:
        if most > 0:
            start, stop, more = _settled(gains, first_held, after, n)
            tried += more
            missed_there = measured[start:stop] - simulated[start]
            if not _lasts(residual[start:stop] ** 2 - missed_there**2, 2.0 * np.log(n) * noise**2):
                continue
            rows.append(_row(setting, start, stop, 0.0))
    return np.array(rows).reshape(-1, 3), tried


def _lasts(gain: np.ndarray, by_chance: float) -> bool:
    """Tell whether more than a few samples gain: one that stands alone is a spike.

    Where a signal turns fast at the end of a hold, most is gained there, but so is more than noise elsewhere.
    """
    others = float(np.sort(gain)[:-SPIKE].sum())
    return others > min(LASTING * float(gain.sum()), by_chance)


def _settled(gains, begin: int, end: int, n: int) -> tuple[int, int, int]:
    """Return the best ends of a stretch, within a third of its length, and how many were tried."""
    reach, tried = max(2, (end - begin) // 3), 0
    for _ in range(SETTLED):
        before = begin, end
        ends = np.arange(max(end - reach, begin + SHORTEST_HOLD), min(end + reach, n) + 1)
        end = int(ends[np.argmax(gains(begin, ends))])
        begins = np.arange(max(begin - reach, 0), min(begin + reach, end - SHORTEST_HOLD) + 1)
        begin = int(begins[np.argmax(gains(begins, end))])
        tried += ends.size + begins.size
        if (begin, end) == before:
            break
    return begin, end, tried


def _quantisation_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_level("steps", _steps, theta, argument)


SENSOR = (
    Effect(
        code="scale_error",
        title="Wrong scale",
        sentence="What goes through here is larger, or smaller, by a fixed share than it is taken to be.",
        equation="s + b (s - r)",
        parameters=(EffectParameter("b", "-", -1.0), EffectParameter("r", "{port}")),
        references=(1,),
        starts=_scaled_starts,
        transform=_scaled_transform,
        lookalikes=("sensor_bias", "input_saturation", "sensor_clip", "gain_drift", "cross_sensitivity"),
        holds=("sensor_bias", "input_offset"),
        separate_by="a reference measured beside it at two levels",
        source="JCGM 200:2012, International Vocabulary of Metrology, 2.39 (calibration)",
        narx_terms="none: it scales the terms of its signal",
    ),
    Effect(
        code="cross_sensitivity",
        title="Sensor that feels another signal",
        sentence="The sensor shows a part of another signal too.",
        equation="s + b (w - reference), with w the other signal",
        parameters=(EffectParameter("b", "{port}/({second})"), EffectParameter("reference", "{second}")),
        references=(1,),
        starts=in_proportion_to_second,
        transform=_cross_transform,
        input_port=False,
        second="other",
        lookalikes=("lag", "delay", "extra_mode", "sensor_bias"),
        holds=("sensor_bias",),
        separate_by="varying that signal alone",
        source="JCGM 200:2012, International Vocabulary of Metrology, 4.13 (influence quantities: 2.52)",
        narx_terms="that signal as a further input, and the constant",
    ),
    Effect(
        code="mixed_reading",
        title="Sensor between two places",
        sentence="The sensor shows a value between those of two places.",
        equation="s + b (w - s), with w that of the other place",
        parameters=(EffectParameter("b", "-", 0.0, 1.0),),
        starts=_between_starts,
        transform=_between_transform,
        input_port=False,
        second="alike",
        lookalikes=("cross_sensitivity", "scale_error", "lag", "extra_mode"),
        separate_by="a second sensor at each of the two places",
        source="Michalski et al. 2001, Temperature Measurement, 2nd ed. (heat that a sensor's stem conducts)",
        narx_terms="that signal as a further input, in a share of which the own one loses as much",
    ),
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
        read_off=True,
        lookalikes=("stuck_sensor", "valve_stiction"),
        scan=_quantisation_scan,
        n_apart=LEVELS - 1,
        separate_by="counting the distinct values, and a small dither",
        source="Widrow and Kollar 2008, Quantization Noise, ch. 1",
        phi=_quantisation_phi,
    ),
    Effect(
        code="stuck_sensor",
        title="Stuck sensor",
        sentence="For a while the sensor shows the same value.",
        equation="s(t0) + o for t0 <= t < t0 + D, with t from the beginning of the record",
        parameters=(
            EffectParameter("t0", "s", 0.0),
            EffectParameter("D", "s", 0.0),
            EffectParameter("o", "{port}"),
        ),
        limits=_stuck_limits,
        instants=(0, 1),
        starts=_stuck_starts,
        transform=_stuck_transform,
        input_port=False,
        amplitude=None,
        lookalikes=("valve_stiction", "quantisation", "sensor_clip"),
        scan=_stuck_scan,
        separate_by="a small dither, or a second sensor",
        source="Isermann 2006, Fault-Diagnosis Systems, sec. 2.5",
        narx_terms="none: leave these samples out",
    ),
)

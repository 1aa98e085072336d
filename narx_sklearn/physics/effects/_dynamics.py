"""Linear dynamics that were left out: delay, lag, a mode."""

import numpy as np
from scipy.linalg import expm

from narx_sklearn.physics.effects._effect import LACKING, Effect, EffectParameter, PutOut, Setting
from narx_sklearn.physics.effects._kernel import kernel
from narx_sklearn.physics.effects._series import by_pieces, time_since
from narx_sklearn.physics.effects._starts import (
    grid,
    lines_in_time,
    record_length,
    scaled,
    spread,
    time_scale,
)

BAND = np.geomspace(0.3, 6.0, 17)  # frequencies of modes that may have been left out, of the signal's own
SMALL = 1e-2  # share of a lag's time that a step takes, below which its moments are summed as series
SHORT = 1e-12  # of a step: a lag of less is none
LIGHT = 0.1  # damping ratio from which modes are tried: half as wide as BAND is spaced


def _delay_transform(signal, second, dt, theta, first):
    """Interpolate between samples."""
    return _shifted(signal, theta[0] / dt, theta[1], first)


def _shifted(signal, late, lacking, first):
    """Return a signal some samples late; before its first value a piece was at that, less a share of it.

    Counted in samples: in seconds rounding would choose whether one at the very beginning lies before it.
    """
    age = time_since(first, signal.size, 1.0)
    began = np.flatnonzero(age == 0)
    out = np.array(signal, dtype=float)
    for a, b in zip(began, [*began[1:], signal.size], strict=True):
        good = a + np.flatnonzero(np.isfinite(signal[a:b]))
        if good.size:
            before = signal[good[0]] * (1.0 - lacking)
            out[good] = np.interp(age[good] - late, age[good], signal[good], left=before)
    return out


def _delay_curved(signal, middle, end, dt, theta, first):
    """Interpolate by the parabola of the step that came so much earlier."""
    time = time_since(first, signal.size, dt)
    began = np.flatnonzero(time == 0)
    out = np.column_stack([signal, middle, end])
    for a, b in zip(began, [*began[1:], signal.size], strict=True):
        good = a + np.flatnonzero(np.isfinite(out[a:b]).all(axis=1))
        if not good.size:
            continue
        step, at = out[good], time[good]
        for j in range(3):
            then = at + 0.5 * j * dt - theta[0]
            k = np.searchsorted(at, then, side="left" if j == 2 else "right") - 1  # an end is before a jump
            late = _parabola(np.minimum((then - at[k]) / dt, 1.0), *step[k].T)
            out[good, j] = np.where(k >= 0, late, step[0, 0] * (1.0 - theta[1]))
    return out.T


def _parabola(share, begin, middle, end):
    """Return the value a share of the step after its beginning of the parabola through three values."""
    return begin + share * ((4 * middle - 3 * begin - end) + share * 2 * (begin - 2 * middle + end))


def _delay_held(signal, dt, theta, first):
    """Hold what came last until a fraction f of the step has passed."""
    f, whole = np.modf(theta[0] / dt)
    last, one_before = (_shifted(signal, late, theta[1], first) for late in (whole, whole + 1.0))
    return last + f * (one_before - last), 6.0 * f * (1.0 - f) * (last - one_before)


@kernel
def _lag_put_out(argument, rate, own, second, time, step, z, theta, dz):
    """z holds what is passed."""
    late = max(theta[0], step)
    dz[0] = (argument - z[0]) / late
    return theta[0] / late * (z[0] - argument)


def times_of_lag(setting: Setting, shares) -> np.ndarray:
    """Return shares of the signal's time scale, from half a sample to a fifth of the record."""
    longest = record_length(setting) / 5
    if spread(setting.argument) == 0 or longest < setting.dt:
        return np.empty(0)
    times = np.array(shares) * time_scale(setting)
    return np.unique(np.clip(times, 0.5 * setting.dt, longest))


def _delay_starts(setting: Setting) -> np.ndarray:
    return grid(times_of_lag(setting, (0.05, 0.15, 0.5)), [0.0])  # from rest


@kernel
def _average_run(values, decay, lacking, late):
    """Return the exponential average of samples, up to each of them; it lacks a share of the first at first.

    One sample ``late`` it is where a lag of held values stands at each sample.
    """
    out = np.empty(values.size)
    out[0] = values[0] * (1.0 - lacking)
    for k in range(1, values.size):
        out[k] = decay * out[k - 1] + (1.0 - decay) * values[k - late]
    return out


@kernel
def weights_along_line(ratio):
    """Return the weights of what a lag was at, and of its signal where a step begins and where it ends.

    Their sum is where the lag is then, if the signal is straight in the step, which takes a ``ratio`` of the
    lag's time.
    """
    decay = np.exp(-ratio)
    new = 1.0 + np.expm1(-ratio) / ratio
    return decay, 1.0 - decay - new, new


@kernel
def _following_run(curve, half, full, lacking):
    """Return the first state of a linear system along a curve: at each step's beginning, middle and end.

    Both (n_samples, 3). Half a step on, and a whole one, the states are (n_states, n_states + 3) times the
    states and these values of the curve. The system begins at rest on the first value, but for a share of it
    that is ``lacking``.
    """
    n = half.shape[0]
    out = np.empty(curve.shape)
    now, moved = np.zeros(n + 3), np.empty(n)
    now[0] = curve[0, 0] * (1.0 - lacking)
    for k in range(len(curve)):
        now[n:] = curve[k]
        out[k, 0] = now[0]
        out[k, 1] = _row_times(half, 0, now)
        for i in range(n):
            moved[i] = _row_times(full, i, now)
        now[:n] = moved
        out[k, 2] = now[0]
    return out


@kernel
def _row_times(matrix, row, vector):
    total = 0.0
    for j in range(vector.size):
        total += matrix[row, j] * vector[j]
    return total


def _along_parabolas(A, b, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return what takes x' = A x + b s half a step and a whole step on, where s is a parabola in the step.

    Each (n_states, n_states + 3): of the states, and of s at the beginning, in the middle and at the end.
    """
    n = len(b)
    M = np.zeros((n + 3, n + 3))
    M[:n, :n], M[:n, n] = A * dt, b * dt
    M[n, n + 1] = M[n + 1, n + 2] = 1.0  # s, and its first and second derivative by the share of the step
    half = expm(0.5 * M)
    of_values = np.eye(n + 3)
    of_values[n:, n:] = [[1, 0, 0], [-3, 4, -1], [4, -8, 4]]
    whole = half @ half
    return np.ascontiguousarray((half @ of_values)[:n]), np.ascontiguousarray((whole @ of_values)[:n])


def _following(signal, middle, end, first, A, b, dt, lacking):
    """Return (signal, middle, end) of a system's first state."""
    steps = (*_along_parabolas(A, b, dt), lacking)
    return by_pieces(_following_run, np.column_stack([signal, middle, end]), first, *steps).T


def _from_sample_to_sample(curved, signal, dt, theta, first):
    """Return what an effect makes of a signal that is straight from sample to sample."""

    def run(values):
        end = np.append(values[1:], values[-1])
        return curved(values, 0.5 * (values + end), end, dt, theta, [0])[0]

    return by_pieces(run, signal, first)


def _digital_lag(signal, dt, theta, first):
    decay = np.exp(-dt / max(theta[0], SHORT * dt))
    return by_pieces(_average_run, signal, first, decay, theta[1], 0)


def _lag_curved(signal, middle, end, dt, theta, first):
    """Follow a curve; the share that samples do stays from each sample to the next."""
    pace = 1.0 / max(theta[0], SHORT * dt)
    analog = _following(signal, middle, end, first, np.array([[-pace]]), np.array([pace]), dt, theta[1])
    return analog + theta[2] * (_digital_lag(signal, dt, theta, first) - analog)


def _lag_transform(signal, second, dt, theta, first):
    return _from_sample_to_sample(_lag_curved, signal, dt, theta, first)


def _lag_held(signal, dt, theta, first):
    mean, rise = _analog_lag_held(signal, dt, theta, first)
    return mean + theta[2] * (_digital_lag(signal, dt, theta, first) - mean), rise * (1.0 - theta[2])


def _analog_lag_held(signal, dt, theta, first):
    """Follow each value of a held signal exponentially."""
    ratio = dt / max(theta[0], SHORT * dt)
    behind = by_pieces(_average_run, signal, first, np.exp(-ratio), theta[1], 1) - signal
    mean, moment = moments_of_decay(ratio)
    return signal + mean * behind, 12.0 * moment * behind


def moments_of_decay(ratio: float) -> tuple[float, float]:
    """Return the mean of exp(-ratio x) for x from 0 to 1, and its first moment about the middle."""
    mean = -np.expm1(-ratio) / ratio
    series = ratio * (-1 / 12 + ratio * (1 / 24 - ratio / 80))  # where the difference would cancel
    return mean, series if ratio < SMALL else (mean - np.exp(-ratio)) / ratio - 0.5 * mean


def _lag_starts(setting: Setting) -> np.ndarray:
    return grid(times_of_lag(setting, (0.05, 0.2, 1.0, 5.0)), [0.0], [0.0])  # from rest, by a filter


@kernel
def _extra_mode(argument, rate, own, second, time, step, z, theta, dz):
    """z holds how far the mode is ahead of the argument, and its own speed; or a mode that an input feeds."""
    w = min(theta[1], 1.0 / step)  # no faster than a step can follow
    damping = min(2.0 * theta[2] * w, 1.0 / step)
    if np.isnan(second):
        dz[0] = z[1] - rate
        dz[1] = -damping * z[1] - w * w * z[0]
    else:
        dz[0] = z[1]
        dz[1] = -damping * z[1] + w * w * (second - z[0])
    return theta[0] * z[0]


def _extra_mode_curved(signal, middle, end, dt, theta, first):
    w, zeta = min(theta[1], np.pi / dt), theta[2]  # what is faster than the sampling cannot be told from it
    A, b = np.array([[0.0, 1.0], [-w * w, -2 * zeta * w]]), np.array([0.0, w * w])
    swung = _following(signal, middle, end, first, A, b, dt, 0.0)
    return [given + theta[0] * (own - given) for given, own in zip((signal, middle, end), swung, strict=True)]


def _extra_mode_transform(signal, second, dt, theta, first):
    return _from_sample_to_sample(_extra_mode_curved, signal, dt, theta, first)


def _extra_mode_starts(setting: Setting) -> np.ndarray:
    """Light damping all over the signal's band and at the residual's strongest lines; and a slow pole."""
    scale = time_scale(setting)
    if scale == 0:
        return np.empty((0, 3))
    w = np.concatenate([BAND / scale, lines_in_time(setting, 2)])
    w = w[w < 0.8 * np.pi / setting.dt]
    rows = np.concatenate([grid([1.0], w, [LIGHT]), [[1.0, 0.3 / scale, 2.0]]])
    fed = setting.second is not None
    signal = setting.second if fed else setting.argument

    def added(row: np.ndarray) -> np.ndarray:
        swung = _extra_mode_transform(signal, None, setting.dt, row, setting.first)
        return swung if fed else swung - signal

    return scaled(setting, rows, added)


DYNAMICS = (
    Effect(
        code="delay",
        title="Delay",
        sentence="Everything comes a fixed time late, as it also does where a column was shifted.",
        equation="s(t - T); before the record a share i of the first command was lacking (below 0: it was "
        "more)",
        parameters=(EffectParameter("T", "s", 0.0), LACKING),
        begin=1,
        starts=_delay_starts,
        transform=_delay_transform,
        held=_delay_held,
        curved=_delay_curved,
        put_out=PutOut(late=0),
        amplitude=None,
        lookalikes=("lag", "backlash", "rate_limit"),
        separate_by="a wideband signal: the phase falls in proportion to frequency",
        source="Ljung 1999, System Identification, sec. 4.2",
        narx_terms="longer lags of u",
    ),
    Effect(
        code="lag",
        title="Lag",
        sentence="The signal arrives smoothed, as through a filter.",
        equation="T s_out' = s - s_out where d = 0, from sample to sample alone, "
        "s_out[k] = s[k] + (s_out[k-1] - s[k]) exp(-dt/T), where d = 1, and between them a share d of the "
        "latter; at first a share i of the command is lacking (below 0: it is more)",
        parameters=(EffectParameter("T", "s", 0.0), LACKING, EffectParameter("d", "-", 0.0, 1.0)),
        begin=1,
        form=2,
        starts=_lag_starts,
        transform=_lag_transform,
        held=_lag_held,
        curved=_lag_curved,
        put_out=PutOut(_lag_put_out, n_memory=1),
        amplitude=None,
        lookalikes=("delay", "rate_limit", "extra_mode", "creep"),
        separate_by="a wideband signal: the gain rolls off",
        source="Ljung 1999, System Identification, sec. 4.2",
        narx_terms="longer lags of u and y",
    ),
    Effect(
        code="extra_mode",
        title="Linear dynamics left out",
        sentence="Something attached swings along, or follows slowly.",
        equation="g (M[s] - s), added, or g M[u] in the equation that u drives; M'' = w^2 (s - M) - "
        "2 zeta w M'",
        parameters=(
            EffectParameter("g", "{port}/({arg})"),
            EffectParameter("w", "rad/s", 0.0),
            EffectParameter("zeta", "-", 0.0, 20.0),
        ),
        starts=_extra_mode_starts,
        force=_extra_mode,
        transform=_extra_mode_transform,
        curved=_extra_mode_curved,
        input_port=False,
        argument="position",
        second="feed",
        n_memory=2,
        lookalikes=("lag", "creep", "periodic_disturbance"),
        holds=("lag", "viscous_damping", "linear_stiffness", "constant_load", "sensor_bias"),
        separate_by="repeated periods: its response repeats, and is free of distortion",
        source="Pintelon and Schoukens 2012, System Identification: A Frequency Domain Approach, sec. 3.2",
        narx_terms="longer lags of u and y",
    ),
)

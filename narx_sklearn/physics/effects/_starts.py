"""Starting values from what a record shows: sizes, thresholds, time scales, frequencies."""

from collections.abc import Callable, Iterable
from itertools import pairwise, product

import numpy as np

from narx_sklearn.physics.effects._effect import Setting

ORDINARY = 0.1  # an effect of ordinary size changes what it acts on by a tenth of its spread
FLAT = 1e-6  # relative spread below which a signal counts as constant
NEAR_ZERO = 0.01  # of the spread: stands for zero, since difference steps are shares of the value
ELSEWHERE = 0.2  # of the spread: a mean nearer to zero than this is found by a fit that begins at zero
TELLING = 1e-5  # of the spread, above rounding: the least that a change differs by from an offset and a gain
DRY = 0.1  # share of the time that a level may stand below an outlet; what is above it longer is a rim
ANGLE_BINS = 4096  # in the range of an angle: a hundred waves a turn still have forty bins each


def grid(*columns: Iterable[float]) -> np.ndarray:
    """Return all combinations of the columns' values, shape (n_rows, n_columns)."""
    return np.array(list(product(*columns)), dtype=float).reshape(-1, len(columns))


def spread(values: np.ndarray) -> float:
    """Return the standard deviation of the finite values; 0 when they are constant but for rounding."""
    values = values[np.isfinite(values)]
    if values.size == 0:
        return 0.0
    deviation = float(np.std(values))
    return deviation if deviation > FLAT * np.max(np.abs(values)) else 0.0


def working_points(values: np.ndarray) -> np.ndarray:
    """Return levels about which a law may act on a signal that varies: zero, and the mean if elsewhere.

    The last one is where the signal works.
    """
    size, mean = spread(values), float(np.mean(values[np.isfinite(values)]))
    return np.array([NEAR_ZERO * size, mean] if abs(mean) > ELSEWHERE * size else [NEAR_ZERO * size])


def quantiles(values: np.ndarray, shares) -> np.ndarray:
    """Return quantiles of the finite values."""
    values = values[np.isfinite(values)]
    return np.quantile(values, shares) if values.size else np.full(np.size(shares), np.nan)


def at_signal(setting: Setting) -> bool:
    """Tell whether the setting is of an input or output, where the signal itself is acted upon."""
    return setting.own is setting.argument or np.array_equal(setting.own, setting.argument, equal_nan=True)


def reverses(values: np.ndarray) -> bool:
    """Tell whether a signal goes to both sides of zero, the lesser by a hundredth of the greater at least."""
    low, high = quantiles(values, [0.0, 1.0])
    return low < 0 < high and min(-low, high) > 0.01 * max(-low, high)


def record_length(setting: Setting) -> float:
    """Return the length of the longest session, s."""
    edges = np.concatenate([[0], setting.first, [setting.argument.size]])
    return float(np.max(np.diff(np.unique(edges)), initial=0) * setting.dt)


def time_looked_at(setting: Setting) -> float:
    """Return the time from the first sample to the last, gaps included, of the session that is longest, s."""
    return float(np.ptp(setting.time)) + setting.dt


def time_scale(setting: Setting) -> float:
    """Return the time in which the argument changes by about its spread, s: 1/w for a sine of frequency w."""
    fast = spread(setting.rate)
    return spread(setting.argument) / fast if fast > 0 else 0.0


def time_constants(setting: Setting, n: int) -> np.ndarray:
    """Return ``n`` times between two samples and a fifth of the record, geometric; none in a short record."""
    longest = record_length(setting) / 5
    return np.geomspace(2 * setting.dt, longest, n) if longest > 4 * setting.dt else np.empty(0)


def scaled(setting: Setting, rows: np.ndarray, shape: Callable, amplitude: int = 0) -> np.ndarray:
    """Give each row the amplitude that makes the effect of ordinary size; leave out those that tell nothing.

    ``shape(row)`` is what the effect adds along the record at amplitude 1, shape (n_samples,).
    """
    wanted = ORDINARY * spread(setting.own)
    kept = []
    for row in rows:
        row = row.copy()
        row[amplitude] = 1.0
        with np.errstate(all="ignore"):
            added = shape(row)
            size = np.sqrt(np.nanmean(added**2)) if spread(added) > 0 else 0.0  # a constant tells nothing
        if size > 0 and wanted > 0:
            row[amplitude] = wanted / size
            kept.append(row)
    return np.array(kept).reshape(-1, rows.shape[1])


def in_proportion_to_second(setting: Setting) -> np.ndarray:
    """Return the start of an effect b (w - r) of the second argument, counted from where that works."""
    if setting.second is None or spread(setting.second) == 0:
        return np.empty((0, 2))
    rows = grid([1.0], working_points(setting.second)[-1:])
    return scaled(setting, rows, lambda row: setting.second - row[1])


def telling(setting: Setting, rows: np.ndarray, transform: Callable) -> np.ndarray:
    """Return the rows whose transform differs from a mere offset and gain of the signal on this record."""
    good = np.isfinite(setting.argument)
    signal = setting.argument[good] - np.mean(setting.argument[good]) if good.any() else np.empty(0)
    energy = signal @ signal
    kept = []
    for row in rows:
        changed = transform(setting.argument, setting.second, setting.dt, row, setting.first)[good]
        changed = changed - changed.mean() if changed.size else changed
        if energy > 0:
            left = changed - signal * (signal @ changed / energy)
            if np.sqrt(left @ left) > TELLING * np.sqrt(energy):
                kept.append(row)
    return np.array(kept).reshape(-1, rows.shape[1])


def _residual(setting: Setting) -> np.ndarray | None:
    """Return what shows lines best: beside noise with a memory a faint one is no peak."""
    return setting.residual if setting.innovations is None else setting.innovations


def lines_in_time(setting: Setting, n: int) -> np.ndarray:
    """Return the ``n`` strongest frequencies of the residual, rad/s, strongest first; none without one.

    The sessions' periodograms are added. Lines of fewer than three periods in a record are drift, not lines.
    """
    residual = _residual(setting)
    if residual is None:
        return np.empty(0)
    edges = np.unique(np.concatenate([[0], setting.first, [residual.size]]))
    size = 2 * int(np.max(np.diff(edges), initial=1))  # zero padding: half a bin is the worst miss
    power = np.zeros(size // 2 + 1)
    for a, b in pairwise(edges):
        piece = residual[a:b]
        good = np.isfinite(piece)
        if not good.any():
            continue
        piece = np.where(good, piece - np.mean(piece[good]), 0.0)
        power += np.abs(np.fft.rfft(piece * np.hanning(b - a), size)) ** 2
    w = 2 * np.pi * np.arange(power.size) / (size * setting.dt)
    power[w < 3 * 2 * np.pi / (size / 2 * setting.dt)] = 0.0
    return _peaks(w, power, n)


def lines_in_angle(setting: Setting, waves: np.ndarray, n: int) -> np.ndarray:
    """Return the ``n`` wave numbers that the residual shows best along the argument; none without one.

    The residual is averaged in narrow bins of the angle first; over more than a turn of what turns they are
    laid on each other, for which the wave numbers must be whole.
    """
    residual = _residual(setting)
    if residual is None or waves.size == 0:
        return np.empty(0)
    good = np.isfinite(setting.argument) & np.isfinite(residual)
    if not good.any():
        return np.empty(0)
    angle, value = setting.argument[good], residual[good]
    angle = angle - angle.min()
    reach = min(angle.max(), 2 * np.pi) if setting.turns else angle.max()
    index = (angle % reach if angle.max() > reach else angle) / max(reach, 1e-300) * (ANGLE_BINS - 1)
    total = np.bincount(np.round(index).astype(np.int64), value - value.mean(), ANGLE_BINS)
    centre = np.arange(ANGLE_BINS) * reach / (ANGLE_BINS - 1)
    return _peaks(waves, np.abs(np.exp(-1j * np.outer(waves, centre)) @ total) ** 2, n)


def _peaks(place: np.ndarray, power: np.ndarray, n: int) -> np.ndarray:
    """Return the places of the ``n`` highest local maxima, highest first."""
    padded = np.concatenate([[-1.0], power, [-1.0]])
    top = np.flatnonzero((padded[1:-1] > padded[:-2]) & (padded[1:-1] >= padded[2:]) & (power > 0))
    return place[top[np.argsort(-power[top], kind="stable")][:n]]

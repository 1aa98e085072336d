"""The colour of what is left over: a small time-series model of each output's residual."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.linalg import LinAlgError, solve_toeplitz, toeplitz
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

LONGEST = 6  # lags of an autoregression
SLOWEST = 0.999  # largest moving-average coefficient: memory of a thousand samples
FORGOTTEN = 1e-6  # of its level a drift loses at least, twice a sample: else a window might begin anywhere
GRID = 13  # values of it that are tried, evenly in the logarithm of its pace
FINE = 1e-3  # to which that logarithm is then found


class Noise(NamedTuple):
    """Noise of each output: autoregression, moving average, and standard deviation of the innovations.

    .. math:: e_k = r_k - \\sum_i a_i r_{k-i} + b\\, e_{k-1}

    The moving average is there for drift: a random walk under white noise is a unit root with b near 1,
    which no short autoregression can follow.
    """

    coefficients: tuple[np.ndarray, ...]  # a, one array an output
    sigma: np.ndarray  # (n_outputs,)
    average: tuple[float, ...] = ()  # b, one an output; none where empty

    @classmethod
    def white(cls, sigma: np.ndarray) -> "Noise":
        """Return white noise."""
        return cls(tuple(np.zeros(0) for _ in sigma), np.asarray(sigma, dtype=float))

    @classmethod
    def as_large_as(cls, signals: np.ndarray) -> "Noise":
        """Return white noise as large as signals (n_samples, n_outputs) spread, 1 where one is constant.

        Under it each output counts for as much, in whatever unit; NaN is skipped, and of what was not
        measured at all the noise is 1.
        """
        known = (signal[np.isfinite(signal)] for signal in signals.T)
        spread = np.array([np.std(values) if values.size else 0.0 for values in known])
        return cls.white(np.where(spread > 0, spread, 1.0))

    @property
    def order(self) -> int:
        """Longest memory of the autoregression, samples."""
        return max(a.size for a in self.coefficients)

    @property
    def n_parameters(self) -> int:
        """Number of coefficients, the variances not counted."""
        return sum(a.size for a in self.coefficients) + sum(b != 0 for b in self.average)

    def colour(self, output: int) -> tuple[np.ndarray, float]:
        """Return the autoregression of an output and its moving average."""
        return self.coefficients[output], self.average[output] if self.average else 0.0

    def drifts(self, output: int) -> bool:
        """Tell whether the noise of an output wanders off."""
        return self.colour(output)[1] != 0.0

    def with_colour(self, output: int, a: np.ndarray, b: float) -> "Noise":
        """Return this noise with another colour on one output."""
        coefficients, average = list(self.coefficients), list(self.average or (0.0,) * len(self.coefficients))
        coefficients[output], average[output] = a, b
        return self._replace(coefficients=tuple(coefficients), average=tuple(average))

    def starting(self, output: int) -> np.ndarray | None:
        """Return the root of the covariance of the first samples of a window, (order, order).

        In units of the innovations. None where an autoregression has none, for want of memory or of a level.
        """
        a, b = self.colour(output)
        if not a.size:
            return None
        return np.sqrt([[_variance(a[0], b)]]) if b else _root_of_covariance(tuple(a.tolist()))

    def deviation(self, output: int) -> float:
        """Return the standard deviation of an output's noise, infinite where it drifts."""
        a, _ = self.colour(output)
        root = self.starting(output)
        if a.size and (root is None or a[0] >= 1.0):
            return np.inf
        return float(self.sigma[output] * (1.0 if root is None else np.linalg.norm(root[0])))

    def gone_after(self, samples: np.ndarray, output: int) -> np.ndarray:
        """Return how far the drift of an output goes in some samples, its variance over the innovations'."""
        a, b = self.coefficients[output][0], self.average[output]
        steps = samples if a == 1.0 else (1.0 - a ** (2.0 * samples)) / (1.0 - a * a)
        return (a - b) ** 2 * steps

    def innovations(self, windowed: np.ndarray, counts: np.ndarray | None = None) -> np.ndarray:
        """Return the scaled innovations of a signal in windows, (W, L, n_outputs); zero where unknown.

        The first samples of a window have the covariance of the noise as it lasts, so that none is free.

        Parameters
        ----------
        windowed : ndarray of shape (n_windows, n_samples, n_outputs)
        counts : ndarray of bool, same shape, optional
            Where an innovation counts; all by default.
        """
        windowed = np.ascontiguousarray(windowed, dtype=float)
        out = np.empty(windowed.shape)
        for output, a in enumerate(self.coefficients):
            root = self.starting(output)
            _autoregressed(
                windowed, output, a, self.sigma[output], np.empty((0, 0)) if root is None else root, out
            )
            _, b = self.colour(output)
            if b:
                inside = np.ones(out.shape[:2], dtype=bool) if counts is None else counts[:, :, output]
                left = out[:, :, output].copy()
                left[:, 0] = windowed[:, 0, output] / self.sigma[output]
                out[:, 1:, output] = _averaged(left, inside, a[0], b)[0][:, 1:]
        return out

    def innovations_from_zero(
        self, signals: np.ndarray, seen: np.ndarray, output: int, before: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """Return innovations of one output, not scaled, where they count, and their log determinant.

        What drifts begins at zero, so many samples before the first; what does not drift has its whole
        covariance from the first on.

        Parameters
        ----------
        signals : ndarray of shape (n_stretches, n_samples, n_signals)
            Zero where not seen.
        seen : ndarray of bool of shape (n_stretches, n_samples)
        before : ndarray of shape (n_stretches,), optional
            Samples that passed since the drift began; none by default.
        """
        a, b = self.colour(output)
        root = None if b else self.starting(output)
        counts, log_determinant, first = remembered(seen, a.size), 0.0, np.empty((0, 0))
        if a.size and root is not None:
            first = np.linalg.inv(root)
            log_determinant = 2 * len(seen) * float(np.log(np.diag(root)).sum())
        e = np.empty(signals.shape)
        _innovated(signals, counts, a, b, first, e)
        if b and before is not None and before.any():
            level = np.where(seen, a[0] ** np.arange(seen.shape[1]), 0.0)
            trace = np.empty((*level.shape, 1))
            _innovated(level[:, :, None], counts, a, b, first, trace)
            trace = np.where(counts, trace[:, :, 0], 0.0)
            e, log_determinant = _from_a_level(e, trace, self.gone_after(before, output))
        return e, counts, log_determinant


def remembered(seen: np.ndarray, order: int) -> np.ndarray:
    """Tell which samples (n_windows, n_samples) are seen with all in their window up to so many before."""
    whole = seen.copy()
    for lag in range(1, order + 1):
        whole[:, lag:] &= seen[:, :-lag]
    return whole


@njit(cache=True, nogil=True)
def _autoregressed(windowed, output, a, sigma, root, out):
    """Write the scaled innovations of an autoregression of one output.

    The first samples of a window go by the root of their covariance; they are zero where it has none.
    """
    n_windows, n_samples = windowed.shape[:2]
    first = min(a.size, n_samples)
    for w in range(n_windows):
        for k in range(first):
            value = windowed[w, k, output] / sigma
            for i in range(min(k, root.shape[0])):
                value -= root[k, i] * out[w, i, output]
            out[w, k, output] = value / root[k, k] if root.size else 0.0
        for k in range(first, n_samples):
            value = windowed[w, k, output]
            for i in range(a.size):
                value -= a[i] * windowed[w, k - 1 - i, output]
            out[w, k, output] = value / sigma


@njit(cache=True, nogil=True)
def _innovated(signals, counts, a, b, first, out):
    """Write the innovations of signals (n_stretches, n_samples, n_signals) that were zero before.

    The matrix ``first`` takes the first samples of a stretch to theirs, where their whole covariance counts.
    """
    n_stretches, n_samples, n_signals = signals.shape
    for s in range(n_stretches):
        for k in range(n_samples):
            row = out[s, k]
            row[:] = 0.0
            if k < first.shape[0]:
                for i in range(min(first.shape[0], n_samples)):
                    for c in range(n_signals):
                        row[c] += first[k, i] * signals[s, i, c]
            elif b == 0.0 or counts[s, k]:
                for c in range(n_signals):
                    row[c] = signals[s, k, c]
                for i in range(min(a.size, k)):
                    for c in range(n_signals):
                        row[c] -= a[i] * signals[s, k - 1 - i, c]
            if b != 0.0 and k > 0:
                for c in range(n_signals):
                    row[c] += b * out[s, k - 1, c]


def _from_a_level(e: np.ndarray, trace: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, float]:
    """Return innovations of a drift that had gone somewhere before, and the log determinant of that.

    The ``trace`` is what a unit of the level leaves behind; along it alone innovations are larger.
    """
    length = np.einsum("st,st->s", trace, trace)
    larger = 1.0 + variance * length
    less = (1.0 - 1.0 / np.sqrt(larger)) / np.where(length > 0, length, 1.0)
    along = less[:, None] * np.einsum("st,stk->sk", trace, e)
    return e - trace[:, :, None] * along[:, None], float(np.log(larger).sum())


@lru_cache(maxsize=64)
def _root_of_covariance(a: tuple[float, ...]) -> np.ndarray | None:
    """Return the Cholesky root of the covariance of as many samples of an autoregression as it has lags."""
    order = len(a)
    equations = np.eye(order + 1)
    for i in range(order + 1):
        for lag, coefficient in enumerate(a, start=1):
            equations[i, abs(i - lag)] -= coefficient
    try:
        covariance = np.linalg.solve(equations, np.eye(order + 1)[0])
        return np.linalg.cholesky(toeplitz(covariance[:order]))
    except np.linalg.LinAlgError:  # a unit root: it lasts nowhere
        return None


def _variance(a: float, b: float) -> float:
    """Return the variance of noise with a moving average, over that of its innovations."""
    return 1.0 + (a - b) ** 2 / max(1.0 - a * a, FORGOTTEN)


def _averaged(left: np.ndarray, counts: np.ndarray, a: float, b: float) -> tuple[np.ndarray, float]:
    """Return the innovations in windows beside a moving average, whitened, and their log determinant.

    Of the innovation at the first sample that sample tells the mean and the variance, and what it leaves
    behind, b to the power of k, goes by them. The first samples themselves do not count.

    Parameters
    ----------
    left : ndarray of shape (n_windows, n_samples)
        What the autoregression leaves; of the first sample, which has none before it, the sample itself.
    counts : ndarray of bool, same shape
        Where an innovation counts: those of samples that are seen, as is the one before.
    """
    level = _variance(a, b)
    counts = counts.copy()
    counts[:, 0] = False
    inputs = np.where(counts, left, 0.0)
    inputs[:, 0] = left[:, 0] / level
    e = np.where(counts, lfilter([1.0], [1.0, -b], inputs, axis=1), 0.0)
    trace = np.where(counts, b ** np.arange(left.shape[1]), 0.0)
    e, log_determinant = _from_a_level(e[:, :, None], trace, np.full(len(e), 1.0 - 1.0 / level))
    return e[:, :, 0], log_determinant


def estimate_noise(
    residual: np.ndarray,
    seen: np.ndarray,
    *,
    may_drift: bool = True,
    price: float | None = None,
) -> Noise:
    """Fit a noise model to residuals in windows: autoregressions and one with a moving average.

    Parameters
    ----------
    residual : ndarray of shape (n_windows, n_samples, n_outputs)
        Zero where not seen.
    seen : ndarray of bool, same shape
    may_drift : bool, default=True
        Whether a moving average is tried; without one the noise stays about a level.
    price : float, optional
        Of a coefficient, in units of the deviance; by default that of BIC.
    """
    found = list(_best(residual, seen, may_drift, price))
    sigma = np.sqrt([max(variance, 1e-300) for _, _, _, variance in found])
    return Noise(tuple(a for _, a, _, _ in found), sigma, tuple(b for _, _, b, _ in found))


def _best(residual, seen, may_drift: bool, price: float | None):
    """Yield (criterion, a, b, variance) of the best noise model of each output."""
    for output in range(residual.shape[2]):
        r, known = residual[:, :, output], seen[:, :, output]
        each = np.log(max(known.sum(), 2)) if price is None else price
        models = [_autoregression(r, known, each)]
        if may_drift:
            models.append(_with_moving_average(r, known, each))
        yield min(models, key=lambda found: found[0])


def _autoregression(r: np.ndarray, known: np.ndarray, price: float):
    """Return (criterion, a, b = 0, variance) of the best autoregression, by the Yule-Walker equations.

    All orders, none too, are compared by the likelihood given the first sample of each window.
    """
    n = int(known.sum())
    lags = range(min(LONGEST, r.shape[1] - 1) + 1)
    c = np.array([np.sum(r[:, lag:] * r[:, : r.shape[1] - lag]) for lag in lags])
    counts = np.array([np.sum(known[:, lag:] & known[:, : r.shape[1] - lag]) for lag in lags])
    c = c / np.maximum(counts, 1) * (1 - np.arange(c.size) / max(n, 2))
    later = known[:, 1:]
    white = float(np.sum(r[:, 1:][later] ** 2) / later.sum()) if later.any() else float(c[0])
    n_compared = int(later.sum())
    best = (n_compared * np.log(max(white, 1e-300)), np.zeros(0), 0.0, c[0])
    for order in range(1, c.size):
        try:
            a = solve_toeplitz(c[:order], c[1 : order + 1])
        except LinAlgError:
            break
        root = _root_of_covariance(tuple(a.tolist()))
        if root is None:
            break
        variance, log_determinant = _left_by(a, root, r, known)
        if not variance > 1e-12 * c[0]:
            break
        criterion = n_compared * np.log(variance) + log_determinant + order * price
        if criterion < best[0]:
            best = (criterion, a, 0.0, variance)
    return best


def _left_by(a: np.ndarray, root: np.ndarray, r: np.ndarray, known: np.ndarray) -> tuple[float, float]:
    """Return the mean square of the innovations that an autoregression leaves, and their log determinant.

    The first sample of each window does not count, nor does what has none before it that is seen.
    """
    e = np.empty((*r.shape, 1))
    _autoregressed(r[:, :, None], 0, a, 1.0, root, e)
    counts = remembered(known, a.size)
    whole = counts[:, a.size - 1].copy()  # windows of which all the first samples are seen
    counts[~whole, : a.size] = False
    counts[:, 0] = False
    if not counts[:, a.size :].any():
        return 0.0, 0.0
    log_determinant = 2.0 * whole.sum() * float(np.log(np.diag(root)[1:]).sum())
    return float(np.sum(e[:, :, 0][counts] ** 2) / counts.sum()), log_determinant


def _with_moving_average(r: np.ndarray, known: np.ndarray, price: float):
    """Return (criterion, (a,), b, variance) of e_k = r_k - a r_{k-1} + b e_{k-1}.

    Fitted by the likelihood given the first sample of each window, a by least squares for each b (variable
    projection, Golub and Pereyra 1973). b is at most a: a drift adds slow noise. What lacks slow power has
    been fitted, and is no noise.
    """
    counts = remembered(known, 1)
    counts[:, 0] = False
    n, n_compared = int(counts.sum()), int(known[:, 1:].sum())  # the latter as for an autoregression
    if n < 50 or not np.any(r):
        return np.inf, np.zeros(1), 0.0, 1.0
    before = np.roll(r, 1, axis=1)
    before[:, 0] = 0.0
    late = np.where(counts, r, 0.0)

    def given(b: float) -> tuple[float, float, float]:
        """Return the deviance, and the a and the mean square of the innovations that go with it."""
        early, there = (_averaged(part, counts, 1.0, b)[0] for part in (before, late))
        power = float(np.sum(early**2))
        a = float(np.clip(np.sum(there * early) / power, b, 1.0)) if power > 0 else 1.0
        left = r - a * before
        e, log_determinant = _averaged(left, counts, a, b)
        variance = max(float(np.sum(e**2)) / n, 1e-300)
        return n_compared * np.log(variance) + log_determinant, a, variance

    def deviance(log_pace: float) -> float:
        return given(1.0 - np.exp(log_pace))[0]

    grid = np.linspace(np.log(1.0 - SLOWEST), 0.0, GRID)
    at = int(np.argmin([deviance(log_pace) for log_pace in grid]))
    around = grid[max(at - 1, 0)], grid[min(at + 1, GRID - 1)]
    found = minimize_scalar(deviance, bounds=around, method="bounded", options={"xatol": FINE})
    b = float(1.0 - np.exp(min(found.x, grid[at], key=deviance)))
    least, a, variance = given(b)
    return least + 2 * price, np.array([a]), b, variance

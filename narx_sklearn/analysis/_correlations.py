"""Correlation functions of residuals and inputs, and how far from zero they stray by chance."""

import warnings
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.stats import norm

from narx_sklearn.analysis._surrogates import draw_surrogate, fit_noise_model
from narx_sklearn.exceptions import ExcitationWarning

N_CALIBRATION = 10_000  # samples the surrogates use; the null law of the statistic no longer moves beyond
N_WINDOWS = 10  # stretches of a longer record that make up those samples
CONSTANT = 1e-12  # standard deviation, as a share of the largest value, under which a signal is constant
FIRST_LAG = {  # of each kind of test
    "autocorrelation": 1,
    "output-residual": 1,
    "cross-correlation": 0,
    "residual-input": 1,
    "even": 0,
    "odd": 0,
    "spread": 0,
    "output-input": 0,
    "feedback": 1,
}


class Record(NamedTuple):
    """What surrogates leave as it is: centred signals of unit variance, at the usable samples only."""

    u: dict[int, np.ndarray]  # by column of X; a constant input is absent
    u_squared: dict[int, np.ndarray]  # absent where the square is constant, as of a two-level input
    u_cubed: dict[int, np.ndarray]  # less what u itself explains; absent where that is all
    predicted: np.ndarray | None  # y - xi, in units of the residuals' standard deviation
    reach: np.ndarray  # samples before each one in its segment


class Sums(NamedTuple):
    """Lagged sums of one test over its lags."""

    total: np.ndarray  # sum of the products p
    spread: np.ndarray  # its standard deviation when p has mean zero
    norm: float  # makes total a correlation coefficient

    @property
    def farthest(self):
        """Largest |total| / spread over the lags: the statistic of the test."""
        return np.max(np.abs(self.total) / np.where(self.spread > 0.0, self.spread, np.inf))


def standardise(xi, u, y, names, reach):
    """Bring all signals to unit variance; leave out, and name, those that do not vary."""
    scaled, scale = _scaled(xi)
    if scale == 0.0:
        raise ValueError(
            f"residuals are constant ({xi[0]:g}) over the {xi.size} usable samples, but a correlation needs "
            "them to vary. Pass the measured output minus its one-step-ahead prediction."
        )
    inputs, squares, cubes, skipped = {}, {}, {}, []
    for j, name in enumerate(names):
        values, spread = _scaled(u[:, j])
        if spread == 0.0:
            sentence = f"Input {name} is constant ({u[0, j]:g}): nothing about it could be tested."
            warnings.warn(sentence + " Use a record in which it moves.", ExcitationWarning, stacklevel=3)
            skipped.append(sentence)
            continue
        inputs[j] = values
        squared, spread = _scaled(values**2)
        if spread:
            squares[j] = squared
        cubed = values**3 - values * np.mean(values**4)  # the cube less what u itself explains
        cubed, spread = _scaled(cubed)
        if spread > CONSTANT:
            cubes[j] = cubed
        hidden = [effect for effect, seen in (("even", squares), ("odd", cubes)) if j not in seen]
        if hidden:
            skipped.append(
                f"Input {name} takes so few values that {' and '.join(hidden)} nonlinear effects of it "
                "cannot be seen on this record."
            )
    predicted = None if y is None else _centred(y - xi) / scale
    return scaled, Record(inputs, squares, cubes, predicted, reach), tuple(skipped)


def _scaled(values):
    """Return the centred values in units of their standard deviation, and that; 0 if they are constant."""
    centred = _centred(values)
    scale = np.sqrt(np.mean(centred**2))
    if scale <= CONSTANT * np.max(np.abs(values)):
        return np.zeros_like(values), 0.0
    return centred / scale, scale


def _centred(values):
    return values - values.mean()


def correlate(xi, record, max_lag):
    """Compute the sums of every test."""
    sums = {}
    for (name, j), (a, b) in _pairs(xi, record).items():
        total, square = _lagged_sums(a, b, record.reach, max_lag)
        norm_ab = np.sqrt((a @ a) * (b @ b))
        spread = np.sqrt(square)
        if name == "spread":  # an alarm comes from few large products here; they must not divide themselves
            spread = norm_ab * np.sqrt(_count_products(record.reach, max_lag)) / xi.size
        lags = slice(FIRST_LAG[name], None)
        sums[name, j] = Sums(total[lags], spread[lags], norm_ab)
    return sums


def _pairs(xi, record):
    """Return the signals (a, b) of every test, keyed by its name and the column of its input."""
    xi_squared = _centred(xi**2)
    pairs = {("autocorrelation", None): (xi, xi)}
    if record.predicted is not None:
        y_xi = _centred((record.predicted + xi) * xi)
        pairs["output-residual", None] = (xi_squared, y_xi)
    for j, u in record.u.items():
        pairs["cross-correlation", j] = (u, xi)
        pairs["residual-input", j] = (_centred(xi * u), xi)
        if j in record.u_squared:
            u_squared = record.u_squared[j]
            pairs["even", j] = (u_squared, xi)
        if j in record.u_cubed:
            pairs["odd", j] = (record.u_cubed[j], xi)
        if j in record.u_squared:
            pairs["spread", j] = (u_squared, xi_squared)
            if record.predicted is not None:
                pairs["output-input", j] = (u_squared, y_xi)
        pairs["feedback", j] = (xi, u)
    return pairs


@njit(cache=True, nogil=True)
def _lagged_sums(a, b, reach, max_lag):
    """Sum a[k - tau] * b[k], and the squares of these products, over k for tau = 0..max_lag."""
    total = np.zeros(max_lag + 1)
    square = np.zeros(max_lag + 1)
    for k in range(b.size):
        # lags innermost, the longest first: neighbouring sums and samples, so the loop vectorises
        n_lags = min(reach[k], max_lag) + 1
        past = a[k + 1 - n_lags : k + 1]
        total_k = total[max_lag + 1 - n_lags :]
        square_k = square[max_lag + 1 - n_lags :]
        for i in range(n_lags):
            product = past[i] * b[k]
            total_k[i] += product
            square_k[i] += product * product
    return total[::-1], square[::-1]


def _count_products(reach, max_lag):
    """Count the samples that reach back by tau = 0..max_lag."""
    counts = np.bincount(np.minimum(reach, max_lag), minlength=max_lag + 1)
    return counts[::-1].cumsum()[::-1]


def calibrate(xi, record, observed, alpha, n_resamples, rng):
    """Draw the statistic of every test under the null hypothesis, and say with which noise."""
    key = ("autocorrelation", None)
    max_lag = observed[key].total.size
    part = _calibration_part(record, max_lag)

    def draw(noise):
        surrogates = (draw_surrogate(noise, part.reach.size, rng) for _ in range(n_resamples))
        rows = [[s.farthest for s in correlate(xi, part, max_lag).values()] for xi in surrogates]
        return dict(zip(observed, np.sort(rows, axis=0).T, strict=True))

    white = fit_noise_model(xi, record.reach, max_order=0)
    draws = draw(white)
    if p_value_of(observed[key], draws[key], alpha) > alpha:
        return white, draws
    coloured = fit_noise_model(xi, record.reach, max_order=max_lag)
    if coloured.order == 0:
        return white, draws
    return coloured, {**draw(coloured), key: draws[key]}


def _calibration_part(record, max_lag):
    """Return the record itself, or evenly spaced stretches of a long one."""
    n_samples = record.reach.size
    length = max(N_CALIBRATION // N_WINDOWS, 20 * max_lag)
    if n_samples <= N_WINDOWS * length:
        return record
    starts = np.linspace(0, n_samples - length, N_WINDOWS).astype(int)
    within = np.arange(length)
    index = np.add.outer(starts, within).ravel()
    return Record(
        {j: u[index] for j, u in record.u.items()},
        {j: u[index] for j, u in record.u_squared.items()},
        {j: u[index] for j, u in record.u_cubed.items()},
        None if record.predicted is None else record.predicted[index],
        np.minimum(record.reach[index], np.tile(within, N_WINDOWS)),
    )


def p_value_of(sums, draws, alpha):
    """Return the rank of the statistic among the draws, continued as a Gaussian tail beyond them."""
    n_above = draws.size - np.searchsorted(draws, sums.farthest)
    p_value = (1 + n_above) / (draws.size + 1)
    if n_above == 0:
        n_lags = sums.total.size
        gaussian = norm.isf((1.0 - (1.0 - alpha) ** (1.0 / n_lags)) / 2.0)
        scale = max(1.0, critical_value(draws, alpha) / gaussian)
        p_value = min(p_value, n_lags * 2.0 * norm.sf(sums.farthest / scale))
    return p_value


def critical_value(draws, alpha):
    """Return the value that a fraction alpha of draws and observation together exceeds."""
    # 1e-9: alpha * (n + 1) is meant to be whole, as 0.05 * 500, whatever the rounding
    return draws[-int(alpha * (draws.size + 1) + 1e-9)]


def holm(p_values):
    """Adjust p-values for the number of tests by Holm's step-down procedure."""
    order = np.argsort(p_values)
    steps = p_values[order] * np.arange(p_values.size, 0, -1)
    adjusted = np.empty_like(p_values)
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return adjusted

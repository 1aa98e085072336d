"""How likely a residual is with an unknown signal of given size and memory, in noise of given colour."""

from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.locate._covered import Covered, Entrance
from narx_sklearn.discrepancy.locate._kalman import filter_windows, smooth_windows, state_size

TINY_NOISE = 1e-6  # white share beside coloured noise of variance one: keeps the filter's variances positive


class Colour(NamedTuple):
    """What the noise of each output is made of, each an array of shape (n_outputs,)."""

    rho: np.ndarray  # correlation of the coloured part from one sample to the next
    coloured: np.ndarray  # its variance
    white: np.ndarray  # variance of the white part

    @classmethod
    def of(cls, rho: np.ndarray) -> "Colour":
        """Return noise of variance one that is white or of one colour."""
        white = TINY_NOISE if np.any(rho > 0) else 1.0
        return cls(rho, np.full(rho.size, float(np.any(rho > 0))), np.full(rho.size, white))

    @property
    def wanders(self) -> np.ndarray:
        """Whether each output's noise has a coloured part under a white one, (n_outputs,)."""
        return (self.rho > 0) & (self.white > TINY_NOISE)


class Estimate(NamedTuple):
    """What the filter, and where asked for the smoother, make of the covered samples."""

    nu: np.ndarray
    S: np.ndarray
    samples: np.ndarray  # log likelihood of each sample
    concentrated: float  # variance of the noise, in units of the outputs' scale squared
    w: np.ndarray
    w_variance: np.ndarray
    dx: np.ndarray


class Regressed(NamedTuple):
    """Least squares on columns, under the colour that noise and force have together."""

    samples: np.ndarray  # log likelihood of each sample
    concentrated: float  # variance of the noise, in units of the outputs' scale squared
    coefficients: np.ndarray  # (n_columns,)
    covariance: np.ndarray  # (n_columns, n_columns), zero along what the columns do not tell apart
    n_told: int  # directions of the columns that were told apart


def estimate(
    covered: Covered, entrance: Entrance, phi: float, w_var: float, colour: Colour, *, keep: bool = False
) -> Estimate:
    """Filter the residual, and smooth it where the force itself is to be kept."""
    n, n_outputs = covered.b.shape[:2]
    size = state_size(covered.A.shape[1], n_outputs, colour.rho)
    nu, S = np.empty((n, n_outputs, 1)), np.empty((n, n_outputs))
    kept = n if keep else 0
    gain, row = np.empty((kept, n_outputs, size)), np.empty((kept, size))
    model = (covered.A, entrance.g, covered.C, entrance.d, covered.seam, phi, w_var)
    filter_windows(*model, *colour, covered.start, covered.b, nu, S, gain, row)
    concentrated, samples = _likelihood(covered, nu[:, :, 0], S)
    w, w_variance, dx = np.zeros(kept), np.zeros(kept), np.zeros((kept, covered.A.shape[1]))
    if keep:
        smooth_windows(
            *model, colour.rho, colour.coloured, covered.start, nu, S, gain, row, w, w_variance, dx
        )
    return Estimate(nu, S, samples, concentrated, w, w_variance, dx)


def no_force(covered: Covered, colour: Colour, *, keep: bool = False) -> Estimate:
    """Filter the residual as noise and free initial deviations alone."""
    return estimate(covered, Entrance.closed(covered), 1.0, 0.0, colour, keep=keep)


def _likelihood(covered: Covered, nu, S):
    """Return the noise variance of maximum likelihood and the log likelihood of each sample under it."""
    seen = S > 0
    variance = np.where(seen, S, 1.0)
    squares = nu**2 / variance
    # innovations that only settle a free initial deviation carry no information on the variance
    degrees = max(int(seen.sum()) - covered.n_free, 1)
    concentrated = max(float(squares.sum()) / degrees, 1e-300)
    terms = np.where(seen, squares / concentrated + np.log(variance) + np.log(concentrated), 0.0)
    # the prior of the initial deviations is in units of the noise: its scale must not count
    settled = covered.n_free * np.log(concentrated) / covered.samples.size
    return concentrated, -0.5 * (terms.sum(axis=1) - settled)


def regressed(
    covered: Covered, entrance: Entrance, series: np.ndarray, phi: float, w_var: float, colour: Colour
) -> Regressed:
    """Return the log likelihood of each sample after least squares on whitened columns (de Jong 1991).

    Parameters
    ----------
    series : ndarray of shape (n, n_outputs, 1 + n_columns)
        The residual, NaN where not seen, and the columns. It is overwritten: on a long record it is the
        largest array there is.
    """
    S = np.empty(series.shape[:2])
    model = (covered.A, entrance.g, covered.C, entrance.d, covered.seam, phi, w_var)
    filter_windows(*model, *colour, covered.start, series, series, S, np.empty((0, 1, 1)), np.empty((0, 1)))
    root = np.sqrt(np.where(S > 0, S, 1.0))
    series /= root[:, :, None]
    white = series.reshape(-1, series.shape[2])  # zero where nothing was seen
    inner = white.T @ white
    # few columns of a tall matrix: normal equations, columns of unit size, small directions left out
    size = np.sqrt(np.diag(inner)[1:])
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 1e-9 * size.max(initial=0.0))
    values, directions = np.linalg.eigh(inner[1:, 1:] * scale[:, None] * scale)
    strong = values > 1e-9 * values.max(initial=0.0)
    along = directions[:, strong] * scale[:, None]
    coefficients = along @ ((along.T @ inner[1:, 0]) / values[strong])
    left = (white[:, 0] - white[:, 1:] @ coefficients).reshape(S.shape) * root
    concentrated, samples = _likelihood(covered, left, S)
    covariance = concentrated * (along / values[strong]) @ along.T
    return Regressed(samples, concentrated, coefficients, covariance, int(np.count_nonzero(strong)))

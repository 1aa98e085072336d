"""How likely a residual is with an unknown signal of given size and memory, and the likeliest size."""

from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from narx_sklearn.discrepancy.locate._covered import Covered, Entrance, thinned
from narx_sklearn.discrepancy.locate._kalman import filter_windows, respond, smooth_windows, state_size

TINY_NOISE = 1e-6  # white share beside coloured noise of variance one: keeps the filter's variances positive
LARGEST_RHO = 0.9995  # of noise: memory of two thousand samples
ORDINARY_RHO = 0.9  # a colour to start from: the background's own is swollen by what the force leaves in it
WORTH = 2.0  # nats that a colour, or one of an output's own, has to gain
ROUNDS = 2  # through the outputs, each of which gets a colour of its own
# of the force's variance over the one that would move the outputs as observed
DECADES = np.arange(-2.0, 9.0, 2.0)


class Estimate(NamedTuple):
    """What the filter, and where asked for the smoother, make of the covered samples."""

    nu: np.ndarray
    S: np.ndarray
    samples: np.ndarray  # log likelihood of each sample
    concentrated: float  # variance of the noise, in units of the outputs' scale squared
    w: np.ndarray
    w_variance: np.ndarray
    dx: np.ndarray


class Likeliest(NamedTuple):
    """The likeliest size of a force and colour of the noise."""

    w_var: float  # variance of the force, over that of the noise
    rho: np.ndarray  # (n_outputs,) correlation of each output's noise from one sample to the next
    log_likelihood: float  # of the samples that the search looked at


class Regressed(NamedTuple):
    """Least squares on columns, under the colour that noise and force have together."""

    samples: np.ndarray  # log likelihood of each sample
    concentrated: float  # variance of the noise, in units of the outputs' scale squared
    coefficients: np.ndarray  # (n_columns,)
    covariance: np.ndarray  # (n_columns, n_columns), zero along what the columns do not tell apart
    n_told: int  # directions of the columns that were told apart


def estimate(
    covered: Covered, entrance: Entrance, phi: float, w_var: float, rho: np.ndarray, *, keep: bool = False
) -> Estimate:
    """Filter the residual, and smooth it where the force itself is to be kept."""
    n, n_outputs = covered.b.shape[:2]
    size = state_size(covered.A.shape[1], n_outputs, rho)
    nu, S = np.empty((n, n_outputs, 1)), np.empty((n, n_outputs))
    kept = n if keep else 0
    gain, row = np.empty((kept, n_outputs, size)), np.empty((kept, size))
    model = (covered.A, entrance.g, covered.C, entrance.d, covered.seam, phi, w_var, rho)
    filter_windows(*model, _white(rho), covered.start, covered.b, nu, S, gain, row)
    concentrated, samples = _likelihood(covered, nu[:, :, 0], S)
    w, w_variance, dx = np.zeros(kept), np.zeros(kept), np.zeros((kept, covered.A.shape[1]))
    if keep:
        smooth_windows(*model, covered.start, nu, S, gain, row, w, w_variance, dx)
    return Estimate(nu, S, samples, concentrated, w, w_variance, dx)


def no_force(covered: Covered, rho: np.ndarray, *, keep: bool = False) -> Estimate:
    """Filter the residual as noise and free initial deviations alone."""
    return estimate(covered, Entrance.closed(covered), 1.0, 0.0, rho, keep=keep)


def _white(rho: np.ndarray) -> float:
    """Return the variance of the white noise that is beside the noise states, in units of all noise."""
    return TINY_NOISE if np.any(rho > 0) else 1.0


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


def best_rho(covered: Covered, noise: str) -> tuple[np.ndarray, float]:
    """Return the colour of each output's noise, and its variance, when there is no force."""
    part = thinned(covered)[0]
    rho = np.zeros(covered.b.shape[1])

    def value(rho):
        return float(no_force(part, rho).samples.sum())

    if noise == "ar1":
        rho[:] = _coloured(lambda c: value(np.full(rho.size, c)), value(rho))
        rho = _of_their_own(value, rho)
    return rho, no_force(covered, rho).concentrated


def _of_their_own(value, rho: np.ndarray) -> np.ndarray:
    """Return the common correlation, changed output by output wherever that gains two nats."""
    if rho.size == 1:
        return rho
    best = value(rho)
    for _ in range(ROUNDS):
        before = best
        for output in range(rho.size):
            other = _one_coloured(value, rho, output)
            value_there = value(other)
            if value_there > best + WORTH:
                rho, best = other, value_there
        if best == before:
            break
    return rho


def _one_coloured(value, rho: np.ndarray, output: int) -> np.ndarray:
    """Return correlations of which one output's maximises ``value(rho)``, the others' as they are."""

    def with_one(correlation):
        changed = rho.copy()
        changed[output] = correlation
        return changed

    return with_one(_coloured(lambda c: value(with_one(c)), value(with_one(0.0))))


def _coloured(value, white: float) -> float:
    """Return the correlation that maximises ``value(rho)``; 0 unless it beats white noise by two nats."""
    # on a scale where 0.9, 0.99 and 0.999 are equally far apart
    search = minimize_scalar(
        lambda t: -value(-np.expm1(-t)),
        bounds=(1e-3, -np.log(1 - LARGEST_RHO)),
        method="bounded",
        options={"maxiter": 12, "xatol": 0.02},
    )
    return float(-np.expm1(-search.x)) if -search.fun > white + WORTH else 0.0


def best_force(covered: Covered, entrance: Entrance, phi: float, rho: np.ndarray, noise: str) -> Likeliest:
    """Return the likeliest size of a force of given memory; of none where it moves no output.

    Colours tried are white, an ordinary one and ``rho``, the background's; then each output's own is refined.
    """
    part, rows = thinned(covered)
    entering = entrance.at(rows)
    response = np.empty((*entering.d.shape, 1))
    respond(part.A, entering.g, part.C, entering.d, part.seam, np.ones((rows.size, 1)), response)
    reach = float(np.mean(response**2))
    if not reach > 0:
        return Likeliest(0.0, rho, float(no_force(part, rho).samples.sum()))
    unit = float(np.nanmean(part.b**2)) / reach

    def value(decade, rho):
        return float(estimate(part, entering, phi, unit * 10.0**decade, rho).samples.sum())

    def refined(decade, rho, span):
        search = minimize_scalar(
            lambda t: -value(t, rho),
            bounds=(decade - span, decade + span),
            method="bounded",
            options={"maxiter": 8, "xatol": 0.05},
        )
        return float(search.x), -float(search.fun)

    white, ordinary = np.zeros(rho.size), np.full(rho.size, ORDINARY_RHO)
    colours = distinct(white, ordinary, rho) if noise == "ar1" else (white,)
    _, decade, likeliest = max((value(t, c), t, tuple(c)) for t in DECADES for c in colours)
    rho = np.array(likeliest)
    decade, best = refined(decade, rho, 2.0)
    for output in range(rho.size if noise == "ar1" else 0):
        colour = _one_coloured(partial(value, decade), rho, output)
        other, value_there = refined(decade, colour, 1.5)
        if value_there > best:
            decade, rho, best = other, colour, value_there
    return Likeliest(unit * 10.0**decade, rho, best)


def distinct(*colours: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return colours that differ, each once."""
    return tuple(np.unique(colours, axis=0))


def regressed(
    covered: Covered, entrance: Entrance, series: np.ndarray, phi: float, w_var: float, rho: np.ndarray
) -> Regressed:
    """Return the log likelihood of each sample after least squares on whitened columns (de Jong 1991).

    Parameters
    ----------
    series : ndarray of shape (n, n_outputs, 1 + n_columns)
        The residual, NaN where not seen, and the columns. It is overwritten: on a long record it is the
        largest array there is.
    """
    S = np.empty(series.shape[:2])
    model = (covered.A, entrance.g, covered.C, entrance.d, covered.seam, phi, w_var, rho, _white(rho))
    filter_windows(*model, covered.start, series, series, S, np.empty((0, 1, 1)), np.empty((0, 1)))
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

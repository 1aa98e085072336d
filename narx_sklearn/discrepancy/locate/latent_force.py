"""The latent force: an unknown signal at one port, estimated from the residual of a simulation."""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import chi2

from narx_sklearn.discrepancy.locate._hats import additive_hats
from narx_sklearn.discrepancy.locate._kalman import (
    filter_windows,
    initial_energy,
    respond,
    smooth_windows,
    state_size,
)
from narx_sklearn.discrepancy.locate.tangent import Tangent
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.simulators.simulator import Windows

DIFFUSE = 1e4  # variance of a free initial deviation over what the residual could ask of it
SEARCH_SAMPLES = 2000  # windows with about this many samples settle the two variances
LONGEST_PIECE = 1000  # samples of a window that the search takes at a time
TINY_NOISE = 1e-6  # white share beside coloured noise of variance one: keeps the filter's variances positive
# variance of what a function of the port's signals leaves, over the whole force
REMAINDERS = (1.0, 1e-2, 1e-4, 0.0)
LARGEST_RHO = 0.9995  # of noise: memory of two thousand samples
ORDINARY_RHO = 0.9  # a colour to start from: the background's own is swollen by what the force leaves in it
# of the force's variance over the one that would move the outputs as observed
DECADES = np.arange(-2.0, 9.0, 2.0)
FEWEST_VALUES = 20  # residuals inside windows, without which no force is located


class Covered(NamedTuple):
    """The samples inside windows, in order of time, as the kernels take them; outputs in units of a scale."""

    samples: np.ndarray  # (n,) indices into the record
    seam: np.ndarray  # (n,) what follows: 0 next sample, n > 0 new window n samples later, -1 new session
    A: np.ndarray
    C: np.ndarray
    b: np.ndarray  # (n, n_outputs, 1)
    start: np.ndarray  # (n_states,) variance of a free initial deviation
    n_free: int  # initial deviations that are estimated, over all windows

    @property
    def observed(self) -> int:
        """Number of residuals that are not NaN."""
        return int(np.isfinite(self.b).sum())


@dataclass(frozen=True, eq=False)
class Background:
    """What noise and free initial states alone make of the residual; the yardstick of every latent force.

    Attributes
    ----------
    rho : float
        Correlation of the noise from one sample to the next; 0 is white.
    sigma : ndarray of shape (n_outputs,)
        Standard deviation of the noise of each output, unit of the output.
    innovations : ndarray of shape (n_samples, n_outputs)
        The residual made white and of unit variance; NaN where there is none.
    remainder : ndarray of shape (n_samples, n_outputs)
        The residual without what the initial deviations explain, unit of the output.
    log_likelihood : ndarray of shape (n_samples,)
        Contribution of each sample; zero where there is none.
    """

    rho: float
    sigma: np.ndarray
    innovations: np.ndarray
    remainder: np.ndarray
    log_likelihood: np.ndarray


@dataclass(frozen=True, eq=False)
class LatentForce:
    """An unknown signal at one port.

    Attributes
    ----------
    port : Port
        Where it acts.
    w : ndarray of shape (n_samples,)
        Its smoothed course: unit of the input; of the state per second (per step for a map); of the output.
        NaN outside the windows.
    w_std : ndarray of shape (n_samples,)
        Standard deviation of that estimate.
    dx : ndarray of shape (n_samples, n_states)
        Smoothed deviation of the states from the run.
    gain : float
        Gain of log likelihood, nats, over noise alone.
    own_gain : float
        The same when the force is a smooth function of the port's own signals and a smaller remainder, one
        half log n taken off for each coefficient (Schwarz 1978); -inf when no arguments were given.
    share : float
        Share of the residual's energy, beyond what initial deviations explain, that the force explains.
    p_value : float
        Of the gain against noise alone, chi-squared with two degrees of freedom, which is cautious.
    rho, sigma, amplitude : float
        Correlation of the noise left over, its standard deviation in units of the background's, and the
        standard deviation of the force.
    log_likelihood : ndarray of shape (n_samples,)
        Contribution of each sample under the better of the two descriptions.
    """

    port: Port
    w: np.ndarray
    w_std: np.ndarray
    dx: np.ndarray
    gain: float
    own_gain: float
    share: float
    p_value: float
    rho: float
    sigma: float
    amplitude: float
    log_likelihood: np.ndarray

    @property
    def evidence(self) -> float:
        """The larger of the two gains, nats."""
        return max(self.gain, self.own_gain)


def background(linear: Tangent, residual: np.ndarray, windows: Windows, *, noise: str = "ar1") -> Background:
    """Describe the residual by noise and free initial deviations alone.

    Parameters
    ----------
    linear : Tangent
        Along the run.
    residual : ndarray of shape (n_samples, n_outputs)
        Measured minus simulated output; NaN is skipped.
    windows : Windows
        Windows of the run.
    noise : {"ar1", "white"}, default="ar1"
        Colour of the noise.

    Returns
    -------
    Background
        Maximum likelihood estimate.

    Raises
    ------
    ValueError
        If fewer than 20 residuals lie inside windows.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.locate import Tangent, background
    >>> from narx_sklearn.discrepancy.simulators.simulator import Windows
    >>> n, rng = 2000, np.random.default_rng(0)
    >>> one, none = np.ones((n, 1, 1)), np.zeros((n, 1, 0))
    >>> still = Tangent(A=0.9 * one, B=none, G=one, C=one, D=none)
    >>> noise = background(still, 0.3 * rng.normal(size=(n, 1)), Windows.whole([slice(0, n)]))
    >>> round(float(noise.sigma[0]), 2)
    0.3
    """
    n_outputs = residual.shape[1]
    energy = np.nanmean(residual**2, axis=0) if np.isfinite(residual).any() else np.zeros(n_outputs)
    sigma = np.sqrt(np.where(energy > 0, energy, 1.0))
    rho = 0.0
    for _ in range(3 if n_outputs > 1 else 1):
        covered = cover(linear, residual, windows, sigma)
        rho, concentrated = _best_rho(covered, noise)
        sigma = sigma * np.sqrt(concentrated)
    covered = cover(linear, residual, windows, sigma)
    estimate = _no_force(covered, rho, keep=True)
    n = residual.shape[0]
    innovations = np.full((n, n_outputs), np.nan)
    seen = estimate.S > 0
    with np.errstate(invalid="ignore", divide="ignore"):
        innovations[covered.samples] = np.where(seen, estimate.nu[:, :, 0] / np.sqrt(estimate.S), np.nan)
    remainder = np.full((n, n_outputs), np.nan)
    remainder[covered.samples] = (covered.b[:, :, 0] - _shown(covered, estimate.dx)) * sigma
    return Background(rho, sigma, innovations, remainder, _spread_out(estimate.samples, covered, n))


def latent_force(
    linear: Tangent,
    residual: np.ndarray,
    windows: Windows,
    port: Port,
    *,
    arguments: np.ndarray | None = None,
    noise: str = "ar1",
    memory: float | None = None,
    against: Background | None = None,
) -> LatentForce:
    r"""Estimate the signal that, entering at one port, would explain the residual.

    .. math:: \delta_{k+1} = A_k \delta_k + g_k w_k, \quad b_k = C_k \delta_k + d_k w_k + e_k, \quad
              w_{k+1} = e^{-1/\tau} w_k + \eta_k

    by a Kalman filter and smoother. The initial deviation of every window is free; the variances of the
    force and of the noise, and the colour of the noise, maximise the likelihood.

    Parameters
    ----------
    linear : Tangent
        Along the run.
    residual : ndarray of shape (n_samples, n_outputs)
        Measured minus simulated output, after the simulator's own parameters were refitted; NaN is skipped.
    windows : Windows
        Windows of the run.
    port : Port
        Where the force enters.
    arguments : ndarray of shape (n_samples, n_arguments), optional
        Signals the force may be a function of: the input at an input port, the states at a state equation
        (the smoothed deviation is added to them), the output at an output. Ports whose forces move the
        outputs alike can only be told apart by what the force depends on.
    noise : {"ar1", "white"}, default="ar1"
        Colour of the noise.
    memory : float, optional
        Correlation time of the force, samples; the median window when not given, which is close to a random
        walk.
    against : Background, optional
        Noise alone, when it is already known.

    Returns
    -------
    LatentForce
        The force, its standard deviation, and how much it explains.

    Raises
    ------
    ValueError
        If the port does not exist or fewer than 20 residuals lie inside windows.

    References
    ----------
    .. [1] M. Alvarez, D. Luengo and N. Lawrence, 2009, latent force models.
    .. [2] J. Hartikainen and S. Sarkka, 2010, Kalman filtering and smoothing of Gaussian process priors.
    .. [3] G. Bierman, 1973, smoothing in the form of Bryson and Frazier.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.locate import Tangent, latent_force
    >>> from narx_sklearn.discrepancy.placed import Port
    >>> from narx_sklearn.discrepancy.simulators.simulator import Windows
    >>> n, rng = 2000, np.random.default_rng(0)
    >>> one, none = np.ones((n, 1, 1)), np.zeros((n, 1, 0))
    >>> still = Tangent(A=0.9 * one, B=none, G=one, C=one, D=none)
    >>> hidden, shown = np.sin(np.arange(n) / 50), np.zeros((n, 1))
    >>> for k in range(n - 1):
    ...     shown[k + 1] = 0.9 * shown[k] + hidden[k]
    >>> shown += 0.1 * rng.normal(size=(n, 1))
    >>> force = latent_force(still, shown, Windows.whole([slice(0, n)]), Port("state", 0))
    >>> round(float(np.corrcoef(force.w, hidden)[0, 1]), 2)
    1.0
    """
    against = background(linear, residual, windows, noise=noise) if against is None else against
    covered = cover(linear, residual, windows, against.sigma)
    g, d = _entrance(linear, covered, port, against.sigma)
    lengths = windows.last - windows.first
    phi = float(np.exp(-1.0 / (np.median(lengths) if memory is None else memory)))
    w_var, rho = _best_force(covered, g, d, phi, against.rho, noise)
    estimate = _estimate(covered, g, d, phi, w_var, rho, keep=True)
    n = residual.shape[0]
    null = against.log_likelihood.sum()
    if estimate.samples.sum() < null:  # the pieces searched did not speak for the record: no force is better
        w_var, rho = 0.0, against.rho
        estimate = _estimate(covered, g, d, phi, w_var, rho, keep=True)
    gain = float(estimate.samples.sum() - null)
    best = estimate.samples
    explained = _shown(covered, estimate.dx) + d * estimate.w[:, None]
    own_gain = -np.inf
    if arguments is not None:
        signals = arguments[covered.samples]
        if port.kind == "state":
            signals = signals + estimate.dx
        own, rho_own = _as_function(covered, g, d, signals, phi, w_var, rho)
        own_gain = float(own.sum() - null)
        if own_gain > gain:
            best, rho = own, rho_own
    left = np.nansum((covered.b[:, :, 0] - explained) ** 2)
    before = np.nansum((against.remainder / against.sigma) ** 2)
    dx = np.full((n, covered.A.shape[1]), np.nan)
    dx[covered.samples] = estimate.dx
    return LatentForce(
        port=port,
        w=_placed(estimate.w, covered, n),
        w_std=_placed(np.sqrt(estimate.w_variance * estimate.concentrated), covered, n),
        dx=dx,
        gain=gain,
        own_gain=own_gain,
        share=float(max(1.0 - left / before, 0.0)) if before > 0 else 0.0,
        p_value=float(chi2.sf(2 * max(gain, 0.0), 2)),
        rho=rho,
        sigma=float(np.sqrt(estimate.concentrated)),
        amplitude=float(np.sqrt(w_var * estimate.concentrated)),
        log_likelihood=_spread_out(best, covered, n),
    )


def cover(linear: Tangent, residual: np.ndarray, windows: Windows, scale: np.ndarray) -> Covered:
    """Return the samples inside windows as the kernels take them, outputs divided by ``scale``."""
    n = residual.shape[0]
    window = np.full(n, -1, dtype=np.int64)
    for i, (first, last) in enumerate(zip(windows.first, windows.last, strict=True)):
        window[first:last] = i
    usable = (window >= 0) & np.isfinite(linear.A).all(axis=(1, 2)) & np.isfinite(linear.C).all(axis=(1, 2))
    samples = np.flatnonzero(usable)
    b = np.ascontiguousarray(residual[samples] / scale)[:, :, None]
    if np.isfinite(b).sum() < FEWEST_VALUES:
        raise ValueError(
            f"residual has {np.isfinite(b).sum()} values inside the windows; locating a force takes at least "
            f"{FEWEST_VALUES}. Pass a longer record, or windows in which the simulation stays finite."
        )
    ahead, apart = np.diff(samples), np.diff(window[samples])
    session = windows.began[window[samples]]
    seam = np.full(samples.size, -1, dtype=np.int64)
    seam[:-1] = np.where(np.diff(session) != 0, -1, np.where((ahead == 1) & (apart == 0), 0, ahead))
    A = np.ascontiguousarray(linear.A[samples])
    C = np.ascontiguousarray(linear.C[samples] / scale[:, None])
    energy = np.empty(A.shape[1])
    count = initial_energy(A, C, seam, energy)
    size = np.nanmean(b**2) * samples.size
    with np.errstate(divide="ignore", over="ignore"):
        start = np.where(energy > 1e-20 * energy.max(initial=0.0), DIFFUSE * max(size, 1e-12) / energy, 0.0)
    return Covered(samples, seam, A, C, b, start, count * int(np.count_nonzero(start)))


class _Estimate(NamedTuple):
    nu: np.ndarray
    S: np.ndarray
    samples: np.ndarray  # log likelihood of each sample
    concentrated: float  # variance of the noise, in units of the outputs' scale squared
    w: np.ndarray
    w_variance: np.ndarray
    dx: np.ndarray


def _estimate(covered: Covered, g, d, phi, w_var, rho, *, keep=False) -> _Estimate:
    n, n_outputs = covered.b.shape[:2]
    size = state_size(covered.A.shape[1], n_outputs, rho)
    nu, S = np.empty((n, n_outputs, 1)), np.empty((n, n_outputs))
    kept = n if keep else 0
    gain, row = np.empty((kept, n_outputs, size)), np.empty((kept, size))
    model = (covered.A, g, covered.C, d, covered.seam, phi, w_var, rho)
    r = TINY_NOISE if rho > 0 else 1.0
    filter_windows(*model, r, covered.start, covered.b, nu, S, gain, row)
    concentrated, samples = _likelihood(covered, nu[:, :, 0], S)
    w, w_variance, dx = np.zeros(kept), np.zeros(kept), np.zeros((kept, covered.A.shape[1]))
    if keep:
        smooth_windows(*model, covered.start, nu, S, gain, row, w, w_variance, dx)
    return _Estimate(nu, S, samples, concentrated, w, w_variance, dx)


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


def _log_likelihood(covered, g, d, phi, w_var, rho) -> float:
    return float(_estimate(covered, g, d, phi, w_var, rho).samples.sum())


def _best_rho(covered: Covered, noise: str):
    """Return the colour of the noise, and its variance, when there is no force."""
    part = _thinned(covered)[0]

    def value(rho):
        return float(_no_force(part, rho).samples.sum())

    rho = _coloured(value, value(0.0)) if noise == "ar1" else 0.0
    return rho, _no_force(covered, rho).concentrated


def _no_force(covered: Covered, rho: float, *, keep=False) -> _Estimate:
    g, d = np.zeros((covered.samples.size, covered.A.shape[1])), np.zeros(covered.b.shape[:2])
    return _estimate(covered, g, d, 1.0, 0.0, rho, keep=keep)


def _coloured(value, white: float) -> float:
    """Return the correlation that maximises ``value(rho)``; 0 unless it beats white noise by two nats."""
    # on a scale where 0.9, 0.99 and 0.999 are equally far apart
    search = minimize_scalar(
        lambda t: -value(-np.expm1(-t)),
        bounds=(1e-3, -np.log(1 - LARGEST_RHO)),
        method="bounded",
        options={"maxiter": 12, "xatol": 0.02},
    )
    return float(-np.expm1(-search.x)) if -search.fun > white + 2.0 else 0.0


def _best_force(covered: Covered, g, d, phi, rho: float, noise: str):
    """Return the variance of the force, over that of the noise, and the colour of the noise."""
    part, rows = _thinned(covered)
    g_part, d_part = g[rows], d[rows]
    response = np.empty((*d_part.shape, 1))
    respond(part.A, g_part, part.C, d_part, part.seam, np.ones((d_part.shape[0], 1)), response)
    reach = float(np.mean(response**2))
    if not reach > 0:
        return 0.0, rho
    unit = float(np.nanmean(part.b**2)) / reach

    def value(decade, rho):
        return _log_likelihood(part, g_part, d_part, phi, unit * 10.0**decade, rho)

    def refined(decade, rho, span):
        search = minimize_scalar(
            lambda t: -value(t, rho),
            bounds=(decade - span, decade + span),
            method="bounded",
            options={"maxiter": 8, "xatol": 0.05},
        )
        return float(search.x), -float(search.fun)

    colours = {0.0, ORDINARY_RHO, rho} if noise == "ar1" else {0.0}
    _, decade, rho = max((value(t, c), t, c) for t in DECADES for c in colours)
    decade, best = refined(decade, rho, 2.0)
    if noise == "ar1":
        colour = _coloured(lambda c: value(decade, c), value(decade, 0.0))
        other, value_there = refined(decade, colour, 1.5)
        if value_there > best:
            decade, rho, best = other, colour, value_there
    return unit * 10.0**decade, rho


def _thinned(covered: Covered):
    """Return evenly spread pieces of windows with about SEARCH_SAMPLES samples in all, and their rows."""
    n = covered.samples.size
    if n <= SEARCH_SAMPLES:
        return covered, np.arange(n)
    ends = np.flatnonzero(covered.seam) + 1
    edges = [0]
    for end in ends:
        edges += [*range(edges[-1] + LONGEST_PIECE, int(end), LONGEST_PIECE), int(end)]
    pieces = [np.arange(a, b) for a, b in pairwise(edges)]
    wanted = max(round(len(pieces) * SEARCH_SAMPLES / n), 1)
    chosen = [pieces[i] for i in np.unique(np.linspace(0, len(pieces) - 1, wanted).round().astype(int))]
    rows = np.concatenate(chosen)
    seam = covered.seam[rows].copy()
    lasts = np.cumsum([piece.size for piece in chosen]) - 1
    for i, last in enumerate(lasts[:-1]):
        new_session = np.any(covered.seam[chosen[i][-1] : chosen[i + 1][0]] < 0)
        seam[last] = -1 if new_session else covered.samples[rows[last + 1]] - covered.samples[rows[last]]
    seam[-1] = -1
    part = Covered(
        covered.samples[rows],
        seam,
        covered.A[rows],
        covered.C[rows],
        covered.b[rows],
        covered.start,
        len(chosen) * int(np.count_nonzero(covered.start)),
    )
    return part, rows


def _as_function(covered: Covered, g, d, signals, phi, w_var, rho):
    """Return the log likelihood of each sample, and the colour, when the force is a function of ``signals``.

    What the function leaves of the force is a latent force again, of less variance. Half log n for each
    coefficient is taken off.
    """
    basis = additive_hats(signals)
    part, rows = _thinned(covered)
    candidates = [(w_var * share, colour) for share in REMAINDERS for colour in sorted({0.0, rho})]
    if len(candidates) > 1:
        small = _with_responses(part, g[rows], d[rows], basis[rows])
        trials = [_regressed(part, g[rows], d[rows], small.copy(), phi, *c).sum() for c in candidates]
        candidates = [candidates[int(np.argmax(trials))]]
    series = _with_responses(covered, g, d, basis)
    return _regressed(covered, g, d, series, phi, *candidates[0]), candidates[0][1]


def _with_responses(covered: Covered, g, d, basis):
    """Return the residual and the outputs' response to each column, (n, n_outputs, 1 + n_columns)."""
    forces = np.zeros((basis.shape[0], 1 + basis.shape[1]))
    forces[:, 1:] = basis
    series = np.empty((*covered.b.shape[:2], forces.shape[1]))
    respond(covered.A, g, covered.C, d, covered.seam, forces, series)
    series[:, :, :1] = covered.b
    return series


def _regressed(covered: Covered, g, d, series, phi, w_var, rho):
    """Return the log likelihood of each sample after least squares on whitened columns (de Jong 1991).

    ``series`` is overwritten: on a long record it is the largest array there is.
    """
    S = np.empty(series.shape[:2])
    r = TINY_NOISE if rho > 0 else 1.0
    model = (covered.A, g, covered.C, d, covered.seam, phi, w_var, rho, r, covered.start)
    filter_windows(*model, series, series, S, np.empty((0, 1, 1)), np.empty((0, 1)))
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
    samples = _likelihood(covered, left, S)[1]
    return samples - 0.5 * np.count_nonzero(strong) * np.log(covered.observed) / samples.size


def _entrance(linear: Tangent, covered: Covered, port: Port, scale):
    """Return what a unit force at a port does to the next states and to the outputs (in units of scale)."""
    n_states, n_inputs, n_outputs = linear.A.shape[2], linear.B.shape[2], linear.C.shape[1]
    sizes = {"input": n_inputs, "state": n_states, "output": n_outputs}
    if port.kind not in sizes or not 0 <= port.index < sizes[port.kind]:
        raise ValueError(
            f"port {port} does not exist: the simulator has {n_inputs} inputs, {n_states} state equations "
            f"and {n_outputs} outputs, counted from zero."
        )
    n = covered.samples.size
    g, d = np.zeros((n, n_states)), np.zeros((n, n_outputs))
    if port.kind == "input":
        g[:] = linear.B[covered.samples, :, port.index]
        d[:] = linear.D[covered.samples, :, port.index] / scale
    elif port.kind == "state":
        g[:] = linear.G[covered.samples, :, port.index]
        if linear.F is not None:
            d[:] = linear.F[covered.samples, :, port.index] / scale
    else:
        d[:, port.index] = 1.0 / scale[port.index]
    return g, d


def _shown(covered: Covered, dx) -> np.ndarray:
    """Return what deviations of the states do to the outputs, in units of their scale."""
    return np.einsum("koi,ki->ko", covered.C, dx)


def _placed(values, covered: Covered, n: int) -> np.ndarray:
    """Return values of the covered samples at their place in the record, NaN elsewhere."""
    out = np.full(n, np.nan)
    out[covered.samples] = values
    return out


def _spread_out(values, covered: Covered, n: int) -> np.ndarray:
    """Return values of the covered samples at their place in the record, zero elsewhere."""
    out = np.zeros(n)
    out[covered.samples] = values
    return out

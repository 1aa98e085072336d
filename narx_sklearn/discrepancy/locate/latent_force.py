"""The latent force: an unknown signal at one port, estimated from the residual of a simulation."""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from narx_sklearn.discrepancy.locate._covered import Covered, Entrance, Entry, cover, thinned
from narx_sklearn.discrepancy.locate._hats import additive_hats
from narx_sklearn.discrepancy.locate._kalman import respond
from narx_sklearn.discrepancy.locate._likelihood import Colour, estimate, no_force, regressed
from narx_sklearn.discrepancy.locate._search import Search, distinct
from narx_sklearn.discrepancy.locate.tangent import Tangent
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.simulators.simulator import Windows

# variance of what a function of the port's signals leaves, over the whole force
REMAINDERS = (1.0, 1e-2, 1e-4, 0.0)


@dataclass(frozen=True, eq=False)
class Background:
    """What noise and free initial states alone make of the residual; the yardstick of every latent force.

    Attributes
    ----------
    rho : ndarray of shape (n_outputs,)
        Correlation of the noise of each output from one sample to the next; 0 is white.
    sigma : ndarray of shape (n_outputs,)
        Standard deviation of the noise of each output, unit of the output.
    innovations : ndarray of shape (n_samples, n_outputs)
        The residual made white and of unit variance; NaN where there is none.
    remainder : ndarray of shape (n_samples, n_outputs)
        The residual without what the initial deviations explain, unit of the output.
    log_likelihood : ndarray of shape (n_samples,)
        Contribution of each sample; zero where there is none.
    """

    rho: np.ndarray
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
        Of what is in proportion to a signal the factor. NaN outside the windows.
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
    rho : ndarray of shape (n_outputs,)
        Correlation of the noise left over at each output.
    sigma, amplitude : float
        Its standard deviation in units of the background's, and the standard deviation of the force.
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
    rho: np.ndarray
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
    covered = cover(linear, residual, windows, sigma)
    rho = np.zeros(n_outputs)
    if noise == "ar1":
        rho = Search.of(covered, covered.b, Entrance.closed(covered), 1.0).likeliest_rho()
    sigma = sigma * np.sqrt(no_force(covered, Colour.of(rho)).concentrated)
    covered = cover(linear, residual, windows, sigma)
    found = no_force(covered, Colour.of(rho), keep=True)
    n = residual.shape[0]
    with np.errstate(invalid="ignore", divide="ignore"):
        innovations = np.where(found.S > 0, found.nu[:, :, 0] / np.sqrt(found.S), np.nan)
    remainder = (covered.b[:, :, 0] - covered.shown(found.dx)) * sigma
    return Background(
        rho=rho,
        sigma=sigma,
        innovations=covered.in_record(innovations, n),
        remainder=covered.in_record(remainder, n),
        log_likelihood=covered.in_record(found.samples, n, 0.0),
    )


def latent_force(
    linear: Tangent,
    residual: np.ndarray,
    windows: Windows,
    port: Port | Entry,
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
    port : Port or Entry
        Where the force enters; an entry also says what it is in proportion to.
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
    entry = port if isinstance(port, Entry) else Entry(port)
    entrance = Entrance.of(linear, covered, entry, against.sigma)
    lengths = windows.last - windows.first
    phi = float(np.exp(-1.0 / (np.median(lengths) if memory is None else memory)))
    w_var, colour, _ = Search.of(covered, covered.b, entrance, phi).best_force(against.rho, noise)
    found = estimate(covered, entrance, phi, w_var, colour, keep=True)
    n = residual.shape[0]
    null = against.log_likelihood.sum()
    if found.samples.sum() < null:  # the pieces searched did not speak for the record: no force is better
        w_var, colour = 0.0, Colour.of(against.rho)
        found = estimate(covered, entrance, phi, w_var, colour, keep=True)
    gain = float(found.samples.sum() - null)
    best = found.samples
    explained = covered.shown(found.dx) + entrance.d * found.w[:, None]
    own_gain = -np.inf
    if arguments is not None:
        signals = arguments[covered.samples]
        if entry.port.kind == "state":
            signals = signals + found.dx
        own, own_colour = _as_function(covered, entrance, signals, phi, w_var, colour)
        own_gain = float(own.sum() - null)
        if own_gain > gain:
            best, colour = own, own_colour
    left = np.nansum((covered.b[:, :, 0] - explained) ** 2)
    before = np.nansum((against.remainder / against.sigma) ** 2)
    return LatentForce(
        port=entry.port,
        w=covered.in_record(found.w, n),
        w_std=covered.in_record(np.sqrt(found.w_variance * found.concentrated), n),
        dx=covered.in_record(found.dx, n),
        gain=gain,
        own_gain=own_gain,
        share=float(max(1.0 - left / before, 0.0)) if before > 0 else 0.0,
        p_value=float(chi2.sf(2 * max(gain, 0.0), 2)),
        rho=colour.rho,
        sigma=float(np.sqrt(found.concentrated)),
        amplitude=float(np.sqrt(w_var * found.concentrated)),
        log_likelihood=covered.in_record(best, n, 0.0),
    )


def _as_function(covered: Covered, entrance: Entrance, signals, phi, w_var, colour: Colour):
    """Return the log likelihood of each sample, and the colour, when the force is a function of ``signals``.

    What the function leaves of the force is a latent force again, of less variance. Half log n for each
    coefficient is taken off.
    """
    basis = additive_hats(signals)
    part, rows = thinned(covered)
    candidates = [
        (w_var * share, Colour.of(rho))
        for share in REMAINDERS
        for rho in distinct(np.zeros(colour.rho.size), colour.rho)
    ]

    def priced(part: Covered, entering: Entrance, series: np.ndarray, w_var: float, colour) -> np.ndarray:
        samples, *_, n_told = regressed(part, entering, series, phi, w_var, colour)
        return samples - 0.5 * n_told * np.log(part.observed) / samples.size

    if len(candidates) > 1:
        entering = entrance.at(rows)
        small = _with_responses(part, entering, basis[rows])
        trials = [priced(part, entering, small.copy(), *c).sum() for c in candidates]
        candidates = [candidates[int(np.argmax(trials))]]
    series = _with_responses(covered, entrance, basis)
    return priced(covered, entrance, series, *candidates[0]), candidates[0][1]


def _with_responses(covered: Covered, entrance: Entrance, basis):
    """Return the residual and the outputs' response to each column, (n, n_outputs, 1 + n_columns)."""
    forces = np.zeros((basis.shape[0], 1 + basis.shape[1]))
    forces[:, 1:] = basis
    series = np.empty((*covered.b.shape[:2], forces.shape[1]))
    respond(covered.A, entrance.g, covered.C, entrance.d, covered.seam, forces, series)
    series[:, :, :1] = covered.b
    return series

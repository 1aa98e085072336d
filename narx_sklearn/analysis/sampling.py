"""Advice on the sampling period from the memory of the recorded output."""

from dataclasses import dataclass

import numpy as np
from scipy.signal import correlate, find_peaks

from narx_sklearn._validation import as_signals, finite_slices, session_slices

__all__ = ["SamplingAdvice", "sampling_advice"]

ADVISED = (10, 20)  # samples per tau_m, Billings and Aguirre (1995)
ACCEPTABLE = (5, 25)  # their relaxed range


@dataclass(frozen=True, eq=False)
class SamplingAdvice:
    """What the correlations of an output say about its sampling period.

    Attributes
    ----------
    sampling_period : float
        Period of the record, in seconds.
    tau_y, tau_y2 : int
        First minimum of the autocorrelation of the output and of its centred square, in samples.
    tau_m : int
        The smaller of the two.
    found : bool
        Whether a minimum was found within the lags looked at; if not, ``tau_m`` is their number.
    period_range : tuple of float
        Advised sampling periods ``(tau_m / 20, tau_m / 10)``, in seconds.
    loose_period_range : tuple of float
        Acceptable sampling periods ``(tau_m / 25, tau_m / 5)``, in seconds.
    decimation : int
        Keep every ``decimation``-th sample to come into the advised range; 1 to keep all.
    autocorrelation : ndarray of shape (n_lags, 2)
        Autocorrelation of the output and of its centred square, from lag 0.
    """

    sampling_period: float
    tau_y: int
    tau_y2: int
    tau_m: int
    found: bool
    period_range: tuple[float, float]
    loose_period_range: tuple[float, float]
    decimation: int
    autocorrelation: np.ndarray

    @property
    def verdict(self):
        """The advice in words."""
        if not self.found:
            return (
                f"The output stays correlated over all {self.tau_m} lags looked at, so its memory cannot be "
                "read from this record. Pass a longer record, a larger max_lag, or remove a drift first."
            )
        memory = (
            f"The output forgets itself after {self.tau_m} samples "
            f"({self.tau_m * self.sampling_period:.3g} s); "
        )
        advised = f"{self.period_range[0]:.3g} to {self.period_range[1]:.3g} s"
        if self.tau_m < ACCEPTABLE[0]:
            return (
                f"{memory}the sampling period of {self.sampling_period:.3g} s is too long for its dynamics. "
                f"Record again with a period of {advised}; no treatment of this record brings back what lies "
                "between its samples."
            )
        if self.decimation == 1:
            return (
                f"{memory}the sampling period of {self.sampling_period:.3g} s suits it (advised: {advised})."
            )
        return (
            f"{memory}the sampling period of {self.sampling_period:.3g} s is short for it: neighbouring "
            "samples are nearly equal, which harms the choice of terms. "
            f"Record again with a period of {advised}, or keep every {self.decimation}th sample after a "
            "low-pass filter. Do not decimate data with hysteresis: their models get worse with any "
            "decimation; record those again, or keep the period."
        )

    def __str__(self):
        return self.verdict


def sampling_advice(y, sampling_period, *, max_lag=None, sessions=None):
    r"""Advise a sampling period by the linear and nonlinear correlation of the output.

    With the autocorrelations of the centred output and of its centred square,

    .. math:: \Phi_{yy}(\tau) = E[y'_k y'_{k-\tau}], \qquad
        \Phi_{y^{2'}y^{2'}}(\tau) = E[y^{2'}_k y^{2'}_{k-\tau}],

    and tau_m the smaller of their first minima, the period should lie between tau_m / 20 and tau_m / 10.
    Sampled faster, y[k-1] nearly equals y[k] and takes the place of every other term; slower, dynamics
    are lost.

    Parameters
    ----------
    y : array-like of shape (n_samples,)
        One measured output; NaN marks gaps.
    sampling_period : float
        Its sampling period, in seconds.
    max_lag : int, default=None
        Largest lag to look at, in samples. None: a quarter of the longest unbroken segment.
    sessions : array-like of shape (n_samples,), default=None
        Label of the recording each sample belongs to; no product reaches across an edge or a gap.

    Returns
    -------
    advice : SamplingAdvice
        Memory, ranges, decimation factor and a verdict in words.

    Raises
    ------
    ValueError
        If ``y`` is constant, has several columns or infinite values, the sampling period is not positive,
        or no unbroken segment is longer than ``max_lag`` (without it, 20 samples).

    Notes
    -----
    The output is centred before it is squared, so that an offset does not matter. A minimum counts when the
    autocorrelation rises from it by at least two standard errors of a white signal's,
    :math:`2/\sqrt{N}`, so that ripple from noise is passed over. The decimation
    factor is the smallest that enters the advised range, because decimation loses information;
    Lacerda Junior et al. found any decimation to worsen models of hysteretic systems.

    References
    ----------
    Billings, S. A. and Aguirre, L. A. (1995). Effects of the sampling time on the dynamics and
    identification of nonlinear models. International Journal of Bifurcation and Chaos, 5(6), 1541-1556.

    Lacerda Junior, W. R., Martins, S. A. M. and Nepomuceno, E. G. (2017). Influence of sampling rate and
    discretization methods in the parameter identification of systems with hysteresis. Journal of Applied
    Nonlinear Dynamics, 6(4), 509-520.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.analysis.sampling import sampling_advice
    >>> t = np.arange(0, 20, 0.001)  # s
    >>> advice = sampling_advice(np.sin(2 * np.pi * t), 0.001)
    >>> advice.tau_y, advice.tau_y2  # half a period and, but for the edges of the record, a quarter
    (500, 249)
    >>> advice.decimation
    13
    """
    y = as_signals(y, "y")
    if y.shape[1] != 1:
        raise ValueError(f"y has {y.shape[1]} columns; ask for advice once per output.")
    y = y[:, 0]
    if not sampling_period > 0.0:
        raise ValueError(f"sampling_period is {sampling_period!r}, but a positive time in seconds is wanted.")
    segments = finite_slices(session_slices(sessions, y.size), np.isfinite(y))
    longest = max((segment.stop - segment.start for segment in segments), default=0)
    wanted = 20 if max_lag is None else max_lag
    if longest <= wanted:
        raise ValueError(
            f"The longest unbroken segment of y has {longest} samples, but more than {wanted} are wanted. "
            "Pass a longer record or a smaller max_lag."
        )
    max_lag = longest // 4 if max_lag is None else max_lag

    mean = np.nanmean(y)
    if np.nanstd(y) <= 1e-12 * np.nanmax(np.abs(y)):
        raise ValueError(f"y is constant ({mean:g}): it has no dynamics to sample. Pass a record that moves.")
    pieces = [y[segment] - mean for segment in segments]
    mean_square = np.concatenate(pieces).var()
    linear = _autocorrelation(pieces, max_lag)
    square = _autocorrelation([piece**2 - mean_square for piece in pieces], max_lag)
    tau_y, tau_y2 = (_first_minimum(phi, sum(map(len, pieces))) for phi in (linear, square))
    tau_m = min(tau_y, tau_y2)
    return SamplingAdvice(
        sampling_period=sampling_period,
        tau_y=tau_y,
        tau_y2=tau_y2,
        tau_m=tau_m,
        found=tau_m < max_lag,
        period_range=_periods(tau_m * sampling_period, ADVISED),
        loose_period_range=_periods(tau_m * sampling_period, ACCEPTABLE),
        decimation=-(-tau_m // ADVISED[1]) if ACCEPTABLE[1] < tau_m < max_lag else 1,
        autocorrelation=np.column_stack([linear, square]),
    )


def _autocorrelation(pieces, max_lag):
    """Sum the autocorrelations of the pieces; zero throughout for a vanishing signal."""
    total = np.zeros(max_lag + 1)
    for piece in pieces:
        phi = correlate(piece, piece, method="auto")[piece.size - 1 :][: max_lag + 1]
        total[: phi.size] += phi
    return total / total[0] if total[0] > 0.0 else total


def _first_minimum(phi, n_samples):
    """Return the lag of the first minimum that rises again by 2 / sqrt(n_samples); else the last lag."""
    minima, _ = find_peaks(-phi, prominence=2.0 / np.sqrt(n_samples))
    return int(minima[0]) if minima.size else phi.size - 1


def _periods(memory, samples):
    fewest, most = samples
    return memory / most, memory / fewest

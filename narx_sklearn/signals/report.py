"""What an excitation signal excites: band, amplitudes, persistence of excitation."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import qr, svdvals

from narx_sklearn.signals._checks import check_count, check_positive, check_vector

__all__ = ["SignalReport", "describe_signal"]

POWER_SHARE = 0.95  # share of the power inside the reported band
BLOCK_ROWS = 2048  # windows factored at a time: under a megabyte, which stays in the cache


@dataclass(frozen=True)
class SignalReport:
    """Figures of an excitation signal, made by `describe_signal`; its text form is ``str(report)``.

    Attributes
    ----------
    n_samples : int
        Length of the signal.
    sampling_period : float
        Sampling period, in seconds.
    minimum, maximum, mean, rms : float
        Extreme values, mean, and root mean square about the mean, in the unit of the signal.
    crest_factor : float
        Largest deviation from the mean over `rms`.
    band : (float, float)
        Frequencies, in Hz, below and above which 2.5 % of the power lie (mean removed).
    amplitude_coverage : float
        Share of `n_bins` equal bins between the extreme values that hold at least one sample.
    n_bins : int
        Number of these bins.
    excitation_order : int
        Order of persistence of excitation found, at most `max_order`.
    excitation_threshold : float
        What an order had to exceed: smallest over largest singular value of the matrix of lagged signals.
    max_order : int
        Largest order tried.
    """

    n_samples: int
    sampling_period: float
    minimum: float
    maximum: float
    mean: float
    rms: float
    crest_factor: float
    band: tuple[float, float]
    amplitude_coverage: float
    n_bins: int
    excitation_order: int
    excitation_threshold: float
    max_order: int

    def __str__(self):
        more = " or more" if self.excitation_order == self.max_order else ""
        return "\n".join(
            [
                f"{self.n_samples} samples of {self.sampling_period:g} s "
                f"({self.n_samples * self.sampling_period:g} s)",
                f"values from {self.minimum:.4g} to {self.maximum:.4g}, mean {self.mean:.4g}, "
                f"rms {self.rms:.4g}, crest factor {self.crest_factor:.3g}",
                f"{POWER_SHARE:.0%} of the power between {self.band[0]:.4g} and {self.band[1]:.4g} Hz",
                f"{self.amplitude_coverage:.0%} of {self.n_bins} amplitude bins visited",
                f"persistently exciting of order {self.excitation_order}{more} "
                f"(singular values above {self.excitation_threshold:g} of the largest)",
            ]
        )


def describe_signal(
    u, sampling_period: float, *, n_bins: int = 20, max_order: int = 50, threshold: float = 1e-6
) -> SignalReport:
    """Report band, amplitude coverage and persistence of excitation of a signal.

    A signal is persistently exciting of order n when n delayed copies of it are linearly independent; then
    a linear model with n input lags can be told apart from every other. Sums of m sines have order 2 m, a
    constant adds one. Every real record is independent at some level, so a threshold decides.

    Parameters
    ----------
    u : array-like of shape (n_samples,)
        Signal, not constant, at least 2 samples.
    sampling_period : float
        Sampling period, in seconds.
    n_bins : int, default=20
        Bins between the extreme values that count as amplitudes covered.
    max_order : int, default=50
        Largest order of excitation tried; half the signal's length if that is less.
    threshold : float, default=1e-6
        Smallest over largest singular value of the lagged copies that counts as independent. The level of
        the measurement noise relative to the signal is a good choice.

    Returns
    -------
    SignalReport

    Raises
    ------
    ValueError
        If `u` is constant, not one-dimensional, or not finite.

    References
    ----------
    Ljung (1999), System Identification: Theory for the User, section 13.2.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.signals import describe_signal
    >>> k = np.arange(1000)
    >>> report = describe_signal(np.sin(0.1 * k) + np.sin(0.37 * k), sampling_period=1.0)
    >>> report.excitation_order
    4
    """
    u = check_vector(u, "u", smallest_size=2)
    sampling_period = check_positive(sampling_period, "sampling_period")
    n_bins = check_count(n_bins, "n_bins")
    max_order = min(check_count(max_order, "max_order"), u.size // 2)
    threshold = check_positive(threshold, "threshold")
    minimum, maximum, mean = float(u.min()), float(u.max()), float(u.mean())
    if minimum == maximum:
        raise ValueError(f"u is constant ({minimum:g}) and excites nothing; pass a signal that moves.")
    deviation = u - mean
    rms = float(np.sqrt(np.mean(deviation**2)))
    counts, _ = np.histogram(u, bins=n_bins)
    return SignalReport(
        n_samples=u.size,
        sampling_period=sampling_period,
        minimum=minimum,
        maximum=maximum,
        mean=mean,
        rms=rms,
        crest_factor=float(np.abs(deviation).max() / rms),
        band=_power_band(deviation, sampling_period),
        amplitude_coverage=float(np.mean(counts > 0)),
        n_bins=n_bins,
        excitation_order=_excitation_order(u, max_order, threshold),
        excitation_threshold=threshold,
        max_order=max_order,
    )


def _power_band(deviation: np.ndarray, sampling_period: float) -> tuple[float, float]:
    power = np.abs(np.fft.rfft(deviation)) ** 2
    power[0] = 0.0
    if deviation.size % 2 == 0:
        power[-1] /= 2  # the line at half the sampling frequency has no mirror image
    cumulated = np.cumsum(power) / power.sum()
    edge = 0.5 * (1.0 - POWER_SHARE)
    frequencies = np.fft.rfftfreq(deviation.size, sampling_period)
    low, high = np.searchsorted(cumulated, [edge, 1.0 - edge])
    return float(frequencies[low]), float(frequencies[high])


def _excitation_order(u: np.ndarray, max_order: int, threshold: float) -> int:
    # The triangular factor R of the lagged copies has their singular values; its leading n x n block those
    # of the first n copies. Blocks of windows are stacked under R, so that no tall matrix is held.
    windows = sliding_window_view(u, max_order)
    R = np.empty((0, max_order))
    for start in range(0, windows.shape[0], BLOCK_ROWS):
        stacked = np.vstack([R, windows[start : start + BLOCK_ROWS]])
        R = qr(stacked, mode="r", overwrite_a=True, check_finite=False)[0][:max_order]
    for n in range(1, max_order + 1):
        singular = svdvals(R[:n, :n], check_finite=False)
        if singular[-1] <= threshold * singular[0]:
            return n - 1
    return max_order

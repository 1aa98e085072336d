"""Pseudo random filtered signal (PRFS): smooth random excitation for systems with hysteresis."""

import numpy as np
from scipy.signal import butter, sosfilt
from sklearn.utils import check_random_state

from narx_sklearn.signals._checks import check_count, check_positive, check_vector

__all__ = ["prfs"]

FILTER_ORDER = 5  # Butterworth, as in the reference


def prfs(
    n_samples,
    frequencies,
    sampling_period: float,
    *,
    operating_points=0.0,
    amplitudes=1.0,
    final_cutoff: float | None = None,
    random_state=None,
) -> np.ndarray:
    """Generate a pseudo random filtered signal: low-pass noise at chosen operating points.

    For each frequency ``f_i`` white noise passes a fifth-order Butterworth low-pass with that cutoff and is
    scaled to reach -1 and 1. Its ``v`` equal parts are placed at the operating points, ``G_j b + o_j``. The
    parts are joined and the whole is low-passed once more, so that the joints have no jump. Input rates
    stay moderate and both directions are covered everywhere, which systems with hysteresis need.

    Parameters
    ----------
    n_samples : int or sequence of int of shape (n_frequencies,)
        Samples ``N_i`` for each frequency; an integer is the total length, shared equally. Each ``N_i`` must
        be a multiple of the number of operating points.
    frequencies : float or sequence of float of shape (n_frequencies,)
        Cutoff frequencies ``f_i``, in Hz, below half the sampling frequency.
    sampling_period : float
        Sampling period, in seconds.
    operating_points : float or sequence of float, default=0.0
        Operating points ``o_j``, in the unit of the input.
    amplitudes : float or sequence of float, default=1.0
        Largest excursion ``G_j`` from each operating point, in the unit of the input; one number serves all.
    final_cutoff : float or None, default=None
        Cutoff of the last filter, in Hz. None takes twice the highest frequency; from half the sampling
        frequency on (or ``np.inf``) there is nothing to remove and no filter is run.
    random_state : int, RandomState instance or None, default=None
        Seed; None draws another signal each time.

    Returns
    -------
    ndarray of shape (n_samples,)

    Raises
    ------
    ValueError
        If a frequency reaches half the sampling frequency, lengths disagree, or samples cannot be shared
        out equally.

    See Also
    --------
    prvs : A sequence of steps.

    Notes
    -----
    All filters start from zero state, so the last one begins at 0 and rises to the first operating point
    within about a period of its cutoff. Without the last filter the signal stays within ``o_j -+ G_j``; the
    filter may exceed these limits a little. Clip the signal where the machine has a hard limit.

    References
    ----------
    Tavares (2020); Abreu (2021), eqs. (2.22)-(2.25).

    Examples
    --------
    >>> from narx_sklearn.signals import prfs
    >>> u = prfs(50_000, 1.0, 0.001, amplitudes=80.0, random_state=0)
    >>> bool(abs(u).max() > 70)
    True
    """
    sampling_period = check_positive(sampling_period, "sampling_period")
    nyquist = 0.5 / sampling_period
    cutoffs = check_vector(frequencies, "frequencies")
    if np.any(cutoffs <= 0) or np.any(cutoffs >= nyquist):
        raise ValueError(
            f"frequencies must lie between 0 and half the sampling frequency, {nyquist:g} Hz, got "
            f"{cutoffs.tolist()}."
        )
    centres = check_vector(operating_points, "operating_points")
    gains = check_vector(amplitudes, "amplitudes")
    gains = np.full(centres.size, gains[0]) if gains.size == 1 else gains
    if gains.size != centres.size or np.any(gains <= 0):
        raise ValueError(
            f"amplitudes must be positive, one for all or one for each of the {centres.size} operating "
            f"points, got {gains.tolist()}."
        )
    lengths = _share_samples(n_samples, cutoffs.size, centres.size)
    rng = check_random_state(random_state)
    parts = []
    for cutoff, length in zip(cutoffs, lengths, strict=True):
        noise = _low_pass(rng.standard_normal(length), cutoff, sampling_period)
        noise = 2.0 * (noise - noise.min()) / (noise.max() - noise.min()) - 1.0  # (2.23)
        parts.append((gains[:, None] * noise.reshape(centres.size, -1) + centres[:, None]).ravel())
    u = np.concatenate(parts)
    cutoff = 2.0 * cutoffs.max() if final_cutoff is None else float(final_cutoff)
    if not cutoff > 0:
        raise ValueError(f"final_cutoff must be positive, None or np.inf, got {final_cutoff!r}.")
    return _low_pass(u, cutoff, sampling_period) if cutoff < nyquist else u


def _share_samples(n_samples, n_frequencies: int, n_points: int) -> list[int]:
    """Return the samples N_i of each frequency."""
    if np.ndim(n_samples) == 0:
        total = check_count(n_samples, "n_samples", smallest=2)
        if total % (n_frequencies * n_points):
            raise ValueError(
                f"n_samples={total} cannot be shared equally by {n_frequencies} frequencies and {n_points} "
                f"operating points; pass a multiple of {n_frequencies * n_points}."
            )
        return [total // n_frequencies] * n_frequencies
    lengths = [check_count(n, "n_samples", smallest=2) for n in n_samples]
    if len(lengths) != n_frequencies:
        raise ValueError(f"n_samples has {len(lengths)} values for {n_frequencies} frequencies.")
    for n in lengths:
        if n % n_points:
            raise ValueError(
                f"n_samples holds {n}, which is no multiple of the {n_points} operating points that share it."
            )
    return lengths


def _low_pass(x: np.ndarray, cutoff: float, sampling_period: float) -> np.ndarray:
    # Second-order sections: the polynomial form loses all digits at cutoffs far below the sampling frequency.
    return sosfilt(butter(FILTER_ORDER, cutoff, fs=1.0 / sampling_period, output="sos"), x)

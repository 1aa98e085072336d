"""Multisine: a periodic signal with a flat spectrum on chosen lines."""

import warnings

import numpy as np
from sklearn.utils import check_random_state

from narx_sklearn._validation import check_choice
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.signals._checks import check_count, check_positive

__all__ = ["multisine"]


def multisine(
    n_samples: int,
    sampling_period: float,
    *,
    band: tuple[float, float] | None = None,
    lines: str = "full",
    phases: str = "random",
    rms: float = 1.0,
    n_periods: int = 1,
    random_state=None,
) -> np.ndarray:
    """Generate a multisine: equal sines on a grid of frequencies, repeated without a joint.

    ``u[k] = c sum_m cos(2 pi m k / n_samples + p_m)`` over the excited lines m. Since it is periodic, the
    response shows noise and nonlinear distortion apart from the linear response; with odd lines only, even
    distortions fall on lines that were not excited.

    Parameters
    ----------
    n_samples : int
        Samples in one period, at least 3; the lines are ``1 / (n_samples * sampling_period)`` apart.
    sampling_period : float
        Sampling period, in seconds.
    band : (float, float) or None, default=None
        Lowest and highest frequency, in Hz, both included; None takes all lines strictly between zero and
        half the sampling frequency. An infinite highest one ends there too.
    lines : {"full", "odd"}, default="full"
        Excite all lines of the band, or those with an odd number.
    phases : {"random", "schroeder"}, default="random"
        Random phases give nearly Gaussian amplitudes, Schroeder's a low crest factor.
    rms : float, default=1.0
        Root mean square of the signal, in the unit of the input.
    n_periods : int, default=1
        Number of periods.
    random_state : int, RandomState instance or None, default=None
        Seed of the random phases.

    Returns
    -------
    ndarray of shape (n_samples * n_periods,)

    Raises
    ------
    ValueError
        If a choice is unknown, or the band holds no line.

    Warns
    -----
    NarxWarning
        If the band reaches beyond half the sampling frequency, where it is cut.

    References
    ----------
    Schroeder (1970), IEEE Trans. Information Theory 16, 85-89; Pintelon and Schoukens (2012), System
    Identification: A Frequency Domain Approach, chapters 2 and 5.

    Examples
    --------
    >>> from narx_sklearn.signals import multisine
    >>> u = multisine(1000, 0.001, band=(1, 100), phases="schroeder")
    >>> round(float(abs(u).max()), 2)
    1.66
    """
    n_samples = check_count(n_samples, "n_samples", smallest=3)
    sampling_period = check_positive(sampling_period, "sampling_period")
    rms = check_positive(rms, "rms")
    n_periods = check_count(n_periods, "n_periods")
    check_choice(lines, "lines", ("full", "odd"))
    check_choice(phases, "phases", ("random", "schroeder"))
    numbers = np.arange(1, (n_samples - 1) // 2 + 1)
    if lines == "odd":
        numbers = numbers[numbers % 2 == 1]
    spacing = 1.0 / (n_samples * sampling_period)
    if band is not None:
        lowest, highest = band
        slack = 1e-9 * spacing  # a band edge on a line includes it, whatever the rounding of the edge
        numbers = numbers[(numbers * spacing >= lowest - slack) & (numbers * spacing <= highest + slack)]
    if numbers.size == 0:
        raise ValueError(
            f"No {lines} line lies in the band {band!r} Hz: lines are {spacing:g} Hz apart and end below "
            f"{0.5 / sampling_period:g} Hz. Widen the band or lengthen the period."
        )
    nyquist = 0.5 / sampling_period
    if band is not None and nyquist + slack < highest < np.inf:
        warnings.warn(
            f"The band ({lowest:g}, {highest:g}) Hz is cut at {nyquist:g} Hz, half the sampling frequency: "
            f"the signal ends at {numbers[-1] * spacing:g} Hz. For a wider one pass a sampling period below "
            f"{0.5 / highest:g} s.",
            NarxWarning,
            stacklevel=2,
        )
    order = np.arange(numbers.size)
    if phases == "random":
        angles = check_random_state(random_state).uniform(0.0, 2.0 * np.pi, numbers.size)
    else:
        angles = -np.pi * order * (order + 1) / numbers.size
    spectrum = np.zeros(n_samples // 2 + 1, dtype=complex)
    spectrum[numbers] = np.exp(1j * angles)
    period = np.fft.irfft(spectrum, n_samples)
    return np.tile(period * (rms / np.sqrt(np.mean(period**2))), n_periods)

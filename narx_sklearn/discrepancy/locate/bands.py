"""Which frequencies: where the residual's spectrum stands above the noise."""

import numpy as np
import pandas as pd
from scipy.signal import welch
from scipy.stats import chi2, f, false_discovery_control

from narx_sklearn._validation import finite_slices

LEVEL = 0.01  # false discovery rate at which one is kept
QUIET = 0.25  # of the bands: the quietest make the noise floor when none is given
FEWEST_LINES = 3  # of a band


def bands(
    residual: np.ndarray,
    y: np.ndarray,
    dt: float,
    *,
    sigma: float | None = None,
    rho: float = 0.0,
    n_bands: int = 16,
) -> pd.DataFrame:
    r"""Compare the residual's spectrum with the noise's and with the output's, band by band.

    .. math:: S_e(f) = \sigma^2 \frac{2\,\Delta t\,(1-\rho^2)}{|1 - \rho e^{-2\pi i f \Delta t}|^2}

    Parameters
    ----------
    residual, y : ndarray of shape (n_samples,)
        Residual and measured output, one unit; NaN is skipped.
    dt : float
        Sampling period, s.
    sigma : float, optional
        Standard deviation of the noise; when not given, the quietest quarter of the bands is taken for noise.
    rho : float, default=0.0
        Correlation of the noise from one sample to the next.
    n_bands : int, default=16
        Bands, equally wide on a logarithmic scale where lines suffice.

    Returns
    -------
    DataFrame
        ``f_low``, ``f_high`` in Hz, ``share`` of the residual's energy, ``relative`` to the output's energy
        in the band, ``excess`` over the noise floor (1 is noise), ``p_value`` (adjusted), ``kept``. Empty
        when the record is too short for a spectrum.

    References
    ----------
    .. [1] P. Welch, 1967, the use of fast Fourier transform for the estimation of power spectra.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.locate import bands
    >>> rng, t = np.random.default_rng(0), np.arange(8000) * 0.01
    >>> residual = 0.1 * rng.normal(size=t.size) + 0.1 * np.sin(2 * np.pi * 5 * t)
    >>> table = bands(residual, np.sin(t), 0.01)
    >>> loud = table[table["kept"]].iloc[0]
    >>> bool(loud["f_low"] < 5.0 < loud["f_high"])
    True
    """
    columns = ["f_low", "f_high", "share", "relative", "excess", "p_value", "kept"]
    known = np.isfinite(residual) & np.isfinite(y)
    pieces = finite_slices([slice(0, residual.size)], known)
    longest = max((piece.stop - piece.start for piece in pieces), default=0)
    length = int(min(longest, max(64, residual.size // 16), 4096))
    length -= length % 2  # halves overlap
    if length < 32:
        return pd.DataFrame(columns=columns)
    power, count = np.zeros((2, length // 2 + 1)), 0
    for piece in pieces:
        samples = piece.stop - piece.start
        if samples < length:
            continue
        segments = 1 + (samples - length) // (length // 2)
        for row, signal in enumerate((residual, y)):
            power[row] += segments * welch(signal[piece], 1 / dt, nperseg=length, detrend="constant")[1]
        count += segments
    frequency = np.fft.rfftfreq(length, dt)[1:]
    power = power[:, 1:] / count
    shape = 1 / np.abs(1 - rho * np.exp(-2j * np.pi * frequency * dt)) ** 2
    edges = _edges(frequency.size, n_bands)
    lines = np.diff(edges)
    level = np.add.reduceat(power[0] / shape, edges[:-1]) / lines
    # Hann windows half overlapped: averages count for 9/11, and neighbouring lines for half
    degrees = np.maximum(lines * max(count * 9 / 11, 1.0), 2.0)
    if sigma is None:
        quiet = np.argsort(level)[: max(1, round(QUIET * level.size))]
        floor = float(np.average(level[quiet], weights=lines[quiet]))
        p = f.sf(level / floor, degrees, degrees[quiet].sum())
    else:
        floor = 2 * dt * sigma**2 * (1 - rho**2)
        p = chi2.sf(degrees * level / floor, degrees)
    sums = np.add.reduceat(power, edges[:-1], axis=1)
    table = pd.DataFrame(
        {
            "f_low": frequency[edges[:-1]] - 0.5 * frequency[0],
            "f_high": frequency[edges[1:] - 1] + 0.5 * frequency[0],
            "share": sums[0] / max(sums[0].sum(), 1e-300),
            "relative": sums[0] / np.maximum(sums[1], 1e-300),
            "excess": level / max(floor, 1e-300),
            "p_value": false_discovery_control(np.clip(p, 0.0, 1.0)),
        }
    )
    table["kept"] = table["p_value"] <= LEVEL
    return table


def _edges(n_lines: int, n_bands: int) -> np.ndarray:
    """Return the first line of each band and one past the last; each has a few lines at least."""
    wanted = np.geomspace(1, n_lines + 1, n_bands + 1) - 1
    edges = [0]
    for edge in wanted[1:-1].round().astype(int):
        if edge - edges[-1] >= FEWEST_LINES and n_lines - edge >= FEWEST_LINES:
            edges.append(int(edge))
    return np.array([*edges, n_lines])

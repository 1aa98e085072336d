"""The estimated curve of an unknown force."""

import numpy as np
import pandas as pd

MEDIAN_SPREAD = 1.2533  # standard error of a median over that of a mean, Gaussian
CONFIDENCE = 1.96  # standard errors to either side: 95 %
FEWEST = 5  # samples in a bin


def force_curve(w: np.ndarray, argument: np.ndarray, *, w_std=None, n_bins: int = 25) -> pd.DataFrame:
    """Draw an unknown force against a signal: medians in bins, with 95 % intervals.

    Samples of one visit to a bin are near copies of each other, so the interval counts visits, not samples.

    Parameters
    ----------
    w : ndarray of shape (n_samples,)
        Force, as smoothed at its port; NaN is skipped.
    argument : ndarray of shape (n_samples,)
        The signal it is drawn against.
    w_std : ndarray of shape (n_samples,), optional
        Standard deviation of ``w``; samples where it exceeds three times its median are left out.
    n_bins : int, default=25
        Bins with equally many samples, of at least half the width that equal ones would have.

    Returns
    -------
    DataFrame
        ``argument`` (median in the bin), ``force``, ``low``, ``high``, ``spread`` (standard deviation
        within the bin), ``count``, ``visits``.

    Raises
    ------
    ValueError
        If fewer than 5 samples are known in both.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.locate import force_curve
    >>> x = np.sin(np.arange(5000) / 30)
    >>> curve = force_curve(x**3 + 0.01 * np.random.default_rng(0).normal(size=x.size), x)
    >>> bool(np.abs(curve["force"] - curve["argument"] ** 3).max() < 0.02)
    True
    """
    known = np.isfinite(w) & np.isfinite(argument)
    if w_std is not None:
        known &= w_std <= 3 * np.nanmedian(w_std)
    samples = np.flatnonzero(known)
    if samples.size < FEWEST:
        raise ValueError(
            f"w and argument are both known at {samples.size} samples only; a curve takes at least {FEWEST}."
        )
    force, place = w[samples], argument[samples]
    edges = _edges(place, n_bins)
    bins = np.clip(np.searchsorted(edges, place, side="right") - 1, 0, edges.size - 2)
    visits = np.concatenate([[True], (np.diff(bins) != 0) | (np.diff(samples) > 1)])
    rows = []
    for b in range(edges.size - 1):
        here = bins == b
        count, entries = int(here.sum()), int((here & visits).sum())
        if count < FEWEST:
            continue
        middle, spread = np.median(force[here]), np.std(force[here])
        error = CONFIDENCE * MEDIAN_SPREAD * spread / np.sqrt(entries)
        rows.append((np.median(place[here]), middle, middle - error, middle + error, spread, count, entries))
    return pd.DataFrame(rows, columns=["argument", "force", "low", "high", "spread", "count", "visits"])


def _edges(place: np.ndarray, n_bins: int) -> np.ndarray:
    """Return edges at quantiles, thinned where they lie closer than half an equal width."""
    quantiles = np.quantile(place, np.linspace(0, 1, n_bins + 1))
    least = 0.5 * (quantiles[-1] - quantiles[0]) / n_bins
    edges = [quantiles[0]]
    for q in quantiles[1:-1]:
        if q - edges[-1] >= least and quantiles[-1] - q >= least:
            edges.append(q)
    return np.array([*edges, quantiles[-1]])

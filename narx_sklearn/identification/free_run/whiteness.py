"""Whether one-step residuals are white, which is when least squares is the right estimate."""

import numpy as np
from scipy.stats import chi2

from narx_sklearn._validation import session_slices

N_LAGS = 20
LEVEL = 1e-3  # of the test: structural error colours residuals far beyond it


def is_white(residuals: np.ndarray, sessions=None) -> bool:
    """Test residuals for autocorrelation (Ljung and Box 1978).

    Parameters
    ----------
    residuals : ndarray of shape (n_samples,)
        One-step residuals; NaN where there is none.
    sessions : array-like of shape (n_samples,), default=None
        One label a sample; products never cross an edge.

    Returns
    -------
    bool
        False where whiteness is rejected at a level of 0.001.
    """
    known = np.isfinite(residuals)
    n = int(known.sum())
    n_lags = min(N_LAGS, n // 10)
    if n_lags < 1:
        return True
    e = np.where(known, residuals - residuals[known].mean(), 0.0)
    power = float(e @ e)
    if not power > 0.0:
        return True
    pieces = session_slices(sessions, e.size)
    statistic = 0.0
    for lag in range(1, n_lags + 1):
        product = sum(float(e[p][lag:] @ e[p][:-lag]) for p in pieces if p.stop - p.start > lag)
        statistic += n * (n + 2) * (product / power) ** 2 / (n - lag)
    return bool(statistic <= chi2.ppf(1.0 - LEVEL, n_lags))

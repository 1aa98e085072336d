"""Exact binomial bounds and calibration."""

import numpy as np
from scipy.stats import beta

__all__ = ["calibration_bins", "clopper_pearson", "error_of_right_confidence", "expected_calibration_error"]

DRAWS = 2000


def clopper_pearson(successes: int, trials: int, level: float = 0.95) -> tuple[float, float]:
    """Return the exact two-sided bounds of a proportion.

    Examples
    --------
    >>> low, high = clopper_pearson(0, 300)
    >>> low, round(high, 4)
    (0.0, 0.0122)
    """
    tail = (1.0 - level) / 2.0
    low = float(beta.ppf(tail, successes, trials - successes + 1)) if successes > 0 else 0.0
    high = float(beta.ppf(1.0 - tail, successes + 1, trials - successes)) if successes < trials else 1.0
    return low, high


def calibration_bins(confidence, right, n_bins: int = 10):
    """Return (mean confidence, share right, count) of the non-empty bins, an array of shape (n, 3).

    Examples
    --------
    >>> calibration_bins([0.9, 0.92, 0.1], [1, 0, 0]).round(2).tolist()
    [[0.1, 0.0, 1.0], [0.91, 0.5, 2.0]]
    """
    confidence, right = np.asarray(confidence, dtype=float), np.asarray(right, dtype=float)
    bins = np.minimum((confidence * n_bins).astype(int), n_bins - 1)
    rows = [
        (confidence[bins == b].mean(), right[bins == b].mean(), np.sum(bins == b)) for b in np.unique(bins)
    ]
    return np.array(rows, dtype=float).reshape(-1, 3)


def expected_calibration_error(confidence, right, n_bins: int = 10) -> float:
    """Return the mean distance of confidence from the share right, weighted by the bins' counts.

    Examples
    --------
    >>> round(expected_calibration_error([0.9, 0.92, 0.1], [1, 0, 0]), 3)
    0.307
    """
    rows = calibration_bins(confidence, right, n_bins)
    return float(np.sum(np.abs(rows[:, 0] - rows[:, 1]) * rows[:, 2]) / np.sum(rows[:, 2]))


def error_of_right_confidence(confidence, n_bins: int = 10) -> float:
    """Return the mean calibration error of as many cases whose confidence is right: few cases scatter.

    Examples
    --------
    >>> round(error_of_right_confidence([0.95] * 20), 2), round(error_of_right_confidence([0.95] * 2000), 3)
    (0.04, 0.004)
    """
    confidence, rng = np.asarray(confidence, dtype=float), np.random.default_rng(0)
    draws = (rng.random(confidence.size) < confidence for _ in range(DRAWS))
    return float(np.mean([expected_calibration_error(confidence, right, n_bins) for right in draws]))

"""Piecewise linear bases: a smooth function of one signal as a sum of hats."""

import numpy as np

N_KNOTS = 7  # over the range of a signal, unless fewer are asked for
NEAR_ZERO = 0.02  # of the range: a pair of knots this close to zero lets a curve jump or turn there


def knots_of(signal: np.ndarray, n_knots: int) -> np.ndarray:
    """Return knots over the range of a signal, denser at zero; fewer than two for a constant signal."""
    low, high = np.nanquantile(signal, [0.002, 0.998])
    if not high - low > 1e-9 * max(abs(low), abs(high)):
        return np.array([low])
    knots = np.linspace(low, high, n_knots)
    near = NEAR_ZERO * (high - low)
    if low + near < 0 < high - near:
        knots = np.concatenate([knots[np.abs(knots) > 2 * near], [-near, near]])
    return np.sort(knots)


def hats(signal: np.ndarray, n_knots: int = N_KNOTS) -> np.ndarray:
    """Return the hats of a signal, shape (n_samples, n_hats); they sum to one, and are constant outside."""
    knots = knots_of(signal, n_knots)
    if knots.size < 2:
        return np.ones((signal.size, 1))
    place = np.interp(signal, knots, np.arange(knots.size))
    left = np.minimum(place.astype(int), knots.size - 2)
    basis = np.zeros((signal.size, knots.size))
    rows = np.arange(signal.size)
    basis[rows, left] = 1.0 - (place - left)
    basis[rows, left + 1] = place - left
    return basis


def additive_hats(signals: np.ndarray) -> np.ndarray:
    """Return the hats of several signals side by side, the constant once."""
    parts = [hats(column) for column in signals.T]
    return np.column_stack([part if i == 0 else part[:, 1:] for i, part in enumerate(parts)])

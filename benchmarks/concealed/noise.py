"""Measurement noise of unit root mean square: white, coloured, drifting."""

import numpy as np
from scipy.signal import lfilter

__all__ = ["NOISES", "draw_noise", "stands_out", "whitened"]

POLE = 0.9  # of the coloured noise
NOISES = ("white", "ar1", "drifting", "quantised")


def draw_noise(kind, n, n_outputs, rng):
    """Return noise of shape (n, n_outputs); of "quantised" only its white part."""
    white = rng.standard_normal((n, n_outputs))
    if kind == "ar1":
        white = lfilter([1.0], [1.0, -POLE], white, axis=0)
    elif kind == "drifting":  # a random walk that ends about as large as the white part
        walk = np.cumsum(rng.standard_normal((n, n_outputs)), axis=0)
        white = 0.8 * white + 0.6 * (walk - walk[0]) / np.sqrt(n / 2.0)
    white /= np.sqrt(np.mean(white**2, axis=0))
    return 0.3 * white if kind == "quantised" else white


def whitened(signal, kind):
    """Return a signal as it is when noise of unit rms is made white; a drift is taken for white."""
    if kind == "ar1":
        signal = lfilter([1.0, -POLE], [1.0], signal, axis=0)[1:] / np.sqrt(1.0 - POLE**2)
    return signal


def stands_out(signal, kind):
    """Return by how many standard errors a signal, known but for its size, stands out of noise of unit rms.

    The colour of the noise is known too; a drift is taken for white, which flatters.
    """
    return float(np.sqrt(np.sum(whitened(signal, kind) ** 2)))

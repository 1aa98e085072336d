"""Surrogate residuals: what the residuals could have been, had they nothing to do with the input.

White residuals are exchangeable: any order of them is as likely as the recorded one, whatever their
distribution. Coloured residuals are not, but the innovations of their autoregressive model are; a
surrogate is then that model driven by shuffled innovations.
"""

from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from narx_sklearn._validation import finite_slices, session_slices

BURN_IN = 1000  # samples for the transient of the noise filter; poles up to 0.995 have decayed below 1 %


class NoiseModel(NamedTuple):
    """Autoregressive model ``sum_i a[i] xi[k - i] = e[k]`` with ``a[0] = 1``, and the e it found."""

    a: np.ndarray
    innovations: np.ndarray

    @property
    def order(self):
        """Number of past residuals the model uses; 0 for white residuals."""
        return self.a.size - 1


def segment_reach(valid, sessions=None):
    """Count, for each valid sample, the samples before it in its own unbroken segment.

    A lag tau may be used at a sample if and only if ``tau <= reach``. Invalid samples are left out of
    the answer; within the reach, dropping them moves no sample against another.
    """
    segments = finite_slices(session_slices(sessions, valid.size), valid)
    lengths = [segment.stop - segment.start for segment in segments]
    return np.concatenate([np.arange(n) for n in [*lengths, 0]])


def fit_noise_model(xi, reach, max_order):
    """Fit an autoregression by Burg's recursion over all segments; BIC chooses the order.

    Burg's reflection coefficients stay inside the unit circle, so the model is always stable, and
    its poles are less biased towards zero than those of the Yule-Walker equations when xi is slow.
    """
    forward, backward = xi.copy(), xi.copy()
    a = np.ones(1)
    variance = np.mean(xi**2)
    best, best_bic = NoiseModel(a, xi), xi.size * np.log(variance)
    for order in range(1, max_order + 1):
        k = np.flatnonzero(reach >= order)
        if k.size < 10 * order:  # too few samples for one more coefficient
            break
        f, b = forward[k], backward[k - 1]
        reflection = 2.0 * (f @ b) / (f @ f + b @ b)
        variance *= 1.0 - reflection**2
        if variance <= 0.0:  # predictable to rounding, as a sine is
            break
        forward[k], backward[k] = f - reflection * b, b - reflection * f
        a = np.append(a, 0.0) - reflection * np.append(0.0, a[::-1])
        bic = xi.size * np.log(variance) + order * np.log(xi.size)
        if bic < best_bic:
            best, best_bic = NoiseModel(a, forward[k]), bic
    return best


def draw_surrogate(noise, n_samples, rng):
    """Draw centred residuals of unit variance with the colour of ``noise``."""
    if noise.order == 0:
        xi = rng.choice(noise.innovations, size=n_samples, replace=False)
    else:
        e = rng.choice(noise.innovations, size=n_samples + BURN_IN)
        xi = lfilter([1.0], noise.a, e)[BURN_IN:]
    xi = xi - xi.mean()
    return xi / np.sqrt(np.mean(xi**2))

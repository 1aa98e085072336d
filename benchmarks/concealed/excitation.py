"""Inputs of the recordings: rich ones and poor ones, all within -1 and 1."""

import numpy as np
from scipy.signal import lfilter

__all__ = ["KINDS", "POOR", "RICH", "excite"]


def _scaled(signal):
    signal = signal - signal.mean()
    return signal / np.max(np.abs(signal))


def multisine(n, dt, band, rng):
    """Sum of cosines with random phases up to `band` hertz."""
    spectrum = np.zeros(n // 2 + 1, dtype=complex)
    top = max(3, int(band * n * dt))
    lines = np.arange(1, min(top, n // 2))
    spectrum[lines] = np.exp(2j * np.pi * rng.random(lines.size))
    return _scaled(np.fft.irfft(spectrum, n))


def prfs(n, dt, band, rng):
    """Pseudo-random filtered signal: white noise through two first-order low-pass filters at `band` hertz."""
    pole = np.exp(-2.0 * np.pi * band * dt)
    x = rng.standard_normal(n + 200)
    for _ in range(2):
        x = lfilter([1.0 - pole], [1.0, -pole], x)
    return _scaled(x[200:])


def prvs(n, dt, band, rng):
    """Pseudo-random variable steps: random levels held for random times, a fraction of 1/band on average."""
    mean_hold = max(2.0, 0.4 / (band * dt))
    signal = np.empty(n)
    k = 0
    while k < n:
        hold = max(2, int(mean_hold * (0.4 + 1.2 * rng.random())))
        signal[k : k + hold] = rng.uniform(-1.0, 1.0)
        k += hold
    return signal / np.max(np.abs(signal))


def stairs(n, dt, band, rng):
    """Steps between few levels, each held until the machine has settled."""
    hold = max(4, int(1.5 / (band * dt)))
    levels = rng.permutation(np.tile(np.linspace(-1.0, 1.0, 7), n // (7 * hold) + 1))
    return np.repeat(levels, hold)[:n]


def sine(n, dt, band, rng):
    """One tone of one amplitude: poor."""
    return np.sin(2.0 * np.pi * band * (0.15 + 0.1 * rng.random()) * np.arange(n) * dt)


def square(n, dt, band, rng):
    """Two levels only: poor, nothing between them is seen."""
    return np.sign(sine(n, dt, band, rng) + 1e-12)


def faint(n, dt, band, rng):
    """A multisine at a quarter of the swing: poor, the ends are not seen."""
    return 0.25 * multisine(n, dt, band, rng)


KINDS = {
    "multisine": multisine,
    "prfs": prfs,
    "prvs": prvs,
    "stairs": stairs,
    "sine": sine,
    "square": square,
    "faint": faint,
}
RICH = ("multisine", "prfs", "prvs")
POOR = ("sine", "square", "faint")


def excite(kind, n, dt, band, rng):
    """Return `n` samples of an input of this kind with content up to `band` hertz."""
    return KINDS[kind](n, dt, band, rng)

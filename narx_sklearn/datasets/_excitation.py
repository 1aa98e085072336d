"""Inputs of the synthetic plants, made inside where the user gives none."""

import numpy as np

__all__ = ["filtered_noise", "multisine", "point_to_point", "random_steps"]


def filtered_noise(n_samples: int, cutoff: float, sampling_period: float, rng) -> np.ndarray:
    """Return white noise through a fifth-order Butterworth low-pass, stretched to [-1, 1].

    The first five periods of the cutoff are filtered and thrown away, so that the signal does not start from
    rest.
    """
    from scipy.signal import butter, sosfilt  # here, because it is slow to import

    n_settle = round(5.0 / (cutoff * sampling_period))
    sos = butter(5, cutoff, fs=1.0 / sampling_period, output="sos")
    b = sosfilt(sos, rng.standard_normal(n_samples + n_settle))[n_settle:]
    return 2.0 * (b - b.min()) / (b.max() - b.min()) - 1.0


def multisine(n_samples: int, band: tuple[float, float], sampling_period: float, rng) -> np.ndarray:
    """Return one period of a random-phase multisine, flat in the band, of unit RMS."""
    frequencies = np.fft.rfftfreq(n_samples, sampling_period)
    excited = (frequencies >= band[0]) & (frequencies <= band[1]) & (frequencies > 0)
    if not excited.any():
        raise ValueError(
            f"No line of the multisine lies in the band {band[0]:g} to {band[1]:g} Hz: with {n_samples} "
            f"samples of {sampling_period:g} s lines are {1 / (n_samples * sampling_period):g} Hz apart. "
            "Take more samples or a wider band."
        )
    phases = np.exp(2j * np.pi * rng.uniform(size=frequencies.size))
    u = np.fft.irfft(np.where(excited, phases, 0.0), n_samples)
    return u / np.sqrt(np.mean(u**2))


def random_steps(n_samples: int, levels: tuple[float, float], hold: tuple[int, int], rng) -> np.ndarray:
    """Return steps to uniform random levels, each held for a uniform random number of samples."""
    holds: list[int] = []
    while sum(holds) < n_samples:
        holds.append(int(rng.randint(hold[0], hold[1] + 1)))
    return np.repeat(rng.uniform(*levels, size=len(holds)), holds)[:n_samples]


def point_to_point(
    n_samples: int, sampling_period: float, stroke: float, duration: tuple[float, float], rng
) -> np.ndarray:
    """Return smooth moves between random positions in [0, stroke], with a rest of a quarter after each.

    A move follows ``10 s^3 - 15 s^4 + 6 s^5``: velocity and acceleration are zero at both ends. The first
    position is zero.
    """
    pieces, position, length = [], 0.0, 0
    while length < n_samples:
        n_move = max(2, round(rng.uniform(*duration) / sampling_period))
        target = rng.uniform(0.0, stroke)
        s = np.minimum(np.arange(1, n_move + n_move // 4 + 1) / n_move, 1.0)
        pieces.append(position + (target - position) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
        position, length = target, length + s.size
    return np.concatenate([[0.0], *pieces])[:n_samples]

"""A trial: a machine that lacks nothing, recorded, and the simulation that somebody wrote of it."""

from typing import NamedTuple

import numpy as np
from numba import njit

N, FINE = 4000, 40  # samples, steps a sample


class Trial(NamedTuple):
    """A recording without noise, what may be called right, and how to make the simulation."""

    expected: tuple[str, ...]  # first names that are right; empty where nothing is missing
    u: np.ndarray
    y: np.ndarray
    simulation: dict  # of ODESimulator


def wave(rng, dt: float, low: float, high: float, size: float) -> np.ndarray:
    """Return a multisine between two frequencies, Hz."""
    f = np.fft.rfftfreq(N, dt)
    lines = np.where((f >= low) & (f <= high), np.exp(2j * np.pi * rng.random(f.size)), 0)
    signal = np.fft.irfft(lines, N)
    return size * signal / np.abs(signal).max()


def steps(rng, held: int, low: float, high: float) -> np.ndarray:
    return np.repeat(rng.uniform(low, high, N // held + 1), held)[:N]


def machine(rates, u: np.ndarray, dt: float, start) -> np.ndarray:
    """Return the states (n, n_states) of a machine whose inputs are held from sample to sample."""

    @njit
    def stepped(u, x):
        states = np.zeros((u.shape[0], x.size))
        h = dt / FINE
        for k in range(u.shape[0]):
            states[k] = x
            for _ in range(FINE):
                here = np.array(rates(x, u[k]))
                there = np.array(rates(x + h * here, u[k]))
                x = x + 0.5 * h * (here + there)
        return states

    return stepped(np.ascontiguousarray(u, dtype=float), np.array(start, dtype=float))


def in_loop(rates, control, wanted: np.ndarray, dt: float, start) -> tuple[np.ndarray, np.ndarray]:
    """Return the inputs (n, n_inputs) and states of a machine that follows what is wanted, (n, n_wanted).

    ``control(x, wanted)`` is asked once a sample; its answer is held.
    """

    @njit
    def stepped(wanted, x):
        states = np.zeros((wanted.shape[0], x.size))
        u = np.zeros((wanted.shape[0], len(control(x, wanted[0]))))
        h = dt / FINE
        for k in range(wanted.shape[0]):
            states[k] = x
            u[k] = np.array(control(x, wanted[k]))
            for _ in range(FINE):
                here = np.array(rates(x, u[k]))
                there = np.array(rates(x + h * here, u[k]))
                x = x + 0.5 * h * (here + there)
        return u, states

    return stepped(np.ascontiguousarray(wanted, dtype=float), np.array(start, dtype=float))


def named(missing: str, *same: str) -> tuple[str, ...]:
    """Return the names that are right: that of what is missing, and others of the same law."""
    return (missing, *same) if missing else ()

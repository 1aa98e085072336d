"""Transforms along a record: pieces that begin anew, gaps that are stepped over."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from narx_sklearn._validation import true_runs

SHORTEST_HOLD = 4  # samples that a sensor is stuck
FEW_HOLDS = 3  # in a record: a signal that stands more often is coarse, or rests
REPEATS = 0.02  # of the other samples, that may repeat the one before where repeats tell of a hold
BY_CHANCE = 1e-3  # stretches that values of finite resolution repeat over in a record, at most
ROUNDING = 1e-14  # of the largest value, up to which two values that were reckoned with are the same


def by_pieces(run: Callable, signal: np.ndarray, first: np.ndarray, *arguments) -> np.ndarray:
    """Apply ``run(values, *arguments) -> values`` to each piece of the signal that begins anew.

    ``run`` sees finite samples only: its memory waits where a sample is missing, which stays missing. Several
    signals may go along, shape (n_samples, n_signals).
    """
    out = np.array(signal, dtype=float)
    edges = np.unique(np.concatenate([[0], np.asarray(first, dtype=np.int64), [len(out)]]))
    for a, b in pairwise(edges):
        piece = out[a:b]
        good = np.isfinite(piece if piece.ndim == 1 else piece.sum(axis=1))
        if good.all():
            piece[:] = run(piece.copy(), *arguments)
        elif good.any():
            piece[good] = run(piece[good], *arguments)
    return out


def rates_along(values: np.ndarray, dt: float) -> np.ndarray:
    """Return how fast a piece of one signal or several moves at its samples; a single one stands still."""
    return np.gradient(values, dt, axis=0) if len(values) > 1 else np.zeros_like(values)


def time_since(first: np.ndarray, n_samples: int, dt: float) -> np.ndarray:
    """Return the time since the piece began, s, shape (n_samples,)."""
    index = np.arange(n_samples)
    began = np.zeros(n_samples, dtype=np.int64)
    first = np.asarray(first, dtype=np.int64)
    began[first[first < n_samples]] = first[first < n_samples]
    return (index - np.maximum.accumulate(began)) * dt


def held_runs(values: np.ndarray) -> list[tuple[int, int]]:
    """Return where a signal that otherwise changes from sample to sample shows the same value, [begin, end).

    Not where that is its largest or smallest value: there a sensor's range may end.
    """
    rounding = ROUNDING * np.nanmax(np.abs(values), initial=0.0)
    same = np.append(False, np.abs(np.diff(values)) <= rounding)
    runs = [(a - 1, b) for a, b in true_runs(same) if b - a + 1 >= SHORTEST_HOLD]
    held = sum(sorted(b - a - 1 for a, b in runs)[-FEW_HOLDS:])
    if not runs or same.sum() - held > REPEATS * (values.size - held):
        return []
    chance = max(same.sum() - held, 1) / values.size  # that one sample repeats the one before
    low, high = np.nanmin(values) + rounding, np.nanmax(values) - rounding
    return [
        (a, b) for a, b in runs if low < values[a] < high and values.size * chance ** (b - a - 1) < BY_CHANCE
    ]

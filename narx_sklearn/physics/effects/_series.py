"""Transforms along a record: pieces that begin anew, gaps that are stepped over."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np


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


def time_since(first: np.ndarray, n_samples: int, dt: float) -> np.ndarray:
    """Return the time since the piece began, s, shape (n_samples,)."""
    index = np.arange(n_samples)
    began = np.zeros(n_samples, dtype=np.int64)
    first = np.asarray(first, dtype=np.int64)
    began[first[first < n_samples]] = first[first < n_samples]
    return (index - np.maximum.accumulate(began)) * dt

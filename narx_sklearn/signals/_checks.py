"""Checks shared by the excitation signals."""

from numbers import Integral

import numpy as np


def check_count(value, name: str, *, smallest: int = 1) -> int:
    """Return ``value`` as an int of at least ``smallest``, or raise."""
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise TypeError(f"{name} must be an integer, got {value!r}.")
    if value < smallest:
        raise ValueError(f"{name}={value} is too small; pass at least {smallest}.")
    return int(value)


def check_positive(value, name: str) -> float:
    """Return ``value`` as a positive finite float, or raise."""
    value = float(value)
    if not (np.isfinite(value) and value > 0):
        raise ValueError(f"{name} must be positive and finite, got {value!r}.")
    return value


def check_vector(values, name: str, *, smallest_size: int = 1) -> np.ndarray:
    """Return ``values`` as a finite float vector of at least ``smallest_size`` elements, or raise."""
    vector = np.atleast_1d(np.asarray(values, dtype=float))
    if vector.ndim != 1 or vector.size < smallest_size:
        raise ValueError(
            f"{name} must be one-dimensional with at least {smallest_size} values, got shape {vector.shape}."
        )
    if not np.all(np.isfinite(vector)):
        raise ValueError(f"{name} holds NaN or infinite values; pass finite numbers.")
    return vector

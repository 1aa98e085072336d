"""Checks shared by the physics."""

import numpy as np
from sklearn.utils.validation import check_array, validate_data


def check_signal(u, name: str = "u") -> np.ndarray:
    """Return a finite float signal of shape (n_samples,), or raise; a single column counts as a signal."""
    u = check_array(u, dtype=np.float64, ensure_2d=False, input_name=name)
    if u.ndim == 2 and u.shape[1] == 1:
        u = u[:, 0]
    if u.ndim != 1:
        raise ValueError(f"{name} must be one signal, shape (n_samples,), got shape {u.shape}.")
    return np.ascontiguousarray(u)


def check_finite(value, name: str) -> float:
    """Return ``value`` as a finite float, or raise."""
    value = float(value)
    if not np.isfinite(value):
        raise ValueError(f"{name} must be finite, got {value!r}.")
    return value


def validate_record(estimator, X, y) -> tuple[np.ndarray, np.ndarray]:
    """Return input and output of one recording for ``fit``, both of shape (n_samples,), or raise."""
    X, y = validate_data(estimator, X, y, dtype=np.float64, y_numeric=True, ensure_min_samples=2)
    return _one_input(estimator, X), np.asarray(y, dtype=np.float64)


def validate_input(estimator, X) -> np.ndarray:
    """Return the input for ``predict``, shape (n_samples,), or raise."""
    return _one_input(estimator, validate_data(estimator, X, dtype=np.float64, reset=False))


def _one_input(estimator, X: np.ndarray) -> np.ndarray:
    if X.shape[1] != 1:
        raise ValueError(
            f"X has {X.shape[1]} columns, but {type(estimator).__name__} describes the effect of one input. "
            "Select one column."
        )
    return np.ascontiguousarray(X[:, 0])


def check_settle(n_settle, n_samples: int) -> int:
    """Return the number of first samples left out of a fit, or raise when too few samples remain."""
    if not 0 <= n_settle <= n_samples - 2:
        raise ValueError(
            f"n_settle={n_settle!r} must be 0 or more and leave at least 2 of the {n_samples} samples."
        )
    return int(n_settle)

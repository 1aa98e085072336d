"""Checks shared by the physics."""

from collections.abc import Callable, Sequence

import numpy as np
from sklearn.metrics import r2_score
from sklearn.utils.validation import check_array, validate_data

from narx_sklearn._validation import check_indexes, session_slices, unmasked


def check_signal(u, name: str = "u") -> np.ndarray:
    """Return a finite float signal of shape (n_samples,), or raise; a single column counts as a signal."""
    u = check_array(unmasked(u), dtype=np.float64, ensure_2d=False, input_name=name)
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


def validate_record(estimator, X, y, sessions) -> tuple[np.ndarray, np.ndarray, list[slice]]:
    """Return input and output for ``fit``, both of shape (n_samples,), and the recordings; or raise."""
    check_indexes(X, y)
    X, y = validate_data(
        estimator, unmasked(X), unmasked(y), dtype=np.float64, y_numeric=True, ensure_min_samples=2
    )
    pieces = session_slices(sessions, X.shape[0])
    return _one_input(estimator, X), np.asarray(y, dtype=np.float64), pieces


def validate_input(estimator, X, sessions) -> tuple[np.ndarray, list[slice]]:
    """Return the input for ``predict``, shape (n_samples,), and the recordings; or raise."""
    X = validate_data(estimator, unmasked(X), dtype=np.float64, reset=False)
    return _one_input(estimator, X), session_slices(sessions, X.shape[0])


def run_pieces(run: Callable[[np.ndarray], np.ndarray], u: np.ndarray, pieces: Sequence[slice]) -> np.ndarray:
    """Return ``run(u)``, begun anew in each recording."""
    return np.concatenate([run(u[piece]) for piece in pieces])


class SessionScoreMixin:
    """Score the prediction of several recordings."""

    predict: Callable

    def score(self, X, y, sample_weight=None, sessions=None):
        """Return R² of the prediction.

        Parameters
        ----------
        X : array-like of shape (n_samples, 1)
            Input, in order of time.
        y : array-like of shape (n_samples,)
            Measured output.
        sample_weight : array-like of shape (n_samples,), default=None
            Weights of the samples.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample; where it changes another recording begins, from rest.

        Returns
        -------
        float
        """
        return r2_score(y, self.predict(X, sessions=sessions), sample_weight=sample_weight)


def _one_input(estimator, X: np.ndarray) -> np.ndarray:
    if X.shape[1] != 1:
        raise ValueError(
            f"X has {X.shape[1]} columns, but {type(estimator).__name__} describes the effect of one input. "
            "Select one column."
        )
    return np.ascontiguousarray(X[:, 0])


def settled_samples(n_settle, pieces: Sequence[slice]) -> np.ndarray:
    """Return which samples count in a fit, shape (n_samples,) bool: all but the first of each recording.

    Raises
    ------
    ValueError
        If `n_settle` is negative, or too few samples remain.
    """
    n_samples = pieces[-1].stop
    counted = np.ones(n_samples, dtype=bool)
    for piece in pieces:
        counted[piece.start : min(piece.start + max(int(n_settle), 0), piece.stop)] = False
    if n_settle < 0 or counted.sum() < 2:
        raise ValueError(
            f"n_settle={n_settle!r} must be 0 or more and leave at least 2 of the {n_samples} samples"
            + (f" in {len(pieces)} sessions." if len(pieces) > 1 else ".")
        )
    return counted

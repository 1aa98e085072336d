"""Data as they are handed to an estimator: validated once, and then a record, wherever they are."""

import numpy as np
from sklearn.utils.validation import validate_data

from narx_sklearn._validation import (
    as_signals,
    check_indexes,
    check_numeric,
    check_same_length,
    column_labels,
    finite_columns,
    session_slices,
    unmasked,
)
from narx_sklearn.identification.records.record import ArrayRecord, Record
from narx_sklearn.identification.records.recordings import open_record
from narx_sklearn.identification.settings import has_no_inputs
from narx_sklearn.model.times import step_of_rows

NOTHING = "Input y contains NaN at every sample of an output; there is nothing to fit."


def open_data(narx, X, y, sessions, *, reset: bool) -> Record:
    """Return what `fit` of a regressor is given as a record; with ``reset`` its columns are remembered."""
    record = open_record(X, y, sessions)
    if record is None:
        return _open_arrays(narx, X, y, sessions, reset=reset)
    validate_data(narx, record.stand_in(), reset=reset, ensure_min_features=0)
    if not record.moments.known[: record.n_outputs].all():
        raise ValueError(NOTHING)
    return record


def open_inputs(narx, X, *, reset: bool = False) -> np.ndarray:
    """Return inputs as an array, their columns those that a regressor was fitted with."""
    check_numeric(X, "X")
    return validate_data(
        narx, unmasked(X), reset=reset, dtype=np.float64, ensure_all_finite="allow-nan", order="C",
        ensure_min_features=0 if has_no_inputs(narx.input_lags) else 1,
    )  # fmt: skip


def _open_arrays(narx, X, y, sessions, *, reset: bool) -> ArrayRecord:
    if X is None:
        raise ValueError(
            "X is None, but a record is wanted: inputs of shape (n_samples, n_inputs). For a model "
            "without inputs pass input_lags=[] and X=np.empty((n_samples, 0))."
        )
    check_numeric(X, "X")
    check_numeric(y, "y")
    check_indexes(X, y)
    step = step_of_rows(
        {"X": X, "y": y}, sessions, narx.sampling_period, "the model by sampling_period", stacklevel=5
    )
    labels, input_labels = column_labels(y), column_labels(X)
    X = open_inputs(narx, X, reset=reset)
    if y is None:
        raise ValueError("requires y to be passed, but the target y is None")
    y_ndim = 2 if hasattr(y, "columns") else np.asarray(y).ndim
    y = as_signals(y, "y")
    if not finite_columns(y).all():
        raise ValueError(NOTHING)
    check_same_length(X=X, y=y, sessions=sessions)
    session_slices(sessions, X.shape[0])
    return ArrayRecord(
        X, y, sessions, input_labels=input_labels, output_labels=labels, y_ndim=y_ndim, sampling_period=step
    )

"""Free runs over many recordings at the same time."""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from joblib import Parallel, delayed

from narx_sklearn._validation import (
    as_signals,
    check_indexes,
    check_same_length,
    finite_rows,
    finite_slices,
    session_slices,
)
from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.identification.free_run.scoring import after_initial_conditions
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.simulation import FreeRun, free_run

__all__ = ["ManyRuns", "by_session", "free_run_many", "named_recordings"]


@dataclass(frozen=True, eq=False)
class ManyRuns:
    """Free runs of one model over many recordings.

    Attributes
    ----------
    table : pandas.DataFrame
        One row for each recording and output: ``recording``, ``output``, ``n_samples`` that were judged,
        ``rmse`` in the unit of the output (infinite for a run that left the finite range), ``nrmse`` (rmse
        over the standard deviation of the output, dimensionless), ``r2``, ``stopped_at`` (first sample out
        of the finite range, -1 if there is none).
    runs : dict of FreeRun
        The runs, by recording.
    """

    table: pd.DataFrame
    runs: dict[Any, FreeRun]


def free_run_many(model: NARXModel, recordings, *, n_jobs: int | None = None) -> ManyRuns:
    """Simulate a model on many recordings, and say how well it does on each.

    The runs go through joblib, so that its backends (threads, processes, a dask cluster) all serve:
    ``with joblib.parallel_config("dask"): ...``.

    Parameters
    ----------
    model : NARXModel
        The model.
    recordings : mapping or list of (X, y)
        Inputs and measured outputs of each recording, by name or in order. The first ``model.max_lag``
        outputs of each, and after each gap of the inputs, are the initial condition and are not judged.
    n_jobs : int, default=None
        Recordings simulated at the same time; results do not depend on it.

    Returns
    -------
    ManyRuns

    Raises
    ------
    ValueError
        If there is no recording, or one does not fit the model; the message names it.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn import NARXModel, free_run
    >>> from narx_sklearn.identification.free_run.many import free_run_many
    >>> model = NARXModel.from_equations("0.5*y[k-1] + u[k-1]")
    >>> rng = np.random.default_rng(0)
    >>> recordings = {}
    >>> for machine, offset in {"first": 0.0, "second": 0.2}.items():
    ...     u = rng.normal(size=(100, 1))
    ...     recordings[machine] = u, free_run(model, u).y[:, 0] + offset * np.sign(u[:, 0])
    >>> free_run_many(model, recordings).table["rmse"].round(1).tolist()
    [0.0, 0.2]
    """
    named = named_recordings(recordings)
    found = Parallel(n_jobs=n_jobs)(delayed(_run_one)(model, name, X, y) for name, (X, y) in named.items())
    rows = [row for _, own in found for row in own]
    return ManyRuns(pd.DataFrame(rows), dict(zip(named, (run for run, _ in found), strict=True)))


def _run_one(model: NARXModel, name, X, y) -> tuple[FreeRun, list[dict]]:
    """Simulate one recording; return the run and its rows of the table."""
    try:
        check_indexes(X, y)
        X, y = as_signals(X, "X"), as_signals(y, "y")
        check_same_length(X=X, y=y)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DivergenceWarning)  # the table says it
            run = free_run(model, X, y)
    except ValueError as error:
        raise ValueError(f"Recording {name!r}: {error}") from error
    given = finite_rows(X)
    pieces = finite_slices([slice(0, X.shape[0])], given)
    given &= after_initial_conditions(pieces, X.shape[0], model.max_lag)
    rows = []
    for i, output in enumerate(model.outputs):
        judged = np.isfinite(y[:, i]) & given
        measured = y[judged, i]
        spread = float(measured.std()) if measured.size else np.nan
        if not measured.size:
            rmse = np.nan
        elif run.stopped_at is not None:
            rmse = np.inf
        else:
            rmse = float(np.sqrt(np.mean((measured - run.y[judged, i]) ** 2)))
        nrmse = rmse / spread if spread > 0 else np.nan
        rows.append(
            {
                "recording": name,
                "output": output,
                "n_samples": int(judged.sum()),
                "rmse": rmse,
                "nrmse": nrmse,
                "r2": 1.0 - nrmse**2,
                "stopped_at": -1 if run.stopped_at is None else run.stopped_at,
            }
        )
    return run, rows


def named_recordings(recordings) -> dict[Any, tuple]:
    """Return recordings by name; those of a list are named by their position.

    Parameters
    ----------
    recordings : mapping or list of (X, y)
        Recordings.

    Returns
    -------
    dict
        Pairs (X, y) by name.

    Raises
    ------
    ValueError, TypeError
        If there are none, or one is not a pair.
    """
    if not isinstance(recordings, Mapping | Sequence) or isinstance(recordings, str):
        raise TypeError(
            f"recordings must be a mapping from names to (X, y), or a list of (X, y), got "
            f"{type(recordings).__name__}."
        )
    named = dict(recordings) if isinstance(recordings, Mapping) else dict(enumerate(recordings))
    if not named:
        raise ValueError("recordings is empty; give at least one (X, y).")
    for name, pair in named.items():
        if not isinstance(pair, tuple | list) or len(pair) != 2:
            raise TypeError(f"Recording {name!r} must be a pair (X, y), got {type(pair).__name__}.")
    return {name: tuple(pair) for name, pair in named.items()}


def by_session(X, y, sessions) -> dict[Any, tuple]:
    """Return one recording for each session label, in the order in which the labels first appear.

    Parameters
    ----------
    X : array-like of shape (n_samples, n_inputs)
        Inputs.
    y : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Outputs.
    sessions : array-like of shape (n_samples,)
        One label a sample, each in one run.

    Returns
    -------
    dict
        Pairs (X, y) by label.

    Raises
    ------
    ValueError
        If lengths differ, or a label comes back after another: joined, its parts would be one recording.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification.free_run.many import by_session
    >>> found = by_session(np.zeros((5, 1)), np.arange(5), ["a", "a", "b", "b", "b"])
    >>> {name: y.tolist() for name, (_, y) in found.items()}
    {'a': [0, 1], 'b': [2, 3, 4]}
    """
    check_indexes(X, y)
    X = X if hasattr(X, "iloc") else np.asarray(X)
    y = y if hasattr(y, "iloc") else np.asarray(y)
    check_same_length(X=X, y=y, sessions=sessions)
    labels = np.asarray(sessions)
    found: dict[Any, tuple] = {}
    for piece in session_slices(labels, len(X)):
        name = labels[piece.start]
        name = name.item() if hasattr(name, "item") else name
        if name in found:
            raise ValueError(
                f"The session {name!r} comes back at sample {piece.start} after another one; give every "
                "recording a label of its own."
            )
        found[name] = tuple(side.iloc[piece] if hasattr(side, "iloc") else side[piece] for side in (X, y))
    return found

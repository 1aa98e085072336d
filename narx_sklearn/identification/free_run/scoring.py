"""Scores of a model's free run, the judgement that model searches use."""

import warnings

import numpy as np

from narx_sklearn._validation import (
    as_signals,
    check_indexes,
    check_same_length,
    finite_rows,
    finite_slices,
    session_slices,
)
from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.metrics import DIVERGED_SCORE, r2_score_of
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.simulation import free_run

__all__ = ["FreeRunJudge", "free_run_score"]


def free_run_score(model: NARXModel, X, y, *, sessions=None, sample_weight=None) -> float:
    """Return R² of a model's free run on a record.

    The first ``max_lag`` outputs of each session, and after each gap of the input, are the initial condition
    and are not scored.

    Parameters
    ----------
    model : NARXModel
        The model.
    X : array-like of shape (n_samples, n_inputs)
        Inputs.
    y : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Measured outputs.
    sessions : array-like of shape (n_samples,), default=None
        One label a sample.
    sample_weight : array-like of shape (n_samples,), default=None
        Weights of the samples.

    Returns
    -------
    float
        R², averaged over outputs; -1e6 where the free run leaves the finite range.

    Raises
    ------
    ValueError
        If fewer than two samples are left to judge by.
    """
    return FreeRunJudge(X, y, sessions=sessions, sample_weight=sample_weight).score(model)


def after_initial_conditions(pieces: list[slice], n_samples: int, max_lag: int) -> np.ndarray:
    """Tell which of all samples are not among the first ``max_lag`` of a piece, from which runs begin."""
    after = np.ones(n_samples, dtype=bool)
    for piece in pieces:
        after[piece.start : min(piece.start + max_lag, piece.stop)] = False
    return after


class FreeRunJudge:
    """A record, validated once, by whose free runs many models are judged.

    Parameters
    ----------
    X, y, sessions, sample_weight
        As for `free_run_score`.
    """

    def __init__(self, X, y, *, sessions=None, sample_weight=None):
        check_indexes(X, y)
        self.X, self.y = as_signals(X, "X"), as_signals(y, "y")
        check_same_length(X=self.X, y=self.y)
        self.sessions = sessions
        self.weight = None if sample_weight is None else np.asarray(sample_weight, dtype=float)
        given = finite_rows(self.X)
        self.pieces = finite_slices(session_slices(sessions, self.X.shape[0]), given)
        self.known = finite_rows(self.y) & given

    def score(self, model: NARXModel) -> float:
        """Return R² of the model's free run, as `free_run_score` defines it."""
        scored = self.known & after_initial_conditions(self.pieces, self.known.size, model.max_lag)
        if scored.sum() < 2:
            raise ValueError(
                f"score has {int(scored.sum())} samples after the initial condition; the model needs "
                f"{model.max_lag} samples to start from and at least 2 to be judged by."
            )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DivergenceWarning)  # the score says it
            simulated = free_run(model, self.X, self.y, sessions=self.sessions).y[scored]
        if not np.isfinite(simulated).all():
            return DIVERGED_SCORE
        measured = self.y[scored]
        weight = np.ones(measured.shape[0]) if self.weight is None else self.weight[scored]
        with np.errstate(over="ignore"):  # an infinite error has the score of a divergence
            error = weight @ (measured - simulated) ** 2
        centred = measured - weight @ measured / weight.sum()
        return r2_score_of(error, weight @ centred**2)

"""Of several models of a machine the one whose law serves, and what of these predicts best."""

import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from sklearn.base import clone

from narx_sklearn._validation import as_signals, session_slices
from narx_sklearn.compensation.law import CompensationLaw
from narx_sklearn.compensation.rehearsal import at_half_speed
from narx_sklearn.identification.one_step.criteria import information_criterion
from narx_sklearn.identification.structure.hysteresis import resting_dynamics
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.simulation import free_run

__all__ = [
    "best_of",
    "choose_model",
    "fitted_regressor",
    "free_run_criterion",
    "input_error",
    "parted",
    "recorded_range",
]

GIVEN_BACK = 0.2  # of the input's deviation: a law that returns an input worse than this has lost it
MOST_CUT = 0.1  # of the samples of a slower reference, at which a law that serves may be cut at its limits


def choose_model(
    regressors: Iterable,
    X,
    y,
    sessions,
    derive: Callable[[NARXModel], CompensationLaw],
    *,
    input_name: str | None = None,
    model_of: Callable[[Any], NARXModel] = lambda regressor: regressor.model_,
) -> tuple[NARXModel, Any]:
    """Identify a machine in several ways; return, of models whose law serves, what predicts best.

    Parameters
    ----------
    regressors : iterable of estimators
        With ``model_`` after fit.
    X, y, sessions
        The record.
    derive : callable
        Takes a model, returns its law.
    input_name : str or None, default=None
        The input that compensates; None is the first.
    model_of : callable
        Takes a fitted estimator, returns its model.

    Returns
    -------
    (NARXModel, estimator)
        The model, and what it was identified with.
    """
    u, measured = as_signals(X, "X"), as_signals(y, "y")
    fitted: dict[int, Any] = {}

    def identify(regressor) -> NARXModel:
        found = fitted_regressor(regressor, X, y, sessions)
        model = model_of(found)
        fitted[id(model)] = found
        return model

    def judge(model: NARXModel) -> tuple[bool, float]:
        law = derive(model)
        criterion, simulated = free_run_criterion(model, u, measured, sessions)
        # with the model's own output as reference a law should return the input that made it
        applied, others = parted(u, model, input_name)
        bounded = replace(law, limits=recorded_range(applied))
        reference = np.column_stack([simulated, others])
        lost = input_error(bounded, reference, applied, sessions) if np.isfinite(criterion) else np.inf
        stays = not law.keeps_rest or resting_dynamics(model, 1).holds  # where its input stops
        serves = stays and lost <= GIVEN_BACK
        serves = serves and share_cut(bounded, reference, applied, sessions) <= MOST_CUT
        return (False, criterion) if serves else (True, lost)

    best = best_of(regressors, identify, judge, stacklevel=6)
    return best, fitted[id(best)]


def parted(u: np.ndarray, model, input_name: str | None) -> tuple[np.ndarray, np.ndarray]:
    """Return the input that compensates, and the other inputs."""
    column = 0 if input_name is None else model.inputs.index(input_name)
    return u[:, column], np.delete(u, column, axis=1)


def recorded_range(applied: np.ndarray) -> tuple[float, float]:
    """Return the least and the largest input of a record."""
    return float(np.nanmin(applied)), float(np.nanmax(applied))


def fitted_regressor(model: Any, X, y, sessions) -> Any:
    """Return a clone of the given estimator, fitted to the record."""
    if X is None or y is None:
        known = "model_ of the estimator" if hasattr(model, "model_") else "NARXModel(...)"
        raise ValueError(
            "fit needs the record X (inputs) and y (output) to identify a model from, or the compensator a "
            f"model that is known: pass model={known}."
        )
    if not hasattr(model, "fit"):
        raise TypeError(
            "model must be None, a NARXModel or an estimator such as NARXRegressor, got "
            f"{type(model).__name__}."
        )
    options = {} if sessions is None else {"sessions": sessions}
    return clone(model).fit(X, y, **options)


def best_of(regressors, identify, judge, compare=None, stacklevel=5) -> NARXModel:
    """Return the model that is judged best; what one cannot do is told only where none can.

    Where ``compare`` is given, it takes all models that could be judged and their marks, and returns others
    in their place. Warnings are those of the model that is taken, told at ``stacklevel``.
    """
    found, refused = [], ValueError("There is nothing to choose from.")
    for regressor in regressors:
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            try:
                model = identify(regressor)
                told_of_model = list(told)
                mark = judge(model)
            except ValueError as error:  # such as a law without a solution
                refused = error
                continue
        found.append((mark, model, told_of_model))
    if not found:
        raise refused
    marks: list[Any] = [mark for mark, _, _ in found]
    if compare is not None:
        marks = compare([model for _, model, _ in found], marks)
    _, model, told_of_model = found[min(range(len(found)), key=lambda i: marks[i])]
    for warning in told_of_model:
        warnings.warn(warning.message, stacklevel=stacklevel)
    return model


def free_run_criterion(model: NARXModel, u, y, sessions, alike=0.0) -> tuple[float, np.ndarray]:
    """Return the criterion of a model's free run (infinite where it diverges) and what it simulates.

    Errors below the share ``alike`` of the output's deviation count as one, so that the fewer terms win.
    """
    run = free_run(model, u, y_init=y, sessions=sessions)
    if run.stopped_at is not None:
        return np.inf, run.y
    left = (run.y - y)[np.isfinite(run.y) & np.isfinite(y)]
    rss = max(float(left @ left), left.size * (alike * float(np.nanstd(y))) ** 2)
    return float(information_criterion("bic", rss, left.size, model.n_terms)), run.y


def input_error(law: CompensationLaw, reference, u: np.ndarray, sessions) -> float:
    """Return how far the input of a law lies from the one that was applied, over the latter's deviation."""
    errors = []
    for piece, known in _known_pieces(reference, u, sessions):
        m = law.run(reference[piece], m=u[piece.start]).m
        errors.append((m - u[piece])[known])
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)) / (np.nanstd(u) or 1.0))


def share_cut(law: CompensationLaw, reference, u: np.ndarray, sessions) -> float:
    """Return the share of samples at which a law is cut at its limits on a reference at half its speed.

    The machine has gone as far within these limits, and faster, so a law that is cut has run away.
    """
    counts = []
    for piece, _ in _known_pieces(reference, u, sessions):
        counts.append(law.run(at_half_speed(reference[piece]), m=u[piece.start]).counts)
    return sum(c.at_limit for c in counts) / max(sum(c.samples for c in counts), 1)


def _known_pieces(reference, u: np.ndarray, sessions) -> Iterator[tuple[slice, np.ndarray]]:
    """Yield each session from where the reference and the input are known, and at which samples they are."""
    for piece in session_slices(sessions, u.size):
        known = np.isfinite(reference[piece]).all(axis=1) & np.isfinite(u[piece])
        if known.any():
            begin = int(np.argmax(known))
            yield slice(piece.start + begin, piece.stop), known[begin:]

"""Free runs that are lost: they leave the finite range, or go where nothing that was fitted ever was."""

import warnings

import numpy as np

from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.identification.settings import refine_mode
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.simulation import FreeRun, free_run

NOWHERE = (0.0, 0.0, 0.0)  # what is known of a signal's values where nothing was recorded
FAR = 1000  # spans of the fitted outputs from their middle: a free run that gets there is no motion of theirs


def is_lost(model: NARXModel, X, y, sessions) -> bool:
    """Tell whether a model's free run of its own record leaves the finite range, or all that was fitted."""
    run = _own_run(model, X, y, sessions)
    return run.stopped_at is not None or _farthest(model, run.y) is not None


def warn_if_lost(settings, model: NARXModel, X, y, sessions) -> None:
    """Warn where the free run of what a fit keeps is lost on the record it was fitted on."""
    run = _own_run(model, X, y, sessions)
    if run.stopped_at is not None:
        what = f"leaves the finite range at sample {run.stopped_at}"
    else:
        place = _farthest(model, run.y)
        if place is None:
            return
        what = f"goes more than {FAR} times as far as its outputs, from sample {place[0]} on"
    unasked = refine_mode(settings.refine) == "auto"
    failed, way = "no refinement brought it back", ""
    if unasked and settings.estimator == "ls":
        failed = "no refinement that errs about as little one step ahead brought it back"
        way = "refine=True for one that may err more, "
    elif unasked:
        failed, way = f"estimator={settings.estimator!r} is not refined unasked", "refine=True, "
    warnings.warn(
        f"The free run of the fitted model {what} of its own record, and {failed}: predict and score, "
        "which simulate, are of no use, while predict_one_step may be. Try fewer terms (n_terms, "
        f"size='free_run'), other lags, a lower degree, {way}or, where predictions one step ahead are "
        "all that is wanted, refine=False.",
        DivergenceWarning,
        stacklevel=4,
    )


def warn_if_far(model: NARXModel, y: np.ndarray) -> None:
    """Warn where a free run, (n_samples, n_outputs), goes where nothing that was fitted ever was."""
    place = _farthest(model, y)
    if place is None:
        return
    k, i = place
    low, _, high = model.recorded[model.outputs[i]]
    warnings.warn(
        f"The free run of {model.outputs[i]!r} goes to {y[k, i]:.3g} at sample {k}, and was fitted "
        f"on {low:.3g} to {high:.3g}: more than {FAR} times as far. The model is unstable for this "
        "input or initial condition, or they lie far beyond the record it was fitted on. Fit to the free "
        "run with refine=True, fit fewer terms with n_terms, or keep to the range of the record.",
        DivergenceWarning,
        stacklevel=3,
    )


def _own_run(model: NARXModel, X, y, sessions) -> FreeRun:
    """Simulate the record that a model was fitted on; where the run is lost, its result says so alone."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DivergenceWarning)
        return free_run(model, X, y, sessions=sessions)


def _farthest(model: NARXModel, y: np.ndarray) -> tuple[int, int] | None:
    """Return the first sample and output at which a run goes where nothing that was fitted ever was."""
    recorded = [model.recorded.get(name, NOWHERE) for name in model.outputs]
    low, _, high = np.transpose(recorded)
    span = np.where(high > low, high - low, np.abs(high))
    far = (np.abs(y - (low + high) / 2) > FAR * span) & (span > 0)
    if not far.any():
        return None
    k, i = (int(index[0]) for index in np.nonzero(far))
    return k, i

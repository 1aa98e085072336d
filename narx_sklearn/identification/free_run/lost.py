"""Free runs that are lost: they leave the finite range, or go where nothing that was fitted ever was."""

import warnings

import numpy as np

from narx_sklearn.exceptions import DivergenceWarning, ExcitationWarning
from narx_sklearn.identification.settings import refine_mode
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.simulation import FreeRun, free_run

NOWHERE = (0.0, 0.0, 0.0)  # what is known of a signal's values where nothing was recorded
FAR = 1000  # spans of the fitted outputs from their middle: a free run that gets there is no motion of theirs

# spans from the middle: half a span beyond the record. Held-out parts of machines stay nearer than that
# unless the fitted part was none of their ordinary motion; a tenth of them a little beyond is ordinary
BEYOND = 1


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


def warn_if_far(model: NARXModel, X: np.ndarray, y: np.ndarray) -> None:
    """Warn where a free run, (n_samples, n_outputs), of inputs X goes where nothing that was fitted was."""
    place = _farthest(model, y)
    if place is None:
        _warn_if_beyond(model, X, y)
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


def _warn_if_beyond(model: NARXModel, X: np.ndarray, y: np.ndarray) -> None:
    """Warn where a free run goes twice as far from the middle of what was fitted as anything that was."""
    moved = np.array([np.ptp(model.recorded.get(name, NOWHERE)) > 0.0 for name in model.outputs])
    distance = np.where(moved, np.nan_to_num(_distance(model, model.outputs, y)), 0.0)
    if not (distance > BEYOND).any():
        return
    k, i = (int(index) for index in np.unravel_index(np.argmax(distance), distance.shape))
    low, _, high = model.recorded[model.outputs[i]]
    share = np.mean(~((y[:, i] >= low) & (y[:, i] <= high))[np.isfinite(y[:, i])])
    inputs = zip(model.inputs, _distance(model, model.inputs, X).T, strict=True)
    names = ", ".join(repr(name) for name, reached in inputs if (reached > BEYOND).any())
    if names:
        why = f"So do the inputs {names}. Fit a record that holds such inputs, or keep to those of this one."
    else:
        why = (
            "The inputs do not: unless the record was too short or too gentle to show what they do, the "
            "model runs off. Compare lags, degrees and sizes with NARXRegressorCV, or fit a longer record."
        )
    warnings.warn(
        f"The free run of {model.outputs[i]!r} goes to {y[k, i]:.3g} at sample {k}, and was fitted on "
        f"{low:.3g} to {high:.3g}: more than half of that span beyond it, and {share:.2g} of the samples lie "
        f"outside. A polynomial there is a guess. {why}",
        ExcitationWarning,
        stacklevel=4,
    )


def _own_run(model: NARXModel, X, y, sessions) -> FreeRun:
    """Simulate the record that a model was fitted on; where the run is lost, its result says so alone."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DivergenceWarning)
        return free_run(model, X, y, sessions=sessions)


def _farthest(model: NARXModel, y: np.ndarray) -> tuple[int, int] | None:
    """Return the first sample and output at which a run goes where nothing that was fitted ever was."""
    far = _distance(model, model.outputs, y) > FAR
    if not far.any():
        return None
    k, i = (int(index[0]) for index in np.nonzero(far))
    return k, i


def _distance(model: NARXModel, names: tuple[str, ...], signals: np.ndarray) -> np.ndarray:
    """Return how far signals are from the middle of what was fitted, in spans of it; 0 where none is known.

    A signal that did not move in the record counts in its own size.
    """
    recorded = [model.recorded.get(name, NOWHERE) for name in names]
    low, _, high = np.array(recorded).reshape(-1, 3).T
    span = np.where(high > low, high - low, np.abs(high))
    return np.where(span > 0, np.abs(signals - (low + high) / 2) / np.where(span > 0, span, 1.0), 0.0)

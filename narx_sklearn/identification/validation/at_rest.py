"""Models that tell directions apart and yet leave the place where their input stops."""

import warnings
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from narx_sklearn._validation import session_slices
from narx_sklearn.exceptions import DivergenceWarning, NarxWarning
from narx_sklearn.identification.free_run.lost import is_lost
from narx_sklearn.identification.structure.hysteresis import SIGN_LIKE, asked_for_continuum
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.phi import AbsoluteDifference
from narx_sklearn.model.simulation import free_run, predict_one_step

__all__ = ["Drift", "drift_at_rest", "warn_if_drifting"]

SEEN = 0.01  # of the output's range: less is not seen as the opening of a loop either
STOPS = 32  # samples of the record at which the input is stopped
LONGEST_HOLD = 2000  # samples; a drift that takes longer to be seen is of no account
HALF = 0.5  # of what a model moves at rest: where the record leaves less unexplained, it moves so too
RESTING = ("hysteresis", "rate_independent")  # structures whose terms vanish at rest


class Drift(NamedTuple):
    """Where a model goes from where its input was stopped.

    Attributes
    ----------
    output : str
        Which output.
    inputs : dict of {str: float}
        At which the inputs are held.
    begin, end : float
        The output when differences and signs have vanished, and ``n_samples`` later.
    per_sample : float
        Its change in the first of these samples.
    n_samples : int
        How long the inputs are held.
    longest_rest : int
        Samples of the longest stretch of the record in which the inputs rest.
    rests : bool
        Whether it rests long enough for the model to move.
    """

    output: str
    inputs: dict[str, float]
    begin: float
    end: float
    per_sample: float
    n_samples: int
    longest_rest: int
    rests: bool


def drift_at_rest(model: NARXModel, X, y, sessions=None) -> Drift | None:
    """Return how a model leaves the place where its input stops, None where it stays or may be right.

    What is small does not count: less than the model errs one step ahead, or than 1 % of the output's range.
    Only models in which the direction of an input counts are asked: without its signs their free run of the
    record must be another. The input is then stopped at samples of that run, and what the model moves from
    there must count in the mean square of all stops; but not where the record rests too, and moves as the
    model does.

    Parameters
    ----------
    model : NARXModel
        The model.
    X : ndarray of shape (n_samples, n_inputs)
        Inputs it was fitted to.
    y : ndarray of shape (n_samples, n_outputs)
        Measured outputs.
    sessions : array-like of shape (n_samples,), default=None
        One label a sample.

    Returns
    -------
    Drift or None
        Of the output that moves most, over its range, and of the stop from which it goes farthest.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification.validation.at_rest import drift_at_rest
    >>> from narx_sklearn.model import AbsoluteDifference, Difference, NARXModel, free_run
    >>> phi = [Difference("u", name="phi1"), AbsoluteDifference("u", name="phi2")]
    >>> u = np.sin(0.1 * np.arange(500))[:, None]
    >>> machine = NARXModel.from_equations("y[k-1] + phi1[k-1] - 0.5*phi2[k-1]*y[k-1]", phi=phi)
    >>> y = free_run(machine, u, [0.0, 0.0]).y
    >>> drift_at_rest(machine, u, y) is None
    True
    >>> leaky = NARXModel.from_equations("0.99*y[k-1] + phi1[k-1] - 0.5*phi2[k-1]*y[k-1]", phi=phi)
    >>> drift = drift_at_rest(leaky, u, y)
    >>> round(drift.per_sample / drift.begin, 6), drift.longest_rest
    (-0.01, 1)
    """
    used = [p for p in model.phi if p.name in model.library.signals]
    signs = {
        str(p.name)
        for p in used
        if isinstance(p, (*SIGN_LIKE, AbsoluteDifference)) and p.signals <= set(model.inputs)
    }
    if not signs or any(p.has_memory for p in used):
        return None
    run = _quietly(model, X, y, sessions)
    left = predict_one_step(model, X, y, sessions=sessions) - y
    if not np.isfinite(left).any(axis=0).all():
        return None
    error, spread = np.sqrt(np.nanmean(left**2, axis=0)), np.nanmax(y, axis=0) - np.nanmin(y, axis=0)
    limit = np.maximum(error, SEEN * spread)
    directed = run - _quietly(_without(model, signs), X, y, sessions)
    if not np.any(_size(directed[np.isfinite(run).all(axis=1)]) > limit):
        return None
    held = _held(model, X, run, sessions)
    if held is None:
        return None
    stops, y_held = held
    begin, after, end = (y_held[:, k] for k in (model.max_lag, model.max_lag + 1, -1))
    moved = _size(end - begin)
    output = int(np.argmax(np.where(spread > 0.0, moved / np.where(spread > 0.0, spread, 1.0), 0.0)))
    longest, moved_so, left_over = _rests(model, X, y, sessions, output)
    rests = bool(moved_so > limit[output])
    if not moved[output] > limit[output] or (rests and left_over**2 < HALF * moved_so**2):
        return None
    far = np.abs(end - begin)[:, output]
    stop = int(np.argmax(np.where(np.isfinite(far), far, -1.0)))
    at = dict(zip(model.inputs, map(float, X[stops[stop]]), strict=True))
    n_samples = y_held.shape[1] - model.max_lag - 1
    at_first, then, at_last = (float(values[stop, output]) for values in (begin, after, end))
    name = model.outputs[output]
    return Drift(name, at, at_first, at_last, then - at_first, n_samples, longest, rests)


def warn_if_drifting(settings, model: NARXModel, X, y, sessions) -> None:
    """Warn where a fitted model leaves the place where its input stops, and nothing says that it may."""
    if asked_for_continuum(settings.constraints):  # where it has not come about, that is told
        return
    drift = drift_at_rest(model, X, y, sessions)
    if drift is None or is_lost(model, X, y, sessions):  # which is told too
        return
    at = ", ".join(f"{name} = {value:.4g}" for name, value in drift.inputs.items())
    way = "constraints='continuum', fit_intercept=False, origin='zero'"
    if settings.structure not in RESTING:
        way = f"structure='hysteresis', {way}"
    plural = "s" if drift.longest_rest > 1 else ""
    rest = f"The record does not say so, its input rests for {drift.longest_rest} sample{plural} at most."
    if drift.rests:
        rest = f"Where the record's input rests, for up to {drift.longest_rest} samples, it does not move so."
    warnings.warn(
        f"The model does not stay where its input stops, as a machine with hysteresis does: held at {at}, "
        f"{drift.output} goes from {drift.begin:.4g} by {drift.per_sample:.3g} a sample at first, and in "
        f"{drift.n_samples} samples to {drift.end:.4g}. At rest differences and signs vanish, and what is "
        f"left of the equation does not hold every output. {rest} If the machine stays, pass {way}; if it "
        "moves, record also how it does, with the input held.",
        NarxWarning,
        stacklevel=4,
    )


def _without(model: NARXModel, names: set[str]) -> NARXModel:
    kept = np.array([not term.signals & names for term in model.library])
    return model.with_parameters(model.parameters * kept[:, None])


def _quietly(model: NARXModel, X, y_init, sessions) -> np.ndarray:
    """Return a free run; what diverges goes to infinity, and nothing is told."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DivergenceWarning)
        run = free_run(model, X, y_init, sessions=sessions)
    return run.y if run.stopped_at is None else np.where(np.isnan(run.y), np.inf, run.y)


def _size(values: np.ndarray) -> np.ndarray:
    """Return the root of the mean square of the samples."""
    with np.errstate(over="ignore"):  # what is beyond all numbers is far
        return np.sqrt(np.mean(np.square(values), axis=0))


def _held(model: NARXModel, X, run, sessions) -> tuple[np.ndarray, np.ndarray] | None:
    """Return samples at which the inputs are stopped, and the outputs from there, (n_stops, n, n_outputs).

    The first ``max_lag`` samples are those in which differences and signs vanish.
    """
    lag = model.max_lag
    n_needed = 2 * lag + 1  # samples of a session without a gap, of which the last is a stop
    unknown = np.append(0, np.cumsum(~(np.isfinite(X).all(axis=1) & np.isfinite(run).all(axis=1))))
    pieces = [piece for piece in session_slices(sessions, len(X)) if piece.stop - piece.start >= n_needed]
    if not pieces:
        return None
    stops = np.concatenate([np.arange(piece.start + n_needed - 1, piece.stop) for piece in pieces])
    stops = stops[unknown[stops + 1] == unknown[stops + 1 - n_needed]]
    if not stops.size:
        return None
    longest = max(piece.stop - piece.start for piece in pieces)
    chosen = stops[np.linspace(0, stops.size - 1, min(STOPS, stops.size)).astype(int)]
    n_held = lag + 1 + min(longest, LONGEST_HOLD)
    past = chosen[:, None] - lag + 1 + np.arange(lag)
    inputs = np.concatenate([X[past], np.repeat(X[chosen][:, None], n_held, axis=1)], axis=1)
    begun = np.full((*inputs.shape[:2], run.shape[1]), np.nan)
    begun[:, :lag] = run[past]
    labels = np.repeat(np.arange(chosen.size), inputs.shape[1])
    y = _quietly(model, inputs.reshape(-1, X.shape[1]), begun.reshape(-1, run.shape[1]), labels)
    return chosen, y.reshape(chosen.size, -1, run.shape[1])[:, lag:]


def _rests(model: NARXModel, X, y, sessions, output: int) -> tuple[int, float, float]:
    """Return how long a record's inputs rest at most, how far a model moves in rests, and by what it errs."""
    lag, longest = model.max_lag, 1
    parts: list[slice] = []
    for piece in session_slices(sessions, len(X)):
        moves = np.flatnonzero((np.diff(X[piece], axis=0) != 0.0).any(axis=1)) + 1
        edges = piece.start + np.concatenate([[0], moves, [piece.stop - piece.start]])
        longest = max(longest, int(np.max(np.diff(edges), initial=0)))
        parts += [slice(a, b) for a, b in pairwise(edges) if b - a > 2 * lag + 1]
    parts = [part for part in parts if np.isfinite(X[part]).all() and np.isfinite(y[part]).all()]
    if not parts:
        return longest, 0.0, 0.0
    rows = np.concatenate([np.arange(part.start + lag, part.stop) for part in parts])
    labels = np.concatenate([np.full(part.stop - part.start - lag, i) for i, part in enumerate(parts)])
    run = _quietly(model, X[rows], y[rows], labels)[:, output]  # at first as measured
    last = np.flatnonzero(np.append(np.diff(labels), 1))
    first = np.append(0, last[:-1] + 1) + lag - 1
    moved = run[last] - run[first]
    return longest, float(_size(moved)), float(_size(y[rows[last], output] - run[last]))

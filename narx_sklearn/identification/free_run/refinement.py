"""Free-run (simulation-error) refinement of a model's parameters, constraints kept."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from narx_sklearn._validation import (
    as_signals,
    check_indexes,
    check_same_length,
    finite_slices,
    session_slices,
)
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.identification.one_step.selection import EXACT
from narx_sklearn.identification.one_step.uncertainty import (
    ParameterUncertainty,
    n_stretches,
    parameter_uncertainty,
)
from narx_sklearn.identification.structure.constraints import LinearConstraints
from narx_sklearn.model import kernels
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.simulation import layout_of, program_of, simulation_state

__all__ = ["FreeRunFit", "free_run_uncertainty", "refine_free_run"]


@dataclass(frozen=True)
class FreeRunFit:
    """What the refinement returns.

    Attributes
    ----------
    model : NARXModel
        The refined model; the one given where nothing better was found.
    loss_before, loss : float
        Weighted sum of squared free-run errors before and after; infinite where the run diverged.
    n_samples : int
        Number of samples in that sum.
    n_iterations : int
        Steps taken.
    converged : bool
        Whether it ended because nothing changed any more.
    rounding : float
        Loss at or below which a fit is exact to rounding.
    """

    model: NARXModel
    loss_before: float
    loss: float
    n_samples: int
    n_iterations: int
    converged: bool
    rounding: float = 0.0


class _Window(NamedTuple):
    """One simulated stretch of record with its measured initial condition."""

    flat: np.ndarray
    state: np.ndarray
    target: np.ndarray
    n_rows: int


class _Runs:
    """The record as windows, ready to be simulated again and again."""

    def __init__(self, model: NARXModel, X, y, sessions, horizon: int | None, weights: np.ndarray):
        self.layout = layout_of(model)
        self.depth = max(model.max_lag, 1)
        self.program = program_of(model)
        self.n_channels = len(model.channels)
        self.weights = weights
        self.windows: list[_Window] = []
        n_outputs = len(model.outputs)
        origin = self.layout.origin[:n_outputs]
        pieces = finite_slices(session_slices(sessions, X.shape[0]), np.isfinite(X).all(axis=1))
        for piece in pieces:
            for window in _windows(piece, y, self.depth, horizon):
                flat, state, self.phis = simulation_state(self.layout, X[window], y[window], self.depth)
                target = y[window] - origin
                self.windows.append(_Window(flat, state, target, target.shape[0]))
        self.n_samples = sum(int(np.isfinite(w.target[self.depth :]).any(axis=1).sum()) for w in self.windows)
        deviation = max((float(np.nanmax(np.abs(w.target))) for w in self.windows), default=1.0)
        power = sum(float(np.nansum(self.weights * w.target**2)) for w in self.windows)
        self.exact = EXACT * power
        # no step that far off is worth finishing; an output that nobody measured may have any size
        hidden = any(not np.isfinite(w.target[self.depth :]).any(axis=0).all() for w in self.windows)
        self.bound = (1e12 if hidden else 1e4) * max(deviation, np.finfo(float).tiny)

    def loss(self, coefficients: np.ndarray) -> float:
        """Return the weighted sum of squared errors; infinite where a run left the range."""
        program = self.program._replace(coefficients=coefficients)
        total = 0.0
        n_outputs = self.weights.size
        for window in self.windows:
            state = window.state.copy()
            end = kernels.free_run(
                window.flat, self.n_channels, self.depth, window.n_rows, program, self.phis, state, self.bound
            )
            if end < window.n_rows:
                return np.inf
            simulated = window.flat.reshape(-1, self.n_channels)[self.depth :, :n_outputs]
            error = window.target[self.depth :] - simulated
            total += float(np.nansum(self.weights * error**2))
        return total

    def linearise(self, coefficients: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Return loss, J'WJ and J'Wr."""
        loss, gram, scores = self.scores(coefficients, 1)
        return loss, gram, scores.sum(axis=0)

    def scores(self, coefficients: np.ndarray, n_parts: int) -> tuple[float, np.ndarray, np.ndarray]:
        """Return loss, J'WJ, and J'Wr summed over ``n_parts`` stretches of each window."""
        program = self.program._replace(coefficients=coefficients)
        gram = np.zeros((coefficients.size, coefficients.size))
        scores = []
        total = 0.0
        for window in self.windows:
            gradients = np.zeros((n_parts, coefficients.size))
            end, loss = kernels.free_run_sensitivity(
                window.flat, self.n_channels, self.depth, window.n_rows, program, self.phis,
                window.state.copy(), self.bound, window.target, self.weights, self.depth, gram, gradients,
            )  # fmt: skip
            total += loss if end == window.n_rows else np.inf
            scores.append(gradients)
        return total, gram + np.tril(gram, -1).T, np.vstack(scores)


def _windows(piece: slice, y: np.ndarray, depth: int, horizon: int | None):
    """Cut a recording into stretches that begin with ``depth`` measured outputs."""
    known = np.isfinite(y).all(axis=1)
    step = piece.stop - piece.start if horizon is None else horizon
    begin = piece.start
    while begin + depth < piece.stop:
        if not known[begin : begin + depth].all():
            begin += 1
            continue
        end = min(begin + depth + step, piece.stop)
        yield slice(begin, end)
        begin = end - depth if horizon is not None else piece.stop


def refine_free_run(
    model: NARXModel,
    X,
    y,
    *,
    sessions=None,
    constraints: LinearConstraints | None = None,
    horizons: Sequence[int | None] = (None,),
    max_iter: int = 50,
    tol: float = 1e-8,
) -> FreeRunFit:
    """Fit the parameters to the free run by Levenberg-Marquardt with analytic sensitivities.

    The sensitivities obey the model's own recursion, ``dy[k]/dtheta = psi[k-1] + sum_i (dF/dy[k-i])
    dy[k-i]/dtheta``, and are simulated with it. Noise on the output, which biases least squares through
    the regressors, does not enter them. The result is never worse than the start.

    Parameters
    ----------
    model : NARXModel
        Where to start.
    X : array-like of shape (n_samples, n_inputs)
        Inputs; NaN marks gaps.
    y : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Measured outputs; NaN where none is.
    sessions : array-like of shape (n_samples,), default=None
        One label a sample.
    constraints : LinearConstraints, default=None
        Constraints on the parameters of the model's nonzero terms, first output first, each in the
        library's order.
    horizons : sequence of int or None, default=(None,)
        Lengths of the simulated stretches, one fit after the other; None is the whole session. Short ones
        first bring an unstable start within reach.
    max_iter : int, default=50
        Steps for each horizon.
    tol : float, default=1e-8
        Relative gain at which a fit has converged.

    Returns
    -------
    FreeRunFit

    Raises
    ------
    ValueError
        If ``X`` and ``y`` differ in length, or do not fit the model.

    References
    ----------
    L. Piroddi and W. Spinelli (2003), simulation-error minimisation for polynomial NARX models.
    """
    check_indexes(X, y)
    X, y = as_signals(X, "X"), as_signals(y, "y")
    check_same_length(X=X, y=y, sessions=sessions)
    for name, side, signals in (("X", X, model.inputs), ("y", y, model.outputs)):
        if side.shape[1] != len(signals):
            raise ValueError(
                f"{name} has {side.shape[1]} columns; those of the model's {list(signals)} are wanted."
            )
    scatter = np.nanvar(y, axis=0)
    weights = np.where(scatter > 0, scatter.max() / np.where(scatter > 0, scatter, 1.0), 0.0)
    columns, terms = np.nonzero(model.parameters.T)
    if not columns.size:
        return FreeRunFit(model, np.inf, np.inf, 0, 0, True)
    # the program sorts the terms of each equation its own way; `place` finds each again
    coefficients = model.parameters[terms, columns]
    place = _program_order(model, columns, terms)
    theta0, Z = np.zeros(coefficients.size), np.eye(coefficients.size)
    if constraints is not None and len(constraints):
        _, Z = constraints.solution_space()
        theta0 = coefficients
    full = _Runs(model, X, y, sessions, None, weights)
    if not full.windows:
        return FreeRunFit(model, np.inf, np.inf, 0, 0, False)
    before = full.loss(coefficients[place])
    theta, loss, steps, converged = coefficients, before, 0, False
    start = coefficients
    for horizon in horizons:
        runs = full if horizon is None else _Runs(model, X, y, sessions, horizon, weights)
        start, reached, taken, converged = _marquardt(runs, start, theta0, Z, place, max_iter, tol)
        steps += taken
        if horizon is not None:
            reached = full.loss(start[place])
        if reached < loss:
            theta, loss = start, reached
    if not loss < before:
        return FreeRunFit(model, before, before, full.n_samples, steps, converged, full.exact)
    parameters = np.zeros_like(model.parameters)
    parameters[terms, columns] = theta
    refined = model.with_parameters(parameters)
    return FreeRunFit(refined, before, loss, full.n_samples, steps, converged, full.exact)


def _program_order(model: NARXModel, columns: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """Return, for each coefficient of the program, its position among the model's nonzero parameters."""
    numbered = np.zeros_like(model.parameters)
    numbered[terms, columns] = np.arange(1, columns.size + 1)
    return program_of(model.with_parameters(numbered)).coefficients.astype(np.int64) - 1


def _marquardt(runs: _Runs, theta, theta0, Z, place, max_iter: int, tol: float):
    """Minimise the loss over theta = theta0 + Z a (theta0 a solution of the constraints)."""
    damping = 1e-3
    into = np.empty_like(place)
    into[place] = np.arange(place.size)
    loss, gram, gradient = runs.linearise(theta[place])
    for step in range(max_iter):
        if not np.isfinite(loss):
            return theta, np.inf, step, False
        if not np.isfinite(gram).all():  # of a chaotic run, bounded though it is, sensitivities overflow
            return theta, loss, step, False
        if not Z.shape[1]:  # the constraints hold all of them
            return theta, loss, step, True
        G = Z.T @ gram[np.ix_(into, into)] @ Z
        g = Z.T @ gradient[into]
        scale = np.sqrt(np.maximum(np.diag(G), np.finfo(float).tiny))
        accepted = False
        while damping < 1e12:
            try:
                # Marquardt's scaling: the damping has no unit, whatever the terms' units are
                H = G / np.outer(scale, scale)
                H[np.diag_indices_from(H)] += damping
                move = Z @ (cho_solve(cho_factor(H), g / scale) / scale)
            except np.linalg.LinAlgError:
                damping *= 10.0
                continue
            trial = theta + move
            reached = runs.loss(trial[place])
            if reached < loss:
                accepted = True
                break
            damping *= 4.0
        if not accepted:
            return theta, loss, step, True
        gain = (loss - reached) / loss if loss > 0 else 0.0
        theta = trial
        damping = max(damping / 10.0, 1e-12)
        if gain < tol or reached <= runs.exact:
            return theta, reached, step + 1, True
        loss, gram, gradient = runs.linearise(theta[place])
    return theta, loss, max_iter, False


def free_run_uncertainty(
    model: NARXModel, X, y, *, sessions=None, constraints: LinearConstraints | None = None
) -> ParameterUncertainty:
    """Return the covariance of parameters that were fitted to the free run.

    Parameters
    ----------
    model : NARXModel
        The fitted model, with one output.
    X, y, sessions, constraints
        As for `refine_free_run`.

    Returns
    -------
    ParameterUncertainty
        Of the nonzero parameters, in the library's order; NaN where the sensitivities overflow.

    Warns
    -----
    NarxWarning
        If they do.
    """
    columns, terms = np.nonzero(model.parameters.T)
    place = _program_order(model, columns, terms)
    runs = _Runs(
        model, np.asarray(X, float), np.asarray(y, float), sessions, None, np.ones(len(model.outputs))
    )
    parts = max(n_stretches(runs.n_samples) // max(len(runs.windows), 1), 1)
    _, gram, scores = runs.scores(model.parameters[terms, columns][place], parts)
    if not np.isfinite(gram).all():
        warnings.warn(
            "The free run's sensitivities to the parameters leave the finite range, as those of chaotic "
            "models do, so nothing is known of the parameters' uncertainty (NaN). Pass refine=False for "
            "intervals of one-step estimates.",
            NarxWarning,
            stacklevel=6,
        )
        return ParameterUncertainty(np.full_like(gram, np.nan), parts * len(runs.windows) - 1)
    into = np.empty_like(place)
    into[place] = np.arange(place.size)
    return parameter_uncertainty(gram[np.ix_(into, into)], scores[:, into], constraints)

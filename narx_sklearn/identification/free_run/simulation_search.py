"""Term selection on the simulation error, for records whose noise is on the output.

Least squares sees noisy outputs among its regressors and keeps spurious terms to make up for it. Here the
candidates are weighed by what a small amount of each would change in the *free run*: with J the
derivatives of the simulated output with respect to the parameters of all candidates, the best set of terms
round the present model is that of the linear regression of r + J theta on J, which is compressed and
searched like any other. Refit, linearise anew, search again, until nothing changes.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from narx_sklearn._validation import finite_slices, session_slices
from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.identification.free_run.refinement import FreeRunFit, refine_free_run
from narx_sklearn.identification.one_step.criteria import information_criterion
from narx_sklearn.identification.one_step.estimation import least_squares
from narx_sklearn.identification.one_step.factor import Factor
from narx_sklearn.identification.one_step.regressors import ProductPlan
from narx_sklearn.identification.one_step.selection import search_terms
from narx_sklearn.identification.structure.constraints import LinearConstraints, on_library
from narx_sklearn.model.kernels import NO_STEP, Program
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.recording import lay_out
from narx_sklearn.model.simulation import free_run, layout_of, program_of
from narx_sklearn.model.terms import TermLibrary

__all__ = ["SimulationSelection", "select_on_simulation"]

ROUNDS = 6
BLOCK_ROWS = 4096


class FreeRunData(NamedTuple):
    """A record and what the model is to be judged by."""

    X: np.ndarray
    y: np.ndarray
    sessions: np.ndarray | None


@dataclass(frozen=True)
class SimulationSelection:
    """What the search returns.

    Attributes
    ----------
    fit : FreeRunFit
        The best model found, fitted to its free run.
    criterion : float
        Its information criterion, of the simulation error.
    rounds : int
        Linearisations it took.
    """

    fit: FreeRunFit
    criterion: float
    rounds: int


def select_on_simulation(
    model: NARXModel,
    library: TermLibrary,
    data: FreeRunData,
    *,
    criterion: str,
    n_terms: int,
    constraints: LinearConstraints | None = None,
    search: str = "exchange",
    max_iter: int = 30,
    horizons: Sequence[int | None] = (None,),
) -> SimulationSelection:
    """Search terms and parameters of a single-output model by its free run.

    Parameters
    ----------
    model : NARXModel
        Where to start. Where its free run is lost, it is first fitted on growing ``horizons``.
    library : TermLibrary
        Candidate terms, those of the model among them.
    data : FreeRunData
        The record.
    criterion : str
        Information criterion by which sets of different size are compared.
    n_terms : int
        Largest number of terms.
    constraints : LinearConstraints, default=None
        Constraints on the parameters of ``library``.
    search : str, default="exchange"
        Search on the linearised regression.
    max_iter : int, default=30
        Steps of each free-run fit.
    horizons : sequence of int or None, default=(None,)
        Lengths of the stretches on which a start is fitted whose free run is lost; see `refine_free_run`.

    Returns
    -------
    SimulationSelection
    """
    fit = _fit(model, data, library, constraints, max_iter)
    if not np.isfinite(fit.loss):  # there is no slope to follow where the run is lost; short runs have one
        fit = refine_free_run(
            model,
            data.X,
            data.y,
            sessions=data.sessions,
            constraints=on_library(constraints, library, model.library),
            horizons=horizons,
        )
    best = SimulationSelection(fit, _criterion(fit, library, criterion), 0)
    seen = {best.fit.model.library}
    for rounds in range(1, ROUNDS + 1):
        factor = linearised_factor(best.fit.model, library, data)
        if factor is None:
            break
        path = search_terms(factor, n_terms, search=search, constraints=constraints)
        chosen = path.supports[path.best_size(criterion)]
        trial = _model_of(best.fit.model, library, factor, chosen, constraints)
        if trial is None or trial.library in seen:
            break
        seen.add(trial.library)
        fit = _fit(trial, data, library, constraints, max_iter)
        value = _criterion(fit, library, criterion)
        if not value < best.criterion:
            break
        best = SimulationSelection(fit, value, rounds)
    return _prune(best, library, data, criterion, constraints, max_iter)


def _prune(best, library, data, criterion, constraints, max_iter) -> SimulationSelection:
    """Drop terms one by one, the least missed first, as long as the criterion falls."""
    while best.fit.model.n_terms > 1:
        model = best.fit.model
        factor = linearised_factor(model, model.library, data)
        if factor is None:
            return best
        names = list(range(len(model.library)))
        growth = [_rss_without(factor, names, j) for j in names]
        improved = False
        for j in np.argsort(growth)[:2]:
            rest = [i for i in names if i != j]
            try:
                inside = on_library(constraints, library, model.library.subset(rest))
            except ValueError:  # a constraint needs the term
                continue
            theta, _ = least_squares(factor.subset(rest), constraints=inside)
            trial = NARXModel.from_equations(
                dict(zip(model.library.subset(rest), theta, strict=True)), **_fields(model)
            )
            fit = _fit(trial, data, library, constraints, max_iter)
            value = _criterion(fit, library, criterion)
            if value < best.criterion:
                best = SimulationSelection(fit, value, best.rounds)
                improved = True
                break
        if not improved:
            return best
    return best


def _rss_without(factor: Factor, names: list[int], j: int) -> float:
    rest = [i for i in names if i != j]
    P, y = factor.Psi[:, rest], factor.target()
    scale = np.maximum(np.linalg.norm(P, axis=0), np.finfo(float).tiny)
    residual = y - P / scale @ np.linalg.lstsq(P / scale, y, rcond=None)[0]
    return float(residual @ residual)


def _fit(model, data, library, constraints, max_iter) -> FreeRunFit:
    inside = on_library(constraints, library, model.library)
    return refine_free_run(
        model, data.X, data.y, sessions=data.sessions, constraints=inside, max_iter=max_iter, tol=1e-6
    )


def _criterion(fit: FreeRunFit, library: TermLibrary, name: str) -> float:
    if not np.isfinite(fit.loss) or fit.n_samples == 0:
        return np.inf
    return float(
        information_criterion(
            name, max(fit.loss, fit.rounding), fit.n_samples, fit.model.n_terms, len(library)
        )
    )


def _fields(model: NARXModel) -> dict:
    return {
        "outputs": model.outputs,
        "inputs": model.inputs,
        "phi": model.phi,
        "sampling_period": model.sampling_period,
        "units": model.units,
        "origin": model.origin,
        "recorded": model.recorded,
        "recorded_change": model.recorded_change,
    }


def _model_of(model, library, factor, chosen, constraints) -> NARXModel | None:
    """Return the model of the chosen terms with the linearised regression's parameters."""
    chosen = sorted(chosen)
    if not chosen:
        return None
    inside = constraints.restrict(chosen) if constraints is not None and len(constraints) else None
    theta, _ = least_squares(factor.subset(chosen), constraints=inside)
    kept = library.subset(chosen)
    if not np.all(theta):
        return None
    return NARXModel.from_equations(dict(zip(kept, theta, strict=True)), **_fields(model))


def linearised_factor(model: NARXModel, library: TermLibrary, data: FreeRunData) -> Factor | None:
    """Compress [J, r + J theta], J the free run's derivatives with respect to all of ``library``.

    Returns None where the free run or its derivatives leave the finite range.
    """
    pieces = finite_slices(session_slices(data.sessions, data.X.shape[0]), np.isfinite(data.X).all(axis=1))
    layout = layout_of(model)
    n_channels = len(layout.channels)
    # terms of the model, wherever its library stands inside the candidates
    theta = np.zeros(len(library))
    theta[[library.index(term) for term in model.library]] = model.parameters[:, 0]
    plan = ProductPlan.of(library, layout.channels)
    program = program_of(model)
    longest = library.max_lag + max((p.reach for p in layout.phi), default=0)
    depth = max(longest, model.max_lag, 1)
    total = Factor.empty(len(library), 1)
    for piece in pieces:
        known = np.isfinite(data.y[piece, 0])
        n_rows = piece.stop - piece.start
        if n_rows <= depth or not known[:depth].all():
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DivergenceWarning)  # the search turns back from there
            run = free_run(model, data.X[piece], data.y[piece.start : piece.start + depth])
        if run.stopped_at is not None:
            return None
        simulated = run.y.copy()
        simulated[:depth] = data.y[piece.start : piece.start + depth]
        laid = lay_out(layout, data.X[piece], simulated)
        flat = np.nan_to_num(laid.data, nan=0.0).ravel()
        residual = data.y[piece, 0] - simulated[:, 0]
        ring = np.zeros((depth + 1, plan.steps.size))
        for begin in range(depth, n_rows, BLOCK_ROWS):
            end = min(begin + BLOCK_ROWS, n_rows)
            J = np.empty((end - begin, plan.steps.size))
            _sensitivity_rows(flat, n_channels, begin, end, program, plan.steps, plan.parents, ring, J)
            if not np.all(np.isfinite(J)):
                return None
            J = J[:, plan.wanted]
            inside = known[begin:end]
            target = residual[begin:end] + J @ theta
            total = total.merge(Factor.of(J[inside], target[inside]))
    return total if total.n_samples > len(library) else None


@njit(cache=True, nogil=True)
def _sensitivity_rows(flat, n_channels, begin, end, program: Program, steps, parents, ring, J):
    """Write dy[k]/dtheta of all candidate terms for rows ``begin`` to ``end`` into ``J``.

    The free run of the model is in ``flat``; output is channel 0. ``ring``, shape
    (depth + 1, n_candidates), carries the derivatives of the last rows and is written.
    """
    depth = ring.shape[0] - 1
    n_candidates = steps.size
    inner = np.zeros(depth + 1)
    for k in range(begin, end):
        base = k * n_channels
        row = J[k - begin]  # first the candidates themselves, then what they change through the past
        for t in range(n_candidates):
            if steps[t] == NO_STEP:
                row[t] = 1.0
            elif parents[t] < 0:
                row[t] = flat[base + steps[t]]
            else:
                row[t] = row[parents[t]] * flat[base + steps[t]]
        for t in range(program.coefficients.size):
            first, last = program.factor_start[t], program.factor_start[t + 1]
            for f in range(first, last):
                step = program.factor_step[f]
                if step % n_channels == 0:
                    slope = program.coefficients[t]
                    for g in range(first, last):
                        if g != f:
                            slope *= flat[base + program.factor_step[g]]
                    inner[-step // n_channels] += slope
        for lag in range(1, depth + 1):
            slope = inner[lag]
            if slope != 0.0:
                inner[lag] = 0.0
                past = ring[(k - lag) % (depth + 1)]
                for t in range(n_candidates):
                    row[t] += slope * past[t]
        ring[k % (depth + 1)] = row

"""Fit a simulator's parameters, its effects and the windows' initial states by Levenberg-Marquardt."""

from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.fitting.directions import directions_of
from narx_sklearn.discrepancy.fitting.problem import Model, Problem, Projector
from narx_sklearn.discrepancy.simulators.linearise import linearise
from narx_sklearn.discrepancy.simulators.simulator import Run

SMALL = 1e-4  # relative step of the difference quotients: above the roughness of friction, below curvature
ITERATIONS = 25  # at most, where nobody says how many
NOTHING = 0.1  # of the tolerance: a step that promises less is not tried
GIVE_UP = 12  # dampings tried in one iteration, and once more with the windows' states on their own
LUCK = 4.0  # noise variances that a window gains by chance, of several states that a coarse sensor rounds
ROUNDING = 1e-13  # of a run's size
HARDLY_FELT = 1e-3  # noise deviations by which the runs change with all of a parameter
SILENT = 1e-9  # squared share of a response that the initial states do not explain: rounding, no response
POINTS = 3  # of a run, at which equations are asked which states they notice
NOTICED = 1e-6  # of the largest slope, beyond the rounding of difference quotients
SHARES = (0.25, 0.0625, 0.0)  # of a step, that the states of windows take which a whole one makes worse


class Fit(NamedTuple):
    """A fitted model and its linearisation."""

    model: Model
    cost: float  # sum of squared whitened residuals
    residual: np.ndarray  # (W, T) whitened, initial states projected out
    jacobian: np.ndarray  # (W, T, n_q) of y_sim, whitened, initial states projected out
    projector: Projector
    steps: np.ndarray  # difference steps of the global parameters
    converged: bool
    iterations: int
    gained: float  # share of the cost that the last iteration took off
    n_begun: int = 0  # initial states of windows that only effects feel

    @property
    def window_costs(self) -> np.ndarray:
        """Cost of each window, (W,)."""
        return np.einsum("wt,wt->w", self.residual, self.residual)


class Attempt(NamedTuple):
    """A model and what it gives."""

    model: Model
    run: Run
    residual: np.ndarray  # (W, T) whitened
    cost: float


class Tangents(NamedTuple):
    """A model's response to small moves, whitened."""

    steps: np.ndarray  # (n_q,) difference steps
    projector: Projector  # off what the initial states explain
    full: np.ndarray  # (W, T, n_q)
    projected: np.ndarray  # (W, T, n_q)


def state_scale(problem: Problem, model: Model, run: Run) -> np.ndarray:
    """Return a difference step for each initial state, from the size of its motion."""
    with np.errstate(invalid="ignore", over="ignore"):
        motion = np.nanstd(run.x[problem.rows[problem.inside]], axis=0)
        offset = np.nanmax(np.abs(model.x0), axis=0, initial=0.0)
    size = np.where(np.isfinite(motion) & (motion > 0), motion, np.maximum(offset, 1.0))
    return SMALL * size


def difference_steps(model: Model, bounds: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return signed difference steps for the global parameters, away from their upper bounds.

    A parameter whose bounds leave it no room has none.
    """
    q = model.q
    steps = SMALL * np.where(q != 0, np.abs(q), scale)
    steps = np.where(q + steps > bounds[:, 1], -steps, steps)
    return np.where(bounds[:, 0] == bounds[:, 1], 0.0, steps)


def all_bounds(problem: Problem, model: Model) -> np.ndarray:
    """Return the bounds of all global parameters, (n_q, 2)."""
    return np.concatenate([problem.simulator.bounds, *(e.bounds for e in model.effects)])


def fit(
    problem: Problem,
    model: Model,
    *,
    free: np.ndarray | None = None,
    iterations: int = ITERATIONS,
    tolerance: float = 1e-5,
    rough: bool = False,
    n_jobs: int | None = None,
) -> Fit:
    """Minimise the whitened output error over global parameters and initial states.

    The windows' initial states are eliminated exactly in every linear step, so only the few global
    parameters are damped. The cost never rises. Of the simulator's own parameters that only do something
    together (a mass and all forces on it) none goes where nothing is felt.

    Parameters
    ----------
    free : ndarray of bool of shape (n_q,), optional
        Which global parameters may move; all by default.
    rough : bool
        Whether the linearisation may be that of the last step's beginning, for fits that are only ranked.
    n_jobs : int, optional
        Threads that linearise.
    """
    frame = _Frame.of(problem, model, free, tolerance)
    model = model.with_q(np.clip(model.q, frame.bounds[:, 0], frame.bounds[:, 1]))
    now = _begun_as_measured(problem, _attempt(problem, model), frame.luck)
    x_steps = state_scale(problem, model, now.run)
    damping, done, converged, gained = 1e-3, 0, False, 0.0
    at = _tangents(frame, now, x_steps, n_jobs)
    while True:
        r = at.projector(_finite(now.residual))
        if done >= iterations or converged or not np.isfinite(now.cost):
            break
        done += 1
        before = now.cost
        now, damping = _descended(frame, now, at, r, x_steps / SMALL, damping)
        gained = (before - now.cost) / before if now.cost < before else 0.0
        converged = gained <= tolerance
        if not (rough and (done >= iterations or converged)):
            at = _tangents(frame, now, x_steps, n_jobs)
    order = now.model.rising
    model = problem.tied(now.model.with_q(now.model.q[order]))
    n_begun = _felt_by_effects(problem, now, x_steps / SMALL)
    J, steps = at.projected[:, :, order], at.steps[order]
    return Fit(model, now.cost, r, J, at.projector, steps, converged, done, gained, n_begun)


def linearised(problem: Problem, model: Model, x_steps: np.ndarray) -> Fit:
    """Return a model as a fit in which nothing moves, its initial states included.

    Parameters
    ----------
    x_steps : ndarray of shape (n_states,)
        Difference steps of the initial states.
    """
    now = _attempt(problem, model)
    at = _tangents(_Frame.of(problem, model, None, 0.0), now, x_steps, None)
    residual = at.projector(_finite(now.residual))
    return Fit(model, now.cost, residual, at.projected, at.projector, at.steps, True, 0, 0.0)


class _Frame(NamedTuple):
    """What stays as it is during a fit."""

    problem: Problem
    bounds: np.ndarray  # (n_q, 2)
    free: np.ndarray  # (n_q,) bool: may move
    scale: np.ndarray  # (n_q,) sizes that difference steps are shares of, where a parameter is zero
    least_felt: np.ndarray  # (n_q,) per unit of a parameter, in noise deviations
    rounding: float  # of a whole run, in noise deviations: no response is less
    luck: float  # noise variances that a window must gain for its states to move on their own
    tolerance: float

    @classmethod
    def of(cls, problem: Problem, model: Model, free: np.ndarray | None, tolerance: float) -> "_Frame":
        """Return the frame of a fit that begins with a model."""
        bounds = all_bounds(problem, model)
        lower, upper = bounds.T
        q = np.clip(model.q, lower, upper)
        # over its range a parameter counts for one noise deviation at least: what is hardly felt jumps no
        # further
        least_felt = np.divide(1.0, upper - lower, out=np.zeros(q.size), where=upper > lower)
        # through a coarse sensor each window could choose among states that differ in rounding alone
        luck = LUCK if any(effect.port.kind == "output" for effect in model.effects) else 0.0
        free = np.ones(q.size, dtype=bool) if free is None else free
        # a knee between two samples leaves a slope of rounding, and a step by it would go anywhere
        rounding = ROUNDING * float(np.linalg.norm(_finite(problem.whiten(problem.y))))
        scale = np.where(q != 0, np.abs(q), 1.0)
        return cls(problem, bounds, free, scale, least_felt, rounding, luck, tolerance)


def _tangents(frame: _Frame, now: Attempt, x_steps: np.ndarray, n_jobs: int | None) -> Tangents:
    """Linearise about an attempt."""
    problem, steps = frame.problem, difference_steps(now.model, frame.bounds, frame.scale)
    projector = Projector.of(_finite(problem.states_sensitivity(now.model, now.run, x_steps, n_jobs)))
    J = _finite(problem.parameter_sensitivity(now.model, now.run, steps, n_jobs))
    heard = np.sqrt(np.einsum("wti,wti->i", J, J)) * np.abs(steps)
    J[:, :, heard <= frame.rounding] = 0.0
    return Tangents(steps, projector, J, _heard(J, projector(J)))


def _descended(
    frame: _Frame, now: Attempt, at: Tangents, r: np.ndarray, x_size: np.ndarray, damping: float
) -> tuple[Attempt, float]:
    """Return a better attempt, and the damping to go on with; the attempt as it was where none is found.

    Parameters
    ----------
    r : ndarray of shape (n_windows, n_values)
        Whitened residual, initial states projected out.
    x_size : ndarray of shape (n_states,)
        How far the states move.
    """
    problem, (lower, upper), q = frame.problem, frame.bounds.T, now.model.q
    chosen = np.flatnonzero(problem.simulator.free_states)
    columns = at.projected.reshape(-1, q.size)
    gradient = columns.T @ r.ravel()
    movable = frame.free & ~((q <= lower) & (gradient < 0)) & ~((q >= upper) & (gradient > 0))
    hessian = columns.T @ columns
    felt = np.maximum(np.sqrt(np.diag(hessian)), frame.least_felt)
    movable &= np.diag(hessian) > 0
    own = np.flatnonzero(movable[: now.model.p.size])
    unfelt = _unfelt(hessian[np.ix_(own, own)])
    for attempt in range(2 * GIVE_UP):
        if attempt == GIVE_UP:  # without those that had far to go to be felt at all
            damping = 1e-3
            movable &= felt * frame.scale >= HARDLY_FELT
        move = _damped_step(hessian, gradient, movable, felt, damping)
        move[own] -= unfelt @ move[own]
        promised = now.cost - float(np.sum(r * r)) + move @ (2.0 * gradient - hessian @ move)
        if promised <= NOTHING * frame.tolerance * now.cost:
            break
        target = np.clip(q + move, lower, upper)
        x0 = now.model.x0.copy()
        left = now.residual - at.full @ (target - q)
        x0[:, chosen] += (at.projector.inverse @ _finite(left)[:, :, None])[:, :, 0]
        trial = _attempt(problem, now.model.with_q(target)._replace(x0=x0))
        if attempt >= GIVE_UP and not trial.cost < now.cost:
            trial = _windows_apart(problem, now, trial, x_size, frame.luck)
        if trial.cost < now.cost:
            return trial, max(damping / 9, 1e-9)
        damping = max(damping * 6, 1e-6)
    return now, damping


def _felt_by_effects(problem: Problem, now: Attempt, size: np.ndarray) -> int:
    """Return how many initial states of windows are felt that the simulator does not feel without effects.

    A measured speed does not tell where a motion is. An effect that asks for it lets every window choose its
    own place, and so its own gain or load, as no single law does.
    """
    if not (now.model.effects and np.isfinite(now.cost)):
        return 0
    changes = [
        _finite(problem.whiten(problem.run(now.model._replace(x0=now.model.x0 + move)).y - now.run.y))
        for move in _unseen_moves(problem, now.run, size)
    ]
    if not changes:
        return 0
    return int(np.sum(np.linalg.svd(np.stack(changes, axis=2), compute_uv=False) > 1.0))


def _unseen_moves(problem: Problem, run: Run, size: np.ndarray) -> np.ndarray:
    """Return moves of the states, (n_moves, n_states), that neither the equations nor the outputs notice.

    They are as large as the motion, and found at a few points of a run.
    """
    simulator = problem.simulator
    free = np.flatnonzero(simulator.free_states)
    rows = problem.rows[problem.inside]
    rows = rows[np.isfinite(run.x[rows]).all(axis=1)]
    noticed = []
    for row in rows[np.linspace(0, rows.size - 1, POINTS).astype(int)]:
        at = linearise(simulator, run.x[row], problem.u[row])
        noticed.append(np.concatenate([at.A - np.eye(len(at.A)) * simulator.discrete, at.C])[:, free])
    slopes = np.nan_to_num(np.concatenate(noticed)) * size[free]
    largest = np.abs(slopes).max(axis=1, initial=0.0, keepdims=True)
    _, values, directions = np.linalg.svd(slopes / np.where(largest > 0, largest, 1.0), full_matrices=True)
    n_noticed = int(np.sum(values > NOTICED * values.max(initial=0.0)))
    moves = np.zeros((free.size - n_noticed, size.size))
    moves[:, free] = directions[n_noticed:] * size[free]
    return moves


def _heard(full: np.ndarray, projected: np.ndarray) -> np.ndarray:
    """Return projected responses, zero where nothing but rounding is left of them.

    The offset of a sensor behind an integrator is one with the integrator's initial state. Measured in its
    own size, rounding would send it anywhere.
    """
    before, after = (np.einsum("wti,wti->i", J, J) for J in (full, projected))
    return np.where(after <= SILENT * before, 0.0, projected)


def _damped_step(
    hessian: np.ndarray, gradient: np.ndarray, movable: np.ndarray, felt: np.ndarray, damping: float
) -> np.ndarray:
    """Return the Levenberg-Marquardt step of the global parameters, zero for those that may not move."""
    move = np.zeros(gradient.size)
    index = np.flatnonzero(movable)
    if index.size:
        size = felt[index]
        normal = hessian[np.ix_(index, index)] / np.outer(size, size)
        normal[np.diag_indices_from(normal)] += damping
        move[index] = np.linalg.solve(normal, gradient[index] / size) / size
    return move


def _unfelt(hessian: np.ndarray) -> np.ndarray:
    """Return what takes a step to its part along which parameters do nothing together, (n, n).

    Difference quotients leave such a part a slope of rounding, and nothing would hold it: masses and forces
    go anywhere together.
    """
    found = directions_of(hessian)
    return (found.silent / found.size[:, None]) @ (found.silent.T * found.size)


def _windows_apart(
    problem: Problem, now: Attempt, trial: Attempt, farthest: np.ndarray, least: float
) -> Attempt:
    """Return an attempt whose windows take a share of their states' step only, where a whole one is worse.

    Where friction holds or turns about, a state's sensitivity says little of a whole step, and none is longer
    than the motion goes.
    """
    step = np.clip(trial.model.x0 - now.model.x0, -farthest, farthest)
    for share in SHARES:
        worse = ~(_by_window(trial.residual) <= _by_window(now.residual) - least)
        if not worse.any():
            break
        x0 = np.where(worse[:, None], now.model.x0 + share * step, trial.model.x0)
        trial = _attempt(problem, trial.model._replace(x0=x0))
    return trial


def fit_states(problem: Problem, model: Model, *, iterations: int = ITERATIONS) -> Fit:
    """Fit the windows' initial states alone, the global parameters as they are."""
    return fit(problem, model, free=np.zeros(model.q.size, dtype=bool), iterations=iterations)


def _attempt(problem: Problem, model: Model) -> Attempt:
    run = problem.run(model)
    residual = problem.residual(run)
    return Attempt(model, run, residual, _cost(residual))


def _by_window(residual: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore", invalid="ignore"):
        return np.einsum("wt,wt->w", residual, residual)


def _begun_as_measured(problem: Problem, now: Attempt, least: float) -> Attempt:
    """Return an attempt whose windows begin as the record tells where that leaves less.

    States were fitted without what is tried now. Where it makes a machine turn about, no tangent leads from
    them to the right ones.
    """
    for known in problem.measured_x0:
        x0 = np.where(np.isfinite(known) & problem.simulator.free_states, known, now.model.x0)
        if np.array_equal(x0, now.model.x0):
            continue
        afresh = _attempt(problem, now.model._replace(x0=x0))
        better = _by_window(afresh.residual) < np.nan_to_num(_by_window(now.residual), nan=np.inf) - least
        if better.any():
            now = _attempt(problem, now.model._replace(x0=np.where(better[:, None], x0, now.model.x0)))
    return now


def _cost(residual: np.ndarray) -> float:
    with np.errstate(over="ignore", invalid="ignore"):
        cost = float(np.einsum("wt,wt->", residual, residual))
    return cost if np.isfinite(cost) else np.inf


def _finite(tensor: np.ndarray) -> np.ndarray:
    return np.nan_to_num(tensor, nan=0.0, posinf=0.0, neginf=0.0)

"""Other valleys of the cost: values round those that a fit came to, for effects whose cost has many."""

from dataclasses import replace
from itertools import product

import numpy as np
from scipy.stats import qmc

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.bank import directions, off

OCTAVES = (1.0, 0.5, 0.25, 0.12)  # of each round, to either side; as parts of the range where it is finite
ASIDE = (-0.1, -0.05, -0.02, 0.0, 0.02, 0.05, 0.1)  # of the range, by which a threshold is moved at first
A_LITTLE = -0.02, -0.01, -0.005, 0.005, 0.01, 0.02  # of a value, by which what jumps is moved at last
FARTHEST = 8  # samples by which an end of what happened once is moved in each round
IN_SIGHT = (0.03, 0.1, 0.25)  # of a signal's values, beyond which levels are tried
BEGUN = (0.9, 0.3, 0.1)  # shares of the ends of its range at which what is lacking at first is tried
# of half the range in which a memory may begin, from its middle, and then from the best of these
ALL_OVER = 0.0, -0.03, 0.03, -0.1, 0.1, -0.25, 0.25, -0.5, 0.5, -0.75, 0.75, -1.0, 1.0
NEARBY = -0.12, -0.06, 0.06, 0.12
MOST_SESSIONS = 12  # of which each begins by itself
BY_CHANCE = 4.0  # noise variances that the beginning of each session has to take off
FITTED = 3  # values from which a fit goes on
ALL_ELSE, SETTLED = 6, 14  # iterations of such a fit with the values held, and then free


def other_valleys(problem: Problem, found: Fit) -> Fit:
    """Return a fit, or a better one from other values of its last effect.

    What holds and jumps changes the cost in steps, and a fit stays near its start. What each value would
    leave is told from one run, all else refitted on the tangents at hand; the best few are fitted, first
    with the values held. Beside thresholds that are chosen, the rest of their effect is all else.
    """
    found = _from_where_it_is_felt(problem, found)
    found = _begun_apart(problem, found)
    begun = found
    for octaves in OCTAVES:
        before = found
        last = before.model.effects[-1]
        others = _directions_but(before, 0 if last.effect.chosen else last.n_theta)
        tried = _tried_round(problem, last, octaves)
        models = [_with_last(before.model, last.at(theta)) for theta in tried]
        left = np.array([_left_by(problem, before, others, model) for model in models])
        for i in np.argsort(left, kind="stable")[:FITTED]:
            if np.isfinite(left[i]):
                found = min(found, _settled(problem, models[i]), key=lambda f: f.cost)
        # what has no rounds would try the same again
        if found is before and not (last.effect.valleys or last.effect.chosen):
            break
    return _moved_little(problem, found if found is begun else _begun_apart(problem, found))


def _moved_little(problem: Problem, found: Fit) -> Fit:
    """Return a fit, or a better one with a value of what holds and jumps a little off.

    By a hundredth another command is the one that it gives way to, and the path from there on another.
    """
    last = found.model.effects[-1]
    if not last.effect.valleys:
        return found
    others = _directions_but(found, last.n_theta)
    lower, upper = last.bounds.T
    best, least = last, found.cost
    for k in np.flatnonzero((upper > lower) & (np.arange(last.n_theta) != last.effect.begin)).tolist():
        for share in A_LITTLE:
            theta = np.array(best.theta)
            theta[k] = np.clip(theta[k] * (1.0 + share), lower[k], upper[k])
            left = _left_by(problem, found, others, _with_last(found.model, best.at(theta)))
            best, least = (best.at(theta), left) if left < least else (best, least)
    if best is last:
        return found
    return min(found, _settled(problem, _with_last(found.model, best)), key=lambda f: f.cost)


def _from_where_it_is_felt(problem: Problem, found: Fit) -> Fit:
    """Return a fit, or a better one with more lacking at first than is caught up within a sample.

    Of that little, a limit in code has no slope. Only what would leave less as it stands is fitted.
    """
    last = found.model.effects[-1]
    models = [_with_last(found.model, last.at(theta)) for theta in begun_elsewhere(last)]
    if not models:
        return found
    others = _directions_but(found, last.n_theta)
    left = [_left_by(problem, found, others, model) for model in models]
    if min(left) >= found.cost:
        return found
    better = fit(problem, models[int(np.argmin(left))], iterations=SETTLED)
    return min(found, better, key=lambda f: f.cost)


def _begun_apart(problem: Problem, found: Fit) -> Fit:
    """Return a fit, or a better one whose last effect begins elsewhere in each session.

    Nobody moved a machine back to where its valve had stuck, or its gears had met, before. What each session
    leaves with a beginning is told from a run of all sessions with that.
    """
    last = found.model.effects[-1]
    begin = last.effect.begin
    if begin is None or not begins_in_sessions(problem, last):
        return found
    lower, upper = last.bounds[begin]
    sessions = np.unique(problem.windows.began)
    at = np.array([dict(last.begins).get(int(began), last.theta[begin]) for began in sessions])
    least = _left_in_sessions(problem, found, found.model)
    for shares in (ALL_OVER, NEARBY):
        middle = at if shares is NEARBY else 0.5 * (lower + upper)
        tried = np.clip(middle + 0.5 * (upper - lower) * np.array(shares)[:, None], lower, upper)
        for values in np.broadcast_to(tried, (len(shares), sessions.size)):
            model = _with_last(found.model, _begun(last, sessions, values))
            left = _left_in_sessions(problem, found, model)
            at, least = np.where(left < least, values, at), np.minimum(left, least)
    better = fit(problem, _with_last(found.model, _begun(last, sessions, at)), iterations=SETTLED)
    by_chance = BY_CHANCE * sessions.size * found.cost / problem.n_seen
    return better if better.cost < found.cost - by_chance else found


def begins_in_sessions(problem: Problem, placed: PlacedEffect) -> bool:
    """Tell whether an effect at an input or output has a memory that each of several sessions begins anew."""
    begin = placed.effect.begin
    if begin is None or placed.port.kind not in ("input", "output"):
        return False
    lower, upper = placed.bounds[begin]
    if not (upper > lower and np.isfinite([lower, upper]).all()):
        return False
    return 1 < np.unique(problem.windows.began).size <= MOST_SESSIONS


def _begun(placed: PlacedEffect, sessions: np.ndarray, values: np.ndarray) -> PlacedEffect:
    """Return an effect that begins in sessions, each by its first sample, where values say."""
    theta = np.array(placed.theta)
    theta[placed.effect.begin] = values[0]
    others = zip(sessions[1:].tolist(), values[1:].tolist(), strict=True)
    return replace(placed, begins=tuple(others)).at(theta)


def _left_in_sessions(problem: Problem, found: Fit, model: Model) -> np.ndarray:
    """Return what a model leaves in each session, its windows' states refitted on the tangents at hand."""
    residual = found.projector(problem.residual(problem.run(model)))
    left = np.where(np.isfinite(residual), residual, np.inf)
    began, of_each = np.unique(problem.windows.began, return_inverse=True)
    return np.bincount(of_each, np.sum(left**2, axis=1), began.size)


def may_lie_elsewhere(placed: PlacedEffect) -> bool:
    """Tell whether other values of an effect are worth a try, since its cost has no slope towards them."""
    is_chosen = placed.effect.choice is not None
    jumps = placed.effect.valleys or placed.effect.instants or placed.effect.chosen
    return bool(is_chosen or jumps or _limits_an_input(placed))


def _limits_an_input(placed: PlacedEffect) -> bool:
    return bool(placed.effect.levels) and placed.port.kind == "input"


def _tried_round(problem: Problem, placed: PlacedEffect, octaves: float) -> np.ndarray:
    if placed.effect.instants:
        return moved_in_time(placed, problem.simulator.dt)
    if placed.effect.chosen:
        return thresholds_moved(placed, octaves)
    if placed.effect.choice is not None:
        return at_other_end(placed, placed.effect.choice)
    if _limits_an_input(placed):
        return levels_in_sight(placed, problem.u[problem.rows[problem.inside], placed.port.index])
    return spread_round(placed, octaves)


def spread_round(placed: PlacedEffect, octaves: float) -> np.ndarray:
    """Return values spread evenly (Halton 1960) round an effect's, within octaves or a share of its range.

    Those beyond an end of the range stand at it. Where a memory begins a fit finds by itself.
    """
    n, theta, bounds = placed.effect.valleys, np.array(placed.theta), placed.bounds
    moving = np.arange(theta.size) != placed.effect.begin
    points = np.full((n, theta.size), 0.5)
    even = qmc.Halton(int(moving.sum()), scramble=False)
    points[:, moving] = even.random(n + 1)[1:]  # the first is a corner
    lower, upper = bounds.T
    ranged = np.isfinite(lower) & np.isfinite(upper)
    width = np.where(ranged, octaves * (upper - lower), 0.0)
    moved = np.where(
        ranged, theta + 2.0 * width * (points - 0.5), theta * 2.0 ** (octaves * (2 * points - 1))
    )
    return np.clip(moved, lower, upper)


def thresholds_moved(placed: PlacedEffect, octaves: float) -> np.ndarray:
    """Return values with the thresholds that are chosen moved by shares of their range, each and together."""
    chosen = list(placed.effect.chosen)
    limits = np.array(placed.limits)[chosen]
    moves = np.array(list(product(ASIDE, repeat=len(chosen)))) * octaves * np.ptp(limits, axis=1)
    tried = np.tile(placed.theta, (len(moves), 1))
    tried[:, chosen] = np.clip(tried[:, chosen] + moves, *limits.T)
    return tried


def at_other_end(placed: PlacedEffect, chosen: int) -> np.ndarray:
    """Return values with the one that is chosen at the other end of its range."""
    parameter, other = placed.effect.parameters[chosen], np.array(placed.theta)
    other[chosen] = parameter.lower + parameter.upper - other[chosen]
    return other[None]


def begun_elsewhere(placed: PlacedEffect) -> np.ndarray:
    """Return values with more lacking at first, or there already; none where a little of it has a slope."""
    begin = placed.effect.begin
    if begin is None or placed.effect.choice is None or not np.ptp(placed.bounds[begin]) > 0:
        return np.empty((0, placed.n_theta))
    tried = np.tile(placed.theta, (2 * len(BEGUN), 1))
    tried[:, begin] = np.outer(placed.bounds[begin], BEGUN).ravel()
    return tried


def levels_in_sight(placed: PlacedEffect, signal: np.ndarray) -> np.ndarray:
    """Return values with a level that lies beyond a signal within its range; none where none lies beyond.

    What is never reached has no slope, by which a fit could find back.
    """
    low, high = placed.effect.levels
    shares = np.array(IN_SIGHT)
    tried = np.tile(placed.theta, (2 * shares.size, 1))
    tried[: shares.size, low] = np.quantile(signal, shares)
    tried[shares.size :, high] = np.quantile(signal, 1 - shares)
    least, most = placed.theta[low] < signal.min(), placed.theta[high] > signal.max()
    tried = tried[np.repeat([least, most], shares.size)]
    return tried[tried[:, low] < tried[:, high]]


def moved_in_time(placed: PlacedEffect, dt: float) -> np.ndarray:
    """Return values with the beginning, or the end, of what happened once some samples earlier or later.

    None where the record itself tells both.
    """
    begin, duration = placed.effect.instants or (0, 0)
    steps = dt * np.delete(np.arange(-FARTHEST, FARTHEST + 1), FARTHEST)
    moved = np.tile(placed.theta, (2 * steps.size, 1))
    moved[: steps.size, begin] += steps
    moved[: steps.size, duration] -= steps
    moved[steps.size :, duration] += steps
    lower, upper = placed.bounds.T
    return moved[((lower <= moved) & (moved <= upper)).all(axis=1) & (moved[:, duration] > 0)]


def _settled(problem: Problem, model: Model) -> Fit:
    own, begin = model.theirs[-1], model.effects[-1].effect.begin
    all_else = np.arange(model.q.size) < own.start
    if begin is not None:
        all_else[own.start + begin] = True
    return fit(problem, fit(problem, model, free=all_else, iterations=ALL_ELSE).model, iterations=SETTLED)


def _with_last(model: Model, effect: PlacedEffect) -> Model:
    return model._replace(effects=(*model.effects[:-1], effect))


def _directions_but(found: Fit, n_held: int) -> np.ndarray:
    """Return the directions of all that was fitted but the last values, which are held."""
    return directions(found.jacobian[:, :, : found.model.q.size - n_held])


def _left_by(problem: Problem, found: Fit, others: np.ndarray, model: Model) -> float:
    residual = found.projector(problem.residual(problem.run(model)))
    return float(np.sum(off(others, residual) ** 2)) if np.isfinite(residual).all() else np.inf

"""Explanations that hold another one, or nothing, as a special case: how far from it the data let them be."""

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, all_bounds, fit, fit_states
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.bank import out_of
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.inference import covariance

ALLOWED = 2.0  # standard deviations that a parameter may be off its fitted value
HALVINGS = 6  # of a move that changes the run more than its tangent says
SIZES = 12  # of an effect that are tried


def as_large_as_allowed(
    problem: Problem, without: Fit, candidate: Candidate, effect: PlacedEffect
) -> Candidate:
    """Return an explanation with one effect, that the data do not show, as large as they allow.

    On the way from its fitted parameters to those of ``effect``, at the same place, and beyond, all else is
    refitted; it ends where the cost has risen by ``ALLOWED`` standard deviations over that of the fit
    ``without`` it. Tangents would not do: a play or a dead zone of no width has none.
    """
    model = candidate.fit.model
    at = next(i for i, placed in enumerate(model.effects) if placed.place == effect.place)
    least, ordinary = (np.array(placed.theta) for placed in (model.effects[at], effect))
    free = np.ones(model.q.size, dtype=bool)
    free[model.theirs[at]] = False
    low, high, share, found = 0.0, np.inf, 1.0, candidate
    for _ in range(SIZES):
        placed = effect.at(np.clip(least + share * (ordinary - least), *effect.bounds.T))
        effects = (*model.effects[:at], placed, *model.effects[at + 1 :])
        tried = fit(problem, model._replace(effects=effects), free=free)
        if tried.cost <= without.cost + ALLOWED**2:
            low, found = share, Candidate(tried, candidate.n_samples)
        else:
            high = share
        share = 2 * low if np.isinf(high) else (low + high) / 2 if low > 0 else high / 4
    return found


def farthest_allowed(problem: Problem, general: Candidate, special: Candidate) -> Model:
    """Return an explanation as far from its special case as the data allow, where its fit came down to that.

    Two fits that are one and the same tell nothing of what could separate their explanations. Every parameter
    of the effects is moved by its standard deviations, all others going along to first order; the move that
    the special case can follow least is made.
    """
    found = general.fit
    model, own = found.model, found.model.p.size
    if found.cost < special.fit.cost - ALLOWED**2 or model.q.size == own:
        return model
    spread = covariance(problem, found)
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    begins = [k == e.effect.begin for e in model.effects for k in range(e.n_theta)]
    movable = own + np.flatnonzero((deviation[own:] > 0) & ~np.array(begins, dtype=bool))
    if not movable.size:
        return model
    bounds = all_bounds(problem, model)
    moves = ALLOWED * spread[:, movable] / deviation[movable]
    moves = np.concatenate([moves, -moves], axis=1)
    moves = np.clip(model.q[:, None] + moves, bounds[:, :1], bounds[:, 1:]) - model.q[:, None]
    not_followed = np.linalg.norm(out_of(special.fit.jacobian, found.jacobian @ moves), axis=(0, 1))
    move = moves[:, np.argmax(not_followed)]
    for _ in range(HALVINGS):
        moved = fit_states(problem, model.with_q(model.q + move))
        if moved.cost <= found.cost + (2 * ALLOWED) ** 2:
            return moved.model
        move = move / 2
    return model

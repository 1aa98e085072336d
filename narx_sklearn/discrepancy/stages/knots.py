"""A broken line drawn again with its knots where the law bends."""

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.search.candidate import FINE, Candidate
from narx_sklearn.discrepancy.search.unnamed.broken_line import KNOTS, knots_where_it_bends, with_knots
from narx_sklearn.discrepancy.search.unnamed.kinds import CURVE

ROUNDS = 3  # of fits and knots, each of which shows better where the law bends


def drawn_again(problem: Problem, candidate: Candidate) -> Candidate:
    """Return a set of which the last law is a broken line, its knots where that bends, if that pays.

    Even knots miss a law that bends in one place, as what falls off with a distance does near to it; and they
    were spread over where the machine goes without the law. Where knots are is chosen by the data, which has
    the price of one more parameter of Schwarz (1978).
    """
    if not candidate.effects or candidate.effects[-1].effect.code != CURVE:
        return candidate
    best, last = candidate, candidate
    for _ in range(ROUNDS):
        placed = last.effects[-1]
        values = _argument(problem, last)
        theta = np.array(placed.theta)
        knots = knots_where_it_bends(theta[KNOTS : 2 * KNOTS], theta[:KNOTS], values)
        if not np.all(np.diff(knots) > 0):
            break
        model = last.fit.model._replace(effects=(*last.effects[:-1], with_knots(placed, knots)))
        last = Candidate(fit(problem, model, iterations=FINE), candidate.n_samples)
        if not last.fit.cost < best.fit.cost:
            break
        best = last
    gained = candidate.criterion - best.criterion
    return best if gained > np.log(candidate.n_samples) else candidate


def _argument(problem: Problem, candidate: Candidate) -> np.ndarray:
    """Return what the last law of a set depends on, along the samples fitted."""
    placed, rows = candidate.effects[-1], problem.rows[problem.inside]
    run = problem.run(candidate.fit.model)
    if placed.is_fed:
        values = np.column_stack([problem.u, run.x])[rows] @ np.array(placed.second)
    elif placed.port.kind == "state":
        values = run.x[rows] @ np.array(placed.weights)
    else:
        values = (problem.u if placed.port.kind == "input" else run.y)[rows][:, placed.port.index]
    return values[np.isfinite(values)]

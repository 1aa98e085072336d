"""Parameters of the simulation that are not the same in all sessions: a payload, or a medium, was changed."""

from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.simulators.windows import FEWEST_VALUES, chosen_of

MOST = 12  # sessions that are fitted apart


class Part(NamedTuple):
    """A session, and the simulation fitted to it alone."""

    problem: Problem
    fit: Fit


class Apart(NamedTuple):
    """A record whose sessions were fitted apart, each with parameters of its own."""

    parts: tuple[Part, ...]
    criterion: float  # as of a ``Candidate``: what a set of effects would have to be likelier than


def began_of(problem: Problem) -> np.ndarray:
    """Return the first sample of each session, (n_sessions,)."""
    return np.unique(problem.windows.began)


def fit_apart(problem: Problem, refitted: Fit, n_jobs: int | None = None) -> Apart | None:
    """Return what the simulation leaves with parameters of its own in each session.

    None where there is one session only, or very many, or one that is too short, or no parameter.
    """
    sessions = began_of(problem)
    if not 1 < sessions.size <= MOST or not len(problem.simulator.parameters):
        return None
    parts = []
    for began in sessions:
        chosen = np.flatnonzero(problem.windows.began == began)
        own = problem.over(chosen_of(problem.windows, chosen))
        if own.seen.sum() < FEWEST_VALUES:
            return None
        model = refitted.model._replace(x0=refitted.model.x0[chosen])
        parts.append(Part(own, fit(own, model, n_jobs=n_jobs)))
    n_values = sum(Candidate(part.fit, part.problem.n_seen).n_parameters for part in parts)
    n = sum(part.problem.n_seen for part in parts)
    cost = sum(part.fit.cost for part in parts)
    likelihood = n * np.log(max(cost, 1e-300) / n)
    return Apart(tuple(parts), float(likelihood + 2 * np.log(np.log(n)) * n_values))

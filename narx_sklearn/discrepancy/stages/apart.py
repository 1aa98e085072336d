"""Parameters of the simulation that are not the same in all sessions: a payload, or a medium, was changed."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2, norm

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.inference import covariance, intervals
from narx_sklearn.discrepancy.simulators.windows import FEWEST_VALUES, chosen_of

MOST = 12  # sessions that are fitted apart
LEVEL = 0.9  # of the intervals by which parameters are held against each other
BY_CHANCE = 0.05  # chance that a parameter which is the same in all sessions is said to differ


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


def own_parameters(parts: Sequence[Part], level: float = LEVEL) -> tuple[np.ndarray, np.ndarray]:
    """Return the parameters of each session, (n_parts, n_p), and their intervals, (n_parts, n_p, 2)."""
    values = np.array([part.fit.model.p for part in parts])
    return values, np.array([intervals(*part, level)[: values.shape[1]] for part in parts])


def differing(values: np.ndarray, sure: np.ndarray) -> np.ndarray:
    """Tell which parameters are surely not the same in all sessions, (n_p,); all where none alone is.

    Of what ``own_parameters`` returns, at ``LEVEL``.
    """
    told = np.array(
        [differs(v, s, values.shape[1]) for v, s in zip(values.T, sure.swapaxes(0, 1), strict=True)]
    )
    return told if told.any() else np.ones(told.size, dtype=bool)


def differs(values: np.ndarray, sure: np.ndarray, n_asked: int) -> bool:
    """Tell whether values, (n,), with their intervals, (n, 2), are surely not all one (Cochran's Q)."""
    error = (sure[:, 1] - sure[:, 0]) / (2.0 * norm.isf((1.0 - LEVEL) / 2.0))
    if not np.all(np.isfinite(error) & (error > 0)):
        return False
    weights = 1.0 / error**2
    mean = float(weights @ values / weights.sum())
    return bool(weights @ (values - mean) ** 2 > chi2.isf(BY_CHANCE / n_asked, values.size - 1))


class InCommon(NamedTuple):
    """Parameters that are the same in all sessions, as all of them together tell them."""

    indices: np.ndarray  # (n_common,)
    values: np.ndarray
    errors: np.ndarray  # standard ones


def in_common(parts: Sequence[Part]) -> InCommon | None:
    """Return the parameters that do not surely differ, weighed by what each session tells of them.

    One set for all sessions bends them to make up for those that do differ. None where a session tells them
    together with others alone.
    """
    indices = np.flatnonzero(~differing(*own_parameters(parts)))
    if not indices.size:
        return None
    weight, weighted = np.zeros((indices.size, indices.size)), np.zeros(indices.size)
    size = np.abs(parts[0].fit.model.p[indices])
    for problem, found in parts:
        own = covariance(problem, found)[np.ix_(indices, indices)] / np.outer(size, size)
        if not np.isfinite(own).all() or np.linalg.matrix_rank(own) < indices.size:
            return None
        told = np.linalg.inv(own)
        weight += told
        weighted += told @ (found.model.p[indices] / size)
    together = np.linalg.inv(weight)
    return InCommon(indices, size * (together @ weighted), size * np.sqrt(np.diag(together)))


def intervals_apart(parts: Sequence[Part], level: float) -> np.ndarray:
    """Return intervals of the parameters, (n_p, 2), over all sessions where they are not in common."""
    _, sure = own_parameters(parts, level)
    rows = np.column_stack([sure[:, :, 0].min(axis=0), sure[:, :, 1].max(axis=0)])
    common = in_common(parts)
    if common is not None:
        width = norm.ppf(0.5 + level / 2) * common.errors
        rows[common.indices] = np.column_stack([common.values - width, common.values + width])
    return rows


def with_common(problem: Problem, refitted: Fit, parts: Sequence[Part], n_jobs: int | None = None) -> Fit:
    """Return a refit with one set of parameters for all sessions, those in common as they all tell them."""
    common = in_common(parts)
    if common is None:
        return refitted
    p = refitted.model.p.copy()
    p[common.indices] = common.values
    free = np.ones(p.size, dtype=bool)
    free[common.indices] = False
    found = fit(problem, refitted.model._replace(p=p), free=free, n_jobs=n_jobs)
    return found if np.isfinite(found.cost) else refitted

"""Forces that go as a power of a signal: is it the one that the name says, or one that has no name?"""

from collections.abc import Iterable

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.candidate import FINE, Candidate
from narx_sklearn.discrepancy.search.confirm import chance_of_noise, deviance
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.inference import covariance
from narx_sklearn.discrepancy.search.places import odd_if_coupled
from narx_sklearn.discrepancy.search.unnamed.broken_line import ends_of
from narx_sklearn.discrepancy.search.unnamed.kinds import INVERSE, ODD_POWER
from narx_sklearn.discrepancy.search.unnamed.powers import (
    HALF,
    INVERSES,
    POWERS,
    ROOTS,
    as_root,
    placed_powers,
    with_free_power,
)
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.stages.laws import refit_laws

SURELY = 1.64  # standard errors beyond what a power may be off by


def with_another_power(problem: Problem, best: Candidate, alpha: float) -> Candidate | None:
    """Return a set in which a law goes as another power than it has by its name, if one surely does.

    No form is exact; a power that may be off by no more than a half is still the name's. One more number is
    fitted. In the place of an odd one a root is tried too.
    """
    x = problem.run(best.fit.model).x[problem.rows[problem.inside]]
    for i, placed in enumerate(best.effects):
        power, size = placed.effect.power, abs(x @ placed.weights).max() if placed.weights else 0.0
        if power is None or not size > 0:
            continue
        freed = [with_free_power(placed, power, size)]
        low, high = ends_of(x @ placed.weights)
        if power.odd and low < 0 < high:
            freed.append(as_root(placed, size))
        found = min((_with(problem, best, i, law) for law in freed), key=lambda c: c.fit.cost)
        at = found.fit.model.theirs[i].start + 1
        error = np.sqrt(covariance(problem, found.fit)[at, at])
        if abs(found.fit.model.q[at] - power.exponent) - SURELY * error <= HALF:
            continue
        gained = deviance(problem, best.fit.model) - deviance(problem, found.fit.model)
        if chance_of_noise(gained, 1, 1) <= alpha:
            return found
    return None


def _with(problem: Problem, best: Candidate, i: int, law: PlacedEffect) -> Candidate:
    """Return a set with a law in the place of one of its effects."""
    effects = (*best.effects[:i], law, *best.effects[i + 1 :])
    return Candidate(fit(problem, best.fit.model._replace(effects=effects), iterations=FINE), best.n_samples)


def best_power(
    problem: Problem,
    refitted: Fit,
    beside: Fit,
    structure: Structure,
    known: Iterable[Hypothesis],
    n_jobs: int | None = None,
    named: Candidate | None = None,
) -> Candidate | None:
    """Return the single force that goes best as a power none of what is ``known`` has; None where none does.

    It is fitted from the refit, and from the parameters that go with what stands ``beside`` it, to the
    end where it comes near what is ``named``.
    """
    powers = placed_powers(problem.simulator, structure, _where_it_was(problem, refitted))
    placed = [odd_if_coupled(power, structure) for power in powers]
    found = refit_laws(problem, refitted, beside, placed, n_jobs, named)
    return found[0] if found and _is_new(found[0].effects[-1], known) else None


def _where_it_was(problem: Problem, refitted: Fit) -> np.ndarray:
    """Return the states (n, n_states) along a record: as measured, or else as simulated.

    Without what is missing a simulation may go where the machine never was, through a wall even.
    """
    rows = problem.rows[problem.inside]
    simulated = problem.run(refitted.model).x[rows]
    began = np.repeat(problem.windows.began, problem.windows.last - problem.windows.first)
    measured = problem.simulator.known_states(problem.u, problem.y, rows, began)
    return np.where(np.isfinite(measured), measured, simulated)


def _is_new(power: PlacedEffect, known: Iterable[Hypothesis]) -> bool:
    """Tell whether a power is surely no line and no step, and no effect at home there has it."""
    exponent, is_odd = power.theta[1], power.effect.code == ODD_POWER
    if power.effect.code == INVERSE:  # none of the catalogue's does
        return exponent > INVERSES[0]
    if exponent < 1.0:
        return ROOTS[0] < exponent <= ROOTS[1]  # beside a line of the simulator that end is none
    taken = [
        h.placed.effect.power.exponent
        for h in known
        if h.placed.effect.power is not None
        and h.placed.effect.power.odd == is_odd
        and (h.placed.port, h.placed.weights) == (power.port, power.weights)
        and not h.placed.odd
    ]
    return exponent > POWERS[0] and all(abs(exponent - k) > HALF for k in taken)

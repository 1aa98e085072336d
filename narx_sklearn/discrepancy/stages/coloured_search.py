"""The search for what is missing, under noise whose colour is estimated from what the search leaves."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit, fit_states
from narx_sklearn.discrepancy.noise import estimate_noise
from narx_sklearn.discrepancy.search.bank import Bank, flexible_residual, make_bank
from narx_sklearn.discrepancy.search.candidate import HARDLY, Candidate, converged, once_each
from narx_sklearn.discrepancy.search.confirm import CLEARER, clearer_noise, deviance
from narx_sklearn.discrepancy.search.detect import NONE_SILENT
from narx_sklearn.discrepancy.search.explain import (
    Step,
    refit_leaders,
    refit_pairs,
    search,
)
from narx_sklearn.discrepancy.search.harmonics import with_one_course
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis, enumerate_hypotheses
from narx_sklearn.discrepancy.search.lookalikes import likeliest
from narx_sklearn.discrepancy.search.members import without
from narx_sklearn.discrepancy.search.ranking import leaders, with_nearest, with_pushes
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.structure import Structure

MOSTLY = 0.5  # share of the cost left by one effect, from which the residual was mostly structure
LOST = 0.5  # share of what an explanation takes off, from which a refit that does so too was lost before
VALLEYS = 3  # to which explanations may lead a refit, one after another
FAR = 3.0  # times a nominal value, or a part of it, that nobody is so wrong about
FAINT = 0.9  # share of the cost left by all tangents together, beyond which no effect leaves half of it
LOOKS = 2  # under a clearer noise, at most
RIVALS = 3  # next best explanations that may be likelier, each under noise of its own


class Searched(NamedTuple):
    """A problem under noise of its own colour, the fit of the simulator's own parameters, and a search."""

    problem: Problem
    refitted: Fit
    steps: list[Step]  # none where there is nothing but rounding

    @property
    def p_value(self) -> float:
        """Chance that nothing is missing."""
        return self.steps[0].detection.p_value if self.steps else 1.0

    @property
    def pool(self) -> list[Candidate]:
        """All that was fitted, best first."""
        return pool_of(self.steps)

    @property
    def hypotheses(self) -> list[Hypothesis]:
        """All that was tried, as it was tried last."""
        return list({h.placed.place: h for step in self.steps for h in step.bank.hypotheses}.values())


def coloured_search(
    problem: Problem, refitted: Fit, structure: Structure, settings: Settings, *, valleys: int = VALLEYS
) -> Searched:
    """Estimate the colour of the noise, and search for what is missing under it.

    Where the best explanation but led the simulator's own parameters to a better valley, all begins anew from
    there: what a refit leaves that lost its way is nothing that is missing.
    """
    settings.tell("colour of the noise")
    hypotheses = hypotheses_of(problem, refitted, structure, settings)
    bank = make_bank(problem, refitted, hypotheses, settings.n_jobs)
    residual = _without_structure(problem, bank)
    bank = bank.without_columns()
    faint = np.sum((residual / problem.noise.sigma) ** 2) > FAINT * refitted.cost
    known = [] if faint else _leading(problem, refitted, bank, structure, settings)
    if known and valleys and (led := _led_farther(problem, refitted, known[0])) is not None:
        return coloured_search(problem, led, structure, settings, valleys=valleys - 1)
    if known and settings.max_effects > 1:
        known += refit_pairs(problem, refitted, bank, known, settings.n_leaders, settings.n_jobs)
        known.sort(key=lambda c: c.criterion)
    dominated = bool(known) and known[0].fit.cost < MOSTLY * refitted.cost
    if dominated:
        # mostly structure, far from what its tangents show: only beside a full fit is the rest near them
        rest = [h for h in hypotheses if h.placed.place not in known[0].places]
        residual = _without_structure(problem, make_bank(problem, known[0].fit, rest, settings.n_jobs))
    problem = problem.with_noise(estimate_noise(residual, problem.seen))
    refitted = fit(problem, refitted.model, n_jobs=settings.n_jobs)
    settings.tell("search for missing physics")
    found = Searched(
        problem, refitted, steps_beside(problem, refitted, structure, settings, dominated, known)
    )
    if valleys and found.pool and found.p_value <= settings.alpha:
        led = _led_farther(problem, refitted, found.pool[0])
        if led is not None:
            return coloured_search(problem, led, structure, settings, valleys=valleys - 1)
    for _ in range(LOOKS):
        found = _beside_its_course(found, structure, settings)
        again = _under_clearer_noise(found, structure, settings)
        if again is None:
            break
        found = again
    return found


def _beside_its_course(found: Searched, structure: Structure, settings: Settings) -> Searched:
    """Search on beside a sine with its harmonics, where the likeliest set has such: they are no noise."""
    problem, refitted, pool = found.problem, found.refitted, found.pool
    if not pool or found.p_value > settings.alpha:
        return found
    best = likeliest(pool, refitted.cost)
    if with_one_course(problem, best, pool, refitted.cost, settings.alpha, settings.n_jobs) is best:
        return found
    known = sorted((c for c in pool if len(c.effects) <= 2), key=lambda c: c.criterion)
    return found._replace(steps=steps_beside(problem, refitted, structure, settings, True, known))


def _led_farther(problem: Problem, refitted: Fit, best: Candidate) -> Fit | None:
    """Return the refit from where an explanation led, if that takes off most of what the explanation does."""
    led = without(problem, best, list(best.effects)).fit
    least = max(LOST * (refitted.cost - best.fit.cost), HARDLY * refitted.cost / problem.n_seen)
    return led if refitted.cost - led.cost > least else None


def _without_structure(problem: Problem, bank: Bank) -> np.ndarray:
    """Return what is left of the outputs, (W, L, n_outputs), when a bank's best columns are fitted freely."""
    residual = flexible_residual(bank, problem.n_seen)[0]
    return residual.reshape(problem.seen.shape) * problem.noise.sigma


def _under_clearer_noise(before: Searched, structure: Structure, settings: Settings) -> Searched | None:
    """Search again where an explanation leaves a clearly likelier noise; None where nothing new comes of it.

    What was found before takes part again. Noise that was estimated beside one explanation favours it, so
    the next best may be clearly likelier, each under the noise that it leaves itself.
    """
    problem, pool = before.problem, before.pool
    if not pool or before.p_value > settings.alpha:
        return None
    best = likeliest(pool, before.refitted.cost)
    rivals = [c for c in pool if len(c.effects) == len(best.effects) and c is not best][:RIVALS]
    found = Parallel(n_jobs=settings.n_jobs, prefer="threads")(
        delayed(deviance)(problem, c.fit.model) for c in (best, *rivals)
    )
    priced = [value + c.price for value, c in zip(found, (best, *rivals), strict=True)]
    if min(priced) < priced[0] - CLEARER:
        best = rivals[int(np.argmin(priced)) - 1]
    noise = clearer_noise(problem, best.fit)
    if noise is None:
        return None
    settings.tell("search again, under the noise that the best explanation leaves")
    known = [c for c in pool if len(c.effects) <= 2]
    problem = problem.with_noise(noise)
    refitted = fit(problem, before.refitted.model, n_jobs=settings.n_jobs)
    found = Searched(problem, refitted, steps_beside(problem, refitted, structure, settings, True, known))
    if found.p_value > settings.alpha:
        return None
    if len(best.effects) > 1:
        found.steps[-1].candidates.append(converged(problem, best, settings.n_jobs))
    return found


def _leading(
    problem: Problem, refitted: Fit, bank: Bank, structure: Structure, settings: Settings
) -> list[Candidate]:
    """Return the best single effects under white noise, the first of them fully fitted.

    Where the simulator's own parameters went far to make up for what is missing, as for a sensor in kelvin
    in place of degrees, the way back from there is long, and what explains most beside their nominal values
    is fitted too.
    """
    placed = leaders(bank, settings.n_leaders, NONE_SILENT, 1.0)
    placed = with_nearest(problem, refitted, bank, placed, settings.n_jobs)
    found = refit_leaders(problem, refitted, placed, settings.n_jobs, finished=1)
    p = problem.simulator.nominal
    if not went_far(refitted.model.p, p):
        return found
    nominal = fit_states(problem, refitted.model._replace(p=p))
    bank = make_bank(problem, nominal, hypotheses_of(problem, nominal, structure, settings), settings.n_jobs)
    placed = with_pushes(bank, settings.n_leaders)
    placed = with_nearest(problem, nominal, bank, placed, settings.n_jobs)
    found += refit_leaders(problem, nominal, placed, settings.n_jobs, finished=1, twins=0)
    return once_each(sorted(found, key=lambda c: c.criterion))


def went_far(p: np.ndarray, nominal: np.ndarray) -> bool:
    """Tell whether parameters went farther from their nominal values than anybody is wrong about them."""
    near = (np.abs(p) <= FAR * np.abs(nominal)) & (np.abs(nominal) <= FAR * np.abs(p))
    return not np.all(near | (nominal == 0))


def kept_near(problem: Problem) -> Problem:
    """Return the problem with parameters that stay within what anybody may be wrong about them."""
    simulator = problem.simulator
    nominal = simulator.nominal
    ends = np.sort(np.column_stack([nominal / FAR, nominal * FAR]), axis=1)
    bounds = np.where(nominal[:, None] == 0, simulator.bounds, np.clip(ends, *simulator.bounds.T[:, :, None]))
    return replace(problem, simulator=simulator.with_bounds(bounds))


def steps_beside(
    problem: Problem,
    refitted: Fit,
    structure: Structure,
    settings: Settings,
    dominated: bool = False,
    known: Sequence[Candidate] = (),
) -> list[Step]:
    """Return a search for all that may be missing beside a fitted model."""

    def make_hypotheses(found: Fit) -> list[Hypothesis]:
        return hypotheses_of(problem, found, structure, settings)

    return search(problem, refitted, make_hypotheses, settings, dominated=dominated, known=known)


def hypotheses_of(problem: Problem, found: Fit, structure: Structure, settings: Settings) -> list[Hypothesis]:
    """Return all that may be missing beside a fitted model, at every place where it may act."""
    run = problem.run(found.model)
    return enumerate_hypotheses(settings.effects, problem, run, structure, settings.unasked, settings.n_jobs)


def pool_of(steps: Sequence[Step]) -> list[Candidate]:
    """Return all that was fitted in a search, best first."""
    return sorted((c for step in steps for c in step.candidates), key=lambda c: c.criterion)

"""What has no name: the best curve, power, product or wave, and whether it explains what is missing."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.placed import ALWAYS, PlacedEffect
from narx_sklearn.discrepancy.search.candidate import FINE, HARDLY, Candidate, converged, odd
from narx_sklearn.discrepancy.search.confirm import CLEARER, deviance, is_of_a_sensor
from narx_sklearn.discrepancy.search.explain import in_reach
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.inference import covariance
from narx_sklearn.discrepancy.search.places import odd_if_coupled
from narx_sklearn.discrepancy.search.unnamed.curves import curve_hypotheses
from narx_sklearn.discrepancy.search.unnamed.kinds import CHANGED, LINE, RADIATED
from narx_sklearn.discrepancy.search.unnamed.polynomials import TERMS, held_beyond, without_terms
from narx_sklearn.discrepancy.search.unnamed.proportions import line_hypotheses, pulse_hypotheses
from narx_sklearn.discrepancy.search.unnamed.varying import change_hypotheses
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.stages.coloured_search import went_far
from narx_sklearn.discrepancy.stages.knots import drawn_again
from narx_sklearn.discrepancy.stages.laws import at_other_ports, best_laws, refit_laws
from narx_sklearn.discrepancy.stages.powers import best_power
from narx_sklearn.discrepancy.stages.remainder import look_for_pulse
from narx_sklearn.discrepancy.stages.smooth import smoothed
from narx_sklearn.discrepancy.stages.temporary import with_settled_ends

UNEXPLAINED = 0.1  # share of what could be explained that may be left to anything else
SUSPECT = 0.05  # level at which something counts that is no finding of its own


def best_unnamed(
    problem: Problem,
    refitted: Fit,
    best: Candidate,
    structure: Structure,
    settings: Settings,
    known: Iterable[Hypothesis],
    waves: Sequence[float] = (),
) -> Candidate | None:
    """Return the best curve at any port, fitted from the refit and the parameters that go with the names.

    So are forces that go as a power, but one that an effect has which is ``known``, or as a product, storages
    that change, what acts near one place, and what remembers at an input or output. All act beside what the
    refit has already. Beside what acts for a while, curves are tried that do too, and a change of the
    simulator's own parameters meanwhile; and what pulsates at the frequencies of some ``waves``, Hz. What
    does not come near names is not fitted to the end, where that is enough to judge by.
    """
    curves = curves_along(problem, refitted, structure)
    times = {effect.during for effect in best.effects}
    during = times.pop() if len(times) == 1 else ALWAYS
    fine = 1.0 / (problem.simulator.dt * len(problem.y))  # between two that the record tells apart
    for wave in waves:
        curves += pulse_hypotheses(problem.simulator, structure, (wave - fine, wave + fine))
    placed = [curve.placed for curve in curves]
    if during != ALWAYS:
        curves += line_hypotheses(problem.simulator, structure)
        curves += change_hypotheses(problem.simulator)
        placed += [c.placed.acting(during) for c in curves]
    placed = [odd_if_coupled(law, structure) for law in placed]
    beside = refitted._replace(model=best.fit.model._replace(effects=refitted.model.effects))
    named = best if _is_enough(problem, best) else None
    found = refit_laws(problem, refitted, beside, placed, settings.n_jobs, named)
    if during != ALWAYS:
        found = _at_its_own_time(problem, found)
    power = best_power(problem, refitted, beside, structure, known, settings.n_jobs, named)
    laws = found[:1] + at_other_ports(found)
    if laws and (named is None or in_reach(laws[0], named, refitted)):
        laws[0] = drawn_again(problem, simplified(problem, laws[0]))
        nothing = Candidate(refitted, problem.n_seen).criterion
        laws = [smoothed(problem, law) if law.criterion < nothing else law for law in laws]
    laws += best_laws(problem, refitted, beside, structure, settings.n_jobs, named)
    laws += [power] if power is not None else []
    return _likeliest(problem, laws, settings.n_jobs)


def _at_its_own_time(problem: Problem, found: list[Candidate]) -> list[Candidate]:
    """Return laws that act for a while, best first, the first ones with the ends of their time settled.

    So are those of the best change of a parameter, and of what grows with a signal: what stood in for it came
    and went more gently, and a change that begins some samples off leaves more than that. Of these two it is
    a signal's where that is as likely: there it is known where it acts.
    """
    changes, lines = (
        [law for law in found if law.effects[-1].effect.code == code][:1] for code in (CHANGED, LINE)
    )
    leaders = {id(law) for law in (*found[:1], *changes, *lines) if len(law.effects) == 1}
    settled = [with_settled_ends(problem, law, 1, 0.0) if id(law) in leaders else law for law in found]
    line = min((law.criterion for law in settled if law.effects[-1].effect.code == LINE), default=np.inf)
    told = [law for law in settled if law.effects[-1].effect.code != CHANGED or law.criterion < line - HARDLY]
    return sorted(told, key=lambda law: law.criterion)


def _is_enough(problem: Problem, best: Candidate) -> bool:
    """Tell whether a law without a name has to come near to names to count.

    It has not where they come from elsewhere, or are a sensor's, where the parameters went far with them, or
    where the noise has a colour, which may hold what they leave.
    """
    if not best.effects or problem.noise.n_parameters or odd(best):
        return False
    at_sensors = all(is_of_a_sensor(effect) for effect in best.effects)
    return not at_sensors and not went_far(best.fit.model.p, problem.simulator.nominal)


def _likeliest(problem: Problem, laws: list[Candidate], n_jobs: int | None) -> Candidate | None:
    """Return the likeliest of laws, with the other ports at which one is hardly less likely; None of none.

    Noise was estimated beside something else, of which its colour may hold what that left: a sensor's error,
    say, that only looks like a drift. A law that is clearly likelier under the noise that it leaves itself
    then goes first. White noise holds nothing of the kind, and colour would excuse what a law leaves. That
    what is hot radiates is known before any data; that it loses a power of its rise is not.
    """
    if not laws:
        return None
    before = np.array([-HARDLY * (law.effects[-1].effect.code == RADIATED) for law in laws])
    own = np.array([deviance(problem, law.fit.model) + law.price for law in laws]) + before
    shared = np.array([law.criterion for law in laws]) + before
    at = int(np.argmin(shared))
    if problem.noise.n_parameters and own.min() < own[at] - CLEARER:
        at = int(np.argmin(own))
    as_likely = (shared <= shared[at] + HARDLY) & (own <= own[at] + CLEARER)
    places = [laws[k].effects[-1] for k in np.argsort(shared) if as_likely[k]]
    best = laws[at] if at == np.argmin(shared) else converged(problem, laws[at], n_jobs)
    return replace(best, elsewhere=tuple(law for law in places if law.port != best.effects[-1].port))


def simplified(problem: Problem, candidate: Candidate) -> Candidate:
    """Return a set without the terms of its last law that do not pay for themselves (Schwarz 1978).

    That is a polynomial. A law of the terms that are there holds also beyond the motion on which it was
    fitted. All that are lost in their errors go at once, then the weakest by turns.
    """
    if not candidate.effects or candidate.effects[-1].effect.code not in TERMS:
        return candidate
    best, dropped, at_once = candidate, set[int](), True
    while True:
        placed, theirs = best.effects[-1], best.fit.model.theirs[-1]
        n_terms = len(TERMS[placed.effect.code])
        dropped = {j for j in dropped if j < n_terms}
        if len(dropped) == n_terms - 1:
            return best
        error = np.sqrt(np.maximum(np.diag(covariance(problem, best.fit))[theirs][:n_terms], 0.0))
        size = np.abs(placed.theta[:n_terms]) / np.where(error > 0, error, np.inf)
        size[list(dropped)] = np.inf
        order = np.argsort(size)
        n_lost = min(np.count_nonzero(size < 1.0), n_terms - 1 - len(dropped)) if at_once else 1
        weak = set(order[: max(n_lost, 1)].tolist())
        fewer = without_terms(placed, dropped | weak)
        model = best.fit.model._replace(effects=(*best.effects[:-1], fewer))
        found = fit(problem, model, iterations=FINE)
        if found.cost - best.fit.cost <= len(weak) * np.log(candidate.n_samples):
            best, dropped = Candidate(found, candidate.n_samples), dropped | weak
        elif len(weak) == 1:
            return best
        at_once = False


def held_where_seen(problem: Problem, candidate: Candidate) -> Candidate:
    """Return a set whose polynomials stay as they are beyond the motion over which they were fitted."""
    model = candidate.fit.model
    if not any(effect.effect.code in TERMS for effect in model.effects):
        return candidate
    run, inside = problem.run(model), problem.inside

    def held(placed: PlacedEffect) -> PlacedEffect:
        position = run.x[problem.rows] @ np.array(placed.weights)
        rate = np.diff(position, axis=1)[inside[:, 1:]] / problem.simulator.dt
        ends = [float(end) for v in (position[inside], rate) for end in (np.nanmin(v), np.nanmax(v))]
        return held_beyond(placed, ends) if np.isfinite(ends).all() else placed

    effects = tuple(held(e) if e.effect.code in TERMS else e for e in model.effects)
    return replace(candidate, fit=candidate.fit._replace(model=model._replace(effects=effects)))


def best_pulsating(
    problem: Problem,
    refitted: Fit,
    unnamed: Candidate | None,
    structure: Structure,
    settings: Settings,
    known: Iterable[Hypothesis],
) -> Candidate | None:
    """Return what pulsates, where something surely does and it is better than a curve; else the curve."""
    pulse = look_for_pulse(problem, refitted, structure, settings.random_state)
    if pulse.p_value > settings.alpha_nameless:
        return unnamed
    base = Candidate(refitted, problem.n_seen)
    pulsating = best_unnamed(problem, refitted, base, structure, settings, known, pulse.frequencies)
    found = [c for c in (unnamed, pulsating) if c is not None]
    return min(found, key=lambda c: c.criterion, default=None)


def curves_along(problem: Problem, found: Fit, structure: Structure) -> list[Hypothesis]:
    """Return the unnamed curves at every port, knots where a fitted model's run goes."""
    run = problem.run(found.model)
    rows = problem.rows[problem.inside]
    return curve_hypotheses(problem.simulator, structure, problem.u[rows], run.x[rows], run.y[rows])

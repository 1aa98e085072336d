"""Which of the sets that a search found is named."""

from collections.abc import Callable
from functools import partial
from itertools import combinations

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.candidate import HARDLY, Candidate, converged, odd
from narx_sklearn.discrepancy.search.confirm import more_than_drift
from narx_sklearn.discrepancy.search.harmonics import with_one_course
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.lookalikes import ALIKE, REFINES, declared_rival, is_one_law, likeliest
from narx_sklearn.discrepancy.search.members import reordered, that_run, without, without_idle
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.stages.coloured_search import Searched
from narx_sklearn.discrepancy.stages.fading import with_what_fades
from narx_sklearn.discrepancy.stages.forms import FORM, along, taken_by_forms
from narx_sklearn.discrepancy.stages.swaps import as_one_law, exchanges, special_cases, swaps, untried

EXCHANGES = 2  # members of a set that may be exchanged


def named_set(
    searched: Searched, pool: list[Candidate], structure: Structure, settings: Settings
) -> Candidate:
    """Return the set of effects that a search found likeliest, fitted to the end.

    Sets that are tried on the way join the ``pool``.
    """
    problem, refitted, steps = searched
    best = _likeliest_set(problem, pool, refitted.cost, searched.hypotheses, settings.n_jobs)
    best = _without_refinement(best, pool, refitted.cost)
    best = more_than_drift(problem, refitted, best, pool, steps[0].bank, settings)
    best = _converged_best(problem, best, pool, refitted.cost, settings.n_jobs)
    best = next((converged(problem, fewer, settings.n_jobs) for fewer in without_idle(problem, best)), best)
    best = _with_fewer(problem, best, pool, refitted.cost, settings.n_jobs)
    best = _without_form_menders(problem, best, pool, structure, settings.n_jobs)
    best = with_what_fades(problem, best, pool, settings.n_jobs)
    return with_one_course(problem, best, pool, refitted.cost, settings.alpha, settings.n_jobs)


def _converged_best(
    problem: Problem, best: Candidate, pool: list[Candidate], unexplained: float, n_jobs: int | None
) -> Candidate:
    """Return the best set fitted to the end, or another that is likelier once the best has its whole price.

    On the way to the end of a fit the data may not feel all parameters, which then have no price. What was
    fitted to the end joins the ``pool``.
    """
    for _ in range(EXCHANGES):
        found = converged(problem, best, n_jobs)
        dearer = found.criterion > best.criterion
        if not dearer or all(c is not best for c in pool):
            return found
        pool[:] = [found if c is best else c for c in pool]
        best = likeliest(pool, unexplained)
        if best is found:
            return found
    return converged(problem, best, n_jobs)


def _with_fewer(
    problem: Problem, best: Candidate, pool: list[Candidate], unexplained: float, n_jobs: int | None
) -> Candidate:
    """Return a set of fewer of its members that is as likely, fitted to the end, if there is one.

    A stop that is touched once pays for itself as an accident does: elsewhere it is none.
    """
    fewer = [c for c in pool if c.places and c.places < best.places]
    fewer = [c for c in fewer if c.criterion <= best.criterion + ALIKE]
    return converged(problem, likeliest(fewer, unexplained), n_jobs) if fewer else best


def _without_form_menders(
    problem: Problem, best: Candidate, pool: list[Candidate], structure: Structure, n_jobs: int | None
) -> Candidate:
    """Return a set without a member that pays for itself only because the rest has not another form.

    Two names on one signal make up any law of it: one name in their place goes before them if, in a form of
    its own, it is as likely.
    """
    if len(best.effects) < 2:
        return best
    members = sorted(that_run(without(problem, best, [e]) for e in best.effects), key=lambda c: c.fit.cost)
    for fewer in [*members, *_one_for_two(best, pool)]:
        fewer = converged(problem, fewer, n_jobs)
        if fewer.criterion - taken_by_forms(problem, fewer, structure, n_jobs) < best.criterion:
            return fewer
    return best


def _one_for_two(best: Candidate, pool: list[Candidate]) -> list[Candidate]:
    """Return the likeliest sets of a pool with one effect for two curves of one signal at a place."""
    found = []
    curves = [e for e in best.effects if e.effect.argument != "none" and not e.effect.n_memory]
    for one, other in combinations(curves, 2):
        if along(one, other):
            found += _with_one_for(best, pool, (one, other), partial(along, one))
    return sorted(found, key=lambda c: c.criterion)[:EXCHANGES]


def _with_one_for(
    best: Candidate,
    pool: list[Candidate],
    two: tuple[PlacedEffect, PlacedEffect],
    may_stand: Callable[[PlacedEffect], bool],
) -> list[Candidate]:
    """Return the sets of a pool with one effect, which may stand there, for two of the best."""
    kept = best.places - {effect.place for effect in two}
    return [
        c
        for c in pool
        if len(c.effects) == len(best.effects) - 1
        and kept <= c.places
        and all(may_stand(effect) for effect in c.effects if effect.place not in kept)
    ]


def _at_one_port(one: PlacedEffect, other: PlacedEffect) -> bool:
    return one.port == other.port


def _likeliest_set(
    problem: Problem, pool: list[Candidate], unexplained: float, hypotheses: list[Hypothesis], n_jobs
) -> Candidate:
    """Return the likeliest set, once the members of the leading one were exchanged for what fits as well.

    The sets that come of it join the pool.
    """
    best = likeliest(pool, unexplained)
    swapped: list[set] = []
    for _ in range(EXCHANGES):
        sets = [c for c in pool if len(c.effects) > 1 and c.criterion <= best.criterion + HARDLY]
        others = exchanges(problem, likeliest(sets, unexplained), pool) if sets else []
        if best.places not in swapped:
            swapped.append(best.places)
            others += special_cases(problem, best, hypotheses) + reordered(problem, [best])
            others += as_one_law(problem, best, hypotheses)
            others += swaps(problem, best, [*pool, *others], hypotheses, n_jobs)
            others += untried(problem, best, [*pool, *others], hypotheses, n_jobs)
        if not others:
            break
        pool += others
        best = likeliest(pool, unexplained)
    return best


def _without_refinement(best: Candidate, pool: list[Candidate], unexplained: float) -> Candidate:
    """Return a set with one effect for two look-alikes at a port, if the second only mends a form."""
    next_to_nothing = REFINES * (unexplained - best.fit.cost)
    for one, other in bent_together(best):
        at_port = _with_one_for(best, pool, (one, other), partial(_at_one_port, one))
        fewer = [c for c in at_port if c.fit.cost - best.fit.cost <= next_to_nothing]
        if fewer:
            return likeliest(fewer, unexplained)
    return best


def named_by_reach(
    problem: Problem, best: Candidate, pool: list[Candidate], unexplained: float, n_jobs
) -> Candidate:
    """Return a set under the name that its law has in a motion of this size, where that fits as well.

    Slip elements are the friction of a body where all of them let go within the motion's standard deviation.
    """
    for effect in best.effects:
        at, kept = effect.effect.reach, best.places - {effect.place}
        if at is None or effect.port.kind != "state":
            continue
        x = problem.run(best.fit.model).x[problem.rows[problem.inside]]
        if effect.theta[at] > np.std(x @ effect.weights):
            continue
        rivals = [(c, declared_rival(best, c)) for c in pool if kept <= c.places and not odd(c)]
        named = [converged(problem, c, n_jobs) for c, rival in rivals if rival and is_one_law(best, rival)]
        without = min((c.fit.cost for c in pool if c.places == kept), default=unexplained)
        as_good = [c for c in named if c.fit.cost - best.fit.cost <= FORM * (without - best.fit.cost)]
        if as_good:
            return min(as_good, key=lambda c: c.criterion)
    return best


def bent_together(candidate: Candidate) -> list[tuple[PlacedEffect, PlacedEffect]]:
    """Return the look-alikes that act at one port."""
    return [
        (one, other)
        for one, other in combinations(candidate.effects, 2)
        if one.port == other.port and one.effect.code in other.effect.lookalikes
    ]

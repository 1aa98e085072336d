"""What is said of a search: the set that is named, what it is held against, and the verdict."""

from functools import cache, partial
from itertools import chain
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.search.candidate import FINE, HARDLY, Candidate, converged, odd
from narx_sklearn.discrepancy.search.confirm import DRIFT, Trial, is_of_a_sensor
from narx_sklearn.discrepancy.search.lookalikes import REFINES, declared_rival, likeliest, look_alikes
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.stages.coloured_search import Searched
from narx_sklearn.discrepancy.stages.foretold import are_foretelling
from narx_sklearn.discrepancy.stages.forms import FORM, own_forms
from narx_sklearn.discrepancy.stages.naming import named_by_reach, named_set
from narx_sklearn.discrepancy.stages.powers import with_another_power
from narx_sklearn.discrepancy.stages.refuted import (
    NOTHING_SEEN,
    LeftByForm,
    is_refuted,
    left_by_form,
    left_that_follows,
    left_that_is_no_noise,
    leftover_of,
    may_be_drift,
    needs_wrong_parameters,
    only_stand_in,
    outdoes_drift,
    say_less_than_they_leave,
)
from narx_sklearn.discrepancy.stages.remainder import Sign
from narx_sklearn.discrepancy.stages.unforeseen import Unforeseen
from narx_sklearn.discrepancy.stages.unnamed import SUSPECT, best_unnamed

ROOM = 3.0  # times what a form visibly leaves, that its look-alikes may leave


class Judgement(NamedTuple):
    """What is said of a set of effects, and what it was held against."""

    verdict: str
    best: Candidate
    alternatives: tuple[tuple[Candidate, ...], ...]
    unnamed: Candidate | None
    stand_in: bool = False  # names for a law that is none of them
    against_noise: tuple[Sign, ...] = ()  # what noise would not do, and the names leave
    unforeseen: Unforeseen | None = None  # what follows no signal, in the place of names
    beside: Unforeseen | None = None  # the same where names stand, and it acts beside them
    left: LeftByForm = NOTHING_SEEN  # by names that stand, or do not because of that


def judge(searched: Searched, structure: Structure, settings: Settings) -> Judgement | None:
    """Return what is said of the likeliest set of a search; None where nothing is missing."""
    problem, refitted, pool = searched.problem, searched.refitted, searched.pool
    if not pool or searched.p_value > settings.alpha:
        return None
    settings.tell("rivals and unnamed curves")
    best = named_set(searched, pool, structure, settings)
    named = named_by_reach(problem, best, pool, refitted.cost, settings.n_jobs)
    found = judged(searched, named, pool, structure, settings)
    if found.verdict == "unknown" and named is not best:
        found = judged(searched, best, pool, structure, settings)
    singles = [c for c in pool if len(c.effects) == 1 and c.effects[0].effect.code != DRIFT]
    if found.verdict == "unknown" and len(best.effects) > 1 and singles and not found.stand_in:
        # what goes with it has no name; the effect that explains most may have one (a drift goes anywhere)
        single = converged(problem, likeliest(singles, refitted.cost), settings.n_jobs)
        alone = judged(searched, single, pool, structure, settings)
        return alone if alone.verdict != "unknown" else found
    return found


def judged(
    searched: Searched, best: Candidate, pool: list[Candidate], structure: Structure, settings: Settings
) -> Judgement:
    """Hold a set of effects against what it leaves, its rivals and the best curve without a name."""
    problem, refitted, _ = searched
    leftover = leftover_of(problem, best, structure, settings)
    # where the named form visibly leaves something, its look-alikes may leave as much, and some more
    visible = max(leftover.gain, 0.0) if leftover.p_value <= SUSPECT else 0.0
    tolerated = min(FORM * (refitted.cost - best.fit.cost), ROOM * visible)
    starts = {h.placed.always().place: h.starts for h in searched.hypotheses}
    alternatives = _alternatives(problem, best, pool, tolerated, starts, refitted.cost)
    unnamed = best_unnamed(problem, refitted, best, structure, settings, searched.hypotheses)
    named = "ambiguous" if any(alternatives) else "explained"
    if may_be_drift(problem.noise, best, alternatives):  # its course is as it may be, and that is all of it
        bank, nothing = searched.steps[0].bank.without_columns(), Candidate(refitted, problem.n_seen)
        trial = Trial(problem, nothing, bank, settings.n_jobs, settings.random_state)
        if outdoes_drift(trial, best, unnamed, settings.alpha_nameless):
            assert unnamed is not None
            return _told_instead(unnamed)
        signs = left_that_follows(problem, best, structure, settings)
        return Judgement("unknown" if signs else named, best, alternatives, unnamed, against_noise=signs)
    if needs_wrong_parameters(problem, refitted, best, unnamed, structure, settings):
        assert unnamed is not None
        return _told_instead(unnamed)
    if (other := with_another_power(problem, best, settings.alpha)) is not None:
        as_likely = [
            c for c in _without_its_power(best, other, alternatives) if c.criterion <= other.criterion
        ]
        if as_likely:  # another name does what this power does
            rival = converged(problem, likeliest(as_likely, refitted.cost), settings.n_jobs)
            return judged(searched, rival, pool, structure, settings)
        nearest = min((c for c in (unnamed, other) if c is not None), key=lambda c: c.criterion)
        return Judgement("unknown", best, alternatives, nearest, stand_in=True)
    forms = cache(partial(own_forms, problem, best, structure, settings.n_jobs))  # asked for once, if at all
    signs = left_that_is_no_noise(problem, refitted, best, structure, settings, forms)
    took_less = any(sign.gain > refitted.cost - best.fit.cost for sign in signs)
    if took_less and not are_foretelling(problem, refitted.model, best.fit.model):
        # the names took off less than they leave, and foretell nothing: they are not even near to it
        nothing = Candidate(refitted, problem.n_seen)
        return Judgement("unknown", nothing, (), unnamed, stand_in=True, against_noise=signs)
    if signs or only_stand_in(problem, refitted, best, unnamed, leftover, structure, settings, forms):
        return Judgement("unknown", best, alternatives, unnamed, stand_in=True, against_noise=signs)
    if say_less_than_they_leave([best, *chain.from_iterable(alternatives)], unnamed, pool):
        return Judgement("unknown", best, alternatives, unnamed)
    left = left_by_form(refitted, best, unnamed, leftover)
    if is_refuted(refitted, best, unnamed, leftover, settings.alpha):
        at_home = _judged_at_home(searched, best, alternatives, pool, structure, settings)
        too_much = left if left.doubt >= 1.0 else NOTHING_SEEN
        return at_home or Judgement("unknown", best, alternatives, unnamed, left=too_much)
    return Judgement(named, best, alternatives, unnamed, left=left)


def _told_instead(law: Candidate) -> Judgement:
    """Return what is said where names stand in for a law that has none."""
    return Judgement("unknown", law, ((),) * len(law.effects), law, stand_in=True)


def _judged_at_home(
    searched: Searched,
    best: Candidate,
    alternatives: tuple[tuple[Candidate, ...], ...],
    pool: list[Candidate],
    structure: Structure,
    settings: Settings,
) -> Judgement | None:
    """Return what is said of a name at home in the place of a refuted one from elsewhere, if one stands.

    The likeliest is asked first. What was refuted is no rival any more.
    """
    rest = [c for c in pool if c.places != best.places]
    rivals = at_home_instead(best, alternatives, rest)
    while rivals:
        likely = likeliest(rivals, searched.refitted.cost)
        rival = converged(searched.problem, likely, settings.n_jobs)
        found = judged(searched, rival, rest, structure, settings)
        if found.verdict != "unknown":
            return found
        rivals = [c for c in rivals if c is not likely]
    return None


def at_home_instead(
    best: Candidate, alternatives: tuple[tuple[Candidate, ...], ...], pool: list[Candidate]
) -> list[Candidate]:
    """Return what could stand in the place of names from elsewhere without being clearly worse, at home.

    Those are the alternatives, and the same name where one meets it if it is hardly less likely there. That a
    sensor is off or drifts is none: such goes anywhere, and was held against noise that does.
    """
    if not odd(best):
        return []
    hardly = [
        c for c in pool if len(c.effects) == len(best.effects) and c.criterion <= best.criterion + HARDLY
    ]
    rivals = {id(c): c for c in (*chain.from_iterable(alternatives), *hardly)}.values()
    return [c for c in rivals if not odd(c) and not any(is_of_a_sensor(e) for e in c.effects)]


def _without_its_power(
    best: Candidate, other: Candidate, alternatives: tuple[tuple[Candidate, ...], ...]
) -> list[Candidate]:
    """Return what could stand in the place of a law that another power refutes, and is no power itself."""
    return [
        candidate
        for member, freed, rivals in zip(best.effects, other.effects, alternatives, strict=True)
        if freed.effect is not member.effect
        for candidate in rivals
        if all(effect.effect.power is None or effect.place in best.places for effect in candidate.effects)
        and member.place not in candidate.places
    ]


def _alternatives(
    problem: Problem,
    best: Candidate,
    pool: list[Candidate],
    tolerated: float,
    starts: dict[tuple, np.ndarray],
    unexplained: float,
) -> tuple[tuple[Candidate, ...], ...]:
    """Return, for each effect of the set, what could stand in its place without being clearly worse."""
    singles = [c.effects[0] for c in pool if len(c.effects) == 1]
    found = []
    for i, effect in enumerate(best.effects):
        others = [e for j, e in enumerate(best.effects) if j != i]
        kept = {e.place for e in others}
        rivals = [
            c
            for c in pool
            if len(c.effects) == len(best.effects) and kept <= c.places and effect.place not in c.places
        ]
        if others and not rivals:
            start = best.fit.model
            for single in [s for s in singles if s.place not in {effect.place, *kept}][:3]:
                model = start._replace(effects=(*others, single))
                rivals.append(Candidate(fit(problem, model, iterations=FINE), best.n_samples))
        # the same effect at another place is a question of where, not of what
        rivals = [c for c in rivals if effect.name.code not in _replaced(c, kept)]
        # what the catalogue warns of, or leaves hardly more, is fitted to the end before it is judged
        near = best.fit.cost + REFINES * (unexplained - best.fit.cost)
        rivals = [
            converged(problem, c) if declared_rival(best, c) or c.fit.cost <= near else c for c in rivals
        ]
        rivals.sort(key=lambda c: c.criterion)
        found.append(
            tuple(look_alikes(problem, best, rivals, tolerated, starts, unexplained=unexplained)[1:])
        )
    return tuple(found)


def _replaced(candidate: Candidate, kept: set) -> set[str]:
    """Return the names of the effects that are not among those kept."""
    return {e.name.code for e in candidate.effects if e.place not in kept}

"""Other effects in the places of a set's members: what stood there first need not be what fits best."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np
from joblib import Parallel, delayed

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit, fit_states
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.bank import directions, effect_column, entered, make_bank, moved_for, off
from narx_sklearn.discrepancy.search.candidate import FINE, HARDLY, Candidate
from narx_sklearn.discrepancy.search.explain import in_reach, refit_leaders
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.ranking import gains, scaled

SWAPS = 6  # effects that are tried in the place of a member because they would change the run alike
LEFT = 0.1  # share of what a member changes that another may leave, for it to be tried


def exchanges(problem: Problem, best: Candidate, pool: list[Candidate]) -> list[Candidate]:
    """Return a set refitted with other effects of a pool in the places of its members.

    The set was built on whichever stood first alone: the more general of two, one of several that fitted
    equally well, or what went best with something that is no member any more. Special cases of a member are
    tried, what the catalogue calls its look-alikes, and what alone was hardly worse.
    """
    alone = {c.effects[0].place: c.criterion for c in reversed(pool) if len(c.effects) == 1}
    others = {effect.place: effect for c in reversed(pool) for effect in c.effects}
    known = {frozenset(c.places) for c in (best, *pool)}
    found = []
    for i, member in enumerate(best.effects):
        kept = (*best.effects[:i], *best.effects[i + 1 :])
        for place, other in others.items():
            related = other.effect.code in (*member.effect.holds, *member.effect.lookalikes)
            as_good = abs(alone.get(place, np.inf) - alone.get(member.place, -np.inf)) <= HARDLY
            places = frozenset({place, *(effect.place for effect in kept)})
            is_new = len(places) > len(kept) and places not in known
            if other.port == member.port and (related or as_good) and is_new:
                known.add(places)
                found.append(_swapped(problem, best, i, other))
    return found


def special_cases(problem: Problem, best: Candidate, hypotheses: Sequence[Hypothesis]) -> list[Candidate]:
    """Return a set refitted with what a member becomes at an edge of its parameters, from where that lies.

    Friction that holds and lets go makes a cost full of steps, on one of which the simpler law may have been
    left standing; where its parameters are those of the more general by name, they are as good a beginning.
    One that the more general has none of, as it is fixed there, begins as ever. Where another member is that
    law already, the two become one.
    """
    asked = {h.placed.effect.code: h.placed.effect for h in hypotheses if h.asked}
    ordinary = {h.placed.place: h.starts[0] for h in hypotheses if len(h.starts)}
    found = []
    for member in best.effects:
        general, n = member.effect, len(member.effect.parameters)
        given = _values_by_name(member)
        for special in (asked[code] for code in general.holds if code in asked):
            names = [(p.name, p.unit) for p in special.parameters]
            begun = ordinary.get(replace(member, effect=special).always().place, ())
            known = {**dict(zip(names, begun, strict=False)), **given}
            is_alike = special.argument == general.argument and names[0] in given
            if not is_alike or not known.keys() >= set(names):
                continue
            theta = (*(float(known[name]) for name in names), *member.theta[n:])
            simpler = replace(member, effect=special, theta=theta)
            one = _as_one([simpler, *(e for e in best.effects if e.place == simpler.place)])
            changed = [one if e is member else e for e in best.effects]
            effects = tuple(e for e in changed if e is one or e.place != one.place)
            model = best.fit.model._replace(effects=effects)
            found.append(Candidate(fit(problem, model, iterations=FINE), best.n_samples))
    return found


def as_one_law(problem: Problem, best: Candidate, hypotheses: Sequence[Hypothesis]) -> list[Candidate]:
    """Return a set refitted with one effect for two of its members that act at one port.

    It holds the one as a special case, from whose parameters it begins, and looks like the other: a load
    beside what is the same both ways is as well what is not.
    """
    found = []
    for one, other in permutations(best.effects, 2):
        if one.port != other.port or one.during != other.during:
            continue
        given = _values_by_name(one)
        kept = tuple(effect for effect in best.effects if effect is not one and effect is not other)
        for h in hypotheses:
            general = h.placed.effect
            stands_for = one.effect.code in general.holds and other.effect.code in general.lookalikes
            in_its_place = replace(one, effect=general)
            if not (stands_for and h.asked and h.placed.place == in_its_place.place):
                continue
            names = [(p.name, p.unit) for p in general.parameters]
            rest = one.theta[len(one.effect.parameters) :]
            begun = {
                (*(given.get(name, float(value)) for name, value in zip(names, start, strict=False)), *rest)
                for start in h.starts
            }
            models = [
                best.fit.model._replace(effects=(*kept, in_its_place.at(theta))) for theta in sorted(begun)
            ]
            fits = [fit(problem, model, iterations=FINE) for model in models]
            found.append(Candidate(min(fits, key=lambda f: f.cost), best.n_samples))
    return found


def _values_by_name(placed: PlacedEffect) -> dict[tuple[str, str], float]:
    """Return the values of an effect's parameters by their names and units."""
    own = zip(placed.effect.parameters, placed.theta, strict=False)
    return {(p.name, p.unit): value for p, value in own}


def _as_one(alike: Sequence[PlacedEffect]) -> PlacedEffect:
    """Return one effect for several of one place: the first, as large as all together."""
    first = alike[0]
    if first.amplitude is None:
        return first
    theta = list(first.theta)
    theta[first.amplitude] = sum(effect.theta[first.amplitude] for effect in alike)
    return first.at(theta)


def swaps(
    problem: Problem,
    best: Candidate,
    pool: Sequence[Candidate],
    hypotheses: Sequence[Hypothesis],
    n_jobs: int | None = None,
) -> list[Candidate]:
    """Return a set refitted with what would change its run as a member does, in that member's place.

    Where an effect moves the run far, what is seen from the run without it tells little of its shape, and a
    fit from there may end in another valley. About the fitted set the run is right: an effect that is as
    good a name must change it there as the member does, wherever it acts, at some strength and from one of
    its starts. Those that the pool already knows to fit as well as that promises are left out.
    """
    known: dict[frozenset, float] = {}
    for candidate in sorted(pool, key=lambda c: -c.fit.cost):
        known[frozenset(candidate.places)] = candidate.fit.cost
    tried = []
    for i, own in enumerate(best.fit.model.theirs):
        member, kept = best.effects[i], (*best.effects[:i], *best.effects[i + 1 :])
        rivals = [h for h in hypotheses if _may_replace(h, best, kept)]
        for left, rival in _one_a_name(_alike(problem, best, member, own, rivals, n_jobs))[:SWAPS]:
            before = known.get(frozenset({rival.place, *(effect.place for effect in kept)}), np.inf)
            if before > best.fit.cost + left:
                tried.append((i, rival))
    return Parallel(n_jobs=n_jobs, prefer="threads")(
        delayed(_swapped)(problem, best, i, rival) for i, rival in tried
    )


def untried(
    problem: Problem,
    best: Candidate,
    pool: Sequence[Candidate],
    hypotheses: Sequence[Hypothesis],
    n_jobs: int | None = None,
) -> list[Candidate]:
    """Return a set refitted with look-alikes of its members in their places that no set of the pool has.

    What leads is told about the simulator without effects, whose parameters may have gone far to make up for
    what is missing: there the friction of a stem that follows a pressure does next to nothing. Those that the
    catalogue calls a member's look-alikes begin from the set's own, and so does the member itself elsewhere;
    and where they come near, what holds them as a special case.
    """
    known = {frozenset(c.places) for c in (best, *pool)}
    found = []
    for i, member in enumerate(best.effects):
        kept = (*best.effects[:i], *best.effects[i + 1 :])
        there = {effect.place for effect in kept}
        others = [
            h
            for h in hypotheses
            if _may_replace(h, best, kept) and frozenset({h.placed.place, *there}) not in known
        ]
        beside, names = None, {member.effect.code, *member.effect.lookalikes}
        for _ in range(2):
            rivals = [h for h in others if h.placed.effect.code in names]
            if not rivals:
                break
            beside = beside or fit_states(problem, best.fit.model._replace(effects=kept))
            placed = _promising(problem, beside, rivals, n_jobs)
            fitted = refit_leaders(problem, beside, placed, n_jobs, finished=2, twins=0, ahead_of_all=best)
            found += fitted
            near = {c.effects[-1].effect.code for c in fitted if in_reach(c, best, beside)}
            names = {h.placed.effect.code for h in others if near & set(h.placed.effect.holds)} - names
    return found


def _promising(
    problem: Problem, beside: Fit, rivals: Sequence[Hypothesis], n_jobs: int | None
) -> list[PlacedEffect]:
    """Return the few that leave least where they enter, each from its best start."""
    run = problem.run(beside.model)

    def begun(rival: Hypothesis) -> tuple[float, PlacedEffect]:
        started = [rival.placed.at(start) for start in rival.starts]
        left = [entered(problem, beside, run, placed).left for placed in started]
        return min(left), started[int(np.argmin(left))]

    found = Parallel(n_jobs=n_jobs, prefer="threads")(delayed(begun)(rival) for rival in rivals)
    return [placed for _, placed in sorted(found, key=lambda pair: pair[0])[:SWAPS]]


def _one_a_name(alike: list[tuple[float, PlacedEffect]]) -> list[tuple[float, PlacedEffect]]:
    """Return of each effect the place where it leaves least."""
    first: dict[str, tuple[float, PlacedEffect]] = {}
    for left, rival in alike:
        first.setdefault(rival.effect.code, (left, rival))
    return list(first.values())


def _swapped(problem: Problem, best: Candidate, i: int, rival: PlacedEffect) -> Candidate:
    """Return a fitted set refitted with a rival for one of its members, the better of two fits.

    One begins with all else as it was, one with all else moved as the tangents say: a rival that changes the
    run as the member does, but for what the simulator's own parameters can do, leaves that to them, and they
    may have far to go.
    """
    model, kept = best.fit.model, (*best.effects[:i], *best.effects[i + 1 :])
    run = problem.run(model)
    lost, won = (effect_column(problem, best.fit, run, effect) for effect in (best.effects[i], rival))
    others = np.delete(np.arange(model.q.size), np.r_[model.theirs[i]])
    moved = moved_for(problem, best.fit, lost - won, others)
    moved = moved._replace(effects=(*moved.effects[:i], *moved.effects[i + 1 :], rival))
    fits = [fit(problem, m, iterations=FINE) for m in (model._replace(effects=(*kept, rival)), moved)]
    return Candidate(min(fits, key=lambda found: found.cost), best.n_samples)


def _may_replace(hypothesis: Hypothesis, best: Candidate, kept: tuple[PlacedEffect, ...]) -> bool:
    placed = hypothesis.placed
    is_new = placed.place not in best.places
    return is_new and hypothesis.asked and not (placed.odd and kept)


def _alike(
    problem: Problem,
    best: Candidate,
    member: PlacedEffect,
    own: slice,
    rivals: list[Hypothesis],
    n_jobs: int | None,
) -> list[tuple[float, PlacedEffect]]:
    """Return the rivals that change the run nearly as a member does, with what they leave of its change."""
    column = effect_column(problem, best.fit, problem.run(best.fit.model), member)
    others = np.delete(best.fit.jacobian, np.r_[own], axis=2)
    change = off(directions(others), best.fit.projector(column))
    bank = make_bank(problem, best.fit._replace(jacobian=others, residual=change), rivals, n_jobs)
    gain, strength = gains(bank)
    size = float(np.sum(change**2))
    found = {}
    for j in np.argsort(gain, kind="stable"):
        if size - gain[j] <= LEFT * size:
            found[bank.owner[j]] = size - gain[j], scaled(bank, j, strength[j])
    return sorted(found.values(), key=lambda pair: pair[0])

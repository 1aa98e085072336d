"""What the members of a set of effects are worth in it: the set without them, or in another order."""

from collections.abc import Iterable, Sequence
from itertools import combinations

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.candidate import FINE, Candidate, once_each
from narx_sklearn.discrepancy.search.inference import covariance
from narx_sklearn.discrepancy.search.restricted import STEPPED

IN_ORDER = 3  # sets of two effects on one signal that are tried in the other order
ADDED = 0.25  # share of what it takes off beside a converter, that a member adds at least
MAY_BE_NOTHING = 1.64  # standard errors, within which an effect's size may as well be zero


def without_each(problem: Problem, candidate: Candidate) -> list[Candidate]:
    """Return the set fitted without each of its members but the last; of those with which it runs."""
    return that_run(without(problem, candidate, [effect]) for effect in candidate.effects[:-1])


def that_run(candidates: Iterable[Candidate]) -> list[Candidate]:
    """Return those that leave something finite: without what a set held on to a machine may run away."""
    return [c for c in candidates if np.isfinite(c.fit.cost)]


def reordered(problem: Problem, pool: Sequence[Candidate]) -> list[Candidate]:
    """Return the best sets with two members on one signal, those two in the other order.

    A gain that drifts before a limit is another machine than one behind it, and what was found first came
    first.
    """
    found = []
    for candidate in once_each([c for c in pool if any(_on_one_signal(c))])[:IN_ORDER]:
        for i, j in _on_one_signal(candidate):
            effects = list(candidate.effects)
            effects[i], effects[j] = effects[j], effects[i]
            model = candidate.fit.model._replace(effects=tuple(effects))
            found.append(Candidate(fit(problem, model, iterations=FINE), candidate.n_samples))
    return that_run(found)


def _on_one_signal(candidate: Candidate) -> list[tuple[int, int]]:
    """Return which two members act on one input or output."""
    ports = [effect.port for effect in candidate.effects]
    return [
        (i, j)
        for i, j in combinations(range(len(ports)), 2)
        if ports[i] == ports[j] and ports[i].kind != "state"
    ]


def without_idle(problem: Problem, candidate: Candidate) -> list[Candidate]:
    """Return the set fitted without the members that do nothing in it; none where all do something.

    What a fit reached with their help the others may not have found alone. Where a force of no size does as
    well as one of its own, it is the shorter steps in which it turns about that help, so it does nothing.
    """
    idle = [effect for i, effect in enumerate(candidate.effects) if _is_idle(problem, candidate, i)]
    return that_run([without(problem, candidate, idle)]) if 0 < len(idle) < len(candidate.effects) else []


def _is_idle(problem: Problem, candidate: Candidate, index: int) -> bool:
    lacking = without(problem, candidate, [candidate.effects[index]], iterations=0)
    return (
        lacking.criterion <= candidate.criterion
        or _moves_steps_alone(problem, candidate, index, lacking.fit.cost)
        or _is_as_good_at_no_size(problem, candidate, index)
    )


def _moves_steps_alone(problem: Problem, candidate: Candidate, index: int, without_it: float) -> bool:
    """Tell whether a member beside a converter takes off what it does not add to what is converted.

    The least change moves samples near an edge by whole steps, and among many changes one fits by chance.
    What a smooth member takes off a fit, all else as it is, are the squares of what it adds.
    """
    effects = candidate.effects
    smooth = tuple(e for e in effects if e.effect.code not in STEPPED)
    if len(smooth) == len(effects) or effects[index] not in smooth:
        return False
    others = tuple(e for e in smooth if e is not effects[index])
    there, gone = (problem.run(candidate.fit.model._replace(effects=e)).y for e in (smooth, others))
    added = float(np.sum(problem.whiten(there - gone) ** 2))
    return added < ADDED * (without_it - candidate.fit.cost)


def _is_as_good_at_no_size(problem: Problem, candidate: Candidate, index: int) -> bool:
    """Tell whether a member whose size may as well be zero, by its error, does next to nothing."""
    model, effect = candidate.fit.model, candidate.effects[index]
    if effect.amplitude is None:
        return False
    at = model.theirs[index].start + effect.amplitude
    q = model.q
    if abs(q[at]) > MAY_BE_NOTHING * np.sqrt(covariance(problem, candidate.fit)[at, at]):
        return False
    q[at] = 0.0
    free = np.ones(q.size, dtype=bool)
    free[model.theirs[index]] = False
    nothing = fit(problem, model.with_q(q), free=free, iterations=FINE)
    more = np.log(max(nothing.cost, 1e-300) / max(candidate.fit.cost, 1e-300))
    return bool(candidate.n_samples * more <= np.log(candidate.n_samples))


def by_weight(problem: Problem, candidate: Candidate, pool: Sequence[Candidate] = ()) -> tuple[int, ...]:
    """Return the members of a set in order of what would be left unexplained without each, most first.

    Two of one name (a rim on either tank) stand in for each other, so they are left out together first.
    What the others leave is the least of what a refit and the ``pool`` of candidates know. The set keeps the
    order in which its members act: a limit before a gain is not one behind it.
    """
    effects = candidate.effects
    if len(effects) < 2:
        return tuple(range(len(effects)))

    def cost(left_out: list[PlacedEffect]) -> float:
        places = candidate.places - {effect.place for effect in left_out}
        known = [c.fit.cost for c in pool if c.places == places]
        return min([without(problem, candidate, left_out).fit.cost, *known])

    namesakes: dict[str, list[PlacedEffect]] = {}
    for effect in effects:
        namesakes.setdefault(effect.effect.code, []).append(effect)
    together = {code: cost(members) for code, members in namesakes.items()}

    def left(i: int) -> tuple[float, float]:
        code = effects[i].effect.code
        return together[code], cost([effects[i]]) if len(namesakes[code]) > 1 else 0.0

    return tuple(sorted(range(len(effects)), key=left, reverse=True))


def without(
    problem: Problem, candidate: Candidate, left_out: list[PlacedEffect], *, iterations: int = FINE
) -> Candidate:
    """Return a set fitted again without some of its members."""
    places = {effect.place for effect in left_out}
    effects = tuple(e for e in candidate.effects if e.place not in places)
    reduced = fit(problem, candidate.fit.model._replace(effects=effects), iterations=iterations)
    return Candidate(reduced, candidate.n_samples)

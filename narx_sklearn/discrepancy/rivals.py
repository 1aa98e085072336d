"""Explanations that a record leaves open, as simulators that an experiment is to separate."""

from collections.abc import Iterable, Sequence
from itertools import chain, permutations

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.nested import ALLOWED, as_large_as_allowed, farthest_allowed
from narx_sklearn.discrepancy.placed import in_short
from narx_sklearn.discrepancy.search.bank import make_bank
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.detect import NONE_SILENT
from narx_sklearn.discrepancy.search.explain import refit_leaders
from narx_sklearn.discrepancy.search.hypotheses import enumerate_hypotheses
from narx_sklearn.discrepancy.search.lookalikes import is_special_case
from narx_sklearn.discrepancy.search.ranking import leaders, scaled, with_nearest
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.discrepancy.stages.coloured_search import pool_of
from narx_sklearn.discrepancy.stages.diagnosis import Diagnosis
from narx_sklearn.physics.effects import CATALOGUE, Effect

MOST_RIVALS = 4  # explanations that one experiment is asked to separate, where nobody says which
MOST_PORTS = 6  # at which an effect is fitted that nobody looked for before


def find_rivals(
    diagnosis: Diagnosis, between=None, *, own: Sequence[Effect] = (), n_jobs: int | None = None
) -> dict[str, Candidate]:
    """Return explanations to separate, by name.

    Parameters
    ----------
    between : list of (str or Effect), optional
        Their effects, by code; by default the best explanation with its look-alikes, or, where it has none,
        the best that were tried.
    own : sequence of Effect
        Effects that are known beside those of the catalogue.

    Raises
    ------
    TypeError
        If ``between`` is no list.
    ValueError
        If an effect is not known or does not show in these data, or only one explanation is at hand.
    """
    if between is not None:
        return _explanations_by(read_between(between, own), diagnosis, own, n_jobs)
    pool = _once_a_name([diagnosis.best, *chain.from_iterable(diagnosis.alternatives)])
    wanted = min(max(len(pool), 2), MOST_RIVALS)
    pool += pool_of(diagnosis.steps)
    chosen: dict[str, Candidate] = {}
    for candidate in pool:
        chosen.setdefault(in_short(candidate.effects) or "nothing", candidate)
        if len(chosen) == wanted:
            break
    if len(chosen) < 2:
        raise ValueError(
            "There is only one explanation, so no experiment is needed to separate it from others. To see "
            "how two effects of the catalogue would be told apart, pass between=[...] with their codes."
        )
    return chosen


def read_between(between, own: Sequence[Effect] = ()) -> list[Effect]:
    """Return the effects that an experiment is asked to separate, each once."""
    if isinstance(between, str | Effect) or not isinstance(between, Iterable):
        raise TypeError(f"between is {between!r}; wanted is a list of the codes of at least two effects.")
    known = CATALOGUE | {effect.code: effect for effect in own}
    asked: dict[str, Effect] = {}
    for entry in between:
        effect = entry if isinstance(entry, Effect) else known.get(entry)
        if effect is None:
            raise ValueError(f"between holds {entry!r}, which is no effect that is known: {sorted(known)}.")
        asked[effect.code] = effect
    if len(asked) < 2:
        raise ValueError(f"between names {list(asked)}; wanted are the codes of at least two effects.")
    return list(asked.values())


def _explanations_by(
    asked: list[Effect], diagnosis: Diagnosis, own: Sequence[Effect], n_jobs: int | None
) -> dict[str, Candidate]:
    """Return the best explanation by each effect without the others, beside what else has a name.

    What was not fitted so is fitted.
    """
    codes = {effect.code for effect in asked}
    named = {*CATALOGUE, *(effect.code for effect in own)} - codes
    rest = {placed.place for placed in diagnosis.best.effects if placed.effect.code in named}
    base = _beside(diagnosis, rest, n_jobs)
    fitted = [diagnosis.best, *chain.from_iterable(diagnosis.alternatives), *pool_of(diagnosis.steps)]
    chosen = {}
    for effect in asked:
        having = [
            candidate
            for candidate in fitted
            if rest <= candidate.places
            and codes & {placed.effect.code for placed in candidate.effects} == {effect.code}
        ]
        best = _shown(effect, diagnosis, base, min(having, key=lambda c: c.criterion, default=None), n_jobs)
        chosen[in_short(best.effects)] = best
    return chosen


def _beside(diagnosis: Diagnosis, places: set[tuple], n_jobs: int | None) -> Fit:
    """Return the fit of those effects of the best explanation that are at some places."""
    model = diagnosis.best.fit.model
    if not places:
        return diagnosis.refitted
    if places == diagnosis.best.places:
        return diagnosis.best.fit
    effects = tuple(placed for placed in model.effects if placed.place in places)
    return fit(diagnosis.problem, model._replace(effects=effects), n_jobs=n_jobs)


def _shown(
    effect: Effect, diagnosis: Diagnosis, base: Fit, found: Candidate | None, n_jobs: int | None
) -> Candidate:
    """Return an effect as it was found, or else fitted beside a base at the port where it explains most.

    What the data do not show, whose fit leaves as much as the base alone, is as large as they allow.
    """
    problem = diagnosis.problem
    if found is not None and found.fit.cost < base.cost - ALLOWED**2:
        return found
    run = problem.run(base.model)
    hypotheses = enumerate_hypotheses([effect], problem, run, diagnosis.structure, n_jobs=n_jobs)
    taken = {placed.place for placed in base.model.effects}
    bank = make_bank(problem, base, [h for h in hypotheses if h.placed.place not in taken], n_jobs)
    if not bank.useful.any():
        raise ValueError(
            f"between holds {effect.code!r}, which does not show in these data at any port of the simulator: "
            "it changes nothing that the simulator's own parameters and initial states do not."
        )
    length = np.where(bank.useful, np.sqrt(np.diag(bank.gram)), 0.0)
    most = np.argsort(-length, kind="stable")[: np.count_nonzero(length)]
    if found is None:
        placed = leaders(bank, MOST_PORTS, NONE_SILENT, 1.0)
        placed = with_nearest(problem, base, bank, placed, n_jobs)
        if not placed:  # it would act against its physical sense: where it would show most, it hardly does
            placed = [scaled(bank, most[0], 1 / length[most[0]])]
        fitted = refit_leaders(problem, base, placed, n_jobs, finished=1, twins=0)
        if not fitted:
            raise ValueError(
                f"between holds {effect.code!r}, with which no run of the simulator stays in range."
            )
        found = fitted[0]
    ordinary = [p for p in map(bank.placed, most) if p.place in found.places]
    if found.fit.cost < base.cost - ALLOWED**2 or not ordinary:
        return found
    return as_large_as_allowed(problem, base, found, ordinary[0])


def _once_a_name(candidates: list[Candidate]) -> list[Candidate]:
    """Return the first candidate of each set of names, or all of them where they are all of one.

    Where the same acts is another question than what it is.
    """
    first: dict[frozenset[str], Candidate] = {}
    for candidate in candidates:
        first.setdefault(frozenset(effect.effect.code for effect in candidate.effects), candidate)
    return list(first.values()) if len(first) > 1 else candidates


def nested_pairs(rivals: dict[str, Candidate]) -> set[tuple[str, str]]:
    """Return which rival holds which other as a special case."""
    return {
        (general, special)
        for general, special in permutations(rivals, 2)
        if is_special_case(rivals[special], rivals[general])
        or (rivals[general].effects and not rivals[special].effects)
    }


def as_simulators(
    rivals: dict[str, Candidate], nested: set[tuple[str, str]], problem: Problem
) -> dict[str, Simulator]:
    """Return rivals as simulators, each as far from its likeliest special case as the data allow.

    What acted for a while acts always.
    """
    found = {}
    for name, candidate in rivals.items():
        model = candidate.fit.model
        held = [rivals[special] for general, special in nested if general == name]
        if held:
            model = farthest_allowed(problem, candidate, min(held, key=lambda c: c.criterion))
        effects = [effect.always() for effect in model.effects]
        found[name] = problem.simulator.with_parameters(model.p).with_effects(effects)
    return found

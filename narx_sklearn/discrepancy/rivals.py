"""Explanations that a record leaves open, as simulators that an experiment is to separate."""

from itertools import permutations

from narx_sklearn.discrepancy.candidate import Candidate
from narx_sklearn.discrepancy.diagnosis import Diagnosis
from narx_sklearn.discrepancy.lookalikes import is_special_case
from narx_sklearn.discrepancy.nested import farthest_allowed
from narx_sklearn.discrepancy.placed import in_short
from narx_sklearn.discrepancy.problem import Problem
from narx_sklearn.discrepancy.simulator import Simulator

MOST_RIVALS = 4  # explanations that one experiment is asked to separate


def find_rivals(diagnosis: Diagnosis, between: list[str] | None = None) -> dict[str, Candidate]:
    """Return explanations to separate, by name.

    Parameters
    ----------
    between : list of str, optional
        Codes of their effects; by default the best explanation with its look-alikes, or, where it has none,
        the best that were tried.

    Raises
    ------
    ValueError
        If a code was not among those fitted, or only one explanation is at hand.
    """
    tried = [candidate for step in diagnosis.steps for candidate in step.candidates]
    if between is None:
        pool = _once_a_name([diagnosis.best, *(c for rivals in diagnosis.alternatives for c in rivals)])
        wanted = min(max(len(pool), 2), MOST_RIVALS)
        pool += sorted(tried, key=lambda c: c.criterion)
    else:
        pool, wanted = [_best_with(code, tried) for code in between], MOST_RIVALS
    chosen: dict[str, Candidate] = {}
    for candidate in pool:
        chosen.setdefault(in_short(candidate.effects) or "nothing", candidate)
        if len(chosen) == wanted:
            break
    if len(chosen) < 2:
        raise ValueError(
            "There is only one explanation, so no experiment is needed to separate it from others. Pass "
            "between=[...] with two codes, or see confusability() for a design before any data."
        )
    return chosen


def _once_a_name(candidates: list[Candidate]) -> list[Candidate]:
    """Return the first candidate of each set of names, or all of them where they are all of one.

    Where the same acts is another question than what it is.
    """
    first: dict[frozenset[str], Candidate] = {}
    for candidate in candidates:
        first.setdefault(frozenset(effect.effect.code for effect in candidate.effects), candidate)
    return list(first.values()) if len(first) > 1 else candidates


def _best_with(code: str, tried: list[Candidate]) -> Candidate:
    having = [candidate for candidate in tried if code in {e.effect.code for e in candidate.effects}]
    if not having:
        raise ValueError(
            f"{code!r} was not among the explanations fitted: "
            f"{sorted({e.effect.code for candidate in tried for e in candidate.effects})}."
        )
    return min(having, key=lambda c: c.criterion)


def nested_pairs(rivals: dict[str, Candidate]) -> set[tuple[str, str]]:
    """Return which rival holds which other as a special case."""
    return {
        (general, special)
        for general, special in permutations(rivals, 2)
        if is_special_case(rivals[special], rivals[general])
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

"""A law without a name that is told: what it leaves, and what goes with it."""

from collections.abc import Iterable
from typing import NamedTuple

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit
from narx_sklearn.discrepancy.search.bank import make_bank
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.confirm import DRIFTS, chance_of_noise, deviance, n_shapes
from narx_sklearn.discrepancy.search.detect import NONE_SILENT
from narx_sklearn.discrepancy.search.explain import refit_leaders
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.ranking import leaders
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.stages.coloured_search import hypotheses_of
from narx_sklearn.discrepancy.stages.refuted import is_likelier
from narx_sklearn.discrepancy.stages.remainder import Sign, look_at_remainder
from narx_sklearn.discrepancy.stages.unnamed import SUSPECT, UNEXPLAINED, best_unnamed

MOSTLY = 0.5  # of what is missing: a law that leaves more is not what is missing


class LeftByLaw(NamedTuple):
    """What a law without a name leaves of what is missing."""

    share: float  # that the strongest sign holds, of what it and the law do; 1 where the law may be noise
    signs: tuple[Sign, ...]  # that speak against noise

    @property
    def is_little(self) -> bool:
        """Whether the law explains what is missing.

        A broken line has corners that a smooth law has not: what it leaves may be no noise, if it is little.
        """
        return self.share <= UNEXPLAINED


def left_by_law(
    problem: Problem,
    base: Candidate,
    law: Candidate,
    structure: Structure,
    settings: Settings,
    n_tried: int = 1,
    level: float = SUSPECT,
) -> LeftByLaw:
    """Return what a law leaves, if it takes off more than noise of any colour would let the best of some."""
    gained = deviance(problem, base.fit.model) - deviance(problem, law.fit.model)
    if chance_of_noise(gained, n_tried, n_shapes(law.effects[0], problem)) > level:
        return LeftByLaw(1.0, ())
    rest = look_at_remainder(problem, law.fit.model, structure, settings.random_state)
    signs = rest.speaking(settings.alpha_nameless)
    taken_off = base.fit.cost - law.fit.cost
    of_some_unknown = [sign.gain / (taken_off + sign.gain) if sign.gain else 1.0 for sign in signs]
    return LeftByLaw(max(of_some_unknown, default=0.0), signs)


class ToldLaw(NamedTuple):
    """A law without a name, a second effect beside it where there is one, and what they leave."""

    laws: Candidate
    left: LeftByLaw

    @property
    def stands(self) -> bool:
        """Whether it is no noise, though what it leaves may be none either."""
        return bool(self.left.signs) or self.left.is_little

    @property
    def is_most(self) -> bool:
        """Whether it is most of what is missing."""
        return self.left.share < MOSTLY

    @property
    def against_noise(self) -> tuple[Sign, ...]:
        """What noise would not do, of what is left."""
        return () if self.left.is_little else self.left.signs


def told_law(
    problem: Problem, nothing: Candidate, law: Candidate, structure: Structure, settings: Settings
) -> ToldLaw:
    """Return a law with what it leaves, and with a second effect or law where it leaves one.

    Parameters
    ----------
    nothing : Candidate
        The refit, to which nothing is added.
    """
    left = left_by_law(problem, nothing, law, structure, settings)
    if left.is_little or not left.signs or settings.max_effects < 2:
        return ToldLaw(law, left)
    both = _with_a_second(problem, law, left.signs, structure, settings)
    if both is None:
        return ToldLaw(law, left)
    return ToldLaw(both, left_by_law(problem, nothing, both, structure, settings))


def _with_a_second(
    problem: Problem, law: Candidate, signs: Iterable[Sign], structure: Structure, settings: Settings
) -> Candidate | None:
    """Return a law with the best effect beside it, or with another law; None where that may be noise.

    A name goes before a law without one that is not clearly likelier. Nothing slow is looked for: beside a
    law that is not all of it, anything drifts.
    """
    known = [
        h
        for h in hypotheses_of(problem, law.fit, structure, settings)
        if h.asked and h.placed.effect.code not in DRIFTS and h.placed.place not in law.places
    ]
    waves = [hertz for sign in signs for hertz in sign.frequencies]
    named = _best_named(problem, law.fit, known, settings)
    unnamed = best_unnamed(problem, law.fit, law, structure, settings, known, waves)
    second = named
    if unnamed is not None and (named is None or is_likelier(unnamed, named)):
        second = unnamed
    if second is None:
        return None
    gained = deviance(problem, law.fit.model) - deviance(problem, second.fit.model)
    chance = chance_of_noise(gained, max(len(known), 1), n_shapes(second.effects[-1], problem))
    return second if chance <= settings.alpha_nameless else None


def _best_named(problem: Problem, base: Fit, known: list[Hypothesis], settings: Settings) -> Candidate | None:
    """Return the likeliest effect of those known beside a fit, converged."""
    bank = make_bank(problem, base, known, settings.n_jobs)
    placed = leaders(bank, settings.n_leaders, NONE_SILENT, 1.0)
    found = refit_leaders(problem, base, placed, settings.n_jobs, finished=1, twins=0)
    return found[0] if found else None

"""What is said of a search: the set that is named, what it is held against, and the verdict."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.bank import make_bank
from narx_sklearn.discrepancy.candidate import HARDLY, ODD, Candidate, odd
from narx_sklearn.discrepancy.coloured_search import Searched, converged, hypotheses_of
from narx_sklearn.discrepancy.confirm import (
    DRIFT,
    chance_of_noise,
    deviance,
    is_all_drift,
    is_of_a_sensor,
    n_shapes,
)
from narx_sklearn.discrepancy.explain import FINE, probe, refit_leaders
from narx_sklearn.discrepancy.generic import UNNAMED, curve_hypotheses, line_hypotheses, pulse_hypotheses
from narx_sklearn.discrepancy.hypotheses import Hypothesis
from narx_sklearn.discrepancy.lookalikes import REFINES, declared_rival, is_a_change, likeliest, look_alikes
from narx_sklearn.discrepancy.naming import FORM, bent_together, named_by_reach, named_set
from narx_sklearn.discrepancy.placed import ALWAYS
from narx_sklearn.discrepancy.problem import Problem
from narx_sklearn.discrepancy.ranking import gains
from narx_sklearn.discrepancy.refit import Fit, fit
from narx_sklearn.discrepancy.remainder import Sign, look_at_remainder, look_for_pulse
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.structure import Structure

UNEXPLAINED = 0.1  # share of what could be explained that named effects may leave to anything else
BENT = 0.01  # the same, of effects that act together: those leaving more were bent to one law
ROOM = 3.0  # times what a form visibly leaves, that its look-alikes may leave
BY_CHANCE = 10.0  # noise variances that the best curve takes off pure noise
SHARE = 0.5  # of alpha, for what has no name
SUSPECT = 0.05  # level at which a pair's remainder counts as something


class Judgement(NamedTuple):
    """What is said of a set of effects, and what it was held against."""

    verdict: str
    best: Candidate
    alternatives: tuple[tuple[Candidate, ...], ...]
    unnamed: Candidate | None
    stand_in: bool = False  # names for a law that is none of them
    against_noise: tuple[Sign, ...] = ()  # what noise would not do, and several names leave


def judge(searched: Searched, structure: Structure, settings: Settings) -> Judgement | None:
    """Return what is said of the likeliest set of a search; None where nothing is missing."""
    problem, refitted, pool = searched.problem, searched.refitted, searched.pool
    if not pool or searched.p_value > settings.alpha:
        return None
    settings.tell("rivals and unnamed curves")
    best = named_set(searched, pool, settings)
    named = named_by_reach(problem, best, pool, refitted.cost, settings.n_jobs)
    found = _judged(searched, named, pool, structure, settings)
    if found.verdict == "unknown" and named is not best:
        found = _judged(searched, best, pool, structure, settings)
    singles = [c for c in pool if len(c.effects) == 1 and c.effects[0].effect.code != DRIFT]
    if found.verdict == "unknown" and len(best.effects) > 1 and singles and not found.stand_in:
        # what goes with it has no name; the effect that explains most may have one (a drift goes anywhere)
        single = converged(problem, likeliest(singles, refitted.cost), settings.n_jobs)
        alone = _judged(searched, single, pool, structure, settings)
        return alone if alone.verdict != "unknown" else found
    return found


def _judged(
    searched: Searched, best: Candidate, pool: list[Candidate], structure: Structure, settings: Settings
) -> Judgement:
    """Hold a set of effects against what it leaves, its rivals and the best curve without a name."""
    problem, refitted, _ = searched
    leftover = _leftover(problem, best, structure, settings)
    # where the named form visibly leaves something, its look-alikes may leave as much, and some more
    visible = max(leftover.gain, 0.0) if leftover.p_value <= SUSPECT else 0.0
    tolerated = min(FORM * (refitted.cost - best.fit.cost), ROOM * visible)
    starts = {h.placed.always().place: h.starts for h in searched.hypotheses}
    alternatives = _alternatives(problem, best, pool, tolerated, starts, refitted.cost)
    unnamed = best_unnamed(problem, refitted, best, structure, settings)
    follows = _left_by_several(problem, refitted, best, structure, settings)
    stand_in = bool(follows) or _stand_in(refitted, best, leftover, settings.alpha)
    verdict = _decide(refitted, best, alternatives, unnamed, leftover, settings.alpha)
    return Judgement("unknown" if stand_in else verdict, best, alternatives, unnamed, stand_in, follows)


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
        rivals = [c for c in rivals if effect.effect.code not in _replaced(c, kept)]
        # what the catalogue warns of is fitted to the end before it is judged
        rivals = [converged(problem, c) if declared_rival(best, c) else c for c in rivals]
        rivals.sort(key=lambda c: c.criterion)
        found.append(
            tuple(look_alikes(problem, best, rivals, tolerated, starts, unexplained=unexplained)[1:])
        )
    return tuple(found)


def _replaced(candidate: Candidate, kept: set) -> set[str]:
    """Return the codes of the effects that are not among those kept."""
    return {e.effect.code for e in candidate.effects if e.place not in kept}


def best_unnamed(
    problem: Problem,
    refitted: Fit,
    best: Candidate,
    structure: Structure,
    settings: Settings,
    waves: Sequence[float] = (),
) -> Candidate | None:
    """Return the best curve at any port, fitted from the refit and the parameters that go with the names.

    Beside what acts for a while, a change of the simulator's own parameters meanwhile is tried too, and what
    pulsates at the frequencies of some ``waves``, Hz.
    """
    curves = _curves(problem, refitted, structure)
    times = {effect.during for effect in best.effects}
    during = times.pop() if len(times) == 1 else ALWAYS
    if during != ALWAYS:
        curves += line_hypotheses(problem.simulator, structure)
    fine = 1.0 / (problem.simulator.dt * len(problem.y))  # between two that the record tells apart
    for wave in waves:
        curves += pulse_hypotheses(problem.simulator, structure, (wave - fine, wave + fine))
    placed = [replace(curve.placed, during=during) for curve in curves]
    beside = refitted._replace(model=best.fit.model._replace(effects=()))
    found = refit_leaders(problem, refitted, placed, settings.n_jobs, finished=1, twins=0, elsewhere=[beside])
    return found[0] if found else None


def best_pulsating(
    problem: Problem, refitted: Fit, unnamed: Candidate | None, structure: Structure, settings: Settings
) -> Candidate | None:
    """Return what pulsates, where something surely does and it is better than a curve; else the curve."""
    pulse = look_for_pulse(problem, refitted, structure, settings.random_state)
    if pulse.p_value > SHARE * settings.alpha:
        return unnamed
    base = Candidate(refitted, problem.n_seen)
    pulsating = best_unnamed(problem, refitted, base, structure, settings, pulse.frequencies)
    found = [c for c in (unnamed, pulsating) if c is not None]
    return min(found, key=lambda c: c.criterion, default=None)


def _curves(problem: Problem, found: Fit, structure: Structure) -> list[Hypothesis]:
    """Return the unnamed curves at every port, knots where a fitted model's run goes."""
    run = problem.run(found.model)
    rows = problem.rows[problem.inside]
    return curve_hypotheses(problem.simulator, structure, problem.u[rows], run.x[rows], run.y[rows])


def is_explained_by(
    problem: Problem, base: Candidate, curve: Candidate, structure: Structure, settings: Settings
) -> bool:
    """Tell whether a curve takes off more than noise of any colour would let it, and leaves noise."""
    gained = deviance(problem, base.fit.model) - deviance(problem, curve.fit.model)
    if chance_of_noise(gained, 1, n_shapes(curve.effects[0], problem)) > SUSPECT:
        return False
    rest = look_at_remainder(problem, curve.fit.model, structure, settings.random_state)
    return rest.p_value > SHARE * settings.alpha


class Leftover(NamedTuple):
    """The test of what a named set leaves, and what tells it best."""

    p_value: float
    gain: float  # what that would take, beyond what it takes off pure noise
    of_form: bool = False  # told by a curve without a name, in an equation in which a named effect acts

    def refutes(self, taken_off: float, share: float, alpha: float) -> bool:
        """Tell whether it shows that a form is wrong: it is more than a share of what could be explained."""
        return self.of_form and self.p_value <= alpha and self.gain > share * (taken_off + self.gain)


def _leftover(problem: Problem, best: Candidate, structure: Structure, settings: Settings) -> Leftover:
    """Test what the named set leaves, and return what the best further column or curve would take.

    A drift or an offset of an output does not count: the search held it against noise that drifts.
    """
    curves = _curves(problem, best.fit, structure)
    hypotheses = hypotheses_of(problem, best.fit, structure, settings)
    named = [h for h in hypotheses if not (h.placed.place in best.places or is_of_a_sensor(h.placed))]
    bank = make_bank(problem, best.fit, [*named, *curves], settings.n_jobs)
    is_curve = np.array([bank.hypotheses[h].placed.effect.code in UNNAMED for h in bank.owner])
    gain = gains(bank).gain
    detection = probe(problem, best.fit, bank, settings.random_state, is_curve | (gain > 0))
    curve_gain, at = 0.0, None
    for h in set(bank.owner[is_curve]):
        columns = np.flatnonzero(bank.owner == h)
        G, b = bank.gram[np.ix_(columns, columns)], bank.plain[columns]
        taken = float(b @ np.linalg.pinv(G, rcond=1e-9, hermitian=True) @ b)
        if taken > curve_gain:
            curve_gain, at = taken, bank.hypotheses[h].placed.port
    named_gain = float(np.where(is_curve, 0.0, gain).max(initial=0.0))
    by_chance = BY_CHANCE * best.fit.cost / best.n_samples
    of_form = at is not None and any(structure.share_equation(at, e.port) for e in best.effects)
    return Leftover(
        detection.p_value, max(curve_gain, named_gain) - by_chance, of_form and curve_gain > named_gain
    )


def _stand_in(refitted: Fit, best: Candidate, leftover: Leftover, alpha: float) -> bool:
    """Tell whether two look-alikes that act together at one port were bent to a law that is neither."""
    return bool(bent_together(best)) and leftover.refutes(refitted.cost - best.fit.cost, BENT, alpha)


def _left_by_several(
    problem: Problem, refitted: Fit, best: Candidate, structure: Structure, settings: Settings
) -> tuple[Sign, ...]:
    """Return what still follows the motion beside several names, where it does.

    One name may be idealised. Where it takes two and that is not all, they stand in for something else.
    """
    if len(best.effects) < 2:
        return ()
    remainder = look_at_remainder(problem, best.fit.model, structure, settings.random_state)
    taken_off = refitted.cost - best.fit.cost
    speaking = remainder.speaking(SHARE * settings.alpha)
    return tuple(sign for sign in speaking if sign.gain > BENT * (taken_off + sign.gain))


def _may_be_drift(best: Candidate, alternatives) -> bool:
    """Tell whether outputs are off by nothing but what may drift."""
    of_sensors = all(is_of_a_sensor(effect) for effect in best.effects)
    return of_sensors and any(is_all_drift(c) for c in (best, *chain.from_iterable(alternatives)))


def _decide(refitted: Fit, best: Candidate, alternatives, unnamed, leftover: Leftover, alpha: float) -> str:
    """Return explained, ambiguous or unknown."""
    if _may_be_drift(best, alternatives):
        return "ambiguous" if any(alternatives) else "explained"  # its course is as it may be
    taken_off = refitted.cost - best.fit.cost
    several = len(best.effects) > 1
    to_explain = taken_off + leftover.gain
    if leftover.p_value <= (SUSPECT if several else alpha) and leftover.gain > UNEXPLAINED * to_explain:
        return "unknown"
    if leftover.refutes(taken_off, FORM, alpha):
        return "unknown"
    if unnamed is not None and is_a_change(unnamed, best):
        return "unknown"  # a parameter of the simulator's own has changed
    if unnamed is not None and odd(best) and unnamed.criterion < best.criterion + ODD:
        return "unknown"  # a name from elsewhere says no more than the curve does
    if unnamed is not None and unnamed.criterion < best.criterion - HARDLY:
        # one curve that does visibly better than two names has them stand in for it
        tolerated = REFINES if several else UNEXPLAINED
        if best.fit.cost - unnamed.fit.cost > tolerated * (refitted.cost - unnamed.fit.cost):
            return "unknown"
    return "ambiguous" if any(alternatives) else "explained"

"""The chain of a diagnosis: refit, test, name, decide."""

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, all_bounds, fit
from narx_sklearn.discrepancy.fitting.start import fit_initial_states
from narx_sklearn.discrepancy.noise import Noise, estimate_noise
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.results import NOTHING_MISSING
from narx_sklearn.discrepancy.search.candidate import Candidate, converged, odd
from narx_sklearn.discrepancy.search.confirm import CLEARER, OFFSET, clearer_noise, is_drift, priced
from narx_sklearn.discrepancy.search.explain import Step
from narx_sklearn.discrepancy.search.inference import (
    intervals,
    parameters_moved,
    spanning,
    told_together,
    untold,
)
from narx_sklearn.discrepancy.search.lookalikes import is_a_change
from narx_sklearn.discrepancy.search.members import by_weight, without
from narx_sklearn.discrepancy.search.unnamed.kinds import is_unnamed
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.simulator import Run, Simulator
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.simulators.windows import followed_for
from narx_sklearn.discrepancy.stages.apart import (
    Apart,
    Part,
    began_of,
    fit_apart,
    intervals_apart,
    with_common,
)
from narx_sklearn.discrepancy.stages.beginning import (
    DivergesError,
    begin,
    centred,
    leaves_rounding,
    residual_deviation,
    rounding_of,
    states_at,
)
from narx_sklearn.discrepancy.stages.between_samples import in_straight_lines
from narx_sklearn.discrepancy.stages.bounded import AtBound, fit_beyond
from narx_sklearn.discrepancy.stages.coloured_search import (
    Searched,
    coloured_search,
    pool_of,
    steps_beside,
)
from narx_sklearn.discrepancy.stages.in_sessions import sessions_of
from narx_sklearn.discrepancy.stages.judgement import Judgement, judge, judged
from narx_sklearn.discrepancy.stages.plain import (
    counted_from_zero,
    with_limits_that_pay,
    with_positive_amplitudes,
)
from narx_sklearn.discrepancy.stages.refuted import NOTHING_SEEN, LeftByForm, may_be_drift
from narx_sklearn.discrepancy.stages.remainder import Sign, look_at_remainder
from narx_sklearn.discrepancy.stages.stretches import Stretches, find_stretches
from narx_sklearn.discrepancy.stages.temporary import (
    large_parts,
    may_stand_in,
    search_in_spans,
    spans_of,
)
from narx_sklearn.discrepancy.stages.told_law import ToldLaw, left_by_law, told_law
from narx_sklearn.discrepancy.stages.unforeseen import (
    Unforeseen,
    Worth,
    beside_laws,
    fitted_beside,
    leave_little,
    look_for_unforeseen,
    that_pay,
    which_leads,
)
from narx_sklearn.discrepancy.stages.unnamed import (
    SUSPECT,
    UNEXPLAINED,
    best_pulsating,
    best_unnamed,
    held_where_seen,
)
from narx_sklearn.discrepancy.stages.varying import parameter_that_varies
from narx_sklearn.discrepancy.surrogates.twin import TwinSimulator

LARGE = 0.02  # of the deviance for each sample: so much less is no accident of laws that are not true
LEADERS = 3  # of what was fitted, that may be better with inputs in straight lines between samples
SHORTER = 8  # times as short are windows over which what was not explained is looked at again
SHORT = 50  # samples, that such windows have at least
CLEARLY_LESS = 0.7  # of what was left over long windows, where names of short ones are believed
AGAIN = 2  # diagnoses after the first, each with a simulator known nearer to the parameters found


@dataclass(frozen=True)
class Diagnosis:
    """Everything that was found on the fitting windows."""

    verdict: str
    problem: Problem
    structure: Structure
    nominal: Fit  # initial states only
    refitted: Fit
    best: Candidate  # the set chosen, or a curve that tells more; empty when nothing is missing
    order: tuple[int, ...]  # of its effects: those first that explain most
    alternatives: tuple[tuple[Candidate, ...], ...]  # what could stand in the place of each of its effects
    p_missing: float
    steps: tuple[Step, ...]
    followed_for: float  # samples for which a run follows the machine; infinite where nothing grows
    forgets: bool  # whether the machine forgets with which states it began
    stretches: Stretches  # of time, in which the mismatch is
    twin_misses_more: bool = False  # than the effects at state equations explain; then they are not believed
    against_noise: tuple[Sign, ...] = ()  # what noise would not do, of what is left over
    unforeseen: Unforeseen | None = None  # what follows no signal, where that is what was found
    beside: Unforeseen | None = None  # the same where names stand, and it acts beside them
    chosen: Candidate | None = None  # the best as it was among others, where it was fitted beside that since
    lengthened_from: int = 0  # samples of a window before it was made long; 0 where it was not
    steps_miss: bool = False  # most of it, those of the integration; then no physics is believed
    record_misleads: bool = False  # by a mistake that must be mended before physics is believed
    left: LeftByForm = NOTHING_SEEN  # by names, of what could be explained
    unnamed: Candidate | None = None  # the best law without a name, where names were held against one
    narrow: tuple[AtBound, ...] = ()  # bounds that were given, and are all that was wrong; it is without them
    apart: tuple[Part, ...] = ()  # sessions with parameters of their own, which leaves less than the best
    missed_in_each: tuple[PlacedEffect, ...] = ()  # of these sessions by itself; all else is of one
    together: Part | None = None  # what was found of all sessions, where the diagnosis is of one

    @property
    def law(self) -> Candidate:
        """What follows signals of all that was found: the best set, or parameters alone."""
        return self.best if self.unforeseen is None else Candidate(self.refitted, self.problem.n_seen)

    @property
    def is_named(self) -> bool:
        """Whether effects of known names explain what is missing, these or others that look alike."""
        return self.verdict in ("explained", "ambiguous")

    @property
    def is_apart(self) -> bool:
        """Whether nothing is missing but parameters of their own in sessions."""
        return bool(self.apart) and self.verdict == "refit"

    @property
    def of_session(self) -> int | None:
        """First sample of the session that it is of; None where it is of all."""
        return int(self.problem.windows.began[0]) if self.missed_in_each else None

    @property
    def noise(self) -> Noise:
        """Noise that the best explanation leaves; searched was under that which names leave."""
        if self.is_apart:
            return max(self.apart, key=lambda part: part.problem.n_seen).problem.noise
        wanders = self.unforeseen or self.beside
        if wanders is not None:
            return wanders.noise
        if not any(map(is_unnamed, self.best.effects)):
            return self.problem.noise
        return estimate_noise(self.problem.left_over(self.best.fit.model), self.problem.seen)

    def intervals(self, level: float) -> np.ndarray:
        """Return confidence intervals of all that was fitted last, (n_q, 2).

        Those of the simulator's own parameters hold whichever of the explanations is right that these data
        do not exclude.
        """
        problem, found = self.problem, self.best.fit
        if self.is_apart:
            return intervals_apart(self.apart, level)
        wanders = self.unforeseen or self.beside
        if wanders is None:
            rows = intervals(problem, found, level)
        else:
            rows = wanders.intervals(found.model.q, all_bounds(problem, found.model), level)
        return spanning(rows, problem, found, [c.fit for c in self.not_excluded], level)

    @cached_property
    def untold(self) -> np.ndarray:
        """Directions in which parameters may move together and nothing is noticed, (n, n_q)."""
        return untold(self.best.fit)

    @cached_property
    def told_together(self) -> list[list[int]]:
        """Groups of parameters of which only what they do together is told."""
        return told_together(self.best.fit)

    @property
    def not_excluded(self) -> list[Candidate]:
        """What else may explain the record: look-alikes, a law without a name where names leave something."""
        if not self.is_named:
            return []
        laws = [self.unnamed] if self.left.share and self.unnamed is not None else []
        return [*chain.from_iterable(self.alternatives), *laws]

    @property
    def as_drift(self) -> "Diagnosis | None":
        """The same with a drift named in place of an offset that looks like one; None where none does."""
        if len(self.best.effects) != 1 or self.best.effects[0].effect.code != OFFSET:
            return None
        (rivals,) = self.alternatives
        drifts = [c for c in rivals if is_drift(c.effects[0])]
        if not drifts:
            return None
        others = tuple(c for c in rivals if c is not drifts[0])
        verdict = "ambiguous" if others else "explained"
        return replace(
            self, verdict=verdict, best=drifts[0], alternatives=(others,), beside=None, chosen=None
        )

    @property
    def compared(self) -> Candidate:
        """The best as it was held against others: what it is now was fitted to something else too."""
        return self.best if self.chosen is None else self.chosen

    @property
    def base_run(self) -> Run:
        """Run of the refitted simulator over the windows."""
        return self.problem.run(self.refitted.model)


def diagnose(simulator: Simulator, u: np.ndarray, y: np.ndarray, pieces, settings: Settings) -> Diagnosis:
    """Diagnose a simulator on the given pieces of a record.

    A simulator that is known only near some parameters is diagnosed again where those found lie elsewhere.
    Where nothing that is known explains what is seen over long windows, nor do parameters that are not the
    same in all sessions, shorter ones are tried.

    Parameters
    ----------
    pieces : list of (slice, int)
        Stretches without gaps in ``u``, each with the first sample of its session.
    """
    found = _diagnosed(simulator, u, y, pieces, settings)
    first, apart = found, None
    if found.verdict == "unknown" and (length := _shorter(found, settings)):
        apart = _unless_apart(found, u, y, pieces, settings)
        if apart.verdict in NOTHING_MISSING:
            return apart
        settings.tell("again, over shorter windows")
        over_shorter = replace(settings, window=length)
        shorter = _diagnosed_if_it_runs(simulator, u, y, pieces, over_shorter)
        if shorter is not None and _explains_more(shorter, found):
            found, settings = shorter, over_shorter
    for _ in range(AGAIN):
        known = found.problem.simulator
        nearer = known.centred(found.best.fit.model.p)
        if nearer is known:
            break
        settings.tell("again, nearer to the parameters that were found")
        again = _diagnosed_if_it_runs(nearer, u, y, pieces, settings)
        if again is None:
            break
        found = again
    found = _unless_straight(found, u, y, pieces, settings)
    found = _unless_narrow(found, u, y, pieces, settings)
    if apart is None or found is not first:
        apart = _unless_apart(found, u, y, pieces, settings)
    return _fitted_beside(apart, settings)


def _fitted_beside(found: Diagnosis, settings: Settings) -> Diagnosis:
    """Return a diagnosis whose names are fitted beside what follows no signal, which bends them too."""
    if found.beside is None:
        return found
    fitted, beside = fitted_beside(found.problem, found.best.fit, found.beside, settings.n_jobs)
    return replace(found, best=replace(found.best, fit=fitted), chosen=found.best, beside=beside)


def _unless_straight(found: Diagnosis, u: np.ndarray, y: np.ndarray, pieces, settings: Settings) -> Diagnosis:
    """Return a diagnosis, or that with inputs in straight lines between samples, where that leaves less.

    It has to be as simple: more effects may also mend what straight lines do to inputs that were held.
    """
    if found.verdict in NOTHING_MISSING:
        return found
    problem, law = found.problem, found.law
    simpler = (without(problem, law, [effect]) for effect in law.effects if len(law.effects) > 1)
    leaders = [Candidate(found.refitted, problem.n_seen), *pool_of(found.steps)[:LEADERS]]
    other = in_straight_lines(problem, law, chain(simpler, leaders), settings.n_jobs)
    if other is None:
        return found
    settings.tell("again, with inputs in straight lines between samples")
    straight = _diagnosed_if_it_runs(other, u, y, pieces, settings)
    if straight is None:
        return found
    gained = priced(problem, law) - priced(straight.problem, straight.law)
    least = CLEARER if straight.verdict != "unknown" else max(CLEARER, LARGE * problem.n_seen)
    is_as_simple = straight.law.price <= law.price
    return straight if is_as_simple and gained > least else found


def _unless_apart(found: Diagnosis, u: np.ndarray, y: np.ndarray, pieces, settings: Settings) -> Diagnosis:
    """Return a diagnosis, or that of parameters which are not the same in all sessions, if that is all.

    What was changed between recordings looks like physics to one set of parameters. Where sessions with their
    own leave less than what was found, and nothing is missing in any by itself, it is none. Where each misses
    the same, and it has a name by itself, the diagnosis is that of a session which names it first. Else
    they are told beside what was found, unless its names leave less.
    """
    if found.verdict in NOTHING_MISSING:
        return found
    problem, refitted = found.problem, found.refitted
    apart = fit_apart(problem, refitted, settings.n_jobs)
    if apart is None:
        return found
    is_law = bool(found.best.effects) and found.unforeseen is None
    together = Candidate(refitted, problem.n_seen)
    leave_less = apart.criterion < (found.best if is_law else together).criterion
    beside_names = _apart_beside_names(found, settings)
    if not (leave_less or beside_names):
        return found
    settings.tell("again, session by session")
    alone: list[Diagnosis] = []
    for began in began_of(problem):
        of_session = [piece for piece in pieces if piece[1] == began]
        one = _diagnosed_if_it_runs(problem.simulator, u, y, of_session, settings)
        if one is None:
            return found
        alone.append(one)
        have_no_name_in_common = not all(each.is_named for each in alone)
        is_more_missing = any(each.verdict not in NOTHING_MISSING for each in alone)
        if have_no_name_in_common and (beside_names or is_more_missing):
            break  # other sessions would not change what is said
    all_of_it = Part(problem, found.best.fit)
    telling, missed = _missed_in_each(alone)
    if missed:
        parts = tuple(Part(one.problem, one.best.fit) for one in alone)
        return replace(telling, apart=parts, missed_in_each=missed, together=all_of_it)
    if beside_names:
        return replace(found, apart=beside_names.parts, together=all_of_it)
    if is_more_missing:
        return found if found.is_named else replace(found, apart=apart.parts)
    parts = tuple(Part(one.problem, one.refitted) for one in alone)
    return replace(
        found,
        verdict="refit",
        best=Candidate(with_common(problem, refitted, parts, settings.n_jobs), problem.n_seen),
        order=(),
        alternatives=(),
        p_missing=min(1.0, len(alone) * min(one.p_missing for one in alone)),
        against_noise=(),
        unforeseen=None,
        beside=None,
        left=NOTHING_SEEN,
        unnamed=None,
        apart=parts,
    )


def _apart_beside_names(found: Diagnosis, settings: Settings) -> Apart | None:
    """Return sessions with parameters of their own beside what is named; None where they leave hardly less.

    What they take off has to be more than is to be had by chance, and more than a form may leave.
    """
    best = found.best
    if not found.is_named or any(effect.passes for effect in best.effects):
        return None
    apart = fit_apart(found.problem, best.fit, settings.n_jobs)
    if apart is None or apart.criterion >= best.criterion:
        return None
    left = sum(part.fit.cost for part in apart.parts)
    more = best.fit.cost - left > UNEXPLAINED * (found.refitted.cost - left)
    return apart if more else None


def _missed_in_each(alone: list[Diagnosis]) -> tuple[Diagnosis, tuple[PlacedEffect, ...]]:
    """Return the session whose names most others have, the longest of such, and those that none excludes."""

    def called(effect: PlacedEffect) -> tuple:
        return effect.effect.code, effect.port

    first = Counter(called(e) for one in alone if one.is_named for e in one.best.effects)
    common = set(first)
    for one in alone:
        sets = (one.best, *chain.from_iterable(one.alternatives)) if one.is_named else ()
        common &= {called(e) for candidate in sets for e in candidate.effects}

    def missed(one: Diagnosis) -> tuple[PlacedEffect, ...]:
        return tuple(e for e in one.best.effects if one.is_named and called(e) in common)

    def agreed(one: Diagnosis) -> tuple[int, int]:
        return sum(first[called(e)] for e in missed(one)), one.problem.n_seen

    telling = max(alone, key=agreed)
    return telling, missed(telling)


def _unless_narrow(found: Diagnosis, u: np.ndarray, y: np.ndarray, pieces, settings: Settings) -> Diagnosis:
    """Return a diagnosis, or that without the bounds of parameters where these alone were wrong.

    What a bound forbids looks like physics. Where the parameters beyond it explain the record as well as what
    was found, and nothing is missing beside them, it is none.
    """
    problem, best = found.problem, found.best
    beyond = fit_beyond(problem, found.refitted, settings.alpha, settings.n_jobs)
    if beyond is None:
        return found
    is_law = bool(best.effects) and found.unforeseen is None
    if is_law and best.criterion < Candidate(beyond.fit, problem.n_seen).criterion:
        return found
    settings.tell("again, without bounds of parameters")
    freed = _diagnosed_if_it_runs(beyond.simulator, u, y, pieces, settings)
    if freed is None or freed.verdict != "refit":
        return found
    return replace(freed, narrow=beyond.passed)


def _shorter(found: Diagnosis, settings: Settings) -> int:
    """Return how many samples shorter windows should have; 0 where there are none worth a look."""
    if settings.window is not None or _leaves_next_to_noise(found):
        return 0
    length = float(np.median(found.problem.windows.last - found.problem.windows.first))
    if found.lengthened_from:
        return int(np.sqrt(found.lengthened_from * length))
    return int(length / SHORTER) if length >= SHORTER * SHORT else 0


def _leaves_next_to_noise(found: Diagnosis) -> bool:
    """Tell whether a law without a name leaves hardly more than what is new in each sample.

    Names of shorter windows have to leave clearly less than the law, and nothing foretells what is new.
    """
    is_law = bool(found.best.effects) and all(map(is_unnamed, found.best.effects))
    if not is_law or found.lengthened_from or found.against_noise or found.unforeseen is not None:
        return False
    noise, seen = found.noise, found.problem.seen.sum(axis=(0, 1))
    whole = np.array([noise.deviation(output) for output in range(seen.size)])
    return bool(CLEARLY_LESS * np.average((whole / noise.sigma) ** 2, weights=seen) < 1.0)


def _explains_more(shorter: Diagnosis, found: Diagnosis) -> bool:
    """Tell whether what is named over shorter windows leaves less of the long ones too.

    An integrator without what is missing follows a long run; with it the machine may turn over, or swing out
    of step, and a fit that begins far away does not get there. Where windows were not made long, it has to
    leave clearly less than what was found.
    """
    if not shorter.is_named:
        return False
    long = found.problem.with_noise(Noise.white(found.problem.noise.sigma))
    model = shorter.best.fit.model
    x0 = states_at(shorter.problem, model, long.windows)
    left = [fit(long, m).cost for m in (model._replace(x0=x0), found.best.fit.model)]
    return left[0] < (1.0 if found.lengthened_from else CLEARLY_LESS) * left[1]


def _diagnosed_if_it_runs(
    simulator: Simulator, u: np.ndarray, y: np.ndarray, pieces, settings: Settings
) -> Diagnosis | None:
    """Diagnose once more, otherwise; None where the simulation is lost there, and what was found stands."""
    try:
        return _diagnosed(simulator, u, y, pieces, settings)
    except DivergesError:
        return None


def _diagnosed(simulator: Simulator, u: np.ndarray, y: np.ndarray, pieces, settings: Settings) -> Diagnosis:
    """Diagnose once: over windows of one length, near the parameters that the simulator has."""
    problem, refitted, structure, pace, lengthened_from = begin(simulator, u, y, pieces, settings)
    problem, refitted = centred(problem, refitted)
    rounding = rounding_of(y)
    left_over = residual_deviation(problem, refitted.residual)
    problem = problem.with_noise(Noise.white(np.maximum(left_over, rounding)))
    refitted = fit(problem, refitted.model, iterations=2, n_jobs=settings.n_jobs)
    searched = Searched(problem, refitted, [])
    if not leaves_rounding(problem, refitted.residual):
        searched = coloured_search(problem, refitted, structure, settings)
    problem, refitted, _ = searched
    stretches = find_stretches(problem, refitted, settings.random_state, settings.n_jobs)
    searched, found = _looked_into_parts(searched, stretches, structure, settings)
    p_missing = searched.p_value
    if searched.steps and (found is None or not found.best.effects):
        searched, found, p_missing = _unless_noise(found, searched, stretches, structure, settings)
    if found is not None and not _varies(found):
        searched, found = parameter_that_varies(searched, found, structure, settings) or (searched, found)
    if searched.steps:
        found, p_missing = _unless_unforeseen(found, p_missing, searched, structure, settings)
    problem, refitted, steps = searched
    if found is None and steps and (noise := clearer_noise(problem, refitted)) is not None:
        # all that is left is noise, of a colour of its own: as what an integrator adds up, which is slow
        problem = problem.with_noise(noise)
        refitted = fit(problem, refitted.model, n_jobs=settings.n_jobs)
    nominal = fit_initial_states(problem, refitted.model.x0)
    is_exact = leaves_rounding(problem, nominal.residual)
    p_moved = 1.0 if is_exact else parameters_moved(problem, nominal, refitted, settings.random_state)
    if found is None:
        nothing = "refit" if p_moved <= settings.alpha else "consistent"
        found = Judgement(nothing, Candidate(refitted, problem.n_seen), (), None)
    plain = with_positive_amplitudes(problem, counted_from_zero(problem, found.best))
    found = found._replace(best=with_limits_that_pay(problem, plain))
    twin_misses_more = _twin_misses_more(problem, refitted, found.best)
    if twin_misses_more:
        found = found._replace(verdict="unknown")
    if _is_told_by_a_law(found):
        assert found.unnamed is not None
        base = Candidate(refitted, problem.n_seen)
        found = _judged_as(told_law(problem, base, found.unnamed, structure, settings))
    found = found._replace(best=held_where_seen(problem, found.best))
    return Diagnosis(
        verdict=found.verdict,
        problem=problem,
        structure=structure,
        nominal=nominal,
        refitted=refitted,
        best=found.best,
        order=by_weight(problem, found.best, searched.pool),
        alternatives=found.alternatives,
        p_missing=p_missing,
        steps=tuple(steps),
        followed_for=followed_for(simulator, pace),
        forgets=pace.forgets,
        stretches=stretches,
        twin_misses_more=twin_misses_more,
        against_noise=found.against_noise,
        unforeseen=found.unforeseen,
        beside=found.beside,
        left=found.left,
        unnamed=found.unnamed,
        lengthened_from=lengthened_from,
    )


def _looked_into_parts(
    searched: Searched, stretches: Stretches, structure: Structure, settings: Settings
) -> tuple[Searched, Judgement | None]:
    """Look into parts of the record too; return the search that tells most, and what is said of it.

    Nothing is said (None) where nothing is missing.
    """
    if searched.steps:
        spans = spans_of(stretches, searched.problem)
        searched = search_in_spans(spans, stretches.p, searched, structure, settings) or searched
    found = judge(searched, structure, settings)
    if found is not None and not found.best.effects:  # where no name is near all else takes long
        varying = parameter_that_varies(searched, found, structure, settings)
        if varying is not None:
            return varying
    if found is not None:
        # what acts for half of the time bends the quieter half too, and what an integrator adds up is as loud
        # before as after, so no stretch of it need stand out
        names_leave_some = found.verdict == "unknown" or found.left != NOTHING_SEEN
        may_pass = names_leave_some or may_stand_in(found.best.effects)
        parts = large_parts if may_pass else sessions_of
        spans = parts(searched.problem, stretches.residual)
        in_part = search_in_spans(spans, stretches.p, searched, structure, settings)
        if in_part is not None:
            searched = in_part
            found = judge(searched, structure, settings)
    if found is not None and found.verdict == "unknown":
        problem, refitted, _ = searched
        curve, known = found.unnamed, searched.hypotheses
        pulsating = best_pulsating(problem, refitted, curve, structure, settings, known)
        found = found._replace(unnamed=pulsating)
    return searched, found


def _varies(found: Judgement) -> bool:
    """Tell whether a parameter was found that depends on a signal."""
    return any(effect.port.is_parameter for effect in found.best.effects)


def _unless_noise(
    found: Judgement | None,
    searched: Searched,
    stretches: Stretches,
    structure: Structure,
    settings: Settings,
) -> tuple[Searched, Judgement | None, float]:
    """Return the search and what is said where none found anything, and the p-value: the rest must be noise.

    Where it is none, what acts for half of the time may have bent all that was fitted. Where the test says
    that something is missing, but no name takes it off, a law without one may.
    """
    problem, refitted, _ = searched
    settings.tell("is what is left over noise?")
    remainder = look_at_remainder(problem, refitted.model, structure, settings.random_state)
    is_noise = remainder.p_value > settings.alpha_nameless
    if is_noise and searched.p_value > settings.alpha:
        return searched, found, max(searched.p_value, remainder.p_value)
    if not is_noise:
        parts = large_parts(problem, stretches.residual)
        in_part = search_in_spans(parts, stretches.p, searched, structure, settings)
        named = in_part and judge(in_part, structure, settings)
        if in_part and named and named.verdict != "unknown":
            return in_part, named, in_part.p_value
        heard = _searched_as_heard(searched, remainder.p_value, structure, settings)
        named = judge(heard, structure, settings)
        if named and named.verdict != "unknown":
            return heard, named, heard.p_value
    nothing, known = Candidate(refitted, problem.n_seen), searched.hypotheses
    against_noise = () if is_noise else remainder.speaking(settings.alpha_nameless)
    waves = [hertz for sign in against_noise for hertz in sign.frequencies]
    law = best_unnamed(problem, refitted, nothing, structure, settings, known, waves)
    if is_noise:
        # one weak sign, of what no name explains, is no finding: the law has to be one by itself
        if law is not None and _is_one_by_itself(law, nothing, searched, structure, settings):
            return searched, Judgement("unknown", law, ((),), law), searched.p_value
        return searched, found, max(searched.p_value, remainder.p_value)
    if law is not None:
        told = told_law(problem, nothing, law, structure, settings)
        if told.is_most:
            return searched, _judged_as(told), remainder.p_value
        law = told.laws if told.stands else None
    shapeless = Judgement("unknown", nothing, (), law, against_noise=against_noise)
    return searched, shapeless, remainder.p_value


def _searched_as_heard(
    searched: Searched, p_value: float, structure: Structure, settings: Settings
) -> Searched:
    """Return a search for names of what another test hears: it need not hear them as clearly itself.

    A ripple that is no line in time, under noise with a memory, is little of all that is searched for.
    """
    problem, refitted, _ = searched
    steps = steps_beside(problem, refitted, structure, replace(settings, alpha=SUSPECT))
    heard = steps[0].detection._replace(p_value=p_value)
    return Searched(problem, refitted, [steps[0]._replace(detection=heard), *steps[1:]])


def _unless_unforeseen(
    found: Judgement | None,
    p_missing: float,
    searched: Searched,
    structure: Structure,
    settings: Settings,
) -> tuple[Judgement | None, float]:
    """Return what is said, and the p-value, where something may act that follows no signal.

    What a twin gets wrong of its simulator looks like that, and is no alarm. Where no law was asked for yet,
    one that leaves little of it goes before.
    """
    problem, refitted, _ = searched
    if found is not None and may_be_drift(problem.noise, found.best, found.alternatives):
        return found, p_missing
    settings.tell("does anything act that follows no signal?")
    seen = look_for_unforeseen(problem, refitted.model, structure, settings.n_jobs)
    level = settings.alpha_nameless
    if seen is None or seen.p_value > level:
        return found, p_missing
    base = Candidate(refitted, problem.n_seen)
    by_law, told = found, None
    if found is not None:
        by_law = _by_its_law(found, base, searched, structure, settings)
        told = by_law.unnamed if _is_told_by_a_law(by_law) else by_law.best
    if told is None or not told.effects:
        if found is None and isinstance(problem.simulator, TwinSimulator):
            return found, p_missing
        p_missing = min(p_missing, seen.p_value)
        if found is None:
            law = best_unnamed(problem, refitted, base, structure, settings, searched.hypotheses)
            one = _is_one_by_itself(law, base, searched, structure, settings)
            if law is not None and one and leave_little(problem, seen, base, law):
                return Judgement("unknown", law, ((),), law), p_missing
    elif leave_little(problem, seen, base, told):
        return by_law, p_missing
    else:
        worth = beside_laws(problem, told, structure, level, settings.n_jobs)
        if not isinstance(problem.simulator, TwinSimulator):
            worth = that_pay(problem, worth, structure, level, settings.n_jobs)
        leading = which_leads(problem, seen, base, worth)
        left = () if by_law is None else by_law.against_noise
        follows = any(sign.kind == "follows" for sign in left)  # what the laws leave follows a signal
        if leading is None:
            if by_law is None or told is not by_law.best:
                return by_law, p_missing
            return _beside(by_law, worth, searched, structure, settings), p_missing
        if leading[0] is worth.laws and follows:
            return by_law, p_missing
        base, seen = leading
    beside, seen = fitted_beside(problem, base.fit, seen, settings.n_jobs)
    best = Candidate(beside, problem.n_seen)
    alternatives: tuple[tuple[Candidate, ...], ...] = ((),) * len(best.effects)
    return Judgement("unknown", best, alternatives, None, unforeseen=seen), p_missing


def _beside(
    said: Judgement, worth: Worth, searched: Searched, structure: Structure, settings: Settings
) -> Judgement:
    """Return what is said of those members of a set that pay beside what follows no signal.

    What a twin gets wrong of its simulator looks like that, and says nothing of names.
    """
    problem = searched.problem
    if isinstance(problem.simulator, TwinSimulator):
        return said
    if worth.laws is not said.best:
        fewer = converged(problem, worth.laws, settings.n_jobs)
        found = judged(searched, fewer, searched.pool, structure, settings)
        if found.verdict == "unknown" and said.verdict != "unknown":
            return said
        said = found
    return said._replace(beside=worth.seen)


def _is_one_by_itself(
    law: Candidate | None, base: Candidate, searched: Searched, structure: Structure, settings: Settings
) -> bool:
    """Tell whether a law explains what is missing, and paid for all that was tried: no test asked for one."""
    if law is None:
        return False
    alone = max(len(searched.hypotheses), 1), settings.alpha
    return left_by_law(searched.problem, base, law, structure, settings, *alone).is_little


def _judged_as(told: ToldLaw) -> Judgement:
    """Return what is said where a law without a name says most."""
    of_each: tuple[tuple[Candidate, ...], ...] = ((),) * len(told.laws.effects)
    return Judgement("unknown", told.laws, of_each, told.laws, against_noise=told.against_noise)


def _by_its_law(
    found: Judgement, base: Candidate, searched: Searched, structure: Structure, settings: Settings
) -> Judgement:
    """Return what a law says where nothing else is said, though it may leave most of what is missing."""
    law = found.unnamed
    if law is None or found.best.effects or found.verdict != "unknown":
        return found
    told = ToldLaw(law, left_by_law(searched.problem, base, law, structure, settings))
    return _judged_as(told) if told.stands else found


def _is_told_by_a_law(found: Judgement) -> bool:
    """Tell whether a law without a name says more than names that do not explain what is missing."""
    unnamed = found.unnamed
    names = found.verdict == "unknown" and bool(found.best.effects) and found.unforeseen is None
    return names and unnamed is not None and _tells_more(unnamed, found.best)


def _tells_more(unnamed: Candidate, best: Candidate) -> bool:
    """Tell whether a curve without a name says more than names that do not explain what is missing."""
    return odd(best) or is_a_change(unnamed, best) or unnamed.criterion < best.criterion


def _twin_misses_more(problem: Problem, refitted: Fit, best: Candidate) -> bool:
    """Tell whether a twin gets more of its simulator wrong than the effects that act in it explain."""
    if not isinstance(problem.simulator, TwinSimulator):
        return False
    missed = problem.whiten(problem.simulator.missed(problem.u, problem.windows))
    explained = refitted.cost - best.fit.cost
    return any(e.port.kind == "state" for e in best.effects) and explained < float(np.sum(missed**2))

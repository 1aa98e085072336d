"""The chain of a diagnosis: refit, test, name, decide."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain, combinations
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed

from narx_sklearn.discrepancy.bank import make_bank
from narx_sklearn.discrepancy.candidate import HARDLY, ODD, Candidate, odd
from narx_sklearn.discrepancy.coloured_search import coloured_search, converged, hypotheses_of, pool_of
from narx_sklearn.discrepancy.confirm import (
    DRIFT,
    OFFSET,
    chance_of_noise,
    deviance,
    is_drift,
    is_of_a_sensor,
    more_than_drift,
    n_shapes,
)
from narx_sklearn.discrepancy.explain import FINE, Step, by_weight, probe, refit_leaders
from narx_sklearn.discrepancy.generic import UNNAMED, curve_hypotheses, line_hypotheses, pulse_hypotheses
from narx_sklearn.discrepancy.hypotheses import Hypothesis
from narx_sklearn.discrepancy.inference import parameters_moved
from narx_sklearn.discrepancy.lookalikes import (
    REFINES,
    declared_rival,
    is_a_change,
    is_one_law,
    likeliest,
    look_alikes,
)
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import ALWAYS, PlacedEffect
from narx_sklearn.discrepancy.problem import Problem
from narx_sklearn.discrepancy.ranking import gains
from narx_sklearn.discrepancy.refit import Fit, fit
from narx_sklearn.discrepancy.remainder import Sign, look_at_remainder, look_for_pulse
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulator import Run, Simulator, Windows
from narx_sklearn.discrepancy.start import fit_initial_states, guess_states, states_along
from narx_sklearn.discrepancy.stretches import Stretches, find_stretches
from narx_sklearn.discrepancy.structure import Structure, find_structure
from narx_sklearn.discrepancy.swaps import exchanges, swaps
from narx_sklearn.discrepancy.temporary import large_parts, may_stand_in, search_in_spans, spans_of
from narx_sklearn.discrepancy.twin import TwinSimulator
from narx_sklearn.discrepancy.windows import (
    LONGEST,
    Pace,
    cut,
    find_pace,
    followed_for,
    shortest_window,
    spread_out,
    window_length,
)

UNEXPLAINED = 0.1  # share of what could be explained that named effects may leave to anything else
LONG = (
    4  # windows in which an integrating plant is looked at, once short ones have brought its parameters near
)
SHORTER = ((4, 2), (16, 8, 4, 2))  # parts of a window, over which a machine is fitted first
TRAPPED = 2.0  # times the cost of a fit led by shorter windows, beyond which one from afar lost its way
FOLLOWS = 0.3  # share of an output's spread that the residual of long windows may have
CENTRED = 6  # times that a fit goes on with a simulator known nearer to its parameters
AGAIN = 2  # diagnoses after the first, for the same reason
FINEST = 1e-9  # of an output's spread: a smaller residual is rounding, in which nothing is missing
FORM = 0.05  # share of what an effect explains that its idealised form may leave; a wrong one leaves more
BENT = 0.01  # the same, of effects that act together: those leaving more were bent to one law
ROOM = 3.0  # times what a form visibly leaves, that its look-alikes may leave
BY_CHANCE = 10.0  # noise variances that the best curve takes off pure noise
SHARE = 0.5  # of alpha, for what has no name
SUSPECT = 0.05  # level at which a pair's remainder counts as something
EXCHANGES = 2  # members of a set that may be exchanged


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
    p_moved: float
    steps: tuple[Step, ...]
    time_constant: float
    followed_for: float  # samples for which a run follows the machine; infinite where nothing grows
    stretches: Stretches  # of time, in which the mismatch is
    twin_misses_more: bool = False  # than the effects at state equations explain; then they are not believed
    against_noise: tuple[Sign, ...] = ()  # what noise would not do, of what is left over
    lengthened_from: int = 0  # samples of a window before it was made long; 0 where it was not

    @property
    def is_named(self) -> bool:
        """Whether effects of known names explain what is missing, these or others that look alike."""
        return self.verdict in ("explained", "ambiguous")

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
        return replace(self, verdict=verdict, best=drifts[0], alternatives=(others,))

    @property
    def base_run(self) -> Run:
        """Run of the refitted simulator over the windows."""
        return self.problem.run(self.refitted.model)


def diagnose(simulator: Simulator, u: np.ndarray, y: np.ndarray, pieces, settings: Settings) -> Diagnosis:
    """Diagnose a simulator on the given pieces of a record.

    A simulator that is known only near some parameters is diagnosed again where those found lie elsewhere.
    Where nothing that is known explains what is seen over long windows, shorter ones are tried.

    Parameters
    ----------
    pieces : list of (slice, int)
        Stretches without gaps in ``u``, each with the first sample of its session.
    """
    found = _diagnosed(simulator, u, y, pieces, settings)
    if found.verdict == "unknown" and found.lengthened_from:
        settings.tell("again, over shorter windows")
        lengths = found.problem.windows.last - found.problem.windows.first
        halfway = replace(settings, window=int(np.sqrt(found.lengthened_from * np.median(lengths))))
        found = _explaining_more(found, _diagnosed(simulator, u, y, pieces, halfway))
    for _ in range(AGAIN):
        known = found.problem.simulator
        nearer = known.centred(found.best.fit.model.p)
        if nearer is known:
            break
        settings.tell("again, nearer to the parameters that were found")
        found = _diagnosed(nearer, u, y, pieces, settings)
    return found


def _explaining_more(found: Diagnosis, shorter: Diagnosis) -> Diagnosis:
    """Return a diagnosis, or that over shorter windows where what it names leaves less of the long ones too.

    An integrator without what is missing follows a long run; with it the machine may turn over, and a fit
    that begins far away does not get there.
    """
    if not shorter.is_named:
        return found
    long = found.problem.with_noise(Noise.white(found.problem.noise.sigma))
    model = shorter.best.fit.model
    x0 = _states_at(shorter.problem, shorter.best.fit, long.windows)
    left = [fit(long, m).cost for m in (model._replace(x0=x0), found.best.fit.model)]
    return shorter if left[0] < left[1] else found


class Beginning(NamedTuple):
    """The fit of the simulator's own parameters, and what it was made with."""

    problem: Problem
    refitted: Fit
    structure: Structure
    pace: Pace
    lengthened_from: int  # samples of a window before it was made long; 0 where it was not


def begin(simulator: Simulator, u: np.ndarray, y: np.ndarray, pieces, settings: Settings) -> Beginning:
    """Fit the simulator's own parameters on the given pieces of a record.

    Parameters
    ----------
    pieces : list of (slice, int)
        Stretches without gaps in ``u``, each with the first sample of its session.
    """
    x = states_along(simulator, u, y, pieces)
    inside = np.isfinite(x).all(axis=1)
    if not inside.any():
        raise ValueError(
            "The simulation left the finite range at its first sample; check its parameters, units and dt."
        )
    structure = find_structure(simulator, x[inside], u[inside])
    pace = find_pace(simulator, x[inside], u[inside])
    n_samples = sum(piece.stop - piece.start for piece, _ in pieces)
    length = settings.window or window_length(simulator, pace, n_samples)
    shortest = shortest_window(simulator)
    _check_growth(simulator, pace, shortest)
    windows = spread_out(cut(pieces, length, shortest))
    if not windows.count:
        raise ValueError(
            f"No stretch of the record without gaps has the {shortest} samples that a fitting window needs. "
            "Pass a longer record."
        )
    spread = np.nanstd(y, axis=0)
    problem = Problem(simulator, u, y, windows, Noise.white(np.where(spread > 0, spread, 1.0)))
    settings.tell("fit of the simulator's own parameters")
    x0 = guess_states(simulator, u, y, windows, structure, x)
    nominal = fit_initial_states(problem, x0)
    refitted = fit(problem, nominal.model, n_jobs=settings.n_jobs)
    if settings.window is None:
        ladders = [
            [
                spread_out(cut(pieces, n, shortest))
                for n in sorted({max(length // share, shortest) for share in shares})
            ]
            for shares in SHORTER
        ]
        led = Parallel(n_jobs=settings.n_jobs, prefer="threads")(
            delayed(_grown)(problem, shorter, structure, x) for shorter in ladders
        )
        grown = min(refitted, *led, key=lambda found: found.cost)
        if refitted.cost > TRAPPED * grown.cost:
            problem, grown = _shortened(problem, grown, ladders[-1], structure, x)
            length = int(np.median(problem.windows.last - problem.windows.first))
        refitted = grown
    before = problem
    if settings.window is None and not (pace.forgets or pace.growth):
        longer = cut(pieces, min(n_samples, LONGEST) // LONG, shortest)
        problem, refitted = _lengthened(problem, refitted, spread_out(longer))
    _check_finite(problem, refitted)
    return Beginning(problem, refitted, structure, pace, 0 if problem is before else length)


def _diagnosed(simulator: Simulator, u: np.ndarray, y: np.ndarray, pieces, settings: Settings) -> Diagnosis:
    problem, refitted, structure, pace, lengthened_from = begin(simulator, u, y, pieces, settings)
    spread = np.nanstd(y, axis=0)
    problem, refitted = _centred(problem, refitted)
    rounding = FINEST * spread
    problem = problem.with_noise(Noise.white(np.maximum(_left_over(problem, refitted.residual), rounding)))
    refitted = fit(problem, refitted.model, iterations=2, n_jobs=settings.n_jobs)
    steps: list[Step] = []
    if np.any(_left_over(problem, refitted.residual) > rounding):
        problem, refitted, steps = coloured_search(problem, refitted, structure, settings)
    stretches = find_stretches(problem, refitted, settings.random_state, settings.n_jobs)
    if steps:
        spans = spans_of(stretches, problem)
        found = search_in_spans(spans, stretches.p, problem, refitted, steps, structure, settings)
        problem, refitted, steps = found or (problem, refitted, steps)
    named = _named(problem, refitted, steps, structure, settings)
    if named is not None and (named.verdict == "unknown" or may_stand_in(named.best.effects)):
        # what acts for half of the time bends the quieter half too, so no stretch of it need stand out
        spans = large_parts(problem)
        found = search_in_spans(spans, stretches.p, problem, refitted, steps, structure, settings)
        if found is not None:
            problem, refitted, steps = found
            named = _named(problem, refitted, steps, structure, settings)
    if named is not None and named.verdict == "unknown":
        named = named._replace(unnamed=_pulsating(problem, refitted, named.unnamed, structure, settings))
    p_missing = steps[0].detection.p_value if steps else 1.0
    nominal = fit_initial_states(problem, refitted.model.x0)
    is_exact = np.all(_left_over(problem, nominal.residual) <= rounding)
    p_moved = 1.0 if is_exact else parameters_moved(problem, nominal, refitted, settings.random_state)
    nothing = "refit" if p_moved <= settings.alpha else "consistent"
    named = named or _Judgement(nothing, Candidate(refitted, problem.n_seen), (), None)
    verdict, best, alternatives, unnamed, _, against_noise = named
    twin_misses_more = _twin_misses_more(problem, refitted, best)
    if not best.effects and steps:
        settings.tell("is what is left over noise?")
        remainder = look_at_remainder(problem, refitted.model, structure, settings.random_state)
        if remainder.p_value <= SHARE * settings.alpha:
            verdict, p_missing = "unknown", remainder.p_value
            against_noise = remainder.speaking(SHARE * settings.alpha)
            waves = [hertz for sign in against_noise for hertz in sign.frequencies]
            if waves or any(sign.kind == "follows" for sign in against_noise):
                unnamed = _unnamed(problem, refitted, best, structure, settings, waves)
            if unnamed is not None and _explains(problem, best, unnamed, structure, settings):
                best, alternatives, against_noise = unnamed, ((),), ()
    verdict = "unknown" if twin_misses_more else verdict
    if verdict == "unknown" and best.effects and unnamed is not None and _tells_more(unnamed, best):
        best, alternatives, against_noise = unnamed, ((),), ()
    return Diagnosis(
        verdict,
        problem,
        structure,
        nominal,
        refitted,
        best,
        by_weight(problem, best, pool_of(steps)),
        alternatives,
        p_missing,
        p_moved,
        tuple(steps),
        pace.time_constant,
        followed_for(simulator, pace),
        stretches,
        twin_misses_more,
        against_noise,
        lengthened_from,
    )


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


class _Judgement(NamedTuple):
    """What is said of a set of effects, and what it was held against."""

    verdict: str
    best: Candidate
    alternatives: tuple[tuple[Candidate, ...], ...]
    unnamed: Candidate | None
    stand_in: bool = False  # names for a law that is none of them
    against_noise: tuple[Sign, ...] = ()  # what noise would not do, and several names leave


def _named(
    problem: Problem, refitted: Fit, steps: list[Step], structure: Structure, settings: Settings
) -> _Judgement | None:
    """Return what is said of the likeliest set of a search; None where nothing is missing."""
    pool = pool_of(steps)
    if not pool or steps[0].detection.p_value > settings.alpha:
        return None
    settings.tell("rivals and unnamed curves")
    hypotheses = list({h.placed.place: h for step in steps for h in step.bank.hypotheses}.values())
    best = _likeliest_set(problem, pool, refitted.cost, hypotheses, settings.n_jobs)
    best = _without_refinement(best, pool, refitted.cost)
    best = more_than_drift(problem, refitted, best, pool, steps[0].bank, settings)
    best = converged(problem, best, settings.n_jobs)
    named = _named_by_reach(problem, best, pool, refitted.cost, settings.n_jobs)
    found = _judged(problem, refitted, named, pool, steps, structure, settings)
    if found.verdict == "unknown" and named is not best:
        found = _judged(problem, refitted, best, pool, steps, structure, settings)
    singles = [c for c in pool if len(c.effects) == 1 and c.effects[0].effect.code != DRIFT]
    if found.verdict == "unknown" and len(best.effects) > 1 and singles and not found.stand_in:
        # what goes with it has no name; the effect that explains most may have one (a drift goes anywhere)
        single = converged(problem, likeliest(singles, refitted.cost), settings.n_jobs)
        alone = _judged(problem, refitted, single, pool, steps, structure, settings)
        return alone if alone.verdict != "unknown" else found
    return found


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
            others += swaps(problem, best, [*pool, *others], hypotheses, n_jobs)
        if not others:
            break
        pool += others
        best = likeliest(pool, unexplained)
    return best


def _without_refinement(best: Candidate, pool: list[Candidate], unexplained: float) -> Candidate:
    """Return a set with one effect for two look-alikes at a port, if the second only mends a form."""
    next_to_nothing = REFINES * (unexplained - best.fit.cost)
    for one, other in _bent_together(best):
        kept = best.places - {one.place, other.place}
        fewer = [
            c
            for c in pool
            if len(c.effects) == len(best.effects) - 1
            and kept <= c.places
            and all(effect.port == one.port for effect in c.effects if effect.place not in kept)
            and c.fit.cost - best.fit.cost <= next_to_nothing
        ]
        if fewer:
            return likeliest(fewer, unexplained)
    return best


def _named_by_reach(
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


def _judged(
    problem: Problem,
    refitted: Fit,
    best: Candidate,
    pool: list[Candidate],
    steps: list[Step],
    structure: Structure,
    settings: Settings,
) -> _Judgement:
    """Hold a set of effects against what it leaves, its rivals and the best curve without a name."""
    leftover = _leftover(problem, best, structure, settings)
    # where the named form visibly leaves something, its look-alikes may leave as much, and some more
    visible = max(leftover.gain, 0.0) if leftover.p_value <= SUSPECT else 0.0
    tolerated = min(FORM * (refitted.cost - best.fit.cost), ROOM * visible)
    alternatives = _alternatives(problem, best, pool, tolerated, _ordinary(steps), refitted.cost)
    unnamed = _unnamed(problem, refitted, best, structure, settings)
    follows = _left_by_several(problem, refitted, best, structure, settings)
    stand_in = bool(follows) or _stand_in(refitted, best, leftover, settings.alpha)
    verdict = _decide(refitted, best, alternatives, unnamed, leftover, settings.alpha)
    return _Judgement("unknown" if stand_in else verdict, best, alternatives, unnamed, stand_in, follows)


def _check_growth(simulator: Simulator, pace: Pace, shortest: int) -> None:
    """Raise where equations grow so fast that they are no machine's: a run is lost within any window."""
    if simulator.discrete or followed_for(simulator, pace) >= shortest / 2:
        return
    raise ValueError(
        f"The simulation diverges: as it stands it grows e-fold in {1 / (pace.growth * simulator.dt):.2g} "
        f"samples, so even a window of {shortest} samples is lost. Check the signs of its terms, its units "
        f"and its dt={simulator.dt:.6g}."
    )


def _check_finite(problem: Problem, refitted: Fit) -> None:
    """Raise where a simulation leaves the finite range even in short windows, so nothing could be fitted."""
    if np.isfinite(refitted.cost):
        return
    run, windows, dt = problem.run(refitted.model), problem.windows, problem.simulator.dt
    with np.errstate(over="ignore"):
        lost = problem.seen & ~np.isfinite(run.y[problem.rows] ** 2)
    k = int(problem.rows[lost.any(axis=2)].min())
    length = int(np.median(windows.last - windows.first))
    raise ValueError(
        f"The simulation diverges: even begun anew in every window of {length} samples it leaves the finite "
        f"range, first at sample {k} of the record ({k * dt:.6g} s), and cannot be refitted. Check the signs "
        f"of its terms, its units and its dt={dt:.6g}; start from parameters with which it stays near the "
        "recording; or pass a shorter window."
    )


def _centred(problem: Problem, found: Fit) -> tuple[Problem, Fit]:
    """Return the problem and its fit with a simulator that is known near the parameters fitted."""
    for _ in range(CENTRED):
        nearer = problem.simulator.centred(found.model.p)
        if nearer is problem.simulator:
            break
        problem = Problem(nearer, problem.u, problem.y, problem.windows, problem.noise)
        found = fit(problem, found.model)
    return problem, found


def _grown(problem: Problem, shorter: list[Windows], structure: Structure, x: np.ndarray) -> Fit:
    """Return the fit of a problem to which fits over ever longer windows led.

    What grows, or turns over, takes a long run far away before parameters that are somewhat wrong can be told
    from it.
    """
    now = problem.over(shorter[0])
    x0 = guess_states(now.simulator, now.u, now.y, now.windows, structure, x)
    found = fit(now, fit_initial_states(now, x0).model)
    for windows in (*shorter[1:], problem.windows):
        longer = problem.over(windows)
        found = fit(longer, found.model._replace(x0=_states_at(now, found, windows)))
        now = longer
    return found


def _shortened(
    problem: Problem, found: Fit, shorter: list[Windows], structure: Structure, x: np.ndarray
) -> tuple[Problem, Fit]:
    """Return the problem over the longest windows in which a fit from afar finds its way, and its fit.

    Over longer ones effects would lose theirs too: what a machine that turns over makes of a small mistake is
    another run altogether.
    """
    for windows in reversed(shorter):
        part = problem.over(windows)
        led = fit(part, found.model._replace(x0=_states_at(problem, found, windows)))
        x0 = guess_states(part.simulator, part.u, part.y, windows, structure, x)
        from_afar = fit(part, fit_initial_states(part, x0).model)
        if from_afar.cost <= TRAPPED * led.cost:
            break
    return part, min(led, from_afar, key=lambda fitted: fitted.cost)


def _states_at(problem: Problem, found: Fit, windows: Windows) -> np.ndarray:
    """Return the states with which other windows begin, from the run of a fit, or else as measured."""
    x = problem.run(found.model).x[windows.first]
    known = problem.simulator.known_states(problem.u, problem.y, windows.first)
    return np.where(np.isfinite(x), x, np.where(np.isfinite(known), known, 0.0))


def _lengthened(problem: Problem, found: Fit, windows: Windows) -> tuple[Problem, Fit]:
    """Return the problem over longer windows and its fit, where the run still follows the recording there.

    What an integrator adds up over a long window tells far more than the same samples cut into many short
    ones, each with initial states of its own; but far from the right parameters a long run is lost.
    """
    longer = problem.over(windows)
    if not windows.count or windows.count >= problem.windows.count:
        return problem, found
    refitted = fit(longer, found.model._replace(x0=_states_at(problem, found, windows)))
    share = _left_over(longer, refitted.residual) / np.nanstd(problem.y, axis=0)
    return (longer, refitted) if np.all(share < FOLLOWS) else (problem, found)


def _left_over(problem: Problem, residual: np.ndarray) -> np.ndarray:
    """Return the standard deviation of the residual of each output."""
    r = residual.reshape(problem.seen.shape) * problem.noise.sigma
    counts = problem.seen.sum(axis=(0, 1))
    sigma = np.sqrt((r**2).sum(axis=(0, 1)) / np.maximum(counts, 1))
    return np.maximum(sigma, 1e-12 * np.maximum(problem.noise.sigma, 1e-300))


def _curves(problem: Problem, found: Fit, structure: Structure) -> list[Hypothesis]:
    """Return the unnamed curves at every port, knots where a fitted model's run goes."""
    run = problem.run(found.model)
    rows = problem.rows[problem.inside]
    return curve_hypotheses(problem.simulator, structure, problem.u[rows], run.x[rows], run.y[rows])


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


def _ordinary(steps: list[Step]) -> dict[tuple, np.ndarray]:
    """Return the starting values of all that was tried, by its place."""
    return {h.placed.always().place: h.starts for step in steps for h in step.bank.hypotheses}


def _replaced(candidate: Candidate, kept: set) -> set[str]:
    """Return the codes of the effects that are not among those kept."""
    return {e.effect.code for e in candidate.effects if e.place not in kept}


def _unnamed(
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


def _pulsating(
    problem: Problem, refitted: Fit, unnamed: Candidate | None, structure: Structure, settings: Settings
) -> Candidate | None:
    """Return what pulsates, where something surely does and it is better than a curve; else the curve."""
    pulse = look_for_pulse(problem, refitted, structure, settings.random_state)
    if pulse.p_value > SHARE * settings.alpha:
        return unnamed
    base = Candidate(refitted, problem.n_seen)
    pulsating = _unnamed(problem, refitted, base, structure, settings, pulse.frequencies)
    found = [c for c in (unnamed, pulsating) if c is not None]
    return min(found, key=lambda c: c.criterion, default=None)


def _explains(
    problem: Problem, base: Candidate, curve: Candidate, structure: Structure, settings: Settings
) -> bool:
    """Tell whether a curve takes off more than noise of any colour would let it, and leaves noise."""
    gained = deviance(problem, base.fit.model) - deviance(problem, curve.fit.model)
    if chance_of_noise(gained, 1, n_shapes(curve.effects[0], problem)) > SUSPECT:
        return False
    rest = look_at_remainder(problem, curve.fit.model, structure, settings.random_state)
    return rest.p_value > SHARE * settings.alpha


class _Leftover(NamedTuple):
    """The test of what a named set leaves, and what tells it best."""

    p_value: float
    gain: float  # what that would take, beyond what it takes off pure noise
    of_form: bool = False  # told by a curve without a name, in an equation in which a named effect acts

    def refutes(self, taken_off: float, share: float, alpha: float) -> bool:
        """Tell whether it shows that a form is wrong: it is more than a share of what could be explained."""
        return self.of_form and self.p_value <= alpha and self.gain > share * (taken_off + self.gain)


def _leftover(problem: Problem, best: Candidate, structure: Structure, settings: Settings) -> _Leftover:
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
    return _Leftover(
        detection.p_value, max(curve_gain, named_gain) - by_chance, of_form and curve_gain > named_gain
    )


def _stand_in(refitted: Fit, best: Candidate, leftover: _Leftover, alpha: float) -> bool:
    """Tell whether two look-alikes that act together at one port were bent to a law that is neither."""
    return bool(_bent_together(best)) and leftover.refutes(refitted.cost - best.fit.cost, BENT, alpha)


def _bent_together(candidate: Candidate) -> list[tuple[PlacedEffect, PlacedEffect]]:
    """Return the look-alikes that act at one port."""
    return [
        (one, other)
        for one, other in combinations(candidate.effects, 2)
        if one.port == other.port and one.effect.code in other.effect.lookalikes
    ]


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
    sets = (best, *chain.from_iterable(alternatives))
    return of_sensors and any(all(effect.effect.code == DRIFT for effect in c.effects) for c in sets)


def _decide(refitted: Fit, best: Candidate, alternatives, unnamed, leftover: _Leftover, alpha: float) -> str:
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

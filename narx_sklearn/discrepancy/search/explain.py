"""Which physics is missing: refit what leads, alone and in pairs, and add one effect after another."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed, effective_n_jobs

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.bank import Bank, entered, make_bank
from narx_sklearn.discrepancy.search.candidate import FINE, Candidate, odd, once_each
from narx_sklearn.discrepancy.search.confirm import Trial, confirmed, is_of_a_sensor
from narx_sklearn.discrepancy.search.detect import Detection, detect
from narx_sklearn.discrepancy.search.draws import nearer_by_draws
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.members import reordered, that_run, without_each, without_idle
from narx_sklearn.discrepancy.search.ranking import Pair, gains, leaders, pairs, with_nearest
from narx_sklearn.discrepancy.search.restricted import STEPPED
from narx_sklearn.discrepancy.search.valleys import begins_in_sessions, may_lie_elsewhere, other_valleys
from narx_sklearn.discrepancy.settings import Settings

ROUNDS = ((3, 14), (7, 6))  # iterations of a leader's first refits, and how many go on to the next round
FEW = 2  # models a thread, below which each is linearised by all threads
TWINS = 7  # leaders that are also tried from other values of the simulator's own parameters
ASUNDER = 0.5  # share of the larger of two values of such a parameter, from which they lie far apart
BEAM = 2  # sets of effects carried to the next depth
PAIRS = 8  # of effects that promise most together, fitted
PAIR_ROUNDS = ((3, 4), (7, 2))  # as above, of pairs
MUCH_LESS = 0.5  # share of what the best so far leaves, at most left by a pair that is looked into
IN_REACH = 60.0  # difference of the criterion that another valley of the cost may make up
FORM = 0.05  # share of what the best takes off, that it may make up too
PACE = 2.0  # times the last iteration's decrease, that each further one is given credit for


class Step(NamedTuple):
    """One depth of the search: the test before it, and the candidates that came of it."""

    detection: Detection
    bank: Bank
    candidates: list[Candidate]


def refit_leaders(
    problem: Problem,
    base: Fit,
    placed: list[PlacedEffect],
    n_jobs=None,
    *,
    finished: int | None = None,
    known: Sequence[Candidate] = (),
    twins: int = TWINS,
    elsewhere: Sequence[Fit] = (),
    ahead_of_all: Candidate | None = None,
) -> list[Candidate]:
    """Fit each leader together with everything that is in the model already; best first, each place once.

    All get a few iterations, the better ones more, the best (or the ``finished`` best) are taken to
    convergence. Where nothing is in the model yet, ``twins`` start from the simulator's own parameter values
    too: what the refit made of them without the effect may lie in another valley. Where the best came to
    quite other values of them than the next, these are tried from there as well. All begin from the fits
    ``elsewhere`` too. Those ``known``, fitted before under another noise, go on from there; of them the best
    are no less leaders. What does not come near one ``ahead_of_all``, which is known as well, is not fitted
    to the end.
    """
    before = {c.effects[-1].place: c.fit.model for c in reversed(known)}
    within = min((c.criterion for c in known), default=0.0) + IN_REACH
    ahead = (c.effects[-1].place for c in known if c.criterion < within)
    places = dict.fromkeys([*(effect.place for effect in placed), *ahead])
    models = [before[place] for place in places if place in before]
    for start in (base, *elsewhere):
        run = problem.run(start.model)
        begun = Parallel(n_jobs=n_jobs, prefer="threads")(
            delayed(entered)(problem, start, run, effect) for effect in placed if effect.place not in before
        )
        models += [one.model for one in begun]
    twins = 0 if base.model.effects or before else twins
    found, left_behind = _in_rounds(
        problem, base, models, n_jobs, twins=twins, finished=finished, leader=ahead_of_all
    )
    if finished is None:
        found, left_behind = _from_where_the_best_is(problem, base, found, left_behind, n_jobs)
    found = _from_other_valleys(problem, base, found, n_jobs)
    return once_each(sorted(found + left_behind, key=lambda c: c.criterion))


def _in_rounds(
    problem: Problem,
    base: Fit,
    models: list[Model],
    n_jobs,
    *,
    rounds: tuple[tuple[int, int], ...] = ROUNDS,
    twins: int = 0,
    finished: int | None = None,
    leader: Candidate | None = None,
) -> tuple[list[Candidate], list[Candidate]]:
    """Return what became of the best models, converged, and what was left behind on the way.

    What takes off less than half as much as the best, or a ``leader`` that is known, and would not come near
    it even at twice its last pace, goes no further.
    """
    left_behind: list[Candidate] = []
    for (iterations, most), remaining in zip(rounds, _remaining(rounds), strict=True):
        found = once_each(_fitted(problem, models, iterations, n_jobs))
        if not found:
            return [], left_behind
        going_on = found[:most]
        if twins and iterations == rounds[0][0]:
            again = [c.fit.model._replace(p=problem.simulator.nominal) for c in going_on[:twins]]
            going_on += _fitted(problem, again, iterations, n_jobs)
        known = going_on if leader is None else [*going_on, leader]
        best = min(known, key=lambda c: c.criterion)
        hopeful: list[Candidate] = []
        left_behind += found[most:]
        for candidate in going_on:
            (hopeful if _may_catch_up(candidate, best, base, remaining) else left_behind).append(candidate)
        models = [c.fit.model for c in hopeful]
    if finished is not None:
        models, left_behind = models[:finished], left_behind + hopeful[finished:]
    return _fitted(problem, models, FINE, n_jobs, rough=False), left_behind


def _remaining(rounds: tuple[tuple[int, int], ...]) -> list[int]:
    """Return how many iterations follow each round."""
    later = [iterations for iterations, _ in rounds[1:]]
    return [sum(later[k:]) + FINE for k in range(len(rounds))]


def in_reach(candidate: Candidate, best: Candidate, base: Fit) -> bool:
    """Tell whether a candidate leaves little more than the best."""
    near = candidate.criterion < best.criterion + IN_REACH
    return near or candidate.fit.cost - best.fit.cost < FORM * (base.cost - best.fit.cost)


def _may_catch_up(candidate: Candidate, best: Candidate, base: Fit, iterations: int) -> bool:
    """Tell whether a candidate takes off half as much as the best, or would be near it at twice its pace."""
    half_way = np.sqrt(base.cost * best.fit.cost)  # of the logarithm of the cost
    ahead = candidate.criterion - PACE * iterations * candidate.pace < best.criterion + IN_REACH
    return candidate.fit.cost < half_way or ahead or in_reach(candidate, best, base)


def _from_where_the_best_is(
    problem: Problem, base: Fit, found: list[Candidate], left_behind: list[Candidate], n_jobs
) -> tuple[list[Candidate], list[Candidate]]:
    """Return the candidates, better ones from the best's values of the simulator's own parameters with them.

    Those left behind are tried as well, up to as many as there are twins.
    """
    if not found:
        return found, left_behind
    best = found[0].fit.model.p
    others = [c for c in [*found[1:], *left_behind] if _lies_asunder(problem, c.fit.model.p, best)]
    models = [c.fit.model._replace(p=best) for c in others[:TWINS]]
    moved, behind = _in_rounds(problem, base, models, n_jobs, rounds=PAIR_ROUNDS, leader=found[0])
    return once_each(sorted(found + moved, key=lambda c: c.criterion)), left_behind + behind


def _lies_asunder(problem: Problem, p: np.ndarray, other: np.ndarray) -> bool:
    """Tell whether two values of any of the simulator's own parameters that have a size lie far apart."""
    larger = np.maximum(np.abs(p), np.abs(other))
    return bool(np.any((np.abs(p - other) > ASUNDER * larger) & (problem.simulator.nominal != 0)))


def _fitted(
    problem: Problem, models: list[Model], iterations: int, n_jobs, *, rough: bool = True
) -> list[Candidate]:
    """Return what a few iterations make of models, best first."""
    # else the last of a few keeps one thread busy while the others wait
    threads_each = n_jobs if len(models) < FEW * effective_n_jobs(n_jobs) else 1

    def fitted(model: Model) -> Candidate:
        found = fit(problem, model, iterations=iterations, rough=rough, n_jobs=threads_each)
        return Candidate(found, problem.n_seen)

    found = Parallel(n_jobs=n_jobs, prefer="threads")(delayed(fitted)(model) for model in models)
    return sorted(that_run(found), key=lambda c: c.criterion)


def refit_pairs(
    problem: Problem,
    base: Fit,
    bank: Bank,
    found: Sequence[Candidate],
    n_leaders: int,
    n_jobs=None,
    *,
    known: Sequence[Candidate] = (),
) -> list[Candidate]:
    """Fit pairs of effects where they promise to leave much less than any one ``found``; best first.

    Where the best keeps its promise, what goes with either of it is tried too. Those ``known``, fitted before
    under another noise, go on from there.
    """
    ranking = pairs(bank)
    much_less = MUCH_LESS * min((c.fit.cost for c in found), default=base.cost)
    promising = [pair for pair in ranking if base.cost - pair.gain <= much_less][:PAIRS]
    if not (promising or known):
        return []
    run = problem.run(base.model)

    def tried(some: list[Pair], models: list[Model]) -> list[Candidate]:
        begun = Parallel(n_jobs=n_jobs, prefer="threads")(
            delayed(entered)(problem, base, run, *pair.effects(bank)) for pair in some
        )
        models = [*models, *(one.model for one in begun)]
        ended, left_behind = _in_rounds(problem, base, models, n_jobs, rounds=PAIR_ROUNDS)
        return ended + left_behind

    fitted = sorted(tried(promising, [c.fit.model for c in known]), key=lambda c: c.criterion)
    if fitted and fitted[0].fit.cost <= much_less:
        for effect in fitted[0].effects[len(base.model.effects) :]:
            beside = [pair for pair in ranking[len(promising) :] if effect.place in pair.places(bank)]
            fitted += tried(beside[:n_leaders], [])
    return once_each(sorted(fitted, key=lambda c: c.criterion))


def _from_other_valleys(problem: Problem, base: Fit, found: list[Candidate], n_jobs) -> list[Candidate]:
    """Return the candidates, those in reach of the best from other values of their last effect too."""

    def settled(candidate: Candidate) -> Candidate:
        last = candidate.effects[-1]
        is_stepped = last.effect.code in STEPPED
        elsewhere = is_stepped or may_lie_elsewhere(last) or begins_in_sessions(problem, last)
        if not (elsewhere and in_reach(candidate, found[0], base)):
            return candidate
        look = nearer_by_draws if is_stepped else other_valleys
        other = Candidate(look(problem, candidate.fit), candidate.n_samples)
        return min(candidate, other, key=lambda c: c.criterion)

    return Parallel(n_jobs=n_jobs, prefer="threads")(delayed(settled)(c) for c in found)


def search(
    problem: Problem,
    base: Fit,
    make_hypotheses: Callable[[Fit], list[Hypothesis]],
    settings: Settings,
    *,
    dominated: bool = False,
    known: Sequence[Candidate] = (),
) -> list[Step]:
    """Add effects one after another while the test finds something left; return the steps taken.

    The best few sets of each depth are carried on, since one effect can mask another, and every set found is
    tried without each of its older members. Where something is left, but nothing that is added to the best
    set takes it, the next best is built on, and the best without each of its older members (a floating
    search: Pudil, Novovicova and Kittler 1994). Two effects enter at once where they promise what neither
    does. Beside another effect, before or after it, none is named at a place where one does not meet it.

    Parameters
    ----------
    make_hypotheses : callable
        Returns what may be missing beside a fitted model.
    dominated : bool
        Whether the residual is mostly structure, of which tangents tell little, so that the fits decide.
    known : sequence of Candidate
        Single effects and pairs that were fitted before.
    """
    alpha = settings.alpha
    beam = [Candidate(base, problem.n_seen)]
    steps: list[Step] = []
    for _ in range(settings.max_effects + 1):
        pool: list[Candidate] = []
        for rank, candidate in enumerate(beam):
            bank, detection = _probed(problem, candidate, make_hypotheses(candidate.fit), settings)
            if dominated and not candidate.effects:
                detection = _left_to_the_fits(detection)
            full = len(candidate.effects) >= settings.max_effects
            silent = rank == 0 and detection.p_value > alpha
            placed = [] if full or silent else leaders(bank, settings.n_leaders, detection, alpha)
            found = _added(problem, candidate, bank, placed, () if candidate.effects else known, settings)
            first = not pool  # and must be more than noise, as must what goes with a drift of a sensor
            if first or any(is_of_a_sensor(effect) for effect in candidate.effects):
                trial = Trial(problem, candidate, bank, settings.n_jobs, settings.random_state)
                detection, found = confirmed(trial, found, detection, alpha)
                found = found if detection.p_value <= alpha else []
            if rank == 0:
                steps.append(Step(detection, bank, pool))
                if detection.p_value > alpha:
                    return steps
                if not found:  # one of them may be wrong: looked at after the rest of the beam
                    beam += without_each(problem, candidate)
            pool += found
        pool.sort(key=lambda c: c.criterion)
        if pool and pool[0].effects[:-1]:
            best = pool[0]
            pool += without_each(problem, best) + without_idle(problem, best) + reordered(problem, pool)
            pool.sort(key=lambda c: c.criterion)
        if not pool or pool[0].criterion >= beam[0].criterion:
            break
        beam = [c for c in pool if not odd(c)][:BEAM]
        if not beam:
            break
    return steps


def _probed(
    problem: Problem, candidate: Candidate, hypotheses: Sequence[Hypothesis], settings: Settings
) -> tuple[Bank, Detection]:
    """Return what may be missing beside a set as a bank, its columns left out, and the test over it."""
    others = [
        h._replace(asked=h.asked and not (h.placed.odd and candidate.effects))
        for h in hypotheses
        if h.placed.place not in candidate.places
    ]
    bank = make_bank(problem, candidate.fit, others, settings.n_jobs)
    detection = probe(problem, candidate.fit, bank, settings.random_state)
    return bank.without_columns(), detection


def _added(
    problem: Problem,
    candidate: Candidate,
    bank: Bank,
    placed: list[PlacedEffect],
    known: Sequence[Candidate],
    settings: Settings,
) -> list[Candidate]:
    """Return the sets with one or two effects more that are better than a set, best first."""
    base, n_jobs = candidate.fit, settings.n_jobs
    alone = [c for c in known if len(c.effects) == 1]
    begun = {c.effects[-1].place for c in alone}
    placed = with_nearest(problem, base, bank, placed, n_jobs, known=begun)
    found = refit_leaders(problem, base, placed, n_jobs, known=alone)
    if placed and len(candidate.effects) + 2 <= settings.max_effects:
        both = [c for c in known if len(c.effects) == 2]
        found += refit_pairs(problem, base, bank, found, settings.n_leaders, n_jobs, known=both)
    return sorted((c for c in found if c.criterion < candidate.criterion), key=lambda c: c.criterion)


def _left_to_the_fits(detection: Detection) -> Detection:
    """Return a detection that leaves the decision to the fits: tangents tell little of what dominates."""
    return detection._replace(p_value=0.0, p_bank=0.0, p_line=0.0, p_scan=0.0)


def probe(problem: Problem, base: Fit, bank: Bank, random_state=None, allowed=None) -> Detection:
    """Test what is asked for of a bank, where it acts in its physical sense (or the columns ``allowed``)."""
    pairs = [(bank.hypotheses[h], s) for h, s in zip(bank.owner, bank.start, strict=True)]
    if allowed is None:
        allowed = (gains(bank).gain > 0) & np.array([hypothesis.asked for hypothesis, _ in pairs], dtype=bool)
    blind = np.array([not hypothesis.tuned[s] for hypothesis, s in pairs], dtype=bool)
    return detect(
        bank,
        blind & allowed,
        tried=np.array([hypothesis.tried[s] * hypothesis.asked for hypothesis, s in pairs]),
        n_outputs=problem.y.shape[1],
        n_samples=problem.n_seen,
        n_fitted=base.model.q.size + problem.n_initial,
        random_state=random_state,
    )

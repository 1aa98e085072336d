"""Which physics is missing: refit what leads, alone and in pairs, and add one effect after another."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed, effective_n_jobs

from narx_sklearn.discrepancy.bank import Bank, entered, make_bank, out_of
from narx_sklearn.discrepancy.confirm import (
    OFFSET,
    as_if_white,
    chance_of_noise,
    deviance,
    is_of_a_sensor,
    is_slow,
    n_shapes,
    noises_against,
)
from narx_sklearn.discrepancy.detect import Detection, detect
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.problem import Model, Problem
from narx_sklearn.discrepancy.ranking import Pair, gains, leaders, pairs
from narx_sklearn.discrepancy.refit import Fit, fit
from narx_sklearn.discrepancy.valleys import other_valleys

ROUNDS = ((3, 14), (7, 6))  # iterations of a leader's first refits, and how many go on to the next round
FEW = 2  # models a thread, below which each is linearised by all threads
FINE = 20  # iterations that bring a leader to convergence
TWINS = 7  # leaders that are also tried from other values of the simulator's own parameters
ASUNDER = 0.5  # share of the larger of two values of such a parameter, from which they lie far apart
BEAM = 2  # sets of effects carried to the next depth
PAIRS = 8  # of effects that promise most together, fitted
PAIR_ROUNDS = ((3, 4), (7, 2))  # as above, of pairs
MUCH_LESS = 0.5  # share of what the best so far leaves, at most left by a pair that is looked into
LEVELS = 2  # ways in which an output may be slowly off: from the first sample on, or as time goes
CONFIRMED = 4  # of the best candidates that may each show that it is not noise
IN_REACH = 60.0  # difference of the criterion that another valley of the cost may make up
FORM = 0.05  # share of what the best takes off, that it may make up too
PACE = 2.0  # times the last iteration's decrease, that each further one is given credit for
HARDLY = 4.0  # difference of the criterion, odds of seven to one, that excludes nothing
ODD = 6.0  # twice the logarithm of the odds against an effect at a place where one does not meet it


@dataclass(frozen=True)
class Candidate:
    """A set of effects, fitted."""

    fit: Fit
    n_samples: int
    given: int = 0  # ends of its effects' times that nobody chose

    @property
    def effects(self) -> tuple[PlacedEffect, ...]:
        """The effects, with their fitted parameters."""
        return self.fit.model.effects

    @property
    def places(self) -> set[tuple]:
        """What the effects are and where they act."""
        return {effect.place for effect in self.effects}

    @property
    def n_values(self) -> int:
        """Number of global parameters, but for those that tell where a memory begins."""
        return self.fit.model.q.size - sum(e.effect.begin is not None for e in self.effects)

    @cached_property
    def n_parameters(self) -> int:
        """Number of global parameters that the data can feel.

        A direction in which the effects change nothing that the simulator's own parameters and the other
        directions do not, or a parameter at its bound, was not fitted and has no price. Where a memory begins
        has none, as initial states have none. Where many valleys were looked into, tangents say nothing, and
        every parameter has its price.
        """
        model, J = self.fit.model, self.fit.jacobian
        own, q = model.p.size, model.q
        bounds = np.concatenate([np.empty((0, 2)), *(e.bounds for e in model.effects)])
        inside = (q[own:] > bounds[:, 0]) & (q[own:] < bounds[:, 1])
        inside &= np.array([k != e.effect.begin for e in model.effects for k in range(e.n_theta)], dtype=bool)
        many = np.array([e.effect.valleys > 0 for e in model.effects for _ in range(e.n_theta)], dtype=bool)
        n_tried = int(np.sum(inside & many))
        free = own + np.flatnonzero(inside & ~many)
        if not free.size:
            return own + n_tried
        columns = out_of(J[:, :, :own], J[:, :, free] * np.abs(q[free])).reshape(-1, free.size)
        felt = np.linalg.eigvalsh(columns.T @ columns)
        return own + n_tried + int(np.sum(felt > 1.0))

    @property
    def criterion(self) -> float:
        """Minus twice the log-likelihood of the whitened residual, and the price of what was chosen."""
        return self.n_samples * np.log(max(self.fit.cost, 1e-300) / self.n_samples) + self.price

    @property
    def pace(self) -> float:
        """Decrease of the criterion in the last iteration of the fit."""
        return -self.n_samples * np.log1p(-min(self.fit.gained, 1.0 - 1e-9))

    @cached_property
    def price(self) -> float:
        """Price of Hannan and Quinn (1979) a parameter, and that of BIC once an effect.

        Whether an effect is there was tested; among effects with different numbers of parameters the milder
        price of the former decides, since their shapes are fitted within narrow physical ranges. An effect
        that one meets elsewhere pays for its odd place. What acts for a while, or happened once, pays for the
        samples at which it begins and ends, each chosen among all.
        """
        n = self.n_samples
        price = 2 * np.log(np.log(n)) * self.n_parameters + np.log(n) * len(self.effects)
        price += ODD * sum(effect.odd for effect in self.effects)
        ends = sum(int(np.isfinite(e.during).sum()) + e.effect.n_instants for e in self.effects)
        return price + 2 * np.log(n) * (ends - self.given)


def odd(candidate: Candidate) -> bool:
    """Tell whether an effect of a set is met elsewhere, not at such a place."""
    return any(effect.odd for effect in candidate.effects)


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
) -> list[Candidate]:
    """Fit each leader together with everything that is in the model already; best first, each place once.

    All get a few iterations, the better ones more, the best (or the ``finished`` best) are taken to
    convergence. Where nothing is in the model yet, ``twins`` start from the simulator's own parameter values
    too: what the refit made of them without the effect may lie in another valley. Where the best came to
    quite other values of them than the next, these are tried from there as well. All begin from the fits
    ``elsewhere`` too. Those ``known``, fitted before under another noise, go on from there; of them the best
    are no less leaders.
    """
    before = {c.effects[-1].place: c.fit.model for c in reversed(known)}
    within = min((c.criterion for c in known), default=0.0) + IN_REACH
    ahead = (c.effects[-1].place for c in known if c.criterion < within)
    places = dict.fromkeys([*(effect.place for effect in placed), *ahead])
    models = [before[place] for place in places if place in before]
    for start in (base, *elsewhere):
        run = problem.run(start.model)
        models += Parallel(n_jobs=n_jobs, prefer="threads")(
            delayed(entered)(problem, start, run, effect) for effect in placed if effect.place not in before
        )
    twins = 0 if base.model.effects or before else twins
    found, left_behind = _in_rounds(problem, base, models, n_jobs, twins=twins, finished=finished)
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


def _in_reach(candidate: Candidate, best: Candidate, base: Fit) -> bool:
    """Tell whether a candidate leaves little more than the best."""
    near = candidate.criterion < best.criterion + IN_REACH
    return near or candidate.fit.cost - best.fit.cost < FORM * (base.cost - best.fit.cost)


def _may_catch_up(candidate: Candidate, best: Candidate, base: Fit, iterations: int) -> bool:
    """Tell whether a candidate takes off half as much as the best, or would be near it at twice its pace."""
    half_way = np.sqrt(base.cost * best.fit.cost)  # of the logarithm of the cost
    ahead = candidate.criterion - PACE * iterations * candidate.pace < best.criterion + IN_REACH
    return candidate.fit.cost < half_way or ahead or _in_reach(candidate, best, base)


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
    return sorted((c for c in found if np.isfinite(c.fit.cost)), key=lambda c: c.criterion)


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
        models = models + Parallel(n_jobs=n_jobs, prefer="threads")(
            delayed(entered)(problem, base, run, *pair.effects(bank)) for pair in some
        )
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
        if not (_in_reach(candidate, found[0], base) and candidate.effects[-1].effect.valleys):
            return candidate
        return Candidate(other_valleys(problem, candidate.fit), candidate.n_samples)

    return Parallel(n_jobs=n_jobs, prefer="threads")(delayed(settled)(c) for c in found)


def once_each(candidates: list[Candidate]) -> list[Candidate]:
    """Return the first candidate with each set of effects."""
    first: dict[frozenset, Candidate] = {}
    for candidate in candidates:
        first.setdefault(frozenset(candidate.places), candidate)
    return list(first.values())


def search(
    problem: Problem,
    base: Fit,
    make_hypotheses,
    *,
    alpha: float,
    max_effects: int,
    n_leaders: int,
    random_state=None,
    n_jobs=None,
    dominated: bool = False,
    known: Sequence[Candidate] = (),
) -> list[Step]:
    """Add effects one after another while the test finds something left; return the steps taken.

    The best few sets of each depth are carried on, since one effect can mask another, and every set found is
    tried without each of its older members. Where something is left, but nothing that is added to the best
    set takes it, the next best is built on, and the best without each of its older members (a floating
    search: Pudil, Novovicova and Kittler 1994). Two effects enter at once where they promise what neither
    does. Beside another effect, before or after it, none is named at a place where one does not meet it.
    ``known`` are single effects and pairs that were fitted before.
    """
    beam = [Candidate(base, problem.n_seen)]
    steps: list[Step] = []
    for _ in range(max_effects + 1):
        pool: list[Candidate] = []
        for rank, candidate in enumerate(beam):
            hypotheses = [
                h._replace(asked=h.asked and not (h.placed.odd and candidate.effects))
                for h in make_hypotheses(candidate.fit)
                if h.placed.place not in candidate.places
            ]
            bank = make_bank(problem, candidate.fit, hypotheses, n_jobs)
            detection = probe(problem, candidate.fit, bank, random_state)
            bank = bank.without_columns()
            if dominated and not candidate.effects:
                detection = _left_to_the_fits(detection)
            full = len(candidate.effects) >= max_effects
            silent = rank == 0 and detection.p_value > alpha
            placed = [] if full or silent else leaders(bank, n_leaders, detection, alpha)
            before = () if candidate.effects else known
            alone = [c for c in before if len(c.effects) == 1]
            found = refit_leaders(problem, candidate.fit, placed, n_jobs, known=alone)
            if placed and len(candidate.effects) + 2 <= max_effects:
                both = [c for c in before if len(c.effects) == 2]
                found += refit_pairs(problem, candidate.fit, bank, found, n_leaders, n_jobs, known=both)
            found = sorted((c for c in found if c.criterion < candidate.criterion), key=lambda c: c.criterion)
            first = not pool  # and must be more than noise, as must what goes with a drift of a sensor
            if first or any(is_of_a_sensor(effect) for effect in candidate.effects):
                detection, found = _confirmed(
                    problem, candidate, found, detection, bank, alpha, n_jobs, random_state
                )
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
            pool += without_each(problem, pool[0])
            pool.sort(key=lambda c: c.criterion)
        if not pool or pool[0].criterion >= beam[0].criterion:
            break
        beam = [c for c in pool if not odd(c)][:BEAM]
        if not beam:
            break
    return steps


def _left_to_the_fits(detection: Detection) -> Detection:
    """Return a detection that leaves the decision to the fits: tangents tell little of what dominates."""
    return detection._replace(p_value=0.0, p_bank=0.0, p_line=0.0, p_scan=0.0)


def _confirmed(
    problem: Problem,
    base: Candidate,
    found: list[Candidate],
    detection: Detection,
    bank: Bank,
    alpha: float,
    n_jobs,
    random_state=None,
) -> tuple[Detection, list[Candidate]]:
    """Return the detection with the chance that what was found is noise of some colour, and what was found.

    Of what the criterion cannot tell from the best, the least chance counts. Where all of it may be noise,
    the next best are asked: the noise so far may owe its colour to what two effects left, and one that
    stands under any colour then stands for what is before it. An odd place has its price. Where only a drift
    or an offset of an output stands, with drifting noise not against it, nothing else is found; a drift that
    fits no better than an offset is held against what an offset is.
    """
    if not found:
        return detection, found
    n_near = sum(c.criterion <= found[0].criterion + HARDLY for c in found[:CONFIRMED])
    offsets = {e.port for c in found[:n_near] for e in _added(c, base) if e.effect.code == OFFSET}
    asked = found[:n_near]

    def chances_of(some: list[Candidate]) -> list[float]:
        return chances(problem, base, some, offsets, bank, n_jobs, alpha, random_state)

    likely = chances_of(asked)
    if min(likely) > alpha:
        asked = found[: n_near + CONFIRMED]
        likely += chances_of(asked[n_near:])
        if min(likely) <= alpha:
            found = [c for k, c in enumerate(found) if k >= len(asked) or likely[k] <= alpha]
    standing = [c for c, chance in zip(asked, likely, strict=True) if chance <= alpha]
    if standing and all(is_slow(effect) for c in standing for effect in _added(c, base)):
        found = standing
    return detection._replace(p_value=max(detection.p_value, min(likely))), found


def _added(candidate: Candidate, base: Candidate) -> tuple[PlacedEffect, ...]:
    """Return what a candidate has beyond a set that it holds."""
    return tuple(effect for effect in candidate.effects if effect.place not in base.places)


def chances(
    problem: Problem,
    base: Candidate,
    some: list[Candidate],
    offsets: set[Port],
    bank: Bank,
    n_jobs,
    alpha: float,
    random_state=None,
) -> list[float]:
    """Return the chance that what each candidate adds is noise of some colour.

    That an output is slowly off is asked of all that was tried. That it is no drift of the noise, which began
    at nothing, is then asked of the few ways of being so alone. What seems to be no chance at a level
    ``alpha`` is held against what is gained by chance where noise drifts.
    """
    noises = [
        sorted({kind for e in _added(c, base) for kind in noises_against(e, e.port in offsets)}) for c in some
    ]
    against = sorted({kind for kinds in noises for kind in kinds})
    asked = [(base, kind) for kind in against]
    asked += [(c, kind) for c, kinds in zip(some, noises, strict=True) for kind in kinds]
    deviances = iter(
        Parallel(n_jobs=n_jobs, prefer="threads")(
            delayed(deviance)(problem, c.fit.model, may_drift=kind) for c, kind in asked
        )
    )
    without = {kind: next(deviances) for kind in against}
    n_directions = bank.n_directions
    found = []
    for candidate, kinds in zip(some, noises, strict=True):
        added = _added(candidate, base)
        price = ODD * sum(effect.odd for effect in added)
        gained = {kind: without[kind] - next(deviances) - price for kind in kinds}
        n_felt = max(candidate.n_parameters - base.n_parameters, 1)
        no_drift = 0.0
        if len(kinds) > 1 and all(is_of_a_sensor(effect) for effect in added):
            no_drift = chance_of_noise(gained.pop(True), LEVELS, 1, n_felt)
        least = min(gained.values())
        chance = _chance(least, added, n_felt, problem, bank, n_directions)
        if chance <= alpha and True in gained:
            models = base.fit.model, candidate.fit.model
            least = as_if_white(problem, *models, least, n_felt, random_state)
            chance = _chance(least, added, n_felt, problem, bank, n_directions)
        found.append(max(no_drift, chance))
    return found


def _chance(
    gained: float,
    effects: tuple[PlacedEffect, ...],
    n_felt: int,
    problem: Problem,
    bank: Bank,
    n_directions: float,
) -> float:
    """Return the chance that noise gains as much, the less of two bounds.

    One counts hypotheses, or sets of so many, and the shapes of an effect that the samples can tell apart.
    The other counts the independent directions of the bank's columns, with as many degrees of freedom as
    parameters are felt; it holds for one effect, and where the columns did not look at the residual.
    """
    n_values, blind = 1.0, True
    for effect in effects:
        own = [h for h in bank.hypotheses if h.placed.place == effect.place]
        n_values *= max([n_shapes(effect, problem), *(np.max(h.tried) for h in own)])
        blind &= bool(own) and not any(h.tuned.any() for h in own)
    n_sets = comb(max(len(bank.hypotheses), len(effects)), len(effects))
    by_values = chance_of_noise(gained, n_sets, n_values, len(effects))
    if len(effects) > 1 or not blind:
        return by_values
    return min(by_values, chance_of_noise(gained, n_directions, 1, n_felt))


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


def without_each(problem: Problem, candidate: Candidate) -> list[Candidate]:
    """Return the set fitted without each of its members but the last."""
    return [_without(problem, candidate, [effect]) for effect in candidate.effects[:-1]]


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
        return min([_without(problem, candidate, left_out).fit.cost, *known])

    namesakes: dict[str, list[PlacedEffect]] = {}
    for effect in effects:
        namesakes.setdefault(effect.effect.code, []).append(effect)
    together = {code: cost(members) for code, members in namesakes.items()}

    def left(i: int) -> tuple[float, float]:
        code = effects[i].effect.code
        return together[code], cost([effects[i]]) if len(namesakes[code]) > 1 else 0.0

    return tuple(sorted(range(len(effects)), key=left, reverse=True))


def _without(problem: Problem, candidate: Candidate, left_out: list[PlacedEffect]) -> Candidate:
    places = {effect.place for effect in left_out}
    effects = tuple(e for e in candidate.effects if e.place not in places)
    reduced = fit(problem, candidate.fit.model._replace(effects=effects), iterations=FINE)
    return Candidate(reduced, candidate.n_samples)

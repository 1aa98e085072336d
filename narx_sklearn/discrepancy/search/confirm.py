"""Could it all be noise? The likelihood of noise of its own colour, with and without an effect."""

from collections.abc import Set
from functools import cache, partial
from math import comb
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from scipy.stats import chi2

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.bank import Bank
from narx_sklearn.discrepancy.search.by_chance import gained_by_chance
from narx_sklearn.discrepancy.search.candidate import HARDLY, ODD, Candidate
from narx_sklearn.discrepancy.search.detect import Detection
from narx_sklearn.discrepancy.search.lookalikes import CERTAIN, likeliest
from narx_sklearn.discrepancy.search.restricted import Contrasts, OwnNoise, own_noise
from narx_sklearn.discrepancy.settings import Settings

DRIFT, OFFSET, LOAD = "additive_drift", "sensor_bias", "constant_load"
DRIFTS = {DRIFT, "gain_drift"}  # of any slow course: they may stand in for what acts for a while, or wanders
LEVELS = 2  # ways in which an output may be slowly off: from the first sample on, or as time goes
CONFIRMED = 4  # of the best candidates that may each show that it is not noise
DOUBTFUL = 0.05  # chance of being noise, up to which an explanation stays beside a drift that is one too
CLEARER = 10.0  # difference of the deviance that makes a noise clearly the likelier


def chance_of_noise(gained: float, n_tried: float, n_values: float, n_felt: int = 1) -> float:
    """Return the p-value of an effect when each side may call what it leaves noise of its colour.

    Slow noise (a drift) looks like slow effects. Without the effect the noise model takes up what it can;
    the difference of the deviances is then chi-squared, and the best of all that was tried pays for their
    number (Bonferroni).

    Parameters
    ----------
    gained : float
        What the effect takes off the deviance.
    n_tried : float
        Hypotheses of which the effect is the best.
    n_values : float
        Shapes of the effect of which its own is the best.
    n_felt : int, default=1
        Degrees of freedom: parameters of the effect that were fitted and are felt.
    """
    log_tried = np.log(n_tried) + np.log(n_values)
    return float(np.exp(min(0.0, log_tried + chi2.logsf(max(gained, 0.0), n_felt))))


def n_shapes(effect: PlacedEffect, problem: Problem) -> float:
    """Return how many shapes of an effect the samples can tell apart.

    Of each fitted parameter but its size n samples tell about the square root of n values.
    """
    n_fitted = effect.n_values + (effect.effect.begin is not None)
    return problem.n_seen ** (0.5 * (n_fitted - 1))


def noises_against(effect: PlacedEffect, as_offset: bool = False, adds_up: bool = False) -> tuple[bool, ...]:
    """Return whether noise may drift, of each kind of noise to which an effect must be preferred.

    Noise that drifts is as good as a drift of an output, which is held against noise that does not. An offset
    is held against both: a sensor is off from the first sample on, where a drift has yet to come. So is what
    is no better than one (``as_offset``). Of what an integrator ``adds_up``, noise that drifts is what all
    small errors come to, not the sensor's: there a drift of the sensor is an effect as any other.
    """
    if adds_up or not is_of_a_sensor(effect):
        return (True,)
    return (False, True) if as_offset or effect.effect.code == OFFSET else (False,)


def is_slow(effect: PlacedEffect) -> bool:
    """Tell whether an effect is a drift of an output, an offset or a load, as slow as noise may be."""
    return is_of_a_sensor(effect) or effect.effect.code in (OFFSET, LOAD)


def is_drift(effect: PlacedEffect) -> bool:
    """Tell whether an effect is a drift of an output."""
    return effect.port.kind == "output" and effect.effect.code == DRIFT


def is_all_drift(candidate: Candidate) -> bool:
    """Tell whether a set is drifts of outputs alone, which may have gone somewhere before the record."""
    drifting = {effect.port for effect in candidate.effects if is_drift(effect)}
    return all(is_of_a_sensor(effect) and effect.port in drifting for effect in candidate.effects)


def is_of_a_sensor(effect: PlacedEffect) -> bool:
    """Tell whether an effect is a drift or an offset of an output, which noise of that output may be."""
    return is_drift(effect) or (effect.port.kind == "output" and effect.effect.code == OFFSET)


def deviance(problem: Problem, model: Model, *, may_drift: bool = True) -> float:
    """Return minus twice the restricted log-likelihood under noise of its own colour, the colour priced."""
    return own_noise(problem, model, may_drift=may_drift).deviance


def priced(problem: Problem, candidate: Candidate) -> float:
    """Return minus twice the log-likelihood of a set under the noise that it leaves, and its price."""
    return deviance(problem, candidate.fit.model) + candidate.price


class Trial(NamedTuple):
    """What candidates are held against: a set of effects that all of them have, and all that was tried."""

    problem: Problem
    base: Candidate
    bank: Bank
    n_jobs: int | None = None
    random_state: int | None = None

    def added(self, candidate: Candidate) -> tuple[PlacedEffect, ...]:
        """Return what a candidate has beyond the base."""
        return tuple(effect for effect in candidate.effects if effect.place not in self.base.places)


class Beside(NamedTuple):
    """A set of effects as it is held against a larger one: linear about its fit, and the noise it leaves."""

    contrasts: Contrasts
    own: OwnNoise

    @classmethod
    def of(cls, problem: Problem, candidate: Candidate) -> "Beside":
        """Linearise a set in what is felt of its parameters, and find the noise that it leaves."""
        contrasts = Contrasts.of(problem, candidate.fit.model, candidate.felt)
        return cls(contrasts, own_noise(problem, candidate.fit.model, contrasts=contrasts))


def as_if_white(
    problem: Problem, base: Beside, candidate: Candidate, gained: float, random_state=None
) -> float:
    """Return what a set would gain as rarely over its base if the noise beside the base did not drift.

    What the data do not feel of its parameters counts for nothing.

    Parameters
    ----------
    gained : float
        What it takes off the deviance.
    """
    noise = base.own.noise
    if not any(noise.average):
        return gained
    more = Beside.of(problem, candidate)
    gained = min(gained, base.own.deviance - more.own.deviance)
    return gained_by_chance(base.contrasts, more.contrasts, noise, random_state).as_if_white(gained)


def clearer_noise(problem: Problem, found: Fit) -> Noise | None:
    """Return the noise that a fitted model leaves, if it is much likelier than the problem's own.

    Noise is first estimated from what tangents or a single effect leave. What they miss colours it, and
    coloured noise then hides what it was coloured by.
    """
    contrasts = Contrasts.of(problem, found.model)
    own, given = own_noise(problem, found.model, contrasts=contrasts), contrasts.under(problem.noise)
    return own.noise if own.deviance < given.deviance - CLEARER else None


def confirmed(
    trial: Trial, found: list[Candidate], detection: Detection, alpha: float
) -> tuple[Detection, list[Candidate]]:
    """Return the detection with the chance that what was found is noise of some colour, and what was found.

    Of what the criterion cannot tell from the best, the least chance counts. Where all of it may be noise,
    the next best are asked: the noise so far may owe its colour to what two effects left, and one that
    stands under any colour then stands for what is before it. An odd place has its price. Where only a drift
    or an offset of an output stands, with drifting noise not against it, nothing else is found but what is
    hardly noise, however much better it fits than a drift of this form does; a drift that fits no better
    than an offset is held against what an offset is.
    """
    if not found:
        return detection, found
    n_near = sum(c.criterion <= found[0].criterion + HARDLY for c in found[:CONFIRMED])
    offsets = {e.port for c in found[:n_near] for e in trial.added(c) if e.effect.code == OFFSET}
    asked = found[:n_near]
    likely = chances(trial, asked, offsets)
    if min(likely) > alpha:
        asked = found[: n_near + CONFIRMED]
        likely += chances(trial, asked[n_near:], offsets)
        if min(likely) <= alpha:
            found = [c for k, c in enumerate(found) if k >= len(asked) or likely[k] <= alpha]
    standing = [c for c, chance in zip(asked, likely, strict=True) if chance <= alpha]
    if standing and all(is_slow(effect) for c in standing for effect in trial.added(c)):
        found = [c for c, chance in zip(asked, likely, strict=True) if chance <= max(alpha, DOUBTFUL)]
    return detection._replace(p_value=max(detection.p_value, min(likely))), found


def chances(trial: Trial, some: list[Candidate], offsets: Set[Port] = frozenset()) -> list[float]:
    """Return the chance that what each candidate adds is noise of some colour.

    That an output is slowly off is asked of all that was tried. That it is no drift of the noise, which began
    at nothing, is then asked of the few ways of being so alone. What seems hardly noise is held against what
    is gained by chance where noise drifts.
    """
    problem, base = trial.problem, trial.base
    added_up = {Port("output", o) for o, adds_up in enumerate(problem.adds_up) if adds_up}
    noises = [
        sorted({k for e in trial.added(c) for k in noises_against(e, e.port in offsets, e.port in added_up)})
        for c in some
    ]
    against = sorted({kind for kinds in noises for kind in kinds})
    asked = [(base, kind) for kind in against]
    asked += [(c, kind) for c, kinds in zip(some, noises, strict=True) for kind in kinds]
    deviances = iter(
        Parallel(n_jobs=trial.n_jobs, prefer="threads")(
            delayed(deviance)(problem, c.fit.model, may_drift=kind) for c, kind in asked
        )
    )
    without = {kind: next(deviances) for kind in against}
    beside = cache(partial(Beside.of, problem, base))  # once, where anything asks for it
    found = []
    for candidate, kinds in zip(some, noises, strict=True):
        added = trial.added(candidate)
        price = ODD * sum(effect.odd for effect in added)
        gained = {kind: without[kind] - next(deviances) - price for kind in kinds}
        n_felt = max(candidate.n_parameters - base.n_parameters, 1)
        no_drift = 0.0
        if len(kinds) > 1 and all(is_of_a_sensor(effect) for effect in added):
            no_drift = chance_of_noise(gained.pop(True), LEVELS, 1, n_felt)
        least = min(gained.values())
        chance = _chance(trial, least, added, n_felt)
        if chance <= DOUBTFUL and True in gained:
            least = as_if_white(problem, beside(), candidate, least + price, trial.random_state) - price
            chance = _chance(trial, least, added, n_felt)
        found.append(max(no_drift, chance))
    return found


def _chance(trial: Trial, gained: float, effects: tuple[PlacedEffect, ...], n_felt: int) -> float:
    """Return the chance that noise gains as much, the less of two bounds.

    One counts hypotheses, or sets of so many, and the shapes of an effect that the samples can tell apart.
    The other counts the independent directions of the bank's columns, with as many degrees of freedom as
    parameters are felt; it holds for one effect, and where the columns did not look at the residual.
    """
    n_values, blind = 1.0, True
    for effect in effects:
        own = [h for h in trial.bank.hypotheses if h.placed.place == effect.place]
        n_values *= max([n_shapes(effect, trial.problem), *(np.max(h.tried) for h in own)])
        blind &= bool(own) and not any(h.tuned.any() for h in own)
    n_sets = comb(max(len(trial.bank.hypotheses), len(effects)), len(effects))
    by_values = chance_of_noise(gained, n_sets, n_values, len(effects))
    if len(effects) > 1 or not blind:
        return by_values
    return min(by_values, chance_of_noise(gained, trial.bank.n_directions, 1, n_felt))


def more_than_drift(
    problem: Problem, refitted: Fit, best: Candidate, pool: list[Candidate], bank: Bank, settings: Settings
) -> Candidate:
    """Return the likeliest set that is no noise, where noise that drifts may be nearly as likely as the best.

    A search that found a drift goes on from there, and comes to sets which nobody held against noise that
    drifts: without the drift, or with another name in its place. Nor against a drift that had gone somewhere
    when the record began, as it had unless it began with it. What goes with a drift must stand where noise
    that drifts takes the place of it too: what the drift's form leaves of one is not white.
    """
    drift = min((c.criterion for c in pool if is_all_drift(c)), default=np.inf)
    while not is_all_drift(best) and drift <= best.criterion + CERTAIN:
        drifts, more = _beside_drifts(problem, refitted, best, settings)
        trial = Trial(problem, drifts, bank, settings.n_jobs, settings.random_state)
        (chance,) = chances(trial, [more])
        if chance <= settings.alpha and _stands_without_drift(trial, refitted, best, settings):
            return best
        pool = [*(c for c in pool if c.places != best.places), *([drifts] if drifts.effects else [])]
        best = likeliest(pool, refitted.cost)
    return best


def _stands_without_drift(trial: Trial, refitted: Fit, best: Candidate, settings: Settings) -> bool:
    """Tell whether what goes with a drift is no noise where noise that drifts stands for the drift."""
    rest = tuple(effect for effect in best.effects if not is_of_a_sensor(effect))
    if not any(is_drift(effect) for effect in best.effects):
        return True
    drifting = trial.problem.with_noise(own_noise(trial.problem, refitted.model).noise)
    base, more = (
        Candidate(fit(drifting, model, n_jobs=settings.n_jobs), best.n_samples)
        for model in (refitted.model, best.fit.model._replace(effects=rest))
    )
    (chance,) = chances(trial._replace(problem=drifting, base=base), [more])
    return chance <= settings.alpha


def _beside_drifts(
    problem: Problem, refitted: Fit, candidate: Candidate, settings: Settings
) -> tuple[Candidate, Candidate]:
    """Return the drifts of outputs in a set and the set, both with what each drift had come to before."""
    drifting = {effect.port for effect in candidate.effects if is_drift(effect)}
    if not drifting:
        return Candidate(refitted, candidate.n_samples), candidate
    off = {effect.port for effect in candidate.effects if effect.effect.code == OFFSET}
    asked = [effect for effect in settings.effects if effect.code == OFFSET]
    before = tuple(PlacedEffect(e, port, theta=(0.0,)) for e in asked for port in sorted(drifting - off))

    def fitted(effects: tuple[PlacedEffect, ...]) -> Candidate:
        model = candidate.fit.model._replace(effects=effects)
        return Candidate(fit(problem, model, n_jobs=settings.n_jobs), candidate.n_samples)

    more = fitted((*candidate.effects, *before)) if before else candidate
    of_drifts = tuple(e for e in more.effects if is_of_a_sensor(e) and e.port in drifting)
    return fitted(of_drifts), more

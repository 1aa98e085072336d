"""A set of effects in plain numbers: counted from zero, amplitudes positive, each limit worth its level."""

from dataclasses import replace

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.search.candidate import Candidate, converged


def counted_from_zero(problem: Problem, best: Candidate) -> Candidate:
    """Return a set whose references are zero, all or each, where the simulator's own parameters do the rest.

    A gain that depends on the state, counted from elsewhere, is another gain of the simulator's, and the two
    references of a product are told by their product alone: where both are near zero, by next to nothing.
    """
    places = [
        (i, k)
        for i, effect in enumerate(best.effects)
        for k in effect.effect.references
        if np.ptp(effect.bounds[k]) > 0
    ]
    for some in [places] + [[place] for place in places] * (len(places) > 1):
        free = {place for place in some if np.ptp(best.effects[place[0]].bounds[place[1]]) > 0}
        if not free:
            continue
        zero = _with_zeros(problem, best, free)
        if _do_not_pay(zero, best, len(free)):
            best = zero
    return best


def without_spare(problem: Problem, best: Candidate) -> Candidate:
    """Return a set without the spare parameters of its last effect that do not pay for themselves.

    That which is missed least goes first: what it did another may do.
    """
    last = len(best.effects) - 1
    spare = set(best.effects[last].effect.spare)
    while spare:
        fewer = {k: _with_zeros(problem, best, {(last, k)}) for k in spare}
        k = min(fewer, key=lambda k: fewer[k].fit.cost)
        if not _do_not_pay(fewer[k], best, 1):
            break
        best = fewer[k]
        spare.remove(k)
    return best


def _do_not_pay(zero: Candidate, best: Candidate, n_zeros: int) -> bool:
    """Tell whether so many parameters, that are at zero in one of two sets, do not pay for themselves."""
    worse = (zero.criterion - zero.price) - (best.criterion - best.price)
    return worse < 2.0 * np.log(np.log(best.n_samples)) * n_zeros


def with_positive_amplitudes(problem: Problem, best: Candidate) -> Candidate:
    """Return a set whose ripples and lines have positive amplitudes, phases within half a turn of zero."""
    effects = tuple(effect.with_positive_amplitude() for effect in best.effects)
    if effects == best.effects:
        return best
    return Candidate(fit(problem, best.fit.model._replace(effects=effects), iterations=0), best.n_samples)


def _with_zeros(problem: Problem, candidate: Candidate, places: set[tuple[int, int]]) -> Candidate:
    effects = tuple(
        effect.with_zeros([k for j, k in places if j == i]) for i, effect in enumerate(candidate.effects)
    )
    model = candidate.fit.model._replace(effects=effects)
    return converged(problem, Candidate(fit(problem, model), candidate.n_samples))


def with_limits_that_pay(problem: Problem, best: Candidate) -> Candidate:
    """Return a set whose saturations and clips have a second limit only where it pays for its level.

    A level is chosen among all samples, and where some were met once, noise makes them seem to stand at it.
    """
    for i, placed in enumerate(best.effects):
        if not placed.effect.levels or placed.port.kind == "state":
            continue
        signals = problem.u if placed.port.kind == "input" else problem.y
        signal = signals[problem.rows[problem.inside], placed.port.index]
        lowest, highest = np.nanmin(signal), np.nanmax(signal)
        low, high = placed.effect.levels
        if placed.theta[low] <= lowest or placed.theta[high] >= highest:
            continue  # one of them is out of reach already
        reach = 2 * (highest - lowest)
        away = ((low, lowest - reach), (high, highest + reach))
        others = [_with_value(problem, best, i, k, value) for k, value in away]
        other = min(others, key=lambda c: c.fit.cost)
        unit = best.fit.cost / best.n_samples
        if other.fit.cost - best.fit.cost < 2 * np.log(best.n_samples) * unit:
            best = other
    return best


def _with_value(problem: Problem, candidate: Candidate, i: int, k: int, value: float) -> Candidate:
    """Return a set fitted again from where a parameter of one of its effects has a value."""
    effects = list(candidate.effects)
    theta, limits = np.array(effects[i].theta), effects[i].bounds
    theta[k], limits[k] = value, (min(limits[k, 0], value), max(limits[k, 1], value))
    effects[i] = replace(effects[i], limits=tuple(map(tuple, limits.tolist()))).at(theta)
    model = candidate.fit.model._replace(effects=tuple(effects))
    return converged(problem, Candidate(fit(problem, model), candidate.n_samples))

"""A set of effects in plain numbers: counted from zero where that does as well, amplitudes positive."""

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.stages.coloured_search import converged


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
        worse = (zero.criterion - zero.price) - (best.criterion - best.price)
        if worse < 2.0 * np.log(np.log(best.n_samples)) * len(free):
            best = zero
    return best


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

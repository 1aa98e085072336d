"""What an output is off by at first and then no more: one thing, not an offset that a drift takes away."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.candidate import HARDLY, Candidate, converged
from narx_sklearn.discrepancy.search.confirm import is_drift, is_slow
from narx_sklearn.discrepancy.search.lookalikes import CERTAIN
from narx_sklearn.physics.effects import Effect, EffectParameter
from narx_sklearn.physics.effects._drift import warmed_along
from narx_sklearn.physics.effects._series import time_since

KEPT = 0.5  # share of what it is off by at first that an output may keep until the end, to be said to lose it
BENDS = (2, 3)  # parameters of what fades that are zero where it does so as an exponential


def faded(time: np.ndarray, theta: Sequence[float]) -> np.ndarray:
    """Return by how much an output is off at some times since it began."""
    size, T, b, c = theta
    q = warmed_along(time, T)
    return size * (1.0 - q) * (1.0 + q * (b + q * c))


def _transform(signal, second, dt, theta, first):
    return signal + faded(time_since(first, signal.size, dt), theta)


def fading(drift: PlacedEffect, size: float, T: float) -> PlacedEffect:
    """Return a drift of an output that begins off by a size and fades away, at first as an exponential.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.placed import PlacedEffect, Port
    >>> from narx_sklearn.discrepancy.stages.fading import fading
    >>> from narx_sklearn.physics.effects import CATALOGUE
    >>> drift = PlacedEffect(CATALOGUE["additive_drift"], Port("output", 0), theta=(-4.0, 2.0, 0.0, 0.0))
    >>> placed = fading(drift, size=4.0, T=2.0)
    >>> placed.place == drift.place
    True
    >>> placed.effect.transform(np.ones(3), None, 2.0, np.array(placed.theta), [0]).round(3).tolist()
    [5.0, 2.472, 1.541]
    """
    given: Effect = drift.effect
    effect = replace(
        given,
        title="Additive drift that fades away",
        sentence="It is off at first, and comes back by itself, whatever the input does.",
        equation="a (1 - q) (1 + b q + c q^2), added; q = 1 - exp(-t/T); where b = c = 0 that is a exp(-t/T)",
        parameters=tuple(EffectParameter(p.name, p.unit, p.lower, p.upper) for p in given.parameters),
        force=None,
        transform=_transform,
    )
    return replace(drift, effect=effect, limits=()).at((size, T, 0.0, 0.0)).with_zeros(BENDS)


def with_what_fades(
    problem: Problem, best: Candidate, pool: list[Candidate], n_jobs: int | None = None
) -> Candidate:
    """Return a set with one drift that fades away for two members that do that together, if it is as likely.

    A drift begins at nothing, and what an output was off by before is another member then: an offset, or a
    load that comes to the same. Where the drift only takes that away again, both together have more
    parameters than what they do, and two names where one thing happened. What else may stand beside it joins
    the ``pool`` in the same form.
    """
    for two in _cancelling(best):
        plainer = _plainer(problem, best, two, n_jobs)
        if plainer is None or plainer.criterion > best.criterion + HARDLY:
            continue
        places = {effect.place for effect in two}
        for other in [c for c in pool if places < c.places and len(c.effects) == len(best.effects)]:
            if other.places != best.places and other.criterion <= best.criterion + CERTAIN:
                found = _plainer(problem, other, two, n_jobs)
                pool += [found] if found is not None else []
        return plainer
    return best


def _cancelling(candidate: Candidate) -> Iterator[tuple[PlacedEffect, PlacedEffect]]:
    """Yield each drift of an output with what is slow beside it and drifts nowhere itself."""
    lasting = [effect for effect in candidate.effects if not effect.passes]
    for drift in lasting:
        if is_drift(drift):
            yield from ((drift, other) for other in lasting if is_slow(other) and not is_drift(other))


def _plainer(
    problem: Problem, candidate: Candidate, two: tuple[PlacedEffect, PlacedEffect], n_jobs: int | None
) -> Candidate | None:
    """Return a set with one drift that fades for two members, as an exponential if that is as likely.

    None where it does not lose most of what it began with.
    """
    drift = next(effect for effect in candidate.effects if effect.place == two[0].place)
    kept = tuple(e for e in candidate.effects if e.place not in {effect.place for effect in two})
    windows = problem.windows
    whole = problem.simulator.dt * float(np.max(windows.last - windows.began))
    ends = drift.effect.transform(np.zeros(2), None, whole, np.array(drift.theta), [0])[-1]
    begun = fading(drift, -float(ends), min(drift.theta[1], whole))
    model = candidate.fit.model._replace(effects=(*kept, begun))
    plain = converged(problem, Candidate(fit(problem, model, n_jobs=n_jobs), candidate.n_samples), n_jobs)
    bent = tuple(replace(e, limits=()) if e.place == begun.place else e for e in plain.effects)
    bent_fit = fit(problem, plain.fit.model._replace(effects=bent), n_jobs=n_jobs)
    shaped = converged(problem, Candidate(bent_fit, candidate.n_samples), n_jobs)
    found = plain if plain.criterion <= shaped.criterion + HARDLY else shaped
    theta = next(e.theta for e in found.effects if e.place == begun.place)
    first, last = np.abs(faded(np.array([0.0, whole]), theta))
    return found if last < KEPT * first else None

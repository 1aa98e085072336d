"""What swings by itself, and not as a sine: one disturbance with its harmonics, not a sine for each."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.candidate import HARDLY, Candidate, converged
from narx_sklearn.discrepancy.search.confirm import chance_of_noise, deviance
from narx_sklearn.discrepancy.search.lookalikes import likeliest, unpaid
from narx_sklearn.physics.effects import Effect, EffectParameter
from narx_sklearn.physics.effects._kernel import kernel
from narx_sklearn.physics.effects._series import time_since

SINE = "periodic_disturbance"
MOST = 6  # harmonics, the first among them
IN_VAIN = (
    2  # harmonics on end that say nothing, after which no higher one is asked: a square wave has no even ones
)
LINE = 0.5  # of the width of a line in a record's spectrum, by which a harmonic's frequency may differ


@kernel
def _force(argument, rate, own, second, time, step, z, theta, dz):
    """Return a sine and its harmonics; there are as many as parameters, those beyond are zero."""
    total = np.sin(theta[1] * time + theta[2])
    for n in range(2, min(MOST, (theta.size - 1) // 2) + 1):
        phase = n * theta[1] * time + theta[2]
        total += theta[2 * n - 1] * np.sin(phase) + theta[2 * n] * np.cos(phase)
    return theta[0] * total


def course(time: np.ndarray, theta) -> np.ndarray:
    """Return a sine and its harmonics at some times: A, w, p, then r and q of each.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.search.harmonics import course
    >>> course(np.array([0.0, 0.25]), (2.0, 2 * np.pi, 0.0, 0.0, 0.5)).round(9).tolist()
    [1.0, 1.0]
    """
    size, w, p, *others = theta
    total = np.sin(w * time + p)
    for n, (r, q) in enumerate(zip(others[::2], others[1::2], strict=True), start=2):
        total = total + r * np.sin(n * w * time + p) + q * np.cos(n * w * time + p)
    return size * total


def _transform(signal, second, dt, theta, first):
    return signal + course(time_since(first, signal.size, dt), theta)


def n_harmonics(course_of: PlacedEffect) -> int:
    """Return how many harmonics a periodic disturbance has, the first among them."""
    return len(course_of.effect.parameters) // 2


def with_harmonics(sine: PlacedEffect, most: int, ratios=()) -> PlacedEffect:
    """Return a periodic disturbance with its harmonics up to one of no more than MOST.

    Parameters
    ----------
    ratios : sequence of float
        r and q of each harmonic from the second on, by which it begins; those that are not given are zero.

    Examples
    --------
    >>> from narx_sklearn.discrepancy.placed import PlacedEffect, Port
    >>> from narx_sklearn.discrepancy.search.harmonics import with_harmonics
    >>> from narx_sklearn.physics.effects import CATALOGUE
    >>> hum = PlacedEffect(CATALOGUE["periodic_disturbance"], Port("output", 0), theta=(0.1, 314.0, 0.2))
    >>> placed = with_harmonics(hum, 3)
    >>> placed.place == hum.place, placed.theta
    (True, (0.1, 314.0, 0.2, 0.0, 0.0, 0.0, 0.0))
    >>> [p.name for p in placed.effect.parameters]
    ['A', 'w', 'p', 'r2', 'q2', 'r3', 'q3']
    """
    given: Effect = sine.effect
    orders = range(2, most + 1)
    sums = " + ".join(f"r{n} sin({n} w t + p) + q{n} cos({n} w t + p)" for n in orders)
    effect = replace(
        given,
        sentence="Something else swings at a fixed frequency, with harmonics.",
        equation=f"A (sin(w t + p) + {sums})",
        parameters=(
            *given.parameters[:3],
            *(EffectParameter(f"{name}{n}", "-") for n in orders for name in ("r", "q")),
        ),
        force=_force,
        transform=_transform,
    )
    begun = np.zeros(2 * (most - 1))
    begun[: len(ratios)] = ratios
    return replace(sine, effect=effect).at((*sine.theta[:3], *begun))


def with_one_course(
    problem: Problem, best: Candidate, pool: list[Candidate], unexplained: float, alpha: float, n_jobs=None
) -> Candidate:
    """Return a set with one periodic disturbance for the sines that are its harmonics, if it is as likely.

    A sine alone gets harmonics that noise would not give it, none larger than itself, unless the machine
    repeats its motion as often. What is returned joins the ``pool``, and so does the same where it may act as
    well.

    Parameters
    ----------
    unexplained : float
        Cost without any effect.
    alpha : float
        Chance that noise gives a sine some harmonics.
    """
    for sine, others in _courses(problem, best):
        kept = tuple(e for e in best.effects if e.place not in {sine.place, *(o.place for o in others)})
        if _repeats_itself(problem, best, kept, sine):
            continue
        found = _fitted(problem, best, kept, _begun(sine, others), n_jobs)
        if others:
            is_one = found.criterion <= best.criterion + HARDLY
        else:
            gained = deviance(problem, best.fit.model) - deviance(problem, found.fit.model)
            n_more = found.n_values - best.n_values
            is_one = _is_better(found, best) and chance_of_noise(gained, MOST - 1, 1, n_more) <= alpha
        if not is_one or _is_outdone(found, sine):
            continue
        course_of = _now(found, sine)
        elsewhere = [
            _converged(
                problem, found, kept, replace(other, effect=course_of.effect).at(course_of.theta), n_jobs
            )
            for other in _sines_elsewhere(pool, {e.place for e in found.effects})
        ]
        pool += [found, *elsewhere]
        return likeliest([found, *elsewhere], unexplained)
    return best


def _with_those_of(course_of: PlacedEffect, other: PlacedEffect) -> PlacedEffect:
    """Return a sine elsewhere with as many harmonics, of the same ratios to begin with."""
    return with_harmonics(other, n_harmonics(course_of), course_of.theta[3:])


def _courses(problem: Problem, best: Candidate) -> Iterator[tuple[PlacedEffect, list[PlacedEffect]]]:
    """Yield each lasting sine of a set with those that are harmonics of it, the slowest first."""
    windows = problem.windows
    whole = problem.simulator.dt * float(np.max(windows.last - windows.began))
    sines = [e for e in best.effects if e.effect.code == SINE and not e.passes and frequency_of(e) > 0]
    for sine in sorted(sines, key=frequency_of):
        yield sine, [o for o in sines if o is not sine and _is_harmonic(o, sine, LINE * 2 * np.pi / whole)]


def _now(candidate: Candidate, course_of: PlacedEffect) -> PlacedEffect:
    """Return a course as a set has it."""
    return next(e for e in candidate.effects if e.place == course_of.place)


def frequency_of(sine: PlacedEffect) -> float:
    return sine.theta[1]


def _is_harmonic(other: PlacedEffect, sine: PlacedEffect, width: float) -> bool:
    """Tell whether a sine swings at a multiple of another's frequency, rad/s, within some width."""
    w = frequency_of(sine)
    order = round(frequency_of(other) / w)
    return 2 <= order <= MOST and abs(frequency_of(other) - order * w) <= width


def _is_outdone(candidate: Candidate, sine: PlacedEffect) -> bool:
    """Tell whether a harmonic is larger than the first: of such a series anything is made that wanders."""
    theta = _now(candidate, sine).theta
    return bool(np.max(np.hypot(theta[3::2], theta[4::2]), initial=0.0) > 1.0)


def _repeats_itself(
    problem: Problem, best: Candidate, kept: tuple[PlacedEffect, ...], sine: PlacedEffect
) -> bool:
    """Tell whether a machine, without a sine, moves as often as that swings, or half as often, all of it.

    Whatever its motion brings about then swings so too, twice a period where it is alike both ways, and says
    nothing of a clock of its own.
    """
    run = problem.run(best.fit.model._replace(effects=kept))
    rows = problem.samples_of(run)
    since = rows - problem.windows.began[np.searchsorted(problem.windows.first, rows, side="right") - 1]
    period = 2 * 2 * np.pi / (frequency_of(sine) * problem.simulator.dt)  # of two turns, samples
    moving = run.x[rows][:, np.ptp(run.x[rows], axis=0) > 0]
    return moving.size > 0 and all(_folded(signal, since, period) for signal in moving.T)


def _folded(signal: np.ndarray, at: np.ndarray, period: float) -> bool:
    """Tell whether a signal is mostly its mean over periods, more than it would be by chance."""
    phases = np.minimum((at % period).astype(int), max(int(period), 1) - 1)
    mean = np.bincount(phases, signal) / np.maximum(np.bincount(phases), 1)
    by_chance = min(period / signal.size, 1.0)  # of a signal that never comes again
    return bool(np.var(mean[phases]) > (1.0 + by_chance) / 2 * np.var(signal))


def _is_better(more: Candidate, fewer: Candidate) -> bool:
    """Tell whether further harmonics pay for themselves, those too that the data hardly feel."""
    return more.criterion + unpaid(more, fewer) < fewer.criterion


def _begun(sine: PlacedEffect, others: list[PlacedEffect]) -> PlacedEffect:
    """Return a sine with the harmonics that it has, and those that others are, where these act there too."""
    size, w, p, *own = sine.theta
    orders = [round(frequency_of(other) / w) for other in others]
    ratios = np.zeros((max([2, n_harmonics(sine), *orders]) - 1, 2))
    ratios.ravel()[: len(own)] = own
    for other, n in zip(others, orders, strict=True):
        if other.port == sine.port and size != 0:
            turned = other.theta[2] - p
            ratios[n - 2] = other.theta[0] / size * np.array([np.cos(turned), np.sin(turned)])
    return with_harmonics(sine, len(ratios) + 1, ratios.ravel())


def _fitted(
    problem: Problem, best: Candidate, kept: tuple[PlacedEffect, ...], begun: PlacedEffect, n_jobs: int | None
) -> Candidate:
    """Return the set with the course of most harmonics that say something."""
    found = leading = _converged(problem, best, kept, begun, n_jobs)
    last = first = n_harmonics(begun)
    for n in range(first + 1, MOST + 1):
        course_of = _now(leading, begun)
        more = with_harmonics(course_of, n, course_of.theta[3:])
        leading = _converged(problem, leading, kept, more, n_jobs)
        if _is_better(leading, found) and not _is_outdone(leading, begun):
            found, last = leading, n
        elif n - last >= IN_VAIN:
            break
    return found


def _converged(
    problem: Problem, near: Candidate, kept: tuple[PlacedEffect, ...], course_of: PlacedEffect, n_jobs
) -> Candidate:
    """Return a set of what is kept and a course, fitted to the end."""
    by_place = {e.place: e for e in near.effects}
    effects = (*(by_place.get(e.place, e) for e in kept), course_of)
    model = near.fit.model._replace(effects=effects)
    return converged(problem, Candidate(near.fit._replace(model=model), near.n_samples), n_jobs)


def _sines_elsewhere(pool: list[Candidate], places: set) -> list[PlacedEffect]:
    """Return the sines of a pool that act alone, at places of their own: the likeliest of each."""
    found: dict = {}
    for candidate in pool:
        (placed, *others) = candidate.effects
        if not others and placed.effect.code == SINE and not placed.passes and placed.place not in places:
            found.setdefault(placed.place, placed)
    return list(found.values())

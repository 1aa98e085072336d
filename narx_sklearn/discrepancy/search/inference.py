"""How sure: intervals of the parameters, and whether they moved at all."""

import math
from collections.abc import Iterable

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.stats import chi2, f, norm

from narx_sklearn.discrepancy.fitting.directions import directions_of
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import SMALL, Fit, all_bounds, linearised, state_scale
from narx_sklearn.discrepancy.search.bank import Bank
from narx_sklearn.discrepancy.search.detect import block_length, blocks_of, detect
from narx_sklearn.discrepancy.simulators.simulator import Windows

FAR = 2.0  # times the cost of the refitted parameters, that the nominal ones leave
UNFELT = 1e-3  # noise deviations by which runs change with the ordinary size of what is zero, if it is told
BY_CHANCE = 0.01  # probability, above which what windows' own initial states take off may be noise
NEWTON = 5  # steps to where a machine rests
LARGE_PART = 0.3  # of a direction of unit length
TAKES_PART = 0.01  # of the relative change of parameters along such a direction


def covariance(problem: Problem, fit: Fit) -> np.ndarray:
    """Return the covariance of the global parameters, robust to what the noise model leaves.

    Short blocks of whitened samples are the independent units (a sandwich over blocks); the residual is
    scaled for the parameters and initial states that were fitted to it. Where parameters do the same thing
    (a stiffness, and the reference of an effect that acts like one), what they do together is what is sure.
    """
    J, r = fit.jacobian, fit.residual
    n = J.shape[2]
    if n == 0:
        return np.zeros((0, 0))
    n_outputs = problem.y.shape[1]
    directions = directions_of(_gram(fit))
    size, bread = np.where(directions.size > 0, directions.size, 1.0), directions.inverse
    length = block_length(r.shape[0], r.shape[1] // n_outputs)
    scores = blocks_of(J * r[:, :, None], n_outputs, length) / size
    fitted = n + problem.n_initial
    factor = problem.n_seen / max(problem.n_seen - fitted, 1)
    robust = bread @ (scores.T @ scores) @ bread * factor
    plain = bread * fit.cost / max(problem.n_seen - fitted, 1)
    # with few blocks a sandwich can come out too thin; it never goes below what white noise would give
    scale = np.sqrt(np.maximum(np.diag(plain) / np.maximum(np.diag(robust), 1e-300), 1.0))
    return robust * np.outer(scale, scale) / np.outer(size, size)


def intervals(problem: Problem, fit: Fit, level: float = 0.9) -> np.ndarray:
    """Return confidence intervals of the global parameters, (n_q, 2), as far as their bounds allow.

    Of what the record does not show, the interval is all that it may be. Where windows begin as inputs led
    to it, but for noise, parameters are told by what inputs do alone. When something happened once is told by
    what the record leaves with it earlier or later, in steps of half a sample.
    """
    q = fit.model.q
    width = norm.ppf(0.5 + level / 2) * _errors(problem, fit)
    n_own = fit.model.p.size
    if n_own and (driven := as_driven(problem, fit)) is not None:
        width[:n_own] = np.maximum(width, norm.ppf(0.5 + level / 2) * _errors(problem, driven))[:n_own]
    domain = np.concatenate([problem.simulator.bounds, *(e.domain for e in fit.model.effects)])
    width[np.ptp(all_bounds(problem, fit.model), axis=1) == 0] = 0.0  # held there
    rows = np.column_stack([q - width, q + width])
    for effect, own in zip(fit.model.effects, fit.model.theirs, strict=True):
        for index in effect.effect.instants:
            rows[own.start + index] = _earliest_and_latest(problem, fit, own.start + index, level)
    return np.clip(rows, domain[:, :1], domain[:, 1:])


def spanning(
    rows: np.ndarray, problem: Problem, found: Fit, others: Iterable[Fit], level: float = 0.9
) -> np.ndarray:
    """Return intervals of a fit, (n_q, 2), widened over what others say of the simulator's own parameters.

    Of parameters that another does not tell alone and the first does, it says nothing: a curve does not tell
    the stiffness beside it.
    """
    spanned, n_own = rows.copy(), len(problem.simulator.parameters)
    lost_anyway = {k for group in told_together(found) for k in group}
    for other in others:
        its = intervals(problem, other, level)[:n_own]
        lost = {k for group in told_together(other) for k in group if k < n_own} - lost_anyway
        told = np.isfinite(its).all(axis=1)
        told[list(lost)] = False
        own = spanned[:n_own]  # a view
        own[told, 0] = np.minimum(own[told, 0], its[told, 0])
        own[told, 1] = np.maximum(own[told, 1], its[told, 1])
    return spanned


def as_driven(problem: Problem, found: Fit) -> Fit | None:
    """Return a fit whose windows begin where inputs led them from rest; None where these leave surely more.

    At rest the initial states of windows follow noise, with the frequency and damping that suit it best, and
    tangents there would tell the parameters of that. Parameters count as fitted to it too, and each ordinate
    of a window's spectrum as a frequency that was tried.
    """
    n_fitted = problem.n_initial + found.model.p.size
    n_left = problem.n_seen - n_fitted
    x0 = _states_as_driven(problem, found.model)
    if x0 is None or not (problem.n_initial and n_left > 0 and found.cost > 0):
        return None
    x_steps = state_scale(problem, found.model, problem.run(found.model))
    driven = linearised(problem, found.model._replace(x0=x0), x_steps)
    if not np.isfinite(driven.cost):
        return None
    ratio = (driven.cost - found.cost) / n_fitted / (found.cost / n_left)
    tried = max(problem.windows.length // 2, 1)
    return driven if tried * f.sf(ratio, n_fitted, n_left) > BY_CHANCE else None


def _states_as_driven(problem: Problem, model: Model) -> np.ndarray | None:
    """Return the states of windows to which inputs lead from where each session rests; None if nowhere."""
    windows, u, simulator = problem.windows, problem.u, problem.simulator
    x0 = model.x0.copy()
    for began in np.unique(windows.began):
        own = np.flatnonzero(windows.began == began)
        first, last = int(windows.first[own].min()), int(windows.last[own].max())
        rest = _at_rest(problem, model, u[first], model.x0[own].mean(axis=0))
        span = Windows(*(np.array([value]) for value in (first, last, True, began)))
        x0[own] = simulator.run(u, span, rest[None], model.p, model.effects).x[windows.first[own]]
    x0 = np.where(simulator.free_states, x0, model.x0)
    return x0 if np.isfinite(x0).all() else None


def _at_rest(problem: Problem, model: Model, u: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the states near some, (n_states,), that stay as they are under a constant input; NaN if none."""
    n = x.size
    held = np.tile(u, (2 * (n + 1), 1))
    first = 2 * np.arange(n + 1)
    pairs = Windows(first, first + 2, np.ones(n + 1, dtype=bool), first)
    motion = np.abs(model.x0).max(axis=0)
    size = SMALL * np.where(motion > 0, motion, 1.0)
    for _ in range(NEWTON):
        x0 = x + np.concatenate([np.zeros((1, n)), np.diag(size)])
        moved = problem.simulator.run(held, pairs, x0, model.p, model.effects).x[first + 1] - x0
        if not np.isfinite(moved).all():
            return np.full(n, np.nan)
        slopes = (moved[1:] - moved[0]).T / size
        x = x - np.linalg.pinv(slopes * size) @ moved[0] * size
    return x


def _errors(problem: Problem, fit: Fit) -> np.ndarray:
    """Return standard errors of the global parameters, infinite of those that show nothing, (n_q,)."""
    error = np.sqrt(np.maximum(np.diag(covariance(problem, fit)), 0.0))
    silent = (fit.model.q == 0) & (_felt_alone(fit) < UNFELT) | ~np.any(fit.jacobian, axis=(0, 1))
    return np.where(silent, np.inf, error)


def _earliest_and_latest(problem: Problem, fit: Fit, index: int, level: float) -> tuple[float, float]:
    """Return between which times something may have happened, all else as it is."""
    step = 0.5 * problem.simulator.dt
    lower, upper = all_bounds(problem, fit.model)[index]
    most = fit.cost + chi2.ppf(level, 1) * fit.cost / problem.n_seen

    def fits(n_steps: int) -> bool:
        q = fit.model.q
        q[index] += n_steps * step
        return (
            lower <= q[index] <= upper
            and np.sum(problem.residual(problem.run(fit.model.with_q(q))) ** 2) <= most
        )

    ends = []
    for way in (-1, 1):
        n, within = 1, 0
        while n < problem.rows.size and fits(way * n):  # twice as far each time
            n, within = 2 * n, n
        while n - within > 1:
            middle = (n + within) // 2
            n, within = (n, middle) if fits(way * middle) else (middle, within)
        ends.append(fit.model.q[index] + way * within * step)
    return ends[0], ends[1]


def untold(fit: Fit) -> np.ndarray:
    """Return directions in which global parameters may move together and nothing is noticed, (n, n_q).

    They are orthonormal in relative changes: masses and forces, say, all larger by one factor. A parameter
    whose own change by all of itself is lost in the noise is not among them.
    """
    felt = _felt_alone(fit)
    heard = np.flatnonzero(felt > 1.0)
    silent = directions_of(_gram(fit)[np.ix_(heard, heard)]).silent / felt[heard][:, None]
    directions = np.zeros((silent.shape[1], felt.size))
    directions[:, heard] = np.linalg.qr(silent)[0].T
    return directions


def lost_together(problem: Problem, fit: Fit, own: slice) -> list[int]:
    """Return which parameters of an effect may be off by more than themselves, as others make up for it.

    Counted from the effect's first; none where all are told, or only one is not.
    """
    for group in told_together(fit):  # which the covariance leaves out
        if group[0] >= own.start and group[-1] < own.stop:
            return [index - own.start for index in group]
    q = fit.model.q[own]
    some = np.flatnonzero(q)
    relative = covariance(problem, fit)[own, own][np.ix_(some, some)] / np.outer(q[some], q[some])
    if some.size < 2 or not np.all(np.isfinite(relative)):
        return []
    values, vectors = np.linalg.eigh(relative)
    part = np.flatnonzero(np.abs(vectors[:, -1]) > LARGE_PART)
    return some[part].tolist() if values[-1] > 1.0 and part.size > 1 else []


def _felt_alone(fit: Fit) -> np.ndarray:
    """Return by how many noise deviations the runs change with all of each global parameter, (n_q,).

    Of one that is zero, with its ordinary size.
    """
    return np.sqrt(np.diag(_gram(fit))) * (np.abs(fit.steps) / SMALL)


def _gram(fit: Fit) -> np.ndarray:
    """Return the inner products of what the global parameters do to the runs, whitened, (n_q, n_q)."""
    flat = fit.jacobian.reshape(-1, fit.model.q.size)
    return flat.T @ flat


def _left_out(fit: Fit) -> np.ndarray:
    """Return the directions that a covariance leaves out, (n, n_q), orthonormal in what each parameter does.

    Among them are those of parameters that are nothing by themselves and may be anything beside others, as a
    value of a broken line is where it crosses zero.
    """
    return directions_of(_gram(fit)).silent.T


def told_together(fit: Fit) -> list[list[int]]:
    """Return groups of parameters of which only what they do together is told.

    They take part in a direction that nobody notices by what they do along it, or by how much they change.
    """
    joint = np.zeros((fit.model.q.size,) * 2, dtype=bool)
    for directions in (untold(fit), _left_out(fit)):
        joint |= np.abs(directions.T @ directions) > TAKES_PART
    _, group = connected_components(joint, directed=False)
    found = (np.flatnonzero((group == g) & np.diag(joint)).tolist() for g in np.unique(group))
    return [members for members in found if len(members) > 1]


def confidence_in_nothing(p_value: float) -> float:
    r"""Return the least probability, after a test, that there is nothing, at even odds before it.

    .. math:: \left(1 + \frac{1}{-e\, p \ln p}\right)^{-1}, \qquad p < 1/e

    A p-value speaks no more against it than that (Sellke, Bayarri and Berger 2001, The American Statistician
    55(1), eq. 3); a larger one leaves the odds as they were.
    """
    p_value = max(p_value, 1e-300)
    factor = -math.e * p_value * np.log(p_value) if p_value < 1 / math.e else 1.0
    return float(factor / (1.0 + factor))


def parameters_moved(problem: Problem, fit: Fit, refitted: Fit, random_state=None) -> float:
    """Return the p-value of the test that the nominal parameters are right, from the fit made with them.

    Where the refitted ones leave far less, the ratio of likelihoods decides: tangents tell little from afar.
    """
    if fit.cost > FAR * refitted.cost:
        times_less = np.log(fit.cost) - np.log(max(refitted.cost, 1e-300))  # an exact fit leaves nothing
        return float(chi2.sf(problem.n_seen * times_less, refitted.model.p.size))
    columns, residual = fit.jacobian, fit.residual
    flat = columns.reshape(-1, columns.shape[2])
    gram = flat.T @ flat
    n = columns.shape[2]
    none = np.zeros(n, dtype=int)
    bank = Bank([], none, none, columns, residual, gram, flat.T @ residual.ravel(), np.diag(gram) > 0)
    found = detect(
        bank,
        np.ones(n, dtype=bool),
        n_outputs=problem.y.shape[1],
        n_samples=problem.n_seen,
        n_fitted=problem.n_initial,
        random_state=random_state,
    )
    return float(found.p_values.min(initial=1.0))

"""A search by draws, where a coarse sensor leaves the cost no slope."""

from itertools import compress
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, all_bounds, fit
from narx_sklearn.discrepancy.search.candidate import FINE
from narx_sklearn.discrepancy.search.inference import covariance
from narx_sklearn.discrepancy.search.restricted import STEPPED

DRAWN, KEPT = 12, 3  # in a generation, and of these for the next, for each value that is drawn
GENERATIONS = 40  # at most
SETTLED = 1.0  # noise variances by which what is kept differs at last
MOST_DRAWN = 20  # values; if there are more, initial states follow all else
A_PART_OF_A_STEP = 0.25  # by which the farthest reading is off, to begin with


def nearer_by_draws(problem: Problem, found: Fit) -> Fit:
    """Return a fit beside a coarse sensor, or a better one of those drawn where noise would leave it.

    A small change of a parameter takes a reading to the next step or leaves it: there is no slope, and a fit
    stays where the smooth machine was. Steps that are right tell parameters far better than noise of their
    size would, in a narrow valley that widens upwards as |error| does; draws from a normal distribution,
    made anew from the best of them, come down into it (the cross-entropy method: Rubinstein 1999). What so
    many draws would take off noise is no better.

    Parameters
    ----------
    found : Fit
        With an effect through which a small change comes as it is, on the whole, or not at all.
    """
    frame = _Draws.about(problem, found.model)
    rng = np.random.default_rng(0)
    center, factor = np.zeros(frame.size), np.eye(frame.size)
    best, least, n_drawn = found.model, found.cost, 0
    for _ in range(GENERATIONS):
        drawn = center + rng.standard_normal((DRAWN * frame.size, frame.size)) @ factor.T
        models = [frame.model_at(values) for values in drawn]
        left = np.array([_cost(problem, model) for model in models])
        n_drawn += len(drawn)
        order = np.argsort(left, kind="stable")[: KEPT * frame.size]
        if not np.isfinite(left[order]).all():
            break
        if left[order[0]] < least:
            best, least = models[order[0]], float(left[order[0]])
        center, factor = drawn[order].mean(axis=0), _root(np.cov(drawn[order].T).reshape(2 * (frame.size,)))
        if np.ptp(left[order]) < SETTLED:
            break
    if best is found.model:
        return found
    better = fit(problem, best, iterations=FINE)
    return better if better.cost < found.cost - 2 * np.log(n_drawn) else found


class _Draws(NamedTuple):
    """Values about those of a model without steps, as far off as its noise lets them be."""

    problem: Problem
    model: Model
    root: np.ndarray  # (n_q, n_q) of the covariance of global parameters
    follows: np.ndarray  # (n_windows, n_free, n_q) what initial states gain with each of these
    roots: np.ndarray  # (n_windows, n_free, n_free) of their own covariance, global parameters as they are

    @classmethod
    def about(cls, problem: Problem, model: Model) -> "_Draws":
        """Fit a model without steps, and return what it and its errors are."""
        is_smooth = np.array([effect.effect.code not in STEPPED for effect in model.effects], dtype=bool)
        smooth = model._replace(effects=tuple(compress(model.effects, is_smooth)))
        plain = fit(problem, smooth, iterations=FINE)
        there = np.repeat(is_smooth, [effect.n_theta for effect in model.effects])
        there = np.concatenate([np.ones(model.p.size, dtype=bool), there])
        q = model.q
        q[there] = plain.model.q
        run = problem.run(plain.model)
        root = np.zeros(2 * (q.size,))
        root[np.ix_(there, there)] = _root(covariance(problem, plain))
        for effect, own in zip(model.effects, model.theirs, strict=True):
            if effect.effect.code in STEPPED:
                reading = run.y[problem.rows[problem.inside], effect.port.index]
                (step,) = effect.theta
                farthest = max(np.max(np.abs(reading), initial=step, where=np.isfinite(reading)), 1e-300)
                root[own, own] = A_PART_OF_A_STEP * step * step / farthest
        moved = np.zeros((problem.windows.count, problem.rows.shape[1] * problem.y.shape[1], q.size))
        moved[:, :, there] = problem.parameter_sensitivity(plain.model, run, plain.steps)
        inverse = plain.projector.inverse
        roots = np.array([_root(one @ one.T) for one in inverse])
        return cls(problem, model.with_q(q)._replace(x0=plain.model.x0), root, -inverse @ moved, roots)

    @property
    def size(self) -> int:
        """How many values are drawn."""
        n_states = self.roots.shape[0] * self.roots.shape[1]
        return len(self.root) + (n_states if len(self.root) + n_states <= MOST_DRAWN else 0)

    def model_at(self, values: np.ndarray) -> Model:
        """Return the model at drawn values, each in standard deviations."""
        n = len(self.root)
        moved = self.root @ values[:n]
        gained = self.follows @ moved
        if values.size > n:
            gained = gained + np.einsum("wij,wj->wi", self.roots, values[n:].reshape(gained.shape))
        x0 = self.model.x0.copy()
        x0[:, self.problem.simulator.free_states] += gained
        q = np.clip(self.model.q + moved, *all_bounds(self.problem, self.model).T)
        return self.model.with_q(q)._replace(x0=x0)


def _root(matrix: np.ndarray) -> np.ndarray:
    """Return a root of a covariance, also of one without full rank."""
    values, vectors = np.linalg.eigh(matrix)
    return vectors * np.sqrt(values.clip(min=0.0))


def _cost(problem: Problem, model: Model) -> float:
    residual = problem.residual(problem.run(model))
    cost = float(np.einsum("wt,wt->", residual, residual))
    return cost if np.isfinite(cost) else np.inf

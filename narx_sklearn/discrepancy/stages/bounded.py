"""Parameters that a refit brought to their bounds, and whether the record would have them beyond."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.search.inference import covariance
from narx_sklearn.discrepancy.simulators.simulator import Parameter, Simulator
from narx_sklearn.discrepancy.stages.beginning import leaves_rounding

NEAR = 0.1  # standard deviations off a bound, within which a parameter lies at it


class AtBound(NamedTuple):
    """A parameter of the simulator at one of its bounds."""

    number: int  # among the parameters
    parameter: Parameter  # with the bounds that it had
    is_upper: bool

    @property
    def bound(self) -> float:
        """The bound at which it lies."""
        return self.parameter.upper if self.is_upper else self.parameter.lower

    @property
    def is_given(self) -> bool:
        """Whether somebody gave this bound: it is no matter of the sign."""
        return bool(self.bound != _by_sign(self.parameter)[self.is_upper])


class Beyond(NamedTuple):
    """What a record tells where bounds that were given do not stand in the way."""

    simulator: Simulator  # without them
    fit: Fit
    passed: tuple[AtBound, ...]  # the bounds that lie between
    less: float  # share of what is left that it takes away


def at_bounds(problem: Problem, found: Fit) -> tuple[AtBound, ...]:
    """Return the simulator's own parameters that lie at a bound, of those which the record notices.

    One that has no room is held, and lies at none.
    """
    parameters = problem.simulator.parameters
    error = np.sqrt(np.maximum(np.diag(covariance(problem, found)), 0.0))
    heard = np.any(found.jacobian, axis=(0, 1))
    return tuple(
        AtBound(i, parameter, is_upper)
        for i, parameter in enumerate(parameters)
        for is_upper in (False, True)
        if heard[i] and parameter.lower < parameter.upper
        if abs(found.model.p[i] - (parameter.upper if is_upper else parameter.lower)) <= NEAR * error[i]
    )


def fit_beyond(problem: Problem, found: Fit, alpha: float, n_jobs: int | None = None) -> Beyond | None:
    """Return the fit that bounds somebody gave stand in the way of; None where it is no better but by chance.

    Only those at which parameters lie are left out. The sign of a parameter is kept.
    """
    if leaves_rounding(problem, found.residual):
        return None
    now, free, passed = problem, found, tuple[AtBound, ...]()
    while met := [at for at in at_bounds(now, free) if at.is_given]:
        passed += tuple(met)
        now = replace(now, simulator=now.simulator.with_bounds(_without(now.simulator, met)))
        free = fit(now, free.model, n_jobs=n_jobs)
    passed = tuple(at for at in passed if (free.model.p[at.number] > at.bound) == at.is_upper)
    times_less = np.log(found.cost) - np.log(max(free.cost, 1e-300))
    if not passed or not chi2.sf(problem.n_seen * times_less, len(passed)) <= alpha:
        return None
    return Beyond(now.simulator, free, passed, 1.0 - free.cost / found.cost)


def _without(simulator: Simulator, met: Sequence[AtBound]) -> np.ndarray:
    """Return the bounds of a simulator's parameters without some of them, (n_parameters, 2)."""
    bounds = simulator.bounds
    for at in met:
        bounds[at.number, int(at.is_upper)] = _by_sign(at.parameter)[at.is_upper]
    return bounds


def _by_sign(parameter: Parameter) -> tuple[float, float]:
    """Return the bounds that the sign of a parameter alone would have it keep."""
    return -np.inf if parameter.lower < 0 else 0.0, np.inf if parameter.upper > 0 else 0.0

"""Every effect at every one of its places, with the values from which it is tried there."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.places import Argument, parameter_placements, placed_at, placements
from narx_sklearn.discrepancy.simulators.simulator import Run, Simulator, covered
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.model.units import may_be_alike
from narx_sklearn.physics.effects import Effect, Setting
from narx_sklearn.physics.effects._series import rates_along


class Hypothesis(NamedTuple):
    """A placed effect and the parameter values from which to try it."""

    placed: PlacedEffect
    starts: np.ndarray  # (n_starts, n_theta)
    tuned: np.ndarray  # (n_starts,) bool: found by looking at the residual, so no test may use them freely
    tried: np.ndarray  # (n_starts,) of how many values it is the best, where a scan found it; else 0
    asked: bool = True  # whether it may be named; else it only takes up structure, so that the noise shows

    @classmethod
    def untuned(cls, placed: PlacedEffect, starts: np.ndarray) -> "Hypothesis":
        """Return a hypothesis that is tried from starts, (n_starts, n_theta), which no residual told."""
        return cls(placed, starts, tuned=np.zeros(len(starts), dtype=bool), tried=np.zeros(len(starts)))


def enumerate_hypotheses(
    effects: Iterable[Effect],
    problem: Problem,
    run: Run,
    structure: Structure,
    unasked: Iterable[Effect] = (),
    n_jobs: int | None = None,
) -> list[Hypothesis]:
    """Return the hypotheses that can act on this record, in the order given; last those nobody asks for."""
    simulator = problem.simulator
    order = covered(problem.windows)
    material = _Material(simulator, problem, run, order, structure)
    asked = tuple(effects)
    places = [
        (placed, effect in asked)
        for effect in (*asked, *unasked)
        for placed in placements(effect, simulator, structure)
    ]
    return _begun(places, material, n_jobs)


def parameter_hypotheses(
    effects: Iterable[Effect], problem: Problem, run: Run, structure: Structure, n_jobs: int | None = None
) -> list[Hypothesis]:
    """Return the hypotheses that a parameter of the simulator depends on one of its signals."""
    simulator = problem.simulator
    material = _Material(simulator, problem, run, covered(problem.windows), structure)
    places = [
        (placed, True) for effect in effects for placed in parameter_placements(effect, simulator, structure)
    ]
    return _begun(places, material, n_jobs)


def _begun(
    places: Iterable[tuple[PlacedEffect, bool]], material: "_Material", n_jobs: int | None
) -> list[Hypothesis]:
    """Return the hypotheses at places, told whether they are asked for, where something lets them start."""
    found = Parallel(n_jobs=n_jobs, prefer="threads")(
        delayed(_hypothesis)(placed, material.setting(placed), is_asked) for placed, is_asked in places
    )
    return [hypothesis for hypothesis in found if hypothesis is not None]


def _hypothesis(placed: PlacedEffect, setting: Setting, asked: bool) -> Hypothesis | None:
    """Return the hypothesis that an effect acts at a place; None where nothing there lets it start."""
    effect = placed.effect
    limits = np.tile([-np.inf, np.inf], (len(effect.parameters), 1))
    if effect.limits is not None:
        limits = np.array(effect.limits(setting), dtype=float)
    for k in effect.references:
        is_of_second = placed.is_fed or "{second}" in effect.parameters[k].unit
        signal = setting.second if is_of_second else None
        limits[k] = reference_limits(setting.argument if signal is None else signal)
    if np.isfinite(limits).any():
        placed = replace(placed, limits=tuple((low, high) for low, high in limits.tolist()))
    starts = _starts(effect, setting, placed)
    scanned, n_tried = _scan(effect, setting, placed)
    if not len(starts) + len(scanned):
        return None
    blind = _starts(effect, setting._replace(residual=None, innovations=None), placed)
    # what is read off the measured values themselves (their steps, their repeats) is no residual
    tuned = (
        np.zeros(len(starts), dtype=bool)
        if effect.read_off
        else ~np.array([any(np.array_equal(row, b) for b in blind) for row in starts], dtype=bool)
    )
    return Hypothesis(
        placed,
        np.concatenate([starts, scanned]),
        np.append(tuned, np.ones(len(scanned), dtype=bool)),
        np.append(np.zeros(len(starts)), np.full(len(scanned), n_tried)),
        asked,
    )


def reference_limits(signal: np.ndarray) -> tuple[float, float]:
    """Return between what a signal is counted from in a law: zero, or no farther from it than it moves.

    Counted from far away it hardly changes, and what else the law depends on would act alone, under the name
    of both.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.search.hypotheses import reference_limits
    >>> reference_limits(np.array([30.0, 55.0])), reference_limits(np.array([-1.0, np.nan, 1.0]))
    ((-25.0, 80.0), (-3.0, 3.0))
    """
    finite = signal[np.isfinite(signal)]
    if not finite.size:
        return -np.inf, np.inf
    low, high = float(finite.min()), float(finite.max())
    return min(low, 0.0) - (high - low), max(high, 0.0) + (high - low)


def _starts(effect: Effect, setting: Setting, placed: PlacedEffect) -> np.ndarray:
    with np.errstate(all="ignore"):
        starts = np.asarray(effect.starts(setting), dtype=float)
    if starts.size == 0:
        return np.empty((0, placed.n_theta))
    if placed.onward >= 0:
        starts = np.column_stack([starts, np.full(len(starts), placed.share)])
    return starts[np.all(np.isfinite(starts), axis=1)]


def _scan(effect: Effect, setting: Setting, placed: PlacedEffect) -> tuple[np.ndarray, int]:
    if effect.scan is None or setting.residual is None:
        return np.empty((0, placed.n_theta)), 0
    with np.errstate(all="ignore"):
        rows, n_tried = effect.scan(setting, setting.residual)
    return rows[np.all(np.isfinite(rows), axis=1)], n_tried


def counted_from_means(
    law: Effect, i: int, signals: Sequence[Argument], x: np.ndarray, n_inputs: int, amplitude: float
) -> Hypothesis:
    """Return a law of one or two signals in state equation ``i``, each counted from its mean at first.

    The law's parameters are its amplitude and what each signal is counted from. No neighbour is pushed back.

    Parameters
    ----------
    x : ndarray of shape (n_samples, n_states)
        States of the run over which means are taken.
    """
    values = [x @ np.array(signal.weights) for signal in signals]
    placed = placed_at(law, Port("state", i), signals[0]._replace(pushed_back=-1))
    for other in signals[1:]:
        weights = (*[0.0] * n_inputs, *other.weights)
        placed = replace(placed, second=weights, second_name=other.name, second_unit=other.unit)
    means = [signal.mean() for signal in values]
    limits = (-np.inf, np.inf), *(reference_limits(signal) for signal in values)
    begun = replace(placed, limits=limits).at((0.0, *means))
    return Hypothesis.untuned(begun, np.array([[amplitude, *means]]))


class _Material:
    """Signals along a run, from which settings are taken; computed once for all hypotheses."""

    def __init__(self, simulator: Simulator, problem: Problem, run: Run, order, structure: Structure):
        self.simulator, self.u, self.run, self.structure = simulator, problem.u[order], run, structure
        self.residual = np.nan_to_num(problem.y - run.y)
        innovations = problem.residual(run).reshape(problem.seen.shape)[problem.inside]
        self.innovations = np.nan_to_num(innovations, posinf=0.0, neginf=0.0)
        _, directions = np.linalg.eigh(self.innovations.T @ self.innovations)
        self.together = self.innovations @ directions[:, -1]  # where something shows in several outputs
        self.order, self.time, self.first = order, _time(problem), _firsts(problem)
        x = run.x[order]
        rates = np.empty_like(x)
        edges = [*self.first.tolist(), len(order)]
        for a, b in pairwise(edges):
            rates[a:b] = rates_along(x[a:b], simulator.dt)
        self.x, self.rates = x, rates

    def setting(self, placed: PlacedEffect) -> Setting:
        """Return what the record shows at one place."""
        dt = self.simulator.dt
        kind, index = placed.port
        second = placed.second_of(self.u, None if kind == "input" else self.x)
        if kind == "state":
            weights = np.array(placed.weights)
            own = self.rates[:, index] * (dt if self.simulator.discrete else 1.0)
            argument, rate = placed.argument_of(self.u, self.x), self.rates @ weights
            own = rate if placed.inertial else argument if placed.handed_on else own
            if placed.through >= 0:  # what is added to the input is counted in its unit
                own = own / self.structure.gain[index, placed.through]
        else:
            if placed.port.is_parameter and second is not None:
                own = second
            else:
                own = self.u[:, index] if kind == "input" else self.run.y[self.order, index]
            argument = own if second is None or not (placed.is_fed and kind == "output") else second
            rate = np.gradient(argument, dt)
        residual = self.residual[self.order, index if kind == "output" else 0]
        shows = self.innovations[:, index] if kind == "output" else self.together
        elapsed = self.order * dt
        turns = may_be_alike(placed.argument_unit, "rad")
        at = self.time, dt, self.first
        return Setting(argument, rate, own, second, *at, residual, shows, elapsed, turns)


def _time(problem: Problem) -> np.ndarray:
    w = problem.windows
    return np.concatenate(
        [
            (np.arange(a, b) - s) * problem.simulator.dt
            for a, b, s in zip(w.first, w.last, w.began, strict=True)
        ]
    )


def _firsts(problem: Problem) -> np.ndarray:
    w = problem.windows
    offsets = np.concatenate([[0], np.cumsum(w.last - w.first)[:-1]])
    return offsets[w.fresh]

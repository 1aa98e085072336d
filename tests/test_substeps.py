"""Simulations whose own steps are too long: told with the way out, and their error sold as no physics."""

from types import SimpleNamespace

import numpy as np
import pytest

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy import substeps
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.substeps import coarse_steps, mind_steps, too_coarse
from narx_sklearn.physics.effects import CATALOGUE

DT = 0.1


def filled(x, u, p):
    """A valve that is nearly as fast as a step, and the store behind it."""
    return p[0] * (u[0] - x[0]), p[1] * (x[0] ** 3 - x[1])


def make(pace, emptying, substeps):
    return ODESimulator(
        filled,
        dt=DT,
        parameters={"pace [1/s]": pace, "emptying [1/s]": emptying},
        states=["valve [m]", "level [m]"],
        inputs=["u [V]"],
        output=(0, 1),
        substeps=substeps,
    )


def recorded(pace, n=1000):
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1, 1, n // 8), 8)[:, None]
    y = make(pace, 1.0, 20).simulate(u)
    return u, y + 0.005 * y.std(axis=0) * rng.normal(size=y.shape)


def problem_of(simulator, u, y):
    return Problem(simulator, u, y, cut([(slice(0, len(u)), 0)], 200, 8), Noise.white(0.005 * y.std(axis=0)))


def at_measured(problem):
    return Model(problem.simulator.nominal, (), problem.y[problem.windows.first])


def test_how_far_finer_steps_move_a_run_is_measured():
    u, y = recorded(18.0)
    coarse = problem_of(make(18.0, 1.0, 1), u, y)
    found = too_coarse(coarse, at_measured(coarse))
    finer = make(18.0, 1.0, 4).run(u, coarse.windows, y[coarse.windows.first]).y
    run = coarse.run(at_measured(coarse)).y
    moved = np.sqrt(np.mean((finer - run) ** 2, axis=0))
    share = moved / coarse.noise.sigma
    worst = int(np.argmax(share))
    assert found == pytest.approx((worst, share[worst], moved[worst]), rel=1e-9)
    fine = problem_of(make(18.0, 1.0, 8), u, y)
    assert too_coarse(fine, at_measured(fine)) is None


def test_a_run_that_only_finer_steps_keep_finite_is_told_so():
    u, y = recorded(40.0)  # four times as much as a step of Runge-Kutta stays stable with is 2.8
    lost = problem_of(make(60.0, 1.0, 1), u, y)
    found = too_coarse(lost, at_measured(lost))
    assert found.share == found.error == np.inf
    told = coarse_steps(lost.simulator, found)
    assert "With 4 times as many integration steps valve no longer leaves the finite range" in told.sentence
    assert "Pass substeps=4" in told.sentence
    hopeless = problem_of(make(6000.0, 1.0, 1), u, y)
    assert too_coarse(hopeless, at_measured(hopeless)) is None


@pytest.mark.parametrize("pace", [5.0, 24.0])
def test_steps_too_long_for_a_refit_alone_are_not_told_of_what_was_found(pace, monkeypatch):
    """A refit without the load that is missing went to a faster valve; beside the load it is not."""
    monkeypatch.setattr(substeps, "explained_by_finer", lambda *_: 0.1)
    u, _ = recorded(pace)
    load = PlacedEffect(
        CATALOGUE["constant_load"], Port("state", 1), (0.0, 1.0), theta=(20.0,), argument_name="level"
    )
    y = make(pace, 1.0, 20).with_effects([load]).simulate(u)
    problem = problem_of(make(pace, 1.0, 1), u, y)
    problem = problem.with_noise(Noise.white(np.array([0.003, 0.003])))
    right = at_measured(problem)._replace(effects=(load,))
    astray = at_measured(problem)._replace(p=np.array([24.0, 1.0]))
    diagnosis = SimpleNamespace(
        problem=problem,
        verdict="explained",
        refitted=SimpleNamespace(model=astray),
        best=SimpleNamespace(fit=SimpleNamespace(model=right), effects=right.effects),
    )
    found, told = mind_steps(diagnosis)
    assert found is diagnosis
    assert too_coarse(problem, astray)
    assert [finding.code for finding in told] == ["coarse_steps"] * (pace > 10)


@pytest.mark.long
def test_the_error_of_long_steps_is_sold_as_no_physics_and_the_advice_ends_it():
    u, y = recorded(18.0)
    effects = ["delay"]  # which would be explained: what a long step does comes as if it were late
    dx = DiscrepancyRegressor(make(17.0, 1.1, 1), effects=effects).fit(u, y)
    assert dx.verdict_ == "unknown"
    assert "may be the error of its own integration steps" in dx.report_.splitlines()[0]
    (told,) = [finding for finding in dx.data_findings_ if finding.code == "coarse_steps"]
    assert told.sentence in dx.report_
    dx = DiscrepancyRegressor(make(17.0, 1.1, told.evidence["substeps"]), effects=effects).fit(u, y)
    assert dx.verdict_ == "refit"
    assert not dx.data_findings_
    assert dx.scores_.loc["refitted", "nrmse"] < 0.007

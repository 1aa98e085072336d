"""Bounds of parameters that exclude what the record tells: told as such, and not sold as physics."""

import numpy as np
import pytest
from small_machines import levels, oscillator

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.bounded import at_bounds, fit_beyond

EFFECTS = ["coulomb_friction", "cubic_stiffness", "creep", "constant_load", "sensor_bias"]
TRUE = {"gain [1/s^2]": 4.4, "damping [1/s]": 1.0, "stiffness [1/s^2]": 20.0}
ALPHA = 0.005


def hard_oscillator(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 2.0 * x[0] ** 3


def make(parameters, equations=oscillator):
    return ODESimulator(
        equations,
        dt=0.02,
        parameters=parameters,
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive"],
    )


def bounded(highest, lowest=3.0, damping=1.1):
    return make(TRUE | {"gain [1/s^2]": (max(4.0, lowest), lowest, highest), "damping [1/s]": damping})


def recorded(seed=0, equations=oscillator, **other):
    rng = np.random.default_rng(seed)
    u = levels(rng, 1500)
    y = make(TRUE | other, equations).simulate(u)
    return u, y + 0.002 * rng.normal(size=y.shape)


def fitted(simulator, u, y):
    windows = cut([(slice(0, len(u)), 0)], 250, 20)
    problem = Problem(simulator, u, y, windows, Noise.white(np.array([0.002])))
    return problem, fit(problem, Model(simulator.nominal, (), np.zeros((windows.count, 2))))


@pytest.mark.long
def test_a_bound_that_excludes_the_truth_is_told_and_no_physics_is_named():
    u, y = recorded()
    dx = DiscrepancyRegressor(bounded(4.2), effects=["coulomb_friction", "creep"]).fit(u, y)
    assert dx.verdict_ == "refit"
    assert not dx.findings_
    (told,) = dx.data_findings_
    assert told.code == "bounds"
    assert told.evidence["side"] == "upper"
    assert told.evidence["bound"] == 4.2
    assert told.evidence["freed"] == pytest.approx(4.4, rel=2e-3)
    assert "gain lies at its upper bound, 4.2 1/s^2. Without that bound it is 4." in dx.report_
    assert "the bound given for gain is too narrow" in dx.report_
    low, high = dx.parameters_.loc["gain", ["augmented_low", "augmented_high"]]
    assert low < 4.4 < high


@pytest.mark.long
def test_bounds_that_hold_the_truth_say_nothing_where_physics_is_missing():
    u, y = recorded(equations=hard_oscillator)
    dx = DiscrepancyRegressor(bounded(4.6, 4.2), effects=EFFECTS).fit(u, y)
    assert dx.verdict_ == "explained"
    assert dx.findings_[0].effect == "cubic_stiffness"
    assert not dx.data_findings_
    assert "bound" not in dx.report_


@pytest.mark.long
def test_a_bound_that_stands_in_the_way_beside_missing_physics_is_told():
    u, y = recorded(equations=hard_oscillator)
    dx = DiscrepancyRegressor(bounded(4.2), effects=EFFECTS).fit(u, y)
    assert dx.verdict_ != "refit"
    (told,) = [finding for finding in dx.data_findings_ if finding.code == "bounds"]
    assert "diagnose again" in told.sentence
    assert dx.report_.count("lies at its upper bound") == 1


@pytest.mark.parametrize("seed", range(4))
def test_what_is_at_its_bound_by_chance_is_no_finding(seed):
    problem, found = fitted(bounded(4.4), *recorded(seed))
    assert fit_beyond(problem, found, ALPHA) is None


def test_no_parameter_is_freed_of_its_sign():
    u, y = recorded(**{"damping [1/s]": (-0.05, -1.0, 1.0)})
    problem, found = fitted(bounded(6.0), u, y)
    (at,) = at_bounds(problem, found)
    assert at.parameter.name == "damping"
    assert at.bound == 0.0
    assert not at.is_given
    assert fit_beyond(problem, found, ALPHA) is None


def test_a_parameter_that_is_held_lies_at_no_bound():
    problem, found = fitted(bounded(4.0, 4.0), *recorded())
    assert not at_bounds(problem, found)


def test_more_than_one_bound_may_be_in_the_way():
    u, y = recorded()
    narrow = {"gain [1/s^2]": (4.0, 3.0, 4.2), "stiffness [1/s^2]": (18.0, 17.0, 18.5)}
    problem, found = fitted(make(TRUE | narrow), u, y)
    beyond = fit_beyond(problem, found, ALPHA)
    assert {(at.parameter.name, at.is_upper) for at in beyond.passed} == {("gain", True), ("stiffness", True)}
    assert beyond.fit.model.p == pytest.approx(list(TRUE.values()), rel=0.02)

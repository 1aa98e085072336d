"""From quiet motion to loud: fitted to the one, scored in the other."""

import numpy as np
import pytest

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.extrapolate import find_amplitudes
from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.stages import judgement
from narx_sklearn.report import render_report

TRUTH = {"gain": 1.1, "damping": 0.7, "stiffness": 11.0}
NOMINAL = {"gain": 1.0, "damping": 0.8, "stiffness": 12.0}


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def hardening(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 15.0 * x[0] ** 3


def stopped(x, u, p):
    beyond = x[0] - 0.6 if x[0] > 0.6 else 0.0
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 60.0 * beyond


def made(rhs, parameters):
    return ODESimulator(rhs, dt=0.05, parameters=parameters, states=["x", "v"], inputs=["u"])


def recorded(rhs, sizes=(0.3, 1.0, 0.5, 1.5), noise=0.005):
    """Return levels of several sizes and what a machine makes of them."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.normal(0, 3, 100 * len(sizes)), 5) * np.repeat(sizes, 500)
    y = made(rhs, TRUTH).simulate(u)
    return u, y + noise * rng.normal(size=y.shape)


def diagnosed(rhs, effects, **record):
    u, y = recorded(rhs, **record)
    return DiscrepancyRegressor(made(stage, NOMINAL), effects=effects).fit(u, y)


@pytest.fixture(scope="module")
def hardens():
    return diagnosed(hardening, ["cubic_stiffness", "quadratic_drag"])


def test_quiet_and_loud_windows_are_told_by_how_far_outputs_go():
    y = np.repeat([1.0, -1.0, 1.2, 3.0, -2.0, 2.0], 10)[:, None] * np.tile([1.0, -1.0], 30)[:, None]
    first = np.arange(0, 60, 10)
    windows = Windows(first, first + 10, first == 0, np.zeros(6, dtype=int))
    problem = Problem(made(stage, TRUTH), np.zeros((60, 1)), y, windows, Noise.white(np.ones(1)))
    found = find_amplitudes(problem)
    spread = np.std(y)
    assert np.allclose(found.reach, np.array([1.0, 1.0, 1.2, 3.0, 2.0, 2.0]) / spread)
    assert found.quiet.tolist() == [True, True, True, False, False, False]  # within 1.6, halfway
    assert found.loud.tolist() == [False, False, False, True, False, False]  # beyond 2.0, a quarter more
    assert not found.present  # one window is not enough


def test_a_window_without_measurements_is_neither_quiet_nor_loud():
    y = np.repeat([1.0, 1.0, np.nan, 3.0, 3.0], 10)[:, None] * np.tile([1.0, -1.0], 25)[:, None]
    first = np.arange(0, 50, 10)
    windows = Windows(first, first + 10, first == 0, np.zeros(5, dtype=int))
    problem = Problem(made(stage, TRUTH), np.zeros((50, 1)), y, windows, Noise.white(np.ones(1)))
    found = find_amplitudes(problem)
    assert not (found.quiet | found.loud)[2]
    assert found.present


@pytest.mark.long
def test_the_right_law_holds_in_louder_motion_and_refitted_parameters_do_not(hardens):
    table = hardens.extrapolation_
    assert table.index.tolist() == ["nominal", "refitted", "augmented"]
    assert table["rmse"]["augmented"] < 1.2 * 0.005  # the noise, and what its parameters are off by
    assert table["rmse"]["augmented"] < 0.05 * table["rmse"]["refitted"]
    assert (table["loud"] > 1.25 * table["quiet"]).all()
    assert 0.9 < table["removed_low"]["augmented"] < table["removed"]["augmented"] <= 1


@pytest.mark.long
def test_a_law_without_a_name_holds_in_louder_motion_too():
    """Without its name the hardening spring is a power, told as one or by the only term of a polynomial."""
    found = diagnosed(hardening, ["clearance"])
    (finding,) = found.findings_
    assert (found.verdict_, finding.effect, finding.port) == ("unknown", "unknown", "state:1")
    assert finding.equation.startswith("x3 x^3, ") or finding.parameters["n"] == pytest.approx(3.0, abs=0.1)
    table = found.extrapolation_
    assert table["rmse"]["augmented"] < 0.1 * table["rmse"]["refitted"]


@pytest.mark.long
def test_a_law_of_another_form_does_not_hold_in_louder_motion(hardens, monkeypatch):
    """A gap with a spring behind it passes for a hardening one on samples of the same size."""
    monkeypatch.setattr(judgement, "best_unnamed", lambda *_: None)
    other = diagnosed(hardening, ["clearance"])
    assert [finding.effect for finding in other.findings_] == ["clearance"]
    held_out, louder = (dx["rmse"]["augmented"] for dx in (other.scores_, other.extrapolation_))
    assert held_out < 0.1 * other.scores_["rmse"]["nominal"]
    assert louder > 0.5 * other.extrapolation_["rmse"]["nominal"]
    assert louder > 10 * hardens.extrapolation_["rmse"]["augmented"]


def test_parameters_alone_extrapolate_where_nothing_is_missing():
    found = diagnosed(stage, ["cubic_stiffness"])
    assert found.verdict_ == "refit"
    rmse = found.extrapolation_["rmse"]
    assert rmse["augmented"] == rmse["refitted"] < 1.1 * 0.005
    assert rmse["nominal"] > 3 * rmse["refitted"]


def test_what_quiet_motion_does_not_show_is_not_extrapolated():
    found = diagnosed(stopped, ["clearance"])
    assert [finding.effect for finding in found.findings_] == ["clearance"]
    assert found.extrapolation_.empty
    assert {"nrmse", "quiet", "loud"} <= set(found.extrapolation_.columns)
    assert "does not show in quiet motion" in found.report_


@pytest.mark.long
def test_motion_of_one_size_is_not_extrapolated():
    t = 0.05 * np.arange(2000)
    u = 3 * np.sin(2.0 * t)
    y = made(hardening, TRUTH).simulate(u) + 0.005 * np.random.default_rng(0).normal(size=(2000, 1))
    found = DiscrepancyRegressor(made(stage, NOMINAL), effects=["cubic_stiffness"]).fit(u[400:], y[400:])
    assert found.extrapolation_.empty
    assert "quiet motion" not in found.report_


@pytest.mark.long
def test_a_consistent_simulation_has_nothing_to_extrapolate():
    u, y = recorded(stage)
    found = DiscrepancyRegressor(made(stage, TRUTH), effects=["cubic_stiffness"]).fit(u, y)
    assert found.verdict_ == "consistent"
    assert found.extrapolation_.empty


@pytest.mark.long
def test_a_drift_is_not_extrapolated():
    u, y = recorded(stage)
    y += 0.2 * np.linspace(0, 1, len(y))[:, None]
    found = DiscrepancyRegressor(made(stage, TRUTH), effects=["additive_drift"]).fit(u, y)
    assert found.findings_[0].effect == "additive_drift"
    assert found.extrapolation_.empty


@pytest.mark.long
def test_the_reports_show_both_sizes_of_motion(hardens):
    assert "Fitted anew to quiet motion alone" in hardens.report_
    page = render_report(hardens, *recorded(hardening))
    assert "Fitted anew to quiet motion alone" in page
    assert "Fitted to quiet motion, run over louder motion" in page

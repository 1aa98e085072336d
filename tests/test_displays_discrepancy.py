"""Figures of a diagnosis: where, what, before and after, look-alikes; their numbers and that they draw."""

import sys

import numpy as np
import pandas as pd
import pytest
from small_machines import held_growing, make_growing

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.before_measuring import confusability
from narx_sklearn.displays import (
    BeforeAfterDisplay,
    ConfusabilityDisplay,
    EffectCurveDisplay,
    LocationDisplay,
)
from narx_sklearn.physics.effects import CATALOGUE

mpl = pytest.importorskip("matplotlib")
TRUTH = {"gain [m/s^2/V]": 1.1, "damping [1/s]": 0.7, "stiffness [1/s^2]": 11.0}
K3 = 15.0
ABOUT = {"dt": 0.05, "states": ["position [m]", "velocity [m/s]"], "inputs": ["drive [V]"]}
EFFECTS = ["cubic_stiffness", "coulomb_friction", "quadratic_drag"]


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def hardening_stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 15.0 * x[0] ** 3


@pytest.fixture(scope="module")
def record():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.normal(0, 3, 150), 10)
    y = ODESimulator(hardening_stage, parameters=TRUTH, **ABOUT).simulate(u)[:, 0]
    return u[:, None], y + 0.002 * rng.normal(size=y.size)


@pytest.fixture(scope="module")
def nominal():
    return ODESimulator(stage, parameters={name: 0.9 * value for name, value in TRUTH.items()}, **ABOUT)


@pytest.fixture(scope="module")
def dx(record, nominal):
    return DiscrepancyRegressor(nominal, effects=EFFECTS, n_leaders=3, max_effects=1).fit(*record)


@pytest.fixture
def plt():
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    yield plt
    plt.close("all")


def test_loud_stretches_of_the_residual_are_shaded(plt):
    rng = np.random.default_rng(0)
    residual = rng.normal(size=4000) * np.where(np.arange(4000) // 1000 == 2, 4.0, 1.0)
    display = LocationDisplay.from_predictions(residual, np.zeros(4000), sampling_period=0.01)
    frame = display.to_frame()
    assert abs(frame.index[frame["segment"] == 0].min() - 2000) < 60
    assert len(display.axes_[1].texts) == len(display.segments) == 1
    assert display.axes_[1].get_xlabel() == "time (s)"
    display.figure_.canvas.draw()


def test_a_fitted_diagnosis_shows_its_recording_over_the_refitted_simulation(plt, dx, record):
    display = LocationDisplay.from_estimator(dx)
    np.testing.assert_array_equal(display.y_true, record[1])
    known = np.isfinite(display.y_pred)
    assert 0.7 < known.mean() < 0.9  # the held-out part is not run
    assert display.axes_[0].get_ylabel() == "position (m)"
    assert display.sampling_period == 0.05
    display.figure_.canvas.draw()


def test_the_curve_of_a_cubic_spring_is_the_cubic_and_the_cloud_lies_on_the_truth(plt, dx):
    assert [finding.effect for finding in dx.findings_] == ["cubic_stiffness"]
    display = EffectCurveDisplay.from_estimator(dx)
    k3 = dx.findings_[0].parameters["k3"]
    np.testing.assert_allclose(display.fitted, -k3 * display.argument**3, rtol=1e-9, atol=1e-12)
    medians = display.medians_
    largest = K3 * np.abs(medians["argument"]).max() ** 3
    assert np.abs(medians["force"] + K3 * medians["argument"] ** 3).max() < 0.1 * largest
    assert display.ax_.get_xlabel() == "position (m)"
    assert display.ax_.get_ylabel() == "added to the rate of velocity (m/s^2)"
    assert display.title == "Cubic stiffness"
    assert list(display.to_frame()) == ["argument", "fitted", "needed"]
    display.figure_.canvas.draw()


def test_the_curve_of_an_input_saturation_is_what_it_takes_off(plt, record, nominal):
    X = record[0]
    clipped = np.clip(X, -4.0, 4.0)
    y = nominal.simulate(clipped)[:, 0]
    y += 0.002 * np.random.default_rng(1).normal(size=y.size)
    dx = DiscrepancyRegressor(nominal, effects=["input_saturation", *EFFECTS], n_leaders=3, max_effects=1)
    dx.fit(X, y)
    display = EffectCurveDisplay.from_estimator(dx)
    low, high, w = (dx.findings_[0].parameters[name] for name in ("low", "high", "w"))
    assert (low, high) == (pytest.approx(-4.0, abs=0.1), pytest.approx(4.0, abs=0.1))
    assert w < 0.1
    np.testing.assert_allclose(  # a rounded corner is w log 2 off at most
        display.fitted, np.clip(display.argument, low, high) - display.argument, atol=w + 1e-12
    )
    assert display.ax_.get_ylabel() == "added to drive (V)"


def test_before_and_after_runs_the_three_simulations_from_their_own_states(plt, dx, record):
    X, y = record[0][1200:], record[1][1200:]
    display = BeforeAfterDisplay.from_estimator(dx, X, y)
    assert list(display.runs) == ["nominal", "refitted", "augmented"]
    errors = display.nrmse_
    assert errors["augmented"] < 0.1 * errors["refitted"] < 0.1 * errors["nominal"]
    assert list(display.to_frame()) == ["recorded", "nominal", "refitted", "augmented"]
    assert display.axes_[0].get_ylabel() == "position (m)"
    halves = BeforeAfterDisplay.from_estimator(dx, X, y, sessions=np.arange(len(y)) // 150)
    assert np.isnan(halves.runs["nominal"]).reshape(2, 150)[:, [0, -1]].tolist() == [[True, False]] * 2
    display.figure_.canvas.draw()


def test_runs_of_an_unstable_machine_begin_anew_before_they_are_lost(plt):
    u, y = held_growing()
    dx = DiscrepancyRegressor(make_growing(), effects=["quadratic_drag"]).fit(u, y)
    display = BeforeAfterDisplay.from_estimator(dx, u, y)
    assert display.nrmse_["refitted"] < 0.05
    assert np.isfinite(display.runs["refitted"]).mean() > 0.6


def test_errors_are_compared_where_every_run_is_known(plt):
    y = np.array([1.0, -1.0, 1.0, -1.0, 50.0])
    runs = {"one": np.zeros(5), "other": np.array([1.0, -1.0, 1.0, -1.0, np.nan])}
    display = BeforeAfterDisplay.from_predictions(y, runs)
    assert display.nrmse_.to_dict() == {"one": 1.0, "other": 0.0}
    assert display.axes_[1].get_xlabel() == "sample"


def test_look_alikes_are_the_pairs_at_small_angles(plt, nominal, record):
    X = record[0][:400]
    display = ConfusabilityDisplay.from_simulator(nominal, X, effects=EFFECTS, noise=0.01)
    angles, _ = confusability(nominal, X, effects=[CATALOGUE[code] for code in EFFECTS], noise=0.01)
    pd.testing.assert_frame_equal(display.to_frame(), angles)
    np.testing.assert_array_equal(display.image_.get_array(), angles)
    n = len(angles)
    assert len(display.ax_.texts) == n * (n - 1)
    everything = ConfusabilityDisplay(angles, alike=91.0).lookalikes_
    assert len(everything) == n * (n - 1) // 2
    assert [pair[2] for pair in everything] == sorted(pair[2] for pair in everything)
    display.figure_.canvas.draw()


def test_what_cannot_be_drawn_is_said(plt, dx, nominal, record):
    with pytest.raises(TypeError, match="ODESimulator holds no diagnosis"):
        LocationDisplay.from_estimator(nominal)
    with pytest.raises(TypeError, match="holds no diagnosis"):
        EffectCurveDisplay.from_estimator(DiscrepancyRegressor(nominal))
    with pytest.raises(TypeError, match="holds no refitted simulation"):
        BeforeAfterDisplay.from_estimator(DiscrepancyRegressor(nominal), *record)
    with pytest.raises(ValueError, match="no stretch without gaps of more than 24 samples: half of them"):
        BeforeAfterDisplay.from_estimator(dx, *(signal[:20] for signal in record))
    with pytest.raises(ValueError, match=r"effect is 1, but the diagnosis \(explained\) added 1 effects"):
        EffectCurveDisplay.from_estimator(dx, effect=1)
    with pytest.raises(ValueError, match="output is 2, but there are 1 outputs"):
        LocationDisplay.from_estimator(dx, output=2)
    with pytest.raises(ValueError, match="The run 'a' has 2 samples, y_true has 3"):
        BeforeAfterDisplay.from_predictions(np.zeros(3), {"a": np.zeros(2)})
    with pytest.raises(ValueError, match=r"There is no effect 'magic' in the catalogue"):
        ConfusabilityDisplay.from_simulator(nominal, record[0], effects=["magic"], noise=0.01)


def test_missing_matplotlib_is_said_with_its_install_name(monkeypatch):
    segments = pd.DataFrame({"start": [0], "stop": [1], "share": [1.0]})
    zeros = np.zeros(20)
    displays = [
        LocationDisplay(zeros, zeros, segments),
        EffectCurveDisplay(np.arange(20.0), zeros, zeros),
        BeforeAfterDisplay(np.arange(20.0), {"nominal": zeros}),
        ConfusabilityDisplay(pd.DataFrame([[0.0]], ["a"], ["a"])),
    ]
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    for display in displays:
        with pytest.raises(ImportError, match=r'pip install "narx-sklearn\[plot\]"'):
            display.plot()

"""Feedback round compensator and plant: the controller's arithmetic, what each part adds, tuning."""

import numpy as np
import pytest

from narx_sklearn.compensation import (
    PID,
    BoucWenCompensator,
    IsolatedCompensator,
    RootCompensator,
    simulate_loop,
    tune_pid,
)
from narx_sklearn.model import NARXModel, Play, free_run
from narx_sklearn.physics import PIEZO_BENCH, BoucWenModel

SINE = 40.0 * np.sin(2.0 * np.pi * np.arange(600) / 300)
ROUGH = BoucWenModel(A=0.8, beta=0.009, gamma=0.008, input_gain=1.6, hysteresis_gain=-1.0)  # a wrong model
DRIFT = 5.0 * np.arange(600) / 600


def test_a_pid_step_by_step():
    # kp e + ki T sum(e) + kd (1 - a) (difference) / T, T = 0.5, a = 0.5
    state = PID(kp=2.0, ki=1.0, kd=0.25, sampling_period=0.5, derivative_filter=0.5).start()
    assert state.step(1.0) == pytest.approx(2.0 + 0.5 + 0.0)
    assert state.step(3.0) == pytest.approx(6.0 + 2.0 + 0.5)
    assert state.step(3.0) == pytest.approx(6.0 + 3.5 + 0.25)


def test_the_integral_does_not_wind_up():
    state = PID(ki=1.0, limits=(-1.0, 1.0)).start()
    for _ in range(100):
        assert state.step(0.3) <= 1.0
    assert state.step(-0.3) == pytest.approx(0.7)


@pytest.mark.parametrize(
    "wrong",
    [
        {"kp": np.nan},
        {"sampling_period": 0.0},
        {"derivative_filter": 1.0},
        {"limits": (1.0, 1.0)},
    ],
)
def test_wrong_gains_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        PID(**wrong)


@pytest.mark.parametrize("n_samples", [1, 2, 3])
def test_a_reference_shorter_than_a_law_looks_ahead_is_held_in_a_loop(n_samples):
    compensator = IsolatedCompensator(NARXModel.from_equations("u[k-5] - 0.5*y[k-1]*u[k-6]")).fit()
    r = np.full(n_samples, 0.6)
    run = simulate_loop(lambda u: u, r, compensator=compensator)
    np.testing.assert_allclose(run.m, compensator.predict(r[:, None]))


@pytest.mark.parametrize("side", ["reference", "disturbance"])
def test_a_loop_takes_no_gaps(side):
    signals = {"reference": np.ones(5), "disturbance": np.zeros(5)}
    signals[side][2] = np.nan
    with pytest.raises(ValueError, match=f"{side} is not finite at sample 2"):
        simulate_loop(lambda u: u, controller=PID(kp=1.0), **signals)


def test_a_linear_loop_follows_its_own_recursion():
    # y[k] = 0.5 m[k], m[k] = r + 0.4 sum of (r - y) up to k-1
    run = simulate_loop(lambda u: 0.5 * u, np.ones(5), controller=PID(ki=0.4))
    y, total = [], 0.0
    for k in range(5):
        total += 0.4 * (1.0 - y[-1]) if k else 0.0
        y.append(0.5 * (1.0 + total))
    np.testing.assert_allclose(run.y, y)
    assert list(run.to_frame()) == ["reference", "y", "measured", "correction", "m"]


def test_without_controller_and_compensator_the_loop_is_the_plant():
    np.testing.assert_allclose(simulate_loop(PIEZO_BENCH, SINE).y, PIEZO_BENCH.run(SINE), atol=1e-9)
    model = NARXModel.from_equations("0.7*y[k-1] + u[k-1] - 0.2*u[k-2]")
    np.testing.assert_allclose(simulate_loop(model, SINE).y, free_run(model, SINE).y[:, 0], atol=1e-9)


def test_compensator_and_feedback_each_take_their_part_of_the_error():
    compensator = BoucWenCompensator(ROUGH).fit()
    setting = {"noise": 0.05, "disturbance": DRIFT, "random_state": 0}
    feedback = PID(kp=0.1, ki=0.1)
    open_loop = simulate_loop(PIEZO_BENCH, SINE, **setting).mape
    only_law = simulate_loop(PIEZO_BENCH, SINE, compensator=compensator, **setting).mape
    only_feedback = simulate_loop(PIEZO_BENCH, SINE, controller=feedback, **setting).mape
    both = simulate_loop(PIEZO_BENCH, SINE, controller=feedback, compensator=compensator, **setting)
    assert only_law < open_loop
    assert both.mape < 0.6 * min(only_law, only_feedback)
    assert both.nsavi < 2.0


def test_tuning_beats_its_cautious_start_and_stays_stable():
    setting = {"noise": 0.05, "disturbance": DRIFT[:200]}
    tuned = tune_pid(PIEZO_BENCH, SINE[:200], max_runs=15, **setting)
    start = PID(kp=0.1, ki=0.05)
    runs = [
        simulate_loop(PIEZO_BENCH, SINE[:200], controller=c, random_state=0, **setting)
        for c in (start, tuned)
    ]
    assert runs[1].mape < runs[0].mape
    assert tuned.kd == 0.0


def test_a_loop_that_is_lost_ends_in_nan():
    run = simulate_loop(lambda u: 3.0 * u, SINE, controller=PID(kp=5.0))
    assert np.isnan(run.y[-1])
    assert run.mape == np.inf


def test_what_a_loop_cannot_take_is_said():
    remembering = NARXModel.from_equations("phi1[k]", phi=[Play("u", radius=1.0)])
    with pytest.raises(ValueError, match="remember"):
        simulate_loop(remembering, SINE)
    with pytest.raises(TypeError, match="stepped"):
        simulate_loop(3.0, SINE)
    with pytest.raises(ValueError, match="disturbance has 2"):
        simulate_loop(PIEZO_BENCH, SINE, disturbance=[1.0, 2.0])
    two = NARXModel.from_equations("u[k-1] + w[k-1]", inputs=["u", "w"])
    with pytest.raises(ValueError, match="a reference only"):
        simulate_loop(PIEZO_BENCH, SINE, compensator=RootCompensator(two).fit())
    with pytest.raises(ValueError, match="kind='pdf'"):
        tune_pid(PIEZO_BENCH, SINE, kind="pdf")

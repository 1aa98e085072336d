"""Simulators that cannot be stepped: a trace, a program; and their NARX twins."""

import pickle

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from narx_sklearn import DiscrepancyRegressor, NARXRegressor, ODESimulator
from narx_sklearn.discrepancy import CallableSimulator, TraceSimulator
from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.surrogates import twin
from narx_sklearn.discrepancy.surrogates.twin import identify_twin
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.physics.effects import CATALOGUE, Effect, EffectParameter, no_start


def bias(signal, second, dt, theta, first):
    return signal + theta[0]


def push(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0]


OFFSET = Effect(
    code="offset",
    title="Offset",
    sentence="A constant is added.",
    equation="b",
    parameters=(EffectParameter("b", "{port}"),),
    starts=no_start,
    force=push,
    transform=bias,
)


def lag(u, parameters):
    a = parameters["pole"]
    return lfilter([0, parameters["gain"] * (1 - a)], [1, -a], u[:, 0])


PROGRAM = CallableSimulator(
    lag, 0.1, {"gain [m/V]": 2.0, "pole": (0.8, 0.0, 1.0)}, ["drive [V]"], ["level [m]"]
)


def excitation(n=300, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, n)


def cubic_record(n=400):
    u = excitation(n)
    y = np.zeros(n)
    for k in range(2, n):
        y[k] = 1.2 * y[k - 1] - 0.5 * y[k - 2] + 0.3 * u[k - 1] - 0.1 * y[k - 1] ** 3
    return u, y


# -- a trace -------------------------------------------------------------------------------------------------


def test_twin_of_a_polynomial_trace_is_exact_and_the_run_is_the_trace():
    u, y = cubic_record()
    sim = TraceSimulator(y, u, dt=0.1)
    assert sim.twin_error_ < 1e-8
    found = {p.name: p.value for p in sim.parameters}
    expected = {"y[k-1]": 1.2, "y[k-2]": -0.5, "u[k-1]": 0.3, "y[k-1]^3": -0.1}
    assert {name: found[name] for name in expected} == pytest.approx(expected, abs=1e-6)
    np.testing.assert_allclose(sim.simulate(u)[:, 0], y, atol=1e-12)


def test_trace_waits_for_its_inputs():
    u, y = cubic_record()
    sim = TraceSimulator(y, dt=0.1)
    assert "without inputs" in repr(sim)
    with pytest.raises(ValueError, match="call identified"):
        sim.known_states(u[:, None], y[:, None], np.array([5]))
    ready = sim.identified(u)
    assert ready.identified(u) is ready
    np.testing.assert_allclose(ready.simulate(u)[:, 0], y, atol=1e-12)


def test_what_the_twin_misses_is_told_and_added_back():
    u = excitation(600)
    y = np.sign(np.convolve(u, np.ones(5))[:600])  # a relay: no polynomial of few lags
    with pytest.warns(NarxWarning, match=r"misses held-out simulated output by \d+"):
        sim = TraceSimulator(y, u, dt=0.1, regressor=NARXRegressor(2, 2, degree=1))
    assert sim.twin_error_ > 0.05
    np.testing.assert_allclose(sim.simulate(u)[:, 0], y, atol=1e-12)


def test_states_where_a_session_begins_are_none_of_the_one_before():
    """What a map remembers would else be where another recording had ended."""
    u, y = cubic_record()
    u, y = np.tile(u, 2)[:, None], np.tile(y, 2)[:, None] + 0.001
    sim = TraceSimulator(y[:, 0], u[:, 0], dt=0.1, sessions=np.repeat([0, 1], 400))
    windows = cut([(slice(0, 400), 0), (slice(400, 800), 400)], 200, 10)
    problem = Problem(sim, u, y, windows, Noise.white([1.0]))
    begin = np.flatnonzero(windows.first == windows.began)
    first, second = problem.measured_x0[0][begin]
    np.testing.assert_array_equal(first, second)
    told = sim.told_states(u, y, windows.first, windows.began)[begin]
    np.testing.assert_array_equal(told[0], told[1])


def test_a_twin_runs_where_it_was_identified_too(monkeypatch):
    """A polynomial through all samples may turn over in a run, on the part that nobody held out."""
    u, y = cubic_record()
    asked = []

    def error_of(model, u, y_sim, labels, chosen):
        asked.append(chosen.copy())
        return np.inf if model.n_terms == most and chosen[0] else 0.0

    most = identify_twin(u, y, dt=0.1).simulator.model.n_terms
    monkeypatch.setattr(twin, "_free_run_error", error_of)
    assert identify_twin(u, y, dt=0.1).simulator.model.n_terms != most
    assert asked[0][0] != asked[1][0]


def test_labels_units_and_sessions_of_a_trace_are_kept():
    u, y = cubic_record()
    frame = pd.DataFrame({"drive [V]": np.tile(u, 2)})
    series = pd.Series(np.tile(y, 2), name="level [m]")
    sessions = np.repeat([0, 1], 400)
    sim = TraceSimulator(series, frame, dt=0.1, sessions=sessions)
    assert [str(s) for s in sim.inputs + sim.outputs] == ["drive [V]", "level [m]"]
    out = sim.simulate(frame, sessions=sessions)
    np.testing.assert_allclose(out["level [m]"], series, atol=1e-12)


def test_trace_goes_on_from_any_window():
    u, y = cubic_record()
    sim = TraceSimulator(y, u, dt=0.1)
    first = np.array([0, 150])
    windows = Windows(first, np.array([150, 400]), np.array([True, False]), np.zeros(2, dtype=np.int64))
    x0 = sim.known_states(u[:, None], y[:, None], first)
    np.testing.assert_allclose(sim.run(u[:, None], windows, x0).y[:, 0], y, atol=1e-9)
    again = pickle.loads(pickle.dumps(sim))
    np.testing.assert_allclose(again.simulate(u)[:, 0], y, atol=1e-12)


def test_misaligned_and_short_traces_are_refused():
    with pytest.raises(ValueError, match="y_sim has 3 samples, u has 5"):
        TraceSimulator(np.zeros(3), np.zeros(5), dt=0.1)
    with pytest.raises(ValueError, match="at least 40 are needed"):
        TraceSimulator(np.zeros(9), np.zeros(9), dt=0.1)
    with pytest.raises(ValueError, match="No NARX model could be identified"):
        TraceSimulator(np.full(100, np.nan), excitation(100), dt=0.1)


# -- a program -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["coloured", "held"])
def test_a_trace_and_an_input_that_are_swapped_are_told_soon(kind):
    rng = np.random.default_rng(0)
    push = {
        "coloured": lfilter([0.3], [1, -0.7], rng.normal(size=2000)),
        "held": np.repeat(rng.normal(size=200), 10),
    }[kind]
    motion = lfilter([0.0, 2e-4, 2e-4], [1.0, -1.968, 0.984], push)
    with pytest.warns(NarxWarning, match="misses held-out simulated output") as told:
        sim = TraceSimulator(push, motion, dt=0.02)
    assert sim.twin_error_ > 0.3
    if sim.twin_error_ > 0.9:
        assert "are u and y_sim swapped" in str(told[0].message)


def test_a_trace_that_follows_nothing_is_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match=r"No NARX model could be identified .* is it noise"):
        TraceSimulator(rng.normal(size=600), np.repeat(rng.normal(size=60), 10), dt=0.02)
    push = rng.normal(size=2000)
    with pytest.raises(ValueError, match="are the two swapped"):
        TraceSimulator(push, lfilter([0.0, 2e-4, 2e-4], [1.0, -1.968, 0.984], push), dt=0.02)


def test_program_is_called_with_its_parameters():
    u = excitation()
    np.testing.assert_array_equal(PROGRAM.simulate(u)[:, 0], lag(u[:, None], {"gain": 2.0, "pole": 0.8}))
    other = PROGRAM.with_parameters({"gain": 3.0})
    np.testing.assert_allclose(other.simulate(u), 1.5 * PROGRAM.simulate(u))


def test_effects_at_inputs_and_outputs_go_through_the_program():
    u = excitation()
    at_input = PlacedEffect(OFFSET, Port("input", 0), theta=(0.5,))
    at_output = PlacedEffect(OFFSET, Port("output", 0), theta=(7.0,))
    for sim in (PROGRAM, PROGRAM.identified(u)):
        np.testing.assert_allclose(
            sim.with_effects([at_input]).simulate(u), PROGRAM.simulate(u + 0.5), atol=1e-12
        )
        np.testing.assert_allclose(
            sim.with_effects([at_output]).simulate(u), PROGRAM.simulate(u) + 7.0, atol=1e-12
        )


def test_effects_at_states_go_through_the_twin():
    u = excitation()
    effect = PlacedEffect(OFFSET, Port("state", 0), weights=(1.0,), theta=(0.1,))
    with pytest.raises(ValueError, match="call identified"):
        PROGRAM.with_effects([effect]).simulate(u)
    sim = PROGRAM.identified(u)  # x' = 10 log(0.8) x + ..., pushed by 0.1 a second
    pushed = sim.with_effects([effect]).simulate(u) - sim.simulate(u)
    settled = 0.1 / (-10 * np.log(0.8))
    expected = settled * (1 - 0.8 ** np.arange(300))
    np.testing.assert_allclose(pushed[:, 0], expected, rtol=1e-4)  # steps of 0.22 time constants


def test_effects_at_states_of_a_narx_twin_act_once_a_sample():
    u = excitation()
    effect = PlacedEffect(OFFSET, Port("state", 0), weights=(1.0,), theta=(0.1,))
    about = (0.1, {"gain [m/V]": 2.0, "pole": (0.8, 0.0, 1.0)}, ["drive [V]"], ["level [m]"])
    sim = CallableSimulator(lag, *about, regressor=NARXRegressor(1, 1, degree=1)).identified(u)
    pushed = sim.with_effects([effect]).simulate(u) - sim.simulate(u)
    np.testing.assert_allclose(pushed[:, 0], 0.1 * (1 - 0.8 ** np.arange(300)) / 0.2, atol=1e-6)


def test_parameters_move_the_program_in_runs_from_any_state():
    u = excitation()[:, None]
    sim = PROGRAM.identified(u)
    y = lag(u, {"gain": 2.0, "pole": 0.8})[:, None]
    first = np.array([0, 100])
    windows = Windows(first, np.array([100, 300]), np.array([True, False]), np.zeros(2, dtype=np.int64))
    x0 = sim.known_states(u, y, first)
    np.testing.assert_allclose(sim.run(u, windows, x0).y, y, atol=1e-9)
    moved = sim.run(u, windows, x0, np.array([2.2, 0.8])).y
    expected = 1.1 * y  # but the second window begins where it was told to, and forgets it at the pole's rate
    expected[100:, 0] += -0.1 * y[100, 0] * 0.8 ** np.arange(200)
    np.testing.assert_allclose(moved, expected, atol=1e-9)


def resonator(x, u, p):
    return x[1], (u[0] - p[1] * x[1] - p[2] * x[0]) / p[0]


MASSES = ODESimulator(
    resonator,
    dt=0.05,
    parameters={"mass [kg]": 2.0, "damping [N*s/m]": 1.0, "stiffness [N/m]": 20.0},
    states=["position [m]", "velocity [m/s]"],
    inputs=["force [N]"],
)


class Machine:
    """A program that counts how often it is called."""

    def __init__(self):
        self.calls = 0

    def __call__(self, u, parameters):
        self.calls += 1
        return MASSES.with_parameters(parameters).simulate(u)

    def simulator(self):
        return CallableSimulator(
            self,
            0.05,
            {f"{p.name} [{p.unit}]": p.value for p in MASSES.parameters},
            ["force [N]"],
            ["position [m]"],
        )


def test_a_twin_follows_the_program_where_its_parameters_go():
    """As the equations themselves would run, the effect too, once it is centred there."""
    u = 10 * np.repeat(excitation(60), 10)[:, None]
    sim = Machine().simulator().identified(u)
    spring = PlacedEffect(CATALOGUE["cubic_stiffness"], Port("state", 1), (1.0, 0.0), theta=(5.0,))
    assert sim.centred(sim.nominal) is sim
    p = np.array([2.2, 0.9, 23.0])
    windows, x0 = Windows.whole([slice(0, 600)]), np.zeros((1, 2))
    true = MASSES.run(u, windows, x0, p, [spring]).y
    spread = true.std()
    far, near = (s.run(u, windows, x0, p, [spring]).y for s in (sim, sim.centred(p)))
    assert np.abs(near - true).max() < 1e-4 * spread
    assert np.abs(far - true).max() > 1e-2 * spread
    assert np.abs(sim.with_parameters(p).simulate(u) - MASSES.with_parameters(p).simulate(u)).max() < 1e-12


@pytest.mark.long
def test_a_diagnosis_asks_the_program_few_times():
    u = 10 * np.repeat(excitation(150), 10)

    def hardened(x, u, p):
        return x[1], (u[0] - p[1] * x[1] - p[2] * x[0] - 8.0 * x[0] ** 3) / p[0]

    true = ODESimulator(
        hardened,
        dt=0.05,
        parameters={"m": 2.3, "d": 0.9, "k": 17.0},
        states=["x", "v"],
        inputs=["u"],
        substeps=4,
    )
    y = true.simulate(u)[:, 0]
    y += 0.01 * y.std() * np.random.default_rng(1).normal(size=y.size)
    program = Machine()
    dx = DiscrepancyRegressor(program.simulator(), effects=["cubic_stiffness", "quadratic_drag"]).fit(u, y)
    assert (dx.verdict_, [f.effect for f in dx.findings_]) == ("explained", ["cubic_stiffness"])
    assert program.calls < 500  # tens of thousands, were every run of a fit a call
    found = dx.parameters_["augmented"]
    np.testing.assert_allclose(found, [2.3, 0.9, 17.0], rtol=0.03)
    assert dx.scores_["nrmse"]["augmented"] < 0.012
    np.testing.assert_allclose(
        dx.simulator_.with_effects(()).simulate(u), MASSES.with_parameters(found).simulate(u), atol=1e-12
    )


def test_wrong_programs_are_named():
    about = (0.1, {"gain": 1.0}, ["u"], ["y"])
    with pytest.raises(RuntimeError, match="raised KeyError: 'mass'"):
        CallableSimulator(lambda u, parameters: parameters["mass"], *about).simulate(np.ones(5))
    with pytest.raises(ValueError, match=r"returned shape \(4,\); wanted is \(5, 1\)"):
        CallableSimulator(lambda u, parameters: np.ones(4), *about).simulate(np.ones(5))
    with pytest.raises(ValueError, match=r"returned None; wanted are outputs of shape \(5,\) or \(5, 1\)"):
        CallableSimulator(lambda u, parameters: None, *about).simulate(np.ones(5))
    with pytest.raises(TypeError, match="simulate must be callable"):
        CallableSimulator(None, *about)
    with pytest.raises(TypeError, match="parameters must map"):
        CallableSimulator(lag, 0.1, [1.0], ["u"], ["y"])


def test_representation_names_the_program_and_its_parameters():
    assert "CallableSimulator of lag, dt=0.1 s" in repr(PROGRAM)
    assert "gain=2 m/V" in repr(PROGRAM)


@pytest.mark.filterwarnings("ignore:The twin of the simulator misses")
@pytest.mark.parametrize(
    ("lags", "code", "cubic", "push", "verdict"),
    [
        pytest.param(2, "cubic_stiffness", 0.05, 0.0, "explained", marks=pytest.mark.long),
        (1, "constant_load", 0.0, 0.03, "unknown"),
    ],
)
def test_an_effect_smaller_than_what_the_twin_misses_is_not_believed(lags, code, cubic, push, verdict):
    """A resonance, of which a twin of one lag misses the most."""
    u = excitation(1500)
    y_sim, y = np.zeros(u.size), np.zeros(u.size)
    for k in range(2, u.size):
        y_sim[k] = 1.6 * y_sim[k - 1] - 0.9 * y_sim[k - 2] + 0.3 * u[k - 1]
        y[k] = 1.6 * y[k - 1] - 0.9 * y[k - 2] + 0.3 * u[k - 1] - cubic * y[k - 1] ** 3 + push
    y += 1e-3 * np.random.default_rng(1).normal(size=u.size)
    trace = TraceSimulator(y_sim, u, dt=0.1, regressor=NARXRegressor(lags, lags, degree=1))
    dx = DiscrepancyRegressor(trace, effects=[code]).fit(u, y)
    assert dx.verdict_ == verdict
    assert ("explains less than that" in dx.report_) == (verdict == "unknown")

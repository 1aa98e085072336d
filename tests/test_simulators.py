"""ODESimulator: runs against exact solutions, mistakes of the user's function, points of rest."""

import copy
import math
import pickle
import types
import warnings

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from joblib.externals.loky.backend.reduction import dumps
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.exceptions import DivergenceWarning, NarxWarning
from narx_sklearn.physics.effects import CATALOGUE

STAGE = {
    "dt": 0.05,
    "parameters": {"gain [m/s^2/V]": 1.0, "damping [1/s]": 0.8, "stiffness [1/s^2]": 12.0},
    "states": ["position [m]", "velocity [m/s]"],
    "inputs": ["drive [V]"],
    "outputs": ["position [m]"],
}
TANK = {"dt": 0.1, "parameters": {"a": 1.0, "b": 0.5}, "states": ["h"], "inputs": ["u"]}
GAIN = {"gain": 1.0}


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def tank(x, u, p):
    return (p[0] * u[0] - p[1] * x[0],)


# -- runs ---------------------------------------------------------------------------------------------------


def test_linear_stage_follows_the_matrix_exponential():
    A, B, dt = np.array([[0, 1], [-12, -0.8]]), np.array([0.0, 1.0]), 0.05
    u = np.random.default_rng(0).normal(size=100)
    step = expm(np.block([[A, B[:, None]], [np.zeros((1, 3))]]) * dt)
    x, expected = np.zeros(2), []
    for value in u:
        expected.append(x[0])
        x = step[:2, :2] @ x + step[:2, 2] * value
    y = ODESimulator(stage, substeps=4, **STAGE).simulate(u)
    np.testing.assert_allclose(y[:, 0], expected, atol=1e-7)  # four steps of order four: (0.17/4)^5


def test_linear_hold_agrees_with_an_independent_solver():
    u, dt = np.random.default_rng(1).normal(size=40), 0.05
    time = dt * np.arange(u.size)
    exact = solve_ivp(
        lambda t, x: stage(x, [np.interp(t, time, u)], [1.0, 0.8, 12.0]),
        (0, time[-1]),
        [0.1, 0.0],
        t_eval=time,
        rtol=1e-10,
        atol=1e-12,
        max_step=dt / 4,
    )
    y = ODESimulator(stage, hold="linear", substeps=4, **STAGE).simulate(u, x0=[0.1, 0.0])
    np.testing.assert_allclose(y[:, 0], exact.y[0], atol=1e-7)


@pytest.mark.parametrize("late", [0.015, 0.035, 0.125])
@pytest.mark.parametrize("code", ["delay", "lag"])
@pytest.mark.parametrize("lacking", [0.0, 1.0])
def test_what_comes_late_of_a_held_input_acts_between_the_samples(code, late, lacking):
    """Against the exact solution on a grid fifty times as fine, within a tenth of what means alone leave."""
    A, b, dt, fine = np.array([[0, 1], [-12, -0.8]]), np.array([0.0, 1.0]), 0.05, 50
    u = np.random.default_rng(2).normal(size=120)
    sent = np.repeat(u, fine)
    if code == "delay":
        arrived = np.concatenate([np.full(round(late / dt * fine), u[0] * (1 - lacking)), sent])[: sent.size]
        system, x = np.block([[A, b[:, None]], [np.zeros((1, 3))]]), np.zeros(2)
    else:
        arrived = sent
        system, x = np.zeros((4, 4)), np.array([0.0, 0.0, u[0] * (1 - lacking)])
        system[:2, :2], system[:2, 2], system[2, 2:] = A, b, [-1 / late, 1 / late]
    step = expm(system * dt / fine)
    exact = []
    for value in arrived:
        exact.append(x[0])
        x = step[: x.size, : x.size] @ x + step[: x.size, x.size] * value
    by_filter = [0.0] if code == "lag" else []
    placed = PlacedEffect(CATALOGUE[code], Port("input", 0), theta=(late, lacking, *by_filter))
    y = ODESimulator(stage, **STAGE).with_effects([placed]).simulate(u)[:, 0]
    changed, _ = CATALOGUE[code].held(u, dt, [late, lacking, *by_filter], [0])
    means = ODESimulator(stage, **STAGE).simulate(changed)[:, 0]
    error, of_means = (np.std(run - exact[::fine]) for run in (y, means))
    assert error < 1e-3 * np.std(exact)
    assert error < 0.1 * of_means


@pytest.mark.parametrize("substeps", [1, 2, 3])
@pytest.mark.parametrize(
    ("code", "theta"), [("delay", (0.035, 0.0)), ("lag", (0.03, 0.0, 0.0)), ("extra_mode", (0.8, 40.0, 0.2))]
)
def test_a_sensor_follows_what_its_signal_does_between_the_samples(code, theta, substeps):
    """Of a pole whose input jumps at the samples; straight lines in between leave over ten times as much."""
    pole, dt, fine = 6.0, 0.05, 200
    u = np.random.default_rng(2).normal(size=(120, 1))
    share = np.arange(fine) / fine
    x, exact = 0.0, []
    for (value,) in u:
        exact.append(value / pole + (x - value / pole) * np.exp(-pole * share * dt))
        x = value / pole + (x - value / pole) * np.exp(-pole * dt)
    effect = CATALOGUE[code]
    exact = effect.transform(np.concatenate(exact), None, dt / fine, theta, [0])[::fine]
    simulator = ODESimulator(
        lambda x, u, p: (u[0] - p[0] * x[0],),
        dt=dt,
        parameters={"pole [1/s]": pole},
        states=["x [V]"],
        inputs=["u [V/s]"],
        substeps=substeps,
    )
    y = simulator.with_effects([PlacedEffect(effect, Port("output", 0), theta=theta)]).simulate(u)[:, 0]
    straight = effect.transform(simulator.simulate(u)[:, 0], None, dt, theta, [0])
    assert np.std(y - exact) < min(0.1 * np.std(straight - exact), 1e-3 * np.std(exact))


def test_python_fallback_runs_as_compiled():
    class Tank:
        def __call__(self, x, u, p):
            self.rate = list(tank(x, u, p))
            return self.rate

    u = np.random.default_rng(0).normal(size=200)
    with pytest.warns(NarxWarning, match="Tank could not be compiled"):
        y = ODESimulator(Tank(), **TANK).simulate(u)
    np.testing.assert_allclose(y, ODESimulator(tank, **TANK).simulate(u), rtol=1e-12, atol=1e-15)


def falls(level):
    return max(level, 0.0)


def outflow(level, width):
    return width * math.sqrt(falls(level))


def factorial(n):
    return 1.0 if n <= 1 else n * factorial(n - 1)


def make_enclosed(scale):
    def inflow(volts):
        return scale * volts

    def enclosed(x, u, p):
        return (p[0] * inflow(u[0]) - p[1] * outflow(x[0], 0.5),)

    return enclosed


def test_functions_that_equations_call_are_compiled_with_them():
    def written_out(x, u, p):
        return (p[0] * 2.0 * u[0] - p[1] * 0.5 * math.sqrt(max(x[0], 0.0)),)

    def recursive(x, u, p):
        return (p[0] * factorial(3) * u[0] / 3.0 - p[1] * outflow(x[0], 0.5),)

    u = np.random.default_rng(0).uniform(size=200)
    expected = ODESimulator(written_out, **TANK).simulate(u)
    simulator = ODESimulator(make_enclosed(2.0), **TANK)
    assert simulator.compiled
    np.testing.assert_allclose(simulator.simulate(u), expected, rtol=1e-12)
    with pytest.warns(NarxWarning, match="recursive could not be compiled"):
        y = ODESimulator(recursive, **TANK).simulate(u)  # a function that calls itself runs as Python
    np.testing.assert_allclose(y, expected, rtol=1e-12)
    assert type(outflow) is type(falls) is types.FunctionType  # they are still what they were


@pytest.mark.parametrize("size", [2, 5000])
def test_what_a_called_function_reads_is_read_anew(size):
    space = {"width": 0.5, "table": np.arange(size, dtype=float)}
    exec(
        "def drains(h):\n    return width * h * table[1]\n"
        "def equations(x, u, p):\n    return (p[0] * u[0] - p[1] * drains(x[0]),)",
        space,
    )
    u = np.random.default_rng(0).uniform(size=50)

    def simulated():
        simulator = ODESimulator(space["equations"], **TANK)
        assert simulator.compiled
        return simulator.simulate(u)

    before = simulated()
    np.testing.assert_array_equal(simulated(), before)
    space["width"] = 1.0
    wider = simulated()
    assert np.abs(wider - before).max() > 0.01
    space["width"], space["table"] = 0.5, 2.0 * np.arange(size)
    np.testing.assert_array_equal(simulated(), wider)


def test_fallback_says_where_a_number_was_not_taken_from_an_array():
    simulator = ODESimulator(lambda x, u, p: (p[0] * u - p[1] * x[0],), **TANK)
    with pytest.warns(NarxWarning, match=r"an array; take numbers by place, such as u\[0\] for u"):
        assert not simulator.compiled


@pytest.mark.parametrize("mixed", [True, False])
def test_a_matrix_of_integers_and_floats_makes_the_compiler_fail_not_the_simulator(mixed):
    zero = 0 if mixed else 0.0

    def second_order(x, u, p):
        A = np.array([[zero, 1.0], [-p[0], -p[1]]])
        return A @ x + u[0]

    def by_rows(x, u, p):
        A = [[0, 1], [-p[0], -p[1]]] if mixed else [[0.0, 1.0], [-p[0], -p[1]]]
        return A[0][1] * x[1] + u[0], A[1][0] * x[0] + A[1][1] * x[1] + u[0]

    what = {"dt": 0.01, "parameters": {"k": 4.0, "d": 0.5}, "states": ["x", "v"], "inputs": ["u"]}
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        runs = [ODESimulator(f, **what).simulate(np.ones(20)) for f in (second_order, by_rows)]
    np.testing.assert_allclose(runs[0], runs[1], rtol=1e-12)
    said = [str(warning.message) for warning in told if warning.category is NarxWarning]
    assert len(said) == mixed  # rows alone: an array of them is made of floats
    assert all("lists that mix integers and floats: write 0.0 for 0 there" in words for words in said)


def test_fallback_says_its_price_once_and_nothing_of_numba_leaks():
    looked_up = {1: 1.0}

    def decay(x, u, p):
        return (-looked_up[1] * x[0],)

    sim = ODESimulator(decay, **TANK)
    with pytest.warns(NarxWarning, match="many times slower") as caught:
        assert not sim.compiled
    assert len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        y = sim.simulate(np.zeros(3), x0=[1.0])
    np.testing.assert_allclose(y[1, 0], 1 - 0.1 + 0.1**2 / 2 - 0.1**3 / 6 + 0.1**4 / 24, rtol=1e-14)


def test_numbers_that_make_no_sense_together_are_tried_without_a_warning():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ODESimulator(lambda x, u, p: (p[0] * np.log(x[0] - u[0]) / (x[0] - u[0]),), **TANK)


def test_bare_number_arrays_and_functions_of_the_output_compile():
    for function in (lambda x, u, p: -p[0] * x[0], lambda x, u, p: -p[0] * x, lambda x, u, p: [-p[0] * x[0]]):
        assert ODESimulator(function, **TANK).compiled
    sim = ODESimulator(
        stage, output=lambda x, u, p: (x[0] + u[0], 2 * x[1]), **STAGE | {"outputs": ["sum [m]", "twice"]}
    )
    y = sim.simulate([1.0, 1.0], x0=[3.0, 4.0])
    assert y[0].tolist() == [4.0, 8.0]


def test_several_inputs_outputs_and_an_ignored_channel():
    def two_tanks(x, u, p):
        return p[0] * u[0] - x[0], p[0] * u[1] + x[0] - x[1]

    sim = ODESimulator(
        two_tanks,
        dt=0.1,
        parameters=GAIN,
        states=["h1", "h2"],
        inputs=["p1", "p2", "temperature [K]"],
        outputs=["h2", "h1"],
    )
    u = np.random.default_rng(2).normal(size=(300, 3))
    y = sim.simulate(u)
    u[:, 2] = 300.0
    np.testing.assert_array_equal(sim.simulate(u), y)
    np.testing.assert_allclose(sim.steady_state([1.0, 2.0, 300.0]), [1.0, 3.0])
    assert not sim.jacobian([0, 0], [0, 0, 0]).B[:, 2].any()


def test_dataframe_in_dataframe_out_columns_by_name():
    sim = ODESimulator(lambda x, u, p: (u[0] - 2 * u[1],), **TANK | {"inputs": ["a [V]", "b [V]"]})
    frame = pd.DataFrame({"b [V]": [1.0, 1.0], "other": [9.0, 9.0], "a [V]": [3.0, 3.0]}, index=[5, 6])
    y = sim.simulate(frame)
    assert list(y.columns) == ["h"]
    assert list(y.index) == [5, 6]
    np.testing.assert_allclose(y["h"], [0.0, 0.1])


def test_sessions_and_gaps_begin_anew():
    sim = ODESimulator(tank, **TANK)
    u = np.ones(9)
    alone = sim.simulate(u[:3], x0=[2.0])[:, 0]
    y = sim.simulate(u, x0=[[2.0], [2.0], [2.0]], sessions=[0] * 3 + [1] * 3 + [2] * 3)[:, 0]
    np.testing.assert_array_equal(y, np.tile(alone, 3))
    u[3] = np.nan
    y = sim.simulate(u, x0=[2.0])[:, 0]
    assert np.isnan(y[3])
    np.testing.assert_array_equal(y[4:7], alone)


def test_windows_of_a_run_join_to_the_whole():
    sim, u = ODESimulator(stage, **STAGE), np.random.default_rng(3).normal(size=(60, 1))
    whole = sim.run(u, Windows.whole([slice(0, 60)]), np.zeros((1, 2)))
    first = np.array([0, 25])
    parts = Windows(first, np.array([25, 60]), np.array([True, False]), np.zeros(2, dtype=np.int64))
    np.testing.assert_array_equal(sim.run(u, parts, whole.x[first]).y, whole.y)


# -- trouble in a run --------------------------------------------------------------------------------------


def test_divergence_names_the_first_lost_sample():
    sim = ODESimulator(lambda x, u, p: (x[0] * x[0],), dt=0.25, parameters={}, states=["x"], inputs=["u"])
    with pytest.warns(DivergenceWarning, match="finite range at sample") as caught:
        y = sim.simulate(np.zeros(40), x0=[1.0])
    k = int(np.flatnonzero(np.isnan(y))[0])
    assert f"at sample {k} (t = {0.25 * k:g} s)" in str(caught[0].message)
    assert np.isnan(y[k:]).all()


@pytest.mark.parametrize("form", [lambda f: f, lambda f: lambda *a, c={"f": f}: c["f"](*a)])
def test_undefined_arithmetic_ends_a_run_with_its_sample(form):
    def drain(x, u, p):
        return (-math.sqrt(x[0]) - 1.0,)

    sim = ODESimulator(form(drain), dt=0.1, parameters={}, states=["h"], inputs=["u"])
    with pytest.warns(NarxWarning) as caught:
        y = sim.simulate(np.zeros(20), x0=[0.5])
    assert any(issubclass(w.category, DivergenceWarning) for w in caught)
    assert np.isfinite(y[:3]).all()
    assert np.isnan(y[-1])


@pytest.mark.filterwarnings("ignore:.*many times slower")
@pytest.mark.parametrize("table", [None, {"a": 1}], ids=["compiled", "python"])
def test_function_that_raises_in_a_run_is_named_with_its_sample(table):
    def fill(x, u, p):
        if x[0] > 2.0 and u[0] > 0.5:
            if table is None:
                raise KeyError("overfull")
            return table["overfull"]
        return (u[0] + 0.0,)

    sim = ODESimulator(fill, dt=1.0, parameters={}, states=["h"], inputs=["u"])
    with pytest.raises(RuntimeError, match=r"raised KeyError: 'overfull', at sample 2 \(t = 2 s\)"):
        sim.simulate(np.ones(6))


def test_index_past_the_end_is_an_error_and_no_garbage():
    def wrong(x, u, p):
        return (x[0] if u[0] < 2 else x[7],)

    sim = ODESimulator(wrong, **TANK)
    with pytest.raises(RuntimeError, match="raised IndexError"):
        sim.simulate(np.full(3, 5.0))


def test_stiff_equations_are_told_with_enough_substeps():
    stiff = TANK | {"parameters": {"a": 1.0, "b": 100.0}}
    with pytest.warns(NarxWarning, match=r"100 1/s.*Try substeps=7"):
        ODESimulator(tank, **stiff).simulate(np.ones(3))
    y = ODESimulator(tank, substeps=7, **stiff).simulate(np.ones(30))
    np.testing.assert_allclose(y[-1, 0], 0.01, rtol=1e-9)


# -- points ------------------------------------------------------------------------------------------------


def test_jacobian_has_the_matrices_of_the_linear_stage():
    A, B, C, D = ODESimulator(stage, **STAGE).jacobian([0.3, -2.0], [5.0])
    np.testing.assert_allclose(A, [[0, 1], [-12, -0.8]], atol=1e-8)
    np.testing.assert_allclose(B, [[0], [1]], atol=1e-8)
    np.testing.assert_allclose(C, [[1, 0]], atol=1e-8)
    np.testing.assert_allclose(D, [[0]], atol=1e-8)
    other = ODESimulator(stage, **STAGE).jacobian([0, 0], [0], [1.0, 2.0, 3.0]).A
    np.testing.assert_allclose(other, [[0, 1], [-3, -2]], atol=1e-8)


@given(st.floats(-3, 3), st.floats(0.2, 5))
def test_steady_state_is_where_a_long_run_ends(u, outflow):
    sim = ODESimulator(tank, **TANK).with_parameters({"b": outflow})
    np.testing.assert_allclose(sim.steady_state([u]), [u / outflow], atol=1e-9)


def test_steady_state_prefers_a_stable_rest_and_says_when_there_is_none():
    def double_well(x, u, p):
        return (x[0] - x[0] ** 3 + u[0],)

    about = {"dt": 0.1, "parameters": {}, "states": ["x"], "inputs": ["u"]}
    rest = ODESimulator(double_well, **about).steady_state([0.0])
    np.testing.assert_allclose(np.abs(rest), [1.0])
    with pytest.raises(ValueError, match="not found to rest anywhere"):
        ODESimulator(lambda x, u, p: (u[0] + 0.0,), **about).steady_state([1.0])
    with pytest.raises(ValueError, match=r"u has shape \(2,\), wanted is \(1,\)"):
        ODESimulator(double_well, **about).steady_state([0.0, 1.0])


# -- mistakes in the arguments -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda x, u, p: (x[0], x[0]), "returned 2 values; wanted are 1 rates"),
        (lambda x, u, p: (x[3],), "raised IndexError"),
        (lambda x, u, p: None, "returned None; wanted are 1 numbers"),
        (lambda x, u: (x[0],), "raised TypeError"),
        (lambda x, u, p: (p["a"] * x[0],), r"by place: x\[0\] is \w+, u\[0\] is \w+, p\[0\] is \w+"),
    ],
)
def test_wrong_functions_are_refused_at_once(function, message):
    with pytest.raises(ValueError, match=message):
        ODESimulator(function, **TANK)


def test_an_error_names_no_more_than_a_few_of_many_arguments():
    many = {"dt": 0.1, "parameters": {}, "states": [f"x{i}" for i in range(20)], "inputs": ["u"]}
    with pytest.raises(ValueError, match=r"x\[7\] is x7, and 12 more in x, u\[0\] is u, p is empty\.$"):
        ODESimulator(lambda x, u, p: x["x0"], **many)


def test_units_may_be_given_by_name():
    named = {"states": {"h": "m"}, "inputs": {"u": ""}, "outputs": {"h": "m"}}
    simulator = ODESimulator(tank, **TANK | named)
    assert simulator.states == simulator.outputs
    assert [(s.name, s.unit) for s in (*simulator.states, *simulator.inputs)] == [("h", "m"), ("u", "")]


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"dt": "0.1"}, TypeError, "dt is the sampling period in seconds, a number; got '0.1'"),
        ({"dt": -1.0}, ValueError, "must be positive"),
        ({"states": "h"}, TypeError, "states must be a list of names"),
        ({"states": {"h": 1.0}}, TypeError, "states must be units by name"),
        ({"states": ["h", "h [m]"]}, ValueError, r"states names \['h'\] twice"),
        ({"inputs": ["u", "u"]}, ValueError, r"inputs names \['u'\] twice"),
        ({"parameters": {"a": 1, "a [m]": 2}}, ValueError, r"parameters names \['a'\] twice"),
        ({"parameters": [1.0]}, TypeError, "parameters must map names to values"),
        ({"parameters": {"a": "much"}}, ValueError, "needs a finite value"),
        ({"parameters": {"a": (2.0, 0.0, 1.0)}}, ValueError, "does not lie between its bounds"),
        ({"output": [1]}, ValueError, r"names the states \[1\]"),
        ({"output": [0.5]}, TypeError, "indices of states or a function"),
        ({"output": [0, 0]}, ValueError, r"outputs names \['h'\] twice"),
        ({"output": tank}, ValueError, "name what it returns"),
        ({"outputs": ["a"], "output": [0, 0]}, ValueError, "measures 2 states, outputs names 1"),
        ({"substeps": 0}, ValueError, "at least 1"),
        ({"hold": "cubic"}, ValueError, "choose one of 'zero', 'linear'"),
    ],
)
def test_wrong_arguments_are_named(change, error, message):
    with pytest.raises(error, match=message):
        ODESimulator(tank, **TANK | change)


def test_wrong_data_are_named():
    sim = ODESimulator(tank, **TANK)
    with pytest.raises(ValueError, match="X has 2 columns, the simulator has 1 inputs"):
        sim.simulate(np.zeros((3, 2)))
    with pytest.raises(ValueError, match=r"x0 has shape \(2,\)"):
        sim.simulate(np.zeros(3), x0=[0.0, 1.0])
    with pytest.raises(ValueError, match=r"Unknown parameters \['c'\]"):
        sim.with_parameters({"c": 1.0})
    with pytest.raises(ValueError, match="Got 5 values for "):
        sim.with_parameters(np.ones(5))
    with pytest.raises(TypeError, match="function must be callable"):
        ODESimulator("tank", **TANK)


# -- as an object ------------------------------------------------------------------------------------------


def test_copies_run_alike_and_parameters_change_only_the_copy():
    sim, u = ODESimulator(stage, **STAGE), np.ones(20)
    y = sim.simulate(u)
    for twin in (copy.deepcopy(sim), pickle.loads(pickle.dumps(sim))):
        np.testing.assert_array_equal(twin.simulate(u), y)
    stiffer = sim.with_parameters({"stiffness": 24.0})
    assert stiffer.simulate(u)[-1, 0] < y[-1, 0]
    same = sim.with_parameters({"stiffness [1/s^2]": 24.0})  # as it was named when it was made
    np.testing.assert_array_equal(same.nominal, stiffer.nominal)
    np.testing.assert_array_equal(sim.simulate(u), y)


def test_functions_of_a_session_go_to_workers_and_are_compiled_once():
    scale = 2.0
    sim = ODESimulator(lambda x, u, p: (scale * u[0] - p[1] * x[0],), **TANK)
    sent = pickle.loads(dumps(sim))  # as joblib's process workers do it
    np.testing.assert_array_equal(sent.simulate(np.ones(10)), sim.simulate(np.ones(10)))
    assert sent.function is not sim.function
    assert sent._equations()[0] is sim._equations()[0]


def test_functions_of_one_code_with_other_constants_are_not_confused():
    def scaled(by):
        return ODESimulator(lambda x, u, p: (by * u[0],), **TANK)

    ends = [scaled(by).simulate(np.ones(2))[-1, 0] for by in (1.0, 3.0, 1.0)]
    np.testing.assert_allclose(ends, [0.1, 0.3, 0.1])


def test_representation_names_signals_and_parameters():
    text = repr(ODESimulator(stage, **STAGE))
    assert "ODESimulator of stage, dt=0.05 s" in text
    assert "stiffness=12 1/s^2" in text

"""NARXSimulator: the map made of a model runs as the model's own free run."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.discrepancy import NARXSimulator
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.model import (
    AsymmetricSign,
    Difference,
    DifferenceSign,
    FunctionPhi,
    HystereticOperator,
    NARXModel,
    Play,
    SmoothSign,
    free_run,
)


def product(a, b):
    return a * b


MODELS = {
    "polynomial": NARXModel.from_equations(
        "0.5*y[k-1] - 0.2*y[k-3] + 0.3*u[k-2]^2*y[k-1] + 0.3*u[k-1] + 0.1"
    ),
    "delay 0 at an operating point": NARXModel.from_equations(
        "0.5*y[k-1] + u[k] + 0.2*u[k-2]*y[k-2]", origin={"y": 2.0, "u": 0.3}
    ),
    "two outputs, two inputs": NARXModel.from_equations(
        {"y": "0.5*y[k-1] + 0.1*z[k-2] + u[k-1]*v[k-1]", "z": "0.3*z[k-1]*u[k-1] - 0.4*y[k-1]"},
        outputs=["y", "z"],
        inputs=["u", "v"],
    ),
    "phi regressors": NARXModel.from_equations(
        "0.8*y[k-1] + 0.3*phi1[k-1] + 0.2*phi2[k-1]*u[k-1] + 0.1*phi3[k-2] + 0.1*phi4[k-2]*y[k-1] "
        "+ 0.05*phi5[k-1]",
        phi=[
            Difference("u"),
            DifferenceSign("u"),
            SmoothSign("y", width=0.3),
            FunctionPhi(product, ["y[k]", "u[k-1]"]),
            AsymmetricSign("u", rising=(0, 1), falling=(-1,)),
        ],
    ),
    "phi regressors with memory": NARXModel.from_equations(
        "0.8*y[k-1] + 0.3*phi1[k] + 0.1*phi2[k-2] + 0.1*phi3[k-2]",
        phi=[Play("u", radius=0.3), Play("y", radius=0.1), HystereticOperator("u")],
    ),
}
per_model = pytest.mark.parametrize("model", MODELS.values(), ids=MODELS)


def record(model, seed=0, n=120):
    return np.random.default_rng(seed).uniform(-0.8, 0.8, (n, len(model.inputs)))


@per_model
def test_run_from_rest_is_the_free_run_from_rest(model):
    u = record(model)
    y = NARXSimulator(model, dt=0.1).simulate(u)
    np.testing.assert_allclose(y, free_run(model, u).y, atol=1e-12)


@per_model
def test_windows_go_on_where_measured_outputs_put_them(model):
    u = record(model)
    y_init = np.random.default_rng(1).uniform(-0.5, 0.5, (model.max_lag, len(model.outputs)))
    y = free_run(model, u, y_init).y
    sim = NARXSimulator(model, dt=0.1)
    first = np.array([model.max_lag, 50])
    windows = Windows(first, np.array([50, 120]), np.array([True, False]), np.zeros(2, dtype=np.int64))
    run = sim.run(u, windows, sim.known_states(u, y, first))
    np.testing.assert_allclose(run.y[model.max_lag :], y[model.max_lag :], atol=1e-12)


@per_model
def test_copies_run_alike_and_the_model_comes_back(model):
    sim, u = NARXSimulator(model, dt=0.1), record(model, n=20)
    assert sim.model == model
    for twin in (copy.deepcopy(sim), pickle.loads(pickle.dumps(sim))):
        np.testing.assert_array_equal(twin.simulate(u), sim.simulate(u))


@given(st.floats(-0.9, 0.9), st.floats(-2, 2))
def test_parameters_are_the_coefficients(pole, gain):
    sim = NARXSimulator(NARXModel.from_equations("0.5*y[k-1] + u[k-1]"), dt=1.0)
    assert [p.name for p in sim.parameters] == ["y[k-1]", "u[k-1]"]
    new = sim.with_parameters({"y[k-1]": pole, "u[k-1]": gain})
    y = new.simulate([0.0, 1.0, 0.0, 0.0])[:, 0]
    np.testing.assert_allclose(y, [0.0, 0.0, gain, pole * gain], atol=1e-15)
    assert new.model.equation()["u[k-1]"] == gain


def test_only_lagged_outputs_are_free():
    sim = NARXSimulator(NARXModel.from_equations("y[k-1] + 0.1*y[k-2] + u[k-3]"), dt=1.0)
    assert [str(s) for s in sim.states] == ["y[k]", "y[k-1]", "u[k-1]", "u[k-2]"]
    assert sim.free_states.tolist() == [True, True, False, False]
    u, y = np.arange(10.0)[:, None], 100 + np.arange(10.0)[:, None]
    known = sim.known_states(u, y, np.array([1, 7]), np.array([0, 6]))
    assert known.tolist() == [[101, 100, 0, 0], [107, 106, 6, 6]]  # held before each session


def test_units_of_coefficients_follow_from_the_signals():
    model = NARXModel.from_equations(
        "0.5*y[k-1] + u[k-1] + 2*u[k-1]^2*y[k-1]", units={"y": "m", "u": "V"}, sampling_period=0.1
    )
    assert [p.unit for p in NARXSimulator(model).parameters] == ["", "m/V", "1/V^2"]


def test_steady_state_rests():
    sim = NARXSimulator(NARXModel.from_equations("0.5*y[k-1] + u[k-2]"), dt=1.0)
    np.testing.assert_allclose(sim.steady_state([1.5]), [3.0, 1.5])


def test_function_that_does_not_compile_runs_as_python():
    table = {1: 2.0}
    model = NARXModel.from_equations(
        "0.5*y[k-1] + phi1[k-1]", phi=[FunctionPhi(lambda v: table[1] * v, ["u[k]"])]
    )
    sim, u = NARXSimulator(model, dt=1.0), np.arange(6.0)
    with pytest.warns(UserWarning, match="NARX model's step could not be compiled"):
        y = sim.simulate(u)
    np.testing.assert_allclose(y, free_run(model, u).y)


def test_wrong_arguments_are_named():
    model = NARXModel.from_equations("0.5*y[k-1] + u[k-1]", sampling_period=0.1)
    with pytest.raises(TypeError, match="pass its model_"):
        NARXSimulator("y[k-1]")
    with pytest.raises(ValueError, match=r"dt is 0.2 s, but the model's sampling_period is 0.1 s"):
        NARXSimulator(model, dt=0.2)
    with pytest.raises(ValueError, match="no sampling_period; pass dt"):
        NARXSimulator(NARXModel.from_equations("0.5*y[k-1] + u[k-1]"))

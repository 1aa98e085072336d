"""Twins in continuous time: what a linear trace says of its equation."""

import numpy as np
import pandas as pd
import pytest

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy import TraceSimulator
from narx_sklearn.discrepancy.findings import parameter_units
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.surrogates.motion import MotionSimulator
from narx_sklearn.physics.effects import CATALOGUE


def slide(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def machine(values, hold="zero", rhs=slide):
    names = ["gain", "damping", "stiffness"]
    return ODESimulator(
        rhs,
        dt=0.02,
        parameters=dict(zip(names, values, strict=True)),
        states=["position", "velocity"],
        inputs=["drive"],
        hold=hold,
        substeps=2,
    )


def drive(n=1500, seed=0):
    return np.repeat(np.random.default_rng(seed).normal(size=n // 10), 10)


@pytest.mark.parametrize("hold", ["zero", "linear"])
@pytest.mark.parametrize("values", [(2.0, 0.5, 30.0), (1.5, 0.8, 0.0), (1.0, 0.0, 0.0)])
def test_a_position_and_its_velocity_stand_behind_a_trace(values, hold):
    """The double integrator and the undamped one too; what is not in the trace is no term."""
    gain, damping, stiffness = values
    u = drive()
    twin = TraceSimulator(machine(values, hold).simulate(u), u, dt=0.02).twin_
    found = {p.name: p.value for p in twin.parameters}
    true = {"y": -stiffness, "y'": -damping, "u": gain}
    assert found == pytest.approx({name: value for name, value in true.items() if value}, rel=1e-4)
    assert twin.linear_hold == (hold == "linear")
    assert [str(s) for s in twin.states] == ["y", "y' [1/s]"]


def test_a_trace_as_it_is_printed_will_do():
    u = drive()
    y = np.array([float(f"{value:.6g}") for value in machine((1.5, 0.8, 0.0)).simulate(u)[:, 0]])
    sim = TraceSimulator(y, u, dt=0.02)
    assert sim.twin_error_ < 1e-5
    np.testing.assert_allclose(sim.twin_.nominal, [-0.8, 1.5], rtol=1e-4)
    np.testing.assert_allclose(sim.simulate(u)[:, 0], y, atol=1e-12)


def test_a_first_order_trace_has_one_state_and_its_rest():
    u = drive()
    y = ODESimulator(
        lambda x, u, p: (p[0] * u[0] - p[1] * (x[0] - 3.0),),
        dt=0.02,
        parameters={"gain": 2.0, "decay": 4.0},
        states=["level"],
        inputs=["drive"],
    ).simulate(u)
    twin = TraceSimulator(y, u, dt=0.02).twin_
    assert {p.name: p.value for p in twin.parameters} == pytest.approx(
        {"y": -4.0, "u": 2.0, "1": 12.0}, rel=1e-4
    )


def test_names_units_inputs_and_sessions():
    inputs = pd.DataFrame({"drive [V]": drive(), "load [N]": drive(seed=1)})
    sim = ODESimulator(
        lambda x, u, p: (x[1], p[0] * u[0] - p[1] * u[1] - 0.6 * x[1] - 20.0 * x[0]),
        dt=0.02,
        parameters={"gain": 2.0, "mobility": 0.5},
        states=["position", "velocity"],
        inputs=["drive", "load"],
    )
    sessions = np.repeat([0, 1], 750)
    y = pd.Series(sim.simulate(inputs.to_numpy(), sessions=sessions)[:, 0], name="stage [m]")
    trace = TraceSimulator(y, inputs, dt=0.02, sessions=sessions)
    assert [str(s) for s in trace.states] == ["stage [m]", "stage' [m/s]"]
    assert {p.name: p.unit for p in trace.parameters} == {
        "stage": "1/s^2",
        "stage'": "1/s",
        "drive": "m/s^2/V",
        "load": "m/s^2/N",
    }
    assert trace.nominal == pytest.approx([-20.0, -0.6, 2.0, -0.5], rel=1e-4)
    np.testing.assert_allclose(trace.simulate(inputs, sessions=sessions)["stage [m]"], y, atol=1e-12)


def test_a_trace_of_higher_order_or_no_motion_is_a_narx_model():
    u = drive()
    y = np.zeros(u.size)
    for k in range(3, u.size):  # a pole on the negative axis, which no motion has
        y[k] = -0.5 * y[k - 1] + 0.2 * y[k - 2] + 0.1 * u[k - 1]
    twin = TraceSimulator(y, u, dt=0.02).twin_
    assert not isinstance(twin, MotionSimulator)
    assert twin.discrete


@pytest.mark.long
def test_friction_is_found_from_a_bare_trace():
    """As with the simulator: in the equation of the velocity, though nobody gave one."""
    u = 3 * drive(3000)

    def rubbing(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 0.6 * np.tanh(x[1] / 1e-3)

    y = machine((2.0, 0.5, 30.0), rhs=rubbing).simulate(u)[:, 0]
    y += 1e-3 * np.random.default_rng(1).normal(size=y.size)
    trace = TraceSimulator(machine((2.0, 0.5, 30.0)).simulate(u)[:, 0], u, dt=0.02)
    dx = DiscrepancyRegressor(trace, effects=["coulomb_friction", "cubic_stiffness", "quadratic_drag"])
    dx.fit(u, y)
    assert (dx.verdict_, dx.findings_[0].effect, dx.findings_[0].port) == (
        "explained",
        "coulomb_friction",
        "state:1",
    )
    assert dx.findings_[0].parameters["Fc"] == pytest.approx(0.6, rel=0.05)
    assert "A twin stands in for it, with the states y and y'" in dx.report_


def test_a_trace_without_inputs_takes_those_of_the_record():
    inputs = pd.DataFrame({"drive [V]": 3 * drive(1000)})
    y_sim = pd.Series(machine((2.0, 0.5, 30.0)).simulate(inputs.to_numpy())[:, 0], name="position [m]")
    y = machine((2.0, 0.5, 36.0)).simulate(inputs.to_numpy())[:, 0]
    y += 1e-3 * np.random.default_rng(1).normal(size=y.size)
    waiting, given = (
        DiscrepancyRegressor(TraceSimulator(y_sim, u, dt=0.02), effects=["cubic_stiffness"]).fit(inputs, y)
        for u in (None, inputs)
    )
    assert waiting.verdict_ == "refit"
    assert [str(s) for s in waiting.simulator_.inputs + waiting.simulator_.outputs] == [
        "drive [V]",
        "position [m]",
    ]
    assert waiting.report_ == given.report_
    np.testing.assert_array_equal(waiting.predict(inputs), given.predict(inputs))
    assert waiting.score(inputs, y) > 0.999
    with pytest.raises(ValueError, match="y_sim has 1000 samples, u has 900"):
        waiting.fit(inputs[:900], y[:900])


@pytest.mark.parametrize(("label", "unit"), [("q", "1/s^2"), ("q [m]", "1/m^2/s^2")])
def test_an_effect_in_the_equation_of_the_rate_has_the_unit_of_an_acceleration(label, unit):
    u = drive(600)
    y = pd.Series(machine((2.0, 0.5, 30.0)).simulate(u)[:, 0], name=label)
    twin = TraceSimulator(y, u, dt=0.02).twin_
    spring = PlacedEffect(
        CATALOGUE["cubic_stiffness"],
        Port("state", 1),
        (1.0, 0.0),
        theta=(1.0,),
        argument_name="q",
        argument_unit=twin.states[0].unit,
    )
    assert parameter_units(spring, twin) == [unit]

"""Friction beside a NARX model: it acts on the rate of the output, from its last two values."""

import numpy as np
import pytest

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy import NARXSimulator
from narx_sklearn.discrepancy.fitting.acting import correction_name, correction_unit, state_forces
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulators.simulator import Windows, evaluate
from narx_sklearn.model import NARXModel
from narx_sklearn.physics.effects import CATALOGUE

DT = 0.1
MASS = NARXSimulator(NARXModel.from_equations("2*y[k-1] - y[k-2] + 0.01*u[k-1]", units={"y": "m"}), dt=DT)
WHOLE = Windows.whole([slice(0, 40)])


def rubbing(code, theta, dt=DT):
    return PlacedEffect(
        CATALOGUE[code],
        Port("state", 0),
        (1 / dt, -1 / dt),
        theta=theta,
        argument_name="rate of y",
        argument_unit="m/s",
        inertial=True,
    )


def test_a_sliding_mass_slows_down_and_stays():
    """From 1 m/s at 1 m/s^2: each step 0.01 m shorter than the last, until there is none."""
    run = MASS.run(
        np.zeros((40, 1)), WHOLE, np.array([[0.0, -0.1]]), None, [rubbing("coulomb_friction", (1.0,))]
    )
    expected = np.cumsum([0.0, *np.arange(0.09, 0.005, -0.01), *np.zeros(30)])
    np.testing.assert_allclose(run.y[:, 0], expected, atol=1e-12)


@pytest.mark.parametrize(("force", "gained"), [(0.99, 0.0), (1.3, 0.3)])
def test_a_mass_at_rest_moves_when_it_is_pushed_harder_than_friction_holds(force, gained):
    run = MASS.run(
        np.full((40, 1), force), WHOLE, np.zeros((1, 2)), None, [rubbing("coulomb_friction", (1.0,))]
    )
    np.testing.assert_allclose(np.diff(run.y[:, 0], 2)[1:], 0.01 * gained, atol=1e-12)
    assert (run.y[-1, 0] > 0) == (gained > 0)


@pytest.mark.parametrize(
    ("code", "theta"),
    [
        ("coulomb_friction", (0.7,)),
        ("quadratic_drag", (0.8,)),
        ("presliding_friction", (0.7, 0.02, 1.2, 0.3, 0.0)),
    ],
)
def test_forces_are_those_the_run_adds(code, theta):
    u = np.random.default_rng(0).normal(size=(40, 1))
    sim = MASS.with_effects([rubbing(code, theta)])
    run = sim.run(u, WHOLE, np.array([[0.3, 0.25]]))
    rows = np.arange(39)
    argument, force = state_forces(sim, run, u, WHOLE, rows)[0]
    before = (run.x[rows, 0] - run.x[rows, 1]) / DT
    free = (2 * run.x[rows, 0] - run.x[rows, 1] + 0.01 * u[rows, 0] - run.x[rows, 0]) / DT
    np.testing.assert_allclose(argument, (before + free) / 2, atol=1e-12)
    added = np.array([run.x[k + 1, 0] - evaluate(sim, run.x[k], u[k])[0][0] for k in rows])
    np.testing.assert_allclose(DT**2 * force, added, atol=1e-12)
    placed = sim.effects[0]
    assert (correction_name(placed, sim), correction_unit(placed, sim)) == (
        "added to the acceleration of y[k]",
        "m/s^2",
    )


def test_a_memory_lives_in_time_whatever_the_period():
    """Bouc-Wen's element along the straight lines between the samples, as it is at a signal."""
    effect = CATALOGUE["bouc_wen_hysteresis"]
    u = np.cumsum(0.2 * np.random.default_rng(0).normal(size=(40, 1)), axis=0)
    theta = (1e-6, 0.8, 0.2, 1.0, 0.0)
    placed = PlacedEffect(effect, Port("state", 0), (1.0,), theta=theta)
    for dt in (0.01, 10.0):
        follower = NARXSimulator(NARXModel.from_equations("u[k-1]"), dt=dt)
        run = follower.run(u, WHOLE, u[:1], None, [placed])
        along = (run.y[:, 0] - effect.transform(run.y[:, 0], None, dt, np.array(theta), [0])) / theta[0]
        np.testing.assert_allclose(run.z[:, 0], along, atol=0.02 * np.abs(along).max())


@pytest.mark.long
def test_friction_of_a_machine_is_found_beside_its_narx_model():
    """With the level that the machine has, in its acceleration's unit."""
    dt, rng = 0.02, np.random.default_rng(0)
    u = np.repeat(rng.uniform(-3, 3, 150), 20)

    def machine(x, u, p):
        return x[1], 10 * u[0] - 1.2 * x[1] - 40 * x[0] - 2.0 * np.tanh(x[1] / 1e-3)

    truth = ODESimulator(machine, dt=dt, parameters={}, states=["x", "v"], inputs=["u"], substeps=40)
    y = truth.simulate(u)[:, 0]
    y += 0.01 * y.std() * rng.standard_normal(y.size)
    # the frictionless machine, sampled, with a gain and a stiffness that are not right
    model = NARXModel.from_equations("1.965*y[k-1] - 0.977*y[k-2] + 0.0018*u[k-1] + 0.0018*u[k-2]")
    dx = DiscrepancyRegressor(
        NARXSimulator(model, dt=dt),
        effects=["coulomb_friction", "cubic_stiffness", "quadratic_drag", "backlash", "dead_zone"],
        max_effects=1,
    ).fit(u, y)
    first = dx.findings_[0]
    assert (first.effect, first.port) == ("coulomb_friction", "state:0")
    assert first.parameters["Fc"] == pytest.approx(2.0, rel=0.1)
    assert "v = rate of y[k]" in dx.report_

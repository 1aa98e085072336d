"""Outputs that see how fast the states change, forces that were not in the simulation and all."""

import pickle

import numpy as np
import pytest
from numpy.testing import assert_allclose
from small_machines import levels

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.locate import tangent
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port, Span
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.followed import response
from narx_sklearn.discrepancy.stages.pulse import gradients_by_force
from narx_sklearn.model.simulation import free_run
from narx_sklearn.physics.effects import CATALOGUE

DT = 0.02
NOMINAL = {"gain [m/s^2/V]": 1.0, "damping [1/s]": 0.8, "stiffness [1/s^2]": 60.0}


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def acceleration(x, u, p, rates):
    return (rates[1],)


def written_out(x, u, p):
    """The same by the equations, which is taken for the rate that it repeats."""
    return (p[0] * u[0] - p[1] * x[1] - p[2] * x[0],)


def make(rhs=stage, output=acceleration, parameters=NOMINAL, dt=DT, **settings):
    return ODESimulator(
        rhs,
        dt=dt,
        parameters=parameters,
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
        output=output,
        outputs=["acceleration [m/s^2]"],
        **settings,
    )


def drive(n=600, seed=0):
    return levels(np.random.default_rng(seed), n)


def at_velocity(code, *theta, weights=(1.0, 0.0)):
    return PlacedEffect(CATALOGUE[code], Port("state", 1), weights, theta=theta)


def whole(n=600):
    return Windows.whole([slice(0, n)])


@pytest.mark.parametrize("settings", [{}, {"substeps": 3}, {"hold": "linear"}])
def test_without_effects_the_rates_are_those_of_the_equations(settings):
    seen, written = (make(output=output, **settings) for output in (acceleration, written_out))
    assert seen.sees_rates
    assert written.sees_rates
    assert_allclose(seen.simulate(drive()), written.simulate(drive()), rtol=1e-12, atol=1e-12)


def test_a_force_of_an_effect_is_seen_at_once():
    run = make().with_effects([at_velocity("cubic_stiffness", 30.0)]).run(drive(), whole(), np.zeros((1, 2)))
    x, v = run.x.T
    assert_allclose(run.y[:, 0], drive()[:, 0] - 0.8 * v - 60.0 * x - 30.0 * x**3, atol=1e-9)
    assert np.abs(30.0 * x**3).max() > 0.01


def test_what_sticks_is_not_accelerated_and_what_slides_is_braked():
    friction = at_velocity("coulomb_friction", 2.0, weights=(0.0, 1.0))
    run = make().with_effects([friction]).run(drive(), whole(), np.zeros((1, 2)))
    x, v = run.x.T
    stuck, slides = np.abs(v) < 1e-9, np.abs(v) > 0.2
    stuck &= np.abs(drive()[:, 0] - 60.0 * x) < 1.9
    assert stuck.sum() > 20
    assert slides.sum() > 20
    assert np.abs(run.y[stuck]).max() < 1e-6
    braked = drive()[:, 0] - 0.8 * v - 60.0 * x - 2.0 * np.sign(v)
    assert_allclose(run.y[slides, 0], braked[slides], atol=1e-9)


@pytest.mark.parametrize("output", [acceleration, written_out])
def test_a_sensor_with_a_lag_follows_what_is_seen_within_the_steps(output):
    """Bends between samples, and jumps where the held drive does."""
    lag = PlacedEffect(CATALOGUE["lag"], Port("output", 0), theta=(0.05, 0.0, 0.0))
    coarse = make(output=output).with_effects([lag]).simulate(drive())
    fine = make(output=output, dt=DT / 20).with_effects([lag]).simulate(np.repeat(drive(), 20, axis=0))
    assert np.abs(coarse - fine[::20]).max() < 5e-4 * np.std(fine)


def test_what_does_not_compile_sees_rates_too():
    def in_python(x, u, p, rates):
        return [float(f"{rates[1]:.17g}")]

    with pytest.warns(match="runs as Python"):
        slow = make(output=in_python).simulate(drive(60))
    assert_allclose(slow, make().simulate(drive(60)), rtol=1e-12)


def test_it_is_compiled_whatever_is_compiled_already():
    numba = pytest.importorskip("numba")
    compiled = make(output=numba.njit(acceleration))
    assert compiled.sees_rates
    assert_allclose(compiled.simulate(drive(60)), make().simulate(drive(60)))


def test_a_default_value_is_no_rate():
    def scaled(x, u, p, factor=2.0):
        return (factor * x[0],)

    assert not make(output=scaled).sees_rates


def test_it_goes_through_pickle():
    again = pickle.loads(pickle.dumps(make()))
    assert again.sees_rates
    assert_allclose(again.simulate(drive(60)), make().simulate(drive(60)))


def out_of_reach(x, u, p, rates):
    return (rates[2],)


@pytest.mark.parametrize(
    ("output", "message"),
    [
        (out_of_reach, r"output\(x, u, p, rates\) raised IndexError"),
        (lambda x, u, p, rates: (rates[0], rates[1]), r"output\(x, u, p, rates\) returned 2 values"),
        (lambda x, u: (x[0],), r"output\(x, u, p\) raised TypeError"),
    ],
)
def test_a_mistake_is_told_at_once(output, message):
    with pytest.raises(ValueError, match=message):
        make(output=output)


def test_the_jacobian_holds_what_passes_through():
    linear = make().jacobian([0.1, 0.2], [1.0])
    assert_allclose(linear.C, [[-60.0, -0.8]], atol=1e-6)
    assert_allclose(linear.D, [[1.0]], atol=1e-6)


def test_the_tangent_holds_what_a_force_shows_at_once():
    u = drive()
    run = make().run(u, whole(), np.zeros((1, 2)))
    linear = tangent(make(), run, u, whole())
    assert_allclose(linear.F, np.broadcast_to([[[0.0, 1.0]]], linear.F.shape), atol=1e-7)
    assert tangent(make(output=lambda x, u, p: (p[0] * x[1],)), run, u, whole()).F is None
    # a load of 0.01 from sample 200 on
    load = at_velocity("constant_load", 0.01)
    forces = 0.01 * (np.arange(600) >= 200)[:, None]
    problem = Problem(make(), u, run.y, cut([(slice(0, 600), 0)], 600, 8), Noise.white(np.ones(1)))
    acting = PlacedEffect(load.effect, load.port, load.weights, theta=load.theta, during=Span(200 * DT, 1e9))
    expected = make().with_effects([acting]).simulate(u) - run.y
    assert_allclose(response(problem, linear, Port("state", 1), forces)[:, :, 0], expected, atol=1e-6)


def test_the_gradient_by_forces_is_that_of_their_answers():
    rng = np.random.default_rng(3)
    u = drive()
    run = make().run(u, whole(), np.zeros((1, 2)))
    problem = Problem(make(), u, run.y, cut([(slice(0, 600), 0)], 200, 4), Noise.white(np.ones(1)))
    linear = tangent(
        make(), problem.run(Model(make().nominal, (), run.x[problem.windows.first])), u, problem.windows
    )
    e, forces = (
        rng.normal(size=(*problem.rows.shape, 1)).reshape(len(problem.rows), -1),
        rng.normal(size=(600, 5)),
    )
    answers = response(problem, linear, Port("state", 1), forces)
    expected = [np.sum(e * problem.whiten(answers[:, :, j])) for j in range(5)]
    gradient = gradients_by_force(problem, linear, e[:, :, None])[Port("state", 1)][problem.inside, 0]
    assert gradient @ forces[problem.rows[problem.inside]] == pytest.approx(expected, rel=1e-6)


@pytest.fixture(scope="module")
def hardened():
    """A spring that hardens, seen by an accelerometer."""

    def spring(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 900.0 * x[0] ** 3

    u = drive(1500)
    true = dict(zip(NOMINAL, (1.1, 0.7, 56.0), strict=True))
    y = make(spring, parameters=true, substeps=5).simulate(u)
    return u, y + 0.01 * y.std() * np.random.default_rng(1).normal(size=y.shape)


@pytest.fixture(scope="module")
def diagnosed(hardened):
    effects = ["cubic_stiffness", "coulomb_friction", "quadratic_drag", "input_saturation"]
    return DiscrepancyRegressor(make(), effects=effects).fit(*hardened)


@pytest.mark.long
def test_a_spring_that_hardens_is_named_and_placed(hardened, diagnosed):
    _, y = hardened
    (finding,) = diagnosed.findings_
    assert (diagnosed.verdict_, finding.effect, finding.port) == ("explained", "cubic_stiffness", "state:1")
    assert finding.parameters["k3"] == pytest.approx(900.0, rel=0.05)
    noise = 0.01 * y.std() / y[1200:].std()  # where it is scored, from a state that noise hides
    assert diagnosed.scores_.loc["augmented", "nrmse"] < 1.15 * noise
    best = diagnosed.location_.ports.iloc[0]
    assert (best["kind"], best["index"]) == ("state", 1)


@pytest.mark.long
def test_a_narx_model_of_it_reads_the_present_input(hardened, diagnosed):
    u = 0.5 * hardened[0]
    y = diagnosed.simulator_.simulate(u)

    def missed(model):
        return np.std(free_run(model, u, y[:2]).y[10:] - y[10:]) / np.std(y)

    assert missed(diagnosed.to_narx(u)) < 0.05
    assert missed(diagnosed.to_narx(u, delay=1)) > 0.2  # the drive jumps, and pushes at once

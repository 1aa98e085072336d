"""Initial states that nobody measured: a fit that ended on the wrong side is begun anew on others."""

import numpy as np
import pytest
from small_machines import levels

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.fitting import sides
from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.sides import from_other_sides
from narx_sklearn.discrepancy.fitting.start import fit_initial_states
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.verify import Lead, Stretch, free_run, on_held_out

SIGMA = 1e-3


def coil(x, u, p):
    return (u[0] - p[0] * x[0],)


def pendulum(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * np.sin(x[0])


def squared(x, u, p):
    return (x[0] * x[0],)


def cosine(x, u, p):
    return (np.cos(x[0]),)


def make_coil():
    """Return a coil of time constant 1 s, of which the heating power is measured: the current's square."""
    asked = {"parameters": {"rate": 1.0}, "states": ["current [A]"], "inputs": ["drive"]}
    return ODESimulator(coil, dt=0.1, output=squared, outputs=["power"], **asked)


def make_pendulum():
    parameters = {"gain": 4.0, "damping": 0.5, "weight": 20.0}
    asked = {"states": ["angle [rad]", "speed [rad/s]"], "inputs": ["drive"]}
    return ODESimulator(pendulum, dt=0.02, parameters=parameters, output=cosine, outputs=["height"], **asked)


def heated(begins, n=40):
    """Return the problem of windows in which a coil is driven by 1, and its current at their ends.

    Begun at -2 the current is 1 - 3 exp(-t): the power falls to nothing at log 3, and rises again. Of all
    that begins above nothing, 1.18 comes nearest, and a fit that begins there stays.
    """
    simulator, count = make_coil(), len(begins)
    first = n * np.arange(count)
    windows = Windows(first, first + n, np.ones(count, dtype=bool), first)
    u = np.ones((n * count, 1))
    y = simulator.run(u, windows, np.array(begins)[:, None]).y
    return Problem(simulator, u, y, windows, Noise.white(np.array([SIGMA])))


class TestFromOtherSides:
    def test_a_square_tells_no_sign_but_its_course_does(self):
        problem = heated([-2.0])
        t = 0.1 * np.arange(40)
        np.testing.assert_allclose(problem.y[:, 0], (1.0 - 3.0 * np.exp(-t)) ** 2, atol=1e-4)  # steps of 0.1
        one_side = fit_initial_states(problem, np.array([[2.0]]))
        assert one_side.model.x0[0, 0] == pytest.approx(1.18, abs=0.005)
        found = from_other_sides(problem, one_side)
        assert found.model.x0[0, 0] == pytest.approx(-2.0, abs=1e-5)
        assert found.cost < 1e-3

    def test_windows_that_keep_noise_alone_stay(self):
        problem = heated([-2.0, 2.0])
        begun = fit_initial_states(problem, np.array([[1.0], [2.1]]))
        found = from_other_sides(problem, begun)
        np.testing.assert_allclose(found.model.x0[:, 0], [-2.0, 2.0], atol=1e-5)
        good = fit_initial_states(problem, np.array([[-2.1], [2.1]]))
        assert from_other_sides(problem, good) is good

    def test_what_is_measured_is_on_its_side(self, monkeypatch):
        asked = {"parameters": {"rate": 1.0}, "states": ["current [A]"], "inputs": ["drive"]}
        simulator = ODESimulator(coil, dt=0.1, output=(0,), **asked)
        u = np.ones((40, 1))
        problem = Problem(simulator, u, -u, Windows.whole([slice(0, 40)]), Noise.white(np.array([SIGMA])))
        begun = fit_initial_states(problem, np.array([[-1.0]]))
        assert begun.cost > 100.0 * problem.n_seen  # no start makes it stay at -1
        for name in ("_mirrored", "_reached", "_visited"):
            monkeypatch.setattr(sides, name, None)
        assert from_other_sides(problem, begun) is begun

    def test_a_run_that_is_lost_is_begun_where_it_is_not(self):
        def bursting(x, u, p):
            return (u[0] - p[0] * x[0] + x[0] * x[0] * x[0],)

        asked = {"parameters": {"rate": 1.0}, "states": ["current [A]"], "inputs": ["drive"]}
        simulator = ODESimulator(bursting, dt=0.1, output=squared, outputs=["power"], **asked)
        windows = Windows(np.array([0, 40]), np.array([40, 80]), np.ones(2, dtype=bool), np.array([0, 0]))
        u = np.repeat(np.array([0.1, -0.2, 0.3, 0.1, -0.3, 0.2, -0.1, 0.1]), 10)[:, None]
        run = simulator.run(u, Windows.whole([slice(0, 80)]), np.array([[0.3]]))
        problem = Problem(simulator, u, run.y, windows, Noise.white(np.array([SIGMA])))
        begun = fit_initial_states(problem, np.array([[0.3], [9.0]]))
        assert not np.isfinite(begun.cost)
        found = from_other_sides(problem, begun)
        assert found.model.x0[1, 0] == pytest.approx(run.x[40, 0], abs=1e-4)


@pytest.mark.parametrize(
    ("make", "seed"), [(make_coil, 1), (make_coil, 3), (make_pendulum, 0), (make_pendulum, 2)]
)
def test_a_sensor_that_is_even_refutes_no_right_simulator(make, seed):
    """One guess for all held-out windows is on the wrong side of some of them."""
    rng = np.random.default_rng(seed)
    simulator, u = make(), levels(rng, 1500)
    whole = simulator.run(u, Windows.whole([slice(0, 1500)]), np.zeros((1, len(simulator.states))))
    sigma = 0.01 * np.std(whole.y)
    y = whole.y + sigma * rng.normal(size=(1500, 1))
    windows = cut([(slice(0, 1200), 0)], 60, 8)
    problem = Problem(simulator, u, y, windows, Noise.white(np.array([sigma])))
    guess, lead = whole.x[1140], Lead(windows, whole.x[windows.first])
    held = on_held_out(problem, simulator, simulator, [(slice(1200, 1500), 0)], (guess, guess), lead)
    assert held.without == pytest.approx(1.0, abs=0.3)  # 300 samples: a deviation of 0.08
    assert held.left == pytest.approx(1.0, abs=0.3)
    run = free_run(simulator, u, y, Stretch(slice(1200, 1500), 0, 60), guess)
    assert np.std(run.y[60:] - y[1260:]) < 1.5 * sigma

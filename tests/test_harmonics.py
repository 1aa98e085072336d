"""What swings by itself and not as a sine is one disturbance, not a sine for each of its harmonics."""

import numpy as np
import pytest
from small_machines import levels, make_oscillator

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.harmonics import MOST, course, with_harmonics, with_one_course
from narx_sklearn.discrepancy.simulators.kernels import MAX_THETA
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.physics.effects import CATALOGUE

N, DT = 1200, 0.02
NOISE = 0.02
W = 2 * np.pi * 0.4
ALPHA = 0.01


SENSOR = Port("output", 0)


def sine(size, w, p, port=SENSOR):
    return PlacedEffect(CATALOGUE["periodic_disturbance"], port, theta=(size, w, p))


def fitted(off, *sets, seed=0, again=N):
    """Return the problem of an oscillator whose position is off by a course in time, and fitted sets.

    It is driven alike every ``again`` samples.
    """
    rng = np.random.default_rng(seed)
    u = np.resize(levels(rng, again), (N, 1))
    y = make_oscillator().simulate(u) + NOISE * rng.normal(size=(N, 1)) + off(np.arange(N) * DT)[:, None]
    simulator = make_oscillator()
    windows = cut([(slice(0, N), 0)], 300, 12)
    problem = Problem(simulator, u, y, windows, Noise.white(np.array([NOISE])))
    start = Model(simulator.nominal, (), np.zeros((windows.count, 2)))
    nothing, *found = (fit(problem, start._replace(effects=effects)) for effects in ((), *sets))
    return problem, nothing.cost, *(Candidate(one, problem.n_seen) for one in found)


def sawtooth(t):
    return 0.1 * sum(np.sin(n * W * t + 0.3 * n) / n for n in (1, 2, 3))


class TestCourse:
    def test_a_square_wave_is_made_of_odd_harmonics(self):
        ratios = [(1 / n, 0.0) if n % 2 else (0.0, 0.0) for n in range(2, MOST + 1)]
        t = np.linspace(0.0, 2.0, 801)
        theta = (4 / np.pi, np.pi, 0.0, *np.ravel(ratios))
        flat = np.abs(np.abs((t % 1.0) - 0.5)) < 0.3
        assert course(t, theta)[flat] == pytest.approx(np.where(t % 2.0 < 1.0, 1.0, -1.0)[flat], abs=0.25)

    @pytest.mark.parametrize("most", [2, MOST])
    def test_forces_and_signals_are_off_by_the_same(self, most):
        rng = np.random.default_rng(0)
        placed = with_harmonics(sine(0.5, 3.0, 0.4), most, rng.normal(size=2 * (most - 1)))
        padded = np.zeros(MAX_THETA)
        padded[: placed.n_theta] = placed.theta
        t = np.arange(50) * 0.1
        along = placed.effect.transform(np.zeros(50), None, 0.1, np.array(placed.theta), [0])
        for theta in (padded, np.array(placed.theta)):
            forces = [placed.effect.force(0, 0, 0, 0, at, 0.1, None, theta, None) for at in t]
            assert forces == pytest.approx(along, abs=1e-12)
        assert along == pytest.approx(course(t, placed.theta), abs=1e-12)

    def test_half_a_turn_on_with_the_other_sign_it_is_the_same(self):
        placed = with_harmonics(sine(-0.5, 3.0, 0.4), 3, (0.3, -0.2, 0.1, 0.4))
        turned = placed.with_positive_amplitude()
        t = np.linspace(0.0, 5.0, 50)
        assert turned.theta[0] == 0.5
        assert course(t, turned.theta) == pytest.approx(course(t, placed.theta))


class TestWithOneCourse:
    def test_sines_that_are_harmonics_become_one(self):
        sines = sine(0.1, W, 0.3), sine(0.05, 2 * W, 0.6)
        problem, nothing, two = fitted(sawtooth, sines)
        found = with_one_course(problem, two, [two], nothing, ALPHA)
        (placed,) = found.effects
        t = np.arange(N) * DT
        assert placed.effect.code == "periodic_disturbance"
        assert len(placed.theta) == 7
        assert course(t, placed.theta) == pytest.approx(sawtooth(t), abs=0.01)
        assert found.criterion < two.criterion

    def test_a_sine_gets_the_harmonics_that_are_there(self):
        problem, nothing, one = fitted(sawtooth, (sine(0.1, W, 0.3),))
        (placed,) = with_one_course(problem, one, [one], nothing, ALPHA).effects
        assert len(placed.theta) == 7

    def test_what_may_act_elsewhere_does_so_in_the_same_form(self):
        at_state = sine(1.0, W, 0.3, Port("state", 1))
        problem, nothing, one, other = fitted(sawtooth, (sine(0.1, W, 0.3),), (at_state,))
        pool = [one, other]
        with_one_course(problem, one, pool, nothing, ALPHA)
        formed = [c for c in pool if len(c.effects[0].theta) == 7]
        assert {c.effects[0].port.kind for c in formed} == {"output", "state"}

    def test_what_is_larger_than_the_first_is_no_harmonic_of_it(self):
        def off(t):
            return 0.05 * np.sin(W * t) + 0.1 * np.sin(3 * W * t)

        problem, nothing, one = fitted(off, (sine(0.05, W, 0.0),))
        assert with_one_course(problem, one, [one], nothing, ALPHA) is one

    @pytest.mark.parametrize("turns", [1, 2])
    def test_where_the_machine_repeats_itself_as_often_a_sine_stays_one(self, turns):
        again = turns * round(2 * np.pi / W / DT)
        problem, nothing, one = fitted(sawtooth, (sine(0.1, W, 0.3),), again=again)
        assert with_one_course(problem, one, [one], nothing, ALPHA) is one

    def test_that_it_repeats_itself_at_other_times_says_nothing(self):
        again = round(2.4 * 2 * np.pi / W / DT)
        problem, nothing, one = fitted(sawtooth, (sine(0.1, W, 0.3),), again=again)
        assert with_one_course(problem, one, [one], nothing, ALPHA) is not one

    @pytest.mark.parametrize("seed", range(4))
    def test_a_sine_stays_one(self, seed):
        problem, nothing, one = fitted(lambda t: 0.1 * np.sin(W * t), (sine(0.1, W, 0.0),), seed=seed)
        assert with_one_course(problem, one, [one], nothing, ALPHA) is one

    def test_sines_of_unlike_frequencies_stay_two(self):
        def off(t):
            return 0.1 * np.sin(W * t) + 0.05 * np.sin(2.6 * W * t)

        problem, nothing, two = fitted(off, (sine(0.1, W, 0.0), sine(0.05, 2.6 * W, 0.0)))
        assert with_one_course(problem, two, [two], nothing, ALPHA) is two


@pytest.mark.long
def test_a_load_in_pulses_is_told_as_one_disturbance():
    rng = np.random.default_rng(3)
    u = levels(rng, 1500)
    t = np.arange(u.size) * DT
    load = 6.0 * np.maximum(np.sin(W * t), 0.0) ** 2  # a cam that lifts for half of each turn

    def pushed(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] + u[1]

    machine = ODESimulator(
        pushed,
        dt=DT,
        parameters={"gain": 4.0, "damping": 1.0, "stiffness": 20.0},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]", "load [m/s^2]"],
    )
    y = machine.simulate(np.column_stack([u, load]))
    y += 0.01 * np.std(y) * rng.normal(size=y.shape)
    effects = ["periodic_disturbance", "constant_load", "cubic_stiffness", "additive_drift"]
    dx = DiscrepancyRegressor(make_oscillator(gain=4.4), effects=effects, random_state=0).fit(u, y)
    found = {finding.effect: finding for finding in dx.findings_}
    assert set(found) == {"periodic_disturbance", "constant_load"}
    assert "One period takes 2.5 s." in found["periodic_disturbance"].sentence
    assert found["constant_load"].parameters["F"] == pytest.approx(1.5, abs=0.03)  # the mean of those pulses
    assert len(found["periodic_disturbance"].parameters) == 7

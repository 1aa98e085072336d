"""Readings and drives that are bent smoothly: their curve is a spline, fitted from given parameters too."""

import numpy as np
import pytest

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.places import Argument
from narx_sklearn.discrepancy.search.unnamed.broken_line import KNOTS, smooth_line
from narx_sklearn.discrepancy.search.unnamed.curves import curve_at
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.smooth import smoothed

N = 1500
TRUE = [20.0, 6.0, 150.0]


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def simulator():
    return ODESimulator(
        stage,
        dt=0.02,
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
        parameters={"gain": 18.0, "damping": 7.0, "stiffness": 135.0},
    )


def recorded(seed=0):
    """Return an input, and a reading that is bent as by a cube, with noise of 1 %."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-2, 2, N // 20), 20)[:, None]
    x = simulator().with_parameters(TRUE).simulate(u)
    y = x + 12.0 * x**3
    return u, y + 0.01 * y.std() * rng.normal(size=y.shape)


@pytest.fixture(scope="module")
def bent():
    """Return the problem, and a broken line at the output beside parameters that a refit bent."""
    u, y = recorded()
    windows = cut([(slice(0, N), 0)], 150, 1)
    begun = simulator().run(u, cut([(slice(0, N), 0)], N, 1), np.zeros((1, 2))).x[windows.first]
    problem = Problem(simulator(), u, y, windows, Noise.as_large_as(y))
    refitted = fit(problem, Model(np.array([18.0, 7.0, 135.0]), (), begun))
    line = curve_at(Port("output", 0), Argument((), "position", "m"), problem.run(refitted.model).y[:, 0])
    found = fit(problem, refitted.model._replace(effects=(line.placed,)))
    return problem, Candidate(found, problem.n_seen)


def left(problem, candidate):
    """Return what is left over the spread of the reading."""
    return np.sqrt(np.mean(problem.left_over(candidate.fit.model) ** 2)) / problem.y.std()


class TestSmoothed:
    def test_a_smooth_curve_leaves_the_noise_and_a_broken_line_three_times_as_much(self, bent):
        problem, line = bent
        smooth = smoothed(problem, line)
        assert "a smooth curve" in smooth.effects[-1].effect.equation
        assert left(problem, line) > 0.025
        assert left(problem, smooth) < 0.0105

    def test_parameters_that_the_refit_bent_are_right_again(self, bent):
        problem, line = bent
        assert smoothed(problem, line).fit.model.p[1:] == pytest.approx(TRUE[1:], rel=0.05)

    def test_the_curve_is_that_of_the_reading_but_for_its_scale(self, bent):
        problem, line = bent
        (curve,) = smoothed(problem, line).effects
        gain = smoothed(problem, line).fit.model.p[0] / TRUE[0]
        x = np.linspace(-0.3, 0.3, 31)
        read = curve.effect.transform(gain * x, None, 0.02, np.array(curve.theta), [0])
        np.testing.assert_allclose(read, x + 12.0 * x**3, atol=0.01)

    def test_what_is_no_curve_of_a_signal_stays_as_it_is(self, bent):
        problem, line = bent
        base = Candidate(fit(problem, line.fit.model._replace(effects=())), problem.n_seen)
        of_force = curve_at(Port("state", 1), Argument((1.0, 0.0), "position", "m"), problem.y[:, 0]).placed
        other = Candidate(
            fit(problem, base.fit.model._replace(effects=(of_force,)), iterations=1), problem.n_seen
        )
        assert smoothed(problem, other) is other


def test_a_smooth_line_goes_through_its_knots_and_stays_beyond_them():
    line = curve_at(Port("input", 0), Argument((), "drive", "V"), np.linspace(-1.0, 1.0, 201)).placed
    knots = np.array(line.theta[KNOTS:])
    line = smooth_line(line.at((*np.exp(knots), *knots)))

    def added(x):
        return line.effect.transform(x, None, 0.1, np.array(line.theta), [0]) - x

    np.testing.assert_allclose(added(knots), np.exp(knots))
    np.testing.assert_allclose(added(np.array([-5.0, 5.0])), np.exp(knots[[0, -1]]))


@pytest.mark.long
def test_a_diagnosis_tells_a_bent_reading_and_its_curve_holds_on_another_recording():
    dx = DiscrepancyRegressor(simulator(), random_state=0).fit(*recorded())
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.effect, finding.port) == ("unknown", "unknown", "output:0")
    assert dx.scores_.loc["augmented", "nrmse"] < 0.1 * dx.scores_.loc["refitted", "nrmse"]
    u, y = recorded(seed=1)
    assert np.std(dx.simulator_.simulate(u) - y) < 0.02 * y.std()

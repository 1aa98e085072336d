"""What inputs do between samples: told by who writes the simulator, or asked of the record."""

import numpy as np
import pytest

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.start import fit_initial_states
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.between_samples import in_straight_lines

DT = 0.05
NOISE = 0.01  # m
TRUE = (1.2, 0.8, 9.0)


def slide(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def make(hold=None, gain=1.2, damping=0.8):
    return ODESimulator(
        slide,
        dt=DT,
        parameters={"gain [m/s^2/V]": gain, "damping [1/s]": damping, "stiffness [1/s^2]": TRUE[2]},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
        outputs=["position [m]"],
        hold=hold,
        substeps=4,
    )


def smooth(rng, n=1500):
    """Return a sum of sines, faster than the slide is, in most of a record; then it dwells."""
    t = DT * np.arange(n)
    course = sum(np.sin(w * t + rng.uniform(0, 6)) for w in (0.9, 2.1, 3.3, 4.7, 6.1))
    return 3.0 * course * (t % 30.0 < 20.0)


def slowly(u, friction=0.0, straight=True, finer=80):
    """Return the position by small steps of Euler's kind, with dry friction: an independent twin."""
    gain, damping, stiffness = TRUE
    position = velocity = 0.0
    y, h = [], DT / finer
    for now, after in zip(u, np.append(u[1:], u[-1]), strict=True):
        y.append(position)
        for s in range(finer):
            drive = now + straight * (s + 0.5) / finer * (after - now)
            pushed = velocity + h * (gain * drive - damping * velocity - stiffness * position)
            velocity = pushed - np.clip(pushed, -h * friction, h * friction)
            position += h * velocity
    return np.array(y)


def problem_of(simulator, u, y):
    windows = cut([(slice(0, len(u)), 0)], 300, 1)
    return Problem(simulator, u[:, None], y[:, None], windows, Noise.white(np.array([NOISE])))


def begun(problem):
    """Return the simulator as it is, its initial states fitted."""
    fitted = fit_initial_states(problem, np.zeros((problem.windows.first.size, 2)))
    return Candidate(fitted, problem.n_seen)


def test_who_tells_is_believed():
    assert make("zero").hold_is_told
    assert make("linear").hold_is_told
    assert not make().hold_is_told
    u = smooth(np.random.default_rng(0), 100)
    np.testing.assert_array_equal(make().simulate(u), make("zero").simulate(u))
    with pytest.raises(ValueError, match="choose one of 'zero', 'linear'"):
        make("cubic")


@pytest.mark.parametrize("straight", [True, False])
def test_a_record_tells(straight):
    u = smooth(np.random.default_rng(1))
    y = slowly(u, straight=straight) + NOISE * np.random.default_rng(2).standard_normal(u.size)
    problem = problem_of(make(), u, y)
    found = in_straight_lines(problem, begun(problem), [])
    assert (found is not None) == straight
    if straight:
        assert found.linear_hold
        assert not problem.simulator.linear_hold
    told = problem_of(make("zero"), u, y)
    assert in_straight_lines(told, begun(told), []) is None


def test_a_command_that_stays_is_not_asked_about():
    u = np.repeat(np.random.default_rng(3).uniform(-5, 5, 100), 10)
    problem = problem_of(make(), u, slowly(u))
    assert in_straight_lines(problem, begun(problem), []) is None


@pytest.mark.long
def test_what_came_half_a_sample_late_is_no_physics():
    """Nothing is missing: held inputs looked like it."""
    rng = np.random.default_rng(4)
    u = smooth(rng)
    y = slowly(u) + NOISE * rng.standard_normal(u.size)
    dx = DiscrepancyRegressor(make(gain=1.1, damping=1.0), random_state=0).fit(u, y)
    assert dx.verdict_ == "refit"
    (told,) = (f for f in dx.data_findings_ if f.code == "hold")
    assert 'hold="linear"' in told.sentence
    assert dx.simulator_.linear_hold
    assert {p.name: p.value for p in dx.simulator_.parameters}["damping"] == pytest.approx(0.8, rel=0.02)


@pytest.mark.long
@pytest.mark.parametrize("straight", [True, False])
def test_friction_is_named_alone(straight):
    rng = np.random.default_rng(5)
    u = smooth(rng)
    y = slowly(u, friction=1.0, straight=straight) + NOISE * rng.standard_normal(u.size)
    dx = DiscrepancyRegressor(make(gain=1.1, damping=1.0), random_state=0).fit(u, y)
    (friction,) = dx.findings_
    assert "coulomb_friction" in (friction.effect, *friction.lookalikes)
    assert friction.port == "state:1"
    assert friction.parameters["Fc"] == pytest.approx(1.0, rel=0.1)
    assert any(f.code == "hold" for f in dx.data_findings_) == straight

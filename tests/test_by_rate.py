"""Laws of a reading by how fast it moves: what they add, where they are tried, and that they are told."""

import pickle

import numpy as np
import pytest

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.bank import make_bank
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.confirm import Trial
from narx_sklearn.discrepancy.search.unnamed.broken_line import KNOTS
from narx_sklearn.discrepancy.search.unnamed.by_rate import built_up, by_rate, placed_by_rate
from narx_sklearn.discrepancy.search.unnamed.curves import curve_hypotheses
from narx_sklearn.discrepancy.search.unnamed.kinds import BUILDS_UP, BY_RATE, UNNAMED
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.refuted import outdoes_drift
from narx_sklearn.physics.effects import CATALOGUE

DT = 0.02
SLIPS_FROM = 0.6  # m/s


def driven(x, u, p):
    """A cart on a spring."""
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def cart(off=1.0):
    return ODESimulator(
        driven,
        dt=DT,
        parameters={"drive [m/s^2/A]": 1.3 * off, "damping [1/s]": 0.8 / off, "spring [1/s^2]": 2.0 * off},
        states=["position [m]", "speed [m/s]"],
        inputs=["motor [A]"],
        output=[0],
    )


def recorded(rng, n=4000, finer=20):
    """Step the cart by Heun's method; the wheel that measures its way slips where it is fast."""
    u = np.repeat(rng.uniform(-3.0, 3.0, n // 40), 40)
    y, x, slipped = np.empty(n), np.zeros(2), 0.0

    def rates(x, force):
        return np.array([x[1], 1.3 * force - 0.8 * x[1] - 2.0 * x[0]])

    for k, force in enumerate(u):
        y[k] = x[0] - slipped
        for _ in range(finer):
            step = DT / finer
            ahead = x + step * rates(x, force)
            x = x + step / 2 * (rates(x, force) + rates(ahead, force))
            slipped += step * 0.06 * np.sign(x[1]) * max(abs(x[1]) - SLIPS_FROM, 0.0)
    return u[:, None], (y + 0.004 * rng.normal(size=n))[:, None]


def a_tenth_of(low=-3.0, high=3.0):
    """Parameters of a line through zero that rises by a tenth."""
    knots = np.linspace(low, high, KNOTS)
    return np.r_[0.1 * knots, knots]


def test_a_line_of_the_rate_is_added_or_builds_up():
    signal = np.array([0.0, 1.0, 3.0, 3.0])
    np.testing.assert_allclose(by_rate(signal, None, 1.0, a_tenth_of(), [0]), [0.0, 1.1, 3.2, 3.0])
    np.testing.assert_allclose(built_up(signal, None, 1.0, a_tenth_of(), [0]), [0.0, 1.1, 3.3, 3.3])


def test_nothing_builds_up_over_the_beginning_of_another_session():
    signal = np.array([0.0, 1.0, 9.0, 10.0])
    np.testing.assert_allclose(built_up(signal, None, 1.0, a_tenth_of(), [2]), [0.0, 1.1, 9.0, 10.1])
    np.testing.assert_allclose(by_rate(signal, None, 0.5, a_tenth_of(), [2]), [0.0, 1.2, 9.0, 10.2])


def test_faster_than_seen_is_as_the_fastest_seen():
    signal = np.array([0.0, 50.0])
    np.testing.assert_allclose(by_rate(signal, None, 1.0, a_tenth_of(), [0]), [0.0, 50.3])


def test_both_laws_are_tried_on_each_output_over_its_rates_inside_windows():
    y = np.arange(40.0)[:, None] ** 2
    y[20:] += 1e6  # between two windows, where nothing moves as fast
    first = np.array([0, 20])
    found = placed_by_rate(cart(), y, Windows(first, first + 20, np.ones(2, dtype=bool), first))
    assert [(law.effect.code, str(law.port)) for law in found] == [
        (BY_RATE, "output:0"),
        (BUILDS_UP, "output:0"),
    ]
    for law in found:
        knots = np.array(law.theta[KNOTS:])
        assert 1.0 / DT <= knots[0] < knots[-1] <= 77.0 / DT
        np.testing.assert_array_equal(law.theta[:KNOTS], 0.0)
        assert law.effect.ports == ("output",)
        assert pickle.loads(pickle.dumps(law)).effect.code in UNNAMED


def test_what_stands_still_has_no_law_by_its_rate():
    assert placed_by_rate(cart(), np.ones((50, 1)), Windows.whole([slice(0, 50)])) == []


@pytest.mark.parametrize("slips", [True, False])
def test_a_course_that_the_speed_tells_is_no_drift(slips):
    """A drift of the same size, by itself, stays one: the law follows it no better than by chance."""
    rng = np.random.default_rng(0)
    u, y = recorded(rng, 2000, finer=4)
    if not slips:
        wandered = 0.05 * np.sin(2 * np.pi * np.arange(2000) / 1700)
        y = cart().simulate(u) + wandered[:, None] + 0.004 * rng.normal(size=(2000, 1))
    simulator = cart()
    problem = Problem(simulator, u, y, cut([(slice(0, 2000), 0)], 200, 4), Noise.white(np.array([0.004])))
    x0 = np.column_stack([y[problem.windows.first, 0], np.zeros(problem.windows.count)])
    base = fit(problem, Model(simulator.nominal, (), x0))
    run = problem.run(base.model)
    laws = placed_by_rate(simulator, run.y, problem.windows)
    drift = PlacedEffect(CATALOGUE["additive_drift"], Port("output", 0), theta=(0.05, 20.0, 0.0, 0.0))
    drifting, _, law = (
        Candidate(fit(problem, base.model._replace(effects=(e,)), iterations=20), problem.n_seen)
        for e in (drift, *laws)
    )
    curves = curve_hypotheses(simulator, find_structure(simulator, run.x, u), u, run.x, run.y)
    trial = Trial(problem, Candidate(base, problem.n_seen), make_bank(problem, base, curves))
    assert outdoes_drift(trial, drifting, law, 0.0025) is slips
    assert not outdoes_drift(trial, drifting, None, 0.0025)


@pytest.mark.long
def test_a_wheel_that_slips_is_told_as_the_sensor_that_it_is():
    u, y = recorded(np.random.default_rng(0))
    dx = DiscrepancyRegressor(cart(1.1), random_state=0).fit(u, y)
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.effect, finding.port) == ("unknown", "unknown", "output:0")
    assert dx.conclusion_.diagnosis.best.effects[0].effect.code == BUILDS_UP
    assert finding.units["f1"] == "m/s"
    assert finding.units["x1"] == "m/s"

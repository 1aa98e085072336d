"""What an output is off by at first and then no more is one thing, not an offset and a drift."""

import pickle

import numpy as np
import pytest
from small_machines import levels, make_oscillator

from narx_sklearn.discrepancy import DiscrepancyRegressor
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.confirm import is_all_drift
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.fading import faded, fading, with_what_fades
from narx_sklearn.physics.effects import CATALOGUE

N, DT = 1200, 0.02
WHOLE = N * DT
NOISE = 0.02
OFFSET = PlacedEffect(CATALOGUE["sensor_bias"], Port("output", 0), theta=(0.3,))
LOAD = PlacedEffect(CATALOGUE["constant_load"], Port("state", 1), (0.0, 1.0), theta=(6.0,))
DRAG = PlacedEffect(CATALOGUE["quadratic_drag"], Port("state", 1), (0.0, 1.0), theta=(0.1,))
CUBE = PlacedEffect(CATALOGUE["cubic_stiffness"], Port("state", 1), (1.0, 0.0), theta=(0.1,))


def drift(T):
    return PlacedEffect(CATALOGUE["additive_drift"], Port("output", 0), theta=(-0.3, T, 0.0, 0.0))


def recorded(off, seed=0):
    """Return drive and position of an oscillator, the position off by a course in time."""
    rng = np.random.default_rng(seed)
    u = levels(rng, N)
    y = make_oscillator().simulate(u) + NOISE * rng.normal(size=(N, 1))
    return u, y + off(np.arange(N) * DT)[:, None]


def fitted(off, *sets):
    """Return the problem of such a record, and sets of effects fitted to it."""
    u, y = recorded(off)
    simulator = make_oscillator()
    windows = cut([(slice(0, N), 0)], 300, 12)
    problem = Problem(simulator, u, y, windows, Noise.white(np.array([NOISE])))
    start = Model(simulator.nominal, (), np.zeros((windows.count, 2)))
    fits = [fit(problem, start._replace(effects=effects)) for effects in sets]
    return problem, *(Candidate(found, problem.n_seen) for found in fits)


def exponential(T, keeps=0.0):
    return lambda t: 0.3 * (keeps + (1.0 - keeps) * np.exp(-t / T))


class TestWithWhatFades:
    @pytest.mark.parametrize("other", [OFFSET, LOAD])
    def test_an_offset_that_a_drift_takes_away_is_told_as_one(self, other):
        T = 0.3 * WHOLE
        problem, two = fitted(exponential(T), (other, drift(T)))
        found = with_what_fades(problem, two, [two])
        (placed,) = found.effects
        assert is_all_drift(found)
        assert placed.theta == pytest.approx((0.3, T, 0.0, 0.0), rel=0.1)
        assert found.n_values == two.n_values - 3
        assert found.criterion < two.criterion

    @pytest.mark.parametrize(("T", "keeps"), [(0.3 * WHOLE, 0.5), (3.0 * WHOLE, 0.0)])
    def test_what_stays_off_by_most_of_it_stays_an_offset(self, T, keeps):
        problem, two = fitted(exponential(T, keeps), (OFFSET, drift(T)))
        assert with_what_fades(problem, two, [two]) is two

    def test_it_fades_in_another_shape_where_no_exponential_does_as_well(self):
        shape = (0.3, 0.3 * WHOLE, 4.0, -2.0)  # it rises before it goes
        problem, two = fitted(lambda t: faded(t, shape), (OFFSET, drift(shape[1])))
        (placed,) = with_what_fades(problem, two, [two]).effects
        t = np.arange(0.0, WHOLE, DT)
        assert faded(t, placed.theta) == pytest.approx(faded(t, shape), abs=0.02)
        assert faded(t, shape).max() > 0.4

    def test_what_may_stand_beside_it_is_compared_in_the_same_form(self):
        T = 0.3 * WHOLE
        slow = OFFSET, drift(T)
        problem, best, other, single = fitted(exponential(T), (*slow, DRAG), (*slow, CUBE), (DRAG,))
        pool = [best, other, single]
        found = with_what_fades(problem, best, pool)
        assert [e.effect.code for e in found.effects] == ["quadratic_drag", "additive_drift"]
        (beside,) = (c for c in pool if len(c.effects) == 2)
        assert [e.effect.code for e in beside.effects] == ["cubic_stiffness", "additive_drift"]
        assert beside.effects[1].effect.title == found.effects[1].effect.title
        assert all(any(c is kept for c in pool) for kept in (best, other, single))

    def test_a_drift_alone_stays_as_it_is(self):
        problem, alone = fitted(exponential(WHOLE), (drift(WHOLE),))
        assert with_what_fades(problem, alone, [alone]) is alone


def test_what_fades_begins_anew_in_each_session_and_can_be_stored():
    placed = pickle.loads(pickle.dumps(fading(drift(2.0), 4.0, 2.0)))
    at = np.exp(-np.arange(3) / 2.0)
    changed = placed.effect.transform(np.zeros(6), None, 1.0, np.array(placed.theta), [0, 3])
    assert changed == pytest.approx(4.0 * np.concatenate([at, at]))


@pytest.mark.long
def test_a_sensor_that_warms_up_is_told_as_one_drift():
    u, y = recorded(exponential(0.3 * WHOLE))
    simulator = make_oscillator(gain=4.4, damping=0.9, stiffness=22.0)
    found = DiscrepancyRegressor(simulator, random_state=0).fit(u, y)
    assert found.verdict_ == "explained"
    (finding,) = found.findings_
    assert finding.effect == "additive_drift"
    assert finding.port == "output:0"
    assert finding.parameters["a"] == pytest.approx(0.3, rel=0.1)
    assert finding.adds[1] == pytest.approx(0.3, rel=0.1)
    assert abs(finding.adds[0]) < 0.03

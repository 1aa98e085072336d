"""Laws of inputs and readings that remember: what they do to a signal, and that they are told as laws."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_machines import VESSEL_DT, make_vessel, recorded_vessel

from narx_sklearn.discrepancy import DiscrepancyRegressor
from narx_sklearn.discrepancy.search.unnamed.kinds import LOOP, TWO_SPEEDS, UNNAMED, WORKED, WORKED_BY_SQUARE
from narx_sklearn.discrepancy.search.unnamed.memories import MEMORIES
from narx_sklearn.physics.effects import CATALOGUE

DT = VESSEL_DT
LAWS = {law.code: law for law in MEMORIES}
TIMES = st.floats(0.05, 20.0)
SIGNALS = st.lists(st.floats(-5.0, 5.0), min_size=2, max_size=30).map(np.array)


class Sagging:
    """A pump that gives less the harder it worked in the last seconds."""

    def __init__(self, worked=0.0):
        self.worked = worked

    def __call__(self, u, step):
        given = u / (1.0 + 0.1 * self.worked)
        self.worked += step / 12.0 * (u - self.worked)
        return given


class TwoSpeeds:
    """A pump that runs up slowly, and down soon."""

    def __init__(self, speed=0.0):
        self.speed = speed

    def __call__(self, u, step):
        self.speed += step / (3.0 if u > self.speed else 0.6) * (u - self.speed)
        return self.speed


def recorded(pump, rng, n=1600):
    return recorded_vessel(lambda command, _, step: 0.5 * pump(command, step), rng, n, level=12.0)


def diagnosed(u, y):
    dx = DiscrepancyRegressor(make_vessel(1.1), random_state=0).fit(u, y)
    return dx, dx.findings_[0]


def test_laws_have_no_name_and_are_carried_along():
    assert set(LAWS) == {WORKED, WORKED_BY_SQUARE, TWO_SPEEDS, LOOP} <= set(UNNAMED)
    assert not set(LAWS) & set(CATALOGUE)
    signal = np.sin(np.arange(50.0))
    for law in MEMORIES:
        theta = [0.5, 1.0, 0.2, 1.0]
        again = pickle.loads(pickle.dumps(law))
        np.testing.assert_array_equal(
            again.transform(signal, None, DT, theta, [0]), law.transform(signal, None, DT, theta, [0])
        )


def test_ports():
    assert LAWS[LOOP].ports == ("output",)
    assert {LAWS[code].ports for code in (WORKED, WORKED_BY_SQUARE, TWO_SPEEDS)} == {("input", "output")}


@pytest.mark.parametrize(("code", "power"), [(WORKED, 1), (WORKED_BY_SQUARE, 2)])
def test_a_gain_after_work_by_hand(code, power):
    """A step from r to r + 2 at the second sample: the work 2^power is remembered from the third on."""
    signal = np.array([1.0, 3.0, 3.0, 3.0])
    decay = np.exp(-DT / 4.0)
    worked = 2.0**power * np.array([0.0, 0.0, 1.0 - decay, 1.0 - decay**2])
    found = LAWS[code].transform(signal, None, DT, [-0.1, 4.0, 1.0, 0.0], [0])
    np.testing.assert_allclose(found, 1.0 + (signal - 1.0) * np.exp(-0.1 * worked))


def test_work_is_remembered_across_missing_samples_and_forgotten_at_a_new_session():
    law, theta = LAWS[WORKED], [0.3, 2.0, 0.0, 1.5]
    signal = np.array([2.0, 2.0, np.nan, 2.0, 2.0, 2.0])
    found = law.transform(signal, None, DT, theta, [0, 4])
    assert np.isnan(found[2])
    assert found[4] == found[0] == pytest.approx(2.0 * np.exp(0.3 * 1.5))
    np.testing.assert_array_equal(np.isfinite(found), np.isfinite(signal))


@given(signal=SIGNALS, T1=TIMES, T2=TIMES, lacking=st.floats(-1.0, 1.0))
def test_a_held_signal_is_followed_at_two_speeds(signal, T1, T2, lacking):
    """Against small steps of Euler's kind: the mean over each sample, and the closest line's rise."""
    finer = 400
    along = (np.arange(finer) + 0.5) / finer - 0.5
    at, means, rises = signal[0] * (1 - lacking), [], []
    for value in signal:
        T = T1 if at < value else T2
        course = value + (at - value) * np.exp(-DT / T * (along + 0.5))
        means.append(course.mean())
        rises.append(12 * np.mean(course * along))
        at = value + (at - value) * np.exp(-DT / T)
    mean, rise = LAWS[TWO_SPEEDS].held(signal, DT, [T1, T2, lacking], [0])
    scale = np.abs(signal).max() * (1 + abs(lacking)) + 1e-9
    np.testing.assert_allclose(mean, means, atol=1e-3 * scale)
    np.testing.assert_allclose(rise, rises, atol=2e-3 * scale)


@given(signal=SIGNALS, T=TIMES, lacking=st.floats(-1.0, 1.0))
def test_with_one_speed_it_is_the_lag_of_the_catalogue(signal, T, lacking):
    lag, law = CATALOGUE["lag"], LAWS[TWO_SPEEDS]
    scale = np.abs(signal).max() + 1e-9
    np.testing.assert_allclose(
        law.held(signal, DT, [T, T, lacking], [0]),
        lag.held(signal, DT, [T, lacking, 0.0], [0]),
        atol=1e-9 * scale,
    )
    np.testing.assert_allclose(
        law.transform(signal, None, DT, [T, T, lacking], [0]),
        lag.transform(signal, None, DT, [T, lacking, 0.0], [0]),
        atol=1e-6 * scale,
    )


def test_a_reading_that_stays_where_it_turned():
    """A loop of a reading closes where it began, and is as wide as twice the level at which it yields."""
    there_and_back = np.concatenate([np.linspace(-5, 5, 200), np.linspace(5, -5, 200)] * 2)
    yields = 0.4
    theta = [0.1, yields, 0.0]  # r = 0: z ends at zy
    off = (LAWS[LOOP].transform(there_and_back, None, DT, theta, [0]) - there_and_back)[400:]
    at_zero = off[99], off[299]  # going up, and down
    np.testing.assert_allclose(at_zero, (0.1 * yields, -0.1 * yields), rtol=0.02)
    assert off[0] == pytest.approx(off[-1], rel=1e-3)


@pytest.mark.long
def test_a_supply_that_sags_is_a_law_and_no_drift_with_saturation():
    dx, finding = diagnosed(*recorded(Sagging(), np.random.default_rng(0)))
    assert (dx.verdict_, finding.port) == ("unknown", "input:0")
    assert dx.conclusion_.diagnosis.best.effects[0].effect.code in (WORKED, WORKED_BY_SQUARE)
    assert finding.parameters["T"] == pytest.approx(12.0, rel=0.25)


@pytest.mark.long
def test_a_pump_that_runs_up_slowly_and_down_soon_is_a_law():
    dx, finding = diagnosed(*recorded(TwoSpeeds(), np.random.default_rng(1)))
    assert (dx.verdict_, finding.port) == ("unknown", "input:0")
    assert finding.parameters["T1"] == pytest.approx(3.0, rel=0.1)
    assert finding.parameters["T2"] == pytest.approx(0.6, rel=0.2)

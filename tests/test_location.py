"""Where the mismatch is, once it is named: regions in which an effect acts, stretches in which it acted."""

import numpy as np
import pandas as pd
import pytest

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.locate import features, inside, regions
from narx_sklearn.discrepancy.locate.features import plain
from narx_sklearn.discrepancy.location import (
    _features,
    _shown,
    _slope,
    _spectra,
    slopes_of_ends,
    widened,
)
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulators.simulator import Signal
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.trimmed import trimmed
from narx_sklearn.physics.effects import CATALOGUE

GAP, LIMIT, DEAD = 0.25, 2.5, 0.8


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def with_stop(x, u, p):
    beyond = x[0] - min(max(x[0], -GAP), GAP)
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 20.0 * beyond


def limited(x, u, p):
    passed = min(max(u[0], -LIMIT), LIMIT)
    return x[1], p[0] * passed - p[1] * x[1] - p[2] * x[0]


def dead(x, u, p):
    passed = u[0] - min(max(u[0], -DEAD), DEAD)
    return x[1], p[0] * passed - p[1] * x[1] - p[2] * x[0]


def make(rhs, gain=1.1, damping=0.7, stiffness=11.0):
    return ODESimulator(
        rhs,
        dt=0.02,
        parameters={"gain": gain, "damping": damping, "stiffness": stiffness},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
    )


def drive(n=3000, seed=0):
    return np.repeat(np.random.default_rng(seed).normal(0, 3, n // 10), 10)[:, None]


@pytest.mark.parametrize(
    ("rhs", "effect", "signal", "edge", "above", "off"),
    [
        pytest.param(
            *(with_stop, "clearance", "|position [m]|", GAP, True, 0.02),  # as its own parameters say
            marks=pytest.mark.long,
        ),
        pytest.param(
            *(limited, "input_saturation", "|drive [V]|", LIMIT, True, 0.1),  # where its corner is rounded
            marks=pytest.mark.long,
        ),
        pytest.param(dead, "dead_zone", "|drive [V]|", DEAD, False, 0.02, marks=pytest.mark.long),
    ],
)
def test_a_rule_says_where_a_named_effect_acts(rhs, effect, signal, edge, above, off):
    u = drive()
    y = make(rhs).simulate(u)
    y += 0.005 * np.random.default_rng(1).normal(size=y.shape)
    simulator = make(stage, 1.0, 0.8, 12.0)
    dx = DiscrepancyRegressor(simulator, effects=["cubic_stiffness", effect]).fit(u, y)
    assert dx.findings_[0].effect == effect
    first = dx.location_.regions.iloc[0]
    (condition,) = first["conditions"]
    assert (first["effect"], condition.feature) == (effect, signal)
    assert (condition.low if above else condition.high) == pytest.approx(edge, rel=off)
    assert first["share"] > 0.95


def test_what_is_held_at_a_rim_is_on_the_near_side_of_its_rule():
    def tank(x, u, p):
        return (u[0] - p[0] * np.sqrt(x[0] if x[0] > 0.0 else 0.0),)

    about = {"dt": 1.0, "states": ["level [cm]"], "inputs": ["inflow [cm/s]"]}
    simulator = ODESimulator(tank, parameters={"outflow": 0.2}, **about)
    u = np.repeat(np.random.default_rng(0).uniform(0.2, 0.75, 60), 40)[:, None]
    y, level = np.empty(u.size), 4.0
    for k in range(u.size):
        y[k] = level
        for _ in range(50):
            level = min(level + 0.02 * (u[k, 0] - 0.22 * np.sqrt(level)), 7.5)
    held = y > 7.5 - 1e-9
    assert 0.02 < held.mean() < 0.5
    measured = y + 0.03 * np.random.default_rng(1).normal(size=y.size)
    dx = DiscrepancyRegressor(simulator, effects=["overflow", "sensor_clip"]).fit(u, measured)
    assert [finding.effect for finding in dx.findings_] == ["overflow"]
    (rule,) = dx.location_.regions.to_dict("records")
    assert [condition.feature for condition in rule["conditions"]] == ["level [cm]"]
    inside_rule = inside(rule["conditions"], pd.DataFrame({"level [cm]": y}))
    assert inside_rule[held].all()
    assert inside_rule.sum() < 1.3 * held.sum()


def test_what_a_curve_of_a_signal_adds_is_told_by_its_slope():
    u = np.array([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 0.5])
    passing = u - np.clip(u, -1.0, 1.0)
    assert _slope(u, passing - u).tolist() == [0.0, -1.0, -1.0, -1.0, -1.0, 0.0, 0.0, -1.0]
    delayed = np.roll(u, 3) - u  # at 0.5 it adds one thing, then another: no curve
    assert _slope(u, delayed) is None
    assert _slope(np.ones(3), np.zeros(3)) is None


@pytest.mark.parametrize("reach", [3.0, 0.4])
def test_a_rounded_corner_lies_where_a_fifth_of_the_gain_is_gone_or_half_of_what_is_seen_to_go(reach):
    u = np.linspace(-reach, reach, 2001)
    limit = PlacedEffect(CATALOGUE["input_saturation"], Port("input", 0))
    names = "drive [V]", "|drive [V]|", "time since reversal of drive [s]", "position [m]"
    table = pd.DataFrame(dict.fromkeys(names, u))
    slope, floor, telling = _shown(make(stage, 1.0, 0.8, 12.0), limit, u, np.tanh(u) - u, table)
    lost = np.tanh(u) ** 2  # the gain is 1 - tanh(u)**2
    np.testing.assert_allclose(-slope, lost, atol=2e-3)
    assert floor == pytest.approx(min(0.2, 0.5 * lost.max()) ** 2, rel=0.03)
    assert list(telling) == ["drive [V]", "|drive [V]|"]
    echo = np.roll(u, 7) - u  # no curve of the signal: half of the most that is added
    shown, floor, telling = _shown(make(stage, 1.0, 0.8, 12.0), limit, np.round(u), echo, table)
    np.testing.assert_array_equal(shown, echo)
    assert floor == (0.5 * np.abs(echo).max()) ** 2
    assert list(telling) == list(names)


def gated(n=4000, start=1500, stop=2600):
    """A stage with a stop that was there for a while, and the problem of fitting one without."""

    def stop_meanwhile(x, u, p):
        beyond = x[0] - min(max(x[0], -0.1), 0.1)
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 20.0 * u[1] * beyond

    simulator = ODESimulator(
        stop_meanwhile,
        dt=0.02,
        parameters={"gain": 1.1, "damping": 0.7, "stiffness": 11.0},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]", "stop [-]"],
    )
    u = drive(n)
    there = ((np.arange(n) >= start) & (np.arange(n) < stop)).astype(float)
    y = simulator.simulate(np.column_stack([u[:, 0], there]))
    return u, y + 0.005 * np.random.default_rng(1).normal(size=y.shape)


def test_what_acted_for_a_while_is_left_where_it_was():
    u, y = gated()
    simulator = make(stage, 1.0, 0.8, 12.0)
    problem = Problem(simulator, u, y, cut([(slice(0, 4000), 0)], 500, 8), Noise.white(np.array([0.005])))
    found = fit(problem, Model(simulator.nominal, (), np.zeros((problem.windows.count, 2))))
    bent = (problem.y - problem.run(found.model).y)[:, 0]
    local = trimmed(problem, found).residual[:, 0]
    outside = np.r_[0:1400, 3000:4000]
    assert np.std(bent[outside]) > 2 * 0.005  # a fit to all of it is wrong everywhere
    assert np.std(local[outside]) == pytest.approx(0.005, rel=0.1)
    assert np.std(local[1600:2500]) > 4 * 0.005


@pytest.mark.parametrize("length", [40, 180, 190, 1000, 4000])
def test_any_windows_will_do(length):
    u, y = gated()
    y[700:900] = np.nan
    simulator = make(stage, 1.0, 0.8, 12.0)
    pieces = [(slice(0, 700), 0), (slice(900, 4000), 0)]
    problem = Problem(simulator, u, y, cut(pieces, length, 8), Noise.white(np.array([0.005])))
    found = fit(problem, Model(simulator.nominal, (), np.zeros((problem.windows.count, 2))))
    local = trimmed(problem, found).residual[:, 0]
    assert np.isnan(local[700:900]).all()
    assert np.isfinite(local[:700]).all()
    assert np.isfinite(local[900:]).all()
    assert np.std(local[1600:2500]) > np.std(local[:700])


@pytest.mark.long
def test_the_stretch_in_which_it_acted_is_told():
    u, y = gated()
    simulator = make(stage, 1.0, 0.8, 12.0)
    dx = DiscrepancyRegressor(simulator, effects=["clearance", "gain_drift"], test_fraction=0.0).fit(u, y)
    told = np.zeros(4000, dtype=bool)
    for row in dx.location_.segments.itertuples():
        told[row.start : row.stop] = True
    real = np.zeros(4000, dtype=bool)
    real[1500:2600] = True
    assert (told & real).sum() / (told | real).sum() > 0.7


@pytest.mark.long
def test_what_acts_everywhere_has_no_region_and_hides_none_of_another():
    """Friction is as large at any speed; the stop beside it acts beyond its gap."""
    u = drive()

    def rubbing_stop(x, u, p):
        beyond = x[0] - min(max(x[0], -GAP), GAP)
        rubbing = 0.8 * np.tanh(x[1] / 1e-3)
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 20.0 * beyond - rubbing

    y = make(rubbing_stop).simulate(u)
    y += 0.002 * np.random.default_rng(1).normal(size=y.shape)
    effects = ["clearance", "coulomb_friction"]
    dx = DiscrepancyRegressor(make(stage, 1.0, 0.8, 12.0), effects=effects).fit(u, y)
    assert {finding.effect for finding in dx.findings_} == set(effects)
    assert dx.location_.regions["effect"].tolist() == ["clearance"]


def walk(n=4000, seed=3):
    """Signals of a level above zero and of a drive, and all that is said of them."""
    rng = np.random.default_rng(seed)
    level = 5.0 + np.cumsum(rng.normal(0, 0.05, n)) % 4.0
    u = np.repeat(rng.uniform(2, 8, n // 10), 10)
    signals = {"inputs": [Signal("pump", "V")], "states": [Signal("level", "cm")]}
    return level, u, features(u[:, None], level[:, None], 0.1, **signals)


def test_what_is_often_nothing_has_its_region_where_it_is_anything():
    level, _, table = walk()
    excess = np.maximum(level - 7.5, 0.0)
    (rule,) = regions(excess, table, noise_free=True).to_dict("records")
    (condition,) = rule["conditions"]
    assert (condition.feature, condition.high) == ("level [cm]", np.inf)
    assert condition.low == pytest.approx(7.5, abs=0.01)
    assert rule["share"] == pytest.approx(1.0)


def test_what_acts_for_a_few_samples_only_has_a_region_too():
    level, _, table = walk(40)
    (rule,) = regions(np.maximum(level - 7.5, 0.0), table, noise_free=True).to_dict("records")
    assert [condition.feature for condition in rule["conditions"]] == ["level [cm]"]
    assert inside(rule["conditions"], table).tolist() == (level > 7.5).tolist()


def test_a_range_of_a_signal_is_told_by_its_bounds_not_by_distances():
    _, u, table = walk()
    dead = np.where(np.abs(u - 5.0) < 1.0, u - 5.0, 0.0)
    (rule,) = regions(dead, table, noise_free=True).to_dict("records")
    (condition,) = rule["conditions"]
    assert condition.feature == "pump [V]"
    assert (condition.low, condition.high) == pytest.approx((4.0, 6.0), abs=0.05)


def test_directions_are_told_where_signals_alone_say_less():
    _, _, table = walk()
    falling = np.where(table["direction of level"] < 0, 1.0, 0.0)
    (rule,) = regions(falling, table, noise_free=True).to_dict("records")
    assert rule["rule"] == "level falling"


def test_a_division_that_says_next_to_nothing_is_not_made():
    level, u, table = walk()
    mostly = np.where((level > 7.5) & ((u < 7.95) | (level > 8.5)), 1.0, 0.0)
    (rule,) = regions(mostly, table, noise_free=True).to_dict("records")
    assert [condition.feature for condition in rule["conditions"]] == ["level [cm]"]


def test_a_signal_called_after_a_rate_is_a_signal():
    rng = np.random.default_rng(0)
    turning, rudder = rng.normal(size=(2, 200))
    signals = {"inputs": [Signal("rudder", "rad")], "states": [Signal("rate of turn", "rad/s")]}
    table = features(rudder[:, None], turning[:, None], 0.1, **signals)
    names = ["rudder [rad]", "rate of turn [rad/s]", "|rudder [rad]|", "|rate of turn [rad/s]|"]
    assert plain(table).columns.tolist() == names
    assert plain(table[names[:1]]).columns.tolist() == names[:1]
    assert plain(pd.DataFrame({"a": turning})).columns.tolist() == ["a"]


def test_what_a_machine_does_is_told_of_each_session_by_itself():
    """Two sessions of one ramp, held-out ends between them: no jump where the second begins."""
    x, u = (np.concatenate([np.arange(100.0), np.arange(50.0)])[:, None] * k for k in (0.02, 0.1))
    windows = cut([(slice(10, 80), 0), (slice(100, 150), 100)], 25, 8)
    table = _features(make(stage), u, np.hstack([x, x]), windows, slice(10, 150))
    np.testing.assert_allclose(table["rate of position [m/s]"], 0.02 / 0.02)
    since = table["time since reversal of drive [s]"].to_numpy()
    assert since[[89, 90, 91]] == pytest.approx([89 * 0.02, 0.0, 0.02])
    assert (table["direction of drive"].iloc[[1, 89, 91]] == 1).all()


def test_frequencies_are_told_of_every_output():
    rng, t = np.random.default_rng(0), 0.02 * np.arange(8000)
    two = ODESimulator(
        stage,
        dt=0.02,
        parameters={"gain": 1.1, "damping": 0.7, "stiffness": 11.0},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
        output=(0, 1),
    )
    residual = 0.1 * rng.normal(size=(8000, 2)) + np.outer(0.1 * np.sin(2 * np.pi * 5 * t), [0, 1])
    table = _spectra(two, residual, rng.normal(size=(8000, 2)))
    assert set(table["output"]) == {"position [m]", "velocity [m/s]"}
    loudest = table.loc[table["excess"].idxmax()]
    assert loudest["output"] == "velocity [m/s]"
    assert loudest["f_low"] < 5.0 < loudest["f_high"]
    few = _spectra(two, residual[:20], residual[:20])
    assert few.empty
    assert "output" in few
    half = np.where(np.arange(2) == 0, np.nan, residual)
    assert set(_spectra(two, half, half)["output"]) == {"velocity [m/s]"}


def test_how_an_end_moves_is_asked_beside_the_parameters():
    """An end of four times the square root of one parameter, less another, and no end above."""
    slopes = slopes_of_ends(
        lambda theta: ((4.0 * np.sqrt(theta[0]) - theta[1], np.inf),), np.array([4.0, 0.0])
    )
    np.testing.assert_allclose(slopes[:, 0, 0], [1.0, -1.0], rtol=1e-6)


def test_what_is_held_at_either_limit_is_inside():
    """A hard stop on both sides: fitted limits are a little off, and positions rest on them."""
    at = np.array([-1.001, 0.0, 0.999])
    spans = widened(np.array([[-np.inf, -1.002], [1.0, np.inf]]), [0.01, 0.01])
    assert ((at[:, None] > spans[:, 0]) & (at[:, None] <= spans[:, 1])).any(axis=1).tolist() == [
        True,
        False,
        True,
    ]

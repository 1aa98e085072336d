"""Times, regions, frequencies, the nature of a force: planted mismatches are found, noise is left alone."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import trapezoid
from scipy.signal import lfilter

from narx_sklearn.discrepancy.locate import (
    Condition,
    bands,
    event_table,
    features,
    force_curve,
    input_events,
    inside,
    invariances,
    regions,
    segments,
    stated_regions,
)
from narx_sklearn.discrepancy.locate._hats import additive_hats, hats
from narx_sklearn.discrepancy.simulators.simulator import Signal

SIGNALS = {"inputs": [Signal("drive", "V")], "states": [Signal("position", "m"), Signal("velocity", "m/s")]}


def coloured(rng, n, rho):
    return lfilter([1.0], [1.0, -rho], rng.normal(size=n + 200))[200:]


def motion(rng, n):
    """Return an input of random levels and the states of an oscillator under it."""
    u = np.repeat(rng.normal(size=n // 25), 25)
    x = lfilter([0.01], [1, -1.9, 0.91], u)
    return u[:, None], np.column_stack([x, np.gradient(x, 0.02)])


# --- times ---


@pytest.mark.parametrize("seed", range(5))
def test_a_stretch_of_mismatch_is_found_in_time(seed):
    rng = np.random.default_rng(seed)
    n, start, length = 10_000, int(rng.integers(1000, 7000)), int(rng.integers(600, 2500))
    residual = coloured(rng, n, 0.7)
    residual[start : start + length] += 3.0 * coloured(rng, length, 0.95)
    found = segments(residual, 0.01, random_state=0)
    truth, marked = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    truth[start : start + length] = True
    for row in found.itertuples():
        marked[row.start : row.stop] = True
        assert row.start_s == pytest.approx(0.01 * row.start)
        assert row.z_score > 5
    assert np.sum(truth & marked) / np.sum(truth | marked) >= 0.7


def test_two_stretches_are_told_apart_and_gaps_are_bridged():
    rng = np.random.default_rng(1)
    residual = rng.normal(size=8000)
    residual[1000:2000] *= 3
    residual[5000:5600] *= 3
    residual[3000:3300] = np.nan
    found = segments(residual, 0.01, random_state=0)
    assert len(found) == 2
    assert np.allclose(found["start"], [1000, 5000], atol=64)
    assert np.allclose(found["stop"], [2000, 5600], atol=64)


def test_a_stretch_that_begins_with_a_step_of_the_input_says_so():
    rng = np.random.default_rng(2)
    residual = rng.normal(size=4000)
    residual[2000:2600] *= 4
    u = np.zeros((4000, 1))
    u[2000:2600] = 1.0
    for names, called in ((None, "input 0"), (["drive"], "drive")):
        found = segments(residual, 0.01, u=u, names=names, random_state=0)
        assert found.loc[0, "event"] == f"step of {called}"


def test_noise_has_no_segments_and_no_regions():
    # 60 records, white and coloured; at 1 % each the chance of three or more false ones is 2 %
    false_segments = false_regions = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        u, x = motion(rng, 2500)
        residual = coloured(rng, 2500, 0.9 * (seed % 2))
        false_segments += len(segments(residual, 0.02, u=u, random_state=0)) > 0
        false_regions += len(regions(residual, features(u, x, 0.02, **SIGNALS), random_state=0)) > 0
    assert false_segments <= 1
    assert false_regions <= 1


def test_a_short_or_silent_residual_has_no_segments():
    assert segments(np.ones(30), 0.1).empty
    assert segments(np.zeros(1000), 0.1).empty


# --- events ---


def test_steps_reversals_and_limits_of_an_input_are_seen():
    u = np.array([0.0, 0, 0, 0, 1, 1, 1, 1, 0.5, 0.5, 0.5, 0.5])
    events = input_events(u)
    assert events["step"].tolist() == [4, 8]
    assert events["reversal"].tolist() == [7]
    assert events["limit"].tolist() == [4]


def test_a_residual_that_follows_reversals_is_tied_to_them():
    rng = np.random.default_rng(0)
    u = np.cumsum(np.repeat(np.sign(rng.normal(size=80)), rng.integers(60, 100, 80)))[:, None] * 0.01
    reversals = input_events(u[:, 0])["reversal"]
    residual = 0.3 * rng.normal(size=u.shape[0])
    for k in reversals:
        residual[k : k + 10] += 1.0
    table = event_table(residual, u, reach=10, random_state=0)
    row = table[table["event"] == "reversal"].iloc[0]
    assert row["kept"]
    assert row["ratio"] > 5
    assert not event_table(rng.normal(size=u.shape[0]), u, reach=10, random_state=0)["kept"].any()


# --- regions ---


def test_a_region_of_two_features_is_found_as_a_rule():
    rng = np.random.default_rng(3)
    u, x = motion(rng, 8000)
    table = features(u, x, 0.02, **SIGNALS)
    limit = np.quantile(x[:, 0], 0.6)
    truth = (x[:, 0] > limit) & (u[:, 0] > 0)
    found = regions(rng.normal(size=8000) * np.where(truth, 1.0, 0.05), table, random_state=0)
    marked = np.any([inside(conditions, table) for conditions in found["conditions"]], axis=0)
    assert 2 * np.sum(truth & marked) / (truth.sum() + marked.sum()) > 0.95
    assert "position [m]" in found.loc[0, "rule"]
    assert "drive [V]" in found.loc[0, "rule"]
    assert found["share"].sum() > 0.95


def test_rules_read_like_sentences():
    assert str(Condition("velocity [m/s]", 0.12, np.inf)) == "velocity [m/s] > 0.12"
    assert str(Condition("position [m]", -0.3, 0.3)) == "-0.3 < position [m] <= 0.3"
    assert str(Condition("direction of drive", 0.5, np.inf)) == "drive rising"
    assert str(Condition("direction of drive", -np.inf, -0.5)) == "drive falling"
    assert str(Condition("direction of drive", -0.5, np.inf)) == "drive not falling"


@pytest.mark.parametrize(
    ("bound", "below", "above"),
    [(35.17443, 35.17, 35.175), (0.333, 0.333, 0.333), (0.40001, 0.4, 0.401), (-0.2, -0.2, -0.2)],
)
def test_a_bound_has_the_fewest_digits_that_hold_for_the_same_samples(bound, below, above):
    table = pd.DataFrame({"level [cm]": [0.1, 0.333, 0.39, 0.41, 35.17, 35.1765, 35.2]})
    condition = Condition("level [cm]", bound, np.inf).readable(table)
    assert condition == ("level [cm]", below, np.inf)
    assert inside([condition], table).tolist() == (table["level [cm]"] > bound).tolist()
    assert Condition("level [cm]", -np.inf, bound).readable(table) == ("level [cm]", -np.inf, above)


def test_a_region_that_an_effect_states_is_told_as_it_is():
    x = np.linspace(-0.997, 2.003, 301)
    table = pd.DataFrame({"position [m]": x, "|position [m]|": np.abs(x)})
    stop = np.where(x > 1.5, x - 1.5, np.where(x < -0.5, x + 0.5, 0.0))
    spans = [(-np.inf, -0.5), (1.5, np.inf)]
    apart = stated_regions(stop, table, "position [m]", spans)
    assert sorted(apart["rule"]) == ["position [m] <= -0.5", "position [m] > 1.5"]
    assert apart["share"].sum() == pytest.approx(1.0)
    by_size = stated_regions(stop, table, "position [m]", spans, is_centred=True)
    assert by_size["rule"].tolist() == ["|position [m]| > 1"]
    within = stated_regions((np.abs(x) < 0.4).astype(float), table, "position [m]", [(-0.4, 0.4)])
    assert within["rule"].tolist() == ["|position [m]| <= 0.4"]
    assert stated_regions(stop, table, "position [m]", [(3.0, np.inf)]).empty  # it is never there
    assert stated_regions(0 * stop, table, "position [m]", spans).empty


def test_a_rate_that_is_a_state_is_not_listed_twice():
    u, x = motion(np.random.default_rng(0), 1000)
    names = list(features(u, x, 0.02, **SIGNALS))
    assert "velocity [m/s]" in names
    assert "rate of position [m/s]" not in names
    assert "rate of velocity [m/s^2]" in names


def test_a_record_that_begins_at_rest_has_the_same_edges():
    """Half a record of one value first: what moves later is no direction, and has something in between."""
    rng = np.random.default_rng(0)
    position = np.concatenate([np.zeros(4000), np.sin(np.arange(6000) / 40)])
    table = pd.DataFrame({"position [m]": position})
    signal = np.maximum(position - 0.3, 0.0) + 0.05 * rng.normal(size=10_000)
    moving, whole = (
        regions(signal[part], table[part], random_state=0) for part in (slice(4000, None), slice(None))
    )
    edges = [found.loc[0, "conditions"][0].low for found in (moving, whole)]
    assert edges == pytest.approx([0.3, 0.3], abs=0.08)  # a 60th of the samples lies between two edges tried


# --- frequencies ---


def test_halves_of_the_stretches_of_a_spectrum_overlap():
    """Of a 16th of 1040 samples, 65, an even number is taken; their middle is where the next begins."""
    signal = np.random.default_rng(0).normal(size=1040)
    assert bands(signal, signal, 1.0).loc[0, "f_low"] == pytest.approx(0.5 / 64)


def test_power_of_a_sine_lies_in_its_band():
    rng, t = np.random.default_rng(0), np.arange(20_000) * 0.005
    sine = 0.2 * np.sin(2 * np.pi * 12.0 * t)
    table = bands(sine + 0.1 * rng.normal(size=t.size), np.sin(t), 0.005, sigma=0.1)
    row = table[(table["f_low"] < 12) & (table["f_high"] > 12)].iloc[0]
    assert row["kept"]
    assert row["share"] > 0.6  # 0.02 of 0.03
    assert table["share"].sum() == pytest.approx(1.0)
    assert table["kept"].sum() <= 2


def test_coloured_noise_of_known_colour_has_no_bands():
    false = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        noise = coloured(rng, 8000, 0.9)
        false += bands(noise, noise, 0.01, sigma=1 / np.sqrt(1 - 0.81), rho=0.9)["kept"].any()
    assert false <= 1


# --- the curve and the nature of a force ---


def test_the_curve_of_a_force_lies_within_its_intervals():
    rng = np.random.default_rng(0)
    x = coloured(rng, 20_000, 0.99)
    curve = force_curve(np.tanh(x / 3) + 0.3 * rng.normal(size=x.size), x)
    truth = np.tanh(curve["argument"] / 3)
    assert np.mean((curve["low"] <= truth) & (truth <= curve["high"])) > 0.85
    assert trapezoid(np.abs(curve["force"] - truth), curve["argument"]) < 0.03 * np.ptp(x)


def test_a_curve_of_nothing_is_refused():
    with pytest.raises(ValueError, match="known at 0 samples"):
        force_curve(np.full(10, np.nan), np.arange(10.0))


@pytest.fixture(scope="module")
def moved():
    """Return position, rate, input and time of a motion of varying amplitude."""
    rng = np.random.default_rng(0)
    n, dt = 8000, 0.01
    size = np.interp(np.arange(n), np.arange(0, n + 1, 400), rng.uniform(0.3, 1.0, n // 400 + 1))
    u = np.repeat(rng.normal(size=n // 40), 40)
    x = size * np.sin(2 * np.pi * np.cumsum(0.6 + 0.2 * np.sin(np.arange(n) / 500)) * dt)
    return x, np.gradient(x, dt), u, np.arange(n) * dt


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (lambda x, v, u, t: -(x**3), {"odd": "odd", "rate": "independent", "memory": "no memory"}),
        (lambda x, v, u, t: x**2, {"odd": "even", "product": "adds", "direction": "independent"}),
        (lambda x, v, u, t: -np.abs(v) * v, {"rate": "depends", "memory": "no memory"}),
        (lambda x, v, u, t: -np.sign(v), {"direction": "depends", "rate": "independent"}),
        (lambda x, v, u, t: u * x, {"product": "multiplies", "memory": "no memory"}),
        (lambda x, v, u, t: lfilter([0.05], [1, -0.95], u), {"memory": "has memory"}),
        (
            lambda x, v, u, t: np.sin(2 * np.pi * x / 0.1),
            {"position period": "periodic in position, every 0."},
        ),
        (lambda x, v, u, t: np.sin(2 * np.pi * 3.1 * t), {"time period": "periodic in time, every 0.32"}),
    ],
    ids=["cube", "square", "drag", "friction", "product", "lag", "cogging", "hum"],
)
def test_the_nature_of_a_force_is_read_off(moved, law, expected):
    x, v, u, t = moved
    w = law(x, v, u, t)
    w = w + 0.05 * w.std() * np.random.default_rng(1).normal(size=w.size)
    table = invariances(w, x, v, u, 0.01)
    for name, reading in expected.items():
        assert table.loc[name, "reading"].startswith(reading), table.to_string()


@pytest.mark.parametrize("degree", [0.5, 1.0, 2.2, 3.0])
def test_degree_is_the_exponent_of_the_amplitude(degree):
    size = np.repeat(np.geomspace(0.2, 1.0, 40), 100)
    x = size * np.sin(np.arange(4000) * 2 * np.pi / 50)
    v = np.gradient(x)
    table = invariances(np.sign(x) * np.abs(x) ** degree, x, v, 0.1 * np.cos(np.arange(4000)), 1.0)
    assert table.loc["degree", "value"] == pytest.approx(degree, abs=0.1)


def test_too_few_samples_for_a_nature_are_refused():
    few = np.arange(50.0)
    with pytest.raises(ValueError, match="at least 200"):
        invariances(few, few, few, few, 1.0)


@given(st.integers(0, 1000))
def test_hats_sum_to_one(seed):
    signal = np.random.default_rng(seed).normal(size=50)
    assert np.allclose(hats(signal).sum(axis=1), 1.0)


def test_additive_hats_hold_the_constant_once():
    basis = additive_hats(np.random.default_rng(0).normal(size=(200, 3)))
    assert np.linalg.matrix_rank(basis) == basis.shape[1]


def test_rows_with_nan_meet_no_condition():
    table = pd.DataFrame({"a": [0.0, np.nan, 2.0]})
    assert inside([Condition("a", -np.inf, 1.0)], table).tolist() == [True, False, False]

"""A fleet of mass-spring-dampers: who shows the effect, how machines differ, whether they drift."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pandas as pd
import pytest

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fleet import (
    _effect_table,
    _One,
    _value_table,
    diagnose_fleet,
    pool_estimates,
)
from narx_sklearn.identification.free_run.many import by_session

ABOUT = {"dt": 0.05, "states": ["position [m]", "velocity [m/s]"], "inputs": ["drive [V]"]}
NOMINAL = {"gain [m/s^2/V]": 1.0, "damping [1/s]": 0.8, "stiffness [1/s^2]": 12.0}


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def hardening_stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - p[3] * x[0] ** 3


def machine(seed, stiffness, cubic):
    """Return a recording of one machine of the fleet."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.normal(0, 3, 120), 8)
    truth = {"gain": 1.0, "damping": 0.8, "stiffness": stiffness, "cubic": cubic}
    y = ODESimulator(hardening_stage, parameters=truth, **ABOUT).simulate(u)[:, 0]
    return u, y + 0.005 * rng.normal(size=y.size)


class Remembering(DiscrepancyRegressor):
    """The diagnosis, which keeps what each of its fits found."""

    fits: ClassVar[list] = []

    def fit(self, X, y):
        super().fit(X, y)
        self.fits.append(self.findings_)
        return self


@pytest.fixture(scope="module")
def unread():
    """Six machines whose stiffness falls by 0.2 a machine; three of them have a hardening spring."""
    recordings = {f"M{i}": machine(10 + i, 12.0 - 0.2 * i, 6.0 + i if i % 2 else 0.0) for i in range(6)}
    dx = Remembering(
        ODESimulator(stage, parameters=NOMINAL, **ABOUT),
        effects=["cubic_stiffness", "quadratic_drag"],
        n_leaders=4,
        max_effects=1,
        window=48,
    )
    return dx, recordings


@pytest.fixture(scope="module")
def fleet(unread):
    return *unread, diagnose_fleet(*unread)


@pytest.mark.long
def test_the_machines_with_the_effect_are_named_and_no_others(fleet):
    _, _, found = fleet
    assert found.effects["effect"].tolist() == ["cubic_stiffness"]
    row = found.effects.iloc[0]
    assert row["recordings"] == ["M1", "M3", "M5"]
    assert row["place"] == "in the equation of velocity"
    assert row["share"] == 0.5
    assert 0 < row["low"] < 0.5 < row["high"] < 1
    assert (found.machines["q_value"] >= found.machines["p_value"] * (1 - 1e-12)).all()
    assert found.machines.loc["M0", "effects"] == ""


@pytest.mark.long
def test_what_only_comes_nearest_in_a_recording_does_not_count_and_what_has_no_name_does(fleet):
    dx, recordings, _ = fleet
    (finding,) = dict(zip(recordings, dx.fits, strict=False))["M1"]
    nameless = replace(finding, effect="unknown", stands=False)
    own = pd.DataFrame()
    found = {
        name: _One(verdict, 0.001, [said], own, 0.95)
        for name, verdict, said in (
            ("told", "explained", finding),
            ("nearest", "unknown", replace(finding, stands=False)),
            ("nameless", "unknown", nameless),
        )
    }
    effects = _effect_table(found, 0.95).set_index("effect")
    assert effects["recordings"].to_dict() == {"cubic_stiffness": ["told"], "unknown": ["nameless"]}
    values = _value_table(found, np.arange(3.0))
    assert values["recording"].drop_duplicates().tolist() == ["told", "nameless"]


@pytest.mark.long
def test_differences_and_drift_of_a_parameter_are_told_from_its_errors(fleet):
    _, _, found = fleet
    row = found.parameters.query("parameter == 'stiffness'").iloc[0]
    assert (row["n"], row["unit"]) == (6, "1/s^2")
    assert row["low"] < 11.5 < row["high"]
    assert row["p_differ"] < 1e-6
    assert row["p_drift"] < 1e-3
    assert row["slope_low"] < -0.2 < row["slope_high"]
    damping = found.parameters.query("parameter == 'damping'").iloc[0]
    assert damping["p_drift"] > 0.01
    assert damping["low"] - 0.02 < 0.8 < damping["high"] + 0.02
    effect = found.parameters.query("effect == 'cubic_stiffness'").iloc[0]
    assert effect["n"] == 3
    assert effect["low"] < 9.0 < effect["high"]


def test_sessions_of_one_record_are_the_recordings(unread):
    _, recordings = unread
    u, y = (np.concatenate([pair[i] for pair in recordings.values()]) for i in (0, 1))
    sessions = np.repeat(list(recordings), [len(pair[0]) for pair in recordings.values()])
    cut = by_session(u, y, sessions)
    assert list(cut) == list(recordings)
    for name, pair in recordings.items():
        np.testing.assert_array_equal(cut[name], pair)


# -- the summary of one parameter ---------------------------------------------------------------------------


def test_a_summary_worked_by_hand():
    """Weights 1, 1/4 and 1/4 of 1, 2 and 4: mean 5/3, scatter 11/6."""
    x, s = np.array([1.0, 2.0, 4.0]), np.array([1.0, 2.0, 2.0])
    w = 1 / s**2
    mean = (1.0 + 0.5 + 1.0) / 1.5
    scatter = (1 - mean) ** 2 + (2 - mean) ** 2 / 4 + (4 - mean) ** 2 / 4
    assert scatter == pytest.approx(11 / 6)
    pooled = pool_estimates(x, s)
    assert pooled.between == 0.0  # 11/6 is less than the two degrees of freedom
    assert pooled.mean == pytest.approx(mean)
    assert pooled.p_differ == pytest.approx(np.exp(-scatter / 2))  # chi-squared of two degrees of freedom
    # Hartung and Knapp: Q / (n - 1) / sum of weights, times Student's 4.302653 of two degrees
    assert pooled.high - mean == pytest.approx(4.302653 * np.sqrt(scatter / 2 / w.sum()), rel=1e-6)


def test_the_variance_between_machines_is_dersimonian_and_laird_s():
    rng = np.random.default_rng(0)
    x, s = rng.normal(size=9), rng.uniform(0.1, 0.5, 9)
    w = 1 / s**2
    scatter = w @ (x - np.average(x, weights=w)) ** 2
    between = (scatter - 8) / (w.sum() - (w**2).sum() / w.sum())
    assert pool_estimates(x, s).between == pytest.approx(np.sqrt(between))


def test_intervals_and_tests_keep_their_level_with_few_machines():
    rng = np.random.default_rng(1)
    covered, next_covered, drifts, n_trials = 0, 0, 0, 800
    for _ in range(n_trials):
        s = rng.uniform(0.5, 1.5, 6)
        truth = 3.0 + 0.8 * rng.normal(size=7)
        pooled = pool_estimates(truth[:6] + s * rng.normal(size=6), s)
        covered += pooled.low < 3.0 < pooled.high
        next_covered += pooled.next_low < truth[6] < pooled.next_high
        drifts += pooled.p_drift < 0.05
    # three standard deviations of a share of 0.95 in 800 trials are 0.023
    assert covered / n_trials > 0.93
    assert next_covered / n_trials > 0.85  # the variance between machines is hardly known from six
    assert drifts / n_trials < 0.075


def test_too_few_machines_give_nan_and_no_warning():
    one, two = pool_estimates([1.0], [0.1]), pool_estimates([1.0, 1.2], [0.1, 0.1])
    assert np.isnan([one.low, one.p_differ, one.slope, two.slope, two.p_drift]).all()
    assert two.low < 1.1 < two.high


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (([1.0, 2.0], [0.1]), "one length"),
        (([1.0, 2.0], [0.1, 0.0]), "above zero, got 0.0"),
        (([1.0, 2.0], [0.1, 0.1], [1.0]), "one number for each of 2 recordings"),
    ],
)
def test_wrong_estimates_are_refused(arguments, match):
    with pytest.raises(ValueError, match=match):
        pool_estimates(*arguments)


def test_wrong_fleets_are_refused(unread):
    dx, recordings = unread
    with pytest.raises(TypeError, match="must be a DiscrepancyRegressor"):
        diagnose_fleet(ODESimulator(stage, parameters=NOMINAL, **ABOUT), recordings)
    with pytest.raises(ValueError, match="level must lie between 0 and 1"):
        diagnose_fleet(dx, recordings, level=95)
    with pytest.raises(ValueError, match="Recording 'short'"):
        diagnose_fleet(dx, {"short": (np.zeros(3), np.zeros(3))})


def test_all_recordings_are_read_before_the_first_is_diagnosed(unread, monkeypatch):
    dx, recordings = unread
    monkeypatch.setattr(DiscrepancyRegressor, "fit", lambda *_: pytest.fail("diagnosed already"))
    good, wrong = (
        next(iter(recordings.values() if hasattr(recordings, "values") else recordings)),
        np.ones((9, 7)),
    )
    with pytest.raises(ValueError, match="Recording 'wrong': X has 7 columns"):
        diagnose_fleet(dx, {"good": good, "wrong": (wrong, np.ones(9))})

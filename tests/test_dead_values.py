"""Values that recorders write where nothing was measured are no measurements."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from small_machines import levels, make_oscillator

from narx_sklearn import NARXRegressor
from narx_sklearn.discrepancy import DiscrepancyRegressor
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.model.dead_values import NINES, dead_in_record, dead_in_words, dead_values, known_values

N = 1500
HOLE = slice(400, 420)


@pytest.fixture
def signal():
    return np.random.default_rng(0).normal(size=N)


@pytest.fixture
def moves():
    return levels(np.random.default_rng(1), N, hold=17)


@pytest.mark.parametrize("value", [-9999.0, 99999.0, -999.0, -999.9, 32767.0, -32768.0, 1e30])
def test_known_values_are_found_in_any_signal(signal, value):
    signal[HOLE] = value
    signal[900] = value
    assert np.flatnonzero(dead_values(signal)).tolist() == [*range(400, 420), 900]


def test_nines_are_what_is_written_with_nines_alone():
    def is_of_nines(value):
        digits = f"{value:.10g}".replace(".", "")
        return len(digits) >= 3 and set(digits) == {"9"}

    numbers = np.concatenate(
        [np.arange(0.0, 10000.0), np.arange(0.0, 10000.0) / 10, 10.0 ** np.arange(-5, 13)]
    )
    near = np.outer(NINES, [1.0, 1.0 + 1e-11, 1.0 - 1e-11, 1.0 + 1e-9, 1.0 - 1e-9, 0.1, 10.0, 100.0]).ravel()
    for values in (numbers, near):
        np.testing.assert_array_equal(known_values(values), np.unique([v for v in values if is_of_nines(v)]))
        np.testing.assert_array_equal(known_values(-values), -known_values(values)[::-1])


def test_other_values_are_found_where_they_are_repeated_in_what_is_measured(signal, moves):
    signal[HOLE] = 300.0
    assert not dead_values(signal).any()
    assert dead_values(signal, moves).sum() == 20
    signal[900:905] = -400.0
    signal[1000:1005] = -9999.0
    assert dead_values(signal, moves).sum() == 30


def test_motion_pulses_clipping_and_constants_are_alive(signal, moves):
    assert not dead_values(signal, moves).any()
    assert not dead_values(np.clip(signal, -1, 1), moves).any()
    assert not dead_values(np.where(np.arange(N) < 700, 0.0, 9999.0), moves).any()
    assert not dead_values(np.full(N, np.nan), moves).any()
    signal[HOLE] = 30.0 + signal[HOLE]  # a pulse is not the same to the last digit
    assert not dead_values(signal, moves).any()
    assert not dead_values(999.0 * signal, moves).any()
    switched = np.repeat([0.0, 1.0, 0.0, 99.5, 1.0], N // 5)
    assert not dead_values(switched, switched[:, None]).any()


def test_dead_values_of_a_record_are_found_column_by_column(signal, moves):
    u = moves.copy()
    u[700] = -9999.0
    y = np.column_stack([signal, signal])
    y[HOLE, 0] = 300.0
    dead = dead_in_record(u, y)
    assert np.flatnonzero(dead.u).tolist() == [700]
    assert np.flatnonzero(dead.y[:, 0]).tolist() == list(range(400, 420))
    assert not dead.y[:, 1].any()
    assert dead_in_record(np.empty((N, 0)), y).y[:, 0].sum() == 20


def test_half_of_a_record_is_no_failure(signal):
    signal[: N // 2 + 1] = -9999.0
    assert not dead_values(signal).any()


def test_dead_values_are_told_with_where_they_are(signal):
    signal[HOLE] = -9999.0
    signal[900] = -9999.0
    said = dead_in_words(signal, dead_values(signal), "level")
    assert said.startswith("21 samples of level are -9999 (400 to 419, 900), where all others lie between -")


def test_dead_values_of_a_record_are_told_and_left_out():
    rng = np.random.default_rng(0)
    u = levels(rng, N)
    y = make_oscillator(gain=4.4).simulate(u)
    y += 0.002 * rng.normal(size=y.shape)
    y[HOLE] = -9999.0
    u[1100:1103] = 99999.0
    dx = DiscrepancyRegressor(make_oscillator(), effects=["stuck_sensor", "sensor_clip"]).fit(u, y)
    assert dx.verdict_ == "refit"
    assert [finding.code for finding in dx.data_findings_] == ["dead_values", "dead_values"]
    assert [finding.evidence["signal"] for finding in dx.data_findings_] == ["drive", "position"]
    assert "20 samples of position are -9999 (400 to 419)" in dx.report_
    assert dx.parameters_["augmented"]["gain"] == pytest.approx(4.4, rel=5e-3)


def test_runs_and_scores_take_dead_values_as_missing_too_and_say_so():
    rng = np.random.default_rng(0)
    u = levels(rng, N)
    simulator = make_oscillator()
    y = simulator.simulate(u) + 0.002 * rng.normal(size=(N, 1))
    dx = DiscrepancyRegressor(simulator, effects=["coulomb_friction"]).fit(u, y[:, 0])
    missing_u, missing_y, dead_u, dead_y = u.copy(), y.copy(), u.copy(), y.copy()
    missing_u[1100:1103], dead_u[1100:1103] = np.nan, 99999.0
    missing_y[HOLE], dead_y[HOLE] = np.nan, -9999.0
    missing_y[3], dead_y[3] = np.nan, 32767.0
    with pytest.warns(NarxWarning, match=r"3 samples of drive are 99999 \(1100 to 1102\), .* as missing"):
        run = dx.predict(dead_u)
    np.testing.assert_array_equal(run, dx.predict(missing_u))
    with pytest.warns(NarxWarning, match="One sample of position is 32767"):
        run = dx.predict(u, y_init=dead_y[:50])
    np.testing.assert_array_equal(run, dx.predict(u, y_init=missing_y[:50]))
    with pytest.warns(NarxWarning, match="drive are 99999|position are -9999 or 32767") as told:
        score = dx.score(dead_u, dead_y)
    assert len(told) == 2
    assert {warning.filename for warning in told} == {__file__}
    assert score == dx.score(missing_u, missing_y) > 0.99


def test_names_that_leave_more_than_the_simulation_as_it_was_given_explain_nothing():
    rng = np.random.default_rng(0)
    u = levels(rng, N)
    y = make_oscillator(gain=4.4).simulate(u)
    y += 0.002 * rng.normal(size=y.shape)
    dx = DiscrepancyRegressor(make_oscillator(), effects=["coulomb_friction"]).fit(u, y)
    found = dx.conclusion_
    assert not found.is_worse_than_given
    scores = found.scores.copy()
    scores.loc["augmented"] = 3.0 * scores.loc["nominal"]
    assert replace(found, scores=scores).is_worse_than_given
    cheaper = replace(found.diagnosis, nominal=found.diagnosis.nominal._replace(cost=0.0))
    assert replace(found, diagnosis=cheaper).is_worse_than_given


@pytest.fixture
def table():
    """Return a record of a first-order machine, as a table."""
    u = np.random.default_rng(0).uniform(-1, 1, size=400)
    y = np.zeros(400)
    for k in range(1, 400):
        y[k] = 0.5 * y[k - 1] + u[k - 1]
    return pd.DataFrame({"drive [V]": u, "level [m]": y})


FIRST_ORDER = {"output_lags": 1, "input_lags": 1, "degree": 1, "refine": False, "max_terms": None}


def fitted(table, **how):
    return NARXRegressor(**FIRST_ORDER, **how).fit(table[["drive [V]"]], table["level [m]"])


def test_an_identified_record_with_dead_values_is_fitted_as_it_is_and_told_with_the_way_out(table):
    gone = table.copy()
    gone.loc[200:209, "level [m]"] = -9999.0
    gone.loc[7, "drive [V]"] = 32767.0
    with pytest.warns(NarxWarning) as told:
        lost = fitted(gone)
    in_output, in_input = (str(warning.message) for warning in told)
    assert in_output.startswith("10 samples of level are -9999 (200 to 209), where all others lie between -")
    assert in_input.startswith("One sample of drive is 32767 (7), where all others lie between -")
    assert "replace them by NaN" in in_output
    assert "replace it by NaN" in in_input
    assert told[0].filename == __file__  # where it was fitted
    low, high = lost.model_.recorded["level"][0], lost.model_.recorded["drive"][2]
    assert (low, high) == (-9999.0, 32767.0)
    found = fitted(gone.replace([-9999.0, 32767.0], np.nan))  # without a warning
    assert dict(zip(found.terms_, found.coef_, strict=True)) == pytest.approx(
        {"level[k-1]": 0.5, "drive[k-1]": 1.0}
    )


def test_a_batch_with_dead_values_is_told_too(table):
    table.loc[200:209, "level [m]"] = -9999.0
    with pytest.warns(NarxWarning, match="10 samples of level are -9999"):
        NARXRegressor(**FIRST_ORDER).partial_fit(table[["drive [V]"]], table["level [m]"])


def test_a_fit_takes_large_values_and_odd_numbers_for_what_they_are(table):
    """In a register that counts to 65535, and of what goes evenly up to 9999."""
    counts = table.assign(**{"level [m]": np.round(32767.5 + 16000 * table["level [m]"])})
    counts.loc[0, "level [m]"] = 65535.0
    fitted(counts)
    fitted(table * 9999.0 / table.abs().max())

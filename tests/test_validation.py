"""Passes over long records are made in blocks that must not show; rows of X and y are of the same samples."""

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.model_selection import TimeSeriesSplit, cross_val_score

from narx_sklearn import NARXRegressor, NARXRegressorCV, _validation
from narx_sklearn._validation import (
    all_finite,
    as_signals,
    blocks,
    check_indexes,
    finite_columns,
    session_slices,
    split_unit,
)
from narx_sklearn.analysis import advise
from narx_sklearn.compensation import InverseCompensator, PrandtlIshlinskiiCompensator, RootCompensator
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.identification import ErrSelector
from narx_sklearn.identification.free_run.many import by_session, free_run_many
from narx_sklearn.model import NARXModel, free_run, predict_k_steps, predict_one_step
from narx_sklearn.physics import BoucWen


@given(st.lists(st.integers(0, 2), min_size=1, max_size=40), st.integers(1, 7))
def test_sessions_are_the_runs_of_equal_labels_whatever_the_blocks(labels, block_rows):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_validation, "BLOCK_ROWS", block_rows)
        pieces = session_slices(np.array(labels), len(labels))
    assert pieces[0].start == 0
    assert pieces[-1].stop == len(labels)
    for piece, after in pairwise(pieces):
        assert piece.stop == after.start
        assert labels[piece.stop - 1] != labels[after.start]
    assert all(len(set(labels[piece])) == 1 for piece in pieces)


@given(st.integers(0, 50), st.integers(1, 9))
def test_blocks_cover_every_sample_once(n_samples, block_rows):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_validation, "BLOCK_ROWS", block_rows)
        covered = [i for block in blocks(n_samples) for i in range(block.start, block.stop)]
    assert covered == list(range(n_samples))


def test_a_column_is_found_empty_only_if_all_its_blocks_are(monkeypatch):
    monkeypatch.setattr(_validation, "BLOCK_ROWS", 3)
    data = np.full((10, 3), np.nan)
    data[0, 0] = data[9, 2] = 1.0
    assert finite_columns(data).tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([1.0, -2.0], True),
        ([1.0, np.nan], False),
        ([np.inf, -np.inf], False),
        ([1e308, 1e308], False),
        ([], True),
    ],
)
def test_all_finite_errs_on_the_side_of_another_look(values, expected):
    assert all_finite(np.array(values)) is expected


def test_inputs_whose_sum_overflows_are_simulated_like_others():
    model = NARXModel.from_equations("0.5*y[k-1] + 1e-308*u[k-1]")
    np.testing.assert_allclose(free_run(model, np.full(4, 1e308), [0.0]).y[:, 0], [0.0, 1.0, 1.5, 1.75])


# -- rows of X and y ---------------------------------------------------------------------------------------

MODEL = NARXModel.from_equations("0.5*y[k-1] + u[k-1]")
X_FRAME = pd.DataFrame({"u": np.random.default_rng(0).normal(size=200)})
Y_SERIES = pd.Series(free_run(MODEL, X_FRAME, [0.0]).y[:, 0], name="y")
FITTED = NARXRegressor(n_terms=2).fit(X_FRAME, Y_SERIES)
INVERTED = RootCompensator(MODEL).fit()
TAKES_BOTH = {
    "fit": lambda X, y: NARXRegressor(n_terms=2).fit(X, y),
    "partial_fit": lambda X, y: NARXRegressor(n_terms=2).partial_fit(X, y),
    "cv": lambda X, y: NARXRegressorCV([1], [1], degree=[1], max_terms=2, cv=2).fit(X, y),
    "score": FITTED.score,
    "one step": FITTED.predict_one_step,
    "k steps": lambda X, y: FITTED.predict_k_steps(X, y, 2),
    "model, one step": lambda X, y: predict_one_step(MODEL, X, y),
    "model, k steps": lambda X, y: predict_k_steps(MODEL, X, y, 2),
    "many": lambda X, y: free_run_many(MODEL, [(X, y)]),
    "by session": lambda X, y: by_session(X, y, np.zeros(len(X))),
    "advise": lambda X, y: advise(MODEL, X, y),
    "selector": lambda X, y: ErrSelector().fit(X, y),
    "Bouc-Wen": lambda X, y: BoucWen(n_starts=1, exponent_bounds=(1, 1), random_state=0).fit(X, y),
    "root": lambda X, y: RootCompensator(NARXRegressor(n_terms=2)).fit(X, y),
    "inverse": lambda X, y: InverseCompensator(NARXRegressor(1, 2, n_terms=2)).fit(X, y),
    "plays": lambda X, y: PrandtlIshlinskiiCompensator().fit(X, y),
    "compensator's score": INVERTED.score,
}


@pytest.mark.filterwarnings("ignore::narx_sklearn.exceptions.NarxWarning")
@pytest.mark.parametrize("call", TAKES_BOTH.values(), ids=TAKES_BOTH)
def test_rows_of_other_samples_are_refused_wherever_inputs_and_outputs_meet(call):
    call(X_FRAME[5:], Y_SERIES[5:])
    with pytest.raises(ValueError, match=r"different row labels \(row 0 is 3 in X and 5 in y\)"):
        call(X_FRAME[3:-2], Y_SERIES[5:])
    with pytest.raises(ValueError, match="same row labels in another order"):
        call(X_FRAME, Y_SERIES[::-1])


@pytest.mark.parametrize("swapped", [False, True])
def test_first_rows_of_inputs_beside_later_rows_of_outputs_are_asked_about(swapped):
    X, y = X_FRAME[:80], Y_SERIES[80:160]
    if swapped:
        X, y = X_FRAME[80:160], Y_SERIES[:80]
    ours, theirs = ("80 to 159", "0 to 79") if swapped else ("0 to 79", "80 to 159")
    told = rf"labels {ours} and y {theirs}, none in common; .*set_axis\(X\.index"
    with pytest.warns(NarxWarning, match=told):
        check_indexes(X, y)
    check_indexes(X, y.set_axis(X.index))  # each way out ends the warning
    check_indexes(X.reset_index(drop=True), y.reset_index(drop=True))
    check_indexes(X.to_numpy(), y)


def test_an_index_that_only_counts_is_paired_by_position_in_folds_too():
    dated = X_FRAME.set_axis(pd.date_range("2024-01-01", periods=200, freq="1s"))
    scores = cross_val_score(NARXRegressor(n_terms=2), dated, Y_SERIES, cv=TimeSeriesSplit(3))
    assert scores == pytest.approx(np.ones(3))
    NARXRegressor(n_terms=2).fit(X_FRAME[5:], Y_SERIES[5:].reset_index(drop=True))
    NARXRegressor(n_terms=2).fit(X_FRAME[5:], Y_SERIES[:-5].to_numpy())
    check_indexes(X_FRAME.set_axis(np.arange(200) * 0.1), Y_SERIES.set_axis(range(100, 300)))
    with pytest.raises(ValueError, match="different row labels"):
        check_indexes(X_FRAME.set_axis(np.arange(200) * 0.1), Y_SERIES.set_axis(np.arange(200) * 0.2))


@pytest.mark.parametrize(
    ("label", "name", "unit"),
    [
        ("Zeit (ms)", "Zeit", "ms"),
        ("Position(mm)", "Position", "mm"),
        ("friction (N s/m)", "friction", "N s/m"),
        ("a (m/s^2)", "a", "m/s^2"),
        ("n (1/min)", "n", "1/min"),
        ("T (°C)", "T", "°C"),
        ("valve ( % )", "valve", "%"),
        ("time (min)", "time", "min"),
        ("speed (motor) [rad/s]", "speed (motor)", "rad/s"),
    ],
)
def test_a_unit_in_round_brackets_is_one(label, name, unit):
    assert split_unit(label) == (name, unit)


@pytest.mark.parametrize(
    "label",
    ["position (left)", "u(t)", "y(k)", "x (2)", "x (1.5)", "x (max)", "x (min)", "x (L)", "flow (in)", "(V)",
     "f (raw)", "position (m) raw", "y (sim)", "pressure (mean of both sides)"],
)  # fmt: skip
def test_words_and_numbers_in_round_brackets_belong_to_the_name(label):
    assert split_unit(label) == (label, None)


def test_signals_are_named_without_units_in_round_brackets():
    X = pd.DataFrame({"Drive (V)": np.sin(np.arange(50.0))})
    y = pd.Series(0.5 * np.sin(np.arange(50.0) - 1), name="Position (mm)")
    narx = NARXRegressor(0, 1, degree=1, refine=False, n_terms=1).fit(X, y)
    assert narx.terms_ == ["Drive[k-1]"]
    assert narx.model_.units == {"Drive": "V", "Position": "mm"}


def test_text_among_numbers_is_told_with_what_makes_gaps_of_it():
    X = pd.DataFrame({"drive [V]": ["0.5", "1.5", "n/a"] * 20, "load": np.arange(60.0)})
    y = np.arange(60.0)
    told = r"X's column 'drive \[V\]' holds text, such as 'n/a'.*to_numeric\(X\['drive \[V\]'\], errors="
    with pytest.raises(ValueError, match=told):
        NARXRegressor(0, 1, degree=1).fit(X, y)
    mended = X.assign(**{"drive [V]": pd.to_numeric(X["drive [V]"], errors="coerce")})
    written = mended.astype({"drive [V]": object})
    written.iloc[0, 0] = "0.5"  # text that is a number counts as one
    for table in (mended, written):
        assert as_signals(table, "X")[:2, 0].tolist() == [0.5, 1.5]


def test_a_column_of_times_is_told_to_belong_into_the_index():
    times = pd.date_range("2026-01-01", periods=50, freq="s")
    X = pd.DataFrame({"clock": times, "u": np.sin(np.arange(50.0))})
    y = pd.Series(0.5 * np.sin(np.arange(50.0) - 1), name="y")
    told = r"X's column 'clock' holds times.*X\.set_index\('clock'\)"
    for table in (X, X[["clock"]], X.assign(clock=times - times[0])):
        with pytest.raises(TypeError, match=told):
            NARXRegressor(0, 1, degree=1).fit(table, y)
    written = X.assign(clock=times.strftime("%Y-%m-%d %H:%M:%S"))
    told_of_text = (
        r"X's column 'clock' holds times, such as '2026-01-01 00:00:00'.*to_datetime\(X\.pop\('clock'\)"
    )
    for fit in (NARXRegressor(0, 1, degree=1).fit, NARXRegressorCV([0], [1], degree=[1]).fit):
        with pytest.raises(TypeError, match=told_of_text):
            fit(written, y)
    as_told = written.set_index(pd.to_datetime(written.pop("clock")))
    y_then = y.set_axis(as_told.index)
    assert NARXRegressor(0, 1, degree=1, refine=False).fit(as_told, y_then).model_.sampling_period == 1.0
    with pytest.raises(TypeError, match="y holds times, such as '2026-01-01"):
        NARXRegressor(0, 1, degree=1).fit(X[["u"]], times.strftime("%Y-%m-%d").to_series(index=y.index))
    with pytest.raises(TypeError, match="y's column 'clock' holds times"):
        NARXRegressor(0, 1, degree=1).fit(X[["u"]], X[["clock"]])
    narx = NARXRegressor(0, 1, degree=1, refine=False).fit(X[["u"]], y)
    with pytest.raises(TypeError, match=told):
        narx.predict(X)
    with pytest.raises(TypeError, match=told):
        free_run(narx.model_, X)
    assert (
        NARXRegressor(0, 1, degree=1).fit(X.set_index("clock"), y.set_axis(times)).model_.sampling_period == 1
    )

"""What the labels of rows tell: the sampling period, and rows that are missing, uneven or out of order."""

import numpy as np
import pandas as pd
import pytest

from narx_sklearn import LagTransformer, NARXModel, NARXRegressor, NARXRegressorCV, RootCompensator
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.model.times import index_step, rows_out_of_line

N = 300
U = np.random.default_rng(0).normal(size=N)
STAMPS = pd.date_range("2025-01-01", periods=N, freq="10ms")
FRAME = pd.DataFrame({"drive [V]": U, "position [mm]": np.convolve(U, [0.0, 0.3, 0.2])[:N]})


def fit(frame, sessions=None, **options):
    model = NARXRegressor(1, 2, degree=1, **options)
    return model.fit(frame[["drive [V]"]], frame["position [mm]"], sessions=sessions).model_


def without(frame, *rows):
    return frame.drop(frame.index[list(rows)])


@pytest.mark.parametrize(
    "index",
    [
        STAMPS,
        STAMPS - STAMPS[0],
        STAMPS.tz_localize("Europe/Vienna"),
        STAMPS.astype(str),
        STAMPS.tz_localize("Europe/Vienna").strftime("%Y-%m-%dT%H:%M:%S.%f%z"),
        pd.Index(np.arange(N) * 0.01, name="time [s]"),
        pd.Index(np.round(100.0 + np.arange(N) * 0.01, 6), name="t [s]"),
    ],
    ids=["stamps", "deltas", "zone", "texts", "texts with a zone", "seconds", "rounded"],
)
def test_a_model_keeps_the_step_of_a_time_index(index):
    assert fit(FRAME.set_axis(index)).sampling_period == pytest.approx(0.01, rel=1e-8)
    assert NARXRegressorCV(1, 1, degree=1).fit(
        FRAME.set_axis(index)[["drive [V]"]], FRAME["position [mm]"].set_axis(index)
    ).model_.sampling_period == pytest.approx(0.01, rel=1e-8)


@pytest.mark.parametrize(
    "index",
    [
        np.arange(N),
        np.arange(N) * 3,
        np.arange(N) * 0.5,
        pd.Index([f"row {k}" for k in range(N)]),
        pd.Index([str(2000 + k) for k in range(N)]),
        pd.Index(["2025-01-01", *"?" * (N - 1)]),
    ],
    ids=["numbers", "threes", "floats", "words", "digits", "one time"],
)
def test_an_index_that_is_no_time_says_nothing(index):
    frame = FRAME.set_axis(index)
    assert rows_out_of_line(frame, None, "X") == ""
    assert index_step(frame, None, "X") is None
    assert fit(frame).sampling_period is None


def test_a_batch_that_goes_on_with_a_session_keeps_the_step_of_its_index():
    frame, model = FRAME.set_axis(STAMPS), NARXRegressor(1, 2, degree=1)
    for piece in (slice(0, 150), slice(150, N)):
        part = frame.iloc[piece]
        model.partial_fit(part[["drive [V]"]], part["position [mm]"], sessions=np.zeros(150))
    assert model.model_.sampling_period == pytest.approx(0.01, rel=1e-8)


SHUFFLED = np.random.default_rng(1).permutation(N)


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (without(FRAME, 50, 51, 52, 200), "row numbers of X skip 4 rows, at 2 places: the first at row 50"),
        (without(FRAME.set_axis(STAMPS), 50), "time index of X skips 1 row, at 1 place: the first at row 50"),
        (FRAME.iloc[SHUFFLED], f"row {1 + np.flatnonzero(np.diff(SHUFFLED) < 0)[0]} is .* shuffle=False"),
        (pd.concat([FRAME, FRAME]), f"go back at row {N}, from {N - 1} to 0, .*sessions"),
        (FRAME.set_axis(STAMPS.floor("1s")), "uneven: its steps are of 0 to 1 s, 0 s in the median"),
        (FRAME.set_axis(STAMPS.insert(9, STAMPS[8])[:N]), "uneven: its steps are of 0 to .* before row 9"),
        (
            FRAME.set_axis(STAMPS + pd.to_timedelta(9 * np.random.default_rng(2).uniform(size=N), "ms")),
            "uneven.*resample",
        ),
    ],
    ids=["dropped", "dropped times", "shuffled", "joined", "rough", "repeated", "jitter"],
)
def test_rows_out_of_line_are_told_where_lags_read_them(frame, words):
    with pytest.warns(NarxWarning, match=words):
        fit(frame)
    with pytest.warns(NarxWarning, match=words):
        LagTransformer(lags=[1]).fit(FRAME).transform(frame)
    with pytest.warns(NarxWarning, match=words):
        NARXRegressorCV(1, 1, degree=1).fit(frame[["drive [V]"]], frame["position [mm]"])


def test_rows_of_the_output_alone_can_be_out_of_line():
    y = FRAME["position [mm]"].drop(50)
    with pytest.warns(NarxWarning, match="row numbers of y skip 1 row"):
        NARXRegressor(1, 1, degree=1).fit(U[: N - 1, None], y)


def test_times_that_go_back_are_refused_but_between_sessions():
    again = pd.concat([FRAME.set_axis(STAMPS)] * 2)
    with pytest.raises(ValueError, match=f"time index of X goes back at row {N}.*sessions"):
        fit(again)
    assert fit(again, np.repeat([0, 1], N)).sampling_period == pytest.approx(0.01)


def test_sessions_between_which_rows_are_missing_say_nothing():
    for frame in (FRAME, FRAME.set_axis(STAMPS)):
        cut = without(frame, *range(100, 120))
        assert rows_out_of_line(cut, np.repeat([0, 1], [100, N - 120]), "X") == ""


def test_rows_of_another_period_are_told():
    with pytest.warns(NarxWarning, match=r"advances by 0\.01 s .* sampling_period=0\.02 s, 2 times as long"):
        assert fit(FRAME.set_axis(STAMPS), sampling_period=0.02).sampling_period == 0.02
    model = NARXRegressor(1, 2, degree=1, sampling_period=0.02).fit(U[:, None], FRAME["position [mm]"])
    with pytest.warns(NarxWarning, match=r"advances by 0\.01 s"):
        model.predict(FRAME.set_axis(STAMPS)[["drive [V]"]].to_numpy() * 0 + pd.DataFrame(U, STAMPS))


PLANT = NARXModel.from_equations("0.5*y[k-1] + u[k-1]", sampling_period=0.02)


def test_a_reference_of_another_period_or_with_missing_rows_is_told():
    compensator = RootCompensator(PLANT).fit()
    with pytest.warns(NarxWarning, match=r"advances by 0\.01 s .* the model by sampling_period=0\.02 s"):
        compensator.predict(pd.Series(np.sin(np.arange(N) / 9), STAMPS))
    with pytest.warns(NarxWarning, match="row numbers of X skip 1 row"):
        compensator.predict(pd.Series(np.sin(np.arange(N) / 9)).drop(7))
    compensator.predict(pd.Series(np.sin(np.arange(N) / 9), STAMPS[0] + 2 * (STAMPS - STAMPS[0])))

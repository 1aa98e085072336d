"""Figures of an identification: free run and selection path, their numbers and that they draw."""

import sys

import numpy as np
import pandas as pd
import pytest

from narx_sklearn import ErrSelector, NARXRegressor
from narx_sklearn.displays import FreeRunDisplay, SelectionPathDisplay
from narx_sklearn.metrics import nrmse

mpl = pytest.importorskip("matplotlib")


@pytest.fixture
def plt():
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    yield plt
    plt.close("all")


@pytest.fixture(scope="module")
def record():
    rng = np.random.default_rng(0)
    u = rng.uniform(-1, 1, 600)
    y = np.zeros(600)
    for k in range(2, 600):
        y[k] = 0.5 * y[k - 1] - 0.2 * y[k - 2] + u[k - 1] ** 2 + 0.05 * rng.normal()
    return pd.DataFrame({"drive [V]": u}), pd.Series(y, name="position [um]")


@pytest.fixture(scope="module")
def narx(record):
    return NARXRegressor(3, 2, degree=2, refine=False, sampling_period=0.1).fit(*record)


def test_the_free_run_drawn_is_that_of_predict_and_scores_what_was_not_given(plt, narx, record):
    X, y = record
    display = FreeRunDisplay.from_estimator(narx, X, y)
    simulated, lag = narx.predict(X, y_init=y), narx.model_.max_lag
    np.testing.assert_array_equal(display.y_pred, simulated)
    assert display.nrmse_ == pytest.approx(nrmse(y[lag:], simulated[lag:]), rel=1e-12)
    assert display.to_frame()["initial"].sum() == lag
    assert display.axes_[0].get_ylabel() == "position (um)"
    assert display.axes_[1].get_xlabel() == "time (s)"
    assert display.axes_[1].lines[0].get_xdata()[-1] == pytest.approx(59.9)
    display.figure_.canvas.draw()


def test_every_session_has_its_own_initial_condition(plt, narx, record):
    X, y = record
    sessions = np.repeat([0, 1, 2], 200)
    display = FreeRunDisplay.from_estimator(narx, X, y, sessions=sessions)
    lag = narx.model_.max_lag
    np.testing.assert_array_equal(np.flatnonzero(display.is_initial) % 200, np.tile(np.arange(lag), 3))
    np.testing.assert_array_equal(display.y_pred, narx.predict(X, y_init=y, sessions=sessions))


def test_a_free_run_scores_zero_where_the_prediction_is_the_measurement_and_skips_gaps(plt):
    y = np.array([1.0, np.nan, 3.0, -1.0])
    display = FreeRunDisplay.from_predictions(y, np.array([1.0, 2.0, 3.0, -1.0]))
    assert display.nrmse_ == 0.0
    assert display.axes_[1].get_xlabel() == "sample"
    assert np.isnan(FreeRunDisplay(np.full(3, np.nan), np.zeros(3)).nrmse_)


def test_the_selection_path_holds_ratios_of_the_model_and_the_criterion_of_every_size(plt, narx):
    display = SelectionPathDisplay.from_estimator(narx)
    assert display.err.to_dict() == dict(zip(narx.terms_, narx.err_, strict=True))
    assert display.err.is_monotonic_decreasing
    np.testing.assert_array_equal(display.criterion, narx.path_.criterion("ebic"))
    assert display.criterion.idxmin() == narx.path_.best_size("ebic") == len(narx.terms_)
    frame = display.to_frame()
    assert frame.loc[1, "term"] == display.err.index[0]
    assert frame["err"].count() == len(narx.terms_)
    assert [text.get_text() for text in display.axes_[0].get_yticklabels()] == list(display.err.index)
    assert display.axes_[1].get_ylabel() == "EBIC"
    other = SelectionPathDisplay.from_estimator(narx, criterion="aic")
    np.testing.assert_array_equal(other.criterion, narx.path_.criterion("aic"))
    display.figure_.canvas.draw()


def test_features_chosen_by_a_selector_keep_their_column_names(plt):
    X = pd.DataFrame(np.random.default_rng(0).normal(size=(80, 4)), columns=list("abcd"))
    selector = ErrSelector(n_terms=2).fit(X, X["c"] - 0.3 * X["b"])
    assert SelectionPathDisplay.from_estimator(selector).err.index.tolist() == ["c", "b"]


def test_a_size_other_than_the_minimum_is_marked_apart(plt):
    err = pd.Series([0.9, 0.05], index=["a", "b"])
    criterion = pd.Series([0.0, -3.0, -2.0], index=[0, 1, 2])
    labels = SelectionPathDisplay(err, criterion).plot().axes_[1].get_legend().get_texts()
    assert [label.get_text() for label in labels] == ["minimum, 1 terms", "model, 2 terms"]


def test_the_minimum_is_not_lost_in_a_flat_line(plt):
    sizes = np.arange(21)
    criterion = pd.Series(np.where(sizes < 4, 13_000.0 - 15_000.0 * sizes, (sizes - 12.0) ** 2 - 48_000.0))
    path = SelectionPathDisplay(pd.Series([0.9], index=["a"]), criterion).plot().axes_[1]
    low, high = path.get_ylim()
    assert low < -48_000.0  # the minimum, at 12 terms, and all from 4 on
    assert criterion[4:].between(low, high).all()
    assert high < -47_900.0


def test_what_cannot_be_drawn_is_said(plt, narx, record):
    X, y = record
    with pytest.raises(TypeError, match="ErrSelector has no model_"):
        FreeRunDisplay.from_estimator(ErrSelector(), X, y)
    with pytest.raises(ValueError, match="output is 1, but y has 1 columns"):
        FreeRunDisplay.from_estimator(narx, X, y, output=1)
    with pytest.raises(ValueError, match=r"shape \(2, 1\) and y_pred has shape \(3, 1\)"):
        FreeRunDisplay.from_predictions([0.0, 1.0], [0.0, 1.0, 2.0])
    with pytest.raises(TypeError, match="NARXRegressor has no path_"):
        SelectionPathDisplay.from_estimator(NARXRegressor())
    with pytest.raises(ValueError, match="output is 3, but there are 1 outputs"):
        SelectionPathDisplay.from_estimator(narx, output=3)
    with pytest.raises(ValueError, match="ax holds 1 axes, this figure has 2"):
        FreeRunDisplay.from_estimator(narx, X, y, ax=plt.figure().gca())


def test_given_axes_are_drawn_in_and_style_is_left_alone(plt, narx, record):
    before = dict(mpl.rcParams)
    figure, axes = plt.subplots(2, 2)
    assert FreeRunDisplay.from_estimator(narx, *record, ax=axes[0]).figure_ is figure
    assert SelectionPathDisplay.from_estimator(narx, ax=axes[1]).axes_ == tuple(axes[1])
    assert dict(mpl.rcParams) == before


def test_missing_matplotlib_is_said_with_its_install_name(monkeypatch, narx, record):
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    for draw in (FreeRunDisplay.from_estimator, lambda e, *_: SelectionPathDisplay.from_estimator(e)):
        with pytest.raises(ImportError, match=r'pip install "narx-sklearn\[plot\]"'):
            draw(narx, *record)

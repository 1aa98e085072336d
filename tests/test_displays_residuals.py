import sys

import numpy as np
import pandas as pd
import pytest

from narx_sklearn.analysis.residuals import residual_tests
from narx_sklearn.displays._residuals import ResidualTestsDisplay

mpl = pytest.importorskip("matplotlib")
OPTIONS = {"max_lag": 5, "n_resamples": 39}


@pytest.fixture
def plt(monkeypatch):
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    yield plt
    plt.close("all")


@pytest.fixture
def record():
    rng = np.random.default_rng(0)
    X = pd.DataFrame({"valve [V]": rng.normal(size=200)})
    y_pred = np.roll(X["valve [V]"].to_numpy(), 1)
    y = y_pred + 0.3 * rng.normal(size=200)
    return X, y, y_pred


class OneStep:
    """Smallest estimator the display can use."""

    def predict_one_step(self, X, y, sessions=None):
        self.sessions = sessions
        y_pred = np.roll(np.asarray(X)[:, 0], 1)
        y_pred[0] = np.nan
        return y_pred if np.ndim(y) == 1 else np.column_stack([y_pred, y_pred])


def test_numbers_are_those_of_the_residual_tests(plt, record):
    X, y, y_pred = record
    display = ResidualTestsDisplay.from_predictions(y, y_pred, X, **OPTIONS)
    expected = residual_tests(y - y_pred, X, y, **OPTIONS).to_frame()
    pd.testing.assert_frame_equal(display.to_frame(), expected)


def test_every_test_has_a_labelled_panel_with_its_correlations_and_bounds(plt, record):
    X, y, y_pred = record
    display = ResidualTestsDisplay.from_predictions(y, y_pred, X, **OPTIONS)
    n_tests = len(display.tests.tests)
    assert len(display.axes_) == len(display.stems_) == len(display.bounds_) == n_tests == 8
    for axes in display.axes_:
        assert axes.get_xlabel() == "lag (samples)"
        assert axes.get_ylabel() == "correlation"
    assert display.axes_[0].get_title().startswith("ξ, ξ   p")
    assert display.axes_[2].get_title().startswith("valve, ξ   p")
    heights = [segment[1, 1] for segment in display.stems_[0].get_segments()]
    np.testing.assert_array_equal(heights, display.tests.tests[0].correlation)
    display.figure_.canvas.draw()


def test_the_cross_correlation_shows_feedback_at_negative_lags(plt, record):
    X, y, y_pred = record
    display = ResidualTestsDisplay.from_predictions(y, y_pred, X, **OPTIONS)
    lags = [segment[0, 0] for segment in display.stems_[2].get_segments()]
    np.testing.assert_array_equal(lags, np.arange(-5, 6))


def test_from_estimator_predicts_one_step_and_routes_sessions(plt, record):
    X, y, y_pred = record
    estimator, sessions = OneStep(), np.arange(200) // 100
    display = ResidualTestsDisplay.from_estimator(estimator, X, y, sessions=sessions, **OPTIONS)
    assert estimator.sessions is sessions
    assert display.tests.n_samples == 199
    y2 = np.column_stack([np.zeros(200), y])
    second = ResidualTestsDisplay.from_estimator(OneStep(), X, y2, output=1, **OPTIONS)
    y_pred[0] = np.nan
    pd.testing.assert_frame_equal(
        second.to_frame(), ResidualTestsDisplay.from_predictions(y, y_pred, X, **OPTIONS).to_frame()
    )


def test_panels_go_where_they_are_told(plt, record):
    X, y, y_pred = record
    tests = residual_tests(y - y_pred, X, y, **OPTIONS)
    figure, ax = plt.subplots()
    display = ResidualTestsDisplay(tests)
    assert display.plot(ax=ax) is display
    assert display.figure_ is figure
    _, axes = plt.subplots(2, 4)
    assert display.plot(ax=axes).axes_ == list(axes.ravel())
    with pytest.raises(ValueError, match="ax holds 3 axes, but there are 8 tests"):
        display.plot(ax=axes.ravel()[:3])


def test_drawing_leaves_global_style_alone(plt, record):
    X, y, y_pred = record
    before = dict(mpl.rcParams)
    ResidualTestsDisplay.from_predictions(y, y_pred, X, **OPTIONS)
    assert dict(mpl.rcParams) == before


def test_bad_arguments_are_refused(plt, record):
    X, y, y_pred = record
    with pytest.raises(TypeError, match=r"object has no predict_one_step.*from_predictions"):
        ResidualTestsDisplay.from_estimator(object(), X, y)
    with pytest.raises(ValueError, match="output is 2, but y has 2 columns"):
        ResidualTestsDisplay.from_estimator(OneStep(), X, np.column_stack([y, y]), output=2)
    with pytest.raises(ValueError, match=r"y_true has shape \(200, 1\) and y_pred has shape \(199, 1\)"):
        ResidualTestsDisplay.from_predictions(y, y_pred[1:], X)


def test_missing_matplotlib_is_said_with_its_install_name(record, monkeypatch):
    X, y, y_pred = record
    display = ResidualTestsDisplay(residual_tests(y - y_pred, X, **OPTIONS))
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    with pytest.raises(ImportError, match=r'pip install "narx-sklearn\[plot\]"'):
        display.plot()

"""Figures of the analyses: the numbers they hold, that they draw, what they refuse."""

import inspect
import sys

import numpy as np
import pandas as pd
import pytest
from thesis_models import EXAMPLE_2_9, EXAMPLE_4_1

from narx_sklearn import NARXRegressor, displays
from narx_sklearn.analysis import hysteresis_loop, quasi_static_sets, static_curve
from narx_sklearn.displays._hysteresis import HysteresisLoopDisplay
from narx_sklearn.displays._quasi_static import QuasiStaticDisplay
from narx_sklearn.displays._static_curve import StaticCurveDisplay
from narx_sklearn.model import NARXModel

mpl = pytest.importorskip("matplotlib")
BISTABLE = NARXModel.from_equations("1.3*y[k-1] - 0.3*y[k-1]^3 + 0.2*u[k-1]", units={"u": "V"})
LEVELS = np.linspace(-1.0, 1.0, 41)


@pytest.fixture
def plt():
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    yield plt
    plt.close("all")


def test_the_static_curve_is_drawn_branch_by_branch(plt):
    display = StaticCurveDisplay.from_model(BISTABLE, LEVELS)
    pd.testing.assert_frame_equal(display.to_frame(), static_curve(BISTABLE, LEVELS).to_frame())
    assert (len(display.stable_), len(display.unstable_)) == (2, 1)
    assert display.ax_.get_xlabel() == "constant u (V)"
    assert display.ax_.get_ylabel() == "y at rest"
    display.figure_.canvas.draw()


def test_a_continuum_is_written_into_the_static_curve(plt):
    display = StaticCurveDisplay.from_model(EXAMPLE_4_1, LEVELS)
    assert display.ax_.texts[0].get_text() == "every output is a steady state"
    assert display.ax_.get_ylabel() == "y (um) at rest"
    assert display.stable_ == []
    display.figure_.canvas.draw()


@pytest.mark.parametrize("display", [StaticCurveDisplay, HysteresisLoopDisplay, QuasiStaticDisplay])
def test_displays_of_a_model_take_the_estimator_that_holds_it(display, plt):
    u = np.random.default_rng(0).uniform(-1, 1, 200)
    y = np.zeros(200)
    for k in range(1, 200):
        y[k] = 0.5 * y[k - 1] + u[k - 1]
    narx = NARXRegressor(1, 1, degree=1).fit(u[:, None], y)
    asked = (LEVELS,) if display is StaticCurveDisplay else (-1.0, 1.0)
    drawn, expected = display.from_estimator(narx, *asked), display.from_model(narx.model_, *asked)
    pd.testing.assert_frame_equal(drawn.to_frame(), expected.to_frame())
    with pytest.raises(TypeError, match="NARXRegressor holds no model_; fit it first"):
        display.from_estimator(NARXRegressor(), *asked)


def test_every_display_is_made_drawn_and_tabulated_in_the_same_way():
    for name in displays.__all__:
        display = getattr(displays, name)
        assert name.endswith("Display")
        assert any(made.startswith("from_") for made in dir(display)), name
        assert (
            "ax" in inspect.signature(display.plot).parameters
            or "axes" in inspect.signature(display.plot).parameters
        ), name
        assert callable(display.to_frame), name


def test_loops_are_drawn_inside_their_bounding_structure(plt):
    display = HysteresisLoopDisplay.from_model(EXAMPLE_2_9, -1.0, 1.0, samples_per_branch=(20, 200))
    assert len(display.loops_) == 2
    bounds = [np.unique(line.get_ydata().round(9)).tolist() for line in display.bounding_]
    assert bounds == [[5.0], [-5.0]]
    frame = display.to_frame()
    assert frame.groupby("samples_per_branch").size().to_dict() == {20: 41, 200: 401}
    display.figure_.canvas.draw()


def test_a_bounding_structure_that_does_not_hold_is_left_out(plt):
    options = {"samples_per_branch": (50,)}
    assert HysteresisLoopDisplay.from_model(EXAMPLE_4_1, -40.0, 40.0, **options).bounding_ == []
    assert HysteresisLoopDisplay.from_model(EXAMPLE_2_9, -1, 1, bounding=False, **options).bounding_ == []


def test_quasi_static_sets_are_drawn_with_their_loop(plt):
    display = QuasiStaticDisplay.from_model(EXAMPLE_4_1, -70.0, 70.0, samples_per_branch=100)
    assert set(display.attracting_) == set(display.repelling_) == {1, -1}
    assert all(len(lines) == 1 for lines in (*display.attracting_.values(), *display.repelling_.values()))
    level, y = display.sets.select(1, attracting=True)
    np.testing.assert_array_equal(display.attracting_[1][0].get_xdata(), level)
    np.testing.assert_array_equal(display.attracting_[1][0].get_ydata(), y[:, 0])
    low, high = display.ax_.get_ylim()
    assert low < display.loop.y.min() < display.loop.y.max() < high
    assert display.ax_.get_xlabel() == "u (V)"
    pd.testing.assert_frame_equal(display.to_frame(), display.sets.to_frame())
    display.figure_.canvas.draw()


def test_one_regime_can_be_drawn_alone_in_given_axes(plt):
    sets = quasi_static_sets(EXAMPLE_4_1, LEVELS, rate=0.1)
    figure, ax = plt.subplots()
    display = QuasiStaticDisplay(sets)
    assert display.plot(ax=ax, direction="loading") is display
    assert display.figure_ is figure
    assert set(display.attracting_) == {1}
    assert display.loop_ is None
    with pytest.raises(ValueError, match="direction='up' is not known; choose one of both, loading"):
        display.plot(ax=ax, direction="up")


def test_drawing_leaves_global_style_alone(plt):
    before = dict(mpl.rcParams)
    StaticCurveDisplay.from_model(BISTABLE, LEVELS)
    HysteresisLoopDisplay([hysteresis_loop(EXAMPLE_2_9, -1.0, 1.0, samples_per_branch=20)]).plot()
    QuasiStaticDisplay(quasi_static_sets(EXAMPLE_2_9, LEVELS, rate=0.1)).plot()
    assert dict(mpl.rcParams) == before


def test_missing_matplotlib_is_said_with_its_install_name(monkeypatch):
    displays = [
        StaticCurveDisplay(static_curve(BISTABLE, LEVELS)),
        HysteresisLoopDisplay([hysteresis_loop(EXAMPLE_2_9, -1.0, 1.0, samples_per_branch=20)]),
        QuasiStaticDisplay(quasi_static_sets(EXAMPLE_2_9, LEVELS, rate=0.1)),
    ]
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", None)
    for display in displays:
        with pytest.raises(ImportError, match=r'pip install "narx-sklearn\[plot\]"'):
            display.plot()

"""What a model leaves over: one step ahead, or of the free run where the noise is on the output."""

import numpy as np
import pytest

from narx_sklearn import NARXRegressor, NARXRegressorCV
from narx_sklearn.analysis import residual_tests
from narx_sklearn.displays import ResidualTestsDisplay
from narx_sklearn.identification.validation.residuals import (
    model_residuals,
    one_step_residuals,
    simulation_residuals,
)
from narx_sklearn.model import NARXModel

ROUNDING = 1e-10  # of levels near 1, over a nudge of 1e-4 and up to 800 samples
TANK = NARXModel.from_equations("0.995*y[k-1] + 0.05*u[k-1]")


def slow_tank(seed=0, n_samples=800, in_equation=0.0, on_output=0.0):
    rng = np.random.default_rng(seed)
    u, y = np.repeat(rng.uniform(-1, 1, n_samples // 10), 10), np.zeros(n_samples)
    for k in range(1, n_samples):
        y[k] = 0.995 * y[k - 1] + 0.05 * u[k - 1] + in_equation * rng.normal()
    return u[:, None], y + on_output * rng.normal(size=n_samples)


def test_the_right_model_passes_where_noise_is_on_the_output():
    X, y = slow_tank(on_output=0.05)
    narx = NARXRegressor(1, 1, degree=1).fit(X, y)
    assert narx.noise_ == "output"
    assert not residual_tests(y - narx.predict_one_step(X, y), X, n_resamples=99).passed
    assert residual_tests(narx.residuals(X, y), X, n_resamples=99).passed
    drawn = ResidualTestsDisplay.from_estimator(narx, X, y, n_resamples=99)
    assert drawn.tests.passed


def test_one_step_ahead_is_looked_at_where_noise_is_in_the_equation():
    X, y = slow_tank(in_equation=0.05)
    narx = NARXRegressor(1, 1, degree=1).fit(X, y)
    assert narx.noise_ == "equation"
    np.testing.assert_array_equal(narx.residuals(X, y), y - narx.predict_one_step(X, y))


def test_a_wrong_first_level_is_not_left_over_in_any_session():
    X, y = slow_tank()
    sessions = np.repeat([0, 1], 400)
    wrong = y.copy()
    wrong[[0, 400]] += 0.3, -0.2
    left = simulation_residuals(TANK, X, wrong[:, None], sessions)
    assert np.flatnonzero(np.isnan(left)).tolist() == [0, 400]
    assert np.nanmax(np.abs(left)) < ROUNDING


def test_gaps_have_no_residuals_and_leave_the_others():
    X, y = slow_tank()
    y = y[:, None]
    y[0], y[100:103], X[200:202] = np.nan, np.nan, np.nan
    left = model_residuals(TANK, X, y, "output")
    # unknown are the gaps and, as the model looks one sample back, the sample after each
    assert np.flatnonzero(np.isnan(left)).tolist() == [0, 1, 100, 101, 102, 103, 200, 201, 202]
    assert np.nanmax(np.abs(left)) < ROUNDING


def test_a_record_without_a_start_leaves_nothing():
    assert np.isnan(simulation_residuals(TANK, np.ones((3, 1)), np.array([[np.nan], [np.nan], [1.0]]))).all()


@pytest.mark.parametrize("noise", ["equation", "output"])
def test_models_without_past_outputs_have_the_same_residuals_either_way(noise):
    static, X = NARXModel.from_equations("2*u[k]"), np.ones((4, 1))
    y = np.array([[2.0], [3.0], [2.0], [2.0]])
    assert model_residuals(static, X, y, noise).ravel().tolist() == [0.0, 1.0, 0.0, 0.0]


def test_shapes_follow_y_and_the_search_hands_on():
    X, y = slow_tank(on_output=0.05, n_samples=300)
    search = NARXRegressorCV(output_lags=(1,), input_lags=(1,), degree=(1,)).fit(X, y)
    assert search.residuals(X, y).shape == (300,)
    np.testing.assert_array_equal(search.residuals(X, y), search.best_estimator_.residuals(X, y))
    narx = NARXRegressor(1, 1, degree=1, refine=False).fit(X, y[:, None])
    np.testing.assert_array_equal(
        narx.residuals(X, y[:, None]), one_step_residuals(narx.model_, X, y[:, None])
    )

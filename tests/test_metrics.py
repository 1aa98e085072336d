import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.metrics import make_scorer, mean_absolute_error, r2_score, root_mean_squared_error

from narx_sklearn.metrics import fit_percent, mape, nrmse, nsavi, rmse

METRICS = [rmse, nrmse, fit_percent, mape]
Y = np.array([[0.0, 1.0], [1.0, 3.0], [4.0, 2.0], [2.0, 7.0], [3.0, 5.0]])
Y_HAT = np.array([[0.5, 1.0], [1.0, 2.0], [3.0, 2.0], [2.5, 6.0], [3.0, 5.5]])


def test_values_by_hand():
    y, y_hat = [0.0, 1.0, 2.0, 4.0, 3.0], [0.0, 1.0, 2.0, 2.0, 4.0]  # errors 2 and 1
    assert rmse(y, y_hat) == pytest.approx(1.0)  # sqrt(5 / 5)
    assert nrmse(y, y_hat) == pytest.approx(np.sqrt(5 / 10))  # sum (y - 2)^2 = 10
    assert nrmse(y, y_hat, normalization="range") == pytest.approx(0.25)
    assert fit_percent(y, y_hat) == pytest.approx(100 * (1 - np.sqrt(0.5)))
    assert mape(y, y_hat) == pytest.approx(100 * 3 / (5 * 4))
    assert nsavi([0, 1, 1, 0], [0, 3, 2, 2]) == pytest.approx(4 / 2)


@pytest.mark.parametrize("multioutput", ["raw_values", "uniform_average", [0.2, 0.8]])
@pytest.mark.parametrize("sample_weight", [None, [1.0, 2.0, 0.5, 1.0, 3.0]])
def test_they_agree_with_scikit_learn(multioutput, sample_weight):
    how = {"multioutput": multioutput, "sample_weight": sample_weight}
    np.testing.assert_allclose(rmse(Y, Y_HAT, **how), root_mean_squared_error(Y, Y_HAT, **how))
    raw = {"multioutput": "raw_values", "sample_weight": sample_weight}
    r2 = r2_score(Y, Y_HAT, **raw)
    np.testing.assert_allclose(nrmse(Y, Y_HAT, **raw), np.sqrt(1 - r2))
    expected = 100 * mean_absolute_error(Y, Y_HAT, **raw) / np.ptp(Y, axis=0)
    np.testing.assert_allclose(mape(Y, Y_HAT, **raw), expected)


@pytest.mark.parametrize("metric", METRICS)
def test_a_mask_is_the_record_without_the_masked_samples(metric):
    keep = np.array([True, False, True, True, True])
    y, y_hat = Y.copy(), Y_HAT.copy()
    y[1], y_hat[1] = 1e6, np.nan
    assert metric(y, y_hat, sample_weight=keep) == pytest.approx(metric(Y[keep], Y_HAT[keep]))


@pytest.mark.parametrize("metric", METRICS)
def test_gaps_in_the_measurement_are_left_out(metric):
    y = Y[:, 0].copy()
    y[2] = np.nan
    keep = np.isfinite(y)
    assert metric(y, Y_HAT[:, 0]) == pytest.approx(metric(y[keep], Y_HAT[keep, 0]))


@pytest.mark.parametrize("metric", METRICS)
def test_a_missing_prediction_is_never_skipped_in_silence(metric):
    y_hat = Y_HAT[:, 0].copy()
    y_hat[3:] = np.nan
    with pytest.raises(ValueError, match="y_pred is NaN at 2 samples of output 0 that count, the first at "):
        metric(Y[:, 0], y_hat)


def test_a_diverged_run_has_infinite_error():
    y_hat = np.array([0.0, 1.0, 4.0, np.inf, -np.inf])
    assert rmse(Y[:, 0], y_hat) == np.inf
    assert mape(Y[:, 0], y_hat) == np.inf
    assert fit_percent(Y[:, 0], y_hat) == -np.inf


@pytest.mark.parametrize("metric", [nrmse, fit_percent, mape])
@given(gain=st.sampled_from([1e-9, 2.0, 1e9]), offset=st.integers(-300, 300), seed=st.integers(0, 50))
def test_relative_errors_know_no_unit(metric, gain, offset, seed):
    y, y_hat = np.random.default_rng(seed).normal(size=(2, 20))
    # 1e-9: an offset of 300 costs two to three of sixteen digits, its square twice that
    assert metric(gain * (y + offset), gain * (y_hat + offset)) == pytest.approx(metric(y, y_hat), rel=1e-9)


@pytest.mark.parametrize("metric", [nrmse, fit_percent, mape])
def test_constant_measurement_is_refused(metric):
    with pytest.raises(ValueError, match=r"y_true is constant \(2\) over the 4 samples"):
        metric([2.0, 2.0, 2.0, 2.0], [1.0, 2.0, 3.0, 4.0])


@pytest.mark.parametrize("metric", METRICS)
def test_bad_arguments_are_refused(metric):
    with pytest.raises(ValueError, match=r"y_true has shape \(5, 2\) and y_pred has shape \(4, 2\)"):
        metric(Y, Y_HAT[1:])
    with pytest.raises(ValueError, match=r"sample_weight has shape \(3,\), but \(5,\) is wanted"):
        metric(Y, Y_HAT, sample_weight=[1, 1, 1])
    with pytest.raises(ValueError, match="negative or NaN"):
        metric(Y, Y_HAT, sample_weight=[1, 1, 1, 1, -1])
    with pytest.raises(ValueError, match="No sample of output 0 is left"):
        metric(Y, Y_HAT, sample_weight=np.zeros(5))
    with pytest.raises(ValueError, match="multioutput='mean' is not known"):
        metric(Y, Y_HAT, multioutput="mean")
    with pytest.raises(ValueError, match="multioutput has 3 weights, but there are 2 outputs"):
        metric(Y, Y_HAT, multioutput=[1, 1, 1])


def test_unknown_normalization_is_refused():
    with pytest.raises(ValueError, match="normalization='max' is not known; choose one of 'std', 'range'"):
        nrmse(Y, Y_HAT, normalization="max")


def test_no_compensation_is_effort_one():
    r = np.random.default_rng(0).normal(size=(50, 2))
    np.testing.assert_array_equal(nsavi(r, r, multioutput="raw_values"), [1.0, 1.0])


def test_effort_counts_no_step_across_a_gap_or_between_sessions():
    r, m = np.array([0.0, 1.0, 5.0, 6.0]), np.array([0.0, 2.0, 9.0, 10.0])
    assert nsavi(r, m, sessions=[0, 0, 1, 1]) == pytest.approx(3 / 2)
    assert nsavi(r, np.array([0.0, np.nan, 9.0, 10.0])) == pytest.approx(1.0)


def test_resting_reference_is_refused():
    with pytest.raises(ValueError, match="reference does not move in column 1"):
        nsavi(np.column_stack([np.arange(4.0), np.ones(4)]), np.zeros((4, 2)))


def test_a_metric_becomes_a_scorer():
    class Constant(RegressorMixin, BaseEstimator):
        def fit(self, X, y):
            return self

        def predict(self, X):
            return np.full(len(X), 2.0)

    scorer = make_scorer(mape, greater_is_better=False)
    assert scorer(Constant(), Y[:, :1], Y[:, 0]) == pytest.approx(-100 * 6 / (5 * 4))

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter

from narx_sklearn.analysis.sampling import sampling_advice


def sine(period, n_periods=40):
    return np.sin(2 * np.pi * np.arange(period * n_periods) / period)


def test_memory_of_a_sine_is_half_a_period_and_of_its_square_a_quarter():
    advice = sampling_advice(sine(200), 0.01)
    # the biased autocorrelation tapers by 1 - tau / N, which moves a minimum by at most one sample here
    assert advice.tau_y == pytest.approx(100, abs=1)
    assert advice.tau_y2 == pytest.approx(50, abs=1)
    assert advice.tau_m == advice.tau_y2
    assert advice.period_range == pytest.approx((advice.tau_m / 2000, advice.tau_m / 1000))
    assert advice.loose_period_range == pytest.approx((advice.tau_m / 2500, advice.tau_m / 500))


def test_autocorrelation_equals_the_sum_over_pairs_within_segments():
    rng = np.random.default_rng(0)
    y = rng.normal(size=120)
    y[50] = np.nan
    sessions = np.arange(120) // 80
    advice = sampling_advice(y, 1.0, max_lag=12, sessions=sessions)
    parts = [np.arange(0, 50), np.arange(51, 80), np.arange(80, 120)]
    z = y - np.nanmean(y)
    for column, signal in enumerate([z, z**2 - np.nanmean(z**2)]):
        phi = np.array(
            [
                sum(signal[k] * signal[k - tau] for part in parts for k in part if k - tau in part)
                for tau in range(13)
            ]
        )
        np.testing.assert_allclose(advice.autocorrelation[:, column], phi / phi[0], atol=1e-12)


@given(factor=st.integers(1, 12), seed=st.integers(0, 10))
def test_decimated_by_the_advice_the_record_lies_in_the_advised_range(factor, seed):
    y = sine(60 * factor) + 0.01 * np.random.default_rng(seed).normal(size=2400 * factor)
    advice = sampling_advice(y, 1.0)
    if advice.decimation > 1:
        assert 10 <= advice.tau_m / advice.decimation <= 20


def test_offset_and_unit_change_nothing():
    y = lfilter([1.0], [1.0, -1.9, 0.95], np.random.default_rng(1).normal(size=3000))
    one, other = sampling_advice(y, 1.0), sampling_advice(300.0 + 1e-3 * y, 1.0)
    assert (one.tau_y, one.tau_y2) == (other.tau_y, other.tau_y2)


def test_oversampled_record_gets_a_factor_and_the_warning_about_hysteresis():
    advice = sampling_advice(sine(400), 0.001)
    assert advice.decimation == -(-advice.tau_m // 20)
    assert "Do not decimate data with hysteresis" in advice.verdict
    assert f"keep every {advice.decimation}th sample" in str(advice)


def test_well_sampled_record_is_kept():
    advice = sampling_advice(sine(60), 0.5)
    assert advice.decimation == 1
    assert "the sampling period of 0.5 s suits it" in advice.verdict


def test_undersampled_record_must_be_made_again():
    advice = sampling_advice(sine(10, n_periods=200), 2.0)
    assert advice.decimation == 1
    assert "too long for its dynamics. Record again" in advice.verdict


def test_a_drift_gives_no_advice_but_a_way_out():
    advice = sampling_advice(np.arange(1000.0), 1.0, max_lag=40)
    assert not advice.found
    assert advice.decimation == 1
    assert "stays correlated over all 40 lags" in advice.verdict


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((np.ones(100), 1.0), r"y is constant \(1\)"),
        ((np.arange(10.0), 1.0), "longest unbroken segment of y has 10 samples, but more than 20"),
        ((np.arange(100.0), 0.0), "sampling_period is 0.0, but a positive time"),
        ((np.ones((100, 2)), 1.0), "y has 2 columns; ask for advice once per output"),
        ((np.full(100, np.nan), 1.0), "longest unbroken segment of y has 0 samples"),
    ],
)
def test_bad_input_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        sampling_advice(*arguments)

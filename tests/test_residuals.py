import re

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lfilter
from scipy.stats import binom

from narx_sklearn.analysis._correlations import _lagged_sums, holm
from narx_sklearn.analysis._surrogates import draw_surrogate, fit_noise_model, segment_reach
from narx_sklearn.analysis.residuals import residual_tests
from narx_sklearn.exceptions import ExcitationWarning

FAST = 99  # surrogates: the tests are exact with any number, only the p-values are coarser


def coloured(rng, n, pole, draw="normal"):
    return lfilter([1.0], [1.0, -pole], getattr(rng, draw)(size=n + 500))[500:]


def by_name(result, name, u="u"):
    return next(test for test in result.tests if test.name == name and test.input in (None, u))


def rejected(result):
    return {test.name for test in result.tests if test.rejected}


def slow_sums(a, b, segment, max_lag):
    """Sum the products inside segments, sample by sample; segment -1 is a missing sample."""
    total, square = np.zeros(max_lag + 1), np.zeros(max_lag + 1)
    for tau in range(max_lag + 1):
        for k in range(tau, b.size):
            if segment[k] >= 0 and len(set(segment[k - tau : k + 1])) == 1:
                total[tau] += a[k - tau] * b[k]
                square[tau] += (a[k - tau] * b[k]) ** 2
    return total, square


# --- the pieces


@pytest.mark.parametrize("kernel", [_lagged_sums, _lagged_sums.py_func], ids=["compiled", "python"])
def test_lagged_sums_by_hand(kernel):
    a, b = np.array([1.0, 2.0, 3.0]), np.array([5.0, 7.0, 11.0])
    total, square = kernel(a, b, np.array([0, 1, 2]), 2)
    np.testing.assert_array_equal(total, [5 + 14 + 33, 7 + 22, 11])
    np.testing.assert_array_equal(square, [25 + 196 + 1089, 49 + 484, 121])


@given(
    labels=st.lists(st.sampled_from([-1, 0, 1, 2]), min_size=1, max_size=40),
    max_lag=st.integers(1, 8),
    seed=st.integers(0, 99),
)
def test_no_product_crosses_an_edge_or_a_gap(labels, max_lag, seed):
    labels = np.array(labels)
    a, b = np.random.default_rng(seed).normal(size=(2, labels.size))
    valid = labels >= 0
    reach = segment_reach(valid, labels)
    for kernel in (_lagged_sums, _lagged_sums.py_func):
        sums = kernel(a[valid], b[valid], reach, max_lag)
        # 1e-12: sums of at most 40 products of order one
        np.testing.assert_allclose(sums, slow_sums(a, b, labels, max_lag), atol=1e-12)


def test_holm_by_hand():
    # smallest times 4, next times 3, then times 2 = 0.06 lifted to the 0.09 before it, then times 1
    np.testing.assert_allclose(holm(np.array([0.04, 0.005, 0.03, 0.03])), [0.09, 0.02, 0.09, 0.09])


def test_burg_recovers_an_autoregression_over_segments():
    rng = np.random.default_rng(0)
    xi = lfilter([1.0], [1.0, -1.5, 0.8], rng.normal(size=6000))
    labels = np.arange(6000) // 300
    noise = fit_noise_model(xi, segment_reach(np.ones(6000, bool), labels), max_order=10)
    assert noise.order == 2
    # standard error of an AR(2) coefficient: sqrt((1 - 0.8^2) / 6000) = 0.008
    np.testing.assert_allclose(noise.a, [1.0, -1.5, 0.8], atol=0.03)


@given(seed=st.integers(0, 200), order=st.integers(1, 8))
def test_noise_models_are_stable(seed, order):
    rng = np.random.default_rng(seed)
    xi = np.cumsum(rng.normal(size=200)) + np.sin(np.arange(200))
    noise = fit_noise_model(xi - xi.mean(), np.arange(200), order)
    assert np.all(np.abs(np.roots(noise.a)) < 1.0)


def test_white_surrogates_are_the_residuals_in_another_order():
    rng = np.random.default_rng(0)
    xi = rng.laplace(size=50)
    xi = (xi - xi.mean()) / xi.std()
    noise = fit_noise_model(xi, np.arange(50), max_order=0)
    np.testing.assert_allclose(np.sort(draw_surrogate(noise, 50, rng)), np.sort(xi), rtol=1e-12, atol=1e-12)


# --- correlations and bounds


def test_correlations_equal_the_slow_form_with_sessions_and_gaps():
    rng = np.random.default_rng(1)
    n, max_lag = 240, 6
    xi, u, y = rng.normal(size=(3, n))
    xi[[0, 100]] = np.nan
    u[30] = np.nan
    y[[31, 200]] = np.nan
    sessions = np.repeat(["a", "b", "c"], 80)
    result = residual_tests(xi, u, y, max_lag=max_lag, sessions=sessions, n_resamples=19)

    valid = np.isfinite(xi) & np.isfinite(u) & np.isfinite(y)
    segment = np.where(valid, np.cumsum(~valid) + 1000 * np.repeat([0, 1, 2], 80), -1)

    def centred(x):
        return np.where(valid, x - x[valid].mean(), 0.0)

    xi0, u0 = centred(xi), centred(u)
    y_hat = centred(y - xi)
    pairs = {
        "autocorrelation": (xi0, xi0),
        "output-residual": (centred(xi0**2), centred((y_hat + xi0) * xi0)),
        "cross-correlation": (u0, xi0),
        "residual-input": (centred(xi0 * u0), xi0),
        "even": (centred(u0**2), xi0),
        "spread": (centred(u0**2), centred(xi0**2)),
        "output-input": (centred(u0**2), centred((y_hat + xi0) * xi0)),
    }
    cube = centred(u0**3)
    pairs["odd"] = (cube - u0 * (u0 @ cube) / (u0 @ u0), xi0)
    assert {test.name for test in result.tests} == set(pairs)
    for name, (a, b) in pairs.items():
        test = by_name(result, name)
        expected = slow_sums(a, b, segment, max_lag)[0] / np.sqrt((a @ a) * (b @ b))
        np.testing.assert_allclose(test.correlation, expected[test.lags], atol=1e-12)  # sums of 240 products
    feedback = result.feedback[0]
    expected = slow_sums(xi0, u0, segment, max_lag)[0] / np.sqrt((u0 @ u0) * (xi0 @ xi0))
    np.testing.assert_array_equal(feedback.lags, np.arange(-max_lag, 0))
    np.testing.assert_allclose(feedback.correlation, expected[-feedback.lags], atol=1e-12)


def test_a_row_of_nan_parts_recordings_as_session_labels_do():
    rng = np.random.default_rng(2)
    xi, u = rng.normal(size=(2, 200))
    labelled = residual_tests(xi, u, sessions=np.arange(200) // 100, max_lag=5, n_resamples=FAST)
    parted = residual_tests(np.insert(xi, 100, np.nan), np.insert(u, 100, 0.0), max_lag=5, n_resamples=FAST)
    pd.testing.assert_frame_equal(labelled.to_frame(), parted.to_frame())


@given(
    gain=st.sampled_from([1e-12, -3.0, 1e12]), offset=st.sampled_from([0.0, 300.0]), seed=st.integers(0, 20)
)
def test_units_and_offsets_change_nothing(gain, offset, seed):
    rng = np.random.default_rng(seed)
    xi, u, y_hat = rng.normal(size=(3, 100))
    one = residual_tests(xi, u, y_hat + xi, max_lag=3, n_resamples=19)
    other = residual_tests(
        gain * xi, abs(gain) * (u + offset), gain * (y_hat + xi + offset), max_lag=3, n_resamples=19
    )
    # 1e-6: a ranking may only move where the offset's rounding moves a statistic across a draw
    np.testing.assert_allclose(
        [test.p_value for test in other.tests], [test.p_value for test in one.tests], atol=1e-6
    )


def test_a_lag_lies_outside_exactly_when_the_test_fails():
    rng = np.random.default_rng(3)
    for _ in range(40):
        xi, u = rng.laplace(size=(2, 120))
        result = residual_tests(xi, u, max_lag=8, n_resamples=39, alpha=0.2)
        for test in (*result.tests, *result.feedback):
            assert (test.lags_outside.size > 0) == (test.p_value <= 0.2)


def test_same_seed_same_answer():
    rng = np.random.default_rng(4)
    xi, u = rng.normal(size=(2, 150))
    frames = [residual_tests(xi, u, n_resamples=FAST, random_state=s).to_frame() for s in (0, 0, 1)]
    assert frames[0].equals(frames[1])
    assert not frames[0]["bound"].equals(frames[2]["bound"])


# --- calibration


def false_alarms(n_samples, n_seeds, make_u, noise, n_resamples):
    """Count the alarms of every test and of the verdict over seeds of a model that is right."""
    counts = {}
    for seed in range(n_seeds):
        rng = np.random.default_rng([11, seed])
        u, e = make_u(rng, n_samples), getattr(rng, noise)(size=n_samples)
        y = lfilter([1.0], [1.0, -0.9], np.r_[0.0, u[:-1]] / u.std() + e)
        result = residual_tests(e, u, y, n_resamples=n_resamples, random_state=seed)
        for test in (*result.tests, *result.feedback):
            counts[test.name] = counts.get(test.name, 0) + (test.p_value <= 0.05)
        counts["verdict"] = counts.get("verdict", 0) + (not result.passed)
    return counts


def white(rng, n):
    return rng.normal(size=n)


def slow(rng, n):
    return coloured(rng, n, 0.95)


def multisine(rng, n):
    lines = np.zeros(n // 2 + 1, dtype=complex)
    lines[1 : n // 20] = np.exp(2j * np.pi * rng.uniform(size=n // 20 - 1))
    return np.fft.irfft(lines, n)


def binary(rng, n):
    return np.repeat(rng.choice([-1.0, 1.0], size=n // 5 + 1), 5)[:n]


def test_false_alarm_rate_of_each_test_is_nominal():
    n_seeds = 150
    counts = false_alarms(500, n_seeds, slow, "laplace", n_resamples=39)
    counts.pop("verdict")  # 39 surrogates are too few for Holm's correction
    # two-sided binomial bounds at 1e-4 for each of the nine tests
    low, high = binom.ppf([1e-4, 1 - 1e-4], n_seeds, 0.05)
    assert len(counts) == 9
    for name, count in counts.items():
        assert low <= count <= high, (name, count)


@pytest.mark.long
@pytest.mark.parametrize("n_samples", [200, 1000, 10_000])
@pytest.mark.parametrize("noise", ["normal", "laplace"])
@pytest.mark.parametrize("make_u", [white, slow, multisine, binary])
def test_false_alarm_rates_are_nominal_for_any_input_and_noise(make_u, noise, n_samples):
    n_seeds = 400
    counts = false_alarms(n_samples, n_seeds, make_u, noise, n_resamples=199)
    low, high = binom.ppf([1e-5, 1 - 1e-5], n_seeds, 0.05)
    assert counts.pop("verdict") <= high  # Holm's correction may only be safer than nominal
    for name, count in counts.items():
        assert low <= count <= high, (name, count)


def test_colour_alone_is_not_taken_for_missed_dynamics():
    n_seeds, alarms, found = 30, 0, 0
    for seed in range(n_seeds):
        rng = np.random.default_rng([12, seed])
        xi, u = coloured(rng, 400, 0.9), coloured(rng, 400, 0.95)
        result = residual_tests(xi, u, n_resamples=39, random_state=seed)
        found += by_name(result, "autocorrelation").p_value <= 0.05
        alarms += by_name(result, "cross-correlation").p_value <= 0.05
        assert result.noise_order >= 1
    assert found == n_seeds
    assert alarms <= binom.ppf(1 - 1e-4, n_seeds, 0.05)  # naive 1/sqrt(N) bounds: about three in four


def test_long_records_are_calibrated_on_a_part():
    rng = np.random.default_rng(5)
    xi, u = rng.normal(size=(2, 12_000))
    result = residual_tests(xi + 0.06 * np.roll(u, 2), u, n_resamples=19, max_lag=5)
    test = by_name(result, "cross-correlation")
    assert result.n_samples == 12_000
    # 95 % of six white lags stay inside 2.63 standard errors; 19 draws place the bound roughly
    np.testing.assert_allclose(test.bound, 2.63 / np.sqrt(12_000), rtol=0.4)
    assert test.lags_outside[0] == 2


# --- what is found, and what is said


MISSED = {
    "autocorrelation": lambda e, u: e + 0.5 * np.roll(e, 1),
    "cross-correlation": lambda e, u: e + 0.4 * np.roll(u, 3),
    "even": lambda e, u: e + 0.4 * np.roll(u**2, 3),
    "odd": lambda e, u: e + 0.3 * np.roll(u**3 - 3 * u, 3),
    "residual-input": lambda e, u: e + 0.5 * np.roll(e * u, 1),
    "spread": lambda e, u: e * (0.2 + np.abs(np.roll(u, 3))),
}


@pytest.mark.parametrize("name", MISSED)
def test_what_is_missed_is_named_with_its_lag(name):
    rng = np.random.default_rng(6)
    e, u = rng.normal(size=(2, 1000))
    result = residual_tests(MISSED[name](e, u), u, n_resamples=199)
    lag = 1 if name in ("autocorrelation", "residual-input") else 3
    assert name in rejected(result)
    assert by_name(result, name).lags_outside[0] == lag
    assert not result.passed
    assert f"lag {lag}" in result.verdict or f"lags {lag}," in result.verdict


def test_products_of_output_and_input_are_found_through_the_output():
    rng = np.random.default_rng(7)
    e, u = rng.normal(size=(2, 2000))
    y_hat = 2.0 * np.roll(u**2, 1)
    xi = e + 0.3 * (y_hat - 2.0)
    assert "output-input" in rejected(residual_tests(xi, u, y_hat + xi, n_resamples=199))


def test_nonlinear_noise_is_found_through_the_output():
    rng = np.random.default_rng(8)
    e = rng.normal(size=3000)
    xi = e * np.sqrt(0.3 + 0.7 * np.roll(e, 1) ** 2)  # white, but its size has memory
    result = residual_tests(xi, None, xi, n_resamples=199)
    assert rejected(result) == {"output-residual"}


def test_the_input_at_fault_is_named():
    rng = np.random.default_rng(9)
    X = pd.DataFrame(rng.normal(size=(800, 2)), columns=["valve [V]", "load [N]"])
    xi = rng.normal(size=800) + 0.4 * np.roll(X["load [N]"], 2)
    verdict = residual_tests(xi, X, n_resamples=199).verdict
    assert "misses linear dynamics of input load (lag" in verdict
    assert "valve" not in verdict


def test_nonlinear_findings_wait_for_the_linear_one():
    rng = np.random.default_rng(10)
    u, e = rng.normal(size=(2, 1000))
    result = residual_tests(e + np.roll(u, 3), u, n_resamples=199)
    assert {"cross-correlation", "spread"} <= rejected(result)
    assert "(u^2, xi^2) fail too, which may only follow" in result.verdict
    assert "spread of the residuals" not in result.verdict


def test_white_residuals_pass_in_words():
    rng = np.random.default_rng(14)
    result = residual_tests(*rng.normal(size=(2, 600)), n_resamples=199)
    assert result.passed
    assert result.noise_order == 0
    assert result.verdict.startswith("The residuals pass all 6 tests at the 0.05 level (lags up to 25, 600 ")


def test_closed_loop_is_reported_and_not_held_against_the_model():
    rng = np.random.default_rng(0)
    e, r = rng.normal(size=(2, 1000))
    u = r - 0.8 * np.roll(e, 1)  # the controller answers last sample's disturbance
    result = residual_tests(e, u, n_resamples=199)
    assert result.feedback[0].rejected
    assert result.feedback[0].lags_outside[0] == -1
    assert "made in closed loop" in result.verdict
    assert result.passed


def test_a_system_without_input_is_tested_on_its_own():
    result = residual_tests(np.random.default_rng(1).normal(size=100), None, n_resamples=FAST)
    assert [test.name for test in result.tests] == ["autocorrelation"]
    assert result.feedback == ()


def test_frame_has_a_row_for_each_lag_and_text_a_row_for_each_test():
    rng = np.random.default_rng(2)
    xi, u = rng.normal(size=(2, 100))
    result = residual_tests(xi, u, max_lag=4, n_resamples=FAST)
    frame = result.to_frame()
    assert list(frame.columns) == [
        "test",
        "input",
        "signals",
        "lag",
        "correlation",
        "bound",
        "outside",
        "p_value",
        "adjusted_p_value",
    ]
    assert len(frame) == 4 + 5 + 4 + 5 + 5 + 5 + 4  # autocorrelation ... spread, feedback
    assert frame["input"].isna().sum() == 4
    text = str(result).splitlines()
    assert len(text) == 1 + len(result.tests) + 1
    assert text[1].startswith("xi, xi ")
    assert text[-1] == result.verdict


def test_many_lags_are_listed_shortly():
    rng = np.random.default_rng(3)
    result = residual_tests(coloured(rng, 1000, 0.99), None, n_resamples=FAST)
    assert re.search(r"lags 1, 2, 3, 4 and \d+ more", result.verdict)


# --- input that cannot be tested, or not all of it


def test_two_level_input_has_no_nonlinear_tests_and_says_so():
    rng = np.random.default_rng(4)
    result = residual_tests(rng.normal(size=300), binary(rng, 300), n_resamples=FAST)
    # unequal shares of the two levels still make the square a copy of the input
    assert "odd" not in {test.name for test in result.tests}
    balanced = np.tile([1.0, -1.0, -1.0, 1.0], 75)
    result = residual_tests(rng.normal(size=300), balanced, n_resamples=FAST)
    assert {test.name for test in result.tests} == {"autocorrelation", "cross-correlation", "residual-input"}
    assert "u takes so few values that even and odd nonlinear effects" in result.verdict


def test_constant_input_warns_and_is_left_out():
    rng = np.random.default_rng(5)
    X = np.column_stack([rng.normal(size=100), np.full(100, 2.5)])
    with pytest.warns(ExcitationWarning, match=r"Input u2 is constant \(2.5\): nothing about it"):
        result = residual_tests(rng.normal(size=100), X, n_resamples=FAST)
    assert {test.input for test in result.tests} == {None, "u1"}
    assert "Input u2 is constant" in result.verdict


def test_constant_residuals_are_refused():
    with pytest.raises(ValueError, match=r"residuals are constant \(0.5\) over the 100 usable samples"):
        residual_tests(np.full(100, 0.5), None)


def test_short_records_are_refused_with_the_numbers():
    rng = np.random.default_rng(6)
    with pytest.raises(ValueError, match=r"40 usable samples.*lag 25 is reached 15 times, but 20 are wanted"):
        residual_tests(*rng.normal(size=(2, 40)))
    with pytest.raises(ValueError, match=r"longest unbroken segment 20: lag 25 is reached 0 times"):
        residual_tests(*rng.normal(size=(2, 200)), sessions=np.arange(200) // 20)
    with pytest.raises(ValueError, match=r"0 usable samples, its longest unbroken segment 0"):
        residual_tests(np.full(30, np.nan), None)


def test_lengths_must_agree():
    xi = np.random.default_rng(7).normal(size=100)
    with pytest.raises(ValueError, match="residuals has 100, X has 99, y has 100, sessions has 98"):
        residual_tests(xi, xi[1:], xi, sessions=np.zeros(98))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"max_lag": 0}, "max_lag is 0, but a whole number"),
        ({"max_lag": 2.5}, "max_lag is 2.5, but a whole number"),
        ({"alpha": 0.0}, "alpha is 0.0, but a probability"),
        ({"alpha": 0.01, "n_resamples": 50}, "n_resamples is 50, but alpha=0.01 needs .* at least 99"),
    ],
)
def test_options_out_of_range_are_refused(options, message):
    with pytest.raises(ValueError, match=message):
        residual_tests(np.random.default_rng(8).normal(size=100), None, **options)


def test_infinite_values_and_several_outputs_are_refused():
    rng = np.random.default_rng(9)
    xi = rng.normal(size=100)
    with pytest.raises(ValueError, match="X contains infinity"):
        residual_tests(xi, np.where(np.arange(100) == 3, np.inf, xi))
    with pytest.raises(ValueError, match="residuals has 2 columns, but one output is tested at a time"):
        residual_tests(rng.normal(size=(100, 2)), None)

"""Excitation signals hold the laws of their design, and the report says what they excite."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.signals import (
    StepTable,
    describe_signal,
    hold_limits,
    loading_unloading,
    multisine,
    prfs,
    prvs,
    quasi_static,
    reversal_points,
    step_table,
)

# Table 2.1: a pH process, T_s = 1 s
TABLE_2_1 = StepTable(
    amplitudes=(1, 2, 3, 4, 5, 6),
    k_min_up=(54, 64, 74, 94, 114, 134),
    k_max_up=(108, 128, 148, 188, 228, 268),
    k_min_down=(60, 110, 150, 180, 250, 280),
    k_max_down=(120, 220, 300, 360, 500, 560),
)


def holds(u):
    """Return levels and lengths of the constant stretches of u."""
    edges = np.concatenate([[0], np.flatnonzero(np.diff(u)) + 1, [u.size]])
    return u[edges[:-1]], np.diff(edges)


def step_response(amplitude, k_min, share=0.45):
    """Return a recorded first-order step response that covers `share` of its way at the sample k_min."""
    k = np.arange(-5, 20 * k_min)
    pole = (1 - share) ** (1 / (k_min - 0.5))
    u = np.where(k >= 0, amplitude, 0.0) + 2.0
    return u, 7.0 + 0.5 * amplitude * np.where(k >= 0, 1 - pole ** k.clip(0), 0.0)


# PRVS


@st.composite
def step_tables(draw):
    n = draw(st.integers(1, 5))
    sizes = np.cumsum(draw(st.lists(st.floats(0.1, 2.0), min_size=n, max_size=n)))
    limits = []
    for _ in range(2):
        shortest = draw(st.lists(st.integers(1, 30), min_size=n, max_size=n))
        limits += [shortest, [k + draw(st.integers(0, 30)) for k in shortest]]
    return StepTable(sizes, *limits)


@given(step_tables(), st.integers(0, 1000), st.floats(-10, 10), st.floats(0.1, 20))
@settings(max_examples=60, deadline=None)
def test_prvs_holds_each_level_between_the_limits_of_its_step(steps, seed, u_min, width):
    u = prvs(600, steps, u_min=u_min, u_max=u_min + width, random_state=seed)
    assert u.shape == (600,)
    assert u.min() >= u_min
    assert u.max() <= u_min + width
    levels, lengths = holds(u)
    for change, length in zip(np.diff(levels)[:-1], lengths[1:-1], strict=True):
        row = min(sum(abs(change) > size for size in steps.amplitudes), len(steps.amplitudes) - 1)
        way = "up" if change > 0 else "down"
        assert getattr(steps, f"k_min_{way}")[row] <= length <= getattr(steps, f"k_max_{way}")[row]


def test_prvs_draws_every_hold_of_its_range():
    steps = StepTable((10,), (3,), (6,), (8,), (9,))
    levels, lengths = holds(prvs(20_000, steps, u_min=0, u_max=1, random_state=0))
    rising = np.diff(levels)[:-1] > 0
    assert set(lengths[1:-1][rising]) == {3, 4, 5, 6}
    assert set(lengths[1:-1][~rising]) == {8, 9}


def test_prvs_levels_are_uniform_over_the_range():
    levels, _ = holds(
        prvs(20_000, StepTable((10,), (2,), (3,), (2,), (3,)), u_min=-3, u_max=5, random_state=1)
    )
    # mean and standard deviation of 8 000 uniform draws, to four standard errors
    assert levels.mean() == pytest.approx(1.0, abs=4 * 8 / np.sqrt(12 * levels.size))
    assert levels.std() == pytest.approx(8 / np.sqrt(12), rel=0.03)


def test_prvs_repeats_with_its_seed():
    first, again, other = (prvs(500, TABLE_2_1, u_min=10, u_max=16, random_state=s) for s in (3, 3, 4))
    assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_step_table_reproduces_table_2_1_from_step_responses():
    records = []
    for size, up, down in zip(TABLE_2_1.amplitudes, TABLE_2_1.k_min_up, TABLE_2_1.k_min_down, strict=True):
        records += [step_response(-size, down), step_response(size, up)]
    assert step_table(records) == TABLE_2_1


def test_hold_limits_reproduce_example_2_4():
    assert hold_limits(*step_response(5.0, 114))[:3] == (5.0, 114, 228)
    assert hold_limits(*step_response(-5.0, 250))[:3] == (-5.0, 250, 500)


def test_hold_limits_say_when_the_response_has_settled():
    # 1 - 0.9^k stays within 5 % of 1 once 0.9^k <= 0.05: 28.4 samples
    k = np.arange(-3, 400)
    limits = hold_limits(np.where(k >= 0, 1.0, 0.0), np.where(k >= 0, 1 - 0.9 ** k.clip(0), 0.0))
    assert (limits.k_min, limits.k_settled) == (6, 29)


def test_hold_limits_stand_measurement_noise():
    u, y = step_response(5.0, 114)
    noisy = y + 0.01 * np.random.default_rng(0).standard_normal(y.size)
    assert hold_limits(u, noisy).k_min == pytest.approx(114, abs=5)


@pytest.mark.parametrize(
    ("u", "y", "message"),
    [
        ([0, 1, 1, 0], [0, 0, 1, 1], "u changes 2 times"),
        ([1, 1, 1], [0, 0, 1], "u changes 0 times"),
        ([0, 1, 1], [0, 1], "recorded together"),
        ([0, 1, 1], [2, 2, 2], "ends at the level it had before"),
        ([0, 1, np.nan], [0, 1, 1], "NaN or infinite"),
    ],
)
def test_hold_limits_refuse_what_is_no_step_response(u, y, message):
    with pytest.raises(ValueError, match=message):
        hold_limits(u, y)


def test_hold_limits_refuse_shares_and_ratios_out_of_range():
    record = step_response(1.0, 20)
    with pytest.raises(ValueError, match="share must lie between 0 and 1"):
        hold_limits(*record, share=1.0)
    with pytest.raises(ValueError, match="ratio must be at least 1"):
        hold_limits(*record, ratio=0.5)


def test_step_table_wants_each_size_in_both_directions():
    with pytest.raises(ValueError, match="once upwards and once downwards"):
        step_table([step_response(1.0, 20)])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((2, 1), (1, 1), (1, 1), (1, 1), (1, 1)), "must be positive and increase"),
        (((1,), (1, 2), (3,), (1,), (3,)), "k_min_up has 2 values for 1 amplitudes"),
        (((1,), (4,), (3,), (1,), (3,)), "k_min_up=4 exceeds k_max_up=3"),
    ],
)
def test_step_table_refuses_inconsistent_limits(arguments, message):
    with pytest.raises(ValueError, match=message):
        StepTable(*arguments)


def test_prvs_refuses_an_empty_range_and_no_samples():
    with pytest.raises(ValueError, match="u_min must lie below u_max"):
        prvs(10, TABLE_2_1, u_min=1, u_max=1)
    with pytest.raises(ValueError, match="n_samples=0 is too small"):
        prvs(0, TABLE_2_1, u_min=0, u_max=1)
    with pytest.raises(TypeError, match="n_samples must be an integer"):
        prvs(10.0, TABLE_2_1, u_min=0, u_max=1)


# PRFS


@given(st.integers(0, 1000), st.lists(st.floats(0.5, 8.0), min_size=1, max_size=3), st.integers(1, 3))
@settings(max_examples=25, deadline=None)
def test_prfs_without_last_filter_fills_its_amplitude_limits(seed, frequencies, n_points):
    centres, gains = np.arange(n_points) * 10.0, 1.0 + np.arange(n_points)
    n = 300 * n_points
    u = prfs(
        [n] * len(frequencies),
        frequencies,
        0.01,
        operating_points=centres,
        amplitudes=gains,
        final_cutoff=np.inf,
        random_state=seed,
    )
    normalised = (u.reshape(-1, n_points, 300) - centres[:, None]) / gains[:, None]
    # (2.23): each frequency's noise reaches -1 and 1, over all its operating points together
    assert_allclose(normalised.min(axis=(1, 2)), -1, atol=1e-12)
    assert_allclose(normalised.max(axis=(1, 2)), 1, atol=1e-12)


def test_prfs_keeps_its_power_below_the_cutoff():
    u = prfs(40_000, 1.0, 0.001, random_state=0)
    power = np.abs(np.fft.rfft((u - u.mean()) * np.hanning(u.size))) ** 2
    frequency = np.fft.rfftfreq(u.size, 0.001)
    # |B|^2 = 1 / (1 + f^10): at most a share of 2^-10 of the density is left at twice the cutoff
    assert power[frequency > 2].sum() < 2e-3 * power.sum()
    assert power[frequency < 1.1].sum() > 0.9 * power.sum()


def test_prfs_of_the_piezo_experiment_covers_its_range():
    for seed in range(3):
        report = describe_signal(prfs(50_000, 1.0, 0.001, amplitudes=80.0, random_state=seed), 0.001)
        assert report.amplitude_coverage == 1.0
        assert 75 < max(-report.minimum, report.maximum) < 84
        assert report.band[1] < 1.5


def test_prfs_of_figure_2_9_visits_its_operating_points_in_order():
    u = prfs(
        [7200, 10800, 6750],
        [0.5, 1.0, 4.0],
        0.001,
        operating_points=[1, 3, 7],
        amplitudes=[1, 3, 2],
        random_state=0,
    )
    assert u.shape == (24_750,)
    # the last filter lags by about a tenth of a second and may exceed the limits by a few percent of the jump
    settled = u[:7200].reshape(3, 2400)[:, 500:]
    for part, centre, gain in zip(settled, (1, 3, 7), (1, 3, 2), strict=True):
        assert part.min() > centre - gain - 0.3
        assert part.max() < centre + gain + 0.3


def test_prfs_last_filter_starts_from_zero_and_joins_without_jumps():
    arguments = (20_000, [1.0, 2.0], 0.001)
    raw = prfs(*arguments, operating_points=[0, 10], final_cutoff=np.inf, random_state=0)
    smooth = prfs(*arguments, operating_points=[0, 10], random_state=0)
    assert abs(smooth[0]) < 1e-6
    assert np.abs(np.diff(raw)).max() > 5
    assert np.abs(np.diff(smooth)).max() < 0.2


def test_prfs_final_cutoff_beyond_half_the_sampling_frequency_changes_nothing():
    assert_array_equal(
        prfs(500, 30.0, 0.01, random_state=0), prfs(500, 30.0, 0.01, final_cutoff=np.inf, random_state=0)
    )


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        ((100, 60.0, 0.01), {}, "half the sampling frequency, 50 Hz"),
        ((100, [1.0, 2.0, 3.0], 0.01), {}, "pass a multiple of 3"),
        (([50, 50], 1.0, 0.01), {}, "n_samples has 2 values for 1 frequencies"),
        (([51], 1.0, 0.01), {"operating_points": [0, 1]}, "no multiple of the 2 operating points"),
        (
            (100, 1.0, 0.01),
            {"operating_points": [0, 1], "amplitudes": [1, 2, 3]},
            "amplitudes must be positive",
        ),
        ((100, 1.0, 0.0), {}, "sampling_period must be positive"),
        ((100, 1.0, 0.01), {"final_cutoff": -1.0}, "final_cutoff must be positive"),
    ],
)
def test_prfs_refuses_an_inconsistent_setup(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        prfs(*arguments, **options)


# multisine


@given(
    st.integers(3, 400), st.sampled_from(["full", "odd"]), st.sampled_from(["random", "schroeder"]),
    st.integers(1, 3), st.floats(1e-3, 1e3),
)  # fmt: skip
@settings(max_examples=50, deadline=None)
def test_multisine_has_a_flat_spectrum_on_its_lines_only(n, lines, phases, n_periods, rms):
    u = multisine(n, 0.5, lines=lines, phases=phases, rms=rms, n_periods=n_periods, random_state=0)
    assert u.shape == (n * n_periods,)
    assert np.sqrt(np.mean(u**2)) == pytest.approx(rms, rel=1e-12)
    size = np.abs(np.fft.rfft(u)) / u.size
    numbers = np.arange(1, (n - 1) // 2 + 1)
    excited = n_periods * (numbers[numbers % 2 == 1] if lines == "odd" else numbers)
    # m equal lines share the power: rms^2 = 2 m size^2
    assert_allclose(size[excited], rms / np.sqrt(2 * excited.size), rtol=1e-9)
    assert np.delete(size, excited).max(initial=0) < 1e-12 * rms


def test_multisine_stays_in_its_band_edges_included():
    u = multisine(1000, 0.001, band=(10, 20), random_state=0)
    assert_array_equal(np.flatnonzero(np.abs(np.fft.rfft(u)) > 1), np.arange(10, 21))


def test_schroeder_phases_have_a_low_crest_factor():
    crest = [np.abs(multisine(2000, 1.0, random_state=s)).max() for s in range(10)]
    assert np.abs(multisine(2000, 1.0, phases="schroeder")).max() < 1.8 < min(crest)


def test_a_band_beyond_half_the_sampling_frequency_is_told():
    told = r"band \(10, 500\) Hz is cut at 50 Hz, .* ends at 49\.8 Hz\. .* sampling period below 0\.001 s"
    with pytest.warns(NarxWarning, match=told):
        cut = multisine(500, 0.01, band=(10, 500), random_state=0)
    for highest in (50, np.inf):  # and no warning
        np.testing.assert_array_equal(multisine(500, 0.01, band=(10, highest), random_state=0), cut)


def test_multisine_refuses_unknown_choices_and_empty_bands():
    with pytest.raises(ValueError, match="lines='even' is not known"):
        multisine(100, 1.0, lines="even")
    with pytest.raises(ValueError, match="phases='flat' is not known"):
        multisine(100, 1.0, phases="flat")
    with pytest.raises(ValueError, match=r"No full line lies in the band \(0.001, 0.002\)"):
        multisine(100, 1.0, band=(0.001, 0.002))


# loading-unloading


@given(
    st.lists(st.floats(0.1, 5), min_size=1, max_size=6),
    st.integers(1, 30),
    st.sampled_from(["triangle", "sine"]),
    st.sampled_from([-1, 1]),
)
@settings(max_examples=60, deadline=None)
def test_loading_unloading_is_strictly_monotonic_between_its_turning_points(changes, n, shape, first):
    ways = first * (-1) ** np.arange(len(changes))
    points = np.concatenate([[0.5], 0.5 + np.cumsum(ways * changes)])
    u = loading_unloading(points, n, shape=shape)
    assert_array_equal(u[::n], points)
    assert_array_equal(np.sign(np.diff(u)), np.repeat(ways, n))


def test_loading_unloading_satisfies_definition_2_8():
    u = loading_unloading((-2, 3), [30, 50], shape="sine", n_periods=3)
    assert u.size == 240
    assert_array_equal(u[:80], u[80:160])
    assert (u.min(), u.max()) == (-2, 3)
    # (2.58): the difference never vanishes, so its sign is 1 in loading and -1 in unloading
    assert_array_equal(np.sign(np.diff(u))[:80], [1] * 30 + [-1] * 50)


def test_triangle_has_a_constant_rate_and_sine_rests_at_the_turns():
    assert_allclose(np.diff(loading_unloading((0, 1), 20)), 0.05, rtol=1e-12)
    rate = np.diff(loading_unloading((0, 1), 20, shape="sine"))
    assert rate[0] < 0.2 * rate[10]
    assert_allclose(rate, rate[::-1], rtol=1e-9)


@pytest.mark.parametrize(
    ("points", "samples", "options", "message"),
    [
        ([0, 1, 2], 5, {}, "alternately higher and lower"),
        ([0, 0], 5, {}, "alternately higher and lower"),
        ([0], 5, {}, "at least 2 values"),
        ([0, 1, 0], [5], {}, "samples_per_branch has 1 values for 2 branches"),
        ([0, 1, 0], 5, {"n_periods": 2}, "even number of turning points"),
        ([0, 1], 5, {"shape": "square"}, "shape='square' is not known"),
        ([0, 1], 0, {}, "samples_per_branch=0 is too small"),
    ],
)
def test_loading_unloading_refuses_impossible_paths(points, samples, options, message):
    with pytest.raises(ValueError, match=message):
        loading_unloading(points, samples, **options)


def test_quasi_static_output_lags_by_one_part_in_slowness():
    u = quasi_static((0, 1), time_constant=10, slowness=40, n_periods=2)
    assert u.size == 1600
    y = np.empty_like(u)
    y[0] = u[0]
    for k in range(1, u.size):
        y[k] = y[k - 1] + (u[k] - y[k - 1]) / 10
    assert np.abs(u - y).max() == pytest.approx(1 / 40, rel=0.15)
    with pytest.raises(ValueError, match="slowness must be at least 1"):
        quasi_static((0, 1), time_constant=10, slowness=0.5)


def test_reversal_points_descend_from_the_top_to_the_bottom():
    points = reversal_points(-2, 2, 4)
    assert_allclose(points, [-2, 2, 1, 2, 0, 2, -1, 2, -2, 2])
    assert loading_unloading(points, 10).size == 91
    with pytest.raises(ValueError, match="u_min must lie below u_max"):
        reversal_points(1, 1, 2)


# report


@given(st.lists(st.integers(1, 9), min_size=1, max_size=4, unique=True), st.booleans(), st.floats(1e-6, 1e6))
@settings(max_examples=40, deadline=None)
def test_excitation_order_is_twice_the_number_of_sines_and_one_for_a_constant(lines, offset, scale):
    k = np.arange(400)
    u = scale * (sum(np.sin(0.3 * m * k + m) for m in lines) + offset)
    assert describe_signal(u, 1.0).excitation_order == 2 * len(lines) + offset


def test_excitation_order_agrees_with_the_full_matrix_of_lagged_signals():
    # slow form: singular values of all windows at once
    u = prfs(9000, 1.0, 0.05, random_state=2)
    found = describe_signal(u, 0.05, max_order=12, threshold=1e-4).excitation_order
    windows = np.lib.stride_tricks.sliding_window_view(u, 12)
    ratios = [np.divide(*np.linalg.svd(windows[:, :n], compute_uv=False)[[-1, 0]]) for n in range(1, 13)]
    assert 1 < found < 12
    assert found == sum(ratio > 1e-4 for ratio in ratios)


def test_report_of_a_sine_has_its_textbook_figures():
    report = describe_signal(3.0 + 2.0 * np.sin(2 * np.pi * 5 * np.arange(4000) / 1000), 0.001)
    assert report.crest_factor == pytest.approx(np.sqrt(2), rel=1e-5)
    assert report.rms == pytest.approx(np.sqrt(2), rel=1e-9)
    assert report.band == (5.0, 5.0)
    assert (report.minimum, report.maximum) == pytest.approx((1.0, 5.0))
    assert report.amplitude_coverage == 1.0


def test_white_noise_spreads_its_power_over_all_frequencies():
    report = describe_signal(np.random.default_rng(0).standard_normal(20_000), 0.5)
    # 2.5 % and 97.5 % of the range up to 1 Hz; a cumulated periodogram wanders by about 1 / sqrt(n)
    assert report.band == pytest.approx((0.025, 0.975), abs=0.01)
    assert report.excitation_order == 50
    assert "persistently exciting of order 50 or more" in str(report)


def test_binary_signal_covers_two_amplitude_bins():
    u = np.tile([0.0, 1.0, 1.0, 0.0, 1.0], 40)
    report = describe_signal(u, 1.0, n_bins=10)
    assert report.amplitude_coverage == pytest.approx(0.2)
    assert "20% of 10 amplitude bins visited" in str(report)


@pytest.mark.parametrize(
    ("u", "message"),
    [
        (np.ones(10), "u is constant"),
        ([1.0, np.nan, 2.0], "NaN or infinite"),
        (np.zeros((5, 2)), "one-dimensional"),
    ],
)
def test_describe_signal_refuses_what_excites_nothing_or_is_no_signal(u, message):
    with pytest.raises(ValueError, match=message):
        describe_signal(u, 1.0)

"""Operators with memory obey the laws of rate-independent hysteresis; estimators find what made the data."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp
from sklearn.base import clone
from sklearn.utils.estimator_checks import parametrize_with_checks
from sklearn.utils.validation import check_is_fitted, validate_data

from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.model import AsymmetricSign, operators
from narx_sklearn.physics import (
    PIEZO_BENCH,
    BoucWen,
    BoucWenModel,
    PrandtlIshlinskii,
    PrandtlIshlinskiiOperator,
    asymmetric_sign,
    bouc_wen,
    boucwen,
    first_order_reversal_curves,
    fit_asymmetric_sign,
    hysteretic_operator,
    play,
    smooth_sign,
)
from narx_sklearn.physics.boucwen import (
    _bouc_wen_move,
    _bouc_wen_run,
    _bouc_wen_slope,
    _bouc_wen_step,
    _is_too_long,
)
from narx_sklearn.physics.hysteretic import _hysteretic_run
from narx_sklearn.physics.multivalued import _asymmetric_run
from narx_sklearn.physics.play_operator import _play_run
from narx_sklearn.physics.prandtl_ishlinskii import _weighted_plays_run

EXAMPLE_2_2 = PrandtlIshlinskiiOperator(radii=(0, 0.8, 1.7), weights=(5.88, 1.58, 0.47))

# Rounding of sums and arctangents over the at most sixty samples that hypothesis draws, values of order 10.
ROUNDING = 1e-11

inputs = st.lists(st.floats(-5, 5, width=32), min_size=2, max_size=30).map(np.array)

OPERATORS = {
    "play": lambda u: play(u, [0.7])[:, 0],
    "prandtl-ishlinskii": EXAMPLE_2_2.run,
    "hysteretic operator": lambda u: hysteretic_operator(u, memory=100),
}
each_operator = pytest.mark.parametrize("operator", OPERATORS.values(), ids=OPERATORS.keys())


@st.composite
def admissible_operators(draw, positive=False):
    """Prandtl-Ishlinskii operators whose initial loading curve has slopes between 0.05 and 5."""
    n = draw(st.integers(1, 8))
    gaps = draw(st.lists(st.floats(0.05, 1.0), min_size=n - 1, max_size=n - 1))
    slopes = np.array(draw(st.lists(st.floats(0.05, 5.0), min_size=n, max_size=n)))
    if positive:
        slopes = np.cumsum(slopes)
    return PrandtlIshlinskiiOperator(
        radii=np.concatenate([[0.0], np.cumsum(gaps)]),
        weights=np.diff(slopes, prepend=0.0),
        input_offset=draw(st.floats(-2, 2)),
        output_offset=draw(st.floats(-2, 2)),
    )


# Laws of rate-independent hysteresis


@each_operator
@given(inputs, st.integers(1, 4), st.integers(0, 100))
@settings(max_examples=40, deadline=None)
def test_rate_independence_samples_on_the_way_change_nothing(operator, u, extra, seed):
    shares = np.random.default_rng(seed).random((u.size - 1, extra))
    way = u[:-1, None] + np.sort(shares, axis=1) * np.diff(u)[:, None]
    slow = np.concatenate([np.column_stack([u[:-1], way]).ravel(), u[-1:]])
    assert_allclose(operator(slow)[:: extra + 1], operator(u), atol=ROUNDING)


@each_operator
@given(inputs, st.floats(0.0, 1.0), inputs)
@settings(max_examples=40, deadline=None)
@example(np.array([3.0, 1.0]), 0.5, np.array([-4.0, 4.0, 0.0]))
def test_wiping_out_a_closed_minor_loop_leaves_no_trace(operator, history, depth, future):
    # from the last sample back towards the one before, and again to the last sample
    turn = history[-1] + depth * (history[-2] - history[-1])
    plain = operator(np.concatenate([history, future]))
    looped = operator(np.concatenate([history, [turn, history[-1]], future]))
    assert_allclose(looped[: history.size], plain[: history.size], atol=ROUNDING)
    assert_allclose(looped[history.size + 1 :], plain[history.size - 1 :], atol=ROUNDING)


@each_operator
@given(inputs, inputs, st.floats(-4, 4), st.floats(0.01, 4), st.integers(1, 6))
@settings(max_examples=40, deadline=None)
def test_congruency_minor_loops_between_the_same_inputs_have_the_same_shape(
    operator, one, other, low, width, n
):
    high = low + width
    up, down = np.linspace(low, high, n + 1), np.linspace(high, low, n + 1)
    loop = np.concatenate([up, down[1:]])
    shapes = []
    for history in (one, other):
        approach = [low, high, low]  # the loop is closed once its inputs were run through
        y = operator(np.concatenate([history, approach, loop]))[-loop.size :]
        shapes.append(y - y[0])
    assert_allclose(shapes[0], shapes[1], atol=ROUNDING)


def test_hysteretic_operator_with_one_extremum_keeps_a_trace_of_a_closed_loop():
    plain, looped = [0.0, 3.0, 1.0, -2.0], [0.0, 3.0, 1.0, 2.0, 1.0, -2.0]
    assert hysteretic_operator(looped, memory=1)[-1] != pytest.approx(
        hysteretic_operator(plain, memory=1)[-1]
    )
    assert hysteretic_operator(looped)[-1] == pytest.approx(hysteretic_operator(plain)[-1], abs=1e-12)


# Play


def test_play_by_hand():
    # radius 1: dragged up behind 2, held at 1 until 0, dragged down in front of -2, held until 0
    u = [0.0, 2.0, 1.0, 0.0, -2.0, -1.0, 0.5]
    assert_array_equal(play(u, 1.0)[:, 0], [0, 1, 1, 1, -1, -1, -0.5])
    assert_array_equal(play(u, 0.0)[:, 0], u)


@given(inputs, st.floats(0, 3), st.floats(-3, 3))
@settings(max_examples=50, deadline=None)
def test_play_stays_within_its_radius_and_moves_only_at_the_end_of_its_play(u, r, start):
    w = play(u, r, initial_state=start)[:, 0]
    assert np.abs(u - w).max() <= r + 1e-12
    moved = np.diff(w, prepend=start) != 0
    assert_allclose(np.abs(u - w)[moved], r, atol=1e-12)


@given(inputs, st.integers(0, 30))
@settings(max_examples=30, deadline=None)
def test_play_goes_on_from_its_last_row(u, cut):
    cut = min(cut, u.size - 1)
    radii = [0.3, 1.0, 2.0]
    whole = play(u, radii)
    state = whole[cut - 1] if cut else None
    assert_array_equal(play(u[cut:], radii, initial_state=state), whole[cut:])


def test_play_refuses_bad_radii_states_and_signals():
    with pytest.raises(ValueError, match="radii must be finite numbers of 0 or more"):
        play([0, 1], [-1.0])
    with pytest.raises(ValueError, match="one for each of the 2 radii"):
        play([0, 1], [0.0, 1.0], initial_state=[0, 0, 0])
    with pytest.raises(ValueError, match=r"u must be one signal.*got shape \(2, 2\)"):
        play(np.zeros((2, 2)), [1.0])
    with pytest.raises(ValueError, match="NaN"):
        play([0, np.nan], [1.0])


# Prandtl-Ishlinskii


def by_madelung_rules(operator, u):
    """Slow twin without plays: branches of the initial loading curve between dominant reversals."""
    outputs, turns = [], []  # turns: dominant reversals since rest, alternating, sizes decreasing
    previous, way = 0.0, 0.0
    for value in u - operator.input_offset:
        now = np.sign(value - previous)
        if now and way and now != way:
            turns.append(previous)
        way = now or way
        while len(turns) >= 2 and way * (value - turns[-2]) >= 0:
            turns = turns[:-2]  # the loop begun at turns[-2] is closed
        if len(turns) == 1 and abs(value) >= abs(turns[0]):
            turns = []  # back on the initial curve
        path = [*turns, value]
        branches = [2 * operator.initial_loading_curve(0.5 * (b - a)) for a, b in pairwise(path)]
        outputs.append(operator.output_offset + operator.initial_loading_curve(path[0]) + sum(branches))
        previous = value
    return np.array(outputs)


@given(admissible_operators(), inputs)
@settings(max_examples=100, deadline=None)
def test_prandtl_ishlinskii_agrees_with_madelungs_rules(operator, u):
    assert_allclose(operator.run(u), by_madelung_rules(operator, u), atol=ROUNDING)


def test_prandtl_ishlinskii_of_example_2_2_by_hand():
    # at 3: 5.88 * 3 + 1.58 * 2.2 + 0.47 * 1.3; at -3 the opposite; back at 0 the plays hold 0.8 and 1.3
    v = EXAMPLE_2_2.run([3.0, 0.0, -3.0, 0.0])
    assert_allclose(v, [21.727, 1.875, -21.727, -1.875], rtol=1e-12)


@given(admissible_operators(), inputs, inputs)
@settings(max_examples=100, deadline=None)
def test_prandtl_ishlinskii_times_its_inverse_is_the_identity(operator, u, later):
    v, state = operator.run_with_state(u)
    assert_allclose(operator.inverse().run(v), u, atol=1e-10)
    assert_allclose(operator.run(operator.inverse().run(u)), u, atol=1e-10)
    resumed = replace(operator, initial_state=state)
    assert_allclose(resumed.inverse().run(resumed.run(later)), later, atol=1e-10)


@given(admissible_operators())
@settings(max_examples=50, deadline=None)
def test_inverse_of_the_inverse_is_the_operator(operator):
    twice = operator.inverse().inverse()
    assert_allclose(twice.radii, operator.radii, atol=1e-10)
    assert_allclose(twice.weights, operator.weights, atol=1e-10)
    assert (twice.input_offset, twice.output_offset) == (operator.input_offset, operator.output_offset)


def test_inverse_by_hand():
    # slopes 2 and 4: radius 1 maps to 2; weights 1/2 and 1/4 - 1/2
    inverse = PrandtlIshlinskiiOperator((0, 1), (2, 2), input_offset=5, output_offset=7).inverse()
    assert inverse == PrandtlIshlinskiiOperator((0, 2), (0.5, -0.25), input_offset=7, output_offset=5)


@pytest.mark.parametrize("weights", [(0.0, 1.0), (1.0, -1.0), (1.0, -2.0)])
def test_inverse_is_refused_where_the_loading_curve_does_not_rise(weights):
    with pytest.raises(ValueError, match="The operator has no inverse: the slope"):
        PrandtlIshlinskiiOperator((0, 1), weights).inverse()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((0.1, 1), (1, 1)), "radii must increase from 0"),
        (((0, 1, 1), (1, 1, 1)), "radii must increase from 0"),
        (((0, 1), (1, 1, 1)), "weights must be 2 finite numbers"),
        (((0, 1), (1, np.nan)), "weights must be 2 finite numbers"),
        (((0, 1), (1, 1), (0.0,)), "initial_state must be 2 finite numbers"),
        (((0, 1), (1, 1), (0.0, 1.5)), "cannot be reached by any input"),
        (((0, 1), (1, 1), None, np.inf), "input_offset must be finite"),
    ],
)
def test_prandtl_ishlinskii_operator_refuses_what_is_none(arguments, message):
    with pytest.raises(ValueError, match=message):
        PrandtlIshlinskiiOperator(*arguments)


@given(admissible_operators(positive=True), st.integers(0, 100))
@settings(max_examples=30, deadline=None)
def test_estimated_prandtl_ishlinskii_recovers_its_weights(operator, seed):
    rng = np.random.default_rng(seed)
    u = operator.input_offset + 2.2 * (operator.radii[-1] + 0.5) * rng.uniform(-1, 1, 300)
    estimator = PrandtlIshlinskii(operator.radii, rest_input=operator.input_offset)
    estimator.fit(u.reshape(-1, 1), operator.run(u))
    # known exactly, so recovered to rounding times the condition of the plays
    assert_allclose(estimator.coef_, operator.weights, atol=1e-10)
    assert estimator.intercept_ == pytest.approx(operator.output_offset, abs=1e-9)
    assert_allclose(estimator.inverse().run(operator.run(u)), u, atol=1e-8)


def test_default_radii_are_spread_over_half_the_range():
    u = np.sin(np.arange(400) / 10)
    estimator = PrandtlIshlinskii(4).fit(u.reshape(-1, 1), u)
    assert_allclose(estimator.radii_, np.arange(4) / 4 * 0.5 * np.ptp(u))
    assert_allclose(estimator.coef_, [1, 0, 0, 0], atol=1e-12)


def test_min_slope_guarantees_an_inverse():
    u = np.sin(np.arange(400) / 10)
    y = play(u, 0.4)[:, 0]
    plain = PrandtlIshlinskii(radii=[0.0, 0.4]).fit(u.reshape(-1, 1), y)
    with pytest.raises(ValueError, match="min_slope"):
        plain.inverse()
    steep = PrandtlIshlinskii(radii=[0.0, 0.4], min_slope=0.05).fit(u.reshape(-1, 1), y)
    assert steep.coef_[0] == pytest.approx(0.05)
    assert_allclose(steep.inverse().run(steep.predict(u.reshape(-1, 1))), u, atol=1e-10)


def test_n_settle_leaves_an_unknown_history_out_of_the_fit():
    u = 3 * np.sin(np.arange(600) / 30)
    started_elsewhere = replace(EXAMPLE_2_2, initial_state=(2.0, 1.5, 1.0))
    estimator = PrandtlIshlinskii(EXAMPLE_2_2.radii, n_settle=200)
    estimator.fit(u.reshape(-1, 1), started_elsewhere.run(u))
    assert_allclose(estimator.coef_, EXAMPLE_2_2.weights, atol=1e-10)


def test_without_intercept_no_input_gives_no_output():
    u = np.sin(np.arange(100) / 10)
    estimator = PrandtlIshlinskii(3, fit_intercept=False).fit(u.reshape(-1, 1), u + 1)
    assert estimator.intercept_ == 0.0
    assert estimator.predict([[0.0]]).tolist() == [0.0]


def test_input_may_be_a_frame_with_a_name():
    u = np.sin(np.arange(100) / 10)
    frame = pd.DataFrame({"voltage": u})
    estimator = PrandtlIshlinskii(3).fit(frame, u)
    assert list(estimator.feature_names_in_) == ["voltage"]
    assert_array_equal(
        estimator.predict(frame), PrandtlIshlinskii(3).fit(frame.to_numpy(), u).predict(frame.to_numpy())
    )


@pytest.mark.parametrize("estimator", [PrandtlIshlinskii(), BoucWen(n_starts=1)])
def test_estimators_refuse_two_inputs_and_a_constant_one(estimator):
    with pytest.raises(ValueError, match=r"X has 2 columns, but \w+ describes the effect of one input"):
        clone(estimator).fit(np.random.default_rng(0).random((20, 2)), np.arange(20.0))
    with pytest.raises(ValueError, match="X is constant"):
        clone(estimator).fit(np.ones((20, 1)), np.arange(20.0))


@pytest.mark.parametrize(
    ("estimator", "message"),
    [
        (PrandtlIshlinskii(0), "radii=0 asks for no play"),
        (PrandtlIshlinskii([0.5, 1.0]), "radii must increase from 0"),
        (PrandtlIshlinskii(min_slope=-1), "min_slope must be 0 or more"),
        (PrandtlIshlinskii(rest_input=np.nan), "rest_input must be finite"),
        (PrandtlIshlinskii(n_settle=19), "n_settle=19 must be 0 or more and leave at least 2 of the 20"),
        (BoucWen(n_settle=-1), "n_settle=-1 must be 0 or more"),
        (BoucWen(n_starts=0), "n_starts must be an integer of at least 1"),
        (BoucWen(substeps=0), "substeps must be an integer of at least 1"),
        (BoucWen(exponent_bounds=(0.5, 2)), "exponent_bounds must be 1 or more"),
        (BoucWen(exponent_bounds=(3, 2)), "exponent_bounds must be 1 or more and not decrease"),
    ],
)
def test_estimators_refuse_arguments_out_of_range(estimator, message):
    with pytest.raises(ValueError, match=message):
        estimator.fit(np.arange(20.0).reshape(-1, 1), np.arange(20.0))


# First-order reversal curves


def test_reversal_curves_of_a_prandtl_ishlinskii_operator_are_copies_of_one_curve():
    curves = first_order_reversal_curves(EXAMPLE_2_2.run, -3, 3, n_curves=6, n_inputs=61)
    assert_allclose(curves.reversals, [2, 1, 0, -1, -2, -3], atol=1e-12)
    whole = curves.outputs[-1] - curves.outputs[-1, 0]
    for reversal, outputs in zip(curves.reversals, curves.outputs, strict=True):
        branch = outputs[~np.isnan(outputs)]
        assert curves.inputs[np.isnan(outputs)].max(initial=-np.inf) < reversal
        assert_allclose(branch - branch[0], whole[: branch.size], atol=1e-10)
        assert branch[-1] == pytest.approx(21.727, rel=1e-12)  # every minor loop closes at the top
    # symmetric major loop: the way down is the way up, turned by half a turn
    assert_allclose(curves.descending, -curves.outputs[-1][::-1], atol=1e-10)


def test_reversal_curves_start_on_the_descending_branch():
    curves = first_order_reversal_curves(EXAMPLE_2_2.run, -3, 3, n_curves=4, n_inputs=81)
    for reversal, outputs in zip(curves.reversals, curves.outputs, strict=True):
        at = np.argmin(np.abs(curves.inputs - reversal))
        assert outputs[at] == pytest.approx(curves.descending[at], abs=1e-12)


def test_reversal_curves_of_a_local_memory_do_not_return_to_the_top():
    curves = first_order_reversal_curves(PIEZO_BENCH.run, -80, 80, n_curves=4)
    assert np.ptp(curves.outputs[:, -1]) > 1.0  # micrometres, in a range of some 170


def test_reversal_curves_refuse_an_empty_range_and_systems_of_another_length():
    with pytest.raises(ValueError, match="u_min must lie below u_max"):
        first_order_reversal_curves(EXAMPLE_2_2.run, 1, 1)
    with pytest.raises(ValueError, match="n_curves=5 must lie between 1 and n_inputs - 1"):
        first_order_reversal_curves(EXAMPLE_2_2.run, 0, 1, n_curves=5, n_inputs=5)
    with pytest.raises(ValueError, match="system returned 2 samples"):
        first_order_reversal_curves(lambda u: u[:2], 0, 1)


# Deng and Tan's hysteretic operator


def from_the_whole_history(u, memory):
    """Slow twin: dominant extrema found anew from the whole past at each sample."""
    outputs = []
    extrema = [(0.0, 0.0)]
    previous, h, way = 0.0, 0.0, 0.0
    for value in u:
        now = np.sign(value - previous)
        if now * way < 0:
            extrema = [*extrema, (previous, h)][-memory:]
        way = now or way
        while now and len(extrema) >= 2 and now * (value - extrema[-2][0]) >= 0:
            extrema = extrema[:-2] if len(extrema) > 2 else extrema[-1:]
        distance = value - extrema[-1][0]
        h = abs(np.arctan(distance)) * distance + extrema[-1][1] if now else h
        outputs.append(h)
        previous = value
    return np.array(outputs)


@given(inputs, st.integers(1, 5))
@settings(max_examples=100, deadline=None)
def test_hysteretic_operator_agrees_with_its_slow_form(u, memory):
    assert_allclose(hysteretic_operator(u, memory=memory), from_the_whole_history(u, memory), atol=ROUNDING)


def test_hysteretic_operator_of_example_2_8():
    t = 0.02 * np.arange(700)
    u = 2.5 * np.sin(1.5 * t) + 4 * np.sin(0.5 * t)
    h = hysteretic_operator(u)
    ways = np.sign(np.diff(u))
    turns = np.flatnonzero(ways[1:] != ways[:-1]) + 1
    branch = lambda d: np.abs(np.arctan(d)) * d  # noqa: E731
    # (2.55) by hand: from rest to the first maximum, then each branch from its own extremum
    assert_allclose(h[: turns[0] + 1], branch(u[: turns[0] + 1]), rtol=1e-12)
    assert_allclose(
        h[turns[0] : turns[1] + 1], branch(u[turns[0] : turns[1] + 1] - u[turns[0]]) + h[turns[0]]
    )
    # the minor loop on top closes; the input passes on to the minimum on the first maximum's branch
    closing = turns[2] + np.argmax(u[turns[2] :] < u[turns[1]])
    expected = branch(u[closing : turns[3] + 1] - u[turns[0]]) + h[turns[0]]
    assert u[turns[0]] == pytest.approx(u[turns[2]], abs=1e-3)  # both humps are equally high
    assert_allclose(h[closing : turns[3] + 1], expected, atol=1e-2)


@given(st.floats(0.1, 5), st.integers(2, 20))
@settings(max_examples=30, deadline=None)
def test_hysteretic_operator_repeats_its_loop_for_ever(amplitude, n_periods):
    u = np.tile(amplitude * np.sin(2 * np.pi * np.arange(40) / 40), n_periods)
    h = hysteretic_operator(u).reshape(n_periods, 40)
    assert_allclose(h[1:], np.broadcast_to(h[1], h[1:].shape), atol=1e-12)
    # passive like a real hysteresis: the loop is run through counter-clockwise
    assert np.sum(u[:40] * np.diff(h[1], append=h[1, 0])) > 0


def test_hysteretic_operator_refuses_no_memory():
    with pytest.raises(ValueError, match="memory=0 keeps no extremum"):
        hysteretic_operator([0, 1], memory=0)
    with pytest.raises(TypeError, match="memory must be an integer"):
        hysteretic_operator([0, 1], memory=1.5)


# Multi-valued functions


def test_asymmetric_sign_of_example_2_10():
    u = np.sin(0.1 * np.arange(200))
    change = np.diff(u, prepend=u[0])
    expected = np.where(change > 0, u, np.where(change < 0, -1.0, 0.0))  # (2.66)
    assert_array_equal(asymmetric_sign(u, rising=(0, 1), falling=(-1,)), expected)
    assert_array_equal(asymmetric_sign(u), np.sign(change))


def test_asymmetric_sign_rests_within_its_threshold():
    assert_array_equal(asymmetric_sign([0, 0.1, 1.0, 0.8, 0.0], threshold=0.3), [0, 0, 1, 0, -1])


def test_fitted_asymmetric_sign_takes_the_branches_of_the_loop():
    u = np.concatenate([np.linspace(-1, 2, 80), np.linspace(1.9, -1, 70)])
    rising, falling = (1.0, 2.0, 0.0, -0.5), (0.5, 2.0, 1.0, 0.0)
    y = np.where(
        np.diff(u, prepend=-2) > 0, np.polynomial.Polynomial(rising)(u), np.polynomial.Polynomial(falling)(u)
    )
    phi = fit_asymmetric_sign(u, y, degree=3, name="phi2")
    assert isinstance(phi, AsymmetricSign)
    assert (phi.signal, phi.name) == ("u", "phi2")
    assert_allclose(phi.rising, rising, atol=1e-10)
    assert_allclose(phi.falling, falling, atol=1e-10)
    # as a regressor it repeats the recorded loop
    assert_allclose(phi.run(u)[1:], y[1:], atol=1e-10)
    assert_allclose(asymmetric_sign(u, rising=phi.rising, falling=phi.falling), phi.run(u), atol=1e-12)


def test_multivalued_functions_refuse_what_they_cannot_use():
    with pytest.raises(ValueError, match="eps must be positive"):
        smooth_sign([1.0], 0.0)
    with pytest.raises(ValueError, match="falling must hold at least one finite coefficient"):
        asymmetric_sign([0, 1], falling=())
    with pytest.raises(ValueError, match="threshold must be 0 or more"):
        asymmetric_sign([0, 1], threshold=-1)
    with pytest.raises(ValueError, match="While falling, the input takes 0 different values"):
        fit_asymmetric_sign([0, 1, 2, 3], [0, 1, 2, 3], degree=1)
    with pytest.raises(ValueError, match="recorded together"):
        fit_asymmetric_sign([0, 1], [0, 1, 2])
    with pytest.raises(ValueError, match="degree must be 0 or more"):
        fit_asymmetric_sign([0, 1, 0], [0, 1, 0], degree=-1)


def test_smooth_sign_tends_to_the_sign():
    x = np.array([-2.0, -1e-3, 0.0, 1e-3, 2.0])
    assert_array_equal(smooth_sign(x, 1e-6), np.sign(x))
    assert_allclose(smooth_sign(x, 1.0), np.tanh(x))


# Bouc-Wen


def test_bouc_wen_agrees_with_its_closed_forms():
    u = np.linspace(0, 2, 400)
    s = 1.5  # beta + gamma, met in first loading
    exponential = bouc_wen(u, A=0.8, beta=1.0, gamma=0.5, n=1)
    assert_allclose(exponential, 0.8 * (1 - np.exp(-s * u)) / s, atol=1e-11)
    tangent = bouc_wen(u, A=0.8, beta=1.0, gamma=0.5, n=2)
    assert_allclose(tangent, np.sqrt(0.8 / s) * np.tanh(np.sqrt(0.8 * s) * u), atol=1e-10)


def test_bouc_wen_integration_is_of_fourth_order():
    u = np.linspace(0, 1, 6)
    exact = np.sqrt(0.5) * np.tanh(np.sqrt(2) * u[-1])
    arguments = {"A": 1.0, "beta": 1.0, "gamma": 1.0, "n": 2}
    # few steps would be refined by themselves; from 4 on the given number counts
    errors = [abs(bouc_wen(u, substeps=m, **arguments)[-1] - exact) for m in (4, 8, 16)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert_allclose(orders, 4, atol=0.15)


def test_piezo_bench_agrees_with_an_independent_integration_in_time():
    t = np.arange(2001) / 1000
    h = np.zeros(t.size)

    def right_hand_side(t, h):  # (5.1), in time
        v = 80 * 2 * np.pi * np.cos(2 * np.pi * t)
        return 0.9 * v - 0.008 * abs(v) * h - 0.008 * v * abs(h)

    for start, end in pairwise([0, 250, 750, 1250, 1750, 2000]):  # from turning point to turning point
        times = t[start : end + 1]
        solution = solve_ivp(
            right_hand_side, times[[0, -1]], h[[start]], t_eval=times, rtol=1e-10, atol=1e-10
        )
        h[start : end + 1] = solution.y[0]
    u = 80 * np.sin(2 * np.pi * t)
    # turning points fall on samples here, so that the piecewise linear input loses nothing; what remains
    # comes from the sample in which h crosses zero, where the right-hand side has a corner
    assert_allclose(PIEZO_BENCH.run(u), 1.6 * u - h, atol=1e-4)
    assert_allclose(PIEZO_BENCH.run(u, substeps=20), 1.6 * u - h, atol=1e-6)


@given(st.integers(0, 1000), st.floats(1, 4), st.floats(-0.9, 1), st.floats(0.1, 20))
@settings(max_examples=40, deadline=None)
def test_bouc_wen_stays_within_its_bound_however_coarse_the_input(seed, n, ratio, beta):
    u = np.random.default_rng(seed).uniform(-3, 3, 60)
    h = bouc_wen(u, A=1.0, beta=beta, gamma=ratio * beta, n=n)
    # the larger of the limits on loading (beta + gamma) and unloading (the state never lies beyond it)
    bound = (1.0 / (beta * (1 + ratio))) ** (1 / n)
    assert np.abs(h).max() <= bound * (1 + 1e-3)  # relative error of a step, about 1e-5, over sixty samples


@given(inputs, st.integers(1, 4))
@settings(max_examples=30, deadline=None)
def test_bouc_wen_does_not_depend_on_the_rate(u, extra):
    arguments = {"A": 1.0, "beta": 0.3, "gamma": 0.1, "n": 1.5}
    assert_array_equal(bouc_wen(np.repeat(u, extra), **arguments)[::extra], bouc_wen(u, **arguments))
    slow = np.interp(np.arange((u.size - 1) * extra + 1) / extra, np.arange(u.size), u)
    # samples on the way refine the integration only
    fine = bouc_wen(slow, substeps=100, **arguments)[::extra]
    assert_allclose(fine, bouc_wen(u, substeps=100, **arguments), atol=1e-3)


@pytest.mark.parametrize(
    ("gamma", "few"), [(-198.0, 60), (0.0, 200), (198.0, 200)], ids=["hardly bent", "even", "flat"]
)
def test_a_loop_far_narrower_than_the_input_takes_few_steps(gamma, few, monkeypatch):
    steps = []

    def counted(*arguments):
        steps.append(arguments)
        return _bouc_wen_step.py_func(*arguments)

    monkeypatch.setattr(boucwen, "_bouc_wen_step", counted)
    arguments = 1.0, 200.0, gamma, 1.0
    u = np.array([0.0, 1.0, -1.0, 1.0])
    h = [0.0]
    for change in np.diff(u):
        h.append(_bouc_wen_move.py_func(h[-1], change, *arguments, 1))
    assert len(steps) < 3 * few  # 16 for each unit of beta + |gamma| and of the input's way: thousands
    fine = bouc_wen(u, A=1.0, beta=200.0, gamma=gamma, n=1.0, substeps=20000)
    assert_allclose(h, fine, atol=1e-4 * np.abs(fine).max())
    assert_allclose(h, _bouc_wen_run(u, *arguments, 0.0, 1)[0], rtol=1e-12)


def test_bouc_wen_turns_the_sign_of_h_with_the_input():
    u = np.cumsum(np.random.default_rng(0).standard_normal(300))
    arguments = {"A": 1.0, "beta": 0.5, "gamma": -0.2, "n": 2.0}
    assert_allclose(bouc_wen(-u, **arguments), -bouc_wen(u, **arguments), rtol=1e-14)


def test_bouc_wen_warns_with_the_sample_where_it_diverges():
    u = np.linspace(0, 50, 500)
    with pytest.warns(DivergenceWarning, match="left the finite range at sample"):
        h = bouc_wen(u, A=1.0, beta=0.1, gamma=-1.0, n=3)
    stop = np.argmax(np.isnan(h))
    assert 0 < stop < 500
    assert np.all(np.isfinite(h[:stop]))
    assert np.all(np.isnan(h[stop:]))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"A": np.nan}, "A must be finite"),
        ({"beta": -1}, "beta must be 0 or more"),
        ({"n": 0.5}, "n must be 1 or more"),
        ({"substeps": 0}, "substeps must be an integer"),
    ],
)
def test_bouc_wen_refuses_bad_parameters(changes, message):
    with pytest.raises(ValueError, match=message):
        bouc_wen([0, 1], **{"A": 1.0, "beta": 1.0, "gamma": 0.0, **changes})


def test_bouc_wen_model_refuses_bad_parameters():
    with pytest.raises(ValueError, match="beta must be 0 or more"):
        BoucWenModel(A=1.0, beta=-1.0, gamma=0.0)


def rich_input(n_samples, amplitude):
    t = np.arange(n_samples) / 500
    return amplitude * (0.6 * np.sin(2 * np.pi * t) + 0.4 * np.sin(2 * np.pi * 0.37 * t))


@pytest.mark.parametrize(
    "model",
    [
        PIEZO_BENCH,
        BoucWenModel(A=2.0, beta=0.5, gamma=-0.2, n=2.3, input_gain=0.3, offset=4.0),
        BoucWenModel(A=5e-7, beta=3e-5, gamma=2e-5, n=1.4, input_gain=-1e-7, hysteresis_gain=-1.0),
    ],
    ids=["piezo bench", "sharp bend", "small units"],
)
def test_estimated_bouc_wen_recovers_its_parameters(model):
    u = rich_input(3000, {1.0: 80.0, 2.3: 5.0, 1.4: 4e5}[model.n])
    y = model.run(u)
    estimator = BoucWen(random_state=0).fit(u.reshape(-1, 1), y)
    found = estimator.model_
    # the search stops at 1e-12 of the cost; at the bound n = 1 it approaches more slowly
    for name in ("A", "beta", "gamma", "n", "input_gain"):
        assert getattr(found, name) == pytest.approx(getattr(model, name), rel=2e-5), name
    assert found.hysteresis_gain == model.hysteresis_gain
    assert found.offset == pytest.approx(model.offset, abs=1e-5 * np.ptp(y))
    assert estimator.converged_
    assert_allclose(estimator.predict(u.reshape(-1, 1)), y, atol=1e-6 * np.ptp(y))


def test_estimated_bouc_wen_reaches_the_noise_floor_and_says_so():
    u = rich_input(3000, 80.0)
    clean = PIEZO_BENCH.run(u)
    noise = np.random.default_rng(0).standard_normal(u.size)
    estimator = BoucWen(n_starts=3, random_state=0).fit(u.reshape(-1, 1), clean + noise)
    assert estimator.rms_errors_.shape == (3,)
    assert estimator.rms_errors_[0] == pytest.approx(1.0, rel=0.05)
    # six parameters from 3000 samples: sqrt(6 / 3000) of the noise
    assert np.sqrt(np.mean((estimator.predict(u.reshape(-1, 1)) - clean) ** 2)) < 2 * np.sqrt(6 / 3000)


def test_bouc_wen_estimator_fixes_the_exponent_and_leaves_out_a_start():
    u = rich_input(4000, 80.0)
    y = PIEZO_BENCH.run(u, initial_state=30.0)
    estimator = BoucWen(
        exponent_bounds=(1, 1), n_settle=2000, n_starts=2, fit_intercept=False, random_state=0
    )
    found = estimator.fit(u.reshape(-1, 1), y).model_
    assert found.n == 1.0
    assert found.offset == 0.0
    # while it is loaded, h forgets its start at the rate exp(-0.016 per volt)
    assert (found.A, found.beta, found.gamma) == pytest.approx((0.9, 0.008, 0.008), rel=1e-3)


def test_bouc_wen_estimator_repeats_with_its_seed():
    u = rich_input(500, 3.0)
    y = np.tanh(u) + 0.1 * np.random.default_rng(0).standard_normal(500)
    first, again = (BoucWen(n_starts=2, random_state=7).fit(u.reshape(-1, 1), y) for _ in range(2))
    assert first.model_ == again.model_


# Kernels: compiled and as written


def test_kernels_agree_with_their_python_originals():
    rng = np.random.default_rng(0)
    u = np.round(np.cumsum(rng.standard_normal(300)), 1)
    radii, weights, state = np.array([0.0, 0.5, 2.0]), np.array([1.0, 0.5, 0.2]), np.zeros(3)
    size = operators.hysteretic_state_size(3)
    cases = [
        (_play_run, (u, radii, state)),
        (_weighted_plays_run, (u, radii, weights, state)),
        (_hysteretic_run, (u, np.zeros(size))),
        (_asymmetric_run, (u, np.array([0.5, 1.0]), np.array([-1.0]), 0.2)),
        (_bouc_wen_run, (u, 1.0, 2.0, 0.5, 1.0, 0.1, 2)),
        (_bouc_wen_run, (u, 1.0, 0.1, -0.5, 2.5, 0.0, 1)),
        (_bouc_wen_move, (0.3, 0.2, 1.0, 200.0, -190.0, 1.3, 1)),
        (_bouc_wen_move, (0.3, 0.0, 1.0, 2.0, 0.5, 1.7, 2)),
        (_bouc_wen_slope, (0.3, -1.0, 1.0, 2.0, 0.5, 1.7)),
        (_bouc_wen_step, (0.3, -1.0, -0.2, 1.0, 2.0, 0.5, 1.7)),
        (_is_too_long, (0.3, -0.2, 1.0, 2.0, 0.5, 1.0)),
        (_is_too_long, (0.3, -0.2, 1.0, 2.0, 0.5, 1.7)),
        (_is_too_long, (0.3, 0.2, 1.0, 2.0, -0.5, 1.7)),
        (operators._arctan_branch, (-0.7,)),
        (operators.play_step, (0.2, 1.0, 0.5)),
        (operators.smooth_sign, (0.3, 0.2)),
        (operators.polynomial, (np.array([1.0, -2.0, 3.0]), 0.5)),
        (operators.polynomial, (np.empty(0), 0.5)),
        *((operators.sign, (x,)) for x in (-2.0, 0.0, 3.0)),
        *((operators.asymmetric_sign, (d, 0.5, radii, weights, 0.1)) for d in (-1.0, 0.05, 1.0)),
    ]
    for kernel, arguments in cases:
        with np.errstate(over="ignore", invalid="ignore"):
            slow = kernel.py_func(*arguments)
        fast = kernel(*arguments)
        if not isinstance(fast, tuple):
            fast, slow = (fast,), (slow,)
        for a, b in zip(fast, slow, strict=True):
            assert_allclose(a, b, rtol=1e-12, atol=1e-12)


def test_hysteretic_step_agrees_with_its_python_original_state_included():
    u = np.round(np.cumsum(np.random.default_rng(1).standard_normal(300)), 1)
    for memory in (1, 2, 5):
        fast, slow = (np.zeros(operators.hysteretic_state_size(memory)) for _ in range(2))
        for value in u:
            h = operators.hysteretic_step(fast, value)
            assert h == pytest.approx(operators.hysteretic_step.py_func(slow, value), abs=1e-12)
        assert_allclose(fast, slow, atol=1e-12)


# scikit-learn


class FirstColumn:
    """Takes the first of several columns, so that the checks which bring several test all the rest."""

    def fit(self, X, y, sessions=None):
        X, y = validate_data(self, X, y, y_numeric=True, ensure_min_samples=2)
        super().fit(X[:, :1], y, sessions=sessions)
        validate_data(self, X, y, y_numeric=True)  # n_features_in_ as the checks passed them
        return self

    def predict(self, X, sessions=None):
        check_is_fitted(self)
        X = validate_data(self, X, reset=False)
        return self.model_.run(X[:, 0]) if hasattr(self, "model_") else self.operator_.run(X[:, 0])

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.regressor_tags.poor_score = (
            True  # the checks' samples are drawn independently and need all columns
        )
        return tags


class FirstColumnPrandtlIshlinskii(FirstColumn, PrandtlIshlinskii):
    pass


class FirstColumnBoucWen(FirstColumn, BoucWen):
    pass


ORDERED = "an operator with memory answers to the order of its samples, which this check permutes or cuts"
SEVERAL = "this check brings several columns; one input is wanted, and more are refused with a clear error"
MEMORY_FAILURES = dict.fromkeys(
    ["check_methods_sample_order_invariance", "check_methods_subset_invariance"], ORDERED
)
COLUMN_FAILURES = dict.fromkeys(
    [
        "check_dict_unchanged",
        "check_dont_overwrite_parameters",
        "check_dtype_object",
        "check_estimators_dtypes",
        "check_estimators_fit_returns_self",
        "check_estimators_nan_inf",
        "check_estimators_overwrite_params",
        "check_estimators_pickle",
        "check_f_contiguous_array_estimator",
        "check_fit2d_predict1d",
        "check_fit_check_is_fitted",
        "check_fit_idempotent",
        "check_fit_score_takes_y",
        "check_n_features_in",
        "check_n_features_in_after_fitting",
        "check_pipeline_consistency",
        "check_positive_only_tag_during_fit",
        "check_readonly_memmap_input",
        "check_regressor_data_not_an_array",
        "check_regressors_int",
        "check_regressors_no_decision_function",
        "check_regressors_train",
        "check_supervised_y_2d",
    ],
    SEVERAL,
)


@parametrize_with_checks(
    [FirstColumnPrandtlIshlinskii(), FirstColumnBoucWen(exponent_bounds=(1, 1), n_starts=1, random_state=0)],
    expected_failed_checks=lambda estimator: MEMORY_FAILURES,
)
def test_scikit_learn_checks_on_the_first_column(estimator, check):
    check(estimator)


@parametrize_with_checks(
    [PrandtlIshlinskii(), BoucWen(n_starts=1, random_state=0)],
    expected_failed_checks=lambda estimator: MEMORY_FAILURES | COLUMN_FAILURES,
)
def test_scikit_learn_checks(estimator, check):
    check(estimator)


@pytest.mark.parametrize(
    "estimator",
    [PrandtlIshlinskii(radii=[0, 0.8, 1.7]), BoucWen(exponent_bounds=(1, 1), n_starts=2, random_state=0)],
    ids=["prandtl-ishlinskii", "bouc-wen"],
)
class TestSessions:
    """Two recordings, each from rest: what one leaves behind must not enter the other."""

    def records(self, estimator):
        t = np.arange(400) / 100
        u = [3 * np.sin(2 * np.pi * t[:330]), 2 * np.cos(3 * np.pi * t)]
        run = EXAMPLE_2_2.run if isinstance(estimator, PrandtlIshlinskii) else PIEZO_BENCH.run
        labels = np.repeat([0, 1], [330, 400])
        return np.concatenate(u)[:, None], np.concatenate([run(part) for part in u]), labels

    def test_the_true_system_is_found_from_two_recordings(self, estimator):
        X, y, sessions = self.records(estimator)
        fitted = clone(estimator).fit(X, y, sessions=sessions)
        assert fitted.score(X, y, sessions=sessions) > 1 - 1e-8
        assert fitted.score(X, y) < 0.9999  # run through, the second recording starts from the first's end

    def test_a_prediction_is_that_of_each_recording_alone(self, estimator):
        X, y, sessions = self.records(estimator)
        fitted = clone(estimator).fit(X, y, sessions=sessions)
        alone = [fitted.predict(X[sessions == label]) for label in (0, 1)]
        assert_array_equal(fitted.predict(X, sessions=sessions), np.concatenate(alone))

    def test_samples_to_settle_are_left_out_of_each(self, estimator):
        X, y, sessions = self.records(estimator)
        spoiled = y.copy()
        spoiled[:5] += 100.0
        spoiled[330:335] -= 100.0
        fitted = clone(estimator).set_params(n_settle=5).fit(X, spoiled, sessions=sessions)
        assert_allclose(fitted.predict(X, sessions=sessions), y, atol=1e-3)
        with pytest.raises(
            ValueError, match="n_settle=400 must be 0 or more and leave at least 2 of the 730"
        ):
            clone(estimator).set_params(n_settle=400).fit(X, y, sessions=sessions)

    def test_one_label_a_sample_is_wanted(self, estimator):
        X, y, sessions = self.records(estimator)
        with pytest.raises(ValueError, match="sessions must hold one label a sample"):
            clone(estimator).fit(X, y, sessions=sessions[:-1])

"""phi regressors: worked by hand, laws of each kind, slopes against differences, refusals."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.model import (
    AbsoluteDifference,
    AsymmetricSign,
    Difference,
    DifferenceSign,
    FunctionPhi,
    HystereticOperator,
    Play,
    Polynomial,
    SmoothSign,
    Variable,
    kernels,
)
from narx_sklearn.model.phi import phi_from_dict

U = np.array([0.0, 2.0, 2.0, 1.0, -1.0, 0.5])

BY_HAND = [
    (Difference("u"), [0.0, 2.0, 0.0, -1.0, -2.0, 1.5]),
    (DifferenceSign("u"), [0.0, 1.0, 0.0, -1.0, -1.0, 1.0]),
    (AbsoluteDifference("u"), [0.0, 2.0, 0.0, 1.0, 2.0, 1.5]),
    (SmoothSign("u", width=2.0), np.tanh([0.0, 1.0, 0.0, -0.5, -1.0, 0.75])),
    # (2.66): u in loading, -1 in unloading, 0 at rest
    (AsymmetricSign("u", rising=(0, 1), falling=(-1,)), [0.0, 2.0, 0.0, -1.0, -1.0, 0.5]),
    (AsymmetricSign("u", rising=(1, 0, 2), falling=(0, 3)), [0.0, 9.0, 0.0, 3.0, -3.0, 1.5]),
    # (2.7): dragged up to 2 - 1, held down to 0, dragged to -1 + 1, held
    (Play("u", radius=1.0), [0.0, 1.0, 1.0, 1.0, 0.0, 0.0]),
]
KINDS = [phi for phi, _ in BY_HAND] + [HystereticOperator("u")]
signals = st.lists(st.integers(-8, 8).map(lambda i: i / 4), min_size=1, max_size=12).map(np.array)


def kind_name(value):
    return type(value).__name__ if not isinstance(value, list | np.ndarray) else ""


@pytest.mark.parametrize(("phi", "expected"), BY_HAND, ids=kind_name)
def test_values_worked_by_hand(phi, expected):
    np.testing.assert_allclose(phi.run(U), expected, rtol=1e-15)


def test_hysteretic_operator_by_hand():
    # (2.55): from the virgin state h = arctan(2) 2; reversal there, so going down to 1:
    # h = |arctan(-1)| (-1) + h(2); beyond 0 nothing older is left but the extremum at 2
    h2 = 2 * np.arctan(2)
    expected = [0.0, h2, h2, h2 - np.arctan(1), h2 - 3 * np.arctan(3)]
    np.testing.assert_allclose(HystereticOperator("u").run(U)[:5], expected, rtol=1e-15)


@pytest.mark.parametrize("phi", KINDS, ids=kind_name)
def test_compiled_kernel_and_its_python_original_agree(phi, monkeypatch):
    compiled = phi.run(U)
    values, state = np.empty(U.size), np.zeros(kernels.STATE_SIZE)
    monkeypatch.setattr(kernels, "phi_value", kernels.phi_value.py_func)
    kernels.phi_run.py_func(phi.kind, phi.kernel_parameters, U, state, values)
    np.testing.assert_allclose(values, compiled, rtol=1e-15)


@pytest.mark.parametrize("phi", KINDS, ids=kind_name)
@given(source=signals, cut=st.integers(0, 12))
def test_the_future_does_not_change_the_past(phi, source, cut):
    np.testing.assert_array_equal(phi.run(source)[:cut], phi.run(source[:cut]))


@pytest.mark.parametrize("phi", KINDS, ids=kind_name)
def test_run_takes_integers_views_and_read_only_arrays(phi):
    doubled = np.repeat(np.arange(-3, 4), 2)
    doubled.setflags(write=False)
    expected = phi.run(np.arange(-3.0, 4.0))
    np.testing.assert_array_equal(phi.run(doubled[::2]), expected)
    np.testing.assert_array_equal(phi.run(doubled[::2].astype(np.float32)), expected)
    assert phi.run(np.zeros(0)).shape == (0,)


@pytest.mark.parametrize("phi", KINDS, ids=kind_name)
@given(source=signals)
def test_held_signal_is_a_fixed_point_of_every_kind(phi, source):
    held = phi.run(np.append(source, [source[-1]] * 3))[-3:]
    assert held[0] == held[1] == held[2]
    if not phi.has_memory:
        assert held[0] == 0.0


@pytest.mark.parametrize("phi", KINDS, ids=kind_name)
@pytest.mark.parametrize("direction", [-1, 1])
def test_expansion_is_the_value_while_the_signal_moves_one_way(phi, direction):
    expansion = phi.expansion(direction)
    if expansion is None:
        assert isinstance(phi, HystereticOperator | SmoothSign)
        return
    source = direction * np.linspace(-4.0, 4.0, 17)
    now, before = Variable("u", 0), Variable("u", 1)
    expected = [expansion({now: a, before: b}) for a, b in zip(source[10:], source[9:-1], strict=True)]
    np.testing.assert_allclose(phi.run(source)[10:], expected, rtol=1e-14)


@pytest.mark.parametrize("phi", KINDS, ids=kind_name)
@pytest.mark.parametrize("rate", [-1e-3, 1e-3])
def test_quasi_static_value_is_that_of_a_slow_ramp(phi, rate):
    level = np.arange(0.0, 4.0, 1e-3) if rate > 0 else np.arange(4.0, 0.0, -1e-3)
    run = phi.run(level)
    if isinstance(phi, HystereticOperator) and rate < 0:
        run -= run[0]  # the branch from the virgin state up to the start
    np.testing.assert_allclose(phi.quasi_static(level, rate)[-10:], run[-10:], rtol=1e-9, atol=1e-12)


def test_kinds_without_memory_vanish_at_rest_also_as_polynomials():
    for phi in KINDS:
        if not phi.has_memory:
            assert phi.expansion(0) == Polynomial()


# --- slopes for sensitivities


@pytest.mark.parametrize("phi", [phi for phi in KINDS if phi.kind != kernels.HYSTERETIC], ids=kind_name)
@pytest.mark.parametrize(
    "function", [kernels.phi_slopes, kernels.phi_slopes.py_func], ids=["compiled", "python"]
)
@pytest.mark.parametrize(("now", "before", "held"), [(1.3, 0.4, 0.1), (-0.7, 0.5, 0.2), (0.6, 0.5, 0.9)])
def test_slopes_are_the_derivatives_of_the_value(phi, function, now, before, held):
    def value(point):
        state = np.full(kernels.STATE_SIZE, point[2])
        return kernels.phi_value(phi.kind, phi.kernel_parameters, point[0], point[1], state), state

    point, step = np.array([now, before, held]), 1e-6
    expected = [(value(point + e)[0] - value(point - e)[0]) / (2 * step) for e in step * np.eye(3)]
    slopes = np.full(3, np.nan)
    function(phi.kind, phi.kernel_parameters, now, before, value(point)[1], slopes)
    np.testing.assert_allclose(slopes, expected, atol=1e-8)


# --- functions of the user's


def test_function_gets_its_arguments_lagged_and_held_before_the_first_sample():
    phi = FunctionPhi(lambda u, old, y: u - old + 10 * y, ["u[k]", "u[k-2]", "y[k-1]"])
    # lag by lag: u - [1, 1, 1, 2], y one later is [5, 5, 6, 7]
    assert phi.run([1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]).tolist() == [50.0, 51.0, 62.0, 72.0]
    assert phi.reach == 2
    assert phi.signals == {"u", "y"}
    assert phi.quasi_static(3.0, 0.5) == 3.0 - 2.0 + 10 * 2.5


def test_function_of_a_record_shorter_than_its_lags():
    assert FunctionPhi(np.negative, ["u[k-5]"]).run(np.array([2.0, 3.0])).tolist() == [-2.0, -2.0]


@pytest.mark.parametrize(
    ("build", "error", "message"),
    [
        (lambda: FunctionPhi("abs", ["u[k]"]), TypeError, "function must be callable, got str"),
        (lambda: FunctionPhi(np.abs, []), ValueError, "at least one variable"),
        (lambda: FunctionPhi(np.abs, ["u[k+1]"]), ValueError, "lag 0 or more"),
        (lambda: FunctionPhi(np.sum, ["u[k]"]).run(U), ValueError, r"returned shape \(\) for 6 samples"),
        (lambda: FunctionPhi(np.abs, ["u[k]"]).run(U, U), ValueError, r"signals \['u'\], got 2"),
        (lambda: Play("u", radius=0.0), ValueError, "radius of Play must be a positive number, got 0.0"),
        (lambda: Play("u", radius="1"), ValueError, "must be a positive number, got '1'"),
        (lambda: SmoothSign("u", width=np.nan), ValueError, "width of SmoothSign must be a positive"),
        (lambda: AsymmetricSign("u", rising=()), ValueError, "rising needs at least one finite coefficient"),
        (lambda: AsymmetricSign("u", falling=(np.inf,)), ValueError, "falling needs at least one finite"),
    ],
)
def test_malformed_phi_is_refused(build, error, message):
    with pytest.raises(error, match=message):
        build()


# --- values


@pytest.mark.parametrize("phi", KINDS, ids=kind_name)
def test_phi_survives_dict_and_pickle(phi):
    assert phi_from_dict(phi.to_dict()) == phi
    assert pickle.loads(pickle.dumps(phi)) == phi
    assert hash(phi_from_dict(phi.to_dict())) == hash(phi)


def test_function_is_asked_for_by_name_never_read_from_a_file():
    phi = FunctionPhi(np.abs, ["u[k]", "y[k-1]"], name="phi1")
    content = phi.to_dict()
    assert content["function"] == "absolute"
    assert phi_from_dict(content, {"absolute": np.abs}) == phi
    with pytest.raises(ValueError, match=r"pass it as functions=\{'absolute': ...\}"):
        phi_from_dict(content)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"type": "Backlash", "signal": "u"}, "Unknown type of phi regressor 'Backlash'"),
        ({"signal": "u"}, "Unknown type of phi regressor None"),
        ({"type": "Play", "signal": "u", "width": 1.0}, "fields of the phi regressor Play do not fit"),
        ({"type": "Play"}, "fields of the phi regressor Play do not fit"),
    ],
)
def test_malformed_dict_is_refused(content, message):
    with pytest.raises(ValueError, match=message):
        phi_from_dict(content)


def test_description_defines_each_kind_in_words():
    assert [phi.describe() for phi in KINDS] == [
        "u[k] - u[k-1]",
        "sign(u[k] - u[k-1])",
        "|u[k] - u[k-1]|",
        "tanh((u[k] - u[k-1])/2)",
        "(u[k]) while u rises, (-1) while it falls, else 0",
        "(1 + 2*u[k]^2) while u rises, (3*u[k]) while it falls, else 0",
        "play of u with radius 1",
        "hysteretic operator of u",
    ]
    assert FunctionPhi(np.abs, ["u[k]"]).describe() == "absolute(u[k])"

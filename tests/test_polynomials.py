"""Polynomials over lagged variables: ring laws, calculus, substitution, and the text notation."""

from math import prod

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from narx_sklearn.model import Polynomial, Term, Variable

VARIABLES = tuple(Variable(signal, lag) for signal in ("y", "u") for lag in (1, 2))

terms = st.lists(st.sampled_from(VARIABLES), max_size=3).map(lambda chosen: Term.of(*chosen))
# whole numbers, so that every law can be asked to hold exactly
polynomials = st.dictionaries(terms, st.integers(-9, 9), max_size=4).map(Polynomial)
points = st.fixed_dictionaries({variable: st.integers(-3, 3) for variable in VARIABLES})
variables = st.sampled_from(VARIABLES)


# --- algebra


@given(polynomials, polynomials, polynomials)
def test_polynomials_form_a_commutative_ring(p, q, r):
    assert p + q == q + p
    assert p * q == q * p
    assert (p + q) + r == p + (q + r)
    assert (p * q) * r == p * (q * r)
    assert p * (q + r) == p * q + p * r
    assert p + 0 == p
    assert p * 1 == p
    assert p - p == Polynomial()
    assert 1 - p == -(p - 1)


@given(polynomials, polynomials, points)
def test_value_of_a_sum_and_a_product_is_that_of_the_values(p, q, point):
    assert (p + q)(point) == p(point) + q(point)
    assert (p * q)(point) == p(point) * q(point)


@given(polynomials, st.integers(0, 3))
def test_power_is_repeated_product(p, power):
    assert p**power == prod([p] * power, start=Polynomial.constant(1.0))


@pytest.mark.parametrize("power", [-1, 0.5])
def test_only_whole_powers_are_polynomials(power):
    with pytest.raises(ValueError, match="integer, zero or more"):
        Polynomial.variable("y[k-1]") ** power


def test_equal_terms_are_added_and_zeros_dropped():
    p = Polynomial([("u[k-1]*y[k-1]", 2.0), ("y[k-1]*u[k-1]", 1.0), ("u[k-1]", 1.0), ("u[k-1]", -1.0)])
    assert p.coefficients == {Term.parse("y[k-1]*u[k-1]"): 3.0}
    assert p["u[k-1]"] == 0.0
    assert p.degree == 2


def test_the_zero_polynomial_is_false_and_prints_as_zero():
    zero = Polynomial()
    assert not zero
    assert (str(zero), zero.latex(), zero.degree, zero({})) == ("0", "0", 0, 0.0)


# --- calculus and substitution


@given(polynomials, polynomials, variables)
def test_derivative_obeys_sum_and_product_rule(p, q, variable):
    assert (p + q).derivative(variable) == p.derivative(variable) + q.derivative(variable)
    assert (p * q).derivative(variable) == p.derivative(variable) * q + p * q.derivative(variable)


def test_derivative_by_hand():
    p = Polynomial.parse("3*y[k-1]^2*u[k-1] + u[k-1] - 4")
    assert str(p.derivative("y[k-1]")) == "6*y[k-1]*u[k-1]"
    assert str(p.derivative("u[k-1]")) == "1 + 3*y[k-1]^2"


@given(polynomials, polynomials, variables, points)
def test_substitution_is_composition(p, q, variable, point):
    assert p.substitute({variable: q})(point) == p(point | {variable: q(point)})


@given(polynomials, points)
def test_substituting_every_variable_leaves_the_value(p, point):
    assert p.substitute(point) == Polynomial.constant(p(point))


def test_substitution_is_simultaneous():
    swapped = Polynomial.parse("y[k-1] - u[k-1]").substitute(
        {"y[k-1]": Polynomial.variable("u[k-1]"), "u[k-1]": Polynomial.variable("y[k-1]")}
    )
    assert str(swapped) == "-y[k-1] + u[k-1]"


@given(polynomials, variables)
def test_collected_powers_rebuild_the_polynomial(p, variable):
    collected = p.collect(variable)
    x = Polynomial.variable(variable)
    assert sum((c * x**power for power, c in enumerate(collected)), Polynomial()) == p
    assert not any(variable in c.variables for c in collected)


@given(polynomials, points, st.integers(-3, 3), st.integers(-3, 3))
def test_translate_writes_the_same_function_in_signals_that_are_not_offset(p, point, y0, u0):
    offset = {"y": y0, "u": u0}
    deviations = {variable: value - offset[variable.signal] for variable, value in point.items()}
    assert p.translate(offset)(point) == p(deviations)


@given(polynomials, st.integers(0, 3))
def test_shift_delays_every_variable(p, steps):
    assert p.shift(steps).variables == tuple(variable.shift(steps) for variable in p.variables)
    assert list(p.shift(steps).coefficients.values()) == list(p.coefficients.values())


def test_value_works_elementwise_on_arrays():
    p = Polynomial.parse("2*u[k-1]^2 - 1")
    np.testing.assert_array_equal(p({"u[k-1]": np.array([0.0, 1.0, 2.0])}), [-1.0, 1.0, 7.0])


def test_missing_values_are_all_named():
    with pytest.raises(ValueError, match=r"No value given for y\[k-1\], u\[k-1\]"):
        Polynomial.parse("y[k-1]*u[k-1] + u[k-2]")({"u[k-2]": 1.0})


# --- text


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0.5*y[k-1] - u[k-2]^2 + 1", {"1": 1.0, "y[k-1]": 0.5, "u[k-2]^2": -1.0}),
        ("-y[k-1]", {"y[k-1]": -1.0}),
        ("+ 2 y[k-1]", {"y[k-1]": 2.0}),
        ("1e-3*u[k] + 2.5E+2", {"u[k]": 1e-3, "1": 250.0}),
        (".5*u[k+1] - -1.", {"u[k+1]": 0.5, "1": 1.0}),
        ("y[k-1] - y[k-1]", {}),
        ("0", {}),
        ("3*1", {"1": 3.0}),
    ],
)
def test_sum_is_read_from_text(text, expected):
    assert Polynomial.parse(text) == Polynomial(expected)


@pytest.mark.parametrize(
    "text", ["", "y[k-1] +", "2*", "y", "2**y[k-1]", "y[k-1] = 1", "sin(u[k])", "0.5*0.2"]
)
def test_text_that_is_no_sum_of_terms_is_refused(text):
    with pytest.raises(ValueError, match=r"Cannot read"):
        Polynomial.parse(text)


coefficients = st.floats(-1e300, 1e300).filter(lambda value: value == 0.0 or abs(value) > 1e-300)


@given(st.dictionaries(terms, coefficients, max_size=4))
@example({Term(): 1e-7, Term.parse("y[k-1]"): -1e22})
def test_text_of_seventeen_digits_is_read_back_exactly(content):
    p = Polynomial(content)
    assert Polynomial.parse(p.to_text(digits=17)) == p


def test_text_rounds_to_the_digits_asked_for():
    p = Polynomial({"y[k-1]": -1.23456789, "1": 2.0, "u[k]": 1.0})
    assert str(p) == "2 - 1.2346*y[k-1] + u[k]"
    assert p.to_text(digits=2) == "2 - 1.2*y[k-1] + u[k]"


def test_latex_writes_exponents_of_ten():
    p = Polynomial({"y[k-1]": 3.16e-7, "1": -2.0})
    assert p.latex() == r"-2 + 3.16 \times 10^{-7}\, y_{k-1}"

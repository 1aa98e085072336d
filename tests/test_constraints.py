"""Equality constraints: reading, solution spaces, elimination, contradiction."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from narx_sklearn.identification import LinearConstraints, parse_constraints
from narx_sklearn.model import TermLibrary

LIBRARY = TermLibrary(["1", "y[k-1]", "y[k-2]", "u[k-1]", "y[k-1]*u[k-1]"])


@pytest.mark.parametrize(
    ("text", "row", "side"),
    [
        ("y[k-1] + y[k-2] = 1", [0, 1, 1, 0, 0], 1.0),
        ("y[k-1] = 1 - y[k-2]", [0, 1, 1, 0, 0], 1.0),
        ("2*u[k-1] - 3 = y[k-1]", [0, -1, 0, 2, 0], 3.0),
        ("constant = 0.5", [1, 0, 0, 0, 0], 0.5),
        ("u[k-1]*y[k-1] = constant", [-1, 0, 0, 0, 1], 0.0),
    ],
)
def test_texts_are_read_as_rows(text, row, side):
    read = parse_constraints(text, LIBRARY)
    np.testing.assert_array_equal(read.S, [row])
    np.testing.assert_array_equal(read.c, [side])


def test_a_matrix_is_taken_as_it_is():
    S = np.array([[0, 1, 1, 0, 0], [1, 0, 0, -2, 0]])
    read = parse_constraints((S, [1, 0]), LIBRARY)
    np.testing.assert_array_equal(read.S, S)
    assert read.terms.tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("nothing", [None, [], ()])
def test_no_constraints_leave_every_parameter_free(nothing):
    theta0, Z = parse_constraints(nothing, LIBRARY).solution_space()
    assert not theta0.any()
    np.testing.assert_array_equal(Z, np.eye(5))


def test_a_signal_may_have_constant_in_its_name():
    library = TermLibrary(["1", "time_constant[k-1]", "constant[k-1]"])
    read = parse_constraints("constant + 2*time_constant[k-1] = 3*constant[k-1]", library)
    named = dict(zip(library.names, read.S[0].tolist(), strict=True))
    assert named == {"1": 1.0, "time_constant[k-1]": 2.0, "constant[k-1]": -3.0}


@given(st.integers(1, 3), st.integers(3, 6), st.integers(0, 999))
def test_every_point_of_the_solution_space_meets_the_constraints(n_constraints, n_terms, seed):
    rng = np.random.default_rng(seed)
    constraints = LinearConstraints(rng.normal(size=(n_constraints, n_terms)), rng.normal(size=n_constraints))
    assume(np.linalg.cond(constraints.S) < 1e3)
    theta0, Z = constraints.solution_space()
    np.testing.assert_allclose(Z.T @ Z, np.eye(n_terms - n_constraints), atol=1e-13)
    theta = theta0 + Z @ rng.normal(size=Z.shape[1])
    np.testing.assert_allclose(constraints.S @ theta, constraints.c, atol=1e-12)


@given(st.integers(1, 3), st.integers(3, 6), st.integers(0, 999))
def test_eliminated_parameters_follow_from_the_others(n_constraints, n_terms, seed):
    rng = np.random.default_rng(seed)
    constraints = LinearConstraints(rng.normal(size=(n_constraints, n_terms)), rng.normal(size=n_constraints))
    solved = constraints.eliminate(rng.normal(size=n_terms))
    assume(np.abs(solved.S).max(initial=0.0) < 1e3)
    theta = np.empty(n_terms)
    theta[solved.rest] = rng.normal(size=solved.rest.size)
    theta[solved.pivots] = solved.c - solved.S @ theta[solved.rest]
    np.testing.assert_allclose(constraints.S @ theta, constraints.c, atol=1e-9)


def test_elimination_solves_for_the_preferred_parameter():
    solved = LinearConstraints(np.array([[1.0, 2.0, 4.0]]), np.array([8.0])).eliminate(np.array([0, 9, 1]))
    assert solved.pivots.tolist() == [1]
    np.testing.assert_allclose(solved.S, [[0.5, 2.0]])
    np.testing.assert_allclose(solved.c, [4.0])
    assert solved.support([0]) == (1, 0)


def test_constraints_that_repeat_each_other_count_once():
    read = parse_constraints(["y[k-1] + y[k-2] = 1", "2*y[k-1] = 2 - 2*y[k-2]", "u[k-1] = 0"], LIBRARY)
    assert len(read) == 2


def test_contradictory_constraints_are_refused_with_their_gap():
    with pytest.raises(ValueError, match=r"contradict each other: constraint \d of 2 misses its value"):
        parse_constraints(["y[k-1] + y[k-2] = 1", "y[k-1] + y[k-2] = 2"], LIBRARY)


def test_scaled_constraints_speak_of_scaled_parameters():
    constraints = LinearConstraints(np.array([[1.0, 2.0]]), np.array([3.0]))
    factors = np.array([10.0, 0.1])
    theta = np.array([1.0, 1.0])
    np.testing.assert_allclose(constraints.scaled(factors).S @ (theta / factors), constraints.c)


def test_rows_whose_terms_all_left_are_dropped_or_refused():
    constraints = parse_constraints(["y[k-1] + y[k-2] = 1", "u[k-1] = 0"], LIBRARY)
    inside = constraints.restrict([1, 4])
    np.testing.assert_array_equal(inside.S, [[1, 0]])
    with pytest.raises(ValueError, match="must sum to 1, but none of its terms is in the model"):
        constraints.restrict([0, 3])


@pytest.mark.parametrize(
    ("constraints", "message"),
    [
        ("y[k-1] + y[k-2]", "Cannot read the constraint"),
        ("y[k-1] = u[k-1] = 1", "Cannot read the constraint"),
        ("y[k-3] = 1", r"names y\[k-3\], which is not among the 5 candidate terms"),
        ("y[k-3] = 1", r"; check lags, degree and fit_intercept\. The candidates are .*y\[k-1\], .*u\[k-1\]"),
        ("w[k-1] = y[k-1]", r"names w\[k-1\], .* 'w' is none of the signals, which are \['u', 'y'\]\. Sig"),
        ((np.ones((2, 5)), [1.0]), r"S has shape \(2, 5\); for c of 1 values and 5 candidate terms"),
        ((np.ones((1, 4)), [1.0]), r"must be \(1, 5\)"),
    ],
)
def test_unreadable_constraints_say_what_is_wanted(constraints, message):
    with pytest.raises(ValueError, match=message):
        parse_constraints(constraints, LIBRARY)


def test_a_constant_that_is_no_candidate_is_named_as_it_was_written():
    with pytest.raises(ValueError, match="names constant, which is not among the 1 candidate terms; check"):
        parse_constraints("constant = 1", TermLibrary(["y[k-1]"]))


def test_what_a_message_calls_the_constant_term_can_be_typed():
    library = TermLibrary(["1", "y[k-1]"])
    with pytest.raises(ValueError, match=r"The candidates are constant, y\[k-1\]\."):
        parse_constraints("y[k-9] = 1", library)
    np.testing.assert_array_equal(parse_constraints("constant = 0.2", library).S, [[1.0, 0.0]])


@pytest.mark.parametrize("text", ["1 = 9", "2*1 = 9", "9 = 9"])
def test_a_constraint_of_numbers_alone_says_what_the_constant_term_is_called(text):
    with pytest.raises(ValueError, match=r"names no term.*Write constant for the constant term"):
        parse_constraints(text, TermLibrary(["1", "y[k-1]"]))

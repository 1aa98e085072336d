"""Terms are values: one notation, one canonical order, and the algebra of monomials."""

import pickle
from dataclasses import FrozenInstanceError
from itertools import permutations
from math import comb, prod

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from narx_sklearn.model import Term, TermLibrary, Variable, count_candidates

SIGNALS = ("y", "y2", "u", "u0", "u1", "u01", "u10", "phi1", "phi2", "drive", "e", "m")

variables = st.builds(Variable, st.sampled_from(SIGNALS), st.integers(-2, 12))
factors = st.lists(st.tuples(variables, st.integers(1, 3)), max_size=4)
terms = st.builds(lambda chosen: Term(tuple(chosen)), factors)
libraries = st.builds(TermLibrary, st.lists(terms, max_size=6))


# --- variables


@pytest.mark.parametrize(
    ("text", "signal", "lag"),
    [("y[k-1]", "y", 1), ("u[k]", "u", 0), (" phi2 [ k - 3 ] ", "phi2", 3), ("u[k+2]", "u", -2)],
)
def test_variable_is_read_from_text(text, signal, lag):
    assert Variable.parse(text) == Variable(signal, lag)


@given(variables)
def test_variable_survives_print_and_parse(variable):
    assert Variable.parse(str(variable)) == variable


@given(variables, st.integers(0, 5))
def test_shift_moves_a_variable_into_the_past(variable, steps):
    assert variable.shift(steps).lag == variable.lag + steps
    assert variable.shift(steps).shift(-steps) == variable


@pytest.mark.parametrize("text", ["y", "y[1]", "y[k-]", "1y[k]", "y[k-1] u[k]", "y(k-1)", "y[k-1.5]", ""])
def test_malformed_variable_is_refused(text):
    with pytest.raises(ValueError, match="write it like"):
        Variable.parse(text)


@pytest.mark.parametrize("name", ["1y", "", "y 1", "y-1", "y[k]"])
def test_signal_name_that_could_not_be_read_back_is_refused(name):
    with pytest.raises(ValueError, match="must be a letter followed by"):
        Variable(name, 0)


@pytest.mark.parametrize("lag", [1.0, "1", None, True])
def test_lag_must_be_an_integer(lag):
    with pytest.raises(TypeError, match="lag of y must be an integer"):
        Variable("y", lag)


def test_numpy_integers_are_lags_like_any_other():
    assert Variable("y", np.int64(2)) == Variable("y", 2)
    assert type(Variable("y", np.int64(2)).lag) is int


def test_reading_order_is_outputs_others_inputs_phi_noise_then_number_then_lag():
    texts = ["y[k-1]", "y[k-2]", "y2[k-1]", "drive[k]", "u[k]", "u2[k]", "u10[k]", "phi1[k-1]", "e[k-1]"]
    ordered = sorted((Variable.parse(t) for t in reversed(texts)), key=lambda v: v.order)
    assert [str(v) for v in ordered] == texts


@given(variables, variables)
@example(Variable("u", 1), Variable("u0", 1))
@example(Variable("u1", 1), Variable("u01", 1))
def test_different_variables_never_tie_in_reading_order(a, b):
    assert (a.order == b.order) == (a == b)


# --- terms


def test_equal_variables_join_into_a_power():
    assert str(Term.parse("u[k-1]*y[k-1]*u[k-1]")) == "y[k-1]*u[k-1]^2"


@pytest.mark.parametrize(
    "text", ["u[k-2]^2*phi2[k-1]", "phi2[k-1] * u[k-2]**2", "u[k-2] u[k-2] phi2[k-1]", " u[k-2]^2phi2[k-1] "]
)
def test_every_spelling_of_a_term_is_the_same_term(text):
    assert Term.parse(text) == Term(((Variable("u", 2), 2), (Variable("phi2", 1), 1)))


@pytest.mark.parametrize("text", ["1", " 1 "])
def test_one_is_the_constant_term(text):
    assert Term.parse(text) == Term()
    assert str(Term()) == "1"
    assert (Term().degree, Term().max_lag, Term().cluster) == (0, 0, ())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty text"),
        ("  ", "at position 0"),
        ("2*y[k-1]", "at position 0"),
        ("y[k-1]*", "at position 7"),
        ("y[k-1]+u[k]", "at position 6"),
        ("*y[k-1]", "at position 0"),
        ("y[k-1]^0", "must be a positive integer, got 0"),
        ("y[k-1]^1.5", "at position 8"),
    ],
)
def test_malformed_term_is_refused_with_its_position(text, message):
    with pytest.raises(ValueError, match=message):
        Term.parse(text)


@pytest.mark.parametrize("exponent", [0, -1, 1.5])
def test_exponents_must_be_positive_integers(exponent):
    with pytest.raises(ValueError, match="positive integer"):
        Term(((Variable("u", 1), exponent),))


@given(terms)
def test_term_survives_print_and_parse(term):
    assert Term.parse(str(term)) == term


@given(terms, terms, terms)
def test_product_is_commutative_associative_and_has_the_constant_as_one(a, b, c):
    assert a * b == b * a
    assert (a * b) * c == a * (b * c)
    assert a * Term() == a
    assert (a * b).degree == a.degree + b.degree


@given(terms, st.integers(0, 4))
def test_power_is_repeated_product(term, power):
    assert term**power == prod([term] * power, start=Term())


@given(terms, st.integers(-2, 4))
def test_shift_acts_on_every_factor_and_can_be_undone(term, steps):
    assert term.shift(steps).shift(-steps) == term
    assert term.shift(steps).degree == term.degree
    if term.factors:
        assert term.shift(steps).max_lag == term.max_lag + steps
        assert term.shift(steps).min_lag == term.min_lag + steps


@given(terms)
def test_term_is_the_product_of_its_expanded_variables(term):
    assert Term.of(*term.expanded) == term
    assert len(term.expanded) == term.degree


@given(terms, variables)
def test_term_is_what_remains_without_a_variable_times_its_power(term, variable):
    assert term.without(variable) * Term.of(variable) ** term.exponent(variable) == term


@given(terms, st.integers(1, 4))
def test_cluster_forgets_lags_and_keeps_the_degree(term, steps):
    assert term.shift(steps).cluster == term.cluster
    assert sum(exponent for _, exponent in term.cluster) == term.degree
    assert {signal for signal, _ in term.cluster} == term.signals


def test_clusters_of_the_model_of_equation_2_30():
    # the seven terms of thesis eq. (2.30) and the clusters Definition 2.2 gives them
    texts = [
        "y[k-1]",
        "u[k-2]",
        "phi1[k-1]",
        "y[k-2]*u[k-4]",
        "y[k-1]*y[k-2]",
        "y[k-1]*u[k-1]",
        "u[k-1]*phi1[k-2]",
    ]
    found = {text: dict(Term.parse(text).cluster) for text in texts}
    assert found["y[k-2]*u[k-4]"] == found["y[k-1]*u[k-1]"] == {"y": 1, "u": 1}
    assert found["y[k-1]*y[k-2]"] == {"y": 2}
    assert found["u[k-1]*phi1[k-2]"] == {"u": 1, "phi1": 1}


def test_product_with_something_else_is_not_defined():
    with pytest.raises(TypeError):
        Term() * 2.0


def test_latex_writes_numbers_of_signals_and_lags_as_subscripts():
    assert Term.parse("y[k-1]*u2[k]^3*phi1[k-2]").latex() == r"y_{k-1} u_{2,k}^{3} \phi_{1,k-2}"
    assert Variable("coil_drive", 1).latex() == r"\mathrm{coil\_drive}_{k-1}"
    assert Variable("Öl_Druck", 1).latex() == r"\text{Öl\_Druck}_{k-1}"  # math mode sets no accents
    assert Variable("ö1", 0).latex() == r"\text{ö}_{1,k}"
    assert Term().latex() == "1"


def test_terms_cannot_be_changed():
    with pytest.raises(FrozenInstanceError):
        Term().factors = ()
    with pytest.raises(FrozenInstanceError):
        Variable("y", 1).lag = 2


@given(libraries)
def test_library_survives_pickle_and_hashes_by_value(library):
    again = pickle.loads(pickle.dumps(library))
    assert again == library
    assert hash(again) == hash(library)


# --- libraries


@pytest.mark.parametrize("texts", list(permutations(["1", "u[k-1]", "u0[k-1]", "y[k-1]*u[k-1]"])))
def test_order_of_a_library_does_not_depend_on_how_it_was_built(texts):
    assert TermLibrary(texts).names == ["1", "u[k-1]", "u0[k-1]", "y[k-1]*u[k-1]"]


@given(st.lists(terms, max_size=6), st.randoms(use_true_random=False))
def test_library_has_no_duplicates_and_one_canonical_order(chosen, random):
    shuffled = chosen + chosen[:3]
    random.shuffle(shuffled)
    library = TermLibrary(shuffled)
    assert library == TermLibrary(chosen)
    assert len(library) == len(set(chosen))
    assert [t.degree for t in library] == sorted(t.degree for t in set(chosen))


@given(libraries, libraries)
def test_libraries_obey_the_algebra_of_sets(a, b):
    assert set(a | b) == set(a) | set(b)
    assert set(a & b) == set(a) & set(b)
    assert set(a - b) == set(a) - set(b)
    assert (a & b) | (a - b) == a
    assert set(a * b) == {s * t for s in a for t in b}


@given(libraries)
def test_index_contains_slice_and_subset_agree(library):
    for i, term in enumerate(library):
        assert library.index(term) == library.index(str(term)) == i
        assert term in library
        assert str(term) in library
    assert library[1:] == TermLibrary(library.terms[1:])
    assert library.subset(range(len(library))) == library
    assert library.filter(lambda term: term.degree > 1) == TermLibrary(t for t in library if t.degree > 1)


def test_missing_term_is_named():
    with pytest.raises(ValueError, match=r"y\[k-9\] is not among the 1 terms"):
        TermLibrary(["y[k-1]"]).index("y[k-9]")


def test_other_kinds_are_no_terms():
    with pytest.raises(TypeError, match="got float"):
        TermLibrary([1.0])


@given(st.lists(variables, max_size=4, unique=True), st.integers(0, 3))
def test_polynomial_library_has_the_counted_number_of_terms(chosen, degree):
    full = TermLibrary.polynomial(chosen, degree)
    assert len(full) == comb(len(chosen) + degree, degree) == count_candidates(len(chosen), degree)
    assert TermLibrary.polynomial(chosen, degree, include_constant=False) == full - TermLibrary(["1"])
    assert full.degree == (degree if chosen else 0)


def test_polynomial_library_of_two_variables_by_hand():
    library = TermLibrary.polynomial(["u[k-1]", "y[k-1]", "u[k-1]"], degree=2)
    assert library.names == ["1", "y[k-1]", "u[k-1]", "y[k-1]^2", "y[k-1]*u[k-1]", "u[k-1]^2"]


@given(st.integers(0, 9), st.integers(0, 5))
def test_candidate_count_is_the_recursion_of_the_thesis(n_variables, degree):
    # (2.38): n_0 = 1, n_i = n_(i-1) (n_variables + i - 1) / i, summed over i
    count, total = 1, 1
    for i in range(1, degree + 1):
        count = count * (n_variables + i - 1) // i
        total += count
    assert count_candidates(n_variables, degree) == total


@given(libraries)
def test_table_holds_what_the_library_holds(library):
    table = library.table(SIGNALS)
    at = [Variable(SIGNALS[c], int(lag)) for c, lag in zip(table.channels, table.lags, strict=True)]
    rebuilt = [Term.of(*(at[i] for i in row[row >= 0])) for row in table.factors]
    assert rebuilt == list(library)
    assert len(set(at)) == len(at)
    assert set(at) == set(library.variables)


def test_table_of_an_unknown_signal_is_refused():
    with pytest.raises(ValueError, match=r"signals \['u'\], which are not among \['y'\]"):
        TermLibrary(["u[k-1]"]).table(["y"])


def test_empty_library_is_a_library():
    empty = TermLibrary()
    assert (len(empty), empty.degree, empty.max_lag, empty.variables, str(empty)) == (0, 0, 0, (), "")
    assert empty.table(["y"]).factors.shape == (0, 1)

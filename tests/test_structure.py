"""Candidate terms: clusters as text, filters, lags and delays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.identification import NARXRegressor, exclude_clusters
from narx_sklearn.identification.structure.candidates import (
    candidate_library,
    cluster_text,
    parse_cluster,
    structure_filter,
)
from narx_sklearn.model import Difference, DifferenceSign, Term, TermLibrary, count_candidates


def candidates(outputs=("y",), inputs=("u",), phi=(), **options):
    defaults = {
        "output_lags": 1, "input_lags": 1, "phi_lags": 1, "delay": 1, "degree": 1, "include_constant": False,
        "keep": structure_filter(None, (), outputs, inputs, phi),
    }  # fmt: skip
    return candidate_library(outputs, inputs, phi, **(defaults | options)).names


@given(st.dictionaries(st.sampled_from(["y", "u", "phi1", "x", "u2"]), st.integers(1, 4), max_size=4))
def test_clusters_survive_printing_and_reading(exponents):
    term = Term.parse("*".join(f"{s}[k-1]^{e}" for s, e in exponents.items()) or "1")
    assert parse_cluster(cluster_text(term.cluster)) == term.cluster


@pytest.mark.parametrize(
    ("text", "cluster"),
    [("1", ()), ("u*y^2", (("y", 2), ("u", 1))), ("y**2", (("y", 2),)), (" y * y ", (("y", 2),))],
)
def test_clusters_are_read_in_any_spelling(text, cluster):
    assert parse_cluster(text) == cluster


@pytest.mark.parametrize("text", ["y[k-1]", "y+u", "", "2*y"])
def test_what_is_no_cluster_is_refused(text):
    with pytest.raises(ValueError, match="as a term cluster; write it like"):
        exclude_clusters(text)


def test_excluding_a_cluster_takes_all_its_lags_and_nothing_else():
    library = TermLibrary.polynomial(["y[k-1]", "y[k-2]", "u[k-1]"], degree=2)
    left = library.filter(exclude_clusters(["y^2", "1"]))
    assert (library - left).names == ["1", "y[k-1]^2", "y[k-1]*y[k-2]", "y[k-2]^2"]


def test_structure_and_exclusion_both_filter():
    keep = structure_filter(lambda term: "y" in term.signals, ["y^2"], ("y",), ("u",), ())
    library = TermLibrary.polynomial(["y[k-1]", "u[k-1]"], degree=2)
    assert library.filter(keep).names == ["y[k-1]", "y[k-1]*u[k-1]"]


def test_unknown_structure_says_what_is_possible():
    with pytest.raises(ValueError, match="structure='black' is not known; pass None, a function of a Term"):
        structure_filter("black", (), ("y",), ("u",), ())


def test_an_integer_means_up_to_and_starts_at_the_delay():
    assert candidates(output_lags=2, input_lags=3, delay=2) == ["y[k-1]", "y[k-2]", "u[k-2]", "u[k-3]"]
    assert candidates(output_lags=[3], input_lags=1, delay=0) == ["y[k-3]", "u[k]", "u[k-1]"]


def test_a_list_means_itself_whatever_the_delay():
    assert candidates(output_lags=0, input_lags=[0, 5], delay=3) == ["u[k]", "u[k-5]"]


def test_each_input_may_have_lags_and_delay_of_its_own():
    given_lists = candidates(inputs=("u1", "u2"), output_lags=[], input_lags=[[1], [2, 4]])
    given_names = candidates(inputs=("u1", "u2"), output_lags=[], input_lags={"u2": [2, 4], "u1": 1})
    assert given_lists == given_names == ["u1[k-1]", "u2[k-2]", "u2[k-4]"]
    assert candidates(inputs=("u1", "u2"), output_lags=[], input_lags=2, delay={"u1": 0, "u2": 2}) == [
        "u1[k]", "u1[k-1]", "u1[k-2]", "u2[k-2]",
    ]  # fmt: skip


def test_phi_of_an_input_may_be_present_and_phi_of_the_output_may_not():
    phi = (Difference("u", name="phi1"), DifferenceSign("y", name="phi2"))
    names = candidates(phi=phi, output_lags=[], input_lags=[], phi_lags=1, delay=0)
    assert names == ["phi1[k]", "phi1[k-1]", "phi2[k-1]"]
    with pytest.raises(ValueError, match="phi_lags holds the lag 0; the shortest lag allowed here is 1"):
        candidates(phi=phi, phi_lags={"phi2": [0], "phi1": 1})


@given(st.integers(1, 4), st.integers(1, 4), st.integers(1, 3))
def test_candidates_are_as_many_as_the_formula_counts(n_y, n_u, degree):
    names = candidates(output_lags=n_y, input_lags=n_u, degree=degree, include_constant=True)
    assert len(names) == count_candidates(n_y + n_u, degree)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"degree": 0}, "degree must be an integer of at least 1, got 0"),
        ({"degree": True}, "degree must be an integer of at least 1, got True"),
        ({"delay": -1}, "delay must be a non-negative integer, got -1 for u"),
        ({"input_lags": 1, "delay": 2}, "input_lags=1 ends before the shortest lag allowed, 2"),
        ({"output_lags": [0]}, "output_lags holds the lag 0; the shortest lag allowed here is 1"),
        ({"input_lags": {"v": 1}}, r"input_lags names \['v'\]; the signals here are \['u'\]"),
        ({"input_lags": [[1], [1]]}, r"input_lags has 2 entries for the 1 signals \['u'\]"),
        ({"output_lags": 0, "input_lags": 0}, "No candidate term is left"),
        ({"output_lags": 20, "degree": 9}, "degree=9 with 2. lagged variables makes .* at most 1,000,000"),
    ],
)
def test_what_gives_no_candidates_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        candidates(**options)


@pytest.mark.parametrize("lags", [1.5, "1", [1.5], [True]])
def test_lags_are_integers(lags):
    with pytest.raises(TypeError, match="input_lags must"):
        candidates(input_lags=lags)


@pytest.mark.parametrize("structure", ["hysteresis", "rate_independent"])
def test_a_structure_that_would_leave_a_model_without_input_is_refused(structure):
    u = np.random.default_rng(0).uniform(-1, 1, (50, 1))
    with pytest.raises(ValueError, match=r"Pass phi=\[Difference\('u'\), DifferenceSign\('u'\)\]"):
        NARXRegressor(1, 1, structure=structure).fit(u, u[:, 0])


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"exclude": ["load"]}, ValueError, r"exclude='load' names \['load'\]; the signals are \['u', 'y'\]"),
        ({"phi": [Difference("drive")]}, ValueError, r"phi\[0\] is a function of \['drive'\]; the signals"),
        ({"phi": Difference("u")}, TypeError, r"phi must be a sequence of phi regressors"),
        ({"phi": ["sign"]}, TypeError, r"phi must hold phi regressors such as Difference\('u'\), got 'sign'"),
        ({"phi": [Difference("u", name="u")]}, ValueError, "The name 'u' is given twice"),
    ],
)
def test_signals_that_are_none_are_told(arguments, error, message):
    u = np.random.default_rng(0).uniform(-1, 1, (50, 1))
    with pytest.raises(error, match=message):
        NARXRegressor(1, 1, **arguments).fit(u, u[:, 0])

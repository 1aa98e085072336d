"""Signals of two values: found by their moments; powers of them are straight lines and no candidates."""

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn import NARXRegressor, NARXRegressorCV
from narx_sklearn.exceptions import ExcitationWarning
from narx_sklearn.identification.one_step.procedure import Problem
from narx_sklearn.identification.records.record import Moments
from narx_sklearn.identification.two_values import two_valued, without_repeated_powers
from narx_sklearn.model import TermLibrary


def moments_of(u):
    return Moments.of(np.zeros((len(u), 0)), np.asarray(u, dtype=float)[:, None])


@given(
    st.floats(-300, 300),
    st.floats(1e-3, 1e3),
    st.lists(st.booleans(), min_size=3, max_size=60).filter(lambda flags: len(set(flags)) == 2),
)
def test_two_levels_are_two_values_whatever_they_are(low, width, flags):
    u = np.where(flags, low + width, low)
    assert two_valued(moments_of(u)).tolist() == [True]


@given(st.integers(2, 2000), st.floats(0.01, 0.99), st.integers(0, 2**16))
def test_one_sample_between_them_is_a_third(n_samples, share, seed):
    u = np.random.default_rng(seed).choice([5.0, 7.0], n_samples)
    assert not two_valued(moments_of(np.r_[5.0, u, 7.0, 5.0 + 2.0 * share]))[0]


def test_one_value_and_none_are_not_two():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert two_valued(moments_of([3.0, 3.0])).tolist() == [False]
        assert two_valued(moments_of([np.nan, np.nan])).tolist() == [False]
        assert two_valued(moments_of([1.0, 2.0])).tolist() == [False]  # two samples are no sign of it


def binary(levels, seed, n_samples=400):
    rng = np.random.default_rng(seed)
    u, y = rng.choice(levels, n_samples), np.zeros(n_samples)
    for k in range(1, n_samples):
        y[k] = 0.8 * y[k - 1] + 0.3 * u[k - 1] + 0.01 * rng.normal()
    return u[:, None], y


@pytest.mark.parametrize("levels", [(-1.0, 1.0), (0.0, 1.0), (40.0, 60.0)])
def test_a_prbs_gives_the_straight_law_and_a_warning(levels):
    for seed in range(3):  # rounding chose u^3, and y u^2 for y, in two of four records
        X, y = binary(levels, seed)
        with pytest.warns(ExcitationWarning, match="u takes only two values in this record"):
            narx = NARXRegressor(2, 2, degree=3).fit(X, y)
        # the constant belongs to the operating point of levels far from zero
        assert [term for term in narx.terms_ if term != "1"] == ["y[k-1]", "u[k-1]"]


def test_a_search_over_degrees_warns_once():
    X, y = binary((-1.0, 1.0), 0)
    with pytest.warns(ExcitationWarning) as told:
        search = NARXRegressorCV((1,), (1,), degree=(2, 3), max_terms=4).fit(X, y)
    assert len(told) == 1
    assert all(v.signal == "y" or e == 1 for t in search.model_.library for v, e in t.factors)


def test_degree_one_and_three_levels_warn_of_nothing():
    X, y = binary((-1.0, 1.0), 0)
    assert NARXRegressor(2, 2, degree=1).fit(X, y).terms_ == ["y[k-1]", "u[k-1]"]
    X, y = binary((-1.0, 0.0, 1.0), 0)
    NARXRegressor(2, 2, degree=3).fit(X, y)


def problem(*terms):
    return Problem(("y",), ("u",), (), TermLibrary(terms))


def moments_of_both():
    return Moments.of(np.array([[1.0], [2.0], [1.0]]), np.array([[0.0], [0.3], [1.0]]))


def test_a_term_stays_where_what_it_repeats_is_no_candidate():
    # u^2 = 3u - 2 needs the constant; y u^2 = 3 y u - 2 y has both
    posed = problem("y[k-1]", "u[k-1]", "u[k-1]^2", "y[k-1]*u[k-1]", "y[k-1]*u[k-1]^2", "y[k-1]^2")
    kept = without_repeated_powers(posed, moments_of_both(), None, warn=False).library
    assert kept.names == ["y[k-1]", "u[k-1]", "y[k-1]^2", "y[k-1]*u[k-1]", "u[k-1]^2"]


def test_what_constraints_name_stays():
    posed = problem("1", "u[k-1]", "u[k-1]^2")
    assert without_repeated_powers(posed, moments_of_both(), "u[k-1]^2 = 0.3") is posed
    with pytest.warns(ExcitationWarning):
        kept = without_repeated_powers(posed, moments_of_both(), "continuum").library
    assert kept.names == ["1", "u[k-1]"]

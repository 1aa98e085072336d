"""Feature selection by error reduction ratio."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.utils.estimator_checks import parametrize_with_checks

from narx_sklearn.exceptions import ExcitationWarning
from narx_sklearn.identification.err_selector import ErrSelector


@parametrize_with_checks([ErrSelector(), ErrSelector(n_terms=2, search="forward", fit_intercept=False)])
def test_scikit_learn_checks(estimator, check):
    check(estimator)


def problem(n_samples=200, noise=0.1, seed=1):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n_samples, 6))
    return X, 3.0 * X[:, 4] - X[:, 0] + 0.5 * X[:, 2] + 7.0 + noise * rng.normal(size=n_samples)


def test_ratios_by_hand():
    """Columns (1,-1,0,0) and (0,0,1,-1), y = 1 times one plus 2 times the other: ERR 2/10 and 8/10."""
    X = np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1]])
    selector = ErrSelector(n_terms=2).fit(X, X @ [1.0, 2.0] + 5.0)
    assert selector.order_.tolist() == [1, 0]
    np.testing.assert_allclose(selector.err_, [0.2, 0.8], atol=1e-15)


def test_the_true_features_are_found_and_ordered():
    X, y = problem()
    selector = ErrSelector().fit(X, y)
    assert selector.order_.tolist() == [4, 0, 2]
    assert selector.get_support(indices=True).tolist() == [0, 2, 4]
    np.testing.assert_array_equal(selector.transform(X), X[:, [0, 2, 4]])


@given(st.integers(1, 6), st.booleans(), st.integers(0, 99))
def test_ratios_add_up_to_the_share_that_is_explained(n_terms, fit_intercept, seed):
    X, y = problem(40, 2.0, seed)
    selector = ErrSelector(n_terms=n_terms, fit_intercept=fit_intercept).fit(X, y)
    chosen = selector.transform(X)
    assert chosen.shape[1] == n_terms
    model = LinearRegression(fit_intercept=fit_intercept).fit(chosen, y)
    level = y.mean() if fit_intercept else 0.0
    share = 1.0 - np.sum((y - model.predict(chosen)) ** 2) / np.sum((y - level) ** 2)
    assert selector.err_.sum() == pytest.approx(share, abs=1e-10)


@pytest.mark.parametrize("unit", [1e-12, 1e12])
def test_units_and_offsets_do_not_change_what_is_selected(unit):
    X, y = problem()
    X, y = X * [1, unit, unit, 1, 1, unit] + [0, 0, 0, 300, 300, 0], unit * y
    assert ErrSelector().fit(X, y).order_.tolist() == [4, 0, 2]


def test_rows_with_nan_are_left_out():
    X, y = problem()
    holed = np.vstack([np.full((3, 6), np.nan), X])
    selector = ErrSelector().fit(holed, np.concatenate([[1e9, 1e9, 1e9], y]))
    np.testing.assert_allclose(selector.err_, ErrSelector().fit(X, y).err_)
    assert selector.transform(holed).shape == (203, 3)


def test_names_of_the_columns_are_kept():
    X, y = problem()
    frame = pd.DataFrame(X, columns=[f"u[k-{i}]" for i in range(1, 7)])
    selector = ErrSelector().set_output(transform="pandas").fit(frame, y)
    assert selector.transform(frame).columns.tolist() == ["u[k-1]", "u[k-3]", "u[k-5]"]


@pytest.mark.parametrize("constant", [1.0, 0.1, 1e9, 0.0])
def test_a_constant_feature_is_left_to_the_intercept(constant):
    X, y = problem()
    X[:, 1] = constant
    assert ErrSelector(n_terms=6).fit(X, y).order_.size == 5
    without = ErrSelector(n_terms=6, fit_intercept=False).fit(X, y)
    assert (1 in without.order_) == (constant != 0.0)


def test_duplicate_features_are_taken_once():
    X, y = problem()
    selector = ErrSelector(n_terms=12).fit(np.hstack([X, X]), y)
    assert sorted(selector.order_ % 6) == [0, 1, 2, 3, 4, 5]


def test_at_least_one_feature_is_kept():
    rng = np.random.default_rng(0)
    assert ErrSelector().fit(rng.normal(size=(50, 4)), rng.normal(size=50)).order_.size == 1


def test_a_constant_target_warns_that_nothing_explains_it():
    X, _ = problem()
    with pytest.warns(ExcitationWarning, match="No feature explains anything of y"):
        selector = ErrSelector().fit(X, np.full(200, 0.1))
    assert not selector.get_support().any()


def test_two_targets_are_refused():
    X, y = problem()
    with pytest.raises(ValueError, match="y should be a 1d array"):
        ErrSelector().fit(X, np.column_stack([y, y]))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"n_terms": 0}, "n_terms must be an integer of at least 1, got 0"),
        ({"max_terms": 2.5}, "max_terms must be an integer of at least 1, got 2.5"),
        ({"criterion": "r2"}, "criterion='r2' is not known; choose one of 'aic'"),
        ({"search": "all"}, "search='all' is not known; choose one of 'forward'"),
    ],
)
def test_wrong_parameters_are_refused(parameters, message):
    with pytest.raises(ValueError, match=message):
        ErrSelector(**parameters).fit(*problem())


def test_too_few_complete_rows_are_refused_with_their_number():
    X, y = problem()
    X[2:] = np.nan
    with pytest.raises(ValueError, match="Of n_samples=200, 2 have no NaN; at least 3 complete samples"):
        ErrSelector().fit(X, y)


def test_a_grid_searches_the_number_of_features():
    X, y = problem()
    search = GridSearchCV(
        make_pipeline(ErrSelector(), LinearRegression()), {"errselector__n_terms": [1, 2, 3]}
    )
    assert search.fit(X, y).best_params_ == {"errselector__n_terms": 3}

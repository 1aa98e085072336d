"""NARXRegressorCV: the same choice as a plain grid search, from one pass over the data."""

import warnings
from itertools import product

import numpy as np
import pandas as pd
import pytest
from sklearn.model_selection import GridSearchCV, KFold, TimeSeriesSplit

from narx_sklearn import NARXRegressor, NARXRegressorCV
from narx_sklearn.datasets import make_piezo_bench
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.model import Difference

pytestmark = pytest.mark.filterwarnings("ignore:The best choice has")  # grids here end at the true lags


def make_record(n_samples, seed=0, noise=0.02):
    """Return input and output of a second-order system with one quadratic term."""
    rng = np.random.default_rng(seed)
    u = rng.uniform(-1, 1, n_samples)
    y = np.zeros(n_samples)
    for k in range(2, n_samples):
        y[k] = 0.6 * y[k - 1] - 0.2 * y[k - 2] + u[k - 1] + 0.5 * u[k - 1] * u[k - 2] + noise * rng.normal()
    return u[:, None], y


@pytest.mark.filterwarnings("ignore:n_terms=")
@pytest.mark.parametrize("seed", range(3))
def test_of_least_squares_it_chooses_what_a_grid_search_chooses(seed):
    X, y = make_record(500, seed)
    folds = TimeSeriesSplit(3)
    ours = NARXRegressorCV([1, 2], [1, 2], degree=[1, 2], max_terms=6, cv=folds, refine=False).fit(X, y)
    grid = {"output_lags": [1, 2], "input_lags": [1, 2], "degree": [1, 2], "n_terms": list(range(1, 7))}

    def pooled(results):
        weight = np.array([y[test].var() for _, test in folds.split(X)])
        scores = np.array([results[f"split{i}_test_score"] for i in range(3)])
        return int(np.argmax(weight @ scores / weight.sum()))

    plain = GridSearchCV(NARXRegressor(refine=False, max_terms=6), grid, cv=folds, refit=pooled).fit(X, y)
    assert plain.best_params_.items() <= ours.best_params_.items()
    for name in ("mean_test_score", "std_test_score"):
        np.testing.assert_allclose(
            ours.cv_results_[name][ours.best_index_], plain.cv_results_[name][plain.best_index_], rtol=1e-6
        )


def test_the_score_of_a_search_is_that_of_all_held_out_errors_together():
    X, y = make_record(400)
    X[300:] *= 0.1  # an input that hardly moves the output, whose own R² is poor
    for k in range(300, 400):
        y[k] = 0.6 * y[k - 1] - 0.2 * y[k - 2] + X[k - 1, 0] + 0.5 * X[k - 1, 0] * X[k - 2, 0]
    y[300:] += 0.05 * np.random.default_rng(1).normal(size=100)
    search = NARXRegressorCV([2], [2], degree=[2], n_terms=[4], cv=4, refine=False).fit(X, y)
    parts = [slice(100 * i, 100 * i + 100) for i in range(4)]
    scatter = np.array([((y[part] - y[part].mean()) ** 2).sum() for part in parts])
    scores = np.array([search.cv_results_[f"split{i}_test_score"][0] for i in range(4)])
    together = 1 - ((1 - scores) * scatter).sum() / scatter.sum()
    np.testing.assert_allclose(search.best_score_, together, rtol=1e-9)
    np.testing.assert_allclose(search.cv_results_["pooled_test_score"], [together], rtol=1e-9)
    assert scores[3] < 0.95 < 0.98 < together


def test_what_is_chosen_was_fitted_to_the_folds_as_it_is_to_the_record():
    X, y = make_record(300)
    y = y + 0.1 * np.random.default_rng(1).normal(size=300)  # noise on the output, which biases least squares
    search = NARXRegressorCV([2], [2], degree=[1, 2], max_terms=6, cv=3, origin="zero").fit(X, y)
    table = pd.DataFrame(search.cv_results_)
    assert table["refined"].tolist() == [False] * 12 + [True] * 4
    assert table.loc[search.best_index_, ["refined", "rank_test_score"]].tolist() == [True, 1]
    assert table.loc[table["refined"], "rank_test_score"].max() == 4
    for _, row in table[table["refined"]].iterrows():
        size = {"n_terms": row["param_n_terms"]} if row["param_n_terms"] else {"criterion": "ebic"}
        plain = NARXRegressor(2, 2, degree=row["param_degree"], max_terms=6, origin="zero", **size)
        for i, (train, test) in enumerate(KFold(3).split(X)):
            score = plain.fit(X[train], y[train], sessions=train > test[0]).score(X[test], y[test])
            np.testing.assert_allclose(row[f"split{i}_test_score"], score, rtol=1e-9)
    assert search.best_estimator_.noise_ == "output"


@pytest.mark.filterwarnings("ignore::narx_sklearn.exceptions.NarxWarning")  # sizes are kept small
def test_a_hysteresis_is_held_out_as_well_as_the_best_of_the_grid():
    train = make_piezo_bench(600, sampling_period=0.05, noise=0.005, random_state=0)
    test = make_piezo_bench(600, sampling_period=0.05, random_state=1)
    grid = {"output_lags": (1, 2), "input_lags": (2,), "degree": (1, 3)}
    search = NARXRegressorCV(**grid, max_terms=10, cv=3).fit(train.X, train.y)
    settings = [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]
    plain = [
        NARXRegressor(**one, max_terms=10).fit(train.X, train.y).score(test.X, test.y) for one in settings
    ]
    assert 1 - search.score(test.X, test.y) < 1.5 * (1 - max(plain))


def test_every_point_of_the_grid_has_the_score_of_a_plain_fit():
    X, y = make_record(400)
    ours = NARXRegressorCV(
        [1, 2],
        [2],
        degree=[2],
        n_terms=[3],
        criterion=["bic"],
        cv=TimeSeriesSplit(2),
        origin="zero",
        refine=False,
    ).fit(X, y)
    table = pd.DataFrame(ours.cv_results_)
    for _, row in table.iterrows():
        size = {"n_terms": row["param_n_terms"]} if row["param_n_terms"] else {"criterion": "bic"}
        plain = NARXRegressor(row["param_output_lags"], 2, degree=2, refine=False, origin="zero", **size)
        for i, (train, test) in enumerate(TimeSeriesSplit(2).split(X)):
            score = plain.fit(X[train], y[train]).score(X[test], y[test])
            np.testing.assert_allclose(row[f"split{i}_test_score"], score, rtol=1e-9)


def test_lags_never_reach_across_the_hole_that_a_fold_leaves():
    X, y = make_record(300, noise=0.0)
    y[100:200] += 5.0  # the middle third is another world; fitted across, its edges would spoil the rest
    search = NARXRegressorCV([2], [2], degree=[2], n_terms=[4], cv=KFold(3), origin="zero").fit(X, y)
    # the first and last fold's training parts hold the odd third; the middle fold's do not
    assert search.cv_results_["split1_test_score"][0] < 0
    clean = NARXRegressor(2, 2, degree=2, n_terms=4, refine=False, origin="zero").fit(
        np.delete(X, np.s_[100:200], axis=0), np.delete(y, np.s_[100:200]), sessions=np.repeat([0, 1], 100)
    )
    np.testing.assert_allclose(clean.coef_, [0.6, -0.2, 1.0, 0.5], atol=1e-9)
    np.testing.assert_allclose(
        search.cv_results_["split1_test_score"][0], clean.score(X[100:200], y[100:200]), rtol=1e-9
    )


def test_phi_regressors_do_not_reach_across_it_either():
    X, y = make_record(300, noise=0.1)
    y[100:200] += 5.0
    task = {"phi": [Difference("y", name="dy")], "phi_lags": 2, "origin": "zero"}
    search = NARXRegressorCV([2], [2], degree=[1], n_terms=[6], cv=KFold(3), **task).fit(X, y)
    rest, sessions = np.delete(np.arange(300), np.s_[100:200]), np.repeat([0, 1], 100)
    plain = NARXRegressor(2, 2, degree=1, n_terms=6, refine=False, **task)
    plain.fit(X[rest], y[rest], sessions=sessions)
    np.testing.assert_allclose(
        search.cv_results_["split1_test_score"][0], plain.score(X[100:200], y[100:200]), rtol=1e-9
    )


@pytest.mark.parametrize("sessions", [None, np.repeat([0, 1], [350, 250])])
def test_parts_of_a_test_fold_are_simulated_one_by_one(sessions):
    rng = np.random.default_rng(0)
    X, y = rng.uniform(-1, 1, (600, 1)), np.zeros(600)
    for k in range(1, 600):
        y[k] = 0.99 * y[k - 1] + X[k - 1, 0]  # an exact model, which remembers where a part begins
    test = np.r_[0:100, 300:400]
    folds = [(np.setdiff1d(np.arange(600), test), test)]
    search = NARXRegressorCV([1], [1], degree=[1], n_terms=[2], cv=folds, refine=False, origin="zero")
    assert search.fit(X, y, sessions).best_score_ == pytest.approx(1.0, abs=1e-9)


@pytest.mark.filterwarnings("ignore:max_terms=")
def test_a_number_of_terms_is_judged_as_it_is_fitted():
    X, y = make_record(400)
    search = NARXRegressorCV([2], [2], degree=[2], n_terms=[8], criterion=["aic"], max_terms=4, cv=2)
    search.fit(X, y)
    counts = search.cv_results_["mean_n_terms"]
    assert counts[0] == 8
    assert counts[1] <= 4
    assert len(search.set_params(criterion=[], refine=False).fit(X, y).best_estimator_.terms_) == 8


def test_numbers_of_terms_that_constraints_rule_out_come_last():
    X, y = make_record(200)
    search = NARXRegressorCV(
        [2], [2], degree=[2], max_terms=4, cv=2, constraints=["y[k-1] = 0.6", "y[k-2] = -0.2"], refine=False
    ).fit(X, y)
    np.testing.assert_array_equal(search.cv_results_["mean_test_score"] == -1e6, [True, False, False, False])
    assert search.cv_results_["mean_n_terms"].tolist() == [1, 2, 3, 4]
    assert search.best_params_["n_terms"] == 4


def test_a_fit_without_names_forgets_those_of_the_fit_before():
    X, y = make_record(100)
    search = NARXRegressorCV([1], [1], degree=[1], cv=2).fit(pd.DataFrame(X, columns=["drive"]), y)
    assert list(search.feature_names_in_) == ["drive"]
    assert not hasattr(search.fit(X, y), "feature_names_in_")


def test_one_standard_error_takes_no_more_terms_than_the_best():
    X, y = make_record(500)
    best = NARXRegressorCV([2], [2], degree=[1, 2], max_terms=8, cv=3).fit(X, y)
    lean = NARXRegressorCV([2], [2], degree=[1, 2], max_terms=8, cv=3, rule="one_standard_error").fit(X, y)
    assert len(lean.best_estimator_.terms_) <= len(best.best_estimator_.terms_)


def test_it_predicts_and_scores_with_the_best_model_and_uses_threads():
    X, y = make_record(500)
    search = NARXRegressorCV([1, 2], [1, 2], degree=[2], max_terms=5, n_jobs=2).fit(X[:400], y[:400])
    assert search.score(X[400:], y[400:]) > 0.95
    np.testing.assert_array_equal(search.predict(X, y_init=y), search.best_estimator_.predict(X, y_init=y))
    assert search.predict_one_step(X, y).shape == search.predict_k_steps(X, y, 3).shape == y.shape


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"rule": "median"}, "'one_standard_error'"),
        ({"n_terms": None}, "Nothing chooses"),
        ({"degree": "3"}, "list of choices"),
        ({"n_terms": "some"}, "'all'"),
        ({"n_terms": [0, 3]}, "n_terms must be an integer of at least 1, got 0"),
        ({"criterion": ["bic", "cic"]}, "criterion='cic'"),
        ({"max_terms": None}, "max_terms must be"),
        ({"race": "never"}, "race=.never. is not known"),
    ],
)
def test_wrong_parameters_are_refused(parameters, message):
    X, y = make_record(100)
    with pytest.raises((ValueError, TypeError), match=message):
        NARXRegressorCV(**parameters).fit(X, y)


def test_an_input_in_long_steps_floods_nobody_with_warnings_of_trials():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(0, 1, 6), 50)  # (u[k-1] - u[k-2]) (u[k-2] - u[k-3]) is always zero
    y = np.zeros(u.size)
    for k in range(1, u.size):
        y[k] = 0.9 * y[k - 1] + 0.1 * u[k - 1] + 0.001 * rng.normal()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        search = NARXRegressorCV([1, 2], [2, 3], degree=[1, 2], cv=3).fit(u[:, None], y)
    assert len(told) <= 1
    assert search.best_score_ > 0.9


@pytest.mark.parametrize("refine", [False, True])
@pytest.mark.parametrize("rule", ["best", "one_standard_error"])
def test_a_race_leaves_out_much_and_changes_nothing_that_is_chosen(rule, refine):
    X, y = make_record(300)
    task = {"degree": [1, 2], "criterion": ["bic"], "max_terms": 5, "cv": 4, "rule": rule, "refine": refine}
    raced, full = (
        NARXRegressorCV([1, 2], [1, 2], **task, race=race, origin="zero").fit(X, y) for race in (True, False)
    )
    assert raced.best_params_ == full.best_params_
    assert raced.best_score_ == pytest.approx(full.best_score_, rel=1e-12)
    table = pd.DataFrame(raced.cv_results_)
    splits = table[[f"split{i}_test_score" for i in range(4)]]
    np.testing.assert_array_equal(table["n_judged_splits"], splits.notna().sum(axis=1))
    out = table["n_judged_splits"] < 4
    assert 0 < out.sum() < len(table)
    assert table.loc[out, ["mean_test_score", "pooled_test_score"]].isna().all(axis=None)
    assert table["mean_n_terms"].notna().all()
    assert sorted(table["rank_test_score"]) == list(range(1, len(table) + 1))
    for _, alike in table.groupby("refined"):  # what was left out ranks behind what was not
        done = alike["n_judged_splits"] == 4
        if not done.all():
            assert alike.loc[done, "rank_test_score"].max() < alike.loc[~done, "rank_test_score"].min()
    whole = ~out & ~table["refined"]
    np.testing.assert_allclose(
        splits[whole], pd.DataFrame(full.cv_results_)[splits.columns][: len(table)][whole]
    )


@pytest.mark.parametrize(("max_terms", "left_out"), [(12, False), (13, True)])
def test_only_grids_of_more_than_a_hundred_choices_are_raced_unasked(max_terms, left_out):
    X, y = make_record(200)
    search = NARXRegressorCV([1, 2], [1, 2], degree=[2, 3], max_terms=max_terms, cv=3, refine=False)
    assert len(search.fit(X, y).cv_results_["n_judged_splits"]) == 8 * max_terms
    assert (search.cv_results_["n_judged_splits"] < 3).any() == left_out


def test_a_choice_at_the_edge_of_the_grid_is_told_where_it_needs_what_it_has():
    rng = np.random.default_rng(0)
    X, y = rng.uniform(-1, 1, (600, 1)), np.zeros(600)
    for k in range(4, 600):
        y[k] = 0.5 * y[k - 1] + X[k - 1, 0] + 0.8 * X[k - 3, 0] + 0.4 * X[k - 4, 0] + 0.02 * rng.normal()
    task = {"degree": [1], "max_terms": 6, "cv": 3, "origin": "zero", "refine": False}
    with pytest.warns(NarxWarning, match=r"has input_lags=3, .* Pass larger values for input_lags as well"):
        NARXRegressorCV([1], [2, 3], **task).fit(X, y)
    for input_lags in ([3, 4, 5], [4], [[1, 3], [1, 4]]):  # inside, nothing to compare with, no edge
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            NARXRegressorCV([1], input_lags, **task).fit(X, y)

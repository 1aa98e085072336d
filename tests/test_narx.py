"""NARXRegressor as a scikit-learn estimator, on known systems, and on what users do wrong."""

import pickle
import time

import numpy as np
import pandas as pd
import pytest
import sklearn
from sklearn.base import clone
from sklearn.compose import TransformedTargetRegressor
from sklearn.exceptions import NotFittedError
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit, cross_validate
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.estimator_checks import parametrize_with_checks

from narx_sklearn import NARXRegressor, NARXRegressorCV
from narx_sklearn.exceptions import DivergenceWarning, ExcitationWarning, NarxWarning, RankWarning
from narx_sklearn.identification.one_step import compression
from narx_sklearn.model import Difference, DifferenceSign, NARXModel, Polynomial, TermLibrary, free_run

NINE_TERMS = NARXModel.from_equations(
    "0.5*y[k-1] - 0.2*y[k-2] + 0.1*y[k-3] + 0.4*u[k-1] + 0.2*u[k-1]*u[k-2] + 0.1*y[k-1]*u[k-3]"
    " - 0.1*y[k-1]^2*u[k-2] + 0.05*u[k-1]^3 - 0.05*y[k-1]^3"
)

SEQUENCE = "a free run reads the samples before: in another order, or in part, the input is another signal"
EXPECTED_FAILURES = {
    "check_methods_sample_order_invariance": SEQUENCE,
    "check_methods_subset_invariance": SEQUENCE,
}


@parametrize_with_checks(
    [NARXRegressor(n_terms=2), NARXRegressorCV([1], [1], degree=[1], max_terms=2, cv=2)],
    expected_failed_checks=lambda estimator: EXPECTED_FAILURES,
)
def test_scikit_learn_checks(estimator, check):
    check(estimator)


def simulate(u, e=None):
    """Return the nine-term system's output with noise in the equation, sample by sample."""
    e = np.zeros(u.size) if e is None else e
    y = np.zeros(u.size)
    for k in range(3, u.size):
        a, b, c = y[k - 1], y[k - 2], y[k - 3]
        v, w, x = u[k - 1], u[k - 2], u[k - 3]
        y[k] = (
            0.5 * a - 0.2 * b + 0.1 * c + 0.4 * v + 0.2 * v * w + 0.1 * a * x
            - 0.1 * a**2 * w + 0.05 * v**3 - 0.05 * a**3 + e[k]
        )  # fmt: skip
    return y


@pytest.fixture(scope="module")
def record():
    rng = np.random.default_rng(0)
    u = rng.uniform(-2, 2, 1500)
    return u[:, None], simulate(u, 0.02 * rng.normal(size=u.size))


# -- truth ------------------------------------------------------------------------------------------------


def test_a_noise_free_system_is_recovered_to_rounding():
    u = np.random.default_rng(1).uniform(-2, 2, 800)
    narx = NARXRegressor(3, 3, degree=3).fit(u[:, None], simulate(u))
    assert narx.terms_ == NINE_TERMS.library.names
    np.testing.assert_allclose(narx.coef_, NINE_TERMS.parameters[:, 0], rtol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_equation_noise_does_not_hide_the_structure(seed):
    rng = np.random.default_rng(seed)
    u = rng.uniform(-2, 2, 2000)
    narx = NARXRegressor(3, 3, degree=3).fit(u[:, None], simulate(u, 0.05 * rng.normal(size=u.size)))
    assert narx.terms_ == NINE_TERMS.library.names
    assert narx.noise_ == "equation"


def test_output_noise_is_told_from_equation_noise_and_does_not_bias():
    rng = np.random.default_rng(0)
    u = rng.uniform(-2, 2, 2000)
    narx = NARXRegressor(3, 3, degree=3).fit(u[:, None], simulate(u) + 0.05 * rng.normal(size=u.size))
    assert narx.noise_ == "output"
    assert narx.terms_ == NINE_TERMS.library.names
    plain = NARXRegressor(3, 3, degree=3, refine=False).fit(
        u[:, None], simulate(u) + 0.05 * rng.normal(size=u.size)
    )
    v = rng.uniform(-2, 2, 500)
    truth = simulate(v)
    ours, theirs = (np.std(m.predict(v[:, None], y_init=truth[:3]) - truth) for m in (narx, plain))
    assert ours < theirs


@pytest.mark.parametrize("scale", [1e-12, 1e-3, 1e12])
def test_units_do_not_change_what_is_selected(record, scale):
    X, y = record
    reference = NARXRegressor(3, 3, degree=3).fit(X, y)
    scaled = NARXRegressor(3, 3, degree=3).fit(X * scale, y / scale)
    assert scaled.terms_ == reference.terms_
    np.testing.assert_allclose(scaled.predict(X * scale) * scale, reference.predict(X), rtol=1e-6, atol=1e-9)


def test_an_offset_does_not_change_what_is_selected(record):
    X, y = record
    near = NARXRegressor(3, 3, degree=3, origin="mean").fit(X, y)
    far = NARXRegressor(3, 3, degree=3, origin="mean").fit(0.012 + 4e-3 * X, 300.0 + 5.0 * y)
    assert far.terms_ == near.terms_
    np.testing.assert_allclose((far.predict(0.012 + 4e-3 * X) - 300.0) / 5.0, near.predict(X), atol=1e-8)


def test_a_given_operating_point_recovers_the_structure_in_physical_units():
    rng = np.random.default_rng(3)
    u = rng.uniform(-2, 2, 2000)
    y = simulate(u, 0.05 * rng.normal(size=u.size))
    frame = pd.DataFrame({"current [A]": 0.012 + 4e-3 * u})
    narx = NARXRegressor(3, 3, degree=3, origin={"temperature": 300.0, "current": 0.012})
    narx.fit(frame, pd.Series(300.0 + 5.0 * y, name="temperature [K]"))
    renamed = [t.replace("temperature", "y").replace("current", "u") for t in narx.terms_]
    assert TermLibrary(renamed) == NINE_TERMS.library
    assert dict(narx.model_.units) == {"temperature": "K", "current": "A"}


def test_the_current_input_is_found_with_delay_zero():
    rng = np.random.default_rng(0)
    u = rng.normal(size=600)
    y = np.zeros(600)
    for k in range(1, 600):
        y[k] = 0.5 * y[k - 1] + u[k] + 0.01 * rng.normal()
    narx = NARXRegressor(1, 1, delay=0, degree=2).fit(u[:, None], y)
    assert narx.terms_ == ["y[k-1]", "u[k]"]


def test_several_outputs_are_identified_together():
    rng = np.random.default_rng(0)
    u = rng.uniform(-1, 1, size=(800, 2))
    y = np.zeros((800, 2))
    for k in range(1, 800):
        y[k, 0] = 0.5 * y[k - 1, 0] + 0.2 * y[k - 1, 1] + u[k - 1, 0]
        y[k, 1] = 0.3 * y[k - 1, 1] + u[k - 1, 1] ** 2
    y += 0.001 * rng.normal(size=y.shape)
    narx = NARXRegressor(1, 1, degree=2, refine=False).fit(u, y)
    assert [str(t) for t in narx.model_.equations["y1"].library] == ["y1[k-1]", "y2[k-1]", "u1[k-1]"]
    assert [str(t) for t in narx.model_.equations["y2"].library] == ["y2[k-1]", "u2[k-1]^2"]
    assert narx.predict(u, y_init=y[:1]).shape == (800, 2)
    assert narx.score(u, y) > 0.999


def test_phi_regressors_are_candidates_like_signals():
    u = np.sin(0.05 * np.arange(600)) + 0.3 * np.sin(0.31 * np.arange(600))
    model = NARXModel.from_equations(
        "0.9*y[k-1] + 0.5*phi1[k-1] + 0.1*phi2[k-1]", phi=[Difference("u"), DifferenceSign("u")]
    )
    y = free_run(model, u[:, None], y_init=[0.0, 0.0]).y[:, 0]
    narx = NARXRegressor(1, 1, phi=[Difference("u"), DifferenceSign("u")], degree=1)
    with pytest.warns(NarxWarning, match="does not stay where its input stops"):  # it falls to zero
        narx.fit(u[:, None], y)
    assert narx.terms_ == ["y[k-1]", "phi1[k-1]", "phi2[k-1]"]


# -- constraints, estimators, refinement ------------------------------------------------------------------


@pytest.mark.parametrize("estimator", ["ls", "ridge", "els", "rls"])
@pytest.mark.parametrize("refine", [False, True])
def test_constraints_hold_to_rounding(record, estimator, refine):
    X, y = record
    narx = NARXRegressor(
        3, 3, degree=2, constraints="y[k-1] + y[k-2] + y[k-3] = 0.3", estimator=estimator, refine=refine
    ).fit(X, y)
    total = sum(c for t, c in zip(narx.terms_, narx.coef_, strict=True) if t.count("*") == 0 and t[0] == "y"
                and "^" not in t)  # fmt: skip
    assert abs(total - 0.3) < 1e-12


@pytest.mark.filterwarnings("ignore:max_terms=")
@pytest.mark.parametrize("search", ["exchange", "forward"])
@pytest.mark.parametrize(
    ("constraints", "holds"),
    [
        (None, True),
        ("y[k-1] + y[k-2] = 0.3", True),
        (["u[k-4]*y[k-3]^2 = 0", "u[k-1]^2*u[k-4] + 2*y[k-4]^3 = 0"], True),
        ("y[k-1] + y[k-2] = 0.45", False),
    ],
    ids=["none", "true", "of terms that do nothing", "false, so that substitutes are needed"],
)
def test_a_screened_library_gives_the_model_of_all_its_columns(
    record, monkeypatch, constraints, holds, search
):
    """165 candidates, with screening from 100 on: what a constraint names must outlive it."""
    monkeypatch.setattr(compression, "SCREENING_CANDIDATES", 100)
    task = {"degree": 3, "constraints": constraints, "search": search, "refine": False, "max_terms": 12}
    screened = NARXRegressor(4, 4, **task).fit(*record)
    assert len(screened.candidates_) < 60
    assert screened.path_.n_considered == 165
    parameters = dict(zip(screened.terms_, screened.coef_, strict=True))
    for text in np.atleast_1d([] if constraints is None else constraints):
        left, right = text.split("=")
        total = sum(value * parameters.get(str(term), 0.0) for term, value in Polynomial.parse(left).items)
        assert total == pytest.approx(float(right), abs=1e-12)
    monkeypatch.setattr(compression, "SCREENING_CANDIDATES", 10_000)
    monkeypatch.setattr(compression, "FORWARD_CANDIDATES", 10_000)
    whole = NARXRegressor(4, 4, **task).fit(*record)
    assert len(whole.candidates_) == 165
    # without lags that screening left out there are a few more samples
    assert screened.path_.rss[-1] < 1.1 * whole.path_.rss[-1]
    if holds and search == "exchange":
        assert screened.terms_ == whole.terms_
        np.testing.assert_allclose(screened.coef_, whole.coef_, rtol=0.05, atol=1e-3)


def test_contradictory_constraints_are_refused(record):
    with pytest.raises(ValueError, match="contradict"):
        NARXRegressor(2, 2, constraints=["y[k-1] = 1", "y[k-1] = 2"]).fit(*record)


@pytest.mark.parametrize("estimator", ["els", "rls"])
def test_other_estimators_fit_the_chosen_terms(record, estimator):
    X, y = record
    narx = NARXRegressor(3, 3, degree=3, estimator=estimator, refine=False).fit(X, y)
    assert narx.score(X, y) > 0.99


def test_refinement_never_ends_worse(record):
    X, y = record
    narx = NARXRegressor(2, 2, degree=2, refine=True).fit(X, y)
    assert narx.refinement_.loss <= narx.refinement_.loss_before


@pytest.mark.parametrize(("given", "meant"), [(0, False), (np.False_, False), (1, True), (np.True_, True)])
def test_refine_means_what_it_equals(record, given, meant):
    X, y = record
    ours, plain = (NARXRegressor(2, 2, refine=value).fit(X[:300], y[:300]) for value in (given, meant))
    assert (ours.refinement_ is None) == (plain.refinement_ is None) == (not meant)
    assert ours.noise_ == plain.noise_
    np.testing.assert_array_equal(ours.coef_, plain.coef_)


@pytest.mark.parametrize("search", ["forward", "iterated"])
def test_every_search_returns_a_model_of_the_wanted_size(record, search):
    narx = NARXRegressor(2, 2, degree=2, search=search, n_terms=5, refine=False).fit(*record)
    assert len(narx.terms_) == 5


def test_the_size_may_be_chosen_by_free_run(record):
    X, y = record
    assert (
        NARXRegressor(3, 3, degree=3, size="free_run", criterion="aic", max_terms=14).fit(X, y).score(X, y)
        > 0.99
    )


def test_intervals_hold_the_truth_and_the_summary_lists_them(record):
    X, y = record
    narx = NARXRegressor(3, 3, degree=3).fit(X, y)
    low, high = narx.confidence_intervals(0.999).T
    truth = NINE_TERMS.parameters[:, 0]
    assert ((low <= truth) & (truth <= high)).all()
    table = narx.summary()
    assert list(table.columns) == ["output", "term", "parameter", "low", "high", "err"]
    assert table["err"].is_monotonic_decreasing


def test_err_adds_up_to_the_explained_share(record):
    X, y = record
    narx = NARXRegressor(3, 3, degree=3, refine=False, origin="zero").fit(X, y)
    residual = (y - narx.predict_one_step(X, y))[3:]
    np.testing.assert_allclose(narx.err_.sum(), 1 - residual @ residual / (y[3:] @ y[3:]), rtol=1e-10)


# -- data: sessions, gaps, batches, kinds of arrays -------------------------------------------------------


def test_sessions_are_fitted_as_separate_recordings(record):
    X, y = record
    sessions = np.repeat([0, 1, 2], 500)
    whole = NARXRegressor(3, 3, degree=3, refine=False).fit(X, y, sessions=sessions)
    shuffled = np.r_[1000:1500, 0:500, 500:1000]
    moved = NARXRegressor(3, 3, degree=3, refine=False).fit(X[shuffled], y[shuffled], sessions=sessions)
    assert moved.terms_ == whole.terms_
    np.testing.assert_allclose(moved.coef_, whole.coef_, rtol=1e-9)
    prediction = whole.predict(X, y_init=y, sessions=sessions)
    np.testing.assert_array_equal(prediction[500:503], y[500:503])


def test_gaps_are_left_out_and_come_back_as_nan(record):
    X, y = record[0].copy(), record[1].copy()
    y[200:210] = np.nan
    X[700:705] = np.nan
    narx = NARXRegressor(3, 3, degree=3).fit(X, y)
    assert narx.terms_ == NINE_TERMS.library.names
    prediction = narx.predict(X)
    assert np.isnan(prediction[700:705]).all()
    assert np.isfinite(np.delete(prediction, np.s_[700:705])).all()


def test_what_a_mask_hides_is_a_gap_and_no_value(record):
    X, y = record[0].copy(), record[1].copy()
    hidden_X, hidden_y = np.zeros(X.shape, bool), np.zeros(y.shape, bool)
    hidden_X[700:705], hidden_y[200:210] = True, True
    X[hidden_X], y[hidden_y] = 1e20, -9999.0  # as netCDF files and loggers fill
    masked = np.ma.masked_array(X, hidden_X), np.ma.masked_array(y, hidden_y)
    as_nan = np.where(hidden_X, np.nan, X), np.where(hidden_y, np.nan, y)
    narx, other = (NARXRegressor(3, 3, degree=3).fit(*data) for data in (masked, as_nan))
    assert narx.model_ == other.model_
    np.testing.assert_array_equal(narx.predict(masked[0]), other.predict(as_nan[0]))
    assert narx.score(*masked) == other.score(*as_nan)


FOUR = ["y[k-1] = 0.6", "y[k-2] = -0.2", "u[k-1] = 1", "u[k-2] = 0.5"]


def test_sizes_that_constraints_rule_out_are_not_tried(record):
    X, y = record
    narx = NARXRegressor(2, 2, constraints=FOUR, size="free_run", max_terms=6, refine=False).fit(X, y)
    assert {"y[k-1]", "y[k-2]", "u[k-1]", "u[k-2]"} <= set(narx.terms_)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"n_terms": 2}, "no set of 2 terms satisfies the constraints"),
        ({"max_terms": 3}, "constraints need 4 terms, but at most 3"),
    ],
)
def test_constraints_on_more_terms_than_allowed_are_refused(record, parameters, message):
    with pytest.raises(ValueError, match=message):
        NARXRegressor(2, 2, constraints=FOUR, refine=False, **parameters).fit(*record)


def test_batches_give_the_model_of_the_whole(record):
    X, y = record
    batches = NARXRegressor(3, 3, degree=3, origin="zero")
    for part in (slice(0, 700), slice(700, 1500)):
        batches.partial_fit(X[part], y[part])
    whole = NARXRegressor(3, 3, degree=3, origin="zero", refine=False).fit(
        X, y, sessions=np.repeat([0, 1], [700, 800])
    )
    assert batches.terms_ == whole.terms_
    np.testing.assert_allclose(batches.coef_, whole.coef_, rtol=1e-9)
    for narx in (batches, whole):
        for name, signal in (("u", X[:, 0]), ("y", y)):
            least, mean, most = narx.model_.recorded[name]
            assert (least, most) == (signal.min(), signal.max())
            assert mean == pytest.approx(signal.mean(), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    "convert",
    [
        lambda a: a.astype(np.float32),
        lambda a: np.asfortranarray(np.column_stack([a, a]))[:, 0],
        lambda a: np.repeat(a, 2)[::2],
        lambda a: (a.setflags(write=False), a)[1],
        list,
    ],
    ids=["float32", "column of a matrix", "strided", "read-only", "list"],
)
def test_kinds_of_arrays_give_the_same_model(record, convert):
    u, y = record[0][:, 0].copy(), record[1].copy()
    X = np.asarray(convert(u)).reshape(-1, 1)
    narx = NARXRegressor(3, 3, degree=3, refine=False).fit(X, convert(y))
    assert narx.terms_ == NINE_TERMS.library.names


def test_integers_are_taken_as_numbers():
    rng = np.random.default_rng(0)
    u = rng.integers(-5, 6, 400)
    y = np.zeros(400, dtype=int)
    for k in range(1, 400):
        y[k] = y[k - 1] // 2 + u[k - 1]
    assert "u[k-1]" in NARXRegressor(1, 1).fit(u[:, None], y).terms_


# -- scikit-learn's company -------------------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:max_terms=")
def test_it_works_in_pipelines_target_transformers_and_grids(record):
    X, y = record
    pipeline = make_pipeline(StandardScaler(), NARXRegressor(2, 2, refine=False))
    grid = GridSearchCV(
        pipeline,
        {"narxregressor__output_lags": [1, 3], "narxregressor__degree": [1, 3],
         "narxregressor__structure": [None, lambda term: term.degree != 2]},
        cv=TimeSeriesSplit(2),
    ).fit(X, y)  # fmt: skip
    assert grid.best_params_["narxregressor__degree"] == 3
    target = TransformedTargetRegressor(NARXRegressor(2, 2, refine=False), transformer=StandardScaler())
    assert target.fit(X, y).predict(X).shape == y.shape
    scores = cross_validate(
        NARXRegressor(3, 3, degree=3, refine=False), X, y, cv=TimeSeriesSplit(2), n_jobs=2
    )
    assert (scores["test_score"] > 0.9).all()


def test_sessions_are_routed_through_a_search(record):
    X, y = record
    sessions = np.repeat(np.arange(15), 100)
    with sklearn.config_context(enable_metadata_routing=True):
        narx = NARXRegressor(1, 1).set_fit_request(sessions=True).set_score_request(sessions=True)
        grid = GridSearchCV(narx, {"degree": [1, 3]}, cv=TimeSeriesSplit(2)).fit(X, y, sessions=sessions)
    assert grid.best_params_ == {"degree": 3}


def test_clone_and_pickle_keep_everything(record):
    X, y = record
    narx = NARXRegressor(3, 3, degree=2, phi=[Difference("u")], constraints="y[k-1] = 0.5").fit(X, y)
    again = pickle.loads(pickle.dumps(narx))
    np.testing.assert_array_equal(again.predict(X), narx.predict(X))
    assert again.model_ == narx.model_
    assert clone(narx).get_params()["constraints"] == "y[k-1] = 0.5"
    assert "NARXRegressor" in narx._repr_html_()


# -- prediction -------------------------------------------------------------------------------------------


def test_one_step_and_k_steps_agree_with_the_free_run_where_they_must(record):
    X, y = record
    narx = NARXRegressor(3, 3, degree=3).fit(X, y)
    np.testing.assert_allclose(narx.predict_k_steps(X, y, 1), narx.predict_one_step(X, y))
    run = narx.predict(X[:13], y_init=y[:3])
    np.testing.assert_allclose(narx.predict_k_steps(X[:13], y[:13], 10)[12], run[12])


def test_score_starts_from_the_first_outputs_and_judges_the_rest(record):
    X, y = record
    narx = NARXRegressor(3, 3, degree=3).fit(X, y)
    lag = narx.model_.max_lag
    simulated = narx.predict(X, y_init=y)
    expected = 1 - np.sum((y - simulated)[lag:] ** 2) / np.sum((y[lag:] - y[lag:].mean()) ** 2)
    np.testing.assert_allclose(narx.score(X, y), expected)


def test_a_divergent_free_run_scores_low_but_finite():
    u = np.random.default_rng(0).normal(size=(60, 1))
    y = np.cumprod(np.full(60, 1.3)) + u[:, 0]
    narx = NARXRegressor(1, 1, degree=3, n_terms=3, refine=False).fit(u, y)
    assert np.isfinite(narx.score(u, y))


# -- traps that others fell into --------------------------------------------------------------------------


def test_the_criterion_is_taken_at_its_minimum_not_at_its_first_rise(record):
    narx = NARXRegressor(3, 3, degree=3, criterion="aic", max_terms=14, refine=False, origin="zero").fit(
        *record
    )
    values = narx.path_.criterion("aic")
    assert len(narx.terms_) == int(np.argmin(values))


def test_a_refit_keeps_nothing_of_the_last_fit(record):
    X, y = record
    narx = NARXRegressor(3, 3, degree=3)
    first = narx.fit(X, y).terms_
    narx.fit(X, 0.5 * np.roll(X[:, 0], 1))
    assert narx.terms_ == ["u[k-1]"]
    assert narx.fit(X, y).terms_ == first


def test_no_output_column_is_ignored(record):
    X, y = record
    both = np.column_stack([y, np.roll(X[:, 0], 1)])
    narx = NARXRegressor(3, 3, degree=1, refine=False).fit(X, both)
    assert narx.model_.outputs == ("y1", "y2")
    assert narx.predict(X).shape == both.shape


def test_the_free_run_lets_other_threads_work():
    from threading import Thread

    model = NARXModel.from_equations("0.9*y[k-1] + 0.1*u[k-1]")
    u = np.ones((3_000_000, 1))
    free_run(model, u[:10], y_init=[0.0])
    ticks = []
    worker = Thread(target=free_run, args=(model, u), kwargs={"y_init": [0.0]})
    worker.start()
    while worker.is_alive():
        ticks.append(time.perf_counter())
        time.sleep(0.0005)
    assert len(ticks) >= 3  # a run that held the interpreter would have let none through


# -- bad input --------------------------------------------------------------------------------------------


def test_fewer_samples_than_lags_are_refused_with_the_number():
    with pytest.raises(ValueError, match="at least 8 samples"):
        NARXRegressor(5, 5).fit([[1.0], [2.0], [4.0], [3.0]], [1.0, 2.0, 3.0, 5.0])


def test_a_constant_input_warns():
    y = np.random.default_rng(0).normal(size=100)
    with pytest.warns(ExcitationWarning, match="u is constant"):
        NARXRegressor(1, 1).fit(np.full((100, 1), 2.0), y)


def test_duplicate_inputs_are_said_to_be_collinear(record):
    X, y = record
    narx = NARXRegressor(1, 1, degree=1, refine=False).fit(np.hstack([X, X]), y)
    assert narx.path_.collinear


def test_rank_loss_of_fixed_terms_warns():
    from narx_sklearn.identification import Factor, least_squares

    p = np.arange(10.0)
    with pytest.warns(RankWarning, match="rank 1 of 2"):
        least_squares(Factor.of(np.column_stack([p, p]), p))


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"criterion": "best"}, "choose one of 'aic'"),
        ({"search": "greedy"}, "'floating'"),
        ({"estimator": "svm"}, "'ls'"),
        ({"size": "big"}, "'free_run'"),
        ({"origin": "median"}, "'auto'"),
        ({"origin": {"pressure": 1.0}}, "neither outputs nor inputs"),
        ({"degree": 0}, "degree must be"),
        ({"degree": 1.5}, "degree must be"),
        ({"max_terms": 0}, "max_terms must be"),
        ({"n_terms": -1}, "n_terms must be"),
        ({"delay": -1}, "delay must be"),
        ({"output_lags": [0]}, "shortest lag allowed here is 1"),
        ({"input_lags": [-1]}, "shortest lag allowed here is 0"),
        ({"structure": "spiral"}, "structure='spiral'"),
        ({"constraints": "y[k-9] = 1"}, "not among the"),
        ({"constraints": "y[k-1] + 1"}, "write it like"),
        ({"constraints": (np.ones((1, 2)), [1.0])}, "must be"),
        ({"refine": "maybe"}, "refine must be"),
        ({"origin": None}, "origin must be"),
        ({"alpha": np.inf}, "alpha must be"),
        ({"alpha": -1.0}, "alpha must be"),
        ({"exclude": ["y[k-1]"]}, "term cluster"),
    ],
)
def test_wrong_parameters_are_refused_with_what_is_wanted(record, parameters, message):
    with pytest.raises((ValueError, TypeError), match=message):
        NARXRegressor(**parameters).fit(*record)


@pytest.mark.parametrize("none", [0, [], (), np.array([], dtype=int)])
def test_a_model_without_inputs_needs_no_column(none):
    y = 0.9 ** np.arange(50) + 1e-3 * np.random.default_rng(0).normal(size=50)
    X = np.empty((50, 0))
    narx = NARXRegressor(1, none, degree=1, n_terms=1, refine=False, origin="zero").fit(X, y)
    assert narx.terms_ == ["y[k-1]"]
    assert narx.predict(X, y_init=y[:1]).shape == (50,)


def test_wrong_data_are_refused_with_what_came(record):
    X, y = record
    narx = NARXRegressor(3, 3).fit(pd.DataFrame({"drive [V]": X[:, 0]}), y)
    with pytest.raises(ValueError, match="feature names"):
        narx.predict(pd.DataFrame({"voltage [V]": X[:, 0]}))
    with pytest.raises(ValueError, match="y_init has 1 samples, but the model needs the last 3"):
        narx.predict(pd.DataFrame({"drive [V]": X[:, 0]}), y_init=y[:1])
    with pytest.raises(ValueError, match="inconsistent numbers of samples"):
        NARXRegressor().fit(X, y[:-1])
    with pytest.raises(ValueError, match="sessions must hold one label"):
        NARXRegressor().fit(X, y, sessions=np.zeros((X.shape[0], 2)))
    with pytest.raises(ValueError, match="infinity"):
        NARXRegressor().fit(np.where(X > 1.99, np.inf, X), y)
    with pytest.raises(ValueError, match="same signal name"):
        NARXRegressor().fit(pd.DataFrame({"a b": X[:, 0], "a_b": X[:, 0]}), y)


@pytest.mark.parametrize(
    "step", ["choosing.scaled_layout", "narx.build_model", "free_run.free_run_fit.select_on_simulation"]
)
def test_an_interrupted_fit_leaves_the_estimator_unfitted(record, monkeypatch, step):
    """Ctrl-C raises KeyboardInterrupt wherever the fit is; also a second fit must not leave the first."""
    X, y = record
    narx = NARXRegressor(2, 2).fit(X, y)

    def interrupt(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(f"narx_sklearn.identification.{step}", interrupt)
    with pytest.raises(KeyboardInterrupt):
        narx.fit(X, y)
    with pytest.raises(NotFittedError):
        narx.predict(X)


@pytest.mark.parametrize(
    ("n_samples", "lags", "message"),
    [
        (9, 9, "Of n_samples = 9 none can be used: the longest lag is 9, so at least 12 samples in a row"),
        (3, 1, "Of n_samples = 3 only 2 can be used: the longest lag is 1, so at least 4 samples in a row"),
        (12, 10, "Of n_samples = 12 only 2 can be used: the longest lag is 10, so at least 13 samples in a"),
    ],
)
def test_records_too_short_for_any_model_are_refused_with_the_length_wanted(n_samples, lags, message):
    u = np.random.default_rng(0).uniform(-1, 1, (n_samples, 1))
    with pytest.raises(ValueError, match=message):
        NARXRegressor(lags, lags, degree=3).fit(u, u[:, 0])


def short_record(n_samples, seed):
    rng = np.random.default_rng(seed)
    u = rng.normal(size=(n_samples, 1))
    y = np.zeros(n_samples)
    for k in range(1, n_samples):
        y[k] = 0.5 * y[k - 1] + u[k - 1, 0] + 0.3 * u[k - 1, 0] ** 2
    return u, y + 0.02 * rng.normal(size=n_samples)


@pytest.mark.filterwarnings("ignore::narx_sklearn.exceptions.ExcitationWarning")
def test_of_a_short_record_no_model_is_made_that_fits_anything():
    judged = short_record(500, seed=100)
    scores = []
    for seed in range(5):
        narx = NARXRegressor(2, 2, degree=3).fit(*short_record(20, seed))
        assert len(narx.terms_) <= 9  # 17 terms of 18 usable samples without
        scores.append(narx.score(*judged))
    assert min(scores) > 0.99  # -1e6 in each without


def test_a_model_as_large_as_its_record_allows_to_compare_is_warned_of():
    told = r"The model of y has 4 terms from 8 usable samples: the record is too short .* \(40 usable samples"
    with pytest.warns(ExcitationWarning, match=told):
        NARXRegressor(2, 2, degree=3).fit(*short_record(10, seed=1))
    with pytest.warns(ExcitationWarning, match="7 terms from 8 usable samples"):
        NARXRegressor(2, 2, degree=3, n_terms=7).fit(*short_record(10, seed=1))
    NARXRegressor(1, 1, degree=1).fit(*short_record(10, seed=1))  # three candidates of nine samples


@pytest.mark.parametrize("call", ["predict", "predict_one_step", "predict_k_steps", "score"])
def test_missing_inputs_are_refused_with_those_wanted(call):
    u, y = short_record(50, seed=0)
    narx = NARXRegressor(n_terms=2).fit(u, y)
    others = {"predict": (), "predict_k_steps": (y, 2)}.get(call, (y,))
    with pytest.raises(
        ValueError, match=r"X is None, but the model has the inputs \['u'\]: .* \(n_samples, 1\)"
    ):
        getattr(narx, call)(None, *others)
    with pytest.raises(ValueError, match=r"X is None, .* X=np\.empty\(\(n_samples, 0\)\)"):
        NARXRegressor().fit(None, y)


@pytest.mark.parametrize(("size", "word"), [(1e-150, "small"), (1e150, "large"), (1e200, "large")])
@pytest.mark.parametrize("estimator", [NARXRegressor(), NARXRegressorCV([1], [1], degree=[2])])
def test_values_whose_products_are_no_numbers_are_refused_by_name(estimator, size, word):
    u, y = short_record(100, seed=0)
    with pytest.raises(
        ValueError, match=f"u holds values of up to .* too {word} to square: .* Choose a unit"
    ):
        clone(estimator).fit(size * u, y)
    with pytest.raises(ValueError, match=f"y holds values of up to .* too {word} to square"):
        clone(estimator).fit(u, size * y)


@pytest.mark.parametrize("size", [1e-70, 1e70])
def test_large_and_small_units_change_nothing_but_the_units(size):
    u, y = short_record(100, seed=0)
    plain, other = NARXRegressor().fit(u, y), NARXRegressor().fit(size * u, size * y)
    assert other.terms_ == plain.terms_
    assert other.score(size * u, size * y) == pytest.approx(plain.score(u, y), abs=1e-9)


# -- free runs that go off ---------------------------------------------------------------------------------


def growing(n_samples):
    """Return a record of y[k] = 1.05 y[k-1] + u[k-1], of which a long free run goes off and stays finite."""
    u = np.random.default_rng(0).uniform(-1, 1, n_samples)
    y = np.zeros(n_samples)
    for k in range(1, n_samples):
        y[k] = 1.05 * y[k - 1] + u[k - 1]
    return u[:, None], y


@pytest.fixture(scope="module")
def half_way():
    """Return a model that is exact, y[k] = 0.5 y[k-1] + u[k-1], of outputs between -2 and 2."""
    u = np.repeat([1.0, -1.0, 0.5, -0.25, 0.0], 40)
    y = np.zeros(u.size)
    for k in range(1, u.size):
        y[k] = 0.5 * y[k - 1] + u[k - 1]
    narx = NARXRegressor(1, 1, degree=1, n_terms=2, fit_intercept=False, origin="zero", refine=False)
    return narx.fit(u[:, None], y)


def test_a_free_run_half_a_span_beyond_what_was_fitted_is_told_with_the_input_that_drives_it(half_way):
    X = np.r_[np.full(30, 0.9), np.full(10, 3.0)][:, None]  # nine outputs of forty rise from 1.8 to 6
    low, _, high = half_way.model_.recorded["y"]
    assert high - low == pytest.approx(4.0, abs=1e-6)
    message = r"goes to 5.99 at sample 39, .* on -2 to 2: .* 0\.23 of the samples .* So do the inputs 'u'"
    with pytest.warns(ExcitationWarning, match=message) as told:
        half_way.predict(X, y_init=[1.8])
    assert len(told) == 1


def test_a_free_run_that_goes_there_by_itself_is_told_so(half_way):
    with pytest.warns(ExcitationWarning, match="goes to 4.5 at sample 0, .* The inputs do not: "):
        half_way.predict(np.zeros((50, 1)), y_init=[4.5])


@pytest.mark.parametrize("size", [1.0, 1.4, 1.9])  # the middle is 0 and the span 4: told from 2 on
def test_a_free_run_less_than_half_a_span_beyond_what_was_fitted_is_ordinary(half_way, size):
    y = half_way.predict(np.full((60, 1), size), y_init=[0.0])  # a warning would be an error
    assert y[-1] == pytest.approx(2 * size)


def test_a_free_run_a_thousand_times_beyond_what_was_fitted_is_warned_of():
    X, y = growing(400)
    narx = NARXRegressor(1, 1, degree=1, fit_intercept=False, origin="zero").fit(X[:60], y[:60])
    low, _, high = narx.model_.recorded[narx.model_.outputs[0]]
    assert (low, high) == (y[:60].min(), y[:60].max())
    first = int(np.argmax(np.abs(y - (low + high) / 2) > 1000 * (high - low)))  # the model is exact
    assert first > 60
    with pytest.warns(DivergenceWarning, match=rf"run of 'y' goes to .* at sample {first}, .* refine=True"):
        simulated = narx.predict(X, y_init=y)
    assert np.isfinite(simulated).all()
    with pytest.warns(ExcitationWarning, match="The inputs do not") as told:  # far beyond, but not lost
        simulated = narx.predict(X[:first], y_init=y)
    assert len(told) == 1
    np.testing.assert_allclose(simulated, y[:first], rtol=1e-6)


@pytest.mark.parametrize("y_init", [[np.nan], [np.nan, 1.0, 2.0]], ids=["short", "as long as X"])
def test_initial_outputs_that_are_nan_are_told(record, y_init):
    u, y = record
    narx = NARXRegressor(1, 1, degree=1, refine=False).fit(u, y)
    with pytest.warns(NarxWarning, match=r"y_init lacks a value among the 1 samples .* steady state\."):
        started = narx.predict(u[:3], y_init=y_init)
    np.testing.assert_array_equal(started, narx.predict(u[:3]))  # as documented, and without a warning


def test_the_range_of_the_outputs_is_that_of_all_batches():
    X, y = growing(60)
    narx = NARXRegressor(1, 1, degree=1, origin="zero", refine=False)
    for piece in (slice(0, 30), slice(30, 60)):
        narx.partial_fit(X[piece], y[piece])
    low, _, high = narx.model_.recorded[narx.model_.outputs[0]]
    assert (low, high) == (y.min(), y.max())


def test_of_an_output_that_stood_still_its_size_is_the_measure():
    y = np.full(50, 2.0)
    X = np.random.default_rng(0).uniform(-1, 1, (50, 1))
    with pytest.warns(ExcitationWarning):
        narx = NARXRegressor(1, 1, degree=1, origin="zero", refine=False).fit(X, y)
    low, _, high = narx.model_.recorded[narx.model_.outputs[0]]
    assert low == high == 2.0
    narx.predict(X)


def test_more_terms_than_there_are_candidates_are_told(record):
    with pytest.warns(
        NarxWarning, match=r"n_terms=50 for y, but there are 3 candidates; the model has 3"
    ) as told:
        NARXRegressor(1, 1, degree=1, n_terms=50).fit(*record)
    assert told[0].filename == __file__
    doubled = np.column_stack([record[0], record[0]])
    with pytest.warns(NarxWarning, match=r"but 3 of 4 candidates can be told apart"):
        NARXRegressor(1, 1, degree=1, n_terms=4, refine=False).fit(doubled, record[1])


def test_a_limit_that_bounds_the_size_is_told(record):
    with pytest.warns(NarxWarning, match=r"max_terms=2 bound the size of the model of y") as told:
        NARXRegressor(3, 3, degree=3, max_terms=2, refine=False).fit(*record)
    assert told[0].filename == __file__
    NARXRegressor(1, 0, degree=1, max_terms=2, refine=False, fit_intercept=True).fit(
        *record
    )  # there are no more


def test_a_limit_that_nobody_set_bounds_as_the_default_does_and_is_told_nobody():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(3000, 1))
    weights = 1.0 / np.arange(1, 26)  # all of them matter
    y = np.convolve(X[:, 0], np.append(0.0, weights))[:3000]
    about = {"output_lags": 0, "input_lags": 25, "degree": 1, "refine": False}
    with pytest.warns(NarxWarning, match="max_terms=20 bound the size of the model of y"):
        told = NARXRegressor(**about).fit(X, y)
    narx = NARXRegressor(**about, max_terms=None).fit(X, y)
    assert len(narx.terms_) == 20
    assert narx.terms_ == told.terms_
    with pytest.raises(ValueError, match="max_terms must be an integer of at least 1, got 0"):
        NARXRegressor(max_terms=0).fit(X, y)


def test_the_same_phi_twice_is_refused(record):
    phi = (Difference("u"), Difference("u"))
    with pytest.raises(ValueError, match=r"phi\[1\] is phi\[0\] again, u\[k\] - u\[k-1\].*Leave one out"):
        NARXRegressor(1, 1, phi=phi).fit(*record)
    named = (Difference("u"), Difference("u", name="rate"))
    with pytest.raises(ValueError, match=r"phi\[1\] is phi\[0\] again"):
        NARXRegressor(1, 1, phi=named).fit(*record)

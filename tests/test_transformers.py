"""Transformers: names, lags inside sessions and out of gaps, phi, terms, pipelines."""

import numpy as np
import pandas as pd
import pytest
import sklearn
from hypothesis import given
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler
from sklearn.utils.estimator_checks import parametrize_with_checks

from narx_sklearn.identification.err_selector import ErrSelector
from narx_sklearn.identification.transformers import LagTransformer, PhiTransformer, TermTransformer
from narx_sklearn.model import Difference, DifferenceSign, Play, Term

SEQUENCE = "a row holds earlier samples: in another order, or in part, the signal is another one"
EXPECTED_FAILURES = {
    "check_methods_sample_order_invariance": SEQUENCE,
    "check_methods_subset_invariance": SEQUENCE,
}


@parametrize_with_checks(
    [LagTransformer(), LagTransformer(2, fill="hold"), TermTransformer(), PhiTransformer()],
    expected_failed_checks=lambda e: {} if isinstance(e, PhiTransformer) else EXPECTED_FAILURES,
)
def test_scikit_learn_checks(estimator, check):
    check(estimator)


def system(n_samples=600, noise=0.0, seed=0):
    """Return y[k] = 0.5 y[k-1] - 0.2 y[k-2] u[k-1] + u[k-1] + 0.3 u[k-2]^2 as a frame of signals."""
    rng = np.random.default_rng(seed)
    u, y = rng.normal(size=n_samples), np.zeros(n_samples)
    for k in range(2, n_samples):
        y[k] = 0.5 * y[k - 1] - 0.2 * y[k - 2] * u[k - 1] + u[k - 1] + 0.3 * u[k - 2] ** 2
        y[k] += noise * rng.normal()
    return pd.DataFrame({"y": y, "u": u})


def table(transformer, X, **arguments):
    return transformer.set_output(transform="pandas").fit_transform(X, **arguments)


# -- lags -------------------------------------------------------------------------------------------------


def test_lags_by_hand():
    frame = pd.DataFrame({"y": [1.0, 2.0, 3.0], "u": [4.0, 5.0, 6.0]}, index=[10, 11, 12])
    lagged = table(LagTransformer({"y": 1, "u": [0, 2]}), frame)
    expected = pd.DataFrame(
        {"y[k-1]": [np.nan, 1, 2], "u[k]": [4.0, 5, 6], "u[k-2]": [np.nan, np.nan, 4]}, index=[10, 11, 12]
    )
    pd.testing.assert_frame_equal(lagged, expected)


def test_held_lags_by_hand():
    lagged = LagTransformer(2, fill="hold").fit_transform([[4.0], [5.0], [6.0]], sessions=["a", "a", "b"])
    np.testing.assert_array_equal(lagged, [[4, 4], [4, 4], [6, 6]])


@given(
    st.integers(1, 12), st.lists(st.integers(0, 5), min_size=1, max_size=4), st.integers(0, 99), st.booleans()
)
def test_lags_are_those_of_every_sample_in_its_session(n_samples, lags, seed, hold):
    rng = np.random.default_rng(seed)
    X, sessions = rng.normal(size=(n_samples, 2)), np.sort(rng.integers(0, 3, n_samples))
    X[rng.random(X.shape) < 0.1] = np.nan
    lags = sorted(set(lags))
    lagged = LagTransformer([lags, []], fill="hold" if hold else "nan").fit_transform(X, sessions=sessions)
    for k in range(n_samples):
        start = int(np.argmax(sessions == sessions[k]))
        for column, lag in enumerate(lags):
            inside = k - lag >= start
            expected = X[k - lag, 0] if inside else X[start, 0] if hold else np.nan
            np.testing.assert_equal(lagged[k, column], expected)


def test_columns_name_signals_and_leave_units_to_the_labels():
    lagged = LagTransformer().fit(pd.DataFrame({"drive [V]": [0.0], "2nd coil": [0.0]}))
    assert lagged.get_feature_names_out().tolist() == ["drive[k-1]", "u_2nd_coil[k-1]"]
    assert LagTransformer().fit([[0.0]]).get_feature_names_out().tolist() == ["u[k-1]"]
    assert LagTransformer().fit([[0.0, 1.0]]).get_feature_names_out().tolist() == ["u1[k-1]", "u2[k-1]"]


def test_input_names_are_checked():
    lagged = LagTransformer().fit(pd.DataFrame({"y": [0.0], "u": [0.0]}))
    with pytest.raises(ValueError, match="input_features is not equal to feature_names_in_"):
        lagged.get_feature_names_out(["u", "y"])
    with pytest.raises(ValueError, match=r"equal to number of features \(2\), got 3"):
        LagTransformer().fit([[0.0, 1.0]]).get_feature_names_out(["a", "b", "c"])


@pytest.mark.parametrize(
    ("transformer", "message"),
    [
        (LagTransformer(fill="drop"), "fill='drop' is not known; choose one of 'nan', 'hold'"),
        (LagTransformer([-1]), "lags holds the lag -1; the shortest lag allowed here is 0"),
        (LagTransformer(1, delay=2), "lags=1 ends before the shortest lag allowed, 2"),
        (LagTransformer({"v": 1}), r"lags names \['v'\]; the signals here are \['y', 'u'\]"),
        (TermTransformer(["v[k-1]"]), r"terms use the signals \['v'\]; X \(n_features=2\) and phi hold"),
        (TermTransformer(["u[k+1]"]), r"terms read the future, u\[k\+1\]; shift the target instead"),
        (TermTransformer([]), "terms is empty"),
        (TermTransformer(phi=[Difference("v")]), r"phi\[0\] is a function of \['v'\]; the signals here"),
        (TermTransformer(phi=[Difference("u", name="y")]), "The name 'y' is given twice"),
        (PhiTransformer(keep_signals=False), "There is nothing to compute"),
    ],
)
def test_wrong_parameters_are_refused_with_what_is_wanted(transformer, message):
    with pytest.raises(ValueError, match=message):
        transformer.fit(pd.DataFrame({"y": [0.0, 1.0], "u": [0.0, 1.0]}))


def test_kinds_of_parameters_are_checked():
    with pytest.raises(TypeError, match=r"terms must be a list of terms, got the text 'u\[k-1\]'"):
        TermTransformer("u[k-1]").fit([[0.0]])
    with pytest.raises(TypeError, match="phi must hold phi regressors such as"):
        PhiTransformer(["sign(u)"]).fit([[0.0]])


def test_sessions_need_one_label_a_sample():
    with pytest.raises(ValueError, match=r"one label a sample, shape \(2,\), got shape \(3,\)"):
        LagTransformer().fit([[0.0]]).transform([[0.0], [1.0]], sessions=[0, 0, 1])


def test_infinities_are_refused():
    with pytest.raises(ValueError, match="infinity"):
        LagTransformer().fit([[0.0], [np.inf]])


# -- terms and phi ----------------------------------------------------------------------------------------


@given(st.integers(3, 30), st.integers(0, 99))
def test_terms_are_products_of_lags(n_samples, seed):
    frame = pd.DataFrame(np.random.default_rng(seed).normal(size=(n_samples, 2)), columns=["y", "u"])
    terms = table(TermTransformer(lags=2, degree=3, include_constant=True), frame)
    lags = table(LagTransformer(2), frame)
    for name in terms:
        product = np.ones(n_samples)
        for variable, exponent in Term.parse(name).factors:
            product = product * lags[str(variable)].to_numpy() ** exponent
        np.testing.assert_allclose(terms[name], product, rtol=1e-14)


def test_terms_stand_in_canonical_order_once_each():
    frame = pd.DataFrame({"y": [1.0], "u": [1.0]})
    terms = TermTransformer(["u[k-1]*y[k-1]", "u[k-1]", Term.parse("y[k-1]*u[k-1]"), "1"]).fit(frame)
    assert terms.get_feature_names_out().tolist() == ["1", "u[k-1]", "y[k-1]*u[k-1]"]


def test_excluded_clusters_are_no_columns():
    frame = pd.DataFrame({"y": [1.0], "u": [1.0]})
    terms = TermTransformer(lags={"y": 2, "u": 1}, exclude=["y^2", "u"]).fit(frame)
    assert terms.get_feature_names_out().tolist() == [
        "y[k-1]", "y[k-2]", "y[k-1]*u[k-1]", "y[k-2]*u[k-1]", "u[k-1]^2",
    ]  # fmt: skip


def test_terms_of_phi_regressors_by_hand():
    frame = pd.DataFrame({"u": [0.0, 2.0, 3.0, 1.0]})
    both = ["phi1[k]", "u[k-1]*phi1[k-1]"]
    nan = TermTransformer(both, phi=[DifferenceSign("u")]).fit_transform(frame)
    np.testing.assert_array_equal(nan, [[np.nan, np.nan], [1, np.nan], [1, 2], [-1, 3]])
    held = TermTransformer(both, phi=[DifferenceSign("u")], fill="hold").fit_transform(frame)
    np.testing.assert_array_equal(held, [[0, 0], [1, 0], [1, 2], [-1, 3]])


def test_phi_stand_behind_the_signals_under_their_labels():
    frame = pd.DataFrame({"drive [V]": [0.0, 3.0, 2.0], "y": [1.0, 1.0, 1.0]})
    phi = [Play("drive", 1.0), Difference("y", name="dy")]
    out = table(PhiTransformer(phi, fill="hold"), frame)
    assert out.columns.tolist() == ["drive [V]", "y", "phi1", "dy"]
    np.testing.assert_array_equal(out["phi1"], Play("drive", 1.0).run([0.0, 3.0, 2.0]))
    alone = table(PhiTransformer(phi, keep_signals=False), frame)
    np.testing.assert_array_equal(alone["dy"], [np.nan, 0.0, 0.0])


def test_phi_begin_anew_in_each_session_and_after_a_gap():
    X = np.array([[0.0], [3.0], [9.0], [8.0], [np.nan], [5.0], [6.0]])
    phi = PhiTransformer([Difference("u")], keep_signals=False, fill="hold")
    values = phi.fit_transform(X, sessions=[0, 0, 1, 1, 1, 1, 1])[:, 0]
    np.testing.assert_array_equal(values, [0, 3, 0, -1, np.nan, np.nan, 1])


def test_phi_then_lags_are_terms_of_phi():
    frame = system(20)
    in_steps = make_pipeline(PhiTransformer([DifferenceSign("u")]), LagTransformer(2))
    at_once = TermTransformer(lags=2, phi=[DifferenceSign("u")], phi_lags=2, degree=1)
    pd.testing.assert_frame_equal(table(in_steps, frame), table(at_once, frame))


# -- in pipelines -----------------------------------------------------------------------------------------


def test_a_model_is_composed_of_ordinary_parts():
    """Lags, products, selection by ERR and least squares find the system's four terms."""
    frame = system(noise=0.01)
    model = make_pipeline(
        LagTransformer(2, fill="hold"), PolynomialFeatures(2), ErrSelector(), LinearRegression()
    ).set_output(transform="pandas")
    model.fit(frame, frame["y"])
    names = [str(Term.parse(name)) for name in model[:-1].get_feature_names_out()]
    found = dict(zip(names, model[-1].coef_, strict=True))
    truth = {"y[k-1]": 0.5, "u[k-1]": 1.0, "y[k-2]*u[k-1]": -0.2, "u[k-2]^2": 0.3}
    assert found == pytest.approx(truth, abs=0.01)


def test_rows_without_history_can_be_dropped_with_their_targets():
    frame = system()
    terms = table(TermTransformer(lags=2), frame).dropna()
    assert len(terms) == len(frame) - 2
    selector = ErrSelector(n_terms=4).set_output(transform="pandas")
    chosen = selector.fit_transform(terms, frame["y"].loc[terms.index])
    model = LinearRegression().fit(chosen, frame["y"].loc[terms.index])
    np.testing.assert_allclose(model.predict(chosen), frame["y"].loc[terms.index], atol=1e-12)


def test_a_grid_searches_lags_and_degree():
    frame = system(noise=0.01)
    model = make_pipeline(TermTransformer(fill="hold"), ErrSelector(), LinearRegression())
    grid = {"termtransformer__lags": [1, 2], "termtransformer__degree": [1, 2]}
    search = GridSearchCV(model, grid, cv=TimeSeriesSplit(3)).fit(frame, frame["y"])
    assert search.best_params_ == {"termtransformer__lags": 2, "termtransformer__degree": 2}
    assert search.best_score_ > 0.99


def test_sessions_are_routed_through_a_pipeline():
    frame = system(40)
    sessions = np.repeat([0, 1], 20)
    direct = LagTransformer(2, fill="hold").fit_transform(
        StandardScaler().fit_transform(frame), sessions=sessions
    )
    with sklearn.config_context(enable_metadata_routing=True):
        lags = LagTransformer(2, fill="hold").set_transform_request(sessions=True)
        model = make_pipeline(StandardScaler(), lags, LinearRegression())
        model.fit(frame, frame["y"], sessions=sessions)
        np.testing.assert_array_equal(model[:-1].transform(frame, sessions=sessions), direct)
        expected = LinearRegression().fit(direct, frame["y"]).predict(direct)
        np.testing.assert_allclose(model.predict(frame, sessions=sessions), expected)


@pytest.mark.parametrize(
    "convert", [np.float32, np.asfortranarray, lambda X: X[::2][:, ::-1], lambda X: X.astype(int)]
)
def test_every_form_of_an_array_is_taken_and_left_alone(convert):
    X = convert(np.round(100 * np.random.default_rng(0).normal(size=(20, 2))))
    before = X.copy()
    X.flags.writeable = False
    lagged = LagTransformer(fill="hold").fit_transform(X)
    assert lagged.dtype == np.float64
    np.testing.assert_array_equal(lagged[1:], X[:-1])
    np.testing.assert_array_equal(X, before)


def test_clones_are_equal_and_unfitted():
    transformer = TermTransformer(lags=2, phi=[Difference("u")], exclude=["y^2"]).fit(system(10))
    copy = clone(transformer)
    assert not hasattr(copy, "library_")
    assert copy.fit(system(10)).library_ == transformer.library_


@pytest.mark.parametrize("second", [LagTransformer(), TermTransformer()])
def test_lagged_columns_are_not_lagged_again(second):
    signals = pd.DataFrame({"u": [1.0, 2.0, 3.0]})
    chain = make_pipeline(LagTransformer(1).set_output(transform="pandas"), second)
    with pytest.raises(ValueError, match=r"columns \['u\[k-1\]'\], which are lagged already"):
        chain.fit(signals)

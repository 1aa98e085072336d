"""constraints="continuum": Lemma 4.1 written out, kept by every estimator of parameters, and checked."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from narx_sklearn import NARXRegressor
from narx_sklearn.analysis import continuum_of_steady_states
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.identification.structure.hysteresis import (
    check_continuum,
    expand_continuum,
    rate_independent_structure,
    resting_dynamics,
)
from narx_sklearn.model import (
    Difference,
    DifferenceSign,
    NARXModel,
    Play,
    SmoothSign,
    TermLibrary,
    free_run,
)
from narx_sklearn.physics import PIEZO_BENCH
from narx_sklearn.signals import prfs

PHI = (Difference("u", name="phi1"), DifferenceSign("u", name="phi2"))


def bench(n_samples=4000, seed=0):
    u = prfs(n_samples, 1.0, 0.001, amplitudes=80.0, random_state=seed)
    return u[:, None], PIEZO_BENCH.run(u)


def piezo_regressor(**options):
    return NARXRegressor(
        **{"phi": PHI, "degree": 3, "structure": "hysteresis", "constraints": "continuum", "n_terms": 6}
        | options
    )


def test_the_word_is_lemma_4_1_in_its_general_form():
    library = TermLibrary(["y[k-1]", "y[k-3]", "y[k-1]*phi1[k-1]", "phi1[k-1]*phi2[k-1]"])
    expanded = expand_continuum("continuum", library, ["y"], ["u"], PHI)
    assert expanded == ["y[k-1] + y[k-3] = 1"]
    beside = expand_continuum(["continuum", "y[k-1] = 0.9"], library, ["y"], ["u"], PHI)
    assert beside == ["y[k-1] + y[k-3] = 1", "y[k-1] = 0.9"]


def test_each_of_several_outputs_may_rest_anywhere():
    library = TermLibrary(["x[k-1]", "x[k-2]", "y[k-1]", "phi1[k-1]"])
    expanded = expand_continuum("continuum", library, ["x", "y"], ["u"], PHI)
    assert expanded == {
        "x": ["x[k-1] + x[k-2] = 1", "y[k-1] = 0"],
        "y": ["y[k-1] = 1", "x[k-1] + x[k-2] = 0"],
    }
    only_one = expand_continuum({"x": "continuum", "y": "y[k-1] = 0.5"}, library, ["x", "y"], ["u"], PHI)
    assert only_one == {"x": ["x[k-1] + x[k-2] = 1", "y[k-1] = 0"], "y": "y[k-1] = 0.5"}


@pytest.mark.parametrize("given_constraints", [None, "y[k-1] = 1", (np.ones((1, 2)), np.ones(1)), []])
def test_other_constraints_pass_unchanged_and_nothing_is_checked(given_constraints):
    library = TermLibrary(["y[k-1]", "u[k-1]"])
    assert expand_continuum(given_constraints, library, ["y"], ["u"], ()) is given_constraints
    assert check_continuum(NARXModel.from_equations("0.5*y[k-1]"), given_constraints) is None


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        (["y[k-1]", "u[k-1]", "phi1[k-1]"], r"1 of 3 are not: u\[k-1\]. Use structure='hysteresis'"),
        (["1", "y[k-1]", "y[k-1]*u[k-1]"], r"2 of 3 are not: 1, y\[k-1\]\*u\[k-1\]"),
        (["phi1[k-1]", "y[k-1]*phi1[k-1]"], "needs a linear output among the candidates, but 'y' has none"),
        (
            ["y[k-1]", "p[k-1]"],
            r"not: p\[k-1\].*a phi with memory, which holds its value, cannot stand alone",
        ),
    ],
)
def test_candidates_that_break_the_lemma_are_refused(terms, message):
    phi = (*PHI, Play("u", 1.0, name="p"))
    with pytest.raises(ValueError, match=message):
        expand_continuum("continuum", TermLibrary(terms), ["y"], ["u"], phi)


@pytest.mark.parametrize("options", [{"refine": False}, {"refine": True}, {}])
def test_a_fitted_model_meets_the_lemma_to_rounding(options):
    X, y = bench()
    narx = piezo_regressor(**options).fit(X, y)
    assert abs(narx.continuum_.output_sums[0, 0] - 1.0) < 1e-12
    assert narx.continuum_.holds
    assert continuum_of_steady_states(narx.model_).exists


def test_two_output_lags_share_the_sum():
    true = NARXModel.from_equations("1.3*y[k-1] - 0.3*y[k-2] + 0.8*phi1[k-1] + 0.1*u[k-1]*phi1[k-1]", phi=PHI)
    X, _ = bench(1000)
    y = free_run(true, X, np.zeros(2)).y[:, 0]
    narx = piezo_regressor(output_lags=2, n_terms=None).fit(X, y)
    assert narx.terms_ == true.library.names
    assert abs(narx.continuum_.output_sums[0, 0] - 1.0) < 1e-12
    assert abs(narx.continuum_.other_radius - 0.3) < 1e-6


def test_the_word_and_the_equation_give_one_model():
    X, y = bench()
    assert piezo_regressor().fit(X, y).model_ == piezo_regressor(constraints="y[k-1] = 1").fit(X, y).model_


def test_partial_fit_keeps_the_lemma():
    X, y = bench()
    narx = piezo_regressor().partial_fit(X[:2000], y[:2000]).partial_fit(X[2000:], y[2000:])
    assert narx.continuum_.holds


def test_without_the_word_nothing_is_reported():
    X, y = bench(1000)
    assert piezo_regressor(constraints=None).fit(X, y).continuum_ is None


def test_without_the_structure_the_candidates_are_refused():
    X, y = bench(1000)
    with pytest.raises(ValueError, match="needs candidates that are zero at rest"):
        piezo_regressor(structure=None).fit(X, y)


def test_an_eigenvalue_outside_the_unit_circle_is_a_warning_with_its_modulus():
    # y[k] = -0.5 y[k-1] + 1.5 y[k-2]: (z - 1)(z + 1.5), by hand
    model = NARXModel.from_equations("-0.5*y[k-1] + 1.5*y[k-2] + 0.1*phi1[k-1]", phi=PHI)
    with pytest.warns(
        NarxWarning, match=r"besides the eigenvalue 1 the largest has modulus 1\.5, which must"
    ):
        rest = check_continuum(model, "continuum")
    assert not rest.holds
    assert_allclose(rest.eigenvalues, [1.0, -1.5])


def test_of_a_continuum_that_is_not_there_only_what_fails_is_told():
    outside = NARXModel.from_equations("-0.5*y[k-1] + 1.5*y[k-2] + 0.1*phi1[k-1]", phi=PHI)
    off_sum = NARXModel.from_equations("0.9*y[k-1] + 0.1*phi1[k-1]", phi=PHI)
    both = NARXModel.from_equations("-0.5*y[k-1] + 1.6*y[k-2] + 0.1*phi1[k-1]", phi=PHI)
    for model, sums, modulus in ((outside, False, True), (off_sum, True, False), (both, True, True)):
        with pytest.warns(NarxWarning, match="no stable continuum") as told:
            check_continuum(model, "continuum")
        message = str(told[0].message)
        assert ("miss their sum" in message) == sums
        assert ("has modulus" in message) == modulus


def test_a_sum_that_is_not_one_is_a_warning_with_the_gap():
    model = NARXModel.from_equations("0.9*y[k-1] + 0.1*phi1[k-1]", phi=PHI)
    with pytest.warns(NarxWarning, match=r"miss their sum by 0\.1,"):
        assert not check_continuum(model, "continuum").holds


@given(st.lists(st.floats(-0.8, 0.8), min_size=1, max_size=3), st.integers(0, 2**32 - 1))
def test_a_model_whose_other_roots_are_inside_stays_where_it_has_come_to_rest(roots, seed):
    # (z - 1) prod(z - root): the coefficients sum to 1 whatever the roots
    coefficients = -np.poly([1.0, *roots])[1:]
    terms = {f"y[k-{lag}]": c for lag, c in enumerate(coefficients, start=1)} | {"phi1[k-1]": 0.5}
    model = NARXModel.from_equations(terms, phi=PHI)
    rest = resting_dynamics(model)
    assert rest.holds
    assert_allclose(
        rest.other_radius, np.abs(roots).max(), atol=1e-4
    )  # clustered roots are known to 1e-16^(1/3)
    moved = np.random.default_rng(seed).normal(size=30)
    u = np.concatenate([moved, np.full(400, moved[-1])])
    y = free_run(model, u[:, None], np.zeros((model.max_lag, 1))).y[:, 0]
    assert np.ptp(y[-100:]) < 1e-9


def test_differences_of_the_output_count_among_the_eigenvalues():
    # y[k] = y[k-1] + 0.4 (y[k-1] - y[k-2]): (z - 1)(z - 0.4)
    model = NARXModel.from_equations("y[k-1] + 0.4*dy[k-1]", phi=[Difference("y", name="dy")])
    assert_allclose(resting_dynamics(model).eigenvalues, [1.0, 0.4], atol=1e-12)


def test_smooth_signs_of_the_output_count_among_the_eigenvalues():
    # near rest 0.1 tanh(dy / 0.05) is 2 dy: (z - 1)(z - 2), and a touch of the input sets it off
    phi = [SmoothSign("y", width=0.05, name="sign"), Difference("u", name="phi1")]
    model = NARXModel.from_equations("y[k-1] + 0.1*sign[k-1] + phi1[k-1]", phi=phi)
    rest = resting_dynamics(model)
    assert_allclose(rest.eigenvalues, [1.0, 2.0], atol=1e-12)
    assert not rest.holds
    touched = np.repeat([0.0, 1e-3], [5, 200])[:, None]
    assert np.ptp(free_run(model, touched, np.zeros((2, 1))).y[-100:]) > 1.0


def test_one_of_two_outputs_may_have_the_continuum():
    model = NARXModel.from_equations({"x": "x[k-1] + 0.3*phi1[k-1]", "y": "0.5*y[k-1] + x[k-1]"}, phi=PHI)
    rest = check_continuum(model, {"x": "continuum", "y": None})
    assert rest.n_free == 1
    assert rest.holds
    assert_allclose(rest.eigenvalues, [1.0, 0.5])


def test_the_rate_independent_structure_keeps_terms_with_exactly_one_difference():
    library = TermLibrary.polynomial(["y[k-1]", "u[k]", "phi1[k]", "phi2[k]"], degree=3)
    kept = library.filter(rate_independent_structure(["y"], ["u"], PHI))
    # phi1 alone, times one of {y, u, phi2}, times one of their six products without phi2^2; and y itself
    assert len(kept) == 1 + 3 + 5 + 1
    assert "y[k-1]^2*phi1[k]" in kept.names
    assert not {"phi1[k]^2", "phi1[k]*phi2[k]^2", "phi2[k]", "y[k-1]^2", "1"} & set(kept.names)


@given(st.integers(0, 2**32 - 1), st.integers(2, 6))
def test_a_rate_independent_model_hardly_depends_on_the_rate(seed, slower):
    rng = np.random.default_rng(seed)
    phi = (Difference("u", name="phi1"), DifferenceSign("u", name="phi2"))
    terms = {"y[k-1]": 1.0, "phi1[k]": 0.7, "u[k]*phi1[k]*phi2[k]": 0.05, "y[k-1]*phi1[k]*phi2[k]": -0.1}
    model = NARXModel.from_equations(terms, phi=phi)
    corners = rng.uniform(-2, 2, size=6)
    runs = []
    for samples in (400, 400 * slower):
        u = np.interp(np.arange(5 * samples + 1) / samples, np.arange(6), corners)
        runs.append(free_run(model, u[:, None], np.zeros(1)).y[::samples, 0])
    assert_allclose(runs[0], runs[1], atol=0.01)  # one step of Euler's method: 0.4 / 400 of the slopes

"""Free-run refinement: derivatives, descent, constraints, sessions, gaps, outputs, bad starts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.exceptions import DivergenceWarning, NarxWarning
from narx_sklearn.identification import LinearConstraints, NARXRegressor, refine_free_run
from narx_sklearn.identification.free_run.refinement import _Runs
from narx_sklearn.model import Difference, NARXModel, Play, free_run

TRUTH = NARXModel.from_equations("1.2*y[k-1] - 0.4*y[k-2] + 0.5*u[k-1] + 0.2*u[k-1]*y[k-1] - 0.1*y[k-1]^3")
TWO_OUTPUTS = NARXModel.from_equations(
    {
        "y1": "0.6*y1[k-1] + 0.3*y2[k-1] + 0.5*u[k-1]",
        "y2": "0.5*y2[k-1] - 0.2*y1[k-1]^2 + 0.4*u[k-2]",
    },
    outputs=("y1", "y2"),
)


def measured(model, n_samples=400, noise=0.0, seed=0, sessions=None):
    """Return inputs and the free run of a model started at rest, with noise on the output."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1, 1, (n_samples, len(model.inputs)))
    y = free_run(model, X, sessions=sessions).y
    return X, y + noise * rng.normal(size=y.shape)


def perturbed(model, size=0.05, seed=1):
    factors = 1.0 + size * np.random.default_rng(seed).uniform(-1, 1, model.parameters.shape)
    return model.with_parameters(model.parameters * factors)


@given(st.sampled_from([TRUTH, TWO_OUTPUTS]), st.integers(0, 99), st.booleans(), st.sampled_from([None, 15]))
def test_gradient_is_that_of_finite_differences(model, seed, with_gaps, horizon):
    X, y = measured(model, 60, noise=0.1, seed=seed)
    if with_gaps:
        y[20:23] = np.nan
        X[40] = np.nan
    weights = np.ones(y.shape[1])
    runs = _Runs(perturbed(model, seed=seed), X, y, None, horizon, weights)
    theta = runs.program.coefficients.copy()
    loss, gram, gradient = runs.linearise(theta)
    assert loss == pytest.approx(runs.loss(theta), rel=1e-12)
    np.testing.assert_array_equal(gram, gram.T)
    for i in range(theta.size):
        step = np.zeros_like(theta)
        step[i] = 1e-6
        slope = (runs.loss(theta + step) - runs.loss(theta - step)) / 2e-6
        # J'r is minus half the slope of r'r
        assert gradient[i] == pytest.approx(-0.5 * slope, rel=1e-5, abs=1e-6 * max(loss, 1.0))


def test_a_noise_free_record_gives_the_parameters_to_rounding():
    X, y = measured(TRUTH)
    fit = refine_free_run(perturbed(TRUTH), X, y)
    np.testing.assert_allclose(fit.model.parameters, TRUTH.parameters, atol=1e-9)
    assert fit.converged
    assert fit.loss <= max(fit.rounding, 1e-18 * fit.loss_before)
    assert fit.n_samples == 400 - TRUTH.max_lag


def test_noise_on_the_output_does_not_bias_it():
    """Twenty records: least squares would shrink y[k-1]'s parameter by far more than this mean error."""
    errors = []
    for seed in range(20):
        X, y = measured(TRUTH, 300, noise=0.1, seed=seed)
        errors.append(refine_free_run(TRUTH, X, y).model.parameters[:, 0] - TRUTH.parameters[:, 0])
    mean, error = np.mean(errors, axis=0), np.std(errors, axis=0) / np.sqrt(20)
    assert np.all(np.abs(mean) < 4 * error)


@given(st.integers(0, 30), st.floats(0.0, 0.6), st.sampled_from([(None,), (10, None), (5, 50)]))
def test_the_result_is_never_worse_than_the_start(seed, size, horizons):
    X, y = measured(TRUTH, 120, noise=0.2, seed=seed)
    fit = refine_free_run(perturbed(TRUTH, size, seed), X, y, horizons=horizons, max_iter=8)
    assert fit.loss <= fit.loss_before
    again = refine_free_run(fit.model, X, y, max_iter=0)
    assert again.loss == pytest.approx(fit.loss, rel=1e-9)


def test_zero_steps_only_measure_the_loss():
    X, y = measured(TRUTH, 100, noise=0.1)
    fit = refine_free_run(TRUTH, X, y, max_iter=0)
    simulated = free_run(TRUTH, X, y).y
    assert fit.loss == fit.loss_before == pytest.approx(np.sum((y - simulated)[TRUTH.max_lag :] ** 2))
    assert fit.model.parameters.tolist() == TRUTH.parameters.tolist()
    assert fit.n_iterations == 0


def test_constraints_hold_to_rounding():
    model = NARXModel.from_equations("0.5*y[k-1] + 0.3*y[k-2] + 0.2*u[k-1] + 0.1*u[k-2]*y[k-1]")
    X, y = measured(model, 300, noise=0.05)
    names = model.library.names
    row = np.zeros((1, len(names)))
    row[0, [names.index("y[k-1]"), names.index("y[k-2]"), names.index("u[k-1]")]] = 1.0
    start = model.with_parameters(
        model.parameters + np.where(row.T > 0, [[0.02], [-0.05], [0.03], [0.0]], 0.0)
    )
    constraints = LinearConstraints(row, row @ start.parameters[:, 0])
    fit = refine_free_run(start, X, y, constraints=constraints)
    assert fit.loss < fit.loss_before
    np.testing.assert_allclose(row @ fit.model.parameters[:, 0], constraints.c, atol=1e-12)
    free = refine_free_run(start, X, y)
    assert free.loss <= fit.loss


def test_sessions_are_simulated_from_their_own_starts():
    sessions = np.repeat(["a", "b", "c"], [100, 150, 50])
    X, y = measured(TRUTH, 300, sessions=sessions)
    together = refine_free_run(perturbed(TRUTH), X, y, sessions=sessions)
    np.testing.assert_allclose(together.model.parameters, TRUTH.parameters, atol=1e-9)
    assert together.n_samples == 300 - 3 * TRUTH.max_lag


def test_gaps_are_left_out_of_the_sum():
    X, y = measured(TRUTH, 300)
    y[50:60] = np.nan  # the simulation runs through what was not measured
    X[200] = np.nan  # and begins anew after a missing input
    fit = refine_free_run(perturbed(TRUTH), X, y)
    np.testing.assert_allclose(fit.model.parameters, TRUTH.parameters, atol=1e-8)
    assert fit.n_samples == 300 - 10 - 1 - 2 * TRUTH.max_lag


def test_several_outputs_are_fitted_together_whatever_their_units():
    X, y = measured(TWO_OUTPUTS, 300)
    fit = refine_free_run(perturbed(TWO_OUTPUTS), X, y)
    np.testing.assert_allclose(fit.model.parameters, TWO_OUTPUTS.parameters, atol=1e-8)


@pytest.mark.parametrize(
    "phi", [Difference("u", name="phi1"), Difference("y", name="phi1"), Play("u", 0.3, name="phi1")]
)
def test_phi_regressors_are_simulated_with_their_derivatives(phi):
    model = NARXModel.from_equations("0.7*y[k-1] + 0.4*u[k-1] + 0.2*phi1[k-1]", phi=(phi,))
    X, y = measured(model, 200)
    fit = refine_free_run(perturbed(model), X, y)
    np.testing.assert_allclose(fit.model.parameters, model.parameters, atol=1e-8)


def test_short_stretches_bring_an_unstable_start_within_reach():
    model = NARXModel.from_equations("0.95*y[k-1] + 0.5*u[k-1] - 0.02*y[k-1]^3")
    X, y = measured(model, 400, noise=0.01)
    start = NARXModel.from_equations("1.6*y[k-1] + 0.5*u[k-1] + 0.02*y[k-1]^3")
    assert np.isinf(refine_free_run(start, X, y, max_iter=0).loss)
    alone = refine_free_run(start, X, y)
    assert np.isinf(alone.loss)
    assert alone.model is start
    assert not alone.converged
    helped = refine_free_run(start, X, y, horizons=(3, 10, None))
    assert np.isfinite(helped.loss)
    np.testing.assert_allclose(helped.model.parameters, model.parameters, atol=0.01)


def test_a_record_too_short_to_simulate_is_left_alone():
    fit = refine_free_run(TRUTH, np.zeros((2, 1)), np.zeros((2, 1)))
    assert fit.model is TRUTH
    assert fit.n_samples == 0
    assert not fit.converged


def test_a_model_without_parameters_is_done():
    model = NARXModel.from_equations("0*y[k-1] + 0*u[k-1]")
    assert refine_free_run(model, np.ones((9, 1)), np.ones((9, 1))).converged


def test_of_a_chaotic_run_whose_sensitivities_overflow_nothing_is_claimed():
    model = NARXModel.from_equations("3.9*y[k-1] - 3.9*y[k-1]^2 + 0.001*u[k-1]")
    X = np.random.default_rng(0).uniform(-1, 1, (2000, 1))
    y = free_run(model, X, y_init=[0.3]).y
    fit = refine_free_run(perturbed(model, 1e-4), X, y)
    assert np.isfinite(fit.loss)
    assert not fit.converged
    with pytest.warns(NarxWarning, match="nothing is known of the parameters' uncertainty"):
        narx = NARXRegressor(1, 1, refine=True).fit(X, y[:, 0])
    assert np.isnan(narx.confidence_intervals()).all()


def test_outputs_may_be_a_vector_and_lengths_must_agree():
    X, y = measured(TRUTH)
    plain = refine_free_run(perturbed(TRUTH), X, y)
    vector = refine_free_run(perturbed(TRUTH), X[:, 0], y[:, 0])
    np.testing.assert_array_equal(vector.model.parameters, plain.model.parameters)
    with pytest.raises(ValueError, match="inconsistent numbers of samples"):
        refine_free_run(TRUTH, X[:100], y)
    with pytest.raises(ValueError, match="y has 1 columns"):
        refine_free_run(TWO_OUTPUTS, X, y)


def saturating(seed, n_samples=300):
    """Return a record whose output stops at limits, beyond which polynomials explode."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-3, 3, n_samples // 10), 10)
    y = np.zeros(n_samples)
    for k in range(1, n_samples):
        free = y[k - 1] + 0.3 * u[k - 1] - 0.1 * y[k - 1] * abs(y[k - 1])
        y[k] = np.clip(free + 0.02 * rng.normal(), -1.5, 1.5)
    return u[:, None], y


@pytest.mark.parametrize(("seed", "lags"), [(46, 3), (49, 2)])
def test_a_free_run_that_is_lost_is_brought_back_over_short_horizons(seed, lags):
    X, y = saturating(seed)
    kept = NARXRegressor(lags, lags, refine=False).fit(X, y)
    assert kept.score(X, y) == -1e6
    narx = NARXRegressor(lags, lags).fit(X, y)  # warnings are errors: those of trials are not shown
    assert narx.noise_ == "mixed"
    assert narx.score(X, y) > 0.9
    given = NARXRegressor(lags, lags, n_terms=kept.model_.n_terms).fit(X, y)
    assert given.score(X, y) > 0.9


@pytest.mark.parametrize("options", [{"refine": True}, {"n_terms": 5}])
def test_constraints_hold_on_the_free_run_where_candidates_were_screened(options):
    rng = np.random.default_rng(0)
    X, y = rng.uniform(-1, 1, (600, 2)), np.zeros(600)
    for k in range(2, 600):
        y[k] = 0.5 * y[k - 1] - 0.2 * y[k - 2] + 0.3 * X[k - 1, 0] + 0.4 * X[k - 2, 1] ** 2
    y += 0.05 * rng.normal(size=600)  # on the output
    narx = NARXRegressor(4, 5, degree=3, constraints="y[k-1] + y[k-2] = 0.3", **options).fit(X, y)
    assert len(narx.candidates_) < narx.path_.n_considered
    assert narx.noise_ == "output"
    of_term = dict(zip(narx.terms_, narx.coef_, strict=True))
    assert of_term.get("y[k-1]", 0.0) + of_term.get("y[k-2]", 0.0) == pytest.approx(0.3, abs=1e-12)


def test_a_model_that_is_lost_on_its_own_record_is_told_once_with_the_way_out():
    X, y = saturating(0)
    with pytest.warns(
        DivergenceWarning, match=r"finite range at sample \d+ of its own record.*n_terms"
    ) as told:
        narx = NARXRegressor(2, 2).fit(X, y)
    assert len(told) == 1
    assert told[0].filename == __file__
    assert narx.score(X, y) == -1e6
    with pytest.warns(DivergenceWarning, match="'ridge' is not refined unasked"):
        NARXRegressor(2, 2, estimator="ridge", alpha=1e-12).fit(X, y)
    NARXRegressor(2, 2, refine=False).fit(X, y)  # who does not want free runs is not told of them


def test_an_unstable_plant_under_feedback_keeps_least_squares():
    rng = np.random.default_rng(0)
    u, y = np.zeros(1500), np.zeros(1500)
    for k in range(1, 1500):
        y[k] = 1.1 * y[k - 1] + 0.5 * u[k - 1] + 0.05 * rng.normal()
        u[k] = 0.8 * (np.sign(np.sin(k / 37)) - y[k]) + 0.3 * rng.normal()
    with pytest.warns(DivergenceWarning, match="of its own record"):
        narx = NARXRegressor(1, 1, degree=1).fit(u[:, None], y)
    assert narx.noise_ == "equation"
    # four standard errors of least squares, 0.05 / sqrt(1500 var) with variances near one
    np.testing.assert_allclose(narx.coef_, [1.1, 0.5], atol=0.01)


def test_of_several_outputs_a_lost_free_run_is_brought_back_too():
    X, y = saturating(46)
    second = np.roll(X[:, 0], 1) + 0.1 * np.random.default_rng(1).normal(size=y.size)
    both = np.column_stack([y, second])
    lags = {"output_lags": [[1, 2, 3], []], "input_lags": 3}
    assert NARXRegressor(**lags, refine=False).fit(X, both).score(X, both) == -1e6
    narx = NARXRegressor(**lags).fit(X, both)
    assert narx.noise_ == "mixed"
    assert narx.score(X, both) > 0.9

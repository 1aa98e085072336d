"""Confidence intervals cover as often as they say, whatever the colour of the residuals."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom
from scipy.stats import t as student

from narx_sklearn.identification import LinearConstraints, ParameterUncertainty, refine_free_run
from narx_sklearn.identification.free_run.refinement import free_run_uncertainty
from narx_sklearn.identification.one_step.regressors import Candidates
from narx_sklearn.identification.one_step.uncertainty import (
    n_stretches,
    one_step_scores,
    parameter_uncertainty,
)
from narx_sklearn.model import NARXModel, TermLibrary, free_run
from narx_sklearn.model.recording import Layout, lay_out

LAYOUT = Layout.of(("y",), ("u",), ())


def within_binomial_error(hits, trials, level=0.95):
    """Tell whether a coverage count is one that chance alone would give in 99.9 of 100 cases."""
    low, high = binom.ppf([0.0005, 0.9995], trials, level)
    return low <= hits <= high


def response_record(rng, n_samples, pole):
    """Return candidates of y[k] = u[k-1] - 0.5 u[k-2]^2 + v[k], u and v of the same colour."""
    u, v = lfilter([1.0], [1.0, -pole], rng.normal(size=(2, n_samples)), axis=1)
    y = v.copy()
    y[2:] += u[1:-1] - 0.5 * u[:-2] ** 2
    library = TermLibrary(["1", "u[k-1]", "u[k-2]^2"])
    return Candidates.of(library, LAYOUT, lay_out(LAYOUT, u[:, None], y[:, None]))


def intervals_of(scores, theta):
    """Return lower and upper ends at 95 %, leverage corrected."""
    return parameter_uncertainty(scores.gram, scores.sums, grams=scores.grams).intervals(theta).T


@pytest.mark.parametrize(("pole", "n_samples"), [(0.0, 1200), (0.9, 9600)])
def test_one_step_intervals_cover_under_white_and_coloured_residuals(pole, n_samples):
    """The coloured record is long: its stretches must outlast the memory of input and noise together."""
    truth, trials = np.array([0.0, 1.0, -0.5]), 300
    rng = np.random.default_rng(0)
    hits = np.zeros(3)
    narrow = np.zeros(3)
    for _ in range(trials):
        candidates = response_record(rng, n_samples, pole)
        Psi, y = candidates.matrix(), candidates.targets[:, 0]
        theta = np.linalg.lstsq(Psi, y, rcond=None)[0]
        scores = one_step_scores(lambda parts=(candidates,): parts, theta, 0)
        low, high = intervals_of(scores, theta)
        hits += (low <= truth) & (truth <= high)
        white = 1.96 * scores.residual_deviation * np.sqrt(np.diag(np.linalg.inv(Psi.T @ Psi)))
        narrow += np.abs(theta - truth) <= white
    assert all(within_binomial_error(count, trials) for count in hits), hits / trials
    if pole > 0.0:  # what the textbook formula would say
        assert not within_binomial_error(narrow[1], trials)


def test_free_run_intervals_cover_under_noise_on_the_output():
    model = NARXModel.from_equations("0.7*y[k-1] + 0.5*u[k-1] - 0.1*y[k-1]*u[k-1]")
    truth, trials = model.parameters[:, 0], 150
    rng = np.random.default_rng(0)
    hits = np.zeros(truth.size)
    for _ in range(trials):
        u = rng.uniform(-1, 1, (500, 1))
        y = free_run(model, u).y + 0.1 * rng.normal(size=(500, 1))
        fitted = refine_free_run(model, u, y).model
        low, high = free_run_uncertainty(fitted, u, y).intervals(fitted.parameters[:, 0]).T
        hits += (low <= truth) & (truth <= high)
    assert all(within_binomial_error(count, trials) for count in hits), hits / trials


def test_scores_are_sums_over_stretches_and_vanish_in_total_at_the_estimate():
    candidates = response_record(np.random.default_rng(0), 5000, 0.5)
    Psi, y = candidates.matrix(), candidates.targets[:, 0]
    theta = np.linalg.lstsq(Psi, y, rcond=None)[0]
    scores = one_step_scores(lambda: [candidates], theta, 0)
    residual = y - Psi @ theta
    products = Psi * residual[:, None]
    stretch = np.arange(len(y)) * 12 // len(y)
    expected = np.array([products[stretch == w].sum(axis=0) for w in range(12)])
    np.testing.assert_allclose(scores.sums, expected, atol=1e-9)
    np.testing.assert_allclose(scores.sums.sum(axis=0), 0.0, atol=1e-8)
    np.testing.assert_allclose(scores.grams[3], Psi[stretch == 3].T @ Psi[stretch == 3], rtol=1e-12)
    np.testing.assert_allclose(scores.gram, Psi.T @ Psi, rtol=1e-12)
    assert scores.residual_deviation == pytest.approx(np.sqrt(residual @ residual / (len(y) - 3)))


def test_parts_of_a_record_give_the_scores_of_the_whole():
    candidates = response_record(np.random.default_rng(0), 3000, 0.0)
    halves = [
        Candidates(candidates.library, candidates.layout, candidates.recording, rows)
        for rows in np.split(candidates.rows, [1234])
    ]
    theta = np.array([0.1, 0.9, -0.4])
    whole = one_step_scores(lambda: [candidates], theta, 0)
    parts = one_step_scores(lambda: halves, theta, 0)
    np.testing.assert_allclose(parts.sums, whole.sums, atol=1e-9)
    np.testing.assert_allclose(parts.grams, whole.grams, rtol=1e-12)


def test_covariance_by_hand():
    """G = 4, scores +2 and -2: meat = (4 + 4) 2/(2 - 1) = 16, covariance = 16/4^2 = 1, one degree."""
    uncertainty = parameter_uncertainty(np.array([[4.0]]), np.array([[2.0], [-2.0]]))
    assert uncertainty.covariance[0, 0] == pytest.approx(1.0)
    assert uncertainty.degrees_of_freedom == 1
    low, high = uncertainty.intervals(np.array([3.0]))[0]
    assert (3.0 - low, high - 3.0) == pytest.approx([student.ppf(0.975, 1)] * 2)


def leverage_corrected_in_full(Psi, residual, count):
    """Slow twin: the n x n hat matrix, its blocks' inverse roots, and the quadratic form's own matrix."""
    n, p = Psi.shape
    inverse = np.linalg.inv(Psi.T @ Psi)
    H = Psi @ inverse @ Psi.T
    stretch = np.arange(n) * count // n
    weights = np.zeros((count, n, p))  # parameter p's error in stretch w, as weights of the residuals
    for w in range(count):
        inside = stretch == w
        values, vectors = np.linalg.eigh(np.eye(inside.sum()) - H[np.ix_(inside, inside)])
        weights[w, inside] = (vectors / np.sqrt(values)) @ vectors.T @ Psi[inside] @ inverse
    parts = np.einsum("wnp,n->wp", weights, residual)
    degrees = []
    for j in range(p):
        B = weights[:, :, j] @ (np.eye(n) - H) @ weights[:, :, j].T
        degrees.append(np.trace(B) ** 2 / np.trace(B @ B))
    return parts.T @ parts, np.array(degrees)


def test_leverage_correction_is_that_of_the_hat_matrix():
    candidates = response_record(np.random.default_rng(3), 150, 0.9)
    Psi, y = candidates.matrix(), candidates.targets[:, 0]
    theta = np.linalg.lstsq(Psi, y, rcond=None)[0]
    scores = one_step_scores(lambda: [candidates], theta, 0)
    found = parameter_uncertainty(scores.gram, scores.sums, grams=scores.grams)
    covariance, degrees = leverage_corrected_in_full(Psi, y - Psi @ theta, len(scores.sums))
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-9)
    np.testing.assert_allclose(found.degrees_of_freedom, degrees, rtol=1e-9)


def test_equal_stretches_lose_one_degree_of_freedom_to_the_mean():
    """A constant alone, 12 stretches of equal length: n - 1 degrees, s^2/n of the stretch means."""
    values = np.random.default_rng(0).normal(size=12)
    grams = np.full((12, 1, 1), 10.0)
    sums = 10.0 * (values - values.mean())[:, None]
    found = parameter_uncertainty(grams.sum(axis=0), sums, grams=grams)
    assert found.covariance[0, 0] == pytest.approx(values.var(ddof=1) / 12)
    assert found.degrees_of_freedom[0] == pytest.approx(11.0)


def test_a_stretch_that_alone_determines_a_parameter_leaves_finite_intervals():
    grams = np.zeros((4, 2, 2))
    grams[:, 0, 0] = 5.0
    grams[2, 1, 1] = 3.0
    sums = np.array([[1.0, 0.0], [-2.0, 0.0], [0.5, 0.0], [0.5, 0.0]])
    found = parameter_uncertainty(grams.sum(axis=0), sums, grams=grams)
    assert np.isfinite(found.intervals(np.ones(2))).all()


@pytest.mark.long
@pytest.mark.parametrize(
    ("pole", "n_samples", "least"), [(0.0, 300, 0.93), (0.0, 800, 0.935), (0.9, 800, 0.92)]
)
def test_intervals_keep_their_coverage_on_short_records(pole, n_samples, least):
    """Nominal 95 %; 2000 records, so that a coverage is known to half a percent."""
    truth, trials = np.array([0.0, 1.0, -0.5]), 2000
    rng = np.random.default_rng(1)
    hits = np.zeros(3)
    for _ in range(trials):
        candidates = response_record(rng, n_samples, pole)
        theta = np.linalg.lstsq(candidates.matrix(), candidates.targets[:, 0], rcond=None)[0]
        low, high = intervals_of(one_step_scores(lambda parts=(candidates,): parts, theta, 0), theta)
        hits += (low <= truth) & (truth <= high)
    assert (hits / trials >= least).all(), hits / trials
    assert (hits / trials <= 0.975).all(), hits / trials


def test_constraints_take_the_uncertainty_of_what_they_fix():
    rng = np.random.default_rng(0)
    A = rng.normal(size=(50, 3))
    constraints = LinearConstraints(np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]), np.array([0.5, 1.0]))
    covariance = parameter_uncertainty(A.T @ A, rng.normal(size=(24, 3)), constraints).covariance
    np.testing.assert_allclose(constraints.S @ covariance, 0.0, atol=1e-15)
    assert covariance[1, 1] == pytest.approx(covariance[2, 2])
    assert covariance[1, 1] > 0


def test_units_scale_the_covariance():
    rng = np.random.default_rng(0)
    A, scores = rng.normal(size=(50, 3)), rng.normal(size=(24, 3))
    units = np.array([1e-9, 1.0, 1e9])
    plain = parameter_uncertainty(A.T @ A, scores).covariance
    scaled = parameter_uncertainty((A.T @ A) * np.outer(units, units), scores * units).covariance
    np.testing.assert_allclose(scaled * np.outer(units, units), plain, rtol=1e-9)


@pytest.mark.parametrize(("n_samples", "expected"), [(3, 2), (64, 8), (10**6, 12)])
def test_stretches_are_few_and_long(n_samples, expected):
    assert n_stretches(n_samples) == expected


@pytest.mark.parametrize("level", [0.0, 1.0, 95])
def test_levels_lie_between_zero_and_one(level):
    with pytest.raises(ValueError, match="level must lie between 0 and 1"):
        ParameterUncertainty(np.eye(1), 5).intervals(np.zeros(1), level)

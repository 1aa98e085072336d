"""Least squares on the factor, recursively, and with a model of the noise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.exceptions import RankWarning
from narx_sklearn.identification import Factor, LinearConstraints, least_squares, recursive_least_squares
from narx_sklearn.identification.one_step.estimation import _recursive_least_squares
from narx_sklearn.identification.one_step.extended import extended_least_squares
from narx_sklearn.identification.one_step.regressors import Candidates
from narx_sklearn.model import TermLibrary
from narx_sklearn.model.recording import Layout, lay_out

MODES = pytest.mark.parametrize("kernel", [_recursive_least_squares, _recursive_least_squares.py_func])


def constrained_by_formula(Psi, y, S, c):
    """Return the constrained estimate as (2.48) is written."""
    inverse = np.linalg.inv(Psi.T @ Psi)
    theta = inverse @ Psi.T @ y
    return theta - inverse @ S.T @ np.linalg.inv(S @ inverse @ S.T) @ (S @ theta - c)


def recursive_twin(Psi, y, forgetting, theta, P):
    """Return all parameters of (2.50)-(2.52), matrix by matrix."""
    history = []
    for psi, value in zip(Psi, y, strict=True):
        denominator = psi @ P @ psi + forgetting
        K = P @ psi / denominator
        theta = theta + K * (value - psi @ theta)
        P = (P - np.outer(P @ psi, psi @ P) / denominator) / forgetting
        history.append(theta)
    return np.array(history), P


# -- batch ------------------------------------------------------------------------------------------------


def test_constrained_estimate_by_hand():
    """Psi = I, y = (3, 1), theta1 + theta2 = 2: the gap 2 is shared, theta = (2, 0), |xi|^2 = 2."""
    constraints = LinearConstraints(np.array([[1.0, 1.0]]), np.array([2.0]))
    theta, rss = least_squares(Factor.of(np.eye(2), np.array([3.0, 1.0])), constraints=constraints)
    np.testing.assert_allclose(theta, [2.0, 0.0], atol=1e-15)
    assert rss == pytest.approx(2.0)


@given(st.integers(0, 3), st.integers(0, 999))
def test_constrained_estimate_is_the_formula_and_meets_its_constraints(n_constraints, seed):
    rng = np.random.default_rng(seed)
    Psi, y = rng.normal(size=(30, 5)), rng.normal(size=30)
    S, c = rng.normal(size=(n_constraints, 5)), rng.normal(size=n_constraints)
    theta, rss = least_squares(Factor.of(Psi, y), constraints=LinearConstraints(S, c))
    if n_constraints:
        np.testing.assert_allclose(theta, constrained_by_formula(Psi, y, S, c), atol=1e-9)
        np.testing.assert_allclose(S @ theta, c, atol=1e-12)
    else:
        np.testing.assert_allclose(theta, np.linalg.lstsq(Psi, y, rcond=None)[0], atol=1e-11)
    assert rss == pytest.approx(np.sum((y - Psi @ theta) ** 2), rel=1e-10)


@pytest.mark.parametrize("unit", [1e-12, 1e12])
def test_units_of_a_term_only_scale_its_parameter(unit):
    rng = np.random.default_rng(0)
    Psi, y = rng.normal(size=(40, 3)), rng.normal(size=40)
    units = np.array([1.0, unit, 1.0])
    theta, rss = least_squares(Factor.of(Psi, y))
    scaled, scaled_rss = least_squares(Factor.of(Psi * units, y))
    np.testing.assert_allclose(scaled * units, theta, rtol=1e-10)
    assert scaled_rss == pytest.approx(rss, rel=1e-12)


def test_ridge_is_its_closed_form_in_units_of_the_regressors():
    rng = np.random.default_rng(0)
    Psi, y = rng.normal(size=(40, 3)) * [1.0, 10.0, 0.1], rng.normal(size=40)
    theta, _ = least_squares(Factor.of(Psi, y), alpha=0.5)
    D = np.diag(np.sum(Psi**2, axis=0))
    np.testing.assert_allclose(theta, np.linalg.solve(Psi.T @ Psi + 0.5 * D, Psi.T @ y), rtol=1e-10)


def test_ridge_keeps_the_constraints():
    rng = np.random.default_rng(0)
    Psi, y = rng.normal(size=(40, 3)), rng.normal(size=40)
    constraints = LinearConstraints(np.array([[1.0, -1.0, 2.0]]), np.array([0.3]))
    theta, _ = least_squares(Factor.of(Psi, y), alpha=2.0, constraints=constraints)
    np.testing.assert_allclose(constraints.S @ theta, constraints.c, atol=1e-12)


def test_each_output_has_its_own_estimate():
    rng = np.random.default_rng(0)
    Psi = rng.normal(size=(20, 2))
    factor = Factor.of(Psi, Psi @ np.array([[1.0, 3.0], [2.0, 4.0]]))
    assert least_squares(factor, output=1)[0] == pytest.approx([3.0, 4.0])


def test_collinear_regressors_warn_with_their_rank():
    rng = np.random.default_rng(0)
    Psi = rng.normal(size=(30, 2))
    with pytest.warns(RankWarning, match="rank 2 of 3"):
        theta, rss = least_squares(Factor.of(np.column_stack([Psi, Psi[:, 0]]), Psi[:, 0]))
    np.testing.assert_allclose(theta, [0.5, 0.0, 0.5], atol=1e-10)
    assert rss < 1e-20


def test_everything_fixed_by_constraints_leaves_nothing_to_estimate():
    rng = np.random.default_rng(0)
    constraints = LinearConstraints(np.eye(2), np.array([0.5, -0.5]))
    theta, _ = least_squares(Factor.of(rng.normal(size=(9, 2)), rng.normal(size=9)), constraints=constraints)
    np.testing.assert_allclose(theta, [0.5, -0.5], atol=1e-15)


# -- recursive --------------------------------------------------------------------------------------------


@MODES
@pytest.mark.parametrize("forgetting", [1.0, 0.97])
def test_recursion_is_the_equations_matrix_by_matrix(kernel, forgetting):
    rng = np.random.default_rng(0)
    Psi = rng.normal(size=(60, 3))
    y = Psi @ [1.0, -1.0, 0.5] + 0.1 * rng.normal(size=60)
    theta, P = np.zeros(3), 100.0 * np.eye(3)
    history, factors = np.empty((60, 3)), np.empty(60)
    expected, final = recursive_twin(Psi, y, forgetting, theta.copy(), P.copy())
    kernel(Psi, y, forgetting, False, 0.0, 1.0, theta, P, history, factors)
    np.testing.assert_allclose(history, expected, atol=1e-11)
    np.testing.assert_allclose(P, final, atol=1e-11)
    np.testing.assert_array_equal(theta, history[-1])
    assert np.all(factors == forgetting)


@MODES
def test_variable_forgetting_reacts_to_surprise_and_only_to_that(kernel):
    """A parameter jumps at sample 300: memory shortens there, and nowhere in the quiet before."""
    rng = np.random.default_rng(0)
    Psi = rng.normal(size=(600, 2))
    jump = np.where(np.arange(600) < 300, 1.0, 2.0)
    y = jump * Psi[:, 0] + Psi[:, 1] + 0.01 * rng.normal(size=600)
    history, factors = np.empty((600, 2)), np.empty(600)
    kernel(Psi, y, 1.0, True, 0.02, 0.9, np.zeros(2), 1e6 * np.eye(2), history, factors)
    assert factors[300:310].min() == 0.9
    assert np.median(factors[100:300]) == 1.0
    assert np.all((factors >= 0.9) & (factors <= 1.0))
    assert abs(history[-1, 0] - 2.0) < 0.02


@pytest.mark.parametrize("one", [np.float32(1.0), np.int64(1)])
def test_numbers_of_any_kind_are_forgetting_factors(one):
    Psi = np.random.default_rng(0).normal(size=(50, 2))
    y = Psi @ [1.0, -2.0]
    ours, plain = (recursive_least_squares(Psi, y, forgetting=f).theta for f in (one, 1.0))
    np.testing.assert_array_equal(ours, plain)


def test_recursion_without_forgetting_ends_at_least_squares():
    """Starting from P = 1e9 I adds 1e-9 theta'theta to the sum of squares, and no more."""
    rng = np.random.default_rng(0)
    Psi = rng.normal(size=(200, 4))
    y = Psi @ [1.0, 2.0, 3.0, 4.0] + rng.normal(size=200)
    estimate = recursive_least_squares(Psi, y, covariance=1e9)
    np.testing.assert_allclose(estimate.theta, np.linalg.lstsq(Psi, y, rcond=None)[0], atol=1e-6)
    np.testing.assert_allclose(estimate.covariance, np.linalg.inv(Psi.T @ Psi), atol=1e-6)


def test_a_batch_estimate_goes_on_recursively():
    """Started from the first half's estimate and inverse Gram matrix, the second half ends at the whole's."""
    rng = np.random.default_rng(1)
    Psi, y = rng.normal(size=(100, 3)), rng.normal(size=100)
    first = np.linalg.lstsq(Psi[:50], y[:50], rcond=None)[0]
    P = np.linalg.inv(Psi[:50].T @ Psi[:50])
    estimate = recursive_least_squares(Psi[50:], y[50:], theta=first, covariance=P)
    np.testing.assert_allclose(estimate.theta, np.linalg.lstsq(Psi, y, rcond=None)[0], atol=1e-12)


def test_forgetting_follows_a_change_that_full_memory_averages():
    rng = np.random.default_rng(0)
    Psi = rng.normal(size=(1000, 1))
    y = np.where(np.arange(1000) < 500, 1.0, 3.0) * Psi[:, 0] + 0.05 * rng.normal(size=1000)
    full, short = (recursive_least_squares(Psi, y, forgetting=f).theta[0] for f in (1.0, 0.95))
    assert abs(full - 2.0) < 0.1
    assert abs(short - 3.0) < 0.05


def test_starting_values_are_left_alone():
    theta, P = np.zeros(2), np.eye(2)
    recursive_least_squares(np.ones((3, 2)), np.ones(3), theta=theta, covariance=P)
    assert not theta.any()
    np.testing.assert_array_equal(P, np.eye(2))


@pytest.mark.parametrize("forgetting", [0.0, 1.1, "fast", None])
def test_forgetting_out_of_range_is_refused(forgetting):
    with pytest.raises(ValueError, match=r"forgetting must be a number in \(0, 1\] or 'variable'"):
        recursive_least_squares(np.ones((3, 1)), np.ones(3), forgetting=forgetting)


def test_lengths_must_agree():
    with pytest.raises(ValueError, match="Psi has 3 rows, y has 4 samples"):
        recursive_least_squares(np.ones((3, 1)), np.ones(4))


def test_variable_forgetting_learns_the_noise_after_a_quiet_start():
    """100 samples of rest give no scale; 500 samples of noise later the memory is long again."""
    rng = np.random.default_rng(0)
    Psi = rng.normal(size=(900, 2))
    Psi[:100] = 0.0
    y = Psi @ [1.0, 1.0] + np.where(np.arange(900) < 100, 0.0, 0.1) * rng.normal(size=900)
    estimate = recursive_least_squares(Psi, y, forgetting="variable")
    assert estimate.forgetting[100:110].min() == 0.9
    assert estimate.forgetting[600:].mean() > 0.97
    np.testing.assert_allclose(estimate.theta, [1.0, 1.0], atol=0.05)


# -- with a model of the noise ----------------------------------------------------------------------------


def moving_average_record(seed, n_samples=800):
    """Return y[k] = 0.8 y[k-1] + 0.5 u[k-1] + e[k] + 0.9 e[k-1] as candidates."""
    rng = np.random.default_rng(seed)
    u, e = rng.normal(size=(2, n_samples))
    y = np.zeros(n_samples)
    for k in range(1, n_samples):
        y[k] = 0.8 * y[k - 1] + 0.5 * u[k - 1] + 0.5 * (e[k] + 0.9 * e[k - 1])
    layout = Layout.of(("y",), ("u",), ())
    library = TermLibrary(["y[k-1]", "u[k-1]"])
    return Candidates.of(library, layout, lay_out(layout, u[:, None], y[:, None]))


def test_extended_least_squares_takes_the_bias_of_coloured_noise_away():
    """Over 20 records plain least squares is off by +0.05; noise terms leave a tenth of that."""
    plain, extended = [], []
    for seed in range(20):
        candidates = moving_average_record(seed)
        theta = np.linalg.lstsq(candidates.matrix(), candidates.targets[:, 0], rcond=None)[0]
        plain.append(theta[0] - 0.8)
        extended.append(extended_least_squares(candidates, 0, theta, noise_lags=1)[0] - 0.8)
    assert np.mean(plain) > 0.03
    assert abs(np.mean(extended)) < 0.1 * np.mean(plain) + 3 * np.std(extended) / np.sqrt(20)
    assert np.mean(np.square(extended)) < 0.25 * np.mean(np.square(plain))


def test_without_noise_extended_least_squares_changes_nothing():
    layout = Layout.of(("y",), ("u",), ())
    u = np.random.default_rng(0).normal(size=(50, 1))
    y = np.zeros((50, 1))
    for k in range(1, 50):
        y[k] = 0.5 * y[k - 1] + u[k - 1]
    candidates = Candidates.of(TermLibrary(["y[k-1]", "u[k-1]"]), layout, lay_out(layout, u, y))
    theta = extended_least_squares(candidates, 0, np.array([0.5, 1.0]), noise_lags=2)
    np.testing.assert_allclose(theta, [0.5, 1.0], atol=1e-10)

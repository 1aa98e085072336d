"""The restricted likelihood of noise: against dense algebra, and what it is for."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from small_machines import LOAD, fitted, walking

from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise, estimate_noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.confirm import deviance
from narx_sklearn.discrepancy.search.restricted import Contrasts, own_noise
from narx_sklearn.physics.effects import CATALOGUE


def covariance(a, b, n):
    """Return the covariance of noise with unit innovations: lasting where b is zero, else begun at zero."""
    if not b:
        ahead = np.zeros(4000)
        ahead[0] = 1.0
        for k in range(1, ahead.size):  # the response to one innovation
            ahead[k] = sum(c * ahead[k - lag] for lag, c in enumerate(a, start=1) if k >= lag)
        return toeplitz([ahead[lag:] @ ahead[: ahead.size - lag] for lag in range(n)])
    root = np.eye(n)
    for k in range(1, n):
        root[k] = a[0] * root[k - 1]
        root[k, k - 1] -= b
        root[k, k] = 1.0
    return root @ root.T


def dense(problem, model, a, b):
    """Return the restricted deviance of one output, seen without gaps, by the formula as it is written."""
    plain = problem.with_noise(Noise.white(np.ones(1)))
    run = plain.run(model)
    n, n_windows = problem.n_seen, problem.windows.count
    X = np.zeros((n, 2 * n_windows + 2))
    length = problem.windows.last - problem.windows.first
    ends = np.cumsum(length)
    states = plain.states_sensitivity(model, run, np.full(2, 1e-5))
    parameters = plain.parameter_sensitivity(model, run, np.full(2, 1e-5))
    rest = np.zeros(n)
    for w, (end, size) in enumerate(zip(ends, length, strict=True)):
        X[end - size : end, 2 * w : 2 * w + 2] = states[w, :size]
        X[end - size : end, -2:] = parameters[w, :size]
        rest[end - size : end] = plain.residual(run)[w, :size]
    X, _ = np.linalg.qr(X)
    V = covariance(a, b, n)
    inverse = np.linalg.inv(V)
    information = X.T @ inverse @ X
    left = rest - X @ np.linalg.solve(information, X.T @ inverse @ rest)
    k = X.shape[1]
    cost = left @ inverse @ left / (n - k)
    return (n - k) * np.log(cost) + np.linalg.slogdet(V)[1] + np.linalg.slogdet(information)[1]


@pytest.mark.parametrize(
    ("a", "b"), [((), 0.0), ((0.8,), 0.0), ((0.5, 0.3), 0.0), ((1.0,), 0.95), ((0.97,), 0.9)]
)
def test_it_is_that_of_dense_algebra(a, b):
    problem, found = fitted(0.02 * np.random.default_rng(1).normal(size=(300, 1)))
    contrasts = Contrasts.of(problem, found.model)
    own = contrasts.under(Noise((np.array(a),), np.ones(1), (b,)))
    free = 300 - contrasts.n_nuisances
    expected = dense(problem, found.model, a, b) - 2 * free * np.log(contrasts.unit[0])
    assert own.deviance - 2.0 * (len(a) + (b != 0)) == pytest.approx(expected, abs=0.02)


def test_an_output_that_nobody_saw_for_a_while_counts_where_it_was_seen():
    noise = 0.02 * np.random.default_rng(1).normal(size=(400, 2))
    problem, found = fitted(noise, outputs=(0, 1), unseen=range(150, 180))
    contrasts = Contrasts.of(problem, found.model)
    assert contrasts.seen.sum() == 2 * 370
    walk = contrasts.under(Noise((np.ones(1), np.ones(1)), np.ones(2), (0.98, 0.98)))
    white = contrasts.under(Noise.white(np.ones(2)))
    assert white.deviance < walk.deviance
    assert white.noise.sigma == pytest.approx(0.02, rel=0.1)


def test_an_initial_state_that_gaps_hide_from_coloured_noise_speaks_for_no_colour():
    """After gaps like these an autoregression of three lags counts no innovation in the last window."""
    noise = 0.02 * np.random.default_rng(1).normal(size=(400, 1))
    problem, found = fitted(noise, n_windows=4, unseen=[k for k in range(300, 400) if k % 3 == 0])
    contrasts = Contrasts.of(problem, found.model)
    white = contrasts.under(Noise.white(np.ones(1)))
    coloured = contrasts.under(Noise((np.array([0.05, 0.02, 0.01]),), np.ones(1), (0.0,)))
    # of the 67 samples seen in that window none counts, nor do the states that only it tells of
    assert coloured.deviance == pytest.approx(white.deviance, abs=150.0)
    assert own_noise(problem, found.model).deviance <= white.deviance


def test_windows_that_do_not_follow_begin_anew():
    noise = 0.02 * np.random.default_rng(1).normal(size=(400, 1))
    pieces = [(slice(0, 200), 0), (slice(220, 400), 220)]
    problem, found = fitted(noise, pieces=pieces, n_windows=4)
    contrasts = Contrasts.of(problem, found.model)
    assert contrasts.seen.shape == (2, 200, 1)
    assert contrasts.seen.sum() == 380
    assert contrasts.n_nuisances == 2 * problem.windows.count + 2


@pytest.mark.parametrize("b", [0.0, 0.001, 0.3])
def test_the_first_sample_of_coloured_noise_counts(b):
    """The course that noise is expected to take from its first sample leaves the innovation of that alone."""
    pole = 0.9
    variance = 1.0 + (pole - b) ** 2 / (1.0 - pole**2)
    noise = Noise((np.array([pole]),), np.array([0.1]), (b,))
    course = 2.0 * np.concatenate([[1.0], (pole - b / variance) * pole ** np.arange(199.0)])
    e = noise.innovations(course[None, :, None])[0, :, 0]
    assert e[0] == pytest.approx(20.0 / np.sqrt(variance))
    assert e[1:] == pytest.approx(np.zeros(199), abs=1e-9)


def test_a_drift_that_initial_states_follow_is_found_all_the_same():
    paces = []
    for seed in range(10):
        problem, found = fitted(walking(np.random.default_rng(seed), 1500), n_windows=4, seed=seed)
        noise = own_noise(problem, found.model).noise
        paces += [1.0 - noise.average[0]] if noise.average else []
    assert len(paces) >= 7
    expected = 0.6 / 0.8 / np.sqrt(750)  # of the walk's steps to the white part, where that is small
    assert np.median(paces) == pytest.approx(expected, rel=0.5)


def test_what_a_load_gains_on_noise_that_drifts_is_chi_squared():
    gained = []
    for seed in range(30):
        problem, found = fitted(walking(np.random.default_rng(seed), 1500), n_windows=4, seed=seed)
        problem = problem.with_noise(estimate_noise(problem.left_over(found.model), problem.seen))
        base = fit(problem, found.model)
        loaded = fit(problem, base.model._replace(effects=(LOAD,)))
        gained.append(deviance(problem, base.model) - deviance(problem, loaded.model))
    assert np.mean(np.array(gained) > 6.63) < 0.1  # a hundredth, if all is counted


@pytest.mark.parametrize("seed", range(3))
def test_steps_below_the_noise_take_nothing_from_a_drift(seed):
    problem, found = fitted(walking(np.random.default_rng(seed), 1500), n_windows=15, seed=seed)
    steps = PlacedEffect(CATALOGUE["quantisation"], Port("output", 0), theta=(0.002,))
    stepped = found.model._replace(effects=(steps,))
    assert deviance(problem, stepped) == pytest.approx(deviance(problem, found.model), abs=8.0)

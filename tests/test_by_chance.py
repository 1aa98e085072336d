"""What an effect gains by chance on noise that drifts: against algebra draw by draw, and against fits."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_machines import LOAD, fitted, walking

from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise, estimate_noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search import by_chance
from narx_sklearn.discrepancy.search.by_chance import ByChance, gained_by_chance
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.confirm import Beside, as_if_white
from narx_sklearn.discrepancy.search.restricted import Contrasts, own_noise
from narx_sklearn.physics.effects import CATALOGUE

DRIFTING_DAMPING = PlacedEffect(
    CATALOGUE["gain_drift"], Port("state", 1), (0.0, 1.0), theta=(0.01, 10.0, 0.0)
)


def drifting(seed, effect, n_samples=1500):
    """Return a problem of drifting noise alone, its fit and that with an effect."""
    noise = walking(np.random.default_rng(seed), n_samples)
    problem, found = fitted(noise, n_windows=4, seed=seed)
    problem = problem.with_noise(estimate_noise(problem.left_over(found.model), problem.seen))
    base = fit(problem, found.model)
    return problem, base, fit(problem, base.model._replace(effects=(effect,)))


class TestEquivalentGain:
    def test_chi_squared_as_it_should_be_stays(self):
        assert ByChance(3.0, np.sqrt(6.0), 3).as_if_white(20.0) == pytest.approx(20.0)

    def test_a_gain_of_the_mean_is_one_of_the_mean(self):
        assert ByChance(14.0, 4.0, 1).as_if_white(14.0) == pytest.approx(1.0)
        assert ByChance(14.0, 4.0, 2).as_if_white(18.0) == pytest.approx(4.0)
        assert ByChance(14.0, 4.0, 1).as_if_white(2.0) == 0.0

    def test_what_moves_no_column_is_left_alone(self):
        assert ByChance(0.0, 0.0, 0).as_if_white(40.0) == 40.0

    @given(st.floats(-5.0, 20.0), st.floats(0.1, 20.0), st.integers(0, 8), st.floats(0.0, 1e6))
    def test_it_is_never_larger_and_grows_with_the_gain(self, mean, spread, n_columns, gained):
        chance = ByChance(mean, spread, n_columns)
        less = chance.as_if_white(gained)
        assert 0.0 <= less <= gained
        assert less <= chance.as_if_white(1.1 * gained) + 1e-9


def test_many_draws_at_once_are_each_of_them_alone():
    problem, base, _ = drifting(0, LOAD, 300)
    contrasts = Contrasts.of(problem, base.model)
    draws = np.random.default_rng(0).normal(size=(*contrasts.signals.shape[:3], 5))
    for colour in ((np.zeros(0), 0.0), (np.ones(1), 0.95), (np.array([0.5, 0.3]), 0.0)):
        noise = Noise.white(np.ones(1)).with_colour(0, *colour)
        together, _ = contrasts.with_rests(draws).deviances(noise)
        for k in range(5):
            signals = np.concatenate([contrasts.signals[..., :-1], draws[..., k : k + 1]], axis=3)
            alone = replace(contrasts, signals=signals).under(noise)
            assert together[k] == pytest.approx(alone.deviance, abs=1e-6)


def test_noise_of_two_outputs_is_drawn_as_large_as_it_is():
    noise = 0.02 * np.random.default_rng(1).normal(size=(600, 2)) * [1.0, 5.0]
    problem, found = fitted(noise, outputs=(0, 1), n_windows=4)
    contrasts = Contrasts.of(problem, found.model)
    walk = Noise((np.ones(1), np.array([0.9])), np.array([0.01, 0.1]), (0.95, 0.0))
    draws = by_chance._drawn(contrasts, walk, np.random.RandomState(0)) * contrasts.unit[:, None]
    variance = (draws**2).mean(axis=(0, 3))  # (samples, outputs)
    assert variance[0, 0] == pytest.approx(1e-4, rel=0.5)
    assert variance[-1, 0] == pytest.approx(1e-4 * (1 + 599 * 0.05**2), rel=0.5)
    assert variance[:, 1].mean() == pytest.approx(0.01 / (1 - 0.81), rel=0.1)


def test_what_fits_gain_on_drifting_noise_is_as_large_as_simulated_and_no_chi_squared():
    gained, as_white, means, n_felt = [], [], [], []
    for seed in range(20):
        problem, base, more = drifting(seed, DRIFTING_DAMPING)
        contrasts = Contrasts.of(problem, base.model)
        own = own_noise(problem, base.model, contrasts=contrasts)
        taken = own.deviance - own_noise(problem, more.model).deviance
        chance = gained_by_chance(contrasts, Contrasts.of(problem, more.model), own.noise, seed)
        gained.append(taken)
        means.append(chance.mean)
        plain, fuller = (Candidate(found, problem.n_seen) for found in (base, more))
        as_white.append(as_if_white(problem, Beside.of(problem, plain), fuller, taken, seed))
        n_felt.append(max(fuller.felt.shape[1], 1))
    assert np.mean(means) == pytest.approx(np.mean(gained), abs=3 * np.std(gained) / np.sqrt(20))
    beyond = np.array(as_white) - n_felt  # chi-squared of as many degrees of freedom has that mean
    assert np.mean(beyond) < 3 * np.std(beyond) / np.sqrt(20)
    assert np.mean(gained) > np.mean(n_felt) + 1.0


def test_what_nobody_feels_counts_for_nothing():
    """Steps of a converter below the noise have no response that counts, a play at its bound none at all."""
    problem, base, _ = drifting(0, LOAD, 300)
    coarse = PlacedEffect(CATALOGUE["quantisation"], Port("output", 0), theta=(0.001,))
    both = fit(problem, base.model._replace(effects=(coarse, LOAD)), iterations=0)
    felt = Candidate(both, problem.n_seen).felt
    assert felt.shape[0] == 2
    contrasts = Contrasts.of(problem, both.model, felt)
    assert contrasts.n_others == felt.shape[1]
    assert Contrasts.of(problem, both.model).n_others == 1
    told = Contrasts.of(problem, both.model, np.array([[0.0], [2.0]]))
    np.testing.assert_allclose(told.signals, Contrasts.of(problem, both.model).signals)


def test_noise_that_does_not_drift_needs_no_draws(monkeypatch):
    noise = 0.02 * np.random.default_rng(1).normal(size=(600, 1))
    problem, found = fitted(noise, n_windows=4)
    more = fit(problem, found.model._replace(effects=(LOAD,)))
    monkeypatch.setattr(by_chance, "_drawn", None)
    plain, fuller = (Candidate(some, problem.n_seen) for some in (found, more))
    assert as_if_white(problem, Beside.of(problem, plain), fuller, 12.0) == 12.0

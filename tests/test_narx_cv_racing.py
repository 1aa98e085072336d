"""A race over folds leaves out nothing that could be chosen."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.identification.cross_validation.judged import Judged
from narx_sklearn.identification.cross_validation.racing import race, room_of_a_standard_error

seeds = st.integers(0, 10_000)


def random_table(seed):
    """Return scores of structures and sizes on folds, and weights of the folds."""
    rng = np.random.default_rng(seed)
    shape = rng.integers([1, 1, 1], [8, 5, 6])
    quality = rng.exponential(size=(shape[0], 1, 1))
    return 1.0 - quality * rng.exponential(size=shape), rng.dirichlet(np.ones(shape[2]))


def run(table, weights, **how):
    asked = []

    def judge(fold, wanted):
        asked.append((fold, wanted))
        return np.where(wanted, table[..., fold], -9e9), np.where(wanted, 1.0, -9e9)

    scores, counts = race(judge, weights, table.shape[:2], **how)
    return scores, counts, asked


@given(seeds, st.integers(1, 4))
def test_the_best_structures_come_out_as_without_a_race(seed, kept):
    table, weights = random_table(seed)
    scores, counts, asked = run(table, weights, kept=kept)
    full, raced = table @ weights, np.nan_to_num(scores @ weights, nan=-np.inf)
    leaders = np.argsort(-full.max(axis=1))[:kept]
    np.testing.assert_array_equal(np.argsort(-raced.max(axis=1))[:kept], leaders)
    np.testing.assert_array_equal(raced.argmax(axis=1)[leaders], full.argmax(axis=1)[leaders])
    judged = np.isfinite(scores)
    np.testing.assert_array_equal(scores[judged], table[judged])
    np.testing.assert_array_equal(np.isfinite(counts), judged)
    assert sum(wanted.sum() for _, wanted in asked) == judged.sum()  # nothing is judged twice


@given(seeds)
def test_whatever_is_within_a_standard_error_of_the_best_reaches_the_end(seed):
    table, weights = random_table(seed)
    scores, _, _ = run(table, weights, room=room_of_a_standard_error(weights))
    flat = table.reshape(-1, len(weights))
    judged = Judged([{}] * len(flat), flat, np.ones(flat.shape), weights)
    best = judged.pooled.argmax()
    near = judged.pooled >= judged.pooled[best] - judged.standard_error[best]
    assert np.isfinite(scores.reshape(flat.shape)[near]).all()


@given(seeds)
def test_the_room_of_a_standard_error_is_the_least_that_holds_for_all_errors(seed):
    _, weights = random_table(seed)
    some = np.random.default_rng(seed).exponential(size=(50, weights.size))
    errors = np.vstack([some, np.diag(1 / weights)])
    judged = Judged([{}] * len(errors), 1 - errors, np.ones(errors.shape), weights)
    ratio = (judged.standard_error / (1 - judged.pooled)).max()
    assert 1 + ratio == pytest.approx(room_of_a_standard_error(weights), rel=1e-9)


def test_sizes_go_on_together_where_they_are_asked_to():
    table = np.array([[[0.2, 0.0], [0.1, 0.0]], [[0.95, 0.0], [0.0, 0.0]], [[0.96, 0.95], [0.0, 0.0]]])
    alone, _, _ = run(table, np.array([0.5, 0.5]))
    whole, _, _ = run(table, np.array([0.5, 0.5]), whole=True)
    assert np.isfinite(alone).all(axis=2).tolist() == [[False, False], [True, False], [True, True]]
    assert np.isfinite(whole).all(axis=2).tolist() == [[False, False], [True, True], [True, True]]

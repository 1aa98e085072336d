"""Choices that are out of a race over folds could not have won it."""

from contextlib import nullcontext

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from narx_sklearn.identification.cross_validation.judged import Judged
from narx_sklearn.identification.cross_validation.race import race

SCORES = arrays(float, (5, 3, 4), elements=st.floats(-3.0, 1.0) | st.just(-1e6))
WEIGHTS = arrays(float, 4, elements=st.floats(0.01, 1.0)).map(lambda w: w / w.sum())


def raced(scores, weights, **settings):
    """Return what a race judged of a table of scores, and how many choices it asked for."""
    asked_for = []

    def open_fold(f):
        def judge(g, asked):
            asked_for.append(asked.sum())
            return scores[g, asked, f], np.full(asked.sum(), g)

        return nullcontext(judge)

    return *race(open_fold, weights, scores.shape[:2], **settings), sum(asked_for)


@given(SCORES, WEIGHTS, st.integers(1, 6))
def test_the_best_groups_are_judged_on_all_folds_and_what_is_out_is_worse(scores, weights, kept):
    found, counts, _ = raced(scores, weights, kept=kept)
    judged = ~np.isnan(found)
    assert (found == scores)[judged].all()
    assert (np.isnan(counts) == np.isnan(found)).all()
    errors = (1.0 - scores) @ weights
    complete = judged.all(axis=2)
    best = np.sort(errors.min(axis=1))[min(kept, 5) - 1]
    assert (errors[~complete] >= best * (1 - 1e-12)).all()
    assert np.count_nonzero(complete.any(axis=1)) >= min(kept, 5)


@given(SCORES, WEIGHTS)
def test_with_twice_the_errors_nothing_within_a_standard_error_of_the_best_is_out(scores, weights):
    found, _, _ = raced(scores, weights, slack=2.0)
    all_judged = Judged([], scores.reshape(15, 4), np.ones((15, 4)), weights)
    best = int(np.argmax(all_judged.pooled))
    near = all_judged.pooled >= all_judged.pooled[best] - all_judged.standard_error[best]
    complete = ~np.isnan(found.reshape(15, 4)).any(axis=1)
    assert complete[near & (all_judged.pooled > -1e5)].all()


@given(SCORES, WEIGHTS)
def test_without_a_bound_all_are_judged_once(scores, weights):
    found, _, n_asked = raced(scores, weights, slack=np.inf)
    np.testing.assert_array_equal(found, scores)
    assert n_asked == scores.size


def test_what_is_hopeless_on_the_heaviest_fold_is_judged_nowhere_else():
    scores = np.full((3, 1, 4), 0.9)
    scores[1:] = 0.1
    _, _, n_asked = raced(scores, np.array([0.1, 0.1, 0.7, 0.1]))
    assert n_asked == 4 + 1 + 1


@pytest.mark.parametrize("n_folds", [1, 2])
def test_few_folds_are_no_race(n_folds):
    scores = np.array([[0.5, 0.9], [0.4, 0.1]])[:, None, :n_folds]
    found, _, _ = raced(scores, np.full(n_folds, 1 / n_folds))
    np.testing.assert_array_equal(found[0], scores[0])

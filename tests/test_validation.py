"""Passes over long records are made in blocks: the blocks must not show."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn import _validation
from narx_sklearn._validation import all_finite, blocks, finite_columns, session_slices
from narx_sklearn.model import NARXModel, free_run


@given(st.lists(st.integers(0, 2), min_size=1, max_size=40), st.integers(1, 7))
def test_sessions_are_the_runs_of_equal_labels_whatever_the_blocks(labels, block_rows):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_validation, "BLOCK_ROWS", block_rows)
        pieces = session_slices(np.array(labels), len(labels))
    assert pieces[0].start == 0
    assert pieces[-1].stop == len(labels)
    for piece, after in pairwise(pieces):
        assert piece.stop == after.start
        assert labels[piece.stop - 1] != labels[after.start]
    assert all(len(set(labels[piece])) == 1 for piece in pieces)


@given(st.integers(0, 50), st.integers(1, 9))
def test_blocks_cover_every_sample_once(n_samples, block_rows):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_validation, "BLOCK_ROWS", block_rows)
        covered = [i for block in blocks(n_samples) for i in range(block.start, block.stop)]
    assert covered == list(range(n_samples))


def test_a_column_is_found_empty_only_if_all_its_blocks_are(monkeypatch):
    monkeypatch.setattr(_validation, "BLOCK_ROWS", 3)
    data = np.full((10, 3), np.nan)
    data[0, 0] = data[9, 2] = 1.0
    assert finite_columns(data).tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([1.0, -2.0], True),
        ([1.0, np.nan], False),
        ([np.inf, -np.inf], False),
        ([1e308, 1e308], False),
        ([], True),
    ],
)
def test_all_finite_errs_on_the_side_of_another_look(values, expected):
    assert all_finite(np.array(values)) is expected


def test_inputs_whose_sum_overflows_are_simulated_like_others():
    model = NARXModel.from_equations("0.5*y[k-1] + 1e-308*u[k-1]")
    np.testing.assert_allclose(free_run(model, np.full(4, 1e308), [0.0]).y[:, 0], [0.0, 1.0, 1.5, 1.75])

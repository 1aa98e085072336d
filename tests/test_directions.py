"""What parameters do together, and what they do not."""

import numpy as np
import pytest

from narx_sklearn.discrepancy.fitting.directions import ALIKE, directions_of


@pytest.fixture
def gram():
    """Return the inner products of five columns: two alike, one on its own, one of both, one of nothing."""
    columns = np.random.default_rng(0).normal(size=(50, 5)) * [1.0, 1e4, 1e-3, 1.0, 0.0]
    columns[:, 3] = 3.0 * columns[:, 0]
    return columns.T @ columns


def test_the_inverse_is_the_pseudo_inverse_of_the_scaled_matrix(gram):
    found = directions_of(gram)
    size = np.where(found.size > 0, found.size, 1.0)
    wanted = np.linalg.pinv(gram / np.outer(size, size), rcond=ALIKE, hermitian=True)
    np.testing.assert_allclose(found.inverse, wanted, atol=1e-12)


def test_two_that_do_the_same_are_silent_against_each_other_whatever_their_units(gram):
    np.testing.assert_allclose(
        np.abs(directions_of(gram).silent.T), [[0.5**0.5, 0, 0, 0.5**0.5, 0]], atol=1e-6
    )
    units = np.array([1e3, 1e-6, 1.0, 1e2, 1.0])
    scaled = directions_of(gram * np.outer(units, units))
    np.testing.assert_allclose(np.abs(scaled.silent), np.abs(directions_of(gram).silent), atol=1e-6)


@pytest.mark.parametrize("n", [0, 2])
def test_where_nothing_is_done_there_is_no_direction(n):
    found = directions_of(np.zeros((n, n)))
    assert found.vectors.shape == found.silent.shape == (n, 0)
    np.testing.assert_array_equal(found.inverse, np.zeros((n, n)))

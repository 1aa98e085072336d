"""The compressed record: R is the dense factor, parts merge in any order, columns combine."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.identification import Factor, compress
from narx_sklearn.identification.one_step.regressors import Candidates, chunks
from narx_sklearn.model import TermLibrary
from narx_sklearn.model.recording import Layout, lay_out

LAYOUT = Layout.of(("y",), ("u",), ())
LIBRARY = TermLibrary.polynomial(["y[k-1]", "y[k-2]", "u[k-1]", "u[k-2]"], degree=2)


def record(n_samples, seed=0, smooth=False):
    rng = np.random.default_rng(seed)
    X, y = rng.normal(size=(2, n_samples, 1))
    if smooth:
        time = np.linspace(0.0, 1.0, n_samples)[:, None]
        X, y = np.sin(3 * time) + 1e-4 * X, np.cos(2 * time) + 1e-4 * y
    return X, y


def dense_triangle(Psi, Y):
    """Return numpy's own QR factor of the tall matrix, its diagonal made positive."""
    R = np.linalg.qr(np.column_stack([Psi, Y]), mode="r")
    return R * np.where(np.diag(R) < 0, -1.0, 1.0)[:, None]


@pytest.mark.parametrize("n_samples", [40, 513, 2500])
def test_one_pass_gives_the_dense_factor(n_samples):
    X, y = record(n_samples)
    candidates = Candidates.of(LIBRARY, LAYOUT, lay_out(LAYOUT, X, y))
    expected = dense_triangle(candidates.matrix(), candidates.targets)
    factor = compress([candidates])
    np.testing.assert_allclose(factor.R, expected, atol=1e-12 * np.abs(expected).max())
    assert (factor.n_terms, factor.n_outputs, factor.n_samples) == (15, 1, n_samples - 2)


def test_a_fast_sampled_record_keeps_its_small_directions():
    """Neighbouring samples nearly equal: a Gram matrix would lose what R still holds."""
    X, y = record(3000, smooth=True)
    candidates = Candidates.of(LIBRARY, LAYOUT, lay_out(LAYOUT, X, y))
    Psi = candidates.matrix()
    smallest = np.linalg.svd(Psi, compute_uv=False)
    assert smallest[-1] < 1e-8 * smallest[0]
    R = compress([candidates]).Psi
    # rounding is relative to the largest singular value, not to its square
    np.testing.assert_allclose(
        np.linalg.svd(R, compute_uv=False), smallest, rtol=1e-6, atol=1e-13 * smallest[0]
    )


def small_directions(R):
    """Return each column's part orthogonal to all others, relative to its length."""
    norms = np.linalg.norm(R, axis=0)
    return 1.0 / np.linalg.norm(np.linalg.inv(R / norms), axis=1)


def fast_sampled(n_samples):
    """Return a smooth input and the slow system's response to it, neighbouring samples nearly equal."""
    rng = np.random.default_rng(1)
    X = np.cumsum(np.cumsum(rng.normal(size=(n_samples, 1)), axis=0), axis=0)
    X = np.sin(2 * X / np.abs(X).max() * np.linspace(1, 30, n_samples)[:, None])
    y = np.zeros((n_samples, 1))
    for k in range(1, n_samples):
        y[k] = y[k - 1] + 0.01 * (X[k - 1] - y[k - 1] - 0.3 * y[k - 1] ** 3)
    return X, y + 1e-6 * rng.normal(size=(n_samples, 1))


def test_inner_products_conditioned_by_a_sample_keep_the_digits_of_reflections():
    """The Gram matrix itself would keep none of the smallest directions: they are below 1e-8."""
    X, y = fast_sampled(20_000)
    library = TermLibrary.polynomial(["y[k-1]", "y[k-2]", "u[k-1]", "u[k-2]"], degree=3)
    candidates = Candidates.of(library, LAYOUT, lay_out(LAYOUT, X, y))
    expected = dense_triangle(candidates.matrix(), candidates.targets)
    directions = small_directions(expected)
    assert directions.min() < 1e-10
    R = compress([candidates]).R
    # a double's rounding over the smallest direction: neither way has more digits
    np.testing.assert_allclose(small_directions(R), directions, rtol=1e-4)
    np.testing.assert_allclose(R[:, -1], expected[:, -1], atol=1e-9 * np.linalg.norm(expected[:, -1]))


@pytest.mark.parametrize("rest", [0.0, 1e-9, 1e-2])
def test_a_sample_unlike_the_record_costs_no_digits(rest):
    """The input is at its level ``rest`` exactly where samples are taken, so that reflections take over."""
    X, y = record(6000)
    X[:-1][(np.arange(5999) - 1) % 11 == 0] *= rest
    y[:1500] *= rest
    candidates = Candidates.of(LIBRARY, LAYOUT, lay_out(LAYOUT, X, y))
    expected = dense_triangle(candidates.matrix(), candidates.targets)
    np.testing.assert_allclose(compress([candidates]).R, expected, atol=1e-11 * np.abs(expected).max())


def test_an_output_without_noise_keeps_a_residual_of_rounding():
    X, y = record(5000)
    y[2:] = 0.3 * X[1:-1] + 0.2 * X[1:-1] * X[:-2]
    candidates = Candidates.of(LIBRARY, LAYOUT, lay_out(LAYOUT, X, y))
    exact = candidates.restrict(TermLibrary.polynomial(["u[k-1]", "u[k-2]"], degree=2))
    R = compress([exact]).R
    assert abs(R[-1, -1]) < 1e-13 * np.linalg.norm(R[:, -1])


def test_chunks_of_a_long_record_give_the_factor_of_the_whole():
    X, y = record(700)
    X[100, 0] = np.nan
    sessions = np.repeat([0, 1], [300, 400])
    whole = compress([Candidates.of(LIBRARY, LAYOUT, lay_out(LAYOUT, X, y, sessions))])
    pieces = compress(chunks(LIBRARY, LAYOUT, X, y, sessions, size=90))
    assert pieces.n_samples == whole.n_samples == 700 - 2 * 2 - 2
    np.testing.assert_allclose(pieces.R, whole.R, atol=1e-12)


@given(st.permutations(range(4)), st.lists(st.integers(1, 30), min_size=4, max_size=4), st.integers(0, 9))
def test_parts_merge_in_any_order_and_grouping(order, lengths, seed):
    rng = np.random.default_rng(seed)
    parts = [rng.normal(size=(n, 4)) for n in lengths]
    whole = Factor.of(np.vstack(parts)[:, :3], np.vstack(parts)[:, 3])
    a, b, c, d = (Factor.of(parts[i][:, :3], parts[i][:, 3]) for i in order)
    for merged in (a.merge(b).merge(c).merge(d), a.merge(b).merge(c.merge(d)), a.merge(b.merge(c.merge(d)))):
        assert merged.n_samples == whole.n_samples
        # as many samples as columns, or fewer, may leave a diagonal of rounding whose sign is free
        np.testing.assert_allclose(merged.R.T @ merged.R, whole.R.T @ whole.R, atol=1e-11)


def test_the_empty_record_changes_nothing():
    rng = np.random.default_rng(0)
    factor = Factor.of(rng.normal(size=(20, 2)), rng.normal(size=20))
    merged = Factor.empty(2, 1).merge(factor)
    np.testing.assert_allclose(merged.R, factor.R, atol=1e-13)
    assert merged.n_samples == 20


def test_column_subsets_combinations_and_weights_are_factors_again():
    rng = np.random.default_rng(0)
    Psi, Y = rng.normal(size=(50, 4)), rng.normal(size=(50, 2))
    factor = Factor.of(Psi, Y)
    np.testing.assert_allclose(factor.subset([3, 1]).R, dense_triangle(Psi[:, [3, 1]], Y), atol=1e-12)
    T = rng.normal(size=(6, 5))
    combined = np.column_stack([Psi, Y]) @ T
    np.testing.assert_allclose(
        factor.combine(T).R, dense_triangle(combined[:, :3], combined[:, 3:]), atol=1e-12
    )
    np.testing.assert_allclose(factor.scaled(0.25).R, 0.5 * factor.R)
    assert factor.sum_of_squares(1) == pytest.approx(Y[:, 1] @ Y[:, 1])


def test_factors_of_different_candidates_are_refused():
    rng = np.random.default_rng(0)
    one, other = (Factor.of(rng.normal(size=(9, n)), rng.normal(size=9)) for n in (2, 3))
    with pytest.raises(ValueError, match="Factors of 2 and 3 regressors cannot be merged"):
        one.merge(other)


def test_no_data_is_an_error():
    with pytest.raises(ValueError, match="no data to compress"):
        compress([])

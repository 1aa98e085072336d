"""Forward selection without a regressor matrix, against Householder reflections of the whole matrix."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from narx_sklearn.identification import parse_constraints
from narx_sklearn.identification.one_step._products import SumPlan, term_values, weighted_sums
from narx_sklearn.identification.one_step.regressors import Candidates
from narx_sklearn.identification.one_step.screening import screen_terms, screening_cost
from narx_sklearn.identification.one_step.selection import COLLINEARITY, EXACT
from narx_sklearn.model import DifferenceSign, TermLibrary
from narx_sklearn.model.recording import Layout, lay_out


def householder_selection(Psi, y, n_terms):
    """Slow twin: reflect the whole matrix for every chosen column, recompute every score from scratch."""
    A = np.column_stack([Psi, y])
    norms = np.linalg.norm(Psi, axis=0)
    order, err = [], []
    for m in range(min(n_terms, *Psi.shape)):
        left = np.linalg.norm(A[m:, :-1], axis=0)
        independent = left > COLLINEARITY * norms
        independent[order] = False
        if not independent.any() or A[m:, -1] @ A[m:, -1] <= EXACT * (y @ y):
            break
        score = np.where(
            independent, (A[m:, -1] @ A[m:, :-1]) ** 2 / np.where(independent, left, 1.0) ** 2, -1.0
        )
        order.append(int(np.flatnonzero(score >= score.max() * (1 - 1e-13))[0]))
        err.append(score[order[-1]] / (y @ y))
        v = A[m:, order[-1]].copy()
        v[0] += np.copysign(np.linalg.norm(v), v[0])
        A[m:] -= np.outer(2.0 / (v @ v) * v, v @ A[m:])
    return order, np.array(err)


def gains_in_extended_precision(Psi, y, order):
    """Return the ERR of each term of ``order`` and the largest there was to choose from at its step."""
    A = np.column_stack([Psi, y]).astype(np.longdouble)
    norms = (A[:, :-1] ** 2).sum(axis=0)
    gains, best = [], []
    for m, index in enumerate(order):
        left = (A[m:, :-1] ** 2).sum(axis=0)
        independent = left > COLLINEARITY**2 * norms
        independent[order[:m]] = False
        score = np.where(independent, (A[m:, -1] @ A[m:, :-1]) ** 2 / np.where(independent, left, 1), 0) / (
            y @ y
        )
        gains.append(float(score[index]))
        best.append(float(score.max()))
        v = A[m:, index].copy()
        v[0] += np.copysign(np.sqrt(v @ v), v[0])
        A[m:] -= np.outer(2 / (v @ v) * v, v @ A[m:])
    return gains, best


def lagged(signal, lags):
    return [f"{signal}[k-{lag}]" for lag in range(1, lags + 1)]


def candidates_of(library, u, y, phi=(), sessions=None):
    """Lay out inputs and outputs, given as columns, without scaling."""
    u, y = (a[:, None] if a.ndim == 1 else a for a in (u, y))
    inputs = ("u",) if u.shape[1] == 1 else tuple(f"u{i + 1}" for i in range(u.shape[1]))
    outputs = ("y",) if y.shape[1] == 1 else tuple(f"y{i + 1}" for i in range(y.shape[1]))
    layout = Layout.of(outputs, inputs, phi)
    return Candidates.of(library, layout, lay_out(layout, u, y, sessions))


def simulated(rng, n_samples, noise=0.05):
    """Return input and output of a mildly nonlinear system of second order."""
    u = np.convolve(rng.normal(size=n_samples + 2), [0.5, 0.3, 0.2], mode="valid")
    e = noise * rng.normal(size=n_samples)
    y = np.zeros(n_samples)
    for k in range(2, n_samples):
        y[k] = (
            0.6 * y[k - 1]
            - 0.2 * y[k - 2]
            + 0.5 * u[k - 1]
            + 0.1 * u[k - 2] ** 2
            - 0.1 * np.tanh(y[k - 1]) ** 3
        )
        y[k] += e[k]
    return u, y


def fast_sampled(rng, n_samples, oversampling=50):
    """Return a smooth input and the output of a lag, so that neighbouring samples are nearly equal."""
    time = np.arange(n_samples) / oversampling
    u = sum(np.sin(f * time + rng.uniform(0, 6)) for f in (0.7, 1.3, 2.1, 3.7, 5.1))
    y = np.zeros(n_samples)
    for k in range(1, n_samples):
        y[k] = y[k - 1] + (u[k - 1] - y[k - 1] - 0.3 * y[k - 1] ** 3) / oversampling
    return u, y + 1e-6 * rng.normal(size=n_samples)


def assert_same_selection(candidates, n_terms, output=0):
    """Order equal, ERR equal to 1e-9 of itself (1e-12 of the whole where it is smaller)."""
    path = screen_terms(candidates, n_terms, output=output, n_threads=1)
    order, err = householder_selection(candidates.matrix(), candidates.targets[:, output], n_terms)
    assert path.order.tolist() == order
    np.testing.assert_allclose(path.err, err, rtol=1e-9, atol=1e-12)
    return path


# A case worked by hand.


def test_orthogonal_columns_have_the_err_of_their_coefficients():
    # u1 and u2 are orthogonal with equal norms, so y = 3 u1 + 4 u2 splits into 9/25 and 16/25.
    u = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
    candidates = candidates_of(TermLibrary(["u1[k]", "u2[k]"]), u, u @ [3.0, 4.0])
    path = screen_terms(candidates, 2, n_threads=1)
    assert [str(candidates.library[i]) for i in path.order] == ["u2[k]", "u1[k]"]
    np.testing.assert_allclose(path.err, [16 / 25, 9 / 25], rtol=1e-15)


# The kernels, compiled and as Python, against the matrix.


@pytest.mark.parametrize("as_python", [False, True])
@pytest.mark.parametrize(
    "library",
    [
        TermLibrary(["1"]),
        TermLibrary(["y[k-2]", "u[k-1]"]),
        TermLibrary.polynomial([*lagged("y", 2), *lagged("u", 2)], 3),
        TermLibrary.polynomial(lagged("u", 2), 4, include_constant=False),
        TermLibrary(["1", "y[k-1]^3*u[k-3]", "u[k-1]*u[k-2]", "y[k-4]^5"]),
    ],
    ids=["constant", "linear", "cubic", "quartic without constant", "sparse"],
)
def test_weighted_sums_are_those_of_the_matrix(library, as_python):
    rng = np.random.default_rng(0)
    candidates = candidates_of(library, rng.normal(size=47), rng.normal(size=47))
    Psi, weight = candidates.matrix(), rng.normal(size=candidates.n_rows)
    plan = SumPlan.of(library, candidates.layout.channels)
    kernel = weighted_sums.py_func if as_python else weighted_sums
    columns_of = term_values.py_func if as_python else term_values
    data = candidates.recording.data.reshape(-1), 2, candidates.rows
    for squared, expected in ((False, weight @ Psi), (True, weight @ Psi**2)):
        totals = np.zeros(plan.n_sums)
        kernel(*data, weight, squared, plan.steps, plan.products, plan.runs, totals)
        np.testing.assert_allclose(totals[plan.slots], expected, rtol=1e-12, atol=1e-12)
    columns = np.empty((len(library), candidates.n_rows))
    columns_of(*data, plan.steps, plan.factors, columns)
    np.testing.assert_array_equal(columns, Psi.T)


@given(st.integers(1, 4), st.sets(st.integers(0, 125), min_size=1), st.integers(0, 2**31))
def test_any_subset_of_a_library_is_summed_right(degree, kept, seed):
    rng = np.random.default_rng(seed)
    whole = TermLibrary.polynomial([*lagged("y", 3), *lagged("u", 2)], degree)
    library = whole.subset({i % len(whole) for i in kept})
    candidates = candidates_of(library, rng.normal(size=40), rng.normal(size=40))
    plan = SumPlan.of(library, candidates.layout.channels)
    totals = np.zeros(plan.n_sums)
    flat, weight = candidates.recording.data.reshape(-1), rng.normal(size=candidates.n_rows)
    weighted_sums(flat, 2, candidates.rows, weight, False, plan.steps, plan.products, plan.runs, totals)
    np.testing.assert_allclose(totals[plan.slots], weight @ candidates.matrix(), rtol=1e-11, atol=1e-11)


def test_a_dense_library_sums_every_term_once_and_nothing_else():
    plan = SumPlan.of(TermLibrary.polynomial(lagged("y", 12), 3), ("y",))
    assert plan.n_sums == 455
    assert len(plan.runs) == 13


# The order, against the twin.


@given(
    st.integers(1, 3),
    st.integers(1, 3),
    st.integers(1, 3),
    st.integers(20, 400),
    st.booleans(),
    st.integers(0, 2**31),
)
def test_order_and_err_are_those_of_householder_on_random_records(
    n_y, n_u, degree, n_samples, constant, seed
):
    u, y = simulated(np.random.default_rng(seed), n_samples)
    library = TermLibrary.polynomial(
        [*lagged("y", n_y), *lagged("u", n_u)], degree, include_constant=constant
    )
    assert_same_selection(candidates_of(library, u, y), 8)


@pytest.mark.parametrize("seed", range(4))
def test_order_and_err_are_those_of_householder_on_a_fast_sampled_record(seed):
    u, y = fast_sampled(np.random.default_rng(seed), 3000)
    library = TermLibrary.polynomial([*lagged("y", 3), *lagged("u", 3)], 3)
    candidates = candidates_of(library, u, y)
    assert np.linalg.cond(candidates.matrix()) > 1e9
    assert_same_selection(candidates, 15)


@pytest.mark.parametrize(
    "constraints",
    ["y[k-1] + y[k-2] = 0.5", ["y[k-1] = 0.3", "u[k-1] + u[k-2] - y[k-2] = 0.1"], "u[k-1]^2 = 0"],
)
def test_order_under_constraints_is_that_after_the_columns_they_leave_free(constraints):
    u, y = simulated(np.random.default_rng(4), 800)
    library = TermLibrary.polynomial([*lagged("y", 2), *lagged("u", 2)], 3)
    candidates = candidates_of(library, u, y)
    read = parse_constraints(constraints, library)
    path = screen_terms(candidates, 6, constraints=read, n_threads=1)
    Psi = candidates.matrix()
    others = np.setdiff1d(np.arange(len(library)), read.terms)
    fixed, free = read.solution_space()
    Q, _ = np.linalg.qr(
        Psi[:, read.terms] @ np.linalg.qr(free[read.terms])[0][:, : read.terms.size - len(read)]
    )
    target = candidates.targets[:, 0] - Psi @ fixed
    left = Psi[:, others] - Q @ (Q.T @ Psi[:, others])
    order, err = householder_selection(left, target - Q @ (Q.T @ target), 6)
    assert path.order.tolist() == others[order].tolist()
    remaining = np.sum((target - Q @ (Q.T @ target)) ** 2) / (target @ target)
    np.testing.assert_allclose(path.err, err * remaining, rtol=1e-8)


@pytest.mark.parametrize("scale", [1e-12, 1e-3, 1e6, 1e12])
def test_order_and_err_are_those_of_householder_in_any_unit(scale):
    u, y = simulated(np.random.default_rng(1), 600)
    library = TermLibrary.polynomial([*lagged("y", 2), *lagged("u", 2)], 3)
    assert_same_selection(candidates_of(library, scale * u, y / scale), 12)


def test_order_is_that_of_householder_with_a_large_offset():
    u, y = simulated(np.random.default_rng(2), 2000)
    library = TermLibrary.polynomial([*lagged("y", 2), *lagged("u", 2)], 3)
    path = assert_same_selection(candidates_of(library, u + 30.0, y + 300.0), 10)
    assert path.n_verified > 10


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="no extended precision on this platform")
@pytest.mark.parametrize("seed", [2, 15, 18])
def test_every_choice_is_the_best_in_extended_precision_where_doubles_have_few_digits_left(seed):
    u, y = simulated(np.random.default_rng(seed), 1500)
    library = TermLibrary.polynomial([*lagged("y", 3), *lagged("u", 3)], 3)
    candidates = candidates_of(library, u + 30.0, y + 300.0)
    path = screen_terms(candidates, 14, n_threads=1)
    gains, best = gains_in_extended_precision(candidates.matrix(), candidates.targets[:, 0], path.order)
    np.testing.assert_allclose(gains, best, rtol=1e-6)
    # left of these columns is 1e-7 of what they were: seven digits of 16 are gone in every method
    np.testing.assert_allclose(path.err, gains, rtol=1e-5)


def test_a_long_record_of_many_chunks_gives_the_same_order():
    u, y = simulated(np.random.default_rng(3), 20_000)
    assert_same_selection(
        candidates_of(TermLibrary.polynomial([*lagged("y", 2), *lagged("u", 2)], 3), u, y), 10
    )


def test_what_cannot_be_told_apart_by_downdating_is_decided_exactly():
    rng = np.random.default_rng(4)
    common, fine = rng.normal(size=800), rng.normal(size=(800, 4))
    u = common[:, None] + 1e-8 * fine
    y = common + 1e-8 * (fine @ [0.0, 3.0, 0.0, 1.0]) + 1e-10 * rng.normal(size=800)
    candidates = candidates_of(TermLibrary([f"u{i}[k]" for i in (1, 2, 3, 4)]), u, y)
    path = screen_terms(candidates, 4, n_threads=1)
    order, err = householder_selection(candidates.matrix(), y, 4)
    assert path.order.tolist() == order
    # Two columns that agree to 1e-8 leave eight digits of what separates them.
    np.testing.assert_allclose(path.err, err, rtol=1e-6)
    assert path.n_verified > 4


def test_several_outputs_phi_sessions_and_gaps():
    rng = np.random.default_rng(5)
    u, y = simulated(rng, 900)
    y = np.column_stack(
        [y, np.roll(y, 1) * 0.3 + np.sign(np.diff(u, prepend=0)) + 0.1 * rng.normal(size=900)]
    )
    u[400:405] = np.nan
    phi = (DifferenceSign("u", name="phi2"),)
    library = TermLibrary.polynomial(
        [*lagged("y1", 2), "y2[k-1]", *lagged("u", 2), "phi2[k-1]", "phi2[k]"], 2
    )
    candidates = candidates_of(library, u, y, phi, sessions=np.repeat([0, 1], 450))
    first = assert_same_selection(candidates, 8, output=0)
    second = assert_same_selection(candidates, 8, output=1)
    assert str(library[second.order[0]]) == "phi2[k]"
    assert first.order.tolist() != second.order.tolist()


# Laws.


@given(st.integers(60, 300), st.integers(1, 12), st.integers(0, 2**31))
@settings(max_examples=30)
def test_err_sums_to_the_share_of_the_output_that_the_terms_explain(n_samples, n_terms, seed):
    u, y = simulated(np.random.default_rng(seed), n_samples)
    candidates = candidates_of(TermLibrary.polynomial([*lagged("y", 2), *lagged("u", 2)], 2), u, y)
    path = screen_terms(candidates, n_terms, n_threads=1)
    target = candidates.targets[:, 0]
    Psi = candidates.matrix()[:, path.order]
    residual = target - Psi @ np.linalg.lstsq(Psi, target, rcond=None)[0]
    assert path.err.sum() == pytest.approx(1 - residual @ residual / (target @ target), abs=1e-12)


def test_threads_do_not_change_a_bit():
    u, y = fast_sampled(np.random.default_rng(6), 40_000)
    candidates = candidates_of(TermLibrary.polynomial([*lagged("y", 3), *lagged("u", 2)], 3), u, y)
    one, *others = [screen_terms(candidates, 6, n_threads=n) for n in (1, 2, 3, None)]
    for other in others:
        np.testing.assert_array_equal(one.order, other.order)
        np.testing.assert_array_equal(one.err, other.err)


def test_a_shorter_selection_is_the_beginning_of_a_longer_one():
    u, y = simulated(np.random.default_rng(7), 500)
    candidates = candidates_of(TermLibrary.polynomial([*lagged("y", 2), *lagged("u", 2)], 3), u, y)
    long = screen_terms(candidates, 12, n_threads=1)
    short = screen_terms(candidates, 5, n_threads=1)
    np.testing.assert_array_equal(short.err, long.err[:5])
    np.testing.assert_array_equal(short.order, long.order[:5])
    assert long.n_passes == 13


# How it ends, and what is dependent.


def test_a_constant_input_leaves_one_of_its_copies():
    _, y = simulated(np.random.default_rng(8), 400)
    library = TermLibrary.polynomial([*lagged("y", 2), *lagged("u", 2)], 2)
    path = screen_terms(candidates_of(library, np.full(400, 0.7), y), 15, n_threads=1)
    assert path.stopped_at == "exhausted"
    # Independent are 1 and the five products of y; a copy of the constant is never chosen twice.
    assert path.order.size == 6
    assert sorted([*path.order, *path.collinear]) == list(range(len(library)))


def test_equal_columns_are_decided_by_the_order_of_the_library():
    rng = np.random.default_rng(9)
    u = np.repeat(rng.normal(size=(300, 1)), 3, axis=1)
    candidates = candidates_of(TermLibrary(["u1[k]", "u2[k]", "u3[k]"]), u, u[:, 0] + rng.normal(size=300))
    path = screen_terms(candidates, 3, n_threads=1)
    assert path.order.tolist() == [0]
    assert path.collinear.tolist() == [1, 2]
    assert path.stopped_at == "exhausted"


def test_a_column_of_zeros_is_reported_and_not_chosen():
    rng = np.random.default_rng(10)
    u = np.column_stack([np.zeros(100), rng.normal(size=100)])
    path = screen_terms(candidates_of(TermLibrary(["u1[k]", "u2[k]"]), u, u[:, 1] + 1.0), 2, n_threads=1)
    assert (path.order.tolist(), path.collinear.tolist()) == ([1], [0])
    nothing = screen_terms(candidates_of(TermLibrary(["u1[k]"]), u, u[:, 1]), 2, n_threads=1)
    assert (nothing.order.size, nothing.err.size, nothing.stopped_at) == (0, 0, "exhausted")


def test_a_noise_free_model_is_found_and_ends_the_selection():
    u, y = simulated(np.random.default_rng(11), 500)
    y[2:] = 0.5 * u[1:-1] - 0.2 * u[:-2] * u[1:-1]
    library = TermLibrary.polynomial(lagged("u", 3), 3)
    path = screen_terms(candidates_of(library, u, y), 10, n_threads=1)
    assert {str(library[i]) for i in path.order} == {"u[k-1]", "u[k-1]*u[k-2]"}
    assert path.stopped_at == "explained"


def test_no_more_terms_than_samples():
    rng = np.random.default_rng(12)
    candidates = candidates_of(
        TermLibrary.polynomial(lagged("u", 3), 3), rng.normal(size=8), rng.normal(size=8)
    )
    path = screen_terms(candidates, 20, n_threads=1)
    assert path.order.size == candidates.n_rows == 5
    assert path.err.sum() == pytest.approx(1.0, abs=1e-12)


# Cost.


def test_memory_is_a_column_for_every_selected_term():
    u, y = simulated(np.random.default_rng(13), 30_000)
    candidates = candidates_of(TermLibrary.polynomial([*lagged("y", 5), *lagged("u", 5)], 3), u, y)
    screen_terms(candidates, 2, n_threads=1)
    tracemalloc.start()
    screen_terms(candidates, 5, n_threads=1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 12 * 8 * candidates.n_rows  # the matrix has 286 columns


def test_cost_grows_with_samples_and_terms_and_undercuts_the_factor_for_large_libraries():
    large = TermLibrary.polynomial(lagged("y", 20), 3)
    cost = screening_cost(1000, large, 15)
    assert screening_cost(3000, large, 15) == pytest.approx(3 * cost)
    assert screening_cost(1000, large, 30) > 1.9 * cost
    assert cost < 0.05 * 2 * 1000 * len(large) ** 2
    # every pass multiplies and adds each term at least once
    assert cost > 15 * 1000 * 2 * len(large)


# Messages.


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"n_terms": 0}, ValueError, "n_terms must be at least 1, got 0"),
        ({"n_terms": 2.5}, TypeError, r"n_terms must be an integer, got 2\.5 of type float"),
        ({"n_terms": None}, TypeError, "n_terms must be an integer, got None"),
        ({"output": 1}, ValueError, "output must be between 0 and 0"),
        ({"n_threads": 0}, ValueError, "n_threads must be at least 1"),
        ({"n_threads": "all"}, TypeError, "n_threads must be an integer, got 'all'"),
    ],
)
def test_wrong_arguments_are_named(arguments, error, message):
    rng = np.random.default_rng(14)
    candidates = candidates_of(TermLibrary(["u[k-1]"]), rng.normal(size=20), rng.normal(size=20))
    with pytest.raises(error, match=message):
        screen_terms(candidates, **{"n_terms": 1, **arguments})


def test_a_recording_without_usable_samples_is_refused():
    candidates = candidates_of(TermLibrary(["u[k-9]"]), np.ones(5), np.ones(5))
    with pytest.raises(ValueError, match=r"No sample is usable.*longest lag \(9\)"):
        screen_terms(candidates, 1)


def test_an_output_of_zeros_is_refused():
    candidates = candidates_of(TermLibrary(["u[k-1]"]), np.ones(20), np.zeros(20))
    with pytest.raises(ValueError, match=r"output 'y' is zero at all 19 usable"):
        screen_terms(candidates, 1)


def test_an_empty_library_is_refused():
    candidates = candidates_of(TermLibrary(), np.ones(20), np.ones(20))
    with pytest.raises(ValueError, match="holds no candidate terms"):
        screen_terms(candidates, 1)

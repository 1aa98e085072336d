"""Free run, one step and k steps ahead, sensitivities: against slow twins, by hand, and at the edges."""

import warnings
from contextlib import contextmanager
from itertools import groupby, pairwise

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.model import (
    AbsoluteDifference,
    AsymmetricSign,
    Difference,
    DifferenceSign,
    FunctionPhi,
    HystereticOperator,
    NARXModel,
    Play,
    Polynomial,
    SmoothSign,
    TermLibrary,
    Variable,
    free_run,
    kernels,
    operators,
    predict_k_steps,
    predict_one_step,
    steady_state,
)
from narx_sklearn.model.simulation import layout_of, program_of, simulation_state

BOUND = 1e3  # the random models below may diverge; both sides stop here
MODES = pytest.mark.parametrize("mode", ["compiled", "python"])


@contextmanager
def kernels_as(mode):
    """Run the kernels compiled, or as the Python functions they are compiled from."""
    with pytest.MonkeyPatch.context() as patch:
        if mode == "python":
            for module in (kernels, operators):
                for name, function in list(vars(module).items()):
                    if hasattr(function, "py_func"):
                        patch.setattr(module, name, function.py_func)
        yield


# --- slow twins: equations evaluated term by term from lists of raw values


def twin_phi(phi, values, outputs, k, start, hold):
    """Return a phi regressor at ``k``; ``outputs`` from ``start`` on are simulated.

    Before the first sample signals are held (``hold``) or unknown; an unknown value gives NaN.
    """
    if not hold and k < phi.reach:
        return np.nan
    window = [values[signal][max(k - lag, 0)] for signal in phi.signals for lag in range(phi.reach + 1)]
    if not np.isfinite(window).all():
        return np.nan
    if isinstance(phi, FunctionPhi):
        return float(phi.function(*(np.float64(values[v.signal][max(k - v.lag, 0)]) for v in phi.of)))
    source = values[phi.signal]
    now, change = source[k], source[k] - source[max(k - 1, 0)]
    if isinstance(phi, Difference):
        return change
    if isinstance(phi, DifferenceSign):
        return float(np.sign(change))
    if isinstance(phi, AbsoluteDifference):
        return abs(change)
    if isinstance(phi, SmoothSign):
        return float(np.tanh(change / phi.width))
    if isinstance(phi, AsymmetricSign):
        branch = phi.rising if change > 0 else phi.falling if change < 0 else ()
        return sum(c * now**power for power, c in enumerate(branch))
    if phi.signal in outputs and k >= start > 0 and not np.isfinite(source[start - 1]):
        return np.nan  # the memory at the start of the simulation is not known
    begin = k
    while begin > 0 and np.isfinite(source[begin - 1]):
        begin -= 1
    if isinstance(phi, Play):
        held = 0.0
        for value in source[begin : k + 1]:
            held = max(min(value + phi.radius, held), value - phi.radius)
        return held
    return float(phi.run(np.array(source[begin : k + 1]))[-1])


def twin_step(model, values, k, start, hold):
    """Return all outputs at ``k``, in deviations from the operating point."""
    phis = {phi.name: phi for phi in model.phi}
    origin = dict(model.origin)
    totals = []
    for side in model.equations.values():
        total = 0.0
        for term, product in side.items:
            for variable in term.expanded:
                past = k - variable.lag
                if past < 0:
                    product *= np.nan
                elif variable.signal in phis:
                    product *= twin_phi(phis[variable.signal], values, model.outputs, past, start, hold)
                else:
                    product *= values[variable.signal][past] - origin.get(variable.signal, 0.0)
            total += product
        totals.append(total)
    return np.array(totals)


def named_columns(names, array):
    return {name: list(map(float, column)) for name, column in zip(names, array.T, strict=True)}


def append_outputs(model, values, totals):
    for name, total in zip(model.outputs, totals, strict=True):
        values[name].append(float(total) + model.origin.get(name, 0.0))


def twin_free_run(model, X, start):
    """Return the free run of one gapless piece, and where it stopped."""
    values = named_columns(model.inputs, X) | named_columns(model.outputs, start)
    stopped_at = None
    for k in range(len(start), len(X)):
        totals = twin_step(model, values, k, len(start), hold=True)
        if not np.all(np.abs(totals) <= BOUND):
            stopped_at = k
            break
        append_outputs(model, values, totals)
    y = np.full((len(X), len(model.outputs)), np.nan)
    simulated = np.array([values[name] for name in model.outputs]).T
    y[: len(simulated)] = simulated[: len(X)]
    return y, stopped_at


def twin_k_steps(model, X, y, steps):
    """Return the k-step predictions of one session."""
    predictions = np.full(y.shape, np.nan)
    depth = max(model.max_lag, 1 if steps > 1 else 0)
    for k in range(steps - 1 + depth, len(X)):
        start = k - steps + 1
        values = named_columns(model.inputs, X) | named_columns(model.outputs, y[:start])
        for j in range(start, k + 1):
            totals = twin_step(model, values, j, start, hold=False)
            if not np.all(np.abs(totals) <= BOUND):
                break
            append_outputs(model, values, totals)
        else:
            predictions[k] = [values[name][k] for name in model.outputs]
    return predictions


def by_session(sessions, n_samples):
    """Return a slice for every run of equal labels."""
    labels = [0] * n_samples if sessions is None else sessions
    edges = [0, *(k for k in range(1, n_samples) if labels[k] != labels[k - 1]), n_samples]
    return [slice(a, b) for a, b in pairwise(edges)]


# --- random models and records

SMOOTH_KINDS = (
    lambda s: Difference(s),
    lambda s: AbsoluteDifference(s),
    lambda s: SmoothSign(s, width=0.5),
    lambda s: AsymmetricSign(s, rising=(0.3, 0, 0.5), falling=(-1, 0.2)),
    lambda s: Play(s, radius=0.3),
)
ALL_KINDS = (*SMOOTH_KINDS, lambda s: DifferenceSign(s), lambda s: HystereticOperator(s))


@st.composite
def models(draw, kinds=ALL_KINDS, functions=False):
    """Models of one or two inputs and outputs, with phi regressors and terms of up to four factors."""
    outputs = ("y", "z")[: draw(st.integers(1, 2))]
    inputs = ("u", "v")[: draw(st.integers(1, 2))]
    signals = outputs + inputs
    phi = [
        kind(draw(st.sampled_from(signals))) for kind in draw(st.lists(st.sampled_from(kinds), max_size=3))
    ]
    if functions:
        phi.append(FunctionPhi(lambda y, u: np.cos(y - u), ["y[k]", "u[k-2]"]))
        phi.append(FunctionPhi(lambda u, y: u * y, ["u[k-1]", "y[k-1]"]))
    variables = [Variable(s, lag) for s in outputs for lag in (1, 2, 3)]
    variables += [Variable(s, lag) for s in inputs for lag in (0, 1, 3)]
    for number, p in enumerate(phi, start=1):
        variables += [
            Variable(f"phi{number}", lag) for lag in (0, 1, 2) if lag or not p.signals & set(outputs)
        ]
    random = np.random.default_rng(draw(st.integers(0, 999)))
    products = st.lists(st.sampled_from(variables), max_size=4).map(lambda v: "*".join(map(str, v)) or "1")
    equations = {
        output: Polynomial(
            {term: random.uniform(-0.6, 0.6) for term in draw(st.lists(products, min_size=1, max_size=5))}
        )
        for output in outputs
    }
    origin = {"y": 0.3, "u": -0.2} if draw(st.booleans()) else {}
    return NARXModel.from_equations(equations, outputs=outputs, inputs=inputs, phi=phi, origin=origin)


@st.composite
def records(draw, model, gaps=True, sessions=True):
    """Inputs and outputs for a model: a few samples, with gaps and sessions."""
    n_samples = draw(st.integers(1, 16))
    random = np.random.default_rng(draw(st.integers(0, 999)))
    X = random.uniform(-1, 1, (n_samples, len(model.inputs)))
    y = random.uniform(-1, 1, (n_samples, len(model.outputs)))
    if gaps:
        holes = st.lists(st.integers(0, n_samples - 1), max_size=2)
        X[draw(holes), draw(st.integers(0, X.shape[1] - 1))] = np.nan
        y[draw(holes), draw(st.integers(0, y.shape[1] - 1))] = np.nan
    labels = st.lists(st.sampled_from("ab"), min_size=n_samples, max_size=n_samples)
    return X, y, draw(st.none() | labels) if sessions else None


def close(actual, expected):
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-11)


# --- laws against the twins


@MODES
@given(data=st.data())
def test_free_run_is_its_slow_twin_in_every_session_and_between_gaps(mode, data):
    model = data.draw(models(functions=data.draw(st.booleans())))
    X, _, sessions = data.draw(records(model))
    n_init = max(len(X), model.max_lag)
    y_init = np.random.default_rng(0).uniform(-1, 1, (n_init, len(model.outputs)))
    expected, stops = np.full((len(X), len(model.outputs)), np.nan), []
    for session in by_session(sessions, len(X)):
        finite = np.isfinite(X[session]).all(axis=1)
        for known, group in groupby(
            range(session.start, session.stop), key=lambda k: finite[k - session.start]
        ):
            rows = list(group)
            if known:
                start = y_init[rows[: model.max_lag]]
                expected[rows], stopped = twin_free_run(model, X[rows], start)
                stops += [] if stopped is None else [rows[0] + stopped]
    with kernels_as(mode), warnings.catch_warnings():
        warnings.simplefilter("ignore", DivergenceWarning)
        run = free_run(model, X, y_init, sessions=sessions, bound=BOUND)
    close(run.y, expected)
    assert run.stopped_at == min(stops, default=None)


@MODES
@given(data=st.data())
def test_one_step_prediction_is_its_slow_twin(mode, data):
    model = data.draw(models(functions=data.draw(st.booleans())))
    X, y, sessions = data.draw(records(model))
    with kernels_as(mode):
        predictions = predict_one_step(model, X, y, sessions=sessions)
    for session in by_session(sessions, len(X)):
        close(predictions[session], twin_k_steps(model, X[session], y[session], 1))


@MODES
@given(data=st.data(), steps=st.integers(2, 4))
def test_k_step_prediction_is_its_slow_twin(mode, data, steps):
    model = data.draw(models())
    X, y, sessions = data.draw(records(model))
    with kernels_as(mode):
        predictions = predict_k_steps(model, X, y, steps, sessions=sessions, bound=BOUND)
    for session in by_session(sessions, len(X)):
        close(predictions[session], twin_k_steps(model, X[session], y[session], steps))


@given(data=st.data(), steps=st.integers(1, 3))
def test_on_the_models_own_free_run_every_prediction_is_exact(data, steps):
    model = data.draw(models())
    X, _, _ = data.draw(records(model, gaps=False, sessions=False))
    start = np.random.default_rng(1).uniform(-1, 1, (max(model.max_lag, 1), len(model.outputs)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DivergenceWarning)
        y = free_run(model, X, start, bound=BOUND).y
    predictions = predict_k_steps(model, X, y, steps)
    known = np.isfinite(predictions)
    close(predictions[known], y[known])


@given(data=st.data())
def test_operating_point_and_expanded_model_simulate_alike(data):
    model = data.draw(models())
    X, _, _ = data.draw(records(model, gaps=False, sessions=False))
    start = np.random.default_rng(2).uniform(-1, 1, (max(model.max_lag, 1), len(model.outputs)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DivergenceWarning)
        first, second = (free_run(m, X, start, bound=10.0).y for m in (model, model.expanded()))
    both = np.isfinite(first) & np.isfinite(second)  # the bound is on deviations, so the ends may differ
    np.testing.assert_allclose(first[both], second[both], rtol=1e-6, atol=1e-9)


@MODES
@given(data=st.data())
def test_sensitivities_are_the_derivatives_of_the_free_run(mode, data):
    model = data.draw(models(kinds=SMOOTH_KINDS))
    X, target, _ = data.draw(records(model, sessions=False))
    X = np.nan_to_num(X, nan=0.1)
    layout, program = layout_of(model), program_of(model)
    n_outputs, n_channels = len(model.outputs), len(layout.channels)
    first = min(max(model.max_lag, 1), len(X))
    y_init = np.random.default_rng(3).uniform(-1, 1, target.shape)
    weights = np.array([1.0, 0.25])[:n_outputs]

    def simulate(coefficients):
        flat, state, phis = simulation_state(layout, X, y_init, first)
        moved = program._replace(coefficients=coefficients)
        end = kernels.free_run(flat, n_channels, first, len(X), moved, phis, state, BOUND)
        return flat.reshape(-1, n_channels)[first:end, :n_outputs], end

    flat, state, phis = simulation_state(layout, X, y_init, first)
    n_terms = program.coefficients.size
    gram, gradients = np.zeros((n_terms, n_terms)), np.zeros((2, n_terms))
    with kernels_as(mode):
        end, loss = kernels.free_run_sensitivity(
            flat, n_channels, first, len(X), program, phis, state, BOUND,
            target, weights, max(model.max_lag, 1), gram, gradients,
        )  # fmt: skip
    y, expected_end = simulate(program.coefficients)
    assert end == expected_end
    if end < len(X):
        return
    step = 1e-6
    J = np.array(
        [
            (simulate(program.coefficients + e)[0] - simulate(program.coefficients - e)[0]) / (2 * step)
            for e in step * np.eye(n_terms)
        ]
    )
    residual = target[first:] - y
    known = np.isfinite(residual)
    weighted = known * weights
    residual = np.where(known, residual, 0.0)
    scale = max(1.0, np.abs(J).max(initial=0.0)) ** 2
    np.testing.assert_allclose(loss, np.sum(weighted * residual**2), rtol=1e-9)
    window = np.arange(2)[:, None] == np.arange(len(y)) * 2 // max(len(y), 1)  # first and second half
    expected_gradients = np.einsum("wk,tko,ko->wt", window, J, weighted * residual)
    np.testing.assert_allclose(gradients, expected_gradients, atol=1e-6 * scale)
    expected_gram = np.tril(np.einsum("tko,sko,ko->ts", J, J, weighted))
    np.testing.assert_allclose(gram, expected_gram, atol=1e-6 * scale)


@MODES
def test_term_columns_are_the_products_of_lagged_channels(mode):
    flat = np.random.default_rng(0).normal(size=(8, 2))
    rows = np.array([2, 3, 5, 7])
    # 1, y[k-1], y[k-1] u[k], y[k-1] u[k] y[k-2]
    steps, parents = np.array([kernels.NO_STEP, -2, 1, -4]), np.array([-1, -1, 1, 2])
    columns = np.empty((4, rows.size))
    with kernels_as(mode):
        kernels.term_columns(flat.reshape(-1), 2, rows, steps, parents, columns)
    y1, u, y2 = flat[rows - 1, 0], flat[rows, 1], flat[rows - 2, 0]
    np.testing.assert_array_equal(columns, [np.ones(4), y1, y1 * u, y1 * u * y2])


def test_terms_of_every_length_are_summed():
    text = "2 + y[k-1] + 3*y[k-1]*u[k] + 5*y[k-1]*u[k]*u[k-1] + 7*y[k-1]^2*u[k]*u[k-1] + 11*u[k]^5"
    model = NARXModel.from_equations(text)
    predicted = predict_one_step(model, [2.0, 3.0], [1.0, 0.0])
    assert predicted[1, 0] == 2 + 1 + 3 * 3 + 5 * 6 + 7 * 6 + 11 * 243


# --- worked by hand


def test_delay_zero_reads_the_current_input():
    model = NARXModel.from_equations("0.5*y[k-1] + u[k]^2")
    run = free_run(model, [9.0, 1.0, 2.0, 0.0], y_init=[4.0])
    assert run.y.ravel().tolist() == [4.0, 3.0, 5.5, 2.75]
    assert (run.stopped_at, run.started_from) == (None, "y_init")


def test_second_output_reads_the_first_of_the_sample_before():
    model = NARXModel.from_equations({"a": "a[k-1] + u[k-1]", "b": "2*a[k-1]"})
    run = free_run(model, [1.0, 2.0, 3.0], y_init=[[0.0, 7.0]])
    assert run.y.tolist() == [[0.0, 7.0], [1.0, 0.0], [3.0, 2.0]]


def test_play_of_the_output_is_stepped_inside_the_free_run():
    # w follows y at distance 1: y = 0, 3, 4, 4.5 gives w = 0, 2, 3, 3.5; y[k] = y[k-1] + u[k-1] - w[k-1]/2
    model = NARXModel.from_equations("y[k-1] + u[k-1] - 0.5*phi1[k-1]", phi=[Play("y", radius=1.0)])
    assert free_run(model, [3.0, 2.0, 2.0, 0.0], y_init=[0.0]).y.ravel().tolist() == [0.0, 3.0, 4.0, 4.5]


def test_function_of_the_output_is_called_inside_the_free_run():
    model = NARXModel.from_equations("phi1[k-1] + u[k-1]", phi=[FunctionPhi(np.abs, ["y[k]"])])
    assert free_run(model, [-3.0, 1.0, 0.0], y_init=[-1.0]).y.ravel().tolist() == [-1.0, -2.0, 3.0]


def test_function_of_the_output_that_fails_stops_the_run_there():
    model = NARXModel.from_equations(
        "phi1[k-1] + u[k]", phi=[FunctionPhi(lambda y: np.where(y > 0, y, np.nan), ["y[k]"])]
    )
    with pytest.warns(DivergenceWarning, match="at sample 3"):
        run = free_run(model, [0.0, 1.0, -5.0, 1.0, 1.0], y_init=[1.0])
    np.testing.assert_array_equal(run.y.ravel(), [1.0, 2.0, -3.0, np.nan, np.nan])


# --- the published model (4.5) of Example 4.1

PIEZO = NARXModel.from_equations(
    {
        "y[k-1]": 1.0,
        "phi1[k-1]": 0.77,
        "phi2[k-1]*phi1[k-1]*u[k-1]": 1.42e-2,
        "phi2[k-1]*phi1[k-1]*y[k-1]": -9.60e-3,
        "phi1[k-1]*u[k-1]^2": 3.16e-4,
        "phi1[k-1]*u[k-1]*y[k-1]": -2.47e-4,
    },
    phi=[Difference("u"), DifferenceSign("u")],
    sampling_period=0.001,
)


def piezo_input(periods=3):
    return 70 * np.sin(2 * np.pi * np.arange(1000 * periods) * PIEZO.sampling_period)


def test_published_model_is_simulated_as_its_printed_equation():
    u = piezo_input()
    y = [0.0, 0.0]
    for k in range(2, u.size):
        d = u[k - 1] - u[k - 2]
        s = np.sign(d)
        y.append(
            y[k - 1]
            + 0.77 * d
            + 1.42e-2 * s * d * u[k - 1]
            - 9.60e-3 * s * d * y[k - 1]
            + 3.16e-4 * d * u[k - 1] ** 2
            - 2.47e-4 * d * u[k - 1] * y[k - 1]
        )
    np.testing.assert_allclose(free_run(PIEZO, u, y_init=y[:2]).y.ravel(), y, rtol=1e-10, atol=1e-10)


def test_published_model_draws_a_closed_loop_that_is_odd_and_lags_behind_the_input():
    y = free_run(PIEZO, piezo_input(periods=15)).y.ravel()
    period = y[-1000:]
    np.testing.assert_allclose(y[-2000:-1000], period, atol=1e-9)
    # every term is odd in (u, y), so half a period later the loop passes the opposite point
    np.testing.assert_allclose(np.roll(period, 500), -period, atol=1e-9)
    assert period[0] < -10  # u rises through zero: loading runs below unloading


def test_published_model_stays_where_the_input_stops_in_either_branch():
    # Lemma 4.1: with theta_1 = 1 any output is a steady state once phi1 = 0
    u = piezo_input()
    for stop in (2100, 2400):  # u equals itself at both: loading and unloading through the same value
        held = np.append(u[:stop], np.full(100_000, u[stop - 1]))
        y = free_run(PIEZO, held).y.ravel()
        assert np.ptp(y[stop + 1 :]) == 0.0


# --- steady state


def test_steady_state_of_a_model_without_outputs_is_its_static_value():
    model = NARXModel.from_equations("u[k-1]^2 + 1", origin={"y": 10.0, "u": 1.0})
    assert steady_state(model, [3.0]).tolist() == [15.0]


def test_of_two_fixed_points_the_stable_one_is_returned():
    # y = y^2 / 2 + u: fixed points 1 -+ sqrt(1 - 2 u); slope y < 1 only at the lower one
    model = NARXModel.from_equations("0.5*y[k-1]^2 + u[k-1]")
    assert steady_state(model, [0.375])[0] == pytest.approx(0.5, rel=1e-12)


@pytest.mark.parametrize(
    "equation", ["y[k-1] + phi1[k-1]", "2*y[k-1] + u[k]", "y[k-1]^2 + 1 + u[k]^2", "-1.1*y[k-2] + u[k]"]
)
def test_model_without_a_stable_fixed_point_starts_at_its_operating_point(equation):
    model = NARXModel.from_equations(equation, phi=[Difference("u")], origin={"y": 5.0})
    assert steady_state(model, [1.0]).tolist() == [5.0]


def test_steady_state_of_two_outputs_solves_both_equations():
    model = NARXModel.from_equations(
        {"a": "0.5*a[k-1] + 0.2*b[k-1] + u[k]", "b": "0.3*a[k-1]"}, inputs=("u",), origin={"a": 1.0}
    )
    # in deviations: a = a/2 + 0.06 a + u
    np.testing.assert_allclose(steady_state(model, [2.2]), [6.0, 1.5], rtol=1e-6)


def test_steady_state_of_a_slow_or_moving_model_of_outputs_phi():
    slow = NARXModel.from_equations("0.999*y[k-1] + 0.001*u[k-1] - 0.1*phi1[k-1]", phi=[Difference("y")])
    assert steady_state(slow, [3.0])[0] == pytest.approx(3.0, rel=1e-5)
    swinging = NARXModel.from_equations("u[k] - y[k-1] + 0.1*phi1[k-1]", phi=[DifferenceSign("y")])
    assert steady_state(swinging, [1.0]).tolist() == [0.0]


@given(data=st.data())
def test_run_started_from_rest_stays_at_rest_while_the_input_does(data):
    model = data.draw(models(kinds=(Difference, AbsoluteDifference)))
    u = np.full((6, len(model.inputs)), 0.4)
    rest = steady_state(model, u[0])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DivergenceWarning)
        run = free_run(model, u)
    assert run.started_from == "steady state"
    at_operating_point = rest == [model.origin.get(output, 0.0) for output in model.outputs]
    if not at_operating_point.all():
        np.testing.assert_allclose(run.y, np.tile(rest, (6, 1)), rtol=1e-5, atol=1e-7)


@pytest.mark.parametrize("u", [[1.0, 2.0], [], [np.nan]])
def test_steady_state_wants_one_finite_value_for_each_input(u):
    with pytest.raises(ValueError, match=r"one finite value for each of the inputs \['u'\]"):
        steady_state(NARXModel.from_equations("u[k]"), u)


# --- initial conditions, sessions and gaps


def test_each_session_starts_from_its_own_measured_outputs():
    model = NARXModel.from_equations("y[k-1] + u[k-1]")
    y = [1.0, 0.0, 0.0, 5.0, 0.0, 9.0]
    run = free_run(model, np.ones(6), y, sessions=[1, 1, 1, 2, 2, 3])
    assert run.y.ravel().tolist() == [1.0, 2.0, 3.0, 5.0, 6.0, 9.0]
    assert run.started_from == "y_init"


def test_after_a_gap_of_the_input_the_run_starts_anew():
    model = NARXModel.from_equations("0.5*y[k-1] + u[k-1]")
    X = np.array([1.0, 1.0, np.nan, 2.0, 2.0])
    measured = free_run(model, X, [0.0, 0.0, 0.0, 7.0, 0.0])
    np.testing.assert_array_equal(measured.y.ravel(), [0.0, 1.0, np.nan, 7.0, 5.5])
    short = free_run(model, X, [0.0])  # nothing measured after the gap: rest at 2 / (1 - 0.5)
    np.testing.assert_array_equal(short.y.ravel(), [0.0, 1.0, np.nan, 4.0, 4.0])
    assert (measured.started_from, short.started_from) == ("y_init", "both")


def test_missing_initial_outputs_are_replaced_by_the_steady_state():
    model = NARXModel.from_equations("0.5*y[k-1] + u[k-1]")
    run = free_run(model, [1.0, 1.0], [np.nan, 3.0])
    assert run.y.ravel().tolist() == [2.0, 2.0]
    assert run.started_from == "steady state"


def test_record_without_one_usable_sample_gives_nan():
    run = free_run(NARXModel.from_equations("0.5*y[k-1] + u[k-1]"), [np.nan, np.nan])
    assert np.isnan(run.y).all()
    assert run.stopped_at is None


def test_one_sample_and_records_shorter_than_the_lags():
    model = NARXModel.from_equations("0.5*y[k-3] + u[k-1]")
    assert free_run(model, [1.0]).y.tolist() == [[2.0]]
    assert free_run(model, [1.0, 1.0], y_init=[7.0, 8.0, 9.0]).y.ravel().tolist() == [7.0, 8.0]
    assert np.isnan(predict_one_step(model, [1.0, 1.0], [0.0, 0.0])).all()
    assert np.isnan(predict_k_steps(model, [1.0, 1.0], [0.0, 0.0], 3)).all()
    sessions = free_run(model, np.ones(5), np.arange(5.0), sessions=[1, 1, 1, 1, 2])
    assert sessions.y.ravel().tolist() == [0.0, 1.0, 2.0, 1.0, 4.0]


def test_static_model_needs_no_initial_condition():
    model = NARXModel.from_equations("u[k]^2")
    for y_init in (None, [3.0]):
        assert free_run(model, [1.0, 2.0], y_init).y.ravel().tolist() == [1.0, 4.0]
    assert predict_one_step(model, [1.0, 2.0], [np.nan, np.nan]).ravel().tolist() == [1.0, 4.0]


def test_gap_of_the_current_input_does_not_matter_where_it_is_not_read():
    model = NARXModel.from_equations("y[k-1] + u[k-2]")
    X, y = np.array([1.0, 2.0, np.nan, 4.0, 5.0]), np.arange(5.0)
    np.testing.assert_array_equal(predict_one_step(model, X, y).ravel(), [np.nan, np.nan, 2.0, 4.0, np.nan])
    # two steps back from sample 3 only y[1], u[0] and u[1] are read
    np.testing.assert_array_equal(predict_k_steps(model, X, y, 2).ravel(), [np.nan] * 3 + [4.0, np.nan])


def test_first_difference_of_an_output_that_is_only_read_through_it_needs_it_measured():
    model = NARXModel.from_equations("u[k] + phi1[k-1]", phi=[Difference("y")])
    y = np.array([0.0, 1.0, np.nan, 3.0, 4.0, 5.0, 6.0])
    # y[3] = 1 + (y[2] - y[1]) with y[2] = 1 + (y[1] - y[0]) simulated, y[6] = 1 + (2 - y[4]); elsewhere the
    # measured difference next to the gap is not known
    expected = [np.nan, np.nan, np.nan, 2.0, np.nan, np.nan, -1.0]
    np.testing.assert_array_equal(predict_k_steps(model, np.ones(7), y, 2).ravel(), expected)


def test_memory_of_an_output_begins_anew_in_each_session():
    model = NARXModel.from_equations("u[k] + phi1[k-1]", phi=[Play("y", radius=1.0)])
    X, y = np.zeros(6), np.array([9.0, 9.0, 9.0, 0.0, 0.0, 0.0])
    alone = predict_k_steps(model, X[3:], y[3:], 2)
    together = predict_k_steps(model, X, y, 2, sessions=[1, 1, 1, 2, 2, 2])
    np.testing.assert_array_equal(together[3:], alone)


# --- divergence


@pytest.mark.parametrize("phi", [[], [FunctionPhi(np.abs, ["y[k]"])]], ids=["kernel", "with a function"])
def test_free_run_stops_at_the_first_sample_out_of_the_finite_range(phi):
    # 1e200 squared leaves the range at once; the second session is not touched
    model = NARXModel.from_equations("y[k-1]^2 + u[k]" + (" + phi1[k-1]" if phi else ""), phi=phi)
    y_init = [1e50, 0.0, 0.0, 0.0, 0.0, 0.0]
    with pytest.warns(DivergenceWarning, match="left the finite range at sample 3;"):
        run = free_run(model, np.zeros(6), y_init, sessions=[1, 1, 1, 1, 1, 2])
    assert run.stopped_at == 3
    np.testing.assert_array_equal(np.isfinite(run.y).ravel(), [True, True, True, False, False, True])


def test_bound_is_a_deviation_from_the_operating_point():
    model = NARXModel.from_equations("y[k-1] + 1", origin={"y": 300.0})
    with pytest.warns(DivergenceWarning, match="at sample 4"):
        run = free_run(model, np.zeros(6), [300.0], bound=3.0)
    np.testing.assert_array_equal(run.y.ravel(), [300.0, 301.0, 302.0, 303.0, np.nan, np.nan])


def test_divergence_after_a_start_at_rest_is_counted_from_the_record():
    model = NARXModel.from_equations("2*y[k-1] + u[k-1]")
    with pytest.warns(DivergenceWarning, match="at sample 2"):
        run = free_run(model, [0.0, 1.0, 0.0, 0.0], bound=0.5)
    np.testing.assert_array_equal(run.y.ravel(), [0.0, 0.0, np.nan, np.nan])


def test_diverging_k_step_predictions_are_nan_one_by_one():
    model = NARXModel.from_equations("y[k-1]^2")
    predictions = predict_k_steps(model, np.zeros(5), [1.0, 1e200, 2.0, 1.0, 1.0], steps=2)
    np.testing.assert_array_equal(predictions.ravel(), [np.nan, np.nan, 1.0, np.nan, 16.0])


@pytest.mark.parametrize("bound", [0.0, -1.0, np.nan])
def test_bound_must_be_positive(bound):
    model = NARXModel.from_equations("0.5*y[k-1] + u[k]")
    with pytest.raises(ValueError, match="bound must be positive"):
        free_run(model, [1.0], bound=bound)
    with pytest.raises(ValueError, match="bound must be positive"):
        predict_k_steps(model, [1.0], [1.0], 2, bound=bound)


# --- what comes in

FORMS = {
    "list": lambda a: a.tolist(),
    "float32": lambda a: a.astype(np.float32),
    "integer": lambda a: a.astype(np.int8),
    "strided": lambda a: np.repeat(a, 2, axis=0)[::2],
    "fortran": np.asfortranarray,
    "reversed": lambda a: a[::-1].copy()[::-1],
    "frame": pd.DataFrame,
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_of_an_array_gives_the_same_numbers_and_is_left_alone(form):
    model = NARXModel.from_equations(
        {"a": "0.5*a[k-1] + u[k]*v[k-1]", "b": "0.25*a[k-1] + 0.5*b[k-2]"}, inputs="uv"
    )
    random = np.random.default_rng(0)
    X, y = (random.integers(-3, 4, (20, 2)).astype(float) for _ in range(2))
    X.setflags(write=False)
    y.setflags(write=False)
    given_X, given_y = FORMS[form](X), FORMS[form](y)
    np.testing.assert_array_equal(free_run(model, given_X, given_y).y, free_run(model, X, y).y)
    np.testing.assert_array_equal(predict_one_step(model, given_X, given_y), predict_one_step(model, X, y))
    np.testing.assert_array_equal(
        predict_k_steps(model, given_X, given_y, 3), predict_k_steps(model, X, y, 3)
    )
    np.testing.assert_array_equal(np.asarray(given_X), X)
    np.testing.assert_array_equal(np.asarray(given_y), y)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda m: free_run(m, np.ones((4, 2))), r"X has 2 columns, the model has the 1 inputs \['u'\]"),
        (
            lambda m: free_run(m, np.ones(4), np.ones((4, 2))),
            "y_init has 2 columns, the model has the 1 outputs",
        ),
        (
            lambda m: free_run(m, np.ones(4), [1.0]),
            "y_init has 1 samples, but the model needs the last 2 outputs",
        ),
        (lambda m: free_run(m, np.ones(4), [1.0, 1.0], sessions=[1, 1, 2, 2]), "2 samples for 2 sessions"),
        (lambda m: free_run(m, [1.0, np.inf]), "Input X contains infinity"),
        (lambda m: free_run(m, np.ones((2, 2, 2))), "dim 3"),
        (lambda m: free_run(m, np.ones(4), sessions=[1, 2]), r"one label a sample, shape \(4,\)"),
        (lambda m: free_run(m, []), "0 sample"),
        (lambda m: predict_one_step(m, np.ones(4), np.ones(3)), "inconsistent numbers of samples"),
        (lambda m: predict_k_steps(m, np.ones(4), np.ones(3), 2), "inconsistent numbers of samples"),
        (lambda m: predict_k_steps(m, np.ones(4), np.ones(4), 0), "steps must be a positive integer, got 0"),
        (lambda m: predict_k_steps(m, np.ones(4), np.ones(4), 1.5), "steps must be a positive integer"),
    ],
)
def test_what_does_not_fit_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call(NARXModel.from_equations("0.5*y[k-2] + u[k-1]"))


def test_k_steps_of_a_python_function_of_an_output_are_refused_but_one_is_not():
    model = NARXModel.from_equations("phi1[k-1]", phi=[FunctionPhi(np.abs, ["y[k]"])])
    assert predict_k_steps(model, [0.0, 0.0], [-2.0, 0.0], 1)[1, 0] == 2.0
    with pytest.raises(ValueError, match="phi1 is a Python function of an output"):
        predict_k_steps(model, [0.0, 0.0], [-2.0, 0.0], 2)


def test_scales_of_any_size_are_simulated_alike():
    X = np.random.default_rng(0).uniform(-1, 1, 50)
    unit = free_run(NARXModel(TermLibrary(["y[k-1]", "u[k-1]^2"]), [0.5, 1.0]), X, [0.0]).y
    for scale in (1e-12, 1e12):
        scaled = NARXModel(TermLibrary(["y[k-1]", "u[k-1]^2"]), [0.5, 1 / scale])
        np.testing.assert_allclose(free_run(scaled, scale * X, [0.0]).y, scale * unit, rtol=1e-12)


def test_a_single_initial_output_is_taken_where_one_is_all_that_is_needed():
    model = NARXModel.from_equations("0.5*y[k-1] + u[k-1]")
    for value in (4.0, np.float64(4.0), np.array(4.0), 4):
        assert free_run(model, [1.0, 1.0, 0.0], value).y.ravel().tolist() == [4.0, 3.0, 2.5]
    two = NARXModel.from_equations({"y": "0.5*y[k-1] + u[k-1]", "z": "0.5*z[k-1] + y[k-1]"})
    with pytest.raises(ValueError, match=r"single value 4\.0, .* at least 2 values, .*np\.full\(\(1, 2\)"):
        free_run(two, [1.0, 1.0, 0.0], 4.0)


def test_what_is_no_signal_is_refused_with_what_is_wanted():
    model = NARXModel.from_equations("0.5*y[k-1] + 0.1*y[k-2] + u[k-1]")
    with pytest.raises(
        ValueError, match=r"y_init is the single value 1\.0, .* at least 2 values.*np\.full\(2, 1\.0"
    ):
        free_run(model, [1.0, 1.0, 1.0], 1.0)
    with pytest.raises(ValueError, match="y_init has 2 columns, the model has the 1 outputs"):
        free_run(model, [1.0, 1.0, 1.0], [[1.0, 2.0], [3.0, 4.0]])
    with pytest.raises(ValueError, match=r"X is None, but the model has the inputs \['u'\]"):
        free_run(model, None)
    with pytest.raises(ValueError, match=r"X is the single value 1\.0, but a signal is wanted"):
        free_run(model, 1.0)
    with pytest.raises(ValueError, match="y is None, but a signal is wanted"):
        predict_one_step(model, [1.0, 1.0, 1.0], None)

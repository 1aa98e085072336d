"""The tangent, the latent force and the ports: against exact solutions, dense matrices and hidden physics."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import least_squares
from scipy.signal import lfilter

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.locate import (
    Tangent,
    background,
    concentrated_force,
    features,
    inside,
    latent_force,
    latent_forces,
    port_table,
    ports_of,
    regions,
    tangent,
)
from narx_sklearn.discrepancy.locate import _kalman as kernels
from narx_sklearn.discrepancy.locate._covered import cover
from narx_sklearn.discrepancy.locate._likelihood import TINY_NOISE, Colour, no_force
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.simulators.simulator import Windows

DT = 0.02
SIGNALS = {"states": ["position [m]", "velocity [m/s]"], "inputs": ["drive [V]"]}
NOMINAL = {"gain [m/s^2/V]": 1.0, "damping [1/s]": 0.8, "stiffness [1/s^2]": 12.0}
GAP = 0.15


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def with_cube(x, u, p):
    return x[1], u[0] - 0.8 * x[1] - 12.0 * x[0] - 40.0 * x[0] ** 3


def with_clearance(x, u, p):
    return x[1], u[0] - 0.8 * x[1] - 12.0 * x[0] - 60.0 * (max(x[0] - 0.15, 0.0) + min(x[0] + 0.15, 0.0))


@pytest.fixture(scope="module")
def simulator():
    return ODESimulator(stage, dt=DT, parameters=NOMINAL, **SIGNALS)


def plant(function):
    return ODESimulator(function, dt=DT, parameters={}, substeps=4, **SIGNALS)


def drive(n, seed=1):
    return np.repeat(1.5 * np.random.default_rng(seed).normal(size=n // 25), 25)[:, None]


def windows_of(n, length=200):
    edges = np.arange(0, n + 1, length, dtype=np.int64)
    fresh = np.arange(edges.size - 1) == 0
    return Windows(edges[:-1], edges[1:], fresh, np.zeros(edges.size - 1, dtype=np.int64))


def refitted(simulator, u, y, windows):
    """Return parameters and initial states of every window by least squares on the output."""
    start = np.zeros((windows.count, 2))
    start[:, 0] = y[windows.first, 0]
    n_p = len(simulator.parameters)

    def left(theta):
        return (y - simulator.run(u, windows, theta[n_p:].reshape(-1, 2), p=theta[:n_p]).y).ravel()

    theta = least_squares(left, np.concatenate([simulator.nominal, start.ravel()]), max_nfev=6).x
    return theta[:n_p], theta[n_p:].reshape(-1, 2)


def located(simulator, u, y, windows):
    p, start = refitted(simulator, u, y, windows)
    run = simulator.run(u, windows, start, p=p)
    noise, forces = latent_forces(simulator, run, u, y, windows, p)
    return run, noise, forces, port_table(forces, simulator, windows)


# --- the tangent ---


def test_tangent_of_a_linear_system_is_its_exact_discretisation(simulator):
    u, windows = drive(600), windows_of(600)
    linear = tangent(simulator, simulator.run(u, windows, np.zeros((windows.count, 2))), u, windows)
    J = np.zeros((4, 4))
    J[:2] = np.array([[0, 1, 1, 0], [-12, -0.8, 0, 1]]) * DT
    exact = expm(J)
    assert np.allclose(linear.A, exact[:2, :2], atol=1e-7)  # Runge-Kutta's own error is (0.02 * 3.5)^5 / 120
    assert np.allclose(linear.G, exact[:2, 2:], atol=1e-8)
    assert np.allclose(linear.B[:, :, 0], exact[:2, 3], atol=1e-8)
    assert np.allclose(linear.C, [[1, 0]], atol=1e-9)
    assert np.allclose(linear.D, 0, atol=1e-9)


def test_tangent_of_a_nonlinear_system_follows_the_run():
    cube = plant(with_cube)
    u, windows = drive(600), windows_of(600)
    run = cube.run(u, windows, np.zeros((windows.count, 2)))
    linear = tangent(cube, run, u, windows)
    stiffness = 12 + 120 * run.x[:, 0] ** 2
    # A[1, 0] = -dt * stiffness + O(dt^2)
    assert np.corrcoef(linear.A[:, 1, 0], stiffness)[0, 1] < -0.99
    moved = cube.run(u, windows, np.full((windows.count, 2), 1e-6)).x - run.x
    rows = np.setdiff1d(np.arange(600), windows.last - 1)
    ahead = np.einsum("kij,kj->ki", linear.A[rows], moved[rows])
    assert np.allclose(ahead, moved[rows + 1], atol=1e-11)


def test_tangent_is_unknown_outside_the_windows(simulator):
    u, windows = drive(500), Windows.whole([slice(100, 300)])
    linear = tangent(simulator, simulator.run(u, windows, np.zeros((1, 2))), u, windows)
    known = np.isfinite(linear.A).all(axis=(1, 2))
    assert np.array_equal(np.flatnonzero(known), np.arange(100, 300))


# --- the kernels against dense matrices ---


def random_model(rng, n, n_states, n_outputs):
    A = rng.normal(size=(n, n_states, n_states)) * 0.4
    g, C = rng.normal(size=(n, n_states)), rng.normal(size=(n, n_outputs, n_states))
    d = rng.normal(size=(n, n_outputs))
    seam = rng.choice([0, 0, 0, 0, 1, 3, -1], size=n).astype(np.int64)
    phi, rho, coloured = (
        rng.uniform(0.5, 0.99),
        rng.uniform(0.1, 0.9, n_outputs),
        rng.uniform(0.2, 3, n_outputs),
    )
    return A, g, C, d, seam, phi, 0.7, rho, coloured, rng.uniform(0.5, 2, n_states)


def dense(model, r):
    """Return mean-free covariances: of all outputs, of all forces, and between forces and outputs."""
    A, g, C, d, seam, phi, w_var, rho, s, start = model
    n, n_states, n_outputs = A.shape[0], A.shape[1], C.shape[1]
    coloured = bool((rho > 0).any())
    size = n_states + 1 + (n_outputs if coloured else 0)
    first = np.diag(np.concatenate([start, [w_var], s[: size - n_states - 1]]))
    joint = np.zeros((n * size, n * size))
    joint[:size, :size] = first
    for k in range(n - 1):
        F, length = np.zeros((size, size)), max(int(seam[k]), 1)
        if seam[k] >= 0:
            F[n_states:, n_states:] = np.diag([phi**length, *(rho[: size - n_states - 1] ** length)])
        if seam[k] == 0:
            F[:n_states, :n_states], F[:n_states, n_states] = A[k], g[k]
        stationary = np.diag(first) * (1 - np.diag(F) ** 2)
        stationary[:n_states] = 0.0 if seam[k] == 0 else start
        here, ahead = slice(k * size, (k + 1) * size), slice((k + 1) * size, (k + 2) * size)
        joint[ahead, : (k + 1) * size] = F @ joint[here, : (k + 1) * size]
        joint[: (k + 1) * size, ahead] = joint[ahead, : (k + 1) * size].T
        joint[ahead, ahead] = F @ joint[here, here] @ F.T + np.diag(stationary)
    H = np.zeros((n * n_outputs, n * size))
    for k in range(n):
        for o in range(n_outputs):
            row = H[k * n_outputs + o, k * size : (k + 1) * size]
            row[:n_states], row[n_states] = C[k, o], d[k, o]
            if coloured:
                row[n_states + 1 + o] = 1.0
    forces = np.arange(n) * size + n_states
    states = (np.arange(n)[:, None] * size + np.arange(n_states)).ravel()
    return H @ joint @ H.T + np.diag(np.tile(r, n)), joint, H, forces, states


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize(
    ("n_states", "n_outputs", "white"),
    [(1, 1, [0]), (2, 1, []), (2, 2, []), (3, 2, [0, 1]), (2, 2, [0]), (1, 3, [2])],
)
def test_filter_and_smoother_agree_with_dense_gaussian_conditioning(n_states, n_outputs, white, compiled):
    rng = np.random.default_rng(n_states + 10 * n_outputs)
    n, r = 14, rng.uniform(0.1, 0.5, n_outputs)
    model = random_model(rng, n, n_states, n_outputs)
    model[7][white] = 0.0
    b = rng.normal(size=(n, n_outputs, 1))
    b[3, 0] = np.nan
    size = kernels.state_size(n_states, n_outputs, model[7])
    nu, S = np.empty(b.shape), np.empty((n, n_outputs))
    gain, row = np.empty((n, n_outputs, size)), np.empty((n, size))
    w, variance, dx = np.empty(n), np.empty(n), np.empty((n, n_states))
    run_filter = kernels.filter_windows if compiled else kernels.filter_windows.py_func
    run_smoother = kernels.smooth_windows if compiled else kernels.smooth_windows.py_func
    run_filter(*model[:9], r, model[9], b, nu, S, gain, row)
    run_smoother(*model, nu, S, gain, row, w, variance, dx)

    covariance, joint, H, forces, states = dense(model, r)
    seen = np.isfinite(b.ravel())
    data, K = b.ravel()[seen], covariance[np.ix_(seen, seen)]
    log_likelihood = -0.5 * (np.linalg.slogdet(K)[1] + data @ np.linalg.solve(K, data))
    used = S > 0
    assert -0.5 * np.sum(np.log(S[used]) + nu[:, :, 0][used] ** 2 / S[used]) == pytest.approx(
        log_likelihood, rel=1e-10
    )
    cross = joint @ H.T[:, seen]
    posterior = cross @ np.linalg.solve(K, data)
    assert np.allclose(w, posterior[forces], atol=1e-10)
    assert np.allclose(dx.ravel(), posterior[states], atol=1e-10)
    spread = np.diag(joint - cross @ np.linalg.solve(K, cross.T))
    assert np.allclose(variance, spread[forces], atol=1e-10)


@given(seed=st.integers(0, 10_000))
def test_responses_add_up(seed):
    rng = np.random.default_rng(seed)
    A, g, C, d, seam = random_model(rng, 12, 2, 1)[:5]
    force = rng.normal(size=(12, 2))
    both = np.column_stack([force, force.sum(axis=1)])
    response = np.empty((12, 1, 3))
    kernels.respond(A, g, C, d, seam, both, response)
    assert np.allclose(response[:, :, 0] + response[:, :, 1], response[:, :, 2], atol=1e-10)
    slow = np.empty_like(response)
    kernels.respond.py_func(A, g, C, d, seam, both, slow)
    assert np.allclose(slow, response, atol=1e-12)


def test_initial_energy_is_the_sum_of_squares_of_initial_responses():
    rng = np.random.default_rng(0)
    A, _, C, _, _ = random_model(rng, 10, 2, 1)[:5]
    seam = np.array([0, 0, 0, 0, 1, 0, 0, 0, 0, -1])
    slow = np.zeros(2)
    for piece in (range(5), range(5, 10)):
        travelled = np.eye(2)
        for k in piece:
            slow += np.sum((C[k] @ travelled) ** 2, axis=0)
            travelled = A[k] @ travelled
    for function in (kernels.initial_energy, kernels.initial_energy.py_func):
        energy = np.empty(2)
        assert function(A, C, seam, energy) == 2
        assert np.allclose(energy, slow)


# --- one port ---


def still(n):
    one, none = np.ones((n, 1, 1)), np.zeros((n, 1, 0))
    return Tangent(A=0.9 * one, B=none, G=one, C=one, D=none)


def test_background_finds_the_colour_and_size_of_the_noise():
    n, rng = 4000, np.random.default_rng(3)
    noise = lfilter([np.sqrt(1 - 0.8**2)], [1, -0.8], rng.normal(size=n))[:, None]
    found = background(still(n), 0.5 * noise, Windows.whole([slice(0, n)]))
    assert found.rho == pytest.approx([0.8], abs=0.05)
    assert found.sigma[0] == pytest.approx(0.5, rel=0.1)
    white = found.innovations[1:, 0]
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 0.05
    assert white.std() == pytest.approx(1.0, abs=0.05)


def dense_log_likelihood(covered, rho):
    """Return the log likelihood of noise alone by one covariance matrix, its variance concentrated out."""
    n, n_outputs = covered.b.shape[:2]
    n_states, edges = covered.A.shape[1], [0, *(np.flatnonzero(covered.seam) + 1)]
    initial = np.zeros((n, n_outputs, (len(edges) - 1) * n_states))
    for i, (first, last) in enumerate(pairwise(edges)):
        travelled = np.eye(n_states)
        for k in range(first, last):
            initial[k, :, i * n_states : (i + 1) * n_states] = covered.C[k] @ travelled
            travelled = covered.A[k] @ travelled
    apart = np.abs(np.subtract.outer(covered.samples, covered.samples))
    K = np.zeros((n, n_outputs, n, n_outputs))
    for output in range(n_outputs):
        K[:, output, :, output] = rho[output] ** apart + TINY_NOISE * np.eye(n)
    K = K.reshape(n * n_outputs, -1)
    initial = initial.reshape(n * n_outputs, -1)
    K += initial @ np.diag(np.tile(covered.start, len(edges) - 1)) @ initial.T
    seen = np.isfinite(covered.b.ravel())
    data, K = covered.b.ravel()[seen], K[np.ix_(seen, seen)]
    squares, degrees = data @ np.linalg.solve(K, data), seen.sum() - covered.n_free
    return -0.5 * (degrees + np.linalg.slogdet(K)[1] + degrees * np.log(squares / degrees))


@pytest.mark.parametrize("rho", [(0.3, 0.95), (0.0, 0.8)])
def test_each_output_has_the_colour_of_one_covariance_matrix(rho):
    n, rng, rho = 90, np.random.default_rng(1), np.array(rho)
    A, _, C, _, _ = random_model(rng, n, 2, 2)[:5]
    linear = Tangent(A=A, B=np.zeros((n, 2, 0)), G=A, C=C, D=np.zeros((n, 2, 0)))
    residual = rng.normal(size=(n, 2))
    residual[rng.random((n, 2)) < 0.1] = np.nan
    covered = cover(linear, residual, windows_of(n, 30), np.ones(2))
    ours = no_force(covered, Colour.of(rho)).samples.sum()
    assert ours == pytest.approx(dense_log_likelihood(covered, rho), rel=1e-6)


def decoupled(n, load, seed):
    """Return two leaky integrators, one output each, and residuals: of white noise, and of a hidden load."""
    rng = np.random.default_rng(seed)
    A, none = np.tile(np.diag([0.8, 0.9]), (n, 1, 1)), np.zeros((n, 2, 0))
    one = np.tile(np.eye(2), (n, 1, 1))
    hidden = lfilter([0, 1], [1, -0.9], lfilter([1], [1, -0.97], load * rng.normal(size=n)))
    noise = rng.normal(size=(n, 2)) * [0.3, 0.05]
    residual = noise + np.column_stack([np.zeros(n), hidden])
    return Tangent(A=A, B=none, G=one, C=one, D=none), residual, Windows.whole([slice(0, n)])


@pytest.mark.parametrize("seed", range(3))
def test_a_force_is_not_found_at_another_output_whose_noise_is_white(seed):
    # with one colour for both outputs it was: a force there took up the white noise
    record = decoupled(800, 0.05, seed)
    noise = background(*record)
    assert noise.rho[0] < 0.1
    assert noise.rho[1] > 0.9
    ports = [Port(kind, i) for kind in ("state", "output") for i in (0, 1)]
    gains = {str(port): latent_force(*record, port, against=noise).gain for port in ports}
    assert max(gains, key=gains.get) in ("state:1", "output:1")
    assert gains["state:0"] < 6
    assert gains["output:0"] < 6


def test_outputs_alike_share_one_colour():
    n, rng = 3000, np.random.default_rng(6)
    noise = lfilter([1], [1, -0.8], rng.normal(size=(n, 2)), axis=0)
    one, none = np.ones((n, 1, 1)), np.zeros((n, 1, 0))
    both = Tangent(A=0.9 * one, B=none, G=one, C=np.ones((n, 2, 1)), D=np.zeros((n, 2, 0)))
    found = background(both, noise, Windows.whole([slice(0, n)]))
    assert found.rho == pytest.approx([0.8, 0.8], abs=0.05)
    assert np.ptp(found.rho) == 0.0


def test_with_one_output_the_force_is_as_it_was_with_a_colour_common_to_all():
    n, rng = 1000, np.random.default_rng(7)
    hidden = np.sin(np.arange(n) / 50)
    noise = lfilter([1], [1, -0.7], 0.1 * rng.normal(size=n))
    residual = (lfilter([0, 1], [1, -0.9], hidden) + noise)[:, None]
    force = latent_force(still(n), residual, Windows.whole([slice(0, n)]), Port("state", 0))
    # as computed before each output had its own
    assert force.gain == pytest.approx(384.5405535707605, rel=1e-6)
    assert force.rho == pytest.approx([0.23876486713451786], rel=1e-6)


def test_intervals_of_the_force_cover_it():
    n, rng = 3000, np.random.default_rng(5)
    hidden = np.cumsum(rng.normal(size=n)) * 0.05
    shown = lfilter([0, 1], [1, -0.9], hidden) + 0.5 * rng.normal(size=n)
    force = latent_force(
        still(n), shown[:, None], Windows.whole([slice(0, n)]), Port("state", 0), noise="white"
    )
    covered = np.mean(np.abs(force.w - hidden) < 1.96 * force.w_std)
    assert 0.9 < covered < 0.99


def test_missing_outputs_are_bridged():
    n, rng = 2000, np.random.default_rng(0)
    hidden = np.sin(np.arange(n) / 50)
    shown = lfilter([0, 1], [1, -0.9], hidden)[:, None] + 0.05 * rng.normal(size=(n, 1))
    shown[rng.random(n) < 0.3] = np.nan
    force = latent_force(still(n), shown, Windows.whole([slice(0, n)]), Port("state", 0))
    assert np.sqrt(np.mean((force.w - hidden) ** 2)) < 0.1
    assert force.p_value < 1e-10


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_no_port_is_found_where_there_is_only_noise(simulator, colour):
    u, windows = drive(3000), windows_of(3000)
    start = np.zeros((windows.count, 2))
    run = simulator.run(u, windows, start)
    for seed in range(5):
        e = lfilter([1], [1, -colour], np.random.default_rng(seed).normal(size=(3000, 1)), axis=0)
        _, forces = latent_forces(simulator, run, u, run.y + 0.01 * e, windows)
        table = port_table(forces, simulator, windows)
        assert not table["tied"].any()
        assert (table["gain"] < 6).all()


def test_an_unknown_port_is_refused():
    residual = np.random.default_rng(0).normal(size=(100, 1))
    with pytest.raises(ValueError, match="port state:3 does not exist"):
        latent_force(still(100), residual, Windows.whole([slice(0, 100)]), Port("state", 3))


def test_a_short_residual_is_refused():
    with pytest.raises(ValueError, match="takes at least 20"):
        background(still(10), np.ones((10, 1)), Windows.whole([slice(0, 10)]))


# --- all ports ---


@pytest.mark.parametrize("colour", [0.0, 0.9])
def test_hidden_cubic_stiffness_is_found_at_the_velocity_equation(simulator, colour):
    n = 5000
    u, windows = drive(n), windows_of(n)
    e = lfilter([np.sqrt(1 - colour**2)], [1, -colour], np.random.default_rng(2).normal(size=(n, 1)), axis=0)
    _, _, _, table = located(simulator, u, plant(with_cube).simulate(u) + 0.002 * e, windows)
    assert table.loc[0, ["kind", "index"]].tolist() == ["state", 1]
    assert table["tied"].tolist() == [True, False, False, False]
    assert table.loc[0, "unit"] == "m/s^2"
    assert table.loc[0, "share"] > 0.98


@pytest.mark.parametrize("seed", range(3))
def test_hidden_stiffness_is_found_beside_an_output_whose_noise_is_loud_and_white(seed):
    # with one colour for both outputs it was found at the loud one
    n, both = 3000, {"outputs": SIGNALS["states"]}
    u, windows = drive(n), windows_of(n)
    y = ODESimulator(with_cube, dt=DT, parameters={}, substeps=4, **SIGNALS, **both).simulate(u)
    simulator = ODESimulator(stage, dt=DT, parameters=NOMINAL, **SIGNALS, **both)
    run = simulator.run(u, windows, y[windows.first])
    noise = np.random.default_rng(seed).normal(size=(n, 2)) * [0.1, 0.02]
    _, forces = latent_forces(simulator, run, u, y + noise, windows)
    assert port_table(forces, simulator, windows).loc[0, ["kind", "index"]].tolist() == ["state", 1]


def test_a_dead_zone_is_found_at_the_input(simulator):
    n = 5000
    u, windows = drive(n), windows_of(n)
    effective = np.sign(u) * np.maximum(np.abs(u) - 0.5, 0.0)
    y = simulator.simulate(effective) + 0.002 * np.random.default_rng(2).normal(size=(n, 1))
    _, _, _, table = located(simulator, u, y, windows)
    assert table.loc[0, ["kind", "index"]].tolist() == ["input", 0]
    assert table["tied"].sum() == 1


def test_steps_of_a_sensor_are_found_at_the_output(simulator):
    n = 5000
    u, windows = drive(n), windows_of(n)
    rng = np.random.default_rng(4)
    # inside windows: at their edges, where the state is free, a step is as good a constant force
    steps = np.roll(np.repeat(0.05 * rng.normal(size=n // 500), 500), 90)[:, None]
    y = simulator.simulate(u) + steps
    _, _, _, table = located(simulator, u, y + 0.002 * rng.normal(size=(n, 1)), windows)
    assert table.loc[0, ["kind", "index"]].tolist() == ["output", 0]


def test_clearance_is_found_as_a_region_of_the_position_after_a_refit(simulator):
    n = 5000
    u, windows = drive(n), windows_of(n)
    x = plant(with_clearance).run(u, Windows.whole([slice(0, n)]), np.zeros((1, 2))).x
    y = x[:, :1] + 0.0005 * np.random.default_rng(2).normal(size=(n, 1))
    p, start = refitted(simulator, u, y, windows)
    run = simulator.run(u, windows, start, p=p)
    _, (force,) = latent_forces(simulator, run, u, y, windows, p, ports=[Port("state", 1)])
    corrected = run._replace(x=run.x + force.dx)
    contact_force = concentrated_force(force, tangent(simulator, corrected, u, windows, p))
    table = features(u, corrected.x, DT, inputs=simulator.inputs, states=simulator.states)
    found = regions(contact_force, table, random_state=0)
    region = np.any([inside(conditions, table) for conditions in found["conditions"]], axis=0)
    contact = np.abs(x[:, 0]) > GAP
    assert 2 * np.sum(region & contact) / (region.sum() + contact.sum()) >= 0.9
    assert found["rule"].str.contains("position").all()
    # the refit had made the spring stiffer everywhere; the force beyond the gap alone is what remains
    true = -60.0 * np.sign(x[:, 0]) * np.maximum(np.abs(x[:, 0]) - GAP, 0.0)
    assert np.std(contact_force - true) < 0.3 * np.std(force.w - true)


def test_every_port_is_listed(simulator):
    assert [str(port) for port in ports_of(simulator)] == ["input:0", "state:0", "state:1", "output:0"]
    assert all(b > a for a, b in pairwise(windows_of(400).first))

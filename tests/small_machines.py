"""Small machines that several tests of the diagnosis simulate, and problems made of them."""

import numpy as np

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.physics.effects import CATALOGUE

LOAD = PlacedEffect(CATALOGUE["constant_load"], Port("state", 1), theta=(0.001,))


def axis(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1]


def make_axis(gain=1.0, damping=0.5, equations=axis, output=(0,), dt=0.02):
    return ODESimulator(
        equations,
        dt=dt,
        parameters={"gain [m/s^2/V]": gain, "damping [1/s]": damping},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
        output=output,
    )


def oscillator(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def make_oscillator(equations=oscillator, gain=4.0, damping=1.0, stiffness=20.0):
    return ODESimulator(
        equations,
        dt=0.02,
        parameters={"gain": gain, "damping": damping, "stiffness": stiffness},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
    )


def recorded_oscillator(equations, noise, seed):
    """Return an input, and what an oscillator with such equations makes of it, with noise of such a share."""
    rng = np.random.default_rng(seed)
    u = levels(rng, 1500)
    y = make_oscillator(equations).simulate(u)
    return u, y + noise * np.std(y) * rng.normal(size=y.shape)


def diagnosed_oscillator(equations, effects, noise, seed):
    """Return the diagnosis of such a recording, by an oscillator whose parameters are a tenth off."""
    u, y = recorded_oscillator(equations, noise=noise, seed=seed)
    simulator = make_oscillator(gain=4.4, damping=0.9, stiffness=22.0)
    return DiscrepancyRegressor(simulator, effects=effects, random_state=0).fit(u, y)


def circuit(x, u, p):
    return p[0] * x[1], p[1] * (u[0] - x[0]) - p[2] * x[1]


def tank(x, u, p):
    return (p[0] * u[0] - p[1] * x[0],)


VESSEL_DT = 0.5  # s
VESSEL_STEPS = 40  # of a vessel between two samples, where a test makes its record


def vessel(x, u, p):
    """Level of a tank that drains in proportion to it."""
    return p[0] * u[0] - p[1] * x[0]


def make_vessel(gain=1.0):
    return ODESimulator(
        vessel,
        dt=VESSEL_DT,
        parameters={"inflow [cm/s/V]": 0.5 * gain, "outlet [1/s]": 0.1 / gain},
        states=["level [cm]"],
        inputs=["pump [V]"],
        output=[0],
    )


def recorded_vessel(inflow, rng, n, level, noise=0.02):
    """Return the command and the level of a vessel, by Euler's method, far finer than it is measured.

    ``inflow(command, level, step)`` is what comes in, over a step in seconds.
    """
    u = np.repeat(rng.uniform(1.0, 6.0, n // 16), 16)
    y, step = np.empty(n), VESSEL_DT / VESSEL_STEPS
    for k, command in enumerate(u):
        y[k] = level
        for _ in range(VESSEL_STEPS):
            level += step * (inflow(command, level, step) - 0.1 * level)
    return u[:, None], (y + noise * rng.normal(size=n))[:, None]


def make_circuit():
    return ODESimulator(
        circuit,
        dt=0.01,
        parameters={"1/capacitance": 9.0, "1/inductance": 4.0, "resistance/inductance": 0.8},
        states=["capacitor [V]", "current [A]"],
        inputs=["source [V]"],
    )


def make_drive(equations, dt, torque, **parameters):
    """Return a motor, whose angle is measured, that turns a load through a shaft."""
    return ODESimulator(
        equations,
        dt=dt,
        parameters=parameters,
        states=["motor [rad]", "motor speed [rad/s]", "load [rad]", "load speed [rad/s]"],
        inputs=[torque],
    )


def levels(rng, n, hold=15):
    return np.repeat(rng.normal(0.0, 3.0, n // hold + 1), hold)[:n, None]


def friction(size, code="coulomb_friction", shape=()):
    return PlacedEffect(
        CATALOGUE[code], Port("state", 1), (0.0, 1.0), theta=(size, *shape), argument_name="velocity"
    )


def axis_problem(effects=(), noise=0.002, n=1500, n_windows=4, seed=0, drift=0.0):
    rng = np.random.default_rng(seed)
    u = levels(rng, n)
    y = make_axis(1.1, 0.4).with_effects(list(effects)).simulate(u) + noise * rng.normal(size=(n, 1))
    y = y + drift * np.cumsum(rng.normal(size=(n, 1)), axis=0)
    windows = cut([(slice(0, n), 0)], n // n_windows, 12)
    problem = Problem(make_axis(), u, y, windows, Noise.white(np.array([noise])))
    return problem, Model(problem.simulator.nominal, (), np.zeros((windows.count, 2)))


def walking(rng, n):
    """Return white noise and a random walk that ends as large."""
    walk = np.cumsum(rng.normal(size=(n, 1)), axis=0) / np.sqrt(n / 2)
    return 0.02 * (0.8 * rng.normal(size=(n, 1)) + 0.6 * walk)


def fitted(noise, *, outputs=(0,), n_windows=3, seed=0, pieces=None, unseen=()):
    """Return a problem and the axis's fit to a recording of its own, with noise on it."""
    n = len(noise)
    u = levels(np.random.default_rng(seed), n)
    y = make_axis(1.1, 0.4, output=outputs).simulate(u) + noise
    y[list(unseen)] = np.nan
    windows = cut(pieces or [(slice(0, n), 0)], n // n_windows, 12)
    problem = Problem(make_axis(output=outputs), u, y, windows, Noise.white(np.std(noise, axis=0)))
    found = fit(problem, Model(problem.simulator.nominal, (), np.zeros((windows.count, 2))))
    return problem, fit(problem, found.model, tolerance=1e-12)


def growing(x, u, p):
    return (p[0] * x[0] + p[1] * u[0],)


def make_growing(rate=1.8, gain=1.05):
    return ODESimulator(
        growing,
        dt=0.02,
        parameters={"rate [1/s]": rate, "gain [1/s]": gain},
        states=["level [m]"],
        inputs=["drive [m]"],
    )


def held_growing(n=1500, seed=0):
    """Return drive and level of an unstable machine that a loop holds."""
    rng = np.random.default_rng(seed)
    wanted = np.repeat(rng.normal(size=n // 30), 30)
    u, y, level = np.empty((n, 1)), np.empty((n, 1)), 0.0
    for k in range(n):
        y[k] = level + 0.01 * rng.normal()
        u[k] = -8.0 * (y[k] - wanted[k])
        for _ in range(20):
            level += 0.001 * (2.0 * level + u[k, 0])
    return u, y

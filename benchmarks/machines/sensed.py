"""A shaker, a slide and two masses, whose sensors see rates: accelerometers and a load cell."""

import numpy as np
from numba import njit

from machines.trial import Trial, machine, named, wave


def acceleration(x, u, p, rates):
    return (rates[1],)


def shaker(rng, missing: str) -> Trial:
    """A coil that moves a table on a flexure."""
    dt = 1 / 2000
    most = 6.0 if missing == "input_saturation" else np.inf
    gap = 0.0012 if missing == "clearance" else np.inf
    hardening = 4e9 if missing == "cubic_stiffness" else 0.0

    @njit
    def rates(x, u):
        beyond = x[0] - min(max(x[0], -gap), gap)
        force = 11.0 * x[2] - 9.0 * x[1] - 9000.0 * x[0] - hardening * x[0] ** 3 - 6e4 * beyond
        supply = min(max(u[0], -most), most)
        return x[1], force / 0.35, (supply - 2.2 * x[2] - 11.0 * x[1]) / 1.2e-3

    def nominal(x, u, p):
        force = p[0] * x[2] - p[1] * x[1] - p[2] * x[0]
        return x[1], force / 0.35, (u[0] - p[3] * x[2] - p[0] * x[1]) / 1.2e-3

    u = wave(rng, dt, 5.0, 120.0, 12.0)[:, None]
    x = machine(rates, u, dt, [0.0] * 3)
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"Bl [N/A]": 10.2, "c [N s/m]": 11.0, "k [N/m]": 8200.0, "R [ohm]": 2.4},
        "states": ["position [m]", "velocity [m/s]", "current [A]"],
        "inputs": ["voltage [V]"],
        "output": acceleration,
        "outputs": ["acceleration [m/s^2]"],
        "substeps": 2,
    }
    return Trial(named(missing), u, _second_rate(rates, x, u), simulation)


def slide(rng, missing: str) -> Trial:
    """A table on a guide, its accelerometer behind a filter or not."""
    dt = 0.002
    dry = 1.5 if missing == "coulomb_friction" else 0.0
    hardening = 2e6 if missing == "cubic_stiffness" else 0.0

    @njit
    def rates(x, u):
        braked = 8.0 * x[1] + 4000.0 * x[0] + hardening * x[0] ** 3 + dry * np.tanh(x[1] / 1e-4)
        accelerated = (u[0] - braked) / 2.0
        return x[1], accelerated, (accelerated - x[2]) / 0.004

    def nominal(x, u, p):
        return x[1], (u[0] - p[0] * x[1] - p[1] * x[0]) / p[2]

    u = wave(rng, dt, 0.5, 25.0, 30.0)[:, None]
    x = machine(rates, u, dt, [0.0] * 3)
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"c [N s/m]": 10.0, "k [N/m]": 3600.0, "m [kg]": 1.8},
        "states": ["position [m]", "velocity [m/s]"],
        "inputs": ["force [N]"],
        "output": acceleration,
        "outputs": ["acceleration [m/s^2]"],
    }
    return Trial(named(missing), u, x[:, 2:] if missing == "lag" else _second_rate(rates, x, u), simulation)


def two_masses(rng, missing: str) -> Trial:
    """One moves the other through a spring, whose force a load cell beside it measures."""
    dt = 0.001
    dry = 2.0 if missing == "coulomb_friction" else 0.0
    hardening = 4e6 if missing == "cubic_stiffness" else 0.0

    @njit
    def between(x):
        stretch = x[0] - x[2]
        return 2000.0 * stretch + hardening * stretch**3 + 3.0 * (x[1] - x[3])

    @njit
    def rates(x, u):
        force = between(x)
        held = 1500.0 * x[2] + 4.0 * x[3] + dry * np.tanh(x[3] / 1e-4)
        return x[1], u[0] - force - 5.0 * x[1], x[3], (force - held) / 0.5

    def nominal(x, u, p):
        force = p[0] * (x[0] - x[2]) + p[1] * (x[1] - x[3])
        return x[1], u[0] - force - 5.0 * x[1], x[3], (force - p[2] * x[2] - p[3] * x[3]) / 0.5

    def cell(x, u, p, rates):
        return x[0], u[0] - 5.0 * x[1] - rates[1]  # what the first mass of 1 kg passes on

    u = wave(rng, dt, 2.0, 40.0, 40.0)[:, None]
    x = machine(rates, u, dt, [0.0] * 4)
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"k [N/m]": 1800.0, "c [N s/m]": 4.0, "k2 [N/m]": 1650.0, "c2 [N s/m]": 3.0},
        "states": ["first [m]", "first speed [m/s]", "second [m]", "second speed [m/s]"],
        "inputs": ["force [N]"],
        "output": cell,
        "outputs": ["first [m]", "cell [N]"],
        "substeps": 2,
    }
    return Trial(named(missing), u, np.column_stack([x[:, 0], [between(row) for row in x]]), simulation)


def _second_rate(rates, x, u) -> np.ndarray:
    """Return the rate of the second state at each sample, (n, 1)."""
    return np.array([[rates(state, inputs)[1]] for state, inputs in zip(x, u, strict=True)])

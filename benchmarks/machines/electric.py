"""A battery, a converter, a loudspeaker, a solenoid, a ball that a magnet holds."""

import numpy as np
from numba import njit

from machines.trial import N, Trial, in_loop, machine, named, steps, wave


def battery(rng, missing: str) -> Trial:
    """Two time constants and a charge; what is missing is in the voltmeter."""
    dt = 1.0

    @njit
    def rates(x, u):
        return u[0] / 2000.0 - x[0] / 40.0, u[0] / 20000.0 - x[1] / 600.0, -u[0] / 36000.0

    def nominal(x, u, p):
        return u[0] / p[0] - x[0] / p[1], u[0] / p[2] - x[1] / 600.0, -u[0] / 36000.0

    def voltage(x, u, p):
        return (3.2 + 0.9 * x[2] - x[0] - x[1] - p[3] * u[0],)

    u = steps(rng, 60, -4.0, 6.0)[:, None]
    x = machine(rates, u, dt, [0.0, 0.0, 0.8])
    y = 3.2 + 0.9 * x[:, 2] - x[:, 0] - x[:, 1] - 0.01 * u[:, 0]
    changes = {
        "additive_drift": y + np.linspace(0.0, 0.05, N),
        "sensor_clip": np.maximum(y, np.quantile(y, 0.05)),
    }
    # a drift of the voltage is the same as a current that drains the charge evenly
    expected = (missing, "constant_load") if missing == "additive_drift" else (missing,)
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"C1 [F]": 2200.0, "tau1 [s]": 35.0, "C2 [F]": 22000.0, "R0 [Ohm]": 0.012},
        "states": ["v1 [V]", "v2 [V]", "charge [1]"],
        "inputs": ["current [A]"],
        "output": voltage,
        "outputs": ["voltage [V]"],
    }
    return Trial(expected, u, changes[missing][:, None], simulation)


def converter(rng, missing: str) -> Trial:
    """A buck converter, averaged over its switching."""
    dt = 2e-5
    dead = 0.04 if missing == "dead_zone" else 0.0
    soft = 1.0 if missing == "unknown" else 0.0

    @njit
    def rates(x, u):
        inductance = 1e-4 / (1.0 + soft * (x[0] / 12.0) ** 2)  # a core that saturates
        duty = max(u[0] - dead, 0.0)
        return (24.0 * duty - 0.1 * x[0] - x[1]) / inductance, (x[0] - x[1] / 3.0) / 2e-4

    def nominal(x, u, p):
        return (p[0] * u[0] - p[1] * x[0] - x[1]) / 1e-4, (x[0] - x[1] / p[2]) / 2e-4

    u = steps(rng, 25, 0.0, 0.9)[:, None]
    y = machine(rates, u, dt, [0.0, 0.0])
    if missing == "quantisation":
        y[:, 1] = np.round(y[:, 1] / 0.25) * 0.25
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"supply [V]": 22.0, "resistance [Ohm]": 0.12, "load [Ohm]": 3.3},
        "states": ["current [A]", "voltage [V]"],
        "inputs": ["duty [1]"],
        "output": (0, 1),
    }
    return Trial(named(missing), u, y, simulation)


def loudspeaker(rng, missing: str) -> Trial:
    """Coil and cone; the suspension is no straight spring, or the magnet's field ends."""
    dt = 5e-5
    bent = 1.2e5 if missing == "quadratic_stiffness" else 0.0
    hard = 6e7 if missing == "cubic_stiffness" else 0.0
    ends = 4e5 if missing == "unknown" else 0.0

    @njit
    def rates(x, u):
        factor = 5.0 - ends * x[0] ** 2
        spring = 1500.0 * x[0] + bent * x[0] ** 2 + hard * x[0] ** 3
        return x[1], (factor * x[2] - 1.2 * x[1] - spring) / 0.01, (u[0] - 6.0 * x[2] - factor * x[1]) / 5e-4

    def nominal(x, u, p):
        return (
            x[1],
            (p[0] * x[2] - p[1] * x[1] - p[2] * x[0]) / 0.01,
            (u[0] - 6.0 * x[2] - p[0] * x[1]) / 5e-4,
        )

    u = wave(rng, dt, 20.0, 400.0, 15.0)[:, None]
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"force factor [N/A]": 4.6, "damping [N s/m]": 1.35, "stiffness [N/m]": 1400.0},
        "states": ["cone [m]", "cone speed [m/s]", "current [A]"],
        "inputs": ["voltage [V]"],
        "output": (0, 2),
    }
    return Trial(named(missing), u, machine(rates, u, dt, [0.0] * 3)[:, [0, 2]], simulation)


def levitated_ball(rng, missing: str) -> Trial:
    """A ball under a magnet: unstable, and recorded in the loop that holds it."""
    dt = 0.002
    slow = 0.004 if missing == "lag" else 0.0
    load = 0.6 if missing == "constant_load" else 0.0
    level = np.sqrt(9.81 / 1e-3) * 0.01

    @njit
    def rates(x, u):
        current = x[2] if slow > 0.0 else u[0]
        pull = 9.81 - load - 1e-3 * (current / x[0]) ** 2 - 0.1 * x[1]
        return x[1], pull, (u[0] - x[2]) / slow if slow > 0.0 else 0.0

    def nominal(x, u, p):
        return x[1], 9.81 - p[0] * (u[0] / x[0]) ** 2 - p[1] * x[1]

    @njit
    def control(x, wanted):
        return (level + 455.0 * (x[0] - wanted[0]) + 7.0 * x[1] + wanted[1],)

    wanted = np.column_stack([0.01 + steps(rng, 150, -0.0015, 0.0015), 0.02 * rng.standard_normal(N)])
    u, x = in_loop(rates, control, wanted, dt, [0.01, 0.0, level])
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"force [m^3/s^2/A^2]": 1.08e-3, "damping [1/s]": 0.3},
        "states": ["gap [m]", "speed [m/s]"],
        "inputs": ["current [A]"],
    }
    return Trial(named(missing), u, x[:, :1], simulation)


def solenoid(rng, missing: str) -> Trial:
    """A coil pulls an armature against a spring, the less the wider its gap; a stop may end its travel."""
    dt = 2e-4
    stop = 1.4e-3 if missing == "clearance" else np.inf
    dry = 0.6 if missing == "coulomb_friction" else 0.0

    @njit
    def rates(x, u):
        pull = 3.0 * x[2] ** 2 / (1.0 + x[0] / 2e-3) ** 2
        held = 2.0 * x[1] + 1500.0 * x[0] + 6e4 * max(x[0] - stop, 0.0) + dry * np.tanh(x[1] / 1e-3)
        return x[1], (pull - held) / 0.02, (u[0] - 4.0 * x[2]) / 0.01

    def nominal(x, u, p):
        pull = p[0] * x[2] ** 2 / (1.0 + x[0] / 2e-3) ** 2
        return x[1], (pull - p[1] * x[1] - p[2] * x[0]) / 0.02, (u[0] - p[3] * x[2]) / p[4]

    u = steps(rng, 80, 0.0, 6.0)[:, None]
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {
            "pull [N/A^2]": 2.7,
            "damping [N s/m]": 2.3,
            "spring [N/m]": 1600.0,
            "R [ohm]": 4.4,
            "L [H]": 0.011,
        },
        "states": ["position [m]", "velocity [m/s]", "current [A]"],
        "inputs": ["voltage [V]"],
        "output": (0, 2),
    }
    return Trial(named(missing), u, machine(rates, u, dt, [0.0] * 3)[:, [0, 2]], simulation)

"""A suspension, an aircraft, a ship, cars, a rotor that hovers."""

import numpy as np
from numba import njit

from machines.trial import N, Trial, in_loop, machine, named, steps, wave


def quarter_car(rng, missing: str) -> Trial:
    """Body and wheel of a car: what is missing acts between them."""
    dt = 0.005
    forces = {
        "coulomb_friction": njit(lambda d, v: 150.0 * np.tanh(v / 1e-3)),
        "cubic_stiffness": njit(lambda d, v: 2e7 * d**3),
        "clearance": njit(lambda d, v: 2e5 * (d - min(max(d, -0.02), 0.02))),
    }
    force = forces[missing]

    @njit
    def rates(x, u):
        strut = 18e3 * (x[2] - x[0]) + 1200.0 * (x[3] - x[1]) + force(x[2] - x[0], x[3] - x[1])
        return x[1], strut / 300.0, x[3], (180e3 * (u[0] - x[2]) - strut) / 40.0

    def nominal(x, u, p):
        strut = p[0] * (x[2] - x[0]) + p[1] * (x[3] - x[1])
        return x[1], strut / 300.0, x[3], (p[2] * (u[0] - x[2]) - strut) / 40.0

    u = wave(rng, dt, 0.2, 12.0, 0.05)[:, None]
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"spring [N/m]": 16e3, "damper [N s/m]": 1400.0, "tyre [N/m]": 200e3},
        "states": ["body [m]", "body rate [m/s]", "wheel [m]", "wheel rate [m/s]"],
        "inputs": ["road [m]"],
        "output": (0, 2),
    }
    return Trial((missing,), u, machine(rates, u, dt, [0.0] * 4)[:, [0, 2]], simulation)


def aircraft(rng, missing: str) -> Trial:
    """Short-period motion in pitch; what is missing is in the elevator's drive, or the gyro."""
    dt = 0.02
    lag = 1.0 / 0.08 if missing == "lag" else 0.0
    most = 25.0 if missing == "rate_limit" else np.inf
    width = 0.8 if missing == "backlash" else 0.0

    @njit
    def rates(x, u):
        if lag > 0.0:
            moved, speed = x[2], lag * (u[0] - x[2])
        elif most < np.inf:
            moved, speed = x[2], min(max(500.0 * (u[0] - x[2]), -most), most)
        else:
            moved, speed = u[0], 0.0
        turn = -6.0 * x[0] - 1.5 * x[1] - 0.15 * moved
        return -1.2 * x[0] + x[1] - 0.002 * moved, turn, speed

    def nominal(x, u, p):
        return p[0] * x[0] + x[1] - 0.002 * u[0], p[1] * x[0] + p[2] * x[1] + p[3] * u[0]

    u = wave(rng, dt, 0.05, 4.0, 10.0)
    arrived = u.copy()
    if missing == "delay":
        arrived = np.concatenate([np.zeros(3), u[:-3]])
    for k in range(1, N if width else 0):
        arrived[k] = min(max(arrived[k - 1], u[k] - width), u[k] + width)
    y = machine(rates, arrived[:, None], dt, [0.0] * 3)[:, 1]
    if missing == "sensor_clip":
        y = np.minimum(y, np.quantile(y, 0.97))
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"za [1/s]": -1.3, "ma [1/s^2]": -5.0, "mq [1/s]": -1.3, "md [1/s^2]": -0.17},
        "states": ["alpha [rad]", "pitch rate [rad/s]"],
        "inputs": ["elevator [deg]"],
        "output": (1,),
    }
    return Trial((missing,), u[:, None], y[:, None], simulation)


def ship(rng, missing: str) -> Trial:
    """Turning by the rudder; the law of turning, the steering gear or the waves have more to them."""
    dt = 0.5
    most = 2.0 if missing == "rate_limit" else 0.0
    waves = 0.15 if missing == "periodic_disturbance" else 0.0
    stiffer = 0.06 if missing == "cubic_stiffness" else 0.0

    @njit
    def rates(x, u):
        rudder, speed = u[0], 0.0
        if most > 0.0:
            rudder, speed = x[1], min(max(20.0 * (u[0] - x[1]), -most), most)
        push = waves * np.sin(0.55 * u[1])
        return (0.12 * rudder - x[0] - stiffer * x[0] ** 3 + push) / 12.0, speed

    def nominal(x, u, p):
        return ((p[0] * u[0] - x[0]) / p[1],)

    u = steps(rng, 40, -20.0, 20.0)
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"gain [1/s]": 0.105, "time constant [s]": 13.5},
        "states": ["rate of turn [deg/s]"],
        "inputs": ["rudder [deg]"],
    }
    y = machine(rates, np.column_stack([u, np.arange(N) * dt]), dt, [0.0, 0.0])[:, :1]
    # a rate that is resisted by its cube is nearly resisted by its square
    return Trial(named(missing, *["quadratic_drag"] * bool(stiffer)), u[:, None], y, simulation)


def car(rng, missing: str) -> Trial:
    """Along a road whose grade is recorded, the simulation aware of it or not."""
    dt = 0.1
    rolling = 250.0 if missing == "coulomb_friction" else 0.0
    drag = 0.9 if missing == "quadratic_drag" else 0.0
    most = 2500.0 if missing == "input_saturation" else np.inf
    uphill = 1200.0 * 9.81 if missing == "coupling" else 0.0

    @njit
    def rates(x, u):
        resisted = 60.0 * x[0] + drag * x[0] * abs(x[0]) + rolling * np.tanh(x[0] / 0.01)
        return ((min(u[0], most) - resisted - uphill * u[1]) / 1200.0,)

    def nominal(x, u, p):
        return ((u[0] - p[0] * x[0]) / p[1],)

    rough = np.cumsum(rng.standard_normal(N))
    grade = 0.03 * np.sin(0.005 * np.arange(N) + 1.0) + 0.02 * rough / np.abs(rough).max()
    u = np.column_stack([steps(rng, 80, -1450.0, 3450.0), grade])
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"drag [N s/m]": 68.0, "mass [kg]": 1350.0},
        "states": ["speed [m/s]"],
        "inputs": ["force [N]", "grade [1]"],
    }
    return Trial(named(missing), u, machine(rates, u, dt, [10.0]), simulation)


def rotor(rng, missing: str) -> Trial:
    """A rotor that hovers: its height, held by a loop."""
    dt = 0.02
    bent = 0.12 if missing == "input_polynomial" else 0.0
    drag = 0.5 if missing == "quadratic_drag" else 0.0
    sag = 0.001 if missing == "gain_drift" else 0.0

    @njit
    def rates(x, u):
        lift = 2.0 * (1.0 - sag * u[1]) * u[0] + bent * (u[0] - 4.905) ** 2
        return x[1], lift - 9.81 - 0.1 * x[1] - drag * x[1] * abs(x[1])

    def nominal(x, u, p):
        return x[1], p[0] * u[0] - 9.81 - p[1] * x[1]

    @njit
    def control(x, wanted):
        return 4.905 + 1.6 * (wanted[0] - x[0]) - 1.8 * x[1] + wanted[1], wanted[2]

    wanted = np.column_stack([steps(rng, 200, -1.0, 1.0), 0.1 * rng.standard_normal(N), np.arange(N) * dt])
    u, x = in_loop(rates, control, wanted, dt, [0.0, 0.0])
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"thrust [m/s^2/V]": 1.9, "damping [1/s]": 0.15},
        "states": ["height [m]", "climb [m/s]"],
        "inputs": ["throttle [V]"],
    }
    return Trial(named(missing), u[:, :1], x[:, :1], simulation)


def car_in_its_lane(rng, missing: str) -> Trial:
    """Offset and heading in a lane, kept by a loop whose servo steers."""
    dt = 0.02
    play = 0.008 if missing == "dead_zone" else 0.0
    fastest = 0.15 if missing == "rate_limit" else np.inf

    @njit
    def rates(x, u):
        told = u[0] - min(max(u[0], -play), play)
        steered = min(max((told - x[2]) / 0.1, -fastest), fastest)
        return 20.0 * np.sin(x[1]), 20.0 / 2.8 * np.tan(x[2]), steered

    def nominal(x, u, p):
        return p[0] * np.sin(x[1]), p[0] / p[1] * np.tan(x[2]), (u[0] - x[2]) / p[2]

    @njit
    def control(x, wanted):
        told = 0.02 * (wanted[0] - x[0]) - 0.5 * x[1] - 0.1 * x[2]
        return (min(max(told, -0.3), 0.3),)

    u, x = in_loop(rates, control, steps(rng, 250, -1.5, 1.5)[:, None], dt, [0.0] * 3)
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"speed [m/s]": 18.5, "wheelbase [m]": 3.1, "servo [s]": 0.12},
        "states": ["offset [m]", "heading [rad]", "steering [rad]"],
        "inputs": ["command [rad]"],
        "output": (0, 1),
    }
    return Trial(named(missing), u, x[:, :2], simulation)

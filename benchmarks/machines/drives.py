"""A crane, motors, a turbine, a robot's arm, a belt, pendulums, a mirror, a piezo stage, a table."""

import numpy as np
from numba import njit

from machines.trial import N, Trial, in_loop, machine, named, steps, wave


def crane(rng, missing: str) -> Trial:
    """A cart with a swinging load: a force on the cart turns up in both equations of motion."""
    dt = 0.02
    forces = {
        "coulomb_friction": njit(lambda v: 4.0 * np.tanh(v / 1e-3)),
        "quadratic_drag": njit(lambda v: 15.0 * v * abs(v)),
        "constant_load": njit(lambda v: 2.0),
        "": njit(lambda v: 0.0),
    }
    force = forces[missing]

    @njit
    def rates(x, u):
        s, c = np.sin(x[2]), np.cos(x[2])
        along = (u[0] - 12.0 * x[1] - force(x[1]) + 2.0 * s * (1.2 * x[3] ** 2 + 9.81 * c)) / (
            8.0 + 2.0 * s * s
        )
        return x[1], along, x[3], (-along * c - 9.81 * s) / 1.2 - 0.1 * x[3]

    def nominal(x, u, p):
        s, c = np.sin(x[2]), np.cos(x[2])
        along = (u[0] - p[1] * x[1] + 2.0 * s * (1.2 * x[3] ** 2 + 9.81 * c)) / (p[0] + 2.0 * s * s)
        return x[1], along, x[3], (-along * c - 9.81 * s) / 1.2 - p[2] * x[3]

    u = wave(rng, dt, 0.05, 2.0, 30.0)[:, None]
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"cart [kg]": 9.0, "damping [kg/s]": 10.0, "swing damping [1/s]": 0.08},
        "states": ["cart [m]", "cart rate [m/s]", "swing [rad]", "swing rate [rad/s]"],
        "inputs": ["force [N]"],
        "output": (0, 2),
    }
    expected = (missing,) if missing else ()
    return Trial(expected, u, machine(rates, u, dt, [0.0] * 4)[:, [0, 2]], simulation)


def wind_turbine(rng, missing: str) -> Trial:
    """Rotor and generator on a shaft; the load on the generator has more to it."""
    dt = 0.05
    loads = {
        "periodic_disturbance": njit(lambda w, t: 0.25 * np.sin(1.7 * t + 0.4)),
        "quadratic_drag": njit(lambda w, t: 0.02 * w * abs(w)),
        "constant_load": njit(lambda w, t: 0.5 if 80.0 < t < 130.0 else 0.0),
        "": njit(lambda w, t: 0.0),
    }
    load = loads[missing]

    @njit
    def rates(x, u):
        shaft = 8.0 * x[0] + 1.0 * (x[1] - x[2])
        return x[1] - x[2], (u[0] - shaft - 0.2 * x[1]) / 5.0, shaft - 0.6 * x[2] - load(x[2], u[1])

    def nominal(x, u, p):
        shaft = p[0] * x[0] + p[1] * (x[1] - x[2])
        return x[1] - x[2], (u[0] - shaft - 0.2 * x[1]) / p[2], shaft - p[3] * x[2]

    u = steps(rng, 30, 2.0, 6.0) + wave(rng, dt, 0.02, 2.0, 1.0)
    y = machine(rates, np.column_stack([u, np.arange(N) * dt]), dt, [0.0] * 3)[:, 2:]
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"k [N m/rad]": 7.0, "c [N m s/rad]": 1.2, "J [kg m^2]": 5.5, "b [N m s/rad]": 0.7},
        "states": ["twist [rad]", "rotor [rad/s]", "generator [rad/s]"],
        "inputs": ["torque [N m]"],
        "output": (2,),
    }
    # it never turns back, so a drag is the square of its speed under either name
    same = ("quadratic_stiffness",) if missing == "quadratic_drag" else ()
    return Trial(((missing, *same) if missing else ()), u[:, None], y, simulation)


def piezo(rng, missing: str) -> Trial:
    """A fast stage whose actuator is a sum of play operators."""
    dt = 2e-5
    u = wave(rng, dt, 20.0, 1500.0, 50.0)
    radius, weight = np.array([2.0, 5.0, 9.0, 14.0]), np.array([0.03, 0.03, 0.02, 0.02])
    held, moved = np.zeros(4), np.zeros(N)
    for k in range(N):
        held = np.minimum(np.maximum(held, u[k] - radius), u[k] + radius)
        moved[k] = u[k] + weight @ held

    @njit
    def rates(x, u):
        return x[1], 4e7 * (0.1 * u[0] - x[0]) - 2000.0 * x[1]

    def nominal(x, u, p):
        return x[1], p[0] * (p[1] * u[0] - x[0]) - p[2] * x[1]

    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"w2 [1/s^2]": 3.5e7, "gain [um/V]": 0.11, "damping [1/s]": 2300.0},
        "states": ["position [um]", "velocity [um/s]"],
        "inputs": ["voltage [V]"],
    }
    y = machine(rates, moved[:, None], dt, [0.0] * 2)[:, :1]
    return Trial((missing,), u[:, None], y, simulation)


def motor(rng, missing: str) -> Trial:
    dt = 0.002
    torques = {
        "cogging": njit(lambda q, v: 60.0 * np.sin(6.0 * q + 0.7)),
        "stribeck_friction": njit(lambda q, v: (30.0 + 30.0 * np.exp(-((v / 1.5) ** 2))) * np.tanh(v / 0.01)),
    }
    torque = torques[missing]

    @njit
    def rates(x, u):
        return x[1], 40.0 * u[0] - 8.0 * x[1] - torque(x[0], x[1])

    def nominal(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1]

    u = wave(rng, dt, 0.2, 5.0, 8.0)[:, None]
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"gain [rad/s^2/V]": 36.0, "damping [1/s]": 9.0},
        "states": ["angle [rad]", "speed [rad/s]"],
        "inputs": ["voltage [V]"],
    }
    return Trial((missing,), u, machine(rates, u, dt, [0.0] * 2)[:, :1], simulation)


def robot_arm(rng, missing: str) -> Trial:
    """Two links in a plane, their joints in a loop: what is missing acts on one joint."""
    dt = 0.01
    rubbing = 0.8 if missing == "coulomb_friction" else 0.0
    weight = 3.0 if missing == "gravity" else 0.0

    @njit
    def rates(x, u):
        c, s = np.cos(x[1]), np.sin(x[1])
        m11, m12, m22 = 1.2 + 0.6 * c, 0.3 + 0.3 * c, 0.3
        one = u[0] - x[2] + 0.3 * s * (2.0 * x[2] * x[3] + x[3] ** 2) - weight * np.sin(x[0])
        two = u[1] - 0.5 * x[3] - 0.3 * s * x[2] ** 2 - rubbing * np.tanh(x[3] / 1e-3)
        size = m11 * m22 - m12 * m12
        return x[2], x[3], (m22 * one - m12 * two) / size, (m11 * two - m12 * one) / size

    def nominal(x, u, p):
        c, s = np.cos(x[1]), np.sin(x[1])
        m11, m12, m22 = p[0] + 0.6 * c, 0.3 + 0.3 * c, 0.3
        one = u[0] - p[1] * x[2] + 0.3 * s * (2.0 * x[2] * x[3] + x[3] ** 2)
        two = u[1] - p[2] * x[3] - 0.3 * s * x[2] ** 2
        size = m11 * m22 - m12 * m12
        return x[2], x[3], (m22 * one - m12 * two) / size, (m11 * two - m12 * one) / size

    @njit
    def control(x, wanted):
        return 40.0 * (wanted[0] - x[0]) - 8.0 * x[2], 20.0 * (wanted[1] - x[1]) - 3.0 * x[3]

    wanted = np.column_stack([wave(rng, dt, 0.05, 1.0, 1.0), wave(rng, dt, 0.05, 1.5, 0.8)])
    u, x = in_loop(rates, control, wanted, dt, [0.0] * 4)
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"inertia [kg m^2]": 1.3, "damping 1 [N m s]": 0.9, "damping 2 [N m s]": 0.6},
        "states": ["joint 1 [rad]", "joint 2 [rad]", "rate 1 [rad/s]", "rate 2 [rad/s]"],
        "inputs": ["torque 1 [N m]", "torque 2 [N m]"],
        "output": (0, 1),
    }
    return Trial(named(missing), u, x[:, :2], simulation)


def belt(rng, missing: str) -> Trial:
    """Motor and carriage on a belt, both measured, in a loop."""
    dt = 0.001
    loose = 2e-4 if missing == "clearance" else 0.0
    teeth = 20.0 if missing == "cogging" else 0.0
    rubbing = 8.0 if missing == "coulomb_friction" else 0.0

    @njit
    def rates(x, u):
        ahead = x[0] - x[2]
        pull = 2e4 * (ahead - min(max(ahead, -loose), loose)) + 10.0 * (x[1] - x[3])
        motor = u[0] - 2.0 * x[1] - pull - teeth * np.sin(2.0 * np.pi * x[0] / 0.012)
        return x[1], motor, x[3], (pull - 5.0 * x[3] - rubbing * np.tanh(x[3] / 1e-3)) / 2.0

    def nominal(x, u, p):
        pull = p[2] * (x[0] - x[2]) + 10.0 * (x[1] - x[3])
        return x[1], u[0] - p[0] * x[1] - pull, x[3], (pull - p[1] * x[3]) / p[3]

    @njit
    def control(x, wanted):
        return (900.0 * (wanted[0] - x[0]) - 25.0 * x[1],)

    wanted = np.cumsum(wave(rng, dt, 0.3, 6.0, 1.0))[:, None] * dt
    u, x = in_loop(rates, control, wanted, dt, [0.0] * 4)
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {
            "motor damping [N s/m]": 2.5,
            "carriage damping [N s/m]": 4.4,
            "belt [N/m]": 1.8e4,
            "carriage [kg]": 2.2,
        },
        "states": ["motor [m]", "motor speed [m/s]", "carriage [m]", "carriage speed [m/s]"],
        "inputs": ["force [N]"],
        "output": (0, 2),
    }
    return Trial(named(missing, *["backlash"] * bool(loose)), u, x[:, [0, 2]], simulation)


def pendulum(rng, missing: str) -> Trial:
    """A motor that turns an arm over; on the arm a load may swing on a spring."""
    dt = 0.01
    rubbing = 1.5 if missing == "coulomb_friction" else 0.0
    spring = 400.0 if missing == "extra_mode" else 0.0

    @njit
    def rates(x, u):
        torque = 30.0 * u[0] - 20.0 * np.sin(x[0]) - x[1] - rubbing * np.tanh(x[1] / 1e-3)
        return x[1], torque - spring * (x[0] - x[2]), x[3], 2.25 * spring * (x[0] - x[2]) - 4.0 * x[3]

    def without_weight(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1]

    def nominal(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * np.sin(x[0])

    parameters = {"gain [rad/s^2/A]": 27.0, "damping [1/s]": 1.2, "weight [1/s^2]": 22.0}
    if missing == "gravity":
        del parameters["weight [1/s^2]"]
    u = wave(rng, dt, 0.1, 3.0, 2.5)[:, None]
    simulation = {
        "function": without_weight if missing == "gravity" else nominal,
        "dt": dt,
        "parameters": parameters,
        "states": ["angle [rad]", "rate [rad/s]"],
        "inputs": ["current [A]"],
    }
    return Trial(named(missing), u, machine(rates, u, dt, [0.0] * 4)[:, :1], simulation)


def mirror(rng, missing: str) -> Trial:
    """A mirror on a flexure, fast; its sensor may creep."""
    dt = 1e-4
    laws = {
        "cubic_stiffness": njit(lambda q, v: 6e4 * q**3),
        "quadratic_stiffness": njit(lambda q, v: 2e4 * q * q),
        "coulomb_friction": njit(lambda q, v: 900.0 * np.tanh(v / 0.05)),
    }
    law = laws.get(missing, njit(lambda q, v: 0.0))

    @njit
    def rates(x, u):
        return x[1], 9e4 * u[0] - 3e5 * x[0] - 150.0 * x[1] - law(x[0], x[1])

    def nominal(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[0] - p[2] * x[1]

    u = wave(rng, dt, 5.0, 400.0, 3.0)[:, None]
    y = machine(rates, u, dt, [0.0] * 2)[:, :1]
    crept = 0.0
    for k in range(N if missing == "creep" else 0):
        angle = y[k, 0]
        y[k] += crept
        crept += dt / 0.05 * (0.15 * angle - crept)
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"gain [deg/s^2/V]": 8e4, "flexure [1/s^2]": 3.3e5, "damping [1/s]": 130.0},
        "states": ["angle [deg]", "rate [deg/s]"],
        "inputs": ["drive [V]"],
    }
    return Trial(named(missing), u, y, simulation)


def cart_with_pole(rng, missing: str) -> Trial:
    """A pole that a cart balances: unstable, and recorded in the loop that holds it up."""
    dt = 0.02
    dry = 1.0 if missing == "coulomb_friction" else 0.0
    zone = 0.8 if missing == "dead_zone" else 0.0
    tilt = 0.03 if missing == "sensor_bias" else 0.0

    @njit
    def rates(x, u):
        force = u[0] - min(max(u[0], -zone), zone) - dry * np.tanh(x[1] / 0.002) - 0.5 * x[1]
        s, c = np.sin(x[2]), np.cos(x[2])
        along = (force + 0.2 * s * (0.4 * x[3] ** 2 - 9.81 * c)) / (1.0 + 0.2 * s * s)
        return x[1], along, x[3], (9.81 * s - along * c) / 0.4 - 0.05 * x[3]

    def nominal(x, u, p):
        s, c = np.sin(x[2]), np.cos(x[2])
        along = (u[0] - p[1] * x[1] + p[2] * s * (p[3] * x[3] ** 2 - 9.81 * c)) / (p[0] + p[2] * s * s)
        return x[1], along, x[3], (9.81 * s - along * c) / p[3] - 0.05 * x[3]

    @njit
    def control(x, wanted):
        return (4.0 * (x[0] - wanted[0]) + 5.5 * x[1] + 45.0 * (x[2] + tilt) + 9.0 * x[3] + wanted[1],)

    wanted = np.column_stack([steps(rng, 150, -0.5, 0.5), 2.0 * rng.standard_normal(N)])
    u, x = in_loop(rates, control, wanted, dt, [0.0] * 4)
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"cart [kg]": 1.1, "damping [kg/s]": 0.4, "pole [kg]": 0.22, "length [m]": 0.42},
        "states": ["cart [m]", "cart rate [m/s]", "angle [rad]", "angle rate [rad/s]"],
        "inputs": ["force [N]"],
        "output": (0, 2),
    }
    return Trial(named(missing), u, x[:, [0, 2]] + [0.0, tilt], simulation)


def table_of_two_axes(rng, missing: str) -> Trial:
    """Each axis has its motor; one pulls at the other axis too, or the two share a supply that sags."""
    dt = 0.01
    pull = 0.12 if missing == "coupling" else 0.0
    sag = 0.06 if missing == "temperature_gain" else 0.0

    @njit
    def rates(x, u):
        first = u[0] * (1.0 - sag * u[1]) - 2.0 * x[1] - 30.0 * x[0]
        return x[1], first, x[3], 0.8 * u[1] + pull * u[0] - 1.5 * x[3] - 20.0 * x[2]

    def nominal(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0], x[3], p[3] * u[1] - p[4] * x[3] - p[5] * x[2]

    u = np.column_stack([steps(rng, 18, -3.0, 3.0), steps(rng, 23, -3.0, 3.0)])
    names = ("gain x", "damping x", "stiffness x", "gain y", "damping y", "stiffness y")
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": dict(zip(names, (1.1, 1.8, 28.0, 0.9, 1.3, 22.0), strict=True)),
        "states": ["x [m]", "x rate [m/s]", "y [m]", "y rate [m/s]"],
        "inputs": ["motor x [V]", "motor y [V]"],
        "output": (0, 2),
    }
    return Trial(named(missing), u, machine(rates, u, dt, [0.0] * 4)[:, [0, 2]], simulation)


def reaction_wheel(rng, missing: str) -> Trial:
    """A wheel on a pendulum pushes it by speeding up; what brakes the wheel pushes the pendulum too."""
    dt = 0.01
    dry = 0.004 if missing == "coulomb_friction" else 0.0
    most = 0.03 if missing == "input_saturation" else np.inf

    @njit
    def rates(x, u):
        torque = min(max(u[0], -most), most) - dry * np.tanh(x[2] / 0.05) - 1e-5 * x[2]
        return x[1], (-0.9 * np.sin(x[0]) - 0.006 * x[1] - torque) / 0.02, torque / 2.5e-4

    def nominal(x, u, p):
        torque = p[0] * u[0] - p[1] * x[2]
        return x[1], (-p[2] * np.sin(x[0]) - p[3] * x[1] - torque) / 0.02, torque / 2.5e-4

    u = wave(rng, dt, 0.1, 3.0, 0.06)[:, None]
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {
            "gain [-]": 1.1,
            "drag [N m s]": 1.2e-5,
            "weight [N m]": 0.85,
            "damping [N m s]": 0.007,
        },
        "states": ["angle [rad]", "rate [rad/s]", "wheel [rad/s]"],
        "inputs": ["torque [N m]"],
        "output": (0, 2),
    }
    return Trial(named(missing), u, machine(rates, u, dt, [0.0] * 3)[:, [0, 2]], simulation)

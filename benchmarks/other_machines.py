"""Machines of other kinds, each with something its simulation lacks: what the diagnosis says of them.

    python benchmarks/other_machines.py [--only quarter_car] [--seed 0] [--noise 0.01] [--jobs 2]

A suspension, a hydraulic cylinder, a crane, a battery, an aircraft, a wind turbine, a tank, an oven, a
piezo stage and a motor, with their own units and time scales. All parameters of the simulations are 5 to 20 %
wrong; the noise is white. The machines are stepped by Heun's method at a fortieth of the sampling period and
share no code with the package. Held-out errors are those of the last fifth, over the recording's spread.
"""

import argparse
import warnings
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from typing import NamedTuple

import numpy as np
from harness.tables import format_table, save_json
from numba import njit

N, FINE = 4000, 40  # samples, steps a sample


class Trial(NamedTuple):
    """A recording without noise, what may be called right, and how to make the simulation."""

    expected: tuple[str, ...]  # first names that are right; empty where nothing is missing
    u: np.ndarray
    y: np.ndarray
    simulation: dict  # of ODESimulator


def wave(rng, dt: float, low: float, high: float, size: float) -> np.ndarray:
    """Return a multisine between two frequencies, Hz."""
    f = np.fft.rfftfreq(N, dt)
    lines = np.where((f >= low) & (f <= high), np.exp(2j * np.pi * rng.random(f.size)), 0)
    signal = np.fft.irfft(lines, N)
    return size * signal / np.abs(signal).max()


def steps(rng, held: int, low: float, high: float) -> np.ndarray:
    return np.repeat(rng.uniform(low, high, N // held + 1), held)[:N]


def machine(rates, u: np.ndarray, dt: float, start) -> np.ndarray:
    """Return the states (n, n_states) of a machine whose inputs are held from sample to sample."""

    @njit
    def stepped(u, x):
        states = np.zeros((u.shape[0], x.size))
        h = dt / FINE
        for k in range(u.shape[0]):
            states[k] = x
            for _ in range(FINE):
                here = np.array(rates(x, u[k]))
                there = np.array(rates(x + h * here, u[k]))
                x = x + 0.5 * h * (here + there)
        return states

    return stepped(np.ascontiguousarray(u, dtype=float), np.array(start, dtype=float))


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


def hydraulic_cylinder(rng, missing: str) -> Trial:
    dt = 0.01
    valves = {
        "dead_zone": njit(lambda s: s - min(max(s, -0.6), 0.6)),
        "input_saturation": njit(lambda s: min(max(s, -2.5), 2.5)),
        "input_polynomial": njit(lambda s: s + 0.04 * s * s),
    }
    valve = valves[missing]

    @njit
    def rates(x, u):
        return x[1], 25.0 * (0.3 * valve(u[0]) - x[1])

    def nominal(x, u, p):
        return x[1], p[0] * (p[1] * u[0] - x[1])

    u = wave(rng, dt, 0.1, 4.0, 5.0)[:, None]
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"bandwidth [1/s]": 20.0, "gain [mm/s/V]": 0.25},
        "states": ["position [mm]", "speed [mm/s]"],
        "inputs": ["valve [V]"],
    }
    return Trial((missing,), u, machine(rates, u, dt, [0.0] * 2)[:, :1], simulation)


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


def tank(rng, missing: str) -> Trial:
    dt = 1.0

    @njit
    def rates(x, u):
        return ((u[0] - 2.0 * np.sqrt(max(x[0], 0.0))) / 5.0,)

    def nominal(x, u, p):
        return ((p[0] * u[0] - p[1] * x[0] - p[2]) / 5.0,)

    u = steps(rng, 80, 1.0, 5.0)[:, None]
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"gain [1]": 1.0, "leak [1/s]": 0.5, "base [dm]": 1.0},
        "states": ["level [dm]"],
        "inputs": ["inflow [l/s]"],
    }
    return Trial((missing,), u, machine(rates, u, dt, [2.0]), simulation)


def oven(rng, missing: str) -> Trial:
    """An oven that warms its walls."""
    dt = 5.0

    @njit
    def rates(x, u):
        return 0.01 * u[0] - 0.004 * x[0] - 0.01 * (x[0] - x[1]), 0.002 * (x[0] - x[1])

    def nominal(x, u, p):
        return (p[0] * u[0] - p[1] * x[0],)

    u = steps(rng, 50, 0.0, 100.0)[:, None]
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"gain [K/s/W]": 0.011, "loss [1/s]": 0.0045},
        "states": ["oven [K]"],
        "inputs": ["heater [W]"],
    }
    return Trial((missing,), u, machine(rates, u, dt, [0.0] * 2)[:, :1], simulation)


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


TRIALS = {
    quarter_car: ("coulomb_friction", "cubic_stiffness", "clearance"),
    hydraulic_cylinder: ("dead_zone", "input_saturation", "input_polynomial"),
    crane: ("coulomb_friction", "quadratic_drag", "constant_load", ""),
    battery: ("additive_drift", "sensor_clip"),
    aircraft: ("rate_limit", "delay", "lag", "backlash", "sensor_clip"),
    wind_turbine: ("periodic_disturbance", "quadratic_drag", "constant_load", ""),
    tank: ("root_outflow",),
    oven: ("extra_mode",),
    piezo: ("prandtl_ishlinskii",),
    motor: ("cogging", "stribeck_friction"),
}


def diagnose(name: str, missing: str, seed: int, noise: float) -> dict:
    """Return what is said of one trial, a row of the table."""
    from narx_sklearn import DiscrepancyRegressor, ODESimulator

    warnings.simplefilter("ignore")
    (make,) = (make for make in TRIALS if make.__name__ == name)
    rng = np.random.default_rng(seed)
    trial = make(rng, missing)
    y = trial.y + noise * trial.y.std(axis=0) * rng.standard_normal(trial.y.shape)
    dx = DiscrepancyRegressor(ODESimulator(**trial.simulation), random_state=0).fit(trial.u, y)
    found = [finding.effect for finding in dx.findings_]
    right = set(found[:1]) <= set(trial.expected) and bool(found) == bool(trial.expected)
    row = {"machine": name, "missing": missing or "nothing", "verdict": dx.verdict_}
    row |= {"found": ", ".join(f"{f.effect} {f.place}{f.when}" for f in dx.findings_) or "-"}
    row |= {f"{k} %": 100 * dx.scores_.loc[k, "nrmse"] for k in ("nominal", "refitted", "augmented")}
    return row | {"right": right, "alone": right and len(found) < 2}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=[make.__name__ for make in TRIALS])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--noise", type=float, default=0.01, help="standard deviation over that of the output"
    )
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out")
    given = parser.parse_args()
    wanted = [
        (make.__name__, missing)
        for make, effects in TRIALS.items()
        if not given.only or make.__name__ in given.only
        for missing in effects
    ]
    names, missing = zip(*wanted, strict=True)
    with ProcessPoolExecutor(given.jobs) as pool:
        rows = list(pool.map(diagnose, names, missing, repeat(given.seed), repeat(given.noise)))
    print(format_table(list(rows[0]), [list(row.values()) for row in rows]))
    print(
        f"first name (or silence) right: {sum(r['right'] for r in rows)} of {len(rows)}, "
        f"with nothing beside it: {sum(r['alone'] for r in rows)}"
    )
    if given.out:
        save_json(given.out, {"seed": given.seed, "noise": given.noise, "rows": rows})


if __name__ == "__main__":
    main()

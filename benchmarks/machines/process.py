"""Cylinders of oil and air, a tank, a canal, a flow, a vessel, a bioreactor, an oven, an exchanger, rooms."""

import numpy as np
from numba import njit

from machines.trial import N, Trial, machine, named, steps, wave


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
    """An oven that warms its walls, which follow slowly: that is creep, too."""
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
    return Trial((missing, "creep"), u, machine(rates, u, dt, [0.0] * 2)[:, :1], simulation)


def pneumatic_cylinder(rng, missing: str) -> Trial:
    """A piston between two pressures, lumped to one force that is measured too."""
    dt = 0.005
    frictions = {
        "stribeck_friction": njit(lambda v: (20.0 + 25.0 * np.exp(-abs(v) / 0.02)) * np.tanh(v / 4e-3)),
        "asymmetric_friction": njit(lambda v: (40.0 if v > 0 else 15.0) * np.tanh(v / 4e-3)),
    }
    friction = frictions.get(missing, njit(lambda v: 0.0))
    closed = 0.4 if missing == "dead_zone" else 0.0

    @njit
    def rates(x, u):
        opened = u[0] - min(max(u[0], -closed), closed)
        return (
            x[1],
            (x[2] - 60.0 * x[1] - friction(x[1])) / 3.0,
            900.0 * opened - 12.0 * x[2] - 9000.0 * x[1],
        )

    def nominal(x, u, p):
        return x[1], (x[2] - p[0] * x[1]) / 3.0, p[1] * u[0] - p[2] * x[2] - 9000.0 * x[1]

    u = wave(rng, dt, 0.1, 5.0, 5.0)[:, None]
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"damping [N s/m]": 70.0, "valve [N/s/V]": 800.0, "leak [1/s]": 13.5},
        "states": ["position [m]", "velocity [m/s]", "force [N]"],
        "inputs": ["valve [V]"],
        "output": (0, 2),
    }
    return Trial(named(missing), u, machine(rates, u, dt, [0.0] * 3)[:, [0, 2]], simulation)


def heat_exchanger(rng, missing: str) -> Trial:
    """Water that is heated as it flows; the room's temperature is recorded."""
    dt = 2.0
    flow, heat = steps(rng, 90, 0.05, 0.2), steps(rng, 60, 0.0, 4000.0)
    room = 20.0 + 8.0 * np.cumsum(rng.standard_normal(N)) / np.sqrt(N)
    late = 5 if missing == "delay" else 0
    arrived = np.concatenate([np.full(late, heat[0]), heat[: N - late]])
    loss = 60.0 if missing == "coupling" else 0.0
    slow = 12.0 if missing == "lag" else 0.0

    @njit
    def rates(x, u):
        warmed = (u[1] + 4180.0 * u[0] * (15.0 - x[0]) + loss * (u[2] - x[0])) / 60000.0
        return warmed, (x[0] - x[1]) / slow if slow > 0.0 else 0.0

    def nominal(x, u, p):
        return ((p[0] * u[1] + 4180.0 * u[0] * (p[1] - x[0])) / p[2],)

    x = machine(rates, np.column_stack([flow, arrived, room]), dt, [18.0, 18.0])
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"efficiency [1]": 0.92, "inlet [K]": 14.0, "capacity [J/K]": 66000.0},
        "states": ["water [K]"],
        "inputs": ["flow [l/s]", "heater [W]", "room [K]"],
    }
    seen = x[:, 1:] if slow else x[:, :1]
    return Trial(named(missing), np.column_stack([flow, heat, room]), seen, simulation)


def room(rng, missing: str) -> Trial:
    """A heated room: its walls, the weather that is recorded, a window that somebody opened."""
    dt = 60.0
    hours = np.arange(N) * dt / 3600.0
    outdoors = 5.0 + 6.0 * np.sin(2 * np.pi * hours / 24.0) + 0.05 * np.cumsum(rng.standard_normal(N))
    heater = steps(rng, 60, 0.0, 2000.0)
    window = (hours > 25.0) & (hours < 38.0) & (missing == "unknown")
    walls = 150.0 if missing == "extra_mode" else 0.0
    knows = missing != "coupling"

    @njit
    def rates(x, u):
        lost = 60.0 * (1.0 + 1.2 * u[2]) * (x[0] - u[1])
        return (u[0] - lost - walls * (x[0] - x[1])) / 6e5, walls * (x[0] - x[1]) / 4e6

    def nominal(x, u, p):
        return ((p[0] * u[0] - p[1] * (x[0] - (u[1] if knows else 5.0))) / 6e5,)

    y = machine(rates, np.column_stack([heater, outdoors, window]), dt, [15.0, 15.0])[:, :1]
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"efficiency [1]": 0.9, "loss [W/K]": 66.0},
        "states": ["room [K]"],
        "inputs": ["heater [W]", "outdoors [K]"],
    }
    # walls that follow slowly are creep, too
    same = ["creep"] * (missing == "extra_mode")
    return Trial(named(missing, *same), np.column_stack([heater, outdoors]), y, simulation)


def flow_loop(rng, missing: str) -> Trial:
    """A valve whose stem stands wherever it stood, in a loop with an integrator."""
    dt = 1.0
    wanted = 10.0 + steps(rng, 200, -3.0, 3.0)
    stem, flow, integral = 50.0, 10.0, 50.0
    u, y = np.zeros((N, 1)), np.zeros((N, 1))
    for k in range(N):
        integral += 0.15 * (wanted[k] - flow)
        u[k], y[k] = integral + 0.8 * (wanted[k] - flow), flow
        ahead = u[k, 0] - stem
        if missing == "valve_stiction":  # it holds against 2 %, and then moves all but 1 % of it
            stem += ahead - np.sign(ahead) if abs(ahead) > 2.0 else 0.0
        else:
            play = 1.5 if missing == "backlash" else 0.0
            stem += ahead - min(max(ahead, -play), play)
        flow = 0.2 * stem + (flow - 0.2 * stem) * np.exp(-dt / 5.0)
    if missing == "quantisation":
        y = np.round(y / 0.05) * 0.05

    def nominal(x, u, p):
        return ((p[0] * u[0] - x[0]) / p[1],)

    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"gain [l/s/%]": 0.18, "time constant [s]": 5.6},
        "states": ["flow [l/s]"],
        "inputs": ["valve [%]"],
    }
    return Trial(named(missing), u, y, simulation)


def greenhouse(rng, missing: str) -> Trial:
    """Air and floor; the heater's gain may follow the weather, or the sun shine on the air too."""
    dt = 60.0
    warmer = 0.03 if missing == "temperature_gain" else 0.0
    shining = 2.0 if missing == "coupling" else 0.0
    day = np.arange(N) * dt / 86_400 * 2 * np.pi
    sun = np.clip(np.sin(day), 0.0, None) * 600.0 + 60.0 * rng.random(N)
    outdoors = 8.0 + 6.0 * np.sin(day - 0.6) + 0.05 * np.cumsum(rng.standard_normal(N))
    u = np.column_stack([steps(rng, 45, 0.0, 10.0), outdoors, sun])

    @njit
    def rates(x, u):
        heat = 1000.0 * u[0] * (1.0 + warmer * (u[1] - 8.0)) + shining * u[2]
        return (heat - 250.0 * (x[0] - u[1]) - 80.0 * (x[0] - x[1])) / 4e5, 80.0 * (x[0] - x[1]) / 3e6

    def nominal(x, u, p):
        heat = p[0] * u[0] - p[1] * (x[0] - u[1])
        return (heat - p[2] * (x[0] - x[1])) / 4e5, p[2] * (x[0] - x[1]) / 3e6

    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"heater [W/kW]": 900.0, "loss [W/K]": 280.0, "floor [W/K]": 95.0},
        "states": ["air [degC]", "floor [degC]"],
        "inputs": ["heating [kW]", "outdoors [degC]", "sun [W/m^2]"],
    }
    return Trial(named(missing), u, machine(rates, u, dt, [12.0, 11.0])[:, :1], simulation)


def canal(rng, missing: str) -> Trial:
    """A gate between two pools; the lower one drains over a weir, both are measured."""
    dt = 30.0
    power = 1.5 if missing == "root_outflow" else 1.0
    leak = 0.05 if missing == "constant_load" else 0.0
    rim = 1.55 if missing == "overflow" else np.inf

    @njit
    def rates(x, u):
        passing = 1.6 * u[1] * np.sqrt(max(x[0], 0.0))
        rising = (u[0] - passing - leak) / 800.0
        if x[0] >= rim:
            rising = min(rising, 0.0)
        return rising, (passing - 1.1 * max(x[1], 0.0) ** power) / 1100.0

    def nominal(x, u, p):
        passing = p[0] * u[1] * np.sqrt(max(x[0], 0.0))
        return (u[0] - passing) / p[1], (passing - p[2] * x[1]) / p[3]

    u = np.column_stack([steps(rng, 60, 0.4, 1.2), steps(rng, 37, 0.35, 0.65)])
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"gate": 1.5, "upper [m^2]": 900.0, "weir [m^2/s]": 1.0, "lower [m^2]": 1000.0},
        "states": ["upper [m]", "lower [m]"],
        "inputs": ["inflow [m^3/s]", "gate [m]"],
        "output": (0, 1),
    }
    return Trial(named(missing), u, machine(rates, u, dt, [1.2, 0.9]), simulation)


def pressure_vessel(rng, missing: str) -> Trial:
    """Air is let in through a valve and out through an orifice; the gauge may follow late."""
    dt = 0.05
    leak = 0.12 if missing == "root_outflow" else 0.0
    lap = 0.05 if missing == "dead_zone" else 0.0

    @njit
    def rates(x, u):
        let_in = 0.8 * max(u[0] - lap, 0.0) * np.sqrt(max(8.0 - x[0], 0.0))
        let_out = 0.15 * u[1] * np.sqrt(max(x[0] - 1.0, 0.0)) + leak * np.sqrt(max(x[0], 0.0))
        return let_in - let_out, (x[0] - x[1]) / 0.4

    def nominal(x, u, p):
        let_in = p[0] * u[0] * np.sqrt(max(8.0 - x[0], 0.0))
        return (let_in - p[1] * u[1] * np.sqrt(max(x[0] - 1.0, 1e-9)),)

    u = np.column_stack([steps(rng, 40, 0.0, 0.5), steps(rng, 70, 0.5, 4.0)])
    x = machine(rates, u, dt, [2.0, 2.0])
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"valve [bar^0.5/s]": 0.7, "orifice [bar^0.5/s]": 0.17},
        "states": ["pressure [bar]"],
        "inputs": ["valve [-]", "vent [-]"],
    }
    return Trial(named(missing), u, x[:, 1:] if missing == "lag" else x[:, :1], simulation)


def bioreactor(rng, missing: str) -> Trial:
    """Cells that live on sugar (Monod), fed and thinned by one pump; hours."""
    dt = 0.1
    most = 0.28 if missing == "input_saturation" else np.inf

    @njit
    def rates(x, u):
        thinned, growth = min(u[0], most), 0.5 * x[1] / (0.4 + x[1]) * x[0]
        return growth - thinned * x[0], thinned * (u[1] - x[1]) - growth / 0.45

    def nominal(x, u, p):
        growth = p[0] * x[1] / (p[1] + x[1]) * x[0]
        return growth - u[0] * x[0], u[0] * (u[1] - x[1]) - growth / p[2]

    u = np.column_stack([steps(rng, 60, 0.1, 0.35), steps(rng, 90, 8.0, 12.0)])
    pumped = u.copy()
    if missing == "delay":
        pumped[3:, 0] = u[:-3, 0]
    simulation = {
        "function": nominal,
        "dt": dt,
        "parameters": {"fastest growth [1/h]": 0.55, "half speed at [g/l]": 0.35, "yield [-]": 0.5},
        "states": ["cells [g/l]", "sugar [g/l]"],
        "inputs": ["dilution [1/h]", "feed [g/l]"],
        "output": (0, 1),
    }
    return Trial(named(missing), u, machine(rates, pumped, dt, [4.0, 1.0]), simulation)

"""Synthetic machines with mass: a hardening spring, a servo axis with friction, a sticking valve."""

import numpy as np
from numba import njit
from sklearn.utils import check_random_state

from narx_sklearn.datasets._excitation import filtered_noise, multisine, point_to_point
from narx_sklearn.datasets._files import check_choice
from narx_sklearn.datasets._integrate import friction_step, rk4_run
from narx_sklearn.datasets._plant import check_input, check_numbers, check_state, make_plant
from narx_sklearn.datasets._results import SyntheticPlant

__all__ = ["make_duffing", "make_pneumatic_valve", "make_servo_axis"]

# Substeps a sample. Error against eight times as many, relative to the output: 1e-6, 1e-7, 1e-3.
DUFFING_SUBSTEPS = 10
SERVO_SUBSTEPS = 20
VALVE_SUBSTEPS = 100


@njit(cache=True, nogil=True)
def _duffing_rhs(x, u, rate, p, out):
    mass, damping, stiffness, cubic = p[0], p[1], p[2], p[3]
    out[0] = x[1]
    out[1] = (u[0] - damping * x[1] - stiffness * x[0] - cubic * x[0] ** 3) / mass


@njit(cache=True, nogil=True)
def _simulate_duffing(x0, u, p, h, n_substeps):
    return rk4_run(_duffing_rhs, x0, u, False, p, h, n_substeps)


def make_duffing(
    n_samples: int = 4096,
    *,
    u=None,
    excitation: str = "multisine",
    amplitude: float = 4.0,
    band: tuple[float, float] = (0.5, 25.0),
    sampling_period: float = 0.005,
    mass: float = 0.25,
    damping: float = 0.8,
    stiffness: float = 1000.0,
    cubic_stiffness: float = 5e5,
    initial_state=None,
    noise: float = 0.0,
    random_state=None,
) -> SyntheticPlant:
    """Make a mass on a damper and a hardening spring (Duffing oscillator).

    ``mass x'' + damping x' + stiffness x + cubic_stiffness x^3 = u``, output x. The resonance, at 10 Hz for
    small amplitudes, climbs with amplitude: the standard soft nonlinearity.

    Parameters
    ----------
    n_samples : int, default=4096
        Samples to make; ignored where `u` is given.
    u : array-like of shape (n_samples,) or None, default=None
        Force in N, taken as straight lines between samples. None makes one by `excitation`.
    excitation : {"multisine", "random"}, default="multisine"
        One period of a random-phase multisine, flat in `band`, or noise through a low-pass at the upper edge
        of `band`. Ignored where `u` is given.
    amplitude : float, default=4.0
        RMS of the excitation in N.
    band : tuple of float, default=(0.5, 25.0)
        Lower and upper frequency in Hz.
    sampling_period : float, default=0.005
        In seconds.
    mass, damping, stiffness, cubic_stiffness : float, defaults 0.25, 0.8, 1000.0, 500000.0
        In kg, N s/m, N/m, N/m^3. A negative `cubic_stiffness` softens, and a large input then escapes.
    initial_state : array-like of shape (2,) or None, default=None
        Position in m and velocity in m/s at the first sample; None is rest at zero.
    noise : float, default=0.0
        Standard deviation of white measurement noise, relative to that of the noise-free output.
    random_state : int, RandomState or None, default=None
        Seeds excitation and noise.

    Returns
    -------
    plant : SyntheticPlant
        ``force [N]`` to ``position [m]``; truth with ``velocity [m/s]``.

    Raises
    ------
    ValueError
        If an argument is out of range, or the simulation leaves the finite range.

    References
    ----------
    .. [1] T. Wigren, J. Schoukens, "Three free data sets for development and benchmarking in nonlinear system
       identification", European Control Conference, 2013, eqs. (13)-(14): the same form.

    Examples
    --------
    >>> from narx_sklearn.datasets import make_duffing
    >>> plant = make_duffing(random_state=0)
    >>> spring = plant.truth.parameters["cubic_stiffness"] * plant.truth.y.abs().max() ** 2
    >>> round(float(spring / plant.truth.parameters["stiffness"]), 1)
    0.6
    """
    check_choice("excitation", excitation, ("multisine", "random"))
    check_numbers(
        positive={"mass": mass, "sampling_period": sampling_period, "amplitude": amplitude},
        non_negative={"noise": noise, "damping": damping},
    )
    rng = check_random_state(random_state)
    force = check_input(u, n_samples)
    x0 = check_state(initial_state, ("position [m]", "velocity [m/s]"))
    if force is None and excitation == "multisine":
        force = amplitude * multisine(n_samples, band, sampling_period, rng)[:, None]
    elif force is None:
        random = filtered_noise(n_samples, band[1], sampling_period, rng)
        force = amplitude * (random / np.sqrt(np.mean(random**2)))[:, None]
    p = np.array([mass, damping, stiffness, cubic_stiffness])
    states = _simulate_duffing(x0, force, p, sampling_period / DUFFING_SUBSTEPS, DUFFING_SUBSTEPS)
    return make_plant(
        name="duffing",
        X={"force [N]": force[:, 0]},
        y=states[:, 0],
        output="position [m]",
        states={"position [m]": states[:, 0], "velocity [m/s]": states[:, 1]},
        sampling_period=sampling_period,
        equation="mass x'' + damping x' + stiffness x + cubic_stiffness x^3 = u",
        parameters={
            "mass": mass,
            "damping": damping,
            "stiffness": stiffness,
            "cubic_stiffness": cubic_stiffness,
        },
        noise=noise,
        rng=rng,
        DESCR="Mass on a damper and a hardening spring; force in, position out.",
    )


@njit(cache=True, nogil=True)
def _simulate_servo(reference, e, p, h, n_substeps):
    """Return position, velocity, voltage and measured position at the samples; `e` is measurement noise."""
    mass, viscous, coulomb, breakaway, offset = p[0], p[1], p[2], p[3], p[4]
    gain, kp, kv, v_max = p[5], p[6], p[7], p[8]
    n = reference.size
    out = np.empty((n, 4))
    q, v = reference[0], 0.0
    measured_before = q + e[0]
    for i in range(n):
        measured = q + e[i]
        command = kp * kv * (reference[i] - measured) - kv * (measured - measured_before) / (n_substeps * h)
        voltage = min(max(command, -v_max), v_max)
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = q, v, voltage, measured
        measured_before = measured
        for _ in range(n_substeps):
            v = friction_step(v, gain * voltage - offset, h, mass, viscous, 0.0, coulomb, breakaway)
            q += h * v
    return out


def make_servo_axis(
    n_samples: int = 20_000,
    *,
    reference=None,
    stroke: float = 0.2,
    sampling_period: float = 1e-3,
    mass: float = 95.1,
    viscous_friction: float = 203.5,
    coulomb_friction: float = 20.4,
    breakaway_force: float = 22.0,
    offset: float = -3.2,
    force_gain: float = 35.15,
    position_gain: float = 160.2,
    velocity_gain: float = 243.5,
    voltage_limit: float = 10.0,
    noise: float = 0.0,
    random_state=None,
) -> SyntheticPlant:
    """Make a linear servo drive with dry friction, recorded under position control.

    ``mass q'' = force_gain V - offset - viscous_friction q' - coulomb_friction sign(q')``; at rest the axis
    sticks until the force exceeds `breakaway_force`. The voltage comes from the controller
    ``V = position_gain velocity_gain (r - y) - velocity_gain dy``, sampled, held, and limited: the plant
    integrates, and its input depends on its output.

    Parameters
    ----------
    n_samples : int, default=20_000
        Samples to make; ignored where `reference` is given.
    reference : array-like of shape (n_samples,) or None, default=None
        Position wanted, in m; the axis starts at its first value, at rest. None makes smooth moves of 1.2 to
        2 s between random positions.
    stroke : float, default=0.2
        Largest position of the random moves, in m.
    sampling_period : float, default=1e-3
        In seconds; also the period of the controller.
    mass, viscous_friction : float, defaults 95.1, 203.5
        In kg and N s/m.
    coulomb_friction, breakaway_force, offset : float, defaults 20.4, 22.0, -3.2
        In N. `breakaway_force` may not be less than `coulomb_friction`.
    force_gain, position_gain, velocity_gain, voltage_limit : float, defaults 35.15, 160.2, 243.5, 10.0
        In N/V, 1/s, V s/m, V.
    noise : float, default=0.0
        Standard deviation of white noise on the measured position, relative to that of the reference. The
        controller acts on the measured position, so the noise reaches the voltage as well.
    random_state : int, RandomState or None, default=None
        Seeds reference and noise.

    Returns
    -------
    plant : SyntheticPlant
        ``voltage [V]`` to ``position [m]``; truth with ``velocity [m/s]`` and ``reference [m]``.

    Raises
    ------
    ValueError
        If an argument is out of range, or the simulation leaves the finite range.

    Notes
    -----
    Default values are rounded from the published fit of the EMPS drive; the breakaway force is ours.

    References
    ----------
    .. [1] A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", Workshop on Nonlinear
       System Identification Benchmarks, 2019.

    Examples
    --------
    >>> from narx_sklearn.datasets import make_servo_axis
    >>> plant = make_servo_axis(5000, random_state=0)
    >>> error = plant.y - plant.truth.states["reference [m]"]
    >>> round(float(error.abs().max()), 4)
    0.0011
    """
    check_numbers(
        positive={
            "mass": mass,
            "sampling_period": sampling_period,
            "stroke": stroke,
            "voltage_limit": voltage_limit,
        },
        non_negative={
            "viscous_friction": viscous_friction,
            "coulomb_friction": coulomb_friction,
            "noise": noise,
        },
    )
    _check_breakaway(breakaway_force, coulomb_friction)
    rng = check_random_state(random_state)
    given = check_input(reference, n_samples, name="reference")
    moves = (1.2, 2.0)  # s
    r = point_to_point(n_samples, sampling_period, stroke, moves, rng) if given is None else given[:, 0]
    e = noise * np.std(r) * rng.standard_normal(r.size)
    parameters = {
        "mass": mass,
        "viscous_friction": viscous_friction,
        "coulomb_friction": coulomb_friction,
        "breakaway_force": breakaway_force,
        "offset": offset,
        "force_gain": force_gain,
        "position_gain": position_gain,
        "velocity_gain": velocity_gain,
        "voltage_limit": voltage_limit,
    }
    p = np.array(list(parameters.values()), dtype=float)
    q, v, voltage, measured = _simulate_servo(r, e, p, sampling_period / SERVO_SUBSTEPS, SERVO_SUBSTEPS).T
    return make_plant(
        name="servo_axis",
        X={"voltage [V]": voltage},
        y=q,
        y_measured=measured,
        output="position [m]",
        states={"position [m]": q, "velocity [m/s]": v, "reference [m]": r},
        sampling_period=sampling_period,
        equation=(
            "mass q'' = force_gain V - offset - viscous_friction q' - coulomb_friction sign(q'), stuck at "
            "rest while |force_gain V - offset| <= breakaway_force; V = limit(position_gain velocity_gain "
            "(r - y) - velocity_gain dy, voltage_limit)"
        ),
        parameters=parameters,
        noise=noise,
        rng=rng,
        DESCR="Drive with Coulomb and viscous friction in a position loop; voltage in, position out.",
    )


@njit(cache=True, nogil=True)
def _simulate_valve(command, p, h, n_substeps):
    """Return pressure, stem position, stem velocity and reading of the linkage at the samples."""
    lag, area, p_low, p_span, mass, damping, stiffness = p[0], p[1], p[2], p[3], p[4], p[5], p[6]
    coulomb, breakaway, stribeck, play = p[7], p[8], p[9], p[10]
    n = command.size
    out = np.empty((n, 4))
    decay = np.exp(-h / lag)
    pressure = p_low + p_span * (command[0] - 1.0) / 4.0
    x = area * (pressure - p_low) / stiffness
    v, reading = 0.0, x
    for i in range(n):
        out[i, 0], out[i, 1], out[i, 2], out[i, 3] = pressure, x, v, reading
        target = p_low + p_span * (command[i] - 1.0) / 4.0
        for _ in range(n_substeps):
            pressure = target + (pressure - target) * decay
            force = area * (pressure - p_low) - stiffness * x
            friction = coulomb + (breakaway - coulomb) * np.exp(-((v / stribeck) ** 2))
            v = friction_step(v, force, h, mass, damping, stiffness, friction, breakaway)
            x += h * v
            # Play operator: the linkage follows the stem once its gap is closed.
            reading = min(max(reading, x - play), x + play)
    return out


def make_pneumatic_valve(
    n_samples: int = 20_000,
    *,
    u=None,
    cutoff: float = 0.1,
    sampling_period: float = 0.01,
    pressure_lag: float = 0.1,
    diaphragm_area: float = 0.0645,
    mass: float = 1.36,
    damping: float = 612.0,
    stiffness: float = 210_000.0,
    coulomb_friction: float = 250.0,
    breakaway_force: float = 255.0,
    stribeck_velocity: float = 2.5e-4,
    dead_band: float = 4e-4,
    noise: float = 0.0,
    random_state=None,
) -> SyntheticPlant:
    """Make a spring-diaphragm control valve whose stem sticks and whose linkage has play.

    ``pressure_lag P' = P(u) - P`` and ``mass x'' = diaphragm_area (P - P0) - stiffness x - damping x' - F``,
    where F is dry friction that falls from `breakaway_force` at rest to `coulomb_friction` in motion. The
    position sensor sits behind a gap of width `dead_band`. After every reversal of the command nothing
    moves until it has come back by about ``2 coulomb_friction`` in force: hysteresis with a continuum of
    steady states.

    Parameters
    ----------
    n_samples : int, default=20_000
        Samples to make; ignored where `u` is given.
    u : array-like of shape (n_samples,) or None, default=None
        Command in V, held between samples: 1 to 5 V for 20.7 to 103.4 kPa (3 to 15 psi). The valve starts in
        the balance of spring and pressure. None makes low-pass noise of 3 V plus or minus 0.8 V.
    cutoff : float, default=0.1
        Upper frequency of the noise in Hz.
    sampling_period : float, default=0.01
        In seconds.
    pressure_lag : float, default=0.1
        Time constant of the current-to-pressure converter and line, in s.
    diaphragm_area, mass, damping, stiffness : float, defaults 0.0645, 1.36, 612.0, 210000.0
        In m^2, kg, N s/m, N/m.
    coulomb_friction, breakaway_force, stribeck_velocity : float, defaults 250.0, 255.0, 0.00025
        In N, N, m/s. `breakaway_force` may not be less than `coulomb_friction`.
    dead_band : float, default=4e-4
        Play between stem and position sensor, in m (full width).
    noise : float, default=0.0
        Standard deviation of white measurement noise, relative to that of the noise-free output.
    random_state : int, RandomState or None, default=None
        Seeds input and noise.

    Returns
    -------
    plant : SyntheticPlant
        ``command [V]`` to ``position [V]`` (1 to 5 V over the travel of 25.4 mm); truth with
        ``pressure [Pa]``, ``stem [m]``, ``velocity [m/s]``.

    Raises
    ------
    ValueError
        If an argument is out of range, or the simulation leaves the finite range.

    Notes
    -----
    Mass, area, spring, damping and the Stribeck form are of the size given in [1]_; friction is smaller than
    there, so that the valve moves at most reversals.

    References
    ----------
    .. [1] A. Kayihan, F.J. Doyle III, "Friction compensation for a process control valve", Control
       Engineering Practice 8(7), 2000.
    .. [2] P.E.O.G.B. Abreu, "Identification and compensator design using NARX models", thesis, UFMG, 2021,
       section 5.3: the experiment with a real valve that this one imitates.

    Examples
    --------
    >>> from narx_sklearn.datasets import make_pneumatic_valve
    >>> plant = make_pneumatic_valve(5000, random_state=0)
    >>> stuck = plant.truth.states["velocity [m/s]"] == 0.0
    >>> round(float(stuck.mean()), 1)
    0.8
    """
    check_numbers(
        positive={
            "sampling_period": sampling_period,
            "cutoff": cutoff,
            "pressure_lag": pressure_lag,
            "diaphragm_area": diaphragm_area,
            "mass": mass,
            "stiffness": stiffness,
            "stribeck_velocity": stribeck_velocity,
        },
        non_negative={
            "damping": damping,
            "coulomb_friction": coulomb_friction,
            "dead_band": dead_band,
            "noise": noise,
        },
    )
    _check_breakaway(breakaway_force, coulomb_friction)
    rng = check_random_state(random_state)
    given = check_input(u, n_samples)
    if given is None:
        command = 3.0 + 0.8 * filtered_noise(n_samples, cutoff, sampling_period, rng)
    else:
        command = given[:, 0]
    pressure_low, pressure_span, travel = 20.7e3, 82.7e3, 0.0254  # 3 psi, 12 psi, one inch
    parameters = {
        "pressure_lag": pressure_lag,
        "diaphragm_area": diaphragm_area,
        "pressure_low": pressure_low,
        "pressure_span": pressure_span,
        "mass": mass,
        "damping": damping,
        "stiffness": stiffness,
        "coulomb_friction": coulomb_friction,
        "breakaway_force": breakaway_force,
        "stribeck_velocity": stribeck_velocity,
        "half_dead_band": dead_band / 2.0,
    }
    p = np.array(list(parameters.values()), dtype=float)
    pressure, stem, velocity, reading = _simulate_valve(
        command, p, sampling_period / VALVE_SUBSTEPS, VALVE_SUBSTEPS
    ).T
    return make_plant(
        name="pneumatic_valve",
        X={"command [V]": command},
        y=1.0 + 4.0 * reading / travel,
        output="position [V]",
        states={"pressure [Pa]": pressure, "stem [m]": stem, "velocity [m/s]": velocity},
        sampling_period=sampling_period,
        equation=(
            "pressure_lag P' = pressure_low + pressure_span (u - 1) / 4 - P; mass x'' = diaphragm_area "
            "(P - pressure_low) - stiffness x - damping x' - F(x'); F(v) = [coulomb_friction + "
            "(breakaway_force - coulomb_friction) exp(-(v / stribeck_velocity)^2)] sign(v), stuck at rest up "
            "to breakaway_force; y = 1 + 4 play(x, half_dead_band) / 0.0254"
        ),
        parameters=parameters,
        noise=noise,
        rng=rng,
        DESCR="Control valve with sticking stem and play in the linkage; command in, stem reading out.",
    )


def _check_breakaway(breakaway_force: float, coulomb_friction: float) -> None:
    if not (np.isfinite(breakaway_force) and breakaway_force >= coulomb_friction):
        raise ValueError(
            f"breakaway_force is {breakaway_force!r}, but must be finite and at least coulomb_friction "
            f"({coulomb_friction!r})."
        )

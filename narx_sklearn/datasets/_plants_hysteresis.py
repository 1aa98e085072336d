"""Synthetic devices with hysteresis: a piezo actuator, a magneto-rheological damper, a diode circuit."""

import numpy as np
from numba import njit
from sklearn.utils import check_random_state

from narx_sklearn.datasets._excitation import filtered_noise
from narx_sklearn.datasets._integrate import rk4_run
from narx_sklearn.datasets._plant import check_input, check_numbers, check_state, make_plant
from narx_sklearn.datasets._results import SyntheticPlant

__all__ = ["make_hysteresis_circuit", "make_mr_damper", "make_piezo_bench"]

DAMPER_SUBSTEPS = 10  # the yield element relaxes at up to 5000 1/s: ten steps a millisecond resolve it
CIRCUIT_SUBSTEPS = 10  # the fastest time constant is the series resistance times the capacity, 1 ms


@njit(cache=True, nogil=True)
def _piezo_rhs(x, u, rate, p, out):
    amplitude, beta, gamma = p[0], p[1], p[2]
    out[0] = amplitude * rate[0] - beta * abs(rate[0]) * x[0] - gamma * rate[0] * abs(x[0])


@njit(cache=True, nogil=True)
def _simulate_piezo(x0, u, p, h, n_substeps):
    return rk4_run(_piezo_rhs, x0, u, False, p, h, n_substeps)


def make_piezo_bench(
    n_samples: int = 50_000,
    *,
    u=None,
    amplitude: float = 80.0,
    cutoff: float = 1.0,
    sampling_period: float = 1e-3,
    A: float = 0.9,
    beta: float = 0.008,
    gamma: float = 0.008,
    d_p: float = 1.6,
    initial_state=None,
    noise: float = 0.0,
    random_state=None,
) -> SyntheticPlant:
    """Make the piezo actuator of the thesis: a Bouc-Wen element beside a straight gain.

    ``h' = A u' - beta |u'| h - gamma u' |h|``, ``y = d_p u - h``. Without dynamics of its own it depends on
    the path of the voltage, not on its rate, and remembers forever.

    Parameters
    ----------
    n_samples : int, default=50_000
        Samples to make; ignored where `u` is given.
    u : array-like of shape (n_samples,) or None, default=None
        Voltage in V, taken as straight lines between samples. None makes white noise through a fifth-order
        Butterworth low-pass, stretched to plus and minus `amplitude` (the form of eqs. (2.22)-(2.25) with one
        frequency and one operating point).
    amplitude : float, default=80.0
        Largest voltage of the noise in V.
    cutoff : float, default=1.0
        Upper frequency of the noise in Hz.
    sampling_period : float, default=1e-3
        In seconds; also the step of the fourth-order Runge-Kutta method, as in the thesis.
    A, beta, gamma, d_p : float, defaults 0.9, 0.008, 0.008, 1.6
        In um/V, 1/V, 1/V, um/V.
    initial_state : array-like of shape (1,) or None, default=None
        h in um at the first sample; None is zero.
    noise : float, default=0.0
        Standard deviation of white measurement noise, relative to that of the noise-free output.
    random_state : int, RandomState or None, default=None
        Seeds input and noise.

    Returns
    -------
    plant : SyntheticPlant
        ``voltage [V]`` to ``displacement [um]``; truth with ``h [um]``.

    Raises
    ------
    ValueError
        If an argument is out of range, or the simulation leaves the finite range.

    References
    ----------
    .. [1] P.E.O.G.B. Abreu, "Identification and compensator design using NARX models", thesis, UFMG, 2021,
       eq. (5.1).
    .. [2] M. Rakotondrabe, "Bouc-Wen modeling and inverse multiplicative structure to compensate hysteresis
       nonlinearity in piezoelectric actuators", IEEE Trans. Autom. Sci. Eng. 8(2), 2011.

    Examples
    --------
    Loading from zero to 80 V follows ``h = A / (beta + gamma) (1 - exp(-(beta + gamma) u))``:

    >>> import numpy as np
    >>> from narx_sklearn.datasets import make_piezo_bench
    >>> plant = make_piezo_bench(u=np.linspace(0, 80, 1001))
    >>> round(float(plant.y.iloc[-1]), 3)
    87.39
    """
    check_numbers(
        positive={"sampling_period": sampling_period, "cutoff": cutoff, "amplitude": amplitude},
        non_negative={"noise": noise},
    )
    rng = check_random_state(random_state)
    voltage = check_input(u, n_samples)
    x0 = check_state(initial_state, ("h [um]",))
    if voltage is None:
        voltage = amplitude * filtered_noise(n_samples, cutoff, sampling_period, rng)[:, None]
    h = _simulate_piezo(x0, voltage, np.array([A, beta, gamma], dtype=float), sampling_period, 1)[:, 0]
    return make_plant(
        name="piezo_bench",
        X={"voltage [V]": voltage[:, 0]},
        y=d_p * voltage[:, 0] - h,
        output="displacement [um]",
        states={"h [um]": h},
        sampling_period=sampling_period,
        equation="h' = A u' - beta |u'| h - gamma u' |h|; y = d_p u - h",
        parameters={"A": A, "beta": beta, "gamma": gamma, "d_p": d_p},
        noise=noise,
        rng=rng,
        DESCR="Piezo actuator with rate-independent Bouc-Wen hysteresis; voltage in, displacement out.",
    )


@njit(cache=True, nogil=True)
def _damper_internal_rate(x, displacement, speed, p):
    """Return the rate of the damper's internal displacement and the damping of its outer dashpot."""
    c0 = p[0] + p[1] * x[2]
    c1 = p[2] + p[3] * x[2]
    alpha = p[4] + p[5] * x[2]
    rate = (alpha * x[1] + c0 * speed + p[6] * (displacement - x[0])) / (c0 + c1)
    return rate, c1


@njit(cache=True, nogil=True)
def _damper_rhs(x, u, rate, p, out):
    """States: internal displacement, yield element z, filtered voltage. Inputs: displacement, voltage."""
    gamma, beta, n, amplitude, eta = p[8], p[9], p[10], p[11], p[12]
    internal, _ = _damper_internal_rate(x, u[0], rate[0], p)
    slip = rate[0] - internal
    z = abs(x[1])
    out[0] = internal
    out[1] = -gamma * abs(slip) * x[1] * z ** (n - 1.0) - beta * slip * z**n + amplitude * slip
    out[2] = -eta * (x[2] - u[1])


@njit(cache=True, nogil=True)
def _simulate_damper(x0, u, p, h, n_substeps):
    """Return the states and, as last column, the force at the samples."""
    states = rk4_run(_damper_rhs, x0, u, False, p, h, n_substeps)
    n_samples = u.shape[0]
    out = np.empty((n_samples, 4))
    for i in range(n_samples):
        before = max(i - 1, 0)
        speed = (u[before + 1, 0] - u[before, 0]) / (n_substeps * h)  # of the segment that ends here
        internal, c1 = _damper_internal_rate(states[i], u[i, 0], speed, p)
        out[i, :3] = states[i]
        out[i, 3] = c1 * internal + p[7] * (u[i, 0] - p[13])
    return out


def make_mr_damper(
    n_samples: int = 10_000,
    *,
    u=None,
    amplitude: float = 1.5,
    voltage_limit: float = 2.25,
    cutoff: float = 3.0,
    sampling_period: float = 1e-3,
    c0a: float = 20.2,
    c0b: float = 2.68,
    c1a: float = 350.0,
    c1b: float = 70.7,
    alpha_a: float = 44.9,
    alpha_b: float = 638.0,
    k0: float = 15.0,
    k1: float = 5.37,
    gamma: float = 39.3,
    beta: float = 39.3,
    n: float = 2.0,
    A: float = 47.2,
    eta: float = 251.0,
    x0: float = 0.0,
    noise: float = 0.0,
    random_state=None,
) -> SyntheticPlant:
    """Make a magneto-rheological damper by the phenomenological model, with two inputs.

    With displacement x, internal displacement w, voltage v and its filtered value s:
    ``F = c1 w' + k1 (x - x0)``, ``w' = (alpha z + c0 x' + k0 (x - w)) / (c0 + c1)``,
    ``z' = -gamma |x' - w'| z |z|^(n-1) - beta (x' - w') |z|^n + A (x' - w')``, ``s' = -eta (s - v)``,
    ``alpha = alpha_a + alpha_b s``, ``c0 = c0a + c0b s``, ``c1 = c1a + c1b s``.

    Parameters
    ----------
    n_samples : int, default=10_000
        Samples to make; ignored where `u` is given.
    u : array-like of shape (n_samples, 2) or None, default=None
        Voltage in V and displacement in cm, taken as straight lines between samples. None makes independent
        low-pass noise: displacement of plus and minus `amplitude`, voltage of 0 to `voltage_limit`.
    amplitude : float, default=1.5
        In cm.
    voltage_limit : float, default=2.25
        In V.
    cutoff : float, default=3.0
        Upper frequency of both inputs in Hz.
    sampling_period : float, default=1e-3
        In seconds.
    c0a, c0b, c1a, c1b : float, defaults 20.2, 2.68, 350.0, 70.7
        Damping without voltage (a) in N s/cm and per voltage (b) in N s/(cm V).
    alpha_a, alpha_b : float, defaults 44.9, 638.0
        Yield force per z, in N/cm and N/(cm V).
    k0, k1 : float, defaults 15.0, 5.37
        Stiffness in N/cm.
    gamma, beta : float, default=39.3
        In 1/cm^2.
    n, A : float, defaults 2.0, 47.2
        Exponent and slope of the yield element, without unit.
    eta : float, default=251.0
        Rate of the driver in 1/s.
    x0 : float, default=0.0
        Displacement at which the accumulator is without force, in cm.
    noise : float, default=0.0
        Standard deviation of white measurement noise, relative to that of the noise-free output.
    random_state : int, RandomState or None, default=None
        Seeds inputs and noise.

    Returns
    -------
    plant : SyntheticPlant
        ``voltage [V]``, ``displacement [cm]`` to ``force [N]``; truth with ``internal [cm]``, ``z [cm]``,
        ``filtered voltage [V]``.

    Raises
    ------
    ValueError
        If an argument is out of range, or the simulation leaves the finite range.

    Notes
    -----
    The damper starts at rest at its first displacement and voltage. Printed parameter sets of this model
    differ; the default one follows [2]_.

    References
    ----------
    .. [1] B.F. Spencer, S.J. Dyke, M.K. Sain, J.D. Carlson, "Phenomenological model for magnetorheological
       dampers", J. Eng. Mech. 123(3), 1997.
    .. [2] A. Leva, L. Piroddi, "NARX-based technique for the modelling of magneto-rheological damping
       devices", Smart Mater. Struct. 11(1), 2002.

    Examples
    --------
    At a constant 2 V and 5 cm/s the yield element has settled, ``z^2 = A / (beta + gamma)``:

    >>> import numpy as np
    >>> from narx_sklearn.datasets import make_mr_damper
    >>> plant = make_mr_damper(u=np.column_stack([np.full(2001, 2.0), np.linspace(0, 10, 2001)]))
    >>> round(float(plant.truth.states["z [cm]"].iloc[-1]), 4)
    0.7749
    """
    check_numbers(
        positive={
            "sampling_period": sampling_period,
            "cutoff": cutoff,
            "amplitude": amplitude,
            "voltage_limit": voltage_limit,
            "c0a + c1a": c0a + c1a,
            "n": n,
            "eta": eta,
        },
        non_negative={"noise": noise},
    )
    rng = check_random_state(random_state)
    given = check_input(u, n_samples, n_inputs=2)
    if given is None:
        displacement = amplitude * filtered_noise(n_samples, cutoff, sampling_period, rng)
        voltage = voltage_limit * (1.0 + filtered_noise(n_samples, cutoff, sampling_period, rng)) / 2.0
    else:
        voltage, displacement = given.T
    parameters = {
        "c0a": c0a,
        "c0b": c0b,
        "c1a": c1a,
        "c1b": c1b,
        "alpha_a": alpha_a,
        "alpha_b": alpha_b,
        "k0": k0,
        "k1": k1,
        "gamma": gamma,
        "beta": beta,
        "n": n,
        "A": A,
        "eta": eta,
        "x0": x0,
    }
    p = np.array(list(parameters.values()), dtype=float)
    start = np.array([displacement[0], 0.0, voltage[0]])
    inputs = np.column_stack([displacement, voltage])
    internal, z, filtered, force = _simulate_damper(
        start, inputs, p, sampling_period / DAMPER_SUBSTEPS, DAMPER_SUBSTEPS
    ).T
    return make_plant(
        name="mr_damper",
        X={"voltage [V]": voltage, "displacement [cm]": displacement},
        y=force,
        output="force [N]",
        states={"internal [cm]": internal, "z [cm]": z, "filtered voltage [V]": filtered},
        sampling_period=sampling_period,
        equation=(
            "F = c1 w' + k1 (x - x0); w' = (alpha z + c0 x' + k0 (x - w)) / (c0 + c1); z' = -gamma |x' - w'| "
            "z |z|^(n-1) - beta (x' - w') |z|^n + A (x' - w'); s' = -eta (s - v); "
            "alpha = alpha_a + alpha_b s; c0 = c0a + c0b s; c1 = c1a + c1b s"
        ),
        parameters=parameters,
        noise=noise,
        rng=rng,
        DESCR="Magneto-rheological damper; voltage and displacement in, force out.",
    )


@njit(cache=True, nogil=True)
def _diode_current(voltage, resistance, saturation, slope):
    """Return the current through a resistor and a pair of opposed diodes, ``2 saturation sinh(v / slope)``.

    Newton's method in ``w = v / slope`` from above, where the equation is convex: it descends to the root.
    """
    e = abs(voltage)
    w = min(e / slope, np.arcsinh(e / (2.0 * saturation * resistance)))
    for _ in range(50):
        error = 2.0 * saturation * resistance * np.sinh(w) + slope * w - e
        step = error / (2.0 * saturation * resistance * np.cosh(w) + slope)
        w -= step
        if step <= 1e-14 * (1.0 + w):
            break
    return np.copysign(2.0 * saturation * np.sinh(w), voltage)


@njit(cache=True, nogil=True)
def _circuit_rhs(x, u, rate, p, out):
    resistance, capacity, leak, saturation, slope = p[0], p[1], p[2], p[3], p[4]
    current = _diode_current(u[0] - x[0], resistance, saturation, slope)
    out[0] = (current - x[0] / leak) / capacity


@njit(cache=True, nogil=True)
def _simulate_circuit(x0, u, p, h, n_substeps):
    return rk4_run(_circuit_rhs, x0, u, False, p, h, n_substeps)


def make_hysteresis_circuit(
    n_samples: int = 20_000,
    *,
    u=None,
    amplitude: float = 5.0,
    cutoff: float = 1.0,
    sampling_period: float = 1e-3,
    resistance: float = 1e3,
    capacity: float = 1e-6,
    leak_resistance: float = 1e8,
    saturation_current: float = 1e-9,
    diode_slope: float = 0.1,
    initial_state=None,
    noise: float = 0.0,
    random_state=None,
) -> SyntheticPlant:
    """Make a circuit with hysteresis: a capacitor charged through opposed diodes.

    ``capacity y' = i - y / leak_resistance``, ``u - y = resistance i + diode_slope asinh(i / (2
    saturation_current))``. The diodes hardly conduct until about a volt stands across them, so after every
    reversal of the input the output waits: a soft play, which also relaxes slowly at rest.

    Parameters
    ----------
    n_samples : int, default=20_000
        Samples to make; ignored where `u` is given.
    u : array-like of shape (n_samples,) or None, default=None
        Input voltage in V, taken as straight lines between samples. None makes low-pass noise of plus and
        minus `amplitude`.
    amplitude : float, default=5.0
        In V.
    cutoff : float, default=1.0
        Upper frequency of the noise in Hz.
    sampling_period : float, default=1e-3
        In seconds.
    resistance, capacity, leak_resistance : float, defaults 1000.0, 1e-06, 100000000.0
        Series resistance in ohm, capacity in F, resistance across the capacitor in ohm.
    saturation_current : float, default=1e-9
        Of the diodes, in A.
    diode_slope : float, default=0.1
        Emission coefficient times thermal voltage times number of diodes in series, in V.
    initial_state : array-like of shape (1,) or None, default=None
        Voltage of the capacitor at the first sample; None is zero.
    noise : float, default=0.0
        Standard deviation of white measurement noise, relative to that of the noise-free output.
    random_state : int, RandomState or None, default=None
        Seeds input and noise.

    Returns
    -------
    plant : SyntheticPlant
        ``input [V]`` to ``output [V]``; truth with ``current [A]``.

    Raises
    ------
    ValueError
        If an argument is out of range, or the simulation leaves the finite range.

    Notes
    -----
    The circuit is ours. The thesis cites the identification of a real circuit with hysteresis, [1]_.

    References
    ----------
    .. [1] W.R. Lacerda Junior, S.A.M. Martins, E.G. Nepomuceno, M.J. Lacerda, "Control of hysteretic systems
       through an analytical inverse compensation based on a NARX model", IEEE Access 7, 2019.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.datasets import make_hysteresis_circuit
    >>> t = np.arange(3000) * 1e-3
    >>> plant = make_hysteresis_circuit(u=5 * np.sin(2 * np.pi * t))
    >>> round(float(plant.y.max()), 1)
    4.2
    """
    check_numbers(
        positive={
            "sampling_period": sampling_period,
            "cutoff": cutoff,
            "amplitude": amplitude,
            "resistance": resistance,
            "capacity": capacity,
            "leak_resistance": leak_resistance,
            "saturation_current": saturation_current,
            "diode_slope": diode_slope,
        },
        non_negative={"noise": noise},
    )
    rng = check_random_state(random_state)
    source = check_input(u, n_samples)
    x0 = check_state(initial_state, ("output [V]",))
    if source is None:
        source = amplitude * filtered_noise(n_samples, cutoff, sampling_period, rng)[:, None]
    parameters = {
        "resistance": resistance,
        "capacity": capacity,
        "leak_resistance": leak_resistance,
        "saturation_current": saturation_current,
        "diode_slope": diode_slope,
    }
    p = np.array(list(parameters.values()), dtype=float)
    y = _simulate_circuit(x0, source, p, sampling_period / CIRCUIT_SUBSTEPS, CIRCUIT_SUBSTEPS)[:, 0]
    gaps = source[:, 0] - y
    current = np.array([_diode_current(gap, resistance, saturation_current, diode_slope) for gap in gaps])
    return make_plant(
        name="hysteresis_circuit",
        X={"input [V]": source[:, 0]},
        y=y,
        output="output [V]",
        states={"current [A]": current},
        sampling_period=sampling_period,
        equation=(
            "capacity y' = i - y / leak_resistance; u - y = resistance i + diode_slope "
            "asinh(i / (2 saturation_current))"
        ),
        parameters=parameters,
        noise=noise,
        rng=rng,
        DESCR="Capacitor charged through opposed diodes: soft play; input voltage in, capacitor voltage out.",
    )

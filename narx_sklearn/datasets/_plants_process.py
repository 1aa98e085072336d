"""Synthetic processes: two tanks with overflow, and a neutralisation."""

import numpy as np
from numba import njit
from sklearn.utils import check_random_state

from narx_sklearn.datasets._excitation import filtered_noise, random_steps
from narx_sklearn.datasets._integrate import rk4_run, rk4_step
from narx_sklearn.datasets._plant import check_input, check_numbers, check_state, make_plant
from narx_sklearn.datasets._results import SyntheticPlant

__all__ = ["make_cascaded_tanks", "make_ph_process"]

# Substeps a sample. Error against eight times as many, relative to the output: 2e-4 (where a tank starts to
# run over, else far less) and 1e-6.
TANK_SUBSTEPS = 20
PH_SUBSTEPS = 5
GRAVITY = 981.0  # cm/s^2
WATER = 1e-14  # ionic product of water at 25 degC, mol^2/L^2


@njit(cache=True, nogil=True)
def _tanks_rhs(x, u, rate, p, out):
    """States: volumes of upper tank, lower tank, lost over the rim, pumped in, drained out; in cm^3."""
    area_upper, area_lower, outlet_upper, outlet_lower, pump_gain = p[0], p[1], p[2], p[3], p[4]
    pumped = pump_gain * max(u[0], 0.0)
    transfer = outlet_upper * np.sqrt(2.0 * GRAVITY * max(x[0], 0.0) / area_upper)
    drained = outlet_lower * np.sqrt(2.0 * GRAVITY * max(x[1], 0.0) / area_lower)
    out[0] = pumped - transfer
    out[1] = transfer - drained
    out[2] = 0.0
    out[3] = pumped
    out[4] = drained


@njit(cache=True, nogil=True)
def _simulate_tanks(x0, u, p, h, n_substeps):
    """Return the states at the samples; what stands above a rim after a substep runs over."""
    full_upper, full_lower, caught = p[0] * p[5], p[1] * p[5], p[6]
    n_samples = u.shape[0]
    states = np.empty((n_samples, x0.size))
    k, x, x_stage = np.empty((4, x0.size)), x0.copy(), np.empty(x0.size)
    u_stage, rate = np.empty(1), np.zeros(1)
    for i in range(n_samples):
        states[i] = x
        if i == n_samples - 1:
            break
        for _ in range(n_substeps):
            rk4_step(_tanks_rhs, x, u[i], rate, p, h, k, x_stage, u_stage)
            spill = max(x[0] - full_upper, 0.0)
            x[0] -= spill
            x[1] += caught * spill
            excess = max(x[1] - full_lower, 0.0)
            x[1] -= excess
            x[2] += (1.0 - caught) * spill + excess
    return states


def make_cascaded_tanks(
    n_samples: int = 1024,
    *,
    u=None,
    cutoff: float = 0.01,
    sampling_period: float = 4.0,
    upper_area: float = 30.0,
    lower_area: float = 30.0,
    upper_outlet: float = 0.1,
    lower_outlet: float = 0.1,
    pump_gain: float = 3.3,
    height: float = 10.0,
    caught_share: float = 0.5,
    initial_state=None,
    noise: float = 0.0,
    random_state=None,
) -> SyntheticPlant:
    """Make two tanks, one draining into the other, that can run over.

    ``A1 h1' = pump_gain u - a1 sqrt(2 g h1)``, ``A2 h2' = a1 sqrt(2 g h1) - a2 sqrt(2 g h2)``, output h2.
    What stands above the rim of the upper tank runs over; `caught_share` of it falls into the lower tank. The
    time constants grow with the level (soft), and the overflow is a hard limit with its own short-cut.

    Parameters
    ----------
    n_samples : int, default=1024
        Samples to make; ignored where `u` is given.
    u : array-like of shape (n_samples,) or None, default=None
        Pump voltage in V, held between samples; the pump does not run backwards, below 0 V it stands. None
        makes low-pass noise from 0 to 6 V.
    cutoff : float, default=0.01
        Upper frequency of the noise in Hz.
    sampling_period : float, default=4.0
        In seconds.
    upper_area, lower_area : float, default=30.0
        Cross-sections A1 and A2 of the tanks in cm^2.
    upper_outlet, lower_outlet : float, default=0.1
        Cross-sections a1 and a2 of the outlets in cm^2.
    pump_gain : float, default=3.3
        In cm^3/(s V).
    height : float, default=10.0
        Of both tanks, in cm.
    caught_share : float, default=0.5
        Share of the upper tank's overflow that the lower tank catches, 0 to 1.
    initial_state : array-like of shape (2,) or None, default=None
        Levels of the upper and lower tank in cm, 0 to `height`; None is empty.
    noise : float, default=0.0
        Standard deviation of white measurement noise, relative to that of the noise-free output.
    random_state : int, RandomState or None, default=None
        Seeds input and noise.

    Returns
    -------
    plant : SyntheticPlant
        ``pump [V]`` to ``lower level [cm]``; truth with ``upper level [cm]`` and, since the first sample,
        ``lost [cm^3]``, ``pumped [cm^3]``, ``drained [cm^3]``.

    Raises
    ------
    ValueError
        If an argument is out of range, or the simulation leaves the finite range.

    References
    ----------
    .. [1] M. Schoukens, P. Mattsson, T. Wigren, J.P. Noel, "Cascaded tanks benchmark combining soft and hard
       nonlinearities", Workshop on Nonlinear System Identification Benchmarks, 2016.

    Examples
    --------
    >>> from narx_sklearn.datasets import make_cascaded_tanks
    >>> plant = make_cascaded_tanks(random_state=0)
    >>> float(plant.truth.states["upper level [cm]"].max())
    10.0
    """
    check_numbers(
        positive={
            "sampling_period": sampling_period,
            "cutoff": cutoff,
            "upper_area": upper_area,
            "lower_area": lower_area,
            "upper_outlet": upper_outlet,
            "lower_outlet": lower_outlet,
            "pump_gain": pump_gain,
            "height": height,
        },
        non_negative={"caught_share": caught_share, "noise": noise},
    )
    if caught_share > 1:
        raise ValueError(f"caught_share is {caught_share!r}, but must be at most 1.")
    levels = check_state(initial_state, ("upper level [cm]", "lower level [cm]"))
    if ((levels < 0) | (levels > height)).any():
        raise ValueError(
            f"initial_state is {levels.tolist()} cm, but levels must be from 0 to {height!r} cm."
        )
    rng = check_random_state(random_state)
    pump = check_input(u, n_samples)
    if pump is None:
        pump = 3.0 + 3.0 * filtered_noise(n_samples, cutoff, sampling_period, rng)[:, None]
    parameters = {
        "upper_area": upper_area,
        "lower_area": lower_area,
        "upper_outlet": upper_outlet,
        "lower_outlet": lower_outlet,
        "pump_gain": pump_gain,
        "height": height,
        "caught_share": caught_share,
    }
    p = np.array(list(parameters.values()), dtype=float)
    x0 = np.array([levels[0] * upper_area, levels[1] * lower_area, 0.0, 0.0, 0.0])
    upper, lower, lost, pumped, drained = _simulate_tanks(
        x0, pump, p, sampling_period / TANK_SUBSTEPS, TANK_SUBSTEPS
    ).T
    return make_plant(
        name="cascaded_tanks",
        X={"pump [V]": pump[:, 0]},
        y=lower / lower_area,
        output="lower level [cm]",
        states={
            "upper level [cm]": upper / upper_area,
            "lower level [cm]": lower / lower_area,
            "lost [cm^3]": lost,
            "pumped [cm^3]": pumped,
            "drained [cm^3]": drained,
        },
        sampling_period=sampling_period,
        equation=(
            "upper_area h1' = pump_gain u - upper_outlet sqrt(2 g h1); lower_area h2' = upper_outlet "
            "sqrt(2 g h1) - lower_outlet sqrt(2 g h2); h1, h2 <= height; caught_share of the upper overflow "
            "enters the lower tank; g = 981 cm/s^2"
        ),
        parameters=parameters,
        noise=noise,
        rng=rng,
        DESCR="Two tanks in cascade with root outflow and overflow; pump voltage in, lower level out.",
    )


@njit(cache=True, nogil=True)
def _ph_of(strong, weak, dissociation):
    """Return the pH at which the charges balance, by bisection.

    ``[H] + strong = Kw / [H] + weak dissociation / (dissociation + [H])``, where `strong` is the strong base
    minus the strong acid and `weak` the weak acid, in mol/L.
    """
    low, high = 0.0, 14.0
    for _ in range(50):  # 14 / 2^50: rounding
        middle = 0.5 * (low + high)
        hydrogen = 10.0**-middle
        charge = hydrogen + strong - WATER / hydrogen - weak * dissociation / (dissociation + hydrogen)
        if charge > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@njit(cache=True, nogil=True)
def _ph_rhs(x, u, rate, p, out):
    """States: strong charge and weak acid in mol/L, reading of the electrode."""
    volume, acid_flow, acid, weak_acid, pump_gain = p[0], p[1], p[2], p[3], p[4]
    base, dissociation, rise_time, fall_time = p[5], p[6], p[7], p[8]
    base_flow = pump_gain * max(u[0], 0.0)
    out_flow = acid_flow + base_flow
    out[0] = (base_flow * base - acid_flow * acid - out_flow * x[0]) / volume
    out[1] = (acid_flow * weak_acid - out_flow * x[1]) / volume
    gap = _ph_of(x[0], x[1], dissociation) - x[2]
    out[2] = gap / (rise_time if gap > 0.0 else fall_time)


@njit(cache=True, nogil=True)
def _simulate_ph(x0, u, p, h, n_substeps):
    return rk4_run(_ph_rhs, x0, u, True, p, h, n_substeps)


def make_ph_process(
    n_samples: int = 6000,
    *,
    u=None,
    hold: tuple[int, int] = (60, 300),
    sampling_period: float = 1.0,
    volume: float = 0.4,
    acid_flow: float = 4e-3,
    acid: float = 0.01,
    weak_acid: float = 0.005,
    pump_gain: float = 5e-4,
    base: float = 0.022,
    pka: float = 6.35,
    rise_time: float = 8.0,
    fall_time: float = 25.0,
    noise: float = 0.0,
    random_state=None,
) -> SyntheticPlant:
    """Make a neutralisation: base is pumped into a stirred tank with a constant flow of acid.

    The tank mixes linearly; the pH follows from the balance of charges of a strong acid, a weak acid and a
    strong base, and the electrode follows the pH faster upwards than downwards. So the static curve is a
    titration curve (steep, flat, steep), and the dynamics depend on the operating point and on the direction.

    Parameters
    ----------
    n_samples : int, default=6000
        Samples to make; ignored where `u` is given.
    u : array-like of shape (n_samples,) or None, default=None
        Pump voltage in V, held between samples; below 0 V the pump stands. The process starts in steady
        state for the first value. None makes steps to random levels from 0 to 6 V.
    hold : tuple of int, default=(60, 300)
        Shortest and longest number of samples that a random step is held.
    sampling_period : float, default=1.0
        In seconds.
    volume : float, default=0.4
        Of the tank, in L.
    acid_flow, acid, weak_acid : float, defaults 0.004, 0.01, 0.005
        Flow of the acid stream in L/s; its strong and weak acid in mol/L.
    pump_gain, base : float, defaults 0.0005, 0.022
        Flow of base per voltage in L/(s V); strong base in it in mol/L.
    pka : float, default=6.35
        Of the weak acid (6.35: carbonic acid).
    rise_time, fall_time : float, defaults 8.0, 25.0
        Time constants of the electrode for rising and falling pH, in s.
    noise : float, default=0.0
        Standard deviation of white measurement noise, relative to that of the noise-free output.
    random_state : int, RandomState or None, default=None
        Seeds input and noise.

    Returns
    -------
    plant : SyntheticPlant
        ``base pump [V]`` to ``pH [-]``; truth with ``strong charge [mol/L]``, ``weak acid [mol/L]`` and
        ``tank pH [-]``.

    Raises
    ------
    ValueError
        If an argument is out of range, or the simulation leaves the finite range.

    Notes
    -----
    The process is ours, made to show what the experiment of [1]_ shows; it imitates no particular plant.

    References
    ----------
    .. [1] P.E.O.G.B. Abreu, "Identification and compensator design using NARX models", thesis, UFMG, 2021,
       examples 2.3 B) and 2.4 (eq. (2.16), Table 2.1).
    .. [2] T.J. McAvoy, E. Hsu, S. Lowenthal, "Dynamics of pH in controlled stirred tank reactor", Ind. Eng.
       Chem. Process Des. Dev. 11(1), 1972: charge balance and mixing.

    Examples
    --------
    >>> from narx_sklearn.datasets import make_ph_process
    >>> plant = make_ph_process(2000, u=[4.0] * 2000)
    >>> round(float(plant.y.iloc[-1]), 2)
    5.75
    """
    check_numbers(
        positive={
            "sampling_period": sampling_period,
            "volume": volume,
            "acid_flow": acid_flow,
            "rise_time": rise_time,
            "fall_time": fall_time,
        },
        non_negative={
            "acid": acid,
            "weak_acid": weak_acid,
            "pump_gain": pump_gain,
            "base": base,
            "pka": pka,
            "noise": noise,
        },
    )
    if not 1 <= hold[0] <= hold[1]:
        raise ValueError(f"hold is {hold!r}, but must be (shortest, longest) with 1 <= shortest <= longest.")
    rng = check_random_state(random_state)
    pump = check_input(u, n_samples)
    if pump is None:
        pump = random_steps(n_samples, (0.0, 6.0), hold, rng)[:, None]
    parameters = {
        "volume": volume,
        "acid_flow": acid_flow,
        "acid": acid,
        "weak_acid": weak_acid,
        "pump_gain": pump_gain,
        "base": base,
        "dissociation": 10.0**-pka,
        "rise_time": rise_time,
        "fall_time": fall_time,
    }
    p = np.array(list(parameters.values()), dtype=float)
    base_flow = pump_gain * max(pump[0, 0], 0.0)
    strong0 = (base_flow * base - acid_flow * acid) / (acid_flow + base_flow)
    weak0 = acid_flow * weak_acid / (acid_flow + base_flow)
    x0 = np.array([strong0, weak0, _ph_of(strong0, weak0, 10.0**-pka)])
    strong, weak, reading = _simulate_ph(x0, pump, p, sampling_period / PH_SUBSTEPS, PH_SUBSTEPS).T
    tank = [_ph_of(s, w, 10.0**-pka) for s, w in zip(strong, weak, strict=True)]
    return make_plant(
        name="ph_process",
        X={"base pump [V]": pump[:, 0]},
        y=reading,
        output="pH [-]",
        states={"strong charge [mol/L]": strong, "weak acid [mol/L]": weak, "tank pH [-]": np.array(tank)},
        sampling_period=sampling_period,
        equation=(
            "volume s' = pump_gain u base - acid_flow acid - (acid_flow + pump_gain u) s; volume w' = "
            "acid_flow weak_acid - (acid_flow + pump_gain u) w; [H] + s = 1e-14 / [H] + w dissociation / "
            "(dissociation + [H]); tau y' = -log10 [H] - y, tau = rise_time upwards, fall_time downwards"
        ),
        parameters=parameters,
        noise=noise,
        rng=rng,
        DESCR="Neutralisation with a titration curve and an electrode slower downwards; pump in, pH out.",
    )

"""Simulations that have dry friction of their own, and steps in which a motion comes to rest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from numpy.testing import assert_allclose

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.physics.effects import CATALOGUE

DT = 0.01
VALUES = {"gain [m/s^2/V]": 1.0, "damping [1/s]": 0.9, "stiffness [1/s^2]": 36.0, "friction [m/s^2]": 0.2}
MASS = ["position [m]", "velocity [m/s]"]


def written_as_sign(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - p[3] * np.sign(x[1])


def written_as_branches(x, u, p):
    friction = p[3] if x[1] > 0 else (-p[3] if x[1] < 0 else 0.0)
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - friction


def written_steep(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - p[3] * np.tanh(x[1] / 1e-5)


def written_mild(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - p[3] * np.tanh(x[1] / 0.01)


def without(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def between_two(x, u, p):
    rub = p[3] * np.sign(x[1] - x[3])
    return x[1], u[0] - p[2] * x[0] - p[1] * x[1] - rub, x[3], rub - p[2] * x[2]


def draining(x, u, p):
    return (p[0] * u[0] - p[1] * np.sqrt(max(x[0], 0.0)),)


def that_raises(x, u, p):
    if x[0] > 100.0:
        raise IndexError("beyond the table")
    return written_as_sign(x, u, p)


def simulator(function=written_as_sign, states=MASS, dt=DT, **settings):
    return ODESimulator(function, dt=dt, parameters=VALUES, states=states, inputs=["drive [V]"], **settings)


def drive(n=3000, seed=0):
    """Return a multisine from 0.1 to 4 Hz, at most 3 V."""
    frequency = np.fft.rfftfreq(n, DT)
    angle = 2j * np.pi * np.random.default_rng(seed).random(frequency.size)
    u = np.fft.irfft(np.where((frequency > 0.1) & (frequency < 4), np.exp(angle), 0), n)
    return 3.0 * u / np.abs(u).max()


@njit
def event_driven(u, dt, fine, gain, damping, stiffness, friction, cubic=0.0):
    """Integrate the mass in tiny steps, in each of which it holds, slides, or comes to rest on the way."""
    x, v, h = 0.0, 0.0, dt / fine
    out = np.empty(u.size)
    for k in range(u.size):
        out[k] = x
        for _ in range(fine):
            load = gain * u[k] - damping * v - stiffness * x - cubic * x**3
            if v == 0.0 and abs(load) <= friction:
                continue
            way = np.sign(v) if v != 0.0 else np.sign(load)
            after = v + h * (load - friction * way)
            if v * after < 0.0:
                x, v = x + 0.5 * h * v, 0.0
            else:
                x, v = x + 0.5 * h * (v + after), after
    return out


def error_of(y, truth):
    return np.std(y - truth) / np.std(truth)


TRUTH = event_driven(drive(), DT, 4000, *VALUES.values())


# -- what is found -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("function", [written_as_sign, written_as_branches, written_steep, that_raises])
def test_friction_of_a_state_is_found(function):
    switches = simulator(function).switches
    assert switches.weights.tolist() == [[0.0, 1.0]]
    assert_allclose(switches.authority, 0.2, rtol=0.05)


@pytest.mark.parametrize("units", [" [m/s]", ""])
def test_friction_between_two_bodies_is_found_between_them_alone(units):
    names = ["x1 [m]", f"v1{units}", "x2 [m]", f"v2{units}"]
    switches = simulator(between_two, names).switches
    assert switches.weights.tolist() == [[0.0, 1.0, 0.0, -1.0]]
    assert_allclose(switches.authority, 0.4, rtol=0.05)  # the two accelerations part by twice the friction


@pytest.mark.parametrize(
    ("function", "states"), [(without, MASS), (written_mild, MASS), (draining, ["h [m]"])]
)
def test_what_steps_can_follow_is_no_switch(function, states):
    assert simulator(function, states).switches.authority.size == 0


def test_finer_steps_follow_a_steep_slope_themselves():
    assert simulator(written_steep).switches.authority.size == 1
    assert simulator(written_steep, dt=1e-5).switches.authority.size == 0


def test_a_friction_that_is_zero_as_yet_is_found():
    values = {**VALUES, "friction [m/s^2]": 0.0}
    sim = ODESimulator(written_as_sign, dt=DT, parameters=values, states=MASS, inputs=["drive [V]"])
    plain = ODESimulator(without, dt=DT, parameters=values, states=MASS, inputs=["drive [V]"])
    assert sim.switches.weights.tolist() == [[0.0, 1.0]]
    assert error_of(sim.simulate(drive()[:, None]), plain.simulate(drive()[:, None])) < 1e-5  # of the steps


# -- how it runs ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("function", [written_as_sign, written_as_branches, written_steep])
def test_runs_agree_with_an_event_driven_twin(function):
    error = error_of(simulator(function).simulate(drive()[:, None])[:, 0], TRUTH)
    assert error < 3e-4  # chatter of plain steps of the sampling period makes 3e-3


def test_friction_between_two_bodies_agrees_with_fine_steps():
    names = ["x1 [m]", "v1 [m/s]", "x2 [m]", "v2 [m/s]"]
    runs = [simulator(between_two, names, substeps=n).simulate(drive()[:, None])[:, 0] for n in (1, 200)]
    assert error_of(*runs) < 3e-4


@pytest.mark.parametrize(
    ("code", "theta"), [("coulomb_friction", (0.2,)), ("asymmetric_friction", (0.2, 0.0))]
)
def test_friction_of_the_catalogue_agrees_with_the_twin(code, theta):
    placed = PlacedEffect(CATALOGUE[code], Port("state", 1), (0.0, 1.0), theta=theta)
    sim = simulator(without).with_effects([placed])
    assert error_of(sim.simulate(drive()[:, None])[:, 0], TRUTH) < 3e-4


def test_own_friction_and_that_of_the_catalogue_add_up():
    placed = PlacedEffect(CATALOGUE["coulomb_friction"], Port("state", 1), (0.0, 1.0), theta=(0.12,))
    sim = simulator().with_parameters({"friction": 0.08}).with_effects([placed])
    assert error_of(sim.simulate(drive()[:, None])[:, 0], TRUTH) < 1e-3


def test_a_mass_that_sticks_does_not_creep():
    u = np.full((5000, 1), 0.15)  # below the friction of 0.2
    assert np.abs(simulator().simulate(u)).max() < 1e-7
    moving = simulator().simulate(np.where(np.arange(5000)[:, None] < 100, 3.0, 0.0))[:, 0]
    assert np.ptp(moving[1500:]) < 1e-7  # it rests where the spring holds less than the friction
    assert 1e-4 < abs(moving[-1]) < 0.2 / 36.0


def test_free_swings_fall_by_the_same_at_each_reversal():
    values = {**VALUES, "damping [1/s]": 0.0}
    sim = ODESimulator(written_as_sign, dt=DT, parameters=values, states=MASS, inputs=["drive [V]"])
    y = sim.simulate(np.zeros((600, 1)), x0=[0.1, 0.0])[:, 0]
    turns = np.abs(y[[round(k * np.pi / 6.0 / DT) for k in range(8)]])
    # 2 F / k from one to the next; the samples lie up to half a period of sampling beside the turns
    assert_allclose(turns, 0.1 - 2 * 0.2 / 36.0 * np.arange(8), atol=1e-4)


@settings(max_examples=20, deadline=None)
@given(st.sampled_from([1e-6, 1e-3, 1e3]), st.integers(0, 1000))
def test_units_do_not_change_a_run(scale, seed):
    u = drive(600, seed)[:, None]
    values = {**VALUES, "gain [m/s^2/V]": scale, "friction [m/s^2]": 0.2 * scale}
    small = ODESimulator(written_as_sign, dt=DT, parameters=values, states=MASS, inputs=["drive [V]"])
    # not to the last digit: what a width and a nudge are, is told from the scales that are looked at
    assert_allclose(small.simulate(u) / scale, simulator().simulate(u), atol=1e-6)


def test_a_run_changes_evenly_with_the_friction():
    u, windows = drive()[:, None], Windows.whole([slice(0, 3000)])
    sim, step = simulator(), 2e-5
    runs = [
        sim.run(u, windows, np.zeros((1, 2)), p=np.array([1.0, 0.9, 36.0, 0.2 + k * step])).y[:, 0]
        for k in range(50)
    ]
    slope = np.diff(runs, axis=0) / step
    # chatter changes at random: there a slope differs from the next by more than it is large
    assert np.sqrt(np.mean(np.diff(slope, axis=0) ** 2)) < 0.1 * np.sqrt(np.mean(slope**2))


def test_resting_is_no_stiffness(recwarn):
    simulator(written_steep).simulate(drive()[:, None])
    assert not recwarn.list


# -- what is said of it --------------------------------------------------------------------------------------


def diagnosed(cubic=0.0):
    y = event_driven(drive(), DT, 1000, 1.1, 0.8, 40.0, 0.25, cubic)
    y += 0.01 * y[2400:].std() * np.random.default_rng(4).standard_normal(y.size)  # of what is held out
    effects = ["stribeck_friction", "presliding_friction", "cogging", "cubic_stiffness", "backlash"]
    return DiscrepancyRegressor(simulator(), effects=effects, random_state=0).fit(drive()[:, None], y)


def test_a_simulation_with_friction_is_only_refitted():
    dx = diagnosed()
    assert dx.verdict_ == "refit"
    assert not dx.data_findings_
    assert_allclose(dx.parameters_["refitted"], [1.1, 0.8, 40.0, 0.25], rtol=0.02)


@pytest.mark.long
def test_what_is_missing_beside_its_own_friction_is_named_alone():
    dx = diagnosed(cubic=800.0)
    assert [finding.effect for finding in dx.findings_] == ["cubic_stiffness"]
    assert dx.scores_["nrmse"]["augmented"] < 0.011


def test_a_root_that_turns_over_far_outside_is_no_switch():
    """An orifice whose flow depends on the pressure left: at states of 1e9 Pa it looks like a steep tanh."""

    def hydraulic(x, u, p):
        speed, pressure, spool = x[0], x[1], x[2]
        flow = p[0] * spool * np.sqrt(np.abs(1.0 - np.tanh(spool / 0.002) * pressure / 1.6e7))
        return (
            (6.9e-6 * pressure - 0.11 * speed) / 0.105,
            (flow - 6.9e-6 * speed - 4e-12 * pressure) / 1.1e-13,
            (u[0] - spool) / 0.022,
        )

    def of(substeps):
        return ODESimulator(
            hydraulic,
            dt=0.004,
            parameters={"flow [m3/s]": 6.1e-4},
            states=["speed [rad/s]", "pressure [Pa]", "spool [-]"],
            inputs=["valve [-]"],
            output=[0, 1],
            substeps=substeps,
        )

    assert len(of(1).switches.weights) == 0
    u = np.repeat(np.random.default_rng(0).uniform(-0.2, 0.2, 20), 25)
    found, told = of(1).simulate(u), of(20).simulate(u)
    assert np.std(told[:, 1]) > 1e5  # Pa; it stood still where a switch was seen
    assert np.all(np.abs(found - told).max(axis=0) < 0.01 * np.std(told, axis=0))

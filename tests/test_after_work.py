"""Coefficients that depend on what went before: a paste that is stirred thin, a winding that warms up."""

import numpy as np
import pytest

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.unnamed.kinds import AFTER_SQUARE, AFTER_WORK, UNNAMED
from narx_sklearn.discrepancy.search.unnamed.memories import COEFFICIENTS
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.physics.effects import CATALOGUE

DT = 0.05
LAWS = {law.code: law for law in COEFFICIENTS}
THETA = (-0.3, 4.0, 0.1, 0.2, 0.15)  # a, T, r, i, k


def stirrer(x, u, p):
    return (p[0] * u[0] - p[1] * x[0],)


def make_stirrer(**parameters):
    nominal = {"gain [rad/s^2/V]": 2.0, "drag [1/s]": 1.0}
    return ODESimulator(
        stirrer, dt=DT, parameters=nominal, states=["speed [rad/s]"], inputs=["drive [V]"]
    ).with_parameters(parameters)


def steps(rng, n=3000, low=-1.0):
    return np.repeat(rng.uniform(low, 3.0, -(-n // 40)), 40)[:n]


def slowly(u, force, finer=20):
    """Return the speed at each sample, by small steps of Heun's kind: an independent twin."""
    x, memory, speeds, h = 0.0, None, [], DT / finer

    def rates(x, memory, command):
        pushed, change = force(x, memory)
        return 2.0 * command - 1.0 * x + pushed, change

    memory = force(0.0, None)[1]
    for command in u:
        speeds.append(x)
        for _ in range(finer):
            v, dm = rates(x, memory, command)
            v2, dm2 = rates(x + h * v, memory + h * dm, command)
            x, memory = x + h / 2 * (v + v2), memory + h / 2 * (dm + dm2)
    return np.array(speeds)


def test_laws_have_no_name():
    assert set(LAWS) == {AFTER_WORK, AFTER_SQUARE} <= set(UNNAMED)
    assert not set(LAWS) & set(CATALOGUE)
    assert {law.ports for law in COEFFICIENTS} == {("state",)}
    assert LAWS[AFTER_SQUARE].equation == "a M (x - r), T M' = |x - r|^2 (1 - k M) - M, at first M = i"


@pytest.mark.parametrize(("code", "power"), [(AFTER_WORK, 1), (AFTER_SQUARE, 2)])
def test_against_the_memory_as_a_state_of_its_own(code, power):
    a, T, r, i, k = THETA

    def force(x, memory):
        if memory is None:
            return 0.0, i
        return a * memory * (x - r), (abs(x - r) ** power * (1 - k * memory) - memory) / T

    u = steps(np.random.default_rng(0), 400)
    placed = PlacedEffect(LAWS[code], Port("state", 0), (1.0,), theta=THETA)
    found = make_stirrer().with_effects([placed]).simulate(u)[:, 0]
    np.testing.assert_allclose(found, slowly(u, force), atol=2e-5)


def test_it_is_remembered_from_one_window_to_the_next():
    """Windows of one session carry memory on, so that two give what one does."""
    u = steps(np.random.default_rng(1), 300)[:, None]
    placed = PlacedEffect(LAWS[AFTER_WORK], Port("state", 0), (1.0,), theta=THETA)
    simulator = make_stirrer().with_effects([placed])
    whole = simulator.run(u, Windows.whole([slice(0, 300)]), np.zeros((1, 1)))
    first = np.array([0, 120])
    parts = Windows(first, np.array([120, 300]), np.array([True, False]), np.zeros(2, dtype=np.int64))
    np.testing.assert_allclose(simulator.run(u, parts, whole.x[first]).y, whole.y, rtol=1e-12)


def diagnosed(force, seed, noise=0.01, low=-1.0):
    rng = np.random.default_rng(seed)
    u = steps(rng, low=low)
    y = slowly(u, force, finer=8)
    off = make_stirrer(gain=1.8, drag=1.1)
    return DiscrepancyRegressor(off, random_state=0).fit(u, y + noise * rng.standard_normal(u.size))


@pytest.mark.long
def test_a_paste_that_is_stirred_thin_is_a_law_without_a_name():
    """Thixotropy: a structure that shear breaks down and rest builds up (Moore 1959)."""
    c, recovery, broken = 0.8, 6.0, 0.1  # 1/s, s, 1/rad

    def force(x, structure):
        if structure is None:
            return 0.0, 1.0
        return -c * structure * x, (1.0 - structure) / recovery - broken * abs(x) * structure

    dx = diagnosed(force, 0)
    assert dx.verdict_ == "unknown"
    finding = dx.findings_[0]
    assert finding.port == "state:0"
    assert dx.conclusion_.diagnosis.best.effects[0].effect.code == AFTER_WORK
    assert finding.parameters["T"] == pytest.approx(recovery, rel=0.15)
    assert finding.parameters["k"] == pytest.approx(broken * recovery, rel=0.25)
    told = {p.name: p.value for p in dx.simulator_.parameters}
    assert told["drag"] == pytest.approx(1.0 + c, rel=0.03)  # of all the structure
    assert told["gain"] == pytest.approx(2.0, rel=0.01)


@pytest.mark.long
def test_a_resistance_that_warms_up_is_one_too():
    hotter, cools = 0.06, 8.0  # of the coefficient, s

    def force(x, warm):
        if warm is None:
            return 0.0, 0.0
        return -warm * x, hotter * x**2 * (1.0 + warm) / cools - warm / cools

    dx = diagnosed(force, 1)
    assert dx.verdict_ == "unknown"
    assert dx.conclusion_.diagnosis.best.effects[0].effect.code == AFTER_SQUARE
    finding = dx.findings_[0]
    assert "k" not in finding.parameters  # does not pay here, and in proportion it cools more slowly
    assert finding.parameters["T"] == pytest.approx(cools, rel=0.4)
    assert dx.scores_.loc["augmented", "nrmse"] < 0.2 * dx.scores_.loc["refitted", "nrmse"]


@pytest.mark.long
def test_what_does_not_remember_keeps_its_name():
    def force(x, memory):
        return -0.1 * x * abs(x), 0.0

    dx = diagnosed(force, 2)
    assert (dx.verdict_, dx.findings_[0].effect) == ("explained", "quadratic_drag")

"""From where an effect counts its arguments, and what is told only together."""

import numpy as np
import pytest

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.hypotheses import enumerate_hypotheses, reference_limits
from narx_sklearn.discrepancy.search.inference import intervals, lost_together
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.plain import counted_from_zero, with_positive_amplitudes
from narx_sklearn.physics.effects import CATALOGUE

N = 2000
ABOUT = {"dt": 0.1, "states": ["current [A]"], "inputs": ["duty [-]"]}
TRUE = {"supply [A/s]": 3.0, "decay [1/s]": 0.5}


def converter(x, u, p):
    return (p[0] * u[0] - p[1] * x[0],)


def converter_that_sags(x, u, p):
    return (p[0] * u[0] - p[1] * x[0] - 0.2 * u[0] * x[0],)


def duty(seed=0):
    return np.repeat(np.random.default_rng(seed).uniform(0.2, 0.8, N // 20), 20)[:, None]


def problem_of(y, u, sigma):
    simulator = ODESimulator(converter, parameters=TRUE, **ABOUT)
    windows = cut([(slice(0, N), 0)], N // 4, 8)
    return Problem(simulator, u, y, windows, Noise.white(np.array([sigma])))


def fitted(problem, *effects):
    model = Model(problem.simulator.nominal, effects, np.zeros((problem.windows.count, 1)))
    return Candidate(fit(problem, model, iterations=60), problem.n_seen)


def product(theta):
    return PlacedEffect(CATALOGUE["bilinear_input"], Port("state", 0), (1.0,), second=(1.0, 0.0), theta=theta)


@pytest.fixture(scope="module")
def sagging():
    u = duty()
    y = ODESimulator(converter_that_sags, parameters=TRUE, **ABOUT).simulate(u)
    sigma = 0.01 * y.std()
    return problem_of(y + sigma * np.random.default_rng(1).normal(size=y.shape), u, sigma)


def test_a_product_counted_from_elsewhere_is_counted_from_zero(sagging):
    """Of b (u - c) (x - r) the simulator's own gain and decay do what c and r do."""
    elsewhere = fitted(sagging, product((-0.2, 1.5, 0.01)))
    assert abs(elsewhere.fit.model.p[0] - 3.0) > 0.1
    found = counted_from_zero(sagging, elsewhere)
    assert found.fit.cost < elsewhere.fit.cost * (1 + 8 / N)
    assert found.effects[0].theta == pytest.approx([-0.2, 0.0, 0.0], rel=0.1)
    assert found.fit.model.p == pytest.approx(list(TRUE.values()), rel=0.03)
    rows = intervals(sagging, found.fit)
    assert np.all((rows[:2, 0] <= [3.0, 0.5]) & (rows[:2, 1] >= [3.0, 0.5]))
    assert rows[3:].tolist() == [[0.0, 0.0], [0.0, 0.0]]  # held there
    assert counted_from_zero(sagging, found) is found


def test_a_reference_that_nothing_else_does_stays(sagging):
    u = sagging.u
    drive = PlacedEffect(CATALOGUE["input_polynomial"], Port("input", 0), theta=(1.0, 0.0, 0.5))
    y = sagging.simulator.with_effects([drive]).simulate(u)
    sigma = 0.005 * y.std()
    problem = problem_of(y + sigma * np.random.default_rng(2).normal(size=y.shape), u, sigma)
    found = counted_from_zero(problem, fitted(problem, drive))
    assert found.effects[0].theta[2] == pytest.approx(0.5, abs=0.1)


def test_amplitudes_are_positive_and_phases_within_half_a_turn(sagging):
    placed = PlacedEffect(
        CATALOGUE["periodic_disturbance"], Port("state", 0), theta=(-0.5, 2.0, 2.0 + 2 * np.pi)
    )
    turned = placed.with_positive_amplitude()
    assert turned.theta == pytest.approx([0.5, 2.0, 2.0 - np.pi])
    assert turned.with_positive_amplitude() == turned
    waves = [sagging.simulator.with_effects([effect]).simulate(sagging.u) for effect in (placed, turned)]
    np.testing.assert_allclose(*waves, atol=1e-9)
    found = with_positive_amplitudes(sagging, fitted(sagging, placed))
    assert found.effects[0].theta[0] > 0
    law = product((-0.2, 0.0, 0.0))
    assert law.with_positive_amplitude() is law


def test_of_a_slow_drift_only_the_slope_is_told(sagging):
    u = sagging.u
    slow, soon = (
        PlacedEffect(CATALOGUE["gain_drift"], Port("input", 0), theta=(size, time, 0.0))
        for size, time in ((-0.5, 3000.0), (-0.2, 40.0))
    )
    told = {}
    for effect in (slow, soon):
        y = sagging.simulator.with_effects([effect]).simulate(u)
        sigma = 0.05 * y.std()
        problem = problem_of(y + sigma * np.random.default_rng(3).normal(size=y.shape), u, sigma)
        found = counted_from_zero(problem, fitted(problem, effect))
        told[effect] = lost_together(problem, found.fit, found.fit.model.theirs[0])
    assert told == {slow: [0, 1], soon: []}
    dx = DiscrepancyRegressor(sagging.simulator, effects=["gain_drift"])
    y = sagging.simulator.with_effects([slow]).simulate(u)
    dx.fit(u, y + 0.05 * y.std() * np.random.default_rng(3).normal(size=y.shape))
    assert dx.findings_[0].together == ("a", "T")
    assert "Of a and T only what they do together is told." in dx.report_


def warmed(x, u, p):
    return (p[0] * u[0] - p[1] * x[0],)


def heater(gain=1.0):
    return ODESimulator(
        warmed,
        dt=1.0,
        parameters={"gain [K/s/%]": 0.05 * gain, "loss [1/s]": 0.04},
        states=["temperature [K]"],
        inputs=["power [%]"],
    )


class TestCountedFromNearby:
    """A gain that drifts, counted from far beyond all inputs, would be a drift under another name."""

    def test_it_is_counted_from_zero_or_from_near_the_range_of_its_signal(self):
        rng = np.random.default_rng(0)
        u = np.repeat(rng.uniform(30.0, 55.0, 40), 25)[:, None]
        simulator = heater()
        run = simulator.run(u, Windows.whole([slice(0, 1000)]), np.array([[50.0]]))
        problem = Problem(simulator, u, run.y, Windows.whole([slice(0, 1000)]), Noise.white(np.array([0.1])))
        structure = find_structure(simulator, run.x, u)
        asked = [CATALOGUE["gain_drift"], CATALOGUE["bilinear_input"]]
        placed = [h.placed for h in enumerate_hypotheses(asked, problem, run, structure)]
        (at_input,) = [p for p in placed if p.effect.code == "gain_drift" and p.port.kind == "input"]
        np.testing.assert_allclose(at_input.bounds[2], reference_limits(u))
        (product,) = [p for p in placed if p.effect.code == "bilinear_input"]
        np.testing.assert_allclose(product.bounds[1:], [reference_limits(run.x), reference_limits(u)])

    @pytest.mark.parametrize("seed", [pytest.param(0, marks=pytest.mark.long), 1])
    def test_a_drift_of_the_sensor_is_told_as_one(self, seed):
        rng = np.random.default_rng(seed)
        u = np.repeat(rng.uniform(30.0, 55.0, 60), 25)[:, None]
        y = heater().simulate(u, [50.0]) + 2.0 * (1 - np.exp(-np.arange(1500) / 900.0))[:, None]
        y += 0.15 * rng.standard_normal(y.shape)
        found = DiscrepancyRegressor(
            heater(1.2), effects=["gain_drift", "additive_drift", "constant_load"], random_state=0
        ).fit(u, y)
        assert found.findings_[0].effect == "additive_drift"

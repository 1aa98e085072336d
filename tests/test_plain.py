"""Sets in plain numbers: a limit of a saturation that noise alone asked for goes."""

import numpy as np
import pytest

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.plain import with_limits_that_pay
from narx_sklearn.physics.effects import CATALOGUE

N, SIGMA, FAR = 2000, 0.02, 1e6
SATURATION = PlacedEffect(CATALOGUE["input_saturation"], Port("input", 0))
CLIP = PlacedEffect(CATALOGUE["sensor_clip"], Port("output", 0))


def pump(x, u, p):
    return (p[0] * (u[0] - x[0]),)


def recorded(truth, dip=0.0, seed=0):
    """Return the problem of a pump whose speed command steps, once below all others, by 0.1 of them."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0.0, 1.0, N // 40), 40)
    u[600:680] = -0.1
    simulator = ODESimulator(pump, dt=0.1, parameters={"pace": 0.5}, states=["speed"], inputs=["command"])
    y = simulator.with_effects([truth]).simulate(u[:, None]) + SIGMA * rng.standard_normal((N, 1))
    y[600:680] += dip
    windows = cut([(slice(0, N), 0)], N // 4, 8)
    return Problem(simulator, u[:, None], y, windows, Noise.white(np.array([SIGMA])))


def fitted(problem, effect):
    model = Model(problem.simulator.nominal, (effect,), np.zeros((problem.windows.count, 1)))
    return Candidate(fit(problem, model, iterations=60), problem.n_seen)


@pytest.mark.filterwarnings("ignore:.*compile")
class TestSecondLimit:
    def test_one_that_noise_asked_for_goes(self):
        problem = recorded(SATURATION.at((-FAR, 0.8, 0.0)), dip=0.008)
        both = fitted(problem, SATURATION.at((-0.08, 0.8, 0.0)))
        assert -0.1 < both.effects[0].theta[0] < 0.0
        found = with_limits_that_pay(problem, both)
        low, high, _ = found.effects[0].theta
        assert low < -0.1
        assert high == pytest.approx(0.8, abs=0.01)
        unit = both.fit.cost / both.n_samples
        assert 0 < found.fit.cost - both.fit.cost < 2 * np.log(problem.n_seen) * unit
        assert with_limits_that_pay(problem, found) is found

    @pytest.mark.parametrize(
        ("placed", "theta"), [(SATURATION, (0.2, 0.8, 0.0)), (CLIP, (0.2, 0.8))], ids=["saturation", "clip"]
    )
    def test_both_stay_where_both_are_met(self, placed, theta):
        problem = recorded(placed.at(theta))
        both = fitted(problem, placed.at(theta))
        assert with_limits_that_pay(problem, both) is both

    def test_what_has_no_limits_is_left_as_it_is(self):
        effect = PlacedEffect(CATALOGUE["constant_load"], Port("state", 0), theta=(0.1,))
        problem = recorded(effect)
        load = fitted(problem, effect)
        assert with_limits_that_pay(problem, load) is load

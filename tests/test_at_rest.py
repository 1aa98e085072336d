"""What a record at rest tells of parameters: nothing, whatever noise its initial states follow."""

import numpy as np
import pytest
from small_machines import levels, make_axis, make_oscillator

from narx_sklearn.discrepancy import DiscrepancyRegressor
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.search.inference import as_driven, intervals
from narx_sklearn.discrepancy.simulators.windows import cut

N = 1500
NOISE = 0.01


def fitted(simulator, u, y):
    windows = cut([(slice(0, N), 0)], 300, 20)
    problem = Problem(simulator, u, y, windows, Noise.white(np.array([NOISE])))
    return problem, fit(problem, Model(simulator.nominal, (), np.zeros((windows.count, 2))))


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_tells_no_parameter(seed):
    y = NOISE * np.random.default_rng(seed).normal(size=(N, 1))
    problem, found = fitted(make_oscillator(), np.zeros((N, 1)), y)
    nominal = problem.simulator.nominal
    low, high = intervals(problem, found).T
    assert (low <= nominal).all()
    assert (nominal <= high).all()
    assert (high > 10.0 * nominal).all()


def test_the_report_of_a_record_at_rest_gives_no_numbers():
    y = NOISE * np.random.default_rng(0).normal(size=(N, 1))
    dx = DiscrepancyRegressor(make_oscillator(), effects=["coulomb_friction"]).fit(np.zeros((N, 1)), y)
    assert dx.verdict_ == "consistent"
    assert "stiffness: these data do not tell it, nominal 20" in dx.report_
    assert "lies at" not in dx.report_


def test_a_decay_from_a_state_of_its_own_tells_parameters():
    u, x0 = np.zeros((N, 1)), np.array([0.5, 0.0])
    y = make_oscillator(damping=0.2).simulate(u, x0=x0)
    y += NOISE * np.random.default_rng(1).normal(size=y.shape)
    problem, found = fitted(make_oscillator(), u, y)
    assert as_driven(problem, found) is None
    low, high = intervals(problem, found)[2]
    assert high - low < 0.2
    assert low < 20.0 < high


@pytest.mark.parametrize("make", [make_oscillator, make_axis])
def test_where_inputs_move_it_the_intervals_stay_as_they_were(make):
    u = levels(np.random.default_rng(2), N)
    y = make().simulate(u)
    y += NOISE * np.random.default_rng(3).normal(size=y.shape)
    problem, found = fitted(make(), u, y)
    driven = as_driven(problem, found)
    truth = problem.simulator.nominal
    low, high = intervals(problem, found, 0.99).T
    assert ((low < truth) & (truth < high)).all()
    assert (high - low < 0.1 * truth).all()
    if driven is not None:
        np.testing.assert_allclose(driven.jacobian, found.jacobian, atol=0.02 * np.abs(found.jacobian).max())

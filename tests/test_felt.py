"""In which equation or output a parameter that depends on a signal is felt most."""

import numpy as np
import pytest

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.locate import felt_at
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.unnamed.varying import PARAMETER_THAT_VARIES
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.physics.effects import CATALOGUE


def battery(x, u, p):
    """Charge, and a voltage that lags; the second equation has the lag, the output the resistance."""
    return -p[0] * u[0], p[1] * (u[0] - x[1])


def terminal(x, u, p):
    return (x[0] - p[2] * u[0] - x[1],)


@pytest.fixture
def problem():
    simulator = ODESimulator(
        battery,
        output=terminal,
        outputs=["voltage [V]"],
        dt=0.1,
        parameters={"capacity": 0.01, "lag [1/s]": 2.0, "resistance": 0.5},
        states=["charge", "lagging"],
        inputs=["current", "temperature"],
    )
    u = np.random.default_rng(0).uniform(0.5, 2.0, size=(400, 2))
    windows = cut([(slice(0, 400), 0)], 100, 12)
    return Problem(simulator, u, simulator.simulate(u), windows, Noise.white(np.array([0.01])))


@pytest.mark.parametrize(
    ("parameter", "where"), [(0, Port("state", 0)), (1, Port("state", 1)), (2, Port("output", 0))]
)
def test_a_parameter_is_felt_where_it_stands(problem, parameter, where):
    placed = PlacedEffect(
        PARAMETER_THAT_VARIES, Port("parameter", parameter), second=(0.0, 1.0, 0.0, 0.0), theta=(0.1, 1.25)
    )
    model = Model(problem.simulator.nominal, (placed,), np.zeros((problem.windows.count, 2)))
    assert felt_at(placed, problem, model) == where


def test_what_is_at_no_parameter_is_felt_at_its_port(problem):
    damping = PlacedEffect(CATALOGUE["viscous_damping"], Port("state", 1), (0.0, 1.0), theta=(0.1,))
    model = Model(problem.simulator.nominal, (damping,), np.zeros((problem.windows.count, 2)))
    assert felt_at(damping, problem, model) == damping.port

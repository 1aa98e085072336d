"""Storages that change with a signal: tried in every equation, told where none of the names does it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from small_machines import vessel

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.search.unnamed.kinds import STORED, STORED_BY_SQUARE
from narx_sklearn.discrepancy.search.unnamed.storage import LEAST, storage_hypotheses
from narx_sklearn.discrepancy.simulators.structure import find_structure

DT = 2.0
SIZES = st.floats(-10.0, 10.0)
WIDER = 0.04  # of a tank's cross-section, a cm of level


def spring(x, u, p):
    """A body on a spring."""
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def tank(gain=1.0):
    return ODESimulator(
        vessel,
        dt=DT,
        parameters={"inflow [cm/s/V]": 0.1 * gain, "outlet [1/s]": 0.02 / gain},
        states=["level [cm]"],
        inputs=["pump [V]"],
        output=[0],
    )


def body():
    return ODESimulator(
        spring,
        dt=0.01,
        parameters={"drive": 10.0, "damping [1/s]": 1.0, "spring [1/s^2]": 30.0},
        states=["position [m]", "velocity [m/s]"],
        inputs=["force [N]"],
        output=[0, 1],
    )


def hypotheses(simulated, u):
    """Of a simulator whose outputs are its states."""
    run = simulated.simulate(u)
    return storage_hypotheses(simulated, find_structure(simulated, run, u), run)


def recorded(rng, wider, n=1500, finer=20):
    """Step a tank that is wider further up by Euler's method, far finer than it is measured."""
    u = np.repeat(rng.uniform(0.5, 4.0, n // 30), 30)
    y, level = np.empty(n), 8.0
    for k, pump in enumerate(u):
        y[k] = level
        for _ in range(finer):
            level += DT / finer * (0.1 * pump - 0.02 * level) / (1.0 + wider * (level - 8.0))
    return u[:, None], (y + 0.02 * rng.normal(size=n))[:, None]


def test_every_signal_is_tried_in_every_equation_that_is_no_definition():
    u = np.sin(np.arange(500.0)[:, None] / 20)
    x = body().simulate(u)
    found = hypotheses(body(), u)
    assert [(str(h.placed.port), h.placed.argument_name, h.placed.effect.code) for h in found] == [
        ("state:1", name, code) for name in ("velocity", "position") for code in (STORED, STORED_BY_SQUARE)
    ]
    np.testing.assert_allclose(found[2].starts[0], [1 / np.ptp(x[:, 0]), x[:, 0].mean()])


@given(x=SIZES, own=SIZES, a=st.floats(-0.02, 1.0), r=SIZES)
def test_the_whole_rate_is_divided(x, own, a, r):
    nothing = np.zeros(1)
    for h, taken_up in zip(
        hypotheses(tank(), np.linspace(1.0, 2.0, 50)[:, None]),
        (1 + a * (x - r), 1 + a * (x - r) ** 2),
        strict=True,
    ):
        added = h.placed.effect.force(x, own, own, np.nan, 0.0, DT, nothing, np.array([a, r]), nothing)
        assert own + added == pytest.approx(own / max(taken_up, LEAST), abs=1e-12)


def test_what_does_not_move_changes_nothing():
    assert hypotheses(tank(), np.zeros((50, 1))) == []


@pytest.fixture(scope="module")
def diagnosed():
    u, y = recorded(np.random.default_rng(0), WIDER)
    return DiscrepancyRegressor(tank(1.1), random_state=0).fit(u, y)


@pytest.mark.long
def test_a_tank_that_is_wider_further_up_is_told_as_a_storage(diagnosed):
    (finding,) = diagnosed.findings_
    assert (diagnosed.verdict_, finding.effect, finding.port) == ("unknown", "unknown", "state:0")
    assert "f / (1 + a (x - r)) in the place of f" in diagnosed.report_
    assert "x = level [cm]" in diagnosed.report_


@pytest.mark.long
def test_its_model_holds_on_what_was_held_out(diagnosed):
    left = diagnosed.scores_["nrmse"]
    assert left["augmented"] < 0.4 * left["refitted"]  # the noise is 1.2 %, of 4.1


@pytest.mark.long
def test_its_cross_section_is_found(diagnosed):
    """Of 1 + a (level - 8), as the parameters and the law have it between them."""
    (finding,) = diagnosed.findings_
    a, r = finding.parameters["a"], finding.parameters.get("r", 0.0)
    slope = a / (1.0 + a * (8.0 - r))  # over the cross-section at a level of 8 cm
    assert slope == pytest.approx(WIDER, rel=0.15)

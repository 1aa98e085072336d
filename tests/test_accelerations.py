"""Outputs that repeat the rate of a speed feel forces that are not simulated; flows and others do not."""

import pickle

import numpy as np
import pytest

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulators.accelerations import Acceleration
from narx_sklearn.physics.effects import CATALOGUE

DT, GRAVITY = 0.01, 9.81


def axis(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def copied(x, u, p):
    return x[0], (p[0] * u[0] - p[1] * x[1] - p[2] * x[0]) / GRAVITY


def read(x, u, p, rates):
    return x[0], rates[1] / GRAVITY


def make(output=copied, equations=axis, off=1.0, outputs=("position [m]", "acceleration [g]")):
    return ODESimulator(
        equations,
        dt=DT,
        parameters={"drive": 10.0 * off, "damping": 2.0 / off, "spring": 30.0 * off},
        states=["position [m]", "velocity [m/s]"],
        inputs=["force [N]"],
        outputs=list(outputs),
        output=output,
    )


def friction(size):
    return PlacedEffect(CATALOGUE["coulomb_friction"], Port("state", 1), (0.0, 1.0), theta=(size,))


def pushed(rng, n=600):
    return np.repeat(rng.uniform(-4.0, 4.0, n // 20), 20)[:, None]


def test_a_copied_rate_is_what_the_accelerometer_reads():
    (felt,) = make()._felt
    assert felt == Acceleration(1, 1, pytest.approx(1.0 / GRAVITY), 0.0, (0.0, 0.0, 0.0))
    u = pushed(np.random.default_rng(0))
    given = make(read)
    assert given._felt == ()
    for effects in ([], [friction(3.0)]):
        by_copy, by_rate = (s.with_effects(effects).simulate(u) for s in (make(), given))
        np.testing.assert_allclose(by_copy, by_rate, rtol=1e-12, atol=1e-12)


def test_what_rises_feels_its_weight_as_well():
    """What a scale in a lift reads: a constant more than the rate, or a parameter."""

    def lifted(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] - GRAVITY

    def specific(x, u, p):
        return x[0], p[0] * u[0] - p[1] * x[1]

    def of_rates(x, u, p, rates):
        return x[0], rates[1] + p[2] + GRAVITY

    by_copy, by_rate = (
        make(o, lifted, outputs=("position [m]", "felt [m/s^2]")) for o in (specific, of_rates)
    )
    (felt,) = by_copy._felt
    assert felt[:3] == (1, 1, pytest.approx(1.0))
    assert (felt.offset, *felt.weights) == (pytest.approx(GRAVITY), 0.0, 0.0, pytest.approx(1.0))
    u = pushed(np.random.default_rng(0))
    for effects in ([], [friction(3.0)]):
        copied, read = (s.with_effects(effects).simulate(u) for s in (by_copy, by_rate))
        np.testing.assert_allclose(copied, read, rtol=1e-11, atol=1e-9)


def test_it_goes_through_pickle():
    u = pushed(np.random.default_rng(0))
    simulator = make().with_effects([friction(3.0)])
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(simulator)).simulate(u), simulator.simulate(u))


@pytest.mark.parametrize(
    "output",
    [
        lambda x, u, p: (x[0], p[0] * u[0] - p[1] * x[1]),  # a part of it
        lambda x, u, p: (x[0], p[0] * (p[0] * u[0] - p[1] * x[1] - p[2] * x[0])),  # a force, by a parameter
        lambda x, u, p: (x[0], x[1]),
        lambda x, u, p: (x[0], np.sqrt(x[0] - 100.0)),
        lambda x, u, p: (x[0], 0.0),
    ],
)
def test_what_is_no_rate_times_a_constant_stays_as_it_is(output):
    assert make(output)._felt == ()
    assert not make(output).sees_rates


def test_a_flow_is_none():
    """It may be one of several into its store, and a leak is none of a meter's."""

    def stores(x, u, p):
        return p[0] * u[0] - p[1] * x[0], p[1] * x[0] - p[2] * x[1]

    flow = make(lambda x, u, p: (x[0], p[1] * x[0] - p[2] * x[1]), stores)
    assert flow._felt == ()


def test_what_looks_like_a_rate_by_chance_is_none():
    """How far the spring of a body of mass and stiffness one is drawn, and what pulls at it."""

    def drawn(x, u, p):
        return x[1], u[0] - x[0]

    def drawn_from(x, u, p):
        return x[1], u[0] - x[0] + p[1]

    for equations in (drawn, drawn_from):
        assert make(lambda x, u, p: (x[0], u[0] - x[0]), equations)._felt == ()
        assert make(lambda x, u, p: (x[0], u[0] - x[0] + p[0]), equations)._felt == ()
    as_force = make(outputs=("position [m]", "force [N]"))
    assert as_force._felt == ()
    assert make(outputs=("position", "felt"))._felt


@pytest.mark.long
def test_friction_is_named_by_an_accelerometer_whose_equation_was_copied():
    rng = np.random.default_rng(1)
    u = pushed(rng, 3000)
    y = make(read).with_effects([friction(3.0)]).simulate(u)
    y += [0.005, 0.02] * rng.normal(size=y.shape)
    effects = ["coulomb_friction", "quadratic_drag", "cubic_stiffness", "backlash"]
    dx = DiscrepancyRegressor(make(off=1.1), effects=effects, random_state=0).fit(u, y)
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.effect, finding.port) == ("explained", "coulomb_friction", "state:1")
    assert finding.parameters["Fc"] == pytest.approx(3.0, rel=0.05)

"""What a diagnosis carries into other records: laws, not what one record remembered or met with once."""

from dataclasses import replace

import numpy as np
import pytest

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.placed import PlacedEffect, Port, for_other_records
from narx_sklearn.physics.effects import CATALOGUE

ABOUT = {"dt": 0.1, "states": ["angle [rad]", "rate [rad/s]"], "inputs": ["rudder [rad]"]}
TRUE = {"gain [1/s^2]": 0.5, "damping [1/s]": 0.4}


def ship(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1]


def simulator(**parameters):
    return ODESimulator(ship, parameters=TRUE | parameters, **ABOUT)


def commands(n, seed):
    return np.repeat(np.random.default_rng(seed).normal(0, 0.3, n // 40), 40)


def test_memories_begin_in_the_middle_and_what_happened_once_is_over():
    limit = PlacedEffect(CATALOGUE["rate_limit"], Port("input", 0), theta=(0.2, 3.0, 0.0))
    play = PlacedEffect(CATALOGUE["backlash"], Port("state", 1), onward=0, theta=(1.0, 0.1, 0.0, -0.7, 0.5))
    held = PlacedEffect(CATALOGUE["stuck_sensor"], Port("output", 0), theta=(3.0, 1.0, 0.0))
    load = PlacedEffect(CATALOGUE["constant_load"], Port("state", 1), theta=(0.1,))
    others = for_other_records([limit, replace(play, begins=((100, 0.3),)), held, load])
    assert [e.theta for e in others] == [(0.2, 0.0, 0.0), (1.0, 0.1, 0.0, 0.0, 0.5), (0.1,)]
    assert not any(e.begins for e in others)


@pytest.mark.long
def test_a_drive_that_lagged_when_the_record_began_does_not_in_another():
    """It stood elsewhere before a first command next to zero, so a multiple of that was lacking."""
    u = commands(1600, 0)
    u[:40] = 0.05
    begun = PlacedEffect(CATALOGUE["rate_limit"], Port("input", 0), theta=(0.15, -6.0, 0.0))
    rng = np.random.default_rng(1)
    y = simulator().with_effects([begun]).simulate(u)[:, 0]
    y += 0.002 * y.std() * rng.normal(size=y.size)
    dx = DiscrepancyRegressor(simulator(), effects=["rate_limit", "lag", "input_saturation"]).fit(u, y)
    assert dx.findings_[0].effect == "rate_limit"
    assert dx.findings_[0].parameters["i"] == pytest.approx(-6.0, abs=2.0)
    other = commands(800, 2)
    truth = simulator().with_effects([begun.begun_anew()]).simulate(other)
    missed = [np.std(s.simulate(other) - truth) for s in (dx.simulator_, dx.refitted_simulator_)]
    assert missed[0] < 0.02 * np.std(truth)
    assert missed[0] < 0.1 * missed[1]


@pytest.mark.long
def test_a_drive_that_began_at_rest_in_several_sessions_does_so_in_another():
    u = np.concatenate([0.3 + commands(400, seed) for seed in range(4)])
    sessions = np.repeat(range(4), 400)
    begun = PlacedEffect(CATALOGUE["rate_limit"], Port("input", 0), theta=(0.15, 1.0, 0.0))
    y = simulator().with_effects([begun]).simulate(u, sessions=sessions)[:, 0]
    y += 0.005 * y.std() * np.random.default_rng(1).normal(size=y.size)
    dx = DiscrepancyRegressor(simulator(), effects=["rate_limit", "lag", "input_saturation"])
    dx.fit(u, y, sessions=sessions)
    (limit,) = dx.simulator_.effects
    assert limit.theta == pytest.approx((0.15, 1.0, 0.0), rel=0.1)
    other = 0.5 + commands(400, 7)
    truth = simulator().with_effects([begun]).simulate(other)
    assert np.std(dx.simulator_.simulate(other) - truth) < 0.02 * np.std(truth)


def test_a_sensor_that_was_stuck_is_told_to_the_sample_and_works_in_another_record():
    u = commands(1600, 0)
    rng = np.random.default_rng(1)
    y = simulator().simulate(u)[:, 0]
    y += 0.005 * y.std() * rng.normal(size=y.size)
    y[900:960] = y[900]  # in the second session, behind what is held out of the first
    effects = ["stuck_sensor", "sensor_clip", "sensor_bias"]
    dx = DiscrepancyRegressor(simulator(), effects=effects).fit(u, y, sessions=np.arange(1600) >= 600)
    (found,) = dx.findings_
    assert found.effect == "stuck_sensor"
    assert found.parameters["t0"] == pytest.approx(90.0)
    assert found.parameters["D"] == pytest.approx(6.0)
    assert [mistake.code for mistake in dx.data_findings_] == ["held_output"]
    assert dx.simulator_.effects == ()
    assert np.ptp(dx.predict(u)[900:960]) > 0
    assert "corrected simulation leaves it out" not in dx.report_

"""What an integrator adds up: small errors of a machine's motion are no drift of its sensor."""

import numpy as np
import pytest
from scipy.signal import lfilter

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator

DT, NOISE = 0.01, 0.002
GAIN, DAMPING = 1.2, 2.0
TIME = DT * np.arange(2000)


def cart(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1]


def recording(shaken=0.0, warmed=0.0, seed=0):
    """Return the drive and the position of a cart that is shaken, whose sensor warms up; sizes in metres."""
    rng = np.random.default_rng(seed)
    drive = sum(np.sin(2 * np.pi * f * TIME + rng.uniform(0, 6)) for f in (0.2, 0.5, 1.1, 1.9, 3.1))
    drive -= drive.mean()
    decay, settled = np.exp(-DAMPING * DT), GAIN / DAMPING * drive  # of the speed, and where to, in a sample
    speed = lfilter([0.0, 1.0 - decay], [1.0, -decay], settled)
    moved = settled * DT + (speed - settled) * (1.0 - decay) / DAMPING
    wandered = shaken * np.sqrt(DT) * np.cumsum(rng.standard_normal(TIME.size))
    off = warmed * (1.0 - np.exp(-TIME / 5.0))
    position = np.cumsum(moved) - moved + wandered + off + NOISE * rng.standard_normal(TIME.size)
    return drive[:, None], position[:, None]


def diagnosed(u, y):
    simulator = ODESimulator(
        cart,
        dt=DT,
        parameters={"gain [m/s^2/V]": 1.0, "damping [1/s]": 1.7},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
    )
    return DiscrepancyRegressor(simulator, random_state=0).fit(u, y)


@pytest.mark.parametrize("shaken", [0.0, 5e-4])
def test_a_cart_that_is_shaken_has_no_drifting_sensor(shaken):
    dx = diagnosed(*recording(shaken=shaken, seed=1))
    assert dx.verdict_ == "refit"
    noise = dx.conclusion_.diagnosis.noise
    assert noise.drifts(0) == (shaken > 0)
    assert ("drifting" in dx.report_) == (shaken > 0)


@pytest.mark.long
def test_a_sensor_that_warms_up_by_far_more_is_told():
    dx = diagnosed(*recording(warmed=0.05, seed=1))
    assert "drift on the output position" in dx.report_

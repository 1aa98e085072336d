"""Heat that is radiated: tried at every temperature, told with what it goes to, in kelvin or degrees."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.search.unnamed.kinds import RADIATED
from narx_sklearn.discrepancy.search.unnamed.radiation import ROOM, TYPICAL, radiation_hypotheses
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.model.units import ZEROS

DT, FINER = 10.0, 20
EMITS, SKY = 6e-4, 11.0  # 1/s, K below the air
CELSIUS = ZEROS["degC"]
FEW = ["root_outflow", "quadratic_stiffness", "cubic_stiffness", "temperature_gain", "constant_load"]
TRUE = {"absorbs": 2.0e-4, "loses": 6.0e-4}


def warmed(x, u, p):
    """A plate in the sun that loses heat to the air."""
    return (p[0] * u[0] - p[1] * (x[0] - u[1]),)


def plate(unit="K", off=1.0):
    return ODESimulator(
        warmed,
        dt=DT,
        parameters={"absorbs [K m^2/J]": TRUE["absorbs"] * off, "loses [1/s]": TRUE["loses"] / off},
        states=[f"plate [{unit}]"],
        inputs=["sun [W/m^2]", f"air [{unit}]"],
        x0=[300.0 if unit == "K" else 300.0 - CELSIUS],
    )


def recorded(rng, n=3000):
    """Step the plate by small steps under clouds that come and go, in kelvin."""
    sun = np.repeat(rng.uniform(0.0, 900.0, n // 60), 60)
    air = 295.0 + 6.0 * np.sin(np.arange(n) / 400.0)
    y, x = np.empty(n), 300.0
    for k in range(n):
        y[k] = x
        for _ in range(FINER):
            sky = air[k] - SKY
            radiated = EMITS * (x**4 - sky**4) / (4 * TYPICAL**3)
            x += DT / FINER * (TRUE["absorbs"] * sun[k] - TRUE["loses"] * (x - air[k]) - radiated)
    return np.column_stack([sun, air]), (y + 0.1 * rng.normal(size=n))[:, None]


def hypotheses(simulator, u, x):
    return radiation_hypotheses(simulator, find_structure(simulator, x, u), u, x)


def test_a_temperature_radiates_to_its_surroundings_and_to_what_was_measured():
    u, x = recorded(np.random.default_rng(0), 300)
    alone, to_air = (h.placed for h in hypotheses(plate(), u, x))
    assert (str(alone.port), alone.effect.code, alone.second) == ("state:0", RADIATED, ())
    assert (to_air.second_name, to_air.second_unit) == ("air", "K")
    np.testing.assert_array_equal(to_air.bounds[2:], np.zeros((2, 2)))  # both are absolute
    u[:, 1] -= CELSIUS
    in_degrees = hypotheses(plate("degC"), u, x - CELSIUS)[1].placed
    np.testing.assert_array_equal(in_degrees.bounds[2:], np.full((2, 2), CELSIUS))


def one_state(state, inputs):
    return ODESimulator(warmed, dt=DT, parameters={"a": 1.0, "b": 1.0}, states=[state], inputs=inputs)


def test_what_is_no_temperature_radiates_nothing():
    tank = one_state("level [m]", ["flow", "air [K]"])
    assert hypotheses(tank, np.full((9, 2), 300.0), np.full((9, 1), 300.0)) == []


@given(x=st.floats(0, 2000), s=st.floats(0, 2000), zero=st.sampled_from([0.0, CELSIUS]))
def test_it_goes_from_hot_to_cold_and_its_slope_at_300_kelvin_is_its_coefficient(x, s, zero):
    u, states = np.full((9, 2), 300.0), np.full((9, 1), 300.0)
    effect = hypotheses(plate(), u, states)[0].placed.effect

    def force(hot, cold):
        nothing = np.zeros(1)
        theta = np.array([EMITS, cold, zero])
        return effect.force(hot - zero, 0.0, 0.0, np.nan, 0.0, DT, nothing, theta, nothing)

    np.testing.assert_allclose(force(x, s), -force(s, x), atol=1e-9)
    assert force(x, s) * (x - s) <= 1e-9
    slope = (force(TYPICAL + 0.01, s) - force(TYPICAL - 0.01, s)) / 0.02
    assert slope == pytest.approx(-EMITS, rel=1e-4)


@pytest.mark.long
@pytest.mark.parametrize(("unit", "effects"), [("degC", FEW), ("K", None)])
def test_a_plate_that_radiates_to_the_sky_is_told_with_its_parameters(unit, effects):
    u, y = recorded(np.random.default_rng(1))
    if unit == "degC":
        u, y = u - (0.0, CELSIUS), y - CELSIUS
    dx = DiscrepancyRegressor(plate(unit, 1.15), effects=effects, random_state=0).fit(u, y)
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.effect, finding.port) == ("unknown", "unknown", "state:0")
    assert "Heat that is radiated in the equation of plate" in dx.report_
    assert finding.parameters["a"] == pytest.approx(EMITS, rel=0.2)
    table = dx.parameters_
    inside = (table["augmented_low"] < list(TRUE.values())) & (table["augmented_high"] > list(TRUE.values()))
    assert inside.all()
    assert dx.scores_["nrmse"]["augmented"] < dx.scores_["nrmse"]["refitted"]


def test_a_rise_is_counted_from_its_surroundings():
    simulator = one_state("rise [K]", ["heat [W]", "room [degC]"])
    u, x = np.full((9, 2), 20.0), np.linspace(0.0, 60.0, 9)[:, None]
    (alone, _) = (h.placed for h in hypotheses(simulator, u, x))
    np.testing.assert_array_equal(alone.bounds[1:], np.full((2, 2), ROOM))
    theta, nothing = np.array([1.0, ROOM, ROOM]), np.zeros(1)
    assert alone.effect.force(0.0, 0.0, 0.0, np.nan, 0.0, DT, nothing, theta, nothing) == 0.0

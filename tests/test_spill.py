"""An overflow that rises with the level is an overflow too, in another form."""

import math
from dataclasses import replace

import numpy as np
import pytest

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.settings import read_effects
from narx_sklearn.physics.effects import CATALOGUE, Setting, register_effect

RIM, OUTLET = 6.0, 0.06


def tank(gain, spilt=lambda head: 0.0, substeps=1):
    """A tank that drains through an opening, and above its rim as told."""

    def rhs(x, u, p):
        return (p[0] * u[0] - p[1] * math.sqrt(max(x[0], 0.0)) - spilt(max(x[0] - RIM, 0.0)),)

    return ODESimulator(
        rhs,
        dt=2.0,
        states=["level [cm]"],
        inputs=["pump [V]"],
        outputs=["level [cm]"],
        parameters={"gain [cm/s/V]": gain, "outlet [cm^0.5/s]": OUTLET},
        x0=[3.0],
        substeps=substeps,
    )


def seen(level):
    """What a record of a level shows of it."""
    time = np.arange(level.size) * 2.0
    return Setting(level, np.gradient(level, 2.0), level, None, time, 2.0, np.array([0]))


@pytest.mark.parametrize(
    ("c", "n", "within"), [(0.4, 1.5, 0.03), pytest.param(0.1, 2.5, 0.06, marks=pytest.mark.long, id="notch")]
)
def test_what_goes_over_an_edge_or_through_a_notch_is_an_overflow(c, n, within):
    rng = np.random.default_rng(3)
    u = np.repeat(rng.uniform(1.0, 6.0, 60), 30)[:, None]
    y = tank(0.05, lambda head: c * head**n, substeps=10).simulate(u)
    assert (y > RIM).mean() > 0.3
    noisy = y + 0.02 * rng.normal(size=y.shape)
    suspects = ["overflow", "root_outflow", "sensor_clip", "input_saturation"]
    dx = DiscrepancyRegressor(tank(0.045), effects=suspects).fit(u, noisy)
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.effect, finding.lookalikes) == ("explained", "overflow", ())
    assert finding.equation == CATALOGUE["spill"].equation
    assert finding.parameters["h"] == pytest.approx(RIM, abs=0.03)
    assert finding.parameters["n"] == pytest.approx(n, abs=0.1)
    head = np.quantile(y, 0.95) - RIM
    spilt = finding.parameters["c"] * head ** finding.parameters["n"]
    assert spilt == pytest.approx(c * head**n, rel=within)


def test_with_an_effect_go_its_other_forms():
    assert [effect.code for effect in read_effects(["overflow", "sensor_clip"])] == [
        "overflow",
        "sensor_clip",
        "spill",
    ]
    assert [effect.code for effect in read_effects(["spill"])] == ["spill"]
    assert not {"overflow", "spill"} & {e.code for e in read_effects("catalogue", exclude=["overflow"])}
    left = {effect.code for effect in read_effects("catalogue", exclude=["spill"])}
    assert "overflow" in left
    assert "spill" not in left


def test_an_outlet_lies_below_the_level_and_a_rim_within_its_way():
    level = 5.0 + np.sin(0.01 * np.arange(1200.0)) * np.sin(0.003 * np.arange(1200.0))
    lowest, highest = np.quantile(level, [0.1, 1.0])
    of_outlet = CATALOGUE["root_outflow"].limits(seen(level))
    assert of_outlet[2].tolist() == [-lowest, np.inf]
    assert CATALOGUE["spill"].limits(seen(level))[1].tolist() == [lowest, highest]
    rims = CATALOGUE["spill"].starts(seen(level))[:, 1]
    assert rims.size == 5
    assert ((lowest < rims) & (rims < highest)).all()
    assert CATALOGUE["spill"].starts(seen(np.full(50, 3.0))).size == 0


def test_a_form_of_nothing_known_is_refused():
    form = replace(CATALOGUE["spill"], code="spill_of_mine", form_of="no_such_effect", lookalikes=())
    with pytest.raises(ValueError, match="form_of must be the code of an effect of the catalogue"):
        register_effect(form)

"""Whether what was found where a simulation was fitted holds on the samples held out."""

import numpy as np
import pytest
from small_machines import make_axis

from narx_sklearn.discrepancy import DiscrepancyRegressor
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.report_text import what_is_left
from narx_sklearn.physics.effects import CATALOGUE

N, SPLIT = 2000, 1600


def diagnosed(before, after):
    """Return the diagnosis of an axis whose friction changes where the held-out samples begin."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.normal(0.0, 3.0, N // 15 + 1), 15)[:N, None]
    first, then = (
        make_axis(1.1, 0.4).with_effects(
            [PlacedEffect(CATALOGUE["coulomb_friction"], Port("state", 1), (0.0, 1.0), theta=(size,))]
        )
        for size in (before, after)
    )
    y, later = first.simulate(u), then.simulate(u)
    y[SPLIT:] = later[SPLIT:] + (y[SPLIT] - later[SPLIT])
    y += 0.002 * rng.normal(size=(N, 1))
    effects = ["coulomb_friction", "quadratic_drag", "cubic_stiffness"]
    return DiscrepancyRegressor(make_axis(), effects=effects, random_state=0).fit(u, y)


@pytest.mark.long
@pytest.mark.parametrize("after", [pytest.param(0.4, id="the same"), pytest.param(0.46, id="warmed up")])
def test_a_name_that_holds_stays_explained(after):
    found = diagnosed(0.4, after)
    assert found.verdict_ == "explained"
    assert found.findings_[0].effect == "coulomb_friction"
    assert found.findings_[0].stands
    assert what_is_left(found) == ""


@pytest.mark.long
def test_a_name_that_does_not_hold_on_other_samples_is_no_explanation():
    found = diagnosed(0.4, 0.7)
    assert found.verdict_ == "unknown"
    assert found.findings_[0].effect == "coulomb_friction"
    assert not found.findings_[0].stands
    assert "What comes nearest:" in found.report_
    assert found.scores_.loc["augmented", "nrmse"] < found.scores_.loc["refitted", "nrmse"]
    assert "they stand in for something else, or the machine has changed" in found.report_

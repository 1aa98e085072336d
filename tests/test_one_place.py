"""A force near one place of a signal, or from there on: tried in every equation, told by its place."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.search.unnamed.kinds import ONE_PLACE, STEP
from narx_sklearn.discrepancy.search.unnamed.one_place import (
    NARROW,
    PLACES,
    WIDE,
    WIDTHS,
    place_hypotheses,
    step_hypotheses,
)
from narx_sklearn.discrepancy.simulators.structure import find_structure

DT, FINER = 0.01, 20
CATCH, WHERE, REACH = 3.0, 0.25, 0.06  # N/kg, m, m


def spring(x, u, p):
    """A body on a spring."""
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def body(off=1.0):
    return ODESimulator(
        spring,
        dt=DT,
        parameters={"drive": 10.0 * off, "damping [1/s]": 2.0 / off, "spring [1/s^2]": 30.0 * off},
        states=["position [m]", "velocity [m/s]"],
        inputs=["force [N]"],
        output=[0],
    )


def groove(x):
    """Return the force of a ball that is pressed into a groove: a Gaussian's slope."""
    return CATCH * np.exp(-(((x - WHERE) / REACH) ** 2))


def recorded(rng, force_at=groove, n=4000):
    """Move the body by small steps through a force that depends on its position."""
    u = np.repeat(rng.uniform(-4.0, 4.0, n // 20), 20)
    y, x, v = np.empty(n), 0.0, 0.0
    for k, force in enumerate(u):
        y[k] = x
        for _ in range(FINER):
            v += DT / FINER * (10.0 * force - 2.0 * v - 30.0 * x + force_at(x))
            x += DT / FINER * v
    return u[:, None], (y + 0.002 * rng.normal(size=n))[:, None]


def hypotheses(u, of=place_hypotheses):
    run = body().simulate(u)
    x = np.column_stack([run[:, 0], np.gradient(run[:, 0], DT)])
    return of(body(), find_structure(body(), x, u), x), x


def test_places_are_tried_all_over_the_motion_and_not_beyond():
    found, x = hypotheses(np.sin(np.arange(800.0)[:, None] / 20))
    assert [(str(h.placed.port), h.placed.argument_name, h.placed.effect.code) for h in found] == [
        ("state:1", name, ONE_PLACE) for name in ("velocity", "position")
    ]
    (low, high), (narrow, wide) = found[1].placed.bounds[1:]
    assert x[:, 0].min() <= low < high <= x[:, 0].max()
    np.testing.assert_allclose((narrow, wide), (NARROW * (high - low), WIDE * (high - low)))
    assert found[1].starts.shape == (PLACES * len(WIDTHS), 3)
    places = np.unique(found[1].starts[:, 1])
    np.testing.assert_allclose(np.diff(places), (high - low) / PLACES)
    assert places[0] - low == pytest.approx(high - places[-1])


def test_what_stands_still_has_no_place():
    assert hypotheses(np.zeros((50, 1)))[0] == []


@given(a=st.floats(-5, 5), c=st.floats(-2, 2), w=st.floats(0.01, 3), off=st.floats(0, 10))
def test_it_is_half_as_strong_a_half_width_off_and_the_same_either_way(a, c, w, off):
    (_, law), _ = hypotheses(np.sin(np.arange(100.0)[:, None] / 20))
    nothing = np.zeros(1)

    def force(x):
        return law.placed.effect.force(x, 0.0, 0.0, np.nan, 0.0, DT, nothing, np.array([a, c, w]), nothing)

    assert force(c) == pytest.approx(a)
    assert force(c + w) == pytest.approx(a / 2, rel=1e-6, abs=1e-12)
    assert force(c + off) == pytest.approx(force(c - off), rel=1e-6, abs=1e-12)


def test_a_step_is_tried_at_each_place_of_a_position_and_of_no_speed():
    found, x = hypotheses(np.sin(np.arange(800.0)[:, None] / 20), step_hypotheses)
    assert {(h.placed.argument_name, h.placed.effect.code) for h in found} == {("position", STEP)}
    at = [set(h.starts[:, 1]) for h in found]
    assert len(set.union(*at)) == len(at) == PLACES
    assert x[:, 0].min() < min(map(min, at))
    assert max(map(max, at)) < x[:, 0].max()


@given(a=st.floats(-5, 5), c=st.floats(-2, 2), w=st.floats(0.01, 3), s=st.floats(-2, 2), off=st.floats(0, 10))
def test_a_step_is_halfway_at_its_place_and_goes_as_far_either_way(a, c, w, s, off):
    (law, *_), _ = hypotheses(np.sin(np.arange(100.0)[:, None] / 20), step_hypotheses)
    nothing = np.zeros(1)

    def force(x):
        return law.placed.effect.force(x, 0.0, 0.0, np.nan, 0.0, DT, nothing, np.array([a, c, w, s]), nothing)

    halfway = a * (s + 0.5)
    assert force(c) == pytest.approx(halfway)
    assert force(c - 50 * w) == pytest.approx(a * s)
    assert force(c + 50 * w) == pytest.approx(a * (s + 1))
    assert force(c + off) - halfway == pytest.approx(halfway - force(c - off), abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("before", [0.0, -0.5])
def test_a_spring_that_is_preloaded_either_way_is_told_by_where_it_turns(before):
    def preloaded(x):
        return -CATCH * (before + 0.5 * (1.0 + np.tanh((x - WHERE) / (0.2 * REACH))))

    u, y = recorded(np.random.default_rng(1), preloaded)
    dx = DiscrepancyRegressor(body(1.1), random_state=0).fit(u, y)
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.effect, finding.port) == ("unknown", "unknown", "state:1")
    assert dx.conclusion_.diagnosis.best.effects[0].effect.code == STEP
    assert finding.parameters["a"] == pytest.approx(-CATCH, rel=0.05)
    assert finding.parameters["c"] == pytest.approx(WHERE, abs=0.2 * REACH)
    assert finding.parameters["s"] == pytest.approx(before, abs=0.05)
    assert dx.scores_["nrmse"]["augmented"] < 0.5 * dx.scores_["nrmse"]["refitted"]


@pytest.mark.long
def test_a_detent_is_told_by_its_place_and_not_as_a_ripple():
    u, y = recorded(np.random.default_rng(0))
    dx = DiscrepancyRegressor(body(1.1), random_state=0).fit(u, y)
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.effect, finding.port) == ("unknown", "unknown", "state:1")
    assert dx.conclusion_.diagnosis.best.effects[0].effect.code == ONE_PLACE
    assert finding.parameters["c"] == pytest.approx(WHERE, abs=0.2 * REACH)
    assert dx.scores_["nrmse"]["augmented"] < 0.5 * dx.scores_["nrmse"]["refitted"]

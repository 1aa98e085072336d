"""Laws that switch with hysteresis: what they do to a signal and in an equation, and that they are told."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from small_machines import VESSEL_DT, make_vessel, recorded_vessel

from narx_sklearn.discrepancy import DiscrepancyRegressor
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.unnamed.kinds import SWITCHED, SWITCHED_GAIN, UNNAMED
from narx_sklearn.discrepancy.search.unnamed.switches import SWITCHES, sides
from narx_sklearn.discrepancy.search.valleys import may_lie_elsewhere, other_valleys, thresholds_moved
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.plain import without_spare
from narx_sklearn.physics.effects import CATALOGUE, Setting, register_effect

DT = VESSEL_DT
LAWS = {law.code: law for law in SWITCHES}


class Snapping:
    """A spring that snaps over and adds its force on the side to which it last went."""

    side = 0.0

    def __call__(self, u, level, step):
        self.side = 1.0 if u > 4.2 else (-1.0 if u < 2.6 else self.side)
        return 0.5 * (u + 0.4 * self.side)


def recorded(inflow, rng, n=1600):
    return recorded_vessel(inflow, rng, n, level=15.0)


def setting_of(signal):
    rate = np.gradient(signal, DT)
    time = DT * np.arange(signal.size)
    return Setting(signal, rate, signal, None, time, DT, np.array([0]))


def test_laws_have_no_name_and_are_carried_along():
    assert set(LAWS) == {SWITCHED, SWITCHED_GAIN} <= set(UNNAMED)
    assert not set(LAWS) & set(CATALOGUE)
    signal = np.sin(np.arange(50.0))
    for law in SWITCHES:
        assert law.ports == ("input", "state", "output")
        theta = [0.5, 0.3, -0.3, 1.0, 0.1, 0.2][: len(law.parameters)]
        again = pickle.loads(pickle.dumps(law))
        np.testing.assert_array_equal(
            again.transform(signal, None, DT, theta, [0]), law.transform(signal, None, DT, theta, [0])
        )


@pytest.mark.parametrize(
    ("change", "message"), [({"limits": None}, "between limits"), ({"spare": (9,)}, "spare")]
)
def test_what_is_chosen_has_limits_and_indices_are_of_parameters(change, message):
    with pytest.raises(ValueError, match=message):
        register_effect(replace(LAWS[SWITCHED], **change))


def test_switched_signals_by_hand():
    """It begins as it is told, goes over beyond a threshold, and begins again in another session."""
    signal = np.array([0.0, 2.0, 0.0, -2.0, 0.0, np.nan, 0.0, 1.0])
    jumps = LAWS[SWITCHED].transform(signal, None, DT, [3.0, 1.0, -1.0, 0.5, 0.2, 0.1], [0, 6])
    side = np.array([0.5, 1.0, 1.0, -1.0, -1.0, np.nan, 0.5, 0.5])
    np.testing.assert_allclose(jumps, 1.1 * signal + 3.0 * side + 0.2)
    gained = LAWS[SWITCHED_GAIN].transform(signal, None, DT, [0.3, 1.0, -1.0, 0.5, 0.2], [0, 6])
    np.testing.assert_allclose(gained, signal * (1.2 + 0.3 * side))


@pytest.mark.parametrize(
    ("code", "theta"),
    [
        (SWITCHED, (-0.2, 20.0, 15.0, -1.0, -0.2, 0.01)),
        (SWITCHED_GAIN, (-0.02, 20.0, 15.0, -1.0, -0.02)),
    ],
)
def test_a_force_that_switches_keeps_its_side_along_a_run(code, theta):
    """Against exact steps of the linear tank: what a sample crossed acts from the next on."""
    placed = PlacedEffect(LAWS[code], Port("state", 0), weights=(1.0,), theta=theta)
    u = np.repeat(np.random.default_rng(0).uniform(1.0, 6.0, 30), 16)[:, None]
    y = make_vessel().with_effects([placed]).simulate(u, [15.0])
    level, side, changes = 15.0, -1.0, 0
    for k, command in enumerate(u[:, 0]):
        assert y[k, 0] == pytest.approx(level, rel=1e-6)
        if code == SWITCHED:
            pole, push = -0.1 + theta[5], 0.5 * command + theta[0] * side + theta[4]
        else:
            pole, push = -0.1 + theta[0] * side + theta[4], 0.5 * command
        before, side = side, 1.0 if level > 20.0 else (-1.0 if level < 15.0 else side)
        changes += before != side
        level = -push / pole + (level + push / pole) * np.exp(pole * DT)
    assert changes > 2


def test_thresholds_are_tried_only_between_which_a_switch_is_on_either_side():
    """A signal of two levels passes both thresholds at once: that is a curve."""
    two = np.where(np.arange(200) % 20 < 10, 1.0, -1.0)
    ramps = np.abs(np.arange(200) % 40 - 20.0)
    for law in SWITCHES:
        assert not len(law.starts(setting_of(two)))
        starts = law.starts(setting_of(ramps))
        assert len(starts) == 21
        assert np.all(starts[:, 1] > starts[:, 2])


def switched_problem(theta):
    """Return the problem of a tank whose pump switches, and its model, with a switch begun at theta."""
    rng = np.random.default_rng(1)
    u = np.interp(np.arange(480), np.arange(0, 481, 12), rng.uniform(1.0, 6.0, 41))[:, None]
    law = PlacedEffect(LAWS[SWITCHED], Port("input", 0))
    law = replace(law, limits=tuple(map(tuple, law.effect.limits(setting_of(u[:, 0])).tolist())))
    true = law.at((0.4, 4.2, 2.6, 1.0, 0.0, 0.0))
    y = make_vessel().with_effects([true]).simulate(u, [15.0]) + 0.01 * rng.normal(size=(480, 1))
    windows = cut([(slice(0, 480), 0)], 480, 4)
    problem = Problem(make_vessel(), u, y, windows, Noise.white(np.array([0.01])))
    return problem, Model(make_vessel().nominal, (law.at(theta),), np.array([[15.0]]))


def test_a_fit_leaves_thresholds_and_other_valleys_find_them():
    problem, model = switched_problem((0.3, 4.5, 2.9, 0.0, 0.0, 0.0))
    u = problem.u[:, 0]
    begun = fit(problem, model._replace(effects=(model.effects[0].with_zeros((4, 5)),)))
    assert begun.model.effects[0].theta[1:3] == (4.5, 2.9)
    assert may_lie_elsewhere(begun.model.effects[0])
    a, high, low, *_ = other_valleys(problem, begun).model.effects[0].theta
    first = np.array([0])
    np.testing.assert_array_equal(sides(u, first, high, low, 1.0), sides(u, first, 4.2, 2.6, 1.0))
    assert a == pytest.approx(0.4, abs=0.01)


def test_thresholds_are_moved_within_what_the_signal_reaches():
    _, model = switched_problem((0.3, 5.9, 3.3, 0.0, 0.0, 0.0))
    placed = model.effects[0]
    tried = thresholds_moved(placed, 1.0)
    high, low = placed.limits[1]
    assert np.ptp(tried[:, [0, 3, 4, 5]], axis=0).max() == 0
    assert tried[:, 1:3].max() <= max(high, low)
    assert np.ptp(tried[:, 2]) == pytest.approx(0.2 * abs(high - low))


def test_thresholds_pay_and_what_is_spare_goes():
    problem, model = switched_problem((0.4, 4.2, 2.6, 0.0, 0.0, 0.0))
    found = Candidate(fit(problem, model), problem.n_seen)
    assert found.effects[0].n_values == 5  # a, two thresholds, b and c
    fewer = without_spare(problem, found)
    assert fewer.effects[0].theta[4:] == (0.0, 0.0)
    assert fewer.effects[0].n_values == 3
    n = problem.n_seen
    chosen = 2 * np.log(n)
    assert fewer.price == pytest.approx(2 * np.log(np.log(n)) * fewer.n_parameters + np.log(n) + chosen)


@pytest.mark.long
def test_a_spring_that_snaps_before_a_machine_is_told_at_its_input():
    u, y = recorded(Snapping(), np.random.default_rng(3))
    dx = DiscrepancyRegressor(make_vessel(1.1), random_state=0).fit(u, y)
    (finding,) = dx.findings_
    assert dx.verdict_ == "unknown"
    assert (str(finding.port), finding.title) == ("input:0", "a switch with hysteresis")
    found = finding.parameters["high"], finding.parameters["low"]
    np.testing.assert_allclose(found, (4.2, 2.6), atol=0.2)

"""What would change a fitted run as a member of its set does, tried in that member's place."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from small_machines import make_axis, make_oscillator

from narx_sklearn import DiscrepancyRegressor
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise, estimate_noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.bank import make_bank, moved_for
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.detect import NONE_SILENT
from narx_sklearn.discrepancy.search.explain import Step
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.members import reordered
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages import coloured_search
from narx_sklearn.discrepancy.stages.swaps import as_one_law, special_cases, swaps, untried
from narx_sklearn.physics.effects import CATALOGUE


def at_velocity(code, *theta, index=1, odd=False):
    return PlacedEffect(CATALOGUE[code], Port("state", index), (0.0, 1.0), theta=theta, odd=odd)


def hypothesis(placed, *, asked=True):
    return Hypothesis.untuned(placed, np.array([placed.theta]))._replace(asked=asked)


LOAD = PlacedEffect(CATALOGUE["constant_load"], Port("state", 1), theta=(0.05,))
COULOMB = at_velocity("coulomb_friction", 0.05)
RIVALS = [
    hypothesis(COULOMB),
    hypothesis(at_velocity("quadratic_drag", 0.1)),
    hypothesis(PlacedEffect(CATALOGUE["cubic_stiffness"], Port("state", 1), (1.0, 0.0), theta=(0.1,))),
    hypothesis(PlacedEffect(CATALOGUE["sensor_bias"], Port("output", 0), theta=(0.1,))),
]


@pytest.fixture(scope="module")
def problem():
    """Return the recording of an axis that rubs, and a first model of it."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.normal(0.0, 3.0, 101), 15)[:1500, None]
    rubs = [at_velocity("coulomb_friction", 0.3)]
    y = make_axis(1.1, 0.4).with_effects(rubs).simulate(u) + 0.002 * rng.normal(size=(1500, 1))
    windows = cut([(slice(0, 1500), 0)], 375, 12)
    return Problem(make_axis(), u, y, windows, Noise.white(np.array([0.002])))


def fitted(problem, *effects):
    n = problem.windows.count
    model = Model(problem.simulator.nominal, effects, np.zeros((n, 2)))
    return Candidate(fit(problem, model, iterations=30), problem.n_seen)


def codes(candidates):
    return [[effect.effect.code for effect in candidate.effects] for candidate in candidates]


def test_what_moves_the_run_as_the_member_does_is_fitted_in_its_place(problem):
    best = fitted(problem, at_velocity("asymmetric_friction", 0.1, 0.0))
    (found,) = swaps(problem, best, [best], RIVALS)
    assert codes([found]) == [["coulomb_friction"]]
    assert found.fit.cost == pytest.approx(best.fit.cost, rel=0.01)
    assert found.effects[0].theta[0] == pytest.approx(0.3, rel=0.03)


def test_what_acts_elsewhere_and_moves_the_run_alike_is_fitted_too():
    """To a linear machine a swing of the sensor may be one of the load, whose share its parameters took."""
    u = np.repeat(np.random.default_rng(0).normal(0.0, 3.0, 101), 15)[:1500, None]
    swings = PlacedEffect(
        CATALOGUE["periodic_disturbance"], Port("state", 1), (0.0, 1.0), theta=(0.5, 2.0, 0.3)
    )
    noise = 0.002 * np.random.default_rng(1).normal(size=(1500, 1))
    y = make_axis(1.1, 0.4).with_effects([swings]).simulate(u) + noise
    windows = cut([(slice(0, 1500), 0)], 375, 12)
    problem = Problem(make_axis(), u, y, windows, Noise.white(np.array([0.002])))
    sensor = PlacedEffect(CATALOGUE["periodic_disturbance"], Port("output", 0), theta=(0.12, 2.0, 3.2))
    best = fitted(problem, sensor)
    (found,) = swaps(problem, best, [best], [hypothesis(swings.at((0.1, 2.0, 0.0))), *RIVALS])
    assert [effect.place for effect in found.effects] == [swings.place]
    assert found.effects[0].theta == pytest.approx((0.5, 2.0, 0.3), rel=0.02)


def test_parameters_move_as_far_as_a_change_says_and_no_further_than_they_may(problem):
    best = fitted(problem, COULOMB)
    by = np.array([0.02, -0.01, 0.03])
    moved = moved_for(problem, best.fit, best.fit.jacobian @ by, np.arange(3))
    assert moved.q == pytest.approx(best.fit.model.q + by, abs=1e-6)
    only = moved_for(problem, best.fit, best.fit.jacobian @ (by * [1, 0, 0]), np.array([0]))
    assert only.q == pytest.approx(best.fit.model.q + by * [1, 0, 0], abs=1e-6)
    back = moved_for(problem, best.fit, best.fit.jacobian @ [0.0, 0.0, -5.0], np.array([2]))
    assert back.effects[0].theta == (0.0,)  # friction drives nothing


@pytest.mark.parametrize("settled", [True, False])
def test_a_rival_is_tried_again_only_where_it_was_caught_in_another_valley(problem, settled):
    best = fitted(problem, at_velocity("asymmetric_friction", 0.1, 0.0))
    rival = fitted(problem, COULOMB)
    if not settled:
        rival = Candidate(rival.fit._replace(cost=2 * rival.fit.cost), rival.n_samples)
    found = swaps(problem, best, [best, rival], RIVALS)
    assert codes(found) == [["coulomb_friction"]] * (not settled)


def test_the_others_of_a_set_stay(problem):
    best = fitted(problem, LOAD, at_velocity("asymmetric_friction", 0.1, 0.0))
    found = swaps(problem, best, [best], RIVALS)
    assert ["constant_load", "coulomb_friction"] in codes(found)
    assert all(len(candidate.effects) == 2 for candidate in found)


@pytest.mark.parametrize("change", ["unasked", "odd", "elsewhere", "member"])
def test_nothing_else_takes_a_place(problem, change):
    asymmetric = at_velocity("asymmetric_friction", 0.1, 0.0)
    best = fitted(problem, LOAD, asymmetric)
    rival = {
        "unasked": hypothesis(COULOMB, asked=False),
        "odd": hypothesis(at_velocity("coulomb_friction", 0.05, odd=True)),
        "elsewhere": hypothesis(
            at_velocity("coulomb_friction", 0.05, index=0)
        ),  # where it moves other things
        "member": hypothesis(asymmetric),
    }[change]
    assert swaps(problem, best, [best], [rival]) == []


def test_few_are_tried(problem, monkeypatch):
    best = fitted(problem, at_velocity("asymmetric_friction", 0.1, 0.0))
    alike = [
        hypothesis(at_velocity(code, *theta))
        for code, theta in {
            "coulomb_friction": (0.1,),
            "stribeck_friction": (0.1, 1.2, 0.1, 2.0),
            "presliding_friction": (0.1, 0.001, 1.0, 1.0, 0.0),
        }.items()
    ]
    everything = swaps(problem, best, [best], alike)
    monkeypatch.setattr("narx_sklearn.discrepancy.stages.swaps.SWAPS", 1)
    assert len(swaps(problem, best, [best], alike)) == 1 < len(everything)


def test_a_load_beside_what_is_the_same_both_ways_may_be_what_is_not(problem):
    """Friction and a load are as well a friction that is stronger one way."""
    best = fitted(problem, COULOMB, LOAD)
    uneven = Hypothesis.untuned(
        at_velocity("asymmetric_friction", 0.1, 0.3), np.array([[0.1, -0.3], [0.1, 0.3]])
    )
    (found,) = as_one_law(problem, best, [uneven, *RIVALS])
    (friction,) = found.effects
    assert friction.effect.code == "asymmetric_friction"
    alone = fitted(problem, COULOMB)
    assert found.fit.cost <= alone.fit.cost
    assert friction.theta[0] == pytest.approx(best.effects[0].theta[0], rel=0.2)
    assert as_one_law(problem, alone, [uneven]) == []


class TestWhatNobodyTriedYet:
    asymmetric = at_velocity("asymmetric_friction", 0.1, 0.0)

    def test_look_alikes_of_a_member_begin_from_the_parameters_beside_it(self, problem):
        best = fitted(problem, self.asymmetric)
        found = untried(problem, best, [best], RIVALS)
        assert CATALOGUE["coulomb_friction"].code in self.asymmetric.effect.lookalikes
        assert codes(found) == [["coulomb_friction"]]  # a drag is no look-alike
        assert found[0].fit.cost == pytest.approx(best.fit.cost, rel=0.01)

    def test_a_member_is_tried_elsewhere_too(self, problem):
        best = fitted(problem, COULOMB)
        there = hypothesis(at_velocity("coulomb_friction", 0.05, index=0))
        (found,) = untried(problem, best, [best], [there])
        assert [(str(e.port), e.effect.code) for e in found.effects] == [("state:0", "coulomb_friction")]

    def test_what_holds_one_that_comes_near_is_tried_after_it(self, problem):
        best = fitted(problem, self.asymmetric)
        stribeck = hypothesis(at_velocity("stribeck_friction", 0.1, 1.2, 0.1, 2.0))
        alone = {c.effects[0].effect.code for c in untried(problem, best, [best], [stribeck])}
        assert "coulomb_friction" in stribeck.placed.effect.holds
        both = {c.effects[0].effect.code for c in untried(problem, best, [best], [*RIVALS, stribeck])}
        assert both == {"coulomb_friction", "stribeck_friction"}
        assert alone <= {"stribeck_friction"}

    def test_what_was_fitted_before_is_not_fitted_again(self, problem):
        best, known = fitted(problem, self.asymmetric), fitted(problem, COULOMB)
        assert untried(problem, best, [best, known], RIVALS) == []

    def test_the_others_of_the_set_stay(self, problem):
        best = fitted(problem, LOAD, self.asymmetric)
        found = untried(problem, best, [best], RIVALS)
        assert ["constant_load", "coulomb_friction"] in codes(found)


def test_noise_is_estimated_beside_what_is_likeliest_under_noise_of_its_own(problem, monkeypatch):
    """Noise estimated beside one explanation favours it: whatever it leaves counts as noise."""
    drag, rubs = fitted(problem, RIVALS[1].placed), fitted(problem, COULOMB)
    working = problem.with_noise(estimate_noise(problem.left_over(drag.fit.model), problem.seen))
    pool = [Candidate(fit(working, c.fit.model), working.n_seen) for c in (drag, rubs)]
    favoured = pool[0].fit._replace(cost=0.9 * min(c.fit.cost for c in pool))
    pool[0] = Candidate(favoured, working.n_seen)
    refitted = fit(working, drag.fit.model._replace(effects=()))
    step = Step(NONE_SILENT, make_bank(working, refitted, []), pool)
    monkeypatch.setattr(coloured_search, "steps_beside", lambda *_: [step])
    settings = SimpleNamespace(alpha=0.01, n_jobs=None, tell=lambda stage: None)
    before = coloured_search.Searched(working, refitted, [step])
    again = coloured_search._under_clearer_noise(before, None, settings).problem
    assert working.noise.sigma[0] > 1.5 * 0.002
    assert again.noise.sigma[0] == pytest.approx(0.002, rel=0.1)


def test_what_a_law_becomes_at_an_edge_is_fitted_from_there(problem):
    stribeck = fitted(problem, at_velocity("stribeck_friction", 0.3, 1.0, 1e-9, 2.0))
    (simple,) = special_cases(problem, stribeck, RIVALS)
    assert simple.effects[0].place == COULOMB.place
    assert simple.effects[0].theta[0] == pytest.approx(0.3, abs=0.01)
    assert simple.fit.cost == pytest.approx(stribeck.fit.cost, rel=1e-3)
    # of a set the others stay, and what was not asked for is not tried
    (beside,) = special_cases(problem, fitted(problem, LOAD, *stribeck.effects), RIVALS)
    assert codes([beside]) == [["constant_load", "coulomb_friction"]]
    assert special_cases(problem, stribeck, [hypothesis(COULOMB, asked=False)]) == []
    assert special_cases(problem, fitted(problem, COULOMB), RIVALS) == []


def test_what_another_member_is_already_becomes_one_with_it(problem):
    """Half of a friction and half of it are no two findings."""
    half = at_velocity("stribeck_friction", 0.15, 1.0, 1e-9, 2.0)
    both = fitted(problem, half, at_velocity("coulomb_friction", 0.15))
    assert both.effects[0].theta[0] < 0.2
    (one,) = special_cases(problem, both, RIVALS)
    assert codes([one]) == [["coulomb_friction"]]
    assert one.effects[0].theta[0] == pytest.approx(0.3, abs=0.01)


def test_what_the_law_has_fixed_begins_as_ever(problem):
    """Sticking that gives way over next to nothing is Stribeck's friction, of which the exponent is free."""
    tall = [at_velocity("stribeck_friction", 0.3, 1.6, 0.2, 2.0)]
    y = make_axis(1.1, 0.4).with_effects(tall).simulate(problem.u)
    stepped = replace(problem, y=y + 0.002 * np.random.default_rng(1).normal(size=y.shape))
    presliding = at_velocity("presliding_friction", 0.3, 1e-6, 1.6, 0.2, 0.0)
    x0 = np.column_stack([y[:, 0], np.gradient(y[:, 0], problem.simulator.dt)])[problem.windows.first]
    near = Model(np.array([1.1, 0.4]), (presliding,), x0)
    general = Candidate(fit(stepped, near), problem.n_seen)
    stuck = hypothesis(at_velocity("stribeck_friction", 0.4, 1.0, 5.0, 2.0))
    found = special_cases(stepped, general, [*RIVALS, stuck])
    costs = {c.effects[0].effect.code: c.fit.cost for c in found}
    assert costs["stribeck_friction"] < 1.1 * problem.n_seen
    assert costs["coulomb_friction"] > 1.2 * problem.n_seen


def at_drive(code, *theta):
    return PlacedEffect(CATALOGUE[code], Port("input", 0), theta=theta)


LIMIT, SLOW = at_drive("input_saturation", -2.0, 1.6, 0.0), at_drive("lag", 0.1, 0.0, 0.0)


@pytest.fixture(scope="module", params=[(LIMIT, SLOW), (SLOW, LIMIT)], ids=["limit first", "lag first"])
def acting(request):
    """Return two effects on one input in the order in which they act, and a recording."""
    rng = np.random.default_rng(1)
    u = np.repeat(rng.normal(0.0, 3.0, 100), 15)[:, None]
    y = make_oscillator().with_effects(request.param).simulate(u)
    y += 0.01 * y.std() * rng.normal(size=y.shape)
    windows = cut([(slice(0, 1500), 0)], 500, 12)
    return request.param, Problem(
        make_oscillator(gain=3.6, damping=1.2), u, y, windows, Noise.white(0.01 * y.std(axis=0))
    )


class TestTheOtherOrder:
    def test_two_effects_on_one_input_get_the_order_in_which_they_act(self, acting):
        effects, problem = acting
        wrong, alone = fitted(problem, *effects[::-1]), fitted(problem, effects[0])
        (found,) = reordered(problem, [wrong, alone])
        assert codes([found]) == [[effect.effect.code for effect in effects]]
        assert found.fit.cost < 0.8 * wrong.fit.cost
        assert found.fit.cost == pytest.approx(problem.n_seen, rel=0.1)

    def test_what_adds_up_has_no_order(self, problem):
        assert not reordered(problem, [fitted(problem, LOAD, COULOMB)])

    @pytest.mark.long
    def test_a_diagnosis_tells_the_order(self, acting):
        effects, problem = acting
        some = ["input_saturation", "lag", "input_polynomial", "cubic_stiffness"]
        dx = DiscrepancyRegressor(problem.simulator, effects=some).fit(problem.u, problem.y)
        assert [e.effect.code for e in dx.simulator_.effects] == [e.effect.code for e in effects]
        assert dx.verdict_ in ("explained", "ambiguous")

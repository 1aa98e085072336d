"""Other valleys of the cost of effects that hold and jump."""

from dataclasses import replace

import numpy as np
import pytest

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.candidate import HARDLY, Candidate
from narx_sklearn.discrepancy.search.inference import intervals
from narx_sklearn.discrepancy.search.lookalikes import look_alikes
from narx_sklearn.discrepancy.search.valleys import (
    _moved_little,
    begins_in_sessions,
    begun_elsewhere,
    levels_in_sight,
    moved_in_time,
    other_valleys,
    spread_round,
)
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.physics.effects import CATALOGUE

TRUE = (0.3, 0.3, 1.0)


def stiction(*theta):
    return PlacedEffect(CATALOGUE["valve_stiction"], Port("input", 0), theta=(*theta, 0.0))


def tank(x, u, p):
    return (p[0] * u[0] - p[1] * x[0],)


def problem_of(effect, noise, *, held=0) -> tuple[Problem, Model]:
    """Return a tank with an effect at its valve, recorded with noise, and the model without the effect.

    The valve is told to stay next to zero for as many samples as it is ``held``.
    """
    rng = np.random.default_rng(0)
    simulator = ODESimulator(
        tank,
        dt=0.1,
        parameters={"gain": 1.0, "outflow": 0.3},
        states=["level [m]"],
        inputs=["valve [V]"],
        outputs=["level [m]"],
    )
    time = 0.1 * np.arange(2000)[:, None]
    u = sum(np.sin(w * time + rng.uniform(0, 6)) for w in (0.11, 0.23, 0.41, 0.67))
    u[:held] = 0.05
    y = simulator.with_effects([effect]).simulate(u) + noise * rng.normal(size=(2000, 1))
    windows = cut([(slice(0, 2000), 0)], 500, 8)
    problem = Problem(simulator, u, y, windows, Noise.white(np.array([noise])))
    return problem, Model(simulator.nominal, (), np.zeros((windows.count, 1)))


@pytest.fixture(scope="module")
def sticking() -> tuple[Problem, Model]:
    """A tank whose valve sticks, and the fitted model without that."""
    problem, model = problem_of(stiction(*TRUE), 0.02)
    return problem, fit(problem, model).model


class TestOtherValleys:
    def test_a_fit_that_stays_near_its_start_is_led_to_the_jumps_that_were_there(self, sticking):
        problem, model = sticking
        near = fit(problem, model._replace(effects=(stiction(0.22, 0.05, 1.0),)))
        there = fit(problem, model._replace(effects=(stiction(*TRUE),)))
        assert near.cost > 1.5 * there.cost
        found = other_valleys(problem, near)
        assert found.cost < 0.6 * near.cost
        np.testing.assert_allclose(found.model.effects[0].theta[:3], TRUE, rtol=0.05)

    def test_the_cost_never_rises(self, sticking):
        problem, model = sticking
        there = fit(problem, model._replace(effects=(stiction(*TRUE),)))
        assert other_valleys(problem, there).cost <= there.cost

    def test_every_value_that_was_tried_has_its_price(self, sticking):
        problem, model = sticking
        there = fit(problem, model._replace(effects=(stiction(0.3, 0.3, 0.9),)), iterations=0)
        assert not np.any(there.jacobian[:, :, -2])  # `again` changes nothing by a small step
        assert Candidate(there, problem.n_seen).n_parameters == 2 + 3
        at_an_end = fit(problem, model._replace(effects=(stiction(0.3, 0.3, 1.0),)), iterations=0)
        assert Candidate(at_an_end, problem.n_seen).n_parameters == 2 + 2


def test_a_command_that_comes_in_steps_just_reaches_a_threshold_or_not():
    """At a whole number of steps the valve goes, and the path from there on is another one."""
    rng = np.random.default_rng(0)
    simulator = ODESimulator(
        tank, dt=0.1, parameters={"gain": 1.0, "outflow": 0.3}, states=["level [m]"], inputs=["valve [V]"]
    )
    u = np.round(np.cumsum(rng.choice([-0.1, 0.0, 0.1], 3000)), 1)[:, None]
    y = simulator.with_effects([stiction(0.55, 1.0, 1.0)]).simulate(u) + 0.01 * rng.normal(size=(3000, 1))
    windows = cut([(slice(0, 3000), 0)], 1500, 8)
    problem = Problem(simulator, u, y, windows, Noise.white(np.array([0.01])))
    model = Model(simulator.nominal, (stiction(0.6, 1.0, 1.0),), np.zeros((windows.count, 1)))
    on_the_step = fit(problem, model)
    assert on_the_step.cost > 100 * problem.n_seen
    assert _moved_little(problem, on_the_step).cost < 1.1 * problem.n_seen


class TestBesideBacklash:
    """A sticking valve whose jump is small goes as backlash does."""

    @pytest.mark.parametrize(("noise", "stays"), [(0.2, True), (0.01, False)])
    def test_it_is_not_excluded_while_an_ordinary_jump_fits_as_well(self, noise, stays):
        lost = PlacedEffect(CATALOGUE["backlash"], Port("input", 0), theta=(1.0, 0.02, 0.0, 0.0))
        problem, model = problem_of(lost, noise)
        play, valve = (
            Candidate(fit(problem, model._replace(effects=(effect,))), problem.n_seen)
            for effect in (lost, stiction(0.04, 0.03, 1.0))
        )
        place = valve.effects[0].place
        starts = {place: np.array([[0.1, 0.3, 1.0, 0.0], [0.1, 0.7, 1.0, 0.0]])}
        assert look_alikes(problem, play, [valve], 0.0, starts) == [play, valve][: 1 + stays]

    def test_it_stays_where_it_is_likelier_with_a_jump_of_no_ordinary_size(self):
        problem, model = problem_of(stiction(0.15, 0.14, 0.0), 0.01)
        play, valve = (
            Candidate(fit(problem, model._replace(effects=(effect,))), problem.n_seen)
            for effect in (
                PlacedEffect(CATALOGUE["backlash"], Port("input", 0), theta=(1.0, 0.075, 0.0, 0.0)),
                stiction(0.15, 0.14, 0.0),
            )
        )
        assert 0 < play.criterion - valve.criterion < HARDLY
        assert look_alikes(problem, play, [valve], 0.0, {}) == [play, valve]


class TestSpreadRound:
    @pytest.mark.parametrize("octaves", [1.0, 0.25])
    def test_values_lie_round_what_was_found_and_at_the_ends_of_ranges(self, octaves):
        values = spread_round(stiction(0.3, 0.5, 0.9), octaves)
        assert values.shape == (CATALOGUE["valve_stiction"].valleys, 4)
        assert np.all(np.abs(np.log2(values[:, 0] / 0.3)) <= octaves)
        assert values[:, 1:3].min() >= 0.0
        assert values[:, 1:3].max() <= 1.0
        assert np.mean(values[:, 2] == 1.0) > 0.2
        assert np.all(np.abs(values[:, 1] - 0.5) <= octaves)
        assert not values[:, 3].any()


class TestWhatHappenedOnce:
    def test_its_ends_are_moved_to_the_sample_and_told_within_few(self):
        held = PlacedEffect(CATALOGUE["stuck_sensor"], Port("output", 0), theta=(80.0, 6.0, 0.0))
        held = replace(held, limits=((0.0, np.inf), (0.0, np.inf), (0.0, 0.0)))
        problem, model = problem_of(held, 0.02)
        near = fit(problem, model._replace(effects=(held.at([80.5, 5.1, 0.0]),)))
        found = other_valleys(problem, near)
        begin, duration, off = found.model.effects[0].theta
        assert (begin, duration, off) == (pytest.approx(80.0), pytest.approx(6.0), 0.0)
        rows = intervals(problem, found)[-3:]
        assert np.all(rows[:2, 0] <= [80.0, 6.0])
        assert np.all(rows[:2, 1] + 1e-9 >= [80.0, 6.0])
        assert np.all(np.ptp(rows[:2], axis=1) < 0.5)

    def test_ends_that_the_record_tells_stay(self):
        held = PlacedEffect(CATALOGUE["stuck_sensor"], Port("output", 0), theta=(80.0, 6.0, 0.0))
        told = replace(held, limits=((80.0, 80.0), (6.0, 6.0), (-0.1, 0.1)))
        assert len(moved_in_time(told, 0.1)) == 0
        assert len(moved_in_time(held, 0.1)) == 32


class TestBeginning:
    RESTING = PlacedEffect(CATALOGUE["rate_limit"], Port("input", 0), theta=(0.2, 0.01, 1.0))

    @pytest.mark.parametrize("share", [-7.0, 6.0])
    def test_a_drive_that_stood_far_from_a_first_command_is_found_where_that_is_not_felt(self, share):
        problem, model = problem_of(self.RESTING.at([0.2, share, 1.0]), 0.02, held=50)
        unfelt = fit(problem, model._replace(effects=(self.RESTING,)))
        assert abs(unfelt.model.effects[0].theta[1]) < 1.0
        found = other_valleys(problem, unfelt)
        assert found.cost < 0.9 * unfelt.cost
        assert found.model.effects[0].theta == pytest.approx((0.2, share, 1.0), rel=0.1)

    def test_what_has_a_slope_at_first_is_not_tried_elsewhere(self):
        lag = PlacedEffect(CATALOGUE["lag"], Port("input", 0), theta=(0.2, 0.01, 0.0))
        assert len(begun_elsewhere(lag)) == 0
        assert begun_elsewhere(self.RESTING)[:, 1].tolist() == [-9.0, -3.0, -1.0, 9.0, 3.0, 1.0]


class TestSessions:
    """A valve that stood elsewhere when each of three sessions began."""

    AT = (0.8, -0.6, 0.3)

    def problem(self, at=AT, n=600):
        rng = np.random.default_rng(4)
        simulator = ODESimulator(
            tank, dt=0.1, parameters={"gain": 1.0, "outflow": 0.3}, states=["level [m]"], inputs=["valve [V]"]
        )
        time = 0.1 * np.arange(n)[:, None]
        u = np.concatenate(
            [sum(np.sin(w * time + rng.uniform(0, 6)) for w in (0.23, 0.41, 0.67)) for _ in range(3)]
        )
        sessions = np.repeat(range(3), n)
        each = (
            simulator.with_effects([stiction(0.8, 0.8, 1.0).at([0.8, 0.8, 1.0, i])]).simulate(
                u[sessions == k]
            )
            for k, i in enumerate(at)
        )
        y = np.concatenate(list(each)) + 0.01 * rng.normal(size=(3 * n, 1))
        windows = cut([(slice(k * n, (k + 1) * n), k * n) for k in range(3)], n, 8)
        problem = Problem(simulator, u, y, windows, Noise.white(np.array([0.01])))
        return problem, Model(simulator.nominal, (), np.zeros((3, 1)))

    def test_each_begins_where_it_stood(self):
        problem, model = self.problem()
        alike = fit(problem, model._replace(effects=(stiction(0.8, 0.8, 1.0),)))
        found = other_valleys(problem, alike)
        assert found.cost < 0.5 * alike.cost
        assert found.cost < 1.2 * problem.n_seen
        (valve,) = found.model.effects
        assert [began for began, _ in valve.begins] == [600, 1200]
        assert (valve.theta[3], *(at for _, at in valve.begins)) == pytest.approx(self.AT, abs=0.15)

    def test_it_runs_in_each_session_as_one_that_begins_there_alone(self):
        problem, model = self.problem()
        valve = replace(stiction(0.8, 0.8, 1.0), begins=((600, -0.6), (1200, 0.3))).at([0.8, 0.8, 1.0, 0.8])
        y = problem.run(model._replace(effects=(valve,))).y
        for k, at in enumerate(self.AT):
            own = valve.begun_anew().at([0.8, 0.8, 1.0, at])
            assert own.begins == ()
            alone = problem.run(model._replace(effects=(own,))).y
            np.testing.assert_array_equal(y[600 * k : 600 * (k + 1)], alone[600 * k : 600 * (k + 1)])

    def test_where_all_begin_alike_no_session_has_its_own(self):
        problem, model = self.problem(at=(0.5, 0.5, 0.5))
        alike = fit(problem, model._replace(effects=(stiction(0.8, 0.8, 1.0).at([0.8, 0.8, 1.0, 0.5]),)))
        (valve,) = other_valleys(problem, alike).model.effects
        assert valve.begins == ()

    def test_one_session_has_none(self):
        problem, _ = problem_of(stiction(*TRUE), 0.02)
        assert not begins_in_sessions(problem, stiction(*TRUE))
        assert begins_in_sessions(self.problem()[0], stiction(*TRUE))
        lost = replace(stiction(*TRUE), port=Port("state", 0))
        assert not begins_in_sessions(self.problem()[0], lost)


class TestLevels:
    LIMIT = PlacedEffect(CATALOGUE["input_saturation"], Port("input", 0), theta=(-2.0, 2.5, 0.0))

    def test_a_level_out_of_sight_is_tried_within_the_signal(self):
        problem, model = problem_of(self.LIMIT, 0.02)
        astray = fit(problem, model._replace(effects=(self.LIMIT.at([-40.0, 2.3, 0.0]),)))
        assert astray.model.effects[0].theta[0] < problem.u.min()
        found = other_valleys(problem, astray)
        assert found.cost < 0.5 * astray.cost
        assert found.model.effects[0].theta == pytest.approx(self.LIMIT.theta, abs=0.05)

    def test_levels_in_sight_stay(self):
        signal = np.linspace(-3.0, 3.0, 101)
        assert len(levels_in_sight(self.LIMIT, signal)) == 0
        tried = levels_in_sight(self.LIMIT.at([-2.0, 9.0, 0.0]), signal)
        assert np.all(tried[:, 0] == -2.0)
        assert np.all((tried[:, 1] > 1.0) & (tried[:, 1] < 3.0))

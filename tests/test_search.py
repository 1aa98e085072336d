"""The search: what is asked for, added, exchanged and put in order."""

from types import SimpleNamespace

import numpy as np
import pytest
from small_machines import axis_problem, friction, levels, make_axis

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search import confirm, explain
from narx_sklearn.discrepancy.search.bank import flexible_residual, make_bank
from narx_sklearn.discrepancy.search.candidate import HARDLY, Candidate
from narx_sklearn.discrepancy.search.confirm import deviance
from narx_sklearn.discrepancy.search.detect import NONE_SILENT
from narx_sklearn.discrepancy.search.explain import probe, refit_leaders
from narx_sklearn.discrepancy.search.hypotheses import enumerate_hypotheses
from narx_sklearn.discrepancy.search.inference import intervals
from narx_sklearn.discrepancy.search.members import by_weight, that_run, without, without_each, without_idle
from narx_sklearn.discrepancy.search.ranking import leaders
from narx_sklearn.discrepancy.search.valleys import other_valleys
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages import unforeseen
from narx_sklearn.discrepancy.stages.unforeseen import Worth, that_pay
from narx_sklearn.physics.effects import CATALOGUE


def run_and_hypotheses(problem, found, asked, unasked=()):
    """Return the states of a fit's run inside the windows, and the hypotheses about it."""
    run = problem.run(found.model)
    inside = problem.rows[problem.inside]
    structure = find_structure(problem.simulator, run.x[inside], problem.u[inside])
    return run.x[inside], enumerate_hypotheses(asked, problem, run, structure, unasked)


class TestAsked:
    def bank(self, unasked):
        problem, start = axis_problem([friction(0.3)])
        found = fit(problem, start)
        _, hypotheses = run_and_hypotheses(problem, found, [CATALOGUE["gain_drift"]], unasked)
        return problem, found, make_bank(problem, found, hypotheses)

    def test_what_nobody_asks_for_takes_up_structure_but_is_not_named(self):
        problem, _, few = self.bank([])
        _, found, all_of_them = self.bank([CATALOGUE["coulomb_friction"]])
        noise = [np.var(flexible_residual(bank, problem.n_seen)[0]) for bank in (few, all_of_them)]
        assert noise[1] < 0.5 * noise[0]
        named = {placed.effect.code for placed in leaders(all_of_them, 10, NONE_SILENT, 1.0)}
        assert named == {"gain_drift"}
        assert probe(problem, found, all_of_them, 0).statistic[all_of_them.owner == 0].max() > 0
        assert not probe(problem, found, all_of_them, 0).statistic[-1]


class TestByWeight:
    def test_the_effect_that_explains_most_comes_first(self):
        small = PlacedEffect(
            CATALOGUE["constant_load"], Port("state", 1), (0.0, 1.0), theta=(0.02,), argument_name="velocity"
        )
        problem, start = axis_problem([friction(0.3), small])
        for effects in ((small, friction(0.3)), (friction(0.3), small)):
            found = Candidate(fit(problem, start._replace(effects=effects)), problem.n_seen)
            order = by_weight(problem, found)
            assert [effects[i].effect.code for i in order] == ["coulomb_friction", "constant_load"]

    def test_a_gain_before_a_limit_stays_before_it(self):
        """Told by weight, they still act in the order in which their values were fitted."""
        gain = PlacedEffect(
            CATALOGUE["gain_drift"], Port("input", 0), theta=(0.2, 0.5, 0.0), argument_name="force"
        )
        limit = PlacedEffect(
            CATALOGUE["rate_limit"], Port("input", 0), theta=(0.5, 0.0, 0.0), argument_name="force"
        )
        problem, start = axis_problem([gain, limit])
        runs = [problem.run(start._replace(effects=e)).y for e in ((gain, limit), (limit, gain))]
        assert np.nanmax(np.abs(runs[1] - runs[0])) > 0.01
        found = Candidate(fit(problem, start._replace(effects=(gain, limit))), problem.n_seen)
        assert [found.effects[i].effect.code for i in by_weight(problem, found)] == [
            "rate_limit",
            "gain_drift",
        ]
        assert [effect.effect.code for effect in found.effects] == ["gain_drift", "rate_limit"]


class TestIdle:
    def load(self, size):
        weights = (0.0, 1.0)
        return PlacedEffect(
            CATALOGUE["constant_load"], Port("state", 1), weights, theta=(size,), argument_name="velocity"
        )

    def test_what_does_nothing_in_a_set_leaves_it(self):
        problem, start = axis_problem([friction(0.3)])
        alone = fit(problem, start._replace(effects=(friction(0.3),)))
        both = alone.model._replace(effects=(self.load(0.0), *alone.model.effects))
        found = Candidate(fit(problem, both, iterations=0), problem.n_seen)
        (alone,) = without_idle(problem, found)
        assert [effect.effect.code for effect in alone.effects] == ["coulomb_friction"]
        assert alone.criterion < found.criterion
        assert alone.fit.cost == pytest.approx(found.fit.cost)

    def test_friction_of_no_size_that_helps_by_its_shorter_steps_does_nothing(self):
        """Where it turns about, a hysteresis beside it is followed in shorter steps too."""
        about = {"parameters": {"gain": 1.0, "damping": 0.5, "stiffness": 40.0}, "states": ["x", "v"]}

        def mass(substeps):
            def rates(x, u, p):
                return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]

            return ODESimulator(rates, dt=0.1, inputs=["u"], substeps=substeps, **about)

        loop = PlacedEffect(
            CATALOGUE["bouc_wen_hysteresis"], Port("state", 1), (1.0, 0.0), theta=(30.0, 0.1, -0.5, 1.0, 0.0)
        )
        rubs = PlacedEffect(CATALOGUE["coulomb_friction"], Port("state", 1), (0.0, 1.0), theta=(0.0,))
        rng = np.random.default_rng(0)
        u = 20 * levels(rng, 1500)
        y = mass(64).with_effects([loop]).simulate(u) + 1e-4 * rng.normal(size=(1500, 1))
        windows = cut([(slice(0, 1500), 0)], 500, 12)
        problem = Problem(mass(1), u, y, windows, Noise.white(np.array([1e-4])))
        start = Model(problem.simulator.nominal, (loop, rubs), np.zeros((3, 2)))
        both = Candidate(fit(problem, start, iterations=30), problem.n_seen)
        (alone,) = without_idle(problem, both)
        assert [effect.effect.code for effect in alone.effects] == ["bouc_wen_hysteresis"]
        assert alone.criterion > both.criterion + 10  # the steps were worth more than a name costs

    def test_what_moves_a_converters_steps_alone_leaves_it(self):
        """Of 81 loads that hardly add anything the best takes off sixty times the noise, by chance."""
        coarse, problem, found = self.converted()
        models = [
            found.model._replace(effects=(self.load(size), coarse)) for size in np.linspace(-1e-3, 1e-3, 81)
        ]
        lucky = min((fit(problem, model, iterations=0) for model in models), key=lambda f: f.cost)
        both = Candidate(lucky, problem.n_seen)
        assert both.criterion < Candidate(found, problem.n_seen).criterion - 10
        (alone,) = without_idle(problem, both)
        assert [effect.effect.code for effect in alone.effects] == ["quantisation"]

    def test_what_is_there_before_a_converter_stays(self):
        _, problem, found = self.converted(self.load(0.2))
        assert without_idle(problem, Candidate(found, problem.n_seen)) == []

    def converted(self, *effects):
        """Return a converter of five deviations of the noise, and the axis before it with all fitted."""
        coarse = PlacedEffect(CATALOGUE["quantisation"], Port("output", 0), theta=(0.01,))
        problem, start = axis_problem([*effects, coarse])
        smooth = fit(problem, start._replace(effects=effects)).model
        return coarse, problem, fit(problem, smooth._replace(effects=(*effects, coarse)))

    def test_what_does_something_stays(self):
        problem, start = axis_problem([friction(0.3), self.load(0.2)])
        both = (self.load(0.2), friction(0.3))
        found = Candidate(fit(problem, start._replace(effects=both)), problem.n_seen)
        assert without_idle(problem, found) == []


class TestUnseenPlace:
    """A speed does not tell where the motion is: what asks for its place lets each window choose its own."""

    def begun(self, effect, output=(1,)):
        simulator = make_axis(output=output)
        u = levels(np.random.default_rng(0), 600)
        windows = cut([(slice(0, 600), 0)], 150, 20)
        y = simulator.with_effects((effect,)).simulate(u)
        problem = Problem(simulator, u, y, windows, Noise.white(np.full(1, 0.01)))
        x0 = np.zeros((windows.count, 2))
        found = fit(problem, Model(simulator.nominal, (effect,), x0), iterations=0)
        candidate = Candidate(found, problem.n_seen)
        return candidate.n_parameters - candidate.felt.shape[1] - 2

    def at(self, code, theta):
        return PlacedEffect(
            CATALOGUE[code], Port("state", 1), (1.0, 0.0), theta=theta, argument_name="position"
        )

    def test_a_spring_costs_a_value_a_window(self):
        assert self.begun(self.at("cubic_stiffness", (2.0,))) == 4

    def test_what_does_not_ask_for_it_and_a_place_that_is_measured_cost_nothing(self):
        assert self.begun(friction(0.3)) == 0
        assert self.begun(self.at("cubic_stiffness", (2.0,)), output=(0,)) == 0

    def test_play_that_begins_anywhere_costs_nothing(self):
        assert self.begun(self.at("backlash", (5.0, 0.3, 0.1, 0.0))) == 0


class TestRateLimit:
    def test_a_drive_that_is_not_yet_where_it_is_told_to_be_is_fitted(self):
        resting = PlacedEffect(
            CATALOGUE["rate_limit"], Port("input", 0), theta=(0.5, 1.0, 0.0), argument_name="force"
        )
        problem, start = axis_problem([resting])
        found = fit(problem, start._replace(effects=(resting.at(np.array([0.4, 0.01, 0.0])),)))
        assert found.model.effects[0].theta == pytest.approx((0.5, 1.0, 0.0), rel=0.05)
        assert Candidate(found, problem.n_seen).n_values == 3  # where it began, and its form, have no price

    def test_a_limit_of_code_is_told_from_one_of_parts(self):
        """Half a step lies between their ramps; no fit goes there, but it is tried from the other one."""
        digital = PlacedEffect(
            CATALOGUE["rate_limit"], Port("input", 0), theta=(5.0, 0.0, 1.0), argument_name="force"
        )
        problem, start = axis_problem([digital])
        of_parts = fit(problem, start._replace(effects=(digital.at(np.array([4.0, 0.0, 0.0])),)))
        assert of_parts.model.effects[0].theta[2] == 0.0
        found = other_valleys(problem, of_parts)
        r, _, d = found.model.effects[0].theta
        assert (r, d) == pytest.approx((5.0, 1.0), rel=0.02)
        assert Candidate(found, problem.n_seen).n_values == 3  # how it is built is no further law


class TestLag:
    def test_a_lag_of_code_is_told_from_one_of_parts_and_is_no_less_simple(self):
        """Half a step lies between them: without it the time is off by a factor of nearly two."""
        digital, delay = (
            PlacedEffect(CATALOGUE[code], Port("output", 0), theta=theta, argument_name="position")
            for code, theta in (("lag", (0.07, 0.0, 1.0)), ("delay", (0.07, 0.0)))
        )
        problem, start = axis_problem([digital])
        found, late = (
            Candidate(fit(problem, start._replace(effects=(effect.at(theta),))), problem.n_seen)
            for effect, theta in ((digital, np.array([0.1, 0.0, 0.0])), (delay, np.array([0.05, 0.0])))
        )
        T, _, d = found.effects[0].theta
        assert (T, d) == pytest.approx((0.07, 1.0), rel=0.02)
        assert found.n_values == late.n_values


class TestBacklash:
    def test_of_a_command_all_motion_is_lost_and_of_a_force_a_part(self):
        at_input = PlacedEffect(CATALOGUE["backlash"], Port("input", 0), theta=(1.0, 0.1, 0.2, 0.0))
        at_state = PlacedEffect(CATALOGUE["backlash"], Port("state", 1), (1.0, 0.0), theta=at_input.theta)
        assert at_input.bounds[0].tolist() == [1.0, 1.0]
        assert at_state.bounds[0].tolist() == [0.0, np.inf]
        assert (at_input.amplitude, at_state.amplitude) == (None, 0)
        assert (at_input.n_values, at_state.n_values) == (2, 3)  # where it began is none

    def test_what_is_not_fitted_has_no_room_in_its_interval(self):
        play = PlacedEffect(
            CATALOGUE["backlash"], Port("input", 0), theta=(1.0, 0.15, 0.2, 0.0), argument_name="force"
        )
        problem, start = axis_problem([play])
        found = fit(problem, start._replace(effects=(play.at(np.array([0.4, 0.12, 0.1, 0.0])),)))
        k, b, *_ = found.model.effects[0].theta
        assert k == 1.0
        assert b == pytest.approx(0.15, rel=0.1)
        assert intervals(problem, found)[found.model.p.size] == pytest.approx([1.0, 1.0], abs=1e-12)


class TestLimits:
    def test_beyond_what_a_record_shows_parameters_have_no_meaning_and_still_their_price(self):
        """A ripple has two periods in the travel; a fit that would rather have a longer one stays there."""
        problem, start = axis_problem([friction(0.3)])
        found = fit(problem, start)
        asked = [CATALOGUE[code] for code in ("cogging", "creep", "periodic_disturbance")]
        x, hypotheses = run_and_hypotheses(problem, found, asked)
        placed = {h.placed.effect.code: h.placed for h in hypotheses if h.placed.port == Port("state", 1)}
        time = 1500 * problem.simulator.dt
        slowest = 2 * 2 * np.pi / np.ptp(x[:, 0])
        assert placed["cogging"].bounds[1] == pytest.approx([slowest, np.inf], rel=0.01)
        assert placed["creep"].bounds[1] == pytest.approx([problem.simulator.dt, time], rel=0.01)
        assert placed["periodic_disturbance"].bounds[1] == pytest.approx([6 * np.pi / time, np.inf], rel=0.01)
        ripple = placed["cogging"].at([0.5, 0.2 * slowest, 0.5, 0.0, 0.0])
        fitted = Candidate(fit(problem, start._replace(effects=(ripple,)), iterations=3), problem.n_seen)
        assert fitted.effects[0].theta[1] >= placed["cogging"].bounds[1, 0]
        assert ripple.domain[1].tolist() == [0.0, np.inf]


def settings_of(max_effects, n_leaders):
    """Return settings of a search that is told its hypotheses."""
    return Settings(
        effects=(),
        alpha=0.01,
        max_effects=max_effects,
        n_leaders=n_leaders,
        window=None,
        random_state=0,
        n_jobs=None,
        tell=lambda stage: None,
    )


class TestSearch:
    @pytest.fixture
    def found(self, monkeypatch):
        """Return a search of Coulomb friction and drag in which some sets find nothing beside them."""

        def search(is_barren, first=("coulomb_friction", "quadratic_drag", "stribeck_friction")):
            problem, start = axis_problem([friction(0.3), friction(0.05, "quadratic_drag")])
            base = fit(problem, start)
            structure = find_structure(problem.simulator, problem.run(base.model).x, problem.u)

            def hypotheses(found):
                codes = ("coulomb_friction", "quadratic_drag") if found.model.effects else first
                asked = [CATALOGUE[code] for code in codes]
                return enumerate_hypotheses(asked, problem, problem.run(found.model), structure)

            singles = []

            def sometimes_barren(problem, base, placed, n_jobs=None, **options):
                if singles and is_barren(base.model.effects, singles):
                    return []
                found = refit_leaders(problem, base, placed, n_jobs, **options)
                singles.extend(found)
                return found

            monkeypatch.setattr(explain, "refit_leaders", sometimes_barren)
            return explain.search(problem, base, hypotheses, settings_of(3, 8)), singles

        return search

    def test_where_nothing_added_to_the_best_takes_what_it_leaves_sets_are_built_on_the_next(self, found):
        steps, singles = found(lambda effects, singles: effects[0].place == singles[0].effects[0].place)
        best = min(steps[1].candidates, key=lambda c: c.criterion)
        assert best.effects[0].place == singles[1].effects[0].place != singles[0].effects[0].place
        assert best.criterion < singles[0].criterion - HARDLY

    def test_a_set_that_is_stuck_is_tried_without_its_older_members(self, found, monkeypatch):
        monkeypatch.setattr(explain, "BEAM", 1)

        def is_barren(effects, singles):
            return len(effects) > 1 and effects[0].effect.code == "cogging"

        steps, _ = found(is_barren, first=("cogging",))
        best = min((c for step in steps for c in step.candidates), key=lambda c: c.criterion)
        assert {effect.effect.code for effect in best.effects} == {"coulomb_friction", "quadratic_drag"}

    @pytest.mark.parametrize("is_noise", [True, False])
    def test_what_goes_with_a_drift_must_be_more_than_noise_wherever_the_drift_stood(
        self, is_noise, monkeypatch
    ):
        problem, start = axis_problem([friction(0.3)])
        ramp = np.linspace(0.0, 0.02, len(problem.y))[:, None]
        problem = Problem(problem.simulator, problem.u, problem.y + ramp, problem.windows, problem.noise)
        base = fit(problem, start)
        structure = find_structure(problem.simulator, problem.run(base.model).x, problem.u)
        asked = [CATALOGUE[code] for code in ("coulomb_friction", "additive_drift")]

        def hypotheses(found):
            return enumerate_hypotheses(asked, problem, problem.run(found.model), structure)

        def chances(trial, some, offsets):
            beside_drift = any(effect.effect.code == "additive_drift" for effect in trial.base.effects)
            return [float(beside_drift and is_noise)] * len(some)

        monkeypatch.setattr(confirm, "chances", chances)
        steps = explain.search(problem, base, hypotheses, settings_of(2, 4))
        built = [[effect.effect.code for effect in c.effects] for c in steps[1].candidates]
        assert ["coulomb_friction", "additive_drift"] in built
        assert (["additive_drift", "coulomb_friction"] in built) is not is_noise


def running_away(x, u, p):
    return (p[0] * u[0] - x[0] + p[1] * x[0] ** 3,)


@pytest.fixture(scope="module")
def held():
    """Return a problem whose machine runs away without a force that is in a set beside another one."""
    rng = np.random.default_rng(0)
    names = {"states": ["x"], "inputs": ["u"]}
    simulator = ODESimulator(running_away, dt=0.1, parameters={"gain": 3.0, "push": 1.0}, **names)
    u = np.repeat(rng.uniform(-1.0, 1.0, 60), 10)[:, None]
    holds = PlacedEffect(CATALOGUE["cubic_stiffness"], Port("state", 0), (1.0,), theta=(1.5,))
    load = PlacedEffect(CATALOGUE["constant_load"], Port("state", 0), theta=(0.3,))
    y = simulator.with_effects([holds, load]).simulate(u) + 0.01 * rng.normal(size=u.shape)
    windows = cut([(slice(0, len(u)), 0)], 300, 4)
    problem = Problem(simulator, u, y, windows, Noise.white(np.array([0.01])))
    found = fit(problem, Model(simulator.nominal, (holds, load), np.zeros((windows.count, 1))))
    return problem, Candidate(found, problem.n_seen)


def test_a_set_without_what_holds_the_machine_is_none(held):
    problem, both = held
    holds, load = both.effects
    assert not np.isfinite(without(problem, both, [holds]).fit.cost)
    assert without_each(problem, both) == []
    assert len(that_run([without(problem, both, [holds]), without(problem, both, [load])])) == 1


def test_what_runs_away_leaves_no_noise_of_any_likelihood(held):
    problem, both = held
    assert deviance(problem, both.fit.model._replace(effects=())) == np.inf
    assert np.isfinite(deviance(problem, both.fit.model))


def test_a_set_without_what_holds_the_machine_is_not_asked_what_acts_beside_it(held, monkeypatch):
    problem, both = held
    asked = []
    monkeypatch.setattr(unforeseen, "beside_laws", lambda problem, laws, *given: asked.append(laws) or worth)
    worth = Worth(both, SimpleNamespace(deviance=0.0))
    assert that_pay(problem, worth, None, 0.0025) is worth
    assert [laws.effects[0].effect.code for laws in asked] == ["cubic_stiffness"]

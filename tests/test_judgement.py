"""What is said of a search: named, or not by what it leaves, or by a curve that tells more."""

from dataclasses import replace

import numpy as np
import pytest
from small_machines import axis_problem, friction, levels, make_axis

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.findings import _range_of, argument_told
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.candidate import HARDLY, Candidate
from narx_sklearn.discrepancy.search.unnamed.curves import curve_hypotheses
from narx_sklearn.discrepancy.search.unnamed.kinds import DRIVEN, SURFACE
from narx_sklearn.discrepancy.search.unnamed.powers import with_free_power
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages import judgement
from narx_sklearn.discrepancy.stages.coloured_search import Searched
from narx_sklearn.discrepancy.stages.judgement import _without_its_power, at_home_instead, judged
from narx_sklearn.discrepancy.stages.naming import _without_refinement
from narx_sklearn.discrepancy.stages.refuted import (
    NOTHING_SEEN,
    LeftByForm,
    Leftover,
    is_refuted,
    left_by_form,
    may_be_drift,
    needs_wrong_parameters,
    only_stand_in,
    say_less_than_they_leave,
)
from narx_sklearn.physics.effects import CATALOGUE


def position_damping(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - 10.0 * x[0] - 3.0 * x[0] * x[0] * x[1]


def growing_inertia(x, u, p):
    return x[1], (p[0] * u[0] - p[1] * x[1] - 10.0 * x[0]) / (1.0 + 0.002 * x[0] * x[0])


class TestUnnamedForces:
    @pytest.mark.parametrize(
        ("law", "fitting"), [(position_damping, {SURFACE, DRIVEN}), (growing_inertia, {DRIVEN})]
    )
    def test_a_law_of_several_signals_fits_what_no_curve_can(self, law, fitting):
        def plain(x, u, p):
            return x[1], p[0] * u[0] - p[1] * x[1] - 10.0 * x[0]

        about = {"dt": 0.02, "states": ["position [m]", "velocity [m/s]"], "inputs": ["drive [V]"]}
        parameters = {"gain": 4.0, "damping": 0.5}
        rng = np.random.default_rng(0)
        u = levels(rng, 1200)
        y = ODESimulator(law, parameters=parameters, **about).simulate(u)
        y = y + 0.002 * rng.normal(size=y.shape)
        simulator = ODESimulator(plain, parameters=parameters, **about)
        windows = cut([(slice(0, 1200), 0)], 300, 12)
        problem = Problem(simulator, u, y, windows, Noise.white(np.array([0.002])))
        base = fit(problem, Model(simulator.nominal, (), np.zeros((4, 2))))
        run = problem.run(base.model)
        structure = find_structure(simulator, run.x, u)
        costs = {}
        for hypothesis in curve_hypotheses(simulator, structure, u, run.x, run.y):
            found = fit(problem, base.model._replace(effects=(hypothesis.placed,)))
            code = hypothesis.placed.effect.code
            costs[code] = min(found.cost, costs.get(code, np.inf))
        assert {code for code, cost in costs.items() if cost < 1.1 * problem.n_seen} == fitting
        assert min(cost for code, cost in costs.items() if code not in fitting) > 2.2 * problem.n_seen


NOTHING_LEFT = Leftover(1.0, 0.0)


class TestOddPlaces:
    def test_a_name_from_elsewhere_says_no_more_than_a_curve_that_fits_as_well(self):
        problem, start = axis_problem([friction(0.4)])
        base = fit(problem, start)
        best = Candidate(fit(problem, base.model._replace(effects=(friction(0.4),))), problem.n_seen)
        curve = Candidate(best.fit, problem.n_seen)
        elsewhere = Candidate(
            best.fit._replace(model=best.fit.model._replace(effects=(replace(best.effects[0], odd=True),))),
            problem.n_seen,
        )
        assert not is_refuted(base, best, curve, NOTHING_LEFT, 0.005)
        assert is_refuted(base, elsewhere, curve, NOTHING_LEFT, 0.005)
        assert not is_refuted(base, elsewhere, None, NOTHING_LEFT, 0.005)

    @pytest.mark.parametrize(("share", "refuted"), [(0.05, True), (0.2, False)])
    def test_it_stands_where_no_curve_comes_near_it(self, share, refuted):
        problem, start = axis_problem([friction(0.4)])
        base = fit(problem, start)
        there = replace(friction(0.4), odd=True)
        best = Candidate(fit(problem, base.model._replace(effects=(there,))), problem.n_seen)
        cost = best.fit.cost + share * (base.cost - best.fit.cost)
        curve = Candidate(best.fit._replace(cost=cost), problem.n_seen)
        assert is_refuted(base, best, curve, NOTHING_LEFT, 0.005) == refuted


class TestAtHomeInstead:
    """Friction at an odd place, and one with two sides at home, which fits as well."""

    @pytest.fixture
    def found(self):
        problem, start = axis_problem([friction(0.4)], n=600)
        base = fit(problem, start)
        placed = replace(friction(0.4), odd=True), friction(0.4, "asymmetric_friction", (0.4,))
        fits = [fit(problem, base.model._replace(effects=(effect,))) for effect in placed]
        return Searched(problem, base, []), *(Candidate(each, problem.n_seen) for each in fits)

    def likely(self, candidate, criterion):
        """Return a candidate of such a criterion."""
        cost = candidate.fit.cost * np.exp((criterion - candidate.criterion) / candidate.n_samples)
        return Candidate(candidate.fit._replace(cost=cost), candidate.n_samples)

    @pytest.mark.parametrize(("behind", "told"), [(HARDLY - 0.1, True), (HARDLY + 0.1, False)])
    def test_only_what_is_hardly_less_likely_may_be_told(self, found, behind, told):
        _, elsewhere, home = found
        home = self.likely(home, elsewhere.criterion + behind)
        assert at_home_instead(elsewhere, (), [elsewhere, home]) == [home] * told
        assert at_home_instead(elsewhere, ((home,),), [home]) == [home]  # a look-alike may be, once
        assert at_home_instead(home, (), [elsewhere, home]) == []  # it is at home itself

    def test_neither_another_odd_place_nor_a_sensor_that_is_off_is_at_home(self, found):
        _, elsewhere, home = found
        offset = PlacedEffect(CATALOGUE["sensor_bias"], Port("output", 0), theta=(0.1,))
        strangers = [
            Candidate(home.fit._replace(model=home.fit.model._replace(effects=effects)), home.n_samples)
            for effects in ((replace(home.effects[0], odd=True),), (offset,), (*home.effects, offset))
        ]
        assert at_home_instead(elsewhere, ((strangers[0], strangers[1]),), strangers) == []

    @pytest.mark.parametrize("stands", [True, False])
    def test_it_is_told_if_it_stands_where_one_from_elsewhere_is_refuted(self, found, monkeypatch, stands):
        searched, elsewhere, home = found
        left = 0.0 if stands else searched.refitted.cost
        monkeypatch.setattr(
            judgement,
            "leftover_of",
            lambda _, best, *rest: Leftover(1e-4, left * (best.places == home.places), of_form=True),
        )
        monkeypatch.setattr(judgement, "left_that_is_no_noise", lambda *given: ())
        monkeypatch.setattr(
            judgement, "best_unnamed", lambda *given: Candidate(elsewhere.fit, home.n_samples)
        )
        settings = Settings((), 0.005, 2, 4, None, 0, 1, lambda stage: None)
        run = searched.problem.run(searched.refitted.model)
        structure = find_structure(searched.problem.simulator, run.x, searched.problem.u)
        said = judged(searched, elsewhere, [elsewhere, home], structure, settings)
        assert said.verdict == ("explained" if stands else "unknown")
        assert said.best.places == (home if stands else elsewhere).places
        alone = judged(searched, elsewhere, [elsewhere], structure, settings)
        assert (alone.verdict, alone.best) == ("unknown", elsewhere)
        assert not alone.left.share  # it is where it acts that speaks against it
        for doubt in (0.99, 1.0):  # as much as would refute it, or less
            left_by_it = LeftByForm(share=0.5, deviations=0.7, doubt=doubt)
            monkeypatch.setattr(judgement, "left_by_form", lambda *given, said=left_by_it: said)
            refuted = judged(searched, elsewhere, [elsewhere], structure, settings)
            assert refuted.left == (left_by_it if doubt == 1.0 else NOTHING_SEEN)


class TestExactSimulations:
    @pytest.mark.parametrize(("damping", "verdict"), [(0.5, "consistent"), (0.7, "refit")])
    def test_a_residual_of_rounding_is_nothing_missing(self, damping, verdict):
        u = levels(np.random.default_rng(0), 800)
        y = make_axis(damping=damping).simulate(u)
        found = DiscrepancyRegressor(make_axis()).fit(u, y)
        assert found.verdict_ == verdict
        assert not found.findings_
        assert found.p_value_ == 1.0


@pytest.mark.parametrize(
    ("p_value", "share", "of_form", "refuted"),
    [
        (1e-4, 0.07, True, True),  # its form is wrong
        (1e-4, 0.07, False, False),  # something small is missing elsewhere
        (1e-4, 0.2, False, True),  # something large is
        (1e-4, 0.03, True, False),  # no form is exact
        (0.3, 0.07, True, False),  # it may be noise
    ],
)
def test_a_name_is_refuted_by_what_it_leaves_where_it_acts(p_value, share, of_form, refuted):
    problem, start = axis_problem([friction(0.4)])
    base = fit(problem, start)
    best = Candidate(fit(problem, base.model._replace(effects=(friction(0.4),))), problem.n_seen)
    left = Leftover(p_value, share / (1 - share) * (base.cost - best.fit.cost), of_form)
    assert is_refuted(base, best, None, left, 0.005) == refuted


@pytest.mark.parametrize(
    ("named", "law", "refuted"),
    [
        (490.0, 440.0, True),  # 10 beyond the constant, and 50 left to the law
        (450.0, 430.0, False),  # 50 beyond it, and 20 left: a matter of form
        (500.0, 440.0, True),  # the constant itself: it has no form
        (500.0, 495.0, False),  # what noise gives a law of more parameters
    ],
)
def test_what_a_constant_does_too_tells_for_no_name(named, law, refuted):
    """All take off 400 of 900 with their constant."""
    problem, start = axis_problem([friction(0.4)])
    base = fit(problem, start)

    def costing(cost, *effects):
        fitted = fit(problem, base.model._replace(effects=effects))
        return Candidate(fitted._replace(cost=cost), 500)

    load = PlacedEffect(CATALOGUE["constant_load"], Port("state", 1), theta=(0.3,))
    pool = [costing(500.0, load), costing(300.0, load, friction(0.4))]  # two of them are no constant
    best, unnamed = costing(named, load), costing(law, load)
    assert say_less_than_they_leave([best], unnamed, pool) is refuted
    assert not say_less_than_they_leave([best], None, pool)
    assert not say_less_than_they_leave([best], unnamed, pool[1:])
    assert not say_less_than_they_leave([best, costing(430.0, friction(0.4))], unnamed, pool)  # one says more


@pytest.mark.parametrize(
    ("left", "unnamed", "said"),
    [
        (Leftover(1e-4, 5.0, of_form=True), None, (0.0, 0.0, 0.0)),  # little, and quiet
        # all explained 900, noise 100; a further 25 of these would be 1 / 37 of 925, over 1 / 20 or 1 / 10
        (Leftover(1e-4, 25.0, of_form=True), None, (25 / 925, np.sqrt(25 / 75), 20 * 25 / 925)),
        (Leftover(1e-4, 25.0), None, (25 / 925, np.sqrt(25 / 75), 10 * 25 / 925)),
        (Leftover(0.3, 25.0, of_form=True), None, (0.0, 0.0, 0.0)),  # it may be noise
        (Leftover(1e-4, -3.0), None, (0.0, 0.0, 0.0)),
        # a law without a name that leaves 60 of the 100: 40, but ten times the 1 of noise by its freedom
        (NOTHING_LEFT, 60.0, (30 / 930, np.sqrt(30 / 70), 10 * 30 / 930)),
        (NOTHING_LEFT, 99.0, (0.0, 0.0, 0.0)),
        (Leftover(1e-4, 25.0, of_form=True), 60.0, (25 / 925, np.sqrt(25 / 75), 20 * 25 / 925)),
    ],
)
def test_what_a_name_leaves_is_told_as_a_share_in_noise_and_as_doubt(left, unnamed, said):
    problem, start = axis_problem([friction(0.4)])
    base = fit(problem, start)
    best = Candidate(base._replace(cost=100.0), 100)
    law = None if unnamed is None else Candidate(base._replace(cost=unnamed), 100)
    found = left_by_form(base._replace(cost=1000.0), best, law, left)
    assert found == pytest.approx(LeftByForm(*said))


@pytest.mark.parametrize(("gain", "told"), [(49.0, False), (51.0, True)])
def test_a_small_share_that_is_louder_than_the_noise_is_told(gain, told):
    problem, start = axis_problem([friction(0.4)])
    base = fit(problem, start)
    best = Candidate(base._replace(cost=100.0), 100)
    assert gain < 0.006 * 9900
    left = left_by_form(base._replace(cost=1e4), best, None, Leftover(1e-4, gain))
    assert bool(left.share) == told


@pytest.mark.parametrize(("better", "refuted"), [(8.0, False), (12.0, True)])
def test_a_law_without_a_name_that_is_simpler_and_likelier_refutes_it(better, refuted):
    problem, start = axis_problem([friction(0.4)])
    base = fit(problem, start)
    best = Candidate(fit(problem, base.model._replace(effects=(friction(0.4),))), problem.n_seen)
    simpler = Candidate(best.fit._replace(cost=best.fit.cost - better), problem.n_seen)
    assert better < 0.1 * (base.cost - best.fit.cost)  # a curve of many numbers might be so by its freedom
    assert is_refuted(base, best, simpler, NOTHING_LEFT, 0.005) == refuted


@pytest.mark.parametrize(
    ("said", "rival", "noise", "may_be"),
    [
        ("sensor_bias", "additive_drift", Noise.white(np.ones(1)), True),  # a drift leaves what it may
        ("sensor_bias", None, Noise.white(np.ones(1)), False),
        ("sensor_bias", None, Noise((np.ones(1),), np.ones(1), (0.98,)), True),
        ("coulomb_friction", "additive_drift", Noise.white(np.ones(1)), False),
        ("coulomb_friction", None, Noise((np.ones(1),), np.ones(1), (0.98,)), False),
    ],
)
def test_an_offset_that_may_be_a_drift_is_one_to_the_judge(said, rival, noise, may_be):
    problem, start = axis_problem([friction(0.4)])
    base = fit(problem, start)

    def found(code):
        kind = CATALOGUE[code]
        on_output = PlacedEffect(kind, Port("output", 0), theta=(0.1,) * len(kind.parameters))
        effect = friction(0.4) if code == "coulomb_friction" else on_output
        return Candidate(fit(problem, base.model._replace(effects=(effect,))), problem.n_seen)

    alternatives = ((found(rival),),) if rival else ((),)
    assert may_be_drift(noise, found(said), alternatives) == may_be


def test_where_nothing_is_named_no_output_drifts():
    problem, start = axis_problem([friction(0.4)])
    nothing = Candidate(fit(problem, start), problem.n_seen)
    assert not may_be_drift(problem.noise, nothing, ())


@pytest.mark.long
def test_names_bent_to_friction_that_grows_with_a_power_of_speed_are_no_explanation():
    """Without the name that has such a law too, Stribeck friction at the limits of its shape."""

    def stage(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - p[3] * np.sign(x[1]) * abs(x[1]) ** 0.7

    def nominal(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]

    def make(rhs, **parameters):
        return ODESimulator(rhs, dt=0.02, parameters=parameters, states=["x", "v"], inputs=["u"])

    rng = np.random.default_rng(1)
    u = levels(rng, 1500)
    y = make(stage, b=1.1, c=0.4, k=12.0, r=0.6).simulate(u) + 0.004 * rng.normal(size=(1500, 1))
    others = DiscrepancyRegressor(make(nominal, b=1.0, c=0.5, k=12.0), exclude=["stribeck_friction"])
    found = others.fit(u, y)
    assert found.verdict_ == "unknown"
    assert found.findings_[0].port == "state:1"
    assert found.location_.against == ("x", "v", "u")
    assert found.location_.invariances["reading"]["direction"] == "depends on the direction"


@pytest.mark.long
def test_names_that_leave_what_follows_the_motion_stand_in_for_something_else():
    """A drive that is the faster the farther it is behind is neither a lag nor a curve, nor both."""

    def stage(x, u, p):
        return x[1], x[2] - 0.5 * x[1] - 12.0 * x[0], 8.0 * (u[0] - x[2]) * abs(u[0] - x[2])

    def nominal(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]

    plant = ODESimulator(
        stage,
        dt=0.02,
        parameters={},
        states=["x", "v", "drive"],
        inputs=["u"],
        output=lambda x, u, p: (x[0],),
        outputs=["x"],
    )
    model = {"b": 1.1, "c": 0.6, "k": 11.5}
    simulator = ODESimulator(nominal, dt=0.02, parameters=model, states=["x", "v"], inputs=["u"])
    rng = np.random.default_rng(0)
    u = levels(rng, 3000)
    y = plant.simulate(u)
    y = y + 0.01 * y.std() * rng.normal(size=y.shape)
    effects = ["lag", "delay", "input_polynomial", "dead_zone", "coulomb_friction"]
    found = DiscrepancyRegressor(simulator, effects=effects).fit(u, y)
    assert found.verdict_ == "unknown"
    assert "What these leave is no noise. It depends on" in found.report_


def load_beside_friction():
    problem, start = axis_problem([friction(0.4)])
    base = fit(problem, start)
    load = PlacedEffect(CATALOGUE["constant_load"], Port("state", 1), (0.0, 1.0), theta=(0.01,))
    pair = fit(problem, base.model._replace(effects=(friction(0.4), load)))
    return problem, base, Candidate(pair, problem.n_seen)


def stands_in(problem, base, best, unnamed, left):
    """Ask of names that have no other forms, so that all that is left counts."""
    run = problem.run(base.model)
    structure = find_structure(problem.simulator, run.x, problem.u)
    settings = Settings((), 0.005, 2, 4, None, 0, None, lambda stage: None)
    return only_stand_in(problem, base, best, unnamed, left, structure, settings, list)


@pytest.mark.parametrize(("better", "stand_in"), [(-12.0, False), (12.0, True)])
def test_two_names_that_a_simpler_law_outdoes_only_stand_in_for_it(better, stand_in):
    problem, base, two = load_beside_friction()
    assert not stands_in(problem, base, two, None, NOTHING_LEFT)
    one = two.fit._replace(cost=two.fit.cost - better, model=two.fit.model._replace(effects=(friction(0.4),)))
    assert stands_in(problem, base, two, Candidate(one, problem.n_seen), NOTHING_LEFT) == stand_in


@pytest.mark.parametrize(("share", "stand_in"), [(0.003, False), (0.02, True)])
def test_a_law_of_many_numbers_must_be_visibly_better(share, stand_in):
    """At little noise every form is seen to be idealised."""
    problem, base, two = load_beside_friction()
    surface = next(h.placed for h in surfaces(problem, base))
    cost = two.fit.cost - share * (base.cost - two.fit.cost)
    found = fit(problem, base.model._replace(effects=(surface,)), iterations=2)
    law = Candidate(found._replace(cost=cost), problem.n_seen)
    assert law.n_values > two.n_values
    assert law.criterion < two.criterion - 12
    assert stands_in(problem, base, two, law, NOTHING_LEFT) == stand_in


def test_a_likelier_law_that_acts_elsewhere_is_no_better_form_of_two_names():
    problem, base, two = load_beside_friction()
    surface = next(h.placed for h in surfaces(problem, base))
    found = fit(problem, base.model._replace(effects=(surface,)), iterations=2)
    law = Candidate(found._replace(cost=two.fit.cost - 0.003 * base.cost), problem.n_seen)
    assert law.criterion < two.criterion - 12
    assert not stands_in(problem, base, two, law, NOTHING_LEFT)
    on_the_output = replace(surface, port=Port("output", 0))
    elsewhere = replace(law, fit=law.fit._replace(model=law.fit.model._replace(effects=(on_the_output,))))
    assert stands_in(problem, base, two, elsewhere, NOTHING_LEFT)


@pytest.mark.parametrize(("off", "needs"), [(1.0, False), (5.0, True)])
def test_names_that_need_parameters_that_nobody_is_so_wrong_about_give_way(off, needs):
    """They leave next to nothing, but only with what is five times as far off as parameters are."""
    problem, base, two = load_beside_friction()
    nominal = problem.simulator.nominal
    bent = problem.simulator.with_parameters(np.where(np.arange(nominal.size) == 0, nominal / off, nominal))
    problem = replace(problem, simulator=bent)
    run = problem.run(base.model)
    structure = find_structure(problem.simulator, run.x, problem.u)
    settings = Settings((), 0.005, 2, 4, None, 0, None, lambda stage: None)
    surface = next(h.placed for h in surfaces(problem, base))
    at = two.fit.model._replace(p=np.array(bent.nominal), effects=(surface,))
    law = Candidate(fit(problem, at, iterations=0)._replace(cost=two.fit.cost + 5.0), problem.n_seen)
    asked = problem, base, two, law, structure, settings
    assert needs_wrong_parameters(*asked) is needs
    assert not needs_wrong_parameters(problem, base, two, None, structure, settings)


def surfaces(problem, base):
    run = problem.run(base.model)
    structure = find_structure(problem.simulator, run.x, problem.u)
    found = curve_hypotheses(problem.simulator, structure, problem.u, run.x, run.y)
    return [h for h in found if h.placed.effect.code == SURFACE]


@pytest.mark.parametrize(
    ("share", "p_value", "of_form", "stand_in"),
    [
        (0.005, 1e-4, True, False),
        (0.02, 1e-4, True, True),
        (0.02, 0.01, True, False),  # it may be noise
        (0.02, 1e-4, False, False),  # a third name would take it
    ],
)
def test_two_names_that_leave_something_where_they_act_stand_in_for_it(share, p_value, of_form, stand_in):
    problem, base, two = load_beside_friction()
    left = Leftover(p_value, share / (1 - share) * (base.cost - two.fit.cost), of_form)
    assert stands_in(problem, base, two, None, left) == stand_in


def test_a_series_of_one_kind_stands_in_for_what_it_makes():
    problem, base, two = load_beside_friction()
    model = two.fit.model._replace(effects=(two.effects[1], two.effects[1]))
    left = Leftover(1e-4, 0.02 * (base.cost - two.fit.cost))
    series = Candidate(two.fit._replace(model=model), two.n_samples)
    assert stands_in(problem, base, series, None, left)


@pytest.mark.parametrize(
    ("other", "share", "kept"),
    [("asymmetric_friction", 0.003, 1), ("asymmetric_friction", 0.02, 2), ("quadratic_drag", 0.003, 2)],
)
def test_a_look_alike_that_only_mends_the_form_of_another_is_left_out(other, share, kept):
    problem, start = axis_problem([friction(0.4)])
    base = fit(problem, start)
    found = fit(problem, base.model._replace(effects=(friction(0.4),)))
    single = Candidate(found, problem.n_seen)
    effects = (friction(0.4), friction(0.01, other, (0.0,) if other == "asymmetric_friction" else ()))
    cost = found.cost - share * (base.cost - found.cost)
    pair = Candidate(found._replace(cost=cost, model=found.model._replace(effects=effects)), problem.n_seen)
    chosen = _without_refinement(pair, [pair, single], base.cost)
    assert len(chosen.effects) == kept


@pytest.mark.parametrize(
    ("code", "kind", "argument"),
    [
        ("coulomb_friction", "state", "v = signal [m]"),
        ("root_outflow", "state", "x = signal [m]"),
        ("overflow", "state", "s = signal [m]"),
        ("cubic_stiffness", "state", "x = signal [m]"),
        ("backlash", "input", "s = signal [m]"),
        ("backlash", "state", "x = signal [m]"),
        ("sensor_clip", "output", "s = signal [m]"),
        ("constant_load", "state", ""),
    ],
)
def test_a_finding_names_its_signal_by_the_letter_of_the_equation(code, kind, argument):
    placed = PlacedEffect(CATALOGUE[code], Port(kind, 0), argument_name="signal", argument_unit="m")
    assert argument_told(placed) == argument


def test_a_name_refuted_by_its_power_gives_way_to_one_that_does_as_well():
    """A spring that is hit beyond a gap looks like a cube; the power that it has then is the gap's doing."""
    gap = PlacedEffect(CATALOGUE["clearance"], Port("state", 1), (1.0, 0.0), theta=(60.0, 0.5, 0.0))
    cube = PlacedEffect(CATALOGUE["cubic_stiffness"], Port("state", 1), (1.0, 0.0), theta=(10.0,))
    cog = PlacedEffect(CATALOGUE["cogging"], Port("state", 1), (1.0, 0.0), theta=(1.0, 2.0, 0.0, 0.0, 0.0))
    problem, start = axis_problem()
    fits = {e.effect.code: fit(problem, start._replace(effects=(e,)), iterations=1) for e in (gap, cube, cog)}
    best, clearance, cogging = (
        Candidate(fits[code], problem.n_seen) for code in ("cubic_stiffness", "clearance", "cogging")
    )
    freed = with_free_power(cube, cube.effect.power, 1.0)
    other = Candidate(fit(problem, start._replace(effects=(freed,)), iterations=1), problem.n_seen)
    assert _without_its_power(best, other, ((clearance, cogging),)) == [clearance, cogging]
    square = replace(cube, effect=CATALOGUE["quadratic_stiffness"])
    power = Candidate(fit(problem, start._replace(effects=(square,)), iterations=1), problem.n_seen)
    assert _without_its_power(best, other, ((power, clearance),)) == [clearance]
    assert _without_its_power(best, best, ((clearance,),)) == []  # it has its power


def test_what_is_rounding_is_told_as_zero():
    assert _range_of(np.array([-3.27, 0.5, 1.42e-14])) == (-3.27, 0.5)
    assert _range_of(np.array([-3.27, 1.42e-14])) == (-3.27, 0.0)
    assert _range_of(np.zeros(3)) == (0.0, 0.0)
    assert _range_of(np.empty(0)) is None

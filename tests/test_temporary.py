"""Effects that act for a while: how they run, how they are found, and what is not taken for one."""

import pickle
from copy import copy
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.cli._diagnose import propose
from narx_sklearn.discrepancy import conclusion
from narx_sklearn.discrepancy.as_narx import effect_regressors
from narx_sklearn.discrepancy.fitting.acting import correction
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import ALWAYS, PlacedEffect, Port, Span
from narx_sklearn.discrepancy.report_text import report_text
from narx_sklearn.discrepancy.results import Finding
from narx_sklearn.discrepancy.rivals import as_simulators, find_rivals
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages import diagnosis, temporary
from narx_sklearn.discrepancy.stages.coloured_search import coloured_search
from narx_sklearn.discrepancy.stages.stretches import Stretches
from narx_sklearn.discrepancy.stages.temporary import (
    large_parts,
    only_where_fitted,
    search_in_spans,
    spans_of,
)
from narx_sklearn.model.simulation import free_run
from narx_sklearn.physics.effects import CATALOGUE
from narx_sklearn.report._words import headline

DT = 0.02
FRICTION = 1.5


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def rubbing(x, u, p):
    """The stage, where u[1] says how much of a dry friction rubs; smooth near rest."""
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - u[1] * np.tanh(x[1] / 0.003)


def make(rhs=stage, inputs=("drive [V]",), parameters=(1.0, 0.8, 12.0), **settings):
    names = "gain [m/s^2/V]", "damping [1/s]", "stiffness [1/s^2]"
    return ODESimulator(
        rhs,
        dt=DT,
        parameters=dict(zip(names, parameters, strict=True)),
        states=["position [m]", "velocity [m/s]"],
        inputs=list(inputs),
        **settings,
    )


def drive(n, seed=0):
    return np.repeat(np.random.default_rng(seed).normal(0, 3, n // 10), 10)[:, None]


def rubbed(n=4000, start=1200, stop=2300, noise=0.004):
    """A recording of the stage on which something rubbed for a while."""
    u = drive(n)
    there = FRICTION * ((np.arange(n) >= start) & (np.arange(n) < stop))
    machine = make(rubbing, ("drive [V]", "rub [m/s^2]"), (1.1, 0.7, 11.0), substeps=10)
    y = machine.simulate(np.column_stack([u[:, 0], there]))
    return u, y + noise * np.random.default_rng(1).normal(size=y.shape)


START, STOP = 1050, 1800


@pytest.fixture(scope="module")
def record():
    return rubbed(2600, START, STOP)


@pytest.fixture(scope="module")
def found(record):
    effects = ["coulomb_friction", "viscous_damping", "constant_load", "cubic_stiffness", "dead_zone"]
    return DiscrepancyRegressor(make(), effects=effects).fit(*record)


def integrator(x, u, p):
    return (p[0] * u[0],)


def test_a_load_acts_in_the_steps_of_its_time():
    simulator = ODESimulator(
        integrator, dt=0.5, parameters={"gain": 1.0}, states=["level [m]"], inputs=["flow [m/s]"]
    )
    load = PlacedEffect(
        CATALOGUE["constant_load"], Port("state", 0), (1.0,), theta=(2.0,), during=Span(1.0, 2.5)
    )
    y = simulator.with_effects([load]).simulate(np.zeros(8))[:, 0]
    np.testing.assert_allclose(y, [0, 0, 0, 1, 2, 3, 3, 3], atol=1e-12)


@pytest.mark.parametrize("kind", ["input", "output"])
def test_a_signal_is_changed_in_its_time_only(kind):
    code = "input_polynomial" if kind == "input" else "sensor_bias"
    effect = CATALOGUE[code]
    theta = tuple(0.3 for _ in effect.parameters)
    simulator, u = make(), drive(200)
    passing = PlacedEffect(effect, Port(kind, 0), theta=theta, during=Span(1.0, 2.0))
    plain = simulator.simulate(u)
    with_it = simulator.with_effects([passing]).simulate(u)
    np.testing.assert_array_equal(with_it[:50], plain[:50])
    changed = plain if kind == "output" else u
    changed = np.concatenate(
        [
            changed[:50],
            effect.transform(changed[:, 0], None, DT, np.array(theta), np.array([0]))[50:100, None],
            changed[100:],
        ]
    )
    expected = changed if kind == "output" else simulator.simulate(changed)
    np.testing.assert_allclose(with_it, expected, atol=1e-12)
    assert np.std(with_it - plain) > 0.01


def test_times_are_counted_from_where_a_session_began_in_any_window():
    load = PlacedEffect(
        CATALOGUE["constant_load"], Port("state", 1), (0.0, 1.0), theta=(2.0,), during=Span(1.0, 2.0)
    )
    simulator, u = make().with_effects([load]), drive(200)
    whole = simulator.simulate(u)
    twice = simulator.simulate(np.concatenate([u, u]), sessions=np.repeat([0, 1], 200))
    np.testing.assert_array_equal(twice, np.concatenate([whole, whole]))
    windows = Windows.whole([slice(0, 200)])
    run = simulator.run(u, windows, np.zeros((1, 2)))
    later = Windows(np.array([70]), np.array([200]), np.array([True]), np.array([0]))
    np.testing.assert_allclose(simulator.run(u, later, run.x[[70]]).y[70:], run.y[70:], atol=1e-12)


def test_what_it_adds_is_told_for_its_time_only():
    friction = PlacedEffect(
        CATALOGUE["coulomb_friction"], Port("state", 1), (0.0, 1.0), theta=(0.5,), during=Span(1.0, 2.0)
    )
    u = drive(200)
    problem = Problem(
        make(), u, np.zeros((200, 1)), cut([(slice(0, 200), 0)], 200, 8), Noise.white(np.ones(1))
    )
    model = Model(problem.simulator.nominal, (friction,), np.zeros((1, 2)))
    rows, _, added = correction(problem, model, problem.run(model), 0, np.arange(200), 1000)
    assert rows.tolist() == list(range(50, 100))
    assert np.all(np.abs(added) <= 0.5 + 1e-12)
    assert np.abs(added).max() == pytest.approx(0.5)


@pytest.mark.long
def test_it_is_named_with_its_time(found):
    (finding,) = found.findings_
    assert (found.verdict_, finding.effect, finding.port) == ("explained", "coulomb_friction", "state:1")
    assert finding.during == pytest.approx((START * DT, STOP * DT), abs=8 * DT)
    assert finding.parameters["Fc"] == pytest.approx(FRICTION, rel=0.05)
    assert finding.when.startswith(", from 2")
    assert f"Coulomb friction in the equation of velocity{finding.when}." in found.report_
    (segment,) = found.location_.segments.to_dict("records")
    assert segment["effect"] == "coulomb_friction"
    assert (segment["start"], segment["stop"]) == pytest.approx((START, STOP), abs=8)
    assert segment["share"] > 0.8
    p = found.parameters_
    assert np.abs(p["augmented"] / [1.1, 0.7, 11.0] - 1).max() < 0.02
    assert np.abs(p["refitted"] / [1.1, 0.7, 11.0] - 1).max() > 0.05  # bent by what acted for a while
    scores = found.scores_["nrmse"]
    assert scores["augmented"] < 0.8 * scores["refitted"]


@pytest.mark.long
def test_the_corrected_simulation_holds_it_at_its_time(found, record):
    u, y = record
    again = pickle.loads(pickle.dumps(found))
    run = again.predict(u, y_init=y[:20])
    assert np.std(run - y) < 1.2 * 0.004
    assert found.score(u, y) > 0.999


def test_models_and_experiments_take_what_lasts(found):
    u = drive(2000, seed=3)
    plain = found.simulator_.with_effects([]).simulate(u)
    model = found.to_narx(u)
    assert effect_regressors(found.simulator_)
    assert not model.phi
    error = free_run(model, u, plain[:2]).y[10:, 0] - plain[10:, 0]
    assert np.std(error) < 0.02 * np.std(plain)
    rivals = find_rivals(found.conclusion_.diagnosis, ["coulomb_friction", "viscous_damping"])
    rivals = as_simulators(rivals, set(), found.conclusion_.diagnosis.problem)
    assert all(e.during == ALWAYS for simulator in rivals.values() for e in simulator.effects)


class TestConfirmed:
    """The friction was over when the samples held out began: only the parameters that it bent show there."""

    @pytest.fixture
    def judged(self, found, record, monkeypatch):
        def judge_with(unbent=False, lasting=()):
            of = found.conclusion_.diagnosis
            best, refitted = of.best.fit.model, of.refitted
            if unbent:
                refitted = refitted._replace(model=refitted.model._replace(p=best.p, x0=best.x0))
            effects = (*best.effects, *lasting)
            model = best._replace(effects=effects)
            best = replace(of.best, fit=fit(of.problem, model, iterations=0)) if lasting else of.best
            given = replace(
                of,
                refitted=refitted,
                best=best,
                order=tuple(range(len(effects))),
                alternatives=((),) * len(effects),
            )
            monkeypatch.setattr(conclusion, "diagnose", lambda *_: given)
            u, y = record
            settings = Settings((), 0.005, 2, 16, None, 0, None, lambda stage: None)
            return conclusion.conclude(make(), u, y, None, settings)

        return judge_with

    def test_by_what_it_bent(self, judged):
        concluded = judged()
        assert not concluded.is_unconfirmed
        assert concluded.verdict == "explained"

    def test_by_nothing_is_no_explanation(self, judged):
        concluded = judged(unbent=True)
        assert concluded.is_unconfirmed
        assert concluded.diagnosis.verdict == "explained"
        assert concluded.verdict == "ambiguous"
        assert concluded.corrected.effects

    def test_what_lasts_beside_it_does_not_confirm_it(self, judged, monkeypatch):
        """What lasts is compared without it, with the parameters that it has beside it."""
        weak = PlacedEffect(CATALOGUE["viscous_damping"], Port("state", 1), (0.0, 1.0), theta=(1e-9,))
        asked = []

        def alone(problem, model):
            asked.append(tuple(e.effect.code for e in model.effects))
            return fit(problem, model, iterations=0)  # as it stands beside what acts for a while

        monkeypatch.setattr(conclusion, "fit", alone)
        assert judged(lasting=[weak]).is_unconfirmed
        assert asked == [("viscous_damping",)]

    def test_by_nothing_is_said(self, found):
        assert "acts for a while" not in found.report_
        dx = copy(found)
        dx.conclusion_ = replace(found.conclusion_, is_unconfirmed=True)
        dx.verdict_ = "ambiguous"
        report = " ".join(report_text(dx).split())
        assert "acts for a while only, and no sample that was held out confirms it" in report
        assert "Nothing that was held out is followed better with what acts for a while" in report
        assert headline(dx).count("or what") == 1
        assert "or what always acts and looks like that meanwhile" in headline(dx)
        assert propose(dx, None) is None  # no experiment tells it from what nobody knows


@pytest.mark.long
def test_what_always_acts_is_said_to_act_always():
    u, y = rubbed(start=0, stop=4000)
    dx = DiscrepancyRegressor(make(), effects=["coulomb_friction", "constant_load"]).fit(u, y)
    assert dx.findings_[0].effect == "coulomb_friction"
    assert dx.findings_[0].during is None
    assert (dx.location_.segments["effect"] == "").all()


@pytest.mark.long
def test_what_begins_and_stays_has_no_end_unless_it_ended_unseen():
    u, y = rubbed(2400, 1150, 2400)
    effects = ["coulomb_friction", "constant_load"]
    stays = DiscrepancyRegressor(make(), effects=effects).fit(u, y)
    assert stays.findings_[0].during == (pytest.approx(1150 * DT, abs=8 * DT), np.inf)
    assert stays.scores_["nrmse"]["augmented"] < 0.5 * stays.scores_["nrmse"]["refitted"]
    u, y = rubbed(2400, 1150, 1970)  # the last fifth is held out, and the friction is gone there
    ended = DiscrepancyRegressor(make(), effects=effects).fit(u, y)
    assert ended.verdict_ == "explained"
    assert ended.findings_[0].during == pytest.approx((1150 * DT, 1920 * DT), abs=8 * DT)


@pytest.mark.long
def test_what_is_contradicted_after_its_end_explains_nothing():
    """What rubbed is over when another plant takes its place: the numbers found with it do not hold."""
    u, y = rubbed(2000, 500, 1000)
    other = make(parameters=(1.1, 4.0, 11.0)).simulate(u)
    y[1600:] = other[1600:]
    dx = DiscrepancyRegressor(make(), effects=["coulomb_friction", "constant_load"]).fit(u, y)
    assert dx.findings_[0].during == pytest.approx((500 * DT, 1000 * DT), abs=8 * DT)
    assert dx.verdict_ == "unknown"


def test_an_end_that_nobody_chose_has_no_price():
    problem, start, load = held_load()
    model = start.model._replace(effects=(load.acting(Span(2.0, np.inf)),))
    open_ended = Candidate(fit(problem, model, iterations=0), 800)
    closed = only_where_fitted(problem, open_ended)
    assert closed.effects[0].during[:2] == (2.0, pytest.approx(16.0))
    assert closed.price == open_ended.price
    chosen = Candidate(closed.fit, 800)
    assert chosen.price == pytest.approx(closed.price + 2 * np.log(800))


def test_what_is_not_defined_outside_its_time_does_no_harm_there():
    def root(argument, rate, own, second, time, step, z, theta, dz):
        return theta[0] * np.sqrt(argument)

    effect = replace(CATALOGUE["constant_load"], code="root", force=root)
    never = PlacedEffect(effect, Port("state", 1), (1.0, 0.0), theta=(2.0,), during=Span(100.0, 200.0))
    u = drive(300)
    np.testing.assert_array_equal(make().with_effects([never]).simulate(u), make().simulate(u))


@pytest.mark.long
def test_the_halves_and_the_middle_are_tried_where_no_stretch_stands_out(monkeypatch):
    u = drive(1000)
    problem = Problem(make(), u, u, cut([(slice(200, 1000), 200)], 200, 8), Noise.white(np.ones(1)))
    assert large_parts(problem, problem.y) == [Span(-np.inf, 8.0), Span(4.0, 12.0), Span(8.0, np.inf)]
    monkeypatch.setattr(diagnosis, "spans_of", lambda *_: [])
    dx = DiscrepancyRegressor(make(), effects=["coulomb_friction", "gain_drift"]).fit(*rubbed(start=1000))
    assert dx.findings_[0].effect == "coulomb_friction"
    assert dx.findings_[0].during == pytest.approx((1000 * DT, 2300 * DT), abs=8 * DT)


def loosening(x, u, p):
    """The stage, where u[1] says how much of its spring is lost."""
    return x[1], p[0] * u[0] - p[1] * x[1] - (1.0 - u[1]) * p[2] * x[0]


def sagging(x, u, p):
    """The stage, where u[1] says how much of its drive is lost."""
    return x[1], p[0] * (1.0 - u[1]) * u[0] - p[1] * x[1] - p[2] * x[0]


@pytest.mark.long
@pytest.mark.parametrize(
    ("rhs", "port", "parameter"),
    [(loosening, "state:1", ("k", 2.2, "1/s^2")), (sagging, "input:0", ("k", -0.2, "-"))],
)
def test_a_parameter_that_changes_is_told_and_no_name_is_sold_for_it(rhs, port, parameter):
    u = drive(3000)
    lost = 0.2 * (np.arange(3000) >= 1200)
    machine = make(rhs, ("drive [V]", "lost [-]"), (1.1, 0.7, 11.0))
    y = machine.simulate(np.column_stack([u[:, 0], lost]))
    y += 0.004 * np.random.default_rng(1).normal(size=y.shape)
    effects = ["clearance", "creep", "extra_mode", "constant_load", "viscous_damping", "dead_zone"]
    found = DiscrepancyRegressor(make(), effects=effects).fit(u, y)
    assert found.verdict_ == "unknown"
    (finding,) = found.findings_
    assert (finding.effect, finding.port) == ("unknown", port)
    assert "parameter that changed" in finding.title
    name, value, unit = parameter
    before = finding.during[0] == -np.inf  # it acts before or after, which is the same
    assert finding.parameters[name] == pytest.approx(-value if before else value, rel=0.3)
    assert finding.units[name] == unit
    # ends are settled to 1/500 of the record, 0.12 s of it
    assert finding.during[1 if before else 0] == pytest.approx(24.0, abs=0.15)
    scores = found.scores_["nrmse"]
    assert scores["augmented"] < 0.3 * scores["refitted"]


RUBBED = "coulomb_friction", "constant_load", "cubic_stiffness", "sensor_bias", "dead_zone"


def asked(y, u, simulator=None, codes=RUBBED, window=200):
    """Return a problem under white noise as large as the output, and settings."""
    simulator = make() if simulator is None else simulator
    problem = Problem(
        simulator, u, y, cut([(slice(0, len(u)), 0)], window, 8), Noise.white(np.array([np.nanstd(y)]))
    )
    settings = Settings(
        tuple(CATALOGUE[code] for code in codes), 0.005, 2, 16, None, 0, None, lambda stage: None
    )
    return problem, settings


def searched_in(y, u, start, stop, p=None, simulator=None, codes=RUBBED, window=200):
    """Search in a stretch that somebody points at, from the refitted parameters or others."""
    problem, settings = asked(y, u, simulator, codes, window)
    simulator = problem.simulator
    base = fit(problem, Model(simulator.nominal, (), np.zeros((problem.windows.count, 2))))
    structure = find_structure(simulator, problem.run(base.model).x, u)
    searched = coloured_search(problem, base, structure, settings)
    spans = [Span(start * simulator.dt, stop * simulator.dt)]
    p = searched.refitted.model.p if p is None else np.array(p)
    return search_in_spans(spans, p, searched, structure, settings)


def test_parameters_with_which_a_run_diverges_are_not_begun_with():
    u, y = rubbed(1500, 500, 1000)
    _, _, (step,) = searched_in(y, u, 500, 1000, p=(1.0, 0.8, 1e9))
    assert best_of(step).effects[0].during[:2] == pytest.approx((500 * DT, 1000 * DT), abs=8 * DT)


def drum(x, u, p):
    """Water of a boiler, and the swell of what steams in it."""
    return p[0] * (u[0] - u[1]), p[1] * (p[2] * (u[1] - 40.0) - x[1])


def leaked(seed, n=1000):
    """Half an hour of a drum that a controller feeds; it leaks from 667 s to 1167 s."""
    rng = np.random.default_rng(seed)
    steam = np.repeat(rng.uniform(30, 50, n // 40), 40)
    noise = lfilter([1.0], [1.0, -0.9], rng.normal(size=n))
    measured, integral, water, swell = 0.3 * noise / noise.std(), 0.0, 0.0, 0.0
    u = np.column_stack([steam, steam])
    for k in range(n):
        measured[k] += water + swell
        integral -= 2.0 * measured[k]
        u[k, 0] = 40 - 0.15 * measured[k] + 0.0005 * integral + 0.5 * (steam[k] - 40)
        lost = 0.3 if n / 3 < k < 1.75 * n / 3 else 0.0
        for _ in range(10):
            water += 0.2 * 0.2 * (u[k, 0] - lost - steam[k])
            swell += 0.2 * 0.03 * (1.6 * (steam[k] - 40) - swell)
    return u, measured[:, None]


@pytest.mark.long
@pytest.mark.parametrize("seed", [3, 5])
def test_parameters_that_what_acts_for_a_while_bent_far_are_left_for_the_nominal_ones(seed):
    """The water constant is 0.124 to 0.129 without a leak, where it is 0.2."""
    names = "water [mm/kg]", "swell rate [1/s]", "swell [mm s/kg]"
    simulator = ODESimulator(
        drum,
        dt=2.0,
        parameters=dict(zip(names, (0.23, 0.026, 1.4), strict=True)),
        states=["water [mm]", "swell [mm]"],
        inputs=["feed [kg/s]", "steam [kg/s]"],
        output=lambda x, u, p: x[0] + x[1],
        outputs=["level [mm]"],
    )
    u, y = leaked(seed)
    _, _, (step,) = searched_in(
        y, u, 400, 800, simulator=simulator, codes=("constant_load", "extra_mode"), window=500
    )
    (effect,) = best_of(step).effects
    assert (effect.effect.code, effect.port) == ("constant_load", Port("state", 0))
    assert effect.during[:2] == pytest.approx((667.0, 1167.0), abs=10.0)


def pushed(n=3000, start=900, stop=1700):
    """A level that a flow fills and something drains for a while; noise with a pole at 0.9."""
    u, rng = drive(n), np.random.default_rng(4)
    there = 0.02 * ((np.arange(n) >= start) & (np.arange(n) < stop))
    y = np.cumsum(DT * np.r_[0.0, (1.1 * u[:, 0] + there)[:-1]])
    noise = lfilter([1.0], [1.0, -0.9], rng.normal(size=n))
    return u, (y + 0.02 * noise)[:, None]


def test_where_an_integrator_remembers_a_push_the_pieces_tell_the_noise():
    u, y = pushed()
    simulator = ODESimulator(
        integrator, dt=DT, parameters={"gain": 1.0}, states=["level [m]"], inputs=["flow [m/s]"]
    )
    windows = cut([(slice(0, 3000), 0)], 3000, 8)
    problem = Problem(simulator, u, y, windows, Noise.white(np.ones(1)), adds_up=(True,))
    start = Model(np.array([1.1]), (), np.zeros((1, 1)))
    span = Span(900 * DT, 1700 * DT)
    whole, pieces = temporary._noises_of_the_rest(span, problem, start)
    slow = max(np.abs(np.roots([1.0, *-whole.coefficients[0]])))
    assert slow > 0.97  # the aftermath looks like noise that drifts
    np.testing.assert_allclose(pieces.coefficients[0], [0.9], atol=0.03)
    assert pieces.sigma == pytest.approx([0.02], rel=0.05)
    assert not any(pieces.average)
    forgets = replace(problem, adds_up=(False,))
    (alone,) = temporary._noises_of_the_rest(span, forgets, start)
    np.testing.assert_array_equal(alone.coefficients[0], whole.coefficients[0])
    assert temporary._noises_of_the_rest(Span(), problem, start) == []


def test_pieces_of_windows_without_a_span_are_windows():
    problem = Problem(
        make(), drive(60), np.zeros((60, 1)), cut([(slice(0, 60), 0)], 20, 8), Noise.white(np.ones(1))
    )
    acting = temporary._acting(Span(15 * DT, 42 * DT), problem)
    pieces = temporary._without(acting, problem)
    assert list(zip(pieces.first, pieces.last, strict=True)) == [(0, 15), (42, 60)]
    assert pieces.fresh.all()
    assert pieces.began.tolist() == [0, 0]


@pytest.mark.parametrize(
    ("codes", "may"),
    [
        ((), False),
        (("constant_load",), False),
        (("gain_drift",), True),
        (("constant_load", "sensor_bias"), True),
    ],
)
def test_a_drift_or_several_names_may_stand_in_for_what_acts_for_a_while(codes, may):
    effects = [PlacedEffect(CATALOGUE[code], Port("output", 0), (0.0, 1.0)) for code in codes]
    assert temporary.may_stand_in(effects) is may


def test_what_did_not_lead_where_a_search_began_may_lead_in_the_time_it_came_to():
    u, y = rubbed(1500, 500, 1000)
    problem, settings = asked(y, u)
    base = fit(problem, Model(problem.simulator.nominal, (), np.zeros((problem.windows.count, 2)))).model
    structure = find_structure(problem.simulator, problem.run(base).x, u)
    load = PlacedEffect(CATALOGUE["constant_load"], Port("state", 1), (0.0, 1.0), theta=(0.1,))
    led = fit(problem, base._replace(effects=(load.acting(Span(500 * DT, 1000 * DT)),)))
    settled = [Candidate(led, problem.n_seen)]
    first, *_, last = temporary._looked_at_again(problem, settled, structure, settings)
    assert last is settled[0]
    assert first.effects[0].effect.code == "coulomb_friction"
    assert first.effects[0].during[:2] == pytest.approx((500 * DT, 1000 * DT), abs=8 * DT)


@pytest.mark.parametrize(
    ("seed", "pole"),
    [
        pytest.param(seed, pole, marks=() if (seed, pole) in {(0, 0.0), (1, 0.9)} else pytest.mark.long)
        for seed in range(4)
        for pole in (0.0, 0.9)
    ],
)
def test_noise_in_a_stretch_that_somebody_points_at_is_noise(seed, pole):
    u = drive(3000, seed)
    noise = np.random.default_rng(seed + 10).normal(size=3000)
    for k in range(1, 3000):
        noise[k] += pole * noise[k - 1]
    y = make(parameters=(1.1, 0.7, 11.0)).simulate(u) + 0.01 * noise[:, None]
    start = 300 + 500 * seed
    assert searched_in(y, u, start, start + 700) is None


def test_a_push_is_tried_however_many_others_lead(monkeypatch):
    u = drive(3000)
    pushed = make(parameters=(1.1, 0.7, 11.0)).with_effects(
        [
            PlacedEffect(
                CATALOGUE["constant_load"],
                Port("state", 1),
                (0.0, 1.0),
                theta=(0.8,),
                during=Span(22.0, 38.0),
            )
        ]
    )
    y = pushed.simulate(u) + 0.004 * np.random.default_rng(0).normal(size=(3000, 1))
    monkeypatch.setattr(temporary, "LEADERS", 0)
    _, _, (step,) = searched_in(y, u, 1100, 1900)
    passing = {c.effects[0].effect.code for c in step.candidates if c.effects[0].passes}
    assert passing <= {"constant_load", "sensor_bias"}
    assert best_of(step).effects[0].effect.code == "constant_load"
    assert best_of(step).effects[0].during[:2] == pytest.approx((22.0, 38.0), abs=8 * DT)


def best_of(step):
    return min(step.candidates, key=lambda c: c.criterion)


@pytest.mark.long
def test_an_end_that_leaves_the_record_is_not_known():
    u, y = rubbed(1500, 900, 1500)
    _, _, (step,) = searched_in(y, u, 900, 1400)
    assert best_of(step).effects[0].during[:2] == (pytest.approx(900 * DT, abs=8 * DT), np.inf)
    u, y = rubbed(1500, 0, 600)
    _, _, (step,) = searched_in(y, u, 100, 600)
    assert best_of(step).effects[0].during[:2] == (-np.inf, pytest.approx(600 * DT, abs=8 * DT))


def test_nothing_is_searched_where_the_rest_was_not_measured():
    u, y = rubbed(1500, 300, 1200)
    y[:250] = np.nan
    y[1250:] = np.nan
    assert searched_in(y, u, 250, 1250, codes=("coulomb_friction",)) is None


def test_a_stretch_that_is_pointed_at_badly_is_mended():
    u, y = rubbed(1500, 500, 1000)
    problem, _, (step,) = searched_in(y, u, 575, 950)
    assert best_of(step).effects[0].during[:2] == pytest.approx((500 * DT, 1000 * DT), abs=8 * DT)
    assert step.detection.p_value < 1e-10
    assert problem.noise.sigma[0] == pytest.approx(0.004, rel=0.1)


def test_ends_are_moved_where_whole_fits_would_move_them(monkeypatch):
    """Only moves that tangents promise something of are fitted, less than half, and they end alike."""
    u, y = rubbed(1500, 500, 1000)
    windows = cut([(slice(0, 1500), 0)], 500, 20)
    problem = Problem(make(), u, y, windows, Noise.white(np.array([0.004])))
    rub = PlacedEffect(CATALOGUE["coulomb_friction"], Port("state", 1), (0.0, 1.0), theta=(1.0,))
    begun = Model(np.array([1.1, 0.7, 11.0]), (rub.acting(Span(11.5, 19.0)),), np.zeros((3, 2)))
    candidate, fits = Candidate(fit(problem, begun), problem.n_seen), []
    monkeypatch.setattr(temporary, "fit", lambda *a, **k: fits.append(1) or fit(*a, **k))
    settled = temporary.with_settled_ends(problem, candidate, 2)
    n_fits = len(fits)
    monkeypatch.setattr(temporary, "_may_leave_less", lambda *_: True)
    by_fits = temporary.with_settled_ends(problem, candidate, 2)
    assert settled.effects[0].during == by_fits.effects[0].during
    assert settled.effects[0].during[:2] == pytest.approx((500 * DT, 1000 * DT), abs=8 * DT)
    assert settled.fit.cost == pytest.approx(by_fits.fit.cost, rel=1e-9)
    assert n_fits < 0.5 * (len(fits) - n_fits)


def test_ends_go_on_past_a_time_at_which_nothing_shows():
    """A limit of the drive is met some seconds apart: round one of these no end has a reason to move."""
    rng = np.random.default_rng(3)
    u = 0.5 * np.repeat(rng.normal(0, 1, 200), 10)[:, None]
    peaks = [300, 700, 1000, 1250, 1700]
    for peak in peaks:
        u[peak : peak + 20] = 6.0
    limit = PlacedEffect(CATALOGUE["input_saturation"], Port("input", 0), theta=(-9.0, 4.0, 0.05))
    there = limit.acting(Span(600 * DT, 1400 * DT))
    y = make(parameters=(1.1, 0.7, 11.0)).with_effects([there]).simulate(u)
    y += 0.004 * rng.normal(size=y.shape)
    problem = Problem(make(), u, y, cut([(slice(0, 2000), 0)], 500, 20), Noise.white(np.array([0.004])))
    begun = Model(np.array([1.1, 0.7, 11.0]), (limit.acting(Span(980 * DT, 1040 * DT)),), np.zeros((4, 2)))
    candidate = Candidate(fit(problem, begun), problem.n_seen)
    assert candidate.fit.cost > 2.0 * problem.n_seen
    settled = temporary.with_settled_ends(problem, candidate, temporary.PASSES)
    begins, ends, _ = settled.effects[0].during
    assert 320 * DT < begins < 705 * DT
    assert 1265 * DT < ends < 1705 * DT
    assert settled.fit.cost < 1.1 * problem.n_seen


def test_an_end_that_went_too_far_comes_back():
    """Sticking out of the record it takes in most of the rest; it is known where that is worth its price."""
    u, y = rubbed(2000, 500, 1850)
    rub = PlacedEffect(CATALOGUE["coulomb_friction"], Port("state", 1), (0.0, 1.0), theta=(1.0,))
    problem = Problem(make(), u, y, cut([(slice(0, 2000), 0)], 500, 20), Noise.white(np.array([0.004])))
    p = np.array([1.1, 0.7, 11.0])
    for begun in (Span(1250 * DT, 1700 * DT), Span(600 * DT, np.inf)):
        model = Model(p, (rub.acting(begun),), np.zeros((4, 2)))
        candidate = Candidate(fit(problem, model), problem.n_seen)
        during = temporary.with_settled_ends(problem, candidate, temporary.PASSES).effects[0].during
        assert during[:2] == pytest.approx((500 * DT, 1850 * DT), abs=8 * DT)


def test_a_move_with_which_a_run_diverges_is_left_to_a_fit():
    u, y = rubbed(600, 200, 400)
    problem = Problem(make(), u, y, cut([(slice(0, 600), 0)], 600, 20), Noise.white(np.array([0.004])))
    load = PlacedEffect(
        CATALOGUE["constant_load"], Port("state", 1), (0.0, 1.0), theta=(0.5,), during=Span(4.0, 8.0)
    )
    found = fit(problem, Model(np.array([1.1, 0.7, 11.0]), (load,), np.zeros((1, 2))))
    lost = replace(load, theta=(1e308,), during=Span(4.0, 6.0))
    with np.errstate(over="ignore", invalid="ignore"):
        assert temporary._may_leave_less(problem, found, found.model._replace(effects=(lost,)))


def stretches(*rows):
    return Stretches(pd.DataFrame(rows, columns=["start", "stop", "share"]), np.zeros(3), np.zeros((1000, 1)))


@pytest.mark.parametrize(
    ("rows", "spans"),
    [
        ([], []),
        ([(400, 600, 0.5)], [(8.0, 12.0)]),
        ([(400, 500, 0.2), (550, 600, 0.5)], [(8.0, 12.0), (11.0, 12.0)]),
        ([(5, 600, 0.5)], [(-np.inf, 12.0), (12.0, np.inf)]),
        ([(700, 1000, 0.5)], [(14.0, np.inf), (-np.inf, 14.0)]),
        ([(100, 200, 0.2), (800, 950, 0.7)], [(16.0, 19.0)]),  # together they are most of the time
        ([(0, 1000, 0.9)], []),
    ],
)
def test_times_to_look_at(rows, spans):
    u = drive(1000)
    problem = Problem(make(), u, u, cut([(slice(0, 1000), 0)], 200, 8), Noise.white(np.ones(1)))
    found = spans_of(stretches(*rows), problem)
    assert len(found) == len(spans)
    for one, wanted in zip(found, spans, strict=True):
        assert not one.along_record
        assert one[:2] == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("rows", "span"),
    [
        ([(100, 200, 0.5)], (2.0, 4.0)),
        ([(600, 700, 0.5)], (2.0, 4.0)),  # counted from where the session began
        ([(100, 200, 0.5), (605, 710, 0.4)], (2.0, 4.2)),  # at about the same time of each
    ],
)
def test_sessions_have_times_of_their_own(rows, span):
    u = drive(1000)
    pieces = [(slice(0, 500), 0), (slice(500, 1000), 500)]
    problem = Problem(make(), u, u, cut(pieces, 100, 8), Noise.white(np.ones(1)))
    assert spans_of(stretches(*rows), problem)[0][:2] == pytest.approx(span)
    assert large_parts(problem, problem.y)[1][:2] == pytest.approx((2.5, 7.5))


@pytest.mark.long
def test_what_acts_for_a_while_in_each_session_is_found():
    parts = [rubbed(n=2000, start=600, stop=1200, noise=0.004)[:2] for _ in range(2)]
    u, y = (np.concatenate(both) for both in zip(*parts, strict=True))
    sessions = np.repeat([0, 1], 2000)
    named = ["coulomb_friction", "constant_load", "gain_drift"]
    dx = DiscrepancyRegressor(make(), effects=named, random_state=0).fit(u, y, sessions=sessions)
    first = dx.findings_[0]
    assert (first.effect, first.port) == ("coulomb_friction", "state:1")
    assert first.during == pytest.approx((12.0, 24.0), abs=0.5)
    assert first.parameters["Fc"] == pytest.approx(FRICTION, rel=0.1)
    assert len(dx.location_.segments.query("effect == 'coulomb_friction'")) == 2


def held_load():
    """A problem that begins at 4 s of a record, begins to count there, and a load in it."""
    u = drive(1000)
    problem = Problem(make(), u, u, cut([(slice(200, 1000), 200)], 200, 8), Noise.white(np.ones(1)))
    load = PlacedEffect(CATALOGUE["constant_load"], Port("state", 1), (0.0, 1.0), theta=(2.0,))
    return problem, fit(problem, Model(problem.simulator.nominal, (), np.zeros((4, 2))), iterations=0), load


def test_what_was_not_fitted_is_not_said():
    problem, start, load = held_load()

    def times(during):
        model = start.model._replace(effects=(load.acting(during),))
        ended = only_where_fitted(problem, Candidate(start._replace(model=model), 800))
        return ended and ended.effects[0].during

    assert times(ALWAYS) is None
    assert times(Span(2.0, 3.0)) is None
    assert times(Span(2.0, np.inf)) == (2.0, pytest.approx(16.0), False)
    assert times(Span(-np.inf, 3.0)) == (0.0, 3.0, False)


@pytest.mark.parametrize(
    ("during", "words"),
    [
        (ALWAYS, ""),
        (Span(3.0, 7.5), ", from 3 s to 7.5 s"),
        (Span(3.0, np.inf), ", from 3 s on"),
        (Span(149760.0, np.inf), ", from 149760 s on"),
        (Span(-np.inf, 7.5), ", until 7.5 s"),
    ],
)
def test_times_in_words(during, words):
    load = PlacedEffect(CATALOGUE["constant_load"], Port("state", 1), (0.0, 1.0), theta=(2.0,), during=during)
    assert load.passes == bool(words)
    told = dict.fromkeys(
        [
            "effect",
            "title",
            "sentence",
            "equation",
            "port",
            "place",
            "argument",
            "parameters",
            "intervals",
            "units",
        ]
    )
    finding = Finding(
        **told, lookalikes=(), p_value=0.0, improvement=1.0, during=during[:2] if words else None
    )
    assert finding.when == words
    assert load.always().during == ALWAYS


@pytest.mark.long
def test_parameters_come_from_a_part_that_was_spared_and_each_effect_has_its_own_ends():
    """A load on the far side of a shaft, for a quarter of the time, while all parameters are guessed."""

    def turbine(x, u, p):
        shaft = p[0] * x[0] + p[1] * (x[1] - x[2])
        return x[1] - x[2], (u[0] - shaft - 0.2 * x[1]) / p[2], shaft - p[3] * x[2] - u[1]

    def nominal(x, u, p):
        shaft = p[0] * x[0] + p[1] * (x[1] - x[2])
        return x[1] - x[2], (u[0] - shaft - 0.2 * x[1]) / p[2], shaft - p[3] * x[2]

    def made(rhs, inputs, *values):
        names = ["k [N m/rad]", "c [N m s/rad]", "J [kg m^2]", "b [N m s/rad]"]
        states = ["twist [rad]", "rotor [rad/s]", "generator [rad/s]"]
        parameters = dict(zip(names, values, strict=True))
        return ODESimulator(rhs, dt=0.05, parameters=parameters, states=states, inputs=inputs, output=(2,))

    rng = np.random.default_rng(0)
    torque = np.repeat(rng.uniform(2, 6, 100), 40) + rng.normal(size=4000)
    load = np.where((np.arange(4000) >= 1600) & (np.arange(4000) < 2600), 0.5, 0.0)
    machine = made(turbine, ["torque [N m]", "load [N m]"], 8.0, 1.0, 5.0, 0.6)
    y = machine.simulate(np.column_stack([torque, load]))
    y += 0.01 * np.std(y) * rng.normal(size=y.shape)
    effects = ["constant_load", "extra_mode", "sensor_bias", "dead_zone", "viscous_damping"]
    guessed = made(nominal, ["torque [N m]"], 7.0, 1.2, 5.5, 0.7)
    found = DiscrepancyRegressor(guessed, effects=effects).fit(torque[:, None], y)
    (finding,) = found.findings_
    assert (finding.effect, finding.port) == ("constant_load", "state:2")
    assert finding.during == pytest.approx((80.0, 130.0), abs=0.5)
    assert found.simulator_.nominal == pytest.approx([8.0, 1.0, 5.0, 0.6], rel=0.03)

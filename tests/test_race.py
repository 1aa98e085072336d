"""How far leaders are fitted: what cannot come near the best any more is left as it is."""

from dataclasses import replace

import numpy as np
import pytest

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search import explain
from narx_sklearn.discrepancy.search.bank import make_bank
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.detect import NONE_SILENT
from narx_sklearn.discrepancy.search.explain import IN_REACH, refit_leaders
from narx_sklearn.discrepancy.search.hypotheses import enumerate_hypotheses
from narx_sklearn.discrepancy.search.ranking import leaders
from narx_sklearn.discrepancy.search.unnamed.curves import curve_hypotheses
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages import unnamed
from narx_sklearn.discrepancy.stages.unnamed import best_unnamed
from narx_sklearn.physics.effects import CATALOGUE

NOISE = 0.02  # m
CUBIC = PlacedEffect(CATALOGUE["cubic_stiffness"], Port("state", 1), (1.0, 0.0), theta=(15.0,))


def spring(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def make_spring(gain=1.0, damping=0.8, stiffness=12.0):
    return ODESimulator(
        spring,
        dt=0.05,
        parameters={"gain [m/s^2/V]": gain, "damping [1/s]": damping, "stiffness [1/s^2]": stiffness},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [V]"],
    )


@pytest.fixture(scope="module")
def hardening():
    """Return a spring that hardens strongly, the refit without it, and the run of that."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.normal(0.0, 3.0, 200), 10)[:, None]
    y = make_spring(1.1, 0.7, 11.0).with_effects([CUBIC]).simulate(u) + NOISE * rng.normal(size=u.shape)
    windows = cut([(slice(0, len(u)), 0)], 500, 12)
    problem = Problem(make_spring(), u, y, windows, Noise.white(np.array([NOISE])))
    base = fit(problem, Model(problem.simulator.nominal, (), np.zeros((windows.count, 2))))
    run = problem.run(base.model)
    return problem, base, run, find_structure(problem.simulator, run.x, u)


def iterations_spent(monkeypatch):
    """Return a list to which every fit of a leader adds its iterations."""
    spent = []

    def counted(*args, **options):
        found = fit(*args, **options)
        spent.append(found.iterations)
        return found

    monkeypatch.setattr(explain, "fit", counted)
    return spent


def test_a_race_leaves_the_order_in_reach_as_it_is_and_saves_work(hardening, monkeypatch):
    problem, base, run, structure = hardening
    hypotheses = enumerate_hypotheses(list(CATALOGUE.values()), problem, run, structure)
    placed = leaders(make_bank(problem, base, hypotheses), 12, NONE_SILENT, 1.0)
    spent = iterations_spent(monkeypatch)
    raced = refit_leaders(problem, base, placed)
    with_race = sum(spent)
    spent.clear()
    monkeypatch.setattr(explain, "IN_REACH", np.inf)
    thorough = refit_leaders(problem, base, placed)
    assert with_race < 0.95 * sum(spent)

    def in_reach(found: list[Candidate]) -> dict[tuple, float]:
        least = found[0].criterion
        return {c.effects[0].place: c.criterion for c in found if c.criterion < least + IN_REACH}

    assert raced[0].effects[0].effect.code == "cubic_stiffness"
    assert in_reach(raced).keys() == in_reach(thorough).keys()
    for place, criterion in in_reach(thorough).items():
        assert in_reach(raced)[place] == pytest.approx(criterion, abs=1.0)
    assert {c.effects[0].place for c in raced} == {c.effects[0].place for c in thorough}


def test_what_still_falls_fast_goes_on(hardening):
    """A candidate that halved its cost in the last iteration is given credit for those to come."""
    problem, base, *_ = hardening
    n = problem.n_seen
    best = Candidate(base._replace(cost=n, gained=0.0), n)
    slow = Candidate(base._replace(cost=100.0 * n, gained=1e-4), n)
    falling = Candidate(slow.fit._replace(gained=0.5), n)
    far = base._replace(cost=1e3 * n)
    assert not explain._may_catch_up(slow, best, far, 20)
    assert explain._may_catch_up(falling, best, far, 20)
    assert falling.pace == pytest.approx(n * np.log(2.0))
    most = Candidate(slow.fit._replace(cost=30.0 * n), n)
    assert explain._may_catch_up(most, best, far, 20)  # a slow beginning; it takes off more than half


def test_a_surface_without_a_name_fits_as_well_as_the_name(hardening):
    """From the parameters that go with the name alone a stiff surface is thrown out of all range."""
    problem, base, run, structure = hardening
    rows = problem.rows[problem.inside]
    curves = curve_hypotheses(problem.simulator, structure, problem.u[rows], run.x[rows], run.y[rows])
    named = fit(problem, base.model._replace(p=np.array([1.1, 0.7, 11.0]), effects=(CUBIC,)))
    beside = base._replace(model=named.model._replace(effects=()))
    placed = [curve.placed for curve in curves]
    found = refit_leaders(problem, base, placed, finished=1, twins=0, elsewhere=[beside])
    assert found[0].fit.cost < 1.02 * named.cost
    alone = refit_leaders(problem, beside, placed, finished=1, twins=0)
    assert alone[0].fit.cost > found[0].fit.cost


@pytest.mark.long
def test_laws_that_stay_behind_the_right_name_are_not_fitted_to_the_end(hardening, monkeypatch):
    problem, base, _, structure = hardening
    named = Candidate(fit(problem, base.model._replace(effects=(CUBIC,))), problem.n_seen)
    spent = iterations_spent(monkeypatch)
    settings = Settings((), 0.005, 2, 4, None, 0, None, lambda stage: None)

    def asked(best):
        spent.clear()
        law = best_unnamed(problem, base, best, structure, settings, [])
        return law, sum(spent)

    quick, work = asked(named)
    monkeypatch.setattr(unnamed, "_is_enough", lambda *given: False)
    thorough, whole = asked(named)
    assert work < 0.9 * whole
    # the name is as far ahead, and the law that comes nearest is the same
    assert quick.effects[-1].place == thorough.effects[-1].place
    assert quick.criterion == pytest.approx(thorough.criterion, abs=1.0)


def test_laws_need_not_come_near_what_is_no_measure_of_them(hardening):
    problem, base, _, _ = hardening

    def is_enough(model, problem=problem):
        return unnamed._is_enough(problem, Candidate(base._replace(model=model), problem.n_seen))

    named = base.model._replace(effects=(CUBIC,))
    offset = PlacedEffect(CATALOGUE["sensor_bias"], Port("output", 0), theta=(0.1,))
    assert is_enough(named)
    assert not is_enough(base.model)
    assert not is_enough(named._replace(effects=(offset,)))
    assert not is_enough(named._replace(effects=(replace(CUBIC, odd=True),)))
    assert not is_enough(named._replace(p=named.p * (1.0, 1.0, 100.0)))
    coloured = Noise((np.array([0.9]),), np.array([NOISE]))
    assert not is_enough(named, problem.with_noise(coloured))

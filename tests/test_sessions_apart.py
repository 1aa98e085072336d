"""Effects that act in some sessions of a record only: a load of one day, a sensor that was mounted anew."""

from dataclasses import replace

import numpy as np
import pytest
from small_machines import make_oscillator

from narx_sklearn import DiscrepancyRegressor
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.locate import tangent
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port, Span, for_other_records
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.in_sessions import MOST_SPANS, sessions_of, to_sessions
from narx_sklearn.physics.effects import CATALOGUE

DT = 0.02
N = 1000


def make(gain=1.0, damping=0.8, stiffness=12.0):
    return make_oscillator(gain=gain, damping=damping, stiffness=stiffness)


LOAD = PlacedEffect(CATALOGUE["constant_load"], Port("state", 1), (0.0, 1.0), theta=(0.8,))
BIAS = PlacedEffect(CATALOGUE["sensor_bias"], Port("output", 0), theta=(0.05,))


def commands(n_sessions, seed=0):
    u = np.repeat(np.random.default_rng(seed).normal(0, 3, n_sessions * N // 10), 10)[:, None]
    return u, np.repeat(range(n_sessions), N)


def in_sessions(effect, begins, ends):
    """Return an effect that acts from a session on and until another begins."""
    return effect.acting(Span(begins * N * DT, ends * N * DT, along_record=True))


@pytest.mark.parametrize("effect", [LOAD, BIAS])
def test_it_acts_in_the_sessions_that_its_time_covers(effect):
    u, sessions = commands(3)
    plain, always, acting = (
        make().with_effects(effects).simulate(u, sessions=sessions)
        for effects in ([], [effect], [in_sessions(effect, 1, 2)])
    )
    second = sessions == 1
    np.testing.assert_array_equal(acting[second], always[second])
    np.testing.assert_array_equal(acting[~second], plain[~second])


@pytest.mark.parametrize("code", ["cubic_stiffness", "quadratic_drag"])
def test_deviations_travel_as_they_do_where_it_acts(code):
    argument = (1.0, 0.0) if code == "cubic_stiffness" else (0.0, 1.0)
    effect = PlacedEffect(CATALOGUE[code], Port("state", 1), argument, theta=(2.0,))
    u, sessions = commands(3)
    windows = Windows.whole([slice(k * N, (k + 1) * N) for k in range(3)])

    def slopes(effects):
        simulator = make().with_effects(effects)
        return tangent(simulator, simulator.run(u, windows, np.zeros((3, 2))), u, windows).A

    without, always, acting = slopes([]), slopes([effect]), slopes([in_sessions(effect, 1, 2)])
    second = sessions == 1
    np.testing.assert_allclose(acting[second], always[second], atol=1e-9)
    np.testing.assert_allclose(acting[~second], without[~second], atol=1e-9)
    assert np.abs(always - without).max() > 1e-3


def test_it_does_not_recur_in_other_records():
    assert for_other_records([LOAD, in_sessions(LOAD, 1, 2)]) == (LOAD,)


def problem_of(n_sessions, effects=()):
    u, sessions = commands(n_sessions)
    y = make().with_effects(effects).simulate(u, sessions=sessions)
    pieces = [(slice(k * N, k * N + 800), k * N) for k in range(n_sessions)]  # the end of each is held out
    return Problem(make(), u, y, cut(pieces, 400, 8), Noise.white(np.ones(1)))


def tried(problem):
    start = Model(problem.simulator.nominal, (), np.zeros((problem.windows.count, 2)))
    return sessions_of(problem, problem.y - problem.run(fit(problem, start, iterations=1).model).y)


def test_sessions_are_tried_one_by_one_and_what_is_after_each():
    edge, other = N * DT, 2 * N * DT
    assert tried(problem_of(3)) == [
        Span(-np.inf, edge, True),
        Span(edge, other, True),
        Span(other, np.inf, True),
        Span(edge, np.inf, True),
    ]
    assert tried(problem_of(2)) == [Span(-np.inf, edge, True), Span(edge, np.inf, True)]
    assert tried(problem_of(1)) == []


@pytest.mark.parametrize("effect", [LOAD, BIAS])
@pytest.mark.parametrize(("begins", "ends"), [(0, 1), (6, 7), (11, 12), (4, np.inf), (9, np.inf)])
def test_of_many_those_are_tried_that_differ_from_the_rest(effect, begins, ends):
    problem = problem_of(12, [in_sessions(effect, begins, ends)])
    noise = np.random.default_rng(0).normal(0, 0.01, problem.y.shape)
    wanted = Span(begins * N * DT if begins else -np.inf, ends * N * DT if ends < 12 else np.inf, True)
    found = tried(replace(problem, y=problem.y + noise))
    assert wanted in found
    assert len(found) <= MOST_SPANS


def test_ends_near_those_of_a_session_are_its_own():
    problem, edge, other = problem_of(3), N * DT, 2 * N * DT
    assert to_sessions(Span(edge - 3.0, other - 1.0, True), problem) == Span(edge, other, True)
    assert to_sessions(Span(0.1, other + 0.1, True), problem) == Span(-np.inf, other, True)
    amid = Span(edge + 4.0, other - 8.0, True)
    assert to_sessions(amid, problem) == amid
    alike = Span(0.1, 9.0)
    assert to_sessions(alike, problem) == alike


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "begins", "n_sessions", "words"),
    [
        (LOAD, 1, 3, "in session 2 of 3"),
        (BIAS, 2, 3, "in session 3 of 3"),
        (LOAD, 8, 12, "in session 9 of 12"),
    ],
)
def test_a_diagnosis_tells_the_session(effect, begins, n_sessions, words):
    u, sessions = commands(n_sessions, seed=1)
    machine = make(1.1, 0.7, 11.0).with_effects([in_sessions(effect, begins, begins + 1)])
    y = machine.simulate(u, sessions=sessions)
    y += 0.01 * np.random.default_rng(2).normal(size=y.shape)
    names = ["constant_load", "sensor_bias", "coulomb_friction", "additive_drift", "creep"]
    dx = DiscrepancyRegressor(make(), effects=names, random_state=0).fit(u, y, sessions=sessions)
    (finding,) = dx.findings_
    assert dx.verdict_ in ("explained", "ambiguous")
    assert (finding.effect, finding.in_sessions) == (effect.effect.code, words)
    assert f", {words}." in dx.report_
    assert next(iter(finding.parameters.values())) == pytest.approx(effect.theta[0], rel=0.1)
    assert dx.scores_.loc["augmented", "nrmse"] == pytest.approx(0.01 / y.std(), rel=0.05)  # noise alone
    assert dx.scores_.loc["refitted", "nrmse"] > 0.02 / y.std()
    assert not dx.simulator_.effects  # nobody knows in which sessions of another record

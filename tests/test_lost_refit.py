"""Refits that lose their way among many valleys: what they leave is nothing that is missing."""

from dataclasses import replace

import numpy as np
import pytest
from small_machines import LOAD, axis_problem, friction

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.fitting.start import fit_initial_states
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.stages import beginning, coloured_search
from narx_sklearn.discrepancy.stages.beginning import begin
from narx_sklearn.physics.effects import CATALOGUE

N, N_SESSIONS = 480, 3
SETTINGS = Settings((), 0.005, 2, 4, None, 0, None, lambda stage: None)
NEXT_TO_NOTHING = 1e-9  # 1/s^2, of a spring that is not there
TRUE = {"k0": 0.0, "damping": 0.8, "k1": 12.3, "d1": 0.95, "k2": 12.5, "d2": 1.16, "gain": 8.0}


def chain(x, u, p):
    """Three bodies in a row; the first is driven, the last is seen."""
    first = p[2] * (x[2] - x[0]) + p[3] * (x[3] - x[1])
    second = p[4] * (x[4] - x[2]) + p[5] * (x[5] - x[3])
    return x[1], first - p[0] * x[0] - p[1] * x[1] + p[6] * u[0], x[3], second - first, x[5], -second


def make_chain(parameters):
    states = [name for i in range(3) for name in (f"q{i} [rad]", f"v{i} [rad/s]")]
    return ODESimulator(
        chain, dt=0.02, parameters=parameters, states=states, inputs=["torque [V]"], output=(4,)
    )


@pytest.fixture(scope="module")
def record():
    """Torque and angle of three sessions, and the simulation with parameters up to 15 % off."""
    rng = np.random.default_rng(1)
    u = [np.repeat(rng.normal(size=N // 20), 20)[:, None] for _ in range(N_SESSIONS)]
    y = np.concatenate([make_chain(TRUE).simulate(one) for one in u]).reshape(-1, 1)
    y += 0.003 * y.std() * rng.normal(size=y.shape)
    wrong = {name: value * rng.uniform(0.85, 1.15) for name, value in TRUE.items()}
    wrong["k0"] = NEXT_TO_NOTHING
    return make_chain(wrong), np.concatenate(u), y


def without_a_way_back(monkeypatch):
    monkeypatch.setattr(beginning, "_no_worse_than_given", lambda _, refitted: refitted)


def begun(record):
    simulator, u, y = record
    pieces = [(slice(k * N, (k + 1) * N), k * N) for k in range(N_SESSIONS)]
    return begin(simulator, u, y, pieces, SETTINGS)


def left_by_nominal(at):
    return fit_initial_states(at.problem, at.refitted.model.x0).cost


def test_a_refit_leaves_no_more_than_the_parameters_that_were_given(record, monkeypatch):
    found = begun(record)
    gain = list(TRUE).index("gain")
    assert found.refitted.cost < 0.1 * left_by_nominal(found)
    assert found.refitted.model.p[gain] == pytest.approx(TRUE["gain"], rel=0.01)
    without_a_way_back(monkeypatch)
    lost = begun(record)
    assert lost.refitted.cost > left_by_nominal(lost)


def test_a_refit_that_leaves_less_stays_as_it_is(record):
    found = begun(record)
    assert beginning._no_worse_than_given(found.problem, found.refitted) is found.refitted


def test_an_explanation_that_but_led_to_a_better_valley_is_told_from_one_that_explains(record, monkeypatch):
    without_a_way_back(monkeypatch)
    problem, lost = begun(record)[:2]
    nominal = lost.model._replace(p=problem.simulator.nominal, effects=(LOAD,))
    led = coloured_search._led_farther(problem, lost, Candidate(fit(problem, nominal), problem.n_seen))
    assert led.cost < 0.1 * lost.cost
    problem, start = axis_problem([friction(0.3)])
    refitted = fit(problem, start)
    rubs = Candidate(fit(problem, refitted.model._replace(effects=(friction(0.1),))), problem.n_seen)
    assert rubs.fit.cost < 0.5 * refitted.cost
    assert coloured_search._led_farther(problem, refitted, rubs) is None


@pytest.mark.long
def test_where_an_effect_led_the_parameters_to_a_better_valley_nothing_is_missing(record, monkeypatch):
    """A constant load of no size, fitted beside nominal parameters, left next to nothing of a lost refit."""
    without_a_way_back(monkeypatch)
    simulator, u, y = record
    dx = DiscrepancyRegressor(simulator, effects=["constant_load", "extra_mode"], random_state=0)
    dx.fit(u, y, sessions=np.repeat(range(N_SESSIONS), N))
    assert (dx.verdict_, dx.findings_) == ("refit", [])
    assert dx.parameters_["refitted"]["gain"] == pytest.approx(TRUE["gain"], rel=0.01)


def test_explanations_lead_a_refit_to_other_valleys_a_few_times_only(monkeypatch):
    """Noise is estimated anew in each, by which two of them might be the better one in turn."""
    problem, start = axis_problem([friction(0.3)], n=800)
    refitted = fit(problem, start)
    structure = find_structure(problem.simulator, problem.run(refitted.model).x, problem.u)
    asked = []

    def always(problem, found, best):
        asked.append(best)
        return found

    monkeypatch.setattr(coloured_search, "_led_farther", always)
    settings = replace(SETTINGS, effects=(CATALOGUE["coulomb_friction"],))
    found = coloured_search.coloured_search(problem, refitted, structure, settings)
    assert len(asked) == coloured_search.VALLEYS
    assert found.pool[0].effects[0].effect.code == "coulomb_friction"

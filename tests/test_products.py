"""Forces that go as a product of two states: tried in every pair, told where none of the names does it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.findings import parameters_it_has
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.unnamed.kinds import PRODUCT, WITH_SQUARE
from narx_sklearn.discrepancy.search.unnamed.products import product_hypotheses
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages import diagnosis
from narx_sklearn.discrepancy.stages.coloured_search import Searched
from narx_sklearn.discrepancy.stages.laws import best_laws
from narx_sklearn.discrepancy.stages.stretches import Stretches
from narx_sklearn.discrepancy.stages.told_law import left_by_law

DT = 0.5
CARRIED = 0.4  # of the heat, 1/s per m/s of flow
SIZES = st.floats(-10.0, 10.0)


def loop(x, u, p):
    """Flow that a pump sets, and a temperature that a heater does."""
    return p[0] * (u[0] - x[0]), p[1] * u[1] - p[2] * x[1]


def simulator(gain=1.0):
    return ODESimulator(
        loop,
        dt=DT,
        parameters={"pump [1/s]": 0.5 * gain, "heater [K/s/kW]": 0.3, "loss [1/s]": 0.05 / gain},
        states=["flow [m/s]", "temperature [K]"],
        inputs=["pump [m/s]", "heater [kW]"],
        output=[0, 1],
    )


def driven(rng, n=1500):
    return np.column_stack([np.repeat(rng.uniform(low, high, n // 25), 25) for low, high in [(0, 1), (2, 9)]])


def recorded(rng, carried=0.0, boosted=0.0, finer=20):
    """Step the machine by Euler's method, far finer than it is measured."""
    u = driven(rng)
    x, y = np.array([0.5, 40.0]), np.empty((len(u), 2))
    for k, (pump, heater) in enumerate(u):
        y[k] = x
        for _ in range(finer):
            heat = 0.3 * heater - 0.05 * x[1] - carried * x[0] * x[1] - boosted * heater * x[1]
            x = x + DT / finer * np.array([0.5 * (pump - x[0]), heat])
    return u, y + rng.normal(size=y.shape) * 0.01 * y.std(axis=0)


def hypotheses(simulated, u):
    run = simulated.simulate(u)
    return product_hypotheses(simulated, find_structure(simulated, run, u), run)


def test_every_pair_is_tried_in_every_equation_from_the_means_of_the_run():
    simulated, u = simulator(), driven(np.random.default_rng(0))
    x = simulated.simulate(u)
    found = hypotheses(simulated, u)
    assert [(str(h.placed.port), h.placed.effect.code) for h in found] == [
        (port, code) for port in ("state:0", "state:1") for code in (PRODUCT, WITH_SQUARE, WITH_SQUARE)
    ]
    for product, square, other in (found[:3], found[3:]):
        assert (product.placed.weights, product.placed.second) == ((1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        assert (square.placed.weights, square.placed.second) == ((1.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        assert (other.placed.weights, other.placed.second) == ((0.0, 1.0), (0.0, 0.0, 1.0, 0.0))
        np.testing.assert_allclose(product.starts, [[1.0, *x.mean(axis=0)]])
        np.testing.assert_allclose(other.starts, [[1.0, *x.mean(axis=0)[::-1]]])


@given(x=SIZES, w=SIZES, k=SIZES, r=SIZES, c=SIZES)
def test_the_forces_are_the_products(x, w, k, r, c):
    product, square, _ = hypotheses(simulator(), driven(np.random.default_rng(0), 100))[:3]

    def force(hypothesis):
        theta, nothing = np.array([k, r, c]), np.zeros(1)
        return hypothesis.placed.effect.force(x, 0.0, 0.0, w, 0.0, 0.01, nothing, theta, nothing)

    assert force(product) == pytest.approx(k * (x - r) * (w - c))
    assert force(square) == pytest.approx(k * (x - r) * (w - c) ** 2)


def test_what_is_counted_from_zero_has_no_other_number_to_be_counted_from():
    product = hypotheses(simulator(), driven(np.random.default_rng(0)))[0].placed
    assert parameters_it_has(product).tolist() == [True, True, True]
    assert parameters_it_has(product.with_zeros([1])).tolist() == [True, False, True]


def test_what_does_not_move_is_in_no_pair():
    u = driven(np.random.default_rng(0))
    u[:, 0] = 0.0
    assert hypotheses(simulator(), u) == []


@pytest.fixture(scope="module")
def diagnosed():
    u, y = recorded(np.random.default_rng(1), carried=CARRIED)
    return DiscrepancyRegressor(simulator(1.15), random_state=0).fit(u, y)


@pytest.mark.long
def test_what_carries_something_else_is_told_as_a_product(diagnosed):
    (finding,) = diagnosed.findings_
    assert (diagnosed.verdict_, finding.effect, finding.port) == ("unknown", "unknown", "state:1")
    assert "k (x - r) (w - c), x = flow [m/s], w = temperature [K]" in diagnosed.report_
    assert finding.parameters["k"] == pytest.approx(-CARRIED, rel=0.1)


@pytest.mark.long
def test_its_model_holds_on_what_was_held_out(diagnosed):
    left = diagnosed.scores_["nrmse"]
    assert left["augmented"] < 0.5 * left["refitted"]


@pytest.mark.long
def test_an_input_that_acts_by_the_state_keeps_its_name():
    u, y = recorded(np.random.default_rng(2), boosted=0.002)
    found = DiscrepancyRegressor(simulator(1.15), random_state=0).fit(u, y)
    assert found.verdict_ in ("explained", "ambiguous")
    assert found.findings_[0].effect == "bilinear_input"


def voice_coil(x, u, p):
    """A coil whose force factor, which the voltage it induces has too, falls off from the middle."""
    factor = p[1] * (1.0 - p[5] * x[1] ** 2)
    rate = 1000.0 * (u[0] - p[0] * x[0] - 0.001 * factor * x[2]) / p[2]
    return rate, x[2], 5e4 * (factor * x[0] - p[3] * x[1] - 0.001 * p[4] * x[2])


def make_coil(rhs, **more):
    return ODESimulator(
        rhs,
        dt=2e-4,
        parameters={"ohm": 4.0, "factor": 6.0, "mH": 1.5, "N/mm": 2.0, "N s/m": 1.5, **more},
        states=["current [A]", "cone [mm]", "speed [mm/s]"],
        inputs=["voltage [V]"],
        outputs=["current [A]", "cone [mm]"],
    )


def even_coil(x, u, p):
    """One whose force factor is the same everywhere."""
    rate = 1000.0 * (u[0] - p[0] * x[0] - 0.001 * p[1] * x[2]) / p[2]
    return rate, x[2], 5e4 * (p[1] * x[0] - p[3] * x[1] - 0.001 * p[4] * x[2])


SETTINGS = Settings((), 0.005, 2, 4, None, 0, None, lambda stage: None)


def recorded_coil(fall):
    """Return the problem of a coil, its refit and structure."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.normal(0, 6, 250), 10)[:, None]
    y = make_coil(voice_coil, fall=fall).simulate(u)
    sigma = 0.02 * y.std(axis=0)
    y = y + sigma * rng.normal(size=y.shape)
    problem = Problem(make_coil(even_coil), u, y, cut([(slice(0, 2500), 0)], 500, 12), Noise.white(sigma))
    refitted = fit(problem, Model(problem.simulator.nominal, (), np.zeros((5, 3))))
    return problem, refitted, find_structure(problem.simulator, problem.run(refitted.model).x, u)


def test_a_law_that_no_test_has_asked_for_pays_for_all_that_were_tried():
    problem, refitted, structure = recorded_coil(fall=2e-4)
    laws = best_laws(problem, refitted, refitted, structure)
    law = next(law for law in laws if law.effects[-1].effect.code in (PRODUCT, WITH_SQUARE))
    nothing = Candidate(refitted, problem.n_seen)
    gained = refitted.cost - law.fit.cost
    assert 6.0 < gained < 20.0
    asked = left_by_law(problem, nothing, law, structure, SETTINGS)
    assert asked.is_little
    by_itself = left_by_law(problem, nothing, law, structure, SETTINGS, 200, SETTINGS.alpha)
    assert not by_itself.is_little


@pytest.mark.long
@pytest.mark.parametrize("alone", [True, False])
def test_a_law_that_is_most_of_what_is_missing_is_told_with_what_it_leaves(monkeypatch, alone):
    """The fall of the force is most of it; the voltage that falls too is the second law, if any is sought."""
    problem, refitted, structure = recorded_coil(fall=0.002)
    monkeypatch.setattr(diagnosis, "search_in_spans", lambda *_: None)
    settings = replace(SETTINGS, max_effects=1) if alone else SETTINGS
    none = Stretches(pd.DataFrame(columns=["start", "stop", "share"]), refitted.model.p, problem.y)
    searched = Searched(problem, refitted, [])
    _, told, p_value = diagnosis._unless_noise(None, searched, none, structure, settings)
    assert p_value < 0.0025
    force = told.best.effects[0]
    assert (force.effect.code, force.port, force.argument_name) == (WITH_SQUARE, Port("state", 2), "current")
    assert force.theta[0] == pytest.approx(-5e4 * 6.0 * 0.002, rel=0.2 if alone else 0.05)
    assert bool(told.against_noise) == alone
    assert len(told.best.effects) == len(told.alternatives) == (1 if alone else 2)
    if not alone:
        voltage = told.best.effects[1]
        code, port, name = voltage.effect.code, voltage.port, voltage.argument_name
        assert (code, port, name) == (WITH_SQUARE, Port("state", 0), "speed")
        assert voltage.theta[0] == pytest.approx(6.0 * 0.002 / 1.5, rel=0.2)
        assert told.best.fit.cost == pytest.approx(problem.n_seen, rel=0.05)

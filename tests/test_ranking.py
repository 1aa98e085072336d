"""Which effects, alone and in pairs, take most off the cost to first order."""

from itertools import combinations, product

import numpy as np
import pytest
from scipy.signal import lfilter
from small_machines import make_axis

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.bank import Bank, make_bank
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.detect import NONE_SILENT
from narx_sklearn.discrepancy.search.explain import refit_leaders, refit_pairs
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis, enumerate_hypotheses
from narx_sklearn.discrepancy.search.ranking import APART, gains, leaders, pairs, with_nearest
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.physics.effects import CATALOGUE

FORCE = Port("state", 1)
LIMIT = 4.5  # V, that one sample in a hundred is beyond


def hypothesis(code, starts, *, port=FORCE, weights=(0.0, 1.0), asked=True, odd=False):
    starts = np.atleast_2d(np.array(starts, dtype=float))
    placed = PlacedEffect(CATALOGUE[code], port, weights, theta=tuple(starts[0]), odd=odd)
    return Hypothesis.untuned(placed, starts)._replace(asked=asked)


def bank_of(hypotheses, columns, residual):
    """Return a bank of given columns, (n_samples, n_columns), one for each start."""
    owner = np.repeat(np.arange(len(hypotheses)), [len(h.starts) for h in hypotheses])
    start = np.concatenate([np.arange(len(h.starts)) for h in hypotheses])
    useful = np.ones(owner.size, dtype=bool)
    gram, plain = columns.T @ columns, columns.T @ residual
    return Bank(hypotheses, owner, start, columns[None], residual[None], gram, plain, useful)


def random_bank(seed=0):
    rng = np.random.default_rng(seed)
    hypotheses = [
        hypothesis("coulomb_friction", [[1.0]]),
        hypothesis("cubic_stiffness", [[2.0]], weights=(1.0, 0.0)),
        hypothesis("dead_zone", [[0.1, 0.0, 0.01], [0.3, 0.0, 0.01]], port=Port("input", 0), weights=()),
        hypothesis("constant_load", [[-0.5]], weights=()),
        hypothesis("lag", [[T, 0.0, 0.0] for T in (0.1, 1.0, 2.0)], port=Port("input", 0), weights=()),
    ]
    columns = rng.normal(size=(30, 8)) + 2.0 * rng.normal(size=(30, 1))
    return bank_of(hypotheses, columns, columns @ rng.normal(size=8) + rng.normal(size=30))


def is_physical(bank, column, strength):
    start = bank.hypotheses[bank.owner[column]].starts[bank.start[column]]
    placed = bank.placed(column)
    amplitude = placed.effect.amplitude
    if amplitude is None:
        return strength > 0
    lower, upper = placed.bounds[amplitude]
    return lower <= strength * start[amplitude] <= upper


@pytest.mark.parametrize("seed", range(6))
def test_pairs_are_those_of_least_squares_on_two_columns(seed):
    """An independent slow twin: every two columns of every two hypotheses fitted by themselves."""
    bank = random_bank(seed)
    A, r = bank.columns[0], bank.residual[0]
    expected = {}
    for one, other in combinations(range(len(bank.hypotheses)), 2):
        for columns in product(*(np.flatnonzero(bank.owner == h) for h in (one, other))):
            strengths, left, _, singular = np.linalg.lstsq(A[:, columns], r, rcond=None)
            assert np.prod(singular**2) > APART * np.prod(np.diag(bank.gram)[list(columns)])
            if all(is_physical(bank, *pair) for pair in zip(columns, strengths, strict=True)):
                gain = r @ r - left[0]
                if gain > expected.get((one, other), (0.0,))[0]:
                    expected[one, other] = gain, columns, strengths
    found = {tuple(bank.owner[list(pair.columns)]): pair for pair in pairs(bank)}
    assert len(found) >= 2
    assert found.keys() == expected.keys()
    for key, (gain, columns, strengths) in expected.items():
        assert found[key].columns == columns
        np.testing.assert_allclose(found[key].strengths, strengths, rtol=1e-9)
        assert found[key].gain == pytest.approx(gain, rel=1e-9)
    ordered = [pair.gain for pair in pairs(bank)]
    assert ordered == sorted(ordered, reverse=True)


def test_two_that_hide_each_other_show_together():
    rng = np.random.default_rng(1)
    one, noise = rng.normal(size=(2, 200))
    other = -one + 0.3 * noise
    bystander = noise + 2.0 * rng.normal(size=200)
    hypotheses = [
        hypothesis(code, [[1.0]]) for code in ("coulomb_friction", "quadratic_drag", "constant_load")
    ]
    bank = bank_of(hypotheses, np.column_stack([one, other, bystander]), one + other)
    alone = gains(bank).gain
    assert alone[2] > max(alone[:2])
    best = pairs(bank)[0]
    assert [e.effect.code for e in best.effects(bank)] == ["coulomb_friction", "quadratic_drag"]
    assert best.gain == pytest.approx(np.sum(bank.residual**2))
    np.testing.assert_allclose(best.strengths, 1.0)


@pytest.mark.parametrize("change", [{"asked": False}, {"odd": True}])
def test_nobody_is_paired_with_what_is_not_asked_for_or_out_of_place(change):
    bank = random_bank()
    kept = len(pairs(bank))
    assert kept > 2
    hypotheses = list(bank.hypotheses)
    hypotheses[0] = hypothesis("coulomb_friction", [[1.0]], **change)
    without = pairs(bank_of(hypotheses, bank.columns[0], bank.residual[0]))
    assert 0 < len(without) < kept
    assert not any(0 in bank.owner[list(pair.columns)] for pair in without)


def test_one_effect_under_two_readings_is_no_pair():
    one, other = hypothesis("coulomb_friction", [[1.0]]), hypothesis("coulomb_friction", [[2.0]])
    columns = np.random.default_rng(0).normal(size=(20, 2))
    assert pairs(bank_of([one, other], columns, columns.sum(axis=1))) == []


@pytest.fixture(scope="module")
def searched():
    """Return a machine with a dead zone and a saturation in its drive, and the search for either alone."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.normal(0.0, 3.0, 101), 15)[:1500, None]
    drive = Port("input", 0)
    both = [
        PlacedEffect(CATALOGUE["dead_zone"], drive, theta=(0.8, 0.0, 0.1, 0.0)),
        PlacedEffect(CATALOGUE["input_saturation"], drive, theta=(-4.0, 4.0, 0.1)),
    ]
    y = make_axis(1.1, 0.4).with_effects(both).simulate(u) + 0.002 * rng.normal(size=(1500, 1))
    windows = cut([(slice(0, 1500), 0)], 375, 12)
    problem = Problem(make_axis(), u, y, windows, Noise.white(np.array([0.002])))
    base = fit(problem, Model(problem.simulator.nominal, (), np.zeros((windows.count, 2))))
    run = problem.run(base.model)
    structure = find_structure(problem.simulator, run.x, u)
    hypotheses = enumerate_hypotheses(list(CATALOGUE.values()), problem, run, structure)
    bank = make_bank(problem, base, hypotheses)
    singles = refit_leaders(problem, base, leaders(bank, 12, NONE_SILENT, 1.0))
    return problem, base, bank, singles


def test_an_effect_in_another_valley_is_tried_where_the_best_is():
    """A limit of the drive, fitted from a tenth of the stiffness, stays there; friction knows better."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.normal(0.0, 3.0, 60), 25)[:, None]
    friction = PlacedEffect(CATALOGUE["coulomb_friction"], FORCE, (0.0, 1.0), theta=(0.6,))
    limit = PlacedEffect(CATALOGUE["input_saturation"], Port("input", 0), theta=(-4.0, 4.0, 0.1))
    y = make_spring().with_effects([friction]).simulate(u) + 0.002 * rng.normal(size=(1500, 1))
    windows = cut([(slice(0, 1500), 0)], 1500, 1)
    problem = Problem(make_spring(), u, y, windows, Noise.white(np.array([0.002])))
    base = fit(problem, Model(problem.simulator.nominal, (), np.zeros((1, 2))))
    afar = base.model._replace(p=np.array([0.1, 3.0]), effects=(limit,))
    near = base.model._replace(effects=(friction,))
    known = [Candidate(fit(problem, model), problem.n_seen) for model in (near, afar)]
    assert known[1].fit.cost > 100 * base.cost
    found = refit_leaders(problem, base, [friction, limit], known=known)
    assert [c.effects[0].effect.code for c in found] == ["coulomb_friction", "input_saturation"]
    assert found[1].fit.cost < 1.1 * base.cost
    np.testing.assert_allclose([c.fit.model.p[1] for c in found], 40.0, rtol=0.01)


@pytest.fixture(scope="module")
def limited():
    """Return a machine whose drive has a limit that it meets at few peaks, and what may be missing."""
    rng = np.random.default_rng(1)
    u = lfilter([1.0], [1.0, -0.8], rng.normal(size=(1500, 1)), axis=0)
    limit = PlacedEffect(CATALOGUE["input_saturation"], Port("input", 0), theta=(-LIMIT, LIMIT, 0.05))
    assert 0 < np.mean(np.abs(u) > LIMIT) < 0.02
    y = make_axis(1.1, 0.4).with_effects([limit]).simulate(u) + 1e-5 * rng.normal(size=(1500, 1))
    windows = cut([(slice(0, 1500), 0)], 375, 12)
    problem = Problem(make_axis(), u, y, windows, Noise.white(np.array([1e-5])))
    base = fit(problem, Model(problem.simulator.nominal, (), np.zeros((windows.count, 2))))
    run = problem.run(base.model)
    structure = find_structure(problem.simulator, run.x, u)
    asked = [CATALOGUE[code] for code in ("input_saturation", "rate_limit", "coulomb_friction")]
    return problem, base, make_bank(problem, base, enumerate_hypotheses(asked, problem, run, structure))


class TestNearest:
    """A limit that few peaks meet: no tangent along a run without it shows where it lies."""

    def test_the_start_whose_run_comes_nearest_leads_to_the_limit(self, limited):
        problem, base, bank = limited
        told = leaders(bank, 3, NONE_SILENT, 1.0)
        costs = []
        for placed in (told, with_nearest(problem, base, bank, told)):
            found = refit_leaders(problem, base, placed, twins=0)
            of_limit = next(c for c in found if c.effects[0].effect.code == "input_saturation")
            costs.append(of_limit.fit.cost)
        assert costs[1] < 1.2 * problem.n_seen < 1e-3 * costs[0]
        np.testing.assert_allclose(of_limit.effects[0].theta[:2], [-LIMIT, LIMIT], rtol=1e-3)

    def test_one_of_each_form_is_added_and_none_of_what_has_a_strength(self, limited):
        problem, base, bank = limited
        told = leaders(bank, 3, NONE_SILENT, 1.0)
        more = with_nearest(problem, base, bank, told)
        added = [e for e in more if e not in told]
        assert more[: len(told)] == told
        assert {e.effect.code for e in added} <= {"input_saturation", "rate_limit"}
        limits = [e for e in more if e.effect.code == "rate_limit"]
        assert {e.theta[2] for e in limits} == {0.0, 1.0}
        friction = [e for e in told if e.effect.code == "coulomb_friction"]
        assert with_nearest(problem, base, bank, friction) == friction


def spring(x, u, p):
    return x[1], u[0] - p[0] * x[1] - p[1] * x[0]


def make_spring():
    return ODESimulator(
        spring,
        dt=0.02,
        parameters={"damping [1/s]": 0.1, "stiffness [1/s^2]": 40.0},
        states=["position [m]", "velocity [m/s]"],
        inputs=["drive [m/s^2]"],
        outputs=["position [m]"],
    )


class TestTwoAtOnce:
    """A dead zone and a saturation of one drive: the gain makes up for most of either, if both are there."""

    def test_they_are_found_though_neither_stands_out_alone(self, searched):
        problem, base, bank, singles = searched
        assert singles[0].fit.cost > 0.1 * base.cost
        best, second = refit_pairs(problem, base, bank, singles, 12)[:2]
        assert {e.effect.code for e in best.effects} == {"dead_zone", "input_saturation"}
        assert best.fit.cost < 1.1 * problem.n_seen < 0.1 * second.fit.cost
        dead, limit = sorted(best.effects, key=lambda e: e.effect.code)
        assert dead.theta[0] == pytest.approx(0.8, rel=0.05)
        np.testing.assert_allclose(limit.theta[:2], [-4.0, 4.0], rtol=0.02)

    def test_no_pair_is_looked_into_where_one_effect_leaves_as_little(self, searched):
        problem, base, bank, singles = searched
        clear = Candidate(singles[0].fit._replace(cost=problem.n_seen), problem.n_seen)
        assert refit_pairs(problem, base, bank, [clear, *singles], 12) == []

    def test_a_pair_that_is_known_goes_on_from_there(self, searched):
        problem, base, bank, singles = searched
        known = refit_pairs(problem, base, bank, singles, 12)[0]
        clear = Candidate(singles[0].fit._replace(cost=problem.n_seen), problem.n_seen)
        again = refit_pairs(problem, base, bank, [clear], 0, known=[known])
        assert [c.places for c in again] == [known.places]
        assert again[0].fit.cost == pytest.approx(known.fit.cost, rel=1e-3)

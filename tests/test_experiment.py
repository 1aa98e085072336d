"""The experiment that separates rivals: where it begins, and how far it goes."""

from types import SimpleNamespace

import numpy as np
import pytest

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.designs import settled
from narx_sklearn.discrepancy.experiment import chance, design_experiment, middle_of
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit, fit_states
from narx_sklearn.discrepancy.nested import ALLOWED, farthest_allowed
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.rivals import find_rivals
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.inference import covariance
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.physics.effects import CATALOGUE


def tank(power, **idle):
    def level(x, u, p):
        return (p[0] * u[0] - p[1] * max(x[0], 0.0) ** power,)

    return ODESimulator(
        level,
        dt=0.5,
        parameters={"gain": 0.2, "outlet": 0.4, **idle},
        states=["level [m]"],
        inputs=["pump [V]"],
    )


def cart():
    return ODESimulator(
        lambda x, u, p: (x[1], p[0] * u[0] - p[1] * x[1]),
        dt=0.02,
        parameters={"gain": 2.0, "damping": 1.0},
        states=["position", "velocity"],
        inputs=["drive"],
    )


@pytest.mark.filterwarnings("ignore:.*compile")
@pytest.mark.parametrize("power", [0.5, 1.0])
def test_an_experiment_begins_where_the_simulation_rests(power):
    rest = (0.2 * 4.0 / 0.4) ** (1 / power)
    assert settled(tank(power), np.array([4.0]), 1000) == pytest.approx([rest], rel=1e-3)


def test_what_runs_away_or_does_not_settle_in_time_begins_at_zero():
    assert settled(cart(), np.array([1.0]), 1000).tolist() == [0.0, 0.0]
    assert settled(tank(0.5), np.array([4.0]), 8).tolist() == [0.0]


@pytest.mark.filterwarnings("ignore:.*compile")
def test_designs_are_as_fast_as_the_machine_is_about_the_middle_of_the_input():
    """An outlet by the root of the level is infinitely fast where it is empty, and is nowhere else."""
    noise = Noise.white(np.array([0.01]))
    plan = design_experiment(
        {"root": tank(0.5), "linear": tank(1.0)}, noise=noise, amplitude=1.0, n_samples=1000, offset=4.0
    )
    tops = [float(words.split()[3]) for words in plan.table["design"] if words.startswith("multisine up")]
    corner = 0.4 / (2 * 2.0) / (2 * np.pi)  # k / (2 sqrt(4 m)), about 4 V
    assert max(tops) == pytest.approx(30 * corner, rel=0.01)
    assert np.all(np.abs(plan.u - 4.0) <= 1.0 + 1e-9)
    assert plan.separation > 10


@pytest.mark.filterwarnings("ignore:.*compile")
def test_beyond_doubt_the_input_that_tells_most_of_everything_is_proposed():
    noise = Noise.white(np.array([1e-3]))
    rivals = {"root": tank(0.5), "linear": tank(1.0)}
    plan = design_experiment(rivals, noise=noise, amplitude=3.0, n_samples=1000, offset=4.0)
    certain = plan.table[plan.table["chance"] > 0.995]
    assert len(certain) > 1
    chosen = plan.table.set_index("design").loc[plan.kind]
    assert chosen["information"] == certain["information"].max()
    assert plan.separation == chosen["separation"]


@pytest.mark.filterwarnings("ignore:.*compile")
def test_a_parameter_that_no_input_shows_tells_neither_much_nor_little():
    about = {"noise": Noise.white(np.array([1e-3])), "amplitude": 3.0, "n_samples": 1000, "offset": 4.0}
    about["random_state"] = 0
    without, idle = (
        design_experiment({"root": tank(0.5, **more), "linear": tank(1.0, **more)}, **about).table
        for more in ({}, {"idle": 3.0})
    )
    assert np.isfinite(without["information"]).all()
    assert idle["information"].to_numpy() == pytest.approx(without["information"].to_numpy())


def explained_by(*places):
    """Return a diagnosis of which nothing but its explanations' names and places matters, the best first."""
    sets = ((PlacedEffect(CATALOGUE[code], port),) for code, port in places)
    best, *rivals = (SimpleNamespace(effects=effects) for effects in sets)
    return SimpleNamespace(best=best, alternatives=(tuple(rivals),), steps=())


def test_an_experiment_is_asked_what_acts_before_it_is_asked_where():
    into, out = Port("input", 0), Port("output", 0)
    several = explained_by(("delay", into), ("delay", out), ("lag", into), ("lag", out), ("backlash", into))
    assert list(find_rivals(several)) == ["delay at input:0", "lag at input:0", "backlash at input:0"]
    places = explained_by(("lag", into), ("lag", out))
    assert list(find_rivals(places)) == ["lag at input:0", "lag at output:0"]


def test_the_middle_of_an_input_is_zero_where_it_was_meant_to_be():
    u = np.array([[-1.0, 2.0], [1.1, 8.0], [np.nan, np.nan]])
    assert middle_of(u).tolist() == [0.0, 5.0]
    around_zero = np.tile([-1.0, 1.0], 50)
    around_zero[7] = 4.6  # one peak that goes far
    assert middle_of(around_zero[:, None]).tolist() == [0.0]
    assert middle_of(np.empty((9, 0))).tolist() == []  # a machine that nobody drives


@pytest.mark.parametrize(("separation", "expected"), [(0.0, 0.0), (2.0, 0.5), (4.0, 0.93319), (np.inf, 1.0)])
def test_a_pair_is_told_apart_where_the_criterion_comes_to_differ_by_four(separation, expected):
    """Its difference is normal about d^2 with a deviation of 2 d: at d = 4 it is 1.5 of them above four."""
    assert chance(separation) == pytest.approx(expected, abs=1e-5)


def test_what_forms_may_be_wrong_by_is_not_told_apart():
    assert chance(20.0, wanted=400.0) == pytest.approx(0.5)
    assert chance(20.0, wanted=4000.0) < 1e-9 < chance(20.0)


@pytest.mark.filterwarnings("ignore:.*compile")
def test_a_pair_is_wanted_apart_by_a_share_of_what_the_effects_do():
    """A strong friction and one that rises a little with speed: far apart in noise, not in what they do."""
    friction = PlacedEffect(CATALOGUE["coulomb_friction"], Port("state", 1), (0.0, 1.0), theta=(0.5,))
    steep = PlacedEffect(
        CATALOGUE["stribeck_friction"], Port("state", 1), (0.0, 1.0), theta=(0.5, 1.04, 0.3, 2.0)
    )
    plans = {}
    for noise in (1e-1, 1e-3, 1e-5):
        rivals = {name: cart().with_effects([e]) for name, e in (("plain", friction), ("falling", steep))}
        plans[noise] = design_experiment(
            rivals, noise=Noise.white(np.array([noise])), amplitude=4.0, n_samples=800, random_state=0
        )
    loud, quiet, none = plans.values()
    assert quiet.separation > 50 * loud.separation
    assert chance(quiet.separation) > 0.9
    assert quiet.chance < 0.5
    halves = none.table["design"].str.contains("in the second half")
    assert none.table["separation"][halves].max() > 2 * none.table["separation"][~halves].max()
    assert none.chance > 0.99  # no form is wrong by just what another law does, with hardly any noise about
    table = quiet.table.set_index("design")
    assert not table["expected"].any()
    assert table.loc[quiet.kind, "separation"] > 0.2 * table["separation"].max()


@pytest.mark.filterwarnings("ignore:.*compile")
def test_laws_that_bend_are_told_apart_by_large_motion_of_several_amplitudes():
    """A weight on a swing and a cubic spring."""
    swing = ODESimulator(
        lambda x, u, p: (x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]),
        dt=0.02,
        parameters={"gain": 30.0, "damping": 4.0, "spring": 40.0},
        states=["angle [rad]", "rate [rad/s]"],
        inputs=["motor [A]"],
    )
    rivals = {
        code: swing.with_effects([PlacedEffect(CATALOGUE[code], Port("state", 1), (1.0, 0.0), theta=theta)])
        for code, theta in (("gravity", (2.0, 0.0)), ("cubic_stiffness", (-0.26,)))
    }
    plan = design_experiment(
        rivals,
        noise=Noise.white(np.array([0.01])),
        amplitude=2.4,
        n_samples=1500,
        nested={("gravity", "cubic_stiffness")},
        random_state=0,
    )
    several = plan.table["design"].str.contains("four amplitudes")
    distance = plan.table["separation"]
    assert distance[several].max() > 1.4 * distance[~several].max()
    assert "four amplitudes" in plan.kind


@pytest.fixture(scope="module")
def fitted():
    rng = np.random.default_rng(3)
    u = np.repeat(rng.normal(0.0, 2.0, 40), 25)[:, None]
    at = Port("state", 1), (0.0, 1.0)
    plain = PlacedEffect(CATALOGUE["coulomb_friction"], *at, theta=(0.5,))
    by_direction = PlacedEffect(CATALOGUE["asymmetric_friction"], *at, theta=(0.5, 0.0))
    y = cart().with_effects([plain]).simulate(u) + 0.01 * rng.normal(size=(1000, 1))
    windows = cut([(slice(0, 1000), 0)], 250, 8)
    problem = Problem(cart(), u, y, windows, Noise.white(np.array([0.01])))
    x0 = cart().run(u, windows, np.zeros((windows.count, 2))).x[windows.first]
    fits = [fit(problem, Model(cart().nominal, (effect,), x0)) for effect in (plain, by_direction)]
    return problem, *(Candidate(found, problem.n_seen) for found in fits)


class TestNestedRivals:
    """A friction that may differ by direction, fitted where it does not, is the plain friction itself."""

    @pytest.mark.filterwarnings("ignore:.*compile")
    def test_the_general_one_goes_as_far_as_the_data_allow(self, fitted):
        problem, special, general = fitted
        moved = farthest_allowed(problem, general, special)
        before, after = general.effects[0].theta, moved.effects[0].theta
        error = np.sqrt(covariance(problem, general.fit)[-1, -1])
        assert abs(after[1] - before[1]) == pytest.approx(ALLOWED * error, rel=1e-6)
        cost = fit_states(problem, moved).cost
        assert general.fit.cost < cost <= general.fit.cost + (2 * ALLOWED) ** 2
        ahead = Candidate(special.fit._replace(cost=special.fit.cost + 5.0), special.n_samples)
        assert farthest_allowed(problem, general, ahead) is general.fit.model

    @pytest.mark.filterwarnings("ignore:.*compile")
    def test_only_what_the_special_one_cannot_do_counts(self, fitted):
        problem, special, general = fitted
        models = {"plain": special.fit.model, "by direction": farthest_allowed(problem, general, special)}
        rivals = {
            name: cart().with_parameters(model.p).with_effects(model.effects)
            for name, model in models.items()
        }
        about = {"noise": problem.noise, "amplitude": 4.0, "n_samples": 1500, "random_state": 0}
        both_ways = design_experiment(rivals, **about)
        nested = design_experiment(rivals, **about, nested={("by direction", "plain")}, n_jobs=2)
        assert both_ways.separation < 0.5
        assert nested.separation > ALLOWED
        assert both_ways.chance == chance(both_ways.separation)
        # the truth may lie anywhere between the two
        shares = np.linspace(0.025, 0.975, 20)
        expected = np.mean([chance(share * nested.separation) for share in shares])
        assert nested.chance == pytest.approx(expected)
        assert nested.chance < chance(nested.separation)
        assert nested.pairs == ("plain / by direction",)
        mutual = {("by direction", "plain"), ("plain", "by direction")}
        assert design_experiment(rivals, **about, nested=mutual).separation == both_ways.separation

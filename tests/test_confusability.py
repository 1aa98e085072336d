"""How alike effects look before anything is measured, and the input under which they look least alike."""

import numpy as np
import pandas as pd
import pytest

from narx_sklearn.discrepancy import CallableSimulator, ODESimulator, confusability, design_input
from narx_sklearn.discrepancy.before_measuring import RESOLVED, VISIBLE, _distances
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.tangents import EffectTangents, effect_tangents
from narx_sklearn.physics.effects import CATALOGUE

pytestmark = pytest.mark.filterwarnings("ignore:.*compile")
DT = 0.1
RUBS = "coulomb_friction at state:1 (velocity)"


def tank():
    """Return what only adds up what flows in: its parameters, if any, are none."""
    return ODESimulator(
        lambda x, u, p: (u[0],), dt=DT, parameters={}, states=["volume [m^3]"], inputs=["inflow [m^3/s]"]
    )


def cart(*more):
    return ODESimulator(
        lambda x, u, p: (x[1], p[0] * u[0] - p[1] * x[1]),
        dt=0.02,
        parameters={"gain": 2.0, "damping": 1.0},
        states=["position", "velocity"],
        inputs=["drive [V]", *more],
    )


def drive(n=400, seed=0):
    return np.repeat(np.random.default_rng(seed).normal(size=n // 20), 20)


class TestConfusability:
    def test_a_leak_is_a_ramp_and_an_offset_of_what_integrates_is_where_it_begins(self):
        """A constant outflow d makes d t of the volume; less its mean that is d dt sqrt(n (n^2 - 1) / 12)."""
        n, sigma, u = 100, 0.01, drive(100)
        chosen = [CATALOGUE[code] for code in ("constant_load", "sensor_bias")]
        angles, visible = confusability(tank(), u, effects=chosen, noise=sigma, n_windows=1)
        leak, offset = visible.index
        whole = Windows.whole([slice(0, n)])
        found = effect_tangents(tank(), u[:, None], whole, np.zeros((1, 1)), chosen, np.array([sigma]))
        outflow = abs(found.placed[0].theta[0])
        expected = outflow * DT * np.sqrt(n * (n**2 - 1) / 12) / sigma
        assert visible.loc[leak, "separation"] == pytest.approx(expected, rel=1e-6)
        assert visible.loc[leak, "smallest_share"] == pytest.approx(RESOLVED / expected, rel=1e-6)
        assert visible.loc[offset].tolist() == [0.0, np.inf]
        assert angles.index.tolist() == angles.columns.tolist() == [leak]

    def test_half_the_noise_shows_half_the_size(self):
        loud, quiet = (
            confusability(cart(), drive(), effects=["coulomb_friction"], noise=noise)[1]
            for noise in (0.02, 0.01)
        )
        pd.testing.assert_series_equal(quiet["smallest_share"], loud["smallest_share"] / 2)

    def test_codes_and_entries_and_one_axis_or_two_say_the_same(self):
        codes = ["coulomb_friction", "quadratic_drag"]
        angles, visible = confusability(cart(), drive(), effects=codes, noise=0.01)
        assert (angles.to_numpy()[~np.eye(2, dtype=bool)] > 1.0).all()
        entries = [CATALOGUE[code] for code in codes]
        for other in (
            confusability(cart(), drive()[:, None], effects=entries, noise=[0.01]),
            confusability(cart(), drive().tolist(), effects=codes, noise=0.01),
        ):
            pd.testing.assert_frame_equal(other[0], angles)
            pd.testing.assert_frame_equal(other[1], visible)

    def test_columns_are_found_by_name(self):
        simulator = cart("heat [K]")
        wide = np.column_stack([drive(), drive(seed=1)])
        frame = pd.DataFrame(wide[:, ::-1], columns=["heat [K]", "drive [V]"])
        about = {"effects": ["coulomb_friction", "temperature_gain"], "noise": 0.01}
        expected, found = (confusability(simulator, X, **about)[0] for X in (wide, frame))
        pd.testing.assert_frame_equal(found, expected)

    def test_the_whole_catalogue_has_every_name_once(self):
        _, visible = confusability(cart(), drive(), effects="catalogue", noise=0.01)
        assert visible.index.is_unique
        assert visible.index.str.startswith("dead_zone").any()

    def test_a_program_is_looked_at_through_its_twin(self):
        def program(u, parameters):
            y = np.zeros(len(u))
            for k in range(1, len(u)):
                y[k] = 0.9 * y[k - 1] + 0.1 * parameters["gain"] * u[k - 1, 0]
            return y

        simulator = CallableSimulator(program, 0.1, {"gain": 2.0}, ["drive [V]"], ["level [m]"])
        angles, _ = confusability(simulator, drive(), effects=["dead_zone", "delay"], noise=0.01)
        assert len(angles) >= 2
        about = {"amplitude": 1.0, "n_samples": 200, "noise": 0.01}
        with pytest.raises(ValueError, match=r"no twin yet.* Pass simulator.identified\(X\)"):
            design_input(simulator, ["dead_zone", "delay"], **about)
        plan = design_input(simulator.identified(drive()), ["dead_zone", "delay"], **about)
        assert plan.separation > 0

    @pytest.mark.parametrize(
        ("about", "error", "words"),
        [
            ({"simulator": np.sin}, TypeError, "simulator is a ufunc; wanted is a Simulator"),
            ({"effects": "coulomb_friction"}, ValueError, "effects must be 'catalogue' or a list"),
            ({"effects": CATALOGUE["delay"]}, TypeError, "put a single one into a list"),
            ({"effects": ["rubber"]}, ValueError, "no effect 'rubber'"),
            ({"effects": []}, ValueError, "No effect is left"),
            ({"noise": 0.0}, ValueError, "noise is 0.0; wanted is .* positive and finite"),
            ({"noise": -1.0}, ValueError, "noise is -1.0"),
            ({"noise": np.nan}, ValueError, "noise is nan"),
            ({"noise": np.inf}, ValueError, "noise is inf"),
            ({"noise": [1.0, 1.0]}, ValueError, r"noise is \[1.0, 1.0\]; .* one for each of \['position'\]"),
            ({"noise": "low"}, TypeError, "noise is 'low'; wanted is a number"),
            ({"n_windows": 0}, ValueError, "n_windows is 0; wanted is an integer"),
            ({"X": np.append(np.ones(99), np.nan)}, ValueError, "X is NaN at 1 samples, first at 99"),
            ({"X": np.append(np.ones(99), np.inf)}, ValueError, "infinity"),
            ({"X": np.ones((100, 2))}, ValueError, "X has 2 columns, the simulator has 1 inputs"),
            ({"X": np.ones(5)}, ValueError, "X has 5 samples, too few .* at least 20"),
        ],
    )
    def test_what_does_not_fit_is_refused(self, about, error, words):
        given = {"simulator": cart(), "X": drive(), "effects": ["delay"], "noise": 0.01} | about
        with pytest.raises(error, match=words):
            confusability(given.pop("simulator"), given.pop("X"), **given)

    def test_an_input_that_a_machine_does_not_survive_is_refused(self):
        simulator = ODESimulator(
            lambda x, u, p: (x[0] ** 3 + u[0],), dt=DT, parameters={}, states=["x"], inputs=["u"]
        )
        with pytest.raises(ValueError, match="X drives the simulation out of the finite range at sample"):
            confusability(simulator, np.ones(100), effects=["delay"], noise=0.01)


def tangents(*grams):
    placed = tuple(PlacedEffect(CATALOGUE[code], Port("input", 0)) for code in ("delay", "dead_zone", "lag"))
    return EffectTangents(placed, np.array(grams, dtype=float))


ABOUT = {"amplitude": 5.0, "n_samples": 300, "noise": 1e-4, "random_state": 0}


class TestDesignInput:
    def test_two_effects_are_apart_by_what_the_smaller_has_beyond_the_other(self):
        """Lengths 16, 32 and 4 under the first design: the two larger ones shrink to eight there.

        The first two are at sixty degrees there, of sine sqrt(3) / 2; the third is alone.
        """
        first = [[256, 256, 0], [256, 1024, 0], [0, 0, 16]]
        second = [[64, 0, 0], [0, 64, 0], [0, 0, 0]]
        distances = list(_distances(tangents(first, second)).values())
        assert VISIBLE == 8.0
        assert distances[0] == pytest.approx([8 * np.sqrt(3) / 2, min(8 * 8 / 16, 8 * 8 / 32)])
        assert distances[1] == pytest.approx([4, 0])
        assert distances[2] == pytest.approx([4, 0])

    def test_the_best_are_tried_in_halves_with_one_another(self):
        effects = ["coulomb_friction", "quadratic_drag", "dead_zone"]
        plan = design_input(cart(), effects, rate=50.0, **ABOUT)
        halves = plan.table["design"].str.contains("; in the second half ")
        assert halves.sum() == 6  # any two of four
        pairs = list(plan.pairs)
        least = plan.table[pairs].min(axis=1)
        np.testing.assert_allclose(plan.table["separation"], least)
        assert plan.separation >= plan.table.loc[~halves, "separation"].min()
        assert np.abs(np.diff(plan.u[:, 0])).max() <= 50.0 * 0.02 + 1e-9

    def test_the_worst_pair_is_farthest_apart_under_the_input_proposed(self):
        plan = design_input(cart(), ["coulomb_friction", "quadratic_drag"], rate=50.0, **ABOUT)
        assert plan.separation == plan.table["separation"].max() > 1.0
        assert plan.table["separation"].is_monotonic_decreasing
        assert plan.kind == plan.table["design"][0]
        assert plan.pairs == (f"{RUBS} / quadratic_drag at state:1 (velocity)",)
        assert np.all(np.abs(plan.u) <= 5.0)
        assert np.all(np.abs(np.diff(plan.u[:, 0], prepend=0.0)) <= 50.0 * 0.02 + 1e-12)
        angles, _ = confusability(
            cart(), plan.u, effects=["coulomb_friction", "quadratic_drag"], noise=1e-3, n_windows=1
        )
        assert plan.separation <= VISIBLE * np.sin(np.radians(angles.iloc[0, 1])) + 1e-6

    def test_the_same_seed_gives_the_same_input(self):
        effects = ["coulomb_friction", "quadratic_drag"]
        one, other = (design_input(cart(), effects, **ABOUT).u for _ in range(2))
        np.testing.assert_array_equal(one, other)

    def test_in_much_noise_nothing_is_told_apart(self):
        effects = ["coulomb_friction", "quadratic_drag"]
        plan = design_input(cart(), effects, **ABOUT | {"noise": 100.0})
        assert plan.separation < 0.1
        assert plan.chance < 0.01

    def test_where_one_pair_is_hopeless_the_others_decide(self):
        """Damping is a parameter of the cart, so no input shows it."""
        effects = ["viscous_damping", "coulomb_friction", "quadratic_drag"]
        plan = design_input(cart(), effects, **ABOUT)
        assert plan.separation == 0.0
        pair = f"{RUBS} / quadratic_drag at state:1 (velocity)"
        assert plan.table.set_index("design").loc[plan.kind, pair] == plan.table[pair].max()

    def test_of_one_effect_the_places_are_told_apart(self):
        plan = design_input(cart(), ["delay"], **ABOUT)
        assert all(pair.count("delay") == 2 for pair in plan.pairs)

    def test_other_inputs_rest_where_they_are_held(self):
        plan = design_input(
            cart("heat [K]"), ["coulomb_friction", "quadratic_drag"], held=[0.0, 300.0], **ABOUT
        )
        assert np.all(plan.u[:, 1] == 300.0)
        with pytest.raises(ValueError, match=r"held is \[1.0\]; .* each of \['drive \[V\]', 'heat \[K\]'\]"):
            design_input(cart("heat [K]"), ["delay"], held=[1.0], **ABOUT)

    @pytest.mark.parametrize(
        ("about", "words"),
        [
            ({"rate": -1.0}, "rate is -1.0"),
            ({"n_samples": 10}, "n_samples is 10, too short"),
            ({"noise": 0.0}, "noise is 0.0"),
            ({"effects": ["coulomb_friction"]}, "effects has fewer than two to tell apart"),
        ],
    )
    def test_what_does_not_fit_is_refused(self, about, words):
        given = ABOUT | {"effects": ["delay", "lag"]} | about
        with pytest.raises(ValueError, match=words):
            design_input(cart(), given.pop("effects"), **given)

    def test_a_machine_that_no_input_alone_drives_is_refused(self):
        upright = ODESimulator(
            lambda x, u, p: (x[1], 100.0 * x[0] + u[0]),
            dt=0.01,
            parameters={},
            states=["angle [rad]", "rate [rad/s]"],
            inputs=["torque [1/s^2]"],
        )
        with pytest.raises(ValueError, match="no input alone drives an unstable machine"):
            design_input(upright, ["delay", "lag"], **ABOUT | {"n_samples": 3000})

"""DiscrepancyRegressor: what it says of known systems, how it behaves in scikit-learn, what it refuses."""

import pickle
import re
import warnings
from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.model_selection import TimeSeriesSplit, cross_val_score

from narx_sklearn import DiscrepancyRegressor, NARXModel, NARXRegressor, ODESimulator
from narx_sklearn.discrepancy import settings
from narx_sklearn.discrepancy.report_text import report_text, what_adds_up
from narx_sklearn.metrics import DIVERGED_SCORE
from narx_sklearn.physics.effects import CATALOGUE
from narx_sklearn.report._words import next_steps

DT = 0.02
ABOUT = {"dt": DT, "states": ["position [m]", "velocity [m/s]"], "inputs": ["drive [V]"]}
NOMINAL = {"gain [m/s^2/V]": 1.0, "damping [1/s]": 0.8, "stiffness [1/s^2]": 12.0}
SOME = [
    "cubic_stiffness",
    "coulomb_friction",
    "quadratic_drag",
    "dead_zone",
    "input_saturation",
    "sensor_bias",
]


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def nominal(**changes):
    return ODESimulator(stage, parameters=NOMINAL | changes, **ABOUT)


def record(kind, seed=0, n=2500, noise=0.02, size=1.0):
    """Return a recording of a stage made elsewhere: midpoint steps ten times finer than the simulator's."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.normal(0, 3, n // 10), 10)
    gain, damping, stiffness = np.array([1.0, 0.8, 12.0]) * (1 + 0.2 * rng.uniform(-1, 1, 3))
    beyond = {"dead_zone": (-1.0, 1.0), "overlap": (-0.5, 1.2)}.get(kind, (0.0, 0.0))
    drive = u - np.clip(u, *beyond)

    def rate(x, v, force):
        a = gain * force - damping * v - stiffness * x
        if kind == "cubic_stiffness":
            a -= size * 25.0 * x**3
        if kind == "coulomb_friction":
            a -= size * 0.4 * np.tanh(v / 1e-3)
        return a

    h = DT / 10
    x = v = 0.0
    y = np.empty(n)
    for k in range(n):
        y[k] = x
        for _ in range(10):
            a = rate(x, v, drive[k])
            middle_x, middle_v = x + 0.5 * h * v, v + 0.5 * h * a
            x, v = x + h * middle_v, v + h * rate(middle_x, middle_v, drive[k])
    return u, y + noise * y.std() * rng.normal(size=n), (gain, damping, stiffness)


@pytest.fixture(scope="module")
def cubic():
    u, y, truth = record("cubic_stiffness")
    return DiscrepancyRegressor(nominal(), effects=SOME).fit(u, y), u, y, truth


@pytest.fixture(scope="module")
def short():
    """A fit in a second, for what does not depend on how much there is to find."""
    u, y, _ = record("cubic_stiffness", n=1200)
    y = y.astype(np.float32).astype(float)  # the same numbers in single precision too
    told = []
    dx = DiscrepancyRegressor(nominal(), effects=["cubic_stiffness"], verbose=told.append).fit(u, y)
    dx.set_params(verbose=0)
    return dx, u, y, told


@pytest.fixture(scope="module")
def again(short):
    """The same fitted twice more by one estimator: to a frame with other columns too, and then to arrays.

    Those are read only, not contiguous, and of single precision.
    """
    _, u, y, _ = short
    dx = DiscrepancyRegressor(nominal(), effects=["cubic_stiffness"])
    frame = pd.DataFrame({"temperature [K]": 300.0, "drive [V]": u, "pump": 0 * u})
    wide = np.column_stack([u, u])[:, :1]
    wide.flags.writeable = False
    return copy(dx.fit(frame, y)), dx.fit(wide, y.astype(np.float32))


class TestVerdicts:
    @pytest.mark.parametrize("kind", [pytest.param("coulomb_friction", marks=pytest.mark.long), "dead_zone"])
    def test_the_missing_effect_is_named_first(self, kind):
        u, y, _ = record(kind, seed=1)
        dx = DiscrepancyRegressor(nominal(), effects=SOME).fit(u, y)
        assert dx.verdict_ in ("explained", "ambiguous")
        assert dx.findings_[0].effect == kind
        assert dx.scores_.loc["augmented", "nrmse"] < 1.1 * 0.02
        assert dx.scores_.loc["augmented", "removed_low"] > 0.5

    def test_a_zone_that_lies_more_to_one_side_comes_without_a_load(self):
        u, y, _ = record("overlap", seed=5, noise=0.01)
        dx = DiscrepancyRegressor(nominal(), effects=[*SOME, "constant_load"]).fit(u, y)
        assert (dx.verdict_, [f.effect for f in dx.findings_]) == ("explained", ["dead_zone"])
        told = dx.findings_[0].parameters
        assert told["o"] == 1.0
        assert (told["c"] - told["d"], told["c"] + told["d"]) == pytest.approx((-0.5, 1.2), abs=0.02)

    def test_wrong_parameters_are_refitted_and_no_physics_is_sold(self):
        u, y, truth = record("nothing", seed=2)
        dx = DiscrepancyRegressor(nominal()).fit(u, y)
        assert dx.verdict_ == "refit"
        assert dx.findings_ == []
        np.testing.assert_allclose(dx.parameters_["refitted"], truth, rtol=0.02)

    def test_a_right_simulation_is_called_consistent(self):
        rng = np.random.default_rng(3)
        u = np.repeat(rng.normal(0, 3, 200), 10)
        y = nominal().simulate(u)[:, 0] + 0.01 * rng.normal(size=2000)
        assert DiscrepancyRegressor(nominal(), effects=SOME).fit(u, y).verdict_ == "consistent"

    def test_coloured_noise_alone_is_no_physics(self):
        rng = np.random.default_rng(4)
        u = np.repeat(rng.normal(0, 3, 250), 10)
        e = np.zeros(2500)
        for k in range(1, 2500):
            e[k] = 0.9 * e[k - 1] + rng.normal()
        y = nominal().simulate(u)[:, 0] + 0.02 * e
        dx = DiscrepancyRegressor(nominal(), effects=SOME).fit(u, y)
        assert dx.verdict_ == "consistent"
        size, new = re.search(
            r"position \[m\]: ([\d.]+), ([\d.]+) of it new in each sample", dx.report_
        ).groups()
        assert float(size) == pytest.approx(0.02 / np.sqrt(1 - 0.9**2), rel=0.2)
        assert float(new) == pytest.approx(0.02, rel=0.1)


class TestHeldOut:
    def test_the_samples_that_were_scored_are_told(self, cubic):
        dx, u, y, _ = cubic
        (held,) = dx.held_out_.itertuples()
        assert round(0.8 * len(u)) <= held.start < held.scored_from < held.stop == len(u)
        spread = np.std(y[held.start :])
        np.testing.assert_allclose(dx.scores_["nrmse"] * spread, dx.scores_["rmse"], rtol=1e-6)
        assert dx.scores_.loc["augmented", "rmse"] > 0.9 * 0.02 * y.std()

    def test_a_free_run_that_leaves_far_more_than_the_windows_of_the_fit_is_told(self, cubic):
        assert "add up" not in cubic[0].report_
        dx = copy(cubic[0])
        found = dx.conclusion_.diagnosis
        in_windows = np.sqrt(np.mean(found.problem.left_over(found.best.fit.model) ** 2))
        dx.scores_ = dx.scores_ * 10
        told = what_adds_up(dx)
        for number in (in_windows, dx.scores_.loc["augmented", "rmse"]):
            assert f"{number:.2g} m" in told
        dx.conclusion_ = replace(dx.conclusion_, corrected=dx.refitted_simulator_)
        assert not what_adds_up(dx)

    def test_a_refit_that_is_worse_than_the_given_parameters_is_not_recommended(self, cubic):
        dx = cubic[0]
        assert "Do not take them over" not in dx.report_
        worse = copy(dx)
        worse.verdict_, worse.scores_ = "refit", dx.scores_.copy()
        assert "Take over the refitted parameters" in " ".join(next_steps(worse))
        worse.scores_.loc["refitted", "nrmse_low"] = 2 * dx.scores_.loc["nominal", "nrmse_high"]
        assert "worse there than those given: in windows of" in report_text(worse)
        assert "Take over the refitted parameters" not in " ".join(next_steps(worse))

    def test_what_held_out_samples_do_not_show_is_said_to_be_unconfirmed(self, cubic):
        assert "neither confirm nor refute" not in cubic[0].report_
        dx = copy(cubic[0])
        dx.conclusion_ = replace(dx.conclusion_, is_silent=True)
        assert "neither confirm nor refute" in report_text(dx)
        dx.conclusion_ = replace(dx.conclusion_, corrected=dx.refitted_simulator_)
        assert "neither confirm nor refute" not in report_text(dx)

    @pytest.mark.parametrize(("unit", "told"), [("kg", " kg "), ("1", " "), ("-", " "), ("", " ")])
    def test_a_ratio_is_printed_without_a_unit(self, cubic, unit, told):
        dx = copy(cubic[0])
        dx.parameters_ = dx.parameters_.assign(unit=unit)
        number = f"gain = {dx.parameters_.loc['gain', 'augmented']:.4g}"
        assert f"{number}{told}  (" in report_text(dx)

    def test_a_record_too_short_to_hold_anything_out_says_so(self):
        u, y, _ = record("cubic_stiffness", n=60)
        dx = DiscrepancyRegressor(nominal(), effects=["cubic_stiffness"]).fit(u, y)
        assert dx.held_out_.empty == dx.scores_.empty


class TestFindings:
    def test_values_intervals_and_units_are_those_of_the_truth(self, cubic):
        dx, _, _, _ = cubic
        finding = dx.findings_[0]
        assert finding.effect == "cubic_stiffness"
        assert finding.port == "state:1"
        low, high = finding.intervals["k3"]
        assert low < 25.0 < high
        assert high - low < 5.0
        assert finding.units["k3"] == "1/m^2/s^2"

    def test_the_report_says_all_of_it_in_words(self, cubic):
        dx, _, _, _ = cubic
        for words in (
            "explained",
            CATALOGUE["cubic_stiffness"].title,
            "k3",
            "Held-out free run",
            "Noise estimated",
        ):
            assert words in dx.report_

    def test_the_place_is_found_too(self, cubic):
        dx, _, _, _ = cubic
        best = dx.location_.ports.iloc[0]
        assert (best["kind"], best["index"]) in {("state", 1), ("input", 0)}
        assert set(dx.location_.force.columns) == {"sample", "force", "deviation"}

    def test_an_experiment_separates_two_explanations(self, cubic):
        dx, _, _, _ = cubic
        plan = dx.next_experiment(amplitude=5.0, n_samples=800, between=["cubic_stiffness", "sensor_bias"])
        assert plan.u.shape == (800, 1)
        assert np.abs(plan.u).max() <= 5.0 + 1e-9
        assert plan.separation > 3.0  # standard deviations of the noise
        assert plan.table["separation"].is_monotonic_decreasing

    def test_an_experiment_separates_effects_that_nobody_looked_for(self, cubic):
        dx, _, _, _ = cubic
        assert "backlash" not in SOME
        plan = dx.next_experiment(amplitude=5.0, n_samples=300, between=["backlash", "cubic_stiffness"])
        assert plan.pairs == ("backlash at state:1 / cubic_stiffness at state:1",)
        assert plan.separation > 3.0

    def test_an_experiment_goes_about_the_middle_of_the_record_unless_told(self, cubic):
        dx, _, _, _ = cubic
        assert dx._middle_input == 0.0
        plan = dx.next_experiment(
            amplitude=0.5, n_samples=400, between=["cubic_stiffness", "sensor_bias"], offset=2.0
        )
        assert np.all(np.abs(plan.u - 2.0) <= 0.5 + 1e-9)

    def test_the_corrected_simulation_becomes_a_narx_model(self, cubic):
        dx, u, _, _ = cubic
        model = dx.to_narx(u)
        assert isinstance(model, NARXModel)


class TestPrediction:
    def test_the_corrected_simulation_is_nearer_than_the_nominal_one(self, cubic):
        dx, u, y, _ = cubic
        before = nominal().simulate(u)[:, 0]
        assert np.std(y - dx.predict(u)) < 0.2 * np.std(y - before)

    def test_the_initial_state_is_taken_from_first_outputs(self, cubic):
        dx, u, y, _ = cubic
        late = dx.predict(u[1000:], y_init=y[1000:1040])
        assert np.std((y[1000:] - late)[40:]) < 0.05 * np.std(y)

    def test_a_gap_in_the_inputs_begins_a_run_anew(self, cubic):
        dx, u, y, _ = cubic
        with_gap = np.array(u, dtype=float)
        with_gap[500:503] = np.nan
        run = dx.predict(with_gap, y_init=y[:40])
        assert np.flatnonzero(np.isnan(run)).tolist() == [500, 501, 502]
        np.testing.assert_allclose(run[:500], dx.predict(u[:500], y_init=y[:40]))
        np.testing.assert_allclose(run[503:], dx.predict(u[503:]))
        with_gap[:503] = np.nan  # nothing of y_init is where a run begins
        np.testing.assert_allclose(dx.predict(with_gap, y_init=y[:40])[503:], dx.predict(u[503:]))

    def test_columns_are_those_that_were_fitted(self, cubic):
        fitted, u, y, _ = cubic
        dx = copy(fitted)
        (name,) = map(str, dx.simulator_.inputs)
        assert not hasattr(dx, "feature_names_in_")
        dx.feature_names_in_ = np.array([name], dtype=object)
        table = pd.DataFrame({"other": y, name: np.ravel(u)})
        np.testing.assert_array_equal(dx.predict(table), dx.predict(u))
        np.testing.assert_array_equal(dx.predict(table[name]), dx.predict(u))
        for wrong in (table[["other"]], table["other"]):
            with pytest.raises(ValueError, match=r"X has the columns \['other'\]; those that were fitted"):
                dx.predict(wrong)
            with pytest.raises(ValueError, match="columns of these names"):
                dx.score(wrong, y)

    def test_score_is_that_of_a_free_run(self, cubic):
        dx, u, y, _ = cubic
        assert 0.998 < dx.score(u, y) <= 1.0

    def test_sessions_start_anew(self, cubic):
        dx, u, _, _ = cubic
        sessions = np.repeat([0, 1], 1250)
        both = dx.predict(u, sessions=sessions)
        np.testing.assert_allclose(both[1250:], dx.predict(u[1250:]))


class TestInScikitLearn:
    def test_a_fit_that_fails_leaves_nothing_half_done(self, short):
        _, u, y, _ = short
        dx = DiscrepancyRegressor(nominal(), effects=["cubic_stiffness"])
        with pytest.raises(ValueError, match="No output of y moves"):
            dx.fit(u, np.zeros(len(y)))
        with pytest.raises(NotFittedError):
            dx.predict(u)
        assert not [name for name in vars(dx) if name.endswith("_")]

    def test_names_of_columns_are_those_of_the_last_fit_and_of_inputs(self, again):
        of_frame, of_arrays = again
        assert (of_frame.n_features_in_, of_frame.feature_names_in_.tolist()) == (1, ["drive [V]"])
        assert not hasattr(of_arrays, "feature_names_in_")

    def test_a_function_is_told_of_each_stage(self, short):
        *_, told = short
        assert told[0] == "check of the record"
        assert told[-1] == "location"

    def test_scores_are_finite_whatever_the_record(self, short):
        dx, u, y, _ = short
        still = np.zeros(400)
        assert dx.score(still, still) == 1.0  # met exactly, as scikit-learn has it
        assert dx.score(still, still + np.linspace(0, 1e-3, 400)) < 0
        softer = copy(dx)
        softer.simulator_ = nominal().with_parameters([1.0, 0.8, -12.0])
        with np.errstate(over="ignore", invalid="ignore"):
            assert softer.score(1e9 * np.tile(u, 20), np.tile(y, 20)) == DIVERGED_SCORE

    def test_clone_and_pickle(self, cubic):
        dx, u, _, _ = cubic
        again = pickle.loads(pickle.dumps(dx))
        np.testing.assert_array_equal(again.predict(u), dx.predict(u))
        assert clone(dx).get_params()["effects"] == SOME

    def test_the_same_record_gives_the_same_diagnosis(self, short, again):
        _, of_arrays = again
        assert of_arrays.report_ == short[0].report_

    def test_dataframes_are_read_by_name(self, short, again):
        of_frame, _ = again
        assert of_frame.findings_ == short[0].findings_

    @pytest.mark.parametrize("split", [pytest.param(0, marks=pytest.mark.long), 1])
    def test_cross_validation_judges_the_augmented_free_run(self, split):
        u, y, _ = record("cubic_stiffness", n=1500)
        dx = DiscrepancyRegressor(nominal(), effects=["cubic_stiffness"])
        splits = list(TimeSeriesSplit(2).split(u))
        assert cross_val_score(dx, u, y, cv=splits[split : split + 1]).min() > 0.99

    def test_read_only_non_contiguous_and_single_precision_arrays_are_taken(self, again):
        _, of_arrays = again
        assert of_arrays.findings_[0].effect == "cubic_stiffness"

    def test_gaps_and_sessions_do_not_stop_it(self):
        u, y, _ = record("cubic_stiffness", n=1600)
        u[300:310] = np.nan
        y[600:650] = np.nan
        sessions = np.repeat(["a", "b"], 800)
        effects = ["cubic_stiffness", "quadratic_drag"]
        dx = DiscrepancyRegressor(nominal(), effects=effects).fit(u, y, sessions=sessions)
        assert dx.findings_[0].effect == "cubic_stiffness"


class TestRefusals:
    u, y = np.ones(100), np.arange(100.0)

    @pytest.mark.parametrize(
        ("settings", "words"),
        [
            ({"alpha": 0.0}, "alpha is a probability"),
            ({"level": 1.0}, "level is a probability"),
            ({"test_fraction": 0.95}, "test_fraction"),
            ({"max_effects": 0}, "max_effects"),
            ({"window": 2}, "window counts samples"),
            ({"effects": "all"}, "effects must be"),
            ({"effects": ["rubber"]}, "no effect 'rubber'"),
            ({"effects": ["gravity"], "exclude": ["gravity"]}, "No effect is left"),
        ],
    )
    def test_settings(self, settings, words):
        with pytest.raises(ValueError, match=words):
            DiscrepancyRegressor(nominal(), **settings).fit(self.u, self.y)

    def test_what_is_no_simulator_is_told_how_to_become_one(self):
        model = NARXModel.from_equations("0.5*y[k-1] + u[k-1]")
        for given, way in (
            (model, r"NARXSimulator\(model, dt"),
            (NARXRegressor(), "NARXSimulator.estimator"),
            (np.zeros(9), r"TraceSimulator\(y_sim"),
        ):
            with pytest.raises(TypeError, match=way):
                DiscrepancyRegressor(given).fit(np.zeros((9, 1)), np.zeros(9))
        with pytest.raises(TypeError, match="goes into ODESimulator"):
            DiscrepancyRegressor(stage).fit(self.u, self.y)

    def test_lengths_and_columns(self):
        dx = DiscrepancyRegressor(nominal())
        with pytest.raises(ValueError, match="X has 100 samples and y has 90"):
            dx.fit(self.u, self.y[:90])
        with pytest.raises(ValueError, match="X has 2 columns"):
            dx.fit(np.ones((100, 2)), self.y)
        with pytest.raises(ValueError, match="y has 2 columns"):
            dx.fit(self.u, np.ones((100, 2)))

    @pytest.mark.parametrize("value", [1.0, np.nan])
    def test_an_output_that_never_moves_is_refused(self, value):
        with pytest.raises(ValueError, match=r"No output of y moves.* Pass a record in which"):
            DiscrepancyRegressor(nominal()).fit(self.u, np.full(100, value))

    @pytest.mark.parametrize(
        ("value", "words"), [(0.0, "is 0 in all samples"), (np.nan, "is never measured")]
    )
    def test_a_dead_channel_beside_one_that_moves_is_refused(self, value, words):
        both = ODESimulator(stage, parameters=NOMINAL, outputs=ABOUT["states"], **ABOUT)
        y = np.column_stack([self.y, np.full(100, value)])
        with pytest.raises(ValueError, match=rf"Output velocity \[m/s\] {words}"):
            DiscrepancyRegressor(both).fit(self.u, y)

    def test_a_record_without_a_whole_window(self):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with pytest.raises(ValueError, match="fitting window needs"):
                DiscrepancyRegressor(nominal(), effects=SOME).fit(self.u[:8], self.y[:8])

    @pytest.mark.parametrize(
        ("about", "error", "words"),
        [
            ({"rate": -1.0}, ValueError, "rate is -1.0; wanted is a positive and finite number"),
            ({"n_samples": 3}, ValueError, "n_samples is 3, too short"),
            ({"column": 1}, ValueError, r"column is 1; .* \{0: drive \[V\]\}"),
            ({"column": "drive"}, TypeError, r"column is 'drive'; .* \{0: drive \[V\]\}"),
            ({"between": "cubic_stiffness"}, TypeError, "between is 'cubic_stiffness'; wanted is a list"),
            (
                {"between": ["cubic_stiffness", "rubber"]},
                ValueError,
                "'rubber', which is no effect that is known",
            ),
        ],
    )
    def test_an_experiment_within_no_limits_or_between_nothing(self, cubic, about, error, words):
        dx, _, _, _ = cubic
        with pytest.raises(error, match=words):
            dx.next_experiment(**{"amplitude": 1.0, "n_samples": 100} | about)


def test_every_stage_of_the_progress_bar_is_told_by_some_part_of_a_diagnosis():
    folder = Path(settings.__file__).parent
    told = "".join(file.read_text() for file in folder.rglob("*.py") if file.name != "settings.py")
    assert [stage for stage in settings.STAGES if f'tell("{stage}")' not in told] == []

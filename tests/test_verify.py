"""What a correction does to held-out samples, and how errors there are counted."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from small_machines import levels, make_axis, make_oscillator, recorded_oscillator

from narx_sklearn.discrepancy import DiscrepancyRegressor, conclusion
from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.verify import (
    BLOCKS,
    Errors,
    HeldOut,
    Lead,
    on_held_out,
    score_table,
    scored_stretches,
    squared_errors,
)
from narx_sklearn.physics.effects import CATALOGUE

N = 800


def held_out(left_before, left_after) -> HeldOut:
    """Return what two simulators leave, whitened residuals (n,)."""

    def by_block(values):
        return np.array([block.sum() for block in np.array_split(values, BLOCKS)])

    less = by_block(left_before**2 - left_after**2)
    changed = by_block((left_before - left_after) ** 2)
    windows = Windows.whole([slice(0, N)])
    return HeldOut(less, changed, np.mean(left_before**2), np.mean(left_after**2), windows, np.zeros((1, 1)))


class TestIsBetter:
    def test_what_is_right_and_large_enough_is(self):
        rng = np.random.default_rng(0)
        change = 0.5 * rng.normal(size=N)
        assert all(held_out(e + change, e).is_better for e in rng.normal(size=(50, N)))

    def test_what_changes_nothing_or_goes_anywhere_is_not(self):
        rng = np.random.default_rng(1)
        e = rng.normal(size=N)
        assert not held_out(e, e).is_better
        told = [held_out(e, e + 0.2 * rng.normal(size=N)).is_better for e in rng.normal(size=(50, N))]
        assert sum(told) == 0

    def test_a_run_that_is_lost_is_worse_than_one_that_is_not(self):
        e, lost = np.ones(N), np.full(N, np.inf)
        assert held_out(lost, e).is_better
        assert not held_out(e, lost).is_better


class TestIsBelied:
    def test_what_is_right_rarely_is(self):
        rng = np.random.default_rng(0)
        change = 0.15 * rng.normal(size=N)  # four standard errors
        told = [held_out(e + change, e).is_belied(1.0) for e in rng.normal(size=(300, N))]
        assert sum(told) <= 3

    def test_what_goes_the_wrong_way_is(self):
        rng = np.random.default_rng(1)
        change = 0.15 * rng.normal(size=N)
        told = [held_out(e, e + change).is_belied(1.0) for e in rng.normal(size=(100, N))]
        assert sum(told) >= 90

    @pytest.mark.parametrize("share", [0.6, 1.0, 1.4])
    def test_a_form_that_is_somewhat_off_is_not(self, share):
        rng = np.random.default_rng(2)
        change, e = rng.normal(size=N), rng.normal(size=N)
        assert not held_out(e + change, e + (1.0 - share) * change).is_belied(1.0)

    def test_what_changes_nothing_is_not(self):
        e = np.random.default_rng(3).normal(size=N)
        assert not held_out(e, e).is_belied(1.0)
        assert held_out(e, e).is_silent(1.0)
        assert not held_out(e, e + 0.1).is_silent(1.0)  # by eight noise variances

    def test_a_run_that_is_lost_tells_nothing(self):
        """It is another matter that such a run does harm."""
        e = np.ones(N)
        assert not held_out(e, np.full(N, np.inf)).is_belied(1.0)


def test_stretches_that_are_too_short_leave_no_initial_states():
    simulator, u = make_axis(), np.zeros((100, 1))
    windows = cut([(slice(0, 90), 0)], 15, 12)
    problem = Problem(simulator, u, u, windows, Noise.white(np.ones(1)))
    nothing = on_held_out(
        problem,
        simulator,
        simulator,
        [(slice(95, 100), 0)],
        (np.zeros(2),) * 2,
        Lead(windows, np.zeros((6, 2))),
    )
    assert nothing.x0.shape == (0, 2)
    assert not nothing.is_silent(1.0)
    assert not nothing.is_better
    assert not nothing.is_belied(1.0)


class TestScores:
    """Held-out outputs may have gaps: what was not measured counts as nothing."""

    @pytest.fixture(scope="class")
    @classmethod
    def record(cls):
        rng = np.random.default_rng(0)
        u = np.repeat(rng.normal(0, 2, 90), 10)[:, None]
        return u, make_axis().simulate(u) + 0.02 * rng.normal(size=(900, 1))

    @pytest.fixture(scope="class")
    @classmethod
    def whole(cls, record):
        return DiscrepancyRegressor(make_axis(), effects=["cubic_stiffness"]).fit(*record)

    @pytest.mark.parametrize(
        "gap",
        [
            slice(724, 728),  # where the initial state is fitted
            pytest.param(slice(840, 852), marks=pytest.mark.long),  # after
        ],
    )
    def test_a_short_gap_changes_next_to_nothing(self, record, whole, gap):
        u, y = record
        gapped = y.copy()
        gapped[gap] = np.nan
        other = DiscrepancyRegressor(make_axis(), effects=["cubic_stiffness"]).fit(u, gapped)
        assert np.isfinite(other.scores_.to_numpy()).all()
        # an integrator adds up what a few other samples say of its first velocity
        assert (other.scores_["rmse"] < 2 * whole.scores_["rmse"]).all()
        assert "inf %" not in other.report_

    def test_a_gap_as_long_as_what_fixes_the_initial_state_is_no_trouble(self, record):
        u, y = record
        y = y.copy()
        y[720:740] = np.nan
        (stretch,) = scored_stretches([(slice(720, 840), 0)], y, 20, np.inf, 2)
        errors = squared_errors({"one": make_axis()}, u, y, [stretch], {"one": np.zeros(2)}, {})
        assert errors["one"].counts.sum() == 80
        # as many samples as without the gap fix its initial state
        assert np.sqrt(errors["one"].mean_squares()[0]) < 0.06
        assert np.isfinite(errors["one"].squares).all()

    def test_every_sample_counts_for_as_much(self):
        """Blocks of 1, 3 and no samples: (4 + 3 * 1) / 4, not the mean of block means."""
        squares, counts = np.array([[4.0], [3.0], [0.0]]), np.array([[1], [3], [0]])
        table = score_table({"one": Errors(squares, counts)}, np.array([1.0]), 0.9, 0)
        assert table["rmse"]["one"] == pytest.approx(np.sqrt(7 / 4))
        assert 1.0 <= table["nrmse_low"]["one"] <= table["nrmse_high"]["one"] <= 2.0

    def test_an_output_that_was_not_measured_has_no_part_in_it(self):
        seen = np.ones((20, 1), dtype=int)
        squares = np.random.default_rng(0).chisquare(1, (20, 1))
        alone = score_table({"one": Errors(squares, seen)}, np.array([2.0]), 0.9, 0)
        both = Errors(np.hstack([squares, 0 * squares]), np.hstack([seen, 0 * seen]))
        beside = score_table({"one": both}, np.array([2.0, np.nan]), 0.9, 0)
        for column in ("nrmse", "nrmse_low", "nrmse_high"):
            assert beside[column]["one"] == pytest.approx(alone[column]["one"])
        assert np.isnan(beside["rmse_1"]["one"])

    def test_nothing_measured_is_no_score(self):
        nothing = Errors(np.zeros((3, 1)), np.zeros((3, 1), dtype=int))
        assert score_table({"one": nothing}, np.array([np.nan]), 0.9, 0).empty

    def test_a_run_that_is_lost_has_an_infinite_error(self):
        counts = np.ones((20, 1), dtype=int)
        errors = {
            "refitted": Errors(np.ones((20, 1)), counts),
            "augmented": Errors(np.full((20, 1), np.inf), counts),
        }
        table = score_table(errors, np.array([1.0]), 0.9, 0)
        assert table["nrmse"]["augmented"] == table["nrmse_high"]["augmented"] == np.inf
        assert table["removed"].tolist() == [0.0, -np.inf]


class TestScoredStretches:
    def test_short_pieces_are_left_out_and_long_ones_cut_before_a_run_is_lost(self):
        pieces = [(slice(0, 40), 0), (slice(50, 250), 50)]
        y = np.zeros((250, 1))
        (whole,) = scored_stretches(pieces, y, 24, np.inf, 2)
        assert (*whole, whole.scored) == (slice(50, 250), 50, 24, slice(74, 250))
        cut_up = scored_stretches(pieces, y, 24, 52.0, 2)
        assert [s.rows for s in cut_up] == [slice(a, a + 50) for a in range(50, 250, 50)]

    def test_where_all_are_short_fewer_samples_fix_the_initial_state(self):
        y = np.zeros((70, 1))
        (short,) = scored_stretches([(slice(0, 40), 0), (slice(50, 70), 50)], y, 24, np.inf, 2)
        assert (short.rows, short.n_init) == (slice(0, 40), 12)
        assert scored_stretches([(slice(0, 24), 0)], y, 24, np.inf, 2) == []


def test_what_happened_once_makes_no_other_run_worse():
    """It does not act there, and parameters fitted beside it differ by what is not known of them."""
    scores = pd.DataFrame({"removed_high": [-0.1]}, index=["augmented"])

    def is_worse(**thetas):
        effects = [PlacedEffect(CATALOGUE[code], Port("output", 0), theta=t) for code, t in thetas.items()]
        tried = SimpleNamespace(effects=effects)
        return conclusion.Conclusion.is_worse.fget(SimpleNamespace(scores=scores, tried=tried))

    assert is_worse(sensor_bias=(1.0,))
    assert not is_worse(stuck_sensor=(80.0, 6.0, 0.0))
    assert is_worse(stuck_sensor=(80.0, 6.0, 0.0), sensor_bias=(1.0,))
    assert is_worse()  # parameters beside what follows no signal


class TestWhatHarmsWholeRunsAlone:
    """Its windows speak for it, over a whole run it is worse than a refit."""

    @pytest.fixture
    def in_whole_runs(self, monkeypatch):
        scored = conclusion.score_table

        def worse(*args):
            table = scored(*args)
            table.loc["augmented", ["nrmse", "removed_high"]] = table["nrmse"]["refitted"] * times, -1.0
            return table

        times = 1.5

        def make_worse(by=times):
            nonlocal times
            times = by
            monkeypatch.setattr(conclusion, "score_table", worse)

        return make_worse

    @pytest.mark.long
    def test_is_named_and_not_used_where_small_errors_add_up(self, in_whole_runs):
        def drags(x, u, p):
            return x[1], p[0] * u[0] - p[1] * x[1] - 0.8 * x[1] * abs(x[1])

        rng = np.random.default_rng(0)
        u = levels(rng, 1500)
        y = make_axis(equations=drags).simulate(u)
        y += 0.01 * np.std(y) * rng.normal(size=y.shape)
        usual, dx = (DiscrepancyRegressor(make_axis(), effects=["quadratic_drag"]) for _ in range(2))
        usual.fit(u, y)
        assert usual.simulator_.effects
        in_whole_runs()
        dx.fit(u, y)
        assert dx.verdict_ == usual.verdict_ == "explained"
        assert not dx.simulator_.effects
        assert "but whole runs harm: the corrected simulation leaves it out" in " ".join(dx.report_.split())
        assert "whole runs harm" not in usual.report_
        in_whole_runs(100.0)  # as the nominal simulation does not: nothing that is right runs off
        dx.fit(u, y)
        assert dx.verdict_ == "unknown"
        assert not dx.simulator_.effects

    @pytest.mark.long
    def test_is_no_explanation_of_a_machine_that_forgets(self, in_whole_runs):
        def hardens(x, u, p):
            return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 30.0 * x[0] ** 3

        u, y = recorded_oscillator(hardens, noise=0.02, seed=0)
        in_whole_runs()
        dx = DiscrepancyRegressor(make_oscillator(), effects=["cubic_stiffness"]).fit(u, y)
        assert dx.verdict_ == "unknown"
        assert not dx.simulator_.effects

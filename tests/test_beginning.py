"""How a diagnosis begins: windows, initial states, and pieces of a record that begin late."""

from itertools import pairwise

import numpy as np
import pytest
from small_machines import axis_problem, levels, make_axis, make_circuit, make_drive

from narx_sklearn.discrepancy import verify
from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages import beginning
from narx_sklearn.discrepancy.stages.beginning import _Fitted, _lengthened, _lengthened_most, begin
from narx_sklearn.discrepancy.verify import Lead, Stretch, free_run
from narx_sklearn.physics.effects import CATALOGUE

LATE = Stretch(slice(600, 1000), 0, 100)


def two_masses(x, u, p):
    twist = p[2] * (x[0] - x[2])
    return x[1], p[0] * u[0] - p[1] * x[1] - twist, x[3], twist - p[1] * x[3]


class TestLongWindows:
    def test_an_integrator_is_looked_at_over_long_windows_once_its_parameters_are_near(self):
        problem, start = axis_problem(n_windows=30)
        short = _Fitted(problem, fit(problem, start), 50)
        longer = _lengthened(short, cut([(slice(0, 1500), 0)], 375, 12))
        assert (longer.problem.windows.count, longer.lengthened_from) == (4, 50)
        np.testing.assert_allclose(longer.refitted.model.p, [1.1, 0.4], rtol=0.01)

    def test_windows_stay_short_where_a_long_run_loses_the_recording(self):
        problem, start = axis_problem(n_windows=30)
        rng = np.random.default_rng(9)
        problem.y[:] = np.cumsum(rng.normal(size=problem.y.shape), axis=0)
        short = _Fitted(problem, fit(problem, start), 50)
        assert _lengthened(short, cut([(slice(0, 1500), 0)], 375, 12)) is short

    def test_noise_alone_keeps_no_windows_short(self):
        """Half as large as the motion, it is no more in long windows than in short ones."""
        problem, start = axis_problem(n_windows=30)
        problem.y[:] += 0.5 * np.std(problem.y) * np.random.default_rng(9).normal(size=problem.y.shape)
        short = _Fitted(problem, fit(problem, start), 50)
        assert _lengthened(short, cut([(slice(0, 1500), 0)], 375, 12)).problem.windows.count == 4

    @pytest.mark.parametrize(("follows_from", "count"), [(1, 1), (2, 2), (3, 4), (30, 30)])
    def test_where_a_whole_run_is_lost_parts_are_tried(self, follows_from, count, monkeypatch):
        problem, start = axis_problem(n_windows=30)
        short = _Fitted(problem, fit(problem, start), 50)

        def followed(begun, windows):
            return begun if windows.count < follows_from else begun._replace(problem=problem.over(windows))

        monkeypatch.setattr(beginning, "_lengthened", followed)
        longest = _lengthened_most(short, [(slice(0, 1500), 0)], 1500, 12)
        assert longest.problem.windows.count == count

    def test_each_session_is_run_through_in_one(self):
        problem, _ = axis_problem(n_windows=30)
        settings = Settings((), 0.005, 2, 4, None, 0, None, lambda stage: None)
        for edges in ((0, 1500), (0, 800, 1500)):
            pieces = [(slice(a, b), a) for a, b in pairwise(edges)]
            begun = begin(problem.simulator, problem.u, problem.y, pieces, settings)
            assert begun.problem.windows.count == len(pieces)


class TestLatePieces:
    @pytest.mark.parametrize(
        ("code", "port", "theta"),
        [
            ("additive_drift", Port("output", 0), (0.8, 10.0, 2.0, -6.0)),
            ("periodic_disturbance", Port("state", 1), (2.0, 1.3, 0.4)),
            ("backlash", Port("input", 0), (1.0, 1.5, 0.0, 0.0)),
            ("gain_drift", Port("input", 0), (0.5, 9.0, 0.1)),
        ],
    )
    def test_an_effect_acts_in_a_late_piece_as_since_the_session_began(self, code, port, theta):
        effect = PlacedEffect(CATALOGUE[code], port, (0.0, 1.0), theta=theta)
        simulator = make_axis().with_effects([effect])
        u = levels(np.random.default_rng(4), 1000)
        y = simulator.simulate(u)
        late = free_run(simulator, u, y, LATE, np.zeros(2))
        np.testing.assert_allclose(late.y, y[600:], atol=1e-6 * np.ptp(y))

    @pytest.mark.parametrize(
        ("code", "port", "theta"),
        [
            ("creep", Port("output", 0), (0.3, 4.0, 1.0, 0.0)),
            ("creep", Port("state", 1), (3.0, 4.0, 1.0, 0.0)),
            ("extra_mode", Port("state", 1), (0.5, 0.2, 0.01)),
        ],
    )
    def test_an_effect_of_long_memory_remembers_what_led_to_a_late_piece(self, code, port, theta):
        effect = PlacedEffect(CATALOGUE[code], port, (0.0, 1.0), theta=theta)
        simulator = make_circuit().with_effects([effect])
        u = levels(np.random.default_rng(4), 1000)
        whole = simulator.run(u, Windows.whole([slice(0, 1000)]), np.zeros((1, 2)))
        first, last = np.array([0, 300]), np.array([300, 600])
        windows = Windows(first, last, np.array([True, False]), np.zeros(2, dtype=np.int64))
        lead = Lead(windows, whole.x[first])
        late = free_run(simulator, u, whole.y, LATE, np.zeros(2), lead)
        np.testing.assert_allclose(late.y, whole.y[600:], atol=1e-6 * np.ptp(whole.y))
        without = free_run(simulator, u, whole.y, LATE, np.zeros(2))
        assert np.max(np.abs(without.y - whole.y[600:])) > 0.01 * np.ptp(whole.y)

    @pytest.mark.parametrize("seed", [1, 3])
    def test_a_poor_guess_of_what_nobody_measured_is_not_held_against_a_simulator(self, seed):
        rng = np.random.default_rng(seed)
        drive = make_drive(two_masses, 0.02, "torque [V]", gain=1.0, damping=0.5, stiffness=40.0)
        rubs = PlacedEffect(
            CATALOGUE["coulomb_friction"], Port("state", 3), (0.0, 0.0, 0.0, 1.0), theta=(0.8,)
        )
        true = drive.with_effects([rubs])
        u = levels(rng, 1600)
        y = true.simulate(u) + 0.002 * rng.normal(size=(1600, 1))
        windows = cut([(slice(0, 800), 0)], 400, 12)
        problem = Problem(drive, u, y, windows, Noise.white(np.array([0.002])))
        x = true.run(u, Windows.whole([slice(0, 1600)]), np.zeros((1, 4))).x
        held_out, lead = [(slice(800, 1600), 0)], Lead(windows, x[windows.first])
        poor = 2 * rng.normal(size=4)
        held = verify.on_held_out(problem, true, true, held_out, (x[[800, 1200]], poor), lead)
        assert abs(held.less.sum()) < 5.0
        assert 0.8 < held.left < 1.2

    def test_the_state_under_a_coarse_sensor_is_found(self):
        coarse = PlacedEffect(CATALOGUE["quantisation"], Port("output", 0), theta=(0.05,))
        simulator = make_circuit().with_effects([coarse])
        u = levels(np.random.default_rng(4), 1000)
        y = simulator.simulate(u)
        late = free_run(simulator, u, y, LATE, np.array([2.0, -1.0]))
        assert np.sqrt(np.mean((late.y - y[600:]) ** 2)) < 0.05

"""Machines that a long run does not follow: unstable ones that a loop holds, and those that turn over."""

from dataclasses import replace

import numpy as np
import pytest

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.experiment import design_experiment
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.fitting.start import fit_initial_states, fit_where_followed, states_along
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.records.checks import check_record
from narx_sklearn.discrepancy.search.bank import entered
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.inference import parameters_moved
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.windows import Pace, cut, find_pace, followed_for, window_length
from narx_sklearn.discrepancy.stages import diagnosis
from narx_sklearn.discrepancy.stages.beginning import DivergesError, begin
from narx_sklearn.discrepancy.stages.diagnosis import diagnose
from narx_sklearn.discrepancy.verify import Stretch, free_run, initial_state, within_reach
from narx_sklearn.physics.effects import CATALOGUE

N, DT, GRAVITY, MIDDLE = 3000, 0.002, 9.81, 0.01
FORCE = 1e-3  # m^3/s^2/A^2


def ball(x, u, p):
    """A ball under a magnet: gap and speed, driven by the current."""
    return x[1], GRAVITY - p[0] * (u[0] / x[0]) ** 2 - p[1] * x[1]


def pendulum(x, u, p):
    return x[1], p[0] * u[0] - p[1] * np.sin(x[0]) - p[2] * x[1]


def make_ball(force=1.07 * FORCE, damping=0.3):
    return ODESimulator(
        ball,
        dt=DT,
        parameters={"force [m^3/s^2/A^2]": force, "damping [1/s]": damping},
        states=["gap [m]", "speed [m/s]"],
        inputs=["current [A]"],
    )


def make_pendulum(gain=27.0, weight=22.0, damping=1.2):
    return ODESimulator(
        pendulum,
        dt=0.01,
        parameters={"gain [rad/s^2/A]": gain, "weight [1/s^2]": weight, "damping [1/s]": damping},
        states=["angle [rad]", "rate [rad/s]"],
        inputs=["current [A]"],
    )


def held_ball(seed=0, load=0.0, noise=0.01):
    """Return current and gap of a ball that a loop holds, without and with noise."""
    rng = np.random.default_rng(seed)
    wanted = MIDDLE + np.repeat(rng.uniform(-0.0015, 0.0015, N // 150 + 1), 150)[:N]
    level = np.sqrt(GRAVITY / FORCE) * MIDDLE
    fine = DT / 40
    gap, speed = MIDDLE, 0.0
    u, y = np.empty((N, 1)), np.empty((N, 1))
    for k in range(N):
        u[k] = level + 455.0 * (gap - wanted[k]) + 7.0 * speed + 0.02 * rng.standard_normal()
        y[k] = gap
        for _ in range(40):
            pull = GRAVITY + load - FORCE * (u[k, 0] / gap) ** 2 - 0.1 * speed
            gap, speed = gap + fine * speed + 0.5 * fine**2 * pull, speed + fine * pull
    return u, y, y + noise * y.std() * rng.standard_normal(y.shape)


@pytest.fixture(scope="module")
def held():
    return held_ball()


@pytest.fixture(scope="module")
def ball_problem(held):
    """A problem of short windows, and the fit without anything missing; a load is."""
    u, true, y = held_ball(load=-0.6)
    windows = cut([(slice(0, N), 0)], 46, 12)
    problem = Problem(make_ball(FORCE / 0.94), u, y, windows, Noise.white(np.array([0.01 * true.std()])))
    x0 = np.column_stack([y[windows.first, 0], np.gradient(true[:, 0], DT)[windows.first]])
    return problem, fit(problem, fit_initial_states(problem, x0).model)


class TestPace:
    def test_an_unstable_mode_is_found_and_limits_the_window(self):
        level = np.sqrt(GRAVITY / FORCE) * MIDDLE
        x, u = np.tile([MIDDLE, 0.0], (5, 1)), np.full((5, 1), level)
        pace = find_pace(make_ball(FORCE, 0.0), x, u)
        assert pace.growth == pytest.approx(np.sqrt(2 * GRAVITY / MIDDLE), rel=1e-4)
        assert not pace.forgets
        assert followed_for(make_ball(), pace) == pytest.approx(4 / (pace.growth * DT))
        assert window_length(make_ball(), pace, N) == int(followed_for(make_ball(), pace))

    def test_nothing_grows_where_all_is_damped_or_adds_up(self):
        at_rest = find_pace(make_pendulum(), np.zeros((5, 2)), np.zeros((5, 1)))
        assert at_rest.growth == 0.0
        assert followed_for(make_pendulum(), Pace(1.0, True)) == np.inf


class TestStatesAlong:
    def test_a_lost_run_begins_anew_from_what_was_measured(self, held):
        u, true, y = held
        lost = make_ball().simulate(u, [MIDDLE, 0.0])
        assert not np.all(np.abs(lost - true) < true.std())
        x = states_along(make_ball(), u, y, [(slice(0, N), 0)])
        assert np.std(x[:, 0] - true[:, 0]) < 0.3 * true.std()
        speed = np.gradient(true[:, 0], DT)
        assert np.std(x[:, 1] - speed) < speed.std()

    def test_a_run_that_is_not_lost_is_one_run(self):
        rng = np.random.default_rng(0)
        u = 0.1 * rng.normal(size=(500, 1))
        y = make_pendulum(30.0, 20.0, 1.0).simulate(u)
        x = states_along(make_pendulum(), u, y, [(slice(0, 500), 0)])
        np.testing.assert_allclose(x[:, :1], make_pendulum().simulate(u), atol=1e-12)


class TestReach:
    def test_stretches_are_over_before_the_run_is_lost(self):
        pieces = [(slice(100, 500), 0), (slice(520, 600), 510)]
        assert within_reach(pieces, 20, np.inf) is pieces
        short = within_reach(pieces, 20, 40.0)
        assert short[0] == (slice(100, 140), 0)
        assert short[-1] == (slice(560, 600), 510)
        assert max(piece.stop - piece.start for piece, _ in short) == 40


@pytest.mark.parametrize("off", [-0.5, -0.2, 1.0])
def test_an_initial_state_is_found_from_a_guess_that_loses_the_run(held, off):
    """With half a metre a second towards the magnet the ball meets it before the last of these samples."""
    u, true, y = held
    simulator, piece = make_ball(FORCE, 0.1), slice(900, 946)
    speed = np.gradient(true[:, 0], DT)[900]
    guess = np.array([true[900, 0], speed + off])
    x0 = initial_state(simulator, u, y, Stretch(piece, 0, 46), guess)
    assert x0[1] == pytest.approx(speed, abs=0.01)
    run = free_run(simulator, u, y, Stretch(piece, 0, 46), guess)
    assert np.abs(run.y - true[piece]).max() < 0.2 * true.std()


def test_an_effect_enters_with_the_parameters_moved_as_the_tangents_say(ball_problem):
    """A load of a twentieth of the weight throws the ball away unless the magnet pulls less."""
    problem, base = ball_problem
    load = PlacedEffect(CATALOGUE["constant_load"], Port("state", 1), (0.0, 1.0), theta=(-0.6,))
    as_it_was = base.model._replace(effects=(load,))
    model, left = entered(problem, base, problem.run(base.model), load)
    assert model.effects == (load,)
    assert model.p[0] == pytest.approx(FORCE, rel=0.02)

    def cost(at: Model) -> float:
        return float(np.sum(base.projector(problem.residual(problem.run(at))) ** 2))

    assert left == pytest.approx(cost(model))
    assert left < 0.01 * cost(as_it_was)


def test_rounding_explains_nothing_by_the_choice_of_states_in_many_windows(held):
    u, true, y = held
    windows = cut([(slice(0, N), 0)], 46, 12)
    sigma = 0.01 * true.std()
    problem = Problem(make_ball(FORCE, 0.1), u, y, windows, Noise.white(np.array([sigma])))
    x0 = np.column_stack([y[windows.first, 0], np.gradient(true[:, 0], DT)[windows.first]])
    base = fit(problem, fit_initial_states(problem, x0).model)
    steps = PlacedEffect(CATALOGUE["quantisation"], Port("output", 0), theta=(0.2 * sigma,))
    found = fit(problem, base.model._replace(effects=(steps,)))
    assert base.cost - found.cost < 10.0  # 38 where each window takes the best of several states


def test_parameters_that_leave_far_more_than_others_have_moved(ball_problem):
    problem, base = ball_problem
    nominal = fit_initial_states(problem, base.model.x0)
    assert nominal.cost < 2 * base.cost or parameters_moved(problem, nominal, base) < 1e-12
    far = nominal._replace(cost=3 * base.cost, residual=0 * nominal.residual)
    assert parameters_moved(problem, far, base) < 1e-12


class TestExperiment:
    def test_an_unstable_machine_is_not_driven_by_an_input_alone(self):
        def upright(x, u, p):
            return x[1], p[0] * x[0] + u[0]

        about = {"dt": 0.01, "states": ["angle [rad]", "rate [rad/s]"], "inputs": ["torque [1/s^2]"]}
        simulator = ODESimulator(upright, parameters={"weight [1/s^2]": 100.0}, **about)
        rivals = {
            code: simulator.with_effects(
                [PlacedEffect(CATALOGUE[code], Port("state", 1), (0.0, 1.0), theta=(0.5,))]
            )
            for code in ("coulomb_friction", "quadratic_drag")
        }
        about = {"noise": Noise.white(np.array([0.01])), "amplitude": 1.0}
        assert design_experiment(rivals, n_samples=60, **about).separation > 0
        with pytest.raises(ValueError, match="no input alone drives an unstable machine"):
            design_experiment(rivals, n_samples=600, **about)

    def test_a_run_that_leaves_the_finite_range_is_no_experiment(self):
        """At rest, with no gap, the magnet's pull is infinite."""
        rivals = {"strong": make_ball(), "weak": make_ball(0.9 * FORCE)}
        noise = Noise.white(np.array([1e-5]))
        with pytest.raises(ValueError, match="no input alone drives an unstable machine"):
            design_experiment(rivals, noise=noise, amplitude=0.1, n_samples=200)


class TestDiagnosis:
    def test_a_ball_that_a_loop_holds_is_refitted(self, held):
        u, _, y = held
        dx = DiscrepancyRegressor(make_ball()).fit(u, y)
        assert dx.verdict_ == "refit"
        assert dx.parameters_.loc["force", "refitted"] == pytest.approx(FORCE, rel=0.002)
        assert dx.scores_.loc["refitted", "nrmse"] < 0.06 < dx.scores_.loc["nominal", "nrmse"]
        assert dx.score(u, y) > 0.98
        assert not [finding for finding in dx.data_findings_ if finding.code != "coarse_steps"]

    @pytest.mark.long
    def test_a_load_on_a_ball_that_a_loop_holds_is_named(self):
        u, _, y = held_ball(load=-0.6)
        dx = DiscrepancyRegressor(make_ball()).fit(u, y)
        assert dx.findings_[0].effect == "constant_load"
        assert dx.findings_[0].parameters["F"] == pytest.approx(-0.6, abs=0.1)
        assert dx.scores_.loc["augmented", "nrmse"] < dx.scores_.loc["refitted", "nrmse"]
        with pytest.raises(ValueError, match="at sample 1 of 3000"):
            dx.to_narx(u)

    @pytest.mark.long
    @pytest.mark.parametrize("seed", [0, 1])
    def test_a_pendulum_that_turns_over_is_refitted(self, seed):
        rng = np.random.default_rng(seed)
        u = np.repeat(rng.uniform(-2.5, 2.5, N // 20), 20)[:, None]
        true = make_pendulum(30.0, 20.0, 1.0).simulate(u)
        assert np.ptp(true) > 4 * np.pi
        y = true + 0.05 * rng.standard_normal(true.shape)
        dx = DiscrepancyRegressor(make_pendulum()).fit(u, y)
        assert dx.verdict_ == "refit"
        np.testing.assert_allclose(dx.parameters_["refitted"], [30.0, 20.0, 1.0], rtol=0.02)
        assert check_record(make_pendulum(), u, y) == ()


def turning(seed, n=4000, noise=0.01):
    """Return current and angle of a pendulum that turns over several times, and the noise of the latter."""
    rng = np.random.default_rng(seed)
    f = np.fft.rfftfreq(n, 0.01)
    lines = np.where((f >= 0.1) & (f <= 3.0), np.exp(2j * np.pi * rng.random(f.size)), 0)
    wave = np.fft.irfft(lines, n)
    u = (2.5 * wave / np.abs(wave).max())[:, None]
    y = make_pendulum(30.0, 20.0, 1.0).simulate(u)
    assert np.ptp(y) > 6 * np.pi
    return u, y + noise * y.std() * rng.standard_normal(y.shape), noise * y.std()


def settings_of(*codes):
    effects = tuple(CATALOGUE[code] for code in codes)
    return Settings(effects, 0.01, 2, 12, None, 0, 2, lambda text: None)


class TestWindows:
    @pytest.mark.parametrize("seed", [2, 9])
    def test_they_are_as_short_as_a_fit_from_afar_needs(self, seed):
        """Over a quarter of the record each, the refit left 23 and 44 times the noise."""
        u, y, sigma = turning(seed)
        problem, refitted, _, pace, _ = begin(
            make_pendulum(), u, y, [(slice(0, len(u)), 0)], settings_of("gravity")
        )
        assert problem.windows.count > len(u) / window_length(make_pendulum(), pace, len(u))
        left = np.sqrt(refitted.cost / problem.n_seen) * problem.noise.sigma[0]
        assert left < 1.05 * sigma
        np.testing.assert_allclose(refitted.model.p, [30.0, 20.0, 1.0], rtol=0.02)

    def test_they_stay_long_where_it_finds_its_way(self):
        rng = np.random.default_rng(0)
        u = np.repeat(rng.normal(0.0, 0.2, 40), 100)[:, None]  # it hangs
        y = make_pendulum(30.0, 20.0, 1.0).simulate(u)
        y = y + 0.01 * y.std() * rng.standard_normal(y.shape)
        problem, *_ = begin(make_pendulum(), u, y, [(slice(0, 4000), 0)], settings_of("gravity"))
        assert problem.windows.count == 4


def without_weight(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1]


@pytest.fixture(scope="module")
def told():
    """Return a record, the diagnosis over short windows, and one over long ones that explains nothing."""
    u, y, _ = turning(2, 2000)
    simulator = ODESimulator(
        without_weight,
        dt=0.01,
        parameters={"gain [rad/s^2/A]": 27.0, "damping [1/s]": 1.2},
        states=["angle [rad]", "rate [rad/s]"],
        inputs=["current [A]"],
    )
    record = simulator, u, y, [(slice(0, 1600), 0)]
    short = diagnose(*record, replace(settings_of("gravity"), window=80))
    assert short.verdict == "explained"
    long = short.problem.over(cut(record[3], 400, 12))
    x0 = np.zeros((long.windows.count, 2))
    nothing = Candidate(fit(long, fit_initial_states(long, x0).model), long.n_seen)
    of_long = {"problem": long, "refitted": nothing.fit, "best": nothing, "steps": (), "lengthened_from": 50}
    lost = replace(short, verdict="unknown", **of_long)
    return record, short, lost


class TestAgainOverShorterWindows:
    """Without its weight a pendulum is an integrator; over long windows a fit with the weight is lost."""

    @pytest.mark.long
    def test_what_they_tell_is_believed_where_it_leaves_less_of_long_ones(self, told, monkeypatch):
        record, short, lost = told
        asked = []

        def diagnosed(simulator, u, y, pieces, settings):
            asked.append(settings.window)
            return lost if settings.window is None else short

        monkeypatch.setattr(diagnosis, "_diagnosed", diagnosed)
        assert diagnose(*record, settings_of("gravity")) is short
        assert asked == [None, 141]  # halfway between 50 and 400

    @pytest.mark.long
    def test_else_what_long_ones_said_stands(self, told, monkeypatch):
        record, short, lost = told
        worse = replace(short, best=Candidate(short.refitted, short.problem.n_seen))
        better = replace(lost, best=short_over(lost, short))
        for again in (worse, replace(short, verdict="unknown")):
            answers = iter([better, again])
            monkeypatch.setattr(diagnosis, "_diagnosed", lambda *args, answers=answers: next(answers))
            assert diagnose(*record, settings_of("gravity")) is better

    @pytest.mark.long
    def test_a_simulation_that_is_lost_over_them_takes_nothing_away(self, told, monkeypatch):
        record, _, lost = told

        def diagnosed(simulator, u, y, pieces, settings):
            if settings.window is None:
                return lost
            raise DivergesError("The simulation diverges.")

        monkeypatch.setattr(diagnosis, "_diagnosed", diagnosed)
        assert diagnose(*record, settings_of("gravity")) is lost


def short_over(lost, short):
    """Return the effects of a diagnosis fitted over the windows of another."""
    x0 = short.problem.run(short.best.fit.model).x[lost.problem.windows.first]
    return Candidate(fit(lost.problem, short.best.fit.model._replace(x0=x0)), lost.problem.n_seen)


def running_away(x, u, p):
    """At rest where x - p x^3 = u, the largest of which is 2 / sqrt(27 p): with more it runs away."""
    return (p[0] * x[0] ** 3 - x[0] + u[0],)


class TestRunsThatAreLost:
    """The machine stays with inputs up to 0.5, and would to 0.54; as simulated it runs away from 0.31 on."""

    def problem(self, nominal=1.5, noise=0.001):
        rng = np.random.default_rng(0)
        u = np.repeat(rng.uniform(-0.5, 0.5, 20), 50)[:, None]
        machine, simulator = (
            ODESimulator(running_away, dt=0.1, parameters={"p": p}, states=["x"], inputs=["u"])
            for p in (0.5, nominal)
        )
        y = machine.simulate(u) + noise * rng.standard_normal(u.shape)
        windows = cut([(slice(0, len(u)), 0)], 50, 8)
        problem = Problem(simulator, u, y, windows, Noise.white(np.array([noise])))
        return problem, Model(simulator.nominal, (), y[windows.first])

    def test_windows_that_follow_the_machine_lead_a_fit_that_is_lost_in_others(self):
        problem, start = self.problem()
        lost = np.isnan(problem.run(start).y[problem.rows]).any(axis=(1, 2))
        assert 0 < lost.sum() < problem.windows.count / 2
        assert not np.isfinite(fit(problem, start).cost)
        found = fit_where_followed(problem, start)
        assert found.model.p == pytest.approx([0.5], rel=0.01)
        assert found.cost == pytest.approx(problem.n_seen, rel=0.15)

    def test_a_fit_that_follows_the_machine_everywhere_is_left_as_it_is(self):
        problem, start = self.problem(nominal=0.4)
        np.testing.assert_array_equal(fit_where_followed(problem, start).model.p, fit(problem, start).model.p)

    def test_nothing_leads_where_no_window_follows_the_machine(self):
        problem, start = self.problem(nominal=1e9)
        found = fit_where_followed(problem, start)
        assert found.cost == np.inf
        assert found.model.p == [1e9]

    def test_a_diagnosis_begins_so(self):
        problem, _ = self.problem()
        settings = Settings((), 0.005, 2, 4, 50, 0, None, lambda stage: None)
        begun = begin(problem.simulator, problem.u, problem.y, [(slice(0, len(problem.y)), 0)], settings)
        assert begun.refitted.model.p == pytest.approx([0.5], rel=0.01)

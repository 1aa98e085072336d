"""Is what is left over noise? False alarms under noise of many colours, and one positive for every sign."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import lfilter
from scipy.stats import rankdata

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.findings import where_it_follows
from narx_sklearn.discrepancy.fitting.acting import port_in_words
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.locate import tangent
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.followed import (
    followed,
    followed_slowly,
    followed_together,
    response,
)
from narx_sklearn.discrepancy.stages.remainder import (
    Remainder,
    Sign,
    _in_bursts,
    _loud,
    _shared,
    look_at_remainder,
)

N = 2000
DT = 0.02
STATES = ["position [m]", "velocity [m/s]"]
NAMES = ("gain [m/s^2/V]", "damping [1/s]", "stiffness [1/s^2]")
TRUE = (1.1, 0.7, 11.0)
LEVEL = 0.0025


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def pushed(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] + u[1]


def loosened(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * (1.0 + u[1]) * x[0]


def simulator(rhs=stage, values=TRUE, inputs=("drive [V]",)):
    parameters = dict(zip(NAMES, values, strict=True))
    return ODESimulator(rhs, dt=DT, parameters=parameters, states=STATES, inputs=list(inputs))


def levels(rng, n=N, hold=10):
    return np.repeat(rng.normal(0, 3, n // hold), hold)


def output(u, second=None, rhs=stage):
    """Return what the real stage does, a second input kept from the simulator."""
    if second is None:
        return simulator().simulate(u)[:, 0]
    return simulator(rhs, TRUE, ("drive [V]", "hidden")).simulate(np.column_stack([u, second]))[:, 0]


def setting(u, y, values=(1.0, 0.8, 12.0)):
    """Return the problem of a simulator with wrong parameters, its refitted model and its structure."""
    sim = simulator(values=values)
    windows = cut([(slice(0, len(u)), 0)], len(u) // 4, 12)
    u, y = u[:, None], y[:, None]
    problem = Problem(sim, u, y, windows, Noise.white(np.array([0.02])))
    found = fit(problem, Model(sim.nominal, (), np.zeros((windows.count, 2))))
    x = problem.run(found.model).x
    return problem, found.model, find_structure(sim, x, u)


def look(u, y) -> Remainder:
    return look_at_remainder(*setting(u, y), random_state=0)


def rescaled(signal):
    return signal / signal.std()


def coloured(kind, rng, n=N):
    white = rng.normal(size=n)
    if kind == "ar1":
        white = lfilter([1.0], [1.0, -0.9], white)
    elif kind == "a gusty load":
        white = white + 2 * rescaled(output(levels(rng, n, hold=1)))
    elif kind == "drifting":
        white = white + 0.05 * np.cumsum(rng.normal(size=n))
    elif kind == "heavy tails":
        white = rng.standard_t(3, size=n)
    return 0.02 * rescaled(white)


def in_closed_loop(rng, n=N):
    """Return input and recording of the stage under a controller that reads the coloured noise."""
    wanted, noise = levels(rng, n) / 10, coloured("ar1", rng, n)
    u, y, x = np.zeros(n), np.zeros(n), np.zeros(2)
    gain, damping, stiffness = TRUE
    step = expm(DT * np.array([[0.0, 1.0, 0.0], [-stiffness, -damping, gain], [0.0, 0.0, 0.0]]))
    for k in range(n):
        y[k] = x[0] + noise[k]
        u[k] = 12.0 * (wanted[k] - y[k])
        x = step[:2, :2] @ x + step[:2, 2] * u[k]
    return u, y


class TestFalseAlarms:
    @pytest.mark.parametrize("kind", ["white", "ar1", "a gusty load", "drifting", "heavy tails"])
    def test_noise_of_any_colour_is_noise(self, kind):
        chances = []
        for seed in range(4):
            rng = np.random.default_rng(seed)
            u = levels(rng)
            chances.append(look(u, output(u) + coloured(kind, rng)).p_value)
        assert min(chances) > LEVEL
        assert np.median(chances) > 0.05

    def test_a_step_of_the_converter_is_noise(self):
        rng = np.random.default_rng(1)
        u = levels(rng)
        y = np.round((output(u) + 0.004 * rng.normal(size=N)) / 0.04) * 0.04
        assert look(u, y).p_value > LEVEL

    def test_noise_that_a_controller_feeds_back_is_noise(self):
        assert min(look(*in_closed_loop(np.random.default_rng(seed))).p_value for seed in range(4)) > LEVEL

    def test_tests_share_the_level(self):
        remainder = Remainder((Sign("line", "", 0.001), Sign("size", "", 0.4), Sign("bursts", "", 0.5)))
        assert remainder.p_value == pytest.approx(0.003)
        assert [sign.kind for sign in remainder.speaking(0.01)] == ["line"]
        assert Remainder(()).p_value == 1.0


class TestSigns:
    def strongest(self, u, y):
        remainder = look(u, y)
        assert remainder.p_value <= LEVEL
        return min(remainder.signs, key=lambda sign: sign.p_value)

    def test_a_scale_that_errs_periodically_is_followed_at_the_output(self):
        rng = np.random.default_rng(0)
        u = levels(rng)
        y = output(u)
        y = y + 0.02 * np.sin(25.0 * y) + 0.02 * rng.normal(size=N)
        sign = self.strongest(u, y)
        assert sign.kind == "follows"
        assert sign.words == "It depends on position [m], acting on the output position."
        assert sign.port == Port("output", 0)

    def test_a_push_at_every_step_of_the_input_follows_how_fast_it_moves(self):
        rng = np.random.default_rng(2)
        u = levels(rng)
        y = output(u, 0.8 * np.abs(np.diff(u, prepend=u[0])), pushed) + coloured("ar1", rng)
        sign = self.strongest(u, y)
        assert sign.kind == "follows"
        assert sign.words.startswith("It depends on how fast drive [V] moves")
        assert sign.port is not None
        assert port_in_words(sign.port, simulator()) in sign.words

    def test_what_follows_signals_at_several_places_is_where_it_is_most(self):
        loud, soft = Port("input", 0), Port("state", 1)
        signs = (
            Sign("follows", "", 1e-4, gain=3.0, port=soft),
            Sign("pulse", "", 1e-3, gain=5.0, port=loud),
            Sign("bursts", "", 1e-9, gain=9.0),
        )
        assert where_it_follows(SimpleNamespace(against_noise=signs)) == loud
        assert where_it_follows(SimpleNamespace(against_noise=signs[2:])) is None

    def test_what_grows_with_the_position_follows_in_size(self):
        rng = np.random.default_rng(3)
        u = levels(rng)
        y = output(u)
        y = y + 0.02 * (0.3 + np.abs(rescaled(y))) * rng.normal(size=N)
        sign = self.strongest(u, y)
        assert sign.kind == "size"
        assert sign.words.startswith("Its size on position [m] depends on position [m]")

    def test_blows_come_in_bursts_at_their_times(self):
        rng = np.random.default_rng(4)
        u = levels(rng)
        blows, struck = np.zeros(N), (400, 1100, 1700)
        for k in struck:
            blows[k : k + 2] = 60.0
        sign = self.strongest(u, output(u, blows, pushed) + 0.005 * rng.normal(size=N))
        assert sign.kind == "bursts"
        times = [float(t.split()[0]) for t in sign.words.split(" round ")[1].split(", ")]
        # the first is hidden by the initial state of the window that it opens
        assert all(min(abs(t - k * DT) for t in times) < 0.5 for k in struck[1:])

    def test_faint_blows_are_clearer_on_all_outputs_at_once(self):
        rng = np.random.default_rng(0)
        struck = np.repeat(rng.random(N // 10) < 0.1, 10)  # bursts of ten samples, for a tenth of the time
        e = rng.normal(size=(N, 2)) * np.where(struck, 1.5, 1.0)[:, None]
        scores = -np.log1p(-rankdata(np.abs(e), axis=0) / (N + 1))
        scores = (scores - scores.mean(axis=0)) / scores.std(axis=0)

        def sign(*names):
            records = SimpleNamespace(
                simulator=SimpleNamespace(outputs=names, dt=DT), rows=np.arange(N)[None]
            )
            which = [["current", "speed"].index(name) for name in names]
            flat = (signal[:, which].reshape(1, -1) for signal in (scores, e))
            return _in_bursts(records, *flat, np.random.default_rng(1))

        both = sign("current", "speed")
        assert "on all outputs at once" in both.words
        assert both.p_value < min(sign("current").p_value, sign("speed").p_value) / 2

    @pytest.mark.parametrize("n_outputs", [1, 2, 6])
    def test_what_bursts_hold_is_their_excess_over_ordinary_noise_counted_as_costs_are(self, n_outputs):
        ordinary = np.linspace(1.0, 0.2, n_outputs)  # of the noise that costs are counted in: bursts made it
        e = np.random.default_rng(2).normal(size=(N, n_outputs)) * ordinary
        struck = np.zeros(N, dtype=bool)
        struck[600:616] = struck[1400:1416] = True
        e[struck] *= 5.0
        records = SimpleNamespace(simulator=SimpleNamespace(dt=DT), rows=np.arange(N)[None])
        when, gain = _loud(records, e, np.arange(N))
        times = [float(t.split()[0]) for t in when.removeprefix(" round ").split(", ")]
        assert all(min(abs(t - k * DT) for t in times) < 0.1 for k in (608, 1408))
        excess = np.sum(e[struck] ** 2 - ordinary**2)
        assert gain == pytest.approx(excess, rel=0.15)

    def test_a_hum_is_a_line_at_its_frequency(self):
        rng = np.random.default_rng(5)
        u = levels(rng)
        y = output(u) + 0.02 * np.sin(2 * np.pi * 7.3 * DT * np.arange(N)) + 0.02 * rng.normal(size=N)
        sign = self.strongest(u, y)
        assert sign.kind == "line"
        assert float(sign.words.split(" at ")[1].split()[0]) == pytest.approx(7.3, abs=0.03)

    def two_sensors(self, rng, gusts):
        u = levels(rng)
        inside = lfilter([1.0], [1.0, -0.8], rng.normal(size=N))
        both = simulator(pushed, TRUE, ("drive [V]", "hidden")).run(
            np.column_stack([u, gusts * inside]), cut([(slice(0, N), 0)], N, 12), np.zeros((1, 2))
        )
        sensors = np.stack([coloured("ar1", rng), 3.0 * coloured("ar1", rng)], axis=1)
        y = both.x + sensors
        parameters = dict(zip(NAMES, TRUE, strict=True))
        sim = ODESimulator(
            stage, dt=DT, parameters=parameters, states=STATES, inputs=["drive [V]"], outputs=STATES
        )
        windows = cut([(slice(0, N), 0)], N // 4, 12)
        problem = Problem(sim, u[:, None], y, windows, Noise.white(np.array([0.02, 0.06])))
        found = fit(problem, Model(sim.nominal, (), np.zeros((windows.count, 2))))
        structure = find_structure(sim, problem.run(found.model).x, u[:, None])
        return look_at_remainder(problem, found.model, structure, random_state=0)

    def test_what_moves_two_sensors_alike_acts_inside(self):
        sign = min(self.two_sensors(np.random.default_rng(7), gusts=1.0).signs, key=lambda sign: sign.p_value)
        assert sign.kind == "together"
        assert sign.words.startswith("It goes together on position [m] and velocity [m/s]")

    @pytest.mark.parametrize(("gusts", "seed"), [(0.0, 0), (0.05, 1)])
    def test_noise_of_two_sensors_and_faint_gusts_are_no_sign(self, gusts, seed):
        remainder = self.two_sensors(np.random.default_rng(seed), gusts)
        assert {sign.kind: sign.p_value for sign in remainder.signs}["together"] > 0.05
        assert remainder.p_value > LEVEL

    def test_damping_that_differs_by_position_is_no_noise(self):
        def rubbed(x, u, p):  # as a guide that is worn in the middle: neither a curve of x nor of v
            return x[1], p[0] * u[0] - p[1] * (1.0 + x[0] ** 2) * x[1] - p[2] * x[0]

        rng = np.random.default_rng(7)
        u = levels(rng)
        y = simulator(rubbed).simulate(u)[:, 0] + 0.2 * coloured("ar1", rng)
        (follows,) = (sign for sign in look(u, y).signs if sign.kind == "follows")
        assert len(look(u, y).signs) * follows.p_value <= LEVEL
        assert "position [m] squared times velocity [m/s]" in follows.words

    def test_a_sensor_that_has_to_recover_from_what_was_too_much_for_it_is_no_noise(self):
        """What it reads is off for 128 samples after each peak, as if it drifted."""
        rng = np.random.default_rng(8)
        u = levels(rng, 4000)
        true = output(u)
        over = np.sign(true) * np.maximum(np.abs(true) - 1.5 * true.std(), 0.0)
        y = true - lfilter([1 / 128], [1.0, 1 / 128 - 1.0], 2.0 * over) + coloured("white", rng, 4000)
        (follows,) = (sign for sign in look(u, y).signs if sign.kind == "follows")
        assert len(look(u, y).signs) * follows.p_value <= LEVEL
        # slower than the machine, it does the same before and after it
        assert "the cube of " in follows.words
        assert "forgotten within" in follows.words
        assert follows.port in {Port("input", 0), Port("output", 0)}

    def test_a_stiffness_modulated_in_time_is_no_noise(self):
        rng = np.random.default_rng(6)
        u = levels(rng)
        swing = 0.8 * np.sin(5.0 * DT * np.arange(N) + 1.0)
        assert look(u, output(u, swing, loosened) + coloured("ar1", rng) / 2).p_value <= LEVEL


class TestFollowed:
    def test_inputs_are_late_where_noise_is_fed_back(self):
        rng = np.random.default_rng(0)
        u = levels(rng)
        problem, model, structure = setting(u, output(u) + coloured("white", rng))
        run = problem.run(model)
        words = [f.words for f in followed(problem, run, structure, 2, past=1)]
        assert [w for w in words if "drive" in w and "before" not in w] == []
        assert "the direction of drive [V] 1 sample before" in words
        assert words.count("position [m]") == 2  # two cosines, at the sample itself
        assert not [w for w in words if "rate of position" in w or "direction of position" in w]

    def test_products_are_of_two_signals_within_their_ranges(self):
        rng = np.random.default_rng(0)
        u = levels(rng)
        problem, model, _ = setting(u, output(u) + coloured("white", rng))
        run = problem.run(model)
        found = {f.words: f.values for f in followed_together(problem, run, past=1)}
        assert len(found) == 9  # three pairs of one input and two states, three products each
        x, v = (s - (np.quantile(s, 0.005) + np.quantile(s, 0.995)) / 2 for s in run.x.T)
        got = found["position [m] squared times velocity [m/s]"]
        assert np.corrcoef(got, x * x * v)[0, 1] > 0.98  # but for the ends, which are cut off
        assert "drive [V] times position [m] 1 sample before" in found

    def test_what_is_forgotten_was_once_and_in_the_same_session(self):
        u = np.zeros(1200)
        u[200:300] = 1.0
        u[780:800] = 1.0
        windows = cut([(slice(0, 800), 0), (slice(800, 1200), 800)], 200, 12)
        problem = Problem(simulator(), u[:, None], np.zeros((1200, 1)), windows, Noise.white(np.ones(1)))
        run = problem.run(Model(simulator().nominal, (), np.zeros((windows.count, 2))))
        found = {f.words: f.values for f in followed_slowly(problem, run, past=0)}
        wave = found["the cube of drive [V], forgotten within 16 samples"]
        at, after, long_after = wave[[299, 315, 700]]
        assert (after - long_after) / (at - long_after) == pytest.approx(np.exp(-1), abs=0.005)
        assert wave[799] > wave[700] + 0.5 * (at - long_after)
        assert wave[800] == pytest.approx(wave[0])  # nothing of the session before
        late = {f.words: f.values for f in followed_slowly(problem, run, past=1)}
        assert not set(late) & {words for words in found if "drive" in words}

    def test_each_is_what_the_signal_was_so_long_ago(self):
        rng = np.random.default_rng(0)
        u = levels(rng)
        problem, model, structure = setting(u, output(u) + coloured("white", rng))
        found = {f.words: f.values for f in followed(problem, problem.run(model), structure, 1)}
        late = found["drive [V] 16 samples before"]
        assert np.corrcoef(late[16:], u[:-16])[0, 1] == pytest.approx(1.0)
        assert np.all(late[:16] == 0)

    def test_neither_rates_nor_the_past_reach_across_sessions_and_gaps(self):
        """Ramps of one slope: nothing moves faster where one session follows another."""
        u = 0.01 * np.concatenate([np.arange(300), np.arange(300)])
        u += 0.001 * np.random.default_rng(0).normal(size=600)
        u[500:520] = np.nan
        pieces = [(slice(0, 300), 0), (slice(300, 500), 300), (slice(520, 600), 300)]
        windows = cut(pieces, 100, 12)
        problem = Problem(simulator(), u[:, None], np.zeros((600, 1)), windows, Noise.white(np.ones(1)))
        run = problem.run(Model(simulator().nominal, (), np.zeros((windows.count, 2))))
        structure = find_structure(simulator(), run.x[:300], u[:300, None])
        found = {f.words: f.values for f in followed(problem, run, structure, 1)}
        late, rate = found["drive [V] 16 samples before"], found["the rate of drive [V]"]
        assert np.all(late[300:316] == 0)  # the mean: nothing is known of it
        assert np.all(late[316:516] != 0)
        assert np.all(rate[[0, 300, *range(500, 521)]] == 0)
        together = {f.words: f.values for f in followed_together(problem, run, past=1)}
        assert together["drive [V] times position [m] 1 sample before"][300] == 0

    @pytest.mark.parametrize("port", [Port("state", 1), Port("input", 0), Port("output", 0)])
    def test_responses_are_those_of_the_simulator_with_a_small_force(self, port):
        rng = np.random.default_rng(1)
        u = levels(rng, 200)
        windows = cut([(slice(0, 200), 0)], 200, 12)
        sim, small = simulator(), 1e-4
        problem = Problem(sim, u[:, None], np.zeros((200, 1)), windows, Noise.white(np.ones(1)))
        run = sim.run(u[:, None], windows, np.zeros((1, 2)))
        w = rng.normal(size=200)
        moved = {
            "state": lambda: output(u, small * w, pushed),
            "input": lambda: output(u + small * w),
            "output": lambda: output(u) + small * w,
        }[port.kind]()
        linear = tangent(sim, run, u[:, None], windows)
        got = response(problem, linear, port, w[:, None])[:, 0, 0]
        np.testing.assert_allclose(got, (moved - output(u)) / small, atol=1e-6)


@pytest.fixture(scope="module")
def diagnosed():
    rng = np.random.default_rng(0)
    u = levels(rng, 2500)
    y = output(u)
    y = y + 0.02 * np.sin(8.0 * np.gradient(y, DT)) + 0.02 * rng.normal(size=u.size)
    nominal = simulator(values=(1.0, 0.8, 12.0))
    effects = ["coulomb_friction", "gain_drift"]
    return DiscrepancyRegressor(nominal, effects=effects, max_effects=1, n_leaders=2).fit(u, y), u, y


@pytest.mark.long
class TestDiagnosis:
    def test_what_has_no_name_is_unknown_at_its_port(self, diagnosed):
        dx, _, _ = diagnosed
        assert dx.verdict_ == "unknown"
        assert dx.p_value_ <= dx.alpha / 2
        (finding,) = dx.findings_
        assert (finding.effect, finding.port) == ("unknown", "output:0")
        assert "follows" in finding.evidence
        assert not finding.modelled
        assert finding.place == "on the output position"

    def test_it_is_told_what_the_unknown_signal_is_like(self, diagnosed):
        dx, _, _ = diagnosed
        assert dx.location_.against == ("position [m]", "velocity [m/s]", "drive [V]")
        readings = dx.location_.invariances["reading"]
        told = readings[["memory", "time period"]].tolist()  # a sine of how fast it moves
        assert told == ["no memory seen", "not tied to time"]
        assert readings["memoryless"] == "noise or something else beside a function of x, v, u"
        assert "with x = position [m], v = velocity [m/s] and u = drive [V]: " in dx.report_

    def test_the_simulation_stays_the_refitted_one(self, diagnosed):
        dx, u, _ = diagnosed
        np.testing.assert_array_equal(dx.simulator_.simulate(u), dx.refitted_simulator_.simulate(u))

    def test_the_report_says_what_speaks_against_noise_and_what_to_try(self, diagnosed):
        dx, _, _ = diagnosed
        assert "What is left over is no noise. It depends on velocity [m/s]" in dx.report_
        assert "What would tell more: an effect of your own" in dx.report_
        assert "comes nearest" not in dx.report_

    def test_the_html_report_shows_it_without_a_curve(self, diagnosed):
        pytest.importorskip("jinja2")
        pytest.importorskip("matplotlib")
        from narx_sklearn.report import render_report

        dx, u, y = diagnosed
        page = render_report(dx, u, y)
        assert "the likeliest place is on the output position" in page
        assert "What would tell more: an effect of your own" in page


def test_a_ripple_of_many_waves_in_a_reading_is_told_as_one():
    rng = np.random.default_rng(0)
    u = levels(rng, 2500)
    y = output(u)
    y = y + 0.02 * np.sin(25.0 * y) + 0.02 * rng.normal(size=u.size)
    found = DiscrepancyRegressor(simulator(values=(1.0, 0.8, 12.0)), effects=["coulomb_friction"]).fit(u, y)
    (finding,) = found.findings_
    assert (found.verdict_, finding.effect, finding.port) == ("unknown", "unknown", "output:0")
    assert finding.parameters["N"] == pytest.approx(25.0, rel=0.005)
    assert finding.parameters["b"] == pytest.approx(0.02, rel=0.15)


def test_an_unknown_signal_of_a_machine_without_inputs_is_described_too():
    def swinging(x, u, p):
        return x[1], -p[0] * x[0]

    nominal = ODESimulator(swinging, dt=0.05, parameters={"k": 4.0}, states=["x", "v"], inputs=[])
    y = np.sin(0.1 * np.arange(600.0))
    dx = DiscrepancyRegressor(nominal, effects=["coulomb_friction"]).fit(np.zeros((600, 0)), y)
    assert dx.verdict_ == "unknown"
    assert dx.location_.against[-1] == "no input"


@pytest.mark.parametrize("length", [4, 9, 300])
def test_what_two_outputs_share_is_told_in_windows_of_any_length(length):
    one, noise = np.random.default_rng(0).normal(size=(2, 400, length))
    assert _shared(one, 2.0 * one) == pytest.approx(1.0)
    assert _shared(one, noise) < 0.1


@pytest.mark.long
def test_what_only_the_remainder_hears_gets_its_name():
    """A ripple of eleven waves a radian, half as large as noise with a memory: no line in time, and faint."""

    def cogged(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] + 0.55 * np.sin(11.0 * x[0] + 2.6)

    def plain(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]

    def pendulum(equations, *values):
        names = "gain [rad/s^2/A]", "damping [1/s]", "spring [1/s^2]"
        return ODESimulator(
            equations,
            dt=0.01,
            parameters=dict(zip(names, values, strict=True)),
            states=["angle [rad]", "rate [rad/s]"],
            inputs=["motor [A]"],
        )

    rng = np.random.default_rng(4)
    time = np.arange(4000) * 0.01
    waves = np.arange(0.1, 4.0, 0.1)[:, None]
    u = np.sin(2 * np.pi * waves * time + rng.uniform(0, 6.28, (waves.size, 1))).sum(axis=0)
    u *= 0.65 / np.std(u)
    y = pendulum(cogged, 34.9, 3.66, 41.8).simulate(u)[:, 0]
    y += 0.0125 * lfilter([np.sqrt(1 - 0.81)], [1, -0.9], rng.standard_normal(time.size))
    dx = DiscrepancyRegressor(pendulum(plain, 28.66, 4.41, 36.6), random_state=0).fit(u, y)
    assert [finding.effect for finding in dx.findings_] == ["cogging"]
    assert dx.findings_[0].parameters["N"] == pytest.approx(11.0, rel=0.05)

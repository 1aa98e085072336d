"""What acts behind an actuator's own lag: between a spool and what flows, a motor and what it turns."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.as_narx import effect_regressors
from narx_sklearn.discrepancy.findings import parameter_units, place_in_words
from narx_sklearn.discrepancy.fitting.acting import state_forces
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.places import placements
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.physics.effects import CATALOGUE, Effect, EffectParameter, register_effect

DT = 0.02
ACTING = [effect for effect in CATALOGUE.values() if effect.handed_on and "input" in effect.ports]


def cylinder(x, u, p):
    spool, speed = x[0], x[1]
    return (u[0] - spool) / p[0], p[1] * spool * (1.0 - 0.1 * speed) - p[2] * speed


def make(equations=cylinder, lag=0.08, gain=6.0, damping=2.0, **shown):
    shown = shown or {"outputs": ["speed [m/s]"], "output": [1]}
    return ODESimulator(
        equations,
        dt=DT,
        parameters={"lag [s]": lag, "gain [m/s^2/V]": gain, "damping [1/s]": damping},
        states=["spool [V]", "speed [m/s]"],
        inputs=["valve [V]"],
        **shown,
    )


def slowly(u, before=lambda s: s, follows=lambda v: v, behind=lambda s: s):
    """Return the speed at each sample, by small steps of Euler's kind: an independent twin."""
    return with_flow(u, before, follows, behind)[:, 0]


def with_flow(u, before=lambda s: s, follows=lambda v: v, behind=lambda s: s):
    """Return the speed and the flow at each sample."""
    speed, spool, told, h = 0.0, 0.0, [], DT / 20
    for command in u:
        for step in range(20):
            passed = behind(spool)
            if step == 0:
                told.append((speed, 6.0 * passed))
            speed += h * (6.0 * passed * (1.0 - 0.1 * speed) - 2.0 * speed)
            spool += h * follows((before(command) - spool) / 0.08)
    return np.array(told)


def play_of(half_width):
    """Return a function that follows with a play."""
    at = [0.0]

    def follows(s):
        at[0] = min(max(at[0], s - half_width), s + half_width)
        return at[0]

    return follows


def structure_of(simulator):
    u = np.random.default_rng(0).normal(size=(200, len(simulator.inputs)))
    x = simulator.run(u, Windows.whole([slice(0, 200)]), np.zeros((1, len(simulator.states)))).x
    return find_structure(simulator, x, u)


def behind(code, simulator):
    """Return an effect at the one place behind an actuator that a simulator has."""
    (placed,) = (p for p in placements(CATALOGUE[code], simulator, structure_of(simulator)) if p.handed_on)
    return placed


def test_which_states_follow_an_input_and_drive_others():
    assert structure_of(make()).handed_on == [0]
    assert {effect.code for effect in ACTING} == {
        "backlash",
        "dead_zone",
        "input_saturation",
        "input_polynomial",
        "valve_stiction",
        "prandtl_ishlinskii",
    }


def test_an_amplifier_follows_its_input_by_a_gain():
    """Where it rests a parameter says too; how soon it is there another one does."""

    def amplified(x, u, p):
        return (p[1] * u[0] - x[0]) / p[0], x[0] - p[2] * x[1]

    def paced_by_others(x, u, p):
        return (p[1] * u[0] + 0.1 * x[1] - x[0]) / p[0], x[0] - p[2] * x[1]

    assert structure_of(make(amplified)).handed_on == [0]
    assert structure_of(make(paced_by_others)).handed_on == []


@pytest.mark.long
@pytest.mark.parametrize("step", [0.0, 2.0])
def test_a_stack_with_many_plays_behind_its_amplifier_is_told_there(step):
    """Its hysteresis, of plays with weights of their own, is no hysteresis of the command.

    Nor is what rounding leaves, where the reading is written in coarse steps, anything that names leave.
    """
    half_widths, weights = np.array([4.0, 9.0, 15.0, 23.0, 34.0]), np.array([1.0, 0.8, 0.65, 0.5, 0.4])

    def stage(lag, gain, damping):
        def rates(x, u, p):
            return (p[1] * u[0] - x[0]) / p[0], x[2], 900.0 * (0.6 * x[0] - x[1]) - p[2] * x[2]

        return ODESimulator(
            rates,
            dt=DT,
            parameters={"lag [s]": lag, "gain": gain, "damping [1/s]": damping},
            states=["amplifier [V]", "x [um]", "v [um/s]"],
            inputs=["command [V]"],
            output=[1],
            outputs=["x [um]"],
        )

    rng = np.random.default_rng(4)
    command = np.repeat(rng.uniform(-4.0, 4.0, 150), 20)
    plays, (voltage, x, v), y, h = np.zeros(5), (0.0, 0.0, 0.0), [], DT / 40
    for u in command:
        y.append(x)
        for _ in range(40):
            plays = np.clip(plays, voltage - half_widths, voltage + half_widths)
            driven = voltage - 0.12 * weights @ (voltage - plays)
            x += h * v
            v += h * (900.0 * (0.6 * driven - x) - 25.0 * v)
            voltage += h * (14.0 * u - voltage) / 0.06
    y = np.array(y)[:, None]
    y = step * np.round(y / step) if step else y + 0.3 * rng.standard_normal(y.shape)
    effects = ["prandtl_ishlinskii", "backlash", "lag", "input_polynomial", "bouc_wen_hysteresis"]
    dx = DiscrepancyRegressor(stage(0.05, 12.5, 22.0), effects=effects, random_state=0)
    dx.fit(command[:, None], y)
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.effect, str(finding.port)) == ("explained", "prandtl_ishlinskii", "state:0")
    assert dx.parameters_.loc["lag", "augmented"] == pytest.approx(0.06, rel=0.05)


def test_a_store_is_no_actuator():
    """What it holds at rest depends on how it leaks, so a parameter moves it."""

    def tanks(x, u, p):
        return p[0] * u[0] - p[1] * x[0], p[1] * x[0] - p[2] * x[1]

    assert structure_of(make(tanks)).handed_on == []


def test_what_feels_others_or_drives_none_is_none():
    def motor(x, u, p):
        return (u[0] - x[0]) / p[0] - 0.1 * x[1], p[1] * x[0] - p[2] * x[1]

    def alone(x, u, p):
        return (u[0] - x[0]) / p[0], p[1] * u[0] - p[2] * x[1]

    assert structure_of(make(motor)).handed_on == []
    assert structure_of(make(alone)).handed_on == []


@pytest.mark.parametrize("effect", [effect for effect in ACTING if effect.memoryless], ids=str)
@given(
    values=st.lists(st.floats(-4.0, 4.0), min_size=1, max_size=8),
    theta=st.tuples(
        st.floats(0.0, 2.0), st.floats(-1.0, 1.0), st.floats(0.0, 0.8), st.sampled_from([0.0, 1.0])
    ),
)
def test_it_is_what_it_does_to_an_input(effect, values, theta):
    signal = np.array(values)
    theta = np.array([-theta[0] - 0.1, theta[1] + 1.1, theta[2], 0.0] if effect.levels else theta)
    unused = np.zeros(1)
    added = [effect.handed_on(s, 0.0, s, 0.0, 0.0, DT, unused, theta, unused) for s in values]
    at_input = effect.transform(signal, None, DT, theta, [0]) - signal
    np.testing.assert_allclose(added, at_input, rtol=1e-9, atol=1e-9)


def stem_along(values, theta):
    """Return the stem at values that a spool goes through one after another."""
    sticking, z = CATALOGUE["valve_stiction"], np.zeros(4)
    stem = []
    for value in values:
        now = np.zeros(4)
        stem.append(value + sticking.handed_on(value, 0.0, value, 0.0, 0.0, DT, z, theta, now))
        z = now
    return np.array(stem)


@given(
    values=st.lists(st.floats(-4.0, 4.0), min_size=1, max_size=20),
    theta=st.tuples(*[st.floats(0.0, 2.0), st.floats(0.0, 1.0), st.floats(-1.0, 1.0)]),
)
def test_a_stem_that_slides_behind_it_is_one_that_slides_at_an_input(values, theta):
    sticking, theta = CATALOGUE["valve_stiction"], np.array([*theta[:2], 0.0, theta[2]])
    at_input = sticking.transform(np.array(values), None, DT, theta, [0])
    np.testing.assert_allclose(stem_along(values, theta), at_input, atol=1e-12)


@given(
    values=st.lists(st.floats(-4.0, 4.0), min_size=1, max_size=8),
    theta=st.tuples(*[st.floats(0.3, 2.0), st.floats(0.2, 1.0), st.floats(0.3, 1.0), st.floats(-1.0, 1.0)]),
)
def test_a_stem_that_sticks_again_goes_in_steps_however_far_the_spool_goes_in_one(values, theta):
    """At an input it is where the command jumped to; a spool gets there through all values between."""
    theta, finely = np.array(theta), [values[0]]
    for before, after in pairwise(values):
        finely += np.linspace(before, after, 501)[1:].tolist()
    off = np.abs(stem_along(values, theta) - stem_along(finely, theta)[::500])
    of_a_step = 8.0 / 500  # that the spool may have gone on when it is asked
    step = theta[0] * theta[1] * theta[2]
    assert np.all((off <= of_a_step + 1e-9) | (np.abs(off - step) <= of_a_step + 1e-9))


@pytest.mark.parametrize("o", [0.0, 1.0])
def test_against_equations_that_have_it(o):
    d, c = 0.4, 0.1

    def overlapped(x, u, p):
        spool, speed = x[0], x[1]
        passed = spool - min(max(spool - c, -d), d) - o * c
        return (u[0] - spool) / p[0], p[1] * passed * (1.0 - 0.1 * speed) - p[2] * speed

    u = np.repeat(np.random.default_rng(1).uniform(-2, 2, 30), 20)
    placed = behind("dead_zone", make()).at([d, c, 0.0, o])
    with_effect, written = make().with_effects([placed]), make(overlapped)
    np.testing.assert_allclose(with_effect.simulate(u), written.simulate(u), atol=1e-12)
    whole = Windows.whole([slice(0, u.size)])
    run = with_effect.run(u[:, None], whole, np.zeros((1, 2)))
    np.testing.assert_array_equal(run.x[:, 0], make().run(u[:, None], whole, np.zeros((1, 2))).x[:, 0])
    rows = np.arange(0, u.size, 7)
    argument, added = state_forces(with_effect, run, u[:, None], whole, rows)[0]
    np.testing.assert_array_equal(argument, run.x[rows, 0])
    np.testing.assert_allclose(added, -np.clip(argument - c, -d, d) - o * c)
    assert effect_regressors(with_effect) == ()  # no signal of the record is that state


def test_a_play_behind_it_is_that_of_the_state():
    u = np.repeat(np.random.default_rng(3).uniform(-2, 2, 30), 20)
    play = behind("backlash", make())
    assert play.at([1.0, 0.3, 0.0, 0.0]).bounds[0].tolist() == [1.0, 1.0]  # all of the motion is lost
    whole, none = Windows.whole([slice(0, u.size)]), np.zeros((1, 2))
    fine = make().run(u[:, None], whole, none)
    run = make().with_effects([play.at([1.0, 0.3, 0.0, 0.0])]).run(u[:, None], whole, none)
    np.testing.assert_array_equal(run.x[:, 0], fine.x[:, 0])
    passed = play_of(0.3)
    told = slowly(u, behind=passed)
    assert np.abs(run.x[:, 1] - told).max() < 0.02 * np.std(told)  # of the step in which it begins


def measured(flow=lambda x, u, p: p[1] * x[0], equations=cylinder, **parameters):
    """Return the cylinder with a meter of what flows, which is made of where the spool is."""

    def shown(x, u, p):
        return x[1], flow(x, u, p)

    return make(equations, **parameters, outputs=["speed [m/s]", "flow [l/min]"], output=shown)


@pytest.mark.parametrize("code", ["dead_zone", "backlash"])
def test_outputs_made_of_the_state_may_have_it_too(code):
    """A meter behind a valve shows what gets through it, one on the spool where that is."""
    simulator = measured()
    found = placements(CATALOGUE[code], simulator, structure_of(simulator))
    hidden, seen = (p for p in found if p.handed_on)
    assert (hidden.is_seen, seen.is_seen) == (False, True)
    assert hidden.place != seen.place
    theta = [0.3, 0.0, 0.0, 0.0] if code == "dead_zone" else [1.0, 0.3, 0.0, 0.0]
    u = np.repeat(np.random.default_rng(2).uniform(-2, 2, 25), 8)
    speed, flow = simulator.with_effects([seen.at(theta)]).simulate(u).T
    run = simulator.with_effects([hidden.at(theta)]).run(
        u[:, None], Windows.whole([slice(0, u.size)]), np.zeros((1, 2))
    )
    np.testing.assert_allclose(speed, run.y[:, 0], atol=1e-12)
    spool = run.x[:, 0]
    np.testing.assert_allclose(run.y[:, 1], 6.0 * spool)
    play = play_of(0.3)
    behind = spool - np.clip(spool, -0.3, 0.3) if code == "dead_zone" else [play(s) for s in spool]
    np.testing.assert_allclose(flow, 6.0 * np.array(behind), atol=0.02)
    assert place_in_words(seen, simulator) == "behind spool, as the other equations and the outputs have it"


def test_a_sensor_that_lags_has_it_between_samples_too():
    """It is asked half a sample on, and a whole one: there the same is handed on."""

    def bent(spool):
        return spool + 0.2 * spool**2

    def written(x, u, p):
        return (u[0] - x[0]) / p[0], p[1] * bent(x[0]) * (1.0 - 0.1 * x[1]) - p[2] * x[1]

    simulator, twin = measured(), measured(lambda x, u, p: p[1] * bent(x[0]), written)
    found = placements(CATALOGUE["input_polynomial"], simulator, structure_of(simulator))
    seen = next(p for p in found if p.is_seen).at([0.2, 0.0, 0.0])
    lag = PlacedEffect(CATALOGUE["lag"], Port("output", 1)).at([0.05, 0.0, 0.0])
    u = np.repeat(np.random.default_rng(2).uniform(-2, 2, 25), 8)
    shown, wanted = simulator.with_effects([seen, lag]).simulate(u), twin.with_effects([lag]).simulate(u)
    np.testing.assert_allclose(shown, wanted, atol=1e-3)
    assert np.abs(wanted - simulator.with_effects([lag]).simulate(u)).max() > 1.0


@pytest.mark.parametrize(("code", "more"), [("rate_limit", ()), ("asymmetric_rate_limit", (0.4,))])
def test_how_fast_it_follows_may_be_limited(code, more):
    down, up = 5.0 * (1.0 - sum(more)), 5.0 * (1.0 + sum(more))

    def limited(x, u, p):
        spool, speed = x[0], x[1]
        return min(max((u[0] - spool) / p[0], -down), up), p[1] * spool * (1.0 - 0.1 * speed) - p[2] * speed

    u = np.repeat(np.random.default_rng(1).uniform(-2, 2, 30), 20)
    limits = placements(CATALOGUE[code], make(), structure_of(make()))
    (placed,) = (p.at([5.0, 0.0, 0.0, *more]) for p in limits if p.is_how_it_follows)
    assert placed.bounds.tolist() == [[0.0, np.inf], [0.0, 0.0], [0.0, 0.0], *[[-1.0, 1.0] for _ in more]]
    assert placed.n_values == 1 + len(more)
    with_effect = make().with_effects([placed])
    np.testing.assert_allclose(with_effect.simulate(u), make(limited).simulate(u), atol=1e-12)
    assert parameter_units(placed, make())[0] == "V/s"


@pytest.mark.parametrize(
    ("equation", "is_paced"),
    [
        (lambda x, u, p: (x[1], (min(max(p[2] * (u[0] - x[0]), -9.0), 9.0) - x[1]) / p[0]), True),
        (lambda x, u, p: (x[1], p[0] * (p[1] * (u[0] - x[0]) - x[1])), True),
        (lambda x, u, p: (x[1], (p[2] * (u[0] - x[0]) - p[1] * x[1]) / p[0]), False),  # by an inertia
        (lambda x, u, p: (x[1], (u[0] - x[0]) / p[0] - x[1]), False),
    ],
)
def test_what_a_controller_drives_may_be_limited_in_how_fast_it_follows(equation, is_paced):
    """A gate's or a brake's: (g - x)/T or w (g - x), whatever g is."""
    servo = ODESimulator(
        equation,
        dt=DT,
        parameters={"T": 0.2, "b": 3.0, "kp": 4.0},
        states=["position [m]", "speed [m/s]"],
        inputs=["reference [m]"],
    )
    rng = np.random.default_rng(0)
    found = find_structure(servo, rng.normal(size=(50, 2)), rng.normal(size=(50, 1)))
    assert found.paced.tolist() == [False, is_paced]
    limits = [p for p in placements(CATALOGUE["rate_limit"], servo, found) if p.is_how_it_follows]
    assert [str(p.port) for p in limits] == ["state:1"] * is_paced


def test_an_effect_of_ones_own_may_act_there():
    def half(argument, rate, own, second, time, step, z, theta, dz):
        return -theta[0] * argument

    own = Effect(
        "test_halved",
        "Halved",
        "Less arrives.",
        "(1 - q) s",
        (EffectParameter("q", "-", 0.0, 1.0),),
        lambda setting: np.array([[0.5]]),
        transform=lambda signal, second, dt, theta, first: (1 - theta[0]) * signal,
        handed_on=half,
    )
    try:
        register_effect(own)
        placed = PlacedEffect(own, Port("state", 0), (1.0, 0.0), theta=(0.5,), handed_on=True)
        u = np.ones(400)
        halved = make().with_effects([placed]).simulate(u)[-1, 0]
        assert halved == pytest.approx(3.0 / 2.3, rel=1e-6)  # 6 s (1 - v/10) = 2 v with s = 1/2
    finally:
        CATALOGUE.pop("test_halved", None)


def diagnosed(meter=False, **what):
    """Return the diagnosis of a cylinder; a valve has something before its spool's lag, in it or behind."""
    rng = np.random.default_rng(2)
    u = np.repeat(rng.uniform(-2.0, 2.0, 150), 12)
    simulator, run = (measured, with_flow) if meter else (make, slowly)
    y = run(u, **what)
    y = y + 0.03 * np.std(y, axis=0) * rng.standard_normal(y.shape)
    return DiscrepancyRegressor(simulator(lag=0.07, gain=5.4, damping=2.2), random_state=0).fit(u, y)


@pytest.mark.parametrize(
    ("effect", "passed", "told"),
    [
        ("dead_zone", lambda s: s - min(max(s, -0.4), 0.4), {"d": 0.4}),
        pytest.param(
            "input_saturation",
            lambda s: min(max(s, -1.0), 1.2),
            {"low": -1.0, "high": 1.2},
            marks=pytest.mark.long,
        ),
    ],
)
def test_it_is_named_behind_the_actuator(effect, passed, told):
    dx = diagnosed(behind=passed)
    finding = dx.findings_[0]
    assert (dx.verdict_, finding.effect, finding.port) == ("explained", effect, "state:0")
    assert "behind spool, as the other equations have it" in dx.report_
    for name, value in told.items():
        assert finding.parameters[name] == pytest.approx(value, rel=0.05)
    lag = {p.name: p.value for p in dx.simulator_.parameters}["lag"]
    assert lag == pytest.approx(0.08, rel=0.05)


@pytest.mark.long
def test_what_acts_before_it_is_named_there():
    dx = diagnosed(before=lambda s: s - min(max(s, -0.4), 0.4))
    finding = dx.findings_[0]
    assert (dx.verdict_, finding.effect, finding.port) == ("explained", "dead_zone", "input:0")
    assert finding.parameters["d"] == pytest.approx(0.4, rel=0.05)


@pytest.mark.long
def test_a_limit_of_how_fast_it_follows_is_named_in_its_equation():
    dx = diagnosed(follows=lambda v: min(max(v, -12.0), 12.0))
    finding = dx.findings_[0]
    assert (dx.verdict_, finding.effect, finding.port) == ("explained", "rate_limit", "state:0")
    assert finding.parameters["r"] == pytest.approx(12.0, rel=0.05)


def stem_of(stick, slip):
    """Return a function that says where a stem is which sticks, and slides when it is let go."""
    at = [0.0, 0.0, 0.0]  # the stem, the direction of its slide, the spool before

    def follows(s):
        stem, direction, before = at
        direction = direction if (s - before) * direction > 0 else 0.0
        withheld, trailing = s - stem, (stick - slip) / 2
        if abs(withheld) > (trailing if direction else (stick + slip) / 2):
            direction = np.sign(withheld)
            stem = s - direction * trailing
        at[:] = stem, direction, s
        return stem

    return follows


@pytest.mark.long
@pytest.mark.parametrize("meter", [False, True])
def test_a_stem_that_sticks_is_named_behind_it(meter):
    """A meter of what flows shows the stem itself."""
    dx = diagnosed(meter, behind=stem_of(0.8, 0.3))
    finding = dx.findings_[0]
    assert (dx.verdict_, finding.effect, finding.port) == ("explained", "valve_stiction", "state:0")
    assert ("and the outputs have it" in dx.report_) == meter
    assert finding.parameters["S"] == pytest.approx(0.8, rel=0.05)
    assert finding.parameters["j"] == pytest.approx(0.3 / 0.8, rel=0.05)


@pytest.mark.long
def test_a_play_is_named_behind_it():
    dx = diagnosed(behind=play_of(0.3))
    finding = dx.findings_[0]
    assert (finding.effect, finding.port) == ("backlash", "state:0")
    assert finding.parameters["b"] == pytest.approx(0.3, rel=0.05)

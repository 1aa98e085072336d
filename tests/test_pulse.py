"""A parameter that comes and goes at one frequency: seen in what is left over, told, and modelled."""

import numpy as np
import pytest

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.locate import tangent
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.bank import out_of
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.harmonics import SINE
from narx_sklearn.discrepancy.search.unnamed.kinds import BY_TURNS, PULSE, WORDS
from narx_sklearn.discrepancy.search.unnamed.proportions import pulse_hypotheses
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages import refuted
from narx_sklearn.discrepancy.stages.followed import response
from narx_sklearn.discrepancy.stages.pulse import gradients_by_force, strongest_pulse
from narx_sklearn.discrepancy.stages.remainder import Remainder, Sign
from narx_sklearn.physics.effects import CATALOGUE
from narx_sklearn.report._words import headline

DT, HERTZ, SIGMA = 0.02, 3.7, 0.004
NAMES, NOMINAL = ("b", "c", "k [1/s^2]"), (1.0, 0.5, 12.0)


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def softened(x, u, p):
    """A spring of which a wheel, u[1], takes and gives a part."""
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * (1.0 + u[1]) * x[0]


def rippled(x, u, p):
    """A drive on a supply that ripples."""
    return x[1], p[0] * (1.0 + u[1]) * u[0] - p[1] * x[1] - p[2] * x[0]


def make(rhs=stage, inputs=("u [V]",), values=NOMINAL):
    parameters = dict(zip(NAMES, values, strict=True))
    return ODESimulator(rhs, dt=DT, parameters=parameters, states=["x [m]", "v [m/s]"], inputs=list(inputs))


def drive(rng, n):
    return np.repeat(rng.uniform(-1.0, 1.0, -(-n // 12)), 12)[:n, None]


def recorded(rng, rhs=stage, depth=0.0, n=3000):
    u = drive(rng, n)
    wave = depth * np.sin(2 * np.pi * HERTZ * DT * np.arange(n) + 0.4)
    machine = make(rhs, ("u", "wave"), (1.05, 0.6, 11.5))
    moved = machine.simulate(np.column_stack([u[:, 0], wave]))
    return u, moved + SIGMA * rng.normal(size=moved.shape), moved


def fitted(u, y, coefficients=()):
    """Return the problem and fit of the stage with the noise that the record was made with."""
    windows = cut([(slice(0, len(u)), 0)], 200, 4)
    noise = Noise((np.array(coefficients),), np.array([SIGMA]))
    problem = Problem(make(), u, y, windows, noise)
    x0 = np.column_stack([y[windows.first, 0], np.zeros(windows.count)])
    return problem, fit(problem, Model(make().nominal, (), x0))


def along(problem, found):
    run = problem.run(found.model)
    return run, tangent(problem.simulator, run, problem.u, problem.windows, found.model.p)


@pytest.mark.parametrize("port", [Port("input", 0), Port("output", 0), Port("state", 0), Port("state", 1)])
@pytest.mark.parametrize("coefficients", [(), (0.6,)])
def test_the_gradient_by_forces_is_that_of_their_answers(port, coefficients):
    rng = np.random.default_rng(3)
    problem, found = fitted(*recorded(rng, n=800)[:2], coefficients)
    _, linear = along(problem, found)
    e = rng.normal(size=found.residual.shape)
    ends = e.reshape(*problem.rows.shape, 1)
    ends[:, : len(coefficients)] = ends[:, ends.shape[1] - len(coefficients) :] = 0.0  # there it is rough
    forces = rng.normal(size=(800, 5))
    answers = response(problem, linear, port, forces)
    expected = [np.sum(e * problem.whiten(answers[:, :, j])) for j in range(5)]
    gradient = gradients_by_force(problem, linear, e[:, :, None])[port][problem.inside, 0]
    assert gradient @ forces[problem.rows[problem.inside]] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_noise_holds_no_pulse_even_where_the_drive_is_a_sine(seed):
    rng = np.random.default_rng(seed)
    u, *_ = recorded(rng)
    if seed % 2:
        u = np.sin(2 * np.pi * 0.4 * DT * np.arange(3000))[:, None]
    y = make().simulate(u)
    problem, found = fitted(u, y + SIGMA * rng.normal(size=y.shape))
    run, linear = along(problem, found)
    e = out_of(found.jacobian, found.residual[:, :, None])[:, :, 0]
    pulse = strongest_pulse(problem, found, run, linear, e, find_structure(make(), run.x, u), rng)
    assert pulse.p_value > 0.01


@pytest.mark.parametrize("depth", [0.3, 0.6])
def test_the_gain_of_a_pulse_is_what_its_wave_would_take_off(depth):
    u, y, _ = recorded(np.random.default_rng(0), softened, depth)
    problem, found = fitted(u, y)
    run, linear = along(problem, found)
    structure = find_structure(make(), run.x, u)
    e = out_of(found.jacobian, found.residual[:, :, None])[:, :, 0]
    pulse = strongest_pulse(problem, found, run, linear, e, structure, np.random.default_rng(1))
    machine = make(softened, ("u", "wave"), (1.05, 0.6, 11.5))
    wave = depth * np.sin(2 * np.pi * HERTZ * DT * np.arange(len(u)) + 0.4)
    told = Problem(machine, np.column_stack([u[:, 0], wave]), y, problem.windows, problem.noise)
    left = fit(told, found.model._replace(p=machine.nominal)).cost
    assert pulse.gain == pytest.approx(found.cost - left, rel=0.5)


def read_by_another_clock(rng, hertz=HERTZ, most=0.004):
    """Return drive and readings, up to so many seconds late and as much early by turns."""
    u = drive(rng, 3000)
    late = most * np.sin(2 * np.pi * hertz * DT * np.arange(3000) + 0.4)
    position = make(values=(1.05, 0.6, 11.5)).simulate(u)
    rate = np.gradient(position, DT, axis=0)
    return u, position - late[:, None] * rate + 0.002 * rng.normal(size=(3000, 1))


def test_a_clock_that_runs_unevenly_is_seen_in_the_rate_of_what_it_reads():
    """What is read s seconds late is off by s times its rate: by hand, the wave's size and its frequency."""
    rng = np.random.default_rng(0)
    u, y = read_by_another_clock(rng)
    problem, found = fitted(u, y)
    run, linear = along(problem, found)
    structure = find_structure(make(), run.x, u)
    e = out_of(found.jacobian, found.residual[:, :, None])[:, :, 0]
    pulse = strongest_pulse(problem, found, run, linear, e, structure, rng)
    assert (pulse.signal, pulse.port) == ("the rate of x", Port("output", 0))
    assert pulse.p_value < 1e-6
    assert np.abs(np.array(pulse.frequencies) - HERTZ * DT).min() < 1e-4
    laws = pulse_hypotheses(make(), structure, (HERTZ - 1e-6, HERTZ + 1e-6))
    (clock,) = (law.placed for law in laws if law.placed.effect.code == BY_TURNS)
    told = fit(problem, found.model._replace(effects=(clock,)), iterations=20).model.effects[0]
    assert (told.theta[0], told.theta[1]) == pytest.approx(
        (-0.004 * np.sin(0.4), -0.004 * np.cos(0.4)), abs=3e-4
    )


def test_a_reading_of_two_converters_that_take_turns_is_told_at_the_output():
    """Of unequal gains: a wave of half the sampling rate times what is read, 0.01 large."""
    rng = np.random.default_rng(0)
    u, _, position = recorded(rng)
    by_turns = 1.0 + 0.01 * (-1.0) ** np.arange(3000)[:, None]
    problem, found = fitted(u, position * by_turns + 0.001 * rng.normal(size=position.shape))
    run, linear = along(problem, found)
    structure = find_structure(make(), run.x, u)
    e = out_of(found.jacobian, found.residual[:, :, None])[:, :, 0]
    pulse = strongest_pulse(problem, found, run, linear, e, structure, rng)
    assert (pulse.signal, pulse.port) == ("x", Port("output", 0))
    assert pulse.p_value < 1e-3
    assert max(pulse.frequencies) == pytest.approx(0.5, abs=1e-3)
    laws = pulse_hypotheses(make(), structure, (0.5 / DT - 1e-3, 0.5 / DT + 1e-3))
    (gain,) = (p for p in (law.placed for law in laws) if p.effect.code == PULSE and p.port == pulse.port)
    told = fit(problem, found.model._replace(effects=(gain,)), iterations=20).model.effects[0]
    assert told.theta[0] == pytest.approx(0.01, rel=0.1)


@pytest.mark.long
def test_a_clock_that_wanders_slowly_is_told_at_the_reading():
    """Five periods in the record: what is added by itself would be a drift, but this follows the rate."""
    u, y = read_by_another_clock(np.random.default_rng(0), 5 / (3000 * DT), 0.015)
    found = DiscrepancyRegressor(make(), effects=["additive_drift", "gain_drift", "delay", "lag"]).fit(u, y)
    (finding,) = found.findings_
    assert (found.verdict_, finding.port) == ("unknown", "output:0")
    assert finding.title == WORDS[BY_TURNS].title
    assert finding.parameters["f"] == pytest.approx(5 / (3000 * DT), abs=5e-3)
    assert np.hypot(finding.parameters["a"], finding.parameters["b"]) == pytest.approx(0.015, rel=0.1)


def test_windows_far_apart_tell_no_frequency():
    rng = np.random.default_rng(0)
    u, y, _ = recorded(rng)
    windows = cut([(slice(0, 200), 0), (slice(2700, 2900), 0)], 200, 4)
    problem = Problem(make(), u, y, windows, Noise.white(np.array([SIGMA])))
    found = fit(problem, Model(make().nominal, (), np.zeros((2, 2))))
    run, linear = along(problem, found)
    structure = find_structure(make(), run.x[:200], u[:200])
    assert strongest_pulse(problem, found, run, linear, found.residual, structure, rng) is None


@pytest.mark.long
@pytest.mark.parametrize(
    ("rhs", "depth", "port", "size"),
    [(softened, 0.6, "state:1", 0.6 * 11.5), (rippled, 0.25, "input:0", 0.25)],
)
def test_a_parameter_that_pulsates_is_told_and_modelled(rhs, depth, port, size):
    u, y, moved = recorded(np.random.default_rng(0), rhs, depth)
    found = DiscrepancyRegressor(make(), effects=["coulomb_friction", "constant_load", "dead_zone"]).fit(u, y)
    assert found.verdict_ == "unknown"
    (finding,) = found.findings_
    assert (finding.effect, finding.title, finding.port) == ("unknown", "a parameter that pulsates", port)
    assert finding.parameters["f"] == pytest.approx(HERTZ, abs=5e-3)
    assert np.hypot(finding.parameters["a"], finding.parameters["b"]) == pytest.approx(size, rel=0.1)
    assert finding.units["f"] == "Hz"
    refitted, augmented = (s.simulate(u) for s in (found.refitted_simulator_, found.simulator_))
    assert np.std(moved - augmented) < 0.5 * np.std(moved - refitted)


@pytest.mark.long
def test_a_line_by_name_does_not_stand_for_what_pulsates():
    """Whatever else a wave times a motion is, it has lines, of which a name takes one."""
    u, y, _ = recorded(np.random.default_rng(0), softened, 0.6)
    found = DiscrepancyRegressor(make(), effects=["periodic_disturbance", "gain_drift"]).fit(u, y)
    assert found.verdict_ == "unknown"
    (finding,) = found.findings_
    assert (finding.title, finding.port) == ("a parameter that pulsates", "state:1")
    assert "A parameter of the simulation is not always the same." in found.report_
    assert headline(found).startswith(
        "A parameter of the simulation is not always the same: A parameter that pulsates in the equation of v"
    )


@pytest.mark.parametrize(
    ("kind", "hertz", "gain", "counts"),
    [
        ("pulse", HERTZ, 5.0, True),
        ("pulse", HERTZ + 0.2, 5.0, False),
        ("pulse", HERTZ + 0.2, 50.0, True),
        ("line", HERTZ, 5.0, False),
    ],
)
def test_little_that_goes_with_a_signal_times_a_named_wave_counts(monkeypatch, kind, hertz, gain, counts):
    u, y, _ = recorded(np.random.default_rng(0))
    problem, base = fitted(u, y)
    sine = PlacedEffect(CATALOGUE[SINE], Port("state", 1), theta=(1.5, 2 * np.pi * HERTZ, 0.4))
    named = base._replace(model=base.model._replace(effects=(sine,)), cost=base.cost - 100.0)
    frequencies = (hertz, 3.0 * hertz) if kind == "pulse" else ()
    sign = Sign(kind, "", 1e-9, frequencies, gain)
    monkeypatch.setattr(refuted, "look_at_remainder", lambda *given: Remainder((sign,)))
    settings = Settings((), 0.005, 2, 4, None, 0, 1, lambda stage: None)
    structure = find_structure(make(), problem.run(base.model).x, u)
    best = Candidate(named, problem.n_seen)
    signs = refuted.left_that_is_no_noise(problem, base, best, structure, settings, list)
    assert signs == ((sign,) if counts else ())

"""Parameters of a simulator that depend on a signal: run, tangent, fit, and when they are told."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from small_machines import diagnosed_oscillator

from narx_sklearn.discrepancy import CallableSimulator, DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.dependence import dependence_in_words
from narx_sklearn.discrepancy.fitting.acting import correction
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.locate import tangent
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.bank import effect_column
from narx_sklearn.discrepancy.search.hypotheses import parameter_hypotheses
from narx_sklearn.discrepancy.search.places import parameter_placements
from narx_sklearn.discrepancy.search.unnamed.varying import PARAMETER_THAT_VARIES, bending, broken, line_of
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.displays import EffectCurveDisplay
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.physics.effects import (
    Effect,
    EffectParameter,
    no_start,
    register_effect,
    unregister_effect,
)
from narx_sklearn.report import render_report

VARYING = PARAMETER_THAT_VARIES
DT = 1.0
FALL, ABOUT = -0.015, 25.0  # of the resistance, 1/degC


def cell(x, u, p):
    """Warm a cell by the current through its resistance, and cool it by the air."""
    return ((u[0] * u[0] * p[0] - p[1] * (x[0] - u[1])) / p[2],)


def measured(x, u, p):
    return 3.7 - u[0] * p[0], x[0]


def make_cell(resistance=0.05, equations=cell):
    return ODESimulator(
        equations,
        dt=DT,
        parameters={"R0 [ohm]": resistance, "h [W/K]": 0.1, "C [J/K]": 12.0},
        states=["temperature [degC]"],
        inputs=["current [A]", "air [degC]"],
        outputs=["voltage [V]", "temperature [degC]"],
        output=measured,
    )


def warming(theta=(FALL, ABOUT), parameter=0, signal=2):
    weights = tuple(float(i == signal) for i in range(3))
    limits = (-np.inf, np.inf), (theta[1], theta[1])  # where it is counted from is no matter of a fit
    return PlacedEffect(VARYING, Port("parameter", parameter), second=weights, theta=theta, limits=limits)


def driven(rng, n):
    air = 25.0 + 12.0 * np.sin(2 * np.pi * np.arange(n) / n + rng.uniform(0, 6))
    return np.column_stack([np.repeat(rng.uniform(-8, 8, n // 20), 20), air])


def recorded(rng, fall=FALL, n=1200, finer=20, bend=0.0, law=None):
    """Step the cell by Euler's method, far finer than it is measured."""

    def resistance_at(temperature):
        ahead = temperature - ABOUT
        return 0.05 * (1 + fall * ahead + bend * ahead**2 if law is None else law(ahead))

    u = driven(rng, n)
    temperature, y = u[0, 1], np.empty((n, 2))
    for k, (current, air) in enumerate(u):
        y[k] = 3.7 - current * resistance_at(temperature), temperature
        for _ in range(finer):
            heat = current**2 * resistance_at(temperature) - 0.1 * (temperature - air)
            temperature += DT / finer * heat / 12.0
    return u, y + rng.normal(size=y.shape) * [0.002, 0.05]


def problem_of(simulator, u, y, sigma=(0.002, 0.05)):
    windows = cut([(slice(0, len(u)), 0)], 100, 1)
    return Problem(simulator, u, y, windows, Noise.white(np.array(sigma)))


def test_along_a_parabola():
    bent = bending(warming()).at((FALL, ABOUT, 0.0004))
    assert bent.n_values == 2
    for temperature in (10.0, 25.0, 40.0):
        ahead = temperature - ABOUT
        factor = bent.effect.factor(temperature, np.array(bent.theta))
        assert factor == pytest.approx(1 + FALL * ahead + 0.0004 * ahead**2)
    bent = replace(bent, second_name="temperature", second_unit="degC")
    told = dependence_in_words(bent, np.array([[FALL, FALL], [ABOUT, ABOUT], [0.0, 0.0]]), make_cell())
    assert told.endswith("about 25 degC, and bends by +0.04 % per degC^2 there.")


def test_along_a_broken_line():
    bent = bending(warming()).at((FALL, ABOUT, 0.0004))
    line = broken(bent, np.linspace(10.0, 40.0, 301))
    knots, heights = line_of(line)
    assert line_of(bent) is None
    np.testing.assert_allclose(np.diff(knots), np.diff(knots)[0])
    assert (heights[3], line.bounds[3].tolist(), line.n_values) == (1.0, [1.0, 1.0], 6)
    ratio = [bent.effect.factor(at, np.array(bent.theta)) for at in knots]
    np.testing.assert_allclose(heights, np.array(ratio) / ratio[3])
    half_way = line.effect.factor(0.5 * (knots[1] + knots[2]), np.array(line.theta))
    assert half_way == pytest.approx(0.5 * (heights[1] + heights[2]))
    line = replace(line, second_name="temperature", second_unit="degC")
    told = dependence_in_words(line, np.tile(0.0, (14, 2)), make_cell())
    assert told.startswith("The parameter R0 depends on temperature: times its value at 25 degC it is 1.3")
    assert told.endswith(" degC; straight between them.")


# -- the run ------------------------------------------------------------------------------------------------


def written_out(x, u, p):
    r = p[0] * (1 - 0.015 * (x[0] - 25.0))
    return ((u[0] * u[0] * r - p[1] * (x[0] - u[1])) / p[2],)


class Slow:
    """The same as an object that keeps its rates, which no compiler takes."""

    def __call__(self, x, u, p):
        self.rates = list(cell(x, u, p))
        return self.rates


def test_equations_and_outputs_read_the_parameter_as_it_is_at_the_moment():
    u, start = driven(np.random.default_rng(0), 60), np.array([[18.0]])
    whole = Windows.whole([slice(0, 60)])
    run = make_cell().run(u, whole, start, effects=[warming()])
    by_hand = make_cell(equations=written_out).run(u, whole, start)
    np.testing.assert_array_equal(run.x, by_hand.x)
    resistance = 0.05 * (1 + FALL * (by_hand.x[:, 0] - ABOUT))
    np.testing.assert_allclose(run.y[:, 0], 3.7 - u[:, 0] * resistance, rtol=1e-14)


def test_a_simulator_that_runs_as_python_varies_as_well():
    u, whole = driven(np.random.default_rng(0), 20), Windows.whole([slice(0, 20)])
    slow = make_cell(equations=Slow())
    with pytest.warns(NarxWarning, match="Slow could not be compiled"):
        run = slow.run(u, whole, np.array([[18.0]]), effects=[warming()])
    fast = make_cell().run(u, whole, np.array([[18.0]]), effects=[warming()])
    np.testing.assert_allclose(run.x, fast.x, rtol=1e-14)


def test_two_effects_on_two_parameters_act_beside_each_other_and_by_their_strength():
    u, whole = driven(np.random.default_rng(0), 20), Windows.whole([slice(0, 20)])
    cooled = warming((0.5, 25.0), parameter=1, signal=1)
    run = make_cell().run(u, whole, np.array([[18.0]]), effects=[warming(), cooled], strength=[1.0, 0.02])
    weaker = warming((0.01, 25.0), parameter=1, signal=1)
    same = make_cell().run(u, whole, np.array([[18.0]]), effects=[weaker, warming()])
    np.testing.assert_allclose(run.x, same.x, rtol=1e-13)
    assert np.ptp(run.x - make_cell().run(u, whole, np.array([[18.0]]), effects=[warming()]).x) > 0.1


def test_the_tangent_is_the_slope_by_the_parameter_times_the_signal():
    """x' = -p x, y = p x with p (1 + a d), d = w - r: dy/da = p d x0 exp(-p t) (1 - p t) at a = 0."""
    decay = ODESimulator(
        lambda x, u, p: (-p[0] * x[0],),
        dt=0.01,
        parameters={"p [1/s]": 0.8},
        states=["x [-]"],
        inputs=["w [K]"],
        outputs=["y [1/s]"],
        output=lambda x, u, p: (p[0] * x[0],),
    )
    n, away = 200, 3.0
    u, y = np.full((n, 1), 20.0 + away), np.zeros((n, 1))
    problem = Problem(decay, u, y, Windows.whole([slice(0, n)]), Noise.white(np.ones(1)))
    base = fit(problem, Model(decay.nominal, (), np.array([[2.0]])), iterations=0)
    placed = PlacedEffect(VARYING, Port("parameter", 0), second=(1.0, 0.0), theta=(1e-4, 20.0))
    column = effect_column(problem, base, problem.run(base.model), placed)[0] / 1e-4
    t = 0.01 * np.arange(n)
    by_hand = 0.8 * away * 2.0 * np.exp(-0.8 * t) * (1 - 0.8 * t)
    np.testing.assert_allclose(column, by_hand, atol=1e-4 * np.abs(by_hand).max())


def test_the_tangent_along_a_run_knows_that_a_parameter_varies_and_what_outputs_show_of_it():
    u, whole = driven(np.random.default_rng(0), 40), Windows.whole([slice(0, 40)])
    simulator = make_cell().with_effects([warming()])
    run = simulator.run(u, whole, np.array([[18.0]]))
    linear = tangent(simulator, run, u, whole)
    inside = slice(0, 39)
    np.testing.assert_allclose(linear.C[inside, 0, 0], -u[inside, 0] * 0.05 * FALL, rtol=1e-5, atol=1e-9)
    factor = 1 + FALL * (run.x[inside, 0] - ABOUT)
    np.testing.assert_allclose(linear.Q[inside, 0, 0], -u[inside, 0] * factor, rtol=1e-6, atol=1e-9)


# -- hypotheses and the fit ---------------------------------------------------------------------------------


def test_every_parameter_is_tried_with_every_input_and_state_counted_from_its_mean():
    u, y = recorded(np.random.default_rng(0), n=200)
    problem = problem_of(make_cell(), u, y)
    model = Model(make_cell().nominal, (), y[problem.windows.first, 1:])
    run = problem.run(model)
    structure = find_structure(make_cell(), run.x, u)
    found = parameter_hypotheses([VARYING], problem, run, structure)
    assert [(h.placed.port.index, h.placed.second.index(1.0)) for h in found] == [
        (parameter, signal) for parameter in range(3) for signal in range(3)
    ]
    for hypothesis, signal in zip(found[:3], (*u.T, run.x[:, 0]), strict=True):
        placed = hypothesis.placed.at(hypothesis.starts[0])
        assert placed.n_values == 1  # where it is counted from is given
        np.testing.assert_allclose(placed.theta, [0.1 / signal.std(), signal.mean()], rtol=1e-9)


def test_a_simulator_whose_parameters_nobody_reads_is_not_asked():
    black_box = CallableSimulator(
        lambda u, p: np.cumsum(p["gain"] * u, axis=0),
        dt=0.1,
        parameters={"gain": 1.0},
        inputs=["u"],
        outputs=["y"],
    )
    u, y = recorded(np.random.default_rng(0), n=200)
    structure = find_structure(make_cell(), y[:, 1:], u)
    assert list(parameter_placements(VARYING, black_box, structure)) == []
    assert len(list(parameter_placements(VARYING, make_cell(), structure))) == 9


def test_a_parameter_may_depend_on_how_far_neighbours_are_apart_and_how_fast_they_part():
    simulator = suspension()
    x = np.random.default_rng(0).normal(size=(100, 4))
    structure = find_structure(simulator, x, np.random.default_rng(1).normal(size=(100, 1)))
    found = [p for p in parameter_placements(VARYING, simulator, structure) if p.port.index == 0]
    apart = {p.second_name: p.second for p in found[5:]}
    assert len(found) == 5 + 2  # the input, the states, and of these two differences, each once
    np.testing.assert_allclose(np.sort(list(apart.values())), [[-1.0, 0.0, 0.0, 0.0, 1.0]] * 2, atol=1e-9)
    assert {frozenset(np.flatnonzero(way)) for way in apart.values()} == {
        frozenset({1, 3}),
        frozenset({2, 4}),
    }


def damped(closing):
    """Return the rates of a body on a wheel, whose damper is as many times as strong while it closes."""

    def quarter(x, u, p):
        speed = x[3] - x[1]
        soft = 0.5 * (closing - 1.0) * (1.0 + np.tanh(speed / 0.02))
        force = p[1] * (x[2] - x[0]) + p[0] * speed * (1.0 + soft)
        return x[1], force / 300.0, x[3], (p[2] * (u[0] - x[2]) - 200.0 * x[3] - force) / p[3]

    return quarter


def felt(x, u, p, rates):
    return rates[1], x[2] - x[0]


def suspension(off=1.0, closing=1.0):
    """Return a quarter of a car, by its acceleration and travel."""
    return ODESimulator(
        damped(closing),
        dt=0.005,
        parameters={
            "damper [N s/m]": 1400.0 * off,
            "spring [N/m]": 20000.0 / off,
            "tyre [N/m]": 150000.0 * off,
            "wheel [kg]": 35.0 / off,
        },
        states=["body [m]", "body speed [m/s]", "wheel [m]", "wheel speed [m/s]"],
        inputs=["road [m]"],
        outputs=["acceleration [m/s^2]", "travel [m]"],
        output=felt,
    )


@pytest.mark.long
def test_a_damper_that_is_softer_while_it_closes_is_one_that_depends_on_how_fast_it_does():
    rng = np.random.default_rng(0)
    u = 0.02 * np.convolve(rng.normal(size=3000), np.ones(8) / 8, "same")[:, None]
    y = suspension(closing=0.7).simulate(u)
    y += 0.01 * y.std(axis=0) * rng.normal(size=y.shape)
    dx = DiscrepancyRegressor(suspension(1.05), random_state=0).fit(u, y)
    best = dx.conclusion_.diagnosis.best.effects[0]
    assert (dx.verdict_, str(best.port)) == ("unknown", "parameter:0")
    knots, heights = line_of(best)
    away = np.abs(knots) > 0.2
    softer = np.sign(best.second[-1]) * knots > 0
    assert heights[away & softer].mean() == pytest.approx(0.7 * heights[away & ~softer].mean(), rel=0.05)
    assert dx.scores_["nrmse"]["augmented"] < 0.3 * dx.scores_["nrmse"]["refitted"]


def test_a_fit_finds_what_a_parameter_does_in_two_equations_at_once():
    u, y = recorded(np.random.default_rng(1))
    simulator = make_cell(resistance=0.04)
    problem = problem_of(simulator, u, y)
    x0 = y[problem.windows.first, 1:]
    found = fit(problem, Model(simulator.nominal, (warming((0.001, ABOUT)),), x0))
    change, reference = found.model.effects[0].theta
    J = found.jacobian[:, :, :4]  # of the simulator's own parameters and the change
    errors = np.sqrt(np.diag(np.linalg.inv(np.einsum("wti,wtj->ij", J, J))))
    assert reference == ABOUT
    assert abs(change - FALL) < 3 * errors[3] < 0.05 * abs(FALL)
    assert abs(found.model.p[0] - 0.05) < 3 * errors[0]
    assert found.cost < 1.1 * problem.n_seen


def test_what_is_added_to_the_parameter_is_told_along_the_run():
    u, y = recorded(np.random.default_rng(0), n=200)
    problem = problem_of(make_cell(), u, y)
    model = Model(make_cell().nominal, (warming(),), y[problem.windows.first, 1:])
    run = problem.run(model)
    rows, argument, added = correction(problem, model, run, 0, problem.samples_of(run), 50)
    np.testing.assert_allclose(argument, run.x[rows, 0])
    np.testing.assert_allclose(added, 0.05 * FALL * (argument - ABOUT), rtol=1e-9)


# -- users' own ---------------------------------------------------------------------------------------------


def test_a_factor_of_ones_own_is_tried_when_it_is_registered():
    def own(factor):
        parameters = (EffectParameter("b", "1/({second})"),)
        return Effect(
            code="arrhenius",
            title="t",
            sentence="s",
            equation="p exp(b w)",
            parameters=parameters,
            starts=no_start,
            factor=factor,
        )

    register_effect(own(lambda second, theta: np.exp(theta[0] * second)))
    assert unregister_effect("arrhenius").ports == ("parameter",)
    with pytest.raises(ValueError, match=r"factor returned .*; wanted is one finite number"):
        register_effect(own(lambda second, theta: np.array([second, second])))
    with pytest.raises(ValueError, match="factor must be callable, got float"):
        register_effect(own(1.5))


# -- the diagnosis ------------------------------------------------------------------------------------------


@pytest.mark.long
def test_a_resistance_that_falls_as_it_warms_is_told_and_corrected():
    u, y = recorded(np.random.default_rng(2))
    dx = DiscrepancyRegressor(make_cell(resistance=0.045), random_state=0).fit(u, y)
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.effect, finding.port) == ("unknown", "unknown", "state:0")
    assert finding.place == "in the parameter R0, with temperature"
    assert finding.sentence.startswith("The parameter R0 depends on temperature: it falls by 1.")
    low, high = finding.intervals["a"]
    reference = finding.parameters["r"]
    assert low < FALL / (1 + FALL * (reference - ABOUT)) < high
    assert finding.units == {"a": "1/degC", "r": "degC"}
    said = render_report(dx, u, y)
    assert finding.sentence in said
    curve = EffectCurveDisplay.from_estimator(dx)
    change = finding.parameters["a"] * dx.simulator_.nominal[0]
    np.testing.assert_allclose(curve.fitted, change * (curve.argument - finding.parameters["r"]), rtol=1e-6)
    slope = np.polyfit(curve.argument, curve.needed, 1)[0]  # what the record asks for, by no form at all
    assert abs(slope - change) < 0.2 * abs(change)
    assert curve.force_label == "added to R0 (ohm)"
    again = pickle.loads(pickle.dumps(dx))
    u_new, y_new = recorded(np.random.default_rng(3), n=400)
    predicted = again.predict(u_new, y_init=y_new[:20])
    assert np.std(y_new[20:, 0] - predicted[20:, 0]) < 1.1 * 0.002  # the noise
    constant = dx.refitted_simulator_.simulate(u_new, x0=[y_new[0, 1]])
    assert np.std(y_new[20:, 0] - constant[20:, 0]) > 5 * 0.002


@pytest.mark.long
def test_a_resistance_that_falls_less_and_less_is_told_along_a_parabola():
    u, y = recorded(np.random.default_rng(2), fall=-0.03, bend=0.0008)
    dx = DiscrepancyRegressor(make_cell(resistance=0.045), random_state=0).fit(u, y)
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.place) == ("unknown", "in the parameter R0, with temperature")
    a, r, b = (finding.parameters[name] for name in "arb")
    resistance = {p.name: p.value for p in dx.simulator_.parameters}["R0"]
    for ahead in (-10.0, 0.0, 10.0):
        told = resistance * (1 + a * (ahead + ABOUT - r) + b * (ahead + ABOUT - r) ** 2)
        assert told == pytest.approx(0.05 * (1 - 0.03 * ahead + 0.0008 * ahead**2), rel=0.02)
    assert "and bends by +0.0" in finding.sentence
    u_new, y_new = recorded(np.random.default_rng(3), n=400, fall=-0.03, bend=0.0008)
    predicted = dx.predict(u_new, y_init=y_new[:20])
    assert np.std(y_new[20:, 0] - predicted[20:, 0]) < 1.1 * 0.002  # the noise


@pytest.mark.long
def test_a_resistance_that_falls_within_few_degrees_is_told_along_a_broken_line():
    def jump(ahead):
        return 0.7 + 0.6 / (1.0 + np.exp(ahead))

    u, y = recorded(np.random.default_rng(2), law=jump)
    dx = DiscrepancyRegressor(make_cell(resistance=0.045), random_state=0).fit(u, y)
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.place) == ("unknown", "in the parameter R0, with temperature")
    assert "straight between them" in finding.sentence
    u_new, y_new = recorded(np.random.default_rng(3), n=400, law=jump)
    predicted = dx.predict(u_new, y_init=y_new[:20])
    assert np.std(y_new[20:, 0] - predicted[20:, 0]) < 1.5 * 0.002  # the noise


@pytest.mark.long
def test_a_constant_resistance_is_left_one():
    u, y = recorded(np.random.default_rng(2), fall=0.0)
    dx = DiscrepancyRegressor(make_cell(resistance=0.045), random_state=0).fit(u, y)
    assert (dx.verdict_, dx.findings_) == ("refit", [])


@pytest.mark.long
def test_a_stiffness_that_grows_with_the_position_is_told_by_its_name():
    """k (1 + a x) x is a quadratic stiffness, which the catalogue has."""

    def softened(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 2.0 * x[0] ** 2

    asked = ["quadratic_stiffness", "cubic_stiffness", "coulomb_friction"]
    dx = diagnosed_oscillator(softened, asked, noise=0.02, seed=0)
    assert (dx.verdict_, [f.effect for f in dx.findings_]) == ("explained", ["quadratic_stiffness"])

"""Forces that go as a power: told by the exponent, and a name refuted by another one."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_machines import axis, axis_problem, diagnosed_oscillator, friction, levels, make_axis

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.lookalikes import likeliest
from narx_sklearn.discrepancy.search.unnamed.broken_line import KNOTS
from narx_sklearn.discrepancy.search.unnamed.curves import curve_hypotheses
from narx_sklearn.discrepancy.search.unnamed.kinds import EVEN_POWER, INVERSE, ODD_POWER
from narx_sklearn.discrepancy.search.unnamed.powers import (
    POWERS,
    ROOTS,
    inverse_power,
    placed_powers,
    power_effect,
    root_effect,
    with_free_power,
)
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.knots import drawn_again
from narx_sklearn.discrepancy.stages.powers import _is_new, best_power, with_another_power
from narx_sklearn.physics.effects import CATALOGUE, Power

VELOCITY = (0.0, 1.0)
NOWHERE = (0.0, 0.0, 0.0, 0.0)  # rate, own, second, time


def value(effect, x, theta):
    return effect.force(x, *NOWHERE, 0.01, np.zeros(1), np.array(theta), np.zeros(1))


def drag(c2=0.3):
    return PlacedEffect(CATALOGUE["quadratic_drag"], Port("state", 1), VELOCITY, theta=(c2,))


def power(exponent, strength=0.3, size=1.0, odd=True):
    effect = power_effect(Power(3.0, odd), size)
    return PlacedEffect(effect, Port("state", 1), VELOCITY, theta=(-strength, exponent, size))


def root(exponent, strength=0.3, size=1.0):
    return PlacedEffect(root_effect(size), Port("state", 1), VELOCITY, theta=(-strength, exponent, size))


@given(x=st.floats(-3.0, 3.0), n=st.floats(1.5, 6.0), size=st.floats(0.1, 5.0))
def test_an_odd_power_turns_with_its_argument_and_an_even_one_does_not(x, n, size):
    odd, even = (power_effect(Power(2.0, is_odd), size) for is_odd in (True, False))
    for effect, sign in ((odd, -1.0), (even, 1.0)):
        assert value(effect, -x, (2.0, n, size)) == pytest.approx(sign * value(effect, x, (2.0, n, size)))
        assert value(effect, size, (2.0, n, size)) == pytest.approx(2.0)


@given(share=st.floats(0.1, 1.5), n=st.floats(0.2, 2 / 3), size=st.floats(0.1, 5.0))
def test_a_root_turns_with_its_argument_and_has_a_slope_at_zero(share, n, size):
    effect, theta = root_effect(size), (2.0, n, size)
    assert value(effect, share * size, theta) == pytest.approx(2.0 * share**n, rel=0.01)
    assert value(effect, -share * size, theta) == -value(effect, share * size, theta)
    assert value(effect, 0.0, theta) == 0.0
    # next to zero it is the chord to a five-hundredth of the size, not steeper
    assert value(effect, 1e-6 * size, theta) / 1e-6 == pytest.approx(2.0 * 0.002 ** (n - 1.0), rel=1e-6)


@settings(max_examples=30, deadline=None)
@given(x=st.floats(-2.0, 2.0), size=st.floats(0.1, 5.0), k=st.floats(0.1, 9.0))
@pytest.mark.parametrize("code", ["cubic_stiffness", "quadratic_stiffness", "quadratic_drag"])
def test_a_law_with_its_power_free_begins_as_it_is(code, x, size, k):
    named = PlacedEffect(CATALOGUE[code], Port("state", 1), (1.0, 0.0), theta=(k,))
    freed = with_free_power(named, named.effect.power, size)
    assert value(freed.effect, x, freed.theta) == pytest.approx(value(named.effect, x, (k,)), abs=1e-9)
    assert freed.theta[1] == named.effect.power.exponent
    assert (freed.port, freed.weights) == (named.port, named.weights)


@pytest.mark.parametrize(("x", "force"), [(0.5, 3.0), (1.0, 0.75), (-2.0, 3.0 / 16), (0.1, 3.0), (0.0, 3.0)])
def test_an_inverse_square_has_a_quarter_at_twice_the_distance_and_no_more_than_it_had_nearest(x, force):
    assert value(inverse_power(0.5), x, (3.0, 2.0, 0.5)) == pytest.approx(force)


def refitted_with(truth, *named, noise=0.001, **made):
    problem, start = axis_problem([truth], noise=noise, **made)
    base = fit(problem, start)
    best = Candidate(fit(problem, base.model._replace(effects=named)), problem.n_seen)
    return problem, base, best


class TestNames:
    @pytest.mark.parametrize("exponent", [3.0, 4.0])
    def test_another_power_refutes_the_name(self, exponent):
        problem, _, best = refitted_with(power(exponent), drag())
        other = with_another_power(problem, best, 0.005)
        (placed,) = other.effects
        assert placed.effect.code == ODD_POWER
        assert placed.theta[1] == pytest.approx(exponent, abs=0.3)
        assert other.fit.cost < best.fit.cost

    def test_a_root_refutes_the_name_of_a_square(self):
        problem, _, best = refitted_with(root(0.45), drag())
        (placed,) = with_another_power(problem, best, 0.005).effects
        assert placed.theta[1] == pytest.approx(0.45, abs=0.05)

    @pytest.mark.parametrize("exponent", [2.0, 2.3])
    def test_a_power_that_is_hardly_off_does_not(self, exponent):
        problem, _, best = refitted_with(power(exponent), drag())
        assert with_another_power(problem, best, 0.005) is None

    @pytest.mark.parametrize(("noise", "refuted"), [(0.001, True), (0.03, False)])
    def test_one_that_noise_may_have_moved_does_not(self, noise, refuted):
        problem, _, best = refitted_with(power(2.6), drag(), noise=noise)
        assert (with_another_power(problem, best, 0.005) is not None) == refuted

    def test_what_is_no_power_by_its_name_is_not_asked(self):
        friction = PlacedEffect(CATALOGUE["coulomb_friction"], Port("state", 1), VELOCITY, theta=(0.3,))
        problem, _, best = refitted_with(power(3.0), friction)
        assert with_another_power(problem, best, 0.005) is None

    def test_others_of_the_set_stay(self):
        problem, _, best = refitted_with(
            power(3.5),
            drag(),
            PlacedEffect(CATALOGUE["constant_load"], Port("state", 1), theta=(0.0,)),
        )
        other = with_another_power(problem, best, 0.005)
        assert [placed.effect.code for placed in other.effects] == [ODD_POWER, "constant_load"]


class TestWithoutAName:
    def found(self, truth, known):
        problem, base, best = refitted_with(truth, drag())
        run = problem.run(base.model)
        structure = find_structure(problem.simulator, run.x, problem.u)
        hypotheses = [Hypothesis.untuned(p, np.ones((1, 1))) for p in known]
        return best_power(problem, base, best.fit._replace(model=base.model), structure, hypotheses)

    def test_the_power_and_its_argument_are_found(self):
        found = self.found(power(3.0), [drag()])
        (placed,) = found.effects
        assert (placed.effect.code, placed.weights) == (ODD_POWER, VELOCITY)
        assert placed.theta[1] == pytest.approx(3.0, abs=0.3)

    def test_that_of_a_name_is_told_by_the_name(self):
        assert self.found(power(2.0), [drag()]) is None

    def test_a_name_from_elsewhere_takes_none(self):
        found = self.found(power(2.0), [replace(drag(), odd=True)])
        assert found.effects[0].theta[1] == pytest.approx(2.0, abs=0.3)

    @pytest.mark.parametrize("exponent", [0.35, 0.5])
    def test_a_root_of_what_turns_is_found(self, exponent):
        (placed,) = self.found(root(exponent), [drag()]).effects
        assert (placed.effect.code, placed.weights) == (ODD_POWER, VELOCITY)
        assert placed.theta[1] == pytest.approx(exponent, abs=0.05)

    def test_a_dry_friction_is_no_root(self):
        truth = PlacedEffect(CATALOGUE["coulomb_friction"], Port("state", 1), VELOCITY, theta=(0.3,))
        found = self.found(truth, [drag()])
        assert found is None or found.effects[0].theta[1] > 1.0

    def test_roots_of_what_stays_on_one_side_are_an_outflow(self):
        problem, start = axis_problem()
        x = problem.run(start).x
        structure = find_structure(problem.simulator, x, problem.u)
        roots = [
            [p.weights for p in placed_powers(problem.simulator, structure, at) if p.theta[1] < 1.0]
            for at in (x, np.abs(x) + 0.1)
        ]
        assert set(roots[0]) == {VELOCITY, (1.0, 0.0)}
        assert roots[1] == []

    def test_it_is_tried_either_way_on_all_that_moves(self):
        problem, start = axis_problem()
        x = problem.run(start).x
        placed = placed_powers(problem.simulator, find_structure(problem.simulator, x, problem.u), x)
        tried = {(p.effect.code, p.weights) for p in placed}
        assert tried == {(c, w) for c in (ODD_POWER, EVEN_POWER) for w in (VELOCITY, (1.0, 0.0))}


def screw(x, u, p):
    """An axis that the root of its speed brakes, its law written by hand."""
    return x[1], p[0] * u[0] - p[1] * x[1] - 0.6 * np.sign(x[1]) * abs(x[1]) ** 0.45


def fitted_to(record, *laws):
    """Return an axis with laws at its velocity, fitted to a record of another's."""
    u, y = record
    windows = cut([(slice(0, len(u)), 0)], 375, 12)
    problem = Problem(make_axis(), u, y, windows, Noise.white(np.array([0.002])))
    model = Model(problem.simulator.nominal, laws, np.zeros((windows.count, 2)))
    return Candidate(fit(problem, model), problem.n_seen)


NAMED = {  # Fc, and of Stribeck's friction that at rest over it, a speed, and the power of the fall
    "coulomb_friction": (0.3,),
    "stribeck_friction": (0.3, 2.0, 1.0, 2.0),
    "viscous_damping": (0.3,),
}


@pytest.mark.parametrize("kind", ["screw", *NAMED])
def test_a_root_and_the_frictions_of_the_catalogue_are_told_apart(kind):
    u = levels(np.random.default_rng(0), 1500)
    frictions = {code: friction(size, code, shape) for code, (size, *shape) in NAMED.items()}
    machine = make_axis(1.1, 0.4, equations=screw if kind == "screw" else axis)
    machine = machine.with_effects([frictions[kind]] if kind in NAMED else [])
    record = u, machine.simulate(u) + 0.002 * np.random.default_rng(1).normal(size=u.shape)
    nothing, by_root = fitted_to(record), fitted_to(record, root(0.5))
    named = likeliest([fitted_to(record, law) for law in frictions.values()], nothing.fit.cost)
    if kind == "screw":
        assert by_root.effects[0].theta[1] == pytest.approx(0.45, abs=0.03)
        assert by_root.criterion < named.criterion - 100
    elif kind == "viscous_damping":  # the axis has one of its own, which needs nothing beside it
        assert by_root.criterion > nothing.criterion
    else:
        assert named.effects[0].effect.code == kind
        assert by_root.criterion > named.criterion + 100


def height(x, u, p):
    return (p[0] * u[0] - p[1] * x[0],)


def height_near_ground(x, u, p):
    return (p[0] * u[0] - p[1] * x[0] + 0.05 / x[0] ** 2,)


class TestFallingOff:
    """A craft that sinks to a tenth of its height, held up by what falls off with the square of it."""

    @pytest.fixture
    def flown(self):
        about = {"dt": 0.05, "states": ["height [m]"], "inputs": ["thrust [V]"]}
        parameters = {"lift [m/s/V]": 1.0, "sinking [1/s]": 1.0}
        rng = np.random.default_rng(0)
        u = np.repeat(rng.uniform(-1.0, 3.0, 60), 20)[:, None]
        true, plain = (
            ODESimulator(law, parameters=parameters, substeps=4, **about)
            for law in (height_near_ground, height)
        )
        x0 = np.array([1.0])
        y = true.simulate(u, x0=x0) + 0.002 * rng.normal(size=(len(u), 1))
        windows = cut([(slice(0, len(u)), 0)], 200, 12)
        problem = Problem(plain, u, y, windows, Noise.white(np.array([0.002])))
        base = fit(problem, Model(plain.nominal, (), y[windows.first]))
        return problem, base, find_structure(plain, problem.run(base.model).x, u)

    def test_the_inverse_power_is_found(self, flown):
        problem, base, structure = flown
        found = best_power(problem, base, base, structure, [])
        (placed,) = found.effects
        assert placed.effect.code == INVERSE
        assert placed.theta[1] == pytest.approx(2.0, abs=0.1)
        assert found.fit.cost < 1.1 * problem.n_seen

    def test_a_line_with_knots_near_the_ground_leaves_far_less_than_an_even_one(self, flown):
        problem, base, structure = flown
        run = problem.run(base.model)
        curves = curve_hypotheses(problem.simulator, structure, problem.u, run.x, run.y)
        (line,) = [c.placed for c in curves if c.placed.port.kind == "state"]
        even = Candidate(fit(problem, base.model._replace(effects=(line,))), problem.n_seen)
        drawn = drawn_again(problem, even)
        knots = np.array(drawn.effects[0].theta[KNOTS : 2 * KNOTS])
        assert np.all(np.diff(knots) > 0)
        assert np.diff(knots)[0] < 0.5 * np.diff(knots)[-1]
        assert knots[0] == pytest.approx(problem.y.min(), abs=0.02)  # without the law it sinks below ground
        assert even.effects[0].theta[KNOTS] < -0.5
        assert drawn.fit.cost - problem.n_seen < 0.1 * (even.fit.cost - problem.n_seen)


def damped_by_the_cube(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 0.15 * x[1] ** 3


def held_by_the_fifth(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 8.0 * x[0] ** 5


def rubbed_by_the_root(x, u, p):
    rubs = np.sign(x[1]) * abs(x[1]) ** 0.5
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 3.0 * rubs


def held_and_rubbing(x, u, p):
    spring = p[2] * x[0] + 8.0 * x[0] ** 5
    return x[1], p[0] * u[0] - p[1] * x[1] - spring - 2.5 * np.tanh(500.0 * x[1])


@pytest.mark.long
@pytest.mark.parametrize(
    ("machine", "argument", "exponent"),
    [
        (damped_by_the_cube, "velocity", 3.0),
        (held_by_the_fifth, "position", 5.0),
        (rubbed_by_the_root, "velocity", 0.5),
    ],
)
def test_a_diagnosis_tells_the_power_that_no_name_has(machine, argument, exponent):
    named = ["quadratic_drag", "cubic_stiffness", "cogging", "coulomb_friction", "stribeck_friction"]
    dx = diagnosed_oscillator(machine, named, noise=0.03, seed=0)
    assert dx.verdict_ == "unknown"
    (finding,) = dx.findings_
    assert (finding.effect, finding.port) == ("unknown", "state:1")
    if finding.equation.startswith("v3 v^3, "):  # as a polynomial of one term
        assert exponent == 3.0
    else:
        low, high = finding.intervals["n"]
        assert low < exponent < high
        assert argument in finding.argument
    size = next(line for line in dx.report_.splitlines() if line.strip().startswith("size "))
    assert " to " not in size  # what is given has no interval


@pytest.mark.long
def test_a_power_without_a_name_may_stand_beside_a_name():
    named = ["quadratic_drag", "cubic_stiffness", "coulomb_friction"]
    dx = diagnosed_oscillator(held_and_rubbing, named, noise=0.01, seed=0)
    assert dx.verdict_ == "unknown"
    findings = {finding.effect: finding for finding in dx.findings_}
    assert findings.keys() == {"unknown", "coulomb_friction"}
    low, high = findings["unknown"].intervals["n"]
    assert low < 5.0 < high
    assert findings["coulomb_friction"].parameters["Fc"] == pytest.approx(2.5, rel=0.1)


@pytest.mark.parametrize(
    ("exponent", "is_new"), [(ROOTS[0], False), (0.5, True), (ROOTS[1], True), (POWERS[0], False)]
)
def test_a_root_at_the_end_towards_a_line_is_one_and_next_to_a_step_is_none(exponent, is_new):
    """Friction that goes as 0.7 of speed ends there: surely no line, which its simulator has."""
    effect = root_effect(1.0) if exponent < 1.0 else power_effect(Power(3.0, odd=True), 1.0)
    power = PlacedEffect(effect, Port("state", 1), VELOCITY, theta=(-0.5, exponent, 1.0))
    assert _is_new(power, []) == is_new

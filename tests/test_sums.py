"""Sums of a state and its rate: what controllers put out, what couplings pass on, and what acts on that."""

import numpy as np
import pytest

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.findings import (
    argument_told,
    build_in_words,
    parameter_names,
    parameter_units,
    place_in_words,
)
from narx_sklearn.discrepancy.fitting.acting import state_forces
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.search.places import placements
from narx_sklearn.discrepancy.search.unnamed.curves import curve_hypotheses
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.structure import Sums, find_structure
from narx_sklearn.physics.effects import CATALOGUE

DT = 0.01
PARTS = 50  # of a step, in which the twins go
FINE = DT / PARTS
KP, KI = 0.8, 6.0
GAP = 0.02
NOMINAL = {"kt [N m/A]": 0.5, "damping [N m s]": 0.02, "inertia [kg m^2]": 0.012, "resistance [ohm]": 1.1}
TRUE = (0.55, 0.025, 0.01, 1.3)


def make(put_out=lambda v: v, tracking=0.0):
    """Return a motor whose voltage is that of a PI controller of its speed."""

    def drive(x, u, p):
        speed, current, integral = x[0], x[1], x[2]
        asked = KP * (u[0] - speed) + KI * integral
        voltage = put_out(asked)
        torque = p[0] * current - p[1] * speed
        rate = u[0] - speed + tracking * (voltage - asked) / KI
        return torque / p[2], (voltage - p[3] * current - p[0] * speed) / 0.02, rate

    return ODESimulator(
        drive,
        dt=DT,
        parameters=NOMINAL,
        states=["speed [rad/s]", "current [A]", "integral [rad]"],
        inputs=["reference [rad/s]"],
        outputs=["speed [rad/s]"],
        output=[0],
    )


def plain(equations, n_states, n_inputs=1):
    """Return a simulator that shows its first two states."""
    return ODESimulator(
        equations,
        dt=DT,
        parameters={"a": 2.0, "b": 3.0},
        states=[f"x{i}" for i in range(n_states)],
        inputs=[f"u{i}" for i in range(n_inputs)],
        output=[0, 1],
        outputs=["y0", "y1"],
    )


def of(equations, n_states, n_inputs=1):
    return structure_of(plain(equations, n_states, n_inputs))


def structure_of(simulator):
    u = np.random.default_rng(0).normal(size=(100, len(simulator.inputs)))
    x = simulator.run(u, Windows.whole([slice(0, 100)]), np.zeros((1, len(simulator.states)))).x
    return find_structure(simulator, x, u)


def behind(code, simulator, tracks=False):
    found = placements(CATALOGUE[code], simulator, structure_of(simulator))
    alone, tracked = (p for p in found if p.handed_on)
    assert tracked.tracks
    assert not alone.tracks
    return tracked if tracks else alone


def test_what_a_controller_puts_out():
    """Over the gain of its integral that is the integral and T = kp/ki times what is integrated."""
    (found,) = structure_of(make()).controllers
    assert found.state == 2
    assert found.time == pytest.approx(KP / KI)
    assert found.weights == pytest.approx((KP / KI, -KP / KI, 0.0, 1.0), abs=1e-6)


def test_an_integral_in_the_unit_of_the_output():
    def drive(x, u, p):
        error = u[0] - x[0]
        return p[0] * (p[1] * error + x[1]) - x[0], 5.0 * error

    (found,) = of(drive, 2).controllers
    assert found.weights == pytest.approx((3.0, -3.0, 1.0), rel=1e-6)


def test_the_inner_one_of_two_loops():
    """The reference of the speed is what the loop of the position puts out."""

    def axis(x, u, p):
        error = 4.0 * (u[0] - x[0]) - x[1]
        return x[1], p[0] * (2.0 * error + 5.0 * x[2]) - x[1] * abs(x[1]), error

    (found,) = of(axis, 3).controllers
    assert found.state == 2
    assert found.weights == pytest.approx((1.6, -1.6, -0.4, 1.0), rel=1e-6)


def tank_and_pipe(x, u, p):
    """What flows in fills the tank, and is in no other equation."""
    return p[0] * (u[0] - x[1]), p[1] * (x[0] - x[1])


def lag_beside(x, u, p):
    """A state that leaks is no integral."""
    return p[0] * (u[0] - x[0] + x[1]), u[0] - x[0] - 0.1 * x[1]


def wound(x, u, p):
    """What is integrated goes with a product."""
    return p[0] * (u[0] - x[0] + x[1]), (u[0] - x[0]) * x[0]


def against(x, u, p):
    """The reference enters with the other sign."""
    return p[0] * (x[1] - u[0]) - x[0], u[0] - x[0]


def test_a_spring_with_a_damper_that_a_base_pulls_at():
    """How far the base is ahead, and how fast, comes in one sum too: the force between the two."""

    def isolator(x, u, p):
        return u[0] - x[1], 10.0 * p[0] * x[0] + p[1] * (u[0] - x[1])

    (found,) = of(isolator, 2).controllers
    assert found.weights == pytest.approx((0.15, 1.0, -0.15), rel=1e-6)


@pytest.mark.parametrize("equations", [tank_and_pipe, lag_beside, wound, against])
def test_what_is_no_controller(equations):
    assert of(equations, 2).controllers == ()


def shaft(motor, load, ahead, p):
    """Return the torque of a spring with a damper."""
    return 50.0 * p[0] * ahead + p[1] * (motor - load)


def twisting(passed):
    """Return a drive whose bodies are coupled by a torque, and which knows how far it is twisted."""

    def train(x, u, p):
        torque = passed(x[0], x[1], x[2], p)
        return u[0] - torque - 0.1 * x[0], 2.0 * torque - 0.3 * x[1], x[0] - x[1]

    return train


def geared(passed):
    """Return one that knows both positions, behind a gear of three to one, and a load with a weight."""

    def train(x, u, p):
        torque = passed(x[1], 3.0 * x[3], x[0] - 3.0 * x[2], p)
        return x[1], u[0] - torque - 0.1 * x[1], x[3], 6.0 * torque - np.sin(x[2])

    return train


def undamped(x, u, p):
    torque = 50.0 * p[0] * x[2]
    return u[0] - torque - 0.1 * x[0], 2.0 * torque - 0.3 * x[1], x[0] - x[1]


@pytest.mark.parametrize(
    ("equations", "state", "weights"),
    [
        (twisting(shaft), 2, (0.0, 0.03, -0.03, 1.0)),
        (geared(shaft), 0, (0.0, 1.0, 0.03, -3.0, -0.09)),
        (undamped, 2, (0.0, 0.0, 0.0, 1.0)),
    ],
)
def test_what_a_coupling_passes_on(equations, state, weights):
    """Over its stiffness that is the twist and T = c/k times how fast it grows."""
    (found,) = of(equations, len(weights) - 1).couplings
    assert found.state == state
    assert found.weights == pytest.approx(weights, abs=1e-5)


@pytest.mark.parametrize(
    ("equations", "p", "weights"),
    [
        (twisting(shaft), (1.0, 10.0), (0.0, 0.2, -0.2, 1.0)),
        (geared(shaft), (3.0, 3.0), (0.0, 1.0, 0.02, -3.0, -0.06)),
    ],
    ids=["twist", "positions"],
)
def test_a_sum_follows_the_parameters(equations, p, weights):
    """What acts on it acts on c/k as a fit has them, not as they were given."""
    simulator = plain(equations, len(weights) - 1)
    structure = structure_of(simulator)
    sums = Sums(simulator, structure)
    (given,) = structure.couplings
    assert sums.at(simulator.nominal)[given.place].weights == pytest.approx(given.weights)
    placed = next(one for one in placements(CATALOGUE["clearance"], simulator, structure) if one.handed_on)
    (moved,) = sums.under([placed], np.array(p))
    assert moved.second == pytest.approx(weights, abs=1e-5)
    assert moved.argument_name.endswith(f"+ {p[1] / (50.0 * p[0]):.4g} s x its rate")
    assert moved.place == placed.place  # the same hypothesis
    assert sums.under([moved], np.array([1.0, -1.0])) == (moved,)  # no coupling: as it was


def test_a_run_takes_the_sum_that_its_parameters_have():
    simulator = plain(twisting(shaft), 3)
    u = np.repeat(np.random.default_rng(1).uniform(-40, 40, 30), 10)[:, None]
    whole = Windows.whole([slice(0, u.size)])
    structure = structure_of(simulator)
    placed = next(p for p in placements(CATALOGUE["clearance"], simulator, structure) if p.handed_on)
    problem = Problem(
        simulator, u, np.zeros((u.size, 2)), whole, Noise.white([1.0, 1.0]), sums=Sums(simulator, structure)
    )
    model = Model(np.array([2.0, 9.0]), (placed.at([1.0, GAP, 0.0]),), np.zeros((1, 3)))
    written = plain(twisting(loose), 3).with_parameters(model.p).simulate(u)
    np.testing.assert_allclose(problem.run(model).y, written, rtol=1e-5, atol=1e-6)
    assert fit(problem, model, iterations=0).model.effects[0].second == problem.tied(model).effects[0].second


def test_what_two_bodies_differ_by_is_counted_behind_the_gear():
    """Friction goes with the load on the teeth, which is the spring's; what acts between both is such too."""
    simulator = plain(geared(shaft), 4)
    structure = structure_of(simulator)
    assert structure.geared(0, 2) == pytest.approx(3.0, rel=1e-5)
    assert structure.geared(3, 1) == pytest.approx(1.0 / 3.0, rel=1e-5)
    assert structure.geared(0, 1) == 1.0
    by_load = placements(CATALOGUE["load_friction"], simulator, structure)
    (loaded,) = (p for p in by_load if p.second_name == "x0 - 3 x x2" and p.onward < 0)
    assert loaded.second == pytest.approx((0.0, 1.0, 0.0, -3.0, 0.0), abs=1e-4)
    between = next(p for p in by_load if p.onward >= 0)  # told at the load, which it moves more
    assert (between.port, between.argument_name) == (Port("state", 3), "x3 - 0.3333 x x1")
    assert between.share == pytest.approx(1.0 / (2.0 * 3.0), rel=1e-5)  # of inertias, and by the gear


def held_back(x, u, p):
    """A spring to the ground too, and no damper: where the motor is counts by itself."""
    torque = 50.0 * p[0] * (x[0] - x[2])
    return x[1], u[0] - torque - 4.0 * x[0], x[3], torque - 2.0 * x[2]


def watched(x, u, p):
    """Something else depends on the twist."""
    torque = shaft(x[0], x[1], x[2], p)
    return u[0] - torque, torque - x[1], x[0] - x[1], x[2] - x[3]


@pytest.mark.parametrize("equations", [held_back, watched])
def test_what_is_no_coupling(equations):
    assert of(equations, 4).couplings == ()


def loose(motor, load, ahead, p):
    torque = shaft(motor, load, ahead, p)
    return torque - min(max(torque, -50.0 * p[0] * GAP), 50.0 * p[0] * GAP)


@pytest.mark.parametrize(
    ("drive", "n", "name"), [(twisting, 3, "x2"), (geared, 4, "x0 - 3 x x2")], ids=["twist", "positions"]
)
def test_a_clearance_in_a_coupling(drive, n, name):
    simulator = plain(drive(shaft), n)
    found = placements(CATALOGUE["clearance"], simulator, structure_of(simulator))
    (placed,) = (p.at([1.0, GAP, 0.0]) for p in found if p.handed_on)
    assert placed.name.code == "backlash"
    assert {p.name.code for p in found if not p.handed_on} == {"clearance"}
    assert placed.argument_name == f"{name} + 0.03 s x its rate"
    u = np.repeat(np.random.default_rng(1).uniform(-40, 40, 30), 10)
    run, twin = simulator.with_effects([placed]).simulate(u), plain(drive(loose), n).simulate(u)
    np.testing.assert_allclose(run, twin, rtol=1e-5, atol=1e-6)
    assert np.abs(twin - simulator.simulate(u)).max() > 0.01 * np.std(twin)


def forward(put_out=lambda v: v):
    """Return a drive whose controller puts out the speed it is to have beside what its error asks for."""

    def equations(x, u, p):
        asked = 0.5 * u[1] + KP * (u[0] - x[0]) + KI * x[2]
        return x[1], p[0] * put_out(asked) - p[1] * x[1], u[0] - x[0]

    return plain(equations, 3, 2)


def test_what_is_fed_forward_is_put_out_with_it():
    alone, whole = structure_of(forward()).controllers
    assert alone.weights == pytest.approx((KP / KI, 0.0, -KP / KI, 0.0, 1.0), abs=1e-6)
    assert whole.weights == pytest.approx((KP / KI, 0.5 / KI, -KP / KI, 0.0, 1.0), abs=1e-6)
    assert whole.called(forward()) == "x2 + 0.08333 x u1 + 0.1333 s x its rate"
    placed = next(
        p
        for p in placements(CATALOGUE["input_saturation"], forward(), structure_of(forward()))
        if p.handed_on and not p.tracks and p.second == whole.weights
    )
    limited = forward().with_effects([placed.at([-4.0 / KI, 4.0 / KI, 0.0])])
    written = forward(lambda v: min(max(v, -4.0), 4.0))
    u = np.repeat(np.random.default_rng(1).uniform(-4, 4, (20, 2)), 30, axis=0)
    np.testing.assert_allclose(limited.simulate(u), written.simulate(u), rtol=1e-7, atol=1e-9)
    assert np.abs(written.simulate(u) - forward().simulate(u)).max() > 0.01


@pytest.mark.parametrize("tracking", [0.0, 5.0])
def test_against_equations_that_have_it(tracking):
    limit = 10.0
    u = np.repeat(np.random.default_rng(1).uniform(-40, 40, 20), 30)
    theta = [-limit / KI, limit / KI, 0.0, tracking]
    placed = behind("input_saturation", make(), tracking > 0).at(theta[: 4 if tracking else 3])
    limited = make().with_effects([placed])
    written = make(lambda v: min(max(v, -limit), limit), tracking)
    np.testing.assert_allclose(limited.simulate(u), written.simulate(u), rtol=1e-9, atol=1e-9)
    whole = Windows.whole([slice(0, u.size)])
    run = limited.run(u[:, None], whole, np.zeros((1, 3)))
    rows = np.arange(0, u.size, 7)
    argument, added = state_forces(limited, run, u[:, None], whole, rows)[0]
    voltage = KP * (u[rows] - run.x[rows, 0]) + KI * run.x[rows, 2]
    np.testing.assert_allclose(argument, voltage / KI, rtol=1e-6)
    np.testing.assert_allclose(
        added, np.clip(voltage, -limit, limit) / KI - voltage / KI, rtol=1e-6, atol=1e-6
    )


def test_it_is_told_in_the_unit_of_the_integral():
    placed = behind("dead_zone", make()).at([0.2, 0.0, 0.0, 0.0])
    words = place_in_words(placed, make())
    assert words == "behind integral + 0.1333 s x its rate, as the other equations have it"
    assert argument_told(placed) == "s = integral + 0.1333 s x its rate [rad]"
    assert parameter_units(placed, make()) == ["rad", "rad", "rad", "-"]


def test_how_fast_the_integral_follows_is_told():
    placed = behind("input_saturation", make(), tracks=True)
    assert placed.share == pytest.approx(KI / KP)  # at first as fast as the error is made up for
    placed = placed.at([-2.0, 2.0, 0.0, 5.0])
    assert place_in_words(placed, make()).endswith("; integral follows what is left")
    assert parameter_names(placed)[-1] == "tracking"
    assert parameter_units(placed, make())[-1] == "1/s"


def dead_time(late):
    held = [0.0] * round(late / FINE)

    def arrives(asked):
        held.append(asked)
        return held.pop(0)

    return arrives


def lagging(late):
    at = [0.0]

    def arrives(asked):
        at[0] += FINE * (asked - at[0]) / late
        return at[0]

    return arrives


def limited(rate, more=0.0):
    at = [0.0]

    def arrives(asked):
        at[0] += min(max(asked - at[0], -rate * (1.0 - more) * FINE), rate * (1.0 + more) * FINE)
        return at[0]

    return arrives


def positioned(asked=lambda s: s, damper=0.0):
    """Return an axis in the loop of its position, without an integral."""

    def axis(x, u, p):
        return x[1], p[0] * asked(4.0 * (u[0] - x[0]) - 0.5 * x[1]) - damper * x[1]

    return axis


def test_a_controller_without_an_integral():
    """The error alone, and with what equations take off it by a speed: a friction would do the same."""
    alone, both = of(positioned(), 2).errors
    assert (alone.state, alone.through, alone.time) == (1, 0, 0.0)
    assert alone.weights == pytest.approx((1.0, -1.0, 0.0))
    assert both.weights == pytest.approx((1.0, -1.0, -0.125), rel=1e-6)
    names = [one.called(plain(positioned(), 2)) for one in (alone, both)]
    assert names == ["u0 - x0", "u0 - x0 - 0.125 s x x1"]


def base(x, u, p):
    """A spring to a base that is told by where it is: how far it is stretched."""
    return x[1], p[0] * (u[0] - x[0]) - p[1] * x[1] * abs(x[1])


def oven(x, u, p):
    """What heat goes out of a body into surroundings that its own equation has is no controller's."""
    return p[0] * (u[0] - x[0]) + x[1], -x[1]


def test_where_an_input_and_a_state_differ():
    assert [one.time for one in of(base, 2).errors] == [0.0]
    assert of(oven, 2).errors == ()
    assert structure_of(make()).errors == ()  # its integral tells all that is put out


@pytest.mark.parametrize("code", ["input_saturation", "delay"])
def test_what_is_behind_a_controller_without_an_integral(code):
    def saturated(asked):
        return min(max(asked, -12.0), 12.0)

    simulator = plain(positioned(), 2)
    found = placements(CATALOGUE[code], simulator, structure_of(simulator))
    _, placed = (p for p in found if p.handed_on)
    u = np.repeat([0.0, *np.random.default_rng(1).uniform(-10, 10, 30)], 20)
    if code == "input_saturation":
        placed = placed.at([-3.0, 3.0, 0.0])  # of 12 / 4
        told = plain(positioned(saturated), 2).simulate(u)
    else:
        placed = placed.at([0.03, 0.0])
        told = ramped(u, dead_time(0.03))
    simulator = simulator.with_effects([placed])
    off = np.std(simulator.simulate(u) - told, axis=0)
    assert np.all(off < 0.01 * np.std(told, axis=0))
    whole = Windows.whole([slice(0, u.size)])
    run = simulator.run(u[:, None], whole, np.zeros((1, 2)))
    argument, _ = state_forces(simulator, run, u[:, None], whole, np.arange(u.size))[0]
    np.testing.assert_allclose(argument, u - run.x[:, 0] - 0.125 * run.x[:, 1], atol=1e-6)
    assert place_in_words(placed, simulator) == "behind u0 - x0 - 0.125 s x x1, as the equations have it"
    assert parameter_units(placed, simulator)[0] == ("s" if code == "delay" else "-")


def ramped(u, arrives):
    """Return place and speed of the axis in small steps of Euler's kind."""
    place = speed = 0.0
    told = []
    for reference in u:
        told.append((place, speed))
        for _ in range(PARTS):
            put_out = arrives(4.0 * (reference - place) - 0.5 * speed)
            place += FINE * speed
            speed += FINE * 2.0 * put_out
    return np.array(told)


def late(code, simulator=None):
    """Return what makes the output of the motor's controller arrive late."""
    simulator = simulator or make()
    found = placements(CATALOGUE[code], simulator, structure_of(simulator))
    (placed,) = (p for p in found if p.handed_on)
    return placed


@pytest.mark.parametrize(
    ("placed", "arrives"),
    [
        *[(("delay", T, 0.0), dead_time(T)) for T in (0.002, 0.005, 0.01, 0.0124, 0.03)],
        (("lag", 0.03, 0.0, 0.0), lagging(0.03)),
        (("rate_limit", 250.0 / KI, 0.0, 0.0), limited(250.0)),
        (("asymmetric_rate_limit", 400.0 / KI, 0.0, 0.0, -0.3), limited(400.0, -0.3)),
    ],
    ids=lambda case: f"{case[0]}-{case[1]:.4g}" if isinstance(case, tuple) else "",
)
def test_what_is_put_out_may_arrive_late(placed, arrives):
    """Also by parts of a step, though it jumps where the reference does: as a twin has it in small steps."""
    code, *theta = placed
    u = np.repeat([0.0, *np.random.default_rng(1).uniform(-40, 40, 30)], 30)
    speed = make().with_effects([late(code).at(theta)]).simulate(u)[:, 0]
    told, without = slowly(u, tuple(NOMINAL.values()), arrives), make().simulate(u)[:, 0]
    assert np.std(speed - told) < 0.01 * np.std(told) < 0.5 * np.std(without - told)


def test_a_dead_time_of_nothing_is_none():
    """A fit may begin at any: what is put out arrives the same way from nothing on."""
    u = np.repeat(np.random.default_rng(1).uniform(-40, 40, 30), 30)
    at_once, hardly, none = (
        make().with_effects(effects).simulate(u)[:, 0]
        for effects in ([late("delay").at([0.0, 0.0])], [late("delay").at([1e-9, 0.0])], [])
    )
    np.testing.assert_array_equal(at_once, none)
    assert np.std(hardly - none) < 0.002 * np.std(none)


@pytest.mark.parametrize(
    ("placed", "arrives"),
    [
        (("delay", 0.03, 1.0), dead_time(0.03)),
        (("delay", 0.0124, 1.0), dead_time(0.0124)),
        (("lag", 0.03, 1.0, 0.0), lagging(0.03)),
        (("rate_limit", 250.0 / KI, 1.0, 0.0), limited(250.0)),
    ],
    ids=lambda case: f"{case[0]}-{case[1]:.4g}" if isinstance(case, tuple) else "",
)
def test_what_is_put_out_first_may_come_to_a_machine_at_rest(placed, arrives):
    """All of it is lacking then, as where a record begins with a step."""
    code, *theta = placed
    u = np.repeat([30.0, -20.0, 10.0], 30)
    speed, from_first_on = (
        make().with_effects([late(code).at([theta[0], lacking, *theta[2:]])]).simulate(u)[:, 0]
        for lacking in (1.0, 0.0)
    )
    told = slowly(u, tuple(NOMINAL.values()), arrives)
    assert np.std(speed - told) < 0.01 * np.std(told) < 0.3 * np.std(from_first_on - told)


def test_how_a_delay_is_built_has_no_meaning_there():
    placed = late("rate_limit").at([40.0, 0.3, 1.0])
    assert placed.bounds.tolist() == [[0.0, np.inf], [-10.0, 10.0], [0.0, 0.0]]
    assert (placed.n_values, placed.n_memory, placed.lacking) == (1, 1, 0.3)
    assert late("delay").at([0.1, 0.0]).dead_time == 0.1
    assert placed.dead_time is None
    assert parameter_units(placed, make())[0] == "rad/s"
    assert build_in_words(placed, placed.bounds) == ""


def test_what_arrives_late_is_told_sample_by_sample():
    u = np.repeat(np.random.default_rng(1).uniform(-40, 40, 20), 30)
    simulator = make().with_effects([late("delay").at([0.02, 0.25])])
    whole = Windows.whole([slice(0, u.size)])
    run = simulator.run(u[:, None], whole, np.zeros((1, 3)))
    argument, added = state_forces(simulator, run, u[:, None], whole, np.arange(u.size))[0]
    put_out = KP / KI * (u - run.x[:, 0]) + run.x[:, 2]
    was = [*[0.75 * put_out[0]] * 2, *put_out[:-2]]
    np.testing.assert_allclose(argument, put_out, rtol=1e-6)
    np.testing.assert_allclose(added, was - put_out, rtol=1e-5, atol=1e-5)


def test_what_is_only_late_is_the_same_before_an_actuator():
    """There it has its place, and behind the actuator none."""

    def cylinder(x, u, p):
        return (u[0] - x[0]) / p[0], p[1] * x[0] - x[1]

    structure = of(cylinder, 2)
    assert structure.handed_on == [0]
    places = placements(CATALOGUE["lag"], plain(cylinder, 2), structure)
    assert not any(placed.handed_on for placed in places)


def test_a_curve_is_tried_there_too():
    u = np.random.default_rng(0).normal(size=(200, 1))
    run = make().run(u, Windows.whole([slice(0, 200)]), np.zeros((1, 3)))
    structure = find_structure(make(), run.x, u)
    curves = curve_hypotheses(make(), structure, u, run.x, run.y)
    (found,) = (h for h in curves if h.placed.handed_on)
    assert found.placed.second == structure.controllers[0].weights


def slowly(u, parameters, put_out, tracking=0.0):
    """Return the speed of the motor at each sample: an independent twin in small steps of Euler's kind."""
    speed = current = integral = 0.0
    kt, damping, inertia, resistance = parameters
    y = []
    for reference in u:
        y.append(speed)
        for _ in range(PARTS):
            asked = KP * (reference - speed) + KI * integral
            voltage = put_out(asked)
            torque = kt * current - damping * speed
            current += FINE * (voltage - resistance * current - kt * speed) / 0.02
            integral += FINE * (reference - speed + tracking * (voltage - asked) / KI)
            speed += FINE * torque / inertia
    return np.array(y)


def diagnosed(put_out, tracking=0.0):
    """Return the diagnosis of a motor by its speed."""
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(-40, 40, 60), 40)
    y = slowly(u, TRUE, put_out, tracking) + 0.3 * rng.standard_normal(u.size)
    return DiscrepancyRegressor(make(), random_state=0).fit(u, y)


@pytest.mark.long
@pytest.mark.parametrize(
    ("effect", "put_out", "told"),
    [
        ("input_saturation", lambda v: min(max(v, -24.0), 24.0), {"low": -24.0 / KI, "high": 24.0 / KI}),
        ("dead_zone", lambda v: v - min(max(v, -3.0), 3.0), {"d": 3.0 / KI}),
        ("rate_limit", limited(250.0), {"r": 250.0 / KI}),
        ("asymmetric_rate_limit", limited(250.0, -0.3), {"r": 250.0 / KI, "a": -0.3}),
    ],
)
def test_it_is_named_behind_the_controller(effect, put_out, told):
    dx = diagnosed(put_out)
    finding = dx.findings_[0]
    assert (dx.verdict_, finding.effect, finding.port) == ("explained", effect, "state:2")
    for name, value in told.items():
        assert finding.parameters[name] == pytest.approx(value, rel=0.05)


@pytest.mark.long
def test_a_torque_that_arrives_late_is_named_where_the_loop_is_closed_by_it():
    """Two loops, one in the other, by measured place and speed: nothing before them does the same."""
    rng = np.random.default_rng(4)
    u = np.repeat(rng.uniform(-1.0, 1.0, 40), 100)
    (kpp, kpv, kiv), (inertia, friction), h = (18.0, 4.0, 60.0), (0.05, 0.14), 0.001 / 100
    place = speed = integral = 0.0
    held, y = [0.0] * 620, []  # 6.2 ms
    for reference in u:
        y.append((place, speed))
        for _ in range(100):
            error = kpp * (reference - place) - speed
            held.append(kpv * error + kiv * integral)
            place += h * speed
            speed += h * (held.pop(0) - friction * speed) / inertia
            integral += h * error

    def table(x, u, p):
        error = p[2] * (u[0] - x[0]) - x[1]
        return x[1], (p[3] * error + p[4] * x[2] - p[1] * x[1]) / p[0], error

    simulator = ODESimulator(
        table,
        dt=0.001,
        parameters={"J": 0.045, "b": 0.12, "kpp": 18.0, "kpv": 4.0, "kiv": 60.0},
        states=["place [rad]", "speed [rad/s]", "integral [rad]"],
        inputs=["reference [rad]"],
        outputs=["place [rad]", "speed [rad/s]"],
        output=[0, 1],
    )
    y = np.array(y) + [0.0012, 0.05] * rng.standard_normal((u.size, 2))
    dx = DiscrepancyRegressor(simulator, random_state=0).fit(u, y)
    finding = dx.findings_[0]
    assert (dx.verdict_, finding.effect, finding.port) == ("explained", "delay", "state:2")
    assert finding.parameters["T"] == pytest.approx(0.0062, rel=0.01)


@pytest.mark.long
def test_an_integral_that_does_not_wind_up_is_told_beside_the_limit():
    dx = diagnosed(lambda v: min(max(v, -24.0), 24.0), tracking=5.0)
    finding = dx.findings_[0]
    assert (dx.verdict_, finding.effect, finding.port) == ("explained", "input_saturation", "state:2")
    assert finding.parameters["high"] == pytest.approx(24.0 / KI, rel=0.05)
    assert finding.parameters["tracking"] == pytest.approx(5.0, rel=0.2)


@pytest.mark.long
def test_a_clearance_in_a_coupling_is_named_though_long_runs_swing_out_of_step():
    """Over long windows a fit loses count of the swings; over shorter ones it does not."""
    rng = np.random.default_rng(3)
    inertias, stiffness, damping, frictions, gap = (0.6, 1.35), 3200.0, 3.5, (0.6, 1.6), 0.006
    torque = np.repeat(rng.uniform(-40, 40, 150), 20)
    motor = load = twist = 0.0
    finer, y = 100, []
    h = 0.002 / finer
    for applied in torque:
        y.append((motor, load))
        for _ in range(finer):
            beyond = twist - min(max(twist, -gap), gap)
            passed = stiffness * beyond + damping * (motor - load) if beyond else 0.0
            passed = max(passed, 0.0) if beyond > 0 else min(passed, 0.0)
            motor += h * (applied - passed - frictions[0] * motor) / inertias[0]
            load += h * (passed - frictions[1] * load) / inertias[1]
            twist += h * (motor - load)
    y = np.array(y) + [0.03, 0.05] * rng.standard_normal((torque.size, 2))

    def train(x, u, p):
        passed = p[2] * x[2] + p[3] * (x[0] - x[1])
        return (u[0] - passed - p[4] * x[0]) / p[0], (passed - p[5] * x[1]) / p[1], x[0] - x[1]

    simulator = ODESimulator(
        train,
        dt=0.002,
        parameters={"Jm": 0.6, "Jl": 1.1, "k": 2600.0, "c": 2.5, "bm": 0.5, "bl": 2.0},
        states=["motor [rad/s]", "load [rad/s]", "twist [rad]"],
        inputs=["torque [N m]"],
        outputs=["motor [rad/s]", "load [rad/s]"],
        output=[0, 1],
    )
    dx = DiscrepancyRegressor(simulator, random_state=0).fit(torque, y)
    finding = dx.findings_[0]
    assert (dx.verdict_, len(dx.findings_)) == ("explained", 1)
    assert (finding.effect, finding.title, finding.port) == ("backlash", "Backlash", "state:2")
    assert {*dx.location_.regions["effect"]} <= {"backlash"}
    assert finding.parameters["g"] == pytest.approx(gap, rel=0.05)
    assert finding.parameters["c"] == 0.0  # nothing shows from where a twist is counted
    found = {p.name: p.value for p in dx.simulator_.parameters}
    assert found["k"] == pytest.approx(stiffness, rel=0.05)
    assert found["c"] == pytest.approx(damping, rel=0.05)

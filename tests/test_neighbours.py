"""Effects between two neighbours: what pushes one body pushes the other back."""

import numpy as np
import pytest

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.findings import parameter_names, place_in_words
from narx_sklearn.discrepancy.fitting.acting import state_forces
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.search.hypotheses import enumerate_hypotheses
from narx_sklearn.discrepancy.search.places import placements
from narx_sklearn.discrepancy.search.unnamed.curves import curve_hypotheses
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.substeps import coarse_steps, too_coarse
from narx_sklearn.physics.effects import CATALOGUE

BODY, WHEEL = 300.0, 40.0  # kg
DT = 0.005
STATES = ["body [m]", "body rate [m/s]", "wheel [m]", "wheel rate [m/s]"]
TRUE = {"spring [N/m]": 18e3, "damper [N s/m]": 1200.0, "tyre [N/m]": 180e3}
GUESSED = {"spring [N/m]": 16e3, "damper [N s/m]": 1400.0, "tyre [N/m]": 200e3}


def suspension(x, u, p):
    strut = p[0] * (x[2] - x[0]) + p[1] * (x[3] - x[1])
    return x[1], strut / 300.0, x[3], (p[2] * (u[0] - x[2]) - strut) / 40.0


def in_space(x, u, p):
    """Two bodies that nothing else holds."""
    strut = p[0] * (x[2] - x[0]) + p[1] * (x[3] - x[1])
    return x[1], (strut + u[0]) / 300.0, x[3], -strut / 40.0


def make(function=suspension, parameters=TRUE, substeps=1):
    return ODESimulator(
        function,
        dt=DT,
        parameters=parameters,
        states=STATES,
        inputs=["road [m]"],
        output=(0, 2),
        substeps=substeps,
    )


def road(n=3000, seed=0):
    rng = np.random.default_rng(seed)
    f = np.fft.rfftfreq(n, DT)
    line = np.where((f > 0.2) & (f < 12), np.exp(2j * np.pi * rng.random(f.size)), 0)
    wave = np.fft.irfft(line, n)
    return 0.05 * wave[:, None] / np.abs(wave).max()


def states_along(simulator, u):
    return simulator.run(u, Windows.whole([slice(0, len(u))]), np.zeros((1, len(simulator.states)))).x


def places(code, simulator, u):
    x = states_along(simulator, u)
    return placements(CATALOGUE[code], simulator, find_structure(simulator, x, u))


@pytest.mark.parametrize("code", ["coulomb_friction", "cubic_stiffness", "clearance"])
def test_what_acts_between_two_is_told_once_at_the_one_that_it_moves_more(code):
    between = [p for p in places(code, make(), road()) if np.count_nonzero(p.weights) == 2]
    (placed,) = between
    assert placed.port == Port("state", 3)
    assert (placed.onward, placed.reacts) == (1, True)
    assert placed.share == pytest.approx(WHEEL / BODY)
    words = place_in_words(placed, make())
    assert words == "in the equation of wheel rate, and back in that of body rate"
    unfelt = placed.at([1.0] * (placed.n_theta - 1) + [0.0])
    assert place_in_words(unfelt, make()) == "in the equation of wheel rate"
    assert parameter_names(placed)[-1] == "reaction_ratio"


def test_a_neighbour_that_does_not_feel_it_is_not_pushed_back():
    def towed(x, u, p):
        """The wheel follows the road whatever the body does."""
        strut = p[0] * (x[2] - x[0]) + p[1] * (x[3] - x[1])
        return x[1], strut / 300.0, x[3], p[2] * (u[0] - x[2]) / 40.0 - 20.0 * x[3]

    between = [p for p in places("cubic_stiffness", make(towed), road()) if np.count_nonzero(p.weights) == 2]
    assert [(p.port.index, p.onward, p.reacts) for p in between] == [(1, -1, False)]


def test_curves_without_a_name_push_back_too():
    simulator, u = make(), road()
    x = states_along(simulator, u)
    found = curve_hypotheses(simulator, find_structure(simulator, x, u), u, x, x[:, [0, 2]])
    between = [h for h in found if np.count_nonzero(h.placed.weights) == 2]
    assert between
    assert all(h.placed.reacts and h.placed.onward == 1 for h in between)
    assert {h.starts.shape[1] for h in between} == {h.placed.n_theta for h in between}


@pytest.mark.parametrize(
    ("code", "theta"),
    [
        ("coulomb_friction", [5.0]),
        ("cubic_stiffness", [1e6]),
        ("presliding_friction", [5.0, 1e-3, 1.2, 0.05, 1e-3]),
    ],
)
def test_what_acts_between_two_changes_nothing_of_their_momentum(code, theta):
    simulator = make(in_space)
    u = 5e3 * road() / 0.05  # N
    (placed,) = [p for p in places(code, simulator, u) if np.count_nonzero(p.weights) == 2]
    acting = simulator.with_effects([placed.at([*theta, WHEEL / BODY])])
    windows = Windows.whole([slice(0, len(u))])
    without, run = (s.run(u, windows, np.zeros((1, 4))) for s in (simulator, acting))
    momentum = [r.x @ [0, BODY, 0, WHEEL] for r in (without, run)]
    assert np.abs(run.x[:, 3] - without.x[:, 3]).max() > 1e-3
    np.testing.assert_allclose(momentum[1], momentum[0], atol=1e-6 * np.abs(momentum[0]).max())


def test_two_bodies_that_stick_together_move_as_one():
    simulator = make(in_space, TRUE | {"spring [N/m]": 1e-9, "damper [N s/m]": 1e-9})
    u = 5e3 * road() / 0.05  # N
    (placed,) = [p for p in places("coulomb_friction", make(in_space), u) if np.count_nonzero(p.weights) == 2]
    stuck = simulator.with_effects([placed.at([100.0, WHEEL / BODY])])
    x = states_along(stuck, u)
    assert np.ptp(x[:, 1]) > 0.1
    np.testing.assert_allclose(x[:, 3], x[:, 1], atol=1e-9)


@pytest.mark.long
def test_dry_friction_of_a_strut_is_named_and_located_between_body_and_wheel():
    def rubbing(x, u, p):
        dry = 150.0 * np.tanh((x[3] - x[1]) / 1e-3)
        strut = p[0] * (x[2] - x[0]) + p[1] * (x[3] - x[1]) + dry
        return x[1], strut / 300.0, x[3], (p[2] * (u[0] - x[2]) - strut) / 40.0

    u = road()
    y = make(rubbing, substeps=40).simulate(u)
    y += 0.01 * y.std(axis=0) * np.random.default_rng(1).normal(size=y.shape)
    effects = ["coulomb_friction", "quadratic_drag", "cubic_stiffness", "presliding_friction", "clearance"]
    dx = DiscrepancyRegressor(make(parameters=GUESSED), effects=effects).fit(u, y)
    (finding,) = dx.findings_
    assert finding.effect == "coulomb_friction"
    assert finding.place == "in the equation of wheel rate, and back in that of body rate"
    size, ratio = finding.parameters.values()
    assert size == pytest.approx(150 / WHEEL, rel=0.05)
    assert ratio == pytest.approx(WHEEL / BODY, rel=0.1)


CRANE = ["cart [m]", "cart rate [m/s]", "swing [rad]", "swing rate [rad/s]"]
HELD = {"cart [kg]": 8.0, "damping [kg/s]": 12.0, "swing damping [1/s]": 0.1}


def crane(x, u, p):
    """A cart with a swinging load: what pushes the cart turns up in both equations of motion."""
    s, c = np.sin(x[2]), np.cos(x[2])
    along = (u[0] - p[1] * x[1] + 2.0 * s * (1.2 * x[3] ** 2 + 9.81 * c)) / (p[0] + 2.0 * s * s)
    return x[1], along, x[3], (-along * c - 9.81 * s) / 1.2 - p[2] * x[3]


def make_crane(function=crane, parameters=HELD, substeps=1):
    made = {"states": CRANE, "inputs": ["force [N]"], "output": (0, 2), "substeps": substeps}
    return ODESimulator(function, dt=0.02, parameters=parameters, **made)


def beside(code, simulator, u):
    return [p for p in places(code, simulator, u) if p.through >= 0]


def test_a_force_beside_an_input_does_what_the_input_does():
    simulator, u = make_crane(), 600 * road()
    (load,) = beside("constant_load", simulator, u)
    assert (load.port, place_in_words(load, simulator)) == (Port("state", 1), "beside the input force")
    pushed = simulator.with_effects([load.at([3.0])]).simulate(u)
    np.testing.assert_allclose(pushed, simulator.simulate(u + 3.0), atol=1e-9)


def test_no_place_beside_an_input_that_drives_one_equation():
    assert beside("coulomb_friction", make(), road()) == []


def wheel_on_a_pendulum(x, u, p):
    torque = p[0] * u[0] - p[1] * x[2]
    return x[1], (-0.9 * np.sin(x[0]) - torque) / 0.02, torque / 2.5e-4


def make_wheel(unit="rad/s"):
    made = {"states": ["angle [rad]", "rate [rad/s]", f"wheel [{unit}]"], "inputs": ["torque [N m]"]}
    return ODESimulator(wheel_on_a_pendulum, dt=0.01, parameters={"a": 1.0, "b": 1e-5}, **made)


def test_a_speed_without_a_position_moves_with_others_too():
    for unit, found in (("rad/s", {(Port("state", 2), 0)}), ("bar", set())):
        placed = beside("coulomb_friction", make_wheel(unit), 0.01 * road())
        assert {(p.port, p.through) for p in placed} == found


@pytest.mark.parametrize(
    ("bent", "per_load", "found"),
    [
        (0.0, 1.0, True),
        (0.0, 0.0, False),  # a force is a rate then, in another unit
        (0.1, 1.0, False),  # what is added to such an input is no force
    ],
    ids=["loaded", "empty", "bent"],
)
def test_a_force_beside_an_input_moves_what_grows_heavier_less(bent, per_load, found):
    def belt(x, u, p):
        pull = p[0] * u[0] * (1.0 + bent * abs(u[0])) - p[1] * x[0]
        return pull / (180.0 + per_load * x[1]), u[1] - x[0] * x[1] / 9.0

    made = {"states": ["speed [m/s]", "load [kg]"], "inputs": ["torque [N m]", "feed [kg/s]"]}
    simulator = ODESimulator(belt, dt=0.1, parameters={"pull": 7.0, "drag": 110.0}, **made)
    u = np.array([25.0, 8.0]) + np.column_stack([200.0 * road(), 100.0 * road(seed=1)])
    placed = beside("constant_load", simulator, u)
    assert [(p.port, p.through) for p in placed] == [(Port("state", 0), 0)] * found
    for load in placed:
        braked = simulator.with_effects([load.at([-3.0])]).simulate(u)
        np.testing.assert_allclose(braked, simulator.simulate(u - (3.0, 0.0)), atol=1e-9)


def test_beside_an_input_values_to_begin_with_are_counted_as_it_is():
    """A torque that turns a wheel of 2.5e-4 kg m^2 is as many times less than the rate it gives."""
    simulator, u = make_wheel(), 0.01 * road()
    windows = cut([(slice(0, len(u)), 0)], 600, 12)
    whole = simulator.run(u, Windows.whole([slice(0, len(u))]), np.zeros((1, 3)))
    problem = Problem(simulator, u, whole.y, windows, Noise.white(np.ones(whole.y.shape[1])))
    model = Model(simulator.nominal, (), whole.x[windows.first])
    run, structure = problem.run(model), find_structure(simulator, whole.x, u)
    for code in ("coulomb_friction", "quadratic_drag", "constant_load"):
        found = enumerate_hypotheses([CATALOGUE[code]], problem, run, structure)
        plain, through = (
            next(h for h in found if h.placed.port == Port("state", 2) and h.placed.through == k)
            for k in (-1, 0)
        )
        np.testing.assert_allclose(through.starts[:, 0], 2.5e-4 * plain.starts[:, 0], rtol=1e-4)


def test_dry_friction_beside_an_input_holds_all_that_hangs_on_it():
    simulator, u = make_crane(), 10 * road() / 0.05
    (friction,) = beside("coulomb_friction", simulator, u)
    y = simulator.with_effects([friction.at([40.0])]).simulate(u)
    assert np.abs(y[:, 0]).max() < 1e-9


@pytest.mark.long
def test_what_brakes_the_cart_of_a_crane_is_named_in_newtons():
    def braked(x, u, p):
        s, c, push = np.sin(x[2]), np.cos(x[2]), u[0] - 15.0 * x[1] * abs(x[1])
        along = (push - p[1] * x[1] + 2.0 * s * (1.2 * x[3] ** 2 + 9.81 * c)) / (p[0] + 2.0 * s * s)
        return x[1], along, x[3], (-along * c - 9.81 * s) / 1.2 - p[2] * x[3]

    u = 600 * road(1500)
    y = make_crane(braked, substeps=40).simulate(u)
    y += 0.01 * y.std(axis=0) * np.random.default_rng(0).normal(size=y.shape)
    guessed = dict(zip(HELD, (9.0, 10.0, 0.08), strict=True))
    effects = ["quadratic_drag", "coulomb_friction", "constant_load"]
    dx = DiscrepancyRegressor(make_crane(parameters=guessed), effects=effects).fit(u, y)
    (finding,) = dx.findings_
    assert (finding.effect, finding.place) == ("quadratic_drag", "beside the input force")
    (size,), (unit,) = finding.parameters.values(), finding.units.values()
    assert size == pytest.approx(15.0, rel=0.05)
    assert unit == "N s^2/m^2"


@pytest.mark.parametrize(("substeps", "noise", "said"), [(1, 5e-5, True), (1, 5e-4, False), (8, 5e-5, False)])
def test_steps_too_coarse_for_what_was_found_are_told_with_the_way_out(substeps, noise, said):
    simulator, u = make_crane(substeps=substeps), 600 * road(1500)
    (friction,) = beside("coulomb_friction", simulator, u)
    acting = simulator.with_effects([friction.at([10.0])])
    windows = cut([(slice(0, len(u)), 0)], 300, 12)
    x = states_along(acting, u)
    problem = Problem(simulator, u, x[:, [0, 2]], windows, Noise.white(np.array([noise, noise])))
    model = Model(simulator.nominal, acting.effects, x[windows.first])
    found = too_coarse(problem, model)
    assert bool(found) is said
    if said:
        told = coarse_steps(simulator, found)
        assert "Pass substeps=4" in told.sentence
        assert told.evidence["output"] == "cart"


@pytest.mark.parametrize("made", ["strut", "crane"])
def test_forces_are_those_the_run_adds(made):
    if made == "strut":
        simulator, u = make(substeps=64), road(200)
        (placed,) = [p for p in places("coulomb_friction", simulator, u) if p.reacts]
        acting = simulator.with_effects([placed.at([0.5, WHEEL / BODY])])
    else:
        simulator, u = make_crane(substeps=64), 600 * road(200)
        (placed,) = beside("quadratic_drag", simulator, u)
        acting = simulator.with_effects([placed.at([15.0])])
    windows = Windows.whole([slice(0, len(u))])
    run = acting.run(u, windows, np.zeros((1, 4)))
    rows = np.arange(199)
    argument, force = state_forces(acting, run, u, windows, rows)[0]
    moving = np.abs(argument) > 0.02
    law = -0.5 * np.sign(argument) if made == "strut" else -15.0 * argument * np.abs(argument)
    np.testing.assert_allclose(argument, run.x[rows] @ placed.weights, atol=1e-12)
    np.testing.assert_allclose(force[moving], law[moving], atol=1e-9)


def muscle(x, u, p):
    """A pressure that moves a body and feels nothing of it."""
    return p[0] * u[0] - p[1] * x[0], x[2], p[2] * x[0] - p[3] * x[1] - p[4] * x[2]


@pytest.mark.parametrize(("units", "is_neighbour"), [(("", "", ""), False), (("m/s", "m", "m/s"), True)])
def test_what_feels_nothing_of_a_body_is_no_neighbour_where_nobody_told_units(units, is_neighbour):
    names = ("pressure", "position", "rate")
    simulator = ODESimulator(
        muscle,
        dt=0.01,
        parameters={"gain": 8.0, "leak": 8.0, "area": 30.0, "spring": 90.0, "damping": 6.0},
        states=[f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)],
        inputs=["valve"],
        output=(0, 1),
    )
    u = np.repeat(np.random.default_rng(0).uniform(0.0, 3.0, 20), 30)[:, None]
    found = places("load_friction", simulator, u)
    rubs = [(str(p.port), p.weights, p.second_name) for p in found]
    assert (("state:2", (0.0, 0.0, 1.0), "pressure") in rubs) is not is_neighbour  # it may press on what rubs
    assert any(np.count_nonzero(p.weights) == 2 for p in found) is is_neighbour

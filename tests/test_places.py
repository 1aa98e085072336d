"""Where effects are tried: places where one meets them, and odd ones."""

from dataclasses import replace

import numpy as np
import pytest
from small_machines import levels, make_axis, make_circuit, make_drive, tank

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.as_narx import effect_regressors
from narx_sklearn.discrepancy.findings import argument_told
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.search.places import placements
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.physics.effects import CATALOGUE


class TestPlaces:
    def structure_of(self, simulator, n=300):
        u = levels(np.random.default_rng(0), n)
        x = simulator.run(u, Windows.whole([slice(0, n)]), np.zeros((1, len(simulator.states)))).x
        return find_structure(simulator, x, u)

    def test_a_charge_is_the_position_of_a_current_but_its_equation_may_miss_physics(self):
        structure = self.structure_of(make_circuit())
        assert structure.partner == (-1, 0)
        assert structure.kinematic.tolist() == [False, False]
        arguments = {
            p.argument_name
            for p in placements(CATALOGUE["cubic_stiffness"], make_circuit(), structure)
            if p.port == Port("state", 1)
        }
        assert "capacitor" in arguments

    def test_friction_of_a_level_is_odd_and_that_of_a_speed_is_not(self):
        made = {"dt": 1.0, "parameters": {"a": 1.0, "b": 0.1}, "inputs": ["pump [V]"]}
        for state, odd in (
            ("level [m]", True),
            ("speed [rad/s]", False),
            ("speed [rpm]", False),
            ("level", False),
        ):
            simulator = ODESimulator(tank, states=[state], **made)
            rubbing = replace(CATALOGUE["coulomb_friction"], code="rubbing")  # a user's own says so itself
            for effect in (CATALOGUE["coulomb_friction"], rubbing):
                placed = placements(effect, simulator, self.structure_of(simulator))
                assert [p.odd for p in placed] == [odd]

    def test_a_machine_may_have_more_outputs_than_states_beside_two_drives(self):
        """A drift of the second output has no second signal; there is no second equation to ask for one."""

        def heated(x, u, p):
            return (p[0] * u[0] * u[0] - p[1] * (x[0] - u[1]),)

        simulator = ODESimulator(
            heated,
            dt=1.0,
            parameters={"a": 1.0, "b": 0.1},
            states=["temperature [degC]"],
            inputs=["current [A]", "air [degC]"],
            outputs=["voltage [V]", "temperature [degC]"],
            output=lambda x, u, p: (u[0] * p[0], x[0]),
        )
        u = np.column_stack([levels(np.random.default_rng(0), 300), np.linspace(15.0, 25.0, 300)])
        x = simulator.run(u, Windows.whole([slice(0, 300)]), np.full((1, 1), 20.0)).x
        placed = placements(CATALOGUE["additive_drift"], simulator, find_structure(simulator, x, u))
        assert [(p.port, p.second) for p in placed if p.port.kind == "output"] == [
            (Port("output", 0), ()),
            (Port("output", 1), ()),
        ]

    @pytest.mark.parametrize(
        ("charge", "temperature", "odd"),
        [("charge", "cell", False), ("charge", "cell [degC]", True), ("charge [m/s]", "cell [degC]", False)],
    )
    def test_a_state_without_a_unit_moves_only_where_none_has_one(self, charge, temperature, odd):
        def cell(x, u, p):
            return -p[0] * u[0], p[1] * u[0] * u[0] - x[1]

        states, parameters = [charge, temperature], {"a": 1.0, "b": 0.1}
        simulator = ODESimulator(cell, dt=1.0, parameters=parameters, states=states, inputs=["current [A]"])
        structure = self.structure_of(simulator)
        for code in ("coulomb_friction", "quadratic_drag"):
            placed = placements(CATALOGUE[code], simulator, structure)
            assert {p.odd for p in placed if p.port == Port("state", 0)} == {odd}

    def test_what_drives_a_state_equation_may_drift_there_where_it_enters_elsewhere_too(self):
        """A battery's capacity fades: the current fills it faster, and takes off the voltage what it did."""

        def drawn(x, u, p):
            return -p[0] * u[0], u[0] - x[1]

        def voltage(x, u, p):
            return (x[0] - p[1] * u[0],)

        made = {"dt": 1.0, "parameters": {"a": 1.0, "b": 0.1}, "inputs": ["current [A]"]}
        cell = ODESimulator(
            drawn, states=["charge", "late [A]"], output=voltage, outputs=["voltage [V]"], **made
        )
        fed = self.fed_by(cell)
        assert [(p.port, p.second) for p in fed] == [
            (Port("state", 0), (1.0, 0.0, 0.0)),
            (Port("state", 1), (1.0, 0.0, 0.0)),
        ]
        assert argument_told(fed[0]) == "u = current [A]"
        alone = ODESimulator(tank, states=["charge"], **made)
        assert self.fed_by(alone) == []  # a drift of the input is that

    def fed_by(self, simulator):
        """Return the places at which a gain drifts of what drives a state equation."""
        found = placements(CATALOGUE["gain_drift"], simulator, self.structure_of(simulator))
        return [placed for placed in found if placed.is_fed]

    def test_what_a_level_loses_is_not_tried_on_what_is_none(self):
        made = {"dt": 1.0, "parameters": {"a": 1.0, "b": 0.1}, "inputs": ["pump [V]"]}
        levels = ["level [m]", "volume [l]", "head [kPa]", "level sensor [V]", "value"]
        others = ["speed [rpm]", "speed [m/s]", "casing [degC]", "rise [K]", "current [mA]", "arm [deg]"]
        for state in levels + others:
            simulator = ODESimulator(tank, states=[state], **made)
            for code in ("root_outflow", "overflow"):
                found = placements(CATALOGUE[code], simulator, self.structure_of(simulator))
                assert bool(found) == (state in levels)

    @pytest.mark.parametrize(
        ("fed", "onward"), [("pool [m]", 1), ("pool [cm]", 1), ("pool", 1), ("flow [m3/s]", -1)]
    )
    def test_what_overflows_goes_on_to_what_is_counted_alike(self, fed, onward):
        def cascade(x, u, p):
            return p[0] * u[0] - p[1] * x[0], p[1] * x[0] - p[1] * x[1]

        made = {"dt": 1.0, "parameters": {"a": 1.0, "b": 0.1}, "inputs": ["pump [V]"]}
        simulator = ODESimulator(cascade, states=["tank [m]", fed], **made)
        placed = placements(CATALOGUE["overflow"], simulator, self.structure_of(simulator))
        assert {p.onward for p in placed if p.port == Port("state", 0)} == {-1, onward}

    def test_weight_is_met_on_an_angle_in_degrees_and_reads_it_in_radians(self):
        def arm(x, u, p):
            return x[1], p[0] * u[0] - p[1] * x[1]

        made = {"dt": 0.02, "parameters": {"a": 1.0, "b": 0.1}, "inputs": ["motor [V]"]}
        for unit, scale in (("rad", 1.0), ("deg", np.pi / 180), ("rev", 2 * np.pi), ("V", None)):
            simulator = ODESimulator(arm, states=[f"arm [{unit}]", f"speed [{unit}/s]"], **made)
            found = placements(CATALOGUE["gravity"], simulator, self.structure_of(simulator))
            at_speed = [p for p in found if p.port == Port("state", 1) and p.through < 0]
            assert [p.argument_unit for p in at_speed] == ([] if scale is None else ["rad"])
            assert [p.weights for p in at_speed] == ([] if scale is None else [(scale, 0.0)])
            heavy = simulator.with_effects([p.at((2.0, 0.5)) for p in at_speed])
            rate = heavy.run(np.zeros((2, 1)), Windows.whole([slice(0, 2)]), np.array([[0.3, 0.0]])).x[1, 1]
            if scale is not None:
                assert rate == pytest.approx(-2.0 * np.sin(0.3 * scale + 0.5) * 0.02, rel=0.01)
            assert len(effect_regressors(heavy)) == (scale == 1.0)  # a NARX model knows degrees only

    def test_what_slides_is_odd_in_a_circuit_where_a_diode_is_not(self):
        simulator = make_circuit()
        for code, odd in (
            ("presliding_friction", True),
            ("stribeck_friction", True),
            ("coulomb_friction", False),
        ):
            placed = placements(CATALOGUE[code], simulator, self.structure_of(simulator))
            assert [p.odd for p in placed if p.port == Port("state", 1)] == [odd]

    def test_a_spring_of_a_speed_is_odd_where_no_position_goes_with_it(self):
        made = {"dt": 1.0, "parameters": {"a": 1.0, "b": 0.1}, "inputs": ["pump [V]"]}
        spring = CATALOGUE["cubic_stiffness"]
        for state, odd in (("speed [rad/s]", True), ("position [m]", True), ("value", False)):
            simulator = ODESimulator(tank, states=[state], **made)
            assert [p.odd for p in placements(spring, simulator, self.structure_of(simulator))] == [odd]
        simulator = make_axis()
        placed = placements(spring, simulator, self.structure_of(simulator))
        assert [p.odd for p in placed if p.port == Port("state", 1)] == [False]

    def test_a_spring_between_two_bodies_acts_on_both_where_a_twist_is_all_that_is_known(self):
        def train(x, u, p):
            shaft = p[0] * x[0] + 1.2 * (x[1] - x[2])
            return x[1] - x[2], (u[0] - shaft) / 5.0, shaft / p[1]

        simulator = ODESimulator(
            train,
            dt=0.02,
            parameters={"shaft [N m/rad]": 8.0, "load [kg m^2]": 2.0},
            states=["twist [rad]", "motor [rad/s]", "load [rad/s]"],
            inputs=["torque [N m]"],
        )
        structure = self.structure_of(simulator)
        assert structure.kinematic.tolist() == [
            True,
            False,
            False,
        ]  # it is a definition: no place for physics
        assert structure.twists == [(0, 1, 2)]
        placed = placements(CATALOGUE["clearance"], simulator, structure)
        between, passed = (p for p in placed if not p.odd)
        assert (between.port, between.argument_name, between.onward) == (Port("state", 1), "twist", 2)
        assert between.share == pytest.approx(2.5)  # the load feels what the motor feels, over its inertia
        assert (passed.port, passed.handed_on) == (Port("state", 0), True)  # in place of spring and damper

    @pytest.mark.parametrize(("units", "is_twist"), [("m m/s m/s", True), ("m m^3/s m^3/s", False)])
    def test_a_level_between_two_flows_is_no_twist(self, units, is_twist):
        """Of a level something may be lost, where the equations are those of two bodies on a spring."""
        names = [f"{name} [{unit}]" for name, unit in zip("abc", units.split(), strict=True)]

        def rhs(x, u, p):
            return x[1] - x[2], u[0] - p[0] * x[0] - x[1], p[0] * x[0] - x[2]

        simulator = ODESimulator(rhs, dt=0.02, parameters={"p": 2.0}, states=names, inputs=["u"])
        assert self.structure_of(simulator).kinematic[0] == is_twist

    def test_a_difference_with_a_parameter_or_a_leak_of_its_own_is_no_twist(self):
        def make(rhs):
            return ODESimulator(
                rhs, dt=0.02, parameters={"p": 2.0}, states=["a", "b", "c"], inputs=["u"], output=(0,)
            )

        for rhs in (
            lambda x, u, p: (p[0] * x[1] - x[2], u[0] - x[0] - x[1], x[0] - x[2]),
            lambda x, u, p: (x[1] - x[2] - 0.1 * x[0], u[0] - x[0] - x[1], x[0] - x[2]),
            lambda x, u, p: (x[1] + x[2], u[0] - x[0] - x[1], -x[0] - x[2]),
            lambda x, u, p: (x[1] - x[2], u[0] - x[1], x[0] - x[2]),
        ):
            structure = self.structure_of(make(rhs))
            assert not structure.kinematic[0]
            assert structure.twists == []

    @pytest.mark.parametrize(
        ("units", "rate", "is_definition"),
        [
            ("m m/s m/s", lambda v, base, p: v - base, True),
            ("m m/s m/s", lambda v, base, p: v - p * base, False),  # p is to be found
            ("m m/s m/s", lambda v, base, p: v - 2.0 * base, False),
            ("m m/s m/s", lambda v, base, p: v - base * abs(base), False),
            ("m m^3/s m^3/s", lambda v, base, p: v - base, False),  # a store, of which something may be lost
            ("a a/s", lambda v, base, p: v - base, False),
        ],
    )
    def test_how_far_a_body_has_moved_from_a_base_is_a_definition(self, units, rate, is_definition):
        one, other, driven = [*units.split(), ""][:3]

        def wheel(x, u, p):
            return rate(x[1], u[0], p[0]), -40.0 * x[0] - x[1] + u[0]

        simulator = ODESimulator(
            wheel,
            dt=0.02,
            parameters={"p": 1.0},
            states=[f"deflection [{one}]", f"speed [{other}]"],
            inputs=[f"base [{driven}]" if driven else "base"],
        )
        structure = self.structure_of(simulator)
        assert structure.kinematic.tolist() == [is_definition, False]
        assert structure.rates == ()  # it is no integral of the speed alone
        if is_definition:
            found = placements(CATALOGUE["cubic_stiffness"], simulator, structure)
            assert [(p.port, p.argument_name) for p in found if not p.odd] == [
                (Port("state", 1), "deflection")
            ]

    def test_a_drive_may_pull_at_another_axis_and_gains_may_follow_each_other(self):
        def table_of_two(x, u, p):
            return x[1], p[0] * u[0] - p[1] * x[1], x[3], p[2] * u[1] - p[3] * x[3]

        two = ODESimulator(
            table_of_two,
            dt=0.02,
            parameters=dict(zip("abcd", (1.0, 2.0, 0.8, 1.5), strict=True)),
            states=["x [m]", "vx [m/s]", "y [m]", "vy [m/s]"],
            inputs=["motor x [V]", "motor y [V]", "hall [degC]"],
            output=(0, 2),
        )
        u = np.column_stack([levels(np.random.default_rng(k), 300, 5 + k) for k in range(3)])
        x = two.run(u, Windows.whole([slice(0, 300)]), np.zeros((1, 4))).x
        structure = find_structure(two, x, u)

        def told(code, kind):
            placed = placements(CATALOGUE[code], two, structure)
            return {(p.port.index, p.second_name) for p in placed if p.port.kind == kind}

        others = {(1, "motor y"), (1, "y"), (1, "vy"), (3, "motor x"), (3, "x"), (3, "vx")}
        assert told("coupling", "state") == {*others, (1, "hall"), (3, "hall")}
        seconds = {(0, "motor y"), (0, "hall"), (1, "motor x"), (1, "hall"), (2, "motor x"), (2, "motor y")}
        assert told("temperature_gain", "input") <= seconds
        assert {(0, "motor y"), (0, "hall"), (1, "motor x")} <= told("temperature_gain", "input")
        assert {name for _, name in told("temperature_gain", "state")} == {"hall"}
        # one drive is no other: it has no cross-talk with itself
        shaft = make_drive(
            lambda x, u, p: (x[1], u[0] - x[0] + x[2], x[3], x[0] - x[2]), 0.01, "torque [N m]"
        )
        assert not placements(CATALOGUE["coupling"], shaft, self.structure_of(shaft))

    @pytest.mark.long
    def test_what_one_motor_does_to_the_other_axis_is_named(self):
        def two(x, u, p):
            return x[1], p[0] * u[0] - 2 * x[1] - 30 * x[0], x[3], p[1] * u[1] - 1.5 * x[3] - 20 * x[2]

        def talking(x, u, p):
            pull = p[1] * u[1] + 0.12 * u[0]
            return x[1], p[0] * u[0] - 2 * x[1] - 30 * x[0], x[3], pull - 1.5 * x[3] - 20 * x[2]

        def make(equations, *gains):
            return ODESimulator(
                equations,
                dt=0.01,
                parameters=dict(zip("ab", gains, strict=True)),
                states=["x [m]", "vx [m/s]", "y [m]", "vy [m/s]"],
                inputs=["motor x [V]", "motor y [V]"],
                output=(0, 2),
            )

        rng = np.random.default_rng(0)
        u = np.column_stack([levels(rng, 1200, 18), levels(rng, 1200, 23)])
        y = make(talking, 1.0, 0.8).simulate(u)
        y += 0.01 * y.std(axis=0) * rng.normal(size=y.shape)
        effects = ["coupling", "constant_load", "coulomb_friction", "cubic_stiffness"]
        found = DiscrepancyRegressor(make(two, 1.1, 0.9), effects=effects).fit(u, y)
        (finding,) = found.findings_
        assert (found.verdict_, finding.effect, finding.port) == ("explained", "coupling", "state:3")
        assert finding.parameters["b"] == pytest.approx(0.12, rel=0.05)

    @pytest.mark.long
    def test_friction_may_grow_with_whatever_drives_the_motion(self):
        def drive(x, u, p):
            twist = p[1] * (x[0] - x[2]) + p[2] * (x[1] - x[3])
            return x[1], p[0] * u[0] - twist, x[3], twist

        simulator = make_drive(drive, 0.01, "torque [N m]", gain=1.0, shaft=30.0, damping=0.5)
        placed = placements(CATALOGUE["load_friction"], simulator, self.structure_of(simulator))
        drives = {(p.port.index, p.second, p.second_name, p.second_unit) for p in placed}
        assert drives == {
            (1, (), "", ""),
            (1, (1.0, 0.0, 0.0, 0.0, 0.0), "torque", "N m"),
            (1, (0.0, 1.0, 0.0, -1.0, 0.0), "motor - load", "rad"),
            (3, (), "", ""),
            (3, (0.0, -1.0, 0.0, 1.0, 0.0), "load - motor", "rad"),
        }

        u = 5 * levels(np.random.default_rng(1), 800)
        rubbing = next(p for p in placed if p.second_name == "motor - load").at([2.0])
        y = simulator.with_effects([rubbing]).simulate(u)
        found = DiscrepancyRegressor(simulator, max_effects=1, random_state=0).fit(
            u, y + 1e-3 * np.std(y) * np.random.default_rng(2).standard_normal(y.shape)
        )
        assert found.findings_[0].effect == "load_friction"
        assert found.simulator_.effects[0].second_name in ("motor - load", "load - motor")
        assert ", L = " in found.findings_[0].argument


@pytest.mark.long
def test_a_capacity_that_fades_is_a_gain_that_drifts_of_what_fills_it():
    """The current fills a cell that holds ever less ever faster, and takes off the voltage what it did."""

    def cell(x, u, p):
        return (-u[0] / p[0],)

    def voltage(x, u, p):
        return (3.2 + 0.9 * x[0] - p[1] * u[0],)

    def made(capacity, resistance):
        return ODESimulator(
            cell,
            dt=10.0,
            parameters={"capacity [A s]": capacity, "resistance [ohm]": resistance},
            states=["charge"],
            inputs=["current [A]"],
            output=voltage,
            outputs=["voltage [V]"],
        )

    rng = np.random.default_rng(0)
    steps = np.repeat(rng.uniform(-5.0, 5.0, 60), 25)
    u = (steps - steps.mean() + 2.0 * np.sin(2 * np.pi * np.arange(1500) / 600))[:, None]
    fade = 1.0 - 0.2 * np.arange(1500) / 1500
    charge = 0.6 - 10.0 * np.append(0.0, np.cumsum(u[:, 0] / (12000.0 * fade))[:-1])
    y = 3.2 + 0.9 * charge[:, None] - 0.02 * u + 0.003 * rng.normal(size=u.shape)
    found = DiscrepancyRegressor(made(11000.0, 0.018), random_state=0).fit(u, y)
    told = found.findings_[0]
    assert (told.effect, told.port, told.argument) == ("gain_drift", "state:0", "u = current [A]")
    assert not any(finding.port == "input:0" for finding in found.findings_)
    assert found.simulator_.nominal == pytest.approx([12000.0, 0.02], rel=0.03)

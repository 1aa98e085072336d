"""What is in proportion and was left out: a spring, a loss of heat, what another signal brings in."""

import numpy as np
import pytest

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.search.places import placements
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.physics.effects import CATALOGUE

RIVALS = ["linear_stiffness", "constant_load", "viscous_damping", "coupling", "cross_sensitivity", "lag"]


def levels(rng, n, held, low=-1.0, high=1.0):
    return np.repeat(rng.uniform(low, high, n // held + 1), held)[:n, None]


def told(simulator, truth, u, rng, effects=(), share=0.01):
    """Return a diagnosis of what a true simulator does, with noise."""
    y = truth.simulate(u)
    y = y + share * y.std(axis=0) * rng.standard_normal(y.shape)
    return DiscrepancyRegressor(simulator, effects=[*RIVALS, *effects], random_state=0).fit(u, y)


def slide(spring=0.0, at=0.0, mass=1.5, rubs=3.0):
    def rates(x, u, p):
        return x[1], (u[0] - p[1] * x[1] - spring * (x[0] - at)) / p[0]

    return ODESimulator(
        rates,
        dt=0.01,
        parameters={"mass": mass, "rubs": rubs},
        states=["x [m]", "v [m/s]"],
        inputs=["force [N]"],
        output=lambda x, u, p: (x[0],),
        outputs=["x [m]"],
    )


def bodies(loss=0.0, **changed):
    """Return two bodies that exchange heat, of which the second loses some; the first too, if told so."""
    parameters = {"C1": 900.0, "k": 2.0, "C2": 2500.0, "lost": 0.8} | changed

    def rates(x, u, p):
        between = p[1] * (x[0] - x[1])
        return (u[0] - between - loss * (x[0] - 21.0)) / p[0], (between - p[3] * (x[1] - 21.0)) / p[2]

    return ODESimulator(
        rates,
        dt=10.0,
        parameters=parameters,
        states=["T1 [degC]", "T2 [degC]"],
        inputs=["power [W]"],
        output=(0, 1),
        x0=[21.0, 21.0],
    )


def motor(back=0.08, feels=0.0, pick_up=0.0, **changed):
    """Return a motor whose current feels its speed by ``back``; what its sensors pick up of other signals."""
    parameters = {"J": 2e-3, "K": 0.08, "b": 1e-3, "R": 1.2, "L": 6e-3} | changed

    def rates(x, u, p):
        return (p[1] * x[1] - p[2] * x[0]) / p[0], (u[0] - p[3] * x[1] - back * x[0]) / p[4]

    return ODESimulator(
        rates,
        dt=0.002,
        parameters=parameters,
        states=["w [rad/s]", "i [A]"],
        inputs=["u [V]"],
        output=lambda x, u, p: (x[0] + feels * x[1], x[1] + pick_up * u[0]),
        outputs=["w [rad/s]", "i [A]"],
    )


@pytest.mark.long
def test_a_spring_that_was_left_out_is_told_with_its_rest():
    rng = np.random.default_rng(0)
    found = told(
        slide(mass=1.7, rubs=2.5), slide(40.0, 0.05), levels(rng, 3000, 30, -10, 10), rng, ["clearance"]
    )
    (finding,) = found.findings_
    assert (found.verdict_, finding.effect, finding.port) == ("explained", "linear_stiffness", "state:1")
    assert finding.parameters["k"] == pytest.approx(40 / 1.5, rel=0.01)
    assert finding.parameters["r"] == pytest.approx(0.05, abs=0.003)
    assert found.parameters_.loc["mass", "augmented"] == pytest.approx(1.5, rel=0.01)


@pytest.mark.long
def test_a_loss_of_heat_that_was_left_out_is_no_body_that_follows():
    rng = np.random.default_rng(1)
    nominal = bodies(C1=1000.0, k=1.7, C2=2300.0, lost=0.9)
    u = levels(rng, 2000, 60, 0.0, 150.0)
    found = told(nominal, bodies(1.2), u, rng, ["extra_mode"], share=0.003)
    (finding,) = found.findings_
    assert (finding.effect, finding.port) == ("linear_stiffness", "state:0")
    assert finding.parameters["k"] == pytest.approx(1.2 / 900, rel=0.03)
    assert finding.parameters["r"] == pytest.approx(21.0, abs=0.5)
    assert found.parameters_.loc["k", "augmented"] == pytest.approx(2.0, rel=0.03)


@pytest.mark.long
def test_a_state_may_drive_another_whose_equation_does_not_say_so():
    rng = np.random.default_rng(2)
    nominal = motor(back=0.0, J=2.3e-3, b=1.2e-3, R=1.0, L=7e-3)
    found = told(nominal, motor(), levels(rng, 3000, 40, -12, 12), rng)
    (finding,) = found.findings_
    # where the motor's friction is free of sign, a current that is read with a part of the speed is the same
    assert "coupling" in (finding.effect, *finding.lookalikes)
    assert found.scores_.loc["augmented", "nrmse"] < 0.02


@pytest.mark.long
def test_a_sensor_may_show_a_part_of_another_signal():
    rng = np.random.default_rng(3)
    nominal = motor(J=2.3e-3, K=0.07, b=1.2e-3, R=1.0, L=7e-3)
    found = told(nominal, motor(pick_up=0.15), levels(rng, 3000, 40, -12, 12), rng)
    (finding,) = found.findings_
    assert (found.verdict_, finding.effect, finding.port) == ("explained", "cross_sensitivity", "output:1")
    assert finding.parameters["b"] == pytest.approx(0.15, rel=0.03)
    assert found.parameters_.loc["R", "augmented"] == pytest.approx(1.2, rel=0.01)


@pytest.mark.long
def test_what_wind_does_goes_by_its_square():
    def blown(drag, mass=1.5, rubs=3.0, spring=40.0):
        def rates(x, u, p):
            pushed = u[0] + drag * u[1] * abs(u[1])
            return x[1], (pushed - p[1] * x[1] - p[2] * x[0]) / p[0]

        return ODESimulator(
            rates,
            dt=0.01,
            parameters={"mass": mass, "rubs": rubs, "spring": spring},
            states=["x [m]", "v [m/s]"],
            inputs=["force [N]", "wind [m/s]"],
            output=lambda x, u, p: (x[0],),
            outputs=["x [m]"],
        )

    rng = np.random.default_rng(6)
    u = np.column_stack([levels(rng, 3000, 30, -10, 10), levels(rng, 3000, 45, -8, 8)])
    effects = ["quadratic_coupling", "cogging"]
    found = told(blown(0.0, mass=1.7, rubs=2.5, spring=45.0), blown(0.05), u, rng, effects)
    (finding,) = found.findings_
    assert (found.verdict_, finding.effect, finding.port) == ("explained", "quadratic_coupling", "state:1")
    assert finding.parameters["b"] == pytest.approx(0.05 / 1.5, rel=0.03)


def room(share=0.0, **changed):
    """Return a heated room whose sensor shows a share of its wall, which nothing else shows."""
    parameters = {"C_air": 60.0, "C_wall": 900.0, "inside": 1.2} | changed

    def rates(x, u, p):
        to_wall = p[2] * (x[0] - x[1])
        return (u[0] - to_wall - 0.25 * (x[0] - u[1])) / p[0], (to_wall - 0.4 * (x[1] - u[1])) / p[1]

    return ODESimulator(
        rates,
        dt=10.0,
        parameters=parameters,
        states=["air [degC]", "wall [degC]"],
        inputs=["heater [W]", "outdoors [degC]"],
        output=lambda x, u, p: (x[0] + share * (x[1] - x[0]),),
        outputs=["air [degC]"],
        x0=[5.0, 3.0],
    )


@pytest.mark.long
def test_a_sensor_may_sit_between_two_places_of_which_nothing_shows_one():
    rng = np.random.default_rng(5)
    u = np.column_stack([levels(rng, 3000, 80, 0.0, 20.0), levels(rng, 3000, 400, -5.0, 10.0)])
    nominal = room(C_air=70.0, C_wall=800.0, inside=1.0)
    found = told(nominal, room(0.3), u, rng, ["mixed_reading", "scale_error", "extra_mode"], share=0.005)
    (finding,) = found.findings_
    assert (found.verdict_, finding.effect, finding.port) == ("explained", "mixed_reading", "output:0")
    assert finding.parameters["b"] == pytest.approx(0.3, rel=0.02)
    assert found.parameters_.loc["C_air", "augmented"] == pytest.approx(60.0, rel=0.01)


def receiver(**changed):
    """Return an air receiver, filled from a supply of 8 bar through a valve and emptied by what is drawn."""
    parameters = {"volume": 9.0, "fills": 0.14, "leaks": 0.035} | changed
    return ODESimulator(
        lambda x, u, p: ((p[1] * u[0] * (8.0 - x[0]) - p[2] * x[0] - u[1]) / p[0],),
        dt=2.0,
        parameters=parameters,
        states=["P [bar]"],
        inputs=["valve", "drawn"],
        outputs=["P [bar]"],
        x0=[2.0],
    )


def test_a_sensor_may_be_of_another_scale():
    rng = np.random.default_rng(5)
    u = np.column_stack([levels(rng, 3000, 60, 0.2, 1.0), levels(rng, 3000, 45, 0.0, 0.3)])
    y = 1.04 * receiver().simulate(u)
    y += 0.02 * rng.standard_normal(y.shape)
    off = receiver(volume=7.5, fills=0.16, leaks=0.03)
    effects = [*RIVALS, "scale_error", "sensor_bias", "creep"]
    found = DiscrepancyRegressor(off, effects=effects, random_state=0).fit(u, y)
    (finding,) = found.findings_
    assert "scale_error" in (finding.effect, *finding.lookalikes)
    assert finding.port == "output:0"
    assert found.parameters_.loc["volume", "augmented"] == pytest.approx(9.0, rel=0.02)


def station(zero=0.0, **changed):
    """Return a gas network behind a choked valve, whose flow goes with the pressure before it."""
    parameters = {"volume": 600.0, "valve": 1.1, "load": 190.0} | changed
    return ODESimulator(
        lambda x, u, p: ((p[1] * u[0] * (u[1] + zero) - p[2] * x[0]) / p[0],),
        dt=0.05,
        parameters=parameters,
        states=["p [bar]"],
        inputs=["opening [%]", "before [bar]"],
        outputs=["p [bar]"],
        x0=[3.0],
    )


def test_an_input_may_be_counted_from_another_zero():
    rng = np.random.default_rng(8)
    u = np.column_stack([levels(rng, 3000, 60, 20.0, 90.0), levels(rng, 3000, 45, 4.0, 9.0)])
    effects = ["input_offset", "scale_error", "gain_drift", "input_polynomial"]
    nominal = station(volume=500.0, valve=1.3, load=160.0)
    found = told(nominal, station(1.013), u, rng, effects)
    (finding,) = found.findings_
    assert (found.verdict_, finding.effect, finding.port) == ("explained", "input_offset", "input:1")
    assert finding.parameters["b"] == pytest.approx(1.013, rel=0.05)


class TestPlaces:
    def places(self, code, simulator, held=5):
        rng = np.random.default_rng(4)
        x = rng.standard_normal((200, len(simulator.states)))
        u = np.repeat(rng.standard_normal((200 // held, len(simulator.inputs))), held, axis=0)
        return placements(CATALOGUE[code], simulator, find_structure(simulator, x, u))

    def test_a_spring_acts_on_the_position_and_a_loss_on_the_state_itself(self):
        assert [(p.port.index, p.weights) for p in self.places("linear_stiffness", slide())] == [
            (1, (1.0, 0.0))
        ]
        found = {(p.port.index, p.weights) for p in self.places("linear_stiffness", bodies())}
        assert {(0, (1.0, 0.0)), (1, (0.0, 1.0))} <= found

    def test_an_offset_is_one_of_inputs_that_act_more_or_less_by_something_else(self):
        assert [p.port.index for p in self.places("input_offset", station())] == [0, 1]
        assert self.places("input_offset", slide()) == []  # there it is a load

    def test_a_state_couples_into_an_equation_that_does_not_feel_it(self):
        (back,) = self.places("coupling", motor(back=0.0))
        assert (back.port.index, back.second, back.second_name) == (1, (0.0, 1.0, 0.0), "w")
        assert self.places("coupling", motor()) == []
        assert self.places("coupling", slide()) == []  # a position and its own rate

    def test_a_sensor_feels_what_it_is_not_made_of_and_what_drives_that_is_odd(self):
        found = {(p.port.index, p.second_name): p.odd for p in self.places("cross_sensitivity", motor())}
        assert found == {(0, "u"): False, (0, "i"): True, (1, "u"): True, (1, "w"): True}
        slid = {p.second_name: p.odd for p in self.places("cross_sensitivity", slide())}
        assert slid == {"force": False}

    def test_a_sensor_sits_between_places_of_one_quantity(self):
        found = [(p.port.index, p.second, p.second_unit) for p in self.places("mixed_reading", room())]
        outdoors, wall = (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
        assert found == [(0, outdoors, "degC"), (0, wall, "degC")]
        assert self.places("mixed_reading", slide()) == []  # nor is a position its own rate
        assert self.places("mixed_reading", motor()) == []

    def test_what_may_come_from_a_controller_is_nothing_that_a_sensor_feels(self):
        """It has the noise of what it controls in it, which it would explain."""
        assert self.places("cross_sensitivity", slide(), held=1) == []

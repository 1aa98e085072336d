"""A gain, or a reading, that ripples with an angle: told where no name does it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.bank import make_bank
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.detect import NONE_SILENT
from narx_sklearn.discrepancy.search.explain import refit_leaders
from narx_sklearn.discrepancy.search.ranking import leaders
from narx_sklearn.discrepancy.search.unnamed.ripples import reading_hypotheses, ripple_hypotheses
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.physics.effects import CATALOGUE

DT, SIGMA = 0.05, 0.01
SIZES = st.floats(-5.0, 5.0)


def test_a_linear_motor_cogs_by_its_pitch_in_millimetres():
    def axis(mass, rubs, cogs=0.0):
        def rates(x, u, p):
            ripple = cogs * np.sin(2 * np.pi * x[0] / 24.0 + 0.6)
            return x[1], (u[0] - p[1] * x[1] - ripple) / p[0] - 9.0 * x[0]

        return ODESimulator(
            rates,
            dt=0.01,
            parameters={"mass": mass, "rubs": rubs},
            states=["x [mm]", "v [mm/s]"],
            inputs=["force [N]"],
            output=(0,),
            outputs=["x [mm]"],
        )

    rng = np.random.default_rng(2)
    u = np.repeat(rng.uniform(-1200.0, 1200.0, 60), 30)[:, None]
    y = axis(2.0, 5.0, 150.0).simulate(u)
    y += 2.0 * rng.standard_normal(y.shape)
    assert np.ptp(y) > 100.0
    effects = ["cogging", "cubic_stiffness", "coulomb_friction", "gravity"]
    found = DiscrepancyRegressor(axis(2.2, 4.5), effects=effects, random_state=0).fit(u, y)
    (finding,) = found.findings_
    assert (found.verdict_, finding.effect, finding.port) == ("explained", "cogging", "state:1")
    assert finding.parameters["N"] == pytest.approx(2 * np.pi / 24.0, rel=0.01)
    assert finding.parameters["a"] == pytest.approx(75.0, rel=0.1)


def pump(x, u, p):
    """A rotor that turns as fast as it is told, and the level that it fills."""
    return p[1] * u[0], p[0] * u[0] - p[2] * x[1]


def make_pump(off=1.0, unit="rad"):
    return ODESimulator(
        pump,
        dt=DT,
        parameters={"gain [m/rad]": 1.0 / off, "ratio": 1.0, "leak [1/s]": 0.3 * off},
        states=[f"phi [{unit}]", "level [m]"],
        inputs=["speed [rad/s]"],
        output=(0, 1),
    )


def recorded(rippled=0.0, cogged=0.0, n=1500, finer=20):
    """Step the machine by Euler's method, far finer than it is measured."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1.0, 3.0, n // 25), 25)[:, None]
    x, y = np.zeros(2), np.empty((n, 2))
    for k, (speed,) in enumerate(u):
        y[k] = x
        for _ in range(finer):
            wave = np.sin(3.0 * x[0] + 0.4)
            flow = speed * (1.0 + rippled * wave) + cogged * wave
            x = x + DT / finer * np.array([speed, flow - 0.3 * x[1]])
    return u, y + SIGMA * rng.normal(size=y.shape)


def refitted(u, y):
    simulator, windows = make_pump(1.1), cut([(slice(0, len(u)), 0)], 300, 12)
    problem = Problem(simulator, u, y, windows, Noise.white(np.full(2, SIGMA)))
    return problem, fit(problem, Model(simulator.nominal, (), y[windows.first]))


def hypotheses(simulator, x, u):
    return ripple_hypotheses(simulator, find_structure(simulator, x, u), x)


def best_ripple(problem, base):
    found = hypotheses(problem.simulator, problem.run(base.model).x, problem.u)
    placed = leaders(make_bank(problem, base, found), 3, NONE_SILENT, 1.0)
    return refit_leaders(problem, base, placed, None, finished=1, twins=0)[0]


def test_what_enters_an_equation_is_tried_with_each_angle():
    u, y = recorded()
    found = hypotheses(make_pump(), y, u)
    tried = [(str(h.placed.port), h.placed.argument_name, h.placed.second_name) for h in found]
    assert tried == [
        ("state:0", "phi", "speed"),
        ("state:1", "phi", "speed"),
        ("state:1", "phi", "level"),  # but never an angle with itself, nor a level, which is drawn back
    ]
    assert found[0].placed.second == (1.0, 0.0, 0.0)
    assert set(found[0].starts[:, 1]) == set(range(1, 17))


@pytest.mark.parametrize(
    ("unit", "turns", "slowest"), [("rad", 3.0, 1.0), ("rad", 0.5, 4.0), ("mm", 3.0, 2 / 3)]
)
def test_what_turns_round_has_whole_waves_and_all_else_two_where_it_went(unit, turns, slowest):
    u, y = recorded()
    y[:, 0] *= 2 * np.pi * turns / np.ptp(y[:, 0])
    waves = hypotheses(make_pump(unit=unit), y, u)[0].starts[:, 1]
    assert waves.min() == pytest.approx(slowest)


def test_degrees_are_read_as_radians():
    u, y = recorded()
    placed = hypotheses(make_pump(unit="deg"), y, u)[0].placed
    assert placed.weights == (pytest.approx(np.pi / 180), 0.0)
    assert placed.argument_unit == "rad"


def test_what_stands_still_ripples_nothing():
    u, y = recorded()
    assert hypotheses(make_pump(), np.zeros_like(y), u) == []


@given(a=SIZES, wave=st.floats(0.1, 9.0), p=SIZES, x=SIZES, w=SIZES)
def test_the_force_is_the_signal_times_a_sine(a, wave, p, x, w):
    u, y = recorded(n=100)
    force, nothing = hypotheses(make_pump(), y, u)[0].placed.effect.force, np.zeros(1)
    value = force(x, 0.0, 0.0, w, 0.0, DT, nothing, np.array([a, wave, p]), nothing)
    assert value == pytest.approx(a * w * np.sin(wave * x + p), abs=1e-12)


def test_it_is_found_with_its_waves():
    problem, base = refitted(*recorded(rippled=0.25))
    law = best_ripple(problem, base)
    placed = law.effects[-1].with_positive_amplitude()
    assert (placed.port, placed.second_name) == (Port("state", 1), "speed")
    assert placed.theta == pytest.approx((0.25, 3.0, 0.4), abs=0.02)
    assert law.fit.cost < 1.1 * problem.n_seen < 0.1 * base.cost


def test_a_ripple_at_any_speed_is_none_of_a_gain():
    """The cogging of the catalogue is likelier there by far; the other where a gain ripples."""
    cogging = PlacedEffect(
        CATALOGUE["cogging"], Port("state", 1), (1.0, 0.0), theta=(0.3, 3.0, 0.4, 0.0, 0.0)
    )
    for truth in ({"cogged": 0.4}, {"rippled": 0.25}):
        problem, base = refitted(*recorded(**truth))
        named = Candidate(fit(problem, base.model._replace(effects=(cogging,))), problem.n_seen)
        likelier = best_ripple(problem, base).criterion - named.criterion
        assert (likelier > 100) if "cogged" in truth else (likelier < -100)


@pytest.mark.long
def test_a_pump_that_ripples_is_told_and_its_model_holds_on_what_was_held_out():
    """Where laws are not asked for it passes for a disturbance that follows no signal."""
    dx = DiscrepancyRegressor(make_pump(1.1), random_state=0).fit(*recorded(rippled=0.25))
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.effect, finding.port) == ("unknown", "unknown", "state:1")
    assert "a w sin(N x + p), x = phi [rad], w = speed [rad/s]" in dx.report_
    assert finding.parameters["a"] == pytest.approx(0.25, abs=0.02)
    assert finding.parameters["N"] == pytest.approx(3.0, abs=0.02)
    left = dx.scores_["nrmse"]
    assert left["augmented"] < 0.5 * left["refitted"]


class TestReadings:
    def test_all_that_turns_round_has_whole_waves_whatever_its_unit(self):
        y = np.linspace(0.0, 20.0, 500)[:, None] * [1.0, 0.1]
        one, many = reading_hypotheses(make_pump(), y)[0], reading_hypotheses(make_pump(), y)
        assert [h.placed.port.index for h in many] == [0] * 16 + [1] * 15
        assert (one.placed.bounds[4] == (0.25, 1.75)).all()
        (found,) = {
            tuple(h.placed.bounds[4]) for h in reading_hypotheses(make_pump(unit="deg"), y * 180 / np.pi)[:1]
        }
        assert found == pytest.approx((0.25 * np.pi / 180, 1.75 * np.pi / 180))
        assert reading_hypotheses(make_pump(), np.zeros((5, 2))) == []

    @given(a=SIZES, b=SIZES, c=SIZES, d=SIZES, wave=st.floats(0.1, 9.0), s=SIZES)
    def test_a_reading_is_off_by_two_harmonics(self, a, b, c, d, wave, s):
        (law, *_) = reading_hypotheses(make_pump(), np.linspace(0.0, 20.0, 50)[:, None] * [1.0, 0.1])
        theta, signal = np.array([a, b, c, d, wave]), np.array([s, 0.0])
        read = law.placed.effect.transform(signal, None, DT, theta, np.zeros(1, int))
        turned = wave * s
        off = a * np.cos(turned) + b * np.sin(turned) + c * np.cos(2 * turned) + d * np.sin(2 * turned)
        assert read == pytest.approx([s + off, a + c], abs=1e-12)
        nothing = np.zeros(1)
        assert law.placed.effect.force(s, 0.0, 0.0, 0.0, 0.0, DT, nothing, theta, nothing) == pytest.approx(
            off
        )

    def test_a_disc_that_does_not_run_true_is_found_with_its_turn(self):
        u, y = recorded()
        y[:, 0] += 0.05 * np.sin(y[:, 0] + 0.9) + 0.02 * np.cos(2 * y[:, 0])
        problem, base = refitted(u, y)
        found = reading_hypotheses(problem.simulator, problem.run(base.model).y)
        placed = leaders(make_bank(problem, base, found), 3, NONE_SILENT, 1.0)
        law = refit_leaders(problem, base, placed, None, finished=1, twins=0)[0]
        assert law.effects[-1].port == Port("output", 0)
        told = (0.05 * np.sin(0.9), 0.05 * np.cos(0.9), 0.02, 0.0, 1.0)
        assert law.effects[-1].theta == pytest.approx(told, abs=0.004)
        assert law.fit.cost < 1.1 * problem.n_seen < 0.3 * base.cost

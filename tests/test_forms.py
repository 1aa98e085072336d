"""What a set of names leaves because their forms are idealised is no reason to call it unknown."""

from dataclasses import replace

import numpy as np
import pytest

from narx_sklearn import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.forms import own_forms
from narx_sklearn.discrepancy.stages.naming import _without_form_menders
from narx_sklearn.physics.effects import CATALOGUE

N, DT, NOISE = 3000, 0.02, 0.01
STATES = ["position [m]", "velocity [m/s]"]
TRUE = {"gain [m/s^2/V]": 1.1, "damping [1/s]": 0.7, "stiffness [1/s^2]": 11.0}
POSITION, VELOCITY = (1.0, 0.0), (0.0, 1.0)


def stage(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def levelling(x, u, p):
    """Pull with a spring whose even part levels off, and hum at 1.3 Hz (a second input)."""
    force = p[0] * u[0] - p[1] * x[1] - p[2] * x[0]
    return x[1], force - 3.0 * x[0] ** 2 / (1.0 + 0.4 * x[0] ** 2) + u[1]


def simulator(rhs=stage, inputs=("drive [V]",), parameters=TRUE):
    return ODESimulator(rhs, dt=DT, parameters=parameters, states=STATES, inputs=list(inputs))


def recorded(amplitude):
    rng = np.random.default_rng(3)
    u = np.repeat(rng.normal(0, 4, N // 10), 10)
    hum = amplitude * np.sin(2 * np.pi * 1.3 * DT * np.arange(N) + 0.4)
    y = simulator(levelling, ("drive [V]", "hum [m/s^2]")).simulate(np.column_stack([u, hum]))[:, 0]
    return u, y + NOISE * rng.normal(size=N)


def at(code, weights, theta, name):
    return PlacedEffect(
        CATALOGUE[code], Port("state", 1), weights=weights, theta=theta, argument_name=name, argument_unit="-"
    )


@pytest.fixture(scope="module")
def record():
    return recorded(2.5)


QUADRATIC = at("quadratic_stiffness", POSITION, (2.0,), "position")
CUBIC = at("cubic_stiffness", POSITION, (0.5,), "position")
HUM = at("periodic_disturbance", (), (2.5, 2 * np.pi * 1.3, 0.4), "")


def fitted(record, *effects):
    u, y = record
    sim = simulator()
    problem = Problem(
        sim, u[:, None], y[:, None], cut([(slice(0, N), 0)], 500, 12), Noise.white(np.array([NOISE]))
    )
    found = fit(problem, Model(sim.nominal, tuple(effects), np.zeros((problem.windows.count, 2))))
    run = problem.run(found.model)
    return problem, Candidate(found, problem.n_seen), find_structure(sim, run.x, problem.u)


def test_a_curve_along_its_own_argument_is_a_names_form(record):
    (form,) = own_forms(*fitted(record, QUADRATIC, HUM))
    assert form.placed.port == Port("state", 1)
    assert form.placed.weights == POSITION


def test_two_names_on_one_signal_have_no_forms_of_their_own(record):
    assert own_forms(*fitted(record, QUADRATIC, CUBIC)) == []


def test_a_name_that_leaves_much_to_a_curve_is_the_wrong_name(record):
    problem, best, structure = fitted(record, CUBIC, HUM)
    assert own_forms(problem, best, structure) == []


def test_what_only_mends_the_form_of_a_name_is_no_second_name():
    """A drift that pays for itself beside an idealised spring does not beside a spring of another form."""
    drift = at("gain_drift", POSITION, (0.1, 20.0, 0.0), "position")
    problem, pair, structure = fitted(recorded(0.0), QUADRATIC, drift)
    _, alone, _ = fitted(recorded(0.0), QUADRATIC)
    assert _without_form_menders(problem, pair, [], structure, None).places == alone.places
    problem, pair, structure = fitted(recorded(2.5), QUADRATIC, HUM)
    assert _without_form_menders(problem, pair, [], structure, None) is pair


def test_a_value_that_is_the_best_of_very_many_pays_for_them(record):
    """A saw tooth of the best of 65535 steps takes 22 noise variances off white noise."""
    step = PlacedEffect(
        CATALOGUE["quantisation"], Port("output", 0), theta=(0.005,), argument_name="position"
    )
    _, rounded, _ = fitted(record, step)
    _, offset, _ = fitted(record, replace(step, effect=replace(step.effect, n_apart=0)))
    assert rounded.price - offset.price == pytest.approx(2 * np.log(65535))


@pytest.mark.long
def test_names_with_another_form_are_still_named(record):
    u, y = record
    wrong = {name: value * off for (name, value), off in zip(TRUE.items(), (0.9, 1.2, 1.1), strict=True)}
    dx = DiscrepancyRegressor(simulator(parameters=wrong)).fit(u, y)
    assert dx.verdict_ in ("explained", "ambiguous"), dx.report_
    assert {f.effect for f in dx.findings_} == {"quadratic_stiffness", "periodic_disturbance"}

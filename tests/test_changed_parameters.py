"""A parameter of the simulator that is another one for a while: run, tangent, and how it is told."""

import numpy as np
import pytest

from narx_sklearn.discrepancy import CallableSimulator, DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import Span
from narx_sklearn.discrepancy.search.unnamed.varying import change_hypotheses
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.windows import cut

DT, N = 1.0, 900
TRUE = {"lag [s]": 2.5, "syringe [mL/kPa]": 0.09, "filter [kPa s/mL]": 20.0, "catheter [kPa s/mL]": 60.0}


def line(x, u, p):
    """A syringe, a filter and a catheter into a vein: how much flows in, and both pressures."""
    through = (x[1] - x[2]) / p[2]
    return (u[0] - x[0]) / p[0], (x[0] - through) / p[1], (through - (x[2] - 1.0 - 0.1 * u[1]) / p[3]) / 0.04


def make(off=0.0):
    signs = (1, -1, 1, -1)
    return ODESimulator(
        line,
        dt=DT,
        parameters={
            name: value * (1 + off * s) for (name, value), s in zip(TRUE.items(), signs, strict=True)
        },
        states=["flow [mL/s]", "syringe pressure [kPa]", "line pressure [kPa]"],
        inputs=["rate [mL/s]", "height [cm]"],
        outputs=["syringe pressure [kPa]", "line pressure [kPa]"],
        output=(1, 2),
        substeps=2,
    )


def kinked(a=0.4, begins=300.0, ends=480.0, *, along_record=False, parameter=3):
    placed = change_hypotheses(make())[parameter].placed
    return placed.acting(Span(begins, ends, along_record)).at((a,))


def commands(n=N, seed=0):
    rng = np.random.default_rng(seed)
    rate = np.repeat(rng.uniform(0.05, 0.4, n // 30), 30)
    return np.column_stack([rate, np.repeat(rng.uniform(-20, 20, n // 100), 100)])


def in_pieces(u, a, begins, ends):
    """Run with one set of parameters after the other."""
    plain = make()
    p = plain.nominal
    changed = plain.with_parameters([*p[:3], p[3] * (1 + a)])
    x = np.zeros(3)
    found = []
    for simulator, part in zip((plain, changed, plain), np.split(u, [begins, ends]), strict=True):
        inputs = np.concatenate([part, part[-1:]])  # one more, for the states at the end
        states = simulator.run(inputs, Windows.whole([slice(0, len(inputs))]), x[None]).x
        found.append(states[:-1])
        x = states[-1]
    return np.concatenate(found)[:, [1, 2]]


def test_it_runs_as_one_simulator_after_the_other():
    u = commands()
    y = make().with_effects([kinked()]).simulate(u, x0=np.zeros(3))
    np.testing.assert_allclose(y, in_pieces(u, 0.4, 300, 480), rtol=1e-12)


def test_what_runs_as_python_changes_as_well():
    def slow(x, u, p):
        return [float(f"{rate:.17g}") for rate in line(x, u, p)]

    python = ODESimulator(
        slow,
        dt=DT,
        parameters=TRUE,
        states=["flow", "one", "two"],
        inputs=["rate", "height"],
        output=(1, 2),
        outputs=["one", "two"],
        substeps=2,
    )
    u, effect = commands(300), kinked(begins=60.0, ends=140.0)
    with pytest.warns(match="runs as Python"):
        changed = python.with_effects([effect]).simulate(u, x0=np.zeros(3))
    expected = make().with_effects([effect]).simulate(u, x0=np.zeros(3))
    np.testing.assert_allclose(changed, expected, rtol=1e-12)


def test_its_time_counts_from_each_session_or_along_the_record():
    u, sessions = commands(), np.repeat(range(3), N // 3)
    plain, each, once = (
        make().with_effects(effects).simulate(u, sessions=sessions, x0=np.zeros(3))
        for effects in ([], [kinked(0.4, 100, 200)], [kinked(0.4, 400, 500, along_record=True)])
    )
    differs = [np.any(y != plain, axis=1).reshape(3, -1).any(axis=1).tolist() for y in (each, once)]
    assert differs == [[True] * 3, [False, True, False]]
    np.testing.assert_array_equal(each[300:600], once[300:600])


def test_other_parameters_beside_it_stay_as_they_are():
    """The vector that the equations read is written to while it runs, and is nobody else's."""
    simulator = make().with_effects([kinked(), kinked(-0.2, 200.0, 350.0, parameter=0)])
    before = simulator.nominal.copy()
    first, again = (simulator.simulate(commands()) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(simulator.nominal, before)


def test_a_fit_finds_by_how_much():
    u = commands()
    y = make().with_effects([kinked()]).simulate(u, x0=np.zeros(3))
    y += 0.01 * np.random.default_rng(1).normal(size=y.shape)
    windows = cut([(slice(0, N), 0)], 300, 8)
    problem = Problem(make(0.1), u, y, windows, Noise.white(np.array([0.01, 0.01])))
    x0 = np.zeros((windows.count, 3))
    found = fit(problem, Model(problem.simulator.nominal, (kinked(0.0),), x0), iterations=40)
    assert found.model.effects[0].theta[0] == pytest.approx(0.4, abs=0.01)
    np.testing.assert_allclose(found.model.p, list(TRUE.values()), rtol=0.01)


@pytest.mark.long
def test_a_catheter_that_is_kinked_for_a_while_is_told_as_such():
    u, sessions = np.concatenate([commands(), commands(seed=1)]), np.repeat([0, 1], N)
    kink = kinked(0.4, 400.0, 560.0, along_record=True)
    y = make().with_effects([kink]).simulate(u, sessions=sessions)
    y += 0.01 * y.std(axis=0) * np.random.default_rng(2).normal(size=y.shape)
    dx = DiscrepancyRegressor(make(0.08), random_state=0).fit(u, y, sessions=sessions)
    (finding,) = dx.findings_
    assert (dx.verdict_, finding.title) == ("unknown", "a parameter that changed")
    assert finding.port == "state:2"  # where the parameter stands
    assert finding.place == "in the parameter catheter"
    assert finding.parameters["a"] == pytest.approx(0.4, abs=0.02)
    np.testing.assert_allclose(finding.during, (400.0, 560.0), atol=6.0)
    np.testing.assert_allclose(dx.parameters_["augmented"], list(TRUE.values()), rtol=0.02)
    assert "A parameter of the simulation is not always the same" in dx.report_


def test_a_simulator_without_equations_has_none_that_change():
    simulator = CallableSimulator(
        lambda u, p: p["gain"] * u, dt=DT, parameters={"gain": 1.0}, inputs=["u"], outputs=["y"]
    )
    assert change_hypotheses(simulator) == []

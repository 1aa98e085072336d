"""Curves of a signal of which an output is made: what a current takes off a voltage, what a charge adds."""

from dataclasses import replace

import numpy as np
import pytest

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.discrepancy.fitting.acting import signal_change
from narx_sklearn.discrepancy.locate import tangent
from narx_sklearn.discrepancy.search.unnamed.broken_line import KNOTS
from narx_sklearn.discrepancy.search.unnamed.curves import curve_hypotheses
from narx_sklearn.discrepancy.search.unnamed.kinds import CURVE
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut
from narx_sklearn.discrepancy.stages.forms import along

DT = 1.0
N = 1200
FULL = [0.9, 0.0]


def cell(x, u, p):
    return -u[0] / 2000.0, (u[0] - x[1]) / p[2]


def measured(x, u, p):
    return 3.4 + p[0] * x[0] - p[1] * (u[0] + x[1]), x[0]


def make(factor=1.0, output=measured, outputs=("voltage [V]", "counted charge")):
    """A cell of a battery; the voltage sinks with the current, at once and late, and with the charge."""
    return ODESimulator(
        cell,
        dt=DT,
        parameters={"slope [V]": 0.8 * factor, "resistance [ohm]": 0.02 / factor, "lag [s]": 30.0},
        states=["charge", "late current [A]"],
        inputs=["current [A]"],
        output=output,
        outputs=list(outputs),
    )


def current(n=N, seed=0):
    """Of a battery that drives and is charged in turn."""
    slow = 8.0 * np.sin(2 * np.pi * np.arange(n) / 200.0)
    return slow[:, None] + np.repeat(np.random.default_rng(seed).uniform(-4.0, 4.0, n // 20), 20)[:, None]


def recorded(u, of_charge=0.0, of_current=0.0, seed=1):
    def bent(x, u, p):
        plain = 3.4 + 0.8 * x[0] - 0.02 * (u[0] + x[1])
        return plain - of_charge * np.exp((0.6 - x[0]) / 0.1) - of_current * np.exp(u[0] / 3.0), x[0]

    y = make(output=bent).simulate(u, x0=FULL)
    return y + [0.002, 0.001] * np.random.default_rng(seed).normal(size=y.shape)


def curves(simulator, u):
    run = simulator.run(u, cut([(slice(0, len(u)), 0)], len(u), 1), np.array([FULL]))
    structure = find_structure(simulator, run.x, u)
    return structure, [
        h.placed
        for h in curve_hypotheses(simulator, structure, u, run.x, run.y)
        if h.placed.port.kind == "output"
    ]


def test_what_an_output_is_made_of_is_found_at_points_of_a_run():
    structure, found = curves(make(), current(200))
    assert structure.read.tolist() == [[True, True, True], [False, True, False]]
    assert [(c.argument_name, c.is_fed) for c in found] == [
        ("voltage", False),
        ("current", True),
        ("charge", True),
        ("late current", True),
        ("counted charge", False),
    ]
    assert [c.second for c in found] == [(), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), ()]


def test_an_output_of_one_signal_has_one_curve():
    structure, found = curves(
        make(output=lambda x, u, p: (2.0 * x[0],), outputs=["voltage [V]"]), current(200)
    )
    assert structure.read.tolist() == [[False, True, False]]
    assert [c.argument_name for c in found] == ["voltage"]


@pytest.fixture
def acting():
    """A broken line of the charge and one of the current, on one output."""
    u = current(200)
    _, found = curves(make(), u)
    knots = [curve.theta[KNOTS : 2 * KNOTS] for curve in found]
    lines = [[0.3, 0.1, 0.0, 0.2, 0.1, 0.0, -0.1], [0.0, 0.0, 0.1, 0.1, 0.2, 0.3, 0.5]]
    effects = [found[k].at((*line, *knots[k])) for k, line in zip((2, 1), lines, strict=True)]
    drawn = [(knots[k], line) for k, line in zip((2, 1), lines, strict=True)]
    return make(), u, effects, drawn


def test_curves_are_added_to_the_output_as_they_are_drawn(acting):
    simulator, u, effects, ((of_charge, low), (of_current, high)) = acting
    windows, x0 = cut([(slice(0, 200), 0)], 200, 1), np.array([FULL])
    plain = simulator.run(u, windows, x0)
    run = simulator.with_effects(effects).run(u, windows, x0)
    added = np.interp(plain.x[:, 0], of_charge, low), np.interp(u[:, 0], of_current, high)
    np.testing.assert_allclose(run.y[:, 0], plain.y[:, 0] + sum(added), atol=1e-12)
    np.testing.assert_array_equal(run.x, plain.x)
    argument, change = signal_change(effects[0], plain.y, u, plain.x, windows, np.arange(200), DT)
    np.testing.assert_array_equal(argument, plain.x[:, 0])
    np.testing.assert_allclose(change, added[0], atol=1e-12)


def test_tangents_of_the_output_have_the_slopes_of_its_curves(acting):
    simulator, u, effects, ((of_charge, low), (of_current, high)) = acting
    windows = cut([(slice(0, 200), 0)], 200, 1)
    run = simulator.with_effects(effects).run(u, windows, np.array([FULL]))
    linear = tangent(simulator.with_effects(effects), run, u, windows)
    at = np.flatnonzero([_is_inside(v, of_charge) for v in run.x[:, 0]])
    slope = np.diff(low) / np.diff(of_charge)
    expected = 0.8 + slope[np.searchsorted(of_charge, run.x[at, 0]) - 1]
    np.testing.assert_allclose(linear.C[at, 0, 0], expected, rtol=1e-4)
    at = np.flatnonzero([_is_inside(v, of_current) for v in u[:, 0]])
    slope = np.diff(high) / np.diff(of_current)
    expected = -0.02 + slope[np.searchsorted(of_current, u[at, 0]) - 1]
    np.testing.assert_allclose(linear.D[at, 0, 0], expected, rtol=1e-4)


def _is_inside(value, knots):
    """Tell whether no knot is near, at which there is no slope."""
    return knots[0] < value < knots[-1] and np.abs(knots - value).min() > 0.01 * (knots[1] - knots[0])


def test_a_curve_of_another_signal_is_no_form_of_one_of_the_output(acting):
    _, _, (of_charge, of_current), _ = acting
    own = replace(of_charge, second=())
    assert along(of_charge, of_charge)
    assert not along(of_charge, of_current)
    assert not along(of_charge, own)
    assert along(own, replace(own, argument_name="the same"))


@pytest.mark.long
@pytest.mark.parametrize(
    ("of_charge", "of_current", "argument"),
    [
        (0.1, 0.0, "charge"),
        (0.0, 0.005, "current [A]"),
    ],
)
def test_a_diagnosis_tells_the_curve_and_keeps_the_parameters_right(of_charge, of_current, argument):
    """No name takes off what the test finds, and noise that drifts would be as likely as any of them."""
    u = current(seed=2)
    y = recorded(u, of_charge, of_current)
    effects = ["sensor_clip", "input_polynomial", "dead_zone"]
    dx = DiscrepancyRegressor(make(1.15), effects=effects, random_state=0).fit(u, y)
    assert dx.verdict_ == "unknown"
    (finding,) = dx.findings_
    assert (finding.effect, finding.port) == ("unknown", "output:0")
    assert dx.simulator_.effects[0].effect.code == CURVE
    assert finding.argument == f"w = {argument}"
    assert dx.scores_.loc["augmented", "nrmse"] < 0.5 * dx.scores_.loc["refitted", "nrmse"]
    other = current(seed=3)
    y = recorded(other, of_charge, of_current)
    refitted, told = (s.simulate(other, x0=FULL) for s in (dx.refitted_simulator_, dx.simulator_))
    assert np.std((told - y)[:, 0]) < 0.4 * np.std((refitted - y)[:, 0])

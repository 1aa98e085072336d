"""How sure parameters are where several explanations are left."""

import numpy as np
import pytest
from small_machines import axis_problem, friction, tank

from narx_sklearn.discrepancy import ODESimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.search.inference import intervals, spanning, told_together
from narx_sklearn.discrepancy.search.unnamed.broken_line import KNOTS, with_knots
from narx_sklearn.discrepancy.search.unnamed.curves import curve_hypotheses
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.discrepancy.simulators.windows import cut


class TestSpanning:
    @pytest.fixture
    def two(self):
        """Return a problem, and two explanations of it that differ in the gain by three."""
        problem, start = axis_problem([friction(0.4)])
        found = fit(problem, start._replace(effects=(friction(0.4),)))
        other = found._replace(model=found.model._replace(p=np.add(found.model.p, (3.0, 0.0))))
        return problem, found, other

    def test_intervals_reach_over_what_each_explanation_says_of_the_simulators_own(self, two):
        problem, found, other = two
        sure, others = (intervals(problem, one) for one in (found, other))
        spanned = spanning(sure, problem, found, [other])
        np.testing.assert_allclose(spanned[0], [sure[0, 0], others[0, 1]])
        assert spanned[0, 1] - spanned[0, 0] > 3.0
        np.testing.assert_allclose(spanned[1], [min(sure[1, 0], others[1, 0]), max(sure[1, 1], others[1, 1])])
        np.testing.assert_array_equal(spanned[2:], sure[2:])  # those of an effect are of it alone

    def test_an_explanation_says_nothing_of_what_it_does_not_tell_alone(self, two):
        problem, found, other = two
        alike = other.jacobian.copy()
        alike[:, :, 2] = alike[:, :, 0]  # what the effect does, the gain does too
        lost = other._replace(jacobian=alike)
        sure = intervals(problem, found)
        np.testing.assert_array_equal(spanning(sure, problem, found, [lost])[0], sure[0])
        as_lost = found._replace(jacobian=alike)  # unless the first does not tell it either
        spanned = spanning(intervals(problem, as_lost), problem, as_lost, [lost])
        assert spanned[0, 1] == intervals(problem, lost)[0, 1]

    def test_nothing_else_leaves_intervals_as_they_are(self, two):
        problem, found, _ = two
        sure = intervals(problem, found)
        np.testing.assert_array_equal(spanning(sure, problem, found, []), sure)


def test_a_rate_of_flow_is_told_only_together_with_a_line_of_the_level_that_may_have_any_slope():
    """Though the line is nothing, and none of its values is heard by itself."""
    about = {"dt": 0.1, "states": ["level [m]"], "inputs": ["pump [V]"]}
    simulator = ODESimulator(tank, parameters={"gain [m/s/V]": 1.0, "outflow [1/s]": 0.5}, **about)
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(0.5, 2.0, 40), 25)[:, None]
    y = simulator.simulate(u) + 0.01 * rng.normal(size=(1000, 1))
    windows = cut([(slice(0, 1000), 0)], 200, 12)
    problem = Problem(simulator, u, y, windows, Noise.white(np.array([0.01])))
    base = fit(problem, Model(simulator.nominal, (), y[windows.first]))
    assert told_together(base) == []
    run = problem.run(base.model)
    curves = curve_hypotheses(simulator, find_structure(simulator, run.x, u), u, run.x, run.y)
    (line,) = [c.placed for c in curves if c.placed.port.kind == "state"]
    ends = np.linspace(run.x.min() - 0.5, run.x.max() + 0.5, KNOTS)  # nowhere is it constant
    found = fit(problem, base.model._replace(effects=(with_knots(line, ends),)))
    (together,) = told_together(found)
    assert together[0] == 1  # the outflow, and not the gain
    assert set(together) & set(range(2, 2 + KNOTS))

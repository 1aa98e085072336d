"""How sure parameters are where several explanations are left."""

import numpy as np
import pytest
from small_machines import axis_problem, friction

from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.search.inference import intervals, spanning


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
        spanned = spanning(problem, sure, [other], 0.9)
        np.testing.assert_allclose(spanned[0], [sure[0, 0], others[0, 1]])
        assert spanned[0, 1] - spanned[0, 0] > 3.0
        np.testing.assert_allclose(spanned[1], [min(sure[1, 0], others[1, 0]), max(sure[1, 1], others[1, 1])])
        np.testing.assert_array_equal(spanned[2:], sure[2:])  # those of an effect are of it alone

    def test_an_explanation_says_nothing_of_what_it_does_not_tell_alone(self, two):
        problem, found, other = two
        alike = other.jacobian.copy()
        alike[:, :, 2] = alike[:, :, 0]  # what the effect does, the gain does too
        spanned = spanning(problem, intervals(problem, found), [other._replace(jacobian=alike)], 0.9)
        np.testing.assert_array_equal(spanned[0], intervals(problem, found)[0])

    def test_nothing_else_leaves_intervals_as_they_are(self, two):
        problem, found, _ = two
        sure = intervals(problem, found)
        np.testing.assert_array_equal(spanning(problem, sure, [], 0.9), sure)

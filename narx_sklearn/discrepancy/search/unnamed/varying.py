"""A parameter of the simulator that depends on a signal, wherever it stands in the equations and outputs.

That a parameter does is no name: why it does is another question. So it is a law without a name.
"""

from dataclasses import replace

import numpy as np

from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.unnamed.broken_line import (
    KNOTS,
    broken_line,
    ends_of,
    knots_as_parameters,
)
from narx_sklearn.discrepancy.search.unnamed.kinds import CHANGED, VARYING, WORDS
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.physics.effects import PARAMETER, Effect, EffectParameter, Setting, no_start
from narx_sklearn.physics.effects._kernel import kernel
from narx_sklearn.physics.effects._starts import ORDINARY, grid, spread


@kernel
def _in_proportion(second, theta):
    return 1.0 + theta[0] * (second - theta[1])


@kernel
def _along_a_parabola(second, theta):
    ahead = second - theta[1]
    return 1.0 + ahead * (theta[0] + theta[2] * ahead)


@kernel
def _along_a_line(second, theta):
    return broken_line(second, theta)


@kernel
def _changed(second, theta):
    return 1.0 + theta[0]


def _mean(setting: Setting) -> float:
    return float(np.nanmean(setting.argument))


def _starts(setting: Setting) -> np.ndarray:
    """A parameter that changes by a tenth where the signal is a standard deviation off its mean."""
    size = spread(setting.argument)
    return grid([ORDINARY / size], [_mean(setting)]) if size > 0 else np.empty((0, 2))


def _limits(setting: Setting) -> np.ndarray:
    """Count the signal from its mean: from elsewhere, the parameter itself would be another."""
    return np.array([[-np.inf, np.inf], [_mean(setting)] * 2])


PARAMETER_THAT_VARIES = Effect(
    code=VARYING,
    title=WORDS[VARYING].title,
    sentence=WORDS[VARYING].sentence,
    equation="p (1 + a (w - r)) in place of p, with r the mean of w",
    parameters=(EffectParameter("a", "1/({second})"), EffectParameter("r", "{second}")),
    starts=_starts,
    limits=_limits,
    factor=_in_proportion,
    separate_by="that signal alone at several levels, with all else repeated",
    source="Rugh and Shamma 2000, Automatica 36(10), sec. 2 (parameters that depend on a signal)",
)

BENDING = replace(
    PARAMETER_THAT_VARIES,
    equation="p (1 + a (w - r) + b (w - r)^2) in place of p, with r the mean of w",
    parameters=(*PARAMETER_THAT_VARIES.parameters, EffectParameter("b", "1/({second})^2")),
    factor=_along_a_parabola,
)


BROKEN = replace(
    PARAMETER_THAT_VARIES,
    equation="p f(w) in place of p, f a broken line, 1 near the mean of w",
    factor=_along_a_line,
)

CHANGED_PARAMETER = replace(
    PARAMETER_THAT_VARIES,
    code=CHANGED,
    title=WORDS[CHANGED].title,
    sentence=WORDS[CHANGED].sentence,
    equation="p (1 + a) in place of p",
    parameters=(EffectParameter("a", "-", -1.0),),
    starts=no_start,
    limits=None,
    factor=_changed,
)


def change_hypotheses(simulator: Simulator) -> list[Hypothesis]:
    """Return that a parameter is another one, for each that a simulator reads; it is to act for a while."""
    if not simulator.reads_parameters:
        return []
    no_signal = (0.0,) * (len(simulator.inputs) + len(simulator.states))
    placed = (
        PlacedEffect(CHANGED_PARAMETER, Port(PARAMETER, j), second=no_signal, theta=(0.0,))
        for j in np.flatnonzero(simulator.nominal != 0).tolist()
    )
    return [Hypothesis.untuned(changed, np.array([[ORDINARY]])) for changed in placed]


def bending(placed: PlacedEffect) -> PlacedEffect:
    """Return a parameter that changes in proportion to a signal as one that does so along a parabola."""
    limits = (*placed.limits, (-np.inf, np.inf))
    return replace(placed, effect=BENDING, limits=limits).at((*placed.theta, 0.0))


def broken(placed: PlacedEffect, values: np.ndarray) -> PlacedEffect:
    """Return a parameter that depends on a signal as one that does so along a broken line.

    Parameters
    ----------
    values : ndarray
        Of the signal, along a record.
    """
    knots = np.linspace(*ends_of(values), KNOTS)
    heights = np.array([placed.effect.factor(at, np.array(placed.theta)) for at in knots])
    middle = int(np.argmin(np.abs(knots - np.mean(values))))
    names = tuple(EffectParameter(f"f{i}", "-", 0.0) for i in range(1, KNOTS + 1))
    effect = replace(BROKEN, parameters=names + knots_as_parameters(knots))
    limits = [(0.0, np.inf)] * KNOTS + [(at, at) for at in knots.tolist()]
    limits[middle] = 1.0, 1.0  # what is more, the parameter itself is
    theta = np.concatenate([np.maximum(heights / heights[middle], 0.0), knots])
    return replace(placed, effect=effect, limits=tuple(limits)).at(theta)


def line_of(placed: PlacedEffect) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the knots of a parameter that depends on a signal along a broken line, and how high it is there.

    None where it does not.
    """
    theta = np.array(placed.theta)
    return (theta[KNOTS:], theta[:KNOTS]) if placed.effect.factor is _along_a_line else None

"""A force near one place of a signal (a detent, a magnet, a rough spot), and one that steps at one place.

Such a step is that of a spring that is preloaded either way, as those that bring a throttle, a spool or a
lever back to where it rests, or of one that engages from some place on.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.places import Argument, arguments, moving, placed_at
from narx_sklearn.discrepancy.search.unnamed.broken_line import ends_of
from narx_sklearn.discrepancy.search.unnamed.kinds import ONE_PLACE, STEP, unnamed_law
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.physics.effects import Effect, EffectParameter

PLACES = 9  # evenly over what a run visits, at which one is looked for
WIDTHS = (0.03, 0.12)  # half-widths tried, as shares of that
NARROW, WIDE = 0.01, 0.25  # half-widths allowed: what is felt over more than half of it is a curve as any


@njit(nogil=True, cache=True)
def _near(argument, rate, own, second, time, step, z, theta, dz):
    """Return what is half as strong a half-width w off its place c."""
    return theta[0] / (1.0 + ((argument - theta[1]) / theta[2]) ** 2)


@njit(nogil=True, cache=True)
def _from_there_on(argument, rate, own, second, time, step, z, theta, dz):
    """Return a step at a place c, three quarters of it within w either way, and a share of it before."""
    return theta[0] * (theta[3] + 0.5 * (1.0 + np.tanh((argument - theta[1]) / theta[2])))


_WHERE = EffectParameter("c", "{arg}"), EffectParameter("w", "{arg}")
_NEAR_ONE_PLACE = unnamed_law(ONE_PLACE, "a / (1 + ((x - c)/w)^2)", ["a"], _WHERE, _near, amplitude=0)
_STEP = replace(
    unnamed_law(
        STEP,
        "a (s + (1 + tanh((x - c)/w)) / 2)",
        ["a"],
        (*_WHERE, EffectParameter("s", "-")),
        _from_there_on,
        amplitude=0,
    ),
    spare=(3,),
)


def place_hypotheses(simulator: Simulator, structure: Structure, x: np.ndarray) -> list[Hypothesis]:
    """Return a force near one place for each state equation and signal that moves in a run.

    Parameters
    ----------
    x : ndarray of shape (n_samples, n_states)
        States of that run.
    """
    found = []
    for i in np.flatnonzero(~structure.kinematic).tolist():
        found += _at_places(_NEAR_ONE_PLACE, i, moving(i, simulator, structure), x)
    return found


def step_hypotheses(simulator: Simulator, structure: Structure, x: np.ndarray) -> list[Hypothesis]:
    """Return a force that steps at one place for each body, its positions and those between it and others.

    By a speed it would be a friction that is not the same either way. Each place is a hypothesis of its own,
    to be fitted: along a run without the step tangents hardly tell where it is.

    Parameters
    ----------
    x : ndarray of shape (n_samples, n_states)
        States of a run.
    """
    found = []
    for i in np.flatnonzero(~structure.kinematic).tolist():
        positions = [
            argument
            for argument in arguments("position", i, simulator, structure)
            if structure.partner[i] >= 0 or argument.is_twist
        ]
        for everywhere in _at_places(_STEP, i, positions, x):
            of_places = np.split(everywhere.starts, PLACES)
            found += [Hypothesis.untuned(everywhere.placed, starts) for starts in of_places]
    return found


def _at_places(law: Effect, i: int, signals: Iterable[Argument], x: np.ndarray) -> list[Hypothesis]:
    """Return a law with its place all over what each of some signals does, where that moves."""
    rest = [0.0] * (len(law.parameters) - 3)
    found = []
    for argument in signals:
        low, high = ends_of(x @ np.array(argument.weights))
        if not high > low:
            continue
        places = low + (high - low) * (np.arange(PLACES) + 0.5) / PLACES
        widths = (high - low) * np.array(WIDTHS)
        starts = np.array([[1.0, c, w, *rest] for c in places for w in widths])
        within = (low, high), (NARROW * (high - low), WIDE * (high - low))
        limits = ((-np.inf, np.inf), *within, *[(-np.inf, np.inf)] * len(rest))
        placed = replace(placed_at(law, Port("state", i), argument._replace(pushed_back=-1)), limits=limits)
        found.append(Hypothesis.untuned(placed, starts))
    return found

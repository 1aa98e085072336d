"""A force that acts near one place of a signal only: a detent, a magnet, a rough spot, a worn tooth."""

from dataclasses import replace

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.places import moving, placed_at
from narx_sklearn.discrepancy.search.unnamed.broken_line import ends_of
from narx_sklearn.discrepancy.search.unnamed.kinds import ONE_PLACE, unnamed_law
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.physics.effects import EffectParameter

PLACES = 9  # evenly over what a run visits, at which one is looked for
WIDTHS = (0.03, 0.12)  # half-widths tried, as shares of that
NARROW, WIDE = 0.01, 0.25  # half-widths allowed: what is felt over more than half of it is a curve as any


@njit(nogil=True, cache=True)
def _near(argument, rate, own, second, time, step, z, theta, dz):
    """Return what is half as strong a half-width w off its place c."""
    return theta[0] / (1.0 + ((argument - theta[1]) / theta[2]) ** 2)


def place_hypotheses(simulator: Simulator, structure: Structure, x: np.ndarray) -> list[Hypothesis]:
    """Return a force near one place for each state equation and signal that moves in a run.

    Parameters
    ----------
    x : ndarray of shape (n_samples, n_states)
        States of that run.
    """
    where = EffectParameter("c", "{arg}"), EffectParameter("w", "{arg}")
    law = unnamed_law(ONE_PLACE, "a / (1 + ((x - c)/w)^2)", ["a"], where, _near, amplitude=0)
    found = []
    for i in np.flatnonzero(~structure.kinematic).tolist():
        for argument in moving(i, simulator, structure):
            low, high = ends_of(x @ np.array(argument.weights))
            if not high > low:
                continue
            places = low + (high - low) * (np.arange(PLACES) + 0.5) / PLACES
            widths = (high - low) * np.array(WIDTHS)
            starts = np.array([[1.0, c, w] for c in places for w in widths])
            limits = (-np.inf, np.inf), (low, high), (NARROW * (high - low), WIDE * (high - low))
            placed = replace(
                placed_at(law, Port("state", i), argument._replace(pushed_back=-1)), limits=limits
            )
            found.append(Hypothesis.untuned(placed, starts))
    return found

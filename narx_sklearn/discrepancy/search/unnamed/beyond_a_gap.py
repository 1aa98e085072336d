"""What damps a motion beyond a gap: another form of a law that acts there."""

from dataclasses import replace

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.unnamed.kinds import DAMPED, unnamed_law
from narx_sklearn.physics.effects import EffectParameter


@njit(nogil=True, cache=True)
def _damped_beyond(argument, rate, own, second, time, step, z, theta, dz):
    """Return what damps a motion beyond a gap."""
    return 0.0 if theta[1] < argument < theta[2] else -theta[0] * rate


def damped_beyond(placed: PlacedEffect) -> Hypothesis | None:
    """Return what damps a motion where an effect acts on it, if that is beyond a gap: a stop gives way.

    A spring alone gives all back (Hunt and Crossley 1975, Coefficient of Restitution Interpreted as Damping
    in Vibroimpact).
    """
    if placed.effect.acts_in is None or placed.port.kind != "state":
        return None
    spans = placed.effect.acts_in(placed.own_theta)
    if len(spans) != 2 or np.isfinite([spans[0][0], spans[1][1]]).any():
        return None
    gap = spans[0][1], spans[1][0]
    fixed = [EffectParameter(name, "{arg}", at, at) for name, at in zip(("from", "to"), gap, strict=True)]
    law = unnamed_law(DAMPED, "-d dx/dt beyond the gap", ["d"], fixed, _damped_beyond, "({port}) s/({arg})")
    begun = replace(placed, effect=law, limits=()).at((0.0, *gap, *placed.onward_theta))
    start = np.array(begun.theta)
    start[0] = 1.0
    return Hypothesis.untuned(begun, start[None])

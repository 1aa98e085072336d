"""A force that goes as a power of a signal, or falls off as one."""

from dataclasses import replace

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.places import beside_inputs, moving, placed_at
from narx_sklearn.discrepancy.search.unnamed.broken_line import ends_of
from narx_sklearn.discrepancy.search.unnamed.kinds import EVEN_POWER, INVERSE, ODD_POWER, unnamed_law
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.physics.effects import Effect, EffectParameter, Power

POWERS = (1.5, 12.0)  # exponents: with less it is hardly more than a line
ROOTS = (0.2, 2.0 / 3.0)  # the same below a line; with less it is hardly more than a dry friction
ROUNDED = 0.002  # of the size, near zero, within which a root has a slope that a step can follow
INVERSES = (0.5, 6.0)  # the same of what falls off
HALF = 0.5  # by which an exponent may be off and the law still be of a power's name
CUBE, SQUARE = Power(3.0, odd=True), Power(2.0, odd=False)  # with which a free power begins
ROOT = Power(0.5, odd=True)


@njit(nogil=True, cache=True)
def _odd_power(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * np.sign(argument) * np.abs(argument / theta[2]) ** theta[1]


@njit(nogil=True, cache=True)
def _even_power(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * np.abs(argument / theta[2]) ** theta[1]


@njit(nogil=True, cache=True)
def _odd_root(argument, rate, own, second, time, step, z, theta, dz):
    share = argument / theta[2]
    return theta[0] * share * (share * share + ROUNDED * ROUNDED) ** ((theta[1] - 1.0) / 2.0)


@njit(nogil=True, cache=True)
def _inverse_power(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * (theta[2] / max(np.abs(argument), theta[2])) ** theta[1]


def placed_powers(simulator: Simulator, structure: Structure, x: np.ndarray) -> list[PlacedEffect]:
    """Return a force that goes as a power, for each state equation and argument that moves, either way.

    Where the argument stays on one side of zero the force may fall off as a power too; roots of such a one
    are an outflow of the catalogue.
    """
    found = []
    for i in np.flatnonzero(~structure.kinematic).tolist():
        for argument in moving(i, simulator, structure):
            values = x @ np.array(argument.weights)
            far, (low, high) = np.abs(values).max(), ends_of(values)
            if not far > 0:
                continue
            laws = [(power_effect(power, far), power.exponent, far) for power in (CUBE, SQUARE)]
            if low * high > 0:
                near = min(abs(low), abs(high))
                laws.append((inverse_power(near), SQUARE.exponent, near))
            else:
                laws.append((root_effect(far), ROOT.exponent, far))
            for effect, exponent, size in laws:
                placed = placed_at(effect, Port("state", i), argument)
                placed = placed.at((0.0, exponent, size, *[placed.share] * placed.reacts))
                found += [placed, *beside_inputs(placed, simulator, structure)]
    return found


def inverse_power(nearest: float) -> Effect:
    """Return a force that falls off as a power, as strong as it says at the nearest to zero that was seen."""
    fixed = (EffectParameter("n", "-", *INVERSES), EffectParameter("nearest", "{arg}", nearest, nearest))
    return unnamed_law(INVERSE, "a (nearest / |x|)^n", ["a"], fixed, _inverse_power, amplitude=0)


def root_effect(size: float) -> Effect:
    """Return a force that goes as a root, as strong as it says where its argument has a size.

    Its slope at zero, which no step could follow, is that of a chord: next to zero it is a line.
    """
    fixed = (EffectParameter("n", "-", *ROOTS), EffectParameter("size", "{arg}", size, size))
    equation = "a sgn(x) |x / size|^n, rounded next to zero"
    return unnamed_law(ODD_POWER, equation, ["a"], fixed, _odd_root, amplitude=0)


def power_effect(power: Power, size: float) -> Effect:
    """Return a force that goes as a power, as strong as it says where its argument has a size."""
    code = ODD_POWER if power.odd else EVEN_POWER
    equation = "a sgn(x) |x / size|^n" if power.odd else "a |x / size|^n"
    fixed = (EffectParameter("n", "-", *POWERS), EffectParameter("size", "{arg}", size, size))
    force = _odd_power if power.odd else _even_power
    return unnamed_law(code, equation, ["a"], fixed, force, amplitude=0)


def with_free_power(placed: PlacedEffect, power: Power, size: float) -> PlacedEffect:
    """Return the law of an effect that goes as a power, with that power free, for an argument of a size."""
    return _instead(placed, power_effect(power, size), power.exponent, size)


def as_root(placed: PlacedEffect, size: float) -> PlacedEffect:
    """Return a root in the place of an effect, as strong for an argument of a size."""
    return _instead(placed, root_effect(size), ROOT.exponent, size)


def _instead(placed: PlacedEffect, law: Effect, exponent: float, size: float) -> PlacedEffect:
    effect, theta = placed.effect, np.array(placed.theta)
    strength = effect.force(size, 0.0, 0.0, 0.0, 0.0, 1.0, np.zeros(1), theta, np.zeros(1))
    freed = replace(placed, effect=law, limits=())
    return freed.at((strength, exponent, size, *placed.onward_theta))

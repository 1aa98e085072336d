"""A polynomial in position and rate, and one in which an input's gain depends on them."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.places import Argument, weights_of
from narx_sklearn.discrepancy.search.unnamed.kinds import DRIVEN, SURFACE, unnamed_law
from narx_sklearn.discrepancy.search.unnamed.linear import linear_hypothesis
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.physics.effects import EffectParameter

ENDS = ("x from", "{arg}"), ("x to", "{arg}"), ("v from", "{arg}/s"), ("v to", "{arg}/s")  # of what was seen
ANYWHERE = (-1e30, 1e30, -1e30, 1e30)  # while it is fitted
MONOMIALS = {"x2": "x^2", "xv": "x v", "v2": "v^2", "x3": "x^3", "x2v": "x^2 v", "xv2": "x v^2", "v3": "v^3"}
OF_INPUT = {"ux": "u x", "ux2": "u x^2", "uv": "u v", "uv2": "u v^2"}
TERMS = {SURFACE: MONOMIALS, DRIVEN: MONOMIALS | OF_INPUT}  # of a polynomial, by the names of coefficients


@njit(nogil=True, cache=True)
def _surface(argument, rate, own, second, time, step, z, theta, dz):
    """Return the polynomial of second and third degree in position and rate, in units of their sizes."""
    x, v = min(max(argument, theta[9]), theta[10]), min(max(rate, theta[11]), theta[12])
    return _polynomial(x / theta[7], v / theta[8], theta)


@njit(nogil=True, cache=True)
def _driven_surface(argument, rate, own, second, time, step, z, theta, dz):
    """Return the same, and an input's gain of second degree in position and rate."""
    x = min(max(argument, theta[14]), theta[15]) / theta[11]
    v, u = min(max(rate, theta[16]), theta[17]) / theta[12], second / theta[13]
    gain = theta[7] * x + theta[8] * x * x + theta[9] * v + theta[10] * v * v
    return _polynomial(x, v, theta) + gain * u


@njit(nogil=True, cache=True)
def _polynomial(x, v, theta):
    squares = theta[0] * x * x + theta[1] * x * v + theta[2] * v * v
    return squares + theta[3] * x**3 + theta[4] * x * x * v + theta[5] * x * v * v + theta[6] * v**3


def of_motion(port: Port, argument: Argument, position: np.ndarray, dt: float) -> Hypothesis | None:
    """Return a polynomial in a position and its rate; None of what stands still."""
    sizes = _sizes_of_motion(position, dt)
    if not min(sizes) > 0:
        return None
    equation = "f(x, v), of second and third degree"
    return linear_hypothesis(SURFACE, equation, MONOMIALS, _fixed(sizes), _surface, port, argument)


def driven(
    port: Port, argument: Argument, position: np.ndarray, simulator: Simulator, j: int, drive: np.ndarray
) -> Hypothesis | None:
    """Return one in which the gain of an input, ``j``, depends on them too; None of what stands still."""
    finite = np.abs(drive[np.isfinite(drive)])
    sizes = *_sizes_of_motion(position, simulator.dt), float(finite.max(initial=0.0))
    if not min(sizes) > 0:
        return None
    equation = "f(x, v) + u g(x, v), of second and third degree"
    found = linear_hypothesis(
        DRIVEN, equation, (*MONOMIALS, *OF_INPUT), _fixed(sizes), _driven_surface, port, argument
    )
    name, unit = simulator.inputs[j]
    weights = weights_of(len(simulator.inputs) + len(simulator.states), {j: 1.0})
    placed = replace(found.placed, second=weights, second_name=name, second_unit=unit)
    return found._replace(placed=placed)


def without_terms(placed: PlacedEffect, dropped: Collection[int]) -> PlacedEffect:
    """Return a polynomial with some of its terms dropped for good; its equation tells those left.

    Where none is left with the input, it is one of position and rate.
    """
    terms = TERMS[placed.effect.code]
    kept = {name: power for j, (name, power) in enumerate(terms.items()) if j not in dropped}
    if placed.effect.code == DRIVEN and not kept.keys() & OF_INPUT.keys():
        placed = _without_input(placed)
    signals = "x, v and u" if placed.effect.code == DRIVEN else "x and v"
    equation = " + ".join(f"{name} {power}" for name, power in kept.items())
    effect = replace(placed.effect, equation=f"{equation}, {signals} over their sizes")
    gone = [j for j in dropped if j < len(TERMS[placed.effect.code])]
    return replace(placed, effect=effect).with_zeros(gone)


def _without_input(placed: PlacedEffect) -> PlacedEffect:
    """Return a polynomial in position, rate and input without the input."""
    n, n_of_input = len(MONOMIALS), len(OF_INPUT)
    sizes = placed.theta[n + n_of_input :][:2]
    effect = unnamed_law(SURFACE, "", MONOMIALS, _fixed(sizes), _surface)
    rest = placed.onward_theta
    alone = replace(placed, effect=effect, second=(), second_name="", second_unit="", limits=())
    return alone.at((*placed.theta[:n], *sizes, *ANYWHERE, *rest))


def _sizes_of_motion(position: np.ndarray, dt: float) -> tuple[float, float]:
    speed = np.abs(np.diff(position[np.isfinite(position)])) / dt
    return float(np.ptp(position)) / 2, float(np.quantile(speed, 0.98)) if speed.size else 0.0


def _fixed(sizes: tuple[float, ...]) -> tuple[EffectParameter, ...]:
    kinds = ("size of x", "{arg}"), ("size of v", "{arg}/s"), ("size of u", "{second}")
    told = [*zip(kinds, sizes, strict=False), *zip(ENDS, ANYWHERE, strict=True)]
    return tuple(EffectParameter(name, unit, value, value) for (name, unit), value in told)


def held_beyond(placed: PlacedEffect, ends: Sequence[float]) -> PlacedEffect:
    """Return a polynomial that stays as it is at the ends of the positions and rates it was seen over.

    Its powers may throw a louder motion anywhere.

    Parameters
    ----------
    ends : list of float
        Least and largest position, and rate.
    """
    n, after = len(placed.effect.parameters) - len(ENDS), len(placed.effect.parameters)
    fixed = (EffectParameter(name, unit, end, end) for (name, unit), end in zip(ENDS, ends, strict=True))
    effect = replace(placed.effect, parameters=(*placed.effect.parameters[:n], *fixed))
    limits = placed.limits and (*placed.limits[:n], *((end, end) for end in ends), *placed.limits[after:])
    theta = (*placed.theta[:n], *ends, *placed.theta[after:])
    return replace(placed, effect=effect, limits=limits).at(theta)

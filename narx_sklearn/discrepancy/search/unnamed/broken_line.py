"""A broken line: the form of a law of which nothing is known but what it depends on."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numba import njit
from scipy.interpolate import CubicSpline

from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.physics.effects import EffectParameter

KNOTS = 7  # of a broken line
OFTEN = 0.005  # share of the values that may lie beyond either end
FINE = 200  # points between the ends, at which it is asked how far knots should be apart


@njit(nogil=True, cache=True)
def broken_line(value, theta):
    """Return the broken line through (theta_(n+i), theta_i) of n knots, constant beyond the ends."""
    if not value > theta[KNOTS]:
        return theta[0]
    for i in range(1, KNOTS):
        begins, ends = theta[KNOTS + i - 1], theta[KNOTS + i]
        if value < ends:
            return theta[i - 1] + (value - begins) / (ends - begins) * (theta[i] - theta[i - 1])
    return theta[KNOTS - 1]


@njit(nogil=True, cache=True)
def force_of_line(argument, rate, own, second, time, step, z, theta, dz):
    """Return a force that is a broken line of its argument."""
    return broken_line(argument, theta)


def line_added(signal, second, dt, theta, first):
    """Return a signal with a broken line of it, or of another, added."""
    knots = theta[KNOTS : 2 * KNOTS]
    return signal + np.interp(signal if second is None else second, knots, theta[:KNOTS])


def _smoothly_added(signal, second, dt, theta, first):
    """Return a signal with a smooth curve of it, or of another, added: constant beyond its ends."""
    knots = np.asarray(theta[KNOTS : 2 * KNOTS])
    curve = CubicSpline(knots, theta[:KNOTS], bc_type="natural")
    return signal + curve(np.clip(signal if second is None else second, knots[0], knots[-1]))


def smooth_line(placed: PlacedEffect) -> PlacedEffect:
    """Return a broken line at an input or output as the natural cubic spline through its knots.

    Between knots h apart it misses a smooth law by :math:`h^4`, a broken line by :math:`h^2`.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.placed import Port
    >>> from narx_sklearn.discrepancy.search.places import Argument
    >>> from narx_sklearn.discrepancy.search.unnamed.broken_line import smooth_line
    >>> from narx_sklearn.discrepancy.search.unnamed.curves import curve_at
    >>> line = curve_at(Port("output", 0), Argument((), "level", "m"), np.linspace(-3.0, 3.0, 601)).placed
    >>> knots = np.array(line.theta[7:])
    >>> line = line.at((*np.sin(knots), *knots))
    >>> at = np.linspace(-2.0, 2.0, 41)
    >>> missed = [np.abs(drawn.effect.transform(at, None, 0.1, line.theta, [0]) - at - np.sin(at)).max()
    ...           for drawn in (line, smooth_line(line))]
    >>> [round(float(value), 3) for value in missed]
    [0.12, 0.002]
    """
    equation = placed.effect.equation.replace("a broken line", "a smooth curve")
    return replace(placed, effect=replace(placed.effect, equation=equation, transform=_smoothly_added))


def heights_through(knots: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return how high a broken line must be at its knots to come nearest to some points (least squares).

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.search.unnamed.broken_line import heights_through
    >>> x = np.linspace(0.0, 2.0, 9)
    >>> heights_through(np.array([0.0, 1.0, 2.0]), x, np.abs(x - 1.0) + 1.0).round(6).tolist()
    [2.0, 1.0, 2.0]
    """
    columns = np.column_stack([np.interp(x, knots, one) for one in np.eye(knots.size)])
    return np.linalg.lstsq(columns, y, rcond=None)[0]


def knots_as_parameters(knots: Iterable[float]) -> tuple[EffectParameter, ...]:
    """Return where a line's knots are, as parameters that stay as they are."""
    return tuple(EffectParameter(f"x{i}", "{arg}", at, at) for i, at in enumerate(map(float, knots), start=1))


def with_knots(placed: PlacedEffect, knots: np.ndarray) -> PlacedEffect:
    """Return a broken line with other knots, on the line that it was."""
    own, rest = placed.effect.parameters, placed.theta[2 * KNOTS :]
    effect = replace(placed.effect, parameters=(*own[:KNOTS], *knots_as_parameters(knots)))
    line = np.interp(knots, placed.theta[KNOTS : 2 * KNOTS], placed.theta[:KNOTS])
    limits: tuple[tuple[float, float], ...] = ()
    if placed.limits:
        limits = (*placed.limits[:KNOTS], *((at, at) for at in knots.tolist()), *placed.limits[2 * KNOTS :])
    return replace(placed, effect=effect, limits=limits).at((*line, *knots, *rest))


def ends_of(values: np.ndarray) -> tuple[float, float]:
    """Return between which values a line is drawn: almost all that occur."""
    low, high = np.quantile(values, [OFTEN, 1.0 - OFTEN])
    return float(low), float(high)


def knots_where_it_bends(knots: np.ndarray, line: np.ndarray, values: np.ndarray) -> np.ndarray:
    r"""Return as many knots for the law that a broken line shows, over the values that occur.

    A line between knots h apart misses a law f by :math:`h^2 f''`, and by the same mean square, weighted by
    how often w a value occurs, where knots are as dense as :math:`(w f''^2)^{1/5}` (de Boor 1973, Good
    approximation by splines with variable knots). Half of that, and half evenly, for a law may bend where the
    line did not show it.

    Parameters
    ----------
    knots, line : ndarray of shape (n_knots,)
        Where the line's knots are, and how high.
    values : ndarray
        Of the argument, along a record.

    Examples
    --------
    A line that bends at its second knot only.

    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.search.unnamed.broken_line import knots_where_it_bends
    >>> knots, line = np.linspace(0.0, 6.0, 7), np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    >>> knots_where_it_bends(knots, line, np.linspace(0.0, 6.0, 601)).round(1).tolist()
    [0.0, 0.5, 0.9, 1.4, 2.0, 4.0, 6.0]
    """
    slopes = np.diff(line) / np.diff(knots)
    bend = np.abs(np.diff(slopes)) / (0.5 * (knots[2:] - knots[:-2]))
    often = np.histogram(values, bins=knots)[0] / np.diff(knots)
    low, high = ends_of(values)
    at = np.linspace(low, high, FINE + 1)
    middles = 0.5 * (at[1:] + at[:-1])
    weight = often[np.clip(np.searchsorted(knots, middles) - 1, 0, often.size - 1)]
    dense = (weight * np.interp(middles, knots[1:-1], bend) ** 2) ** 0.2
    if not dense.sum() > 0:
        return np.linspace(low, high, knots.size)
    share = np.concatenate([[0.0], np.cumsum(0.5 * dense / dense.sum() + 0.5 / FINE)])
    found = np.interp(np.linspace(0.0, 1.0, knots.size), share, at)
    found[[0, -1]] = low, high
    return found

"""Tables and polynomials of scipy and numpy as functions that the compiler takes.

What stands in the place of a table is compared with it at points within and beyond its range; where they
differ the table is left as it is.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numba import njit
from numpy.polynomial import Chebyshev, Hermite, HermiteE, Laguerre, Legendre, Polynomial
from scipy.interpolate import BSpline, PPoly, RegularGridInterpolator, UnivariateSpline, interp1d

INSIDE = 7  # points of each interval at which a table and what stands in its place are compared
BEYOND = (0.01, 1.0, 7.3)  # spans past its ends, likewise
SERIES = np.poly1d | Chebyshev | Hermite | HermiteE | Laguerre | Legendre | Polynomial
ALIKE = 1e-9  # of the largest value, by which they may differ


def compiled_table(value: Any) -> Callable | None:
    """Return a function of numbers, compiled, in the place of a table or polynomial; None of all else.

    Tables are the interpolating curves of ``scipy.interpolate`` with numbers as values (piecewise
    polynomials, splines, ``interp1d``) and ``RegularGridInterpolator`` with ``method="linear"``, which takes
    a tuple of numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from scipy.interpolate import CubicSpline
    >>> from narx_sklearn.discrepancy.simulators.tables import compiled_table
    >>> levels = np.linspace(0.0, 2.0, 5)
    >>> spline = CubicSpline(levels, levels**3)
    >>> round(compiled_table(spline)(1.7), 9)
    4.913
    """
    if isinstance(value, SERIES):
        return _polynomial(value)
    if isinstance(value, RegularGridInterpolator):
        return _grid(value)
    pieces = _pieces(value)
    return None if pieces is None else _curve(value, pieces)


def _polynomial(value) -> Callable:
    if isinstance(value, np.poly1d):
        coefficients = np.asarray(value.coeffs, dtype=float)
    else:
        coefficients = value.convert(kind=Polynomial).coef[::-1].astype(float)

    @njit(error_model="numpy", nogil=True)
    def polynomial(x):
        total = 0.0
        for coefficient in coefficients:
            total = total * x + coefficient
        return total

    return polynomial


def _pieces(value: Any) -> PPoly | None:
    """Return the polynomials of a curve, without what it does beyond its ends; None where it has none."""
    try:
        if isinstance(value, interp1d):
            if value._kind == "linear":  # type: ignore[attr-defined]
                slopes = np.diff(value.y) / np.diff(value.x)
                value = PPoly(np.vstack([slopes, value.y[:-1]]), value.x)
            else:
                value = value._spline  # type: ignore[attr-defined]
        elif isinstance(value, UnivariateSpline):
            value = BSpline(*value._eval_args)  # type: ignore[attr-defined]
        if isinstance(value, BSpline):
            if value.c.size != len(value.c):
                return None
            value = PPoly.from_spline((value.t, value.c.ravel(), value.k))
    except (AttributeError, ValueError, TypeError):
        return None  # of other kinds, or of several values
    if not isinstance(value, PPoly) or value.c.ndim != 2 or np.iscomplexobj(value.c):
        return None
    known = np.diff(value.x) > 0  # splines repeat their ends
    breaks = np.append(value.x[:-1][known], value.x[-1])
    return PPoly(value.c[:, known], breaks) if (np.diff(breaks) > 0).all() else None


def _curve(value, pieces: PPoly) -> Callable | None:
    breaks, coefficients = pieces.x.astype(float), np.ascontiguousarray(pieces.c, dtype=float)
    n, span = breaks.size - 1, breaks[-1] - breaks[0]
    edges = breaks[0] - span * BEYOND[0], breaks[-1] + span * BEYOND[0]
    ends = [_asked(value, edge) for edge in edges]
    extrapolated = [_alike(end, float(pieces(edge)), 1.0) for end, edge in zip(ends, edges, strict=True)]
    raises = [end is None for end in ends]
    below, above = (np.nan if end is None else end for end in ends)
    goes_on_below, goes_on_above = extrapolated
    raises_below, raises_above = raises

    @njit(error_model="numpy", nogil=True)
    def curve(x):
        if x < breaks[0] and not goes_on_below:
            if raises_below:
                raise ValueError("a value lies below the range of a table")
            return below
        if x > breaks[n] and not goes_on_above:
            if raises_above:
                raise ValueError("a value lies above the range of a table")
            return above
        i = min(max(np.searchsorted(breaks, x, side="right") - 1, 0), n - 1)
        along, total = x - breaks[i], 0.0
        for k in range(coefficients.shape[0]):
            total = total * along + coefficients[k, i]
        return total

    points = [a + (b - a) * t for a, b in pairwise(breaks) for t in np.linspace(0.0, 1.0, INSIDE)]
    points += [edge for share in BEYOND for edge in (breaks[0] - share * span, breaks[-1] + share * span)]
    return curve if _agree(value, curve, points) else None


def _grid(value: RegularGridInterpolator) -> Callable | None:
    if value.method != "linear" or value.values.ndim != len(value.grid) or np.iscomplexobj(value.values):
        return None
    n_axes = len(value.grid)
    sizes = np.array([axis.size for axis in value.grid])
    starts = np.concatenate([[0], np.cumsum(sizes)])
    nodes = np.concatenate([np.asarray(axis, dtype=float) for axis in value.grid])
    steps = np.concatenate([np.cumprod(sizes[::-1])[::-1][1:], [1]])
    values = np.ascontiguousarray(value.values, dtype=float).ravel()
    is_bounded, fill = bool(value.bounds_error), value.fill_value
    goes_on = fill is None
    beyond = np.nan if fill is None else float(fill)

    @njit(error_model="numpy", nogil=True)
    def grid(point):
        total, index, share = 0.0, np.zeros(n_axes, dtype=np.int64), np.zeros(n_axes)
        for axis in range(n_axes):
            own, x = nodes[starts[axis] : starts[axis + 1]], point[axis]
            if x < own[0] or x > own[-1]:
                if is_bounded:
                    raise ValueError("a value lies beyond the range of a table")
                if not goes_on:
                    return beyond
            i = min(max(np.searchsorted(own, x, side="right") - 1, 0), own.size - 2)
            index[axis], share[axis] = i, (x - own[i]) / (own[i + 1] - own[i])
        for corner in range(1 << n_axes):
            weight, place = 1.0, 0
            for axis in range(n_axes):
                upper = (corner >> axis) & 1
                weight *= share[axis] if upper else 1.0 - share[axis]
                place += (index[axis] + upper) * steps[axis]
            total += weight * values[place]
        return total

    rng = np.random.default_rng(0)
    low, high = np.array([[axis[0], axis[-1]] for axis in value.grid]).T
    reach = high - low
    points = [tuple(low + reach * rng.uniform(size=n_axes)) for _ in range(INSIDE * 9)]
    points += [tuple(low + reach * (1.6 * rng.uniform(size=n_axes) - 0.3)) for _ in range(INSIDE * 9)]
    return grid if _agree(value, grid, points) else None


def _agree(value, function: Callable, points: list) -> bool:
    wanted, found = [_asked(value, point) for point in points], [_asked(function, point) for point in points]
    scale = np.nanmax([abs(one) for one in wanted if one is not None], initial=0.0)
    return all(_alike(one, other, scale) for one, other in zip(wanted, found, strict=True))


def _asked(function: Callable, point) -> float | None:
    """Return what a function says at a point; None where it refuses."""
    try:
        return float(np.ravel(function(point))[0])
    except ValueError:
        return None


def _alike(one: float | None, other: float | None, scale: float) -> bool:
    if one is None or other is None:
        return one is other
    return bool(np.isclose(one, other, rtol=ALIKE, atol=ALIKE * scale, equal_nan=True))

"""Kernels: the root of a polynomial that lies nearest to zero on one side, and where it is smallest.

A compensation law asks for the root next to the last input, not for all of them. So the polynomial is written
in the move d = m[k] - m[k-1], and [start, end] is cut where its derivatives change sign, from the highest
down: between two cuts each of them is monotone and one safeguarded Newton iteration finds its only root. A
quadratic derivative is solved in closed form. Unlike Cardano's formula this loses nothing where the leading
coefficient nearly vanishes, finds double roots as the cuts they are, and holds for any degree.

Most moves are short, and the cuts are then not needed: interval arithmetic shows that the polynomial has no
root in the interval, or that it is monotone as far as the root at which Newton's iteration arrives.
"""

import numpy as np
from numba import njit

GRAZE = 64.0 * np.finfo(float).eps  # what rounding leaves of a double root, relative to the sum of the terms
TIGHT = 4.0 * np.finfo(float).eps
MAX_ITERATIONS = 200  # bisection alone ends a double's exponent range and digits within this
FEW_ITERATIONS = 12  # from the last input Newton's iteration arrives within these, or starts from too far
ALIKE = 1e-9  # relative: sizes and moves that differ by less tie, so that no rounding chooses between them
REAL = 1e-6  # relative imaginary part under which a root is real; a double root is known to sqrt(eps)
WIDEST = 1e15  # end of an interval without limit when not even the coefficients bound the roots


@njit(cache=True, nogil=True)
def evaluate(c, degree, x):
    """Return ``c[0] + c[1] x + ... + c[degree] x^degree`` by Horner's rule."""
    value = c[degree]
    for i in range(degree - 1, -1, -1):
        value = value * x + c[i]
    return value


@njit(cache=True, nogil=True)
def _is_negligible(c, degree, x, value):
    """Tell whether ``value`` is what rounding may leave of a zero of the polynomial at x."""
    size = abs(c[degree])
    for i in range(degree - 1, -1, -1):
        size = size * abs(x) + abs(c[i])
    return abs(value) <= GRAZE * size


@njit(cache=True, nogil=True)
def _newton(c, slopes, degree, a, b, value_a):
    """Return the root in [a, b], between whose ends the polynomial is monotone and changes sign."""
    x = a
    value = value_a
    for _ in range(MAX_ITERATIONS):
        slope = evaluate(slopes, degree - 1, x)
        nxt = x - value / slope if slope != 0.0 else np.inf
        if not a < nxt < b:
            nxt = 0.5 * (a + b)
        if abs(nxt - x) <= TIGHT * abs(nxt) or nxt in (a, b):
            return nxt
        x = nxt
        value = evaluate(c, degree, x)
        if value == 0.0:
            return x
        if (value > 0.0) == (value_a > 0.0):
            a = x
        else:
            b = x
    return x


@njit(cache=True, nogil=True)
def _quadratic(c, roots):
    """Write the real roots of ``c[0] + c[1] x + c[2] x^2`` in ascending order; return how many."""
    if c[2] == 0.0:
        if c[1] == 0.0:
            return 0
        roots[0] = -c[0] / c[1]
        return 1
    discriminant = c[1] * c[1] - 4.0 * c[2] * c[0]
    if discriminant < 0.0:
        if discriminant < -GRAZE * c[1] * c[1]:
            return 0
        discriminant = 0.0
    # the sum without cancellation; the other root follows from the product of both
    q = -0.5 * (c[1] + np.copysign(np.sqrt(discriminant), c[1]))
    first = q / c[2]
    second = c[0] / q if q != 0.0 else first
    roots[0] = min(first, second)
    roots[1] = max(first, second)
    return 2


@njit(cache=True, nogil=True)
def root_bound(c, degree):
    """Return a bound of the size of all roots (Fujiwara), at most ``WIDEST``."""
    while degree > 0 and c[degree] == 0.0:
        degree -= 1
    largest = 0.0
    for i in range(degree):
        if c[i] != 0.0:
            largest = max(largest, abs(c[i] / c[degree]) ** (1.0 / (degree - i)))
    return min(2.0 * largest * (1.0 + 1e-12), WIDEST)


@njit(cache=True, nogil=True)
def _next_cuts(chain, level, degree, cuts, n_cuts, found):
    """Write the start, the roots of derivative ``level`` between the cuts, and the end; return how many.

    ``chain[j]`` holds the coefficients of derivative j. ``cuts`` are start, sign changes of derivative
    ``level + 1``, end.
    """
    order = degree - level
    c = chain[level]
    found[0] = cuts[0]
    n = 1
    before = evaluate(c, order, cuts[0])
    for i in range(1, n_cuts):
        after = evaluate(c, order, cuts[i])
        is_cut = i < n_cuts - 1
        if before * after < 0.0 and not (is_cut and _is_negligible(c, order, cuts[i], after)):
            found[n] = _newton(c, chain[level + 1], order, cuts[i - 1], cuts[i], before)
            n += 1
        if is_cut and _is_negligible(c, order, cuts[i], after):
            found[n] = cuts[i]  # a double root, where the polynomial grazes zero
            n += 1
            after = 0.0
        before = after
    found[n] = cuts[n_cuts - 1]
    return n + 1


@njit(cache=True, nogil=True)
def critical_points(c, degree, start, end, chain, work):
    """Cut [start, end] where the polynomial turns.

    Parameters
    ----------
    c : ndarray of shape (degree + 1,)
        Coefficients, lowest power first.
    degree : int
        At least 1.
    start, end : float
        Ends, start < end.
    chain : ndarray of shape (degree + 1, degree + 1)
        Written: coefficients of all derivatives.
    work : ndarray of shape (2, degree + 3)
        Written; its first row holds the answer.

    Returns
    -------
    int
        Number of cuts: start, turning points in ascending order, end.
    """
    for i in range(degree + 1):  # a slice that is assigned compiles the wording of its error too, for seconds
        chain[0, i] = c[i]
    for level in range(1, degree):
        for i in range(degree - level + 1):
            chain[level, i] = (i + 1) * chain[level - 1, i + 1]
    work[0, 0] = start
    n = 1
    level = max(degree - 2, 1)
    if degree > 1:
        n_roots = 0
        if degree == 2:
            if chain[1, 1] != 0.0:
                work[1, 0] = -chain[1, 0] / chain[1, 1]
                n_roots = 1
        else:
            n_roots = _quadratic(chain[level], work[1])
        for i in range(n_roots):
            if work[0, n - 1] < work[1, i] < end:
                work[0, n] = work[1, i]
                n += 1
    work[0, n] = end
    n += 1
    while level > 1:
        level -= 1
        n = _next_cuts(chain, level, degree, work[0], n, work[1])
        for i in range(n):
            work[0, i] = work[1, i]
    return n


@njit(cache=True, nogil=True)
def _has_no_zero(c, degree, start, end):
    """Tell whether Horner's rule on the interval [start, end], start >= 0, keeps clear of zero.

    False says nothing: the interval is an outer bound of the polynomial's values.
    """
    low = high = c[degree]
    size = abs(c[degree])
    for i in range(degree - 1, -1, -1):
        low = c[i] + min(low * start, low * end)
        high = c[i] + max(high * start, high * end)
        size = size * end + abs(c[i])
    return low > GRAZE * size or high < -GRAZE * size


@njit(cache=True, nogil=True)
def near_root(c, degree, start, end, slopes):
    """Return the smallest root in (start, end] where a few Newton steps from ``start`` find and prove it.

    The root is the smallest because the derivative has no zero before it. NaN says nothing. Arguments as for
    `critical_points`, but ``start`` is at least 0, and ``slopes``, shape (degree + 1,), is written.
    """
    for i in range(degree):
        slopes[i] = (i + 1) * c[i + 1]
    x = start
    for _ in range(FEW_ITERATIONS):
        before = x
        slope = evaluate(slopes, degree - 1, x)
        if slope == 0.0:
            return np.nan
        x -= evaluate(c, degree, x) / slope
        if not start < x <= end:
            return np.nan
        if abs(x - before) <= TIGHT * x:
            return x if _has_no_zero(slopes, degree - 1, start, x) else np.nan
    return np.nan


@njit(cache=True, nogil=True)
def first_root(c, degree, start, end, chain, work):
    """Return the smallest root in (start, end], NaN if there is none; start itself does not count.

    Arguments as for `critical_points`, but ``start`` is at least 0 and ``end`` may be infinite; degree 0 has
    no root.
    """
    if degree == 0 or not start < end:
        return np.nan
    if degree == 1:
        root = -c[0] / c[1] if c[1] != 0.0 else np.nan
        return root if start < root <= end else np.nan
    if degree == 2:
        n_roots = _quadratic(c, work[1])
        for i in range(n_roots):
            if start < work[1, i] <= end:
                return work[1, i]
        return np.nan
    root = near_root(c, degree, start, end, chain[1])
    if root == root:
        return root
    end = root_bound(c, degree) if np.isinf(end) else end
    if not start < end or _has_no_zero(c, degree, start, end):
        return np.nan
    n = critical_points(c, degree, start, end, chain, work)
    before = evaluate(c, degree, work[0, 0])
    for i in range(1, n):
        after = evaluate(c, degree, work[0, i])
        if before * after < 0.0:
            return _newton(c, chain[1], degree, work[0, i - 1], work[0, i], before)
        if _is_negligible(c, degree, work[0, i], after):
            return work[0, i]
        before = after
    return np.nan


@njit(nogil=True, inline="always")
def is_better(size, move, least, shortest):
    """Tell whether a residual is less than the least one, or as small after a shorter move."""
    if size < least * (1.0 - ALIKE):
        return True
    return size <= least * (1.0 + ALIKE) and move < shortest * (1.0 - ALIKE)


@njit(cache=True, nogil=True)
def smallest_value(c, degree, start, end, chain, work):
    """Return the point of [start, end] at which the polynomial is nearest to zero, and its size there.

    Of points that tie it is the one nearest to the start. For a polynomial without a root in the interval;
    arguments as for `first_root`.
    """
    end = root_bound(c, degree) if np.isinf(end) else end
    best, least = start, abs(evaluate(c, degree, start))
    if degree == 0 or not start < end:
        return best, least
    n = critical_points(c, degree, start, end, chain, work)
    for i in range(1, n):
        size = abs(evaluate(c, degree, work[0, i]))
        if size < least * (1.0 - ALIKE):
            best, least = work[0, i], size
    return best, least


def held_root(c, low: float, high: float, near: float, side: float = 0.0) -> float:
    """Return the root of a polynomial in [low, high] nearest to a point, or what comes nearest to a root.

    Slow and of the whole line, where the kernels look from the last input outwards.

    Parameters
    ----------
    c : ndarray of shape (n,)
        Coefficients, lowest power first; of degree 1 at least.
    low, high : float
        Ends, maybe infinite.
    near : float
        The point, in [low, high]. Of two roots as near the upper one is taken.
    side : float, default=0.0
        Positive (negative): roots above (below) ``near`` come first, and the others only without one there.

    Returns
    -------
    float
        Where there is no root in [low, high]: the point of least size, the nearest one of those that tie.
    """
    slopes = np.polynomial.polynomial.polyder(c)
    roots = _polished(c, slopes, _real_roots(c))
    roots = roots[(roots >= low) & (roots <= high)]
    if roots.size:
        ahead = roots[(roots - near) * side > 0.0]
        return _nearest(ahead if ahead.size else roots, near)
    turns = _real_roots(slopes) if c.size > 2 else np.empty(0)
    points = np.array([x for x in (low, high, *turns) if np.isfinite(x) and low <= x <= high])
    if not points.size:  # no limits, and roots so multiple that rounding hides them
        return near
    sizes = np.abs(np.polynomial.polynomial.polyval(points, c))
    return _nearest(points[sizes <= sizes.min() * (1.0 + ALIKE)], near)


def _real_roots(c) -> np.ndarray:
    roots = np.polynomial.polynomial.polyroots(c)
    return roots[np.abs(roots.imag) <= REAL * np.abs(roots)].real


def _polished(c, slopes, roots: np.ndarray) -> np.ndarray:
    """Return the roots after a Newton step each, where that comes nearer to zero."""
    value, slope = (np.polynomial.polynomial.polyval(roots, p) for p in (c, slopes))
    stepped = roots - np.divide(value, slope, out=np.zeros_like(value), where=slope != 0.0)
    is_nearer = np.abs(np.polynomial.polynomial.polyval(stepped, c)) < np.abs(value)
    return np.where(is_nearer, stepped, roots)


def _nearest(points: np.ndarray, near: float) -> float:
    distances = np.abs(points - near)
    return float(points[distances <= distances.min() * (1.0 + ALIKE)].max()) + 0.0  # no -0.0

"""Term selection on a compressed record: forward ERR, floating search, iterated search.

All of them return the best set of terms they found for every number of terms; which number to take is
the criterion's business. On the factor R every inner product of the data is at hand, so that one step of
any search costs the same whatever the number of samples was.
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy.linalg import qr, solve_triangular

from narx_sklearn._validation import check_choice
from narx_sklearn.identification.one_step.criteria import information_criterion
from narx_sklearn.identification.one_step.factor import Factor
from narx_sklearn.identification.structure.constraints import LinearConstraints

__all__ = ["SEARCHES", "SelectionPath", "criterion_minima", "err_order", "search_terms", "size_window"]

# A regressor whose part orthogonal to the chosen ones is smaller than this is collinear to rounding.
COLLINEARITY = 1e-11
# Relative gain below which two sets count as equally good: well above rounding, far below any criterion.
IMPROVEMENT = 1e-9
# Share of y'y at which a residual is rounding and cannot be reduced any more.
EXACT = 1e-24
# Sine of the angle between two directions, below which their difference is made of the columns themselves.
NEARLY_PARALLEL = 1e-4
# Sizes on either side of the criterion's minimum at which pairs of terms are exchanged.
EXCHANGE_REACH = 2


@dataclass(frozen=True)
class SelectionPath:
    """The best set of terms found for each number of terms.

    Attributes
    ----------
    supports : tuple of tuple of int
        ``supports[n]`` are the indices of the best ``n`` terms, in the order in which they were found; see
        `err_order` for that of their ERR.
    rss : ndarray of shape (n_sizes,)
        Sum of squared one-step residuals of each; infinite for a size that constraints rule out.
    total : float
        Sum of squared outputs, y'y.
    n_samples : int
        Number of samples.
    n_candidates : int
        Number of terms they were chosen from.
    collinear : tuple of int
        Terms left out because they are collinear, to rounding, with terms chosen before them.
    n_considered : int or None
        Number of terms before screening, the price of choosing among which a criterion asks; None where
        there was no screening.
    """

    supports: tuple[tuple[int, ...], ...]
    rss: np.ndarray
    total: float
    n_samples: int
    n_candidates: int
    collinear: tuple[int, ...] = ()
    n_considered: int | None = None

    @property
    def sizes(self) -> np.ndarray:
        """Numbers of terms, 0 to the longest."""
        return np.arange(len(self.supports))

    def criterion(self, name: str) -> np.ndarray:
        """Return an information criterion for every size; residuals that are rounding count as equal."""
        rss = np.maximum(self.rss, EXACT * self.total)
        considered = self.n_considered or self.n_candidates
        return information_criterion(name, rss, self.n_samples, self.sizes, considered)

    @property
    def longest_comparable(self) -> int:
        """Largest size that a criterion may choose: it leaves a sample for the residual of each term.

        Criteria price a term by what chance gives it in a long record. Of N samples of which k terms are
        fitted it gives N / (N - k) times that, without bound towards k = N, where anything fits.
        """
        return min(len(self.supports) - 1, self.n_samples // 2)

    def up_to(self, n_terms: int) -> "SelectionPath":
        """Return the path without sets of more terms."""
        return replace(self, supports=self.supports[: n_terms + 1], rss=self.rss[: n_terms + 1])

    def best_size(self, name: str) -> int:
        """Return the comparable size at the criterion's global minimum (not where it first rises)."""
        values = self.criterion(name)
        comparable = values[: self.longest_comparable + 1]
        if not np.isfinite(comparable).any():  # constraints ask for more terms
            comparable = values
        return int(np.argmin(comparable))


class _Projection:
    """Columns of R split into their parts within and orthogonal to the span of chosen columns."""

    def __init__(self, factor: Factor, output: int):
        norms = np.linalg.norm(factor.Psi, axis=0)
        self.usable = norms > 0
        # unit columns: what is chosen must not depend on the units of the terms
        self.P = factor.Psi / np.where(self.usable, norms, 1.0)
        self.y = factor.target(output)
        self.n_samples = factor.n_samples
        self._last: tuple = (None, None)  # what was split last, and its parts: searches ask twice in a row

    def gains(self, support: list[int]) -> tuple[float, np.ndarray]:
        """Return the residual's square for ``support`` and what each other column would take off it."""
        P_rest, y_rest, _, _ = self._split(support)
        return float(y_rest @ y_rest), self._gain(P_rest, y_rest, support)

    def swaps(self, support: list[int]) -> tuple[float, np.ndarray, np.ndarray]:
        """Return the residual's square, its growth on each removal, and the residual of every swap.

        ``swapped[i, j]`` belongs to column ``support[i]`` replaced by column ``j``. With w_i the part of a
        chosen column orthogonal to the other chosen ones, removing it gives every column back its part
        along w_i: all swaps come from one product W'P.
        """
        P_rest, y_rest, Q, T = self._split(support)
        W = Q @ solve_triangular(T, np.eye(len(support)), trans="T", check_finite=False)
        W /= np.linalg.norm(W, axis=0)
        along = W.T @ self.P
        removed = (W.T @ self.y) ** 2
        squares = np.einsum("ij,ij->j", P_rest, P_rest)[None] + along**2
        products = (y_rest @ P_rest)[None] + along * (W.T @ self.y)[:, None]
        open_ = squares > COLLINEARITY**2
        gain = np.where(open_, products**2 / np.where(open_, squares, 1.0), 0.0)
        gain[:, support] = 0.0
        rss = float(y_rest @ y_rest)
        return rss, removed, rss + removed[:, None] - gain

    def pair_exchange(self, support: list[int]) -> tuple[float, tuple[int, int], tuple[int, int]]:
        """Return the residual after the best exchange of two chosen columns for two others, and which.

        Exact, over all pairs of pairs: with the chosen columns' dual vectors, giving two of them back is an
        update of rank two, and the gain of two columns together needs three inner products.
        """
        P_rest, y_rest, Q, T = self._split(support)
        duals = Q @ solve_triangular(T, np.eye(len(support)), trans="T", check_finite=False)
        rss = float(y_rest @ y_rest)
        better, i, j, a, b = _best_exchange(
            P_rest.T @ P_rest, P_rest.T @ y_rest, np.ascontiguousarray(duals.T), self.P, duals.T @ self.P,
            duals.T @ self.y, self.y, self.usable, COLLINEARITY**2,
        )  # fmt: skip
        return (rss - better if i >= 0 else np.inf), (int(i), int(j)), (int(a), int(b))

    def collinear(self, support: list[int]) -> tuple[int, ...]:
        """Return the columns that lie in the span of ``support`` to rounding."""
        P_rest, _, _, _ = self._split(support)
        flat = np.linalg.norm(P_rest, axis=0) <= COLLINEARITY
        flat[support] = False
        return tuple(int(j) for j in np.flatnonzero(flat & self.usable))

    def _split(self, support: list[int]):
        if self._last[0] != support:
            self._last = list(support), self._project(support)
        return self._last[1]

    def _project(self, support: list[int]):
        if not support:
            return self.P, self.y, np.zeros((self.P.shape[0], 0)), np.zeros((0, 0))
        Q, T = qr(self.P[:, support], mode="economic", check_finite=False)
        P_rest = self.P - Q @ (Q.T @ self.P)
        P_rest -= Q @ (Q.T @ P_rest)  # the second pass removes what rounding left of the first
        y_rest = self.y - Q @ (Q.T @ self.y)
        y_rest = y_rest - Q @ (Q.T @ y_rest)
        return P_rest, y_rest, Q, T

    def _gain(self, P_rest, y_rest, support) -> np.ndarray:
        squares = np.einsum("ij,ij->j", P_rest, P_rest)
        open_ = self.usable & (squares > COLLINEARITY**2)
        open_[support] = False
        return np.where(open_, (y_rest @ P_rest) ** 2 / np.where(open_, squares, 1.0), -1.0)


@njit(cache=True, nogil=True)
def _best_exchange(products, numerators, duals, P, along, back, target, free, smallest):
    """Return what the best exchange of two chosen columns for two others takes off the residual, and which.

    ``products`` and ``numerators`` are the inner products of the columns with each other and with the
    target, orthogonal to the chosen ones. ``duals`` are the parts of the chosen columns, a row each, that the
    other chosen ones cannot make; ``along`` and ``back`` are the parts of the columns and of the target along
    them.
    """
    n_chosen, n = along.shape
    best, out_1, out_2, in_1, in_2 = -np.inf, -1, -1, -1, -1
    given = np.empty((2, n))
    for i in range(n_chosen):
        length = np.sqrt(np.sum(duals[i] ** 2))
        first = duals[i] / length
        given[0] = along[i] / length
        back_1 = back[i] / length
        for j in range(i + 1, n_chosen):
            # an orthonormal basis of what the two give back
            size = np.sqrt(np.sum(duals[j] ** 2))
            share = np.sum(first * duals[j])
            second = duals[j] - share * first
            rest = np.sum(first * second)
            second -= rest * first  # removes what rounding left of the first
            width = np.sqrt(np.sum(second**2))
            if width > NEARLY_PARALLEL * size:
                given[1] = (along[j] - (share + rest) * given[0]) / width
                back_2 = (back[j] - (share + rest) * back_1) / width
            elif width > 0.0:  # the difference of what is along them would have few digits
                given[1] = (second / width) @ P
                back_2 = np.sum(second * target) / width
            else:
                continue
            cost = back_1**2 + back_2**2
            least = max(best + cost, -1.0)  # no gain is negative
            gain, a, b = _best_pair(products, numerators, given, back_1, back_2, free, smallest, least)
            if a >= 0:
                best, out_1, out_2, in_1, in_2 = gain - cost, i, j, a, b
    return best, out_1, out_2, in_1, in_2


@njit(cache=True, nogil=True)
def _best_pair(products, numerators, given, back_1, back_2, free, smallest, least):
    """Return the largest joint gain of two columns that is more than ``least``, and which; else ``least``.

    ``given``, shape (2, n_columns), ``back_1`` and ``back_2`` are the parts of the columns and of the target
    along two orthonormal directions that are given back to them.
    """
    n = numerators.size
    squares, numbers = np.empty(n), np.empty(n)
    for b in range(n):
        squares[b] = products[b, b] + given[0, b] ** 2 + given[1, b] ** 2
        if not free[b] or squares[b] <= smallest:
            squares[b] = 0.0  # takes no part
        numbers[b] = numerators[b] + given[0, b] * back_1 + given[1, b] * back_2
    best, first, second = least, -1, -1
    rests, gains, beyond = np.empty(n), np.empty(n), np.empty(n)
    for a in range(n):
        if squares[a] == 0.0:
            continue
        x, y, number_a, inverse = given[0, a], given[1, a], numbers[a], 1.0 / squares[a]
        gain_a = number_a * number_a * inverse
        wanted = best - gain_a
        row, along_1, along_2 = products[a, a + 1 :], given[0, a + 1 :], given[1, a + 1 :]
        square, target = squares[a + 1 :], numbers[a + 1 :]
        # without a division and without a branch, so that the loop runs on several columns at a time
        for b in range(row.size):
            cross = row[b] + x * along_1[b] + y * along_2[b]
            rests[b] = square[b] - cross * cross * inverse  # what is left of b orthogonal to a
            number = target[b] - cross * inverse * number_a
            gains[b] = number * number
            beyond[b] = gains[b] - wanted * rests[b]
        for b in range(row.size):
            if beyond[b] > 0.0 and rests[b] > 1e-9 * square[b]:
                gain = gain_a + gains[b] / rests[b]
                if gain > best:
                    best, first, second = gain, a, a + 1 + b
    return best, first, second


class _Best:
    """The best set seen of each size."""

    def __init__(self, rss_without_terms: float):
        self.rss = [rss_without_terms]
        self.supports: list[tuple[int, ...]] = [()]
        self.floor = EXACT * rss_without_terms

    def improves(self, size: int, rss: float) -> bool:
        """Tell whether ``rss`` is better than the best of that size by more than rounding."""
        return rss < self.rss[size] * (1.0 - IMPROVEMENT) - self.floor

    def record(self, support: list[int], rss: float) -> bool:
        """Keep ``support`` if it is the best of its size; tell whether it is."""
        size = len(support)
        if size == len(self.rss):
            self.rss.append(rss)
            self.supports.append(tuple(support))
            return True
        if self.improves(size, rss):
            self.rss[size] = rss
            self.supports[size] = tuple(support)
            return True
        return False


def _forward(projection: _Projection, n_terms: int, start: list[int], best: _Best) -> None:
    """Add the term of the largest ERR, again and again (2.42)."""
    support = list(start)
    while len(support) < n_terms:
        rss, gains = projection.gains(support)
        if support and len(support) >= len(best.rss):
            best.record(support, rss)
        if gains.max(initial=-1.0) <= 0.0 or rss <= best.floor:
            return
        support.append(int(np.argmax(gains)))
        best.record(support, max(rss - float(gains[support[-1]]), 0.0))


def _floating(projection: _Projection, n_terms: int, start: list[int], best: _Best) -> None:
    """Forward steps; after each, removals and swaps as long as they beat the best set of that size."""
    support = list(start)
    while len(support) < n_terms:
        rss, gains = projection.gains(support)
        if gains.max(initial=-1.0) <= 0.0 or rss <= best.floor:
            return
        support.append(int(np.argmax(gains)))
        _settle(projection, support, best)


def _settle(projection: _Projection, support: list[int], best: _Best) -> None:
    """Improve ``support`` in place by swaps, and look back at smaller sets by removals.

    Each is believed once the set itself has been projected: among nearly collinear columns what a step
    promises may be rounding, and steps that keep no promise go round in circles.
    """
    before, unswapped = np.inf, list(support)
    for _ in range(100 + 10 * len(support)):  # far above what was ever needed; guards against a cycle
        rss, removed, swapped = projection.swaps(support)
        if not rss < before:
            support[:] = unswapped
            return
        best.record(support, rss)
        i, j = np.unravel_index(np.argmin(swapped), swapped.shape)
        if swapped[i, j] < rss * (1.0 - IMPROVEMENT) - best.floor:
            before, unswapped = rss, list(support)
            support[i] = int(j)
            continue
        drop = int(np.argmin(removed))
        if len(support) > 2 and best.improves(len(support) - 1, rss + removed[drop]):
            shorter = [*support[:drop], *support[drop + 1 :]]
            if not best.improves(len(shorter), projection.gains(shorter)[0]):
                return
            before = np.inf
            support[:] = shorter
            continue
        return


def _exchange(projection: _Projection, n_terms: int, start: list[int], best: _Best) -> None:
    """Floating search; then exchanges of two terms for two others, at the sizes that may be chosen."""
    _floating(projection, n_terms, start, best)
    done: set[tuple[int, ...]] = set()
    while True:
        sizes = np.arange(len(best.rss))
        rss = np.maximum(best.rss, best.floor)
        values = information_criterion("ebic", rss, projection.n_samples, sizes, projection.P.shape[1])
        likely = int(np.argmin(values))
        window = range(max(likely - EXCHANGE_REACH, 2), min(likely + EXCHANGE_REACH, len(sizes) - 1) + 1)
        due = [n for n in window if best.rss[n] > best.floor and best.supports[n] not in done]
        if not due:
            return
        for size in due:
            done.add(best.supports[size])
            _exchange_pairs(projection, size, best)


def _exchange_pairs(projection: _Projection, size: int, best: _Best) -> None:
    """Exchange pairs of terms of one size as long as that improves it."""
    while True:
        support = list(best.supports[size])
        rss, out, into = projection.pair_exchange(support)
        kept = {column for i, column in enumerate(support) if i not in out}
        if not best.improves(size, rss) or kept & set(into):
            return
        for position, column in zip(out, into, strict=True):
            support[position] = column
        before = best.rss[size]
        _settle(projection, support, best)
        if not best.rss[size] < before:
            return


def _iterated(projection: _Projection, n_terms: int, start: list[int], best: _Best) -> None:
    """Floating search from several first terms: those of the best sets so far, until nothing improves."""
    _exchange(projection, n_terms, start, best)
    tried: set[int] = set()
    while True:
        before = list(best.rss)
        _, gains = projection.gains([])
        strongest = [int(j) for j in np.argsort(-gains)[:5]]
        starts = [j for j in dict.fromkeys([*best.supports[-1], *strongest]) if j not in tried]
        for first in starts:
            tried.add(first)
            trial = _Best(best.rss[0])
            _forward(projection, n_terms, [first], trial)
            for support in trial.supports[1:]:
                _settle(projection, list(support), best)
        if before == best.rss or not starts:
            return


SEARCHES = {"forward": _forward, "floating": _floating, "exchange": _exchange, "iterated": _iterated}


def search_terms(
    factor: Factor,
    n_terms: int,
    *,
    search: str = "exchange",
    output: int = 0,
    constraints: LinearConstraints | None = None,
) -> SelectionPath:
    """Find good sets of terms of every size up to ``n_terms``.

    Parameters
    ----------
    factor : Factor
        The compressed record of all candidates.
    n_terms : int
        Largest number of terms to look for.
    search : {"exchange", "floating", "forward", "iterated"}, default="exchange"
        ``"forward"``: the term of the largest error reduction ratio next, never looking back (2.40-2.43).
        ``"floating"``: forward steps with removals and swaps after each. ``"exchange"``: floating, then
        the best exchanges of two terms for two others round the size that the extended BIC takes.
        ``"iterated"``: exchange, from several first terms.
    output : int, default=0
        Which output.
    constraints : LinearConstraints, default=None
        Equality constraints on the parameters. Terms are selected under them; the terms that a constraint
        with a value needs belong to every set.

    Returns
    -------
    SelectionPath

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification import Factor, search_terms
    >>> Psi = np.random.default_rng(0).normal(size=(50, 4))
    >>> path = search_terms(Factor.of(Psi, Psi[:, 2] + 0.5 * Psi[:, 0]), n_terms=3)
    >>> sorted(path.supports[2])
    [0, 2]
    """
    check_choice(search, "search", SEARCHES)
    if constraints is not None and len(constraints):
        return _search_constrained(factor, n_terms, search, output, constraints)
    n_terms = min(n_terms, factor.n_terms, max(factor.n_samples - 1, 0))
    projection = _Projection(factor, output)
    best = _Best(factor.sum_of_squares(output))
    SEARCHES[search](projection, n_terms, [], best)
    supports = tuple(best.supports)
    collinear = projection.collinear(list(supports[-1]))
    total = best.rss[0]
    return SelectionPath(supports, np.array(best.rss), total, factor.n_samples, factor.n_terms, collinear)


def _search_constrained(
    factor: Factor, n_terms: int, search: str, output: int, constraints: LinearConstraints
) -> SelectionPath:
    """Search with the constraints put into the regression."""
    _, gains = _Projection(factor, output).gains([])
    solved = constraints.eliminate(gains)
    T = solved.columns(factor.n_terms, factor.n_outputs, output)
    path = search_terms(factor.combine(T), n_terms, search=search, output=output)
    by_size: dict[int, tuple[tuple[int, ...], float]] = {}
    for chosen, rss in zip(path.supports, path.rss, strict=True):
        support = solved.support(chosen)
        if len(support) <= n_terms and (len(support) not in by_size or rss < by_size[len(support)][1]):
            by_size[len(support)] = (support, rss)
    if not by_size:
        fewest = min(len(solved.support(chosen)) for chosen in path.supports)
        raise ValueError(
            f"The constraints need {fewest} terms, but at most {n_terms} may be selected. Raise max_terms "
            "(or n_terms), or pass fewer constraints."
        )
    # sizes below the constraints' own terms do not exist; they stand in the path as never worth taking
    sizes = range(max(by_size) + 1)
    supports = tuple(by_size[n][0] if n in by_size else () for n in sizes)
    rss = np.array([by_size[n][1] if n in by_size else np.inf for n in sizes])
    collinear = tuple(int(solved.rest[j]) for j in path.collinear)
    total = factor.sum_of_squares(output)
    return SelectionPath(supports, rss, total, factor.n_samples, factor.n_terms, collinear)


def _greedy(projection: _Projection, support) -> tuple[tuple[int, ...], np.ndarray]:
    """Order a set by what each term takes off the residual after those before it; return that too."""
    P, y = projection.P[:, list(support)].copy(), projection.y.copy()
    rest = list(support)
    order: list[int] = []
    taken: list[float] = []
    while rest:
        squares = np.einsum("ij,ij->j", P, P)
        gains = np.where(squares > COLLINEARITY**2, (y @ P) ** 2 / np.maximum(squares, 1e-300), 0.0)
        pick = int(np.argmax(gains))
        q = P[:, pick] / max(float(np.sqrt(squares[pick])), 1e-300)
        order.append(rest.pop(pick))
        taken.append(float(gains[pick]))
        P = np.delete(P, pick, axis=1)
        for _ in range(2):  # twice is enough for orthogonality to rounding
            P -= np.outer(q, q @ P)
        y = y - q * (q @ y)
    return tuple(order), np.array(taken)


def err_order(factor: Factor, support, *, output: int = 0) -> tuple[tuple[int, ...], np.ndarray]:
    """Order a set of terms by ERR within it and return the ratios (2.42).

    Parameters
    ----------
    factor : Factor
        The compressed record.
    support : sequence of int
        Indices of the terms.
    output : int, default=0
        Which output.

    Returns
    -------
    order : tuple of int
        The same indices, the largest ERR first, each with those before it taken into account.
    err : ndarray of shape (len(support),)
        Error reduction ratios; they add up to ``1 - rss / y'y``.
    """
    order, taken = _greedy(_Projection(factor, output), support)
    total = factor.sum_of_squares(output)
    return order, taken / total if total > 0 else np.zeros_like(taken)


def criterion_minima(values, *, flat: float = 1e-3) -> list[int]:
    """Return the sizes at local minima of a criterion, step 2 of the thesis's section 5.2.1.1.

    Where several sizes in a row leave the criterion practically unchanged, the first of them counts.

    Parameters
    ----------
    values : array-like of shape (n_sizes,)
        The criterion for sizes 0, 1, 2, ...
    flat : float, default=1e-3
        Change from one size to the next, relative to the range of ``values``, that counts as none.

    Returns
    -------
    list of int
        At least one size.

    Examples
    --------
    >>> from narx_sklearn.identification import criterion_minima
    >>> criterion_minima([9, 5, 3, 4, 2, 2.5])
    [2, 4]
    """
    values = np.asarray(values, dtype=float)
    finite = values[np.isfinite(values)]
    tolerance = flat * (finite.max() - finite.min()) if finite.size else 0.0
    with np.errstate(invalid="ignore"):  # sizes that constraints rule out, next to each other
        flat_step = np.abs(np.diff(values)) <= tolerance
    minima: list[int] = []
    for size in range(1, values.size):
        falls_into = values[size] < values[size - 1]
        last = size == values.size - 1
        rises_after = last or values[size + 1] >= values[size]
        flat_after = not last and flat_step[size]
        if falls_into and (rises_after or flat_after) and not (flat_step[size - 1] and minima):
            minima.append(size)
    return minima or [int(np.argmin(values))]


def size_window(minima: list[int], n_max: int, *, reach: int = 2, first: int = 2) -> list[int]:
    """Return the sizes worth a free run: round the first minima, step 3 of section 5.2.1.1.

    Parameters
    ----------
    minima : list of int
        Sizes at local minima of the criterion.
    n_max : int
        Largest size.
    reach : int, default=2
        Sizes on either side of a minimum.
    first : int, default=2
        How many minima.

    Returns
    -------
    list of int

    Examples
    --------
    >>> from narx_sklearn.identification import size_window
    >>> size_window([9, 12, 17], n_max=20)
    [7, 8, 9, 10, 11, 12, 13, 14]
    """
    sizes = {s for m in minima[:first] for s in range(m - reach, m + reach + 1)}
    return sorted(s for s in sizes if 1 <= s <= n_max)

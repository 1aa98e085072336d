"""Inner products of all terms of a library with a signal, without forming a single regressor.

Every term is a shorter term times one variable, and the last product can be folded into the sum::

    sum_k w[k] (z_i z_j z_l)[k]  =  sum_k (z_i z_j)[k] (w z_l)[k]

so a library of degree 3 needs only its pairs, a few at a time, in the first-level cache. Sorted by their
last variable, the pairs that go with one ``z_l`` stand side by side: a *run*, one long vector operation.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from narx_sklearn.model.kernels import NO_STEP
from narx_sklearn.model.terms import TermLibrary

BLOCK_GROUPS = 128  # groups of samples between two transfers to the totals: keeps rounding errors short
WIDEST_GAP = 8  # shorter gaps in a run are computed rather than left out
FORM_COST = 10  # forming a product, or loading a variable, takes as long as so many operations of a run
RUN_COST = 36  # and so does starting a run


class SumPlan(NamedTuple):
    """How to sum the terms of a library against a signal.

    The workspace of a sample holds the constant and the variables, then products of them, each an earlier
    entry times a variable. A run ``(variable, start, target, length)`` multiplies ``length`` entries from
    ``start`` on by one variable and adds them to the sums from ``target`` on.
    """

    steps: np.ndarray  # (n_variables + 1,) distance of each variable in the flattened data; constant first
    products: np.ndarray  # (n_products, 2) entry and variable whose product is the next entry
    runs: np.ndarray  # (n_runs, 4)
    n_sums: int
    slots: np.ndarray  # (n_terms,) where each term's sum stands
    factors: np.ndarray  # (n_terms, degree) entries whose product is the term

    @classmethod
    def of(cls, library: TermLibrary, channels: tuple[str, ...]) -> "SumPlan":
        """Plan the sums of ``library`` over the named channels, the cheaper of two ways.

        Folding the last factor into the sum pays where the library is dense; where it is sparse and runs
        are short, forming every term and summing all of them as one run does.
        """
        table = library.table(channels)
        steps = np.concatenate(([NO_STEP], table.channels - table.lags * len(channels)))
        # 1*1*z_i*z_j with variables ascending: the constant, entry 0, pads every term to one length.
        padded = [tuple(sorted(row)) for row in (table.factors + 1).tolist()]
        degree = table.factors.shape[1]
        plans = [_plan(steps, padded, formed) for formed in {max(degree - 1, 1), degree}]
        return min(plans, key=lambda plan: plan.operations)

    @property
    def operations(self) -> int:
        """Arithmetic operations a sample; what else takes time is counted as such."""
        summed = 2 * int(self.runs[:, 3].sum()) + RUN_COST * len(self.runs)
        return summed + FORM_COST * (self.steps.size + len(self.products))


def _plan(steps: np.ndarray, terms: list[tuple[int, ...]], formed: int) -> SumPlan:
    """Plan sums in which the first ``formed`` factors of each term are formed, a further one folded in."""
    position: dict[tuple[int, ...], int] = {(variable,): variable for variable in range(steps.size)}
    products: list[tuple[int, int]] = []
    for length in range(2, formed + 1):
        # ordered by last variable: what one variable can still multiply stands side by side
        wanted = sorted((term[length - 1], position[term[: length - 1]]) for term in terms)
        start = steps.size + len(products)
        entry = {pair: start + i for i, pair in enumerate(dict.fromkeys(wanted))}
        products += [(source, variable) for variable, source in entry]
        position = {term[:length]: entry[term[length - 1], position[term[: length - 1]]] for term in terms}
    last = [(term[formed] if len(term) > formed else 0, position[term[:formed]]) for term in terms]
    runs: list[list[int]] = []
    slots = {}
    n_sums = 0
    for variable, source in sorted(last):
        if not runs or runs[-1][0] != variable or source - sum(runs[-1][1::2]) > WIDEST_GAP:
            runs.append([variable, source, n_sums, 0])
        _, start, target, _ = run = runs[-1]
        run[3] = source - start + 1
        slots[variable, source] = target + source - start
        n_sums = target + run[3]
    return SumPlan(
        steps,
        np.array(products, dtype=np.int64).reshape(-1, 2),
        np.array(runs, dtype=np.int64),
        n_sums,
        np.array([slots[pair] for pair in last], dtype=np.int64),
        np.array(terms, dtype=np.int64),
    )


@njit(cache=True, nogil=True)
def term_values(flat, n_channels, rows, steps, factors, columns):
    """Write the terms with the given ``factors`` (of a `SumPlan`) at ``rows`` into ``columns``.

    For a handful of terms, shape (n_terms, n_rows); multiplied from left to right, as the matrix is.
    """
    for t in range(factors.shape[0]):
        column = columns[t]
        column[:] = 1.0
        for f in range(factors.shape[1]):
            if factors[t, f] > 0:
                step = steps[factors[t, f]]
                for i in range(rows.size):
                    column[i] *= flat[rows[i] * n_channels + step]


@njit(cache=True, nogil=True)
def weighted_sums(flat, n_channels, rows, weight, squared, steps, products, runs, totals):
    """Add ``sum_k weight[k] p_t[k]`` over ``rows`` to ``totals`` for every term ``t`` of a `SumPlan`.

    ``squared`` sums the squares of the terms instead. Written is ``totals``, shape (n_sums,).

    Slow form: ``totals[slots] += weight @ Psi[rows]`` (or ``Psi[rows]**2``). Here eight samples go through
    each run together, so that a sum is loaded and stored once for eight products.
    """
    n_variables = steps.size
    work = np.zeros((8, n_variables + products.shape[0]))
    lanes = np.zeros(8)
    block = np.empty(totals.size)
    for begin in range(0, rows.size, 8 * BLOCK_GROUPS):
        end = min(begin + 8 * BLOCK_GROUPS, rows.size)
        block[:] = 0.0
        for first in range(begin, end, 8):
            for lane in range(8):
                entry = work[lane]
                if first + lane >= end:
                    lanes[lane] = 0.0
                    continue
                lanes[lane] = weight[first + lane]
                base = rows[first + lane] * n_channels
                entry[0] = 1.0
                for v in range(1, n_variables):
                    entry[v] = flat[base + steps[v]]
                if squared:
                    for v in range(1, n_variables):
                        entry[v] *= entry[v]
            for i in range(products.shape[0]):
                p, v, t = products[i, 0], products[i, 1], n_variables + i
                work[0, t] = work[0, p] * work[0, v]
                work[1, t] = work[1, p] * work[1, v]
                work[2, t] = work[2, p] * work[2, v]
                work[3, t] = work[3, p] * work[3, v]
                work[4, t] = work[4, p] * work[4, v]
                work[5, t] = work[5, p] * work[5, v]
                work[6, t] = work[6, p] * work[6, v]
                work[7, t] = work[7, p] * work[7, v]
            for s in range(runs.shape[0]):
                v, start, length = runs[s, 0], runs[s, 1], runs[s, 3]
                stop = start + length
                w0, w1, w2, w3 = work[0, v], work[1, v], work[2, v], work[3, v]
                w4, w5, w6, w7 = work[4, v], work[5, v], work[6, v], work[7, v]
                w0, w1, w2, w3 = w0 * lanes[0], w1 * lanes[1], w2 * lanes[2], w3 * lanes[3]
                w4, w5, w6, w7 = w4 * lanes[4], w5 * lanes[5], w6 * lanes[6], w7 * lanes[7]
                p0, p1, p2, p3 = (
                    work[0, start:stop],
                    work[1, start:stop],
                    work[2, start:stop],
                    work[3, start:stop],
                )
                p4, p5, p6, p7 = (
                    work[4, start:stop],
                    work[5, start:stop],
                    work[6, start:stop],
                    work[7, start:stop],
                )
                target = block[runs[s, 2] : runs[s, 2] + length]
                for i in range(length):
                    target[i] += ((w0 * p0[i] + w1 * p1[i]) + (w2 * p2[i] + w3 * p3[i])) + (
                        (w4 * p4[i] + w5 * p5[i]) + (w6 * p6[i] + w7 * p7[i])
                    )
        for i in range(totals.size):
            totals[i] += block[i]

"""Times that are sessions of a record: those in which something may have acted that did not in the others."""

from itertools import pairwise

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.placed import Span

MOST_SPANS = 10  # that are looked at: all, of up to six sessions
NEAR = 0.02  # of the samples of a session, within which a span ends where the session does


def sessions_of(problem: Problem, residual: np.ndarray) -> list[Span]:
    """Return the sessions one by one, and what is after each of them; none where there is one session only.

    Of many, those are returned in which a ``residual``, (n_samples, n_outputs), is larger than in the rest.
    """
    began, dt = np.unique(problem.windows.began), problem.simulator.dt
    if began.size < 2:
        return []
    edges = [-np.inf, *(began[1:] * dt).tolist(), np.inf]
    alone = [Span(a, b, along_record=True) for a, b in pairwise(edges)]
    spans = alone + [Span(edge, np.inf, along_record=True) for edge in edges[1:-2]]
    if len(spans) <= MOST_SPANS:
        return spans
    known = np.isfinite(residual).sum(axis=0)
    size = np.sqrt(np.nansum(residual**2, axis=0) / np.maximum(known, 1))
    pieces = np.split(residual / np.where(size > 0, size, 1.0), began[1:])
    cost = np.array([np.nansum(piece**2) for piece in pieces])
    values = np.array([np.count_nonzero(np.isfinite(piece)) for piece in pieces])
    stands_out = [_stands_out(span.holds(began, began, dt), cost, values) for span in spans]
    chosen = np.argsort(stands_out, kind="stable")[: -MOST_SPANS - 1 : -1]
    return [spans[i] for i in sorted(chosen) if stands_out[i] > 0]


def _stands_out(inside: np.ndarray, cost: np.ndarray, values: np.ndarray) -> float:
    """Return how much likelier a variance of their own makes what some sessions leave; 0 if it is less.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.stages.in_sessions import _stands_out
    >>> cost, values = np.array([100.0, 400.0, 100.0]), np.full(3, 100.0)
    >>> [round(_stands_out(np.arange(3) == k, cost, values)) for k in range(3)]
    [0, 69, 0]
    """
    (n_in, n_out), (c_in, c_out) = ((of[inside].sum(), of[~inside].sum()) for of in (values, cost))
    if not (n_in and n_out) or c_in * n_out <= c_out * n_in:
        return 0.0
    tiny = np.finfo(float).tiny
    terms = (n_in, c_in), (n_out, c_out)
    whole = (n_in + n_out) * np.log((c_in + c_out) / (n_in + n_out))
    return float(whole - sum(n * np.log(max(c / n, tiny)) for n, c in terms))


def to_sessions(span: Span, problem: Problem) -> Span:
    """Return a span along a record whose ends are those of sessions where next to nothing is in between."""
    if not span.along_record:
        return span
    windows, dt = problem.windows, problem.simulator.dt
    fitted = np.concatenate([np.arange(a, b) for a, b in zip(windows.first, windows.last, strict=True)]) * dt
    edges = np.append(np.unique(windows.began) * dt, np.inf)
    edges[0] = -np.inf
    few = NEAR * fitted.size / (edges.size - 1)

    def moved(end: float) -> float:
        between = [np.count_nonzero((fitted >= min(end, e)) & (fitted < max(end, e))) for e in edges]
        nearest = int(np.argmin(between))
        return float(edges[nearest]) if between[nearest] <= few else end

    return span._replace(begins=moved(span.begins), ends=moved(span.ends))

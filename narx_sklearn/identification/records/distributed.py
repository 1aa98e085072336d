"""dask arrays and DataFrames as records: partitions are compressed where they are, factors travel.

A task compresses one partition, with the samples before it that lags reach taken from the partitions before;
a tree of tasks merges the factors. All of it runs on the scheduler the user has: a distributed client that
is current, else dask's threads. Nothing is kept on a worker that could not be computed again.
"""

from collections.abc import Callable, Iterator
from functools import reduce
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from narx_sklearn._threads import single_threaded_blas
from narx_sklearn._validation import as_signals, column_labels
from narx_sklearn.identification.records.record import (
    CHUNK_ROWS,
    GROUP_BLOCKS,
    MERGED_TOGETHER,
    Block,
    Moments,
    Record,
    fingerprint,
    grouped,
    in_groups,
    merge_tree,
    running_total,
)

__all__ = ["DaskRecord"]


class Survey(NamedTuple):
    """What one pass over a partition found."""

    n_samples: int
    n_outputs: int
    n_labels: int | None
    moments: Moments
    first_label: Any
    last_label: Any
    fingerprint: str


class DaskRecord(Record):
    """A dask array or DataFrame of inputs, with outputs and labels partitioned alike.

    Parameters
    ----------
    X : dask array of shape (n_samples, n_inputs) or dask DataFrame
        Inputs.
    y : dask array or Series or DataFrame, or array-like of shape (n_samples,) or (n_samples, n_outputs)
        Outputs, in the partitions of ``X`` where they are a dask collection.
    sessions : dask array or Series, or array-like of shape (n_samples,), default=None
        Labels, in the partitions of ``X`` where they are a dask collection.

    Raises
    ------
    ValueError
        If partitions do not match, or values are not finite numbers or NaN.
    TypeError
        If ``y`` is a dask collection and ``X`` is not.

    Examples
    --------
    >>> import dask.array as da
    >>> import numpy as np
    >>> from narx_sklearn import NARXRegressor
    >>> rng = np.random.default_rng(0)
    >>> u, y = rng.uniform(-1, 1, size=(2000, 1)), np.zeros(2000)
    >>> for k in range(1, 2000):
    ...     y[k] = 0.5 * y[k - 1] + u[k - 1, 0] ** 2
    >>> X, target = da.from_array(u, chunks=(300, 1)), da.from_array(y, chunks=300)
    >>> NARXRegressor(origin="zero", refine=False).fit(X, target).coef_.round(6).tolist()
    [0.5, 1.0]
    """

    def __init__(self, X, y, sessions=None):
        _dask()  # says what to install
        if not hasattr(X, "__dask_graph__"):
            raise TypeError(
                f"y is a dask collection and X is {type(X).__name__}; make X one too, or y an array "
                "(y.compute())."
            )
        if y is None:
            raise ValueError("requires y to be passed, but the target y is None")
        if getattr(X, "ndim", 2) != 2:
            raise ValueError(
                f"X must have two axes, samples by inputs, got {X.ndim}. Reshape it: X[:, None]."
            )
        self.input_labels, self.output_labels = column_labels(X), column_labels(y)
        self.n_inputs = int(X.shape[1])
        self.y_ndim = int(y.ndim if hasattr(y, "ndim") else np.ndim(y))
        parts = partitions(X)
        rows = _known_rows(X)
        if rows is None and not all(_is_lazy(side) for side in (y, sessions)):
            rows = _compute([_delayed(len)(part) for part in parts])
        self._X = parts
        self._y = _cut_alike(y, "y", parts, rows)
        self._sessions = (
            [None] * len(parts) if sessions is None else _cut_alike(sessions, "sessions", parts, rows)
        )
        self._take_stock()

    def _take_stock(self) -> None:
        """Visit every partition once: lengths, labels at the edges, moments."""
        work = _delayed(survey)
        sides = zip(self._X, self._y, self._sessions, strict=True)
        found: list[Survey] = _compute([work(*side) for side in sides])
        for i, one in enumerate(found):
            if one.n_labels not in (None, one.n_samples):
                raise ValueError(
                    f"Partition {i} of X has {one.n_samples} samples, of sessions {one.n_labels}; take all "
                    "from one DataFrame, or rechunk them alike."
                )
        self.lengths = [one.n_samples for one in found]
        self.firsts = [int(first) for first in np.cumsum([0, *self.lengths])]
        self.n_samples, self.n_outputs = self.firsts[-1], found[0].n_outputs
        if self.n_samples == 0:
            raise ValueError("X holds no samples in any of its partitions.")
        self.moments = merge_tree(Moments.merge, [one.moments for one in found])
        self._edge_labels = [(one.first_label, one.last_label) for one in found]
        self._fingerprints = [one.fingerprint for one in found]

    def map(self, function, *, reach=0, whole=False):
        """Return ``function(block)`` for every block; see `Record.map`."""
        function = _delayed(function, traverse=False)
        work = _delayed(map_part)
        found = _compute([work(function, *part) for part in self._parts(reach, whole)])
        return [value for values in found for value in values]

    def total(self, function, merge, *, reach=0, whole=False, checkpoint=None):
        """Return the merge over all blocks; see `Record.total`."""
        function = _delayed(function, traverse=False)
        leaf, node = _delayed(total_of_part), _delayed(total_of_values)

        def tree(parts):
            values = [leaf(function, merge, *part) for part in parts]
            while len(values) > 1:
                values = [node(merge, *group) for group in grouped(values, MERGED_TOGETHER)]
            return values[0]

        groups = grouped(self._parts(reach, whole), GROUP_BLOCKS)
        if checkpoint is None:
            # one graph, of the shape that a checkpoint's groups give
            totals = [tree(group) for group in groups]
            while len(totals) > 1:
                totals = [node(merge, *group) for group in grouped(totals, MERGED_TOGETHER)]
            (value,) = _compute(totals)
            return value
        return in_groups(groups, lambda group: _compute([tree(group)])[0], merge, checkpoint)

    def take(self, runs):
        """Return the samples in ``runs``; see `Record.take`."""
        work = _delayed(cut)
        pieces = [
            work(self._X[i], self._y[i], self._sessions[i], run.start - first, run.stop - first)
            for run in runs
            for i, first in enumerate(self.firsts[:-1])
            if run.start < first + self.lengths[i] and run.stop > first
        ]
        X, y, labels = zip(*_compute(pieces), strict=True)
        return np.concatenate(X), np.concatenate(y), None if labels[0] is None else np.concatenate(labels)

    def description(self):
        """Return lengths and fingerprints of the partitions; see `Record.description`."""
        return {
            "partitions": self.lengths,
            "fingerprints": self._fingerprints,
            "sessions": [len(group) for group in self._whole_sessions()],
        }

    def _parts(self, reach: int, whole: bool) -> list[tuple]:
        """Return, for every task, what `blocks_of_part` takes: a plan, partitions, ends of those before."""
        groups = self._whole_sessions() if whole else [[i] for i, n in enumerate(self.lengths) if n]
        tail = _delayed(last_samples)
        tails: dict[int, Any] = {}
        found = []
        for group in groups:
            before: list[int] = []
            i = group[0] - 1
            while not whole and i >= 0 and sum(self.lengths[j] for j in before) < reach:
                before.insert(0, i)
                i -= 1
            for j in before:
                if j not in tails:
                    tails[j] = tail(self._X[j], self._y[j], self._sessions[j], reach)
            own = [side for j in group for side in (self._X[j], self._y[j], self._sessions[j])]
            plan = f"{len(group)} {reach} {self.firsts[group[0]]} {int(whole)}"
            # flat: dask looks into lists and tuples for tasks, at some milliseconds each
            found.append((plan, *own, *(tails[j] for j in before)))
        return found

    def _whole_sessions(self) -> list[list[int]]:
        """Return runs of partitions that share no session with each other."""
        groups: list[list[int]] = []
        last = None
        for i, (n, labels) in enumerate(zip(self.lengths, self._edge_labels, strict=True)):
            if n == 0:
                continue
            if groups and (self._sessions[i] is None or labels[0] == last):
                groups[-1].append(i)
            else:
                groups.append([i])
            last = labels[1]
        return groups


# -- what runs on the workers -------------------------------------------------------------------------------


def samples_of(X, y, sessions) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Return a partition as arrays."""
    inputs, outputs = as_values(X, "X"), as_values(y, "y")
    return inputs, outputs, None if sessions is None else np.asarray(sessions).reshape(-1)


def as_values(part, name: str) -> np.ndarray:
    """Return a side of a partition as float64, shape (n_samples, n_signals); it may hold no samples."""
    if len(part) == 0:
        part = np.asarray(part, dtype=float)
        return part.reshape(0, part.shape[1] if part.ndim == 2 else 1)
    return as_signals(part, name)


def survey(X, y, sessions) -> Survey:
    """Measure a partition."""
    X, y, labels = samples_of(X, y, sessions)
    if X.shape[0] != y.shape[0]:
        raise ValueError(
            f"A partition of X has {X.shape[0]} samples, and of y {y.shape[0]}; take both from one "
            "DataFrame, or rechunk them alike."
        )
    first, last = (None, None) if labels is None or labels.size == 0 else (labels[0], labels[-1])
    n_labels = None if labels is None else labels.size
    if n_labels not in (None, X.shape[0]):  # which is refused
        return Survey(X.shape[0], y.shape[1], n_labels, Moments.of(X, y), first, last, "")
    moments = Moments.of(X, y, labels)
    return Survey(X.shape[0], y.shape[1], n_labels, moments, first, last, fingerprint(X, y, labels))


def last_samples(X, y, sessions, reach: int):
    """Return the end of a partition, as long as lags reach."""
    X, y, labels = samples_of(X, y, sessions)
    end = slice(max(X.shape[0] - reach, 0), None)
    return X[end].copy(), y[end].copy(), None if labels is None else labels[end].copy()


def cut(X, y, sessions, start: int, stop: int):
    """Return a stretch of a partition."""
    X, y, labels = samples_of(X, y, sessions)
    rows = slice(max(start, 0), max(stop, 0))
    return X[rows], y[rows], None if labels is None else labels[rows]


def _joined(one: tuple, other: tuple) -> tuple:
    return tuple(None if a is None else np.concatenate([a, b]) for a, b in zip(one, other, strict=True))


def blocks_of_part(plan: str, *pieces) -> Iterator[Block]:
    """Yield the blocks of a task.

    Parameters
    ----------
    plan : str
        Number of partitions, how far lags reach, index of the first sample, 1 for whole sessions.
    *pieces
        Inputs, outputs and labels of each partition; then the ends of partitions before, in order.
    """
    n_parts, reach, first, whole = map(int, plan.split())
    own = reduce(_joined, (samples_of(*pieces[3 * i : 3 * i + 3]) for i in range(n_parts)))
    before = pieces[3 * n_parts :]
    n_past = 0
    if before:
        ends = reduce(_joined, before)
        start = max(ends[0].shape[0] - reach, 0)
        n_past = ends[0].shape[0] - start
        own = _joined(tuple(None if side is None else side[start:] for side in ends), own)
    block = Block(*own, n_past, first)
    return block.split(max(block.n_own, 1) if whole else CHUNK_ROWS, reach)


def map_part(function: Callable, plan: str, *pieces) -> list:
    """Return ``function(block)`` for the blocks of a task."""
    return [function(block) for block in blocks_of_part(plan, *pieces)]


def total_of_part(function: Callable, merge: Callable, plan: str, *pieces):
    """Return the total over the blocks of a task."""
    with single_threaded_blas():
        return running_total(function, merge, blocks_of_part(plan, *pieces))


def total_of_values(merge: Callable, *values):
    """Return the merge of a few results."""
    with single_threaded_blas():
        return reduce(merge, values)


# -- dask ---------------------------------------------------------------------------------------------------


def _dask():
    """Return dask; the error says what to install."""
    try:
        import dask
    except ImportError as error:
        raise ImportError('dask collections need dask: pip install "narx-sklearn[dask]".') from error
    return dask


def _delayed(function, **options):
    return _dask().delayed(function, pure=False, **options)


def _compute(values: list) -> list:
    return list(_dask().compute(*values))


def _is_lazy(side) -> bool:
    return side is None or hasattr(side, "__dask_graph__")


def _known_rows(X) -> list[int] | None:
    """Return the lengths of the partitions, None where dask does not know them."""
    rows = getattr(X, "chunks", None)
    return None if rows is None or np.isnan(rows[0]).any() else [int(n) for n in rows[0]]


def partitions(data) -> list:
    """Return the partitions of a dask collection, in order, all columns together."""
    if not hasattr(data, "chunks"):
        # only the columns wanted are read; a full optimisation may join the partitions of one side only
        frame = data.simplify() if hasattr(data, "simplify") else data
        return list(frame.to_delayed(optimize_graph=False))
    if data.ndim == 2 and len(data.chunks[1]) > 1:
        data = data.rechunk({1: -1})
    # unoptimised, so that two columns of one array share the task that makes them
    return list(data.to_delayed(optimize_graph=False).reshape(-1))


def _cut_alike(side, name: str, parts: list, rows: list[int] | None) -> list:
    """Return ``y`` or ``sessions`` in the partitions of X."""
    if hasattr(side, "__dask_graph__"):
        if rows is not None and _known_rows(side) not in (None, rows):
            if sum(rows) != sum(_known_rows(side) or []):
                raise ValueError(
                    f"X has {sum(rows)} samples and {name} has {side.shape[0]}; they must be of one length."
                )
            side = side.rechunk({0: tuple(rows)})
        cut_alike = partitions(side)
        if len(cut_alike) != len(parts):
            raise ValueError(
                f"X has {len(parts)} partitions and {name} has {len(cut_alike)}; take both from one "
                "DataFrame, or rechunk them alike."
            )
        return cut_alike
    values = side if hasattr(side, "iloc") else np.asarray(side)
    assert rows is not None  # lengths are computed where a side is in memory
    if len(values) != sum(rows):
        raise ValueError(
            f"X has {sum(rows)} samples and {name} has {len(values)}; they must be of one length."
        )
    edges = np.cumsum([0, *rows])
    at = values.iloc if hasattr(values, "iloc") else values
    return [at[a:b] for a, b in pairwise(edges)]

"""A record that is read block by block: the one way in which fits visit arrays, files and clusters.

Whatever holds the samples, a fit asks it for two things: the results of a function on every block, or their
total under an associative merge. Blocks know the samples before them that lags reach.
"""

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from narx_sklearn._validation import all_finite, blocks, session_slices

CHUNK_ROWS = 1 << 18  # samples laid out at a time: some megabytes a channel
MERGED_TOGETHER = 8  # results merged by one task: a tree of depth 4 over four thousand blocks
GROUP_BLOCKS = 64  # blocks whose total is saved together in a checkpoint


class Block(NamedTuple):
    """Consecutive samples of a record, preceded by those that their lags reach.

    Attributes
    ----------
    X, y : ndarray of shape (n_past + n_own, n_inputs) and (n_past + n_own, n_outputs)
        Inputs and outputs.
    sessions : ndarray of shape (n_past + n_own,) or None
        Labels.
    n_past : int
        Leading samples that belong to earlier blocks.
    first : int
        Index in the record of the first sample of the block's own.
    """

    X: np.ndarray
    y: np.ndarray
    sessions: np.ndarray | None
    n_past: int
    first: int

    @property
    def n_own(self) -> int:
        """Number of samples of the block's own."""
        return self.X.shape[0] - self.n_past

    @property
    def origin(self) -> int:
        """Index in the record of the first sample held."""
        return self.first - self.n_past

    def split(self, size: int, reach: int) -> "Iterator[Block]":
        """Yield smaller blocks, each with as many samples before it as lags reach."""
        n_samples = self.X.shape[0]
        for begin in range(self.n_past, n_samples, size):
            start = max(begin - reach, 0)
            part = slice(start, min(begin + size, n_samples))
            labels = None if self.sessions is None else self.sessions[part]
            yield Block(self.X[part], self.y[part], labels, begin - start, self.origin + begin)


class Moments(NamedTuple):
    """Sums over the known values of each output and then each input.

    Attributes
    ----------
    known, mean, square, low, high : ndarray of shape (n_signals,)
        Number of known values, their mean, sum of squared deviations from it, smallest and largest.
    change : ndarray of shape (n_signals,)
        Largest change from one sample to the next of its session; from stretch to stretch none is measured.
    """

    known: np.ndarray
    mean: np.ndarray
    square: np.ndarray
    low: np.ndarray
    high: np.ndarray
    change: np.ndarray

    @classmethod
    def of(cls, X: np.ndarray, y: np.ndarray, sessions: np.ndarray | None = None) -> "Moments":
        """Measure a stretch, NaN left out."""
        total = cls.none(X.shape[1] + y.shape[1])
        with np.errstate(over="ignore", invalid="ignore"):  # such values are refused by who fits them
            for rows in blocks(X.shape[0]):
                columns = (column[rows] for side in (y, X) for column in side.T)
                known = [c if all_finite(c) else c[np.isfinite(c)] for c in columns]
                means = np.array([c.mean() if c.size else 0.0 for c in known])
                total = total.merge(
                    cls(
                        np.array([c.size for c in known], dtype=float),
                        means,
                        np.array([((c - m) ** 2).sum() for c, m in zip(known, means, strict=True)]),
                        np.array([c.min(initial=np.inf) for c in known]),
                        np.array([c.max(initial=-np.inf) for c in known]),
                        np.zeros(len(known)),
                    )
                )
            change = [_largest_change(column, sessions) for side in (y, X) for column in side.T]
        return total._replace(change=np.array(change))

    @classmethod
    def none(cls, n_signals: int) -> "Moments":
        """Return the moments of no samples."""
        zero = np.zeros(n_signals)
        return cls(zero, zero, zero, np.full(n_signals, np.inf), np.full(n_signals, -np.inf), zero)

    def merge(self, other: "Moments") -> "Moments":
        """Return the moments of both stretches (Chan, Golub and LeVeque's update)."""
        known = self.known + other.known
        share = other.known / np.maximum(known, 1.0)
        step = other.mean - self.mean
        return Moments(
            known,
            self.mean + step * share,
            self.square + other.square + step**2 * self.known * share,
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
            np.maximum(self.change, other.change),
        )

    @property
    def range(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Smallest value, mean and largest value of each signal."""
        return self.low, np.clip(self.mean, self.low, self.high), self.high  # a mean has its rounding

    @property
    def deviation(self) -> np.ndarray:
        """Standard deviation of each signal."""
        return np.sqrt(self.square / np.maximum(self.known, 1.0))


def _largest_change(column: np.ndarray, sessions: np.ndarray | None) -> float:
    """Return the largest change between known neighbours of one session, block by block."""
    largest = 0.0
    for rows in blocks(column.size):
        part = slice(max(rows.start - 1, 0), rows.stop)
        change = np.abs(np.diff(column[part]))
        if sessions is not None:
            change = change[sessions[part][1:] == sessions[part][:-1]]
        largest = max(largest, change[np.isfinite(change)].max(initial=0.0))
    return float(largest)


class Record(ABC):
    """Samples of inputs and outputs, wherever they are.

    Attributes
    ----------
    n_samples : int
        Number of samples.
    moments : Moments
        Of the outputs and then the inputs.
    input_labels, output_labels : list or None
        Labels of the columns, None where they have none.
    y_ndim : int
        1 where the output came as a vector.
    in_memory : bool
        Whether every sample can be reached directly.
    sampling_period : float or None
        Seconds between samples, where the samples tell.
    """

    n_samples: int
    moments: Moments
    n_inputs: int
    n_outputs: int
    input_labels: list | None
    output_labels: list | None
    y_ndim: int
    in_memory: bool = False
    sampling_period: float | None = None

    @abstractmethod
    def map(self, function: Callable[[Block], Any], *, reach: int = 0, whole: bool = False) -> list:
        """Return ``function(block)`` for every block, in the order of the samples.

        Parameters
        ----------
        function : callable
            Takes a `Block`; can be pickled.
        reach : int, default=0
            How many samples before its own a block needs.
        whole : bool, default=False
            Whether blocks must hold whole sessions, for what remembers all of the past.
        """

    @abstractmethod
    def total(
        self,
        function: Callable[[Block], Any],
        merge: Callable[[Any, Any], Any],
        *,
        reach: int = 0,
        whole: bool = False,
        checkpoint=None,
    ) -> Any:
        """Return the merge of ``function(block)`` over all blocks; the order of merges is always the same.

        ``checkpoint``, if given, keeps the totals of groups of blocks, and returns those it has.
        """

    @abstractmethod
    def take(self, runs: Sequence[slice]) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Return inputs, outputs and labels of the samples in ``runs``, one run after the other."""

    @abstractmethod
    def description(self) -> dict:
        """Return what tells this record, and how it is cut, from others; values fit for JSON."""

    def everything(self) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Return inputs, outputs and labels of the whole record."""
        return self.take([slice(0, self.n_samples)])

    def in_one_place(self) -> "ArrayRecord":
        """Return the record with all samples in this process."""
        labels = {"input_labels": self.input_labels, "output_labels": self.output_labels}
        return ArrayRecord(*self.everything(), **labels, y_ndim=self.y_ndim)

    def stand_in(self):
        """Return two samples of zeros with the inputs' columns, which validation can look at."""
        zeros = np.zeros((2, self.n_inputs))
        return zeros if self.input_labels is None else pd.DataFrame(zeros, columns=self.input_labels)


class ArrayRecord(Record):
    """Arrays in memory, or mapped from disk.

    Parameters
    ----------
    X, y : ndarray of shape (n_samples, n_inputs) and (n_samples, n_outputs)
        Inputs and outputs.
    sessions : ndarray of shape (n_samples,) or None
        Labels.
    input_labels, output_labels : list or None
        Labels of the columns.
    y_ndim : int, default=1
        1 where the output came as a vector.
    n_past : int, default=0
        Leading samples that belong to an earlier record and that only lags read.
    sampling_period : float or None, default=None
        Seconds between samples, where known.
    """

    in_memory = True

    def __init__(
        self, X, y, sessions=None, *,
        input_labels=None, output_labels=None, y_ndim=1, n_past=0, sampling_period=None,
    ):  # fmt: skip
        self.X, self.y = X, y
        self.sessions = None if sessions is None else np.asarray(sessions)
        self.n_past, self.sampling_period = n_past, sampling_period
        self.n_samples, self.n_inputs = X.shape[0] - n_past, X.shape[1]
        self.n_outputs = y.shape[1]
        self.input_labels, self.output_labels, self.y_ndim = input_labels, output_labels, y_ndim

    @property
    def moments(self) -> Moments:  # type: ignore[override]
        """Of the outputs and then the inputs; measured when first asked for."""
        if not hasattr(self, "_moments"):
            self._moments = Moments.of(
                self.X[self.n_past :],
                self.y[self.n_past :],
                None if self.sessions is None else self.sessions[self.n_past :],
            )
        return self._moments

    def blocks(self, reach: int = 0, whole: bool = False) -> Iterator[Block]:
        """Yield the blocks of the record; see `Record.map`."""
        everything = Block(self.X, self.y, self.sessions, self.n_past, 0)
        return everything.split(max(self.n_samples, 1) if whole else CHUNK_ROWS, reach)

    def map(self, function, *, reach=0, whole=False):
        """Return ``function(block)`` for every block; see `Record.map`."""
        return [function(block) for block in self.blocks(reach, whole)]

    def total(self, function, merge, *, reach=0, whole=False, checkpoint=None):
        """Return the merge over all blocks; see `Record.total`."""
        groups = grouped(list(self.blocks(reach, whole)), GROUP_BLOCKS)
        return in_groups(groups, lambda group: running_total(function, merge, group), merge, checkpoint)

    def take(self, runs):
        """Return the samples in ``runs``; see `Record.take`."""
        rows: slice | np.ndarray
        if len(runs) == 1:
            rows = slice(runs[0].start + self.n_past, runs[0].stop + self.n_past)
        else:
            rows = np.concatenate([np.arange(r.start, r.stop) for r in runs]) + self.n_past
        return self.X[rows], self.y[rows], None if self.sessions is None else self.sessions[rows]

    def after(self, X: np.ndarray, y: np.ndarray, sessions: np.ndarray) -> "ArrayRecord":
        """Return the record with earlier samples in front, which only its lags read."""
        return ArrayRecord(
            np.vstack([X, self.X]),
            np.vstack([y, self.y]),
            np.concatenate([sessions, self.sessions]),
            input_labels=self.input_labels,
            output_labels=self.output_labels,
            y_ndim=self.y_ndim,
            n_past=X.shape[0],
        )

    def end(self, n_samples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Return the last samples held, those in front included."""
        last = slice(max(self.X.shape[0] - n_samples, 0), None)
        labels = None if self.sessions is None else self.sessions[last].copy()
        return self.X[last].copy(), self.y[last].copy(), labels

    def description(self):
        """Return length and fingerprint of the record; see `Record.description`."""
        return {"n_samples": self.n_samples, "fingerprint": fingerprint(self.X, self.y, self.sessions)}


def fingerprint(X: np.ndarray, y: np.ndarray, sessions: np.ndarray | None) -> str:
    """Return a short text that changes with any sample of a stretch, and with any border between sessions.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification.records.record import fingerprint
    >>> X, y = np.zeros((4, 1)), np.arange(4.0)[:, None]
    >>> whole, parted, backwards = (
    ...     fingerprint(X, y, None), fingerprint(X, y, np.array([0, 0, 1, 1])), fingerprint(X, y[::-1], None)
    ... )
    >>> whole == fingerprint(X, y, np.zeros(4)), whole == parted, whole == backwards
    (True, False, False)
    """
    found = hashlib.blake2b(repr((X.shape, y.shape)).encode(), digest_size=16)
    for rows in blocks(X.shape[0]):
        found.update(X[rows].tobytes())
        found.update(y[rows].tobytes())
    begins = [piece.start for piece in session_slices(sessions, X.shape[0])]
    found.update(np.array(begins, dtype=np.int64).tobytes())
    return found.hexdigest()


def grouped(items: Sequence, size: int) -> list[Sequence]:
    """Return consecutive items in groups of ``size``."""
    return [items[i : i + size] for i in range(0, len(items), size)]


def running_total(function, merge, items: Iterable):
    """Return the merge of ``function(item)`` over items, one held at a time."""
    iterator = iter(items)
    value = function(next(iterator))
    for item in iterator:
        value = merge(value, function(item))
    return value


def in_groups(groups: Sequence, total_of: Callable, merge: Callable, checkpoint=None):
    """Return the merge of ``total_of(group)`` over groups, those that a checkpoint holds taken from it."""
    values = []
    for i, group in enumerate(groups):
        value = None if checkpoint is None else checkpoint.load(i)
        if value is None:
            value = total_of(group)
            if checkpoint is not None:
                checkpoint.save(i, value)
        values.append(value)
    return merge_tree(merge, values)


def merge_tree(merge: Callable, values: Sequence):
    """Return the merge of values as a tree whose shape depends on their number alone."""
    values = list(values)
    while len(values) > 1:
        values = [running_total(_itself, merge, group) for group in grouped(values, MERGED_TOGETHER)]
    return values[0]


def _itself(value):
    return value

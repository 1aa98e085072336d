"""Folds of a record: which samples train and which test, and the training parts compressed by merging."""

from dataclasses import replace
from functools import partial
from itertools import pairwise
from numbers import Integral
from threading import Lock
from typing import NamedTuple

import numpy as np
from sklearn.model_selection import KFold, check_cv

from narx_sklearn._threads import single_threaded_blas
from narx_sklearn.identification.one_step.factor import Factor, compress
from narx_sklearn.identification.one_step.procedure import (
    Compressed,
    Problem,
    compress_choices,
    merge_parts,
    origin_choices,
    scaled_layout,
)
from narx_sklearn.identification.one_step.regressors import Candidates, reach_of, remembers_all
from narx_sklearn.identification.records.record import Block, Record
from narx_sklearn.model.recording import Layout
from narx_sklearn.model.terms import TermLibrary

__all__ = ["Fold", "FoldedRecord", "parted", "runs_of", "split_in_runs"]


class Fold(NamedTuple):
    """Training and test part as runs of consecutive samples."""

    training: list[slice]
    test: list[slice]


def split_in_runs(cv, record: Record) -> list[Fold]:
    """Return the folds of a splitter; an integer (None: five) is that many parts, each held out once.

    Outputs of a machine follow its inputs, so that its past may be judged by a model of its future, and each
    model is fitted to nearly as much as the final one; in order of time the first would have a sixth of it.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification.cross_validation.folds import split_in_runs
    >>> from narx_sklearn.identification.records.record import ArrayRecord
    >>> record = ArrayRecord(np.zeros((7, 1)), np.zeros((7, 1)))
    >>> for fold in split_in_runs(3, record):
    ...     print([(run.start, run.stop) for run in fold.training], [(r.start, r.stop) for r in fold.test])
    [(3, 7)] [(0, 3)]
    [(0, 3), (5, 7)] [(3, 5)]
    [(0, 5)] [(5, 7)]
    """
    n_samples = record.n_samples
    if n_samples < 2:
        raise ValueError(f"Folds need at least two samples, got n_samples = {n_samples}.")
    if cv is None or isinstance(cv, Integral):
        n_splits = KFold(5 if cv is None else int(cv)).n_splits  # refuses a number that cannot be
        if n_splits > n_samples:
            raise ValueError(
                f"cv={n_splits} folds need at least as many samples, got n_samples = {n_samples}. "
                "Pass a smaller cv, or a longer record."
            )
        sizes = np.full(n_splits, n_samples // n_splits)
        sizes[: n_samples % n_splits] += 1
        cuts = [0, *np.cumsum(sizes).tolist()]
        return [
            Fold([run for run in (slice(0, a), slice(b, n_samples)) if run.start < run.stop], [slice(a, b)])
            for a, b in pairwise(cuts)
        ]
    placeholder = np.empty((n_samples, 0))
    return [Fold(runs_of(np.sort(a)), runs_of(b)) for a, b in check_cv(cv).split(placeholder)]


def runs_of(indices: np.ndarray) -> list[slice]:
    """Return indices (or a mask) as runs of consecutive ones, in their order."""
    indices = np.flatnonzero(indices) if indices.dtype == bool else indices
    if indices.size == 0:
        return []
    cuts = np.flatnonzero(np.diff(indices) != 1) + 1
    firsts, lasts = indices[np.r_[0, cuts]], indices[np.r_[cuts - 1, indices.size - 1]]
    return [slice(int(a), int(b) + 1) for a, b in zip(firsts, lasts, strict=True)]


def parted(labels: np.ndarray | None, runs: list[slice]) -> np.ndarray | None:
    """Return session labels that change from run to run too, where samples of several runs stand in a row."""
    if len(runs) < 2:
        return labels
    own = np.repeat(np.arange(len(runs)), [run.stop - run.start for run in runs])
    if labels is None:
        return own
    begins = (own[1:] != own[:-1]) | (labels[1:] != labels[:-1])
    return np.concatenate([[0], np.cumsum(begins)])


class FoldedRecord:
    """A record compressed stretch by stretch, so that the training part of every fold is a merge."""

    def __init__(self, problems: list[Problem], record: Record, folds: list[Fold], settings):
        self.record, self.folds, self.settings = record, folds, settings
        first = problems[0]
        union = TermLibrary(term for problem in problems for term in problem.library)
        self.problem = Problem(first.outputs, first.inputs, first.phi, union)
        self.libraries = tuple(problem.library for problem in problems)
        self.layout = scaled_layout(self.problem, record)
        edges = {0, record.n_samples}
        for fold in folds:
            edges |= {edge for run in fold.training for edge in (run.start, run.stop)}
        self.edges = np.array(sorted(edges))
        self._parts: dict = {}
        self._lock = Lock()

    def choices(self, f: int, g: int, problem: Problem, constraints) -> list[Compressed]:
        """Return the training part of fold ``f``, compressed at the origins worth trying."""
        chosen = self.settings
        origins = origin_choices(
            chosen.origin, problem, self.layout, self.record, constraints, chosen.structure,
            chosen.fit_intercept,
        )  # fmt: skip
        return compress_choices(
            problem, self.layout, origins, lambda at: self._training_factor(f, g, problem.library, at)
        )

    def _training_factor(self, f: int, g: int, library: TermLibrary, layout) -> Compressed:
        """Merge the stretches of a fold, and add the few rows that only this library can use."""
        parts = self._compressed(layout)
        columns = [self.problem.library.index(term) for term in library]
        total = Factor.empty(len(library), len(layout.outputs))
        for s, begin in enumerate(self.edges[:-1]):
            if s in parts and any(run.start <= begin < run.stop for run in self.folds[f].training):
                total = total.merge(parts[s].subset(columns))
        if (f, g) in parts:
            total = total.merge(parts[f, g])
        return Compressed(library, layout, total, len(library))

    def _compressed(self, layout) -> dict:
        """Return, once for each origin, factors by stretch, and of what is left by fold and library."""
        key = layout.origin.tobytes()
        with self._lock:
            if key not in self._parts:
                union = self.problem.library
                self._parts[key] = self.record.total(
                    partial(folds_of_block, union, self.libraries, layout, self.edges, self.folds),
                    merge_parts,
                    reach=reach_of(union, layout),
                    whole=remembers_all(layout),
                )
            return self._parts[key]


def folds_of_block(
    union: TermLibrary,
    libraries: tuple[TermLibrary, ...],
    layout: Layout,
    edges: np.ndarray,
    folds: list[Fold],
    block: Block,
) -> dict:
    """Compress a block: what lies in each stretch, and for each fold and library what that leaves out.

    A sample counts where all that is read at it lies in one training part. In a stretch those are the samples
    from the longest lag on, for all libraries and folds alike; the others are few.
    """
    every = Candidates.in_block(union, layout, block)
    place = every.rows + block.origin
    stretch = np.searchsorted(edges, place, side="right") - 1
    inside = place - edges[stretch] >= reach_of(union, layout)
    found: dict = {}
    with single_threaded_blas():
        for s in np.unique(stretch[inside]):
            rows = every.rows[inside & (stretch == s)]
            found[int(s)] = compress([replace(every, rows=rows)])
        for g, library in enumerate(libraries):
            own = Candidates(library, layout, every.recording, usable_rows(library, layout, every, block))
            others = np.setdiff1d(own.rows, every.rows[inside], assume_unique=True)
            for f, fold in enumerate(folds):
                rows = others[_inside(fold.training, others + block.origin, reach_of(library, layout))]
                if rows.size:
                    found[f, g] = compress([replace(own, rows=rows)])
    return found


def usable_rows(library: TermLibrary, layout: Layout, every: Candidates, block: Block) -> np.ndarray:
    """Return the block's own samples at which a library is known."""
    rows = Candidates.of(library, layout, every.recording).rows
    return rows[rows >= block.n_past]


def _inside(runs: list[slice], places: np.ndarray, reach: int) -> np.ndarray:
    """Tell which places lie in a run, at least ``reach`` after its start."""
    if not runs:
        return np.zeros(places.size, dtype=bool)
    starts, stops = (np.array(side) for side in zip(*((r.start, r.stop) for r in runs), strict=True))
    own = np.searchsorted(starts, places, side="right") - 1
    return (own >= 0) & (places < stops[own]) & (places - starts[own] >= reach)

"""What is kept of a stream of batches: their factors, what is known of their signals, and their end."""

import textwrap
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise

import numpy as np

from narx_sklearn.identification.one_step.factor import Factor
from narx_sklearn.identification.one_step.procedure import Compressed, Problem
from narx_sklearn.identification.one_step.regressors import reach_of, remembers_all
from narx_sklearn.identification.one_step.uncertainty import OneStepScores, n_stretches
from narx_sklearn.identification.records.record import ArrayRecord, Moments, Record
from narx_sklearn.identification.validation.stretches import scores_on_factors, stretch_factors
from narx_sklearn.model.terms import TermLibrary


@dataclass(frozen=True)
class Batches:
    """All that was seen of a stream, at one origin.

    Attributes
    ----------
    compressed : Compressed
        Candidates and the factor of all batches.
    stretches : tuple of Factor
        Factors of consecutive stretches, about equal in samples; merged they are that of all batches.
    lengths : tuple of float
        Samples in each stretch, earlier ones counting what forgetting leaves of them.
    """

    compressed: Compressed
    stretches: tuple[Factor, ...]
    lengths: tuple[float, ...]

    @classmethod
    def begin(cls, compressed: Compressed, record: Record) -> "Batches":
        """Return the first batch."""
        stretches = stretch_factors(compressed.library, compressed.layout, record)
        return cls(compressed, tuple(stretches), tuple(float(f.n_samples) for f in stretches))

    def add(self, record: Record, forgetting: float) -> "Batches":
        """Return what was seen with one more batch, all before it weighed down by ``forgetting``."""
        seen = self.compressed
        new = stretch_factors(seen.library, seen.layout, record, shortest=max(*self.lengths, 1.0))
        lengths = [*(forgetting * n for n in self.lengths), *(float(f.n_samples) for f in new)]
        n_samples = round(sum(lengths))  # of the total: of many short batches rounding would add up
        factor = replace(reduce(Factor.merge, new, seen.factor.scaled(forgetting)), n_samples=n_samples)
        stretches = [*(f.scaled(forgetting) for f in self.stretches), *new]
        _join(stretches, lengths, n_stretches(n_samples))
        return Batches(replace(seen, factor=factor), tuple(stretches), tuple(lengths))

    def scores(self, library: TermLibrary, theta: np.ndarray, output: int) -> OneStepScores:
        """Return the sums over stretches that the covariance of the parameters of some terms is made of."""
        columns = [self.compressed.library.index(term) for term in library]
        stretches = [stretch.subset(columns) for stretch in self.stretches]
        return scores_on_factors(stretches, theta, output, self.compressed.factor.n_samples)


End = tuple[np.ndarray, np.ndarray, np.ndarray | None]  # inputs, outputs and labels


@dataclass(frozen=True)
class Stream:
    """Batches that came one after another.

    Attributes
    ----------
    problem : Problem
        What is identified from each of them.
    moments : Moments
        Of all samples.
    batches : tuple of Batches
        What was seen, at each origin that is tried.
    end : tuple of (ndarray, ndarray, ndarray or None), or None
        What the lags of a next batch of the same session will read.
    """

    problem: Problem
    moments: Moments
    batches: tuple[Batches, ...]
    end: End | None

    @classmethod
    def begin(cls, problem: Problem, choices: list[Compressed], record: Record) -> "Stream":
        """Return a stream of one batch, compressed at the origins that are tried."""
        batches = tuple(Batches.begin(compressed, record) for compressed in choices)
        return cls(problem, record.moments, batches, _end_of(record, batches))

    def add(self, problem: Problem, record: Record, forgetting: float) -> "Stream":
        """Return the stream with one more batch, all before it weighed down by ``forgetting``.

        Raises
        ------
        ValueError
            If the batch does not go on with those before it.
        """
        _check_same(self.problem, problem)
        moments = self.moments.merge(record.moments)
        record = self._continued(record)
        batches = tuple(before.add(record, forgetting) for before in self.batches)
        return Stream(problem, moments, batches, _end_of(record, batches))

    def _continued(self, record: Record) -> Record:
        """Return a batch with the end of the batch before in front, where it goes on with that session."""
        if not isinstance(record, ArrayRecord) or record.sessions is None or self.end is None:
            return record
        X, y, labels = self.end
        if labels is None or labels[-1] != record.sessions[0]:
            return record
        if remembers_all(self.batches[0].compressed.layout):
            raise ValueError(
                "phi regressors that remember all of the past cannot be computed batch by batch of one "
                "session; give every batch a label of its own in sessions, or call fit."
            )
        return record.after(X, y, labels)


def _end_of(record: Record, batches: tuple[Batches, ...]) -> End | None:
    reach = max(reach_of(b.compressed.library, b.compressed.layout) for b in batches)
    return record.end(reach) if isinstance(record, ArrayRecord) and reach else None


def _check_same(before: Problem, now: Problem) -> None:
    """Refuse a batch with other signals or candidates than the batches before it."""
    for what, was, came in (
        ("outputs", before.outputs, now.outputs),
        ("inputs", before.inputs, now.inputs),
        ("phi", before.phi, now.phi),
        ("candidate terms", before.library, now.library),
    ):
        if was != came:
            new, old = (textwrap.shorten(str(side), 60, placeholder=" ...") for side in (came, was))
            raise ValueError(
                f"This batch has other {what} than the batches before it: {new} instead of {old}. "
                "Name its columns alike and keep the parameters that say what is a candidate, or call "
                "fit, which forgets the batches."
            )


def _join(stretches: list[Factor], lengths: list[float], count: int) -> None:
    """Merge neighbours, those first that are shortest together, until ``count`` are left; in place."""
    while len(stretches) > count:
        together = [one + other for one, other in pairwise(lengths)]
        i = together.index(min(together))
        stretches[i : i + 2] = [stretches[i].merge(stretches[i + 1])]
        lengths[i : i + 2] = [together[i]]

"""What is kept of a stream of batches: their factor, and those of a few long stretches for the intervals."""

from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise

import numpy as np

from narx_sklearn.identification.factor import Factor
from narx_sklearn.identification.procedure import Compressed, scores_on_factors, stretch_factors
from narx_sklearn.identification.record import Record
from narx_sklearn.identification.uncertainty import OneStepScores, n_stretches
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


def _join(stretches: list[Factor], lengths: list[float], count: int) -> None:
    """Merge neighbours, those first that are shortest together, until ``count`` are left; in place."""
    while len(stretches) > count:
        together = [one + other for one, other in pairwise(lengths)]
        i = together.index(min(together))
        stretches[i : i + 2] = [stretches[i].merge(stretches[i + 1])]
        lengths[i : i + 2] = [together[i]]

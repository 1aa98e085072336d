"""The whole grid by least squares, on factors that all come from one pass over the record."""

from collections.abc import Callable

import numpy as np
from joblib import Parallel, delayed

from narx_sklearn.identification.cross_validation.folds import Fold, FoldedRecord, parted
from narx_sklearn.identification.free_run.scoring import FreeRunJudge
from narx_sklearn.identification.one_step.procedure import (
    Compressed,
    Problem,
    Selected,
    build_model,
    estimate_terms,
    scaled_constraints,
    total_criterion,
)
from narx_sklearn.identification.one_step.selection import search_terms
from narx_sklearn.identification.records.record import Record
from narx_sklearn.identification.structure.constraints import LinearConstraints
from narx_sklearn.metrics import DIVERGED_SCORE

__all__ = ["Screening", "scatter_of"]


def scatter_of(record: Record, folds: list[Fold]) -> np.ndarray:
    """Return what the outputs do in each test part, as sums of squares of shape (n_folds, n_outputs)."""
    outputs = (record.take(fold.test)[1] for fold in folds)
    return np.stack([np.nan_to_num(y.shape[0] * np.nanvar(y, axis=0)) for y in outputs])


class Screening:
    """Structures and sizes, to be judged by least squares and free run on any fold.

    Parameters
    ----------
    problems : list of Problem
        The structures.
    constraints : list of list of LinearConstraints
        Those of each structure's outputs.
    sizes : list of dict
        Ways of choosing the number of terms: ``n_terms`` or ``criterion``.
    record : Record
        The record.
    folds : list of Fold
        The folds.
    settings : NARXRegressorCV
        What the choices have in common.
    """

    def __init__(
        self,
        problems: list[Problem],
        constraints: list[list[LinearConstraints]],
        sizes: list[dict],
        record: Record,
        folds: list[Fold],
        settings,
    ):
        self.problems, self.constraints, self.sizes, self.settings = problems, constraints, sizes, settings
        self.folded = FoldedRecord(problems, record, folds, settings)
        self.longest = max(settings.max_terms, *(size.get("n_terms", 0) for size in sizes))

    def judge(self, f: int, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return scores and numbers of terms on one fold, where a mask (n_structures, n_sizes) wants them."""
        test = self.folded.folds[f].test
        X, y, labels = self.folded.record.take(test)
        on_test: Callable = FreeRunJudge(X, y, sessions=parted(labels, test)).score
        scores = np.full(wanted.shape, np.nan)
        counts = scores.copy()
        asked = np.flatnonzero(wanted.any(axis=1))
        found = Parallel(n_jobs=self.settings.n_jobs, prefer="threads")(
            delayed(self._judge_structure)(on_test, f, g, wanted[g]) for g in asked
        )
        for g, (score, count) in zip(asked, found, strict=True):
            scores[g], counts[g] = score, count
        return scores, counts

    def _judge_structure(self, on_test: Callable, f: int, g: int, wanted: np.ndarray):
        problem, bound = self.problems[g], self.constraints[g]
        choices = self.folded.choices(f, g, problem, bound)
        paths = [
            [
                search_terms(
                    c.factor, self.longest, search=self.settings.search, output=i,
                    constraints=scaled_constraints(c, i, bound[i]),
                )
                for i in range(len(problem.outputs))
            ]
            for c in choices
        ]  # fmt: skip
        scores = np.full(len(self.sizes), DIVERGED_SCORE)
        counts = np.zeros(len(self.sizes))
        judged: dict = {}
        for s in np.flatnonzero(wanted):
            size = self.sizes[s]
            selected = _select_size(choices, paths, bound, size, self.settings.max_terms)
            if selected is None:  # the score of a divergence stays
                counts[s] = size.get("n_terms", 0)
                continue
            model = build_model(selected, problem)
            key = (model.library, tuple(model.origin))
            if key not in judged:
                judged[key] = on_test(model)
            scores[s], counts[s] = judged[key], model.n_terms
        return scores, counts


def _select_size(
    choices: list[Compressed], paths, bound: list[LinearConstraints], size: dict, max_terms: int
) -> list[Selected] | None:
    """Return the terms of every output for one way of choosing their number, at the better origin.

    A criterion chooses up to ``max_terms``; a number that is given may be larger. None where constraints rule
    it out.
    """
    criterion = size.get("criterion", "ebic")
    found = []
    for compressed, own in zip(choices, paths, strict=True):
        n = size.get("n_terms")
        counts = [
            min(n, len(path.supports) - 1) if n else path.up_to(max_terms).best_size(criterion)
            for path in own
        ]
        if not all(np.isfinite(path.rss[count]) for path, count in zip(own, counts, strict=True)):
            continue
        found.append(
            [
                estimate_terms(compressed, i, path, count, criterion, bound[i] if len(bound[i]) else None)
                for i, (path, count) in enumerate(zip(own, counts, strict=True))
            ]
        )
    return min(found, key=lambda selected: total_criterion(selected, criterion)) if found else None

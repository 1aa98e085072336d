"""A grid of structures and sizes judged by models of least squares, on small triangular factors."""

from contextlib import contextmanager

import numpy as np

from narx_sklearn.identification.cross_validation.folds import Fold, FoldedRecord, parted
from narx_sklearn.identification.cross_validation.judged import Judged, fold_weights
from narx_sklearn.identification.cross_validation.race import race
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

__all__ = ["screen"]


def screen(
    record: Record,
    folds: list[Fold],
    structures: list[dict],
    sizes: list[dict],
    problems: list[Problem],
    constraints: list[list[LinearConstraints]],
    settings,
    *,
    kept: int,
    slack: float,
) -> Judged:
    """Return the scores of every structure with every size, the sizes of each one after another.

    Parameters
    ----------
    structures : list of dict
        Lags, delay and degree.
    sizes : list of dict
        ``n_terms`` or ``criterion``.
    problems : list of Problem
        What each structure is to be fitted to.
    constraints : list of list of LinearConstraints
        Of each structure, on each output.
    settings : NARXRegressorCV
        Its ``search``, ``max_terms``, ``n_jobs`` and what all regressors have in common.
    kept : int
        How many structures must be judged on all folds; see `race`.
    slack : float
        How far behind the last of these another may fall and go on.
    """
    folded = FoldedRecord(problems, record, folds, settings)
    longest = max(settings.max_terms, *(size.get("n_terms", 0) for size in sizes))

    @contextmanager
    def opened(f: int):
        X, y, labels = record.take(folds[f].test)
        judge = FreeRunJudge(X, y, sessions=parted(labels, folds[f].test))

        def judged(g: int, asked: np.ndarray) -> tuple[list[float], list[int]]:
            problem, bound = problems[g], constraints[g]
            choices = folded.choices(f, g, problem, bound)
            paths = [
                [
                    search_terms(
                        c.factor, longest, search=settings.search, output=i,
                        constraints=scaled_constraints(c, i, bound[i]),
                    )
                    for i in range(len(problem.outputs))
                ]
                for c in choices
            ]  # fmt: skip
            scores, counts, known = [], [], {}
            for size in (sizes[s] for s in np.flatnonzero(asked)):
                selected = _select_size(choices, paths, bound, size, settings.max_terms)
                if selected is None:
                    scores.append(DIVERGED_SCORE)
                    counts.append(size.get("n_terms", 0))
                    continue
                model = build_model(selected, problem)
                key = model.library, tuple(model.origin)
                if key not in known:
                    known[key] = judge.score(model)
                scores.append(known[key])
                counts.append(model.n_terms)
            return scores, counts

        yield judged

    weights = fold_weights(np.array([_scatter(record, fold) for fold in folds]))
    shape = len(structures), len(sizes)
    scores, counts = race(opened, weights, shape, kept=kept, slack=slack, n_jobs=settings.n_jobs)
    grid = [structure | size for structure in structures for size in sizes]
    flat = len(grid), len(folds)
    return Judged(grid, scores.reshape(flat), counts.reshape(flat), weights)


def _scatter(record: Record, fold: Fold) -> np.ndarray:
    """Return what the outputs of a test part do, as sums of squares (n_outputs,)."""
    _, y, _ = record.take(fold.test)
    return np.nan_to_num(y.shape[0] * np.nanvar(y, axis=0))


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

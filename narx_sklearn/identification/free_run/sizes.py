"""How many terms a model gets where its free run chooses, and what is told where something bound them."""

import warnings

import numpy as np

from narx_sklearn.exceptions import ExcitationWarning, NarxWarning
from narx_sklearn.identification.free_run.refinement import refine_free_run
from narx_sklearn.identification.free_run.simulation_search import FreeRunData
from narx_sklearn.identification.one_step.criteria import information_criterion
from narx_sklearn.identification.one_step.procedure import (
    Problem,
    Selected,
    build_model,
    estimate_terms,
)
from narx_sklearn.identification.one_step.selection import criterion_minima, size_window
from narx_sklearn.identification.settings import longest_size, ridge_penalty
from narx_sklearn.identification.structure.constraints import LinearConstraints, on_screened
from narx_sklearn.model.narx import NARXModel


def size_by_free_run(
    settings, problem: Problem, constraints: list[LinearConstraints], selected: list[Selected],
    samples: FreeRunData,
) -> list[Selected]:  # fmt: skip
    """Take, of the sizes round the criterion's first minima, the one with the best free run."""
    chosen = list(selected)
    for output, one in enumerate(selected):
        values = one.path.criterion(settings.criterion)
        minima = criterion_minima(values[: one.path.longest_comparable + 1])
        window = size_window(minima, one.path.longest_comparable)
        best = np.inf
        for size in window:
            if not np.isfinite(one.path.rss[size]):  # constraints ask for more terms
                continue
            trial = estimate_terms(
                one.compressed,
                output,
                one.path,
                size,
                settings.criterion,
                on_screened(constraints[output], problem.library, one.compressed.library),
                ridge_penalty(settings),
            )
            model = build_model([*chosen[:output], trial, *chosen[output + 1 :]], problem)
            fit = refine_free_run(model, samples.X, samples.y, sessions=samples.sessions, max_iter=0)
            if not np.isfinite(fit.loss):
                continue
            value = information_criterion(
                settings.criterion, fit.loss, fit.n_samples, model.n_terms, one.compressed.n_considered
            )
            if value < best:
                best, chosen[output] = float(value), trial
    return chosen


def warn_if_short(settings, selected: list[Selected], model: NARXModel) -> None:
    """Warn where a model has as many terms as its record allows to compare, or more."""
    n_terms, longest = settings.n_terms, longest_size(settings.max_terms)
    counts = np.count_nonzero(model.parameters, axis=0)
    for output, one, count in zip(model.outputs, selected, counts, strict=True):
        path = one.path
        most = path.n_samples // 2
        wished = count if n_terms is not None else min(longest, path.n_considered or path.n_candidates)
        if count < most or wished <= most:
            continue
        warnings.warn(
            f"The model of {output} has {count} term{'s' if count > 1 else ''} from {path.n_samples} usable "
            "samples: the record is too short to tell what belongs to it, and beyond the record it may go "
            f"anywhere. Pass a longer record ({2 * wished} usable samples compare all sizes up to {wished}), "
            "or ask for less: fewer lags, a lower degree, n_terms.",
            ExcitationWarning,
            stacklevel=4,
        )


def warn_if_bound(settings, selected: list[Selected], model: NARXModel) -> None:
    """Warn where a limit that somebody set, and not the criterion, says how many terms a model has."""
    n_terms, max_terms = settings.n_terms, settings.max_terms
    counts = np.count_nonzero(model.parameters, axis=0)
    for output, one, count in zip(model.outputs, selected, counts, strict=True):
        path = one.path
        candidates, longest = path.n_considered or path.n_candidates, len(path.supports) - 1
        told = ""
        if n_terms is not None and longest < n_terms:
            less = f"{longest} of {candidates} candidates can be told apart in this record"
            told = (
                f"n_terms={n_terms} for {output}, but "
                f"{less if longest < candidates else f'there are {candidates} candidates'}; the model has "
                f"{count}. Pass more lags or a higher degree, or n_terms={longest} to agree."
            )
        elif n_terms is not None or max_terms is None:
            continue
        elif count >= max_terms and min(candidates, path.n_samples // 2) > max_terms:
            told = (
                f"max_terms={max_terms} bound the size of the model of {output}: of all sizes tried "
                "the largest is the best. Pass a larger max_terms, or n_terms to say how many are wanted."
            )
        if told:
            warnings.warn(told, NarxWarning, stacklevel=4)

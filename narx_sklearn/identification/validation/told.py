"""What is told of a fitted model beside its equations: error reduction ratios, noise, how sure it is."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from narx_sklearn.identification.free_run.refinement import free_run_uncertainty
from narx_sklearn.identification.free_run.simulation_search import FreeRunData
from narx_sklearn.identification.one_step.procedure import Selected, parameter_scales
from narx_sklearn.identification.one_step.regressors import candidates_of
from narx_sklearn.identification.one_step.selection import err_order
from narx_sklearn.identification.one_step.uncertainty import (
    OneStepScores,
    ParameterUncertainty,
    one_step_scores,
    parameter_uncertainty,
)
from narx_sklearn.identification.records.record import ArrayRecord, Record
from narx_sklearn.identification.structure.constraints import LinearConstraints, on_library
from narx_sklearn.identification.validation.stretches import scores_on_factors, stretch_factors
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.recording import Layout
from narx_sklearn.model.terms import TermLibrary

ScoresOf = Callable[[TermLibrary, np.ndarray, int], OneStepScores]  # of terms, scaled parameters, output


def error_reduction(model: NARXModel, selected: list[Selected]) -> np.ndarray:
    """Return the error reduction ratio (2.42) of each term for each output, (n_terms, n_outputs)."""
    err = np.zeros(model.parameters.shape)
    for i, one in enumerate(selected):
        kept = [t for t, value in zip(model.library, model.parameters[:, i], strict=True) if value]
        columns = [one.compressed.library.index(term) for term in kept]
        order, ratios = err_order(one.compressed.factor, columns, output=i)
        for column, ratio in zip(order, ratios, strict=True):
            err[model.library.index(one.compressed.library[column]), i] = ratio
    return err


def scores_on_record(record: Record, layout: Layout) -> ScoresOf:
    """Return what sums scores of an estimate over stretches: sample by sample, or where the samples are."""

    def scores_of(library: TermLibrary, theta: np.ndarray, output: int) -> OneStepScores:
        if isinstance(record, ArrayRecord):
            return one_step_scores(partial(candidates_of, library, layout, record), theta, output)
        stretches = stretch_factors(library, layout, record)
        return scores_on_factors(stretches, theta, output, sum(f.n_samples for f in stretches))

    return scores_of


def uncertainty_of(
    model: NARXModel,
    layout: Layout,
    constraints: list[LinearConstraints],
    library: TermLibrary,
    scores_of: ScoresOf,
    simulated: FreeRunData | None = None,
) -> tuple[np.ndarray, list[ParameterUncertainty]]:
    """Return the deviation of each output's one-step residuals, and the covariance of its parameters.

    Parameters
    ----------
    model : NARXModel
    layout : Layout
        In whose scaled signals scores are counted.
    constraints : list of LinearConstraints
        Of each output, on the parameters of ``library``.
    library : TermLibrary
        All candidate terms.
    scores_of : callable
        Takes terms, their scaled parameters and the output's number.
    simulated : FreeRunData, optional
        The record, where the parameters were fitted to its free run, whose residuals are then the errors.
    """
    found, sigma = [], []
    for output in range(len(model.outputs)):
        present = model.parameters[:, output] != 0.0
        kept = model.library.subset(np.flatnonzero(present))
        inside = on_library(constraints[output], library, kept)
        scales = parameter_scales(layout, kept, output)
        scores = scores_of(kept, model.parameters[present, output] / scales, output)
        sigma.append(layout.scale[output] * scores.residual_deviation)
        if simulated is not None and len(model.outputs) == 1:
            X, y, sessions = simulated
            found.append(free_run_uncertainty(model, X, y, sessions=sessions, constraints=inside))
            continue
        scaled = None if inside is None else inside.scaled(scales)
        robust = parameter_uncertainty(scores.gram, scores.sums, scaled, grams=scores.grams)
        found.append(replace(robust, covariance=robust.covariance * np.outer(scales, scales)))
    return np.array(sigma), found


def parameter_intervals(
    model: NARXModel, uncertainty: list[ParameterUncertainty], level: float
) -> np.ndarray:
    """Return the ends of confidence intervals, (n_terms, n_outputs, 2), NaN where an output lacks a term."""
    bounds = np.full((*model.parameters.shape, 2), np.nan)
    for output, known in enumerate(uncertainty):
        rows = np.flatnonzero(model.parameters[:, output])
        bounds[rows, output] = known.intervals(model.parameters[rows, output], level)
    return bounds


def summary_table(model: NARXModel, bounds: np.ndarray, err: np.ndarray) -> pd.DataFrame:
    """Return a row for each term of each output, those with the largest error reduction ratio first."""
    rows = []
    for i, output in enumerate(model.outputs):
        for t in np.flatnonzero(model.parameters[:, i]):
            rows.append((output, model.library.names[t], model.parameters[t, i], *bounds[t, i], err[t, i]))
    columns = ["output", "term", "parameter", "low", "high", "err"]
    return pd.DataFrame(rows, columns=columns).sort_values(
        ["output", "err"], ascending=[True, False], ignore_index=True
    )

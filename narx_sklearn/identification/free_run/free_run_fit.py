"""Whether a model is kept as least squares has it, or is fitted to its free run: where the noise is."""

import warnings
from functools import partial
from typing import NamedTuple

import numpy as np

from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.identification.free_run.lost import is_lost
from narx_sklearn.identification.free_run.refinement import FreeRunFit, refine_free_run
from narx_sklearn.identification.free_run.simulation_search import FreeRunData, select_on_simulation
from narx_sklearn.identification.free_run.whiteness import is_white
from narx_sklearn.identification.one_step.criteria import information_criterion
from narx_sklearn.identification.one_step.procedure import Problem, Selected
from narx_sklearn.identification.records.record import Record
from narx_sklearn.identification.settings import longest_size, refine_mode, wants_free_run_size
from narx_sklearn.identification.structure.constraints import LinearConstraints, on_library, on_screened
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.simulation import predict_one_step
from narx_sklearn.model.terms import TermLibrary

GATHERED_SAMPLES = (
    2_000_000  # of files or a cluster, gathered unasked for the free-run refinement: minutes of it
)
AS_GOOD = 3  # times the one-step error up to which a model is another view of a record, not another plant
SEARCHED_COST = 2e11  # operations up to which the search on the simulation error uses all candidates


class Refined(NamedTuple):
    """The model that is kept, how its refinement went, and where the noise was taken to be."""

    model: NARXModel
    fit: FreeRunFit | None = None
    noise: str = "equation"


def reads_all_samples(settings, record: Record) -> bool:
    """Tell whether steps after the compression want every sample of a record at once."""
    mode = refine_mode(settings.refine)
    if record.in_memory or wants_free_run_size(settings):
        return True
    if settings.estimator in ("els", "rls") or mode == "always":
        return True
    if mode == "never" or record.n_outputs > 1 or settings.estimator != "ls":
        return False
    if record.n_samples > GATHERED_SAMPLES:
        warnings.warn(
            f"refine='auto' is left out: it simulates the whole record in this process, and n_samples = "
            f"{record.n_samples} are more than the {GATHERED_SAMPLES} that are gathered unasked. Pass "
            "refine=False to agree, or refine=True to gather and refine.",
            NarxWarning,
            stacklevel=4,
        )
        return False
    return True


def refine(
    settings, problem: Problem, constraints: list[LinearConstraints], selected: list[Selected],
    model: NARXModel, samples: FreeRunData,
) -> Refined:  # fmt: skip
    """Fit, or search, by the free run, as far as ``refine`` asks for it."""
    mode = refine_mode(settings.refine)
    if mode == "never":
        return Refined(model)
    inside = _on_model(model, problem.library, constraints)
    over_horizons = partial(_fitted, model, samples, inside, horizons=_horizons(model))
    if mode == "always":
        fit = over_horizons()
        return Refined(fit.model, fit, "output")
    if settings.estimator != "ls":
        return Refined(model)
    if len(selected) > 1:  # nothing is searched, but a run that is lost is brought back
        if not is_lost(model, *samples):
            return Refined(model)
        fit = over_horizons()
        return Refined(fit.model, fit, "mixed" if np.isfinite(fit.loss) else "equation")
    (one,), (of_output,) = selected, constraints
    if settings.n_terms is not None or any(p.signals & set(model.outputs) for p in model.phi):
        # the terms stay: their number is given, or the search cannot differentiate a phi of an output
        fit = _fitted(model, samples, inside)
        if not np.isfinite(fit.loss):
            fit = over_horizons()
    else:
        fit = _searched(settings, problem.library, of_output, one, model, samples)
    return _kept(settings, one, model, fit, samples)


def _fitted(model: NARXModel, samples: FreeRunData, inside, **options) -> FreeRunFit:
    return refine_free_run(
        model, samples.X, samples.y, sessions=samples.sessions, constraints=inside, **options
    )


def _searched(
    settings, library: TermLibrary, constraints: LinearConstraints, one: Selected, model: NARXModel,
    samples: FreeRunData,
) -> FreeRunFit:  # fmt: skip
    """Search the terms by their effect on the free run, among those on the path where all are too many."""
    searched = one.compressed.library
    if samples.X.shape[0] * len(searched) ** 2 > SEARCHED_COST:
        searched = searched.subset(sorted({j for s in one.path.supports for j in s}))
    return select_on_simulation(
        model,
        searched,
        samples,
        criterion=settings.criterion,
        n_terms=longest_size(settings.max_terms),
        constraints=on_screened(constraints, library, searched),
        horizons=_horizons(model),
    ).fit


def _kept(settings, one: Selected, model: NARXModel, fit: FreeRunFit, samples: FreeRunData) -> Refined:
    """Return the model of least squares, or that of the free run where the first is not to be believed."""
    if not np.isfinite(fit.loss):
        return Refined(model, fit)
    n_considered, n_samples = one.compressed.n_considered, fit.n_samples
    power = one.rss * one.compressed.layout.scale[0] ** 2 * n_samples / one.path.n_samples
    on_output = information_criterion(
        settings.criterion, fit.loss, n_samples, fit.model.n_terms, n_considered
    )
    in_equation = information_criterion(settings.criterion, power, n_samples, len(one.support), n_considered)
    if on_output < in_equation:
        return Refined(fit.model, fit, "output")
    X, y, sessions = samples
    residuals = (y - predict_one_step(model, X, y, sessions=sessions))[:, 0]
    if not is_white(residuals, sessions):
        return Refined(fit.model, fit, "mixed")
    if is_lost(model, X, y, sessions):
        # that of an unstable plant under feedback is lost by right; what is bounded errs much more there
        refined = (y - predict_one_step(fit.model, X, y, sessions=sessions))[:, 0]
        if np.nansum(refined**2) <= AS_GOOD**2 * np.nansum(residuals**2):
            return Refined(fit.model, fit, "mixed")
    return Refined(model)


def _horizons(model: NARXModel) -> tuple[int | None, ...]:
    return (10 * max(model.max_lag, 1), 100 * max(model.max_lag, 1), None)


def _on_model(
    model: NARXModel, library: TermLibrary, constraints: list[LinearConstraints]
) -> LinearConstraints | None:
    """Return constraints on all candidates as those on a model's nonzero parameters, output after output."""
    if not any(len(c) for c in constraints):
        return None
    rows, sides, width = [], [], int(np.count_nonzero(model.parameters))
    begin = 0
    for output, c in enumerate(constraints):
        kept = [t for t, value in zip(model.library, model.parameters[:, output], strict=True) if value]
        part = on_library(c, library, TermLibrary(kept))
        if part is not None:
            S = np.zeros((len(part), width))
            S[:, begin : begin + len(kept)] = part.S
            rows.append(S)
            sides.append(part.c)
        begin += len(kept)
    return LinearConstraints(np.vstack(rows), np.concatenate(sides))

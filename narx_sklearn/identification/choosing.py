"""Which terms a model gets, and which estimates: what a regressor's parameters make of a record."""

from dataclasses import replace

from narx_sklearn.identification.free_run.simulation_search import FreeRunData
from narx_sklearn.identification.one_step.compression import compress_record
from narx_sklearn.identification.one_step.estimation import recursive_least_squares
from narx_sklearn.identification.one_step.extended import extended_least_squares
from narx_sklearn.identification.one_step.procedure import (
    Compressed,
    Problem,
    Selected,
    compress_choices,
    origin_choices,
    scaled_constraints,
    scaled_layout,
    select_terms,
    total_criterion,
)
from narx_sklearn.identification.one_step.regressors import Candidates
from narx_sklearn.identification.records.record import Record
from narx_sklearn.identification.settings import longest_size, ridge_penalty
from narx_sklearn.identification.structure.constraints import LinearConstraints, on_screened
from narx_sklearn.model.recording import lay_out


def compress_at_origins(
    settings, problem: Problem, constraints: list[LinearConstraints], record: Record
) -> list[Compressed]:
    """Compress a record in the coordinates worth trying: one or two origins."""
    layout = scaled_layout(problem, record)
    origins = origin_choices(
        settings.origin, problem, layout, record, constraints, settings.structure, settings.fit_intercept
    )
    longest = max(longest_size(settings.max_terms), settings.n_terms or 0)
    return compress_choices(
        problem, layout, origins,
        lambda at: compress_record(
            problem.library, at, record, max_terms=longest, constraints=constraints,
            search=settings.search, checkpoint=settings.checkpoint,
        ),
    )  # fmt: skip


def select_best(
    settings, problem: Problem, constraints: list[LinearConstraints], choices: list[Compressed]
) -> list[Selected]:
    """Select the terms of every output, in the coordinates where they serve best."""

    def select(compressed: Compressed, output: int) -> Selected:
        return select_terms(
            compressed,
            output,
            search=settings.search,
            criterion=settings.criterion,
            n_terms=settings.n_terms,
            max_terms=longest_size(settings.max_terms),
            constraints=on_screened(constraints[output], problem.library, compressed.library),
            alpha=ridge_penalty(settings),
        )

    found = ([select(compressed, output) for output in range(len(constraints))] for compressed in choices)
    return min(found, key=lambda selected: total_criterion(selected, settings.criterion))


def estimate_again(
    settings, problem: Problem, constraints: list[LinearConstraints], selected: list[Selected],
    samples: FreeRunData,
) -> list[Selected]:  # fmt: skip
    """Return extended or recursive estimates of the terms that least squares chose."""
    found = []
    for output, one in enumerate(selected):
        layout = one.compressed.layout
        candidates = Candidates.of(one.library, layout, lay_out(layout, *samples))
        given = on_screened(constraints[output], problem.library, one.compressed.library)
        scaled = scaled_constraints(one.compressed, output, given)
        inside = (scaled or LinearConstraints.none(len(one.compressed.library))).restrict(one.support)
        if settings.estimator == "els":
            theta = extended_least_squares(candidates, output, one.theta, settings.noise_lags, inside)
        else:
            fixed, free = inside.solution_space()
            Psi = candidates.matrix()
            estimate = recursive_least_squares(
                Psi @ free,
                candidates.targets[:, output] - Psi @ fixed,
                forgetting=settings.forgetting,
                theta=free.T @ (one.theta - fixed),
            )
            theta = fixed + free @ estimate.theta
        found.append(replace(one, theta=theta))
    return found

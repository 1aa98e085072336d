"""Laws without a name: which product of two states, storage that changes or memory tells most."""

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit
from narx_sklearn.discrepancy.search.bank import make_bank
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.detect import NONE_SILENT
from narx_sklearn.discrepancy.search.explain import refit_leaders
from narx_sklearn.discrepancy.search.generic import product_hypotheses
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis, enumerate_hypotheses
from narx_sklearn.discrepancy.search.memories import MEMORIES
from narx_sklearn.discrepancy.search.ranking import leaders
from narx_sklearn.discrepancy.search.storage import storage_hypotheses
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.stages.plain import counted_from_zero

TRIED = 3  # laws of which the tangents tell most, that are fitted


def best_product(
    problem: Problem, refitted: Fit, beside: Fit, structure: Structure, n_jobs: int | None = None
) -> Candidate | None:
    """Return the single force that goes best as a product of two states; None where there are no two.

    It is fitted from the refit, and from the parameters that go with what stands ``beside`` it.
    """
    x = _seen(problem, refitted)
    return _best(problem, refitted, beside, product_hypotheses(problem.simulator, structure, x), n_jobs)


def best_storage(
    problem: Problem, refitted: Fit, beside: Fit, structure: Structure, n_jobs: int | None = None
) -> Candidate | None:
    """Return the single storage that best changes with a signal; None where nothing moves.

    It is fitted as the products are.
    """
    x = _seen(problem, refitted)
    return _best(problem, refitted, beside, storage_hypotheses(problem.simulator, structure, x), n_jobs)


def best_memory(
    problem: Problem, refitted: Fit, beside: Fit, structure: Structure, n_jobs: int | None = None
) -> Candidate | None:
    """Return the single law of an input or output that best remembers what went before; None where none does.

    It is fitted as the products are, but all of them at first: how well the tangents tell what has a memory
    depends on how near to it they begin.
    """
    run = problem.run(refitted.model)
    hypotheses = enumerate_hypotheses(MEMORIES, problem, refitted.model, run, structure, n_jobs=n_jobs)
    return _best(problem, refitted, beside, hypotheses, n_jobs, tried=len(hypotheses))


def _seen(problem: Problem, refitted: Fit) -> np.ndarray:
    """Return the states of a run where it was measured, (n_samples, n_states)."""
    return problem.run(refitted.model).x[problem.rows[problem.inside]]


def _best(
    problem: Problem,
    refitted: Fit,
    beside: Fit,
    hypotheses: list[Hypothesis],
    n_jobs: int | None,
    tried: int = TRIED,
) -> Candidate | None:
    """Return the best law, fitted, of those of which the tangents tell most."""
    if not hypotheses:
        return None
    bank = make_bank(problem, refitted, hypotheses, n_jobs)
    placed = leaders(bank, tried, NONE_SILENT, 1.0)
    found = refit_leaders(problem, refitted, placed, n_jobs, finished=1, twins=0, elsewhere=[beside])
    return counted_from_zero(problem, found[0]) if found else None

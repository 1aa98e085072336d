"""Laws without a name: which product, storage that changes, force near one place or memory tells most."""

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit
from narx_sklearn.discrepancy.search.bank import make_bank
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.detect import NONE_SILENT
from narx_sklearn.discrepancy.search.explain import refit_leaders
from narx_sklearn.discrepancy.search.generic import product_hypotheses
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis, enumerate_hypotheses
from narx_sklearn.discrepancy.search.memories import MEMORIES
from narx_sklearn.discrepancy.search.one_place import place_hypotheses
from narx_sklearn.discrepancy.search.ranking import leaders
from narx_sklearn.discrepancy.search.storage import storage_hypotheses
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.stages.plain import counted_from_zero

TRIED = 3  # laws of which the tangents tell most, that are fitted


def best_laws(
    problem: Problem, refitted: Fit, beside: Fit, structure: Structure, n_jobs: int | None = None
) -> list[Candidate]:
    """Return the best law of each kind; none of a kind of which nothing moves.

    They are fitted from the refit, and from the parameters that go with what stands ``beside`` it. Those with
    a memory are all fitted at first: how well the tangents tell one depends on how near to it they begin.
    """
    simulator, run = problem.simulator, problem.run(refitted.model)
    x = run.x[problem.rows[problem.inside]]
    kinds = (
        product_hypotheses(simulator, structure, x),
        storage_hypotheses(simulator, structure, x),
        place_hypotheses(simulator, structure, x),
    )
    memories = enumerate_hypotheses(MEMORIES, problem, run, structure, n_jobs=n_jobs)
    tried = [(hypotheses, TRIED) for hypotheses in kinds] + [(memories, len(memories))]
    found = [_best(problem, refitted, beside, hypotheses, n, n_jobs) for hypotheses, n in tried if hypotheses]
    return [law for law in found if law is not None]


def _best(
    problem: Problem,
    refitted: Fit,
    beside: Fit,
    hypotheses: list[Hypothesis],
    tried: int,
    n_jobs: int | None,
) -> Candidate | None:
    """Return the best law, fitted, of those of which the tangents tell most."""
    bank = make_bank(problem, refitted, hypotheses, n_jobs)
    placed = leaders(bank, tried, NONE_SILENT, 1.0)
    found = refit_leaders(problem, refitted, placed, n_jobs, finished=1, twins=0, elsewhere=[beside])
    return counted_from_zero(problem, found[0]) if found else None

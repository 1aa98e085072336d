"""Laws without a name: which product, storage, ripple, radiation, memory, switch or reading tells most."""

from itertools import chain

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.bank import make_bank
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.detect import NONE_SILENT
from narx_sklearn.discrepancy.search.explain import in_reach, refit_leaders
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis, enumerate_hypotheses
from narx_sklearn.discrepancy.search.places import odd_if_coupled
from narx_sklearn.discrepancy.search.ranking import leaders
from narx_sklearn.discrepancy.search.unnamed.by_rate import placed_by_rate
from narx_sklearn.discrepancy.search.unnamed.memories import COEFFICIENTS, MEMORIES
from narx_sklearn.discrepancy.search.unnamed.one_place import place_hypotheses, step_hypotheses
from narx_sklearn.discrepancy.search.unnamed.products import product_hypotheses
from narx_sklearn.discrepancy.search.unnamed.radiation import radiation_hypotheses
from narx_sklearn.discrepancy.search.unnamed.ripples import reading_hypotheses, ripple_hypotheses
from narx_sklearn.discrepancy.search.unnamed.storage import storage_hypotheses
from narx_sklearn.discrepancy.search.unnamed.switches import SWITCHES
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.stages.plain import counted_from_zero, without_spare

TRIED = 3  # laws of which the tangents tell most, that are fitted


def best_laws(
    problem: Problem,
    refitted: Fit,
    beside: Fit,
    structure: Structure,
    n_jobs: int | None = None,
    named: Candidate | None = None,
) -> list[Candidate]:
    """Return the best law of each kind, and its best at each other port; none of a kind that nothing moves.

    They are fitted from the refit, and from the parameters that go with what stands ``beside`` it, and to the
    end where they come near what is ``named``. Those with a memory, and those that switch or step, are all
    fitted at first: how well the tangents tell one depends on how near to it they begin.
    """
    simulator, run = problem.simulator, problem.run(refitted.model)
    rows = problem.rows[problem.inside]
    x = run.x[rows]
    kinds = (
        product_hypotheses(simulator, structure, x),
        storage_hypotheses(simulator, structure, x),
        place_hypotheses(simulator, structure, x),
        ripple_hypotheses(simulator, structure, x),
        reading_hypotheses(simulator, run.y[rows]),
        radiation_hypotheses(simulator, structure, problem.u[rows], x),
    )
    coefficients = enumerate_hypotheses(COEFFICIENTS, problem, run, structure, n_jobs=n_jobs)
    once = {h.placed.place: h for h in coefficients}  # a state without one is its own position too
    tried = [(hypotheses, TRIED) for hypotheses in (*kinds, list(once.values()))]
    unsure = [
        enumerate_hypotheses(effects, problem, run, structure, n_jobs=n_jobs)
        for effects in (MEMORIES, SWITCHES)
    ]
    unsure.append(step_hypotheses(simulator, structure, x))
    tried += [(hypotheses, len(hypotheses)) for hypotheses in unsure]
    each = [_leading(problem, refitted, structure, some, n, n_jobs) for some, n in tried if some]
    each.append(placed_by_rate(simulator, run.y, problem.windows))
    found = (_best(problem, refitted, beside, placed, n_jobs, named) for placed in each if placed)
    return list(chain.from_iterable(found))


def refit_laws(
    problem: Problem,
    refitted: Fit,
    beside: Fit,
    placed: list[PlacedEffect],
    n_jobs: int | None,
    named: Candidate | None,
) -> list[Candidate]:
    """Fit laws from the refit and from what stands ``beside`` them, the best one to the end; best first.

    One that does not come near what is ``named`` is not.
    """
    return refit_leaders(
        problem, refitted, placed, n_jobs, finished=1, twins=0, elsewhere=[beside], ahead_of_all=named
    )


def at_other_ports(found: list[Candidate]) -> list[Candidate]:
    """Return the first of some fitted laws at each port but that of the first of all."""
    if not found:
        return []
    first = {law.effects[-1].port: law for law in reversed(found)}
    return [law for port, law in first.items() if port != found[0].effects[-1].port]


def _leading(
    problem: Problem,
    refitted: Fit,
    structure: Structure,
    hypotheses: list[Hypothesis],
    tried: int,
    n_jobs: int | None,
) -> list[PlacedEffect]:
    """Return those of which the tangents tell most."""
    bank = make_bank(problem, refitted, hypotheses, n_jobs)
    return [odd_if_coupled(law, structure) for law in leaders(bank, tried, NONE_SILENT, 1.0)]


def _best(
    problem: Problem,
    refitted: Fit,
    beside: Fit,
    placed: list[PlacedEffect],
    n_jobs: int | None,
    named: Candidate | None,
) -> list[Candidate]:
    """Return the best law, fitted, and the best at other ports."""
    found = refit_laws(problem, refitted, beside, placed, n_jobs, named)
    if not found or (named is not None and not in_reach(found[0], named, refitted)):
        return found[:1] + at_other_ports(found)
    return [without_spare(problem, counted_from_zero(problem, found[0])), *at_other_ports(found)]

"""What a name leaves because its form is idealised: what a curve along its argument or a loss takes."""

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.bank import Bank, effect_column, make_bank, out_of
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.members import without
from narx_sklearn.discrepancy.search.unnamed.beyond_a_gap import damped_beyond
from narx_sklearn.discrepancy.search.unnamed.kinds import CURVE
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.stages.unnamed import curves_along

FORM = 0.05  # share of what an effect explains that its idealised form may leave; a wrong one leaves more
IS_A_CURVE = 0.5  # share of what an effect does that a curve would do too, above which it is one


def own_forms(
    problem: Problem, best: Candidate, structure: Structure, n_jobs: int | None = None
) -> list[Hypothesis]:
    """Return what gives names of a set another form, each little beside what its name explains.

    That is a curve along what it depends on, and for what is hit, a damping while it is.

    Only where a name is alone on what it depends on: two on one signal make up a law together, of which
    neither need be true.
    """
    curves = [c for c in curves_along(problem, best.fit, structure) if c.placed.effect.code == CURVE]
    found = []
    for effect in best.effects:
        if sum(along(effect, other) for other in best.effects) > 1:
            continue
        for curve in curves:
            at_its_place = along(effect, curve.placed) and _way(effect) == _way(curve.placed)
            if at_its_place and _is_form(problem, best, effect, curve, n_jobs):
                found.append(curve)
        damped = damped_beyond(effect)
        if damped is not None:
            explained = without(problem, best, [effect]).fit.cost - best.fit.cost
            if _is_little(problem, best, damped, explained, n_jobs):
                found.append(damped)
    return found


def _way(placed: PlacedEffect) -> tuple[int, bool, bool]:
    """Return on which way an effect gets to equations and outputs."""
    return placed.through, placed.handed_on, placed.is_seen


def taken_by_forms(
    problem: Problem, best: Candidate, structure: Structure, n_jobs: int | None = None
) -> float:
    """Return by how much other forms of the names of a set would lower its cost, beyond what noise lets them.

    In noise variances.
    """
    forms = own_forms(problem, best, structure, n_jobs)
    if not forms:
        return 0.0
    bank = make_bank(problem, best.fit, forms, n_jobs)
    return max(_taken(bank) * best.n_samples / best.fit.cost - bank.n_columns, 0.0)


def _taken(bank: Bank) -> float:
    """Return by how much all columns of a bank together lower the cost."""
    residual = bank.residual[:, :, None]
    return float(np.sum(residual**2) - np.sum(out_of(bank.columns, residual) ** 2))


def along(one: PlacedEffect, other: PlacedEffect) -> bool:
    """Tell whether two effects act at one place and depend on one signal."""
    own, others = (effect.second if effect.is_fed else effect.weights for effect in (one, other))
    return one.port == other.port and own == others


def _is_form(
    problem: Problem, best: Candidate, effect: PlacedEffect, curve: Hypothesis, n_jobs: int | None
) -> bool:
    """Tell whether a curve would do most of what an effect does, and takes little of what that leaves."""
    others = without(problem, best, [effect]).fit
    bank = make_bank(problem, others, [curve], n_jobs)
    own = others.projector(effect_column(problem, others, problem.run(others.model), effect))
    own = out_of(others.jacobian, own[:, :, None])
    left = np.sum(out_of(bank.columns, own) ** 2)
    if not left < (1.0 - IS_A_CURVE) * np.sum(own**2):
        return False
    return _is_little(problem, best, curve, others.cost - best.fit.cost, n_jobs)


def _is_little(
    problem: Problem, best: Candidate, form: Hypothesis, explained: float, n_jobs: int | None
) -> bool:
    """Tell whether another form takes little beside what a name has explained."""
    taken = _taken(make_bank(problem, best.fit, [form], n_jobs))
    return bool(taken <= FORM * (explained + taken))

"""Is a parameter of the simulator no constant? Which one depends on which signal, if nothing plainer does."""

from collections.abc import Sequence

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.search.bank import Bank, make_bank
from narx_sklearn.discrepancy.search.candidate import HARDLY, Candidate, converged, once_each
from narx_sklearn.discrepancy.search.confirm import Trial, chances, clearer_noise, priced
from narx_sklearn.discrepancy.search.explain import refit_leaders
from narx_sklearn.discrepancy.search.hypotheses import parameter_hypotheses
from narx_sklearn.discrepancy.search.ranking import gains, scaled
from narx_sklearn.discrepancy.search.unnamed.kinds import VARYING
from narx_sklearn.discrepancy.search.unnamed.varying import PARAMETER_THAT_VARIES, bending, broken, line_of
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.stages.coloured_search import Searched
from narx_sklearn.discrepancy.stages.judgement import Judgement, judged
from narx_sklearn.discrepancy.stages.refuted import BEFORE_DATA, may_be_drift
from narx_sklearn.discrepancy.stages.unnamed import UNEXPLAINED
from narx_sklearn.physics.effects import PARAMETER

LOOKS = 2  # at the form of its law, under the noise that the form before leaves
TRIED = 6  # of all parameters and signals, those of which the tangents tell most, that are fitted
MOST = 0.5  # of what names take off: where tangents promise less, no parameter stands in their place
RIVALS = 5  # of all that was fitted before, that are held against it under the noise that it leaves


def parameter_that_varies(
    searched: Searched, found: Judgement, structure: Structure, settings: Settings
) -> tuple[Searched, Judgement] | None:
    """Return the search and what is said where a parameter depends on a signal; None where it does not.

    What such a parameter does enters several equations and outputs at once, where the catalogue's names enter
    one. It is asked for where something is missing already, so that it raises no alarm; it has to outdo the
    names that were found, be no noise, though all parameters with all signals were tried, and to stand where
    a name has to. What a name at one place does about as well is a matter of that name, whatever speaks
    against it: a loss that rises with the level itself is a square of the level. It has no name itself: why
    the parameter changes is not said, so what is missing stays *unknown*.
    """
    problem, refitted, steps = searched
    if not steps or may_be_drift(problem.noise, found.best, found.alternatives):
        return None
    bank = _bank(searched, structure, settings)
    if bank is None:
        return None
    settings.tell("parameters that depend on a signal")
    gain, strength = gains(bank)
    explained = refitted.cost - found.best.fit.cost if found.verdict != "unknown" else 0.0
    most = [j for j in np.argsort(-gain, kind="stable")[:TRIED] if gain[j] > max(MOST * explained, 0.0)]
    placed = [scaled(bank, j, strength[j]) for j in most]
    varying = refit_leaders(problem, refitted, placed, settings.n_jobs, finished=1) if placed else []
    if not varying:
        return None
    varying[0] = _unless_bent(problem, converged(problem, varying[0], settings.n_jobs), settings.n_jobs)
    if not _outdoes(problem, varying[0], found, refitted):
        return None
    nothing = Candidate(refitted, problem.n_seen)
    trial = Trial(problem, nothing, bank.without_columns(), settings.n_jobs, settings.random_state)
    if chances(trial, varying[:1])[0] > settings.alpha_nameless:
        return None
    for _ in range(LOOKS):
        searched = _under_its_noise(searched, varying, settings)
        best = next(c for c in searched.pool if c.places == varying[0].places)
        nearer = _unless_bent(searched.problem, best, settings.n_jobs)
        if nearer is best:
            break
        varying = [nearer]
    said = judged(searched, best, searched.pool, structure, settings)
    if said.verdict != "explained" or said.best is not best:
        return None
    of_laws = ((),) * len(best.effects)
    return searched, Judgement("unknown", best, of_laws, best) if _is_own(best) else said


def _is_own(candidate: Candidate) -> bool:
    """Tell whether that a parameter depends on a signal has no name."""
    return candidate.effects[0].effect.code == VARYING


def _unless_bent(problem: Problem, law: Candidate, n_jobs: int | None) -> Candidate:
    """Return a parameter as it depends on a signal, or along a parabola or a broken line where likelier."""
    if not _is_own(law) or line_of(law.effects[0]) is not None:
        return law
    model = law.fit.model
    placed, run = law.effects[0], problem.run(model)
    rows = problem.samples_of(run)
    values = placed.second_of(problem.u[rows], run.x[rows])
    assert values is not None
    is_straight = placed.effect == PARAMETER_THAT_VARIES
    for other in [bending(placed)] * is_straight + [broken(placed, values)]:
        bent = fit(problem, model._replace(effects=(other,)), n_jobs=n_jobs)
        found = converged(problem, Candidate(bent, law.n_samples), n_jobs)
        law = found if found.criterion < law.criterion - HARDLY else law
    return law


def _bank(searched: Searched, structure: Structure, settings: Settings) -> Bank | None:
    """Return what every parameter would do that depends on any signal; None where none can."""
    problem, refitted, _ = searched
    effects = [PARAMETER_THAT_VARIES, *(effect for effect in settings.effects if PARAMETER in effect.ports)]
    run = problem.run(refitted.model)
    hypotheses = parameter_hypotheses(effects, problem, run, structure, settings.n_jobs)
    return make_bank(problem, refitted, hypotheses, settings.n_jobs) if hypotheses else None


def _outdoes(problem: Problem, varying: Candidate, found: Judgement, refitted: Fit) -> bool:
    """Tell whether a parameter that varies is the likelier explanation, each under noise of its own.

    Names that explain what is missing go first: what a parameter does at one place has a name there (a gain
    that follows a temperature, a stiffness with a square). It has to leave visibly less than they do, or to
    be simpler than several that piece it together.
    """
    plainer = found.best
    likelier = priced(problem, plainer) - priced(problem, varying)
    if found.verdict == "unknown":
        return likelier > 0.0
    left = plainer.fit.cost - varying.fit.cost
    leaves_less = left > UNEXPLAINED * (refitted.cost - varying.fit.cost)
    is_simpler = len(plainer.effects) > len(varying.effects) and varying.n_values < plainer.n_values
    return likelier > HARDLY + BEFORE_DATA and (leaves_less or is_simpler)


def _under_its_noise(searched: Searched, varying: Sequence[Candidate], settings: Settings) -> Searched:
    """Return the search with what was tried last, all under the noise that the best of that leaves.

    Noise that was estimated beside names that do not explain it all holds the rest of it.
    """
    problem, refitted, steps = searched
    noise = clearer_noise(problem, varying[0].fit)
    if noise is None:
        pool = [*varying, *searched.pool]
    else:
        problem = problem.with_noise(noise)
        refitted = fit(problem, refitted.model, n_jobs=settings.n_jobs)
        singles = [c for c in searched.pool if len(c.effects) == len(varying[0].effects)]
        pool = [converged(problem, c, settings.n_jobs) for c in [*varying, *singles[:RIVALS]]]
    pool = once_each(sorted(pool, key=lambda c: c.criterion))
    return Searched(problem, refitted, [steps[0]._replace(candidates=pool)])

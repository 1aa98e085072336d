"""What is concluded of a record: its diagnosis, and what samples that were held out say of it."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import repeat

import numpy as np
import pandas as pd
from scipy.stats import chi2

from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.narrow import bounds_as_findings
from narx_sklearn.discrepancy.per_session import sessions_as_findings
from narx_sklearn.discrepancy.placed import for_other_records, that_recur
from narx_sklearn.discrepancy.records.finding import DataFinding
from narx_sklearn.discrepancy.records.record import Piece, Split, hold_out, pieces_of
from narx_sklearn.discrepancy.records.standing import not_told_by, still_standing, to_be_mended
from narx_sklearn.discrepancy.results import BY_SESSION, NOTHING_MISSING, STANDS_IN
from narx_sklearn.discrepancy.search.confirm import DRIFT, is_drift
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.discrepancy.stages.diagnosis import Diagnosis, diagnose
from narx_sklearn.discrepancy.stages.temporary import are_foreseen, only_where_fitted
from narx_sklearn.discrepancy.stages.unnamed import UNEXPLAINED
from narx_sklearn.discrepancy.substeps import hold_as_findings, mind_steps
from narx_sklearn.discrepancy.verify import (
    SURELY,
    HeldOut,
    Lead,
    Stretch,
    errors_over,
    left_together,
    on_held_out,
    score_table,
    scored_stretches,
    squared_errors,
)

ALIKE = 0.99  # confidence with which several sessions began off a memory's middle
RUNS_OFF = 2.0  # times what a simulation leaves of whole runs, refitted or not, that no explanation does
ROUNDING = 1e-6  # share of an error, which says nothing
HARM = 0.01  # chance that what the uncertainty of parameters costs on other samples is taken for harm


@dataclass(frozen=True, eq=False)
class Conclusion:
    """A diagnosis, what is used of it, and what samples that were held out say.

    Attributes
    ----------
    diagnosis : Diagnosis
        Of the samples that were fitted.
    split : Split
        Samples that were fitted and samples that were held out.
    verdict : str
        That of the diagnosis, "unknown" where samples held out take it back, or "ambiguous" where they would
        have to confirm it and do not.
    tried : Simulator
        With all that was found, but what nobody can foresee where the rest does without it.
    corrected : Simulator
        The same, or the refitted one where what was tried does harm.
    of_record : tuple of DataFinding
        Mistakes in the record that still stand beside the diagnosis.
    scores : DataFrame
        Errors of the ``simulators`` in free runs over the ``stretches``.
    stretches : tuple of Stretch
        Those runs.
    left_there : float
        What names leave of held-out samples over what they leave elsewhere, mean square; 1 if none can tell.
    is_silent : bool
        Whether held-out samples neither confirm nor refute what was found.
    is_unconfirmed : bool
        Whether names that act for a while only leave no less of held-out samples than all else does alone.
    """

    diagnosis: Diagnosis
    split: Split
    verdict: str
    tried: Simulator
    corrected: Simulator
    of_record: tuple[DataFinding, ...] = ()
    scores: pd.DataFrame = field(default_factory=pd.DataFrame)
    stretches: tuple[Stretch, ...] = ()
    left_there: float = 1.0
    is_silent: bool = False
    is_unconfirmed: bool = False

    @cached_property
    def refitted(self) -> Simulator:
        """The simulator with its own parameters refitted."""
        return self.diagnosis.problem.simulator.with_parameters(self.diagnosis.refitted.model.p)

    @property
    def is_worse(self) -> bool:
        """Whether what was tried is surely worse than a refit in whole runs, where small errors add up.

        What happened once does not act there; parameters that were fitted beside it differ by what is not
        known of them.
        """
        happened_once = self.tried.effects and not that_recur(self.tried.effects)
        if self.scores.empty or happened_once:
            return False
        return bool(self.scores["removed_high"]["augmented"] < -ROUNDING)

    @property
    def is_better(self) -> bool:
        """Whether what was tried is surely better than a refit in whole runs."""
        return not self.scores.empty and bool(self.scores["removed_low"]["augmented"] > ROUNDING)

    @property
    def is_lost(self) -> bool:
        """Whether what was tried runs off, beside the simulator as it was given and as it was refitted.

        Where small errors add up the right effect may do harm, but not as much.
        """
        if not self.is_worse:
            return False
        errors = self.scores["nrmse"]
        return bool(errors["augmented"] > RUNS_OFF * max(errors["nominal"], errors["refitted"]))

    @property
    def is_worse_than_given(self) -> bool:
        """Whether what was found leaves more than the simulation that was given, fitted or held out.

        Then it is no explanation, whatever a refit alone leaves: that may have lost its way. Nobody holds
        against a drift, or against what begins or ends, what it does where it was not fitted, nor against
        anything what small errors add up to in whole runs.
        """
        diagnosis, effects = self.diagnosis, self.diagnosis.best.effects
        if diagnosis.best.fit.cost > diagnosis.nominal.cost:
            return True
        foreseen = are_foreseen(effects) and not any(is_drift(effect) for effect in effects)
        if self.scores.empty or not (diagnosis.forgets and foreseen):
            return False
        return bool(self.scores["nrmse_low"]["augmented"] > self.scores["nrmse_high"]["nominal"])

    @property
    def leaves_all_out(self) -> bool:
        """Whether what was found was taken back, and a refit alone corrects the simulator."""
        return self.corrected is not self.tried

    @property
    def for_other_records(self) -> Simulator:
        """The corrected simulator without what is of this record alone."""
        effects = for_other_records(self.corrected.effects, self.beginning_alike)
        return self.corrected.with_effects(effects)

    @property
    def beginning_alike(self) -> set[tuple]:
        """Places of effects whose memories began off their middle in several sessions: so others will."""
        diagnosis = self.diagnosis
        effects, model = diagnosis.best.effects, diagnosis.best.fit.model
        if np.unique(diagnosis.problem.windows.began).size < 2 or not effects:
            return set()
        lower, upper = diagnosis.intervals(ALIKE).T
        return {
            effect.place
            for effect, own in zip(effects, model.theirs, strict=True)
            if (at := effect.effect.begin) is not None
            and (lower[own.start + at] > 0 or upper[own.start + at] < 0)
        }

    @property
    def simulators(self) -> dict[str, Simulator]:
        """The simulators that are compared, by the names of their scores.

        What happened once is left out: it was no sample held out.
        """
        return {
            "nominal": self.diagnosis.problem.simulator,
            "refitted": self.refitted,
            "augmented": self.tried.with_effects(that_recur(self.tried.effects)),
        }

    @property
    def guesses(self) -> dict[str, np.ndarray]:
        """Initial states from which those of held-out runs are fitted, by the same names."""
        found = self.diagnosis
        fits = {"nominal": found.nominal, "refitted": found.refitted, "augmented": found.best.fit}
        return {name: self.guess_of(fit) for name, fit in fits.items()}

    def guess_of(self, found: Fit) -> np.ndarray:
        """Return the initial state that a fit has for the window next to what was held out."""
        return found.model.x0[0 if self.split.beginnings else -1]

    @property
    def leads(self) -> dict[str, Lead]:
        """What the effects of a simulator remember, by the same names."""
        return {"augmented": Lead(self.diagnosis.problem.windows, self.diagnosis.best.fit.model.x0)}

    @cached_property
    def n_init(self) -> int:
        """Samples that fix an initial state: eight for each state, and eight more, or half of a window."""
        problem = self.diagnosis.problem
        return int(max(8 * (len(problem.simulator.states) + 1), min(problem.windows.length // 2, 200)))

    def stretches_of(self, pieces: list[Piece], y: np.ndarray) -> tuple[Stretch, ...]:
        """Return the stretches over which simulations are run freely, of pieces of a record of outputs y."""
        n_states = len(self.diagnosis.problem.simulator.states)
        return tuple(scored_stretches(pieces, y, self.n_init, self.diagnosis.followed_for, n_states))

    @property
    def held_out(self) -> pd.DataFrame:
        """The samples that the scores are of, a row a stretch."""
        rows = [(s.rows.start, s.scored.start, s.rows.stop) for s in self.stretches]
        return pd.DataFrame(rows, columns=["start", "scored_from", "stop"], dtype=int)


def conclude(
    simulator: Simulator,
    u: np.ndarray,
    y: np.ndarray,
    sessions,
    settings: Settings,
    of_record: Sequence[DataFinding] = (),
) -> Conclusion:
    """Diagnose a record but its end, and hold what was found against that.

    Where nothing is missing before the end, or no law, or what was found leaves more there than elsewhere, a
    second look is at a record whose beginning is held out: a limit may be met at the end only.

    Parameters
    ----------
    of_record : list of DataFinding
        Mistakes in the record that were found before any fit.
    """
    pieces = pieces_of(u, sessions)
    ends, beginnings = (hold_out(pieces, settings.test_fraction, beginnings=b) for b in (False, True))

    def look(split: Split, settings: Settings) -> Diagnosis:
        return diagnose(simulator, u, y, split.fitting, settings)

    first, split = look(ends, settings), ends
    no_law = first.unforeseen is not None and first.steps[0].detection.p_value > settings.alpha
    if (first.verdict in NOTHING_MISSING or no_law) and not first.is_apart and ends.held_out:
        settings.tell("a second look, at the samples held out")
        second = look(beginnings, settings.for_second_look())
        is_law = second.unforeseen is None or not no_law
        if second.verdict not in NOTHING_MISSING and is_law:
            first, split = second, beginnings
    found = _concluded(first, split, u, y, settings, of_record)
    if found.left_there > STANDS_IN and not split.beginnings:
        settings.tell("a second look: what these names lack may show at the end only")
        second = look(beginnings, settings.for_second_look())
        if second.is_named:
            again = _concluded(second, beginnings, u, y, settings, of_record)
            found = found if again.verdict == "unknown" else again
    return found


def _concluded(
    diagnosis: Diagnosis,
    split: Split,
    u: np.ndarray,
    y: np.ndarray,
    settings: Settings,
    of_record: Sequence[DataFinding],
) -> Conclusion:
    """Return what is concluded of a diagnosis, and which mistakes in the record still stand beside it."""
    if diagnosis.of_session is not None:
        split = split.of_session(diagnosis.of_session)
    best = diagnosis.best.fit.model
    standing = still_standing(list(of_record), diagnosis.problem, diagnosis.refitted.model, best)
    diagnosis, of_steps = mind_steps(diagnosis, settings.n_jobs)
    if diagnosis.verdict not in NOTHING_MISSING and to_be_mended(standing, best.effects):
        diagnosis = replace(diagnosis, verdict="unknown", record_misleads=True)
    of_bounds = bounds_as_findings(diagnosis, settings)
    settings.tell("verification on held-out samples")
    concluded = _held_against(diagnosis, split, u, y, settings)
    if concluded.verdict in ("explained", "ambiguous"):
        effects = concluded.diagnosis.best.effects
        standing = not_told_by(standing, effects, concluded.diagnosis.problem.simulator)
    if concluded.is_unconfirmed and concluded.verdict == "explained":
        concluded = replace(concluded, verdict="ambiguous")
    of_steps = [*of_steps, *hold_as_findings(diagnosis.problem.simulator)]
    told = *standing, *sessions_as_findings(diagnosis), *of_steps, *of_bounds
    return replace(concluded, of_record=told)


def _held_against(
    diagnosis: Diagnosis, split: Split, u: np.ndarray, y: np.ndarray, settings: Settings
) -> Conclusion:
    """Hold a diagnosis against held-out samples, and take back what they refute.

    What makes them worse is not used, and is no explanation, unless it drifts, or acted when the fit ended:
    nobody can foresee its course, or when it ends. What makes only whole runs worse is not used; of a machine
    that adds up small errors it may be an explanation nevertheless, unless it runs off.
    """
    simulator, best = diagnosis.problem.simulator, diagnosis.best
    found = simulator
    if diagnosis.verdict != "consistent":
        found = simulator.with_parameters(best.fit.model.p).with_effects(best.effects)
    whole = _scored(Conclusion(diagnosis, split, diagnosis.verdict, found, found), u, y, settings)
    if diagnosis.verdict in NOTHING_MISSING:
        return whole
    held = _on_held_out(whole)
    whole = replace(
        whole,
        left_there=_left_over_there(diagnosis, held),
        is_silent=held.is_silent(best.fit.cost / best.n_samples),
        is_unconfirmed=_is_unconfirmed(whole, held),
    )
    harms = _harms(whole, held)
    if harms or whole.is_worse:
        without_drifts = _without_drifts(whole, u, y, settings)
        if without_drifts is not None:
            whole = without_drifts
        elif not harms:
            verdict = "unknown" if whole.is_lost else whole.verdict
            whole = replace(whole, verdict=verdict, corrected=whole.refitted)
        else:
            # what began may have ended since; an offset would have stayed
            ended = only_where_fitted(diagnosis.problem, best)
            milder = diagnosis.as_drift if ended is None else replace(diagnosis, best=ended)
            if milder is not None:
                return _held_against(milder, split, u, y, settings)
            drifts = bool(best.effects) and best.effects[diagnosis.order[0]].effect.code == DRIFT
            verdict = whole.verdict if drifts or best.given else "unknown"
            return replace(whole, verdict=verdict, corrected=whole.refitted)
    if whole.is_worse_than_given:
        return replace(whole, verdict="unknown", corrected=whole.refitted)
    return replace(whole, verdict="unknown") if whole.left_there > STANDS_IN else whole


def _scored(found: Conclusion, u: np.ndarray, y: np.ndarray, settings: Settings) -> Conclusion:
    """Return a conclusion with the scores of its simulators."""
    stretches = found.stretches_of(found.split.held_out, y)
    if not stretches:
        return found
    errors = squared_errors(found.simulators, u, y, stretches, found.guesses, found.leads)
    if found.diagnosis.is_apart:
        errors[BY_SESSION] = errors_over(_by_session(found, stretches), u, y)
    columns = np.concatenate([y[stretch.rows] for stretch in stretches]).T
    measured = (column[np.isfinite(column)] for column in columns)
    spread = np.array([np.std(values) if values.size else np.nan for values in measured])
    scores = score_table(errors, spread, settings.level, settings.random_state)
    return replace(found, scores=scores, stretches=stretches)


def _by_session(found: Conclusion, stretches: Sequence[Stretch]) -> list[tuple]:
    """Return with each stretch the simulator with its session's own parameters, and about where it begins.

    A session that was held out as a whole has those of all.
    """
    diagnosis = found.diagnosis
    fits = {int(part.problem.windows.began[0]): part.fit for part in diagnosis.apart}
    own = [fits.get(stretch.began, diagnosis.best.fit) for stretch in stretches]
    simulators = [diagnosis.problem.simulator.with_parameters(fit.model.p) for fit in own]
    guesses = [found.guess_of(fit) for fit in own]
    return list(zip(stretches, simulators, guesses, repeat(None), strict=False))


def _without_drifts(whole: Conclusion, u: np.ndarray, y: np.ndarray, settings: Settings) -> Conclusion | None:
    """Return a conclusion without drifts of outputs, if what is beside them then does no harm.

    Nobody can foresee their course, which says nothing of what was found beside them.
    """
    foreseen = tuple(effect for effect in whole.tried.effects if not is_drift(effect))
    if not foreseen or len(foreseen) == len(whole.tried.effects):
        return None
    tried = whole.tried.with_effects(foreseen)
    rest = _scored(replace(whole, tried=tried, corrected=tried), u, y, settings)
    return None if rest.is_worse or _harms(rest, _on_held_out(rest)) else rest


def _on_held_out(found: Conclusion, before: tuple[Simulator, Fit] | None = None) -> HeldOut:
    """Return what a simulator and the one that was tried leave of held-out samples.

    The former is that which was refitted, or another one with its fit that is given.
    """
    simulator, its_fit = before or (found.refitted, found.diagnosis.refitted)
    guesses = found.guess_of(its_fit), found.guesses["augmented"]
    pieces, lead = found.split.held_out, found.leads["augmented"]
    return on_held_out(found.diagnosis.problem, simulator, found.tried, pieces, guesses, lead)


def _is_unconfirmed(found: Conclusion, held: HeldOut) -> bool:
    """Tell whether names that act for a while leave no less of held-out samples than all else does alone.

    A law that always acts, and has no name, may look like some effect for as long as the machine is moved in
    one way. Where it acts on held-out samples, or where without it parameters are bent that these ask for, an
    effect that acts for a while does them good.
    """
    diagnosis, model = found.diagnosis, found.diagnosis.best.fit.model
    lasting = tuple(effect for effect in model.effects if not effect.passes)
    if len(lasting) == len(model.effects):
        return False
    if lasting:
        problem = diagnosis.problem
        alone = fit(problem, model._replace(effects=lasting))
        simulator = problem.simulator.with_parameters(alone.model.p).with_effects(alone.model.effects)
        return not _on_held_out(found, (simulator, alone)).is_better
    return not (held.is_better or found.is_better)


def _harms(found: Conclusion, held: HeldOut) -> bool:
    """Tell whether what was tried is worse on held-out samples, or leaves all range.

    Surely worse, or no better where it should be by far. What explains nothing must not make a whole run
    worse either, nor what acts in a machine that forgets: there small errors do not add up.
    """
    if not found.scores.empty:
        errors = found.scores["nrmse"]
        if np.isfinite(errors["refitted"]) and not np.isfinite(errors["augmented"]):
            return True
        if found.is_worse and (found.verdict == "unknown" or found.diagnosis.forgets):
            return True
    best = found.diagnosis.best
    # what the uncertainty of its parameters costs on other samples is no harm
    unit = best.fit.cost / best.n_samples
    by_chance = chi2.isf(HARM, best.fit.model.q.size) * unit
    surely = max(SURELY * np.sqrt(np.sum(held.less**2)), by_chance)
    harmful = np.all(np.isfinite(held.less)) and held.less.sum() < -surely
    return bool(harmful) or held.is_belied(unit)


def _left_over_there(diagnosis: Diagnosis, held: HeldOut) -> float:
    """Return what names leave of held-out samples over what they leave elsewhere; 1 if none can tell.

    What is little beside all that they explain is no more than a form, or a machine that has warmed up.
    """
    best = diagnosis.best
    usual = best.fit.cost / best.n_samples
    if not (best.effects and are_foreseen(best.effects) and STANDS_IN * usual < held.left < np.inf):
        return 1.0
    there, elsewhere = left_together(diagnosis.problem, best.fit, held)
    return there / elsewhere if there > UNEXPLAINED * held.without else 1.0

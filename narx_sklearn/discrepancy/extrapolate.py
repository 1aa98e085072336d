"""From quiet motion to loud: what was found, fitted to the quieter windows and run over the louder ones."""

from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import chi2

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit, fit_states
from narx_sklearn.discrepancy.simulators.windows import cut, shortest_window
from narx_sklearn.discrepancy.stages.diagnosis import Diagnosis
from narx_sklearn.discrepancy.stages.temporary import are_foreseen
from narx_sklearn.discrepancy.verify import Errors, no_scores, score_table

FURTHER = 1.25  # times the reach of all quiet windows, that a louder one has
FEWEST = 2  # windows on either side
WINDOWS = 16  # at least, where they need not be too short for it
PER_PARAMETER = 4  # samples of the quiet windows
TELLS = 0.01  # chance that an effect explains as much of the quiet windows if it is not there


class Amplitudes(NamedTuple):
    """Windows in which a machine moves little, and those in which it moves further."""

    quiet: np.ndarray  # (W,) bool
    loud: np.ndarray  # (W,) bool
    reach: np.ndarray  # (W,) farthest that an output goes from its mean, in spreads of the record

    @property
    def quiet_reach(self) -> float:
        """The farthest that an output goes in quiet windows, in spreads of the record."""
        return float(self.reach[self.quiet].max(initial=0.0))

    @property
    def loud_reach(self) -> float:
        """The farthest that an output goes at all, in spreads of the record."""
        return float(self.reach[self.loud].max(initial=0.0))

    @property
    def present(self) -> bool:
        """Whether there is another amplitude to extrapolate to."""
        return bool(min(self.quiet.sum(), self.loud.sum()) >= FEWEST)


class Extrapolation(NamedTuple):
    """Errors in louder windows of what was fitted to quieter ones."""

    scores: pd.DataFrame  # as `score_table` makes them; empty where there is nothing to tell
    amplitudes: Amplitudes
    silent: bool = False  # whether quiet windows tell nothing of what was found


def find_amplitudes(problem: Problem) -> Amplitudes:
    """Return the quieter half of the windows and those that reach a quarter farther than all of it."""
    values = np.where(problem.seen, problem.y[problem.rows], np.nan)
    centre, spread = np.nanmean(values, axis=(0, 1)), np.nanstd(values, axis=(0, 1))
    away = np.abs(values - centre) / np.where(spread > 0, spread, np.inf)
    reach: np.ndarray = np.nan_to_num(np.nanmax(away, axis=(1, 2), initial=0.0))
    counts = problem.weighted.sum(axis=1).min(axis=1) > 0  # every output is seen in them
    if not counts.any():
        return Amplitudes(counts, counts, reach)
    edge = float(np.median(reach[counts]))
    return Amplitudes(counts & (reach <= edge), counts & (reach > FURTHER * edge), reach)


def extrapolate(
    diagnosis: Diagnosis, corrected: Model, level: float, random_state, n_jobs: int | None = None
) -> Extrapolation:
    """Fit a corrected simulation to quiet windows and score it in louder ones, their initial states fitted.

    The names are those of the whole fit, and parameters of which quiet windows tell nothing stay as they are
    there; all others are fitted anew. The refitted simulation, to which nothing is added, is treated alike.

    Parameters
    ----------
    corrected : Model
        What the diagnosis uses: its best model, or the refitted one.
    level : float
        Confidence level of the intervals.
    """
    problem = _shorter(diagnosis.problem)
    amplitudes = find_amplitudes(problem)
    no_reaches = dict.fromkeys(("quiet", "loud"), np.empty(0))
    nothing = Extrapolation(no_scores(len(problem.simulator.outputs)).assign(**no_reaches), amplitudes)
    if diagnosis.verdict == "consistent" or not amplitudes.present or not are_foreseen(corrected.effects):
        return nothing
    nominal, refitted, corrected = (
        _begun(diagnosis.problem, model, problem)
        for model in (diagnosis.nominal.model, diagnosis.refitted.model, corrected)
    )
    quiet, loud = (problem.only(windows) for windows in (amplitudes.quiet, amplitudes.loud))
    n_fitted = corrected.q.size + amplitudes.quiet.sum() * problem.simulator.free_states.sum()
    if quiet.n_seen < PER_PARAMETER * n_fitted:
        return nothing
    before = after = fit(quiet, refitted, n_jobs=n_jobs)
    if corrected.effects:
        after = fit(quiet, corrected, n_jobs=n_jobs)
        told = (before.cost - after.cost) / (after.cost / quiet.n_seen)
        if told < chi2.isf(TELLS, corrected.q.size - refitted.q.size):
            return nothing._replace(silent=True)
    models = {"nominal": nominal, "refitted": before.model, "augmented": after.model}
    errors = {name: _errors(loud, model) for name, model in models.items()}
    spread = np.nanstd(np.where(loud.seen, loud.y[loud.rows], np.nan), axis=(0, 1))
    scores = score_table(errors, spread, level, random_state)
    return Extrapolation(scores.assign(quiet=amplitudes.quiet_reach, loud=amplitudes.loud_reach), amplitudes)


def _shorter(problem: Problem) -> Problem:
    """Return the problem over windows enough to tell quiet ones from loud, if its own are too few."""
    own, simulator = problem.windows, problem.simulator
    n_samples = int(np.sum(own.last - own.first))
    length = max(n_samples // WINDOWS, 2 * shortest_window(simulator))
    if length >= own.length:
        return problem
    pieces = [(slice(a, b), k) for a, b, k in zip(own.first, own.last, own.began, strict=True)]
    finer = cut(pieces, length, shortest_window(simulator))
    joined = np.zeros(finer.count, dtype=bool)
    joined[1:] = (finer.first[1:] == finer.last[:-1]) & (finer.began[1:] == finer.began[:-1])
    return problem.over(finer._replace(fresh=finer.fresh & ~joined))


def _begun(whole: Problem, model: Model, problem: Problem) -> Model:
    """Return a model whose windows begin with the states that it visits over those of the whole problem."""
    x0 = whole.run(model).x[problem.windows.first]
    return model._replace(x0=np.where(np.isfinite(x0), x0, 0.0))


def _errors(problem: Problem, model: Model) -> Errors:
    """Return a model's squared errors by window, its initial states fitted."""
    left = problem.left_over(fit_states(problem, model).model)
    with np.errstate(over="ignore", invalid="ignore"):
        squares = np.sum(left**2, axis=1)
    counts = problem.seen.sum(axis=1)
    return Errors(np.where(counts == 0, 0.0, np.where(np.isfinite(squares), squares, np.inf)), counts)

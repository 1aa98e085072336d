"""Held-out free runs: the simulation as it was, refitted, and with the physics added."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.fitting.sides import from_other_sides
from narx_sklearn.discrepancy.fitting.start import fit_initial_states
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.simulators.simulator import Simulator, Windows
from narx_sklearn.discrepancy.simulators.windows import cut, shortest_window

BLOCKS = 20  # of the held-out errors, for intervals
DRAWS = 1000  # of blocks, for intervals
SURELY = 1.64  # standard errors
SEEN = 4.0  # noise variances by which a correction must change held-out samples, for them to tell anything
BELIED = 2.33  # standard errors, that what is right may be off by in one of a hundred cases


class Stretch(NamedTuple):
    """Part of a record that is run freely; its first samples fix the initial state and are not scored."""

    rows: slice
    began: int  # first sample of its session, from which effects count the time
    n_init: int

    @property
    def scored(self) -> slice:
        """The samples whose errors count."""
        return slice(self.rows.start + self.n_init, self.rows.stop)


class FreeRun(NamedTuple):
    """One stretch run freely from an initial state found on its first samples."""

    y: np.ndarray  # (n, n_outputs)
    x0: np.ndarray  # (n_states,)


class Lead(NamedTuple):
    """The windows of a fit with their initial states: where the memory of effects comes from."""

    windows: Windows
    x0: np.ndarray  # (n_windows, n_states)

    def up_to(self, start: int, began: int) -> "Lead":
        """Return the windows of a session before a sample."""
        chosen = (self.windows.began == began) & (self.windows.last <= start)
        return Lead(Windows(*(field[chosen] for field in self.windows)), self.x0[chosen])

    def before(self, windows: Windows, x0: np.ndarray) -> tuple[Windows, np.ndarray, np.ndarray]:
        """Return windows with those that lead to them, all initial states, and which of them lead."""
        own = Windows(*(np.concatenate(pair) for pair in zip(self.windows, windows, strict=True)))
        leads = np.arange(own.count) < self.windows.count
        order = np.argsort(own.first, kind="stable")
        own = Windows(*(field[order] for field in own))
        fresh = own.fresh.copy()
        fresh[1:] &= (own.last[:-1] != own.first[1:]) | (own.began[:-1] != own.began[1:])
        return own._replace(fresh=fresh), np.concatenate([self.x0, x0])[order], leads[order]


def initial_state(
    simulator: Simulator,
    u: np.ndarray,
    y: np.ndarray,
    stretch: Stretch,
    guess: np.ndarray,
    lead: Lead | None = None,
) -> np.ndarray:
    """Return the state at the first sample of a stretch, fitted to those that fix it.

    Parameters
    ----------
    u, y : ndarray of shape (n_samples, n_inputs) and (n_samples, n_outputs)
        The whole record.
    lead : Lead, optional
        What effects remember; without it they begin at rest.
    """
    start, began = stretch.rows.start, stretch.began
    simulator = _in_session(simulator, began)
    stop = min(stretch.scored.start, stretch.rows.stop)
    noise = Noise.as_large_as(y[start:stop])
    known = simulator.known_states(u, y, np.array([start]), np.array([began]))[0]
    fewest = 2 * (int(simulator.free_states.sum()) + 1)
    quarter = min(start + max((stop - start) // 4, fewest), stop)

    def fitted(state: np.ndarray, upto: int) -> tuple[Problem, Fit]:
        windows, x0 = _led(lead, start, upto, began, state)
        unseen = y[began:upto].copy()
        unseen[: start - began] = np.nan
        problem = Problem(simulator, u[began:upto], unseen, windows, noise)
        return problem, fit_initial_states(problem, x0)

    problem, at_once = fitted(np.where(np.isfinite(known), known, guess), stop)
    # a run that begins wrong may be lost before the end
    _, early = fitted(at_once.model.x0[-1], quarter)
    _, begun = fitted(early.model.x0[-1], stop)
    found = min(at_once, begun, key=lambda fit: fit.cost)
    # nothing tells how much of what so few samples keep is noise
    return from_other_sides(problem, found, tolerated=0.0).model.x0[-1]


def free_run(
    simulator: Simulator,
    u: np.ndarray,
    y: np.ndarray,
    stretch: Stretch,
    guess: np.ndarray,
    lead: Lead | None = None,
) -> FreeRun:
    """Run a stretch freely after its initial state was fitted to its first samples."""
    x0 = initial_state(simulator, u, y, stretch, guess, lead)
    rows, began = stretch.rows, stretch.began
    simulator = _in_session(simulator, began)
    windows, all_x0 = _led(lead, rows.start, rows.stop, began, x0)
    run = simulator.run(u[began : rows.stop], windows, all_x0)
    return FreeRun(run.y[rows.start - began :], x0)


def _in_session(simulator: Simulator, began: int) -> Simulator:
    """Return a simulator for a run of which the time is counted from where a session begins."""
    return simulator.with_effects(
        [e.acting(e.during.in_session(began, simulator.dt)) for e in simulator.effects]
    )


def _led(lead: Lead | None, start: int, stop: int, began: int, x0: np.ndarray) -> tuple[Windows, np.ndarray]:
    """Return a stretch and the windows that lead to it, counted from its session, and all initial states."""
    first, last, session = (np.array([k], dtype=np.int64) for k in (start, stop, began))
    windows, x0 = Windows(first, last, np.array([True]), session), x0[None, :]
    if lead is not None:
        windows, x0, _ = lead.up_to(start, began).before(windows, x0)
    counted = {name: getattr(windows, name) - began for name in ("first", "last", "began")}
    return windows._replace(**counted), x0


def within_reach(pieces: list[tuple[slice, int]], n_init: int, reach: float) -> list[tuple[slice, int]]:
    """Return pieces cut into stretches that are over before a run follows the machine no longer.

    Parameters
    ----------
    reach : float
        Samples for which a run follows the machine; infinite where nothing grows.
    """
    if not np.isfinite(reach):
        return pieces
    windows = cut(pieces, n_init + max(int(reach) // 2, 1), n_init + 1)
    return [(slice(a, b), k) for a, b, k in zip(windows.first, windows.last, windows.began, strict=True)]


def scored_stretches(
    pieces: list[tuple[slice, int]], y: np.ndarray, n_init: int, reach: float, n_states: int
) -> list[Stretch]:
    """Return the stretches over which simulations are run, scored and drawn.

    Pieces of no more than twice the samples that fix an initial state are left out. Where all are that short,
    fewer samples fix it: four for each state, and four more. So many are measured, at any output.

    Parameters
    ----------
    pieces : list of (slice, int)
        Stretches of inputs without gaps, each with the first sample of its session.
    y : ndarray of shape (n_samples, n_outputs)
        What was measured, NaN elsewhere.
    n_init : int
        Measured samples that fix an initial state.
    reach : float
        As in :func:`within_reach`.

    Returns
    -------
    list of Stretch
        Empty where all pieces are too short.
    """
    for n in (n_init, 4 * (n_states + 1)):
        long_enough = [(piece, began) for piece, began in pieces if piece.stop - piece.start > 2 * n]
        found = []
        for rows, began in within_reach(long_enough, n, reach):
            measured = np.flatnonzero(np.isfinite(y[rows]).any(axis=1))
            if measured.size > n:
                found.append(Stretch(rows, began, int(measured[n - 1]) + 1))
        if found:
            return found
    return []


class Errors(NamedTuple):
    """Squared errors by block and output; what was not measured counts as nothing."""

    squares: np.ndarray  # (n_blocks, n_outputs), sums; infinite where a run leaves the finite range
    counts: np.ndarray  # (n_blocks, n_outputs), measured samples

    def mean_squares(self, draws: np.ndarray | None = None) -> np.ndarray:
        """Return the mean square of each output, (n_outputs,), NaN where nothing of it was measured.

        Of each draw of blocks, (n_draws, n_outputs), where such are given.
        """
        chosen = slice(None) if draws is None else draws
        with np.errstate(invalid="ignore"):
            return self.squares[chosen].sum(axis=-2) / self.counts[chosen].sum(axis=-2)


def squared_errors(
    simulators: dict[str, Simulator],
    u: np.ndarray,
    y: np.ndarray,
    stretches: Sequence[Stretch],
    guesses: dict[str, np.ndarray],
    leads: dict[str, Lead],
) -> dict[str, Errors]:
    """Return each simulator's squared errors over stretches, by block."""
    return {
        name: errors_over([(s, simulator, guesses[name], leads.get(name)) for s in stretches], u, y)
        for name, simulator in simulators.items()
    }


def errors_over(
    runs: Sequence[tuple[Stretch, Simulator, np.ndarray, Lead | None]], u: np.ndarray, y: np.ndarray
) -> Errors:
    """Return the squared errors over stretches, by block.

    Parameters
    ----------
    runs : list of (Stretch, Simulator, ndarray, Lead or None)
        With each stretch what simulates it, about where it begins, and what went before.
    """
    n_blocks = max(1, BLOCKS // len(runs))
    squares, counts = [], []
    for stretch, simulator, guess, lead in runs:
        run = free_run(simulator, u, y, stretch, guess, lead)
        measured, simulated = y[stretch.scored], run.y[stretch.n_init :]
        seen = np.isfinite(measured)
        error = np.where(seen, (measured - simulated) ** 2, 0.0)
        error[seen & np.isnan(simulated)] = np.inf
        squares += [block.sum(axis=0) for block in np.array_split(error, n_blocks)]
        counts += [block.sum(axis=0) for block in np.array_split(seen, n_blocks)]
    return Errors(np.array(squares), np.array(counts))


class HeldOut(NamedTuple):
    """What a simulator and a corrected one leave of held-out stretches, in noise variances."""

    less: np.ndarray  # (n_blocks,) that the corrected one takes off the cost; not finite where a run diverges
    changed: np.ndarray  # (n_blocks,) squared difference of the two
    without: float  # a sample, by the one as it was
    left: float  # a sample, by the corrected one
    windows: Windows
    x0: np.ndarray  # (n_windows, n_states) with which the corrected one begins

    def is_silent(self, unit: float) -> bool:
        """Tell whether the corrected one changes next to nothing there, so that nothing is confirmed."""
        return bool(self.changed.size and self.changed.sum() < SEEN * unit)

    @property
    def is_better(self) -> bool:
        """Whether the corrected one leaves surely less there."""
        if not np.all(np.isfinite(self.less)):
            return bool(np.isfinite(self.left) and not np.isfinite(self.without))
        return bool(self.less.sum() > SURELY * np.sqrt(np.sum(self.less**2)))

    def is_belied(self, unit: float) -> bool:
        r"""Tell whether the corrected one does no good there, where it should if it were right.

        With :math:`e` what it leaves and :math:`\delta` how it differs from the simulator, the cost falls by
        :math:`\delta^2 + 2 e^\top \delta`, of which the second part is of mean zero if it is right.

        Parameters
        ----------
        unit : float
            Cost of a sample of noise.
        """
        if not np.all(np.isfinite(self.less)) or self.less.sum() >= 0:
            return False
        missed = (self.changed - self.less) / 2
        return bool(missed.sum() > BELIED * np.sqrt(max(np.sum(missed**2), unit * self.changed.sum())))


def on_held_out(
    problem: Problem,
    before: Simulator,
    after: Simulator,
    pieces,
    guesses: tuple[np.ndarray, np.ndarray],
    lead: Lead,
) -> HeldOut:
    """Return what a simulator and a corrected one leave of held-out stretches.

    The stretches are cut and weighted as those of the fit were, their initial states fitted: what an
    integrator makes of a small error in its initial state or parameters counts only as long as it did there.

    Parameters
    ----------
    problem : Problem
        The windows and the noise of the fit.
    pieces : list of (slice, int)
        Stretches without gaps, each with the first sample of its session.
    lead : Lead
        What the effects of the corrected simulator remember.

    Returns
    -------
    HeldOut
        Without blocks where no stretch is long enough.
    """
    length = problem.windows.length
    windows = cut(pieces, length, shortest_window(problem.simulator))
    if not windows.count:
        none = np.empty(0)
        return HeldOut(none, none, np.nan, np.nan, windows, np.empty((0, len(before.states))))
    starts: list[np.ndarray] = []
    residuals = []
    for simulator, guess in zip((before, after), guesses, strict=True):
        known = simulator.known_states(problem.u, problem.y, windows.first, windows.began)
        # where friction holds, a fit stays near its start: that of the one is tried with the other too
        starts.append(np.where(np.isfinite(known), known, guess))
        found = [_initial_states_fitted(problem, simulator, windows, x0, lead) for x0 in starts]
        best = np.argmin([np.sum(left**2, axis=1) for _, left in found], axis=0)
        residuals.append(np.choose(best[:, None], [left for _, left in found]))
        starts = [x0 for x0, _ in found]
    with np.errstate(invalid="ignore"):
        less = _by_block(residuals[0] ** 2 - residuals[1] ** 2)
        changed = _by_block((residuals[0] - residuals[1]) ** 2)
    x0 = np.choose(best[:, None], starts)
    n_seen = problem.over(windows).n_seen
    without, left = (float(np.sum(residual**2) / n_seen) for residual in residuals)
    return HeldOut(less, changed, without, left, windows, x0)


def _by_block(values: np.ndarray) -> np.ndarray:
    return np.array([block.sum() for block in np.array_split(values.ravel(), BLOCKS)])


def left_together(problem: Problem, found: Fit, held: HeldOut) -> tuple[float, float]:
    """Return what a model leaves a sample of held-out stretches and of all else, all fitted together.

    Parameters that a fit could not know well are then not held against it.
    """
    lead = Lead(problem.windows, found.model.x0)
    windows, x0, elsewhere = lead.before(held.windows, held.x0)
    together = problem.over(windows)
    costs = fit(together, found.model._replace(x0=x0)).window_costs
    counts = together.weighted.sum(axis=(1, 2))
    there, here = (float(costs[w].sum() / counts[w].sum()) for w in (~elsewhere, elsewhere))
    return there, here


def _initial_states_fitted(
    problem: Problem, simulator: Simulator, windows: Windows, x0: np.ndarray, lead: Lead
) -> tuple[np.ndarray, np.ndarray]:
    """Return the fitted initial states of windows and what they leave, infinite where a run diverges."""
    led, all_x0, leads = lead.before(windows, x0)
    y = problem.y.copy()
    for a, b in zip(led.first[leads], led.last[leads], strict=True):
        y[a:b] = np.nan
    own = replace(problem, simulator=simulator, y=y, windows=led)
    found = from_other_sides(own, fit_initial_states(own, all_x0))
    left = found.residual[~leads]
    return found.model.x0[~leads], left if np.isfinite(found.cost) else np.full_like(left, np.inf)


def score_table(errors: dict[str, Errors], spread: np.ndarray, level: float, random_state) -> pd.DataFrame:
    """Return root mean squared errors with intervals, fit in percent, and the share of the error removed.

    Intervals come from a bootstrap of blocks; the share is of the refitted simulation's mean square. An
    output of which nothing was measured has no part in it; where nothing was measured at all, the table is
    empty.

    Parameters
    ----------
    errors : dict of {str: Errors}
        Of the same samples, by the names of the simulators.
    spread : ndarray of shape (n_outputs,)
        By which the errors of each output are divided.
    level : float
        Confidence level of the intervals.
    """
    counts = next(iter(errors.values())).counts
    seen = counts.sum(axis=0) > 0
    if not seen.any():
        return no_scores(spread.size)
    told = np.flatnonzero(counts.any(axis=1))  # blocks
    draws = told[np.random.default_rng(random_state).integers(0, told.size, size=(DRAWS, told.size))]
    draws = draws[counts[draws][..., seen].sum(axis=1).all(axis=1)]  # that tell of every output
    variance = np.where(spread > 0, spread, 1.0)[seen] ** 2
    tail = (1 - level) / 2
    means = {name: float((e.mean_squares()[seen] / variance).mean()) for name, e in errors.items()}
    drawn = {name: (e.mean_squares(draws)[:, seen] / variance).mean(axis=1) for name, e in errors.items()}
    rows = []
    for name, e in errors.items():
        value = float(np.sqrt(means[name]))
        low, high = value, np.inf
        if np.all(np.isfinite(drawn[name])):
            low, high = np.quantile(np.sqrt(drawn[name]), [tail, 1 - tail])
        row = {"run": name, "nrmse": value, "nrmse_low": float(low), "nrmse_high": float(high)}
        row["fit_percent"] = 100 * (1 - value)
        rmse = np.sqrt(e.mean_squares())
        row |= {f"rmse_{i}" if rmse.size > 1 else "rmse": float(one) for i, one in enumerate(rmse)}
        if "refitted" in errors:
            with np.errstate(invalid="ignore", divide="ignore"):
                row["removed"] = float(1 - np.divide(means[name], means["refitted"]))
                removed = 1 - drawn[name] / drawn["refitted"]
            good = removed[np.isfinite(removed)]
            row["removed_low"], row["removed_high"] = (
                (float(v) for v in np.quantile(good, [tail, 1 - tail])) if good.size else (np.nan, np.nan)
            )
        rows.append(row)
    return pd.DataFrame(rows).set_index("run")


def no_scores(n_outputs: int) -> pd.DataFrame:
    """Return a table of scores without rows.

    Examples
    --------
    >>> from narx_sklearn.discrepancy.verify import no_scores
    >>> list(no_scores(1))[:5]
    ['nrmse', 'nrmse_low', 'nrmse_high', 'fit_percent', 'rmse']
    """
    nothing = Errors(np.zeros((1, n_outputs)), np.ones((1, n_outputs), dtype=np.int64))
    return score_table({"refitted": nothing}, np.ones(n_outputs), level=0.9, random_state=0).iloc[:0]

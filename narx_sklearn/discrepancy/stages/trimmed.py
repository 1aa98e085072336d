"""What the quieter half of a record says of a simulator's parameters, and what that leaves of the rest."""

from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit, fit_states
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.windows import cut

HALF = 0.5  # share of the samples, in the quietest windows, that the parameters are fitted to
ORDINARY = 3 * 1.4826  # median absolute deviations: windows that are like the quiet ones take part in the end
FEWEST = 8  # windows, so that half of them can be quiet; longer ones forgive a mismatch less
PARTS = 4  # of the record, to each of which parameters are fitted to begin with
STEPS = 5  # of choosing windows and fitting to them, at most
ITERATIONS = 10  # of each fit on the way


class Trimmed(NamedTuple):
    """A simulator without effects whose parameters come from the quieter half of a record."""

    p: np.ndarray  # (n_parameters,)
    residual: np.ndarray  # (n_samples, n_outputs) recording less simulation; NaN outside the windows


def trimmed(problem: Problem, refitted: Fit, n_jobs: int | None = None) -> Trimmed:
    """Fit a simulator's parameters to the quieter half of the record.

    What acts for a while only bends the parameters of a fit to the whole record, and then a bit is left
    everywhere. Least trimmed squares over windows leaves it where it is: parameters are fitted to the windows
    that fit best, and those are chosen anew, until the choice stands; then to all that fit no worse. It
    begins at the refitted parameters, and at those fitted to each quarter of the record alone, one of which
    the mismatch may have spared; of all ends the one with the quietest half counts.

    Parameters
    ----------
    problem : Problem
    refitted : Fit
        Of the simulator without effects, over the problem's windows.
    n_jobs : int, optional
        Threads.

    Returns
    -------
    Trimmed
        The initial state of every short window is fitted to it.

    References
    ----------
    .. [1] P. J. Rousseeuw, 1984, least median of squares regression (least trimmed squares).
    .. [2] P. J. Rousseeuw and K. Van Driessen, 2006, computing LTS regression for large data sets.
    """
    everything, model = _in_short_windows(problem, refitted)
    lengths = everything.windows.last - everything.windows.first
    own = model._replace(p=everything.simulator.nominal)
    parts = np.arange(lengths.size) * PARTS // lengths.size

    def from_part(part: int | None) -> tuple[Model, np.ndarray]:
        start = model if part is None else _fitted_to(everything, own, parts == part)
        return _of_the_quieter_half(everything, start, lengths)

    begun = (None, *range(PARTS))
    ends = Parallel(n_jobs=n_jobs, prefer="threads")(delayed(from_part)(part) for part in begun)
    model, size = min(ends, key=lambda end: end[1] @ (lengths * _quieter_half(end[1], lengths)))
    deviation = size - np.median(size)
    model = _fitted_to(everything, model, deviation <= ORDINARY * np.median(np.abs(deviation)))
    model, _ = _begun_anew(everything, model, lengths)
    return Trimmed(model.p, everything.y - everything.run(model).y)


def _of_the_quieter_half(problem: Problem, model: Model, lengths: np.ndarray) -> tuple[Model, np.ndarray]:
    """Return a model fitted to the quieter half of the windows, chosen as it goes, and their mean squares."""
    chosen = np.zeros(lengths.size, dtype=bool)
    for _ in range(STEPS):
        model, size = _begun_anew(problem, model, lengths)
        quiet = _quieter_half(size, lengths)
        if np.array_equal(quiet, chosen):
            break
        chosen = quiet
        model = _fitted_to(problem, model, quiet)
    return _begun_anew(problem, model, lengths)


def _quieter_half(size: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Tell which windows are the quietest that hold half of the samples."""
    order = np.argsort(size)
    quiet = np.zeros(size.size, dtype=bool)
    quiet[order[: 1 + np.searchsorted(np.cumsum(lengths[order]), HALF * lengths.sum())]] = True
    return quiet


def _begun_anew(problem: Problem, model: Model, lengths: np.ndarray) -> tuple[Model, np.ndarray]:
    """Return a model with the initial states of all windows fitted, and the windows' mean squares."""
    found = fit_states(problem, model, iterations=ITERATIONS)
    return found.model, found.window_costs / lengths


def _fitted_to(problem: Problem, model: Model, chosen: np.ndarray) -> Model:
    """Return a model with parameters fitted to some of the windows, if there are any that run."""
    if not chosen.any():
        return model
    windows = problem.windows
    fresh = np.ones(int(chosen.sum()), dtype=bool)
    part = Windows(windows.first[chosen], windows.last[chosen], fresh, windows.began[chosen])
    alone = problem.over(part)
    found = fit(alone, model._replace(x0=model.x0[chosen]), iterations=ITERATIONS)
    return model._replace(p=found.model.p) if np.isfinite(found.cost) else model


def _in_short_windows(problem: Problem, refitted: Fit) -> tuple[Problem, Model]:
    """Return the problem under white noise in windows short enough that half of them can be quiet.

    What a stand-in gets wrong of its simulator is taken off the record once, as it is at the refitted
    parameters: to find it anew for every move of them would take many runs of a program.
    """
    windows, run = problem.windows, problem.run(refitted.model)
    simulator, y = problem.simulator.by_equations(), problem.y
    if simulator is not problem.simulator:
        model = refitted.model
        y = y - (run.y - simulator.run(problem.u, windows, model.x0, model.p, model.effects).y)
    starts = np.flatnonzero(windows.fresh)
    stops = np.append(starts[1:], windows.count) - 1
    pieces = [
        (slice(int(windows.first[a]), int(windows.last[b])), int(windows.began[a]))
        for a, b in zip(starts, stops, strict=True)
    ]
    n = sum(piece.stop - piece.start for piece, _ in pieces)
    longest = int((windows.last - windows.first).max())
    shorter = cut(pieces, min(longest, max(n // FEWEST, 1)), 1)
    left = problem.left_over(refitted.model)[problem.seen.any(axis=2)]
    spread = np.sqrt(np.mean(left**2, axis=0))
    noise = Noise.white(np.where(spread > 0, spread, 1.0))
    again = Problem(simulator, problem.u, y, shorter, noise)
    return again, refitted.model._replace(x0=np.nan_to_num(run.x[shorter.first]))

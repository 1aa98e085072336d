"""Held-out free runs: the simulation as it was, refitted, and with the physics added."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.problem import Model, Problem
from narx_sklearn.discrepancy.refit import fit
from narx_sklearn.discrepancy.simulator import Simulator, Windows
from narx_sklearn.discrepancy.start import fit_initial_states
from narx_sklearn.discrepancy.windows import cut

BLOCKS = 20  # of the held-out errors, for intervals
DRAWS = 1000
SURELY = 1.64  # standard errors


def compared(dx) -> dict[str, Simulator]:
    """Return the simulators that a fitted DiscrepancyRegressor compares, by the names of its scores."""
    return {
        "nominal": dx._diagnosis.problem.simulator,
        "refitted": dx.refitted_simulator_,
        "augmented": dx.simulator_,
    }


class FreeRun(NamedTuple):
    """One stretch run freely from an initial state found on its first samples."""

    y: np.ndarray  # (n, n_outputs)
    x0: np.ndarray  # (n_states,)


def initial_state(
    simulator: Simulator, u: np.ndarray, y: np.ndarray, piece: slice, began: int, n: int, guess: np.ndarray
) -> np.ndarray:
    """Return the state at the first sample of a piece, fitted to the first ``n`` of its samples.

    Parameters
    ----------
    u, y : ndarray of shape (n_samples, n_inputs) and (n_samples, n_outputs)
        The whole record.
    piece : slice
        A stretch without gaps.
    began : int
        First sample of its session, from which effects count the time and remember.
    """
    stop = min(piece.start + n, piece.stop)
    u, y = u[began:stop], y[began:stop]
    start = piece.start - began
    sigma = np.nanstd(y[start:], axis=0)
    noise = Noise.white(np.where(sigma > 0, sigma, 1.0))
    problem = Problem(simulator, u, y, _late(start, len(u)), noise)
    known = simulator.known_states(u, y, np.array([start]))[0]
    model = Model(simulator.nominal, simulator.effects, np.where(np.isfinite(known), known, guess)[None, :])
    return fit(problem, model, free=np.zeros(model.q.size, dtype=bool), iterations=10).model.x0[0]


def free_run(
    simulator: Simulator,
    u: np.ndarray,
    y: np.ndarray,
    piece: slice,
    began: int,
    n_init: int,
    guess: np.ndarray,
) -> FreeRun:
    """Run a piece freely after its initial state was fitted to its first ``n_init`` samples."""
    x0 = initial_state(simulator, u, y, piece, began, n_init, guess)
    start = piece.start - began
    run = simulator.run(u[began : piece.stop], _late(start, piece.stop - began), x0[None, :])
    return FreeRun(run.y[start:], x0)


def _late(start: int, stop: int) -> Windows:
    """Return one window of a session that began before it, at sample 0."""
    first, last, began = (np.array([k], dtype=np.int64) for k in (start, stop, 0))
    return Windows(first, last, np.array([True]), began)


def squared_errors(simulators: dict, u, y, pieces, n_init: int, guesses: dict) -> dict[str, np.ndarray]:
    """Return each simulator's mean squared held-out errors by block, (n_blocks, n_outputs).

    Parameters
    ----------
    pieces : list of (slice, int)
        Stretches without gaps, each with the first sample of its session.
    """
    found = {}
    for name, simulator in simulators.items():
        blocks = []
        for piece, began in pieces:
            run = free_run(simulator, u, y, piece, began, n_init, guesses[name])
            error = (y[piece] - run.y)[n_init:] ** 2
            error[np.isnan(run.y[n_init:])] = np.inf
            error[np.isnan(y[piece][n_init:])] = np.nan
            blocks += np.array_split(error, max(1, BLOCKS // len(pieces)))
        with np.errstate(invalid="ignore"):
            found[name] = np.array([np.nanmean(block, axis=0) for block in blocks if len(block)])
    return found


def gained(
    problem: Problem, before: Simulator, after: Simulator, pieces, guesses: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Return what a corrected simulator takes off the cost of held-out stretches, block by block.

    The stretches are cut and weighted as those of the fit were, their initial states fitted: what an
    integrator makes of a small error in its initial state or parameters counts only as long as it did there.

    Parameters
    ----------
    problem : Problem
        The windows and the noise of the fit.
    pieces : list of (slice, int)
        Stretches without gaps, each with the first sample of its session.

    Returns
    -------
    ndarray of shape (n_blocks,)
        In noise variances; not finite where a run leaves the finite range. Empty where no stretch is long
        enough.
    """
    length = int(np.median(problem.windows.last - problem.windows.first))
    windows = cut(pieces, length, 4 * (int(problem.simulator.free_states.sum()) + 1))
    if not windows.count:
        return np.empty(0)
    costs = []
    for simulator, guess in zip((before, after), guesses, strict=True):
        own = Problem(simulator, problem.u, problem.y, windows, problem.noise)
        known = simulator.known_states(problem.u, problem.y, windows.first)
        found = fit_initial_states(own, np.where(np.isfinite(known), known, guess))
        costs.append(found.residual**2 if np.isfinite(found.cost) else np.full_like(found.residual, np.inf))
    with np.errstate(invalid="ignore"):
        less = (costs[0] - costs[1]).ravel()
    return np.array([block.sum() for block in np.array_split(less, BLOCKS)])


def score_table(
    errors: dict[str, np.ndarray], spread: np.ndarray, level: float, random_state
) -> pd.DataFrame:
    """Return root mean squared errors with intervals, fit in percent, and the share of the error removed.

    Intervals come from a bootstrap of blocks; the share is of the refitted simulation's mean square.
    """
    rng = np.random.default_rng(random_state)
    some = next(iter(errors.values()))
    draws = rng.integers(0, len(some), size=(DRAWS, len(some)))
    scale = np.where(spread > 0, spread, 1.0)
    tail = (1 - level) / 2
    rows = []
    means = {name: (e / scale**2).mean(axis=1) for name, e in errors.items()}
    reference = means.get("refitted")
    for name, e in errors.items():
        with np.errstate(invalid="ignore"):
            value = float(np.sqrt(np.nanmean(means[name])))
            boot = np.sqrt(means[name][draws].mean(axis=1))
            low, high = np.quantile(boot, [tail, 1 - tail]) if np.all(np.isfinite(boot)) else (value, np.inf)
        row = {"run": name, "nrmse": value, "nrmse_low": float(low), "nrmse_high": float(high)}
        row["fit_percent"] = 100 * (1 - value)
        for i in range(e.shape[1]):
            row[f"rmse_{i}" if e.shape[1] > 1 else "rmse"] = float(np.sqrt(np.mean(e[:, i])))
        if reference is not None:
            with np.errstate(invalid="ignore", divide="ignore"):
                removed = 1 - means[name][draws].mean(axis=1) / reference[draws].mean(axis=1)
                row["removed"] = float(1 - means[name].mean() / reference.mean())
            good = removed[np.isfinite(removed)]
            row["removed_low"], row["removed_high"] = (
                (float(v) for v in np.quantile(good, [tail, 1 - tail])) if good.size else (np.nan, np.nan)
            )
        rows.append(row)
    return pd.DataFrame(rows).set_index("run")

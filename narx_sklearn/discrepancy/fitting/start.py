"""First guesses: initial states of the windows, and the fit of the simulator as it stands."""

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Model, Problem, measured_states
from narx_sklearn.discrepancy.fitting.refit import Fit, fit, fit_states
from narx_sklearn.discrepancy.simulators.simulator import Run, Simulator, Windows, covered
from narx_sklearn.discrepancy.simulators.structure import Structure, find_structure
from narx_sklearn.discrepancy.simulators.windows import chosen_of, cut, shortest_window

ITERATIONS = 10  # of a fit of initial states alone
ASTRAY = 100.0  # times an output's spread, by which a run has lost the recording
AFRESH = 1000  # times that a lost run begins anew, at most


def states_along(simulator: Simulator, u, y, pieces) -> np.ndarray:
    """Return the states that the simulator as it stands visits along a record, (n_samples, n_states).

    It runs from the first sample on. Where that run is lost (an unstable machine, held by a loop that the
    simulator knows nothing of), it begins anew every few samples from what was measured; NaN where that is
    lost too.

    Parameters
    ----------
    pieces : list of (slice, int)
        Stretches without gaps in ``u``, each with the first sample of its session.
    """
    whole = Windows.whole([piece for piece, _ in pieces])
    x, astray = _followed(simulator, u, y, whole, simulator.told_states(u, y, whole.first, whole.began))
    if not astray.any() or astray.all():  # all: what was measured is something else
        return x
    n_samples = int(np.sum(whole.last - whole.first))
    windows = cut(pieces, max(shortest_window(simulator), n_samples // AFRESH), 1)
    kept = covered(whole)[~astray]
    near = x[kept]
    structure = find_structure(simulator, near, u[kept])
    middle = np.broadcast_to(np.median(near, axis=0), x.shape)
    again, astray = _followed(
        simulator, u, y, windows, guess_states(simulator, u, y, windows, structure, middle)
    )
    again[covered(windows)[astray]] = np.nan
    return again


def _followed(simulator: Simulator, u, y, windows: Windows, x0: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the states of a run, (n_samples, n_states), and where in its windows it is lost."""
    run = simulator.run(u, windows, x0)
    return run.x, _is_lost(run, y, covered(windows))


def _is_lost(run: Run, y: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Tell at which samples a run has lost the recording, or left the finite range."""
    spread = np.nanstd(y, axis=0)
    with np.errstate(over="ignore", invalid="ignore"):
        far = np.abs(run.y - y)[rows] > ASTRAY * np.where(spread > 0, spread, np.inf)
    return far.any(axis=-1) | ~np.isfinite(run.x[rows]).all(axis=-1)


def guess_states(
    simulator: Simulator, u, y, windows: Windows, structure: Structure, x: np.ndarray
) -> np.ndarray:
    """Return initial states of the windows, (n_windows, n_states).

    Measured states come from the measurement, velocities of measured positions from its slope, the others
    from a run of the simulator as it stands (``x``), or its ``x0`` where that run left the finite range.
    """
    x0 = np.where(np.isfinite(x[windows.first]), x[windows.first], simulator.x0)
    known = measured_states(simulator, u, y, windows, structure.rates)
    return np.where(np.isfinite(known), known, x0)


def fit_initial_states(problem: Problem, x0: np.ndarray) -> Fit:
    """Fit the initial states alone, the parameters as they are.

    A coarse sensor feels no small move of a state, so what effects do to the outputs comes second.
    """
    simulator = problem.simulator
    model = Model(simulator.nominal, simulator.effects, x0)
    smooth = tuple(effect for effect in simulator.effects if effect.port.kind != "output")
    if smooth != simulator.effects:
        smoothed = fit_states(problem, model._replace(effects=smooth), iterations=ITERATIONS)
        model = model._replace(x0=smoothed.model.x0)
    return fit_states(problem, model, iterations=ITERATIONS)


def fit_where_followed(problem: Problem, model: Model, *, n_jobs: int | None = None) -> Fit:
    """Fit a model; where a window's run leaves the finite range, by the windows that follow the record first.

    One such window makes the error infinite, whatever all others tell of the parameters. Nearer to the right
    ones the machine is followed in more of them, until it is in all.
    """
    found = fit(problem, model, n_jobs=n_jobs)
    n_followed = 0
    while not np.isfinite(found.cost):
        run = problem.run(model)
        lost = _is_lost(run, problem.y, problem.rows) | ~np.isfinite(run.y[problem.rows]).all(axis=2)
        followed = np.flatnonzero(~(lost & problem.inside).any(axis=1))
        if followed.size <= n_followed:
            break
        n_followed = followed.size
        part = problem.over(chosen_of(problem.windows, followed))
        model = model._replace(p=fit(part, model._replace(x0=model.x0[followed]), n_jobs=n_jobs).model.p)
        found = fit(problem, model, n_jobs=n_jobs)
    return found

"""The beginning of a diagnosis: the simulator's own parameters, fitted over windows that allow it."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.fitting.start import (
    fit_initial_states,
    fit_where_followed,
    guess_states,
    states_along,
)
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.simulator import Simulator, Windows
from narx_sklearn.discrepancy.simulators.structure import Structure, Sums, find_structure
from narx_sklearn.discrepancy.simulators.windows import (
    LONGEST,
    Pace,
    cut,
    find_pace,
    followed_for,
    shortest_window,
    spread_out,
    window_length,
)

SHORTER = ((4, 2), (16, 8, 4, 2))  # parts of a window, over which a machine is fitted first
TRAPPED = 2.0  # times the cost of a fit led by shorter windows, beyond which one from afar lost its way
FOLLOWS = 0.3  # share of an output's spread that long windows may leave beside what short ones leave
PARTS = (1, 2, 4, 8)  # of a record, that are tried as windows of an integrating plant
FINEST = 1e-9  # of an output's spread: a smaller residual is rounding, in which nothing is missing
CENTRED = 6  # times that a fit goes on with a simulator known nearer to its parameters


class DivergesError(ValueError):
    """A simulation that leaves the finite range wherever it begins, so that nothing can be fitted."""


class Beginning(NamedTuple):
    """The fit of the simulator's own parameters, and what it was made with."""

    problem: Problem
    refitted: Fit
    structure: Structure
    pace: Pace
    lengthened_from: int  # samples of a window before it was made long; 0 where it was not


class _Fitted(NamedTuple):
    """A problem over windows of some length, and the fit of the simulator's own parameters."""

    problem: Problem
    refitted: Fit
    length: int  # samples that a window is wanted to have
    lengthened_from: int = 0  # as in `Beginning`


def begin(simulator: Simulator, u: np.ndarray, y: np.ndarray, pieces, settings: Settings) -> Beginning:
    """Fit the simulator's own parameters on the given pieces of a record.

    Parameters
    ----------
    pieces : list of (slice, int)
        Stretches without gaps in ``u``, each with the first sample of its session.
    """
    x = states_along(simulator, u, y, pieces)
    inside = np.isfinite(x).all(axis=1)
    if not inside.any():
        raise DivergesError(
            "The simulation left the finite range at its first sample; check its parameters, units and dt."
            + _finer_steps(simulator, *_first_points(simulator, u, y, pieces))
        )
    structure = find_structure(simulator, x[inside], u[inside])
    pace = find_pace(simulator, x[inside], u[inside])
    n_samples = sum(piece.stop - piece.start for piece, _ in pieces)
    length = settings.window or window_length(simulator, pace, n_samples)
    shortest = shortest_window(simulator)
    finer = _finer_steps(simulator, x, u)
    _check_growth(simulator, pace, shortest, finer)
    windows = spread_out(cut(pieces, length, shortest))
    if not windows.count:
        raise ValueError(
            f"No stretch of the record without gaps has the {shortest} samples that a fitting window needs. "
            "Pass a longer record."
        )
    known = structure.rates, pace.adds_up, Sums(simulator, structure)
    problem = Problem(simulator, u, y, windows, Noise.as_large_as(y), *known)
    settings.tell("fit of the simulator's own parameters")
    refitted = fit_where_followed(problem, _as_it_stands(problem, structure, x), n_jobs=settings.n_jobs)
    begun = _Fitted(problem, refitted, length)
    if settings.window is None:
        begun = _led(begun, pieces, shortest, structure, x, settings.n_jobs)
        if not (pace.forgets or pace.growth):
            begun = _lengthened_most(begun, pieces, min(n_samples, LONGEST), shortest)
    begun = begun._replace(refitted=_no_worse_than_given(begun.problem, begun.refitted))
    _check_finite(begun.problem, begun.refitted, finer)
    _check_influence(begun.problem, begun.refitted, structure)
    return Beginning(begun.problem, begun.refitted, structure, pace, begun.lengthened_from)


def _as_it_stands(problem: Problem, structure: Structure, x: np.ndarray) -> Model:
    """Return the simulator's nominal model, its initial states fitted from a guess along the states ``x``."""
    x0 = guess_states(problem.simulator, problem.u, problem.y, problem.windows, structure, x)
    return fit_initial_states(problem, x0).model


def _finer_steps(simulator: Simulator, x: np.ndarray, u: np.ndarray) -> str:
    """Return, in words, how many substeps the equations want at states, where that is more than they have."""
    wanted = simulator.steps_wanted(x, u)
    if not wanted:
        return ""
    return (
        " Its equations are stiff: their fastest eigenvalue is too fast for integration steps of "
        f"{simulator.dt / simulator.substeps:.4g} s. Pass substeps={wanted} to the simulator first."
    )


def _first_points(
    simulator: Simulator, u: np.ndarray, y: np.ndarray, pieces
) -> tuple[np.ndarray, np.ndarray]:
    """Return the states with which pieces begin, as far as they are measured, and the inputs there."""
    first = np.array([piece.start for piece, _ in pieces], dtype=np.int64)
    return simulator.told_states(u, y, first, first), u[first]


def _check_growth(simulator: Simulator, pace: Pace, shortest: int, finer: str) -> None:
    """Raise where equations grow so fast that they are no machine's: a run is lost within any window."""
    if simulator.discrete or followed_for(simulator, pace) >= shortest / 2:
        return
    raise DivergesError(
        f"The simulation diverges: as it stands it grows e-fold in {1 / (pace.growth * simulator.dt):.2g} "
        f"samples, so even a window of {shortest} samples is lost. Check the signs of its terms, its units "
        f"and its dt={simulator.dt:.6g}.{finer}"
    )


def _check_finite(problem: Problem, refitted: Fit, finer: str) -> None:
    """Raise where a simulation leaves the finite range even in short windows, so nothing could be fitted."""
    if np.isfinite(refitted.cost):
        return
    run, windows, dt = problem.run(refitted.model), problem.windows, problem.simulator.dt
    with np.errstate(over="ignore"):
        lost = problem.seen & ~np.isfinite(run.y[problem.rows] ** 2)
    k = int(problem.rows[lost.any(axis=2)].min())
    length = windows.length
    is_at_once = not np.isfinite(run.y[problem.rows[:, 1]]).all(axis=1).any()
    at_once = (
        "Wherever it begins, its function returns NaN or inf at once, as a division by zero does, or a root "
        "or logarithm of what is negative: print what it returns for recorded states and inputs. "
    )
    raise DivergesError(
        f"The simulation diverges: even begun anew in every window of {length} samples it leaves the finite "
        f"range, first at sample {k} of the record ({k * dt:.6g} s), and cannot be refitted. "
        f"{at_once * is_at_once}Check the signs of its terms, its units and its dt={dt:.6g}; start from "
        f"parameters with which it stays near the recording; or pass a shorter window.{finer}"
    )


def _check_influence(problem: Problem, refitted: Fit, structure: Structure) -> None:
    """Raise where neither an input nor a parameter changes what is simulated, though there are both."""
    simulator = problem.simulator
    n_inputs, n_parameters = len(simulator.inputs), len(simulator.parameters)
    if not (n_inputs and n_parameters) or refitted.jacobian[:, :, :n_parameters].any():
        return
    if structure.inputs.any() or structure.read[:, :n_inputs].any():
        return
    raise ValueError(
        f"None of the inputs {[str(s) for s in simulator.inputs]} and none of the parameters "
        f"{[p.name for p in simulator.parameters]} changes the simulated output: what its function returns "
        "does not depend on u or p. Check that it uses them."
    )


def centred(problem: Problem, found: Fit) -> tuple[Problem, Fit]:
    """Return the problem and its fit with a simulator that is known near the parameters fitted."""
    for _ in range(CENTRED):
        nearer = problem.simulator.centred(found.model.p)
        if nearer is problem.simulator:
            break
        problem = replace(problem, simulator=nearer)
        found = fit(problem, found.model)
    return problem, found


def _led(
    begun: _Fitted, pieces, shortest: int, structure: Structure, x: np.ndarray, n_jobs: int | None
) -> _Fitted:
    """Return the best of a fit and those to which ever longer windows led, up to the problem's own.

    Where the fit from afar lost its way, the problem is one over shorter windows.
    """
    problem, refitted, length, _ = begun
    lengths = [sorted({max(length // share, shortest) for share in shares}) for shares in SHORTER]
    ladders = [[spread_out(cut(pieces, n, shortest)) for n in ladder] for ladder in lengths]
    grown = Parallel(n_jobs=n_jobs, prefer="threads")(
        delayed(_grown)(problem, shorter, structure, x) for shorter in ladders
    )
    best = min(refitted, *grown, key=lambda found: found.cost)
    if refitted.cost > TRAPPED * best.cost:
        return _shortened(problem, best, ladders[-1], structure, x)
    return begun._replace(refitted=best)


def _grown(problem: Problem, shorter: list[Windows], structure: Structure, x: np.ndarray) -> Fit:
    """Return the fit of a problem to which fits over ever longer windows led.

    What grows, or turns over, takes a long run far away before parameters that are somewhat wrong can be told
    from it.
    """
    now = problem.over(shorter[0])
    found = fit_where_followed(now, _as_it_stands(now, structure, x))
    for windows in (*shorter[1:], problem.windows):
        longer = problem.over(windows)
        found = fit_where_followed(longer, found.model._replace(x0=states_at(now, found.model, windows)))
        now = longer
    return found


def _shortened(
    problem: Problem, found: Fit, shorter: list[Windows], structure: Structure, x: np.ndarray
) -> _Fitted:
    """Return the problem over the longest windows in which a fit from afar finds its way, and its fit.

    Over longer ones effects would lose theirs too: what a machine that turns over makes of a small mistake is
    another run altogether.
    """
    for windows in reversed(shorter):
        part = problem.over(windows)
        led = fit(part, found.model._replace(x0=states_at(problem, found.model, windows)))
        from_afar = fit_where_followed(part, _as_it_stands(part, structure, x))
        if from_afar.cost <= TRAPPED * led.cost:
            break
    return _Fitted(part, min(led, from_afar, key=lambda fitted: fitted.cost), part.windows.length)


def _lengthened_most(begun: _Fitted, pieces, n_samples: int, shortest: int) -> _Fitted:
    """Return the problem over the longest windows in which the run still follows the recording."""
    for share in PARTS:
        longer = _lengthened(begun, spread_out(cut(pieces, n_samples // share, shortest)))
        if longer is not begun:
            return longer
    return begun


def _lengthened(begun: _Fitted, windows: Windows) -> _Fitted:
    """Return the problem over longer windows and its fit, where the run still follows the recording there.

    What an integrator adds up over a long window tells far more than the same samples cut into many short
    ones, each with initial states of its own; but far from the right parameters a long run is lost.
    """
    problem, found, length, _ = begun
    if windows.count >= problem.windows.count:
        return begun
    longer = problem.over(windows)
    refitted = fit(longer, found.model._replace(x0=states_at(problem, found.model, windows)))
    left, noise = (residual_deviation(p, f.residual) for p, f in ((longer, refitted), (problem, found)))
    more = left**2 - noise**2  # than short windows leave, which is mostly noise
    follows = np.all(more < (FOLLOWS * np.nanstd(problem.y, axis=0)) ** 2)
    return _Fitted(longer, refitted, windows.length, length) if follows else begun


def _no_worse_than_given(problem: Problem, refitted: Fit) -> Fit:
    """Return a fit, or one from the simulator's nominal parameters where these alone leave less."""
    nominal = fit_initial_states(problem, refitted.model.x0)
    return fit(problem, nominal.model) if nominal.cost < refitted.cost else refitted


def states_at(problem: Problem, model: Model, windows: Windows) -> np.ndarray:
    """Return the states with which other windows begin, from the run of a model, or else as measured."""
    x = problem.run(model).x[windows.first]
    first = problem.simulator.told_states(problem.u, problem.y, windows.first, windows.began)
    return np.where(np.isfinite(x), x, first)


def residual_deviation(problem: Problem, residual: np.ndarray) -> np.ndarray:
    """Return the standard deviation of the residual of each output."""
    r = residual.reshape(problem.seen.shape) * problem.noise.sigma
    counts = problem.seen.sum(axis=(0, 1))
    sigma = np.sqrt((r**2).sum(axis=(0, 1)) / np.maximum(counts, 1))
    return np.maximum(sigma, 1e-12 * np.maximum(problem.noise.sigma, 1e-300))


def rounding_of(y: np.ndarray) -> np.ndarray:
    """Return the deviation of each output that is rounding, (n_outputs,)."""
    return FINEST * np.nanstd(y, axis=0)


def leaves_rounding(problem: Problem, residual: np.ndarray) -> bool:
    """Tell whether a whitened residual is rounding, in which nothing is missing."""
    return bool(np.all(residual_deviation(problem, residual) <= rounding_of(problem.y)))

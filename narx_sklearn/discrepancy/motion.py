"""Twins in continuous time: a linear differential equation found from a simulated output.

    y' = a0 y + b u + c    or    y'' = a0 y + a1 y' + b u + c

Lagged outputs are states of a map, not of a machine: nothing moves in them, so friction or a spring has no
place there. Where a position and its velocity reproduce the trace, they are the better twin.
"""

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from narx_sklearn._validation import as_signals, column_labels, signal_names, split_unit
from narx_sklearn.discrepancy.equations import compiled_source, picker
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.ode import describe
from narx_sklearn.discrepancy.problem import Model, Problem
from narx_sklearn.discrepancy.refit import fit
from narx_sklearn.discrepancy.simulator import Parameter, Signal, Simulator, Windows
from narx_sklearn.discrepancy.start import fit_initial_states
from narx_sklearn.discrepancy.units import tidy_unit
from narx_sklearn.discrepancy.windows import WINDOWS, cut

ORDERS = (1, 2)
STEP = 0.25  # of the fastest pole's time, in an integration step: errors of 1e-5 of what it moves
MOST_STEPS = 8  # in a sample; what is faster than that answers within the sample, and is no motion
SHORTEST = 50  # samples of a window, from which the first fit begins
NOTHING = 1e-6  # of the output's spread: what a term that leaves no more is worth


class Trace(NamedTuple):
    """A simulated output, the inputs that led to it, and what they are called."""

    u: np.ndarray  # (n_samples, n_inputs)
    y: np.ndarray  # (n_samples, 1)
    training: Windows  # one window for each stretch that is fitted
    held_out: Windows
    inputs: tuple[Signal, ...]
    output: Signal
    dt: float


class MotionSimulator(Simulator):
    """Simulate a linear differential equation of first or second order in the output.

    Its states are the output and, for the second order, its rate; its parameters are the coefficients of the
    terms that give the highest derivative: the output, its rate, the inputs, and 1.
    """

    def __init__(self, order, terms, inputs, output, *, dt, substeps=1, linear_hold=False):
        self.order, self.terms = order, tuple(terms)
        self.inputs, self.outputs, self.dt = inputs, (output,), dt
        self.substeps, self.linear_hold = substeps, linear_hold
        rate = Signal(f"{output.name}'", _quotient(output.unit, "s"))
        self.states = (output, rate)[:order]
        units = {s.name: s.unit for s in (*self.states, *inputs)} | {"1": "-"}
        highest = _quotient(output.unit, "s" if order == 1 else "s^2")
        self.parameters = tuple(Parameter(t, _quotient(highest, units[t]), 0.0) for t in self.terms)

    def known_states(self, u, y, samples, began=None):
        """Return the output as measured; its rate is not known."""
        known = np.full((samples.size, self.order), np.nan)
        known[:, 0] = y[samples, 0]
        return known

    def _equations(self):
        places = {s.name: f"x[{i}]" for i, s in enumerate(self.states)}
        places |= {s.name: f"u[{i}]" for i, s in enumerate(self.inputs)} | {"1": "1.0"}
        return _equation(self.order, tuple(places[term] for term in self.terms)), picker((0,))

    def __repr__(self) -> str:
        return describe(self, f"MotionSimulator of order {self.order}, dt={self.dt:g} s")


def _quotient(above: str, below: str) -> str:
    """Return the unit of a quotient, empty where one of the units is not known."""
    return tidy_unit(f"({above})/({below})") if above and below else ""


@lru_cache(maxsize=64)
def _equation(order: int, places: tuple[str, ...]):
    """Return the compiled right-hand side in which each coefficient multiplies what stands at its place."""
    lines = [f"written[{i}] = x[{i + 1}]" for i in range(order - 1)]
    lines.append(f"written[{order - 1}] = " + " + ".join(f"p[{i}] * {at}" for i, at in enumerate(places)))
    return compiled_source("def write(x, u, p, written):\n    " + "\n    ".join(lines), {}, {}, "The twin")


def identify_motion(
    u, y_sim, labels: np.ndarray, dt: float, good_enough: float
) -> tuple[Simulator, float] | None:
    """Return the equation of motion that runs like a trace, and its error; None where there is none.

    Parameters
    ----------
    u, y_sim : array-like or DataFrame of shape (n_samples, n_inputs) and (n_samples, 1)
    labels : ndarray of shape (n_samples,)
        Even where the trace may be fitted, odd where it is held out; a label for each stretch.
    dt : float
        Sampling period, s.
    good_enough : float
        Held-out error over the output's standard deviation, above which the next order is tried.

    Returns
    -------
    (Simulator, float) or None
    """
    trace = _trace(u, y_sim, labels, dt)
    if trace is None:
        return None
    best = None
    for order in ORDERS:
        for linear_hold in (False, True):
            start = _start(trace, order, linear_hold)
            found = None if start is None else _fitted(trace, start)
            if found is not None and (best is None or found[1] < best[1]):
                best = found
        if best is not None and best[1] < good_enough:
            return _without_idle_terms(trace, *best)
    return best


def _trace(u, y_sim, labels, dt: float) -> Trace | None:
    values, y = as_signals(u, "u"), as_signals(y_sim, "y_sim")
    if y.shape[1] != 1 or not (np.isfinite(values).all() and np.isfinite(y).all()):
        return None
    edges = np.flatnonzero(np.diff(labels, prepend=labels[0] - 1, append=labels[-1] + 1))
    pieces = [slice(int(a), int(b)) for a, b in pairwise(edges)]
    fitted, held_out = ([p for p in pieces if labels[p.start] % 2 == odd] for odd in (0, 1))
    if min((p.stop - p.start for p in pieces), default=0) < 8 * max(ORDERS):
        return None
    names = _signals(column_labels(u), values.shape[1], "u")
    output = _signals(column_labels(y_sim), 1, "y")[0]
    return Trace(values, y, Windows.whole(fitted), Windows.whole(held_out), names, output, dt)


def _signals(labels, n: int, letter: str) -> tuple[Signal, ...]:
    given = range(n) if labels is None else labels
    units = [split_unit(label)[1] if isinstance(label, str) else None for label in given]
    return tuple(
        Signal(name, unit or "") for name, unit in zip(signal_names(given, letter), units, strict=True)
    )


def _start(trace: Trace, order: int, linear_hold: bool) -> Simulator | None:
    """Return an equation with the poles of the linear map through the trace, other coefficients zero.

    None where the map's poles are not those of an equation of that order, or answer within a sample.
    """
    poles = np.log(_poles(trace, order).astype(complex)) / trace.dt
    fastest = np.abs(poles).max()
    substeps = int(np.ceil(fastest * trace.dt / STEP)) if np.isfinite(fastest) else MOST_STEPS + 1
    if substeps > MOST_STEPS or np.any(poles.imag * trace.dt >= np.pi):
        return None
    names = [trace.output.name, f"{trace.output.name}'"][:order]
    terms = [*names, *(signal.name for signal in trace.inputs), "1"]
    simulator = MotionSimulator(
        order,
        terms,
        trace.inputs,
        trace.output,
        dt=trace.dt,
        substeps=max(substeps, 1),
        linear_hold=linear_hold,
    )
    return simulator.with_parameters(dict(zip(names, -np.poly(poles).real[:0:-1], strict=True)))


def _poles(trace: Trace, order: int) -> np.ndarray:
    """Return the poles of the map y[k] = sum a_i y[k-i] + sum b_i u[k-i] + c through the trace."""
    rows, wanted = [], []
    for a, b in zip(trace.training.first, trace.training.last, strict=True):
        lags = [trace.y[a + order - i : b - i] for i in range(1, order + 1)]
        lags += [trace.u[a + order - i : b - i] for i in range(order + 1)]
        rows.append(np.hstack([*lags, np.ones((b - a - order, 1))]))
        wanted.append(trace.y[a + order : b, 0])
    matrix = np.vstack(rows)
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0] = 1.0
    a = np.linalg.lstsq(matrix / size, np.concatenate(wanted), rcond=None)[0] / size
    return np.roots([1.0, *-a[:order]])


def _fitted(trace: Trace, simulator: Simulator) -> tuple[Simulator, float] | None:
    """Fit an equation over short windows, then over the whole stretches, and measure it on the others."""
    pieces = [(slice(a, b), a) for a, b in zip(trace.training.first, trace.training.last, strict=True)]
    n = sum(piece.stop - piece.start for piece, _ in pieces)
    for windows in (cut(pieces, max(n // WINDOWS, SHORTEST), 4 * len(simulator.states)), trace.training):
        problem = _problem(trace, simulator, windows)
        x0 = _first_states(trace, simulator, windows)
        found = fit(problem, Model(simulator.nominal, (), x0), tolerance=NOTHING)
        if not np.isfinite(found.cost):
            return None
        simulator = simulator.with_parameters(found.model.p)
    problem = _problem(trace, simulator, trace.held_out)
    error = np.sqrt(fit_initial_states(problem, _first_states(trace, simulator, trace.held_out)).cost)
    error /= np.sqrt(problem.n_seen)
    return (simulator, float(error)) if np.isfinite(error) else None


def _problem(trace: Trace, simulator: Simulator, windows: Windows) -> Problem:
    return Problem(simulator, trace.u, trace.y, windows, Noise.white(np.maximum(trace.y.std(axis=0), 1e-300)))


def _first_states(trace: Trace, simulator: Simulator, windows: Windows) -> np.ndarray:
    """Return the output where windows begin, and its slope there."""
    slope = (trace.y[windows.first + 1, 0] - trace.y[windows.first, 0]) / trace.dt
    return np.column_stack([trace.y[windows.first, 0], slope])[:, : len(simulator.states)]


def _without_idle_terms(trace: Trace, simulator: Simulator, error: float) -> tuple[Simulator, float]:
    """Leave out the terms without which the equation runs like the trace as well."""
    best = simulator, error
    for term in simulator.parameters[::-1]:
        kept = {p.name: p.value for p in best[0].parameters if p.name != term.name}
        if not kept:
            break
        shorter = MotionSimulator(
            len(simulator.states),
            kept,
            simulator.inputs,
            simulator.outputs[0],
            dt=simulator.dt,
            substeps=simulator.substeps,
            linear_hold=simulator.linear_hold,
        )
        found = _fitted(trace, shorter.with_parameters(kept))
        if found is not None and found[1] <= max(2 * error, NOTHING):
            best = found
    return best

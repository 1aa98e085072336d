"""Differential equations fitted to a simulated output: what is common to all that may stand behind one."""

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple, Self, TypeVar

import numpy as np

from narx_sklearn._validation import as_signals, column_labels, signal_names, split_unit
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.fitting.start import fit_initial_states
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.simulators.simulator import Signal, Simulator, Windows
from narx_sklearn.discrepancy.simulators.windows import WINDOWS, cut
from narx_sklearn.model.units import tidy_unit

STEP = 0.25  # of the fastest pole's time, in an integration step: errors of 1e-5 of what it moves
MOST_STEPS = 8  # in a sample; what is faster than that answers within the sample, and is no motion
SHORTEST = 50  # samples of a window, from which the first fit begins
NOTHING = 1e-6  # of the output's spread: what a term that leaves no more is worth
LONG_ENOUGH = 16  # samples of a stretch


class Trace(NamedTuple):
    """A simulated output, the inputs that led to it, and what they are called."""

    u: np.ndarray  # (n_samples, n_inputs)
    y: np.ndarray  # (n_samples, 1)
    training: Windows  # one window for each stretch that is fitted
    held_out: Windows
    inputs: tuple[Signal, ...]
    output: Signal
    dt: float


class TracedEquation(Simulator):
    """Base of the equations that a trace can be fitted with: one output, linear in most of its terms.

    A subclass is made from its shape, terms, inputs and output, and how it runs, as ``_like`` does.
    """

    terms: tuple[str, ...]

    def known_states(self, u, y, samples, began=None):
        """Return the output as measured; no other state is known."""
        known = np.full((samples.size, len(self.states)), np.nan)
        known[:, self.states.index(self.outputs[0])] = y[samples, 0]
        return known

    @abstractmethod
    def first_states(self, y: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Return a guess of the states (n, n_states) where the output and its slope (n,) are these."""

    def _like(self, shape, terms: Sequence[str]) -> Self:
        """Return an equation of another shape that runs as this one, with its values where both have one."""
        make: Any = type(self)
        how = {"dt": self.dt, "substeps": self.substeps, "linear_hold": self.linear_hold}
        other = make(shape, terms, self.inputs, self.outputs[0], **how)
        names = {p.name for p in other.parameters}
        return other.with_parameters({p.name: p.value for p in self.parameters if p.name in names})

    @abstractmethod
    def with_terms(self, kept: Sequence[str]) -> Self | None:
        """Return the equation with no other terms, at the same values; None where it needs the others."""


Equation = TypeVar("Equation", bound=TracedEquation)


def read_trace(u, y_sim, labels: np.ndarray, dt: float) -> Trace | None:
    """Return a trace of one output without gaps; None where it is none, or short.

    Parameters
    ----------
    u, y_sim : array-like or DataFrame of shape (n_samples, n_inputs) and (n_samples, 1)
    labels : ndarray of shape (n_samples,)
        Even where the trace may be fitted, odd where it is held out; a label for each stretch.
    dt : float
        Sampling period, s.

    Returns
    -------
    Trace or None
    """
    values, y = as_signals(u, "u"), as_signals(y_sim, "y_sim")
    if y.shape[1] != 1 or not (np.isfinite(values).all() and np.isfinite(y).all()):
        return None
    edges = np.flatnonzero(np.diff(labels, prepend=labels[0] - 1, append=labels[-1] + 1))
    pieces = [slice(int(a), int(b)) for a, b in pairwise(edges)]
    fitted, held_out = ([p for p in pieces if labels[p.start] % 2 == odd] for odd in (0, 1))
    if min((p.stop - p.start for p in pieces), default=0) < LONG_ENOUGH:
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


def quotient(above: str, below: str) -> str:
    """Return the unit of a quotient, empty where one of the units is not known."""
    return tidy_unit(f"({above})/({below})") if above and below else ""


class LinearMap(NamedTuple):
    """What the map y[k] = sum a_i y[k-i] + sum b_i u[k-i] + c through a trace says in continuous time."""

    poles: np.ndarray  # (order,) 1/s
    gains: np.ndarray  # (n_inputs,) of the output at rest by each input
    substeps: int  # integration steps in a sample that its fastest pole needs


def linear_map(trace: Trace, order: int) -> LinearMap | None:
    """Return the linear map of an order through a trace.

    None where its poles are not those of an equation of that order, or answer within a sample.
    """
    rows, wanted = [], []
    for a, b in zip(trace.training.first, trace.training.last, strict=True):
        lags = [trace.y[a + order - i : b - i] for i in range(1, order + 1)]
        lags += [trace.u[a + order - i : b - i] for i in range(order + 1)]
        rows.append(np.hstack([*lags, np.ones((b - a - order, 1))]))
        wanted.append(trace.y[a + order : b, 0])
    matrix = np.vstack(rows)
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0] = 1.0
    values = np.linalg.lstsq(matrix / size, np.concatenate(wanted), rcond=None)[0] / size
    a, b = values[:order], values[order:-1].reshape(order + 1, -1)
    with np.errstate(divide="ignore", invalid="ignore"):
        poles = np.log(np.roots([1.0, *-a]).astype(complex)) / trace.dt
        gains = b.sum(axis=0) / (1.0 - a.sum())
    fastest = np.abs(poles).max(initial=0.0)
    substeps = int(np.ceil(fastest * trace.dt / STEP)) if np.isfinite(fastest) else MOST_STEPS + 1
    if poles.size < order or substeps > MOST_STEPS or np.any(poles.imag * trace.dt >= np.pi):
        return None
    return LinearMap(poles, gains, max(substeps, 1))


def best_fitted(
    trace: Trace, rounds: Iterable[Iterable[Equation]], good_enough: float
) -> tuple[Equation, float] | None:
    """Return the equation that runs most like a trace, and its error, fitted from one round of starts after
    another until one is good enough; None where none could be fitted."""
    best = None
    for starts in rounds:
        for start in starts:
            found = fitted(trace, start)
            if found is not None and (best is None or found[1] < best[1]):
                best = found
        if best is not None and best[1] < good_enough:
            break
    return best


def fitted(trace: Trace, simulator: Equation) -> tuple[Equation, float] | None:
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


def _first_states(trace: Trace, simulator: TracedEquation, windows: Windows) -> np.ndarray:
    """Return the states where windows begin, from the output and its slope there."""
    y = trace.y[windows.first, 0]
    return simulator.first_states(y, (trace.y[windows.first + 1, 0] - y) / trace.dt)


def without_idle_terms(trace: Trace, simulator: Equation, error: float) -> tuple[Equation, float]:
    """Leave out the terms without which the equation runs like the trace as well."""
    best = simulator, error
    for term in simulator.parameters[::-1]:
        shorter = best[0].with_terms([p.name for p in best[0].parameters if p.name != term.name])
        best = as_good(trace, shorter, error) or best
    return best


def as_good(trace: Trace, simulator: Equation | None, error: float) -> tuple[Equation, float] | None:
    """Return an equation, fitted, and its error if it runs like the trace as well as one with this error."""
    found = None if simulator is None else fitted(trace, simulator)
    return found if found is not None and found[1] <= max(2 * error, NOTHING) else None

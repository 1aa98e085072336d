"""What an unknown force may follow: the signals of a run, their rates and directions, now and before."""

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.locate import Tangent
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.simulators.simulator import Run
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.physics.effects._series import by_pieces

BEFORE = (0, 1, 4, 16, 64)  # samples ago
SHAPES = 12  # half turns over the range of a signal: what is finer, no broken line of 13 knots follows
FORGOTTEN = (16, 64, 256)  # samples in which what is remembered falls to 1/e
SEVERAL = 10  # such times that a session must have room for
ENDS = 0.005  # share of the samples beyond either end of a signal's range


class Followed(NamedTuple):
    """A signal that something may follow, of mean zero."""

    words: str  # "position [m]", "the direction of drive [V] 4 samples before"
    values: np.ndarray  # (n_samples,)
    of: tuple[int, ...]  # places of the signals it is made of: inputs first, then states

    def is_at_home(self, port: Port, structure: Structure) -> bool:
        """Tell whether it is told at a port, where that does the same as another.

        What is added to an input that enters one equation alone is what is added there. It is told at the
        input if it follows that input, and else in the equation.
        """
        n_inputs = structure.inputs.shape[1]
        entered = structure.inputs.sum(axis=0) + structure.read[:, :n_inputs].sum(axis=0)
        the_same = (entered == 1) & ~structure.varies.any(axis=0)
        if port.kind == "input":
            return not the_same[port.index] or self.of == (port.index,)
        is_of_an_input = len(self.of) == 1 and self.of[0] < n_inputs
        if port.kind == "output" or not is_of_an_input:
            return True
        return not (the_same[self.of[0]] and structure.inputs[port.index, self.of[0]])


def followed(
    problem: Problem, run: Run, structure: Structure, n_shapes: int, shapes_before=(0,), *, past: int = 0
) -> list[Followed]:
    """Return functions of each input and state along a run, and what it was and how it moved before.

    Only simulated states and recorded inputs are looked at: recorded outputs hold the noise itself.

    Parameters
    ----------
    n_shapes : int
        Cosines of 1 to ``n_shapes`` half turns over a signal's range, which together are any curve.
    shapes_before : tuple of int
        How many samples ago the curves count.
    past : int, default=0
        Samples by which inputs are late at least. A controller writes the noise of a sample into the input
        of that sample, so what is compared with this sample's noise must look at inputs before it.
    """
    found: list[Followed] = []
    age = _age(problem)
    n_inputs = len(problem.simulator.inputs)
    rated = {n_inputs + i for i in structure.partner if i >= 0}  # their rates are states too
    for place, name, values, (low, high), late in _signals(problem, run, past):
        turns = np.pi * (np.clip(values, low, high) - low) / (high - low)
        for m in range(1, n_shapes + 1):
            found += _lagged(name, np.cos(m * turns), shapes_before, late, age, (place,))
        found += _lagged(name, values, BEFORE[1:], late, age, (place,))
        if place not in rated:
            change = np.where(age > 0, np.diff(values, prepend=np.nan), np.nan)
            found += _lagged(f"the rate of {name}", change, BEFORE, late, age, (place,))
            found += _lagged(f"how fast {name} moves", np.abs(change), BEFORE, late, age, (place,))
            found += _lagged(f"the direction of {name}", np.sign(change), BEFORE, late, age, (place,))
    return found


def followed_together(problem: Problem, run: Run, *, past: int = 0) -> list[Followed]:
    """Return products of every two inputs and states along a run, of second and third degree.

    What depends on two signals at once, as damping that differs by position, follows neither of them.

    Parameters
    ----------
    past : int, default=0
        As in :func:`followed`.
    """
    found: list[Followed] = []
    age = _age(problem)
    for one, other in combinations(_signals(problem, run, past), 2):
        late = max(one.late, other.late)
        a, b = (np.clip(s.values, *s.range) - np.mean(s.range) for s in (one, other))
        for squared, also, values in (
            ("", "", a * b),
            (" squared", "", a * a * b),
            ("", " squared", a * b * b),
        ):
            words = f"{one.name}{squared} times {other.name}{also}"
            found += _lagged(words, values, BEFORE[:1], late, age, (one.place, other.place))
    return found


def followed_slowly(problem: Problem, run: Run, *, past: int = 0) -> list[Followed]:
    """Return what is left, after a while, of the square and the cube of each input and state along a run.

    What heats up, fades or has to recover follows neither what is, nor what was some samples before.

    Parameters
    ----------
    past : int, default=0
        As in :func:`followed`.
    """
    found: list[Followed] = []
    age = _age(problem)
    for signal in _signals(problem, run, past):
        moved = np.nan_to_num(np.clip(signal.values, *signal.range) - np.mean(signal.range))
        for power, said in ((2, "square"), (3, "cube")):
            for time in (t for t in FORGOTTEN if SEVERAL * t < age.max()):
                words = f"the {said} of {signal.name}, forgotten within {time} samples"
                left = by_pieces(_remembered, moved**power, problem.windows.began, np.exp(-1.0 / time))
                found += _lagged(words, left, BEFORE[:1], signal.late, age, (signal.place,))
    return found


def _remembered(values: np.ndarray, kept: float) -> np.ndarray:
    """Return the mean of what came before, each value counting ``kept`` times the next."""
    return lfilter([1.0 - kept], [1.0, -kept], values)


class _Signal(NamedTuple):
    place: int  # inputs first, then states
    name: str
    values: np.ndarray  # (n_samples,), NaN in gaps and outside windows
    range: tuple[float, float]
    late: int


def _signals(problem: Problem, run: Run, past: int) -> Iterator[_Signal]:
    """Yield each input and state that moves."""
    signals = [(str(s), problem.u[:, i], past) for i, s in enumerate(problem.simulator.inputs)]
    signals += [(str(s), run.x[:, i], 0) for i, s in enumerate(problem.simulator.states)]
    for i, (name, values, late) in enumerate(signals):
        seen = values[problem.rows[problem.inside]]
        low, high = np.nanquantile(seen, [ENDS, 1 - ENDS])
        if high > low:
            yield _Signal(i, name, np.where(np.isfinite(values), values, np.nan), (low, high), late)


def _age(problem: Problem) -> np.ndarray:
    """Return how many samples of its session lie before each sample."""
    index = np.arange(len(problem.u))
    began = np.zeros_like(index)
    began[problem.windows.began] = problem.windows.began
    return index - np.maximum.accumulate(began)


def _lagged(
    words: str, values: np.ndarray, before, late: int, age: np.ndarray, of: tuple[int, ...]
) -> Iterator[Followed]:
    """Yield values as they were some samples before; what is not known of the session is the mean, zero."""
    if not np.isfinite(values).any():
        return
    centred = values - np.nanmean(values)
    size = np.nanstd(centred)
    centred = np.nan_to_num(centred)
    for lag in sorted({max(lag, late) for lag in before if lag < centred.size}):
        shifted = np.where(age >= lag, np.roll(centred, lag), 0.0)
        ago = f" {lag} sample{'s' * (lag > 1)} before" * (lag > 0)
        yield Followed(words + ago, shifted / size if size > 0 else shifted, of)


def response(problem: Problem, linear: Tangent, port: Port, forces: np.ndarray) -> np.ndarray:
    """Return how the outputs answer to small forces at a port, (n_samples, n_outputs, n_forces).

    Parameters
    ----------
    linear : Tangent
        Along the run.
    forces : ndarray of shape (n_samples, n_forces)
    """
    out = np.zeros((forces.shape[0], problem.y.shape[1], forces.shape[1]))
    if port.kind == "output":
        out[:, port.index] = forces
        return out
    at_input = port.kind == "input"
    into = (linear.B if at_input else linear.G)[:, :, port.index]
    shown = linear.D if at_input else linear.F  # at once
    dx = np.zeros((problem.windows.count, linear.A.shape[1], forces.shape[1]))
    for k, inside in zip(problem.rows.T, problem.inside.T, strict=True):  # all windows abreast
        k, dx = k[inside], dx[inside] if not inside.all() else dx
        w = forces[k][:, None, :]
        out[k] = linear.C[k] @ dx
        if shown is not None:
            out[k] += shown[k][:, :, port.index][:, :, None] * w
        ahead = np.nan_to_num(linear.A[k] @ dx + into[k][:, :, None] * w)
        dx = np.zeros((inside.size, *ahead.shape[1:]))
        dx[inside] = ahead
    return np.nan_to_num(out)

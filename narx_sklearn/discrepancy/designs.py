"""Inputs that an experiment may use: within limits of amplitude, length and rate, slow and fast."""

from collections.abc import Iterator
from itertools import combinations
from numbers import Integral, Real
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.simulators.simulator import Simulator, Windows
from narx_sklearn.discrepancy.simulators.windows import find_pace, resonances
from narx_sklearn.signals import loading_unloading, multisine

PACES = (0.3, 1.0, 3.0, 10.0, 30.0)  # of designs, times the simulator's
SLOWEST = 2.0  # periods of the slowest sine in an experiment
NARROWEST = 1.5  # times that, up to which a multisine goes at least
EVEN = (0.25, 0.5, 0.75, 1.0)  # amplitudes, each for as long: what bends shows in how they differ
FASTEST = 0.4  # of the sampling frequency: a little below half of it
EACH = 4  # samples at least for each initial state and parameter, which are refitted
RESONANT = 0.25  # damping ratio below which a mode answers at least twice as much as to what is slow
AROUND = 1.5  # times a resonance, and as much below it, that a multisine about it goes
AT_REST = 0.05  # of all that a state moved, that it may still move in the last quarter of a run


class Limits(NamedTuple):
    """What an experiment may do with one input: checked, see :func:`read_limits`."""

    amplitude: float  # largest departure from the offset
    n_samples: int
    offset: float  # where the experiment begins, and about which the input moves
    rate: float | None  # largest change in one second, None for any
    column: int  # the input that is moved

    def signal(self, shape: np.ndarray, dt: float) -> np.ndarray:
        """Return the input of a shape within -1 and 1; it leaves the offset no faster than it may.

        Examples
        --------
        >>> import numpy as np
        >>> Limits(2.0, 3, 10.0, 5.0, 0).signal(np.array([1.0, 1.0, -1.0]), dt=0.2).tolist()
        [11.0, 12.0, 11.0]
        """
        wanted = self.amplitude * shape
        if self.rate is None:
            return self.offset + wanted
        out, before, most = np.empty_like(wanted), 0.0, self.rate * dt
        for k, value in enumerate(wanted):
            out[k] = before = before + np.clip(value - before, -most, most)
        return self.offset + out


def read_limits(
    simulator: Simulator,
    amplitude: float,
    n_samples: int,
    *,
    offset: float = 0.0,
    rate: float | None = None,
    column: int = 0,
) -> Limits:
    """Return the limits of an experiment on a simulator.

    Raises
    ------
    TypeError
        If one of them is not a number, or ``n_samples`` or ``column`` no integer.
    ValueError
        If ``amplitude`` or ``rate`` is not positive and finite, ``offset`` not finite, the simulator has no
        such column, or ``n_samples`` is too short for what is refitted.
    """
    column = read_column(simulator, column)
    amplitude = _positive(amplitude, "amplitude", "the largest departure of the input from offset")
    offset = _number(offset, "offset")
    if not np.isfinite(offset):
        raise ValueError(f"offset is {offset!r}; wanted is the finite value about which the input moves.")
    if rate is not None:
        rate = _positive(rate, "rate", "the largest change of the input in one second, or None for no limit")
    if not isinstance(n_samples, Integral) or isinstance(n_samples, bool):
        raise TypeError(f"n_samples is {n_samples!r}; wanted is an integer number of samples.")
    least = fewest_samples(simulator)
    if n_samples < least:
        raise ValueError(
            f"n_samples is {n_samples}, too short for an experiment: the simulator's initial states and "
            f"parameters are refitted to it. Pass at least {least} samples."
        )
    return Limits(amplitude, int(n_samples), offset, rate, column)


def fewest_samples(simulator: Simulator) -> int:
    """Return the number of samples below which nothing is left once all that is refitted was."""
    return EACH * (int(simulator.free_states.sum()) + len(simulator.parameters) + 1)


def read_column(simulator: Simulator, column: int) -> int:
    """Return which input is moved."""
    inputs = ", ".join(f"{i}: {signal}" for i, signal in enumerate(simulator.inputs))
    wanted = f"wanted is the number of one of the inputs, {{{inputs}}}."
    if not isinstance(column, Integral) or isinstance(column, bool):
        raise TypeError(f"column is {column!r}; {wanted}")
    if not 0 <= column < len(simulator.inputs):
        raise ValueError(f"column is {column}; {wanted}")
    return int(column)


def _positive(value, name: str, meaning: str) -> float:
    value = _number(value, name)
    if not 0 < value < np.inf:
        raise ValueError(f"{name} is {value!r}; wanted is a positive and finite number, {meaning}.")
    return value


def _number(value, name: str) -> float:
    if not isinstance(value, Real) or isinstance(value, bool):
        raise TypeError(f"{name} is {value!r}; wanted is a number.")
    return float(value)


def settled(simulator: Simulator, u: np.ndarray, n: int) -> np.ndarray:
    """Return the states (n_states,) to which n samples of a constant input lead; ``x0`` without a rest."""
    windows = Windows.whole([slice(0, n)])
    x = simulator.run(np.tile(u, (n, 1)), windows, simulator.x0[None]).x
    with np.errstate(invalid="ignore", over="ignore"):
        late, all_along = np.ptp(x[-(n // 4) - 1 :], axis=0), np.ptp(x, axis=0)
    return x[-1] if np.all(late <= AT_REST * all_along) else simulator.x0


def make_designs(
    simulator: Simulator, x: np.ndarray, base: np.ndarray, limits: Limits, random_state=None
) -> list[tuple[str, np.ndarray]]:
    """Return inputs, each in words and as (n_samples, n_inputs): one column moves, the others stay at base.

    How slow and fast they are is measured by the pace of the simulator at states x.
    """
    found = []
    for kind, shape in _shapes(simulator, x, base, limits.n_samples, random_state):
        u = np.tile(base, (limits.n_samples, 1))
        u[:, limits.column] = limits.signal(shape, simulator.dt)
        found.append((kind, u))
    return found


def spliced(designs: list[tuple[str, np.ndarray]], limits: Limits, dt: float) -> list[tuple[str, np.ndarray]]:
    """Return every two inputs in one: the first half of one, the second half of the other.

    What two inputs leave alike differs from one to the other, so both together often tell more than either.
    """
    half, found = limits.n_samples // 2, []
    for (one, first), (other, second) in combinations(designs, 2):
        u = np.concatenate([first[:half], second[half:]])
        u[:, limits.column] = limits.signal((u[:, limits.column] - limits.offset) / limits.amplitude, dt)
        found.append((f"{one}; in the second half {other}", u))
    return found


def _shapes(
    simulator: Simulator, x: np.ndarray, u: np.ndarray, n: int, random_state
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield (words, signal within -1 and 1): slow and fast, small and large, with and without steps."""
    dt = simulator.dt
    rng = np.random.default_rng(random_state)
    with np.errstate(all="ignore"):
        constant = find_pace(simulator, x[None], u[None]).time_constant
    corner = 1 / (2 * np.pi * constant) if constant > 0 else 20 / (n * dt)
    ladder = np.repeat([0.1, 0.25, 0.5, 1.0], -(-n // 4))[:n]
    even = np.repeat(EVEN, -(-n // len(EVEN)))[:n]
    low = SLOWEST / (n * dt)
    tops = np.unique(np.minimum(np.array(PACES) * corner, FASTEST / dt))
    # a machine far slower than the experiment is long: all that the experiment has room for is slow
    if tops[-1] > NARROWEST * low:
        tops = tops[tops > NARROWEST * low]
    else:
        tops = np.array([min(2 * NARROWEST * low, FASTEST / dt)])
    for top in tops:
        wave = multisine(n, dt, band=(low, top), random_state=int(rng.integers(2**31)))
        wave = wave / np.max(np.abs(wave))
        yield f"multisine up to {top:.3g} Hz", wave
        yield f"multisine up to {top:.3g} Hz, amplitude in four steps", wave * ladder
        hold = max(2, int(0.25 / (top * dt)))
        steps = np.repeat(rng.uniform(-1, 1, -(-n // hold)), hold)[:n]
        jumps = np.repeat(rng.choice([-1.0, 1.0], -(-n // hold)), hold)[:n]
        yield f"random steps held {hold * dt:.3g} s", steps
        yield f"random steps held {hold * dt:.3g} s, amplitude in four steps", steps * ladder
        yield f"random jumps between two levels, held {hold * dt:.3g} s", jumps
        yield f"random jumps between two levels, held {hold * dt:.3g} s, four amplitudes", jumps * even
        sine = np.sin(2 * np.pi * top / 3 * dt * np.arange(n))
        yield f"sine of {top / 3:.3g} Hz, amplitude in four steps", sine * ladder
        # nothing within the limits moves a machine farther than what turns about with it
        square = np.where(sine >= 0, 1.0, -1.0)
        yield f"square wave of {top / 3:.3g} Hz, four amplitudes", square * even
    with np.errstate(all="ignore"):
        swinging = resonances(simulator, x, u, RESONANT)
    for mode in swinging[(swinging > low) & (swinging < FASTEST / dt)]:
        # what bends a spring or damps it moves a resonance with the amplitude, and shows nowhere as much
        sine = np.sin(2 * np.pi * mode * dt * np.arange(n))
        yield f"sine of {mode:.3g} Hz, a resonance, amplitude in four steps", sine * ladder
        band = max(mode / AROUND, low), min(mode * AROUND, FASTEST / dt)
        if band[1] - band[0] > 2 / (n * dt):
            wave = multisine(n, dt, band=band, random_state=int(rng.integers(2**31)))
            wave = wave / np.max(np.abs(wave))
            yield f"multisine round the resonance of {mode:.3g} Hz, amplitude in four steps", wave * ladder
    for turns in (4, 12):
        branch = max(2, n // (2 * turns))
        triangle = loading_unloading([-1.0, 1.0], branch, n_periods=turns + 1)
        triangle = np.asarray(getattr(triangle, "u", triangle), dtype=float)[:n]
        if triangle.size == n:
            yield f"slow triangle, {turns} times up and down", triangle
            yield f"slow triangle, {turns} times, amplitude in four steps", triangle * ladder

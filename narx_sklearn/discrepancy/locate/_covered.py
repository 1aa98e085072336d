"""The samples inside windows, and how an unknown signal enters there, as the kernels take them."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.locate._kalman import initial_energy
from narx_sklearn.discrepancy.locate.tangent import Tangent
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.windows import FEWEST_VALUES

DIFFUSE = 1e4  # variance of a free initial deviation over what the residual could ask of it
SEARCH_SAMPLES = 2000  # windows with about this many samples settle the two variances
LONGEST_PIECE = 1000  # samples of a window that the search takes at a time


class Covered(NamedTuple):
    """The samples inside windows, in order of time, as the kernels take them; outputs in units of a scale."""

    samples: np.ndarray  # (n,) indices into the record
    seam: np.ndarray  # (n,) what follows: 0 next sample, n > 0 new window n samples later, -1 new session
    A: np.ndarray
    C: np.ndarray
    b: np.ndarray  # (n, n_outputs, 1)
    start: np.ndarray  # (n_states,) variance of a free initial deviation
    n_free: int  # initial deviations that are estimated, over all windows

    @property
    def observed(self) -> int:
        """Number of residuals that are not NaN."""
        return int(np.isfinite(self.b).sum())

    def shown(self, dx: np.ndarray) -> np.ndarray:
        """Return what deviations of the states do to the outputs, in units of their scale."""
        return np.einsum("koi,ki->ko", self.C, dx)

    def in_record(self, values: np.ndarray, n: int, elsewhere: float = np.nan) -> np.ndarray:
        """Return values of the covered samples at their place in a record of n samples."""
        out = np.full((n, *values.shape[1:]), elsewhere)
        out[self.samples] = values
        return out


class Entry(NamedTuple):
    """Where and how an unknown signal may enter.

    Attributes
    ----------
    port : Port
        Where it acts.
    times : ndarray of shape (n_samples,), optional
        What it is in proportion to, with an unknown factor; nothing, where it adds.
    onward, share : int, float
        State equation, if any, at which a share of it is taken off: forces between two bodies act on both.
    """

    port: Port
    times: np.ndarray | None = None
    onward: int = -1
    share: float = 0.0


class Entrance(NamedTuple):
    """What a unit of an unknown signal does at each covered sample."""

    g: np.ndarray  # (n, n_states) to the next states
    d: np.ndarray  # (n, n_outputs) to the outputs at once, in units of their scale

    @classmethod
    def of(cls, linear: Tangent, covered: Covered, entry: Entry, scale: np.ndarray) -> "Entrance":
        """Return the entrance of a signal, and of the share of it that is taken off elsewhere."""
        found = cls.at_port(linear, covered, entry.port, scale)
        if entry.onward >= 0:
            there = cls.at_port(linear, covered, Port("state", entry.onward), scale)
            found = cls(found.g - entry.share * there.g, found.d - entry.share * there.d)
        if entry.times is None:
            return found
        signal = entry.times[covered.samples, None]
        return cls(found.g * signal, found.d * signal)

    @classmethod
    def at_port(cls, linear: Tangent, covered: Covered, port: Port, scale: np.ndarray) -> "Entrance":
        """Return the entrance of what is added at a port."""
        n_states, n_inputs, n_outputs = linear.A.shape[2], linear.B.shape[2], linear.C.shape[1]
        of_parameters = None if linear.P is None or linear.Q is None else (linear.P, linear.Q)
        n_parameters = 0 if of_parameters is None else of_parameters[0].shape[2]
        sizes = {"input": n_inputs, "state": n_states, "output": n_outputs}
        size = n_parameters if port.is_parameter else sizes.get(port.kind, 0)
        if not 0 <= port.index < size:
            raise ValueError(
                f"port {port} does not exist: the simulator has {n_inputs} inputs, {n_states} state "
                f"equations and {n_outputs} outputs, counted from zero."
            )
        found = cls.closed(covered)
        if port.kind == "input":
            found.g[:] = linear.B[covered.samples, :, port.index]
            found.d[:] = linear.D[covered.samples, :, port.index] / scale
        elif port.kind == "state":
            found.g[:] = linear.G[covered.samples, :, port.index]
            if linear.F is not None:
                found.d[:] = linear.F[covered.samples, :, port.index] / scale
        elif of_parameters is not None and port.is_parameter:
            P, Q = of_parameters
            found.g[:], found.d[:] = (
                P[covered.samples, :, port.index],
                Q[covered.samples, :, port.index] / scale,
            )
        else:
            found.d[:, port.index] = 1.0 / scale[port.index]
        return found

    @classmethod
    def closed(cls, covered: Covered) -> "Entrance":
        """Return one through which nothing enters."""
        n = covered.samples.size
        return cls(np.zeros((n, covered.A.shape[1])), np.zeros((n, covered.b.shape[1])))

    def at(self, rows: np.ndarray) -> "Entrance":
        """Return the entrance at some of the covered samples."""
        return Entrance(self.g[rows], self.d[rows])


def cover(linear: Tangent, residual: np.ndarray, windows: Windows, scale: np.ndarray) -> Covered:
    """Return the samples inside windows as the kernels take them, outputs divided by ``scale``."""
    n = residual.shape[0]
    window = np.full(n, -1, dtype=np.int64)
    for i, (first, last) in enumerate(zip(windows.first, windows.last, strict=True)):
        window[first:last] = i
    usable = (window >= 0) & np.isfinite(linear.A).all(axis=(1, 2)) & np.isfinite(linear.C).all(axis=(1, 2))
    samples = np.flatnonzero(usable)
    b = np.ascontiguousarray(residual[samples] / scale)[:, :, None]
    if np.isfinite(b).sum() < FEWEST_VALUES:
        raise ValueError(
            f"residual has {np.isfinite(b).sum()} values inside the windows; locating a force takes at least "
            f"{FEWEST_VALUES}. Pass a longer record, or windows in which the simulation stays finite."
        )
    ahead, apart = np.diff(samples), np.diff(window[samples])
    session = windows.began[window[samples]]
    seam = np.full(samples.size, -1, dtype=np.int64)
    seam[:-1] = np.where(np.diff(session) != 0, -1, np.where((ahead == 1) & (apart == 0), 0, ahead))
    A = np.ascontiguousarray(linear.A[samples])
    C = np.ascontiguousarray(linear.C[samples] / scale[:, None])
    energy = np.empty(A.shape[1])
    count = initial_energy(A, C, seam, energy)
    size = np.nanmean(b**2) * samples.size
    with np.errstate(divide="ignore", over="ignore"):
        start = np.where(energy > 1e-20 * energy.max(initial=0.0), DIFFUSE * max(size, 1e-12) / energy, 0.0)
    return Covered(samples, seam, A, C, b, start, count * int(np.count_nonzero(start)))


def thinned(covered: Covered) -> tuple[Covered, np.ndarray]:
    """Return evenly spread pieces of windows with about SEARCH_SAMPLES samples in all, and their rows."""
    n = covered.samples.size
    if n <= SEARCH_SAMPLES:
        return covered, np.arange(n)
    ends = np.flatnonzero(covered.seam) + 1
    edges = [0]
    for end in ends:
        edges += [*range(edges[-1] + LONGEST_PIECE, int(end), LONGEST_PIECE), int(end)]
    pieces = [np.arange(a, b) for a, b in pairwise(edges)]
    wanted = max(round(len(pieces) * SEARCH_SAMPLES / n), 1)
    chosen = [pieces[i] for i in np.unique(np.linspace(0, len(pieces) - 1, wanted).round().astype(int))]
    rows = np.concatenate(chosen)
    seam = covered.seam[rows].copy()
    lasts = np.cumsum([piece.size for piece in chosen]) - 1
    for i, last in enumerate(lasts[:-1]):
        new_session = np.any(covered.seam[chosen[i][-1] : chosen[i + 1][0]] < 0)
        seam[last] = -1 if new_session else covered.samples[rows[last + 1]] - covered.samples[rows[last]]
    seam[-1] = -1
    part = Covered(
        covered.samples[rows],
        seam,
        covered.A[rows],
        covered.C[rows],
        covered.b[rows],
        covered.start,
        len(chosen) * int(np.count_nonzero(covered.start)),
    )
    return part, rows

"""A record as arrays, its columns in the order of a simulator's signals, and what is held out of it."""

import warnings
from typing import NamedTuple

import numpy as np

from narx_sklearn._validation import (
    check_indexes,
    check_magnitude,
    finite_rows,
    finite_slices,
    session_slices,
)
from narx_sklearn.discrepancy.columns import read_columns, unlike_units
from narx_sklearn.discrepancy.records.finding import DataFinding
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.discrepancy.simulators.windows import FEWEST_VALUES, shortest_window
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.model.times import index_step, other_step, rows_out_of_line

Piece = tuple[slice, int]  # a stretch without gaps in the inputs, and the first sample of its session


class Split(NamedTuple):
    """Pieces to fit and pieces that are held out."""

    fitting: list[Piece]
    held_out: list[Piece]
    beginnings: bool  # whether those held out are the beginnings, not the ends

    def of_session(self, began: int) -> "Split":
        """Return the pieces of one session, which began at a sample."""
        fitting, held_out = ([p for p in pieces if p[1] == began] for pieces in self[:2])
        return self._replace(fitting=fitting, held_out=held_out)


def read_record(X, y, simulator: Simulator) -> tuple[np.ndarray, np.ndarray]:
    """Return inputs and outputs as arrays, in the order of the simulator's.

    Raises
    ------
    ValueError
        If columns or rows do not fit the simulator or each other, or values cannot be compared.
    """
    u, measured = read_inputs(X, simulator), read_outputs(y, simulator)
    if len(measured) != len(u):
        raise ValueError(f"X has {len(u)} samples and y has {len(measured)}; they must be of one length.")
    check_indexes(X, y)
    if len(simulator.inputs) and not finite_rows(u).any():
        bare = [str(s) for s, column in zip(simulator.inputs, u.T, strict=True) if np.isnan(column).all()]
        raise ValueError(
            f"X is NaN at every sample{f' of {bare}' if bare else ' in one input or another'}: NaN marks "
            "gaps, and nothing is left between them. Pass the recorded inputs."
        )
    for name, signals, values in (("X", simulator.inputs, u), ("y", simulator.outputs, measured)):
        for signal, column in zip(signals, values.T, strict=True):
            largest = float(np.nanmax(np.abs(column), initial=0.0))
            check_magnitude(largest, f"{name}'s column for {str(signal)!r}")
    return u, measured


def read_inputs(X, simulator: Simulator) -> np.ndarray:
    """Return inputs as an array, in the order of the simulator's."""
    u = read_columns(X, simulator.inputs, "X", "input")
    return np.require(u, requirements=["C", "W"])


def read_outputs(y, simulator: Simulator, name: str = "y") -> np.ndarray:
    """Return measured outputs as an array, in the order of the simulator's."""
    measured = read_columns(y, simulator.outputs, name, "output")
    return np.require(measured, requirements=["C", "W"])


def label_findings(X, y, simulator: Simulator, sessions=None) -> list[DataFinding]:
    """Return what the labels of a record say against the simulator: of units, and of time.

    Raises
    ------
    ValueError
        If time goes back in an index.
    """
    found = [
        DataFinding("units", words, evidence)
        for told in (
            unlike_units(X, simulator.inputs, "X", "input"),
            unlike_units(y, simulator.outputs, "y", "output"),
        )
        for words, evidence in told
    ]
    steps = [index_step(data, sessions, name) for data, name in ((X, "X"), (y, "y"))]
    step = next((step for step in steps if step is not None), None)
    words = _other_step(step, simulator)
    if words:
        found.append(DataFinding("time_scale", words, {"step": step, "dt": simulator.dt}))
    words = rows_out_of_line(X, sessions, "X") or rows_out_of_line(y, sessions, "y")
    if words:
        found.append(DataFinding("rows", words))
    return found


def warn_of_step(X, simulator: Simulator, sessions=None) -> None:
    """Warn where the time index of inputs advances by another step than the simulator."""
    words = _other_step(index_step(X, sessions, "X"), simulator)
    if words:
        warnings.warn(words, NarxWarning, stacklevel=3)


def _other_step(step: float | None, simulator: Simulator) -> str:
    remedy = (
        ""
        if step is None
        else f"Pass dt={step:.6g} to the simulator, resample the record, or drop the index."
    )
    return other_step(step, simulator.dt, "the simulator by dt", remedy)


def check_length(simulator: Simulator, u: np.ndarray, y: np.ndarray, sessions, test_fraction: float) -> None:
    """Raise where too few samples are left to fit to, held-out ones not counted."""
    pieces = pieces_of(u, sessions)
    shortest = shortest_window(simulator)
    fitting = [piece for piece, _ in hold_out(pieces, test_fraction).fitting]
    usable = [piece for piece in fitting if piece.stop - piece.start >= shortest]
    measured = np.isfinite(y) | ~np.isfinite(y).any()  # what is missing throughout is no matter of length
    seen = sum(int(measured[piece].sum()) for piece in usable)
    if seen >= FEWEST_VALUES:
        return
    needed = int(np.ceil(max(shortest, FEWEST_VALUES / y.shape[1]) / (1 - test_fraction)))
    longest = max((piece.stop - piece.start for piece, _ in pieces), default=0)
    if longest >= needed:
        raise ValueError(
            f"y has {seen} measured values where X has no gaps and nothing is held out; a diagnosis takes at "
            f"least {FEWEST_VALUES}. The others are NaN: pass a record in which more was measured."
        )
    raise ValueError(
        f"The record is too short: its longest stretch without gaps in X has {longest} samples, and a "
        f"diagnosis of this simulator takes at least {needed}. A fitting window needs {shortest} samples, "
        f"{FEWEST_VALUES} measured values in all, and test_fraction={test_fraction:g} of the samples is held "
        "out. Pass a longer record, some hundreds of samples to find anything."
    )


def pieces_of(u: np.ndarray, sessions) -> list[Piece]:
    """Return the stretches of a record without gaps in its inputs."""
    found = []
    finite = finite_rows(u)
    for session in session_slices(sessions, len(u)):
        found += [(piece, session.start) for piece in finite_slices([session], finite)]
    return found


def hold_out(pieces: list[Piece], share: float, *, beginnings: bool = False) -> Split:
    """Return pieces without their ends, or without their beginnings, and those."""
    split = Split([], [], beginnings)
    for piece, session in pieces:
        n_out = round(share * (piece.stop - piece.start))
        edge = piece.start + n_out if beginnings else piece.stop - n_out
        parts = slice(piece.start, edge), slice(edge, piece.stop)
        kept, out = reversed(parts) if beginnings else parts
        split.fitting.append((kept, session))
        if n_out > 1:
            split.held_out.append((out, session))
    return split

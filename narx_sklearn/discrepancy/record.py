"""A record as arrays, its columns in the order of a simulator's signals, and what is held out of it."""

from typing import NamedTuple

import numpy as np

from narx_sklearn._validation import (
    as_signals,
    column_labels,
    finite_rows,
    finite_slices,
    session_slices,
    split_unit,
)
from narx_sklearn.discrepancy.simulator import Simulator

Piece = tuple[slice, int]  # a stretch without gaps in the inputs, and the first sample of its session


class Split(NamedTuple):
    """Pieces to fit and pieces that are held out."""

    fitting: list[Piece]
    held_out: list[Piece]


def read_record(X, y, simulator: Simulator) -> tuple[np.ndarray, np.ndarray]:
    """Return inputs and outputs as arrays, in the order of the simulator's."""
    u = read_inputs(X, simulator)
    measured = np.require(as_signals(y, "y"), requirements=["C", "W"])
    if len(measured) != len(u):
        raise ValueError(f"X has {len(u)} samples and y has {len(measured)}; they must be of one length.")
    if measured.shape[1] != len(simulator.outputs):
        raise ValueError(
            f"y has {measured.shape[1]} columns, the simulator has {len(simulator.outputs)} outputs: "
            f"{[str(s) for s in simulator.outputs]}."
        )
    return u, measured


def read_inputs(X, simulator: Simulator) -> np.ndarray:
    """Return inputs as an array, in the order of the simulator's."""
    wanted = [signal.name for signal in simulator.inputs]
    labels = column_labels(X)
    if hasattr(X, "columns") and labels is not None:
        names = [split_unit(label)[0] for label in labels]
        missing = [name for name in wanted if name not in names]
        if not missing:
            X = X.iloc[:, [names.index(name) for name in wanted]]
        elif len(names) != len(wanted) or any(name in names for name in wanted):
            raise ValueError(
                f"X lacks the columns {missing}; it has {names}, the simulator's inputs are {wanted}."
            )
    u = np.require(as_signals(X, "X"), requirements=["C", "W"])
    if u.shape[1] != len(wanted):
        raise ValueError(f"X has {u.shape[1]} columns, the simulator has {len(wanted)} inputs: {wanted}.")
    return u


def pieces_of(u: np.ndarray, sessions) -> list[Piece]:
    """Return the stretches of a record without gaps in its inputs."""
    found = []
    finite = finite_rows(u)
    for session in session_slices(sessions, len(u)):
        found += [(piece, session.start) for piece in finite_slices([session], finite)]
    return found


def hold_out(pieces: list[Piece], share: float, *, beginnings: bool = False) -> Split:
    """Return pieces without their ends, or without their beginnings, and those."""
    split = Split([], [])
    for piece, session in pieces:
        n_out = round(share * (piece.stop - piece.start))
        edge = piece.start + n_out if beginnings else piece.stop - n_out
        parts = slice(piece.start, edge), slice(edge, piece.stop)
        kept, out = reversed(parts) if beginnings else parts
        split.fitting.append((kept, session))
        if n_out > 1:
            split.held_out.append((out, session))
    return split

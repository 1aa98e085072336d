"""Which columns of a table are inputs, outputs and simulated outputs."""

import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from narx_sklearn._validation import session_slices, split_unit
from narx_sklearn.cli._errors import DataError, UsageError
from narx_sklearn.cli._sampling import find_column, sample_evenly
from narx_sklearn.cli._tables import Table, read_table
from narx_sklearn.model.dead_values import dead_columns, dead_in_record
from narx_sklearn.model.times import same_period

INPUT = re.compile(r"(u|input|drive|in)_?\d*$", re.IGNORECASE)
OUTPUT = re.compile(r"(y|output|measured|y_?meas(ured)?|out)_?\d*$", re.IGNORECASE)
SIMULATED = re.compile(r"(y_?sim(ulated)?|sim(ulated|ulation)?|y_?model|y_?hat)_?\d*$", re.IGNORECASE)


class Recording(NamedTuple):
    """A recording ready for use.

    Attributes
    ----------
    u, y : DataFrame of shape (n_samples, n_inputs), (n_samples, n_outputs)
        Inputs and outputs, labelled as in the file.
    y_sim : DataFrame or None
        Simulated outputs.
    dt : float or None
        Sampling period, s.
    sessions : ndarray of shape (n_samples,)
        One number a sample.
    notes : tuple of str
        What was guessed or seen on reading.
    time : str or None
        Label of the column of numbers that told the time; None where an option or time stamps did.
    """

    u: pd.DataFrame
    y: pd.DataFrame
    y_sim: pd.DataFrame | None
    dt: float | None
    sessions: np.ndarray
    notes: tuple[str, ...]
    time: str | None = None


def read_recording(source: str, options, *, simulated: bool = False, inputs=(), outputs=()) -> Recording:
    """Read a recording by the options of a command.

    Parameters
    ----------
    source : str
        File, or ``-``.
    options : namespace
        With ``u``, ``y``, ``y_sim``, ``time``, ``session``, ``dt``, ``resample``.
    simulated : bool, default=False
        Whether a simulated output must be among the columns.
    inputs, outputs : sequence of str
        Names that a simulator gives to its signals, tried before the usual ones.

    Returns
    -------
    Recording
    """
    table = read_table(source)
    sampled = sample_evenly(
        table, dt=options.dt, time=options.time, session=options.session, resample=options.resample
    )
    u, y, y_sim = choose_columns(table, sampled.frame, options, simulated, inputs, outputs)
    notes = [*sampled.notes, f"Inputs: {', '.join(u)}. Outputs: {', '.join(y)}."]
    chosen = pd.concat([u, y] + ([y_sim] if y_sim is not None else []), axis=1)
    _check_values(chosen, table.source)
    _check_motion(y, table.source)
    missing = int(chosen.isna().any(axis=1).sum())
    if missing:
        notes.append(
            f"{missing} of {len(chosen)} samples lack a value; they are left out, nothing is filled in."
        )
    return Recording(u, y, y_sim, sampled.dt, sampled.sessions, tuple(notes), sampled.time)


def read_recordings(
    sources: Sequence[str], options, *, simulated: bool = False, inputs=(), outputs=()
) -> Recording:
    """Read recordings of one machine, each another session, as one.

    Parameters
    ----------
    sources : sequence of str
        Files; one of them may be ``-``.
    options, simulated, inputs, outputs
        As in ``read_recording``.

    Returns
    -------
    Recording

    Raises
    ------
    UsageError
        If a source is named twice.
    DataError
        If the recordings differ in their columns, units or sampling periods.
    """
    twice = [source for source, count in Counter(sources).items() if count > 1]
    if twice:
        raise UsageError(
            f"{'Standard input' if twice[0] == '-' else twice[0]} is named twice; a recording counts once."
        )
    read = [
        read_recording(source, options, simulated=simulated, inputs=inputs, outputs=outputs)
        for source in sources
    ]
    if len(read) == 1:
        return read[0]
    called = ["standard input" if source == "-" else source for source in sources]
    first = read[0]
    for source, other in zip(called[1:], read[1:], strict=True):
        for what in ("u", "y") + ("y_sim",) * simulated:
            ours, theirs = (list(getattr(recording, what)) for recording in (first, other))
            _check_same_columns(ours, theirs, f"--{what.replace('_', '-')}", called[0], source)
        _check_same_period(first.dt, other.dt, called[0], source)
    lengths = [len(recording.u) for recording in read]
    offsets = np.cumsum([0] + [recording.sessions[-1] + 1 for recording in read[:-1]])
    periods = [recording.dt for recording in read if recording.dt is not None]
    return Recording(
        _joined([recording.u for recording in read]),
        _joined([recording.y for recording in read]),
        _joined([r.y_sim for r in read if r.y_sim is not None]) if simulated else None,
        float(np.average(periods, weights=lengths)) if periods else None,
        np.concatenate([r.sessions + offset for r, offset in zip(read, offsets, strict=True)]),
        _notes_together([recording.notes for recording in read], called),
        first.time,
    )


def without_dead_values(recording: Recording) -> Recording:
    """Return a recording whose dead values are missing, with a note of each column that had such."""
    u, y = (table.to_numpy(dtype=float) for table in (recording.u, recording.y))
    dead = dead_in_record(u, y)
    found = dead_columns(map(repr, recording.u), u, dead.u) + dead_columns(map(repr, recording.y), y, dead.y)
    notes = [f"{column.words}: taken as missing." for column in found]
    return recording._replace(
        u=recording.u.mask(dead.u), y=recording.y.mask(dead.y), notes=(*recording.notes, *notes)
    )


def _joined(tables: list[pd.DataFrame]) -> pd.DataFrame:
    """Return tables of the same columns below each other, in the first one's order."""
    return pd.concat([table[list(tables[0])] for table in tables], ignore_index=True)


def _notes_together(notes: list[tuple[str, ...]], called: list[str]) -> tuple[str, ...]:
    """Return what was noted of several files: what was of all is said once, the rest with the file."""
    told = [f"{len(called)} recordings, each another session: {', '.join(called)}."]
    told += [note for note in notes[0] if all(note in of_one for of_one in notes)]
    for source, of_one in zip(called, notes, strict=True):
        told += [f"{source}: {note}" for note in of_one if note not in told]
    return tuple(told)


def _check_same_columns(ours: list[str], theirs: list[str], option: str, first: str, source: str) -> None:
    """Raise unless two recordings have the same columns for a part to play, in whatever order."""
    if sorted(ours) == sorted(theirs):
        return
    units = dict(map(split_unit, theirs))
    for name, unit in map(split_unit, ours):
        if name in units and units[name] != unit:
            here, there = (f"in {u!r}" if u else "without a unit" for u in (units[name], unit))
            raise DataError(
                f"Column {name!r} is {here} in {source} and {there} in {first}; recordings that are taken "
                "together want one unit, said alike. Convert one of them, or mend its header."
            )
    raise DataError(
        f"For {option}, {source} has {', '.join(map(repr, theirs))}, and {first} has "
        f"{', '.join(map(repr, ours))}; recordings that are taken together want the same columns. Name those "
        f"that they share with {option}, or rename them."
    )


def _check_same_period(ours: float | None, theirs: float | None, first: str, source: str) -> None:
    if ours is None and theirs is None:
        return
    if ours is None or theirs is None:
        without, told = (first, source) if ours is None else (source, first)
        raise DataError(
            f"{without} does not tell the time as {told} does. Add a time column to it, or pass the sampling "
            "period of both with --dt."
        )
    if not same_period(ours, theirs):
        raise DataError(
            f"{source} is sampled every {theirs:.6g} s, {first} every {ours:.6g} s; recordings that are "
            f"taken together want one period. Pass --resample {max(ours, theirs):.6g}, or mend the unit in "
            "which a time column counts."
        )


def choose_columns(table: Table, frame: pd.DataFrame, options, simulated: bool, inputs=(), outputs=()):
    """Return the inputs, outputs and simulated outputs (or None) of a table, out of its signals ``frame``.

    Options decide; then the simulator's names; then usual names such as ``u``, ``y`` and ``y_sim``; and where
    no name helps, two columns are u and y, and three are u, y and y_sim.
    """
    labels = list(frame.columns)
    u = asked_columns(table, labels, options.u, "--u") or _named(labels, inputs)
    y = asked_columns(table, labels, options.y, "--y") or _named(labels, outputs)
    y_sim = asked_columns(table, labels, options.y_sim, "--y-sim") if simulated else []
    free = [label for label in labels if label not in {*u, *y, *y_sim}]
    if simulated and not y_sim:
        y_sim = [label for label in free if SIMULATED.match(split_unit(label)[0])]
    free = [label for label in free if label not in y_sim and not SIMULATED.match(split_unit(label)[0])]
    y = y or [label for label in free if OUTPUT.match(split_unit(label)[0])]
    free = [label for label in free if label not in y]
    u = u or [label for label in free if INPUT.match(split_unit(label)[0])]
    if not (u or y or y_sim) and len(labels) == 2 + simulated:
        u, y, y_sim = labels[:1], labels[1:2], labels[2:]
    elif y and not u and len(free) == 1:
        u = free
    elif u and not y and len([label for label in free if label not in u]) == 1:
        y = [label for label in free if label not in u]
    lacking = [
        option for option, found in (("--u", u), ("--y", y), ("--y-sim", y_sim or not simulated)) if not found
    ]
    if lacking:
        raise UsageError(
            f"Which column is which cannot be told from {', '.join(map(repr, labels))}. Say it with "
            f"{' and '.join(lacking)} (a name, or the column's number in the file; several with commas)."
            + (" Or give the simulation with --model file.py:simulator." if "--y-sim" in lacking else "")
        )
    roles = [("--u", u), ("--y", y), ("--y-sim", y_sim)]
    for label in [*u, *y, *y_sim]:
        options_of = [option for option, chosen in roles for name in chosen if name == label]
        if len(options_of) > 1:
            raise UsageError(
                f"Column {label!r} was taken for {' and '.join(options_of)}; a column has one part to play."
            )
    if simulated and len(y_sim) != len(y):
        raise UsageError(
            f"There are {len(y)} outputs ({', '.join(y)}), but {len(y_sim)} simulated ({', '.join(y_sim)})."
        )
    return frame[u], frame[y], frame[y_sim] if simulated else None


def asked_columns(table: Table, signals: list[str], asked: str | None, option: str) -> list[str]:
    """Return the labels that an option names, with commas between; none where it was not given.

    A column's number counts all columns of the file; what it finds must be among the ``signals``.
    """
    if asked is None:
        return []
    labels = list(map(str, table.frame))
    parts = [asked] if asked in labels else asked.split(",")
    found = [find_column(labels, part.strip(), option) for part in parts]
    for label in found:
        if label in table.words:
            raise UsageError(
                f"{option} {asked}: column {label!r} holds words such as {table.words[label]!r}, not numbers."
            )
        if label in table.empty:
            raise UsageError(f"{option} {asked}: that column has no name and no value.")
        if label not in signals:
            raise UsageError(f"{option} {asked}: column {label!r} is the time, or tells sessions apart.")
    return found


def _named(labels, names) -> list[str]:
    """Return the columns of these names, all of them or none."""
    found = [label for name in names for label in labels if split_unit(label)[0] == name]
    return found if len(found) == len(names) else []


def _check_values(frame: pd.DataFrame, source: str) -> None:
    for label, values in frame.items():
        infinite = np.flatnonzero(np.isinf(values.to_numpy()))
        if infinite.size:
            raise DataError(
                f"Column {label!r} of {source} is infinite in row {infinite[0] + 1} of the values; "
                "leave the cell empty where the value is missing."
            )
        if values.isna().all():
            raise DataError(f"Column {label!r} of {source} holds no number at all.")


def _check_motion(y: pd.DataFrame, source: str) -> None:
    for label, values in y.items():
        if values.min() == values.max():
            raise DataError(
                f"Output {label!r} of {source} is {values.max():g} in every row: nothing can be learnt from "
                "what never moves. Name another column with --y, or pass a record in which it moves."
            )


def last_part(sessions: np.ndarray, share: float) -> np.ndarray:
    """Return the samples, as a mask, in the last ``share`` of every session."""
    held_out = np.zeros(sessions.size, dtype=bool)
    for piece in session_slices(sessions, sessions.size):
        held_out[piece.stop - round(share * (piece.stop - piece.start)) : piece.stop] = True
    return held_out

"""The sampling period of a table: from its time column or an option; gaps, jitter and uneven steps."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from narx_sklearn._validation import finite_slices, session_slices, split_unit
from narx_sklearn.cli._errors import DataError, UsageError
from narx_sklearn.cli._tables import Table

TIME_NAMES = frozenset(
    {"time", "t", "timestamp", "time_s", "datetime", "date", "zeit", "temps", "tempo", "tiempo"}
)
SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
UNEVEN = 0.1  # of a period, beyond which a step is neither one period nor a whole number of them
JITTER = 0.01  # of a period, from which it is worth a note


class Sampled(NamedTuple):
    """A table with its time sorted out.

    Attributes
    ----------
    frame : DataFrame of shape (n_samples, n_signals)
        Everything but the time.
    dt : float or None
        Sampling period, s; None where neither a time column nor an option gives it.
    sessions : ndarray of shape (n_samples,)
        One number a sample; a gap in time begins another session.
    notes : tuple of str
        What was seen, in sentences.
    """

    frame: pd.DataFrame
    dt: float | None
    sessions: np.ndarray
    notes: tuple[str, ...]


def sample_evenly(
    table: Table, *, dt: float | None = None, time: str | None = None, resample: float | None = None
) -> Sampled:
    """Find the sampling period of a table and cut it at gaps.

    Parameters
    ----------
    table : Table
        As read.
    dt : float, optional
        Sampling period, s; where given, the table's time column is set aside.
    time : str, optional
        Name of the time column; guessed from names and time stamps when not given.
    resample : float, optional
        Interpolate linearly onto a grid of this period, s; 0 takes the median step.

    Returns
    -------
    Sampled

    Raises
    ------
    DataError
        If time is missing in places, runs backwards, or is uneven and no resampling was asked for.
    """
    column = _time_column(table, time)
    frame = table.frame if column is None else table.frame.drop(columns=column)
    one_session = np.zeros(len(frame), dtype=int)
    if column is None and resample is not None:
        raise UsageError("--resample needs a time column; name it with --time.")
    if column is None or (dt is not None and resample is None):
        return Sampled(frame, dt, one_session, table.notes)
    t, notes = _in_seconds(table, column)
    notes = [*table.notes, *notes]
    _check_forward(t, column, table.source)
    if t.size < 2:
        raise DataError(f"{table.source} has {t.size} samples; a sampling period needs at least 2.")
    period = float(np.median(np.diff(t))) if not resample else float(resample)
    if resample is not None:
        frame, sessions = _resampled(frame, t, period)
        notes.append(f"Resampled onto a grid of {period:.6g} s: {len(frame)} samples.")
        return Sampled(frame, period, sessions, tuple(notes))
    steps = np.diff(t) / period
    off = np.abs(steps - np.maximum(np.round(steps), 1))
    if off.max() > UNEVEN:
        worst = int(np.argmax(off))
        raise DataError(
            f"The sampling is uneven: steps of column {column!r} lie between {np.diff(t).min():.6g} s and "
            f"{np.diff(t).max():.6g} s, median {period:.6g} s (worst after row {worst + 1}). Pass --resample "
            "to interpolate onto an even grid of the median step, or --resample 0.01 for one of 0.01 s."
        )
    whole = np.round(steps)
    period = float((t[-1] - t[0]) / whole.sum())
    if off.max() > JITTER:
        notes.append(f"Time stamps jitter by up to {100 * off.max():.2g} % of a period; taken as even.")
    gaps = np.flatnonzero(whole > 1)
    if gaps.size:
        notes.append(
            f"{gaps.size} gap{'s' if gaps.size > 1 else ''} in time, the longest of "
            f"{(whole.max() - 1) * period:.4g} s; nothing reaches across."
        )
    notes.append(f"Sampling period {period:.6g} s, from column {column!r}.")
    sessions = np.concatenate([[0], np.cumsum(whole > 1)])
    return Sampled(frame, period, sessions, tuple(notes))


def _time_column(table: Table, asked: str | None) -> str | None:
    labels = list(table.frame.columns)
    if asked is not None:
        return find_column(labels, asked, "--time")
    if len(table.stamped) == 1:
        return next(iter(table.stamped))
    for label in labels:
        if split_unit(label)[0].strip().lower() in TIME_NAMES:
            return label
    return None


def _in_seconds(table: Table, column: str) -> tuple[np.ndarray, list[str]]:
    t = table.frame[column].to_numpy()
    lost = np.flatnonzero(~np.isfinite(t))
    if lost.size:
        raise DataError(
            f"Column {column!r} of {table.source} has no time in row {lost[0] + 1} of the values "
            f"({lost.size} in all). Fill it in, or pass the sampling period with --dt."
        )
    if column in table.stamped:
        return t, []
    unit = split_unit(column)[1]
    if unit and unit not in SECONDS:
        raise DataError(
            f"Column {column!r} counts time in {unit!r}, which is not known; known are {', '.join(SECONDS)}. "
            "Rename the column or pass the sampling period with --dt."
        )
    return t * SECONDS[unit or "s"], [] if unit else [f"Column {column!r} has no unit; taken as seconds."]


def _check_forward(t: np.ndarray, column: str, source: str) -> None:
    back = np.flatnonzero(np.diff(t) <= 0)
    if back.size:
        k = int(back[0])
        what = "stands still" if t[k + 1] == t[k] else "runs backwards"
        raise DataError(
            f"Time {what} in {source} after row {k + 1} of the values: column {column!r} goes from "
            f"{t[k]:.6g} s to {t[k + 1]:.6g} s ({back.size} such places). Sort the rows or take out "
            "repeated ones, or pass the sampling period with --dt."
        )


def _resampled(frame: pd.DataFrame, t: np.ndarray, period: float) -> tuple[pd.DataFrame, np.ndarray]:
    """Interpolate linearly between long gaps; a missing value makes its neighbours so."""
    if not period > 0:
        raise UsageError(f"--resample is a sampling period in seconds and must be positive, got {period:g}.")
    longest = 5 * max(float(np.median(np.diff(t))), period)
    labels = np.concatenate([[0], np.cumsum(np.diff(t) > longest)])
    parts, sessions = [], []
    for number, piece in enumerate(session_slices(labels, t.size)):
        inside = t[piece]
        grid = inside[0] + period * np.arange(int((inside[-1] - inside[0]) / period * (1 + 1e-12)) + 1)
        parts.append(pd.DataFrame({c: np.interp(grid, inside, frame[c].to_numpy()[piece]) for c in frame}))
        sessions.append(np.full(grid.size, number))
    return pd.concat(parts, ignore_index=True), np.concatenate(sessions)


def longest_gap_free(values: np.ndarray, sessions: np.ndarray) -> int:
    """Return the length of the longest stretch inside one session in which all columns are known."""
    runs = finite_slices(session_slices(sessions, len(values)), np.isfinite(values).all(axis=1))
    return max((run.stop - run.start for run in runs), default=0)


def find_column(labels: list[str], asked: str, option: str) -> str:
    """Return the label that is meant by its full text, its name without the unit, or its number from 1."""
    if asked in labels:
        return asked
    named = [label for label in labels if split_unit(label)[0] == asked.strip()]
    if not named:
        named = [label for label in labels if split_unit(label)[0].lower() == asked.strip().lower()]
    if len(named) == 1:
        return named[0]
    if asked.isdigit() and 1 <= int(asked) <= len(labels):
        return labels[int(asked) - 1]
    problem = "names no column" if not named else f"may mean {named}"
    raise UsageError(f"{option} {asked} {problem}; the table has {', '.join(map(repr, labels))}.")

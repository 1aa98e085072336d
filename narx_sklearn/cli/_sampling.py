"""The sampling period of a table: from its time column or an option; gaps, jitter and uneven steps."""

import warnings
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from narx_sklearn._validation import session_slices, split_unit
from narx_sklearn.cli._errors import DataError, UsageError
from narx_sklearn.cli._tables import Table
from narx_sklearn.exceptions import ExcitationWarning
from narx_sklearn.model.times import SAME_PERIOD, same_period

TIME_NAMES = frozenset(
    {"time", "t", "timestamp", "time_s", "datetime", "date", "zeit", "temps", "tempo", "tiempo"}
)
SECONDS = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
SECONDS |= {"d": 86400.0, "days": 86400.0}  # as spreadsheets count
SECONDS |= {"seconds": 1.0, "milliseconds": 1e-3, "minutes": 60.0, "hours": 3600.0}
NONE = "none"  # asked for as the time column: no column tells the time
MANY, TOO_MANY = 2, 100  # times the recorded samples, from which resampling is warned of, and refused
UNEVEN = 0.1  # of a period, beyond which a step is neither one period nor a whole number of them
JITTER = 0.01  # of a period, from which it is worth a note


class Sampled(NamedTuple):
    """A table with its time sorted out.

    Attributes
    ----------
    frame : DataFrame of shape (n_samples, n_signals)
        The numbers; time, sessions and words left out.
    dt : float or None
        Sampling period, s; None where neither a time column nor an option gives it.
    sessions : ndarray of shape (n_samples,)
        One number a sample; a gap in time begins another session.
    notes : tuple of str
        What was seen, in sentences.
    time : str or None
        Label of the column of numbers that told the time; None where an option or time stamps did.
    """

    frame: pd.DataFrame
    dt: float | None
    sessions: np.ndarray
    notes: tuple[str, ...]
    time: str | None = None


def sample_evenly(
    table: Table,
    *,
    dt: float | None = None,
    time: str | None = None,
    session: str | None = None,
    resample: float | None = None,
) -> Sampled:
    """Find the sampling period of a table and cut it at gaps.

    Parameters
    ----------
    table : Table
        As read.
    dt : float, optional
        Sampling period, s, where no column tells; a time column that tells must agree.
    time : str, optional
        Name of the time column; guessed from names and time stamps when not given. ``none``, where no column
        is called so, sets aside what would be guessed: samples are then counted, and no gap is seen.
    session : str, optional
        Name of a column whose changes begin another recording, in which time may begin anew.
    resample : float, optional
        Interpolate linearly onto a grid of this period, s; 0 takes the median step.

    Returns
    -------
    Sampled

    Raises
    ------
    UsageError
        If an option names no column, resampling was asked for where nothing tells the time, or ``dt`` is
        not the period of the time column or grid.
    DataError
        If time is in words or missing in places, runs backwards or stands still between rows that differ,
        or is uneven and no resampling was asked for, or if resampling makes more than a hundred samples of
        each.

    Warns
    -----
    ExcitationWarning
        If resampling makes more than two samples of each.
    """
    column, aside = _time_column(table, time), set()
    if time is not None and column is None:
        aside = {_time_column(table, None), *table.stamped} - {None}
    elif time is None and dt is not None and column in table.words:  # which tell no time
        aside, column = {column}, None
    table, repeats = _without_repeats(table, column)
    label = None if session is None else find_column(list(map(str, table.frame)), session, "--session")
    frame = table.frame.drop(columns={column, label, *aside, *table.words, *table.empty} - {None})
    same = np.ones(max(len(frame) - 1, 0), dtype=bool) if label is None else _same_session(table, label)
    if column is None and resample is not None:
        raise UsageError("--resample needs a time column; name it with --time.")
    if column is None:
        told = [f"Column {name!r} is set aside; samples are counted, and no gap is seen." for name in aside]
        return Sampled(frame, dt, _numbered(~same), (*table.notes, *sorted(told)))
    t, notes = _in_seconds(table, column)
    notes = [*table.notes, *repeats, *notes]
    steps = np.diff(t)
    if not same.any():
        raise DataError(
            f"{table.source} has {t.size} sample{'s' if t.size > 1 else ''}; a sampling period needs at "
            "least 2 of one recording."
        )
    _check_forward(t, same, column, table.source)
    period = resample or float(np.median(steps[same]))
    clock = None if column in table.stamped else column
    if resample is not None:
        _check_same_grid(dt, period)
        _check_growth(t, same, period, clock, table.source)
        frame, sessions = _resampled(frame, t, same, period)
        notes.append(f"Resampled onto a grid of {period:.6g} s: {len(frame)} samples.")
        return Sampled(frame, period, sessions, tuple(notes), clock)
    whole = np.maximum(np.round(steps / period), 1)
    off = np.where(same, np.abs(steps / period - whole), 0.0)
    if off.max() > UNEVEN:
        raise DataError(
            f"The sampling is uneven: steps of column {column!r} lie between {steps[same].min():.6g} s and "
            f"{steps[same].max():.6g} s, median {period:.6g} s (worst after row {np.argmax(off) + 1}). Pass "
            "--resample to interpolate onto an even grid of the median step, or --resample 0.01 for one of "
            "0.01 s."
        )
    period = float(steps[same].sum() / whole[same].sum())
    _check_agrees(dt, period, column, clock, table.source)
    if off.max() > JITTER:
        notes.append(f"Time stamps jitter by up to {100 * off.max():.2g} % of a period; taken as even.")
    gaps = same & (whole > 1)
    if gaps.any():
        notes.append(
            f"{gaps.sum()} gap{'s' if gaps.sum() > 1 else ''} in time, the longest of "
            f"{(whole[gaps].max() - 1) * period:.4g} s; nothing reaches across."
        )
    notes.append(f"Sampling period {period:.6g} s, from column {column!r}.")
    return Sampled(frame, period, _numbered(~same | gaps), tuple(notes), clock)


def _without_repeats(table: Table, column: str | None) -> tuple[Table, list[str]]:
    """Drop rows that repeat the one before to the last cell, where all that repeat its time do."""
    if column is None or column in table.words:
        return table, []
    rows = table.frame.to_numpy(dtype=float)
    again = rows[1:] == rows[:-1]
    still = again[:, table.frame.columns.get_loc(column)]
    copies = (again | (np.isnan(rows[1:]) & np.isnan(rows[:-1]))).all(axis=1)
    # where some rows of one time differ, stamps may be coarse, and what looks alike may be a system at rest
    if not copies.any() or (still & ~copies).any():
        return table, []
    kept = table.frame[np.concatenate([[True], ~copies])].reset_index(drop=True)
    n = int(copies.sum())
    told = "1 row repeats the row" if n == 1 else f"{n} rows repeat the rows"
    note = (
        f"{told} before, its time and all its values; dropped."
        if n == 1
        else (f"{told} before, their time and all their values; dropped.")
    )
    return replace(table, frame=kept), [note]


def _check_agrees(dt: float | None, period: float, column: str, clock: str | None, source: str) -> None:
    """Raise where an option gives another period than the time column, which tells gaps too."""
    if same_period(dt, period):
        return
    assert dt is not None
    unit = "" if clock is None else other_unit(period, dt, column)
    raise UsageError(
        f"--dt gives a sampling period of {dt:.6g} s, column {column!r} of {source} one of {period:.6g} s. "
        f"{unit}{'Else leave' if unit else 'Leave'} out --dt to go by the column, pass --resample {dt:.6g} "
        "to interpolate onto that period, or --time none to set the column aside and count samples."
    )


def _check_same_grid(dt: float | None, period: float) -> None:
    if not same_period(dt, period):
        raise UsageError(
            f"--dt gives a sampling period of {dt:.6g} s, --resample a grid of {period:.6g} s. Pass one of "
            "them: --resample where samples are to be interpolated."
        )


def other_unit(recorded: float, wanted: float, column: str | None) -> str:
    """Ask whether time was counted in another unit, where two periods differ by the ratio of two units.

    Parameters
    ----------
    recorded, wanted : float
        Period of the record as it was read, and the one expected, s.
    column : str or None
        Label of the column that told the time; None where ``--dt`` did.

    Returns
    -------
    str
        A question and what to do, with a blank behind; empty where no unit makes the two alike.

    Examples
    --------
    >>> from narx_sklearn.cli._sampling import other_unit
    >>> other_unit(10.0, 0.01, "time")
    "That is 1000 times as much: is column 'time' in ms? Then label it 'time [ms]'. "
    >>> other_unit(0.02, 0.01, "time")
    ''
    """
    name, told = ("", None) if column is None else split_unit(column)
    ratio = recorded / wanted
    meant = SECONDS[told or "s"] / ratio
    unit = next((unit for unit, size in SECONDS.items() if abs(meant / size - 1) < SAME_PERIOD), None)
    if unit is None or abs(ratio - 1) < SAME_PERIOD:
        return ""
    times = f"{ratio:.4g} times as much" if ratio > 1 else f"a {1 / ratio:.5g}th"
    if column is None:
        return f"That is {times}: is --dt in {unit}? It is wanted in s: pass --dt {wanted:.6g}. "
    return f"That is {times}: is column {column!r} in {unit}? Then label it '{name.strip()} [{unit}]'. "


def _same_session(table: Table, label: str) -> np.ndarray:
    """Tell of each sample but the first whether it goes on with the recording of the one before."""
    values = table.frame[label].to_numpy()
    lost = np.flatnonzero(np.isnan(values))
    if lost.size:
        raise DataError(
            f"Column {label!r} of {table.source} names no session in row {lost[0] + 1} of the values "
            f"({lost.size} in all). Fill it in."
        )
    return values[1:] == values[:-1]


def _numbered(edges: np.ndarray) -> np.ndarray:
    """Return the number of the recording that each sample belongs to, from where another one begins."""
    return np.concatenate([[0], np.cumsum(edges)])


def _time_column(table: Table, asked: str | None) -> str | None:
    labels = list(table.frame.columns)
    if asked is not None and asked.strip().lower() == NONE and NONE not in map(_lower_name, labels):
        return None
    if asked is not None:
        return find_column(labels, asked, "--time")
    if table.stamped:  # a date and a clock in columns of their own: the clock has more to say
        return max(table.stamped, key=lambda label: (table.frame[label].nunique(), label))
    named = [label for label in labels if _lower_name(label) in TIME_NAMES]
    return min(named, key=lambda label: label in table.words, default=None)  # numbers before words


def _lower_name(label: str) -> str:
    return split_unit(label)[0].strip().lower()


def _in_seconds(table: Table, column: str) -> tuple[np.ndarray, list[str]]:
    if column in table.words:
        raise DataError(
            f"Column {column!r} of {table.source} holds words such as {table.words[column]!r}, which cannot "
            "be read as times. Wanted are numbers, or times written like 00:01:02.5, 01:02.5 or "
            "2025-01-31T12:00:00.5. Rewrite them, name another column with --time, or pass --time none, and "
            "the sampling period with --dt."
        )
    t = table.frame[column].to_numpy()
    lost = np.flatnonzero(~np.isfinite(t))
    if lost.size:
        raise DataError(
            f"Column {column!r} of {table.source} has no time in row {lost[0] + 1} of the values "
            f"({lost.size} in all). Fill it in, or pass --time none, and the sampling period with --dt."
        )
    if column in table.stamped:
        return t, []
    unit = split_unit(column)[1]
    if unit and unit not in SECONDS:
        raise DataError(
            f"Column {column!r} counts time in {unit!r}, which is not known; known are {', '.join(SECONDS)}. "
            "Rename the column, or pass --time none, and the sampling period with --dt."
        )
    return t * SECONDS[unit or "s"], [] if unit else [f"Column {column!r} has no unit; taken as seconds."]


def _check_forward(t: np.ndarray, same: np.ndarray, column: str, source: str) -> None:
    back = np.flatnonzero(same & (np.diff(t) <= 0))
    if back.size:
        k = int(back[0])
        told = (
            f"in {source} after row {k + 1} of the values: column {column!r} goes from {t[k]:.6g} s to "
            f"{t[k + 1]:.6g} s ({back.size} of {len(t) - 1} steps). "
        )
        way = (
            "name the column that tells recordings apart with --session; or, where rows were written at an "
            "even rate, pass --time none, and the sampling period with --dt."
        )
        if t[k + 1] == t[k]:
            raise DataError(
                f"Time stands still {told}Rows of one time that differ cannot both be right: keep one of "
                f"them, or their mean (rows that repeat the row before to the last cell are dropped); {way}"
            )
        raise DataError(f"Time runs backwards {told}Sort the rows; {way}")


def _longest(t: np.ndarray, same: np.ndarray, period: float) -> float:
    """Return the longest step that resampling interpolates across."""
    return 5 * max(float(np.median(np.diff(t)[same])), period)


def _check_growth(t: np.ndarray, same: np.ndarray, period: float, column: str | None, source: str) -> None:
    """Raise or warn where a grid is so fine that most of its samples only repeat what lies between others."""
    steps = np.diff(t)[same]
    within = steps[steps <= _longest(t, same, period)]
    made, median = int(within.sum() / period), float(np.median(steps))
    if made <= MANY * t.size:
        return
    told = (
        f"A grid of {period:.6g} s makes {made} samples of the {t.size} in {source}, which are "
        f"{median:.6g} s apart; what is interpolated tells nothing new. "
    )
    unit = "" if column is None else other_unit(median, period, column)
    way = f"{unit}{'Else pass' if unit else 'Pass'} --resample {median:.6g} or more, and give a simulator dt "
    way += "as much."
    if made > TOO_MANY * t.size:
        raise DataError(told + way)
    warnings.warn(told + way, ExcitationWarning, stacklevel=3)


def _resampled(
    frame: pd.DataFrame, t: np.ndarray, same: np.ndarray, period: float
) -> tuple[pd.DataFrame, np.ndarray]:
    """Interpolate linearly between long gaps; a missing value makes its neighbours so."""
    steps = np.diff(t)
    longest = _longest(t, same, period)
    parts, sessions = [], []
    pieces = session_slices(_numbered(~same | (steps > longest)), t.size)
    for number, piece in enumerate(pieces):
        inside = t[piece]
        grid = inside[0] + period * np.arange(int((inside[-1] - inside[0]) / period * (1 + 1e-12)) + 1)
        parts.append(pd.DataFrame({c: np.interp(grid, inside, frame[c].to_numpy()[piece]) for c in frame}))
        sessions.append(np.full(grid.size, number))
    return pd.concat(parts, ignore_index=True), np.concatenate(sessions)


def find_column(labels: list[str], asked: str, option: str, *, lacking: str = " names no column") -> str:
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
    problem = lacking if not named else f" may mean {named}"
    raise UsageError(f"{option} {asked}{problem}; the table has {', '.join(map(repr, labels))}.")

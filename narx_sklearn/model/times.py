"""Rows of a table in time: the step of its index, and rows that are missing, uneven or out of order."""

import math
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np

from narx_sklearn._validation import looks_like_a_time, session_slices, split_unit
from narx_sklearn.exceptions import NarxWarning

SAME_PERIOD = 0.01  # relative difference up to which two sampling periods are one
UNEVEN = 0.5  # of the median step, from which a step is another than the others
FEW = 0.1  # of the steps: rows are missing where fewer are longer than the others, and uneven where more are
TIMES = ("t", "time")  # names of an index that holds seconds, "time [s]"
RESAMPLE = "Resample the samples to that period, or drop the index."


def step_of_rows(
    tables: Mapping[str, Any], sessions, known: float | None = None, whose: str = "", stacklevel: int = 2
) -> float | None:
    """Return the step of the first time index among tables, s, and warn of rows that are out of line.

    Parameters
    ----------
    tables : mapping of {str: array-like}
        By what the caller's arguments are called.
    sessions : array-like of shape (n_samples,) or None
    known : float or None, default=None
        Sampling period that the rows should have, s.
    whose : str, default=""
        Who has it, as for `other_step`.
    stacklevel : int, default=2
        Of the warnings, as the caller counts it.

    Raises
    ------
    ValueError
        If time goes back within a session.
    """
    steps = [index_step(data, sessions, name) for name, data in tables.items()]
    step = next((step for step in steps if step is not None), None)
    told = [rows_out_of_line(data, sessions, name) for name, data in tables.items()]
    out_of_line = next((words for words in told if words), "")
    for words in filter(None, (out_of_line, other_step(step, known, whose, RESAMPLE))):
        warnings.warn(words, NarxWarning, stacklevel=stacklevel + 1)
    return step


def index_step(data, sessions, name: str) -> float | None:
    """Return the median step of a table's time index, s; None where its rows carry no time, or all the same.

    Times are a DatetimeIndex, a TimedeltaIndex, numbers called ``time [s]`` or ``t [s]``, and texts that are
    times as ISO 8601 writes them, ``2024-01-31 12:00:00.5``.

    Raises
    ------
    ValueError
        If time goes back within a session.
    """
    index = _index(data)
    seconds = None if index is None else _seconds(index)
    if seconds is None:
        return None
    steps, back = _steps(seconds, sessions)
    if back is not None:
        raise ValueError(
            f"The time index of {name} goes back at row {back}, from {index[back - 1]} to {index[back]}. "
            "Sort the record by time, as with sort_index(), or label recordings that follow one another in "
            "sessions."
        )
    steps = steps[np.isfinite(steps)]
    return float(f"{np.median(steps):.9g}") or None if steps.size else None  # stamps are rounded themselves


def other_step(step: float | None, known: float | None, whose: str, remedy: str) -> str:
    """Return what a step of an index that is not the known one says, in words; empty where they agree.

    Parameters
    ----------
    step : float or None
        Of an index, s.
    known : float or None
        Sampling period, s.
    whose : str
        Who has it, and what it is called there: ``"the simulator by dt"``.
    remedy : str
        What to do.
    """
    if step is None or known is None or same_period(step, known):
        return ""
    ratio = f", {known / step:.4g} times as long" if step > 0 else ""
    return (
        f"The time index advances by {step:.6g} s from row to row (median), {whose}={known:.6g} s{ratio}. "
        f"{remedy}"
    )


def same_period(one: float | None, other: float | None) -> bool:
    """Tell whether two sampling periods are one; one that nobody told goes with any."""
    return one is None or other is None or math.isclose(one, other, rel_tol=SAME_PERIOD)


def rows_out_of_line(data, sessions, name: str) -> str:
    """Return in words where the rows of a table are not evenly one after another; empty where they are.

    Labels that tell are times, as `index_step` takes them, and whole numbers that count rows: those of a
    table of which some were dropped, shuffled, or put behind those of another.

    Parameters
    ----------
    data : DataFrame, Series or any array-like
        Only the first two have labels.
    sessions : array-like of shape (n_samples,) or None
    name : str
        What the caller's argument is called.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from narx_sklearn.model.times import rows_out_of_line
    >>> rows_out_of_line(pd.Series(np.arange(99.0)).drop([50, 51]), None, "y")[:62]
    'The row numbers of y skip 2 rows, at 1 place: the first at row'
    """
    index = _index(data)
    if index is None:
        return ""
    seconds = _seconds(index)
    if seconds is None and index.dtype.kind not in "iu":
        return ""
    steps, back = _steps(index.to_numpy(dtype=float) if seconds is None else seconds, sessions)
    known = np.flatnonzero(np.isfinite(steps))
    if not known.size:
        return ""
    usual = float(np.median(steps[known]))
    if seconds is None:
        return _numbers_out_of_line(index, steps, usual, back, name)
    far = known[np.abs(steps[known] - usual) > UNEVEN * usual]
    if not far.size:
        return ""
    if far.size > FEW * known.size or steps[far].min() < usual or usual == 0.0:
        return (
            f"The time index of {name} is uneven: its steps are of {steps[known].min():.4g} to "
            f"{steps[known].max():.4g} s, {usual:.4g} s in the median, the first other one before row "
            f"{far[0] + 1}. Rows are taken as evenly one after another; resample the record, or drop the "
            "index if its stamps are rough."
        )
    return _missing("time index", name, far, steps, usual)


def _numbers_out_of_line(index, steps: np.ndarray, usual: float, back: int | None, name: str) -> str:
    backwards = np.flatnonzero(steps < 0)
    if back is not None and backwards.size > FEW * steps.size:
        return (
            f"The row numbers of {name} are not in order (row {back} is {index[back]}, after "
            f"{index[back - 1]}), as of rows that were shuffled. Models of time take rows one after another: "
            "split with shuffle=False, or sort_index()."
        )
    if back is not None:
        return (
            f"The row numbers of {name} go back at row {back}, from {index[back - 1]} to {index[back]}, as "
            "where recordings were put one behind another. Rows are taken as one recording: label the "
            "recordings in sessions, or, if they are one, reset_index(drop=True)."
        )
    far = np.flatnonzero(steps > usual)
    if usual != 1.0 or not far.size or far.size > FEW * steps.size:
        return ""  # numbers of another kind
    return _missing("row numbers", name, far, steps, usual)


def _missing(what: str, name: str, far: np.ndarray, steps: np.ndarray, usual: float) -> str:
    n_missing = max(int(np.round(steps[far] / usual - 1.0).sum()), 1)
    places = f"{far.size} place{'s' if far.size > 1 else ''}"
    return (
        f"The {what} of {name} skip{'s' if what.endswith('x') else ''} {n_missing} row"
        f"{'s' if n_missing > 1 else ''}, at {places}: the first at row {far[0] + 1}. Rows are taken as "
        "evenly one after another; put the missing ones back as NaN (as with reindex), label what lies "
        "between in sessions, or, if nothing is missing, reset_index(drop=True)."
    )


def _index(data) -> Any:
    """Return the index of a table in memory; None of all else."""
    lies_elsewhere = hasattr(data, "__dask_graph__")
    index = getattr(data, "index", None) if hasattr(data, "iloc") and not lies_elsewhere else None
    return index if index is not None and len(index) else None


def _seconds(index) -> np.ndarray | None:
    if getattr(index.dtype, "kind", "") == "O" and looks_like_a_time(index[0]):
        index = _read(index)
    if index is None:
        return None
    if index.dtype.kind in "mM":
        return np.asarray((index - index[0]) / np.timedelta64(1, "s"), dtype=float)
    name, unit = split_unit(index.name) if isinstance(index.name, str) else ("", None)
    is_time = name.lower() in TIMES and unit == "s" and index.dtype.kind in "iuf"
    return index.to_numpy(dtype=float) if is_time else None


def _read(index) -> Any:
    """Return the times that an index of texts is of; None where one of them is none."""
    import pandas as pd

    stamps = pd.to_datetime(index, format="ISO8601", errors="coerce", utc=True)
    return None if stamps.hasnans else stamps


def _steps(position: np.ndarray, sessions) -> tuple[np.ndarray, int | None]:
    """Return steps from row to row, NaN from one session to the next, and the first row that goes back."""
    steps = np.diff(position)
    for piece in session_slices(sessions, position.size):
        steps[piece.stop - 1 : piece.stop] = np.nan
    back = np.flatnonzero(steps < 0)
    return steps, int(back[0]) + 1 if back.size else None

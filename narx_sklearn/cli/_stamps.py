"""Time stamps as machines and spreadsheets write them: dates of three orders, clocks, and stopwatches."""

import re

import numpy as np
import pandas as pd

DAY, HOUR = 86400.0, 3600.0  # s
MILLI = re.compile(r"(:\d\d:\d\d):(\d{3})(?!\d)")  # some controllers write milliseconds behind another colon
ISO = re.compile(r"\d{4}([-/])\d\d\1\d\d([T ]\d\d:\d\d(:\d\d([.,]\d+)?)?(Z|[+-]\d\d:?\d\d)?)?$")
DATE = r"(?P<one>\d{1,2})(?P<mark>[./-])(?P<two>\d{1,2})(?P=mark)(?P<year>\d{4})"
CLOCK = r"(?P<hour>\d{1,2}):(?P<minute>\d\d)(?::(?P<second>\d\d(?:[.,]\d+)?))?(?: ?(?P<half>[AaPp][Mm]))?"
LOCAL = re.compile(rf"(?=\d)(?:{DATE})?(?:,? ?{CLOCK})?$")  # as written outside of standards
MINUTES = re.compile(r"\d{1,3}:[0-5]\d[.,]\d+$")  # minutes and seconds: hours and minutes have no fraction
STOPWATCH = r"(?:(?P<hour>\d{1,2}):)?(?P<minute>\d{1,3}):(?P<second>[0-5]\d(?:[.,]\d+)?)$"


def is_stamp(cell: str) -> bool:
    """Tell whether a cell holds a date, a clock, or both.

    Examples
    --------
    >>> from narx_sklearn.cli._stamps import is_stamp
    >>> [is_stamp(cell) for cell in ("2025-01-31T12:00:00Z", "31.01.2025 12:00", "02:30.5", "3.5")]
    [True, True, True, False]
    >>> is_stamp("12:00:00:250")
    True
    """
    cell = MILLI.sub(r"\1.\2", cell)
    return bool(ISO.match(cell) or LOCAL.match(cell) or MINUTES.match(cell))


def reading(cells: pd.Series) -> str | None:
    """Say how stamps of two numbers and a colon are read, which have two readings; None of all others.

    Examples
    --------
    >>> import pandas as pd
    >>> from narx_sklearn.cli._stamps import reading
    >>> reading(pd.Series(["02:30", "02:31"])), reading(pd.Series(["02:30", "02:30.5"]))
    ('hours and minutes', 'minutes and seconds')
    """
    known = cells.dropna()
    if known.str.match(MINUTES).any():
        return "minutes and seconds"
    return "hours and minutes" if known.str.fullmatch(r"\d{1,2}:\d\d").any() else None


def stamp_seconds(cells: pd.Series) -> np.ndarray:
    """Return time stamps as seconds since the first; NaN where one cannot be read.

    Days and months of a date written with points stand in that order. With slashes or hyphens both orders
    are tried, and the one under which the record is shorter is taken: months that pass between two samples
    were days. A clock without a date that jumps back by more than half a day has passed midnight. Where one
    stamp is of minutes and seconds, all stamps of two numbers are; one that jumps back by more than half an
    hour has passed the hour.

    Parameters
    ----------
    cells : Series of str
        Stamps, trimmed; NA where missing.

    Returns
    -------
    ndarray of shape (n_samples,)

    Examples
    --------
    >>> import pandas as pd
    >>> from narx_sklearn.cli._stamps import stamp_seconds
    >>> stamp_seconds(pd.Series(["31.12.2024 23:59:59,5", "01.01.2025 00:00:00"])).tolist()
    [0.0, 0.5]
    >>> stamp_seconds(pd.Series(["01/31/2025 11:59 PM", "02/01/2025 12:00 AM"])).tolist()
    [0.0, 60.0]
    >>> stamp_seconds(pd.Series(["23:59:58", None, "0:00:01"])).tolist()
    [0.0, nan, 3.0]
    >>> stamp_seconds(pd.Series(["59:59.5", "00:00", "00:00,5", "1:00:01.0"])).tolist()
    [0.0, 0.5, 1.0, 1.5]
    >>> stamp_seconds(pd.Series(["2025-01-31 12:00:00:750", "2025-01-31 12:00:01:000"])).tolist()
    [0.0, 0.25]
    """
    cells = cells.str.replace(MILLI, r"\1.\2", regex=True)
    known = cells.dropna()
    if known.empty or ISO.match(known.iloc[0]):
        marks = cells.str.replace("/", "-").str.replace(",", ".")
        stamps = pd.to_datetime(marks, format="ISO8601", utc=True, errors="coerce")
        seconds = ((stamps - stamps.dropna().iloc[:1].min()) / pd.Timedelta(1, "s")).to_numpy(dtype=float)
    elif known.str.match(MINUTES).any():
        seconds = _stopwatch(cells)
    else:
        parts = cells.str.extract(LOCAL.pattern)
        seconds = _days(parts) * DAY + _clock(parts)
    return seconds - seconds[np.isfinite(seconds)][:1].sum()


def _days(parts: pd.DataFrame) -> np.ndarray:
    """Return whole days of every stamp."""
    if parts["year"].isna().all():
        back = np.diff(pd.Series(_clock(parts)).ffill().to_numpy(), prepend=np.nan) < -DAY / 2
        return np.cumsum(back).astype(float)
    readings = [_date(parts, "two", "one")]
    if (parts["mark"] != ".").any():
        readings.append(_date(parts, "one", "two"))
    return min(readings, key=lambda days: (np.isnan(days).sum(), np.nanmax(days) - np.nanmin(days)))


def _date(parts: pd.DataFrame, month: str, day: str) -> np.ndarray:
    text = parts["year"] + "-" + parts[month].str.zfill(2) + "-" + parts[day].str.zfill(2)
    dates = pd.to_datetime(text, format="%Y-%m-%d", errors="coerce")
    return ((dates - pd.Timestamp(0)) / pd.Timedelta(1, "D")).to_numpy(dtype=float)


def _stopwatch(cells: pd.Series) -> np.ndarray:
    """Return seconds of stamps of minutes and seconds, before which hours may stand."""
    parts = cells.str.extract(STOPWATCH)
    hour, minute, second = _clock_numbers(parts)
    seconds = HOUR * np.nan_to_num(hour) + 60 * minute + second
    back = np.diff(pd.Series(seconds).ffill().to_numpy(), prepend=np.nan) < -HOUR / 2
    return seconds + HOUR * np.cumsum(back) * np.isnan(hour)  # where hours are told, none is to be counted


def _clock_numbers(parts: pd.DataFrame) -> list[np.ndarray]:
    """Return hours, minutes and seconds as numbers; NaN where there are none."""
    return [
        pd.to_numeric(parts[name].str.replace(",", "."), errors="coerce").to_numpy(
            dtype=float, na_value=np.nan
        )
        for name in ("hour", "minute", "second")
    ]


def _clock(parts: pd.DataFrame) -> np.ndarray:
    """Return seconds since midnight; 0 where a date stands alone."""
    hour, minute, second = _clock_numbers(parts)
    half = parts["half"].str.lower().to_numpy(dtype=object, na_value="")
    hour = np.where(half == "", hour, hour % 12 + 12 * (half == "pm"))
    seconds = HOUR * hour + 60 * minute + np.nan_to_num(second)
    dated = parts["year"].notna().to_numpy()
    return np.where(dated & np.isnan(hour), 0.0, seconds)

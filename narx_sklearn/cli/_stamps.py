"""Time stamps as machines and spreadsheets write them: dates of three orders, and clocks."""

import re

import numpy as np
import pandas as pd

DAY = 86400.0  # s
ISO = re.compile(r"\d{4}([-/])\d\d\1\d\d([T ]\d\d:\d\d(:\d\d([.,]\d+)?)?(Z|[+-]\d\d:?\d\d)?)?$")
DATE = r"(?P<one>\d{1,2})(?P<mark>[./-])(?P<two>\d{1,2})(?P=mark)(?P<year>\d{4})"
CLOCK = r"(?P<hour>\d{1,2}):(?P<minute>\d\d)(?::(?P<second>\d\d(?:[.,]\d+)?))?(?: ?(?P<half>[AaPp][Mm]))?"
LOCAL = re.compile(rf"(?=\d)(?:{DATE})?(?:,? ?{CLOCK})?$")  # as written outside of standards


def is_stamp(cell: str) -> bool:
    """Tell whether a cell holds a date, a clock, or both.

    Examples
    --------
    >>> from narx_sklearn.cli._stamps import is_stamp
    >>> [is_stamp(cell) for cell in ("2025-01-31T12:00:00Z", "31.01.2025 12:00", "9:30 AM", "3.5")]
    [True, True, True, False]
    """
    return bool(ISO.match(cell) or LOCAL.match(cell))


def stamp_seconds(cells: pd.Series) -> np.ndarray:
    """Return time stamps as seconds since the first; NaN where one cannot be read.

    Days and months of a date written with points stand in that order. With slashes or hyphens both orders
    are tried, and the one under which the record is shorter is taken: months that pass between two samples
    were days. A clock without a date that jumps back by more than half a day has passed midnight.

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
    """
    known = cells.dropna()
    if known.empty or ISO.match(known.iloc[0]):
        marks = cells.str.replace("/", "-").str.replace(",", ".")
        stamps = pd.to_datetime(marks, format="ISO8601", utc=True, errors="coerce")
        seconds = ((stamps - stamps.dropna().iloc[:1].min()) / pd.Timedelta(1, "s")).to_numpy(dtype=float)
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


def _clock(parts: pd.DataFrame) -> np.ndarray:
    """Return seconds since midnight; 0 where a date stands alone."""
    hour, minute, second = (
        pd.to_numeric(parts[name].str.replace(",", "."), errors="coerce").to_numpy(
            dtype=float, na_value=np.nan
        )
        for name in ("hour", "minute", "second")
    )
    half = parts["half"].str.lower().to_numpy(dtype=object, na_value="")
    hour = np.where(half == "", hour, hour % 12 + 12 * (half == "pm"))
    seconds = 3600 * hour + 60 * minute + np.nan_to_num(second)
    dated = parts["year"].notna().to_numpy()
    return np.where(dated & np.isnan(hour), 0.0, seconds)

"""Read a recording from a text table or parquet, with every guess told and every mistake named."""

import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd

from narx_sklearn.cli._errors import DataError
from narx_sklearn.cli._files import read_bytes
from narx_sklearn.cli._layout import COMMENT, MISSING, Layout, guess_layout
from narx_sklearn.cli._stamps import is_stamp, reading, stamp_seconds

BYTE_ORDER_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
SPOKEN = {";": "semicolons", "\t": "tabs", ",": "commas", "|": "bars", r"\s+": "blanks"}


@dataclass(frozen=True)
class Table:
    """A table as it was read.

    Attributes
    ----------
    frame : DataFrame of shape (n_samples, n_columns)
        Numbers, NaN where missing; time stamps as seconds since the first.
    stamped : frozenset of str
        Labels of the columns that held time stamps.
    words : dict of str to str
        Labels of the columns that held words only, each with its first word; they are numbered in ``frame``.
    notes : tuple of str
        What was guessed, in sentences.
    source : str
        Where it came from.
    empty : frozenset of str
        Labels given to columns without a name and without any value, as a separator at the end of each line
        makes one; they count where columns are numbered, and are no signals.
    """

    frame: pd.DataFrame
    stamped: frozenset[str]
    words: dict[str, str]
    notes: tuple[str, ...]
    source: str
    empty: frozenset[str] = frozenset()


def read_table(source: str) -> Table:
    """Read a table from a file, or from standard input where the source is ``-``.

    Parameters
    ----------
    source : str
        A text table (csv, tsv, txt) or a parquet file, told apart by content.

    Returns
    -------
    Table

    Raises
    ------
    DataError
        If it cannot be read as columns of numbers; the message names line and cell.
    """
    content = read_bytes(source)
    called = "standard input" if source == "-" else source
    if content[:4] == b"PAR1":
        return _from_frame(_read_parquet(content, called), called)
    text, notes = _decoded(content, called)
    layout = guess_layout(text, called)
    notes.append(_told(layout))
    return _from_text(text, layout, notes, called)


def _decoded(content: bytes, source: str) -> tuple[str, list[str]]:
    for mark, encoding in BYTE_ORDER_MARKS.items():
        if content.startswith(mark):
            return content.decode(encoding, errors="replace"), []
    if b"\0" in content[:1000]:
        raise DataError(f"{source} is not text. Wanted is a table as text, or a parquet file.")
    try:
        return content.decode("utf-8"), []
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace"), ["Text is not UTF-8; read as Windows-1252."]


def _read_parquet(content: bytes, source: str) -> pd.DataFrame:
    try:
        import pyarrow  # noqa: F401 - what pandas reads parquet with
    except ImportError as error:
        raise DataError(
            f'{source} is a parquet file, which pyarrow reads: pip install "narx-sklearn[parquet]"'
        ) from error
    try:
        return pd.read_parquet(io.BytesIO(content), engine="pyarrow")
    except (ValueError, OSError) as error:
        raise DataError(f"{source} cannot be read as parquet: {error}") from error


def _from_frame(frame: pd.DataFrame, source: str) -> Table:
    # an index that has a name or tells the time is a column; one that only counts is not
    is_column = frame.index.name is not None or isinstance(frame.index, pd.DatetimeIndex | pd.TimedeltaIndex)
    frame = frame.reset_index(drop=not is_column)
    names = [str(label) for label in frame.columns]
    _check_names(names, source)

    def blame(cell: str, row: int, name: str) -> str:
        return f"{source}, row {row + 1} of the values, column {name!r}: {cell!r} is not a number."

    return _table({name: frame.iloc[:, i] for i, name in enumerate(names)}, ".", blame, [], source)


def _from_text(text: str, layout: Layout, notes: list[str], source: str) -> Table:
    _check_names(layout.names, source)
    try:
        raw = pd.read_csv(
            io.StringIO(COMMENT.sub("", text)),  # blank lines are passed over, and still count as lines
            sep=layout.separator,
            decimal=layout.decimal,
            header=None,
            names=list(layout.names),
            index_col=False,
            skiprows=layout.first_row,
            skipinitialspace=True,
            na_values=sorted(MISSING),
            low_memory=False,
        )
    except pd.errors.ParserError as error:
        raise DataError(_ragged(error, layout, source)) from error

    def blame(cell: str, row: int, name: str) -> str:
        return (
            f"{source}, line {_line_of(row, text, layout)}, column {name!r}: {cell!r} is not a number. Mend "
            "the cell, or leave it empty where the value is missing."
        )

    read = {name: raw[name] for name in layout.names}
    empty = [f"column {i + 1}" for i, name in enumerate(read) if name == f"column {i + 1}"]
    empty = [name for name in empty if layout.has_header and raw[name].isna().all()]
    notes += [f"{name.capitalize()} has no name and no value; left out." for name in empty]
    return replace(_table(read, layout.decimal, blame, notes, source), empty=frozenset(empty))


def _check_names(names: Sequence[str], source: str) -> None:
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        raise DataError(f"{source} has two columns named {repeated[0]!r}; rename one.")


def _table(columns: dict[str, pd.Series], decimal: str, blame, notes: list[str], source: str) -> Table:
    """Return the table of these columns; ``blame`` makes the message about a cell that is no number."""
    read = {name: _numbers(values, decimal, partial(blame, name=name)) for name, values in columns.items()}
    words = {name: column.word for name, column in read.items() if column.word is not None}
    notes = notes + [
        f"Column {name!r} holds words such as {word!r}; it can tell sessions apart, no more."
        for name, word in words.items()
    ]
    notes += [
        f"Times such as {column.clock[0]!r} in column {name!r} are read as {column.clock[1]}."
        for name, column in read.items()
        if column.clock is not None
    ]
    return Table(
        pd.DataFrame({name: column.numbers for name, column in read.items()}),
        frozenset(name for name, column in read.items() if column.is_stamp),
        words,
        tuple(notes),
        source,
    )


class Column(NamedTuple):
    """A column as numbers: values as they are, stamps as seconds, words by their number."""

    numbers: np.ndarray
    is_stamp: bool = False
    word: str | None = None  # the first, where there are only words
    clock: tuple[str, str] | None = None  # the first stamp and its reading, where it may have another one


def _numbers(values: pd.Series, decimal: str, blame) -> Column:
    """Return a column of any kind as numbers."""
    if pd.api.types.is_numeric_dtype(values):
        return Column(values.to_numpy(dtype=float, na_value=np.nan))
    if pd.api.types.is_datetime64_any_dtype(values) or pd.api.types.is_timedelta64_dtype(values):
        return Column(_seconds(values), is_stamp=True)
    cells = values.astype("string").str.strip()
    missing = (cells.isna() | cells.str.lower().isin(MISSING)).to_numpy(dtype=bool)
    stamps = np.array([isinstance(cell, str) and is_stamp(cell) for cell in cells], dtype=bool)
    if (stamps | missing).all() and stamps.any():
        seconds = stamp_seconds(cells.mask(missing))
        _check_cells(seconds, missing, cells, blame)
        told = reading(cells.mask(missing))
        clock = None if told is None else (str(cells[~missing].iloc[0]), told)
        return Column(seconds, is_stamp=True, clock=clock)
    plain = cells.str.replace(",", ".") if decimal == "," else cells
    numbers = pd.to_numeric(plain, errors="coerce")
    if numbers.isna().all() and not stamps.any() and not missing.all():
        codes, words = pd.factorize(cells.mask(missing))
        return Column(np.where(codes < 0, np.nan, codes), word=str(words[0]))
    read = numbers.to_numpy(dtype=float, na_value=np.nan)
    _check_cells(read, missing, cells, blame)
    return Column(read)


def _check_cells(read: np.ndarray, missing: np.ndarray, cells: pd.Series, blame) -> None:
    """Raise for the first cell that holds something and was not understood."""
    bad = np.flatnonzero(np.isnan(read) & ~missing)
    if bad.size:
        raise DataError(blame(cells.iloc[bad[0]], int(bad[0])))


def _seconds(stamps: pd.Series) -> np.ndarray:
    """Return seconds since the first time stamp; NaN where one is missing."""
    return ((stamps - stamps.dropna().iloc[:1].min()) / pd.Timedelta(1, "s")).to_numpy(dtype=float)


def _line_of(row: int, text: str, layout: Layout) -> int:
    """Return the line, from 1, in which a row of values stands."""
    lines = COMMENT.sub("", text).splitlines()
    return [i for i, line in enumerate(lines, 1) if i > layout.first_row and line.strip()][row]


def _ragged(error: Exception, layout: Layout, source: str) -> str:
    if "EOF inside string" in str(error):
        return f"{source} has a quotation mark that is opened and never closed; close it, or take it out."
    found = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
    if not found:
        return f"{source} cannot be read as a table: {error}."
    wanted, line, saw = map(int, found.groups())
    return (
        f"{source}, line {line} has {saw} values, the lines before {wanted}. "
        f"It was read with {SPOKEN[layout.separator]} between columns and decimal mark {layout.decimal!r}."
    )


def _told(layout: Layout) -> str:
    mark = "comma" if layout.decimal == "," else "point"
    header = f"columns {', '.join(layout.names)}" if layout.has_header else "no header"
    return f"Read with {SPOKEN[layout.separator]} between columns, decimal {mark}, {header}."

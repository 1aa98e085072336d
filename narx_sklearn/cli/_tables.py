"""Read a recording from a text table or parquet, with every guess told and every mistake named."""

import io
import re
from dataclasses import dataclass

import numpy as np
import pandas as pd

from narx_sklearn.cli._errors import DataError
from narx_sklearn.cli._files import read_bytes
from narx_sklearn.cli._layout import MISSING, STAMP, Layout, guess_layout

BYTE_ORDER_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
WORDS = {";": "semicolons", "\t": "tabs", ",": "commas", "|": "bars", r"\s+": "blanks"}


@dataclass(frozen=True)
class Table:
    """A table as it was read.

    Attributes
    ----------
    frame : DataFrame of shape (n_samples, n_columns)
        Numbers, NaN where missing; time stamps as seconds since the first.
    stamped : frozenset of str
        Labels of the columns that held time stamps.
    notes : tuple of str
        What was guessed, in sentences.
    source : str
        Where it came from.
    """

    frame: pd.DataFrame
    stamped: frozenset[str]
    notes: tuple[str, ...]
    source: str


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
        return _from_frame(_read_parquet(content), called)
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


def _read_parquet(content: bytes) -> pd.DataFrame:
    try:
        return pd.read_parquet(io.BytesIO(content))
    except ImportError as error:
        raise DataError("Reading parquet needs pyarrow: pip install pyarrow") from error


def _from_frame(frame: pd.DataFrame, source: str) -> Table:
    frame = frame.reset_index() if frame.index.name else frame.reset_index(drop=True)
    columns, stamped = {}, set()
    for label, values in frame.items():
        if pd.api.types.is_datetime64_any_dtype(values):
            columns[str(label)] = _seconds(values)
            stamped.add(str(label))
            continue
        try:
            columns[str(label)] = values.to_numpy(dtype=float, na_value=np.nan)
        except (TypeError, ValueError) as error:
            raise DataError(f"Column {str(label)!r} of {source} does not hold numbers: {error}.") from error
    return Table(pd.DataFrame(columns), frozenset(stamped), (), source)


def _from_text(text: str, layout: Layout, notes: list[str], source: str) -> Table:
    repeated = sorted({name for name in layout.names if layout.names.count(name) > 1})
    if repeated:
        raise DataError(f"{source} has two columns named {repeated[0]!r}; rename one.")
    try:
        raw = pd.read_csv(
            io.StringIO(text),
            sep=layout.separator,
            decimal=layout.decimal,
            header=None,
            names=list(layout.names),
            index_col=False,
            skiprows=layout.first_row,
            comment="#",
            skipinitialspace=True,
            na_values=sorted(MISSING),
            low_memory=False,
        )
    except pd.errors.ParserError as error:
        raise DataError(_ragged(error, layout, source)) from error
    columns, stamped = {}, set()
    for name in layout.names:
        values = raw[name]
        if not pd.api.types.is_numeric_dtype(values):
            values, is_time = _text_column(values, name, text, layout, source)
            stamped |= {name} if is_time else set()
        columns[name] = np.asarray(values, dtype=float)
    return Table(pd.DataFrame(columns), frozenset(stamped), tuple(notes), source)


def _text_column(values: pd.Series, name: str, text: str, layout: Layout, source: str):
    """Return a column that pandas left as text, as numbers, and whether it held time stamps."""
    cells = values.astype("string").str.strip()
    missing = cells.isna() | cells.str.lower().isin(MISSING)
    stamps = cells.str.match(STAMP.pattern).fillna(False).astype(bool)
    if (stamps | missing).all() and stamps.any():
        stamped = pd.to_datetime(cells.str.replace(",", "."), format="ISO8601", utc=True, errors="coerce")
        bad = np.flatnonzero(stamped.isna() & ~missing)
        if bad.size:
            raise DataError(_bad_cell(cells.iloc[bad[0]], int(bad[0]), name, text, layout, source))
        return _seconds(stamped), True
    plain = cells.str.replace(",", ".") if layout.decimal == "," else cells
    numbers = pd.to_numeric(plain, errors="coerce")
    bad = np.flatnonzero((numbers.isna() & ~missing).to_numpy(dtype=bool))
    if bad.size:
        raise DataError(_bad_cell(cells.iloc[bad[0]], int(bad[0]), name, text, layout, source))
    return numbers.to_numpy(dtype=float, na_value=np.nan), False


def _seconds(stamps: pd.Series) -> np.ndarray:
    """Return seconds since the first time stamp; NaN where one is missing."""
    return ((stamps - stamps.dropna().iloc[:1].min()) / pd.Timedelta(1, "s")).to_numpy(dtype=float)


def _bad_cell(cell: str, row: int, name: str, text: str, layout: Layout, source: str) -> str:
    lines = text.splitlines()
    values = [
        i
        for i in range(layout.first_row, len(lines))
        if lines[i].strip() and not lines[i].lstrip().startswith("#")
    ]
    return (
        f"{source}, line {values[row] + 1}, column {name!r}: {cell!r} is not a number. Mend the cell, or "
        "leave it empty where the value is missing."
    )


def _ragged(error: Exception, layout: Layout, source: str) -> str:
    found = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
    if not found:
        return f"{source} cannot be read as a table: {error}."
    wanted, line, saw = map(int, found.groups())
    return (
        f"{source}, line {line} has {saw} values, the lines before {wanted}. "
        f"It was read with {WORDS[layout.separator]} between columns and decimal mark {layout.decimal!r}."
    )


def _told(layout: Layout) -> str:
    mark = "comma" if layout.decimal == "," else "point"
    header = f"columns {', '.join(layout.names)}" if layout.has_header else "no header"
    return f"Read with {WORDS[layout.separator]} between columns, decimal {mark}, {header}."

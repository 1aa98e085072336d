"""How a text table is laid out: separator, decimal mark, header, units, read off its first lines."""

import csv
import re
from collections import Counter
from dataclasses import dataclass

from narx_sklearn._validation import split_unit
from narx_sklearn.cli._errors import DataError
from narx_sklearn.cli._stamps import is_stamp

SEPARATORS = (";", "\t", ",", "|", r"\s+")
LOOKED_AT = 60  # lines
LONGEST_UNIT = 8  # letters
MISSING = frozenset({"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "?", "missing"})
NUMBER = {
    ".": re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$|[+-]?inf(inity)?$", re.IGNORECASE),
    ",": re.compile(r"[+-]?(\d+,?\d*|,\d+)([eE][+-]?\d+)?$|[+-]?inf(inity)?$", re.IGNORECASE),
}
COMMENT = re.compile(r"^[ \t]*#(?!n/a).*$", re.IGNORECASE | re.MULTILINE)  # a line, not a missing value


@dataclass(frozen=True)
class Layout:
    """How a table is written.

    Attributes
    ----------
    separator, decimal : str
        Column separator (``r"\\s+"`` for blanks) and decimal mark.
    names : tuple of str
        Column labels, ``"name [unit]"`` where a unit is known.
    has_header : bool
        Whether the labels were read; else they are ``column 1`` and so on.
    first_row : int
        Line of the file, from 0, at which the values begin.
    """

    separator: str
    decimal: str
    names: tuple[str, ...]
    has_header: bool
    first_row: int


def guess_layout(text: str, source: str = "the table") -> Layout:
    """Read the layout of a table off its first lines.

    Every separator is tried with both decimal marks; the pair under which most cells are numbers or time
    stamps, in lines of one length, wins; of equals, the one with more columns.

    Parameters
    ----------
    text : str
        The whole file or its beginning.
    source : str
        Its name, for messages.

    Returns
    -------
    Layout

    Raises
    ------
    DataError
        If there is no line, or no separator gives a table of numbers.

    Examples
    --------
    >>> from narx_sklearn.cli._layout import guess_layout
    >>> layout = guess_layout("time [s];drive [V]\\n0,0;1,5\\n0,1;2,5\\n")
    >>> layout.separator, layout.decimal, layout.names, layout.first_row
    (';', ',', ('time [s]', 'drive [V]'), 1)
    """
    lines = [(i, line) for i, line in enumerate(COMMENT.sub("", text).splitlines()) if line.strip()]
    lines = lines[:LOOKED_AT]
    if not lines:
        raise DataError(f"{source} is empty: it holds no line of values.")
    best = None
    for separator in SEPARATORS:
        rows = [split(line, separator) for _, line in lines]
        width = Counter(map(len, rows)).most_common(1)[0][0]
        regular = [row for row in rows if len(row) == width]
        for decimal in (".", ","):
            if decimal == separator:
                continue
            body = regular[2:] or regular[1:] or regular
            good = sum(is_value(cell, decimal) for row in body for cell in row)
            share = good / (len(body) * width) * len(regular) / len(rows)
            rank = (round(share, 2), width, decimal == ".")
            if good and (best is None or rank > best[0]):
                best = rank, separator, decimal, rows, width
    if best is None and len(lines) == 1:
        raise DataError(f"{source} has one line and no number in it: a header, but no line of values.")
    if best is None or best[0][0] < 0.4:
        raise DataError(
            f"{source} does not look like a table of numbers. Wanted is one line for each sample, its values "
            "separated by comma, semicolon, tab or blanks, with a first line such as "
            "'time [s],drive [V],position [m]'."
        )
    _, separator, decimal, rows, width = best
    names, has_header, first = _header(rows, width, decimal)
    if first >= len(lines):
        raise DataError(f"{source} has a header but no line of values.")
    return Layout(separator, decimal, names, has_header, lines[first][0])


def _header(rows: list[list[str]], width: int, decimal: str) -> tuple[tuple[str, ...], bool, int]:
    """Return labels, whether they were read, and the row at which the values begin."""
    first = next((i for i, row in enumerate(rows) if _is_data(row, width, decimal)), len(rows))
    above = [row for row in rows[:first] if len(row) == width]
    if not above and first and len(rows[first - 1]) == width - 1 and _end_in_nothing(rows, width):
        above = [[*rows[first - 1], ""]]  # a separator ends each line of values, and not the header
    if not above:
        return tuple(f"column {i + 1}" for i in range(width)), False, first
    labels = above[-1]
    if len(above) > 1 and _are_units(labels):
        labels = [_with_unit(label, unit) for label, unit in zip(above[-2], labels, strict=True)]
    return tuple(label.strip() or f"column {i + 1}" for i, label in enumerate(labels)), True, first


def _end_in_nothing(rows: list[list[str]], width: int) -> bool:
    return all(not row[-1].strip() for row in rows if len(row) == width)


def _is_data(row: list[str], width: int, decimal: str) -> bool:
    """Tell whether a row holds values: mostly numbers, the rest missing or a mistake to be told later."""
    if len(row) != width:
        return False
    numbers = sum(is_value(cell, decimal) and cell.strip().lower() not in MISSING for cell in row)
    return numbers > 0 and numbers >= sum(not is_value(cell, decimal) for cell in row)


def _are_units(row: list[str]) -> bool:
    """Tell whether the cells below a header are short enough to be its units."""
    return all(len(cell.strip().strip("[]()")) <= LONGEST_UNIT for cell in row)


def _with_unit(label: str, unit: str) -> str:
    unit = unit.strip().strip("[]()")
    return f"{label.strip()} [{unit}]" if unit and split_unit(label)[1] is None else label.strip()


def is_value(cell: str, decimal: str) -> bool:
    """Tell whether a cell is a number, a time stamp, or a mark for a missing value."""
    cell = cell.strip()
    return cell.lower() in MISSING or bool(NUMBER[decimal].match(cell) or is_stamp(cell))


def split(line: str, separator: str) -> list[str]:
    """Split one line; quoted cells stay whole."""
    if separator == r"\s+":
        return line.split()
    return next(csv.reader([line], delimiter=separator, skipinitialspace=True))

"""Checks at the public edge, and the few scikit-learn names they lean on."""

import re
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise
from numbers import Integral

import numpy as np
from sklearn.utils.validation import check_array, check_consistent_length

from narx_sklearn.exceptions import NarxWarning

_UNIT = re.compile(r"^\s*(.*?)\s*\[([^\]]*)\]\s*$")
_IN_ROUND = re.compile(r"^\s*(\S.*?)\s*\(\s*([^()]*?)\s*\)\s*$")
LONGEST_IN_ROUND = 12  # letters of a unit in round brackets, which hold words of a name as well
_PREFIX = r"(?:da|[TGMkhdcmuµμnp])"
_SYMBOL = (  # what is a unit wherever it stands
    rf"(?:{_PREFIX}?(?:mol|rad|Ohm|ohm|Pa|bar|Hz|Nm|Wh|Ah|VA|[mgsAKNJWVΩΩFT])|{_PREFIX}[lLSCH]"
    r"|°[CF]?|deg[CF]?|sec|inch|ft|psi|atm|lbf?|rev|rpm|mph|kn|%|‰|ppm|dB|counts?|pixels?|px"
    r"|volts?|amp(?:ere)?s?|met(?:er|re)s?|newtons?|watts?|degrees?|radians?|kelvin|percent"
    r"|(?:milli)?seconds?|minutes?|hours?)"
)
_POWER = r"(?:(?:\^|\*\*)?-?\d|[²³])?"
_FACTOR = rf"(?:(?:{_SYMBOL}|in|min|[hdLlCSHU]){_POWER}|1)"  # of a quotient or product; alone some are words
_UNIT_IN_ROUND = re.compile(rf"-|{_SYMBOL}{_POWER}|{_FACTOR}(?:\s?[*/·.]\s?{_FACTOR}|\s{_FACTOR})+")
_TIME = re.compile(r"(?:time|t|zeit|temps|tempo|tiempo)\b", re.IGNORECASE)
_LONG_TIME = ("min", "h", "d")  # of a time; of all else the smallest, say, and not minutes
STAMP = re.compile(r"\d{4}-\d\d-\d\d(?:[T ]\d\d:\d\d|$)")  # of ISO 8601, with the day at least
_NOT_WORD = re.compile(r"\W+")

SMALLEST, LARGEST = 1e-75, 1e75  # magnitudes whose fourth powers are still numbers

BLOCK_ROWS = 1 << 18  # samples of a long record looked at together, so that no mask grows with the record


def split_unit(label: str) -> tuple[str, str | None]:
    """Split a column label such as ``"drive [V]"`` or ``"drive (V)"`` into name and unit.

    Round brackets hold a unit where what they hold is made of known units; ``"position (left)"``, ``"x (2)"``
    and ``"u(t)"`` are names.

    Examples
    --------
    >>> from narx_sklearn._validation import split_unit
    >>> split_unit("drive [V]"), split_unit("Zeit (ms)"), split_unit("friction (N s/m)")
    (('drive', 'V'), ('Zeit', 'ms'), ('friction', 'N s/m'))
    >>> split_unit("position (left)"), split_unit("u(t)")
    (('position (left)', None), ('u(t)', None))
    """
    text = str(label)
    match = _UNIT.match(text)
    if match is None:
        match = _IN_ROUND.match(text)
        if match and not _is_unit(match[2], match[1]):
            match = None
    return (match[1], match[2]) if match else (text.strip(), None)


def _is_unit(text: str, name: str) -> bool:
    """Tell whether what stands in round brackets behind a name is its unit."""
    if text in _LONG_TIME:
        return _TIME.match(name) is not None
    return len(text) <= LONGEST_IN_ROUND and _UNIT_IN_ROUND.fullmatch(text) is not None


def signal_names(labels: Iterable, letter: str) -> tuple[str, ...]:
    """Return names fit for terms: from the labels when they are texts, else ``u`` or ``u1, u2, ...``.

    Parameters
    ----------
    labels : iterable of str or int
        Column labels; anything but texts counts as unnamed.
    letter : str
        The field's letter for this kind of signal.

    Raises
    ------
    ValueError
        If two labels give the same name.
    """
    labels = list(labels)
    if not all(isinstance(label, str) for label in labels):
        return (letter,) if len(labels) == 1 else tuple(f"{letter}{i + 1}" for i in range(len(labels)))
    names = []
    for label in labels:
        name = _NOT_WORD.sub("_", split_unit(label)[0]).strip("_") or letter
        names.append(name if not name[0].isdigit() else f"{letter}_{name}")
    repeated = {name for name in names if names.count(name) > 1}
    if repeated:
        raise ValueError(
            f"The columns {labels} give the same signal name {sorted(repeated)} in terms; rename a column."
        )
    return tuple(names)


def signal_units(names: Sequence[str], labels: Sequence | None) -> dict[str, str]:
    """Return the units that the labels of the named signals carry."""
    if labels is None:
        return {}
    units = ((name, split_unit(label)[1]) for name, label in zip(names, labels, strict=True))
    return {name: unit for name, unit in units if unit}


def column_labels(data) -> list | None:
    """Return the labels of a DataFrame or the name of a Series, None for other containers."""
    if hasattr(data, "columns"):
        return list(data.columns)
    name = getattr(data, "name", None)
    if hasattr(data, "iloc") and name is not None:
        return [name]
    return None


def unmasked(data):
    """Return a masked array with NaN where it is masked, and anything else as it is.

    What lies under a mask is a fill value, or what somebody would not believe; ``np.asarray`` hands it out.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn._validation import unmasked
    >>> unmasked(np.ma.masked_equal([1, -9999, 3], -9999)).tolist()
    [1.0, nan, 3.0]
    """
    if not isinstance(data, np.ma.MaskedArray):
        return data
    return data.data if np.ma.getmask(data) is np.ma.nomask else np.ma.filled(data.astype(float), np.nan)


def as_signals(data, name: str) -> np.ndarray:
    """Return ``data`` as a float64 array of shape (n_samples, n_signals); NaN, or a mask, marks gaps.

    Raises
    ------
    ValueError
        If it is None, a single value, not numeric, has more than two axes, or holds infinities.
    TypeError
        If a column of it holds times.
    """
    check_numeric(data, name)
    if not hasattr(data, "columns"):
        given, data = data, np.asarray(unmasked(data))
        if data.ndim == 0:
            what = "None" if given is None else f"the single value {given!r}"
            raise ValueError(
                f"{name} is {what}, but a signal is wanted: an array of shape (n_samples,) or "
                "(n_samples, n_signals)."
            )
        data = data.reshape(-1, 1) if data.ndim == 1 else data
    return check_array(
        data,
        dtype=np.float64,
        ensure_all_finite="allow-nan",
        order="C",
        ensure_min_samples=1,
        ensure_min_features=0,
        input_name=name,
    )


def check_lags(lags, name: str, *, smallest: int) -> tuple[int, ...]:
    """Return lags as a sorted tuple: an integer n means ``smallest`` to n, a list means itself.

    Raises
    ------
    TypeError, ValueError
        If a lag is no integer or lies below ``smallest``.
    """
    if isinstance(lags, Integral) and not isinstance(lags, bool):
        if lags < smallest and lags != 0:
            raise ValueError(
                f"{name}={lags} ends before the shortest lag allowed, {smallest}; pass at least {smallest} "
                "or an explicit list of lags."
            )
        return tuple(range(smallest, int(lags) + 1))
    if isinstance(lags, str) or not isinstance(lags, Iterable):
        raise TypeError(f"{name} must be an integer or a list of integers, got {lags!r}.")
    chosen = sorted(set(lags))
    for lag in chosen:
        if not isinstance(lag, Integral) or isinstance(lag, bool):
            raise TypeError(f"{name} must hold integers, got {lag!r}.")
        if lag < smallest:
            raise ValueError(f"{name} holds the lag {lag}; the shortest lag allowed here is {smallest}.")
    return tuple(int(lag) for lag in chosen)


def check_count(value, name: str) -> None:
    """Raise unless a value is an integer of at least 1."""
    if not isinstance(value, Integral) or isinstance(value, bool) or value < 1:
        raise ValueError(f"{name} must be an integer of at least 1, got {value!r}.")


def session_slices(sessions, n_samples: int) -> list[slice]:
    """Return the runs of equal labels as slices; one slice when there are no sessions.

    Raises
    ------
    ValueError
        If there is not one label a sample.
    """
    if sessions is None:
        return [slice(0, n_samples)]
    labels = np.asarray(sessions)
    if labels.shape != (n_samples,):
        raise ValueError(
            f"sessions must hold one label a sample, shape ({n_samples},), got shape {labels.shape}."
        )
    edges = [np.array([0])]
    for block in blocks(n_samples - 1):
        changes = np.flatnonzero(labels[block.start + 1 : block.stop + 1] != labels[block])
        edges.append(changes + block.start + 1)
    bounds = np.concatenate([*edges, [n_samples]])
    return [slice(int(a), int(b)) for a, b in pairwise(bounds) if b > a]


def finite_slices(pieces: Sequence[slice], finite: np.ndarray) -> list[slice]:
    """Cut ``pieces`` at samples that are not finite and return the runs between them."""
    if finite.all():
        return list(pieces)
    runs = []
    for piece in pieces:
        runs += [slice(piece.start + a, piece.start + b) for a, b in true_runs(finite[piece])]
    return runs


def true_runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Return (start, stop) of the runs of True."""
    inside = np.concatenate([[False], flags, [False]])
    edges = np.flatnonzero(inside[1:] != inside[:-1]).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def all_finite(data: np.ndarray) -> bool:
    """Tell whether every value is finite, in one pass and without a mask.

    Values so large that their sum is not finite count as not finite too; who needs to know looks again.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(data.sum()))


def finite_rows(data: np.ndarray) -> np.ndarray:
    """Tell for each row of ``data``, shape (n_samples, n_signals), whether all of it is finite."""
    finite = np.ones(data.shape[0], dtype=bool)
    for column in data.T:  # by columns: numpy reduces short rows slowly
        finite &= np.isfinite(column)
    return finite


def blocks(n_samples: int) -> Iterator[slice]:
    """Yield consecutive slices that cover ``n_samples``, for passes over a record that may lie on disk."""
    for begin in range(0, n_samples, BLOCK_ROWS):
        yield slice(begin, min(begin + BLOCK_ROWS, n_samples))


def finite_columns(data: np.ndarray) -> np.ndarray:
    """Tell for each column of ``data``, shape (n_samples, n_signals), whether any of it is finite."""
    found = np.zeros(data.shape[1], dtype=bool)
    for block in blocks(data.shape[0]):
        found |= np.isfinite(data[block]).any(axis=0)
        if found.all():
            break
    return found


def check_same_length(**arrays) -> None:
    """Raise a ValueError unless all arrays have the same number of samples."""
    check_consistent_length(*(array for array in arrays.values() if array is not None))


def check_inputs_given(X, inputs) -> None:
    """Raise a ValueError where a model's inputs are None; without columns too they say how long to run."""
    if X is None:
        raise ValueError(
            f"X is None, but the model has the inputs {list(inputs)}: pass an array of shape "
            f"(n_samples, {len(inputs)}), which also says how many samples there are."
        )


def check_numeric(data, name: str) -> None:
    """Raise where a column of a table in memory holds times or text in the place of a signal's values.

    Raises
    ------
    TypeError
        If they are times, also where they are written out as text.
    ValueError
        If some text is no number.
    """
    if not hasattr(data, "iloc") or hasattr(data, "__dask_graph__"):
        return
    is_table = hasattr(data, "columns")
    for i, label in enumerate(data.columns if is_table else [data.name]):
        column = data.iloc[:, i] if is_table else data
        whose = f"{name}'s column {label!r}" if is_table else name
        kind = getattr(column.dtype, "kind", "")
        text = "" if kind != "O" else _first_text(column)
        if kind in ("m", "M") or looks_like_a_time(text):
            stamps = f"pd.to_datetime({name}.pop({label!r}))" if text else repr(label)
            way = (
                f"Make it the index, which tells the sampling period, as with {name}.set_index({stamps}), or "
                "drop it."
                if is_table
                else "Pass what was measured at these times."
            )
            written = f", such as {text!r}" if text else ""
            raise TypeError(f"{whose} holds times{written}, not values of a signal. {way}")
        if text:
            series = f"{name}[{label!r}]" if is_table else name
            raise ValueError(
                f"{whose} holds text, such as {text!r}, not values of a signal. Drop it; or, where text "
                f"stands for missing values, pass pd.to_numeric({series}, errors='coerce') in its place."
            )


def looks_like_a_time(text) -> bool:
    """Tell whether a text begins as ISO 8601 writes a date."""
    return isinstance(text, str) and STAMP.match(text) is not None


def _first_text(column) -> str:
    """Return the first text of a column that is no number; empty where there is none."""
    for value in column:
        if isinstance(value, str):
            try:
                float(value)
            except ValueError:
                return value
    return ""


def check_indexes(X, y) -> None:
    """Raise a ValueError where the rows of two tables are labelled and the labels say that they differ.

    An index that only numbers the rows from 0 says nothing, unless the other has these numbers in
    another order; nor does one that numbers them from elsewhere (as a fold of such a table does) beside
    labels that are no integers. The first rows of a table number theirs from 0 too: beside integers that
    have none in common with these, as those of later rows, a `NarxWarning` asks.
    """
    ours, theirs = (getattr(data, "index", None) if hasattr(data, "iloc") else None for data in (X, y))
    if ours is None or theirs is None or len(ours) != len(theirs) or _same(ours, theirs):
        return
    k = next((i for i, (a, b) in enumerate(zip(ours, theirs, strict=True)) if a != b), None)
    # labels of several kinds cannot be sorted; counted they can be compared
    same_set = Counter(ours) == Counter(theirs)
    if k is None:
        return
    if not same_set and (_only_counts(ours, theirs) or _only_counts(theirs, ours)):
        _warn_if_disjoint(ours, theirs)
        return
    first = f"row {k} is {ours[k]} in X and {theirs[k]} in y"
    if same_set:
        raise ValueError(
            f"X and y have the same row labels in another order ({first}); rows are paired by position. Sort "
            "both by time, as with sort_index(), or pass y.loc[X.index]."
        )
    raise ValueError(
        f"X and y have different row labels ({first}), so their samples are not of the same times. Align "
        "them, as with X.join(y, how='inner'), or, if the rows do belong together, pass "
        "y.set_axis(X.index)."
    )


def _warn_if_disjoint(ours, theirs) -> None:
    if all(index.dtype.kind in "iu" for index in (ours, theirs)) and not set(ours) & set(theirs):
        warnings.warn(
            f"X has the row labels {ours[0]} to {ours[-1]} and y {theirs[0]} to {theirs[-1]}, none in "
            "common; rows are paired by position. If they are of other samples, cut both alike, as with "
            "y.loc[X.index] of the whole y; if they do belong together, pass y.set_axis(X.index), or "
            "reset_index(drop=True) of both.",
            NarxWarning,
            stacklevel=3,
        )


def _same(ours, theirs) -> bool:
    if ours.equals(theirs):
        return True
    if not all(index.dtype.kind in "iuf" for index in (ours, theirs)):
        return False
    a, b = ours.to_numpy(dtype=float), theirs.to_numpy(dtype=float)
    step = np.median(np.abs(np.diff(a))) if a.size > 1 else 0.0
    return bool(np.all(np.abs(a - b) <= 1e-6 * step))  # times that were computed twice


def _only_counts(index, other) -> bool:
    """Tell whether an index counts rows: from 0, or from anywhere beside one that is no integer."""
    if index.dtype.kind not in "iu":
        return False
    first = 0 if other.dtype.kind in "iu" else index[0]
    return bool(np.array_equal(index, first + np.arange(len(index))))


def check_magnitude(largest: float, what: str) -> None:
    """Raise where powers of values up to ``largest`` are zero or infinite: no error can be told from none."""
    if largest == 0.0 or SMALLEST <= largest <= LARGEST:
        return
    raise ValueError(
        f"{what} holds values of up to {largest:.3g}, too {'small' if largest < SMALLEST else 'large'} to "
        f"square: magnitudes from {SMALLEST:g} to {LARGEST:g} can be used. Choose a unit in which they are "
        "nearer to 1."
    )


def check_choice(value, name: str, choices: Iterable[str]) -> str:
    """Return ``value`` if it is among ``choices``; else raise a ValueError that lists them."""
    choices = tuple(choices)
    if value not in choices:
        raise ValueError(f"{name}={value!r} is not known; choose one of {', '.join(map(repr, choices))}.")
    return value

"""Labels of a table against the signals of a simulator: which column is which, and in which unit."""

from collections.abc import Sequence

import numpy as np

from narx_sklearn._validation import as_signals, column_labels, signal_names, split_unit
from narx_sklearn.model.units import compare_units


def read_columns(data, signals: Sequence, name: str, role: str) -> np.ndarray:
    """Return the columns of data as an array, (n_samples, n_signals), in the order of the signals.

    The columns of a DataFrame are found by name, with or without the unit, where all signals are among them;
    where none is, they are taken in order, as those of any array are.

    Parameters
    ----------
    data : array-like, Series or DataFrame of shape (n_samples,) or (n_samples, n_columns)
    signals : sequence of Signal
        The simulator's.
    name : str
        What the caller's argument is called, ``"X"``.
    role : {"input", "output"}
        What the signals are.

    Raises
    ------
    ValueError
        If columns are lacking, too many, or named alike, or a label states another unit than the signal.
    """
    data = chosen_columns(data, signals, name, role)
    values = as_signals(data, name)
    wanted = [str(signal) for signal in signals]
    if values.shape[1] != len(wanted):
        more = role == "output" and values.shape[1] > len(wanted)
        told = " What else was measured is told to the simulator: outputs=[...]." if more else ""
        raise ValueError(
            f"{name} has {values.shape[1]} columns, the simulator has {len(wanted)} {role}s: {wanted}. Pass "
            f"one column for each, in this order, or a DataFrame with columns of these names.{told}"
        )
    _unlike(data, signals, name, role)
    return values


def chosen_columns(data, signals: Sequence, name: str, role: str):
    """Return a DataFrame's columns in the order of the signals; what has none of their names as it is."""
    if not hasattr(data, "columns"):
        return data
    labels = list(data.columns)
    places = [_places(labels, signal) for signal in signals]
    missing = [str(signal) for signal, found in zip(signals, places, strict=True) if not found]
    if len(missing) == len(places) == len(labels) and missing:
        return data  # none of the names: in order
    if missing:
        raise ValueError(
            f"{name} lacks the columns {missing}; it has {[str(label) for label in labels]}, the simulator's "
            f"{role}s are {[str(signal) for signal in signals]}. Rename its columns, or pass those of the "
            f"{role}s alone, in this order, as an array."
        )
    for signal, found in zip(signals, places, strict=True):
        if len(found) > 1:
            raise ValueError(
                f"{name} has {len(found)} columns for the {role} {str(signal)!r}: "
                f"{[str(labels[i]) for i in found]}. Drop or rename all but one."
            )
    return data.iloc[:, [found[0] for found in places]]


def _places(labels: Sequence, signal) -> list[int]:
    """Return which columns have a signal's name; those with its unit too, if any has."""
    split = [split_unit(label) for label in labels]
    found = [i for i, (name, _) in enumerate(split) if name == signal.name]
    if not found:  # a twin's signals are called as in terms
        called = [signal_names([name], "u")[0] for name, _ in split]
        found = [i for i, name in enumerate(called) if name == signal.name]
    exact = [i for i in found if (split[i][1] or "") == signal.unit]
    return exact or found


def _unlike(data, signals: Sequence, name: str, role: str) -> list[tuple[str, dict]]:
    """Return, in words and as evidence, labels in units not to be compared; raise where one is another."""
    told = []
    for label, signal in zip(column_labels(data) or [], signals, strict=False):
        unit = split_unit(label)[1] if isinstance(label, str) else None
        column, whose = f"{name}'s column {label!r}", f"the simulator's {role} {str(signal)!r}"
        words = compare_units(column, unit or "", whose, signal.unit)
        if words:
            told.append((words, {role: signal.name, "label": label, "unit": signal.unit}))
    return told


def unlike_units(data, signals: Sequence, name: str, role: str) -> list[tuple[str, dict]]:
    """Return, in words and as evidence, each label whose unit is not that of its signal in any known way."""
    return _unlike(chosen_columns(data, signals, name, role), signals, name, role)

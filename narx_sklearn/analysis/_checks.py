"""Checks of the arguments that the analyses share."""

from collections.abc import Mapping

import numpy as np

from narx_sklearn._validation import as_signals
from narx_sklearn.model.narx import NARXModel


def check_levels(model: NARXModel, X) -> np.ndarray:
    """Return ``X`` as finite input values of shape (n_points, n_inputs)."""
    X = as_signals(X, "X")
    if X.shape[1] != len(model.inputs):
        raise ValueError(
            f"X has {X.shape[1]} columns, the model has the {len(model.inputs)} inputs {list(model.inputs)}."
        )
    if not np.isfinite(X).all():
        raise ValueError("X holds values that are not finite; an analysis needs every input value.")
    return X


def check_output(model: NARXModel, output: str | None) -> str:
    """Return the output's name, the first one by default."""
    if output is None:
        return model.outputs[0]
    if output not in model.outputs:
        raise ValueError(f"output={output!r} is not an output of the model; it has {list(model.outputs)}.")
    return output


def check_driver(model: NARXModel, driver: str | None) -> str:
    """Return the name of the input that is loaded and unloaded, the only one by default."""
    if driver is None and len(model.inputs) == 1:
        return model.inputs[0]
    if driver not in model.inputs:
        raise ValueError(
            f"driver={driver!r}, but the input that is loaded and unloaded must be one of "
            f"{list(model.inputs)}; name it."
        )
    return driver


def inputs_along(model: NARXModel, driver: str, signal: np.ndarray, at: Mapping[str, float] | None):
    """Return inputs of shape (n_samples, n_inputs): ``signal`` for the driver, constants for the others."""
    at = dict(at or {})
    wrong = at.keys() - set(model.inputs) | at.keys() & {driver}
    if wrong:
        others = [name for name in model.inputs if name != driver]
        raise ValueError(f"at names {sorted(wrong)}; it gives constant values of the inputs {others}.")
    columns = [
        signal if name == driver else np.full(signal.size, float(at.get(name, model.origin.get(name, 0.0))))
        for name in model.inputs
    ]
    return np.column_stack(columns)


def unit_label(model: NARXModel, signal: str) -> str:
    """Return a signal's name with its unit, as axes carry it."""
    return f"{signal} ({model.units[signal]})" if model.units.get(signal) else signal

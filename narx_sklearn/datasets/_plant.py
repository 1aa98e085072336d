"""What all synthetic plants share: checks of their arguments, and how a simulation becomes a result."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from narx_sklearn.datasets._results import PlantTruth, SyntheticPlant

__all__ = ["check_input", "check_numbers", "check_state", "make_plant"]


def check_numbers(positive: Mapping[str, float], non_negative: Mapping[str, float]) -> None:
    """Refuse numbers that are not finite, not positive, or negative, by name."""
    for name, value in positive.items():
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} is {value!r}, but must be a finite number above zero.")
    for name, value in non_negative.items():
        if not (np.isfinite(value) and value >= 0):
            raise ValueError(f"{name} is {value!r}, but must be a finite number, zero or above.")


def check_input(u, n_samples: int, n_inputs: int = 1, name: str = "u") -> np.ndarray | None:
    """Return the user's input as an array of shape (n_samples, n_inputs), or None where none is given."""
    if u is None:
        if n_samples < 2:
            raise ValueError(f"n_samples is {n_samples!r}, but must be at least 2.")
        return None
    u = np.array(u, dtype=float)
    u = u.reshape(-1, 1) if u.ndim == 1 and n_inputs == 1 else u
    if u.ndim != 2 or u.shape[1] != n_inputs or len(u) < 2:
        wanted = "(n_samples,)" if n_inputs == 1 else f"(n_samples, {n_inputs})"
        raise ValueError(f"{name} has shape {u.shape}, but must have shape {wanted} with at least 2 samples.")
    if not np.isfinite(u).all():
        bad = int(np.flatnonzero(~np.isfinite(u).all(axis=1))[0])
        raise ValueError(f"{name} is not finite at sample {bad}. Replace or cut such samples.")
    return u


def check_state(initial_state, names: tuple[str, ...]) -> np.ndarray:
    """Return the initial state as a float array; None is rest."""
    if initial_state is None:
        return np.zeros(len(names))
    x0 = np.array(initial_state, dtype=float)
    if x0.shape != (len(names),) or not np.isfinite(x0).all():
        raise ValueError(
            f"initial_state is {initial_state!r}, but must be {len(names)} finite numbers "
            f"({', '.join(names)})."
        )
    return x0


def make_plant(
    *,
    name: str,
    X: Mapping[str, np.ndarray],
    y: np.ndarray,
    output: str,
    states: Mapping[str, np.ndarray],
    sampling_period: float,
    equation: str,
    parameters: Mapping[str, float],
    noise: float,
    rng,
    DESCR: str,
    y_measured: np.ndarray | None = None,
) -> SyntheticPlant:
    """Add measurement noise and name everything.

    `noise` is relative to the standard deviation of `y`. A plant whose controller acts on the measured output
    hands that in as `y_measured`, with its noise.
    """
    frame = pd.DataFrame({key: np.asarray(value) for key, value in states.items()})
    finite = np.isfinite(y) & np.isfinite(frame.to_numpy()).all(axis=1)
    if not finite.all():
        raise ValueError(
            f"The simulation of {name} left the finite range at sample {int(np.flatnonzero(~finite)[0])}. "
            "Take a smaller sampling period, a smaller input or milder parameters."
        )
    if y_measured is None:
        y_measured = y + noise * np.std(y) * rng.standard_normal(y.size)
    return SyntheticPlant(
        name=name,
        X=pd.DataFrame(dict(X)),
        y=pd.Series(y_measured, name=output),
        sampling_period=float(sampling_period),
        truth=PlantTruth(equation, dict(parameters), pd.Series(y, name=output), frame),
        DESCR=DESCR,
    )

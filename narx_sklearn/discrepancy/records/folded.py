"""Readings that fold: angles that begin anew after a turn, and sizes of what has a sign."""

from collections.abc import Sequence

import numpy as np

from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.model.units import scale_to
from narx_sklearn.physics.effects._effect import Effect, no_start

FAR = 0.5  # of a signal's range, beyond which a step may be to the other end of a turn
TURNS = (2 * np.pi, 360.0)  # that a reading may have whose unit nobody told, and 1 and powers of two
NEAR = 0.02  # of a turn, by which what the steps tell of it may be off


def _size(signal, second, dt, theta, first):
    return np.abs(signal)


UNSIGNED = Effect(
    code="unsigned",
    title="Reading without a sign",
    sentence="The sensor shows how large it is, not which way it goes.",
    equation="|s|",
    parameters=(),
    starts=no_start,
    transform=_size,
    input_port=False,
    amplitude=None,
    source="Wigren and Schoukens 2017, Coupled electric drives data set (a pulse counter's speed)",
)


def unsigned_at(output: int) -> PlacedEffect:
    """Return a reading without a sign at an output.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.records.folded import unsigned_at
    >>> unsigned_at(0).effect.transform(np.array([-2.0, 3.0]), None, 0.1, (), [0]).tolist()
    [2.0, 3.0]
    """
    return PlacedEffect(UNSIGNED, Port("output", output))


def reads_size(placed: PlacedEffect) -> bool:
    """Tell whether an effect takes the sign off an output."""
    return placed.effect is UNSIGNED


def turn_of(values: np.ndarray, unit: str, sessions: Sequence[slice]) -> float | None:
    """Return the turn after which a reading begins anew; None where no step is like one.

    A step by more than half of the range goes a turn back, beside what the signal moves in that sample, as it
    does before and after. The turn of an angle is that of its unit; that of a count a power of two.

    Parameters
    ----------
    values : ndarray of shape (n_samples,)
        The reading; NaN where nothing was read.
    unit : str
        Of the reading; empty where nobody told.
    sessions : sequence of slice
        Between which nothing is a step.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.records.folded import turn_of
    >>> shaft = np.arange(300) * 0.1
    >>> round(turn_of((shaft + np.pi) % (2 * np.pi) - np.pi, "rad", [slice(0, 300)]), 6)
    6.283185
    >>> turn_of(np.sin(shaft), "rad", [slice(0, 300)]) is None
    True
    """
    found = []
    far = FAR * np.ptp(values[np.isfinite(values)]) if np.isfinite(values).any() else np.inf
    for session in sessions:
        own = values[session]
        steps = np.diff(own[np.isfinite(own)])
        at = np.flatnonzero(np.abs(steps) > far) if steps.size > 2 else ()
        for k in at:
            beside = [steps[i] for i in (k - 1, k + 1) if 0 <= i < steps.size and i not in at]
            found.append(abs(steps[k] - np.mean(beside)) if beside else abs(steps[k]))
    if not found:
        return None
    size = float(np.median(found))
    return min((t for t in _known(size, unit) if abs(size - t) <= NEAR * t), default=size)


def _known(size: float, unit: str) -> list[float]:
    """Return the turns that a reading in some unit may have."""
    if unit:
        turn = scale_to("rev", unit)
        return [turn] if turn else []
    return [*TURNS, float(2.0 ** max(round(np.log2(size)), 0))]


def unfolded(values: np.ndarray, turn: float, sessions: Sequence[slice]) -> np.ndarray:
    """Return a reading that goes on from turn to turn, in each session from where it begins.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.records.folded import unfolded
    >>> unfolded(np.array([350.0, np.nan, 10.0, 30.0]), 360.0, [slice(0, 4)]).tolist()
    [350.0, nan, 370.0, 390.0]
    """
    out = values.copy()
    for session in sessions:
        own = out[session]
        seen = np.isfinite(own)
        own[seen] = np.unwrap(own[seen], period=turn)
    return out

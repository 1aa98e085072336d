"""First-order reversal curves: the minor loops that tell one hysteresis from another."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

__all__ = ["ReversalCurves", "first_order_reversal_curves"]


@dataclass(frozen=True)
class ReversalCurves:
    """First-order reversal curves on one grid of inputs.

    Attributes
    ----------
    inputs : ndarray of shape (n_inputs,)
        Grid of inputs, increasing, in their unit.
    reversals : ndarray of shape (n_curves,)
        Input at which each curve turns, decreasing; values of the grid.
    outputs : ndarray of shape (n_curves, n_inputs)
        Output on the way back up from each reversal; NaN below it.
    descending : ndarray of shape (n_inputs,)
        Output on the way down from the largest to the smallest input (upper branch of the major loop).
    """

    inputs: np.ndarray
    reversals: np.ndarray
    outputs: np.ndarray
    descending: np.ndarray


def first_order_reversal_curves(
    system: Callable[[np.ndarray], np.ndarray],
    u_min: float,
    u_max: float,
    *,
    n_curves: int = 10,
    n_inputs: int = 101,
) -> ReversalCurves:
    """Record first-order reversal curves of a system, as in Preisach's identification.

    The input goes from `u_min` to `u_max`, down to a reversal point and back to `u_max`, each time deeper,
    the last time to `u_min`, in one run. Curves of a Prandtl-Ishlinskii operator are copies of one curve;
    those of a general Preisach operator are not; those of a local memory depend on the output alone.

    Parameters
    ----------
    system : callable
        ``system(u) -> y`` for a whole signal, such as ``operator.run`` or a simulation that starts anew at
        each call.
    u_min, u_max : float
        Range of the input, in its unit.
    n_curves : int, default=10
        Number of curves, at most ``n_inputs - 1``.
    n_inputs : int, default=101
        Points of the grid from `u_min` to `u_max`, at least 2.

    Returns
    -------
    ReversalCurves

    Raises
    ------
    ValueError
        If the range is empty, the numbers are too small, or `system` returns another length.

    References
    ----------
    Mayergoyz (2003), Mathematical Models of Hysteresis and Their Applications, section 1.2.

    Examples
    --------
    >>> from narx_sklearn.physics import PrandtlIshlinskiiOperator, first_order_reversal_curves
    >>> operator = PrandtlIshlinskiiOperator((0, 0.5), (1.0, 1.0))
    >>> curves = first_order_reversal_curves(operator.run, -1, 1, n_curves=2, n_inputs=5)
    >>> curves.outputs[0].tolist()
    [nan, nan, 0.5, 1.0, 1.5]
    """
    if not (np.isfinite(u_min) and np.isfinite(u_max) and u_min < u_max):
        raise ValueError(f"u_min must lie below u_max, got u_min={u_min!r} and u_max={u_max!r}.")
    if n_inputs < 2 or not 1 <= n_curves <= n_inputs - 1:
        raise ValueError(
            f"n_curves={n_curves} must lie between 1 and n_inputs - 1, and n_inputs={n_inputs} must be at "
            "least 2."
        )
    inputs = np.linspace(u_min, u_max, n_inputs)
    last = n_inputs - 1
    turns = np.round(np.linspace(last, 0, n_curves + 1)).astype(int)[1:]
    legs = [np.arange(n_inputs)]
    for turn in turns:
        legs += [np.arange(last - 1, turn - 1, -1), np.arange(turn + 1, n_inputs)]
    path = np.concatenate(legs)
    y = np.asarray(system(inputs[path]), dtype=float).reshape(-1)
    if y.size != path.size:
        raise ValueError(f"system returned {y.size} samples for an input of {path.size}.")
    outputs = np.full((n_curves, n_inputs), np.nan)
    start = last  # sample at which the input is at u_max, before the next reversal
    for row, turn in enumerate(turns):
        bottom = start + last - turn
        outputs[row, turn:] = y[bottom : bottom + last - turn + 1]
        start = bottom + last - turn
    descending = y[start - 2 * last : start - last + 1][::-1]
    return ReversalCurves(inputs, inputs[turns], outputs, descending)

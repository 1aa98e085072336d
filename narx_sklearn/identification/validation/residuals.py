"""What a model leaves over of measured outputs: errors that are white where it and its noise are right.

Noise in the equation is what cannot be known one step ahead. Noise on the output is white in the error of
the free run, while one step ahead a model passes on that of the past outputs: its errors there are coloured
however right it is. A free run begins with measured, noisy outputs, and a slow machine keeps that error for
long, so the initial condition is fitted and projected out.
"""

import numpy as np

from narx_sklearn._validation import finite_rows, finite_slices, session_slices
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.simulation import free_run, predict_one_step

__all__ = ["model_residuals", "one_step_residuals", "simulation_residuals"]

NUDGE = 1e-4  # of an output's deviation: far above rounding, far below what bends a model


def model_residuals(model: NARXModel, X: np.ndarray, y: np.ndarray, noise: str, sessions=None) -> np.ndarray:
    """Return the residuals that are white where the noise is in the equation, or white on the output.

    Parameters
    ----------
    model : NARXModel
        The model.
    X : ndarray of shape (n_samples, n_inputs)
        Inputs; NaN marks gaps.
    y : ndarray of shape (n_samples, n_outputs)
        Measured outputs; NaN marks gaps.
    noise : {"equation", "output", "mixed"}
        Where the noise is; ``"mixed"`` is white in neither, and gets the errors one step ahead.
    sessions : array-like of shape (n_samples,), default=None
        One label a sample.

    Returns
    -------
    ndarray of shape (n_samples, n_outputs)
        NaN where a lagged value is not known.
    """
    one_step = one_step_residuals(model, X, y, sessions)
    if noise != "output":
        return one_step
    return np.where(np.isfinite(one_step), simulation_residuals(model, X, y, sessions), np.nan)


def one_step_residuals(model: NARXModel, X: np.ndarray, y: np.ndarray, sessions=None) -> np.ndarray:
    """Return measured outputs minus their predictions one step ahead."""
    return y - predict_one_step(model, X, y, sessions=sessions)


def simulation_residuals(model: NARXModel, X: np.ndarray, y: np.ndarray, sessions=None) -> np.ndarray:
    """Return measured outputs minus free runs that begin where they fit best; NaN where they begin.

    Examples
    --------
    A tank that loses nothing keeps an error of its first level for ever; the rest of this record is exact:

    >>> import numpy as np
    >>> from narx_sklearn.identification.validation.residuals import simulation_residuals
    >>> from narx_sklearn.model import NARXModel
    >>> tank = NARXModel.from_equations("y[k-1] + u[k-1]")
    >>> u, level = np.ones((5, 1)), np.array([[0.5], [1.0], [2.0], [3.0], [4.0]])
    >>> np.abs(simulation_residuals(tank, u, level)).round(9).ravel().tolist()
    [nan, 0.0, 0.0, 0.0, 0.0]
    """
    depth = model.max_lag
    left = np.full(y.shape, np.nan)
    known = finite_rows(y)
    spread = np.nanstd(y, axis=0)
    nudges = NUDGE * np.where(spread > 0.0, spread, 1.0)
    for piece in finite_slices(session_slices(sessions, X.shape[0]), finite_rows(X)):
        begin = _first_known(known[piece], depth)
        if begin is not None:
            inside = slice(piece.start + begin, piece.stop)
            left[inside] = _of_one_run(model, X[inside], y[inside], nudges)
    return left


def _first_known(known: np.ndarray, depth: int) -> int | None:
    """Return where ``depth`` known samples in a row begin first, with at least one sample after them."""
    return next((k for k in range(known.size - depth) if known[k : k + depth].all()), None)


def _of_one_run(model: NARXModel, X: np.ndarray, y: np.ndarray, nudges: np.ndarray) -> np.ndarray:
    """Return the error of one free run without what moves of its initial outputs explain of it."""
    depth = model.max_lag
    start = y[:depth]
    run = free_run(model, X, start).y
    error = y - run
    error[:depth] = np.nan
    moves = []
    for k, output in np.ndindex(start.shape):
        moved = start.copy()
        moved[k, output] += nudges[output]
        moves.append((free_run(model, X, moved).y - run).ravel())
    judged = np.isfinite(error).ravel() & np.isfinite(moves).all(axis=0)
    if moves and judged.any():
        J = np.transpose(moves)
        explained = np.linalg.lstsq(J[judged], error.ravel()[judged], rcond=None)[0]
        error -= (J @ explained).reshape(error.shape)
    return error

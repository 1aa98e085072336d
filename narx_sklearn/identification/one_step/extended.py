"""Extended least squares: noise terms take up coloured residuals while fitting, and are dropped after."""

import numpy as np

from narx_sklearn.identification.one_step.regressors import Candidates
from narx_sklearn.identification.structure.constraints import LinearConstraints

__all__ = ["extended_least_squares"]

MAX_ITERATIONS = 50
TOLERANCE = 1e-8


def extended_least_squares(
    candidates: Candidates,
    output: int,
    theta: np.ndarray,
    noise_lags: int,
    constraints: LinearConstraints | None = None,
) -> np.ndarray:
    """Estimate parameters with a moving average of the residuals in the regression.

    Each round computes residuals, appends their lags 1 to ``noise_lags`` as regressors, and solves again;
    lags of residuals never reach across a session's edge or a gap, where they are zero.

    Parameters
    ----------
    candidates : Candidates
        The chosen terms on the record, scaled.
    output : int
        Which output.
    theta : ndarray of shape (n_terms,)
        Least-squares parameters to start from; they obey the constraints.
    noise_lags : int
        Number of lagged residuals.
    constraints : LinearConstraints, default=None
        Equality constraints on the parameters of the terms, solved in their solution space.

    Returns
    -------
    ndarray of shape (n_terms,)
        Parameters of the terms, without those of the noise.

    References
    ----------
    L. Ljung (1999), System Identification, section 10.3; S. Billings (2013), section 3.4.
    """
    fixed, free = (constraints or LinearConstraints.none(theta.size)).solution_space()
    Psi = candidates.matrix()
    y = candidates.targets[:, output] - Psi @ fixed
    Psi, theta = Psi @ free, free.T @ (theta - fixed)
    start = candidates.recording.session_start[candidates.rows]
    residual = y - Psi @ theta
    for _ in range(MAX_ITERATIONS):
        lagged = np.column_stack(
            [_lag(residual, candidates.rows, start, lag) for lag in range(1, noise_lags + 1)]
        )
        both = np.hstack([Psi, lagged])
        scale = np.maximum(np.linalg.norm(both, axis=0), np.finfo(float).tiny)
        solution = np.linalg.lstsq(both / scale, y, rcond=1e-13)[0] / scale
        change = np.abs(solution[: theta.size] - theta).max(initial=0.0)
        theta = solution[: theta.size]
        residual = y - both @ solution
        if change <= TOLERANCE * np.abs(theta).max(initial=1.0):
            break
    return fixed + free @ theta


def _lag(residual: np.ndarray, rows: np.ndarray, start: np.ndarray, lag: int) -> np.ndarray:
    """Return residual[k-lag] at the usable samples; zero where that sample is not usable."""
    shifted = np.zeros_like(residual)
    same = (rows[lag:] - rows[:-lag] == lag) & (start[lag:] == start[:-lag])
    shifted[lag:][same] = residual[:-lag][same]
    return shifted

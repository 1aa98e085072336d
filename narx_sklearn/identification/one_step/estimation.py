"""Estimation of parameters on the compressed record, and recursively sample by sample."""

import warnings
from dataclasses import dataclass
from numbers import Real

import numpy as np
from numba import njit
from scipy.linalg import qr, solve_triangular

from narx_sklearn.exceptions import RankWarning
from narx_sklearn.identification.one_step.factor import Factor
from narx_sklearn.identification.structure.constraints import LinearConstraints

__all__ = ["RecursiveEstimate", "least_squares", "recursive_least_squares"]

SINGULAR = 1e-13  # smallest over largest diagonal of R, columns scaled to one, that still counts as full rank

# Variable forgetting measures the scale of the residuals as a running mean square:
TRANSIENT = 2  # samples for each parameter that do not count, because the estimates still start
WARM_UP = 10  # samples for each parameter over which the first scale is averaged
SCALE_RATE = 0.01  # weight of a sample after that
LARGEST_SURPRISE = 9.0  # multiple of the scale at which a squared residual is cut before it counts
QUIET = 1e-8  # share of the output's mean square that always counts


@dataclass(frozen=True)
class RecursiveEstimate:
    """What recursive least squares returns.

    Attributes
    ----------
    theta : ndarray of shape (n_terms,)
        Parameters after the last sample.
    history : ndarray of shape (n_samples, n_terms)
        Parameters after every sample.
    covariance : ndarray of shape (n_terms, n_terms)
        The matrix P after the last sample.
    forgetting : ndarray of shape (n_samples,)
        Forgetting factor used at every sample.
    """

    theta: np.ndarray
    history: np.ndarray
    covariance: np.ndarray
    forgetting: np.ndarray


def least_squares(
    factor: Factor,
    *,
    output: int = 0,
    constraints: LinearConstraints | None = None,
    alpha: float = 0.0,
) -> tuple[np.ndarray, float]:
    """Estimate the parameters of all terms of a factor by least squares.

    Minimises ``|y - Psi theta|^2 + alpha |D theta|^2`` subject to ``S theta = c``, where D holds the root
    mean squares of the regressors, so that ``alpha`` has no unit.

    Parameters
    ----------
    factor : Factor
        Compressed record of the chosen terms.
    output : int, default=0
        Which output.
    constraints : LinearConstraints, default=None
        Equality constraints (2.47). Solved in their solution space, which is (2.48) without forming
        (Psi'Psi)^-1.
    alpha : float, default=0
        Ridge penalty, in multiples of the number of samples.

    Returns
    -------
    theta : ndarray of shape (n_terms,)
    rss : float
        Sum of squared residuals.

    Warns
    -----
    RankWarning
        If the regressors are collinear to rounding; the smallest-norm solution is returned.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification import Factor, least_squares
    >>> Psi = np.random.default_rng(0).normal(size=(50, 2))
    >>> theta, rss = least_squares(Factor.of(Psi, Psi @ [1.0, -2.0]))
    >>> theta.round(6).tolist()
    [1.0, -2.0]
    """
    P, y = factor.Psi, factor.target(output)
    scale = np.linalg.norm(P, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    P = P / scale
    theta0, Z = np.zeros(P.shape[1]), np.eye(P.shape[1])
    if constraints is not None and len(constraints):
        theta0, Z = constraints.scaled(1.0 / scale).solution_space()
    A, b = P @ Z, y - P @ theta0
    if alpha > 0.0:
        root = np.sqrt(alpha)
        A, b = np.vstack([A, root * Z]), np.concatenate([b, -root * theta0])
    theta = theta0 + Z @ _solve(A, b)
    residual = y - P @ theta
    return theta / scale, float(residual @ residual)


def _solve(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    if A.shape[1] == 0:
        return np.zeros(0)
    Q, R, order = qr(A, mode="economic", pivoting=True, check_finite=False)
    diagonal = np.abs(np.diag(R))
    if R.shape[0] < R.shape[1] or diagonal[-1] <= SINGULAR * diagonal[0]:
        rank = int(np.sum(diagonal > SINGULAR * diagonal[0]))
        warnings.warn(
            f"The chosen regressors have rank {rank} of {A.shape[1]} (pivot ratio "
            f"{diagonal[-1] / max(diagonal[0], np.finfo(float).tiny):.1e}): their parameters cannot be told "
            "apart on these data. Use fewer terms, richer excitation, or alpha > 0.",
            RankWarning,
            stacklevel=4,
        )
        return np.linalg.lstsq(A, b, rcond=SINGULAR)[0]
    solution = np.empty(A.shape[1])
    solution[order] = solve_triangular(R, Q.T @ b, check_finite=False)
    return solution


def recursive_least_squares(
    Psi,
    y,
    *,
    forgetting: float | str = 1.0,
    theta=None,
    covariance=1e6,
    sensitivity: float = 0.02,
    forgetting_min: float = 0.9,
) -> RecursiveEstimate:
    """Estimate parameters sample by sample (2.50)-(2.52).

    Parameters
    ----------
    Psi : array-like of shape (n_samples, n_terms)
        Regressors.
    y : array-like of shape (n_samples,)
        Output.
    forgetting : float or "variable", default=1.0
        Constant forgetting factor in (0, 1]. ``"variable"`` lowers it where a residual is larger than its
        running scale explains, ``lambda = 1 - sensitivity (e^2/s - 1)`` cut to [forgetting_min, 1], and
        scales P no larger than it began.
    theta : array-like of shape (n_terms,), default=None
        Parameters to start from; zeros when None.
    covariance : float or array-like of shape (n_terms, n_terms), default=1e6
        P to start from; a number stands for that multiple of the identity.
    sensitivity : float, default=0.02
        How fast variable forgetting reacts.
    forgetting_min : float, default=0.9
        Smallest variable forgetting factor.

    Returns
    -------
    RecursiveEstimate

    Raises
    ------
    ValueError
        If the forgetting factor is not in (0, 1] or shapes do not fit.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification import recursive_least_squares
    >>> Psi = np.random.default_rng(0).normal(size=(200, 2))
    >>> recursive_least_squares(Psi, Psi @ [1.0, -2.0]).theta.round(3).tolist()
    [1.0, -2.0]
    """
    Psi = np.ascontiguousarray(Psi, dtype=float)
    y = np.ascontiguousarray(y, dtype=float).reshape(-1)
    n_samples, n_terms = Psi.shape
    if y.size != n_samples:
        raise ValueError(f"Psi has {n_samples} rows, y has {y.size} samples; they must agree.")
    variable = forgetting == "variable"
    if not variable and not (isinstance(forgetting, Real) and 0.0 < forgetting <= 1.0):
        raise ValueError(f"forgetting must be a number in (0, 1] or 'variable', got {forgetting!r}.")
    start = np.zeros(n_terms) if theta is None else np.array(theta, dtype=float)
    P = np.array(covariance, dtype=float) if np.ndim(covariance) else float(covariance) * np.eye(n_terms)
    history, factors = np.empty((n_samples, n_terms)), np.empty(n_samples)
    _recursive_least_squares(
        Psi, y, 1.0 if variable else float(forgetting), variable, sensitivity, forgetting_min,
        start, P, history, factors,
    )  # fmt: skip
    return RecursiveEstimate(start, history, P, factors)


@njit(cache=True, nogil=True)
def _recursive_least_squares(Psi, y, constant, variable, sensitivity, smallest, theta, P, history, factors):
    """Run (2.50)-(2.52); theta and P are updated in place, history and factors are written."""
    n_samples, n_terms = Psi.shape
    first, settled = TRANSIENT * n_terms, (TRANSIENT + WARM_UP) * n_terms
    scale, power = 0.0, 0.0
    trace_limit = np.trace(P)
    for k in range(n_samples):
        psi = Psi[k]
        gain = P @ psi
        error = y[k] - psi @ theta
        forgetting = constant
        if variable:
            square = error * error
            power += (y[k] * y[k] - power) / (k + 1)
            if k >= settled:
                surprise = square / max(scale, 1e-300) - 1.0
                forgetting = min(1.0, max(smallest, 1.0 - sensitivity * max(surprise, 0.0)))
                # a change of parameters must not pass for noise at once, nor a quiet start bind for ever
                square = min(square, max(LARGEST_SURPRISE * scale, QUIET * power))
                scale += SCALE_RATE * (square - scale)
            elif k >= first:
                scale += (square - scale) / (k - first + 1)
            if np.trace(P) > trace_limit:
                forgetting = 1.0
        denominator = psi @ gain + forgetting
        for i in range(n_terms):
            theta[i] += gain[i] * error / denominator
        for i in range(n_terms):
            for j in range(i + 1):
                value = (P[i, j] - gain[i] * gain[j] / denominator) / forgetting
                P[i, j] = value
                P[j, i] = value
        history[k] = theta
        factors[k] = forgetting

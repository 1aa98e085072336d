"""Parameter covariance and confidence intervals that stay honest when residuals are coloured.

The scores (regressor or sensitivity times residual) are summed over a fixed number of long stretches of
record. Their scatter holds whatever the colour of the residuals, as long as a stretch is longer than the
memory of the noise; with few stretches the intervals are Student's (fixed-b asymptotics).
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from narx_sklearn.identification.constraints import LinearConstraints
from narx_sklearn.identification.regressors import Candidates

__all__ = ["OneStepScores", "ParameterUncertainty", "one_step_scores", "parameter_uncertainty"]

STRETCHES = 24  # few enough to be long, enough for intervals within 6 % of the normal's
SHORTEST_STRETCH = 8  # samples


@dataclass(frozen=True, eq=False)
class ParameterUncertainty:
    """Covariance of estimated parameters.

    Attributes
    ----------
    covariance : ndarray of shape (n_terms, n_terms)
        Robust covariance.
    degrees_of_freedom : int
        Of the Student distribution of the estimates.
    """

    covariance: np.ndarray
    degrees_of_freedom: int

    @property
    def standard_errors(self) -> np.ndarray:
        """Square roots of the variances; zero for parameters that constraints fix."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def intervals(self, theta: np.ndarray, level: float = 0.95) -> np.ndarray:
        """Return confidence intervals, shape (n_terms, 2).

        Raises
        ------
        ValueError
            If ``level`` is not between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise ValueError(f"level must lie between 0 and 1, got {level!r}.")
        half = student.ppf(0.5 + level / 2.0, self.degrees_of_freedom) * self.standard_errors
        return np.column_stack([theta - half, theta + half])


def n_stretches(n_samples: int) -> int:
    """Return into how many stretches a record is cut."""
    return int(np.clip(n_samples // SHORTEST_STRETCH, 2, STRETCHES))


@dataclass(frozen=True, eq=False)
class OneStepScores:
    """Sums over a record that the covariance of least-squares parameters is made of.

    Attributes
    ----------
    gram : ndarray of shape (n_terms, n_terms)
        Psi'Psi.
    sums : ndarray of shape (n_stretches, n_terms)
        Psi'xi, summed over stretches of the record.
    residual_deviation : float
        Standard deviation of the one-step residuals xi, degrees of freedom taken off.
    """

    gram: np.ndarray
    sums: np.ndarray
    residual_deviation: float


def one_step_scores(
    parts: Callable[[], Iterable[Candidates]], theta: np.ndarray, output: int
) -> OneStepScores:
    """Sum Gram matrix and scores psi (y - psi'theta) over a record, block by block.

    Parameters
    ----------
    parts : callable
        Returns the chosen terms on the record, piece by piece; called twice.
    theta : ndarray of shape (n_terms,)
        Their parameters, in the scaled coordinates of the candidates.
    output : int
        Which output.

    Returns
    -------
    OneStepScores
    """
    n_samples = sum(part.n_rows for part in parts())
    sums = np.zeros((n_stretches(n_samples), theta.size))
    gram = np.zeros((theta.size, theta.size))
    done, power = 0, 0.0
    for part in parts():
        for block in part.blocks():
            P = block[: theta.size]
            residual = block[theta.size + output] - theta @ P
            gram += P @ P.T
            power += float(residual @ residual)
            stretch = (done + np.arange(P.shape[1])) * sums.shape[0] // n_samples
            for w in range(stretch[0], stretch[-1] + 1):
                inside = stretch == w
                sums[w] += P[:, inside] @ residual[inside]
            done += P.shape[1]
    return OneStepScores(gram, sums, float(np.sqrt(power / max(n_samples - theta.size, 1))))


def parameter_uncertainty(
    gram: np.ndarray, scores: np.ndarray, constraints: LinearConstraints | None = None
) -> ParameterUncertainty:
    """Return the sandwich covariance of an estimate from its Gram matrix and scores.

    Parameters
    ----------
    gram : ndarray of shape (n_terms, n_terms)
        J'J, J the derivative of the predictions with respect to the parameters.
    scores : ndarray of shape (n_stretches, n_terms)
        J'r summed over stretches of the record.
    constraints : LinearConstraints, default=None
        Constraints that the estimate obeys.

    Returns
    -------
    ParameterUncertainty
    """
    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    Z = np.eye(scale.size)
    if constraints is not None and len(constraints):
        _, Z = constraints.scaled(1.0 / scale).solution_space()
    G = Z.T @ (gram / np.outer(scale, scale)) @ Z
    inverse = Z @ np.linalg.pinv(G, rcond=1e-13, hermitian=True) @ Z.T
    count = scores.shape[0]
    centred = (scores - scores.mean(axis=0)) / scale
    meat = centred.T @ centred * count / (count - 1)
    covariance = inverse @ meat @ inverse / np.outer(scale, scale)
    return ParameterUncertainty(covariance, count - 1)

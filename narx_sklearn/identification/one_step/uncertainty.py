"""Parameter covariance and confidence intervals that stay honest when residuals are coloured.

The scores (regressor or sensitivity times residual) are summed over a fixed number of long stretches of
record. Their scatter holds whatever the colour of the residuals, as long as a stretch is longer than the
memory of the noise; with few stretches the intervals are Student's (fixed-b asymptotics). Residuals are
smaller than the noise where a stretch has leverage on the parameters; where its share of the information is
known that is corrected, and counted in the degrees of freedom.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from narx_sklearn.identification.one_step.regressors import Candidates
from narx_sklearn.identification.structure.constraints import LinearConstraints

__all__ = ["OneStepScores", "ParameterUncertainty", "one_step_scores", "parameter_uncertainty"]

STRETCHES = 12  # few enough to be long, enough for intervals within 13 % of the normal's
SHORTEST_STRETCH = 8  # samples
RANK = 1e-13  # eigenvalues of the scaled Gram matrix below this share of the largest count as zero
ALONE = 1e-10  # what is left of 1 - leverage where a stretch alone determines a parameter


@dataclass(frozen=True, eq=False)
class ParameterUncertainty:
    """Covariance of estimated parameters.

    Attributes
    ----------
    covariance : ndarray of shape (n_terms, n_terms)
        Robust covariance.
    degrees_of_freedom : float or ndarray of shape (n_terms,)
        Of the Student distribution of the estimates.
    """

    covariance: np.ndarray
    degrees_of_freedom: float | np.ndarray

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
    """Sums over stretches of a record that the covariance of least-squares parameters is made of.

    Attributes
    ----------
    grams : ndarray of shape (n_stretches, n_terms, n_terms)
        Psi'Psi of each stretch.
    sums : ndarray of shape (n_stretches, n_terms)
        Psi'xi of each stretch.
    residual_deviation : float
        Standard deviation of the one-step residuals xi, degrees of freedom taken off.
    """

    grams: np.ndarray
    sums: np.ndarray
    residual_deviation: float

    @property
    def gram(self) -> np.ndarray:
        """Psi'Psi of the record, shape (n_terms, n_terms)."""
        return self.grams.sum(axis=0)


def one_step_scores(
    parts: Callable[[], Iterable[Candidates]], theta: np.ndarray, output: int
) -> OneStepScores:
    """Sum Gram matrices and scores psi (y - psi'theta) over stretches of a record, block by block.

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
    count = n_stretches(n_samples)
    sums = np.zeros((count, theta.size))
    grams = np.zeros((count, theta.size, theta.size))
    done, power = 0, 0.0
    for part in parts():
        for block in part.blocks():
            P = block[: theta.size]
            residual = block[theta.size + output] - theta @ P
            power += float(residual @ residual)
            end = done + residual.size
            for w in range(done * count // n_samples, (end - 1) * count // n_samples + 1):
                # stretch w holds the samples i with i * count // n_samples == w
                first, last = (-(-edge * n_samples // count) for edge in (w, w + 1))
                inside = P[:, max(first - done, 0) : last - done]
                sums[w] += inside @ residual[max(first - done, 0) : last - done]
                grams[w] += inside @ inside.T
            done = end
    return OneStepScores(grams, sums, float(np.sqrt(power / max(n_samples - theta.size, 1))))


def parameter_uncertainty(
    gram: np.ndarray,
    scores: np.ndarray,
    constraints: LinearConstraints | None = None,
    *,
    grams: np.ndarray | None = None,
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
    grams : ndarray of shape (n_stretches, n_terms, n_terms), default=None
        J'J of each stretch. If given, leverage is corrected for, and each parameter has degrees of freedom
        of its own.

    Returns
    -------
    ParameterUncertainty

    Notes
    -----
    With G the Gram matrix and M_w = G^(-1/2) G_w G^(-1/2) the share of stretch w in it, its scores are
    multiplied by (I - M_w)^(-1/2). That makes the covariance unbiased under white residuals. The degrees of
    freedom are those of the chi-squared distribution with the same mean and variance, under white residuals.

    References
    ----------
    R. M. Bell, D. F. McCaffrey (2002), "Bias reduction in standard errors for linear regression with
    multi-stage samples", Survey Methodology 28(2).

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification.one_step.uncertainty import parameter_uncertainty
    >>> parameter_uncertainty(np.array([[4.0]]), np.array([[2.0], [-2.0]])).standard_errors.tolist()
    [1.0]
    """
    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    Z = np.eye(scale.size)
    if constraints is not None and len(constraints):
        _, Z = constraints.scaled(1.0 / scale).solution_space()
    values, vectors = np.linalg.eigh(Z.T @ (gram / np.outer(scale, scale)) @ Z)
    kept = values > RANK * values.max(initial=0.0)
    # whitened coordinates: the information of the whole record is the identity
    W = Z @ (vectors[:, kept] / np.sqrt(values[kept]))
    count = scores.shape[0]
    whitened = (scores / scale) @ W
    if grams is None:
        centred = whitened - whitened.mean(axis=0)
        root = W @ centred.T * np.sqrt(count / (count - 1))
        degrees: float | np.ndarray = count - 1
    else:
        shares = W.T @ (grams / np.outer(scale, scale)) @ W
        adjust = _inverse_roots(np.eye(W.shape[1]) - shares)
        root = W @ np.einsum("wij,wj->iw", adjust, whitened)
        degrees = _degrees_of_freedom(shares, adjust, W)
    root /= scale[:, None]
    return ParameterUncertainty(root @ root.T, degrees)


def _inverse_roots(matrices: np.ndarray) -> np.ndarray:
    """Return the inverse square roots of a stack of matrices with eigenvalues between 0 and 1."""
    values, vectors = np.linalg.eigh(matrices)
    # a stretch that alone determines a parameter leaves no residual there: nothing to correct
    factors = np.where(values > ALONE, 1.0 / np.sqrt(np.maximum(values, ALONE)), 0.0)
    return (vectors * factors[:, None, :]) @ vectors.transpose(0, 2, 1)


def _degrees_of_freedom(shares: np.ndarray, adjust: np.ndarray, W: np.ndarray) -> np.ndarray:
    """Return Bell and McCaffrey's degrees of freedom of each parameter, shape (n_terms,).

    The variance estimate of a parameter is a quadratic form in white residuals; with its matrix B they are
    trace(B)^2 / trace(B^2). B's elements are those of the stretches less what the fit takes away.
    """
    count = shares.shape[0]
    degrees = np.full(W.shape[0], float(count - 1))
    taken = adjust @ shares
    own = adjust @ shares @ adjust
    for i, direction in enumerate(W):
        loads = taken @ direction
        B = np.diag(own @ direction @ direction) - loads @ loads.T
        square = float((B**2).sum())
        if square > 0.0:
            degrees[i] = np.trace(B) ** 2 / square
    return degrees

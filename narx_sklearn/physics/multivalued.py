"""Functions of an input that depend on its direction: smooth sign, asymmetric multi-valued functions."""

import numpy as np
from numba import njit

from narx_sklearn.model import operators
from narx_sklearn.model.phi import AsymmetricSign
from narx_sklearn.physics._checks import check_signal

__all__ = ["asymmetric_sign", "fit_asymmetric_sign", "smooth_sign"]


@njit(cache=True, nogil=True)
def _asymmetric_run(u, rising, falling, threshold):
    """Return the multi-valued function along u; the sample before the first equals the first."""
    values = np.empty(u.size)
    previous = u[0]
    for k in range(u.size):
        values[k] = operators.asymmetric_sign(u[k] - previous, u[k], rising, falling, threshold)
        previous = u[k]
    return values


def smooth_sign(x, eps: float) -> np.ndarray:
    """Return ``tanh(x / eps)``, a sign without its jump.

    Parameters
    ----------
    x : array-like
        Values, for example differences of an input or velocities.
    eps : float
        Width over which the sign turns, in the unit of `x`, positive: at ``x = eps`` it is 0.76.

    Returns
    -------
    ndarray of the shape of `x`

    Raises
    ------
    ValueError
        If `eps` is not positive.

    Examples
    --------
    >>> from narx_sklearn.physics import smooth_sign
    >>> smooth_sign([-1.0, 0.0, 0.1], eps=0.1).round(4).tolist()
    [-1.0, 0.0, 0.7616]
    """
    if not (np.isfinite(eps) and eps > 0):
        raise ValueError(f"eps must be positive and finite, got {eps!r}.")
    return np.tanh(np.asarray(x, dtype=float) / eps)


def asymmetric_sign(u, *, rising=(1.0,), falling=(-1.0,), threshold: float = 0.0) -> np.ndarray:
    """Evaluate a multi-valued function: one polynomial while the input rises, another while it falls.

    ``phi[k] = rising(u[k])`` where ``u[k] - u[k-1] > threshold``, ``falling(u[k])`` where it is below
    ``-threshold``, else 0. Different branches make asymmetric loops.

    Parameters
    ----------
    u : array-like of shape (n_samples,)
        Input.
    rising : sequence of float, default=(1.0,)
        Coefficients of the powers 0, 1, 2, ... of ``u[k]`` while it rises; the example (2.66) is
        ``rising=(0, 1)``, ``falling=(-1,)``, and the defaults make the plain sign of the difference.
    falling : sequence of float, default=(-1.0,)
        The same while it falls.
    threshold : float, default=0.0
        Change of the input, in its unit, up to which it counts as resting; 0 or more.

    Returns
    -------
    ndarray of shape (n_samples,)
        Values; the first is 0, since the input has not moved yet.

    Raises
    ------
    ValueError
        If a branch has no finite coefficients, or `threshold` is negative.

    See Also
    --------
    fit_asymmetric_sign : Branches from a recorded loop.

    Notes
    -----
    Definition 2.10 compares with one threshold from both sides and with zero between; here the two sides
    lie symmetrically about zero, so that the three cases do not overlap.

    References
    ----------
    Martins and Aguirre (2016); Abreu (2021), eqs. (2.56) and (2.66).

    Examples
    --------
    >>> from narx_sklearn.physics import asymmetric_sign
    >>> asymmetric_sign([0.0, 2.0, 2.0, 1.0], rising=(0, 1), falling=(-1,)).tolist()
    [0.0, 2.0, 0.0, -1.0]
    """
    up, down = _coefficients(rising, "rising"), _coefficients(falling, "falling")
    if not (np.isfinite(threshold) and threshold >= 0):
        raise ValueError(f"threshold must be 0 or more and finite, got {threshold!r}.")
    return _asymmetric_run(check_signal(u), up, down, float(threshold))


def fit_asymmetric_sign(
    u, y, *, degree: int = 3, threshold: float = 0.0, signal: str = "u", name: str | None = None
) -> AsymmetricSign:
    """Build a multi-valued function from a recorded loop: a regression for each direction.

    The output of a slow loading-unloading test is described by a polynomial of the input while it rises and
    by another while it falls. The pair, as a candidate regressor, brings the shape of the loop into a model,
    symmetric or not.

    Parameters
    ----------
    u : array-like of shape (n_samples,)
        Input of the test, slow enough for the output to follow (`quasi_static`).
    y : array-like of shape (n_samples,)
        Output.
    degree : int, default=3
        Degree of both polynomials, 0 or more.
    threshold : float, default=0.0
        Change of the input up to which a sample counts as resting and is left out; 0 or more.
    signal : str, default="u"
        Name of the input in the model.
    name : str or None, default=None
        Name of the regressor in terms.

    Returns
    -------
    AsymmetricSign
        Regressor for a NARX model; ``rising`` and ``falling`` are its coefficients.

    Raises
    ------
    ValueError
        If lengths differ, `degree` is negative, or a direction holds no more than `degree` different inputs.

    References
    ----------
    Abreu (2021), section 2.3.8.2.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.physics import fit_asymmetric_sign
    >>> u = np.concatenate([np.linspace(-1, 1, 50), np.linspace(0.9, -1, 50)])
    >>> y = np.where(np.diff(u, prepend=-2) > 0, u**2, 2 * u - 1 + 0.5 * u**2)
    >>> np.round(fit_asymmetric_sign(u, y, degree=2).falling, 9).tolist()
    [-1.0, 2.0, 0.5]
    """
    u, y = check_signal(u), check_signal(y, "y")
    if u.size != y.size:
        raise ValueError(f"u has {u.size} samples and y has {y.size}; they must be recorded together.")
    if degree < 0:
        raise ValueError(f"degree must be 0 or more, got {degree}.")
    change = np.diff(u, prepend=u[0])
    branches = {}
    for side, inside in (("rising", change > threshold), ("falling", change < -threshold)):
        different = np.unique(u[inside]).size
        if different <= degree:
            raise ValueError(
                f"While {side}, the input takes {different} different values, but a polynomial of degree "
                f"{degree} needs at least {degree + 1}. Record a full loading-unloading cycle."
            )
        fitted = np.polynomial.Polynomial.fit(u[inside], y[inside], degree)
        branches[side] = tuple(fitted.convert().coef.tolist())
    return AsymmetricSign(signal, **branches, name=name)


def _coefficients(branch, name: str) -> np.ndarray:
    coefficients = np.atleast_1d(np.asarray(branch, dtype=float))
    if coefficients.ndim != 1 or coefficients.size == 0 or not np.all(np.isfinite(coefficients)):
        raise ValueError(f"{name} must hold at least one finite coefficient, got {branch!r}.")
    return coefficients

"""A latent force without what the simulator's own parameters could make of it."""

import numpy as np

from narx_sklearn.discrepancy.locate.latent_force import LatentForce
from narx_sklearn.discrepancy.locate.tangent import Tangent

N_ITERATIONS = 60  # of least squares weighted anew, at most
N_ABSOLUTE = 20  # of them by absolute deviations
TUKEY = 4.685  # of the spread: 95 % efficiency were the quiet part Gaussian
SPREAD_OF_MEDIAN = 1.4826  # Gaussian spread over median absolute deviation
SMALLEST = 1e-3  # of the force's size: residuals below it weigh alike
CONVERGED = 1e-6  # of the force's size, that the last iteration changes at most


def concentrated_force(force: LatentForce, linear: Tangent) -> np.ndarray:
    r"""Return a force at a state equation as concentrated as changes of the simulator's parameters let it be.

    A refit spreads a local effect: a stop met now and then stiffens the refitted spring everywhere, and the
    latent force is then the stop less that stiffness. Here

    .. math:: \min_\beta \sum_k \rho\Big(w_k - \sum_j \beta_j\, \partial f_i / \partial p_j\Big)

    gives that back: the bounded loss rho leaves most samples near zero where some parameters can.

    Parameters
    ----------
    force : LatentForce
        At any port; one at an input or output is returned as it is.
    linear : Tangent
        With the responses to parameters, best along the corrected states,
        ``run._replace(x=run.x + force.dx)``.

    Returns
    -------
    ndarray of shape (n_samples,)
        The force that is left; NaN where ``force.w`` is.

    References
    ----------
    .. [1] E. J. Schlossmacher, 1973, an iterative technique for absolute deviations curve fitting.
    .. [2] A. E. Beaton and J. W. Tukey, 1974, the fitting of power series (the bisquare weights).

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy import ODESimulator
    >>> from narx_sklearn.discrepancy.locate import concentrated_force, latent_force, tangent
    >>> from narx_sklearn.discrepancy.placed import Port
    >>> from narx_sklearn.discrepancy.simulators.simulator import Windows
    >>> def spring(x, u, p):
    ...     return x[1], u[0] - 4.0 * x[1] - p[0] * x[0]
    >>> def stop(x, u, p):
    ...     return x[1], u[0] - 4.0 * x[1] - 20.0 * x[0] - 80.0 * max(x[0] - 0.05, 0.0)
    >>> names = {"states": ["position [m]", "velocity [m/s]"], "inputs": ["force [N/kg]"]}
    >>> sim = ODESimulator(spring, dt=0.02, parameters={"stiffness [1/s^2]": 25.0}, **names)
    >>> real = ODESimulator(stop, dt=0.02, parameters={}, **names)
    >>> u = np.repeat(np.random.default_rng(0).normal(size=100), 20)[:, None]
    >>> whole = Windows.whole([slice(0, 2000)])
    >>> run = sim.run(u, whole, np.zeros((1, 2)))
    >>> residual = real.simulate(u) + 1e-4 * np.random.default_rng(1).normal(size=(2000, 1)) - run.y
    >>> force = latent_force(tangent(sim, run, u, whole), residual, whole, Port("state", 1), noise="white")
    >>> corrected = run._replace(x=run.x + force.dx)
    >>> left = concentrated_force(force, tangent(sim, corrected, u, whole))
    >>> bool(np.median(np.abs(left)) < 0.25 * np.median(np.abs(force.w)))
    True
    """
    w = force.w
    if force.port.kind != "state" or linear.P is None or linear.P.shape[2] == 0:
        return w.copy()
    i = force.port.index
    with np.errstate(divide="ignore", invalid="ignore"):
        directions = linear.P[:, i] / linear.G[:, i, i][:, None]
    known = np.isfinite(w) & np.isfinite(directions).all(axis=1)
    columns, target = directions[known], w[known]
    size = np.sqrt(np.mean(columns**2, axis=0)) if target.size else np.zeros(0)
    use = size > 1e-12 * size.max(initial=0.0)
    if target.size < 10 * max(use.sum(), 1) or not use.any():
        return w.copy()
    columns = columns[:, use] / size[use]
    left = _concentrated(columns, target)
    out = np.full(w.shape, np.nan)
    out[known] = left
    return out


def _concentrated(columns: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Return what is left of ``target``: least absolute deviations first, then weights that drop to zero.

    Where the force acts at the ends of the range, absolute deviations still lean towards it; Tukey's weights,
    begun from there with the median as scale, let go of it.
    """
    size = np.sqrt(np.mean(target**2))
    least = max(SMALLEST * size, 1e-300)
    left = target
    for i in range(N_ITERATIONS):
        if i < N_ABSOLUTE:
            weight = 1 / np.maximum(np.abs(left), least)
        else:
            scale = max(TUKEY * SPREAD_OF_MEDIAN * float(np.median(np.abs(left))), least)
            weight = np.maximum(1 - (left / scale) ** 2, 0.0) ** 2
        weighted = columns * weight[:, None]
        beta = np.linalg.lstsq(weighted.T @ columns, weighted.T @ target, rcond=1e-12)[0]
        before, left = left, target - columns @ beta
        if i > N_ABSOLUTE and np.max(np.abs(left - before)) <= CONVERGED * size:
            break
    return left

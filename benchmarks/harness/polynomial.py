"""A plain single-input polynomial NARX model, as a yardstick that belongs to no library.

A term is a sorted tuple of factors `(signal, lag)`, for instance `(("u", 2), ("y", 1))` for
u[k-2]*y[k-1]; the constant is the empty tuple. Everything here is written for clearness, not for speed.
"""

from collections import Counter
from collections.abc import Sequence
from itertools import combinations_with_replacement

import numpy as np
from scipy.optimize import least_squares

Term = tuple[tuple[str, int], ...]

DIVERGENCE_BOUND = 1e9  # far above any signal used here, far below overflow in a cubic term


def make_library(output_lags: Sequence[int], input_lags: Sequence[int], degree: int) -> list[Term]:
    """List all products of at most `degree` lagged variables, the constant first."""
    variables = [("y", lag) for lag in output_lags] + [("u", lag) for lag in input_lags]
    return [
        tuple(sorted(factors))
        for size in range(degree + 1)
        for factors in combinations_with_replacement(variables, size)
    ]


def term_text(term: Term) -> str:
    """Write a term as `u[k-2]*y[k-1]^2`; the constant is `1`."""
    powers = Counter(term)
    factors = []
    for (signal, lag), power in sorted(powers.items()):
        name = f"{signal}[k-{lag}]" if lag else f"{signal}[k]"
        factors.append(f"{name}^{power}" if power > 1 else name)
    return "*".join(factors) or "1"


def longest_lag(terms: Sequence[Term]) -> int:
    """Return the longest lag of the terms (at least 1)."""
    return max((lag for term in terms for _, lag in term), default=1) or 1


def regressor_matrix(terms: Sequence[Term], u: np.ndarray, y: np.ndarray, start: int) -> np.ndarray:
    """Evaluate the terms on measured signals for the samples k = start, ..., N - 1."""
    signals = {"u": u, "y": y}
    n_samples = len(y)
    Psi = np.ones((n_samples - start, len(terms)), order="F")
    for column, term in zip(Psi.T, terms, strict=True):
        for signal, lag in term:
            column *= signals[signal][start - lag : n_samples - lag]
    return Psi


def free_run(terms: Sequence[Term], theta: np.ndarray, u: np.ndarray, y_init: np.ndarray) -> np.ndarray:
    """Simulate one model, or several parameter vectors (the rows of `theta`) at once.

    Returns shape (n_samples,) or (n_samples, n_vectors). Once a run leaves the finite range it stays NaN.
    """
    theta = np.asarray(theta, dtype=float)
    rows = np.atleast_2d(theta).T  # (n_terms, n_vectors)
    degree = max(1, *(len(term) for term in terms))
    lagged = sorted({factor for term in terms for factor in term})
    place = {factor: position + 1 for position, factor in enumerate(lagged)}
    # One row a term, one column a factor; place 0 holds the number one and pads the short terms.
    table = np.array([[place[f] for f in term] + [0] * (degree - len(term)) for term in terms])
    y_rows = [(place[f], f[1]) for f in lagged if f[0] == "y"]
    u_rows = [(place[f], f[1]) for f in lagged if f[0] == "u"]

    y = np.full((len(u), rows.shape[1]), np.nan)
    y[: len(y_init)] = np.asarray(y_init, dtype=float)[:, None]
    z = np.ones((len(lagged) + 1, rows.shape[1]))
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(len(y_init), len(u)):
            for position, lag in y_rows:
                z[position] = y[k - lag]
            for position, lag in u_rows:
                z[position] = u[k - lag]
            y[k] = (z[table].prod(axis=1) * rows).sum(axis=0)
            y[k, ~(np.abs(y[k]) < DIVERGENCE_BOUND)] = np.nan
    return y[:, 0] if theta.ndim == 1 else y


def fit_least_squares(terms: Sequence[Term], u: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the one-step-ahead least-squares parameters and their t values."""
    start = longest_lag(terms)
    Psi = regressor_matrix(terms, u, y, start)
    scale = np.linalg.norm(Psi, axis=0)
    theta, *_ = np.linalg.lstsq(Psi / scale, y[start:], rcond=None)
    residual = y[start:] - Psi @ (theta / scale)
    variance = residual @ residual / max(1, len(residual) - len(terms))
    covariance = variance * np.linalg.pinv((Psi / scale).T @ (Psi / scale))
    spread = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    return theta / scale, np.abs(theta) / spread


def fit_free_run(terms: Sequence[Term], u: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the parameters of least free-run error, started from least squares, and their t values."""
    start = longest_lag(terms)
    theta, _ = fit_least_squares(terms, u, y)
    scale = np.maximum(np.abs(theta), 1e-12)

    def residual(x: np.ndarray) -> np.ndarray:
        run = free_run(terms, x * scale, u, y[:start])[start:]
        return np.nan_to_num(run - y[start:], nan=1e3)

    def jacobian(x: np.ndarray) -> np.ndarray:
        step = 1e-6
        around = np.vstack([x + step * np.eye(len(x)), x - step * np.eye(len(x))]) * scale
        runs = np.nan_to_num(free_run(terms, around, u, y[:start])[start:], nan=1e3)
        return (runs[:, : len(x)] - runs[:, len(x) :]) / (2 * step)

    best = least_squares(residual, theta / scale, jac=jacobian, method="lm")
    variance = 2 * best.cost / max(1, len(best.fun) - len(terms))
    spread = np.sqrt(variance * np.diag(np.linalg.pinv(best.jac.T @ best.jac)))
    return best.x * scale, np.abs(best.x) / np.maximum(spread, np.finfo(float).tiny)


def bic(residual: np.ndarray, n_terms: int, y: np.ndarray) -> float:
    """Return the Bayesian information criterion, with the residual floored at rounding.

    Without the floor a noise-free record would be judged by its rounding errors.
    """
    n_samples = len(residual)
    floor = (1e-11 * np.std(y)) ** 2
    return n_samples * np.log(residual @ residual / n_samples + floor) + n_terms * np.log(n_samples)


class PlainModel:
    """Terms with parameters that can be simulated."""

    def __init__(self, terms: Sequence[Term], theta: np.ndarray):
        self.terms = tuple(term_text(term) for term in terms)
        self._terms, self._theta = terms, theta

    def predict(self, X: np.ndarray, y_init: np.ndarray) -> np.ndarray:
        """Simulate over X; `y_init` are the first outputs."""
        return free_run(self._terms, self._theta, X, y_init)

"""Estimation of Bouc-Wen hysteresis from data."""

from numbers import Integral

import numpy as np
from scipy.optimize import least_squares
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted

from narx_sklearn.physics._checks import (
    SessionScoreMixin,
    check_finite,
    run_pieces,
    settled_samples,
    validate_input,
    validate_record,
)
from narx_sklearn.physics.boucwen import BoucWenModel, _bouc_wen_run, check_substeps

__all__ = ["BoucWen"]

MAX_ITERATIONS = 100  # of the search from one start; a few dozen are usual


class BoucWen(SessionScoreMixin, RegressorMixin, BaseEstimator):
    """Bouc-Wen hysteresis with parameters estimated from data.

    ``y = input_gain u + hysteresis_gain h + offset`` with h from (2.6), chosen to minimise the squared error
    of the free run. Scaled by A, h depends on beta, gamma and n alone, and the output on the rest linearly;
    so only the shape is searched, from several starts within bounds, and the rest is solved for each time.

    Parameters
    ----------
    exponent_bounds : (float, float), default=(1.0, 4.0)
        Least and largest exponent n, 1 or more; equal values fix it.
    fit_intercept : bool, default=True
        Whether to estimate the offset; otherwise it is 0.
    n_settle : int, default=0
        First samples of each recording that move h but do not count in the fit, for records that begin with
        a history nobody knows.
    n_starts : int, default=5
        Starting points of the search, drawn at random within the bounds.
    substeps : int, default=1
        As in `bouc_wen`.
    random_state : int, RandomState instance or None, default=None
        Seed of the starting points.

    Attributes
    ----------
    model_ : BoucWenModel
        The estimated model; A is positive, and ``hysteresis_gain`` is -1 or 1 (0 when h explains nothing).
    rms_errors_ : ndarray of shape (n_starts,)
        Root mean square of the free-run error that each start ended at, in the unit of `y`, increasing.
        Several alike at the front speak for the global minimum.
    converged_ : bool
        Whether the best start met its tolerance before its iterations ran out.
    n_features_in_ : int
        Always 1.
    feature_names_in_ : ndarray of shape (1,)
        Name of the input, when `X` is a DataFrame.

    See Also
    --------
    PrandtlIshlinskii : Hysteresis with minor loops that remember, and an analytic inverse.

    Notes
    -----
    The search holds ``|gamma| <= beta``, for which the element cannot create energy. It runs over
    ``log10(beta U^n)``, between -3 and 2 with U half the range of the input (and A scaled to 1), over
    ``gamma / beta`` and over n. A prediction depends on the order of the samples: `predict` starts from
    ``h = 0`` at the first.

    References
    ----------
    Wen (1976); Abreu (2021), eqs. (2.6) and (5.1); for the separation of linear and nonlinear
    parameters Golub and Pereyra (1973), SIAM J. Numerical Analysis 10, 413-432.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.physics import PIEZO_BENCH, BoucWen
    >>> t = np.arange(2000) / 500
    >>> u = 60 * np.sin(2 * np.pi * t) + 20 * np.sin(2 * np.pi * 0.3 * t)
    >>> model = BoucWen(random_state=0).fit(u.reshape(-1, 1), PIEZO_BENCH.run(u)).model_
    >>> round(model.A, 4), round(model.beta, 4), round(model.gamma, 4), round(model.n, 4)
    (0.9, 0.008, 0.008, 1.0)
    """

    def __init__(
        self,
        *,
        exponent_bounds=(1.0, 4.0),
        fit_intercept=True,
        n_settle=0,
        n_starts=5,
        substeps=1,
        random_state=None,
    ):
        self.exponent_bounds = exponent_bounds
        self.fit_intercept = fit_intercept
        self.n_settle = n_settle
        self.n_starts = n_starts
        self.substeps = substeps
        self.random_state = random_state

    def fit(self, X, y, sessions=None):
        """Estimate all parameters by least squares on the free run.

        Parameters
        ----------
        X : array-like of shape (n_samples, 1)
            Input, in the order it was recorded.
        y : array-like of shape (n_samples,)
            Output.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample; where it changes another recording begins, from rest.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If `X` has several columns or is constant, or an argument is out of range.
        """
        u, y, pieces = validate_record(self, X, y, sessions)
        counted = settled_samples(self.n_settle, pieces)
        problem = _ShapeProblem(u, y, pieces, counted, self.fit_intercept, check_substeps(self.substeps))
        lower, upper = self._bounds()
        starts = check_random_state(self.random_state).uniform(lower, upper, (self._count(), lower.size))
        free = upper > lower
        searches = []
        for start in starts:
            search = least_squares(
                problem.residuals,
                start[free],
                args=(start, free),
                bounds=(lower[free], upper[free]),
                xtol=1e-12,
                ftol=1e-12,
                gtol=1e-12,
                max_nfev=MAX_ITERATIONS,
            )
            searches.append((search.cost, search.status > 0, _filled(start, free, search.x)))
        searches.sort(key=lambda search: search[0])
        _, self.converged_, shape = searches[0]
        self.rms_errors_ = problem.rms(np.array([cost for cost, _, _ in searches]))
        self.model_ = problem.model(shape)
        return self

    def predict(self, X, sessions=None):
        """Return the output along an input, starting from h = 0.

        Parameters
        ----------
        X : array-like of shape (n_samples, 1)
            Input, in order of time.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample; where it changes another recording begins, from rest.

        Returns
        -------
        ndarray of shape (n_samples,)
            Output, which depends on the present and past inputs only.
        """
        check_is_fitted(self)
        u, pieces = validate_input(self, X, sessions)
        return run_pieces(lambda part: self.model_.run(part, substeps=self.substeps), u, pieces)

    def _count(self) -> int:
        if not isinstance(self.n_starts, Integral) or self.n_starts < 1:
            raise ValueError(f"n_starts must be an integer of at least 1, got {self.n_starts!r}.")
        return int(self.n_starts)

    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Return bounds of the shape: log10(beta U^n), gamma / beta, n."""
        least, largest = (check_finite(bound, "exponent_bounds") for bound in self.exponent_bounds)
        if not 1 <= least <= largest:
            raise ValueError(f"exponent_bounds must be 1 or more and not decrease, got {least}, {largest}.")
        return np.array([-3.0, -1.0, least]), np.array([2.0, 1.0, largest])


class _ShapeProblem:
    """The free-run error as a function of the shape alone, on recordings scaled to order 1."""

    def __init__(self, u, y, pieces, counted, fit_intercept, substeps):
        self.half_range = 0.5 * np.ptp(u)
        if self.half_range == 0:
            raise ValueError("X is constant and shows no hysteresis; pass an input that moves.")
        self.level = y[counted].mean() if fit_intercept else 0.0
        self.scale = np.abs(y[counted] - self.level).max() or 1.0
        self.u, self.y = u / self.half_range, (y[counted] - self.level) / self.scale
        self.pieces, self.counted = pieces, counted
        self.fit_intercept, self.substeps = fit_intercept, substeps

    def solve(self, shape):
        """Return the linear coefficients (input, minus hysteresis, constant) and the error they leave."""
        beta = 10.0 ** shape[0]

        def hysteresis(u):
            h, stopped_at = _bouc_wen_run(u, 1.0, beta, shape[1] * beta, shape[2], 0.0, self.substeps)
            h[stopped_at:] = 0.0  # a shape that the samples cannot resolve explains nothing from there on
            return h

        h = run_pieces(hysteresis, self.u, self.pieces)
        columns = [self.u, -h] + ([np.ones_like(h)] if self.fit_intercept else [])
        design = np.column_stack(columns)[self.counted]
        coefficients = np.linalg.lstsq(design, self.y, rcond=None)[0]
        return coefficients, self.y - design @ coefficients

    def residuals(self, values, start, free):
        """Return the error of the best output equation, with ``values`` in the free places of the shape."""
        return self.solve(_filled(start, free, values))[1]

    def rms(self, costs):
        """Return the root mean square, in the unit of y, that belongs to costs of the search."""
        return self.scale * np.sqrt(2.0 * costs / self.y.size)

    def model(self, shape) -> BoucWenModel:
        """Return the model of a shape, back in the units of the record."""
        coefficients, _ = self.solve(shape)
        n = float(shape[2])
        gains = self.scale / self.half_range * coefficients[:2]
        A = abs(float(gains[1])) or 1.0
        beta = 10.0 ** shape[0] / self.half_range**n * A ** (1.0 - n)  # undoes h / A and u / U in (2.6)
        return BoucWenModel(
            A=A,
            beta=float(beta),
            gamma=float(shape[1] * beta),
            n=n,
            input_gain=float(gains[0]),
            hysteresis_gain=-float(np.sign(gains[1])),
            offset=float(self.level + self.scale * coefficients[2]) if self.fit_intercept else 0.0,
        )


def _filled(shape: np.ndarray, free: np.ndarray, values: np.ndarray) -> np.ndarray:
    shape = shape.copy()
    shape[free] = values
    return shape

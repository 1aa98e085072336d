"""Prandtl-Ishlinskii operator, its analytic inverse, and its estimation from data."""

from dataclasses import dataclass
from numbers import Integral

import numpy as np
from numba import njit
from scipy.optimize import nnls
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted

from narx_sklearn.model.operators import play_step
from narx_sklearn.physics._checks import (
    SessionScoreMixin,
    check_finite,
    check_signal,
    run_pieces,
    settled_samples,
    validate_input,
    validate_record,
)
from narx_sklearn.physics.play_operator import check_radii, play

__all__ = ["PrandtlIshlinskii", "PrandtlIshlinskiiOperator"]

STATE_SLACK = 1e-9  # rounding allowed in the consistency of a state, relative to radii and states


@njit(cache=True, nogil=True)
def _weighted_plays_run(u, radii, weights, state):
    """Return the weighted sum of plays along u, and the state after it; one pass, no matrix of plays."""
    state = state.copy()
    v = np.empty(u.size)
    for k in range(u.size):
        total = 0.0
        for j in range(radii.size):
            state[j] = play_step(state[j], u[k], radii[j])
            total += weights[j] * state[j]
        v[k] = total
    return v, state


@dataclass(frozen=True)
class PrandtlIshlinskiiOperator:
    """Weighted sum of play operators.

    ``v[k] = output_offset + sum_j weights[j] P_j(u[k] - input_offset)``, with P_j the play of radius
    ``radii[j]``. Its minor loops close and are congruent, and it has an inverse of its own kind.

    Parameters
    ----------
    radii : sequence of float of shape (n_plays,)
        ``0 = r_1 < r_2 < ...``, in the unit of the input.
    weights : sequence of float of shape (n_plays,)
        Weights, in units of the output per unit of the input. The reference wants them positive; the sums
        ``weights[0] + ... + weights[j]``, the slopes of the initial loading curve, need only be positive
        for an inverse to exist, and the inverse itself has negative weights.
    initial_state : sequence of float of shape (n_plays,) or None, default=None
        Outputs of the plays before the first sample, relative to `input_offset`; None means no history.
    input_offset, output_offset : float, default=0.0
        Operating point about which input and output count.

    Raises
    ------
    ValueError
        If lengths differ, radii do not increase from 0, a number is not finite, or neighbouring states
        differ by more than their radii, which no input can bring about.

    References
    ----------
    Kuhnen (2003), European Journal of Control 9, 407-418; Abreu (2021), eqs. (2.8)-(2.10).

    Examples
    --------
    >>> from narx_sklearn.physics import PrandtlIshlinskiiOperator
    >>> operator = PrandtlIshlinskiiOperator(radii=(0, 0.8, 1.7), weights=(5.88, 1.58, 0.47))
    >>> v = operator.run([0, 3, 0, -3, 1])
    >>> v.round(3).tolist()
    [0.0, 21.727, 1.875, -21.727, 5.867]
    >>> operator.inverse().run(v).round(12).tolist()
    [0.0, 3.0, 0.0, -3.0, 1.0]
    """

    radii: tuple[float, ...]
    weights: tuple[float, ...]
    initial_state: tuple[float, ...] | None = None
    input_offset: float = 0.0
    output_offset: float = 0.0

    def __post_init__(self):
        radii = check_radii(self.radii)
        weights = np.atleast_1d(np.asarray(self.weights, dtype=float))
        state = np.zeros(radii.size) if self.initial_state is None else np.asarray(self.initial_state, float)
        if radii[0] != 0 or np.any(np.diff(radii) <= 0):
            raise ValueError(f"radii must increase from 0, got {radii.tolist()}.")
        for name, values in (("weights", weights), ("initial_state", state)):
            if values.shape != radii.shape or not np.all(np.isfinite(values)):
                raise ValueError(
                    f"{name} must be {radii.size} finite numbers, one for each radius, got {values.tolist()}."
                )
        slack = STATE_SLACK * (radii[-1] + np.abs(state).max())
        if np.any(np.abs(np.diff(state)) > np.diff(radii) + slack):
            raise ValueError(
                f"initial_state {state.tolist()} cannot be reached by any input: neighbours may differ by no "
                f"more than their radii {radii.tolist()}. Take the state that `run_with_state` returns."
            )
        for name, values in (("radii", radii), ("weights", weights), ("initial_state", state)):
            object.__setattr__(self, name, tuple(values.tolist()))
        for name in ("input_offset", "output_offset"):
            object.__setattr__(self, name, check_finite(getattr(self, name), name))

    def run(self, u) -> np.ndarray:
        """Return the output along a signal, from the initial state on.

        Parameters
        ----------
        u : array-like of shape (n_samples,)
            Input.

        Returns
        -------
        ndarray of shape (n_samples,)
            Output, which depends on the present input.
        """
        return self.run_with_state(u)[0]

    def run_with_state(self, u) -> tuple[np.ndarray, tuple[float, ...]]:
        """Return the output along a signal, and the state after it.

        Parameters
        ----------
        u : array-like of shape (n_samples,)
            Input.

        Returns
        -------
        v : ndarray of shape (n_samples,)
            Output.
        state : tuple of float of shape (n_plays,)
            State to go on from: ``dataclasses.replace(operator, initial_state=state)``.
        """
        v, state = _weighted_plays_run(
            check_signal(u) - self.input_offset,
            np.array(self.radii),
            np.array(self.weights),
            np.array(self.initial_state),
        )
        return v + self.output_offset, tuple(state.tolist())

    def initial_loading_curve(self, x) -> np.ndarray:
        """Return the output when the input first moves from rest by x, without offsets.

        ``phi(x) = sum_j weights[j] max(|x| - radii[j], 0) sign(x)``, a broken line with a corner at each
        radius. Every later branch is the same line at twice the scale.

        Parameters
        ----------
        x : array-like
            Change of the input from rest, in its unit.

        Returns
        -------
        ndarray of the shape of `x`
        """
        x = np.asarray(x, dtype=float)
        beyond = np.maximum(np.abs(x)[..., None] - np.array(self.radii), 0.0)
        return np.sign(x) * (beyond @ np.array(self.weights))

    def inverse(self) -> "PrandtlIshlinskiiOperator":
        """Return the operator that undoes this one, state included.

        With the slopes ``s_j = weights[0] + ... + weights[j]`` of the initial loading curve, the inverse has
        weights ``1 / s_0`` and ``1 / s_j - 1 / s_(j-1)``, and its radii are the values of that curve at the
        radii: the mirror image of the broken line.

        Returns
        -------
        PrandtlIshlinskiiOperator

        Raises
        ------
        ValueError
            If a slope of the initial loading curve is not positive: then several inputs give one output.

        References
        ----------
        Kuhnen (2003), European Journal of Control 9, 407-418.
        """
        radii, weights, state = map(np.array, (self.radii, self.weights, self.initial_state))
        slopes = np.cumsum(weights)
        if np.any(slopes <= 0):
            j = int(np.argmax(slopes <= 0))
            raise ValueError(
                f"The operator has no inverse: the slope of its initial loading curve beyond the radius "
                f"{radii[j]:g} is {slopes[j]:g}, and must be positive. Give the play of radius 0 a larger "
                "weight (`min_slope` of PrandtlIshlinskii does so in a fit)."
            )
        # To play j of the inverse, wider plays count with their own state, narrower ones with that of play j.
        held = np.maximum.outer(np.arange(radii.size), np.arange(radii.size))
        return PrandtlIshlinskiiOperator(
            radii=tuple(self.initial_loading_curve(radii).tolist()),
            weights=tuple(np.diff(1.0 / slopes, prepend=0.0).tolist()),
            initial_state=tuple((state[held] @ weights).tolist()),
            input_offset=self.output_offset,
            output_offset=self.input_offset,
        )


class PrandtlIshlinskii(SessionScoreMixin, RegressorMixin, BaseEstimator):
    """Prandtl-Ishlinskii hysteresis with weights estimated from data.

    ``y[k] = c + sum_j weights[j] P_j(u[k] - rest_input)``, weights not negative. The plays are known once
    their radii are chosen, so the fit is a convex problem with one solution; what it finds has an analytic
    inverse, which makes a compensator.

    Parameters
    ----------
    radii : int or array-like of shape (n_plays,), default=10
        Radii of the plays, increasing from 0, in the unit of the input. A number takes that many, equally
        spaced from 0 to half the range of the input (excluded).
    rest_input : float, default=0.0
        Input at which the system rested without history before the record, in the unit of the input.
    fit_intercept : bool, default=True
        Whether to estimate the constant c; otherwise it is such that no input gives no output.
    min_slope : float, default=0.0
        Least weight of the play of radius 0, in units of output per unit of input. A positive value
        guarantees an inverse.
    n_settle : int, default=0
        First samples of each recording that move the plays but do not count in the fit, for records that
        begin with a history nobody knows. One pass over the input's range forgets it.

    Attributes
    ----------
    operator_ : PrandtlIshlinskiiOperator
        The estimated operator, with its initial state at rest.
    radii_ : ndarray of shape (n_plays,)
        Radii.
    coef_ : ndarray of shape (n_plays,)
        Weights.
    intercept_ : float
        The constant c.
    n_features_in_ : int
        Always 1.
    feature_names_in_ : ndarray of shape (1,)
        Name of the input, when `X` is a DataFrame.

    See Also
    --------
    BoucWen : Smooth hysteresis with local memory.

    Notes
    -----
    A prediction depends on the order of the samples: `predict` starts from rest and runs through `X`.

    References
    ----------
    Kuhnen (2003), European Journal of Control 9, 407-418; Abreu (2021), eqs. (2.8)-(2.10).

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.physics import PrandtlIshlinskii, PrandtlIshlinskiiOperator
    >>> u = 3 * np.sin(np.arange(500) / 20)
    >>> y = PrandtlIshlinskiiOperator((0, 0.8, 1.7), (5.88, 1.58, 0.47)).run(u)
    >>> PrandtlIshlinskii(radii=[0, 0.8, 1.7]).fit(u.reshape(-1, 1), y).coef_.round(6).tolist()
    [5.88, 1.58, 0.47]
    """

    def __init__(self, radii=10, *, rest_input=0.0, fit_intercept=True, min_slope=0.0, n_settle=0):
        self.radii = radii
        self.rest_input = rest_input
        self.fit_intercept = fit_intercept
        self.min_slope = min_slope
        self.n_settle = n_settle

    def fit(self, X, y, sessions=None):
        """Estimate the weights by least squares under their sign.

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
        min_slope = check_finite(self.min_slope, "min_slope")
        if min_slope < 0:
            raise ValueError(f"min_slope must be 0 or more, got {min_slope:g}.")
        rest_input = check_finite(self.rest_input, "rest_input")
        radii = self._radii(u)
        plays = run_pieces(lambda part: play(part - rest_input, radii), u, pieces)[counted]
        target = y[counted] - min_slope * plays[:, 0]
        centre, level = (plays.mean(axis=0), target.mean()) if self.fit_intercept else (0.0, 0.0)
        # A free constant is projected out by centring; what is left has the same weights.
        weights, _ = nnls(plays - centre, target - level)
        intercept = float(level - np.dot(centre, weights)) if self.fit_intercept else 0.0
        weights[0] += min_slope
        self.operator_ = PrandtlIshlinskiiOperator(
            tuple(radii.tolist()), tuple(weights.tolist()), input_offset=rest_input, output_offset=intercept
        )
        self.radii_, self.coef_, self.intercept_ = radii, weights, intercept
        return self

    def predict(self, X, sessions=None):
        """Return the output along an input, starting from rest.

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
        return run_pieces(self.operator_.run, u, pieces)

    def inverse(self) -> PrandtlIshlinskiiOperator:
        """Return the analytic inverse of the estimated operator.

        Returns
        -------
        PrandtlIshlinskiiOperator
            Takes wanted outputs, gives the inputs that bring them about.

        Raises
        ------
        ValueError
            If the weight of the play of radius 0 was estimated as 0; fit with a positive `min_slope`.
        """
        check_is_fitted(self)
        return self.operator_.inverse()

    def _radii(self, u: np.ndarray) -> np.ndarray:
        if not isinstance(self.radii, Integral):
            return check_radii(self.radii)
        if self.radii < 1:
            raise ValueError(f"radii={self.radii} asks for no play; pass at least 1.")
        half_range = 0.5 * np.ptp(u)
        if half_range == 0:
            raise ValueError("X is constant, so no radii can be derived from it; pass an input that moves.")
        return np.arange(int(self.radii)) * (half_range / int(self.radii))

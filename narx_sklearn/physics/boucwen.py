"""Bouc-Wen hysteresis: integration along a sampled input, and the piezo bench."""

import warnings
from dataclasses import dataclass, fields
from numbers import Integral

import numpy as np
from numba import njit

from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.model.operators import sign
from narx_sklearn.physics._checks import check_finite, check_signal

__all__ = ["PIEZO_BENCH", "BoucWenModel", "bouc_wen"]

LONGEST_STEP = 0.25  # change of u times d(dh/du)/dh in one step: stable to 2.78, to 1e-5 of h at this length
SHORTEST_SHARE = 1e-5  # of the change between two samples; what needs less is not resolved by the data either
ROUNDING = 2.0**-50  # of A: where dh/du is less, h lies at its bound to the last digits and stays there


@njit(cache=True, nogil=True)
def _bouc_wen_slope(h, direction, A, beta, gamma, n):
    """Return dh/du of (2.6) while u moves in ``direction``, which has the rates cancelled."""
    size = abs(h) if n == 1.0 else abs(h) ** n
    return A - (beta * direction * sign(h) + gamma) * size


@njit(cache=True, nogil=True)
def _is_too_long(h, step, A, beta, gamma, n):
    """Return whether dh/du may change too fast with h to integrate over ``step`` at once."""
    # on its way from zero h keeps its sign, and beta and gamma act as their sum
    coefficient = abs(beta + gamma) if A >= 0.0 and h * step >= 0.0 else beta + abs(gamma)
    step = abs(step)
    rate = n * coefficient
    if n > 1.0:  # while beta >= |gamma|, |h| grows by |A step| at most
        rate *= (abs(h) + abs(A) * step) ** (n - 1.0)
    return rate * step > LONGEST_STEP


@njit(cache=True, nogil=True)
def _bouc_wen_step(h, direction, step, A, beta, gamma, n):
    """Return h after u has moved by ``step``, by Runge-Kutta of order 4."""
    k1 = _bouc_wen_slope(h, direction, A, beta, gamma, n)
    k2 = _bouc_wen_slope(h + 0.5 * step * k1, direction, A, beta, gamma, n)
    k3 = _bouc_wen_slope(h + 0.5 * step * k2, direction, A, beta, gamma, n)
    k4 = _bouc_wen_slope(h + step * k3, direction, A, beta, gamma, n)
    return h + step * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0


@njit(cache=True, nogil=True)
def _bouc_wen_move(h, change, A, beta, gamma, n, substeps):
    """Return h after the input has changed by ``change``."""
    if change == 0.0:
        return h
    direction = sign(change)
    remaining, share = 1.0, 1.0  # of the change: still to go, of one step
    while remaining > 0.0:
        # at its bound h stays for the rest of the change, however far that goes
        slope = _bouc_wen_slope(h, direction, A, beta, gamma, n)
        if A > 0.0 and direction * h > 0.0 and abs(slope) <= ROUNDING * A:
            break
        share = min(2.0 * share, 1.0 / substeps, remaining)
        while share > SHORTEST_SHARE and _is_too_long(h, share * change, A, beta, gamma, n):
            share *= 0.5
        h = _bouc_wen_step(h, direction, share * change, A, beta, gamma, n)
        remaining -= share
    return h


@njit(cache=True, nogil=True)
def _bouc_wen_run(u, A, beta, gamma, n, h_start, substeps):
    """Return h along u, and the sample at which it was not finite (u.size when none)."""
    h = np.full(u.size, np.nan)
    h[0] = h_start
    now = h_start
    for k in range(1, u.size):
        now = _bouc_wen_move(now, u[k] - u[k - 1], A, beta, gamma, n, substeps)
        if not np.isfinite(now):
            return h, k
        h[k] = now
    return h, u.size


def check_parameters(**parameters) -> None:
    """Raise unless all parameters are finite, beta is not negative and n is at least 1."""
    values = {name: check_finite(value, name) for name, value in parameters.items()}
    if values["beta"] < 0:
        raise ValueError(f"beta must be 0 or more, got {values['beta']:g}.")
    if values["n"] < 1:
        raise ValueError(
            f"n must be 1 or more, got {values['n']:g}; the loop has no tangent at h = 0 below 1."
        )


def check_substeps(substeps) -> int:
    """Return ``substeps`` as an int of at least 1, or raise."""
    if not isinstance(substeps, Integral) or substeps < 1:
        raise ValueError(f"substeps must be an integer of at least 1, got {substeps!r}.")
    return int(substeps)


def bouc_wen(
    u,
    *,
    A: float,
    beta: float,
    gamma: float,
    n: float = 1.0,
    initial_state: float = 0.0,
    substeps: int = 1,
) -> np.ndarray:
    """Integrate the Bouc-Wen equation along a sampled input.

    ``dh/dt = A du/dt - beta |du/dt| |h|^(n-1) h - gamma du/dt |h|^n``: smooth hysteresis with a single
    state. Slow or fast, the same path of the input gives the same path of h.

    Parameters
    ----------
    u : array-like of shape (n_samples,)
        Input.
    A : float
        Slope of the loop where h is 0, in units of h per unit of `u`.
    beta, gamma : float
        Shape of the loop, in units of ``h^(1-n)`` per unit of `u`; `beta` is 0 or more. h stays within
        ``(A / (beta + gamma))^(1/n)`` when ``-beta < gamma <= beta``.
    n : float, default=1.0
        Exponent, 1 or more: the larger, the sharper the loop bends.
    initial_state : float, default=0.0
        h at the first sample.
    substeps : int, default=1
        Least number of integration steps between two samples. More are taken where the equation is stiff.

    Returns
    -------
    ndarray of shape (n_samples,)
        h at each sample, which depends on the present input; NaN from the sample on at which it was no
        longer finite, if any.

    Raises
    ------
    ValueError
        If a parameter is not finite, `beta` is negative, `n` is less than 1, or `substeps` less than 1.

    Warns
    -----
    DivergenceWarning
        If h leaves the finite range, which takes ``|gamma| > beta`` or a sampling much too coarse.

    Notes
    -----
    The input is taken as piecewise linear between samples, so that ``du/dt`` is
    ``(u[k] - u[k-1]) / T_s`` there. Every term has this factor, so the sampling period ``T_s`` cancels and
    the integration goes along u. A turning point between two samples is missed.

    References
    ----------
    Wen (1976), Journal of the Engineering Mechanics Division 102, 249-263; Abreu (2021), eq. (2.6).

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.physics import bouc_wen
    >>> h = bouc_wen(np.linspace(0, 1, 100), A=1, beta=1, gamma=2)
    >>> round(float(h[-1]), 6)  # (1 - exp(-3)) / 3
    0.316738
    """
    u = check_signal(u)
    check_parameters(A=A, beta=beta, gamma=gamma, n=n, initial_state=initial_state)
    substeps = check_substeps(substeps)
    h, stopped_at = _bouc_wen_run(
        u, float(A), float(beta), float(gamma), float(n), float(initial_state), substeps
    )
    if stopped_at < u.size:
        warnings.warn(
            f"h left the finite range at sample {stopped_at} of {u.size}. With |gamma| > beta the equation "
            "can grow without bound; otherwise sample the input finer or raise substeps.",
            DivergenceWarning,
            stacklevel=2,
        )
    return h


@dataclass(frozen=True)
class BoucWenModel:
    """Bouc-Wen hysteresis with its output equation, ``y = input_gain u + hysteresis_gain h + offset``.

    Parameters
    ----------
    A, beta, gamma, n : float
        As in `bouc_wen`.
    input_gain : float, default=0.0
        Direct effect of the input, in units of the output per unit of the input.
    hysteresis_gain : float, default=1.0
        Effect of h, in units of the output per unit of h; -1 in the piezo bench.
    offset : float, default=0.0
        Constant, in the unit of the output.

    Raises
    ------
    ValueError
        If a parameter is not finite, `beta` is negative, or `n` is less than 1.

    References
    ----------
    Abreu (2021), eqs. (2.6) and (5.1).

    Examples
    --------
    >>> from narx_sklearn.physics import PIEZO_BENCH
    >>> PIEZO_BENCH.run([0.0, 40.0, 80.0, 40.0]).round(2).tolist()
    [0.0, 37.41, 87.39, 59.39]
    """

    A: float
    beta: float
    gamma: float
    n: float = 1.0
    input_gain: float = 0.0
    hysteresis_gain: float = 1.0
    offset: float = 0.0

    def __post_init__(self):
        check_parameters(**{field.name: getattr(self, field.name) for field in fields(self)})

    def run(self, u, *, initial_state: float = 0.0, substeps: int = 1) -> np.ndarray:
        """Return the output along a signal.

        Parameters
        ----------
        u : array-like of shape (n_samples,)
            Input.
        initial_state : float, default=0.0
            h at the first sample.
        substeps : int, default=1
            As in `bouc_wen`.

        Returns
        -------
        ndarray of shape (n_samples,)
            Output, which depends on the present input.
        """
        u = check_signal(u)
        h = bouc_wen(
            u,
            A=self.A,
            beta=self.beta,
            gamma=self.gamma,
            n=self.n,
            initial_state=initial_state,
            substeps=substeps,
        )
        return self.input_gain * u + self.hysteresis_gain * h + self.offset


#: Piezoelectric actuator of Rakotondrabe (2011), thesis eq. (5.1): -80 V to 80 V in, micrometres out.
PIEZO_BENCH = BoucWenModel(A=0.9, beta=0.008, gamma=0.008, n=1.0, input_gain=1.6, hysteresis_gain=-1.0)

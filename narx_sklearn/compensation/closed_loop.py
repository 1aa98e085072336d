"""Feedback round compensator and plant: discrete PI and PID with anti-windup, simulation, tuning."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.optimize import minimize

from narx_sklearn._validation import as_signals, check_choice
from narx_sklearn.compensation.tracking import SteppedPlant
from narx_sklearn.metrics import mape, nsavi, rmse

__all__ = ["PID", "ClosedLoopRun", "PIDState", "simulate_loop", "tune_pid"]

UNBOUNDED = 1e6  # output, in sizes of the reference, at which a loop counts as lost


@dataclass(frozen=True)
class PID:
    r"""A PID controller in discrete time with a filtered derivative and anti-windup.

    .. math::
        v_k = K_p e_k + I_k + D_k, \quad I_k = I_{k-1} + K_i T_s e_k, \quad
        D_k = a D_{k-1} + (1 - a) K_d (e_k - e_{k-1}) / T_s

    The correction is limited; while it is cut, the integral is set back so that it would just reach the limit
    (back-calculation), so that it does not wind up.

    Parameters
    ----------
    kp : float, default=0.0
        Proportional gain, in units of the correction per unit of the error.
    ki : float, default=0.0
        Integral gain, per second; 0 for none.
    kd : float, default=0.0
        Derivative gain, in seconds; 0 gives a PI controller.
    sampling_period : float, default=1.0
        T_s in seconds.
    derivative_filter : float, default=0.0
        a, from 0 (none) to below 1.
    limits : (float, float), default=(-inf, inf)
        Range of the correction.

    Raises
    ------
    ValueError
        If a number is out of range.

    References
    ----------
    Astrom and Hagglund (2006), Advanced PID Control, sections 3.5 and 13.4.

    Examples
    --------
    >>> from narx_sklearn.compensation import PID
    >>> state = PID(kp=1.0, ki=1.0, limits=(-2.0, 2.0)).start()
    >>> [state.step(1.0) for _ in range(4)]
    [2.0, 2.0, 2.0, 2.0]
    >>> state.step(-1.0)  # without anti-windup the integral would be 4
    -1.0
    """

    kp: float = 0.0
    ki: float = 0.0
    kd: float = 0.0
    sampling_period: float = 1.0
    derivative_filter: float = 0.0
    limits: tuple[float, float] = (-np.inf, np.inf)

    def __post_init__(self):
        for name in ("kp", "ki", "kd"):
            if not np.isfinite(getattr(self, name)):
                raise ValueError(f"{name} must be finite, got {getattr(self, name)!r}.")
        if not 0.0 < self.sampling_period < np.inf:
            raise ValueError(f"sampling_period must be positive, got {self.sampling_period!r}.")
        if not 0.0 <= self.derivative_filter < 1.0:
            raise ValueError(f"derivative_filter must lie in [0, 1), got {self.derivative_filter!r}.")
        if not self.limits[0] < self.limits[1]:
            raise ValueError(f"limits must be a pair (low, high) with low < high, got {self.limits!r}.")

    def start(self) -> "PIDState":
        """Return the state at rest."""
        return PIDState(self)


class PIDState:
    """A PID controller between samples.

    Parameters
    ----------
    controller : PID
        Its gains.
    """

    def __init__(self, controller: PID):
        self.controller = controller
        self.integral = 0.0
        self.derivative = 0.0
        self.error: float | None = None

    def step(self, error: float) -> float:
        """Take the newest error, return the correction."""
        c = self.controller
        change = 0.0 if self.error is None else error - self.error
        a = c.derivative_filter
        self.derivative = a * self.derivative + (1.0 - a) * c.kd * change / c.sampling_period
        self.error = error
        self.integral += c.ki * c.sampling_period * error
        wanted = c.kp * error + self.integral + self.derivative
        limited = min(max(wanted, c.limits[0]), c.limits[1])
        if c.ki and limited != wanted:
            self.integral += limited - wanted
        return limited


@dataclass(frozen=True)
class ClosedLoopRun:
    """Signals of a simulated loop.

    Attributes
    ----------
    reference : ndarray of shape (n_samples,)
        Wanted output.
    y : ndarray of shape (n_samples,)
        Output of the plant with its disturbance, without measurement noise.
    measured : ndarray of shape (n_samples,)
        What the controller sees.
    correction : ndarray of shape (n_samples,)
        Output of the controller, in the unit of the reference with a compensator, else of the input.
    m : ndarray of shape (n_samples,)
        Input of the plant.
    """

    reference: np.ndarray
    y: np.ndarray
    measured: np.ndarray
    correction: np.ndarray
    m: np.ndarray

    @property
    def mape(self) -> float:
        """Tracking error in percent of the reference's range (5.10)."""
        return mape(self.reference, np.nan_to_num(self.y, nan=np.inf))

    @property
    def nsavi(self) -> float:
        """Effort relative to the reference (5.15)."""
        return nsavi(self.reference, self.m)

    def to_frame(self) -> pd.DataFrame:
        """Return the signals as columns."""
        names = ("reference", "y", "measured", "correction", "m")
        return pd.DataFrame({name: getattr(self, name) for name in names})


def simulate_loop(
    plant,
    reference,
    *,
    controller: PID | None = None,
    compensator=None,
    noise: float = 0.0,
    disturbance=None,
    random_state=None,
) -> ClosedLoopRun:
    """Simulate feedback round a compensator and a plant, sample by sample.

    At sample k the controller sees the measurement of sample k-1 and corrects the reference; the compensator
    turns the corrected reference into the plant's input. Without a compensator the input is the corrected
    reference itself; without a controller the loop is open.

    Parameters
    ----------
    plant : callable, NARXModel, BoucWenModel, or object with ``step``
        ``step(u)`` or the function itself is called once a sample and returns the output at that sample.
    reference : array-like of shape (n_samples,)
        Wanted output.
    controller : PID or None, default=None
        Feedback controller.
    compensator : fitted compensator or None, default=None
        Turns references into inputs; its own state is not touched.
    noise : float, default=0.0
        Standard deviation of the measurement noise, in the unit of the output.
    disturbance : array-like of shape (n_samples,) or None, default=None
        Added to the output: drift, creep, load. Unit of the output.
    random_state : int, Generator or None, default=None
        Seed of the noise.

    Returns
    -------
    ClosedLoopRun

    Raises
    ------
    ValueError
        If lengths differ, the reference or the disturbance has gaps, or the compensator wants more than a
        reference.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.compensation import PID, simulate_loop
    >>> r = np.ones(50)
    >>> run = simulate_loop(lambda u: 0.5 * u, r, controller=PID(ki=0.4))
    >>> round(float(run.y[-1]), 6)
    0.999991
    """
    r = as_signals(reference, "reference")[:, 0]
    d = np.zeros(r.size) if disturbance is None else as_signals(disturbance, "disturbance")[:, 0]
    if d.size != r.size:
        raise ValueError(f"disturbance has {d.size} samples, the reference {r.size}; they must be as many.")
    for name, side in (("reference", r), ("disturbance", d)):
        if not np.isfinite(side).all():
            k = int(np.flatnonzero(~np.isfinite(side))[0])
            raise ValueError(f"{name} is not finite at sample {k}; a loop needs it at every sample.")
    e = noise * np.random.default_rng(random_state).standard_normal(r.size)
    stepped = SteppedPlant(plant)
    law_state, horizon = None, 0
    if compensator is not None:
        law = compensator.law_
        if law.others:
            raise ValueError(f"The compensator wants {list(law.known)}; a loop gives it a reference only.")
        horizon = law.horizon
        start = compensator._first_input(r[:1])
        law_state, _ = law.begin(r[:, None], start)
    feedback = None if controller is None else controller.start()
    y, measured, correction, m = (np.full(r.size, np.nan) for _ in range(4))
    bound = UNBOUNDED * (1.0 + np.abs(r).max())
    error = 0.0
    for k in range(r.size):
        correction[k] = 0.0 if feedback is None else feedback.step(error)
        wanted = r[min(k + horizon, r.size - 1)] + correction[k]
        m[k] = wanted if law_state is None else law_state.step(wanted)
        y[k] = stepped.step(m[k]) + d[k]
        measured[k] = y[k] + e[k]
        if not abs(y[k]) <= bound:
            y[k:] = np.nan
            break
        error = r[k] - measured[k]
    return ClosedLoopRun(r, y, measured, correction, m)


def tune_pid(
    plant,
    reference,
    *,
    kind: str = "pi",
    compensator=None,
    sampling_period: float = 1.0,
    limits: tuple[float, float] = (-np.inf, np.inf),
    noise: float = 0.0,
    disturbance=None,
    gain_bound: float = 2.0,
    max_runs: int = 60,
    random_state=0,
) -> PID:
    """Tune a PI or PID controller on a simulated loop.

    The gains minimise the root mean square tracking error of the loop with its noise and disturbance; that is
    what keeps them from growing. They are searched as logarithms from a cautious start (Nelder and Mead).

    Parameters
    ----------
    plant : callable, NARXModel, BoucWenModel, or object with ``step`` and ``reset``
        As for `simulate_loop`; must start afresh in every run, so a bare function may not remember.
    reference : array-like of shape (n_samples,)
        Wanted output.
    kind : {"p", "i", "pi", "pid"}, default="pi"
        Which gains are used.
    compensator : fitted compensator or None, default=None
        Inside the loop.
    sampling_period : float, default=1.0
        In seconds.
    limits : (float, float), default=(-inf, inf)
        Range of the correction.
    noise : float, default=0.0
        As for `simulate_loop`.
    disturbance : array-like of shape (n_samples,) or None, default=None
        As for `simulate_loop`.
    gain_bound : float, default=2.0
        Largest ``kp``, ``ki * sampling_period`` and ``kd / sampling_period``, in units of input per unit of
        output.
    max_runs : int, default=60
        Simulations.
    random_state : int, default=0
        Seed of the noise, the same in each run.

    Returns
    -------
    PID
    """
    gains = check_choice(kind, "kind", ("p", "i", "pi", "pid"))
    scales = {"p": 1.0, "i": 1.0 / sampling_period, "d": sampling_period}
    r = as_signals(reference, "reference")[:, 0]

    def controller(logarithms) -> PID:
        sizes = np.minimum(np.exp(logarithms), gain_bound)
        chosen = {f"k{g}": float(size * scales[g]) for g, size in zip(gains, sizes, strict=True)}
        return PID(
            **chosen,
            sampling_period=sampling_period,
            derivative_filter=0.8 if "d" in gains else 0.0,
            limits=limits,
        )

    def loss(logarithms) -> float:
        run = simulate_loop(
            plant, r, controller=controller(logarithms), compensator=compensator, noise=noise,
            disturbance=disturbance, random_state=random_state,
        )  # fmt: skip
        return 1e6 if np.isnan(run.y).any() else rmse(r, run.y)

    start = np.log([{"p": 0.1, "i": 0.05, "d": 0.05}[g] for g in gains])
    simplex = np.vstack([start, start + 1.5 * np.eye(len(gains))])
    found = minimize(
        loss,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "maxfev": max_runs, "xatol": 0.05},
    )
    return controller(found.x)

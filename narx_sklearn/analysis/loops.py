"""The settled hysteresis loop of a model under a loading-unloading input."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from narx_sklearn.analysis._checks import check_driver, check_output, inputs_along
from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.simulation import free_run
from narx_sklearn.signals.loading import loading_unloading

__all__ = ["HysteresisLoop", "hysteresis_loop"]

PERIODS = (4, 8, 16, 32, 64)  # tried in turn until the loop repeats itself
MOST_SAMPLES = 4_000_000  # of a run that is made longer
SETTLED = 1e-4  # largest change from one period to the next, as a share of the output's range


@dataclass(frozen=True, eq=False)
class HysteresisLoop:
    """The last period of a periodic loading-unloading run.

    Attributes
    ----------
    model : NARXModel
        The model.
    driver, output : str
        Names of the input that moves and the output.
    samples_per_branch : int
        Samples from one extremum of the input to the other; the larger, the slower.
    u, y : ndarray of shape (2 * samples_per_branch + 1,)
        Input and output in their units, from the smallest input to the largest and back.
    n_periods : int
        Periods that were run.
    settled : bool
        Whether the last two periods agree.
    """

    model: NARXModel
    driver: str
    output: str
    samples_per_branch: int
    u: np.ndarray
    y: np.ndarray
    n_periods: int
    settled: bool

    @property
    def y_range(self) -> float:
        """Distance from the smallest to the largest output."""
        return float(np.ptp(self.y))

    def branches(self, n_levels: int = 201) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return levels of the input and the output there in loading and unloading.

        Parameters
        ----------
        n_levels : int, default=201
            Number of levels, equally spaced over the input's range.

        Returns
        -------
        levels, loading, unloading : ndarray of shape (n_levels,)
        """
        turn = self.samples_per_branch
        levels = np.linspace(self.u[0], self.u[turn], n_levels)
        loading = np.interp(levels, self.u[: turn + 1], self.y[: turn + 1])
        unloading = np.interp(levels, self.u[turn:][::-1], self.y[turn:][::-1])
        return levels, loading, unloading

    @property
    def opening(self) -> float:
        """Largest distance between the branches at one input, as a share of the output's range."""
        _, loading, unloading = self.branches()
        return float(np.abs(loading - unloading).max() / self.y_range) if self.y_range else 0.0

    @property
    def area(self) -> float:
        """Signed area, input unit times output unit; positive for a counterclockwise loop."""
        return float(np.sum(np.diff(self.y) * (self.u[1:] + self.u[:-1])) / 2.0)

    @property
    def orientation(self) -> str:
        """``"counterclockwise"`` (the output lags, as with backlash) or ``"clockwise"``."""
        return "counterclockwise" if self.area >= 0.0 else "clockwise"

    @property
    def asymmetry(self) -> float:
        """How far the loop is from a copy of itself turned by half a turn, as a share of the output's range.

        The turn is about the middle of the input and the best middle of the output; 0 for a symmetric loop.
        """
        if not self.y_range:
            return 0.0
        _, loading, unloading = self.branches()
        turned = loading + unloading[::-1]  # twice the middle, if the loop is symmetric
        return float(np.ptp(turned) / 2.0 / self.y_range)

    def to_frame(self) -> pd.DataFrame:
        """Return one row a sample: input, output, regime."""
        regime = np.where(np.arange(self.u.size) <= self.samples_per_branch, "loading", "unloading")
        return pd.DataFrame({self.driver: self.u, self.output: self.y, "regime": regime})


def hysteresis_loop(
    model: NARXModel,
    u_min: float,
    u_max: float,
    *,
    samples_per_branch: int = 500,
    shape: str = "triangle",
    driver: str | None = None,
    output: str | None = None,
    at: Mapping[str, float] | None = None,
) -> HysteresisLoop:
    """Simulate a model under a periodic loading-unloading input until its loop repeats itself.

    Parameters
    ----------
    model : NARXModel
        The model.
    u_min, u_max : float
        Extrema of the input, in its unit.
    samples_per_branch : int, default=500
        Samples from one extremum to the other.
    shape : {"triangle", "sine"}, default="triangle"
        Constant rate, or a sine with its slow ends.
    driver : str, default=None
        Input that loads and unloads; None is the only one.
    output : str, default=None
        Output to look at; None is the first.
    at : mapping of {str: float}, default=None
        Constant values of the other inputs, in their units; the operating point where not given.

    Returns
    -------
    HysteresisLoop

    Raises
    ------
    ValueError
        If a name is not known, ``u_min`` is not below ``u_max``, or the free run diverges.

    References
    ----------
    Martins and Aguirre (2016); Lacerda Junior (2021), Definition 2.8.

    Examples
    --------
    >>> from narx_sklearn.analysis import hysteresis_loop
    >>> from narx_sklearn.model import NARXModel, Play
    >>> play = NARXModel.from_equations("phi1[k]", phi=[Play("u", radius=1.0)])
    >>> loop = hysteresis_loop(play, -3.0, 3.0, samples_per_branch=600)
    >>> round(loop.area, 9), loop.orientation, round(loop.opening, 3)
    (8.0, 'counterclockwise', 0.5)
    """
    driver, output = check_driver(model, driver), check_output(model, output)
    if not (np.isfinite(u_min) and np.isfinite(u_max) and u_min < u_max):
        raise ValueError(f"u_min must lie below u_max, got u_min={u_min!r} and u_max={u_max!r}.")
    for n_periods in PERIODS:
        u = loading_unloading((u_min, u_max), samples_per_branch, shape=shape, n_periods=n_periods)
        u = np.append(u, u[0])
        y = run_output(model, driver, output, u, at)
        period = 2 * samples_per_branch
        last, before = y[-period - 1 :], y[-2 * period - 1 : -period]
        settled = bool(np.abs(last - before).max() <= SETTLED * np.ptp(last))
        if settled or 2 * n_periods * period > MOST_SAMPLES:
            break
    return HysteresisLoop(
        model, driver, output, samples_per_branch, u[-period - 1 :], last, n_periods, settled
    )


def run_output(model: NARXModel, driver: str, output: str, u: np.ndarray, at) -> np.ndarray:
    """Return one output of a free run along ``u``; a divergence is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DivergenceWarning)
        run = free_run(model, inputs_along(model, driver, u, at))
    if run.stopped_at is not None:
        raise ValueError(
            f"The free run left the finite range at sample {run.stopped_at} (input {u[run.stopped_at]:.5g}), "
            "so the model has no loop there. Look at quasi_static_sets, and choose the range and rate of the "
            "data it was identified from."
        )
    return run.y[:, model.outputs.index(output)]

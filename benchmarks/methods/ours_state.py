"""The state a free run starts from, estimated; and the fit that needs it.

A model that remembers n samples starts from n outputs. Taking the measured ones puts their noise, and what
the model does not describe, into lightly damped modes that ring for seconds; and a signal that nobody
measured has none. So the state is estimated from the first samples: it should explain them, and be like the
states met in training.
"""

import warnings
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.identification import FreeRunFit, LinearConstraints, refine_free_run
from narx_sklearn.model import NARXModel, free_run

N_STATES = 5000  # states of the training run that the prior is worked out from
FAR_OFF = 1e6  # misfit, in standard deviations, that stands for a diverged run


@dataclass(frozen=True)
class StartingState:
    """A prior of the model's states, and the error that its free run makes.

    `root` maps independent standard normal numbers to deviations from the `mean` state; `sigma` is the
    free run's error in training.
    """

    model: NARXModel
    mean: np.ndarray
    root: np.ndarray
    sigma: float

    @classmethod
    def of(cls, model: NARXModel, simulated: np.ndarray, sigma: float) -> "StartingState":
        """Learn the prior from a simulation of the training record, shape (n_samples, n_outputs)."""
        stacked = sliding_window_view(simulated, max(model.max_lag, 1), axis=0).swapaxes(1, 2)
        states = stacked[:: len(stacked) // N_STATES + 1].reshape(-1, stacked[0].size)
        mean = states.mean(axis=0)
        _, spread, directions = np.linalg.svd(states - mean, full_matrices=False)
        return cls(model, mean, spread[:, None] / np.sqrt(len(states)) * directions, sigma)

    def run(self, u: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return all outputs over the first samples, from the state that explains `y` best (NaN: unknown)."""
        known = np.isfinite(y)

        def simulate(z: np.ndarray) -> np.ndarray:
            state = (self.mean + z @ self.root).reshape(-1, len(self.model.outputs))
            return quiet_run(self.model, u, state)

        def misfit(z: np.ndarray) -> np.ndarray:
            error = (simulate(z)[:, 0] - y) / self.sigma
            error = np.nan_to_num(error, nan=FAR_OFF, posinf=FAR_OFF, neginf=-FAR_OFF)
            return np.r_[z, np.where(known, np.clip(error, -FAR_OFF, FAR_OFF), 0.0)]

        return simulate(least_squares(misfit, np.zeros(len(self.root)), max_nfev=30).x)


def quiet_run(model: NARXModel, u: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Simulate; NaN after a divergence says enough."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DivergenceWarning)
        return free_run(model, u[:, None], y_init=start).y


@dataclass
class OurModel:
    """A model with its starting state, seen from the recorded signals.

    `decimation`: the model steps every so many samples, with the mean input of each step where `mean_input`.
    `advance`: its input is read that many samples ahead, which undoes the delays between its equations.
    `highest`: end of the sensor's range.
    """

    model: NARXModel
    start: StartingState | None = None
    decimation: int = 1
    mean_input: bool = False
    advance: int = 0
    highest: float = np.inf
    search: dict[str, Any] = field(default_factory=dict)

    @property
    def terms(self) -> tuple[str, ...]:
        """Every term of every equation."""
        return tuple(
            f"{output}: {t}" for output in self.model.outputs for t, _ in self.model.equation(output).items
        )

    def inputs(self, X: np.ndarray) -> np.ndarray:
        """Return the input as the model reads it."""
        u = np.r_[X[self.advance :], np.full(self.advance, X[-1])]
        if not self.mean_input:
            return u[:: self.decimation]
        return np.array([u[k : k + self.decimation].mean() for k in range(0, len(u), self.decimation)])

    def predict(self, X: np.ndarray, y_init: np.ndarray) -> np.ndarray:
        """Simulate from the end of the initial outputs."""
        u, y, depth = self.inputs(X), y_init[:: self.decimation], max(self.model.max_lag, 1)
        # the last steps of the head may mix in inputs beyond it, which a simulation is given anyway
        head = y[:, None] if self.start is None else self.start.run(u[: len(y)], y)
        run = quiet_run(self.model, u[len(y) - depth :], head[len(y) - depth :])[:, 0]
        run = np.r_[head[: len(y) - depth, 0], run]
        if self.decimation > 1:
            if not np.isfinite(run).all():
                return np.full(len(X), np.nan)
            run = CubicSpline(np.arange(len(run)) * self.decimation, run)(np.arange(len(X)))
        return np.minimum(run, self.highest)


def fit_free_run(
    model: NARXModel,
    u: np.ndarray,
    y: np.ndarray,
    *,
    constraints: LinearConstraints | None = None,
    horizons: tuple[int | None, ...] = (None,),
    head: int = 50,
    skip: int = 0,
    rounds: int = 2,
    max_iter: int = 60,
    first_state: np.ndarray | None = None,
) -> tuple[FreeRunFit, StartingState]:
    """Fit to the free run, in turn with the states it starts from.

    The first output is the measured one (NaN where it is not), others are not measured at all. The state is
    estimated from the first `head` samples; the first `skip` ones are not judged.
    """
    depth = max(model.max_lag, 1)
    targets = np.full((len(y), len(model.outputs)), np.nan)
    targets[:, 0] = y
    targets[:depth, 1:] = 0.0
    if first_state is not None:
        targets[:depth] = first_state
    targets[depth:skip, 0] = np.nan
    for _ in range(rounds):
        fit = refine_free_run(
            model,
            u[:, None],
            targets,
            constraints=constraints,
            horizons=horizons,
            max_iter=max_iter,
            tol=1e-7,
        )
        if not np.isfinite(fit.loss):
            raise FloatingPointError("the free run diverges")
        model, horizons = fit.model, (None,)
        simulated = quiet_run(model, u, targets[:depth])[skip:]
        sigma = max(np.sqrt(fit.loss / fit.n_samples), 1e-9 * np.nanstd(y))
        start = StartingState.of(model, simulated, sigma)
        targets[:depth] = start.run(u[:head], y[:head])[:depth]
    return fit, start

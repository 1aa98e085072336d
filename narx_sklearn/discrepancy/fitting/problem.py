"""Output error over windows: residuals, sensitivities, and initial states projected out.

All tensors have one axis of windows and one of samples times outputs, padded with zeros:

    residual (W, T),  states' sensitivities (W, T, n_free),  parameters' sensitivities (W, T, n_q)
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from joblib import effective_n_jobs

from narx_sklearn.discrepancy.noise import Noise, remembered
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.simulators.simulator import Run, Simulator, Windows
from narx_sklearn.discrepancy.simulators.structure import Sums

LINE, PARABOLA = (1, 8), (2, 12)  # degree and samples of what a rate is guessed by: at ease, and in a blow
FLAT = 1e-9  # singular values below this share of the largest carry no information on an initial state


class Model(NamedTuple):
    """Parameter values, effects with theirs, and one initial state a window."""

    p: np.ndarray  # (n_parameters,)
    effects: tuple[PlacedEffect, ...]
    x0: np.ndarray  # (n_windows, n_states)

    @property
    def q(self) -> np.ndarray:
        """All global parameters: the simulator's own, then the effects'."""
        return np.concatenate([self.p, *(np.array(e.theta, dtype=float) for e in self.effects)])

    @property
    def theirs(self) -> tuple[slice, ...]:
        """Where each effect's parameters stand among all."""
        ends = np.cumsum([self.p.size, *(e.n_theta for e in self.effects)]).tolist()
        return tuple(slice(first, stop) for first, stop in pairwise(ends))

    @property
    def rising(self) -> np.ndarray:
        """The order of all parameters in which each effect's levels rise, (n_q,)."""
        parts = [own.start + e.rising for e, own in zip(self.effects, self.theirs, strict=True)]
        return np.concatenate([np.arange(self.p.size), *parts])

    def with_q(self, q: np.ndarray) -> "Model":
        """Return the model with other global parameters."""
        effects = tuple(e.at(q[own]) for e, own in zip(self.effects, self.theirs, strict=True))
        return self._replace(p=q[: self.p.size], effects=effects)


@dataclass
class Problem:
    """A simulator, a record and its windows."""

    simulator: Simulator
    u: np.ndarray
    y: np.ndarray
    windows: Windows
    noise: Noise
    rates: tuple[tuple[int, int, float], ...] = ()  # velocity, position, and the factor of its integral
    adds_up: tuple[bool, ...] = ()  # whether an integrator adds up what each output shows; none where empty
    sums: Sums | None = None  # on which effects may act, as the simulator's own parameters have them
    rows: np.ndarray = field(init=False)  # (W, L) sample of each place, 0 where padded
    inside: np.ndarray = field(init=False)  # (W, L)
    seen: np.ndarray = field(init=False)  # (W, L, n_outputs)

    def __post_init__(self):
        lengths = self.windows.last - self.windows.first
        offsets = np.arange(lengths.max())
        self.inside = offsets < lengths[:, None]
        self.rows = np.where(self.inside, self.windows.first[:, None] + offsets, 0)
        self.seen = np.isfinite(self.y[self.rows]) & self.inside[:, :, None]

    def with_noise(self, noise: Noise) -> "Problem":
        """Return the problem with another noise model."""
        return replace(self, noise=noise)

    def over(self, windows: Windows) -> "Problem":
        """Return the problem over other windows."""
        return replace(self, windows=windows)

    def only(self, windows: np.ndarray) -> "Problem":
        """Return the problem with what was measured in some windows alone; the others lead to them."""
        y = self.y.copy()
        for first, last in zip(self.windows.first[~windows], self.windows.last[~windows], strict=True):
            y[first:last] = np.nan
        return replace(self, y=y)

    @cached_property
    def measured_x0(self) -> tuple[np.ndarray, ...]:
        """Initial states of the windows as the record may tell them, (n_windows, n_states) each; else NaN."""
        slopes = (LINE, PARABOLA) if self.rates else (LINE,)
        return tuple(
            measured_states(self.simulator, self.u, self.y, self.windows, self.rates, slope)
            for slope in slopes
        )

    @property
    def n_seen(self) -> int:
        """Number of residuals that count."""
        return int(self.weighted.sum())

    @cached_property
    def weighted(self) -> np.ndarray:
        """Residuals that count, (W, L, n_outputs): seen, as is all that the noise remembers of."""
        counts = self.seen.copy()
        for output, a in enumerate(self.noise.coefficients):
            counts[:, :, output] = remembered(self.seen[:, :, output], a.size)
            if self.noise.starting(output) is None:
                counts[:, : a.size, output] = False
        return counts

    def raw(self, signal: np.ndarray) -> np.ndarray:
        """Return a signal (n_samples, n_outputs) in windows, zero where not seen."""
        return np.where(self.seen, signal[self.rows], 0.0)

    def whiten(self, signal: np.ndarray) -> np.ndarray:
        """Return a signal (n_samples, n_outputs) in windows, whitened and scaled by the noise, (W, T)."""
        if not self.noise.order:
            return self.noise.innovations(self.raw(signal)).reshape(self.rows.shape[0], -1)
        counts = self.weighted
        out = self.noise.innovations(self.raw(signal), counts)
        out[~counts] = 0.0
        return out.reshape(out.shape[0], -1)

    def run(self, model: Model, strength=None) -> Run:
        """Simulate all windows."""
        model = self.tied(model)
        return self.simulator.run(self.u, self.windows, model.x0, model.p, model.effects, strength)

    def tied(self, model: Model) -> Model:
        """Return a model whose effects act on the sums that equations with its parameters have."""
        return model if self.sums is None else model._replace(effects=self.sums.under(model.effects, model.p))

    def samples_of(self, run: Run) -> np.ndarray:
        """Return the samples inside the windows at which a run is finite, in order."""
        rows = self.rows[self.inside]
        return rows[np.isfinite(run.x[rows]).all(axis=1) & np.isfinite(run.y[rows]).all(axis=1)]

    def residual(self, run: Run) -> np.ndarray:
        """Return the whitened residual y - y_sim, (W, T)."""
        return self.whiten(self.y - run.y)

    def left_over(self, model: Model) -> np.ndarray:
        """Return what a model leaves of the outputs, not whitened, (W, L, n_outputs)."""
        return self.raw(self.y - self.run(model).y)

    @property
    def n_initial(self) -> int:
        """Number of free initial states of all windows."""
        return int(self.simulator.free_states.sum()) * self.windows.count

    def states_sensitivity(
        self, model: Model, base: Run, scale: np.ndarray, n_jobs: int | None = None
    ) -> np.ndarray:
        """Return d y_sim / d x0, whitened, (W, T, n_free): every window's own state moves at once.

        Windows of which nothing was seen keep theirs: others may remember them.
        """
        seen = self.seen.any(axis=(1, 2))

        def column(state: int) -> np.ndarray:
            x0 = model.x0.copy()
            x0[seen, state] += scale[state]
            return self.whiten(self.run(model._replace(x0=x0)).y - base.y) / scale[state]

        return self._columns(column, np.flatnonzero(self.simulator.free_states), n_jobs)

    def parameter_sensitivity(
        self, model: Model, base: Run, steps: np.ndarray, n_jobs: int | None = None
    ) -> np.ndarray:
        """Return d y_sim / d q, whitened, (W, T, n_q); zero where the step is."""

        def column(i: int) -> np.ndarray:
            if steps[i] == 0:
                return np.zeros((self.windows.count, self.rows.shape[1] * self.y.shape[1]))
            q = model.q
            q[i] += steps[i]
            return self.whiten(self.run(model.with_q(q)).y - base.y) / steps[i]

        return self._columns(column, range(steps.size), n_jobs)

    def _columns(self, column, indices, n_jobs: int | None) -> np.ndarray:
        """Return the columns of some indices, (W, T, n), each made on its own."""
        if not len(indices):
            return np.zeros((self.windows.count, self.rows.shape[1] * self.y.shape[1], 0))
        if effective_n_jobs(n_jobs) == 1:
            return np.stack([column(i) for i in indices], axis=2)
        # so short that joblib, which looks for results every hundredth of a second, would only slow them down
        with ThreadPoolExecutor(effective_n_jobs(n_jobs)) as threads:
            return np.stack(list(threads.map(column, indices)), axis=2)


def measured_states(
    simulator: Simulator, u, y, windows: Windows, rates: Sequence[tuple[int, int, float]], slope=LINE
) -> np.ndarray:
    """Return initial states of windows as measured, (n_windows, n_states), and rates by slopes; else NaN.

    Parameters
    ----------
    rates : list of (int, int, float)
        Velocities, the positions of which they are the rates, and in what unit of those.
    slope : (int, int)
        Degree of the polynomial that is laid through the first positions, and how many.
    """
    degree, n = slope
    known = simulator.known_states(u, y, windows.first, windows.began)
    given = np.isfinite(known)
    wanted = [r for r in rates if given[:, r[1]].any() and not given[:, r[0]].any()]
    if not wanted:
        return known
    samples = windows.first[:, None] + np.arange(n)
    inside = samples < windows.last[:, None]
    at = np.where(inside, samples, windows.first[:, None]).ravel()
    along = simulator.known_states(u, y, at, np.repeat(windows.began, n))
    powers = np.vander(np.arange(n) / n, degree + 1, increasing=True)
    for velocity, position, factor in wanted:
        measured = along[:, position].reshape(samples.shape)
        seen = inside & np.isfinite(measured)
        enough = np.flatnonzero(seen.sum(axis=1) > degree + 1)
        weighted = seen[enough, :, None] * powers
        right = np.einsum("wti,wt->wi", weighted, np.where(seen, measured, 0.0)[enough])
        fitted = np.linalg.solve(np.swapaxes(weighted, 1, 2) @ weighted, right[:, :, None])
        known[enough, velocity] = fitted[:, 1, 0] / (n * simulator.dt * factor)
    return known


class Projector(NamedTuple):
    """Projection onto what the windows' initial states cannot explain."""

    basis: np.ndarray  # (W, T, n_free) orthonormal columns, zero where a state is not seen
    inverse: np.ndarray  # (W, n_free, T) pseudo-inverse of the sensitivities

    @classmethod
    def of(cls, sensitivity: np.ndarray) -> "Projector":
        """Factor the sensitivities window by window."""
        if sensitivity.shape[2] == 0:
            return cls(sensitivity, np.swapaxes(sensitivity, 1, 2))
        scale = np.sqrt(np.einsum("wtk,wtk->wk", sensitivity, sensitivity))
        scale[scale == 0] = 1.0
        left, values, right = np.linalg.svd(sensitivity / scale[:, None, :], full_matrices=False)
        keep = values > FLAT * values[:, :1].clip(min=1e-300)
        basis = left * keep[:, None, :]
        inverted = np.where(keep, 1 / np.where(keep, values, 1.0), 0.0)
        inverse = np.swapaxes(right, 1, 2) @ (inverted[:, :, None] * np.swapaxes(left, 1, 2))
        inverse /= scale[:, :, None]
        return cls(basis, inverse)

    def __call__(self, columns: np.ndarray) -> np.ndarray:
        """Project (W, T) or (W, T, n) columns."""
        if columns.ndim == 2:
            return self(columns[:, :, None])[:, :, 0]
        return columns - self.basis @ (np.swapaxes(self.basis, 1, 2) @ columns)

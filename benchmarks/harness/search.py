"""The fair search given to a library that has none of its own: a grid judged by free run.

Stage one walks over lags, dead time, degree, decimation and number of terms, in turn through the degrees and
the cheap libraries first, until half of the budget is gone. Stage two tries what else the library offers
(estimators, refinements) on the best three. The winner is fitted again on the whole training record. The
budget is processor time, so that a busy machine does not shorten the search. Signals are standardised with
the mean and deviation of the training record, since raw units cost some methods accuracy.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import product, zip_longest
from math import comb
from typing import Any, Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from harness.recordings import SearchSpec


class FittedModel(Protocol):
    """What a method returns: its terms as text, and a free run from the first measured outputs."""

    terms: tuple[str, ...]

    def predict(self, X: np.ndarray, y_init: np.ndarray) -> np.ndarray:
        """Simulate over X, shape (n_samples,); `y_init` are the first samples of the output."""


@dataclass(frozen=True)
class Config:
    """One point of the grid; `options` are the library's own."""

    output_lags: tuple[int, ...]
    input_lags: tuple[int, ...]
    degree: int
    decimation: int = 1
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def n_candidates(self) -> int:
        return comb(len(self.output_lags) + len(self.input_lags) + self.degree, self.degree)


# Fits one model per size, from one selection run where the library allows that.
FitSizes = Callable[[np.ndarray, np.ndarray, Config, Sequence[int]], Iterator[FittedModel]]


@dataclass
class StandardisedModel:
    """A model of decimated, standardised signals, seen from the recorded ones."""

    inner: FittedModel
    u_scale: tuple[float, float]
    y_scale: tuple[float, float]
    decimation: int
    search: dict[str, Any] = field(default_factory=dict)

    @property
    def terms(self) -> tuple[str, ...]:
        return self.inner.terms

    def predict(self, X: np.ndarray, y_init: np.ndarray) -> np.ndarray:
        (u_mean, u_std), (y_mean, y_std), step = self.u_scale, self.y_scale, self.decimation
        run = self.inner.predict((X[::step] - u_mean) / u_std, (y_init[::step] - y_mean) / y_std)
        run = run * y_std + y_mean
        if step == 1 or not np.isfinite(run).all():
            return run if step == 1 else np.full(len(X), np.nan)
        return CubicSpline(np.arange(len(run)) * step, run)(np.arange(len(X)))


def grid(spec: SearchSpec) -> list[Config]:
    """List the grid: every degree in turn, each in order of its library size.

    Dead time 0 puts the current input among the candidates.
    """
    configs = [
        Config(tuple(range(1, n_y + 1)), tuple(range(delay, delay + n_u)), degree, step)
        for n_y, n_u, delay, degree, step in product(
            spec.lags, spec.lags, (0, 1), spec.degrees, spec.decimations
        )
        if abs(spec.lags.index(n_y) - spec.lags.index(n_u)) <= 1
        and max(n_y, n_u + delay - 1) * step <= spec.n_state
    ]
    by_size = sorted(configs, key=lambda config: config.n_candidates)
    per_degree = [[config for config in by_size if config.degree == degree] for degree in spec.degrees]
    return [config for turn in zip_longest(*per_degree) for config in turn if config is not None]


def search_by_free_run(
    fit_sizes: FitSizes, options: Sequence[dict[str, Any]], X: np.ndarray, y: np.ndarray, spec: SearchSpec
) -> StandardisedModel:
    """Return the model of least validation free-run error that was found within the budget."""
    started = time.process_time()
    u_scale, y_scale = (X.mean(), X.std()), (y.mean(), y.std())
    trials: list[tuple[float, Config, int]] = []
    n_configs = 0

    def fitted(part: slice, config: Config, sizes: Sequence[int]) -> Iterator[StandardisedModel]:
        u_part = (X[part][:: config.decimation] - u_scale[0]) / u_scale[1]
        y_part = (y[part][:: config.decimation] - y_scale[0]) / y_scale[1]
        n_samples = min(len(u_part), int(spec.max_cells / config.n_candidates))
        allowed = sorted({min(size, config.n_candidates) for size in sizes})
        for model in fit_sizes(u_part[:n_samples], y_part[:n_samples], config, allowed):
            yield StandardisedModel(model, u_scale, y_scale, config.decimation, {"fit_samples": n_samples})

    def try_config(config: Config) -> None:
        for model in fitted(spec.fit, config, spec.sizes):
            error = free_run_rmse(model, X[spec.validation], y[spec.validation], spec.n_state)
            trials.append((error, config, len(model.terms)))

    for config in grid(spec):
        if time.process_time() - started > spec.budget_s / 2:
            break
        try_config(replace(config, options=options[0]))
        n_configs += 1
    leaders = list({id(c): c for _, c, _ in sorted(trials, key=lambda trial: trial[0])[:12]}.values())[:3]
    for leader, choice in product(leaders, options[1:]):
        if time.process_time() - started > spec.budget_s:
            break
        try_config(replace(leader, options=choice))

    # The best three, fitted on the whole record and judged once more: a refit may turn unstable.
    finals = []
    for error, config, size in sorted(trials, key=lambda trial: trial[0])[:3]:
        for model in fitted(spec.final, config, [size]):
            again = free_run_rmse(model, X[spec.validation], y[spec.validation], spec.n_state)
            model.search |= {
                "output_lags": config.output_lags,
                "input_lags": config.input_lags,
                "degree": config.degree,
                "decimation": config.decimation,
                "options": config.options,
                "validation_rmse": [error, again],
                "configs_tried": n_configs,
                "configs_in_grid": len(grid(spec)),
            }
            finals.append((again, len(finals), model))
    return min(finals)[2]


def free_run_rmse(model: FittedModel, u: np.ndarray, y: np.ndarray, n_state: int) -> float:
    """Return the free-run RMSE after the samples that set the state (inf if the run diverges)."""
    with np.errstate(all="ignore"):
        run = model.predict(u, y[:n_state])
        error = float(np.sqrt(np.mean((run[n_state:] - y[n_state:]) ** 2)))
    return error if np.isfinite(error) else float("inf")

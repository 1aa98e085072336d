"""Whether a simulation's own steps are fine enough for it, and what its inputs do within them."""

from copy import copy
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.records.finding import DataFinding
from narx_sklearn.discrepancy.results import NOTHING_MISSING
from narx_sklearn.discrepancy.simulators.ode import ODESimulator
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.discrepancy.stages.diagnosis import Diagnosis
from narx_sklearn.model.units import rounded

FINER = 4  # times as many steps, to compare with
EXPLAINING = 0.5  # of what effects do: finer steps may be all that is missing
NOTICEABLE = 0.3  # of the noise, which is a tenth more of error beside it


class Coarse(NamedTuple):
    """How far finer integration steps move a run."""

    output: int  # the one they move most, against its noise
    share: float  # root mean square, of that output's noise
    error: float  # the same in the output's unit


def mind_steps(diagnosis: Diagnosis, n_jobs: int | None = None) -> tuple[Diagnosis, list[DataFinding]]:
    """Return a diagnosis that names no physics for the error of its simulation's steps, and what tells it.

    Without what is missing a refit may go where the steps are too long for it. Unless finer ones explain what
    effects do, that is no matter of the corrected simulation.
    """
    problem, refitted, best = diagnosis.problem, diagnosis.refitted.model, diagnosis.best.fit.model
    before = too_coarse(problem, refitted)
    after = too_coarse(problem, best) if diagnosis.best.effects else before
    is_named = diagnosis.verdict not in NOTHING_MISSING
    if before and is_named and explained_by_finer(problem, refitted, best, n_jobs) > EXPLAINING:
        worse = max((c for c in (before, after) if c is not None), key=lambda c: c.share)
        told = replace(diagnosis, verdict="unknown", steps_miss=True)
        return told, [coarse_steps(problem.simulator, worse)]
    return diagnosis, [] if after is None else [coarse_steps(problem.simulator, after)]


def too_coarse(problem: Problem, model: Model) -> Coarse | None:
    """Return how far finer integration steps move a run, where that is much of the noise.

    What sticks, jumps or stops is met within a step, stiff equations go their own way in steps that are too
    long for them, and the steps' own error then looks like physics. A run that only finer steps keep finite
    is moved without bound.
    """
    simulator = problem.simulator
    if not isinstance(simulator, ODESimulator):
        return None
    finer = _in_finer_steps(simulator)
    run, fine = (
        s.run(problem.u, problem.windows, model.x0, model.p, model.effects).y for s in (simulator, finer)
    )
    if not np.isfinite(problem.raw(fine)).all():
        return None  # finer steps do not help
    moved = problem.raw(fine - run)
    lost = ~np.isfinite(moved).all(axis=(0, 1))
    if lost.any():
        return Coarse(int(np.argmax(lost)), np.inf, np.inf)
    share = _spread(problem.whiten(fine - run).reshape(problem.seen.shape), problem.weighted)
    worst = int(np.argmax(share))
    if not share[worst] > NOTICEABLE:
        return None
    return Coarse(worst, float(share[worst]), float(_spread(moved, problem.seen)[worst]))


def explained_by_finer(problem: Problem, refitted: Model, best: Model, n_jobs: int | None = None) -> float:
    """Return how much finer integration steps take off the cost of a refit, over what effects take off it."""
    before, after = (fit(problem, model, iterations=0).cost for model in (refitted, best))
    finer = replace(problem, simulator=_in_finer_steps(problem.simulator))
    return (before - fit(finer, refitted, n_jobs=n_jobs).cost) / max(before - after, 1e-300)


def _in_finer_steps(simulator):
    finer = copy(simulator)
    finer.substeps = FINER * simulator.substeps
    return finer


def coarse_steps(simulator: Simulator, coarse: Coarse) -> DataFinding:
    """Return how far finer steps move a run as a finding, with the way out."""
    signal, step = simulator.outputs[coarse.output], simulator.dt / simulator.substeps
    finer = _in_finer_steps(simulator).substeps
    how_far = (
        f"{signal.name} moves by {coarse.error:.2g} {signal.unit} root mean square, "
        f"{rounded(coarse.share)} times its noise"
        if np.isfinite(coarse.error)
        else f"{signal.name} no longer leaves the finite range"
    )
    return DataFinding(
        "coarse_steps",
        f"With {FINER} times as many integration steps {how_far}: steps of {step:.4g} s are coarse for what "
        "was found, and their error may be taken for physics. "
        f"Pass substeps={finer} to the simulator and diagnose again.",
        {"output": signal.name, "error": coarse.error, "substeps": finer},
    )


def hold_as_findings(simulator: Simulator) -> list[DataFinding]:
    """Return a finding where the record, and not who wrote the simulator, tells what inputs do in a step."""
    if simulator.hold_is_told or not simulator.linear_hold:
        return []
    return [
        DataFinding(
            "hold",
            "Between samples the inputs go on in straight lines: held for each step, as where nobody tells, "
            "they come half a sample late, and all that was found then leaves more. "
            'Pass hold="linear" to the simulator; all else is told with it.',
            {"hold": "linear"},
        )
    ]


def _spread(signals: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """Return the root mean square of each output (n_outputs,) over the samples that count."""
    total = np.sum(np.where(counted, signals, 0.0) ** 2, axis=(0, 1))
    return np.sqrt(total / np.maximum(counted.sum(axis=(0, 1)), 1))

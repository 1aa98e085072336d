"""Whether a simulation's own steps are fine enough for what was found in it."""

from copy import copy

import numpy as np

from narx_sklearn.discrepancy.checks import DataFinding
from narx_sklearn.discrepancy.ode import ODESimulator
from narx_sklearn.discrepancy.problem import Model, Problem

FINER = 4  # times as many steps, to compare with
NOTICEABLE = 0.3  # of the noise, which is a tenth more of error beside it


def coarse_steps(problem: Problem, model: Model) -> list[DataFinding]:
    """Return a finding where finer integration steps move an output by much of its noise.

    What sticks, jumps or stops is met within a step, and the steps' own error then looks like physics.

    Parameters
    ----------
    problem : Problem
        Windows and noise of the diagnosis.
    model : Model
        What was found.
    """
    simulator = problem.simulator
    if not isinstance(simulator, ODESimulator):
        return []
    finer = copy(simulator)
    finer.substeps = FINER * simulator.substeps
    runs = (s.run(problem.u, problem.windows, model.x0, model.p, model.effects).y for s in (simulator, finer))
    moved = np.subtract(*runs)
    share = _spread(problem.whiten(moved).reshape(problem.seen.shape), problem.weighted)
    worst = int(np.argmax(share))
    if not share[worst] > NOTICEABLE:
        return []
    error = _spread(problem.raw(moved), problem.seen)
    signal = simulator.outputs[worst]
    step = simulator.dt / simulator.substeps
    return [
        DataFinding(
            "coarse_steps",
            f"With {FINER} times as many integration steps {signal.name} moves by {error[worst]:.2g} "
            f"{signal.unit} root mean square, {share[worst]:.1g} times its noise: steps of {step:.4g} s are "
            "coarse for what was found, and their error may be taken for physics. "
            f"Pass substeps={finer.substeps} to the simulator and diagnose again.",
            {"output": signal.name, "error": float(error[worst]), "substeps": finer.substeps},
        )
    ]


def _spread(signals: np.ndarray, counted: np.ndarray) -> np.ndarray:
    """Return the root mean square of each output (n_outputs,) over the samples that count."""
    total = np.sum(np.where(counted, signals, 0.0) ** 2, axis=(0, 1))
    return np.sqrt(total / np.maximum(counted.sum(axis=(0, 1)), 1))

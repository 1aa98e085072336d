"""Which stretches of a record hold more of the mismatch than chance, and what a fit to the others says."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit
from narx_sklearn.discrepancy.locate import segments
from narx_sklearn.discrepancy.stages.trimmed import trimmed


class Stretches(NamedTuple):
    """Where in time a refitted simulation and a recording part."""

    table: pd.DataFrame  # as `segments` gives it, samples and times counted along the whole record
    p: np.ndarray  # (n_parameters,) parameters that go with the quieter half of the record
    residual: np.ndarray  # (n_samples, n_outputs) what these leave; NaN outside the windows


def find_stretches(problem: Problem, refitted: Fit, random_state=None, n_jobs=None) -> Stretches:
    """Find the stretches of time in which the mismatch is, with parameters that it has not bent."""
    p, residual = trimmed(problem, refitted, n_jobs)
    dt, windows = problem.simulator.dt, problem.windows
    start = int(windows.first[0])
    inside = slice(start, int(windows.last[-1]))
    names = [signal.name for signal in problem.simulator.inputs]
    table = segments(residual[inside], dt, u=problem.u[inside], names=names, random_state=random_state)
    table[["start", "stop"]] += start
    table[["start_s", "stop_s"]] += start * dt
    return Stretches(table, p, residual)

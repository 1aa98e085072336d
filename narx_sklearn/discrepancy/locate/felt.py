"""In which equation or output an effect is felt most."""

import numpy as np

from narx_sklearn.discrepancy.fitting.acting import signal_change
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.locate.tangent import tangent
from narx_sklearn.discrepancy.placed import PlacedEffect, Port


def felt_at(placed: PlacedEffect, problem: Problem, model: Model) -> Port:
    """Return the equation or output in which an effect is felt most: its port, if that is no parameter.

    What a parameter adds is compared with how much a state changes in a step, or an output over the record.
    """
    if not placed.port.is_parameter:
        return placed.port
    run, rows, j = problem.run(model), problem.rows[problem.inside], placed.port.index
    linear = tangent(problem.simulator.with_effects(model.effects), run, problem.u, problem.windows, model.p)
    if linear.P is None or linear.Q is None:
        return placed.port
    _, added = signal_change(placed, model.p, problem.u, run.x, problem.windows, rows, problem.simulator.dt)
    steps = np.diff(run.x, axis=0, append=np.nan)[rows]
    felt = {}
    for kind, columns, moved in (("state", linear.P, steps), ("output", linear.Q, run.y[rows])):
        for i in range(columns.shape[1]):
            spread = np.nanstd(moved[:, i])
            if spread > 0:
                felt[Port(kind, i)] = np.sqrt(np.nanmean((columns[rows, i, j] * added) ** 2)) / spread
    return max(felt, key=lambda port: felt[port], default=placed.port)

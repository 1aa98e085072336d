"""Values of a record that stand for none: told, and taken as missing."""

from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.records.checks import DataFinding
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.model.dead_values import dead_in_words, dead_values


class Living(NamedTuple):
    """Inputs and outputs, NaN where they held dead values, and what is said of those."""

    u: np.ndarray
    y: np.ndarray
    findings: list[DataFinding]


def without_dead_values(simulator: Simulator, u: np.ndarray, y: np.ndarray) -> Living:
    """Return inputs, (n_samples, n_inputs), and outputs, (n_samples, n_outputs), without dead values."""
    dead_u = np.array([dead_values(column) for column in u.T], dtype=bool).reshape(u.shape[::-1]).T
    alive = np.where(dead_u, np.nan, u)
    dead_y = np.array([dead_values(column, alive) for column in y.T], dtype=bool).reshape(y.shape[::-1]).T
    findings = [
        DataFinding(
            "dead_values",
            f"{dead_in_words(column, dead, signal.name)}: what a recorder writes where nothing was measured. "
            "Taken as missing.",
            {
                "signal": signal.name,
                "values": np.unique(column[dead]).tolist(),
                "count": int(dead.sum()),
                "samples": np.flatnonzero(dead).tolist(),
            },
        )
        for signals, values, where in ((simulator.inputs, u, dead_u), (simulator.outputs, y, dead_y))
        for signal, column, dead in zip(signals, values.T, where.T, strict=True)
        if dead.any()
    ]
    return Living(alive, np.where(dead_y, np.nan, y), findings)

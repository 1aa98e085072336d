"""Values of a record that stand for none: told, and taken as missing."""

from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.records.checks import DataFinding
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.model.dead_values import dead_in_record, dead_in_words


class Living(NamedTuple):
    """Inputs and outputs, NaN where they held dead values, and what is said of those."""

    u: np.ndarray
    y: np.ndarray
    findings: list[DataFinding]


def without_dead_values(simulator: Simulator, u: np.ndarray, y: np.ndarray) -> Living:
    """Return inputs, (n_samples, n_inputs), and outputs, (n_samples, n_outputs), without dead values."""
    dead = dead_in_record(u, y)
    findings = [
        DataFinding(
            "dead_values",
            f"{dead_in_words(column, at, signal.name)}: what a recorder writes where nothing was measured. "
            "Taken as missing.",
            {
                "signal": signal.name,
                "values": np.unique(column[at]).tolist(),
                "count": int(at.sum()),
                "samples": np.flatnonzero(at).tolist(),
            },
        )
        for signals, values, where in ((simulator.inputs, u, dead.u), (simulator.outputs, y, dead.y))
        for signal, column, at in zip(signals, values.T, where.T, strict=True)
        if at.any()
    ]
    return Living(np.where(dead.u, np.nan, u), np.where(dead.y, np.nan, y), findings)

"""Values of a record that stand for none: told, and taken as missing."""

import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.records.finding import DataFinding
from narx_sklearn.discrepancy.simulators.simulator import Signal, Simulator
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.model.dead_values import dead_columns, dead_in_record


class Living(NamedTuple):
    """Inputs and outputs, NaN where they held dead values, and what is said of those."""

    u: np.ndarray
    y: np.ndarray
    findings: list[DataFinding]


def without_dead_values(simulator: Simulator, u: np.ndarray, y: np.ndarray) -> Living:
    """Return inputs, (n_samples, n_inputs), and outputs, (n_samples, n_outputs), without dead values."""
    dead = dead_in_record(u, y)
    findings = _findings(simulator.inputs, u, dead.u) + _findings(simulator.outputs, y, dead.y)
    return Living(np.where(dead.u, np.nan, u), np.where(dead.y, np.nan, y), findings)


def without_known_values(signals: Sequence[Signal], values: np.ndarray) -> np.ndarray:
    """Return signals without the values that recorders are known to write for none, with a warning of each.

    Parameters
    ----------
    signals : sequence of Signal
    values : ndarray of shape (n_samples, n_signals)
    """
    dead = dead_in_record(values, np.empty((len(values), 0))).u
    warn_of_dead(_findings(signals, values, dead), stacklevel=4)
    return np.where(dead, np.nan, values)


def warn_of_dead(findings: list[DataFinding], stacklevel: int = 3) -> None:
    """Warn of dead values where no finding can be stored."""
    for finding in findings:
        warnings.warn(finding.sentence, NarxWarning, stacklevel=stacklevel)


def _findings(signals: Sequence[Signal], values: np.ndarray, dead: np.ndarray) -> list[DataFinding]:
    return [
        DataFinding(
            "dead_values",
            f"{found.words}: what a recorder writes where nothing was measured. Taken as missing.",
            {
                "signal": found.name,
                "values": found.values.tolist(),
                "count": found.samples.size,
                "samples": found.samples.tolist(),
            },
        )
        for found in dead_columns((signal.name for signal in signals), values, dead)
    ]

"""Whole steps in the measured values: what a coarse sensor writes."""

from collections.abc import Sequence

import numpy as np

from narx_sklearn.discrepancy.records.finding import DataFinding
from narx_sklearn.discrepancy.simulators.simulator import Signal

FEW = 0.3  # share of distinct values from which a signal counts as written in steps
EXACT = 1e-3  # how far from whole steps the values may lie, in steps
VISIBLE = 1e-4  # step over the spread of the signal, below which nobody minds


def measured_steps(y: np.ndarray) -> np.ndarray:
    """Return the step of each column of measured values, (n_outputs,); NaN where there is none."""
    return np.array([_step(column[np.isfinite(column)]) for column in y.T])


def _step(values: np.ndarray) -> float:
    distinct = np.unique(values)
    if not 3 <= distinct.size <= FEW * values.size:
        return np.nan
    gaps = np.diff(distinct)
    gaps = gaps[gaps > 1e-9 * np.ptp(distinct)]
    step = float(gaps.min(initial=np.inf))
    if not np.isfinite(step) or step < VISIBLE * values.std():
        return np.nan
    places = (distinct - distinct[0]) / step
    return step if np.abs(places - np.round(places)).max() < EXACT * max(places[-1], 1.0) else np.nan


def steps_as_findings(steps: np.ndarray, outputs: Sequence[Signal]) -> list[DataFinding]:
    """Return a finding for each output that is written in whole steps."""
    return [
        DataFinding(
            "quantised_output",
            f"{signal.name} is written in steps of {step:.4g} {signal.unit}; the rounding, "
            f"{step / np.sqrt(12):.2g} {signal.unit} root mean square, is part of its noise.".replace(
                "  ", " "
            ),
            {"output": signal.name, "step": float(step)},
        )
        for step, signal in zip(steps, outputs, strict=True)
        if np.isfinite(step)
    ]

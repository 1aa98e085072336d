"""Excitation signals for identification, and a report of what a signal excites."""

from narx_sklearn.signals.filtered_noise import prfs
from narx_sklearn.signals.loading import loading_unloading, quasi_static, reversal_points
from narx_sklearn.signals.periodic import multisine
from narx_sklearn.signals.report import SignalReport, describe_signal
from narx_sklearn.signals.variable_steps import HoldLimits, StepTable, hold_limits, prvs, step_table

__all__ = [
    "HoldLimits",
    "SignalReport",
    "StepTable",
    "describe_signal",
    "hold_limits",
    "loading_unloading",
    "multisine",
    "prfs",
    "prvs",
    "quasi_static",
    "reversal_points",
    "step_table",
]

"""Where a simulation differs from recordings, which physics it lacks, and the proof."""

from narx_sklearn.discrepancy.blackbox import CallableSimulator
from narx_sklearn.discrepancy.checks import DataFinding, check_record
from narx_sklearn.discrepancy.experiment import Experiment, confusability, design_input
from narx_sklearn.discrepancy.fleet import FleetDiagnosis, diagnose_fleet, pool_estimates
from narx_sklearn.discrepancy.fmu import FMUSimulator
from narx_sklearn.discrepancy.narx_simulator import NARXSimulator
from narx_sklearn.discrepancy.ode import ODESimulator
from narx_sklearn.discrepancy.regressor import DiscrepancyRegressor
from narx_sklearn.discrepancy.results import Finding
from narx_sklearn.discrepancy.trace import TraceSimulator

__all__ = [
    "CallableSimulator",
    "DataFinding",
    "DiscrepancyRegressor",
    "Experiment",
    "FMUSimulator",
    "Finding",
    "FleetDiagnosis",
    "NARXSimulator",
    "ODESimulator",
    "TraceSimulator",
    "check_record",
    "confusability",
    "design_input",
    "diagnose_fleet",
    "pool_estimates",
]

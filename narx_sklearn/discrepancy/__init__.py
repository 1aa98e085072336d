"""Where a simulation differs from recordings, which physics it lacks, and the proof.

Who calls whom: a module uses those of its own paragraph and of later ones, a room those named after it.

The estimator
    ``fleet`` diagnoses many recordings, ``regressor`` one: it has the record read and looked through.
    ``conclusion`` has it diagnosed, and holds what was found against samples held out (``verify``);
    ``substeps`` asks whether the simulation's own steps are fine enough, ``narrow`` whether bounds of its
    parameters stand in the way, ``per_session`` what they are in each; ``location``, ``findings``
    (``dependence`` as a sentence), ``extrapolate`` and ``report_text`` tell what came of it. On request
    ``rivals``, with ``nested``, names what an experiment is to separate, and ``as_narx`` identifies a model.
Before any measurement
    ``experiment`` compares ``designs`` of inputs, ``before_measuring`` by the ``tangents`` of effects.
Rooms, each with a map of its own
    ``stages`` of a diagnosis look through ``records``, ``search`` for what is missing and ``locate`` it;
    ``surrogates`` stand in for simulators without equations, ``fitting`` makes a simulator fit a record, and
    ``simulators`` run.
Known to all
    ``settings`` asked for and ``results`` told, ``noise``, effects ``placed`` at a port, and ``columns`` of
    a table by their labels.
"""

from narx_sklearn.discrepancy.before_measuring import confusability, design_input
from narx_sklearn.discrepancy.experiment import Experiment
from narx_sklearn.discrepancy.fleet import FleetDiagnosis, diagnose_fleet, pool_estimates
from narx_sklearn.discrepancy.records.checks import check_record
from narx_sklearn.discrepancy.records.finding import DataFinding
from narx_sklearn.discrepancy.regressor import DiscrepancyRegressor
from narx_sklearn.discrepancy.results import Finding
from narx_sklearn.discrepancy.simulators.ode import ODESimulator
from narx_sklearn.discrepancy.surrogates.blackbox import CallableSimulator
from narx_sklearn.discrepancy.surrogates.fmu import FMUSimulator
from narx_sklearn.discrepancy.surrogates.narx_simulator import NARXSimulator
from narx_sklearn.discrepancy.surrogates.trace import TraceSimulator

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

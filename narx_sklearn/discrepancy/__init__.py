"""Where a simulation differs from recordings, which physics it lacks, and the proof.

Who calls whom: a module uses those of its own paragraph and of later ones.

The estimator
    ``fleet`` diagnoses many recordings, ``regressor`` one: it has the record read and looked through, and
    diagnosed; ``substeps`` asks whether the simulation's own steps are fine enough; ``location``,
    ``findings``, ``verify``, ``extrapolate`` and ``report_text`` tell what came of it. On request
    ``rivals``, with ``nested``, names what an experiment is to separate, and ``as_narx`` identifies a
    model.
Before any measurement
    ``experiment`` compares ``designs`` of inputs, by the ``tangents`` of effects.
The diagnosis
    ``diagnosis`` is the chain. ``beginning`` fits what the simulator has, ``coloured_search`` looks for
    what it lacks, ``stretches`` (by ``trimmed``) and ``temporary`` for what acts for a while; ``judgement``
    says what that comes to, with ``naming`` and ``swaps``: what speaks against names (``refuted``), what has
    none (``unnamed``, ``powers``), and whether the rest is noise (``remainder``, ``followed``, ``pulse``).
The record
    ``record`` makes arrays of it; what is wrong with it itself is seen by ``checks`` (``mistakes`` are
    undone on trial), ``steps`` and ``spikes``.
The search
    ``explain`` adds one effect after another. ``hypotheses`` of the catalogue, and ``generic`` ones without
    a name, become columns of a ``bank``; ``detect`` tests whether anything is missing, ``ranking`` says
    what leads; that is fitted, from other ``valleys`` too, and is then a ``candidate``; ``confirm`` asks
    whether it is noise (``by_chance``, ``restricted``), ``lookalikes`` which is the likeliest and what else
    it could be, ``inference`` how sure that is.
Where it is
    ``locate`` finds port, times, regions and frequencies.
Simulators without equations
    ``trace``, ``blackbox`` and ``fmu``; a ``twin`` stands in for each: ``motion`` or ``stores``, fitted by
    ``trace_fit``, or a ``narx_simulator``.
The fit
    ``start`` guesses initial states, ``refit`` fits a ``problem``: a simulator, and a record in windows.
    ``acting`` tells what effects add along a run.
Simulators
    ``ode`` has equations, which ``equations`` compiles; ``switches`` finds where they jump. Every simulator
    is a ``simulator``, which the ``kernels`` run. ``linearise``, ``structure`` and ``windows`` ask it about
    itself: its slopes, what drives what, how long it remembers.
Known to all
    ``settings`` asked for and ``results`` told, ``noise``, effects ``placed`` at a port, ``columns`` of a
    table and the ``units`` of its labels.
"""

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

"""Compensation: laws that make a machine follow a reference, from its model or its inverse, and loops.

The compensators
    ``roots``, ``isolated``, ``inverse`` and ``physical`` are what users meet; ``_base`` is what they share,
    ``_defaults`` the models that they identify unasked, of which ``choosing`` takes one. The ``holding``
    input is where a law begins.
What is told of a law
    ``beyond`` says where a reference leaves the record, a ``rehearsal`` on a model of the machine where a
    straight line does better (``rehearsing`` takes the model, ``rehearsed`` is the part of an estimator that
    asks for it), ``stability`` whether a law amplifies its errors.
From a model to a law
    ``derive`` does the algebra, in the ``letters`` of a law.
The law
    ``law`` is a value that runs, by ``_kernels``, ``_polynomial_roots`` and ``_user_functions``.
What is done with it
    ``closed_loop`` puts a controller round it, ``tracking`` judges it on a plant.
C for a controller
    ``c_code`` writes a law and ``model_code`` a model, both with ``c_terms`` and ``_c_runtime``.
"""

from narx_sklearn.compensation.c_code import c_source
from narx_sklearn.compensation.closed_loop import PID, ClosedLoopRun, PIDState, simulate_loop, tune_pid
from narx_sklearn.compensation.derive import (
    inverse_law,
    isolated_law,
    root_law,
    root_polynomials,
    smooth_signs,
)
from narx_sklearn.compensation.inverse import InverseCompensator, smooth_output
from narx_sklearn.compensation.isolated import IsolatedCompensator
from narx_sklearn.compensation.law import (
    BoucWenElement,
    CompensationLaw,
    LawCounts,
    LawRun,
    LawState,
    UnreachableWarning,
)
from narx_sklearn.compensation.model_code import model_c_source
from narx_sklearn.compensation.physical import BoucWenCompensator, PrandtlIshlinskiiCompensator
from narx_sklearn.compensation.rehearsal import Rehearsal, Trial
from narx_sklearn.compensation.roots import RootCompensator
from narx_sklearn.compensation.stability import AmplificationWarning, LawStability, law_stability
from narx_sklearn.compensation.tracking import run_plant, tracking_error, tracking_scorer

__all__ = [
    "PID",
    "AmplificationWarning",
    "BoucWenCompensator",
    "BoucWenElement",
    "ClosedLoopRun",
    "CompensationLaw",
    "InverseCompensator",
    "IsolatedCompensator",
    "LawCounts",
    "LawRun",
    "LawStability",
    "LawState",
    "PIDState",
    "PrandtlIshlinskiiCompensator",
    "Rehearsal",
    "RootCompensator",
    "Trial",
    "UnreachableWarning",
    "c_source",
    "inverse_law",
    "isolated_law",
    "law_stability",
    "model_c_source",
    "root_law",
    "root_polynomials",
    "run_plant",
    "simulate_loop",
    "smooth_output",
    "smooth_signs",
    "tracking_error",
    "tracking_scorer",
    "tune_pid",
]

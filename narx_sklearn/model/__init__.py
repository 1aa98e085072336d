"""Terms, polynomials, phi regressors, and the immutable NARX model with its simulation."""

from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.phi import (
    AbsoluteDifference,
    AsymmetricSign,
    Difference,
    DifferenceSign,
    FunctionPhi,
    HystereticOperator,
    Phi,
    Play,
    SmoothSign,
)
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.simulation import FreeRun, free_run, predict_k_steps, predict_one_step, steady_state
from narx_sklearn.model.terms import Term, TermLibrary, TermTable, Variable, count_candidates

__all__ = [
    "AbsoluteDifference",
    "AsymmetricSign",
    "Difference",
    "DifferenceSign",
    "FreeRun",
    "FunctionPhi",
    "HystereticOperator",
    "NARXModel",
    "Phi",
    "Play",
    "Polynomial",
    "SmoothSign",
    "Term",
    "TermLibrary",
    "TermTable",
    "Variable",
    "count_candidates",
    "free_run",
    "predict_k_steps",
    "predict_one_step",
    "steady_state",
]

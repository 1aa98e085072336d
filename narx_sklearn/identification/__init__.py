"""Identification of NARX models: regressors, compression, selection, estimation, estimators."""

from narx_sklearn.identification.constraints import LinearConstraints, parse_constraints
from narx_sklearn.identification.criteria import CRITERIA, information_criterion
from narx_sklearn.identification.distributed import DaskRecord
from narx_sklearn.identification.err_selector import ErrSelector
from narx_sklearn.identification.estimation import (
    RecursiveEstimate,
    least_squares,
    recursive_least_squares,
)
from narx_sklearn.identification.factor import Factor, compress
from narx_sklearn.identification.hysteresis import hysteresis_structure, rate_independent_structure
from narx_sklearn.identification.isolable import isolable_structure
from narx_sklearn.identification.many import ManyRuns, by_session, free_run_many
from narx_sklearn.identification.narx import NARXRegressor
from narx_sklearn.identification.narx_cv import NARXRegressorCV
from narx_sklearn.identification.recordings import Recordings
from narx_sklearn.identification.refinement import FreeRunFit, refine_free_run
from narx_sklearn.identification.scoring import free_run_score
from narx_sklearn.identification.screening import ScreenPath, screen_terms, screening_cost
from narx_sklearn.identification.selection import (
    SelectionPath,
    criterion_minima,
    err_order,
    search_terms,
    size_window,
)
from narx_sklearn.identification.simulation_search import select_on_simulation
from narx_sklearn.identification.spurious import detect_spurious_clusters
from narx_sklearn.identification.structure import exclude_clusters
from narx_sklearn.identification.transformers import LagTransformer, PhiTransformer, TermTransformer
from narx_sklearn.identification.uncertainty import ParameterUncertainty

__all__ = [
    "CRITERIA",
    "DaskRecord",
    "ErrSelector",
    "Factor",
    "FreeRunFit",
    "LagTransformer",
    "LinearConstraints",
    "ManyRuns",
    "NARXRegressor",
    "NARXRegressorCV",
    "ParameterUncertainty",
    "PhiTransformer",
    "Recordings",
    "RecursiveEstimate",
    "ScreenPath",
    "SelectionPath",
    "TermTransformer",
    "by_session",
    "compress",
    "criterion_minima",
    "detect_spurious_clusters",
    "err_order",
    "exclude_clusters",
    "free_run_many",
    "free_run_score",
    "hysteresis_structure",
    "information_criterion",
    "isolable_structure",
    "least_squares",
    "parse_constraints",
    "rate_independent_structure",
    "recursive_least_squares",
    "refine_free_run",
    "screen_terms",
    "screening_cost",
    "search_terms",
    "select_on_simulation",
    "size_window",
]

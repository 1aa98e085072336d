"""Identification of NARX models: regressors, compression, selection, estimation, estimators."""

from narx_sklearn.identification.constraints import LinearConstraints, parse_constraints
from narx_sklearn.identification.criteria import CRITERIA, information_criterion
from narx_sklearn.identification.estimation import (
    RecursiveEstimate,
    least_squares,
    recursive_least_squares,
)
from narx_sklearn.identification.factor import Factor, compress
from narx_sklearn.identification.narx import NARXRegressor
from narx_sklearn.identification.narx_cv import NARXRegressorCV
from narx_sklearn.identification.refinement import FreeRunFit, refine_free_run
from narx_sklearn.identification.screening import ScreenPath, screen_terms, screening_cost
from narx_sklearn.identification.selection import (
    SelectionPath,
    criterion_minima,
    err_order,
    search_terms,
    size_window,
)
from narx_sklearn.identification.structure import exclude_clusters
from narx_sklearn.identification.uncertainty import ParameterUncertainty

__all__ = [
    "CRITERIA",
    "Factor",
    "FreeRunFit",
    "LinearConstraints",
    "NARXRegressor",
    "NARXRegressorCV",
    "ParameterUncertainty",
    "RecursiveEstimate",
    "ScreenPath",
    "SelectionPath",
    "compress",
    "criterion_minima",
    "err_order",
    "exclude_clusters",
    "information_criterion",
    "least_squares",
    "parse_constraints",
    "recursive_least_squares",
    "refine_free_run",
    "screen_terms",
    "screening_cost",
    "search_terms",
    "size_window",
]

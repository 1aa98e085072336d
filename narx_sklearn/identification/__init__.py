"""Identification of NARX models: regressors, compression, selection, estimation."""

from narx_sklearn.identification.criteria import CRITERIA, information_criterion
from narx_sklearn.identification.factor import Factor, compress
from narx_sklearn.identification.selection import (
    SelectionPath,
    criterion_minima,
    err_order,
    search_terms,
    size_window,
)

__all__ = [
    "CRITERIA",
    "Factor",
    "SelectionPath",
    "compress",
    "criterion_minima",
    "err_order",
    "information_criterion",
    "search_terms",
    "size_window",
]

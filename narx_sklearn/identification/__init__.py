"""Identification of NARX models, from records to models and what is told of them.

The estimators
    ``narx`` identifies one model, ``narx_cv`` chooses lags, degree and size as well: all are ``judged`` on
    ``folds``, and ``finalists`` as they will be fitted; ``settings`` is what may be asked of them.
    ``transformers`` and the ``err_selector`` are parts of ordinary pipelines.
What is to be identified
    ``opening`` makes a ``record`` of what is handed over, that is read block by block: arrays, ``recordings``
    in files, ``distributed`` ones, ``batches`` of a stream. ``posing`` chooses signals, candidate terms by
    their ``structure`` (``hysteresis``, ``isolable``; no powers of ``two_values``) and ``constraints``.
    ``dead`` values are told of.
Terms and parameters
    ``choosing`` goes through the steps of a ``procedure``: ``compression`` of the ``regressors`` into a
    ``factor``, after the ``screening`` of many by their inner ``_products``; ``selection`` on it, by
    ``criteria``; ``estimation``, also ``extended`` by terms of noise.
The free run
    ``free_run_fit`` has ``refinement`` fit parameters by it and ``simulation_search`` choose terms, and keeps
    what they find where one-step errors show no ``whiteness``; ``sizes`` lets it choose how many terms. Free
    runs are judged by ``scoring``; some are ``lost``, ``many`` go at the same time.
What is told of a model
    ``told`` with its ``uncertainty``, from ``stretches`` of the record; its ``residuals``, clusters of its
    terms that are ``spurious``, and whether it stays where its input stops, ``at_rest``.
"""

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

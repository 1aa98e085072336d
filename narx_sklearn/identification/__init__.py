"""Identification of NARX models, from records to models and what is told of them.

The estimators
    ``narx`` identifies one model, ``narx_cv`` chooses lags, degree and size as well. ``transformers`` and the
    ``err_selector`` are parts of ordinary pipelines.
What they do
    ``opening`` makes a record of what is handed over, ``dead`` values are told of. ``posing`` chooses
    signals, candidate terms (no powers of ``two_values``) and constraints; ``choosing`` goes through the
    steps to a model. ``batches`` of a stream are kept as a factor.
What is judged and told
    ``cross_validation`` judges choices on parts that are held out, ``validation`` says what is known of a
    model.
What decides on terms and parameters
    The ``free_run``, where a fit is refined by it.
What may be asked
    ``settings`` of a regressor.
What comes first
    Terms and parameters by errors ``one_step`` ahead.
What is given
    The ``structure`` of the candidates, and ``records``.
"""

from narx_sklearn.identification.err_selector import ErrSelector
from narx_sklearn.identification.free_run.many import ManyRuns, by_session, free_run_many
from narx_sklearn.identification.free_run.refinement import FreeRunFit, refine_free_run
from narx_sklearn.identification.free_run.scoring import free_run_score
from narx_sklearn.identification.free_run.simulation_search import select_on_simulation
from narx_sklearn.identification.narx import NARXRegressor
from narx_sklearn.identification.narx_cv import NARXRegressorCV
from narx_sklearn.identification.one_step.criteria import CRITERIA, information_criterion
from narx_sklearn.identification.one_step.estimation import (
    RecursiveEstimate,
    least_squares,
    recursive_least_squares,
)
from narx_sklearn.identification.one_step.factor import Factor, compress
from narx_sklearn.identification.one_step.screening import ScreenPath, screen_terms, screening_cost
from narx_sklearn.identification.one_step.selection import (
    SelectionPath,
    criterion_minima,
    err_order,
    search_terms,
    size_window,
)
from narx_sklearn.identification.one_step.uncertainty import ParameterUncertainty
from narx_sklearn.identification.records.distributed import DaskRecord
from narx_sklearn.identification.records.recordings import Recordings
from narx_sklearn.identification.structure.candidates import exclude_clusters
from narx_sklearn.identification.structure.constraints import LinearConstraints, parse_constraints
from narx_sklearn.identification.structure.hysteresis import hysteresis_structure, rate_independent_structure
from narx_sklearn.identification.structure.isolable import isolable_structure
from narx_sklearn.identification.transformers import LagTransformer, PhiTransformer, TermTransformer
from narx_sklearn.identification.validation.spurious import detect_spurious_clusters

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

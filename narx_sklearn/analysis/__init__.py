"""Analysis of models and residuals: clusters, fixed points, quasi-static sets, hysteresis, residual tests."""

from narx_sklearn.analysis.advice import Advice, Finding, advise
from narx_sklearn.analysis.clusters import TermCluster, TermClusters, term_clusters
from narx_sklearn.analysis.continuum import Continuum, continuum_of_steady_states
from narx_sklearn.analysis.fixed_points import FixedPoint, FixedPoints, fixed_points
from narx_sklearn.analysis.hysteresis import HysteresisReport, hysteresis_report
from narx_sklearn.analysis.loops import HysteresisLoop, hysteresis_loop
from narx_sklearn.analysis.quasistatic import (
    BoundingStructure,
    QuasiStaticSets,
    bounding_structure,
    quasi_static_sets,
)
from narx_sklearn.analysis.residuals import ResidualTest, ResidualTests, residual_tests
from narx_sklearn.analysis.sampling import SamplingAdvice, sampling_advice
from narx_sklearn.analysis.static_curve import StaticCurve, static_curve

__all__ = [
    "Advice",
    "BoundingStructure",
    "Continuum",
    "Finding",
    "FixedPoint",
    "FixedPoints",
    "HysteresisLoop",
    "HysteresisReport",
    "QuasiStaticSets",
    "ResidualTest",
    "ResidualTests",
    "SamplingAdvice",
    "StaticCurve",
    "TermCluster",
    "TermClusters",
    "advise",
    "bounding_structure",
    "continuum_of_steady_states",
    "fixed_points",
    "hysteresis_loop",
    "hysteresis_report",
    "quasi_static_sets",
    "residual_tests",
    "sampling_advice",
    "static_curve",
    "term_clusters",
]

"""Figures: one Display each, numbers first, drawn with matplotlib when asked."""

from narx_sklearn.displays._before_after import BeforeAfterDisplay
from narx_sklearn.displays._compensation import CompensationDisplay
from narx_sklearn.displays._confusability import ConfusabilityDisplay
from narx_sklearn.displays._effect_curve import EffectCurveDisplay
from narx_sklearn.displays._free_run import FreeRunDisplay
from narx_sklearn.displays._hysteresis import HysteresisLoopDisplay
from narx_sklearn.displays._location import LocationDisplay
from narx_sklearn.displays._quasi_static import QuasiStaticDisplay
from narx_sklearn.displays._residuals import ResidualTestsDisplay
from narx_sklearn.displays._selection_path import SelectionPathDisplay
from narx_sklearn.displays._static_curve import StaticCurveDisplay

__all__ = [
    "BeforeAfterDisplay",
    "CompensationDisplay",
    "ConfusabilityDisplay",
    "EffectCurveDisplay",
    "FreeRunDisplay",
    "HysteresisLoopDisplay",
    "LocationDisplay",
    "QuasiStaticDisplay",
    "ResidualTestsDisplay",
    "SelectionPathDisplay",
    "StaticCurveDisplay",
]

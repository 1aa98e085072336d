"""Figures: one Display each, numbers first, drawn with matplotlib when asked."""

from narx_sklearn.displays._hysteresis import HysteresisLoopDisplay
from narx_sklearn.displays._quasi_static import QuasiStaticDisplay
from narx_sklearn.displays._residuals import ResidualTestsDisplay
from narx_sklearn.displays._static_curve import StaticCurveDisplay

__all__ = ["HysteresisLoopDisplay", "QuasiStaticDisplay", "ResidualTestsDisplay", "StaticCurveDisplay"]

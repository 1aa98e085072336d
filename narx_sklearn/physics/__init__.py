"""Physics of hysteresis: operators with memory, their inverses, and estimation from data."""

from narx_sklearn.physics.boucwen import PIEZO_BENCH, BoucWenModel, bouc_wen
from narx_sklearn.physics.boucwen_estimator import BoucWen
from narx_sklearn.physics.hysteretic import hysteretic_operator
from narx_sklearn.physics.multivalued import asymmetric_sign, fit_asymmetric_sign, smooth_sign
from narx_sklearn.physics.play_operator import play
from narx_sklearn.physics.prandtl_ishlinskii import PrandtlIshlinskii, PrandtlIshlinskiiOperator
from narx_sklearn.physics.reversal_curves import ReversalCurves, first_order_reversal_curves

__all__ = [
    "PIEZO_BENCH",
    "BoucWen",
    "BoucWenModel",
    "PrandtlIshlinskii",
    "PrandtlIshlinskiiOperator",
    "ReversalCurves",
    "asymmetric_sign",
    "bouc_wen",
    "first_order_reversal_curves",
    "fit_asymmetric_sign",
    "hysteretic_operator",
    "play",
    "smooth_sign",
]

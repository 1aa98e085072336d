"""Gray-box polynomial NARX models of real machines, as scikit-learn estimators.

Names are imported when they are first used, so that importing the package costs next to nothing.
"""

from importlib import import_module

__version__ = "0.1.0.dev0"

_HOMES = {
    "DiscrepancyRegressor": "discrepancy",
    "ODESimulator": "discrepancy",
    "NARXSimulator": "discrepancy",
    "TraceSimulator": "discrepancy",
    "CallableSimulator": "discrepancy",
    "FMUSimulator": "discrepancy",
    "RootCompensator": "compensation",
    "IsolatedCompensator": "compensation",
    "InverseCompensator": "compensation",
    "NARXModel": "model",
    "NARXRegressor": "identification",
    "NARXRegressorCV": "identification",
    "LagTransformer": "identification",
    "PhiTransformer": "identification",
    "TermTransformer": "identification",
    "ErrSelector": "identification",
    "Recordings": "identification",
    "diagnose_fleet": "discrepancy",
    "register_effect": "physics.effects",
    "list_effects": "physics.effects",
    "render_report": "report",
    "write_report": "report",
    "free_run": "model",
    "residual_tests": "analysis",
}

__all__ = ["__version__", *sorted(_HOMES)]


def __getattr__(name: str):
    if name in _HOMES:
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__():
    return __all__

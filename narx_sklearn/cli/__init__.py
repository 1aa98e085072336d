"""The ``narx-sklearn`` command: diagnose, identify, compensate, excite, demo."""

from narx_sklearn.cli._main import main

__all__ = ["main"]

"""The methods that the benchmarks compare: one module a library, loaded only in the process that runs it.

A module offers any of four tables, each from a name to a function:

SEARCHES    fit(X, y, spec: SearchSpec) -> FittedModel, with a search of its own (real_recordings.py)
RECOVERERS  fit(X, y, spec: LibrarySpec) -> FittedModel, from one given library (recovery.py)
SELECTORS   select(u, y, n_lags, degree, n_terms) -> list of term names (selection_speed.py)
SIMULATORS  make(terms, theta) -> run(u, y_init) (selection_speed.py, free run)
"""

import importlib
from collections.abc import Callable

MODULES = {
    "ours": "methods.ours",
    "sysidentpy": "methods.sysidentpy_narx",
    "fastcan": "methods.fastcan_narx",
    "pysindy": "methods.pysindy_narx",
    "oracle": "methods.oracle",
}


def find(table: str, name: str) -> Callable:
    """Return the function behind `library: variant`, for instance `fastcan: eta`."""
    library = name.partition(":")[0].strip()
    return getattr(importlib.import_module(MODULES[library]), table)[name]

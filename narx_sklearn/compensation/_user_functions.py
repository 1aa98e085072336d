"""Functions of the user's inside a law: compiled where numba can, else called as Python."""

import warnings
from collections.abc import Callable, Sequence
from types import FunctionType

import numpy as np
from numba import njit, objmode
from numba.core.errors import NumbaWarning

from narx_sklearn.compensation._kernels import FUNCTIONS
from narx_sklearn.exceptions import NarxWarning


def compiled_functions(calls: Sequence[tuple[Callable, int, Sequence[int]]]):
    """Return ``functions(window, base)`` of a law, as its kernels take it.

    Parameters
    ----------
    calls : sequence of (callable, int, sequence of int)
        For each of the user's functions where its value stands and where its arguments stand, as distances
        from the first number of the row.

    Warns
    -----
    NarxWarning
        If numba cannot compile a function, with its reason.
    """
    try:
        return _fixed(_written([_scalar(function) for function, _, _ in calls], calls))
    except Exception as error:  # a compiler fails in ways of its own too; nothing else runs here
        reason = _first_line(error)
    names = ", ".join(getattr(f, "__name__", type(f).__name__) for f, _, _ in calls)
    warnings.warn(
        f"{names} could not be compiled ({reason}), so the law calls it as Python, many times slower. "
        "Plain arithmetic, math and numpy functions of scalars compile.",
        NarxWarning,
        stacklevel=4,
    )
    return _interpreted(_written([_elementwise(f) for f, _, _ in calls], calls))


def _written(inner, calls) -> Callable:
    """Return Python that calls every function with numbers of the window and writes its value there."""
    space = {f"f{i}": function for i, function in enumerate(inner)}
    lines = []
    for i, (_, target, steps) in enumerate(calls):
        arguments = ", ".join(f"window[base + {step}]" for step in steps)
        lines.append(f"    window[base + {target}] = f{i}({arguments})")
    exec("def write(window, base):\n" + "\n".join(lines), space)
    return space["write"]


def _scalar(function: Callable):
    """Return a function that numba can call with numbers, if there is one."""
    # numpy's division gives inf where Python's raises
    return njit(error_model="numpy", nogil=True)(function) if isinstance(function, FunctionType) else function


def _elementwise(function: Callable) -> Callable:
    """Return a function of numbers that calls the user's with arrays, as everywhere in the package."""

    def call(*numbers):
        return np.asarray(function(*(np.array([x]) for x in numbers)), dtype=float).reshape(-1)[0]

    return call


def _interpreted(write: Callable):
    """Return a Python ``write`` behind the compiled face."""

    def functions(window, base):
        with objmode():
            write(window, base)

    return _fixed(functions)


def _fixed(write: Callable):
    """Return ``write`` compiled for the signature that the kernels know; there is no file to cache it by."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NumbaWarning)  # Python called in between holds the interpreter lock
        return njit(FUNCTIONS, error_model="numpy", nogil=True)(write)


def _first_line(error: Exception) -> str:
    """Return the line of a compiler's message that says what it did not like."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    telling = [line for line in lines if not line.startswith(("Failed in", "During", "[", "File", "<"))]
    return (telling or lines or [type(error).__name__])[0]

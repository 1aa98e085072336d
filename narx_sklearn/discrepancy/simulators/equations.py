"""User's functions as the kernel takes them: ``(x, u, p, written)``, compiled where numba can."""

import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from inspect import Parameter, signature
from types import FunctionType
from typing import Any

import numpy as np
from numba import carray, njit, objmode
from numba.core import ir, ir_utils
from numba.core.compiler import run_frontend
from numba.core.errors import NumbaError, NumbaWarning, UnsupportedBytecodeError

from narx_sklearn.discrepancy.simulators.addresses import EQUATION
from narx_sklearn.discrepancy.simulators.callables import identity, itself, jitted
from narx_sklearn.exceptions import NarxWarning

KEPT = 128  # compiled functions remembered
# What compiled arithmetic answers with inf or NaN raises in Python; the run ends there in the same way.
UNDEFINED = ("math domain error", "math range error", "expected a ")
ARRAY_WRITTEN = re.compile(r"setitem\(array\(float64, 1d, \w\), Literal\[int\]\(\d+\), .*array\(")

_compiled: dict[Any, Any] = {}


@lru_cache(maxsize=KEPT)
def picker(indices: tuple[int, ...]):
    """Return the compiled output that measures these states."""
    chosen = np.array(indices, dtype=np.int64)

    def measure(x, u, p, written):
        for i in range(chosen.size):
            written[i] = x[chosen[i]]

    return _fixed(measure)


def takes_rates(function: Callable) -> bool:
    """Tell whether an output is one of four arguments, ``(x, u, p, rates)``."""
    try:
        taken = signature(getattr(function, "py_func", function)).parameters.values()
    except (TypeError, ValueError):  # of what was compiled from C nobody knows
        return False
    positional = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
    return sum(one.kind in positional and one.default is Parameter.empty for one in taken) == 4


def compiled(function: Callable, n: int):
    """Return the user's function of ``n`` values as ``(x, u, p, written)``, compiled where numba can.

    One that takes rates has them after the states in ``x``.

    Compiled functions are remembered by what they compute, not by which object they are: a copy that came
    through pickle to a worker, or a notebook cell run again, is not compiled again.
    """
    # one that runs as Python may change what it reads: it is what it is
    for_python, key = (itself(function), n), (identity(function), n)
    found = _compiled.get(for_python) or _compiled.get(key)
    if found is None:
        while len(_compiled) >= KEPT:
            _compiled.pop(next(iter(_compiled)), None)
        found = _compile(function, n)
        _compiled[for_python if getattr(found, "runs_python", False) else key] = found
    return found


def _compile(function: Callable, n: int):
    reason = "it is no Python function"
    with_rates = takes_rates(function)
    given = "x[: x.size // 2], u, p, x[x.size // 2 :]" if with_rates else "x, u, p"
    reach = _reach(function) if isinstance(function, FunctionType) else None
    inner = jitted(function, checked=reach is None)
    if inner is not None:
        for lines in _assignments(n):
            source = (
                f"def write(x, u, p, written):\n    {_guard(reach)}\n    values = inner({given})\n    {lines}"
            )
            try:
                return _fixed(_executed(source, {}, {"inner": inner}))
            except Exception as error:  # a compiler fails in ways of its own too; nothing else runs here
                reason = _first_line(error)

    def write(x, u, p, written):
        given = (x[: x.size // 2], u, p, x[x.size // 2 :]) if with_rates else (x, u, p)
        written[:] = np.asarray(function(*given), dtype=float).reshape(n)

    _warn_of_price(getattr(function, "__name__", type(function).__name__), reason, stacklevel=6)
    return _interpreted(write)


def compiled_lines(
    lines: Sequence[str], values: Mapping[str, Any], functions: Mapping[str, Callable], title: str
):
    """Return ``write(x, u, p, written)`` from its lines, compiled, or Python behind the same face.

    Parameters
    ----------
    lines : sequence of str
        Body of ``write``.
    values : mapping
        Constants and compiled functions that it uses, by name.
    functions : mapping
        User's functions that it calls with numbers, by name.
    title : str
        What it is, for the warning when it does not compile.
    """
    source = "def write(x, u, p, written):\n" + "\n".join(f"    {line}" for line in lines or ["pass"])
    try:
        return _fixed(_executed(source, values, functions))
    except Exception as error:  # as above
        _warn_of_price(title, _first_line(error), stacklevel=7)
    space = {**values, **functions}
    exec(source, space)
    return _interpreted(space["write"])


def _executed(source: str, values: Mapping[str, Any], functions: Mapping[str, Callable]) -> Callable:
    """Return ``write`` from its source text, round the user's functions compiled."""
    space = {**values, **{name: jitted(function) or function for name, function in functions.items()}}
    exec(source, space)
    return space["write"]


def _reach(function: FunctionType) -> tuple[int, ...] | None:
    """Return how many entries of each argument a function takes, if all its indices are plain numbers.

    None where an index is computed. Checking each of many indices at every call takes several times as long
    as the arithmetic between them; where they are known beforehand, the lengths alone need a look.
    """
    try:
        lines = run_frontend(function)
    except (NumbaError, UnsupportedBytecodeError):
        return None  # does not compile, as will be said
    reach = [0] * function.__code__.co_argcount
    for statement in (s for block in lines.blocks.values() for s in block.body):
        value = getattr(statement, "value", None)
        if isinstance(statement, ir.SetItem | ir.StaticSetItem):
            return None
        if not isinstance(value, ir.Expr) or value.op not in ("getitem", "static_getitem"):
            continue
        held = ir_utils.guard(ir_utils.get_definition, lines, value.value)
        if isinstance(held, ir.Expr) and held.op in ("exhaust_iter", "build_tuple"):
            continue  # of a tuple, whose length the compiler knows
        index = value.index
        if isinstance(index, ir.Var):
            index = ir_utils.guard(ir_utils.find_const, lines, index)
        if not isinstance(held, ir.Arg) or type(index) is not int or index < 0:
            return None
        reach[held.index] = max(reach[held.index], index + 1)
    return tuple(reach)


def _guard(reach: tuple[int, ...] | None) -> str:
    """Return the line that compares the lengths of ``x, u, p`` (and rates) with what is taken of them."""
    if reach is None or len(reach) not in (3, 4):
        return "pass"
    if len(reach) == 4:  # states and rates are as many, the two halves of x
        reach = (2 * max(reach[0], reach[3]), *reach[1:3])
    short = " or ".join(f"{name}.size < {n}" for name, n in zip("xup", reach, strict=True))
    return f"if {short}: raise IndexError('index is out of bounds')"


def _assignments(n: int):
    """Yield the ways in which a function's values are written: as a sequence, or as a bare number."""
    yield "; ".join(f"written[{i}] = values[{i}]" for i in range(n)) or "pass"
    if n == 1:
        yield "written[0] = values"


def _warn_of_price(title: str, reason: str, stacklevel: int) -> None:
    warnings.warn(
        f"{title} could not be compiled ({reason}), so it runs as Python, many times slower: a diagnosis of "
        "some thousand samples takes minutes to an hour. Plain arithmetic, min and max, math and most numpy "
        "functions of scalars compile, attributes that are only read, and tables of scipy.interpolate.",
        NarxWarning,
        stacklevel=stacklevel,
    )


def _first_line(error: Exception) -> str:
    """Return the line of a compiler's message that says what it did not like."""
    if not isinstance(error, NumbaError | UnsupportedBytecodeError):
        return (
            f"the compiler fails on it with {type(error).__name__}, as it does on lists that mix integers "
            "and floats: write 0.0 for 0 there"
        )
    if ARRAY_WRITTEN.search(str(error)):
        return "a value that it returns is an array; take numbers by place, such as u[0] for u"
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    telling = [line for line in lines if not line.startswith(("Failed in", "During", "[", "File", "<"))]
    return (telling or lines or [type(error).__name__])[0]


def _interpreted(function: Callable):
    """Return a Python ``write`` behind the compiled face; undefined arithmetic gives NaN, as compiled."""

    def fill(x, u, p, written):
        try:
            function(x, u, p, written)
        except ArithmeticError:
            written[:] = np.nan
        except ValueError as error:
            if not str(error).startswith(UNDEFINED):
                raise
            written[:] = np.nan

    def write(x, u, p, written):
        with objmode():
            fill(x, u, p, written)

    result = _fixed(write)
    result.runs_python = True
    return result


def _fixed(function: Callable):
    """Return the function of arrays ``(x, u, p, written)`` compiled for the one signature the kernel knows.

    Not kept on disk: numba would not notice that something the user's function calls has changed.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NumbaWarning)
        inner = njit(error_model="numpy", nogil=True)(function)

        def write(x, u, p, written, n_x, n_u, n_p, n_written):
            inner(carray(x, (n_x,)), carray(u, (n_u,)), carray(p, (n_p,)), carray(written, (n_written,)))

        return njit(EQUATION, error_model="numpy", nogil=True)(write)

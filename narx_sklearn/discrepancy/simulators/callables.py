"""User's functions, with what they call and read, as the compiler takes them."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from inspect import Parameter, getattr_static, signature
from types import CellType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numba
import numpy as np
from numba import njit

from narx_sklearn.discrepancy.simulators.held import Held
from narx_sklearn.discrepancy.simulators.tables import compiled_table

LARGEST = 1 << 14  # bytes of a table that is compared by its numbers, which every run asks for
KNOWN_TO_NUMBA = {"numpy", "scipy", "numba"}  # whose functions it calls by versions of its own
# packages whose objects are no constants
FOREIGN = KNOWN_TO_NUMBA | {"builtins", "pandas", "polars", "sklearn", "dask"}
NAMED = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD, Parameter.KEYWORD_ONLY)

Within = tuple[Any, ...]  # functions and objects on the way to the one that is looked at


# -- compiled ----------------------------------------------------------------------------------------------


def jitted(function: Callable, checked: bool = True, within: Within = ()) -> Callable | None:
    """Return a function compiled, with what it calls and reads; None of what is no Python function.

    Methods, callable objects and partial functions are functions whose first, or last, arguments are held.
    Attributes of objects and items of mappings are constants, and tables of scipy are compiled. One that
    calls itself, or one that calls it, is left as it is, which does not compile.

    Parameters
    ----------
    function : callable
    checked : bool, default=True
        Whether indices are compared with bounds: one past the end would otherwise read whatever lies there.
    within : tuple, default=()
        Functions and objects that call this one, or hold it.
    """
    if hasattr(function, "py_func"):
        return function  # compiled already
    if isinstance(function, FunctionType):
        return _compile(_with_what_it_uses(function, (*within, function)), checked)
    if isinstance(function, partial):
        return _of_partial(function, within)
    method = _method(function)
    if method is None or _is_among(method.__func__, within):
        return None
    names = names_in(method.__func__.__code__)
    held = Held(_members(method.__self__, names, (*within, method.__func__)))
    inner: Any = jitted(method.__func__, checked, within)
    return _compile(lambda *given: inner(held, *given), checked)


def _compile(function: Callable, checked: bool = True) -> Callable:
    return njit(error_model="numpy", nogil=True, boundscheck=checked)(function)


def _of_partial(function: partial, within: Within) -> Callable | None:
    """Return a partial function compiled, if the keywords it holds are the last of its arguments."""
    inner = jitted(function.func, within=within)
    if inner is None:
        return None
    first, last = function.args, ()
    if function.keywords:
        taken = [p for p in signature(function.func).parameters.values() if p.kind in NAMED]
        known = [p.name in function.keywords for p in taken]
        begin = known.index(True)
        rest = [function.keywords.get(p.name, p.default) for p in taken[begin:]]
        if any(value is Parameter.empty for value in rest):
            return None
        last = tuple(rest)
    first, last = (tuple(_constant(v, (), within) for v in values) for values in (first, last))
    if not first and not last:
        return inner
    return _compile(lambda *given: inner(*first, *given, *last))


def _method(function: Callable) -> MethodType | None:
    """Return the method that a callable is, or has for being called."""
    if isinstance(function, MethodType):
        return function if isinstance(function.__func__, FunctionType) else None
    call = getattr_static(type(function), "__call__", None)
    is_users = isinstance(call, FunctionType) and not _is_foreign(type(function))
    return MethodType(call, function) if is_users else None


def _with_what_it_uses(function: FunctionType, within: Within) -> FunctionType:
    """Return a function whose global and enclosed values are such as the compiler takes."""
    known, enclosed = function.__globals__, function.__closure__ or ()
    names = names_in(function.__code__)
    globals_ = {name: known[name] for name in names if name in known}
    values = {name: _constant(value, names, within) for name, value in globals_.items()}
    changed = {name: value for name, value in values.items() if value is not globals_[name]}
    cells = tuple(_in_cell(cell, names, within) for cell in enclosed)
    code, defaults = _all_positional(function)
    if not changed and cells == enclosed and code is function.__code__:
        return function
    return FunctionType(code, {**known, **changed}, function.__name__, defaults, cells or None)


def _in_cell(cell: CellType, names: frozenset[str], within: Within) -> CellType:
    try:
        value = cell.cell_contents
    except ValueError:  # empty: not set yet
        return cell
    constant = _constant(value, names, within)
    return cell if constant is value else CellType(constant)


def _all_positional(function: FunctionType) -> tuple[CodeType, tuple | None]:
    """Return code and defaults in which arguments by keyword only, which numba lacks, come by place."""
    code, by_keyword = function.__code__, function.__kwdefaults__ or {}
    n = code.co_kwonlyargcount
    names = code.co_varnames[code.co_argcount : code.co_argcount + n]
    if not n or len(by_keyword) < n:
        return code, function.__defaults__
    changed = code.replace(co_argcount=code.co_argcount + n, co_kwonlyargcount=0)
    return changed, (*(function.__defaults__ or ()), *(by_keyword[name] for name in names))


def _constant(value: Any, names: frozenset[str] | tuple, within: Within) -> Any:
    """Return what the compiler takes in the place of a value; the value itself where there is nothing."""
    if _is_among(value, within) or isinstance(value, ModuleType):
        return value
    if _is_users(value):
        return jitted(value, within=within)
    if isinstance(value, list):
        return tuple(value) if value and all(isinstance(v, int | float) for v in value) else value
    table = compiled_table(value)
    if table is not None:
        return table
    is_called = isinstance(value, MethodType | partial) or _method(value) is not None
    if is_called and (isinstance(value, MethodType | partial) or not dict(members_of(value, names))):
        return jitted(value, within=within) or value
    return Held(_members(value, names, within)) if _holds(value) else value


def _members(value: Any, names: frozenset[str] | tuple, within: Within) -> dict[str, Any]:
    """Return the members of an object that go by these names, as the compiler takes them."""
    inside = (*within, value)
    found = {name: _constant(raw, names, inside) for name, raw in members_of(value, names)}
    return {name: constant for name, constant in found.items() if _is_typed(constant)}


def _is_typed(value: Any) -> bool:
    try:
        numba.typeof(value)
    except (ValueError, TypeError, NotImplementedError):
        return False
    return not isinstance(value, list | dict | set)


# -- what functions read -----------------------------------------------------------------------------------


def names_in(code: CodeType) -> frozenset[str]:
    """Return names that code reads, global ones and those of attributes, with what is defined inside."""
    inner = (names_in(part) for part in code.co_consts if isinstance(part, CodeType))
    return frozenset(code.co_names).union(*inner)


def members_of(value: Any, names: frozenset[str] | tuple) -> Iterator[tuple[str, Any]]:
    """Yield names and values of an object's attributes among names, or of a mapping's items."""
    if isinstance(value, Mapping):
        yield from ((key, item) for key, item in value.items() if isinstance(key, str))
        return
    for name in sorted(names):
        try:
            yield name, getattr(value, name)
        except Exception:  # a property of the user's that has no value now, whatever it raises
            continue


def _holds(value: Any) -> bool:
    """Tell whether an object's attributes, or a mapping's items, may be constants."""
    if isinstance(value, Mapping):
        return bool(value) and all(isinstance(key, str) for key in value)
    return not _is_foreign(value if isinstance(value, type) else type(value)) and not _is_typed(value)


def _is_foreign(kind: type) -> bool:
    return (kind.__module__ or "").partition(".")[0] in FOREIGN


def _is_users(value: Any) -> bool:
    """Tell whether a value is a plain function, and none of which the compiler has an own version."""
    if not isinstance(value, FunctionType):
        return False
    return (value.__module__ or "").partition(".")[0] not in KNOWN_TO_NUMBA  # what was typed in has no module


# -- which function it is ----------------------------------------------------------------------------------


def identity(function: Callable) -> Any:
    """Return what tells functions apart: code, defaults, and values that are read; or the object."""
    found = _computes(function, frozenset(), ())
    return found if _is_hashable(found) else itself(function)


def itself(function: Callable) -> Any:
    """Return what tells one object from all others."""
    return function if _is_hashable(function) else _Same(function)


def _computes(value: Any, names: frozenset[str], within: Within) -> Any:
    """Return what a value comes to in code: of a user's function what it computes, of a table its numbers.

    A large table is told by which object it is.
    """
    if isinstance(value, np.ndarray):
        is_small = value.nbytes <= LARGEST
        return (value.shape, value.dtype.str, value.tobytes()) if is_small else _Same(value)
    if _is_among(value, within) or isinstance(value, ModuleType):
        return value if _is_hashable(value) else _Same(value)
    inside = (*within, value)
    if _is_users(value):
        return _computed_by(value, inside)
    if isinstance(value, partial):
        held = (value.args, tuple(sorted(value.keywords.items())))
        return (_computes(value.func, names, inside), held, _types(held))
    method = _method(value)
    if method is not None:
        function: Any = method.__func__
        if _is_among(function, within):
            return function
        inside = (*within, function)
        return (
            _computed_by(function, inside),
            _held_by(method.__self__, names_in(function.__code__), inside),
        )
    if isinstance(value, list):
        return (tuple(value), _types(tuple(value)))
    if _holds(value):
        return _held_by(value, names, inside)
    return value


def _computed_by(function: FunctionType, inside: Within) -> tuple:
    known, names = function.__globals__, names_in(function.__code__)
    cells = (cell.cell_contents for cell in function.__closure__ or () if _is_full(cell))
    enclosed = tuple(_computes(value, names, inside) for value in cells)
    used = tuple((name, _computes(known[name], names, inside)) for name in sorted(names) if name in known)
    by_keyword = tuple(sorted((function.__kwdefaults__ or {}).items()))
    values = (function.__defaults__, by_keyword, enclosed, used)
    return (function.__code__, values, _types(values))


def _held_by(value: Any, names: frozenset[str], inside: Within) -> tuple:
    members = tuple((name, _computes(raw, names, inside)) for name, raw in members_of(value, names))
    return (type(value), members, _types(members))


def _is_full(cell: CellType) -> bool:
    try:
        cell.cell_contents  # noqa: B018
    except ValueError:
        return False
    return True


class _Same:
    """An object that is equal to itself alone, for keys of unhashable callables."""

    def __init__(self, held):
        self.held = held

    def __eq__(self, other):
        return isinstance(other, _Same) and self.held is other.held

    def __hash__(self):
        return id(self.held)


def _types(values):
    """Return the types in nested tuples, for 1, 1.0 and True are equal as keys but not as code."""
    return tuple(map(_types, values)) if isinstance(values, tuple) else type(values)


def _is_among(value: Any, within: Within) -> bool:
    return any(value is one for one in within)


def _is_hashable(value) -> bool:
    try:
        hash(value)
    except TypeError:
        return False
    return True

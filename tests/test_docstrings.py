"""Docstring and signature agree: names, order, presence and defaults of every public name.

Public is what a room lists in ``__all__``; classes bring their public methods along.
"""

import ast
import importlib
import inspect
import pkgutil
from functools import cache

import pytest
from numpydoc.docscrape import FunctionDoc

import narx_sklearn

ROOMS = (
    "",
    *(f".{info.name}" for info in pkgutil.iter_modules(narx_sklearn.__path__) if info.name[0] != "_"),
)


@cache
def public_names(room):
    """Return {dotted name: object} of what a room exports."""
    module = importlib.import_module(f"narx_sklearn{room}")
    return {f"{module.__name__}.{name}": getattr(module, name) for name in getattr(module, "__all__", ())}


def documented_objects(room):
    """Yield the public functions and classes, and the classes' own public methods."""
    for name, value in public_names(room).items():
        if inspect.isclass(value):
            yield name, value
            for method, member in vars(value).items():
                function = getattr(member, "__func__", member)
                if not method.startswith("_") and inspect.isfunction(function) and from_here(function):
                    yield f"{name}.{method}", function
        elif callable(value):
            yield name, inspect.unwrap(getattr(value, "py_func", value))


def from_here(function):
    return (function.__module__ or "").startswith("narx_sklearn")


def parameters_of(value):
    """Return the parameters of a signature as {shown name: default}, without self."""
    stars = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}
    try:
        signature = inspect.signature(value)
    except ValueError:
        return {}
    return {
        stars.get(p.kind, "") + p.name: p.default
        for p in signature.parameters.values()
        if p.name not in ("self", "cls")
    }


def documented_parameters(text):
    """Return {name: type text} of the section Parameters; of Attributes where a result has only those."""
    doc = FunctionDoc(None, doc=text)
    entries = doc["Parameters"] or doc["Attributes"]
    return {name.strip(): entry.type for entry in entries for name in entry.name.split(",")}


def stated_default(text):
    """Return the value after ``default=`` where it is a plain one, else None and whether one is stated."""
    _, found, written = text.partition("default=")
    try:
        return (ast.literal_eval(written), True) if found else (None, False)
    except (ValueError, SyntaxError):
        return None, False


def violations(name, value):
    """Yield what is wrong with one docstring."""
    text = inspect.getdoc(value)
    if not text:
        yield f"{name} has no docstring"
        return
    actual, documented = parameters_of(value), documented_parameters(text)
    is_method = not inspect.isclass(value) and inspect.isfunction(value) and "." in value.__qualname__
    if not documented and is_method:  # a method of one line says all in that line
        return
    if list(actual) != list(documented):
        yield f"{name} documents {list(documented)}, its signature is {list(actual)}"
        return
    for parameter, default in actual.items():
        kind = documented[parameter]
        stated, is_plain = stated_default(kind)
        has_default = default is not inspect.Parameter.empty and not parameter.startswith("*")
        if has_default and "default" not in kind and "optional" not in kind and not inspect.isclass(value):
            yield f"{name}: the default {default!r} of {parameter} is not documented"
        if is_plain and has_default and stated != default:
            yield f"{name}: {parameter} defaults to {default!r}, documented is {stated!r}"
        if is_plain and not has_default:
            yield f"{name}: {parameter} has no default, documented is {stated!r}"


@pytest.mark.parametrize("room", ROOMS)
def test_docstrings_and_signatures_agree(room):
    found = [wrong for name, value in documented_objects(room) for wrong in violations(name, value)]
    assert not found, "\n" + "\n".join(found)


@pytest.mark.parametrize("room", ROOMS)
def test_docstrings_begin_with_one_short_sentence(room):
    wrong = []
    for name, value in documented_objects(room):
        lines = (inspect.getdoc(value) or "").splitlines()
        if not lines or any(lines[1:2]) or not lines[0].endswith((".", ":")):
            wrong.append(name)
    assert not wrong


def test_every_name_of_the_package_itself_shows_an_example():
    without = [
        name
        for name, value in public_names("").items()
        if (inspect.isclass(value) or inspect.isroutine(value))
        and not (inspect.isclass(value) and issubclass(value, Warning | Exception))
        and not FunctionDoc(None, doc=inspect.getdoc(value) or "")["Examples"]
    ]
    assert not without, f"no Examples section: {without}"


@pytest.mark.parametrize("room", ROOMS)
def test_exported_names_exist_once_and_in_order(room):
    listed = list(getattr(importlib.import_module(f"narx_sklearn{room}"), "__all__", ()))
    assert len(set(listed)) == len(listed)
    assert all(value is not None for value in public_names(room).values())

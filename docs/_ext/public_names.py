"""Write the API pages from the rooms' ``__all__``: a public name cannot be forgotten."""

import importlib
import inspect
import pkgutil
from pathlib import Path

import narx_sklearn

EXTRA = (
    "physics.effects",
    "discrepancy.locate",
    "discrepancy.experiment",
    "discrepancy.before_measuring",
    "metrics",
    "exceptions",
)
HOMES = narx_sklearn._HOMES  # room of each name that the package itself offers
LEFT_OUT = {"cli"}  # a command, described by its own help


def setup(app):
    """Register the writer; called by Sphinx."""
    app.connect("config-inited", write_pages)
    return {"parallel_read_safe": True}


def write_pages(app, config) -> None:
    """Write one page a room, and the table of rooms."""
    folder = Path(app.srcdir) / "generated" / "rooms"
    folder.mkdir(parents=True, exist_ok=True)
    rooms = [name for name in room_names() if exported(name)]
    for room in rooms:
        write_if_new(folder / f"{room or 'narx_sklearn'}.rst", page(room))
    toc = "\n".join(f"   rooms/{room or 'narx_sklearn'}" for room in rooms)
    write_if_new(folder.parent / "rooms.rst", f"Rooms\n=====\n\n.. toctree::\n   :maxdepth: 1\n\n{toc}\n")


def room_names() -> list[str]:
    """Return the package itself (""), its public rooms, and the public modules inside them."""
    inside = [info.name for info in pkgutil.iter_modules(narx_sklearn.__path__) if info.name[0] != "_"]
    return ["", *sorted({*inside, *EXTRA} - LEFT_OUT)]


def exported(room: str) -> list[str]:
    """Return the names a room exports: its ``__all__``, or what a module without one defines."""
    module = importlib.import_module(f"narx_sklearn.{room}" if room else "narx_sklearn")
    listed = getattr(module, "__all__", None)
    if listed is None:
        listed = [
            name
            for name, value in vars(module).items()
            if name[0] != "_"
            and (inspect.isclass(value) or inspect.isfunction(value))
            and value.__module__ == module.__name__
        ]
    return [name for name in listed if documented(getattr(module, name))]


def constants(room: str) -> list[str]:
    """Return the values that a room exports beside classes and functions; its version number has no page."""
    module = importlib.import_module(f"narx_sklearn.{room}" if room else "narx_sklearn")
    listed = getattr(module, "__all__", ())
    return [name for name in listed if name[0] != "_" and not documented(getattr(module, name))]


def documented(value) -> bool:
    """Tell whether a name is a class or function, which have pages, and not a constant."""
    return inspect.isclass(value) or callable(value)


def page(room: str) -> str:
    """Return the page of one room: its sentence, and a table that links each name to its own page."""
    dotted = f"narx_sklearn.{room}" if room else "narx_sklearn"
    sentence = inspect.getdoc(importlib.import_module(dotted)) or ""
    # the package itself only lists names that live in the rooms, where their pages are
    listed = exported(room) if room else [f"~narx_sklearn.{HOMES[name]}.{name}" for name in exported(room)]
    names = "\n".join(f"   {name}" for name in listed)
    module = f".. currentmodule:: {dotted}\n\n" if room else ""
    target = f"   :toctree: ../api/{room}\n" if room else ""
    module_of = importlib.import_module(dotted)
    values = "".join(
        f"\n.. py:data:: {name}\n   :type: {type(getattr(module_of, name)).__name__}\n"
        for name in constants(room)
    )
    return (
        f"{dotted}\n{'=' * len(dotted)}\n\n{sentence}\n\n{module}"
        f".. autosummary::\n{target}   :nosignatures:\n\n{names}\n{values}"
    )


def write_if_new(path: Path, text: str) -> None:
    """Write a file unless it says so already, so that Sphinx rebuilds only what changed."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")

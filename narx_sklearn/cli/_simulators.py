"""The simulator that ``--model file.py:name`` means."""

import importlib.util
import inspect
import sys
import traceback
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from types import ModuleType

from narx_sklearn.cli._errors import DataError, UsageError
from narx_sklearn.discrepancy.simulators.simulator import Simulator


def load_simulator(text: str) -> Simulator:
    """Return the simulator of a Python file.

    What the file prints goes to standard error: standard output may carry the result.

    Parameters
    ----------
    text : str
        ``file.py:name``; the name may be left out, where it is ``simulator`` or the file holds only one.

    Returns
    -------
    Simulator

    Raises
    ------
    UsageError
        If the file holds no such name.
    DataError
        If the file is missing or raises.
    """
    path, name = _parts(text)
    if not path.is_file():
        raise DataError(f"Cannot read the model {path}: there is no such file.")
    with redirect_stdout(sys.stderr):
        module = _executed(path, text)
        held = {key: value for key, value in vars(module).items() if isinstance(value, Simulator)}
        if name is None:
            name = next(iter(held)) if len(held) == 1 else "simulator"
        found = getattr(module, name, None)
        if found is None:
            there = f"it holds {', '.join(held)}" if held else "it holds no Simulator"
            way = f" Name the one that is meant: --model {path}:{next(iter(held))}." if held else ""
            raise UsageError(f"--model {text}: {path} has no {name!r}; {there}.{way}")
        if not isinstance(found, Simulator) and callable(found):
            _check_called_without(found, name, text)
            with _blamed_on(path):
                found = found()
    if not isinstance(found, Simulator):
        raise UsageError(
            f"--model {text}: {name!r} is of type {type(found).__name__}; wanted is a Simulator such as "
            "ODESimulator(...), or a function that returns one."
        )
    return found


def _check_called_without(found, name: str, text: str) -> None:
    """Raise where a function takes arguments: it is the right-hand side, and not what returns a simulator."""
    try:
        parameters = inspect.signature(found).parameters.values()
    except (TypeError, ValueError):  # of some builtins nothing is known
        return
    wanted = [
        p.name
        for p in parameters
        if p.default is p.empty and p.kind in (p.POSITIONAL_OR_KEYWORD, p.POSITIONAL_ONLY)
    ]
    if wanted:
        raise UsageError(
            f"--model {text}: {name!r} is a function of {', '.join(wanted)}; wanted is a Simulator, or a "
            "function without arguments that returns one. If it gives the rates of states, wrap it in the "
            f"file, as simulator = ODESimulator({name}, dt=..., states=[...], inputs=[...], "
            "parameters={...}), and name that."
        )


def _executed(path: Path, text: str) -> ModuleType:
    called = f"_model_{path.stem}"  # so that a file named like a module of the library does not hide it
    spec = importlib.util.spec_from_file_location(called, path)
    if spec is None or spec.loader is None:
        raise UsageError(f"--model {text}: wanted is a Python file, file.py:simulator.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[called] = module  # dataclasses look their module up there
    beside = str(path.resolve().parent)
    sys.path.insert(0, beside)  # so that the file may import what lies beside it
    try:
        with _blamed_on(path):
            spec.loader.exec_module(module)
    finally:
        sys.path.remove(beside)
    return module


@contextmanager
def _blamed_on(path: Path):
    try:
        yield
    except (Exception, SystemExit) as error:
        line = _last_line(error, path)
        where = f", line {line}," if line else ""
        raise DataError(f"The model {path}{where} raised {type(error).__name__}: {error}") from error


def _last_line(error: BaseException, path: Path) -> int | None:
    """Return the innermost line of a file that an error, or what caused it, came through."""
    while error.__cause__ is not None:
        error = error.__cause__
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if Path(frame.filename).resolve() == path.resolve()
    ]
    return lines[-1] if lines else None


def _parts(text: str) -> tuple[Path, str | None]:
    path, colon, name = text.rpartition(":")
    return (Path(path), name) if colon and name.isidentifier() else (Path(text), None)

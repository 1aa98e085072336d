"""The simulator that ``--model file.py:name`` means."""

import importlib.util
import sys
from pathlib import Path

from narx_sklearn.cli._errors import DataError, UsageError
from narx_sklearn.discrepancy.simulator import Simulator


def load_simulator(text: str) -> Simulator:
    """Return the simulator of a Python file.

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
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise UsageError(f"--model {text}: wanted is a Python file, file.py:simulator.")
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(path.resolve().parent))  # so that the file may import what lies beside it
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise DataError(f"The model {path} raised {type(error).__name__}: {error}") from error
    finally:
        sys.path.pop(0)
    held = {key: value for key, value in vars(module).items() if isinstance(value, Simulator)}
    if name is None:
        name = next(iter(held)) if len(held) == 1 else "simulator"
    found = getattr(module, name, None)
    if found is None:
        there = f"it holds {', '.join(held)}" if held else "it holds no Simulator"
        raise UsageError(f"--model {text}: {path} has no {name!r}; {there}.")
    if not isinstance(found, Simulator) and callable(found):
        found = found()
    if not isinstance(found, Simulator):
        raise UsageError(
            f"--model {text}: {name!r} is a {type(found).__name__}; wanted is a Simulator such as "
            "ODESimulator(...), or a function that returns one."
        )
    return found


def _parts(text: str) -> tuple[Path, str | None]:
    path, colon, name = text.rpartition(":")
    return (Path(path), name) if colon and name.isidentifier() else (Path(text), None)

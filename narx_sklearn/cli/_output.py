"""What commands write: words for people, JSON and tables for programs."""

import json
import math
import re
import sys
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pandas as pd

from narx_sklearn import __version__
from narx_sklearn.cli._files import write_text


def say(text: str, *, beside: bool = False) -> None:
    """Print for a person: on standard output, or beside it where that carries data."""
    print(text, file=sys.stderr if beside else sys.stdout, flush=True)


def tell_notes(notes: Iterable[str], quiet: bool) -> None:
    """Print on standard error what was guessed or seen."""
    for note in () if quiet else notes:
        print(f"narx-sklearn: note: {note}", file=sys.stderr)


def write_json(target: str, content: dict) -> None:
    """Write values as JSON; what is not finite becomes null, which every reader takes."""
    write_text(target, json.dumps(plain(content), indent=2, ensure_ascii=False, allow_nan=False) + "\n")


def plain(value):
    """Return a value made of what JSON has.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.cli._output import plain
    >>> plain({"a": np.float64(1.5), "b": (np.nan, np.int64(2))})
    {'a': 1.5, 'b': [None, 2]}
    """
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, pd.DataFrame):  # one object a row; an index without a name only numbers them
        return [plain(row) for row in value.reset_index(drop=value.index.name is None).to_dict("records")]
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(item) for item in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, int | np.integer):
        return int(value)
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value if value is None else str(value)


def write_columns(target: str, columns: dict[str, np.ndarray]) -> None:
    """Write signals as a table with a header, numbers to twelve digits."""
    write_text(target, pd.DataFrame(columns).to_csv(index=False, float_format="%.12g", lineterminator="\n"))


def c_prefix(target: str, otherwise: str) -> str:
    """Return what names in a C file begin with: the file's own name, as far as C takes it.

    Examples
    --------
    >>> from narx_sklearn.cli._output import c_prefix
    >>> c_prefix("src/x-axis.c", "model"), c_prefix("2nd.c", "model"), c_prefix("-", "model")
    ('x_axis', 'model_2nd', 'model')
    """
    stem = re.sub(r"\W", "_", Path(target).stem, flags=re.ASCII)
    if not stem.strip("_"):
        return otherwise
    return f"{otherwise}_{stem}" if stem[0].isdigit() else stem


def diagnosis_content(dx) -> dict:
    """Return a fitted diagnosis as plain values."""
    settings = {k: v for k, v in dx.get_params(deep=False).items() if k not in ("simulator", "verbose")}
    tables = ("ports", "segments", "regions", "bands")
    return {
        "format": "narx_sklearn diagnosis",
        "version": __version__,
        "verdict": dx.verdict_,
        "p_value": dx.p_value_,
        "findings": [asdict(finding) for finding in dx.findings_],
        "parameters": dx.parameters_,
        "scores": dx.scores_,
        "extrapolation": dx.extrapolation_,
        "noise": dx.noise_,
        "data_findings": [str(finding) for finding in dx.data_findings_],
        "settings": settings,
        "location": {name: getattr(dx.location_, name) for name in tables},
    }

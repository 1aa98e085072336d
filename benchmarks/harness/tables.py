"""Text tables and the JSON file next to them."""

import json
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any


def format_table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Align a table: words to the left, numbers to the right."""
    cells = [[_text(value) for value in row] for row in [header, *rows]]
    widths = [max(len(row[column]) for row in cells) for column in range(len(header))]
    numeric = [
        all(isinstance(row[column], int | float) or row[column] in ("", "-") for row in rows)
        for column in range(len(header))
    ]
    lines = [
        "  ".join(
            text.rjust(width) if right else text.ljust(width)
            for text, width, right in zip(row, widths, numeric, strict=True)
        ).rstrip()
        for row in cells
    ]
    lines.insert(1, "  ".join("-" * width for width in widths))
    return "\n".join(lines)


def _text(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def versions() -> dict[str, str]:
    """Return the versions that a measured number belongs to."""
    found = {"python": platform.python_version(), "machine": platform.processor() or platform.machine()}
    for name in (
        "narx-sklearn",
        "sysidentpy",
        "fastcan",
        "pysindy",
        "numpy",
        "scipy",
        "scikit-learn",
        "numba",
    ):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def save_json(path: str | None, content: dict[str, Any]) -> None:
    """Write the raw results with the versions, when a path was asked for."""
    if path is not None:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        Path(path).write_text(json.dumps(content | {"versions": versions()}, indent=1))

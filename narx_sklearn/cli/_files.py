"""Files that are either whole or absent, and the two streams that stand for ``-``."""

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from narx_sklearn.cli._errors import DataError


def read_bytes(source: str) -> bytes:
    """Return the content of a file, or of standard input where the source is ``-``."""
    if source == "-":
        return sys.stdin.buffer.read()
    try:
        return Path(source).read_bytes()
    except OSError as error:
        raise DataError(f"Cannot read {source}: {error.strerror}.") from error


def write_text(target: str, text: str) -> None:
    """Write a file in one piece, or to standard output where the target is ``-``."""
    if target == "-":
        _write_out(text)
        return
    with replaced(target) as draft:
        Path(draft).write_text(text, encoding="utf-8")


def _write_out(text: str) -> None:
    if sys.stdout is None:
        raise DataError("Cannot write to standard output: it is closed. Name a file.")
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader has seen enough
        raise
    except OSError as error:
        raise DataError(f"Cannot write to standard output: {error.strerror}.") from error


@contextmanager
def replaced(target: str) -> Iterator[str]:
    """Give the name of a draft beside the target, and put it in the target's place when all went well.

    Whatever interrupts the writing, the target is the old file, the new one, or not there; never a half.
    A link stays a link, to a new file; a device or a named pipe is written to as it is.
    """
    try:
        if _is_special(target):
            yield target
            return
        path = Path(os.path.realpath(target))
        handle, draft = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        os.close(handle)
        try:
            yield draft
            os.chmod(draft, 0o666 & ~_umask())
            os.replace(draft, path)
        finally:
            Path(draft).unlink(missing_ok=True)
    except OSError as error:
        raise DataError(f"Cannot write {target}: {error.strerror or error}.") from error


def check_writable(target: str | None) -> None:
    """Raise before long work, rather than after it, where a result could not be written."""
    if target in (None, "-"):
        return
    path = Path(os.path.realpath(target))
    if path.is_dir():
        raise DataError(f"Cannot write {target}: it is a folder. Name a file in it.")
    if _is_special(target):
        return
    if not path.parent.is_dir():
        raise DataError(f"Cannot write {target}: there is no folder {Path(target).parent}. Make it first.")
    if not os.access(path.parent, os.W_OK):
        raise DataError(f"Cannot write {target}: the folder {Path(target).parent} may not be written to.")


def _is_special(target: str) -> bool:
    """Tell whether a target is a device, a pipe or a terminal, which is written to and never replaced."""
    path = Path(target)
    return path.exists() and not path.is_file() and not path.is_dir()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask

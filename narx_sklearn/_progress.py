"""A progress bar on the terminal, and the lines that may appear beside it.

The bar is drawn on standard error where that is a terminal; in a pipe or a file nothing of it appears, or a
line for each stage.
"""

import os
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

BAR = "{desc} |{bar:20}| {n:3.0f} % [{elapsed}]"
NARROW = 80  # columns of a terminal that does not tell
TICK = 0.5  # seconds between two drawings, so that the clock runs while a stage takes its time


@contextmanager
def progress(
    stages: Mapping[str, float], *, quiet: bool, lines: str | None = None
) -> Iterator[Callable[[str], None]]:
    """Show how far long work has come, and wipe the bar away at its end, however it ends.

    Parameters
    ----------
    stages : mapping of str to float
        Names of the stages, and the share of the whole time, in per cent, that has usually passed when each
        begins.
    quiet : bool
        Show nothing, on a terminal neither.
    lines : str, optional
        Where there is no terminal, write each stage on a line of its own that begins with this.

    Yields
    ------
    callable
        To be called with the name of each stage as it begins. One that is not among ``stages`` is shown and
        leaves the bar where it is.
    """
    from tqdm import tqdm

    is_terminal = sys.stderr.isatty()
    hidden = quiet or not is_terminal
    # left alone, tqdm shows nothing on a terminal that says it is 0 x 0
    size: dict[str, Any] = {} if hidden else {"ncols": _width(), "nrows": 2}
    with tqdm(total=100, disable=hidden, file=sys.stderr, leave=False, bar_format=BAR, **size) as bar:

        def begin(stage: str) -> None:
            if lines is not None and not (quiet or is_terminal):
                print(f"{lines}{stage}", file=sys.stderr, flush=True)
            bar.n = max(bar.n, stages.get(stage, bar.n))
            bar.set_description_str(stage)

        with _ticking(bar):
            yield begin


def _width() -> int:
    """Return the number of columns of the terminal on standard error; some do not know it."""
    try:
        return os.get_terminal_size(sys.stderr.fileno()).columns or NARROW
    except OSError:
        return NARROW


@contextmanager
def _ticking(bar) -> Iterator[None]:
    """Draw the bar again and again until the work is done."""
    if bar.disable:
        yield
        return
    done = threading.Event()

    def tick() -> None:
        while not done.wait(TICK):
            bar.refresh()

    clock = threading.Thread(target=tick, daemon=True)
    clock.start()
    try:
        yield
    finally:
        done.set()
        clock.join()


def write_beside(line: str) -> None:
    """Write a line on standard error, above the bar where there is one."""
    from tqdm import tqdm

    tqdm.write(line, file=sys.stderr)

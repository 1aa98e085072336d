"""Run a command: call it, tell its warnings, and turn what went wrong into a sentence and an exit code."""

import os
import sys
import traceback
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module

from narx_sklearn._progress import write_beside
from narx_sklearn.cli._errors import DataError, UsageError
from narx_sklearn.cli._parser import make_parser
from narx_sklearn.exceptions import NarxWarning

PROGRAM = "narx-sklearn"
INTERRUPTED = 130  # 128 + SIGINT, as shells have it
# What the package raises when data or settings do not fit; anything else is a bug and shows its trace.
REFUSALS = (ValueError, TypeError, RuntimeError, ImportError, OSError)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, default=None
        What follows the program's name; None takes it from the call.

    Returns
    -------
    int
        Exit code: 0 all is well, 1 data or a file cannot be used, 2 wrong use, 130 interrupted.

    Examples
    --------
    >>> from narx_sklearn.cli import main
    >>> main("excite prvs --samples 3 --dt 0.5 --min 0 --max 2 --hold 1 2".split())
    time [s],u
    0,1.43037873274
    0.5,1.43037873274
    1,1.71589123525
    0
    """
    try:
        options = make_parser(PROGRAM).parse_args(arguments)
    except SystemExit as stop:  # argparse has told why
        return int(stop.code or 0)
    called_here: Mapping[str, str] = {}
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always", NarxWarning)
            module = import_module(f"narx_sklearn.cli.{options.module}")
            called_here = getattr(module, "CALLED_HERE", called_here)
            warnings.showwarning = _warning_teller(called_here)
            module.run(options)
            if sys.stdout is not None:
                sys.stdout.flush()
    except UsageError as error:
        return _tell(
            options, error, f"{error}\nTry: {PROGRAM} {options.command} --help", UsageError.exit_code
        )
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # the reader has left: no more output
        return DataError.exit_code
    except (DataError, *REFUSALS) as error:
        return _tell(options, error, _as_called(str(error), called_here), DataError.exit_code)
    except MemoryError as error:
        return _tell(options, error, f"There is not enough memory for this: {error}.", DataError.exit_code)
    except KeyboardInterrupt as error:
        return _tell(options, error, "interrupted; no file was left half written", INTERRUPTED)
    return 0


def _tell(options, error: BaseException, sentence: str, code: int) -> int:
    if options.traceback:
        traceback.print_exception(error)
    print(f"{PROGRAM} {options.command}: {sentence}", file=sys.stderr)
    return code


def _warning_teller(called_here: Mapping[str, str]) -> Callable:
    """Return what shows warnings: those of the package, each sentence once, wherever it arose."""
    told = set()

    def tell(message, category, filename, lineno, file=None, line=None) -> None:
        if issubclass(category, NarxWarning) and str(message) not in told:
            told.add(str(message))
            write_beside(f"{PROGRAM}: warning: {_as_called(str(message), called_here)}")

    return tell


def _as_called(sentence: str, called_here: Mapping[str, str]) -> str:
    """Return a sentence that calls what the package offers in Python by what a command calls it."""
    for name, here in called_here.items():
        sentence = sentence.replace(f"{name}(input_name=...)", here).replace(name, here)
    return sentence

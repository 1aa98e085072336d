"""What the command line takes. Nothing is imported here that help would have to wait for."""

import argparse
import re
from typing import NoReturn

from narx_sklearn import __version__

SEEDS = 2**32  # what numpy takes
RECORD_HELP = """\
The record is a table (csv, tsv, txt or parquet; - for standard input) with one line for each sample.
Separator, decimal comma, header, units in brackets and a time column are found out, and what was found is
told. An empty cell is a missing value, a step in time a gap. Columns called u, y, y_sim or time need no
option; the others are named, or numbered from 1 as they stand in the file. Several recordings of one
machine have the same columns and sampling period; nothing reaches from one into the next.
"""

DIAGNOSE = f"""\
Say where a simulation and a recording part, which physics is missing, and prove it on data held out.

{RECORD_HELP}
The simulation comes as a column of simulated outputs, or as a Simulator in a Python file.

examples:
  narx-sklearn diagnose bench.csv --u "drive" --y position --y-sim simulated --report bench.html
  narx-sklearn diagnose bench.csv --model servo.py:simulator --report bench.html --json bench.json
  narx-sklearn diagnose run1.csv run2.csv run3.csv --model servo.py:simulator
  zcat bench.csv.gz | narx-sklearn diagnose - --dt 0.01 --json - | jq .verdict
"""

IDENTIFY = f"""\
Identify a NARX model, and judge it by its free run on the last part of the record.

{RECORD_HELP}
Without lags and degree they are chosen by cross-validation of the free run; with a --structure that can rest
anywhere, by the free run of those models whose law `compensate` can follow.

examples:
  narx-sklearn identify bench.csv --save model.json
  narx-sklearn identify bench.csv --output-lags 2 --input-lags 3 --degree 3
  narx-sklearn identify run1.csv run2.csv --y position --save model.json
  narx-sklearn identify piezo.csv --structure rate_independent --save model.json
  narx-sklearn identify bench.csv --c sensor.c
"""

COMPENSATE = """\
Turn a reference into the input that makes the machine follow it.

The reference is a table with one column besides the time, and one for each other input of the model, by
name. The model comes from `identify --save`, or is identified here from a record.

examples:
  narx-sklearn compensate reference.csv --model model.json --limits 0 10 --output input.csv
  narx-sklearn compensate reference.csv --record bench.csv --method inverse > input.csv
  narx-sklearn compensate reference.csv --model model.json --c stage.c --output input.csv
"""

EXCITE = """\
Make an excitation signal, to be played to the machine.

examples:
  narx-sklearn excite prvs --samples 5000 --dt 0.01 --min 0 --max 5 --hold 20 60 --output prvs.csv
  narx-sklearn excite prfs --samples 5000 --dt 0.01 --min 0 --max 5 --frequency 1 --seed 3
  narx-sklearn excite multisine --samples 4096 --dt 0.001 --min -1 --max 1 --band 0.5 50 --odd
"""

DEMO = """\
Diagnose a positioning stage whose simulation knows nothing of its friction, and write the report.

examples:
  narx-sklearn demo
  narx-sklearn demo --report stage.html --csv stage.csv
"""


COLUMNS = {"input": "u", "output": "y"}


class _Parser(argparse.ArgumentParser):
    """A parser that says what is wrong in a line, and where all options are told, instead of listing them."""

    def error(self, message: str) -> NoReturn:
        if re.match(r"unrecognized arguments: [^-]", message):  # of which argparse takes one run alone
            message += "; several recordings stand side by side, before or behind all options"
        columns = re.match(r"unrecognized arguments: --(input|output)s?\b(?!-)", message)
        if columns:
            message += f"; {columns[1]} columns are named with --{COLUMNS[columns[1]]}"
        self.exit(2, f"{self.prog}: {message}\nTry: {self.prog} --help\n")


def make_parser(program: str) -> argparse.ArgumentParser:
    """Return the parser of the whole command line."""
    parser = _Parser(
        prog=program,
        description="Find what a simulation lacks, identify models of real machines, compensate them.",
        epilog="exit codes: 0 all is well, 1 data or a file cannot be used, 2 wrong use, 130 interrupted.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="command")
    _diagnose(_command(commands, "diagnose", "find the physics that a simulation lacks", DIAGNOSE))
    _identify(_command(commands, "identify", "identify a NARX model of a recording", IDENTIFY))
    _compensate(_command(commands, "compensate", "make the input that follows a reference", COMPENSATE))
    _excite(_command(commands, "excite", "make an excitation signal", EXCITE))
    _demo(_command(commands, "demo", "run a diagnosis that comes with the package", DEMO))
    return parser


def _command(commands, name: str, help: str, text: str) -> argparse.ArgumentParser:
    description, _, examples = text.partition("examples:")
    parser = commands.add_parser(
        name,
        help=help,
        description=description,
        epilog="examples:" + examples,
        allow_abbrev=False,  # --input is not --input-lags
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(module=f"_{name}")
    parser.add_argument("--quiet", action="store_true", help="tell no progress and no notes")
    parser.add_argument("--traceback", action="store_true", help="show where an error arose")
    return parser


def _records(parser) -> None:
    parser.add_argument(
        "records",
        nargs="+",
        metavar="record",
        help="table of the recording; several of one machine, side by side, are a session each; - for "
        "standard input",
    )


def _record_options(parser, *, y_sim: bool = False) -> None:
    group = parser.add_argument_group("columns and time")
    group.add_argument("--u", metavar="NAMES", help="input columns, with commas between")
    group.add_argument("--y", metavar="NAMES", help="output columns")
    if y_sim:
        group.add_argument("--y-sim", metavar="NAMES", help="simulated outputs, in the order of the outputs")
    group.add_argument(
        "--time", metavar="NAME", help="column that holds the time; none: set it aside and count samples"
    )
    group.add_argument("--session", metavar="NAME", help="column whose changes begin another recording")
    group.add_argument(
        "--dt",
        type=positive,
        metavar="SECONDS",
        help="sampling period, where no column tells; a time column must agree",
    )
    group.add_argument(
        "--resample",
        type=positive,
        nargs="?",
        const=0.0,
        metavar="SECONDS",
        help="interpolate onto an even grid of this period, or of the median step",
    )


def _diagnose(parser) -> None:
    _records(parser)
    parser.add_argument(
        "--model", metavar="FILE.py:NAME", help="Simulator in a Python file, or a function that returns it"
    )
    parser.add_argument("--report", metavar="FILE", help="write an HTML report")
    parser.add_argument("--json", metavar="FILE", help="write the result as JSON; - for standard output")
    _record_options(parser, y_sim=True)
    group = parser.add_argument_group("diagnosis")
    group.add_argument(
        "--effects", metavar="CODES", default="", help="look for these effects only, with commas between"
    )
    group.add_argument("--exclude", metavar="CODES", default="", help="effects that are not looked for")
    group.add_argument(
        "--alpha", type=float, default=0.005, help="chance of a false alarm (default: %(default)s)"
    )
    group.add_argument(
        "--level", type=float, default=0.9, help="level of all intervals (default: %(default)s)"
    )
    group.add_argument(
        "--max-effects", type=int, default=2, help="most effects together (default: %(default)s)"
    )
    group.add_argument("--window", type=int, metavar="SAMPLES", help="length of a fitting window")
    group.add_argument(
        "--test-fraction", type=float, default=0.2, help="last share held out (default: %(default)s)"
    )
    group.add_argument("--seed", type=seed, default=0, help="of all random draws (default: %(default)s)")
    group.add_argument(
        "--jobs", type=jobs, default=-1, metavar="N", help="threads (default: as many as there are)"
    )


def _identify(parser) -> None:
    _records(parser)
    parser.add_argument(
        "--save", metavar="FILE", help="write the model as JSON, for `compensate`; - for standard output"
    )
    parser.add_argument(
        "--c",
        metavar="FILE",
        help="write the model as C that simulates it, functions named after the file; - for standard output",
    )
    parser.add_argument("--json", metavar="FILE", help="write the metrics as JSON; - for standard output")
    _record_options(parser)
    group = parser.add_argument_group("model")
    group.add_argument("--output-lags", type=int, help="longest lag of the output")
    group.add_argument("--input-lags", type=int, help="longest lag of the input")
    group.add_argument(
        "--delay", type=int, default=1, help="shortest lag of the input (default: %(default)s)"
    )
    group.add_argument("--degree", type=int, help="highest degree of a term")
    group.add_argument("--terms", type=int, help="number of terms")
    group.add_argument(
        "--structure",
        help="hysteresis or rate_independent: with differences of the inputs and their signs, a model that "
        "rests wherever its input stops; isolable: one that compensate can isolate the input of",
    )
    group.add_argument(
        "--test-fraction", type=float, default=0.2, help="last share held out (default: %(default)s)"
    )


def _compensate(parser) -> None:
    parser.add_argument("reference", help="table of the reference; - for standard input")
    parser.add_argument("--model", metavar="FILE", help="model that `identify --save` wrote")
    parser.add_argument("--record", metavar="FILE", help="recording from which to identify it")
    parser.add_argument(
        "--method",
        choices=("roots", "isolated", "inverse"),
        default="roots",
        help="how (default: %(default)s)",
    )
    parser.add_argument("--r", metavar="NAME", help="column of the reference")
    parser.add_argument(
        "--start",
        type=float,
        metavar="INPUT",
        help="input at which the machine is held before the first sample",
    )
    parser.add_argument("--limits", type=float, nargs=2, metavar=("LEAST", "MOST"), help="range of the input")
    parser.add_argument("--rate-limit", type=positive, metavar="CHANGE", help="largest change in one sample")
    parser.add_argument(
        "--output", metavar="FILE", default="-", help="where to write (default: standard output)"
    )
    parser.add_argument(
        "--c", metavar="FILE", help="write the law as C for a controller, functions named after the file"
    )
    _record_options(parser)


def _excite(parser) -> None:
    parser.add_argument("signal", choices=("prvs", "prfs", "multisine"), help="kind of signal")
    parser.add_argument("--samples", type=int, required=True, help="length of the signal")
    parser.add_argument("--dt", type=positive, required=True, metavar="SECONDS", help="sampling period")
    parser.add_argument("--min", type=finite, required=True, help="least value")
    parser.add_argument("--max", type=finite, required=True, help="largest value")
    parser.add_argument(
        "--name", default="u", help="label of the column, such as 'drive [V]' (default: %(default)s)"
    )
    parser.add_argument(
        "--hold", type=int, nargs=2, metavar=("LEAST", "MOST"), help="prvs: samples that a level is held"
    )
    parser.add_argument("--frequency", type=positive, metavar="HZ", help="prfs: cutoff of the noise")
    parser.add_argument(
        "--band", type=float, nargs=2, metavar=("LOW", "HIGH"), help="multisine: excited frequencies, Hz"
    )
    parser.add_argument("--odd", action="store_true", help="multisine: odd lines only")
    parser.add_argument("--seed", type=seed, default=0, help="of the random draws (default: %(default)s)")
    parser.add_argument(
        "--output", metavar="FILE", default="-", help="where to write (default: standard output)"
    )


def _demo(parser) -> None:
    parser.add_argument(
        "--report", metavar="FILE", default="narx-demo.html", help="HTML report (default: %(default)s)"
    )
    parser.add_argument("--json", metavar="FILE", help="write the result as JSON; - for standard output")
    parser.add_argument("--csv", metavar="FILE", help="write the recording too")


def finite(text: str) -> float:
    """Return a finite number, or raise what argparse makes a message of."""
    try:
        value = float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number; write decimals with a point") from error
    if not abs(value) < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not finite")
    return value


def positive(text: str) -> float:
    """Return a positive number, or raise what argparse makes a message of."""
    value = finite(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"{text} must be positive")
    return value


def seed(text: str) -> int:
    """Return a seed, or raise what argparse makes a message of."""
    if not text.isdigit() or int(text) >= SEEDS:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 to {SEEDS - 1}")
    return int(text)


def jobs(text: str) -> int:
    """Return a number of threads, or raise what argparse makes a message of."""
    if not text.lstrip("-").isdigit() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of threads; pass 1 or more, or -1 for all")
    return int(text)

"""Command line: ``python -m benchmarks.concealed STEP --out DIR``."""

import argparse
import sys
from pathlib import Path

from benchmarks.concealed.cells import CELLS

SMALL = {"cells": ["T0", "T1", "T2", "T6"], "seeds": range(1), "n_samples": 2000}
SMALL_EFFECTS = (
    "coulomb_friction",
    "cubic_stiffness",
    "quadratic_drag",
    "input_saturation",
    "backlash",
    "root_outflow",
    "gravity",
    "additive_drift",
    "detent_force",
    "position_damping",
)


def main(arguments=None) -> int:
    """Run one step of the protocol; return the exit code."""
    options = _parser().parse_args(arguments)
    return _STEPS[options.step](options)


def _parser():
    parser = argparse.ArgumentParser(prog="python -m benchmarks.concealed", description=__doc__)
    parser.add_argument("step", choices=list(_STEPS))
    parser.add_argument("--out", type=Path, required=True, help="folder of the run")
    parser.add_argument("--cells", type=_cells, default=list(CELLS), help="such as T0,T2 (default: all)")
    parser.add_argument("--seeds", type=_seeds, default=range(1), help="such as 0:20 (default: 0:1)")
    parser.add_argument("--plants", type=_names, help="only these, such as pendulum,rlc")
    parser.add_argument("--effects", type=_names, help="only cases that conceal one of these, or nothing")
    parser.add_argument("--strata", type=_names, help="only these parts of the cells, such as drifting")
    parser.add_argument("--samples", type=int, default=4000, help="of a training recording (default: 4000)")
    parser.add_argument("--jobs", type=int, default=2, help="processes (default: 2)")
    parser.add_argument("--again", action="store_true", help="diagnose anew what has a verdict")
    parser.add_argument("--figures", action="store_true", help="with score: draw every case too")
    return parser


def _cells(text):
    cells = text.split(",")
    unknown = [cell for cell in cells if cell not in CELLS]
    if unknown:
        raise argparse.ArgumentTypeError(f"{unknown} are not cells; there are {', '.join(CELLS)}.")
    return cells


def _seeds(text):
    first, _, last = text.partition(":")
    return range(int(first), int(last) if last else int(first) + 1)


def _names(text):
    return text.split(",")


def _make(options):
    from benchmarks.concealed.make import make

    manifest = make(
        options.cells,
        options.seeds,
        options.out,
        n_samples=options.samples,
        plants=options.plants,
        effects=options.effects,
        strata=options.strata,
        n_jobs=options.jobs,
    )
    print(f"{len(manifest['cases'])} cases in {options.out}, {len(manifest['skipped'])} out of reach")
    return 0


def _diagnose(options):
    from benchmarks.concealed.diagnose import diagnose, load_verdicts

    seals = diagnose(options.out, n_jobs=options.jobs, again=options.again)
    print(f"{len(seals)} files sealed in {options.out / 'verdicts.json'}")
    for name, verdict in load_verdicts(options.out).items():
        if verdict["verdict"] == "error":
            print(f"{name} failed: {verdict['error']}\n{verdict['trace']}", file=sys.stderr)
    return 0


def _experiment(options):
    from benchmarks.concealed.diagnose import diagnose, load_verdicts
    from benchmarks.concealed.experiment import perform

    made = perform(options.out, load_verdicts(options.out))
    if made:
        diagnose(options.out, n_jobs=options.jobs, folder="experiments", again=options.again)
    print(f"{len(made)} experiments recorded and diagnosed")
    return 0


def _baselines(options):
    from benchmarks.concealed.baselines.run import run_baselines

    table = run_baselines(options.out, n_jobs=options.jobs)
    print(table.to_string(index=False, float_format="%.3f"))
    return 0


def _twins(options):
    from benchmarks.concealed.twins import could_be_told

    _, told = could_be_told(options.out, n_jobs=options.jobs)
    print(told.to_string(index=False, float_format="%.3f"))
    return 0


def _score(options):
    from benchmarks.concealed.figures import draw_cases, draw_score
    from benchmarks.concealed.score import clearly_missed, score

    tables = score(options.out)
    draw_score(tables, options.out / "score")
    if options.figures:
        draw_cases(options.out, options.out / "score")
    print(tables["cells"].to_string(index=False, float_format="%.3f"))
    missed = clearly_missed(tables["cells"])
    for row in missed.itertuples():
        print(f"clearly missed: {row.cell} {row.stratum} {row.measure} {row.value:.3f}, target {row.target}")
    return int(len(missed) > 0)


def _small(options):
    options.cells, options.seeds, options.samples = SMALL["cells"], SMALL["seeds"], SMALL["n_samples"]
    options.effects = options.effects or SMALL_EFFECTS
    _make(options)
    _diagnose(options)
    return _score(options)


_STEPS = {
    "make": _make,
    "diagnose": _diagnose,
    "experiment": _experiment,
    "baselines": _baselines,
    "score": _score,
    "twins": _twins,
    "small": _small,
}

if __name__ == "__main__":
    sys.exit(main())

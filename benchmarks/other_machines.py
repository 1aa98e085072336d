"""Machines of other kinds, each with something its simulation lacks: what the diagnosis says of them.

    python benchmarks/other_machines.py [--only quarter_car] [--seed 0] [--noise 0.01] [--jobs 2]

Thirty-six machines with their own units and time scales, from a piezo stage to a greenhouse, some of them
in loops, two unstable. All parameters of the simulations are 5 to 20 % wrong; the noise is white. The
machines are stepped by Heun's method at a fortieth of the sampling period and share no code with the
package. Held-out errors are those of the last fifth, over the recording's spread.
"""

import argparse
import sys
import warnings
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat

import numpy as np
from harness.tables import format_table, save_json
from machines import TRIALS


def diagnose(name: str, missing: str, seed: int, noise: float) -> dict:
    """Return what is said of one trial, a row of the table."""
    from narx_sklearn import DiscrepancyRegressor, ODESimulator

    warnings.simplefilter("ignore")
    (make,) = (make for make in TRIALS if make.__name__ == name)
    rng = np.random.default_rng(seed)
    trial = make(rng, missing)
    y = trial.y + noise * trial.y.std(axis=0) * rng.standard_normal(trial.y.shape)
    dx = DiscrepancyRegressor(ODESimulator(**trial.simulation), random_state=0).fit(trial.u, y)
    found = [finding.effect for finding in dx.findings_]
    right = set(found[:1]) <= set(trial.expected) and bool(found) == bool(trial.expected)
    row = {"machine": name, "missing": missing or "nothing", "verdict": dx.verdict_}
    row |= {"found": ", ".join(f"{f.effect} {f.place}{f.when}" for f in dx.findings_) or "-"}
    row |= {f"{k} %": 100 * dx.scores_.loc[k, "nrmse"] for k in ("nominal", "refitted", "augmented")}
    return row | {"right": right, "alone": right and len(found) < 2}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=[make.__name__ for make in TRIALS])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--noise", type=float, default=0.01, help="standard deviation over that of the output"
    )
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out")
    given = parser.parse_args()
    wanted = [
        (make.__name__, missing)
        for make, effects in TRIALS.items()
        if not given.only or make.__name__ in given.only
        for missing in effects
    ]
    names, missing = zip(*wanted, strict=True)
    with ProcessPoolExecutor(given.jobs) as pool:
        rows = []
        for row in pool.map(diagnose, names, missing, repeat(given.seed), repeat(given.noise)):
            rows.append(row)
            print(f"{len(rows)}/{len(names)} {row['machine']}: {row['missing']}", file=sys.stderr, flush=True)
    print(format_table(list(rows[0]), [list(row.values()) for row in rows]))
    print(
        f"first name (or silence) right: {sum(r['right'] for r in rows)} of {len(rows)}, "
        f"with nothing beside it: {sum(r['alone'] for r in rows)}"
    )
    if given.out:
        save_json(given.out, {"seed": given.seed, "noise": given.noise, "rows": rows})


if __name__ == "__main__":
    main()

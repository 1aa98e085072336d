"""Real recordings with a documented effect kept from the simulator: what the diagnosis says, and the proof.

python benchmarks/real_mismatch.py [--only silverbox,emps] [--trace] [--most 8192] [--out results.txt]

The recordings are read by the package's fetchers (NARX_SKLEARN_DATA names a folder of local copies).
A table is written as soon as a record is done; the report in words follows it.
"""

import argparse
import sys
import traceback
from collections.abc import Callable
from pathlib import Path

from harness.tables import format_table
from mismatch import cases
from mismatch.judge import Outcome, diagnose, from_trace

RECORDS: dict[str, Callable[..., cases.Case]] = {
    "cascaded_tanks": cases.cascaded_tanks,
    "silverbox": cases.silverbox,
    "emps": cases.emps,
    "bouc_wen": cases.bouc_wen,
    "mr_damper": cases.mr_damper,
    "bh_loops": cases.bh_loops,
    "f16": cases.f16,
}
LONG = (
    "silverbox",
    "emps",
    "bouc_wen",
    "mr_damper",
    "f16",
)  # of which the first part will do for a quick look
WITH_TRACE = ("cascaded_tanks", "silverbox", "emps", "bouc_wen")
FRICTION = {"coulomb_friction", "asymmetric_friction", "stribeck_friction"}
HYSTERESIS = {"bouc_wen_hysteresis", "prandtl_ishlinskii"}
HEADER = ["record", "part", "verdict", "found, in order", "nominal", "refitted", "augmented", "unit", "s"]


def targets(outcome: Outcome) -> dict[str, bool]:
    """Return what the documentation of a record lets one expect, and whether it came true."""
    name = outcome.case.name.split(" ")[0]
    found, rmse, value = outcome.effects, outcome.rmse, outcome.parameters
    if name == "silverbox":
        return {
            "cubic stiffness found": "cubic_stiffness" in found,
            "arrow at most 1 mV": rmse["arrow"]["augmented"] <= 1.0,
        }
    if name == "emps":
        held = {"dry friction first": bool(found) and found[0] in FRICTION}
        if "mass" in value and held["dry friction first"]:
            force = value["mass"] * value[f"{found[0]} Fc"]
            held[f"Fc {force:.1f} N within 10 % of 20.4 N"] = abs(force / 20.4 - 1) < 0.10
            held[f"mass {value['mass']:.1f} kg within 5 % of 95.1 kg"] = abs(value["mass"] / 95.1 - 1) < 0.05
        return held | {"fivefold better": outcome.gain("pulses") >= 5.0}
    if name == "cascaded_tanks":
        return {
            "overflow first": found[:1] == ["overflow"],
            "test at most 0.34 V": rmse["test"]["augmented"] <= 0.34,
        }
    if name == "bouc_wen":
        return {
            "hysteresis found": bool(HYSTERESIS & set(found)),
            "multisine tenfold better": outcome.gain("multisine") >= 10.0,
        }
    return {}


def rows(outcome: Outcome) -> list[list]:
    """Return a row for each test part."""
    found = ", ".join(outcome.effects) or "nothing"
    return [
        [
            outcome.case.name,
            part,
            outcome.diagnosis.verdict_,
            found,
            *(errors[kind] for kind in ("nominal", "refitted", "augmented")),
            outcome.case.unit,
            round(outcome.seconds),
        ]
        for part, errors in outcome.rmse.items()
    ]


def story(outcome: Outcome) -> str:
    """Return the report of a record, its parameters after the final fit, and the targets."""
    lines = [outcome.diagnosis.report_]
    lines += ["After the fit to the free run:"]
    lines += [f"   {name} = {value:.5g}" for name, value in outcome.parameters.items()]
    lines += [f"{'holds' if held else 'FAILS'}: {claim}" for claim, held in targets(outcome).items()]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default=",".join(RECORDS), help="records, separated by commas")
    parser.add_argument("--trace", action="store_true", help="the simulator is known by its output alone")
    parser.add_argument("--most", type=int, help="samples of the training part that are used, from its first")
    parser.add_argument("--out", help="file to which every result is added as it comes")
    options = parser.parse_args()
    for name in options.only.split(","):
        if name not in RECORDS:
            parser.error(f"there is no record {name!r}; choose from {', '.join(RECORDS)}")
        if options.trace and name not in WITH_TRACE:
            continue
        try:
            shorter = {"most": options.most} if options.most and name in LONG else {}
            case = RECORDS[name](**shorter)
            outcome = diagnose(from_trace(case) if options.trace else case)
            text = format_table(HEADER, rows(outcome)) + "\n\n" + story(outcome)
        except (ArithmeticError, ValueError, RuntimeError):  # the other records shall still be seen
            text = f"{name}: {traceback.format_exc()}"
        print(text, "\n", flush=True)
        if options.out:
            with Path(options.out).open("a") as file:
                file.write(text + "\n\n")


if __name__ == "__main__":
    sys.exit(main())

"""Free run on the official test parts of real recordings: RMSE, terms, fit time and memory, side by side.

python benchmarks/real_recordings.py [--only silverbox,tanks] [--methods ours,fastcan] [--budget 150]
"""

import argparse
import time
from dataclasses import replace

import methods
from harness.measure import peak_memory_mb, reset_peak_memory, run_fresh
from harness.recordings import RECORDINGS
from harness.search import free_run_rmse
from harness.tables import format_table, save_json

METHODS = ("ours", "ours: black box", "ours: NARXRegressorCV", "sysidentpy", "fastcan")
DEFAULT = (
    "silverbox",
    "emps",
    "tanks",
    "wiener_hammerstein",
    "bouc_wen",
    "f16_level2_wing",
    "f16_level4_wing",
    "f16_level6_wing",
)


def job(task: dict) -> dict:
    """Fit one method on one recording and score every test part (runs in a process of its own)."""
    recording = RECORDINGS[task["recording"]]()
    spec = replace(recording.spec, budget_s=task["budget_s"])
    fit = methods.find("SEARCHES", task["method"])
    reset_peak_memory()
    started = time.process_time()
    model = fit(recording.u, recording.y, spec)
    fit_s = time.process_time() - started
    peak_mb = peak_memory_mb()
    rmse = {
        name: free_run_rmse(model, test.u, test.y, test.n_state) * recording.per_unit
        for name, test in recording.tests.items()
    }
    return {
        "rmse": rmse,
        "terms": list(model.terms),
        "fit_s": fit_s,
        "peak_mb": peak_mb,
        "search": getattr(model, "search", {}),
    }


def _rows(name: str, method: str, result: dict) -> list[list]:
    recording = RECORDINGS[name]()
    if "failed" in result:
        return [
            [name, test, method, result["failed"], recording.unit, "-", "-", "-", "", ""]
            for test in recording.tests
        ]
    remark = _remark(result["search"])
    return [
        [
            name,
            test,
            method,
            rmse,
            recording.unit,
            len(result["terms"]),
            round(result["fit_s"], 1),
            round(result["peak_mb"]),
            recording.references.get(test, ""),
            remark,
        ]
        for test, rmse in result["rmse"].items()
    ]


def _remark(found: dict) -> str:
    """Say which setting a search chose and what it had to leave out; `remark` is the method's own word."""
    parts = [found["remark"]] if "remark" in found else []
    if "degree" in found:
        first, last = found["input_lags"][0], found["input_lags"][-1]
        parts.append(f"y {found['output_lags'][-1]}, u {first}..{last}, degree {found['degree']}")
    if "fit_samples" in found:
        parts.append(f"fit on {found['fit_samples']} samples")
    if found.get("decimation", 1) > 1:
        parts.append(f"every {found['decimation']}th sample")
    if "configs_tried" in found:
        parts.append(f"{found['configs_tried']} of {found['configs_in_grid']} settings tried")
    return ", ".join(parts)


def main() -> None:
    """Run every method on every recording and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default=",".join(DEFAULT), help=f"recordings, of {', '.join(RECORDINGS)}")
    parser.add_argument("--methods", default=",".join(METHODS))
    parser.add_argument("--budget", type=float, default=150.0, help="processor seconds of one search")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--memory-gb", type=float, default=12.0)
    parser.add_argument("--out", help="write the raw results to this JSON file")
    options = parser.parse_args()

    results, rows = {}, []
    for name in options.only.split(","):
        for method in options.methods.split(","):
            task = {"recording": name, "method": method, "budget_s": options.budget}
            result = run_fresh(
                "real_recordings:job",
                task,
                threads=options.threads,
                limit_s=5 * options.budget + 300,
                memory_gb=options.memory_gb,
            )
            results[f"{name} | {method}"] = result
            rows += _rows(name, method, result)
            save_json(options.out, {"budget_s": options.budget, "results": results})
            print(f"{name}: {method}: {result.get('rmse', result.get('failed'))}", flush=True)
    header = (
        "recording",
        "test",
        "method",
        "RMSE",
        "unit",
        "terms",
        "fit cpu s",
        "peak MB",
        "published",
        "choice",
    )
    print(format_table(header, rows))


if __name__ == "__main__":
    main()

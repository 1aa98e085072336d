"""Run the baselines over the cases of a run, and tell how often each was right and how well it predicts."""

import time
from pathlib import Path

import joblib
import numpy as np
import pandas as pd

from benchmarks.concealed.baselines import (
    boosting,
    correlation_tests,
    likelihood,
    sparse_regression,
    symbolic_regression,
)
from benchmarks.concealed.baselines.bench import open_case
from benchmarks.concealed.sealing import read_json

__all__ = ["METHODS", "run_baselines"]

METHODS = {
    "sparse regression, STLSQ": sparse_regression.run_stlsq,
    "sparse regression, SSR": sparse_regression.run_ssr,
    "symbolic regression": symbolic_regression.run,
    "residual correlation tests": correlation_tests.run,
    "likelihood with BIC": likelihood.run,
    "gradient boosting": boosting.run,
}


def run_baselines(out: Path, *, methods=None, n_jobs=1) -> pd.DataFrame:
    """Run every method on every case; write ``out/baselines.csv`` and return the summary.

    Methods whose library is not installed (pysindy, gplearn) are rows that say so.
    """
    out = Path(out)
    names = sorted(read_json(out / "manifest.json")["cases"])
    chosen = list(methods or METHODS)
    rows = joblib.Parallel(n_jobs=n_jobs)(joblib.delayed(_run_case)(out, name, chosen) for name in names)
    table = pd.DataFrame([row for case in rows for row in case])
    table.to_csv(out / "baselines.csv", index=False)
    return _summary(table)


def _run_case(out, name, methods):
    bench = open_case(out / "cases" / name)
    truth = read_json(out / "truth" / f"{name}.json")
    with np.load(out / "truth" / f"{name}.npz") as arrays:
        clean = {session: arrays[f"{session}_clean"] for session in bench.heldout}
    true = [e["effect"] for e in truth["effects"]]
    about = {"case": name, "cell": truth["cell"], "effects": "+".join(true) or "nothing", "R": truth["R"]}
    rows = [about | {"method": "nominal, refitted"} | _errors(_nominal(bench), clean)]
    for method in methods:
        started = time.process_time()
        row = about | {"method": method}
        try:
            answer = METHODS[method](bench)
        except ImportError as error:
            rows.append(row | {"failed": f"{error.name} is not installed"})
            continue
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            rows.append(row | {"failed": f"{type(error).__name__}: {error}"})
            continue
        row |= _errors(answer.runs, clean) | {"seconds": time.process_time() - started}
        if answer.missing is not None:
            row["detected"] = float(answer.missing)
        row["named_right"] = float(answer.named in true) if answer.named and true else None
        rows.append(row)
    return rows


def _nominal(bench):
    return {session: bench.free_run(u) for session, u in bench.heldout.items()}


def _errors(runs, clean):
    """Return held-out errors over the reading's standard deviation; a run that was lost counts as one."""
    found = {}
    for session, run in runs.items():
        error = np.sqrt(np.mean(((run - clean[session]) / np.std(clean[session], axis=0)) ** 2))
        found[f"error_{session}"] = min(float(error), 1.0) if np.isfinite(error) else 1.0
    return found


def _summary(table):
    rows = []
    for method, part in table.groupby("method", sort=False):
        nulls, concealed = part[part["effects"] == "nothing"], part[part["effects"] != "nothing"]
        rows.append(
            {
                "method": method,
                "false alarms": _mean(nulls, "detected"),
                "detected": _mean(concealed, "detected"),
                "named right": _named_right(concealed),
                "error, other": _median(part, "error_other"),
                "error, amplitude": _median(part, "error_amplitude"),
                "failed": float(part["failed"].notna().mean()) if "failed" in part else 0.0,
                "seconds": _median(part, "seconds"),
            }
        )
    return pd.DataFrame(rows)


def _named_right(part):
    """Return the share of cases named right; no name is wrong, unless the method never names."""
    if "named_right" not in part or part["named_right"].isna().all():
        return np.nan
    return float(part["named_right"].fillna(0.0).mean())


def _mean(part, column):
    return float(part[column].mean()) if column in part else np.nan


def _median(part, column):
    return float(part[column].median()) if column in part else np.nan

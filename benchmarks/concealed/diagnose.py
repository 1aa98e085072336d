"""Diagnose cases blind: a case's folder is all that is read; verdicts are sealed before truths are opened."""

import importlib.util
import json
import time
import traceback
import warnings
from pathlib import Path

import joblib
import numpy as np
import pandas as pd

from benchmarks.concealed.sealing import read_json, sha256, write_json

__all__ = ["diagnose", "diagnose_case", "load_nominal", "load_verdicts", "port_text"]

SHOWN = 20  # rows kept of each table of the location
EXPERIMENT_SAMPLES = 4000


def diagnose(out: Path, *, n_jobs=1, options=None, only=None, folder="cases", again=False) -> dict:
    """Diagnose every case below ``out/cases`` and return the digests of the verdicts, also written to disk.

    Parameters
    ----------
    out : Path
        Folder that ``make`` wrote.
    n_jobs : int
        Processes.
    options : dict, optional
        Passed on to ``DiscrepancyRegressor``.
    only : collection of str, optional
        Names of cases; by default all.
    folder : str
        Where the cases are: ``"cases"`` or ``"experiments"``.
    again : bool
        Diagnose anew what has a verdict already.
    """
    out = Path(out)
    folders = sorted(p for p in (out / folder).iterdir() if p.is_dir() and (not only or p.name in only))
    todo = [p for p in folders if again or not (out / "verdicts" / f"{p.name}.json").exists()]
    joblib.Parallel(n_jobs=n_jobs)(joblib.delayed(_diagnose_to_file)(p, out, options or {}) for p in todo)
    seals = {p.name: sha256(p) for p in sorted((out / "verdicts").iterdir())}
    write_json(out / "verdicts.json", seals)
    return seals


def load_nominal(folder: Path):
    """Import the nominal simulator that lies in a case's folder."""
    path = Path(folder) / "nominal.py"
    spec = importlib.util.spec_from_file_location(f"nominal_{path.parent.name.replace('-', '_')}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _diagnose_to_file(folder, out, options):
    started = time.process_time()
    try:
        verdict, predictions = diagnose_case(folder, options)
    except Exception as error:  # one failed case must not lose the others; it counts as a wrong answer
        verdict = {
            "verdict": "error",
            "error": f"{type(error).__name__}: {error}",
            "trace": traceback.format_exc(),
        }
        predictions = {}
    verdict |= {"case": folder.name, "seconds": time.process_time() - started}
    if predictions:
        (out / "verdicts").mkdir(parents=True, exist_ok=True)
        np.savez_compressed(out / "verdicts" / f"{folder.name}.npz", **predictions)
    write_json(out / "verdicts" / f"{folder.name}.json", verdict)


def diagnose_case(folder: Path, options: dict) -> tuple[dict, dict]:
    """Return the verdict of one case and the corrected simulation's held-out free runs."""
    from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator

    nominal = load_nominal(folder)
    simulator = ODESimulator(
        nominal.rhs,
        dt=nominal.DT,
        parameters=nominal.PARAMETERS,
        states=list(nominal.STATES),
        inputs=list(nominal.INPUTS),
        outputs=list(nominal.OUTPUTS),
    )
    recording = pd.read_csv(folder / "recording.csv")
    u, y = recording[list(nominal.INPUTS)], recording[list(nominal.OUTPUTS)]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        dx = DiscrepancyRegressor(simulator, **options).fit(u, y, sessions=recording["session"].to_numpy())
        predictions = _held_out_runs(
            {
                "nominal": simulator,
                "refitted": getattr(dx, "refitted_simulator_", simulator),
                "corrected": dx.simulator_,
            },
            nominal,
            folder,
        )
        verdict = _describe(dx)
        verdict["next_input"] = _proposal(dx, verdict["verdict"], u, nominal.SWING)
    verdict["warnings"] = sorted({str(w.message)[:300] for w in caught})
    return verdict, predictions


def _held_out_runs(simulators, nominal, folder):
    """Return the free runs from rest on the held-out inputs, by session and simulator."""
    heldout = pd.read_csv(folder / "heldout.csv")
    runs = {}
    for session, part in heldout.groupby("session", sort=False):
        u = part[list(nominal.INPUTS)].to_numpy()
        for name, simulator in simulators.items():
            x0 = np.zeros(len(simulator.states))
            x0[: len(nominal.X0)] = nominal.X0  # an effect's own states come after the machine's
            runs[f"{session}_{name}"] = np.asarray(simulator.simulate(u, x0))
    return runs


def _describe(dx) -> dict:
    location = getattr(dx, "location_", None)
    return {
        "verdict": str(dx.verdict_),
        "confidence": _number(getattr(dx, "confidence_", None)),
        "findings": [_finding(f) for f in dx.findings_],
        "ports": _rows(getattr(location, "ports", None)),
        "segments": _rows(getattr(location, "segments", None)),
        "regions": _rows(getattr(location, "regions", None)),
        "parameters": _intervals(dx),
        "report": str(getattr(dx, "report_", "")),
    }


def _finding(finding) -> dict:
    return {
        "effect": str(finding.effect),
        "port": port_text(finding.port),
        "lookalikes": sorted({code for other in finding.lookalikes for code in _codes(other)}),
        "p_value": _number(getattr(finding, "p_value", None)),
        "confidence": _number(getattr(finding, "confidence", None)),
        "parameters": _plain(getattr(finding, "parameters", None)),
        "intervals": _plain(getattr(finding, "intervals", None)),
    }


def _codes(rival: str) -> list[str]:
    """Return the effects of a rival explanation: ``"backlash at input:0 + lag at output:0"`` has two."""
    return [part.split(" at ")[0].strip() for part in str(rival).split(" + ")]


def port_text(port) -> str:
    """Return a port as ``"state:1"``, from text, a pair, or an object with a kind and an index."""
    if hasattr(port, "kind") and hasattr(port, "index") and not isinstance(port, str | tuple):
        return f"{getattr(port.kind, 'name', port.kind)}:{int(port.index)}"
    if isinstance(port, tuple):
        return f"{port[0]}:{int(port[1])}"
    return str(port)


def _intervals(dx) -> dict:
    """Return the refitted parameters of the nominal simulator as {name: [value, lower, upper]}, 90 %."""
    table = getattr(dx, "parameters_", None)
    columns = ["refitted", "refitted_low", "refitted_high"]
    if not hasattr(table, "columns") or not set(columns) <= set(table.columns):
        return {}
    return {str(name): [float(row[c]) for c in columns] for name, row in table.iterrows()}


def _rows(table) -> list[dict]:
    if table is None:
        return []
    if not hasattr(table, "to_json"):
        return _plain(table) or []
    return json.loads(table.head(SHOWN).reset_index(drop=True).to_json(orient="records", default_handler=str))


def _number(value):
    return None if value is None else float(value)


def _plain(value):
    return None if value is None else json.loads(json.dumps(value, default=_as_list))


def _as_list(value):
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _proposal(dx, verdict, u, swing):
    """Return the input that the diagnosis would like to see next, where it could not decide."""
    if verdict != "ambiguous" or not hasattr(dx, "next_experiment"):
        return None
    recorded = float(np.ptp(u.iloc[:, 0])) / 2
    plan = dx.next_experiment(amplitude=swing or recorded, n_samples=EXPERIMENT_SAMPLES)
    signal = getattr(plan, "u", plan)
    return np.asarray(signal, dtype=float).reshape(EXPERIMENT_SAMPLES, -1).tolist()


def load_verdicts(out: Path) -> dict[str, dict]:
    """Read the verdicts back, refusing any that was changed after it was sealed."""
    seals = read_json(Path(out) / "verdicts.json")
    verdicts = {}
    for name, digest in seals.items():
        path = Path(out) / "verdicts" / name
        if sha256(path) != digest:
            raise ValueError(f"{name} was changed after it was sealed in verdicts.json. Diagnose it again.")
        if path.suffix == ".json":
            verdicts[path.stem] = read_json(path)
    return verdicts

"""Write cases to disk: a recording and a nominal simulator to diagnose, and a truth under seal."""

import dataclasses
import inspect
import json
import shutil
import textwrap
import zlib
from pathlib import Path

import joblib
import numpy as np
import pandas as pd

from benchmarks.concealed.case import Case, UnreachableError, build_case
from benchmarks.concealed.cells import recipes
from benchmarks.concealed.noise import stands_out
from benchmarks.concealed.oracle import refit_error, refit_truth
from benchmarks.concealed.regions import activity
from benchmarks.concealed.sealing import read_json, sha256, write_json

__all__ = ["case_name", "make", "write_case", "write_recording"]

NOMINAL = '''"""{title}, as its user simulates it."""

DT = {dt!r}  # s
STATES = {states!r}
INPUTS = {inputs!r}
OUTPUTS = {outputs!r}
PARAMETERS = {parameters}
X0 = {x0!r}  # state at the start of every recording, as the user believes it
SWING = {swing!r}  # of the first input about its middle, as far as an experiment may go; None: as recorded


{source}'''


def make(
    cells, seeds, out: Path, *, n_samples=4000, plants=None, effects=None, strata=None, n_jobs=1
) -> dict:
    """Write the cases of some cells and seeds into `out` and return the manifest of all that are there.

    Cases that an earlier call wrote stay as they are, so a proof can grow as time allows.

    Parameters
    ----------
    cells : list of str
        Such as ``["T0", "T2"]``.
    seeds : iterable of int
        One batch of every cell's cases per seed.
    out : Path
        Receives ``cases/``, ``truth/`` and ``manifest.json``.
    n_samples : int
        Samples of a training recording.
    plants, effects : collection of str, optional
        Keep only these plants; only cases that conceal one of these effects (or nothing).
    strata : collection of str, optional
        Keep only these parts of the cells, such as ``["drifting"]``.
    n_jobs : int
        Processes.
    """
    out = Path(out)
    batches = [
        options for cell in cells for seed in seeds for options in recipes(cell, seed, n_samples, plants)
    ]
    if strata:
        known = sorted({b[0].stratum for b in batches})
        if unknown := sorted(set(strata) - set(known)):
            raise ValueError(f"There is no stratum {unknown} in the cells {list(cells)}; they have {known}.")
        batches = [b for b in batches if b[0].stratum in strata]
    if effects:
        batches = [
            b for b in batches if not b[0].effects or {e.code.name for e in b[0].effects} & set(effects)
        ]
    file = out / "manifest.json"
    manifest = read_json(file) if file.exists() else {"cases": {}, "skipped": []}
    batches = [b for b in batches if not any(case_name(spec) in manifest["cases"] for spec in b)]
    done = joblib.Parallel(n_jobs=n_jobs)(joblib.delayed(_make_one)(options, out) for options in batches)
    manifest["cases"] |= {row["case"]: row["truth"] for row in done if "case" in row}
    skipped = (row["skipped"] for row in done if "skipped" in row)
    manifest["skipped"] += [row for row in skipped if row not in manifest["skipped"]]
    write_json(file, manifest)
    return manifest


def _make_one(options, out):
    reasons = []
    for spec in options:
        try:
            case = build_case(spec)
        except UnreachableError as error:
            reasons.append(f"{spec.plant}: {error}")
            continue
        name = case_name(spec)
        return {"case": name, "truth": write_case(case, name, out)}
    wanted = {"cell": options[0].cell, "stratum": options[0].stratum, "seed": list(options[0].seed)}
    return {"skipped": wanted | {"reasons": reasons}}


def case_name(spec) -> str:
    """Return a name that tells nothing: a number from the recipe."""
    return f"case-{zlib.crc32(repr((spec.cell, spec.seed)).encode()):08x}"


def write_case(case: Case, name: str, out: Path) -> dict[str, str]:
    """Write what may be seen and what may not; return the digests of the truth's files."""
    folder = out / "cases" / name
    folder.mkdir(parents=True, exist_ok=True)
    machine = case.rig.machine
    _table(machine, {"training": case.training}, with_output=True).to_csv(
        folder / "recording.csv", index=False
    )
    _table(machine, case.heldout, with_output=False).to_csv(folder / "heldout.csv", index=False)
    (folder / "nominal.py").write_text(_nominal_source(case), encoding="utf-8")
    return _write_truth(case, name, out / "truth")


def write_recording(old: Path, folder: Path, machine, recording) -> None:
    """Write a case that is another one with one more recording under it."""
    folder.mkdir(parents=True, exist_ok=True)
    for unchanged in ("nominal.py", "heldout.csv"):
        shutil.copy(old / unchanged, folder / unchanged)
    parts = [pd.read_csv(old / "recording.csv"), _table(machine, {"experiment": recording}, with_output=True)]
    pd.concat(parts, ignore_index=True).to_csv(folder / "recording.csv", index=False)


def _table(machine, recordings, with_output):
    """Return recordings under each other, time first; a session's name in its own column."""
    parts = []
    for session, recording in recordings.items():
        columns = {"session": session, "time [s]": machine.dt * np.arange(len(recording.u))}
        columns |= dict(zip(machine.inputs, recording.u.T, strict=True))
        if with_output:
            columns |= dict(zip(machine.outputs, recording.y.T, strict=True))
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def _nominal_source(case):
    machine = case.rig.machine
    parameters = json.dumps(case.guess, indent=4)
    source = textwrap.dedent(inspect.getsource(machine.nominal))
    return NOMINAL.format(
        title=machine.name.replace("_", " ").capitalize(),
        dt=machine.dt,
        states=machine.states,
        inputs=machine.inputs,
        outputs=machine.outputs,
        parameters=parameters,
        swing=None if case.spec.closed_loop else machine.amplitude,
        x0=tuple(float(f"{v:.6g}") for v in case.rig.rest()),
        source=source,
    )


def _write_truth(case, name, folder):
    spec, rig, fit = case.spec, case.rig, case.fit
    n = spec.n_samples
    noise = np.sqrt(np.mean((case.training.y - case.training.clean) ** 2, axis=0))
    effects = [
        {
            "effect": e.code.name,
            "port": e.site.port,
            "site": [int(v) for v in dataclasses.astuple(e.site)],
            "R": depth,
            "wanted_R": e.depth,
            "strength": strength,
            "theta": theta,
            "segment": [int(e.start * n), int(min(e.stop, 1.0) * n)],
        }
        for (e, theta), strength, depth in zip(rig.effects, case.strengths, case.depths, strict=True)
    ]
    oracle = refit_truth(case)
    truth = {
        "case": name,
        "cell": spec.cell,
        "stratum": spec.stratum,
        "plant": spec.plant,
        "seed": list(spec.seed),
        "noise": spec.noise,
        "noise_rms": noise,
        "excitation": spec.excitation,
        "closed_loop": spec.closed_loop,
        "sigma": np.broadcast_to(rig.sigma, (len(rig.machine.measured),)),
        "effects": effects,
        "R": fit.ratio,
        "parameters": rig.parameters,
        "constants": rig.constants,
        "guess": case.guess,
        "refitted": fit.parameters,
        "oracle": {
            "z_scores": oracle.z_scores,
            "z_in_colour": stands_out(fit.residual, spec.noise),
            "errors": oracle.errors,
        },
        "refit_errors": {k: refit_error(case, r) for k, r in case.heldout.items()},
        "n_samples": n,
    }
    folder.mkdir(parents=True, exist_ok=True)
    masks = [activity(e, theta, case.training, rig.rest()) for e, theta in rig.effects]
    arrays = {f"active_{i}": mask for i, mask in enumerate(masks) if mask is not None}
    arrays |= {
        "training_clean": case.training.clean,
        "states": case.training.states,
        "state_names": np.array(rig.machine.states),
    }
    arrays |= {
        f"{session}_{k}": getattr(r, k) for session, r in case.heldout.items() for k in ("u", "y", "clean")
    }
    np.savez_compressed(folder / f"{name}.npz", **arrays)
    return {
        f"{name}.json": write_json(folder / f"{name}.json", truth),
        f"{name}.npz": sha256(folder / f"{name}.npz"),
    }

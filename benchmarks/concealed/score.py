"""Open the truths, judge the sealed verdicts, and write the tables."""

from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.concealed.bounds import (
    clopper_pearson,
    error_of_right_confidence,
    expected_calibration_error,
)
from benchmarks.concealed.diagnose import load_verdicts
from benchmarks.concealed.judge import judge, names_of
from benchmarks.concealed.sealing import read_json, sha256
from benchmarks.concealed.targets import TARGETS, Target

__all__ = ["clearly_missed", "score"]

GAP_TARGET, HARM_TARGET, CALIBRATION_TARGET, CALIBRATION_CASES = 0.80, 0.01, 0.05, 50
EXPERIMENT_TARGETS = (0.90, 0.30)  # resolved; better than a random input by
LOSS_TARGET = 0.10  # of T7 against T2
COVERAGE = (0.87, 0.93)
CLEAR = 0.998  # level at which a target is called clearly missed: many strata are looked at
ORACLE_CLEAR = 3.0  # standard errors at which an oracle would call an effect present


def score(out: Path) -> dict[str, pd.DataFrame]:
    """Return, and write below ``out/score``, the tables of a run.

    ``cases`` has one row a case; ``cells`` the measures with their exact bounds, mean over seeds and worst
    seed, and the target; ``effects``, ``plants`` and ``confusion`` look closer at the cases with one effect.
    """
    out = Path(out)
    cases = _judge_all(out)
    tables = {
        "cases": cases,
        "cells": pd.DataFrame(_cells(cases, out)),
        "effects": _breakdown(cases, "effects"),
        "plants": _breakdown(cases, "plant"),
        "confusion": _confusion(cases),
    }
    folder = out / "score"
    folder.mkdir(exist_ok=True)
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=name == "confusion")
    return tables


def clearly_missed(cells: pd.DataFrame) -> pd.DataFrame:
    """Return the rows whose exact 99.8 % bounds lie wholly on the wrong side of the target."""
    missed = []
    for row in cells.itertuples():
        if np.isnan(row.low):
            continue
        low, high = clopper_pearson(round(row.value * row.n), row.n, CLEAR)
        if (high < row.target) if row.at_least else (low > row.target):
            missed.append(row.Index)
    return cells.loc[missed]


def _judge_all(out):
    manifest, verdicts = read_json(out / "manifest.json"), load_verdicts(out)
    rows = []
    for name, seals in manifest["cases"].items():
        if name not in verdicts:
            continue
        for file, digest in seals.items():
            if sha256(out / "truth" / file) != digest:
                raise ValueError(
                    f"truth/{file} is not the one sealed in manifest.json. Make the cases again."
                )
        truth = read_json(out / "truth" / f"{name}.json")
        recording = pd.read_csv(out / "cases" / name / "recording.csv")
        runs_file = out / "verdicts" / f"{name}.npz"
        runs = np.load(runs_file) if runs_file.exists() else {}
        with np.load(out / "truth" / f"{name}.npz") as arrays:
            rows.append(judge(truth, verdicts[name], arrays, runs, recording))
    if not rows:
        raise ValueError(f"{out} has no case with a verdict. Run make, then diagnose.")
    return pd.DataFrame(rows)


def _cells(cases, out):
    rows = []
    for target in TARGETS:
        part = cases[cases["cell"] == target.cell]
        if target.measure not in part:
            continue
        if target.stratum == "":
            groups = list(part.groupby("stratum"))
        elif target.stratum == "*":
            groups = [("all", part)]
        else:
            groups = [(target.stratum, part[part["stratum"] == target.stratum])]
        rows += [_row(target, stratum, group) for stratum, group in groups]
    rows += _coverage(cases) + _loss(cases) + _ports(cases) + _fit(cases) + _experiments(cases, out)
    rows += _calibration(cases)
    return [row for row in rows if row is not None]


def _row(target: Target, stratum, group, values=None):
    values = group[target.measure].dropna() if values is None else values
    if values.empty:
        return None
    row = {
        "cell": target.cell,
        "stratum": stratum,
        "measure": target.measure,
        "n": len(values),
        "value": float(values.mean()),
        "low": np.nan,
        "high": np.nan,
        "target": target.value,
        "at_least": target.at_least,
    }
    if target.proportion:
        row["low"], row["high"] = clopper_pearson(int(values.sum()), len(values))
    by_seed = values.groupby(group.loc[values.index, "seed"]).mean()
    row["seed_mean"] = float(by_seed.mean())
    row["worst_seed"] = float(by_seed.min() if target.at_least else by_seed.max())
    row["met"] = bool(row["value"] >= target.value if target.at_least else row["value"] <= target.value)
    clear = group["oracle_z"].dropna()
    row["oracle_sees"] = float((clear > ORACLE_CLEAR).mean()) if len(clear) else np.nan
    return row


def _plain(cell, stratum, measure, n, value, target, at_least=True, met=None):
    met = met if met is not None else (value >= target if at_least else value <= target)
    return {
        "cell": cell,
        "stratum": stratum,
        "measure": measure,
        "n": n,
        "value": value,
        "low": np.nan,
        "high": np.nan,
        "target": target,
        "at_least": at_least,
        "met": bool(met),
    }


def _coverage(cases):
    part = cases[(cases["cell"] == "T1")]
    part = part[part["n_intervals"] > 0] if "n_intervals" in part else part[:0]
    if part.empty:
        return []
    value = float(np.average(part["covered"], weights=part["n_intervals"]))
    met = COVERAGE[0] <= value <= COVERAGE[1]
    return [
        _plain("T1", "all", "coverage of 90 % intervals", int(part["n_intervals"].sum()), value, 0.9, met=met)
    ]


def _loss(cases):
    """T7 against the same effects and depth in T2."""
    if "first_right" not in cases:
        return []
    easy = cases[(cases["cell"] == "T2") & (cases["stratum"] == "R>=0.3")]
    rows = []
    for stratum, hard in cases[cases["cell"] == "T7"].groupby("stratum"):
        same = easy[easy["effects"].isin(hard["effects"])]
        if len(same):
            loss = float(same["first_right"].mean() - hard["first_right"].mean())
            rows.append(
                _plain("T7", stratum, "loss against T2", len(hard), loss, LOSS_TARGET, at_least=False)
            )
    return rows


def _ports(cases):
    if "port_right" not in cases:
        return []
    part = cases[cases["cell"].isin(["T2", "T6"])]
    return [_row(Target("T10", "*", "port_right", True, 0.95), "T2 and T6", part)]


def _fit(cases):
    """T11: the gap from nominal to oracle that was closed, and harm where nothing was missing."""
    rows = []
    for session in ("other", "amplitude"):
        for measure in (f"gap_{session}", f"structural_gap_{session}"):
            values = cases.loc[cases["cell"] == "T2", measure].dropna() if measure in cases else pd.Series()
            if len(values):
                rows.append(_plain("T11", "median", measure, len(values), float(values.median()), GAP_TARGET))
        harm = f"harm_{session}"
        if harm in cases:
            nulls = cases[cases["cell"] == "T0"]
            rows.append(_row(Target("T11", "T0", harm, False, HARM_TARGET), "T0", nulls))
    return rows


def _experiments(cases, out):
    """T9: undecided cases after the proposed experiment, and after a random one."""
    verdicts = load_verdicts(out)
    asked = [n for n in cases.loc[cases["cell"].isin(["T8", "T9"]), "case"] if f"{n}-next" in verdicts]
    if not asked:
        return []
    resolved = {}
    for suffix in ("next", "random"):
        hits = []
        for name in asked:
            truth = read_json(out / "truth" / f"{name}.json")
            named, _ = names_of(verdicts[f"{name}-{suffix}"])
            single = verdicts[f"{name}-{suffix}"]["verdict"] == "explained"
            hits.append(single and set(named) == {e["effect"] for e in truth["effects"]})
        resolved[suffix] = float(np.mean(hits))
    better = resolved["next"] - resolved["random"]
    return [
        _plain("T9", "all", "resolved", len(asked), resolved["next"], EXPERIMENT_TARGETS[0]),
        _plain("T9", "all", "better than random", len(asked), better, EXPERIMENT_TARGETS[1]),
    ]


def _calibration(cases):
    """Return the rows of T12: the confidence in the first name, where one was given.

    Beside its error stands that of a right confidence in as many cases.
    """
    part = cases.dropna(subset=["confidence"])
    part = part[part["verdict"].isin(["explained", "ambiguous"])]
    part = part[part["first_right"].notna()] if "first_right" in part else part[:0]
    if len(part) < CALIBRATION_CASES:
        return []
    error = expected_calibration_error(part["confidence"], part["first_right"])
    right = error_of_right_confidence(part["confidence"])
    return [
        _plain("T12", "all", "calibration error", len(part), error, CALIBRATION_TARGET, at_least=False),
        _plain("T12", "all", "of a right confidence", len(part), right, np.nan, met=True),
    ]


def _breakdown(cases, by):
    """Return how often effects of R >= 0.3 were named first, and wrongly, per effect or plant."""
    part = cases[(cases["cell"] == "T2") & (cases["stratum"] == "R>=0.3")]
    if part.empty:
        return pd.DataFrame(columns=[by, "n", "first_right", "wrong_name"])
    table = part.groupby(by)[["first_right", "wrong_name"]].mean()
    table.insert(0, "n", part.groupby(by).size())
    bounds = [clopper_pearson(round(r.first_right * r.n), int(r.n)) for r in table.itertuples()]
    table["low"], table["high"] = zip(*bounds, strict=True)
    return table.reset_index()


def _confusion(cases):
    """Return the table of what was concealed (rows) against what was said first (columns), cell T2."""
    part = cases[cases["cell"] == "T2"]
    return pd.crosstab(part["effects"], part["named"].str.split("+").str[0])

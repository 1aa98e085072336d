"""One verdict against one truth: what was right, as numbers between 0 and 1 (None: does not apply)."""

import re

import numpy as np

__all__ = ["judge", "names_of", "rule_mask"]

RIGHT_ON_NOISE = {  # what may be named when nothing is concealed but the noise itself
    "drifting": {"additive_drift", "sensor_bias"},
    "quantised": {"quantisation"},
}
ALARMS = ("explained", "ambiguous", "unknown")
NUMBER = r"[-+.\deE]+"
HARM = 0.01  # relative growth of the held-out error that counts as harm


def names_of(verdict: dict) -> tuple[list[str], set[str]]:
    """Return the effects named, and all that the verdict leaves possible (look-alikes included)."""
    if verdict["verdict"] not in ("explained", "ambiguous"):
        return [], set()
    named = [f["effect"] for f in verdict["findings"]]
    possible = set(named).union(*(f["lookalikes"] for f in verdict["findings"]))
    return named, possible if verdict["verdict"] == "ambiguous" else set(named)


def judge(truth: dict, verdict: dict, arrays, runs, recording) -> dict:
    """Return the measures of one case.

    Parameters
    ----------
    truth, verdict : dict
        As read from their files.
    arrays, runs : mapping
        Arrays of the truth and the diagnosis's held-out runs (empty when it failed).
    recording : DataFrame
        The training recording, whose columns a region's rule may name.
    """
    true = [e["effect"] for e in truth["effects"]]
    catalogued = [name for name in true if truth["cell"] != "T6"]
    named, possible = names_of(verdict)
    row = {
        "case": truth["case"],
        "cell": truth["cell"],
        "stratum": truth["stratum"],
        "plant": truth["plant"],
        "noise": truth["noise"],
        "seed": truth["seed"][0],
        "effects": "+".join(true) or "nothing",
        "R": truth["effects"][-1]["R"] if truth["effects"] else 0.0,
        "verdict": verdict["verdict"],
        "named": "+".join(named) or verdict["verdict"],
        "seconds": verdict["seconds"],
        "failed": float(verdict["verdict"] == "error"),
        "oracle_z": _oracle_z(truth),
        "confidence": _confidence(verdict),
    }
    if not true:
        row |= _judge_null(truth, verdict, named)
    else:
        row |= _judge_names(true, catalogued, verdict, named, possible)
        row |= _judge_place(truth, verdict, arrays, recording)
    return row | _judge_fit(truth, runs, arrays)


def _oracle_z(truth):
    """Return how clearly the truth stands out of the noise: in its colour, where there is one effect only."""
    scores = truth["oracle"]["z_scores"]
    return truth["oracle"]["z_in_colour"] if len(scores) == 1 else min(scores, default=None)


def _judge_null(truth, verdict, named):
    excused = set(named) <= RIGHT_ON_NOISE.get(truth["noise"], set()) and bool(named)
    excused = excused and all(f["port"].startswith("output") for f in verdict["findings"])
    told = verdict.get("parameters", {})  # by names, those of the truth with their units
    true = {label.split(" [")[0]: value for label, value in truth["parameters"].items()}
    covered = [low <= true[name] <= high for name, (_, low, high) in told.items()]
    return {
        "false_alarm": float((verdict["verdict"] in ALARMS and not excused) or verdict["verdict"] == "error"),
        "says_refit": float(verdict["verdict"] == "refit"),
        "covered": float(np.mean(covered)) if covered else None,
        "n_intervals": len(covered),
    }


def _judge_names(true, catalogued, verdict, named, possible):
    said = verdict["verdict"]
    hit = len(set(named) & set(true))
    return {
        "first_right": float(bool(named) and named[0] in catalogued),
        "wrong_name": float(bool(named) and not possible & set(catalogued)),
        "abstains": float(not named),
        "exact_set": float(set(named) == set(true)),
        "set_f1": 2.0 * hit / (len(set(named)) + len(set(true))),
        "unknown": float(said == "unknown"),
        "forced_name": float(bool(named) and not catalogued),
        "set_holds": float(set(true) <= possible),
        "set_size": float(len(possible)) if possible else None,
        "resolved": float(said == "explained" and set(named) == set(true)),
    }


def _judge_place(truth, verdict, arrays, recording):
    port = _said_port(verdict)
    ports = {e["port"] for e in truth["effects"]}
    right = None if verdict["verdict"] in ("consistent", "refit") else float(port in ports)
    place = {"port_right": right, "unknown_at_port": float(verdict["verdict"] == "unknown" and port in ports)}
    if "active_0" in arrays:
        place["region_f1"] = _f1(_region(verdict, arrays, recording), arrays["active_0"])
    start, stop = truth["effects"][0]["segment"]
    if truth["stratum"] == "time":
        found = np.zeros(truth["n_samples"], dtype=bool)
        for row in verdict.get("segments", []):
            found[int(row["start"]) : int(row["stop"])] = True
        real = np.zeros_like(found)
        real[start:stop] = True
        place["time_iou"] = float(np.sum(found & real) / np.sum(found | real))
    return place


def _said_port(verdict):
    if verdict.get("findings"):
        return verdict["findings"][0]["port"]
    table = verdict.get("ports") or [{}]
    first = table[0]
    return f"{first['kind']}:{first['index']}" if "kind" in first else first.get("port")


def _region(verdict, arrays, recording):
    """Return the samples that meet any rule on what acts first, among those that can be read."""
    rows = verdict.get("regions") or []
    rules = [r.get("rule", "") for r in rows if r.get("effect", "") == rows[0].get("effect", "")]
    masks = [rule_mask(rule, _signals(arrays, recording)) for rule in rules]
    found = np.zeros(arrays["active_0"].shape, dtype=bool)
    for mask in masks:
        found |= False if mask is None else mask
    return found


def _signals(arrays, recording):
    """Return what a rule may name: the recorded columns, with measured states as they truly were."""
    return {name: recording[name].to_numpy() for name in recording.columns if name != "session"} | {
        str(name): column for name, column in zip(arrays["state_names"], arrays["states"].T, strict=True)
    }


def rule_mask(rule: str, signals: dict) -> np.ndarray | None:
    """Return the samples a rule such as ``"position [m] > 0.1 and 1 < |velocity [m/s]| <= 2"`` speaks of.

    None when the rule names a signal that is not there.
    """
    mask = None
    for part in re.split(r"\s+and\s+", rule):
        match = re.fullmatch(rf"\s*(?:({NUMBER})\s*<\s*)?(.+?)\s*(<=|>=|<|>|≤|≥)\s*({NUMBER})\s*", part)
        if match is None:
            return None
        low, name, relation, number = match.groups()
        absolute = name.startswith("|") and name.endswith("|")
        signal = signals.get(name.strip("|"))
        if signal is None:
            return None
        signal = np.abs(signal) if absolute else signal
        holds = signal > float(number) if relation in (">", ">=", "≥") else signal <= float(number)
        if low is not None:
            holds &= signal > float(low)
        mask = holds if mask is None else mask & holds
    return mask


def _f1(found, real):
    real = np.asarray(real, dtype=bool)
    return float(2.0 * np.sum(found & real) / max(np.sum(found) + np.sum(real), 1))


def _confidence(verdict):
    if verdict.get("confidence") is not None:
        return verdict["confidence"]
    findings = verdict.get("findings") or [{}]
    return findings[0].get("confidence")


def _judge_fit(truth, runs, arrays):
    """Compare held-out free runs: the nominal's, the corrected one's, the oracle's."""
    row = {}
    for session in ("other", "amplitude"):
        clean = arrays[f"{session}_clean"]
        if f"{session}_corrected" not in runs:
            continue
        scale = np.std(clean, axis=0)
        error = {
            "nominal": _error(runs[f"{session}_nominal"], clean, scale),
            "corrected": _error(runs[f"{session}_corrected"], clean, scale),
            "refitted": _relative(truth["refit_errors"][session], scale),
            "oracle": _relative(truth["oracle"]["errors"][session], scale),
        }
        row |= {f"{name}_{session}": value for name, value in error.items()}
        row[f"gap_{session}"] = _share(error["nominal"], error["corrected"], error["oracle"])
        row[f"structural_gap_{session}"] = _share(error["refitted"], error["corrected"], error["oracle"])
        if not truth["effects"]:
            row[f"harm_{session}"] = float(error["corrected"] > error["nominal"] * (1.0 + HARM))
    return row


def _error(run, clean, scale):
    error = np.sqrt(np.mean(((run - clean) / scale) ** 2))
    return float(error) if np.isfinite(error) else None


def _relative(errors, scale):
    error = np.sqrt(np.mean((np.array(errors) / scale) ** 2))
    return float(error) if np.isfinite(error) else None


def _share(before, after, best):
    """Return the share of the way from `before` to `best` that was gone; a failed run went none of it."""
    if before is None or best is None or before <= best * 1.05:
        return None
    return 0.0 if after is None else float(np.clip((before - after) / (before - best), -1.0, 1.0))

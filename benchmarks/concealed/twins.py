"""Could anybody tell? How far truths are from their rivals for an oracle that knows the forms of both."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import joblib
import numpy as np
import pandas as pd
from scipy.stats import norm, qmc

from benchmarks.concealed.diagnose import load_verdicts
from benchmarks.concealed.experiment import rig_of
from benchmarks.concealed.hidden import Rig, measure_scales
from benchmarks.concealed.judge import names_of
from benchmarks.concealed.noise import whitened
from benchmarks.concealed.plants.codes import CATALOGUE, Code, Kind
from benchmarks.concealed.plants.dispatch import MACHINES
from benchmarks.concealed.plants.machine import Machine, Site
from benchmarks.concealed.plants.shapes import shape
from benchmarks.concealed.sealing import read_json

__all__ = ["chance_of_truth", "could_be_told", "nearest_twin"]

STRENGTHS = np.geomspace(3e-3, 10.0, 7)  # of a rival, to begin with
N_DRAWS = 2  # of its other numbers
N_FITTED = 2  # starts that are fitted
N_STEPS = 8
STEP = 1e-3  # of the logarithms of constants and numbers
REACH = 0.5  # largest change of one of them in one step
SETTLED = 1e-4  # share of the cost below which a step changes nothing
RANK = 1e-5
CELLS = ("T2", "T3", "T6", "T7", "T8")  # of one effect
SEES = 5.0  # standard errors that the best of some hundred hypotheses needs


def could_be_told(out: Path, n_jobs: int = 1) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return, and write below ``out/score``, how far truths are from their rivals, and what an oracle gets.

    A rival of a truth is what a verdict names in its place or beside it. The first table has a row a rival:
    ``distance``, in standard errors of the noise in its colour, between the truth and the rival's *hidden*
    form with all its numbers and the machine's constants refitted, and ``chance``, with which an oracle that
    knows both forms chooses the truth. The second has a row for each stratum and noise: how often the truth
    was named first (or, of an effect that no catalogue has, *unknown* was said), and how often that oracle
    would name it. It does not see what is less than five standard errors large, and has to choose between the
    truth and its hardest rival only. Of a verdict with two names it has none.
    """
    out = Path(out)
    verdicts = load_verdicts(out)
    names = [name for name in read_json(out / "manifest.json")["cases"] if name in verdicts]
    truths = {name: read_json(out / "truth" / f"{name}.json") for name in names}
    single = {name: t for name, t in truths.items() if len(t["effects"]) == 1 and t["cell"] in CELLS}
    asked = [(name, rival) for name, truth in single.items() for rival in _rivals(truth, verdicts[name])]
    rows = joblib.Parallel(n_jobs=n_jobs)(
        joblib.delayed(_row)(out, single[name], rival) for name, rival in asked
    )
    rivals = pd.DataFrame(rows, columns=["case", "truth", "rival", "distance", "chance"])
    hardest = rivals.groupby("case")["chance"].min()
    cases = pd.DataFrame(
        {
            "stratum": "outside" if truth["cell"] == "T6" else truth["stratum"],
            "noise": truth["noise"],
            "right": _is_right(truth, verdicts[name]),
            "oracle_right": float(truth["oracle"]["z_in_colour"] > SEES) * hardest.get(name, 1.0),
        }
        for name, truth in single.items()
    )
    told = cases.groupby(["stratum", "noise"]).agg(
        n=("right", "size"), right=("right", "mean"), oracle_right=("oracle_right", "mean")
    )
    folder = out / "score"
    folder.mkdir(exist_ok=True)
    rivals.to_csv(folder / "rivals.csv", index=False)
    told.to_csv(folder / "could_be_told.csv")
    return rivals, told.reset_index()


def _is_right(truth: dict, verdict: dict) -> bool:
    if truth["cell"] == "T6":
        return verdict["verdict"] == "unknown"
    return names_of(verdict)[0][:1] == [truth["effects"][0]["effect"]]


def chance_of_truth(distance: float, n_more: int, n_samples: int) -> float:
    """Return the chance that the better one of two known hypotheses is the true one.

    Minus twice the logarithm of their likelihoods' ratio is normal about d^2 with a deviation of 2 d, and
    each number more of the rival costs the logarithm of the number of samples (Schwarz 1978).
    """
    ahead = distance**2 + n_more * np.log(n_samples)
    if not np.isfinite(distance):
        return 1.0
    return float(norm.cdf(ahead / (2 * distance))) if distance > 0 else float(0.5 * (1 + np.sign(ahead)))


def _rivals(truth: dict, verdict: dict) -> list[str]:
    """Return what a verdict on one effect has in the place of the truth or beside it."""
    named, possible = names_of(verdict)
    known = {code.name for code in CATALOGUE}
    return sorted((possible & known) - {truth["effects"][0]["effect"]}) if len(named) == 1 else []


def _row(out: Path, truth: dict, rival: str) -> dict:
    rig = rig_of(truth)
    recording = pd.read_csv(out / "cases" / truth["case"] / "recording.csv")
    u = recording[list(rig.machine.inputs)].to_numpy(dtype=float)
    with np.load(out / "truth" / f"{truth['case']}.npz") as arrays:
        clean = arrays["training_clean"]
    twin = nearest_twin(rig, u, clean, np.array(truth["noise_rms"]), Code[rival])
    ((effect, theta),) = rig.effects
    chance = chance_of_truth(twin.distance, twin.n_numbers - len(_numbers(theta)), clean.size)
    return {
        "case": truth["case"],
        "truth": effect.code.name,
        "rival": rival,
        "distance": twin.distance,
        "chance": chance,
    }


class Twin(NamedTuple):
    """A rival's hidden form, fitted to a hidden plant."""

    distance: float  # standard errors of the noise; infinite where the machine has no place for it
    n_numbers: int  # that were fitted, the machine's constants not counted


def nearest_twin(rig: Rig, u: np.ndarray, clean: np.ndarray, noise_rms: np.ndarray, code: Code) -> Twin:
    """Return the rival's hidden form that comes nearest to the output of a hidden plant.

    Parameters
    ----------
    rig : Rig
        The hidden plant with its effect.
    u, clean : ndarray of shape (n_samples, n_inputs), (n_samples, n_outputs)
        What went in, and what came out without noise.
    noise_rms : ndarray of shape (n_outputs,)
    code : Code
        The rival.
    """
    bare = replace(rig, closed_loop=False, sigma=np.zeros(1), noise="white", effects=())
    still = np.random.default_rng(0)
    without = bare.record(u, still)

    def residual(x: np.ndarray, effect, theta) -> np.ndarray:
        """Return what is left, as logarithms of constants and of the rival's numbers say."""
        n = len(bare.constants)
        constants = {k: v * np.exp(f) for (k, v), f in zip(bare.constants.items(), x[:n], strict=True)}
        changed = theta.copy()
        changed[_numbers(theta)] *= np.exp(x[n:])
        plant = replace(bare, constants=constants).with_effects([(effect, changed)])
        return whitened((clean - plant.record(u, still).clean) / noise_rms, rig.noise).ravel()

    starts = []
    (own, _), *_ = rig.effects
    for site in _sites(bare.machine, own.site, code):
        for draws in qmc.Halton(4, scramble=False).random(N_DRAWS + 1)[1:]:
            scales = measure_scales(bare, without, site, tuple(draws))
            for strength in STRENGTHS:
                theta = shape(code, strength, scales)
                start = replace(own, code=code, site=site), theta
                left = residual(np.zeros(len(bare.constants) + len(_numbers(theta))), *start)
                if np.all(np.isfinite(left)):
                    starts.append((float(left @ left), start))
    starts.sort(key=lambda entry: entry[0])
    found = [
        Twin(np.sqrt(_fitted(residual, len(bare.constants), *start)), len(_numbers(start[1])))
        for _, start in starts[:N_FITTED]
    ]
    return min(found, default=Twin(np.inf, 0))


def _sites(machine: Machine, own: Site, code: Code) -> list[Site]:
    """Return where a rival may act: where the machine has it, or in the truth's place at a signal."""
    known = {site.kind for other in MACHINES.values() for site in other.sites.get(code, ())}
    here = [own] if own.kind in known and own.kind != Kind.state else []
    return list(dict.fromkeys([*machine.sites.get(code, ()), *here]))


def _numbers(theta: np.ndarray) -> np.ndarray:
    """Return which of an effect's numbers are fitted: all it has but the working point of the input."""
    return np.flatnonzero(theta[:-1])


def _fitted(residual, n_constants: int, effect, theta) -> float:
    """Return the least sum of squares by Gauss-Newton steps."""
    n = n_constants + len(_numbers(theta))
    x = np.zeros(n)
    left = residual(x, effect, theta)
    for _ in range(N_STEPS):
        steps = STEP * np.eye(n)
        A = np.column_stack([(residual(x + h, effect, theta) - left) / STEP for h in steps])
        if not np.all(np.isfinite(A)):
            break
        size = np.maximum(np.linalg.norm(A, axis=0), 1e-12)
        move = np.clip(-np.linalg.lstsq(A / size, left, rcond=RANK)[0] / size, -REACH, REACH)
        before = left @ left
        for share in (1.0, 0.5, 0.25, 0.1):
            trial = residual(x + share * move, effect, theta)
            if trial @ trial < before:
                x, left = x + share * move, trial
                break
        if left @ left > (1.0 - SETTLED) * before:
            break
    return float(left @ left)

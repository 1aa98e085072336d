"""Run the proposed experiment on the hidden plant, and beside it a random input of equal energy (cell T9)."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.concealed.excitation import excite
from benchmarks.concealed.hidden import Rig
from benchmarks.concealed.make import write_recording
from benchmarks.concealed.plants.codes import Code, Kind
from benchmarks.concealed.plants.dispatch import MACHINES
from benchmarks.concealed.plants.machine import Site
from benchmarks.concealed.sealing import read_json
from benchmarks.concealed.specs import Concealed

__all__ = ["perform", "rig_of"]

LARGEST = 1e6  # gain over the limit: the signal then jumps from one to the other
BISECTIONS = 60


def rig_of(truth: dict) -> Rig:
    """Set the hidden plant of a truth up again."""
    machine = MACHINES[truth["plant"]]
    effects = []
    for row in truth["effects"]:
        kind, *rest = row["site"]
        start, stop = (edge / truth["n_samples"] for edge in row["segment"])
        site = Site(Kind(kind), *rest)
        # what lasted to the end of the recording goes on in the next one
        concealed = Concealed(
            Code[row["effect"]], site, row["wanted_R"], start, stop if stop < 1.0 else np.inf
        )
        effects.append((concealed, np.array(row["theta"])))
    return Rig(
        machine,
        truth["constants"],
        truth["closed_loop"],
        truth["noise"],
        np.array(truth["sigma"]),
        tuple(effects),
        truth["n_samples"] * machine.dt,
    )


def perform(out: Path, verdicts: dict[str, dict]) -> list[str]:
    """Record what each undecided case asked for; return the names of the new cases.

    Below ``out/experiments`` a case ``name-next`` holds the first recording and the proposed one, and
    ``name-random`` the first recording and one with a random input of the same energy.
    """
    out, made = Path(out), []
    for name, verdict in verdicts.items():
        if not verdict.get("next_input"):
            continue
        truth = read_json(out / "truth" / f"{name}.json")
        rig = replace(rig_of(truth), closed_loop=False)  # the input itself was asked for
        rng = np.random.default_rng([*truth["seed"], 9])
        proposed = np.array(verdict["next_input"])
        for suffix, command in (("next", proposed), ("random", _random_like(proposed, rig, rng))):
            folder = out / "experiments" / f"{name}-{suffix}"
            write_recording(out / "cases" / name, folder, rig.machine, rig.record(command, rng))
            made.append(folder.name)
    return made


def _random_like(proposed, rig, rng):
    """Return a random input with the mean, the energy and the limits of the proposed one, in every column.

    Normal noise in the band of the machine, cut off at the limits; a gain gives back the energy that takes.
    """
    m = rig.machine
    random = np.empty_like(proposed)
    for j, column in enumerate(proposed.T):
        signal = excite("prfs", len(column), m.dt, m.band, rng)
        limit, energy = np.abs(column - column.mean()).max(), column.std()
        low, high = 0.0, 1.0
        while np.clip(high * signal, -limit, limit).std() < energy and high < LARGEST * limit:
            high *= 2.0
        for _ in range(BISECTIONS):
            gain = (low + high) / 2
            low, high = (gain, high) if np.clip(gain * signal, -limit, limit).std() < energy else (low, gain)
        random[:, j] = column.mean() + np.clip(high * signal, -limit, limit)
    return random

"""Where the mismatch is, gathered for a fitted diagnosis."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from narx_sklearn.discrepancy.diagnosis import Diagnosis
from narx_sklearn.discrepancy.locate import (
    bands,
    concentrated_force,
    features,
    latent_forces,
    port_table,
    ports_of,
    regions,
    segments,
    tangent,
)
from narx_sklearn.discrepancy.simulator import Windows

LONGEST = 100_000  # samples looked at; the windows in the middle of a longer record stand for it


class Location(NamedTuple):
    """Where a refitted simulation and a recording part.

    Attributes
    ----------
    ports : DataFrame
        Ports by how well an unknown signal there explains the residual.
    segments : DataFrame
        Stretches of time that hold more of the error than chance.
    regions : DataFrame
        Readable rules, each with its share of the unknown force's energy and of the time.
    bands : DataFrame
        Frequencies at which the residual stands above the noise.
    force : DataFrame
        The unknown signal at the likeliest port: ``sample``, ``force``, ``deviation``.
    """

    ports: pd.DataFrame
    segments: pd.DataFrame
    regions: pd.DataFrame
    bands: pd.DataFrame
    force: pd.DataFrame


def locate(diagnosis: Diagnosis, random_state=None) -> Location:
    """Locate the mismatch that is left after the simulator's own parameters were refitted."""
    problem, p = diagnosis.problem, diagnosis.refitted.model.p
    simulator = problem.simulator
    windows, x0 = _middle(problem.windows, diagnosis.refitted.model.x0)
    run = simulator.run(problem.u, windows, x0, p)
    allowed = [
        port
        for port in ports_of(simulator)
        if port.kind != "state" or not diagnosis.structure.kinematic[port.index]
    ]
    _, forces = latent_forces(simulator, run, problem.u, problem.y, windows, p, ports=allowed)
    table = port_table(forces, simulator, windows)
    best = next(
        f for f in forces if (f.port.kind, f.port.index) == (table.loc[0, "kind"], table.loc[0, "index"])
    )
    residual = problem.y - run.y
    inside = slice(int(windows.first[0]), int(windows.last[-1]))
    white = _innovations(problem, windows, residual)
    found_segments = segments(white[inside], simulator.dt, u=problem.u[inside], random_state=random_state)
    for column in ("start", "stop"):
        found_segments[column] = found_segments[column] + inside.start
    for column in ("start_s", "stop_s"):
        found_segments[column] = found_segments[column] + inside.start * simulator.dt
    corrected = run.x + best.dx
    signal = concentrated_force(best, tangent(simulator, run._replace(x=corrected), problem.u, windows, p))
    rules = regions(
        signal[inside],
        features(
            problem.u[inside],
            corrected[inside],
            simulator.dt,
            inputs=simulator.inputs,
            states=simulator.states,
        ),
        random_state=random_state,
    )
    spectrum = bands(residual[inside, 0], problem.y[inside, 0], simulator.dt)
    samples = np.arange(inside.start, inside.stop)
    force = pd.DataFrame({"sample": samples, "force": best.w[inside], "deviation": best.w_std[inside]})
    return Location(table, found_segments, rules, spectrum, force)


def _innovations(problem, windows: Windows, residual: np.ndarray) -> np.ndarray:
    """Return the whitened residual, (n_samples, n_outputs): its energy is even where there is only noise."""
    out = np.full(residual.shape, np.nan)
    for first, last in zip(windows.first, windows.last, strict=True):
        seen = np.isfinite(residual[first:last])
        piece = problem.noise.innovations(np.where(seen, residual[first:last], 0.0)[None])[0]
        piece[: problem.noise.order] = np.nan
        out[first:last] = np.where(seen, piece, np.nan)
    return out


def _middle(windows: Windows, x0: np.ndarray) -> tuple[Windows, np.ndarray]:
    """Return the windows, or as many in the middle of the record as can be looked at in reasonable memory."""
    lengths = windows.last - windows.first
    if lengths.sum() <= LONGEST:
        return windows, x0
    count = max(1, int(LONGEST // lengths.mean()))
    begin = (windows.count - count) // 2
    keep = slice(begin, begin + count)
    fresh = windows.fresh[keep].copy()
    fresh[0] = True
    return Windows(windows.first[keep], windows.last[keep], fresh, windows.began[keep]), x0[keep]

"""What a found effect does along the record, and what the data ask of it there."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from narx_sklearn.discrepancy.fitting.acting import (
    acts_along,
    correction_name,
    correction_unit,
    signal_change,
    state_forces,
)
from narx_sklearn.discrepancy.locate import force_curve, latent_force, tangent
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.report._runs import Material

MOST_POINTS = 2500  # of the cloud


class EffectCurve(NamedTuple):
    """An effect's correction against the signal it depends on.

    Attributes
    ----------
    argument, fitted : ndarray of shape (n_points,)
        The signal along the corrected run and what the effect adds there.
    at, needed : ndarray of shape (n_points,)
        The signal and what the data ask for there, found without the effect.
    table : DataFrame
        Medians of ``needed`` in bins of the argument, with 95 % intervals, and of ``fitted``.
    x_label, y_label : str
        Axes with units.
    """

    argument: np.ndarray
    fitted: np.ndarray
    at: np.ndarray
    needed: np.ndarray
    table: pd.DataFrame
    x_label: str
    y_label: str


def effect_curves(dx, material: Material) -> list[EffectCurve]:
    """Return one curve for each finding.

    What the data ask for is a latent force: the effect is taken out of the corrected simulation, the others
    stay, and the signal that must enter at its port in its place is estimated by a Kalman smoother, which
    knows nothing of the effect's form.
    """
    problem = dx.conclusion_.diagnosis.problem
    windows, rows = problem.windows, problem.rows[problem.inside]
    rows = rows[np.isfinite(material.after.x[rows]).all(axis=1)]
    thin = rows[_thinned(rows)]
    simulator = problem.simulator.with_parameters(material.p).with_effects(material.effects)
    forces = state_forces(simulator, material.after, material.u, windows, thin)
    return [
        _curve(simulator, material, index, windows, rows, thin, forces.get(index))
        for index in range(len(material.effects))
    ]


def _curve(simulator, material: Material, index: int, windows: Windows, rows, thin, force) -> EffectCurve:
    """Return the curve of one effect; ``force`` is its argument and force where it acts at a state."""
    placed = simulator.effects[index]
    acts = acts_along(placed, windows, rows, simulator.dt)
    others = simulator.with_effects([e for i, e in enumerate(simulator.effects) if i != index])
    run = others.run(material.u, windows, material.after.x[windows.first])
    residual = material.y - run.y
    if (
        placed.port.kind == "output"
    ):  # what is asked for is what is left; a smoother would call it coloured noise
        needed, sure = residual[:, placed.port.index], None
    else:
        latent = latent_force(tangent(others, run, material.u, windows), residual, windows, placed.port)
        needed, sure = latent.w, latent.w_std[rows]
    if placed.port.kind == "state":
        argument, fitted = (values[acts[_thinned(rows)]] for values in force)
        at = placed.argument_of(material.u[rows], (run.x + latent.dx)[rows])
        needed, sure = needed / placed.added(simulator.dt), sure / placed.added(simulator.dt)
    else:
        signal = placed.port.signals(material.u, run.y, material.p)
        at, fitted = signal_change(placed, signal, material.u, run.x, windows, rows, simulator.dt)
        argument, fitted = (values[_thinned(rows)][acts[_thinned(rows)]] for values in (at, fitted))
    rows, at, sure = rows[acts], at[acts], None if sure is None else sure[acts]
    table = force_curve(needed[rows], at, w_std=sure)
    table["fitted"] = _medians(fitted, argument, table["argument"].to_numpy())
    keep = np.isin(rows, thin)
    return EffectCurve(argument, fitted, at[keep], needed[rows][keep], table, *_labels(placed, simulator))


def _thinned(rows: np.ndarray) -> slice:
    """Return every how manyth sample goes into the cloud."""
    return slice(None, None, max(1, -(-rows.size // MOST_POINTS)))


def _medians(values: np.ndarray, argument: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Return the median of the values nearest to each centre."""
    if centres.size == 0:
        return centres
    nearest = np.abs(argument[:, None] - centres).argmin(axis=1)
    return np.array(
        [np.median(values[nearest == i]) if (nearest == i).any() else np.nan for i in range(centres.size)]
    )


def _labels(placed, simulator) -> tuple[str, str]:
    return _labelled(placed.argument_name, placed.argument_unit), _labelled(
        correction_name(placed, simulator), correction_unit(placed, simulator)
    )


def _labelled(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name

"""What a found effect does along the record, and what the data ask of it there."""

from typing import NamedTuple

import numpy as np
import pandas as pd

from narx_sklearn.discrepancy.kernels import MAX_MEMORY, MAX_THETA, compiled_force
from narx_sklearn.discrepancy.locate import force_curve, latent_force, tangent
from narx_sklearn.discrepancy.simulator import Windows
from narx_sklearn.discrepancy.windows import rates_of
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
    problem = dx._diagnosis.problem
    windows, rows = problem.windows, problem.rows[problem.inside]
    rows = rows[np.isfinite(material.after.x[rows]).all(axis=1)]
    thin = rows[:: max(1, -(-rows.size // MOST_POINTS))]
    simulator = problem.simulator.with_parameters(material.p).with_effects(material.effects)
    forces = _state_forces(simulator, material, windows, thin)
    return [
        _curve(simulator, material, index, windows, rows, thin, forces.get(index))
        for index in range(len(material.effects))
    ]


def _curve(simulator, material: Material, index: int, windows: Windows, rows, thin, force) -> EffectCurve:
    """Return the curve of one effect; ``force`` is its argument and force where it acts at a state."""
    placed = simulator.effects[index]
    others = simulator.with_effects([e for i, e in enumerate(simulator.effects) if i != index])
    run = others.run(material.u, windows, material.after.x[windows.first])
    linear = tangent(others, run, material.u, windows)
    latent = latent_force(linear, material.y - run.y, windows, placed.port)
    if placed.port.kind == "state":
        argument, fitted = force
        at = (run.x + latent.dx)[rows] @ np.array(placed.weights)
    else:
        signal = material.u if placed.port.kind == "input" else run.y
        at = signal[rows, placed.port.index]
        argument, fitted = _signal_change(placed, signal, material.u, windows, rows, simulator.dt)
        argument, fitted = (
            argument[:: max(1, -(-rows.size // MOST_POINTS))],
            fitted[:: max(1, -(-rows.size // MOST_POINTS))],
        )
    table = force_curve(latent.w[rows], at, w_std=latent.w_std[rows])
    table["fitted"] = _medians(fitted, argument, table["argument"].to_numpy())
    keep = np.isin(rows, thin)
    return EffectCurve(argument, fitted, at[keep], latent.w[rows][keep], table, *_labels(placed, simulator))


def _state_forces(simulator, material: Material, windows: Windows, rows: np.ndarray) -> dict:
    """Return (argument, force) for each effect at a state equation, in the order the kernel adds them."""
    acting = [(i, e) for i, e in enumerate(simulator.effects) if e.port.kind == "state"]
    run, u, dt = material.after, material.u, simulator.dt
    step = 1.0 if simulator.discrete else dt / simulator.substeps
    session = windows.began[np.maximum(np.searchsorted(windows.first, rows, side="right") - 1, 0)]
    arguments, values = np.zeros((2, len(acting), rows.size))
    functions = [compiled_force(placed.effect.force) for _, placed in acting]
    thetas = np.zeros((len(acting), MAX_THETA))
    for theta, (_, placed) in zip(thetas, acting, strict=True):
        n = len(placed.effect.parameters)
        theta[:n] = placed.theta[:n]
    for at, (k, began) in enumerate(zip(rows, session, strict=True)):
        x = run.x[k]
        nominal = rates_of(simulator, x, u[k])
        slope = nominal.copy()
        for e, (_, placed) in enumerate(acting):
            weights, port = np.array(placed.weights), placed.port.index
            rate = weights @ ((nominal - x) / dt if simulator.discrete else nominal)
            own = slope[port] - (x[port] if simulator.discrete else 0.0)
            z = run.z[k, e * MAX_MEMORY : (e + 1) * MAX_MEMORY].copy()
            other = u[k, placed.second] if placed.second >= 0 else 0.0
            time = (k - began) * dt
            arguments[e, at] = weights @ x
            values[e, at] = functions[e](
                arguments[e, at], rate, own, other, time, step, z, thetas[e], np.zeros(MAX_MEMORY)
            )
            slope[port] += values[e, at]
    return {i: (arguments[e], values[e]) for e, (i, _) in enumerate(acting)}


def _signal_change(placed, signals, u, windows: Windows, rows, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the signal at an input or output and what the effect adds to it."""
    signal = signals[rows, placed.port.index]
    second = u[rows, placed.second] if placed.second >= 0 else None
    begin = np.searchsorted(rows, windows.first[windows.fresh])
    return signal, placed.effect.transform(signal, second, dt, np.array(placed.theta), begin) - signal


def _medians(values: np.ndarray, argument: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Return the median of the values nearest to each centre."""
    if centres.size == 0:
        return centres
    nearest = np.abs(argument[:, None] - centres).argmin(axis=1)
    return np.array(
        [np.median(values[nearest == i]) if (nearest == i).any() else np.nan for i in range(centres.size)]
    )


def _labels(placed, simulator) -> tuple[str, str]:
    argument = (
        f"{placed.argument_name} [{placed.argument_unit}]" if placed.argument_unit else placed.argument_name
    )
    kind, index = placed.port
    signal = {"input": simulator.inputs, "state": simulator.states, "output": simulator.outputs}[kind][index]
    if kind != "state":
        return argument, f"added to {signal.name}" + (f" [{signal.unit}]" if signal.unit else "")
    unit = signal.unit if simulator.discrete else (f"{signal.unit}/s" if signal.unit else "1/s")
    return argument, f"added to the rate of {signal.name}" + (f" [{unit}]" if unit else "")

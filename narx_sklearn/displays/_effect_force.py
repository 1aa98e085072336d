"""What a fitted effect adds along a run, and what the recording asks of it there."""

from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.kernels import MAX_MEMORY, MAX_THETA, compiled_force
from narx_sklearn.discrepancy.locate import latent_force, tangent
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.problem import Model, Problem
from narx_sklearn.discrepancy.simulator import Run, Simulator
from narx_sklearn.discrepancy.windows import rates_of
from narx_sklearn.displays._style import signal_label


class EffectForce(NamedTuple):
    """An effect's correction at the samples of a run.

    Attributes
    ----------
    argument : ndarray of shape (n_points,)
        The signal that the effect depends on.
    fitted : ndarray of shape (n_points,)
        What the effect adds: to a state's rate, to an input or to an output.
    needed : ndarray of shape (n_points,)
        What the recording asks for: the same plus the force that the corrected run still lacks there.
    """

    argument: np.ndarray
    fitted: np.ndarray
    needed: np.ndarray


def effect_force(problem: Problem, model: Model, index: int, most_points: int) -> EffectForce:
    """Return what one effect of a fitted model adds, and what is asked for, at no more than ``most_points``.

    The partial residual of regression, with the residual carried back to the port by a Kalman smoother.
    """
    simulator = problem.simulator.with_parameters(model.p).with_effects(model.effects)
    placed, run = model.effects[index], problem.run(model)
    rows = problem.rows[problem.inside]
    rows = rows[np.isfinite(run.x[rows]).all(axis=1) & np.isfinite(run.y[rows]).all(axis=1)]
    if placed.port.kind == "state":
        rows = rows[:: -(-rows.size // most_points)]
        argument, fitted = _at_state(simulator, problem, run, index, rows)
    else:
        argument, fitted = _at_signal(simulator, problem, model, index, rows)
        thin = slice(None, None, -(-rows.size // most_points))
        rows, argument, fitted = rows[thin], argument[thin], fitted[thin]
    linear = tangent(simulator, run, problem.u, problem.windows)
    lacking = latent_force(linear, problem.y - run.y, problem.windows, placed.port)
    return EffectForce(argument, fitted, fitted + lacking.w[rows])


def labels(placed: PlacedEffect, simulator: Simulator) -> tuple[str, str]:
    """Return what goes on the axes: the argument, and what is added to what, with units."""
    argument = signal_label(placed.argument_name, placed.argument_unit)
    kind, index = placed.port
    signal = {"input": simulator.inputs, "state": simulator.states, "output": simulator.outputs}[kind][index]
    if kind == "state" and not simulator.discrete:
        unit = f"{signal.unit}/s" if signal.unit else "1/s"
        return argument, signal_label(f"added to the rate of {signal.name}", unit)
    return argument, signal_label(f"added to {signal.name}", signal.unit)


def _at_state(simulator: Simulator, problem: Problem, run: Run, index: int, rows: np.ndarray):
    """Return argument and force at a state equation, evaluated as the simulators' kernel does."""
    acting = [(i, placed) for i, placed in enumerate(simulator.effects) if placed.port.kind == "state"]
    place = [i for i, _ in acting].index(index)
    acting = acting[: place + 1]  # those before it add to what it finds at its port
    functions = [compiled_force(placed.effect.force) for _, placed in acting]
    thetas = np.zeros((len(acting), MAX_THETA))
    for theta, (_, placed) in zip(thetas, acting, strict=True):
        theta[: len(placed.effect.parameters)] = placed.theta[: len(placed.effect.parameters)]
    step = 1.0 if simulator.discrete else simulator.dt / simulator.substeps
    windows = problem.windows
    began = windows.began[np.searchsorted(windows.first, rows, side="right") - 1]
    argument, fitted, written = np.zeros(rows.size), np.zeros(rows.size), np.zeros(MAX_MEMORY)
    for at, k in enumerate(rows):
        x, now = run.x[k], problem.u[k]
        slope = rates_of(simulator, x, now)
        change = (slope - x) / simulator.dt if simulator.discrete else slope.copy()
        for e, (_, placed) in enumerate(acting):
            weights, port = np.array(placed.weights), placed.port.index
            argument[at] = weights @ x
            fitted[at] = functions[e](
                argument[at],
                weights @ change,
                slope[port] - (x[port] if simulator.discrete else 0.0),
                now[placed.second] if placed.second >= 0 else 0.0,
                (k - began[at]) * simulator.dt,
                step,
                run.z[k, e * MAX_MEMORY : (e + 1) * MAX_MEMORY].copy(),
                thetas[e],
                written,
            )
            slope[port] += fitted[at]
            if placed.onward >= 0:
                slope[placed.onward] -= placed.theta[-1] * fitted[at]
    return argument, fitted


def _at_signal(simulator: Simulator, problem: Problem, model: Model, index: int, rows: np.ndarray):
    """Return an input or output as the effect finds it, and what the effect adds."""
    placed = simulator.effects[index]
    before = model._replace(effects=tuple(e for i, e in enumerate(model.effects) if i != index))
    signals = problem.u if placed.port.kind == "input" else problem.run(before).y
    signal = signals[rows, placed.port.index]
    second = problem.u[rows, placed.second] if placed.second >= 0 else None
    windows = problem.windows
    first = np.searchsorted(rows, windows.first[windows.fresh])
    changed = placed.effect.transform(signal, second, simulator.dt, np.array(placed.theta), first)
    return signal, changed - signal

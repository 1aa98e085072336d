"""What a fitted effect adds along a run, and what the recording asks of it there."""

from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.fitting.acting import correction, correction_name, correction_unit
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.locate import latent_force, tangent
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.simulators.simulator import Simulator
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
    rows = problem.samples_of(run)
    rows, argument, fitted = correction(problem, model, run, index, rows, most_points)
    residual = problem.y - run.y
    if placed.port.kind == "output":  # what lacks is what is left; a smoother would call it coloured noise
        return EffectForce(argument, fitted, fitted + residual[rows, placed.port.index])
    linear = tangent(simulator, run, problem.u, problem.windows)
    lacking = latent_force(linear, residual, problem.windows, placed.port)
    return EffectForce(argument, fitted, fitted + lacking.w[rows] / placed.added(simulator.dt))


def labels(placed: PlacedEffect, simulator: Simulator) -> tuple[str, str]:
    """Return what goes on the axes: the argument, and what is added to what, with units."""
    argument = signal_label(placed.argument_name, placed.argument_unit)
    return argument, signal_label(correction_name(placed, simulator), correction_unit(placed, simulator))

"""First guesses: initial states of the windows, and the fit of the simulator as it stands."""

import numpy as np

from narx_sklearn.discrepancy.problem import Model, Problem
from narx_sklearn.discrepancy.refit import Fit, fit
from narx_sklearn.discrepancy.simulator import Simulator, Windows
from narx_sklearn.discrepancy.structure import Structure

ITERATIONS = 10


def guess_states(
    simulator: Simulator, u, y, windows: Windows, structure: Structure, x: np.ndarray
) -> np.ndarray:
    """Return initial states of the windows, (n_windows, n_states).

    Measured states come from the measurement, velocities of measured positions from its slope, the others
    from a run of the simulator as it stands (``x``), or zero where that run left the finite range.
    """
    x0 = np.where(np.isfinite(x[windows.first]), x[windows.first], 0.0)
    known = simulator.known_states(u, y, windows.first)
    given = np.isfinite(known)
    for velocity, position in enumerate(structure.partner):
        if position < 0 or not structure.kinematic[position]:
            continue
        if given[:, velocity].any() or not given[:, position].any():
            continue
        for w, (a, b) in enumerate(zip(windows.first, windows.last, strict=True)):
            samples = np.arange(a, min(a + 8, b))
            measured = simulator.known_states(u, y, samples)[:, position]
            good = np.isfinite(measured)
            if good.sum() >= 3:
                known[w, velocity] = np.polyfit(samples[good] * simulator.dt, measured[good], 1)[0]
    return np.where(np.isfinite(known), known, x0)


def fit_initial_states(problem: Problem, x0: np.ndarray) -> Fit:
    """Fit the initial states alone, the parameters as they are.

    A coarse sensor feels no small move of a state, so what effects do to the outputs comes second.
    """
    simulator = problem.simulator
    model = Model(simulator.nominal, simulator.effects, x0)
    smooth = tuple(effect for effect in simulator.effects if effect.port.kind != "output")
    if smooth != simulator.effects:
        model = model._replace(x0=_settled(problem, model._replace(effects=smooth)).model.x0)
    return _settled(problem, model)


def _settled(problem: Problem, model: Model) -> Fit:
    return fit(problem, model, free=np.zeros(model.q.size, dtype=bool), iterations=ITERATIONS)

"""What takes up the forces or flows of an equation, where that changes with a signal.

An inertia by position, a tank's cross-section by level, an inductance by current, a heat capacity by
temperature: the whole rate of the equation is divided by it, whatever drives it.
"""

from dataclasses import replace

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.search.hypotheses import Hypothesis, counted_from_means
from narx_sklearn.discrepancy.search.places import moving
from narx_sklearn.discrepancy.search.unnamed.kinds import STORED, STORED_BY_SQUARE, unnamed_law
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.physics.effects import EffectParameter

LEAST = 0.1  # of what was nominally taken up, while it is fitted: less would make a rate of any size


@njit(nogil=True, cache=True)
def _stored(argument, rate, own, second, time, step, z, theta, dz):
    """Return what is added to a rate that is divided by 1 + a (x - r)."""
    return own * (1.0 / max(1.0 + theta[0] * (argument - theta[1]), LEAST) - 1.0)


@njit(nogil=True, cache=True)
def _stored_by_square(argument, rate, own, second, time, step, z, theta, dz):
    """Return what is added to a rate that is divided by 1 + a (x - r)^2."""
    return own * (1.0 / max(1.0 + theta[0] * (argument - theta[1]) ** 2, LEAST) - 1.0)


def storage_hypotheses(simulator: Simulator, structure: Structure, x: np.ndarray) -> list[Hypothesis]:
    """Return a storage that changes with a signal, or with its square, for each state equation and signal.

    Signals are counted from the means of a run's states ``x`` (n, n_states) at first; what stands still there
    changes nothing.
    """
    forms = (
        (STORED, "f / (1 + a (x - r)) in the place of f, all that drives the equation", _stored, "1/({arg})"),
        (
            STORED_BY_SQUARE,
            "f / (1 + a (x - r)^2) in the place of f, all that drives the equation",
            _stored_by_square,
            "1/({arg})^2",
        ),
    )
    found = []
    for i in np.flatnonzero(~structure.kinematic).tolist():
        for argument in moving(i, simulator, structure):
            values = x @ np.array(argument.weights)
            if not np.ptp(values) > 0:
                continue
            for code, equation, force, unit in forms:
                law = unnamed_law(code, equation, ["a"], (EffectParameter("r", "{arg}"),), force, unit)
                law = replace(law, amplitude=0, references=(1,), last=True)
                n_inputs, size = len(simulator.inputs), 1.0 / np.ptp(values)
                found.append(counted_from_means(law, i, (argument,), x, n_inputs, size))
    return found

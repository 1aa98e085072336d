"""The regressors that a NARX model needs to hold the effects of a simulator."""

import numpy as np

from narx_sklearn.discrepancy.simulator import Simulator
from narx_sklearn.model.phi import Phi


def effect_regressors(simulator: Simulator) -> tuple[Phi, ...]:
    """Return the phi regressors of a simulator's effects, as functions of the signals u and y.

    An effect at an input is a function of that input; any other is written in the measured output, which
    stands for the state it acts on.
    """
    found: dict[str, Phi] = {}
    one_input, one_output = len(simulator.inputs) == 1, len(simulator.outputs) == 1
    for placed in simulator.effects:
        if placed.effect.phi is None:
            continue
        kind, index = placed.port
        signal = ("u" if one_input else f"u{index + 1}") if kind == "input" else None
        if signal is None:
            signal = "y" if one_output else f"y{(index if kind == 'output' else 0) + 1}"
        for phi in placed.effect.phi(np.array(placed.theta), signal, simulator.dt):
            found.setdefault(str(phi.name), phi)
    return tuple(found.values())

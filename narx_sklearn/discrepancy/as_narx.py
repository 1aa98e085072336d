"""A NARX model of a simulator: the regressors of its effects, how late its inputs show."""

import numpy as np

from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.simulators.simulator import Simulator, Windows
from narx_sklearn.identification import NARXRegressor
from narx_sklearn.model import NARXModel
from narx_sklearn.model.phi import Phi

LOOKED_AT = 16  # samples of a run


def identify_narx(simulator: Simulator, u: np.ndarray, **settings) -> NARXModel:
    """Identify a NARX model of a simulator from its own run, without what acts for a while only.

    Parameters
    ----------
    u : ndarray of shape (n_samples, n_inputs)
        Inputs that reach what the model is to know.
    **settings
        Parameters of :class:`NARXRegressor`, in the place of what the simulator tells.

    Raises
    ------
    ValueError
        If the simulation leaves the finite range on these inputs.
    """
    lasting = simulator.with_effects([e for e in simulator.effects if not e.passes])
    run = lasting.run(u, Windows.whole([slice(0, len(u))]), lasting.x0[None])
    lost = ~np.isfinite(run.y).all(axis=1)
    if lost.any():
        raise ValueError(
            "From rest the corrected simulation leaves the finite range at sample "
            f"{int(np.argmax(lost))} of {len(u)}, so a NARX model cannot be identified from it. Pass "
            "inputs under which it stays; an unstable simulator needs its controller in it, with the "
            "reference as its input."
        )
    order = max(2, len(lasting.states))
    delays = least_delays(lasting, run.x, u)
    known = {
        "output_lags": order,
        "input_lags": order,
        "degree": 3,
        "delay": delays if len(delays) > 1 else delays[0],
        "phi": effect_regressors(lasting),
        "max_terms": None,
    }
    y = run.y[:, 0] if run.y.shape[1] == 1 else run.y
    return NARXRegressor(**(known | settings)).fit(u, y).model_


def effect_regressors(simulator: Simulator) -> tuple[Phi, ...]:
    """Return the phi regressors of a simulator's effects, as functions of the signals u and y.

    An effect at an input is a function of that input; any other is written in the measured output, which
    stands for the state it acts on. What acts behind a state, on what others have of it, or in an output on a
    part of it, has none.
    """
    found: dict[str, Phi] = {}
    one_input, one_output = len(simulator.inputs) == 1, len(simulator.outputs) == 1
    for placed in simulator.effects:
        kind, index = placed.port
        if placed.effect.phi is None or placed.handed_on or not _reads_as_written(placed, simulator):
            continue
        if kind == "output" and placed.is_fed:
            continue
        signal = ("u" if one_input else f"u{index + 1}") if kind == "input" else None
        if signal is None:
            signal = "y" if one_output else f"y{(index if kind == 'output' else 0) + 1}"
        for phi in placed.effect.phi(placed.own_theta, signal, simulator.dt):
            found.setdefault(str(phi.name), phi)
    return tuple(found.values())


def _reads_as_written(placed: PlacedEffect, simulator: Simulator) -> bool:
    """Tell whether an effect reads its states in their own unit; not an angle in degrees in radians."""
    states = np.flatnonzero(placed.weights) if placed.effect.argument_units else ()
    return all(simulator.states[j].unit == placed.argument_unit for j in states)


def least_delays(simulator: Simulator, x: np.ndarray, u: np.ndarray) -> list[int]:
    """Return the delay of each input: 0 where the outputs show it within its sample, else 1.

    Parameters
    ----------
    x : ndarray of shape (n_samples, n_states)
        States of a run.
    u : ndarray of shape (n_samples, n_inputs)
        Its inputs.
    """
    first = np.unique(np.linspace(0, len(u) - 1, LOOKED_AT).astype(np.int64))
    windows = Windows(first, first + 1, np.ones(first.size, dtype=bool), np.zeros(first.size, dtype=np.int64))
    delays = []
    for j, spread in enumerate(np.std(u, axis=0)):
        moved = u.copy()
        moved[:, j] += spread if spread > 0 else 1.0
        before, after = (simulator.run(inputs, windows, x[first]).y[first] for inputs in (u, moved))
        delays.append(0 if (before != after).any() else 1)
    return delays

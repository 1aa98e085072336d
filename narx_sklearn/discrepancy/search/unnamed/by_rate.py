"""Laws of a reading by how fast it moves: what is added to it then, or what builds up in it.

A force that depends on a rate is tried in every state equation, where it builds up in the state. A sensor may
be off by its rate as well, and what counts turns or adds up a flow keeps what it missed.
"""

from dataclasses import replace

import numpy as np

from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.places import Argument, placed_at
from narx_sklearn.discrepancy.search.unnamed.broken_line import KNOTS, ends_of, knots_as_parameters
from narx_sklearn.discrepancy.search.unnamed.kinds import BUILDS_UP, BY_RATE, unnamed_law
from narx_sklearn.discrepancy.simulators.simulator import Simulator, Windows
from narx_sklearn.physics.effects._series import by_pieces

FORMS = (
    (BY_RATE, "s + f(ds/dt), f a broken line", "{port}"),
    (BUILDS_UP, "s + M, M' = f(ds/dt), f a broken line", "({port})/s"),
)


def _rate(values: np.ndarray, dt: float) -> np.ndarray:
    """Return how fast a piece of a signal moved since the sample before; its first stands still."""
    return np.diff(values, prepend=values[:1]) / dt


def _off_by_rate(values: np.ndarray, dt: float, theta: np.ndarray) -> np.ndarray:
    return values + np.interp(_rate(values, dt), theta[KNOTS : 2 * KNOTS], theta[:KNOTS])


def _built_up(values: np.ndarray, dt: float, theta: np.ndarray) -> np.ndarray:
    missed = dt * np.interp(_rate(values, dt), theta[KNOTS : 2 * KNOTS], theta[:KNOTS])
    return values + np.cumsum(missed)


def by_rate(signal, second, dt, theta, first):
    """Return a signal with a broken line of its rate added."""
    return by_pieces(_off_by_rate, signal, first, dt, np.asarray(theta))


def built_up(signal, second, dt, theta, first):
    """Return a signal with what builds up by a broken line of its rate added."""
    return by_pieces(_built_up, signal, first, dt, np.asarray(theta))


TRANSFORMS = {BY_RATE: by_rate, BUILDS_UP: built_up}


def placed_by_rate(simulator: Simulator, y: np.ndarray, windows: Windows) -> list[PlacedEffect]:
    """Return both laws of each output, nothing yet, knots over the rates of a run.

    Parameters
    ----------
    y : ndarray of shape (n_samples, n_outputs)
        Outputs of that run.
    """
    spans = [slice(a, b) for a, b in zip(windows.first, windows.last, strict=True)]
    found = []
    for i, signal in enumerate(simulator.outputs):
        rates = np.concatenate([np.diff(y[span, i]) for span in spans]) / simulator.dt
        rates = rates[np.isfinite(rates)]
        low, high = ends_of(rates) if rates.size else (0.0, 0.0)
        if not high > low:
            continue
        knots = np.linspace(low, high, KNOTS)
        fixed = tuple(knot._replace(unit="{arg}/s") for knot in knots_as_parameters(knots))
        for code, equation, unit in FORMS:
            law = unnamed_law(code, equation, [f"f{k + 1}" for k in range(KNOTS)], fixed, None, unit)
            law = replace(law, transform=TRANSFORMS[code], input_port=False)
            placed = placed_at(law, Port("output", i), Argument((), *signal))
            found.append(placed.at(np.r_[np.zeros(KNOTS), knots]))
    return found

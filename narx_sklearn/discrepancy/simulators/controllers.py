"""Controllers that are part of a simulator's equations: what they put out is a sum, and no signal of it."""

from typing import NamedTuple

import numpy as np

ALIKE = 1e-6  # relative difference below which a slope counts as the same


class Controller(NamedTuple):
    """A controller with an integral, whose output the equations have in terms of signals.

    Its output over the gain of the integral is ``x + T x'``, where x is the integral, an error x' is what is
    integrated, and T the integral time. A spring with a damper that a moving base pulls at is one of speed.
    """

    integral: int  # the state
    time: float  # T [s]
    output: tuple[float, ...]  # (n_inputs + n_states,) weights of inputs and states in that sum


def find_controllers(
    of_states: np.ndarray, of_inputs: np.ndarray, states: np.ndarray, inputs: np.ndarray
) -> tuple[Controller, ...]:
    """Find the states that integrate an error, which other equations have in the same sum as that state.

    The integral of what a reference and signals differ by, with constant weights, drives equations that the
    reference enters too. How much more of the error they have than of the integral is the integral time.

    Parameters
    ----------
    of_states : ndarray of shape (n_points, n_states, n_states)
        Slopes of the rates at some points of a run.
    of_inputs : ndarray of shape (n_points, n_states, n_inputs)
        The same for inputs.
    states, inputs : ndarray of bool, of shape (n_states, n_states) and (n_states, n_inputs)
        Which equation depends on what.
    """
    found = []
    for s in np.flatnonzero(inputs.any(axis=1) & states.any(axis=1) & ~np.diag(states)).tolist():
        error = np.column_stack([of_inputs[:, s], of_states[:, s]])
        if np.any(np.ptp(error, axis=0) > ALIKE * np.abs(error).max()):
            continue
        references = np.flatnonzero(inputs[s])
        driven = np.flatnonzero(states[:, s])
        with np.errstate(all="ignore"):
            times = of_inputs[:, driven][:, :, references] / (
                of_inputs[:, [s]][:, :, references] * of_states[:, driven, s][:, :, None]
            )
        if not (times.size and np.all(np.isfinite(times)) and times.min() > 0):
            continue
        if np.ptp(times) <= ALIKE * times.max():
            time = float(times.mean())
            output = time * error.mean(axis=0)
            output[inputs.shape[1] + s] += 1.0
            found.append(Controller(s, time, tuple(output.tolist())))
    return tuple(found)

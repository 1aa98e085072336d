"""A simulator near a point: derivatives of its equations, and states at which it rests."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.optimize import root

from narx_sklearn.discrepancy.simulators.simulator import Simulator, evaluate

STEP = 6e-6  # relative step of central differences: the cube root of the rounding unit
ROOM_FOR_ROUNDING = 1e-7  # of a rate's own summands, that a state counts as resting


class Linearisation(NamedTuple):
    """First derivatives of ``x' = f(x, u, p)`` (or ``x[k+1] = f``) and ``y = h(x, u, p)`` at one point."""

    A: np.ndarray  # (n_states, n_states) df/dx
    B: np.ndarray  # (n_states, n_inputs) df/du
    C: np.ndarray  # (n_outputs, n_states) dh/dx
    D: np.ndarray  # (n_outputs, n_inputs) dh/du


def central_differences(function, at: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return the derivatives of a function of one vector, shape (n_values, n_arguments)."""
    columns = []
    for j, step in enumerate(steps):
        ahead, behind = at.copy(), at.copy()
        ahead[j] += step
        behind[j] -= step
        with np.errstate(all="ignore"):  # beyond the finite range the derivatives are not finite either
            columns.append((function(ahead) - function(behind)) / (ahead[j] - behind[j]))
    return np.array(columns).T if columns else np.zeros((function(at).size, 0))


def steps(at: np.ndarray) -> np.ndarray:
    """Return the steps of central differences round a point."""
    return STEP * np.maximum(np.abs(at), 1.0)


def linearise(simulator: Simulator, x, u, p=None) -> Linearisation:
    """Return the derivatives of a simulator's equations, effects not counted, by central differences."""
    n = len(simulator.states)
    at = np.concatenate([np.asarray(x, dtype=float), np.asarray(u, dtype=float)])
    J = central_differences(lambda v: np.concatenate(evaluate(simulator, v[:n], v[n:], p)), at, steps(at))
    return Linearisation(J[:n, :n], J[:n, n:], J[n:, :n], J[n:, n:])


def steady_state(simulator: Simulator, u, p=None) -> np.ndarray:
    """Return states at which the simulator rests under constant inputs, effects not counted.

    Of the rests found from several starts, a stable one is preferred.

    Raises
    ------
    ValueError
        If none is found.
    """
    u = np.asarray(u, dtype=float)

    def balance(x):
        rates = evaluate(simulator, x, u, p)[0]
        return rates - x if simulator.discrete else rates

    found: list[tuple[bool, int, np.ndarray]] = []
    for start in _starts(simulator):
        with np.errstate(all="ignore"):
            solution = root(balance, start).x
            left = balance(solution)
        if np.all(np.isfinite(left)):
            A = linearise(simulator, solution, u, p).A
            summands = np.abs(A) @ np.abs(solution) + np.abs(balance(np.zeros_like(solution)))
            if np.all(np.abs(left) <= ROOM_FOR_ROUNDING * np.nan_to_num(summands) + 1e-12):
                found.append((not _is_stable(A, simulator.discrete), len(found), solution))
    if not found:
        raise ValueError(
            f"The simulator was not found to rest anywhere under the inputs {u.tolist()}: its equations have "
            "no zero there, as for an integrator that is driven. Pass inputs that balance it."
        )
    return min(found, key=lambda entry: entry[:2])[2] + 0.0


def _starts(simulator: Simulator) -> Iterator[np.ndarray]:
    """Yield points from which a rest is looked for."""
    n = len(simulator.states)
    yield simulator.x0
    for size in (1.0, -1.0, 100.0):
        yield np.full(n, size)


def _is_stable(A: np.ndarray, discrete: bool) -> bool:
    if not A.size:
        return True
    eigenvalues = np.linalg.eigvals(A)
    return bool(np.all(np.abs(eigenvalues) < 1) if discrete else np.all(eigenvalues.real < 0))

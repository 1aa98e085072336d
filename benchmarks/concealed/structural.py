"""How deep an effect is concealed: what the nominal simulator cannot follow with its numbers refitted."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from benchmarks.concealed.plants.dispatch import NUMBERS
from benchmarks.concealed.plants.integrate import UNFORCED, run_nominal

__all__ = ["Structural", "refit_nominal", "remainder", "window_length"]

N_WINDOW_TIMES = 5.0  # slowest time constants in a window
RANK = 1e-6  # combinations of parameters weaker than this are left alone
STEP = 1e-4  # relative step of the central differences


@dataclass(frozen=True)
class Structural:
    """The best the nominal simulator can do: `ratio` is its misfit over the noise, both root mean square."""

    ratio: float
    parameters: np.ndarray
    residual: np.ndarray  # (n_samples, n_outputs), in units of the noise
    starts: np.ndarray  # (n_windows, n_states), fitted initial states
    tangent: np.ndarray  # (n_samples, n_outputs, n_parameters), initial states not yet projected out
    start_tangent: np.ndarray  # (n_samples, n_outputs, n_states)
    length: int


def window_length(machine, n_samples: int) -> int:
    """Return the samples of one window: a few time constants, at least ten windows in the recording."""
    return int(min(max(N_WINDOW_TIMES * machine.slow / machine.dt, 60), n_samples // 10))


def _windows(n, length):
    edges = [*range(0, n - length // 2, length), n]
    return [slice(a, b) for a, b in pairwise(edges)]


def _project(columns, start_tangent, length):
    """Take the part that free initial states of the windows can make out of the columns (n, n_outputs, m)."""
    n, n_outputs, m = columns.shape
    out = np.empty_like(columns)
    for window in _windows(n, length):
        A = start_tangent[window].reshape(-1, start_tangent.shape[2])
        B = columns[window].reshape(-1, m)
        scale = np.linalg.norm(A, axis=0)
        U, singular, _ = np.linalg.svd(A / np.where(scale > 0.0, scale, 1.0), full_matrices=False)
        U = U[:, singular > 1e-9 * singular[0]]
        out[window] = (B - U @ (U.T @ B)).reshape(-1, n_outputs, m)
    return out


def remainder(columns, fit: Structural):
    """Return the columns (n, n_outputs, m) less what the nominal's states and parameters can make."""
    free = _project(columns, fit.start_tangent, fit.length)
    tangent = _project(fit.tangent, fit.start_tangent, fit.length)
    A = tangent.reshape(-1, tangent.shape[2])
    A = A / np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    B = free.reshape(-1, free.shape[2])
    return (B - A @ np.linalg.lstsq(A, B, rcond=RANK)[0]).reshape(free.shape)


def refit_nominal(machine, u, y, sigma, parameters, states, n_iterations=6) -> Structural:
    """Fit parameters and initial states of the windows to `y` by Gauss-Newton steps.

    Parameters
    ----------
    u, y : ndarray of shape (n_samples, n_inputs), (n_samples, n_outputs)
        What the nominal simulator is driven by, and should give.
    sigma : ndarray of shape (n_outputs,)
        Noise of each output, root mean square.
    parameters : ndarray
        Where to start: the true values.
    states : ndarray of shape (n_samples, n_states)
        Hidden states, which give the windows' first initial states.
    """
    plant, measured = NUMBERS[machine.name], list(machine.measured)
    n, length = len(u), window_length(machine, len(u))
    windows = _windows(n, length)
    p, starts = np.array(parameters, dtype=float), states[[w.start for w in windows]].copy()
    reach = np.maximum(np.std(states, axis=0), 1e-12)

    def run(p, starts):
        return run_nominal(plant, p, starts, u, length, machine.dt, UNFORCED)[:, measured] / sigma

    def linearise(p, starts):
        tangent = np.empty((n, len(measured), p.size))
        for j in range(p.size):
            step = np.zeros(p.size)
            step[j] = STEP * p[j]
            tangent[:, :, j] = (run(p + step, starts) - run(p - step, starts)) / (2.0 * STEP)
        start_tangent = np.empty((n, len(measured), starts.shape[1]))
        for j in range(starts.shape[1]):
            step = np.zeros(starts.shape[1])
            step[j] = STEP * reach[j]
            start_tangent[:, :, j] = (run(p, starts + step) - run(p, starts - step)) / (2.0 * STEP)
        return tangent, start_tangent

    def misfit(p, starts):
        residual = y / sigma - run(p, starts)
        return residual, float(np.sqrt(np.mean(residual**2)))

    residual, cost = misfit(p, starts)
    for _ in range(n_iterations):
        tangent, start_tangent = linearise(p, starts)
        move, shifts = _step(residual, tangent, start_tangent, windows, length)
        for share in (1.0, 0.5, 0.25, 0.1):
            trial = p * (1.0 + share * np.clip(move, -0.5, 0.5)), starts + share * reach * shifts
            new_residual, new_cost = misfit(*trial)
            if new_cost < cost:
                break
        else:
            break
        settled = new_cost > cost * (1.0 - 1e-3)
        (p, starts), residual, cost = trial, new_residual, new_cost
        if settled:
            break
    return Structural(cost, p, residual, starts, *linearise(p, starts), length)


def _step(residual, tangent, start_tangent, windows, length):
    """Return the relative change of the parameters and the change of the windows' initial states."""
    columns = np.concatenate([residual[:, :, None], tangent], axis=2)
    free = _project(columns, start_tangent, length)
    A = free[:, :, 1:].reshape(-1, tangent.shape[2])
    scale = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    move = np.linalg.lstsq(A / scale, free[:, :, 0].ravel(), rcond=RANK)[0] / scale
    left = residual - tangent @ move
    n_states = start_tangent.shape[2]
    shifts = [
        np.linalg.lstsq(start_tangent[w].reshape(-1, n_states), left[w].ravel(), rcond=1e-9)[0]
        for w in windows
    ]
    return move, np.array(shifts)

"""What somebody who knows the true form achieves on the same data: the hidden plant, refitted."""

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.concealed.plants.dispatch import NUMBERS
from benchmarks.concealed.plants.integrate import UNFORCED, run_nominal

__all__ = ["Oracle", "refit_error", "refit_truth"]

STEP = 1e-3
RANK = 1e-4  # combinations of factors weaker than this are left alone
N_STEPS = 2
REACH = 0.3  # largest change of a logarithm in one step


@dataclass(frozen=True)
class Oracle:
    """The refitted truth: held-out errors, and how clear the effects stand of the noise."""

    rig: object
    z_scores: tuple[float, ...]  # size of what only the effect can make over the noise, per effect
    errors: dict[str, list[float]]  # rms free-run error per held-out recording and output, without noise


def refit_truth(case) -> Oracle:
    """Fit constants and strengths of the true form to the noisy training recording by Gauss-Newton steps.

    The unknowns are factors on the constants and on the effects' first numbers. Factors that the recording
    cannot tell apart (mass against motor constant) share what they explain.
    """
    rig, training = case.rig, case.training
    open_rig = replace(rig, closed_loop=False, sigma=np.zeros(1), noise="white")
    sigma = np.sqrt(np.mean((training.y - training.clean) ** 2, axis=0))
    factors = np.zeros(len(rig.constants) + len(rig.effects))  # logarithms

    def play(factors, command):
        changed = _scaled(open_rig, factors)
        states = changed.record(command, np.random.default_rng(0))
        return states.clean

    for _ in range(N_STEPS):
        base = play(factors, training.u)
        A = np.empty((base.size, factors.size))
        for j in range(factors.size):
            step = STEP * (np.arange(factors.size) == j)
            change = play(factors + step, training.u) - play(factors - step, training.u)
            A[:, j] = (change / sigma / (2.0 * STEP)).ravel()
        b = ((training.y - base) / sigma).ravel()
        if not (np.all(np.isfinite(A)) and np.all(np.isfinite(b))):
            break
        scale = np.maximum(np.linalg.norm(A, axis=0), 1e-12)
        move = np.linalg.lstsq(A / scale, b, rcond=RANK)[0] / scale
        for share in (1.0, 0.5, 0.25, 0.1):
            trial = factors + share * np.clip(move, -REACH, REACH)
            if _cost(play(trial, training.u), training.y, sigma) < b @ b:
                factors = trial
                break
    return Oracle(
        _scaled(rig, factors),
        tuple(depth * np.sqrt(training.y.size) for depth in case.depths),
        {name: _errors(play(factors, held.u), held) for name, held in case.heldout.items()},
    )


def _cost(y, measured, sigma):
    cost = float(np.sum(((measured - y) / sigma) ** 2))
    return cost if np.isfinite(cost) else np.inf


def _scaled(rig, factors):
    names = list(rig.constants)
    constants = {k: v * np.exp(f) for (k, v), f in zip(rig.constants.items(), factors, strict=False)}
    effects = []
    for (effect, theta), f in zip(rig.effects, factors[len(names) :], strict=True):
        theta = theta.copy()
        theta[0] *= np.exp(f)
        effects.append((effect, theta))
    return replace(rig, constants=constants).with_effects(effects)


def refit_error(case, held) -> list[float]:
    """Return the held-out errors of the nominal simulator with the best parameters it can have."""
    machine = case.rig.machine
    states = run_nominal(
        NUMBERS[machine.name],
        case.fit.parameters,
        case.rig.rest()[None],
        held.u,
        len(held.u),
        machine.dt,
        UNFORCED,
    )
    return _errors(states[:, list(machine.measured)], held)


def _errors(y, held):
    return np.sqrt(np.mean((y - held.clean) ** 2, axis=0)).tolist()

"""Build a case: hidden plant, effects brought to their depth, recordings, and the truth to be sealed."""

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.concealed.excitation import RICH
from benchmarks.concealed.hidden import CONSTANT_SPREAD, Recording, Rig, measure_scales
from benchmarks.concealed.plants.dispatch import MACHINES
from benchmarks.concealed.plants.shapes import shape
from benchmarks.concealed.specs import Spec
from benchmarks.concealed.structural import Structural, refit_nominal, remainder

__all__ = ["Case", "UnreachableError", "build_case"]

NOISE_SHARE = (0.005, 0.03)  # noise over the swing of the reading, rms to rms
DEPTH_TOLERANCE = 0.05  # of the wanted structural residual
LARGEST_MISS = 0.1
FURTHER_SWING = 1.4  # the recording at another amplitude
LARGEST_CHANGE = 2.0  # of the reading's standard deviation by the effects
CLOSED_LOOP_NOISE = 0.3  # a machine in a loop has the better sensor
N_TRIES = 30


class UnreachableError(Exception):
    """The effect cannot be made as deep as wanted in this plant and recording."""


@dataclass(frozen=True)
class Case:
    """A case before it is written: what the diagnosis sees and what is sealed."""

    spec: Spec
    rig: Rig
    training: Recording
    heldout: dict[str, Recording]
    guess: dict[str, float]  # nominal parameters as the user believes them
    fit: Structural  # of the nominal simulator, to the training recording without noise
    strengths: tuple[float, ...]
    depths: tuple[float, ...]


def build_case(spec: Spec) -> Case:
    """Build the case of a recipe; raise UnreachableError when an effect cannot be brought to its depth."""
    rng = np.random.default_rng(spec.seed)
    machine = MACHINES[spec.plant]
    constants = {k: v * np.exp(rng.uniform(-1, 1) * CONSTANT_SPREAD) for k, v in machine.constants.items()}
    rig = Rig(machine, constants, spec.closed_loop, spec.noise, duration=spec.n_samples * machine.dt)
    command = rig.command(spec.excitation, spec.n_samples, rng)
    bare = rig.record(command, np.random.default_rng(0))
    share = np.exp(rng.uniform(*np.log(NOISE_SHARE)))
    share *= CLOSED_LOOP_NOISE if spec.closed_loop else 1.0
    rig = replace(rig, sigma=share * np.std(bare.clean, axis=0))
    draws = rng.random((len(spec.effects), 4))
    noise_seed = int(rng.integers(2**32))
    rig, strengths, depths, training, fit = _conceal(rig, spec, bare, command, draws, noise_seed)
    guess = _misjudge(rig.parameters, spec.mismatch, rng)
    heldout = _hold_out(rig, spec, rng)
    return Case(spec, rig, training, heldout, guess, fit, strengths, depths)


def _misjudge(parameters, mismatch, rng):
    small, large = mismatch
    wrong = {}
    for name, value in parameters.items():
        error = rng.uniform(small, large) * rng.choice([-1.0, 1.0])
        wrong[name] = float(f"{value * (1.0 + error):.4g}")
    return wrong


def _hold_out(rig, spec, rng):
    """Record two more inputs that no fit sees: the same amplitude, and a larger one."""
    n = spec.n_samples // 2
    kind = spec.excitation if spec.excitation in RICH else "multisine"
    return {
        "other": rig.record(rig.command(kind, n, rng), rng),
        "amplitude": rig.record(rig.command(kind, n, rng, swing=FURTHER_SWING), rng),
    }


def _misfit(rig, recording):
    """Refit the nominal simulator to what was read without noise; the noise is that of the record itself."""
    sigma = np.sqrt(np.mean((recording.y - recording.clean) ** 2, axis=0))
    return refit_nominal(
        rig.machine, recording.u, recording.clean, sigma, list(rig.parameters.values()), recording.states
    )


def _conceal(rig, spec, bare, command, draws, noise_seed):
    """Add the effects one after another, each brought to its depth beside those before it."""
    strengths, depths = [], []
    recording = rig.record(command, np.random.default_rng(noise_seed))
    for effect, draw in zip(spec.effects, draws, strict=True):
        scales = measure_scales(rig, bare, effect.site, tuple(draw))
        before, past = rig, recording

        def attempt(strength, before=before, past=past, effect=effect, scales=scales):
            theta = shape(effect.code, strength, scales)
            trial = before.with_effects((*before.effects, (effect, theta)))
            new = trial.record(command, np.random.default_rng(noise_seed))
            if not _same_machine(new, bare):
                return np.inf, trial, new
            if not before.effects:
                return _misfit(trial, new).ratio, trial, new
            return _added_depth(trial, new, past, before, command, noise_seed), trial, new

        strength, (depth, rig, recording) = _bring_to_depth(attempt, effect.depth, effect.code.name)
        strengths.append(strength)
        depths.append(depth)
    fit = _misfit(rig, recording)
    return rig, tuple(strengths), tuple(depths), recording, fit


def _same_machine(recording, bare):
    """Return whether the machine still moves about as much as without effects."""
    if not recording.finite:
        return False
    ratio = np.std(recording.clean, axis=0) / np.std(bare.clean, axis=0)
    return bool(np.all((ratio > 1.0 / LARGEST_CHANGE) & (ratio < LARGEST_CHANGE)))


def _added_depth(trial, new, past, before, command, noise_seed):
    """What the last effect adds that neither the nominal simulator nor the effects before it can make."""
    fit = _misfit(trial, new)
    sigma = np.sqrt(np.mean((new.y - new.clean) ** 2, axis=0))
    columns = [(new.clean - past.clean) / sigma]
    for i, (effect, theta) in enumerate(before.effects):
        more = theta.copy()
        more[0] *= 1.02
        changed = list(trial.effects)
        changed[i] = (effect, more)
        grown = trial.with_effects(changed).record(command, np.random.default_rng(noise_seed))
        columns.append((grown.clean - new.clean) / sigma)
    left = remainder(np.stack(columns, axis=2), fit).reshape(-1, len(columns))
    own, others = left[:, 0], left[:, 1:]
    others = others / np.maximum(np.linalg.norm(others, axis=0), 1e-300)
    own = own - others @ np.linalg.lstsq(others, own, rcond=None)[0]
    return float(np.sqrt(np.mean(own**2)))


def _bring_to_depth(attempt, wanted, name):
    """Return the strength at which an effect is as deep as wanted, and what was tried there.

    Secant steps on logarithms, kept in a bracket. ``attempt(strength)`` returns the depth first.
    """
    low, high = None, None  # (log strength, log depth)
    x, target = np.log(0.1), np.log(wanted)
    closest = (np.inf, None, None)
    for _ in range(N_TRIES):
        strength = float(np.exp(x))
        tried = attempt(strength)
        y = np.log(max(tried[0], 1e-12)) if np.isfinite(tried[0]) else np.inf
        if abs(y - target) < closest[0]:
            closest = (abs(y - target), strength, tried)
        if closest[0] < DEPTH_TOLERANCE:
            break
        if y < target:
            low = (x, y)
        else:
            high = (x, y)
        if low is None:
            x = high[0] - min(max((high[1] - target) if np.isfinite(high[1]) else 2.0, 0.3), 3.0)
        elif high is None:
            x = low[0] + min(max(target - low[1], 0.2), 2.0)
        else:
            share = (target - low[1]) / (high[1] - low[1]) if np.isfinite(high[1]) else 0.5
            x = low[0] + min(max(share, 0.1), 0.9) * (high[0] - low[0])
            if high[0] - low[0] < 1e-3:  # the depth jumps here, as with the whole samples of a stuck sensor
                break
        if not -14.0 < x < 8.0:
            break
    if closest[0] > LARGEST_MISS:
        raise UnreachableError(f"{name} does not reach a structural residual of {wanted:.3g} times the noise")
    return closest[1], closest[2]

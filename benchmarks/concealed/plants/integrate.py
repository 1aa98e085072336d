"""The hidden plants' integrator: many third-order steps per sample, dry friction by mode, events landed on.

Between samples the input is held. Each fine step knows the mode of every rubbing state (holding, forwards,
backwards); within it the rates are smooth, and a rate that would change its sign is stopped at zero, where
the next step decides whether it holds. This is not how the diagnosis's simulators work.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from benchmarks.concealed.plants.codes import Code, Kind
from benchmarks.concealed.plants.dispatch import hidden_rates, nominal_rates
from benchmarks.concealed.plants.forces import force, friction, remember, stiffening
from benchmarks.concealed.plants.inputs import act
from benchmarks.concealed.plants.sensors import sense

__all__ = ["MEMORY", "UNFORCED", "Attached", "run_hidden", "run_nominal"]

MEMORY = 24  # numbers an effect may remember
UNFORCED = np.zeros((0, 0))  # nothing is added to the nominal's rates
LOST = 1e12  # a state beyond this has left the machine


class Attached(NamedTuple):
    """The effects of one plant as arrays: `seen` holds position, rate, other, other_to and input."""

    code: np.ndarray  # (n_effects,)
    kind: np.ndarray  # (n_effects,)
    index: np.ndarray  # (n_effects,)
    seen: np.ndarray  # (n_effects, 5)
    theta: np.ndarray  # (n_effects, 8)
    gate: np.ndarray  # (n_effects, 2), seconds between which the effect is there


@njit(cache=True, nogil=True)
def _at(x, i):
    return x[i] if i >= 0 else 0.0


@njit(cache=True, nogil=True)
def _other(x, seen):
    return _at(x, seen[2]) - _at(x, seen[3])


@njit(cache=True, nogil=True)
def _rates(plant, x, u, t, c, effects, memory, out):
    """Write the smooth rates at time `t`: the plant's own and what the effects add."""
    hidden_rates(plant, x, u, c, out)
    for e in range(effects.code.size):
        if effects.kind[e] != Kind.state or t < effects.gate[e, 0] or t >= effects.gate[e, 1]:
            continue
        seen = effects.seen[e]
        out[effects.index[e]] += force(
            effects.code[e],
            effects.theta[e],
            _at(x, seen[0]),
            _at(x, seen[1]),
            _other(x, seen),
            u[seen[4]],
            t,
            memory[e],
        )
    for e in range(effects.code.size):
        if effects.kind[e] == Kind.state and effects.gate[e, 0] <= t < effects.gate[e, 1]:
            out[effects.index[e]] *= stiffening(effects.code[e], effects.theta[e], _at(x, effects.seen[e, 0]))


@njit(cache=True, nogil=True)
def _friction_levels(x, t, effects, levels):
    """Write (slide forwards, hold forwards, slide backwards, hold backwards) per state."""
    levels[:] = 0.0
    for e in range(effects.code.size):
        if effects.kind[e] == Kind.state and effects.gate[e, 0] <= t < effects.gate[e, 1]:
            i = effects.index[e]
            found = friction(effects.code[e], effects.theta[e], x[i], _other(x, effects.seen[e]))
            for j in range(4):
                levels[i, j] += found[j]


@njit(cache=True, nogil=True)
def _brake(rates, mode, levels):
    """Take dry friction off the rates: nothing moves in mode 0, friction opposes the motion otherwise."""
    for i in range(rates.size):
        if levels[i, 1] + levels[i, 3] > 0.0:
            if mode[i] == 0.0:
                rates[i] = 0.0
            else:
                rates[i] -= levels[i, 0] if mode[i] > 0.0 else -levels[i, 2]


@njit(cache=True, nogil=True)
def _advance(x, rates, h, out):
    for i in range(x.size):
        out[i] = x[i] + h * rates[i]


@njit(cache=True, nogil=True)
def _after_standstill(before, after, rate, mode, levels, h):
    """Return the speed at the end of a step in which it passed zero: held there, or set off the other way.

    Only the rest of the step counts after the standstill, with friction turned round.
    """
    rest = h * after / (after - before)
    if mode > 0.0:
        free = rate + levels[0]
        return rest * (free + levels[2]) if free < -levels[3] else 0.0
    free = rate - levels[2]
    return rest * (free - levels[0]) if free > levels[1] else 0.0


@njit(cache=True, nogil=True)
def _fine_step(plant, x, u, t, h, c, effects, memory, work):
    """Advance `x` by `h`: three stages of order three, then landings, memories and brims."""
    k1, k2, k3, stage, mode, old = work[0], work[1], work[2], work[3], work[4], work[5]
    levels = work[6:10].T
    old[:] = x
    _friction_levels(x, t, effects, levels)
    _rates(plant, x, u, t, c, effects, memory, k1)
    for i in range(x.size):
        mode[i] = np.sign(x[i])
        if x[i] == 0.0 and (k1[i] > levels[i, 1] or k1[i] < -levels[i, 3]):
            mode[i] = np.sign(k1[i])
    _brake(k1, mode, levels)
    _advance(x, k1, 0.5 * h, stage)
    _rates(plant, stage, u, t + 0.5 * h, c, effects, memory, k2)
    _brake(k2, mode, levels)
    _advance(x, k2, 0.75 * h, stage)
    _rates(plant, stage, u, t + 0.75 * h, c, effects, memory, k3)
    _brake(k3, mode, levels)
    for i in range(x.size):
        x[i] += h * (2.0 * k1[i] + 3.0 * k2[i] + 4.0 * k3[i]) / 9.0
        if levels[i, 1] + levels[i, 3] > 0.0 and x[i] * mode[i] < 0.0:
            x[i] = _after_standstill(old[i], x[i], k3[i], mode[i], levels[i], h)
    for e in range(effects.code.size):
        if effects.kind[e] != Kind.state or t < effects.gate[e, 0] or t >= effects.gate[e, 1]:
            continue
        seen = effects.seen[e]
        remember(
            effects.code[e],
            effects.theta[e],
            _at(old, seen[0]),
            _at(x, seen[0]),
            _at(x, seen[1]),
            u[seen[4]],
            h,
            memory[e],
        )
        i = effects.index[e]
        if effects.code[e] == Code.overflow and x[i] > effects.theta[e, 0]:
            if seen[2] >= 0:  # a share of what spills arrives below
                x[seen[2]] += effects.theta[e, 1] * (x[i] - effects.theta[e, 0])
            x[i] = effects.theta[e, 0]


@njit(cache=True, nogil=True)
def _held_mean(command, t, h, dt):
    """Return the mean over [t, t + h) of a command that is held between samples; before 0 it is its first."""
    first, last = int(np.floor(t / dt)), int(np.floor((t + h) / dt))
    late = min(max((t + h - last * dt) / h, 0.0), 1.0) if last > first else 0.0
    return (1.0 - late) * command[max(first, 0)] + late * command[max(last, 0)]


@njit(cache=True, nogil=True)
def _reach(commands, k, t, dt, h, effects, memory, out):
    """Write what reaches the plant's inputs at time `t` of sample `k`."""
    out[:] = commands[k]
    for e in range(effects.code.size):
        if effects.kind[e] != Kind.input or t < effects.gate[e, 0] or t >= effects.gate[e, 1]:
            continue
        i = effects.index[e]
        if effects.code[e] == Code.delay:
            out[i] = _held_mean(commands[:, i], t - effects.theta[e, 0], h, dt)
        else:
            out[i] = act(effects.code[e], effects.theta[e], out[i], t, h, memory[e])


@njit(cache=True, nogil=True)
def _read(x, k, dt, n_fine, measured, effects, memory, raw, out):
    """Write the readings of sample `k`; `raw` has what they were before a delay, at all fine steps so far."""
    t = k * dt
    for j in range(measured.size):
        y = x[measured[j]]
        for e in range(effects.code.size):
            if effects.kind[e] != Kind.output or effects.index[e] != j:
                continue
            if t < effects.gate[e, 0] or t >= effects.gate[e, 1]:
                continue
            if effects.code[e] == Code.delay:
                past = max((k - effects.theta[e, 0] / dt) * n_fine, 0.0)
                before = int(past)
                after = min(before + 1, k * n_fine)
                y = raw[before, j] + (past - before) * (raw[after, j] - raw[before, j])
            else:
                y = sense(effects.code[e], effects.theta[e], y, t, dt, memory[e])
        out[j] = y


@njit(cache=True, nogil=True)
def _within(x):
    return np.max(np.abs(x)) < LOST  # false for NaN too


@njit(cache=True, nogil=True)
def run_hidden(plant, c, x0, u, noise, steps, measured, loop, effects, memory, dt, n_fine):
    """Run a hidden plant over a recording.

    Parameters
    ----------
    plant : int
        Its number.
    c : ndarray
        Physical constants.
    x0 : ndarray of shape (n_states,)
        State at the first sample.
    u : ndarray of shape (n_samples, n_inputs)
        Inputs; with a loop, column 0 is the reference of the first output.
    noise : ndarray of shape (n_samples, n_outputs)
        Added to the readings.
    steps : ndarray of shape (n_outputs,)
        Step of the converter; 0 for none.
    measured : ndarray of int
        States the sensors see.
    loop : ndarray of shape (6,)
        On or off, PID gains (per second where they integrate), limit, working point.
    effects, memory
        What is concealed, and its memory, (n_effects, MEMORY), written.
    dt, n_fine
        Sampling period in seconds and fine steps in it.

    Returns
    -------
    states, clean, measured_y, used
        States at the samples, readings without and with noise, and the inputs commanded.
    """
    n, n_states = u.shape[0], x0.size
    states = np.empty((n, n_states))
    clean = np.empty((n, measured.size))
    noisy = np.empty((n, measured.size))
    raw = np.empty((n * n_fine + 1, measured.size))
    used = u.copy()
    x = x0.copy()
    reached = np.empty(u.shape[1])
    work = np.empty((10, n_states))
    h = dt / n_fine
    total, last = 0.0, 0.0
    raw[0] = x[measured]
    for k in range(n):
        states[k] = x
        _read(x, k, dt, n_fine, measured, effects, memory, raw, clean[k])
        for j in range(measured.size):
            y = clean[k, j] + noise[k, j]
            noisy[k, j] = steps[j] * np.floor(y / steps[j] + 0.5) if steps[j] > 0.0 else y
        if loop[0] > 0.0:
            error = u[k, 0] - noisy[k, 0]
            slope = (noisy[k, 0] - last) / dt if k > 0 else 0.0
            last = noisy[k, 0]
            command = loop[1] * error + loop[2] * total - loop[3] * slope
            if abs(command) < loop[4]:
                total += dt * error
            used[k, 0] = loop[5] + min(max(command, -loop[4]), loop[4])
        for s in range(n_fine):
            t = k * dt + s * h
            _reach(used, k, t, dt, h, effects, memory, reached)
            _fine_step(plant, x, reached, t, h, c, effects, memory, work)
            for j in range(measured.size):
                raw[k * n_fine + s + 1, j] = x[measured[j]]
        if not _within(x):
            states[k + 1 :] = np.nan
            clean[k + 1 :] = np.nan
            noisy[k + 1 :] = np.nan
            break
    return states, clean, noisy, used


@njit(cache=True, nogil=True)
def _forced_rates(plant, x, u, p, force, out):
    nominal_rates(plant, x, u, p, out)
    for i in range(x.size):
        out[i] += force[i]


@njit(cache=True, nogil=True)
def run_nominal(plant, p, starts, u, length, dt, added):
    """Run the user's simulator over windows of `length` samples by classical Runge-Kutta steps at `dt`.

    `starts` (n_windows, n_states) are the states at samples 0, length, 2 length ...; `added` (n_samples,
    n_states) is added to the rates during each sample, or has no rows. Returns the states at all samples,
    (n_samples, n_states).
    """
    n, n_states = u.shape[0], starts.shape[1]
    states = np.empty((n, n_states))
    x, stage, still = np.empty(n_states), np.empty(n_states), np.zeros(n_states)
    k1, k2, k3, k4 = np.empty(n_states), np.empty(n_states), np.empty(n_states), np.empty(n_states)
    for k in range(n):
        if k % length == 0 and k // length < starts.shape[0]:
            x[:] = starts[k // length]
        states[k] = x
        force = added[k] if added.shape[0] > 0 else still
        _forced_rates(plant, x, u[k], p, force, k1)
        _advance(x, k1, 0.5 * dt, stage)
        _forced_rates(plant, stage, u[k], p, force, k2)
        _advance(x, k2, 0.5 * dt, stage)
        _forced_rates(plant, stage, u[k], p, force, k3)
        _advance(x, k3, dt, stage)
        _forced_rates(plant, stage, u[k], p, force, k4)
        for i in range(n_states):
            x[i] += dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
    return states

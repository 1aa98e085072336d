"""Effects at state equations as the arrays that the kernel takes: each has a slot."""

from collections.abc import Sequence

import numpy as np

from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.simulators.addresses import MAX_THETA, force_address
from narx_sklearn.discrepancy.simulators.kernels import MAX_EFFECTS, SPILL


def slots(forces: Sequence[tuple[PlacedEffect, float]], n_inputs: int, n_states: int) -> tuple:
    """Return forces, each with its strength, as the arrays that the kernel takes, in its order."""
    n = len(forces)
    if n > MAX_EFFECTS:
        raise ValueError(f"{n} effects act at state equations; at most {MAX_EFFECTS} can.")
    addresses = np.zeros(MAX_EFFECTS, dtype=np.int64)  # none where something is but late
    port, onward, through = (np.zeros(MAX_EFFECTS, dtype=np.int64) for _ in range(3))
    memory = np.zeros(MAX_EFFECTS, dtype=np.int64)
    jumps, after, sticks, inertial, sums, seen, along = (np.zeros(MAX_EFFECTS, dtype=bool) for _ in range(7))
    weights = np.zeros((MAX_EFFECTS, n_states))
    seconds = np.full((MAX_EFFECTS, n_inputs + n_states), np.nan)
    answer, strength = np.zeros((2, MAX_EFFECTS))
    late, lacking = np.full(MAX_EFFECTS, -1.0), np.full(MAX_EFFECTS, np.nan)
    theta = np.zeros((MAX_EFFECTS, MAX_THETA))
    begins, ends = np.full((2, MAX_EFFECTS), np.inf)
    for i, (placed, scale) in enumerate(forces):
        effect = placed.effect
        addresses[i] = 0 if placed.force is None else force_address(placed.force)
        port[i], onward[i], through[i] = placed.port.index, placed.onward, placed.through
        if placed.handed_on and placed.through < 0:  # a state counts after the inputs
            through[i] = n_inputs + placed.port.index
        memory[i], jumps[i], after[i], strength[i] = placed.n_memory, effect.jumps, effect.after, scale
        sticks[i] = effect.last and not effect.after  # a hard limit is asked last too, and holds nothing
        sums[i], seen[i] = placed.is_on_sum, placed.is_seen
        late[i] = -1.0 if placed.dead_time is None else placed.dead_time
        lacking[i] = np.nan if placed.lacking is None else placed.lacking
        inertial[i], answer[i] = placed.inertial, 0.0 if placed.inertial else placed.answer
        begins[i], ends[i], along[i] = placed.during
        weights[i, : len(placed.weights)] = placed.weights
        if placed.second:
            seconds[i] = placed.second
        theta[i, : len(effect.parameters)] = placed.own_theta
        if placed.onward >= 0:
            theta[i, SPILL] = placed.taken_onward
    flags = jumps, after, sticks, inertial, sums, seen
    ways = port, onward, through
    sizes = weights, answer, seconds, strength, late, lacking
    return addresses, n, *ways, *sizes, theta, memory, *flags, begins, ends, along


def is_special(placed: PlacedEffect) -> bool:
    """Tell whether a force does more than act in its own state equation (and onward)."""
    elsewhere = placed.through >= 0 or placed.handed_on
    return placed.effect.after or placed.inertial or elsewhere or placed.answer > 0

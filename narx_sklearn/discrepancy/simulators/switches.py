"""Switches in a user's equations: dry friction written as a sign, as an ``if`` at rest, as a steep tanh.

Where such equations drive their state back to the switch from both sides, it stays there (a mass sticks),
and explicit steps of any length chatter about it. What stays is the mean of both sides that moves along the
switch (A. F. Filippov, Differential Equations with Discontinuous Righthand Sides, Kluwer 1988, section 4).
The kernel takes that mean over a step; where switches are is found here.
"""

from collections.abc import Callable
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np

SCALES = (1e-6, 1e-3, 1.0, 1e3)  # of states, in their units: nothing is known of them yet
POINTS = 3  # of each scale
AT_LEAST = 2  # points show a switch, that it is one
APART = 100.0  # times what a step changes, two states are not at a switch between them
ROUNDS = 20  # of what a step changes, which depends on the force, and the force on it
SETTLED = 0.5  # of the change before, that it has been found
EVEN = 1.5  # times the force at four times the distance: what grows no faster is a switch and not a slope
STEEP = 0.75  # of the force already at a quarter of a step's change: no explicit step follows such a slope
WHOLE = 0.99  # of the force, that a side has been reached
CLEAR = 4.0  # widths or steps from a switch, the slopes beside it are seen
HALVINGS = 20  # of the distance to a side; what jumps is as strong at the last


class Switches(NamedTuple):
    """Sums of states at whose zero a right-hand side jumps."""

    weights: np.ndarray  # (n_switches, n_states)
    authority: np.ndarray  # (n_switches,) half of the jump of the rate of weights @ x
    width: np.ndarray  # (n_switches,) how far from its zero either side has been reached

    @classmethod
    def none(cls, n_states: int) -> "Switches":
        """Return no switches."""
        return cls(np.zeros((0, n_states)), np.zeros(0), np.zeros(0))

    def clear_of(self, x: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Return a state so far from every switch that these steps, (n_states,), do not cross it."""
        x = np.array(x, dtype=float)
        for row, width in zip(self.weights, self.width, strict=True):
            least, distance = CLEAR * max(width, np.abs(row) @ steps), row @ x
            if abs(distance) < least:
                x += (np.copysign(least, distance) - distance) * row / (row @ row)
        return x


def find_switches(rates: Callable, n_inputs: int, units: list[str], step: float) -> Switches:
    """Return the switches that integration steps cannot follow, of each state and between two of one unit.

    Parameters
    ----------
    rates : callable
        ``rates(x, u)``, shape (n_states,), with the parameters in it.
    n_inputs : int
        Number of inputs.
    units : list of str
        Units of the states.
    step : float
        Integration step, s.
    """
    n = len(units)
    rng = np.random.default_rng(0)
    points = [
        (scale * rng.standard_normal(n), rng.standard_normal(n_inputs), scale)
        for scale in SCALES
        for _ in range(POINTS)
    ]
    single = np.eye(n)
    alike = np.array([[a == b for b in units] for a in units], dtype=bool).reshape(n, n)

    def seen(row, points, is_apart=lambda at, change: True) -> tuple[float, float] | None:
        """Return the largest authority of a switch at ``row @ x = 0`` and its width, if points show one."""
        aside = row / (row @ row)
        found = []
        for x, u, scale in points:
            at = x - (row @ x) * aside
            jump = _jump(lambda by, at=at, u=u: row @ rates(at + by * aside, u), step)
            # a side that is reached only beyond all states of a scale, as where a root turns over, is none
            if jump is not None and jump[1] < scale and is_apart(at, jump[0] * step):
                found.append(jump)
        return max(found) if len(found) >= AT_LEAST else None

    def apart_from_others(at, change, i):
        return np.all(np.abs(at[alike[i] & (single[i] == 0)]) > APART * change)

    def moving_together(at, change, i):
        return abs(at[i]) > APART * change

    # what switches with a difference does so with each of the two, where all of their unit are zero
    at_rest = [[(np.where(alike[i], 0.0, x), u, scale) for x, u, scale in points] for i in range(n)]
    moving = [i for i in range(n) if seen(single[i], at_rest[i]) is not None]
    rows = [(single[i], partial(apart_from_others, i=i)) for i in moving]
    for i, j in combinations(moving, 2):
        if alike[i, j]:
            rows.append((single[i] - single[j], partial(moving_together, i=i)))
    found = [(row, jump) for row, is_apart in rows if (jump := seen(row, points, is_apart)) is not None]
    if not found:
        return Switches.none(n)
    authority, width = np.array([jump for _, jump in found]).T.copy()
    return Switches(np.array([row for row, _ in found]), authority, width)


def _jump(rate_at: Callable, step: float) -> tuple[float, float] | None:
    """Return half of a rate's jump at zero and how far from there it is whole, if it drives back to zero."""

    def force(distance):
        return 0.5 * float(rate_at(-distance) - rate_at(distance))

    try:
        change, size = step, 0.0
        for _ in range(ROUNDS):
            before, size = change, force(change)
            if not (np.isfinite(size) and size > 0):
                return None
            change = step * size
            if SETTLED * before < change < before / SETTLED:
                break
        else:
            return None
        if not (force(0.25 * change) > STEEP * size and force(4.0 * change) < EVEN * size):
            return None
        width = 0.25 * change
        for _ in range(HALVINGS):
            if not force(0.5 * width) > WHOLE * force(width):
                break
            width *= 0.5
    except Exception:
        return None  # not defined there, for the machine never comes there
    return size, width

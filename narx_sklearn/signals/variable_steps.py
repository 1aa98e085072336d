"""Pseudo random variable steps (PRVS), and their setup from recorded step responses."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from sklearn.utils import check_random_state

from narx_sklearn.signals._checks import check_count, check_vector

__all__ = ["HoldLimits", "StepTable", "hold_limits", "prvs", "step_table"]

SETTLED_WITHIN = 0.05  # share of the covered range inside which a response counts as settled


class HoldLimits(NamedTuple):
    """How long a level may be held, read from one step response.

    Attributes
    ----------
    amplitude : float
        Signed change of the input, in its unit.
    k_min, k_max : int
        Shortest and longest hold, in samples.
    k_settled : int
        Samples after which the response stays within 5 % of its final value. A ``k_max`` at or beyond it
        lets the system come to rest, which the design wants to avoid.
    """

    amplitude: float
    k_min: int
    k_max: int
    k_settled: int


@dataclass(frozen=True)
class StepTable:
    """Setup coefficients of a PRVS: how long a level is held after a step of a given size.

    Parameters
    ----------
    amplitudes : sequence of float
        Step sizes ``u_s1 < u_s2 < ...`` of the preliminary experiments, positive, in the unit of the input.
    k_min_up, k_max_up : sequence of int
        Shortest and longest hold after an increasing step of up to each size, in samples.
    k_min_down, k_max_down : sequence of int
        The same after a decreasing step.

    Raises
    ------
    ValueError
        If the sizes do not increase, the lengths differ, or a shortest hold exceeds the longest.

    References
    ----------
    Abreu (2021), section 2.3.2, Figure 2.6 and Table 2.1.
    """

    amplitudes: tuple[float, ...]
    k_min_up: tuple[int, ...]
    k_max_up: tuple[int, ...]
    k_min_down: tuple[int, ...]
    k_max_down: tuple[int, ...]

    def __post_init__(self):
        amplitudes = tuple(check_vector(self.amplitudes, "amplitudes").tolist())
        if amplitudes[0] <= 0 or any(b <= a for a, b in pairwise(amplitudes)):
            raise ValueError(f"amplitudes must be positive and increase, got {amplitudes}.")
        object.__setattr__(self, "amplitudes", amplitudes)
        for name in ("k_min_up", "k_max_up", "k_min_down", "k_max_down"):
            holds = tuple(check_count(k, name) for k in getattr(self, name))
            if len(holds) != len(amplitudes):
                raise ValueError(f"{name} has {len(holds)} values for {len(amplitudes)} amplitudes.")
            object.__setattr__(self, name, holds)
        for way in ("up", "down"):
            shortest, longest = getattr(self, f"k_min_{way}"), getattr(self, f"k_max_{way}")
            for size, k_min, k_max in zip(amplitudes, shortest, longest, strict=True):
                if k_min > k_max:
                    raise ValueError(
                        f"k_min_{way}={k_min} exceeds k_max_{way}={k_max} at the amplitude {size:g}."
                    )


def prvs(n_samples: int, steps: StepTable, *, u_min: float, u_max: float, random_state=None) -> np.ndarray:
    """Generate pseudo random variable steps: random levels, each held for a random time.

    Levels ``a_j`` are uniform between `u_min` and `u_max`. The hold after the change ``a_j - a_{j-1}`` is
    a uniform integer between the limits that `steps` gives for its size and direction, so that the input
    waits long enough for a response to show and not long enough for it to settle, wherever the system is
    slower for large steps or in one direction.

    Parameters
    ----------
    n_samples : int
        Length of the signal.
    steps : StepTable
        Limits of the hold. Changes larger than its last amplitude use its last row.
    u_min, u_max : float
        Lowest and highest level, in the unit of the input.
    random_state : int, RandomState instance or None, default=None
        Seed; None draws another signal each time.

    Returns
    -------
    ndarray of shape (n_samples,)
        The last level is cut to fit, and may so be held for less than its shortest time.

    Raises
    ------
    ValueError
        If `u_min` is not below `u_max`, or `n_samples` is less than 1.

    See Also
    --------
    step_table : Derives the limits from recorded step responses.
    prfs : A smooth signal, for systems with hysteresis.

    Notes
    -----
    The thesis draws levels between 0 and ``u_max - u_min``; `u_min` is added here, so that they lie in the
    operating range. Its cases (2.18) end at the largest tested step, and (2.19) leaves out a change of
    exactly zero, which has no direction: it counts as an increasing step.

    References
    ----------
    Abreu (2021), eqs. (2.17)-(2.21).

    Examples
    --------
    >>> from narx_sklearn.signals import StepTable, prvs
    >>> steps = StepTable((1, 2), k_min_up=(5, 8), k_max_up=(10, 16), k_min_down=(6, 9), k_max_down=(12, 18))
    >>> u = prvs(1000, steps, u_min=-1, u_max=1, random_state=0)
    >>> int((u[1:] != u[:-1]).sum())
    109
    """
    n_samples = check_count(n_samples, "n_samples")
    u_min, u_max = float(u_min), float(u_max)
    if not (np.isfinite(u_min) and np.isfinite(u_max) and u_min < u_max):
        raise ValueError(f"u_min must lie below u_max, got u_min={u_min:g} and u_max={u_max:g}.")
    rng = check_random_state(random_state)
    u = np.empty(n_samples)
    level = rng.uniform(u_min, u_max)
    k = 0
    while k < n_samples:
        previous, level = level, rng.uniform(u_min, u_max)
        row = min(np.searchsorted(steps.amplitudes, abs(level - previous)), len(steps.amplitudes) - 1)
        if level >= previous:
            hold = rng.randint(steps.k_min_up[row], steps.k_max_up[row] + 1)
        else:
            hold = rng.randint(steps.k_min_down[row], steps.k_max_down[row] + 1)
        u[k : k + hold] = level
        k += hold
    return u


def hold_limits(u, y, *, share: float = 0.45, ratio: float = 2.0) -> HoldLimits:
    """Read the shortest and longest hold of a PRVS level from one recorded step response.

    ``k_min`` is the number of samples from the step until the output has covered `share` of the way from
    its level before the step to its final level, and ``k_max = ratio * k_min``.

    Parameters
    ----------
    u : array-like of shape (n_samples,)
        Input: one level, then another.
    y : array-like of shape (n_samples,)
        Output, at rest before the step and again at the end of the record.
    share : float, default=0.45
        Share of the covered range, between 0 and 1.
    ratio : float, default=2.0
        Longest hold in shortest holds, at least 1.

    Returns
    -------
    HoldLimits

    Raises
    ------
    ValueError
        If `u` is no single step, `y` has another length, or the output does not move.

    Notes
    -----
    The level before is the median of the output before the step, the final level the median of the last
    twentieth of the record. The range counts from level to level, without an overshoot.

    References
    ----------
    Abreu (2021), Example 2.4 and Figure 2.7.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.signals import hold_limits
    >>> k = np.arange(-10, 400)
    >>> u, y = np.where(k >= 0, 5.0, 0.0), np.where(k >= 0, 1 - 0.97 ** k.clip(0), 0.0)
    >>> hold_limits(u, y).k_min
    20
    """
    u, y = check_vector(u, "u", smallest_size=2), check_vector(y, "y", smallest_size=2)
    if u.size != y.size:
        raise ValueError(f"u has {u.size} samples and y has {y.size}; they must be recorded together.")
    if not 0 < share < 1:
        raise ValueError(f"share must lie between 0 and 1, got {share!r}.")
    if not ratio >= 1:
        raise ValueError(f"ratio must be at least 1, got {ratio!r}.")
    changes = np.flatnonzero(np.diff(u))
    if changes.size != 1:
        raise ValueError(
            f"u changes {changes.size} times, but one step is wanted. Cut the record to one step; if the "
            "input was measured with noise, pass the commanded input."
        )
    start = int(changes[0]) + 1
    before = np.median(y[:start])
    covered = np.median(y[-max(1, y.size // 20) :]) - before
    if covered == 0:
        raise ValueError("y ends at the level it had before the step, so no response time can be read.")
    progress = (y[start:] - before) / covered
    k_min = max(1, int(np.argmax(progress >= share)))
    outside = np.flatnonzero(np.abs(progress - 1) > SETTLED_WITHIN)
    return HoldLimits(
        amplitude=float(u[start] - u[start - 1]),
        k_min=k_min,
        k_max=round(ratio * k_min),
        k_settled=int(outside[-1]) + 1 if outside.size else 0,
    )


def step_table(responses: Sequence, *, share: float = 0.45, ratio: float = 2.0) -> StepTable:
    """Derive the setup of a PRVS from recorded step responses.

    Parameters
    ----------
    responses : sequence of (u, y)
        One record of input and output for each step, as `hold_limits` takes them: each size once upwards
        and once downwards, in any order.
    share : float, default=0.45
        Share of the covered range that ends the shortest hold, between 0 and 1.
    ratio : float, default=2.0
        Longest hold in shortest holds, at least 1.

    Returns
    -------
    StepTable

    Raises
    ------
    ValueError
        If a record is no step response, or a size was not recorded once in each direction.

    References
    ----------
    Abreu (2021), Example 2.4.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.signals import step_table
    >>> k = np.arange(-10, 1000)
    >>> step, slow, fast = np.where(k >= 0, 2.0, 0.0), 1 - 0.99 ** k.clip(0), 1 - 0.95 ** k.clip(0)
    >>> step_table([(step, fast), (-step, -slow)])
    StepTable(amplitudes=(2.0,), k_min_up=(12,), k_max_up=(24,), k_min_down=(60,), k_max_down=(120,))
    """
    limits = [hold_limits(u, y, share=share, ratio=ratio) for u, y in responses]
    up = sorted(limit for limit in limits if limit.amplitude > 0)
    down = sorted((limit for limit in limits if limit.amplitude < 0), reverse=True)
    sizes_up, sizes_down = [limit.amplitude for limit in up], [-limit.amplitude for limit in down]
    if not limits or len(up) != len(down) or not np.allclose(sizes_up, sizes_down):
        raise ValueError(
            "Each step size must be recorded once upwards and once downwards, but the records hold "
            f"increasing steps of {sizes_up} and decreasing steps of {sizes_down}."
        )
    return StepTable(
        amplitudes=tuple(sizes_up),
        k_min_up=tuple(limit.k_min for limit in up),
        k_max_up=tuple(limit.k_max for limit in up),
        k_min_down=tuple(limit.k_min for limit in down),
        k_max_down=tuple(limit.k_max for limit in down),
    )

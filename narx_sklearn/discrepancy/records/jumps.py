"""Jumps of a signal: seldom, and much farther than it ever moves from one sample to the next."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

JUMP = 5.0  # times the largest other step
MOST = 10  # jumps of a signal; what goes far more often moves so
STAYS = 5  # samples before and after, by which a jump is told from a spike, which comes back


class Jumps(NamedTuple):
    """Where a signal jumps."""

    samples: list[int]  # the first after each
    usual: float  # largest step that is none


def find_jumps(values: np.ndarray, simulated: np.ndarray, pieces: Sequence[slice]) -> Jumps:
    """Return the samples at which measured values jump, where simulated ones, (n_samples,), do not.

    What the input makes jump jumps in the simulation too; what was held and goes on catches up.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.records.jumps import find_jumps
    >>> angle = np.sin(np.arange(300) / 20)
    >>> find_jumps(angle + (np.arange(300) >= 100), angle, [slice(0, 300)]).samples
    [100]
    """
    inside = [np.arange(piece.start + 1, piece.stop) for piece in pieces]
    places = np.concatenate(inside) if inside else np.empty(0, dtype=int)
    steps = np.nan_to_num(np.abs(np.diff(values, prepend=np.nan)))[places]
    largest = np.argsort(-steps, kind="stable")[: MOST + 1]
    sizes = steps[largest]
    beyond = np.flatnonzero(sizes[:-1] > JUMP * sizes[1:])
    if sizes.size <= MOST or not sizes[-1] > 0 or not beyond.size:
        return Jumps([], float(sizes.max(initial=0.0)))
    n_jumps = int(beyond[-1]) + 1
    usual = float(sizes[n_jumps])
    samples = [
        k
        for k in sorted(places[largest[:n_jumps]].tolist())
        if _stays(values, k) and not abs(simulated[k] - simulated[k - 1]) > usual
    ]
    return Jumps(samples, usual)


def _stays(values: np.ndarray, k: int) -> bool:
    """Tell whether values moved before sample ``k``, and stay where they jumped to."""
    before, after = values[max(k - STAYS, 0) : k], values[k : k + STAYS]
    if min(before.size, after.size) < STAYS or not np.isfinite([*before, *after]).all():
        return False
    moved = np.median(after) - np.median(before)
    return bool(np.ptp(before) > 0 and 2.0 * abs(moved) > abs(values[k] - values[k - 1]))

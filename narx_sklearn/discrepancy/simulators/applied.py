"""Effects at inputs and outputs: what they make of these signals along a record."""

from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.placed import PlacedEffect


class Sessions(NamedTuple):
    """The samples of a record's sessions, up to the last that is run.

    An effect acts since its session began, also where no window is and its memory waits.
    """

    samples: np.ndarray  # (n,)
    began: np.ndarray  # (n,) first sample of the session of each
    first: np.ndarray  # (n_sessions,) where each session begins among the samples

    @classmethod
    def of(cls, began: np.ndarray, last: np.ndarray) -> "Sessions":
        """Return those of windows: the first sample of the session of each, and one past its own last."""
        first = np.unique(began)
        stop = [last[began == one].max() for one in first]
        ages = [np.arange(b - a) for a, b in zip(first, stop, strict=True)]
        age = np.concatenate([np.arange(0), *ages])
        begin = np.cumsum([0, *(part.size for part in ages)])[:-1]
        of_each = np.repeat(first, [part.size for part in ages])
        return cls(of_each + age, of_each, begin)


@np.errstate(invalid="ignore", over="ignore")  # behind a run that is lost everything is
def applied(
    signals: np.ndarray,
    acting: Iterable[tuple[PlacedEffect, float]],
    driven: np.ndarray | None,
    dt: float,
    sessions: Sessions,
    is_held: bool = False,
    within: np.ndarray | None = None,
    x: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return signals with effects applied, each by its strength, and how much they then rise within a step.

    No rows of the latter where they do not. On outputs effects may depend on inputs as ``driven`` and on
    states ``x``.

    What arrives late of a signal that ``is_held`` from sample to sample changes between samples: then the
    signals are means over the steps, and the rise is that of the straight line of least squares. Where the
    middle and the end of each step are known, ``within`` (2, n_samples, n_signals) or no samples, what
    arrives late is that of a signal which bends there and may jump at the samples; behind an effect that does
    not tell its own they are no longer known.
    """
    within = np.empty((2, 0, signals.shape[1])) if within is None else within
    bends = np.full(signals.shape[1], within.shape[1] > 0)
    out, tilt = signals.copy(), np.empty((0, signals.shape[1]))
    for placed, scale in acting:
        column = out[:, placed.port.index].copy()
        other = placed.second_of(signals if driven is None else driven, x)
        keep, began, begin = sessions
        if placed.effect.instants:  # its time is that of the whole record
            begin = np.unique(began)
            keep, began = np.arange(len(column)), np.zeros(len(column), dtype=np.int64)
        inside = column[keep]
        acts = placed.during.holds(keep, began, dt)
        aside = None if other is None else other[keep]
        at = placed.port.index
        changed = np.empty_like(inside)
        for part, theta, first in _beginning(placed, began, begin):
            if is_held and placed.effect.held is not None:
                changed[part], rise = placed.effect.held(inside[part], dt, theta, first)
                tilt = tilt if len(tilt) else np.zeros_like(signals)
                tilt[keep[part], at] += np.where(acts[part], scale * rise, 0.0)
            elif bends[at] and placed.effect.curved is not None:
                known = within[:, keep[part], at]
                changed[part], *then = placed.effect.curved(inside[part], *known, dt, theta, first)
                within[:, keep[part], at] = known + np.where(
                    acts[part], scale * (np.array(then) - known), 0.0
                )
            else:
                bends[at] = False
                changed[part] = placed.effect.transform(
                    inside[part], None if aside is None else aside[part], dt, theta, first
                )
        out[keep, at] = inside + np.where(acts, scale * (changed - inside), 0.0)
    return out, tilt


def _beginning(
    placed: PlacedEffect, began: np.ndarray, first: np.ndarray
) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
    """Yield parts of the samples, the effect's parameters there, and where it begins anew in a part.

    One part where it begins alike in all sessions.
    """
    theta, begin = np.array(placed.theta), placed.effect.begin
    if begin is None or not placed.begins:
        yield slice(None), theta, first
        return
    own = dict(placed.begins)
    for a, b in pairwise([*first.tolist(), began.size]):
        theta[begin] = own.get(int(began[a]), placed.theta[begin])
        yield slice(a, b), theta.copy(), np.zeros(1, dtype=np.int64)

"""Effects at inputs and outputs: what they make of these signals along a record."""

from collections.abc import Iterable
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
        theta = np.array(placed.theta)
        if is_held and placed.effect.held is not None:
            changed, rise = placed.effect.held(inside, dt, theta, begin)
            tilt = tilt if len(tilt) else np.zeros_like(signals)
            tilt[keep, placed.port.index] += np.where(acts, scale * rise, 0.0)
        elif bends[placed.port.index] and placed.effect.curved is not None:
            at = within[:, keep, placed.port.index]
            changed, *then = placed.effect.curved(inside, *at, dt, theta, begin)
            within[:, keep, placed.port.index] = at + np.where(acts, scale * (np.array(then) - at), 0.0)
        else:
            bends[placed.port.index] = False
            changed = placed.effect.transform(
                inside, None if other is None else other[keep], dt, theta, begin
            )
        out[keep, placed.port.index] = inside + np.where(acts, scale * (changed - inside), 0.0)
    return out, tilt

"""A value kept between two levels, the corners sharp or rounded."""

import numpy as np

from narx_sklearn.physics.effects._kernel import kernel


def between(level, low, high, w=0.0):
    """Return the level kept between two others; the corners are rounded over ``w``, and sharp where it is 0.

    The knee is ``low + w log((1 + exp((s - low)/w)) / (1 + exp((s - high)/w)))``. Taken apart it is the sharp
    clip and at each corner ``w log(1 + exp(-distance/w))``, at most ``w log 2``, which cannot overflow.
    """
    low, high = min(low, high), max(low, high)
    sharp = np.clip(level, low, high)
    if not w > 0:
        return sharp
    with np.errstate(over="ignore"):  # a distance of infinitely many widths leaves no rounding
        return sharp + w * (
            np.log1p(np.exp(-np.abs(level - low) / w)) - np.log1p(np.exp(-np.abs(level - high) / w))
        )


@kernel
def kept_between(level, low, high, w):
    """Return one level so kept, for kernels."""
    low, high = min(low, high), max(low, high)
    sharp = min(max(level, low), high)
    if not w > 0.0:
        return sharp
    below, above = np.exp(-abs(level - low) / w), np.exp(-abs(level - high) / w)
    return sharp + w * (np.log1p(below) - np.log1p(above))

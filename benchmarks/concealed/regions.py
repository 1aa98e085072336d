"""Where in its own signals an effect lives: the truth that a readable rule is scored against."""

import numpy as np

from benchmarks.concealed.plants.codes import Code

__all__ = ["activity"]


def activity(effect, theta, recording, rest) -> np.ndarray | None:
    """Return the samples at which the effect is at work, or None where no sharp border can be drawn."""
    site, code = effect.site, effect.code
    u = recording.u[:, site.index if site.kind.name == "input" else 0] - theta[7]
    y = recording.clean[:, site.index] if site.kind.name == "output" else recording.clean[:, 0]
    x = recording.states[:, site.position] if site.position >= 0 else None
    masks = {
        Code.input_saturation: lambda: np.abs(u) > 0.8 * theta[0],
        Code.dead_zone: lambda: np.abs(u) < theta[0],
        Code.sensor_clip: lambda: y >= theta[0] - 1e-12,
        Code.clearance: lambda: np.abs(x) > theta[1],
        Code.overflow: lambda: x >= theta[0] * (1.0 - 1e-9),
        Code.detent_force: lambda: np.abs(x - theta[1]) < 1.5 * theta[2],
        Code.auto_ranging_sensor: lambda: np.abs(y) > theta[1],
    }
    if code not in masks:
        return None
    mask = masks[code]()
    return mask if 0 < mask.sum() < mask.size else None

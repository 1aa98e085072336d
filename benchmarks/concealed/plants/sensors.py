"""What a sensor may do to the quantity it measures, once per sample."""

import numpy as np
from numba import njit

from benchmarks.concealed.plants.codes import Code

__all__ = ["at_rest_remembered", "sense"]


def at_rest_remembered(code, y):
    """Return the memory of a sensor that has long read `y`: the reading; no magnetism, count or charge."""
    blank = code in (Code.sensor_memory, Code.lost_counts, Code.overload_recovery)
    return (0.0, y, y) if blank else (y, y, y)


@njit(cache=True, nogil=True)
def sense(code, theta, y, t, dt, z):
    """Return the reading of `y` at time `t`; `z` is the sensor's memory, written."""
    s = theta[0]
    if code == Code.additive_drift:  # a slow swing that never repeats within the record
        return y + s * (np.sin(theta[1] * t + theta[2]) - np.sin(theta[2]) + 0.5 * theta[1] * t)
    if code == Code.sensor_bias:
        return y + s
    if code == Code.sensor_clip:
        return min(max(y, theta[1]), theta[0])
    if code == Code.quantisation:
        return s * np.floor(y / s + 0.5)
    if code == Code.stuck_sensor:  # theta: duration, start
        if t < theta[1] or t >= theta[1] + s:
            z[0] = y
        return z[0]
    if code == Code.lag:
        z[0] += (y - z[0]) * (1.0 - np.exp(-dt / s))
        return z[0]
    if code == Code.creep:  # three retarded parts, a decade of time constants
        total = 0.0
        for j in range(3):
            z[j] += (y - z[j]) * (1.0 - np.exp(-dt / (theta[1] * 3.0**j)))
            total += z[j]
        return y + s * total / 3.0
    if code == Code.auto_ranging_sensor:  # the coarse range reads too much, and is left late
        if abs(y) > theta[1]:
            z[0] = 1.0
        elif abs(y) < 0.7 * theta[1]:
            z[0] = 0.0
        return y * (1.0 + s * z[0])
    if code == Code.sensor_memory:  # a magnetised core
        end = 1.0 if y > z[1] else -1.0
        z[0] = end + (z[0] - end) * np.exp(-abs(y - z[1]) / theta[1])
        z[1] = y
        return y + s * z[0]
    if code == Code.sensor_ripple:  # interpolation error of a scale, periodic in what is measured
        return y + s * (np.sin(theta[1] * y) - 0.4 * np.cos(2.0 * theta[1] * y))
    if code == Code.lost_counts:  # an encoder that misses a share of what is faster than theta[1]
        over = abs(y - z[1]) - theta[1] * dt
        if over > 0.0:
            z[0] += s * over * np.sign(y - z[1])
        z[1] = y
        return y - z[0]
    if code == Code.resynchronised_clock:  # runs away from the other by theta[0], set right every theta[1]
        slope = (y - z[0]) / dt
        z[0] = y
        return y + s * (t / theta[1] - np.floor(t / theta[1]) - 0.5) * slope
    if code == Code.loaded_potentiometer:  # theta[1]: its lower end, theta[2]: its length
        r = (y - theta[1]) / theta[2]
        return theta[1] + theta[2] * r / (1.0 + s * r * (1.0 - r))
    if code == Code.overload_recovery:  # charged by what exceeds theta[1], recovers within theta[2]
        over = max(abs(y) - theta[1], 0.0) * np.sign(y)
        z[0] += (over - z[0]) * (1.0 - np.exp(-dt / theta[2]))
        return y - s * z[0]
    if code == Code.rate_squared_error:  # dynamic pressure on a probe, centripetal pull on a tilt sensor
        slope = (y - z[0]) / dt
        z[0] = y
        return y - s * (slope / theta[1]) ** 2
    if code == Code.interleaved_converters:  # two that take turns, of unequal gains
        return y * (1.0 + s * (np.floor(t / dt + 0.5) % 2.0 - 0.5))
    return y

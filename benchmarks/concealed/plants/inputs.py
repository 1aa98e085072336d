"""What an actuator may do to its command, advanced by one fine step.

What follows a command within a fine step is told by its mean over that, so that a lag or a ramp much shorter
than a sample is as long as it says.
"""

import numpy as np
from numba import njit

from benchmarks.concealed.plants.codes import Code

__all__ = ["act"]


@njit(cache=True, nogil=True)
def act(code, theta, u, t, h, z):
    """Return what reaches the plant when `u` is commanded; `z` is the actuator's memory, written.

    `theta` holds the effect's numbers (see ``shapes``), ``theta[7]`` the command's working point.
    """
    d = u - theta[7]
    if code == Code.input_saturation:  # algebraic soft clip; theta: limit, sharpness
        d /= (1.0 + abs(d / theta[0]) ** theta[1]) ** (1.0 / theta[1])
    elif code == Code.dead_zone:  # edges rounded over theta[1]
        width, edge = theta[0], theta[1]
        up = 0.5 * (d - width + np.sqrt((d - width) ** 2 + edge**2))
        down = 0.5 * (-d - width + np.sqrt((d + width) ** 2 + edge**2))
        d = up - down
    elif code == Code.input_polynomial:  # an exponential characteristic: even and odd distortion
        d = (np.exp(theta[0] * d) - 1.0) / theta[0]
    elif code == Code.backlash:  # compliant play: four gaps of unequal width in parallel round the corners
        total = 0.0
        for j in range(4):
            width = theta[0] * (0.7 + 0.2 * j)
            z[j] = min(max(z[j], d - width), d + width)
            total += z[j]
        d = total / 4.0
    elif code == Code.valve_stiction:  # held until the error passes theta[0], then jumps to theta[1] of it
        if abs(d - z[0]) > theta[0]:
            z[0] = d - np.sign(d - z[0]) * theta[1]
        d = z[0]
    elif code == Code.rate_limit:  # a positioner whose speed comes to its end theta[0] softly
        step = d - z[0]
        moved = step / (1.0 + abs(step / (theta[0] * h)) ** 6) ** (1.0 / 6.0)
        z[0] += moved
        d = z[0] - 0.5 * moved * abs(moved) / (theta[0] * h)
    elif code == Code.lag:
        moved = (d - z[0]) * (1.0 - np.exp(-h / theta[0]))
        z[0] += moved
        d -= moved * theta[0] / h
    elif code == Code.gain_drift:  # settles towards a gain of 1 + theta[0]
        d *= 1.0 + theta[0] * (1.0 - np.exp(-t / theta[1]))
    elif code == Code.supply_sag:  # the gain gives way after hard work
        z[0] += h / theta[1] * (abs(d) / theta[2] - z[0])
        d /= 1.0 + theta[0] * z[0]
    elif code == Code.input_dropout:  # open contact for a share theta[0] of an irregular cycle
        phase = t / theta[1] + 0.3 * np.sin(t / theta[2])
        if phase - np.floor(phase) < theta[0]:
            d = 0.0
    elif code == Code.two_speed_lag:  # fills faster than it empties
        tau = theta[0] if d > z[0] else theta[1]
        z[0] += (d - z[0]) * (1.0 - np.exp(-h / tau))
        d = z[0]
    elif code == Code.burst_firing:  # a share theta[0] of the power comes as all or nothing, once a cycle
        phase = t / theta[1]
        full = theta[2] if phase - np.floor(phase) < 0.5 + 0.5 * d / theta[2] else -theta[2]
        d += theta[0] * (full - d)
    elif code == Code.supply_ripple:  # a rectified supply: charged at once, then emptied until the next peak
        phase = t / theta[1] + theta[2]
        d *= 1.0 + theta[0] * (0.5 - (phase - np.floor(phase)))
    elif code == Code.snap_action:  # an over-centre spring that adds its force on the side it last went to
        if abs(d) > theta[1]:
            z[0] = np.sign(d)
        d += theta[0] * z[0]
    elif code == Code.reversal_pause:  # a bridge that waits for theta[0] before it lets the other way through
        if z[1] <= 0.0 and d * z[0] < 0.0:
            z[1] = theta[0]
        z[0] = np.sign(d) if d != 0.0 else z[0]
        d *= 1.0 - min(max(z[1] / h, 0.0), 1.0)
        z[1] -= h
    elif code == Code.scoured_deposit:  # silt, a film on contacts: settles at little flow, torn off at much
        loose, tau = abs(u) > theta[2], theta[1]
        z[0] = z[0] * np.exp(-10.0 * h / tau) if loose else 1.0 + (z[0] - 1.0) * np.exp(-h / tau)
        d = u / (1.0 + theta[0] * z[0]) - theta[7]
    elif code == Code.faulty_bit:  # a converter one of whose bits weighs theta[0] too much
        bit = np.floor(d / theta[1] + theta[2]) % 2.0
        d += theta[0] * (bit - 0.5)
    elif code == Code.stroke_pulsation:  # a piston, an auger: a wave each turn, turned by the command
        z[0] += h * theta[1] * max(u, 0.0)
        d = u * (1.0 + theta[0] * np.sin(2.0 * np.pi * z[0])) - theta[7]
    return theta[7] + d

"""What may be missing in a state equation: rates, dry friction in modes, and elements with a memory."""

import numpy as np
from numba import njit

from benchmarks.concealed.plants.codes import Code

__all__ = ["N_ELEMENTS", "force", "friction", "remember", "stiffening"]

N_ELEMENTS = 24  # slip elements of a distributed hysteresis


@njit(cache=True, nogil=True)
def force(code, theta, x, v, w, u, t, z):
    """Return what the effect adds to its state's rate.

    `x`, `v` and `w` are the position, the rate and one more state it looks at, `u` an input, `z` its memory.
    """
    s = theta[0]
    if code == Code.viscous_damping:
        return -s * v
    if code == Code.cubic_stiffness:  # a pair of slanted springs, theta[1] long
        return -s * x * (1.0 - 1.0 / np.sqrt(1.0 + (x / theta[1]) ** 2))
    if (
        code == Code.quadratic_stiffness
    ):  # magnetic pull over a gap theta[1], less its value and slope at rest
        r = x / theta[1]
        return -s * (1.0 / (1.0 - r) ** 2 - 1.0 - 2.0 * r) if r < 0.8 else -s * 22.4
    if code == Code.bilinear_stiffness:  # contact over a roughness theta[1]
        return -s * 0.5 * (x + np.sqrt(x * x + theta[1] ** 2))
    if code == Code.clearance:  # rounded contact beyond the gap theta[1]
        over = abs(x) - theta[1]
        return -s * np.sign(x) * theta[2] * (over / theta[2]) ** 1.25 if over > 0.0 else 0.0
    if code == Code.quadratic_drag:  # a drag coefficient that falls slowly with speed
        return -s * v * abs(v / theta[1]) ** 0.9
    if code == Code.gravity:
        return -s * np.sin(x)
    if code == Code.cogging:
        return s * (np.sin(theta[1] * x + theta[2]) + 0.25 * np.sin(2.0 * theta[1] * x + theta[3]))
    if code == Code.bilinear_input:
        return s * (u - theta[7]) * x
    if (
        code == Code.root_outflow
    ):  # laminar trickle below theta[1], jet above; the linear outflow gives way to it
        depth = max(x, 0.0)
        return s * (depth / theta[2] - depth / np.sqrt(theta[2] * (depth + theta[1])))
    if code == Code.constant_load:
        return s
    if code == Code.periodic_disturbance:
        return s * (np.sin(theta[1] * t + theta[2]) + 0.2 * np.sin(3.0 * theta[1] * t + theta[3]))
    if code == Code.coupling:
        return s * (u - theta[7])
    if code == Code.extra_mode:
        return s * z[0]
    if code in (Code.presliding_friction, Code.prandtl_ishlinskii):
        total = 0.0
        for j in range(N_ELEMENTS):
            total -= z[j]
        return s * total
    if code == Code.bouc_wen_hysteresis:
        return -s * (z[0] + z[1] + z[2]) / 3.0
    if code == Code.detent_force:  # a catch near theta[1], theta[2] wide
        return s * np.exp(-(((x - theta[1]) / theta[2]) ** 2))
    if code == Code.position_damping:
        return -s * v * (x / theta[1]) ** 2
    if code == Code.loosened_spring:  # gives way within a short time after theta[1]
        return s * x / (1.0 + np.exp(-(t - theta[1]) / theta[2]))
    if code == Code.pulsating_stiffness:
        return s * x * np.sin(theta[1] * t + theta[2])
    if code == Code.shocks:  # blows that come irregularly and ring down
        phase = t / theta[1] + 0.35 * np.sin(t / theta[2])
        return s * np.exp(-(phase - np.floor(phase)) / 0.04) * np.sign(np.sin(1.7 * np.floor(phase) + 0.4))
    if code == Code.radiation_loss:  # theta[1] the absolute temperature of the surroundings
        return -s * ((1.0 + x / theta[1]) ** 4 - 1.0)
    if code == Code.wandering_load:  # three incommensurate beats, none of them a line of the input
        return s * np.sin(theta[1] * t + 2.0 * np.sin(0.37 * theta[1] * t)) * np.cos(0.21 * theta[1] * t)
    if code == Code.recovering_softening:  # rubber, soft up to where it was lately stretched
        return s * x * z[0] / theta[2]
    if code == Code.switching_outlet:  # a siphon, a fan, a gas discharge: on while z[0] is 1
        return -s * x * z[0]
    if code == Code.unbalance:  # a centrifugal force that turns with the position
        return s * v * v * np.sin(theta[1] * x + theta[2])
    if code == Code.eddy_brake:  # eddy currents, which cannot follow the field beyond a speed theta[1]
        return -s * v / (1.0 + (v / theta[1]) ** 2)
    if code == Code.overrunning_clutch:  # drags a flywheel of speed z[0] along, which may run ahead
        return -s * max(v - z[0], 0.0)
    if code == Code.latent_store:  # wax that melts at theta[1], a basin behind a sill: takes until it is full
        flow = x - theta[1]
        return -s * flow if (flow > 0.0 and z[0] < 1.0) or (flow < 0.0 and z[0] > 0.0) else 0.0
    if code == Code.linked_throttle:  # a float valve, a bimetal louvre, a lifting brush
        return -s * x * max(abs(w) / theta[1] - 1.0, 0.0)
    if code == Code.warming_damper:  # oil that thins, a thermistor that conducts, as its losses heat it
        return -s * v / (1.0 + z[0])
    return 0.0


@njit(cache=True, nogil=True)
def friction(code, theta, v, w):
    """Return the levels of dry friction: sliding and holding forwards, sliding and holding backwards."""
    s = theta[0]
    if code == Code.coulomb_friction:
        return s, s, s, s
    if code == Code.asymmetric_friction:
        return s, s, s * theta[1], s * theta[1]
    if code == Code.stribeck_friction:  # rational fall from theta[1] times the sliding level
        level = s * (1.0 + (theta[1] - 1.0) / (1.0 + (v / theta[2]) ** 2))
        return level, s * theta[1], level, s * theta[1]
    if code == Code.load_friction:
        return s * abs(w), s * abs(w), s * abs(w), s * abs(w)
    return 0.0, 0.0, 0.0, 0.0


@njit(cache=True, nogil=True)
def stiffening(code, theta, x):
    """Return the factor on the whole rate of the state: an inertia or inductance that depends on `x`."""
    if code == Code.variable_inertia:
        return 1.0 / (1.0 + theta[0] * (x / theta[1]) ** 2)
    if code == Code.saturating_core:  # Froelich's curve: the flux is i / (1 + |i|)
        return (1.0 + theta[0] * abs(x) / theta[1]) ** 2
    return 1.0


@njit(cache=True, nogil=True)
def remember(code, theta, x_old, x_new, v, u, h, z):
    """Advance the memory `z` of an effect over a fine step in which its position went from old to new."""
    dx = x_new - x_old
    if code == Code.extra_mode:  # a lightly damped mode driven by the input: semi-implicit Euler
        z[1] += h * (theta[1] ** 2 * (u - theta[7] - z[0]) - theta[2] * z[1])
        z[0] += h * z[1]
    elif code == Code.presliding_friction:  # slip elements whose strength falls with speed
        strength = 1.0 + (theta[2] - 1.0) / (1.0 + (v / theta[3]) ** 2)
        for j in range(N_ELEMENTS):
            share = strength / N_ELEMENTS
            reach = theta[1] * (j + 0.5) / N_ELEMENTS
            z[j] = min(max(z[j] + dx / reach * share, -share), share)
    elif code == Code.prandtl_ishlinskii:  # slip elements with reaches spread over decades
        for j in range(N_ELEMENTS):
            share = 1.0 / N_ELEMENTS
            reach = theta[1] * 10.0 ** (1.5 * (j + 0.5) / N_ELEMENTS - 1.0)
            z[j] = min(max(z[j] + dx / reach * share, -share), share)
    elif code == Code.bouc_wen_hysteresis:  # three smooth elements of unequal reach
        for j in range(3):
            reach = theta[1] * 0.6 * 1.7**j
            # exact along a step of one direction: z runs into +-1 as 1 - exp(-distance / reach)
            end = 1.0 if dx > 0.0 else -1.0
            z[j] = end + (z[j] - end) * np.exp(-abs(dx) / reach)
    elif code == Code.recovering_softening:  # the largest deflection, slowly forgotten
        z[0] = max(abs(x_new), z[0] * np.exp(-h / theta[1]))
    elif code == Code.switching_outlet:  # on above theta[1], off below theta[2]
        if abs(x_new) > theta[1]:
            z[0] = 1.0
        elif abs(x_new) < theta[2]:
            z[0] = 0.0
    elif code == Code.overrunning_clutch:  # picked up within theta[1], slowed by its own bearing in theta[2]
        z[0] += max(v - z[0], 0.0) * (1.0 - np.exp(-h / theta[1]))
        z[0] *= np.exp(-h / theta[2])
    elif code == Code.latent_store:  # the share that is molten
        z[0] = min(max(z[0] + h * (x_new - theta[1]) / theta[2], 0.0), 1.0)
    elif code == Code.warming_damper:  # heated by its losses, cooled within theta[1]
        z[0] += ((v / theta[2]) ** 2 - z[0]) * (1.0 - np.exp(-h / theta[1]))

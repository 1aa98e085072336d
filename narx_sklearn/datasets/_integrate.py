"""Integrators of the synthetic plants, as kernels.

A compiled function that is handed on as an argument keeps its caller out of numba's cache. So the kernels
that take one are pasted into their caller (``inline="always"``), which is cached; they are not.
"""

import numpy as np
from numba import njit

__all__ = ["friction_step", "rk4_run", "rk4_step"]


@njit(nogil=True, inline="always")
def rk4_step(rhs, x, u, rate, p, h, k, x_stage, u_stage):
    """Advance the state `x` by one classical Runge-Kutta step of length `h`, in place.

    ``rhs(x, u, rate, p, out)`` writes the derivative of the state. The input is ``u`` at the start of the
    step and changes at ``rate``. `k` (shape (4, n_states)), `x_stage` and `u_stage` are scratch, written.
    """
    n = x.size
    for stage in range(4):
        c = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        for j in range(n):
            x_stage[j] = x[j] if stage == 0 else x[j] + c * h * k[stage - 1, j]
        for j in range(u.size):
            u_stage[j] = u[j] + c * h * rate[j]
        rhs(x_stage, u_stage, rate, p, k[stage])
    for j in range(n):
        x[j] += h / 6.0 * (k[0, j] + 2.0 * k[1, j] + 2.0 * k[2, j] + k[3, j])


@njit(nogil=True, inline="always")
def rk4_run(rhs, x0, u, hold, p, h, n_substeps):
    """Return the states at the samples, shape (n_samples, n_states), starting from `x0`.

    `h` is the substep: the sampling period divided by `n_substeps`. Between samples the input ``u``
    (n_samples, n_inputs) is held if `hold`, else it runs straight to its next value.
    """
    n_samples, n_inputs = u.shape
    states = np.empty((n_samples, x0.size))
    k = np.empty((4, x0.size))
    x, x_stage = x0.copy(), np.empty(x0.size)
    u_now, u_stage, rate = np.empty(n_inputs), np.empty(n_inputs), np.zeros(n_inputs)
    states[0] = x
    for i in range(n_samples - 1):
        if not hold:
            for j in range(n_inputs):
                rate[j] = (u[i + 1, j] - u[i, j]) / (n_substeps * h)
        for step in range(n_substeps):
            for j in range(n_inputs):
                u_now[j] = u[i, j] + step * h * rate[j]
            rk4_step(rhs, x, u_now, rate, p, h, k, x_stage, u_stage)
        states[i + 1] = x
    return states


@njit(cache=True, nogil=True)
def friction_step(v, force, h, mass, damping, stiffness, coulomb, breakaway):
    """Return the velocity after a step of length `h` of a mass with dry friction.

    At rest the mass stays at rest, exactly, while ``|force| <= breakaway``. In motion it obeys
    ``mass v' = force - damping v - coulomb sign(v)``, implicitly in v, so that friction stops the mass and
    never drives it back. `force` includes the spring force at the present position; `stiffness` accounts for
    its change over the step.
    """
    if v == 0.0 and abs(force) <= breakaway:
        return 0.0
    free = v + h * force / mass
    brake = h * coulomb / mass
    if abs(free) <= brake:
        return 0.0
    slowed = free - brake if free > 0.0 else free + brake
    return slowed / (1.0 + h * damping / mass + h * h * stiffness / mass)

"""One number per plant, so that one compiled kernel runs them all (and is compiled, and cached, once)."""

from numba import njit

from benchmarks.concealed.plants import (
    dc_motor,
    heated_mass,
    mass_spring_damper,
    pendulum,
    rlc,
    servo_axis,
    two_mass_drive,
    two_tanks,
)

__all__ = ["MACHINES", "NUMBERS", "hidden_rates", "nominal_rates"]

_MODULES = (
    mass_spring_damper,
    servo_axis,
    dc_motor,
    two_tanks,
    heated_mass,
    pendulum,
    two_mass_drive,
    rlc,
)
MACHINES = {module.MACHINE.name: module.MACHINE for module in _MODULES}
NUMBERS = {name: number for number, name in enumerate(MACHINES)}

_mass, _servo, _motor, _tanks, _heat, _arm, _drive, _rlc = (njit(nogil=True)(m.rhs) for m in _MODULES)


@njit(cache=True, nogil=True)
def hidden_rates(plant, x, u, c, out):
    """Write the rates of the states of plant number `plant` into `out`."""
    if plant == 0:
        mass_spring_damper.rates(x, u, c, out)
    elif plant == 1:
        servo_axis.rates(x, u, c, out)
    elif plant == 2:
        dc_motor.rates(x, u, c, out)
    elif plant == 3:
        two_tanks.rates(x, u, c, out)
    elif plant == 4:
        heated_mass.rates(x, u, c, out)
    elif plant == 5:
        pendulum.rates(x, u, c, out)
    elif plant == 6:
        two_mass_drive.rates(x, u, c, out)
    else:
        rlc.rates(x, u, c, out)


@njit(cache=True, nogil=True)
def nominal_rates(plant, x, u, p, out):
    """Write the rates that the user's simulator of plant number `plant` gives into `out`."""
    if plant == 0:
        out[0], out[1] = _mass(x, u, p)
    elif plant == 1:
        out[0], out[1] = _servo(x, u, p)
    elif plant == 2:
        out[0], out[1] = _motor(x, u, p)
    elif plant == 3:
        out[0], out[1] = _tanks(x, u, p)
    elif plant == 4:
        out[0], out[1] = _heat(x, u, p)
    elif plant == 5:
        out[0], out[1] = _arm(x, u, p)
    elif plant == 6:
        out[0], out[1], out[2], out[3] = _drive(x, u, p)
    else:
        out[0], out[1] = _rlc(x, u, p)

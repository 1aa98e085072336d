"""A linear axis without a spring, driven by a current amplifier inside a position loop."""

from numba import njit

from benchmarks.concealed.plants.codes import Code
from benchmarks.concealed.plants.machine import Control, Machine, on_input, on_output, on_state

__all__ = ["MACHINE", "rates", "rhs"]


@njit(cache=True, nogil=True)
def rates(x, u, c, out):
    """Force balance; `c`: mass [kg], damping [N s/m], motor constant [N/V]."""
    out[0] = x[1]
    out[1] = (c[2] * u[0] - c[1] * x[1]) / c[0]


def rhs(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1]


def parameters(mass, damping, motor):
    return {"gain [m/s^2/V]": motor / mass, "damping [1/s]": damping / mass}


_slide = on_state(1, 0, 1)

MACHINE = Machine(
    name="servo_axis",
    dt=0.005,
    states=("position [m]", "velocity [m/s]"),
    inputs=("amplifier [V]",),
    measured=(0,),
    constants={"mass": 95.0, "damping": 240.0, "motor": 35.0},
    nominal=rhs,
    parameters=parameters,
    slow=0.4,
    band=3.0,
    amplitude=5.0,
    control=Control(250.0, 0.0, 25.0, 10.0, 0.04),
    closed_only=True,
    sites={
        Code.coulomb_friction: (_slide,),
        Code.asymmetric_friction: (_slide,),
        Code.stribeck_friction: (_slide,),
        Code.presliding_friction: (_slide,),
        Code.quadratic_drag: (_slide,),
        Code.cogging: (_slide,),
        Code.constant_load: (_slide,),
        Code.periodic_disturbance: (_slide,),
        Code.cubic_stiffness: (_slide,),
        Code.dead_zone: (on_input(),),
        Code.input_saturation: (on_input(),),
        Code.rate_limit: (on_input(),),
        Code.input_polynomial: (on_input(),),
        Code.backlash: (on_input(),),
        Code.delay: (on_input(),),
        Code.lag: (on_input(),),
        Code.quantisation: (on_output(),),
        Code.detent_force: (_slide,),
        Code.position_damping: (_slide,),
        Code.variable_inertia: (_slide,),
        Code.shocks: (_slide,),
        Code.wandering_load: (_slide,),
        Code.supply_sag: (on_input(),),
        Code.two_speed_lag: (on_input(),),
        Code.sensor_ripple: (on_output(),),
        Code.supply_ripple: (on_input(),),
        Code.unbalance: (_slide,),
        Code.lost_counts: (on_output(),),
        Code.loaded_potentiometer: (on_output(),),
        Code.reversal_pause: (on_input(),),
        Code.faulty_bit: (on_input(),),
        Code.eddy_brake: (_slide,),
        Code.interleaved_converters: (on_output(),),
    },
)

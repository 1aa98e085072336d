"""A mass on a spring, driven by a voice coil, with a position sensor."""

from numba import njit

from benchmarks.concealed.plants.codes import Code
from benchmarks.concealed.plants.machine import Control, Machine, on_input, on_output, on_state

__all__ = ["MACHINE", "rates", "rhs"]


@njit(cache=True, nogil=True)
def rates(x, u, c, out):
    """Newton's law; `c`: mass [kg], damping [N s/m], stiffness [N/m], motor constant [N/V]."""
    momentum_rate = c[3] * u[0] - c[2] * x[0] - c[1] * x[1]
    out[0] = x[1]
    out[1] = momentum_rate / c[0]


def rhs(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def parameters(mass, damping, stiffness, motor):
    return {
        "gain [m/s^2/V]": motor / mass,
        "damping [1/s]": damping / mass,
        "stiffness [1/s^2]": stiffness / mass,
    }


_body = on_state(1, 0, 1)

MACHINE = Machine(
    name="mass_spring_damper",
    dt=0.02,
    states=("position [m]", "velocity [m/s]"),
    inputs=("drive [V]",),
    measured=(0,),
    constants={"mass": 1.2, "damping": 2.6, "stiffness": 60.0, "motor": 5.0},
    nominal=rhs,
    parameters=parameters,
    slow=0.92,
    band=2.5,
    amplitude=4.0,
    control=Control(12.0, 25.0, 3.0, 8.0, 0.25),
    sites={
        Code.coulomb_friction: (_body,),
        Code.asymmetric_friction: (_body,),
        Code.stribeck_friction: (_body,),
        Code.presliding_friction: (_body,),
        Code.bouc_wen_hysteresis: (_body,),
        Code.prandtl_ishlinskii: (_body,),
        Code.cubic_stiffness: (_body,),
        Code.quadratic_stiffness: (_body,),
        Code.bilinear_stiffness: (_body,),
        Code.clearance: (_body,),
        Code.quadratic_drag: (_body,),
        Code.periodic_disturbance: (_body,),
        Code.extra_mode: (_body,),
        Code.backlash: (on_input(),),
        Code.dead_zone: (on_input(),),
        Code.input_saturation: (on_input(),),
        Code.rate_limit: (on_input(),),
        Code.input_polynomial: (on_input(),),
        Code.valve_stiction: (on_input(),),
        Code.delay: (on_input(),),
        Code.lag: (on_input(), on_output()),
        Code.gain_drift: (on_input(),),
        Code.creep: (on_output(),),
        Code.additive_drift: (on_output(),),
        Code.sensor_clip: (on_output(),),
        Code.quantisation: (on_output(),),
        Code.stuck_sensor: (on_output(),),
        Code.detent_force: (_body,),
        Code.position_damping: (_body,),
        Code.loosened_spring: (_body,),
        Code.pulsating_stiffness: (_body,),
        Code.variable_inertia: (_body,),
        Code.shocks: (_body,),
        Code.wandering_load: (_body,),
        Code.supply_sag: (on_input(),),
        Code.input_dropout: (on_input(),),
        Code.two_speed_lag: (on_input(),),
        Code.auto_ranging_sensor: (on_output(),),
        Code.sensor_memory: (on_output(),),
        Code.sensor_ripple: (on_output(),),
        Code.snap_action: (on_input(),),
        Code.supply_ripple: (on_input(),),
        Code.recovering_softening: (_body,),
        Code.lost_counts: (on_output(),),
        Code.loaded_potentiometer: (on_output(),),
        Code.faulty_bit: (on_input(),),
        Code.warming_damper: (_body,),
        Code.overload_recovery: (on_output(),),
        Code.interleaved_converters: (on_output(),),
    },
)

"""A permanent-magnet motor with a load: current and speed are both measured."""

from numba import njit

from benchmarks.concealed.plants.codes import Code
from benchmarks.concealed.plants.machine import Machine, on_input, on_output, on_state

__all__ = ["MACHINE", "rates", "rhs"]


@njit(cache=True, nogil=True)
def rates(x, u, c, out):
    """Mesh and torque balance; `c`: R [Ohm], L [H], K [V s/rad], J [kg m^2], viscous load b [N m s/rad]."""
    out[0] = (u[0] - c[0] * x[0] - c[2] * x[1]) / c[1]
    out[1] = (c[2] * x[0] - c[4] * x[1]) / c[3]


def rhs(x, u, p):
    current = (u[0] - p[0] * x[0] - p[1] * x[1]) / p[2]
    speed = (p[1] * x[0] - p[4] * x[1]) / p[3]
    return current, speed


def parameters(resistance, inductance, motor, inertia, load):
    return {
        "resistance [Ohm]": resistance,
        "motor constant [V s/rad]": motor,
        "inductance [H]": inductance,
        "inertia [kg m^2]": inertia,
        "load [N m s/rad]": load,
    }


_shaft = on_state(1, -1, 1)

MACHINE = Machine(
    name="dc_motor",
    dt=0.001,
    states=("current [A]", "speed [rad/s]"),
    inputs=("armature [V]",),
    measured=(0, 1),
    constants={"resistance": 1.1, "inductance": 4.5e-3, "motor": 0.06, "inertia": 1.4e-4, "load": 2.0e-4},
    nominal=rhs,
    parameters=parameters,
    slow=0.045,
    band=40.0,
    amplitude=12.0,
    sites={
        Code.coulomb_friction: (_shaft,),
        Code.asymmetric_friction: (_shaft,),
        Code.stribeck_friction: (_shaft,),
        Code.load_friction: (on_state(1, -1, 1, other=0),),
        Code.quadratic_drag: (_shaft,),
        Code.constant_load: (_shaft,),
        Code.periodic_disturbance: (_shaft,),
        Code.dead_zone: (on_input(),),
        Code.input_saturation: (on_input(),),
        Code.rate_limit: (on_input(),),
        Code.input_polynomial: (on_input(),),
        Code.delay: (on_input(),),
        Code.gain_drift: (on_input(),),
        Code.sensor_bias: (on_output(0), on_output(1)),
        Code.sensor_clip: (on_output(0),),
        Code.quantisation: (on_output(1),),
        Code.stuck_sensor: (on_output(0),),
        Code.additive_drift: (on_output(1),),
        Code.lag: (on_output(0), on_output(1)),
        Code.shocks: (_shaft,),
        Code.wandering_load: (_shaft,),
        Code.supply_sag: (on_input(),),
        Code.input_dropout: (on_input(),),
        Code.auto_ranging_sensor: (on_output(0),),
        Code.sensor_memory: (on_output(0),),
        Code.sensor_ripple: (on_output(1),),
        Code.burst_firing: (on_input(),),
        Code.supply_ripple: (on_input(),),
        Code.saturating_core: (on_state(0, 0),),
        Code.resynchronised_clock: (on_output(1),),
        Code.reversal_pause: (on_input(),),
        Code.scoured_deposit: (on_input(),),
        Code.eddy_brake: (_shaft,),
        Code.overrunning_clutch: (_shaft,),
        Code.linked_throttle: (on_state(0, 0, other=1),),
        Code.overload_recovery: (on_output(0),),
        Code.interleaved_converters: (on_output(0), on_output(1)),
    },
)

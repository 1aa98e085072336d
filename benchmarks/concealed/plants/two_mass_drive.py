"""Motor and load joined by a compliant shaft; the encoder sits on the motor, the load is not seen."""

from numba import njit

from benchmarks.concealed.plants.codes import Code
from benchmarks.concealed.plants.machine import Control, Machine, on_input, on_output, on_state

__all__ = ["MACHINE", "rates", "rhs"]


@njit(cache=True, nogil=True)
def rates(x, u, c, out):
    """Torque balances; `c`: motor inertia, load inertia, shaft stiffness, shaft damping, bearing, torque."""
    shaft = c[2] * (x[0] - x[2]) + c[3] * (x[1] - x[3])
    out[0] = x[1]
    out[1] = (c[5] * u[0] - c[4] * x[1] - shaft) / c[0]
    out[2] = x[3]
    out[3] = shaft / c[1]


def rhs(x, u, p):
    twist = p[2] * (x[0] - x[2]) + p[3] * (x[1] - x[3])
    return x[1], p[0] * u[0] - p[1] * x[1] - twist, x[3], p[4] * twist


def parameters(motor_inertia, load_inertia, stiffness, shaft_damping, bearing, torque):
    return {
        "gain [rad/s^2/A]": torque / motor_inertia,
        "bearing [1/s]": bearing / motor_inertia,
        "shaft [1/s^2]": stiffness / motor_inertia,
        "shaft damping [1/s]": shaft_damping / motor_inertia,
        "inertia ratio [1]": motor_inertia / load_inertia,
    }


_motor, _load = on_state(1, 0, 1), on_state(3, 2, 3)

MACHINE = Machine(
    name="two_mass_drive",
    dt=0.004,
    states=("motor angle [rad]", "motor speed [rad/s]", "load angle [rad]", "load speed [rad/s]"),
    inputs=("motor [A]",),
    measured=(0,),
    constants={
        "motor_inertia": 4.0e-4,
        "load_inertia": 6.0e-4,
        "stiffness": 0.5,
        "shaft_damping": 1.5e-3,
        "bearing": 2.5e-3,
        "torque": 0.05,
    },
    nominal=rhs,
    parameters=parameters,
    slow=0.4,
    band=12.0,
    amplitude=3.0,
    control=Control(2.0, 0.0, 0.12, 6.0, 1.5),
    closed_only=True,
    unmeasured=True,
    sites={
        Code.viscous_damping: (_load,),
        Code.coulomb_friction: (_motor, _load),
        Code.asymmetric_friction: (_motor,),
        Code.stribeck_friction: (_motor,),
        Code.presliding_friction: (_load,),
        Code.load_friction: (on_state(1, 0, 1, other=0, other_to=2),),
        Code.gravity: (_load,),
        Code.cogging: (_motor,),
        Code.constant_load: (_load,),
        Code.quadratic_drag: (_load,),
        Code.periodic_disturbance: (_load,),
        Code.dead_zone: (on_input(),),
        Code.input_saturation: (on_input(),),
        Code.delay: (on_input(),),
        Code.quantisation: (on_output(),),
        Code.detent_force: (_load,),
        Code.shocks: (_load,),
        Code.wandering_load: (_load,),
        Code.supply_sag: (on_input(),),
        Code.sensor_ripple: (on_output(),),
        Code.supply_ripple: (on_input(),),
        Code.unbalance: (_load,),
        Code.lost_counts: (on_output(),),
        Code.reversal_pause: (on_input(),),
        Code.faulty_bit: (on_input(),),
        Code.eddy_brake: (_load,),
    },
)

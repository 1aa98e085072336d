"""An arm on a torsion spring, turned by a torque motor through large angles."""

from numba import njit

from benchmarks.concealed.plants.codes import Code
from benchmarks.concealed.plants.machine import Control, Machine, on_input, on_output, on_state

__all__ = ["MACHINE", "rates", "rhs"]


@njit(cache=True, nogil=True)
def rates(x, u, c, out):
    """Torque balance; `c`: inertia [kg m^2], damping [N m s], spring [N m/rad], motor [N m/A]."""
    out[0] = x[1]
    out[1] = (c[3] * u[0] - c[1] * x[1] - c[2] * x[0]) / c[0]


def rhs(x, u, p):
    return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]


def parameters(inertia, damping, spring, motor):
    return {
        "gain [rad/s^2/A]": motor / inertia,
        "damping [1/s]": damping / inertia,
        "spring [1/s^2]": spring / inertia,
    }


_arm = on_state(1, 0, 1)

MACHINE = Machine(
    name="pendulum",
    dt=0.01,
    states=("angle [rad]", "rate [rad/s]"),
    inputs=("motor [A]",),
    measured=(0,),
    constants={"inertia": 0.020, "damping": 0.07, "spring": 0.75, "motor": 0.6},
    nominal=rhs,
    parameters=parameters,
    slow=0.57,
    band=3.0,
    amplitude=2.4,
    control=Control(1.2, 3.0, 0.15, 5.0, 1.2),
    sites={
        Code.gravity: (_arm,),
        Code.cogging: (_arm,),
        Code.coulomb_friction: (_arm,),
        Code.stribeck_friction: (_arm,),
        Code.asymmetric_friction: (_arm,),
        Code.presliding_friction: (_arm,),
        Code.prandtl_ishlinskii: (_arm,),
        Code.bouc_wen_hysteresis: (_arm,),
        Code.quadratic_drag: (_arm,),
        Code.quadratic_stiffness: (_arm,),
        Code.bilinear_stiffness: (_arm,),
        Code.clearance: (_arm,),
        Code.bilinear_input: (_arm,),
        Code.backlash: (on_input(),),
        Code.dead_zone: (on_input(),),
        Code.input_saturation: (on_input(),),
        Code.delay: (on_input(),),
        Code.quantisation: (on_output(),),
        Code.creep: (on_output(),),
        Code.detent_force: (_arm,),
        Code.position_damping: (_arm,),
        Code.loosened_spring: (_arm,),
        Code.pulsating_stiffness: (_arm,),
        Code.variable_inertia: (_arm,),
        Code.shocks: (_arm,),
        Code.auto_ranging_sensor: (on_output(),),
        Code.sensor_ripple: (on_output(),),
        Code.snap_action: (on_input(),),
        Code.recovering_softening: (_arm,),
        Code.unbalance: (_arm,),
        Code.lost_counts: (on_output(),),
        Code.loaded_potentiometer: (on_output(),),
        Code.reversal_pause: (on_input(),),
        Code.eddy_brake: (_arm,),
        Code.overrunning_clutch: (_arm,),
        Code.warming_damper: (_arm,),
        Code.rate_squared_error: (on_output(),),
    },
)

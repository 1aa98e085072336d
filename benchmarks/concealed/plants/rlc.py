"""A series resonant circuit: source voltage in, capacitor voltage and current out."""

from numba import njit

from benchmarks.concealed.plants.codes import Code
from benchmarks.concealed.plants.machine import Machine, on_input, on_output, on_state

__all__ = ["MACHINE", "rates", "rhs"]


@njit(cache=True, nogil=True)
def rates(x, u, c, out):
    """Kirchhoff's laws; `c`: resistance [Ohm], inductance [H], capacitance [F]."""
    out[0] = x[1] / c[2]
    out[1] = (u[0] - c[0] * x[1] - x[0]) / c[1]


def rhs(x, u, p):
    return p[0] * x[1], p[1] * (u[0] - x[0]) - p[2] * x[1]


def parameters(resistance, inductance, capacitance):
    return {
        "1/capacitance [V/(A s)]": 1.0 / capacitance,
        "1/inductance [1/H]": 1.0 / inductance,
        "resistance/inductance [1/s]": resistance / inductance,
    }


_coil = on_state(1, 0, 1)

MACHINE = Machine(
    name="rlc",
    dt=2.0e-5,
    states=("capacitor [V]", "current [A]"),
    inputs=("source [V]",),
    measured=(0, 1),
    constants={"resistance": 30.0, "inductance": 1.0e-2, "capacitance": 1.0e-6},
    nominal=rhs,
    parameters=parameters,
    slow=6.7e-4,
    band=3000.0,
    amplitude=10.0,
    sites={
        Code.cubic_stiffness: (_coil,),
        Code.quadratic_stiffness: (_coil,),
        Code.bilinear_stiffness: (_coil,),
        Code.clearance: (_coil,),
        Code.quadratic_drag: (_coil,),
        Code.coulomb_friction: (_coil,),
        Code.asymmetric_friction: (_coil,),
        Code.bouc_wen_hysteresis: (_coil,),
        Code.prandtl_ishlinskii: (_coil,),
        Code.extra_mode: (_coil,),
        Code.periodic_disturbance: (_coil,),
        Code.dead_zone: (on_input(),),
        Code.input_saturation: (on_input(),),
        Code.rate_limit: (on_input(),),
        Code.input_polynomial: (on_input(),),
        Code.delay: (on_input(),),
        Code.gain_drift: (on_input(),),
        Code.creep: (on_output(),),
        Code.additive_drift: (on_output(),),
        Code.sensor_clip: (on_output(),),
        Code.quantisation: (on_output(),),
        Code.position_damping: (_coil,),
        Code.pulsating_stiffness: (_coil,),
        Code.variable_inertia: (_coil,),
        Code.wandering_load: (_coil,),
        Code.supply_sag: (on_input(),),
        Code.input_dropout: (on_input(),),
        Code.auto_ranging_sensor: (on_output(),),
        Code.sensor_memory: (on_output(),),
        Code.sensor_ripple: (on_output(),),
        Code.supply_ripple: (on_input(),),
        Code.saturating_core: (on_state(1, 1),),
        Code.switching_outlet: (on_state(0, 0),),
        Code.resynchronised_clock: (on_output(0),),
        Code.scoured_deposit: (on_input(),),
        Code.faulty_bit: (on_input(),),
        Code.warming_damper: (_coil,),
        Code.overload_recovery: (on_output(), on_output(1)),
        Code.interleaved_converters: (on_output(), on_output(1)),
    },
)

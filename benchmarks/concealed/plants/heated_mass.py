"""A heated block in a casing: heater power in, both temperatures out, the room's recorded beside."""

from numba import njit

from benchmarks.concealed.plants.codes import Code
from benchmarks.concealed.plants.machine import Machine, on_input, on_output, on_state

__all__ = ["MACHINE", "rates", "rhs"]

OFFSET = 80.0  # W, the heater's working point


@njit(cache=True, nogil=True)
def rates(x, u, c, out):
    """Heat balances above 20 degC; `c`: block, casing [J/K], contact, loss [W/K], heater [W/W]."""
    flow = c[2] * (x[0] - x[1])
    out[0] = (c[4] * u[0] - flow) / c[0]
    out[1] = (flow - c[3] * x[1]) / c[1]


def rhs(x, u, p):
    return p[0] * u[0] - p[1] * (x[0] - x[1]), p[2] * (x[0] - x[1]) - p[3] * x[1]


def parameters(block, casing, contact, loss, heater):
    return {
        "heating [K/s/W]": heater / block,
        "block to casing [1/s]": contact / block,
        "casing from block [1/s]": contact / casing,
        "loss [1/s]": loss / casing,
    }


def rest_state(block, casing, contact, loss, heater):
    flow = heater * OFFSET
    return flow / contact + flow / loss, flow / loss


_block, _casing = on_state(0, 0), on_state(1, 1)

MACHINE = Machine(
    name="heated_mass",
    dt=5.0,
    states=("block rise [K]", "casing rise [K]"),
    inputs=("heater [W]", "room [degC]"),
    measured=(0, 1),
    constants={"block": 420.0, "casing": 300.0, "contact": 6.0, "loss": 1.6, "heater": 0.95},
    nominal=rhs,
    parameters=parameters,
    slow=460.0,
    band=0.004,
    amplitude=60.0,
    offset=OFFSET,
    second_input=(20.0, 5.0),
    rest_state=rest_state,
    sites={
        Code.coupling: (on_state(1, 1, input=1),),
        Code.bilinear_input: (on_state(0, 0),),
        Code.input_polynomial: (on_input(),),
        Code.input_saturation: (on_input(),),
        Code.delay: (on_input(),),
        Code.lag: (on_input(), on_output(1)),
        Code.gain_drift: (on_input(),),
        Code.constant_load: (_casing,),
        Code.sensor_bias: (on_output(0),),
        Code.additive_drift: (on_output(0),),
        Code.sensor_clip: (on_output(0),),
        Code.quantisation: (on_output(0),),
        Code.stuck_sensor: (on_output(1),),
        Code.periodic_disturbance: (_casing,),
        Code.radiation_loss: (_casing,),
        Code.supply_sag: (on_input(),),
        Code.input_dropout: (on_input(),),
        Code.two_speed_lag: (on_input(),),
        Code.wandering_load: (_casing,),
        Code.sensor_memory: (on_output(0),),
        Code.burst_firing: (on_input(),),
        Code.switching_outlet: (_casing,),
        Code.resynchronised_clock: (on_output(0), on_output(1)),
        Code.faulty_bit: (on_input(),),
        Code.stroke_pulsation: (on_input(),),
        Code.latent_store: (_block, _casing),
        Code.linked_throttle: (on_state(1, 1, other=0),),
    },
)

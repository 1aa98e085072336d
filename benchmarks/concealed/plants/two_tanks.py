"""Two tanks above each other: a pump fills the upper one, only the lower level is measured."""

from numba import njit

from benchmarks.concealed.plants.codes import Code
from benchmarks.concealed.plants.machine import Machine, on_input, on_output, on_state

__all__ = ["MACHINE", "rates", "rhs"]

OFFSET = 3.0  # V, the pump's working point


@njit(cache=True, nogil=True)
def rates(x, u, c, out):
    """Volume balances; `c`: area [cm^2], pump [cm^3/s/V], upper and lower conductance [cm^2/s]."""
    upper = c[2] * x[0]
    out[0] = (c[1] * u[0] - upper) / c[0]
    out[1] = (upper - c[3] * x[1]) / c[0]


def rhs(x, u, p):
    return p[0] * u[0] - p[1] * x[0], p[1] * x[0] - p[2] * x[1]


def parameters(area, pump, upper, lower):
    return {
        "pump [cm/s/V]": pump / area,
        "upper outlet [1/s]": upper / area,
        "lower outlet [1/s]": lower / area,
    }


def rest_state(area, pump, upper, lower):
    return OFFSET * pump / upper, OFFSET * pump / lower


MACHINE = Machine(
    name="two_tanks",
    dt=4.0,
    states=("upper level [cm]", "lower level [cm]"),
    inputs=("pump [V]",),
    measured=(1,),
    constants={"area": 15.5, "pump": 3.3, "upper": 0.62, "lower": 0.39},
    nominal=rhs,
    parameters=parameters,
    slow=40.0,
    band=0.012,
    amplitude=2.2,
    offset=OFFSET,
    rest_state=rest_state,
    unmeasured=True,
    sites={
        Code.root_outflow: (on_state(1, 1), on_state(0, 0)),
        Code.overflow: (on_state(0, 0, other=1), on_state(1, 1)),
        Code.bilinear_input: (on_state(1, 1),),
        Code.input_saturation: (on_input(),),
        Code.input_polynomial: (on_input(),),
        Code.valve_stiction: (on_input(),),
        Code.backlash: (on_input(),),
        Code.rate_limit: (on_input(),),
        Code.dead_zone: (on_input(),),
        Code.delay: (on_input(), on_output()),
        Code.lag: (on_input(),),
        Code.gain_drift: (on_input(),),
        Code.additive_drift: (on_output(),),
        Code.sensor_clip: (on_output(),),
        Code.quantisation: (on_output(),),
        Code.stuck_sensor: (on_output(),),
        Code.supply_sag: (on_input(),),
        Code.input_dropout: (on_input(),),
        Code.two_speed_lag: (on_input(),),
        Code.sensor_memory: (on_output(),),
        Code.wandering_load: (on_state(1),),
        Code.burst_firing: (on_input(),),
        Code.snap_action: (on_input(),),
        Code.switching_outlet: (on_state(0, 0), on_state(1, 1)),
        Code.resynchronised_clock: (on_output(),),
        Code.loaded_potentiometer: (on_output(),),
        Code.scoured_deposit: (on_input(),),
        Code.stroke_pulsation: (on_input(),),
        Code.latent_store: (on_state(0, 0), on_state(1, 1)),
        Code.linked_throttle: (on_state(1, 1, other=0),),
        Code.rate_squared_error: (on_output(),),
    },
)

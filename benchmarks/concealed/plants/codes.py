"""Names of everything that can be concealed: the catalogue's effects and effects no catalogue lists."""

from enum import IntEnum

__all__ = ["CATALOGUE", "FRICTIONS", "FURTHER_OUTSIDE", "OUTSIDE", "THIRD_OUTSIDE", "Code", "Kind"]


class Kind(IntEnum):
    """Where an effect acts: on an input, in a state equation, on a measured output."""

    input = 0
    state = 1
    output = 2


class Code(IntEnum):
    """One number per effect, so that a compiled kernel can choose by it."""

    viscous_damping = 0
    coulomb_friction = 1
    asymmetric_friction = 2
    stribeck_friction = 3
    presliding_friction = 4
    load_friction = 5
    valve_stiction = 6
    backlash = 7
    dead_zone = 8
    input_saturation = 9
    rate_limit = 10
    input_polynomial = 11
    bouc_wen_hysteresis = 12
    prandtl_ishlinskii = 13
    creep = 14
    cubic_stiffness = 15
    quadratic_stiffness = 16
    bilinear_stiffness = 17
    clearance = 18
    quadratic_drag = 19
    gravity = 20
    cogging = 21
    bilinear_input = 22
    root_outflow = 23
    overflow = 24
    constant_load = 25
    delay = 26
    lag = 27
    gain_drift = 28
    additive_drift = 29
    sensor_bias = 30
    sensor_clip = 31
    quantisation = 32
    stuck_sensor = 33
    periodic_disturbance = 34
    extra_mode = 35
    coupling = 36

    # Outside the catalogue: the right answer is "unknown", with the port.
    detent_force = 100
    position_damping = 101
    loosened_spring = 102
    pulsating_stiffness = 103
    auto_ranging_sensor = 104
    sensor_memory = 105
    supply_sag = 106
    shocks = 107
    input_dropout = 108
    two_speed_lag = 109
    variable_inertia = 110
    sensor_ripple = 111
    radiation_loss = 112
    wandering_load = 113

    # Outside it too, and kept from those who improve the diagnosis.
    burst_firing = 200
    supply_ripple = 201
    snap_action = 202
    recovering_softening = 203
    saturating_core = 204
    switching_outlet = 205
    unbalance = 206
    lost_counts = 207
    resynchronised_clock = 208
    loaded_potentiometer = 209

    # The third group: chosen by somebody who knows nothing of the diagnosis, when the others had been read.
    reversal_pause = 300
    scoured_deposit = 301
    faulty_bit = 302
    stroke_pulsation = 303
    eddy_brake = 304
    overrunning_clutch = 305
    latent_store = 306
    linked_throttle = 307
    warming_damper = 308
    overload_recovery = 309
    rate_squared_error = 310
    interleaved_converters = 311


CATALOGUE = tuple(code for code in Code if code < 100)
OUTSIDE = tuple(code for code in Code if 100 <= code < 200)
FURTHER_OUTSIDE = tuple(code for code in Code if 200 <= code < 300)
THIRD_OUTSIDE = tuple(code for code in Code if code >= 300)
FRICTIONS = (
    Code.coulomb_friction,
    Code.asymmetric_friction,
    Code.stribeck_friction,
    Code.load_friction,
)

"""From a dimensionless strength to the numbers of an effect, measured by what the machine does without it.

A strength of 1 makes most effects about as large as the rate, the swing or the reading they act on; towards 0
every effect vanishes. Other numbers (gaps, frequencies, ratios) come from the case's draws.
"""

from dataclasses import dataclass

import numpy as np

from benchmarks.concealed.plants.codes import Code

__all__ = ["Scales", "shape"]


@dataclass(frozen=True)
class Scales:
    """Sizes of the signals at an effect's port in the run without effects, and four draws in [0, 1)."""

    rate: float  # rms rate of the port's state
    x: float  # largest distance of the position from rest
    v: float  # rms of the rate it looks at
    w: float  # rms of the other state it looks at
    u: float  # swing of the input
    y: float  # swing of the reading
    y_std: float
    x_rest: float
    x_top: float  # highest position
    y_range: tuple[float, float]
    u_rest: float
    duration: float  # s, of the training recording
    slow: float  # s
    band: float  # Hz
    draws: tuple[float, float, float, float]


def shape(code: Code, s: float, k: Scales) -> np.ndarray:
    """Return the eight numbers of effect `code` at strength `s`; the last is the input's working point."""
    theta = np.zeros(8)
    theta[7] = k.u_rest
    values = _numbers(code, s, k)
    theta[: len(values)] = values
    return theta


def _numbers(code, s, k):
    a, b, c, _ = k.draws
    turn = 2.0 * np.pi
    squeeze = 1.0 / (1.0 + s)  # 1 leaves the range alone
    low, high = k.y_range
    table = {
        Code.viscous_damping: lambda: (s * k.rate / k.v,),
        Code.coulomb_friction: lambda: (s * k.rate,),
        Code.asymmetric_friction: lambda: (s * k.rate, 1.5 + a),
        Code.stribeck_friction: lambda: (s * k.rate, 1.7 + 0.8 * a, (0.2 + 0.3 * b) * k.v),
        Code.presliding_friction: lambda: (s * k.rate, (0.1 + 0.15 * a) * k.x, 1.4, 0.3 * k.v),
        Code.load_friction: lambda: (s * k.rate / k.w,),
        Code.valve_stiction: lambda: (0.3 * s * k.u, 0.3 * s * k.u * (0.2 + 0.5 * a)),
        Code.backlash: lambda: (0.2 * s * k.u,),
        Code.dead_zone: lambda: (0.3 * s * k.u, 0.03 * s * k.u),
        Code.input_saturation: lambda: (k.u / s, 8.0),
        Code.rate_limit: lambda: (5.0 * k.u * k.band / s,),
        Code.input_polynomial: lambda: (np.copysign(s / k.u, a - 0.5),),
        Code.bouc_wen_hysteresis: lambda: (s * k.rate, (0.15 + 0.2 * a) * k.x),
        Code.prandtl_ishlinskii: lambda: (s * k.rate, (0.3 + 0.3 * a) * k.x),
        Code.creep: lambda: (s, 2.0 * k.slow),
        Code.cubic_stiffness: lambda: (10.0 * s * k.rate / k.x, (2.0 + a) * k.x),
        Code.quadratic_stiffness: lambda: (5.0 * s * k.rate, (4.0 + 2.0 * a) * k.x),
        Code.bilinear_stiffness: lambda: (s * k.rate / k.x, 0.04 * k.x),
        Code.clearance: lambda: (3.0 * s * k.rate / k.x, (0.35 + 0.25 * a) * k.x, 0.3 * k.x),
        Code.quadratic_drag: lambda: (s * k.rate / k.v, k.v),
        Code.gravity: lambda: (s * k.rate,),
        Code.cogging: lambda: (s * k.rate, turn * (1.5 + 1.5 * a) / k.x, turn * b, turn * c),
        Code.bilinear_input: lambda: (s * k.rate / (k.u * k.x),),
        Code.root_outflow: lambda: (10.0 * s * k.rate, 0.02 * k.x_rest, k.x_rest),
        Code.overflow: lambda: (k.x_rest + (k.x_top - k.x_rest) * squeeze, 0.4 + 0.4 * a),
        Code.constant_load: lambda: (np.copysign(s * k.rate, a - 0.5),),
        Code.delay: lambda: (0.05 * s / k.band,),
        Code.lag: lambda: (0.05 * s / k.band,),
        Code.gain_drift: lambda: (np.copysign(s, a - 0.7), k.duration * (0.4 + 0.4 * b)),
        Code.additive_drift: lambda: (s * k.y_std, turn * (0.5 + 0.5 * a) / k.duration, turn * b),
        Code.sensor_bias: lambda: (np.copysign(s * k.y_std, a - 0.5),),
        Code.sensor_clip: lambda: (0.5 * (low + high) + 0.5 * (high - low) * squeeze, low - (high - low)),
        Code.quantisation: lambda: (s * k.y_std,),
        Code.stuck_sensor: lambda: (0.05 * s * k.duration, (0.2 + 0.5 * a) * k.duration),
        Code.periodic_disturbance: lambda: (s * k.rate, turn * k.band * (0.3 + 0.5 * a), turn * b, turn * c),
        Code.extra_mode: lambda: (s * k.rate / k.u, turn * k.band * (0.8 + 0.4 * a), turn * k.band * 0.1),
        Code.coupling: lambda: (s * k.rate / k.u,),
        Code.detent_force: lambda: (
            2.0 * s * k.rate,
            k.x_rest + (0.6 * a - 0.3) * k.x,
            (0.1 + 0.1 * b) * k.x,
        ),
        Code.position_damping: lambda: (s * k.rate / k.v, k.x),
        Code.loosened_spring: lambda: (s * k.rate / k.x, (0.3 + 0.3 * a) * k.duration, 0.01 * k.duration),
        Code.pulsating_stiffness: lambda: (s * k.rate / k.x, turn * k.band * (0.3 + 0.4 * a), turn * b),
        Code.auto_ranging_sensor: lambda: (s, (0.4 + 0.2 * a) * k.y),
        Code.sensor_memory: lambda: (s * k.y_std, (0.2 + 0.2 * a) * k.y),
        Code.supply_sag: lambda: (s, k.slow * (3.0 + 3.0 * a), k.u),
        Code.shocks: lambda: (5.0 * s * k.rate, k.duration / (17.0 + 6.0 * a), k.duration / (4.0 + b)),
        Code.input_dropout: lambda: (0.2 * s, k.duration / (20.0 + 10.0 * a), k.duration / (6.0 + b)),
        Code.two_speed_lag: lambda: (0.05 * s / k.band, 0.008 * s / k.band),
        Code.variable_inertia: lambda: (s, k.x),
        Code.sensor_ripple: lambda: (s * k.y_std, turn * (2.0 + 2.0 * a) / k.y),
        Code.radiation_loss: lambda: (s * k.rate, 293.15),
        Code.wandering_load: lambda: (s * k.rate, turn * k.band * (0.2 + 0.3 * a)),
        Code.burst_firing: lambda: (s, (0.4 + 0.4 * a) / k.band, k.u),
        Code.supply_ripple: lambda: (s, 1.0 / (k.band * (0.3 + 0.5 * a)), b),
        Code.snap_action: lambda: (s * k.u, (0.1 + 0.15 * a) * k.u),
        Code.recovering_softening: lambda: (s * k.rate / k.x, k.slow * (2.0 + 3.0 * a), k.x),
        Code.saturating_core: lambda: (s, k.x),
        Code.switching_outlet: lambda: (
            s * k.rate / (k.x_rest + k.x),
            k.x_rest + (0.3 + 0.15 * a) * k.x,
            k.x_rest + (0.05 + 0.1 * b) * k.x,
        ),
        Code.unbalance: lambda: (s * k.rate / k.v**2, turn * (1.0 + a) / k.x, turn * b),
        Code.lost_counts: lambda: (s / (1.0 + s), (0.8 + 0.4 * a) * k.rate),
        Code.resynchronised_clock: lambda: (0.1 * s / k.band, k.duration / (6.0 + 4.0 * a)),
        Code.loaded_potentiometer: lambda: (s, low - 0.25 * (high - low), 1.5 * (high - low)),
        Code.reversal_pause: lambda: (0.1 * s / k.band,),
        Code.scoured_deposit: lambda: (s, k.slow * (2.0 + 3.0 * a), k.u_rest + (0.4 + 0.2 * b) * k.u),
        Code.faulty_bit: lambda: (s * k.u, (0.3 + 0.2 * a) * k.u, 0.25 + 0.5 * b),
        Code.stroke_pulsation: lambda: (s, k.band * (0.3 + 0.4 * a) / k.u_rest),
        Code.eddy_brake: lambda: (s * k.rate / k.v, (0.9 + 0.6 * a) * k.v),
        Code.overrunning_clutch: lambda: (
            s * k.rate / k.v,
            k.slow * (0.3 + 0.3 * a),
            k.slow * (2.0 + 3.0 * b),
        ),
        Code.latent_store: lambda: (
            s * k.rate / k.x,
            k.x_rest + (0.1 + 0.2 * a) * k.x,
            (0.2 + 0.3 * b) * k.x * k.slow,
        ),
        Code.linked_throttle: lambda: (s * k.rate / (k.x_rest + k.x), (0.8 + 0.2 * a) * k.w),
        Code.warming_damper: lambda: (s * k.rate / k.v, k.slow * (1.0 + 2.0 * a), 0.5 * k.v),
        Code.overload_recovery: lambda: (s, (0.3 + 0.2 * a) * k.y, k.slow * (2.0 + 3.0 * b)),
        Code.rate_squared_error: lambda: (s * k.y_std, 1.5 * k.rate),
        Code.interleaved_converters: lambda: (s,),
    }
    return table[code]()

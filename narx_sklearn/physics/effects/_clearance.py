"""Lost motion: backlash, dead zone, clearance, a sticking valve."""

import numpy as np

from narx_sklearn.model.operators import play_step
from narx_sklearn.model.phi import Phi
from narx_sklearn.physics.effects._corner import between, kept_between
from narx_sklearn.physics.effects._curves import of_level, plays
from narx_sklearn.physics.effects._effect import BEGIN, Effect, EffectParameter, Name, Setting
from narx_sklearn.physics.effects._kernel import kernel
from narx_sklearn.physics.effects._series import by_pieces
from narx_sklearn.physics.effects._starts import (
    at_signal,
    grid,
    quantiles,
    scaled,
    spread,
    telling,
    working_points,
)

N_GAPS = 4  # that share a play whose corners are rounded
ROUNDED = 0.1  # of the half-width of a play or a dead zone: the rounding of its corners to begin with
WIDEST = 0.25  # of the range of the commands, over which an edge of a dead zone is rounded
MET = (0.15, 0.05, 0.015)  # shares of the time, that an end stop is met to begin with


@kernel
def _radius(b, s, j):
    """Return the half-width of one of the gaps that share the play, evenly spread about b."""
    return b * (1.0 + s * ((2.0 * j + 1.0) / N_GAPS - 1.0))


@kernel
def _plays_run(values, b, s, begin):
    """Return the mean of the gaps' play operators along values, each ``begin`` half-widths off the first."""
    out = np.empty(values.size)
    w = np.empty(N_GAPS)
    for j in range(N_GAPS):
        w[j] = values[0] + begin * _radius(b, s, j)
    for k in range(values.size):
        total = 0.0
        for j in range(N_GAPS):
            w[j] = play_step(w[j], values[k], _radius(b, s, j))
            total += w[j]
        out[k] = total / N_GAPS
    return out


def _backlash_transform(signal, second, dt, theta, first):
    return signal + theta[0] * (by_pieces(_plays_run, signal, first, theta[1], theta[2], theta[3]) - signal)


@kernel
def _backlash(argument, rate, own, second, time, step, z, theta, dz):
    """z holds the followers, and last whether they have begun."""
    total = 0.0
    for j in range(N_GAPS):
        radius = _radius(theta[1], theta[2], j)
        before = z[j] if z[N_GAPS] > 0.0 else argument + theta[3] * radius
        dz[j] = play_step(before, argument, radius)
        total += dz[j]
    dz[N_GAPS] = 1.0
    return theta[0] * (total / N_GAPS - argument)


def _backlash_starts(setting: Setting) -> np.ndarray:
    """At an input all of the motion is lost; in a state equation the force is what is of ordinary size."""
    rows = grid([1.0], np.array([0.05, 0.15, 0.5]) * spread(setting.argument), [ROUNDED], [0.0])
    if at_signal(setting):
        return telling(setting, rows, _backlash_transform)
    return scaled(
        setting,
        rows,
        lambda row: (
            _backlash_transform(setting.argument, None, setting.dt, row, setting.first) - setting.argument
        ),
    )


def _past_dead_zone(level, d, c, w, o=0.0):
    return level - between(level - c, -d, d, w) - o * c


def _dead_zone_transform(signal, second, dt, theta, first):
    return _past_dead_zone(signal, *theta[:4])


@kernel
def _dead_zone_handed_on(argument, rate, own, second, time, step, z, theta, dz):
    return -kept_between(argument - theta[1], -theta[0], theta[0], theta[2]) - theta[3] * theta[1]


def _within_zone(theta):
    d, c, *_ = theta
    return ((c - d, c + d),)


def _dead_zone_starts(setting: Setting) -> np.ndarray:
    """Five widths about zero; where the signal works elsewhere, three about zero and three about its mean.

    Zero is left out where it is more than the signal's range away from what was visited.
    """
    if spread(setting.argument) == 0:
        return np.empty((0, 4))
    lowest, highest = quantiles(setting.argument, [0.0, 1.0])
    reach = highest - lowest
    centres = [c for c in working_points(setting.argument) if lowest - reach < c < highest + reach]
    rows = [
        [d, c, ROUNDED * d, 0.0]
        for c in centres
        for d in _half_widths(np.abs(setting.argument - c))[:: len(centres)]
    ]
    return telling(setting, np.array(rows), _dead_zone_transform)


def _dead_zone_limits(setting: Setting) -> np.ndarray:
    """Keep the zone within sight, and its edges edges.

    One farther off is an offset, and one rounded over all that is commanded any curve.
    """
    lowest, highest = quantiles(setting.argument, [0.0, 1.0])
    reach = highest - lowest
    edges = [0.0, 2 * reach], [lowest - reach, highest + reach], [0.0, WIDEST * reach]
    return np.array([*edges, [0.0, 1.0]])


def _half_widths(distance: np.ndarray) -> np.ndarray:
    shares = np.array([0.05, 0.15]) * quantiles(distance, 1.0)
    widths = np.unique(np.concatenate([shares, quantiles(distance, [0.1, 0.25, 0.4])]))
    return widths[widths > 0]


@kernel
def _past_gap(x, g, c):
    """Return how far x is beyond the gap of half-width g round c; 0 inside."""
    return x - c - min(max(x - c, -g), g)


@kernel
def _clearance_handed_on(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * (_past_gap(argument, theta[1], theta[2]) - argument)


@kernel
def _clearance(argument, rate, own, second, time, step, z, theta, dz):
    return -theta[0] * _past_gap(argument, theta[1], theta[2])


def _past_gap_of_level(level, g, c):
    return level - c - np.clip(level - c, -g, g)


def _past_gap_transform(signal, second, dt, theta, first):
    return _past_gap_of_level(signal, theta[1], theta[2])


def _beyond_gap(theta):
    _, g, c = theta
    return (-np.inf, c - g), (c + g, np.inf)


def _clearance_starts(setting: Setting) -> np.ndarray:
    low, middle, high = quantiles(setting.argument, [0.0, 0.5, 1.0])
    if not high > low:
        return np.empty((0, 3))
    gaps = quantiles(np.abs(setting.argument - middle), [0.1, 0.3, 0.6, 0.9])
    if at_signal(setting):  # in a coupling, that passes what is past its gap
        return telling(setting, grid([1.0], gaps, [0.0, middle]), _past_gap_transform)
    wide = 2 * (high - low)  # puts the other stop out of reach
    stops = [
        [1.0, wide, stop - side * wide]
        for beyond in MET
        for side, stop in zip((1, -1), quantiles(setting.argument, [1 - beyond, beyond]), strict=True)
    ]
    rows = np.concatenate([grid([1.0], gaps, [middle]), stops])
    return scaled(setting, rows, lambda row: _past_gap_of_level(setting.argument, *row[1:]))


@kernel
def _stem_after(move, command, stem, direction, stick, slip, again, goes_on):
    """Return the stem and the direction of its slide, 0 at rest, after a move of the command.

    At rest it bears a withheld move of (S + J)/2 either way, sliding it trails by (S - J)/2: so a reversal
    takes S and going on after a stop takes J. While the command goes on it may stick `again`: 0 for never, up
    to 1 for as much as at rest, so that the stem goes in steps of J. Where the command `goes_on` in its move,
    and is not there at once, the last of these steps is not over yet.
    """
    trailing = 0.5 * (stick - slip)
    if move * direction <= 0.0:
        direction = 0.0
    withheld = command - stem
    holding = 0.5 * (stick + slip) if direction == 0.0 else trailing + again * slip
    if abs(withheld) > holding:
        direction = 1.0 if withheld > 0.0 else -1.0
        stem = command - direction * trailing
        if goes_on and again * slip > 0.0:
            stem -= direction * ((abs(withheld) - holding) % (again * slip))
    return stem, direction


@kernel
def _stiction_run(values, stick, slip, again, begin):
    """Return the stem along values; it rests at first, ``begin`` times what it may withhold off them."""
    out = np.empty(values.size)
    stem, direction = values[0] + begin * 0.5 * (stick + slip), 0.0
    for k in range(values.size):
        move = values[k] - values[k - 1] if k > 0 else 0.0
        stem, direction = _stem_after(move, values[k], stem, direction, stick, slip, again, False)
        out[k] = stem
    return out


@kernel
def _stiction_handed_on(argument, rate, own, second, time, step, z, theta, dz):
    """z holds the stem, the direction of its slide, the argument before, and last whether they have begun."""
    stick, slip = theta[0], theta[0] * theta[1]
    stem, direction, before = argument + theta[3] * 0.5 * (stick + slip), 0.0, argument
    if z[3] > 0.0:
        stem, direction, before = z[0], z[1], z[2]
    stem, direction = _stem_after(argument - before, argument, stem, direction, stick, slip, theta[2], True)
    dz[0], dz[1], dz[2], dz[3] = stem, direction, argument, 1.0
    return stem - argument


def _stiction_transform(signal, second, dt, theta, first):
    return by_pieces(_stiction_run, signal, first, theta[0], theta[0] * theta[1], theta[2], theta[3])


def _stiction_starts(setting: Setting) -> np.ndarray:
    """Bands from a fiftieth of the spread up, closely, since a fit does not get past many jumps."""
    bands = np.array([0.02, 0.04, 0.08, 0.16, 0.32, 0.64]) * spread(setting.argument)
    rows = np.concatenate([grid(bands, [0.3, 1.0], [0.0], [0.0]), grid(bands, [0.3, 0.7], [1.0], [0.0])])
    return telling(setting, rows[rows[:, 0] > 0], _stiction_transform)


def _backlash_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return plays(argument, *np.unique([_radius(theta[1], theta[2], j) for j in range(N_GAPS)]))


def _dead_zone_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_level("past_dead_zone", _past_dead_zone, theta[:4], argument)


def _clearance_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_level("past_gap", _past_gap_of_level, theta[1:], argument)


def _valve_stiction_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return plays(argument, 0.5 * theta[0])


CLEARANCE = (
    Effect(
        code="backlash",
        title="Backlash",
        sentence="At every reversal some motion is lost before the other side is touched again.",
        equation="P_b[s] at an input (k = 1, all of the motion is lost); k (P_b[x] - x) in a state "
        "equation; P_b is the play of half-width b, the mean of four from (1 - 3 r/4) b to (1 + 3 r/4) b, as "
        "where the parts give way; at first it is i half-widths off",
        parameters=(
            EffectParameter("k", "{port}/({arg})", 0.0, at_input=1.0),
            EffectParameter("b", "{arg}", 0.0),
            EffectParameter("r", "-", 0.0, 1.0),
            BEGIN,
        ),
        begin=3,
        starts=_backlash_starts,
        force=_backlash,
        transform=_backlash_transform,
        handed_on=_backlash,
        output_port=False,
        argument="any",
        n_memory=N_GAPS + 1,
        jumps=True,
        met_on="motion",
        met_at="input",
        lookalikes=(
            "coulomb_friction",
            "dead_zone",
            "delay",
            "valve_stiction",
            "prandtl_ishlinskii",
            "bouc_wen_hysteresis",
            "clearance",
        ),
        separate_by="slow reversals at two rates and two amplitudes",
        source="Tao and Kokotovic 1996, Adaptive Control of Systems with Actuator and Sensor Nonlinearities",
        phi=_backlash_phi,
        valleys=64,
    ),
    Effect(
        code="dead_zone",
        title="Dead zone",
        sentence="Small commands, or small changes about a level, do nothing.",
        equation="c for |s - c| < d, s - d sgn(s - c) outside; all of it less c where o = 1, so that nothing "
        "passes inside; edges rounded over w",
        parameters=(
            EffectParameter("d", "{port}", 0.0),
            EffectParameter("c", "{port}"),
            EffectParameter("w", "{port}", 0.0),
            EffectParameter("o", "-", 0.0, 1.0),
        ),
        choice=3,
        starts=_dead_zone_starts,
        limits=_dead_zone_limits,
        transform=_dead_zone_transform,
        handed_on=_dead_zone_handed_on,
        output_port=False,
        amplitude=None,
        acts_in=_within_zone,
        lookalikes=("backlash", "coulomb_friction", "valve_stiction"),
        separate_by="the same input repeated about an offset",
        source="Tao and Kokotovic 1996, Adaptive Control of Systems with Actuator and Sensor Nonlinearities",
        phi=_dead_zone_phi,
    ),
    Effect(
        code="clearance",
        title="Clearance or end stop",
        sentence="Nothing is felt inside a gap; beyond it a spring is hit.",
        equation="0 for |x - c| < g, -k (x - c - g sgn(x - c)) outside; in a coupling (k = 1) it passes "
        "x - c - g sgn(x - c)",
        parameters=(
            EffectParameter("k", "{port}/({arg})", 0.0, at_input=1.0),
            EffectParameter("g", "{arg}", 0.0),
            EffectParameter("c", "{arg}"),
        ),
        starts=_clearance_starts,
        force=_clearance,
        handed_on=_clearance_handed_on,
        in_coupling=Name(
            "backlash", "Backlash", "There is lost motion between the two: inside a gap nothing is passed on."
        ),
        argument="position",
        acts_in=_beyond_gap,
        met_on="motion",
        lookalikes=("cubic_stiffness", "backlash", "bilinear_stiffness"),
        holds=("bilinear_stiffness", "linear_stiffness"),
        separate_by="amplitudes below and above the gap",
        source="Shaw and Holmes 1983, J. Sound Vib. 90(1), eq. (1)",
        phi=_clearance_phi,
    ),
    Effect(
        code="valve_stiction",
        title="Sticking valve",
        sentence="The stem holds until the command has moved far enough, then jumps.",
        equation="held until the command has moved by S, then a jump by J = j S, then s - (S - J)/2 sgn(v), "
        "held again in between while it is less than a J ahead of that; at first i (S + J)/2 off",
        parameters=(
            EffectParameter("S", "{port}", 0.0),
            EffectParameter("j", "-", 0.0, 1.0),
            EffectParameter("a", "-", 0.0, 1.0),
            BEGIN,
        ),
        begin=3,
        starts=_stiction_starts,
        transform=_stiction_transform,
        handed_on=_stiction_handed_on,
        output_port=False,
        amplitude=None,
        n_memory=4,
        jumps=True,
        lookalikes=("backlash", "dead_zone", "stuck_sensor", "quantisation"),
        holds=("backlash",),
        separate_by="a bump test in manual, and another controller gain",
        source="Choudhury, Thornhill and Shah 2005, Control Eng. Pract. 13(5), sec. 4, in S and J (a = 0); "
        "He, Wang, Pottmann and Qin 2007, Ind. Eng. Chem. Res. 46(13) (a = 1)",
        phi=_valve_stiction_phi,
        valleys=256,
    ),
)

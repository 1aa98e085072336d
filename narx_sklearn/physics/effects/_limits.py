"""Limits: of an input, of its rate, of a level, of a sensor."""

from typing import Any

import numpy as np

from narx_sklearn.model.phi import Phi
from narx_sklearn.physics.effects._corner import between, kept_between
from narx_sklearn.physics.effects._curves import of_difference, of_level
from narx_sklearn.physics.effects._effect import LACKING, Effect, EffectParameter, PutOut, Setting
from narx_sklearn.physics.effects._kernel import kernel
from narx_sklearn.physics.effects._series import by_pieces
from narx_sklearn.physics.effects._starts import DRY, grid, quantiles, scaled, spread, telling

NARROW, BEGINNING, WIDE = 0.05, 0.1, 0.25  # widths of a knee, as shares of the signal's range
BEYOND = (0.0, 0.25)  # of the range, that levels may lie beyond it and still bend it
LEVELS_TRIED = 200  # on either side
FELT = 0.01  # share of a first command that is lacking: of what is caught up in no time nothing has a slope
ONE_WAY = 0.3  # by which a limit is tighter one way, and looser the other
OVER_EDGE, FROM_ORIFICE_TO_NOTCH = 1.5, (0.4, 2.6)  # power of the head above a rim, and between which it is
SLIM = 1e-4  # of the width: levels no further apart already give 2 w tanh((s - m)/(2 w))


def _saturated(level, low, high, w):
    """Return the rounded clip with unit slope in the middle: small signals pass as they are."""
    if not w > 0:
        return between(level, low, high)
    middle, half = 0.5 * (low + high), max(0.5 * abs(high - low), SLIM * w)
    with np.errstate(over="ignore"):  # so narrow a knee leaves the slope alone
        slope = np.tanh(0.5 * half / w)
    return middle + (between(level, middle - half, middle + half, w) - middle) / slope


def _saturation_transform(signal, second, dt, theta, first):
    return _saturated(signal, theta[0], theta[1], theta[2])


@kernel
def _saturation_handed_on(argument, rate, own, second, time, step, z, theta, dz):
    low, high, w = theta[0], theta[1], theta[2]
    if not w > 0.0:
        return kept_between(argument, low, high, 0.0) - argument
    middle, half = 0.5 * (low + high), max(0.5 * abs(high - low), SLIM * w)
    slope = np.tanh(0.5 * half / w)
    return middle + (kept_between(argument, middle - half, middle + half, w) - middle) / slope - argument


def _saturation_starts(setting: Setting) -> np.ndarray:
    """Both levels or one alone, with a narrow knee; levels that only just show; a gradual loss."""
    lowest, highest = quantiles(setting.argument, [0.0, 1.0])
    rows = np.column_stack([_levels(setting), np.full(5, NARROW * (highest - lowest))])
    beginning = [
        [
            lowest - far * (highest - lowest),
            highest + far * (highest - lowest),
            BEGINNING * (highest - lowest),
        ]
        for far in BEYOND
    ]
    gradual = [*quantiles(setting.argument, [0.1, 0.9]), WIDE * (highest - lowest)]
    return telling(setting, np.vstack([rows, *beginning, gradual]), _saturation_transform)


def _saturation_limits(setting: Setting) -> np.ndarray:
    """Keep the knee no wider than twice the range, beyond which it bends nothing, and the levels in sight."""
    lowest, highest = quantiles(setting.argument, [0.0, 1.0])
    reach = 2 * (highest - lowest)
    return np.array([[lowest - reach, highest], [lowest, highest + reach], [0.0, reach]])


def _clip_transform(signal, second, dt, theta, first):
    return between(signal, theta[0], theta[1])


def _beyond_range(theta):
    low, high = theta
    return (-np.inf, low), (high, np.inf)


def _clip_starts(setting: Setting) -> np.ndarray:
    return telling(setting, _levels(setting), _clip_transform)


def _clip_scan(setting: Setting, residual: np.ndarray) -> tuple[np.ndarray, int]:
    """Clip the simulated signal at every level, from above and from below."""
    signal = setting.argument
    lowest, middle, highest = quantiles(signal, [0.0, 0.5, 1.0])
    if not np.all(np.isfinite(residual)) or not highest > lowest:
        return np.empty((0, 2)), 0
    reach = 2 * (highest - lowest)
    best = []
    for end, sign in ((lowest, -1.0), (highest, 1.0)):
        levels = np.linspace(middle, end, LEVELS_TRIED, endpoint=False)
        gain = []
        for level in levels:
            beyond = sign * (signal - level) > 0
            missed = residual[beyond] + signal[beyond] - level
            gain.append(residual[beyond] @ residual[beyond] - missed @ missed)
        best.append(float(levels[np.argmax(gain)]))
    rows = np.array([best, [best[0], highest + reach], [lowest - reach, best[1]]])
    return telling(setting, rows, _clip_transform), 2 * LEVELS_TRIED


def _levels(setting: Setting) -> np.ndarray:
    """Return both levels, then one alone, (5, 2); the other is then out of reach, by twice the range."""
    lowest, highest = quantiles(setting.argument, [0.0, 1.0])
    reach = 2 * (highest - lowest)
    both = [quantiles(setting.argument, [1 - share, share]) for share in (0.75, 0.9, 0.97)]
    low, high = quantiles(setting.argument, [0.15, 0.85])
    return np.array([*both, [low, highest + reach], [lowest - reach, high]])


@kernel
def _rate_limit_run(values, up, down, lacking):
    """Follow values by at most so much a sample either way; return where each step begins.

    At first a share of the first value is ``lacking``.
    """
    begins = np.empty(values.size)
    at = values[0] * (1.0 - lacking)
    for k in range(values.size):
        begins[k] = at
        at += min(max(values[k] - at, -down), up)
    return begins


def _rate_limit_held(signal, dt, theta, first):
    """Ramp to each value, which steps at its sample, and stay there until the next one.

    Code limits a command before it is held: it is at once where the ramp gets to.
    """
    (up, down), digital = _either_way(theta, dt), theta[2]
    begins = by_pieces(_rate_limit_run, signal, first, up, down, theta[1])
    move = np.clip(signal - begins, -down, up)
    most = np.where(move > 0.0, up, down)
    # share of the step that it takes
    ramp = np.divide(np.abs(move), most, out=np.zeros_like(move), where=most > 0.0)
    lacking = (1.0 - digital) * 0.5 * ramp * move
    return begins + move - lacking, (1.0 - digital) * ramp * (3.0 - 2.0 * ramp) * move


def _either_way(theta, dt: float) -> tuple[float, float]:
    """Return by how much a signal rises and falls in a time at most; the same unless parameters say more."""
    more = theta[3] if len(theta) > 3 else 0.0
    return theta[0] * (1.0 + more) * dt, theta[0] * (1.0 - more) * dt


def _rate_limit_transform(signal, second, dt, theta, first):
    return _rate_limit_held(signal, dt, theta, first)[0]


def _limited_difference(now, before, up, down):
    return np.clip(now - before, -down, up)


def _rate_limit_starts(setting: Setting) -> np.ndarray:
    moves = np.abs(np.diff(setting.argument)) / setting.dt
    moves[setting.first[setting.first > 0] - 1] = np.nan  # from one session to the next nothing moves
    moves = moves[np.isfinite(moves) & (moves > 0)]
    if moves.size == 0:
        return np.empty((0, 3))
    # steps show a limit as ramps of some samples, or within one; a smooth record near its fastest slopes
    limits = np.unique(
        np.concatenate(
            [np.quantile(moves, [0.5, 0.75, 0.95]), np.array([0.05, 0.3, 0.9, 2.0, 8.0]) * moves.max()]
        )
    )
    # code that seldom limits leaves all other moves alone, which parts do not
    rows = np.vstack([grid(limits, [FELT], [0.0]), [0.9 * moves.max(), FELT, 1.0]])
    return telling(setting, rows, _rate_limit_transform)


def _asymmetric_rate_limit_starts(setting: Setting) -> np.ndarray:
    """Return every other limit, of one way alone at first: the other way it is higher."""
    rows = _rate_limit_starts(setting)[1::2]
    rows[:, 0] /= 1.0 - ONE_WAY
    return np.vstack([np.column_stack([rows, np.full(len(rows), more)]) for more in (-ONE_WAY, ONE_WAY)])


@kernel
def _kept_to(rate, up, down):
    return min(max(rate, -down), up)


@kernel
def _rate_limit_following(argument, rate, own, second, time, step, z, theta, dz):
    return _kept_to(own, theta[0], theta[0]) - own


@kernel
def _asymmetric_following(argument, rate, own, second, time, step, z, theta, dz):
    return _kept_to(own, theta[0] * (1.0 + theta[3]), theta[0] * (1.0 - theta[3])) - own


@kernel
def _passed_on(argument, up, down, step, z, dz):
    """z holds what is passed, which comes to the argument where a step takes it there."""
    behind = argument - z[0]
    dz[0] = _kept_to(behind / step, up, down)
    return -behind if behind > up * step or behind < -down * step else 0.0


@kernel
def _rate_limit_put_out(argument, rate, own, second, time, step, z, theta, dz):
    return _passed_on(argument, theta[0], theta[0], step, z, dz)


@kernel
def _asymmetric_put_out(argument, rate, own, second, time, step, z, theta, dz):
    return _passed_on(argument, theta[0] * (1.0 + theta[3]), theta[0] * (1.0 - theta[3]), step, z, dz)


@kernel
def _overflow(argument, rate, own, second, time, step, z, theta, dz):
    """Take away what one step would lift above the limit, and never more than flows in."""
    return -min(max((argument - theta[0]) / step + own, 0.0), max(own, 0.0))


def _at_rim(theta):
    return ((theta[0], np.inf),)


def _overflow_starts(setting: Setting) -> np.ndarray:
    if spread(setting.argument) == 0 or not quantiles(setting.own, 1.0) > 0:
        return np.empty((0, 1))
    return grid(np.unique(quantiles(setting.argument, [0.7, 0.85, 0.95, 0.99, 0.999])))


@kernel
def _spill(argument, rate, own, second, time, step, z, theta, dz):
    head = max(argument - theta[1], 0.0)
    # near the rim one step takes no more than there is above it
    return -min(theta[0] * head ** theta[2], head / step)


def _spilt(level, rim, n):
    return np.maximum(level - rim, 0.0) ** n


def _above_rim(theta):
    return ((theta[1], np.inf),)


def _spill_starts(setting: Setting) -> np.ndarray:
    if spread(setting.argument) == 0:
        return np.empty((0, 3))
    rows = grid([1.0], np.unique(quantiles(setting.argument, [0.2, 0.5, 0.7, 0.85, 0.95])), [OVER_EDGE])
    return scaled(setting, rows, lambda row: _spilt(setting.argument, *row[1:]))


def _spill_limits(setting: Setting) -> np.ndarray:
    """Keep the rim where the level goes: below nearly all of it is an outlet, above it nothing spills."""
    return np.array([[0.0, np.inf], quantiles(setting.argument, [DRY, 1.0]), FROM_ORIFICE_TO_NOTCH])


def _above(now, before, level):
    return np.maximum(now - level, 0.0) * (now > before)


def _input_saturation_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_level("saturation", _saturated, theta[:3], argument)


def _sensor_clip_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_level("clip", between, theta[:2], argument)


def _rate_limit_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_difference("limited_difference", _limited_difference, _either_way(theta, dt), argument)


def _overflow_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_difference("above_rim", _above, theta[:1], argument)


def _spill_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_level("spilt", _spilt, theta[1:], argument)


_AT_FIRST = "at first a share i of the command is lacking (below 0: it is more), all of it from rest at zero"
_OF_RATE_LIMIT = EffectParameter("r", "{port}/s", 0.0), LACKING, EffectParameter("d", "-", 0.0, 1.0)
_RATE_LIMITED: dict[str, Any] = {
    "begin": 1,
    "choice": 2,
    "transform": _rate_limit_transform,
    "held": _rate_limit_held,
    "output_port": False,
    "amplitude": None,
    "source": "Duda 1998, J. Guid. Control Dyn. 21(5)",
    "phi": _rate_limit_phi,
}

LIMITS = (
    Effect(
        code="input_saturation",
        title="Saturation of the input",
        sentence="Towards a level the drive gives less and less, and beyond it no more.",
        equation="min(max(s, low), high) where w = 0; else m + (low + w log((1 + exp((s - low)/w))"
        "/(1 + exp((s - high)/w))) - m)/tanh((high - low)/(4 w)), m = (low + high)/2",
        parameters=(
            EffectParameter("low", "{port}"),
            EffectParameter("high", "{port}"),
            EffectParameter("w", "{port}", 0.0),
        ),
        starts=_saturation_starts,
        limits=_saturation_limits,
        transform=_saturation_transform,
        handed_on=_saturation_handed_on,
        output_port=False,
        amplitude=None,
        levels=(0, 1),
        lookalikes=("sensor_clip", "input_polynomial", "cubic_stiffness", "rate_limit", "bilinear_input"),
        separate_by="an amplitude ladder",
        source="Tao and Kokotovic 1996, Adaptive Control of Systems with Actuator and Sensor Nonlinearities",
        phi=_input_saturation_phi,
    ),
    Effect(
        code="rate_limit",
        title="Rate limit",
        sentence="The drive cannot follow fast commands.",
        equation="|ds/dt| <= r where d = 0, from sample to sample alone, |s[k] - s[k-1]| <= r dt, where "
        f"d = 1; {_AT_FIRST}",
        parameters=_OF_RATE_LIMIT,
        starts=_rate_limit_starts,
        put_out=PutOut(_rate_limit_put_out, n_memory=1),
        following=_rate_limit_following,
        lookalikes=("lag", "delay", "input_saturation", "asymmetric_rate_limit"),
        separate_by="equal slews at different amplitudes",
        **_RATE_LIMITED,
    ),
    Effect(
        code="asymmetric_rate_limit",
        title="Rate limit, another one each way",
        sentence="The drive cannot follow fast commands, one way less than the other.",
        equation="-r (1 - a) <= ds/dt <= r (1 + a) where d = 0; from sample to sample alone, s[k] - s[k-1] "
        f"between these times dt, where d = 1; {_AT_FIRST}",
        parameters=(*_OF_RATE_LIMIT, EffectParameter("a", "-", -1.0, 1.0)),
        starts=_asymmetric_rate_limit_starts,
        put_out=PutOut(_asymmetric_put_out, n_memory=1),
        following=_asymmetric_following,
        lookalikes=("rate_limit", "lag", "constant_load"),
        holds=("rate_limit",),
        separate_by="equal slews up and down",
        **_RATE_LIMITED,
    ),
    Effect(
        code="overflow",
        title="Overflow",
        sentence="Above the rim whatever flows in is lost, or spills onward.",
        equation="-max(s', 0) while s >= h",
        parameters=(EffectParameter("h", "{arg}"),),
        starts=_overflow_starts,
        force=_overflow,
        amplitude=None,
        acts_in=_at_rim,
        after=True,
        last=True,
        onward=True,
        met_on="levels",
        lookalikes=("sensor_clip", "root_outflow", "clearance"),
        separate_by="timing the fall after the flat top",
        source="Schoukens and Noel 2017, IFAC-PapersOnLine 50(1), sec. 4 (cascaded tanks)",
        phi=_overflow_phi,
    ),
    Effect(
        code="spill",
        form_of="overflow",
        title="Overflow that rises with the level",
        sentence="Above a rim it spills, the more the higher it stands.",
        equation="-c max(x - h, 0)^n; n = 3/2 over an edge, 5/2 through a notch, 1/2 into a pipe, about 1 "
        "past a relief valve",
        parameters=(
            EffectParameter("c", "{port}/({arg})^n", 0.0),
            EffectParameter("h", "{arg}"),
            EffectParameter("n", "-", *FROM_ORIFICE_TO_NOTCH),
        ),
        starts=_spill_starts,
        limits=_spill_limits,
        force=_spill,
        acts_in=_above_rim,
        onward=True,
        met_on="levels",
        lookalikes=("sensor_clip", "root_outflow", "clearance", "quadratic_stiffness"),
        separate_by="timing the fall from above the rim",
        source="Bos 1989, Discharge Measurement Structures, ILRI Publication 20 (weirs by the shape of their "
        "control section)",
        phi=_spill_phi,
    ),
    Effect(
        code="sensor_clip",
        title="Clipped sensor",
        sentence="The sensor does not show what lies beyond its range.",
        equation="min(max(s, low), high)",
        parameters=(EffectParameter("low", "{port}"), EffectParameter("high", "{port}")),
        starts=_clip_starts,
        transform=_clip_transform,
        input_port=False,
        amplitude=None,
        levels=(0, 1),
        acts_in=_beyond_range,
        lookalikes=("input_saturation", "overflow"),
        scan=_clip_scan,
        separate_by="counting values at the flat top, and timing the fall after it",
        source="Tao and Kokotovic 1996, Adaptive Control of Systems with Actuator and Sensor Nonlinearities",
        phi=_sensor_clip_phi,
    ),
)

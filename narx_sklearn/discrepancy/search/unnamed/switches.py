"""Laws without a name that switch with hysteresis: on beyond one threshold, off again beyond another.

A snap switch, a relay, a thermostat, a valve that hangs. Between the thresholds the side on which it stands
is the one that was reached last, kept along the run. The cost has no slope towards a threshold: both are
chosen among values that the signal takes, and pay as what is chosen.
"""

from functools import partial
from itertools import combinations

import numpy as np

from narx_sklearn.discrepancy.search.unnamed.kinds import SWITCHED, SWITCHED_GAIN, WORDS
from narx_sklearn.physics.effects import Effect, EffectParameter, Setting
from narx_sklearn.physics.effects._effect import BEGIN
from narx_sklearn.physics.effects._kernel import kernel
from narx_sklearn.physics.effects._series import by_pieces
from narx_sklearn.physics.effects._starts import quantiles, scaled

LEVELS = 7  # of a signal, evenly over its samples, of which any two are tried as thresholds
BOTH_WAYS = 0.01  # share of the samples between two thresholds with the switch on either side, at least
HIGH, LOW, AT_FIRST = 1, 2, 3  # indices of parameters


@kernel
def _side(value, before, high, low):
    """Return the side of a switch, 1 or -1: beyond which threshold its signal was last."""
    if value > high:
        return 1.0
    if value < low:
        return -1.0
    return before


@kernel
def _sides_run(values, high, low, begin):
    """Return the side of a switch at each sample of a signal."""
    out = np.empty(values.size)
    side = begin
    for k in range(values.size):
        side = _side(values[k], side, high, low)
        out[k] = side
    return out


@kernel
def _side_kept(argument, z, theta, dz):
    """Return the side on which a step began, and keep that to which the next goes.

    z[0] is the side, z[1] tells that it has begun. What was crossed within a step would be forgotten by the
    next, and a switch would slide along its threshold.
    """
    high, low = theta[HIGH], theta[LOW]
    side = z[0] if z[1] > 0.0 else _side(argument, theta[AT_FIRST], high, low)
    dz[0], dz[1] = _side(argument, side, high, low), 1.0
    return side


@kernel
def _switched(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * _side_kept(argument, z, theta, dz) + theta[4] + theta[5] * argument


@kernel
def _switched_gain(argument, rate, own, second, time, step, z, theta, dz):
    return (theta[0] * _side_kept(argument, z, theta, dz) + theta[4]) * argument


def sides(signal: np.ndarray, first: np.ndarray, high: float, low: float, begin: float = 0.0) -> np.ndarray:
    """Return the side of a switch along a record, 1 or -1, and ``begin`` before any threshold was crossed.

    Parameters
    ----------
    first : ndarray of int
        Indices at which the signal begins anew, and the switch with it.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.search.unnamed.switches import sides
    >>> sides(np.array([0.0, 2.0, 0.0, -2.0, 0.0]), np.array([0]), 1.0, -1.0).tolist()
    [0.0, 1.0, 1.0, -1.0, -1.0]
    """
    return by_pieces(_sides_run, signal, first, high, low, begin)


def _switched_transform(signal, second, dt, theta, first):
    a, high, low, begin, b, c = theta[:6]
    return signal + a * sides(signal, first, high, low, begin) + b + c * signal


def _switched_gain_transform(signal, second, dt, theta, first):
    a, high, low, begin, b = theta[:5]
    return signal * (1.0 + b + a * sides(signal, first, high, low, begin))


def _thresholds(setting: Setting) -> list[tuple[float, float]]:
    """Return pairs of thresholds, the higher first, between which a signal is with the switch on either side.

    Else it would be a curve.
    """
    signal = setting.argument
    shares = np.arange(1, LEVELS + 1) / (LEVELS + 1)
    found = []
    for low, high in combinations(np.unique(quantiles(signal, shares)).tolist(), 2):
        between = sides(signal, setting.first, high, low)[(low <= signal) & (signal <= high)]
        if min(np.sum(between > 0), np.sum(between < 0)) > BOTH_WAYS * signal.size:
            found.append((high, low))
    return found


def _starts(setting: Setting, rest: int, gain: bool) -> np.ndarray:
    """Any two levels as thresholds, nothing in the ``rest`` of the parameters."""
    rows = np.array([[1.0, *pair, *[0.0] * rest] for pair in _thresholds(setting)]).reshape(-1, 3 + rest)

    def added(row: np.ndarray) -> np.ndarray:
        side = sides(setting.argument, setting.first, row[HIGH], row[LOW])
        return side * setting.argument if gain else side

    return scaled(setting, rows, added)


def _limits(setting: Setting, n: int) -> np.ndarray:
    """Keep both thresholds within what the signal reaches."""
    limits = np.tile([-np.inf, np.inf], (n, 1))
    limits[[HIGH, LOW]] = quantiles(setting.argument, [0.0, 1.0])
    return limits


def _law(code: str, equation: str, amplitude: EffectParameter, besides, force, transform) -> Effect:
    """Return a law that switches, of the size of a jump and of what acts ``besides``, on either side."""
    parameters = (
        amplitude,
        EffectParameter("high", "{arg}"),
        EffectParameter("low", "{arg}"),
        BEGIN,
        *besides,
    )
    return Effect(
        code=code,
        title=WORDS[code].title,
        sentence=WORDS[code].sentence,
        equation=f"{equation}; z is 1 once x > high, -1 once x < low, at first i",
        parameters=parameters,
        starts=partial(_starts, rest=1 + len(besides), gain=code == SWITCHED_GAIN),
        limits=partial(_limits, n=len(parameters)),
        force=force,
        transform=transform,
        argument="any",
        chosen=(HIGH, LOW),
        begin=AT_FIRST,
        spare=tuple(range(AT_FIRST + 1, len(parameters))),
        n_memory=2,
        jumps=True,
        separate_by="slow ramps up and down, that turn between the thresholds and beyond them",
        source="Visintin 1994, Differential Models of Hysteresis, sec. VI.1 (the delayed relay)",
    )


SWITCHES = (
    _law(
        SWITCHED,
        "a z + b + c x",
        EffectParameter("a", "{port}"),
        (EffectParameter("b", "{port}"), EffectParameter("c", "{port}/({arg})")),
        _switched,
        _switched_transform,
    ),
    _law(
        SWITCHED_GAIN,
        "(a z + b) x",
        EffectParameter("a", "{port}/({arg})"),
        (EffectParameter("b", "{port}/({arg})"),),
        _switched_gain,
        _switched_gain_transform,
    ),
)
"""At every kind of port, as entries of a catalogue: where and from which values they are tried."""

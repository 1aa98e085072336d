"""Laws without a name that remember what went through an input or a sensor, or moved, before.

A gain that goes with how hard a signal worked (a supply that sags), a coefficient of the equations that does
(a resistance that warms up, a paste that is stirred thin), a lag that is slower one way than the other, a
reading that depends on where it last turned. What they are, and not why, is told.
"""

from functools import partial

import numpy as np

from narx_sklearn.discrepancy.search.unnamed.kinds import (
    AFTER_SQUARE,
    AFTER_WORK,
    LOOP,
    TWO_SPEEDS,
    WORDS,
    WORKED,
    WORKED_BY_SQUARE,
)
from narx_sklearn.physics.effects import CATALOGUE, Effect, EffectParameter, Setting
from narx_sklearn.physics.effects._dynamics import SHORT, moments_of_decay, times_of_lag, weights_along_line
from narx_sklearn.physics.effects._effect import LACKING
from narx_sklearn.physics.effects._kernel import kernel
from narx_sklearn.physics.effects._series import by_pieces
from narx_sklearn.physics.effects._starts import (
    grid,
    scaled,
    spread,
    time_constants,
    time_looked_at,
    time_scale,
    working_points,
)

APART = 4.0  # times as slow one way as the other, from which two speeds are tried
SIMPLEST = 1.0  # exponent n of a Bouc-Wen element: a loop of exponentials
BOUC_WEN = CATALOGUE["bouc_wen_hysteresis"]
MOST = 30.0  # logarithm of a gain, beyond which it only overflows
RUNAWAY = 0.9  # of what is forgotten, that memory may breed of itself in the mean
POINT, BEGIN = 2, 3  # r and i among the parameters of what goes with work
TOLD_BY = "the same small steps after rest and after hard work"
SLOW = 3  # times over which work is remembered, that are tried


@kernel
def _remembered_run(worked, decay, begin):
    """Return the exponential average of what came before each sample."""
    out = np.empty(worked.size)
    out[0] = begin
    for k in range(1, worked.size):
        out[k] = decay * out[k - 1] + (1.0 - decay) * worked[k - 1]
    return out


def _work(signal, dt, first, theta, power):
    """Return what is remembered of a power of how far a signal was off r, (n_samples,)."""
    _, T, r, begin = theta[:4]
    decay = np.exp(-dt / max(T, SHORT * dt))
    return by_pieces(_remembered_run, np.abs(signal - r) ** power, first, decay, begin)


def _worked_transform(signal, second, dt, theta, first, power):
    """Return a signal whose deviation from r has a gain that goes with the work remembered."""
    a, r = theta[0], theta[2]
    return r + (signal - r) * np.exp(np.minimum(a * _work(signal, dt, first, theta, power), MOST))


@kernel
def _left_by(off, work, time, step, z, theta, dz):
    """Return what a coefficient adds that goes with M; the second memory counts the work since M was i."""
    a, T, begin, k = theta[0], max(theta[1], SHORT * step), theta[3], theta[4]
    dz[0] = (work - (1.0 + k * work) * z[0]) / T
    dz[1] = work / T
    return a * off * (z[0] + begin * np.exp(min(-time / T - k * z[1], MOST)))


@kernel
def _after_work(argument, rate, own, second, time, step, z, theta, dz):
    off = argument - theta[POINT]
    return _left_by(off, abs(off), time, step, z, theta, dz)


@kernel
def _after_square(argument, rate, own, second, time, step, z, theta, dz):
    off = argument - theta[POINT]
    return _left_by(off, off * off, time, step, z, theta, dz)


def _starts_of_work(setting: Setting, times: np.ndarray, added, *others) -> np.ndarray:
    """Work remembered for some times, counted from zero and from the mean.

    ``added(row)`` is what the law adds along the record; ``others`` are values of its further parameters.
    """
    if spread(setting.argument) == 0:
        return np.empty((0, 4 + len(others)))
    return scaled(setting, grid([1.0], times, working_points(setting.argument), [0.0], *others), added)


def _worked_starts(setting: Setting, transform) -> np.ndarray:
    """Work remembered from a few samples to a fifth of the record."""

    def added(row: np.ndarray) -> np.ndarray:
        return transform(setting.argument, None, setting.dt, row, setting.first) - setting.argument

    return _starts_of_work(setting, time_constants(setting, SLOW + 1)[1:], added)


def _coefficient_starts(setting: Setting, power: int) -> np.ndarray:
    """Work remembered for longer than the signal moves one way, to a fifth of the record."""
    times = time_constants(setting, 2)[1:]
    if times.size:
        times = np.geomspace(min(time_scale(setting), times[0]), times[0], SLOW + 1)[1:]

    def added(row: np.ndarray) -> np.ndarray:
        work = _work(setting.argument, setting.dt, setting.first, row, power)
        return row[0] * (setting.argument - row[2]) * work

    return _starts_of_work(setting, times, added, [0.0])


def _worked_limits(setting: Setting) -> np.ndarray:
    """Longer than a sample, or it is a curve; forgotten within the time looked at, or it is a drift."""
    limits = np.tile([-np.inf, np.inf], (4, 1))
    limits[1] = setting.dt, max(time_looked_at(setting), setting.dt)
    return limits


def _of_work(power: int, per: str) -> tuple[tuple[EffectParameter, ...], str]:
    """Return the parameters of a law after work, a in a unit per work, and how that is written."""
    unit = f"{{arg}}{f'^{power}' * (power > 1)}"
    parameters = (
        EffectParameter("a", per.format(work=unit, port="{port}", arg="{arg}")),
        EffectParameter("T", "s", 0.0),
        EffectParameter("r", "{arg}"),
        EffectParameter("i", unit, 0.0),
    )
    return parameters, f"|{{}} - r|{f'^{power}' * (power > 1)}"


def _worked(code: str, power: int) -> Effect:
    """Return a gain, of an input or a sensor, that goes with how far the signal was off a point."""
    parameters, work = _of_work(power, "1/({work})")
    transform = partial(_worked_transform, power=power)
    return Effect(
        code=code,
        title=WORDS[code].title,
        sentence=WORDS[code].sentence,
        equation=f"r + (s - r) exp(a M), T M' = {work.format('s')} - M, at first M = i",
        parameters=parameters,
        starts=partial(_worked_starts, transform=transform),
        limits=_worked_limits,
        transform=transform,
        begin=BEGIN,
        references=(POINT,),
        separate_by=TOLD_BY,
    )


def _coefficient(code: str, power: int, force, argument: str) -> Effect:
    """Return a coefficient, of a state equation, that goes with such work.

    With k = 0 it goes in proportion. A structure that work breaks down, the less the less there is of it
    (k > 0; Moore 1959), and a resistance that warms up the more for being warm (k < 0) are all of this kind:
    1 - k M is the structure left, or what it has become.
    """
    parameters, work = _of_work(power, "{port}/(({arg})*({work}))")
    return Effect(
        code=code,
        title=WORDS[code].title,
        sentence=WORDS[code].sentence,
        equation=f"a M (x - r), T M' = {work.format('x')} (1 - k M) - M, at first M = i",
        parameters=(*parameters, EffectParameter("k", f"1/({parameters[BEGIN].unit})")),
        starts=partial(_coefficient_starts, power=power),
        limits=partial(_coefficient_limits, power=power),
        force=force,
        argument=argument,
        n_memory=2,
        spare=(4,),
        source="Moore 1959, Trans. Brit. Ceram. Soc. 58",
        begin=BEGIN,
        references=(POINT,),
        separate_by=TOLD_BY,
    )


def _coefficient_limits(setting: Setting, power: int) -> np.ndarray:
    """Longer than the signal moves one way, or it is a curve; work breeds no more than is forgotten."""
    limits = _worked_limits(setting)
    limits[1, 0] = min(max(time_scale(setting), limits[1, 0]), limits[1, 1])
    off = np.abs(setting.argument[np.isfinite(setting.argument)]) ** power
    breeds = RUNAWAY / off.mean() if off.any() else np.inf
    return np.vstack([limits, [-breeds, np.inf]])


@kernel
def _two_speeds_run(values, up, down, lacking):
    """Return where a lag of two speeds stands at each sample of a signal held from each to the next."""
    out = np.empty(values.size)
    out[0] = values[0] * (1.0 - lacking)
    for k in range(1, values.size):
        behind = out[k - 1] - values[k - 1]
        out[k] = values[k - 1] + behind * (up if behind < 0.0 else down)
    return out


@kernel
def _two_speeds_along_lines_run(values, dt, up, down, lacking):
    """Return the same of a signal that is straight from sample to sample: its speed is that of the middle."""
    out = np.empty(values.size)
    out[0] = values[0] * (1.0 - lacking)
    for k in range(1, values.size):
        ahead = 0.5 * (values[k - 1] + values[k]) - out[k - 1]
        kept, old, new = weights_along_line(dt / (up if ahead > 0.0 else down))
        out[k] = kept * out[k - 1] + old * values[k - 1] + new * values[k]
    return out


def _two_speeds_transform(signal, second, dt, theta, first):
    up, down = np.maximum(theta[:2], SHORT * dt)
    return by_pieces(_two_speeds_along_lines_run, signal, first, dt, up, down, theta[2])


def _two_speeds_held(signal, dt, theta, first):
    """Follow each value of a held signal exponentially: on the way there the speed stays."""
    up, down = dt / np.maximum(theta[:2], SHORT * dt)
    behind = by_pieces(_two_speeds_run, signal, first, np.exp(-up), np.exp(-down), theta[2]) - signal
    (mean_up, moment_up), (mean_down, moment_down) = moments_of_decay(up), moments_of_decay(down)
    rises = behind < 0
    mean, moment = np.where(rises, mean_up, mean_down), np.where(rises, moment_up, moment_down)
    return signal + mean * behind, 12.0 * moment * behind


def _two_speeds_starts(setting: Setting) -> np.ndarray:
    """Lags of some shares of the signal's time scale, slower up or slower down."""
    slow = times_of_lag(setting, (0.05, 0.2, 1.0, 5.0))
    pairs = np.concatenate([np.column_stack([slow, slow / APART]), np.column_stack([slow / APART, slow])])
    return np.column_stack([pairs, np.zeros(len(pairs))])


def _loop_transform(signal, second, dt, theta, first):
    k, zy, r = theta[:3]
    return BOUC_WEN.transform(signal, second, dt, (-k, zy, r, SIMPLEST, 0.0), first)


def _loop_starts(setting: Setting) -> np.ndarray:
    """Those of a Bouc-Wen element, of its simplest form."""
    rows = BOUC_WEN.starts(setting)
    return rows[rows[:, 3] == SIMPLEST, :3] if len(rows) else np.empty((0, 3))


MEMORIES = (
    _worked(WORKED, 1),
    _worked(WORKED_BY_SQUARE, 2),
    Effect(
        code=TWO_SPEEDS,
        title=WORDS[TWO_SPEEDS].title,
        sentence=WORDS[TWO_SPEEDS].sentence,
        equation="T s_out' = s - s_out, with T = T1 while it rises and T2 while it falls; at first a share i "
        "of the signal is lacking (below 0: it is more)",
        parameters=(EffectParameter("T1", "s", 0.0), EffectParameter("T2", "s", 0.0), LACKING),
        begin=2,
        starts=_two_speeds_starts,
        transform=_two_speeds_transform,
        held=_two_speeds_held,
        amplitude=None,
        separate_by="steps up and down",
    ),
    Effect(
        code=LOOP,
        title=WORDS[LOOP].title,
        sentence=WORDS[LOOP].sentence,
        equation="s + k z, z' = v - v (sgn(v z) + r) |z|/zy, v = ds/dt",
        parameters=(EffectParameter("k", "-"), *BOUC_WEN.parameters[1:3]),
        starts=_loop_starts,
        transform=_loop_transform,
        input_port=False,
        separate_by="loops of several sizes, at two rates",
        source="Wen 1976, J. Eng. Mech. Div. ASCE 102(2), with n = 1",
    ),
)
"""Laws at inputs and outputs, as entries of a catalogue: where and from which values they are tried."""

COEFFICIENTS = tuple(
    _coefficient(code, power, force, argument)
    for code, power, force in ((AFTER_WORK, 1, _after_work), (AFTER_SQUARE, 2, _after_square))
    for argument in ("own", "position")
)
"""The same of laws in state equations."""

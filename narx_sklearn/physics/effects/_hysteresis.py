"""Hysteresis with many reversals remembered, and creep."""

import numpy as np

from narx_sklearn.model.operators import play_step
from narx_sklearn.model.phi import AbsoluteDifference, DifferenceSign, Phi
from narx_sklearn.physics.effects._curves import plays
from narx_sklearn.physics.effects._dynamics import SHORT, weights_along_line
from narx_sklearn.physics.effects._effect import BEGIN, LACKING, Effect, EffectParameter, Setting, at_most
from narx_sklearn.physics.effects._kernel import kernel
from narx_sklearn.physics.effects._series import by_pieces
from narx_sklearn.physics.effects._starts import (
    at_signal,
    grid,
    quantiles,
    scaled,
    spread,
    time_constants,
    time_looked_at,
)

N_PLAYS = 10  # radii of the Prandtl-Ishlinskii model, evenly up to the largest
N_LAGS = 3  # slow poles of creep: half a decade apart they are close to log(t) over a decade and a half
FINEST_STEP = 0.1  # of the yield displacement, in which a Bouc-Wen element follows a sample's move
FORGOTTEN = 20.0  # bounds of z in one move, after which nothing is left of what was before
SOFT, HARD = 1 / 3, -1.5  # r of a loop that yields, and of one that hardens
REACH = 10.0  # zy: larger than any loop, and so near that no power of it overflows


@kernel
def _bouc_wen_bound(zy, r, n):
    """Return what |z| may not exceed: the yield at which loading ends, or the reach where none is near."""
    return zy * min((1.0 + r) ** (-1.0 / n), REACH) if r > -1.0 else REACH * zy


@kernel
def _bouc_wen_slope(z, direction, zy, r, n):
    """Return dz/dx of a Bouc-Wen element, moving up (1) or down (-1)."""
    along = direction if z > 0.0 else (-direction if z < 0.0 else 0.0)
    return 1.0 - (along + r) * min(abs(z) / zy, REACH) ** n


@kernel
def _bouc_wen(argument, rate, own, second, time, step, z, theta, dz):
    """The state holds how far z has come from where it began."""
    direction = 1.0 if rate > 0.0 else -1.0
    bound = _bouc_wen_bound(theta[1], theta[2], theta[3])
    now = z[0] + theta[4] * bound
    change = rate * _bouc_wen_slope(now, direction, theta[1], theta[2], theta[3])
    # one long step must not leave the bound
    dz[0] = min(max(change, (-bound - now) / step), (bound - now) / step)
    return -theta[0] * now


@kernel
def _bouc_wen_run(values, zy, r, n, begin):
    """Return z along values, on the first ``begin`` times its bound."""
    out = np.empty(values.size)
    bound = _bouc_wen_bound(zy, r, n)
    z = begin * bound
    for k in range(values.size):
        move = values[k] - values[k - 1] if k > 0 else 0.0
        direction = 1.0 if move > 0.0 else -1.0
        n_steps = 0
        if abs(move) < FORGOTTEN * bound:
            n_steps = int(np.ceil(abs(move) / (FINEST_STEP * zy)))
        else:
            z = direction * bound
        for _ in range(n_steps):
            if direction * z >= bound:
                break
            part = move / n_steps
            middle = z + 0.5 * part * _bouc_wen_slope(z, direction, zy, r, n)
            z += part * _bouc_wen_slope(middle, direction, zy, r, n)
            z = min(max(z, -bound), bound)
        out[k] = z
    return out


def _bouc_wen_transform(signal, second, dt, theta, first):
    way = signal if second is None else second
    return signal - theta[0] * by_pieces(_bouc_wen_run, way, first, *theta[1:5])


def _added(setting: Setting, transform):
    """Return what a transform adds to the argument, as a function of the parameters."""
    return lambda row: (
        transform(setting.argument, setting.second, setting.dt, row, setting.first) - setting.argument
    )


def _bouc_wen_starts(setting: Setting) -> np.ndarray:
    """Return loops that yield at shares of the motion, a sharper one, and two that harden."""
    size = spread(setting.argument)
    if size == 0:
        return np.empty((0, 5))
    yielding = [[y, SOFT, 1.0] for y in (0.1, 0.4, 1.2)] + [[0.4, SOFT, 2.0]]
    rows = [[1.0, y * size * (1.0 + r) ** (1.0 / n), r, n, 0.0] for y, r, n in yielding]
    rows += [[1.0, scale * size, HARD, 1.0, 0.0] for scale in (1.0, 3.0)]
    return scaled(setting, np.array(rows), _added(setting, _bouc_wen_transform))


@kernel
def _weight(i, q):
    """Return the weight of play i = 1 ... N_PLAYS, before they are scaled to sum 1."""
    return (i / N_PLAYS) ** q


@kernel
def _prandtl_ishlinskii(argument, rate, own, second, time, step, z, theta, dz):
    """z[0 ... N_PLAYS - 1] are the plays, z[N_PLAYS] tells that they have begun."""
    withheld = 0.0
    total = 0.0
    for i in range(N_PLAYS):
        radius = theta[1] * (i + 1) / N_PLAYS
        before = z[i] if z[N_PLAYS] > 0.0 else argument + theta[3] * radius
        dz[i] = play_step(before, argument, radius)
        weight = _weight(i + 1, theta[2])
        withheld += weight * (dz[i] - argument)
        total += weight
    dz[N_PLAYS] = 1.0
    return theta[0] * withheld / total


@kernel
def _weighted_plays_run(values, radius, q, begin):
    """Return the weighted mean of the plays along values, each ``begin`` half-widths off the first."""
    out = np.zeros(values.size)
    total = 0.0
    for i in range(N_PLAYS):
        weight = _weight(i + 1, q)
        total += weight
        own = radius * (i + 1) / N_PLAYS
        w = values[0] + begin * own
        for k in range(values.size):
            w = play_step(w, values[k], own)
            out[k] += weight * w
    return out / total


def _prandtl_ishlinskii_transform(signal, second, dt, theta, first):
    way = signal if second is None else second
    return signal + theta[0] * (by_pieces(_weighted_plays_run, way, first, *theta[1:4]) - way)


def _prandtl_ishlinskii_starts(setting: Setting) -> np.ndarray:
    half = 0.5 * np.diff(quantiles(setting.argument, [0.0, 1.0]))[0]
    if not half > 0:
        return np.empty((0, 4))
    rows = grid([1.0], np.array([0.3, 1.0, 2.0]) * half, [0.0], [0.0])
    return scaled(setting, rows, _added(setting, _prandtl_ishlinskii_transform))


@kernel
def _time_of_lag(i, T, d):
    return T * 10.0 ** (d * i / (N_LAGS - 1))


@kernel
def _creep(argument, rate, own, second, time, step, z, theta, dz):
    """z holds how far the argument is ahead of its slow followers: nothing where the motion begins."""
    ahead = 0.0
    for i in range(N_LAGS):
        dz[i] = rate - z[i] / max(_time_of_lag(i, theta[1], theta[2]), step)
        ahead += z[i]
    return -theta[0] * ahead / N_LAGS


@kernel
def _creep_run(values, dt, T, d, lacking):
    """Return where the slow followers of values are in the mean; they lack a share of the first one."""
    out = np.zeros(values.size)
    for i in range(N_LAGS):
        kept, old, new = weights_along_line(dt / max(_time_of_lag(i, T, d), SHORT * dt))
        follower = (1.0 - lacking) * values[0]
        for k in range(values.size):
            if k > 0:
                follower = kept * follower + old * values[k - 1] + new * values[k]
            out[k] += follower / N_LAGS
    return out


def _creep_transform(signal, second, dt, theta, first):
    return signal + theta[0] * by_pieces(_creep_run, signal, first, dt, theta[1], theta[2], theta[3])


def _creep_starts(setting: Setting) -> np.ndarray:
    return scaled(
        setting, grid([1.0], time_constants(setting, 5)[1:], [1.0], [0.0]), _added(setting, _creep_transform)
    )


def _creep_limits(setting: Setting) -> np.ndarray:
    """The fastest of its lags settles within the time looked at, and not within a sample.

    Slower ones are a spring; what is over at once is another gain, about where a session began.
    """
    limits = at_most(4, 1, time_looked_at(setting))
    limits[1, 0] = setting.dt
    if not at_signal(setting):  # what creeps in an equation is at rest at first
        limits[3] = 0.0
    return limits


def _bouc_wen_hysteresis_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return (AbsoluteDifference(argument), DifferenceSign(argument))


def _prandtl_ishlinskii_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return plays(argument, 0.2 * theta[1], 0.5 * theta[1], theta[1])


HYSTERESIS = (
    Effect(
        code="bouc_wen_hysteresis",
        title="Bouc-Wen hysteresis",
        sentence="The response depends on where the motion last turned, however slowly it goes.",
        equation="-k z in a state equation, s - k z at an input; z' = v - v (sgn(v z) + r) |z/zy|^n (A = 1, "
        "b = 1/zy^n, g = r/zy^n): yields at zy/(1 + r)^(1/n) for r > -1, hardens for r < -1; at first z is i "
        "times what it may be",
        parameters=(
            EffectParameter("k", "{port}/({arg})", 0.0),
            EffectParameter("zy", "{arg}", 1e-15),
            EffectParameter("r", "-", -2.0, 3.0),
            EffectParameter("n", "-", 0.5, 6.0),
            BEGIN,
        ),
        begin=4,
        starts=_bouc_wen_starts,
        force=_bouc_wen,
        transform=_bouc_wen_transform,
        output_port=False,
        read_as="s - k z; z' = u' - u' (sgn(u' z) + r) |z/zy|^n: yields at zy/(1 + r)^(1/n) for r > -1, "
        "hardens for r < -1; at first z is i times what it may be",
        argument="position",
        n_memory=1,
        met_on="motion",
        lookalikes=("viscous_damping", "presliding_friction", "backlash", "prandtl_ishlinskii"),
        # what yields at once is a play, or friction; what never does, a spring from where one began
        holds=("backlash", "coulomb_friction", "linear_stiffness", "constant_load", "sensor_bias"),
        separate_by="loops at three rates, and minor loops",
        source="Wen 1976, J. Eng. Mech. Div. ASCE 102(2); Ismail, Ikhouane and Rodellar 2009, Arch. Comput. "
        "Methods Eng. 16(2), sec. 2 (bounded for all motions where b + g > 0, that is r > -1)",
        phi=_bouc_wen_hysteresis_phi,
    ),
    Effect(
        code="prandtl_ishlinskii",
        title="Prandtl-Ishlinskii hysteresis",
        sentence="Many small lost motions add up to loops that close where they began.",
        equation="w (mean of P_rk[s] - s, weights k^q), added; plays of half-width rk = r k/10, k = 1 to 10, "
        "each at first i half-widths off",
        parameters=(
            EffectParameter("w", "{port}/({arg})", 0.0),
            EffectParameter("r", "{arg}", 0.0),
            EffectParameter("q", "-", -3.0, 10.0),
            BEGIN,
        ),
        begin=3,
        starts=_prandtl_ishlinskii_starts,
        force=_prandtl_ishlinskii,
        transform=_prandtl_ishlinskii_transform,
        handed_on=_prandtl_ishlinskii,
        output_port=False,
        read_as="s + w (mean of P_rk[u] - u, weights k^q); plays of half-width rk = r k/10, k = 1 to 10, "
        "each at first i half-widths off",
        argument="position",
        n_memory=N_PLAYS + 1,
        jumps=True,
        met_on="motion",
        lookalikes=("bouc_wen_hysteresis", "backlash", "presliding_friction", "creep"),
        holds=("backlash", "coulomb_friction", "linear_stiffness", "constant_load", "sensor_bias"),
        same_law=("presliding_friction",),  # of many slip elements (Lampaert, Al-Bender and Swevers 2003)
        reach=1,
        separate_by="first-order reversal curves",
        source="Kuhnen 2003, Eur. J. Control 9(4), sec. 2; Visintin 1994, Differential Models of Hysteresis",
        phi=_prandtl_ishlinskii_phi,
    ),
    Effect(
        code="creep",
        title="Creep",
        sentence="After every step it goes on a little, ever more slowly.",
        equation="g (mean of L_Tj[s] - s), added in a state equation; s + g (mean of L_Tj[s]) at an output, "
        "where the lags begin at s less a share i of it; slow lags Tj = T 10^(d j/2), j = 0, 1, 2: one slow "
        "pole (d = 0) to three decades",
        parameters=(
            EffectParameter("g", "{port}/({arg})", 0.0),
            EffectParameter("T", "s", 0.0),
            EffectParameter("d", "-", 0.0, 3.0),
            LACKING,
        ),
        begin=3,
        starts=_creep_starts,
        limits=_creep_limits,
        force=_creep,
        transform=_creep_transform,
        input_port=False,
        argument="position",
        n_memory=N_LAGS,
        lookalikes=("additive_drift", "extra_mode", "lag", "prandtl_ishlinskii"),
        holds=("linear_stiffness", "constant_load", "sensor_bias"),  # slower than any record it is a spring
        separate_by="long holds at several levels",
        source="Croft, Shed and Devasia 2001, J. Dyn. Syst. Meas. Control 123(1), sec. 2",
        narx_terms="a slow pole: longer lags of y",
    ),
)

"""Friction at a state equation."""

import numpy as np

from narx_sklearn.model.phi import DifferenceSign, Phi
from narx_sklearn.physics.effects._curves import of_difference, plays
from narx_sklearn.physics.effects._effect import Effect, EffectParameter, Setting, at_most
from narx_sklearn.physics.effects._kernel import kernel
from narx_sklearn.physics.effects._starts import (
    grid,
    quantiles,
    record_length,
    reverses,
    scaled,
    spread,
    time_scale,
)


@kernel
def _held(own, limit):
    """Return how much of the load friction of this limit carries at rest: all of it, and none of twice that.

    Between the two it fades, so that the force is continuous in the load.
    """
    size = abs(own)
    if size <= limit:
        return own
    return max(2.0 * limit - size, 0.0) * (1.0 if own > 0.0 else -1.0)


@kernel
def _dry(v, own, forward, backward, step):
    """Return the dry friction that opposes a motion v: -forward for v > 0, backward for v < 0.

    Where one explicit step of it would reverse the motion, it takes just what stops the motion and balances
    the load, so that sticking neither chatters, nor creeps, nor stiffens the run. A load that it cannot hold
    turns the motion about in passing: then it changes sign evenly over a step, as the mean of a step does.
    """
    limit = forward if own > 0.0 else backward
    size = abs(own)
    gentler = 2.0 * limit / size if size > 2.0 * limit else 1.0
    return -min(max(_held(own, limit) + gentler * v / step, -backward), forward)


@kernel
def _viscous(argument, rate, own, second, time, step, z, theta, dz):
    return -theta[0] * argument


@kernel
def _coulomb(argument, rate, own, second, time, step, z, theta, dz):
    return _dry(argument, own, theta[0], theta[0], step)


@kernel
def _asymmetric(argument, rate, own, second, time, step, z, theta, dz):
    return _dry(argument, own, theta[0] * (1.0 + theta[1]), theta[0] * (1.0 - theta[1]), step)


@kernel
def _stribeck_curve(v, rho, vs, delta):
    """Return the friction at speed v over that at high speed: rho at rest, 1 far above vs."""
    return 1.0 + (rho - 1.0) * np.exp(-((abs(v) / vs) ** delta))


@kernel
def _stribeck(argument, rate, own, second, time, step, z, theta, dz):
    limit = theta[0] * _stribeck_curve(argument, theta[1], theta[2], theta[3])
    return _dry(argument, own, limit, limit, step)


@kernel
def _presliding(argument, rate, own, second, time, step, z, theta, dz):
    """Elasto-plastic bristle: z[0] is its deflection over the displacement `d` at which it slips."""
    friction, rho, vs, tau = theta[0], theta[2], theta[3], theta[4]
    # neither the bristle's spring nor its damper is stiffer than a step can follow
    d = max(theta[1], friction * step * step)
    tau = min(tau, d / (friction * step)) if friction * step > 0.0 else tau
    limit = _stribeck_curve(argument, rho, vs, 2.0)
    relaxation = min(abs(argument) / (d * limit), 1.0 / step)
    sliding = limit if argument > 0.0 else -limit
    dz[0] = (sliding - z[0]) * relaxation
    return -friction * (z[0] + tau * dz[0])


@kernel
def _load(argument, rate, own, second, time, step, z, theta, dz):
    load = own if np.isnan(second) else second
    limit = theta[0] * abs(load)
    return _dry(argument, own, limit, limit, step)


def _stribeck_of_difference(now, before, rho, difference, delta):
    moved = now - before
    return np.sign(moved) * (1.0 + (rho - 1.0) * np.exp(-((np.abs(moved) / difference) ** delta)))


def _asymmetric_of_difference(now, before, asymmetry):
    direction = np.sign(now - before)
    return direction + asymmetry * np.abs(direction)


def _dry_starts(setting: Setting, shapes: np.ndarray) -> np.ndarray:
    """Put a tenth of the load's spread before each row of shape parameters; none if nothing reverses."""
    n = shapes.shape[1] + 1
    size = 0.1 * spread(setting.own)
    if not reverses(setting.argument) or size == 0:
        return np.empty((0, n))
    return np.column_stack([np.full(len(shapes), size), shapes])


def _viscous_starts(setting: Setting) -> np.ndarray:
    return scaled(setting, grid([1.0]), lambda row: setting.argument)


def _coulomb_starts(setting: Setting) -> np.ndarray:
    return _dry_starts(setting, np.empty((1, 0)))


def _asymmetric_starts(setting: Setting) -> np.ndarray:
    return _dry_starts(setting, grid([-0.3, 0.3]))


def _stribeck_starts(setting: Setting) -> np.ndarray:
    speeds = quantiles(np.abs(setting.argument), [0.1, 0.3, 0.6])
    return _dry_starts(setting, grid([1.5], speeds[speeds > 0], [2.0]))


def _presliding_starts(setting: Setting) -> np.ndarray:
    fast, size = spread(setting.rate), 0.1 * spread(setting.own)
    if not reverses(setting.argument) or fast == 0 or record_length(setting) < 10 * setting.dt:
        return np.empty((0, 5))
    stroke = spread(setting.argument) ** 2 / fast  # amplitude of a sine of this speed and acceleration
    slips = np.maximum(np.array([0.03, 0.1, 0.3]) * stroke, 4 * size * setting.dt**2)
    vs = float(quantiles(np.abs(setting.argument), 0.3))
    dahl = grid(np.unique(slips), [1.0], [vs], [0.0])
    lugre = grid([slips[1]], [1.4], [vs], [0.3 * np.sqrt(slips[1] / size) if size > 0 else 0.0])
    return _dry_starts(setting, np.concatenate([dahl, lugre]))


def _presliding_limits(setting: Setting) -> np.ndarray:
    """What damps a bristle is over before the motion changes: what goes on is another force than friction."""
    return at_most(5, 4, time_scale(setting) or np.inf)


def _load_starts(setting: Setting) -> np.ndarray:
    load = setting.own if setting.second is None else setting.second
    if not reverses(setting.argument) or spread(load) == 0:
        return np.empty((0, 1))
    return grid([0.1 * spread(setting.own) / spread(load)])


def _coulomb_friction_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return (DifferenceSign(argument),)


def _asymmetric_friction_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_difference("asymmetric_direction", _asymmetric_of_difference, theta[1:], argument)


def _stribeck_friction_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_difference("stribeck", _stribeck_of_difference, (theta[1], theta[2] * dt, theta[3]), argument)


def _presliding_friction_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return (*plays(argument, theta[1]), DifferenceSign(argument))


FRICTION = (
    Effect(
        code="viscous_damping",
        title="Viscous damping",
        sentence="A force opposes the motion in proportion to its speed.",
        equation="-c v",
        parameters=(EffectParameter("c", "{port}/({arg})", 0.0),),
        starts=_viscous_starts,
        force=_viscous,
        met_on="motion",
        lookalikes=("coulomb_friction", "quadratic_drag", "bouc_wen_hysteresis"),
        separate_by="the same motion at two amplitudes",
        source="Rayleigh 1877, The Theory of Sound, vol. 1, sec. 45",
        narx_terms="y[k-1] and y[k-2], through their difference",
    ),
    Effect(
        code="coulomb_friction",
        title="Coulomb friction",
        sentence="A constant force opposes the motion, whatever its speed.",
        equation="-Fc sgn(v)",
        parameters=(EffectParameter("Fc", "{port}", 0.0),),
        starts=_coulomb_starts,
        force=_coulomb,
        last=True,
        met_on="motion",
        lookalikes=(
            "viscous_damping",
            "asymmetric_friction",
            "stribeck_friction",
            "presliding_friction",
            "load_friction",
            "backlash",
            "dead_zone",
        ),
        separate_by="an amplitude ladder, and slow motion both ways",
        source="Olsson, Astrom, Canudas de Wit, Gafvert and Lischinsky 1998, Eur. J. Control 4(3), sec. 3.1",
        phi=_coulomb_friction_phi,
    ),
    Effect(
        code="asymmetric_friction",
        title="Direction-dependent friction",
        sentence="Dry friction is stronger one way than the other.",
        equation="-Fc (1 + a) for v > 0, Fc (1 - a) for v < 0",
        parameters=(EffectParameter("Fc", "{port}", 0.0), EffectParameter("a", "-", -1.0, 1.0)),
        starts=_asymmetric_starts,
        force=_asymmetric,
        last=True,
        met_on="motion",
        lookalikes=("coulomb_friction", "constant_load"),
        holds=("coulomb_friction",),
        separate_by="motion both ways at one speed, at several speeds",
        source="Armstrong-Helouvry, Dupont and Canudas de Wit 1994, Automatica 30(7), sec. 2",
        phi=_asymmetric_friction_phi,
    ),
    Effect(
        code="stribeck_friction",
        title="Stribeck friction",
        sentence="Dry friction falls as the motion gets going, so that slow motion goes in jerks.",
        equation="-Fc (1 + (rho - 1) exp(-|v/vs|^delta)) sgn(v), with rho = Fs/Fc",
        parameters=(
            EffectParameter("Fc", "{port}", 0.0),
            EffectParameter("rho", "-", 1.0, 10.0),
            EffectParameter("vs", "{arg}", 1e-12),
            EffectParameter("delta", "-", 0.3, 4.0),
        ),
        starts=_stribeck_starts,
        force=_stribeck,
        last=True,
        met_on="surfaces",
        lookalikes=("coulomb_friction", "presliding_friction", "viscous_damping"),
        holds=("coulomb_friction",),
        separate_by="a ladder of constant low speeds",
        source="Bo and Pavelescu 1982, Wear 82(3); Armstrong-Helouvry et al. 1994, Automatica 30(7), sec. 2",
        phi=_stribeck_friction_phi,
    ),
    Effect(
        code="presliding_friction",
        title="Friction with presliding (Dahl, LuGre)",
        sentence="Friction gives way like a spring before it breaks loose.",
        equation="-Fc (z + tau z'), z' = (v - |v| z/g)/d, g = 1 + (rho - 1) exp(-(v/vs)^2); "
        "rho = 1, tau = 0 is Dahl's",
        parameters=(
            EffectParameter("Fc", "{port}", 0.0),
            EffectParameter("d", "({arg}) s", 1e-15),
            EffectParameter("rho", "-", 1.0, 10.0),
            EffectParameter("vs", "{arg}", 1e-12),
            EffectParameter("tau", "s", 0.0),
        ),
        starts=_presliding_starts,
        limits=_presliding_limits,
        force=_presliding,
        n_memory=1,
        met_on="surfaces",
        lookalikes=("coulomb_friction", "stribeck_friction", "bouc_wen_hysteresis", "prandtl_ishlinskii"),
        holds=("coulomb_friction", "asymmetric_friction", "stribeck_friction"),
        separate_by="a small sine below breakaway, and ramps at several rates",
        source="Dahl 1968, Aerospace Corp. TOR-0158(3107-18); Canudas de Wit, Olsson, Astrom and Lischinsky "
        "1995, IEEE Trans. Autom. Control 40(3), eqs. (1)-(3), s0 = Fc/d; s2 v is viscous_damping",
        phi=_presliding_friction_phi,
    ),
    Effect(
        code="load_friction",
        title="Load-dependent friction",
        sentence="The more the drive has to push, the more the gears rub.",
        equation="-mu |L| sgn(v), with L the rate without this friction (drive less load), or what drives it",
        parameters=(EffectParameter("mu", "{port}/({second})", 0.0),),
        starts=_load_starts,
        force=_load,
        last=True,
        second="drive",
        met_on="surfaces",
        lookalikes=("coulomb_friction", "input_polynomial"),
        separate_by="two loads, driving and being driven",
        source="Dohring, Lee and Newman 1993, Proc. American Control Conf., pp. 2756-2760",
        phi=_coulomb_friction_phi,
        narx_terms="the products u[k-1]*phi of the input with the direction",
    ),
)

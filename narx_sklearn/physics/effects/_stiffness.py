"""Stiffness, of a spring that is missing or not linear, and an input that acts through a polynomial."""

import numpy as np

from narx_sklearn.model.phi import Phi
from narx_sklearn.physics.effects._curves import of_level
from narx_sklearn.physics.effects._effect import Effect, EffectParameter, Power, Setting
from narx_sklearn.physics.effects._kernel import kernel
from narx_sklearn.physics.effects._starts import (
    ORDINARY,
    grid,
    reverses,
    scaled,
    spread,
    telling,
    working_points,
)

MOSTLY = np.array([[1.0, 0.1], [0.1, 1.0]])  # a square with a little of a cube, and the other way round


@kernel
def _linear(argument, rate, own, second, time, step, z, theta, dz):
    return -theta[0] * (argument - theta[1])


@kernel
def _cubic(argument, rate, own, second, time, step, z, theta, dz):
    return -theta[0] * argument * argument * argument


@kernel
def _quadratic(argument, rate, own, second, time, step, z, theta, dz):
    return -theta[0] * argument * argument


@kernel
def _one_side(x, side):
    """Return x on the positive side, or on the negative one; 0 on the other."""
    return max(x, 0.0) if side > 0.0 else min(x, 0.0)


@kernel
def _bilinear(argument, rate, own, second, time, step, z, theta, dz):
    return -theta[0] * _one_side(argument, theta[1])


def _linear_starts(setting: Setting) -> np.ndarray:
    if spread(setting.argument) == 0:
        return np.empty((0, 2))
    rows = grid([1.0], working_points(setting.argument)[-1:])
    return scaled(setting, rows, lambda row: setting.argument - row[1])


def _cubic_starts(setting: Setting) -> np.ndarray:
    return scaled(setting, grid([1.0]), lambda row: setting.argument**3)


def _quadratic_starts(setting: Setting) -> np.ndarray:
    return scaled(setting, grid([1.0]), lambda row: setting.argument**2)


def _bilinear_starts(setting: Setting) -> np.ndarray:
    """Either side, for a simulator without a stiffness of its own cannot make one out of the other."""
    if not reverses(setting.argument):  # on one side it is a linear spring
        return np.empty((0, 2))
    rows = grid([1.0], [1.0, -1.0])
    return scaled(setting, rows, lambda row: np.maximum(row[1] * setting.argument, 0.0))


def _polynomial_transform(signal, second, dt, theta, first):
    beyond = signal - theta[2]
    return signal + beyond * beyond * (theta[0] + beyond * theta[1])


@kernel
def _polynomial_handed_on(argument, rate, own, second, time, step, z, theta, dz):
    beyond = argument - theta[2]
    return beyond * beyond * (theta[0] + beyond * theta[1])


def _polynomial_starts(setting: Setting) -> np.ndarray:
    """Mostly one power about where the signal works, with either sign; a square about zero if that differs.

    No parameter scales the whole, so each start is of ordinary size; a signal of two levels shows none.
    """
    if spread(setting.argument) == 0:
        return np.empty((0, 3))
    points = working_points(setting.argument)
    rows = [
        [*(sign * shares * _ordinary_powers(setting.argument, r)), r]
        for r in points
        for shares in (MOSTLY if r == points[-1] else MOSTLY[:1])
        for sign in (1.0, -1.0)
    ]
    return telling(setting, np.array(rows), _polynomial_transform)


def _ordinary_powers(signal: np.ndarray, r: float) -> np.ndarray:
    """Return the coefficients of square and cube about ``r`` that make either of ordinary size."""
    powers = np.array([spread((signal - r) ** 2), spread((signal - r) ** 3)])
    return ORDINARY * spread(signal) / np.where(powers > 0, powers, np.inf)


def _one_side_of_level(level, side):
    return np.where(level * side > 0, level, 0.0)


def _bilinear_stiffness_phi(theta, argument: str, dt: float) -> tuple[Phi, ...]:
    return of_level("one_side", _one_side_of_level, theta[1:2], argument)


STIFFNESS = (
    Effect(
        code="linear_stiffness",
        title="Spring, leak or loss in proportion",
        sentence="What pulls it back grows in proportion to how far it is from a point: a spring, a leak, "
        "heat that is lost.",
        equation="-k (x - r)",
        parameters=(EffectParameter("k", "{port}/({arg})"), EffectParameter("r", "{arg}")),
        references=(1,),
        starts=_linear_starts,
        force=_linear,
        argument="position",
        lookalikes=("constant_load", "clearance", "bilinear_stiffness", "root_outflow", "extra_mode"),
        holds=("constant_load",),
        separate_by="holding it at several levels",
        source="Hooke 1678, Lectures de Potentia Restitutiva; Newton 1701, Scala graduum Caloris (of heat)",
        narx_terms="y[k-1] and the constant",
    ),
    Effect(
        code="cubic_stiffness",
        title="Cubic stiffness",
        sentence="The spring hardens (or softens) as it is stretched, alike both ways.",
        equation="-k3 x^3",
        parameters=(EffectParameter("k3", "{port}/({arg})^3"),),
        starts=_cubic_starts,
        force=_cubic,
        argument="position",
        met_on="motion",
        lookalikes=("clearance", "gravity", "input_saturation", "quadratic_stiffness"),
        separate_by="an amplitude ladder with an offset",
        source="Duffing 1918, Erzwungene Schwingungen bei veraenderlicher Eigenfrequenz, ch. 1",
        power=Power(3.0, odd=True),
        narx_terms="y[k-1]^3",
    ),
    Effect(
        code="quadratic_stiffness",
        title="Quadratic stiffness",
        sentence="The spring hardens one way and softens the other.",
        equation="-k2 x^2",
        parameters=(EffectParameter("k2", "{port}/({arg})^2"),),
        starts=_quadratic_starts,
        force=_quadratic,
        argument="position",
        met_on="motion",
        lookalikes=("bilinear_stiffness", "cubic_stiffness"),
        separate_by="an amplitude ladder: the mean shifts with the amplitude squared",
        source="Nayfeh and Mook 1979, Nonlinear Oscillations, sec. 4.1",
        power=Power(2.0, odd=False),
        narx_terms="y[k-1]^2",
    ),
    Effect(
        code="bilinear_stiffness",
        title="Bilinear stiffness",
        sentence="The spring is stiffer one way than the other.",
        equation="-k x on one side (s = 1: x > 0, s = -1: x < 0), 0 on the other",
        parameters=(EffectParameter("k", "{port}/({arg})"), EffectParameter("s", "-", -1.0, 1.0)),
        starts=_bilinear_starts,
        force=_bilinear,
        argument="position",
        met_on="motion",
        lookalikes=("quadratic_stiffness", "clearance"),
        separate_by="an amplitude ladder, and a preload",
        source="Shaw and Holmes 1983, J. Sound Vib. 90(1), sec. 2",
        phi=_bilinear_stiffness_phi,
    ),
    Effect(
        code="input_polynomial",
        title="Nonlinear drive",
        sentence="The drive is not proportional to its command.",
        equation="s + a2 (s - r)^2 + a3 (s - r)^3",
        parameters=(
            EffectParameter("a2", "1/({port})"),
            EffectParameter("a3", "1/({port})^2"),
            EffectParameter("r", "{port}"),
        ),
        references=(2,),
        starts=_polynomial_starts,
        transform=_polynomial_transform,
        handed_on=_polynomial_handed_on,
        output_port=False,
        amplitude=None,
        lookalikes=("input_saturation", "load_friction"),
        separate_by="an amplitude ladder",
        source="Billings 2013, Nonlinear System Identification, sec. 1.4 (Hammerstein models)",
        narx_terms="u[k-1]^2, u[k-1]^3 and the constant",
    ),
)

"""Could it all be noise? The likelihood of noise of its own colour, with and without an effect."""

import numpy as np
from scipy.stats import chi2

from narx_sklearn.discrepancy.by_chance import gained_by_chance
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.problem import Model, Problem
from narx_sklearn.discrepancy.refit import Fit
from narx_sklearn.discrepancy.restricted import Contrasts, own_noise

DRIFT, OFFSET, LOAD = "additive_drift", "sensor_bias", "constant_load"
CLEARER = 10.0  # difference of the deviance that makes a noise clearly the likelier


def chance_of_noise(gained: float, n_tried: float, n_values: float, n_felt: int = 1) -> float:
    """Return the p-value of an effect when each side may call what it leaves noise of its colour.

    Slow noise (a drift) looks like slow effects. Without the effect the noise model takes up what it can;
    the difference of the deviances is then chi-squared, and the best of all that was tried pays for their
    number (Bonferroni).

    Parameters
    ----------
    gained : float
        What the effect takes off the deviance.
    n_tried : float
        Hypotheses of which the effect is the best.
    n_values : float
        Shapes of the effect of which its own is the best.
    n_felt : int, default=1
        Degrees of freedom: parameters of the effect that were fitted and are felt.
    """
    log_tried = np.log(n_tried) + np.log(n_values)
    return float(np.exp(min(0.0, log_tried + chi2.logsf(max(gained, 0.0), n_felt))))


def n_shapes(effect: PlacedEffect, problem: Problem) -> float:
    """Return how many shapes of an effect the samples can tell apart.

    Of each fitted parameter but its size n samples tell about the square root of n values.
    """
    return problem.n_seen ** (0.5 * (effect.n_theta - 1))


def noises_against(effect: PlacedEffect, as_offset: bool = False) -> tuple[bool, ...]:
    """Return whether noise may drift, of each kind of noise to which an effect must be preferred.

    Noise that drifts is as good as a drift of an output, which is held against noise that does not. An offset
    is held against both: a sensor is off from the first sample on, where a drift has yet to come. So is what
    is no better than one (``as_offset``).
    """
    if not is_of_a_sensor(effect):
        return (True,)
    return (False, True) if as_offset or effect.effect.code == OFFSET else (False,)


def is_slow(effect: PlacedEffect) -> bool:
    """Tell whether an effect is a drift of an output, an offset or a load, as slow as noise may be."""
    return is_of_a_sensor(effect) or effect.effect.code in (OFFSET, LOAD)


def is_of_a_sensor(effect: PlacedEffect) -> bool:
    """Tell whether an effect is a drift or an offset of an output, which noise of that output may be."""
    return effect.port.kind == "output" and effect.effect.code in (DRIFT, OFFSET)


def deviance(problem: Problem, model: Model, *, may_drift: bool = True) -> float:
    """Return minus twice the restricted log-likelihood under noise of its own colour, the colour priced."""
    return own_noise(problem, model, may_drift=may_drift).deviance


def as_if_white(
    problem: Problem, base: Model, model: Model, gained: float, n_felt: int, random_state=None
) -> float:
    """Return what a model would gain as rarely over its base if the noise beside the base did not drift.

    Parameters
    ----------
    gained : float
        What it takes off the deviance.
    n_felt : int
        Degrees of freedom of what is gained under white noise.
    """
    contrasts = Contrasts.of(problem, base)
    noise = own_noise(problem, base, contrasts=contrasts).noise
    if not any(noise.average):
        return gained
    chance = gained_by_chance(contrasts, Contrasts.of(problem, model), noise, random_state)
    return chance.as_if_white(gained, n_felt)


def clearer_noise(problem: Problem, found: Fit) -> Noise | None:
    """Return the noise that a fitted model leaves, if it is much likelier than the problem's own.

    Noise is first estimated from what tangents or a single effect leave. What they miss colours it, and
    coloured noise then hides what it was coloured by.
    """
    contrasts = Contrasts.of(problem, found.model)
    own, given = own_noise(problem, found.model, contrasts=contrasts), contrasts.under(problem.noise)
    return own.noise if own.deviance < given.deviance - CLEARER else None

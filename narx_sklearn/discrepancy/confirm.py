"""Could it all be noise? The likelihood of noise of its own colour, with and without an effect."""

from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from narx_sklearn.discrepancy.noise import Noise, estimate_noise, noise_deviance
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.problem import Model, Problem
from narx_sklearn.discrepancy.refit import Fit, fit

ROUNDS = 4  # of noise and model in turn, at most
COLOUR = 2.0  # price of a coefficient of the noise
DRIFT, OFFSET, LOAD = "additive_drift", "sensor_bias", "constant_load"
CLEARER = 10.0  # difference of the deviance that makes a noise clearly the likelier
ENOUGH = 0.5  # of the deviance: a round that gains less is the last


def chance_of_noise(gained: float, n_tried: int, n_values: float) -> float:
    """Return the p-value of an effect when each side may call what it leaves noise of its colour.

    Slow noise (a drift) looks like slow effects. Without the effect the noise model takes up what it can;
    the difference of the deviances is then chi-squared, and the best of all that was tried pays for their
    number (Bonferroni).

    Parameters
    ----------
    gained : float
        What the effect takes off the deviance.
    n_tried : int
        Hypotheses of which the effect is the best.
    n_values : float
        Shapes of the effect of which its own is the best.
    """
    log_tried = np.log(n_tried) + np.log(n_values)
    return float(np.exp(min(0.0, log_tried + chi2.logsf(max(gained, 0.0), 1))))


class Noises(NamedTuple):
    """Which noise an effect is held against."""

    may_drift: bool = True  # else it stays about a level
    from_zero: bool = False  # goes on from window to window: what has a level from the first on is not noise


ANY = Noises()


def held_against(effect: PlacedEffect) -> list[Noises]:
    """Return the noises to each of which an effect must be preferred.

    Noise that drifts is as good as a drift of an output, and within a window as an offset: these two are held
    against noise that does not. What is always there, an offset or a load, is held against noise that begins
    at zero too and goes on, for such noise may stay on one side as long.
    """
    own = effect.port.kind == "output" and effect.effect.code in (DRIFT, OFFSET)
    return [Noises(may_drift=not own)] + [Noises(from_zero=True)] * (effect.effect.code in (OFFSET, LOAD))


def deviance(problem: Problem, model: Model, noises: Noises = ANY) -> float:
    """Return minus twice the log-likelihood under noise of its own colour, with a price for the colour.

    The price is that of Akaike (1974): a dearer one would leave a faint colour to the effect. Noise and
    model are fitted in turn, each to what the other leaves.
    """
    return own_noise(problem, model, noises).deviance


class OwnNoise(NamedTuple):
    """The noise that a model leaves, and minus twice the log-likelihood of the recording under it."""

    noise: Noise
    deviance: float


def own_noise(problem: Problem, model: Model, noises: Noises = ANY) -> OwnNoise:
    """Fit the noise and a model in turn, each to what the other leaves."""
    best = OwnNoise(problem.noise, np.inf)
    for _ in range(ROUNDS):
        left = problem.left_over(model)
        noise = estimate_noise(left, problem.seen, may_drift=noises.may_drift, price=COLOUR)
        value, model = _deviance_under(problem, model, noise)
        if noises.from_zero:
            value = _from_zero(problem, left, noises.may_drift)
        gained = best.deviance - value
        if value < best.deviance:
            best = OwnNoise(noise, value)
        if not gained > ENOUGH:
            break
    return best


def _deviance_under(problem: Problem, model: Model, noise: Noise) -> tuple[float, Model]:
    """Return minus twice the log-likelihood under a given noise, priced, and the model fitted under it."""
    own = problem.with_noise(noise)
    found = fit(own, model, rough=True)
    return _priced(own, found.cost), found.model


def _priced(problem: Problem, cost: float) -> float:
    """Return minus twice the log-likelihood of a fit that leaves a cost, and the price of the colour."""
    noise = problem.noise
    level = np.log(max(cost / max(problem.n_seen, 1), 1e-300)) + 2 * np.mean(np.log(noise.sigma))
    value = int(problem.seen.sum()) * level + noise.n_parameters * COLOUR
    return float(value + noise.log_determinant(problem.windows.count))


def clearer_noise(problem: Problem, found: Fit) -> Noise | None:
    """Return the noise that a fitted model leaves, if it is much likelier than the problem's own.

    Noise is first estimated from what tangents or a single effect leave. What they miss colours it, and
    coloured noise then hides what it was coloured by.
    """
    own = own_noise(problem, found.model)
    return own.noise if own.deviance < _priced(problem, found.cost) - CLEARER else None


def _from_zero(problem: Problem, left: np.ndarray, may_drift: bool) -> float:
    """Return the deviance of what is left under noise that goes on from window to window from zero."""
    seen = _joined(problem, problem.seen)
    return noise_deviance(_joined(problem, left), seen, may_drift=may_drift, price=COLOUR)


def _joined(problem: Problem, values: np.ndarray) -> np.ndarray:
    """Return what stands in windows, (W, L, n), by stretches of windows that follow without a gap."""
    starts = np.flatnonzero(problem.windows.fresh)
    lengths = problem.windows.last - problem.windows.first
    stretches = np.split(np.arange(lengths.size), starts[1:])
    longest = max(int(lengths[stretch].sum()) for stretch in stretches)
    out = np.zeros((len(stretches), longest, values.shape[2]), dtype=values.dtype)
    for row, stretch in zip(out, stretches, strict=True):
        joined = np.concatenate([values[w, : lengths[w]] for w in stretch])
        row[: len(joined)] = joined
    return out

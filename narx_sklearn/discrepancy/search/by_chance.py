"""What an effect takes off the deviance by chance, where noise drifts: simulated.

A drift fixes few slow waves, and each side of the comparison finds its pace anew, so what an effect gains
by chance is not chi-squared: its mean may be ten times as large, its spread three times. Noise as it is
beside the simpler of two models, drawn many times, tells both (a parametric bootstrap, Davison and Hinkley
1997, chapter 4).
"""

from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter
from sklearn.utils import check_random_state

from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.search.restricted import Contrasts, paces, walk

DRAWS = 100  # of noise: their mean is known to a tenth of their spread
GRID = 8  # paces of a drift that are tried, evenly in the logarithm
BEFORE = 1000  # samples by which noise that does not drift began before the first


class ByChance(NamedTuple):
    """Mean and standard deviation of what is gained by chance, and the columns that gain it."""

    mean: float
    spread: float
    n_columns: int

    def as_if_white(self, gained: float) -> float:
        """Return the gain that is as rare under white noise; never a larger one.

        Chance gains are taken for chi-squared of as many degrees of freedom as columns, moved and stretched.
        """
        if not self.spread > 0:
            return gained
        n = max(self.n_columns, 1)
        return min(gained, max(0.0, n + (gained - self.mean) / self.spread * np.sqrt(2.0 * n)))


def gained_by_chance(base: Contrasts, candidate: Contrasts, noise: Noise, random_state=None) -> ByChance:
    """Return what a candidate gains over a simpler model when all that both leave is noise.

    Parameters
    ----------
    base, candidate : Contrasts
        Both models, linear about their fits.
    noise : Noise
        That the base leaves.
    """
    draws = _drawn(base, noise, check_random_state(random_state))
    gained = _least_deviances(base, draws, noise) - _least_deviances(candidate, draws, noise)
    n_columns = candidate.n_others - base.n_others
    return ByChance(float(gained.mean()), float(gained.std(ddof=1)), n_columns)


def _drawn(contrasts: Contrasts, noise: Noise, rng: np.random.RandomState) -> np.ndarray:
    """Return noise over stretches, (stretches, samples, outputs, draws), in the contrasts' units."""
    stretches, samples, outputs, _ = contrasts.signals.shape
    draws = np.zeros((stretches, samples, outputs, DRAWS))
    for output in range(outputs):
        a, b = noise.colour(output)
        before = 0 if b else BEFORE
        e = rng.standard_normal((stretches, before + samples, DRAWS))
        drawn = lfilter([1.0, -b], np.r_[1.0, -a], e, axis=1)[:, before:]
        if b:
            gone = np.sqrt(noise.gone_after(contrasts.before, output))
            levels = gone[:, None] * rng.standard_normal((stretches, DRAWS))
            drawn += levels[:, None] * (a[0] ** np.arange(samples))[:, None]
        draws[:, :, output] = noise.sigma[output] / contrasts.unit[output] * drawn
    return np.where(contrasts.seen[:, :, :, None], draws, 0.0)


def _least_deviances(contrasts: Contrasts, draws: np.ndarray, noise: Noise) -> np.ndarray:
    """Return the deviance of each draw under the likeliest noise that is white, as given, or a walk.

    The colour of each output is chosen beside the given ones of the others.
    """
    drawn = contrasts.with_rests(draws)
    walks = [walk(log_pace) for log_pace in paces(GRID)]
    likeliest = []
    colours = []
    for output in range(contrasts.unit.size):
        colours.append([noise.colour(output), (np.zeros(0), 0.0), *walks])
        tried = [drawn.deviances(noise.with_colour(output, *colour))[0] for colour in colours[-1]]
        likeliest.append(np.argmin(tried, axis=0))
    if len(likeliest) == 1:
        return np.min(tried, axis=0)
    least = np.empty(DRAWS)
    for choice in np.unique(likeliest, axis=1).T:
        alike = np.all(np.array(likeliest) == choice[:, None], axis=0)
        coloured = noise
        for output, k in enumerate(choice):
            coloured = coloured.with_colour(output, *colours[output][k])
        least[alike] = contrasts.with_rests(draws[..., alike]).deviances(coloured)[0]
    return least

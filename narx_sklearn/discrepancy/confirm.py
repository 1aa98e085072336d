"""Could it all be noise? The likelihood of noise of its own colour, with and without an effect."""

import numpy as np
from scipy.stats import chi2

from narx_sklearn.discrepancy.noise import estimate_noise
from narx_sklearn.discrepancy.problem import Model, Problem
from narx_sklearn.discrepancy.refit import fit

ROUNDS = 4  # of noise and model in turn, at most
COLOUR = 2.0  # price of a coefficient of the noise
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


def deviance(problem: Problem, model: Model, *, may_drift: bool = True) -> float:
    """Return minus twice the log-likelihood under noise of its own colour, with a price for the colour.

    The price is that of Akaike (1974): a dearer one would leave a faint colour to the effect.
    Noise and model are fitted in turn, each to what the other leaves. Noise that may not drift stays about a
    level.
    """
    lowest = np.inf
    for _ in range(ROUNDS):
        noise = estimate_noise(problem.left_over(model), problem.seen, may_drift=may_drift, price=COLOUR)
        own = problem.with_noise(noise)
        found = fit(own, model)
        mean_square = found.cost / max(own.n_seen, 1)
        level = np.log(max(mean_square, 1e-300)) + 2 * np.mean(np.log(noise.sigma))
        value = int(problem.seen.sum()) * level + noise.n_parameters * COLOUR
        gained, lowest, model = lowest - value, min(lowest, value), found.model
        if not gained > ENOUGH:
            break
    return float(lowest)

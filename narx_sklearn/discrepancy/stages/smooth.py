"""A curve at an input or output made smooth: few sensors and amplifiers have corners."""

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.fitting.start import fit_initial_states
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.candidate import FINE, Candidate
from narx_sklearn.discrepancy.search.unnamed.broken_line import (
    KNOTS,
    ends_of,
    heights_through,
    knots_where_it_bends,
    smooth_line,
    with_knots,
)
from narx_sklearn.discrepancy.search.unnamed.kinds import CURVE
from narx_sklearn.discrepancy.stages.knots import ROUNDS, drawn_again


def smoothed(problem: Problem, candidate: Candidate) -> Candidate:
    """Return a set whose last law, a broken line at an input or output, is smooth, if that is likelier.

    A sensor's curve bends what a refit makes of the parameters, and a fit that begins there does not find
    back: so it begins with those that were given too, and with the curve from what is simulated with these to
    what was measured.
    """
    placed = candidate.effects[-1]
    if placed.effect.code != CURVE or placed.port.kind not in ("input", "output"):
        return candidate
    before = candidate.fit.model.effects[:-1]
    smooth = smooth_line(placed)
    begun = [candidate.fit.model._replace(effects=(*before, smooth))]
    if placed.port.kind == "output" and not placed.is_fed:
        begun.append(_as_given(problem, candidate.fit.model, smooth))
    found = [_fitted(problem, model, candidate.n_samples) for model in begun]
    return min([candidate, *found], key=lambda c: c.criterion)


def _fitted(problem: Problem, model: Model, n_samples: int) -> Candidate:
    """Return a model fitted, under white noise at first: what is missing gave the noise its colour."""
    white = problem.with_noise(Noise.white(problem.noise.sigma))
    roughly = drawn_again(white, Candidate(fit(white, model, iterations=FINE), n_samples))
    return drawn_again(problem, Candidate(fit(problem, roughly.fit.model, iterations=FINE), n_samples))


def _as_given(problem: Problem, model: Model, curve: PlacedEffect) -> Model:
    """Return a model with the parameters that were given, and the curve from its output to what was read."""
    given = fit_initial_states(problem, model.x0).model
    inside, output = problem.rows[problem.inside], curve.port.index
    simulated, measured = problem.run(given).y[inside, output], problem.y[inside, output]
    known = np.isfinite(simulated) & np.isfinite(measured)
    simulated, measured = simulated[known], measured[known]
    low, high = ends_of(simulated)
    if not high > low:
        return model._replace(effects=(*model.effects[:-1], curve))
    knots = np.linspace(low, high, KNOTS)
    for _ in range(ROUNDS):
        heights = heights_through(knots, simulated, measured - simulated)
        nearer = knots_where_it_bends(knots, heights, simulated)
        knots = nearer if np.all(np.diff(nearer) > 0) else knots
    heights = heights_through(knots, simulated, measured - simulated)
    drawn = with_knots(curve, knots)
    drawn = drawn.at((*heights, *drawn.theta[KNOTS:]))
    return given._replace(effects=(*model.effects[:-1], drawn))

"""A product of two signals."""

from dataclasses import replace
from itertools import combinations, permutations

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.search.hypotheses import Hypothesis, counted_from_means
from narx_sklearn.discrepancy.search.places import arguments, weights_of
from narx_sklearn.discrepancy.search.unnamed.kinds import PRODUCT, WITH_SQUARE, unnamed_law
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.physics.effects import CATALOGUE, Effect, EffectParameter

POINTS = EffectParameter("r", "{arg}"), EffectParameter("c", "{second}")  # from which a product is counted


@njit(nogil=True, cache=True)
def _product_with_square(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0] * (argument - theta[1]) * (second - theta[2]) ** 2


def product_hypotheses(simulator: Simulator, structure: Structure, x: np.ndarray) -> list[Hypothesis]:
    """Return a force in proportion to two states, or one of them squared, for each state equation and pair.

    What moves along with a flow is of the first kind, what is thrown outwards of the second. Working points
    begin at the means of a run's states ``x`` (n, n_states); what stands still there is in no pair, and what
    a position and its own rate do is a matter of the polynomials.
    """
    product = _of_two(
        PRODUCT, "k (x - r) (w - c)", CATALOGUE["bilinear_input"].force, "{port}/(({arg}) ({second}))"
    )
    with_square = _of_two(
        WITH_SQUARE, "k (x - r) (w - c)^2", _product_with_square, "{port}/(({arg}) ({second})^2)"
    )
    n_inputs, n_states = len(simulator.inputs), len(simulator.states)
    found = []
    for i in np.flatnonzero(~structure.kinematic).tolist():
        of_one_motion = {weights_of(n_states, {j: 1.0}) for j in (i, structure.partner[i]) if j >= 0}
        signals = [
            a for a in arguments("any", i, simulator, structure) if np.ptp(x @ np.array(a.weights)) > 0
        ]
        pairs = [(product, pair) for pair in combinations(signals, 2)]
        pairs += [(with_square, pair) for pair in permutations(signals, 2)]
        for law, (one, other) in pairs:
            if {one.weights, other.weights} == of_one_motion:
                continue
            found.append(counted_from_means(law, i, (one, other), x, n_inputs, amplitude=1.0))
    return found


def _of_two(code: str, equation: str, force, unit: str) -> Effect:
    """Return a law of two signals, each counted from a working point."""
    return replace(unnamed_law(code, equation, ["k"], POINTS, force, unit, amplitude=0), references=(1, 2))

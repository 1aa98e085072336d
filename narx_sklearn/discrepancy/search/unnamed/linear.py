"""A law that is linear in its named coefficients, as a hypothesis."""

import numpy as np

from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.places import Argument, placed_at
from narx_sklearn.discrepancy.search.unnamed.kinds import unnamed_law


def linear_hypothesis(
    code: str,
    equation: str,
    names,
    fixed,
    force,
    port: Port,
    argument: Argument,
    unit: str = "{port}",
    transform=None,
) -> Hypothesis:
    """Return the hypothesis of a force that is linear in its named coefficients; others keep their bounds."""
    n = len(names)
    placed = placed_at(unnamed_law(code, equation, names, fixed, force, unit, transform), port, argument)
    scale = [(parameter.lower + parameter.upper) / 2 for parameter in fixed] + [placed.share] * placed.reacts
    starts = np.column_stack([np.eye(n), np.tile(scale, (n, 1))])
    begun = placed.at(np.r_[np.zeros(n), scale])
    return Hypothesis.untuned(begun, starts)

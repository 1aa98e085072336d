"""What inputs do between samples, where nobody has told: they stay as they are, or go on in straight lines.

A command of a computer stays; what was measured, or planned as a smooth course, hardly does. Held for a step
it comes half a sample late, and that looks like physics where the noise is small.
"""

from collections.abc import Iterable
from copy import copy
from dataclasses import replace
from itertools import chain

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.search.candidate import Candidate
from narx_sklearn.discrepancy.search.confirm import CLEARER, priced
from narx_sklearn.discrepancy.simulators.simulator import Simulator

ALIKE = 1e-6  # of an input's range, that its straight lines differ from its steps where it has none


def in_straight_lines(
    problem: Problem, best: Candidate, others: Iterable[Candidate], n_jobs: int | None = None
) -> Simulator | None:
    """Return the simulator with inputs in straight lines, where that is clearly likelier; else None.

    The best explanation may be what it is because inputs came late, so others are tried with straight lines
    too, as long as none is the likelier: they are asked for one by one.
    """
    simulator = problem.simulator
    if simulator.hold_is_told or not _moves_on(problem):
        return None
    straight = replace(problem, simulator=copy(simulator))
    straight.simulator.linear_hold = True
    least = priced(problem, best) - CLEARER  # each under noise of its own
    for candidate in chain([best], others):
        again = replace(candidate, fit=fit(straight, candidate.fit.model, n_jobs=n_jobs))
        if priced(straight, again) < least:
            return straight.simulator
    return None


def _moves_on(problem: Problem) -> bool:
    """Tell whether any input that moves mostly moves in the next step too: what a computer steps stays."""
    u = problem.u[problem.rows[problem.inside]]
    moves = np.abs(np.diff(u, axis=0)) > ALIKE * np.ptp(u, axis=0)
    return bool(np.any(2 * np.sum(moves[1:] & moves[:-1], axis=0) > moves.sum(axis=0)))

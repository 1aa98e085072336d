"""Twins in continuous time: a linear differential equation found from a simulated output.

    y' = a0 y + b u + c    or    y'' = a0 y + a1 y' + b u + c

Lagged outputs are states of a map, not of a machine: nothing moves in them, so friction or a spring has no
place there. Where a position and its velocity reproduce the trace, they are the better twin.
"""

from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from narx_sklearn.discrepancy.simulators.equations import compiled_lines, picker
from narx_sklearn.discrepancy.simulators.ode import describe
from narx_sklearn.discrepancy.simulators.simulator import Parameter, Signal
from narx_sklearn.discrepancy.surrogates.trace_fit import (
    Trace,
    TracedEquation,
    best_fitted,
    linear_map,
    quotient,
    without_idle_terms,
)

ORDERS = (1, 2)


class MotionSimulator(TracedEquation):
    """Simulate a linear differential equation of first or second order in the output.

    Its states are the output and, for the second order, its rate; its parameters are the coefficients of the
    terms that give the highest derivative: the output, its rate, the inputs, and 1.
    """

    def __init__(self, order, terms, inputs, output, *, dt, substeps=1, linear_hold=False):
        self.order, self.terms = order, tuple(terms)
        self.inputs, self.outputs, self.dt = inputs, (output,), dt
        self.substeps, self.linear_hold = substeps, linear_hold
        rate = Signal(f"{output.name}'", quotient(output.unit or "1", "s"))
        self.states = (output, rate)[:order]
        units = {s.name: s.unit for s in (*self.states, *inputs)} | {"1": "-"}
        highest = quotient(output.unit, "s" if order == 1 else "s^2")
        self.parameters = tuple(Parameter(t, quotient(highest, units[t]), 0.0) for t in self.terms)

    def first_states(self, y, slope):
        """Return the output and, for the second order, its slope."""
        return np.column_stack([y, slope])[:, : self.order]

    def with_terms(self, kept):
        """Return the equation with these terms, None without any."""
        return self._like(self.order, kept) if kept else None

    def _equations(self):
        places = {s.name: f"x[{i}]" for i, s in enumerate(self.states)}
        places |= {s.name: f"u[{i}]" for i, s in enumerate(self.inputs)} | {"1": "1.0"}
        return _equation(self.order, tuple(places[term] for term in self.terms)), picker((0,))

    def __repr__(self) -> str:
        return describe(self, f"MotionSimulator of order {self.order}, dt={self.dt:g} s")


@lru_cache(maxsize=64)
def _equation(order: int, places: tuple[str, ...]):
    """Return the compiled right-hand side in which each coefficient multiplies what stands at its place."""
    lines = [f"written[{i}] = x[{i + 1}]" for i in range(order - 1)]
    lines.append(f"written[{order - 1}] = " + " + ".join(f"p[{i}] * {at}" for i, at in enumerate(places)))
    return compiled_lines(lines, {}, {}, "The twin")


def identify_motion(trace: Trace, good_enough: float) -> tuple[MotionSimulator, float] | None:
    """Return the equation of motion that runs like a trace, and its error; None where there is none.

    Parameters
    ----------
    trace : Trace
    good_enough : float
        Held-out error over the output's standard deviation, above which the next order is tried.

    Returns
    -------
    (MotionSimulator, float) or None
    """
    best = best_fitted(trace, (_starts(trace, order) for order in ORDERS), good_enough)
    return best if best is None or best[1] >= good_enough else without_idle_terms(trace, *best)


def _starts(trace: Trace, order: int) -> Iterator[MotionSimulator]:
    """Yield equations with the poles of the linear map through the trace, other coefficients zero."""
    linear = linear_map(trace, order)
    if linear is None:
        return
    names = [trace.output.name, f"{trace.output.name}'"][:order]
    terms = [*names, *(signal.name for signal in trace.inputs), "1"]
    for linear_hold in (False, True):
        simulator = MotionSimulator(
            order,
            terms,
            trace.inputs,
            trace.output,
            dt=trace.dt,
            substeps=linear.substeps,
            linear_hold=linear_hold,
        )
        yield simulator.with_parameters(dict(zip(names, -np.poly(linear.poles).real[:0:-1], strict=True)))

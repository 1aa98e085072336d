"""Twins in continuous time: stores that drain by a power of their level, each into the next.

    x1' = b u + c - k1 x1^m1,    x2' = k1 x1^m1 - k2 x2^m2,    y = x1 or x2

A tank under Torricelli's law (m = 1/2), a vessel behind a valve, a body that radiates (m = 4). The level of
a store before the one measured is counted such that what leaves it raises the next as much.
"""

from collections.abc import Iterator
from functools import lru_cache
from itertools import permutations, product

import numpy as np

from narx_sklearn.discrepancy.simulators.equations import compiled_lines, picker
from narx_sklearn.discrepancy.simulators.ode import describe
from narx_sklearn.discrepancy.simulators.simulator import Parameter, Signal
from narx_sklearn.discrepancy.surrogates.trace_fit import (
    Trace,
    TracedEquation,
    as_good,
    best_fitted,
    fitted,
    linear_map,
    quotient,
    without_idle_terms,
)

COUNTS = (1, 2)
POWERS = (0.5, 1.5)  # from which the fit begins: below and above a linear drain
LOWEST, HIGHEST = 0.2, 5.0  # powers that a drain may have
EMPTY = 1e-6  # of the output's spread, that a level may read below zero


class StoresSimulator(TracedEquation):
    """Simulate one store, or two in a row, of which the last one's level is the output.

    Parameters are what each input and 1 (a steady inflow) add to the first level, and the coefficients of
    the drains. Where ``levels`` are given, the drains' powers are parameters too, and a drain's coefficient
    is what flows at its level: the power then changes little of what flows, and is well told from it.
    """

    def __init__(self, powers, terms, inputs, output, *, dt, substeps=1, linear_hold=False, levels=None):
        self.powers, self.terms, self.levels = tuple(powers), tuple(terms), levels
        self.inputs, self.outputs, self.dt = inputs, (output,), dt
        self.substeps, self.linear_hold = substeps, linear_hold
        self.states = (Signal(f"{output.name} before", output.unit), output)[-len(self.powers) :]
        units = {signal.name: signal.unit for signal in inputs} | {"1": "-"}
        rate = quotient(output.unit, "s")
        fed = [Parameter(term, quotient(rate, units[term]), 0.0) for term in self.terms]
        stores = list(zip(self.states, self.powers, strict=True))
        drains = [
            Parameter(f"drain of {state.name}", _drain_unit(output.unit, power), 0.0, 0.0)
            for state, power in stores
        ]
        bent = [Parameter(f"power of {state.name}", "-", power, LOWEST, HIGHEST) for state, power in stores]
        self.parameters = (*fed, *drains, *(bent if levels else ()))

    def drains(self) -> tuple[np.ndarray, np.ndarray]:
        """Return coefficients and powers of the drains k x^m."""
        coefficients, powers = np.split(self.nominal[len(self.terms) :], [len(self.powers)])
        if not self.levels:
            return coefficients, np.array(self.powers)
        return coefficients / np.array(self.levels) ** powers, powers

    def first_states(self, y, slope):
        """Return the level measured and, before it, the one whose drain makes up for its slope."""
        coefficients, powers = self.drains()
        if powers.size == 1:
            return y[:, None]
        fed = np.maximum(slope + coefficients[1] * np.maximum(y, 0.0) ** powers[1], 0.0)
        return np.column_stack([(fed / max(coefficients[0], 1e-300)) ** (1 / powers[0]), y])

    def with_terms(self, kept):
        """Return the equation with these terms, None where a drain or every inflow would be left out."""
        terms = [term for term in self.terms if term in kept]
        if not terms or not {p.name for p in self.parameters[len(self.terms) :]} <= set(kept):
            return None
        return self._like(self.powers, terms)

    def with_powers(self, powers):
        """Return the equation with these powers, no longer parameters; flows at the levels stay."""
        coefficients = self.nominal[len(self.terms) :][: len(powers)] / np.array(self.levels) ** powers
        drains = [p.name for p in self.parameters[len(self.terms) :][: len(powers)]]
        return self._like(powers, self.terms).with_parameters(dict(zip(drains, coefficients, strict=True)))

    def _equations(self):
        places = {s.name: f"u[{i}]" for i, s in enumerate(self.inputs)} | {"1": "1.0"}
        n, first = len(self.powers), len(self.terms)
        powers = [f"p[{first + n + i}]" if self.levels else repr(self.powers[i]) for i in range(n)]
        equation = _equation(
            tuple(places[term] for term in self.terms), tuple(powers), tuple(self.levels or (1.0,) * n)
        )
        return equation, picker((n - 1,))

    def __repr__(self) -> str:
        return describe(self, f"StoresSimulator of {len(self.powers)}, dt={self.dt:g} s")


def _drain_unit(unit: str, power: float) -> str:
    """Return the unit of k in k x^m, empty where that of x is not known."""
    exponent = 1.0 - power
    if not unit or exponent == 0.0:
        return "1/s" if unit else ""
    written = unit if abs(exponent) == 1.0 else f"{unit}^{abs(exponent):.3g}"
    return f"{written}/s" if exponent > 0 else f"1/s/{written}"


@lru_cache(maxsize=64)
def _equation(fed: tuple[str, ...], powers: tuple[str, ...], levels: tuple[float, ...]):
    """Return the compiled right-hand side; the drains' coefficients come after those of what is fed."""
    lines = ["flow = " + " + ".join(f"p[{i}] * {at}" for i, at in enumerate(fed))]
    for i, (power, level) in enumerate(zip(powers, levels, strict=True)):
        lines.append(f"drained = p[{len(fed) + i}] * (max(x[{i}], 0.0) / {float(level)!r}) ** {power}")
        lines.append(f"written[{i}] = flow - drained")
        lines.append("flow = drained")
    return compiled_lines(lines, {}, {}, "The twin")


def identify_stores(trace: Trace, good_enough: float) -> tuple[StoresSimulator, float] | None:
    """Return the stores in a row that run like a trace, and their error; None where there are none.

    Parameters
    ----------
    trace : Trace
    good_enough : float
        Held-out error over the output's standard deviation, above which another store is tried.

    Returns
    -------
    (StoresSimulator, float) or None
    """
    if trace.y.min() < -EMPTY * trace.y.std():
        return None
    best = best_fitted(trace, (_starts(trace, count) for count in COUNTS), good_enough)
    if best is None or best[1] >= good_enough:
        return best
    return without_idle_terms(trace, *_settled(trace, *best))


def _starts(trace: Trace, count: int) -> Iterator[StoresSimulator]:
    """Yield stores that drain at their mean levels as the linear map through the trace does."""
    linear = linear_map(trace, count)
    level = trace.y.mean()
    if linear is None or not np.isfinite(linear.gains).all():
        return
    if level <= 0 or np.any(linear.poles.real >= 0):
        return
    terms = [*(signal.name for signal in trace.inputs), "1"]
    rates = dict.fromkeys(permutations(np.abs(linear.poles)))
    for power, linear_hold, order in product(POWERS, (False, True), rates):
        through = order[-1] * level / power  # what flows through all of them at the mean level
        levels = [through * power / rate for rate in order]
        fed = order[-1] * linear.gains
        simulator = StoresSimulator(
            (power,) * count,
            terms,
            trace.inputs,
            trace.output,
            dt=trace.dt,
            substeps=linear.substeps,
            linear_hold=linear_hold,
            levels=tuple(levels),
        )
        values = [*fed, through - fed @ trace.u.mean(axis=0), *(through,) * count, *(power,) * count]
        yield simulator.with_parameters(values)


def _settled(trace: Trace, simulator: StoresSimulator, error: float) -> tuple[StoresSimulator, float]:
    """Return the stores with powers that are no longer parameters: halves, where these run as well."""
    powers = simulator.drains()[1].tolist()
    halves = [max(round(2 * power), 1) / 2 for power in powers]
    return (
        as_good(trace, simulator.with_powers(halves), error)
        or fitted(trace, simulator.with_powers(powers))
        or (simulator, error)
    )

"""A curve of unknown shape at every port, and what is like it where something moves."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis
from narx_sklearn.discrepancy.search.places import (
    Argument,
    alone,
    arguments,
    beside_inputs,
    moving,
    parts_read,
    read_from,
    seen_or_not,
)
from narx_sklearn.discrepancy.search.unnamed.broken_line import (
    KNOTS,
    ends_of,
    force_of_line,
    knots_as_parameters,
    line_added,
)
from narx_sklearn.discrepancy.search.unnamed.kinds import CURVE
from narx_sklearn.discrepancy.search.unnamed.linear import linear_hypothesis
from narx_sklearn.discrepancy.search.unnamed.polynomials import driven, of_motion
from narx_sklearn.discrepancy.simulators.simulator import Simulator
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.simulators.sums import Sum


def curve_hypotheses(simulator: Simulator, structure: Structure, u: np.ndarray, x: np.ndarray, y: np.ndarray):
    """Return an unnamed curve for each place and argument, its knots spread over what the run visits."""
    found = []
    for i in np.flatnonzero(structure.inputs.any(axis=0)).tolist():
        found.append(curve_at(Port("input", int(i)), Argument((), *simulator.inputs[i]), u[:, i]))
    for i, signal in enumerate(simulator.outputs):
        found.append(curve_at(Port("output", i), Argument((), *signal), y[:, i]))
        found += _read(Port("output", i), simulator, structure, np.column_stack([u, x]))
    for i in np.flatnonzero(~structure.kinematic).tolist():
        port = Port("state", i)
        for argument in moving(i, simulator, structure):
            found.append(curve_at(port, argument, x @ np.array(argument.weights)))
        if structure.partner[i] >= 0:
            for argument in arguments("position", i, simulator, structure):
                position = x @ np.array(argument.weights)
                found.append(of_motion(port, argument, position, simulator.dt))
                for j in np.flatnonzero(structure.inputs[i]).tolist():
                    found.append(driven(port, argument, position, simulator, j, u[:, j]))
    of_all = np.column_stack([u, x])
    behind: list[tuple[int, np.ndarray, Sum | None]] = [(i, x[:, i], None) for i in structure.handed_on]
    behind += [(of.state, of_all @ np.array(of.weights), of) for of in structure.sums]
    for i, values, of in behind:
        curve = curve_at(Port("state", i), alone(i, simulator), values)
        if curve is not None:
            at_state = curve.placed
            placed = replace(at_state, handed_on=True) if of is None else of.under(at_state, simulator)
            found += [curve._replace(placed=seen) for seen in seen_or_not(placed, structure)]
    known = [hypothesis for hypothesis in found if hypothesis is not None]
    return known + [
        hypothesis._replace(placed=beside)
        for hypothesis in known
        if hypothesis.placed.port.kind == "state" and not hypothesis.placed.handed_on
        for beside in beside_inputs(hypothesis.placed, simulator, structure)
    ]


def curve_at(port: Port, argument: Argument, values: np.ndarray) -> Hypothesis | None:
    """Return a curve over the values that an argument has; None where it does not change."""
    values = values[np.isfinite(values)]
    if values.size == 0 or np.ptp(values) <= 0:
        return None
    low, high = ends_of(values)
    if not high > low:
        return None
    fixed = knots_as_parameters(np.linspace(low, high, KNOTS))
    names = [f"f{i + 1}" for i in range(KNOTS)]
    return linear_hypothesis(
        CURVE, "f(x), a broken line", names, fixed, force_of_line, port, argument, transform=line_added
    )


def _read(
    port: Port, simulator: Simulator, structure: Structure, signals: np.ndarray
) -> Iterator[Hypothesis | None]:
    """Yield a curve of each signal of which an output is made, where these are several.

    What one of them adds need not be in proportion to it, as what a current takes off a voltage.
    """
    for j, signal in parts_read(port.index, simulator, structure):
        found = curve_at(port, Argument((), *signal), signals[:, j])
        if found is not None:
            curve = replace(found.placed.effect, equation="f(w), a broken line")
            yield found._replace(placed=read_from(curve, port.index, j, simulator).at(found.placed.theta))

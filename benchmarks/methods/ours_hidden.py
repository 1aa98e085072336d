"""Models with signals that nobody measured: further outputs of a NARX model, fitted through the one measured.

A circuit's inner voltage, an upper tank's level, a hysteretic force: each has an equation of its own, and
`refine_free_run` fits all of them to the measured output, since a free run reads no measured outputs.

The phi regressors of an output are functions of its difference. A function of the signal x itself is one of
the difference of a signal that adds x up: with p[k] = p[k-1] + x[k-1], |p[k] - p[k-1]| is |x[k-1]|.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from narx_sklearn.identification import LinearConstraints
from narx_sklearn.model import NARXModel, Phi

Equations = dict[str, dict[str, float]]
Condition = tuple[
    Mapping[tuple[str, str], float], float
]  # sum of weight * parameter of (output, term) = value


def equations_of(model: NARXModel) -> Equations:
    """Return every output's terms and parameters."""
    return {output: {str(term): c for term, c in model.equation(output).items} for output in model.outputs}


def build(equations: Equations, phi: Sequence[Phi] = ()) -> NARXModel:
    """Return the model of equations in the input u; the first output is the measured one."""
    return NARXModel.from_equations(equations, outputs=tuple(equations), inputs=("u",), phi=tuple(phi))


def extended(model: NARXModel, more: Equations, phi: Sequence[Phi] = ()) -> NARXModel:
    """Return the model with more terms (those it has keep their parameters), outputs and phi regressors."""
    equations = equations_of(model)
    for output, terms in more.items():
        equations[output] = terms | equations.get(output, {})
    return build(equations, (*model.phi, *phi))


def conditions(model: NARXModel, wanted: Sequence[Condition]) -> LinearConstraints:
    """Return linear conditions on the parameters in the order that `refine_free_run` has them."""
    columns, rows = np.nonzero(model.parameters.T)
    names = [str(term) for term in model.library]
    place = {(model.outputs[c], names[r]): i for i, (c, r) in enumerate(zip(columns, rows, strict=True))}
    S = np.zeros((len(wanted), len(place)))
    for row, (weights, _) in zip(S, wanted, strict=True):
        for key, weight in weights.items():
            row[place[key]] = weight
    return LinearConstraints(S, np.array([value for _, value in wanted]))


def lags(signal: str, values: Sequence[float], first: int = 1) -> dict[str, float]:
    """Return the terms signal[k-first], signal[k-first-1], ... with their parameters."""
    return {
        f"{signal}[k-{lag}]" if lag else f"{signal}[k]": float(v) for lag, v in enumerate(values, start=first)
    }

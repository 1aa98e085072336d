"""How a parameter of the simulation depends on a signal, in words."""

import numpy as np

from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.unnamed.kinds import VARYING
from narx_sklearn.discrepancy.search.unnamed.varying import line_of
from narx_sklearn.discrepancy.simulators.simulator import Simulator

NO_UNIT = ("", "-", "1")


def dependence_in_words(placed: PlacedEffect, sure: np.ndarray, simulator: Simulator) -> str:
    """Return how a parameter depends on a signal, as a sentence; empty for what is of another kind.

    Parameters
    ----------
    sure : ndarray of shape (2 or 3, 2)
        Confidence intervals of the change per unit of the signal, of where that is counted from, and of how
        it bends.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy import ODESimulator
    >>> from narx_sklearn.discrepancy.dependence import dependence_in_words
    >>> from narx_sklearn.discrepancy.placed import PlacedEffect, Port
    >>> from narx_sklearn.discrepancy.search.unnamed.varying import PARAMETER_THAT_VARIES
    >>> cell = ODESimulator(lambda x, u, p: (-p[0] * u[0],), dt=1.0, parameters={"R0 [ohm]": 0.06},
    ...                     states=["v [V]"], inputs=["current [A]", "temperature [degC]"])
    >>> warmer = PlacedEffect(PARAMETER_THAT_VARIES, Port("parameter", 0), second=(0.0, 1.0, 0.0),
    ...                       theta=(-0.012, 25.0), second_name="temperature", second_unit="degC")
    >>> dependence_in_words(warmer, np.array([[-0.0125, -0.0115], [25.0, 25.0]]), cell)
    'The parameter R0 depends on temperature: it falls by 1.2 % per degC (1.15 to 1.25 %) about 25 degC.'
    >>> valve = ODESimulator(lambda x, u, p: (-p[0] * u[0],), dt=1.0, parameters={"opening [%]": 20.0},
    ...                      states=["v [V]"], inputs=["flow", "temperature [degC]"])
    >>> dependence_in_words(warmer, np.array([[-0.0125, -0.0115], [25.0, 25.0]]), valve)[46:]
    'it falls by 1.2 % of its value per degC (1.15 to 1.25 %) about 25 degC.'
    """
    if placed.effect.code != VARYING:
        return ""
    parameter, line = simulator.parameters[placed.port.index], line_of(placed)
    if line is not None:
        return _along_a_line(parameter.name, placed, *line)
    change, reference, *bend = placed.theta
    sizes = np.sort(100 * np.sign(change) * np.array(sure[0]))
    name, unit = placed.second_name, placed.second_unit
    per, about = unit, f"{reference:.4g} {unit}"
    if unit in NO_UNIT:
        per, about = f"unit of {name}", f"{reference:.4g}"
    low, high = (f"{size:.4g}" for size in sizes)
    moves = "rises" if change > 0 else "falls"
    of_it = " of its value" if parameter.unit == "%" else ""
    square = f"({per})^2" if " " in per or "/" in per else f"{per}^2"
    bends = f", and bends by {100 * bend[0]:+.4g} % per {square} there" if bend else ""
    return (
        f"The parameter {parameter.name} depends on {name}: it {moves} by {100 * abs(change):.4g} %{of_it} "
        f"per {per} ({low} to {high} %) about {about}{bends}."
    )


def _along_a_line(parameter: str, placed: PlacedEffect, knots: np.ndarray, heights: np.ndarray) -> str:
    name, unit = placed.second_name, "" if placed.second_unit in NO_UNIT else f" {placed.second_unit}"
    middle = int(np.argmin(np.ptp(placed.bounds[: knots.size], axis=1)))  # which is held at 1
    others = ", ".join(
        f"{height:.4g} at {at:.4g}{unit}"
        for k, (at, height) in enumerate(zip(knots, heights, strict=True))
        if k != middle
    )
    return (
        f"The parameter {parameter} depends on {name}: times its value at {knots[middle]:.4g}{unit} it is "
        f"{others}; straight between them."
    )

"""The input that holds a machine where its reference begins, from its record and its static equation."""

import warnings
from dataclasses import dataclass

import numpy as np

from narx_sklearn.compensation._polynomial_roots import WIDEST, held_root
from narx_sklearn.compensation.law import BRANCHES, CompensationLaw
from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.simulation import free_run
from narx_sklearn.model.terms import Variable

__all__ = ["HoldingInput", "middle_of_record", "static_line"]

AT_REST = 0.01  # of the mean step: a record whose input begins with less begins at rest
SETTLING = 1000  # samples in which a law finds the input that holds the first reference


@dataclass(frozen=True, eq=False)
class HoldingInput:
    """What is known of the inputs that hold a machine.

    Parameters
    ----------
    signals : tuple of str
        What the model calls the followed output and the other known signals.
    is_continuum : bool
        Whether the model can rest anywhere, so that every input holds.
    line : (float, float) or None
        Intercept and slope of the input over the output in the record.
    points : (outputs, inputs) or None
        Outputs, and inputs that went with them, as the model keeps them of its record.
    static : tuple of Polynomial or None
        Coefficients of the input's powers in the model's static equation.
    """

    signals: tuple[str, ...]
    is_continuum: bool
    line: tuple[float, float] | None
    points: tuple[tuple, tuple] | None
    static: tuple[Polynomial, ...] | None

    @property
    def is_recorded(self) -> bool:
        """Whether a record tells of inputs and outputs that went together."""
        return self.line is not None or self.points is not None

    def at(self, known, law: CompensationLaw) -> float:
        """Return the input that holds known signals, the reference first, as far as law or record know it."""
        r = float(np.asarray(known).reshape(-1)[0])
        low, high = law.limits
        guess = r
        if self.line is not None:
            guess = self.line[0] + self.line[1] * r
        elif self.points is not None:
            guess = float(np.interp(r, *self.points))
        guess = float(min(max(guess, low), high))
        if self.is_continuum:
            return guess
        held = self._solved(known, guess, law)
        if held is not None:
            return held
        row = np.asarray(known, dtype=float).reshape(1, -1)
        settled = law.run(np.repeat(row, SETTLING, axis=0), m=guess).m
        calm = abs(settled[-1] - settled[-2]) <= 1e-9 * (1.0 + abs(settled[-1]))
        ran_away = abs(settled[-1]) > WIDEST  # and is kept there, because the next would not be finite
        return float(settled[-1]) if calm and not ran_away else guess

    def _solved(self, known, guess: float, law: CompensationLaw) -> float | None:
        """Return the input at which the model's static equation holds, of several the nearest to a guess.

        Where there is none within the limits it is the one that comes nearest, and None where there is no
        such equation.
        """
        if self.static is None:
            return None
        values = np.asarray(known, dtype=float).reshape(-1)
        held = {Variable(name, 0): value for name, value in zip(self.signals, values, strict=True)}
        c = np.trim_zeros(np.array([float(power(held)) for power in self.static]), "b")
        low, high = law.limits
        if c.size < 2 or not np.isfinite(c).all():
            return None
        if not self.is_recorded:
            guess = float(min(max(0.0, low), high))  # the reference's number says nothing of an input
        too_low = -float(np.polynomial.polynomial.polyval(guess, c))
        return held_root(c, low, high, guess, too_low * BRANCHES[law.branch])


def middle_of_record(model: NARXModel, followed: str, driving: str) -> tuple[tuple, tuple] | None:
    """Return outputs and the inputs that went with them, as far as a model keeps them of its record."""
    outputs, inputs = model.recorded.get(followed), model.recorded.get(driving)
    if outputs is None or inputs is None:
        return None
    rises = _rises(model, next(name for name in (driving, followed) if name in model.inputs))
    return None if rises is None else (outputs, inputs if rises else inputs[::-1])


def static_line(u: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Return the line of the input over the output, as intercept and slope.

    It goes through the first sample where the record begins at rest, else through the mean: a sample in
    motion may lie anywhere in the loop, and where it is the record's first one even outside.
    """
    known = np.isfinite(u) & np.isfinite(y)
    if known.sum() < 2 or np.ptp(y[known]) == 0.0:
        return float(np.mean(u[known])) if known.any() else 0.0, 0.0
    slope = np.cov(u[known], y[known])[0, 1] / np.var(y[known], ddof=1)
    steps = np.abs(np.diff(u[known]))
    at_rest = steps[0] <= AT_REST * np.mean(steps)
    u_held, y_held = (u[known][0], y[known][0]) if at_rest else (np.mean(u[known]), np.mean(y[known]))
    return float(u_held - slope * y_held), float(slope)


def _rises(model: NARXModel, name: str) -> bool | None:
    """Tell whether a model's output rises with an input over the latter's recorded range; None if unknown."""
    n_samples = max(SETTLING, model.max_lag + 2)
    mean = {s: model.recorded.get(s, (0.0, 0.0, 0.0))[1] for s in model.outputs + model.inputs}
    X = np.tile([mean[s] for s in model.inputs], (n_samples, 1))
    least, _, most = model.recorded[name]
    X[:, model.inputs.index(name)] = np.linspace(least, most, n_samples)
    y_init = np.tile([mean[s] for s in model.outputs], (n_samples, 1))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DivergenceWarning)  # a run that is lost tells nothing
        run = free_run(model, X, y_init)
    moved = run.y[-1, 0] - run.y[0, 0]
    return bool(moved > 0) if run.stopped_at is None and moved != 0 else None

"""Fixed points of a model under constant inputs, and their stability."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from narx_sklearn.analysis._checks import check_levels
from narx_sklearn.analysis._held import hold_at_rest, solve
from narx_sklearn.model.narx import NARXModel

__all__ = ["FixedPoint", "FixedPoints", "fixed_points"]

HYPERBOLIC = 1e-9  # distance of the spectral radius from 1 under which the linearisation decides nothing


@dataclass(frozen=True, eq=False)
class FixedPoint:
    """One solution of the steady-state equation.

    Attributes
    ----------
    y : ndarray of shape (n_outputs,)
        Outputs at rest, in their units.
    eigenvalues : ndarray of shape (n_eigenvalues,)
        Eigenvalues of the Jacobian (2.31), complex; the largest modulus first.
    """

    y: np.ndarray
    eigenvalues: np.ndarray

    @property
    def radius(self) -> float:
        """Spectral radius: the largest modulus of the eigenvalues."""
        return float(np.abs(self.eigenvalues).max(initial=0.0))

    @property
    def stability(self) -> str:
        """``"stable"``, ``"unstable"``, or ``"non-hyperbolic"`` where an eigenvalue of modulus 1 decides."""
        if abs(self.radius - 1.0) <= HYPERBOLIC:
            return "non-hyperbolic"
        return "stable" if self.radius < 1.0 else "unstable"


@dataclass(frozen=True, eq=False)
class FixedPoints:
    """All fixed points of a model for one constant input.

    Attributes
    ----------
    model : NARXModel
        The model.
    u : ndarray of shape (n_inputs,)
        The constant inputs, in their units.
    points : tuple of FixedPoint
        Isolated fixed points, by increasing (first) output.
    is_continuum : bool
        Whether instead every output (of several outputs: a line of them) is a fixed point.
    is_exhaustive : bool
        Whether there can be no others. False where they were searched for: several nonlinear outputs, or a
        user's function of an output.
    """

    model: NARXModel
    u: np.ndarray
    points: tuple[FixedPoint, ...]
    is_continuum: bool
    is_exhaustive: bool

    def __len__(self) -> int:
        return len(self.points)

    def __iter__(self):
        return iter(self.points)

    def __getitem__(self, index: int) -> FixedPoint:
        return self.points[index]

    @property
    def stable(self) -> tuple[FixedPoint, ...]:
        """The asymptotically stable ones."""
        return tuple(point for point in self.points if point.stability == "stable")

    def to_text(self, digits: int = 5) -> str:
        """Return inputs, and one line a fixed point."""
        at = ", ".join(f"{s} = {v:.{digits}g}" for s, v in zip(self.model.inputs, self.u, strict=True))
        lines = [f"Fixed points{' at ' if at else ''}{at}:"]
        for point in self.points:
            where = ", ".join(
                f"{s} = {v:.{digits}g}" for s, v in zip(self.model.outputs, point.y, strict=True)
            )
            lines.append(f"  {where}: {point.stability}, spectral radius {point.radius:.{digits}g}")
        if self.is_continuum:
            lines.append("  a continuum: the steady-state equation holds for every output")
        elif not self.points:
            lines.append("  none found")
        if not self.is_exhaustive:
            lines.append("  found by search; there may be others")
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.to_text()

    def to_frame(self) -> pd.DataFrame:
        """Return one row a fixed point: outputs, spectral radius, stability."""
        columns = {s: [point.y[i] for point in self.points] for i, s in enumerate(self.model.outputs)}
        columns["radius"] = [point.radius for point in self.points]
        columns["stability"] = [point.stability for point in self.points]
        return pd.DataFrame(columns)


def fixed_points(model: NARXModel, u=(), *, phi: Mapping[str, float] | None = None) -> FixedPoints:
    r"""Find the outputs at which a model rests for a constant input, and tell which attract.

    Solves :math:`\bar y = F(\bar y, \bar u, \bar\phi)` and evaluates the eigenvalues of the Jacobian there;
    all inside the unit circle make the fixed point asymptotically stable. A fitted model with other fixed
    points than its machine has learned the record and not the machine.

    Parameters
    ----------
    model : NARXModel
        The model.
    u : array-like of shape (n_inputs,), default=()
        Constant inputs, in their units.
    phi : mapping of {str: float}, default=None
        Values at which phi regressors are held. Those not named take their value at rest: differences and
        signs are zero, a regressor with memory has followed an input that never moved before.

    Returns
    -------
    FixedPoints
        All real solutions for one output or linear equations; else what a search from many starts found.

    Raises
    ------
    ValueError
        If ``u`` does not fit the model, ``phi`` names no phi regressor, or a phi regressor of an output has
        memory and no value in ``phi``.

    Notes
    -----
    Where a phi regressor of an output jumps or has a kink at rest (the sign or the absolute value of a
    difference), its slope is taken as zero: stability is that of the model with this regressor held.

    References
    ----------
    Aguirre and Mendes (1996); Lacerda Junior (2021), Definitions 2.3 and 2.4, eqs. (2.31)-(2.33).

    Examples
    --------
    >>> from narx_sklearn.analysis import fixed_points
    >>> from narx_sklearn.model import NARXModel
    >>> model = NARXModel.from_equations("0.5*y[k-1] + 0.5*y[k-1]^2 - 0.5*u[k-1]")
    >>> print(fixed_points(model, [0.75]))
    Fixed points at u = 0.75:
      y = -0.5: stable, spectral radius 0
      y = 1.5: unstable, spectral radius 2
    """
    levels = check_levels(model, np.reshape(np.asarray(u, dtype=float), (1, -1)))
    solutions = solve(hold_at_rest(model, levels, phi))
    points = []
    for y, eigenvalues in zip(solutions.y[0], solutions.eigenvalues[0], strict=True):
        points.append(FixedPoint(y, eigenvalues[np.argsort(-np.abs(eigenvalues), kind="stable")]))
    points.sort(key=lambda point: tuple(point.y))
    return FixedPoints(
        model, levels[0], tuple(points), bool(solutions.is_continuum[0]), solutions.is_exhaustive
    )

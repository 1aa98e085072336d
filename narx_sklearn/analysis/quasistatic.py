"""Quasi-static analysis: what attracts and repels the output while the input slowly loads and unloads."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from narx_sklearn.analysis._checks import check_driver, check_levels, check_output
from narx_sklearn.analysis._held import Held, hold, resting_phi, solve
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.phi import AsymmetricSign, DifferenceSign, FunctionPhi

__all__ = ["BoundingStructure", "QuasiStaticSets", "bounding_structure", "quasi_static_sets"]

VANISHING_RATE = 1e-290  # has a sign; times any parameter it is nothing
DIRECTIONS = {1: "loading", -1: "unloading"}


@dataclass(frozen=True, eq=False)
class QuasiStaticSets:
    """Solutions of the quasi-static equation (4.3) in loading and unloading.

    Attributes
    ----------
    model : NARXModel
        The model.
    driver, output : str
        Names of the input that moves and the output looked at.
    sample : ndarray of shape (n_points,)
        Row of ``X`` that each point belongs to.
    level : ndarray of shape (n_points,)
        Value of the driver that acts on the output there (at its shortest lag), in its unit.
    direction : ndarray of shape (n_points,)
        1 in loading, -1 in unloading.
    y : ndarray of shape (n_points, n_solutions)
        Solutions, in the unit of the output; NaN where a point has fewer.
    radius : ndarray of shape (n_points, n_solutions)
        Spectral radius of the Jacobian at each solution.
    """

    model: NARXModel
    driver: str
    output: str
    sample: np.ndarray
    level: np.ndarray
    direction: np.ndarray
    y: np.ndarray
    radius: np.ndarray

    @property
    def is_attracting(self) -> np.ndarray:
        """Which solutions fulfil the eigenvalue condition (4.4), shape (n_points, n_solutions)."""
        return self.radius < 1.0

    def select(self, direction: int, *, attracting: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return one of the four sets: levels, and solutions with NaN where they belong to the other kind.

        Parameters
        ----------
        direction : {1, -1}
            1 for loading, -1 for unloading.
        attracting : bool
            True for the attracting set, False for the repelling one.

        Returns
        -------
        level : ndarray of shape (n_points_of_direction,)
        y : ndarray of shape (n_points_of_direction, n_solutions)
        """
        rows = self.direction == direction
        return self.level[rows], np.where(self.is_attracting[rows] == attracting, self.y[rows], np.nan)

    def to_frame(self) -> pd.DataFrame:
        """Return one row a solution: sample, level, regime, solution, spectral radius, whether attracting."""
        point, solution = np.nonzero(np.isfinite(self.y))
        return pd.DataFrame(
            {
                "sample": self.sample[point],
                self.driver: self.level[point],
                "regime": [DIRECTIONS[d] for d in self.direction[point]],
                self.output: self.y[point, solution],
                "radius": self.radius[point, solution],
                "attracting": self.is_attracting[point, solution],
            }
        )


def quasi_static_sets(
    model: NARXModel,
    X,
    *,
    rate: float | None = None,
    driver: str | None = None,
    output: str | None = None,
    phi: Mapping[str, float] | None = None,
) -> QuasiStaticSets:
    r"""Find the attracting and repelling sets between which a hysteresis loop forms.

    While the input moves much more slowly than the model responds, outputs of neighbouring samples are
    about equal, :math:`y_{k-j} \approx \tilde y`, and

    .. math:: \tilde y = F(\tilde y, u_{k-\tau_d}, \ldots, \phi_{1,k-\tau_d}, \ldots, \phi_{2,k-\tau_d}, ...)

    is solved at every sample. A solution where the Jacobian has all eigenvalues inside the unit circle
    attracts the output, another repels it; which solutions act changes with the direction of the input.

    Parameters
    ----------
    model : NARXModel
        The model, with any phi regressors.
    X : array-like of shape (n_samples,) or (n_samples, n_inputs)
        A loading-unloading input, in its unit, held before its first sample. With ``rate``: levels.
    rate : float, default=None
        Difference of the driver from sample to sample, in its unit. Given, ``X`` holds levels in order,
        each passed at this rate upwards (loading) and downwards (unloading). None: ``X`` is a signal.
    driver : str, default=None
        Input that loads and unloads; None is the only one.
    output : str, default=None
        Output to look at; None is the first.
    phi : mapping of {str: float}, default=None
        Values at which phi regressors are held instead.

    Returns
    -------
    QuasiStaticSets
        Samples at which the driver rests are left out.

    Raises
    ------
    ValueError
        If ``X`` does not fit the model, ``rate`` is not positive, ``driver``, ``output`` or ``phi`` is not
        known, or a phi regressor of an output has memory and no value in ``phi``.

    Notes
    -----
    Level and direction are those of the driver at its shortest lag d in the model, so that a point at level
    u stands where (4.6) has its u. With a rate, lag i reads the level minus ``(i - d) * rate``; a play is
    dragged along fully.

    References
    ----------
    Lacerda Junior (2021), section 4.2.2, eqs. (4.3), (4.4).

    Examples
    --------
    >>> from narx_sklearn.analysis import quasi_static_sets
    >>> from narx_sklearn.model import DifferenceSign, NARXModel
    >>> model = NARXModel.from_equations("0.9*y[k-1] + 0.5*phi2[k-1]", phi=[DifferenceSign("u", name="phi2")])
    >>> sets = quasi_static_sets(model, [0.0, 1.0], rate=0.01)
    >>> sets.direction.tolist(), sets.y.ravel().round(9).tolist()
    ([1, 1, -1, -1], [5.0, 5.0, -5.0, -5.0])
    """
    X, output, driver = check_levels(model, X), check_output(model, output), check_driver(model, driver)
    if rate is None:
        held, level, direction = _hold_along_signal(model, X, driver, phi)
        sample = np.arange(X.shape[0])
    elif 0 < rate < np.inf:
        held, level, direction = _hold_at_levels(model, X, driver, float(rate), phi)
        sample = np.tile(np.arange(X.shape[0]), 2)
    else:
        raise ValueError(f"rate must be positive and finite (input unit a sample), got {rate!r}.")
    solutions = solve(held)
    moving = direction != 0
    return QuasiStaticSets(
        model,
        driver,
        output,
        sample[moving],
        level[moving],
        direction[moving],
        solutions.y[moving, :, model.outputs.index(output)],
        solutions.radius[moving],
    )


def _hold_along_signal(model: NARXModel, X: np.ndarray, driver: str, phi) -> tuple:
    """Hold the model at every sample of a signal."""
    columns = dict(zip(model.inputs, X.T, strict=True))
    runs: dict[str, np.ndarray] = {}

    def read_phi(one, lag):
        if one.name not in runs:
            runs[one.name] = one.run(*(columns[s] for s in dict.fromkeys(v.signal for v in one.arguments)))
        return _delayed(runs[one.name], lag)

    held = hold(model, X.shape[0], lambda signal, lag: _delayed(columns[signal], lag), read_phi, phi)
    level = _delayed(columns[driver], _shortest_lag(model, driver))
    return held, level, np.sign(np.diff(level, prepend=level[:1])).astype(int)


def _hold_at_levels(model: NARXModel, X: np.ndarray, driver: str, rate: float, phi) -> tuple:
    """Hold the model at levels of the driver that are passed upwards, then at the same passed downwards."""
    first = _shortest_lag(model, driver)
    n_levels = X.shape[0]
    resting = resting_phi(model, X)

    def column(signal):
        return X[:, model.inputs.index(signal)]

    def read_input(signal, lag):
        step = rate * (lag - first) if signal == driver else 0.0
        return np.concatenate([column(signal) - step, column(signal) + step])

    def read_phi(one, lag):
        if driver not in one.signals:
            return np.tile(resting(one, lag), 2)
        if isinstance(one, FunctionPhi):
            return one.function(*(read_input(v.signal, lag + v.lag) for v in one.of))
        passed = read_input(driver, lag)
        return np.concatenate(
            [
                np.broadcast_to(one.quasi_static(passed[:n_levels], rate), n_levels),
                np.broadcast_to(one.quasi_static(passed[n_levels:], -rate), n_levels),
            ]
        )

    held: Held = hold(model, 2 * n_levels, read_input, read_phi, phi)
    return held, np.tile(column(driver), 2), np.repeat([1, -1], n_levels)


def _shortest_lag(model: NARXModel, driver: str) -> int:
    """Return the lag at which the driver first acts, itself or through a phi regressor."""
    through = {driver} | {str(p.name) for p in model.phi if driver in p.signals}
    return min((v.lag for v in model.library.variables if v.signal in through), default=0)


def _delayed(values: np.ndarray, lag: int) -> np.ndarray:
    """Delay by ``lag`` samples; the first value is held."""
    return values[np.maximum(np.arange(values.size) - lag, 0)]


@dataclass(frozen=True, eq=False)
class BoundingStructure:
    """Equilibria of the loading and the unloading regime, which confine the hysteresis loop.

    Attributes
    ----------
    sets : QuasiStaticSets
        The equilibria, for a rate that vanishes.
    theorem : str or None
        ``"2.2"`` or ``"2.3"`` where the model has the form of that theorem (with sign-like phi regressors of
        one input), which then guarantees a loop if the structure is stable; None where it has not.
    """

    sets: QuasiStaticSets
    theorem: str | None

    @property
    def is_stable(self) -> bool:
        """Whether each level has an attracting equilibrium in loading and in unloading (Property 2.2)."""
        reached = np.any(self.sets.is_attracting & np.isfinite(self.sets.y), axis=1)
        return bool(reached.size and reached.all())

    @property
    def width(self) -> float:
        """Largest distance between attracting equilibria of loading and unloading, in output units."""
        (_, up), (_, down) = (self.sets.select(d, attracting=True) for d in (1, -1))
        distances = np.abs(up[:, :, None] - down[:, None, :])
        return float(np.nanmax(distances)) if np.isfinite(distances).any() else 0.0

    def to_text(self, digits: int = 5) -> str:
        """Return the structure in words."""
        lines = []
        for direction, regime in DIRECTIONS.items():
            rows = self.sets.direction == direction
            found = self.sets.y[rows][np.isfinite(self.sets.y[rows])]
            if not found.size:
                lines.append(f"{regime}: no equilibrium")
                continue
            low, high = f"{found.min():.{digits}g}", f"{found.max():.{digits}g}"
            where = low if low == high else f"{low} to {high}"
            radius = np.nanmax(self.sets.radius[rows])
            lines.append(
                f"{regime}: {self.sets.output} = {where}, spectral radius up to {radius:.{digits + 3}g}"
            )
        if self.is_stable and self.width > 0.0:
            reason = f"Theorem {self.theorem}" if self.theorem else "Property 2.2"
            lines.append(f"stable in both regimes: it confines a hysteresis loop ({reason})")
        elif self.is_stable:
            lines.append("stable, but the same in both regimes: no loop follows from it")
        else:
            lines.append("not stable in both regimes: it does not confine a loop; see quasi_static_sets")
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.to_text()


def bounding_structure(
    model: NARXModel, X, *, driver: str | None = None, output: str | None = None
) -> BoundingStructure:
    r"""Find the equilibria of loading and unloading that confine a hysteresis loop.

    In a slow loading regime the first difference is about 0 and its sign is 1, in unloading -1. For the
    form of Theorem 2.3,

    .. math:: \bar y = \frac{\Sigma_0 \pm \Sigma_{\phi_2}}{1 - \Sigma_y \mp \Sigma_{y\phi_2}},
        \qquad -1 < \Sigma_y \pm \Sigma_{y\phi_2} < 1,

    the condition (for unit delays) being that of stability. As the input slows down, the loop approaches the
    structure.

    Parameters
    ----------
    model : NARXModel
        The model.
    X : array-like of shape (n_levels,) or (n_levels, n_inputs)
        Input levels, in their units, in order.
    driver : str, default=None
        Input that loads and unloads; None is the only one.
    output : str, default=None
        Output to look at; None is the first.

    Returns
    -------
    BoundingStructure

    Raises
    ------
    ValueError
        As `quasi_static_sets`.

    See Also
    --------
    quasi_static_sets : The sets for a rate that does not vanish, needed where a model rests anywhere.

    References
    ----------
    Martins and Aguirre (2016); Lacerda Junior (2021), Theorems 2.2 and 2.3, eqs. (2.60), (2.62), (2.63).

    Examples
    --------
    >>> from narx_sklearn.analysis import bounding_structure
    >>> from narx_sklearn.model import DifferenceSign, NARXModel
    >>> model = NARXModel.from_equations("0.9*y[k-1] + 0.5*phi2[k-1]", phi=[DifferenceSign("u", name="phi2")])
    >>> print(bounding_structure(model, [-1.0, 1.0]))
    loading: y = 5, spectral radius up to 0.9
    unloading: y = -5, spectral radius up to 0.9
    stable in both regimes: it confines a hysteresis loop (Theorem 2.2)
    """
    sets = quasi_static_sets(model, X, rate=VANISHING_RATE, driver=driver, output=output)
    return BoundingStructure(sets, _theorem(model, sets.driver))


def _theorem(model: NARXModel, driver: str) -> str | None:
    """Return the theorem whose form the model has: one output, one sign-like phi of the driver."""
    if len(model.outputs) != 1:
        return None
    clusters = {frozenset(term.cluster) for term, _ in model.expanded().equation().items}
    y = (model.outputs[0], 1)
    for phi in model.phi:
        if isinstance(phi, DifferenceSign | AsymmetricSign) and phi.signal == driver:
            sign = (str(phi.name), 1)
            linear = {frozenset({y}), frozenset({sign})}
            if frozenset({sign}) in clusters and clusters <= linear:
                return "2.2"
            if frozenset({sign}) in clusters and clusters <= linear | {frozenset(), frozenset({y, sign})}:
                return "2.3"
    return None

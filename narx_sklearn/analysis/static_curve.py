"""The static curve of a model: its fixed points over a range of constant inputs."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from narx_sklearn.analysis._checks import check_driver, check_levels, check_output
from narx_sklearn.analysis._held import hold_at_rest, solve
from narx_sklearn.model.narx import NARXModel

__all__ = ["StaticCurve", "static_curve"]


@dataclass(frozen=True, eq=False)
class StaticCurve:
    """Branches of fixed points over constant inputs.

    Attributes
    ----------
    model : NARXModel
        The model.
    driver, output : str
        Names of the input and the output that are looked at.
    levels : ndarray of shape (n_levels,)
        Constant values of that input, in its unit.
    y : ndarray of shape (n_levels, n_branches)
        Fixed points of the output, in its unit; NaN where a branch does not exist.
    radius : ndarray of shape (n_levels, n_branches)
        Their spectral radii.
    is_continuum : ndarray of shape (n_levels,)
        Where every output is a fixed point.
    is_exhaustive : bool
        Whether there can be no other fixed points.
    """

    model: NARXModel
    driver: str
    output: str
    levels: np.ndarray
    y: np.ndarray
    radius: np.ndarray
    is_continuum: np.ndarray
    is_exhaustive: bool

    @property
    def is_stable(self) -> np.ndarray:
        """Which fixed points are asymptotically stable, shape (n_levels, n_branches)."""
        return self.radius < 1.0

    def to_frame(self) -> pd.DataFrame:
        """Return one row a fixed point: input, branch, output, spectral radius, whether stable."""
        level, branch = np.nonzero(np.isfinite(self.y))
        return pd.DataFrame(
            {
                self.driver: self.levels[level],
                "branch": branch,
                self.output: self.y[level, branch],
                "radius": self.radius[level, branch],
                "stable": self.is_stable[level, branch],
            }
        )


def static_curve(
    model: NARXModel,
    X,
    *,
    driver: str | None = None,
    output: str | None = None,
    phi: Mapping[str, float] | None = None,
) -> StaticCurve:
    r"""Return the fixed points of a model over a range of constant inputs.

    The curve is what the machine's own static characteristic (a titration curve, a valve's flow) is
    compared with. Several branches, or unstable ones, are a property of the model that its one-step errors
    do not show.

    Parameters
    ----------
    model : NARXModel
        The model.
    X : array-like of shape (n_levels,) or (n_levels, n_inputs)
        Constant inputs, in their units, one row a level; in order, so that branches can be followed.
    driver : str, default=None
        Input the levels are told by; None is the only one.
    output : str, default=None
        Output to look at; None is the first.
    phi : mapping of {str: float}, default=None
        Values at which phi regressors are held, as in `fixed_points`.

    Returns
    -------
    StaticCurve

    Raises
    ------
    ValueError
        As `fixed_points`; or if ``driver`` or ``output`` is not known.

    References
    ----------
    Aguirre and Mendes (1996); Lacerda Junior (2021), Definition 2.3 and Remark 2.5.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.analysis import static_curve
    >>> from narx_sklearn.model import NARXModel
    >>> model = NARXModel.from_equations("0.8*y[k-1] + 0.1*u[k-1]^2")
    >>> static_curve(model, [0.0, 1.0, 2.0]).y.ravel().round(12).tolist()
    [0.0, 0.5, 2.0]
    """
    X, output = check_levels(model, X), check_output(model, output)
    driver = check_driver(model, driver)
    solutions = solve(hold_at_rest(model, X, phi))
    return StaticCurve(
        model,
        driver,
        output,
        X[:, model.inputs.index(driver)],
        solutions.y[:, :, model.outputs.index(output)],
        solutions.radius,
        solutions.is_continuum,
        solutions.is_exhaustive,
    )

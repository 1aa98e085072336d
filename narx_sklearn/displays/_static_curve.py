"""Figure of the static curve: branches of fixed points over a constant input."""

import numpy as np

from narx_sklearn.analysis._checks import unit_label
from narx_sklearn.analysis.static_curve import StaticCurve, static_curve
from narx_sklearn.displays._of_model import ModelDisplay
from narx_sklearn.displays._style import BLUE, VERMILION, import_pyplot


class StaticCurveDisplay(ModelDisplay):
    """Static curve of a model, stable branches full, unstable ones dashed.

    Use :meth:`from_model`; the constructor takes a finished result.

    Parameters
    ----------
    curve : StaticCurve
        Result of :func:`narx_sklearn.analysis.static_curve`.

    Attributes
    ----------
    figure_ : matplotlib Figure
        The figure drawn in; exists after :meth:`plot`.
    ax_ : matplotlib Axes
        The axes drawn in.
    stable_, unstable_ : list of matplotlib Line2D
        One line a branch.

    Examples
    --------
    >>> from narx_sklearn.analysis import static_curve
    >>> from narx_sklearn.displays import StaticCurveDisplay
    >>> from narx_sklearn.model import NARXModel
    >>> curve = static_curve(NARXModel.from_equations("0.8*y[k-1] + 0.1*u[k-1]^2"), [0.0, 1.0, 2.0])
    >>> len(StaticCurveDisplay(curve).to_frame())
    3
    """

    def __init__(self, curve: StaticCurve):
        self.curve = curve

    @classmethod
    def from_model(cls, model, X, *, driver=None, output=None, phi=None, ax=None):
        """Compute the static curve of a model and draw it.

        Parameters
        ----------
        model : NARXModel
            The model.
        X : array-like of shape (n_levels,) or (n_levels, n_inputs)
            Constant inputs, in their units.
        driver, output : str, default=None
            Input and output on the axes; None is the only input and the first output.
        phi : mapping of {str: float}, default=None
            Values at which phi regressors are held.
        ax : matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        display : StaticCurveDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            As :func:`narx_sklearn.analysis.static_curve`.
        """
        return cls(static_curve(model, X, driver=driver, output=output, phi=phi)).plot(ax=ax)

    def plot(self, ax=None):
        """Draw every branch.

        Parameters
        ----------
        ax : matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        self : StaticCurveDisplay
            With ``figure_``, ``ax_``, ``stable_`` and ``unstable_``.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        """
        plt = import_pyplot()
        self.ax_ = plt.subplots(layout="constrained")[1] if ax is None else ax
        self.figure_ = self.ax_.figure
        curve = self.curve
        self.stable_ = self._draw_branches(True, color=BLUE, linewidth=1.8)
        self.unstable_ = self._draw_branches(False, color=VERMILION, linestyle="--")
        if curve.is_continuum.any():
            self.ax_.text(
                0.5,
                0.5,
                "every output is a steady state",
                ha="center",
                va="center",
                transform=self.ax_.transAxes,
            )
            self.ax_.set_xlim(np.min(curve.levels), np.max(curve.levels))
        if not np.isfinite(curve.y).any():
            self.ax_.set_yticks([])
        self.ax_.set(
            xlabel=f"constant {unit_label(curve.model, curve.driver)}",
            ylabel=f"{unit_label(curve.model, curve.output)} at rest",
        )
        if self.unstable_:
            self.ax_.legend(frameon=False)
        return self

    def _draw_branches(self, stable: bool, **style) -> list:
        lines: list = []
        for y, is_stable in zip(self.curve.y.T, self.curve.is_stable.T, strict=True):
            wanted = np.isfinite(y) & (is_stable == stable)
            if wanted.any():
                label = "_again" if lines else "stable" if stable else "unstable"
                shown = np.where(_with_next(wanted), y, np.nan)
                lines += self.ax_.plot(self.curve.levels, shown, label=label, **style)
        return lines

    def to_frame(self):
        """Return the numbers drawn, one row per fixed point.

        Returns
        -------
        frame : DataFrame
            As :meth:`narx_sklearn.analysis.StaticCurve.to_frame`.
        """
        return self.curve.to_frame()


def _with_next(mask):
    """Extend runs of True by one sample at their end, so that lines of neighbouring kinds meet."""
    return mask | np.concatenate([[False], mask[:-1]])

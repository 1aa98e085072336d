"""Figure of a found effect: its force or correction against what it depends on, over a cloud of data."""

import numpy as np
import pandas as pd

from narx_sklearn.discrepancy.locate import force_curve
from narx_sklearn.displays._effect_force import effect_force, labels
from narx_sklearn.displays._style import BLUE, GREY, VERMILION, import_pyplot

MOST_POINTS = 2500  # of the cloud
SHOWN = (0.005, 0.995)  # quantiles of what is drawn that set the vertical range


class EffectCurveDisplay:
    """A found effect as a curve, over what the recording asks for at its place.

    Use :meth:`from_estimator`; the constructor takes finished numbers.

    Parameters
    ----------
    argument : ndarray of shape (n_points,)
        The signal that the effect depends on.
    fitted : ndarray of shape (n_points,)
        What the effect, as fitted, adds there.
    needed : ndarray of shape (n_points,)
        What the recording asks for there.
    argument_label, force_label : str, default="argument" and "force"
        Quantities and units of the axes.
    title : str, default=""
        Name of the effect.

    Attributes
    ----------
    figure_ : matplotlib Figure
        The figure drawn in; exists after :meth:`plot`.
    ax_ : matplotlib Axes
        The axes drawn in.
    medians_ : DataFrame
        Medians of ``needed`` in bins of the argument, with 95 % intervals.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.displays import EffectCurveDisplay
    >>> x = np.sin(np.arange(2000) / 30)
    >>> display = EffectCurveDisplay(x, -(x**3), -(x**3) + 0.01 * np.cos(np.arange(2000)))
    >>> bool(np.abs(display.medians_["force"] + display.medians_["argument"] ** 3).max() < 0.03)
    True
    """

    def __init__(self, argument, fitted, needed, *, argument_label="argument", force_label="force", title=""):
        self.argument = argument
        self.fitted = fitted
        self.needed = needed
        self.argument_label = argument_label
        self.force_label = force_label
        self.title = title

    @classmethod
    def from_estimator(cls, estimator, *, effect=0, ax=None):
        """Evaluate an effect that a diagnosis added along the recording it was fitted to, and draw.

        What the recording asks for is what the effect adds plus the force that the corrected simulation still
        lacks at that place, estimated by a Kalman smoother.

        Parameters
        ----------
        estimator : DiscrepancyRegressor
            Fitted; it holds its recording.
        effect : int, default=0
            Which of the effects added, counted from 0 in the order of ``findings_``.
        ax : matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        display : EffectCurveDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        TypeError
            If the estimator is no fitted DiscrepancyRegressor.
        ValueError
            If nothing was added, or no such effect.
        """
        conclusion = getattr(estimator, "conclusion_", None)
        if conclusion is None:
            raise TypeError(
                f"{type(estimator).__name__} holds no diagnosis; pass a fitted DiscrepancyRegressor."
            )
        diagnosis = conclusion.diagnosis
        best = diagnosis.best
        added = best.effects
        if not 0 <= effect < len(added):
            raise ValueError(
                f"effect is {effect!r}, but the diagnosis ({estimator.verdict_}) added {len(added)} effects, "
                "counted from 0."
            )
        model = best.fit.model
        index = len(model.effects) - len(added) + diagnosis.order[effect]
        force = effect_force(diagnosis.problem, model, index, MOST_POINTS)
        placed = model.effects[index]
        argument_label, force_label = labels(placed, diagnosis.problem.simulator)
        display = cls(
            *force, argument_label=argument_label, force_label=force_label, title=placed.effect.title
        )
        return display.plot(ax=ax)

    @property
    def medians_(self) -> pd.DataFrame:
        """Medians of ``needed`` in bins of ``argument``, with intervals ``low`` to ``high``."""
        return force_curve(self.needed, self.argument)

    def plot(self, ax=None):
        """Draw the cloud, its medians with their intervals, and the effect as fitted.

        Parameters
        ----------
        ax : matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        self : EffectCurveDisplay
            With ``figure_`` and ``ax_``.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        """
        plt = import_pyplot()
        self.ax_ = plt.subplots(figsize=(6, 4), layout="constrained")[1] if ax is None else ax
        self.figure_ = self.ax_.figure
        dots = {"s": 7, "linewidth": 0}
        self.ax_.scatter(
            self.argument, self.needed, color=GREY, alpha=0.4, label="recording asks for", **dots
        )
        self.ax_.scatter(self.argument, self.fitted, color=VERMILION, label="effect as fitted", **dots)
        medians = self.medians_
        self.ax_.plot(
            medians["argument"], medians["force"], color=BLUE, linewidth=1.3, label="median, 95 % interval"
        )
        self.ax_.fill_between(
            medians["argument"], medians["low"], medians["high"], color=BLUE, alpha=0.25, linewidth=0
        )
        low, high = np.nanquantile(np.concatenate([self.needed, self.fitted]), SHOWN)
        if high > low:
            self.ax_.set_ylim(low - 0.15 * (high - low), high + 0.15 * (high - low))
        self.ax_.set(xlabel=self.argument_label, ylabel=self.force_label, title=self.title)
        self.ax_.legend(frameon=False, fontsize="small")
        return self

    def to_frame(self) -> pd.DataFrame:
        """Return the points drawn: ``argument``, ``fitted``, ``needed``."""
        return pd.DataFrame({"argument": self.argument, "fitted": self.fitted, "needed": self.needed})

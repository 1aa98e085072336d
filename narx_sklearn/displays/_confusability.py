"""Figure of what an input can tell apart: angles between the traces that effects would leave."""

import numpy as np

from narx_sklearn.discrepancy.before_measuring import confusability
from narx_sklearn.displays._style import import_pyplot

ALIKE = 20.0  # degrees below which two effects are called look-alikes: cosine above 0.94


class ConfusabilityDisplay:
    """Matrix of look-alikes: the angle between what two missing effects would do to the output.

    0 degrees: the same trace, no record of this input can tell them apart. 90 degrees: nothing in common.
    Use :meth:`from_simulator`; the constructor takes a finished result.

    Parameters
    ----------
    angles : DataFrame of shape (n_effects, n_effects)
        Angles in degrees, as :func:`narx_sklearn.discrepancy.before_measuring.confusability` returns them.
    alike : float, default=20.0
        Degrees below which a pair counts as look-alikes.

    Attributes
    ----------
    figure_ : matplotlib Figure
        The figure drawn in; exists after :meth:`plot`.
    ax_ : matplotlib Axes
        The axes drawn in.
    image_ : matplotlib AxesImage
        The matrix.

    Examples
    --------
    >>> import pandas as pd
    >>> from narx_sklearn.displays import ConfusabilityDisplay
    >>> names = ["drag", "friction", "spring"]
    >>> angles = pd.DataFrame([[0.0, 12.0, 80.0], [12.0, 0.0, 85.0], [80.0, 85.0, 0.0]], names, names)
    >>> ConfusabilityDisplay(angles).lookalikes_
    [('drag', 'friction', 12.0)]
    """

    def __init__(self, angles, *, alike=ALIKE):
        self.angles = angles
        self.alike = alike

    @classmethod
    def from_simulator(cls, simulator, X, *, effects, noise, alike=ALIKE, ax=None):
        """Compute the angles for an input, before anything is measured, and draw.

        Parameters
        ----------
        simulator : Simulator
            The simulation as it stands.
        X : array-like of shape (n_samples, n_inputs)
            The input that will be used.
        effects : "catalogue" or list of (str or Effect)
            What might be missing, by code or as entries of one's own.
        noise : float or sequence of float
            Standard deviation of the measurement noise, in the output's unit; one value an output, or one.
        alike : float, default=20.0
            Degrees below which a pair counts as look-alikes.
        ax : matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        display : ConfusabilityDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        TypeError, ValueError
            If an effect, the input or the noise does not fit; see
            :func:`narx_sklearn.discrepancy.before_measuring.confusability`.
        """
        angles, _ = confusability(simulator, X, effects=effects, noise=noise)
        return cls(angles, alike=alike).plot(ax=ax)

    @property
    def lookalikes_(self) -> list[tuple[str, str, float]]:
        """Pairs below ``alike`` degrees with their angle, the most alike first."""
        names, values = list(self.angles.index), self.angles.to_numpy()
        pairs = [
            (names[i], names[j], float(values[i, j]))
            for i in range(len(names))
            for j in range(i + 1, len(names))
            if values[i, j] < self.alike
        ]
        return sorted(pairs, key=lambda pair: pair[2])

    def plot(self, ax=None):
        """Draw the matrix, the angle written into each cell.

        Parameters
        ----------
        ax : matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        self : ConfusabilityDisplay
            With ``figure_``, ``ax_`` and ``image_``.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        """
        plt = import_pyplot()
        n = len(self.angles)
        if ax is None:
            ax = plt.subplots(figsize=(3.5 + 0.45 * n, 2.5 + 0.4 * n), layout="constrained")[1]
        self.ax_ = ax
        self.figure_ = ax.figure
        values = self.angles.to_numpy()
        self.image_ = ax.imshow(values, vmin=0.0, vmax=90.0, cmap="cividis")
        for i, j in np.ndindex(n, n):
            if i != j:
                alike = values[i, j] < self.alike
                ax.text(
                    j,
                    i,
                    f"{values[i, j]:.0f}",
                    ha="center",
                    va="center",
                    fontsize="small",
                    fontweight="bold" if alike else "normal",
                    color="white" if values[i, j] < 50 else "black",
                )
        ax.set_xticks(np.arange(n), self.angles.columns, rotation=45, ha="right", rotation_mode="anchor")
        ax.set_yticks(np.arange(n), self.angles.index)
        self.figure_.colorbar(self.image_, ax=ax, label="angle (degrees), 0 is alike", shrink=0.8)
        return self

    def to_frame(self):
        """Return the angles drawn, in degrees, shape (n_effects, n_effects)."""
        return self.angles

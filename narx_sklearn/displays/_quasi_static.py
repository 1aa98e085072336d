"""Figure of the quasi-static sets: what attracts and repels the output along a hysteresis loop."""

import numpy as np

from narx_sklearn.analysis._checks import check_driver, inputs_along, unit_label
from narx_sklearn.analysis.loops import HysteresisLoop, hysteresis_loop
from narx_sklearn.analysis.quasistatic import QuasiStaticSets, quasi_static_sets
from narx_sklearn.displays._hysteresis import draw_direction
from narx_sklearn.displays._of_model import ModelDisplay
from narx_sklearn.displays._style import BLUE, VERMILION, import_pyplot
from narx_sklearn.signals.loading import loading_unloading

HEADROOM = 1.5  # of the loop's height shown above and below it; the sets run to infinity
REGIMES = {"both": (1, -1), "loading": (1,), "unloading": (-1,)}
COLORS = {1: "black", -1: BLUE}  # attracting sets
NAMES = {1: "loading", -1: "unloading"}


class QuasiStaticDisplay(ModelDisplay):
    """Attracting and repelling sets of loading and unloading, with the loop that forms between them.

    Use :meth:`from_model`; the constructor takes finished results.

    Parameters
    ----------
    sets : QuasiStaticSets
        Result of :func:`narx_sklearn.analysis.quasi_static_sets`.
    loop : HysteresisLoop, default=None
        Loop of the same model; it sets the range of the output that is shown.

    Attributes
    ----------
    figure_ : matplotlib Figure
        The figure drawn in; exists after :meth:`plot`.
    ax_ : matplotlib Axes
        The axes drawn in.
    attracting_, repelling_ : dict of {int: list of matplotlib Line2D}
        Lines of each set, by direction (1 loading, -1 unloading).
    loop_ : matplotlib Line2D or None
        The loop.

    Examples
    --------
    >>> from narx_sklearn.analysis import quasi_static_sets
    >>> from narx_sklearn.displays import QuasiStaticDisplay
    >>> from narx_sklearn.model import DifferenceSign, NARXModel
    >>> model = NARXModel.from_equations("0.9*y[k-1] + 0.5*phi2[k-1]", phi=[DifferenceSign("u", name="phi2")])
    >>> len(QuasiStaticDisplay(quasi_static_sets(model, [0.0, 1.0], rate=0.1)).to_frame())
    4
    """

    def __init__(self, sets: QuasiStaticSets, loop: HysteresisLoop | None = None):
        self.sets = sets
        self.loop = loop

    @classmethod
    def from_model(
        cls,
        model,
        u_min,
        u_max,
        *,
        samples_per_branch=500,
        shape="sine",
        driver=None,
        output=None,
        at=None,
        direction="both",
        ax=None,
    ):
        """Compute sets and loop of a model for a periodic loading-unloading input, and draw.

        Parameters
        ----------
        model : NARXModel
            The model.
        u_min, u_max : float
            Extrema of the input, in its unit.
        samples_per_branch : int, default=500
            Samples from one extremum to the other.
        shape : {"triangle", "sine"}, default="sine"
            Shape of the input.
        driver, output : str, default=None
            Input that moves and output looked at; None is the only input and the first output.
        at : mapping of {str: float}, default=None
            Constant values of the other inputs; the operating point where not given.
        direction : {"both", "loading", "unloading"}, default="both"
            Which sets to draw.
        ax : matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        display : QuasiStaticDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            As :func:`narx_sklearn.analysis.hysteresis_loop`.
        """
        driver = check_driver(model, driver)
        options = {"samples_per_branch": samples_per_branch, "shape": shape, "driver": driver}
        loop = hysteresis_loop(model, u_min, u_max, output=output, at=at, **options)
        u = loading_unloading((u_min, u_max), samples_per_branch, shape=shape, n_periods=1)
        X = inputs_along(model, driver, np.append(u, u[0]), at)
        sets = quasi_static_sets(model, X, driver=driver, output=output)
        return cls(sets, loop).plot(ax=ax, direction=direction)

    def plot(self, ax=None, *, direction="both"):
        """Draw attracting sets as full lines, repelling ones dash-dotted, the loop dotted.

        Parameters
        ----------
        ax : matplotlib Axes, default=None
            Where to draw; None makes a figure.
        direction : {"both", "loading", "unloading"}, default="both"
            Which sets to draw.

        Returns
        -------
        self : QuasiStaticDisplay
            With ``figure_``, ``ax_``, ``attracting_``, ``repelling_`` and ``loop_``.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            If ``direction`` is not known.
        """
        if direction not in REGIMES:
            raise ValueError(f"direction={direction!r} is not known; choose one of {', '.join(REGIMES)}.")
        plt = import_pyplot()
        self.ax_ = plt.subplots(layout="constrained")[1] if ax is None else ax
        self.figure_ = self.ax_.figure
        self.attracting_ = {d: self._draw_set(d, True) for d in REGIMES[direction]}
        self.repelling_ = {d: self._draw_set(d, False) for d in REGIMES[direction]}
        self.loop_ = None
        if self.loop is not None:
            (self.loop_,) = self.ax_.plot(
                self.loop.u, self.loop.y, linestyle=":", color="black", linewidth=1.6, label="loop"
            )
            draw_direction(self.ax_, self.loop, "black")
            room = HEADROOM * self.loop.y_range
            self.ax_.set_ylim(self.loop.y.min() - room, self.loop.y.max() + room)
        sets = self.sets
        self.ax_.set(xlabel=unit_label(sets.model, sets.driver), ylabel=unit_label(sets.model, sets.output))
        self.ax_.legend(
            loc="upper center", bbox_to_anchor=(0.5, 1.14), ncols=3, frameon=False, fontsize="small"
        )
        return self

    def to_frame(self):
        """Return the sets drawn, one row per solution.

        Returns
        -------
        frame : DataFrame
            As :meth:`narx_sklearn.analysis.QuasiStaticSets.to_frame`.
        """
        return self.sets.to_frame()

    def _draw_set(self, direction: int, attracting: bool) -> list:
        level, y = self.sets.select(direction, attracting=attracting)
        style = {"color": COLORS[direction], "linewidth": 1.6, "label": f"attracting, {NAMES[direction]}"}
        if not attracting:
            style |= {"color": VERMILION, "label": f"repelling, {NAMES[direction]}"}
            style |= {"linestyle": "-." if direction > 0 else (0, (1.5, 1.5)), "linewidth": 1.4}
        lines = []
        for column in y.T:
            if np.isfinite(column).any():
                lines += self.ax_.plot(level, column, **style)
                style["label"] = "_again"
        return lines

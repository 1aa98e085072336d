"""Figure of hysteresis loops at several rates inside their bounding structure."""

import numpy as np
import pandas as pd

from narx_sklearn.analysis._checks import inputs_along, unit_label
from narx_sklearn.analysis.loops import HysteresisLoop, hysteresis_loop
from narx_sklearn.analysis.quasistatic import BoundingStructure, bounding_structure
from narx_sklearn.displays._of_model import ModelDisplay
from narx_sklearn.displays._style import BLUE, GREY, VERMILION, import_pyplot

N_LEVELS = 101  # levels at which the bounding structure is computed


class HysteresisLoopDisplay(ModelDisplay):
    """Hysteresis loops in the input-output plane, with the equilibria that confine them.

    Use :meth:`from_model`; the constructor takes finished results.

    Parameters
    ----------
    loops : sequence of HysteresisLoop
        Loops of one model, from the fastest input to the slowest.
    bounding : BoundingStructure, default=None
        Equilibria of loading and unloading.

    Attributes
    ----------
    figure_ : matplotlib Figure
        The figure drawn in; exists after :meth:`plot`.
    ax_ : matplotlib Axes
        The axes drawn in.
    loops_ : list of matplotlib Line2D
        One line a loop.
    bounding_ : list of matplotlib Line2D
        Attracting equilibria in loading and unloading.

    Examples
    --------
    >>> from narx_sklearn.analysis import hysteresis_loop
    >>> from narx_sklearn.displays import HysteresisLoopDisplay
    >>> from narx_sklearn.model import NARXModel, Play
    >>> play = NARXModel.from_equations("phi1[k]", phi=[Play("u", radius=1.0)])
    >>> display = HysteresisLoopDisplay([hysteresis_loop(play, -3.0, 3.0, samples_per_branch=60)])
    >>> len(display.to_frame())
    121
    """

    def __init__(self, loops: "list[HysteresisLoop]", bounding: BoundingStructure | None = None):
        self.loops = loops
        self.bounding = bounding

    @classmethod
    def from_model(
        cls,
        model,
        u_min,
        u_max,
        *,
        samples_per_branch=(100, 1000),
        shape="sine",
        driver=None,
        output=None,
        at=None,
        bounding=True,
        ax=None,
    ):
        """Simulate loops of a model, find its bounding structure, and draw.

        Parameters
        ----------
        model : NARXModel
            The model.
        u_min, u_max : float
            Extrema of the input, in its unit.
        samples_per_branch : sequence of int, default=(100, 1000)
            Samples from one extremum to the other, one loop each, from fast to slow.
        shape : {"triangle", "sine"}, default="sine"
            Shape of the input.
        driver, output : str, default=None
            Input that moves and output looked at; None is the only input and the first output.
        at : mapping of {str: float}, default=None
            Constant values of the other inputs; the operating point where not given.
        bounding : bool, default=True
            Whether to draw the bounding structure; it is left out where it is not stable.
        ax : matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        display : HysteresisLoopDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            As :func:`narx_sklearn.analysis.hysteresis_loop`.
        """
        options = {"shape": shape, "driver": driver, "output": output, "at": at}
        loops = [
            hysteresis_loop(model, u_min, u_max, samples_per_branch=n, **options) for n in samples_per_branch
        ]
        structure = bounding_of(loops[0], at) if bounding else None
        return cls(loops, structure if structure is not None and structure.is_stable else None).plot(ax=ax)

    def plot(self, ax=None):
        """Draw the loops as lines with the direction of travel, and the bounding structure as stars.

        Parameters
        ----------
        ax : matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        self : HysteresisLoopDisplay
            With ``figure_``, ``ax_``, ``loops_`` and ``bounding_``.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        """
        plt = import_pyplot()
        self.ax_ = plt.subplots(layout="constrained")[1] if ax is None else ax
        self.figure_ = self.ax_.figure
        self.loops_, self.bounding_ = [], []
        shades = [GREY, BLUE, "black"][-min(3, len(self.loops)) :]
        for i, loop in enumerate(self.loops):
            color = shades[min(i, len(shades) - 1)]
            label = f"loop, {loop.samples_per_branch} samples a branch"
            self.loops_ += self.ax_.plot(loop.u, loop.y, color=color, linewidth=1.4, label=label)
            draw_direction(self.ax_, loop, color)
        if self.bounding is not None:
            for direction, marker, label in ((1, "^", "loading"), (-1, "v", "unloading")):
                level, y = self.bounding.sets.select(direction, attracting=True)
                every = max(1, level.size // 25)
                for column in y.T:
                    self.bounding_ += self.ax_.plot(
                        level[::every],
                        column[::every],
                        linestyle="",
                        marker=marker,
                        markersize=5,
                        color=VERMILION,
                        label=f"equilibria, {label}",
                    )
        first = self.loops[0]
        self.ax_.set(
            xlabel=unit_label(first.model, first.driver), ylabel=unit_label(first.model, first.output)
        )
        self.ax_.margins(0.06)
        self.ax_.legend(frameon=True, framealpha=0.85, edgecolor="none", fontsize="small")
        return self

    def to_frame(self) -> pd.DataFrame:
        """Return the loops drawn, one row per sample, told apart by ``samples_per_branch``."""
        frames = [loop.to_frame().assign(samples_per_branch=loop.samples_per_branch) for loop in self.loops]
        return pd.concat(frames, ignore_index=True)


def bounding_of(loop: HysteresisLoop, at=None) -> BoundingStructure:
    """Return the bounding structure over the range of a loop."""
    levels = np.linspace(loop.u.min(), loop.u.max(), N_LEVELS)
    X = inputs_along(loop.model, loop.driver, levels, at)
    return bounding_structure(loop.model, X, driver=loop.driver, output=loop.output)


def draw_direction(ax, loop: HysteresisLoop, color) -> list:
    """Draw an arrow head in the middle of each branch, and return both."""
    arrows = []
    step = max(1, loop.samples_per_branch // 50)
    for middle in (loop.samples_per_branch // 2, loop.samples_per_branch * 3 // 2):
        start, end = (loop.u[middle - step], loop.y[middle - step]), (loop.u[middle], loop.y[middle])
        arrows.append(
            ax.annotate(
                "", end, start, arrowprops={"arrowstyle": "-|>", "color": color, "mutation_scale": 14}
            )
        )
    return arrows

"""The report's figures, as inline SVG that takes the page's text colour."""

import io
import re
from functools import wraps
from html import escape
from itertools import pairwise
from typing import Any
from zlib import crc32

import numpy as np

from narx_sklearn._validation import split_unit

BLUE, VERMILION, GREEN, GREY = "#2a86c4", "#d5602a", "#1d9a74", "#8a8f98"  # legible on white and on black
INK = "#012345"  # stands for the page's text colour until the figure is written
OWN_NAME = re.compile(r'\bid="|href="#|url\(#')  # what stands before a name inside a figure
WIDTH = 6.0  # inches; on a phone the texts are then still legible
FAR = 3.0  # times the recording's range, from which a run counts as lost
PIXELS = 900  # across a figure; a longer signal is drawn by its least and largest value in each
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "text.usetex": False,
    "text.parse_math": False,  # a dollar in a column's name is a dollar
    "svg.hashsalt": "narx_sklearn",  # the same figure gives the same text
    "font.family": "sans-serif",
    "font.size": 9.5,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 9,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
}


def _styled(draw):
    """Let a figure be drawn in the report's style, whatever the user's is."""

    @wraps(draw)
    def drawn(*arguments):
        try:
            from matplotlib import rc_context
        except ImportError as error:
            raise ImportError(
                'The report draws with matplotlib: pip install "narx-sklearn[report]"'
            ) from error
        with rc_context(STYLE):
            return draw(*arguments)

    return drawn


@_styled
def time_line(time, y, y_sim, residual, segments, label: str, name: str) -> str:
    """Draw a recording over its simulation, and their difference, with the found stretches shaded."""
    figure, (top, bottom) = _axes(2, 1, height=4.2, sharex=True, height_ratios=[3, 2])
    _line(top, time, y, GREY, "recorded", 1.6)
    _line(top, time, y_sim, BLUE, "simulated, parameters refitted", 0.9)
    _line(bottom, time, residual, VERMILION, None, 0.8)
    for start, stop in segments:
        for axes in (top, bottom):
            axes.axvspan(start, stop, color=VERMILION, alpha=0.16, linewidth=0)
    top.set_ylabel(label)
    bottom.set_ylabel(_like(label, "difference"))
    bottom.set_xlabel("time [s]")
    _legend(top)
    return to_svg(figure, name)


@_styled
def state_plane(a, b, size, a_label: str, b_label: str, name: str) -> str:
    """Draw where in two signals the mismatch is large: every sample a dot, redder where it is larger."""
    from matplotlib.colors import LinearSegmentedColormap

    figure, axes = _axes(1, 1, height=3.6)
    order = np.argsort(size)
    dots = axes.scatter(
        a[order],
        b[order],
        c=size[order],
        s=5 + 22 * size[order],
        cmap=LinearSegmentedColormap.from_list("mismatch", [GREY + "50", VERMILION]),
        linewidth=0,
        rasterized=True,
    )
    bar = figure.colorbar(dots, ax=axes, shrink=0.9, pad=0.02)
    bar.set_label("size of the mismatch, share of its largest")
    bar.outline.set_visible(False)
    axes.set_xlabel(a_label)
    axes.set_ylabel(b_label)
    return to_svg(figure, name)


@_styled
def course_figure(time, course, deviation, label: str, name: str) -> str:
    """Draw an unknown signal along a record, and how sure it is."""
    figure, axes = _axes(1, 1, height=2.6)
    known = np.isfinite(course)
    time, course, deviation = time[known], course[known], deviation[known]
    step = -(-time.size // PIXELS)
    thin = slice(None, None, step)
    low, high = course - 2 * deviation, course + 2 * deviation
    axes.fill_between(time[thin], low[thin], high[thin], color=VERMILION, alpha=0.2, linewidth=0)
    _line(axes, time, course, VERMILION, None, 0.9)
    axes.axhline(0.0, color=GREY, linewidth=0.6)
    axes.set_xlabel("time [s]")
    axes.set_ylabel(label)
    return to_svg(figure, name)


@_styled
def effect_figure(curve, name: str) -> str:
    """Draw what an effect adds over the cloud of what the data ask for."""
    figure, axes = _axes(1, 1, height=3.4)
    axes.scatter(
        curve.at,
        curve.needed,
        s=6,
        color=GREY,
        alpha=0.45,
        linewidth=0,
        rasterized=True,
        label="data ask for",
    )
    axes.scatter(
        curve.argument,
        curve.fitted,
        s=5,
        color=VERMILION,
        linewidth=0,
        rasterized=True,
        label="effect as fitted",
    )
    table = curve.table
    if len(table):
        axes.plot(table["argument"], table["force"], color=BLUE, linewidth=1.3, label="median of the data")
        axes.fill_between(table["argument"], table["low"], table["high"], color=BLUE, alpha=0.25, linewidth=0)
    low, high = np.nanquantile(np.concatenate([curve.needed, curve.fitted]), [0.005, 0.995])
    margin = 0.15 * (high - low) or 1.0
    axes.set_ylim(low - margin, high + margin)
    axes.set_xlabel(curve.x_label)
    axes.set_ylabel(curve.y_label)
    _legend(axes)
    return to_svg(figure, name)


@_styled
def before_and_after(time, y, runs: dict, label: str, name: str) -> str:
    """Draw a held-out stretch with the runs over it, and their errors below."""
    figure, (top, bottom) = _axes(2, 1, height=4.6, sharex=True, height_ratios=[3, 2])
    _line(top, time, y, GREY, "recorded", 2.2)
    for (called, run), colour in zip(runs.items(), (BLUE, GREEN), strict=False):
        _line(top, time, run, colour, called, 1.0)
        _line(bottom, time, y - run, colour, called, 0.9)
    bottom.axhline(0.0, color=INK, linewidth=0.5)
    top.set_ylabel(label)
    bottom.set_ylabel(_like(label, "error"))
    _frame(top, bottom, y, list(runs.values()))
    bottom.set_xlabel("time [s]")
    _legend(top)
    return to_svg(figure, name)


@_styled
def residual_figure(tests, name: str) -> str:
    """Draw the correlation functions of the residual tests within their bounds."""
    rows = -(-len(tests) // 2)
    figure, panels = _axes(rows, 2, height=1.65 * rows, squeeze=False)
    for panel, test in zip(panels.ravel(), tests, strict=False):
        colour = VERMILION if test.rejected else BLUE
        panel.fill_between(test.lags, -test.bound, test.bound, color=GREY, alpha=0.25, linewidth=0)
        panel.vlines(test.lags, 0.0, test.correlation, color=colour, linewidth=1.3)
        panel.axhline(0.0, color=INK, linewidth=0.5)
        panel.set_title(test.symbol, fontsize=9, color=INK)
    for panel in panels.ravel()[len(tests) :]:
        panel.set_visible(False)
    for panel in panels[-1]:
        panel.set_xlabel("lag [samples]")
    return to_svg(figure, name)


def to_svg(figure, name: str) -> str:
    """Return a figure as an ``<svg>`` element that screen readers call by its name."""
    number = f"{crc32(name.encode()):08x}"
    buffer = io.StringIO()
    figure.savefig(
        buffer, format="svg", dpi=150, metadata=dict.fromkeys(("Date", "Creator", "Format", "Type"))
    )
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    # several figures share a page: their inner names must differ; texts, in which "<" is escaped, stay
    svg = re.sub(
        r"<[^>]+>",
        lambda tag: OWN_NAME.sub(rf"\g<0>f{number}-", tag[0]).replace(INK, "currentColor"),
        svg,
    )
    head, body = svg.split(">", 1)
    head = re.sub(r'\s(width|height)="[^"]*"', "", head)
    return f'{head} role="img" aria-label="{escape(name)}">{body}'


def _axes(n_rows: int, n_columns: int, *, height: float, **options):
    """Return a figure that no window knows of, and its axes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = figure.subplots(n_rows, n_columns, **options)
    for panel in np.ravel(axes):
        panel.grid(color=GREY, alpha=0.25, linewidth=0.5)
        panel.set_axisbelow(True)
    return figure, axes


def _like(label: str, name: str) -> str:
    """Return a name with the unit of another label."""
    unit = split_unit(label)[1]
    return f"{name} [{unit}]" if unit else name


def _frame(top, bottom, y: np.ndarray, runs: list[np.ndarray]) -> None:
    """Keep the recording in sight where a run leaves it far behind."""
    low, high = np.nanmin(y), np.nanmax(y)
    span = (high - low) or 1.0
    if all(np.isfinite(run).all() and np.ptp(run) <= FAR * span for run in runs):
        return
    top.set_ylim(low - span, high + span)
    bottom.set_ylim(-2 * span, 2 * span)


def _legend(axes) -> None:
    axes.legend(loc="lower left", bbox_to_anchor=(0, 1.0), ncols=3, borderaxespad=0.2, markerscale=2)


def _line(axes, x, y, colour, label, width) -> None:
    axes.plot(*thinned(x, y), color=colour, linewidth=width, label=label)


def thinned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a line that looks the same on paper: the least and largest value for each pixel."""
    if x.size <= 3 * PIXELS:
        return x, y
    edges = np.linspace(0, x.size, PIXELS + 1).astype(int)
    keep = []
    for a, b in pairwise(edges):
        piece = y[a:b]
        if np.isfinite(piece).any():
            keep += sorted({a + int(np.nanargmin(piece)), a + int(np.nanargmax(piece))})
        else:
            keep.append(a)
    return x[keep], y[keep]

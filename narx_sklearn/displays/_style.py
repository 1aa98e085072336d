"""What the figures share: matplotlib when it is there, a few colours, and axes."""

import numpy as np

# Okabe and Ito's palette: told apart with any colour vision, and in grey by their lightness
BLUE = "#0072B2"
VERMILION = "#D55E00"
GREEN = "#009E73"
GREY = "#8C8C8C"


def import_pyplot():
    """Return ``matplotlib.pyplot``.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message says how to get it.
    """
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise ImportError('Figures need matplotlib: pip install "narx-sklearn[plot]"') from error
    return plt


def stacked_axes(ax):
    """Return two axes over one another, the upper larger: new ones, or those given."""
    plt = import_pyplot()
    if ax is not None:
        return tuple(check_axes(ax, 2))
    _, axes = plt.subplots(2, 1, sharex=True, height_ratios=(3, 1.3), figsize=(8, 4.6), layout="constrained")
    return tuple(axes)


def legend_above(axes) -> None:
    """Put the legend over the axes, where it hides no data."""
    axes.legend(
        frameon=False, fontsize="small", loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0.2, ncols=4
    )


def check_axes(ax, count: int) -> list:
    """Return the axes given as a list, of which there must be ``count``."""
    axes = list(np.ravel(ax))
    if len(axes) != count:
        raise ValueError(
            f"ax holds {len(axes)} axes, this figure has {count}. Pass {count}, or None for new ones."
        )
    return axes


def time_of(n_samples: int, sampling_period: float | None) -> tuple[np.ndarray, str]:
    """Return the time axis and its label: seconds, or samples where no period is known."""
    if sampling_period is None:
        return np.arange(n_samples), "sample"
    return np.arange(n_samples) * sampling_period, "time (s)"


def signal_label(name: str, unit: str) -> str:
    """Return a quantity with its unit, as axes carry it."""
    return f"{name} ({unit})" if unit else name

"""What the scripts of the thesis's examples share: where figures go, and how they look."""

import argparse
from pathlib import Path


def out_folder(description: str) -> Path:
    """Read the folder for the figure from the command line, and make it."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(), help="folder for the figure")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def new_figure(n_axes: int = 1, **options):
    """Return a figure and its axes, one beside the other."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(
        1, n_axes, figsize=(1 + 4.5 * n_axes, 4), layout="constrained", squeeze=False, **options
    )
    for ax in axes[0]:
        ax.spines[["top", "right"]].set_visible(False)
    return figure, axes[0][0] if n_axes == 1 else axes[0]


def save(figure, folder: Path, script: str) -> None:
    """Write the figure under the script's name and say where."""
    path = folder / f"{Path(script).stem}.png"
    figure.savefig(path, dpi=110)
    print(f"figure: {path}")

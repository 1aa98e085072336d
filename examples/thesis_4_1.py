"""Example 4.1: attracting and repelling sets explain a loop that can rest anywhere (Figure 4.2)."""

from pathlib import Path

from _thesis import new_figure, out_folder, save

from narx_sklearn.analysis import continuum_of_steady_states
from narx_sklearn.displays import QuasiStaticDisplay
from narx_sklearn.model import Difference, DifferenceSign, NARXModel

MODEL = NARXModel.from_equations(
    {
        "y[k-1]": 1.0,
        "phi1[k-1]": 0.77,
        "phi2[k-1]*phi1[k-1]*u[k-1]": 1.42e-2,
        "phi2[k-1]*phi1[k-1]*y[k-1]": -9.60e-3,
        "phi1[k-1]*u[k-1]^2": 3.16e-4,
        "phi1[k-1]*u[k-1]*y[k-1]": -2.47e-4,
    },
    phi=[Difference("u", name="phi1"), DifferenceSign("u", name="phi2")],
    sampling_period=0.001,
    units={"u": "V", "y": "um"},
)


def main(folder: Path) -> None:
    """Draw the sets in loading, in unloading, and together with the loop for u = 70 sin(2 pi t) V."""
    print(MODEL)
    print(continuum_of_steady_states(MODEL))
    figure, axes = new_figure(3, sharey=True)
    for ax, direction in zip(axes, ("loading", "unloading", "both"), strict=True):
        QuasiStaticDisplay.from_model(MODEL, -70, 70, samples_per_branch=500, direction=direction, ax=ax)
        ax.set_xlabel(f"u [V], {direction}")
    save(figure, folder, __file__)


if __name__ == "__main__":
    main(out_folder(__doc__))

"""Example 2.9: +-5 bound the loop, which nears them as the input slows (Figure 2.12)."""

from pathlib import Path

from _thesis import new_figure, out_folder, save

from narx_sklearn.analysis import bounding_structure
from narx_sklearn.displays import HysteresisLoopDisplay
from narx_sklearn.model import DifferenceSign, NARXModel


def main(folder: Path) -> None:
    """Draw a fast and a slow loop of model (2.59) between its equilibria."""
    model = NARXModel.from_equations("0.9*y[k-1] + 0.5*phi2[k-1]", phi=[DifferenceSign("u", name="phi2")])
    print(model)
    print(bounding_structure(model, [-1.0, 1.0]))
    figure, ax = new_figure()
    HysteresisLoopDisplay.from_model(model, -1, 1, samples_per_branch=(10, 300), ax=ax)
    save(figure, folder, __file__)


if __name__ == "__main__":
    main(out_folder(__doc__))

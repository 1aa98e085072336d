"""Example 2.10: an asymmetric multi-valued function (2.66) makes an asymmetric loop (Figure 2.14)."""

from pathlib import Path

from _thesis import new_figure, out_folder, save

from narx_sklearn.analysis import hysteresis_loop
from narx_sklearn.displays import HysteresisLoopDisplay
from narx_sklearn.model import AsymmetricSign, NARXModel


def main(folder: Path) -> None:
    """Draw the loop of model (2.59) with u while loading and -1 while unloading in place of the sign."""
    phi = [AsymmetricSign("u", rising=(0, 1), falling=(-1,), name="phi2")]
    model = NARXModel.from_equations("0.9*y[k-1] + 0.5*phi2[k-1]", phi=phi)
    print(model)
    loop = hysteresis_loop(model, -1, 1, samples_per_branch=300, shape="sine")
    print(f"asymmetry {100 * loop.asymmetry:.0f} % of the output's range")
    figure, ax = new_figure()
    HysteresisLoopDisplay.from_model(model, -1, 1, samples_per_branch=(30, 300), ax=ax)
    save(figure, folder, __file__)


if __name__ == "__main__":
    main(out_folder(__doc__))

"""From a recording to a model one can read, in five lines; then the figure that shows whether to trust it.

A mass on a hardening spring is shaken by a random force. The recording is made here, with noise on the
displacement sensor, so that the example needs no file; with your own, `frame = pandas.read_csv(...)`.
"""

import argparse
from pathlib import Path

from narx_sklearn import NARXRegressor
from narx_sklearn.analysis import residual_tests
from narx_sklearn.datasets import make_duffing
from narx_sklearn.metrics import rmse

N_TRAIN = 3000


def main(folder: Path) -> None:
    """Identify, print, draw."""
    folder.mkdir(parents=True, exist_ok=True)
    plant = make_duffing(4500, noise=0.01, random_state=0)
    force, position = plant.X, plant.y
    train, test = slice(0, N_TRAIN), slice(N_TRAIN, None)

    narx = NARXRegressor(output_lags=3, input_lags=3, degree=3, sampling_period=plant.sampling_period)
    narx.fit(force[train], position[train])
    simulated = narx.predict(force[test], y_init=position[test])
    error = rmse(position[test], simulated)

    print(narx.model_)
    print(narx.summary().to_string(index=False))
    print(f"\nnoise taken to be on the {narx.noise_}")
    print(f"free run on held-out data: RMSE {error:.3g} m, standard deviation {position[test].std():.3g} m")
    print(f"against the noise-free truth: RMSE {rmse(plant.truth.y[test], simulated):.3g} m")
    tests = residual_tests(position[test].to_numpy() - simulated, force[test])
    print(tests.verdict)
    draw(plant, test, simulated, folder / "quick_start.png")


def draw(plant, test, simulated, path: Path) -> None:
    """Draw measured and simulated output of the held-out part, and their difference."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    seconds = plant.sampling_period * plant.y.index.to_numpy()[test]
    measured = plant.y.to_numpy()[test]
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(8, 4.5), height_ratios=(3, 1))
    above.plot(seconds, 1e3 * measured, color="0.6", linewidth=3, label="measured")
    above.plot(seconds, 1e3 * simulated, color="C3", linewidth=1, label="free run of the model")
    above.set_ylabel("position [mm]")
    above.legend(loc="upper right", ncols=2, frameon=False)
    above.set_title("Held-out data: the model sees the force only", loc="left")
    below.plot(seconds, 1e3 * (measured - simulated), color="C3", linewidth=0.8)
    below.set_ylabel("error [mm]")
    below.set_xlabel("time [s]")
    below.set_xlim(seconds[0], seconds[0] + 0.4 * (seconds[-1] - seconds[0]))
    for axes in (above, below):
        axes.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    print(f"figure: {path}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(), help="folder for the figure")
    main(parser.parse_args().out)

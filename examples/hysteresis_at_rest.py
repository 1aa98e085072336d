"""Stop moving a piezo actuator: the true one stays where it is. Does its model?

An ordinary model has one steady state for each input and slides towards it as soon as the input rests. With
the hysteresis structure and the constraint of Lemma 4.1, every output is a steady state: the model remembers.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from narx_sklearn import NARXRegressor
from narx_sklearn.analysis import continuum_of_steady_states
from narx_sklearn.datasets import make_piezo_bench
from narx_sklearn.model import Difference, DifferenceSign
from narx_sklearn.physics import PIEZO_BENCH

PHI = (Difference("voltage", name="phi1"), DifferenceSign("voltage", name="phi2"))


def main(folder: Path) -> None:
    """Identify both models, stop the input half way down, compare where they go."""
    folder.mkdir(parents=True, exist_ok=True)
    plant = make_piezo_bench(20_000, random_state=0)
    usual = NARXRegressor(2, 2, delay=0, degree=1, refine=False).fit(plant.X, plant.y)
    resting = NARXRegressor(
        1,
        [0],
        delay=0,
        phi=PHI,
        phi_lags=[0],
        n_terms=9,
        degree=3,
        structure="hysteresis",
        constraints="continuum",
        fit_intercept=False,
        origin="zero",
        refine=False,
    ).fit(plant.X, plant.y)
    print(resting.model_)
    print(continuum_of_steady_states(resting.model_), end="\n\n")

    # up to 40 V, down to 10 V, then hold
    volts = np.concatenate([40 * np.sin(np.linspace(0, 2.4, 900)), np.full(2100, 40 * np.sin(2.4))])
    truth = PIEZO_BENCH.run(volts)
    X = pd.DataFrame({"voltage [V]": volts})
    runs = {
        "usual": usual.predict(X, y_init=truth[:2]),
        "at rest": resting.predict(X, y_init=truth[:1]),
    }
    for name, run in {"plant": truth, **runs}.items():
        print(
            f"{name:8s} moved by {run[-1] - run[900]:+7.3f} um while the voltage was held, "
            f"and ended {run[-1] - truth[-1]:+7.3f} um from the plant"
        )
    draw(volts, truth, runs, folder / "hysteresis_at_rest.png")


def draw(volts, truth, runs, path: Path) -> None:
    """Draw displacement over time and over voltage."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, (over_time, over_volts) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
    for name, y, style in (
        ("plant", truth, {"color": "0.6", "linewidth": 4}),
        ("usual model", runs["usual"], {"color": "C0", "linewidth": 1.2}),
        ("model that rests", runs["at rest"], {"color": "C3", "linewidth": 1.2}),
    ):
        over_time.plot(y, label=name, **style)
        over_volts.plot(volts, y, **style)
    over_time.axvline(900, color="black", linewidth=0.6)
    over_time.set(xlabel="sample", ylabel="displacement (um)", title="The input stops at the line")
    over_volts.set(xlabel="voltage (V)", ylabel="displacement (um)")
    over_time.legend(frameon=False)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(), help="folder for the figure")
    main(parser.parse_args().out)

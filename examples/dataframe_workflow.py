"""A DataFrame in, a DataFrame out: column names become terms, units go to the axes, the index stays.

Two tanks are filled by a pump. The table has a voltage, a level and a clock, as a data
logger would write them; nothing is turned into bare arrays on the way.
"""

import argparse
from pathlib import Path

import pandas as pd

from narx_sklearn import NARXModel, NARXRegressor
from narx_sklearn.analysis import residual_tests
from narx_sklearn.datasets import make_cascaded_tanks
from narx_sklearn.displays import FreeRunDisplay


def main(folder: Path) -> None:
    """Identify from columns, look at tables, save, load, draw."""
    folder.mkdir(parents=True, exist_ok=True)
    plant = make_cascaded_tanks(1500, noise=0.01, random_state=0)
    clock = pd.date_range("2024-05-06 08:00", periods=len(plant.y), freq="4s")
    table = plant.X.assign(**{plant.y.name: plant.y}).set_index(clock)
    print(table.head(3), end="\n\n")

    morning, later = table.iloc[:1000], table.iloc[1000:]
    narx = NARXRegressor(2, 3, degree=2, sampling_period=plant.sampling_period)
    narx.fit(morning[["pump [V]"]], morning["lower level [cm]"])
    print(narx.model_, end="\n\n")
    print(narx.summary().round(6).to_string(index=False), end="\n\n")

    display = FreeRunDisplay.from_estimator(narx, later[["pump [V]"]], later["lower level [cm]"])
    print(display.to_frame().set_index(later.index).tail(3), end="\n\n")
    residual = narx.residuals(later[["pump [V]"]], later["lower level [cm]"])
    print(residual_tests(residual, later[["pump [V]"]]).verdict)

    # what was identified is a value: text out, the same model back
    path = folder / "tanks.json"
    narx.model_.save(path)
    print(f"saved and read back: {NARXModel.load(path) == narx.model_}")
    display.figure_.savefig(folder / "dataframe_workflow.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(), help="folder for the figure")
    main(parser.parse_args().out)

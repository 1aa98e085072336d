"""Two tanks that run over, and a simulation whose tanks are infinitely high.

Torricelli's law is right, the pump is right, and yet the simulation is wrong now and then. Where? Only while
a tank is full. The upper one is not even measured.
"""

import argparse
from pathlib import Path

from narx_sklearn.datasets import make_cascaded_tanks
from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.displays import LocationDisplay

SUSPECTS = ["overflow", "input_saturation", "root_outflow", "input_polynomial", "sensor_clip"]


def tanks(x, u, p):
    """Levels of two tanks, one draining into the other, without a rim."""
    upper, lower = max(x[0], 0.0) ** 0.5, max(x[1], 0.0) ** 0.5
    return p[0] * u[0] - p[1] * upper, p[1] * upper - p[2] * lower


def main(folder: Path) -> None:
    """Diagnose, print, draw where the simulation leaves the record."""
    folder.mkdir(parents=True, exist_ok=True)
    plant = make_cascaded_tanks(2000, noise=0.005, caught_share=0.0, random_state=2)
    simulator = ODESimulator(
        tanks,
        dt=plant.sampling_period,
        parameters={"pump [cm/s/V]": 0.1, "upper outlet": 0.15, "lower outlet": 0.15},
        states=["upper level [cm]", "lower level [cm]"],
        inputs=["pump [V]"],
        outputs=["lower level [cm]"],
    )
    dx = DiscrepancyRegressor(simulator, effects=SUSPECTS, max_effects=1, n_leaders=5).fit(plant.X, plant.y)
    print(dx.report_)
    display = LocationDisplay.from_estimator(dx)
    print(display.segments.round(3).to_string(index=False))
    display.figure_.savefig(folder / "tanks_overflow.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(), help="folder for the figure")
    main(parser.parse_args().out)

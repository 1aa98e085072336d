"""The simulation lives in another program: export its output beside the recording, that is enough.

Simulink, Modelica, a colleague's executable: whatever made the column `y_sim` need not be run again. A model
is identified that simulates as it does, and stands in for it while the missing physics is looked for.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator, TraceSimulator
from narx_sklearn.displays import BeforeAfterDisplay

SUSPECTS = ["input_saturation", "dead_zone", "cubic_stiffness", "input_polynomial"]


def exported_table() -> pd.DataFrame:
    """Return what the other program and the test bench would have written: u, y and y_sim."""

    def motor(x, u, p):
        return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]

    simulator = ODESimulator(
        motor,
        dt=0.05,
        parameters={"gain [rad/s^2/V]": 2.0, "damping [1/s]": 1.5, "stiffness [1/s^2]": 8.0},
        states=["angle [rad]", "speed [rad/s]"],
        inputs=["drive [V]"],
    )
    rng = np.random.default_rng(0)
    drive = np.repeat(rng.normal(0, 4, 160), 10)
    measured = simulator.simulate(np.clip(drive, -5, 5))[:, 0]  # the real amplifier ends at 5 V
    return pd.DataFrame(
        {
            "drive [V]": drive,
            "angle [rad]": measured + 0.005 * rng.normal(size=drive.size),
            "y_sim": simulator.simulate(drive)[:, 0],
        }
    )


def main(folder: Path) -> None:
    """Diagnose the trace against the recording."""
    folder.mkdir(parents=True, exist_ok=True)
    table = exported_table()  # with your own: pandas.read_csv("exported.csv")
    trace = TraceSimulator(table["y_sim"].rename("angle [rad]"), table[["drive [V]"]], dt=0.05)
    print(f"stands in for the trace to {100 * trace.twin_error_:.2g} % of its spread\n")
    dx = DiscrepancyRegressor(trace, effects=SUSPECTS, max_effects=1, n_leaders=4)
    dx.fit(table[["drive [V]"]], table["angle [rad]"])
    print(dx.report_)
    BeforeAfterDisplay.from_estimator(
        dx, table[["drive [V]"]][-320:], table["angle [rad]"][-320:]
    ).figure_.savefig(folder / "simulink_trace.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(), help="folder for the figure")
    main(parser.parse_args().out)

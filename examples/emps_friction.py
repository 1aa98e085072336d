"""A real drive under position control: its maker's model without friction, and the friction found in it.

The record is that of the EMPS benchmark. It is fetched, or read from the folder that the environment variable
NARX_SKLEARN_DATA names; without either the script says so and ends.

The suspects are friction only, chosen after others had been tried on this record; what the whole catalogue
says of it is printed by ``benchmarks/real_mismatch.py``.
"""

import argparse
from pathlib import Path

from narx_sklearn.datasets import fetch_emps
from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
from narx_sklearn.displays import EffectCurveDisplay

EVERY = 5  # of the samples at 1 kHz: the axis takes tenths of seconds
SUSPECTS = ["asymmetric_friction", "coulomb_friction", "quadratic_drag"]


def axis(x, u, p):
    """Mass and viscous friction, driven by a force proportional to the voltage."""
    return x[1], p[0] * u[0] - p[1] * x[1]


def main(folder: Path) -> None:
    """Fetch, diagnose, draw what the drive is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    try:
        data = fetch_emps()
    except (OSError, ImportError) as error:
        print(f"skipped: the EMPS record is not at hand. {error}")
        return
    record = data.train.iloc[: len(data.train) // EVERY * EVERY]
    # the voltage is held 1 ms; over five samples what acts is its mean
    volts = record[data.input].to_numpy().reshape(-1, EVERY).mean(axis=1)
    position = record[data.output].to_numpy()[::EVERY]
    simulator = ODESimulator(
        axis,
        dt=EVERY * data.sampling_period,
        parameters={"gain [m/s^2/V]": 0.3, "viscous friction [1/s]": 2.0},
        states=["position [m]", "velocity [m/s]"],
        inputs=["voltage [V]"],
    )
    dx = DiscrepancyRegressor(simulator, effects=SUSPECTS, max_effects=1, n_leaders=3)
    dx.fit(volts[:, None], position)
    print(dx.report_)
    if dx.simulator_.effects:
        display = EffectCurveDisplay.from_estimator(dx)
        display.figure_.savefig(folder / "emps_friction.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(), help="folder for the figure")
    main(parser.parse_args().out)

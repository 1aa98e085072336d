"""Make a piezo actuator follow a sine: identify its hysteresis, derive the compensator, print it as C.

The recording is made here; with your own, `frame = pandas.read_csv(...)`.
"""

import argparse
from pathlib import Path

import numpy as np

from narx_sklearn import NARXRegressor
from narx_sklearn.compensation import RootCompensator, law_stability
from narx_sklearn.datasets import make_piezo_bench
from narx_sklearn.displays._compensation import CompensationDisplay
from narx_sklearn.metrics import nsavi
from narx_sklearn.model import Difference, DifferenceSign
from narx_sklearn.physics import PIEZO_BENCH


def main(folder: Path | None = None) -> None:
    """Identify, compensate, explain, draw."""
    plant = make_piezo_bench(20_000, random_state=0)
    # rate-independent hysteresis: whatever moves the output moves with the first difference of the voltage
    regressor = NARXRegressor(
        1,
        [0],
        delay=0,
        phi=(Difference("voltage", name="phi1"), DifferenceSign("voltage", name="phi2")),
        phi_lags=[0],
        degree=3,
        structure="hysteresis",
        constraints="displacement[k-1] = 1",
        n_terms=9,
        fit_intercept=False,
        origin="zero",
        sampling_period=plant.sampling_period,
    )
    compensator = RootCompensator(regressor, limits=(-80.0, 80.0)).fit(plant.X, plant.y)
    seconds = np.arange(3000) * plant.sampling_period
    reference = 40.0 * np.sin(2.0 * np.pi * seconds)

    m = compensator.predict(reference, m_init=0.0)  # the actuator starts at 0 V
    print(compensator.explain())
    print(f"\nthe law is {law_stability(compensator.law_, reference)}")
    print(f"effort (NSAVI): {nsavi(reference, m):.3f}")
    print(f"lines of C for the controller: {len(compensator.explain('c').splitlines())}")
    if folder is None:
        return
    import matplotlib

    matplotlib.use("Agg")
    display = CompensationDisplay(
        reference,
        m,
        PIEZO_BENCH.run(m),
        PIEZO_BENCH.run(reference),
        sampling_period=plant.sampling_period,
        output_label="displacement (um)",
        input_label="voltage (V)",
    ).plot()
    before, after = display.errors_
    print(f"tracking error: {before:.2f} % of the range without, {after:.2f} % with compensation")
    folder.mkdir(parents=True, exist_ok=True)
    display.figure_.savefig(folder / "compensate_piezo.png", dpi=120)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(), help="folder for the figure")
    main(parser.parse_args().out)

"""The figure of a compensation: its numbers, and that it draws."""

import numpy as np
import pytest

from narx_sklearn.compensation import BoucWenCompensator, InverseCompensator, RootCompensator
from narx_sklearn.displays._compensation import CompensationDisplay
from narx_sklearn.metrics import mape, nsavi
from narx_sklearn.model import NARXModel
from narx_sklearn.physics import PIEZO_BENCH

mpl = pytest.importorskip("matplotlib")


def test_the_display_holds_and_draws_what_the_plant_did():
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    r = 40 * np.sin(2 * np.pi * np.arange(500) / 500)
    compensator = BoucWenCompensator(PIEZO_BENCH).fit()
    display = CompensationDisplay.from_compensator(
        compensator, PIEZO_BENCH, r, sampling_period=1e-3, output_label="displacement (um)", input_label="V"
    )
    assert display.errors_[1] == mape(r, display.y) < display.errors_[0] == mape(r, PIEZO_BENCH.run(r))
    assert list(display.to_frame()) == ["reference", "m", "y", "y_uncompensated"]
    assert display.axes_[1].get_xlabel() == "time (s)"
    display.figure_.canvas.draw()
    figure, axes = plt.subplots(3)
    alone = CompensationDisplay(r, display.m, display.y).plot(axes)
    assert alone.figure_ is figure
    assert np.isnan(alone.errors_[0])
    plt.close("all")


@pytest.mark.parametrize("inverse", [False, True])
def test_what_the_model_knows_labels_the_axes_and_no_volts_are_driven_with_micrometres(inverse):
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    stage = NARXModel.from_equations(
        "position[k] = 0.5*position[k-1] + 0.05*drive[k-1]", inputs=["drive"], sampling_period=0.01,
        units={"position": "um", "drive": "V"},
    )  # fmt: skip
    backwards = NARXModel.from_equations(
        "drive[k] = 20*position[k-1] - 10*position[k-2]", inputs=["position"], sampling_period=0.01,
        units={"position": "um", "drive": "V"},
    )  # fmt: skip
    compensator = (InverseCompensator(backwards) if inverse else RootCompensator(stage)).fit()
    r = 5 + np.sin(np.arange(200) / 10)
    display = CompensationDisplay.from_compensator(compensator, stage, r)
    outputs, inputs, _ = display.axes_
    assert (outputs.get_ylabel(), inputs.get_ylabel()) == ("position (um)", "drive (V)")
    assert inputs.get_xlabel() == "time (s)"
    assert display.y_uncompensated is None
    over_gain = CompensationDisplay.from_compensator(compensator, stage, r, uncompensated=10 * r)
    assert over_gain.errors_[1] < over_gain.errors_[0] < 10
    ratio = nsavi(10 * r, over_gain.m)
    assert over_gain.axes_[1].get_lines()[0].get_label().startswith(f"{ratio:.3g} times the path")
    plt.close("all")

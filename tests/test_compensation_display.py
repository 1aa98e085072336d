"""The figure of a compensation: its numbers, and that it draws."""

import numpy as np
import pytest

from narx_sklearn.compensation import BoucWenCompensator
from narx_sklearn.displays._compensation import CompensationDisplay
from narx_sklearn.metrics import mape
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

"""Section 5.2.1: identify the piezo bench under Lemma 4.1, and let the input stop (Figure 5.5)."""

from pathlib import Path

import numpy as np
from _thesis import new_figure, out_folder, save

from narx_sklearn import NARXRegressor
from narx_sklearn.metrics import mape
from narx_sklearn.model import Difference, DifferenceSign
from narx_sklearn.physics import PIEZO_BENCH
from narx_sklearn.signals import prfs

PERIOD = 0.001  # s


def main(folder: Path) -> None:
    """Identify two models, with and without the lemma; compare on a sine and on one that stops."""
    u = prfs(50_000, 1.0, PERIOD, amplitudes=80.0, random_state=0)
    y = PIEZO_BENCH.run(u)
    shared = {
        "phi": (Difference("u"), DifferenceSign("u")),
        "phi_lags": [0],
        "degree": 5,
        "structure": "rate_independent",
        "fit_intercept": False,
        "n_terms": 9,
        "refine": True,
        "sampling_period": PERIOD,
    }
    with_lemma = NARXRegressor(1, [0], constraints="continuum", **shared).fit(u[:, None], y)
    without = NARXRegressor(1, [0], **shared).fit(u[:, None], y)
    print(with_lemma.model_)

    t = np.arange(12_000) * PERIOD
    sine = 40 * np.sin(2 * np.pi * t)
    stopped = np.where(t < 4.432, sine, sine[4432])
    measured = PIEZO_BENCH.run(stopped)
    figure, (left, right) = new_figure(2)
    for narx, name in ((with_lemma, "with Lemma 4.1"), (without, "without")):
        error = mape(PIEZO_BENCH.run(sine), narx.predict(sine[:, None], y_init=[0.0]))
        run = narx.predict(stopped[:, None], y_init=[0.0])
        print(f"{name}: MAPE on the sine {error:.3f} %, moved {abs(run[-1] - run[4432]):.3g} um at rest")
        left.plot(stopped[3000:4433], run[3000:4433], linewidth=1, label=name)
        right.plot(t[4000:], run[4000:], linewidth=1, label=name)
    left.plot(stopped[3000:4433], measured[3000:4433], color="0.7", linewidth=3, zorder=0, label="bench")
    right.plot(t[4000:], measured[4000:], color="0.7", linewidth=3, zorder=0, label="bench")
    right.set_ylim(measured[-1] - 0.5, measured[-1] + 1.5)
    left.set(xlabel="voltage [V]", ylabel="displacement [um]")
    right.set(xlabel="time [s]", ylabel="displacement [um]")
    left.legend(frameon=False)
    save(figure, folder, __file__)


if __name__ == "__main__":
    main(out_folder(__doc__))

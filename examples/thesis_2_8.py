"""Example 2.8: Deng and Tan's hysteretic operator (2.55) and its dominant extrema (Figure 2.10)."""

from pathlib import Path

import numpy as np
from _thesis import new_figure, out_folder, save

from narx_sklearn.physics import hysteretic_operator

PERIOD = 0.02  # s


def main(folder: Path) -> None:
    """Draw the operator along the input of the example, 14 s long, and over it."""
    t = np.arange(700) * PERIOD
    u = 2.5 * np.sin(1.5 * t) + 4 * np.sin(0.5 * t)
    h = hysteretic_operator(u)
    figure, (left, right) = new_figure(2)
    left.plot(t, u, label="input")
    left.plot(t, h, label="operator")
    left.set(xlabel="time [s]", ylabel="input, output [-]")
    left.legend(frameon=False)
    right.plot(u, h, linewidth=1)
    right.set(xlabel="input [-]", ylabel="operator [-]")
    first = int(np.argmax(np.diff(u) < 0))
    by_hand = np.arctan(u[first]) * u[first]
    print(f"up to the first extremum, u = {u[first]:.4f}, h = arctan(u) u = {by_hand:.4f}")
    print(f"and the operator gives {h[first]:.4f}")
    save(figure, folder, __file__)


if __name__ == "__main__":
    main(out_folder(__doc__))

"""Example 2.2: three weighted plays make a Prandtl-Ishlinskii loop (Figure 2.4); its inverse undoes it."""

from pathlib import Path

import numpy as np
from _thesis import new_figure, out_folder, save

from narx_sklearn.physics import PrandtlIshlinskiiOperator, play

SAMPLES = 1000  # a period


def main(folder: Path) -> None:
    """Draw the plays, their weighted sum, and the sum behind its inverse."""
    operator = PrandtlIshlinskiiOperator(radii=(0, 0.8, 1.7), weights=(5.88, 1.58, 0.47))
    u = 3 * np.sin(2 * np.pi * np.arange(2 * SAMPLES + 1) / SAMPLES)
    last = slice(-SAMPLES - 1, None)
    figure, (left, middle, right) = new_figure(3)
    for radius, state in zip(operator.radii, play(u, operator.radii).T, strict=True):
        left.plot(u[last], state[last], label=f"radius {radius:g}")
    left.set(xlabel="u [-]", ylabel="play [-]")
    left.legend(frameon=False)
    middle.plot(u[last], operator.run(u)[last])
    middle.set(xlabel="u [-]", ylabel="output [-]")
    wanted = 6 * u
    undone = operator.run(operator.inverse().run(wanted))
    right.plot(wanted[last], undone[last])
    right.set(xlabel="wanted output [-]", ylabel="output behind the inverse [-]")
    print(f"the inverse leaves an error of {np.abs(undone - wanted).max():.1e}")
    save(figure, folder, __file__)


if __name__ == "__main__":
    main(out_folder(__doc__))

"""Example 2.1: the parameters of the Bouc-Wen model shape its loop (Figure 2.2)."""

from pathlib import Path

import numpy as np
from _thesis import new_figure, out_folder, save

from narx_sklearn.physics import bouc_wen

SAMPLES = 1000  # a period


def main(folder: Path) -> None:
    """Draw the settled loops for three exponents, and for two pairs of beta and gamma."""
    x = np.sin(2 * np.pi * np.arange(5 * SAMPLES + 1) / SAMPLES)
    last = slice(-SAMPLES - 1, None)
    figure, (left, right) = new_figure(2)
    for n in (1, 2, 3):
        h = bouc_wen(x, A=1, beta=1, gamma=2, n=n)
        left.plot(x[last], h[last], label=f"n = {n}")
        bound = (1 / 3) ** (1 / n)
        print(f"n = {n}: largest h {h.max():.4f}, bound (A/(beta+gamma))^(1/n) = {bound:.4f}")
    for beta in (0.5, 0.9):
        h = bouc_wen(x, A=1, beta=beta, gamma=0.5)
        right.plot(x[last], h[last], label=rf"$\beta$ = {beta}, $\gamma$ = 0.5")
    left.set_title(r"A = 1, $\beta$ = 1, $\gamma$ = 2", loc="left")
    right.set_title("A = 1, n = 1", loc="left")
    for ax in (left, right):
        ax.set(xlabel="x [-]", ylabel="h [-]")
        ax.legend(frameon=False)
    save(figure, folder, __file__)


if __name__ == "__main__":
    main(out_folder(__doc__))

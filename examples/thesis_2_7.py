"""Example 2.7: fixed points and their stability from the clusters (2.33)-(2.37), and the static curve."""

from pathlib import Path

import numpy as np
from _thesis import new_figure, out_folder, save
from thesis_2_5 import MODEL

from narx_sklearn.analysis import fixed_points, static_curve, term_clusters
from narx_sklearn.displays import StaticCurveDisplay


def main(folder: Path) -> None:
    """Solve the quadratic of (2.35)-(2.36) by hand and compare; draw both branches."""
    found = fixed_points(MODEL, [1.0])
    print(found)
    clusters = term_clusters(MODEL)
    a = clusters["y^2"].coefficient
    b = clusters["y"].coefficient + clusters["y*u"].coefficient * 1.0 - 1.0
    c = clusters["u"].coefficient * 1.0
    by_hand = np.sort((-b + np.array([-1, 1]) * np.sqrt(b**2 - 4 * a * c)) / (2 * a))
    print(f"by the formulas at u = 1: {by_hand[0]:.5f} and {by_hand[1]:.5f}")
    figure, ax = new_figure()
    StaticCurveDisplay(static_curve(MODEL, np.linspace(-3, 3, 121))).plot(ax=ax)
    save(figure, folder, __file__)


if __name__ == "__main__":
    main(out_folder(__doc__))

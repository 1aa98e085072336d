"""Three recordings, one with a dropout: labels keep them apart, NaN marks the gap, nothing is glued together.

A lag that reached over a seam would pair yesterday's output with today's input. `sessions` and NaN prevent
it; the script shows what happens when one forgets.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from sklearn import config_context
from sklearn.model_selection import LeaveOneGroupOut, cross_val_score

from narx_sklearn import NARXRegressor
from narx_sklearn.datasets import make_duffing
from narx_sklearn.displays import FreeRunDisplay


def main(folder: Path) -> None:
    """Join three recordings, identify with and without their seams, draw the runs."""
    folder.mkdir(parents=True, exist_ok=True)
    plants = [make_duffing(700, noise=0.01, random_state=seed) for seed in range(3)]
    X = pd.concat([plant.X for plant in plants], ignore_index=True)
    y = pd.concat([plant.y for plant in plants], ignore_index=True)
    sessions = np.repeat(["monday", "tuesday", "wednesday"], 700)
    y[900:960] = np.nan  # the sensor's plug came loose on Tuesday

    narx = NARXRegressor(3, 2, degree=3, sampling_period=plants[0].sampling_period)
    narx.fit(X, y, sessions=sessions)
    print(narx.model_)
    print(f"R² of the free runs: {narx.score(X, y, sessions=sessions):.5f}")

    # one day left out in turn; scikit-learn hands the labels on to fit and score
    with config_context(enable_metadata_routing=True):
        asking = NARXRegressor(3, 2, degree=3).set_fit_request(sessions=True).set_score_request(sessions=True)
        labels = {"sessions": sessions, "groups": sessions}
        scores = cross_val_score(asking, X, y, cv=LeaveOneGroupOut(), params=labels)
    print("each day by a model of the others: " + ", ".join(f"{score:.5f}" for score in scores))

    filled = NARXRegressor(3, 2, degree=3).fit(X, y.fillna(0.0))
    print(f"\nseams forgotten and the gap filled with zeros: {len(filled.terms_)} terms,")
    print(f"R² of the same free runs: {filled.score(X, y, sessions=sessions):.5f}")

    display = FreeRunDisplay.from_estimator(narx, X, y, sessions=sessions)
    display.figure_.savefig(folder / "several_recordings_with_gaps.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(), help="folder for the figure")
    main(parser.parse_args().out)

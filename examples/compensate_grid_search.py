"""Choose a compensator by what it does to the plant: GridSearchCV over its model, scored by tracking."""

import numpy as np
import pandas as pd
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit

from narx_sklearn import NARXRegressor
from narx_sklearn.compensation import RootCompensator, tracking_error, tracking_scorer
from narx_sklearn.datasets import make_piezo_bench
from narx_sklearn.model import Difference, DifferenceSign
from narx_sklearn.physics import PIEZO_BENCH


def main() -> None:
    """Search the degree and the number of terms."""
    plant = make_piezo_bench(20_000, random_state=0)
    regressor = NARXRegressor(
        1,
        [0],
        delay=0,
        phi=(Difference("voltage", name="phi1"), DifferenceSign("voltage", name="phi2")),
        phi_lags=[0],
        degree=3,
        structure="hysteresis",
        constraints="displacement[k-1] = 1",
        fit_intercept=False,
        origin="zero",
        refine=False,
    )
    reference = 40.0 * np.sin(2.0 * np.pi * np.arange(1000) / 1000)
    search = GridSearchCV(
        RootCompensator(regressor, limits=(-80.0, 80.0)),
        {"model__degree": [3, 4], "model__n_terms": [4, 6, 9]},
        scoring=tracking_scorer(PIEZO_BENCH, reference, m_init=0.0),
        cv=TimeSeriesSplit(2),
    ).fit(plant.X, plant.y)
    columns = ["param_model__degree", "param_model__n_terms", "mean_test_score"]
    print(pd.DataFrame(search.cv_results_)[columns].to_string(index=False))
    print(f"\nchosen: {search.best_params_}")
    print(f"tracking error without: {tracking_error(None, PIEZO_BENCH, reference):.2f} %")
    chosen = tracking_error(search.best_estimator_, PIEZO_BENCH, reference, m_init=0.0)
    print(f"with the chosen one:    {chosen:.2f} %")


if __name__ == "__main__":
    main()

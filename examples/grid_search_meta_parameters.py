"""Lags, degree and criterion chosen by what the model is for: the free run on recordings it has not seen.

`score` is R² of the free run, so scikit-learn's own search judges it. `NARXRegressorCV` asks the same
question of every number of terms as well, and answers it from one pass over the data.
"""

import argparse
from pathlib import Path

import pandas as pd
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit

from narx_sklearn import NARXRegressor, NARXRegressorCV
from narx_sklearn.datasets import make_duffing
from narx_sklearn.displays import SelectionPathDisplay


def main(folder: Path) -> None:
    """Search twice, compare, draw the path of the winner."""
    folder.mkdir(parents=True, exist_ok=True)
    plant = make_duffing(1300, noise=0.01, random_state=0)
    train, test = slice(0, 900), slice(900, None)
    folds = TimeSeriesSplit(3)

    search = GridSearchCV(
        NARXRegressor(refine=False),
        {"output_lags": [2, 3], "degree": [1, 3], "criterion": ["aic", "ebic"]},
        cv=folds,
    ).fit(plant.X[train], plant.y[train])
    columns = ["param_output_lags", "param_degree", "param_criterion", "mean_test_score", "std_test_score"]
    table = pd.DataFrame(search.cv_results_)[columns].sort_values("mean_test_score", ascending=False)
    print(table.to_string(index=False))
    print(f"\nGridSearchCV takes {search.best_params_}")
    print(f"held-out R² of its free run: {search.score(plant.X[test], plant.y[test]):.5f}")

    quick = NARXRegressorCV((2, 3, 4), (1, 2), degree=(1, 3, 4), cv=folds, rule="one_standard_error")
    quick.fit(plant.X[train], plant.y[train])
    print(
        f"\nNARXRegressorCV takes {quick.best_params_}, "
        f"of {len(quick.cv_results_['mean_test_score'])} choices"
    )
    print(f"held-out R² of its free run: {quick.score(plant.X[test], plant.y[test]):.5f}")

    display = SelectionPathDisplay.from_estimator(search.best_estimator_)
    display.figure_.savefig(folder / "grid_search_meta_parameters.png", dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(), help="folder for the figure")
    main(parser.parse_args().out)

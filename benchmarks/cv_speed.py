"""NARXRegressorCV beside GridSearchCV over NARXRegressor: the same grid, the same folds, time and choice.

    python benchmarks/cv_speed.py [--samples 1e5] [--folds 5] [--lags 3] [--out x.json]

Both judge every choice by its free run on the held-out folds, and fit the best to the whole record; both run
on one thread. Times are processor seconds.
"""

import argparse
import time

from harness.tables import format_table, save_json
from selection_speed import make_signals
from sklearn.model_selection import GridSearchCV, TimeSeriesSplit

from narx_sklearn import NARXRegressor, NARXRegressorCV


def search_from_one_pass(u, y, lags, degrees, sizes, folds) -> NARXRegressorCV:
    """Search the grid on the folds' factors."""
    return NARXRegressorCV(
        lags, lags, degree=degrees, n_terms=sizes, max_terms=max(sizes), cv=folds, refine=False, origin="zero"
    ).fit(u, y)


def search_by_grid(u, y, lags, degrees, sizes, folds) -> GridSearchCV:
    """Fit and score a regressor for every choice and fold."""
    grid = {"output_lags": lags, "input_lags": lags, "degree": degrees, "n_terms": sizes}
    narx = NARXRegressor(max_terms=max(sizes), refine=False, origin="zero")
    return GridSearchCV(narx, grid, cv=folds).fit(u, y)


def main() -> None:
    """Measure both, print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=float, default=1e5)
    parser.add_argument("--folds", type=int, default=5)
    parser.add_argument("--lags", type=int, default=3, help="longest lag of u and of y in the grid")
    parser.add_argument("--out", help="write the raw results to this JSON file")
    options = parser.parse_args()
    u, y = make_signals(int(options.samples))
    lags, degrees, sizes = list(range(1, options.lags + 1)), [1, 2, 3], list(range(3, 13))
    task = u[:, None], y, lags, degrees, sizes, TimeSeriesSplit(options.folds)
    searches = {"NARXRegressorCV": search_from_one_pass, "GridSearchCV": search_by_grid}
    for search in searches.values():  # compiled kernels are loaded
        search(u[:500, None], y[:500], [1], [2], [3], TimeSeriesSplit(2))
    results = {}
    for name, search in searches.items():
        started = time.process_time()
        found = search(*task)
        seconds = time.process_time() - started
        results[name] = {
            "seconds": seconds,
            "choices": len(lags) ** 2 * len(degrees) * len(sizes),
            "score": found.best_score_,
            "chosen": {key: int(value) for key, value in found.best_params_.items()},
            "terms": found.best_estimator_.terms_,
        }
        print(name, results[name], flush=True)
    save_json(options.out, results)
    slowest = results["GridSearchCV"]["seconds"]
    rows = [
        [name, r["choices"], r["seconds"], slowest / r["seconds"], r["score"]] for name, r in results.items()
    ]
    print(format_table(("search", "choices", "cpu s", "times faster", "best mean R2"), rows))
    print("same terms:", len({tuple(r["terms"]) for r in results.values()}) == 1)


if __name__ == "__main__":
    main()

"""NARXRegressorCV as a user writes it: one fit to the training record, one free run from the first outputs.

Lags, degrees and the largest size are those of the harness' grid; folds, race, refinement and everything else
are the defaults. It keeps no budget, and does not try recordings at other sampling periods.
"""

import warnings

import numpy as np
from harness.recordings import SearchSpec

from narx_sklearn import NARXRegressorCV


class CrossValidated:
    """A fitted search, seen as the harness sees models."""

    def __init__(self, fitted: NARXRegressorCV):
        self.fitted = fitted
        self.terms = tuple(fitted.best_estimator_.terms_)
        best = fitted.best_params_
        first, last = best["delay"], best["input_lags"]
        self.search = {
            "output_lags": tuple(range(1, best["output_lags"] + 1)),
            "input_lags": tuple(range(first, last + 1)),
            "degree": best["degree"],
        }

    def predict(self, X: np.ndarray, y_init: np.ndarray) -> np.ndarray:
        """Simulate from the initial outputs, which come first."""
        return np.asarray(self.fitted.predict(X[:, None], y_init=y_init))


def search(X: np.ndarray, y: np.ndarray, spec: SearchSpec) -> CrossValidated:
    """Fit to the part of the training record that a final model may see."""
    lags = list(spec.lags)
    regressor = NARXRegressorCV(
        lags, lags, delay=(0, 1), degree=list(spec.degrees), max_terms=max(spec.sizes)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the edge of a grid that the harness gave
        return CrossValidated(regressor.fit(X[spec.final][:, None], y[spec.final]))

"""PySINDy's sparse optimizers (STLSQ, SSR) on the lagged library.

PySINDy (2.1) models derivatives or the next state, not lagged outputs, so it is given the regressor matrix of
the same candidates. Both optimizers get normalised columns; their threshold or size is chosen by BIC, and
what they keep is fitted by least squares.
"""

import warnings
from collections.abc import Iterator

import numpy as np
from harness.candidates import LibrarySpec
from harness.polynomial import PlainModel, bic, longest_lag, make_library, regressor_matrix
from pysindy.optimizers import SSR, STLSQ

warnings.filterwarnings("ignore", module="pysindy")

RIDGE = 1e-8  # of normalised columns: just enough for the full library to be solved
THRESHOLDS = np.logspace(-4, 0, 25)  # of coefficients of normalised columns, times the norm of y


def _stlsq_supports(Psi: np.ndarray, target: np.ndarray) -> Iterator[np.ndarray]:
    for threshold in THRESHOLDS * np.linalg.norm(target):
        optimizer = STLSQ(threshold=threshold, alpha=RIDGE, normalize_columns=True, max_iter=50)
        optimizer.fit(Psi, target)
        yield np.flatnonzero(optimizer.coef_[0])


def _ssr_supports(Psi: np.ndarray, target: np.ndarray) -> Iterator[np.ndarray]:
    optimizer = SSR(alpha=RIDGE, max_iter=Psi.shape[1], normalize_columns=True)
    optimizer.fit(Psi, target)
    for coefficients in optimizer.history_:
        yield np.flatnonzero(coefficients[0])


def _recover(supports):
    def fit(X: np.ndarray, y: np.ndarray, spec: LibrarySpec) -> PlainModel:
        candidates = make_library(spec.output_lags, spec.input_lags, spec.degree)
        start = longest_lag(candidates)
        Psi, target = regressor_matrix(candidates, X, y, start), y[start:]
        best = (np.inf, np.array([0]), np.zeros(1))
        for columns in supports(Psi, target):
            if 0 < len(columns) <= 2 * spec.max_terms:
                theta = np.linalg.lstsq(Psi[:, columns], target, rcond=None)[0]
                criterion = bic(target - Psi[:, columns] @ theta, len(columns), y)
                best = min(best, (criterion, columns, theta), key=lambda trial: trial[0])
        _, columns, theta = best
        return PlainModel([candidates[column] for column in columns], theta)

    return fit


RECOVERERS = {"pysindy: STLSQ bic": _recover(_stlsq_supports), "pysindy: SSR bic": _recover(_ssr_supports)}

"""Estimators that identify the model when a compensator is given none: hysteresis of third degree."""

import numpy as np

from narx_sklearn._validation import column_labels, signal_names
from narx_sklearn.identification.isolable import isolable_structure
from narx_sklearn.identification.narx import NARXRegressor
from narx_sklearn.model.phi import Difference, DifferenceSign

DEGREE, N_TERMS = 3, 9  # as in the thesis, section 5.2


def direct_regressor(X, y) -> NARXRegressor:
    """Return the estimator of a hysteretic model that can rest anywhere (Assumption 4.1, Lemma 4.1)."""
    return _hysteretic(X, y, lags=1, structure="hysteresis")


def isolable_regressor(X, y) -> NARXRegressor:
    """Return the same with an input lag more and the newest difference in one linear term."""
    return _hysteretic(X, y, lags=2, structure=None)


def inverse_regressor(X, y) -> NARXRegressor:
    """Return the same for the inverse relationship; ``X`` is then the output of the machine."""
    return _hysteretic(X, y, lags=1, structure="hysteresis")


def _hysteretic(X, y, *, lags: int, structure) -> NARXRegressor:
    inputs, output = _names(X, "u"), _names(y, "y")[0]
    phi = (Difference(inputs[0], name="phi1"), DifferenceSign(inputs[0], name="phi2"))
    return NARXRegressor(
        1,
        lags,
        phi=phi,
        phi_lags=lags,
        degree=DEGREE,
        structure=structure or isolable_structure([output], inputs, phi),
        constraints=f"{output}[k-1] = 1",
        fit_intercept=False,
        origin="zero",
        n_terms=N_TERMS,
        refine=False,
    )


def _names(data, letter: str) -> tuple[str, ...]:
    labels = column_labels(data)
    if labels is None:
        values = np.asarray(data)
        labels = list(range(1 if values.ndim == 1 else values.shape[1]))
    return signal_names(labels, letter)

"""Estimators that identify the model when a compensator is given none."""

from typing import Any

import numpy as np

from narx_sklearn._validation import column_labels, signal_names
from narx_sklearn.identification.narx import NARXRegressor
from narx_sklearn.identification.structure.hysteresis import rate_independent_structure
from narx_sklearn.identification.structure.isolable import isolable_structure
from narx_sklearn.model.phi import Difference, DifferenceSign

DEGREE = 3  # as in the thesis, section 5.2
RESTING_LAGS = ((1, 1), (2, 1), (2, 2))  # of output and input
ORDINARY: dict[str, Any] = {"degree": DEGREE, "max_terms": None}  # nobody set a limit that could be told


def direct_regressors(X, y, input_name: str | None) -> list[NARXRegressor]:
    """Return estimators of models that can rest anywhere (Lemma 4.1) and of ordinary ones, slow and quick.

    With one input lag an ordinary model's law has no memory of its own, so that it cannot amplify.
    """
    resting = _resting(input_name or _first_name(X, "u"), "rate_independent")
    return [
        *(NARXRegressor(*lags, phi_lags=lags[1], **resting) for lags in RESTING_LAGS),
        *(NARXRegressor(2, lags, **ORDINARY) for lags in (1, 2)),
    ]


def rehearsal_regressors(X, y, input_name: str | None) -> list[NARXRegressor]:
    """Return the quickest of these, one of each kind: for a model on which another one's law is rehearsed."""
    resting = _resting(input_name or _first_name(X, "u"), "rate_independent")
    return [NARXRegressor(1, 1, phi_lags=1, **resting), NARXRegressor(2, 1, **ORDINARY)]


def isolable_regressors(X, y, input_name: str | None) -> list[NARXRegressor]:
    """Return the same with the newest input or difference in one linear term (Assumptions 4.3, 4.4)."""
    name = input_name or _first_name(X, "u")
    resting = _resting(name, structure=None)
    signals = [_first_name(y, "y")], [name], resting["phi"]
    isolable, rate_independent = isolable_structure(*signals), rate_independent_structure(*signals)
    resting["structure"] = lambda term: isolable(term) and rate_independent(term)
    return [
        *(NARXRegressor(lags, 2, phi_lags=2, **resting) for lags in (1, 2)),
        *(NARXRegressor(2, lags, **ORDINARY, structure="isolable") for lags in (1, 2)),
    ]


def inverse_regressors(X, y, input_name: str | None) -> list[NARXRegressor]:
    """Return the same for the inverse relationship; ``X`` is then the output of the machine."""
    resting = _resting(input_name or _first_name(X, "u"), "rate_independent")
    return [
        *(NARXRegressor(1, lags, phi_lags=lags, refine=True, **resting) for lags in (1, 3)),
        *(NARXRegressor(lags, 3, **ORDINARY) for lags in (0, 1)),
    ]


def _resting(name: str, structure) -> dict:
    """Return what makes a model rest anywhere: differences of an input, and no constant."""
    return {
        "phi": (Difference(name, name="phi1"), DifferenceSign(name, name="phi2")),
        **ORDINARY,
        "structure": structure,
        "constraints": "continuum",
        "fit_intercept": False,
        "origin": "zero",
    }


def _first_name(data, letter: str) -> str:
    labels = column_labels(data)
    if labels is None:
        values = np.asarray(data)
        labels = list(range(1 if values.ndim == 1 else values.shape[1]))
    return signal_names(labels, letter)[0]

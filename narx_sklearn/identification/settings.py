"""What may be asked of a NARXRegressor, and what it comes to."""

from collections.abc import Mapping
from numbers import Integral, Real

import numpy as np

from narx_sklearn._validation import check_choice, check_count
from narx_sklearn.identification.one_step.criteria import CRITERIA
from narx_sklearn.identification.one_step.selection import SEARCHES

ESTIMATORS = ("ls", "ridge", "els", "rls")
ORIGINS = ("auto", "zero", "mean")
SIZES = ("criterion", "free_run")
MAX_TERMS = 20  # of a model whose size nobody limits


def check_settings(settings) -> None:
    """Refuse parameters of a regressor that are none, before any data are looked at."""
    check_choice(settings.criterion, "criterion", CRITERIA)
    check_choice(settings.search, "search", SEARCHES)
    check_choice(settings.size, "size", SIZES)
    check_choice(settings.estimator, "estimator", ESTIMATORS)
    for name in ("max_terms", "n_terms", "noise_lags"):
        value = getattr(settings, name)
        if value is None and name != "noise_lags":
            continue
        check_count(value, name)
    if not isinstance(settings.alpha, Real) or not 0.0 <= float(settings.alpha) < np.inf:
        raise ValueError(f"alpha must be a finite number of at least 0, got {settings.alpha!r}.")
    refine = settings.refine
    known = refine == "auto" if isinstance(refine, str) else refine in (True, False)
    if not known:
        raise ValueError(f"refine must be 'auto', True or False, got {refine!r}.")
    if isinstance(settings.origin, str):
        check_choice(settings.origin, "origin", ORIGINS)
    elif not isinstance(settings.origin, Mapping):
        raise TypeError(
            "origin must be 'auto', 'zero', 'mean' or a mapping from names to numbers, "
            f"got {settings.origin!r}."
        )


def check_settings_of_batches(settings) -> None:
    """Refuse what batches cannot be used for, of which the compressed record alone is kept."""
    if settings.estimator in ("els", "rls"):
        raise ValueError(
            f"partial_fit keeps the compressed record only, which estimator={settings.estimator!r} cannot "
            "use; choose 'ls' or 'ridge', or call fit."
        )
    forgetting = settings.forgetting
    if not isinstance(forgetting, Real) or not 0.0 < float(forgetting) <= 1.0:
        raise ValueError(
            "partial_fit weighs earlier batches by forgetting, which must be a number above 0 and at "
            f"most 1 here, got {forgetting!r}."
        )


def longest_size(max_terms: int | None) -> int:
    """Return the largest number of terms to try."""
    return MAX_TERMS if max_terms is None else max_terms


def refine_mode(refine) -> str:
    """Return "auto", "always" or "never"; 1, 0 and NumPy's booleans count as True and False."""
    if isinstance(refine, str):
        return refine
    return "always" if refine else "never"


def ridge_penalty(settings) -> float:
    """Return the penalty that parameters are estimated with."""
    return settings.alpha if settings.estimator == "ridge" else 0.0


def wants_free_run_size(settings) -> bool:
    """Tell whether the free run chooses the number of terms."""
    return settings.size == "free_run" and settings.n_terms is None


def has_no_inputs(input_lags) -> bool:
    """Tell whether a model without inputs is asked for."""
    if isinstance(input_lags, Integral):
        return input_lags == 0
    return np.ndim(input_lags) == 1 and len(input_lags) == 0

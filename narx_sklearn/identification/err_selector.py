"""Feature selection by error reduction ratio, on any feature matrix."""

import warnings

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.feature_selection import SelectorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from narx_sklearn._threads import single_threaded_blas
from narx_sklearn._validation import check_choice, check_count, check_indexes, finite_rows, unmasked
from narx_sklearn.exceptions import ExcitationWarning
from narx_sklearn.identification.one_step.criteria import CRITERIA
from narx_sklearn.identification.one_step.factor import Factor
from narx_sklearn.identification.one_step.selection import SEARCHES, err_order, search_terms

__all__ = ["ErrSelector"]

MIN_ROWS = 3  # below, an information criterion has no meaning
ROUNDING = 1e-13  # share of a column's level at which its variation is rounding of a constant


class ErrSelector(SelectorMixin, BaseEstimator):
    """Select the features that reduce the error of a linear model most.

    The error reduction ratio of a feature is the share of ``y'y`` that its part orthogonal to the features
    chosen before it explains, ``ERR = (w'y)^2 / (w'w y'y)`` (2.42).

    Parameters
    ----------
    n_terms : int, default=None
        Number of features to keep; fewer where more cannot be told apart. None lets the criterion choose,
        at least one.
    criterion : {"ebic", "bic", "aic", "aicc", "fpe", "lilc", "khundrin"}, default="ebic"
        Criterion that chooses the number; see `information_criterion`.
    search : {"exchange", "floating", "forward", "iterated"}, default="exchange"
        How sets of features are searched; see `search_terms`. ``"forward"`` is the classical ERR ordering.
    max_terms : int, default=20
        Largest number tried when the criterion chooses.
    fit_intercept : bool, default=True
        Whether the estimator that follows fits an intercept: features and target then count from their
        means, and a constant feature is never chosen.

    Attributes
    ----------
    support_ : ndarray of bool, shape (n_features,)
        Which features are kept.
    order_ : ndarray of int, shape (n_selected,)
        Their indices, largest ERR first.
    err_ : ndarray of shape (n_features,)
        Error reduction ratio of each; zero for those left out. They add up to ``1 - |xi|^2/|y|^2``.
    path_ : SelectionPath
        Best set and residual for every number of features.
    n_features_in_ : int
        Number of features.
    feature_names_in_ : ndarray of str
        Names of the columns of ``X``, if they were texts.

    See Also
    --------
    TermTransformer : Makes features of signals.

    Notes
    -----
    Rows of ``X`` with a NaN, such as lags before the first sample give, are left out of the selection.
    The units of the features have no influence on what is selected.

    References
    ----------
    S. Chen, S. A. Billings, W. Luo (1989); P. E. O. G. B. Abreu (2020), eqs. (2.40)-(2.43).

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification.err_selector import ErrSelector
    >>> X = np.random.default_rng(0).normal(size=(100, 5))
    >>> selector = ErrSelector().fit(X, 2 * X[:, 3] - X[:, 1])
    >>> selector.order_.tolist(), round(float(selector.err_.sum()), 6)
    ([3, 1], 1.0)
    """

    def __init__(
        self, n_terms=None, *, criterion="ebic", search="exchange", max_terms=20, fit_intercept=True
    ):
        self.n_terms = n_terms
        self.criterion = criterion
        self.search = search
        self.max_terms = max_terms
        self.fit_intercept = fit_intercept

    def fit(self, X, y):
        """Select features.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
            Features; rows with a NaN are left out.
        y : array-like of shape (n_samples,)
            Target.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If a parameter is not valid, or fewer than 3 rows are complete.

        Warns
        -----
        ExcitationWarning
            If no feature explains anything of ``y``, so that none is selected.
        """
        self._check_parameters()
        check_indexes(X, y)
        X, y = validate_data(
            self,
            unmasked(X),
            unmasked(y),
            dtype=np.float64,
            ensure_all_finite="allow-nan",
            y_numeric=True,
            multi_output=False,
        )
        n_samples = X.shape[0]
        complete = finite_rows(X)
        X, y = X[complete], y[complete].astype(np.float64)
        if X.shape[0] < MIN_ROWS:
            raise ValueError(
                f"Of n_samples={n_samples}, {X.shape[0]} have no NaN; at least {MIN_ROWS} complete samples "
                "are needed to select features."
            )
        if self.fit_intercept:
            X, y = deviations(X), deviations(y[:, None])[:, 0]
        longest = self.max_terms if self.n_terms is None else self.n_terms
        with single_threaded_blas():
            factor = Factor.of(X, y)
            self.path_ = search_terms(factor, longest, search=self.search)
            self.order_, ratios = self._choose(factor)
        self.support_ = np.isin(np.arange(self.n_features_in_), self.order_)
        self.err_ = np.zeros(self.n_features_in_)
        self.err_[self.order_] = ratios
        return self

    def _choose(self, factor: Factor) -> tuple[np.ndarray, np.ndarray]:
        """Return the features of the size wanted, in the order of their ERR, with the ratios."""
        longest = len(self.path_.supports) - 1
        if longest == 0:
            warnings.warn(
                "No feature explains anything of y (the features or y are constant), so none is selected.",
                ExcitationWarning,
                stacklevel=3,
            )
            return np.array([], dtype=int), np.array([])
        if self.n_terms is not None:
            size = min(self.n_terms, longest)
        else:
            size = max(self.path_.best_size(self.criterion), 1)
        order, ratios = err_order(factor, self.path_.supports[size])
        return np.array(order, dtype=int), ratios

    def _check_parameters(self) -> None:
        check_choice(self.criterion, "criterion", CRITERIA)
        check_choice(self.search, "search", SEARCHES)
        for name in ("n_terms", "max_terms"):
            value = getattr(self, name)
            if value is None and name == "n_terms":
                continue
            check_count(value, name)

    def _get_support_mask(self) -> np.ndarray:
        check_is_fitted(self)
        return self.support_

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        tags.target_tags.required = True
        return tags


def deviations(columns: np.ndarray) -> np.ndarray:
    """Return columns less their means; a constant column gives exact zeros."""
    mean = columns.mean(axis=0)
    centred = columns - mean
    flat = np.abs(centred).max(axis=0) <= ROUNDING * np.abs(mean)
    return np.where(flat, 0.0, centred)

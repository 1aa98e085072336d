"""NARXRegressorCV: lags, degree and size chosen by free run on held-out folds, from one pass."""

import warnings
from collections.abc import Sequence
from itertools import product
from numbers import Integral

import numpy as np
from sklearn.base import BaseEstimator, MetaEstimatorMixin, RegressorMixin
from sklearn.utils.validation import check_is_fitted

from narx_sklearn._threads import single_threaded_blas
from narx_sklearn._validation import check_choice, check_count
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.identification.cross_validation.edges import clear_edges
from narx_sklearn.identification.cross_validation.finalists import (
    choose_finalists,
    judge_finalists,
    n_leading,
    refinement_decides,
)
from narx_sklearn.identification.cross_validation.folds import Fold, split_in_runs
from narx_sklearn.identification.cross_validation.judged import Judged, fold_weights
from narx_sklearn.identification.cross_validation.racing import race, room_of_a_standard_error
from narx_sklearn.identification.cross_validation.screening import Screening, scatter_of
from narx_sklearn.identification.narx import NARXRegressor
from narx_sklearn.identification.opening import open_data
from narx_sklearn.identification.posing import constraints_of, pose
from narx_sklearn.identification.records.record import Record
from narx_sklearn.identification.settings import check_settings
from narx_sklearn.identification.two_values import without_repeated_powers

__all__ = ["NARXRegressorCV"]

RULES = ("best", "one_standard_error")
# choices up to which every one is judged on every fold: as many as a person reads
TABLE_TO_READ = 100


class NARXRegressorCV(MetaEstimatorMixin, RegressorMixin, BaseEstimator):
    """Choose lags, delay, degree and number of terms by the free run on held-out folds.

    The record is compressed once for the largest library of the grid; every fold, lag, degree and size is
    then worked out on small triangular factors, by least squares. With ``refine=False`` that is all, and
    equivalent to ``GridSearchCV`` over `NARXRegressor`, at a fraction of its cost. Otherwise the final fit
    searches and refines on the free run, which changes the models, so that the best of each lag, delay and
    degree (of a long record only the leading ones) are fitted to the folds as the final one will be to all
    the data, and these scores decide.

    Parameters
    ----------
    output_lags, input_lags : list of (int, list of int, ...), default=(1, 2, 3)
        Choices for the parameters of `NARXRegressor` of the same names.
    delay : list of int, default=(1,)
        Choices for the smallest lag of the inputs.
    degree : list of int, default=(1, 2, 3)
        Choices for the degree.
    n_terms : "all", None, or list of int, default="all"
        Numbers of terms to judge: every one up to ``max_terms``, or those listed, or none.
    criterion : str or list of str, default=()
        Criteria whose choice of size is judged as well.
    cv : int, cross-validation splitter or iterable, default=None
        Folds; an integer is that many parts of consecutive samples, each held out once, None five. Lags
        never reach across the edge of a training part.
    rule : {"best", "one_standard_error"}, default="best"
        ``"best"`` takes the best score over all folds together; ``"one_standard_error"`` the fewest terms
        whose score is within one standard error of it.
    phi, phi_lags, structure, exclude, max_terms, search, constraints, refine, fit_intercept, origin, \
sampling_period
        As for `NARXRegressor`; ``max_terms`` is a number.
    race : {"auto"} or bool, default="auto"
        Whether a choice is left out of further folds once its errors on some are already more than those of
        better ones on all of them. What is chosen does not depend on it: under ``"one_standard_error"``,
        only what cannot come within one of the best is left out. ``"auto"`` does so with more than a hundred
        choices.
    n_jobs : int, default=None
        Threads over lags, delays and degrees.

    Attributes
    ----------
    best_estimator_ : NARXRegressor
        Fitted to all the data with the best choice.
    best_params_ : dict
        Its parameters from the grid.
    best_score_ : float
        Its held-out R² of the free run, over all folds together.
    cv_results_ : dict of ndarray
        Parameters and scores of all choices, ready for a DataFrame: ``param_*``, ``mean_test_score``,
        ``std_test_score``, ``pooled_test_score``, ``rank_test_score``, ``split<i>_test_score``,
        ``mean_n_terms``, ``n_judged_splits`` and ``refined``. Pooled is R² of all held-out errors together,
        in which a fold counts for as much as its output moves; ranks are those of it. Refined choices were
        fitted to the folds as the final one is to all the data; where some were, the others rank behind
        them. A choice that a race left out has NaN for the folds that it did not reach and for what is over
        all folds; its number of terms is a mean over the others, and it ranks behind what reached more.
    model_ : NARXModel
        The model of ``best_estimator_``.
    n_features_in_ : int
        Number of inputs.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn import NARXRegressorCV
    >>> rng = np.random.default_rng(0)
    >>> u = rng.uniform(-1, 1, size=(600, 1))
    >>> y = np.zeros(600)
    >>> for k in range(2, 600):
    ...     y[k] = 0.6 * y[k - 1] - 0.2 * y[k - 2] + u[k - 1, 0] ** 2 + 0.01 * rng.normal()
    >>> search = NARXRegressorCV([1, 2, 3], [1, 2], degree=[1, 2, 3], max_terms=6, rule="one_standard_error")
    >>> search = search.fit(u, y)
    >>> search.best_estimator_.terms_
    ['y[k-1]', 'y[k-2]', 'u[k-1]^2']
    >>> round(search.best_score_, 2)
    1.0
    """

    def __init__(
        self,
        output_lags=(1, 2, 3),
        input_lags=(1, 2, 3),
        *,
        delay=(1,),
        degree=(1, 2, 3),
        n_terms="all",
        criterion=(),
        cv=None,
        rule="best",
        phi=(),
        phi_lags=1,
        structure=None,
        exclude=(),
        max_terms=20,
        search="exchange",
        constraints=None,
        refine="auto",
        fit_intercept=True,
        origin="auto",
        sampling_period=None,
        race="auto",
        n_jobs=None,
    ):
        self.output_lags = output_lags
        self.input_lags = input_lags
        self.delay = delay
        self.degree = degree
        self.n_terms = n_terms
        self.criterion = criterion
        self.cv = cv
        self.rule = rule
        self.phi = phi
        self.phi_lags = phi_lags
        self.structure = structure
        self.exclude = exclude
        self.max_terms = max_terms
        self.search = search
        self.constraints = constraints
        self.refine = refine
        self.fit_intercept = fit_intercept
        self.origin = origin
        self.sampling_period = sampling_period
        self.race = race
        self.n_jobs = n_jobs

    def fit(self, X, y=None, sessions=None):
        """Judge the whole grid, and fit the best choice to all the data.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_inputs), dask collection, or Recordings
            Inputs. dask collections and `Recordings` are compressed where they are; of the test parts of
            the folds, one at a time is read into this process for its free runs.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs), default=None
            Outputs; None only where ``X`` is a `Recordings`.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample.

        Returns
        -------
        self

        Warns
        -----
        NarxWarning
            If the best choice has the longest lags or the largest degree of the grid, and what has less is
            worse by more than two standard errors of the difference.
        """
        for name in ("model_", "feature_names_in_"):  # an interrupted fit leaves nothing that could be used
            self.__dict__.pop(name, None)
        check_choice(self.rule, "rule", RULES)
        if not (self.race == "auto" or isinstance(self.race, bool)):
            raise ValueError(f"race={self.race!r} is not known; choose 'auto', True or False.")
        check_count(self.max_terms, "max_terms")
        structures = self._structures()
        first = self._regressor(**structures[0])
        check_settings(first)
        sizes = self._sizes()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NarxWarning)  # the fit of the model that is taken tells it too
            record = open_data(first, X, y, sessions, reset=True)
        folds = split_in_runs(self.cv, record)
        refined = refinement_decides(first, record)
        with single_threaded_blas(), warnings.catch_warnings():
            warnings.simplefilter("ignore", NarxWarning)  # of trials; the model that is taken tells its own
            screened, finalists = self._judge(record, folds, structures, sizes, refined)
        self._tabulate(screened, finalists)
        self._tell_edges(screened)
        best = self._regressor(**self.best_params_)
        self.best_estimator_ = best.fit(X, y, sessions=sessions) if record.in_memory else best.fit(record)
        self.model_ = self.best_estimator_.model_
        self.n_features_in_ = self.best_estimator_.n_features_in_
        if hasattr(self.best_estimator_, "feature_names_in_"):
            self.feature_names_in_ = self.best_estimator_.feature_names_in_
        return self

    def _structures(self) -> list[dict]:
        """Return the grid over lags, delay and degree."""
        grid = {
            "output_lags": _choices(self.output_lags, "output_lags"),
            "input_lags": _choices(self.input_lags, "input_lags"),
            "delay": _choices(self.delay, "delay"),
            "degree": _choices(self.degree, "degree"),
        }
        return [dict(zip(grid, values, strict=True)) for values in product(*grid.values())]

    def _sizes(self) -> list[dict]:
        """Return how the number of terms may be chosen."""
        if isinstance(self.n_terms, str):
            check_choice(self.n_terms, "n_terms", ("all",))
            counts = list(range(1, self.max_terms + 1))
        else:
            counts = [] if self.n_terms is None else _choices(self.n_terms, "n_terms")
        criteria = [self.criterion] if isinstance(self.criterion, str) else list(self.criterion)
        sizes = [{"n_terms": n} for n in counts] + [{"criterion": c} for c in criteria]
        if not sizes:
            raise ValueError("Nothing chooses the number of terms: give n_terms, criterion, or both.")
        for size in sizes:
            check_settings(self._regressor(**size))
        return sizes

    def _regressor(self, **chosen) -> NARXRegressor:
        shared = (
            "phi", "phi_lags", "structure", "exclude", "max_terms", "search", "constraints", "refine",
            "fit_intercept", "origin", "sampling_period",
        )  # fmt: skip
        return NARXRegressor(**{name: getattr(self, name) for name in shared} | chosen)

    def _judge(self, record: Record, folds: list[Fold], structures, sizes, refined: bool):
        """Return the scores of the whole grid by least squares, and those of the finalists as fitted."""
        screening = self._screening(record, folds, structures, sizes)  # which refuses what cannot be fitted
        weights = fold_weights(scatter_of(record, folds))
        n_training = sum(run.stop - run.start for fold in folds for run in fold.training)
        n_choices = len(structures) * len(sizes)
        raced = n_choices > TABLE_TO_READ if self.race == "auto" else self.race
        room = 1.0 if self.rule == "best" else room_of_a_standard_error(weights)
        scores, counts = race(
            screening.judge,
            weights,
            (len(structures), len(sizes)),
            kept=len(structures) if not raced else n_leading(n_training) if refined else 1,
            room=1.0 if refined else room,
            whole=refined and len({tuple(size) for size in sizes}) > 1,  # numbers and criteria both go on
        )
        grid = [structure | size for structure in structures for size in sizes]
        screened = Judged(grid, scores.reshape(n_choices, -1), counts.reshape(n_choices, -1), weights)
        if not refined:
            return screened, None
        asked_all = isinstance(self.n_terms, str) and len(sizes) == self.max_terms
        own_size = self._regressor().criterion if asked_all else None
        chosen = choose_finalists(screened, sizes, own_size, n_training)
        return screened, judge_finalists(
            chosen, self._regressor, record, folds, weights=weights, kept=1 if raced else len(chosen),
            room=room, n_jobs=self.n_jobs,
        )  # fmt: skip

    def _screening(self, record: Record, folds: list[Fold], structures, sizes) -> Screening:
        """Pose every structure, and compress the record for all of them."""
        problems, constraints = [], []
        for structure in structures:
            regressor = self._regressor(**structure)
            check_settings(regressor)
            problem = without_repeated_powers(
                pose(regressor, record), record.moments, regressor.constraints, warn=False
            )
            problems.append(problem)
            constraints.append(constraints_of(regressor.constraints, problem))
        return Screening(problems, constraints, sizes, record, folds, self)

    def _tabulate(self, screened: Judged, finalists: Judged | None) -> None:
        """Store the results, and choose: among the finalists, where there are any."""
        judged = screened if finalists is None else screened.followed_by(finalists)
        pooled, terms, reached = judged.pooled, np.nanmean(judged.counts, axis=1), judged.n_reached
        names = dict.fromkeys(name for point in judged.choices for name in point)
        results = {f"param_{name}": _column([p.get(name) for p in judged.choices]) for name in names}
        results |= {f"split{i}_test_score": column for i, column in enumerate(judged.scores.T)}
        behind = np.zeros(len(pooled), dtype=bool)  # choices whose scores decide nothing
        behind[: 0 if finalists is None else len(screened.choices)] = True
        score = np.where(np.isnan(pooled), judged.within_reach, pooled)
        order = np.lexsort((np.arange(len(pooled)), terms, -score, -reached, behind))
        rank = np.empty(len(pooled), dtype=int)
        rank[order] = np.arange(1, len(pooled) + 1)
        self.cv_results_ = results | {
            "mean_test_score": judged.scores.mean(axis=1),
            "std_test_score": judged.scores.std(axis=1),
            "pooled_test_score": pooled,
            "mean_n_terms": terms,
            "rank_test_score": rank,
            "n_judged_splits": reached,
            "refined": ~behind & (finalists is not None),
        }
        best = int(order[0])
        if self.rule == "one_standard_error":
            near = np.flatnonzero((pooled >= pooled[best] - judged.standard_error[best]) & ~behind)
            best = int(near[np.lexsort((-pooled[near], terms[near]))[0]])
        self.best_index_ = best
        self.best_params_ = judged.choices[best]
        self.best_score_ = float(pooled[best])

    def _tell_edges(self, screened: Judged) -> None:
        """Warn where larger lags or degrees than those of the grid may be better.

        That is judged by the screen, which holds all of them, for the best of what it has of the structure
        that was chosen: the finalists may all lie at the edge.
        """
        chosen = {name: v for name, v in self.best_params_.items() if name not in ("n_terms", "criterion")}
        own = [g for g, choice in enumerate(screened.choices) if chosen.items() <= choice.items()]
        best = own[int(np.nanargmax(screened.pooled[own]))]
        edges = clear_edges(screened, best)
        if edges:
            said = " and ".join(f"{name}={value}" for name, value in edges.items())
            warnings.warn(
                f"The best choice has {said}, the largest of the grid, and is clearly better than with less: "
                f"more may be better still. Pass larger values for {' and '.join(edges)} as well.",
                NarxWarning,
                stacklevel=3,
            )

    def predict(self, X, y_init=None, sessions=None):
        """Simulate the best model; see `NARXRegressor.predict`."""
        check_is_fitted(self)
        return self.best_estimator_.predict(X, y_init=y_init, sessions=sessions)

    def predict_one_step(self, X, y, sessions=None):
        """Predict one step ahead; see `NARXRegressor.predict_one_step`."""
        check_is_fitted(self)
        return self.best_estimator_.predict_one_step(X, y, sessions=sessions)

    def residuals(self, X, y, sessions=None):
        """Return what the model leaves over; see `NARXRegressor.residuals`."""
        check_is_fitted(self)
        return self.best_estimator_.residuals(X, y, sessions=sessions)

    def predict_k_steps(self, X, y, steps, sessions=None):
        """Predict several steps ahead; see `NARXRegressor.predict_k_steps`."""
        check_is_fitted(self)
        return self.best_estimator_.predict_k_steps(X, y, steps, sessions=sessions)

    def score(self, X, y, sample_weight=None, sessions=None):
        """Return R² of the best model's free run; see `NARXRegressor.score`."""
        check_is_fitted(self)
        return self.best_estimator_.score(X, y, sample_weight=sample_weight, sessions=sessions)

    def __sklearn_is_fitted__(self):
        return hasattr(self, "model_")

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        tags.target_tags.multi_output = True
        tags.regressor_tags.poor_score = True
        return tags


def _choices(value, name: str) -> list:
    """Return the choices for one parameter; a single number is one choice."""
    if isinstance(value, Integral) and not isinstance(value, bool):
        return [value]
    if isinstance(value, str) or not isinstance(value, Sequence | np.ndarray) or len(value) == 0:
        raise TypeError(f"{name} must be a list of choices, got {value!r}.")
    return list(value)


def _column(values: list) -> np.ndarray:
    """Return values of any kind as a one-dimensional array of objects."""
    column = np.empty(len(values), dtype=object)
    column[:] = values
    return column

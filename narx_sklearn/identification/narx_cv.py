"""NARXRegressorCV: lags, degree and size chosen by free run on held-out folds, from one pass."""

from collections.abc import Sequence
from itertools import product
from numbers import Integral

import numpy as np
from joblib import Parallel, delayed
from sklearn.base import BaseEstimator, MetaEstimatorMixin, RegressorMixin
from sklearn.model_selection import TimeSeriesSplit, check_cv
from sklearn.utils.validation import check_is_fitted

from narx_sklearn._threads import single_threaded_blas
from narx_sklearn._validation import check_choice
from narx_sklearn.identification.constraints import LinearConstraints
from narx_sklearn.identification.factor import Factor, compress
from narx_sklearn.identification.narx import NARXRegressor
from narx_sklearn.identification.procedure import (
    Compressed,
    Problem,
    build_model,
    compress_choices,
    estimate_terms,
    origin_choices,
    scaled_constraints,
    scaled_layout,
    total_criterion,
)
from narx_sklearn.identification.regressors import Candidates
from narx_sklearn.identification.scoring import DIVERGED_SCORE, FreeRunJudge
from narx_sklearn.identification.selection import search_terms
from narx_sklearn.model.recording import Recording, lay_out
from narx_sklearn.model.terms import TermLibrary

__all__ = ["NARXRegressorCV"]

RULES = ("best", "one_standard_error")


class NARXRegressorCV(MetaEstimatorMixin, RegressorMixin, BaseEstimator):
    """Choose lags, delay, degree and number of terms by the free run on held-out folds.

    Equivalent to ``GridSearchCV`` over `NARXRegressor` without free-run refinement, at a fraction of its
    cost: the record is compressed once for the largest library of the grid; every fold, lag, degree and
    size is then worked out on small triangular factors.

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
        Folds; an integer is that many of ``TimeSeriesSplit``, None five. Lags never reach across the edge
        of a training part.
    rule : {"best", "one_standard_error"}, default="best"
        ``"best"`` takes the best mean score; ``"one_standard_error"`` the fewest terms whose mean score is
        within one standard error of it.
    phi, phi_lags, structure, exclude, max_terms, search, constraints, refine, fit_intercept, origin, \
sampling_period
        As for `NARXRegressor`; ``refine`` applies to the final fit.
    n_jobs : int, default=None
        Threads over folds.

    Attributes
    ----------
    best_estimator_ : NARXRegressor
        Fitted to all the data with the best choice.
    best_params_ : dict
        Its parameters from the grid.
    best_score_ : float
        Its mean held-out R² of the free run.
    cv_results_ : dict of ndarray
        Parameters and scores of all choices, ready for a DataFrame: ``param_*``, ``mean_test_score``,
        ``std_test_score``, ``rank_test_score``, ``split<i>_test_score``, ``mean_n_terms``.
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
    >>> search = NARXRegressorCV(max_terms=6, rule="one_standard_error").fit(u, y)
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
        self.n_jobs = n_jobs

    def fit(self, X, y, sessions=None):
        """Judge the whole grid, and fit the best choice to all the data.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_inputs)
            Inputs.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Outputs.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample.

        Returns
        -------
        self
        """
        self.__dict__.pop("model_", None)  # an interrupted fit leaves nothing that could be used
        check_choice(self.rule, "rule", RULES)
        sizes = self._sizes()
        structures = self._structures()
        with single_threaded_blas():
            scores, counts = self._judge(X, y, sessions, structures, sizes)
        self._tabulate(structures, sizes, scores, counts)
        self.best_estimator_ = self._regressor(**self.best_params_).fit(X, y, sessions=sessions)
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
        return sizes

    def _regressor(self, **chosen) -> NARXRegressor:
        shared = (
            "phi", "phi_lags", "structure", "exclude", "max_terms", "search", "constraints", "refine",
            "fit_intercept", "origin", "sampling_period",
        )  # fmt: skip
        return NARXRegressor(**{name: getattr(self, name) for name in shared} | chosen)

    def _judge(self, X, y, sessions, structures, sizes):
        """Return free-run scores and numbers of terms, shape (n_structures, n_sizes, n_folds)."""
        problems, constraints = [], []
        for structure in structures:
            regressor = self._regressor(**structure)
            regressor._check_parameters()
            inputs, outputs, problem, _ = regressor._read(X, y, sessions, reset=True)
            problems.append(problem)
            constraints.append(regressor._constraints(problem))
        X, y = inputs, outputs
        in_time = self.cv is None or isinstance(self.cv, Integral)
        cv = TimeSeriesSplit(5 if self.cv is None else int(self.cv)) if in_time else check_cv(self.cv)
        if X.shape[0] < 2:
            raise ValueError(f"Folds need at least two samples, got n_samples = {X.shape[0]}.")
        folds = list(cv.split(X))
        union = Problem(
            problems[0].outputs,
            problems[0].inputs,
            problems[0].phi,
            TermLibrary(term for problem in problems for term in problem.library),
        )
        record = _FoldedRecord(union, X, y, sessions, folds, self)
        work = delayed(self._judge_fold)
        results = Parallel(n_jobs=self.n_jobs, prefer="threads")(
            work(record, f, problems, constraints, sizes) for f in range(len(folds))
        )
        scores, counts = zip(*results, strict=True)
        return np.stack(scores, axis=-1), np.stack(counts, axis=-1)

    def _judge_fold(self, record: "_FoldedRecord", f: int, problems, constraints, sizes):
        scores = np.full((len(problems), len(sizes)), DIVERGED_SCORE)
        counts = np.zeros((len(problems), len(sizes)), dtype=int)
        test = record.folds[f][1]
        X, y = record.X[test], record.y[test]
        labels = None if record.sessions is None else np.asarray(record.sessions)[test]
        judge = FreeRunJudge(X, y, sessions=labels)
        for g, (problem, bound) in enumerate(zip(problems, constraints, strict=True)):
            choices = record.choices(f, problem, bound)
            paths = [
                [
                    search_terms(
                        c.factor, self.max_terms, search=self.search, output=i,
                        constraints=scaled_constraints(c, i, bound[i]),
                    )
                    for i in range(len(problem.outputs))
                ]
                for c in choices
            ]  # fmt: skip
            judged: dict = {}
            for s, size in enumerate(sizes):
                selected = _select_size(choices, paths, bound, size)
                model = build_model(selected, problem)
                key = (model.library, tuple(model.origin))
                if key not in judged:
                    judged[key] = judge.score(model)
                scores[g, s] = judged[key]
                counts[g, s] = model.n_terms
        return scores, counts

    def _tabulate(self, structures, sizes, scores, counts) -> None:
        """Store the results, and choose."""
        grid = [structure | size for structure in structures for size in sizes]
        flat = scores.reshape(len(grid), -1)
        mean, spread = flat.mean(axis=1), flat.std(axis=1)
        terms = counts.reshape(len(grid), -1).mean(axis=1)
        names = dict.fromkeys(name for point in grid for name in point)
        results = {f"param_{name}": _column([point.get(name) for point in grid]) for name in names}
        results |= {f"split{i}_test_score": flat[:, i] for i in range(flat.shape[1])}
        order = np.lexsort((np.arange(len(grid)), terms, -mean))
        rank = np.empty(len(grid), dtype=int)
        rank[order] = np.arange(1, len(grid) + 1)
        self.cv_results_ = results | {
            "mean_test_score": mean,
            "std_test_score": spread,
            "mean_n_terms": terms,
            "rank_test_score": rank,
        }
        best = int(order[0])
        if self.rule == "one_standard_error":
            near = np.flatnonzero(mean >= mean[best] - spread[best] / np.sqrt(flat.shape[1]))
            best = int(near[np.lexsort((-mean[near], terms[near]))[0]])
        self.best_index_ = best
        self.best_params_ = grid[best]
        self.best_score_ = float(mean[best])

    def predict(self, X, y_init=None, sessions=None):
        """Simulate the best model; see `NARXRegressor.predict`."""
        check_is_fitted(self)
        return self.best_estimator_.predict(X, y_init=y_init, sessions=sessions)

    def predict_one_step(self, X, y, sessions=None):
        """Predict one step ahead; see `NARXRegressor.predict_one_step`."""
        check_is_fitted(self)
        return self.best_estimator_.predict_one_step(X, y, sessions=sessions)

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


class _FoldedRecord:
    """A record compressed stretch by stretch, so that the training part of every fold is a merge."""

    def __init__(self, problem: Problem, X, y, sessions, folds, settings: NARXRegressorCV):
        self.problem, self.X, self.y, self.sessions, self.folds = problem, X, y, sessions, folds
        self.settings = settings
        self.layout = scaled_layout(problem, X, y, sessions)
        self.training = np.zeros((len(folds), X.shape[0]), dtype=bool)
        for f, (train, _) in enumerate(folds):
            self.training[f, train] = True
        changes = np.flatnonzero(np.any(self.training[:, 1:] != self.training[:, :-1], axis=0)) + 1
        self.edges = np.concatenate([[0], changes, [X.shape[0]]])
        self._parts: dict = {}

    def choices(self, f: int, problem: Problem, constraints) -> list[Compressed]:
        """Return the training part of fold ``f``, compressed at the origins worth trying."""
        chosen = self.settings
        origins = origin_choices(
            chosen.origin, problem, self.layout, self.X, self.y, constraints, chosen.structure,
            chosen.fit_intercept,
        )  # fmt: skip
        return compress_choices(
            problem, self.layout, origins, lambda at: self._training_factor(f, problem.library, at)
        )

    def _training_factor(self, f: int, library: TermLibrary, layout) -> Compressed:
        """Merge the stretches of a fold, and add the few rows that only this library can use."""
        recording, rows, parts = self._stretches(layout)
        inside = self.training[f]
        table = library.table(layout.channels)
        usable = recording.rows(table.channels, table.lags, targets=range(len(layout.outputs)))
        # a row counts when all it reads lies in one training part
        run_start = np.maximum.accumulate(
            np.where(inside & ~np.concatenate([[False], inside[:-1]]), np.arange(inside.size), 0)
        )
        usable = usable[inside[usable] & (usable - run_start[usable] >= library.max_lag)]
        columns = [self.problem.library.index(term) for term in library]
        total = Factor.empty(len(library), len(layout.outputs))
        covered = np.zeros(inside.size, dtype=bool)
        for stretch, factor in zip(rows, parts, strict=True):
            if stretch.size and inside[stretch[0]]:
                covered[stretch] = True
                total = total.merge(factor.subset(columns))
        left = usable[~covered[usable]]
        if left.size:
            total = total.merge(compress([Candidates(library, layout, recording, left)]))
        return Compressed(library, layout, total, len(library))

    def _stretches(self, layout) -> tuple[Recording, list[np.ndarray], list[Factor]]:
        """Return, once for each origin, the factors of the stretches between the folds' edges."""
        key = layout.origin.tobytes()
        if key not in self._parts:
            recording = lay_out(layout, self.X, self.y, self.sessions)
            every = Candidates.of(self.problem.library, layout, recording)
            reach = self.problem.library.max_lag
            rows, parts = [], []
            for a, b in zip(self.edges[:-1], self.edges[1:], strict=True):
                stretch = every.rows[(every.rows >= a + reach) & (every.rows < b)]
                rows.append(stretch)
                piece = Candidates(self.problem.library, layout, recording, stretch)
                parts.append(
                    compress([piece])
                    if stretch.size
                    else Factor.empty(len(self.problem.library), len(layout.outputs))
                )
            self._parts[key] = recording, rows, parts
        return self._parts[key]


def _select_size(choices: list[Compressed], paths, bound: list[LinearConstraints], size: dict):
    """Return the terms of every output for one way of choosing their number, at the better origin."""
    criterion = size.get("criterion", "ebic")
    found = []
    for compressed, own in zip(choices, paths, strict=True):
        selected = []
        for i, path in enumerate(own):
            n = size.get("n_terms")
            count = min(n, len(path.supports) - 1) if n else path.best_size(criterion)
            selected.append(
                estimate_terms(compressed, i, path, count, criterion, bound[i] if len(bound[i]) else None)
            )
        found.append(selected)
    return min(found, key=lambda selected: total_criterion(selected, criterion))


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

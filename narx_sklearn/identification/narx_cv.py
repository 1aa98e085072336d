"""NARXRegressorCV: lags, degree and size chosen by free run on held-out folds, from one pass."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from numbers import Integral
from threading import Lock
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from sklearn.base import BaseEstimator, MetaEstimatorMixin, RegressorMixin
from sklearn.model_selection import TimeSeriesSplit, check_cv
from sklearn.utils.validation import check_is_fitted

from narx_sklearn._threads import single_threaded_blas
from narx_sklearn._validation import check_choice, check_count
from narx_sklearn.exceptions import NarxWarning, RankWarning
from narx_sklearn.identification.constraints import LinearConstraints
from narx_sklearn.identification.factor import Factor, compress
from narx_sklearn.identification.narx import NARXRegressor
from narx_sklearn.identification.opening import open_data
from narx_sklearn.identification.posing import constraints_of, pose
from narx_sklearn.identification.procedure import (
    Compressed,
    Problem,
    Selected,
    build_model,
    compress_choices,
    estimate_terms,
    merge_parts,
    origin_choices,
    scaled_constraints,
    scaled_layout,
    total_criterion,
)
from narx_sklearn.identification.record import Block, Record
from narx_sklearn.identification.regressors import Candidates, reach_of, remembers_all
from narx_sklearn.identification.scoring import FreeRunJudge
from narx_sklearn.identification.selection import search_terms
from narx_sklearn.identification.settings import check_settings
from narx_sklearn.identification.two_values import without_repeated_powers
from narx_sklearn.metrics import DIVERGED_SCORE
from narx_sklearn.model.recording import Layout
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
        As for `NARXRegressor`; ``refine`` applies to the final fit, and ``max_terms`` is a number.
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

    def fit(self, X, y=None, sessions=None):
        """Judge the whole grid, and fit the best choice to all the data.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_inputs), dask collection, or Recordings
            Inputs. dask collections and `Recordings` are compressed where they are; of the test parts of
            the folds, one for each thread is read into this process for its free runs.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs), default=None
            Outputs; None only where ``X`` is a `Recordings`.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample.

        Returns
        -------
        self
        """
        for name in ("model_", "feature_names_in_"):  # an interrupted fit leaves nothing that could be used
            self.__dict__.pop(name, None)
        check_choice(self.rule, "rule", RULES)
        check_count(self.max_terms, "max_terms")
        structures = self._structures()
        first = self._regressor(**structures[0])
        check_settings(first)
        sizes = self._sizes()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", NarxWarning)  # the fit of the model that is taken tells it too
            record = open_data(first, X, y, sessions, reset=True)
        with single_threaded_blas(), warnings.catch_warnings():
            warnings.simplefilter("ignore", RankWarning)  # of trials; the model that is taken tells its own
            scores, counts = self._judge(record, structures, sizes)
        self._tabulate(structures, sizes, scores, counts)
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

    def _judge(self, record: Record, structures, sizes):
        """Return free-run scores and numbers of terms, shape (n_structures, n_sizes, n_folds)."""
        problems, constraints = [], []
        for structure in structures:
            regressor = self._regressor(**structure)
            check_settings(regressor)
            problem = without_repeated_powers(
                pose(regressor, record), record.moments, regressor.constraints, warn=False
            )
            problems.append(problem)
            constraints.append(constraints_of(regressor.constraints, problem))
        if record.n_samples < 2:
            raise ValueError(f"Folds need at least two samples, got n_samples = {record.n_samples}.")
        folded = _FoldedRecord(problems, record, split_in_runs(self.cv, record), self)
        work = delayed(self._judge_fold)
        results = Parallel(n_jobs=self.n_jobs, prefer="threads")(
            work(folded, f, problems, constraints, sizes) for f in range(len(folded.folds))
        )
        scores, counts = zip(*results, strict=True)
        return np.stack(scores, axis=-1), np.stack(counts, axis=-1)

    def _judge_fold(self, record: "_FoldedRecord", f: int, problems, constraints, sizes):
        scores = np.full((len(problems), len(sizes)), DIVERGED_SCORE)
        counts = np.zeros((len(problems), len(sizes)), dtype=int)
        test = record.folds[f].test
        X, y, labels = record.record.take(test)
        judge = FreeRunJudge(X, y, sessions=parted(labels, test))
        longest = max(self.max_terms, *(size.get("n_terms", 0) for size in sizes))
        for g, (problem, bound) in enumerate(zip(problems, constraints, strict=True)):
            choices = record.choices(f, g, problem, bound)
            paths = [
                [
                    search_terms(
                        c.factor, longest, search=self.search, output=i,
                        constraints=scaled_constraints(c, i, bound[i]),
                    )
                    for i in range(len(problem.outputs))
                ]
                for c in choices
            ]  # fmt: skip
            judged: dict = {}
            for s, size in enumerate(sizes):
                selected = _select_size(choices, paths, bound, size, self.max_terms)
                if selected is None:  # the score of a divergence stays
                    counts[g, s] = size.get("n_terms", 0)
                    continue
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


class Fold(NamedTuple):
    """Training and test part as runs of consecutive samples."""

    training: list[slice]
    test: list[slice]


def split_in_runs(cv, record: Record) -> list[Fold]:
    """Return the folds of a splitter; those of time order without an index for each sample."""
    if cv is None or isinstance(cv, Integral):
        n_splits, n_samples = 5 if cv is None else int(cv), record.n_samples
        check = TimeSeriesSplit(n_splits)  # refuses a number of splits that cannot be
        size = n_samples // (n_splits + 1)
        if size == 0:
            list(check.split(np.empty((n_samples, 0))))  # raises, with scikit-learn's own words
        starts = range(n_samples - n_splits * size, n_samples, size)
        return [Fold([slice(0, a)], [slice(a, a + size)]) for a in starts]
    placeholder = np.empty((record.n_samples, 0))
    return [Fold(runs_of(np.sort(a)), runs_of(b)) for a, b in check_cv(cv).split(placeholder)]


def runs_of(indices: np.ndarray) -> list[slice]:
    """Return indices (or a mask) as runs of consecutive ones, in their order."""
    indices = np.flatnonzero(indices) if indices.dtype == bool else indices
    if indices.size == 0:
        return []
    cuts = np.flatnonzero(np.diff(indices) != 1) + 1
    firsts, lasts = indices[np.r_[0, cuts]], indices[np.r_[cuts - 1, indices.size - 1]]
    return [slice(int(a), int(b) + 1) for a, b in zip(firsts, lasts, strict=True)]


def parted(labels: np.ndarray | None, runs: list[slice]) -> np.ndarray | None:
    """Return session labels that change from run to run too, where samples of several runs stand in a row."""
    if len(runs) < 2:
        return labels
    own = np.repeat(np.arange(len(runs)), [run.stop - run.start for run in runs])
    if labels is None:
        return own
    begins = (own[1:] != own[:-1]) | (labels[1:] != labels[:-1])
    return np.concatenate([[0], np.cumsum(begins)])


class _FoldedRecord:
    """A record compressed stretch by stretch, so that the training part of every fold is a merge."""

    def __init__(self, problems: list[Problem], record: Record, folds: list[Fold], settings: NARXRegressorCV):
        self.record, self.folds, self.settings = record, folds, settings
        first = problems[0]
        union = TermLibrary(term for problem in problems for term in problem.library)
        self.problem = Problem(first.outputs, first.inputs, first.phi, union)
        self.libraries = tuple(problem.library for problem in problems)
        self.layout = scaled_layout(self.problem, record)
        edges = {0, record.n_samples}
        for fold in folds:
            edges |= {edge for run in fold.training for edge in (run.start, run.stop)}
        self.edges = np.array(sorted(edges))
        self._parts: dict = {}
        self._lock = Lock()

    def choices(self, f: int, g: int, problem: Problem, constraints) -> list[Compressed]:
        """Return the training part of fold ``f``, compressed at the origins worth trying."""
        chosen = self.settings
        origins = origin_choices(
            chosen.origin, problem, self.layout, self.record, constraints, chosen.structure,
            chosen.fit_intercept,
        )  # fmt: skip
        return compress_choices(
            problem, self.layout, origins, lambda at: self._training_factor(f, g, problem.library, at)
        )

    def _training_factor(self, f: int, g: int, library: TermLibrary, layout) -> Compressed:
        """Merge the stretches of a fold, and add the few rows that only this library can use."""
        parts = self._compressed(layout)
        columns = [self.problem.library.index(term) for term in library]
        total = Factor.empty(len(library), len(layout.outputs))
        for s, begin in enumerate(self.edges[:-1]):
            if s in parts and any(run.start <= begin < run.stop for run in self.folds[f].training):
                total = total.merge(parts[s].subset(columns))
        if (f, g) in parts:
            total = total.merge(parts[f, g])
        return Compressed(library, layout, total, len(library))

    def _compressed(self, layout) -> dict:
        """Return, once for each origin, factors by stretch, and of what is left by fold and library."""
        key = layout.origin.tobytes()
        with self._lock:
            if key not in self._parts:
                union = self.problem.library
                self._parts[key] = self.record.total(
                    partial(folds_of_block, union, self.libraries, layout, self.edges, self.folds),
                    merge_parts,
                    reach=reach_of(union, layout),
                    whole=remembers_all(layout),
                )
            return self._parts[key]


def folds_of_block(
    union: TermLibrary,
    libraries: tuple[TermLibrary, ...],
    layout: Layout,
    edges: np.ndarray,
    folds: list[Fold],
    block: Block,
) -> dict:
    """Compress a block: what lies in each stretch, and for each fold and library what that leaves out.

    A sample counts where all that is read at it lies in one training part. In a stretch those are the samples
    from the longest lag on, for all libraries and folds alike; the others are few.
    """
    every = Candidates.in_block(union, layout, block)
    place = every.rows + block.origin
    stretch = np.searchsorted(edges, place, side="right") - 1
    inside = place - edges[stretch] >= reach_of(union, layout)
    found: dict = {}
    with single_threaded_blas():
        for s in np.unique(stretch[inside]):
            rows = every.rows[inside & (stretch == s)]
            found[int(s)] = compress([replace(every, rows=rows)])
        for g, library in enumerate(libraries):
            own = Candidates(library, layout, every.recording, usable_rows(library, layout, every, block))
            others = np.setdiff1d(own.rows, every.rows[inside], assume_unique=True)
            for f, fold in enumerate(folds):
                rows = others[_inside(fold.training, others + block.origin, reach_of(library, layout))]
                if rows.size:
                    found[f, g] = compress([replace(own, rows=rows)])
    return found


def usable_rows(library: TermLibrary, layout: Layout, every: Candidates, block: Block) -> np.ndarray:
    """Return the block's own samples at which a library is known."""
    rows = Candidates.of(library, layout, every.recording).rows
    return rows[rows >= block.n_past]


def _inside(runs: list[slice], places: np.ndarray, reach: int) -> np.ndarray:
    """Tell which places lie in a run, at least ``reach`` after its start."""
    if not runs:
        return np.zeros(places.size, dtype=bool)
    starts, stops = (np.array(side) for side in zip(*((r.start, r.stop) for r in runs), strict=True))
    own = np.searchsorted(starts, places, side="right") - 1
    return (own >= 0) & (places < stops[own]) & (places - starts[own] >= reach)


def _select_size(
    choices: list[Compressed], paths, bound: list[LinearConstraints], size: dict, max_terms: int
) -> list[Selected] | None:
    """Return the terms of every output for one way of choosing their number, at the better origin.

    A criterion chooses up to ``max_terms``; a number that is given may be larger. None where constraints rule
    it out.
    """
    criterion = size.get("criterion", "ebic")
    found = []
    for compressed, own in zip(choices, paths, strict=True):
        n = size.get("n_terms")
        counts = [
            min(n, len(path.supports) - 1) if n else path.up_to(max_terms).best_size(criterion)
            for path in own
        ]
        if not all(np.isfinite(path.rss[count]) for path, count in zip(own, counts, strict=True)):
            continue
        found.append(
            [
                estimate_terms(compressed, i, path, count, criterion, bound[i] if len(bound[i]) else None)
                for i, (path, count) in enumerate(zip(own, counts, strict=True))
            ]
        )
    return min(found, key=lambda selected: total_criterion(selected, criterion)) if found else None


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

"""NARXRegressor: identification of polynomial NARX models as a scikit-learn estimator."""

import textwrap
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from numbers import Integral, Real

import numpy as np
import pandas as pd
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from narx_sklearn._threads import single_threaded_blas
from narx_sklearn._validation import (
    as_signals,
    check_choice,
    check_count,
    check_indexes,
    check_inputs_given,
    check_no_times,
    check_same_length,
    column_labels,
    finite_columns,
    session_slices,
    signal_names,
    signal_units,
)
from narx_sklearn.exceptions import DivergenceWarning, NarxWarning
from narx_sklearn.identification.batches import Batches
from narx_sklearn.identification.constraints import LinearConstraints, parse_constraints
from narx_sklearn.identification.criteria import CRITERIA, information_criterion
from narx_sklearn.identification.estimation import recursive_least_squares
from narx_sklearn.identification.extended import extended_least_squares
from narx_sklearn.identification.hysteresis import check_continuum, expand_continuum
from narx_sklearn.identification.procedure import (
    Compressed,
    Problem,
    Selected,
    build_model,
    compress_choices,
    compress_record,
    estimate_terms,
    longest_size,
    on_library,
    on_screened,
    origin_choices,
    parameter_scales,
    scaled_constraints,
    scaled_layout,
    scores_on_factors,
    select_terms,
    stretch_factors,
    total_criterion,
    warn_if_bound,
    warn_if_short,
)
from narx_sklearn.identification.record import ArrayRecord, Moments, Record
from narx_sklearn.identification.recordings import open_record
from narx_sklearn.identification.refinement import free_run_uncertainty, refine_free_run
from narx_sklearn.identification.regressors import Candidates, candidates_of, reach_of, remembers_all
from narx_sklearn.identification.scoring import free_run_score
from narx_sklearn.identification.selection import SEARCHES, criterion_minima, err_order, size_window
from narx_sklearn.identification.simulation_search import FreeRunData, select_on_simulation
from narx_sklearn.identification.structure import candidate_library, named_phi, structure_filter
from narx_sklearn.identification.uncertainty import (
    OneStepScores,
    ParameterUncertainty,
    one_step_scores,
    parameter_uncertainty,
)
from narx_sklearn.identification.whiteness import is_white
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.recording import lay_out
from narx_sklearn.model.simulation import FreeRun, free_run, predict_k_steps, predict_one_step
from narx_sklearn.model.times import step_of_rows

__all__ = ["NARXRegressor"]

ESTIMATORS = ("ls", "ridge", "els", "rls")
ORIGINS = ("auto", "zero", "mean")
SIZES = ("criterion", "free_run")
GATHERED_SAMPLES = (
    2_000_000  # of files or a cluster, gathered unasked for the free-run refinement: minutes of it
)
NOWHERE = (0.0, 0.0, 0.0)  # what is known of a signal's values where nothing was recorded
FAR = 1000  # spans of the fitted outputs from their middle: a free run that gets there is no motion of theirs
AS_GOOD = 3  # times the one-step error up to which a model is another view of a record, not another plant
SEARCHED_COST = 2e11  # operations up to which the search on the simulation error uses all candidates


class NARXRegressor(RegressorMixin, BaseEstimator):
    """Identify a polynomial NARX model and simulate it.

    The model is ``y[k] = F(y[k-1], ..., u[k-delay], ..., phi[k-1], ...)`` (2.12), F a polynomial of few
    terms. ``fit`` chooses the terms and estimates their parameters; ``predict`` is the free run, which
    reads the inputs and its own past outputs only; ``score`` judges the free run.

    The lag of a variable is how many samples it lies in the past: ``u[k-2]`` has lag 2. The delay is the
    smallest lag an input may have: with ``delay=1`` the input acts from the next sample on, with
    ``delay=0`` the current sample ``u[k]`` is among the candidates::

        sample        k-3     k-2     k-1      k
        outputs      y[k-3]  y[k-2]  y[k-1]  (y[k] is computed)
        inputs       u[k-3]  u[k-2]  u[k-1]   u[k]
        input_lags=3, delay=1:  [1, 2, 3]           input_lags=3, delay=0:  [0, 1, 2, 3]
        input_lags=3, delay=2:  [2, 3]              input_lags=[0, 3]:      [0, 3]

    Parameters
    ----------
    output_lags : int, list of int, or one of these for each output, default=1
        Lags of the outputs: n means 1 to n, a list means itself. One for each output as a list of lists
        or a mapping from names. 0 or an empty list for none.
    input_lags : int, list of int, or one of these for each input, default=1
        Lags of the inputs: n means ``delay`` to n, a list means itself. 0 or an empty list for a model
        without inputs.
    phi : sequence of Phi, default=()
        Functions of inputs and outputs that are candidates like signals; see `narx_sklearn.model.Phi`.
        Unnamed ones become ``phi1``, ``phi2``, ...
    phi_lags : int, list of int, or one of these for each phi, default=1
        Lags of the phi regressors, as for what they are functions of.
    delay : int or one for each input, default=1
        Smallest lag of the inputs where ``input_lags`` is an integer.
    degree : int, default=2
        Highest degree of a term.
    structure : None, str or callable, default=None
        Which candidate terms may be used: a named structure, or a function that takes a `Term` and
        returns whether it is a candidate.
    exclude : sequence of str, default=()
        Term clusters left out, such as ``"y^2"`` or ``"y*u"`` (Def. 2.2).
    criterion : {"ebic", "bic", "aic", "aicc", "fpe", "lilc", "khundrin"}, default="ebic"
        Criterion that chooses the number of terms; see `information_criterion`.
    n_terms : int, default=None
        Number of terms; None lets the criterion choose.
    max_terms : int or None, default=20
        Largest number of terms tried. None tries as many as the default, and does not warn where more might
        have been chosen.
    search : {"exchange", "floating", "forward", "iterated"}, default="exchange"
        How sets of terms are searched; ``"forward"`` is the classical ERR ordering. See `search_terms`.
    size : {"criterion", "free_run"}, default="criterion"
        ``"criterion"`` takes the criterion's global minimum. ``"free_run"`` takes, of the sizes round its
        first two local minima, the one whose free run has the best criterion (section 5.2.1.1). Neither
        takes more terms than half of the usable samples.
    constraints : str, list of str or (S, c), default=None
        Equality constraints on the parameters, ``"y[k-1] + y[k-2] = 1"`` (2.47); with several outputs a
        mapping from their names. A term stands for its parameter, and ``constant`` for that of the constant
        term, which is ``1`` in ``terms_`` and a number here: ``"constant = 0.2"``. Signals of a table are
        named by its columns, without units. Parameters are those of the signals in their units, counted from
        ``origin``. ``"continuum"`` is
        Lemma 4.1 for models with hysteresis: the linear output parameters sum to 1, so that with
        ``structure="hysteresis"`` every output is a steady state.
    estimator : {"ls", "ridge", "els", "rls"}, default="ls"
        Least squares (2.46)-(2.48); with a penalty; extended, with noise terms used while fitting and
        dropped after; recursive (2.50)-(2.52), the parameters being those after the last sample.
    alpha : float, default=1e-6
        Ridge penalty, relative to the mean square of each term; used by ``"ridge"``.
    noise_lags : int, default=2
        Lags of the noise terms of ``"els"``.
    forgetting : float or "variable", default=1.0
        Forgetting factor of ``"rls"``; of earlier batches in ``partial_fit``, where it must be a number.
    refine : {"auto", True, False}, default="auto"
        Free-run refinement. ``"auto"`` also searches the terms by their effect on the free run. It keeps
        that result where the noise turns out to be on the output (the criterion of the simulation error is
        the smaller), and where the one-step residuals are coloured, so that least squares is biased by
        noise or by missing structure. With white residuals least squares stays, unless its free run of the
        record is lost (it leaves the finite range, or goes a thousand times as far as the outputs) where
        that of the result is not, and errs at most three times as much one step ahead; one that errs more
        is of another plant, as a bounded model of an unstable one is. With several outputs nothing is
        searched, and only a free run that is lost is fitted. True fits the chosen terms to the free run
        whatever the noise; the fit never ends worse than it began. Where the free run of what is kept is
        lost, ``fit`` warns; False does not simulate.
    fit_intercept : bool, default=True
        Whether the constant term is a candidate.
    origin : {"auto", "zero", "mean"} or mapping of {str: float}, default="auto"
        Operating point from which signals count inside the terms. ``"auto"`` takes the mean for signals
        that never come within their standard deviation of zero, such as a temperature in kelvin, and for
        the others what gives the better criterion, zero or the mean. What is selected does not depend on
        units in any case.
    sampling_period : float, default=None
        Seconds between samples, kept in the model. None takes the step of the time index of ``X`` or
        ``y`` (times, or numbers called ``time [s]``), if there is one.
    checkpoint : str or path-like, default=None
        Folder in which a long fit leaves what it has compressed so far. A fit that was interrupted goes on
        from there; one with other data or settings is refused. None keeps nothing.

    Attributes
    ----------
    model_ : NARXModel
        The identified model.
    terms_ : list of str
        Its terms, in canonical order.
    coef_ : ndarray of shape (n_terms,) or (n_terms, n_outputs)
        Their parameters, in the units of the signals.
    err_ : ndarray of shape (n_terms,) or (n_terms, n_outputs)
        Error reduction ratio of each (2.42).
    path_ : SelectionPath or list of SelectionPath
        Best set and residual for every size, one for each output where there are several.
    candidates_ : TermLibrary
        The candidate terms (after screening, where there were many).
    noise_ : {"equation", "output", "mixed"}
        Where the noise was taken to be: white in the equation, on the output, or neither.
    continuum_ : RestingDynamics or None
        With ``constraints="continuum"`` whether Lemma 4.1 holds: sums and eigenvalues at rest.
    refinement_ : FreeRunFit or None
        How the free-run refinement went.
    sigma_ : ndarray of shape (n_outputs,)
        Standard deviation of the one-step residuals.
    uncertainty_ : list of ParameterUncertainty
        Covariance of the parameters of each output's terms, robust to coloured residuals.
    n_features_in_ : int
        Number of inputs.
    feature_names_in_ : ndarray of str
        Names of the columns of ``X``, if they were texts.

    See Also
    --------
    NARXRegressorCV : Choose lags, degree and size by free run on held-out folds.

    References
    ----------
    S. Chen, S. A. Billings, W. Luo (1989) for the error reduction ratio; P. Pudil, J. Novovicova,
    J. Kittler (1994) for floating search; J. Chen, Z. Chen (2008) for the criterion.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn import NARXRegressor
    >>> rng = np.random.default_rng(0)
    >>> u = rng.uniform(-1, 1, size=(500, 1))
    >>> y = np.zeros(500)
    >>> for k in range(1, 500):
    ...     y[k] = 0.5 * y[k - 1] + u[k - 1, 0] ** 2 + 0.01 * rng.normal()
    >>> narx = NARXRegressor(output_lags=2, input_lags=2, degree=2).fit(u, y)
    >>> narx.terms_
    ['y[k-1]', 'u[k-1]^2']
    >>> narx.coef_.round(2).tolist()
    [0.5, 1.0]
    """

    def __init__(
        self,
        output_lags=1,
        input_lags=1,
        *,
        phi=(),
        phi_lags=1,
        delay=1,
        degree=2,
        structure=None,
        exclude=(),
        criterion="ebic",
        n_terms=None,
        max_terms=20,
        search="exchange",
        size="criterion",
        constraints=None,
        estimator="ls",
        alpha=1e-6,
        noise_lags=2,
        forgetting=1.0,
        refine="auto",
        fit_intercept=True,
        origin="auto",
        sampling_period=None,
        checkpoint=None,
    ):
        self.output_lags = output_lags
        self.input_lags = input_lags
        self.phi = phi
        self.phi_lags = phi_lags
        self.delay = delay
        self.degree = degree
        self.structure = structure
        self.exclude = exclude
        self.criterion = criterion
        self.n_terms = n_terms
        self.max_terms = max_terms
        self.search = search
        self.size = size
        self.constraints = constraints
        self.estimator = estimator
        self.alpha = alpha
        self.noise_lags = noise_lags
        self.forgetting = forgetting
        self.refine = refine
        self.fit_intercept = fit_intercept
        self.origin = origin
        self.sampling_period = sampling_period
        self.checkpoint = checkpoint

    # -- fitting ------------------------------------------------------------------------------------------

    def fit(self, X, y=None, sessions=None):
        """Select terms and estimate their parameters.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_inputs), dask collection, or Recordings
            Inputs. NaN marks gaps. Columns named like ``"drive [V]"`` or ``"drive (V)"`` give signals
            their names and units.
            dask arrays and DataFrames are compressed where their partitions are; `Recordings` are read
            from their files, block by block.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs), default=None
            Measured outputs, aligned with ``X``. NaN marks gaps. None only where ``X`` is a `Recordings`,
            which holds the outputs too.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample: where it changes another recording begins. Lags never reach across.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If a parameter is not valid, fewer than three samples have all lagged values, or ``X`` and
            ``y`` are pandas tables with different row labels (or the same in another order), or with times
            that go back within a session.
        TypeError
            If a column of ``X`` or ``y`` holds times; those belong into the index.

        Warns
        -----
        NarxWarning
            If ``max_terms`` bound the size, or ``n_terms`` is more than the candidates that can be told
            apart; if ``refine="auto"`` is left out because a dask collection or files hold too many samples,
            or an index tells that rows are missing, uneven or shuffled, or of another period than
            ``sampling_period``.
        ExcitationWarning
            If a signal is constant, or the record so short that the terms cannot be told apart.
        DivergenceWarning
            If the free run of the model that is kept leaves the finite range on the record itself, or goes a
            thousand times as far as its outputs, and ``refine`` is not False.

        Notes
        -----
        What reads all samples at once (``refine``, ``size="free_run"``, ``estimator="els"`` and ``"rls"``)
        gathers dask collections and files in this process.
        """
        self._forget()
        with single_threaded_blas():
            return self._fit(X, y, sessions)

    def _forget(self) -> None:
        """Drop the model and the batches of earlier fits; an interrupted fit leaves nothing to be used."""
        for name in ("model_", "_batches", "_end", "_problem", "_moments"):
            self.__dict__.pop(name, None)

    def _fit(self, X, y, sessions):
        self._check_parameters()
        record = self._open(X, y, sessions, reset=True)
        problem, units = self._pose(record)
        about = self._about(problem, units, record, record.moments)
        constraints = self._constraints(problem)
        choices = self._compress(problem, constraints, record)
        selected = self._select_best(choices, constraints)
        if self._reads_all_samples(record):
            record = record.in_one_place()
            samples = record.everything()
            if self.size == "free_run" and self.n_terms is None:
                selected = self._size_by_free_run(selected, problem, constraints, *samples)
            if self.estimator in ("els", "rls"):
                selected = [
                    self._estimate_again(one, i, constraints[i], *samples) for i, one in enumerate(selected)
                ]
        model = build_model(selected, problem, **about)
        refinement, noise = None, "equation"
        if record.in_memory:
            model, refinement, noise = self._refine(model, selected, constraints, *record.everything())
            if self._refine_mode != "never":
                self._warn_if_lost(model, *record.everything())
        warn_if_short(selected, model, self.n_terms, longest_size(self.max_terms))
        warn_if_bound(selected, model, self.n_terms, self.max_terms)
        self._store(model, selected, refinement, noise)
        self.uncertainty_ = self._uncertainty(constraints, partial(self._scores, record), record)
        return self

    def _reads_all_samples(self, record: Record) -> bool:
        """Tell whether steps after the compression want every sample of a record at once."""
        if record.in_memory:
            return True
        if self.size == "free_run" and self.n_terms is None:
            return True
        if self.estimator in ("els", "rls") or self._refine_mode == "always":
            return True
        if self._refine_mode == "never" or record.n_outputs > 1 or self.estimator != "ls":
            return False
        if record.n_samples > GATHERED_SAMPLES:
            warnings.warn(
                f"refine='auto' is left out: it simulates the whole record in this process, and n_samples = "
                f"{record.n_samples} are more than the {GATHERED_SAMPLES} that are gathered unasked. Pass "
                "refine=False to agree, or refine=True to gather and refine.",
                NarxWarning,
                stacklevel=4,
            )
            return False
        return True

    def partial_fit(self, X, y=None, sessions=None):
        """Add a batch of data: the compressed record grows, terms and parameters are chosen anew.

        Each batch counts as a recording of its own, unless its first session label is the last one of the
        batch before, with which it then goes on. ``forgetting`` weighs earlier batches down: all that came
        before by that factor, for each new batch. The origin, the scales and, for large libraries, the
        screened candidates are those of the first batch. Intervals and ``sigma_`` are those of all batches,
        with the same weights. Free-run refinement and ``"els"`` and ``"rls"`` need the raw data and are not
        available here. `fit` forgets the batches before it: one after it is a first batch.

        A batch with other signals or candidates than those before it is refused, and does not count.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_inputs), dask collection, or Recordings
            Inputs of the batch.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs), default=None
            Outputs of the batch; None only where ``X`` is a `Recordings`.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample.

        Returns
        -------
        self

        Raises
        ------
        ValueError
            If a parameter is not valid, or the batch does not go on with those before it.
        """
        self._check_parameters()
        if self.estimator in ("els", "rls"):
            raise ValueError(
                f"partial_fit keeps the compressed record only, which estimator={self.estimator!r} cannot "
                "use; choose 'ls' or 'ridge', or call fit."
            )
        if not isinstance(self.forgetting, Real) or not 0.0 < float(self.forgetting) <= 1.0:
            raise ValueError(
                "partial_fit weighs earlier batches by forgetting, which must be a number above 0 and at "
                f"most 1 here, got {self.forgetting!r}."
            )
        first = not hasattr(self, "_batches")
        record = self._open(X, y, sessions, reset=first)
        problem, units = self._pose(record)
        constraints = self._constraints(problem)
        moments = record.moments
        if first:
            choices = self._compress(problem, constraints, record)
            batches = [Batches.begin(compressed, record) for compressed in choices]
        else:
            self._check_same_problem(problem)
            moments = self._moments.merge(moments)
            record = self._continued(record)
            batches = [before.add(record, float(self.forgetting)) for before in self._batches]
        selected = self._select_best([b.compressed for b in batches], constraints)
        (taken,) = (b for b in batches if b.compressed is selected[0].compressed)
        model = build_model(selected, problem, **self._about(problem, units, record, moments))
        self._problem = problem
        self._moments: Moments = moments
        self._batches: list[Batches] = batches
        self._keep_end(record)
        self._store(model, selected, None, "equation")
        self.uncertainty_ = self._uncertainty(constraints, taken.scores)
        return self

    def _check_same_problem(self, problem: Problem) -> None:
        """Refuse a batch with other signals or candidates than the batches before it."""
        before = self._problem
        for what, was, now in (
            ("outputs", before.outputs, problem.outputs),
            ("inputs", before.inputs, problem.inputs),
            ("phi", before.phi, problem.phi),
            ("candidate terms", before.library, problem.library),
        ):
            if was != now:
                new, old = (textwrap.shorten(str(side), 60, placeholder=" ...") for side in (now, was))
                raise ValueError(
                    f"This batch has other {what} than the batches before it: {new} instead of {old}. "
                    "Name its columns alike and keep the parameters that say what is a candidate, or call "
                    "fit, which forgets the batches."
                )

    def _keep_end(self, record: Record) -> None:
        """Keep what the lags of a next batch of the same session will read."""
        reach = max(reach_of(b.compressed.library, b.compressed.layout) for b in self._batches)
        self._end = record.end(reach) if isinstance(record, ArrayRecord) and reach else None

    def _continued(self, record: Record) -> Record:
        """Return a batch with the end of the batch before in front, where it goes on with that session."""
        if not isinstance(record, ArrayRecord) or record.sessions is None or self._end is None:
            return record
        X, y, labels = self._end
        if labels is None or labels[-1] != record.sessions[0]:
            return record
        if remembers_all(self._batches[0].compressed.layout):
            raise ValueError(
                "phi regressors that remember all of the past cannot be computed batch by batch of one "
                "session; give every batch a label of its own in sessions, or call fit."
            )
        return record.after(X, y, labels)

    def _longest(self) -> int:
        return max(longest_size(self.max_terms), self.n_terms or 0)

    @property
    def _refine_mode(self) -> str:
        """What ``refine`` asks for: "auto", "always" or "never"; 1, 0 and NumPy's booleans count as such."""
        if isinstance(self.refine, str):
            return self.refine
        return "always" if self.refine else "never"

    def _check_parameters(self) -> None:
        check_choice(self.criterion, "criterion", CRITERIA)
        check_choice(self.search, "search", SEARCHES)
        check_choice(self.size, "size", SIZES)
        check_choice(self.estimator, "estimator", ESTIMATORS)
        for name in ("max_terms", "n_terms", "noise_lags"):
            value = getattr(self, name)
            if value is None and name != "noise_lags":
                continue
            check_count(value, name)
        if not isinstance(self.alpha, Real) or not 0.0 <= float(self.alpha) < np.inf:
            raise ValueError(f"alpha must be a finite number of at least 0, got {self.alpha!r}.")
        known = self.refine == "auto" if isinstance(self.refine, str) else self.refine in (True, False)
        if not known:
            raise ValueError(f"refine must be 'auto', True or False, got {self.refine!r}.")
        if isinstance(self.origin, str):
            check_choice(self.origin, "origin", ORIGINS)
        elif not isinstance(self.origin, Mapping):
            raise TypeError(
                "origin must be 'auto', 'zero', 'mean' or a mapping from names to numbers, "
                f"got {self.origin!r}."
            )

    def _open(self, X, y, sessions, *, reset: bool) -> Record:
        """Validate data and return them as a record, wherever they are."""
        record = open_record(X, y, sessions)
        if record is None:
            return self._open_arrays(X, y, sessions, reset=reset)
        validate_data(self, record.stand_in(), reset=reset, ensure_min_features=0)
        self._y_ndim = record.y_ndim
        if not record.moments.known[: record.n_outputs].all():
            raise ValueError("Input y contains NaN at every sample of an output; there is nothing to fit.")
        return record

    def _open_arrays(self, X, y, sessions, *, reset: bool) -> ArrayRecord:
        if X is None:
            raise ValueError(
                "X is None, but a record is wanted: inputs of shape (n_samples, n_inputs). For a model "
                "without inputs pass input_lags=[] and X=np.empty((n_samples, 0))."
            )
        check_no_times(X, "X")
        check_no_times(y, "y")
        check_indexes(X, y)
        step = step_of_rows(
            {"X": X, "y": y}, sessions, self.sampling_period, "the model by sampling_period", stacklevel=5
        )
        labels = column_labels(y)
        input_labels = column_labels(X)
        X = validate_data(
            self, X, reset=reset, dtype=np.float64, ensure_all_finite="allow-nan", order="C",
            ensure_min_features=0 if self._has_no_inputs() else 1,
        )  # fmt: skip
        if y is None:
            raise ValueError("requires y to be passed, but the target y is None")
        self._y_ndim = 2 if hasattr(y, "columns") else np.asarray(y).ndim
        y = as_signals(y, "y")
        if not finite_columns(y).all():
            raise ValueError("Input y contains NaN at every sample of an output; there is nothing to fit.")
        check_same_length(X=X, y=y, sessions=sessions)
        session_slices(sessions, X.shape[0])
        return ArrayRecord(
            X, y, sessions, input_labels=input_labels, output_labels=labels, y_ndim=self._y_ndim,
            sampling_period=step,
        )  # fmt: skip

    def _pose(self, record: Record) -> tuple[Problem, dict[str, str]]:
        """Say what is to be identified, and the signals' units."""
        labels, input_labels = record.output_labels, record.input_labels
        outputs = signal_names(labels if labels is not None else range(record.n_outputs), "y")
        inputs = signal_names(input_labels if input_labels is not None else range(record.n_inputs), "u")
        clash = set(outputs) & set(inputs)
        if clash:
            raise ValueError(f"{sorted(clash)} is the name of an input and of an output; rename a column.")
        units = signal_units(outputs, labels) | signal_units(inputs, input_labels)
        phi = named_phi(self.phi, outputs + inputs)
        library = candidate_library(
            outputs,
            inputs,
            phi,
            output_lags=self.output_lags,
            input_lags=self.input_lags,
            phi_lags=self.phi_lags,
            delay=self.delay,
            degree=self.degree,
            include_constant=self.fit_intercept,
            keep=structure_filter(self.structure, self.exclude, outputs, inputs, phi),
        )
        self._library = library
        return Problem(outputs, inputs, phi, library), units

    def _about(
        self, problem: Problem, units: dict[str, str], record: Record, moments: Moments
    ) -> dict[str, object]:
        """Return what a model knows besides its equations."""
        values = zip(problem.outputs + problem.inputs, *moments.range, strict=True)
        recorded = {name: (low, mean, high) for name, low, mean, high in values if low <= high}
        period = record.sampling_period if self.sampling_period is None else self.sampling_period
        return {"sampling_period": period, "units": units, "recorded": recorded}

    def _has_no_inputs(self) -> bool:
        lags = self.input_lags
        return lags == 0 if isinstance(lags, Integral) else np.ndim(lags) == 1 and len(lags) == 0

    def _constraints(self, problem: Problem) -> list[LinearConstraints]:
        """Return the constraints of each output."""
        given = expand_continuum(
            self.constraints, problem.library, problem.outputs, problem.inputs, problem.phi
        )
        if isinstance(given, dict):
            unknown = set(given) - set(problem.outputs)
            if unknown:
                raise ValueError(
                    f"constraints name {sorted(unknown)}; the outputs are {list(problem.outputs)}."
                )
            return [parse_constraints(given.get(output), problem.library) for output in problem.outputs]
        if given is not None and len(problem.outputs) > 1:
            raise ValueError(
                "With several outputs, constraints must be a mapping from their names: "
                f"{{{problem.outputs[0]!r}: ...}}."
            )
        return [parse_constraints(given, problem.library) for _ in problem.outputs]

    def _compress(self, problem, constraints, record: Record) -> list[Compressed]:
        """Compress the record in the coordinates worth trying: one or two origins."""
        layout = scaled_layout(problem, record)
        origins = origin_choices(
            self.origin, problem, layout, record, constraints, self.structure, self.fit_intercept
        )
        return compress_choices(
            problem, layout, origins,
            lambda at: compress_record(
                problem.library, at, record, max_terms=self._longest(), constraints=constraints,
                search=self.search, checkpoint=self.checkpoint,
            ),
        )  # fmt: skip

    def _select_best(self, choices: list[Compressed], constraints) -> list[Selected]:
        """Select the terms of every output, in the coordinates where they serve best."""
        found = ([self._select(c, i, constraints[i]) for i in range(len(constraints))] for c in choices)
        return min(found, key=lambda selected: total_criterion(selected, self.criterion))

    def _select(self, compressed: Compressed, output: int, constraints: LinearConstraints) -> Selected:
        return select_terms(
            compressed,
            output,
            search=self.search,
            criterion=self.criterion,
            n_terms=self.n_terms,
            max_terms=longest_size(self.max_terms),
            constraints=on_screened(constraints, self._library, compressed.library),
            alpha=self.alpha if self.estimator == "ridge" else 0.0,
        )

    def _size_by_free_run(self, selected, problem, constraints, X, y, sessions) -> list[Selected]:
        """Of the sizes round the criterion's first minima take the one with the best free run."""
        chosen = list(selected)
        for output, one in enumerate(selected):
            values = one.path.criterion(self.criterion)
            minima = criterion_minima(values[: one.path.longest_comparable + 1])
            window = size_window(minima, one.path.longest_comparable)
            best = np.inf
            for size in window:
                if not np.isfinite(one.path.rss[size]):  # constraints ask for more terms
                    continue
                trial = estimate_terms(
                    one.compressed, output, one.path, size, self.criterion,
                    on_screened(constraints[output], self._library, one.compressed.library),
                    self.alpha if self.estimator == "ridge" else 0.0,
                )  # fmt: skip
                trials = [*chosen[:output], trial, *chosen[output + 1 :]]
                model = build_model(trials, problem)
                value = self._free_run_criterion(model, output, X, y, sessions, one.compressed.n_considered)
                if value < best:
                    best, chosen[output] = value, trial
        return chosen

    def _free_run_criterion(self, model, output, X, y, sessions, n_candidates) -> float:
        fit = refine_free_run(model, X, y, sessions=sessions, max_iter=0)
        if not np.isfinite(fit.loss):
            return np.inf
        return float(
            information_criterion(self.criterion, fit.loss, fit.n_samples, model.n_terms, n_candidates)
        )

    def _estimate_again(self, one: Selected, output: int, constraints, X, y, sessions) -> Selected:
        """Extended or recursive estimates of the terms that least squares chose."""
        layout = one.compressed.layout
        candidates = Candidates.of(one.library, layout, lay_out(layout, X, y, sessions))
        inside = on_screened(constraints, self._library, one.compressed.library)
        inside = scaled_constraints(one.compressed, output, inside) or LinearConstraints.none(
            len(one.compressed.library)
        )
        inside = inside.restrict(one.support)
        if self.estimator == "els":
            theta = extended_least_squares(candidates, output, one.theta, self.noise_lags, inside)
        else:
            fixed, free = inside.solution_space()
            Psi = candidates.matrix()
            estimate = recursive_least_squares(
                Psi @ free,
                candidates.targets[:, output] - Psi @ fixed,
                forgetting=self.forgetting,
                theta=free.T @ (one.theta - fixed),
            )
            theta = fixed + free @ estimate.theta
        return replace(one, theta=theta)

    def _refine(self, model, selected, constraints, X, y, sessions):
        """Fit, or search, by the free run; return the model, how it went, and where the noise is."""
        if self._refine_mode == "never":
            return model, None, "equation"
        inside = self._inside(model, selected, constraints)
        at_any_noise = partial(
            refine_free_run,
            model,
            X,
            y,
            sessions=sessions,
            constraints=inside,
            horizons=self._horizons(model),
        )
        if self._refine_mode == "always":
            fit = at_any_noise()
            return fit.model, fit, "output"
        if self.estimator != "ls":
            return model, None, "equation"
        if len(selected) > 1:  # nothing is searched, but a run that is lost is brought back
            if not is_lost(model, X, y, sessions):
                return model, None, "equation"
            fit = at_any_noise()
            return fit.model, fit, "mixed" if np.isfinite(fit.loss) else "equation"
        return self._search_free_run(model, selected[0], constraints[0], X, y, sessions)

    def _search_free_run(self, model, one: Selected, constraints, X, y, sessions):
        library = one.compressed.library
        inside = self._inside(model, [one], [constraints])
        if self.n_terms is not None or any(p.signals & set(model.outputs) for p in model.phi):
            # the terms stay: their number is given, or the search cannot differentiate a phi of an output
            fit = refine_free_run(model, X, y, sessions=sessions, constraints=inside)
            if not np.isfinite(fit.loss):
                fit = refine_free_run(
                    model, X, y, sessions=sessions, constraints=inside, horizons=self._horizons(model)
                )
        else:
            searched = library
            if X.shape[0] * len(library) ** 2 > SEARCHED_COST:
                searched = library.subset(sorted({j for s in one.path.supports for j in s}))
            fit = select_on_simulation(
                model,
                searched,
                FreeRunData(X, y, sessions),
                criterion=self.criterion,
                n_terms=longest_size(self.max_terms),
                constraints=on_screened(constraints, self._library, searched),
                horizons=self._horizons(model),
            ).fit
        if not np.isfinite(fit.loss):
            return model, fit, "equation"
        value = information_criterion(
            self.criterion, fit.loss, fit.n_samples, fit.model.n_terms, one.compressed.n_considered
        )
        equation = information_criterion(
            self.criterion,
            one.rss * one.compressed.layout.scale[0] ** 2 * fit.n_samples / one.path.n_samples,
            fit.n_samples,
            len(one.support),
            one.compressed.n_considered,
        )
        if value < equation:
            return fit.model, fit, "output"
        residuals = (y - predict_one_step(model, X, y, sessions=sessions))[:, 0]
        if not is_white(residuals, sessions):
            return fit.model, fit, "mixed"
        if is_lost(model, X, y, sessions):
            # that of an unstable plant under feedback is lost by right; what is bounded errs much more there
            refined = (y - predict_one_step(fit.model, X, y, sessions=sessions))[:, 0]
            if np.nansum(refined**2) <= AS_GOOD**2 * np.nansum(residuals**2):
                return fit.model, fit, "mixed"
        return model, None, "equation"

    def _warn_if_lost(self, model: NARXModel, X, y, sessions) -> None:
        """Warn where the free run of what is kept is lost on the record it was fitted on."""
        run = own_run(model, X, y, sessions)
        if run.stopped_at is not None:
            what = f"leaves the finite range at sample {run.stopped_at}"
        else:
            place = farthest(model, run.y)
            if place is None:
                return
            what = f"goes more than {FAR} times as far as its outputs, from sample {place[0]} on"
        searched = self._refine_mode == "auto" and self.estimator == "ls"
        failed, way = "no refinement brought it back", ""
        if searched:
            failed = "no refinement that errs about as little one step ahead brought it back"
            way = "refine=True for one that may err more, "
        elif self._refine_mode == "auto":
            failed, way = f"estimator={self.estimator!r} is not refined unasked", "refine=True, "
        warnings.warn(
            f"The free run of the fitted model {what} of its own record, and {failed}: predict and score, "
            "which simulate, are of no use, while predict_one_step may be. Try fewer terms (n_terms, "
            f"size='free_run'), other lags, a lower degree, {way}or, where predictions one step ahead are "
            "all that is wanted, refine=False.",
            DivergenceWarning,
            stacklevel=4,
        )

    @staticmethod
    def _horizons(model: NARXModel):
        return (10 * max(model.max_lag, 1), 100 * max(model.max_lag, 1), None)

    @staticmethod
    def _inside(model: NARXModel, selected, constraints) -> LinearConstraints | None:
        """Return the constraints on the model's nonzero parameters, output after output."""
        if not any(len(c) for c in constraints):
            return None
        rows, sides, width = [], [], int(np.count_nonzero(model.parameters))
        begin = 0
        for output, (one, c) in enumerate(zip(selected, constraints, strict=True)):
            kept = [t for t, value in zip(model.library, model.parameters[:, output], strict=True) if value]
            part = on_library(c, one.compressed.library, type(model.library)(kept))
            if part is not None:
                S = np.zeros((len(part), width))
                S[:, begin : begin + len(kept)] = part.S
                rows.append(S)
                sides.append(part.c)
            begin += len(kept)
        return LinearConstraints(np.vstack(rows), np.concatenate(sides))

    def _store(self, model: NARXModel, selected: list[Selected], refinement, noise: str) -> None:
        single = len(selected) == 1
        self.model_ = model
        self.continuum_ = check_continuum(model, self.constraints)
        self.terms_ = model.library.names
        self.coef_ = model.parameters[:, 0].copy() if single else model.parameters.copy()
        err = np.zeros(model.parameters.shape)
        for i, one in enumerate(selected):
            kept = [t for t, value in zip(model.library, model.parameters[:, i], strict=True) if value]
            columns = [one.compressed.library.index(term) for term in kept]
            order, ratios = err_order(one.compressed.factor, columns, output=i)
            for column, ratio in zip(order, ratios, strict=True):
                err[model.library.index(one.compressed.library[column]), i] = ratio
        self.err_ = err[:, 0] if single else err
        self.path_ = selected[0].path if single else [one.path for one in selected]
        self.candidates_ = selected[0].compressed.library
        self.refinement_ = refinement
        self.noise_ = noise
        self._layout = selected[0].compressed.layout

    def _uncertainty(
        self, constraints, scores_of: Callable[..., OneStepScores], record: Record | None = None
    ) -> list[ParameterUncertainty]:
        """Covariances from the residuals of what was fitted: one step, or free run of the record."""
        model = self.model_
        found, sigma = [], []
        for output in range(len(model.outputs)):
            present = model.parameters[:, output] != 0.0
            kept = model.library.subset(np.flatnonzero(present))
            inside = on_library(constraints[output], self._library, kept)
            scales = parameter_scales(self._layout, kept, output)
            theta = model.parameters[present, output] / scales
            scores = scores_of(kept, theta, output)
            sigma.append(self._layout.scale[output] * scores.residual_deviation)
            if record is not None and self.noise_ != "equation" and len(model.outputs) == 1:
                X, y, sessions = record.everything()
                found.append(free_run_uncertainty(model, X, y, sessions=sessions, constraints=inside))
                continue
            scaled = None if inside is None else inside.scaled(scales)
            robust = parameter_uncertainty(scores.gram, scores.sums, scaled, grams=scores.grams)
            found.append(replace(robust, covariance=robust.covariance * np.outer(scales, scales)))
        self.sigma_ = np.array(sigma)
        return found

    def _scores(self, record: Record, library, theta, output: int) -> OneStepScores:
        """Sum the scores of the estimate over stretches: sample by sample, or where the samples are."""
        if isinstance(record, ArrayRecord):
            return one_step_scores(partial(candidates_of, library, self._layout, record), theta, output)
        stretches = stretch_factors(library, self._layout, record)
        return scores_on_factors(stretches, theta, output, sum(f.n_samples for f in stretches))

    # -- prediction ---------------------------------------------------------------------------------------

    def predict(self, X, y_init=None, sessions=None):
        """Simulate the model: the free run.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_inputs)
            Inputs; NaN marks gaps, after which the simulation starts anew.
        y_init : array-like of shape (n_init,), (n_init, n_outputs) or as long as ``X``, default=None
            Measured outputs, of which the first ``model_.max_lag`` samples (of each session) are the
            initial condition; a single value where that is all. Where they hold NaN, and everywhere with
            None, the simulation starts from the model's steady state for the first input.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample; where it changes, the simulation starts anew.

        Returns
        -------
        ndarray of shape (n_samples,) or (n_samples, n_outputs)
            Simulated outputs; the first ``max_lag`` of them are ``y_init``, where given.

        Warns
        -----
        DivergenceWarning
            If an output leaves the finite range, or goes more than a thousand times as far as the outputs
            that were fitted; says at which sample.
        NarxWarning
            If ``y_init`` holds NaN wherever the simulation starts, so that it says nothing.
        """
        check_is_fitted(self)
        step_of_rows({"X": X}, sessions, self.model_.sampling_period, "the model by sampling_period")
        X = self._inputs(X)
        run = free_run(self.model_, X, y_init, sessions=sessions)
        if y_init is not None and run.started_from == "steady state" and np.isfinite(run.y).any():
            warnings.warn(
                f"y_init lacks a value among the {self.model_.max_lag} samples from which the simulation "
                "starts (longest lag of its terms), so it starts from the model's steady state. Pass "
                "measured outputs without NaN there, or begin where they are known; y_init=None agrees.",
                NarxWarning,
                stacklevel=2,
            )
        if run.stopped_at is None:
            self._warn_if_far(run.y)
        return self._shaped(run.y)

    def _warn_if_far(self, y: np.ndarray) -> None:
        """Warn where a free run goes where nothing that was fitted ever was."""
        place = farthest(self.model_, y)
        if place is None:
            return
        k, i = place
        low, _, high = self.model_.recorded[self.model_.outputs[i]]
        warnings.warn(
            f"The free run of {self.model_.outputs[i]!r} goes to {y[k, i]:.3g} at sample {k}, and was fitted "
            f"on {low:.3g} to {high:.3g}: more than {FAR} times as far. The model is unstable for this "
            "input or initial condition, or they lie far beyond the record it was fitted on. Fit to the free "
            "run with refine=True, fit fewer terms with n_terms, or keep to the range of the record.",
            DivergenceWarning,
            stacklevel=3,
        )

    def predict_one_step(self, X, y, sessions=None):
        """Predict each output from measured outputs up to the sample before.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_inputs)
            Inputs.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Measured outputs; those of the past are read.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample.

        Returns
        -------
        ndarray of shape (n_samples,) or (n_samples, n_outputs)
            Predictions; NaN where a lagged value is not known.
        """
        check_indexes(X, y)
        return self._shaped(predict_one_step(self.model_, self._inputs(X), y, sessions=sessions))

    def predict_k_steps(self, X, y, steps, sessions=None):
        """Predict each output from measured outputs up to ``steps`` samples before.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_inputs)
            Inputs.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Measured outputs.
        steps : int
            Horizon in samples.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample.

        Returns
        -------
        ndarray of shape (n_samples,) or (n_samples, n_outputs)
            Predictions; NaN where the past is not known.
        """
        check_indexes(X, y)
        return self._shaped(predict_k_steps(self.model_, self._inputs(X), y, steps, sessions=sessions))

    def score(self, X, y, sample_weight=None, sessions=None):
        """Return R² of the free run.

        The first ``model_.max_lag`` outputs of each session, and after each gap of the input, are the initial
        condition and are not scored.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_inputs)
            Inputs.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Measured outputs.
        sample_weight : array-like of shape (n_samples,), default=None
            Weights of the samples.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample.

        Returns
        -------
        float
            R², averaged over outputs; a free run that leaves the finite range scores -1e6.
        """
        check_indexes(X, y)
        return free_run_score(self.model_, self._inputs(X), y, sessions=sessions, sample_weight=sample_weight)

    def _inputs(self, X) -> np.ndarray:
        check_is_fitted(self)
        check_inputs_given(X, self.model_.inputs)
        check_no_times(X, "X")
        return validate_data(
            self, X, reset=False, dtype=np.float64, ensure_all_finite="allow-nan", order="C",
            ensure_min_features=0 if self._has_no_inputs() else 1,
        )  # fmt: skip

    def _shaped(self, y: np.ndarray) -> np.ndarray:
        return y[:, 0] if self._y_ndim == 1 else y

    # -- what was found -----------------------------------------------------------------------------------

    def confidence_intervals(self, level=0.95):
        """Return confidence intervals of the parameters.

        Parameters
        ----------
        level : float, default=0.95
            Coverage.

        Returns
        -------
        ndarray of shape (n_terms, 2) or (n_terms, n_outputs, 2)
            Lower and upper ends, in the order of ``terms_``; NaN where an output lacks the term.
        """
        check_is_fitted(self)
        bounds = np.full((*self.model_.parameters.shape, 2), np.nan)
        for output, uncertainty in enumerate(self.uncertainty_):
            rows = np.flatnonzero(self.model_.parameters[:, output])
            theta = self.model_.parameters[rows, output]
            bounds[rows, output] = uncertainty.intervals(theta, level)
        return bounds[:, 0] if bounds.shape[1] == 1 else bounds

    def summary(self, level=0.95):
        """Return the terms with parameters, intervals and error reduction ratios, largest ratio first.

        Parameters
        ----------
        level : float, default=0.95
            Coverage of the intervals.

        Returns
        -------
        pandas.DataFrame
            One row for each term of each output.
        """
        check_is_fitted(self)
        bounds = self.confidence_intervals(level).reshape(*self.model_.parameters.shape, 2)
        err = self.err_.reshape(self.model_.parameters.shape)
        rows = []
        for i, output in enumerate(self.model_.outputs):
            for t in np.flatnonzero(self.model_.parameters[:, i]):
                low, high = bounds[t, i]
                value = self.model_.parameters[t, i]
                rows.append((output, self.terms_[t], value, low, high, err[t, i]))
        columns = ["output", "term", "parameter", "low", "high", "err"]
        return pd.DataFrame(rows, columns=columns).sort_values(
            ["output", "err"], ascending=[True, False], ignore_index=True
        )

    def __sklearn_is_fitted__(self):
        return hasattr(self, "model_")

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        tags.target_tags.multi_output = True
        tags.regressor_tags.poor_score = True
        return tags


def farthest(model: NARXModel, y: np.ndarray) -> tuple[int, int] | None:
    """Return the first sample and output at which a run goes where nothing that was fitted ever was."""
    recorded = [model.recorded.get(name, NOWHERE) for name in model.outputs]
    low, _, high = np.transpose(recorded)
    span = np.where(high > low, high - low, np.abs(high))
    far = (np.abs(y - (low + high) / 2) > FAR * span) & (span > 0)
    if not far.any():
        return None
    k, i = (int(index[0]) for index in np.nonzero(far))
    return k, i


def own_run(model: NARXModel, X, y, sessions) -> FreeRun:
    """Simulate the record that a model was fitted on; where the run is lost, its result says so alone."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DivergenceWarning)
        return free_run(model, X, y, sessions=sessions)


def is_lost(model: NARXModel, X, y, sessions) -> bool:
    """Tell whether a model's free run of its own record leaves the finite range, or all that was fitted."""
    run = own_run(model, X, y, sessions)
    return run.stopped_at is not None or farthest(model, run.y) is not None

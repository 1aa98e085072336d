"""NARXRegressor: identification of polynomial NARX models as a scikit-learn estimator."""

import warnings

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted

from narx_sklearn._threads import single_threaded_blas
from narx_sklearn._validation import as_signals, check_indexes, check_inputs_given, check_same_length
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.identification.batches import Stream
from narx_sklearn.identification.choosing import compress_at_origins, estimate_again, select_best
from narx_sklearn.identification.dead import warn_of_dead
from narx_sklearn.identification.free_run.free_run_fit import Refined, reads_all_samples, refine
from narx_sklearn.identification.free_run.lost import warn_if_far, warn_if_lost
from narx_sklearn.identification.free_run.scoring import free_run_score
from narx_sklearn.identification.free_run.simulation_search import FreeRunData
from narx_sklearn.identification.free_run.sizes import size_by_free_run, warn_if_bound, warn_if_short
from narx_sklearn.identification.one_step.procedure import Problem, Selected, build_model
from narx_sklearn.identification.opening import open_data, open_inputs
from narx_sklearn.identification.posing import about, constraints_of, pose
from narx_sklearn.identification.records.record import Record
from narx_sklearn.identification.settings import (
    check_settings,
    check_settings_of_batches,
    refine_mode,
    wants_free_run_size,
)
from narx_sklearn.identification.structure.constraints import LinearConstraints
from narx_sklearn.identification.structure.hysteresis import check_continuum
from narx_sklearn.identification.two_values import without_repeated_powers
from narx_sklearn.identification.validation.at_rest import warn_if_drifting
from narx_sklearn.identification.validation.residuals import model_residuals
from narx_sklearn.identification.validation.told import (
    ScoresOf,
    error_reduction,
    parameter_intervals,
    scores_on_record,
    summary_table,
    uncertainty_of,
)
from narx_sklearn.model.simulation import free_run, predict_k_steps, predict_one_step
from narx_sklearn.model.times import step_of_rows

__all__ = ["NARXRegressor"]


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
        ``y`` (times, also as text, or numbers called ``time [s]``), if there is one.
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
            If a column of ``X`` or ``y`` holds times, also as text; those belong into the index.

        Warns
        -----
        NarxWarning
            If ``max_terms`` bound the size, or ``n_terms`` is more than the candidates that can be told
            apart; if ``refine="auto"`` is left out because a dask collection or files hold too many samples,
            or an index tells that rows are missing, uneven or shuffled, or of another period than
            ``sampling_period``; or if an array or table holds values that recorders write where nothing was
            measured (-9999, say), which are fitted as measured.
        ExcitationWarning
            If a signal is constant, or takes two values only, so that powers of it are no candidates; or if
            the record is so short that the terms cannot be told apart.
        DivergenceWarning
            If the free run of the model that is kept leaves the finite range on the record itself, or goes a
            thousand times as far as its outputs, and ``refine`` is not False.
        NarxWarning
            If the direction of an input counts in the model, and the output leaves the place where the input
            stops, while the record does not show that it does.

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
        for name in ("model_", "_stream"):
            self.__dict__.pop(name, None)

    def _fit(self, X, y, sessions):
        check_settings(self)
        record = open_data(self, X, y, sessions, reset=True)
        problem = without_repeated_powers(pose(self, record), record.moments, self.constraints)
        warn_of_dead(problem, record, stacklevel=3)
        constraints = constraints_of(self.constraints, problem)
        known = about(self, problem, record, record.moments)
        choices = compress_at_origins(self, problem, constraints, record)
        selected = select_best(self, problem, constraints, choices)
        if reads_all_samples(self, record):
            record = record.in_one_place()
            samples = FreeRunData(*record.everything())
            if wants_free_run_size(self):
                selected = size_by_free_run(self, problem, constraints, selected, samples)
            if self.estimator in ("els", "rls"):
                selected = estimate_again(self, problem, constraints, selected, samples)
        model = build_model(selected, problem, **known)
        refined = Refined(model)
        if record.in_memory:
            refined = refine(self, problem, constraints, selected, model, samples)
            if refine_mode(self.refine) != "never":
                warn_if_lost(self, refined.model, *samples)
            warn_if_drifting(self, refined.model, *samples)
        warn_if_short(self, selected, refined.model)
        warn_if_bound(self, selected, refined.model)
        scores_of = scores_on_record(record, selected[0].compressed.layout)
        simulated = None if refined.noise == "equation" else samples
        self._store(record, problem, constraints, selected, refined, scores_of, simulated)
        return self

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
        check_settings(self)
        check_settings_of_batches(self)
        before = getattr(self, "_stream", None)
        record = open_data(self, X, y, sessions, reset=before is None)
        problem = pose(self, record)
        warn_of_dead(problem, record)
        constraints = constraints_of(self.constraints, problem)
        if before is None:
            choices = compress_at_origins(self, problem, constraints, record)
            stream = Stream.begin(problem, choices, record)
        else:
            stream = before.add(problem, record, float(self.forgetting))
        selected = select_best(self, problem, constraints, [b.compressed for b in stream.batches])
        (taken,) = (b for b in stream.batches if b.compressed is selected[0].compressed)
        model = build_model(selected, problem, **about(self, problem, record, stream.moments))
        self._store(record, problem, constraints, selected, Refined(model), taken.scores)
        self._stream = stream
        return self

    def _store(
        self, record: Record, problem: Problem, constraints: list[LinearConstraints],
        selected: list[Selected], refined: Refined, scores_of: ScoresOf, simulated: FreeRunData | None = None,
    ) -> None:  # fmt: skip
        """Store a model and what is told of it; last what makes the estimator a fitted one."""
        model, first = refined.model, selected[0].compressed
        sigma, uncertainty = uncertainty_of(
            model, first.layout, constraints, problem.library, scores_of, simulated
        )
        single = len(selected) == 1
        err = error_reduction(model, selected)
        self.continuum_ = check_continuum(model, self.constraints)
        self.terms_ = model.library.names
        self.coef_ = model.parameters[:, 0].copy() if single else model.parameters.copy()
        self.err_ = err[:, 0] if single else err
        self.path_ = selected[0].path if single else [one.path for one in selected]
        self.candidates_ = first.library
        self.refinement_ = refined.fit
        self.noise_ = refined.noise
        self.sigma_, self.uncertainty_ = sigma, uncertainty
        self._y_ndim = record.y_ndim
        self.model_ = model

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
        ExcitationWarning
            If an output goes beyond the range that was fitted by more than half of it; says how far, for how
            many of the samples, and whether the inputs do so too.
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
            warn_if_far(self.model_, X, run.y)
        return self._shaped(run.y)

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

    def residuals(self, X, y, sessions=None):
        """Return what the model leaves over of measured outputs, for `residual_tests`.

        Measured outputs minus their predictions one step ahead; where ``noise_`` is ``"output"``, minus the
        free run, which begins where it fits best. Noise on the output is white there, while it colours the
        errors one step ahead of the right model too.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_inputs)
            Inputs.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Measured outputs.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample.

        Returns
        -------
        ndarray of shape (n_samples,) or (n_samples, n_outputs)
            Residuals, in the units of the outputs; NaN where a lagged value is not known.
        """
        check_indexes(X, y)
        X, y = self._inputs(X), as_signals(y, "y")
        check_same_length(X=X, y=y, sessions=sessions)
        return self._shaped(model_residuals(self.model_, X, y, self.noise_, sessions))

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
        return open_inputs(self, X)

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
        bounds = parameter_intervals(self.model_, self.uncertainty_, level)
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
        bounds = parameter_intervals(self.model_, self.uncertainty_, level)
        return summary_table(self.model_, bounds, self.err_.reshape(self.model_.parameters.shape))

    def __sklearn_is_fitted__(self):
        return hasattr(self, "model_")

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        tags.target_tags.multi_output = True
        tags.regressor_tags.poor_score = True
        return tags

"""DiscrepancyRegressor: the diagnosis as a scikit-learn estimator."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from numbers import Integral, Real

import numpy as np
import pandas as pd
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted

from narx_sklearn._progress import progress
from narx_sklearn._threads import single_threaded_blas
from narx_sklearn._validation import column_labels, finite_rows, finite_slices, session_slices
from narx_sklearn.discrepancy.as_narx import identify_narx
from narx_sklearn.discrepancy.columns import chosen_columns
from narx_sklearn.discrepancy.conclusion import Conclusion, conclude
from narx_sklearn.discrepancy.designs import read_column, read_limits
from narx_sklearn.discrepancy.experiment import design_experiment, middle_of
from narx_sklearn.discrepancy.extrapolate import extrapolate
from narx_sklearn.discrepancy.findings import make_findings
from narx_sklearn.discrepancy.location import locate, with_invariances
from narx_sklearn.discrepancy.records.checks import check_record
from narx_sklearn.discrepancy.records.dead import warn_of_dead, without_dead_values, without_known_values
from narx_sklearn.discrepancy.records.record import (
    check_length,
    label_findings,
    pieces_of,
    read_inputs,
    read_outputs,
    read_record,
    warn_of_step,
)
from narx_sklearn.discrepancy.records.spikes import find_spikes, spikes_as_findings
from narx_sklearn.discrepancy.records.steps import measured_steps, steps_as_findings
from narx_sklearn.discrepancy.report_text import report_text
from narx_sklearn.discrepancy.rivals import as_simulators, find_rivals, nested_pairs
from narx_sklearn.discrepancy.search.inference import confidence_in_nothing, intervals
from narx_sklearn.discrepancy.settings import STAGES, Settings, read_effects
from narx_sklearn.discrepancy.simulators.simulator import Simulator, Windows
from narx_sklearn.discrepancy.stages.beginning import begin
from narx_sklearn.discrepancy.stages.diagnosis import Diagnosis
from narx_sklearn.discrepancy.verify import Stretch, free_run, initial_state, within_reach
from narx_sklearn.metrics import DIVERGED_SCORE, r2_score_of
from narx_sklearn.model import NARXModel
from narx_sklearn.physics.effects import Effect


class DiscrepancyRegressor(RegressorMixin, BaseEstimator):
    """Diagnose a simulation against recordings: where it is wrong, which physics it lacks, and the proof.

    The simulator's own parameters and the initial states are always fitted first, so that a wrong number is
    never sold as missing physics. A test that holds whatever the colour of the noise then says whether
    anything is missing; effects of the catalogue at every port are ordered, refitted and compared; what
    cannot be told apart is reported as such, with the experiment that would tell. Where a stretch of the
    record disagrees more than the rest, effects that act there only are tried too. Where none is found, what
    is left over must depend on nothing, come in no bursts, hold no line and make no parameter pulsate, as
    noise does; and nothing must act inside that follows no signal, as a load that wanders.

    Parameters
    ----------
    simulator : Simulator
        The simulation as it stands: an :class:`ODESimulator`, or another simulator of this package.
    effects : "catalogue" or list of (str or Effect), default="catalogue"
        What may be missing, by code, or effects of your own.
    exclude : list of str, default=()
        Codes left out.
    alpha : float, default=0.005
        Chance of a false alarm allowed where nothing is missing; the searches for what acts for a while, for
        what has no name and for what follows no signal have half of it each, a second look a quarter.
    level : float, default=0.9
        Confidence level of all intervals.
    max_effects : int, default=2
        Most effects looked for together; what a pair leaves is better called unknown.
    n_leaders : int, default=16
        Hypotheses refitted at each depth.
    window : int, optional
        Samples in a fitting window. When not given, twenty time constants of the simulator; a fortieth of
        the record and then a quarter of it where an integrator does not forget (all of it in a second look);
        four e-foldings of an unstable mode.
    test_fraction : float, default=0.2
        Last share of each session kept out of every decision, for the verification (but whether what began
        and stayed still acts there). Where nothing is missing before it, or what was found leaves more of it
        than elsewhere, a second look keeps out the first share instead: a limit may be met at the end only.
    random_state : int, default=0
        Seed of the sign flips and of the bootstrap.
    n_jobs : int, optional
        Threads over hypotheses.
    verbose : int or callable, default=0
        1 shows a progress bar with the stages on standard error, or a line for each stage where that is no
        terminal. A function is called with the name of each stage as it begins.

    Attributes
    ----------
    verdict_ : {"consistent", "refit", "explained", "ambiguous", "unknown"}
        What was concluded.
    findings_ : list of Finding
        Effects found missing, the strongest first. Where the verdict is *unknown*, names and laws come only
        nearest to what is missing, and have a ``stands`` of False; what has no form stands as it is.
    scores_ : DataFrame
        Held-out free run of the nominal, refitted and augmented simulation: ``nrmse`` (over the spread of
        what was held out), ``rmse``, ``removed`` (share of the refitted error taken away), with intervals.
        The augmented one has all that was found; what is held against it there the corrected one leaves out.
        A row "by session" is there where nothing is missing but that parameters are not the same in all.
        Empty where the record is too short for such a run.
    held_out_ : DataFrame
        Samples that the scores are of, a row a stretch: ``start``, ``scored_from`` (samples before it settle
        the initial state), ``stop``. Short ones where the machine is unstable: a free run loses it.
    extrapolation_ : DataFrame
        The same for louder motion, fitted to quiet motion alone: quiet are the half of the windows that go
        less far, loud those that go a quarter farther than all of these. ``quiet`` and ``loud`` are the
        farthest that an output goes from its mean in either, in its spreads. Empty where nothing goes that
        far, where quiet motion tells nothing of what was found, and where nobody can foresee its course.
    parameters_ : DataFrame
        The simulator's parameters: nominal, refitted, augmented, with intervals and units. Those that are not
        ``told_alone`` may all be off with nothing to notice, beyond their intervals: these data tell only
        what they do together with others.
    simulator_ : Simulator
        The corrected simulation, a simulator like any other: refitted, with what was found, unless that makes
        held-out windows or whole runs surely worse or nobody can foresee its course. It is for other records
        too: where within its play an effect stood when this record began, or how far a drive was behind its
        first command, is the finding's, and begins in the middle, or at the command, unless several sessions
        began alike; a sensor that stuck once does not stick again.
    refitted_simulator_ : Simulator
        The simulation with refitted parameters, nothing added.
    location_ : Location
        Where the mismatch is: ``ports``, ``segments``, ``regions``, ``bands``, each a DataFrame.
    p_value_ : float
        Of the test that nothing is missing.
    confidence_ : float
        Weight of the first finding among all that were tried in its place, told so that of many findings as
        sure as many are right; without any, the least probability that nothing is missing, had the odds been
        even before the test.
    noise_ : dict
        Estimated noise of each output, with its unit: ``sigma``, standard deviation of what is new of it in
        each sample; ``deviation``, of all of it, infinite where it drifts without bound; ``autoregression``
        and ``moving_average``, its colour.
    data_findings_ : list of DataFinding
        Mistakes in the record itself that should be mended first, and what else it tells that is no physics:
        bounds that are too narrow, parameters that are not the same in all sessions.
    report_ : str
        All of it in words.
    conclusion_ : Conclusion
        What all this was made from, as the modules of this package know it: the diagnosis with all that was
        tried, and what held-out samples said.
    n_features_in_ : int
        Number of inputs.
    feature_names_in_ : ndarray of str
        Labels of their columns, where ``X`` has such.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn import DiscrepancyRegressor, ODESimulator
    >>> def stage(x, u, p):
    ...     return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0]
    >>> def true_stage(x, u, p):
    ...     return x[1], p[0] * u[0] - p[1] * x[1] - p[2] * x[0] - 15.0 * x[0] ** 3
    >>> about = dict(dt=0.05, states=["position [m]", "velocity [m/s]"], inputs=["drive [V]"])
    >>> nominal = {"gain [m/s^2/V]": 1.0, "damping [1/s]": 0.8, "stiffness [1/s^2]": 12.0}
    >>> rng = np.random.default_rng(0)
    >>> u = np.repeat(rng.normal(0, 3, 200), 10)
    >>> truth = {"gain [m/s^2/V]": 1.1, "damping [1/s]": 0.7, "stiffness [1/s^2]": 11.0}
    >>> y = ODESimulator(true_stage, parameters=truth, **about).simulate(u)[:, 0]
    >>> y += 0.005 * rng.normal(size=y.size)
    >>> sim = ODESimulator(stage, parameters=nominal, **about)
    >>> effects = ["cubic_stiffness", "coulomb_friction", "quadratic_drag"]
    >>> dx = DiscrepancyRegressor(sim, effects=effects).fit(u, y)
    >>> dx.verdict_, dx.findings_[0].effect
    ('explained', 'cubic_stiffness')
    """

    def __init__(
        self,
        simulator,
        *,
        effects="catalogue",
        exclude=(),
        alpha=0.005,
        level=0.9,
        max_effects=2,
        n_leaders=16,
        window=None,
        test_fraction=0.2,
        random_state=0,
        n_jobs=None,
        verbose=0,
    ):
        self.simulator = simulator
        self.effects = effects
        self.exclude = exclude
        self.alpha = alpha
        self.level = level
        self.max_effects = max_effects
        self.n_leaders = n_leaders
        self.window = window
        self.test_fraction = test_fraction
        self.random_state = random_state
        self.n_jobs = n_jobs
        self.verbose = verbose

    def fit(self, X, y, sessions=None):
        """Diagnose the simulator on a recording.

        Parameters
        ----------
        X : array-like or DataFrame of shape (n_samples, n_inputs)
            Recorded inputs, in the order of the simulator's, or a DataFrame with columns of their names, with
            or without units, among any others. A DataFrame with none of the names is taken in order.
        y : array-like, Series or DataFrame of shape (n_samples,) or (n_samples, n_outputs)
            Recorded outputs; NaN where a sample is missing. The columns of a DataFrame are found as those of
            ``X`` are.
        sessions : array-like of shape (n_samples,), optional
            One label a sample; each run of equal labels is a recording of its own.

        Returns
        -------
        self

        Raises
        ------
        ValueError, TypeError
            If a setting or the record does not fit; the message says which and what would. Labels count: a
            column whose unit is another than the simulator's, rows of ``X`` and ``y`` with different
            indexes, and times that go back are refused.
        """
        self._check_settings()
        with single_threaded_blas(), self._shown_stages() as tell:
            return self._fit(X, y, sessions, tell)

    def _fit(self, X, y, sessions, tell: Callable[[str], None]):
        simulator = self.simulator
        if not simulator.inputs:  # a trace that waits for the inputs that led to it
            simulator = simulator.identified(X, sessions=sessions)
        u, measured, of_dead = without_dead_values(simulator, *read_record(X, y, simulator))
        check_length(simulator, u, measured, sessions, self.test_fraction)
        _check_motion(simulator, measured)
        of_record = of_dead + label_findings(X, y, simulator, sessions)
        tell("check of the record")
        simulator = simulator.identified(u, sessions=sessions)
        check_length(simulator, u, measured, sessions, self.test_fraction)  # a twin's states are known now
        of_record += check_record(simulator, u, measured, sessions, self.n_jobs)
        steps = measured_steps(measured)
        of_record += steps_as_findings(steps, simulator.outputs)
        settings = self._settings(tell, rounded=bool(np.isfinite(steps).any()))
        spikes = _find_spikes(simulator, u, measured, sessions, settings)
        of_record += spikes_as_findings(spikes, simulator.outputs)
        measured = np.where(spikes, np.nan, measured)
        conclusion = conclude(simulator, u, measured, sessions, settings, of_record)
        self._store(conclusion, tell)
        self._one_output = np.ndim(y) == 1
        self._mean_input = np.nanmean(u, axis=0)
        self._middle_input = middle_of(u)
        self._store_columns(X)
        return self

    def predict(self, X, y_init=None, sessions=None):
        """Run the corrected simulation.

        An effect that was found to act for a while acts at the same times since each session began.

        Parameters
        ----------
        X : array-like or DataFrame of shape (n_samples, n_inputs)
            Inputs.
        y_init : array-like or DataFrame of shape (n_init,) or (n_init, n_outputs), optional
            First measured outputs of the first session, to which its initial state is fitted; columns as in
            `fit`. Without them a run starts from the simulator's ``x0``, all states zero by default.
        sessions : array-like of shape (n_samples,), optional
            One label a sample; every session starts anew.

        Returns
        -------
        ndarray of shape (n_samples,) or (n_samples, n_outputs)
            Simulated outputs; NaN from where a run left the finite range. NaN in ``X`` is a gap, and NaN
            here; after it a run begins anew.

        Raises
        ------
        ValueError
            If ``X`` or ``y_init`` does not fit the simulator, nothing of ``y_init`` is measured, or the
            columns of ``X`` are called neither as fitted nor as the simulator's inputs.

        Warns
        -----
        NarxWarning
            If the time index of ``X`` advances by another step than the simulator, or ``X`` or ``y_init`` has
            values that recorders write where nothing was measured, such as -9999; they are taken as missing.
        """
        check_is_fitted(self)
        u = without_known_values(self.simulator_.inputs, read_inputs(self._as_fitted(X), self.simulator_))
        warn_of_step(X, self.simulator_, sessions)
        windows = Windows.whole(finite_slices(session_slices(sessions, u.shape[0]), finite_rows(u)))
        x0 = np.tile(self.simulator_.x0, (windows.count, 1))
        if y_init is not None:
            first = read_outputs(y_init, self.simulator_, "y_init")
            first = without_known_values(self.simulator_.outputs, first)
            if not np.isfinite(first).any():
                raise ValueError(
                    f"y_init is NaN in all of its {len(first)} samples, so no initial state can be fitted to "
                    "it. Pass measured outputs, or leave it out for runs from rest."
                )
            if windows.count and windows.first[0] < len(first):
                piece = slice(int(windows.first[0]), int(min(len(first), windows.last[0])))
                n = piece.stop - piece.start
                x0[0] = initial_state(
                    self.simulator_, u[piece], first[piece], Stretch(slice(0, n), 0, n), x0[0]
                )
        y = self.simulator_.run(u, windows, x0).y
        return y[:, 0] if self._one_output else y

    def score(self, X, y, sessions=None):
        """Return R^2 of the corrected simulation's free run, the mean over the outputs.

        The first samples of each session (as many as fix the initial state) are not scored, and the spread is
        about the mean of each stretch. Where the machine is unstable, runs begin anew before they lose it. An
        output that does not move there scores 1 where it is met exactly, else 0; a run that leaves the finite
        range scores -1e6, which searches can rank. Values that stand for none, such as -9999, are taken as
        missing, as in `fit`, with a warning.
        """
        check_is_fitted(self)
        u, measured, of_dead = without_dead_values(
            self.simulator_, *read_record(self._as_fitted(X), y, self.simulator_)
        )
        warn_of_dead(of_dead)
        warn_of_step(X, self.simulator_, sessions)
        found = self.conclusion_
        n_init, guess = found.n_init, found.guesses["augmented"]
        errors, spread = 0.0, 0.0
        for piece, began in within_reach(pieces_of(u, sessions), n_init, found.diagnosis.followed_for):
            if piece.stop - piece.start <= n_init + 1:
                continue
            y_piece, stretch = measured[piece][n_init:], Stretch(piece, began, n_init)
            simulated = free_run(self.simulator_, u, measured, stretch, guess).y[n_init:]
            if np.isnan(simulated).any():
                return DIVERGED_SCORE
            errors = errors + np.nansum((y_piece - simulated) ** 2, axis=0)
            spread = spread + np.nansum((y_piece - np.nanmean(y_piece, axis=0)) ** 2, axis=0)
        if np.ndim(errors) == 0:
            raise ValueError(f"No session is longer than the {n_init} samples that fix the initial state.")
        return r2_score_of(np.asarray(errors), np.asarray(spread))

    def next_experiment(self, amplitude, n_samples, between=None, *, offset=None, rate=None, column=0):
        """Design the input that best separates what these data could not tell apart.

        What acted for a while is taken to act throughout the experiment. An explanation whose fit came down
        to another's, its special case, is taken as far from it as these data allow.

        Parameters
        ----------
        amplitude : float
            Largest departure of the input from ``offset``, in its unit.
        n_samples : int
            Length of the experiment.
        between : list of (str or Effect), optional
            Effects to separate, by code: any of the catalogue, or of this estimator's own. One that was not
            fitted beside what else was found is fitted now, at its best port; one that these data do not show
            is taken as large as they allow. By default the first finding and its look-alikes, or, when it has
            none, the best explanations.
        offset : float, optional
            Middle of the input, at which it begins; by default that of the range in which it is nine tenths
            of the record, zero where that is within a tenth of the range's half.
        rate : float, optional
            Largest change of the input in one second.
        column : int, default=0
            Which input is moved; the others rest at their mean in the record.

        Returns
        -------
        Experiment
            The input ``u``, what it is in words, and how far it separates the worst pair.

        Raises
        ------
        TypeError
            If a limit is no number, ``n_samples`` or ``column`` no integer, or ``between`` no list.
        ValueError
            If a limit is not positive and finite, the experiment is too short or there is no such input; if
            an effect of ``between`` is not known or shows nowhere in these data, or fewer than two
            explanations are at hand; if no input alone keeps the simulation in range.
        """
        check_is_fitted(self)
        diagnosis = self.conclusion_.diagnosis
        simulator = diagnosis.problem.simulator
        if offset is None:
            offset = self._middle_input[read_column(simulator, column)]
        limits = read_limits(simulator, amplitude, n_samples, offset=offset, rate=rate, column=column)
        rivals = find_rivals(diagnosis, between, own=self._own_effects(), n_jobs=self.n_jobs)
        nested = nested_pairs(rivals)
        return design_experiment(
            as_simulators(rivals, nested, diagnosis.problem),
            **limits._asdict(),
            noise=diagnosis.problem.noise,
            held=self._mean_input.copy(),
            nested=nested,
            random_state=self.random_state,
            n_jobs=self.n_jobs,
        )

    def to_narx(self, X, **settings):
        """Identify a NARX model of the corrected simulation, ready for a compensator.

        What acts for a while only is left out.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_inputs)
            Inputs that reach what the model is to know.
        **settings
            Parameters of :class:`NARXRegressor`. By default two lags of output and input or as many as there
            are states, the present input where the output shows it at once, and the regressors of the
            effects found.

        Returns
        -------
        NARXModel

        Raises
        ------
        ValueError
            If the corrected simulation leaves the finite range on these inputs.
        """
        check_is_fitted(self)
        return identify_narx(self.simulator_, read_inputs(X, self.simulator_), **settings)

    # -- parts of fit ------------------------------------------------------------------------------------

    def _settings(self, tell: Callable[[str], None], *, rounded: bool) -> Settings:
        """Return what is asked for; rounded values show in themselves, and need not be looked for."""
        of_noise = ("quantisation",) if rounded else ()
        return Settings(
            effects=tuple(e for e in read_effects(self.effects, self.exclude) if e.code not in of_noise),
            alpha=float(self.alpha),
            max_effects=int(self.max_effects),
            n_leaders=int(self.n_leaders),
            window=self.window,
            random_state=self.random_state,
            n_jobs=self.n_jobs,
            tell=tell,
            level=float(self.level),
            test_fraction=float(self.test_fraction),
            of_noise=of_noise,
        )

    def _check_settings(self) -> None:
        if not isinstance(self.simulator, Simulator):
            raise TypeError(
                "simulator must be a Simulator such as ODESimulator(...), got "
                f"{type(self.simulator).__name__}. {_way_in(self.simulator)}"
            )
        for name in ("alpha", "level", "test_fraction"):
            value = getattr(self, name)
            if not isinstance(value, Real) or isinstance(value, bool):
                raise TypeError(f"{name} must be a number between 0 and 1, got {value!r}.")
        for name in ("alpha", "level"):
            value = getattr(self, name)
            if not 0 < value < 1:
                raise ValueError(f"{name} is a probability between 0 and 1, got {value!r}.")
        if not 0 <= self.test_fraction < 0.9:
            raise ValueError(f"test_fraction must lie in [0, 0.9), got {self.test_fraction!r}.")
        for name, least in (("max_effects", 1), ("n_leaders", 1), ("verbose", 0)):
            value = getattr(self, name)
            if name == "verbose" and callable(value):
                continue
            if not isinstance(value, Integral) or (isinstance(value, bool) and name != "verbose"):
                raise TypeError(f"{name} must be an integer of at least {least}, got {value!r}.")
            if value < least:
                raise ValueError(f"{name} must be an integer of at least {least}, got {value!r}.")
        n_jobs = self.n_jobs
        if n_jobs is not None and (not isinstance(n_jobs, Integral) or isinstance(n_jobs, bool)):
            raise TypeError(f"n_jobs counts threads, -1 for all processors, or is None; got {n_jobs!r}.")
        if n_jobs == 0:
            raise ValueError("n_jobs counts threads and cannot be 0; pass 1, -1 for all processors, or None.")
        if self.window is not None and (not isinstance(self.window, Integral) or self.window < 4):
            raise ValueError(
                f"window counts samples and must be an integer of at least 4, got {self.window!r}."
            )

    def _own_effects(self) -> tuple[Effect, ...]:
        """Return the effects of the list that was given, which need not be in the catalogue."""
        return () if isinstance(self.effects, str) else read_effects(self.effects)

    def _store(self, conclusion: Conclusion, tell: Callable[[str], None]) -> None:
        """Store a conclusion, and what it says of the machine."""
        diagnosis = conclusion.diagnosis
        simulator = diagnosis.problem.simulator
        self.conclusion_ = conclusion
        self.verdict_ = conclusion.verdict
        self.data_findings_ = list(conclusion.of_record)
        self.p_value_ = diagnosis.p_missing
        self.parameters_ = self._parameter_table(diagnosis)
        self.scores_ = conclusion.scores
        self.held_out_ = conclusion.held_out
        self.refitted_simulator_ = conclusion.refitted
        self.simulator_ = conclusion.for_other_records
        tell("location")
        self.location_ = locate(diagnosis, self.random_state, self.n_jobs)
        if conclusion.verdict == "unknown" and diagnosis.unforeseen is None:
            self.location_ = with_invariances(self.location_, diagnosis)
        self.findings_ = make_findings(diagnosis, self.verdict_, self.level, simulator, self.location_)
        nothing = confidence_in_nothing(diagnosis.p_missing)
        self.confidence_ = self.findings_[0].confidence if self.findings_ else nothing
        noise = diagnosis.noise
        self.noise_ = {
            str(signal): {
                "sigma": float(sigma),
                "deviation": float(noise.deviation(i)),
                "autoregression": a.tolist(),
                "moving_average": float(b),
            }
            for i, (signal, sigma) in enumerate(zip(simulator.outputs, noise.sigma, strict=True))
            for a, b in [noise.colour(i)]
        }
        corrected = (diagnosis.best.fit if conclusion.corrected.effects else diagnosis.refitted).model
        self._extrapolation = extrapolate(diagnosis, corrected, self.level, self.random_state, self.n_jobs)
        self.extrapolation_ = self._extrapolation.scores
        self.report_ = report_text(self)

    def _store_columns(self, X) -> None:
        """Store the number of inputs, and the names of their columns where X has them."""
        inputs = self.simulator_.inputs
        self.n_features_in_ = len(inputs)
        labels = column_labels(chosen_columns(X, inputs, "X", "input"))
        if labels is not None and all(isinstance(label, str) for label in labels):
            self.feature_names_in_ = np.array(labels, dtype=object)
        elif hasattr(self, "feature_names_in_"):
            del self.feature_names_in_

    def _as_fitted(self, X):
        """Return the columns of X that were fitted; refuse a table that has other signals in their place."""
        fitted, labels = getattr(self, "feature_names_in_", None), column_labels(X)
        if fitted is None or labels is None or not all(isinstance(label, str) for label in labels):
            return X
        if list(labels) == list(fitted):
            return X
        if hasattr(X, "columns"):
            if set(fitted) <= set(labels):
                return X[list(fitted)]
            if chosen_columns(X, self.simulator_.inputs, "X", "input") is not X:
                return X  # called as the simulator's own
        raise ValueError(
            f"X has the columns {list(labels)}; those that were fitted are called {list(fitted)}. Pass "
            "columns of these names; where only the names are others, pass an array in this order."
        )

    def _parameter_table(self, diagnosis: Diagnosis) -> pd.DataFrame:
        simulator = diagnosis.problem.simulator
        n = len(simulator.parameters)
        refitted, final = diagnosis.refitted, diagnosis.best.fit
        sure = diagnosis.intervals(self.level)[:n]
        before = intervals(diagnosis.problem, refitted, self.level)[:n]
        together = [index for group in diagnosis.told_together for index in group]
        return pd.DataFrame(
            {
                "unit": [p.unit for p in simulator.parameters],
                "nominal": simulator.nominal,
                "refitted": refitted.model.p,
                "refitted_low": before[:, 0],
                "refitted_high": before[:, 1],
                "augmented": final.model.p,
                "augmented_low": sure[:, 0],
                "augmented_high": sure[:, 1],
                "told_alone": ~np.isin(np.arange(n), together),
            },
            index=pd.Index([p.name for p in simulator.parameters], name="parameter"),
        )

    @contextmanager
    def _shown_stages(self) -> Iterator[Callable[[str], None]]:
        """Yield what is to be told of each stage, by which it is shown where that was asked for."""
        if callable(self.verbose):
            yield self.verbose
        elif not self.verbose:
            yield lambda stage: None
        else:
            with progress(STAGES, quiet=False, lines="[narx_sklearn] ") as show:
                yield show


def _way_in(given) -> str:
    """Return how what was given in a simulator's place becomes one."""
    if isinstance(given, NARXModel):
        return "A NARX model goes into NARXSimulator(model, dt=...)."
    if isinstance(given, BaseEstimator):
        return "The model of a fitted estimator goes into NARXSimulator(estimator.model_, dt=...)."
    if hasattr(given, "__array__"):
        return "A simulated output goes into TraceSimulator(y_sim, dt=...)."
    return (
        "A plain function f(x, u, p) goes into ODESimulator(f, dt=..., parameters=..., ...), a program "
        "simulate(u, parameters) into CallableSimulator."
    )


def _find_spikes(simulator: Simulator, u, y, sessions, settings: Settings) -> np.ndarray:
    """Tell which samples, (n_samples, n_outputs), are no measurements."""
    pieces = pieces_of(u, sessions)

    def left_by_refit() -> tuple[np.ndarray, list[slice]]:
        problem, refitted, *_ = begin(simulator, u, y, pieces, settings)
        windows = list(map(slice, problem.windows.first.tolist(), problem.windows.last.tolist()))
        return y - problem.run(refitted.model).y, windows

    return find_spikes(y, left_by_refit, u, [piece for piece, _ in pieces])


def _check_motion(simulator: Simulator, y: np.ndarray) -> None:
    """Refuse outputs that say nothing."""
    largest, smallest = np.nanmax(y, axis=0, initial=-np.inf), np.nanmin(y, axis=0, initial=np.inf)
    still = np.flatnonzero(~(largest > smallest))
    if still.size == y.shape[1]:
        raise ValueError(
            "No output of y moves: what is constant, or missing throughout, cannot be compared with a "
            "simulation. Pass a record in which the machine moves."
        )
    for j in still:
        what = f"is {largest[j]:.6g} in all samples" if np.isfinite(largest[j]) else "is never measured"
        raise ValueError(
            f"Output {simulator.outputs[j]} {what}: a channel that is dead cannot be compared with a "
            "simulation. Leave it out of y, and of the simulator's outputs."
        )

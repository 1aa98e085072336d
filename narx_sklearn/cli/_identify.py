"""``narx-sklearn identify``."""

import json
import warnings

import numpy as np
import pandas as pd

from narx_sklearn._progress import progress
from narx_sklearn._validation import signal_names
from narx_sklearn.analysis import residual_tests
from narx_sklearn.cli._columns import Recording, last_part, read_recordings, without_dead_values
from narx_sklearn.cli._errors import DataError, UsageError
from narx_sklearn.cli._files import check_writable, write_text
from narx_sklearn.cli._output import c_prefix, say, tell_notes, write_json
from narx_sklearn.compensation import RootCompensator, UnreachableWarning, model_c_source
from narx_sklearn.compensation._defaults import RESTING_LAGS
from narx_sklearn.compensation.rehearsed import warn_if_worse
from narx_sklearn.identification import NARXRegressor, NARXRegressorCV
from narx_sklearn.metrics import nrmse, rmse
from narx_sklearn.model import Difference, DifferenceSign, free_run, predict_one_step

STAGES = {"identification": 0, "free run": 95, "residual tests": 96}  # per cent of the time, as measured
FEWEST = 10  # samples from which a model is identified
RESTING = ("hysteresis", "rate_independent")  # structures of models that stay where they are at rest
CALLED_HERE = {
    RootCompensator.__name__: "`compensate --method roots`",  # with no such option of its own
    "output_lags": "--output-lags",
    "input_lags": "--input-lags",
    "degree=": "--degree=",
    "n_terms": "--terms",
}
EXACT = 1e-10  # residual over the output's spread, below which there is nothing to test


def run(options) -> None:
    """Read, identify, judge, tell."""
    targets = {"--save": options.save, "--c": options.c, "--json": options.json}
    for target in targets.values():
        check_writable(target)
    streamed = [option for option, target in targets.items() if target == "-"]
    if len(streamed) > 1:
        raise UsageError(f"{' and '.join(streamed[:2])} cannot both go to standard output.")
    if not 0 <= options.test_fraction < 0.9:
        raise UsageError(f"--test-fraction must lie in [0, 0.9), got {options.test_fraction:g}.")
    recording = without_dead_values(read_recordings(options.records, options))
    tell_notes(recording.notes, options.quiet)
    held_out = last_part(recording.sessions, options.test_fraction)
    if np.sum(~held_out) < FEWEST:
        raise DataError(
            f"The record has {held_out.size} samples, {np.sum(~held_out)} of them to identify a model from; "
            f"at least {FEWEST} are wanted. Pass a longer record, or a smaller --test-fraction."
        )
    with progress(STAGES, quiet=options.quiet) as begin:
        begin("identification")
        narx = identify(recording, ~held_out, options)
        begin("free run")
        metrics = _metrics(narx, recording, held_out)
        begin("residual tests")
        tests = _tests(narx, recording, ~held_out)
    beside = bool(streamed)
    say(
        f"{narx.model_.to_text()}\n\n{narx.summary().to_string(index=False, float_format='%.5g')}\n",
        beside=beside,
    )
    for name, value in metrics.items():
        say(f"{name.replace('_', ' ')}: {value:.5g}", beside=beside)
    if worse := worse_than_mean(metrics):
        say(worse, beside=beside)
    say(f"\n{tests}", beside=beside)
    if options.save:
        write_text(options.save, json.dumps(narx.model_.to_dict(), indent=2) + "\n")
    if options.c:
        write_text(options.c, model_c_source(narx.model_, c_prefix(options.c, "model")))
    if options.json:
        write_json(
            options.json, {"model": narx.model_.to_dict(), "metrics": metrics, "residual_tests": tests}
        )


def identify(recording: Recording, chosen: np.ndarray, options) -> NARXRegressor:
    """Return a regressor fitted to the chosen samples, of lags as asked or chosen here."""
    X, sessions = recording.u[chosen], recording.sessions[chosen]
    outputs = recording.y[chosen]
    y = outputs.iloc[:, 0] if outputs.shape[1] == 1 else outputs
    common = {"structure": options.structure, "sampling_period": recording.dt}
    asked = (options.output_lags, options.input_lags, options.degree)
    usual = (2, 2, 2)
    if options.structure in RESTING:
        common |= _resting(X)
        usual = (2, 2, 3)  # of less than third degree a loop has no curved branches
        if asked[:2] == (None, None) and X.shape[1] == outputs.shape[1] == 1:
            common |= {"delay": options.delay, "n_terms": options.terms, "degree": options.degree or usual[2]}
            return _with_law(X, outputs.iloc[:, 0], sessions, common)
    elif all(value is None for value in asked) and options.terms is None:
        search = NARXRegressorCV(
            delay=(options.delay,), cv=_folds(sessions), rule="one_standard_error", **common
        )
        return search.fit(X, y, sessions=sessions).best_estimator_
    output_lags, input_lags, degree = (u if v is None else v for v, u in zip(asked, usual, strict=True))
    narx = NARXRegressor(
        output_lags, input_lags, phi_lags=input_lags, delay=options.delay, degree=degree,
        n_terms=options.terms, **common,
    )  # fmt: skip
    return narx.fit(X, y, sessions=sessions)


def _with_law(X: pd.DataFrame, y: pd.Series, sessions, common: dict) -> NARXRegressor:
    """Return the regressor that predicts best of those whose model gives a law that can be followed.

    Models that rest anywhere are there to be compensated, and the lags decide whether that can be done.
    """
    regressors = [NARXRegressor(*lags, phi_lags=lags[1], **common) for lags in RESTING_LAGS]
    compensator = RootCompensator(regressors)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UnreachableWarning)  # of the law, which is told of here
            compensator.fit(X, y, sessions=sessions)
    except ValueError:  # none of them has a law
        return regressors[-1].fit(X, y, sessions=sessions)
    warn_if_worse(
        compensator.rehearsal_,
        "Take --structure rate_independent or other lags, or `compensate --record`, which tries several "
        "models.",
        before="This model is not worth compensating by. ",
    )
    return compensator.regressor_


def _resting(X: pd.DataFrame) -> dict:
    """Return what lets a model rest anywhere: differences of the inputs, their signs, and Lemma 4.1."""
    phi = [kind(name) for name in signal_names(list(X), "u") for kind in (Difference, DifferenceSign)]
    return {"phi": phi, "constraints": "continuum", "fit_intercept": False, "origin": "zero"}


def _folds(sessions) -> int:
    """Return the number of folds: fewer on a record too short for five."""
    return 5 if sessions.size >= 300 else 2


def _metrics(narx, recording: Recording, held_out: np.ndarray) -> dict[str, float]:
    """Return errors on the held-out part, or on all where nothing was held out.

    Judged are the samples whose lagged values are all known, so that no initial condition counts as a hit.
    """
    judged = held_out if held_out.any() else np.ones(held_out.size, dtype=bool)
    where = "held_out" if held_out.any() else "fitted"
    X, y = recording.u[judged], recording.y[judged].to_numpy()
    sessions = recording.sessions[judged]
    simulated = free_run(narx.model_, X, y_init=y, sessions=sessions).y
    predicted = predict_one_step(narx.model_, X, y, sessions=sessions)
    known = np.isfinite(predicted).all(axis=1) & np.isfinite(y).all(axis=1)
    if not known.any():
        raise DataError(
            f"The {where.replace('_', '-')} part has no sample whose {narx.model_.max_lag} predecessors are "
            "all known. Pass a longer record, or another --test-fraction."
        )
    if np.ptp(y[known], axis=0).min() == 0:
        raise DataError(
            f"An output stands still all through the {where.replace('_', '-')} part, so no error is relative "
            "to its motion. Pass another --test-fraction."
        )
    y, simulated, predicted = y[known], simulated[known], predicted[known]
    simulated = np.nan_to_num(simulated, nan=np.inf)  # where the run has left the finite range
    return {
        f"{where}_free_run_rmse": float(rmse(y, simulated)),
        f"{where}_free_run_nrmse": float(nrmse(y, simulated)),
        f"{where}_one_step_nrmse": float(nrmse(y, predicted)),
    }


def worse_than_mean(metrics: dict[str, float]) -> str:
    """Return that a free run misses more than a constant would; empty where it does not.

    Examples
    --------
    >>> from narx_sklearn.cli._identify import worse_than_mean
    >>> worse_than_mean({"held_out_free_run_nrmse": 1.4})
    "Run freely, the model predicts the held-out part worse than that part's mean does."
    >>> worse_than_mean({"fitted_free_run_nrmse": 0.2})
    ''
    """
    for where in ("held_out", "fitted"):
        if metrics.get(f"{where}_free_run_nrmse", 0.0) > 1.0:
            part = where.replace("_", "-")
            return f"Run freely, the model predicts the {part} part worse than that part's mean does."
    return ""


def _tests(narx, recording: Recording, chosen: np.ndarray) -> str:
    """Return what the residual tests of each output say about the fitted part."""
    X, y, sessions = recording.u[chosen], recording.y[chosen].to_numpy(), recording.sessions[chosen]
    residuals = narx.residuals(X, y, sessions=sessions).reshape(y.shape)
    told = []
    for label, residual, output in zip(recording.y, residuals.T, y.T, strict=True):
        said = "The model leaves nothing over: its residuals are zero to rounding."
        if np.nanstd(residual) > EXACT * np.nanstd(output):
            said = _tested(residual, X, output, sessions)
        told.append(f"{label}: {said}" if y.shape[1] > 1 else said)
    return "\n".join(told)


def _tested(residual, X, output, sessions) -> str:
    try:
        return residual_tests(residual, X, output, sessions=sessions, n_resamples=199).verdict
    except ValueError as error:  # a record that is short can give a model all the same
        return f"The residuals could not be tested. {error}"

"""``narx-sklearn compensate``."""

import warnings

import numpy as np

from narx_sklearn._validation import split_unit
from narx_sklearn.cli._columns import asked_columns, read_recording
from narx_sklearn.cli._errors import DataError, UsageError
from narx_sklearn.cli._files import check_writable, write_text
from narx_sklearn.cli._output import c_prefix, tell_notes, write_columns
from narx_sklearn.cli._sampling import NONE, find_column, sample_evenly
from narx_sklearn.cli._tables import read_table
from narx_sklearn.compensation import (
    InverseCompensator,
    IsolatedCompensator,
    RootCompensator,
    UnreachableWarning,
)
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.model import NARXModel
from narx_sklearn.model.times import same_period

METHODS = {"roots": RootCompensator, "isolated": IsolatedCompensator, "inverse": InverseCompensator}
# what the package calls by its names in Python
CALLED_HERE = {kind.__name__: f"--method {method}" for method, kind in METHODS.items()}
REFERENCES = frozenset({"r", "ref", "reference", "setpoint", "target"})


def run(options) -> None:
    """Read the reference, take or identify the model, run the law, write the input."""
    check_writable(options.output)
    check_writable(options.c)
    if options.output == options.c == "-":
        raise UsageError("The input and --c cannot both go to standard output: name a file with --output.")
    if (options.model is None) == (options.record is None):
        raise UsageError("Give either --model, as `identify --save` wrote it, or --record, to identify one.")
    if options.reference == options.record == "-":
        raise UsageError("Reference and record cannot both come from standard input.")
    for option in ("u", "y", "session"):
        if options.record is None and getattr(options, option) is not None:
            raise UsageError(f"--{option} names a column of --record, and there is none.")
    if options.model is not None and options.method == "inverse":
        raise UsageError(
            "--method inverse identifies a model of its own, from output back to input: pass --record. "
            "The model that `identify --save` wrote serves the methods roots and isolated."
        )
    if options.limits is not None and not options.limits[0] < options.limits[1]:
        raise UsageError(
            f"--limits wants the least before the most, got {options.limits[0]:g} {options.limits[1]:g}."
        )
    limits = None if options.limits is None else tuple(options.limits)
    compensator = METHODS[options.method](limits=limits, rate_limit=options.rate_limit)
    if options.model is not None:
        model = _load_model(options.model)
        compensator.set_params(model=model).fit()
        name, unit = model.inputs[0], model.units.get(model.inputs[0])
        label = f"{name} [{unit}]" if unit else name
        dt, reach = model.sampling_period, model.recorded.get(model.outputs[0])
    else:
        recording = read_recording(options.record, options)
        tell_notes(recording.notes, options.quiet)
        if recording.y.shape[1] != 1:
            raise UsageError(f"A compensator follows one output; --y names {recording.y.shape[1]}.")
        compensator.fit(recording.u, recording.y.iloc[:, 0], recording.sessions)
        label, dt, y = recording.u.columns[0], recording.dt, recording.y.iloc[:, 0]
        reach = y.min(), y.mean(), y.max()
    columns, reference, notes = _read_reference(options, compensator.law_.others, dt)
    done = compensator.compensate(reference, options.start)
    if options.start is None and compensator.law_.keeps_rest:
        known = options.record is not None or compensator.model_.inputs[0] in compensator.model_.recorded
        told = _tell_start(reference.iloc[0, 0], float(done.m[0]), reach if known else None)
        notes += told if options.record is None else []
    counts = done.counts
    if counts.no_solution == counts.samples:
        raise DataError(
            "No admissible input solves the law at any sample, so none is written. Does the reference lie in "
            "the range of the recorded output, and in its unit? Else identify with fewer terms, or widen "
            "--limits."
        )
    notes += [f"The law:\n{compensator.law_.to_text()}"]
    if compensator.rehearsal_ is not None and compensator.rehearsal_.trials:
        notes += [str(compensator.rehearsal_)]
    _warn_of_input(counts, compensator, reference)
    _warn_if_lost(compensator, reference, options.start)
    tell_notes(notes, options.quiet)
    if options.c:
        write_text(options.c, compensator.explain("c", c_prefix(options.c, "compensator")))
    write_columns(options.output, {**columns, label: done.m})


def _warn_of_input(counts, compensator, reference) -> None:
    """Warn of samples at which the law could not have its way, and of a reference beyond the record."""
    told = [
        f"at {count} of {counts.samples} samples {what}"
        for what, count in (
            ("no admissible input solved the law, so it was held", counts.no_solution),
            ("the input was cut at a limit", counts.at_limit),
            ("its change was cut", counts.at_rate_limit),
        )
        if count
    ]
    words = [f"{told[0].capitalize()}{''.join(f', {part}' for part in told[1:])}."] if told else []
    words += [beyond] if (beyond := compensator.beyond_record(reference)) else []
    if words:
        warnings.warn(" ".join(words), UnreachableWarning, stacklevel=2)


def _warn_if_lost(compensator, reference, start: float | None) -> None:
    """Warn where not even a model follows the reference, or follows a straight line of it better."""
    trial = compensator.rehearse(reference, start)
    words = "" if trial is None else compensator.rehearsal_.said_of(trial)
    if words and not trial.is_bound:
        words += (
            " Identify with other lags, fewer terms or another --structure, or pass --record, by which a "
            "model is chosen whose law serves; or take another --method."
        )
    if words:
        warnings.warn(words, UnreachableWarning, stacklevel=2)


def _tell_start(r: float, first: float, recorded) -> list[str]:
    """Return a note on the first input of a law that can rest anywhere; warn where no record tells of it.

    ``recorded`` is least, mean and largest output of the record, None where that is not known.
    """
    words = "The model can rest at any input, and --start tells none; the first one is"
    way = "Pass --start with the input at which the machine is held."
    if recorded is None:
        warnings.warn(
            f"{words} {first:g}, the number of the first reference, though that is of the output: the output "
            f"will be off by a constant that is not known. {way} Or identify the model anew: what `identify "
            "--save` writes now keeps what was recorded.",
            NarxWarning,
            stacklevel=2,
        )
        return []
    if not recorded[0] <= r <= recorded[2]:
        warnings.warn(
            f"The reference begins at {r:g}, beyond the recorded output, {recorded[0]:g} to {recorded[2]:g}; "
            f"the first input is {first:g}, and the output will be off by a constant that is not known. "
            f"{way}",
            UnreachableWarning,
            stacklevel=2,
        )
        return []
    return [f"{words} {first:g}, about what was recorded with an output of {r:g}. {way}"]


def _load_model(path: str) -> NARXModel:
    try:
        return NARXModel.load(path)
    except OSError as error:
        raise DataError(
            f"Cannot read the model {path}: {error.strerror}. Pass what `identify --save` wrote."
        ) from error


def _read_reference(options, others, dt: float | None):
    """Return the columns to write (time, reference), what the law knows beforehand, and notes."""
    table = read_table(options.reference)
    # the options name columns of the record where there is one, and of the reference where there is none
    own = options.record is None
    time = options.time if own or options.time == NONE else None
    sampled = sample_evenly(table, dt=options.dt, time=time, resample=options.resample if own else None)
    _check_period(sampled.dt, dt, options)
    labels = list(sampled.frame.columns)
    beside = [
        find_column(labels, name, "The law also needs the input", lacking=", which no column gives")
        for name in others
    ]
    named = asked_columns(table, labels, options.r, "--r")
    labels = [label for label in labels if label not in beside]
    named = named or [name for name in labels if split_unit(name)[0].lower() in REFERENCES] or labels
    if len(named) != 1:
        raise UsageError(f"Which column is the reference? Name it with --r; there are {', '.join(labels)}.")
    (label,) = named
    columns = {} if sampled.dt is None else {"time [s]": sampled.dt * np.arange(len(sampled.frame))}
    known = sampled.frame[[label, *beside]]
    return {**columns, label: known[label].to_numpy()}, known, list(sampled.notes)


def _check_period(found: float | None, wanted: float | None, options) -> None:
    """Raise where the reference has another sampling period than the model, or the record it is made from."""
    if same_period(found, wanted):
        return
    if options.record is None:
        whose, way = "model", f"Pass --resample {wanted:.6g}, or identify a model from a record sampled so"
    else:
        whose = "record"
        way = f"Resample the reference, or the record: --resample {found:.6g} is for the record"
    raise DataError(
        f"The reference is sampled every {found:.6g} s, the {whose} {wanted:.6g} s: its law would run "
        f"at another speed. {way}."
    )

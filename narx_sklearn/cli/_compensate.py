"""``narx-sklearn compensate``."""

import numpy as np

from narx_sklearn._validation import split_unit
from narx_sklearn.cli._columns import read_recording
from narx_sklearn.cli._errors import UsageError
from narx_sklearn.cli._files import check_writable
from narx_sklearn.cli._output import tell_notes, write_columns
from narx_sklearn.cli._sampling import find_column, sample_evenly
from narx_sklearn.cli._tables import read_table
from narx_sklearn.compensation import InverseCompensator, IsolatedCompensator, RootCompensator
from narx_sklearn.model import NARXModel

METHODS = {"roots": RootCompensator, "isolated": IsolatedCompensator, "inverse": InverseCompensator}
REFERENCES = frozenset({"r", "ref", "reference", "setpoint", "target"})


def run(options) -> None:
    """Read the reference, take or identify the model, run the law, write the input."""
    check_writable(options.output)
    if (options.model is None) == (options.record is None):
        raise UsageError("Give either --model, as `identify --save` wrote it, or --record, to identify one.")
    if options.reference == options.record == "-":
        raise UsageError("Reference and record cannot both come from standard input.")
    limits = None if options.limits is None else tuple(options.limits)
    compensator = METHODS[options.method](limits=limits, rate_limit=options.rate_limit)
    if options.model is not None:
        model = _read_model(options.model)
        compensator.set_params(model=model).fit()
        name, unit = model.inputs[0], model.units.get(model.inputs[0])
        label = f"{name} [{unit}]" if unit else name
    else:
        recording = read_recording(options.record, options)
        tell_notes(recording.notes, options.quiet)
        if recording.y.shape[1] != 1:
            raise UsageError(f"A compensator follows one output; --y names {recording.y.shape[1]}.")
        compensator.fit(recording.u, recording.y.iloc[:, 0], recording.sessions)
        label = recording.u.columns[0]
    columns, reference, notes = _read_reference(options)
    done = compensator.compensate(reference)
    counts = done.counts
    notes += [f"The law:\n{compensator.law_.to_text()}"]
    for what, count in (
        ("no admissible input solved the law, so it was held", counts.no_solution),
        ("the input was cut at a limit", counts.at_limit),
        ("its change was cut", counts.at_rate_limit),
    ):
        if count:
            notes.append(f"At {count} of {counts.samples} samples {what}.")
    tell_notes(notes, options.quiet)
    write_columns(options.output, {**columns, label: done.m})


def _read_model(path: str) -> NARXModel:
    return NARXModel.load(path)


def _read_reference(options):
    """Return the columns to write (time, reference), the reference, and notes."""
    table = read_table(options.reference)
    # the options name columns of the record where there is one, and of the reference where there is none
    own = options.record is None
    sampled = sample_evenly(
        table, dt=options.dt, time=options.time if own else None, resample=options.resample if own else None
    )
    labels = list(sampled.frame.columns)
    if options.r is not None:
        label = find_column(labels, options.r, "--r")
    else:
        named = [name for name in labels if split_unit(name)[0].lower() in REFERENCES]
        if len(named) != 1 and len(labels) != 1:
            raise UsageError(
                f"Which column is the reference? Name it with --r; there are {', '.join(labels)}."
            )
        label = named[0] if len(named) == 1 else labels[0]
    columns = {} if sampled.dt is None else {"time [s]": sampled.dt * np.arange(len(sampled.frame))}
    reference = sampled.frame[label].to_numpy()
    return {**columns, label: reference}, reference, list(sampled.notes)

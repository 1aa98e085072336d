"""``narx-sklearn diagnose``."""

from importlib.util import find_spec

import numpy as np
import pandas as pd

from narx_sklearn._progress import progress
from narx_sklearn.cli._columns import Recording, read_recordings
from narx_sklearn.cli._errors import DataError, UsageError
from narx_sklearn.cli._files import check_writable, write_text
from narx_sklearn.cli._output import diagnosis_content, say, tell_notes, write_json
from narx_sklearn.cli._sampling import MANY, other_unit
from narx_sklearn.cli._simulators import load_simulator
from narx_sklearn.discrepancy import DiscrepancyRegressor, TraceSimulator
from narx_sklearn.discrepancy.columns import chosen_columns
from narx_sklearn.discrepancy.settings import STAGES
from narx_sklearn.model.times import same_period

LONGEST = 500  # samples of a proposed experiment
OF_REPORT = {"experiment that would tell": 0, "report": 15}  # per cent of the time, as measured
FAR = 1e6  # times the usual size of a simulated output, beyond which it has diverged


def run(options) -> None:
    """Read, diagnose, tell."""
    check_targets(options)
    model = load_simulator(options.model) if options.model else None
    if model is not None and options.y_sim:
        raise UsageError("Give --model or --y-sim, not both: one simulation is diagnosed.")
    recording = read_recordings(
        options.records,
        options,
        simulated=model is None,
        inputs=[] if model is None else [signal.name for signal in model.inputs],
        outputs=[] if model is None else [signal.name for signal in model.outputs],
    )
    tell_notes(recording.notes, options.quiet)
    simulator = _trace(recording) if model is None else _checked(model, recording, options)
    dx = DiscrepancyRegressor(
        simulator,
        effects=_codes(options.effects) or "catalogue",
        exclude=_codes(options.exclude),
        alpha=options.alpha,
        level=options.level,
        max_effects=options.max_effects,
        window=options.window,
        test_fraction=options.test_fraction,
        random_state=options.seed,
        n_jobs=options.jobs,
    )
    source = ", ".join("standard input" if record == "-" else record for record in options.records)
    tell_diagnosis(dx, recording, options, title="Diagnosis", source=source)


def check_targets(options) -> None:
    """Raise before the work where its result could not be written."""
    check_writable(options.report)
    check_writable(options.json)
    if options.report == "-":
        raise UsageError("--report needs a file name; text goes to standard output by itself.")
    if options.report:
        for package in ("jinja2", "matplotlib"):
            if find_spec(package) is None:
                raise DataError(f'--report needs {package}: pip install "narx-sklearn[report]"')


def tell_diagnosis(
    dx: DiscrepancyRegressor, recording: Recording, options, *, title: str, source: str
) -> None:
    """Fit, and write what was asked for: words, JSON, the report."""
    y = recording.y.iloc[:, 0] if recording.y.shape[1] == 1 else recording.y
    with progress(STAGES, quiet=options.quiet) as begin:
        dx.set_params(verbose=begin)
        dx.fit(recording.u, y, sessions=recording.sessions)
    say(dx.report_, beside=options.json == "-")
    if options.json:
        write_json(options.json, diagnosis_content(dx))
    if options.report:
        with progress(OF_REPORT, quiet=options.quiet) as begin:
            page = _page(dx, recording, y, begin, title=title, source=source)
        write_text(options.report, page)
        tell_notes([f"Report written to {options.report}."], options.quiet)


def _page(dx: DiscrepancyRegressor, recording: Recording, y, begin, **about) -> str:
    """Return the report as an HTML page, with the experiment that would separate look-alikes."""
    from narx_sklearn.report import render_report

    begin("experiment that would tell")
    experiment, notes = None, list(recording.notes)
    try:
        experiment = propose(dx, recording)
    except ValueError as reason:  # what was found is told without one
        notes.append(f"No experiment is proposed that would tell more. {reason}")
    begin("report")
    about |= {"sessions": recording.sessions, "notes": notes, "experiment": experiment}
    return render_report(dx, recording.u, y, **about)


def propose(dx: DiscrepancyRegressor, recording: Recording):
    """Return the input, in the range of the recorded one, that separates look-alikes; None where none are."""
    if dx.verdict_ != "ambiguous" or not any(finding.lookalikes for finding in dx.findings_):
        return None
    u = recording.u.iloc[:, 0]
    return dx.next_experiment((u.max() - u.min()) / 2, min(len(u), LONGEST))


def _codes(text: str) -> list[str]:
    return [code.strip() for code in text.split(",") if code.strip()]


def _trace(recording: Recording) -> TraceSimulator:
    if recording.dt is None:
        raise UsageError(
            "The sampling period is not known: pass --dt in seconds, or name the time column with --time."
        )
    assert recording.y_sim is not None  # reading has refused a record without it
    check_trace(recording.y_sim, recording.y)
    y_sim = recording.y_sim.set_axis(recording.y.columns, axis=1)  # the outputs' names and units
    return TraceSimulator(y_sim, recording.u, dt=recording.dt, sessions=recording.sessions)


def check_trace(y_sim: pd.DataFrame, y: pd.DataFrame) -> None:
    """Raise where a simulated output has left the recorded one behind; in another unit all of it is far."""
    for label, measured in zip(y_sim, y, strict=True):
        size = y_sim[label].abs().to_numpy()
        low, high, largest = y[measured].min(), y[measured].max(), np.nanmax(size)
        if largest > FAR * max(np.nanmedian(size), high - low):
            row = int(np.argmax(size > FAR * (high - low)))
            raise DataError(
                f"Simulated output {label!r} has diverged: it is {size[row]:.3g} in row {row + 1} of the "
                f"values and goes to {largest:.3g}, while {measured!r} lies in {low:.3g} to {high:.3g}. "
                "Pass the rows before, or mend the simulation (signs, units, step)."
            )


def _checked(simulator, recording: Recording, options):
    """Return the simulator, or raise where its period or its signals are not those of the record."""
    for option, columns, signals, role in (
        ("--u", recording.u, simulator.inputs, "input"),
        ("--y", recording.y, simulator.outputs, "output"),
    ):
        used = list(chosen_columns(columns, signals, option, role))
        if idle := [repr(label) for label in columns if label not in used]:
            raise UsageError(
                f"{option} names {', '.join(idle)}, which the simulator does not know: its {role}s are "
                f"{', '.join(map(str, signals))}. Leave it out, or tell the simulator of it ({role}s=[...])."
            )
    dt = simulator.dt
    if recording.dt is None or same_period(recording.dt, dt):
        return simulator
    unit = ""  # time stamps have theirs, and so has a grid that was asked for
    if options.resample is None and (recording.time is not None or options.dt is not None):
        unit = other_unit(recording.dt, dt, recording.time)
    # a grid of --resample may be as fine as its samples allow, not finer
    finer = recording.dt > MANY * dt
    raise DataError(
        f"The record is sampled every {recording.dt:.6g} s, the simulator {dt:.6g} s. {unit}"
        f"{'Else give' if unit else 'Give'} the simulator dt={recording.dt:.6g}"
        + ("." if finer else f", or pass --resample {dt:.6g}.")
    )

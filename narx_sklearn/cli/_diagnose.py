"""``narx-sklearn diagnose``."""

import math

from narx_sklearn.cli._columns import Recording, read_recording
from narx_sklearn.cli._errors import DataError, UsageError
from narx_sklearn.cli._files import check_writable, replaced
from narx_sklearn.cli._output import diagnosis_content, say, tell_notes, write_json
from narx_sklearn.cli._simulators import load_simulator
from narx_sklearn.discrepancy import DiscrepancyRegressor, TraceSimulator

LONGEST = 500  # samples of a proposed experiment
SAME_PERIOD = 0.01  # relative difference up to which the periods of record and simulator are one


def run(options) -> None:
    """Read, diagnose, tell."""
    check_targets(options)
    model = load_simulator(options.model) if options.model else None
    if model is not None and options.y_sim:
        raise UsageError("Give --model or --y-sim, not both: one simulation is diagnosed.")
    recording = read_recording(
        options.record,
        options,
        simulated=model is None,
        inputs=[] if model is None else [signal.name for signal in model.inputs],
        outputs=[] if model is None else [signal.name for signal in model.outputs],
    )
    tell_notes(recording.notes, options.quiet)
    simulator = _trace(recording) if model is None else _checked(model, recording)
    dx = DiscrepancyRegressor(
        simulator,
        effects=options.effects.split(",") if options.effects else "catalogue",
        exclude=[code for code in options.exclude.split(",") if code],
        alpha=options.alpha,
        level=options.level,
        max_effects=options.max_effects,
        window=options.window,
        test_fraction=options.test_fraction,
        random_state=options.seed,
        n_jobs=options.jobs,
        verbose=0 if options.quiet else 1,
    )
    source = "standard input" if options.record == "-" else options.record
    tell_diagnosis(dx, recording, options, title="Diagnosis", source=source)


def check_targets(options) -> None:
    """Raise before the work where its result could not be written."""
    check_writable(options.report)
    check_writable(options.json)
    if options.report == "-":
        raise UsageError("--report needs a file name; text goes to standard output by itself.")
    if options.report:
        for package in ("jinja2", "matplotlib"):
            try:
                __import__(package)
            except ImportError as error:
                raise DataError(f'--report needs {package}: pip install "narx-sklearn[report]"') from error


def tell_diagnosis(
    dx: DiscrepancyRegressor, recording: Recording, options, *, title: str, source: str
) -> None:
    """Fit, and write what was asked for: words, JSON, the report."""
    y = recording.y.iloc[:, 0] if recording.y.shape[1] == 1 else recording.y
    dx.fit(recording.u, y, sessions=recording.sessions)
    say(dx.report_, beside=options.json == "-")
    if options.json:
        write_json(options.json, diagnosis_content(dx))
    if options.report:
        from narx_sklearn.report import write_report

        about = {"sessions": recording.sessions, "title": title, "source": source, "notes": recording.notes}
        about["experiment"] = propose(dx, recording)
        with replaced(options.report) as draft:
            write_report(dx, draft, recording.u, y, **about)
        tell_notes([f"Report written to {options.report}."], options.quiet)


def propose(dx: DiscrepancyRegressor, recording: Recording):
    """Return the input, in the range of the recorded one, that separates look-alikes; None where none are."""
    if dx.verdict_ != "ambiguous":
        return None
    u = recording.u.iloc[:, 0]
    half, middle = (u.max() - u.min()) / 2, (u.max() + u.min()) / 2
    return dx.next_experiment(half, min(len(u), LONGEST), offset=middle)


def _trace(recording: Recording) -> TraceSimulator:
    if recording.dt is None:
        raise UsageError(
            "The sampling period is not known: pass --dt in seconds, or name the time column with --time."
        )
    assert recording.y_sim is not None  # reading has refused a record without it
    y_sim = recording.y_sim.set_axis(recording.y.columns, axis=1)  # the outputs' names and units
    return TraceSimulator(y_sim, recording.u, dt=recording.dt, sessions=recording.sessions)


def _checked(simulator, recording: Recording):
    if recording.dt is not None and not math.isclose(simulator.dt, recording.dt, rel_tol=SAME_PERIOD):
        raise DataError(
            f"The record is sampled every {recording.dt:.6g} s, the simulator {simulator.dt:.6g} s. Give "
            f"the simulator dt={recording.dt:.6g}, or pass --resample {simulator.dt:.6g}."
        )
    return simulator

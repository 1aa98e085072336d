"""The report of a diagnosis as one HTML file that needs nothing else."""

import warnings
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd

from narx_sklearn.analysis.residuals import longest_lag, residual_tests
from narx_sklearn.discrepancy.fitting.acting import name_added, unit_added
from narx_sklearn.discrepancy.report_text import (
    about_parameters,
    how_it_extrapolates,
    verdict_sentence,
    what_a_refit_harms,
    what_adds_up,
    what_is_left,
    what_is_left_out,
    what_is_not_confirmed,
)
from narx_sklearn.discrepancy.results import p_text
from narx_sklearn.exceptions import ExcitationWarning
from narx_sklearn.report._curves import effect_curves
from narx_sklearn.report._figures import (
    before_and_after,
    course_figure,
    effect_figure,
    residual_figure,
    state_plane,
    time_line,
)
from narx_sklearn.report._runs import Material, adjoining, gather, noise_left, whitened
from narx_sklearn.report._words import (
    TableText,
    capital,
    correlation_table,
    difference_table,
    finding_table,
    has_form,
    headline,
    held_out_table,
    louder_table,
    next_steps,
    noise_table,
    number,
    parameter_table,
    percent,
    residual_sentence,
    residual_table,
    run_words,
    settings_table,
    to_table,
)

TEMPLATES = Path(__file__).parent / "templates"
N_RESAMPLES = 199  # of the residual tests
FEWEST_RESIDUALS = 200  # held-out samples, below which they are made on the fitting windows
MOST_DOTS = 4000
SHOWN = 2000  # samples of a held-out stretch in its figure


def render_report(dx, X, y, *, sessions=None, title="Diagnosis", source="", notes=(), experiment=None) -> str:
    """Return the report of a fitted diagnosis as an HTML page.

    Parameters
    ----------
    dx : DiscrepancyRegressor
        Fitted.
    X : array-like or DataFrame of shape (n_samples, n_inputs)
        Inputs that it was fitted to.
    y : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Outputs that it was fitted to.
    sessions : array-like of shape (n_samples,), default=None
        Labels that it was fitted with.
    title : str, default="Diagnosis"
        Heading of the page.
    source : str, default=""
        Where the record came from, for the reader.
    notes : sequence of str, default=()
        Remarks on how the record was read.
    experiment : Experiment, default=None
        A proposed experiment, to be told under what to try next.

    Returns
    -------
    str
        One self-contained page: figures are inline SVG, and nothing is loaded from anywhere.

    Raises
    ------
    ImportError
        If jinja2 or matplotlib is missing; says what to install.
    ValueError
        If the record is not the one that was diagnosed.

    See Also
    --------
    write_report : Write it to a file.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy import DiscrepancyRegressor, ODESimulator
    >>> from narx_sklearn.report import render_report
    >>> def tank(x, u, p):
    ...     return (p[0] * u[0] - p[1] * x[0],)
    >>> sim = ODESimulator(tank, dt=0.1, parameters={"gain [m/s/V]": 1.0, "outflow [1/s]": 0.5},
    ...                    states=["level [m]"], inputs=["pump [V]"])
    >>> rng = np.random.default_rng(0)
    >>> u = np.repeat(rng.uniform(0, 2, 120), 10)
    >>> y = sim.simulate(u)[:, 0] + 0.01 * rng.normal(size=u.size)
    >>> dx = DiscrepancyRegressor(sim, effects=["root_outflow"]).fit(u, y)
    >>> page = render_report(dx, u, y)
    >>> page.count("<svg")
    4
    """
    template = _environment().get_template("report.html.jinja")
    material = gather(dx, X, y, sessions)
    facts = _facts(dx, material)
    outputs = [str(signal) for signal in material.simulator.outputs]
    return template.render(
        title=title,
        source=source,
        notes=notes,
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        verdict=dx.verdict_,
        verdict_sentence=verdict_sentence(dx),
        headline=headline(dx),
        p_value=p_text(dx.p_value_),
        facts=facts,
        where=_where(dx, material, outputs),
        what=_what(dx, material),
        what_is_left=what_is_left(dx),
        parameters=None if dx.parameters_.empty else parameter_table(dx),
        about_parameters=about_parameters(dx),
        proof=_proof(dx, material, outputs),
        residuals=_residuals(dx, material, outputs),
        steps=next_steps(dx, experiment),
        noise=noise_table(dx),
        settings=settings_table(dx, facts),
        simulator=repr(material.simulator),
    )


def write_report(dx, path, X, y, **options) -> None:
    """Write the report of a fitted diagnosis to a file.

    Parameters
    ----------
    dx : DiscrepancyRegressor
        Fitted.
    path : str or path-like
        The HTML file.
    X, y : array-like
        The record, as for `render_report`.
    **options
        Further arguments of `render_report`.

    Raises
    ------
    ImportError, ValueError
        As `render_report`.

    See Also
    --------
    render_report : Return it as text.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import numpy as np
    >>> from narx_sklearn import DiscrepancyRegressor, ODESimulator, write_report
    >>> def tank(x, u, p):
    ...     return (p[0] * u[0] - p[1] * x[0],)
    >>> sim = ODESimulator(tank, dt=0.1, parameters={"gain [m/s/V]": 1.0, "outflow [1/s]": 0.5},
    ...                    states=["level [m]"], inputs=["pump [V]"])
    >>> rng = np.random.default_rng(0)
    >>> u = np.repeat(rng.normal(size=40), 25)
    >>> y = sim.simulate(u)[:, 0] + 0.01 * rng.normal(size=1000)
    >>> dx = DiscrepancyRegressor(sim, effects=["dead_zone"]).fit(u, y)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_report(dx, Path(folder) / "tank.html", u, y)
    ...     (Path(folder) / "tank.html").stat().st_size > 10_000
    True
    """
    Path(path).write_text(render_report(dx, X, y, **options), encoding="utf-8")


def _environment():
    try:
        from jinja2 import Environment, FileSystemLoader, StrictUndefined
    except ImportError as error:
        raise ImportError('The report is made with jinja2: pip install "narx-sklearn[report]"') from error
    return Environment(
        loader=FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _figure(svg: str, caption: str) -> dict:
    from markupsafe import Markup

    return {"svg": Markup(svg), "caption": caption}  # matplotlib escapes what its texts contain


def _facts(dx, material: Material) -> list[tuple[str, str]]:
    """Return the numbers at the top, with what they are."""
    n = len(material.u)
    facts = [("samples", f"{n}"), ("sampling period", f"{number(material.simulator.dt)} s")]
    facts.append(("p that nothing is missing", p_text(dx.p_value_, "")))
    if not dx.scores_.empty:
        error = dx.scores_["nrmse"]
        words = run_words(dx)
        facts += [(f"held-out error, {words[run]}", percent(error[run])) for run in error.index]
    return facts


def _where(dx, material: Material, outputs) -> dict:
    """Return figures and tables of where the mismatch is."""
    segments = dx.location_.segments
    column = int(np.argmax(_relative_error(material)))
    residual = material.residual[:, column]
    seen = np.isfinite(residual)
    dt = material.simulator.dt
    t = dt * np.arange(len(residual))  # one axis for all sessions
    shaded = [(a * dt, b * dt) for a, b in zip(segments["start"], segments["stop"], strict=True)]
    caption = f"{outputs[column]}: recorded, and simulated with refitted parameters window by window."
    if shaded:
        caption += " Shaded: where the mismatch is larger than elsewhere."
    last = int(np.flatnonzero(seen)[-1]) + 1
    figures = [
        _figure(
            time_line(
                t[:last],
                material.y[:last, column],
                material.before.y[:last, column],
                residual[:last],
                shaded,
                outputs[column],
                caption,
            ),
            caption,
        )
    ]
    figures.append(_state_figure(dx, material, column, seen))
    if dx.conclusion_.diagnosis.unforeseen is not None:
        figures.append(_course_figure(dx, material))
    unit = material.simulator.outputs[column].unit
    difference = difference_table(t[:last], residual[:last], unit)
    return {"figures": figures, "difference": difference, "tables": _location_tables(dx.location_)}


def _relative_error(material: Material) -> np.ndarray:
    """Return each output's refitted error over its spread."""
    spread = np.nanstd(material.y, axis=0)
    return np.sqrt(np.nanmean(material.residual**2, axis=0)) / np.where(spread > 0, spread, 1.0)


def _state_figure(dx, material: Material, column: int, seen) -> dict:
    x = material.before.x
    states = [str(signal) for signal in material.simulator.states]
    rows = np.flatnonzero(seen & np.isfinite(x).all(axis=1))
    rows = rows[:: -(-rows.size // MOST_DOTS)]
    if len(states) > 1 and "[k-" in states[1]:  # the states are one signal, moved; their change tells more
        unit = material.simulator.states[0].unit
        change = "its change in one sample" + (f" [{unit}]" if unit else "")
        a, b, labels = x[rows, 0], x[rows, 0] - x[rows, 1], [states[0], change]
    elif len(states) > 1:
        a, b, labels = x[rows, 0], x[rows, 1], states[:2]
    else:
        inputs, output = material.simulator.inputs, str(material.simulator.outputs[column])
        a, b, labels = material.time[rows], material.y[rows, column], ["time [s]", output]
        if inputs:
            a, labels = material.u[rows, 0], [str(inputs[0]), output]
    size = np.abs(material.residual[rows, column])
    size = size / max(size.max(), 1e-300)
    caption = (
        f"Where in {labels[0]} and {labels[1]} the mismatch is: each dot a sample, redder where it is larger."
    )
    return _figure(state_plane(a, b, size, *labels, caption), caption)


def _course_figure(dx, material: Material) -> dict:
    """Return what follows no signal, along the record."""
    course, finding = dx.location_.force, dx.findings_[0]
    port = dx.conclusion_.diagnosis.unforeseen.acting.entry.port
    unit = unit_added(port, material.simulator)
    label = name_added(port, material.simulator).removeprefix("added to ")
    label += f" [{unit}]" if unit else ""
    caption = f"{capital(finding.title)} {finding.place}: its course, two standard errors to either side."
    time = material.simulator.dt * course["sample"].to_numpy()
    force, deviation = course["force"].to_numpy(), course["deviation"].to_numpy()
    return _figure(course_figure(time, force, deviation, label, caption), caption)


def _location_tables(location) -> list[TableText]:
    is_named = location.regions["effect"].ne("").any()
    where = "Regions of operation in which what was found acts most"
    if not is_named:
        where = "Regions that hold more of the unknown signal at the likeliest place than of the time"
    segments = {
        "effect": "what",
        "start_s": "from [s]",
        "stop_s": "to [s]",
        "share": "share of the error",
        "time_share": "share of the time",
        "p_value": "p",
        "event": "at its beginning",
    }
    regions = {
        "effect": "what",
        "rule": "where",
        "share": "share of what it adds" if is_named else "share of the signal",
        "time_share": "share of the time",
        "lift": "times the average",
        "p_value": "p",
    }
    ports = {
        "kind": "kind",
        "name": "port",
        "unit": "unit",
        "share": "share of the error",
        "p_value": "p of nothing",
        "p_best": "p that it is as good as the first",
        "tied": "may be the place",
    }
    bands = {
        "output": "output",
        "f_low": "from [Hz]",
        "f_high": "to [Hz]",
        "share": "share of the error",
        "excess": "times the noise",
        "p_value": "p",
    }
    kept = location.bands[location.bands["kept"]]
    tables = [
        to_table(location.regions, where, regions),
        to_table(location.ports, "Where in the equations it enters, best first", ports),
        to_table(location.segments, "Stretches of time with more error than the rest", segments),
        to_table(kept, "Frequencies above the noise", bands),
        to_table(_invariances(location), *_like_what(location)),
    ]
    return [table for table in tables if table.rows]


def _invariances(location) -> pd.DataFrame:
    """Return what an unknown signal is like, without what its record cannot tell."""
    table = location.invariances
    return table[table["value"].notna()].reset_index()


def _like_what(location) -> tuple[str, dict[str, str]]:
    x, v, u = location.against or ("x", "v", "u")
    title = f"What the unknown signal at the likeliest place is like, with x = {x}, v = {v} and u = {u}"
    return title, {
        "property": "property",
        "reading": "reading",
        "value": "value",
        "low": "from",
        "high": "to",
    }


def _what(dx, material: Material) -> list[dict]:
    """Return the findings with their tables and curves."""
    found = []
    curves = effect_curves(dx, material)
    in_order = iter(dx.conclusion_.diagnosis.order)
    for rank, finding in enumerate(dx.findings_, start=1):
        title = capital(finding.title)
        if not finding.modelled:
            found.append({"rank": rank, "title": title, "finding": finding})
            continue
        curve = curves[next(in_order)]
        caption = f"{title}: {curve.y_label} against {curve.x_label}, as fitted and as the data ask for."
        bins = to_table(
            curve.table,
            "The curve in numbers (medians in bins, 95 % intervals)",
            {
                "argument": curve.x_label,
                "force": curve.y_label,
                "low": "from",
                "high": "to",
                "fitted": "as fitted",
                "count": "samples",
            },
        )
        found.append(
            {
                "rank": rank,
                "title": title,
                "rivals": finding.rivals,
                "finding": finding,
                "table": finding_table(finding, dx.level),
                "figure": _figure(effect_figure(curve, caption), caption),
                "bins": bins,
            }
        )
    return found


def _proof(dx, material: Material, outputs) -> dict | None:
    """Return the held-out comparison, None where nothing was held out."""
    if dx.scores_.empty or not material.held_out:
        return None
    keys = ("refitted", "augmented") if has_form(dx) else ("nominal", "refitted")
    before, after = (run_words(dx)[key] for key in keys)
    longest = max(adjoining(material.held_out), key=lambda parts: parts[-1].rows.stop - parts[0].rows.start)
    start, stop = longest[0].rows.start, longest[-1].rows.stop
    rows = slice(start, min(stop, start + SHOWN))
    shown = {run: np.concatenate([part.y[run] for part in longest])[: rows.stop - start] for run in keys}
    figures = []
    for column, label in enumerate(outputs):
        caption = (
            f"{label} on held-out data: recorded, {before}, {after}. Free runs; the fit saw nothing of it."
        )
        if len(longest) > 1:
            caption += (
                f" They begin {len(longest)} times, as the machine is unstable and no long run follows it."
            )
        runs = {word: shown[key][:, column] for word, key in zip((before, after), keys, strict=True)}
        svg = before_and_after(material.time[rows], material.y[rows, column], runs, label, caption)
        figures.append(_figure(svg, caption))
    return {
        "figures": figures,
        "table": held_out_table(dx, outputs),
        "said": [
            what_adds_up(dx),
            what_is_not_confirmed(dx),
            what_a_refit_harms(dx),
            what_is_left_out(dx),
            how_it_extrapolates(dx),
        ],
        "louder": louder_table(dx, outputs),
    }


def _residuals(dx, material: Material, outputs) -> list[dict]:
    """Return the residual tests of each output, on held-out data where there is enough of it."""
    rest = np.full_like(material.y, np.nan)
    for part in material.held_out:
        inside = part.stretch.scored
        rest[inside] = material.y[inside] - part.y["augmented"][part.n_init :]
    where = "held-out data"
    if np.isfinite(rest).all(axis=1).sum() < FEWEST_RESIDUALS:
        rest, where = material.y - material.after.y, "the fitting windows"
    left = whitened(rest, noise_left(dx, material), material.sessions)
    told: list[dict] = []
    inputs = [str(signal) for signal in material.simulator.inputs]
    u = pd.DataFrame(material.u, columns=inputs) if inputs else None
    for column, label in enumerate(outputs):
        max_lag = longest_lag(left[:, column], material.sessions)  # runs may begin anew every few samples
        if max_lag == 0:
            told.append({"verdict": f"Of {label} too few samples in a row are left for tests."})
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ExcitationWarning)  # the verdict says it
            tests = residual_tests(
                left[:, column],
                u,
                material.y[:, column],
                max_lag=max_lag,
                sessions=material.sessions,
                n_resamples=N_RESAMPLES,
                random_state=0,
            )
        caption = (
            f"Correlations of what is left of {label} on {where}, the noise's own colour taken out. "
            "Shaded: bounds; u the input, xi what is left."
        )
        told.append(
            {
                "verdict": residual_sentence(tests),
                "figure": _figure(residual_figure(tests.tests, caption), caption),
                "table": residual_table(tests, label),
                "correlations": correlation_table(tests),
            }
        )
    return told

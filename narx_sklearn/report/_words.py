"""Sentences and tables of the report."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from narx_sklearn.analysis.residuals import ResidualTests
from narx_sklearn.discrepancy.report_text import (
    is_for_its_time_only,
    verdict_sentence,
    what_a_refit_harms,
    what_is_no_law,
)
from narx_sklearn.discrepancy.results import BY_SESSION, p_text
from narx_sklearn.report._runs import WORDS

DYNAMIC = frozenset(
    {"cross-correlation", "even", "odd", "spread", "output-input"}
)  # tests that the input takes part in

TENTHS = 10


class TableText(NamedTuple):
    """A table ready to print: everything a text."""

    caption: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def number(value) -> str:
    """Return a value as it is printed: four digits, and a dash where there is none.

    Examples
    --------
    >>> from narx_sklearn.report._words import number
    >>> number(0.0123456), number(float("nan")), number("text")
    ('0.01235', '-', 'text')
    """
    if value is None or (isinstance(value, float | np.floating) and np.isnan(value)):
        return "-"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return str(value)
    if isinstance(value, float | np.floating):
        return f"{value:.4g}".replace("inf", "∞")
    return str(value)


def percent(share: float) -> str:
    """Return a share in per cent, three digits; a word where a run left the finite range."""
    if np.isnan(share):
        return "-"
    return f"{100 * share:.3g} %" if np.isfinite(share) else "diverges"


def to_table(frame: pd.DataFrame, caption: str, columns: dict[str, str]) -> TableText:
    """Return the named columns of a frame, under the headings given; columns it lacks are left out."""
    present = {column: heading for column, heading in columns.items() if column in frame}
    rows = tuple(
        tuple(_cell(column, value) for column, value in zip(present, row, strict=True))
        for row in frame[list(present)].itertuples(index=False, name=None)
    )
    return TableText(caption, tuple(present.values()), rows)


def _cell(column: str, value) -> str:
    if column.startswith("p_"):
        return p_text(value, "")
    return percent(value) if column in ("share", "time_share") else number(value)


def headline(dx) -> str:
    """Return the verdict in one sentence."""
    names = _listed([f"{capital(finding.title)} {finding.place}{finding.when}" for finding in dx.findings_])
    if dx.verdict_ == "explained":
        sentence = f"Missing from the simulation: {names}"
    elif dx.verdict_ == "ambiguous":
        others = _listed(
            list(dict.fromkeys(name for f in dx.findings_ for name in readable(f.lookalikes))), "or"
        )
        sentence = f"Missing from the simulation: {names}"
        if others:
            sentence += f", or what looks the same on these data: {others}"
        if is_for_its_time_only(dx):
            sentence += ", or what always acts and looks like that meanwhile"
    elif dx.verdict_ == "unknown" and not _is_beside_physics(dx):
        sentence = "Something is missing from the simulation that the catalogue does not hold"
        if other := what_is_no_law(dx):
            sentence = f"{other}: {names}"
        elif has_form(dx):
            sentence += f"; what comes nearest: {names}"
        elif dx.findings_:
            sentence += f"; the likeliest place is {dx.findings_[0].place}"
    else:
        sentence = verdict_sentence(dx).rstrip(".")
    return f"{sentence}{_gain(dx)}."


def _is_beside_physics(dx) -> bool:
    """Tell whether steps of the integration, or mistakes in the record, may be all that is missing."""
    diagnosis = dx.conclusion_.diagnosis
    return diagnosis.steps_miss or diagnosis.record_misleads


def has_form(dx) -> bool:
    """Tell whether anything that was found has a form, and was tried on held-out samples."""
    return any(finding.modelled for finding in dx.findings_)


def run_words(dx) -> dict[str, str]:
    """Return what the simulations of the scores are called.

    Where held-out samples spoke against what was found, the corrected simulation is no longer the one that
    was scored.
    """
    return WORDS | ({"augmented": "with what was found"} if dx.conclusion_.leaves_all_out else {})


def _gain(dx) -> str:
    if dx.scores_.empty:
        return ""
    error = dx.scores_["nrmse"]
    if dx.verdict_ == "consistent":
        return f" (held-out error {percent(error['nominal'])} of the spread there)"
    before = error["refitted" if has_form(dx) else "nominal"]
    after = error.get(BY_SESSION, error["augmented"])
    if not np.isfinite(after):
        return "; on data the fit never saw, the free run leaves the finite range"
    if not np.isfinite(before):
        return f"; on data the fit never saw, a free run that diverged has an error of {percent(after)} now"
    so = "" if after < before else " this is no better:"
    return (
        f"; on data the fit never saw{so} the error goes from {percent(before)} to {percent(after)} of their "
        "spread"
    )


def capital(text: str) -> str:
    """Return a text with a capital at its beginning."""
    return text[:1].upper() + text[1:]


def readable(lookalikes: Sequence[str]) -> list[str]:
    """Return look-alikes without their ports, codes as words.

    Examples
    --------
    >>> from narx_sklearn.report._words import readable
    >>> readable(["asymmetric_friction at state:1"])
    ['asymmetric friction']
    """
    return [name.split(" at ")[0].replace("_", " ") for name in lookalikes]


def _listed(names: Sequence[str], last: str = "and") -> str:
    return f" {last} ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def parameter_table(dx) -> TableText:
    """Return the simulation's own parameters before and after."""
    frame = dx.parameters_.reset_index()
    frame["interval"] = [
        f"{number(low)} to {number(high)}"
        for low, high in zip(frame["augmented_low"], frame["augmented_high"], strict=True)
    ]
    names = {
        "parameter": "parameter",
        "unit": "unit",
        "nominal": "as given",
        "refitted": "refitted, nothing added",
        "augmented": run_words(dx)["augmented"],
        "interval": f"{percent(dx.level)} interval",
    }
    return to_table(frame, "Parameters of the simulation", names)


def held_out_table(dx, outputs: Sequence[str]) -> TableText:
    """Return the held-out errors of ``outputs``, labelled with their units."""
    return _score_table(dx, dx.scores_, "Held-out free run", outputs, run_words(dx))


def louder_table(dx, outputs: Sequence[str]) -> TableText | None:
    """Return the errors in louder motion of what was fitted to quiet motion, None where there are none."""
    if dx.extrapolation_.empty:
        return None
    return _score_table(
        dx, dx.extrapolation_, "Fitted to quiet motion, run over louder motion", outputs, WORDS
    )


def _score_table(dx, scores, title: str, outputs: Sequence[str], words: dict[str, str]) -> TableText:
    frame = scores.reset_index()
    rows = []
    for row in frame.to_dict("records"):
        cells = [words[row["run"]], percent(row["nrmse"])]
        known = np.isfinite(row["nrmse_high"])
        cells.append(f"{percent(row['nrmse_low'])} to {percent(row['nrmse_high'])}" if known else "-")
        cells += [number(row[column]) for column in frame if column.startswith("rmse")]
        removed = row.get("removed", np.nan)
        cells.append(percent(removed) if row["run"] == "augmented" and has_form(dx) else "-")
        rows.append(tuple(cells))
    rmse = [f"rms error of {label}" for label in outputs]
    header = ("simulation", "error / spread", f"{percent(dx.level)} interval", *rmse, "error energy removed")
    return TableText(f"{title}; energy removed is against the refitted simulation", header, tuple(rows))


def finding_table(finding, level: float) -> TableText:
    """Return a finding's parameters."""
    rows = [
        (name, "not told", "", "", finding.units[name])
        if name in finding.untold
        else (name, number(value), *(number(edge) for edge in finding.intervals[name]), finding.units[name])
        for name, value in finding.parameters.items()
    ]
    header = ("parameter", "value", f"{percent(level)} from", "to", "unit")
    return TableText(f"Parameters of: {finding.title}", header, tuple(rows))


def residual_table(tests: ResidualTests, label: str) -> TableText:
    """Return the residual tests of one output."""
    rows = [
        (
            test.symbol,
            p_text(test.p_value, ""),
            p_text(test.adjusted_p_value, ""),
            "fails" if test.rejected else "passes",
        )
        for test in tests.tests
    ]
    return TableText(f"Residual tests of {label}", ("signals", "p", "p (Holm)", "result"), tuple(rows))


def correlation_table(tests: ResidualTests) -> TableText:
    """Return the correlations of the residual tests, with their bounds in brackets."""
    lags = sorted({int(lag) for test in tests.tests for lag in test.lags})
    columns = [
        {int(lag): f"{r:.3f} ({bound:.3f})" for lag, r, bound in zip(*_drawn(test), strict=True)}
        for test in tests.tests
    ]
    rows = [(str(lag), *(column.get(lag, "-") for column in columns)) for lag in lags]
    header = ("lag [samples]", *(test.symbol for test in tests.tests))
    return TableText("The correlations in numbers (bounds in brackets)", header, tuple(rows))


def _drawn(test):
    return test.lags, test.correlation, np.broadcast_to(test.bound, np.shape(test.lags))


def difference_table(time: np.ndarray, residual: np.ndarray, unit: str | None) -> TableText:
    """Return the size of the difference in tenths of the record."""
    measure = f" [{unit}]" if unit else ""
    rows = []
    for piece in np.array_split(np.arange(time.size), min(TENTHS, time.size)):
        there = residual[piece][np.isfinite(residual[piece])]
        sizes = (
            (number(float(v)) for v in (np.sqrt(np.mean(there**2)), np.abs(there).max()))
            if there.size
            else "--"
        )
        rows.append((number(float(time[piece[0]])), number(float(time[piece[-1]])), *sizes))
    header = ("from [s]", "to [s]", f"rms difference{measure}", f"largest{measure}")
    return TableText("The difference in numbers", header, tuple(rows))


def residual_sentence(tests: ResidualTests) -> str:
    """Return what the residual tests say about a simulation, in words."""
    return " ".join([_what_tests_say(tests), *tests.skipped])


def _what_tests_say(tests: ResidualTests) -> str:
    failed = [test for test in tests.tests if test.rejected]
    if not failed:
        return (
            f"What is left passes all {len(tests.tests)} tests at the {percent(tests.alpha)} level "
            f"({tests.n_samples} samples): they find nothing more to explain."
        )
    of_input = sorted({str(test.input) for test in failed if test.name in DYNAMIC})
    symbols = _listed([f"({test.symbol})" for test in failed])
    if of_input:
        return f"What is left still depends on the input {_listed(of_input)}: the tests of {symbols} fail."
    return (
        f"What is left does not depend on the inputs, but it is not plain noise: the tests of {symbols} fail."
    )


def noise_table(dx) -> TableText:
    """Return the estimated noise of each output."""
    rows = [
        (
            name,
            number(noise["deviation"]) if np.isfinite(noise["deviation"]) else "without bound",
            number(noise["sigma"]),
            ", ".join(map(number, noise["autoregression"])) or "none",
            number(noise["moving_average"]),
        )
        for name, noise in dx.noise_.items()
    ]
    header = ("output", "standard deviation", "new in each sample", "autoregression", "moving average")
    return TableText("Noise that the test allowed for", header, tuple(rows))


def settings_table(dx, facts: Sequence[tuple[str, str]] = ()) -> TableText:
    """Return what the diagnosis was asked to do, and with what, after the ``facts`` at the page's top."""
    import platform

    import numba
    import scipy
    import sklearn

    from narx_sklearn import __version__

    given = {
        key: value for key, value in dx.get_params(deep=False).items() if key not in ("simulator", "verbose")
    }
    given["effects"] = (
        given["effects"] if isinstance(given["effects"], str) else ", ".join(map(_code, given["effects"]))
    )
    given["exclude"] = ", ".join(map(_code, given["exclude"])) or "none"
    versions = {
        "narx_sklearn": __version__,
        "Python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "scikit-learn": sklearn.__version__,
        "numba": numba.__version__,
    }
    rows = list(facts)
    rows += [(key, number(value) if value is not None else "automatic") for key, value in given.items()]
    rows += list(versions.items())
    return TableText("Record, result, settings and versions", ("name", "value"), tuple(rows))


def next_steps(dx, experiment=None) -> list[str]:
    """Return what to try next, in sentences."""
    steps = [str(finding) for finding in dx.data_findings_]
    if experiment is not None and experiment.separation < 1:
        pairs = _listed([pair.replace(" / ", " from ") for pair in experiment.pairs])
        steps.append(
            f"No input of this range tells {pairs}: with the values found here they do the same. "
            "Take the simplest."
        )
    elif experiment is not None:
        pairs = _listed([pair.replace(" / ", " from ") for pair in experiment.pairs])
        steps.append(
            f"Record with this input: {experiment.kind}. It tells {pairs} with a chance of "
            f"{percent(experiment.chance)} (they part by {number(experiment.separation)} times the noise)."
        )
    for finding in dx.findings_:
        if finding.lookalikes and finding.separate_by:
            others = _listed(readable(finding.lookalikes), "or")
            steps.append(f"To tell {finding.title} from {others}: {finding.separate_by}.")
    if dx.verdict_ == "consistent":
        steps.append(
            "These data show nothing missing only where the machine went: record again with a larger "
            "amplitude, lower speeds and reversals if the simulation is to be trusted there."
        )
    if dx.verdict_ == "refit" and not what_a_refit_harms(dx):
        steps.append("Take over the refitted parameters; nothing needs to be added to the equations.")
    unmodelled = [finding.separate_by for finding in dx.findings_ if not finding.modelled]
    if unmodelled:
        steps.append(f"What would tell more: {'; '.join(unmodelled)}.")
    elif dx.verdict_ == "unknown":
        steps.append(
            "Look at the curve above: what in the machine depends on that signal in this way? Register it as "
            "an effect of your own and diagnose again."
        )
    worse = has_form(dx) and not dx.scores_.empty
    worse = worse and dx.scores_.loc["augmented", "nrmse"] >= dx.scores_.loc["refitted", "nrmse"]
    if has_form(dx) and dx.conclusion_.leaves_all_out:
        steps.append(
            "Do not add what was found yet: held-out data speak against it, and the corrected simulation has "
            "refitted parameters alone. Record longer, or try effects that you believe in one by one."
        )
    elif worse:
        steps.append(
            "Do not use the corrected simulation yet: on held-out data it is no better than the refitted "
            "one. Record longer, or try effects that you believe in one by one."
        )
    elif dx.findings_ and dx.verdict_ == "explained":
        steps.append("Use the corrected simulation, and confirm it on a recording of another amplitude.")
    if dx.scores_.empty:
        steps.append("Record longer: no held-out stretch was long enough for a verification.")
    return steps


def _code(effect) -> str:
    return getattr(effect, "code", effect)

"""The diagnosis in words, for a terminal."""

import numpy as np

from narx_sklearn.discrepancy.findings import parameter_names, where_names_stand_in
from narx_sklearn.discrepancy.fitting.acting import port_in_words
from narx_sklearn.discrepancy.locate.invariances import NOT_TOLD
from narx_sklearn.discrepancy.narrow import what_lies_at_bounds
from narx_sklearn.discrepancy.results import (
    CHANGES,
    DISTURBED,
    LEAST,
    NOTHING_MISSING,
    STANDS_IN,
    VERDICTS,
    p_text,
)
from narx_sklearn.discrepancy.search.confirm import is_drift
from narx_sklearn.discrepancy.search.unnamed.kinds import LINE, PULSE, WORDS
from narx_sklearn.discrepancy.stages.temporary import are_foreseen
from narx_sklearn.discrepancy.stages.unforeseen import ADDED, FACTOR, GAIN
from narx_sklearn.model.units import in_seconds, rounded

WANDERS = 3.0  # times what noise about a level leaves, that nothing but noise may leave unsaid
ADDS_UP = 3.0  # times what a corrected simulation leaves in windows, that a whole run may leave unsaid
A_FACTOR = 0.05  # relative: changes of parameters as near to each other are by one factor
DRIFTS = 0.99  # of what noise was a sample ago: what keeps more of it drifts
FEWEST_DIGITS, MOST_DIGITS = 4, 8  # with which a number is written


def report_text(dx) -> str:
    """Return the report of a fitted DiscrepancyRegressor as plain text."""
    lines = [f"Verdict: {dx.verdict_}. {verdict_sentence(dx)}", ""]
    lines += _record(dx)
    lines += _twin(dx)
    lines += _what(dx)
    lines += _parameters(dx)
    lines += _scores(dx)
    lines += _extrapolation(dx)
    lines += _noise(dx)
    return "\n".join(lines).rstrip() + "\n"


def verdict_sentence(dx) -> str:
    """Return what a verdict says."""
    if dx.verdict_ == "unknown" and dx.conclusion_.diagnosis.record_misleads:
        return "The record itself seems to be wrong; mend it first, for what it misses is taken for physics."
    if dx.verdict_ == "unknown" and dx.conclusion_.diagnosis.steps_miss:
        return "What the simulation misses may be the error of its own integration steps."
    if dx.verdict_ == "refit" and (narrow := dx.conclusion_.diagnosis.narrow):
        one = len(narrow) == 1
        return (
            f"No physics is missing; the {'bound' if one else 'bounds'} given for "
            f"{_listed([at.parameter.name for at in narrow])} {'is' if one else 'are'} too narrow."
        )
    if dx.verdict_ == "refit" and dx.conclusion_.diagnosis.is_apart:
        return "No physics is missing; the simulation's parameters are off, and not the same in all sessions."
    if is_for_its_time_only(dx):
        return (
            "Physics is missing; what is named acts for a while only, and no sample that was held out "
            "confirms it."
        )
    other = what_is_no_law(dx)
    return f"{other}." if other else VERDICTS[dx.verdict_]


def what_is_no_law(dx) -> str:
    """Return that the simulation's own parameters change or pulsate, or that something acts by itself.

    Empty where what was found is, or may be, a law that the simulation lacks.
    """
    known = dx.conclusion_.diagnosis.unforeseen is not None  # it leads, and laws may go with it
    titles = {finding.title for finding in dx.findings_[: 1 if known else None]}
    if dx.verdict_ != "unknown" or not titles:
        return ""
    if titles <= {WORDS[LINE].title, WORDS[PULSE].title, GAIN, FACTOR}:
        return CHANGES
    return DISTURBED if titles <= {ADDED} else ""


def _record(dx) -> list[str]:
    if not dx.data_findings_:
        return []
    return ["Before physics:", *(f"   {finding}" for finding in dx.data_findings_), ""]


def _twin(dx) -> list[str]:
    error = getattr(dx.simulator_, "twin_error_", np.nan)
    if not np.isfinite(error):
        return []
    lines = [
        f"The simulation shows its output alone. A twin stands in for it, with the states "
        f"{_listed(dx.simulator_.states)}; it misses {_percent(error)} of the spread of held-out simulated "
        "output.",
    ]
    if dx.conclusion_.diagnosis.twin_misses_more:
        lines.append("What was found in its equations explains less than that, so it is not believed.")
    return [*lines, ""]


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share >= LEAST else "nothing"


def _listed(signals) -> str:
    names = [str(signal) for signal in signals]
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def _what(dx) -> list[str]:
    lines = [f"Test that nothing is missing: p {p_text(dx.p_value_)}.", ""]
    if not all(finding.stands for finding in dx.findings_):
        lines += ["What comes nearest:", ""]
    for i, finding in enumerate(dx.findings_, start=1):
        title = finding.title[:1].upper() + finding.title[1:]
        lines.append(f"{i}. {title} {finding.place}{finding.when}.")
        lines.append(f"   {finding.sentence}")
        if finding.equation:
            lines.append(f"   {finding.equation}" + (f", {finding.argument}" if finding.argument else ""))
        for name, value in finding.parameters.items():
            if name in finding.untold:
                lines.append(f"   {name}: these data do not tell it")
                continue
            low, high = finding.intervals[name]
            digits = digits_that_part(low, value, high)
            value_text = _quantity(value, finding.units[name], digits)
            is_given = low == high
            interval = "" if is_given else f"   ({low:.{digits}g} to {high:.{digits}g})"
            lines.append(f"   {name} = {value_text}{interval}")
        if finding.together:
            lines.append(f"   Of {_listed(finding.together)} only what they do together is told.")
        if finding.size:
            lines.append(f"   {finding.size}")
        if finding.elsewhere:
            lines.append(f"   It fits as well {', or '.join(finding.elsewhere)}.")
        if finding.rivals:
            lines.append(f"   Just as likely on these data: {'; '.join(finding.rivals)}.")
            lines.append(f"   To tell them apart: {finding.separate_by}.")
        if not finding.modelled:
            lines.append(f"   What would tell more: {finding.separate_by}.")
        lines.append("")
    for said in (what_is_left(dx), what_it_is_like(dx)):
        lines += [said, ""] if said else []
    return lines


def what_is_left(dx) -> str:
    """Return what speaks against a diagnosis in what it leaves; empty where nothing does."""
    if dx.verdict_ in NOTHING_MISSING:
        return _what_wanders(dx)
    if not any(finding.modelled for finding in dx.findings_):
        return ""
    words = []
    if (left := dx.conclusion_.diagnosis.left).share:
        words.append(
            f"These leave {_percent(left.share)} of what could be explained to a law without a name, "
            f"{rounded(left.deviations)} times the noise (root mean square): "
            + (
                "more than a right name with an idealised form would."
                if dx.verdict_ == "unknown"
                else "their form is idealised, or they stand in for a law near to theirs. The parameters' "
                "intervals hold either way."
            )
        )
    against = dx.conclusion_.diagnosis.against_noise
    if against and where_names_stand_in(dx.conclusion_.diagnosis) is None:  # else that is a finding
        words += ["What these leave is no noise.", *(sign.words for sign in against)]
    if (left_there := dx.conclusion_.left_there) > STANDS_IN:
        words.append(
            f"Even fitted to the held-out samples too, these leave {rounded(left_there)} times as much "
            "there as elsewhere (mean square): they stand in for something else, or the machine has changed."
        )
    if (beside := dx.conclusion_.diagnosis.beside) is not None:
        simulator, port = dx.conclusion_.diagnosis.problem.simulator, beside.acting.entry.port
        lasts = in_seconds(beside.memory * simulator.dt, 2)
        words.append(
            f"Beside these something acts {port_in_words(port, simulator)} that follows no signal (p "
            f"{p_text(beside.p_value)}); it changes within about {lasts}. Whatever else was measured then "
            "may be it, as a further input."
        )
    return " ".join(words)


def _what_wanders(dx) -> str:
    """Return that more is left of an output than its noise leaves, where that comes back to a level."""
    problem = dx.conclusion_.diagnosis.problem
    left = problem.left_over(dx.conclusion_.diagnosis.refitted.model)
    left = np.sqrt(np.sum(left**2, axis=(0, 1)) / np.maximum(problem.seen.sum(axis=(0, 1)), 1))
    noise = np.array([problem.noise.deviation(output) for output in range(left.size)])
    worst = int(np.argmax(left / noise))
    if not left[worst] > WANDERS * noise[worst]:
        return ""
    signal = problem.simulator.outputs[worst]
    there, here = (_quantity(size[worst], signal.unit, digits=2) for size in (left, noise))
    where, when = dx.location_.segments, ""
    if len(where):
        most = where.loc[where["share"].idxmax()]
        when = f", most of it from {in_seconds(most['start_s'])} to {in_seconds(most['stop_s'])}"
    return (
        f"Yet {there} of {signal.name} is left (root mean square{when}) where the noise estimated below "
        f"would leave {here}: something is slowly off, or has moved, a sensor's zero or a load. Noise that "
        "drifts may be off as much."
    )


def what_it_is_like(dx) -> str:
    """Return what a signal without a law, at the likeliest port, depends on; empty where it is not told."""
    if any(finding.modelled for finding in dx.findings_):
        return ""  # a law says it better
    table, against = dx.location_.invariances, dx.location_.against
    readings = table["reading"][table["value"].notna() & (table["reading"] != NOT_TOLD)]
    if not len(readings):
        return ""
    where = port_in_words(dx.location_.likeliest, dx.conclusion_.diagnosis.problem.simulator)
    x, v, u = against
    return f"Seen as an unknown signal {where}, with x = {x}, v = {v} and u = {u}: {'; '.join(readings)}."


def what_adds_up(dx) -> str:
    """Return how much more a whole held-out run leaves than the windows of the fit; empty where not much."""
    if dx.scores_.empty or not dx.conclusion_.corrected.effects:
        return ""
    problem = dx.conclusion_.diagnosis.problem
    left = problem.left_over(dx.conclusion_.diagnosis.best.fit.model)
    in_windows = np.sqrt(np.sum(left**2, axis=(0, 1)) / np.maximum(problem.seen.sum(axis=(0, 1)), 1))
    whole = dx.scores_.filter(regex="^rmse").loc["augmented"].to_numpy(dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.nan_to_num(whole / in_windows, posinf=0.0)
    worst = int(np.argmax(times))
    if not times[worst] > ADDS_UP:
        return ""
    signal = problem.simulator.outputs[worst]
    length = problem.simulator.dt * problem.windows.length
    there, here = (_quantity(size[worst], signal.unit, digits=2) for size in (whole, in_windows))
    return (
        f"There the corrected simulation leaves {there} of {signal.name}, in the windows of "
        f"{in_seconds(length, 3)} that were fitted {here}: over a whole run small errors add up, or "
        "something slow is missing."
    )


def what_is_not_confirmed(dx) -> str:
    """Return that held-out samples do not tell of what was found; empty where they do."""
    if not dx.conclusion_.corrected.effects:
        return ""
    if is_for_its_time_only(dx):
        return (
            "Nothing that was held out is followed better with what acts for a while: only the samples of "
            "its time tell its name. A law that always acts, and has no name, may look like it as long as "
            "the machine is moved in one way. A record that holds such a time twice would tell."
        )
    if not dx.conclusion_.is_silent:
        return ""
    return (
        "What was found changes next to nothing of the held-out samples, which neither confirm nor refute it."
    )


def is_for_its_time_only(dx) -> bool:
    """Tell whether names stand that act for a while, and no held-out sample confirms them."""
    return dx.conclusion_.is_unconfirmed and dx.verdict_ in ("explained", "ambiguous")


def _quantity(value: float, unit: str, digits: int) -> str:
    """Return a value with its unit, where it has one."""
    return f"{value:.{digits}g}" + (f" {unit}" if unit not in {"", "-", "1"} else "")


def digits_that_part(*values: float) -> int:
    """Return with how many digits values differ as they are written: four, or more where they are close.

    Examples
    --------
    >>> from narx_sklearn.discrepancy.report_text import digits_that_part
    >>> digits_that_part(0.9, 1.0, 1.1), digits_that_part(44.99987, 44.99991, 45.00012)
    (4, 7)
    """
    digits = range(FEWEST_DIGITS, MOST_DIGITS)
    return next(
        (n for n in digits if len({f"{value:.{n}g}" for value in values}) == len(set(values))), MOST_DIGITS
    )


def _parameters(dx) -> list[str]:
    if dx.parameters_.empty:
        return []
    lines, silent = ["Parameters of the simulation:"], untold_parameters(dx)
    for name, row in dx.parameters_.iterrows():
        if name in silent:
            lines.append(f"   {name}: these data do not tell it, nominal {row['nominal']:.4g}")
            continue
        low, high = row["augmented_low"], row["augmented_high"]
        digits = digits_that_part(low, row["augmented"], high)
        value = _quantity(row["augmented"], row["unit"], digits)
        interval = f"({low:.{digits}g} to {high:.{digits}g})"
        lines.append(f"   {name} = {value}   {interval}, nominal {row['nominal']:.4g}")
    lines += [f"   {said}" for said in about_parameters(dx)]
    return [*lines, ""]


def untold_parameters(dx) -> set[str]:
    """Return the names of the simulation's own parameters of which the record tells no end of what may be."""
    low, high = dx.parameters_["augmented_low"], dx.parameters_["augmented_high"]
    lower, upper = dx.conclusion_.diagnosis.problem.simulator.bounds.T
    untold = (low <= lower) & (high >= upper) & (lower < upper)
    return set(dx.parameters_.index[untold])


def about_parameters(dx) -> list[str]:
    """Return what is to be said of the simulation's own parameters beside their values, in sentences."""
    told = {finding.evidence["parameter"] for finding in dx.data_findings_ if finding.code == "bounds"}
    told |= untold_parameters(dx)
    said = [*what_lies_at_bounds(dx.conclusion_.diagnosis, told), *_told_together(dx)]
    diagnosis = dx.conclusion_.diagnosis
    if diagnosis.unforeseen is not None or diagnosis.beside is not None:
        said.insert(0, "Fitted beside what acts by itself, of which a refit alone takes a part into them.")
    return said


def _told_together(dx) -> list[str]:
    """Return a sentence for each group of parameters that may change together with nothing to notice.

    Parameters of effects are told only beside the simulator's own.
    """
    diagnosis = dx.conclusion_.diagnosis
    names = [p.name for p in diagnosis.problem.simulator.parameters]
    n_own = len(names)
    for effect in diagnosis.best.fit.model.effects:
        names += [f"{name} of {effect.effect.code.replace('_', ' ')}" for name in parameter_names(effect)]
    directions, said = diagnosis.untold, []
    for group in diagnosis.told_together:
        if group[0] >= n_own:
            continue
        alike = np.isin(np.arange(len(names)), group).astype(float)
        factor = np.allclose(directions.T @ (directions @ alike), alike, atol=A_FACTOR)
        said.append(
            f"Of {_listed([names[i] for i in group])} only what they do together is told: they may all be off"
            f"{' by one factor' if factor else ''} with nothing to notice. Their intervals leave that out."
        )
    return said


def _scores(dx) -> list[str]:
    if dx.scores_.empty:
        return ["No held-out stretch was long enough for a verification.", ""]
    lines = ["Held-out free run (error over the spread of what was held out):", *_errors(dx.scores_)]
    lines += [f"   {said}" for said in (what_adds_up(dx), what_is_not_confirmed(dx)) if said]
    if dx.conclusion_.split.beginnings:
        lines.append(
            "   Something that is missing shows near the end only, so the beginning was held out instead."
        )
    if worse := what_a_refit_harms(dx):
        lines.append(f"   {worse}")
    if left_out := what_is_left_out(dx):
        lines.append(f"   {left_out}")
    return [*lines, ""]


def what_a_refit_harms(dx) -> str:
    """Return that parameters refitted alone are surely worse than those given; empty where they are not."""
    if dx.scores_.empty or not dx.scores_["nrmse_low"]["refitted"] > dx.scores_["nrmse_high"]["nominal"]:
        return ""
    problem = dx.conclusion_.diagnosis.problem
    length = in_seconds(problem.simulator.dt * problem.windows.length, 3)
    which, beside = "Refitted parameters are", ""
    if dx.simulator_.effects:  # the corrected simulation has parameters that go with them
        which, beside = "Parameters refitted alone are", " alone"
    return (
        f"{which} worse there than those given: in windows of {length} they took up what they are not. Do "
        f"not take them over{beside}; record motion that tells them apart."
    )


def what_is_left_out(dx) -> str:
    """Return what the corrected simulation leaves out of what was found; empty where it has all of it."""
    found = dx.conclusion_
    n_used, n_found = len(found.corrected.effects), len(found.diagnosis.best.effects)
    if dx.verdict_ in NOTHING_MISSING:
        return ""
    if found.diagnosis.unforeseen is not None and found.leaves_all_out:
        return (
            "They are disturbed too, and refitted parameters, which hold a part of that, do better there: "
            "these are what the corrected simulation has."
        )
    if n_used == n_found:
        return ""
    if n_used:
        return "Nobody can foresee the course of a drift: the corrected simulation leaves it out."
    if dx.verdict_ in ("explained", "ambiguous"):
        effects = found.diagnosis.best.effects
        if are_foreseen(effects) and not any(is_drift(effect) for effect in effects):
            return (
                "It does parts of them good that are as short as what was fitted, but whole runs harm: the "
                "corrected simulation leaves it out, and has refitted parameters alone."
            )
        return (
            "Nobody can foresee the course of a drift, or when what has begun will end: the corrected "
            "simulation leaves it out."
        )
    if any(finding.modelled for finding in dx.findings_):
        return "What comes nearest does held-out samples no good: the corrected simulation leaves it out."
    return ""


def _errors(scores) -> list[str]:
    """Return a line for each simulation."""
    lines = []
    for name, row in scores.iterrows():
        if not np.isfinite(row["nrmse"]):
            lines.append(f"   {name:<10} its free run leaves the finite range")
            continue
        interval = f"{100 * row['nrmse_low']:.3g} to {100 * row['nrmse_high']:.3g} %"
        lines.append(f"   {name:<10} {100 * row['nrmse']:.3g} %   ({interval})")
    return lines


def _extrapolation(dx) -> list[str]:
    said = how_it_extrapolates(dx)
    if not said:
        return []
    return [said, *(_errors(dx.extrapolation_) if not dx.extrapolation_.empty else []), ""]


def how_it_extrapolates(dx) -> str:
    """Return what the table of louder motion is of, or why there is none; empty where none is expected."""
    found = dx._extrapolation
    quiet, loud = (f"{reach:.2g}" for reach in (found.amplitudes.quiet_reach, found.amplitudes.loud_reach))
    if found.silent:
        return (
            f"What was found does not show in quiet motion (outputs within {quiet} spreads of their mean): "
            "how it extrapolates from there to louder motion cannot be told."
        )
    if found.scores.empty:
        return ""
    return (
        f"Fitted anew to quiet motion alone (outputs within {quiet} spreads of their mean), error over the "
        f"spread of louder motion (up to {loud} spreads):"
    )


def _noise(dx) -> list[str]:
    return ["Noise estimated on:", *(f"   {name}: {noise_in_words(n)}" for name, n in dx.noise_.items())]


def noise_in_words(noise: dict) -> str:
    """Return how large the noise of an output is, and of which colour.

    Colour that adds nothing to its size, as it is written, is next to none.

    Examples
    --------
    >>> from narx_sklearn.discrepancy.report_text import noise_in_words
    >>> noise_in_words({"sigma": 0.2, "deviation": 0.5, "autoregression": [0.9], "moving_average": 0.0})
    '0.5, 0.2 of it new in each sample, coloured, order 1'
    >>> noise_in_words({"sigma": 0.2, "deviation": 0.2001, "autoregression": [0.9], "moving_average": 0.9})
    '0.2, next to white, with a slow part'
    """
    new, whole = f"{noise['sigma']:.3g}", f"{noise['deviation']:.3g}"
    order = len(noise["autoregression"])
    if not order and not noise["moving_average"]:
        return f"{new}, white"
    kind = "with a slow part" if noise["moving_average"] else f"order {order}"
    if noise["moving_average"] and noise["autoregression"][0] > DRIFTS:
        colour = "drifting"
    elif whole == new:
        return f"{new}, next to white, {kind}"
    else:
        colour = f"coloured, {kind}"
    if not np.isfinite(noise["deviation"]):
        return f"{new} new in each sample, {colour}"
    return f"{whole}, {new} of it new in each sample, {colour}"

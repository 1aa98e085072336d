"""From fitted effects to findings in words and units."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import compress

import numpy as np

from narx_sklearn.discrepancy.dependence import dependence_in_words
from narx_sklearn.discrepancy.fitting.acting import (
    added_in_words,
    correction,
    correction_name,
    correction_unit,
    name_added,
    port_in_words,
    unit_added,
)
from narx_sklearn.discrepancy.locate import felt_at
from narx_sklearn.discrepancy.location import Location
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.results import Finding
from narx_sklearn.discrepancy.search.candidate import HARDLY, OUTSIDE, Candidate
from narx_sklearn.discrepancy.search.inference import lost_together
from narx_sklearn.discrepancy.search.lookalikes import ALIKE, at_home, is_one_law, unpaid
from narx_sklearn.discrepancy.search.unnamed.kinds import is_unnamed
from narx_sklearn.discrepancy.search.unnamed.polynomials import ANYWHERE, ENDS
from narx_sklearn.discrepancy.simulators.simulator import Simulator, Windows
from narx_sklearn.discrepancy.stages.coloured_search import pool_of
from narx_sklearn.discrepancy.stages.diagnosis import Diagnosis
from narx_sklearn.discrepancy.stages.unforeseen import TO_TRY, Unforeseen
from narx_sklearn.model.units import in_seconds, tidy_unit

MOST_ASKED = 2000  # samples at which it is asked what an effect adds
NOTHING = 1e-3  # of the most that an effect adds
ROUNDING = 1e-9  # of the same
COARSE = 3.0  # times as large as between exact forms must a difference of the criterion be
RULED = 2.0  # difference of the criterion that the rules of naming are worth
PASSES_FOR_NAMES = 1 / 7  # of what no catalogue holds, that is named nevertheless, as measured
NO_RESONANCE = np.sqrt(0.5)  # damping ratio, from which a mode has none: it follows, and does not swing
AS_FAST = 0.1  # of a frequency, within which it is known: else that another is as fast says nothing
HOUR = 3600.0  # seconds, from which a period is told in hours too
SECOND_LETTERS = "uwL"  # of second arguments in the equations of the catalogue


def make_findings(
    diagnosis: Diagnosis, verdict: str, level: float, simulator: Simulator, location: Location
) -> list[Finding]:
    """Return the findings of a diagnosis, what follows no signal first, then those that explain most.

    What is no noise but has no name or curve is said to enter where it follows a signal, or else at the
    likeliest port of a location. Where the ``verdict`` is *unknown* in the end, which held-out samples may
    say of names, none of these stands.
    """
    best, base = diagnosis.best, diagnosis.refitted
    found = []
    if diagnosis.unforeseen is not None:
        found.append(_unforeseen(diagnosis, diagnosis.unforeseen, simulator, location))
    elif not best.effects and diagnosis.verdict == "unknown":
        found.append(_shapeless(diagnosis, simulator, where_it_follows(diagnosis) or location.likeliest))
    if not best.effects:
        return found
    if (port := where_names_stand_in(diagnosis)) is not None:
        found.append(_beside_names(diagnosis, simulator, port))
    sure = diagnosis.intervals(level)
    compared = diagnosis.compared
    share = 1 - compared.fit.cost / base.cost
    added = list(_added(diagnosis))
    told: dict[int, tuple[PlacedEffect, np.ndarray]] = {}
    for i in diagnosis.order:
        placed, rivals = best.effects[i], diagnosis.alternatives[i]
        there = parameters_it_has(placed)
        names = list(compress(parameter_names(placed), there))
        values = list(compress(placed.theta, there))
        units = list(compress(parameter_units(placed, simulator), there))
        own = sure[best.fit.model.theirs[i]]
        rows, domain = own[there], placed.domain[there]
        untold = np.all(rows == domain, axis=1) & (np.ptp(domain, axis=1) > 0)
        found.append(
            Finding(
                effect="unknown" if is_unnamed(placed) else placed.name.code,
                title=placed.name.title,
                sentence=dependence_in_words(placed, rows, simulator)
                or " ".join(
                    filter(
                        None,
                        (
                            placed.name.sentence,
                            seen_in_words(placed),
                            alike_before(placed, own, told) or period_in_words(placed),
                            build_in_words(placed, own),
                        ),
                    )
                ),
                equation=placed.effect.equation,
                port=str(felt_at(placed, diagnosis.problem, best.fit.model)),
                place=place_in_words(placed, simulator),
                argument=argument_told(placed),
                parameters=dict(zip(names, map(float, values), strict=True)),
                intervals=dict(zip(names, [(float(a), float(b)) for a, b in rows], strict=True)),
                units=dict(zip(names, units, strict=True)),
                lookalikes=tuple(dict.fromkeys(e.name.code for c in rivals for e in _rivals(c, best))),
                rivals=tuple(dict.fromkeys(_in_words(_rivals(c, best), simulator) for c in rivals)),
                p_value=diagnosis.p_missing,
                elsewhere=_elsewhere(diagnosis, i, simulator),
                confidence=_confidence(diagnosis, i),
                improvement=float(share),
                separate_by=placed.effect.separate_by,
                during=placed.during[:2] if placed.passes else None,
                in_sessions=sessions_in_words(placed, diagnosis.problem.windows, simulator.dt),
                untold=tuple(compress(names, untold)),
                together=_together(diagnosis, i),
                adds=_range_of(added[i][1]),
                adds_to=added_in_words(
                    correction_unit(placed, simulator), correction_name(placed, simulator)
                ),
                where=where_in_words(placed, *added[i]),
                stands=verdict != "unknown" or diagnosis.unforeseen is not None,
                evidence={
                    "criterion_gain": float(
                        base.cost and Candidate(base, best.n_samples).criterion - compared.criterion
                    ),
                    "next_best": float(rivals[0].criterion - compared.criterion) if rivals else None,
                },
            )
        )
        told[len(found)] = placed, own
    return found


def _range_of(added: np.ndarray) -> tuple[float, float] | None:
    """Return the least and the most that an effect adds, zero where that is rounding; None if unknown."""
    if not added.size:
        return None
    ends = np.array([added.min(), added.max()])
    ends[np.abs(ends) <= ROUNDING * np.abs(ends).max()] = 0.0
    return float(ends[0]), float(ends[1])


def _together(diagnosis: Diagnosis, i: int) -> tuple[str, ...]:
    """Return which parameters of an effect are told only by what they do together."""
    best = diagnosis.best
    names = parameter_names(best.effects[i])
    own = best.fit.model.theirs[i]
    return tuple(names[k] for k in lost_together(diagnosis.problem, best.fit, own))


def _added(diagnosis: Diagnosis) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield the argument of each effect along the samples fitted, while it acts, and what it adds."""
    problem, model = diagnosis.problem, diagnosis.best.fit.model
    run = problem.run(model)
    rows = problem.samples_of(run)
    for index in range(len(model.effects)):
        _, argument, added = correction(problem, model, run, index, rows, MOST_ASKED)
        known = np.isfinite(added)
        yield argument[known], added[known]


def sessions_in_words(placed: PlacedEffect, windows: Windows, dt: float) -> str:
    """Return in which sessions an effect acts; empty where it acts alike in all.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.findings import sessions_in_words
    >>> from narx_sklearn.discrepancy.placed import PlacedEffect, Port, Span
    >>> from narx_sklearn.discrepancy.simulators.simulator import Windows
    >>> from narx_sklearn.physics.effects import CATALOGUE
    >>> second = Span(10.0, 20.0, along_record=True)
    >>> load = PlacedEffect(CATALOGUE["constant_load"], Port("state", 0), (1.0,), during=second)
    >>> first = np.array([0, 100, 200])
    >>> sessions_in_words(load, Windows(first, first + 80, np.ones(3, dtype=bool), first), dt=0.1)
    'in session 2 of 3'
    """
    during = placed.during
    if not during.along_record:
        return ""
    began = np.unique(windows.began)
    own = windows.began == began[:, None]
    first = np.array([windows.first[of].min() for of in own])
    last = np.array([windows.last[of].max() for of in own]) - 1
    begins, ends = (during.holds(samples, began, dt) for samples in (first, last))
    touched = (during.begins < (last + 1) * dt) & (during.ends > first * dt)
    if not np.array_equal(begins & ends, touched):
        either = zip(("from", "until"), during[:2], strict=True)
        told = [f"{word} {in_seconds(end)}" for word, end in either if np.isfinite(end)]
        return " ".join([*told, "along the record"])
    numbers = (np.flatnonzero(touched) + 1).tolist()
    if len(numbers) > 1 and numbers[-1] == began.size:
        return f"from session {numbers[0]} of {began.size} on"
    these = f"sessions {numbers[0]} to {numbers[-1]}" if len(numbers) > 1 else f"session {numbers[0]}"
    return f"in {these} of {began.size}"


def where_in_words(placed: PlacedEffect, argument: np.ndarray, added: np.ndarray) -> str:
    """Return where an effect acts of the values that its argument takes; empty where it does anywhere.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.findings import where_in_words
    >>> from narx_sklearn.discrepancy.placed import PlacedEffect, Port
    >>> from narx_sklearn.physics.effects import CATALOGUE
    >>> stop = PlacedEffect(
    ...     CATALOGUE["clearance"],
    ...     Port("state", 1),
    ...     (1.0, 0.0),
    ...     theta=(300.0, 5.0, -4.5),
    ...     argument_name="position",
    ...     argument_unit="m",
    ... )
    >>> position = np.linspace(-1.0, 1.0)
    >>> where_in_words(stop, position, -300.0 * np.maximum(position - 0.5, 0.0))
    'position is above 0.5 m'
    """
    if placed.effect.acts_in is None or not argument.size:
        return ""
    spans = placed.effect.acts_in(placed.own_theta)
    outside = ~np.any([(begins <= argument) & (argument <= ends) for begins, ends in spans], axis=0)
    if np.abs(added[outside]).max(initial=0.0) > NOTHING * np.abs(added).max():
        return ""
    low, high = argument.min(), argument.max()
    unit = f" {placed.argument_unit}" if placed.argument_unit else ""
    told = []
    for begins, ends in spans:
        if not (begins < high and ends > low):
            continue
        if begins > low and ends < high:
            told.append(f"between {begins:.4g} and {ends:.4g}{unit}")
        elif begins > low:
            told.append(f"above {begins:.4g}{unit}")
        elif ends < high:
            told.append(f"below {ends:.4g}{unit}")
    return f"{placed.argument_name or 'it'} is {' or '.join(told)}" if told else ""


def where_it_follows(diagnosis: Diagnosis) -> Port | None:
    """Return the port at which what is left over follows a signal, most of it if at several; else None."""
    placed = [sign for sign in diagnosis.against_noise if sign.port is not None]
    return max(placed, key=lambda sign: sign.gain).port if placed else None


def where_names_stand_in(diagnosis: Diagnosis) -> Port | None:
    """Return the port of a law for which names stand in, where what they leave says another than theirs.

    That is what follows a signal where the names act: name and rest come together in one equation, and are
    one law, at the port of what it follows. None where they leave no such thing.
    """
    effects = diagnosis.best.effects
    port = where_it_follows(diagnosis)
    if port is None or diagnosis.unforeseen is not None or any(map(is_unnamed, effects)):
        return None
    theirs = {effect.port for effect in effects}
    together = any(diagnosis.structure.share_equation(port, own) for own in theirs)
    return port if together and port not in theirs else None


def _beside_names(diagnosis: Diagnosis, simulator: Simulator, port: Port) -> Finding:
    """Return the finding of what names that do not stand leave where they act."""
    found = _shapeless(diagnosis, simulator, port)
    against = " ".join(sign.words for sign in diagnosis.against_noise)
    return replace(found, sentence=f"What the names below leave is no noise. {against}", stands=False)


def _shapeless(diagnosis: Diagnosis, simulator: Simulator, port: Port) -> Finding:
    """Return the finding of what has neither name nor curve, but is no noise."""
    against = diagnosis.against_noise
    return replace(
        _without_form(diagnosis, simulator, port),
        title="something without a name",
        sentence=" ".join(["What is left over is no noise.", *(sign.words for sign in against)]),
        confidence=1.0 - diagnosis.p_missing,
        separate_by="; ".join(sign.to_try for sign in against),
        evidence={sign.kind: sign.p_value for sign in against},
    )


def _unforeseen(
    diagnosis: Diagnosis, unforeseen: Unforeseen, simulator: Simulator, location: Location
) -> Finding:
    """Return the finding of what follows no signal."""
    acting = unforeseen.acting
    port, force = acting.entry.port, location.force["force"]
    lasts = in_seconds(unforeseen.memory * simulator.dt, 2)
    return replace(
        _without_form(diagnosis, simulator, port),
        title=acting.title,
        sentence=f"{acting.sentence} It changes within about {lasts}.",
        confidence=(1.0 - OUTSIDE) * (1.0 - unforeseen.p_value),
        separate_by=TO_TRY,
        adds=(float(force.min()), float(force.max())),
        adds_to=added_in_words(unit_added(port, simulator), name_added(port, simulator)),
        evidence={"unforeseen": unforeseen.p_value},
    )


def _without_form(diagnosis: Diagnosis, simulator: Simulator, port: Port) -> Finding:
    """Return an empty finding of something at a port that has no form."""
    return Finding(
        effect="unknown",
        title="",
        sentence="",
        equation="",
        port=str(port),
        place=port_in_words(port, simulator),
        argument="",
        parameters={},
        intervals={},
        units={},
        lookalikes=(),
        p_value=diagnosis.p_missing,
        improvement=0.0,
    )


def _elsewhere(diagnosis: Diagnosis, i: int, simulator: Simulator) -> tuple[str, ...]:
    """Return the other places, in words, where the same effect, or such a law, fits hardly worse."""
    best = diagnosis.compared
    effect = best.effects[i]
    words = [
        place_in_words(other, simulator)
        for candidate, other in _in_its_place(best, i, pool_of(diagnosis.steps))
        if other.effect is effect.effect and candidate.criterion <= best.criterion + HARDLY
    ]
    if effect is best.effects[-1]:
        words += [place_in_words(law, simulator) for law in best.elsewhere]
    here = place_in_words(effect, simulator)
    return tuple(dict.fromkeys(word for word in words if word != here))


def _confidence(diagnosis: Diagnosis, i: int) -> float:
    """Return the weight of this effect among all that were tried in its place, from the criterion.

    Forms are idealised, so that differences of the criterion say less than they would of exact ones (Miller
    and Dunson 2019, Robust Bayesian inference via coarsening). What the rules of naming put first goes before
    what fits as well: the simplest, by its name in such a motion, and more so what is at home where it acts.
    A share is left to what no catalogue holds; a small one where that would hardly have passed for names.
    What names visibly leave speaks for it: the logarithm of its odds grows with that, and they are even where
    the names would not stand.
    """
    best = diagnosis.compared
    is_at_home = at_home(best)
    weights: dict[str, float] = {best.effects[i].effect.code: 1.0}
    rivals = (c for some in diagnosis.alternatives for c in some)
    for candidate, other in _in_its_place(best, i, [*pool_of(diagnosis.steps), *rivals]):
        one_law = is_one_law(best, other)
        price = unpaid(candidate, best) - unpaid(best, candidate)  # of shapes that the data do not feel
        worse = 0.0 if one_law else max(candidate.criterion + price - best.criterion, 0.0) / COARSE
        worse += RULED + ALIKE * one_law + HARDLY * (is_at_home and not at_home(candidate))
        code = other.effect.code
        weights[code] = max(weights.get(code, 0.0), float(np.exp(-0.5 * worse)))
    outside = OUTSIDE * (PASSES_FOR_NAMES if diagnosis.is_named else 1.0)
    odds = (outside / (1.0 - outside)) ** (1.0 - diagnosis.left.doubt)
    outside = odds / (1.0 + odds)
    return (1.0 - outside) * (1.0 - diagnosis.p_missing) / sum(weights.values())


def _in_its_place(
    best: Candidate, i: int, candidates: Iterable[Candidate]
) -> Iterator[tuple[Candidate, PlacedEffect]]:
    """Yield the candidates that have something else for one effect of a set, or it elsewhere, and that."""
    place = best.effects[i].place
    kept = best.places - {place}
    for candidate in candidates:
        others = [e for e in candidate.effects if e.place not in kept]
        if len(candidate.effects) == len(best.effects) and len(others) == 1 and others[0].place != place:
            yield candidate, others[0]


def _rivals(candidate: Candidate, best: Candidate) -> list[PlacedEffect]:
    """Return the effects of a candidate that the best has not."""
    return [e for e in candidate.effects if e.place not in best.places]


def _in_words(effects: Iterable[PlacedEffect], simulator: Simulator) -> str:
    return " and ".join(f"{placed.name.title} {place_in_words(placed, simulator)}" for placed in effects)


def parameters_it_has(placed: PlacedEffect) -> np.ndarray:
    """Tell which parameters a law has: one without a name lacks those that are held at zero on a record.

    They are coefficients of a polynomial's dropped terms, or from where a signal is counted that is counted
    from zero. Nor are the ends of what it was seen over parameters of it.
    """
    if not is_unnamed(placed):
        return np.ones(placed.n_theta, dtype=bool)
    held = (np.ptp(placed.bounds, axis=1) == 0) & (np.ptp(placed.domain, axis=1) > 0)
    dropped = held & (np.array(placed.theta) == 0)
    return ~(dropped | np.isin(parameter_names(placed), [name for name, _ in ENDS]))


def seen_in_words(placed: PlacedEffect) -> str:
    """Return over what a polynomial without a name was seen; empty for what is none.

    Examples
    --------
    >>> from narx_sklearn.discrepancy.findings import seen_in_words
    >>> from narx_sklearn.discrepancy.placed import PlacedEffect, Port
    >>> from narx_sklearn.physics.effects import CATALOGUE
    >>> seen_in_words(PlacedEffect(CATALOGUE["cubic_stiffness"], Port("state", 1), theta=(1.0,)))
    ''
    """
    values = dict(zip(parameter_names(placed), placed.theta, strict=True))
    ends = [values[name] for name, _ in ENDS if name in values]
    if not ends or ends == [*ANYWHERE]:
        return ""
    x, v = (f"from {a:.3g} to {b:.3g}" for a, b in (ends[:2], ends[2:]))
    unit = placed.argument_unit
    rate = tidy_unit(f"{unit}/s") if unit else ""
    seen = f"It was seen for {placed.argument_name} {x} {unit}".rstrip() + f", its rate v {v} {rate}".rstrip()
    return f"{seen}; beyond that it stays as it is there."


def period_in_words(placed: PlacedEffect) -> str:
    """Return how long a period takes of what swings, or how fast what is damped follows; else nothing.

    A mode has a resonance where its damping ratio is below the root of a half. Beyond that it follows
    with the time constant of its slowest pole.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.findings import period_in_words
    >>> from narx_sklearn.discrepancy.placed import PlacedEffect, Port
    >>> from narx_sklearn.physics.effects import CATALOGUE
    >>> hum = CATALOGUE["periodic_disturbance"]
    >>> period_in_words(PlacedEffect(hum, Port("state", 1), theta=(0.2, 100 * np.pi, 0.0)))
    'One period takes 0.02 s.'
    >>> period_in_words(PlacedEffect(hum, Port("state", 1), theta=(0.2, 2 * np.pi / 86400, 0.0)))
    'One period takes 86400 s (24 h).'
    >>> mode = CATALOGUE["extra_mode"]  # with poles at -2 and -50 rad/s
    >>> period_in_words(PlacedEffect(mode, Port("state", 1), theta=(1.0, 10.0, 2.6)))
    'It follows with a time constant of 0.5 s.'
    """
    values = dict(zip(placed.effect.parameters, map(float, placed.own_theta), strict=True))
    w = next((value for p, value in values.items() if p.unit == "rad/s"), 0.0)
    if not w > 0:
        return ""
    zeta = next((value for p, value in values.items() if p.name == "zeta"), 0.0)
    pole = w * np.sqrt(complex(zeta**2 - 1.0)) - w * zeta  # the slower one, where they are real
    swings = zeta < NO_RESONANCE
    time = 2 * np.pi / pole.imag if swings else -1.0 / pole.real
    hours = f" ({time / HOUR:.4g} h)" if time >= HOUR else ""
    said = "One period takes" if swings else "It follows with a time constant of"
    return f"{said} {in_seconds(time, 4)}{hours}."


def alike_before(
    placed: PlacedEffect, sure: np.ndarray, told: Mapping[int, tuple[PlacedEffect, np.ndarray]]
) -> str:
    """Return that what swings is as fast, and damped alike, as what was told before; empty where it is not.

    A frame that swings is felt by every body on it, and a hum by every sensor: one thing, at several places.

    Parameters
    ----------
    sure : ndarray of shape (n_parameters, 2)
        Confidence intervals of the effect's parameters.
    told : mapping of {int: (PlacedEffect, ndarray)}
        The same of the effects told before, by the numbers of their findings.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.findings import alike_before
    >>> from narx_sklearn.discrepancy.placed import PlacedEffect, Port
    >>> from narx_sklearn.physics.effects import CATALOGUE
    >>> first, second = (PlacedEffect(CATALOGUE["extra_mode"], Port("state", k), theta=(9.0, 17.3, 0.03))
    ...                  for k in (1, 3))
    >>> sure = np.array([[8.0, 10.0], [17.2, 17.4], [0.02, 0.04]])
    >>> alike_before(second, sure, {1: (first, sure + 0.01)})
    'It is as fast as no. 1, and damped alike: one thing, most likely, that is felt at both places.'
    >>> alike_before(second, sure, {1: (first, sure + [[0.0], [1.0], [0.0]])})
    ''
    >>> alike_before(second, np.array([[8.0, 10.0], [0.0, 50.0], [0.02, 0.04]]), {1: (first, sure)})
    ''
    """
    own = _swinging(placed, sure)
    for number, (before, theirs) in told.items():
        same = before.effect.code == placed.effect.code
        others = _swinging(before, theirs) if same else np.empty((0, 2))
        if len(own) and len(others) and np.all((own[:, 0] <= others[:, 1]) & (others[:, 0] <= own[:, 1])):
            alike = ", and damped alike" if len(own) > 1 else ""
            return (
                f"It is as fast as no. {number}{alike}: one thing, most likely, that is felt at both places."
            )
    return ""


def _swinging(placed: PlacedEffect, sure: np.ndarray) -> np.ndarray:
    """Return the intervals (n, 2) of frequency and damping of what surely swings; none where it may not."""
    at = {p.name: k for k, p in enumerate(placed.effect.parameters) if p.unit == "rad/s" or p.name == "zeta"}
    rows = sure[list(at.values())]
    for name, (low, high) in zip(at, rows, strict=True):
        is_told = high < NO_RESONANCE if name == "zeta" else high - low < AS_FAST * low
        if not is_told:
            return np.empty((0, 2))
    return rows


def build_in_words(placed: PlacedEffect, sure: np.ndarray) -> str:
    """Return whether what may be made of parts or of code is the one or the other; empty for what may not.

    Parameters
    ----------
    sure : ndarray of shape (n_parameters, 2)
        Confidence intervals of the effect's parameters.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.findings import build_in_words
    >>> from narx_sklearn.discrepancy.placed import PlacedEffect, Port
    >>> from narx_sklearn.physics.effects import CATALOGUE
    >>> lag = PlacedEffect(CATALOGUE["lag"], Port("input", 0), theta=(3.0, 0.8, 1.0))
    >>> build_in_words(lag, np.array([[2.9, 3.1], [0.7, 0.9], [0.98, 1.0]]))
    'It goes from sample to sample, as in code (d = 1).'
    >>> build_in_words(lag, np.array([[2.9, 3.1], [0.7, 0.9], [0.0, 1.0]]))
    'Whether it is made of parts (d = 0) or of code (d = 1), these data do not tell.'
    """
    at = placed.effect.choice if placed.effect.form is None else placed.effect.form
    if at is None or placed.effect.held is None:  # a shape, as of a ripple or a zone
        return ""
    if placed.put_out or placed.is_how_it_follows:  # within the equations it goes on
        return ""
    low, high = sure[at]
    name = placed.effect.parameters[at].name
    if low <= 0.0 and high >= 1.0:
        return f"Whether it is made of parts ({name} = 0) or of code ({name} = 1), these data do not tell."
    if high >= 1.0:
        return f"It goes from sample to sample, as in code ({name} = 1)."
    if low <= 0.0:
        return f"It goes on between samples, as in parts ({name} = 0)."
    return f"It goes partly from sample to sample, as in code, and partly between samples ({name})."


def parameter_names(placed: PlacedEffect) -> list[str]:
    """Return the names of the effect's parameters, the share that goes on included."""
    last = "tracking" if placed.tracks else "reaction_ratio" if placed.reacts else "share_onward"
    return [p.name for p in placed.effect.parameters] + [last] * (placed.onward >= 0)


def parameter_units(placed: PlacedEffect, simulator: Simulator) -> list[str]:
    """Return the units of the effect's parameters, with the port's and the argument's units put in."""
    port = placed.argument_unit if placed.is_how_it_follows else correction_unit(placed, simulator)
    second = placed.second_unit or "-" if placed.second else port
    argument = second if placed.is_fed else placed.argument_unit or "-"
    fill = {"port": port, "arg": argument, "second": second}
    units = [tidy_unit(p.unit.format(**fill)) for p in placed.effect.parameters]
    return units + ["1/s" if placed.tracks else "-"] * (placed.onward >= 0)


def place_in_words(placed: PlacedEffect, simulator: Simulator) -> str:
    """Return where an effect enters: "in the equation of velocity", "on the input drive"."""
    words = port_in_words(placed.port, simulator)
    if placed.port.is_parameter:
        return f"{words}, with {placed.second_name}" if placed.second_name else words
    if placed.through >= 0 and placed.handed_on:
        return f"behind {placed.argument_name}, as the equations have it"
    if placed.through >= 0:
        return f"beside the input {simulator.inputs[placed.through].name}"
    if placed.handed_on:
        name = simulator.states[placed.port.index].name
        follows = f"; {name} follows what is left" if placed.tracks else ""
        and_outputs = " and the outputs" if placed.is_seen else ""
        return f"behind {placed.argument_name}, as the other equations{and_outputs} have it{follows}"
    if placed.reacts and placed.theta and not placed.theta[-1]:
        return words  # the neighbour does not feel it
    if placed.reacts:
        words += f", and back in that of {simulator.states[placed.onward].name}"
    elif placed.onward >= 0:
        words += f", going on to {simulator.states[placed.onward].name}"
    return words


def argument_told(placed: PlacedEffect) -> str:
    """Return what the equation's letters stand for: "v = velocity [m/s]"; empty where it has no letter."""
    is_rate = placed.effect.argument == "own" and not is_unnamed(placed)
    letters = "sx" if placed.port.kind != "state" else "vxs" if is_rate else "xs"
    told = []
    if not placed.is_fed or placed.handed_on:
        told.append(_letter(placed.effect.equation, letters, placed.argument_name, placed.argument_unit))
    if placed.second and not placed.handed_on:
        told.append(_letter(placed.effect.equation, SECOND_LETTERS, placed.second_name, placed.second_unit))
    return ", ".join(filter(None, told))


def _letter(equation: str, letters: str, name: str, unit: str) -> str:
    for letter in letters:
        if re.search(rf"\b{letter}\b", equation):
            return f"{letter} = {name}{f' [{unit}]' if unit else ''}"
    return ""

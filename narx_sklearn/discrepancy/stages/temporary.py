"""Effects that act for a while only, looked for where the rest of the record leaves a mismatch."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed

from narx_sklearn.discrepancy.fitting.acting import age_of
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit, fit_states
from narx_sklearn.discrepancy.locate.segments import MOST_BLOCKS
from narx_sklearn.discrepancy.noise import Noise, estimate_noise
from narx_sklearn.discrepancy.placed import PlacedEffect, Span
from narx_sklearn.discrepancy.search.bank import Bank, make_bank, out_of
from narx_sklearn.discrepancy.search.candidate import FINE, HARDLY, Candidate, price_of_an_end
from narx_sklearn.discrepancy.search.confirm import DRIFTS, chance_of_noise, clearer_noise, deviance, n_shapes
from narx_sklearn.discrepancy.search.explain import IN_REACH, Step, refit_leaders
from narx_sklearn.discrepancy.search.lookalikes import likeliest
from narx_sklearn.discrepancy.search.ranking import gains, with_nearest, with_pushes
from narx_sklearn.discrepancy.settings import Settings
from narx_sklearn.discrepancy.simulators.simulator import Windows
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.discrepancy.stages.beginning import states_at
from narx_sklearn.discrepancy.stages.coloured_search import (
    Searched,
    converged,
    hypotheses_of,
    kept_near,
    went_far,
)
from narx_sklearn.discrepancy.stages.in_sessions import sessions_of, to_sessions
from narx_sklearn.discrepancy.stages.stretches import Stretches

OF_TIME = {*DRIFTS, "stuck_sensor", "quantisation"}  # have times of their own, or none
MOST = 0.8  # of the time that was looked at; what acts longer may as well act always
LEADERS = 8  # effects that are fitted
RIVALS = 6  # of those that always act, kept beside
BEYOND = 4.0  # times what its tangent takes off, that an effect may take off once it is fitted
AT_AN_END = 0.02  # of the time, within which a stretch reaches an end of what was looked at
FINEST = 1 / 500  # of the time, to which the ends of a stretch are settled
PASSES = 3  # over both ends, at most
SETTLED = 4  # iterations of a fit when an end is moved


class InSpan(NamedTuple):
    """What was found to act in a span of time."""

    problem: Problem  # under the noise of the rest
    bank: Bank
    candidates: list[Candidate]  # best first
    value: float  # deviance of the best, its price added; that of different spans can be compared


def search_in_spans(
    spans: list[Span],
    p: np.ndarray,
    before: Searched,
    structure: Structure,
    settings: Settings,
) -> Searched | None:
    """Search for effects that act in a span of the record; None where none explains it better.

    What acts for a while bends the parameters and the noise of a fit to the whole record, so both are taken
    from the rest of it. The ends of the span are settled with the effect in it. It must take off more than
    noise of any colour would let the best of all spans, effects and shapes, and be likelier than the best of
    what always acts, each under noise of its own and with its price, and with parameters that anybody may be
    so wrong about.

    Parameters
    ----------
    spans : list of Span
        Where the search begins.
    p : ndarray of shape (n_parameters,)
        Parameters of the simulator from which it begins; from the nominal ones too where these are far away.
    before : Searched
        What the search for effects that always act came to.
    """
    if not spans:
        return None
    problem, refitted, steps = before
    settings.tell("search for what acts for a while")
    bases = _bases(problem, refitted, p)
    always = before.pool
    named = bool(always) and before.p_value <= settings.alpha
    rival = likeliest(always, refitted.cost) if named else None
    looks = (
        _found_in(span, problem.with_noise(noise), base, rival, structure, settings)
        for base in bases
        for span in spans
        for noise in _noises_of_the_rest(span, problem, base)
    )
    found = min((f for f in looks if f is not None), key=lambda f: f.value, default=None)
    if found is None:
        return None
    # within ends that are wrong what bends most comes first, so all have theirs roughly settled
    roughly = _settled_each(found.problem, found.candidates, settings, passes=1)
    near = _near(roughly)
    settled = _settled_each(found.problem, near, settings)
    best = settled[0]
    value = deviance(found.problem, best.fit.model)
    gained = deviance(problem, refitted.model) - value
    n_spans = MOST_BLOCKS**2 / 2  # by their ends
    n_values = n_shapes(best.effects[0], problem) * n_spans
    chance = chance_of_noise(gained, len(found.bank.hypotheses), n_values)
    if chance > settings.alpha_in_part:
        return None
    nominal = problem.simulator.nominal
    if rival and went_far(rival.fit.model.p, nominal) and not went_far(best.fit.model.p, nominal):
        rival = converged(kept_near(problem), rival, settings.n_jobs)
    to_beat = np.inf if rival is None else deviance(problem, rival.fit.model) + rival.price
    if to_beat <= value + best.price + HARDLY:
        return None
    noise, settled = _settled_again(found.problem, settled, value, settings)
    problem = problem.with_noise(noise)
    settled = _looked_at_again(problem, settled, structure, settings)
    models = [c.fit.model for c in [*settled, *always[:RIVALS]]]
    span = settled[0].effects[0].during
    models += [_in_span(c, span) for c in roughly[len(near) :]]
    step = Step(steps[0].detection._replace(p_value=chance), found.bank, _fitted(problem, models, settings))
    return Searched(problem, fit(problem, refitted.model), [step])


def _bases(problem: Problem, refitted: Fit, p: np.ndarray) -> list[Model]:
    """Return the models of the simulator alone from which spans are searched.

    What acts for a third of the time, as a leak of something that integrates, may bend parameters so far that
    no fit with it leads back, even those of the quieter half. There the nominal ones are begun from too.
    """
    nominal = problem.simulator.nominal
    begun = [p, nominal] if went_far(p, nominal) else [p]
    spared = [fit_states(problem, refitted.model._replace(p=p)) for p in begun]
    return [s.model for s in spared if np.isfinite(s.cost)] or [refitted.model]  # a run may diverge elsewhere


def _fitted(problem: Problem, models: list[Model], settings: Settings) -> list[Candidate]:
    """Return the models fitted to the end, those that run."""
    fits = Parallel(n_jobs=settings.n_jobs, prefer="threads")(
        delayed(fit)(problem, model, iterations=FINE) for model in models
    )
    return [Candidate(f, problem.n_seen) for f in fits if np.isfinite(f.cost)]


def only_where_fitted(problem: Problem, candidate: Candidate) -> Candidate | None:
    """Return a set whose effects do not act beyond the samples fitted, where one did but not always."""
    model = candidate.fit.model

    def within_fitted(effect: PlacedEffect) -> PlacedEffect:
        if not effect.passes:
            return effect
        return effect.acting(effect.during.within(*_ends(problem, effect.during.along_record)))

    effects = tuple(within_fitted(e) for e in model.effects)
    if effects == model.effects:
        return None
    given = sum(2 - e.during.n_ends for e in model.effects if e.passes)
    return replace(candidate, fit=candidate.fit._replace(model=model._replace(effects=effects)), given=given)


def _ends(problem: Problem, along_record: bool = False) -> tuple[float, float]:
    """Return when the samples fitted begin and end, at the earliest and at the latest of all sessions."""
    windows, dt = problem.windows, problem.simulator.dt
    began = 0 if along_record else windows.began
    return float((windows.first - began).min()) * dt, float((windows.last - began).max()) * dt


def spans_of(stretches: Stretches, problem: Problem) -> list[Span]:
    """Return the times between which something may have acted: all stretches together, and the largest.

    Where one reaches an end, what acted may as well be missing in it and there in the rest, which was taken
    for ordinary. In several sessions it acts at the same time of each.
    """
    table, dt = stretches.table, problem.simulator.dt
    if not len(table):
        return []
    start = age_of(problem.windows, table["start"].to_numpy()) * dt
    stop = start + (table["stop"] - table["start"]).to_numpy() * dt
    largest = int(table["share"].to_numpy().argmax())
    first, last = _ends(problem)
    near = AT_AN_END * (last - first)
    found: list[Span] = []
    for a, b in ((start.min(), stop.max()), (start[largest], stop[largest])):
        if b - a <= MOST * (last - first):
            begins = -np.inf if a - first < near else float(a)
            ends = np.inf if last - b < near else float(b)
            found += [Span(begins, ends)]
            found += [Span(ends, np.inf)] * (begins == -np.inf) + [Span(-np.inf, begins)] * (ends == np.inf)
    return list(dict.fromkeys(found)) + [
        session
        for session in sessions_of(problem, stretches.residual)
        if np.any((table["stop"] * dt > session.begins) & (table["start"] * dt < session.ends))
    ]


def may_stand_in(effects: Sequence[PlacedEffect]) -> bool:
    """Tell whether a set may stand in for what acts for a while: a drift, or several.

    Two sines that beat are one that comes and goes.
    """
    return len(effects) > 1 or any(effect.effect.code in DRIFTS for effect in effects)


def are_foreseen(effects: Iterable[PlacedEffect]) -> bool:
    """Tell whether a set acts alike on other samples: nothing drifts, begins or ends."""
    return not any(effect.passes or effect.effect.code in DRIFTS for effect in effects)


def large_parts(problem: Problem, residual: np.ndarray) -> list[Span]:
    """Return the halves of the time that is looked at, its middle, and sessions."""
    first, last = _ends(problem)
    quarter = 0.25 * (last - first)
    halves = Span(-np.inf, first + 2 * quarter), Span(last - 2 * quarter, np.inf)
    return [halves[0], Span(first + quarter, last - quarter), halves[1], *sessions_of(problem, residual)]


def _acting(span: Span, problem: Problem) -> np.ndarray:
    """Tell which samples lie in a span, (n_windows, n_samples)."""
    return problem.inside & span.holds(problem.rows, problem.windows.began[:, None], problem.simulator.dt)


def _without(acting: np.ndarray, problem: Problem) -> Windows:
    """Return what is left of the windows without some of their samples, each piece a window of its own."""
    flanks = np.diff(np.pad(problem.inside & ~acting, ((0, 0), (1, 1))).astype(int), axis=1)
    of, begins = np.nonzero(flanks > 0)
    _, stops = np.nonzero(flanks < 0)
    first, began = problem.windows.first[of], problem.windows.began[of]
    return Windows(first + begins, first + stops, np.ones(of.size, dtype=bool), began)


def _noises_of_the_rest(span: Span, problem: Problem, base: Model) -> list[Noise]:
    """Return the noise of what lies outside a span; none where that is too little.

    Where an integrator remembers what acted, all later samples are off, which looks like noise that drifts.
    There the noise of the pieces before and after, each with states of its own, is told too: the first hides
    less of what goes to and fro, the second less of what pushes one way.
    """
    acting = _acting(span, problem)
    quiet = problem.seen & ~acting[:, :, None]
    if quiet.sum() < (1 - MOST) * problem.seen.sum():
        return []
    whole = estimate_noise(np.where(quiet, problem.left_over(base), 0.0), quiet)
    if not any(problem.adds_up):
        return [whole]
    rest = problem.over(_without(acting, problem))
    found = fit(rest, base._replace(x0=states_at(problem, base, rest.windows)), iterations=SETTLED)
    if not np.isfinite(found.cost):
        return [whole]
    return [whole, estimate_noise(rest.left_over(found.model), rest.seen)]


def _found_in(
    span: Span,
    own: Problem,
    base: Model,
    always: Candidate | None,
    structure: Structure,
    settings: Settings,
) -> InSpan | None:
    """Fit the effects that explain most in a span of time, under the problem's own noise, that of the rest.

    None where none of them comes near to what is explained by effects that ``always`` act.
    """
    start = fit_states(own, base)
    rival = always and Candidate(fit(own, always.fit.model, iterations=SETTLED, rough=True), own.n_seen)
    if rival and _left_outside(np.any(_acting(span, own), axis=1), start) > rival.fit.cost:
        return None
    bank = _bank_in(span, own, start, structure, settings)
    taken = np.sum(bank.residual**2) - rival.fit.cost if rival else 0.0
    if BEYOND * gains(bank).gain.max(initial=0.0) < taken:
        return None
    found = _led(own, start, bank, settings)
    if not found:
        return None
    best = with_settled_ends(own, found[0], passes=1)
    if rival and best.criterion > rival.criterion + IN_REACH:
        return None
    own, found, best = _under_clearer_noise(own, best, found, settings)
    return InSpan(own, bank.without_columns(), found, deviance(own, best.fit.model) + best.price)


def _bank_in(span: Span, problem: Problem, start: Fit, structure: Structure, settings: Settings) -> Bank:
    """Return what effects that act in a span, and have no times of their own, would change."""
    hypotheses = [
        h._replace(placed=h.placed.acting(span))
        for h in hypotheses_of(problem, start, structure, settings)
        if h.asked and h.placed.effect.code not in OF_TIME
    ]
    return make_bank(problem, start, hypotheses, settings.n_jobs)


def _led(problem: Problem, start: Fit, bank: Bank, settings: Settings) -> list[Candidate]:
    """Return the leaders of a bank fitted, best first."""
    placed = with_nearest(problem, start, bank, with_pushes(bank, LEADERS), settings.n_jobs)
    return refit_leaders(problem, start, placed, settings.n_jobs, finished=1, twins=0)


def _under_clearer_noise(
    problem: Problem, best: Candidate, found: list[Candidate], settings: Settings
) -> tuple[Problem, list[Candidate], Candidate]:
    """Return the problem, and what was found, best first, under the noise that its best leaves.

    The noise of the rest was coloured by what acts for longer than the span, and by parameters that the rest
    does not go with; what explains most under it may be far from that. Where the best leaves none that is
    clearer, all is as it was. The best comes, and is returned once more, with its ends roughly settled.
    """
    noise = clearer_noise(problem, best.fit)
    if noise is None:
        return problem, found, best
    problem = problem.with_noise(noise)
    others = [_in_span(c, best.effects[0].during) for c in found[1:]]
    again = _fitted(problem, [best.fit.model, *others], settings)
    settled = _settled_each(problem, again, settings, passes=1)
    return problem, settled, settled[0]


def _left_outside(touched: np.ndarray, start: Fit) -> float:
    """Return the cost of the windows that nothing in a span touched, the parameters fitted to them alone.

    No effect that acts in the span only leaves less.
    """
    outside = ~touched
    if not outside.any():
        return 0.0
    residual = start.residual[outside][:, :, None]
    return float(np.sum(out_of(start.jacobian[outside], residual) ** 2))


def _in_span(candidate: Candidate, span: Span) -> Model:
    """Return the model of a candidate with its effect acting in another span."""
    (effect,) = candidate.effects
    return candidate.fit.model._replace(effects=(effect.acting(span),))


def _settled_again(
    problem: Problem, settled: list[Candidate], value: float, settings: Settings
) -> tuple[Noise, list[Candidate]]:
    """Settle the ends once more under the noise that the best effect leaves, where that is clearer.

    The noise of the rest was coloured by what acts for longer than the span that was searched. That which is
    left in the end is returned too.
    """
    noise = clearer_noise(problem, settled[0].fit)
    if noise is None:
        return problem.noise, settled
    clearer = problem.with_noise(noise)
    near = [replace(c, fit=fit(clearer, c.fit.model)) for c in _near(settled)]
    again = _settled_each(clearer, near, settings)
    if deviance(clearer, again[0].fit.model) < value:
        return clearer_noise(clearer, again[0].fit) or noise, again
    return noise, settled


def _looked_at_again(
    problem: Problem, settled: list[Candidate], structure: Structure, settings: Settings
) -> list[Candidate]:
    """Return what may act in the span that the best was settled to, all effects searched there once more.

    In the span where the search began, whose ends were off, what is likelier need not have led. Parameters
    are begun with as they are beside the best.
    """
    start = fit_states(problem, settled[0].fit.model._replace(effects=()))
    bank = _bank_in(settled[0].effects[0].during, problem, start, structure, settings)
    known = {c.effects[0].always().place for c in settled}
    led = [c for c in _led(problem, start, bank, settings) if c.effects[0].always().place not in known]
    within = settled[0].criterion + IN_REACH
    new = _settled_each(problem, [c for c in led if c.criterion < within], settings)
    return sorted([*settled, *new], key=lambda c: c.criterion)


def _may_leave_less(problem: Problem, found: Fit, moved: Model) -> bool:
    """Tell whether a model with its last effect at another time leaves less than what was found.

    As far as tangents tell, of which only those of the effect are drawn anew: a part of the runs of a fit.
    """
    run = problem.run(moved)
    own = moved.theirs[-1]
    steps = np.zeros_like(found.steps)
    steps[own] = found.steps[own]
    columns = found.jacobian.copy()
    columns[:, :, own] = found.projector(problem.parameter_sensitivity(moved, run, steps)[:, :, own])
    residual = found.projector(problem.residual(run))
    if not (np.isfinite(columns).all() and np.isfinite(residual).all()):
        return True
    return float(np.sum(out_of(columns, residual[:, :, None]) ** 2)) < found.cost


def _near(candidates: list[Candidate]) -> list[Candidate]:
    """Return those of some candidates, best first, that ends settled more finely may bring to the front."""
    return [c for c in candidates if c.criterion < candidates[0].criterion + IN_REACH]


def _settled_each(
    problem: Problem, candidates: list[Candidate], settings: Settings, passes: int = PASSES
) -> list[Candidate]:
    """Return effects with the ends of their time settled, best first."""
    settled = Parallel(n_jobs=settings.n_jobs, prefer="threads")(
        delayed(with_settled_ends)(problem, c, passes) for c in candidates
    )
    return sorted(settled, key=lambda c: c.criterion)


def with_settled_ends(
    problem: Problem, candidate: Candidate, passes: int, finest: float = FINEST
) -> Candidate:
    """Return an effect that acts for a while with the ends of its time where they fit best.

    Each end goes to and fro by steps that halve, while the cost falls; then again from where they came to.
    In several passes they go far at first: between two times at which it shows, an end changes nothing. One
    that leaves the samples fitted is not known, unless one within them is worth its price. The ``finest``
    step is a share of the time, or a sample.
    """
    dt, n = problem.simulator.dt, candidate.n_samples
    first, last = _ends(problem, candidate.effects[0].during.along_record)

    def moved(span: Span, end: int, way: float) -> Span:
        at = span[end] if np.isfinite(span[end]) else (first, last)[end]
        to = round((at + way) / dt) * dt
        if end == 0:
            return span._replace(begins=to if to > first else -np.inf)
        return span._replace(ends=to if to < last else np.inf)

    def descended(best: Candidate, step: float) -> Candidate:
        while step > max(finest * (last - first), 0.75 * dt):
            for end, way in ((0, -step), (0, step), (1, -step), (1, step)):
                before = best.effects[0].during
                span = moved(before, end, way)
                if span != before and max(span[0], first) + 2 * dt < min(span[1], last):
                    model = _in_span(best, span)
                    if not _may_leave_less(problem, best.fit, model):
                        continue
                    trial = fit(problem, model, iterations=SETTLED, rough=True)
                    more = max(span.n_ends - before.n_ends, 0)
                    if trial.cost < best.fit.cost * np.exp(-more * price_of_an_end(n) / n):
                        best = Candidate(trial, n)
            step /= 2
        return best

    begins, ends, _ = candidate.effects[0].during.within(first, last)
    step = 0.25 * (ends - begins if passes == 1 else last - first)
    best = candidate
    for _ in range(passes):
        before, best = best, descended(best, step)
        if best is before:
            break
    span = to_sessions(best.effects[0].during, problem)
    return converged(problem, replace(best, fit=best.fit._replace(model=_in_span(best, span))))

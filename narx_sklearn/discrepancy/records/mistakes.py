"""Mistakes in the data, each tried by undoing it: does the simulator then agree with the record?

A mistake is believed only where undoing it does what no refit can: parameters move within a box round their
nominal values, initial states are free, and the output may be scaled and shifted. What is left must fall to
a quarter (in variance), in nearly all windows.
"""

from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from scipy.signal import lfilter

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.records.folded import reads_size, turn_of, unfolded, unsigned_at
from narx_sklearn.discrepancy.simulators.simulator import Simulator, Windows, covered
from narx_sklearn.discrepancy.simulators.windows import shortest_window

BOX = 0.45  # parameters may be this far off, relatively, before data are suspected
DECISIVE = 0.25  # share of the error's variance that may be left after undoing a mistake
EXPLAINED = 0.5  # share of the output's variance that may be left after it
EXCUSED = 0.01  # share of the variance left with which nothing is suspected
AGREEING = 0.8  # share of the windows that must improve
BETTER_THAN_LAG = 0.5  # error variance of a delay over that of the best first-order lag
LAGS = (0.5, 1.0, 2.0)  # time constants that such a lag may have, times the delay
WINDOWS = 8  # that a record is cut into, about
LONGEST = 500  # samples of one window
PART = 4  # of a window, with which a refit begins
AT_ZERO = 0.1  # of a signal's largest value, below zero by which noise takes what has no sign
SHORTEST = 16  # samples of one, however few states the simulator has
TIME_FACTORS = (0.1, 0.5, 2.0, 10.0)  # sampling periods that are tried, over the simulator's
SHIFTS_TRIED = 14  # of one column: refits in the descent from a guess, at most
ROUNDS = 3  # mistakes undone one after another
SCALE_RANGE = 0.4, 2.5  # slopes that wrong parameters may still explain
OFFSET_LIMIT = 3.0  # standard deviations of the output
ALTERNATIONS = 2  # of scale and offset with the parameters
FIT_STEPS = 3  # iterations in each


class Affine(NamedTuple):
    """Measured over simulated output: offset and slope, (n_outputs,) each."""

    offset: np.ndarray
    slope: np.ndarray

    def apply(self, y: np.ndarray) -> np.ndarray:
        """Return simulated outputs as they would be measured."""
        return self.offset + self.slope * y

    def undo(self, y: np.ndarray) -> np.ndarray:
        """Return measured outputs in the simulator's units."""
        return (y - self.offset) / self.slope


@dataclass(frozen=True)
class Case:
    """A simulator and a record in which some mistakes are undone."""

    simulator: Simulator
    u: np.ndarray
    y: np.ndarray
    windows: Windows
    n_jobs: int | None = None  # threads that refit it, and try what else may be wrong


class Agreement(NamedTuple):
    """How well a case agrees after the refit within the box."""

    errors: np.ndarray  # (n_windows,) sums of squares over the record's variance
    n_seen: int
    affine: Affine
    y: np.ndarray  # simulated outputs, as they would be measured
    model: Model

    @property
    def error(self) -> float:
        """Share of the output's variance that is left."""
        return float(self.errors.sum() / max(self.n_seen, 1))


class Mistake(NamedTuple):
    """A mistake, the case without it, and how much better that agrees."""

    code: str
    about: dict
    case: Case
    before: float = np.nan
    after: float = np.nan
    agreeing: float = np.nan


def make_case(simulator: Simulator, u, y, pieces, n_jobs: int | None = None) -> Case | None:
    """Return the record in a few windows, None where it is too short for any."""
    shortest = max(SHORTEST, shortest_window(simulator))
    n_samples = sum(piece.stop - piece.start for piece in pieces)
    segment = max(n_samples // WINDOWS, 2 * shortest)
    first, last, began = [], [], []
    for piece in pieces:
        count = max((piece.stop - piece.start) // segment, 1)
        for a, b in pairwise(np.linspace(piece.start, piece.stop, count + 1).astype(int)):
            if b - a >= shortest:
                first.append(a)
                last.append(min(b, a + LONGEST))
                began.append(piece.start)
    if not first:
        return None
    integers = [np.array(values, dtype=np.int64) for values in (first, last, began)]
    windows = Windows(integers[0], integers[1], np.ones(len(first), dtype=bool), integers[2])
    return Case(boxed(simulator), u, y, windows, n_jobs)


def boxed(simulator: Simulator) -> Simulator:
    """Return a simulator whose parameters are bound to the box round their nominal values."""
    bound = copy(simulator)
    bound.parameters = tuple(_boxed(parameter) for parameter in simulator.parameters)
    return bound


def _boxed(parameter):
    room = BOX * abs(parameter.value)
    return parameter._replace(
        lower=max(parameter.lower, parameter.value - room), upper=min(parameter.upper, parameter.value + room)
    )


def agreement(case: Case, *, scaled: bool, start: Model | None = None) -> Agreement | None:
    """Refit within the box and return what is left; None where the simulator leaves the finite range.

    Parameters
    ----------
    scaled : bool
        Whether the output may be scaled (by a positive factor) and shifted as well.
    start : Model, optional
        Where the refit begins; by default with the nominal parameters.
    """
    simulator, windows = case.simulator, case.windows
    n_outputs = case.y.shape[1]
    noise = Noise.as_large_as(case.y)
    model = start or Model(simulator.nominal, simulator.effects, _first_states(case))
    affine = Affine(np.zeros(n_outputs), np.ones(n_outputs))
    problem = Problem(simulator, case.u, case.y, windows, noise)
    y_sim = problem.run(model).y
    if not np.isfinite(y_sim[problem.rows[problem.inside]]).all():
        return None
    for _ in range(ALTERNATIONS if scaled else 1):
        if scaled:
            affine = _regress(case.y, y_sim, problem.seen, problem.rows)
        target = affine.undo(case.y)
        size = noise.sigma / affine.slope
        problem = Problem(simulator, case.u, target, windows, Noise.white(size))
        steps = FIT_STEPS if scaled else ALTERNATIONS * FIT_STEPS
        fitted = fit(problem, model, iterations=steps, n_jobs=case.n_jobs)
        model = fitted.model
        y_sim = problem.run(model).y
    if scaled:
        affine = _regress(case.y, y_sim, problem.seen, problem.rows)
    predicted = affine.apply(y_sim)
    left = np.where(problem.seen, (case.y - predicted)[problem.rows] / noise.sigma, 0.0)
    return Agreement((left**2).sum(axis=(1, 2)), int(problem.seen.sum()), affine, predicted, model)


def _first_states(case: Case) -> np.ndarray:
    """Return the windows' states from one run of the whole record, measured ones where states are such.

    The sign of those that were measured without one is that of the run.
    """
    simulator, windows = case.simulator, case.windows
    known = simulator.known_states(case.u, case.y, windows.first, windows.began)
    start = np.where(simulator.free_states, simulator.x0, np.nan_to_num(known))
    if not simulator.discrete or any(reads_size(effect) for effect in simulator.effects):
        whole = _whole(windows)
        x = simulator.run(case.u, whole, np.tile(simulator.x0, (whole.count, 1))).x[windows.first]
        start = np.where(np.isfinite(x), x, start)
    return start


def _regress(y, y_sim, seen, rows) -> Affine:
    """Return the best offset and positive slope; a slope that would be negative becomes next to nothing."""
    offset, slope = np.zeros(y.shape[1]), np.ones(y.shape[1])
    for j in range(y.shape[1]):
        at = rows[seen[:, :, j]]
        measured, simulated = y[at, j], y_sim[at, j]
        centred = simulated - simulated.mean()
        power = float(centred @ centred)
        if not power > 0:
            offset[j] = measured.mean() - simulated.mean()
            continue
        largest = np.std(measured) / np.std(simulated)
        slope[j] = max(float(centred @ measured) / power, 1e-3 * largest, 1e-300)
        offset[j] = measured.mean() - slope[j] * simulated.mean()
    return Affine(offset, slope)


def find_mistakes(case: Case) -> tuple[list[Mistake], Case, Agreement | None]:
    """Undo mistakes one after another, the most telling first, until none helps decisively.

    Returns
    -------
    found : list of Mistake
    case : Case
        The record without them.
    last : Agreement or None
        How well it agrees, scaled.
    """
    found: list[Mistake] = []
    now = agreement_at_best(case, scaled=True)
    while len(found) < ROUNDS and now is not None:
        suspects = _suspects(case, now, {mistake.code for mistake in found})
        tried = Parallel(n_jobs=case.n_jobs, prefer="threads")(delayed(_judge)(m, now) for m in suspects)
        believed = [(mistake, after) for mistake, after in tried if mistake is not None]
        if not believed:
            break
        # to two digits, so that of two that mean the same to the simulator the first is named
        mistake, now = min(believed, key=lambda entry: float(f"{entry[0].after:.2g}"))
        found.append(mistake)
        case = mistake.case
    return found, case, now


def agreement_at_best(case: Case, *, scaled: bool) -> Agreement | None:
    """Return how well a case agrees, the refit begun with the first parts of the windows where it must be.

    A machine that turns over, or is unstable, goes anywhere in a long run whose parameters are a little off.
    """
    whole = agreement(case, scaled=scaled)
    if whole is not None and whole.error < EXCUSED:
        return whole
    first, last = case.windows.first, case.windows.last
    shortest = max(SHORTEST, shortest_window(case.simulator))
    parts = np.minimum(last, first + np.maximum((last - first) // PART, shortest))
    begun = agreement(replace(case, windows=case.windows._replace(last=parts)), scaled=scaled)
    grown = None if begun is None else agreement(case, scaled=scaled, start=begun.model)
    return min((found for found in (whole, grown) if found), key=lambda found: found.error, default=None)


def _judge(mistake: Mistake, before: Agreement) -> tuple[Mistake | None, Agreement | None]:
    """Return the mistake with its numbers if undoing it is decisive, else None; others are judged beside."""
    after = agreement(replace(mistake.case, n_jobs=None), scaled=True)
    if after is None or after.errors.size != before.errors.size:
        return None, None
    agreeing = float(np.mean(after.errors < before.errors))
    decisive = after.error < min(DECISIVE * before.error, EXPLAINED) and agreeing >= AGREEING
    if decisive and mistake.about.get("samples", 0) > 0:
        decisive = after.error < BETTER_THAN_LAG * _error_of_lag(mistake, before)
    if not decisive:
        return None, None
    return mistake._replace(before=before.error, after=after.error, agreeing=agreeing), after


def _suspects(case: Case, now: Agreement, done: set[str]) -> Iterator[Mistake]:
    """Yield the mistakes worth a trial, each with the record in which it is undone."""
    if now.error < EXCUSED:
        return
    if "wrapped" not in done:
        yield from _wrapped(case)
    if "unsigned" not in done:
        yield from _unsigned(case)
    if not done & {"sign", "unsigned"}:  # of sizes no sign is told
        yield from _flipped(case)
    if "swapped" not in done:
        yield from _swapped(case)
    if "time_scale" not in done and not case.simulator.discrete:
        for factor in TIME_FACTORS:
            simulator = copy(case.simulator)
            simulator.dt = case.simulator.dt * factor
            simulator.substeps = int(np.ceil(case.simulator.substeps * factor))
            yield Mistake("time_scale", {"factor": factor}, replace(case, simulator=simulator))
    if "delayed" not in done:
        yield from _shifted(case, now)


def _wrapped(case: Case):
    """Yield columns that begin anew after a turn, made to go on."""
    sessions = _sessions(case.windows)
    for name, key, signals in (
        ("u", "input", case.simulator.inputs),
        ("y", "output", case.simulator.outputs),
    ):
        columns = getattr(case, name)
        for i, signal in enumerate(signals):
            turn = turn_of(columns[:, i], signal.unit, sessions)
            if turn is not None:
                going_on = columns.copy()
                going_on[:, i] = unfolded(columns[:, i], turn, sessions)
                about = {key: i, "turn": turn}
                yield Mistake("wrapped", about, replace(case, **{name: going_on}))


def _unsigned(case: Case):
    """Yield outputs that are simulated as sizes without a sign, as the record's seem to be.

    What the simulator as it stands shows with one sign alone, a level, has none to lose.
    """
    simulator, whole = case.simulator, _whole(case.windows)
    with_one_sign = [j for j, values in enumerate(case.y.T) if _has_one_sign(values)]
    if not with_one_sign:
        return
    as_it_stands = simulator.run(
        case.u, whole, simulator.told_states(case.u, case.y, whole.first, whole.began)
    ).y
    for j in with_one_sign:
        if not _has_one_sign(as_it_stands[:, j]):
            simulator = case.simulator.with_effects((*case.simulator.effects, unsigned_at(j)))
            yield Mistake("unsigned", {"output": j}, replace(case, simulator=simulator))


def _has_one_sign(values: np.ndarray) -> bool:
    """Tell whether a signal stays above zero, but for noise about it."""
    finite = values[np.isfinite(values)]
    return finite.size > 0 and bool(finite.min() > -AT_ZERO * finite.max())


def _whole(windows: Windows) -> Windows:
    """Return one window a session, as far as windows cover it."""
    began, which = np.unique(windows.began, return_inverse=True)
    last = np.array([windows.last[which == s].max() for s in range(began.size)])
    return Windows(began, last, np.ones(began.size, dtype=bool), began)


def _sessions(windows: Windows) -> list[slice]:
    """Return the sessions as far as windows cover them."""
    whole = _whole(windows)
    return [slice(int(a), int(b)) for a, b in zip(whole.first, whole.last, strict=True)]


def _flipped(case: Case):
    for j in range(case.y.shape[1]):
        y = case.y.copy()
        y[:, j] *= -1.0
        yield Mistake("sign", {"output": j}, replace(case, y=y))
    for i in range(case.u.shape[1]):
        u = case.u.copy()
        u[:, i] *= -1.0
        yield Mistake("sign", {"input": i}, replace(case, u=u))


def _swapped(case: Case):
    for name in ("u", "y"):
        columns = getattr(case, name)
        for i, k in combinations(range(columns.shape[1]), 2):
            exchanged = columns.copy()
            exchanged[:, [i, k]] = columns[:, [k, i]]
            which = {"inputs" if name == "u" else "outputs": (i, k)}
            yield Mistake("swapped", which, replace(case, **{name: exchanged}))
    for i in range(case.u.shape[1]):
        for j in range(case.y.shape[1]):
            if np.isfinite(case.y[:, j]).all() and np.nanstd(case.u[:, i]) > 0:
                u, y = case.u.copy(), case.y.copy()
                u[:, i], y[:, j] = case.y[:, j], case.u[:, i]
                yield Mistake("swapped", {"input": i, "output": j}, replace(case, u=u, y=y))


def _shifted(case: Case, now: Agreement):
    """Yield columns moved in time by what leaves least after the refit."""
    reach = int((case.windows.last - case.windows.first).min() // 4)
    run = case.simulator.run(case.u, case.windows, _first_states(case))
    for j in range(case.y.shape[1]):
        start = _lag_of(case.y[:, j], run.y[:, j], case.windows, reach)
        moved = partial(_with_output_moved, case, j)
        samples = _best_shift(moved, start, now.error, reach)
        if samples:
            yield Mistake("delayed", {"output": j, "samples": samples}, moved(samples))
    if case.u.shape[1] > 1:
        for i in range(case.u.shape[1]):
            moved = partial(_with_input_moved, case, i)
            samples = _best_shift(moved, _lag_of_input(case, i, reach), now.error, reach)
            if samples:
                yield Mistake("delayed", {"input": i, "samples": samples}, moved(samples))


def _best_shift(moved: Callable[[int], Case], start: int, unmoved: float, reach: int) -> int:
    """Return the shift that leaves least after the refit, by descent from a guess made without it."""
    errors = {0: unmoved}

    def error(samples: int) -> float:
        if abs(samples) > reach:
            return np.inf
        if samples not in errors:
            after = agreement(moved(samples), scaled=True)
            errors[samples] = np.inf if after is None else after.error
        return errors[samples]

    best, step = start, max(abs(start) // 4, 1)
    while len(errors) < SHIFTS_TRIED:
        nearest = min((best, best - step, best + step), key=error)
        if nearest == best and step == 1:
            break
        best, step = (nearest, step) if nearest != best else (best, step // 2)
    return min(errors, key=errors.__getitem__)


def _lag_of(measured, simulated, windows: Windows, reach: int) -> int:
    """Return by how many samples the measured signal lies behind the simulated one."""
    total = np.zeros(2 * reach + 1)
    for a, b in zip(windows.first, windows.last, strict=True):
        y, s = measured[a:b], simulated[a:b]
        y = np.nan_to_num(y - np.nanmean(y)) if np.isfinite(y).any() else np.zeros(b - a)
        s = s - s.mean()
        size = 1 << int(2 * (b - a) - 1).bit_length()
        product = np.fft.irfft(np.fft.rfft(y, size) * np.conj(np.fft.rfft(s, size)), size)
        total += np.concatenate([product[size - reach :], product[: reach + 1]])
    return int(np.argmax(total)) - reach


def _lag_of_input(case: Case, i: int, reach: int) -> int:
    """Return the shift of one input, from a coarse grid and then its neighbours, that leaves least."""
    steps = np.unique(np.round(np.geomspace(1, max(reach, 1), 12)).astype(int))
    errors = {d: _error_without_refit(case, i, d) for d in (0, *steps.tolist(), *(-steps).tolist())}
    best = min(errors, key=errors.__getitem__)
    step = max(abs(best) // 3, 1)
    while best and step >= 1:
        for d in (best - step, best + step):
            errors.setdefault(d, _error_without_refit(case, i, d))
        nearest = min(errors, key=errors.__getitem__)
        if nearest == best:
            if step == 1:
                break
            step //= 2
        best = nearest
    return best


def _error_without_refit(case: Case, i: int, samples: int) -> float:
    moved = _with_input_moved(case, i, samples)
    run = moved.simulator.run(moved.u, moved.windows, _first_states(moved))
    inside = covered(case.windows)
    seen = np.isfinite(case.y[inside])[None]
    if not np.isfinite(run.y[inside]).all():
        return np.inf
    affine = _regress(case.y, run.y, seen, inside[None])
    left = (case.y - affine.apply(run.y))[inside] / np.nanstd(case.y, axis=0)
    return float(np.nansum(left**2))


def _with_output_moved(case: Case, j: int, samples: int) -> Case:
    """Return the case with one output, late by ``samples``, moved back."""
    y = case.y.copy()
    y[:, j] = _moved(y[:, j], -samples, case.windows, np.nan)
    return replace(case, y=y)


def _with_input_moved(case: Case, i: int, samples: int) -> Case:
    """Return the case with one input moved later by ``samples``, as the system seems to have got it."""
    u = case.u.copy()
    u[:, i] = _moved(u[:, i], samples, case.windows, None)
    return replace(case, u=u)


def _moved(signal, samples: int, windows: Windows, fill) -> np.ndarray:
    """Return a column moved later (earlier where negative) in each session; held at its ends, or filled."""
    out = signal.copy()
    for session in _sessions(windows):
        begin, end = session.start, session.stop
        index = np.arange(begin, end) - samples
        inside = (index >= begin) & (index < end)
        values = signal[np.clip(index, begin, end - 1)]
        out[begin:end] = values if fill is None else np.where(inside, values, fill)
    return out


def _error_of_lag(mistake: Mistake, before: Agreement) -> float:
    """Return what a first-order lag of the simulated output leaves: a slow sensor looks like a late one."""
    case, samples = mistake.case, mistake.about["samples"]
    j = mistake.about.get("output", 0)
    measured = case.y[:, j]
    if "output" in mistake.about:
        measured = _moved(measured, samples, case.windows, np.nan)  # as recorded
    best = np.inf
    for share in LAGS:
        pole = np.exp(-1.0 / (share * samples))
        lagged = before.y[:, j].copy()
        for a, b in zip(case.windows.first, case.windows.last, strict=True):
            s = before.y[a:b, j]
            lagged[a:b], _ = lfilter([1 - pole], [1, -pole], s, zi=[pole * s[0]])
        inside = covered(case.windows)
        inside = inside[np.isfinite(measured[inside]) & np.isfinite(lagged[inside])]
        columns = np.column_stack([np.ones(inside.size), lagged[inside]])
        rest = measured[inside] - columns @ np.linalg.lstsq(columns, measured[inside], rcond=None)[0]
        left, variance = float(rest @ rest), float(np.var(measured[inside])) * inside.size
        best = min(best, left / variance if variance > 0 else np.inf)
    return best

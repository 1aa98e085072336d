"""Mistakes in a record that would be sold as physics: found before the diagnosis begins."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import linprog

from narx_sklearn._validation import (
    as_signals,
    check_same_length,
    finite_rows,
    finite_slices,
    session_slices,
    true_runs,
)
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import SMALL, fit
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.records.jumps import find_jumps
from narx_sklearn.discrepancy.records.mistakes import (
    BOX,
    DECISIVE,
    OFFSET_LIMIT,
    SCALE_RANGE,
    Agreement,
    Case,
    Mistake,
    agreement_at_best,
    boxed,
    find_mistakes,
    make_case,
)
from narx_sklearn.discrepancy.search.confirm import is_of_a_sensor
from narx_sklearn.discrepancy.search.inference import untold
from narx_sklearn.discrepancy.simulators.simulator import Simulator, Windows
from narx_sklearn.discrepancy.simulators.windows import find_pace
from narx_sklearn.model.units import alike_but_for_time
from narx_sklearn.physics.effects import held_runs

TIME_CONSTANTS = 4.0  # a window's length; a session should hold one
SAMPLES_A_NUMBER = 10  # samples for each number that is fitted, at least
REST = 1e-9  # relative spread below which a signal counts as constant
HELD_RUN = 10  # equal rows in a row that count as rest and not as duplicated samples
SUSPICIOUS_SHARE = 0.005  # of the samples
SUSPICIOUS_COUNT = 5  # samples, in a short record
DISTINCT = 0.7  # share of distinct values among changing samples from which a signal is not quantised
FAR_LESS = 0.5  # of what undoing a mistake leaves beyond noise: what an effect leaves that speaks against it
MENDED_FIRST = ("time_scale", "swapped", "sign", "units")  # physics beside them is theirs
# what a factor may be, and the units of one kind that it lies between
KNOWN_RATIOS = (
    (1e3, "between a unit and its thousandth (m and mm)", ""),
    (1e6, "between a unit and its millionth (m and um)", ""),
    (1e9, "between a unit and its billionth (m and nm)", ""),
    (100.0, "between a unit and its hundredth, or a fraction and per cent", ""),
    (10.0, "between a unit and its tenth", ""),
    (1 / 0.0254, "between metres and inches (39.37)", "m"),
    (25.4, "between inches and millimetres (25.4)", "m"),
    (1 / 0.3048, "between metres and feet (3.281)", "m"),
    (180 / np.pi, "between radians and degrees", "rad"),
    (30 / np.pi, "between rad/s and rpm (9.549)", "rad/s"),
    (2 * np.pi, "between turns and radians (6.283)", "rad"),
    (1e5, "between bar and Pa", "Pa"),
    (6894.757, "between psi and Pa (6895)", "Pa"),
    (14.50377, "between bar and psi (14.5)", "Pa"),
)
NEAR_RATIO = 1.33  # a gain is known to a third only
BY_PHYSICS = (0.1, 10.0)  # factors that missing physics may have, where no change of units has them
NAMED = 2  # of the changes of units that a factor looks like
FAHRENHEIT = 1.8  # degrees to one of Celsius
ZEROS = (  # slope, offset, what lies between
    (1.0, 273.15, "between degrees Celsius and kelvin (273.15)"),
    (FAHRENHEIT, 32.0, "between degrees Celsius and Fahrenheit (1.8, 32)"),
    (FAHRENHEIT, -459.67, "between kelvin and degrees Fahrenheit (1.8, -459.67)"),
)
TEMPERATURES = ("", "K", "degC", "°C", "degF", "°F", "C", "F")
NEAR_ZERO = 0.1  # of an offset, by which it may be off


@dataclass(frozen=True)
class DataFinding:
    """Something about a record that is no physics.

    Attributes
    ----------
    code : str
        ``"short_record"``, ``"constant_input"``, ``"duplicated_samples"``, ``"clipped_output"``, ``"jump"``,
        ``"held_output"``, ``"time_scale"``, ``"swapped"``, ``"delayed"``, ``"sign"``, ``"units"``,
        ``"quantised_output"``, ``"spikes"``, ``"coarse_steps"``, ``"rows"``, ``"bounds"``, ``"dead_values"``.
    sentence : str
        What was seen, with the number, and what to do.
    evidence : mapping of {str: value}
        The numbers.
    """

    code: str
    sentence: str
    evidence: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.sentence


def check_record(simulator: Simulator, u, y, sessions=None, n_jobs=None) -> tuple[DataFinding, ...]:
    """Look for mistakes in a record before physics is looked for.

    Counts tell of samples that are too few, constant, repeated or clipped. The other mistakes (wrong
    sampling period, swapped, shifted or sign-flipped columns, other units) are undone on trial: each is
    believed only if the simulator, refitted within 45 % of its nominal parameters and with free initial
    states, then leaves at most a quarter of the error variance that it leaves otherwise, in four windows of
    five. A wrong parameter or a missing piece of physics does not do that.

    Parameters
    ----------
    simulator : Simulator
        The simulation as it stands.
    u : array-like of shape (n_samples, n_inputs)
        Measured inputs; NaN marks gaps.
    y : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Measured outputs, in the order of the simulator's; NaN marks gaps.
    sessions : array-like of shape (n_samples,), default=None
        One label a sample.
    n_jobs : int, default=None
        Threads that try mistakes side by side, as in joblib.

    Returns
    -------
    tuple of DataFinding
        Empty when nothing was found.

    Raises
    ------
    ValueError
        If the data do not fit the simulator.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy import ODESimulator, check_record
    >>> def tank(x, u, p):
    ...     return (p[0] * u[0] - p[1] * x[0],)
    >>> sim = ODESimulator(tank, dt=0.1, parameters={"gain [m/s/V]": 1.0, "outflow [1/s]": 0.5},
    ...                    states=["level [m]"], inputs=["pump [V]"])
    >>> rng = np.random.default_rng(0)
    >>> u = np.repeat(rng.uniform(-1, 1, 100), 10)
    >>> y = 1000 * sim.simulate(u) + rng.normal(size=(1000, 1))
    >>> [finding.code for finding in check_record(sim, u, y)]
    ['units']
    """
    u, y = as_signals(u, "u"), as_signals(y, "y")
    check_same_length(u=u, y=y, sessions=sessions)
    for name, data, signals in (("u", u, simulator.inputs), ("y", y, simulator.outputs)):
        if data.shape[1] != len(signals):
            raise ValueError(
                f"{name} has {data.shape[1]} columns, the simulator has {len(signals)}: "
                f"{[str(s) for s in signals]}. Pass one column for each, in this order."
            )
    pieces = finite_slices(session_slices(sessions, u.shape[0]), finite_rows(u))
    found = [
        *_short_record(simulator, u, pieces),
        *_constant_inputs(simulator, u),
        *_duplicated_samples(u, y, pieces),
        *_clipped_outputs(simulator, u, y, pieces),
        *_held_outputs(simulator, u, y, pieces),
        *_jumping_outputs(simulator, u, y, pieces),
    ]
    longest = max((piece.stop - piece.start for piece in pieces), default=0)
    if longest < _fewest(simulator):
        return tuple(found)  # nothing can be compared
    case = make_case(simulator, u, y, pieces, n_jobs)
    if case is not None and np.nanstd(y, axis=0).min() > 0:
        mistakes, case, last = find_mistakes(case)
        if any(mistake.code == "time_scale" for mistake in mistakes):  # short only as the simulator counts
            found = [finding for finding in found if finding.code != "short_record"]
        found += [_told(simulator, mistake) for mistake in mistakes]
        if last is not None:
            found += _other_units(simulator, case, last)
    return tuple(found)


def still_standing(
    findings: Sequence[DataFinding], problem: Problem, refitted: Model, best: Model
) -> list[DataFinding]:
    """Return findings without mistakes that, undone, left more of the record than is left of it as it is.

    Where small errors of the parameters grow, as on a pole that a loop holds up, the quick refit of the check
    goes anywhere, and whatever makes the simulation move less agrees better. And what arrives smoothed
    arrives late, too: an effect that leaves far less, beyond the noise that nothing explains, says what it
    is. But a fit with a gain a thousand times the nominal is no better than another unit, nor one with every
    rate doubled than another sampling period: what leaves less must do so with parameters that are as near as
    undoing a mistake needs them. Where they lie elsewhere, it is fitted again with such.

    Parameters
    ----------
    findings : sequence of DataFinding
        Of the record, as the check found it.
    problem : Problem
        The record in windows.
    refitted, best : Model
        The refitted simulator over these windows, and that with what was found.
    """
    n_undone = sum("after" in finding.evidence for finding in findings)
    if not n_undone:
        return list(findings)  # none was undone on trial
    spread = np.nanstd(problem.y, axis=0)
    spread = np.where(spread > 0, spread, 1.0)

    def missed(model: Model) -> float:
        if _n_far(problem.simulator, model.p) >= n_undone:
            nearest = _nearest_alike(problem, model)
            model = fit(replace(problem, simulator=boxed(problem.simulator)), nearest).model
        left = (problem.y - problem.run(model).y) / spread
        return float(np.mean(left[problem.rows][problem.seen] ** 2))

    of_refit, of_best = missed(refitted), missed(best)
    innovations = np.where(problem.seen, (problem.noise.sigma / spread) ** 2, 0.0)
    noise = min(float(innovations.sum() / max(problem.seen.sum(), 1)), of_best)
    least = min(of_refit, noise + (of_best - noise) / FAR_LESS) if np.isfinite(of_best) else of_refit
    return [finding for finding in findings if not least < finding.evidence.get("after", -np.inf)]


def _n_far(simulator: Simulator, p: np.ndarray) -> int:
    """Return how many parameters are farther from the nominal ones than a check of the record lets them."""
    nominal = simulator.nominal
    return int(np.sum((np.abs(p - nominal) > BOX * np.abs(nominal)) & (nominal != 0)))


def _nearest_alike(problem: Problem, model: Model) -> Model:
    """Return the model with parameters nearer to the nominal ones, moved where nothing notices it.

    The largest relative distance becomes as small as can be.
    """
    found = fit(problem, model, iterations=0)
    n, nominal = model.p.size, problem.simulator.nominal
    directions = untold(found)
    directions = directions[~np.any(directions[:, n:], axis=1)] * np.abs(found.steps) / SMALL
    known = nominal != 0
    if not len(directions):
        return model
    # how far along each, and the largest distance, which is the least that holds for all
    size = np.abs(nominal[known])
    along, away = directions[:, :n][:, known].T / size[:, None], (model.p - nominal)[known] / size
    rows = np.vstack([np.column_stack([sign * along, -np.ones(size.size)]) for sign in (1, -1)])
    cost = np.concatenate([np.zeros(len(directions)), [1.0]])
    bounds = [(None, None)] * len(directions) + [(0, None)]
    best = linprog(cost, rows, np.concatenate([-away, away]), bounds=bounds)
    return model if best.x is None else model.with_q(model.q + best.x[:-1] @ directions)


def to_be_mended(findings: Sequence[DataFinding], effects: Sequence[PlacedEffect]) -> list[DataFinding]:
    """Return the mistakes of a record that must be mended before effects named beside them mean anything.

    What comes late may do so in the machine, an offset that was named as one is told as what it is, a unit
    that only a label states may be the same in other letters, and what is a few times larger or smaller than
    the simulation, as no change of units makes it, may be so by the physics that is missing.
    """
    of_sensors = bool(effects) and all(is_of_a_sensor(effect) for effect in effects)

    def is_none(finding: DataFinding) -> bool:
        if finding.code != "units":
            return False
        slope = finding.evidence.get("slope")
        if slope is None:
            return True
        if SCALE_RANGE[0] < slope < SCALE_RANGE[1]:
            return of_sensors
        return not finding.evidence["alike"] and BY_PHYSICS[0] < slope < BY_PHYSICS[1]

    return [finding for finding in findings if finding.code in MENDED_FIRST and not is_none(finding)]


def _short_record(simulator: Simulator, u, pieces):
    """Yield a finding if no session holds a window."""
    longest = max((piece.stop - piece.start for piece in pieces), default=0)
    wanted = _fewest(simulator)
    constant = 0.0
    if longest:
        piece = max(pieces, key=lambda p: p.stop - p.start)
        known = simulator.known_states(
            u, np.zeros((u.shape[0], len(simulator.outputs))), np.array([piece.start])
        )
        run = simulator.run(u, Windows.whole([piece]), np.nan_to_num(known))
        constant = (
            find_pace(simulator, run.x[piece], u[piece]).time_constant if len(simulator.states) else 0.0
        )
        wanted = max(wanted, int(np.ceil(TIME_CONSTANTS * constant / simulator.dt)))
    if longest < wanted:
        yield DataFinding(
            "short_record",
            f"The longest session has {longest} samples ({longest * simulator.dt:.4g} s), short for "
            f"{_n_numbers(simulator)} numbers to fit and a slowest time constant of {constant:.4g} s, which "
            f"want {wanted}: what is slow is told vaguely. A longer session tells it better.",
            {"samples": longest, "wanted": wanted, "time_constant": constant},
        )


def _n_numbers(simulator: Simulator) -> int:
    return int(simulator.free_states.sum()) + len(simulator.parameters) + 1


def _fewest(simulator: Simulator) -> int:
    """Return the samples without which nothing is fitted; a window of them may be short for its pace."""
    return SAMPLES_A_NUMBER * _n_numbers(simulator)


def _constant_inputs(simulator: Simulator, u):
    for i, signal in enumerate(simulator.inputs):
        values = u[np.isfinite(u[:, i]), i]
        if values.size and np.ptp(values) <= REST * np.abs(values).max(initial=0.0):
            yield DataFinding(
                "constant_input",
                f"Input {i} ({signal}) is constant at {values[0]:.6g}: what it does cannot be told from an "
                "offset. Excite it.",
                {"input": i, "value": float(values[0])},
            )


def _jumping_outputs(simulator: Simulator, u, y, pieces):
    """Yield a finding for each output that jumps where the simulation does not."""
    if not pieces:
        return
    first = np.array([piece.start for piece in pieces], dtype=np.int64)
    x0 = np.nan_to_num(simulator.known_states(u, y, first))
    simulated = simulator.run(u, Windows.whole(pieces), x0).y
    for i, signal in enumerate(simulator.outputs):
        samples, usual = find_jumps(y[:, i], simulated[:, i], pieces)
        if not samples:
            continue
        sizes = [abs(y[k, i] - y[k - 1, i]) for k in samples]
        where = ", ".join(f"{k} ({k * simulator.dt:.6g} s)" for k in samples)
        yield DataFinding(
            "jump",
            f"Output {i} ({signal}) jumps by {max(sizes):.3g}{' at most' * (len(sizes) > 1)}, at sample "
            f"{where}, where it moves by no more than {usual:.3g} in any other. If recordings were joined "
            "there, label them in sessions; if not, something was hit, shifted, or set to zero anew.",
            {"output": i, "samples": samples, "usual": usual},
        )


def _duplicated_samples(u, y, pieces):
    """Yield a finding if rows repeat although the outputs are not quantised."""
    repeated = n_seen = 0
    for piece in pieces:
        rows = np.column_stack([u[piece], y[piece]])
        same = np.concatenate([[False], (rows[1:] == rows[:-1]).all(axis=1)])
        changing = np.diff(y[piece], axis=0)
        changing = y[piece][1:][(changing != 0).all(axis=1) & np.isfinite(changing).all(axis=1)]
        distinct = min((np.unique(column).size for column in changing.T), default=0)
        for column in y[piece].T:  # told of as held outputs
            for a, b in held_runs(column):
                same[a:b] = False
        n_seen += same.size
        if len(changing) and distinct >= DISTINCT * len(changing):
            repeated += sum(b - a for a, b in true_runs(same) if b - a < HELD_RUN)
    if repeated >= max(SUSPICIOUS_COUNT, SUSPICIOUS_SHARE * n_seen):
        yield DataFinding(
            "duplicated_samples",
            f"{repeated} of {n_seen} rows repeat the row before in every column, although the outputs are "
            "not quantised: samples were doubled, or a slower record was held. Remove them or mark them NaN.",
            {"repeated": int(repeated), "share": repeated / n_seen},
        )


def _clipped_outputs(simulator: Simulator, u, y, pieces):
    """Yield a finding for each output that stands at its largest or smallest value too often."""
    for j, signal in enumerate(simulator.outputs):
        values = y[np.isfinite(y[:, j]), j]
        levels, counts = np.unique(values, return_counts=True)
        if levels.size < 3:
            continue
        for end, word in ((-1, "largest"), (0, "smallest")):
            level = levels[end]
            at_rest = sum(_opening_rest(y[piece, j], level) for piece in pieces)
            count = int(counts[end]) - at_rest
            enough = max(SUSPICIOUS_COUNT, SUSPICIOUS_SHARE * values.size)
            if count >= enough and count > 5 * np.sort(counts[1:-1])[-3:].mean():
                yield DataFinding(
                    "clipped_output",
                    f"{count} samples of output {j} ({signal}) stand exactly at its {word} value, "
                    f"{level:.6g}: the sensor or the recorder clips, or the system stands at a limit. "
                    "Mark them NaN where they are no measurement.",
                    {"output": j, "level": float(level), "count": count, "share": count / values.size},
                )


def _held_outputs(simulator: Simulator, u, y, pieces):
    """Yield a finding for each output that repeats one value while something else in the record changes."""
    for j, signal in enumerate(simulator.outputs):
        others = np.column_stack([u, np.delete(y, j, axis=1)])
        held = [
            (piece.start + a, piece.start + b)
            for piece in pieces
            for a, b in held_runs(y[piece, j])
            if (others[piece][a + 1 : b] != others[piece][a : b - 1]).any()
        ]
        if not held:
            continue
        a, b = max(held, key=lambda run: run[1] - run[0])
        more = f" (the longest of {len(held)} such stretches)" if len(held) > 1 else ""
        yield DataFinding(
            "held_output",
            f"Output {j} ({signal}) shows {y[a, j]:.6g} to the last digit in samples {a} to {b - 1}{more}, "
            "while the record goes on: the sensor or the recorder is stuck there. Mark them NaN.",
            {"output": j, "value": float(y[a, j]), "stretches": [(int(a), int(b)) for a, b in held]},
        )


def _opening_rest(column, level) -> int:
    """Return how many samples a session stands at a level before it first moves."""
    moved = np.flatnonzero(column != level)
    return int(moved[0]) if moved.size else column.size


def _told(simulator: Simulator, mistake: Mistake) -> DataFinding:
    """Return a mistake as a finding."""
    about = mistake.about
    i, j = about.get("input"), about.get("output")
    inputs = about.get("inputs", () if i is None else (i,))
    outputs = about.get("outputs", () if j is None else (j,))
    named = " and ".join(
        [f"input {index} ({simulator.inputs[index]})" for index in inputs]
        + [f"output {index} ({simulator.outputs[index]})" for index in outputs]
    )
    if mistake.code == "time_scale":
        dt = about["factor"] * simulator.dt
        what = (
            f"The record runs {about['factor']:g} times as fast as the simulator: as if dt were "
            f"{dt:.6g} s and not {simulator.dt:.6g} s. Check the sampling period"
        )
    elif mistake.code == "swapped":
        what = f"{named} seem to be swapped"
    elif mistake.code == "sign":
        what = f"The sign of {named} seems to be reversed"
    else:
        samples = about["samples"]
        late = (samples > 0) == (j is not None)
        time = f"{abs(samples)} samples ({abs(samples) * simulator.dt:.4g} s)"
        what = f"{named} comes {time} too {'late' if late else 'early'}: a shifted column"
        if samples > 0:
            what += ", or a dead time that the simulation lacks"
    sentence = (
        f"{what[0].upper()}{what[1:]}. Undone, the share of the output's variance that the refitted "
        f"simulator misses falls from {mistake.before:.3g} to {mistake.after:.3g}."
    )
    numbers = {"before": mistake.before, "after": mistake.after, "windows_agreeing": mistake.agreeing}
    return DataFinding(mistake.code, sentence, about | numbers)


def _other_units(simulator: Simulator, case: Case, scaled: Agreement) -> list[DataFinding]:
    """Return findings where only another scale or a large offset makes the output agree."""
    plain = agreement_at_best(case, scaled=False)
    if plain is None or not scaled.error < min(DECISIVE * plain.error, 0.5):
        return []
    found = []
    for j, signal in enumerate(simulator.outputs):
        units = [signal.unit, *(s.unit for s in simulator.inputs)]
        slope, offset = float(scaled.affine.slope[j]), float(scaled.affine.offset[j])
        spread = float(np.nanstd(case.y[:, j]))
        facts, alike = [], _alike_ratios(slope, units)
        if not SCALE_RANGE[0] < slope < SCALE_RANGE[1]:
            facts.append(f"{slope:.4g} times what the simulator gives{_in_words(alike)}")
        if abs(offset) > OFFSET_LIMIT * spread:
            facts.append(
                f"shifted by {offset:.6g}, {abs(offset) / spread:.1f} standard deviations"
                + _named_zero(slope, offset, signal.unit)
            )
        if facts:
            found.append(
                DataFinding(
                    "units",
                    f"Output {j} ({signal}) is {' and '.join(facts)}: another unit of the output or of an "
                    f"input, or another zero. So scaled, what is missed falls from {plain.error:.3g} to "
                    f"{scaled.error:.3g} of the variance. Convert the column.",
                    {
                        "output": j,
                        "slope": slope,
                        "offset": offset,
                        "alike": alike,
                        "before": plain.error,
                        "after": scaled.error,
                    },
                )
            )
    return found


def _alike_ratios(slope: float, units: Sequence[str]) -> list[str]:
    """Return the changes of units that a slope looks like, those first that the signals' units must have.

    Those of another kind than all units that are stated are left out.
    """
    size = max(slope, 1 / slope)
    unstated = not all(units)
    alike = []
    for ratio, words, unit in KNOWN_RATIOS:
        away = abs(np.log(size / ratio))
        of_its_kind = bool(unit) and any(alike_but_for_time(unit, other) for other in units if other)
        if away < np.log(NEAR_RATIO) and (of_its_kind or unstated or not unit):
            alike.append((not of_its_kind, away, words))
    return [words for *_, words in sorted(alike)]


def _in_words(alike: Sequence[str]) -> str:
    return f", as {', or '.join(alike[:NAMED])}" if alike else ""


def _named_zero(slope: float, offset: float, unit: str) -> str:
    """Return the scales of temperature that a shifted output looks like."""
    if unit not in TEMPERATURES or slope <= 0:
        return ""
    for scale, zero, words in ZEROS:
        for a, b in ((scale, zero), (1 / scale, -zero / scale)):
            if abs(np.log(slope / a)) < np.log(NEAR_RATIO) and abs(offset - b) < NEAR_ZERO * abs(b):
                return f", as {words}"
    return ""

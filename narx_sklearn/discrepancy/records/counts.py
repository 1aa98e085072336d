"""What counting tells of a record: samples that are too few, constant, repeated, clipped or held, or jump."""

import numpy as np

from narx_sklearn._validation import true_runs
from narx_sklearn.discrepancy.records.finding import DataFinding
from narx_sklearn.discrepancy.records.jumps import find_jumps
from narx_sklearn.discrepancy.simulators.simulator import Simulator, Windows
from narx_sklearn.discrepancy.simulators.windows import find_pace
from narx_sklearn.physics.effects import held_runs

TIME_CONSTANTS = 4.0  # a window's length; a session should hold one
SAMPLES_A_NUMBER = 10  # samples for each number that is fitted, at least
REST = 1e-9  # relative spread below which a signal counts as constant
HELD_RUN = 10  # equal rows in a row that count as rest and not as duplicated samples
SUSPICIOUS_SHARE = 0.005  # of the samples
SUSPICIOUS_COUNT = 5  # samples, in a short record
SIGMAS = 4.0  # by which repeated rows must exceed those that chance makes
DISTINCT = 0.7  # share of distinct values among changing samples from which a signal is not quantised


def counted(simulator: Simulator, u: np.ndarray, y: np.ndarray, pieces: list[slice]) -> list[DataFinding]:
    """Return what samples tell that are too few, constant, repeated, clipped, held, or jump."""
    return [
        *_short_record(simulator, u, pieces),
        *_constant_inputs(simulator, u),
        *_duplicated_samples(u, y, pieces),
        *_clipped_outputs(simulator, u, y, pieces),
        *_held_outputs(simulator, u, y, pieces),
        *_jumping_outputs(simulator, u, y, pieces),
    ]


def _short_record(simulator: Simulator, u, pieces):
    """Yield a finding if no session holds a window."""
    longest = max((piece.stop - piece.start for piece in pieces), default=0)
    wanted = fewest(simulator)
    constant = 0.0
    if longest:
        piece = max(pieces, key=lambda p: p.stop - p.start)
        if len(simulator.states):
            constant = find_pace(simulator, _motion_from_rest(simulator, u, piece), u[piece]).time_constant
        wanted = max(wanted, int(np.ceil(TIME_CONSTANTS * constant / simulator.dt)))
    if longest < wanted:
        yield DataFinding(
            "short_record",
            f"The longest session has {longest} samples ({longest * simulator.dt:.4g} s), short for "
            f"{_n_numbers(simulator)} numbers to fit and a slowest time constant of {constant:.4g} s, which "
            f"want {wanted}: what is slow is told vaguely. A longer session tells it better.",
            {"samples": longest, "wanted": wanted, "time_constant": constant},
        )


def _motion_from_rest(simulator: Simulator, u, piece: slice) -> np.ndarray:
    """Return the states of a run from rest; without its loop an unstable machine would soon be elsewhere."""
    first = np.array([piece.start])
    known = simulator.known_states(u, np.zeros((u.shape[0], len(simulator.outputs))), first, first)
    at_rest = np.where(simulator.free_states, simulator.x0, np.nan_to_num(known))
    return simulator.run(u, Windows.whole([piece]), at_rest).x[piece]


def _n_numbers(simulator: Simulator) -> int:
    return int(simulator.free_states.sum()) + len(simulator.parameters) + 1


def fewest(simulator: Simulator) -> int:
    """Return the samples without which nothing is fitted; a window of them may be short for its pace."""
    return SAMPLES_A_NUMBER * _n_numbers(simulator)


def _constant_inputs(simulator: Simulator, u):
    for i, signal in enumerate(simulator.inputs):
        values = u[np.isfinite(u[:, i]), i]
        if values.size and np.ptp(values) <= REST * np.abs(values).max(initial=0.0):
            yield DataFinding(
                "constant_input",
                f"Input {signal} is constant at {values[0]:.6g}: what it does cannot be told from an "
                "offset. Excite it.",
                {"input": i, "value": float(values[0])},
            )


def _jumping_outputs(simulator: Simulator, u, y, pieces):
    """Yield a finding for each output that jumps where the simulation does not."""
    if not pieces:
        return
    first = np.array([piece.start for piece in pieces], dtype=np.int64)
    x0 = simulator.told_states(u, y, first, first)
    simulated = simulator.run(u, Windows.whole(pieces), x0).y
    for i, signal in enumerate(simulator.outputs):
        samples, usual = find_jumps(y[:, i], simulated[:, i], pieces)
        if not samples:
            continue
        sizes = [abs(y[k, i] - y[k - 1, i]) for k in samples]
        where = ", ".join(f"{k} ({k * simulator.dt:.6g} s)" for k in samples)
        yield DataFinding(
            "jump",
            f"Output {signal} jumps by {max(sizes):.3g}{' at most' * (len(sizes) > 1)}, at sample "
            f"{where}, where it moves by no more than {usual:.3g} in any other. If recordings were joined "
            "there, label them in sessions; if not, something was hit, shifted, or set to zero anew.",
            {"output": i, "samples": samples, "usual": usual},
        )


def _duplicated_samples(u, y, pieces):
    """Yield a finding if rows repeat although the outputs are not quantised."""
    repeated = n_seen = n_nearly = 0
    steps = np.array([_finest_step(y[:, i], pieces) for i in range(y.shape[1])])
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
            moved = np.abs(np.diff(y[piece], axis=0))
            nearly = (moved < 1.5 * steps).all(axis=1) & (moved > 0).any(axis=1)
            n_nearly += int((nearly & (np.diff(u[piece], axis=0) == 0).all(axis=1)).sum())
    # values that are written to few digits meet by chance as often as they miss by one digit either way
    by_chance = n_nearly / (3 ** y.shape[1] - 1)
    excess = repeated - by_chance
    enough = max(SUSPICIOUS_COUNT, SUSPICIOUS_SHARE * n_seen, SIGMAS * np.sqrt(repeated + by_chance))
    if excess >= enough:
        yield DataFinding(
            "duplicated_samples",
            f"{repeated} of {n_seen} rows repeat the row before in every column, although the outputs are "
            "not quantised: samples were doubled, or a slower record was held. Remove them or mark them NaN.",
            {"repeated": int(repeated), "share": repeated / n_seen},
        )


def _finest_step(column: np.ndarray, pieces: list[slice]) -> float:
    """Return the least change of a signal from sample to sample; 0 where it never changes."""
    moved = np.abs(np.concatenate([np.diff(column[piece]) for piece in pieces] or [np.empty(0)]))
    moved = moved[np.isfinite(moved) & (moved > 0)]
    return float(moved.min(initial=np.inf)) if moved.size else 0.0


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
                    f"{count} samples of output {signal} stand exactly at its {word} value, "
                    f"{level:.6g}: the sensor or the recorder clips, or the system stands at a limit. "
                    "Mark them NaN where they are no measurement.",
                    {"output": j, "level": float(level), "count": count, "share": count / values.size},
                )


def _opening_rest(column, level) -> int:
    """Return how many samples a session stands at a level before it first moves."""
    moved = np.flatnonzero(column != level)
    return int(moved[0]) if moved.size else column.size


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
            f"Output {signal} shows {y[a, j]:.6g} to the last digit in samples {a} to {b - 1}{more}, "
            "while the record goes on: the sensor or the recorder is stuck there. Mark them NaN.",
            {"output": j, "value": float(y[a, j]), "stretches": [(int(a), int(b)) for a, b in held]},
        )

"""Values that recorders write where nothing was measured: -9999, say."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from narx_sklearn._validation import true_runs

FAR = 10.0  # times the range of all other values, that a dead one is off them
MOST = 0.5  # share of the samples; more is no failure
SHOWN = 3  # stretches, in words
BY_CHANCE = 0.05  # probability, below which values that come and go as inputs move do so with them
# the ends of the integers of converters, and the largest single-precision number
ENDS = (-(2**15), 2**15 - 1, 2**16 - 1, -(2**31), 2**31 - 1, 2**32 - 1, float(np.finfo(np.float32).max))
# nines alone, at least three of them, the point behind any but the last: 999, 99.9, 9.99, 9999 and so on
NINES = np.array(sorted((10**n - 1) / 10**k for n in range(3, 11) for k in range(n)))
DIGITS = 5e-11  # relative, by which a number of ten digits may be rounded
FILL = 1e30  # from which on a number is what a file is filled with, not a measurement


def dead_values(signal: np.ndarray, moves: np.ndarray | None = None) -> np.ndarray:
    """Tell which samples of a signal hold a value that stands for none, (n_samples,).

    It lies off all others by ten times their range, which must not be zero. Values that recorders are known
    to write for none (nines alone, the ends of an integer's range) count in any signal; any other only in
    what is measured, where it is repeated to the last digit, and not where it comes and goes with what
    drives the machine.

    Parameters
    ----------
    signal : ndarray of shape (n_samples,)
        NaN where missing.
    moves : ndarray of shape (n_samples, n_inputs), optional
        What drives the machine; without it only known values count.

    Returns
    -------
    ndarray of bool of shape (n_samples,)

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.model.dead_values import dead_values
    >>> np.flatnonzero(dead_values(np.array([0.1, 0.2, -9999.0, 0.1, 0.3]))).tolist()
    [2]
    """
    seen = np.isfinite(signal)
    found = np.zeros(signal.size, dtype=bool)
    known = known_values(signal[seen])
    of_known = seen & np.isin(signal, known)
    for value in known.tolist():
        at = signal == value
        found |= at & _is_far(value, signal[seen & ~of_known])
    while moves is not None:
        rest = signal[seen & ~found]
        ends = np.array([rest.min(initial=np.inf), rest.max(initial=-np.inf)])
        between = rest[~np.isin(rest, ends)]
        more = found.copy()
        for end in ends:
            more |= _repeated(signal == end, signal, between, moves)
        if (more == found).all():
            break
        found = more
    return found if found.sum() <= MOST * seen.sum() else np.zeros(signal.size, dtype=bool)


class Dead(NamedTuple):
    """Which values of a record stand for none: boolean arrays of the shapes of its inputs and outputs."""

    u: np.ndarray
    y: np.ndarray


def dead_in_record(u: np.ndarray, y: np.ndarray) -> Dead:
    """Tell which values of a record stand for none.

    Parameters
    ----------
    u : ndarray of shape (n_samples, n_inputs)
        What drives the machine, in which only known values count.
    y : ndarray of shape (n_samples, n_outputs)
        What is measured.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.model.dead_values import dead_in_record
    >>> u = np.sin(np.arange(40.0))[:, np.newaxis]
    >>> y = 0.5 * u
    >>> u[7], y[20:23] = -9999.0, 300.0
    >>> dead = dead_in_record(u, y)
    >>> np.flatnonzero(dead.u).tolist(), np.flatnonzero(dead.y).tolist()
    ([7], [20, 21, 22])
    """
    of_u, of_y = np.zeros(u.shape, dtype=bool), np.zeros(y.shape, dtype=bool)
    for j, signal in enumerate(u.T):
        of_u[:, j] = dead_values(signal)
    moves = np.where(of_u, np.nan, u)
    for j, signal in enumerate(y.T):
        of_y[:, j] = dead_values(signal, moves)
    return Dead(of_u, of_y)


class DeadColumn(NamedTuple):
    """A signal of which some values stand for none."""

    name: str
    values: np.ndarray  # that stand for none, each once
    samples: np.ndarray  # that hold them
    words: str  # which samples those are, and what the others are, to begin a sentence


def dead_columns(names: Iterable[str], signals: np.ndarray, dead: np.ndarray) -> list[DeadColumn]:
    """Return what is to be told of each signal that holds dead values.

    Parameters
    ----------
    names : iterable of str
    signals, dead : ndarray of shape (n_samples, n_signals)
        Values, and which of them stand for none.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.model.dead_values import dead_columns
    >>> u = np.array([[0.1, 0.0], [0.2, -9999.0], [0.3, 1.0]])
    >>> (found,) = dead_columns(["drive", "wind"], u, u < -999)
    >>> found.name, found.samples.tolist(), found.words[:35]
    ('wind', [1], 'One sample of wind is -9999 (1), wh')
    """
    return [
        DeadColumn(name, np.unique(signal[at]), np.flatnonzero(at), dead_in_words(signal, at, name))
        for name, signal, at in zip(names, signals.T, dead.T, strict=True)
        if at.any()
    ]


def dead_in_words(signal: np.ndarray, dead: np.ndarray, called: str) -> str:
    """Return which samples of a signal hold dead values, and what the others are, to begin a sentence."""
    values = np.unique(signal[dead])
    rest = signal[np.isfinite(signal) & ~dead]
    runs = [f"{a} to {b - 1}" if b - a > 1 else f"{a}" for a, b in true_runs(dead)]
    where = ", ".join(runs[:SHOWN]) + (", ..." if len(runs) > SHOWN else "")
    count = int(dead.sum())
    some = "One sample" if count == 1 else f"{count} samples"
    written = " or ".join(f"{value:.10g}" for value in values)
    return (
        f"{some} of {called} {'is' if count == 1 else 'are'} {written} ({where}), "
        f"where all others lie between {rest.min():.4g} and {rest.max():.4g}"
    )


def known_values(values: np.ndarray) -> np.ndarray:
    """Return those among finite values that recorders write where there is none, each once.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.model.dead_values import known_values
    >>> known_values(np.array([-9999.0, 99.0, 0.3, 99.9, -9999.0, 32767.0])).tolist()
    [-9999.0, 99.9, 32767.0]
    """
    size = np.abs(values)
    # a value is nines where f"{size:.10g}" without its point holds nothing else, and three of them
    next_nines = np.searchsorted(NINES, size * (1.0 - DIGITS))
    are_nines = NINES[np.minimum(next_nines, NINES.size - 1)] <= size * (1.0 + DIGITS)
    are_nines &= next_nines < NINES.size
    return np.unique(values[are_nines | np.isin(values, ENDS) | (size >= FILL)])


def _is_far(value: float, others: np.ndarray) -> bool:
    if not others.size:
        return False
    low, high = float(others.min()), float(others.max())
    return high > low and max(low - value, value - high) > FAR * (high - low)


def _repeated(at: np.ndarray, signal: np.ndarray, others: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Return where one value is, if far off others, repeated, and not there as inputs move; else nowhere."""
    none = np.zeros(at.size, dtype=bool)
    runs = true_runs(at)
    if not runs or max(b - a for a, b in runs) < 2 or not _is_far(float(signal[runs[0][0]]), others):
        return none
    moved = np.any(moves != np.concatenate([moves[:1], moves[:-1]]), axis=1)
    moved |= np.append(False, moved[:-1])  # what is driven may answer a sample later
    edges = [k for run in runs for k in run if 0 < k < at.size]
    goes_along = moved[edges].all() and moved.mean() ** len(edges) < BY_CHANCE
    return none if goes_along else at

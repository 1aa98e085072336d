"""Cut a record into windows of a few time constants, each with an initial state of its own."""

from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.simulators.linearise import central_differences
from narx_sklearn.discrepancy.simulators.simulator import Simulator, Windows, evaluate

WINDOWS = 40  # where an integrator or an unstable mode lets errors grow
FEWEST = 4  # of a record that has room for them
FEWEST_VALUES = 20  # measured inside windows, without which nothing is located
MOST = 60  # more windows cost information on slow dynamics and bring little
LONGEST = 50_000  # samples looked at; windows spread over a longer record stand for it
TIME_CONSTANTS = 20.0  # a free initial state explains away about the first two of them
SHOWN = 1e-6  # of an output's size that an integrated state is of it, where it is seen there
GROWTHS = 4.0  # e-foldings of an unstable mode in a window: what a state begins with wrong grows fiftyfold


class Pace(NamedTuple):
    """How fast a simulator forgets its initial state."""

    time_constant: float  # s, the longest of its decaying modes; 0 when there is none
    forgets: bool  # whether all modes decay: no integrator, nothing unstable
    growth: float = 0.0  # 1/s, of its fastest growing mode; 0 when there is none
    adds_up: tuple[bool, ...] = ()  # whether each output shows what an integrator has added up


def find_pace(simulator: Simulator, x: np.ndarray, u: np.ndarray) -> Pace:
    """Return the pace of the linearised simulator round the states visited."""
    constants, growths, lasting = [], [], 0
    size = np.max(np.abs(x), axis=0, initial=0.0, where=np.isfinite(x))
    shown: list[np.ndarray] = []
    for k in np.linspace(0, x.shape[0] - 1, 5).astype(int):
        if not np.all(np.isfinite(x[k])):
            continue
        jacobian = state_jacobian(simulator, x[k], u[k])
        if not np.all(np.isfinite(jacobian)):
            continue
        eigenvalues, modes = np.linalg.eig(jacobian)
        if simulator.discrete:
            with np.errstate(divide="ignore"):
                paces = np.log(eigenvalues.astype(complex)) / simulator.dt
        else:
            paces = eigenvalues
        rates = paces.real
        fastest = np.max(np.abs(eigenvalues)) if not simulator.discrete else 1 / simulator.dt
        slow = 1e-6 * max(fastest, 1e-300)
        decaying = rates[rates < -slow]
        lasting += decaying.size < rates.size
        if decaying.size:
            constants.append(1.0 / np.min(-decaying))
        growths.append(np.max(rates[rates > slow], initial=0.0))
        shown.append(_shows(simulator, x[k], u[k], modes[:, np.abs(paces) <= slow], size))
    return Pace(
        float(np.median(constants)) if constants else 0.0,
        2 * lasting < max(len(constants), 1),
        float(np.median(growths)) if growths else 0.0,
        tuple((2 * np.sum(shown, axis=0) > len(shown)).tolist()) if shown else (),
    )


def _shows(
    simulator: Simulator, x: np.ndarray, u: np.ndarray, modes: np.ndarray, size: np.ndarray
) -> np.ndarray:
    """Tell which outputs show any of some modes (n_states, n_modes), of states of some size, (n_outputs,)."""
    size = np.maximum(size, 1e-3)
    C = np.nan_to_num(central_differences(lambda v: evaluate(simulator, v, u)[1], x, 1e-5 * size))
    of_modes = np.abs(C @ (modes / np.max(np.abs(modes) / size[:, None], axis=0, initial=1e-300)))
    return np.any(of_modes > SHOWN * (np.abs(C) @ size)[:, None], axis=1)


def resonances(simulator: Simulator, x: np.ndarray, u: np.ndarray, below: float) -> np.ndarray:
    """Return the frequencies, in Hz and rising, of modes at one point that are damped less than a ratio.

    Parameters
    ----------
    x, u : ndarray of shape (n_states,) and (n_inputs,)
        The point.
    below : float
        Damping ratio that a mode has at most.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy import ODESimulator
    >>> from narx_sklearn.discrepancy.simulators.windows import resonances
    >>> spring = ODESimulator(lambda x, u, p: (x[1], u[0] - p[0] * x[0] - p[1] * x[1]), dt=0.01,
    ...                       parameters={"k": (2 * np.pi) ** 2, "c": 0.1}, states=["x", "v"], inputs=["f"])
    >>> resonances(spring, np.zeros(2), np.zeros(1), below=0.25).round(3).tolist()
    [1.0]
    """
    jacobian = state_jacobian(simulator, x, u)
    if not np.all(np.isfinite(jacobian)):
        return np.empty(0)
    poles = np.linalg.eigvals(jacobian).astype(complex)
    if simulator.discrete:
        poles = np.log(poles[poles != 0]) / simulator.dt
    swinging = poles[(poles.imag > 0) & (poles.real <= 0)]
    return np.sort(swinging.imag[-swinging.real < below * np.abs(swinging)]) / (2 * np.pi)


def state_jacobian(simulator: Simulator, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Return d rhs / d x beside one point, (n_states, n_states), with steps that suit small units too."""
    steps = 1e-5 * np.maximum(np.abs(x), 1e-3)
    x = simulator.switches.clear_of(x, steps)
    return central_differences(lambda v: evaluate(simulator, v, u)[0], x, steps)


def cut(pieces, length: int, shortest: int) -> Windows:
    """Cut pieces of a record into windows of about ``length`` samples; those below ``shortest`` are left out.

    Parameters
    ----------
    pieces : list of (slice, int)
        Stretches without gaps, in order, each with the first sample of its session.
    """
    first, last, fresh, began = [], [], [], []
    for piece, session in pieces:
        n = piece.stop - piece.start
        if n < shortest:
            continue
        count = max(1, round(n / length))
        edges = np.linspace(piece.start, piece.stop, count + 1).astype(int)
        for i in range(count):
            first.append(edges[i])
            last.append(edges[i + 1])
            fresh.append(i == 0)
            began.append(session)
    integers = [np.array(values, dtype=np.int64) for values in (first, last, began)]
    return Windows(integers[0], integers[1], np.array(fresh, dtype=bool), integers[2])


def spread_out(windows: Windows, most: int = LONGEST) -> Windows:
    """Return windows of at most ``most`` samples together, evenly spread over those given."""
    lengths = windows.last - windows.first
    if lengths.sum() <= most:
        return windows
    count = max(1, int(most // lengths.mean()))
    return chosen_of(windows, np.unique(np.linspace(0, windows.count - 1, count).round().astype(int)))


def chosen_of(windows: Windows, chosen: np.ndarray) -> Windows:
    """Return some of the windows, by their numbers in order."""
    fresh = windows.fresh[chosen]
    fresh |= np.diff(chosen, prepend=-2) > 1  # nothing is carried over from a window left out
    return Windows(windows.first[chosen], windows.last[chosen], fresh, windows.began[chosen])


def window_length(simulator: Simulator, pace: Pace, n_samples: int) -> int:
    """Return the number of samples in a window: many time constants, or a share of the record.

    Where something grows, the window is over before the run knows nothing of the recording any more.
    """
    n_free = int(simulator.free_states.sum())
    wanted = n_samples / WINDOWS
    if pace.forgets and pace.time_constant > 0:
        wanted = TIME_CONSTANTS * pace.time_constant / simulator.dt
    length = min(np.clip(wanted, n_samples / MOST, n_samples / FEWEST), followed_for(simulator, pace))
    return int(max(min(length, LONGEST / FEWEST), 8 * (n_free + 1)))


def shortest_window(simulator: Simulator) -> int:
    """Return the number of samples below which a window tells nothing beyond its initial state."""
    return 4 * (int(simulator.free_states.sum()) + 1)


def followed_for(simulator: Simulator, pace: Pace) -> float:
    """Return for how many samples a run follows a machine: infinitely many where nothing grows."""
    return GROWTHS / (pace.growth * simulator.dt) if pace.growth > 0 else np.inf

"""Which input would separate what these data cannot: the next experiment, and how alike effects look."""

from collections.abc import Collection
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy.stats import norm

from narx_sklearn.discrepancy.bank import effect_column
from narx_sklearn.discrepancy.candidate import HARDLY
from narx_sklearn.discrepancy.designs import make_designs, read_limits, settled
from narx_sklearn.discrepancy.hypotheses import enumerate_hypotheses
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.problem import Model, Problem
from narx_sklearn.discrepancy.refit import fit
from narx_sklearn.discrepancy.simulator import Simulator, Windows
from narx_sklearn.discrepancy.structure import find_structure
from narx_sklearn.discrepancy.windows import cut, find_pace, followed_for

NEAR_ZERO = 0.1  # of half the range: an input that was meant to go as far both ways
AS_GOOD = 2  # decimals of the expected number of pairs told apart, to which designs are as good
RESOLVED = 4.0  # separation, in standard deviations of the noise, at which a pair counts as told apart
SHARES = 20  # of the farthest that an explanation may be from its special case, evenly
LOST = 5.0  # times as long as a run follows an unstable machine, after which it is far from anything


class Experiment(NamedTuple):
    """A proposed input and what it would show.

    Attributes
    ----------
    u : ndarray of shape (n_samples, n_inputs)
        The input, within the limits asked for.
    kind : str
        What it is, in words.
    separation : float
        Distance of the worst pair in standard deviations of the noise, after everything else was refitted.
    chance : float
        Chance that the pair least likely to be told apart then is; where one explanation holds the other as a
        special case, averaged over how far from it the truth may be.
    table : DataFrame
        All designs tried, by separation.
    pairs : tuple of str
        The pairs it separates.
    """

    u: np.ndarray
    kind: str
    separation: float
    chance: float
    table: pd.DataFrame
    pairs: tuple[str, ...]


def design_experiment(
    simulators: dict[str, Simulator],
    *,
    noise: Noise,
    amplitude: float,
    n_samples: int,
    offset: float = 0.0,
    rate: float | None = None,
    column: int = 0,
    held: np.ndarray | None = None,
    nested: Collection[tuple[str, str]] = (),
    random_state=None,
    n_jobs: int | None = None,
) -> Experiment:
    """Return the input that best separates rival simulators.

    Each pair's distance is what is left of the difference of their outputs after the rival's parameters are
    refitted to the other's output (to first order), over the noise. What holds its rival as a special case
    can do all that this one does, so there only the other way counts, and the truth may be anywhere between
    the special case and what was passed. The design wins that tells most pairs apart, each counted with its
    chance. Among designs that are as good it is the one that tells most of all parameters (the determinant of
    their information is largest), for the truth may be none of the rivals.

    Parameters
    ----------
    simulators : dict of {str: Simulator}
        At least two fitted rivals, with their effects.
    noise : Noise
        Noise of the measurement.
    amplitude, offset : float
        The input stays within ``offset - amplitude`` and ``offset + amplitude``. The experiment begins where
        the simulation rests at the offset, if it does.
    n_samples : int
        Length of the experiment.
    rate : float, optional
        Largest change of the input in one second.
    column : int, default=0
        The input that is moved; the others stay at ``held`` (zero).
    nested : collection of (str, str)
        Which of the rivals holds which as a special case.
    n_jobs : int, optional
        Threads in which designs are tried.

    Raises
    ------
    TypeError, ValueError
        If a limit is no limit, there are fewer than two rivals, or their runs are lost under every design.
    """
    if len(simulators) < 2:
        raise ValueError(f"simulators holds {list(simulators)}; wanted are at least two rivals.")
    some = next(iter(simulators.values()))
    limits = read_limits(some, amplitude, n_samples, offset=offset, rate=rate, column=column)
    base = np.zeros(len(some.inputs)) if held is None else np.array(held, dtype=float)
    base[limits.column] = limits.offset
    starts = {name: settled(simulator, base, n_samples) for name, simulator in simulators.items()}
    with np.errstate(all="ignore"):
        paces = [
            find_pace(simulator, starts[name][None], base[None]) for name, simulator in simulators.items()
        ]
    if n_samples > LOST * followed_for(some, max(paces, key=lambda pace: pace.growth)):
        raise ValueError(_lost_in(n_samples))
    of_a_share = {
        f"{a} / {b}" for a, b in combinations(simulators, 2) if ((a, b) in nested) != ((b, a) in nested)
    }

    def tried(kind: str, u: np.ndarray) -> dict[str, Any]:
        distances, told = {}, 0.0
        for a, b in combinations(simulators, 2):
            ways = [
                _distance(simulators[truth], simulators[rival], u, starts[truth], noise)
                for truth, rival in ((a, b), (b, a))
                if (rival, truth) not in nested or (truth, rival) in nested
            ]
            distances[f"{a} / {b}"] = min(way.noises for way in ways)
            told += sum(way.information for way in ways)
        chances = _chances(distances, of_a_share)
        facts = {
            "design": kind,
            "separation": min(distances.values()),
            "chance": min(chances),
            "expected": round(sum(chances), AS_GOOD),
            "information": told,
        }
        return facts | distances

    designs = make_designs(some, starts[next(iter(simulators))], base, limits, random_state)
    found = Parallel(n_jobs=n_jobs, prefer="threads")(delayed(tried)(*design) for design in designs)
    table = pd.DataFrame(found)
    pairs = tuple(table.columns[5:])
    if np.isneginf(table["information"]).all() and not table[list(pairs)].to_numpy().any():
        raise ValueError(_lost_in(n_samples))
    chosen = max(table.index, key=lambda k: (table["expected"][k], table["information"][k]))
    (_, u), facts = designs[chosen], found[chosen]
    table = table.sort_values("separation", ascending=False, ignore_index=True)
    return Experiment(u, facts["design"], float(facts["separation"]), facts["chance"], table, pairs)


def _lost_in(n_samples: int) -> str:
    """Return what to say of an experiment in which every run is lost."""
    return (
        f"In {n_samples} samples a simulation is lost: no input alone drives an unstable machine. Put its "
        "controller into the simulator, so that the reference is the input; or a smaller amplitude, an "
        "offset at which it rests, or fewer samples."
    )


def middle_of(u: np.ndarray) -> np.ndarray:
    """Return the middle of the range of each input of a record (n, n_inputs), zero where that is near it."""
    lowest, highest = np.nanmin(u, axis=0), np.nanmax(u, axis=0)
    middle = (lowest + highest) / 2
    return np.where(np.abs(middle) <= NEAR_ZERO * (highest - lowest) / 2, 0.0, middle)


def chance(separation):
    """Return the chance that the wrong one of two rivals at a distance d, or at each of many, is excluded.

    The criterion's difference is normal about d^2 with a deviation of 2 d, and must exceed ``HARDLY``.
    """
    separation = np.asarray(separation, dtype=float)
    with np.errstate(divide="ignore"):
        return norm.cdf(separation / 2.0 - HARDLY / (2.0 * separation))


def _chances(distances: dict[str, float], of_a_share: Collection[str]) -> list[float]:
    """Return the chance of each pair to be told apart; of some their distance is the farthest that may be."""
    shares = (np.arange(SHARES) + 0.5) / SHARES
    return [
        float(np.mean([chance(d * share) for share in shares])) if pair in of_a_share else float(chance(d))
        for pair, d in distances.items()
    ]


class Distance(NamedTuple):
    """How far a rival, refitted, stays from another's output."""

    noises: float  # in standard deviations of the noise
    information: float  # logarithm of the determinant of what is known of the rival's parameters then


def _distance(truth: Simulator, rival: Simulator, u: np.ndarray, start: np.ndarray, noise: Noise) -> Distance:
    """Return how far the rival, refitted, stays from the truth's output."""
    windows = Windows.whole([slice(0, len(u))])
    x0 = start[None]
    y = truth.run(u, windows, x0).y
    if not np.all(np.isfinite(y)):
        return Distance(0.0, -np.inf)
    problem = Problem(rival, u, y, windows, noise)
    found = fit(problem, Model(rival.nominal, rival.effects, x0), iterations=6)
    if not np.isfinite(found.cost):
        return Distance(0.0, -np.inf)
    # a parameter is known within its own size before: so one that nothing shows tells neither much nor little
    size = np.where(found.model.q != 0, np.abs(found.model.q), 1.0)
    columns = found.jacobian.reshape(-1, size.size) * size
    known = np.eye(size.size) + columns.T @ columns
    return Distance(float(np.sqrt(found.cost)), float(np.linalg.slogdet(known)[1]))


def confusability(
    simulator: Simulator, X, *, effects, noise: float, n_windows: int = 24
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Tell, before any measurement, which effects an input can show and which look alike under it.

    Parameters
    ----------
    simulator : Simulator
        The simulation as it stands.
    X : ndarray of shape (n_samples, n_inputs)
        The input that will be used.
    effects : sequence of Effect
        What might be missing.
    noise : float
        Standard deviation of the measurement noise, in the output's unit.
    n_windows : int, default=24
        Windows with initial states of their own.

    Returns
    -------
    angles : DataFrame
        Angle in degrees between every two effects' columns, after the simulator's own parameters and initial
        states are projected out; near 0 they cannot be told apart.
    visible : DataFrame
        For each effect its smallest size that is found with good chance, as a share of an ordinary size.
    """
    u = np.ascontiguousarray(X, dtype=float).reshape(len(X), -1)
    whole = Windows.whole([slice(0, len(u))])
    run = simulator.run(u, whole, np.zeros((1, len(simulator.states))))
    structure = find_structure(simulator, run.x, u)
    windows = cut([(slice(0, len(u)), 0)], max(8, len(u) // n_windows), 4)
    n_outputs = len(simulator.outputs)
    problem = Problem(simulator, u, run.y, windows, Noise.white(np.full(n_outputs, float(noise))))
    base = fit(problem, Model(simulator.nominal, simulator.effects, run.x[windows.first]), iterations=0)
    hypotheses = enumerate_hypotheses(effects, problem, base.model, run, structure)
    names, columns = [], []
    flat = base.jacobian.reshape(-1, base.jacobian.shape[2])
    basis = (
        np.linalg.qr(flat / np.maximum(np.linalg.norm(flat, axis=0), 1e-300))[0] if flat.shape[1] else flat
    )
    for hypothesis in hypotheses:
        best = None
        for start in hypothesis.starts:
            column = base.projector(effect_column(problem, base, run, hypothesis.placed.at(start))).ravel()
            column = column - basis @ (basis.T @ column)
            length = float(np.linalg.norm(column))
            if best is None or length > best[0]:
                best = (length, column)
        if best is not None and best[0] > 0:
            placed = hypothesis.placed
            names.append(f"{placed.effect.code} at {placed.port} ({placed.argument_name})")
            columns.append(best)
    unit = np.array([column / length for length, column in columns])
    cosine = np.clip(np.abs(unit @ unit.T), 0, 1) if len(unit) else np.zeros((0, 0))
    angles = pd.DataFrame(np.degrees(np.arccos(cosine)), index=names, columns=names)
    visible = pd.DataFrame(
        {
            "separation": [length for length, _ in columns],
            "smallest_share": [RESOLVED / length for length, _ in columns],
        },
        index=pd.Index(names, name="effect"),
    )
    return angles, visible

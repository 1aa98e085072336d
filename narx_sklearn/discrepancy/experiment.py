"""Which input would separate rivals that a record cannot tell apart."""

from collections.abc import Collection
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy.stats import norm

from narx_sklearn.discrepancy.designs import make_designs, read_limits, settled, spliced
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.search.candidate import HARDLY
from narx_sklearn.discrepancy.search.lookalikes import CERTAIN, REFINES
from narx_sklearn.discrepancy.simulators.simulator import Simulator, Windows
from narx_sklearn.discrepancy.simulators.windows import find_pace, followed_for

USUAL = (0.05, 0.95)  # quantiles between which an input usually is
NEAR_ZERO = 0.1  # of half the range: an input that was meant to go as far both ways
AS_GOOD = 2  # decimals of the expected number of pairs told apart, to which designs are as good
SPLICED = 4  # best designs of which each half is tried with that of another
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
    refitted to the other's output (to first order), over the noise. Forms are idealised, so of two neither of
    which holds the other it must also be more than next to nothing of what the effects do that not all rivals
    share, or more than any noise does. What holds its rival as a special case can do all that this one does,
    so there only the other way counts, and the truth may be anywhere between the special case and what was
    passed. The design wins that tells most pairs apart, each counted with its chance; where none is likely to
    tell any, the one that comes nearest to it. The best are tried in halves with one another too. Among
    designs that are as good it is the one that tells most of all parameters (the determinant of their
    information is largest), for the truth may be none of the rivals.

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
        raise ValueError(lost_in(n_samples))
    of_a_share = {
        f"{a} / {b}" for a, b in combinations(simulators, 2) if ((a, b) in nested) != ((b, a) in nested)
    }

    shared = set.intersection(*({e.place for e in some.effects} for some in simulators.values()))

    def tried(kind: str, u: np.ndarray) -> tuple[dict[str, Any], float]:
        distances, wanted, told = {}, {}, 0.0
        done = {
            name: _distance(simulator, _with_only(simulator, shared), u, starts[name], noise).noises ** 2
            for name, simulator in simulators.items()
        }
        for a, b in combinations(simulators, 2):
            ways = [
                (_distance(simulators[truth], simulators[rival], u, starts[truth], noise), done[truth])
                for truth, rival in ((a, b), (b, a))
                if (rival, truth) not in nested or (truth, rival) in nested
            ]
            nearest, does = min(ways, key=lambda way: way[0].noises)
            pair = f"{a} / {b}"
            distances[pair] = nearest.noises
            wanted[pair] = HARDLY if pair in of_a_share else np.clip(REFINES * does, HARDLY, CERTAIN)
            told += sum(way.information for way, _ in ways)
        chances = _chances(distances, wanted, of_a_share)
        facts = {
            "design": kind,
            "separation": min(distances.values()),
            "chance": min(chances),
            "expected": round(sum(chances), AS_GOOD),
            "information": told,
        }
        return facts | distances, min(d**2 / wanted[pair] for pair, d in distances.items())

    designs = make_designs(some, starts[next(iter(simulators))], base, limits, random_state)
    with Parallel(n_jobs=n_jobs, prefer="threads") as parallel:
        outcomes = list(parallel(delayed(tried)(*design) for design in designs))
        order = sorted(range(len(designs)), key=lambda k: (outcomes[k][0]["expected"], outcomes[k][1]))
        together = spliced([designs[k] for k in order[: -SPLICED - 1 : -1]], limits, some.dt)
        outcomes += parallel(delayed(tried)(*design) for design in together)
    designs = designs + together
    found, reached = zip(*outcomes, strict=True)
    table = pd.DataFrame(found)
    pairs = tuple(table.columns[5:])
    if np.isneginf(table["information"]).all() and not table[list(pairs)].to_numpy().any():
        raise ValueError(lost_in(n_samples))
    # where no design is likely to tell a pair apart, the one that comes nearest to it
    goodness = table["information"] if table["expected"].any() else reached
    chosen = max(table.index, key=lambda k: (table["expected"][k], goodness[k]))
    (_, u), facts = designs[chosen], found[chosen]
    table = table.sort_values("separation", ascending=False, ignore_index=True)
    return Experiment(u, facts["design"], float(facts["separation"]), facts["chance"], table, pairs)


def lost_in(n_samples: int) -> str:
    """Return what to say of an experiment in which every run is lost."""
    return (
        f"In {n_samples} samples a simulation is lost: no input alone drives an unstable machine. Put its "
        "controller into the simulator, so that the reference is the input; or a smaller amplitude, an "
        "offset at which it rests, or fewer samples."
    )


def middle_of(u: np.ndarray) -> np.ndarray:
    """Return the middle of the usual range of each input of a record (n, n_inputs), or zero if that is near.

    One peak that goes far is not usual.
    """
    lowest, highest = np.nanquantile(u, USUAL, axis=0) if u.shape[1] else np.zeros((2, 0))
    middle = (lowest + highest) / 2
    return np.where(np.abs(middle) <= NEAR_ZERO * (highest - lowest) / 2, 0.0, middle)


def chance(separation, wanted=HARDLY):
    """Return the chance that the wrong one of two rivals at a distance d, or at each of many, is excluded.

    The criterion's difference is normal about d^2 with a deviation of 2 d, and must exceed what is wanted.
    """
    separation = np.asarray(separation, dtype=float)
    with np.errstate(divide="ignore"):
        return norm.cdf(separation / 2.0 - wanted / (2.0 * separation))


def _chances(
    distances: dict[str, float], wanted: dict[str, float], of_a_share: Collection[str]
) -> list[float]:
    """Return the chance of each pair to be told apart; of some their distance is the farthest that may be."""
    shares = (np.arange(SHARES) + 0.5) / SHARES
    return [
        float(np.mean(chance(d * (shares if pair in of_a_share else 1.0), wanted[pair])))
        for pair, d in distances.items()
    ]


def _with_only(simulator: Simulator, places: Collection[tuple]) -> Simulator:
    """Return a simulator with those of its effects that are at some places."""
    return simulator.with_effects([effect for effect in simulator.effects if effect.place in places])


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

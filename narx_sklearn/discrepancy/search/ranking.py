"""What takes most off the cost, to first order: single effects, and pairs of which neither shows alone."""

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.bank import Bank, entered
from narx_sklearn.discrepancy.search.confirm import LOAD, OFFSET
from narx_sklearn.discrepancy.search.detect import NONE_SILENT, Detection

STARTS = 2  # of one leader that are tried
MANY = 6  # starts of one effect, of which one more is tried: a shape with jumps has many valleys
NEARLY = 0.3  # share of the gain of its best start that another one must have
LINES = {"periodic_disturbance"}  # effects that the test over the bank cannot see, but that of a line can
PARTS = 20  # of the time, by which it is told whether the mismatch is in few places
SELDOM = 0.5  # share of the mismatch in a tenth of them, from which it is
APART = 0.01  # share of a column's square that another must leave, for the two to be told apart


class Gains(NamedTuple):
    """What each column would take off the cost at its best strength."""

    gain: np.ndarray  # (n_columns,) zero where the sign is not physical
    strength: np.ndarray  # (n_columns,)


class Pair(NamedTuple):
    """Columns of two effects, their strengths beside each other, and what they take off the cost together."""

    columns: tuple[int, int]
    strengths: tuple[float, float]
    gain: float

    def places(self, bank: Bank) -> tuple[tuple, ...]:
        """Return what the two effects are and where they act."""
        return tuple(bank.hypotheses[bank.owner[j]].placed.place for j in self.columns)

    def effects(self, bank: Bank) -> tuple[PlacedEffect, ...]:
        """Return the two effects, each at its strength."""
        return tuple(
            scaled(bank, j, strength) for j, strength in zip(self.columns, self.strengths, strict=True)
        )


def gains(bank: Bank) -> Gains:
    """Return each column's gain, physical signs respected."""
    length = np.diag(bank.gram)
    safe = np.where(bank.useful & (length > 0), length, 1.0)
    strength = np.where(bank.useful, bank.plain / safe, 0.0)
    gain = np.where(bank.useful, bank.plain**2 / safe, 0.0)
    return Gains(np.where(_within(strength, _strengths(bank)), gain, 0.0), strength)


def _strengths(bank: Bank) -> np.ndarray:
    """Return the least and the largest physical strength of each column, (2, n_columns)."""
    limits = np.empty((2, bank.n_columns))
    for j, (h, s) in enumerate(zip(bank.owner, bank.start, strict=True)):
        placed, start = bank.hypotheses[h].placed, bank.hypotheses[h].starts[s]
        amplitude = placed.amplitude
        if amplitude is None:
            limits[:, j] = 0.0, np.inf
        elif start[amplitude]:
            limits[:, j] = sorted(placed.bounds[amplitude] / start[amplitude])
        else:
            limits[:, j] = np.inf, -np.inf
    return limits


def _within(strength: np.ndarray, limits: np.ndarray) -> np.ndarray:
    return (strength >= limits[0]) & (strength <= limits[1]) & (strength != 0)


def leaders(bank: Bank, n: int, detection: Detection, alpha: float) -> list[PlacedEffect]:
    """Return the hypotheses with the largest gains, their best starts each, scaled to their best strength.

    What is met seldom throws a run so far off that tangents along it tell little: then all are leaders that
    act beyond a threshold. Of effects that no parameter scales :func:`with_nearest` adds the last start.
    """
    gain, strength = gains(bank)
    scanned = {h.placed.effect.code for h in bank.hypotheses if h.placed.effect.scan}
    best: dict[int, list[int]] = {}
    for j in np.argsort(-gain, kind="stable"):
        if gain[j] <= 0:
            break
        if not bank.hypotheses[bank.owner[j]].asked:
            continue
        if _speaking_for(bank.placed(j), detection, scanned) > alpha:
            continue  # the test that speaks for this kind of effect was silent
        best.setdefault(int(bank.owner[j]), []).append(int(j))
    found = []
    seldom = _is_met_seldom(bank)
    for rank, (h, columns) in enumerate(best.items()):
        hypothesis = bank.hypotheses[h]
        if rank >= n and not (seldom and hypothesis.placed.effect.acts_in is not None):
            continue
        most = max(STARTS, len(hypothesis.starts) // MANY)
        chosen = [j for j in columns if gain[j] > NEARLY * gain[columns[0]]][:most]
        if hypothesis.placed.amplitude is None:
            chosen = chosen[: most - 1]
        found += [scaled(bank, j, strength[j]) for j in chosen]
    return found


def with_nearest(
    problem: Problem,
    base: Fit,
    bank: Bank,
    placed: list[PlacedEffect],
    n_jobs: int | None = None,
    *,
    known: Collection[tuple] = (),
) -> list[PlacedEffect]:
    """Return leaders, and of those that no parameter scales the start that leaves least as it stands.

    Tangents along a run without them tell what a little of them would do: of a limit that is never reached
    nothing, of one that is always reached most. One start is added of each form in which they are built;
    none at places that are ``known``, where an earlier fit goes on.
    """
    unscaled = {effect.place for effect in placed if effect.amplitude is None}.difference(known)
    tried = [
        effect
        for effect in map(bank.placed, np.flatnonzero(bank.useful).tolist())
        if effect.place in unscaled
    ]
    if not tried:
        return placed
    run = problem.run(base.model)
    begun = Parallel(n_jobs=n_jobs, prefer="threads")(
        delayed(entered)(problem, base, run, effect) for effect in tried
    )
    nearest: dict[tuple, PlacedEffect] = {}
    for i in np.argsort([one.left for one in begun], kind="stable"):
        choice = tried[i].effect.choice
        form = None if choice is None else tried[i].theta[choice]
        nearest.setdefault((tried[i].place, form), tried[i])
    return list(dict.fromkeys([*placed, *nearest.values()]))


def _is_met_seldom(bank: Bank) -> bool:
    """Tell whether most of what is left is in few parts of the time."""
    if bank.residual.size < PARTS:
        return False
    squares = bank.residual.ravel() ** 2
    costs = np.sort([part.sum() for part in np.array_split(squares, PARTS)])
    return bool(costs[-(PARTS // 10) :].sum() > SELDOM * costs.sum())


def scaled(bank: Bank, column: int, strength: float) -> PlacedEffect:
    """Return the effect behind a column at a strength, where it has one."""
    placed = bank.placed(column)
    theta = np.array(placed.theta)
    if placed.amplitude is not None:
        theta[placed.amplitude] *= strength
    return placed.at(np.clip(theta, placed.bounds[:, 0], placed.bounds[:, 1]))


def with_pushes(bank: Bank, n: int) -> list[PlacedEffect]:
    """Return the hypotheses with the largest gains, and every constant push and offset.

    Where little moves, or far from where a machine is, all effects are pushes, and those with more values may
    stand before them.
    """
    placed = leaders(bank, len(bank.hypotheses), NONE_SILENT, 1.0)
    first = set(list(dict.fromkeys(effect.place for effect in placed))[:n])
    return [e for e in placed if e.place in first or e.effect.code in (LOAD, OFFSET)]


def _speaking_for(placed: PlacedEffect, detection: Detection, scanned: set[str]) -> float:
    """Return the p-value of the test that can see such an effect, or what looks like it."""
    if placed.effect.code in LINES:
        return detection.p_line
    if scanned & {placed.effect.code, *placed.effect.lookalikes}:
        return min(detection.p_bank, detection.p_scan)
    return detection.p_bank


def pairs(bank: Bank) -> list[Pair]:
    """Return what the best of each two hypotheses take off the cost together, most first.

    Two effects of which each undoes much of the other (a dead zone, and a friction that holds what is let
    go) take little alone, so that no search that adds the best one after another meets them.
    """
    named = np.array([h.asked and not h.placed.odd for h in bank.hypotheses], dtype=bool)
    used = np.flatnonzero(bank.useful & (np.diag(bank.gram) > 0) & named[bank.owner])
    gram, plain, owner = bank.gram[np.ix_(used, used)], bank.plain[used], bank.owner[used]
    limits, length = _strengths(bank)[:, used], np.diag(gram)
    found: list[Pair] = []
    for h in np.unique(owner)[:-1]:
        mine, others = np.flatnonzero(owner == h), np.flatnonzero(owner > h)
        common, across, along = gram[np.ix_(mine, others)], length[mine, None], length[others]
        determinant = across * along - common**2
        apart = determinant > APART * across * along
        safe = np.where(apart, determinant, 1.0)
        one = (plain[mine, None] * along - plain[others] * common) / safe
        other = (plain[others] * across - plain[mine, None] * common) / safe
        physical = _within(one, limits[:, mine, None]) & _within(other, limits[:, None, others])
        gain = np.where(apart & physical, plain[mine, None] * one + plain[others] * other, 0.0)
        for partner in np.unique(owner[others]):
            of_partner = np.flatnonzero(owner[others] == partner)
            i, k = np.unravel_index(np.argmax(gain[:, of_partner]), (mine.size, of_partner.size))
            j = of_partner[k]
            if gain[i, j] > 0 and bank.hypotheses[h].placed.place != bank.hypotheses[partner].placed.place:
                columns = int(used[mine[i]]), int(used[others[j]])
                found.append(Pair(columns, (one[i, j], other[i, j]), gain[i, j]))
    return sorted(found, key=lambda pair: -pair.gain)

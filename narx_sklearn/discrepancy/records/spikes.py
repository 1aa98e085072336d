"""Single samples at which a sensor failed: seen in what a refitted simulation leaves, and left out."""

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd
from scipy.stats import mannwhitneyu, norm

from narx_sklearn._validation import true_runs
from narx_sklearn.discrepancy.records.finding import DataFinding
from narx_sklearn.discrepancy.simulators.simulator import Signal

ALONE = 2  # samples of one spike, at most
AROUND = 3  # samples on either side of one that it is held against
SUSPECT = 6.0  # robust standard deviations off its neighbours, from which a measured sample is looked at
FAR = 8.0  # the same of what a simulation leaves, from which a sample is no measurement
STANDS_OUT = 5.0  # times the range of the middle ones among its neighbours, that it must be off them
FALSE_ALARM = 0.01  # chance that Gaussian noise, of whatever colour, leaps so far anywhere in a record
MOST = 0.02  # share of the samples; more is no failure of single ones
SHOWN = 5  # of them
WITH_INPUT = 2.0  # times the usual move of an input, with which what looks like spikes goes along with it
BY_CHANCE = 0.001  # that failures of a sensor come where its machine moves more than elsewhere


def find_spikes(
    y: np.ndarray, left_by_refit: Callable[[], tuple[np.ndarray, list[slice]]], u: np.ndarray, pieces
) -> np.ndarray:
    """Tell which samples (n_samples, n_outputs) stand alone, far off what was measured before and after.

    What a machine does lasts for some samples, and what a simulation lacks does so; a loose contact need not.
    Where samples of the record itself stand out, the decision is made on what the refitted simulation leaves.
    None is told where they come when an input moves, or where the machine moves more than elsewhere as blows
    in a gap do, or where they are many.

    Parameters
    ----------
    left_by_refit : callable
        Returns what the refitted simulation leaves, (n_samples, n_outputs), NaN where it was not run, and the
        windows that it was run over: where one begins, what is left leaps.
    pieces : iterable of slice
        Stretches without gaps.
    """
    pieces = list(pieces)
    found = np.zeros(y.shape, dtype=bool)
    suspects = [j for j in range(y.shape[1]) if _standing_out(y[:, j], pieces, SUSPECT).any()]
    if not suspects:
        return found
    left, windows = left_by_refit()
    for j in suspects:
        spikes = _standing_out(left[:, j], windows, FAR)
        few = spikes.sum() <= MOST * np.isfinite(y[:, j]).sum()
        if few and not _come_with_input(spikes, u) and not _come_with_motion(spikes, y[:, j], pieces):
            found[:, j] = spikes
    return found


def _standing_out(signal: np.ndarray, pieces: Sequence[slice], far: float) -> np.ndarray:
    """Tell which samples are further off the median around them than noise and motion take others."""
    off, spread = np.full(signal.size, np.nan), np.full(signal.size, np.nan)
    for piece in pieces:
        values = pd.Series(signal[piece])
        around = values.rolling(2 * AROUND + 1, center=True, min_periods=AROUND + 1)
        off[piece] = values - around.median()
        # two spikes among seven do not touch these quantiles
        spread[piece] = around.quantile(0.65) - around.quantile(0.35)
    size = np.abs(off)
    seen = np.isfinite(size)
    if not seen.any():
        return np.zeros(signal.size, dtype=bool)
    moving = size[seen & (size > 0)]
    usual = max(1.4826 * float(np.median(size[seen])), float(np.median(moving)) if moving.size else 0.0)
    with np.errstate(invalid="ignore"):
        candidates = seen & (size > far * usual) & (size > STANDS_OUT * spread)
    if not candidates.any():
        return candidates
    return _there_and_back(signal, pieces, _short_runs(candidates))


def _there_and_back(signal: np.ndarray, pieces: Sequence[slice], runs: np.ndarray) -> np.ndarray:
    """Return the mask of those runs that a leap leads to, and one as far back leads away from.

    How far a sample is off the median around it has heavier tails the more the noise remembers, as the median
    of what wanders is often the sample itself. A difference of two samples is normal where the noise is, of
    whatever colour, and so is the mean of two, which spreads no more: it is known what the largest of a
    record hardly reaches.
    """
    kept = np.zeros(runs.size, dtype=bool)
    leaps = np.full(signal.size + 1, np.nan)  # to each sample from the one before
    for piece in pieces:
        begin, end, _ = piece.indices(signal.size)
        leaps[begin + 1 : end] = np.diff(signal[begin:end])
    size = np.abs(leaps[np.isfinite(leaps)])
    if not size.size:
        return kept
    moving = size[size > 0]  # of rounded signals most may stand
    usual = float(np.median(size)) or (float(np.median(moving)) if moving.size else 0.0)
    least = norm.isf(FALSE_ALARM / (2 * ALONE * size.size)) * usual / norm.ppf(0.75)
    for a, b in true_runs(runs):
        there, back = leaps[a], -leaps[b]
        known = np.array([leap for leap in (there, back) if np.isfinite(leap)])  # one at an edge of a piece
        towards = known * np.sign(known.sum())
        kept[a:b] = known.size > 0 and towards.mean() > least and towards.min() > least / 2
    return kept


def _short_runs(mask: np.ndarray) -> np.ndarray:
    """Return the mask without runs of more than a few samples."""
    kept = np.zeros(mask.size, dtype=bool)
    for a, b in true_runs(mask):
        kept[a:b] = b - a <= ALONE
    return kept


def _come_with_input(spikes: np.ndarray, u: np.ndarray) -> bool:
    """Tell whether an input moves more than usual where the spikes are, or just before."""
    at = np.flatnonzero(spikes)
    if not at.size:
        return False
    moves = np.abs(np.diff(u, axis=0, prepend=u[:1]))
    for column in np.nan_to_num(moves).T:
        latest = np.maximum(column, np.concatenate([[0.0], column[:-1]]))
        if latest.mean() > 0 and latest[at].mean() > WITH_INPUT * latest.mean():
            return True
    return False


def _come_with_motion(spikes: np.ndarray, signal: np.ndarray, pieces: Sequence[slice]) -> bool:
    """Tell whether a signal is further from its mean around the spikes than around other samples.

    Of spikes that are near to each other one counts.
    """
    others = np.where(spikes, np.nan, signal)
    squares, motion = (others - np.nanmean(others)) ** 2, np.full(signal.size, np.nan)
    width = 2 * AROUND + 1
    for piece in pieces:
        motion[piece] = pd.Series(squares[piece]).rolling(width, center=True, min_periods=2).mean()
    known = np.isfinite(motion)
    at = np.flatnonzero(spikes & known)
    apart = at[np.diff(at // width, prepend=-1) > 0]
    if not apart.size:
        return False
    elsewhere = motion[known & ~spikes]
    return bool(mannwhitneyu(motion[apart], elsewhere, alternative="greater").pvalue < BY_CHANCE)


def spikes_as_findings(spikes: np.ndarray, outputs: Sequence[Signal]) -> list[DataFinding]:
    """Return a finding for each output with spikes (n_samples, n_outputs)."""
    found = []
    for column, signal in zip(spikes.T, outputs, strict=True):
        at = np.flatnonzero(column)
        if at.size:
            some = "One sample" if at.size == 1 else f"{at.size} samples"
            told = f"{some} of {signal.name} {'stands' if at.size == 1 else 'stand'}"
            first = ", ".join(map(str, at[:SHOWN])) + (", ..." if at.size > SHOWN else "")
            found.append(
                DataFinding(
                    "spikes",
                    f"{told} alone, far off what was before and after ({first}): a sensor or a line that "
                    "fails for a moment. Taken as missing.",
                    {"output": signal.name, "count": int(at.size), "samples": at.tolist()},
                )
            )
    return found

"""Which regions: short rules that say where in the machine's operation the mismatch lives."""

from decimal import ROUND_CEILING, ROUND_FLOOR, Context
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import false_discovery_control
from sklearn.tree import DecisionTreeRegressor

from narx_sklearn.discrepancy.locate.features import plain

COLUMNS = ["rule", "share", "time_share", "lift", "p_value", "conditions"]
MAX_LEAVES = 6  # of the tree, few enough for its rules to be read
MAX_DEPTH = 3  # of it: conditions of a rule, at most
SMALLEST_LEAF = 0.02  # of the samples
LEAST_SHARE = 0.02  # of the energy, where there is no noise
NOTHING = 1e-6  # of the largest size, below which a computed signal is not there
OFTEN = 0.05  # share of the samples at which it is not, that makes its region where it is there at all
WORTH = 0.05  # of the variance, that a division must take off where there is no noise
FEWEST = 3  # samples of a leaf where there is no noise
TRAINING_SAMPLES = 20_000  # at most, evenly spread over the record
N_WINDOWS = 60  # every second one makes the rules, the others judge them
SHORTEST = 5  # samples of such a window
N_SHUFFLES = 1999  # p-values are multiples of 1/2000
LEVEL = 0.01  # false discovery rate at which one is kept
LOOKED_AT = 1000  # samples at least, evenly spread, by which a direction is told from what moves
N_EDGES = 60  # places tried for the beginning of a mismatch that grows
ALIKE = 0.05  # share of a region's samples, by which one told by the size of a signal may differ
FEWEST_DIGITS = 3  # of a bound
DIGITS = 12  # of a bound, at most
LEAST_LIFT = 1.2  # share of the energy over share of the time, below which a rule says nothing


class Condition(NamedTuple):
    """An interval of one feature.

    Attributes
    ----------
    feature : str
        Name of the feature, unit included.
    low, high : float
        Bounds, the lower one exclusive; infinite for none.
    """

    feature: str
    low: float
    high: float

    def __str__(self) -> str:
        if self.feature.startswith("direction of ") and not (
            np.isfinite(self.low) and np.isfinite(self.high)
        ):
            name = self.feature.removeprefix("direction of ")
            words = {
                (-1, False): "falling",
                (0, True): "rising",
                (-1, True): "not falling",
                (0, False): "not rising",
            }
            edge, upper = (self.low, True) if np.isfinite(self.low) else (self.high, False)
            return f"{name} {words[(-1 if edge < 0 else 0, upper)]}"
        if np.isfinite(self.low) and np.isfinite(self.high):
            return f"{self.low:.{DIGITS}g} < {self.feature} <= {self.high:.{DIGITS}g}"
        return (
            f"{self.feature} > {self.low:.{DIGITS}g}"
            if np.isfinite(self.low)
            else f"{self.feature} <= {self.high:.{DIGITS}g}"
        )

    def readable(self, table: pd.DataFrame) -> "Condition":
        """Return it with bounds of as few digits, three or more, as hold for the same samples of a table.

        They are rounded outwards: what is held at a limit stays inside.
        """
        values = table[self.feature].to_numpy(dtype=float)

        def shortest(bound: float, rounding: str) -> float:
            for digits in range(FEWEST_DIGITS, DIGITS + 1):
                rounded = float(Context(digits, rounding).create_decimal(repr(float(bound))))
                if np.array_equal(values > rounded, values > bound):
                    return rounded
            return bound

        return self._replace(low=shortest(self.low, ROUND_FLOOR), high=shortest(self.high, ROUND_CEILING))


def inside(conditions, table: pd.DataFrame) -> np.ndarray:
    """Tell for each sample whether it meets all conditions; NaN meets none.

    Parameters
    ----------
    conditions : sequence of Condition
        As found in a row of :func:`regions`.
    table : DataFrame of shape (n_samples, n_features)
        Features by name.

    Returns
    -------
    ndarray of bool of shape (n_samples,)
        The samples of the region.
    """
    mask = np.ones(len(table), dtype=bool)
    for condition in conditions:
        values = table[condition.feature].to_numpy(dtype=float)
        with np.errstate(invalid="ignore"):
            mask &= (values > condition.low) & (values <= condition.high)
    return mask


def regions(
    signal: np.ndarray, table: pd.DataFrame, *, floor=None, noise_free=False, random_state=None
) -> pd.DataFrame:
    """Find the regions of operation in which a residual or a latent force lives.

    A shallow regression tree of the log energy divides the space of the features; its leaves are parted
    into loud and quiet ones where the variance between the two is largest, and neighbours of one kind are
    joined. Rules are made on every second window and judged on the others: windows of the energy are
    shuffled against the features, which keeps what both have of memory, at a false discovery rate of 1 %.

    Parameters
    ----------
    signal : ndarray of shape (n_samples,)
        Residual or latent force; NaN is skipped.
    table : DataFrame of shape (n_samples, n_features)
        Features, as :func:`features` makes them; rows with NaN are skipped.
    floor : float or ndarray of shape (n_samples,), optional
        Variance that noise alone gives the signal (``w_std ** 2`` of a latent force); a tenth of the median
        energy when not given.
    noise_free : bool, default=False
        The signal is computed, not measured: regions may be as small as a few samples, and are not judged
        (their ``p_value`` is 0). Where it is often nothing at all, they are where it is anything, else where
        it is large.
    random_state : int or None, default=None
        Seed of the shuffles.

    Returns
    -------
    DataFrame
        One row a rule, largest share first: ``rule`` in words, ``share`` of the energy, ``time_share``,
        ``lift`` (their ratio), ``p_value`` (adjusted), ``conditions`` for :func:`inside`.

    References
    ----------
    .. [1] L. Breiman, J. Friedman, R. Olshen and C. Stone, 1984, Classification and Regression Trees.
    .. [2] N. Otsu, 1979, a threshold selection method from gray-level histograms.
    .. [3] Y. Benjamini and Y. Hochberg, 1995, controlling the false discovery rate.

    Examples
    --------
    >>> import numpy as np, pandas as pd
    >>> from narx_sklearn.discrepancy.locate import regions
    >>> rng = np.random.default_rng(0)
    >>> position, drive = np.sin(np.arange(6000) / 40), rng.normal(size=6000)
    >>> table = pd.DataFrame({"position [m]": position, "drive [V]": drive})
    >>> signal = np.where(position > 0.5, 1.0, 0.1) * rng.normal(size=6000)
    >>> found = regions(signal, table, random_state=0)
    >>> len(found), round(float(found.loc[0, "conditions"][0].low), 1)
    (1, 0.5)
    """
    energy = np.asarray(signal, dtype=float) ** 2
    known = np.isfinite(energy) & np.isfinite(table.to_numpy(dtype=float)).all(axis=1)
    samples = np.flatnonzero(known)
    length = samples.size // N_WINDOWS
    if (length < SHORTEST and not noise_free) or not energy[samples].sum() > 0:
        return pd.DataFrame(columns=COLUMNS)
    energy, table = energy[samples], table.iloc[samples]
    least = 0.1 * np.median(energy) if floor is None else np.broadcast_to(floor, known.shape)[samples]
    level = np.log(energy + np.maximum(least, 1e-9 * energy.mean()))
    there = energy > np.maximum(0.0 if floor is None else least, NOTHING**2 * energy.max())
    if noise_free and np.mean(~there) >= OFTEN:
        level = there.astype(float)
    made = noise_free | ((np.arange(samples.size) // max(1, length)) % 2 == 0)
    size = np.sqrt(energy[made])
    smallest = FEWEST if noise_free else SMALLEST_LEAF
    rules = _rules(table[made], level[made], smallest, WORTH if noise_free else 0.0)
    if not noise_free:
        rules = [_with_onsets(rule, table[made], size) for rule in rules]
    judged = np.arange(N_WINDOWS * length).reshape(N_WINDOWS, length)[1::2]
    rng = np.random.default_rng(random_state)
    orders = rng.permuted(np.tile(np.arange(len(judged)), (N_SHUFFLES, 1)), axis=1)
    found = _told(rules, energy, table)
    if noise_free or found.empty:
        return _worth_telling(found, LEAST_SHARE)
    masks = (inside(conditions, table)[judged].astype(float) for conditions in found["conditions"])
    found["p_value"] = false_discovery_control([_p_value(mask, level[judged], orders) for mask in masks])
    return _worth_telling(found[found["p_value"] <= LEVEL], 0.0)


def stated_regions(
    signal: np.ndarray, table: pd.DataFrame, feature: str, spans, *, is_centred=False
) -> pd.DataFrame:
    """Return the regions that an effect states itself, as :func:`regions` returns those that it finds.

    Parameters
    ----------
    signal : ndarray of shape (n_samples,)
        What the effect adds; NaN is skipped.
    table : DataFrame of shape (n_samples, n_features)
        Features by name; rows with NaN are skipped.
    feature : str
        The signal that the effect is a function of.
    spans : array-like of shape (n_spans, 2)
        Where it acts, infinite where there is no end. Where they lie about zero, they are told by the
        signal's size, if it is among the features.
    is_centred : bool, default=False
        Zero may lie halfway between two ends, as far as these are known.

    Returns
    -------
    DataFrame
        One row a rule, largest share first.

    Examples
    --------
    >>> import numpy as np, pandas as pd
    >>> from narx_sklearn.discrepancy.locate import stated_regions
    >>> x = np.sin(np.arange(1000) / 40)
    >>> table = pd.DataFrame({"position [m]": x, "|position [m]|": np.abs(x)})
    >>> stop = np.maximum(np.abs(x) - 0.8, 0.0)
    >>> found = stated_regions(stop, table, "position [m]", [(-np.inf, -0.8), (0.8, np.inf)])
    >>> found["rule"].tolist(), found["share"].tolist()
    (['|position [m]| > 0.8'], [1.0])
    """
    energy = np.asarray(signal, dtype=float) ** 2
    known = np.isfinite(energy) & np.isfinite(table.to_numpy(dtype=float)).all(axis=1)
    energy, table = energy[known], table[known]
    if not energy.sum() > 0:
        return pd.DataFrame(columns=COLUMNS)
    spans = np.asarray(spans, dtype=float)
    rules: list[tuple[Condition, ...]] = [(Condition(feature, low, high),) for low, high in spans]
    size, ends = f"|{feature}|", spans[np.isfinite(spans)]
    if size in table and ends.size == 2:
        half = 0.5 * float(np.ptp(ends))
        is_within = len(spans) == 1
        alike = Condition(size, -np.inf, half) if is_within else Condition(size, half, np.inf)
        apart = np.any([inside(rule, table) for rule in rules], axis=0)
        if is_centred or np.mean(apart != inside([alike], table)) <= ALIKE * apart.mean():
            rules = [(alike,)]
    return _worth_telling(_told(rules, energy, table), LEAST_SHARE)


def _told(rules: list[tuple[Condition, ...]], energy: np.ndarray, table: pd.DataFrame) -> pd.DataFrame:
    """Return rules with readable bounds and what they hold of an energy, not judged."""
    rows = []
    for found in rules:
        conditions = tuple(condition.readable(table) for condition in found)
        mask = inside(conditions, table)
        share, time_share = energy[mask].sum() / energy.sum(), mask.mean()
        rule = " and ".join(map(str, conditions))
        rows.append((rule, share, time_share, share / max(time_share, 1e-300), 0.0, conditions))
    return pd.DataFrame(rows, columns=COLUMNS)


def _worth_telling(found: pd.DataFrame, least_share: float) -> pd.DataFrame:
    kept = (found["lift"] >= LEAST_LIFT) & (found["share"] >= least_share)
    return found[kept].sort_values("share", ascending=False, kind="stable", ignore_index=True)


def _rules(
    table: pd.DataFrame, level: np.ndarray, smallest: float, worth: float
) -> list[tuple[Condition, ...]]:
    """Return the loud regions of a shallow tree, pruned of divisions that are not worth their while.

    Its leaves have no less than the ``smallest`` number, or share, of samples; a division takes off a share
    ``worth`` of the variance, or is not made, and so do features that are more than signals, or are not used.
    """
    stride = max(1, -(-len(level) // TRAINING_SAMPLES))
    table, level = table.iloc[::stride], level[::stride]
    least = worth * np.var(level)

    def divided(some: pd.DataFrame) -> tuple[pd.DataFrame, DecisionTreeRegressor, float]:
        values = some.to_numpy(dtype=float)
        tree = DecisionTreeRegressor(
            max_leaf_nodes=MAX_LEAVES,
            max_depth=MAX_DEPTH,
            min_samples_leaf=smallest,
            ccp_alpha=least,
            random_state=0,
        ).fit(values, level)
        return some, tree, float(np.var(level - tree.predict(values)))

    found = divided(table)
    simpler = plain(table)
    if worth and simpler.shape[1]:
        signals_alone = divided(simpler)
        found = signals_alone if signals_alone[2] <= found[2] + least else found
    table, tree, _ = found
    shape = tree.tree_
    leaves = np.flatnonzero(shape.children_left < 0)
    if leaves.size < 2:
        return []
    threshold = _otsu(shape.value[leaves, 0, 0], shape.n_node_samples[leaves])
    names = list(table.columns)
    rules: list[tuple[Condition, ...]] = []

    def visit(node: int, bounds: dict) -> bool | None:
        """Collect the loud regions below a node; return whether it is of one kind, loud (True) or quiet."""
        if shape.children_left[node] < 0:
            return bool(shape.value[node, 0, 0] > threshold)
        feature, edge = names[shape.feature[node]], float(shape.threshold[node])
        low, high = bounds.get(feature, (-np.inf, np.inf))
        sides = (
            (int(shape.children_left[node]), bounds | {feature: (low, edge)}),
            (int(shape.children_right[node]), bounds | {feature: (edge, high)}),
        )
        kinds = [visit(child, within) for child, within in sides]
        if kinds[0] is not None and kinds[0] == kinds[1]:
            return kinds[0]
        for kind, (_, within) in zip(kinds, sides, strict=True):
            if kind:
                rules.append(tuple(Condition(name, *interval) for name, interval in within.items()))
        return None

    visit(0, {})
    return rules


def _otsu(values: np.ndarray, weights: np.ndarray) -> float:
    """Return the threshold that parts weighted values with the largest variance between the parts."""
    order = np.argsort(values)
    v, w = values[order], weights[order].astype(float)
    below, moment = np.cumsum(w)[:-1], np.cumsum(w * v)[:-1]
    total, mean = w.sum(), np.average(v, weights=w)
    best = int(np.argmax((mean * below - moment) ** 2 / (below * (total - below))))
    return 0.5 * float(v[best] + v[best + 1])


def _with_onsets(rule: tuple[Condition, ...], table: pd.DataFrame, size: np.ndarray) -> tuple[Condition, ...]:
    """Move each bound of a rule to where the size begins to grow.

    A step of the tree lies where a growing mismatch is halfway up; a line that bends finds its beginning.
    """
    moved = list(rule)
    for i, condition in enumerate(rule):
        others = inside([c for c in moved if c is not moved[i]], table)
        values = table[condition.feature].to_numpy(dtype=float)
        some = values[others]
        some = some[:: max(1, some.size // LOOKED_AT)]
        if np.unique(some).size < N_EDGES:  # a direction, or levels: nothing in between
            continue
        low, high = condition.low, condition.high
        if np.isfinite(low):
            use = others & (values <= high)
            low = _onset(values[use], size[use], low)
        if np.isfinite(high):
            use = others & (values > low)
            high = -_onset(-values[use], size[use], -high)
        if low < high:
            moved[i] = Condition(condition.feature, low, high)
    return tuple(moved)


def _onset(values: np.ndarray, size: np.ndarray, edge: float) -> float:
    """Return where ``size`` begins to grow with ``values``, or the given edge where it rather jumps there."""
    upper = values > edge
    if not 0 < upper.sum() < upper.size:
        return edge
    jump = upper.sum() * np.var(size[upper]) + (~upper).sum() * np.var(size[~upper])
    centred = size - size.mean()
    best, where = jump, edge
    for candidate in np.quantile(values, np.linspace(0.01, 0.99, N_EDGES)):
        bent = np.maximum(values - candidate, 0.0)
        bent -= bent.mean()
        energy = bent @ bent
        slope = bent @ centred / energy if energy > 0 else 0.0
        left = centred @ centred - slope**2 * energy
        if slope > 0 and left < best:
            best, where = left, float(candidate)
    return where


def _p_value(mask: np.ndarray, level: np.ndarray, orders: np.ndarray) -> float:
    """Return how often shuffled windows have as high a level inside the mask; both (n_windows, n_samples)."""
    if not 0 < mask.sum() < mask.size:
        return 1.0
    meeting = mask @ (level - level.mean()).T  # window of the mask with window of the level
    rows = np.arange(len(mask))
    shuffled = meeting[rows, orders].sum(axis=1)
    return (1 + np.count_nonzero(shuffled >= np.trace(meeting) - 1e-12)) / (1 + len(orders))

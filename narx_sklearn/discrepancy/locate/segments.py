"""Which times: stretches of the record whose residual is larger than the rest's."""

from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.signal import lfilter
from scipy.stats import false_discovery_control

from narx_sklearn.discrepancy.locate.events import energy_of, input_events
from narx_sklearn.discrepancy.noise import estimate_noise

MOST_BLOCKS = 256  # the record is looked at in this many stretches at most
SHORTEST_BLOCK = 16  # samples, so that the energy of a block has a spread of a third at most
N_SHUFFLES = 1999  # p-values are multiples of 1/2000
LEVEL = 0.01  # false discovery rate at which one is kept
PENALTY = 3.0  # times log J for each change of level
QUIET = 0.2  # share of the time that the quietest stretches, the yardstick of all, take together


def segments(residual: np.ndarray, dt: float, *, u=None, names=None, random_state=None) -> pd.DataFrame:
    r"""Find the stretches of time in which the mismatch is.

    The residual is made white by the noise of its quieter half, and change points of its log energy
    :math:`\ell_j` over short blocks minimise

    .. math:: \sum_j (\ell_j - \mu_{s(j)})^2 / \sigma^2 + 3 m \log J

    over all divisions into m + 1 stretches (optimal partitioning). A stretch above the quietest ones is
    kept when shuffled blocks hardly ever hold one as loud and as long, at a false discovery rate of 1 %.

    Parameters
    ----------
    residual : ndarray of shape (n_samples,) or (n_samples, n_outputs)
        Residual, innovations or a latent force; NaN is skipped.
    dt : float
        Sampling period, s.
    u : ndarray of shape (n_samples, n_inputs), optional
        Inputs; their event nearest to the beginning of each stretch, at most a block away on either side (a
        beginning is known no better), is then named.
    names : sequence of str, optional
        Names of the inputs.
    random_state : int or None, default=None
        Seed of the shuffles.

    Returns
    -------
    DataFrame
        One row a stretch in order of time: ``start``, ``stop`` (samples, one past the end), ``start_s``,
        ``stop_s``, ``share`` of the residual's energy, ``time_share``, ``z_score`` of its log energy
        against the rest, ``p_value`` (adjusted), ``event``.

    References
    ----------
    .. [1] B. Jackson et al., 2005, an algorithm for optimal partitioning of data on an interval.
    .. [2] N. R. Zhang and D. O. Siegmund, 2007, a modified Bayes information criterion (the penalty 3 log J).
    .. [3] Y. Benjamini and Y. Hochberg, 1995, controlling the false discovery rate.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.locate import segments
    >>> rng = np.random.default_rng(0)
    >>> residual = rng.normal(size=5000) * np.where((np.arange(5000) // 1000) == 2, 3.0, 1.0)
    >>> found = segments(residual, 0.01, random_state=0)
    >>> len(found), bool(abs(found.loc[0, "start_s"] - 20.0) < 0.5)
    (1, True)
    """
    energy = energy_of(residual)
    n = energy.size
    count = int(min(MOST_BLOCKS, n // SHORTEST_BLOCK))
    columns = ["start", "stop", "start_s", "stop_s", "share", "time_share", "z_score", "p_value", "event"]
    if count < 10 or not np.nansum(energy) > 0:
        return pd.DataFrame(columns=columns)
    edges = np.linspace(0, n, count + 1).astype(int)
    white = energy_of(_whitened(np.asarray(residual, dtype=float).reshape(n, -1), edges))
    sums, seen = (
        np.add.reduceat(v, edges[:-1]) for v in (np.nan_to_num(white), np.isfinite(white).astype(float))
    )
    blocks = np.flatnonzero(seen >= 0.5 * np.diff(edges))
    if blocks.size < 10:
        return pd.DataFrame(columns=columns)
    level = np.log(np.maximum(sums[blocks] / seen[blocks], 1e-12 * np.nanmean(white)))
    spread = _spread(level)
    loud = _loud(level / spread, _partition(level / spread))
    rng = np.random.default_rng(random_state)
    shuffled = np.cumsum(
        np.pad(rng.permuted(np.tile(level, (N_SHUFFLES, 1)), axis=1), ((0, 0), (1, 0))), axis=1
    )
    rows = []
    for a, b in loud:
        length = b - a
        loudest = (shuffled[:, length:] - shuffled[:, :-length]).max(axis=1)
        p = (1 + np.count_nonzero(loudest >= level[a:b].sum() - 1e-12)) / (1 + N_SHUFFLES)
        rest = np.concatenate([level[:a], level[b:]])
        z = (level[a:b].mean() - rest.mean()) / (spread * np.sqrt(1 / length + 1 / rest.size))
        start, stop = int(edges[blocks[a]]), int(edges[blocks[b - 1] + 1])
        share = np.nansum(energy[start:stop]) / np.nansum(energy)
        rows.append((start, stop, start * dt, stop * dt, share, (stop - start) / n, z, p, ""))
    table = pd.DataFrame(rows, columns=columns)
    if rows:
        table["p_value"] = false_discovery_control(table["p_value"])
        table = table[table["p_value"] <= LEVEL].reset_index(drop=True)
    if u is not None and len(table):
        width = int(np.diff(edges).max())
        called = [f"input {i}" for i in range(u.shape[1])] if names is None else names
        table["event"] = [_event_near(u, called, start, width) for start in table["start"]]
    return table


def _whitened(residual: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Return the residual filtered white by the noise of its quieter half, NaN where unknown."""
    length = int(np.diff(edges).min())
    starts = edges[:-1]
    out = np.full(residual.shape, np.nan)
    for c in range(residual.shape[1]):
        column = residual[:, c]
        known = np.isfinite(column)
        if not known.any():
            continue
        filled = np.where(known, column, 0.0)
        cut = filled[starts[:, None] + np.arange(length)]
        seen = known[starts[:, None] + np.arange(length)]
        size = np.where(seen.any(axis=1), (cut**2).sum(axis=1) / np.maximum(seen.sum(axis=1), 1), np.inf)
        quiet = size <= np.median(size[np.isfinite(size)])
        noise = estimate_noise(cut[quiet][:, :, None], seen[quiet][:, :, None], may_drift=False)
        a = noise.coefficients[0]
        white = lfilter(np.concatenate([[1.0], -a]), [1.0], filled)
        unknown = np.convolve(~known, np.ones(a.size + 1))[: known.size] > 0
        unknown[: a.size] = True
        out[:, c] = np.where(unknown, np.nan, white)
    return out


def _spread(level: np.ndarray) -> float:
    """Return the standard deviation of levels about their local mean, from differences of neighbours."""
    return max(float(np.median(np.abs(np.diff(level)))) / (0.6745 * np.sqrt(2)), 1e-9)


def _partition(values: np.ndarray) -> list[int]:
    """Return the bounds of the stretches that minimise squares within them plus a penalty for each."""
    n = values.size
    sums = np.concatenate([[0.0], np.cumsum(values)])
    squares = np.concatenate([[0.0], np.cumsum(values**2)])
    penalty = PENALTY * np.log(n)
    best = np.full(n + 1, np.inf)
    best[0] = -penalty
    previous = np.zeros(n + 1, dtype=int)
    for end in range(1, n + 1):
        begin = np.arange(end)
        cost = squares[end] - squares[begin] - (sums[end] - sums[begin]) ** 2 / (end - begin)
        total = best[begin] + cost + penalty
        previous[end] = int(np.argmin(total))
        best[end] = total[previous[end]]
    bounds = [n]
    while bounds[-1] > 0:
        bounds.append(int(previous[bounds[-1]]))
    return bounds[::-1]


def _loud(level: np.ndarray, bounds: list[int]) -> list[tuple[int, int]]:
    """Return the stretches above the quietest, neighbours joined."""
    pieces = list(pairwise(bounds))
    means = np.array([level[a:b].mean() for a, b in pieces])
    order = np.argsort(means)
    lengths = np.array([b - a for a, b in pieces])
    n_base = np.cumsum(lengths[order])
    last = int(np.searchsorted(n_base, QUIET * level.size))
    base, n_quiet = np.average(means[order[: last + 1]], weights=lengths[order[: last + 1]]), n_base[last]
    joined: list[tuple[int, int]] = []
    for (a, b), mean in zip(pieces, means, strict=True):
        weight = 1 / (1 / (b - a) + 1 / n_quiet)
        if mean <= base or weight * (mean - base) ** 2 <= PENALTY * np.log(level.size):
            continue
        if joined and joined[-1][1] == a:
            joined[-1] = (joined[-1][0], b)
        else:
            joined.append((a, b))
    return joined


def _event_near(u: np.ndarray, names, start: int, width: int) -> str:
    """Return the kind of input event nearest to a sample, at most one block away."""
    nearest = (width + 1, "")
    if start <= width:
        nearest = (start, "begin of record")
    for name, column in zip(names, u.T, strict=True):
        for kind, samples in input_events(column).items():
            if samples.size:
                away = int(np.min(np.abs(samples - start)))
                if away < nearest[0]:
                    nearest = (away, f"{kind} of {name}")
    return nearest[1]

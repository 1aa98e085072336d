"""Is anything missing at all? A test that holds whatever the colour of the noise."""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter
from scipy.stats import norm

from narx_sklearn.discrepancy.search.bank import Bank, flexible_residual

DRAWS = 4999  # of signs: p-values are multiples of 1/5000
BLOCK = 20  # whitened samples flipped together: what colour the autoregression leaves stays inside
FEWEST_BLOCKS = 60  # of a record; in a short one they are shorter
NEIGHBOURS = 101  # ordinates of the periodogram that tell the level around a line
FINER = 2  # times its own ordinates, that a periodogram is taken at
SLOW = 8  # periods in the record, below which a line and a drift are one
A_LINE = 12.0  # times its neighbours' level: a line of the input
WIDER = 3.0  # price of the tests of lines and of scanned values beside the test over the bank


class Detection(NamedTuple):
    """Outcome of the test over a bank."""

    statistic: np.ndarray  # (n_columns,) |t|, zero where a column says nothing
    p_value: float  # of the largest
    p_values: np.ndarray  # (n_columns,) adjusted for the maximum over the bank
    p_bank: float  # of the bank alone
    p_line: float  # of the strongest line in the residual
    p_scan: float  # of the best of the values that were scanned for


# so sure that something is missing that no kind of effect is silent
NONE_SILENT = Detection(np.zeros(0), 0.0, np.zeros(0), 0.0, 0.0, 0.0)


def blocks_of(values: np.ndarray, n_outputs: int, length: int) -> np.ndarray:
    """Sum (W, T, n) over blocks of whitened samples inside the windows; returns (n_blocks, n)."""
    n_w, n_t, n = values.shape
    by_time = values.reshape(n_w, n_t // n_outputs, n_outputs, n).sum(axis=2)
    edges = np.arange(0, by_time.shape[1], length)
    return np.add.reduceat(by_time, edges, axis=1).reshape(n_w * edges.size, n)


def block_length(n_windows: int, n_times: int) -> int:
    """Return the number of samples flipped together."""
    return int(max(1, min(BLOCK, n_windows * n_times // FEWEST_BLOCKS)))


def detect(
    bank: Bank,
    allowed: np.ndarray,
    *,
    n_outputs: int,
    n_samples: int,
    n_fitted: int,
    tried: np.ndarray | None = None,
    draws: int = DRAWS,
    random_state=None,
) -> Detection:
    r"""Test whether any column of the bank explains the residual.

    With :math:`b` the residual, :math:`c_j` a column, both whitened and projected, and :math:`e` what is left
    of the residual when the bank's best columns are fitted freely,

    .. math:: t_j = |c_j^\top b| \Big/ \sqrt{\sum_B (c_{jB}^\top e_B)^2}

    over short blocks B of samples. The variance comes from the data, so that it holds under unequal noise
    and under the colour that the whitening leaves; taking it from :math:`e` keeps a strong effect from
    hiding itself in its own variance. Flipping the signs of whole blocks (wild bootstrap) calibrates the
    maximum over the bank.

    Parameters
    ----------
    allowed : ndarray of bool of shape (n_columns,)
        Columns that take part.
    n_fitted : int
        Parameters and initial states fitted, for the degrees of freedom.
    tried : ndarray of shape (n_columns,), optional
        Of how many values a column is the best; 0 where it was not scanned for. Such columns are not
        ``allowed``, but tested on their own.
    """
    noise, used = flexible_residual(bank, n_samples)
    noise = noise * np.sqrt(n_samples / max(n_samples - n_fitted - used, 1))
    p_line = strongest_line(bank.residual, n_outputs).p_value
    use = bank.useful & allowed
    length = block_length(*_times(bank, n_outputs))
    p_scan = 1.0 if tried is None else _scanned(bank, tried, noise, n_outputs, n_samples, length)
    t = np.zeros(bank.n_columns)
    if not use.any():
        return Detection(t, min(p_line, p_scan), np.ones(bank.n_columns), 1.0, p_line, p_scan)
    products, spread = _products(bank, use, noise, n_outputs, n_samples, length)
    t[use] = np.abs(bank.plain[use]) / spread
    largest = flipped_maxima(products / spread, draws, np.random.default_rng(random_state))
    largest.sort()
    above = draws - np.searchsorted(largest, t * (1 - 1e-9), side="left")
    p = np.where(use, (1.0 + above) / (1.0 + draws), 1.0)
    p_bank = float(p.min())
    return Detection(t, min(p_bank, p_line, p_scan), p, p_bank, p_line, p_scan)


def flipped_maxima(unit: np.ndarray, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Return the largest sum over blocks, (n_blocks, n), for every draw of the blocks' signs."""
    largest = np.empty(draws)
    for begin in range(0, draws, 500):
        signs = rng.choice([-1.0, 1.0], size=(min(500, draws - begin), len(unit)))
        largest[begin : begin + len(signs)] = np.abs(signs @ unit).max(axis=1)
    return largest


def _products(
    bank: Bank, use: np.ndarray, noise: np.ndarray, n_outputs: int, n_samples: int, length: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return columns times noise by blocks, (n_blocks, n), and the standard deviation of their sums, (n,)."""
    # a column at a time: together their products would be as large as the bank
    by_column = [
        blocks_of((bank.columns[:, :, j] * noise)[:, :, None], n_outputs, length) for j in np.flatnonzero(use)
    ]
    products = np.hstack(by_column)
    products = products[np.any(products != 0, axis=1)]
    spread = np.sqrt(np.einsum("bj,bj->j", products, products))
    # never less than what white noise of this size gives: a column alive in few samples has few products
    floor = np.sqrt(np.diag(bank.gram)[use] * np.einsum("wt,wt->", noise, noise) / n_samples)
    return products, np.maximum(spread, floor)


def _scanned(
    bank: Bank, tried: np.ndarray, noise: np.ndarray, n_outputs: int, n_samples: int, length: int
) -> float:
    """Return the p-value of the columns that are the best of many; all that were tried pay (Bonferroni)."""
    use = bank.useful & (tried > 0)
    if not use.any():
        return 1.0
    spread = _products(bank, use, noise, n_outputs, n_samples, length)[1]
    t = bank.plain[use] / np.where(spread > 0, spread, np.inf)  # in the direction in which it acts
    return float(min(1.0, WIDER * np.min(tried[use] * norm.sf(t))))


def _times(bank: Bank, n_outputs: int) -> tuple[int, int]:
    return bank.residual.shape[0], bank.residual.shape[1] // n_outputs


class Line(NamedTuple):
    """A line in a spectrum."""

    frequency: float  # cycles a sample
    p_value: float
    output: int  # in whose residual it stands


def strongest_line(residual: np.ndarray, n_outputs: int, u: np.ndarray | None = None) -> Line:
    """Return the strongest line in a whitened residual, (W, T), of any output.

    The periodogram is taken twice as fine as its own ordinates, between which a line would lose up to six
    tenths of its power. Each ordinate is compared with the median of its neighbours, so that a colour left
    by the whitening is no line; the largest of n exponential ordinates gives the p-value (Fisher 1929), and
    every ordinate and output pays.
    """
    by_output = residual.reshape(residual.shape[0], -1, n_outputs)
    n = FINER * by_output.shape[0] * by_output.shape[1]
    if n // 2 < 2 * FINER * NEIGHBOURS:
        return Line(0.0, 1.0, 0)
    in_the_input = np.zeros(_ordinates(n), dtype=bool)
    columns = [] if u is None else [u[:, :, i].ravel() for i in range(u.shape[2])]
    for column in columns:
        near = maximum_filter1d(_over_neighbours(_power(column, n)), FINER * 5)
        in_the_input |= near > A_LINE
    found = []
    for output in range(n_outputs):
        power = _power(by_output[:, :, output].ravel(), n)
        if not power.sum() > 0:
            continue
        ratio = np.where(in_the_input, 0.0, _over_neighbours(power))
        ratio[: FINER * SLOW] = 0.0
        i = int(np.argmax(ratio))
        p = -np.expm1(n_outputs * power.size * np.log1p(-np.exp(-min(ratio[i], 700.0))))
        found.append(Line((i + 1) / n, float(min(1.0, WIDER * max(p, 1e-16))), output))
    return min(found, key=lambda line: line.p_value, default=Line(0.0, 1.0, 0))


def exceeded(ratio: float, m: int) -> float:
    """Return the chance that an ordinate of a spectrum is more than some times the mean of m others."""
    return float((1.0 + ratio / m) ** -m) if m else 1.0


def _ordinates(n: int) -> int:
    return (n - 1) // 2


def _power(signal: np.ndarray, n: int) -> np.ndarray:
    """Return the periodogram at n-ths of a cycle a sample, without its first and last ordinate."""
    return np.abs(np.fft.rfft(signal, n))[1 : _ordinates(n) + 1] ** 2


def _over_neighbours(power: np.ndarray) -> np.ndarray:
    """Return the ordinates of a periodogram over their local level (their mean, told from the median)."""
    level = median_filter(power, size=FINER * NEIGHBOURS, mode="reflect") / np.log(2)
    return power / np.maximum(level, 1e-300)

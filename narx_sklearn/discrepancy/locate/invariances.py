"""What kind of thing an unknown force is: its symmetries, memory and scaling, each as a number."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas as pd

from narx_sklearn.discrepancy.locate._hats import additive_hats, hats

N_FOLDS = 10  # stretches of time; each is predicted from the others
TRAINING_SAMPLES = 4000  # at most, evenly spread over the record
FEWEST_SAMPLES = 200  # known, without which nothing is said
RIDGES = (1e-4, 1e-2, 1.0, 1e2)  # of the energy of a column; that which predicts best
PAST = (4, 16)  # samples ago, that stand for the past
FEWEST_CYCLES = 2  # of a sine over the range of the signal it is tied to
MOST_CYCLES = 100  # over the range of the position
N_BINS = 1 << 14  # over the range of a signal, along which a sine is looked for
OVERSAMPLED = 4  # times as fine as its own ordinates, that a spectrum is taken at
CONFIDENCE = 1.96  # standard errors to either side: 95 %
MOSTLY = 0.8  # share of the variance that leaves little else
SURE = 0.5  # half an interval of a power, that tells it
NOT_TOLD = "not told"  # by this record
CLEAR = 0.05  # share of the force's variance that counts


class _Share(NamedTuple):
    """A share of variance with its standard error over the folds."""

    value: float
    error: float

    @property
    def clear(self) -> bool:
        return self.value - CONFIDENCE * self.error > CLEAR


def invariances(
    w: np.ndarray, x: np.ndarray, v: np.ndarray, u: np.ndarray, dt: float, *, first=(0,)
) -> pd.DataFrame:
    r"""Describe an unknown force by what it does and does not depend on.

    Every share of variance is out of sample: smooth functions (sums of hats, ridge regression) of the named
    signals are fitted to nine tenths of the record and judged
    on the tenth left out.

    Parameters
    ----------
    w : ndarray of shape (n_samples,)
        Force, as smoothed at its port; NaN is skipped.
    x, v, u : ndarray of shape (n_samples,)
        Position-like signal, its rate, and the input.
    dt : float
        Sampling period, s.
    first : sequence of int, default=(0,)
        First samples of the sessions; the past does not reach across them.

    Returns
    -------
    DataFrame
        Index ``property``; columns ``value``, ``low``, ``high`` (95 % interval) and ``reading`` in words,
        "not told" where this record does not tell:

        - ``odd``: share of :math:`f(x)` that is odd about zero, where x and -x both occur; NaN when x visits
          one side only;
        - ``memoryless``: share of variance that x, v and u explain;
        - ``memory``: what the values of x and u some samples ago add;
        - ``rate``: what the size of v adds to x, u and the sign of v;
        - ``direction``: what the sign of v adds to x and u;
        - ``position period``, ``time period``: what one sine in x, or in t, adds to functions of x, v and u;
          the readings name the period;
        - ``degree``: exponent of the force's size against that of x, over stretches of time;
        - ``product``: what products of u with functions of x and v add to their sum.

    Raises
    ------
    ValueError
        If fewer than 200 samples are known.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.locate import invariances
    >>> rng, t = np.random.default_rng(0), np.arange(6000) * 0.01
    >>> size = np.repeat(rng.uniform(0.3, 1.0, 30), 200)
    >>> x = size * np.sin(3 * t)
    >>> v = np.gradient(x, 0.01)
    >>> table = invariances(-(x**3), x, v, rng.normal(size=t.size), 0.01)
    >>> table["value"][["odd", "degree"]].round(0).tolist()
    [1.0, 3.0]
    """
    signals = [np.asarray(s, dtype=float) for s in (w, x, v, u)]
    lagged, known = _with_past(signals, first)
    samples = np.flatnonzero(known)
    if samples.size < FEWEST_SAMPLES:
        raise ValueError(
            f"w, x, v and u are known together at {samples.size} samples; this takes at least "
            f"{FEWEST_SAMPLES}. Pass a longer record."
        )
    samples = samples[:: max(1, -(-samples.size // TRAINING_SAMPLES))]
    w, x, v, u = (s[samples] - (s[samples].mean() if s is signals[0] else 0.0) for s in signals)
    folds = np.minimum(np.arange(samples.size) * N_FOLDS // samples.size, N_FOLDS - 1)
    judge = _Judge(w, folds)
    sign = np.sign(v)
    still = np.column_stack([additive_hats(np.column_stack([x, u])), _product(x, u)])
    turned = np.column_stack([still, sign[:, None] * hats(x)])
    full = np.column_stack([turned, hats(v), _product(x, v)])
    summed = additive_hats(np.column_stack([x, v, u]))
    past = np.column_stack([full, *(hats(column) for column in lagged[samples].T)])
    products = np.column_stack([summed, u[:, None] * hats(x), u[:, None] * hats(v)])
    memoryless = judge.share(full)
    memory = _added(judge, full, past, "has memory", "no memory seen")
    rows = {
        "odd": _odd(x, signals[0][samples], folds),
        "memoryless": (memoryless, _beside(memoryless, memory[0])),
        "memory": memory,
        "rate": _added(judge, turned, full, "depends on the rate", "independent of the rate"),
        "direction": _added(judge, still, turned, "depends on the direction", "independent of the direction"),
        "position period": _periodic(judge, full, x, MOST_CYCLES, "position"),
        "time period": _periodic(judge, full, samples * dt, samples.size / 4, "time", " s"),
        "degree": _degree(w, x),
        "product": _added(judge, summed, products, "multiplies the input", "adds to the input"),
    }
    table = pd.DataFrame(
        [
            (name, value, value - CONFIDENCE * error, value + CONFIDENCE * error, reading)
            for name, ((value, error), reading) in rows.items()
        ],
        columns=["property", "value", "low", "high", "reading"],
    )
    return table.set_index("property")


class _Judge:
    """Out-of-sample squares of regressions of one signal, fold by fold."""

    def __init__(self, w, folds):
        self.w = w
        self.folds = folds
        self.own = np.bincount(folds, w**2, N_FOLDS)
        self.total = max(float(self.own.sum()), 1e-300)

    def squares(self, basis) -> np.ndarray:
        """Return the squares left over in each fold, by ridge regression on the others."""
        basis = np.column_stack([np.ones(len(self.w)), basis])
        gram = np.empty((N_FOLDS, basis.shape[1], basis.shape[1]))
        moment = np.empty((N_FOLDS, basis.shape[1]))
        for i in range(N_FOLDS):
            part = basis[self.folds == i]
            gram[i], moment[i] = part.T @ part, part.T @ self.w[self.folds == i]
        energy = np.diag(np.maximum(np.diag(gram.sum(axis=0)), 1e-12))
        left = np.empty((len(RIDGES), N_FOLDS))
        for i in range(N_FOLDS):
            out = self.folds == i
            for ridge, squares in zip(RIDGES, left, strict=True):
                theta = np.linalg.solve(
                    gram.sum(axis=0) - gram[i] + ridge * energy, moment.sum(axis=0) - moment[i]
                )
                squares[i] = np.sum((self.w[out] - basis[out] @ theta) ** 2)
        return left[np.argmin(left.sum(axis=1))]

    def share(self, basis) -> _Share:
        """Return the share of variance that a basis explains."""
        return self.difference(self.own, self.squares(basis))

    def difference(self, before, after) -> _Share:
        """Return the share of variance by which squares went down, a ratio of sums over folds."""
        down = before - after
        share = float(down.sum()) / self.total
        return _Share(share, float(np.std(down - share * self.own, ddof=1) * np.sqrt(N_FOLDS) / self.total))


def _beside(memoryless: _Share, memory: _Share) -> str:
    """Return in words how much of a force is a function of the signals of the same moment."""
    if memoryless.value > MOSTLY:
        return "a function of x, v, u"
    other = "the past" if memory.clear else "noise or something else"
    return f"{other} beside a function of x, v, u"


def _added(judge: _Judge, smaller, larger, yes: str, no: str):
    share = judge.difference(judge.squares(smaller), judge.squares(larger))
    return share, yes if share.clear else no


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the products of coarse hats of two signals."""
    left, right = hats(a, 5), hats(b, 5)
    return (left[:, :, None] * right[:, None, :]).reshape(a.size, -1)


def _with_past(signals, first):
    """Return x and u some samples ago, (n_samples, n_lagged), and where all is known."""
    _, x, _, u = signals
    n = x.size
    starts = np.zeros(n, dtype=int)
    starts[list(first)] = list(first)
    since = np.arange(n) - np.maximum.accumulate(starts)
    columns = []
    for lag in PAST:
        for signal in (x, u):
            earlier = np.full(n, np.nan)
            earlier[lag:] = signal[:-lag]
            earlier[since < lag] = np.nan
            columns.append(earlier)
    lagged = np.column_stack(columns)
    return lagged, np.isfinite(lagged).all(axis=1) & np.isfinite(np.column_stack(signals)).all(axis=1)


def _odd(x: np.ndarray, w: np.ndarray, folds: np.ndarray):
    """Return the odd part's share in the curve of w over x, and its spread when folds are left out."""
    reach = min(np.quantile(x, 0.98), -np.quantile(x, 0.02))
    if not reach > 0.2 * np.abs(x).max():
        return _Share(np.nan, np.nan), "one side only is visited"
    edges = np.linspace(0, reach, 9)

    def share(use):
        levels = []
        for low, high in pairwise(edges):
            right, left = (w[use & (low < s * x) & (s * x <= high)] for s in (1, -1))
            if right.size and left.size:
                levels.append((right.mean(), left.mean()))
        if not levels:
            return np.nan
        right, left = np.array(levels).T
        odd = np.sum((0.5 * (right - left)) ** 2)
        even = np.sum((0.5 * (right + left) - np.mean(0.5 * (right + left))) ** 2)
        return odd / max(odd + even, 1e-300)

    value = share(np.ones(x.size, dtype=bool))
    without = np.array([share(folds != i) for i in range(N_FOLDS)])
    error = np.sqrt((N_FOLDS - 1) / N_FOLDS * np.sum((without - without.mean()) ** 2))  # jackknife
    low, high = value - CONFIDENCE * error, value + CONFIDENCE * error
    if value > MOSTLY:
        reading = "odd"
    elif value < 1.0 - MOSTLY:
        reading = "even"
    else:
        reading = "neither odd nor even" if low > 1.0 - MOSTLY and high < MOSTLY else NOT_TOLD
    return _Share(float(value), float(error)), reading


def _degree(w: np.ndarray, x: np.ndarray):
    """Return the slope of log size of w against log size of x over stretches of time."""
    n = 4 * N_FOLDS
    parts = np.array_split(np.arange(w.size), n)
    force = np.log([max(np.sqrt(np.mean(w[p] ** 2)), 1e-300) for p in parts])
    size = np.log([max(np.sqrt(np.mean(x[p] ** 2)), 1e-300) for p in parts])
    spread = np.sum((size - size.mean()) ** 2)
    if not spread > n * 0.1**2:
        return _Share(np.nan, np.nan), "the amplitude hardly varies"
    slope = np.sum((size - size.mean()) * (force - force.mean())) / spread
    left = force - force.mean() - slope * (size - size.mean())
    error = np.sqrt(np.sum(left**2) / (n - 2) / spread)
    told = CONFIDENCE * error < SURE
    reading = f"grows as amplitude to the power {slope:.1f}" if told else NOT_TOLD
    return _Share(float(slope), float(error)), reading


def _periodic(judge: _Judge, basis, signal: np.ndarray, most: float, what: str, unit: str = ""):
    """Return what the best single sine of a signal adds to a basis."""
    low, high = np.quantile(signal, [0.001, 0.999])
    span = high - low
    if not span > 0:
        return _Share(0.0, 0.0), f"not tied to {what}"
    whole = np.column_stack([np.ones(judge.w.size), basis])
    penalty = RIDGES[0] * np.diag(np.maximum(np.einsum("ij,ij->j", whole, whole), 1e-12))
    left = judge.w - whole @ np.linalg.solve(whole.T @ whole + penalty, whole.T @ judge.w)
    # the spectrum over the signal rather than over time: sums in fine bins, then one transform
    place = np.clip((signal - low) / span, 0.0, 1.0)
    bins = np.bincount((place * (N_BINS - 1)).astype(int), left, N_BINS)
    size = np.abs(np.fft.rfft(bins, OVERSAMPLED * N_BINS))
    first, last = OVERSAMPLED * FEWEST_CYCLES, int(OVERSAMPLED * min(most, N_BINS / 4))
    best = (first + int(np.argmax(size[first : last + 1]))) / OVERSAMPLED * N_BINS / (N_BINS - 1)
    angle = 2 * np.pi * best * (signal - low) / span
    sine = np.column_stack([basis, np.sin(angle), np.cos(angle)])
    share = judge.difference(judge.squares(basis), judge.squares(sine))
    reading = f"periodic in {what}, every {span / best:.3g}{unit}" if share.clear else f"not tied to {what}"
    return share, reading

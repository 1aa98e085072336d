"""The likelihood of noise of any colour, beside what initial states and parameters take for themselves.

Free initial states and parameters follow the slow part of a drift, so what a fit leaves is whiter than the
noise was; an effect that follows a little more makes it white altogether, and looks as if it were there. The
restricted likelihood (Patterson and Thompson 1971) is that of all contrasts which they do not reach:

.. math:: -2 \\ln L = (n - k) \\ln s^2 + \\ln |V| + \\ln |X^\\top V^{-1} X|

with V the covariance of the noise in units of its innovations' variance s^2, and X k orthonormal responses to
initial states and parameters. It is linear about a fitted model.
"""

from dataclasses import dataclass, replace
from itertools import compress
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from narx_sklearn.discrepancy.fitting.problem import FLAT, Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import SLOWEST, Noise, estimate_noise
from narx_sklearn.discrepancy.simulators.simulator import Windows

COLOUR = 2.0  # price of a coefficient of the noise, that of Akaike (1974): a dearer one leaves a faint colour
STEPPED = {"quantisation"}  # effects through which a small change comes as it is, on the whole, or not at all
UNFELT = 1e-6  # least information on a contrast, of that on the one that is felt most
GRID = 9  # paces of a drift that are tried, evenly in the logarithm
FINE = 0.05  # to which that logarithm is then found


class OwnNoise(NamedTuple):
    """The noise that a model leaves, and minus twice the restricted log-likelihood under it, priced."""

    noise: Noise
    deviance: float


def own_noise(
    problem: Problem, model: Model, *, may_drift: bool = True, contrasts: "Contrasts | None" = None
) -> OwnNoise:
    """Return the likeliest noise beside a model: white, coloured or, where it may, drifting.

    What runs away leaves no noise, and its deviance is infinite.
    """
    left = problem.left_over(model)
    if not np.isfinite(left).all():
        return OwnNoise(problem.noise, np.inf)
    contrasts = contrasts or Contrasts.of(problem, model)
    n_outputs = left.shape[2]
    best = contrasts.under(Noise.white(np.ones(n_outputs)))
    for output in range(n_outputs):
        part, seen = left[:, :, output : output + 1], problem.seen[:, :, output : output + 1]
        colours = [estimate_noise(part, seen, may_drift=False, price=COLOUR)]
        if may_drift:
            colours.append(estimate_noise(part, seen, price=COLOUR))
        tried = [contrasts.under(best.noise.with_colour(output, *noise.colour(0))) for noise in colours]
        if may_drift:
            tried.append(contrasts.likeliest_walk(best.noise, output))
        best = min([best, *tried], key=lambda found: found.deviance)
    return best


@dataclass(frozen=True)
class Contrasts:
    """What a model leaves, and its responses, by stretches of windows that follow without a gap."""

    signals: np.ndarray  # (stretches, samples, outputs, signals): nuisances, other responses, what is left
    seen: np.ndarray  # (stretches, samples, outputs)
    n_nuisances: int  # orthonormal responses to initial states and the simulator's own parameters
    unit: np.ndarray  # (outputs,) in which outputs are counted
    before: np.ndarray  # (stretches,) samples since the session began
    n_rests: int = 1  # of the signals, what is left

    @classmethod
    def of(cls, problem: Problem, model: Model, felt: np.ndarray | None = None) -> "Contrasts":
        """Linearise a model about its run; outputs are counted in what they jitter by.

        Of the effects' parameters all count, or the directions ``felt`` alone, one a column.

        The responses are those without the steps of a converter: differences through these are steps too, of
        which drifting noise has none, so states and parameters would seem to take up little of it.
        """
        unit = _jitter(problem)
        plain = problem.with_noise(Noise.white(unit))
        is_smooth = np.array([effect.effect.code not in STEPPED for effect in model.effects], dtype=bool)
        smooth = tuple(compress(model.effects, is_smooth))
        at = fit(plain, model._replace(effects=smooth), iterations=0)
        own = _orthonormal(at.jacobian[:, :, : model.p.size])
        others = at.jacobian[:, :, model.p.size :]
        if felt is not None:
            sizes = np.array([effect.n_theta for effect in model.effects], dtype=int)
            others = others @ felt[np.repeat(is_smooth, sizes)]
        others = _normalised(others)
        rest = np.nan_to_num(plain.residual(plain.run(model)))[:, :, None]
        shared = np.concatenate([own, others, rest], axis=2)
        places, shape = _places(problem.windows)
        n_outputs = unit.size
        pieces = []
        for window, (stretch, start, length) in enumerate(places):
            basis = at.projector.basis[window]
            pieces.append((stretch, start, length, basis[:, basis.any(axis=0)], shared[window]))
        n_states = sum(basis.shape[1] for *_, basis, _ in pieces)
        signals = np.zeros((*shape, n_outputs, n_states + shared.shape[2]))
        seen = np.zeros((*shape, n_outputs), dtype=bool)
        column = 0
        for window, (stretch, start, length, basis, common) in enumerate(pieces):
            rows = slice(start, start + length)
            own_columns = slice(column, column + basis.shape[1])
            signals[stretch, rows, :, own_columns] = _by_output(basis, n_outputs)[:length]
            signals[stretch, rows, :, n_states:] = _by_output(common, n_outputs)[:length]
            seen[stretch, rows] = problem.seen[window, :length]
            column = own_columns.stop
        begins = np.diff([stretch for stretch, *_ in places], prepend=-1) > 0
        before = (problem.windows.first - problem.windows.began)[begins]
        return cls(signals, seen, n_states + own.shape[2], unit, before)

    @property
    def n_others(self) -> int:
        """Number of responses that are no nuisances: to parameters of effects."""
        return self.n_columns - self.n_nuisances

    @property
    def n_columns(self) -> int:
        """Number of responses."""
        return self.signals.shape[3] - self.n_rests

    def with_rests(self, rests: np.ndarray) -> "Contrasts":
        """Return the same with others in the place of what is left.

        Parameters
        ----------
        rests : ndarray of shape (n_stretches, n_samples, n_outputs, n_rests)
            In units of the outputs, zero where not seen.
        """
        signals = np.concatenate([self.signals[..., : self.n_columns], rests], axis=3)
        return replace(self, signals=signals, n_rests=rests.shape[3])

    def under(self, noise: Noise) -> OwnNoise:
        """Return a noise of given colour with the size that fits, and the deviance under it."""
        deviances, sizes = self.deviances(noise)
        return OwnNoise(noise._replace(sigma=sizes * self.unit), float(deviances[0]))

    def deviances(self, noise: Noise) -> tuple[np.ndarray, np.ndarray]:
        """Return the deviance of each of the rests under noise of given colour, and the size of the noise.

        How large noise is on one output beside another is that of all rests together.
        """
        n_columns, n, weights = self.n_columns, 0, []
        products, squares = np.zeros((n_columns, self.signals.shape[3])), np.zeros(self.n_rests)
        deviance = noise.n_parameters * COLOUR
        for output in range(self.unit.size):
            seen, signals = self.seen[:, :, output], self.signals[:, :, output]
            e, counts, log_determinant = noise.innovations_from_zero(signals, seen, output, self.before)
            e = e.reshape(-1, e.shape[2]) if counts.all() else e[counts]
            own = np.einsum("ij,ij->j", e[:, n_columns:], e[:, n_columns:])
            size = np.sqrt(max(float(own.mean()) / len(e), 1e-300)) if len(e) else 1.0
            products += e[:, :n_columns].T @ e / size**2
            squares += own / size**2
            n += len(e)
            weights.append(size)
            deviance += log_determinant + 2 * np.log(size) * len(e)
        columns, with_rests, k = products[:, :n_columns], products[:, n_columns:], self.n_nuisances
        left = _left_by(columns, with_rests, squares)
        cost = np.maximum(left, 1e-300) / max(n - k, 1)
        deviance += _log_determinant(columns[:k, :k])
        return deviance + (n - k) * np.log(cost), np.array(weights) * np.sqrt(cost.mean())

    def likeliest_walk(self, noise: Noise, output: int) -> OwnNoise:
        """Return the likeliest noise of which one output's is a random walk under white noise."""

        def walking(log_pace: float) -> OwnNoise:
            # of two coefficients one is given
            found = self.under(noise.with_colour(output, *walk(log_pace)))
            return found._replace(deviance=found.deviance - COLOUR)

        grid = paces(GRID)
        at = int(np.argmin([walking(log_pace).deviance for log_pace in grid]))
        around = grid[max(at - 1, 0)], grid[min(at + 1, GRID - 1)]
        found = minimize_scalar(
            lambda log_pace: walking(log_pace).deviance,
            bounds=around,
            method="bounded",
            options={"xatol": FINE},
        )
        return min(walking(grid[at]), walking(found.x), key=lambda own: own.deviance)


def paces(n: int) -> np.ndarray:
    """Return the logarithms of n paces of a random walk, evenly, the slowest first."""
    return np.linspace(np.log(1.0 - SLOWEST), np.log(0.9), n)


def walk(log_pace: float) -> tuple[np.ndarray, float]:
    """Return the colour of a random walk under white noise."""
    return np.ones(1), float(1.0 - np.exp(log_pace))


def _log_determinant(information: np.ndarray) -> float:
    """Return the log determinant; what no innovation feels, beside gaps, counts as hardly felt."""
    values = np.linalg.eigvalsh(information)
    return float(np.log(np.maximum(values, UNFELT * max(values.max(initial=0.0), 1e-300))).sum())


def _jitter(problem: Problem) -> np.ndarray:
    """Return how much each output jitters from sample to sample: the same for all models of a record."""
    y = problem.raw(problem.y)
    known = problem.seen[:, 2:] & problem.seen[:, 1:-1] & problem.seen[:, :-2]
    bends = np.where(known, y[:, 2:] - 2 * y[:, 1:-1] + y[:, :-2], 0.0)
    jitter = np.sqrt(np.sum(bends**2, axis=(0, 1)) / np.maximum(known.sum(axis=(0, 1)), 1) / 6.0)
    return np.where(jitter > 0, jitter, np.maximum(np.abs(y).max(axis=(0, 1)), 1.0))


def _normalised(columns: np.ndarray) -> np.ndarray:
    """Return columns (W, T, n) of unit length."""
    length = np.sqrt(np.einsum("wtn,wtn->n", columns, columns))
    return columns / np.where(length > 0, length, 1.0)


def _orthonormal(columns: np.ndarray) -> np.ndarray:
    """Return orthonormal columns (W, T, k) that span the same."""
    if not columns.size:
        return columns
    left, values, _ = np.linalg.svd(_normalised(columns).reshape(-1, columns.shape[2]), full_matrices=False)
    kept = left[:, values > FLAT * values.max(initial=0.0)]
    return kept.reshape(*columns.shape[:2], kept.shape[1])


def _left_by(columns: np.ndarray, with_rests: np.ndarray, squares: np.ndarray) -> np.ndarray:
    """Return the squares of each rest that columns do not explain, from the inner products."""
    size = np.sqrt(np.diag(columns))
    size = np.where(size > 0, size, 1.0)
    between, with_rests = columns / np.outer(size, size), with_rests / size[:, None]
    inverse = np.linalg.pinv(between, rcond=FLAT, hermitian=True)
    return squares - np.einsum("ik,ij,jk->k", with_rests, inverse, with_rests, optimize=True)


def _places(windows: Windows) -> tuple[list[tuple[int, int, int]], tuple[int, int]]:
    """Return each window's stretch, its place there and its length; and the shape of all stretches."""
    lengths = (windows.last - windows.first).tolist()
    places: list[tuple[int, int, int]] = []
    ends: list[int] = []
    for length, fresh in zip(lengths, windows.fresh.tolist(), strict=True):
        if fresh or not ends:
            ends.append(0)
        places.append((len(ends) - 1, ends[-1], length))
        ends[-1] += length
    return places, (len(ends), max(ends))


def _by_output(columns: np.ndarray, n_outputs: int) -> np.ndarray:
    """Return columns over samples times outputs, (T, k), as (samples, outputs, k)."""
    return columns.reshape(len(columns) // n_outputs, n_outputs, columns.shape[1])

"""The likeliest size of an unknown signal, and colour of the noise beside it, by a part of the record."""

from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from narx_sklearn.discrepancy.locate._covered import Covered, Entrance, thinned
from narx_sklearn.discrepancy.locate._kalman import respond
from narx_sklearn.discrepancy.locate._likelihood import TINY_NOISE, Colour, estimate, regressed

LARGEST_RHO = 0.9995  # of noise: memory of two thousand samples
ORDINARY_RHO = 0.9  # a colour to start from: the background's own is swollen by what the force leaves in it
WORTH = 2.0  # nats that a colour, or one of an output's own, has to gain
ROUNDS = 2  # through the outputs, each of which gets a colour of its own
# of the force's variance over the one that would move the outputs as observed
DECADES = np.arange(-2.0, 9.0, 2.0)
WANDERS = 300.0  # samples for which a walk is remembered, to start from
# logarithms of the white part's variance, the walk's, and its memory in samples: first steps, and limits
FIRST_STEPS = np.vstack([np.zeros(3), np.diag([-1.5, -1.5, 1.0])])
LOGS_WITHIN = np.log([[TINY_NOISE, TINY_NOISE, 0.1], [1e6, 1e6, 1e5]])


class Likeliest(NamedTuple):
    """The likeliest size of a force and colour of the noise."""

    w_var: float  # variance of the force, in units in which the colour counts the noise's
    colour: Colour
    log_likelihood: float  # of the samples that the search looked at


class Search(NamedTuple):
    """A part of the record, and the way in which a force of given memory enters there."""

    part: Covered
    series: np.ndarray  # (n, n_outputs, 1 + n_columns) the residual, and what is free under every size
    entering: Entrance
    phi: float
    unit: float  # variance of a force that moves the outputs as observed; 0 where none does

    @classmethod
    def of(cls, covered: Covered, series: np.ndarray, entrance: Entrance, phi: float) -> "Search":
        """Take up a residual and the columns that are free beside it, (n, n_outputs, 1 + n_columns)."""
        part, rows = thinned(covered._replace(b=np.ascontiguousarray(series[:, :, :1])))
        entering = entrance.at(rows)
        response = np.empty((*entering.d.shape, 1))
        respond(part.A, entering.g, part.C, entering.d, part.seam, np.ones((rows.size, 1)), response)
        reach = float(np.mean(response**2))
        unit = float(np.nanmean(part.b**2)) / reach if reach > 0 else 0.0
        return cls(part, series[rows], entering, phi, unit)

    def log_likelihood(self, w_var: float, colour: Colour) -> float:
        """Return how likely this part is."""
        if self.series.shape[2] == 1:
            return float(estimate(self.part, self.entering, self.phi, w_var, colour).samples.sum())
        given = self.series.copy(), self.phi, w_var, colour
        return float(regressed(self.part, self.entering, *given).samples.sum())

    def best_force(self, rho: np.ndarray, noise: str) -> Likeliest:
        """Return the likeliest size of a force; of none where it moves no output.

        Colours tried are white, an ordinary one and ``rho``, the background's; then each output's own is
        refined.
        """
        if not self.unit > 0:
            return self._nothing(Colour.of(rho))

        def value(decade, rho):
            return self._at(decade, Colour.of(rho))

        white, ordinary = np.zeros(rho.size), np.full(rho.size, ORDINARY_RHO)
        colours = distinct(white, ordinary, rho) if noise == "ar1" else (white,)
        _, decade, likeliest = max((value(t, c), t, tuple(c)) for t in DECADES for c in colours)
        rho = np.array(likeliest)
        decade, best = self._refined(decade, Colour.of(rho), 2.0)
        for output in range(rho.size if noise == "ar1" else 0):
            colour = _one_coloured(partial(value, decade), rho, output)
            other, value_there = self._refined(decade, Colour.of(colour), 1.5)
            if value_there > best:
                decade, rho, best = other, colour, value_there
        return Likeliest(self.unit * 10.0**decade, Colour.of(rho), best)

    def beside_wandering(self, size: Likeliest) -> Likeliest:
        """Return the likeliest size near one that is known, in noise that is white and wanders."""
        colour = self.wandering(size.w_var)
        if not size.w_var > 0:
            return self._nothing(colour)
        decade, best = self._refined(np.log10(size.w_var / self.unit), colour, 2.0)
        return Likeliest(self.unit * 10.0**decade, colour, best)

    def likeliest_rho(self) -> np.ndarray:
        """Return the colour of each output's noise, (n_outputs,), where there is no force.

        One is sought for all outputs, then their own.
        """
        white = np.zeros(self.part.b.shape[1])

        def value(rho):
            return self.log_likelihood(0.0, Colour.of(rho))

        common = _coloured(lambda c: value(np.full(white.size, c)), value(white))
        return _of_their_own(value, np.full(white.size, common))

    def wandering(self, w_var: float) -> Colour:
        """Return the likeliest noise that is white and wanders, each output's in its own way.

        That is more than one colour. Outputs take turns, the others' noise as it is (Nelder and Mead 1965);
        each starts as white, with a walk as large that remembers some hundred samples.
        """
        n_outputs = self.part.b.shape[1]
        logs = np.tile(np.log([0.5, 0.5, WANDERS]), (n_outputs, 1))

        def noise(logs: np.ndarray) -> Colour:
            white, coloured, memory = np.exp(logs.T)
            return Colour(np.exp(-1.0 / memory), coloured, white)

        def unlikely(one: np.ndarray, output: int) -> float:
            there = logs.copy()
            there[output] = np.clip(one, *LOGS_WITHIN)
            return -self.log_likelihood(w_var, noise(there))

        for _ in range(ROUNDS if n_outputs > 1 else 1):
            for output in range(n_outputs):
                search = minimize(
                    unlikely,
                    logs[output],
                    args=(output,),
                    method="Nelder-Mead",
                    options={"xatol": 0.05, "fatol": 0.1, "initial_simplex": logs[output] + FIRST_STEPS},
                )
                logs[output] = np.clip(search.x, *LOGS_WITHIN)
        return noise(logs)

    def _nothing(self, colour: Colour) -> Likeliest:
        return Likeliest(0.0, colour, self.log_likelihood(0.0, colour))

    def _at(self, decade: float, colour: Colour) -> float:
        return self.log_likelihood(self.unit * 10.0**decade, colour)

    def _refined(self, decade: float, colour: Colour, span: float) -> tuple[float, float]:
        search = minimize_scalar(
            lambda t: -self._at(t, colour),
            bounds=(decade - span, decade + span),
            method="bounded",
            options={"maxiter": 8, "xatol": 0.05},
        )
        return float(search.x), -float(search.fun)


def _of_their_own(value, rho: np.ndarray) -> np.ndarray:
    """Return the common correlation, changed output by output wherever that gains two nats."""
    if rho.size == 1:
        return rho
    best = value(rho)
    for _ in range(ROUNDS):
        before = best
        for output in range(rho.size):
            other = _one_coloured(value, rho, output)
            value_there = value(other)
            if value_there > best + WORTH:
                rho, best = other, value_there
        if best == before:
            break
    return rho


def _one_coloured(value, rho: np.ndarray, output: int) -> np.ndarray:
    """Return correlations of which one output's maximises ``value(rho)``, the others' as they are."""

    def with_one(correlation):
        changed = rho.copy()
        changed[output] = correlation
        return changed

    return with_one(_coloured(lambda c: value(with_one(c)), value(with_one(0.0))))


def _coloured(value, white: float) -> float:
    """Return the correlation that maximises ``value(rho)``; 0 unless it beats white noise by two nats."""
    # on a scale where 0.9, 0.99 and 0.999 are equally far apart
    search = minimize_scalar(
        lambda t: -value(-np.expm1(-t)),
        bounds=(1e-3, -np.log(1 - LARGEST_RHO)),
        method="bounded",
        options={"maxiter": 12, "xatol": 0.02},
    )
    return float(-np.expm1(-search.x)) if -search.fun > white + WORTH else 0.0


def distinct(*colours: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return colours that differ, each once."""
    return tuple(np.unique(colours, axis=0))

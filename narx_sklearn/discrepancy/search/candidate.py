"""A set of effects, fitted, and what it costs to have chosen it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, fit
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.bank import out_of

HARDLY = 4.0  # difference of the criterion, odds of seven to one, that excludes nothing
OUTSIDE = 0.05  # chance that what is missing has no entry, before any data
FINE = 20  # iterations that bring a set to convergence
ODD = 6.0  # twice the logarithm of the odds against an effect at a place where one does not meet it


@dataclass(frozen=True)
class Candidate:
    """A set of effects, fitted."""

    fit: Fit
    n_samples: int
    given: int = 0  # ends of its effects' times that nobody chose
    elsewhere: tuple[PlacedEffect, ...] = ()  # laws as likely as its last, one without a name, at other ports

    @property
    def effects(self) -> tuple[PlacedEffect, ...]:
        """The effects, with their fitted parameters."""
        return self.fit.model.effects

    @property
    def places(self) -> set[tuple]:
        """What the effects are and where they act."""
        return {effect.place for effect in self.effects}

    @property
    def n_values(self) -> int:
        """Number of global parameters that choose among laws.

        Not where a memory begins, in which form an effect is built, or what has one value only.
        """
        return self.fit.model.p.size + sum(placed.n_values for placed in self.effects)

    @property
    def n_parameters(self) -> int:
        """Number of parameters that the data can feel, and initial states that they feel by effects alone."""
        return self.fit.model.p.size + self.felt.shape[1] + self.fit.n_begun

    @cached_property
    def felt(self) -> np.ndarray:
        """Directions of the effects' parameters that the data can feel, (n_parameters_of_effects, n_felt).

        A direction in which the effects change nothing that the simulator's own parameters and the other
        directions do not, or a parameter at its bound, was not fitted and has no price. Where a memory begins
        has none, as initial states have none. Where many valleys were looked into, tangents say nothing, and
        every parameter has its price.
        """
        model, J = self.fit.model, self.fit.jacobian
        own, q = model.p.size, model.q
        bounds = np.concatenate([np.empty((0, 2)), *(e.domain for e in model.effects)])
        inside = (q[own:] > bounds[:, 0]) & (q[own:] < bounds[:, 1])
        inside &= np.array([k != e.effect.begin for e in model.effects for k in range(e.n_theta)], dtype=bool)
        many = np.array([e.effect.valleys > 0 for e in model.effects for _ in range(e.n_theta)], dtype=bool)
        tried, free = np.eye(inside.size)[:, inside & many], np.flatnonzero(inside & ~many)
        if not free.size:
            return tried
        size = np.abs(q[own:][free])
        columns = out_of(J[:, :, :own], J[:, :, own + free] * size).reshape(-1, free.size)
        values, vectors = np.linalg.eigh(columns.T @ columns)
        told = np.zeros((inside.size, int(np.sum(values > 1.0))))
        told[free] = size[:, None] * vectors[:, values > 1.0]
        return np.concatenate([tried, told], axis=1)

    @property
    def criterion(self) -> float:
        """Minus twice the log-likelihood of the whitened residual, and the price of what was chosen."""
        return self.n_samples * np.log(max(self.fit.cost, 1e-300) / self.n_samples) + self.price

    @property
    def pace(self) -> float:
        """Decrease of the criterion in the last iteration of the fit."""
        return -self.n_samples * np.log1p(-min(self.fit.gained, 1.0 - 1e-9))

    @cached_property
    def price(self) -> float:
        """Price of Hannan and Quinn (1979) a parameter, and that of BIC once an effect.

        Whether an effect is there was tested; among effects with different numbers of parameters the milder
        price of the former decides, since their shapes are fitted within narrow physical ranges. An effect
        that one meets elsewhere pays for its odd place. What acts for a while, or happened once, pays for the
        samples at which it begins and ends, each chosen among all; a value that was chosen among many that no
        fit reaches from each other pays for these, and a threshold, of which n samples tell about the square
        root of n apart, for those.
        """
        n = self.n_samples
        price = 2 * np.log(np.log(n)) * self.n_parameters + np.log(n) * len(self.effects)
        price += ODD * sum(effect.odd for effect in self.effects)
        price += 2 * sum(np.log(e.effect.n_apart) for e in self.effects if e.effect.n_apart)
        price += np.log(n) * sum(len(e.effect.chosen) for e in self.effects)
        ends = sum(e.during.n_ends + len(e.effect.instants) for e in self.effects)
        return price + price_of_an_end(n) * (ends - self.given)


def price_of_an_end(n_samples: int) -> float:
    """Return the price of a time at which something begins or ends, which was chosen among all samples."""
    return 2 * float(np.log(n_samples))


def odd(candidate: Candidate) -> bool:
    """Tell whether an effect of a set is met elsewhere, not at such a place."""
    return any(effect.odd for effect in candidate.effects)


def once_each(candidates: list[Candidate]) -> list[Candidate]:
    """Return the first candidate with each set of effects."""
    first: dict[frozenset, Candidate] = {}
    for candidate in candidates:
        first.setdefault(frozenset(candidate.places), candidate)
    return list(first.values())


def converged(problem: Problem, candidate: Candidate, n_jobs: int | None = None) -> Candidate:
    """Return a set of effects fitted to the end."""
    found = fit(problem, candidate.fit.model, iterations=FINE, tolerance=1e-7, n_jobs=n_jobs)
    return Candidate(found, candidate.n_samples)

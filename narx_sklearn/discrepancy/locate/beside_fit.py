"""How likely a record is where an unknown signal acts beside all that was fitted to it."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.locate._covered import Covered, Entrance, Entry, cover
from narx_sklearn.discrepancy.locate._likelihood import (
    Likeliest,
    Regressed,
    best_force,
    estimate,
    regressed,
)
from narx_sklearn.discrepancy.locate.latent_force import Background, background
from narx_sklearn.discrepancy.locate.tangent import Tangent
from narx_sklearn.discrepancy.simulators.simulator import Windows


class Course(NamedTuple):
    """An unknown signal, known by where it enters and by its size.

    Attributes
    ----------
    entry : Entry
        Where and how it enters.
    memory : float
        Samples for which it is remembered.
    size : Likeliest
        Its likeliest size, and the colour of the noise beside it.
    """

    entry: Entry
    memory: float
    size: Likeliest

    @property
    def phi(self) -> float:
        """What is left of it one sample later."""
        return float(np.exp(-1.0 / self.memory))


class Refined(NamedTuple):
    """What comes of a fit beside an unknown signal.

    Attributes
    ----------
    move, errors : ndarray of shape (n_responses,)
        How far what was fitted moves, and the standard errors; zero for what the record does not show.
    deviation : ndarray of shape (n_outputs,)
        Standard deviation of the noise that is left.
    rho : ndarray of shape (n_outputs,)
        Its correlation, at each output, from one sample to the next.
    """

    move: np.ndarray
    errors: np.ndarray
    deviation: np.ndarray
    rho: np.ndarray


@dataclass(frozen=True, eq=False)
class BesideFit:
    """A fitted run, about which everything is linear, and what may be beside it.

    Initial deviations of the windows, and what the responses explain, are free under every hypothesis.
    """

    linear: Tangent
    against: Background
    covered: Covered
    responses: np.ndarray  # (n, n_outputs, n_responses) of the covered samples, of unit length
    lengths: np.ndarray  # (n_responses,) of these responses, in units of the noise

    @classmethod
    def of(
        cls, linear: Tangent, residual: np.ndarray, windows: Windows, responses: np.ndarray
    ) -> "BesideFit":
        """Take up a run and the responses to what was fitted, (n_samples, n_outputs, n_responses)."""
        against = background(linear, residual, windows)
        covered = cover(linear, residual, windows, against.sigma)
        columns = np.nan_to_num(responses[covered.samples] / against.sigma[:, None])
        lengths = np.sqrt(np.einsum("koj,koj->j", columns, columns))
        return cls(linear, against, covered, columns / np.where(lengths > 0, lengths, 1.0), lengths)

    @property
    def noise_alone(self) -> float:
        """Minus twice the log-likelihood where only noise, each output's own, is beside the fit."""
        return self._deviance(self._regressed(Entrance.closed(self.covered), 1.0, 0.0, self.against.rho))

    def course(self, entry: Entry, memory: float) -> Course:
        """Return a signal of the size that is likeliest, over a part of the record."""
        course = Course(entry, memory, Likeliest(0.0, self.against.rho, 0.0))
        size = best_force(self.covered, self._entrance(course), course.phi, self.against.rho, "ar1")
        return course._replace(size=size)

    def deviance(self, course: Course) -> float:
        """Return minus twice the log-likelihood with a signal, over the whole record."""
        return self._deviance(self._fitted(course))

    def deviations(self, course: Course, n_samples: int) -> np.ndarray:
        """Return how far the states are from the run with a signal, (n_samples, n_states)."""
        w_var, rho, _ = course.size
        found = estimate(self.covered, self._entrance(course), course.phi, w_var, rho, keep=True)
        return self.covered.in_record(found.dx, n_samples)

    def refined(self, course: Course) -> Refined:
        """Return what comes of all that was fitted beside a signal."""
        found = self._fitted(course)
        length = np.where(self.lengths > 0, self.lengths, np.inf)
        return Refined(
            move=found.coefficients / length,
            errors=np.sqrt(np.diag(found.covariance)) / length,
            deviation=self.against.sigma * np.sqrt(found.concentrated),
            rho=course.size.rho,
        )

    def _entrance(self, course: Course) -> Entrance:
        return Entrance.of(self.linear, self.covered, course.entry, self.against.sigma)

    def _fitted(self, course: Course) -> Regressed:
        return self._regressed(self._entrance(course), course.phi, course.size.w_var, course.size.rho)

    def _regressed(self, entrance: Entrance, phi: float, w_var: float, rho: np.ndarray) -> Regressed:
        series = np.concatenate([self.covered.b, self.responses], axis=2)
        return regressed(self.covered, entrance, series, phi, w_var, rho)

    def _deviance(self, found: Regressed) -> float:
        # the residual is counted in units of this background's noise
        unit = np.log(self.against.sigma) @ np.isfinite(self.covered.b[:, :, 0]).sum(axis=0)
        return float(2.0 * (unit - found.samples.sum()))

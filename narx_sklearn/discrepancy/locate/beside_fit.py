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


class Refined(NamedTuple):
    """What comes of a fit beside an unknown signal.

    Attributes
    ----------
    move, errors : ndarray of shape (n_responses,)
        How far what was fitted moves, and the standard errors; zero for what the record does not show.
    deviation : ndarray of shape (n_outputs,)
        Standard deviation of the noise that is left.
    rho : float
        Its correlation from one sample to the next.
    """

    move: np.ndarray
    errors: np.ndarray
    deviation: np.ndarray
    rho: float


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
        """Minus twice the log-likelihood where only noise, white or of one colour, is beside the fit."""
        return self._deviance(Entrance.closed(self.covered), 1.0, 0.0, self.against.rho)

    def searched(self, entry: Entry, memory: float) -> Likeliest:
        """Return the likeliest size of a signal remembered for some samples, over a part of the record."""
        entrance = Entrance.of(self.linear, self.covered, entry, self.against.sigma)
        return best_force(self.covered, entrance, _forgetting(memory), self.against.rho, "ar1")

    def with_signal(self, entry: Entry, memory: float, size: Likeliest) -> float:
        """Return minus twice the log-likelihood with such a signal, over the whole record."""
        entrance = Entrance.of(self.linear, self.covered, entry, self.against.sigma)
        return self._deviance(entrance, _forgetting(memory), size.w_var, size.rho)

    def deviations(self, entry: Entry, memory: float, size: Likeliest, n_samples: int) -> np.ndarray:
        """Return how far the states are from the run with such a signal, (n_samples, n_states)."""
        entrance = Entrance.of(self.linear, self.covered, entry, self.against.sigma)
        found = estimate(self.covered, entrance, _forgetting(memory), size.w_var, size.rho, keep=True)
        return self.covered.in_record(found.dx, n_samples)

    def refined(self, entry: Entry, memory: float, size: Likeliest) -> Refined:
        """Return what comes of all that was fitted beside such a signal."""
        entrance = Entrance.of(self.linear, self.covered, entry, self.against.sigma)
        found = self._regressed(entrance, _forgetting(memory), size.w_var, size.rho)
        length = np.where(self.lengths > 0, self.lengths, np.inf)
        return Refined(
            move=found.coefficients / length,
            errors=np.sqrt(np.diag(found.covariance)) / length,
            deviation=self.against.sigma * np.sqrt(found.concentrated),
            rho=size.rho,
        )

    def _deviance(self, entrance: Entrance, phi: float, w_var: float, rho: float) -> float:
        samples = self._regressed(entrance, phi, w_var, rho).samples
        # the residual is counted in units of this background's noise
        unit = np.log(self.against.sigma) @ np.isfinite(self.covered.b[:, :, 0]).sum(axis=0)
        return float(2.0 * (unit - samples.sum()))

    def _regressed(self, entrance: Entrance, phi: float, w_var: float, rho: float) -> Regressed:
        series = np.concatenate([self.covered.b, self.responses], axis=2)
        return regressed(self.covered, entrance, series, phi, w_var, rho)


def _forgetting(memory: float) -> float:
    return float(np.exp(-1.0 / memory))

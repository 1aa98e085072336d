"""How likely a record is where an unknown signal acts beside all that was fitted to it."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.locate._covered import Covered, Entrance, Entry, cover
from narx_sklearn.discrepancy.locate._likelihood import Colour, Regressed, estimate, regressed
from narx_sklearn.discrepancy.locate._search import Likeliest, Search
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
    unit : ndarray of shape (n_outputs,)
        Standard deviation of what counts as noise of variance one.
    colour : Colour
        The noise that is left, in these units.
    """

    move: np.ndarray
    errors: np.ndarray
    unit: np.ndarray
    colour: Colour


@dataclass(frozen=True, eq=False)
class BesideFit:
    """A fitted run, about which everything is linear, and what may be beside it.

    Initial deviations of the windows, and what the responses explain, are free under every hypothesis. Sizes
    and colours are searched where what was fitted is free as well, and drifts are taken off.
    """

    linear: Tangent
    against: Background
    covered: Covered
    responses: np.ndarray  # (n, n_outputs, n_responses) of the covered samples, of unit length
    lengths: np.ndarray  # (n_responses,) of these responses, in units of the noise
    searched: np.ndarray  # (n, n_outputs, 1 + n_fitted) residual and responses to what was fitted

    @classmethod
    def of(
        cls,
        linear: Tangent,
        residual: np.ndarray,
        windows: Windows,
        responses: np.ndarray,
        drifts: np.ndarray | None = None,
    ) -> "BesideFit":
        """Take up a run and the responses to what was fitted, (n_samples, n_outputs, n_responses).

        Drifts that the outputs may have besides, of the same shape, are free too.
        """
        against = background(linear, residual, windows)
        covered = cover(linear, residual, windows, against.sigma)
        columns = _in_units(responses, covered, against)
        searched = np.concatenate([covered.b, columns], axis=2)
        if drifts is not None:
            slow = _in_units(drifts, covered, against)
            searched = _without(slow, searched)
            columns = np.concatenate([columns, slow], axis=2)
        lengths = np.sqrt(np.einsum("koj,koj->j", columns, columns))
        columns /= np.where(lengths > 0, lengths, 1.0)
        return cls(linear, against, covered, columns, lengths, searched)

    def as_it_is(self) -> "BesideFit":
        """Return this with all that was fitted where it is, free of nothing."""
        none = self.responses[:, :, :0]
        return replace(self, responses=none, lengths=np.zeros(0), searched=self.covered.b)

    @property
    def noise_alone(self) -> float:
        """Minus twice the log-likelihood where only noise is beside the fit.

        It is each output's own: white, of one colour, or white and wandering.
        """
        within = Search.of(self.covered, self.searched, Entrance.closed(self.covered), 1.0)
        colours = [Colour.of(self.against.rho), Colour.of(within.likeliest_rho()), within.wandering(0.0)]
        return min(
            self._deviance(self._regressed(Entrance.closed(self.covered), 1.0, 0.0, colour))
            for colour in colours
        )

    def course(self, entry: Entry, memory: float) -> Course:
        """Return a signal of the size that is likeliest, over a part of the record."""
        course = Course(entry, memory, Likeliest(0.0, Colour.of(self.against.rho), 0.0))
        return course._replace(size=self._search(course).best_force(self.against.rho, "ar1"))

    def in_wandering_noise(self, course: Course) -> Course:
        """Return a signal of the size that is likeliest beside noise that is white and wanders."""
        return course._replace(size=self._search(course).beside_wandering(course.size))

    def deviance(self, course: Course) -> float:
        """Return minus twice the log-likelihood with a signal, over the whole record."""
        return self._deviance(self._fitted(course))

    def deviations(self, course: Course, n_samples: int) -> np.ndarray:
        """Return how far the states are from the run with a signal, (n_samples, n_states)."""
        w_var, colour, _ = course.size
        found = estimate(self.covered, self._entrance(course), course.phi, w_var, colour, keep=True)
        return self.covered.in_record(found.dx, n_samples)

    def refined(self, course: Course) -> Refined:
        """Return what comes of all that was fitted beside a signal."""
        found = self._fitted(course)
        length = np.where(self.lengths > 0, self.lengths, np.inf)
        return Refined(
            move=found.coefficients / length,
            errors=np.sqrt(np.diag(found.covariance)) / length,
            unit=self.against.sigma * np.sqrt(found.concentrated),
            colour=course.size.colour,
        )

    def _entrance(self, course: Course) -> Entrance:
        return Entrance.of(self.linear, self.covered, course.entry, self.against.sigma)

    def _search(self, course: Course) -> Search:
        return Search.of(self.covered, self.searched, self._entrance(course), course.phi)

    def _fitted(self, course: Course) -> Regressed:
        return self._regressed(self._entrance(course), course.phi, course.size.w_var, course.size.colour)

    def _regressed(self, entrance: Entrance, phi: float, w_var: float, colour: Colour) -> Regressed:
        series = np.concatenate([self.covered.b, self.responses], axis=2)
        return regressed(self.covered, entrance, series, phi, w_var, colour)

    def _deviance(self, found: Regressed) -> float:
        # the residual is counted in units of this background's noise
        unit = np.log(self.against.sigma) @ np.isfinite(self.covered.b[:, :, 0]).sum(axis=0)
        return float(2.0 * (unit - found.samples.sum()))


def _in_units(responses: np.ndarray, covered: Covered, against: Background) -> np.ndarray:
    return np.nan_to_num(responses[covered.samples] / against.sigma[:, None])


def _without(slow: np.ndarray, series: np.ndarray) -> np.ndarray:
    """Return series (n, n_outputs, n_series) with slow courses taken off where they are seen."""
    seen = np.isfinite(series[:, :, 0])
    columns = slow[seen]
    left = series.copy()
    left[seen] -= columns @ np.linalg.lstsq(columns, series[seen], rcond=None)[0]
    return left

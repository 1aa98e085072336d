"""The runs that a report shows: along the fitting windows, and freely over what was held out."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from narx_sklearn._validation import finite_rows, finite_slices, session_slices
from narx_sklearn.discrepancy.conclusion import Conclusion
from narx_sklearn.discrepancy.noise import Noise, estimate_noise
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.records.record import read_record
from narx_sklearn.discrepancy.results import BY_SESSION
from narx_sklearn.discrepancy.simulators.simulator import Run, Simulator
from narx_sklearn.discrepancy.verify import Stretch, free_run

WORDS = {
    "nominal": "as it was",
    "refitted": "parameters refitted",
    "augmented": "corrected",
    BY_SESSION: "each session with its own parameters",
}


class HeldOut(NamedTuple):
    """One stretch that no decision has seen, run freely by each simulation."""

    stretch: Stretch
    y: dict[str, np.ndarray]  # run -> (n, n_outputs)

    @property
    def rows(self) -> slice:
        """Its samples."""
        return self.stretch.rows

    @property
    def n_init(self) -> int:
        """Samples to which the initial state was fitted, not counted as error."""
        return self.stretch.n_init


class Material(NamedTuple):
    """A fitted diagnosis with its record, as arrays."""

    simulator: Simulator  # as given, ready to run
    u: np.ndarray  # (n_samples, n_inputs)
    y: np.ndarray  # (n_samples, n_outputs)
    sessions: np.ndarray | None
    time: np.ndarray  # (n_samples,) seconds since the session began
    before: Run  # refitted simulation over the fitting windows
    after: Run  # corrected simulation over the fitting windows
    p: np.ndarray  # (n_parameters,) of the corrected simulation
    effects: tuple[PlacedEffect, ...]  # that the findings tell of, one each
    held_out: tuple[HeldOut, ...]

    @property
    def residual(self) -> np.ndarray:
        """Measured minus refitted output on the fitting windows, (n_samples, n_outputs); NaN elsewhere."""
        return self.y - self.before.y


def gather(dx, X, y, sessions=None) -> Material:
    """Run a fitted diagnosis again over its record.

    Parameters
    ----------
    dx : DiscrepancyRegressor
        Fitted.
    X, y, sessions
        What it was fitted to.

    Returns
    -------
    Material
    """
    u, measured = (np.array(signals) for signals in read_record(X, y, dx.simulator_))  # may be written to
    diagnosis = dx.conclusion_.diagnosis
    if len(u) != len(diagnosis.problem.u):
        raise ValueError(
            f"The record that was diagnosed has {len(diagnosis.problem.u)} samples, X has {len(u)}. "
            "Pass the X and y that fit() was given."
        )
    time = np.concatenate(
        [
            diagnosis.problem.simulator.dt * np.arange(piece.stop - piece.start)
            for piece in session_slices(sessions, len(u))
        ]
    )
    candidate = diagnosis.best
    return Material(
        diagnosis.problem.simulator,
        u,
        measured,
        sessions,
        time,
        diagnosis.base_run,
        diagnosis.problem.run(candidate.fit.model),
        candidate.fit.model.p,
        candidate.effects,
        _held_out(dx.conclusion_, u, measured),
    )


def _held_out(conclusion: Conclusion, u, y) -> tuple[HeldOut, ...]:
    """Return the runs that were scored."""
    guesses, leads = conclusion.guesses, conclusion.leads
    found = []
    for stretch in conclusion.stretches:
        runs = {
            name: free_run(simulator, u, y, stretch, guesses[name], leads.get(name)).y
            for name, simulator in conclusion.simulators.items()
        }
        found.append(HeldOut(stretch, runs))
    return tuple(found)


def adjoining(parts: Sequence[HeldOut]) -> list[list[HeldOut]]:
    """Return held-out stretches with those that follow on them at once."""
    groups: list[list[HeldOut]] = []
    for part in parts:
        if (
            groups
            and groups[-1][-1].rows.stop == part.rows.start
            and part.stretch.began == groups[-1][0].stretch.began
        ):
            groups[-1].append(part)
        else:
            groups.append([part])
    return groups


def noise_left(dx, material: Material) -> Noise:
    """Estimate the colour of what the corrected simulation leaves on the fitting windows."""
    problem = dx.conclusion_.diagnosis.problem
    return estimate_noise(problem.raw(np.nan_to_num(material.y - material.after.y)), problem.seen)


def whitened(residual: np.ndarray, noise: Noise, sessions=None) -> np.ndarray:
    """Take the noise's colour out of residuals, (n_samples, n_outputs), stretch by stretch.

    Returns
    -------
    ndarray of shape (n_samples, n_outputs)
        Innovations over their standard deviation; NaN where a stretch is too young for them.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.noise import Noise
    >>> from narx_sklearn.report._runs import whitened
    >>> whitened(np.array([[1.0], [2.0], [3.0]]), Noise((np.array([0.5]),), np.array([1.0])))[:, 0].tolist()
    [nan, 1.5, 2.0]
    """
    e = np.full_like(residual, np.nan)
    for piece in finite_slices(session_slices(sessions, len(residual)), finite_rows(residual)):
        e[piece] = noise.innovations(residual[None, piece])[0]
        e[piece][: noise.order] = np.nan
    return e

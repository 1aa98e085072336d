"""Which mistakes of a record stand, and speak against physics, beside what was found in it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import linprog

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import SMALL, fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.records.finding import DataFinding
from narx_sklearn.discrepancy.records.mistakes import BOX, SCALE_RANGE, boxed
from narx_sklearn.discrepancy.search.confirm import is_of_a_sensor
from narx_sklearn.discrepancy.search.inference import untold
from narx_sklearn.discrepancy.simulators.simulator import Simulator

FAR_LESS = 0.5  # of what undoing a mistake leaves beyond noise: what an effect leaves that speaks against it
MENDED_FIRST = (
    "time_scale",
    "swapped",
    "sign",
    "wrapped",
    "unsigned",
    "units",
)  # physics beside them is theirs
BY_PHYSICS = (0.1, 10.0)  # factors that missing physics may have, where no change of units has them


def still_standing(
    findings: Sequence[DataFinding], problem: Problem, refitted: Model, best: Model
) -> list[DataFinding]:
    """Return findings without mistakes that, undone, left more of the record than is left of it as it is.

    Where small errors of the parameters grow, as on a pole that a loop holds up, the quick refit of the check
    goes anywhere, and whatever makes the simulation move less agrees better. And what arrives smoothed
    arrives late, too: an effect that leaves far less, beyond the noise that nothing explains, says what it
    is. But a fit with a gain a thousand times the nominal is no better than another unit, nor one with every
    rate doubled than another sampling period: what leaves less must do so with parameters that are as near as
    undoing a mistake needs them. Where they lie elsewhere, it is fitted again with such.

    Parameters
    ----------
    findings : sequence of DataFinding
        Of the record, as the check found it.
    problem : Problem
        The record in windows.
    refitted, best : Model
        The refitted simulator over these windows, and that with what was found.
    """
    n_undone = sum("after" in finding.evidence for finding in findings)
    if not n_undone:
        return list(findings)  # none was undone on trial
    spread = Noise.as_large_as(problem.y).sigma

    def missed(model: Model) -> float:
        if _n_far(problem.simulator, model.p) >= n_undone:
            nearest = _nearest_alike(problem, model)
            model = fit(replace(problem, simulator=boxed(problem.simulator)), nearest).model
        left = (problem.y - problem.run(model).y) / spread
        return float(np.mean(left[problem.rows][problem.seen] ** 2))

    of_refit, of_best = missed(refitted), missed(best)
    innovations = np.where(problem.seen, (problem.noise.sigma / spread) ** 2, 0.0)
    noise = min(float(innovations.sum() / max(problem.seen.sum(), 1)), of_best)
    least = min(of_refit, noise + (of_best - noise) / FAR_LESS) if np.isfinite(of_best) else of_refit
    return [finding for finding in findings if not least < finding.evidence.get("after", -np.inf)]


def _n_far(simulator: Simulator, p: np.ndarray) -> int:
    """Return how many parameters are farther from the nominal ones than a check of the record lets them."""
    nominal = simulator.nominal
    return int(np.sum((np.abs(p - nominal) > BOX * np.abs(nominal)) & (nominal != 0)))


def _nearest_alike(problem: Problem, model: Model) -> Model:
    """Return the model with parameters nearer to the nominal ones, moved where nothing notices it.

    The largest relative distance becomes as small as can be.
    """
    found = fit(problem, model, iterations=0)
    n, nominal = model.p.size, problem.simulator.nominal
    directions = untold(found)
    directions = directions[~np.any(directions[:, n:], axis=1)] * np.abs(found.steps) / SMALL
    known = nominal != 0
    if not len(directions):
        return model
    # how far along each, and the largest distance, which is the least that holds for all
    size = np.abs(nominal[known])
    along, away = directions[:, :n][:, known].T / size[:, None], (model.p - nominal)[known] / size
    rows = np.vstack([np.column_stack([sign * along, -np.ones(size.size)]) for sign in (1, -1)])
    cost = np.concatenate([np.zeros(len(directions)), [1.0]])
    bounds = [(None, None)] * len(directions) + [(0, None)]
    best = linprog(cost, rows, np.concatenate([-away, away]), bounds=bounds)
    return model if best.x is None else model.with_q(model.q + best.x[:-1] @ directions)


def not_told_by(
    findings: Sequence[DataFinding], effects: Sequence[PlacedEffect], simulator: Simulator
) -> list[DataFinding]:
    """Return findings without columns that come late by what a delay among the effects says already.

    Whether the machine or the recorder is late no record tells, so one mismatch would be told twice.

    Examples
    --------
    >>> from narx_sklearn.discrepancy import ODESimulator
    >>> from narx_sklearn.discrepancy.placed import PlacedEffect, Port
    >>> from narx_sklearn.discrepancy.records.finding import DataFinding
    >>> from narx_sklearn.discrepancy.records.standing import not_told_by
    >>> from narx_sklearn.physics.effects import CATALOGUE
    >>> tank = ODESimulator(lambda x, u, p: (u[0] - p[0] * x[0],), dt=0.1, parameters={"outlet": 1.0},
    ...                     states=["level"], inputs=["pump"])
    >>> late = DataFinding("delayed", "", {"output": 0, "samples": 8})
    >>> delay = PlacedEffect(CATALOGUE["delay"], Port("input", 0), theta=(0.79, 0.0))
    >>> len(not_told_by([late], [delay], tank)), len(not_told_by([late], [delay.at((0.4, 0.0))], tank))
    (0, 1)
    """
    delays = [effect for effect in effects if effect.effect.code == "delay"]

    def is_told(finding: DataFinding) -> bool:
        if finding.code != "delayed":
            return False
        at = finding.evidence
        same = {(kind, at[kind]) for kind in ("input", "output") if kind in at}
        if len(simulator.inputs) == 1:  # its delay is that of every output
            same.add(("input", 0))
        behind = sum(e.theta[0] for e in delays if (e.port.kind, e.port.index) in same)
        return behind > 0 and abs(behind / simulator.dt - finding.evidence["samples"]) <= 1.0

    return [finding for finding in findings if not is_told(finding)]


def to_be_mended(findings: Sequence[DataFinding], effects: Sequence[PlacedEffect]) -> list[DataFinding]:
    """Return the mistakes of a record that must be mended before effects named beside them mean anything.

    What comes late may do so in the machine, an offset that was named as one is told as what it is, a unit
    that only a label states may be the same in other letters, and what is a few times larger or smaller than
    the simulation, as no change of units makes it, may be so by the physics that is missing.
    """
    of_sensors = bool(effects) and all(is_of_a_sensor(effect) for effect in effects)

    def is_none(finding: DataFinding) -> bool:
        if finding.code != "units":
            return False
        slope = finding.evidence.get("slope")
        if slope is None:
            return True
        if SCALE_RANGE[0] < slope < SCALE_RANGE[1]:
            return of_sensors
        return not finding.evidence["alike"] and BY_PHYSICS[0] < slope < BY_PHYSICS[1]

    return [finding for finding in findings if finding.code in MENDED_FIRST and not is_none(finding)]

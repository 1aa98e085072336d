"""How effects would move the outputs, and how alike: before anything is measured."""

from collections import Counter
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import fit
from narx_sklearn.discrepancy.noise import Noise
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.bank import INVISIBLE, TANGENT, directions, effect_column, off
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis, enumerate_hypotheses
from narx_sklearn.discrepancy.simulators.simulator import Simulator, Windows
from narx_sklearn.discrepancy.simulators.structure import find_structure
from narx_sklearn.physics.effects import Effect


class EffectTangents(NamedTuple):
    """What effects of ordinary size change in the outputs, in standard deviations of the noise.

    The simulator's own parameters and the initial states are projected out, in each part of the record on its
    own. Of what they do as well nothing is left.
    """

    placed: tuple[PlacedEffect, ...]
    gram: np.ndarray  # (n_parts, n_effects, n_effects) inner products

    @property
    def names(self) -> list[str]:
        """The effects with their places, each once."""
        names = [_named(placed) for placed in self.placed]
        seen: Counter[str] = Counter()
        for i, name in enumerate(names):
            seen[name] += 1
            names[i] = name if seen[name] == 1 else f"{name} #{seen[name]}"
        return names

    @property
    def length(self) -> np.ndarray:
        """How far each effect moves the outputs, (n_parts, n_effects)."""
        return np.sqrt(np.maximum(np.einsum("kii->ki", self.gram), 0.0))

    @property
    def cosine(self) -> np.ndarray:
        """Of the angle between every two, (n_parts, n_effects, n_effects), one where one does nothing."""
        length = self.length
        both = length[:, :, None] * length[:, None, :]
        return np.clip(np.where(both > 0, np.abs(self.gram) / np.where(both > 0, both, 1.0), 1.0), 0.0, 1.0)


def effect_tangents(
    simulator: Simulator,
    u: np.ndarray,
    windows: Windows,
    x0: np.ndarray,
    effects: Iterable[Effect],
    sigma: np.ndarray,
    *,
    apart: bool = False,
    n_jobs: int | None = None,
) -> EffectTangents:
    """Return what effects would change in the outputs at every place where they could act.

    Each is of the shape, among those from which a search would begin, that changes most over all parts.

    Parameters
    ----------
    x0 : ndarray of shape (n_windows, n_states)
        Initial states of the windows; they are taken to be unknown all the same.
    sigma : ndarray of shape (n_outputs,)
        Standard deviation of the noise.
    apart : bool, default=False
        Whether each window is a part, an experiment of its own; else all are one.
    """
    run = simulator.run(u, windows, x0)
    problem = Problem(simulator, u, run.y, windows, Noise.white(sigma))
    base = fit(problem, Model(simulator.nominal, simulator.effects, x0), iterations=0)
    structure = find_structure(simulator, run.x, u)
    hypotheses = enumerate_hypotheses(effects, problem, run, structure, n_jobs=n_jobs)
    parts = [slice(k, k + 1) for k in range(windows.count)] if apart else [slice(0, windows.count)]
    own = [directions(base.jacobian[part]) for part in parts]

    def column(placed: PlacedEffect) -> np.ndarray:
        raw = effect_column(problem, base, run, placed)
        left = base.projector(raw)
        for part, basis in zip(parts, own, strict=True):
            before = np.sum(left[part] ** 2)
            left[part] = off(basis, left[part])
            # what bends within the tangent's own step is no more than the error of taking it
            least = max(INVISIBLE * np.sum(raw[part] ** 2), TANGENT**2 * before)
            if np.sum(left[part] ** 2) <= least:
                left[part] = 0.0
        return left

    def most(hypothesis: Hypothesis) -> tuple[PlacedEffect, np.ndarray]:
        found = None
        for start in hypothesis.starts:
            placed = hypothesis.placed.at(start)
            tried = column(placed)
            if found is None or np.sum(tried**2) > np.sum(found[1] ** 2):
                found = placed, tried
        assert found is not None  # a hypothesis has a start
        return found

    found = Parallel(n_jobs=n_jobs, prefer="threads")(delayed(most)(h) for h in hypotheses)
    n = len(found)
    gram = np.zeros((len(parts), n, n))
    if n:
        columns = np.array([changed for _, changed in found])
        for k, part in enumerate(parts):
            flat = columns[:, part].reshape(n, -1)
            gram[k] = flat @ flat.T
    return EffectTangents(tuple(placed for placed, _ in found), gram)


def _named(placed: PlacedEffect) -> str:
    arguments = [name for name in (placed.argument_name, placed.second_name) if name]
    return f"{placed.effect.code} at {placed.port} ({', '.join(arguments)})"

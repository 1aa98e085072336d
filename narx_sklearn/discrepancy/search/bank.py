"""Columns of the bank: what each effect would change in the output, everything else projected out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed

from narx_sklearn.discrepancy.fitting.directions import ALIKE
from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.fitting.refit import Fit, all_bounds
from narx_sklearn.discrepancy.placed import PlacedEffect
from narx_sklearn.discrepancy.search.hypotheses import Hypothesis

TANGENT = 1e-2  # share of an ordinary size that is injected
ENDLESS = 1e100  # energy of what an effect does, beyond which the run has no slope worth the name
INVISIBLE = 1e-6  # squared share of a column left after projection, below which it says nothing of its own
MOST_COLUMNS = 8  # that are fitted freely, to see the noise


@dataclass(frozen=True)
class Bank:
    """Columns of all hypotheses, with initial states and the model's own parameters projected out.

    Attributes
    ----------
    owner, start : ndarray of shape (n_columns,)
        Hypothesis of each column, and the row of its starts.
    columns : ndarray of shape (W, T, n_columns)
    residual : ndarray of shape (W, T)
        Projected alike.
    gram : ndarray of shape (n_columns, n_columns)
    plain : ndarray of shape (n_columns,)
        Inner products with the residual.
    useful : ndarray of bool of shape (n_columns,)
        Whether something of the column was left by the projection.
    """

    hypotheses: list[Hypothesis]
    owner: np.ndarray
    start: np.ndarray
    columns: np.ndarray
    residual: np.ndarray
    gram: np.ndarray
    plain: np.ndarray
    useful: np.ndarray

    @property
    def n_columns(self) -> int:
        """Number of columns."""
        return self.owner.size

    @cached_property
    def n_directions(self) -> float:
        """Number of independent directions that the columns amount to.

        Counted by the eigenvalues of their correlations (Li and Ji 2005, Heredity 95, 221): one for each
        above one, and what each has beyond a whole number.
        """
        length = np.sqrt(np.diag(self.gram))
        used = np.flatnonzero(self.useful & (length > 0))
        if not used.size:
            return 1.0
        correlation = self.gram[np.ix_(used, used)] / np.outer(length[used], length[used])
        values = np.maximum(np.round(np.linalg.eigvalsh(correlation), 6), 0.0)
        return float(np.sum((values >= 1.0) + (values - np.floor(values))))

    def without_columns(self) -> "Bank":
        """Return the bank with what was made of its columns, but not the columns, which are large."""
        return replace(self, columns=np.empty((*self.residual.shape, 0)))

    def placed(self, column: int) -> PlacedEffect:
        """Return the effect behind a column, at its start."""
        hypothesis = self.hypotheses[self.owner[column]]
        return hypothesis.placed.at(hypothesis.starts[self.start[column]])


class Entered(NamedTuple):
    """A fitted model with effects beside its own, and what it leaves, initial states refitted."""

    model: Model
    left: float


def make_bank(problem: Problem, fit: Fit, hypotheses: list[Hypothesis], n_jobs: int | None = None) -> Bank:
    """Inject every effect at each of its starts, and project out what the model itself can explain."""
    pairs = [(h, s) for h, hypothesis in enumerate(hypotheses) for s in range(len(hypothesis.starts))]
    owner = np.array([h for h, _ in pairs], dtype=int)
    start = np.array([s for _, s in pairs], dtype=int)
    base = problem.run(fit.model)
    n_w, n_t = fit.residual.shape
    stored, raw = np.empty((len(pairs), n_w, n_t)), np.empty(len(pairs))
    own = directions(fit.jacobian)

    def store(i: int, h: int, s: int) -> None:
        column = effect_column(problem, fit, base, hypotheses[h].placed.at(hypotheses[h].starts[s]))
        with np.errstate(over="ignore"):
            raw[i] = np.einsum("wt,wt->", column, column)
        if not raw[i] <= ENDLESS:
            raw[i], column = 0.0, np.zeros_like(column)
        stored[i] = off(own, fit.projector(column))

    Parallel(n_jobs=n_jobs, prefer="threads")(delayed(store)(i, h, s) for i, (h, s) in enumerate(pairs))
    residual = off(own, fit.residual)
    flat = stored.reshape(len(pairs), n_w * n_t)
    gram = flat @ flat.T
    useful = np.diag(gram) > INVISIBLE * np.maximum(raw, 1e-300)
    columns = np.moveaxis(stored, 0, 2)
    return Bank(hypotheses, owner, start, columns, residual, gram, flat @ residual.ravel(), useful)


def beside(problem: Problem, fit: Fit, hypotheses: Sequence[Hypothesis], n_jobs: int | None = None) -> Fit:
    """Return a fit to which what some hypotheses would do is as explained as what its parameters do."""
    if not hypotheses:
        return fit
    columns = make_bank(problem, fit, list(hypotheses), n_jobs).columns
    return fit._replace(jacobian=np.concatenate([fit.jacobian, columns], axis=2))


def directions(jacobian: np.ndarray) -> np.ndarray:
    """Return orthonormal columns, (W T, n), that span the global parameters' sensitivities, (W, T, n_q)."""
    J = jacobian.reshape(jacobian.shape[0] * jacobian.shape[1], jacobian.shape[2])
    if J.shape[1] == 0:
        return J
    size = np.linalg.norm(J, axis=0)
    size[size == 0] = 1.0
    left, values, _ = np.linalg.svd(J / size, full_matrices=False)
    return left[:, values > 1e-9 * values[0]]


def out_of(jacobian: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Project the global parameters' sensitivities, (W, T, n_q), out of columns (W, T, n)."""
    return off(directions(jacobian), columns) if columns.shape[2] else columns


def off(basis: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Project orthonormal columns, (W T, n), out of one column (W, T) or several (W, T, n)."""
    flat = columns.reshape(basis.shape[0], -1)
    return (flat - basis @ (basis.T @ flat)).reshape(columns.shape)


def effect_column(problem: Problem, fit: Fit, base, placed: PlacedEffect) -> np.ndarray:
    """Return the change of the whitened output per full strength of one effect, (W, T)."""
    effects = (*fit.model.effects, placed)
    strength = [*[1.0] * len(fit.model.effects), TANGENT]
    moved = problem.run(fit.model._replace(effects=effects), strength)
    return np.nan_to_num(problem.whiten(moved.y - base.y) / TANGENT, nan=0.0, posinf=0.0, neginf=0.0)


def entered(problem: Problem, fit: Fit, base, *placed: PlacedEffect) -> Entered:
    """Return a fitted model with more effects, all else moved as the tangents say where that leaves less.

    At full strength at once an effect may throw the run far from the recording, although the simulator's own
    parameters would take most of it.
    """

    def left_by(model: Model) -> Entered:
        residual = problem.residual(problem.run(model))
        with np.errstate(over="ignore"):  # what runs off so far leaves more than anything else
            left = float(np.sum(fit.projector(residual) ** 2)) if np.isfinite(residual).all() else np.inf
        return Entered(model, left)

    as_it_was = left_by(fit.model._replace(effects=(*fit.model.effects, *placed)))
    if not fit.model.q.size:
        return as_it_was
    columns = [effect_column(problem, fit, base, effect) for effect in placed]
    moved = moved_for(problem, fit, -np.sum(columns, axis=0), np.arange(fit.model.q.size))
    return min(as_it_was, left_by(moved._replace(effects=(*moved.effects, *placed))), key=lambda e: e.left)


def moved_for(problem: Problem, fit: Fit, change: np.ndarray, index: np.ndarray) -> Model:
    """Return a fitted model in which some parameters make a change, (W, T), as far as tangents let them.

    None goes where parameters do nothing together.

    Parameters
    ----------
    index : ndarray of int
        Which of the global parameters move.
    """
    wanted = fit.projector(change).ravel()
    J = fit.jacobian[:, :, index].reshape(wanted.size, -1)
    size = np.linalg.norm(J, axis=0)
    size[size == 0] = 1.0
    q = fit.model.q
    q[index] += np.linalg.lstsq(J / size, wanted, rcond=np.sqrt(ALIKE))[0] / size
    lower, upper = all_bounds(problem, fit.model).T
    return fit.model.with_q(np.clip(q, lower, upper))


def flexible_residual(bank: Bank, n_samples: int) -> tuple[np.ndarray, int]:
    """Return what is left of the residual, (W, T), when the bank's best columns are fitted freely.

    Named right or wrong, they take the structure out; what remains shows the noise. Also returned is how
    many columns were used.
    """
    plain, gram, use = bank.plain, bank.gram, bank.useful.copy()
    chosen: list[int] = []
    left = float(np.einsum("wt,wt->", bank.residual, bank.residual))
    for _ in range(MOST_COLUMNS):
        rest, length = _after(plain, gram, chosen)
        told = use & (length > 1e-6 * np.diag(gram))
        worth = np.divide(rest**2, length, out=np.zeros(length.size), where=told)
        worth[chosen] = 0.0
        j = int(np.argmax(worth)) if worth.size else 0
        # a column must earn more than noise gives the best of them by chance
        if not worth.size or worth[j] <= 2 * np.log(max(use.sum(), 2)) * left / max(n_samples, 1):
            break
        chosen.append(j)
        left = max(left - worth[j], 0.0)
    if not chosen:
        return bank.residual, 0
    matrix = bank.columns[:, :, chosen]
    flat = matrix.reshape(-1, len(chosen))
    size = np.linalg.norm(flat, axis=0)
    solution = np.linalg.lstsq(flat / size, bank.residual.ravel(), rcond=1e-9)[0]
    return bank.residual - (matrix / size) @ solution, len(chosen)


def _after(plain, gram, chosen):
    """Return inner products and squared lengths after the chosen columns are projected out."""
    if not chosen:
        return plain, np.diag(gram).copy()
    inverse = np.linalg.pinv(gram[np.ix_(chosen, chosen)], hermitian=True)
    cross = gram[:, chosen]
    return plain - cross @ inverse @ plain[chosen], np.diag(gram) - np.einsum(
        "ij,jk,ik->i", cross, inverse, cross
    )

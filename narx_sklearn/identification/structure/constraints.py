"""Linear equality constraints on the parameters, S theta = c (2.47)."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.terms import Term, TermLibrary

__all__ = ["LinearConstraints", "parse_constraints"]

#: Relative size below which a row of S, or a contradiction between rows, counts as rounding.
RANK_TOLERANCE = 1e-10
LISTED = 20  # candidates that a message names


@dataclass(frozen=True, eq=False)
class LinearConstraints:
    """Constraints S theta = c on the parameters of a library's terms.

    Attributes
    ----------
    S : ndarray of shape (n_constraints, n_terms)
    c : ndarray of shape (n_constraints,)
    """

    S: np.ndarray
    c: np.ndarray

    def __len__(self) -> int:
        return self.c.size

    @classmethod
    def none(cls, n_terms: int) -> "LinearConstraints":
        """Return no constraints on ``n_terms`` parameters."""
        return cls(np.zeros((0, n_terms)), np.zeros(0))

    @property
    def terms(self) -> np.ndarray:
        """Indices of the terms that any constraint names."""
        return np.flatnonzero(np.any(self.S != 0.0, axis=0))

    def restrict(self, support: Sequence[int]) -> "LinearConstraints":
        """Return the constraints when only ``support`` has parameters, all others being zero.

        Rows left without a term are dropped when their side is zero.

        Raises
        ------
        ValueError
            If a row is left without a term but must give a value, or rows contradict each other.
        """
        S = self.S[:, list(support)]
        empty = ~np.any(S != 0.0, axis=1)
        lost = empty & (self.c != 0.0)
        if lost.any():
            raise ValueError(
                f"A constraint must sum to {self.c[lost][0]:g}, but none of its terms is in the model."
            )
        return _independent(S[~empty], self.c[~empty])

    def scaled(self, factors: np.ndarray) -> "LinearConstraints":
        """Return the constraints on ``theta / factors``."""
        return LinearConstraints(self.S * factors, self.c)

    def solution_space(self) -> tuple[np.ndarray, np.ndarray]:
        """Return (theta0, Z) such that every solution is theta0 + Z a; Z has orthonormal columns."""
        n_terms = self.S.shape[1]
        if not len(self):
            return np.zeros(n_terms), np.eye(n_terms)
        Q, T = qr(self.S.T)
        rank = len(self)
        theta0 = Q[:, :rank] @ np.linalg.solve(T[:rank].T, self.c)
        return theta0, Q[:, rank:]

    def eliminate(self, preference: np.ndarray) -> "Elimination":
        """Solve each constraint for one of its parameters.

        Parameters
        ----------
        preference : ndarray of shape (n_terms,)
            Of the terms of a constraint the one with the largest value is solved for.
        """
        S, c = self.S.copy(), self.c.copy()
        pivots: list[int] = []
        for i in range(c.size):
            large = np.abs(S[i]) > RANK_TOLERANCE * np.abs(S[i]).max()
            pivot = int(np.argmax(np.where(large, preference, -np.inf)))
            S[i], c[i] = S[i] / S[i, pivot], c[i] / S[i, pivot]
            for j in range(c.size):
                if j != i:
                    c[j] -= S[j, pivot] * c[i]
                    S[j] -= S[j, pivot] * S[i]
            pivots.append(pivot)
        rest = np.setdiff1d(np.arange(S.shape[1]), pivots)
        return Elimination(np.array(pivots, dtype=int), rest, S[:, rest], c)


def on_library(
    constraints: LinearConstraints | None, full: TermLibrary, part: TermLibrary
) -> LinearConstraints | None:
    """Return constraints on ``full`` as constraints on the terms of ``part``."""
    if constraints is None or not len(constraints):
        return None
    return constraints.restrict([full.index(term) for term in part])


def on_screened(
    constraints: LinearConstraints, full: TermLibrary, kept: TermLibrary
) -> LinearConstraints | None:
    """Return constraints on all candidates as constraints on those that screening kept (all they name)."""
    if not len(constraints):
        return None
    return LinearConstraints(constraints.S[:, [full.index(term) for term in kept]], constraints.c)


@dataclass(frozen=True, eq=False)
class Elimination:
    """Constraints solved for some parameters: theta[pivots] = c - S theta[rest].

    Put into the regression, they change its columns and its target but not its kind, so that terms can be
    selected under the constraints.
    """

    pivots: np.ndarray
    rest: np.ndarray
    S: np.ndarray
    c: np.ndarray

    def columns(self, n_terms: int, n_outputs: int, output: int) -> np.ndarray:
        """Return T such that [Psi, Y] T are the columns of the unconstrained regression."""
        T = np.zeros((n_terms + n_outputs, self.rest.size + n_outputs))
        T[self.rest, np.arange(self.rest.size)] = 1.0
        T[np.ix_(self.pivots, np.arange(self.rest.size))] = -self.S
        T[n_terms + np.arange(n_outputs), self.rest.size + np.arange(n_outputs)] = 1.0
        T[self.pivots, self.rest.size + output] = -self.c
        return T

    def support(self, chosen: Sequence[int]) -> tuple[int, ...]:
        """Return the terms that have a parameter when ``chosen`` (positions in ``rest``) are selected."""
        chosen = list(chosen)
        needed = (self.c != 0.0) | np.any(self.S[:, chosen] != 0.0, axis=1)
        return (*(int(p) for p in self.pivots[needed]), *(int(j) for j in self.rest[chosen]))


def parse_constraints(constraints, library: TermLibrary, *, intercept: str = "constant") -> LinearConstraints:
    """Read constraints given as texts or as (S, c).

    Parameters
    ----------
    constraints : None, str, list of str, or tuple (S, c)
        Texts such as ``"y[k-1] + y[k-2] = 1"``; a term's name stands for its parameter, ``constant`` for
        that of the constant term, plain numbers for values. ``S``, of shape (n_constraints, n_terms), has
        its columns in the library's order.
    library : TermLibrary
        Candidate terms.
    intercept : str, default="constant"
        Word for the constant term's parameter.

    Returns
    -------
    LinearConstraints

    Raises
    ------
    ValueError
        If a text cannot be read, a term is not among the candidates, shapes do not fit, or constraints
        contradict each other.

    Examples
    --------
    >>> from narx_sklearn.identification import parse_constraints
    >>> from narx_sklearn.model import TermLibrary
    >>> parse_constraints("y[k-1] + y[k-2] = 1", TermLibrary(["y[k-1]", "y[k-2]", "u[k-1]"])).S
    array([[1., 1., 0.]])
    """
    n_terms = len(library)
    if constraints is None or (not isinstance(constraints, str) and len(constraints) == 0):
        return LinearConstraints.none(n_terms)
    if isinstance(constraints, tuple) and not all(isinstance(part, str) for part in constraints):
        S, c = (np.atleast_1d(np.asarray(part, dtype=float)) for part in constraints)
        S = np.atleast_2d(S)
        if S.shape != (c.size, n_terms):
            raise ValueError(
                f"The constraint matrix S has shape {S.shape}; for c of {c.size} values and {n_terms} "
                f"candidate terms it must be ({c.size}, {n_terms})."
            )
        return _independent(S, c)
    texts = [constraints] if isinstance(constraints, str) else list(constraints)
    rows, sides = zip(*(_parse_one(text, library, intercept) for text in texts), strict=True)
    return _independent(np.array(rows), np.array(sides))


def _parse_one(text: str, library: TermLibrary, intercept: str) -> tuple[np.ndarray, float]:
    left, equals, right = str(text).partition("=")
    if not equals or "=" in right:
        raise ValueError(f"Cannot read the constraint {text!r}; write it like 'y[k-1] + y[k-2] = 1'.")
    marker = "constant_[k]"  # a stand-in, as the constant term itself reads as a number
    word = re.compile(rf"\b{re.escape(intercept)}\b(?!\s*\[)")  # not part of a name, nor a signal's name
    sides = [Polynomial.parse(word.sub(marker, side)) for side in (left, right)]
    difference = sides[0] - sides[1]
    if not any(term.factors for side in sides for term in side.library):
        raise ValueError(
            f"The constraint {text!r} names no term: numbers in it are numbers. Write {intercept} for the "
            f"constant term, which is written 1 elsewhere, as in '{intercept} = 9'."
        )
    row = np.zeros(len(library))
    for term, value in difference.items:
        if not term.factors:
            continue
        named = Term() if str(term) == marker else term
        if named not in library:
            called = str(term) if named.factors else intercept
            raise ValueError(
                f"The constraint {text!r} names {called}, which is not among the {len(library)} candidate "
                f"terms; {_way_to_candidates(named, library, intercept)}"
            )
        row[library.index(named)] += value
    return row, -difference[Term()]


def _way_to_candidates(term: Term, library: TermLibrary, intercept: str) -> str:
    """Say how a term that is no candidate may be meant: of other signals, or of other lags and degrees."""
    unknown, signals = sorted(term.signals - library.signals), sorted(library.signals)
    if unknown:
        return (
            f"{', '.join(map(repr, unknown))} is none of the signals, which are {signals}. Signals of a "
            "table are named by its columns, without units."
        )
    names = [str(term) if term.factors else intercept for term in library.terms[:LISTED]]  # as they are typed
    shown = ", ".join(names) + (", ..." if len(library) > LISTED else "")
    return f"check lags, degree and fit_intercept. The candidates are {shown}."


def _independent(S: np.ndarray, c: np.ndarray) -> LinearConstraints:
    """Drop rows that repeat others; raise where they contradict each other."""
    if not len(c):
        return LinearConstraints(S, c)
    T, order = qr(S.T, pivoting=True, mode="r")
    diagonal = np.abs(np.diag(T))
    rank = int(np.sum(diagonal > RANK_TOLERANCE * max(diagonal.max(initial=0.0), np.finfo(float).tiny)))
    kept = np.sort(order[:rank])
    if rank == len(c):
        return LinearConstraints(S, c)
    theta = np.linalg.lstsq(S[kept], c[kept], rcond=None)[0] if rank else np.zeros(S.shape[1])
    gap = np.abs(S @ theta - c)
    if gap.max() > 1e-8 * max(1.0, np.abs(c).max()):
        raise ValueError(
            f"The constraints contradict each other: constraint {int(np.argmax(gap)) + 1} of {len(c)} "
            f"misses its value by {gap.max():.3g} when the others hold."
        )
    return LinearConstraints(S[kept], c[kept])

"""Terms of polynomial NARX models as values: variables, terms, libraries.

One text notation serves for printing, parsing, pandas column names and constraints: a variable is
``y[k-1]`` (the output one sample ago), ``u[k]`` (the input now); a term is a product of powers,
``u[k-2]^2*phi2[k-1]``; the constant term is ``1``.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement, groupby
from math import comb
from numbers import Integral
from typing import NamedTuple

import numpy as np

__all__ = ["Term", "TermLibrary", "TermTable", "Variable", "count_candidates"]

# Reading order of the field's own letters; every other name stands between y and u.
_LETTER_ORDER = {"y": 0, "u": 2, "m": 3, "phi": 4, "e": 5}
_SIGNAL = re.compile(r"[^\W\d]\w*")
_VARIABLE = re.compile(r"\s*([^\W\d]\w*)\s*\[\s*k\s*(?:([+-])\s*(\d+)\s*)?\]\s*")
_POWER = re.compile(r"\s*(?:\^|\*\*)\s*(\d+)\s*")


def signal_order(signal: str) -> tuple:
    """Return the sort key that puts signals in reading order: y, others, u, m, phi, e; then by number.

    The name itself comes last, so that no two signals (``u`` and ``u0``, ``u1`` and ``u01``) tie.
    """
    stem = signal.rstrip("0123456789")
    number = signal[len(stem) :]
    return _LETTER_ORDER.get(stem, 1), stem, int(number) if number else 0, signal


@dataclass(frozen=True, slots=True)
class Variable:
    """One signal at one lag, ``signal[k-lag]``.

    Parameters
    ----------
    signal : str
        Name of the signal; a Python identifier.
    lag : int
        Samples into the past; 0 is the present, negative values lie ahead.

    Examples
    --------
    >>> from narx_sklearn.model import Variable
    >>> str(Variable("y", 1)), str(Variable("u", 0))
    ('y[k-1]', 'u[k]')
    >>> Variable.parse("phi2[k-3]").lag
    3
    """

    signal: str
    lag: int

    def __post_init__(self):
        if not _SIGNAL.fullmatch(self.signal):
            raise ValueError(
                f"A signal's name must be a letter followed by letters, digits or '_', got {self.signal!r}."
            )
        if not isinstance(self.lag, Integral) or isinstance(self.lag, bool):
            raise TypeError(f"The lag of {self.signal} must be an integer, got {self.lag!r}.")
        object.__setattr__(self, "lag", int(self.lag))

    @classmethod
    def parse(cls, text: str) -> "Variable":
        """Read ``signal[k-lag]``."""
        match = _VARIABLE.fullmatch(text)
        if match is None:
            raise ValueError(f"Cannot read {text!r} as a variable; write it like 'y[k-1]' or 'u[k]'.")
        return cls._from_match(match)

    @classmethod
    def _from_match(cls, match: re.Match) -> "Variable":
        signal, sign, steps = match.groups()
        lag = int(steps or 0)
        return cls(signal, -lag if sign == "+" else lag)

    @property
    def order(self) -> tuple:
        """Sort key: reading order of signals, then lag."""
        return (*signal_order(self.signal), self.lag)

    def shift(self, steps: int) -> "Variable":
        """Return the variable ``steps`` samples further into the past."""
        return Variable(self.signal, self.lag + steps)

    def __str__(self) -> str:
        if self.lag == 0:
            return f"{self.signal}[k]"
        return f"{self.signal}[k{-self.lag:+d}]"

    def latex(self) -> str:
        """Return the variable in LaTeX, subscripted as in the literature.

        A name with letters beyond ASCII stands in ``\\text`` (amsmath): in math mode accents are not set.
        """
        stem = self.signal.rstrip("0123456789")
        number = self.signal[len(stem) :]
        face = "mathrm" if stem.isascii() else "text"
        written = stem.replace("_", r"\_")
        letter = stem if len(stem) == 1 and stem.isascii() else rf"\{face}{{{written}}}"
        letter = r"\phi" if stem == "phi" else letter
        time = "k" if self.lag == 0 else f"k{-self.lag:+d}"
        return f"{letter}_{{{number + ',' if number else ''}{time}}}"


@dataclass(frozen=True, slots=True)
class Term:
    """A product of powers of variables; the empty product is the constant term.

    Parameters
    ----------
    factors : tuple of (Variable, int)
        Variables with their positive exponents. Put into reading order, equal variables joined.

    Examples
    --------
    >>> from narx_sklearn.model import Term
    >>> term = Term.parse("u[k-2]^2 * phi2[k-1]")
    >>> str(term), term.degree, term.max_lag
    ('u[k-2]^2*phi2[k-1]', 3, 2)
    >>> str(term * Term.parse("y[k-1]"))
    'y[k-1]*u[k-2]^2*phi2[k-1]'
    """

    factors: tuple[tuple[Variable, int], ...] = ()

    def __post_init__(self):
        exponents: dict[Variable, int] = {}
        for variable, exponent in self.factors:
            if not isinstance(exponent, int | np.integer) or exponent < 1:
                raise ValueError(f"The exponent of {variable} must be a positive integer, got {exponent!r}.")
            exponents[variable] = exponents.get(variable, 0) + int(exponent)
        ordered = tuple(sorted(exponents.items(), key=lambda factor: factor[0].order))
        object.__setattr__(self, "factors", ordered)

    @classmethod
    def of(cls, *variables: Variable) -> "Term":
        """Return the product of ``variables``, repeated ones as powers."""
        return cls(tuple((variable, 1) for variable in variables))

    @classmethod
    def parse(cls, text: str) -> "Term":
        """Read a term such as ``u[k-2]^2*phi2[k-1]``; ``1`` is the constant."""
        if text.strip() == "1":
            return cls()
        factors: list[tuple[Variable, int]] = []
        position = 0
        while position < len(text):
            if factors and text[position] == "*":
                position += 1
            match = _VARIABLE.match(text, position)
            if match is None:
                raise ValueError(
                    f"Cannot read {text!r} as a term at position {position}; "
                    "write a product of variables like 'u[k-2]^2*phi2[k-1]', or '1' for the constant."
                )
            position = match.end()
            power = _POWER.match(text, position)
            factors.append((Variable._from_match(match), int(power.group(1)) if power else 1))
            position = power.end() if power else position
        if not factors:
            raise ValueError("Cannot read an empty text as a term; the constant term is '1'.")
        return cls(tuple(factors))

    @property
    def degree(self) -> int:
        """Sum of the exponents; 0 for the constant."""
        return sum(exponent for _, exponent in self.factors)

    @property
    def variables(self) -> tuple[Variable, ...]:
        """Distinct variables in reading order."""
        return tuple(variable for variable, _ in self.factors)

    @property
    def expanded(self) -> tuple[Variable, ...]:
        """Variables repeated by their exponents."""
        return tuple(variable for variable, exponent in self.factors for _ in range(exponent))

    @property
    def signals(self) -> frozenset[str]:
        """Names of the signals that occur."""
        return frozenset(variable.signal for variable, _ in self.factors)

    @property
    def max_lag(self) -> int:
        """Longest lag that occurs; 0 for the constant."""
        return max((variable.lag for variable, _ in self.factors), default=0)

    @property
    def min_lag(self) -> int:
        """Shortest lag that occurs; 0 for the constant."""
        return min((variable.lag for variable, _ in self.factors), default=0)

    @property
    def order(self) -> tuple:
        """Canonical sort key: degree, then variables in reading order."""
        return self.degree, tuple(variable.order for variable in self.expanded)

    @property
    def cluster(self) -> tuple[tuple[str, int], ...]:
        """Term cluster: each signal with the sum of its exponents, lags forgotten (Def. 2.2).

        Examples
        --------
        >>> from narx_sklearn.model import Term
        >>> Term.parse("y[k-1]*y[k-2]*u[k-1]").cluster
        (('y', 2), ('u', 1))
        """
        by_signal = groupby(self.factors, key=lambda factor: factor[0].signal)
        return tuple((signal, sum(exponent for _, exponent in group)) for signal, group in by_signal)

    def exponent(self, variable: Variable) -> int:
        """Return the exponent of ``variable``, 0 where it does not occur."""
        return dict(self.factors).get(variable, 0)

    def without(self, variable: Variable) -> "Term":
        """Return the term with every power of ``variable`` removed."""
        return Term(tuple(factor for factor in self.factors if factor[0] != variable))

    def shift(self, steps: int) -> "Term":
        """Return the term ``steps`` samples further into the past."""
        return Term(tuple((variable.shift(steps), exponent) for variable, exponent in self.factors))

    def __mul__(self, other: "Term") -> "Term":
        if not isinstance(other, Term):
            return NotImplemented
        return Term(self.factors + other.factors)

    def __pow__(self, power: int) -> "Term":
        if power == 0:
            return Term()
        return Term(tuple((variable, exponent * power) for variable, exponent in self.factors))

    def __str__(self) -> str:
        if not self.factors:
            return "1"
        return "*".join(f"{v}^{e}" if e > 1 else str(v) for v, e in self.factors)

    def latex(self) -> str:
        """Return the term in LaTeX.

        Examples
        --------
        >>> from narx_sklearn.model import Term
        >>> print(Term.parse("u[k-2]^2*phi2[k-1]").latex())
        u_{k-2}^{2} \\phi_{2,k-1}
        """
        if not self.factors:
            return "1"
        return " ".join(f"{v.latex()}^{{{e}}}" if e > 1 else v.latex() for v, e in self.factors)


def as_term(term: "Term | Variable | str") -> Term:
    """Return ``term`` as a `Term`, reading texts and wrapping variables."""
    if isinstance(term, Term):
        return term
    if isinstance(term, Variable):
        return Term.of(term)
    if isinstance(term, str):
        return Term.parse(term)
    raise TypeError(f"A term is a Term, a Variable or a text like 'u[k-2]^2', got {type(term).__name__}.")


class TermTable(NamedTuple):
    """A library as integers, the form that kernels eat.

    Attributes
    ----------
    channels : ndarray of shape (n_variables,)
        Channel of each distinct variable.
    lags : ndarray of shape (n_variables,)
        Its lag.
    factors : ndarray of shape (n_terms, degree)
        For each term the indices of the variables whose product it is, -1 past the end.
    """

    channels: np.ndarray
    lags: np.ndarray
    factors: np.ndarray


@dataclass(frozen=True)
class TermLibrary(Sequence):
    """An ordered set of terms: no duplicates, and one canonical order however it was built.

    The order is by degree, then by variables in reading order, so that a tie between candidates never
    depends on the history of the library.

    Parameters
    ----------
    terms : iterable of Term, Variable or str
        The terms; texts are parsed.

    Examples
    --------
    >>> from narx_sklearn.model import TermLibrary
    >>> library = TermLibrary(["u[k-1]*y[k-1]", "1", "y[k-1]"])
    >>> print(library)
    1, y[k-1], y[k-1]*u[k-1]
    >>> len(TermLibrary.polynomial(["y[k-1]", "u[k-1]"], degree=2))
    6
    """

    terms: tuple[Term, ...] = ()

    def __init__(self, terms: Iterable[Term | Variable | str] = ()):
        unique = {as_term(term): None for term in terms}
        object.__setattr__(self, "terms", tuple(sorted(unique, key=lambda term: term.order)))

    @classmethod
    def polynomial(
        cls, variables: Iterable[Variable | str], degree: int, *, include_constant: bool = True
    ) -> "TermLibrary":
        """Return all products of ``variables`` up to ``degree``.

        Parameters
        ----------
        variables : iterable of Variable or str
            The lagged variables.
        degree : int
            Highest degree, the nonlinearity degree of the model (2.12).
        include_constant : bool, default=True
            Whether the constant term belongs to it.

        Returns
        -------
        TermLibrary
            The ``comb(n_variables + degree, degree)`` terms, one fewer without the constant.
        """
        distinct = dict.fromkeys(Variable.parse(v) if isinstance(v, str) else v for v in variables)
        ordered = sorted(distinct, key=lambda variable: variable.order)
        products = (
            Term.of(*chosen)
            for d in range(0 if include_constant else 1, degree + 1)
            for chosen in combinations_with_replacement(ordered, d)
        )
        return cls(products)

    @cached_property
    def _index(self) -> dict[Term, int]:
        return {term: i for i, term in enumerate(self.terms)}

    def __len__(self) -> int:
        return len(self.terms)

    def __iter__(self) -> Iterator[Term]:
        return iter(self.terms)

    def __getitem__(self, key):
        if isinstance(key, slice):
            return TermLibrary(self.terms[key])
        return self.terms[key]

    def __contains__(self, term) -> bool:
        return as_term(term) in self._index

    def index(self, term, start: int = 0, stop: int | None = None) -> int:
        """Return the position of ``term``."""
        try:
            return self._index[as_term(term)]
        except KeyError:
            raise ValueError(f"{term} is not among the {len(self)} terms of the library.") from None

    def __or__(self, other: "TermLibrary") -> "TermLibrary":
        return TermLibrary(self.terms + tuple(other))

    def __and__(self, other: "TermLibrary") -> "TermLibrary":
        return self._ordered(term for term in self if term in other)

    def __sub__(self, other: "TermLibrary") -> "TermLibrary":
        return self._ordered(term for term in self if term not in other)

    def __mul__(self, other: "TermLibrary") -> "TermLibrary":
        return TermLibrary(a * b for a in self for b in other)

    def filter(self, keep: Callable[[Term], bool]) -> "TermLibrary":
        """Return the terms for which ``keep`` holds."""
        return self._ordered(term for term in self if keep(term))

    def subset(self, indices: Iterable[int]) -> "TermLibrary":
        """Return the terms at ``indices`` (in canonical order)."""
        return self._ordered(self.terms[i] for i in sorted(set(indices)))

    @classmethod
    def _ordered(cls, terms: Iterable[Term]) -> "TermLibrary":
        """Return the library of terms that are in canonical order already, without sorting them."""
        library = cls.__new__(cls)
        object.__setattr__(library, "terms", tuple(terms))
        return library

    @property
    def degree(self) -> int:
        """Highest degree of its terms."""
        return max((term.degree for term in self), default=0)

    @property
    def max_lag(self) -> int:
        """Longest lag of its terms."""
        return max((term.max_lag for term in self), default=0)

    @property
    def variables(self) -> tuple[Variable, ...]:
        """Distinct variables of all terms, in reading order."""
        distinct = {variable for term in self for variable in term.variables}
        return tuple(sorted(distinct, key=lambda variable: variable.order))

    @property
    def signals(self) -> frozenset[str]:
        """Names of all signals that occur."""
        return frozenset().union(*(term.signals for term in self))

    @property
    def names(self) -> list[str]:
        """The terms as texts."""
        return [str(term) for term in self]

    def table(self, channels: Sequence[str]) -> TermTable:
        """Return the library as integers over the named channels.

        Parameters
        ----------
        channels : sequence of str
            Signal names, in the order of the columns of the kernels' data.

        Returns
        -------
        TermTable
            Channel and lag of each variable, and each term as indices of variables.
        """
        position = {signal: i for i, signal in enumerate(channels)}
        unknown = self.signals - position.keys()
        if unknown:
            raise ValueError(
                f"The terms use the signals {sorted(unknown)}, which are not among {list(channels)}."
            )
        variables = self.variables
        row = {variable: i for i, variable in enumerate(variables)}
        factors = np.full((len(self), max(self.degree, 1)), -1, dtype=np.int64)
        for t, term in enumerate(self):
            rows = [row[variable] for variable in term.expanded]
            factors[t, : len(rows)] = rows
        return TermTable(
            np.array([position[v.signal] for v in variables], dtype=np.int64),
            np.array([v.lag for v in variables], dtype=np.int64),
            factors,
        )

    def __str__(self) -> str:
        return ", ".join(self.names)

    def __repr__(self) -> str:
        return f"TermLibrary({self.names!r})"


def count_candidates(n_variables: int, degree: int) -> int:
    """Count the candidate terms of a polynomial NARX model, the constant included (2.38).

    Parameters
    ----------
    n_variables : int
        Number of lagged variables, ``n_y + n_u + n_phi``.
    degree : int
        Nonlinearity degree.

    Returns
    -------
    int
        ``comb(n_variables + degree, degree)``, the closed form of the thesis's recursion.

    Examples
    --------
    >>> from narx_sklearn.model import count_candidates
    >>> count_candidates(12, 3)
    455
    """
    return comb(n_variables + degree, degree)

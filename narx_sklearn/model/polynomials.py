"""Polynomials over lagged variables: the algebra behind equations, steady states and compensators."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import reduce
from math import comb
from numbers import Integral

from narx_sklearn.model.terms import Term, TermLibrary, Variable, as_term

__all__ = ["Polynomial"]

# A leading coefficient; "1" alone is read as the number one.
_NUMBER = re.compile(r"\s*(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)\s*")


@dataclass(frozen=True, init=False)
class Polynomial:
    """A linear combination of terms with real coefficients.

    Parameters
    ----------
    coefficients : mapping of {Term, Variable or str: float} or iterable of such pairs
        Equal terms are added; zeros are dropped.

    Examples
    --------
    >>> from narx_sklearn.model import Polynomial
    >>> p = Polynomial({"y[k-1]": 0.5, "u[k-1]^2": 2.0})
    >>> print(p)
    0.5*y[k-1] + 2*u[k-1]^2
    >>> print(p * Polynomial.parse("u[k-1] - 1"))
    -0.5*y[k-1] + 0.5*y[k-1]*u[k-1] - 2*u[k-1]^2 + 2*u[k-1]^3
    """

    items: tuple[tuple[Term, float], ...]

    def __init__(self, coefficients: Mapping | Iterable = ()):
        pairs = coefficients.items() if isinstance(coefficients, Mapping) else coefficients
        total: dict[Term, float] = {}
        for term, coefficient in pairs:
            key = as_term(term)
            total[key] = total.get(key, 0.0) + float(coefficient)
        kept = ((term, value) for term, value in total.items() if value != 0.0)
        object.__setattr__(self, "items", tuple(sorted(kept, key=lambda item: item[0].order)))

    @classmethod
    def constant(cls, value: float) -> "Polynomial":
        """Return the polynomial that is ``value`` everywhere."""
        return cls({Term(): value})

    @classmethod
    def variable(cls, variable: Variable | str) -> "Polynomial":
        """Return the polynomial that is one variable."""
        return cls({as_term(variable): 1.0})

    @classmethod
    def parse(cls, text: str) -> "Polynomial":
        """Read a sum such as ``0.5*y[k-1] - u[k-2]^2 + 1``.

        Raises
        ------
        ValueError
            If a summand is not a number times a term.
        """
        return cls(_parse_summand(sign, body) for sign, body in _summands(text))

    @property
    def library(self) -> TermLibrary:
        """The terms with a coefficient."""
        return TermLibrary(term for term, _ in self.items)

    @property
    def coefficients(self) -> dict[Term, float]:
        """Coefficient of each term, in canonical order."""
        return dict(self.items)

    @property
    def degree(self) -> int:
        """Highest degree of its terms; 0 for a constant."""
        return max((term.degree for term, _ in self.items), default=0)

    @property
    def variables(self) -> tuple[Variable, ...]:
        """Distinct variables in reading order."""
        return self.library.variables

    def __getitem__(self, term) -> float:
        return self.coefficients.get(as_term(term), 0.0)

    def __bool__(self) -> bool:
        return bool(self.items)

    def __add__(self, other) -> "Polynomial":
        return Polynomial(self.items + _as_polynomial(other).items)

    __radd__ = __add__

    def __neg__(self) -> "Polynomial":
        return Polynomial((term, -value) for term, value in self.items)

    def __sub__(self, other) -> "Polynomial":
        return self + (-_as_polynomial(other))

    def __rsub__(self, other) -> "Polynomial":
        return _as_polynomial(other) - self

    def __mul__(self, other) -> "Polynomial":
        other = _as_polynomial(other)
        return Polynomial((a * b, x * y) for a, x in self.items for b, y in other.items)

    __rmul__ = __mul__

    def __pow__(self, power: int) -> "Polynomial":
        if not isinstance(power, Integral) or power < 0:
            raise ValueError(f"The power of a polynomial must be an integer, zero or more, got {power!r}.")
        return reduce(lambda product, _: product * self, range(power), Polynomial.constant(1.0))

    def derivative(self, variable: Variable | str) -> "Polynomial":
        """Return the partial derivative with respect to ``variable``."""
        variable = _as_variable(variable)
        pairs = []
        for term, value in self.items:
            exponent = term.exponent(variable)
            if exponent:
                rest = term.without(variable) * Term.of(*[variable] * (exponent - 1))
                pairs.append((rest, value * exponent))
        return Polynomial(pairs)

    def substitute(self, values: Mapping) -> "Polynomial":
        """Replace variables by numbers or polynomials.

        Parameters
        ----------
        values : mapping of {Variable or str: float or Polynomial}
            What each variable becomes; the others stay.

        Examples
        --------
        >>> from narx_sklearn.model import Polynomial
        >>> p = Polynomial.parse("y[k-1]*u[k-1] + u[k-1]^2")
        >>> print(p.substitute({"u[k-1]": 3.0}))
        9 + 3*y[k-1]
        """
        replaced = {_as_variable(v): _as_polynomial(value) for v, value in values.items()}
        total: list[tuple[Term, float]] = []
        for term, value in self.items:
            product = Polynomial({Term(): value})
            kept = []
            for variable, exponent in term.factors:
                if variable in replaced:
                    product = product * replaced[variable] ** exponent
                else:
                    kept.append((variable, exponent))
            rest = Term(tuple(kept))
            total.extend((rest * t, c) for t, c in product.items)
        return Polynomial(total)

    def collect(self, variable: Variable | str) -> tuple["Polynomial", ...]:
        """Return the coefficients of the powers 0, 1, 2, ... of ``variable``.

        Examples
        --------
        >>> from narx_sklearn.model import Polynomial
        >>> [str(c) for c in Polynomial.parse("2*y[k-1]*u[k-1]^2 + 3").collect("u[k-1]")]
        ['3', '0', '2*y[k-1]']
        """
        variable = _as_variable(variable)
        powers: dict[int, list] = {}
        for term, value in self.items:
            powers.setdefault(term.exponent(variable), []).append((term.without(variable), value))
        return tuple(Polynomial(powers.get(p, ())) for p in range(max(powers, default=0) + 1))

    def shift(self, steps: int) -> "Polynomial":
        """Return the polynomial ``steps`` samples further into the past."""
        return Polynomial((term.shift(steps), value) for term, value in self.items)

    def translate(self, offsets: Mapping[str, float]) -> "Polynomial":
        """Return p(s - offset): the same function, written in signals that are not offset.

        Binomial expansion of every power; signals without an offset stay.
        """
        pairs: list[tuple[Term, float]] = []
        for term, value in self.items:
            partial = [(Term(), value)]
            for variable, exponent in term.factors:
                shift = -float(offsets.get(variable.signal, 0.0))
                if shift == 0.0:
                    choices = [(exponent, 1.0)]
                else:
                    choices = [(p, comb(exponent, p) * shift ** (exponent - p)) for p in range(exponent + 1)]
                partial = [
                    (t * Term.of(*[variable] * p), c * factor) for t, c in partial for p, factor in choices
                ]
            pairs.extend(partial)
        return Polynomial(pairs)

    def __call__(self, values: Mapping):
        """Evaluate at ``values``: a number or array for each variable.

        Raises
        ------
        ValueError
            If a variable has no value.
        """
        known = {_as_variable(v): value for v, value in values.items()}
        missing = [str(v) for v in self.variables if v not in known]
        if missing:
            raise ValueError(f"No value given for {', '.join(missing)}.")
        total = 0.0
        for term, coefficient in self.items:
            product = coefficient
            for variable, exponent in term.factors:
                product = product * known[variable] ** exponent
            total = total + product
        return total

    def to_text(self, digits: int = 5) -> str:
        """Return the sum with coefficients of ``digits`` significant digits."""
        if not self.items:
            return "0"
        parts: list[str] = []
        for term, value in self.items:
            number = f"{abs(value):.{digits}g}"
            name = str(term)
            body = number if not term.factors else name if number == "1" else f"{number}*{name}"
            sign = "-" if value < 0 else "+"
            parts.append(f"{sign} {body}" if parts else f"-{body}" if value < 0 else body)
        return " ".join(parts)

    def __str__(self) -> str:
        return self.to_text()

    def latex(self, digits: int = 5) -> str:
        """Return the sum in LaTeX."""
        parts: list[str] = []
        for term, value in self.items:
            mantissa, _, exponent = f"{abs(value):.{digits}g}".partition("e")
            number = mantissa + (rf" \times 10^{{{int(exponent)}}}" if exponent else "")
            body = number if not term.factors else rf"{number}\, {term.latex()}"
            sign = "-" if value < 0 else "+"
            parts.append(f"{sign} {body}" if parts else f"-{body}" if value < 0 else body)
        return " ".join(parts) or "0"


def _as_variable(variable: Variable | str) -> Variable:
    return Variable.parse(variable) if isinstance(variable, str) else variable


def _as_polynomial(value) -> Polynomial:
    return value if isinstance(value, Polynomial) else Polynomial.constant(value)


def _summands(text: str):
    """Split at + and - that stand outside brackets and are not an exponent's sign."""
    sign, start, depth = "+", 0, 0
    for i, letter in enumerate(text):
        depth += (letter == "[") - (letter == "]")
        is_exponent = i >= 2 and text[i - 1] in "eE" and (text[i - 2].isdigit() or text[i - 2] == ".")
        if letter in "+-" and depth == 0 and not is_exponent:
            if text[start:i].strip():
                yield sign, text[start:i]
                sign = letter
            elif letter == "-":
                sign = "-" if sign == "+" else "+"
            start = i + 1
    yield sign, text[start:]


def _parse_summand(sign: str, body: str) -> tuple[Term, float]:
    value = -1.0 if sign == "-" else 1.0
    match = _NUMBER.match(body)
    if match is not None:
        value *= float(match.group(1))
        rest = body[match.end() :].strip()
        return (Term.parse(rest.removeprefix("*")) if rest else Term()), value
    try:
        return Term.parse(body), value
    except ValueError as error:
        raise ValueError(
            f"Cannot read the summand {body.strip()!r}; write a number times a term, like '0.5*y[k-1]'."
        ) from error

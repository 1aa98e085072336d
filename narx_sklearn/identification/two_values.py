"""Signals that take two values only, such as a PRBS or a switch: powers of them are no candidates.

On two values a and b every power is a straight line, ``x^2 = (a + b) x - a b``, so that a term with a power
of x repeats terms with x and without it: which of them is chosen is left to rounding, and what they say
between and beyond the two values differs altogether.
"""

import warnings
from dataclasses import replace

import numpy as np

from narx_sklearn.exceptions import ExcitationWarning
from narx_sklearn.identification.one_step.procedure import Problem
from narx_sklearn.identification.records.record import Moments
from narx_sklearn.model.terms import Term, TermLibrary

__all__ = ["two_valued", "without_repeated_powers"]

EQUAL = 1e-12  # share of the squared range: far above rounding, below one sample in 10^11 between the ends


def two_valued(moments: Moments) -> np.ndarray:
    """Tell of each signal whether it takes exactly two values, in more than two samples.

    Of all distributions between a least and a largest value only those at these two have the variance
    (largest - mean) (mean - least) (Bhatia and Davis 2000), so sums over a record are enough.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.identification.records.record import Moments
    >>> from narx_sklearn.identification.two_values import two_valued
    >>> switch, ramp, still = [5.0, 7.0, 7.0, 5.0], [0.0, 1.0, 2.0, 3.0], [4.0, 4.0, 4.0, 4.0]
    >>> two_valued(Moments.of(np.column_stack([switch, ramp]), np.column_stack([still]))).tolist()
    [False, True, False]
    """
    width = np.where(moments.known > 2, moments.high - moments.low, 0.0)
    low, mean, high = (np.where(width > 0, values, 0.0) for values in moments.range)
    with np.errstate(over="ignore", invalid="ignore"):  # such values are refused by who fits them
        missing = (high - mean) * (mean - low) - moments.square / np.maximum(moments.known, 1.0)
        rounding = 4 * np.finfo(float).eps * np.abs(mean) * width
        return (width > 0) & (np.abs(missing) <= EQUAL * width**2 + rounding)


def without_repeated_powers(problem: Problem, moments: Moments, constraints, *, warn: bool = True) -> Problem:
    """Return the problem without terms that repeat simpler candidates on the two values of a signal.

    Where constraints name parameters, every candidate stays. A search fits many models and warns of none.

    Warns
    -----
    ExcitationWarning
        If a term is left out.
    """
    if constraints is not None and not (isinstance(constraints, str) and constraints == "continuum"):
        return problem
    names = np.array(problem.outputs + problem.inputs)[two_valued(moments)].tolist()
    kept = problem.library.filter(lambda term: not _is_repeated(term, problem.library, names))
    if len(kept) == len(problem.library):
        return problem
    if warn:
        left_out = problem.library - kept
        powers = {v.signal for term in left_out for v in term.variables if term.exponent(v) > 1}
        told = " and ".join(name for name in names if name in powers)
        warnings.warn(
            f"{told} {'take' if ' and ' in told else 'takes'} only two values in this record, on which every "
            f"power is a straight line; terms with powers of {told} are left out. How the machine bends over "
            "them cannot be learnt from this record: excite with more levels, as narx_sklearn.signals.prvs "
            "does.",
            ExcitationWarning,
            stacklevel=4,
        )
    return replace(problem, library=kept)


def _is_repeated(term: Term, library: TermLibrary, names: list[str]) -> bool:
    """Tell whether a term has a power of a two-valued signal, and what it repeats are candidates."""
    for variable in term.variables:
        exponent = term.exponent(variable)
        if variable.signal in names and exponent > 1:
            rest = Term.of(*(v for v in term.expanded if v != variable))
            if rest in library and rest * Term.of(variable) in library:
                return True
    return False

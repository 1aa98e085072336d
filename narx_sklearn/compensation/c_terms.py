"""Polynomials and phi regressors in C: the expressions that laws and models are both written with."""

import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from narx_sklearn.compensation import _c_runtime as runtime
from narx_sklearn.compensation import _kernels as kernels
from narx_sklearn.model.kernels import (
    ABSOLUTE_DIFFERENCE,
    ASYMMETRIC_SIGN,
    DIFFERENCE,
    DIFFERENCE_SIGN,
    HYSTERETIC,
    PLAY,
    SMOOTH_SIGN,
    STATE_SIZE,
)
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.terms import Variable

__all__ = [
    "advanced",
    "check_identifier",
    "expression",
    "filled",
    "helpers",
    "macro_of",
    "number",
    "state_size",
    "window",
]


def check_identifier(name: str) -> None:
    """Refuse what cannot be the prefix of names in C."""
    if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
        raise ValueError(f"name={name!r} is no C identifier; use letters, digits and '_'.")


def macro_of(signal: str) -> str:
    """Return the macro that reads a signal, of letters that every compiler takes.

    Examples
    --------
    >>> from narx_sklearn.compensation.c_terms import macro_of
    >>> macro_of("drive"), macro_of("höhe")
    ('S_drive', 'S_hu00f6he')
    """
    return "S_" + "".join(c if c.isascii() else f"u{ord(c):04x}" for c in signal)


def number(value) -> str:
    """Return a number in C with all its digits."""
    if np.isinf(value):
        return "INFINITY" if value > 0 else "(-INFINITY)"
    return repr(float(value))


def expression(polynomial: Polynomial, read: Callable[[Variable], str]) -> str:
    """Return a polynomial as an expression of what ``read`` says for each lagged variable.

    Examples
    --------
    >>> from narx_sklearn.compensation.c_terms import expression
    >>> from narx_sklearn.model import Polynomial
    >>> expression(Polynomial.parse("u[k-1]^2 - 0.5*y[k-1]"), lambda v: f"{v.signal}{v.lag}")
    '-0.5*y1 + u1*u1'
    """
    parts: list[str] = []
    for term, value in polynomial.items:
        factors = [read(v) for v in term.expanded]
        size = number(abs(value))
        body = "*".join(factors if size == "1.0" and factors else [size, *factors])
        sign = "-" if value < 0 else "+"
        parts.append(f"{sign} {body}" if parts else f"-{body}" if value < 0 else body)
    return " ".join(parts) or "0.0"


def advanced(element: Any, index: int, now: str, before: str, state: str) -> str:
    """Return the value of a phi regressor, the ``index``-th, at one sample; its memory goes on.

    Parameters
    ----------
    element : Phi or BoucWenElement
    index : int
        By which its parameters are found.
    now, before : str
        Its signal at this sample and at the one before, in C.
    state : str
        Where its memory is.
    """
    p = [number(value) for value in element.kernel_parameters]
    difference = f"({now} - {before})"
    if element.kind == DIFFERENCE:
        return difference
    if element.kind == DIFFERENCE_SIGN:
        return f"NAME_sign{difference}"
    if element.kind == ABSOLUTE_DIFFERENCE:
        return f"fabs{difference}"
    if element.kind == SMOOTH_SIGN:
        return f"tanh({difference} / {p[0]})"
    if element.kind == ASYMMETRIC_SIGN:
        split = 1 + int(element.kernel_parameters[0])
        rising, falling = (_horner(part, now) for part in (p[1:split], p[split:]))
        return f"({difference} > 0.0 ? {rising} : {difference} < 0.0 ? {falling} : 0.0)"
    if element.kind == PLAY:
        return f"({state}[0] = NAME_play({state}[0], {now}, {p[0]}))"
    if element.kind == HYSTERETIC:
        return f"NAME_hysteretic({state}, {now})"
    return f"({state}[0] = NAME_bouc_wen({state}[0], {difference}, NAME_p{index}))"


def helpers(kinds: Iterable[int]) -> list[str]:
    """Return the functions that phi regressors of these kinds call."""
    kinds = set(kinds)
    chosen = [
        (runtime.SIGN, kinds & {DIFFERENCE_SIGN, kernels.BOUC_WEN}),
        (runtime.PLAY, PLAY in kinds),
        (runtime.HYSTERETIC, HYSTERETIC in kinds),
        (runtime.BOUC_WEN, kernels.BOUC_WEN in kinds),
    ]
    return [text for text, wanted in chosen if wanted]


def state_size(kinds: Iterable[int]) -> int:
    """Return how many numbers the memory of a phi regressor takes."""
    return STATE_SIZE if HYSTERETIC in set(kinds) else 1


def window(macros: Iterable[str], rows: int) -> list[str]:
    """Return the definitions by which ``S_u(i)`` reads a signal at the ``i``-th row from the newest."""
    return [f"#define {macro}(i) (s->w[{rows - 1} - (i)][{channel}])" for channel, macro in enumerate(macros)]


def filled(text: str, constants: Mapping[str, float]) -> str:
    """Return a text with numbers in the place of constants' names."""
    for key, value in constants.items():
        text = re.sub(rf"\b{key}\b", str(value) if isinstance(value, int) else number(value), text)
    return text


def _horner(coefficients: list[str], x: str) -> str:
    text = coefficients[-1]
    for c in coefficients[-2::-1]:
        text = f"({text}) * {x} + {c}"
    return f"({text})"

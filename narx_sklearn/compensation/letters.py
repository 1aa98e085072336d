"""A model in the letters of a law: the input wanted is m, the reference r, all else out of their way."""

from collections.abc import Callable
from dataclasses import replace

from narx_sklearn.compensation.law import INPUT, REFERENCE, FunctionElement, free_name
from narx_sklearn.model.narx import NARXModel, replace_name
from narx_sklearn.model.phi import FunctionPhi, Phi
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.terms import Term, Variable

__all__ = ["Element", "element_of", "least_lag", "letters_of", "signals_of", "with_letters"]

Element = Phi | FunctionElement


def signals_of(model: NARXModel, input_name: str | None = None) -> tuple[NARXModel, str, str]:
    """Return the model in signals as measured, the name of the input that compensates and the output's.

    Raises
    ------
    ValueError
        If the model has several outputs, no input, or not the one that is named.
    """
    if len(model.outputs) != 1:
        raise ValueError(
            f"A compensator follows one output, the model has {list(model.outputs)}; build it from the "
            "equation of one of them."
        )
    if not model.inputs:
        raise ValueError("The model has no input to compensate with.")
    name = model.inputs[0] if input_name is None else input_name
    if name not in model.inputs:
        raise ValueError(f"input_name={name!r} is not among the model's inputs {list(model.inputs)}.")
    return model.expanded(), name, model.outputs[0]


def letters_of(model: NARXModel, names: dict[str, str]) -> Callable[[str], str]:
    """Return what a law calls a signal: as ``names`` says, and others out of the way of these.

    Examples
    --------
    >>> from narx_sklearn.compensation.letters import letters_of
    >>> from narx_sklearn.model import NARXModel
    >>> model = NARXModel.from_equations("0.5*y[k-1] + u[k-1] + 0.1*m[k-1]", inputs=["u", "m"])
    >>> letter = letters_of(model, {"y": "r", "u": "m"})
    >>> letter("y"), letter("u"), letter("m")
    ('r', 'm', 'm_')
    """
    names = dict(names)
    for other in {INPUT, REFERENCE} & (set(model.channels) - names.keys()):
        names[other] = free_name(other, {INPUT, REFERENCE, *model.channels})
    return lambda signal: names.get(signal, signal)


def with_letters(side: Polynomial, letter: Callable[[str], str]) -> Polynomial:
    """Return a polynomial with its signals called otherwise."""
    return Polynomial(
        (Term(tuple((Variable(letter(v.signal), v.lag), e) for v, e in term.factors)), value)
        for term, value in side.items
    )


def least_lag(side: Polynomial, signal: str) -> int:
    """Return the least lag at which a polynomial reads a signal."""
    return min(v.lag for v in side.variables if v.signal == signal)


def element_of(phi: Phi, letter: Callable[[str], str], newest: int, lead: int = 0) -> Element:
    """Return a phi regressor in the letters of the law; the reference is read ``lead`` samples ahead.

    A user's function is moved so that its newest occurrence, at lag ``newest`` of the law's equation, is the
    one of sample k. What it is called with then tells whether it waits for m[k].
    """
    if not isinstance(phi, FunctionPhi):
        return replace(replace_name(phi, letter(str(phi.name))), signal=letter(phi.signal))
    of = (Variable(letter(v.signal), v.lag + newest) for v in phi.of)
    moved = (v.shift(-lead) if v.signal == REFERENCE else v for v in of)
    return FunctionElement(phi.function, tuple(moved), letter(str(phi.name)))

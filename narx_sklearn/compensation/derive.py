"""From a NARX model to a compensation law, by the algebra of its terms (thesis sections 4.4 to 4.6)."""

from dataclasses import dataclass, replace
from numbers import Real
from typing import Any

from narx_sklearn.compensation.law import INPUT, MOVE, REFERENCE, CompensationLaw, FunctionElement, free_name
from narx_sklearn.compensation.letters import (
    Element,
    element_of,
    least_lag,
    letters_of,
    signals_of,
    with_letters,
)
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.phi import DifferenceSign, Phi, SmoothSign
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.terms import Term, Variable

__all__ = ["inverse_law", "isolated_law", "root_law", "root_polynomials", "smooth_signs"]

NEGLIGIBLE = 1e-11  # of the sum of magnitudes: coefficients that cancel to this are zero to rounding
NOW = Variable(INPUT, 0)
BEFORE = Variable(INPUT, 1)


@dataclass(frozen=True)
class Redirected:
    """A model's equation in the letters of compensation: output r, input m, shifted in time.

    Attributes
    ----------
    side : Polynomial
        The right-hand side.
    target : Variable
        What it gives.
    elements : tuple of Phi or FunctionElement
        Its phi regressors.
    others : tuple of str
        Its other inputs.
    rests : bool
        Whether the model stays where it is while its signals rest (a continuum of steady states).
    """

    side: Polynomial
    target: Variable
    elements: tuple[Element, ...]
    others: tuple[str, ...]
    rests: bool

    @property
    def unknown(self) -> dict[str, Element]:
        """Elements of the wanted input m[k], by name."""
        at_present = {v.signal for v in self.side.variables if v.lag == 0}
        return {str(e.name): e for e in self.elements if e.signal == INPUT and e.name in at_present}


def smooth_signs(model: NARXModel, width: float | None) -> NARXModel:
    """Return the model with every sign of a difference replaced by ``tanh(difference / width)``.

    Parameters
    ----------
    model : NARXModel
        The model.
    width : float or None
        Difference over which the sign turns, in the unit of the signal; None leaves the model as it is.

    Returns
    -------
    NARXModel

    Raises
    ------
    ValueError
        If ``width`` is not positive, whether the model has signs or none.

    Examples
    --------
    >>> from narx_sklearn.compensation import smooth_signs
    >>> from narx_sklearn.model import DifferenceSign, NARXModel
    >>> model = NARXModel.from_equations("y[k-1] + phi1[k-1]", phi=[DifferenceSign("u")])
    >>> smooth_signs(model, 0.5).phi[0].run([0.0, 0.25]).round(3).tolist()
    [0.0, 0.462]
    """
    check_width(width, "width")
    if width is None:
        return model
    phi = tuple(
        SmoothSign(p.signal, width=width, name=p.name) if isinstance(p, DifferenceSign) else p
        for p in model.phi
    )
    return replace(model, phi=phi, units=dict(model.units), origin=dict(model.origin))


def check_width(width, name: str) -> None:
    """Refuse a width that is neither None nor a positive number."""
    is_number = isinstance(width, Real) and not isinstance(width, bool)
    if width is not None and not (is_number and 0.0 < float(width) < float("inf")):
        raise ValueError(f"{name} must be a positive number (or None), got {width!r}.")


def redirect(model: NARXModel, input_name: str | None = None) -> Redirected:
    """Write a model as (4.8): in r and m, shifted so that the newest input is m[k].

    Other signals keep their names; one that is itself called ``m`` or ``r`` gets an underscore.

    Raises
    ------
    ValueError
        If the model has several outputs, or the input is not one of its inputs or does not occur.
    """
    model, name, output = signals_of(model, input_name)
    renamed = letters_of(model, {output: REFERENCE, name: INPUT})
    side = with_letters(model.equation(), renamed)
    used = [p for p in model.phi if p.name in model.library.signals]
    newest = {p.name: least_lag(side, renamed(str(p.name))) for p in used}
    lags = [v.lag for v in side.variables if v.signal == INPUT]
    lags += [newest[p.name] + v.lag for p in used for v in p.arguments if v.signal == name]
    if not lags:
        raise ValueError(
            f"The model does not depend on the input {name!r}, so no input can drive it to a reference. "
            f"Its equation is: {model.equation()}."
        )
    delay = min(lags)
    elements = tuple(element_of(p, renamed, newest[p.name] - delay) for p in used)
    return Redirected(
        _from_newest(side.shift(-delay), elements),
        Variable(REFERENCE, -delay),
        elements,
        tuple(renamed(s) for s in model.inputs if s != name),
        _rests(side, elements, REFERENCE),
    )


def root_polynomials(
    model: NARXModel, *, input_name: str | None = None
) -> tuple[tuple[Polynomial, ...], ...]:
    r"""Return the coefficients of the powers of m[k] in the compensation polynomials (4.9), (4.13)-(4.14).

    Every phi regressor of m[k] is replaced by what it is in loading and in unloading, every other signal
    stays; with :math:`c_{j,k}` the coefficients, :math:`\sum_j c_{j,k} m_k^j = 0`.

    Parameters
    ----------
    model : NARXModel
        Model with one output.
    input_name : str or None, default=None
        The input to compensate with; None is the first one.

    Returns
    -------
    tuple of tuple of Polynomial
        For each regime, the coefficients of the powers 0, 1, ...: loading and unloading, or one regime
        where the direction makes no difference.

    Raises
    ------
    ValueError
        If a phi regressor of m[k] is no polynomial in either direction, or the model does not fit.

    References
    ----------
    Lacerda Junior (2021), eqs. (4.9), (4.13), (4.14).

    Examples
    --------
    >>> from narx_sklearn.compensation import root_polynomials
    >>> from narx_sklearn.model import NARXModel
    >>> model = NARXModel.from_equations("0.8*y[k-1] + u[k-1] + 0.5*u[k-1]*u[k-2] + 0.1*u[k-1]^3")
    >>> [str(c) for c in root_polynomials(model)[0]]
    ['-r[k+1] + 0.8*r[k]', '1 + 0.5*m[k-1]', '0', '0.1']
    """
    redirected = redirect(model, input_name)
    regimes = _regimes(redirected)
    if regimes is None:
        names = [
            str(e.describe())
            for e in redirected.unknown.values()
            if not (isinstance(e, Phi) and _is_polynomial(e))
        ]
        raise ValueError(
            f"{', '.join(names)} of the wanted input is no polynomial in loading and unloading; "
            "RootCompensator searches the root of such a model."
        )
    return tuple(side.collect(NOW) for side in regimes)


def root_law(model: NARXModel, *, input_name: str | None = None) -> CompensationLaw:
    """Derive the law whose input is a root of the model's own equation (section 4.4).

    Models whose phi regressors of m[k] are polynomials in loading and unloading give polynomials, written in
    the move ``m[k] - m[k-1]``: near the last input they keep the digits that powers of m[k] would cancel. Any
    other model is searched.

    Parameters
    ----------
    model : NARXModel
        Model with one output.
    input_name : str or None, default=None
        The input to compensate with; None is the first one.

    Returns
    -------
    CompensationLaw

    Raises
    ------
    ValueError
        As `root_polynomials`, but for models that are no polynomials.
    """
    redirected = redirect(model, input_name)
    fields: dict[str, Any] = {"others": redirected.others, "keeps_rest": redirected.rests}
    regimes = _regimes(redirected)
    if regimes is None:
        equation = redirected.side - Polynomial.variable(redirected.target)
        return CompensationLaw("search", (equation,), redirected.elements, **fields)
    move = Variable(free_name(MOVE, {v.signal for side in regimes for v in side.variables}), 0)
    moved = Polynomial.variable(BEFORE) + Polynomial.variable(move)
    sides = [side.substitute({NOW: moved}).collect(move) for side in regimes]
    degree = max(len(side) for side in sides) - 1
    if degree == 0:
        raise ValueError(
            f"The wanted input cancels out of the model's equation in loading and unloading: {model}."
        )
    equations = tuple(c for side in sides for c in side + (Polynomial(),) * (degree + 1 - len(side)))
    return CompensationLaw(
        "roots", equations, _used(redirected.elements, equations), n_regimes=len(sides), **fields
    )


def isolated_law(model: NARXModel, *, input_name: str | None = None) -> CompensationLaw:
    """Derive the law that isolates the input (4.23) from a model that allows it.

    Parameters
    ----------
    model : NARXModel
        Model with one output, in which the newest input (or its first difference) occurs in one linear term
        (Assumptions 4.3 and 4.4).
    input_name : str or None, default=None
        The input to compensate with; None is the first one.

    Returns
    -------
    CompensationLaw

    Raises
    ------
    ValueError
        If the newest input occurs otherwise; the message says in which terms.

    Examples
    --------
    >>> from narx_sklearn.compensation import isolated_law
    >>> from narx_sklearn.model import NARXModel
    >>> model = NARXModel.from_equations("0.8*y[k-1] + 2*u[k-1] - 0.5*u[k-2]*y[k-1]")
    >>> print(isolated_law(model))
    m[k] = 0.5*r[k+1] - 0.4*r[k] + 0.25*r[k]*m[k-1]
    """
    redirected = redirect(model, input_name)
    fresh = [
        term for term in redirected.side.library if any(_is_fresh(v, redirected) for v in term.variables)
    ]
    regimes = _regimes(redirected)
    powers = [] if regimes is None else [side.collect(NOW) for side in regimes]
    gains = {str(side[1]) for side in powers if len(side) == 2 and side[1].degree == 0}
    wrong = [str(term) for term in fresh if term.degree != 1]
    if len(gains) != 1 or any(len(side) != 2 for side in powers) or wrong or len(powers) != 1:
        raise ValueError(
            f"The wanted input cannot be isolated: written with the newest input as m[k], it occurs in "
            f"{', '.join(wrong or map(str, fresh))}, but may occur only in a linear term of the input or of "
            'its first difference. Identify the model with structure="isolable" (and an input lag beyond the '
            "delay), or use RootCompensator."
        )
    rest, gain = powers[0]
    equation = (-1.0 / gain[Term()]) * rest
    return CompensationLaw(
        "explicit",
        (equation,),
        _used(redirected.elements, (equation,)),
        redirected.others,
        keeps_rest=redirected.rests,
    )


def static_powers(model: NARXModel, wanted: str) -> tuple[Polynomial, ...] | None:
    """Return the coefficients of the powers of a signal in a model's static equation, ``0 = F - y``.

    All signals are held, so that differences and their signs are zero; what is known stands at lag 0.

    Parameters
    ----------
    model : NARXModel
        Model with one output.
    wanted : str
        The input or the output that the equation is to be solved for.

    Returns
    -------
    tuple of Polynomial or None
        None where a phi regressor does not rest at zero (a function of the user's, or one with memory), or
        the wanted signal does not count at rest.

    Examples
    --------
    >>> from narx_sklearn.compensation.derive import static_powers
    >>> from narx_sklearn.model import NARXModel
    >>> model = NARXModel.from_equations("0.5*y[k-1] + 2*u[k-1] + u[k-2] + 0.1*u[k-1]*u[k-2]")
    >>> [str(c) for c in static_powers(model, "u")]
    ['-0.5*y[k]', '3', '0.1']
    """
    model = model.expanded()
    rests = {str(p.name): p.expansion(0) == Polynomial() for p in model.phi}
    total: dict[Term, float] = {Term.of(Variable(model.outputs[0], 0)): -1.0}
    sizes = dict.fromkeys(total, 1.0)
    for term, value in model.equation().items:
        at_rest = [rests[s] for s in term.signals if s in rests]
        if not all(at_rest):
            return None
        if at_rest:
            continue
        held = Term.of(*(Variable(v.signal, 0) for v in term.expanded))
        total[held] = total.get(held, 0.0) + value
        sizes[held] = sizes.get(held, 0.0) + abs(value)
    kept = {term: value for term, value in total.items() if abs(value) > NEGLIGIBLE * sizes[term]}
    powers = Polynomial(kept).collect(Variable(wanted, 0))
    return powers if len(powers) > 1 else None


def inverse_law(model: NARXModel, lead: int) -> CompensationLaw:
    r"""Turn a model of the inverse relationship into a law (4.29).

    The model gives the input u of the machine from the machine's output y, whose sample ``k-L`` in the model
    is the machine's sample ``k - L + lead``.

    Parameters
    ----------
    model : NARXModel
        Model with the machine's input as output and the machine's output as its only input.
    lead : int
        :math:`\tau_s`, by how many samples the machine's output was moved ahead; at least the delay of the
        machine plus 1.

    Returns
    -------
    CompensationLaw

    Raises
    ------
    ValueError
        If the model does not read the machine's output (Assumption 4.5), or does not fit.

    Examples
    --------
    >>> from narx_sklearn.compensation import inverse_law
    >>> from narx_sklearn.model import NARXModel
    >>> model = NARXModel.from_equations("u[k-1] + 2*y[k-1] - 2*y[k-2]", outputs=["u"], inputs=["y"])
    >>> print(inverse_law(model, lead=2))
    m[k] = 2*r[k+1] - 2*r[k] + m[k-1]
    """
    if len(model.inputs) > 1:
        raise ValueError(
            f"The model has the inputs {list(model.inputs)}, but an inverse model has one: it gives the "
            "machine's input from the machine's output. Pass such a model, or use root_law or isolated_law, "
            "RootCompensator or IsolatedCompensator, with a model of the machine itself and input_name."
        )
    model, name, output = signals_of(model, None)
    renamed = letters_of(model, {output: INPUT, name: REFERENCE})
    side = with_letters(model.equation(), renamed)
    used = [p for p in model.phi if p.name in model.library.signals]
    of_input = {INPUT, *(renamed(str(p.name)) for p in used if p.signals == {output})}
    if all(v.signal in of_input for v in side.variables):
        raise ValueError(
            "The inverse model reads no output of the machine, so its law would not follow a reference "
            f"(Assumption 4.5): {model.equation()}."
        )
    newest = {p.name: least_lag(side, renamed(str(p.name))) for p in used}
    elements = tuple(element_of(p, renamed, newest[p.name], lead) for p in used)
    rests = _rests(side, elements, INPUT)
    stay = of_input | {e.name for e in elements if isinstance(e, FunctionElement)}
    leads = {v: v if v.signal in stay else v.shift(-lead) for v in side.variables}
    equation = side.substitute({old: Polynomial.variable(new) for old, new in leads.items() if old != new})
    return CompensationLaw("explicit", (_from_newest(equation, elements),), elements, keeps_rest=rests)


def _from_newest(side: Polynomial, elements: tuple[Element, ...]) -> Polynomial:
    """Return the equation with the lags of users' functions counted from their newest occurrence."""
    moved: dict[Variable, Polynomial] = {}
    for name in (e.name for e in elements if isinstance(e, FunctionElement)):
        lags = [v.lag for v in side.variables if v.signal == name]
        moved |= {Variable(name, lag): Polynomial.variable(Variable(name, lag - min(lags))) for lag in lags}
    return side.substitute(moved)


def _is_fresh(variable: Variable, redirected: Redirected) -> bool:
    of_input = {INPUT, *(str(e.name) for e in redirected.elements if e.signal == INPUT)}
    return variable.lag == 0 and variable.signal in of_input


def _is_polynomial(phi: Phi) -> bool:
    return not phi.has_memory and phi.expansion(1) is not None and phi.expansion(-1) is not None


def _regimes(redirected: Redirected) -> list[Polynomial] | None:
    """Return ``F - r`` with every element of m[k] replaced: loading, unloading, or one where they agree."""
    unknown = {name: e for name, e in redirected.unknown.items() if isinstance(e, Phi) and _is_polynomial(e)}
    if len(unknown) < len(redirected.unknown):
        return None
    sides = []
    for direction in (1, -1):
        values = {Variable(name, 0): e.expansion(direction) for name, e in unknown.items()}
        sides.append(redirected.side.substitute(values) - Polynomial.variable(redirected.target))
    return sides[:1] if sides[0] == sides[1] else sides


def _used(elements: tuple[Element, ...], equations: tuple[Polynomial, ...]) -> tuple[Element, ...]:
    signals = {v.signal for equation in equations for v in equation.variables}
    return tuple(e for e in elements if e.name in signals)


def _rests(side: Polynomial, elements: tuple[Element, ...], output: str) -> bool:
    """Tell whether the equation at rest says no more than that the output stays (Lemma 4.1)."""
    if any(e.has_memory or isinstance(e, FunctionElement) for e in elements):
        return False
    at_rest = side.substitute({v: 0.0 for v in side.variables if v.signal in {str(e.name) for e in elements}})
    if any(term.degree != 1 or term.signals != {output} for term in at_rest.library):
        return False
    return abs(sum(value for _, value in at_rest.items) - 1.0) <= 1e-9

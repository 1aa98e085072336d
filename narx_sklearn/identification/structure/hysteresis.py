"""Models that can rest at more than one output: their candidate terms, and Lemma 4.1 on their parameters."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.identification.structure.candidates import STRUCTURES, Keep, Structure
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.phi import (
    AbsoluteDifference,
    AsymmetricSign,
    Difference,
    DifferenceSign,
    FunctionPhi,
    Phi,
    SmoothSign,
)
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.terms import Term, TermLibrary

__all__ = [
    "CONTINUUM",
    "RestingDynamics",
    "asked_for_continuum",
    "check_continuum",
    "expand_continuum",
    "hysteresis_structure",
    "rate_independent_structure",
    "resting_dynamics",
    "vanishes_at_rest",
]

CONTINUUM = "continuum"  # what a user writes for the constraint of Lemma 4.1
SUM_TOLERANCE = 1e-9  # of the linear output coefficients; a constraint is met to about 1e-12

SIGN_LIKE = (
    DifferenceSign,
    SmoothSign,
    AsymmetricSign,
)  # multi-valued functions, whose square loses the sign
PROBES = (0.0, 1.0, -2.5, 37.0)  # constant levels at which a user's function is tried


def vanishes_at_rest(phi: Phi) -> bool:
    """Tell whether a phi regressor is zero while its signals are constant.

    A user's function is tried at a few constant levels; a function with memory does not vanish.

    Parameters
    ----------
    phi : Phi
        The regressor.

    Returns
    -------
    bool

    Examples
    --------
    >>> from narx_sklearn.identification.structure.hysteresis import vanishes_at_rest
    >>> from narx_sklearn.model import DifferenceSign, Play
    >>> vanishes_at_rest(DifferenceSign("u")), vanishes_at_rest(Play("u", 1.0))
    (True, False)
    """
    if isinstance(phi, FunctionPhi):
        with np.errstate(all="ignore"):
            values = [phi.function(*(np.full(1, level) for _ in phi.of)) for level in PROBES]
        return not np.any(values)
    return phi.expansion(0) == Polynomial()


def hysteresis_structure(outputs: Sequence[str], inputs: Sequence[str], phi: Sequence[Phi]) -> Keep:
    r"""Return the filter of terms that Assumption 4.1 allows in a model with hysteresis.

    What is left at rest, where :math:`\phi_1 = u_k - u_{k-1}` and :math:`\phi_2 = \mathrm{sign}(\phi_1)` are
    zero, is :math:`\bar y = \Sigma_y \bar y`. With :math:`\Sigma_y = 1` (Lemma 4.1) every output is then a
    steady state, so that the model stays where it is when the input stops.

    Parameters
    ----------
    outputs, inputs : sequence of str
        Names of the signals.
    phi : sequence of Phi
        phi regressors, named.

    Returns
    -------
    callable
        Takes a `Term`, returns whether it may be a candidate.

    Notes
    -----
    A term is kept when it has the output at most to the first power (i), no sign-like phi to a higher power
    (ii), and either is one lagged output or has a factor that is zero at rest or remembers (iii). Three
    readings go beyond the letter of the assumption: higher powers of the output and of the sign are left out
    of all products, not only of the clusters it lists, because (4.3) shall be linear in the output and
    powers of the sign repeat lower ones; and so is the constant, because it would move the output at rest.
    Regressors with memory, such as the play, may stand alone: they hold their value when the input stops.

    References
    ----------
    Lacerda Junior (2021), Assumption 4.1; Martins and Aguirre (2016); Aguirre and Mendes (1996).

    Examples
    --------
    >>> from narx_sklearn.identification.structure.hysteresis import hysteresis_structure
    >>> from narx_sklearn.model import Difference, DifferenceSign, TermLibrary
    >>> phi = [Difference("u", name="phi1"), DifferenceSign("u", name="phi2")]
    >>> library = TermLibrary.polynomial(["y[k-1]", "u[k-1]", "phi1[k-1]", "phi2[k-1]"], degree=3)
    >>> kept = library.filter(hysteresis_structure(["y"], ["u"], phi))
    >>> len(library), len(kept)
    (35, 19)
    """
    output_names = set(outputs)
    moving = {str(p.name) for p in phi if _moves(p)}
    signs = {str(p.name) for p in phi if isinstance(p, SIGN_LIKE)}

    def keep(term: Term) -> bool:
        exponents = dict(term.cluster)
        if any(exponents.get(sign, 0) > 1 for sign in signs):
            return False
        output_degree = sum(exponents.get(output, 0) for output in output_names)
        if moving & exponents.keys():
            return output_degree <= 1
        return output_degree == 1 and term.degree == 1

    return keep


def rate_independent_structure(outputs: Sequence[str], inputs: Sequence[str], phi: Sequence[Phi]) -> Keep:
    r"""Return the filter of terms that a rate-independent model with hysteresis may have.

    Where the speed of the input does not matter, the output's change is proportional to the input's,
    :math:`\Delta y = g(u, y, \phi_2) \phi_1`. So every term but the linear outputs has exactly one first
    difference as a factor, and at most one sign. That leaves far fewer candidates of a high degree than
    Assumption 4.1 does, and allows powers of the output in g, which bend the loop where the assumption's
    straight line in the output cannot.

    Parameters
    ----------
    outputs, inputs : sequence of str
        Names of the signals.
    phi : sequence of Phi
        phi regressors, named.

    Returns
    -------
    callable
        Takes a `Term`, returns whether it may be a candidate.

    Notes
    -----
    All terms but the linear outputs vanish at rest, so Lemma 4.1 holds as it does with Assumption 4.1. The
    quasi-static sets (4.3) are roots of a polynomial in the output instead of a quotient.

    References
    ----------
    Ikhouane and Rodellar (2007) on rate independence; Lacerda Junior (2021), Lemma 4.1.

    Examples
    --------
    >>> from narx_sklearn.identification.structure.hysteresis import rate_independent_structure
    >>> from narx_sklearn.model import Difference, DifferenceSign, TermLibrary
    >>> phi = [Difference("u", name="phi1"), DifferenceSign("u", name="phi2")]
    >>> library = TermLibrary.polynomial(["y[k-1]", "u[k]", "phi1[k]", "phi2[k]"], degree=3)
    >>> print(library.filter(rate_independent_structure(["y"], ["u"], phi)).subset(range(5)))
    y[k-1], phi1[k], y[k-1]*phi1[k], u[k]*phi1[k], phi1[k]*phi2[k]
    """
    output_names = set(outputs)
    rates = {str(p.name) for p in phi if _is_rate(p)}
    signs = {str(p.name) for p in phi if isinstance(p, SIGN_LIKE)}

    def keep(term: Term) -> bool:
        exponents = dict(term.cluster)
        if sum(exponents.get(rate, 0) for rate in rates) == 1:
            return sum(exponents.get(sign, 0) for sign in signs) <= 1
        return term.degree == 1 and term.signals <= output_names

    return keep


def _moves(phi: Phi) -> bool:
    return phi.has_memory or vanishes_at_rest(phi)


def _is_rate(phi: Phi) -> bool:
    return isinstance(phi, Difference | AbsoluteDifference)


def _asked_for(structure: str, build: Structure, carries: Callable[[Phi], bool]) -> Structure:
    """Return a structure as an estimator asks for it: refused where it would leave the outputs alone."""

    def built(outputs: Sequence[str], inputs: Sequence[str], phi: Sequence[Phi]) -> Keep:
        if not any(map(carries, phi)):
            name = inputs[0] if inputs else "u"
            raise ValueError(
                f"structure={structure!r} keeps no term but the linear outputs, because no phi regressor "
                f"moves with an input. Pass phi=[Difference({name!r}), DifferenceSign({name!r})] of "
                "narx_sklearn.model."
            )
        return build(outputs, inputs, phi)

    return built


STRUCTURES["hysteresis"] = _asked_for("hysteresis", hysteresis_structure, _moves)
STRUCTURES["rate_independent"] = _asked_for("rate_independent", rate_independent_structure, _is_rate)


def expand_continuum(
    constraints, library: TermLibrary, outputs: Sequence[str], inputs: Sequence[str], phi: Sequence[Phi]
):
    """Write the word "continuum" out as the equality constraints it stands for.

    For a single output these are Lemma 4.1, ``y[k-1] + ... + y[k-n] = 1``. With several outputs the
    coefficients of the others sum to zero as well, so that each output can rest anywhere.

    Parameters
    ----------
    constraints : object
        A regressor's ``constraints``. The word may stand alone, in a list beside other texts, or in a mapping
        from outputs.
    library : TermLibrary
        Candidate terms.
    outputs, inputs : sequence of str
        Names of the signals.
    phi : sequence of Phi
        phi regressors, named.

    Returns
    -------
    object
        The constraints without the word; as they are where it does not occur.

    Raises
    ------
    ValueError
        If a candidate other than a linear output acts at rest, or an output has no linear candidate.

    Examples
    --------
    >>> from narx_sklearn.identification.structure.hysteresis import expand_continuum
    >>> from narx_sklearn.model import Difference, TermLibrary
    >>> library = TermLibrary(["y[k-1]", "y[k-2]", "phi1[k-1]"])
    >>> expand_continuum("continuum", library, ["y"], ["u"], [Difference("u", name="phi1")])
    ['y[k-1] + y[k-2] = 1']
    """
    if isinstance(constraints, str) and constraints == CONTINUUM and len(outputs) > 1:
        constraints = dict.fromkeys(outputs, CONTINUUM)
    if isinstance(constraints, Mapping):
        return {
            output: _written_out(given, output, library, outputs, inputs, phi)
            for output, given in constraints.items()
        }
    return _written_out(constraints, outputs[0], library, outputs, inputs, phi)


def _written_out(given, output: str, library, outputs, inputs, phi):
    texts = [given] if isinstance(given, str) else given
    if not _names_continuum(texts):
        return given
    resting = {str(p.name) for p in phi if not p.has_memory and vanishes_at_rest(p)}
    sums: dict[str, list[str]] = {name: [] for name in outputs}
    acting = []
    for term in library:
        if term.degree == 1 and (signal := term.variables[0].signal) in sums:
            sums[signal].append(str(term))
        elif not resting & term.signals:
            acting.append(str(term))
    if acting:
        shown = ", ".join(acting[:4]) + (", ..." if len(acting) > 4 else "")
        raise ValueError(
            f"constraints={CONTINUUM!r} needs candidates that are zero at rest, apart from linear outputs, "
            f"but {len(acting)} of {len(library)} are not: {shown}. Use structure='hysteresis' with "
            "phi regressors such as Difference and DifferenceSign; a phi with memory, which holds its value, "
            "cannot stand alone beside this constraint."
        )
    if not sums[output]:
        raise ValueError(
            f"constraints={CONTINUUM!r} needs a linear output among the candidates, but {output!r} has none; "
            "give output_lags of at least 1."
        )
    lemma = [f"{' + '.join(sums[output])} = 1"]
    lemma += [f"{' + '.join(terms)} = 0" for name, terms in sums.items() if terms and name != output]
    return lemma + [text for text in texts if text != CONTINUUM]


def _names_continuum(texts) -> bool:
    """Tell whether a list of constraints holds the word; (S, c) does not."""
    return isinstance(texts, list | tuple) and any(isinstance(t, str) and t == CONTINUUM for t in texts)


def asked_for_continuum(constraints) -> int:
    """Return for how many outputs the word "continuum" occurs in constraints; where it stands alone, 1."""
    given = list(constraints.values()) if isinstance(constraints, Mapping) else [constraints]
    return sum(_names_continuum([one] if isinstance(one, str) else one) for one in given)


@dataclass(frozen=True, eq=False)
class RestingDynamics:
    """Linear dynamics that a model has left when its inputs rest.

    Attributes
    ----------
    output_sums : ndarray of shape (n_outputs, n_outputs)
        Sums of the linear output coefficients, those of output j in equation i at [i, j].
    eigenvalues : ndarray of shape (n_eigenvalues,)
        Eigenvalues of the Jacobian at the operating point, complex, those nearest 1 first.
    n_free : int
        How many of them belong to the continuum of steady states and have to be 1.
    """

    output_sums: np.ndarray
    eigenvalues: np.ndarray
    n_free: int

    @property
    def other_radius(self) -> float:
        """Largest modulus of the eigenvalues that do not belong to the continuum."""
        return float(np.abs(self.eigenvalues[self.n_free :]).max(initial=0.0))

    @property
    def sum_error(self) -> float:
        """How far the ``n_free`` best rows of ``output_sums`` are from those of the identity."""
        rows = np.abs(self.output_sums - np.eye(len(self.output_sums))).max(axis=1)
        return float(np.sort(rows)[: self.n_free].max(initial=0.0))

    @property
    def holds(self) -> bool:
        """Whether Lemma 4.1 holds: the sums are 1 and the other eigenvalues inside the unit circle."""
        return self.sum_error <= SUM_TOLERANCE and self.other_radius < 1.0


def resting_dynamics(model: NARXModel, n_free: int | None = None) -> RestingDynamics:
    """Return the linear dynamics of a model whose inputs rest at the operating point.

    Parameters
    ----------
    model : NARXModel
        The model, whose terms are linear outputs or zero at rest.
    n_free : int, default=None
        Outputs that shall rest anywhere; None is all.

    Returns
    -------
    RestingDynamics

    Notes
    -----
    At rest differences and signs vanish, and so do the derivatives of their products with anything. What is
    left of the Jacobian are linear outputs, and linear first differences and smooth signs of outputs.

    References
    ----------
    Lacerda Junior (2021), Lemma 4.1 and Remark 4.1.

    Examples
    --------
    >>> from narx_sklearn.identification.structure.hysteresis import resting_dynamics
    >>> from narx_sklearn.model import Difference, NARXModel
    >>> model = NARXModel.from_equations(
    ...     "1.3*y[k-1] - 0.3*y[k-2] + 0.8*phi1[k-1]", phi=[Difference("u", name="phi1")])
    >>> rest = resting_dynamics(model)
    >>> rest.holds, round(rest.other_radius, 12)
    (True, 0.3)
    """
    n = len(model.outputs)
    steps: dict[str, tuple[tuple[str, int, float], ...]]  # what a variable is made of: signal, lag, weight
    steps = {output: ((output, 0, 1.0),) for output in model.outputs}
    steps |= {
        str(p.name): ((p.signal, 0, 1.0), (p.signal, 1, -1.0))
        for p in model.phi
        if isinstance(p, Difference) and p.signal in model.outputs
    }
    steps |= {
        str(p.name): ((p.signal, 0, 1.0 / p.width), (p.signal, 1, -1.0 / p.width))  # the slope of tanh at 0
        for p in model.phi
        if isinstance(p, SmoothSign) and p.signal in model.outputs
    }
    slopes = np.zeros((model.max_lag + 1, n, n))
    for term, row in zip(model.library, model.parameters, strict=True):
        if term.degree == 1:
            variable = term.variables[0]
            for signal, reach, weight in steps.get(variable.signal, ()):
                slopes[variable.lag + reach, :, model.outputs.index(signal)] += weight * row
    depth = int(np.flatnonzero(slopes.any(axis=(1, 2))).max(initial=1))  # longest lag of an output
    slopes = slopes[: depth + 1]
    companion = np.eye(n * depth, k=-n)
    companion[:n] = slopes[1:].transpose(1, 0, 2).reshape(n, -1)
    eigenvalues = np.linalg.eigvals(companion).astype(complex)
    nearest = np.argsort(np.abs(eigenvalues - 1.0), kind="stable")
    return RestingDynamics(slopes.sum(axis=0), eigenvalues[nearest], n if n_free is None else n_free)


def check_continuum(model: NARXModel, constraints) -> RestingDynamics | None:
    """Check Lemma 4.1 on a fitted model, where "continuum" was asked for.

    Parameters
    ----------
    model : NARXModel
        The fitted model.
    constraints : object
        The regressor's ``constraints``.

    Returns
    -------
    RestingDynamics or None
        None where the word does not occur.

    Warns
    -----
    NarxWarning
        If the lemma does not hold.
    """
    asked = asked_for_continuum(constraints)
    if not asked:
        return None
    n_free = asked if isinstance(constraints, Mapping) else len(model.outputs)
    rest = resting_dynamics(model, n_free)
    if not rest.holds:
        why = []
        if not rest.sum_error <= SUM_TOLERANCE:
            why.append(
                f"its linear output coefficients miss their sum by {rest.sum_error:.3g}, which must be 0"
            )
        if not rest.other_radius < 1.0:
            radius = f"{rest.other_radius:.6g}"
            why.append(f"besides the eigenvalue 1 the largest has modulus {radius}, which must be below 1")
        warnings.warn(
            f"The model has no stable continuum of steady states: {', and '.join(why)} "
            "(Lemma 4.1). It drifts or oscillates when the input stops. Try fewer output_lags, "
            "another sampling period, or refine=True.",
            NarxWarning,
            stacklevel=2,
        )
    return rest

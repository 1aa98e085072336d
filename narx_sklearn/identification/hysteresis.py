"""The structure "hysteresis": candidate terms of models that can rest at more than one output."""

from collections.abc import Sequence

import numpy as np

from narx_sklearn.identification.structure import STRUCTURES, Keep
from narx_sklearn.model.phi import AsymmetricSign, DifferenceSign, FunctionPhi, Phi, SmoothSign
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.terms import Term

__all__ = ["hysteresis_structure", "vanishes_at_rest"]

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
    >>> from narx_sklearn.identification.hysteresis import vanishes_at_rest
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
    >>> from narx_sklearn.identification.hysteresis import hysteresis_structure
    >>> from narx_sklearn.model import Difference, DifferenceSign, TermLibrary
    >>> phi = [Difference("u", name="phi1"), DifferenceSign("u", name="phi2")]
    >>> library = TermLibrary.polynomial(["y[k-1]", "u[k-1]", "phi1[k-1]", "phi2[k-1]"], degree=3)
    >>> kept = library.filter(hysteresis_structure(["y"], ["u"], phi))
    >>> len(library), len(kept)
    (35, 19)
    """
    output_names = set(outputs)
    moving = {str(p.name) for p in phi if p.has_memory or vanishes_at_rest(p)}
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


STRUCTURES["hysteresis"] = hysteresis_structure

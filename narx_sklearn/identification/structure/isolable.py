"""The structure "isolable": candidate terms from whose model the newest input can be isolated."""

from collections.abc import Sequence

from narx_sklearn.identification.structure.candidates import STRUCTURES, Keep
from narx_sklearn.identification.structure.hysteresis import hysteresis_structure
from narx_sklearn.model.phi import Difference, Phi
from narx_sklearn.model.terms import Term

__all__ = ["isolable_structure"]


def isolable_structure(
    outputs: Sequence[str], inputs: Sequence[str], phi: Sequence[Phi], *, delay: int = 1
) -> Keep:
    r"""Return the filter of terms that leaves the newest input :math:`u_{k-\tau_d}` in one linear term.

    Without phi regressors of the input that term is the input itself (Assumption 4.3). With them the
    system is taken to have hysteresis: the term is the input's first difference, and the terms left must
    also be those of `hysteresis_structure` (Assumption 4.4). The model then gives its input in closed form
    (4.23).

    Parameters
    ----------
    outputs, inputs : sequence of str
        Names of the signals; the first input is the one to be isolated.
    phi : sequence of Phi
        phi regressors, named.
    delay : int, default=1
        Delay :math:`\tau_d` of the input in samples, the lag that counts as newest.

    Returns
    -------
    callable
        Takes a `Term`, returns whether it may be a candidate.

    Notes
    -----
    By name, ``structure="isolable"``, the delay is 1. For a longer one pass the function itself:
    ``structure=isolable_structure(["y"], ["u"], phi, delay=2)``. The candidates need input lags beyond the
    delay (Assumption 4.3 (ii)), and the linear term must be among those selected, which the error
    reduction ratio sees to in any system that answers to its newest input.

    References
    ----------
    Lacerda Junior (2021), Assumptions 4.3 and 4.4, eq. (4.23).

    Examples
    --------
    >>> from narx_sklearn.identification.structure.isolable import isolable_structure
    >>> from narx_sklearn.model import TermLibrary
    >>> library = TermLibrary.polynomial(["y[k-1]", "u[k-1]", "u[k-2]"], degree=2)
    >>> print(library.filter(isolable_structure(["y"], ["u"], [])))
    1, y[k-1], u[k-1], u[k-2], y[k-1]^2, y[k-1]*u[k-2], u[k-2]^2
    """
    name = inputs[0] if inputs else ""
    of_input = {str(p.name) for p in phi if name in p.signals}
    differences = {str(p.name) for p in phi if isinstance(p, Difference) and p.signal == name}
    allowed = hysteresis_structure(outputs, inputs, phi) if of_input else lambda term: True
    linear = differences if of_input else {name}

    def keep(term: Term) -> bool:
        if not allowed(term):
            return False
        newest = [v for v in term.variables if v.lag <= delay and (v.signal == name or v.signal in of_input)]
        return not newest or (term.degree == 1 and newest[0].signal in linear)

    return keep


STRUCTURES["isolable"] = isolable_structure

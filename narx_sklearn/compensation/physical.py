"""Compensators from models of hysteresis itself: Prandtl-Ishlinskii inverse, Bouc-Wen multiplicative."""

from typing import Any

import numpy as np
from sklearn.base import clone

from narx_sklearn._validation import as_signals
from narx_sklearn.compensation._base import Compensator
from narx_sklearn.compensation.law import INPUT, REFERENCE, BoucWenElement, CompensationLaw
from narx_sklearn.model.phi import Play
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.physics.boucwen import BoucWenModel
from narx_sklearn.physics.boucwen_estimator import BoucWen
from narx_sklearn.physics.prandtl_ishlinskii import PrandtlIshlinskii, PrandtlIshlinskiiOperator

__all__ = ["BoucWenCompensator", "PrandtlIshlinskiiCompensator"]


class _HysteresisCompensator(Compensator):
    """What compensators from models of hysteresis share."""

    keep_rest = False

    def __init__(self, model=None, *, limits=None, rate_limit=None, rehearsed=True):
        self.model = model
        self.limits = limits
        self.rate_limit = rate_limit
        self.rehearsed = rehearsed

    def _way_out(self) -> str:
        return "The hysteresis may be of another kind, or not all there is: try RootCompensator."


class PrandtlIshlinskiiCompensator(_HysteresisCompensator):
    """Compensate with the analytic inverse of a Prandtl-Ishlinskii operator.

    ``m[k] = c + sum_j w_j P_j(r[k])``: weighted plays of the reference, exact for hysteresis whose minor
    loops are congruent.

    Parameters
    ----------
    model : PrandtlIshlinskiiOperator, PrandtlIshlinskii or None, default=None
        An operator that is known, or an estimator of one; None estimates ten plays with a positive slope.
    limits : (float, float) or None, default=None
        Least and largest input the machine takes, in its unit. None takes the range of the recorded input,
        beyond which nothing is known; no limits where a model is given.
    rate_limit : float or None, default=None
        Largest change of the input in one sample.
    rehearsed : bool, default=True
        Whether ``fit`` rehearses the law on a model of the machine and warns where a straight line of the
        reference does better; where another model has to be identified for it, this takes about a second.

    Attributes
    ----------
    model_ : PrandtlIshlinskiiOperator
        The operator; its inverse is the law.
    law_ : CompensationLaw
        The law; it reads the present reference.
    rehearsal_ : Rehearsal or None
        How the law did on a NARX model of the machine, beside a straight line of the reference. None without
        a record, or where ``rehearsed`` is false. ``str`` tells.
    n_features_in_ : int
        Number of inputs in the record, if there was one.

    References
    ----------
    Kuhnen (2003), European Journal of Control 9, 407-418.

    Examples
    --------
    >>> from narx_sklearn.compensation import PrandtlIshlinskiiCompensator
    >>> from narx_sklearn.physics import PrandtlIshlinskiiOperator
    >>> operator = PrandtlIshlinskiiOperator(radii=(0, 0.8, 1.7), weights=(5.88, 1.58, 0.47))
    >>> compensator = PrandtlIshlinskiiCompensator(operator).fit()
    >>> operator.run(compensator.predict([0.0, 4.0, -2.0, 1.0])).round(9).tolist()
    [0.0, 4.0, -2.0, 1.0]
    """

    def _identify_law(self, X, y, sessions):
        if isinstance(self.model, PrandtlIshlinskiiOperator):
            operator = self.model
        else:
            u, y = _record(X, y, sessions, "a PrandtlIshlinskiiOperator")
            default = PrandtlIshlinskii(min_slope=1e-3 * y.std() / (u.std() or 1.0))
            operator = (default if self.model is None else clone(self.model)).fit(u, y).operator_
        self.model_: Any = operator
        inverse = operator.inverse()
        # the plays see r itself: play j of (r - offset) is play j of r, less the offset
        elements, parts, states = [], [Polynomial.constant(inverse.output_offset)], {}
        initial = np.zeros(len(inverse.radii)) if inverse.initial_state is None else inverse.initial_state
        for j, (radius, weight) in enumerate(zip(inverse.radii, inverse.weights, strict=True)):
            if radius == 0.0:
                parts.append(weight * (Polynomial.variable(f"{REFERENCE}[k]") - inverse.input_offset))
                continue
            name = f"p{j}"
            elements.append(Play(REFERENCE, radius=radius, name=name))
            parts.append(weight * (Polynomial.variable(f"{name}[k]") - inverse.input_offset))
            states[name] = initial[j] + inverse.input_offset
        return CompensationLaw(
            "explicit", (sum(parts, Polynomial()),), tuple(elements), initial_states=states
        )


class BoucWenCompensator(_HysteresisCompensator):
    r"""Compensate with a Bouc-Wen model in a multiplicative-inverse structure.

    The output equation :math:`y = d\,u + g\,h + c` is solved for the input outside the hysteresis,
    with the h of the sample before: :math:`m_k = (r_k - g\,h_{k-1} - c) / d`. No inverse of the hysteresis is
    computed; the price is that one sample.

    Parameters
    ----------
    model : BoucWenModel, BoucWen or None, default=None
        A model that is known, or an estimator of one; None estimates it.
    limits : (float, float) or None, default=None
        Least and largest input the machine takes, in its unit. None takes the range of the recorded input,
        beyond which nothing is known; no limits where a model is given.
    rate_limit : float or None, default=None
        Largest change of the input in one sample.
    rehearsed : bool, default=True
        Whether ``fit`` rehearses the law on a model of the machine and warns where a straight line of the
        reference does better; where another model has to be identified for it, this takes about a second.

    Attributes
    ----------
    model_ : BoucWenModel
        The model.
    law_ : CompensationLaw
        The law; it reads the present reference.
    rehearsal_ : Rehearsal or None
        How the law did on a NARX model of the machine, beside a straight line of the reference. None without
        a record, or where ``rehearsed`` is false. ``str`` tells.
    n_features_in_ : int
        Number of inputs in the record, if there was one.

    References
    ----------
    Rakotondrabe (2011), IEEE Transactions on Automation Science and Engineering 8(2), 428-431.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.compensation import BoucWenCompensator
    >>> from narx_sklearn.metrics import mape
    >>> from narx_sklearn.physics import PIEZO_BENCH
    >>> r = 40 * np.sin(2 * np.pi * np.arange(2000) / 1000)
    >>> m = BoucWenCompensator(PIEZO_BENCH).fit().predict(r)
    >>> round(mape(r, PIEZO_BENCH.run(m)), 2)
    0.17
    """

    def _identify_law(self, X, y, sessions):
        if isinstance(self.model, BoucWenModel):
            bw = self.model
        else:
            u, y = _record(X, y, sessions, "a BoucWenModel")
            regressor = BoucWen(random_state=0) if self.model is None else clone(self.model)
            bw = regressor.fit(u, y).model_
        self.model_: Any = bw
        if bw.input_gain == 0.0:
            raise ValueError(
                "The Bouc-Wen model has input_gain 0: no part of the input stands outside the hysteresis, "
                "so the multiplicative inverse does not exist. Use RootCompensator or "
                "PrandtlIshlinskiiCompensator."
            )
        equation = (1.0 / bw.input_gain) * Polynomial(
            {f"{REFERENCE}[k]": 1.0, "h[k-1]": -bw.hysteresis_gain, "1": -bw.offset}
        )
        element = BoucWenElement(INPUT, bw.A, bw.beta, bw.gamma, bw.n)
        return CompensationLaw("explicit", (equation,), (element,))

    def _first_input(self, known):
        return 0.0  # h counts from an input that never moved


def _record(X, y, sessions, kind: str):
    """Return a record as arrays, refusing what estimators of hysteresis cannot take."""
    if X is None or y is None:
        raise ValueError(f"fit needs the record X and y, or the compensator a model={kind} that is known.")
    if sessions is not None:
        raise ValueError(
            "Hysteresis is estimated from one recording; leave sessions out and pass one at a time."
        )
    return as_signals(X, "X"), as_signals(y, "y")[:, 0]

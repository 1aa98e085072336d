"""IsolatedCompensator: the input in closed form (thesis section 4.5)."""

from collections.abc import Mapping
from typing import Any

from sklearn.base import clone

from narx_sklearn.compensation._base import Compensator
from narx_sklearn.compensation._defaults import isolable_regressors
from narx_sklearn.compensation.derive import isolated_law, smooth_signs
from narx_sklearn.identification.structure.constraints import parse_constraints
from narx_sklearn.identification.structure.hysteresis import expand_continuum
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.terms import Term, TermLibrary

__all__ = ["IsolatedCompensator"]


class IsolatedCompensator(Compensator):
    r"""Compensate with the input isolated from the model's equation.

    Where the newest input occurs in one linear term, :math:`b\,u_{k-\tau_d}`, the model gives

    .. math:: m_k = \tfrac{1}{b} \left[ A(q) r_{k+\tau_d} - B^*(q) m_{k+\tau_d} - f(\cdot) \right]

    in closed form: one expression, always one solution. The price is a model that answers to all else one
    sample later, and a recursion in the input that may amplify its errors, of which `fit` warns.

    Parameters
    ----------
    model : NARXModel, estimator, list of estimators or None, default=None
        A model that is known; or an estimator with ``model_`` after fit, with ``structure="isolable"``, or
        several. None identifies some of third degree, with hysteresis and without. Of several one is taken as
        `RootCompensator` does.
    limits : (float, float) or None, default=None
        Least and largest input the machine takes, in its unit. None takes the range of the recorded input,
        beyond which nothing is known: that of the record, or the one that the model given keeps
        (``model.recorded``). No limits where neither tells.
    rate_limit : float or None, default=None
        Largest change of the input in one sample.
    keep_rest : bool, default=True
        Keep the input while the reference does not move, if the model can rest anywhere.
    smooth_width : float or None, default=None
        Replace signs of differences by ``tanh(difference / smooth_width)``, in the unit of the input.
    input_name : str or None, default=None
        The input to compensate with; None is the first.
    rehearsed : bool, default=True
        Whether ``fit`` rehearses the law on a model of the machine and warns where a straight line of the
        reference does better; where another model has to be identified for it, this takes about a second.

    Attributes
    ----------
    model_ : NARXModel
        The model.
    regressor_ : estimator
        That it was identified with, fitted; there is none where the model was given.
    law_ : CompensationLaw
        The law (4.23); ``law_.horizon`` is the delay of the model. Its input is ``m``, its reference
        ``r``; a signal of the model's that is called so, and is neither, gets an underscore.
    rehearsal_ : Rehearsal or None
        How the law did on its model, beside a straight line of the reference; ``str`` tells. Where the line
        gives the recorded input back better than the law, another model is identified and driven instead.
        None where ``rehearsed`` is false.
    n_features_in_ : int
        Number of inputs in the record, if there was one.

    See Also
    --------
    RootCompensator : For models of any structure.
    law_stability : Whether the recursion amplifies errors.

    Notes
    -----
    The law divides by the parameter of the newest input's linear term. Where the record is short or hardly
    excited, selection may leave that term out; it is then added to the terms selected, and all are estimated
    again.

    References
    ----------
    Lacerda Junior (2021), section 4.5, Assumptions 4.3 and 4.4, eq. (4.23).

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.compensation import IsolatedCompensator
    >>> from narx_sklearn.model import NARXModel
    >>> model = NARXModel.from_equations("0.8*y[k-1] + 2*u[k-1] - 0.5*u[k-2]*y[k-1]")
    >>> compensator = IsolatedCompensator(model).fit()
    >>> compensator.predict([0.0, 1.0, 1.0]).round(9).tolist()
    [0.5, 0.225, 0.15625]
    """

    def __init__(
        self,
        model=None,
        *,
        limits=None,
        rate_limit=None,
        keep_rest=True,
        smooth_width=None,
        input_name=None,
        rehearsed=True,
    ):
        self.model = model
        self.limits = limits
        self.rate_limit = rate_limit
        self.keep_rest = keep_rest
        self.smooth_width = smooth_width
        self.input_name = input_name
        self.rehearsed = rehearsed

    _default_regressors = staticmethod(isolable_regressors)

    def _derive(self, model):
        return isolated_law(smooth_signs(model, self.smooth_width), input_name=self.input_name)

    def _model_of(self, regressor, X, y, sessions) -> NARXModel:
        return _with_newest_input(regressor, self.input_name, X, y, sessions)


def _with_newest_input(regressor: Any, input_name: str | None, X, y, sessions) -> NARXModel:
    """Return a fitted estimator's model, with the newest input's linear term where selection lost it."""
    regressor = getattr(regressor, "best_estimator_", regressor)
    model = regressor.model_
    candidates = getattr(regressor, "candidates_", None)
    if candidates is None or not model.inputs:
        return model
    needed = _newest_linear_term(model, candidates, input_name or model.inputs[0])
    if needed is None or needed in model.library:
        return model
    terms = {*model.library, needed}
    again = clone(regressor).set_params(
        structure=terms.__contains__, n_terms=len(terms), constraints=_on_terms(terms, regressor)
    )
    options = {} if sessions is None else {"sessions": sessions}
    return again.fit(X, y, **options).model_


def _on_terms(terms: set[Term], regressor: Any):
    """Return a fitted estimator's constraints as (S, c) on some of its candidates, all others being zero."""
    model, candidates = regressor.model_, regressor.candidates_
    given = getattr(regressor, "constraints", None)
    given = expand_continuum(given, candidates, model.outputs, model.inputs, model.phi)
    if isinstance(given, Mapping):
        given = given.get(model.outputs[0])
    kept = [i for i, term in enumerate(candidates) if term in terms]
    held = parse_constraints(given, candidates).restrict(kept)
    return (held.S, held.c) if len(held) else None


def _newest_linear_term(model: NARXModel, candidates: TermLibrary, name: str) -> Term | None:
    """Return the only candidate that reads the newest input, if it is linear."""
    of_input = {name, *(p.name for p in model.phi if name in p.signals)}
    lags = [v.lag for term in candidates for v in term.variables if v.signal in of_input]
    fresh = [t for t in candidates if any(v.signal in of_input and v.lag == min(lags) for v in t.variables)]
    return fresh[0] if len(fresh) == 1 and fresh[0].degree == 1 else None

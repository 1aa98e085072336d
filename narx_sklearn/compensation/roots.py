"""RootCompensator: the input as a root of the model's own equation (thesis section 4.4)."""

from narx_sklearn.compensation._base import Compensator
from narx_sklearn.compensation._defaults import direct_regressors
from narx_sklearn.compensation.derive import root_law, smooth_signs

__all__ = ["RootCompensator"]


class RootCompensator(Compensator):
    r"""Compensate by solving the model's equation for its input at every sample.

    In the model :math:`y_k = F(y_{k-1}, \dots, u_{k-\tau_d}, \dots)` the output is replaced by the reference
    and the newest input by the unknown :math:`m_k`. What is left is a polynomial in it, one for loading
    and one for unloading where the model has hysteresis; of its admissible real roots the one nearest to the
    last input is taken. Models with smooth signs, plays or memory are searched instead. Any `NARXModel` with
    one output serves; nothing has to be observed when it is identified.

    Parameters
    ----------
    model : NARXModel, estimator, list of estimators or None, default=None
        A model that is known; or an estimator with ``model_`` after fit, such as `NARXRegressor`, that
        identifies it. Of several the one counts that has the best free run of those whose law gives the
        recorded input back. None identifies models of third degree, some that can rest anywhere and some
        without hysteresis, and chooses among them in that way.
    limits : (float, float) or None, default=None
        Least and largest input the machine takes, in its unit. None takes the range of the recorded input,
        beyond which nothing is known: that of the record, or the one that the model given keeps
        (``model.recorded``). No limits where neither tells.
    rate_limit : float or None, default=None
        Largest change of the input in one sample.
    policy : {"hold", "nearest"}, default="hold"
        Where no root is admissible: keep the last input (Definitions 4.1 and 4.2), or take the admissible
        input whose model output comes nearest to the reference.
    branch : {"nearest", "rising", "falling"}, default="nearest"
        Which admissible root is taken: the nearest to the last input (Definitions 4.1 and 4.2). Or, for a
        machine whose output rises (falls) with its input, the nearest that moves the input up (down) where
        the input held leaves the output too low, and the other way where too high; of the others only where
        there is none such. A model fitted to hysteresis may rise in one part of its loop and fall in
        another; the nearest root then changes sides from sample to sample and the input chatters.
    keep_rest : bool, default=True
        Keep the input while the reference does not move, if the model can rest anywhere.
    smooth_width : float or None, default=None
        Replace signs of differences by ``tanh(difference / smooth_width)``, in the unit of the input. Softens
        abrupt transitions at reversals.
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
        The law; ``law_.horizon`` is how many samples ahead it reads the reference. Its input is ``m``, its
        reference ``r``; a signal of the model's that is called so, and is neither, gets an underscore.
    rehearsal_ : Rehearsal or None
        How the law did on its model, beside a straight line of the reference; ``str`` tells. Where the line
        gives the recorded input back better than the law, another model is identified and driven instead.
        None where ``rehearsed`` is false.
    n_features_in_ : int
        Number of inputs in the record, if there was one.

    See Also
    --------
    IsolatedCompensator : The input in closed form, from a model of suitable structure.
    InverseCompensator : The input from a model of the inverse relationship.
    root_polynomials : The polynomials' coefficients as in the thesis.

    Notes
    -----
    Polynomials are solved in the move :math:`m_k - m_{k-1}`, which keeps the digits that large powers of
    :math:`m_k` would cancel. Thesis and class agree in exact arithmetic.

    References
    ----------
    Lacerda Junior (2021), section 4.4, Definitions 4.1 and 4.2; Tavares et al. (2022).

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.compensation import RootCompensator
    >>> from narx_sklearn.model import NARXModel, free_run
    >>> model = NARXModel.from_equations("0.8*y[k-1] + u[k-1] + 0.1*u[k-1]^3")
    >>> r = np.sin(np.arange(100) / 10)
    >>> m = RootCompensator(model).fit().predict(r)
    >>> y = free_run(model, m, y_init=r).y[:, 0]
    >>> bool(np.abs(y - r).max() < 1e-12)
    True
    """

    def __init__(
        self,
        model=None,
        *,
        limits=None,
        rate_limit=None,
        policy="hold",
        branch="nearest",
        keep_rest=True,
        smooth_width=None,
        input_name=None,
        rehearsed=True,
    ):
        self.model = model
        self.limits = limits
        self.rate_limit = rate_limit
        self.policy = policy
        self.branch = branch
        self.keep_rest = keep_rest
        self.smooth_width = smooth_width
        self.input_name = input_name
        self.rehearsed = rehearsed

    _default_regressors = staticmethod(direct_regressors)

    def _derive(self, model):
        law = root_law(smooth_signs(model, self.smooth_width), input_name=self.input_name)
        if law.method == "search" and self.branch != "nearest":
            raise ValueError(
                f"branch={self.branch!r} chooses among roots of a polynomial, but the law of this model "
                "is searched (smooth signs, plays or memory). Use branch='nearest'."
            )
        return law

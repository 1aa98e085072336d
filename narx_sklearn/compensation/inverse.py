"""InverseCompensator: a model of the inverse relationship as the compensator (thesis section 4.6)."""

from dataclasses import replace
from numbers import Integral

import numpy as np
import pandas as pd
from scipy.signal import savgol_filter

from narx_sklearn._validation import as_signals, column_labels, session_slices, signal_names
from narx_sklearn.compensation._base import Compensator
from narx_sklearn.compensation._defaults import direct_regressors, inverse_regressors
from narx_sklearn.compensation.choosing import (
    best_of,
    fitted_regressor,
    free_run_criterion,
    recorded_range,
)
from narx_sklearn.compensation.derive import inverse_law, smooth_signs
from narx_sklearn.compensation.rehearsal import Rehearsal
from narx_sklearn.compensation.rehearsing import machine_for_rehearsal, rehearse_on_record
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.simulation import free_run

__all__ = ["InverseCompensator", "smooth_output"]

# of the input's deviation: inverse models that err less differ by how they fit the record's own speeds, and
# those with more lags amplify other ones
ALIKE = 0.05


def smooth_output(y, window: int, *, sessions=None) -> np.ndarray:
    """Smooth a measured output by a quadratic fitted to the samples round each one.

    The filter is symmetric, so it delays nothing; it takes noise out of a signal that is about to serve as an
    input, where noise would bias the parameters.

    Parameters
    ----------
    y : array-like of shape (n_samples,)
        Measured output, without gaps.
    window : int
        Samples of each fit, odd and at least 5.
    sessions : array-like of shape (n_samples,), default=None
        One label a sample; no fit reaches across a change.

    Returns
    -------
    ndarray of shape (n_samples,)

    Raises
    ------
    ValueError
        If the window is even, too short, or longer than a recording.

    References
    ----------
    Savitzky and Golay (1964), Analytical Chemistry 36, 1627-1639.

    Examples
    --------
    >>> from narx_sklearn.compensation import smooth_output
    >>> smooth_output([0.0, 1.0, 4.0, 9.0, 16.0, 25.0], 5).round(9).tolist()
    [0.0, 1.0, 4.0, 9.0, 16.0, 25.0]
    """
    y = as_signals(y, "y")[:, 0]
    if not isinstance(window, Integral) or isinstance(window, bool) or window < 5 or window % 2 == 0:
        raise ValueError(f"window must be an odd integer of at least 5, got {window!r}.")
    smooth = np.empty(y.size)
    for piece in session_slices(sessions, y.size):
        if piece.stop - piece.start < window:
            raise ValueError(
                f"A recording of {piece.stop - piece.start} samples is shorter than the window of {window}."
            )
        smooth[piece] = savgol_filter(y[piece], int(window), 2)
    return smooth


class InverseCompensator(Compensator):
    r"""Compensate with a model identified for the inverse relationship.

    .. math:: m_k = \check F(m_{k-1}, \dots, r_{k-1+\tau_s}, \dots)

    The model is fitted with the machine's output as its input, moved :math:`\tau_s` samples ahead. In the
    model and in ``phi`` the machine's output keeps its name, and ``y[k-1]`` is its sample
    ``k - 1 + lead``.

    Parameters
    ----------
    model : NARXModel, estimator or None, default=None
        A known inverse model: its output is the machine's input, its input the machine's output. Or an
        estimator with ``model_`` after fit, such as `NARXRegressor`. None identifies several of third
        degree, with hysteresis and without, and a direct model of the machine, on which it takes the law
        that tracks the record's output, slowed and made smaller, best.
    lead : int, default=2
        :math:`\tau_s`, at least the delay of the machine plus 1.
    denoise : None, int, "model" or estimator, default=None
        Noise on the output would be noise on the inverse model's input and bias its parameters. An odd
        integer smooths it by quadratics over so many samples (`smooth_output`); ``"model"``, or an estimator
        of the direct relationship, replaces it by the free run of a direct model, which the input alone
        drives: the first stage of two-stage least squares, so that noise of any colour does not enter.
        ``"model"`` takes the best of those that `RootCompensator` identifies.
    limits : (float, float) or None, default=None
        Least and largest input the machine takes, in its unit. None takes the range of the recorded input,
        beyond which nothing is known: that of the record, or the one that the model given keeps
        (``model.recorded``). No limits where neither tells.
    rate_limit : float or None, default=None
        Largest change of the input in one sample.
    keep_rest : bool, default=True
        Keep the input while the reference does not move, if the model can rest anywhere.
    smooth_width : float or None, default=None
        Replace signs of differences by ``tanh(difference / smooth_width)``, in the unit of the reference.
    rehearsed : bool, default=True
        Whether ``fit`` rehearses the law on a model of the machine and warns where a straight line of the
        reference does better; where another model has to be identified for it, this takes about a second.

    Attributes
    ----------
    model_ : NARXModel
        The inverse model.
    direct_model_ : NARXModel or None
        The direct model that denoised the output, if one did.
    law_ : CompensationLaw
        The law (4.29); ``law_.horizon`` is ``lead - 1`` for a model that reads the output from lag 1 on.
    rehearsal_ : Rehearsal or None
        How the law did on a model of the machine (``direct_model_``, or one identified for it), beside a
        straight line of the reference. None without a record, or where ``rehearsed`` is false. ``str`` tells.
    n_features_in_ : int
        Number of inputs in the record, if there was one.

    See Also
    --------
    RootCompensator : From a direct model.

    References
    ----------
    Lacerda Junior (2021), section 4.6, Assumption 4.5, eqs. (4.28) and (4.29); for two-stage least squares
    Soderstrom and Stoica (1983), Instrumental Variable Methods for System Identification.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn import NARXRegressor
    >>> from narx_sklearn.compensation import InverseCompensator
    >>> rng = np.random.default_rng(0)
    >>> u = rng.normal(size=500)
    >>> y = np.append(0.0, u[:-1])  # a machine that delays by one sample
    >>> for k in range(1, 500):
    ...     y[k] += 0.5 * y[k - 1]
    >>> compensator = InverseCompensator(NARXRegressor(1, 2)).fit(u.reshape(-1, 1), y)
    >>> print(compensator.law_.equations[0])
    r[k+1] - 0.5*r[k]
    """

    def __init__(
        self,
        model=None,
        *,
        lead=2,
        denoise=None,
        limits=None,
        rate_limit=None,
        keep_rest=True,
        smooth_width=None,
        rehearsed=True,
    ):
        self.model = model
        self.lead = lead
        self.denoise = denoise
        self.limits = limits
        self.rate_limit = rate_limit
        self.keep_rest = keep_rest
        self.smooth_width = smooth_width
        self.rehearsed = rehearsed

    def _identify_law(self, X, y, sessions):
        if not isinstance(self.lead, Integral) or isinstance(self.lead, bool) or self.lead < 1:
            raise ValueError(
                f"lead must be an integer of at least 1 (the machine's delay plus 1), got {self.lead!r}."
            )
        self.direct_model_ = self._machine = None
        if isinstance(self.model, NARXModel):
            self.model_ = self.model
        elif X is None or y is None:
            fitted_regressor(self.model, None, None, None)  # says what is missing
        else:
            swapped = self._swap(X, y, sessions)
            self._machine = self.direct_model_
            if self.model is None:
                if self._machine is None:
                    self._machine = machine_for_rehearsal(X, y, sessions, regressors=direct_regressors)
                self.model_ = self._best_inverse(as_signals(X, "X"), as_signals(y, "y"), sessions, swapped)
            else:
                self.model_ = fitted_regressor(self.model, *swapped).model_
        return self._derive(self.model_)

    def _followed(self) -> str:
        return self.model_.inputs[0]

    def _driving(self) -> str:
        return self.model_.outputs[0]

    def _derive(self, model):
        return inverse_law(smooth_signs(model, self.smooth_width), int(self.lead))

    def _best_inverse(self, u, y, sessions, swapped) -> NARXModel:
        """Return, of several inverse models, the one whose law drives a direct model best.

        The free run of an inverse model is its law on the record's own output, which says little of what it
        makes of other references: the criterion of that run decides only among laws that track alike, and
        where there is no direct model to be asked.
        """
        output, inputs = as_signals(swapped[0], "X"), as_signals(swapped[1], "y")
        applied = recorded_range(u)

        def judge(model):
            self._derive(model)  # raises where there is no law
            return free_run_criterion(model, output, inputs, swapped[2], alike=ALIKE)[0]

        def compare(models, criteria):
            if self._machine is None:
                return criteria
            laws = [replace(self._derive(model), limits=applied) for model in models]
            left = [Rehearsal.of(law, self._machine, u, y, sessions).left for law in laws]
            if np.isnan(left).any():  # nothing could be rehearsed
                return criteria
            # a law that runs away by itself, held by the limits alone, comes last whatever it tracks
            return [(np.isinf(c), max(e, ALIKE), c) for e, c in zip(left, criteria, strict=True)]

        return best_of(
            inverse_regressors(swapped[0], swapped[1], None),
            lambda regressor: fitted_regressor(regressor, *swapped).model_,
            judge,
            compare,
        )

    def _rehearse(self, X, y, sessions):
        """Rehearse the law on a model of the machine itself, where there is a record to identify it from."""
        return None if X is None else rehearse_on_record(self.law_, X, y, sessions, other=self._machine)

    def _way_out(self) -> str:
        return (
            f"Use RootCompensator, or a longer lead than {self.lead}"
            f"{'' if self.model is None else ', or a model with other lags or fewer terms'}."
        )

    def _swap(self, X, y, sessions):
        """Return the machine's output moved ahead as a frame, its input as a series, and sessions."""
        u = as_signals(X, "X")
        if u.shape[1] != 1:
            labels = column_labels(X)
            raise ValueError(
                f"X has {u.shape[1]} columns{'' if labels is None else f', {labels}'}, but the inverse model "
                "of a machine gives one input. Pass the column of the input that the law is to give; where "
                "the others act too, use RootCompensator(input_name=...) or "
                "IsolatedCompensator(input_name=...), which take them as known."
            )
        u_label = (column_labels(X) or ["u"])[0]
        y_label = (column_labels(y) or ["y"])[0]
        names = [
            label if isinstance(label, str) else letter for label, letter in ((u_label, "u"), (y_label, "y"))
        ]
        signal_names(names, "u")  # refuses names that coincide
        output = self._denoised(X, y, sessions)
        ahead, inputs, labels = [], [], []
        for i, piece in enumerate(session_slices(sessions, u.shape[0])):
            keep = max(piece.stop - piece.start - int(self.lead), 0)
            ahead.append(output[piece.start + int(self.lead) : piece.start + int(self.lead) + keep])
            inputs.append(u[piece.start : piece.start + keep, 0])
            labels.append(np.full(keep, i))
        frame = pd.DataFrame({names[1]: np.concatenate(ahead)})
        series = pd.Series(np.concatenate(inputs), name=names[0])
        return frame, series, None if sessions is None else np.concatenate(labels)

    def _denoised(self, X, y, sessions) -> np.ndarray:
        if self.denoise is None:
            return as_signals(y, "y")[:, 0]
        if isinstance(self.denoise, Integral) and not isinstance(self.denoise, bool):
            return smooth_output(y, int(self.denoise), sessions=sessions)
        if self.denoise == "model":
            self.direct_model_ = best_of(
                direct_regressors(X, y, None),
                lambda regressor: fitted_regressor(regressor, X, y, sessions).model_,
                lambda model: free_run_criterion(model, as_signals(X, "X"), as_signals(y, "y"), sessions)[0],
            )
        elif hasattr(self.denoise, "fit"):
            self.direct_model_ = fitted_regressor(self.denoise, X, y, sessions).model_
        else:
            raise ValueError(
                f"denoise must be None, an odd window, 'model' or an estimator, got {self.denoise!r}."
            )
        return free_run(self.direct_model_, as_signals(X, "X"), as_signals(y, "y"), sessions=sessions).y[:, 0]

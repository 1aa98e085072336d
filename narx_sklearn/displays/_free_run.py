"""Figure of a free run: measured and simulated output, and their difference."""

import numpy as np
import pandas as pd

from narx_sklearn._validation import as_signals, session_slices
from narx_sklearn.analysis._checks import unit_label
from narx_sklearn.displays._style import GREY, VERMILION, legend_above, stacked_axes, time_of
from narx_sklearn.metrics import nrmse


class FreeRunDisplay:
    """Free run of a model over the measurement, with the error below.

    Use :meth:`from_estimator` or :meth:`from_predictions`; the constructor takes finished signals.

    Parameters
    ----------
    y_true, y_pred : ndarray of shape (n_samples,)
        Measured and simulated output; NaN where there is none.
    is_initial : ndarray of bool, shape (n_samples,), default=None
        Samples that were the initial condition: shaded and not scored. None for none.
    sampling_period : float, default=None
        Seconds between samples; None draws over samples.
    label : str, default="output"
        Quantity and unit of the vertical axis.

    Attributes
    ----------
    figure_ : matplotlib Figure
        The figure drawn in; exists after :meth:`plot`.
    axes_ : tuple of 2 matplotlib Axes
        Outputs, error.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.displays import FreeRunDisplay
    >>> display = FreeRunDisplay(np.array([0.0, 1.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.5, -1.0]))
    >>> round(display.nrmse_, 4)
    0.3536
    """

    def __init__(self, y_true, y_pred, is_initial=None, *, sampling_period=None, label="output"):
        self.y_true = y_true
        self.y_pred = y_pred
        self.is_initial = is_initial
        self.sampling_period = sampling_period
        self.label = label

    @classmethod
    def from_estimator(cls, estimator, X, y, *, sessions=None, output=0, ax=None):
        """Run the model freely from the first samples of each session, and draw.

        Parameters
        ----------
        estimator : NARXRegressor or NARXRegressorCV
            Fitted.
        X : array-like of shape (n_samples, n_inputs)
            Inputs.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Measured outputs; the run reads the first ``model_.max_lag`` of each session.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample.
        output : int, default=0
            Column of ``y`` to draw, counted from 0.
        ax : sequence of 2 matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        display : FreeRunDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        TypeError
            If the estimator holds no ``model_``.
        ValueError
            If ``y`` has no column ``output``.
        """
        model = getattr(estimator, "model_", None)
        if model is None:
            raise TypeError(
                f"{type(estimator).__name__} has no model_, so that its initial condition is not known. "
                "Fit it, or use FreeRunDisplay.from_predictions(y_true, y_pred)."
            )
        measured = as_signals(y, "y")
        if not 0 <= output < measured.shape[1]:
            raise ValueError(f"output is {output!r}, but y has {measured.shape[1]} columns, counted from 0.")
        routed = {} if sessions is None else {"sessions": sessions}
        simulated = as_signals(estimator.predict(X, y_init=y, **routed), "prediction")
        return cls.from_predictions(
            measured[:, output],
            simulated[:, output],
            sessions=sessions,
            n_init=model.max_lag,
            sampling_period=model.sampling_period,
            label=unit_label(model, model.outputs[output]),
            ax=ax,
        )

    @classmethod
    def from_predictions(
        cls, y_true, y_pred, *, sessions=None, n_init=0, sampling_period=None, label="output", ax=None
    ):
        """Draw a simulation over the measurement.

        Parameters
        ----------
        y_true, y_pred : array-like of shape (n_samples,)
            Measured and simulated output.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample.
        n_init : int, default=0
            First samples of each session that were the initial condition.
        sampling_period : float, default=None
            Seconds between samples; None draws over samples.
        label : str, default="output"
            Quantity and unit of the vertical axis.
        ax : sequence of 2 matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        display : FreeRunDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            If the two differ in shape, or are not one column each.
        """
        measured, simulated = as_signals(y_true, "y_true"), as_signals(y_pred, "y_pred")
        if measured.shape != simulated.shape or measured.shape[1] != 1:
            raise ValueError(
                f"y_true has shape {measured.shape} and y_pred has shape {simulated.shape} (samples, "
                "columns); both must be one column, of equal length. Draw several outputs one by one."
            )
        is_initial = np.zeros(len(measured), dtype=bool)
        for piece in session_slices(sessions, len(measured)):
            is_initial[piece.start : min(piece.start + n_init, piece.stop)] = True
        display = cls(
            measured[:, 0], simulated[:, 0], is_initial, sampling_period=sampling_period, label=label
        )
        return display.plot(ax=ax)

    @property
    def nrmse_(self) -> float:
        """Root mean squared error over the standard deviation, on what is scored and known in both."""
        use = np.isfinite(self.y_true) & np.isfinite(self.y_pred)
        if self.is_initial is not None:
            use &= ~self.is_initial
        return float(nrmse(self.y_true[use], self.y_pred[use])) if use.any() else np.nan

    def plot(self, ax=None):
        """Draw both outputs, and the error below.

        Parameters
        ----------
        ax : sequence of 2 matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        self : FreeRunDisplay
            With ``figure_`` and ``axes_``.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            If there are not two axes.
        """
        self.axes_ = stacked_axes(ax)
        outputs, errors = self.axes_
        self.figure_ = outputs.figure
        time, time_label = time_of(len(self.y_true), self.sampling_period)
        outputs.plot(time, self.y_true, color=GREY, linewidth=2.2, label="measured")
        outputs.plot(
            time,
            self.y_pred,
            color=VERMILION,
            linewidth=1.0,
            label=f"free run, error {100 * self.nrmse_:.3g} % of the spread",
        )
        errors.plot(time, self.y_true - self.y_pred, color=VERMILION, linewidth=0.8)
        errors.axhline(0.0, color="black", linewidth=0.5)
        if self.is_initial is not None:
            for axes in self.axes_:
                axes.fill_between(
                    time,
                    0,
                    1,
                    where=self.is_initial,
                    transform=axes.get_xaxis_transform(),
                    color=GREY,
                    alpha=0.25,
                    linewidth=0,
                )
        outputs.set(ylabel=self.label)
        errors.set(ylabel="error", xlabel=time_label)
        legend_above(outputs)
        return self

    def to_frame(self) -> pd.DataFrame:
        """Return the signals drawn, one row a sample."""
        return pd.DataFrame(
            {
                "measured": self.y_true,
                "simulated": self.y_pred,
                "error": self.y_true - self.y_pred,
                "initial": np.zeros(len(self.y_true), dtype=bool)
                if self.is_initial is None
                else self.is_initial,
            }
        )

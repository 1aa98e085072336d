"""Figure of where in time a simulation and a recording part."""

import numpy as np
import pandas as pd

from narx_sklearn._validation import as_signals, signal_names
from narx_sklearn.discrepancy.locate import segments as find_segments
from narx_sklearn.displays._style import (
    BLUE,
    GREY,
    VERMILION,
    legend_above,
    signal_label,
    stacked_axes,
    time_of,
)


class LocationDisplay:
    """Time line of a recording and its simulation, the stretches that hold the mismatch shaded.

    Use :meth:`from_estimator` or :meth:`from_predictions`; the constructor takes finished results.

    Parameters
    ----------
    y_true, y_pred : ndarray of shape (n_samples,)
        Recorded and simulated output; NaN where there is none.
    segments : DataFrame
        One row a stretch with ``start`` and ``stop`` (samples, one past the end) and ``share`` of the
        residual's energy, as :func:`narx_sklearn.discrepancy.locate.segments` returns it.
    sampling_period : float, default=None
        Seconds between samples; None draws over samples.
    label : str, default="output"
        Quantity and unit of the vertical axis.

    Attributes
    ----------
    figure_ : matplotlib Figure
        The figure drawn in; exists after :meth:`plot`.
    axes_ : tuple of 2 matplotlib Axes
        Outputs, residual.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from narx_sklearn.displays import LocationDisplay
    >>> found = pd.DataFrame({"start": [2], "stop": [4], "share": [1.0]})
    >>> display = LocationDisplay(np.array([0.0, 0.0, 1.0, 1.0]), np.zeros(4), found)
    >>> display.to_frame()["segment"].tolist()
    [-1, -1, 0, 0]
    """

    def __init__(self, y_true, y_pred, segments, *, sampling_period=None, label="output"):
        self.y_true = y_true
        self.y_pred = y_pred
        self.segments = segments
        self.sampling_period = sampling_period
        self.label = label

    @classmethod
    def from_estimator(cls, estimator, *, output=0, ax=None):
        """Show where the refitted simulation left the recording that was diagnosed.

        Parameters
        ----------
        estimator : DiscrepancyRegressor
            Fitted; it holds its recording.
        output : int, default=0
            Output to draw, counted from 0. The stretches are of all outputs together.
        ax : sequence of 2 matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        display : LocationDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        TypeError
            If the estimator is no fitted DiscrepancyRegressor.
        ValueError
            If there is no such output.
        """
        conclusion = getattr(estimator, "conclusion_", None)
        if conclusion is None:
            raise TypeError(
                f"{type(estimator).__name__} holds no diagnosis; pass a fitted DiscrepancyRegressor, or use "
                "LocationDisplay.from_predictions(y_true, y_pred)."
            )
        diagnosis = conclusion.diagnosis
        problem = diagnosis.problem
        simulator = problem.simulator
        if not 0 <= output < len(simulator.outputs):
            raise ValueError(
                f"output is {output!r}, but there are {len(simulator.outputs)} outputs, counted from 0."
            )
        display = cls(
            problem.y[:, output],
            diagnosis.base_run.y[:, output],
            estimator.location_.segments,
            sampling_period=simulator.dt,
            label=signal_label(*simulator.outputs[output]),
        )
        return display.plot(ax=ax)

    @classmethod
    def from_predictions(
        cls, y_true, y_pred, *, X=None, sampling_period=1.0, label="output", random_state=0, ax=None
    ):
        """Find the stretches of time that hold the mismatch, and draw.

        Parameters
        ----------
        y_true, y_pred : array-like of shape (n_samples,)
            Recorded and simulated output; NaN is skipped.
        X : array-like of shape (n_samples, n_inputs), default=None
            Inputs; the last event of theirs before each stretch is then named.
        sampling_period : float, default=1.0
            Seconds between samples.
        label : str, default="output"
            Quantity and unit of the vertical axis.
        random_state : int or None, default=0
            Seed of the shuffles that say which stretches are louder than chance.
        ax : sequence of 2 matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        display : LocationDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            If the two differ in shape, or are not one column each.
        """
        recorded, simulated = as_signals(y_true, "y_true"), as_signals(y_pred, "y_pred")
        if recorded.shape != simulated.shape or recorded.shape[1] != 1:
            raise ValueError(
                f"y_true has shape {recorded.shape} and y_pred has shape {simulated.shape} (samples, "
                "columns); both must be one column, of equal length."
            )
        u = None if X is None else as_signals(X, "X")
        names = signal_names(X.columns, "u") if hasattr(X, "columns") else None
        table = find_segments(
            recorded - simulated, sampling_period, u=u, names=names, random_state=random_state
        )
        display = cls(recorded[:, 0], simulated[:, 0], table, sampling_period=sampling_period, label=label)
        return display.plot(ax=ax)

    def plot(self, ax=None):
        """Draw the outputs and the residual, and shade the stretches with their share of its energy.

        Parameters
        ----------
        ax : sequence of 2 matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        self : LocationDisplay
            With ``figure_`` and ``axes_``.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            If there are not two axes.
        """
        self.axes_ = stacked_axes(ax)
        outputs, residual = self.axes_
        self.figure_ = outputs.figure
        time, time_label = time_of(len(self.y_true), self.sampling_period)
        outputs.plot(time, self.y_true, color=GREY, linewidth=2.0, label="recorded")
        outputs.plot(time, self.y_pred, color=BLUE, linewidth=0.9, label="simulated")
        residual.plot(time, self.y_true - self.y_pred, color=VERMILION, linewidth=0.8)
        for row in self.segments.itertuples():
            begin, end = time[row.start], time[min(row.stop, len(time)) - 1]
            for axes in self.axes_:
                axes.axvspan(begin, end, color=VERMILION, alpha=0.15, linewidth=0)
            residual.annotate(
                f"{100 * row.share:.0f} %",
                (0.5 * (begin + end), 0.97),
                xycoords=residual.get_xaxis_transform(),
                ha="center",
                va="top",
                fontsize="small",
            )
        outputs.set(ylabel=self.label)
        residual.set(ylabel="residual", xlabel=time_label)
        legend_above(outputs)
        return self

    def to_frame(self) -> pd.DataFrame:
        """Return the signals drawn, one row a sample; ``segment`` counts the stretches, -1 outside."""
        segment = np.full(len(self.y_true), -1)
        for i, row in enumerate(self.segments.itertuples()):
            segment[row.start : row.stop] = i
        return pd.DataFrame(
            {
                "recorded": self.y_true,
                "simulated": self.y_pred,
                "residual": self.y_true - self.y_pred,
                "segment": segment,
            }
        )

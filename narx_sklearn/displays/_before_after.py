"""Figure of a correction: a held-out recording, and the simulation as it was, refitted, and corrected."""

import numpy as np
import pandas as pd

from narx_sklearn._validation import as_signals, check_same_length
from narx_sklearn.discrepancy.records.record import pieces_of, read_inputs, read_outputs
from narx_sklearn.discrepancy.verify import free_run
from narx_sklearn.displays._style import (
    BLUE,
    GREEN,
    GREY,
    VERMILION,
    legend_above,
    signal_label,
    stacked_axes,
    time_of,
)
from narx_sklearn.metrics import nrmse

COLOURS = {"nominal": BLUE, "refitted": GREEN, "augmented": VERMILION}


class BeforeAfterDisplay:
    """Free runs of a simulation before and after its correction, over a recording that no fit has seen.

    Use :meth:`from_estimator` or :meth:`from_predictions`; the constructor takes finished signals.

    Parameters
    ----------
    y_true : ndarray of shape (n_samples,)
        Recorded output; NaN where there is none.
    runs : dict of {str: ndarray of shape (n_samples,)}
        Simulated outputs by name; NaN where they are not scored.
    sampling_period : float, default=None
        Seconds between samples; None draws over samples.
    label : str, default="output"
        Quantity and unit of the vertical axis.

    Attributes
    ----------
    figure_ : matplotlib Figure
        The figure drawn in; exists after :meth:`plot`.
    axes_ : tuple of 2 matplotlib Axes
        Outputs, errors.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.displays import BeforeAfterDisplay
    >>> y = np.array([1.0, -1.0, 1.0, -1.0])
    >>> BeforeAfterDisplay(y, {"nominal": 0 * y, "augmented": 0.9 * y}).nrmse_.round(3).to_dict()
    {'nominal': 1.0, 'augmented': 0.1}
    """

    def __init__(self, y_true, runs, *, sampling_period=None, label="output"):
        self.y_true = y_true
        self.runs = runs
        self.sampling_period = sampling_period
        self.label = label

    @classmethod
    def from_estimator(cls, estimator, X, y, *, sessions=None, output=0, ax=None):
        """Run the nominal, the refitted and the corrected simulation freely over a recording, and draw.

        Each starts from the state that fits its first samples; they are not drawn, nor are sessions too short
        for that. Where the machine is unstable, runs begin anew before they lose it.

        Parameters
        ----------
        estimator : DiscrepancyRegressor
            Fitted.
        X : array-like of shape (n_samples, n_inputs)
            Inputs, of a recording that was not fitted.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Recorded outputs.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample; every session starts anew.
        output : int, default=0
            Output to draw, counted from 0.
        ax : sequence of 2 matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        display : BeforeAfterDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        TypeError
            If the estimator is no fitted DiscrepancyRegressor.
        ValueError
            If the recording does not fit the simulation, is too short for a run, or there is no such output.
        """
        if not hasattr(estimator, "refitted_simulator_"):
            raise TypeError(
                f"{type(estimator).__name__} holds no refitted simulation; pass a fitted "
                "DiscrepancyRegressor, or use BeforeAfterDisplay.from_predictions(y_true, runs)."
            )
        simulators = estimator.conclusion_.simulators | {"augmented": estimator.simulator_}
        u = read_inputs(X, estimator.simulator_)
        measured = read_outputs(y, estimator.simulator_)
        check_same_length(X=u, y=measured, sessions=sessions)
        if not 0 <= output < measured.shape[1]:
            raise ValueError(f"output is {output!r}, but y has {measured.shape[1]} columns, counted from 0.")
        runs = {name: np.full(len(u), np.nan) for name in simulators}
        stretches = estimator.conclusion_.stretches_of(pieces_of(u, sessions), measured)
        if not stretches:
            n_states = len(estimator.simulator_.states)
            raise ValueError(
                f"The recording has no stretch without gaps of more than {8 * (n_states + 1)} samples: half "
                "of them fix an initial state. Pass a longer one."
            )
        begin = estimator.conclusion_.guesses
        for stretch in stretches:
            for name, simulator in simulators.items():
                run = free_run(simulator, u, measured, stretch, begin[name]).y
                runs[name][stretch.scored] = run[stretch.n_init :, output]
        simulator = estimator.simulator_
        display = cls(
            measured[:, output],
            runs,
            sampling_period=simulator.dt,
            label=signal_label(*simulator.outputs[output]),
        )
        return display.plot(ax=ax)

    @classmethod
    def from_predictions(cls, y_true, runs, *, sampling_period=None, label="output", ax=None):
        """Draw simulations over a recording.

        Parameters
        ----------
        y_true : array-like of shape (n_samples,)
            Recorded output.
        runs : mapping of {str: array-like of shape (n_samples,)}
            Simulated outputs by name.
        sampling_period : float, default=None
            Seconds between samples; None draws over samples.
        label : str, default="output"
            Quantity and unit of the vertical axis.
        ax : sequence of 2 matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        display : BeforeAfterDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            If a run does not have the shape of ``y_true``.
        """
        recorded = as_signals(y_true, "y_true")[:, 0]
        columns = {name: as_signals(run, name)[:, 0] for name, run in runs.items()}
        for name, column in columns.items():
            if column.shape != recorded.shape:
                raise ValueError(
                    f"The run {name!r} has {column.size} samples, y_true has {recorded.size}; "
                    "they must be equal."
                )
        return cls(recorded, columns, sampling_period=sampling_period, label=label).plot(ax=ax)

    @property
    def nrmse_(self) -> pd.Series:
        """Root mean squared error of each run over the recording's spread, where all are known."""
        use = np.isfinite(self.y_true) & np.all([np.isfinite(run) for run in self.runs.values()], axis=0)
        return pd.Series(
            {
                name: float(nrmse(self.y_true[use], run[use])) if use.any() else np.nan
                for name, run in self.runs.items()
            }
        )

    def plot(self, ax=None):
        """Draw the recording with every run over it, and the errors below.

        Parameters
        ----------
        ax : sequence of 2 matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        self : BeforeAfterDisplay
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
        outputs.plot(time, self.y_true, color=GREY, linewidth=2.4, label="recorded")
        size = self.nrmse_
        for name, run in self.runs.items():
            colour = COLOURS.get(name)
            outputs.plot(time, run, color=colour, linewidth=1.0, label=f"{name}, {100 * size[name]:.3g} %")
            errors.plot(time, self.y_true - run, color=colour, linewidth=0.9)
        errors.axhline(0.0, color="black", linewidth=0.5)
        outputs.set(ylabel=self.label)
        errors.set(ylabel="error", xlabel=time_label)
        legend_above(outputs)
        return self

    def to_frame(self) -> pd.DataFrame:
        """Return the signals drawn, one row a sample: ``recorded`` and one column a run."""
        return pd.DataFrame({"recorded": self.y_true, **self.runs})

"""Figure of a compensation: the reference and what the plant makes of it, its input, and the loop left."""

import numpy as np
import pandas as pd

from narx_sklearn.compensation.inverse import InverseCompensator
from narx_sklearn.compensation.tracking import run_plant
from narx_sklearn.displays._style import BLUE, GREY, VERMILION, import_pyplot, legend_above, signal_label
from narx_sklearn.metrics import mape, nsavi
from narx_sklearn.model.narx import NARXModel


class CompensationDisplay:
    """Tracking of a reference with and without a compensator.

    Use :meth:`from_compensator`; the constructor takes finished signals.

    Parameters
    ----------
    reference : ndarray of shape (n_samples,)
        Wanted output.
    m : ndarray of shape (n_samples,)
        Compensation input.
    y : ndarray of shape (n_samples,)
        Output of the plant with the compensation input.
    y_uncompensated : ndarray of shape (n_samples,), default=None
        Output with the reference, or ``m_uncompensated``, as input.
    sampling_period : float, default=None
        Seconds between samples; None draws over samples.
    output_label, input_label : str, default="output" and "input"
        Quantities and units of the axes.
    m_uncompensated : ndarray of shape (n_samples,), default=None
        Input without compensation, to whose path that of ``m`` is compared (NSAVI); None is the reference.

    Attributes
    ----------
    figure_ : matplotlib Figure
        The figure drawn in; exists after :meth:`plot`.
    axes_ : tuple of matplotlib Axes
        Outputs over time, input over time, output over reference.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.compensation import BoucWenCompensator
    >>> from narx_sklearn.displays import CompensationDisplay
    >>> from narx_sklearn.physics import PIEZO_BENCH
    >>> r = 40 * np.sin(2 * np.pi * np.arange(1000) / 1000)
    >>> m = BoucWenCompensator(PIEZO_BENCH).fit().predict(r)
    >>> display = CompensationDisplay(r, m, PIEZO_BENCH.run(m), PIEZO_BENCH.run(r))
    >>> display.errors_.round(2).tolist()
    [5.84, 0.17]
    """

    def __init__(
        self,
        reference,
        m,
        y,
        y_uncompensated=None,
        *,
        sampling_period=None,
        output_label="output",
        input_label="input",
        m_uncompensated=None,
    ):
        self.reference = reference
        self.m = m
        self.y = y
        self.y_uncompensated = y_uncompensated
        self.sampling_period = sampling_period
        self.output_label = output_label
        self.input_label = input_label
        self.m_uncompensated = m_uncompensated

    @classmethod
    def from_compensator(cls, compensator, plant, reference, *, uncompensated=None, ax=None, **labels):
        """Compensate a reference, run the plant with and without, and draw.

        Parameters
        ----------
        compensator : fitted compensator
            Gives the input.
        plant : callable, NARXModel, or object with ``run`` or ``predict``
            As for :func:`narx_sklearn.compensation.run_plant`.
        reference : array-like of shape (n_samples,)
            Wanted output.
        uncompensated : array-like of shape (n_samples,), default=None
            Input of the run without compensation, such as the reference over the plant's gain. None is the
            reference itself, and no run where the compensator's model states that the plant's input is of
            another unit than its output.
        ax : sequence of 3 matplotlib Axes, default=None
            Where to draw; None makes a figure.
        **labels
            ``sampling_period``, ``output_label``, ``input_label`` of the display; by default those of the
            compensator's model, where it has one.

        Returns
        -------
        display : CompensationDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        """
        r = np.asarray(reference, dtype=float).reshape(-1)
        m = compensator.predict(r)
        machine = _machine(compensator)
        labels = {key: value for key, (value, _) in machine.items()} | labels
        units = {unit for _, unit in machine.values() if unit}
        without = r if uncompensated is None else np.asarray(uncompensated, dtype=float).reshape(-1)
        y_without = None if uncompensated is None and len(units) > 1 else run_plant(plant, without)
        return cls(
            r, m, run_plant(plant, m), y_without,
            m_uncompensated=None if uncompensated is None else without, **labels,
        ).plot(ax=ax)  # fmt: skip

    @property
    def errors_(self) -> np.ndarray:
        """MAPE (5.10) without and with compensation, in percent; NaN where there is no run without."""
        without = np.nan if self.y_uncompensated is None else mape(self.reference, self.y_uncompensated)
        return np.array([without, mape(self.reference, self.y)])

    def plot(self, ax=None):
        """Draw outputs and input over time, and output over reference.

        Parameters
        ----------
        ax : sequence of 3 matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        self : CompensationDisplay
            With ``figure_`` and ``axes_``.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        """
        plt = import_pyplot()
        if ax is None:
            mosaic = [["output", "loop"], ["input", "loop"]]
            ax = tuple(plt.figure(layout="constrained", figsize=(9, 4.5)).subplot_mosaic(mosaic).values())
            ax = (ax[0], ax[2], ax[1])
        self.axes_ = tuple(ax)
        outputs, inputs, loop = self.axes_
        self.figure_ = outputs.figure
        time = np.arange(self.reference.size) * (self.sampling_period or 1.0)
        if self.y_uncompensated is not None:
            outputs.plot(time, self.y_uncompensated, color=GREY, linewidth=1.0, label="without")
            loop.plot(self.reference, self.y_uncompensated, color=GREY, linewidth=1.0, label="without")
        outputs.plot(time, self.reference, color="black", linewidth=1.0, linestyle="--", label="reference")
        outputs.plot(time, self.y, color=VERMILION, linewidth=1.2, label="compensated")
        without = self.reference if self.m_uncompensated is None else self.m_uncompensated
        told = "input"
        if self.m_uncompensated is not None or self.y_uncompensated is not None:
            told = f"{nsavi(without, self.m):.3g} times the path of the input without (NSAVI)"
        inputs.plot(time, self.m, color=BLUE, linewidth=1.2, label=told)
        loop.plot(
            self.reference, self.y, color=VERMILION, linewidth=1.2, label=f"MAPE {self.errors_[1]:.3g} %"
        )
        outputs.set(ylabel=self.output_label)
        inputs.set(ylabel=self.input_label, xlabel="time (s)" if self.sampling_period else "sample")
        loop.set(xlabel=f"reference, {self.output_label}", ylabel=self.output_label)
        for axes in self.axes_:
            legend_above(axes)
        return self

    def to_frame(self) -> pd.DataFrame:
        """Return the signals drawn, one row a sample."""
        columns = {"reference": self.reference, "m": self.m, "y": self.y}
        if self.y_uncompensated is not None:
            columns["y_uncompensated"] = self.y_uncompensated
        return pd.DataFrame(columns)


def _machine(compensator) -> dict[str, tuple]:
    """Return sampling period and labels that a compensator's model knows, each with its unit."""
    model = getattr(compensator, "model_", None)
    if not isinstance(model, NARXModel):
        return {}
    ends = model.outputs[0], getattr(compensator, "input_name", None) or model.inputs[0]
    if isinstance(compensator, InverseCompensator):
        ends = ends[::-1]  # an inverse model's output is the machine's input
    output, input_ = ((name, model.units.get(name, "")) for name in ends)
    return {
        "sampling_period": (model.sampling_period, None),
        "output_label": (signal_label(*output), output[1]),
        "input_label": (signal_label(*input_), input_[1]),
    }

"""Figure of the residual tests: one panel per correlation function."""

import numpy as np

from narx_sklearn._validation import as_signals
from narx_sklearn.analysis.residuals import ResidualTests, residual_tests
from narx_sklearn.displays._style import BLUE, GREY, VERMILION, import_pyplot

PANEL_SIZE = (3.4, 2.3)  # inches
MAX_COLUMNS = 3


class ResidualTestsDisplay:
    """Residual tests drawn as correlations over their lags, inside or outside their bounds.

    Use :meth:`from_estimator` or :meth:`from_predictions`; the constructor takes a finished result.

    Parameters
    ----------
    tests : ResidualTests
        Result of :func:`narx_sklearn.analysis.residuals.residual_tests`.

    Attributes
    ----------
    figure_ : matplotlib Figure
        The figure drawn in; exists after :meth:`plot`.
    axes_ : list of matplotlib Axes
        One per panel, in the order of ``tests.tests``.
    stems_ : list of matplotlib LineCollection
        Correlations of each panel.
    bounds_ : list of matplotlib PolyCollection
        Shaded bounds of each panel.

    See Also
    --------
    narx_sklearn.analysis.residuals.residual_tests : The numbers behind the figure.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.analysis.residuals import residual_tests
    >>> from narx_sklearn.displays import ResidualTestsDisplay
    >>> rng = np.random.default_rng(0)
    >>> display = ResidualTestsDisplay(residual_tests(rng.normal(size=300), rng.normal(size=300), max_lag=10))
    >>> len(display.to_frame())
    74
    """

    def __init__(self, tests: ResidualTests):
        self.tests = tests

    @classmethod
    def from_estimator(cls, estimator, X, y, *, output=0, sessions=None, ax=None, **options):
        """Predict one step ahead, test what is left, and draw.

        Parameters
        ----------
        estimator : object
            Fitted estimator with ``residuals(X, y)``, as `NARXRegressor.residuals`, or with
            ``predict_one_step(X, y)``, aligned with ``y`` and NaN where no prediction can be made.
        X : array-like or DataFrame of shape (n_samples, n_inputs)
            Inputs.
        y : array-like of shape (n_samples,) or (n_samples, n_outputs)
            Measured outputs.
        output : int, default=0
            Column of ``y`` to test, counted from 0.
        sessions : array-like of shape (n_samples,), default=None
            Label of the recording each sample belongs to; given to the estimator when not None.
        ax : matplotlib Axes or array-like of Axes, default=None
            Where to draw, see :meth:`plot`.
        **options
            ``max_lag``, ``alpha``, ``n_resamples``, ``random_state`` of ``residual_tests``.

        Returns
        -------
        display : ResidualTestsDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        TypeError
            If the estimator has neither ``residuals`` nor ``predict_one_step``.
        ValueError
            If ``y`` has no column ``output``, or as ``residual_tests`` raises.
        """
        by_itself = hasattr(estimator, "residuals")
        if not by_itself and not hasattr(estimator, "predict_one_step"):
            raise TypeError(
                f"{type(estimator).__name__} has no predict_one_step(X, y), which gives the residuals. "
                "Use ResidualTestsDisplay.from_predictions(y_true, y_pred, X)."
            )
        routed = {} if sessions is None else {"sessions": sessions}
        y_true = as_signals(y, "y")
        if by_itself:
            y_pred = y_true - as_signals(estimator.residuals(X, y, **routed), "residuals")
        else:
            y_pred = as_signals(estimator.predict_one_step(X, y, **routed), "prediction")
        if not 0 <= output < y_true.shape[1]:
            raise ValueError(f"output is {output!r}, but y has {y_true.shape[1]} columns, counted from 0.")
        return cls.from_predictions(
            y_true[:, output], y_pred[:, output], X, sessions=sessions, ax=ax, **options
        )

    @classmethod
    def from_predictions(cls, y_true, y_pred, X, *, sessions=None, ax=None, **options):
        """Test measured minus predicted output, and draw.

        Parameters
        ----------
        y_true : array-like of shape (n_samples,)
            Measured output.
        y_pred : array-like of shape (n_samples,)
            One-step-ahead prediction; NaN where there is none.
        X : array-like or DataFrame of shape (n_samples, n_inputs), or None
            Inputs.
        sessions : array-like of shape (n_samples,), default=None
            Label of the recording each sample belongs to.
        ax : matplotlib Axes or array-like of Axes, default=None
            Where to draw, see :meth:`plot`.
        **options
            ``max_lag``, ``alpha``, ``n_resamples``, ``random_state`` of ``residual_tests``.

        Returns
        -------
        display : ResidualTestsDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            As ``residual_tests`` raises, or if ``y_true`` and ``y_pred`` differ in shape.
        """
        y_true, y_pred = as_signals(y_true, "y_true"), as_signals(y_pred, "y_pred")
        if y_true.shape != y_pred.shape:
            raise ValueError(
                f"y_true has shape {y_true.shape} and y_pred has shape {y_pred.shape} (samples, columns); "
                "they must be equal."
            )
        tests = residual_tests(y_true - y_pred, X, y_true, sessions=sessions, **options)
        return cls(tests).plot(ax=ax)

    def plot(self, ax=None):
        """Draw one panel per test; correlations outside the bound stand out in colour and width.

        Negative lags, hatched and marked, belong to the feedback test of the same pair of signals.

        Parameters
        ----------
        ax : matplotlib Axes or array-like of Axes, default=None
            None makes a figure. One Axes is divided into panels; several are used as panels, and there
            must be one per test.

        Returns
        -------
        self : ResidualTestsDisplay
            With ``figure_``, ``axes_``, ``stems_`` and ``bounds_``.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            If the number of axes is not that of the tests.
        """
        self.axes_ = _panels(import_pyplot(), ax, len(self.tests.tests))
        self.figure_ = self.axes_[0].figure
        self.stems_, self.bounds_ = [], []
        feedback = {test.input: test for test in self.tests.feedback}
        for panel, test in zip(self.axes_, self.tests.tests, strict=True):
            before = feedback.get(test.input) if test.name == "cross-correlation" else None
            self._draw(panel, test, before)
        return self

    def to_frame(self):
        """Return the numbers drawn, one row per test and lag.

        Returns
        -------
        frame : DataFrame
            As :meth:`narx_sklearn.analysis.residuals.ResidualTests.to_frame`.
        """
        return self.tests.to_frame()

    def _draw(self, panel, test, before):
        lags, correlation, bound = test.lags, test.correlation, test.bound
        if before is not None:
            lags = np.concatenate([before.lags, lags])
            correlation = np.concatenate([before.correlation, correlation])
            bound = np.concatenate([before.bound, bound])
            panel.axvspan(lags[0] - 0.5, -0.5, facecolor="none", edgecolor=GREY, alpha=0.4, hatch="//", lw=0)
            panel.text(0.02, 0.03, "feedback", transform=panel.transAxes, fontsize="small", color="black")
        outside = np.abs(correlation) > bound
        edges = np.concatenate([[lags[0] - 0.5], lags, [lags[-1] + 0.5]])
        band = np.pad(bound, 1, mode="edge")
        self.bounds_.append(
            panel.fill_between(edges, -band, band, step="mid", color=GREY, alpha=0.3, linewidth=0)
        )
        self.stems_.append(
            panel.vlines(
                lags,
                0.0,
                correlation,
                colors=np.where(outside, VERMILION, BLUE),
                linewidths=np.where(outside, 2.4, 1.4),
            )
        )
        panel.axhline(0.0, color="black", linewidth=0.6)
        largest = 1.25 * max(np.max(np.abs(correlation)), np.max(bound))
        panel.set(
            xlim=(lags[0] - 0.5, lags[-1] + 0.5),
            ylim=(-largest, largest),
            xlabel="lag (samples)",
            ylabel="correlation",
        )
        panel.xaxis.get_major_locator().set_params(integer=True)
        panel.set_title(
            f"{test.symbol.replace('^2', '²').replace('^3', '³').replace('xi', 'ξ')}   "
            f"{_round_p(test.p_value)}{', rejected' if test.rejected else ''}",
            fontsize="medium",
            color=VERMILION if test.rejected else "black",
        )


def _round_p(p_value):
    return f"p = {p_value:.2g}" if p_value >= 1e-4 else "p < 0.0001"


def _panels(plt, ax, n_panels):
    """Return ``n_panels`` axes: new ones, parts of one, or those given."""
    if ax is not None and np.ndim(ax):
        axes = list(np.ravel(ax))
        if len(axes) != n_panels:
            raise ValueError(f"ax holds {len(axes)} axes, but there are {n_panels} tests. Pass one per test.")
        return axes
    n_columns = min(MAX_COLUMNS, n_panels)
    n_rows = -(-n_panels // n_columns)
    if ax is None:
        figure = plt.figure(figsize=(PANEL_SIZE[0] * n_columns, PANEL_SIZE[1] * n_rows), layout="constrained")
        grid = figure.add_gridspec(n_rows, n_columns)
    else:
        figure = ax.figure
        grid = ax.get_subplotspec().subgridspec(n_rows, n_columns, hspace=0.8, wspace=0.45)
        ax.set_axis_off()
    return [figure.add_subplot(grid[divmod(i, n_columns)]) for i in range(n_panels)]

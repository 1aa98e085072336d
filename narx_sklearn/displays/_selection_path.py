"""Figure of a selection: error reduction ratios of the terms, and the criterion over their number."""

import numpy as np
import pandas as pd

from narx_sklearn.displays._style import BLUE, GREY, VERMILION, check_axes, import_pyplot, legend_above


class SelectionPathDisplay:
    """Error reduction ratio of each chosen term, and the information criterion of every model size.

    Use :meth:`from_estimator`; the constructor takes finished numbers.

    Parameters
    ----------
    err : Series of float
        Error reduction ratio (2.42) of each chosen term, by its name, largest first.
    criterion : Series of float
        Value of the criterion, by number of terms; infinite where constraints rule a size out.
    name : str, default="criterion"
        Name of the criterion.

    Attributes
    ----------
    figure_ : matplotlib Figure
        The figure drawn in; exists after :meth:`plot`.
    axes_ : tuple of 2 matplotlib Axes
        Ratios, criterion.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn import ErrSelector
    >>> from narx_sklearn.displays import SelectionPathDisplay
    >>> X = np.random.default_rng(0).normal(size=(100, 5))
    >>> selector = ErrSelector().fit(X, 2 * X[:, 3] - X[:, 1])
    >>> SelectionPathDisplay.from_estimator(selector).err.index.tolist()
    ['x3', 'x1']
    """

    def __init__(self, err, criterion, *, name="criterion"):
        self.err = err
        self.criterion = criterion
        self.name = name

    @classmethod
    def from_estimator(cls, estimator, *, criterion=None, output=0, ax=None):
        """Read the path of a fitted estimator, and draw.

        Parameters
        ----------
        estimator : NARXRegressor, NARXRegressorCV or ErrSelector
            Fitted.
        criterion : str, default=None
            Which information criterion; None is the estimator's own.
        output : int, default=0
            Output whose path is drawn, counted from 0.
        ax : sequence of 2 matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        display : SelectionPathDisplay
            The display, drawn.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        TypeError
            If the estimator holds no ``path_``.
        ValueError
            If there is no such output or criterion.
        """
        paths = getattr(estimator, "path_", None)
        if paths is None:
            raise TypeError(f"{type(estimator).__name__} has no path_ of a term selection. Fit it first.")
        paths = paths if isinstance(paths, list) else [paths]
        if not 0 <= output < len(paths):
            raise ValueError(f"output is {output!r}, but there are {len(paths)} outputs, counted from 0.")
        name = criterion or getattr(estimator, "criterion", "ebic")
        values = pd.Series(paths[output].criterion(name), index=pd.Index(paths[output].sizes, name="n_terms"))
        err = np.asarray(estimator.err_).reshape(len(estimator.err_), -1)[:, output]
        ratios = pd.Series(err, index=_names(estimator, len(err)))
        return cls(ratios[ratios > 0].sort_values(ascending=False), values, name=name).plot(ax=ax)

    def plot(self, ax=None):
        """Draw the ratios as bars on a logarithmic axis, and the criterion with its minimum.

        The first few terms take off so much that the minimum would be lost in a flat line: sizes far below
        it leave the axes at the top.

        Parameters
        ----------
        ax : sequence of 2 matplotlib Axes, default=None
            Where to draw; None makes a figure.

        Returns
        -------
        self : SelectionPathDisplay
            With ``figure_`` and ``axes_``.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            If there are not two axes.
        """
        plt = import_pyplot()
        if ax is None:
            height = 1.6 + 0.24 * max(8, len(self.err))
            ax = plt.subplots(1, 2, figsize=(9, height), layout="constrained")[1]
        self.axes_ = tuple(check_axes(ax, 2))
        bars, path = self.axes_
        self.figure_ = bars.figure
        bars.barh(np.arange(len(self.err)), self.err, color=BLUE)
        bars.set_yticks(np.arange(len(self.err)), self.err.index)
        bars.set(xscale="log", xlabel="error reduction ratio")
        bars.invert_yaxis()
        best, chosen = int(self.criterion.idxmin()), len(self.err)
        path.plot(self.criterion.index, self.criterion, color=BLUE, marker="o", markersize=4)
        path.axvline(best, color=GREY, linestyle="--", linewidth=1, label=f"minimum, {best} terms")
        if chosen != best:
            path.axvline(chosen, color=VERMILION, linewidth=1, label=f"model, {chosen} terms")
        path.set(xlabel="number of terms", ylabel=self.name.upper(), ylim=_range_round(self.criterion, best))
        legend_above(path)
        return self

    def to_frame(self) -> pd.DataFrame:
        """Return the criterion of every size, with the term of that rank and its ratio where there is one."""
        frame = self.criterion.rename(self.name).to_frame()
        ranked = self.err.reset_index()
        ranked.columns = ["term", "err"]
        ranked.index = pd.RangeIndex(1, len(ranked) + 1)
        return frame.join(ranked)


def _range_round(criterion: pd.Series, best: int) -> tuple[float, float]:
    """Return limits that hold the criterion from a third of the best size on, with a margin."""
    shown = criterion[(criterion.index >= best // 3) & np.isfinite(criterion)]
    margin = 0.05 * (shown.max() - shown.min()) or 1.0
    return shown.min() - margin, shown.max() + margin


def _names(estimator, count: int) -> list[str]:
    """Return the names of what has an error reduction ratio: terms, columns, or x0, x1, ..."""
    for attribute in ("terms_", "feature_names_in_"):
        names = getattr(estimator, attribute, None)
        if names is not None:
            return [str(name) for name in names]
    return [f"x{i}" for i in range(count)]

"""Lags, phi regressors and terms as scikit-learn transformers, for one-step pipelines of ordinary parts.

A row of the result holds what is known when ``y[k]`` is to be predicted. The signals frame ``X`` must hold
every signal whose past is to be used: the inputs, and the output itself as one more column, while the target
handed to ``fit`` is the same output. Only lags of at least 1 may be taken of that column.
"""

import re
from collections.abc import Sequence

import numpy as np
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from narx_sklearn._validation import check_choice, column_labels, session_slices, signal_names, unmasked
from narx_sklearn.identification.one_step.regressors import Candidates
from narx_sklearn.identification.structure.candidates import candidate_library, named_phi, structure_filter
from narx_sklearn.model.phi import Phi
from narx_sklearn.model.recording import Layout, Recording, lay_out
from narx_sklearn.model.terms import TermLibrary
from narx_sklearn.model.times import step_of_rows

__all__ = ["LagTransformer", "PhiTransformer", "TermTransformer"]

FILLS = ("nan", "hold")


LAGGED = re.compile(r"\[k(?:-\d+)?\]$")  # how the columns of these transformers end


def _refuse_lagged(labels: list | None) -> None:
    """Raise a ValueError where columns are lags of signals, which would be lagged once more."""
    lagged = [label for label in labels or () if isinstance(label, str) and LAGGED.search(label)]
    if lagged:
        raise ValueError(
            f"X holds the columns {lagged}, which are lagged already and would be lagged again. Pass the "
            "signals themselves: LagTransformer, PhiTransformer and TermTransformer each make lags of them. "
            "Products of these columns are made by sklearn.preprocessing.PolynomialFeatures."
        )


class _SignalTransformer(TransformerMixin, BaseEstimator):
    """Base of what turns signals, column by column in time, into regressors."""

    def fit(self, X, y=None):
        """Learn the names of the signals and, from them, the columns to make.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_signals)
            Signals; NaN marks gaps. A DataFrame's columns name them (``"drive [V]"`` gives ``drive``),
            otherwise they are ``u``, or ``u1, u2, ...``.
        y : None, default=None
            Not used.

        Returns
        -------
        self
        """
        check_choice(self.fill, "fill", FILLS)
        labels = column_labels(X)
        _refuse_lagged(labels)
        X = self._read(X, reset=True)
        self.signals_ = signal_names(labels if labels is not None else range(X.shape[1]), "u")
        self._prepare(labels)
        return self

    def transform(self, X, sessions=None):
        """Compute the columns at every sample.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_signals)
            Signals, as in `fit`.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample: where it changes another recording begins. Lags never reach across.

        Returns
        -------
        ndarray of shape (n_samples, n_columns)
            As many rows as ``X``; what a row needs and the record does not hold is filled as ``fill`` says.
        """
        check_is_fitted(self)
        step_of_rows({"X": X}, sessions)
        return self._columns(self._read(X, reset=False), sessions)

    def fit_transform(self, X, y=None, sessions=None):
        """Fit, then transform.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_signals)
            Signals.
        y : None, default=None
            Not used.
        sessions : array-like of shape (n_samples,), default=None
            One label a sample.

        Returns
        -------
        ndarray of shape (n_samples, n_columns)
        """
        return self.fit(X, y).transform(X, sessions=sessions)

    def get_feature_names_out(self, input_features=None):
        """Return the names of the columns.

        Parameters
        ----------
        input_features : array-like of str, default=None
            Checked against what `fit` saw; the names are those of ``signals_`` in any case.

        Returns
        -------
        ndarray of str
        """
        check_is_fitted(self)
        if input_features is not None:
            given = np.asarray(input_features, dtype=object)
            seen = getattr(self, "feature_names_in_", None)
            if seen is not None and not np.array_equal(given, seen):
                raise ValueError(f"input_features is not equal to feature_names_in_, {list(seen)}.")
            if given.size != self.n_features_in_:
                raise ValueError(
                    f"input_features should have length equal to number of features ({self.n_features_in_}), "
                    f"got {given.size}."
                )
        return np.array(self._names(), dtype=object)

    def _read(self, X, *, reset: bool) -> np.ndarray:
        return validate_data(
            self, unmasked(X), reset=reset, dtype=np.float64, ensure_all_finite="allow-nan", order="C"
        )

    def _record(self, X, sessions, phi: Sequence[Phi], depth: int) -> tuple[Layout, Recording, np.ndarray]:
        """Lay signals out with ``depth`` samples before each session; return also the rows of ``X``."""
        pieces = session_slices(sessions, X.shape[0])
        offsets = [np.arange(-depth, piece.stop - piece.start) for piece in pieces]
        pairs = list(zip(pieces, offsets, strict=True))
        held = X[np.concatenate([piece.start + np.maximum(offset, 0) for piece, offset in pairs])]
        measured = np.concatenate(offsets) >= 0
        if self.fill == "nan":
            held[~measured] = np.nan
        labels = np.repeat(np.arange(len(pieces)), [offset.size for offset in offsets])
        layout = Layout.of((), self.signals_, phi)
        recording = lay_out(layout, held, np.empty((held.shape[0], 0)), labels)
        return layout, recording, np.flatnonzero(measured)

    def __sklearn_tags__(self):
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        return tags


class _LibraryTransformer(_SignalTransformer):
    """Base of what computes the terms of a library."""

    def _prepare(self, labels) -> None:
        self.phi_ = named_phi(getattr(self, "phi", ()), self.signals_)
        self.library_ = self._library(self.signals_, self.phi_)

    def _columns(self, X, sessions) -> np.ndarray:
        reach = {p.name: p.reach for p in self.phi_}
        depth = max((v.lag + reach.get(v.signal, 0) for v in self.library_.variables), default=0)
        layout, recording, rows = self._record(X, sessions, self.phi_, depth)
        # every row, complete or not: NaN runs through the products
        return Candidates(self.library_, layout, recording, rows).matrix()

    def _names(self) -> list[str]:
        return self.library_.names


class LagTransformer(_LibraryTransformer):
    """Lag signals: one column ``u[k-i]`` for each signal and lag.

    Parameters
    ----------
    lags : int, list of int, or one of these for each signal, default=1
        n means ``delay`` to n, a list means itself. One for each signal as a list of lists or a mapping
        from names; signals that a mapping leaves out get no column.
    delay : int or one for each signal, default=1
        Smallest lag where ``lags`` is an integer. 0 takes in the present sample ``u[k]``; never do so for
        a column that is also the target.
    fill : {"nan", "hold"}, default="nan"
        What stands where a lag reaches before the first sample of a session: NaN, or the first sample, as
        if the signal had been held there until the record began. Gaps give NaN either way.

    Attributes
    ----------
    signals_ : tuple of str
        Names of the signals.
    library_ : TermLibrary
        The columns.
    n_features_in_ : int
        Number of signals.
    feature_names_in_ : ndarray of str
        Names of the columns of ``X``, if they were texts.

    See Also
    --------
    TermTransformer : Products of lagged signals.
    NARXRegressor : Identify and simulate; a pipeline of transformers predicts one step ahead only.

    Notes
    -----
    A transformer inside a pipeline cannot drop rows, because the target would no longer fit. With
    ``fill="nan"`` the rows without history stay, as NaN: drop them together with their targets before
    fitting, or end the pipeline in an estimator that takes NaN. With ``fill="hold"`` any estimator will do,
    at the price of as many invented rows a session as the longest lag; where the output is among the
    signals, the very first of them holds the target itself. With metadata routing on,
    ``set_transform_request(sessions=True)`` lets a pipeline pass ``sessions`` on.

    Examples
    --------
    The output's past comes from a column of ``X``, its present is the target:

    >>> import numpy as np
    >>> import pandas as pd
    >>> from sklearn.linear_model import LinearRegression
    >>> from sklearn.pipeline import make_pipeline
    >>> from narx_sklearn.identification.transformers import LagTransformer
    >>> u = np.random.default_rng(0).normal(size=200)
    >>> y = np.zeros(200)
    >>> for k in range(1, 200):
    ...     y[k] = 0.5 * y[k - 1] + u[k - 1]
    >>> signals = pd.DataFrame({"y": y, "u": u})
    >>> lags = LagTransformer(fill="hold").set_output(transform="pandas")
    >>> model = make_pipeline(lags, LinearRegression()).fit(signals, y)
    >>> dict(zip(model[0].get_feature_names_out(), model[1].coef_.round(2).tolist()))
    {'y[k-1]': 0.5, 'u[k-1]': 1.0}
    """

    def __init__(self, lags=1, *, delay=1, fill="nan"):
        self.lags = lags
        self.delay = delay
        self.fill = fill

    def _library(self, signals, phi) -> TermLibrary:
        return candidates_of(signals, lags=self.lags, delay=self.delay, include_constant=False)


class TermTransformer(_LibraryTransformer):
    """Compute terms: one column for each product of lagged signals and phi regressors.

    Parameters
    ----------
    terms : list of str or Term, default=None
        The terms, such as ``["y[k-1]", "u[k-2]^2*phi1[k-1]"]``; None makes all that the following
        parameters allow. Columns stand in canonical order, whatever order is given.
    lags : int, list of int, or one of these for each signal, default=1
        Lags of the signals, as for `LagTransformer`.
    delay : int or one for each signal, default=1
        Smallest lag where ``lags`` is an integer. Never 0 for a column that is also the target.
    phi : sequence of Phi, default=()
        Functions of the signals that count as signals. Unnamed ones become ``phi1``, ``phi2``, ...
    phi_lags : int, list of int, or one of these for each phi, default=1
        Lags of the phi regressors.
    degree : int, default=2
        Highest degree of a term.
    include_constant : bool, default=False
        Whether the constant term ``1`` is a column; leave it out where an intercept is fitted.
    exclude : sequence of str, default=()
        Term clusters left out, such as ``"y^2"``.
    fill : {"nan", "hold"}, default="nan"
        What stands where a lag reaches before the first sample of a session; see `LagTransformer`.

    Attributes
    ----------
    signals_ : tuple of str
        Names of the signals.
    phi_ : tuple of Phi
        The phi regressors, named.
    library_ : TermLibrary
        The terms, in the order of the columns.
    n_features_in_ : int
        Number of signals.
    feature_names_in_ : ndarray of str
        Names of the columns of ``X``, if they were texts.

    See Also
    --------
    LagTransformer : Lags alone; says how the output's past enters and what becomes of the first rows.

    Examples
    --------
    >>> import pandas as pd
    >>> from narx_sklearn.identification.transformers import TermTransformer
    >>> signals = pd.DataFrame({"y": [0.0, 1.0, 3.0], "u": [2.0, 4.0, 5.0]})
    >>> TermTransformer(["y[k-1]*u[k-1]", "u[k]"]).set_output(transform="pandas").fit_transform(signals)
       u[k]  y[k-1]*u[k-1]
    0   2.0            NaN
    1   4.0            0.0
    2   5.0            4.0
    """

    def __init__(
        self,
        terms=None,
        *,
        lags=1,
        delay=1,
        phi=(),
        phi_lags=1,
        degree=2,
        include_constant=False,
        exclude=(),
        fill="nan",
    ):
        self.terms = terms
        self.lags = lags
        self.delay = delay
        self.phi = phi
        self.phi_lags = phi_lags
        self.degree = degree
        self.include_constant = include_constant
        self.exclude = exclude
        self.fill = fill

    def _library(self, signals, phi) -> TermLibrary:
        if self.terms is None:
            return candidates_of(
                signals, phi, lags=self.lags, delay=self.delay, phi_lags=self.phi_lags, degree=self.degree,
                include_constant=self.include_constant, exclude=self.exclude,
            )  # fmt: skip
        if isinstance(self.terms, str):
            raise TypeError(f"terms must be a list of terms, got the text {self.terms!r}; put it in a list.")
        library = TermLibrary(self.terms)
        known = {*signals, *(p.name for p in phi)}
        if not library.signals <= known:
            raise ValueError(
                f"terms use the signals {sorted(library.signals - known)}; X (n_features={len(signals)}) and "
                f"phi hold {sorted(known)}."
            )
        ahead = [str(v) for v in library.variables if v.lag < 0]
        if ahead:
            raise ValueError(f"terms read the future, {', '.join(ahead)}; shift the target instead.")
        if not len(library):
            raise ValueError("terms is empty; give at least one term, or None for all up to the degree.")
        return library


class PhiTransformer(_SignalTransformer):
    """Append phi regressors to signals, as further signals.

    Parameters
    ----------
    phi : sequence of Phi, default=()
        Functions of the signals, such as ``DifferenceSign("u")``. Unnamed ones become ``phi1``, ``phi2``, ...
    keep_signals : bool, default=True
        Whether the signals themselves come first, under their own labels.
    fill : {"nan", "hold"}, default="nan"
        Value of a phi regressor where its past is not known, at the first samples of a session: NaN, or what
        it is when the signal was held before.

    Attributes
    ----------
    signals_ : tuple of str
        Names of the signals.
    phi_ : tuple of Phi
        The phi regressors, named.
    n_features_in_ : int
        Number of signals.
    feature_names_in_ : ndarray of str
        Names of the columns of ``X``, if they were texts.

    See Also
    --------
    TermTransformer : Takes phi regressors too, and multiplies them with lagged signals.

    Notes
    -----
    Set the output to pandas when a `LagTransformer` follows, so that it learns the names.

    Examples
    --------
    >>> import pandas as pd
    >>> from narx_sklearn.identification.transformers import PhiTransformer
    >>> from narx_sklearn.model import DifferenceSign
    >>> direction = PhiTransformer([DifferenceSign("u")], fill="hold")
    >>> direction.fit_transform(pd.DataFrame({"u": [1.0, 3.0, 2.0]})).tolist()
    [[1.0, 0.0], [3.0, 1.0], [2.0, -1.0]]
    """

    def __init__(self, phi=(), *, keep_signals=True, fill="nan"):
        self.phi = phi
        self.keep_signals = keep_signals
        self.fill = fill

    def _prepare(self, labels) -> None:
        self.phi_ = named_phi(self.phi, self.signals_)
        if not self.phi_ and not self.keep_signals:
            raise ValueError("There is nothing to compute: give phi, or keep_signals=True.")
        self._labels = self.signals_ if labels is None else tuple(map(str, labels))

    def _columns(self, X, sessions) -> np.ndarray:
        depth = max((p.reach for p in self.phi_), default=0)
        _, recording, rows = self._record(X, sessions, self.phi_, depth)
        return recording.data[rows, 0 if self.keep_signals else len(self.signals_) :]

    def _names(self) -> list[str]:
        return [*(self._labels if self.keep_signals else ()), *(str(p.name) for p in self.phi_)]


def candidates_of(
    signals, phi=(), *, lags, delay, phi_lags=1, degree=1, include_constant, exclude=()
) -> TermLibrary:
    """Return the candidate terms of signals that are all alike, none of them an output of its own."""
    return candidate_library(
        (), signals, phi, output_lags=(), input_lags=lags, phi_lags=phi_lags, delay=delay, degree=degree,
        include_constant=include_constant, keep=structure_filter(None, exclude, (), signals, phi),
        lags_name="lags",
    )  # fmt: skip

"""Residual analysis: is what the model leaves over only noise, and if not, what is missing?"""

from dataclasses import dataclass
from numbers import Integral
from typing import NamedTuple

import numpy as np
import pandas as pd
from sklearn.utils import check_random_state

from narx_sklearn._validation import as_signals, column_labels, signal_names
from narx_sklearn.analysis._correlations import (
    FIRST_LAG,
    calibrate,
    correlate,
    critical_value,
    holm,
    p_value_of,
    standardise,
)
from narx_sklearn.analysis._surrogates import segment_reach

__all__ = ["ResidualTest", "ResidualTests", "residual_tests"]

MAX_LAG = 25  # samples, to which residuals are tested where nothing else is asked
MIN_PRODUCTS = 20  # products a correlation needs before its own spread can normalise it


class _Kind(NamedTuple):
    """One kind of test: its symbol, and what its failure says."""

    symbol: str
    finding: str


_KINDS = {
    "autocorrelation": _Kind(
        "xi, xi",
        "The residuals are coloured ({lags}). Try more output lags, or extended least squares, which "
        "models the noise.",
    ),
    "output-residual": _Kind(
        "(y xi), xi^2",
        "The size of the residuals feeds forward ({lags}): the noise enters nonlinearly. Try a higher "
        "degree in the outputs, or extended least squares.",
    ),
    "cross-correlation": _Kind(
        "{u}, xi",
        "The model misses linear dynamics of input {u} ({lags}). Try input lags that cover them; the "
        "current input (lag 0) is among the candidates only with delay=0.",
    ),
    "residual-input": _Kind(
        "xi, (xi {u})",
        "Noise and input {u} act as a product ({lags}). Try terms that multiply outputs and {u}.",
    ),
    "even": _Kind(
        "{u}^2, xi",
        "The model misses an even nonlinear effect of input {u} ({lags}). Try a higher degree at these lags.",
    ),
    "odd": _Kind(
        "{u}^3, xi",
        "The model misses an odd nonlinear effect of input {u}, such as a cube ({lags}). Try degree 3 or "
        "higher at these lags.",
    ),
    "spread": _Kind(
        "{u}^2, xi^2",
        "The spread of the residuals follows the size of input {u} ({lags}): a nonlinear effect is missing "
        "(try a higher degree), or the noise itself grows with {u}.",
    ),
    "output-input": _Kind(
        "(y xi), {u}^2",
        "Output and residual together follow the size of input {u} ({lags}). Try a higher degree and terms "
        "that multiply outputs and {u}.",
    ),
    "feedback": _Kind(
        "{u}, xi",
        "Input {u} follows earlier residuals ({lags}): the record was made in closed loop. That is no fault "
        "of the model, and lags from 0 on are judged apart from it.",
    ),
}


_NONLINEAR = ("residual-input", "even", "odd", "spread", "output-input")  # may follow from a linear miss


@dataclass(frozen=True, eq=False)
class ResidualTest:
    """One correlation function, its bound, and the decision over all its lags.

    Attributes
    ----------
    name : str
        Kind of test, as listed in :func:`residual_tests`.
    input : str or None
        Name of the input it looks at; None where it looks at the residuals alone.
    symbol : str
        The two correlated signals, the later one last, such as ``"u^2, xi"``.
    lags : ndarray of shape (n_lags,)
        Samples from the earlier signal to the residual; negative where the residual comes first.
    correlation : ndarray of shape (n_lags,)
        Correlation coefficients, between -1 and 1.
    bound : ndarray of shape (n_lags,)
        Half-width of the confidence band. Under the null hypothesis the whole function stays inside
        with probability ``1 - alpha``.
    p_value : float
        Probability, under the null hypothesis, that some lag lies as far out as the farthest here.
    adjusted_p_value : float
        The same after Holm's correction for the number of tests. For ``feedback``, which is no test of
        the model, equal to ``p_value``.
    rejected : bool
        Whether ``adjusted_p_value`` is at or below ``alpha``.
    """

    name: str
    input: str | None
    symbol: str
    lags: np.ndarray
    correlation: np.ndarray
    bound: np.ndarray
    p_value: float
    adjusted_p_value: float
    rejected: bool

    @property
    def lags_outside(self):
        """Lags whose correlation lies outside the bound, farthest first."""
        excess = np.abs(self.correlation) - self.bound
        order = np.argsort(-excess, kind="stable")
        return self.lags[order[: np.count_nonzero(excess > 0)]]


@dataclass(frozen=True, eq=False)
class ResidualTests:
    """Verdict of all residual tests of one output.

    Attributes
    ----------
    tests : tuple of ResidualTest
        The tests of the model.
    feedback : tuple of ResidualTest
        One per input: whether it follows earlier residuals (closed loop). Not part of ``passed``.
    n_samples : int
        Samples that entered.
    alpha : float
        Probability of a false alarm, of each test alone and of ``passed``.
    noise_order : int
        Order of the autoregression that stands for the colour of the residuals in every test but the
        autocorrelation; 0 when they are white.
    skipped : tuple of str
        What could not be tested, and why.
    """

    tests: tuple[ResidualTest, ...]
    feedback: tuple[ResidualTest, ...]
    n_samples: int
    alpha: float
    noise_order: int
    skipped: tuple[str, ...]

    @property
    def passed(self):
        """Whether no test is rejected after Holm's correction."""
        return not any(test.rejected for test in self.tests)

    @property
    def verdict(self):
        """What the tests found and what to try, in words."""
        failed = {(test.name, test.input): test for test in self.tests if test.rejected}
        sentences = []
        for (name, u), test in failed.items():
            if name in _NONLINEAR and ("cross-correlation", u) in failed:
                continue
            sentences.append(_finding(test))
            followers = [failed[key] for key in failed if key[1] == u and key[0] in _NONLINEAR]
            if name == "cross-correlation" and followers:
                sentences.append(
                    f"The tests of {_list_symbols(followers)} fail too, which may only follow from this: "
                    "mend it first."
                )
        if not failed:
            sentences.append(
                f"The residuals pass all {len(self.tests)} tests at the {self.alpha:.3g} level "
                f"(lags up to {self.tests[0].lags[-1]}, {self.n_samples} samples): the tests find nothing "
                "left for the model to explain."
            )
        doubtful = [test for test in self.tests if test.lags_outside.size and not test.rejected]
        if doubtful:
            sentences.append(
                f"Outside its own bound, but not after correction for {len(self.tests)} tests: "
                f"{_list_symbols(doubtful)}; look again on a longer record."
            )
        if self.noise_order and len(failed) > 1:
            sentences.append(
                "The bounds of all tests but the autocorrelation allow for the colour "
                f"(autoregression of order {self.noise_order})."
            )
        # a smooth input that the model misses shows at negative lags too: no sign of feedback then
        missed = {u for name, u in failed if name in ("cross-correlation", "even", "odd")}
        sentences += [_finding(test) for test in self.feedback if test.rejected and test.input not in missed]
        return " ".join([*sentences, *self.skipped])

    def to_frame(self):
        """Return one row per test and lag.

        Returns
        -------
        frame : DataFrame
            Columns ``test``, ``input``, ``signals``, ``lag``, ``correlation``, ``bound``, ``outside``,
            ``p_value`` and ``adjusted_p_value`` (the last two repeat over the lags of a test).
        """
        return pd.concat(
            [
                pd.DataFrame(
                    {
                        "test": test.name,
                        "input": test.input,
                        "signals": test.symbol,
                        "lag": test.lags,
                        "correlation": test.correlation,
                        "bound": test.bound,
                        "outside": np.abs(test.correlation) > test.bound,
                        "p_value": test.p_value,
                        "adjusted_p_value": test.adjusted_p_value,
                    }
                ).astype({"input": object})
                for test in (*self.tests, *self.feedback)
            ],
            ignore_index=True,
        )

    def __str__(self):
        width = max(len(test.symbol) for test in self.tests) + 2
        rows = [f"{'signals':<{width}}  {'p':>8}  {'p (Holm)':>8}  lags outside the bound"]
        for test in self.tests:
            lags = _list_lags(test.lags_outside) if test.lags_outside.size else "none"
            mark = "  rejected" if test.rejected else ""
            rows.append(
                f"{test.symbol:<{width}}  {test.p_value:>8.2g}  {test.adjusted_p_value:>8.2g}  {lags}{mark}"
            )
        return "\n".join([*rows, self.verdict])


def residual_tests(
    residuals,
    X,
    y=None,
    *,
    max_lag=MAX_LAG,
    alpha=0.05,
    sessions=None,
    n_resamples=499,
    random_state=0,
):
    r"""Test whether residuals are white and independent of the inputs.

    Of two signals a and b, centred, each test looks at

    .. math:: \phi_{ab}(\tau) = \frac{\sum_k a_{k-\tau} b_k}{\sqrt{\sum_k a_k^2 \sum_k b_k^2}}

    which has to vanish at every lag when the model explains all that can be explained:

    ====================  =====================  =========  ==================================
    name                  a, b                   lags       fails when the model misses
    ====================  =====================  =========  ==================================
    autocorrelation       xi, xi                 1, ...     dynamics, or a model of the noise
    output-residual       xi^2, (y xi)           1, ...     nonlinear noise terms
    cross-correlation     u, xi                  0, ...     linear dynamics of u
    residual-input        (xi u), xi             1, ...     products of noise and u
    even                  u^2, xi                0, ...     even powers of u
    odd                   u^3, xi                0, ...     odd powers of u
    spread                u^2, xi^2              0, ...     odd and even powers of u
    output-input          u^2, (y xi)            0, ...     nonlinear terms in u and y
    ====================  =====================  =========  ==================================

    The last six are made for each input. Each test has one decision for all its lags, with probability
    ``alpha`` of a false alarm; the overall verdict has it too, by Holm's correction over the tests.

    Parameters
    ----------
    residuals : array-like of shape (n_samples,)
        Measured output minus one-step-ahead prediction, of one output; where the noise is on the output,
        minus the free run, as it colours the errors of one step. `NARXRegressor.residuals` returns those
        that fit. NaN marks samples without a prediction, such as the first ones of a record.
    X : array-like or DataFrame of shape (n_samples, n_inputs), or None
        The inputs; NaN marks gaps. None when the system has no input.
    y : array-like of shape (n_samples,), default=None
        The measured output, in the unit of ``residuals``. With None the two tests that use it are left out.
    max_lag : int, default=25
        Largest lag, in samples.
    alpha : float, default=0.05
        Probability of a false alarm, between 0 and 0.5.
    sessions : array-like of shape (n_samples,), default=None
        Label of the recording each sample belongs to. None: one recording. No product reaches across
        the edge of a session, nor across a sample with NaN.
    n_resamples : int, default=499
        Number of surrogate residuals that calibrate the bounds; at least ``1 / alpha - 1``.
    random_state : int, RandomState instance or None, default=0
        Seed of the surrogates. The default gives the same answer each time.

    Returns
    -------
    result : ResidualTests
        Correlations, bounds, decisions and a verdict in words.

    Raises
    ------
    ValueError
        If lengths differ, a value is infinite, the residuals are constant, there is more than one column
        of residuals, too few samples are left for ``max_lag``, or an option is out of its range.

    Warns
    -----
    ExcitationWarning
        If an input is constant: nothing about it can be tested.

    See Also
    --------
    narx_sklearn.displays.ResidualTestsDisplay : Draw the result.

    Notes
    -----
    The statistic of a test is the largest of :math:`|\sum_k p_k| / \sqrt{\sum_k p_k^2}` over its lags,
    where :math:`p_k` are the products in the sum above. Its law is found by giving shuffled residuals to
    the same computation, with the inputs as recorded: exact at any sample size when the residuals are
    independent and identically distributed, whatever their distribution and however coloured or
    heavy-tailed the inputs. (Of ``output-residual`` and ``output-input`` the prediction stays as it is
    while residuals are shuffled; they are exact for large samples.)

    Because the sum is normalised by its own products, the tests for the mean (autocorrelation,
    cross-correlation, residual-input, even, odd) hold for large samples also when the variance of the
    residuals changes. That change is what ``spread`` looks for, whose sum is normalised by the variances
    of its two signals. Should the residuals turn out coloured, the surrogates of all tests but the
    autocorrelation get that colour (an autoregression), so that colour alone is not taken for missed
    dynamics.

    We depart from the references in these points. Signals are centred before they are squared, so that
    an offset does not turn a square into a copy of the signal. The test ``odd``, of the cube of u less
    its linear part, is new: the others see a missed cube only through its variance. Lags that would blame
    the model for feedback (the input following earlier residuals) form a test of their own that does not
    count. Lags of ``residual-input`` are those of the product, one more than the reference's.

    On the data a model was fitted to, residuals are a little whiter than the noise was, and the tests reject
    less often than ``alpha``.

    Records of more than 10 000 samples are tested in full, and calibrated on ten stretches of them.

    References
    ----------
    Billings, S. A. and Voon, W. S. F. (1986). Correlation based model validity tests for non-linear models.
    International Journal of Control, 44(1), 235-244.

    Billings, S. A. and Zhu, Q. M. (1994). Nonlinear model validation using correlation tests.
    International Journal of Control, 60(6), 1107-1120.

    DiCiccio, C. J. and Romano, J. P. (2017). Robust permutation tests for correlation and regression
    coefficients. Journal of the American Statistical Association, 112(519), 1211-1220.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.analysis.residuals import residual_tests
    >>> rng = np.random.default_rng(0)
    >>> u = rng.normal(size=500)
    >>> xi = rng.normal(size=500) + 0.5 * np.roll(u, 3)  # the model missed u[k-3]
    >>> result = residual_tests(xi, u, max_lag=10)
    >>> result.passed, result.tests[1].name
    (False, 'cross-correlation')
    >>> int(result.tests[1].lags_outside[0])
    3
    """
    _check_options(max_lag, alpha, n_resamples)
    xi, u, y, names = _check_record(residuals, X, y, sessions)
    valid = np.isfinite(xi) & np.isfinite(u).all(axis=1)
    if y is not None:
        valid &= np.isfinite(y)
    reach = segment_reach(valid, sessions)
    _check_length(reach, max_lag)
    xi, record, skipped = standardise(xi[valid], u[valid], None if y is None else y[valid], names, reach)
    observed = correlate(xi, record, max_lag)
    rng = np.random.default_rng(check_random_state(random_state).randint(2**31 - 1))
    noise, draws = calibrate(xi, record, observed, alpha, n_resamples, rng)
    tests, feedback = _judge(observed, draws, names, alpha)
    return ResidualTests(tests, feedback, int(xi.size), alpha, noise.order, skipped)


def _judge(observed, draws, names, alpha):
    """Decide every test; feedback, which is no fault of a model, apart from the others."""
    p_values = {key: p_value_of(sums, draws[key], alpha) for key, sums in observed.items()}
    counted = [key for key in observed if key[0] != "feedback"]
    adjusted = dict(zip(counted, holm(np.array([p_values[key] for key in counted])), strict=True))

    def result(key):
        name, j = key
        sums, kind, u = observed[key], _KINDS[name], None if j is None else names[j]
        lags = np.arange(sums.total.size) + FIRST_LAG[name]
        p_value = float(p_values[key])
        adjusted_p_value = float(adjusted.get(key, p_value))
        correlation = sums.total / sums.norm
        bound = critical_value(draws[key], alpha) * sums.spread / sums.norm
        if name == "feedback":  # its input comes later than the residual: a negative lag, in rising order
            lags, correlation, bound = -lags[::-1], correlation[::-1], bound[::-1]
        return ResidualTest(
            name=name,
            input=u,
            symbol=kind.symbol.format(u=u),
            lags=lags,
            correlation=correlation,
            bound=bound,
            p_value=p_value,
            adjusted_p_value=adjusted_p_value,
            rejected=adjusted_p_value <= alpha,
        )

    feedback = [key for key in observed if key[0] == "feedback"]
    return tuple(map(result, counted)), tuple(map(result, feedback))


def _list_lags(lags):
    """Name at most four lags: ``lags 1, 2, 5, 7 and 3 more``."""
    shown = ", ".join(str(lag) for lag in lags[:4])
    more = f" and {len(lags) - 4} more" if len(lags) > 4 else ""
    return f"{'lag' if len(lags) == 1 else 'lags'} {shown}{more}"


def _list_symbols(tests):
    return ", ".join(f"({test.symbol})" for test in tests)


def _finding(test):
    return _KINDS[test.name].finding.format(u=test.input, lags=_list_lags(test.lags_outside))


def _check_options(max_lag, alpha, n_resamples):
    if not isinstance(max_lag, Integral) or max_lag < 1:
        raise ValueError(f"max_lag is {max_lag!r}, but a whole number of samples, at least 1, is wanted.")
    if not 0.0 < alpha <= 0.5:
        raise ValueError(
            f"alpha is {alpha!r}, but a probability of a false alarm above 0 and at most 0.5 is wanted."
        )
    if not isinstance(n_resamples, Integral) or alpha * (n_resamples + 1) < 1.0:
        raise ValueError(
            f"n_resamples is {n_resamples!r}, but alpha={alpha:g} needs a whole number of at least "
            f"{int(np.ceil(1.0 / alpha)) - 1} surrogates."
        )


def _check_record(residuals, X, y, sessions):
    """Return residuals, inputs (no column for None), output as float arrays, and the inputs' names."""
    xi = _check_column(residuals, "residuals")
    u = np.empty((xi.size, 0)) if X is None else as_signals(X, "X")
    y = None if y is None else _check_column(y, "y")
    lengths = {"residuals": xi, "X": u, "y": y, "sessions": sessions}
    lengths = {name: len(values) for name, values in lengths.items() if values is not None}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} has {n}" for name, n in lengths.items())
        raise ValueError(
            f"Numbers of samples differ: {listed}. Align them, with NaN where a sample has no residual."
        )
    return xi, u, y, signal_names(column_labels(X) or range(u.shape[1]), "u")


def _check_column(values, name):
    values = as_signals(values, name)
    if values.shape[1] != 1:
        raise ValueError(
            f"{name} has {values.shape[1]} columns, but one output is tested at a time. "
            "Call residual_tests once per output."
        )
    return values[:, 0]


def longest_lag(residuals, sessions=None, *, at_most: int = MAX_LAG) -> int:
    """Return the longest lag, up to a limit, that enough residuals reach for `residual_tests`; 0 for none.

    Parameters
    ----------
    residuals : array-like of shape (n_samples,)
        NaN where there is none.
    sessions : array-like of shape (n_samples,), default=None
        One label a sample.
    at_most : int, default=25
        The limit.

    Returns
    -------
    int

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.analysis.residuals import longest_lag
    >>> longest_lag(np.zeros(100)), longest_lag(np.zeros(100), np.arange(100) // 5)
    (25, 4)
    """
    reach = segment_reach(np.isfinite(as_signals(residuals, "residuals")[:, 0]), sessions)
    if reach.size < MIN_PRODUCTS:
        return 0
    return int(np.clip(np.sort(reach)[-MIN_PRODUCTS], 0, at_most))


def _check_length(reach, max_lag):
    n_products = np.count_nonzero(reach >= max_lag)
    if n_products < MIN_PRODUCTS:
        raise ValueError(
            f"The record has {reach.size} usable samples, its longest unbroken segment "
            f"{reach.max(initial=-1) + 1}: lag {max_lag} is reached {n_products} times, but "
            f"{MIN_PRODUCTS} are wanted. Pass a longer record or a smaller max_lag."
        )

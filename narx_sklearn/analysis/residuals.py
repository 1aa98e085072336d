"""Residual analysis: is what the model leaves over only noise, and if not, what is missing?"""

import warnings
from dataclasses import dataclass
from numbers import Integral
from typing import NamedTuple

import numpy as np
import pandas as pd
from numba import njit
from scipy.stats import norm
from sklearn.utils import check_random_state

from narx_sklearn._validation import as_signals, column_labels, signal_names
from narx_sklearn.analysis._surrogates import draw_surrogate, fit_noise_model, segment_reach
from narx_sklearn.exceptions import ExcitationWarning

__all__ = ["ResidualTest", "ResidualTests", "residual_tests"]

MIN_PRODUCTS = 20  # products a correlation needs before its own spread can normalise it
N_CALIBRATION = 10_000  # samples the surrogates use; the null law of the statistic no longer moves beyond
N_WINDOWS = 10  # stretches of a longer record that make up those samples
CONSTANT = 1e-12  # standard deviation, as a share of the largest value, under which a signal is constant


class _Kind(NamedTuple):
    """One kind of test: the lags it starts at, its symbol, and what its failure says."""

    first_lag: int
    symbol: str
    finding: str


_KINDS = {
    "autocorrelation": _Kind(
        1,
        "xi, xi",
        "The residuals are coloured ({lags}). Try more output lags, or extended least squares, which "
        "models the noise.",
    ),
    "output-residual": _Kind(
        1,
        "(y xi), xi^2",
        "The size of the residuals feeds forward ({lags}): the noise enters nonlinearly. Try a higher "
        "degree in the outputs, or extended least squares.",
    ),
    "cross-correlation": _Kind(
        0,
        "{u}, xi",
        "The model misses linear dynamics of input {u} ({lags}). Try input lags that cover them; the "
        "current input (lag 0) is among the candidates only with delay=0.",
    ),
    "residual-input": _Kind(
        1,
        "xi, (xi {u})",
        "Noise and input {u} act as a product ({lags}). Try terms that multiply outputs and {u}.",
    ),
    "even": _Kind(
        0,
        "{u}^2, xi",
        "The model misses an even nonlinear effect of input {u} ({lags}). Try a higher degree at these lags.",
    ),
    "odd": _Kind(
        0,
        "{u}^3, xi",
        "The model misses an odd nonlinear effect of input {u}, such as a cube ({lags}). Try degree 3 or "
        "higher at these lags.",
    ),
    "spread": _Kind(
        0,
        "{u}^2, xi^2",
        "The spread of the residuals follows the size of input {u} ({lags}): a nonlinear effect is missing "
        "(try a higher degree), or the noise itself grows with {u}.",
    ),
    "output-input": _Kind(
        0,
        "(y xi), {u}^2",
        "Output and residual together follow the size of input {u} ({lags}). Try a higher degree and terms "
        "that multiply outputs and {u}.",
    ),
    "feedback": _Kind(
        1,
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
    max_lag=25,
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
    xi, record, skipped = _standardise(xi[valid], u[valid], None if y is None else y[valid], names, reach)
    observed = _sums(xi, record, max_lag)
    rng = np.random.default_rng(check_random_state(random_state).randint(2**31 - 1))
    noise, draws = _calibrate(xi, record, observed, alpha, n_resamples, rng)
    tests, feedback = _judge(observed, draws, names, alpha)
    return ResidualTests(tests, feedback, int(xi.size), alpha, noise.order, skipped)


class _Record(NamedTuple):
    """What surrogates leave as it is: centred signals of unit variance, at the usable samples only."""

    u: dict[int, np.ndarray]  # by column of X; a constant input is absent
    u_squared: dict[int, np.ndarray]  # absent where the square is constant, as of a two-level input
    u_cubed: dict[int, np.ndarray]  # less what u itself explains; absent where that is all
    predicted: np.ndarray | None  # y - xi, in units of the residuals' standard deviation
    reach: np.ndarray  # samples before each one in its segment


class _Sums(NamedTuple):
    """Lagged sums of one test over its lags."""

    total: np.ndarray  # sum of the products p
    spread: np.ndarray  # its standard deviation when p has mean zero
    norm: float  # makes total a correlation coefficient

    @property
    def farthest(self):
        """Largest |total| / spread over the lags: the statistic of the test."""
        return np.max(np.abs(self.total) / np.where(self.spread > 0.0, self.spread, np.inf))


@njit(cache=True, nogil=True)
def _lagged_sums(a, b, reach, max_lag):
    """Sum a[k - tau] * b[k], and the squares of these products, over k for tau = 0..max_lag."""
    total = np.zeros(max_lag + 1)
    square = np.zeros(max_lag + 1)
    for k in range(b.size):
        # lags innermost, the longest first: neighbouring sums and samples, so the loop vectorises
        n_lags = min(reach[k], max_lag) + 1
        past = a[k + 1 - n_lags : k + 1]
        total_k = total[max_lag + 1 - n_lags :]
        square_k = square[max_lag + 1 - n_lags :]
        for i in range(n_lags):
            product = past[i] * b[k]
            total_k[i] += product
            square_k[i] += product * product
    return total[::-1], square[::-1]


def _pairs(xi, record):
    """Return the signals (a, b) of every test, keyed by its name and the column of its input."""
    xi_squared = _centred(xi**2)
    pairs = {("autocorrelation", None): (xi, xi)}
    if record.predicted is not None:
        y_xi = _centred((record.predicted + xi) * xi)
        pairs["output-residual", None] = (xi_squared, y_xi)
    for j, u in record.u.items():
        pairs["cross-correlation", j] = (u, xi)
        pairs["residual-input", j] = (_centred(xi * u), xi)
        if j in record.u_squared:
            u_squared = record.u_squared[j]
            pairs["even", j] = (u_squared, xi)
        if j in record.u_cubed:
            pairs["odd", j] = (record.u_cubed[j], xi)
        if j in record.u_squared:
            pairs["spread", j] = (u_squared, xi_squared)
            if record.predicted is not None:
                pairs["output-input", j] = (u_squared, y_xi)
        pairs["feedback", j] = (xi, u)
    return pairs


def _sums(xi, record, max_lag):
    """Compute the sums of every test."""
    sums = {}
    for (name, j), (a, b) in _pairs(xi, record).items():
        total, square = _lagged_sums(a, b, record.reach, max_lag)
        norm_ab = np.sqrt((a @ a) * (b @ b))
        spread = np.sqrt(square)
        if name == "spread":  # an alarm comes from few large products here; they must not divide themselves
            spread = norm_ab * np.sqrt(_count_products(record.reach, max_lag)) / xi.size
        lags = slice(_KINDS[name].first_lag, None)
        sums[name, j] = _Sums(total[lags], spread[lags], norm_ab)
    return sums


def _count_products(reach, max_lag):
    """Count the samples that reach back by tau = 0..max_lag."""
    counts = np.bincount(np.minimum(reach, max_lag), minlength=max_lag + 1)
    return counts[::-1].cumsum()[::-1]


def _calibrate(xi, record, observed, alpha, n_resamples, rng):
    """Draw the statistic of every test under the null hypothesis, and say with which noise."""
    key = ("autocorrelation", None)
    max_lag = observed[key].total.size
    part = _calibration_part(record, max_lag)

    def draw(noise):
        surrogates = (draw_surrogate(noise, part.reach.size, rng) for _ in range(n_resamples))
        rows = [[s.farthest for s in _sums(xi, part, max_lag).values()] for xi in surrogates]
        return dict(zip(observed, np.sort(rows, axis=0).T, strict=True))

    white = fit_noise_model(xi, record.reach, max_order=0)
    draws = draw(white)
    if _p_value(observed[key], draws[key], alpha) > alpha:
        return white, draws
    coloured = fit_noise_model(xi, record.reach, max_order=max_lag)
    if coloured.order == 0:
        return white, draws
    return coloured, {**draw(coloured), key: draws[key]}


def _calibration_part(record, max_lag):
    """Return the record itself, or evenly spaced stretches of a long one."""
    n_samples = record.reach.size
    length = max(N_CALIBRATION // N_WINDOWS, 20 * max_lag)
    if n_samples <= N_WINDOWS * length:
        return record
    starts = np.linspace(0, n_samples - length, N_WINDOWS).astype(int)
    within = np.arange(length)
    index = np.add.outer(starts, within).ravel()
    return _Record(
        {j: u[index] for j, u in record.u.items()},
        {j: u[index] for j, u in record.u_squared.items()},
        {j: u[index] for j, u in record.u_cubed.items()},
        None if record.predicted is None else record.predicted[index],
        np.minimum(record.reach[index], np.tile(within, N_WINDOWS)),
    )


def _critical_value(draws, alpha):
    """Return the value that a fraction alpha of draws and observation together exceeds."""
    # 1e-9: alpha * (n + 1) is meant to be whole, as 0.05 * 500, whatever the rounding
    return draws[-int(alpha * (draws.size + 1) + 1e-9)]


def _p_value(sums, draws, alpha):
    """Return the rank of the statistic among the draws, continued as a Gaussian tail beyond them."""
    n_above = draws.size - np.searchsorted(draws, sums.farthest)
    p_value = (1 + n_above) / (draws.size + 1)
    if n_above == 0:
        n_lags = sums.total.size
        gaussian = norm.isf((1.0 - (1.0 - alpha) ** (1.0 / n_lags)) / 2.0)
        scale = max(1.0, _critical_value(draws, alpha) / gaussian)
        p_value = min(p_value, n_lags * 2.0 * norm.sf(sums.farthest / scale))
    return p_value


def _holm(p_values):
    """Adjust p-values for the number of tests by Holm's step-down procedure."""
    order = np.argsort(p_values)
    steps = p_values[order] * np.arange(p_values.size, 0, -1)
    adjusted = np.empty_like(p_values)
    adjusted[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return adjusted


def _judge(observed, draws, names, alpha):
    """Decide every test; feedback, which is no fault of a model, apart from the others."""
    p_values = {key: _p_value(sums, draws[key], alpha) for key, sums in observed.items()}
    counted = [key for key in observed if key[0] != "feedback"]
    adjusted = dict(zip(counted, _holm(np.array([p_values[key] for key in counted])), strict=True))

    def result(key):
        name, j = key
        sums, kind, u = observed[key], _KINDS[name], None if j is None else names[j]
        lags = np.arange(sums.total.size) + kind.first_lag
        p_value = float(p_values[key])
        adjusted_p_value = float(adjusted.get(key, p_value))
        correlation = sums.total / sums.norm
        bound = _critical_value(draws[key], alpha) * sums.spread / sums.norm
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


def _centred(values):
    return values - values.mean()


def _scaled(values):
    """Return the centred values in units of their standard deviation, and that; 0 if they are constant."""
    centred = _centred(values)
    scale = np.sqrt(np.mean(centred**2))
    if scale <= CONSTANT * np.max(np.abs(values)):
        return np.zeros_like(values), 0.0
    return centred / scale, scale


def _standardise(xi, u, y, names, reach):
    """Bring all signals to unit variance; leave out, and name, those that do not vary."""
    scaled, scale = _scaled(xi)
    if scale == 0.0:
        raise ValueError(
            f"residuals are constant ({xi[0]:g}) over the {xi.size} usable samples, but a correlation needs "
            "them to vary. Pass the measured output minus its one-step-ahead prediction."
        )
    inputs, squares, cubes, skipped = {}, {}, {}, []
    for j, name in enumerate(names):
        values, spread = _scaled(u[:, j])
        if spread == 0.0:
            sentence = f"Input {name} is constant ({u[0, j]:g}): nothing about it could be tested."
            warnings.warn(sentence + " Use a record in which it moves.", ExcitationWarning, stacklevel=3)
            skipped.append(sentence)
            continue
        inputs[j] = values
        squared, spread = _scaled(values**2)
        if spread:
            squares[j] = squared
        cubed = values**3 - values * np.mean(values**4)  # the cube less what u itself explains
        cubed, spread = _scaled(cubed)
        if spread > CONSTANT:
            cubes[j] = cubed
        hidden = [effect for effect, seen in (("even", squares), ("odd", cubes)) if j not in seen]
        if hidden:
            skipped.append(
                f"Input {name} takes so few values that {' and '.join(hidden)} nonlinear effects of it "
                "cannot be seen on this record."
            )
    predicted = None if y is None else _centred(y - xi) / scale
    return scaled, _Record(inputs, squares, cubes, predicted, reach), tuple(skipped)


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


def _check_length(reach, max_lag):
    n_products = np.count_nonzero(reach >= max_lag)
    if n_products < MIN_PRODUCTS:
        raise ValueError(
            f"The record has {reach.size} usable samples, its longest unbroken segment "
            f"{reach.max(initial=-1) + 1}: lag {max_lag} is reached {n_products} times, but "
            f"{MIN_PRODUCTS} are wanted. Pass a longer record or a smaller max_lag."
        )

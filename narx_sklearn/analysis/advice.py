"""Advice on what a model lacks: the current input, dead time, longer lags, another sampling period."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.stats import f as fisher

from narx_sklearn._validation import as_signals, check_indexes, check_same_length
from narx_sklearn.analysis.sampling import sampling_advice
from narx_sklearn.identification.one_step.regressors import chunks
from narx_sklearn.identification.one_step.uncertainty import STRETCHES, OneStepScores, one_step_scores
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.simulation import layout_of
from narx_sklearn.model.terms import Term, TermLibrary, Variable

__all__ = ["Advice", "Finding", "advise"]

MORE_LAGS = 3  # lags beyond the model's longest that are tried
ROWS_A_STRETCH = 10  # fewer samples make no stretch whose scatter says anything
INDEPENDENT = 1e-10  # share of a regressor's energy outside the model's terms below which it is rounding


@dataclass(frozen=True)
class Finding:
    """One thing to change, or to know.

    Attributes
    ----------
    subject : {"current input", "earlier input", "dead time", "input lags", "output lags", "sampling"}
        What it is about.
    output : str
        The equation it was found in.
    terms : tuple of str
        Regressors that were tried.
    gain : float
        Share of the one-step residual's energy that they explain; NaN for the sampling.
    p_value : float
        Probability of such a gain by chance; NaN for the sampling.
    advice : str
        What to do, in words.
    """

    subject: str
    output: str
    terms: tuple[str, ...]
    gain: float
    p_value: float
    advice: str


@dataclass(frozen=True)
class Advice:
    """What a record says about the choices behind a model.

    Attributes
    ----------
    findings : tuple of Finding
        The most promising first; empty where there is nothing to advise.
    """

    findings: tuple[Finding, ...]

    def __str__(self) -> str:
        if not self.findings:
            return "Nothing to advise: no lag that was tried explains what the model leaves over."
        lines = [f"{i}. {finding.advice}" for i, finding in enumerate(self.findings, 1)]
        if len(lines) > 1:
            lines.append("Follow the first, fit again and ask again: one thing missing looks like others.")
        return "\n".join(lines)


class _Trial(NamedTuple):
    """Regressors that the model lacks, tried together."""

    subject: str
    signal: str
    lags: tuple[int, ...]

    @property
    def terms(self) -> list[Term]:
        return [Term.of(Variable(self.signal, lag)) for lag in self.lags]


def advise(
    model: NARXModel, X, y, *, sessions=None, level: float = 0.01, smallest_gain: float = 0.01
) -> Advice:
    r"""Say in words what a fitted model seems to lack, by tests of its one-step residual.

    Lagged signals that are not in the model are tried in groups: the current input, inputs before the model's
    earliest and beyond its longest lag, outputs beyond the longest lag. For a group Z, with the model's terms
    and a constant projected out, the scores :math:`s_w = Z_w^T \xi_w` of twelve stretches `w` of the record
    give

    .. math:: F = \frac{K - q}{q (K - 1)} \, K \bar s^T C^{-1} \bar s, \qquad K = 12,

    which is F(q, K - q) distributed where the group explains nothing, whatever the colour of the residual, as
    long as a stretch outlasts its memory. A group must be significant, all trials together at `level`, and
    explain `smallest_gain` of the residual's energy: on a long record trifles are significant.

    Parameters
    ----------
    model : NARXModel
        The fitted model.
    X : array-like of shape (n_samples, n_inputs)
        Inputs it was fitted to.
    y : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Measured outputs; past ones are read, and the present one as what is predicted.
    sessions : array-like of shape (n_samples,), default=None
        One label a sample; no lag reaches across an edge.
    level : float, default=0.01
        Probability of advising anything where nothing is missing.
    smallest_gain : float, default=0.01
        Share of the residual's energy that a group must explain; 0 reports whatever is significant.

    Returns
    -------
    Advice

    Raises
    ------
    ValueError
        If the data do not fit the model, `level` or `smallest_gain` is out of range, or too few samples have
        all lagged values.

    See Also
    --------
    sampling_advice : The sampling period on its own.
    residual_tests : Whether anything is left in the residual, of whatever form.

    References
    ----------
    S. A. Billings, W. S. F. Voon (1986), "Correlation based model validity tests for non-linear models",
    Int. J. Control 44(1), for what residuals tell; H. Hotelling (1931), "The generalization of Student's
    ratio", for the test.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn import NARXRegressor
    >>> from narx_sklearn.analysis.advice import advise
    >>> rng = np.random.default_rng(0)
    >>> u, e = rng.uniform(-1, 1, (2, 1500))
    >>> y = np.zeros(1500)
    >>> for k in range(1, 1500):
    ...     y[k] = 0.5 * y[k - 1] + 0.4 * u[k] + 0.3 * u[k - 1] + 0.02 * e[k]
    >>> narx = NARXRegressor(2, 2, degree=1, refine=False).fit(u[:, None], y)
    >>> advice = advise(narx.model_, u[:, None], y)
    >>> advice.findings[0].subject, round(advice.findings[0].gain, 2)
    ('current input', 1.0)
    """
    if not 0.0 < level < 1.0 or not 0.0 <= smallest_gain < 1.0:
        raise ValueError(
            f"level={level!r} must lie between 0 and 1, smallest_gain={smallest_gain!r} from 0 to below 1."
        )
    check_indexes(X, y)
    X, y = as_signals(X, "X"), as_signals(y, "y")
    check_same_length(X=X, y=y, sessions=sessions)
    for name, columns, signals in (("X", X.shape[1], model.inputs), ("y", y.shape[1], model.outputs)):
        if columns != len(signals):
            raise ValueError(f"{name} has {columns} columns, the model has {len(signals)}: {list(signals)}.")
    findings: list[Finding] = []
    for output in range(len(model.outputs)):
        findings += _lag_findings(model, output, X, y, sessions, level, smallest_gain)
        findings += _sampling_findings(model, output, y, sessions)
    return Advice(tuple(findings))


def _lag_findings(model, output, X, y, sessions, level, smallest_gain) -> list[Finding]:
    """Try all groups of lagged signals in one equation."""
    own = [t for t, value in zip(model.library, model.parameters[:, output], strict=True) if value]
    trials = _trials(model, output, own)
    known = list(dict.fromkeys([Term(), *own]))
    library = TermLibrary(dict.fromkeys([*known, *(term for trial in trials for term in trial.terms)]))
    theta = np.zeros(len(library))
    for term in own:
        theta[library.index(term)] = model.parameters[model.library.index(term), output]
    parts = partial(chunks, library, layout_of(model), X, y, sessions)
    n_rows = sum(part.n_rows for part in parts())
    if n_rows < ROWS_A_STRETCH * STRETCHES:
        raise ValueError(
            f"{n_rows} samples have all lagged values up to {library.max_lag}, but advice needs at least "
            f"{ROWS_A_STRETCH * STRETCHES}. Pass a longer record."
        )
    scores = one_step_scores(parts, theta, output)
    energy = scores.residual_deviation**2 * (n_rows - theta.size)
    inside = [library.index(term) for term in known]
    found = {}
    for trial in trials:
        # lags that stand alone in the model already are no news, and drop out as dependent
        outside = [library.index(term) for term in trial.terms]
        found[trial] = _test(scores, inside, outside, energy)
    name = model.outputs[output]
    findings = []
    for trial, (gain, p_value) in found.items():
        if p_value < level / len(trials) and gain > smallest_gain:
            texts = tuple(str(term) for term in trial.terms)
            words = _words(trial, name, gain, own)
            findings.append(Finding(trial.subject, name, texts, gain, p_value, words))
    findings.sort(key=lambda finding: -finding.gain)
    return findings + _dead_times(model, name, own, found, findings)


def _trials(model: NARXModel, output: int, own: Sequence[Term]) -> list[_Trial]:
    """Return the groups of lagged signals that one equation lacks."""
    trials = []
    for signal in model.inputs:
        lags = _lags(own, signal)
        first, last = min(lags, default=1), max(lags, default=0)
        if first > 0:
            trials.append(_Trial("current input", signal, (0,)))
        if first > 1:
            trials.append(_Trial("earlier input", signal, tuple(range(1, first))))
        trials.append(_Trial("input lags", signal, _beyond(last)))
    signal = model.outputs[output]
    trials.append(_Trial("output lags", signal, _beyond(max(_lags(own, signal), default=0))))
    return trials


def _lags(terms: Sequence[Term], signal: str) -> set[int]:
    return {v.lag for term in terms for v in term.variables if v.signal == signal}


def _beyond(last: int) -> tuple[int, ...]:
    return tuple(range(last + 1, last + 1 + MORE_LAGS))


def _test(scores: OneStepScores, inside: list[int], outside: list[int], energy: float) -> tuple[float, float]:
    """Return the share of the residual's energy that a group explains, and how probable it is by chance."""
    gram = scores.gram
    scale = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    gram, sums = gram / np.outer(scale, scale), scores.sums / scale
    # columns of the group with the model's terms projected out
    A = np.linalg.lstsq(gram[np.ix_(inside, inside)], gram[np.ix_(inside, outside)], rcond=1e-13)[0]
    left = gram[np.ix_(outside, outside)] - gram[np.ix_(outside, inside)] @ A
    values, vectors = np.linalg.eigh(0.5 * (left + left.T))
    kept = values > INDEPENDENT
    q, count = int(kept.sum()), sums.shape[0]
    if q == 0 or not energy > 0.0:
        return 0.0, 1.0
    S = (sums[:, outside] - sums[:, inside] @ A) @ (vectors[:, kept] / np.sqrt(values[kept]))
    gain = float((S.sum(axis=0) ** 2).sum() / energy)
    centred = S - S.mean(axis=0)
    covariance = centred.T @ centred / (count - 1)
    square = count * S.mean(axis=0) @ np.linalg.pinv(covariance, hermitian=True) @ S.mean(axis=0)
    return min(gain, 1.0), float(fisher.sf((count - q) / (q * (count - 1)) * square, q, count - q))


def _words(trial: _Trial, output: str, gain: float, own: Sequence[Term]) -> str:
    """Return the advice that a successful trial gives."""
    share = f"explains {gain:.0%} of what the model leaves of {output}"
    signal, last = trial.signal, trial.lags[-1]
    if trial.subject == "current input":
        return f"{signal}[k], the current input, {share}: pass delay=0 for {signal}."
    if trial.subject == "earlier input":
        first = min(_lags(own, signal))
        return (
            f"{signal} acts before lag {first}, the first in the model: what lies between {share}. "
            f"Pass a delay below {first} for {signal}."
        )
    kind = "input_lags" if trial.subject == "input lags" else "output_lags"
    return (
        f"{signal} at lags {trial.lags[0]} to {last}, beyond the model's longest, {share}: pass "
        f"{kind}={last} or more."
    )


def _dead_times(model, output, own, found, findings) -> list[Finding]:
    """Report inputs that act late, where nothing says that they act earlier."""
    late = []
    missed = {(finding.subject, signal) for finding in findings for signal in _signals(finding)}
    for signal in model.inputs:
        first = min(_lags(own, signal), default=0)
        earlier = [trial for trial in found if trial.signal == signal and trial.subject == "earlier input"]
        if not earlier or missed & {("earlier input", signal), ("current input", signal)}:
            continue
        gain, p_value = found[earlier[0]]
        words = (
            f"{signal} acts on {output} from lag {first} on, a dead time of {first} samples: with "
            f"delay={first} for {signal} the search has fewer candidates and loses nothing."
        )
        texts = tuple(str(term) for term in earlier[0].terms)
        late.append(Finding("dead time", output, texts, gain, p_value, words))
    return late


def _signals(finding: Finding) -> set[str]:
    return set(Term.parse(finding.terms[0]).signals) if finding.terms else set()


def _sampling_findings(model: NARXModel, output: int, y: np.ndarray, sessions) -> list[Finding]:
    """Report a sampling period that does not suit the output."""
    advice = sampling_advice(y[:, output], model.sampling_period or 1.0, sessions=sessions)
    if advice.decimation == 1:
        return []
    words = advice.verdict
    if model.sampling_period is None:
        words = (
            f"The samples are about {advice.decimation} times denser than the dynamics of "
            f"{model.outputs[output]} need: neighbouring ones are nearly equal, which harms the choice of "
            f"terms. Record with a longer period, or keep every {advice.decimation}th sample after a "
            "low-pass filter, unless the system has hysteresis."
        )
    return [Finding("sampling", model.outputs[output], (), np.nan, np.nan, words)]

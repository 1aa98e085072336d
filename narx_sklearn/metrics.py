"""Errors of simulated outputs and the effort of compensation inputs.

All functions follow scikit-learn's manner: ``metric(y_true, y_pred, *, sample_weight, multioutput)``, so
that ``sklearn.metrics.make_scorer`` makes scorers of them.
"""

import numpy as np

from narx_sklearn._validation import as_signals, check_choice, session_slices

__all__ = ["fit_percent", "mape", "nrmse", "nsavi", "rmse"]

DIVERGED_SCORE = -1e6  # score of a free run that left the finite range: finite, so that searches can rank it


def rmse(y_true, y_pred, *, sample_weight=None, multioutput="uniform_average"):
    r"""Compute the root mean square error, in the unit of the output.

    .. math:: \sqrt{\tfrac{1}{N} \sum_k (y_k - \hat y_k)^2}

    Parameters
    ----------
    y_true : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Measured output. A sample that is NaN is a gap and is left out.
    y_pred : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Simulated or predicted output. Infinities give an infinite error.
    sample_weight : array-like of shape (n_samples,), default=None
        Weights, or a boolean mask: a sample of weight 0 is left out, whatever it holds.
    multioutput : str or array-like of shape (n_outputs,), default="uniform_average"
        One value per output (``"raw_values"``), their mean, or their mean with these weights.

    Returns
    -------
    error : float or ndarray of shape (n_outputs,)
        Zero for a perfect model.

    Raises
    ------
    ValueError
        If shapes differ, no sample is left, or a prediction that counts is NaN.

    Examples
    --------
    >>> from narx_sklearn.metrics import rmse
    >>> rmse([0.0, 0.0, 1.0, 2.0], [9.0, 0.0, 1.0, 4.0], sample_weight=[0, 1, 1, 0])
    0.0
    >>> round(rmse([0.0, 0.0], [3.0, 4.0]), 4)
    3.5355
    """
    columns = _columns(y_true, y_pred, sample_weight)
    return _combine([_rms(y - y_hat, w) for y, y_hat, w in columns], multioutput)


def nrmse(y_true, y_pred, *, normalization="std", sample_weight=None, multioutput="uniform_average"):
    r"""Compute the root mean square error relative to the size of the output.

    .. math:: \sqrt{\frac{\sum_k (y_k - \hat y_k)^2}{\sum_k (y_k - \bar y)^2}}

    Parameters
    ----------
    y_true : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Measured output. A sample that is NaN is a gap and is left out.
    y_pred : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Simulated or predicted output. Infinities give an infinite error.
    normalization : {"std", "range"}, default="std"
        Divide by the standard deviation of the measured output or by its range.
    sample_weight : array-like of shape (n_samples,), default=None
        Weights, or a boolean mask: a sample of weight 0 is left out, whatever it holds.
    multioutput : str or array-like of shape (n_outputs,), default="uniform_average"
        One value per output (``"raw_values"``), their mean, or their mean with these weights.

    Returns
    -------
    error : float or ndarray of shape (n_outputs,)
        Zero for a perfect model; with ``"std"``, 1 for one that knows only the mean.

    Raises
    ------
    ValueError
        If shapes differ, no sample is left, a prediction that counts is NaN, an output is constant, or
        the normalization is not known.

    See Also
    --------
    fit_percent : The same, turned round and in percent.

    Examples
    --------
    >>> from narx_sklearn.metrics import nrmse
    >>> nrmse([1.0, 2.0, 3.0], [2.0, 2.0, 2.0])
    1.0
    """
    check_choice(normalization, "normalization", ("std", "range"))
    columns = _columns(y_true, y_pred, sample_weight)
    size = _std if normalization == "std" else _range
    return _combine([_rms(y - y_hat, w) / _varying(size, y, w) for y, y_hat, w in columns], multioutput)


def fit_percent(y_true, y_pred, *, sample_weight=None, multioutput="uniform_average"):
    r"""Compute the fit in percent, as MATLAB's ``compare`` shows it.

    .. math:: 100 \left(1 - \frac{\lVert y - \hat y \rVert}{\lVert y - \bar y \rVert}\right)

    Parameters
    ----------
    y_true : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Measured output. A sample that is NaN is a gap and is left out.
    y_pred : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Simulated or predicted output. Infinities give a fit of minus infinity.
    sample_weight : array-like of shape (n_samples,), default=None
        Weights, or a boolean mask: a sample of weight 0 is left out, whatever it holds.
    multioutput : str or array-like of shape (n_outputs,), default="uniform_average"
        One value per output (``"raw_values"``), their mean, or their mean with these weights.

    Returns
    -------
    fit : float or ndarray of shape (n_outputs,)
        100 for a perfect model, 0 for one that knows only the mean, negative for a worse one.

    Raises
    ------
    ValueError
        If shapes differ, no sample is left, a prediction that counts is NaN, or an output is constant.

    See Also
    --------
    nrmse : The ratio in the equation.

    Examples
    --------
    >>> from narx_sklearn.metrics import fit_percent
    >>> fit_percent([1.0, 2.0, 3.0], [1.5, 2.0, 2.5])
    50.0
    """
    error = nrmse(y_true, y_pred, sample_weight=sample_weight, multioutput=multioutput)
    return 100.0 * (1.0 - error)


def mape(y_true, y_pred, *, sample_weight=None, multioutput="uniform_average"):
    r"""Compute the mean absolute error in percent of the range of the output.

    .. math:: \mathrm{MAPE} = \frac{100 \sum_k |y_k - \hat y_k|}{N \, |\max y - \min y|}

    Unlike scikit-learn's metric of a similar name, it does not divide by each sample, so a signal
    that crosses zero does no harm.

    Parameters
    ----------
    y_true : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Measured output. A sample that is NaN is a gap and is left out.
    y_pred : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Simulated or predicted output. Infinities give an infinite error.
    sample_weight : array-like of shape (n_samples,), default=None
        Weights, or a boolean mask: a sample of weight 0 is left out, also of the range.
    multioutput : str or array-like of shape (n_outputs,), default="uniform_average"
        One value per output (``"raw_values"``), their mean, or their mean with these weights.

    Returns
    -------
    error : float or ndarray of shape (n_outputs,)
        Percent; zero for a perfect model.

    Raises
    ------
    ValueError
        If shapes differ, no sample is left, a prediction that counts is NaN, or an output is constant.

    References
    ----------
    Abreu, P. E. O. G. B. (2021). Identification and compensator design using NARX models. Ph.D. thesis,
    Universidade Federal de Minas Gerais, eq. (5.10).

    Examples
    --------
    >>> from narx_sklearn.metrics import mape
    >>> mape([0.0, 1.0, 2.0, 4.0], [0.0, 1.0, 2.0, 3.0])
    6.25
    """
    columns = _columns(y_true, y_pred, sample_weight)
    errors = [
        100.0 * np.average(np.abs(y - y_hat), weights=w) / _varying(_range, y, w) for y, y_hat, w in columns
    ]
    return _combine(errors, multioutput)


def nsavi(reference, compensation, *, sessions=None, multioutput="uniform_average"):
    r"""Compute the effort of a compensation input relative to its reference.

    .. math:: \mathrm{NSAVI} = \frac{\sum_{k=1}^{N-1} |m_{k+1} - m_k|}{\sum_{k=1}^{N-1} |r_{k+1} - r_k|}

    the total path the input travels, over that of the reference.

    Parameters
    ----------
    reference : array-like of shape (n_samples,) or (n_samples, n_inputs)
        Reference r, the input that would be applied without compensation. NaN marks gaps.
    compensation : array-like of shape (n_samples,) or (n_samples, n_inputs)
        Compensation input m. NaN marks gaps.
    sessions : array-like of shape (n_samples,), default=None
        Label of the recording each sample belongs to; no step from one to the next is counted.
    multioutput : str or array-like of shape (n_outputs,), default="uniform_average"
        One value per input, their mean, or their mean with these weights.

    Returns
    -------
    effort : float or ndarray of shape (n_inputs,)
        1 without compensation; larger when the input moves more than the reference.

    Raises
    ------
    ValueError
        If shapes differ or the reference does not move.

    Notes
    -----
    The reference prints a sum of ratios, which is infinite wherever the reference rests; the tabulated
    values are those of the ratio of sums used here.

    References
    ----------
    Abreu, P. E. O. G. B. (2021). Identification and compensator design using NARX models. Ph.D. thesis,
    Universidade Federal de Minas Gerais, eq. (5.15).

    Examples
    --------
    >>> from narx_sklearn.metrics import nsavi
    >>> nsavi([0.0, 1.0, 2.0, 1.0], [0.0, 2.0, 3.0, 1.0])
    1.6666666666666667
    """
    r, m = as_signals(reference, "reference"), as_signals(compensation, "compensation")
    _check_shapes(r, "reference", m, "compensation")
    step_r, step_m = np.abs(np.diff(r, axis=0)), np.abs(np.diff(m, axis=0))
    known = np.isfinite(step_r) & np.isfinite(step_m)
    for piece in session_slices(sessions, r.shape[0])[1:]:
        known[piece.start - 1] = False
    path_r, path_m = step_r.sum(axis=0, where=known), step_m.sum(axis=0, where=known)
    if not np.all(path_r > 0.0):
        raise ValueError(
            f"The reference does not move in column {int(np.argmin(path_r))}, so no effort can be compared "
            "with its own. Pass a reference that changes."
        )
    return _combine(path_m / path_r, multioutput)


def r2_score_of(error: np.ndarray, scatter: np.ndarray) -> float:
    """Return R^2 from sums of squares of each output, (n_outputs,), as the score of a free run.

    As scikit-learn has it, a constant output is predicted either exactly (1) or not (0).
    """
    varies = scatter > 0
    r2 = np.where(varies, 1.0 - error / np.where(varies, scatter, 1.0), np.where(error > 0, 0.0, 1.0))
    return float(max(r2.mean(), DIVERGED_SCORE))


def _rms(error, weight):
    return np.sqrt(np.average(error**2, weights=weight))


def _std(y, weight):
    return _rms(y - np.average(y, weights=weight), weight)


def _range(y, weight):
    return np.ptp(y)


def _varying(size, y, weight):
    """Return the size of an output, refusing one that does not vary."""
    if np.ptp(y) == 0.0:
        raise ValueError(
            f"y_true is constant ({y[0]:g}) over the {y.size} samples that count, and the error is "
            "relative to how much it varies. Use rmse, or samples in which it moves."
        )
    return size(y, weight)


def _check_shapes(first, first_name, second, second_name):
    if first.shape != second.shape:
        raise ValueError(
            f"{first_name} has shape {first.shape} and {second_name} has shape {second.shape} "
            "(samples, columns); they must be equal."
        )


def _columns(y_true, y_pred, sample_weight):
    """Return, per output, the measured and predicted samples that count and their weights."""
    y_true = as_signals(y_true, "y_true")
    y_pred = np.asarray(y_pred, dtype=np.float64)  # may be infinite: a run that diverged
    y_pred = y_pred.reshape(-1, 1) if y_pred.ndim == 1 else y_pred
    _check_shapes(y_true, "y_true", y_pred, "y_pred")
    n_samples = y_true.shape[0]
    weight = np.ones(n_samples) if sample_weight is None else np.asarray(sample_weight, dtype=np.float64)
    if weight.shape != (n_samples,):
        raise ValueError(f"sample_weight has shape {weight.shape}, but ({n_samples},) is wanted.")
    if not np.all(weight >= 0.0):
        raise ValueError("sample_weight holds negative or NaN values; weights must be 0 or larger.")
    columns = []
    for j in range(y_true.shape[1]):
        counts = np.isfinite(y_true[:, j]) & (weight > 0.0)
        if not counts.any():
            raise ValueError(
                f"No sample of output {j} is left: all {n_samples} are NaN in y_true or have weight 0."
            )
        missing = np.flatnonzero(counts & np.isnan(y_pred[:, j]))
        if missing.size:
            raise ValueError(
                f"y_pred is NaN at {missing.size} samples of output {j} that count, the first at index "
                f"{missing[0]}. If they are not meant to be scored, pass "
                "sample_weight=~numpy.isnan(y_pred) (one value per sample)."
            )
        columns.append((y_true[counts, j], y_pred[counts, j], weight[counts]))
    return columns


def _combine(values, multioutput):
    """Return the values of the outputs, or their mean, as scikit-learn's ``multioutput`` says."""
    values = np.asarray(values, dtype=np.float64)
    if isinstance(multioutput, str):
        check_choice(multioutput, "multioutput", ("raw_values", "uniform_average"))
        return values if multioutput == "raw_values" else float(values.mean())
    weights = np.asarray(multioutput, dtype=np.float64)
    if weights.shape != values.shape:
        raise ValueError(
            f"multioutput has {weights.size} weights, but there are {values.size} outputs; "
            "pass one per output."
        )
    return float(np.average(values, weights=weights))

"""Diagnosis of a fleet: which machines show an effect, how its parameters differ, whether they drift."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from scipy.stats import beta, chi2, norm, t
from sklearn.base import clone

from narx_sklearn.discrepancy.records.record import read_record
from narx_sklearn.discrepancy.regressor import DiscrepancyRegressor
from narx_sklearn.discrepancy.results import Finding
from narx_sklearn.identification.free_run.many import named_recordings

__all__ = ["FleetDiagnosis", "PooledEstimate", "diagnose_fleet", "pool_estimates"]

OWN = "(simulator)"  # stands for the effect where a parameter is the simulator's own
MISSING = ("explained", "ambiguous", "unknown")  # verdicts that say physics is missing


@dataclass(frozen=True, eq=False)
class PooledEstimate:
    """Parameters of several machines as draws from a population.

    Attributes
    ----------
    n : int
        Number of machines.
    mean, low, high : float
        Mean of the population and its confidence interval, in the unit of the parameter.
    between : float
        Standard deviation between machines, what their own errors explain taken off (0: none is seen).
    p_differ : float
        Chance of differences as large as these if the machines were alike.
    next_low, next_high : float
        Interval in which the parameter of a further machine is expected.
    slope, slope_low, slope_high : float
        Drift: change for one step of the order, and its confidence interval.
    p_drift : float
        Chance of a slope as large as this without drift.
    """

    n: int
    mean: float
    low: float
    high: float
    between: float
    p_differ: float
    next_low: float
    next_high: float
    slope: float
    slope_low: float
    slope_high: float
    p_drift: float


@dataclass(frozen=True, eq=False)
class FleetDiagnosis:
    """What a fleet shows.

    Attributes
    ----------
    machines : pandas.DataFrame
        One row for each recording: ``verdict``, ``p_value`` (that nothing is missing), ``q_value`` (the
        same, adjusted for the number of recordings after Benjamini and Hochberg), ``effects`` found.
    effects : pandas.DataFrame
        One row for each effect and place: ``n_showing`` recordings that name it (not as what only comes
        nearest), their ``share`` with its interval ``low``, ``high``, ``n_compatible`` recordings that name
        a look-alike of it instead, and ``recordings`` that name it.
    values : pandas.DataFrame
        One row for each parameter in each recording: ``value`` and ``standard_error`` in ``unit``. The
        simulator's own parameters have the effect ``"(simulator)"``.
    parameters : pandas.DataFrame
        One row for each parameter: the fields of `PooledEstimate`, with the unit. NaN where too few
        recordings estimate it.
    level : float
        Confidence level of all intervals.
    """

    machines: pd.DataFrame
    effects: pd.DataFrame
    values: pd.DataFrame
    parameters: pd.DataFrame
    level: float


class _One(NamedTuple):
    """What is kept of the diagnosis of one recording."""

    verdict: str
    p_value: float
    findings: list[Finding]
    own: pd.DataFrame
    level: float

    @property
    def told(self) -> list[Finding]:
        """Findings that count across recordings: no name that only comes nearest in its own."""
        return [finding for finding in self.findings if finding.stands or finding.effect == "unknown"]


def diagnose_fleet(
    estimator: DiscrepancyRegressor, recordings, *, order=None, level: float = 0.95, n_jobs: int | None = None
) -> FleetDiagnosis:
    """Diagnose one simulator on many recordings, and compare what is found.

    Every recording is diagnosed on its own, through joblib. The parameters that the recordings estimate are
    then taken as draws from a population: with :math:`x_i` the estimate of machine i and :math:`s_i` its
    standard error,

    .. math:: x_i = \\mu + \\beta (t_i - \\bar t) + b_i + e_i, \\quad b_i \\sim N(0, \\tau^2),
              \\quad e_i \\sim N(0, s_i^2),

    so that differences between machines are told apart from the errors of their estimates, and a drift over
    the order of recording from both.

    Parameters
    ----------
    estimator : DiscrepancyRegressor
        What to do with each recording; it is not changed.
    recordings : mapping or list of (X, y)
        The recordings, by name or in order. `by_session` cuts one record at its sessions.
    order : array-like of shape (n_recordings,), default=None
        When each was recorded, in any unit of time; None counts them.
    level : float, default=0.95
        Confidence level of the intervals.
    n_jobs : int, default=None
        Recordings diagnosed at the same time; results do not depend on it.

    Returns
    -------
    FleetDiagnosis

    Raises
    ------
    ValueError
        If a recording cannot be diagnosed (the message names it), ``order`` has another length, or ``level``
        is not between 0 and 1.
    TypeError
        If ``estimator`` is no `DiscrepancyRegressor`.

    See Also
    --------
    pool_estimates : The summary of one parameter.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn import DiscrepancyRegressor, ODESimulator
    >>> from narx_sklearn.discrepancy.fleet import diagnose_fleet
    >>> def tank(x, u, p):
    ...     return (p[0] * u[0] - p[1] * x[0],)
    >>> about = dict(dt=0.1, states=["level [m]"], inputs=["flow [L/s]"])
    >>> rng = np.random.default_rng(0)
    >>> recordings = []
    >>> for outflow in (0.5, 0.6, 0.7):
    ...     u = np.repeat(rng.uniform(0, 2, 60), 10)
    ...     true = ODESimulator(tank, parameters={"gain": 1.0, "outflow [1/s]": outflow}, **about)
    ...     recordings.append((u, true.simulate(u)[:, 0] + 0.01 * rng.normal(size=u.size)))
    >>> nominal = ODESimulator(tank, parameters={"gain": 1.0, "outflow [1/s]": 0.6}, **about)
    >>> dx = DiscrepancyRegressor(nominal, effects=["quadratic_drag"])
    >>> fleet = diagnose_fleet(dx, recordings)
    >>> fleet.parameters.set_index("parameter").loc["outflow", ["slope"]].round(2).tolist()
    [0.1]
    """
    if not isinstance(estimator, DiscrepancyRegressor):
        raise TypeError(f"estimator must be a DiscrepancyRegressor, got {type(estimator).__name__}.")
    if not 0.0 < level < 1.0:
        raise ValueError(f"level must lie between 0 and 1, got {level!r}.")
    named = named_recordings(recordings)
    times = _times(order, len(named))
    for name, (X, y) in named.items():  # all of them before the first, for each takes its time
        with _telling_of(name):
            read_record(X, y, estimator.simulator)
    found = Parallel(n_jobs=n_jobs)(
        delayed(_diagnose)(estimator, name, X, y) for name, (X, y) in named.items()
    )
    by_name = dict(zip(named, found, strict=True))
    values = _value_table(by_name, times)
    return FleetDiagnosis(
        _machine_table(by_name),
        _effect_table(by_name, level),
        values,
        _parameter_table(values, level),
        float(level),
    )


def pool_estimates(values, errors, order=None, *, level: float = 0.95) -> PooledEstimate:
    """Summarise estimates of one parameter from several machines.

    The variance between machines is DerSimonian and Laird's; intervals are Student's with the scale of
    Hartung and Knapp, which keeps its level with few machines.

    Parameters
    ----------
    values : array-like of shape (n_machines,)
        Estimates.
    errors : array-like of shape (n_machines,)
        Their standard errors, above zero.
    order : array-like of shape (n_machines,), default=None
        When each was recorded; None counts them.
    level : float, default=0.95
        Confidence level.

    Returns
    -------
    PooledEstimate
        Intervals are NaN with one machine, those of the slope with two.

    Raises
    ------
    ValueError
        If lengths differ, or a standard error is not above zero.

    References
    ----------
    R. DerSimonian, N. Laird (1986), "Meta-analysis in clinical trials", Controlled Clinical Trials 7;
    G. Knapp, J. Hartung (2003), "Improved tests for a random effects meta-regression with a single
    covariate", Statistics in Medicine 22.

    Examples
    --------
    >>> from narx_sklearn.discrepancy.fleet import pool_estimates
    >>> pooled = pool_estimates([1.0, 2.0, 3.0], [0.1, 0.1, 0.1])
    >>> round(pooled.mean, 6), round(pooled.between**2, 6)
    (2.0, 0.99)
    """
    x, s = np.asarray(values, dtype=float), np.asarray(errors, dtype=float)
    when = _times(order, x.size)
    if x.shape != s.shape or x.ndim != 1 or not x.size:
        raise ValueError(
            f"values and errors must be vectors of one length, got shapes {x.shape} and {s.shape}."
        )
    if not np.all(s > 0):
        raise ValueError(f"errors must all be above zero, got {float(s.min())}.")
    tail = 0.5 + level / 2
    one = _regress(x, s, np.ones((x.size, 1)))
    mean, width = float(one.coefficients[0]), np.nan
    next_width = np.nan
    if x.size > 1:
        width = float(t.ppf(tail, x.size - 1) * np.sqrt(one.covariance[0, 0]))
        next_width = float(t.ppf(tail, x.size - 1) * np.sqrt(one.covariance[0, 0] + one.between))
    slope, slope_width, p_drift = np.nan, np.nan, np.nan
    if x.size > 2 and np.ptp(when) > 0:
        line = _regress(x, s, np.column_stack([np.ones(x.size), when - when.mean()]))
        slope, error = float(line.coefficients[1]), float(np.sqrt(line.covariance[1, 1]))
        slope_width = float(t.ppf(tail, x.size - 2)) * error
        p_drift = float(2 * t.sf(abs(slope) / error, x.size - 2)) if error > 0 else float(slope == 0.0)
    return PooledEstimate(
        n=x.size,
        mean=mean,
        low=mean - width,
        high=mean + width,
        between=float(np.sqrt(one.between)),
        p_differ=float(chi2.sf(one.scatter, x.size - 1)) if x.size > 1 else np.nan,
        next_low=mean - next_width,
        next_high=mean + next_width,
        slope=slope,
        slope_low=slope - slope_width,
        slope_high=slope + slope_width,
        p_drift=p_drift,
    )


class _Regression(NamedTuple):
    coefficients: np.ndarray
    covariance: np.ndarray
    between: float  # variance between machines
    scatter: float  # weighted squares about the line, chi-squared where machines are alike


def _regress(x: np.ndarray, s: np.ndarray, Z: np.ndarray) -> _Regression:
    """Fit x = Z beta + b + e, b of unknown variance, e of standard errors s."""
    freedom = x.size - Z.shape[1]
    w = 1.0 / s**2
    inverse = np.linalg.inv(Z.T * w @ Z)
    scatter = float(w @ (x - Z @ (inverse @ (Z.T @ (w * x)))) ** 2)
    # expected scatter is freedom + between * slack (method of moments)
    slack = w.sum() - np.trace(inverse @ (Z.T * w**2 @ Z))
    between = max((scatter - freedom) / slack, 0.0) if freedom > 0 else 0.0
    w = 1.0 / (s**2 + between)
    inverse = np.linalg.inv(Z.T * w @ Z)
    coefficients = inverse @ (Z.T @ (w * x))
    scale = w @ (x - Z @ coefficients) ** 2 / freedom if freedom > 0 else np.nan
    return _Regression(coefficients, inverse * scale, between, scatter)


def _times(order, n: int) -> np.ndarray:
    times = np.arange(n, dtype=float) if order is None else np.asarray(order, dtype=float)
    if times.shape != (n,):
        raise ValueError(f"order must hold one number for each of {n} recordings, got shape {times.shape}.")
    return times


@contextmanager
def _telling_of(name: Any) -> Iterator[None]:
    """Name the recording in which something is wrong."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"Recording {name!r}: {error}") from error


def _diagnose(estimator: DiscrepancyRegressor, name: Any, X, y) -> _One:
    """Diagnose one recording."""
    with _telling_of(name):
        dx = clone(estimator).fit(X, y)
    own = pd.DataFrame(
        {
            "unit": dx.parameters_["unit"],
            "value": dx.parameters_["augmented"],
            "low": dx.parameters_["augmented_low"],
            "high": dx.parameters_["augmented_high"],
        }
    )
    return _One(dx.verdict_, dx.p_value_, dx.findings_, own, float(dx.level))


def _machine_table(found: dict[Any, _One]) -> pd.DataFrame:
    p = np.array([one.p_value for one in found.values()])
    return pd.DataFrame(
        {
            "verdict": [one.verdict for one in found.values()],
            "p_value": p,
            "q_value": _adjusted(p),
            "effects": [", ".join(f"{f.effect} {f.place}" for f in one.findings) for one in found.values()],
        },
        index=pd.Index(found, name="recording"),
    )


def _adjusted(p: np.ndarray) -> np.ndarray:
    """Return Benjamini and Hochberg's adjusted p-values."""
    order = np.argsort(p)
    raised = p[order] * p.size / np.arange(1, p.size + 1)
    adjusted = np.empty(p.size)
    adjusted[order] = np.minimum(np.minimum.accumulate(raised[::-1])[::-1], 1.0)
    return adjusted


def _effect_table(found: dict[Any, _One], level: float) -> pd.DataFrame:
    showing: dict[tuple[str, str], list] = {}
    for name, one in found.items():
        for finding in one.told if one.verdict in MISSING else []:
            showing.setdefault((finding.effect, finding.place), []).append(name)
    rows = []
    for (effect, place), names in showing.items():
        k, n = len(names), len(found)
        compatible = [
            name
            for name, one in found.items()
            if name not in names and any(effect in f.lookalikes for f in one.told)
        ]
        tail = 0.5 - level / 2
        # Clopper and Pearson's interval
        low = float(beta.ppf(tail, k, n - k + 1))
        high = 1.0 if k == n else float(beta.ppf(1 - tail, k + 1, n - k))
        rows.append((effect, place, k, k / n, low, high, len(compatible), names))
    columns = ["effect", "place", "n_showing", "share", "low", "high", "n_compatible", "recordings"]
    return pd.DataFrame(rows, columns=columns).sort_values(
        "n_showing", ascending=False, ignore_index=True, kind="stable"
    )


def _value_table(found: dict[Any, _One], times: np.ndarray) -> pd.DataFrame:
    rows = []
    for (name, one), time in zip(found.items(), times, strict=True):
        half = norm.ppf(0.5 + one.level / 2)  # width of half an interval, in standard errors

        def error_of(value, low, high, half=half):
            return max(high - value, value - low) / half  # a bound may have cut one half short

        for parameter, row in one.own.iterrows():
            error = error_of(row["value"], row["low"], row["high"])
            rows.append((name, time, OWN, "", parameter, row["value"], error, row["unit"]))
        for f in one.told:
            for parameter, value in f.parameters.items():
                error = error_of(value, *f.intervals[parameter])
                rows.append((name, time, f.effect, f.place, parameter, value, error, f.units[parameter]))
    columns = ["recording", "order", "effect", "place", "parameter", "value", "standard_error", "unit"]
    return pd.DataFrame(rows, columns=columns)


def _parameter_table(values: pd.DataFrame, level: float) -> pd.DataFrame:
    rows = []
    for key, group in values.groupby(["effect", "place", "parameter", "unit"], sort=False):
        usable = group[np.isfinite(group["value"]) & (group["standard_error"] > 0)]
        if usable.empty:
            continue
        pooled = pool_estimates(usable["value"], usable["standard_error"], usable["order"], level=level)
        rows.append(dict(zip(group.columns[[2, 3, 4, 7]], key, strict=True)) | vars(pooled))
    return pd.DataFrame(rows)

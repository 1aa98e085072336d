"""Spurious term clusters: kinds of terms that a record offers and the system does not hold (2.3.4)."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from narx_sklearn.identification.one_step.estimation import least_squares
from narx_sklearn.identification.one_step.factor import Factor
from narx_sklearn.identification.one_step.selection import EXACT, SelectionPath, search_terms
from narx_sklearn.identification.structure.candidates import cluster_text
from narx_sklearn.model.terms import TermLibrary

__all__ = ["ClusterEvidence", "ClusterReport", "detect_spurious_clusters"]

MAX_TERMS = 20  # sizes followed where no path is given
SMALL_RATIO = 0.25  # "much smaller" than the largest parameter; of clusters that matter we saw 0.7 and more
OSCILLATION = 2  # changes of sign; one may be the way from a poor model to a good one
CERTAIN = 2.0  # standard errors from zero
NEEDED_GROWTH = 1.1  # residual variance without the cluster over that with it: above, the record needs it


@dataclass(frozen=True, eq=False)
class ClusterEvidence:
    """What the growing model says about one term cluster.

    Attributes
    ----------
    cluster : str
        The cluster, such as ``y^2*u``.
    first_size : int
        Number of terms at which it enters the model.
    coefficients : ndarray of shape (n_sizes,)
        Cluster coefficient (sum of the parameters of its terms, Def. 2.2) for every size; NaN where absent.
    standard_error : float
        Of the coefficient at the largest size, residuals taken as white.
    ratio : float
        Absolute coefficient over the largest absolute parameter of the cluster, median over the sizes, from
        the criterion's on, at which it has more than one term; NaN where it never has.
    sign_changes : int
        How often the coefficient changes sign as terms are added.
    growth : float
        By what factor the sum of squared residuals grows when the cluster is no candidate, at the
        criterion's size.
    verdict : {"effective", "doubtful", "spurious"}
        The judgement.
    reason : str
        Why, in words.
    """

    cluster: str
    first_size: int
    coefficients: np.ndarray
    standard_error: float
    ratio: float
    sign_changes: int
    growth: float
    verdict: str
    reason: str


@dataclass(frozen=True, eq=False)
class ClusterReport:
    """Evidence on every term cluster that enters the model.

    Attributes
    ----------
    clusters : tuple of ClusterEvidence
        One each, in the order in which they enter.
    sizes : ndarray of shape (n_sizes,)
        Numbers of terms, 0 to the longest.
    chosen_size : int
        Size at the criterion's minimum; what enters later is late.
    """

    clusters: tuple[ClusterEvidence, ...]
    sizes: np.ndarray
    chosen_size: int

    @property
    def spurious(self) -> list[str]:
        """Clusters judged spurious, ready for ``NARXRegressor(exclude=...)``."""
        return [one.cluster for one in self.clusters if one.verdict == "spurious"]

    @property
    def doubtful(self) -> list[str]:
        """Clusters that the evidence leaves open."""
        return [one.cluster for one in self.clusters if one.verdict == "doubtful"]

    def to_frame(self) -> pd.DataFrame:
        """Return one row for each cluster; the coefficients are in `coefficients`."""
        columns = ["cluster", "first_size", "ratio", "sign_changes", "growth", "verdict", "reason"]
        rows = [[getattr(one, name) for name in columns] for one in self.clusters]
        return pd.DataFrame(rows, columns=columns).set_index("cluster")

    def coefficients(self) -> pd.DataFrame:
        """Return the cluster coefficients: one row for each size, one column for each cluster."""
        return pd.DataFrame(
            {one.cluster: one.coefficients for one in self.clusters},
            index=pd.Index(self.sizes, name="n_terms"),
        )

    def __str__(self) -> str:
        return self.to_frame().to_string(float_format="{:.3g}".format)


def detect_spurious_clusters(
    factor: Factor,
    library: TermLibrary,
    path: SelectionPath | None = None,
    *,
    output: int = 0,
    criterion: str = "ebic",
    scales=None,
) -> ClusterReport:
    """Judge which term clusters are spurious, by how their coefficients behave as the model grows.

    Terms enter one by one, in the order of their ERR, well past the size that a criterion would choose.
    Signs of a spurious cluster are that it enters late (property iii of section 2.3.4) or that other terms
    serve as well; that its coefficient is much smaller than its parameters, which cancel (iv), or cannot be
    told from zero; and that the coefficient oscillates about zero (v). Two of these make a cluster
    spurious, one makes it doubtful. A cluster whose absence raises the residual variance by more than a
    tenth is doubtful at most: ``u[k-1] - u[k-2]`` has a vanishing coefficient, and may be the physics.

    Parameters
    ----------
    factor : Factor
        Compressed record of all candidate terms.
    library : TermLibrary
        The candidate terms, the factor's columns.
    path : SelectionPath, default=None
        Sets of terms for every size; None takes the forward ERR order up to 20 terms.
    output : int, default=0
        Which output.
    criterion : str, default="ebic"
        Criterion after whose minimum a cluster enters late; see `information_criterion`.
    scales : array-like of shape (n_terms,), default=None
        What turns the factor's parameters into those of measured units, where it was made from scaled
        signals; the verdicts do not depend on it.

    Returns
    -------
    ClusterReport

    Raises
    ------
    ValueError
        If factor, library and path do not belong together.

    References
    ----------
    L. A. Aguirre and S. A. Billings (1995), "Improved structure selection for nonlinear models based on
    term clustering", Int. J. Control 62(3); P. E. O. G. B. Abreu (2020), section 2.3.4.

    Notes
    -----
    The references describe the signs (iii) to (v) and leave the judgement to the reader. The thresholds are
    ours, and so are the standard error and the comparison with models that lack the cluster. Clusters of
    signals that count from an operating point are those of the deviations from it.

    Examples
    --------
    >>> import numpy as np
    >>> import pandas as pd
    >>> from narx_sklearn.identification.one_step.factor import Factor
    >>> from narx_sklearn.identification.validation.spurious import detect_spurious_clusters
    >>> from narx_sklearn.identification.transformers import TermTransformer
    >>> rng = np.random.default_rng(0)
    >>> u = rng.uniform(-1, 1, 400)
    >>> y = np.zeros(400)
    >>> for k in range(2, 400):
    ...     y[k] = 0.6 * y[k - 1] + 0.2 * y[k - 2] + u[k - 1] + 0.3 * u[k - 1] * u[k - 2] + 0.1 * rng.normal()
    >>> signals = pd.DataFrame({"y": y, "u": u})
    >>> terms = TermTransformer(lags=3, degree=2)
    >>> Psi = terms.fit_transform(signals)[3:]
    >>> report = detect_spurious_clusters(Factor.of(Psi, y[3:]), terms.library_)
    >>> report.chosen_size, report.spurious
    (4, ['y*u', 'y^2'])

    ``NARXRegressor(exclude=report.spurious)`` then looks for terms outside these clusters.
    """
    if factor.n_terms != len(library):
        raise ValueError(
            f"The factor has {factor.n_terms} terms and the library {len(library)}; they must agree."
        )
    if path is None:
        path = search_terms(factor, MAX_TERMS, search="forward", output=output)
    elif path.n_candidates != len(library):
        raise ValueError(
            f"The path chose from {path.n_candidates} terms and the library has {len(library)}; pass the "
            "path of the same candidates, or None."
        )
    scales = np.ones(len(library)) if scales is None else np.asarray(scales, dtype=float)
    parameters = _parameters_by_size(factor, path, output) * scales
    chosen_size = path.best_size(criterion)
    floor = EXACT * path.total
    clusters = np.array([cluster_text(term.cluster) for term in library])
    found = []
    for cluster in dict.fromkeys(clusters.tolist()):
        own = clusters == cluster
        if np.isfinite(parameters[:, own]).any():
            others = factor.subset(np.flatnonzero(~own))
            without = search_terms(others, chosen_size, search="floating", output=output).rss[-1]
            growth = float((without + floor) / (path.rss[chosen_size] + floor))
            if abs(without - path.rss[chosen_size]) <= floor:
                growth = 1.0  # which of two exact models leaves less is rounding
            error = _standard_error(factor, path, np.where(own, scales, 0.0), floor)
            found.append(_examine(cluster, parameters[:, own], chosen_size, error, growth))
    found.sort(key=lambda one: one.first_size)
    return ClusterReport(tuple(found), path.sizes, chosen_size)


def _parameters_by_size(factor: Factor, path: SelectionPath, output: int) -> np.ndarray:
    """Return the parameters of every set of a path, shape (n_sizes, n_terms); NaN where absent."""
    parameters = np.full((len(path.supports), factor.n_terms), np.nan)
    for size, support in enumerate(path.supports):
        if support:
            columns = sorted(support)
            parameters[size, columns] = least_squares(factor.subset(columns), output=output)[0]
    return parameters


def _standard_error(factor: Factor, path: SelectionPath, weights: np.ndarray, floor: float) -> float:
    """Return the standard error of a weighted sum of the parameters of the largest set (white residuals).

    The residuals of an exact model are rounding, of at least the ``floor``.
    """
    columns = sorted(path.supports[-1])
    R = factor.subset(columns).Psi
    norms = np.linalg.norm(R, axis=0)
    direction = np.linalg.pinv(R / norms).T @ (weights[columns] / norms)
    spare = max(path.n_samples - len(columns), 1)
    return float(np.sqrt((path.rss[-1] + floor) / spare) * np.linalg.norm(direction))


def _examine(
    cluster: str, parameters: np.ndarray, chosen_size: int, error: float, growth: float
) -> ClusterEvidence:
    """Judge one cluster by its parameters at every size, shape (n_sizes, n_own_terms)."""
    present = np.isfinite(parameters)
    inside = present.any(axis=1)
    first_size = int(np.argmax(inside))
    coefficients = np.where(inside, np.nansum(parameters, axis=1), np.nan)
    several = (present.sum(axis=1) > 1) & (np.arange(inside.size) >= chosen_size)
    largest = np.nanmax(np.abs(parameters[several]), axis=1)
    ratio = float(np.median(np.abs(coefficients[several]) / largest)) if several.any() else np.nan
    sign_changes = int(np.count_nonzero(np.diff(np.sign(coefficients[inside]))))
    signs = []
    if first_size > chosen_size:
        signs.append(f"it enters at {first_size} terms, after the criterion's minimum at {chosen_size}")
    elif growth <= 1.0:
        signs.append(f"other terms do as well without it, at the criterion's {chosen_size} terms")
    if ratio < SMALL_RATIO:
        signs.append(f"its coefficient is {ratio:.2g} of its largest parameter")
    elif abs(coefficients[-1]) < CERTAIN * error:
        signs.append(f"its coefficient cannot be told from zero ({coefficients[-1]:.2g} +- {error:.2g})")
    if sign_changes >= OSCILLATION:
        signs.append(f"its coefficient changes sign {sign_changes} times")
    needed = growth > NEEDED_GROWTH
    if needed and signs:
        signs.append(f"but without it the residual variance is {growth:.3g} times as large")
    verdict = "effective" if not signs else "spurious" if len(signs) > 1 and not needed else "doubtful"
    reason = (
        "; ".join(signs) or "it enters early, with a coefficient of one sign and the size of its parameters"
    )
    return ClusterEvidence(
        cluster, first_size, coefficients, error, ratio, sign_changes, growth, verdict, reason
    )

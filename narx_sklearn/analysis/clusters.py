"""Term clusters and their coefficients: a model seen with its lags forgotten."""

from dataclasses import dataclass

import pandas as pd

from narx_sklearn.identification.structure.candidates import cluster_text
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.polynomials import Polynomial
from narx_sklearn.model.terms import Term, Variable

__all__ = ["TermCluster", "TermClusters", "term_clusters"]


@dataclass(frozen=True)
class TermCluster:
    """The terms of a model that differ only in their lags, and the sum of their coefficients.

    Attributes
    ----------
    name : str
        Powers of the signals, such as ``"y^2*u"``; the constant's is ``"1"``.
    terms : tuple of Term
        Its terms, in canonical order.
    coefficients : tuple of float
        Their coefficients.
    """

    name: str
    terms: tuple[Term, ...]
    coefficients: tuple[float, ...]

    @property
    def coefficient(self) -> float:
        """The cluster coefficient: the sum of the coefficients."""
        return sum(self.coefficients)


@dataclass(frozen=True)
class TermClusters:
    """All term clusters of one output of a model.

    Attributes
    ----------
    output : str
        Name of the output.
    clusters : tuple of TermCluster
        The clusters, by degree, then in reading order.
    representation : Polynomial
        Clustering representation (2.29): each cluster as one term, every signal at its shortest lag.
    """

    output: str
    clusters: tuple[TermCluster, ...]
    representation: Polynomial

    def __getitem__(self, name: str) -> TermCluster:
        for cluster in self.clusters:
            if cluster.name == name:
                return cluster
        raise KeyError(f"{self.output} has no cluster {name!r}; it has {[c.name for c in self.clusters]}.")

    def to_text(self, digits: int = 5) -> str:
        """Return the clustering representation and, below it, the terms of each cluster."""
        lines = [f"{self.output}[k] ≈ {self.representation.to_text(digits)}"]
        for cluster in self.clusters:
            terms = ", ".join(map(str, cluster.terms))
            lines.append(f"  {cluster.name}: {cluster.coefficient:.{digits}g} from {terms}")
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.to_text()

    def to_frame(self) -> pd.DataFrame:
        """Return one row a cluster: coefficient, number of terms, terms."""
        return pd.DataFrame(
            {
                "cluster": [c.name for c in self.clusters],
                "coefficient": [c.coefficient for c in self.clusters],
                "n_terms": [len(c.terms) for c in self.clusters],
                "terms": [", ".join(map(str, c.terms)) for c in self.clusters],
            }
        )


def term_clusters(model: NARXModel, *, output: str | None = None) -> TermClusters:
    r"""Group the terms of a model into clusters and sum their coefficients.

    Sampled fast, a signal is about the same at all lags, and the model about

    .. math:: y_k \approx \sum_{p, m, q} \Sigma_{y^p u^m \phi^q}\, y_{k-1}^p u_{k-\tau_d}^m \phi_{k-1}^q .

    At rest this is exact. A cluster with a small coefficient beside large ones of both signs is a sign of
    spurious terms.

    Parameters
    ----------
    model : NARXModel
        The model. Its terms are taken as written, in deviations from its origin if it has one;
        ``model.expanded()`` gives the clusters in signals as measured.
    output : str, default=None
        Which output; None is the first.

    Returns
    -------
    TermClusters

    Raises
    ------
    ValueError
        If the model has no such output.

    References
    ----------
    Aguirre and Billings (1995); Lacerda Junior (2021), Definition 2.2 and eq. (2.29).

    Examples
    --------
    >>> from narx_sklearn.analysis import term_clusters
    >>> from narx_sklearn.model import NARXModel
    >>> model = NARXModel.from_equations("0.5*y[k-1] + 0.1*y[k-2]*u[k-4] + 0.2*y[k-1]*u[k-1]")
    >>> clusters = term_clusters(model)
    >>> print(clusters)
    y[k] ≈ 0.5*y[k-1] + 0.3*y[k-1]*u[k-1]
      y: 0.5 from y[k-1]
      y*u: 0.3 from y[k-1]*u[k-1], y[k-2]*u[k-4]
    >>> round(clusters["y*u"].coefficient, 12)
    0.3
    """
    output = model.outputs[0] if output is None else output
    if output not in model.outputs:
        raise ValueError(f"output={output!r} is not an output of the model; it has {list(model.outputs)}.")
    equation = model.equation(output)
    shortest: dict[str, int] = {}
    for variable in equation.variables:
        shortest[variable.signal] = min(variable.lag, shortest.get(variable.signal, variable.lag))
    members: dict[Term, list[tuple[Term, float]]] = {}
    for term, value in equation.items:
        at_shortest_lags = Term(tuple((Variable(s, shortest[s]), e) for s, e in term.cluster))
        members.setdefault(at_shortest_lags, []).append((term, value))
    clusters = tuple(
        TermCluster(cluster_text(key.cluster), *zip(*members[key], strict=True))
        for key in sorted(members, key=lambda term: term.order)
    )
    representation = Polynomial((key, value) for key, group in members.items() for _, value in group)
    return TermClusters(output, clusters, representation)

"""Does a model stay where it is when the input stops? The continuum of steady states."""

from dataclasses import dataclass

import numpy as np

from narx_sklearn.analysis._held import (
    NEGLIGIBLE,
    companion_eigenvalues,
    hold,
    output_slopes,
    rest_polynomials,
    resting_phi,
)
from narx_sklearn.identification.structure.candidates import cluster_text
from narx_sklearn.identification.structure.hysteresis import hysteresis_structure, vanishes_at_rest
from narx_sklearn.model.narx import NARXModel

__all__ = ["Continuum", "continuum_of_steady_states"]


@dataclass(frozen=True, eq=False)
class Continuum:
    """Whether a model has a continuum of steady states, and why.

    Attributes
    ----------
    exists : bool
        The verdict.
    reason : str
        The verdict's reason in words.
    output_sums : ndarray of shape (n_outputs, n_outputs)
        Sums of the linear output coefficients at rest, those of output j in equation i at [i, j].
    eigenvalues : ndarray of shape (n_eigenvalues,)
        Eigenvalues of the Jacobian at the operating point, complex, largest modulus first.
    other_radius : float
        Largest modulus of the eigenvalues besides those at 1 that make the continuum.
    violations : tuple of str
        Term clusters that Assumption 4.1 does not allow. They do no harm where they cancel at rest.
    """

    exists: bool
    reason: str
    output_sums: np.ndarray
    eigenvalues: np.ndarray
    other_radius: float
    violations: tuple[str, ...]

    def __str__(self) -> str:
        lines = [f"continuum of steady states: {'yes' if self.exists else 'no'}, {self.reason}"]
        if self.violations:
            lines.append(f"  clusters against Assumption 4.1: {', '.join(self.violations)}")
        return "\n".join(lines)


def continuum_of_steady_states(model: NARXModel) -> Continuum:
    r"""Tell whether a model can rest at any output, so that it remembers when the input stops.

    At rest differences and signs vanish. When nothing is left but linear output terms whose coefficients
    sum to 1, :math:`\bar y = \bar y` holds for every output; when all other eigenvalues of the Jacobian lie
    inside the unit circle, the output converges to the one it has reached. Without this a model of a
    hysteretic machine drifts, or collapses to one value, when the input stops.

    Parameters
    ----------
    model : NARXModel
        The model.

    Returns
    -------
    Continuum
        With ``print``, the verdict in words. A model without it can still rest at many outputs through phi
        regressors with memory (plays, the hysteretic operator), which is said.

    Notes
    -----
    The equation at rest itself is looked at, not the list of Assumption 4.1: clusters whose coefficients
    cancel, such as ``u[k-1] - u[k-2]``, do no harm. The eigenvalues are those at the operating point; with
    several outputs there are as many eigenvalues at 1 as dimensions of the continuum.

    References
    ----------
    Lacerda Junior (2021), Definition 2.5, Lemma 4.1 and Remark 4.1; Morris (2011).

    Examples
    --------
    >>> from narx_sklearn.analysis import continuum_of_steady_states
    >>> from narx_sklearn.model import Difference, NARXModel
    >>> phi = [Difference("u", name="phi1")]
    >>> held = NARXModel.from_equations("1.3*y[k-1] - 0.3*y[k-2] + 0.8*phi1[k-1]", phi=phi)
    >>> print(continuum_of_steady_states(held))
    continuum of steady states: yes, the output coefficients sum to 1 and the other eigenvalues lie within 0.3
    >>> continuum_of_steady_states(NARXModel.from_equations("0.9*y[k-1] + 0.8*phi1[k-1]", phi=phi)).exists
    False
    """
    used = {variable.signal for variable in model.library.variables}
    memory = {str(p.name) for p in model.phi if p.has_memory and p.name in used}
    vanishing = {str(p.name): 0.0 for p in model.phi if str(p.name) not in memory and vanishes_at_rest(p)}
    sides = rest_polynomials(model, vanishing)
    left = _clusters_left(model, sides)
    slopes = output_slopes(_at_operating_point(model, memory))
    eigenvalues = companion_eigenvalues(slopes[None])[0]
    eigenvalues = eigenvalues[np.argsort(-np.abs(eigenvalues), kind="stable")]
    sums = slopes.sum(axis=0)
    gap = np.linalg.svd(np.eye(len(sums)) - sums, compute_uv=False)
    n_free = int(np.sum(gap <= NEGLIGIBLE * (1.0 + np.abs(slopes).sum())))
    others = np.delete(eigenvalues, np.argsort(np.abs(eigenvalues - 1.0))[:n_free])
    other_radius = float(np.abs(others).max(initial=0.0))
    exists, reason = _verdict(sums, n_free, others.size, other_radius, left, memory)
    return Continuum(exists, reason, sums, eigenvalues, other_radius, _violations(model))


def _verdict(
    sums, n_free: int, n_others: int, other_radius: float, left: set[str], memory: set[str]
) -> tuple[bool, str]:
    if n_free and not left:
        if other_radius >= 1.0:
            return False, (
                f"the output coefficients sum to 1, but another eigenvalue has modulus {other_radius:.5g}"
            )
        others = f"the other eigenvalues lie within {other_radius:.5g}"
        others = others if n_others else "there is no other eigenvalue"
        return True, f"the output coefficients sum to 1 and {others}"
    if memory and other_radius < 1.0 and not n_free:
        return True, f"held by the memory of {', '.join(sorted(memory))}, not by Lemma 4.1"
    if left and n_free:
        return False, f"{', '.join(sorted(left))} keep{'s' * (len(left) == 1)} acting when the input stops"
    total = f"{sums[0, 0]:.8g}" if sums.size == 1 else f"{np.round(sums, 6).tolist()}"
    return False, f"the output coefficients sum to {total}, which is not 1"


def _clusters_left(model: NARXModel, sides) -> set[str]:
    """Return what acts at rest besides linear outputs."""
    return {
        cluster_text(term.cluster)
        for side in sides.values()
        for term, _ in side.items
        if term.degree != 1 or not term.signals <= set(model.outputs)
    }


def _at_operating_point(model: NARXModel, memory: set[str]):
    levels = np.array([[model.origin.get(name, 0.0) for name in model.inputs]])
    return hold(
        model,
        1,
        lambda signal, lag: levels[:, model.inputs.index(signal)],
        resting_phi(model, levels),
        {name: 0.0 for name in memory if name in model._output_phis},
    )


def _violations(model: NARXModel) -> tuple[str, ...]:
    """Return the clusters of the model that the structure "hysteresis" would not have."""
    keep = hysteresis_structure(model.outputs, model.inputs, model.phi)
    used = [term for term, row in zip(model.library, model.parameters, strict=True) if row.any()]
    return tuple(dict.fromkeys(cluster_text(term.cluster) for term in used if not keep(term)))

"""Whether a compensation law keeps or amplifies errors of its own input: its free-run Jacobian."""

import warnings
from dataclasses import dataclass

import numpy as np

from narx_sklearn.compensation import _kernels as kernels
from narx_sklearn.compensation.law import CompensationLaw
from narx_sklearn.exceptions import NarxWarning

__all__ = ["AmplificationWarning", "LawStability", "law_stability"]

N_CHECKED = 2000  # most samples at which the Jacobian is evaluated, spread over the reference
FORGOTTEN = 1e6  # growth of an error beyond which the end of a run is its divergence
STEP = 1e-6  # of the range of the inputs: the difference quotients' step
TOLERATED = 1e-3  # growth a sample beyond 1 that counts: a thousandfold error in seven thousand samples


class AmplificationWarning(NarxWarning):
    """A compensator amplifies errors of its own input; the message says by how much and where."""


@dataclass(frozen=True)
class LawStability:
    """How a law passes on small errors of its past inputs, along one reference.

    Attributes
    ----------
    samples : ndarray of shape (n_checked,)
        Samples at which the Jacobian was evaluated.
    radius : ndarray of shape (n_checked,)
        Spectral radius of the Jacobian there; above 1 errors grow at this sample.
    growth : float
        Factor a sample by which an error grows on the average of the whole reference. A law that keeps its
        rest passes errors on unchanged, growth 1; a law that forgets them has less.
    is_stable : bool
        Whether ``growth`` does not exceed 1 by more than a thousandth.
    """

    samples: np.ndarray
    radius: np.ndarray
    growth: float
    is_stable: bool

    @property
    def share_growing(self) -> float:
        """Share of the samples at which errors grow."""
        return float(np.mean(self.radius > 1.0 + TOLERATED))

    def __str__(self) -> str:
        verdict = "stable" if self.is_stable else "amplifies"
        return (
            f"{verdict}: errors change by {self.growth:.4g} a sample on the average; they grow at "
            f"{100 * self.share_growing:.0f} % of the samples, by at most {self.radius.max():.4g} at sample "
            f"{self.samples[self.radius.argmax()]}"
        )


def law_stability(law: CompensationLaw, reference, *, m: float = 0.0) -> LawStability:
    r"""Evaluate the Jacobian of a law's own recursion along a reference.

    A law computes :math:`m_k = f(m_{k-1}, \dots, m_{k-n}; r)`. Errors of the past inputs are passed on by the
    companion matrix of :math:`\partial m_k / \partial m_{k-j}`, and the product of these matrices along the
    reference says whether they die out. A law can be an exact inverse of its model and yet amplify, where
    the model forgets what the law must remember.

    Parameters
    ----------
    law : CompensationLaw
        The law, such as ``compensator.law_``.
    reference : array-like of shape (n_samples,) or (n_samples, n_known)
        Reference.
    m : float, default=0.0
        Input held before the first sample.

    Returns
    -------
    LawStability

    Raises
    ------
    TypeError
        If ``law`` is no law, such as the compensator that has it.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.compensation import isolated_law, law_stability
    >>> from narx_sklearn.model import NARXModel
    >>> law = isolated_law(NARXModel.from_equations("0.5*y[k-1] + u[k-1] + 1.1*u[k-2]"))
    >>> found = law_stability(law, np.sin(np.arange(200) / 10))
    >>> found.is_stable, round(found.growth, 6)
    (False, 1.1)
    """
    if not isinstance(law, CompensationLaw):
        raise TypeError(
            f"law must be a CompensationLaw, got {type(law).__name__}. Of a fitted compensator pass "
            "compensator.law_."
        )
    known = np.ascontiguousarray(np.asarray(reference, dtype=float).reshape(-1, len(law.known)))
    every = max(1, -(-known.shape[0] // N_CHECKED))  # rounded up, so that the samples checked reach the end
    n_checked = -(-known.shape[0] // every)
    state, ahead = law.begin(known, m)
    inputs = law.run(known, m=m).m
    size = np.ptp(inputs) or np.abs(inputs).max() or 1.0
    slopes = np.zeros((n_checked, law.n_past_inputs))
    integers, numbers = law.packed
    unlimited = numbers.copy()
    unlimited[2] = np.inf  # a limit that cuts an error hides that the law amplifies it
    if law.method != "search":
        unlimited[:2] = -np.inf, np.inf
    arguments = (integers, numbers, unlimited, state.values, ahead, STEP * size, every, slopes)
    if law.functions is None:
        kernels.slopes_along(*arguments)
    else:
        kernels.with_functions().slopes_along(law.functions, *arguments)
    return _summarise(slopes, every)


def warn_if_amplifying(law: CompensationLaw, reference, *, m: float) -> LawStability:
    """Return the stability of a law along a reference, warning where it amplifies."""
    found = law_stability(law, reference, m=m)
    if not found.is_stable:
        warnings.warn(
            f"The compensator amplifies its own errors: they grow {found.growth:.4g}-fold a sample on the "
            f"average, most at sample {found.samples[found.radius.argmax()]} "
            f"({found.radius.max():.4g}-fold). Limits and a rate limit bound the damage; better use "
            "RootCompensator or InverseCompensator, or a model with fewer past inputs.",
            AmplificationWarning,
            stacklevel=3,
        )
    return found


def _summarise(slopes: np.ndarray, every: int) -> LawStability:
    n_checked, n_past = slopes.shape
    companions = np.zeros((n_checked, n_past, n_past))
    companions[:, 0] = slopes
    companions[:, np.arange(1, n_past), np.arange(n_past - 1)] = 1.0
    companions[~np.isfinite(companions)] = 0.0
    radius = np.abs(np.linalg.eigvals(companions)).max(axis=1)
    direction, grown = np.ones(n_past) / np.sqrt(n_past), 0.0
    for i, companion in enumerate(companions):
        direction = companion @ direction
        size = np.linalg.norm(direction)
        if size == 0.0:  # all errors are forgotten, or a run that left the finite range is held
            grown = grown if grown > np.log(FORGOTTEN) else -np.inf
            n_checked = max(i, 1)
            break
        grown += np.log(size)
        direction /= size
    growth = float(np.exp(grown / n_checked))
    samples = np.arange(radius.size) * every
    return LawStability(samples, radius, growth, growth <= 1.0 + TOLERATED)

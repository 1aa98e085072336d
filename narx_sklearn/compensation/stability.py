"""Whether a compensation law keeps or amplifies errors of its own input: its free-run Jacobian."""

import warnings
from dataclasses import dataclass

import numpy as np

from narx_sklearn.compensation import _kernels as kernels
from narx_sklearn.compensation.law import INPUT, CompensationLaw, UnreachableWarning
from narx_sklearn.exceptions import NarxWarning
from narx_sklearn.model.kernels import ASYMMETRIC_SIGN, DIFFERENCE_SIGN

__all__ = ["AmplificationWarning", "LawStability", "law_stability"]

N_CHECKED = 2000  # most samples at which the Jacobian is evaluated, spread over the reference
FORGOTTEN = 1e6  # growth of an error beyond which the end of a run is its divergence
STEP = 1e-6  # of the range of the inputs: the difference quotients' step
RESTING = 1e-9  # of the largest input: less is no motion but rounding
RUN_AWAY = 1e3  # ranges of the input, beyond which a law that amplifies has run away
WAYS_OUT = (
    "Limits and a rate limit bound the damage; better use a model with fewer past inputs, or "
    "InverseCompensator, with a longer lead if it is one."
)
JUMPS = (DIFFERENCE_SIGN, ASYMMETRIC_SIGN)  # elements that have no derivative at rest
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
    return _stability_along(law, reference, m)


def _stability_along(law: CompensationLaw, reference, m: float, size: float | None = None) -> LawStability:
    """Return `law_stability`; ``size`` is the range of the inputs, None takes that of the run itself."""
    known = np.ascontiguousarray(np.asarray(reference, dtype=float).reshape(-1, len(law.known)))
    every = max(1, -(-known.shape[0] // N_CHECKED))  # rounded up, so that the samples checked reach the end
    n_checked = -(-known.shape[0] // every)
    state, ahead = law.begin(known, m)
    if size is None:
        inputs = law.run(known, m=m).m
        largest = np.abs(inputs).max()
        moved = np.ptp(inputs)
        size = float(moved if moved > RESTING * largest else largest or 1.0)
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


def warn_if_amplifying_at_rest(law: CompensationLaw, known: np.ndarray, *, m: float) -> None:
    """Warn where a law amplifies small errors about a steady state; known signals and input are held there.

    A law that does not rest there, or that jumps where its input turns, has no Jacobian to be looked at.
    """
    if any(e.kind in JUMPS and e.signal == INPUT for e in law.elements):
        return
    held = np.tile(known, (law.horizon + law.n_past_inputs + 2, 1))
    run = law.run(held, m=m)
    if run.counts.no_solution or np.abs(run.m - m).max() > STEP * (1.0 + abs(m)):
        return
    radius = law_stability(law, held, m=m).radius[-1]
    if radius > 1.0 + TOLERATED:
        warnings.warn(
            f"The compensator amplifies its own errors: it computes an input from those before, and where "
            f"{m:.4g} holds the output at {known[0]:.4g} their errors grow {radius:.4g}-fold a sample. Along "
            f"a reference that moves the input runs away. {WAYS_OUT}",
            AmplificationWarning,
            stacklevel=3,
        )


def warn_if_run_away(law: CompensationLaw, reference, inputs: np.ndarray, held) -> bool:
    """Tell whether a law ran away along a reference because it amplifies its errors, warning where it did.

    Parameters
    ----------
    law : CompensationLaw
        The law.
    reference : ndarray of shape (n_samples, n_known)
        Reference and other known signals.
    inputs : ndarray of shape (n_samples,)
        What the law gave.
    held : sequence of float
        Inputs between which such a reference is usually followed, the one held before the first sample first.
    """
    low, high = min(held), max(held)
    size = (high - low) or max(abs(low), abs(high)) or 1.0
    beyond = np.maximum(inputs - high, low - inputs) > RUN_AWAY * size
    if not beyond.any():
        return False
    first = int(beyond.argmax())
    radius = np.median(_stability_along(law, reference[: first + 1], held[0], size).radius)
    if radius <= 1.0 + TOLERATED:  # a machine that follows slowly wants large inputs
        return False
    warnings.warn(
        f"The law runs away: its usual inputs are {low:.4g} to {high:.4g}, but from sample {first} of "
        f"{inputs.size} on the input lies beyond {RUN_AWAY:g} times that range, and goes as far as "
        f"{np.abs(inputs).max():.3g}. It computes an input from those before and amplifies their errors "
        f"{radius:.4g}-fold a sample. {WAYS_OUT}",
        UnreachableWarning,
        stacklevel=3,
    )
    return True


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

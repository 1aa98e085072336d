"""Verdicts on the hysteresis of a model: loop, rest, memory, symmetry, rate."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from scipy.optimize import brentq

from narx_sklearn.analysis._checks import check_driver, inputs_along
from narx_sklearn.analysis.continuum import Continuum, continuum_of_steady_states
from narx_sklearn.analysis.fixed_points import fixed_points
from narx_sklearn.analysis.loops import HysteresisLoop, hysteresis_loop, run_output
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.signals.loading import loading_unloading

__all__ = ["HysteresisReport", "hysteresis_report"]

SLOWDOWNS = (1, 4, 16)  # rates compared, as multiples of the fastest branch
LOOP_OPENING = 0.01  # of the output's range: below this a loop is not seen
CLOSING = 0.5  # a lag closes its loop by 1/4 when the input slows down by 4; hysteresis keeps it
RATE_TOLERANCE = 0.05  # of the output's range, from one rate to the next
ASYMMETRY_TOLERANCE = 0.02  # of the output's range
MEMORY_TOLERANCE = 0.01  # of the output's range
BRANCH_SAMPLES = 200  # shortest branch of the comparison
TIME_CONSTANTS = 10  # of the model that the fastest branch lasts
LONGEST_BRANCH = 20_000  # samples of the fastest branch, however slow the model
AT_ONE = 1e-9  # distance from 1 of an eigenvalue that only keeps the state
MEETING = 0.5  # of the input's range: where histories with other extrema behind them meet
PEAKS = (
    0.55,
    0.7,
    0.9,
)  # last extrema of those histories; a valley near the meeting leaves small plays behind
VALLEYS = 0.2, 0.35, 0.45, 0.48


@dataclass(frozen=True, eq=False)
class HysteresisReport:
    """What kind of hysteresis a model has over a range of its input.

    Attributes
    ----------
    loops : tuple of HysteresisLoop
        Settled loops, from the fastest to the slowest input.
    has_loop : bool
        Whether a loop stays open as the input slows down.
    rate_sensitivity : float
        Largest change of the output from one rate to the next slower, as a share of its range.
    is_rate_dependent : bool
        Whether that is more than 5 %.
    asymmetry : float
        Departure of the slowest loop from symmetry about its centre, as a share of the output's range.
    is_symmetric : bool
        Whether that is at most 2 %.
    memory : str
        ``"local"``: the future depends on the present state alone; ``"non-local"``: also on earlier
        extrema of the input; ``"none"`` without loop; ``"undecided"`` where no two histories meet.
    memory_spread : float
        Largest later distance of two runs that met in one state after different extrema, as a share of the
        output's range; 0 where the structure alone decides.
    continuum : Continuum
        Whether the model can rest anywhere.
    """

    loops: tuple[HysteresisLoop, ...]
    has_loop: bool
    rate_sensitivity: float
    is_rate_dependent: bool
    asymmetry: float
    is_symmetric: bool
    memory: str
    memory_spread: float
    continuum: Continuum

    def to_text(self) -> str:
        """Return the verdicts, one a line, each with its number."""
        slowest = self.loops[-1]
        openings = ", ".join(f"{100 * loop.opening:.3g} %" for loop in self.loops)
        rates = ", ".join(str(loop.samples_per_branch) for loop in self.loops)
        loop = f"yes, {slowest.orientation}" if self.has_loop else "no, it closes as the input slows down"
        lines = [
            f"Hysteresis of {slowest.output} over {slowest.driver} from {slowest.u.min():.5g} to "
            f"{slowest.u.max():.5g}, at {rates} samples a branch",
            f"  loop: {loop} (opening {openings} of the output's range)",
            f"  {self.continuum}",
            f"  memory: {self.memory}"
            + (f" (runs that met part by {100 * self.memory_spread:.2g} %)" if self.memory_spread else ""),
            f"  shape: {'symmetric' if self.is_symmetric else 'asymmetric'} "
            f"({100 * self.asymmetry:.2g} % from symmetry)",
            f"  rate: {'dependent' if self.is_rate_dependent else 'independent'} "
            f"(the output changes by {100 * self.rate_sensitivity:.2g} % from one rate to the next)",
        ]
        drifting = [one.n_periods for one in self.loops if not one.settled]
        if drifting:
            lines.append(f"  not settled after {max(drifting)} periods: the loop still drifts")
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.to_text()


def hysteresis_report(
    model: NARXModel,
    u_min: float,
    u_max: float,
    *,
    samples_per_branch: int | None = None,
    driver: str | None = None,
    output: str | None = None,
    at: Mapping[str, float] | None = None,
) -> HysteresisReport:
    """Tell what hysteresis a model has: loop, rest, memory, symmetry and rate dependence.

    The model is run with a triangular input between two extrema at three rates, each a quarter of the one
    before. A loop that stays open is hysteresis; one that closes is only a lag.

    Parameters
    ----------
    model : NARXModel
        The model.
    u_min, u_max : float
        Extrema of the input, in its unit: the range of the data the model was identified from.
    samples_per_branch : int, default=None
        Samples from one extremum to the other at the fastest rate. None: ten of the model's time constants,
        200 at least.
    driver : str, default=None
        Input that loads and unloads; None is the only one.
    output : str, default=None
        Output to look at; None is the first.
    at : mapping of {str: float}, default=None
        Constant values of the other inputs, in their units; the operating point where not given.

    Returns
    -------
    HysteresisReport
        With ``print``, the verdicts in words.

    Raises
    ------
    ValueError
        If a name is not known, ``u_min`` is not below ``u_max``, or a free run diverges.

    Notes
    -----
    A model without regressors that remember has local memory by its structure (Remark 2.19). With such
    regressors two histories with different extrema are steered to one and the same output at one input, both
    rising; from there they rise on together. If they part, the past extrema mattered (Figure 2.13).

    References
    ----------
    Lacerda Junior (2021), Definition 2.6, sections 2.3.8.1, 2.3.8.2 and 4.2; Mayergoyz (2003).

    Examples
    --------
    >>> from narx_sklearn.analysis import hysteresis_report
    >>> from narx_sklearn.model import NARXModel, Play
    >>> model = NARXModel.from_equations(
    ...     "0.5*phi1[k] + 0.5*phi2[k]", phi=[Play("u", radius=0.5), Play("u", radius=2.0)])
    >>> report = hysteresis_report(model, -5.0, 5.0)
    >>> report.has_loop, report.memory, report.is_symmetric, report.is_rate_dependent
    (True, 'non-local', True, False)
    >>> round(report.loops[-1].opening, 3)
    0.333
    """
    if samples_per_branch is None:
        samples_per_branch = _branch_samples(model, u_min, u_max, driver, at)
    loops = tuple(
        hysteresis_loop(
            model,
            u_min,
            u_max,
            samples_per_branch=samples_per_branch * slowdown,
            driver=driver,
            output=output,
            at=at,
        )
        for slowdown in SLOWDOWNS
    )
    openings = [loop.opening for loop in loops]
    has_loop = openings[-1] > LOOP_OPENING and openings[-1] > CLOSING * openings[-2]
    rate_sensitivity = max(_distance(fast, slow) for fast, slow in pairwise(loops))
    asymmetry = loops[-1].asymmetry
    memory, spread = _memory(loops[0], at) if has_loop else ("none", 0.0)
    return HysteresisReport(
        loops,
        bool(has_loop),
        rate_sensitivity,
        rate_sensitivity > RATE_TOLERANCE,
        asymmetry,
        asymmetry <= ASYMMETRY_TOLERANCE,
        memory,
        spread,
        continuum_of_steady_states(model),
    )


def _branch_samples(model: NARXModel, u_min: float, u_max: float, driver, at) -> int:
    """Return how long a branch must be for the model to follow, from its slowest eigenvalue below 1."""
    middle = inputs_along(model, check_driver(model, driver), np.array([(u_min + u_max) / 2.0]), at)
    held = {str(p.name): 0.0 for p in model.phi if p.has_memory and p.name in model._output_phis}
    points = fixed_points(model, middle[0], phi=held)
    radii = np.abs(np.concatenate([point.eigenvalues for point in points])) if len(points) else np.zeros(0)
    decaying = radii[(radii > 0.0) & (radii < 1.0 - AT_ONE)]
    longest = float(np.max(-1.0 / np.log(decaying), initial=0.0))
    return int(np.clip(np.ceil(TIME_CONSTANTS * longest), BRANCH_SAMPLES, LONGEST_BRANCH))


def _distance(fast: HysteresisLoop, slow: HysteresisLoop) -> float:
    """Return the largest distance between two loops at one input, as a share of the slower's range."""
    if not slow.y_range:
        return 0.0
    pairs = zip(fast.branches()[1:], slow.branches()[1:], strict=True)
    return float(max(np.abs(a - b).max() for a, b in pairs) / slow.y_range)


def _memory(loop: HysteresisLoop, at) -> tuple[str, float]:
    """Return local or non-local memory, and how far runs part that had met in one state."""
    model = loop.model
    used = {variable.signal for variable in model.library.variables}
    if not any(p.has_memory and p.name in used for p in model.phi):
        return "local", 0.0
    met = (_spread(loop, peak, valley, at) for peak, valley in product(PEAKS, VALLEYS))
    spreads = [spread for spread in met if spread is not None]
    if not spreads:
        return "undecided", 0.0
    return ("non-local" if max(spreads) > MEMORY_TOLERANCE else "local"), max(spreads)


def _spread(loop: HysteresisLoop, peak: float, valley: float, at) -> float | None:
    """Return the later distance of two runs that met; None where no reversal makes them meet.

    One run rises to ``peak``, falls to ``valley`` and rises again; the other falls from the largest input to
    the one valley from which it comes up to the same output.
    """
    n_branch, n_last = loop.samples_per_branch, round((1.0 - MEETING) * loop.samples_per_branch)

    def rise(highest, lowest):
        """Return the output from the meeting on, after these two turning points."""
        points = [0.0, 1.0, 0.0, highest, lowest]  # one cycle first, so that all begin alike
        samples = [max(1, round(way * n_branch)) for way in np.abs(np.diff(points))]
        n_first = max(1, round((MEETING - lowest) * n_branch))
        pieces = [
            loading_unloading(points, samples),
            np.linspace(lowest, MEETING, n_first + 1)[1:],
            np.linspace(MEETING, 1.0, n_last + 1)[1:],
        ]
        u = loop.u.min() + np.ptp(loop.u) * np.concatenate(pieces)
        return run_output(loop.model, loop.driver, loop.output, u, at)[-n_last - 1 :]

    one = rise(peak, valley)

    def mismatch(turn):
        return rise(1.0, turn)[0] - one[0]

    range_of_turns = 0.0, MEETING - 1.0 / n_branch
    if mismatch(range_of_turns[0]) * mismatch(range_of_turns[1]) > 0.0:
        return None
    other = rise(1.0, brentq(mismatch, *range_of_turns, xtol=1e-9))
    return float(np.abs(one - other).max() / loop.y_range)

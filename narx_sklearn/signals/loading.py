"""Loading-unloading and quasi-static signals: monotonic branches between turning points."""

import numpy as np

from narx_sklearn._validation import check_choice
from narx_sklearn.signals._checks import check_count, check_positive, check_vector

__all__ = ["loading_unloading", "quasi_static", "reversal_points"]


def loading_unloading(
    turning_points,
    samples_per_branch,
    *,
    shape: str = "triangle",
    n_periods: int | None = None,
) -> np.ndarray:
    """Generate a loading-unloading signal, monotonic from each turning point to the next.

    Parameters
    ----------
    turning_points : sequence of float of shape (n_points,)
        Input values, in its unit, alternately higher and lower; for the signal of the definition
        ``(u_min, u_max)``, any other sequence for minor loops and first-order reversal curves.
    samples_per_branch : int or sequence of int
        Sampling steps from a turning point to the next; one number serves all branches.
    shape : {"triangle", "sine"}, default="triangle"
        Constant rate, or a half cosine, which is smooth at the turning points.
    n_periods : int or None, default=None
        None runs through the turning points once. A number closes the path from the last point back to the
        first and repeats it; the number of points must then be even.

    Returns
    -------
    ndarray of shape (n_samples,)
        It begins at the first turning point. Once through: ``1 + sum(samples_per_branch)`` samples.
        Periodic: ``n_periods * sum(samples_per_branch)`` samples, so that copies join without a double.

    Raises
    ------
    ValueError
        If the turning points do not alternate, or numbers of points and branches disagree.

    Notes
    -----
    In the definition a branch begins and ends at an extremum, which would hold each extremum for two
    samples; but eq. (2.58) wants the input to move at every sample. Here each turning point is one sample,
    and a branch is the samples after it up to and including the next.

    References
    ----------
    Martins and Aguirre (2016); Abreu (2021), Definition 2.8 and eq. (2.58).

    Examples
    --------
    >>> from narx_sklearn.signals import loading_unloading
    >>> loading_unloading([0, 2, 1], 2).tolist()
    [0.0, 1.0, 2.0, 1.5, 1.0]
    """
    points = check_vector(turning_points, "turning_points", smallest_size=2)
    check_choice(shape, "shape", ("triangle", "sine"))
    if n_periods is not None:
        n_periods = check_count(n_periods, "n_periods")
        if points.size % 2:
            raise ValueError(
                f"A period needs an even number of turning points to close, got {points.size}; add a point "
                "or leave n_periods out."
            )
        points = np.append(points, points[0])
    rises = np.sign(np.diff(points))
    if np.any(rises == 0) or np.any(rises[1:] == rises[:-1]):
        raise ValueError(f"turning_points must be alternately higher and lower, got {points.tolist()}.")
    branches = _branch_lengths(samples_per_branch, points.size - 1)
    pieces = [points[:1]]
    for start, end, n in zip(points[:-1], points[1:], branches, strict=True):
        way = np.arange(1, n + 1) / n
        if shape == "sine":
            way = 0.5 - 0.5 * np.cos(np.pi * way)
        branch = start + (end - start) * way
        branch[-1] = end
        pieces.append(branch)
    u = np.concatenate(pieces)
    return u if n_periods is None else np.tile(u[:-1], n_periods)


def quasi_static(
    turning_points,
    time_constant: float,
    *,
    slowness: float = 50.0,
    shape: str = "triangle",
    n_periods: int | None = None,
) -> np.ndarray:
    """Generate a loading-unloading signal so slow that the system follows through its steady states.

    Each branch lasts `slowness` time constants of the system. On a ramp the output of a first-order system
    then lags its static curve by about ``1 / slowness`` of the range.

    Parameters
    ----------
    turning_points : sequence of float of shape (n_points,)
        As in `loading_unloading`.
    time_constant : float
        Longest time constant of the system, in samples; `hold_limits` reads response times from a step.
    slowness : float, default=50.0
        Time constants a branch lasts, at least 1.
    shape : {"triangle", "sine"}, default="triangle"
        As in `loading_unloading`.
    n_periods : int or None, default=None
        As in `loading_unloading`.

    Returns
    -------
    ndarray of shape (n_samples,)

    Raises
    ------
    ValueError
        If `time_constant` is not positive, `slowness` less than 1, or the turning points do not alternate.

    Notes
    -----
    The definition asks for a frequency far below half the sampling frequency. What makes a signal slow is
    the system, so the pace is set by its time constant.

    References
    ----------
    Martins and Aguirre (2016); Abreu (2021), Definition 2.9.

    Examples
    --------
    >>> from narx_sklearn.signals import quasi_static
    >>> quasi_static((-1, 1), time_constant=20, n_periods=1).size
    2000
    """
    samples = int(np.ceil(check_positive(time_constant, "time_constant") * _check_slowness(slowness)))
    return loading_unloading(turning_points, samples, shape=shape, n_periods=n_periods)


def reversal_points(u_min: float, u_max: float, n_curves: int) -> np.ndarray:
    """Return the turning points that record first-order reversal curves.

    From `u_min` the input saturates the system at `u_max`; then it goes down to a reversal point and back
    to `u_max`, each time deeper, the last time to `u_min`.

    Parameters
    ----------
    u_min, u_max : float
        Range of the input, in its unit.
    n_curves : int
        Number of reversal curves.

    Returns
    -------
    ndarray of shape (2 * n_curves + 2,)
        Turning points for `loading_unloading`.

    Raises
    ------
    ValueError
        If `u_min` is not below `u_max`, or `n_curves` is less than 1.

    References
    ----------
    Mayergoyz (2003), Mathematical Models of Hysteresis and Their Applications, section 1.2.

    Examples
    --------
    >>> from narx_sklearn.signals import reversal_points
    >>> reversal_points(-1, 1, 2).tolist()
    [-1.0, 1.0, 0.0, 1.0, -1.0, 1.0]
    """
    n_curves = check_count(n_curves, "n_curves")
    if not (np.isfinite(u_min) and np.isfinite(u_max) and u_min < u_max):
        raise ValueError(f"u_min must lie below u_max, got u_min={u_min!r} and u_max={u_max!r}.")
    points = np.full(2 * n_curves + 2, float(u_max))
    points[0] = u_min
    points[2::2] = np.linspace(u_max, u_min, n_curves + 1)[1:]
    return points


def _branch_lengths(samples_per_branch, n_branches: int) -> list[int]:
    if np.ndim(samples_per_branch) == 0:
        return [check_count(samples_per_branch, "samples_per_branch")] * n_branches
    lengths = [check_count(n, "samples_per_branch") for n in samples_per_branch]
    if len(lengths) != n_branches:
        raise ValueError(f"samples_per_branch has {len(lengths)} values for {n_branches} branches.")
    return lengths


def _check_slowness(slowness) -> float:
    slowness = check_positive(slowness, "slowness")
    if slowness < 1:
        raise ValueError(f"slowness must be at least 1 time constant a branch, got {slowness:g}.")
    return slowness

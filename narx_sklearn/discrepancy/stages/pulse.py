"""Does a parameter pulsate? What is left over, held against waves times a signal at every port."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d

from narx_sklearn.discrepancy.fitting.problem import Problem
from narx_sklearn.discrepancy.fitting.refit import Fit
from narx_sklearn.discrepancy.locate import Tangent
from narx_sklearn.discrepancy.placed import Port
from narx_sklearn.discrepancy.search.bank import out_of
from narx_sklearn.discrepancy.search.detect import FINER, SLOW, exceeded
from narx_sklearn.discrepancy.search.unnamed.proportions import line_hypotheses
from narx_sklearn.discrepancy.simulators.simulator import Run
from narx_sklearn.discrepancy.simulators.structure import Structure
from narx_sklearn.physics.effects._series import rates_along

COVERED = 0.5  # share of a record that windows must cover: those far apart know nothing of each other's phase
DRAWS = 64  # of noise, from which the level of each ordinate is known
NEAR = FINER * np.arange(2, 26)  # fine ordinates from a line: near enough for one level, far from its foot
IMAGE = 0.5  # share of the highest line, above which another is tried too
MOST = 6  # lines
TWICE = 2  # periods in the record: what is seen less often does not repeat


class Pulse(NamedTuple):
    """The clearest of all waves."""

    frequencies: tuple[float, ...]  # cycles in a sample: the clearest, and others nearly as clear
    p_value: float
    signal: str  # which it multiplies
    port: Port  # where that acts
    gain: float  # by how much the cost would fall with it, noise variances


def strongest_pulse(
    problem: Problem, found: Fit, run: Run, linear: Tangent, e: np.ndarray, structure: Structure, rng
) -> Pulse | None:
    r"""Return the frequencies, port and signal of the force in proportion that comes and goes most clearly.

    A small force :math:`w_k = s_k \cos(\omega k + \phi)` at a port, in proportion to a signal s, changes the
    fit in proportion to the Fourier transform of :math:`q_k = s_k g_k`, where g is the gradient by a force at
    that port (Rao's score test, 1948). One run of the adjoint tells g, so all frequencies are tried at once.
    What is read may be off in proportion to its rate: early and late by turns.
    Each ordinate of the spectrum of q is compared with what it is for the same residual with other signs,
    which tells its level, and over that with its neighbours, which know of colour that whitening has left.
    Slow changes are left to what changes once; not those of a clock, as a slow wave times a rate is no drift.
    None is returned where windows are far apart.

    Parameters
    ----------
    found : Fit
        With all that was projected out of the residual.
    run, linear
        Of the fit, and along it.
    e : ndarray of shape (n_windows, n_values)
        Whitened residual, projected.
    """
    rows = problem.rows[problem.inside]
    begin, length = rows.min(), np.ptp(rows) + 1
    if rows.size < COVERED * length:
        return None
    flipped = e[:, :, None] * rng.choice([-1.0, 1.0], size=(*e.shape, DRAWS))
    flipped = out_of(found.jacobian, found.projector(flipped))
    gradients = gradients_by_force(problem, linear, np.concatenate([e[:, :, None], flipped], axis=2))
    n_tried, strongest = 0, None
    for pulsing in _pulsing(problem, run, structure):
        pushed = gradients[pulsing.port]
        if pulsing.onward is not None:
            onward, share = pulsing.onward
            pushed = pushed - share * gradients[onward]
        product = np.zeros((length, pushed.shape[2]))
        product[rows - begin] = np.nan_to_num(pulsing.values[rows, None] * pushed[problem.inside])
        power = np.abs(np.fft.rfft(product, FINER * length, axis=0))[FINER * pulsing.slowest : -1] ** 2
        ratio = power[:, 0] / np.maximum(power[:, 1:].mean(axis=1), 1e-300)
        n_tried += ratio.size
        if ratio.size and (strongest is None or ratio.max() > strongest[0].max()):
            strongest = ratio, pulsing
    if strongest is None:
        return None
    ratio, pulsing = strongest
    at = int(np.argmax(ratio))
    near = np.concatenate([at - NEAR, at + NEAR])
    near = near[(near >= 0) & (near < ratio.size)]
    chances = exceeded(ratio[at], DRAWS), exceeded(ratio[at] / max(np.mean(ratio[near]), 1e-300), near.size)
    chance = float(min(1.0, n_tried * max(chances)))
    gain = 2.0 * float(ratio[at])  # chi-squared, of a sine and a cosine, is twice the ratio
    frequencies = tuple((_peaks(ratio) + FINER * pulsing.slowest) / (FINER * length))
    return Pulse(frequencies, chance, pulsing.signal, pulsing.port, gain)


class _Pulsing(NamedTuple):
    """A signal that a wave may multiply, and where that acts."""

    signal: str
    values: np.ndarray  # (n_samples,)
    port: Port
    onward: tuple[Port, float] | None = None  # where a share of it reacts
    slowest: int = SLOW  # periods in the record


def _pulsing(problem: Problem, run: Run, structure: Structure) -> Iterator[_Pulsing]:
    """Yield what may come and go at inputs, in equations, and of what is read."""
    signals = {"input": problem.u, "output": run.y}  # by port
    for placed in (hypothesis.placed for hypothesis in line_hypotheses(problem.simulator, structure)):
        port = placed.port
        values = signals[port.kind][:, port.index] if port.kind in signals else run.x @ placed.weights
        onward = (Port("state", placed.onward), placed.share) if placed.reacts else None
        yield _Pulsing(placed.argument_name, values, placed.port, onward)
    rates = np.zeros_like(run.y)
    for a, b in zip(problem.windows.first, problem.windows.last, strict=True):
        rates[a:b] = rates_along(run.y[a:b], problem.simulator.dt)
    for i, output in enumerate(problem.simulator.outputs):
        yield _Pulsing(f"the rate of {output.name}", rates[:, i], Port("output", i), slowest=TWICE)


def _peaks(ratio: np.ndarray) -> np.ndarray:
    """Return the lowest of the highest lines of a spectrum, and the highest of all.

    An input that is held for several samples at a time makes images of a line, nearly as high as the line.
    """
    own = ratio >= maximum_filter1d(ratio, 2 * FINER + 1)
    lines = np.flatnonzero(own & (ratio > IMAGE * ratio.max()))
    return np.union1d(lines[:MOST], np.argmax(ratio))


def gradients_by_force(problem: Problem, linear: Tangent, e: np.ndarray) -> dict[Port, np.ndarray]:
    """Return how the fit would change with a small force in each sample, by its port, each (W, L, n).

    The adjoint of what small forces do to the outputs, of n whitened residuals e, (W, T, n). The noise is
    stationary, so whitening backwards is its own adjoint but for the ends of a window.
    """
    n_windows, length = problem.rows.shape
    n_states, n_inputs, n = linear.A.shape[1], linear.B.shape[2], e.shape[2]
    backwards = e.reshape(n_windows, length, -1, n)[:, ::-1]
    raw = np.stack([problem.noise.innovations(backwards[..., j])[:, ::-1] for j in range(n)], axis=3)
    at_input, at_state = (np.zeros((m, n_windows, length, n)) for m in (n_inputs, n_states))
    ahead = np.zeros((n_windows, n_states, n))
    for step in reversed(range(length)):  # all windows abreast
        inside = problem.inside[:, step]
        k, r, after = problem.rows[inside, step], raw[inside, step], ahead[inside]
        at_state[:, inside, step] = np.moveaxis(_back(linear.G[k], after), 1, 0)
        if linear.F is not None:
            at_state[:, inside, step] += np.moveaxis(_back(linear.F[k], r), 1, 0)
        at_input[:, inside, step] = np.moveaxis(_back(linear.B[k], after) + _back(linear.D[k], r), 1, 0)
        ahead = np.zeros_like(ahead)
        ahead[inside] = np.nan_to_num(_back(linear.C[k], r) + _back(linear.A[k], after))
    found = {Port("input", j): at_input[j] for j in range(n_inputs)}
    found |= {Port("output", i): raw[:, :, i] for i in range(raw.shape[2])}
    return found | {Port("state", i): at_state[i] for i in range(n_states)}


def _back(slopes: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the transposes of some matrices (W, i, j) times values (W, i, n)."""
    return np.swapaxes(slopes, 1, 2) @ values

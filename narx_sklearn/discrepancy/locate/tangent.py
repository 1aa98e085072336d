"""The tangent-linear model along a run: how small deviations travel and what the outputs show of them."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit

from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.simulators.kernels import MAX_EFFECTS
from narx_sklearn.discrepancy.simulators.simulator import Run, Simulator, Windows, transformed
from narx_sklearn.physics.effects import Effect, EffectParameter, no_start

RELATIVE_STEP = 1e-5  # near the cube root of the rounding unit, best for central differences
BLOCK = 1 << 15  # samples perturbed in one call, so that memory does not grow with the record


class Tangent(NamedTuple):
    """Tangent-linear model of a simulator along one run, sample by sample; NaN where the run has none.

    dx[k+1] = A[k] dx[k] + B[k] du[k] + G[k] w[k] + P[k] dp
    dy[k]   = C[k] dx[k] + D[k] du[k] + F[k] w[k] + Q[k] dp

    Attributes
    ----------
    A : ndarray of shape (n_samples, n_states, n_states)
        Deviations of the states, one sample ahead.
    B : ndarray of shape (n_samples, n_states, n_inputs)
        A change of an input, held over the sampling period.
    G : ndarray of shape (n_samples, n_states, n_states)
        A disturbance of a state equation, held as well.
    C : ndarray of shape (n_samples, n_outputs, n_states)
        What the outputs show of the states.
    D : ndarray of shape (n_samples, n_outputs, n_inputs)
        What they show of the inputs at once.
    P : ndarray of shape (n_samples, n_states, n_parameters), optional
        A change of a parameter.
    F : ndarray of shape (n_samples, n_outputs, n_states), optional
        What the outputs show of a disturbance at once; None where they see no rates.
    Q : ndarray of shape (n_samples, n_outputs, n_parameters), optional
        What they show of a change of a parameter at once.
    """

    A: np.ndarray
    B: np.ndarray
    G: np.ndarray
    C: np.ndarray
    D: np.ndarray
    P: np.ndarray | None = None
    F: np.ndarray | None = None
    Q: np.ndarray | None = None


def tangent(simulator: Simulator, run: Run, u: np.ndarray, windows: Windows, p=None) -> Tangent:
    """Linearise a simulator along a run, by central differences over one sample.

    Parameters
    ----------
    simulator : Simulator
        What made the run.
    run : Run
        Its result on ``windows``; only the states are read.
    u : ndarray of shape (n_samples, n_inputs)
        Inputs of that run.
    windows : Windows
        Windows of that run. Outside them the tangent is NaN.
    p : ndarray of shape (n_parameters,), optional
        Parameters of that run; the simulator's own when not given.

    Returns
    -------
    Tangent
        Linear cost: two runs over two samples for every state, input, state equation and parameter.

    Notes
    -----
    The force of an effect with states of its own (play, Bouc-Wen) is taken as it was recorded: it drives the
    deviations no further. An effect on an output enters through its slope at rest.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy import ODESimulator
    >>> from narx_sklearn.discrepancy.locate import tangent
    >>> from narx_sklearn.discrepancy.simulators.simulator import Windows
    >>> def tank(x, u, p):
    ...     return (u[0] - p[0] * x[0],)
    >>> sim = ODESimulator(tank, dt=0.1, parameters={"outflow [1/s]": 0.5}, states=["level [m]"],
    ...                    inputs=["pump [m/s]"])
    >>> u, whole = np.ones((50, 1)), Windows.whole([slice(0, 50)])
    >>> linear = tangent(sim, sim.run(u, whole, np.zeros((1, 1))), u, whole)
    >>> float(linear.A[3, 0, 0].round(6)), float(np.exp(-0.05).round(6))
    (0.951229, 0.951229)
    """
    n_states, n_inputs, n_outputs = len(simulator.states), len(simulator.inputs), len(simulator.outputs)
    p = simulator.nominal if p is None else np.asarray(p, dtype=float)
    driven = transformed(
        u, "input", simulator.effects, np.ones(len(simulator.effects)), None, simulator.dt, windows
    )
    lasting = [
        e for e in simulator.effects if (e.port.kind == "state" or e.port.is_parameter) and not e.n_memory
    ]
    sensors = [e for e in simulator.effects if e.port.kind == "output"]
    raw = np.full((u.shape[0], n_outputs), np.nan)  # outputs before the effects on them
    steps_x, steps_u = _steps(run.x), _steps(driven)
    n = u.shape[0]
    A, B, G, P = (np.full((n, n_states, width), np.nan) for width in (n_states, n_inputs, n_states, p.size))
    C, D, F, Q = (np.full((n, n_outputs, width), np.nan) for width in (n_states, n_inputs, n_states, p.size))
    seam = np.zeros(n, dtype=bool)
    seam[windows.last - 1] = True
    began = np.zeros(n, dtype=np.int64)
    inside = np.zeros(n, dtype=bool)
    for first, last, start in zip(windows.first, windows.last, windows.began, strict=True):
        inside[first:last] = True
        began[first:last] = start
    known = np.flatnonzero(inside & np.isfinite(run.x).all(axis=1))
    for rows, at_rest in _blocks(known, began, lasting, simulator.dt):
        stepper = _Stepper(simulator, p, driven, rows, seam, began)
        x = run.x[rows]
        if sensors:
            raw[rows] = stepper.step(x, at_rest)[1]
        for j in range(n_states):
            move = steps_x[j] * np.eye(n_states)[j]
            A[rows, :, j], C[rows, :, j] = stepper.slope(x - move, x + move, at_rest, steps_x[j])
            G[rows, :, j], F[rows, :, j] = stepper.disturbance(x, at_rest, j, 100 * steps_x[j] / simulator.dt)
        for i in range(n_inputs):
            move = steps_u[i] * np.eye(n_inputs)[i]
            B[rows, :, i], D[rows, :, i] = stepper.slope(x, x, at_rest, steps_u[i], move)
        for j in range(p.size):
            change = RELATIVE_STEP * (abs(p[j]) if p[j] != 0 else 1.0)
            (x_high, y_high), (x_low, y_low) = (
                stepper.step(x, at_rest, p=p + sign * change * np.eye(p.size)[j]) for sign in (1, -1)
            )
            P[rows, :, j], Q[rows, :, j] = (x_high - x_low) / (2 * change), (y_high - y_low) / (2 * change)
    for effect, slope, of_second in _sensor_slopes(simulator, sensors, raw, driven, run.x, windows):
        for slopes in (C, D, F, Q):
            slopes[:, effect.port.index] *= slope[:, None]
        if of_second is not None:
            weights = np.array(effect.second)
            D[:, effect.port.index] += of_second[:, None] * weights[:n_inputs]
            C[:, effect.port.index] += of_second[:, None] * weights[n_inputs:]
    return Tangent(A, B, G, C, D, P, F if simulator.sees_rates else None, Q)


def _blocks(
    known: np.ndarray, began: np.ndarray, effects: Sequence[PlacedEffect], dt: float
) -> Iterator[tuple[np.ndarray, tuple[PlacedEffect, ...]]]:
    """Yield samples of a record, not too many at once, and the effects as they act there.

    Single steps know the time since a session began only, so what counts it along the record is asked session
    by session.
    """
    parts = [known]
    if any(effect.during.along_record for effect in effects):
        parts = np.split(known, np.flatnonzero(np.diff(began[known])) + 1)
    for part in parts:
        for begin in range(0, part.size, BLOCK):
            rows = part[begin : begin + BLOCK]
            start = int(began[rows[0]])
            yield rows, tuple(e.acting(e.during.in_session(start, dt)) for e in effects)


class _Stepper:
    """One step from each of many samples at once: sample i becomes rows 2i and 2i+1 of a new record."""

    def __init__(self, simulator, p, driven, rows, seam, began):
        ahead = np.where(seam[rows], rows, np.minimum(rows + 1, driven.shape[0] - 1))
        self.simulator = simulator.by_equations()  # to what is added to a run single steps are nothing
        self.p = p
        self.u = np.empty((2 * rows.size, driven.shape[1]))
        self.u[0::2], self.u[1::2] = driven[rows], driven[ahead]
        first = 2 * np.arange(rows.size, dtype=np.int64)
        # `began` is moved along, so that effects which know the time see the time of the sample
        self.windows = Windows(first, first + 2, np.ones(rows.size, dtype=bool), first - rows + began[rows])

    def step(self, x, effects, moved=0.0, p=None):
        """Return the states one sample later and the outputs now."""
        run = self.simulator.run(self.u + moved, self.windows, x, self.p if p is None else p, effects=effects)
        return run.x[1::2], run.y[0::2]

    def slope(self, low, high, effects, step, moved=0.0):
        """Return the central difference of the next states and the present outputs."""
        x_low, y_low = self.step(low, effects, -moved)
        x_high, y_high = self.step(high, effects, moved)
        return (x_high - x_low) / (2 * step), (y_high - y_low) / (2 * step)

    def disturbance(self, x, effects, equation, size):
        """Return the change of next states and present outputs per unit added to one state equation."""
        if self.simulator.discrete:
            return np.eye(x.shape[1])[equation], 0.0
        # the other effects change this response at second order of the step only: make room for the constant
        effects = [e for e in effects if e.port.kind == "state"][: MAX_EFFECTS - 1]
        unit = PlacedEffect(_CONSTANT, Port("state", equation), (0.0,) * x.shape[1])
        x_low, y_low = self.step(x, (*effects, unit.at([-size])))
        x_high, y_high = self.step(x, (*effects, unit.at([size])))
        return (x_high - x_low) / (2 * size), (y_high - y_low) / (2 * size)


def _steps(signals: np.ndarray) -> np.ndarray:
    """Return the differencing step of each column: small against its range, large against its rounding."""
    finite = np.where(np.isfinite(signals), signals, np.nan)
    if not np.isfinite(finite).any():
        return np.full(signals.shape[1], RELATIVE_STEP)
    largest = np.nanmax(np.abs(finite), axis=0)
    spread = np.nanstd(finite, axis=0)
    # a constant column has no range of its own: take its size, or one unit
    scale = np.where(spread > 1e-9 * largest, spread, np.where(largest > 0, largest, 1.0))
    return RELATIVE_STEP * np.maximum(scale, 1e-3 * largest)


def _sensor_slopes(simulator, sensors, raw, driven, x, windows):
    """Yield each effect on an output with the slopes of its transform there, shape (n_samples,).

    That is by the output and by its second argument, None where it has none.
    """
    for effect in sensors:
        port, second = effect.port.index, effect.second_of(driven, x)
        # its second argument as the only input, which can be moved
        alone = effect if second is None else replace(effect, second=(1.0,))
        signal = driven if second is None else second[:, None]

        def told(move=0.0, moved=0.0, alone=alone, raw=raw, signal=signal):
            return transformed(raw + move, "output", (alone,), (1.0,), signal + moved, simulator.dt, windows)

        step = _steps(raw)[port]
        by_output = (told(step) - told(-step))[:, port] / (2 * step)
        by_second = None
        if second is not None:
            step = _steps(signal)[0]
            by_second = (told(moved=step) - told(moved=-step))[:, port] / (2 * step)
        yield effect, by_output, by_second
        raw = told()


@njit(nogil=True, cache=True, error_model="numpy")
def _constant_force(argument, rate, own, second, time, step, z, theta, dz):
    return theta[0]


_CONSTANT = Effect(
    code="_constant",
    title="Constant",
    sentence="A constant is added to the state's rate.",
    equation="c",
    parameters=(EffectParameter("c", "{port}"),),
    starts=no_start,
    force=_constant_force,
    argument="none",
)

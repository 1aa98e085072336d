"""Compiled kernels over plain arrays: term evaluation, free run, k steps, sensitivities.

Data come as ``signals``, shape (n_rows, n_channels), C-contiguous: outputs first, then inputs, then phi
regressors. A model comes as a `Program`: for each output its terms, for each term the distances in the
flattened data from the row of ``k`` to its factors, so that one factor is one addition and one load.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from narx_sklearn.model.operators import (
    asymmetric_sign,
    hysteretic_state_size,
    hysteretic_step,
    play_step,
    sign,
    smooth_sign,
)

# Kinds of phi regressors that the kernels know; `phi.py` holds one class for each.
DIFFERENCE, DIFFERENCE_SIGN, ABSOLUTE_DIFFERENCE, SMOOTH_SIGN, ASYMMETRIC_SIGN, PLAY, HYSTERETIC = range(7)
STATE_SIZE = hysteretic_state_size(16)  # the largest state: a hysteretic operator with 16 open extrema
NO_STEP = np.iinfo(np.int64).max  # stands for "no factor": the constant term
at = np.uint64  # makes an index unsigned: numba then leaves out its test for negative ones (half the time)


class Program(NamedTuple):
    """A model's equations as integers and coefficients.

    Output ``i`` has the terms ``equation_start[i]`` to ``equation_start[i+1]``; term ``t`` has the factors
    ``factor_start[t]`` to ``factor_start[t+1]`` of ``factor_step``. Within an equation the terms of one, two
    and three factors stand together, so that each is a straight product; row ``i`` of ``group_start`` holds
    where the groups begin: one factor, two, three, all others.
    """

    equation_start: np.ndarray  # (n_outputs + 1,) int64
    group_start: np.ndarray  # (n_outputs, 4) int64
    factor_start: np.ndarray  # (n_terms + 1,) int64
    factor_step: np.ndarray  # (n_factors,) int64: channel - lag * n_channels
    coefficients: np.ndarray  # (n_terms,) float64


class PhiProgram(NamedTuple):
    """The phi regressors that depend on an output and must be computed inside the free run."""

    kinds: np.ndarray  # (n_phi,) int64
    sources: np.ndarray  # (n_phi,) int64: channel of the signal each is a function of
    channels: np.ndarray  # (n_phi,) int64: channel each is written to
    offsets: np.ndarray  # (n_phi,) float64: operating point of the source, added back
    parameters: np.ndarray  # (n_phi, width) float64


@njit(cache=True, nogil=True)
def phi_value(kind, parameters, now, previous, state):
    """Return one phi regressor at one sample; ``state``, shape (STATE_SIZE,), is written."""
    if kind == DIFFERENCE:
        return now - previous
    if kind == DIFFERENCE_SIGN:
        return sign(now - previous)
    if kind == ABSOLUTE_DIFFERENCE:
        return abs(now - previous)
    if kind == SMOOTH_SIGN:
        return smooth_sign(now - previous, parameters[0])
    if kind == ASYMMETRIC_SIGN:
        split = 1 + int(parameters[0])
        return asymmetric_sign(now - previous, now, parameters[1:split], parameters[split:], 0.0)
    if kind == PLAY:
        state[0] = play_step(state[0], now, parameters[0])
        return state[0]
    return hysteretic_step(state, now)


@njit(cache=True, nogil=True)
def phi_run(kind, parameters, source, state, values):
    """Write a phi regressor along one recording into ``values``; ``state`` is written.

    The sample before the first is taken equal to the first.
    """
    previous = source[0]
    for k in range(source.size):
        values[k] = phi_value(kind, parameters, source[k], previous, state)
        previous = source[k]


@njit(cache=True, nogil=True)
def phi_slopes(kind, parameters, now, previous, state, slopes):
    """Write the derivatives of a phi with respect to (source now, source before, phi before).

    Jumps have derivative zero, and so has the hysteretic operator, whose extrema are outputs of the past too.
    """
    slopes[:] = 0.0
    difference = now - previous
    if kind == DIFFERENCE:
        slopes[0] = 1.0
        slopes[1] = -1.0
    elif kind == ABSOLUTE_DIFFERENCE:
        slopes[0] = sign(difference)
        slopes[1] = -slopes[0]
    elif kind == SMOOTH_SIGN:
        slopes[0] = (1.0 - smooth_sign(difference, parameters[0]) ** 2) / parameters[0]
        slopes[1] = -slopes[0]
    elif kind == ASYMMETRIC_SIGN:
        if difference != 0.0:
            split = 1 + int(parameters[0])
            branch = parameters[1:split] if difference > 0.0 else parameters[split:]
            for i in range(branch.size - 1, 0, -1):
                slopes[0] = slopes[0] * now + i * branch[i]
    elif kind == PLAY:
        # dragged along at the distance of the radius, to rounding; else held
        dragged = abs(abs(now - state[0]) - parameters[0]) <= 1e-12 * (parameters[0] + abs(now))
        slopes[0 if dragged else 2] = 1.0


@njit(cache=True, nogil=True, inline="always")  # a call would count references to five arrays at each step
def right_hand_side(flat, base, program, output):
    """Return the right-hand side of one output's equation for the row that begins at ``base``.

    Slow form: ``sum(coefficient * prod(flat[base + step] for step in factors))`` over the terms. Fast form:
    one sum for each number of factors, which the processor runs side by side, and straight products.
    """
    equation_start, group_start, factor_start, step, coefficients = program
    first = equation_start[at(output)]
    two = group_start[at(output), at(1)]
    three = group_start[at(output), at(2)]
    others = group_start[at(output), at(3)]
    singles = pairs = triples = rest = 0.0
    f = factor_start[at(first)]
    for t in range(first, two):
        singles += coefficients[at(t)] * flat[at(base + step[at(f)])]
        f += 1
    for t in range(two, three):
        older = coefficients[at(t)] * flat[at(base + step[at(f + 1)])]
        pairs += older * flat[at(base + step[at(f)])]
        f += 2
    for t in range(three, others):
        older = coefficients[at(t)] * flat[at(base + step[at(f + 2)])]
        triples += older * (flat[at(base + step[at(f + 1)])] * flat[at(base + step[at(f)])])
        f += 3
    for t in range(others, equation_start[at(output + 1)]):
        product = coefficients[at(t)]
        for g in range(factor_start[at(t)], factor_start[at(t + 1)]):
            product *= flat[at(base + step[at(g)])]
        rest += product
    return (rest + triples) + (pairs + singles)


@njit(cache=True, nogil=True)
def one_step_rows(flat, n_channels, rows, program, predictions):
    """Write the one-step-ahead outputs at ``rows`` into ``predictions``, shape (n_samples, n_outputs)."""
    for i in range(rows.size):
        row = rows[at(i)]
        for output in range(predictions.shape[1]):
            predictions[at(row), at(output)] = right_hand_side(flat, row * n_channels, program, output)


@njit(cache=True, nogil=True)
def free_run(flat, n_channels, first, last, program, phis, state, bound):
    """Simulate rows ``first`` to ``last`` (exclusive) in place; the outputs are overwritten in ``flat``.

    Rows before ``first`` hold the initial condition. ``state``, shape (n_phi, STATE_SIZE), is that of the
    phi regressors of outputs at row ``first - 1`` and is written.

    Returns
    -------
    int
        ``last``, or the row at which an output first left the range ``bound`` (finite) or is NaN.
    """
    n_outputs = program.equation_start.size - 1
    n_phi = phis.kinds.size
    for k in range(first, last):
        base = k * n_channels
        for output in range(n_outputs):
            total = right_hand_side(flat, base, program, output)
            if not abs(total) <= bound:
                return k
            flat[at(base + output)] = total
        for p in range(n_phi):
            now = flat[base + phis.sources[p]] + phis.offsets[p]
            previous = flat[base - n_channels + phis.sources[p]] + phis.offsets[p]
            flat[base + phis.channels[p]] = phi_value(
                phis.kinds[p], phis.parameters[p], now, previous, state[p]
            )
    return last


@njit(cache=True, nogil=True)
def k_steps(flat, n_channels, rows, session_start, horizon, depth, program, phis, bound, predictions):
    """Write the outputs at ``rows``, each simulated ``horizon`` steps from measured data.

    ``rows`` ascend, and ``depth`` rows before each simulation's start lie in the session. ``predictions``,
    shape (n_samples, n_outputs), is written; NaN where a simulation left the range ``bound``.
    """
    n_phi = phis.kinds.size
    scratch = np.empty((depth + horizon) * n_channels)
    measured = np.zeros((n_phi, STATE_SIZE))  # phi states along the data, up to the row before `reached`
    state = np.empty((n_phi, STATE_SIZE))
    reached = 0
    for i in range(rows.size):
        begin = rows[i] - horizon + 1
        while reached < begin:
            for p in range(n_phi):
                now = flat[reached * n_channels + phis.sources[p]] + phis.offsets[p]
                if reached == session_start[reached] or not np.isfinite(now):
                    measured[p] = 0.0
                if np.isfinite(now):
                    phi_value(phis.kinds[p], phis.parameters[p], now, now, measured[p])
            reached += 1
        state[:] = measured
        scratch[:] = flat[(begin - depth) * n_channels : (begin + horizon) * n_channels]
        end = free_run(scratch, n_channels, depth, depth + horizon, program, phis, state, bound)
        for output in range(predictions.shape[1]):
            simulated = scratch[(depth + horizon - 1) * n_channels + output]
            predictions[rows[i], output] = simulated if end == depth + horizon else np.nan


@njit(cache=True, nogil=True)
def free_run_sensitivity(
    flat, n_channels, first, last, program, phis, state, bound, target, weights, depth, gram, gradients
):
    """Free run that also adds up J'J, J'r and r'r for the simulation error r = target - y.

    J is the derivative of the simulated outputs with respect to the coefficients, propagated with them:
    dy[k]/dtheta = psi[k-1] + sum over output factors of (dF/dy) dy/dtheta.

    Parameters
    ----------
    flat, n_channels, first, last, program, phis, state, bound
        As for `free_run`.
    target : ndarray of shape (n_rows, n_outputs)
        Measured outputs; NaN where none is.
    weights : ndarray of shape (n_outputs,)
        Weight of each output's squared error.
    depth : int
        Rows of history that the terms reach back to, at least 1.
    gram : ndarray of shape (n_terms, n_terms)
        Added to: the lower triangle of J'WJ.
    gradients : ndarray of shape (n_windows, n_terms)
        Added to: J'Wr, summed over each of ``n_windows`` equal stretches of the run.

    Returns
    -------
    end : int
        As for `free_run`.
    loss : float
        r'Wr over the simulated rows.
    """
    n_outputs = program.equation_start.size - 1
    n_phi = phis.kinds.size
    n_terms = program.coefficients.size
    # Derivatives of the channels in the last `depth` rows, a ring over k; inputs stay zero.
    ring = np.zeros((depth + 1, n_channels, n_terms))
    moving = np.zeros(n_channels, dtype=np.bool_)
    moving[:n_outputs] = True
    for p in range(n_phi):
        moving[phis.channels[p]] = True
    slopes = np.empty(3)
    inner = np.zeros((n_channels, depth + 1))  # dF/d(channel at lag) of the equation at hand
    loss = 0.0
    for k in range(first, last):
        base = k * n_channels
        slot = k % (depth + 1)
        window = (k - first) * gradients.shape[0] // (last - first)
        ring[slot] = 0.0
        for output in range(n_outputs):
            total = 0.0
            own = ring[slot, output]
            for t in range(program.equation_start[output], program.equation_start[output + 1]):
                begin, end = program.factor_start[t], program.factor_start[t + 1]
                regressor = 1.0
                for f in range(begin, end):
                    regressor *= flat[base + program.factor_step[f]]
                total += program.coefficients[t] * regressor
                own[t] += regressor
                for f in range(begin, end):
                    step = program.factor_step[f]
                    channel = step % n_channels
                    if moving[channel]:
                        slope = program.coefficients[t]
                        for g in range(begin, end):
                            if g != f:
                                slope *= flat[base + program.factor_step[g]]
                        inner[channel, (channel - step) // n_channels] += slope
            for channel in range(n_channels):
                if moving[channel]:
                    for lag in range(1, depth + 1):
                        slope = inner[channel, lag]
                        if slope != 0.0:
                            inner[channel, lag] = 0.0
                            past = ring[(k - lag) % (depth + 1), channel]
                            for q in range(n_terms):
                                own[q] += slope * past[q]
            if not abs(total) <= bound:
                return k, loss
            flat[base + output] = total
            residual = target[k, output] - total
            if np.isfinite(residual):
                loss += weights[output] * residual * residual
                for q in range(n_terms):
                    scaled = weights[output] * own[q]
                    gradients[window, q] += scaled * residual
                    for s in range(q + 1):
                        gram[q, s] += scaled * own[s]
        for p in range(n_phi):
            now = flat[base + phis.sources[p]] + phis.offsets[p]
            previous = flat[base - n_channels + phis.sources[p]] + phis.offsets[p]
            channel = phis.channels[p]
            flat[base + channel] = phi_value(phis.kinds[p], phis.parameters[p], now, previous, state[p])
            phi_slopes(phis.kinds[p], phis.parameters[p], now, previous, state[p], slopes)
            before = (k - 1) % (depth + 1)
            for q in range(n_terms):
                ring[slot, channel, q] = (
                    slopes[0] * ring[slot, phis.sources[p], q]
                    + slopes[1] * ring[before, phis.sources[p], q]
                    + slopes[2] * ring[before, channel, q]
                )
    return last, loss


@njit(cache=True, nogil=True)
def term_columns(flat, n_channels, rows, steps, parents, columns):
    """Write the term values at ``rows`` into ``columns``, shape (n_terms, n_rows).

    Term ``t`` is term ``parents[t]`` (-1: one) times the variable at distance ``steps[t]`` (for the
    constant: parent -1 and ``steps[t]`` equal to ``NO_STEP``), so each costs one product.
    """
    n_rows = rows.size
    for t in range(steps.size):
        column = columns[t]
        if steps[t] == NO_STEP:
            column[:] = 1.0
        elif parents[t] < 0:
            for i in range(n_rows):
                column[i] = flat[at(rows[i] * n_channels + steps[t])]
        else:
            parent = columns[parents[t]]
            for i in range(n_rows):
                column[i] = parent[i] * flat[at(rows[i] * n_channels + steps[t])]

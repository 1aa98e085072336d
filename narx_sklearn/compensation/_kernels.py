"""Kernels of the compensation laws: one sample, and a whole reference.

A law sees a window of the last rows of its signals. The newest row, n = k + horizon, holds the newest
reference; the input to be found, m[k], stands ``horizon`` rows before::

    row          n            n-1           ...      n-horizon
    reference    r[k+horizon] r[k+horizon-1] ...     r[k]
    input        .            .             .        m[k] wanted, m[k-1], ... known

A law and its state travel packed in three flat arrays: calling a compiled function with a tuple of twenty
arrays costs six microseconds, with three arrays half of one.

Functions of the user's come as one ``functions(window, base)``, which writes all their values at the row that
begins at ``base``. `advance`, `run` and `slopes_along` are compiled without any; `with_functions` gives the
same three for laws that have some.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit, types

from narx_sklearn.compensation._polynomial_roots import ALIKE, first_root, is_better, smallest_value
from narx_sklearn.model.kernels import ASYMMETRIC_SIGN, STATE_SIZE, Program, phi_value, right_hand_side
from narx_sklearn.physics.boucwen import _bouc_wen_move

EXPLICIT, ROOTS, SEARCH = range(3)  # how a law finds its input
HOLD, NEAREST = range(2)  # what it does where no input satisfies it
ANY, RISING, FALLING = 0, 1, -1  # the sign of the machine's gain, where the choice of the root follows it
LAST_WITHOUT_MEMORY = ASYMMETRIC_SIGN  # kinds of phi regressors up to this one remember nothing
# Elements beyond the kinds of phi regressors: Bouc-Wen with parameters A, beta, gamma, n; a user's function.
BOUC_WEN, FUNCTION = 100, 101
OF_KNOWN, OF_INPUT, OF_FUNCTION = range(3)  # what an element is of, and so when its value can be had
N_COUNTS = 4
SAMPLES, NO_SOLUTION, AT_LIMIT, AT_RATE = range(N_COUNTS)
# The search goes outwards from the last input; a step that grows by this factor resolves near and far alike.
FIRST_STEP, GROWTH = 1e-7, 1.35  # of the range of the input
VANISHES = 1e-6  # share to which a residual must fall from one side, where it has no value on the other
HEADER, NUMBERS = 16, 3


class Law(NamedTuple):
    """A compensation law, unpacked."""

    n_channels: int
    n_rows: int
    horizon: int
    method: int
    policy: int
    degree: int
    n_regimes: int
    reach: int  # newest rows of the known signals that the law reads, beyond the first
    keeps_rest: int
    branch: int
    low: float
    high: float
    max_step: float
    program: Program
    kinds: np.ndarray  # (n_elements,)
    sources: np.ndarray
    channels: np.ndarray
    of: np.ndarray  # OF_KNOWN, OF_INPUT or OF_FUNCTION
    parameters: np.ndarray  # (n_elements, width)


class State(NamedTuple):
    """What a law carries from sample to sample, and room to work in."""

    window: np.ndarray  # (n_rows * n_channels,), oldest row first
    elements: np.ndarray  # (n_elements, STATE_SIZE)
    counts: np.ndarray  # (N_COUNTS,)
    trial: np.ndarray  # (STATE_SIZE,)
    chain: np.ndarray  # (degree + 1, degree + 1)
    work: np.ndarray  # (4, degree + 3): cuts, found cuts, coefficients up and down


@njit(nogil=True, inline="always")
def unpack_law(integers, numbers):
    """Return the law that `pack` put into two arrays; nothing is copied."""
    n_channels, n_rows, horizon, method = integers[0], integers[1], integers[2], integers[3]
    policy, degree, n_regimes, reach = integers[4], integers[5], integers[6], integers[7]
    keeps_rest, n_equations, n_terms, n_factors = integers[8], integers[9], integers[10], integers[11]
    n_elements, width, branch = integers[12], integers[13], integers[14]
    a = HEADER
    b = a + n_equations + 1
    c = b + 4 * n_equations
    d = c + n_terms + 1
    e = d + n_factors
    program = Program(
        integers[a:b],
        integers[b:c].reshape(n_equations, 4),
        integers[c:d],
        integers[d:e],
        numbers[NUMBERS : NUMBERS + n_terms],
    )
    return Law(
        n_channels,
        n_rows,
        horizon,
        method,
        policy,
        degree,
        n_regimes,
        reach,
        keeps_rest,
        branch,
        numbers[0],
        numbers[1],
        numbers[2],
        program,
        integers[e : e + n_elements],
        integers[e + n_elements : e + 2 * n_elements],
        integers[e + 2 * n_elements : e + 3 * n_elements],
        integers[e + 3 * n_elements : e + 4 * n_elements],
        numbers[NUMBERS + n_terms : NUMBERS + n_terms + n_elements * width].reshape(n_elements, width),
    )


@njit(cache=True, nogil=True)
def state_size(integers):
    """Return the length of the packed state of a law."""
    degree = integers[5]
    n_elements = integers[12]
    window = integers[0] * integers[1]
    return window + (n_elements + 1) * STATE_SIZE + N_COUNTS + (degree + 1) ** 2 + 4 * (degree + 3)


@njit(nogil=True, inline="always")
def unpack_state(integers, state):
    """Return the parts of a packed state; nothing is copied."""
    degree, n_elements = integers[5], integers[12]
    a = integers[0] * integers[1]
    b = a + n_elements * STATE_SIZE
    c = b + N_COUNTS
    d = c + STATE_SIZE
    e = d + (degree + 1) ** 2
    return State(
        state[:a],
        state[a:b].reshape(n_elements, STATE_SIZE),
        state[b:c],
        state[c:d],
        state[d:e].reshape(degree + 1, degree + 1),
        state[e : e + 4 * (degree + 3)].reshape(4, degree + 3),
    )


@njit(nogil=True, inline="always")
def _copy(values, written):
    """Copy a vector; a slice that is assigned has numba compile the wording of its error too, for seconds."""
    for i in range(values.size):
        written[i] = values[i]


@njit(cache=True, nogil=True)
def element_value(kind, parameters, now, previous, state):
    """Return an element (a phi regressor, or Bouc-Wen hysteresis) at one sample; ``state`` is written."""
    if kind == BOUC_WEN:
        A, beta, gamma, n = parameters[0], parameters[1], parameters[2], parameters[3]
        state[0] = _bouc_wen_move(state[0], now - previous, A, beta, gamma, n, 1)
        return state[0]
    return phi_value(kind, parameters, now, previous, state)


@njit(nogil=True, inline="always")
def _set_elements(law, state, row, of):
    """Advance the elements of the input, or of the known signals, to the window's row ``row``."""
    base = row * law.n_channels
    for p in range(law.kinds.size):
        if law.of[p] == of:
            now = state.window[base + law.sources[p]]
            previous = state.window[base - law.n_channels + law.sources[p]]
            state.window[base + law.channels[p]] = element_value(
                law.kinds[p], law.parameters[p], now, previous, state.elements[p]
            )


@njit(cache=True, nogil=True)
def _call(functions, window, base):
    """Write the values of the user's functions at one row; None stands for none and costs nothing."""
    if functions is not None:
        functions(window, base)


@njit(cache=True, nogil=True)
def _residual(functions, law, state, m):
    """Return what the model gives for the input ``m`` less the reference; element states stay."""
    row = law.n_rows - 1 - law.horizon
    base = row * law.n_channels
    state.window[base] = m
    _call(functions, state.window, base)
    for p in range(law.kinds.size):
        if law.of[p] == OF_INPUT:
            _copy(state.elements[p], state.trial)
            previous = state.window[base - law.n_channels + law.sources[p]]
            state.window[base + law.channels[p]] = element_value(
                law.kinds[p], law.parameters[p], m, previous, state.trial
            )
    return right_hand_side(state.window, (law.n_rows - 1) * law.n_channels, law.program, 0)


@njit(cache=True, nogil=True)
def _bisect(functions, law, state, a, b, value_a):
    """Return the input in [a, b] at which the residual changes sign (regula falsi of Illinois, bisection)."""
    value_b = _residual(functions, law, state, b)
    for i in range(200):
        m = b - value_b * (b - a) / (value_b - value_a) if i % 3 else 0.5 * (a + b)
        if not min(a, b) < m < max(a, b):
            m = 0.5 * (a + b)
        if m in (a, b) or abs(b - a) <= 1e-15 * (abs(a) + abs(b)):
            return m
        value = _residual(functions, law, state, m)
        if value == 0.0:
            return m
        if (value > 0.0) == (value_a > 0.0):
            a, value_a = m, value
        else:
            b, value_b = m, value
    return b


@njit(nogil=True, inline="always")
def _may_vanish(value, before):
    """Tell whether a zero may lie between two residuals: signs differ, or one of the two has no value."""
    return (value > 0.0) != (before > 0.0) or value == 0.0 or np.isnan(value) != np.isnan(before)


@njit(cache=True, nogil=True)
def _zero_between(functions, law, state, a, b, value_a, value_b):
    """Return where between two inputs the residual is zero, and whether it is.

    A pole changes the sign too, and where functions end there is no sign to go by: neither is a zero.
    """
    if np.isnan(value_a):
        a, b, value_a, value_b = b, a, value_b, value_a
    m = _bisect(functions, law, state, a, b, value_a)
    size = abs(_residual(functions, law, state, m))
    if np.isnan(value_b):
        return m, size <= VANISHES * abs(value_a)
    return m, size <= max(abs(value_a), abs(value_b))


@njit(cache=True, nogil=True)
def _search(functions, law, state, previous):
    """Return the input nearest to the last one at which the residual is zero, and whether there is one.

    Steps go outwards on both sides and grow, so a pair of roots closer than a third of their distance from
    the last input may be overlooked. Where there is none, the input of the least residual met is returned;
    of those that tie the one nearest to the last input.
    """
    span = law.high - law.low
    inside = min(max(previous, law.low), law.high)
    at_rest = _residual(functions, law, state, inside)
    if at_rest == 0.0:
        return inside, True
    best, least = inside, np.inf if np.isnan(at_rest) else abs(at_rest)
    step = FIRST_STEP * span
    below, above = inside, inside
    value_below, value_above = at_rest, at_rest
    while below > law.low or above < law.high:
        if above < law.high:
            m = min(inside + step, law.high)
            value = _residual(functions, law, state, m)
            if _may_vanish(value, value_above):
                zero, is_zero = _zero_between(functions, law, state, above, m, value_above, value)
                if is_zero:
                    return zero, True
            above, value_above = m, value
            if is_better(abs(value), abs(m - inside), least, abs(best - inside)):
                best, least = m, abs(value)
        if below > law.low:
            m = max(inside - step, law.low)
            value = _residual(functions, law, state, m)
            if _may_vanish(value, value_below):
                zero, is_zero = _zero_between(functions, law, state, below, m, value_below, value)
                if is_zero:
                    return zero, True
            below, value_below = m, value
            if is_better(abs(value), abs(m - inside), least, abs(best - inside)):
                best, least = m, abs(value)
        step *= GROWTH
    return best, False


@njit(nogil=True, inline="always")
def _coefficients(window, base, program, first, degree, flip, c):
    """Write the coefficients in the move, times ``flip`` for each power; return the highest that is not 0."""
    highest = np.int64(0)  # a literal 0 has a type of its own, for which all that takes it is compiled too
    factor = 1.0
    for power in range(degree + 1):
        c[power] = factor * right_hand_side(window, base, program, first + power)
        if c[power] != 0.0:
            highest = np.int64(power)
        factor *= flip
    return highest


@njit(cache=True, nogil=True)
def _nearest_root(law, state, previous):
    """Return the input of Definition 4.1 or 4.2, and whether a root was admissible.

    Moves down are found as moves up of the mirrored polynomial. The side to which Newton's first step points
    comes first: its root bounds the search on the other. Where the sign of the machine's gain is known, the
    side that corrects the output of the input held comes first, and the other only where it has no root.
    """
    base = (law.n_rows - 1) * law.n_channels
    up, down = state.work[2], state.work[3]
    n_up = _coefficients(state.window, base, law.program, 0, law.degree, 1.0, up)
    second = (law.n_regimes - 1) * (law.degree + 1)
    n_down = _coefficients(state.window, base, law.program, second, law.degree, -1.0, down)
    if law.n_regimes == 1 and up[0] == 0.0 and law.low <= previous <= law.high:
        return previous, True
    m, shortest = previous, np.inf
    likely = 0 if up[0] * up[1] <= 0.0 else 1
    too_low = -up[0] * law.branch  # positive where the machine must be driven up
    if too_low != 0.0:
        likely = 0 if too_low > 0.0 else 1
    for side in (likely, 1 - likely):  # 0 is loading, 1 unloading
        start, end = _moves(law, previous, side)
        # a move that is longer than the one found would not be taken; of two alike the one up is
        end = min(end, shortest * (1.0 + ALIKE if side == 0 else 1.0 - ALIKE))
        c, n, sense = (up, n_up, 1.0) if side == 0 else (down, n_down, -1.0)
        move = first_root(c, n, start, end, state.chain, state.work)
        if not np.isnan(move):
            m, shortest = previous + sense * move, move
        if too_low != 0.0 and shortest < np.inf:
            break
    if shortest < np.inf:
        return m, True
    if law.policy == NEAREST:
        least = np.inf
        for side in range(2):  # of residuals alike the one after the shorter move is taken, then the one up
            start, end = _moves(law, previous, side)
            c, n, sense = (up, n_up, 1.0) if side == 0 else (down, n_down, -1.0)
            if start <= end:
                move, size = smallest_value(c, n, start, end, state.chain, state.work)
                if is_better(size, move, least, shortest):
                    m, least, shortest = previous + sense * move, size, move
    return m, False


@njit(nogil=True, inline="always")
def _moves(law, previous, side):
    """Return the shortest and the longest move up (side 0) or down (1) into the limits."""
    if side == 0:
        return max(law.low - previous, 0.0), law.high - previous
    return max(previous - law.high, 0.0), previous - law.low


@njit(nogil=True, inline="always")
def _is_at_rest(law, window, n_known):
    """Tell whether no known signal has moved over all rows that the law reads."""
    moves = 0.0
    for i in range(n_known):
        last = (law.n_rows - 1) * law.n_channels + 1 + i
        for row in range(1, law.reach + 1):
            moves += abs(window[last - row * law.n_channels] - window[last])
    return moves == 0.0


@njit(cache=True, nogil=True)
def _advance(functions, law, state, known):
    """Take the newest row of known signals (reference first), return the input m[k]; ``state`` is written."""
    nc, window = law.n_channels, state.window
    size = law.n_rows * nc
    for i in range(size - nc):
        window[i] = window[i + nc]
    found = True
    for i in range(known.size):
        is_given = np.isfinite(known[i])
        window[size - nc + 1 + i] = known[i] if is_given else window[size - 2 * nc + 1 + i]
        found = found and is_given
    _set_elements(law, state, law.n_rows - 1, OF_KNOWN)
    row = law.n_rows - 1 - law.horizon
    previous = window[(row - 1) * nc]
    state.counts[SAMPLES] += 1.0
    if law.method != SEARCH:
        _call(functions, window, row * nc)  # they do not read m[k]
    if law.keeps_rest == 1 and _is_at_rest(law, window, known.size):
        m = previous
    elif law.method == EXPLICIT:
        m = right_hand_side(window, size - nc, law.program, 0)
    else:
        if law.method == ROOTS:
            m, is_solved = _nearest_root(law, state, previous)
        else:
            m, is_solved = _search(functions, law, state, previous)
        if not is_solved and law.policy == HOLD:
            m = previous
        found = found and is_solved
    if not np.isfinite(m):
        m, found = previous, False
    if not found:
        state.counts[NO_SOLUTION] += 1.0
    limited = min(max(m, law.low), law.high)
    if limited != m:
        state.counts[AT_LIMIT] += 1.0
    m = min(max(limited, previous - law.max_step), previous + law.max_step)
    if m != limited:
        state.counts[AT_RATE] += 1.0
    window[row * nc] = m
    _set_elements(law, state, row, OF_INPUT)
    if law.method == SEARCH:
        _call(functions, window, row * nc)
    return m


@njit(cache=True, nogil=True)
def advance(integers, numbers, state, known):
    """Take the newest row of known signals (reference first), return the input m[k]; ``state`` is written."""
    return _advance(None, unpack_law(integers, numbers), unpack_state(integers, state), known)


@njit(cache=True, nogil=True)
def run(integers, numbers, state, known, m):
    """Compute a whole reference: row i of ``known``, shape (n_samples, n_known), gives ``m[i]``."""
    law, parts = unpack_law(integers, numbers), unpack_state(integers, state)
    for i in range(m.size):
        m[i] = _advance(None, law, parts, known[i])


@njit(cache=True, nogil=True)
def settle(integers, numbers, state, known, inputs):
    """Move the window over past rows of known signals and inputs, so that elements know their history.

    ``inputs[i]`` is the input ``horizon`` samples before row i, NaN where it is still to be found.
    """
    law = unpack_law(integers, numbers)
    parts = unpack_state(integers, state)
    nc, size = law.n_channels, law.n_rows * law.n_channels
    row = law.n_rows - 1 - law.horizon
    for k in range(inputs.size):
        for i in range(size - nc):
            parts.window[i] = parts.window[i + nc]
        for i in range(known.shape[1]):
            parts.window[size - nc + 1 + i] = known[k, i]
        _set_elements(law, parts, law.n_rows - 1, OF_KNOWN)
        parts.window[row * nc] = inputs[k]
        _set_elements(law, parts, row, OF_INPUT)


@njit(nogil=True, inline="always")
def _slopes_along(functions, integers, numbers, unlimited, state, known, step, every, slopes):
    """Write the derivatives of m[k] with respect to the past inputs, row by row of a run.

    Past inputs are moved by ``step`` to both sides and elements follow: those without memory wherever they
    read it, those with memory along a move on from the last input. ``slopes`` has one row for each
    ``every``-th sample and one column for each past input, newest first. The derivatives are those of the
    law with the numbers ``unlimited``, along the run of the law with its limits.
    """
    law, free = unpack_law(integers, numbers), unpack_law(integers, unlimited)
    parts = unpack_state(integers, state)
    spare = state.copy()
    n_past = slopes.shape[1]
    for k in range(known.shape[0]):
        n_trials = 2 * n_past if k % every == 0 and k // every < slopes.shape[0] else 0
        _copy(state, spare)
        # two trials for each past input, then the sample itself: one call, which the compiler pastes in once
        for trial in range(n_trials + 1):
            _copy(spare, state)
            side = step if trial % 2 == 0 else -step
            if trial < n_trials:
                _move_past_input(functions, law, parts, trial // 2, side)
            m = _advance(functions, free if trial < n_trials else law, parts, known[k])
            if trial < n_trials:
                before = slopes[k // every, trial // 2] if trial % 2 else 0.0
                slopes[k // every, trial // 2] = before + m / (2.0 * side)


@njit(cache=True, nogil=True)
def _move_past_input(functions, law, state, j, step):
    """Change the input ``j`` rows before the last one by ``step``, before the window moves on."""
    nc, window = law.n_channels, state.window
    row = law.n_rows - 1 - law.horizon
    at = (row - j) * nc
    before = window[at]
    window[at] += step
    for here in range(at, row * nc + 1, nc):
        _call(functions, window, here)
    for p in range(law.kinds.size):
        if law.of[p] != OF_INPUT:
            continue
        if law.kinds[p] > LAST_WITHOUT_MEMORY:
            if j == 0:
                window[at + law.channels[p]] = element_value(
                    law.kinds[p], law.parameters[p], window[at], before, state.elements[p]
                )
            continue
        for here in (at, at + nc):
            if nc <= here <= row * nc:
                window[here + law.channels[p]] = element_value(
                    law.kinds[p], law.parameters[p], window[here], window[here - nc], state.trial
                )


@njit(cache=True, nogil=True)
def slopes_along(integers, numbers, unlimited, state, known, step, every, slopes):
    """Write the derivatives of m[k] with respect to the past inputs; see `_slopes_along`."""
    _slopes_along(None, integers, numbers, unlimited, state, known, step, every, slopes)


INTEGERS, VECTOR = types.Array(types.int64, 1, "C"), types.Array(types.float64, 1, "C")
MATRIX = types.Array(types.float64, 2, "C")
FUNCTIONS = types.void(VECTOR, types.int64)
"""Signature of a law's ``functions(window, base)``."""


class WithFunctions(NamedTuple):
    """The kernels of laws with functions of the user's; their first argument is ``functions``."""

    advance: Callable
    run: Callable
    slopes_along: Callable


@lru_cache(maxsize=1)
def with_functions() -> WithFunctions:
    """Return the kernels, compiled at the first call for one signature that serves any ``functions``."""
    packed = (types.FunctionType(FUNCTIONS), INTEGERS, VECTOR, VECTOR)

    @njit(types.float64(*packed, VECTOR), cache=True, nogil=True)
    def advance_with(functions, integers, numbers, state, known):
        return _advance(functions, unpack_law(integers, numbers), unpack_state(integers, state), known)

    @njit(types.void(*packed, MATRIX, VECTOR), cache=True, nogil=True)
    def run_with(functions, integers, numbers, state, known, m):
        law, parts = unpack_law(integers, numbers), unpack_state(integers, state)
        for i in range(m.size):
            m[i] = _advance(functions, law, parts, known[i])

    @njit(types.void(*packed, VECTOR, MATRIX, types.float64, types.int64, MATRIX), cache=True, nogil=True)
    def slopes_with(functions, integers, numbers, unlimited, state, known, step, every, slopes):
        _slopes_along(functions, integers, numbers, unlimited, state, known, step, every, slopes)

    return WithFunctions(advance_with, run_with, slopes_with)

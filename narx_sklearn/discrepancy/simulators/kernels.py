"""The kernel under every simulator: windows of a record, effects at the state equations.

    x' = f(x, u, p) + sum_e force_e        (or x[k+1] = f(x[k], u[k], p) + sum_e force_e for a map)
    y  = h(x, u, p)                        (or h(x, u, p, x'), of what an accelerometer sees)

The right-hand side, the output and the forces of the effects enter by their ``addresses``.
"""

from functools import cache

import numpy as np
from numba import njit, types

from narx_sklearn.discrepancy.simulators.addresses import (
    MAX_THETA,
    borrowed,
    equation_at,
    force_at,
    keep,
    row_of,
    row_pointer,
    write,
)
from narx_sklearn.physics.effects._effect import MAX_MEMORY

MAX_EFFECTS = 4  # effects that act at state equations at the same time
SPILL = MAX_THETA - 1
AT_ONCE = 1e-6  # of a step
NEAR = 8.0  # times the jump of a rate at a switch, per step, within which a step looks at both of its sides
FINER = 8  # parts of a step in which a motion comes to rest, or turns about
AHEAD = 1.5  # times what a signal changes in a step, from zero, where the step is so parted
CLOSE = 1e-9  # of a step, that its middle may be off
AT_REST = 1e-3  # of what pushes at it, the rate of what friction holds
PUSH = 1e-6  # of an input, to feel how a force beside it moves its argument
UNBOUNDED = 1e15  # far above any physical state, far below overflow

VECTOR = types.Array(types.float64, 1, "C")
MATRIX = types.Array(types.float64, 2, "C")
INTEGERS = types.Array(types.int64, 1, "C")
FLAGS = types.Array(types.boolean, 1, "C")


@njit(nogil=True, inline="always")
def _weighed(weights, now, states):
    """Return the second argument of an effect; NaN where it has none, as its weights are then."""
    if np.isnan(weights[0]):
        return np.nan
    total = 0.0
    for i in range(now.size):
        total += weights[i] * now[i]
    for i in range(states.size):
        total += weights[now.size + i] * states[i]
    return total


@njit(nogil=True, inline="always")
def _moved(weights, effect, before, after, step):
    """Return an effect's argument where a step began and its mean rate over the step."""
    argument = 0.0
    rate = 0.0
    for i in range(before.size):
        argument += weights[effect, i] * before[i]
        rate += weights[effect, i] * (after[i] - before[i]) / step
    return argument, rate


@njit(nogil=True, inline="always")
def _shared(force, share):
    """Return a share of a force, nothing of one that does not act, defined or not."""
    return share * force if share != 0.0 else 0.0


@njit(nogil=True, inline="always")
def _dot(weights, which, x):
    """Return the product of a row of weights with a vector."""
    total = 0.0
    for i in range(x.size):
        total += weights[which, i] * x[i]
    return total


@njit(nogil=True, inline="always")
def _turns(signal, rate, push, h):
    """Return whether a signal may come to zero within a step, unless it rests there against a push."""
    return abs(signal) <= AHEAD * h * abs(rate) and abs(rate) > AT_REST * abs(push)


@njit(nogil=True, cache=True)
def _settle(equation, x, u, p, switch, distance, width, h, raw, rates, sides):
    """Change rates so that a switch at a ``distance`` does in a step what it does in the limit of short ones.

    Where both sides lead to it, the state comes to rest on the switch in one step, as far as the jump can
    hold the load; else it passes, and the jump is spread evenly over the step. What is held of a load between
    once and twice the jump's fades, so that the rates are continuous. (So sticks the catalogue's dry friction
    too; a kernel that is kept on disk and called it would not notice a change there.)
    """
    n = x.size
    side, over, under = sides[0], sides[1], sides[2]
    length = 0.0
    for i in range(n):
        length += switch[i] * switch[i]
    for i in range(n):
        side[i] = x[i] + max(width - distance, 0.0) * switch[i] / length
    write(equation, side, u, p, over)
    for i in range(n):
        side[i] = x[i] - max(width + distance, 0.0) * switch[i] / length
    write(equation, side, u, p, under)
    limit, load = 0.0, 0.0
    for i in range(n):
        limit += switch[i] * 0.5 * (under[i] - over[i])
        load += switch[i] * (rates[i] + 0.5 * (under[i] + over[i]) - raw[i])
    if not h * limit > width:  # nowhere so steep that a step could not follow
        return
    held = load
    if abs(load) > limit:
        held = max(2.0 * limit - abs(load), 0.0) * (1.0 if load > 0.0 else -1.0)
    gentler = 2.0 * limit / abs(load) if abs(load) > 2.0 * limit else 1.0
    share = min(max((held + gentler * distance / h) / limit, -1.0), 1.0)
    for i in range(n):
        rates[i] += 0.5 * (over[i] + under[i]) - raw[i] + share * 0.5 * (over[i] - under[i])


@njit(nogil=True, inline="always")
def _keep_to(edges, equation, x, u, p, h, raw, rates, sides):
    """Change rates wherever a switch is within reach of a step."""
    switches, authority, width = edges
    for e in range(switches.shape[0]):
        distance = _dot(switches, e, x)
        if abs(distance) <= h * (abs(_dot(switches, e, rates)) + NEAR * authority[e]):
            _settle(equation, x, u, p, row_of(switches, e), distance, width[e], h, raw, rates, sides)


@njit(nogil=True, inline="always")
def _is_parted(x, slope, settled, edges, weights, sticks, share, h):
    """Return whether a switch, or what a force that sticks acts on, may turn about within a step."""
    switches, authority, _ = edges
    parted = False
    for e in range(switches.shape[0]):
        signal, rate = _dot(switches, e, x), _dot(switches, e, row_of(slope, 0))
        parted = parted or _turns(signal, rate, authority[e], h)
    for e in range(sticks.size):
        if sticks[e] and share[e] != 0.0:
            signal, rate = _dot(weights, e, x), _dot(weights, e, row_of(slope, 0))
            parted = parted or _turns(signal, rate, _dot(weights, e, settled), h)
    return parted


@njit(nogil=True, inline="always")
def _force(effects, e, row, argument, rate, own, other, time, step):
    """Return the force of an effect, which writes a row of dz."""
    addresses, theta, z, dz = effects
    memory, values, written = row_pointer(z, e), row_pointer(theta, e), row_pointer(dz, row)
    return force_at(addresses[e])(argument, rate, own, other, time, step, memory, values, written)


@njit(nogil=True, inline="always")
def _gain_through(equation, x, u, p, channel, weights, e, rates, pushed):
    """Return by how much more an effect's argument changes per unit of an input."""
    entered = u[channel]
    nudge = PUSH * (1.0 + abs(entered))
    u[channel] = entered + nudge
    write(equation, x, u, p, pushed)
    u[channel] = entered
    gain = 0.0
    for i in range(x.size):
        gain += weights[e, i] * (pushed[i] - rates[i]) / nudge
    return gain


@njit(nogil=True, inline="always")
def _push_through(equation, x, u, p, channel, force, rates, pushed, slope, r):
    """Add to the rates of a stage what a force beside an input makes of them.

    A channel beyond the inputs is a state: what is added to it all equations have but its own.
    """
    if channel >= u.size:
        state = channel - u.size
        handed_on = x[state]
        x[state] = handed_on + force
        write(equation, x, u, p, pushed)
        x[state] = handed_on
        for i in range(x.size):
            if i != state:
                slope[r, i] += pushed[i] - rates[i]
        return
    entered = u[channel]
    u[channel] = entered + force
    write(equation, x, u, p, pushed)
    u[channel] = entered
    for i in range(x.size):
        slope[r, i] += pushed[i] - rates[i]


@njit(nogil=True, inline="always")
def _keep_stage(past, count, e, r, time, h, value):
    """Keep what a stage puts out, in a ring of steps.

    Of each that is when it began, how long it took, the values where it began, in the middle and where it
    ended, by which it goes on a parabola, and the integral up to where it began.
    """
    at = count[e, 0]
    if r == 0:
        past[e, at, 0], past[e, at, 2] = time, value
    elif r < 3:
        past[e, at, 3] = value if r == 1 else 0.5 * (past[e, at, 3] + value)
    else:
        past[e, at, 1], past[e, at, 4] = h, value


@njit(nogil=True, inline="always")
def _end_step(past, count, e):
    """Count the step that was under way among those kept."""
    at, size = count[e, 0], past.shape[1]
    _, step, first, middle, last, integral = past[e, at]
    past[e, (at + 1) % size, 5] = integral + step / 6.0 * (first + 4.0 * middle + last)
    count[e, 0] = (at + 1) % size
    count[e, 1] = min(count[e, 1] + 1, size - 1)


@njit(nogil=True, inline="always")
def _put_out_until(past, count, e, then, time, value, lacking):
    """Return the integral of what was put out until ``then``.

    Before all that is kept it is what came first, less the share that was lacking.
    """
    at, n, size = count[e, 0], count[e, 1], past.shape[1]
    begun, first, integral = past[e, at, 0], past[e, at, 2], past[e, at, 5]
    if then >= begun:
        on = then - begun
        slope = (value - first) / (time - begun) if time > begun else 0.0
        return integral + on * (first + 0.5 * on * slope)
    if n == 0:
        return integral + (then - begun) * first * (1.0 - lacking)
    back = min(max(int((begun - then) / past[e, (at - 1) % size, 1]), 1), n)
    while back < n and past[e, (at - back) % size, 0] > then:
        back += 1
    while back > 1 and past[e, (at - back + 1) % size, 0] <= then:
        back -= 1
    begun, step, first, middle, last, integral = past[e, (at - back) % size]
    on = min((then - begun) / step, 1.0)
    if on <= 0.0:
        return integral + (then - begun) * first * (1.0 - lacking)
    slope, bend = 4.0 * middle - 3.0 * first - last, 2.0 * (first - 2.0 * middle + last)
    return integral + step * on * (first + on * (slope / 2.0 + on * bend / 3.0))


@njit(nogil=True, inline="always")
def _as_it_was(past, count, e, r, late, time, h, value, lacking):
    """Return what was put out some time ago, the mean over the share of a step that a stage stands for.

    Then a step counts whatever jumped in it, and when. What lies ahead goes on as it did.
    """
    if late <= 0.0:
        return value
    wide = h / 6.0 if r % 3 == 0 else h / 3.0
    begin, end = time - late - (wide if r > 0 else 0.0), time - late + (wide if r < 3 else 0.0)
    until = _put_out_until(past, count, e, end, time, value, lacking)
    return (until - _put_out_until(past, count, e, begin, time, value, lacking)) / (end - begin)


@njit(nogil=True, inline="always")
def _inside_step(on, h, before, slope, x, moving):
    """Write the states a share of a step on, and with their rates, if asked for: the stages make a cubic.

    Hairer, Norsett and Wanner 1993, II.6.
    """
    outer, inner = on * on * (2 * on / 3 - 0.5), on * on * (1 - 2 * on / 3)
    for i in range(x.size):
        mean = outer * slope[3, i] + (on - on * on + outer) * slope[0, i]
        mean += inner * (slope[1, i] + slope[2, i])
        x[i] = before[i] + h * mean
        moving[i] = x[i]
        if moving.size > x.size:
            mean = (2 * on - 1) * (on * slope[3, i] + (on - 1) * slope[0, i])
            moving[x.size + i] = mean + 2 * on * (1 - on) * (slope[1, i] + slope[2, i])


@njit(nogil=True, inline="always")
def _with_rates(x, slope, r, moving):
    """Write states and, after them, their rates, if there is room for them."""
    for i in range(x.size):
        moving[i] = x[i]
        if moving.size > x.size:
            moving[x.size + i] = slope[r, i]


@njit(nogil=True, inline="always")
def _hand_on(states, through, seen, handed, on, n_inputs):
    """Add to states what outputs have of them too, a share of a step on: by a parabola through its stages."""
    for e in range(seen.size):
        if seen[e]:
            begin, middle, end = handed[0, e], 0.5 * (handed[1, e] + handed[2, e]), handed[3, e]
            slope, bend = 4.0 * middle - 3.0 * begin - end, 2.0 * (begin - 2.0 * middle + end)
            states[through[e] - n_inputs] += begin + on * (slope + on * bend)


@njit(nogil=True, inline="always")
def _observe(output, x, u, p, observed, out, k):
    """Write the outputs at sample k."""
    write(output, x, u, p, observed)
    for i in range(observed.size):
        out[k, i] = observed[i]


@njit(nogil=True, inline="always")
def _remember(z, e, count, dz, h):
    """Move the memory of an effect on by a step, from its rates at the four stages."""
    for j in range(count):
        first_half = dz[4 * e, j] + 2 * dz[4 * e + 1, j]
        second_half = 2 * dz[4 * e + 2, j] + dz[4 * e + 3, j]
        z[e, j] += h / 6.0 * (first_half + second_half)


@njit(nogil=True, inline="always")
def _write_inputs(ahead, k, has_next, u, tilt, linear_hold, now):
    """Write the inputs a share of a step after sample k; as they are where they are constant in between."""
    if linear_hold and has_next:
        for i in range(now.size):
            now[i] = u[k, i] + ahead * (u[k + 1, i] - u[k, i])
    elif tilt.shape[0] > 0:
        for i in range(now.size):
            now[i] = u[k, i] + (ahead - 0.5) * tilt[k, i]


@njit(nogil=True, cache=True)
def _simulate_windows(
    equation_address,
    output_address,
    force_addresses,
    n_forces,
    port,
    onward,
    through,
    weights,
    answer,
    seconds,
    strength,
    late,
    lacking,
    theta,
    memory,
    jumps,
    after,
    sticks,
    inertial,
    sums,
    seen,
    begins,
    ends,
    along,
    switches,
    authority,
    width,
    p,
    timed,
    x0,
    u,
    tilt,
    first,
    last,
    fresh,
    began,
    dt,
    substeps,
    linear_hold,
    discrete,
    sees_rates,
    special,
    y_out,
    x_out,
    z_out,
    middle_out,
    end_out,
):
    """Run every window from its own initial state; return the sample where the run left the finite range.

    `seconds` holds the weights of each effect's second argument on inputs and states, NaN where it has none.
    The states of the effects, z, are carried from one window to the next and start at zero where `fresh`.
    A force writes dz/dt; where the effect `jumps` (play operators) it writes z itself, after the move to the
    present argument. `tilt` says by how much each input rises within each step about its mean, u; it has no
    rows where inputs are constant there. A force that acts `after` the step too is a hard limit: within the
    step it acts at once where the limit has been reached, and then on the mean rate of the whole step, so
    that it is met exactly. An `inertial` force accelerates a map's signal, on whose rate it depends; where
    nothing else is its second argument, that is the acceleration without it. Where a force's argument is how
    fast two neighbours part, `answer` says how much faster that changes than the port does (else it is zero):
    what brings them to rest holds their acceleration against each other, over the answer. A force that acts
    `through` an input (else that is -1) is added to it, and the equations tell what it does; so is what is
    added to a state, which counts after the inputs, as all equations but its own have it; and outputs too,
    where it is `seen`. Of `sums` the second argument is what the force depends on (what a controller puts
    out). One that is `late`, by so much time, is what that was then, less what it is. Before a session what
    it depends on, and remembers, was what it is at first, less a `lacking` share of it; that is NaN of all
    that starts at zero. Each acts in the steps that start between its times `begins` and `ends`, counted from
    where the session began or, `along` the record, from its first sample. The equations jump by about twice
    an `authority` where one of the `switches` @ x is zero, to within a `width`.
    A step in which that happens, or a force that `sticks` turns about, is parted. An output that `sees_rates`
    is told those of the states, forces and all, where its sample's first step begins. Some values of `p` are
    `timed`: where each stands, what it is, between which times, else it is zero, and whether these are along
    the record; `p` is written to. `special` is None where
    there is no map and no switch and every force simply acts in its own state equation (and onward): numba
    compiles that case apart, and it runs in half the time.
    Written: y_out (n_samples, n_outputs), x_out (n_samples, n_states), z_out (n_samples, n_forces *
    MAX_MEMORY); and middle_out and end_out (n_samples, n_outputs), if they have rows: the outputs half a step
    after each sample, and a whole one, before a held input jumps. Rows outside the windows are left alone. -1
    is returned when all went well.
    """
    # owners of what inlined helpers are handed would be counted in every branch; what is borrowed has none
    weights, seconds, theta, switches, p, u, tilt = borrowed((weights, seconds, theta, switches, p, u, tilt))
    addresses, sticks, authority, width = borrowed((force_addresses, sticks, authority, width))
    y_out, middle_out, end_out = borrowed((y_out, middle_out, end_out))
    equation = equation_at(equation_address)
    output = equation_at(output_address)
    n_states = x0.shape[1]
    n_outputs = y_out.shape[1]
    of_motion = (
        np.empty(n_states),
        np.empty(n_states),
        np.empty((4, n_states)),
        np.empty(n_states),
        np.empty(n_states),
        np.empty(n_states),
        np.empty((3, n_states)),
        np.empty(n_states),
        np.empty(u.shape[1]),
        np.empty(n_outputs),
        np.empty(2 * n_states if sees_rates else n_states),
    )
    of_effects = (
        np.zeros(MAX_EFFECTS),
        np.zeros((MAX_EFFECTS, MAX_MEMORY)),
        np.zeros((MAX_EFFECTS, MAX_MEMORY)),
        np.zeros((MAX_EFFECTS * 4, MAX_MEMORY)),  # row 4 e + r: effect e at stage r
        np.zeros((4, MAX_EFFECTS)),
    )
    x, stage, slope, nominal, pushed, settled, sides, before, now, observed, moving = borrowed(of_motion)
    share, z, z_stage, dz, handed = borrowed(of_effects)
    effects, edges = (addresses, theta, z_stage, dz), (switches, authority, width)
    wants_middle = middle_out.shape[0] > 0
    failed = -1
    is_map = special is not None and discrete
    n_stages = 1 if is_map else 4
    has_switches = special is not None and switches.shape[0] > 0
    unsettled = nominal if has_switches else settled
    may_part = has_switches
    for e in range(n_forces):
        may_part = may_part or sticks[e]
    may_part = may_part and not is_map
    hands_on, longest = False, -1.0
    if special is not None:
        for e in range(n_forces):
            hands_on = hands_on or seen[e]
            longest = max(longest, late[e])
    n_kept = int(min(longest / dt, u.shape[0]) * substeps) + 4 if longest >= 0.0 else 0
    past = np.zeros((n_forces, n_kept * (FINER if may_part else 1), 6))
    count = np.zeros((n_forces, 2), dtype=np.int64)
    for w in range(first.size):
        begins_anew = fresh[w]
        if begins_anew:
            z[:] = 0.0
            count[:] = 0
        for i in range(n_states):
            x[i] = x0[w, i]
        broken = False
        for k in range(first[w], last[w]):
            for i in range(now.size):
                now[i] = u[k, i]
            _write_inputs(0.0, k, k + 1 < last[w], u, tilt, linear_hold, now)
            for i in range(n_states):
                x_out[k, i] = x[i]
                if not abs(x[i]) < UNBOUNDED:
                    broken = True
            for e in range(timed.shape[0]):
                since = (k if timed[e, 4] > 0.0 else k - began[w]) * dt
                p[int(timed[e, 0])] = timed[e, 1] if timed[e, 2] <= since < timed[e, 3] else 0.0
            for e in range(n_forces):
                since = (k if along[e] else k - began[w]) * dt
                share[e] = strength[e] if begins[e] <= since < ends[e] else 0.0
                for j in range(memory[e]):
                    z_out[k, e * MAX_MEMORY + j] = z[e, j]
            if broken:
                if failed < 0:
                    failed = k
                for rest in range(k, last[w]):
                    for i in range(n_outputs):
                        y_out[rest, i] = np.nan
                break
            if not (sees_rates or hands_on):
                _observe(output, x, now, p, observed, y_out, k)
            for s in range(substeps):
                parts, part = 1, 0
                h = dt / substeps
                while part < parts:
                    # a map adds whole increments, so to a force its step counts as one
                    force_step = 1.0 if is_map else h
                    for i in range(n_states):
                        before[i] = x[i]
                    reached = s * dt / substeps + part * h
                    r = 0
                    while r < n_stages:
                        # Runge-Kutta of order four: stages at 0, h/2, h/2, h
                        step = 0.0 if r == 0 else (0.5 * h if r < 3 else h)
                        for i in range(n_states):
                            stage[i] = x[i] if r == 0 else x[i] + step * slope[r - 1, i]
                        for e in range(n_forces):
                            for j in range(memory[e]):
                                z_stage[e, j] = z[e, j]
                                if r > 0 and not jumps[e]:
                                    z_stage[e, j] += step * dz[4 * e + r - 1, j]
                        _write_inputs((reached + step) / dt, k, k + 1 < last[w], u, tilt, linear_hold, now)
                        write(equation, stage, now, p, settled)
                        if has_switches:
                            for i in range(n_states):
                                nominal[i] = settled[i]
                            _keep_to(edges, equation, stage, now, p, h, nominal, settled, sides)
                        for i in range(n_states):
                            slope[r, i] = settled[i]
                        time = since + reached + step
                        for e in range(n_forces):
                            argument = 0.0
                            rate = 0.0
                            for i in range(n_states):
                                argument += weights[e, i] * stage[i]
                                if is_map:
                                    rate += weights[e, i] * (settled[i] - stage[i]) / dt
                                else:
                                    rate += weights[e, i] * settled[i]
                            other = _weighed(row_of(seconds, e), now, stage)
                            # in a map the port's own increment stands for its rate
                            own = slope[r, port[e]] - (stage[port[e]] if is_map else 0.0)
                            within = force_step
                            if special is not None:
                                if sums[e]:
                                    argument = other
                                if after[e]:
                                    within *= AT_ONCE
                                if is_map and (memory[e] > 0 or inertial[e]):
                                    within = dt  # a memory lives in time
                                gain = answer[e]
                                if 0 <= through[e] < now.size and not sums[e]:
                                    gain = _gain_through(
                                        equation, stage, now, p, through[e], weights, e, unsettled, pushed
                                    )
                                if gain > 0.0:  # a force of a rate; else its argument is a position
                                    own = 0.0
                                    for i in range(n_states):
                                        own += weights[e, i] * slope[r, i] / gain
                                    within *= gain
                                if inertial[e]:
                                    added = slope[r, port[e]] - settled[port[e]]
                                    own = rate + weights[e, port[e]] * added / dt
                                    other = own if np.isnan(other) else other
                                    # the last two values tell the rate half a step ago: half of what it gains
                                    # in a step has come since, the other half is still to come
                                    own *= 0.5
                                    argument += own * dt
                            row = 4 * e + r
                            if special is not None and begins_anew and not np.isnan(lacking[e]):
                                z[e, 0] = z_stage[e, 0] = argument * (1.0 - lacking[e])
                            if special is not None and late[e] >= 0.0:
                                _keep_stage(past, count, e, r, time, h, argument)
                                was = _as_it_was(past, count, e, r, late[e], time, h, argument, lacking[e])
                                force = was - argument
                            else:
                                force = _force(effects, e, row, argument, rate, own, other, time, within)
                            force = _shared(force, share[e])
                            if special is not None and inertial[e]:
                                force *= dt * dt
                            if special is not None and seen[e]:
                                handed[r, e] = force
                            if special is not None and through[e] >= 0:
                                _push_through(
                                    equation, stage, now, p, through[e], force, unsettled, pushed, slope, r
                                )
                            else:
                                slope[r, port[e]] += force
                            if onward[e] >= 0:
                                slope[r, onward[e]] -= theta[e, SPILL] * force
                        begins_anew = False
                        watched = r == 0 and parts == 1 and may_part
                        if watched and _is_parted(x, slope, settled, edges, weights, sticks, share, h):
                            parts = FINER
                            h /= FINER
                            force_step = h
                            continue
                        if (sees_rates or hands_on) and r == 0 and part == 0 and s == 0:
                            _with_rates(x, slope, 0, moving)
                            if hands_on:
                                _hand_on(moving, through, seen, handed, 0.0, now.size)
                            _observe(output, moving, now, p, observed, y_out, k)
                        r += 1
                    if is_map:
                        for i in range(n_states):
                            x[i] = slope[0, i]
                    else:
                        for i in range(n_states):
                            x[i] += h / 6.0 * (slope[0, i] + 2 * slope[1, i] + 2 * slope[2, i] + slope[3, i])
                    for e in range(n_forces):
                        if special is None or not after[e]:
                            continue
                        argument, rate = _moved(weights, e, before, x, h)
                        other = _weighed(row_of(seconds, e), now, before)
                        own = (x[port[e]] - before[port[e]]) / force_step
                        time, row = since + reached, 4 * e
                        force = _force(effects, e, row, argument, rate, own, other, time, force_step)
                        force = _shared(force, share[e] * force_step)
                        x[port[e]] += force
                        if onward[e] >= 0:
                            x[onward[e]] -= theta[e, SPILL] * force
                    if wants_middle and reached < dt * (0.5 + CLOSE) and reached + h > dt * (0.5 + CLOSE):
                        on = max(0.5 * dt - reached, 0.0) / h
                        _inside_step(on, h, before, slope, stage, moving)
                        _write_inputs(0.5, k, k + 1 < last[w], u, tilt, linear_hold, now)
                        if hands_on:
                            _hand_on(moving, through, seen, handed, on, now.size)
                        _observe(output, moving, now, p, observed, middle_out, k)
                    if wants_middle and s == substeps - 1 and part == parts - 1:
                        _with_rates(x, slope, 3, moving)
                        _write_inputs(1.0, k, k + 1 < last[w], u, tilt, linear_hold, now)
                        if hands_on:
                            _hand_on(moving, through, seen, handed, 1.0, now.size)
                        _observe(output, moving, now, p, observed, end_out, k)
                    for e in range(n_forces):
                        if special is not None and late[e] >= 0.0:
                            _end_step(past, count, e)
                        if is_map and memory[e] > 0 and not jumps[e]:
                            # a memory goes on between the samples, while what it depends on moves evenly
                            argument, rate = _moved(weights, e, before, x, dt)
                            other = _weighed(row_of(seconds, e), now, before)
                            own = x[port[e]] - before[port[e]]
                            if inertial[e]:
                                own = 0.5 * rate
                                argument += own * dt
                            for r in range(4):
                                step = 0.0 if r == 0 else (0.5 * dt if r < 3 else dt)
                                for j in range(memory[e]):
                                    z_stage[e, j] = z[e, j] + (step * dz[4 * e + r - 1, j] if r > 0 else 0.0)
                                moved, time, row = argument + step * rate, since + step, 4 * e + r
                                _force(effects, e, row, moved, rate, own, other, time, dt)
                        if jumps[e]:
                            for j in range(memory[e]):
                                z[e, j] = dz[4 * e, j]
                        else:
                            _remember(z, e, memory[e], dz, h)
                    part += 1
    keep(of_motion)
    keep(of_effects)
    return failed


@cache
def simulate_windows():
    """Return the compiled kernel, fixed to two signatures so that no call compiles it again."""
    before = (
        types.int64,
        types.int64,
        INTEGERS,
        types.int64,
        *[INTEGERS] * 3,
        MATRIX,
        VECTOR,
        MATRIX,
        *[VECTOR] * 3,
        MATRIX,
        INTEGERS,
        *[FLAGS] * 6,
        *[VECTOR] * 2,
        FLAGS,
        MATRIX,
        *[VECTOR] * 3,
        *[MATRIX] * 4,
        INTEGERS,
        INTEGERS,
        FLAGS,
        INTEGERS,
        types.float64,
        types.int64,
        types.boolean,
        types.boolean,
        types.boolean,
    )
    for special in (types.none, types.boolean):
        _simulate_windows.compile((*before, special, *[MATRIX] * 5))
    _simulate_windows.disable_compile()
    return _simulate_windows

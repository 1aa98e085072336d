"""What effects add along a run: their forces and corrections, sample by sample."""

import numpy as np

from narx_sklearn.discrepancy.fitting.problem import Model, Problem
from narx_sklearn.discrepancy.placed import PlacedEffect, Port, in_turn
from narx_sklearn.discrepancy.simulators.addresses import MAX_THETA, compiled_force
from narx_sklearn.discrepancy.simulators.kernels import PUSH
from narx_sklearn.discrepancy.simulators.simulator import Run, Signal, Simulator, Windows, evaluate
from narx_sklearn.discrepancy.simulators.varied import compiled_factor
from narx_sklearn.model.units import rate_of, tidy_unit
from narx_sklearn.physics.effects._effect import MAX_MEMORY


def state_forces(
    simulator: Simulator, run: Run, u: np.ndarray, windows: Windows, rows: np.ndarray
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Return (argument, force) of each effect at a state equation, by its index, at some samples of a run.

    Evaluated as the simulators' kernel does: in turn, each on top of those before it.

    Parameters
    ----------
    simulator : Simulator
        With the effects and parameters of the run.
    rows : ndarray of shape (n_points,)
        Samples inside the windows, where the run is finite.
    """
    acting = [(i, simulator.effects[i]) for i in in_turn(simulator.effects)]
    functions = [None if p.force is None else compiled_force(p.force) for _, p in acting]
    late = [_late(placed, run, u, windows, rows, simulator.dt) for _, placed in acting]
    thetas = np.zeros((len(acting), MAX_THETA))
    for theta, (_, placed) in zip(thetas, acting, strict=True):
        n = len(placed.effect.parameters)
        theta[:n] = placed.theta[:n]
    ages = age_of(windows, rows)
    acts = [acts_along(placed, windows, rows, simulator.dt) for _, placed in acting]
    arguments, values = np.zeros((2, len(acting), rows.size))
    for at, (k, age) in enumerate(zip(rows, ages, strict=True)):
        x, now = run.x[k], u[k]
        slope = evaluate(simulator, x, now)[0]
        nominal = slope.copy()
        change = (slope - x) / simulator.dt if simulator.discrete else nominal
        for e, (_, placed) in enumerate(acting):
            weights, port = np.array(placed.weights), placed.port.index
            second = placed.second_of(now[None], x[None])
            driving = np.nan if second is None else second[0]
            arguments[e, at], rate = placed.argument_of(now[None], x[None])[0], weights @ change
            own = slope[port] - (x[port] if simulator.discrete else 0.0)
            step = _step(placed, simulator)
            gain = 0.0 if placed.inertial else placed.answer
            if placed.through >= 0 and not placed.is_on_sum:
                push = PUSH * (1.0 + abs(now[placed.through]))
                gain = weights @ (_beside(simulator, x, now, placed.through, push) - nominal) / push
            if gain > 0:
                own, step = weights @ slope / gain, step * gain
            if placed.inertial:
                own = rate + weights[port] * (slope[port] - nominal[port]) / simulator.dt
                driving = own if second is None else driving
                own = 0.5 * own
                arguments[e, at] += own * simulator.dt
            values[e, at] = late[e][at]
            function = functions[e]
            if function is not None:
                values[e, at] = function(
                    arguments[e, at],
                    rate,
                    own,
                    driving,
                    age * simulator.dt,
                    step,
                    run.z[k, e * MAX_MEMORY : (e + 1) * MAX_MEMORY].copy(),
                    thetas[e],
                    np.zeros(MAX_MEMORY),
                )
            values[e, at] = values[e, at] if acts[e][at] else 0.0
            if placed.handed_on and placed.through < 0:
                change_elsewhere = _moved(simulator, x, now, port, values[e, at]) - nominal
                change_elsewhere[port] = 0.0  # its own equation has it as it is
                slope += change_elsewhere
            elif placed.through >= 0:
                slope += _beside(simulator, x, now, placed.through, values[e, at]) - nominal
            else:
                slope[port] += placed.added(simulator.dt) * values[e, at]
            if placed.onward >= 0:
                slope[placed.onward] -= placed.taken_onward * values[e, at]
    return {i: (arguments[e], values[e]) for e, (i, _) in enumerate(acting)}


def _late(
    placed: PlacedEffect, run: Run, u: np.ndarray, windows: Windows, rows: np.ndarray, dt: float
) -> np.ndarray:
    """Return what a dead time adds to a controller's output at some samples; zeros of all else."""
    if placed.dead_time is None or placed.lacking is None:
        return np.zeros(rows.size)
    put_out = placed.argument_of(u, run.x)
    then, began = rows - placed.dead_time / dt, rows - age_of(windows, rows)
    known = np.flatnonzero(np.isfinite(put_out))
    was = np.interp(np.maximum(then, began), known, put_out[known])
    return np.where(then < began, 1.0 - placed.lacking, 1.0) * was - put_out[rows]


def _beside(simulator: Simulator, x: np.ndarray, u: np.ndarray, through: int, force: float) -> np.ndarray:
    """Return the rates (n_states,) with a force beside an input."""
    moved = np.array(u, dtype=float)
    moved[through] += force
    return evaluate(simulator, x, moved)[0]


def _moved(simulator: Simulator, x: np.ndarray, u: np.ndarray, state: int, added: float) -> np.ndarray:
    """Return the rates (n_states,) with something added to a state."""
    moved = np.array(x, dtype=float)
    moved[state] += added
    return evaluate(simulator, moved, u)[0]


def acts_along(placed: PlacedEffect, windows: Windows, rows: np.ndarray, dt: float) -> np.ndarray:
    """Tell at which samples inside the windows an effect acts."""
    return placed.during.holds(rows, rows - age_of(windows, rows), dt)


def age_of(windows: Windows, rows: np.ndarray) -> np.ndarray:
    """Return how many samples of its session went before each of some samples."""
    return rows - windows.began[np.maximum(np.searchsorted(windows.first, rows, side="right") - 1, 0)]


def _step(placed: PlacedEffect, simulator: Simulator) -> float:
    """Return what counts as a step to a force: one increment of a map, but time where it has a memory."""
    if simulator.discrete and not (placed.n_memory or placed.inertial):
        return 1.0
    return simulator.dt / simulator.substeps


def signal_change(
    placed: PlacedEffect,
    signals: np.ndarray,
    u: np.ndarray,
    x: np.ndarray,
    windows: Windows,
    rows: np.ndarray,
    dt: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return what an effect at an input or output depends on there, and what it adds to the signal.

    At a parameter its values stand in the signals' place, (n_parameters,).
    """
    second = placed.second_of(u[rows], x[rows])
    if placed.port.is_parameter and second is not None:
        factor, theta = compiled_factor(placed.effect.factor), np.array(placed.theta)
        more = np.array([factor(value, theta) for value in second]) - 1.0
        return second, signals[placed.port.index] * np.where(acts_along(placed, windows, rows, dt), more, 0.0)
    signal = signals[rows, placed.port.index]
    begin = np.searchsorted(rows, windows.first[windows.fresh])
    changed = placed.effect.transform(signal, second, dt, np.array(placed.theta), begin)
    added = np.where(acts_along(placed, windows, rows, dt), changed - signal, 0.0)
    return (signal if second is None or not placed.is_fed else second), added


def correction(
    problem: Problem, model: Model, run: Run, index: int, rows: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return what one effect of a model adds along its run while it acts: samples, argument, what is added.

    Parameters
    ----------
    run : Run
        Of the model.
    index : int
        Of the effect.
    rows : ndarray of shape (n_points,)
        Samples inside the windows, where the run is finite.
    most : int
        Samples that are returned at most, every so manyth of the rows.
    """
    simulator = problem.simulator.with_parameters(model.p).with_effects(model.effects)
    placed = model.effects[index]
    acts = np.flatnonzero(acts_along(placed, problem.windows, rows, simulator.dt))
    chosen = acts[:: max(1, -(-acts.size // most))]
    if placed.port.kind == "state":
        argument, added = state_forces(simulator, run, problem.u, problem.windows, rows[chosen])[index]
        return rows[chosen], argument, added
    others = model._replace(effects=tuple(e for i, e in enumerate(model.effects) if i != index))
    before = problem.run(others).y if placed.port.kind == "output" else run.y
    signals = placed.port.signals(problem.u, before, model.p)
    argument, added = signal_change(placed, signals, problem.u, run.x, problem.windows, rows, simulator.dt)
    return rows[chosen], argument[chosen], added[chosen]


def correction_unit(placed: PlacedEffect, simulator: Simulator) -> str:
    """Return the unit of what an effect adds: a state's rate (the state, in a map), an input, an output."""
    unit = _signal(placed.port, simulator).unit
    if placed.through >= 0:
        return simulator.inputs[placed.through].unit
    if placed.handed_on:
        return unit
    if placed.inertial:
        return tidy_unit(f"{unit}/s^2") if unit else ""
    return unit_added(placed.port, simulator)


def correction_name(placed: PlacedEffect, simulator: Simulator) -> str:
    """Return what an effect adds to what, without the unit."""
    if placed.through >= 0:
        return f"added to {simulator.inputs[placed.through].name}"
    if placed.handed_on:
        return f"added to {_signal(placed.port, simulator).name}"
    if placed.inertial:
        return f"added to the acceleration of {_signal(placed.port, simulator).name}"
    return name_added(placed.port, simulator)


def added_in_words(unit: str, name: str) -> str:
    """Return what is added, its unit before it; of per cent it is said that they are no share of anything.

    Examples
    --------
    >>> from narx_sklearn.discrepancy.fitting.acting import added_in_words
    >>> added_in_words("m/s", "added to velocity"), added_in_words("-", "added to ratio")
    ('m/s added to velocity', 'added to ratio')
    >>> added_in_words("%", "added to level"), added_in_words("%/s", "added to the rate of level")
    ('percentage points added to level', 'percentage points/s added to the rate of level')
    """
    unit = "" if unit == "-" else unit
    plain = f"percentage points{unit[1:]}" if unit == "%" or unit.startswith("%/") else unit
    return f"{plain} {name}".lstrip()


def unit_added(port: Port, simulator: Simulator) -> str:
    """Return the unit of what is added at a port, that of a rate where it is a state equation."""
    unit = _signal(port, simulator).unit
    is_rate = port.kind == "state" and not simulator.discrete
    return tidy_unit(f"{unit or 1}/s") if is_rate else unit


def name_added(port: Port, simulator: Simulator) -> str:
    """Return what is added to at a port, without the unit."""
    name = _signal(port, simulator).name
    is_rate = port.kind == "state" and not simulator.discrete
    return f"added to the {rate_of(name)}" if is_rate else f"added to {name}"


def _signal(port: Port, simulator: Simulator) -> Signal:
    return simulator.signals_at(port.kind)[port.index]


def port_in_words(port: Port, simulator: Simulator) -> str:
    """Return where a port is: "in the equation of velocity", "on the input drive", "in the parameter R0"."""
    name = _signal(port, simulator).name
    if port.kind == "state":
        return f"in the equation of {name}"
    return f"in the parameter {name}" if port.is_parameter else f"on the {port.kind} {name}"

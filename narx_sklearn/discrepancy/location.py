"""Where the mismatch is, gathered for a fitted diagnosis."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd

from narx_sklearn.discrepancy.fitting.acting import correction
from narx_sklearn.discrepancy.locate import (
    bands,
    concentrated_force,
    features,
    invariances,
    latent_force,
    latent_forces,
    port_table,
    ports_of,
    regions,
    stated_regions,
    tangent,
)
from narx_sklearn.discrepancy.placed import PlacedEffect, Port
from narx_sklearn.discrepancy.search.inference import covariance
from narx_sklearn.discrepancy.simulators.simulator import Signal, Simulator, Windows
from narx_sklearn.discrepancy.stages.diagnosis import Diagnosis
from narx_sklearn.model.units import rate_of, tidy_unit

FEWEST_KNOWN = 400  # samples of an unknown signal, from which it is described
MOST_ACTING = 20_000  # samples at which it is asked what an effect adds
MOST_TURNS = 4  # ranges that a curve of a signal may go up and down by
LIKELY = 1.64  # standard errors, by which the ends of where an effect acts may be off
NEAR = 1e-6  # of a signal's range, within which it has reached a limit
STEP = 1e-6  # of a parameter, for how the ends of where an effect acts move with it
NOTICEABLE = 0.5  # of the largest size of what is added to a signal, from which on it lives there
LOST = 0.2  # of a signal's gain: a rounded corner lies where as much is gone
SINGLE = 1e-6  # of its range, by which a curve may differ at one value
TOLD = ["value", "low", "high", "reading"]  # of each property of an unknown signal
LONGEST = 100_000  # samples looked at; the windows in the middle of a longer record stand for it


class Location(NamedTuple):
    """Where a refitted simulation and a recording part.

    Attributes
    ----------
    ports : DataFrame
        Ports by how well an unknown signal there explains the residual; the first is that at which something
        acts that follows no signal, where that was found.
    segments : DataFrame
        Stretches of time that hold more of the error than chance, counted along the record. Where an effect
        was found to act for a while, its time comes first, ``effect`` names it and ``p_value`` is that of the
        diagnosis; stretches apart from it follow.
    regions : DataFrame
        Readable rules, each with its share of the energy and the time of what acts; ``effect`` says what
        that is: one that was named, or, empty, the unknown signal at the likeliest port.
    bands : DataFrame
        Frequencies at which the residual stands above the noise, of each ``output``.
    force : DataFrame
        The unknown signal at the likeliest port: ``sample``, ``force`` in the port's unit, and the standard
        ``deviation`` of that estimate.
    invariances : DataFrame
        What that signal does and does not depend on, where what is missing has no name (see
        :func:`~narx_sklearn.discrepancy.locate.invariances`): a row a property, with its ``reading``.
    against : tuple of str
        The signals x, v and u that the readings speak of.
    """

    ports: pd.DataFrame
    segments: pd.DataFrame
    regions: pd.DataFrame
    bands: pd.DataFrame
    force: pd.DataFrame
    invariances: pd.DataFrame
    against: tuple[str, ...]

    @property
    def likeliest(self) -> Port:
        """The first of the ports."""
        first = self.ports.to_dict("records")[0]
        return Port(first["kind"], int(first["index"]))


def locate(diagnosis: Diagnosis, random_state=None, n_jobs: int | None = None) -> Location:
    """Locate the mismatch that is left after the simulator's own parameters were refitted."""
    problem, p = diagnosis.problem, diagnosis.refitted.model.p
    simulator = problem.simulator
    windows, x0 = _middle(problem.windows, diagnosis.refitted.model.x0)
    run = simulator.run(problem.u, windows, x0, p)
    allowed = [
        port
        for port in ports_of(simulator)
        if port.kind != "state" or not diagnosis.structure.kinematic[port.index]
    ]
    residual = problem.y - run.y
    _, forces = latent_forces(simulator, run, problem.u, problem.y, windows, p, ports=allowed, n_jobs=n_jobs)
    table = port_table(forces, simulator, windows)
    if diagnosis.unforeseen is None:
        best = max(forces, key=lambda force: force.evidence)
    else:
        entry, memory = diagnosis.unforeseen.acting.entry, diagnosis.unforeseen.memory
        beside, p = diagnosis.best.fit.model, diagnosis.best.fit.model.p
        simulator = simulator.with_effects(beside.effects)
        run = simulator.run(problem.u, windows, _middle(problem.windows, beside.x0)[1], p)
        linear = tangent(simulator, run, problem.u, windows, p)
        best = latent_force(linear, problem.y - run.y, windows, entry, memory=memory)
        if entry.times is not None:
            best = replace(best, w=best.w * entry.times, w_std=best.w_std * np.abs(entry.times))
        there = (table["kind"] == entry.port.kind) & (table["index"] == entry.port.index)
        table = pd.concat([table[there], table[~there]], ignore_index=True)
    inside = slice(int(windows.first[0]), int(windows.last[-1]))
    if diagnosis.is_named:
        rules = _where_effects_act(diagnosis)
    else:
        corrected = run.x + best.dx
        signal = concentrated_force(
            best, tangent(simulator, run._replace(x=corrected), problem.u, windows, p)
        )
        places = _features(simulator, problem.u, corrected, windows, inside)
        rules = regions(signal[inside], places, random_state=random_state).assign(effect="")
    spectra = _spectra(simulator, residual[inside], problem.y[inside])
    samples = np.arange(inside.start, inside.stop)
    force = pd.DataFrame({"sample": samples, "force": best.w[inside], "deviation": best.w_std[inside]})
    nothing = pd.DataFrame(columns=TOLD, index=pd.Index([], name="property"))
    return Location(table, _stretches(diagnosis), rules, spectra, force, nothing, ())


def with_invariances(location: Location, diagnosis: Diagnosis) -> Location:
    """Return a location that tells what the unknown signal at the likeliest port is like.

    It is held against the position and rate that its equation has, or a signal and its rate, and an input.
    """
    problem, (kind, port) = diagnosis.problem, location.likeliest
    simulator, samples = problem.simulator, location.force["sample"].to_numpy()
    run = problem.run(diagnosis.best.fit.model)
    x, u, names = run.x[samples], problem.u[samples], simulator.states
    drive, force = 0, location.force["force"].to_numpy()

    def with_rate(values: np.ndarray, signal: Signal) -> tuple[np.ndarray, np.ndarray, str, str]:
        moves = Signal(rate_of(signal.name), tidy_unit(f"{signal.unit}/s") if signal.unit else "")
        return values, np.gradient(values, simulator.dt), str(signal), str(moves)

    if kind == "input":
        position, rate, *called = with_rate(u[:, port], simulator.inputs[port])
        drive = next((j for j in range(u.shape[1]) if j != port), port)
    elif kind == "output":
        position, rate, *called = with_rate(run.y[samples, port], simulator.outputs[port])
        # what is asked for is what is left; a smoother would call it coloured noise
        force = (problem.y - diagnosis.base_run.y)[samples, port]
    else:
        partner = diagnosis.structure.partner[port]
        if partner >= 0:
            position, rate, called = x[:, partner], x[:, port], [str(names[partner]), str(names[port])]
        else:
            position, rate, *called = with_rate(x[:, port], names[port])
        drive = next(iter(np.flatnonzero(diagnosis.structure.inputs[port]).tolist()), 0)
    pushed, push = np.zeros(samples.size), "no input"
    if simulator.inputs:
        pushed, push = u[:, drive], str(simulator.inputs[drive])
    windows = problem.windows
    begins = windows.first[windows.fresh] - samples[0]  # the past does not reach across sessions
    begins = begins[(begins >= 0) & (begins < samples.size)]
    known = np.isfinite(np.column_stack([force, position, rate, pushed])).all(axis=1)
    if known.sum() < FEWEST_KNOWN:
        return location
    try:
        table = invariances(force, position, rate, pushed, simulator.dt, first=begins)
    except ValueError:  # in short sessions too few samples have a past
        return location
    return location._replace(invariances=table, against=(*called, push))


def _spectra(simulator: Simulator, residual: np.ndarray, y: np.ndarray) -> pd.DataFrame:
    """Return the bands of every output, one below the other."""
    tables = [bands(*signals, simulator.dt) for signals in zip(residual.T, y.T, strict=True)]
    for table, signal in zip(tables, simulator.outputs, strict=True):
        table.insert(0, "output", str(signal))
    return pd.concat([table for table in tables if len(table)] or tables[:1], ignore_index=True)


def _features(
    simulator: Simulator, u: np.ndarray, x: np.ndarray, windows: Windows, inside: slice
) -> pd.DataFrame:
    """Return what the machine is doing along a part of a record, each session by itself."""
    first = np.unique(np.maximum(windows.began - inside.start, 0))
    first = first[first < inside.stop - inside.start]
    return features(
        u[inside], x[inside], simulator.dt, inputs=simulator.inputs, states=simulator.states, first=first
    )


def _where_effects_act(diagnosis: Diagnosis) -> pd.DataFrame:
    """Return the regions in which each of the effects found acts, along the corrected run.

    Where an effect acts in a range that its own parameters give, that is told, else where what it adds is
    most. That has no noise in it, so that a limit is found where it was fitted.
    """
    problem, model = diagnosis.problem, diagnosis.best.fit.model
    run = problem.run(model)
    rows = problem.samples_of(run)
    found = []
    for index, placed in enumerate(model.effects):
        at, argument, added = correction(problem, model, run, index, rows, MOST_ACTING)
        inside = slice(int(at[0]), int(at[-1]) + 1)
        table = _features(problem.simulator, problem.u, run.x, problem.windows, inside)
        table = table.iloc[at - inside.start]
        shown, floor, telling = _shown(problem.simulator, placed, argument, added, table)
        rules = _stated(diagnosis, index, shown, table)
        if rules is None or rules.empty:
            rules = regions(shown, telling, floor=floor, noise_free=True)
        found.append(rules.assign(effect=placed.name.code))
    some = [rules for rules in found if len(rules)]
    return pd.concat(some, ignore_index=True) if some else found[0]


def _stated(diagnosis: Diagnosis, index: int, added: np.ndarray, table: pd.DataFrame) -> pd.DataFrame | None:
    """Return the regions that an effect's own parameters give, of a signal that has a name; None for none."""
    simulator, fit = diagnosis.problem.simulator, diagnosis.best.fit
    placed, own = fit.model.effects[index], fit.model.theirs[index]
    acts_in, (kind, at) = placed.effect.acts_in, placed.port
    if kind == "state":
        weights = np.array(placed.weights)
        if placed.is_fed or np.count_nonzero(weights) != 1 or weights.max() != 1.0:
            return None
        at = int(np.argmax(weights))
    feature = str(simulator.signals_at(kind)[at])
    if acts_in is None or feature not in table:
        return None
    theta = placed.own_theta
    spans = np.array(acts_in(theta))
    ends = np.isfinite(spans)
    slopes = slopes_of_ends(acts_in, theta)[:, ends]
    own = slice(own.start, own.start + theta.size)
    varied = covariance(diagnosis.problem, fit)[own, own]

    def error(slope: np.ndarray) -> float:
        return LIKELY * float(np.sqrt(max(slope @ varied @ slope, 0.0)))

    is_centred = np.abs(spans[ends].mean()) <= error(slopes.mean(axis=1))
    if placed.effect.after:  # what is held at a limit lies on neither side of it
        spans = widened(spans, [max(error(slope), NEAR * np.ptp(table[feature])) for slope in slopes.T])
    return stated_regions(added, table, feature, spans, is_centred=is_centred)


def slopes_of_ends(acts_in, theta: np.ndarray) -> np.ndarray:
    """Return how the ends of where an effect acts move with each parameter, (n_parameters, n_spans, 2).

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.location import slopes_of_ends
    >>> slopes = slopes_of_ends(lambda theta: ((theta[0] ** 2, np.inf),), np.array([3.0]))
    >>> round(float(slopes[0, 0, 0]), 4)
    6.0
    """
    steps = np.diag(STEP * np.where(theta != 0, np.abs(theta), 1.0))
    with np.errstate(invalid="ignore"):  # of infinite ends
        return np.array([np.subtract(acts_in(theta + step), acts_in(theta)) / step.sum() for step in steps])


def widened(spans: np.ndarray, by) -> np.ndarray:
    """Return ranges with each of their finite ends moved outwards.

    Parameters
    ----------
    spans : ndarray of shape (n_spans, 2)
        Lower and upper ends, infinite where there is none.
    by : sequence of float
        For each finite end, span by span.

    Examples
    --------
    >>> import numpy as np
    >>> from narx_sklearn.discrepancy.location import widened
    >>> widened(np.array([[-np.inf, -1.0], [2.0, np.inf]]), [0.25, 0.5]).tolist()
    [[-inf, -0.75], [1.5, inf]]
    """
    ends = np.isfinite(spans)
    off = np.zeros_like(spans)
    off[ends] = by
    return spans + off * [-1.0, 1.0]


def _stretches(diagnosis: Diagnosis) -> pd.DataFrame:
    """Return the times at which effects were found to act for a while, and what else stands out."""
    table, _, residual = diagnosis.stretches
    windows, dt = diagnosis.problem.windows, diagnosis.problem.simulator.dt
    passing = [effect for effect in diagnosis.best.effects if effect.passes]
    if not diagnosis.is_named or not passing:
        return table.assign(effect="")
    samples = np.arange(int(windows.first[0]), int(windows.last[-1]))
    energy = np.nansum(residual[samples] ** 2, axis=1)
    rows = []
    for effect in passing:
        for began in np.unique(windows.began):  # in each session at the same time, if not along the record
            own = windows.began == began
            inside = (samples >= windows.first[own].min()) & (samples < windows.last[own].max())
            acts = inside & effect.during.holds(samples, began, dt)
            if not acts.any():
                continue
            start, stop = samples[acts][[0, -1]] + (0, 1)
            row = {"start": start, "stop": stop, "start_s": start * dt, "stop_s": stop * dt}
            row |= {"share": energy[acts].sum() / energy.sum(), "time_share": acts.mean(), "z_score": np.nan}
            rows.append(row | {"p_value": diagnosis.p_missing, "event": "", "effect": effect.name.code})
            table = table[(table["start"] >= stop) | (table["stop"] <= start)]
    return pd.concat(
        [pd.DataFrame(rows), *([table.assign(effect="")] if len(table) else [])], ignore_index=True
    )


def _shown(
    simulator: Simulator, placed: PlacedEffect, argument: np.ndarray, added: np.ndarray, table: pd.DataFrame
) -> tuple[np.ndarray, float, pd.DataFrame]:
    """Return what shows where an effect acts, the variance from which on it does, and features that tell it.

    A curve of a signal acts where it has a slope, and its own signal tells that: where few samples lie,
    another may by chance. A signal that loses its gain little by little does so where a fifth of it is gone,
    or half of the most that the record shows.
    """
    port = placed.port
    if port.kind == "state":
        return added, 0.0, table
    slope = _slope(argument, added)
    shown = added if slope is None else slope
    half = NOTICEABLE * float(np.abs(shown).max())
    if slope is None:
        return shown, half**2, table
    signal = simulator.signals_at(port.kind)[port.index]
    own = [column for column in (f"{signal}", f"|{signal}|") if column in table]
    return shown, min(LOST, half) ** 2, table[own] if own else table


def _slope(argument: np.ndarray, added: np.ndarray) -> np.ndarray | None:
    """Return the slope of what is added to a signal where it is a curve of that signal, else None.

    What leaves a dead zone is short of the command all along, but lives where nothing passes.
    """
    values, first, which = np.unique(argument, return_index=True, return_inverse=True)
    curve = added[first]
    turns = np.abs(np.diff(curve)).sum() > MOST_TURNS * np.ptp(curve)
    if values.size < 2 or turns or np.abs(curve[which] - added).max() > SINGLE * np.ptp(curve):
        return None
    slope = np.diff(curve) / np.diff(values)
    return np.append(slope, slope[-1])[which]


def _middle(windows: Windows, x0: np.ndarray) -> tuple[Windows, np.ndarray]:
    """Return the windows, or as many in the middle of the record as can be looked at in reasonable memory."""
    lengths = windows.last - windows.first
    if lengths.sum() <= LONGEST:
        return windows, x0
    count = max(1, int(LONGEST // lengths.mean()))
    begin = (windows.count - count) // 2
    keep = slice(begin, begin + count)
    fresh = windows.fresh[keep].copy()
    fresh[0] = True
    return Windows(windows.first[keep], windows.last[keep], fresh, windows.began[keep]), x0[keep]

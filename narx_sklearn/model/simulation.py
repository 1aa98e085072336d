"""Simulation of NARX models: free run, one step ahead, k steps ahead, steady state.

Which is which: *one step ahead* computes ``y[k]`` from measured outputs up to ``k-1``; *k steps ahead*
from measured outputs up to ``k-steps`` and its own predictions after; the *free run* from an initial
condition and its own predictions only. A simulation is judged by its free run.
"""

import warnings
from dataclasses import dataclass

import numpy as np

from narx_sklearn._validation import (
    all_finite,
    as_signals,
    check_indexes,
    check_inputs_given,
    check_same_length,
    finite_rows,
    finite_slices,
    session_slices,
)
from narx_sklearn.exceptions import DivergenceWarning
from narx_sklearn.model import kernels
from narx_sklearn.model.narx import NARXModel
from narx_sklearn.model.phi import FunctionPhi, Phi
from narx_sklearn.model.recording import Layout, lay_out, shift_and_scale

__all__ = ["FreeRun", "free_run", "predict_k_steps", "predict_one_step", "steady_state"]

SETTLING_STEPS = 1_000, 10_000, 100_000  # tried in turn; what has not settled in the last is not used
LARGEST = np.finfo(float).max  # the end of the finite range


@dataclass(frozen=True)
class FreeRun:
    """A free run and how it ended.

    Attributes
    ----------
    y : ndarray of shape (n_samples, n_outputs)
        Simulated outputs; NaN in gaps of the input and after a divergence.
    stopped_at : int or None
        First sample at which an output left the finite range, None if none did.
    started_from : str
        Where the initial conditions came from: ``"y_init"``, ``"steady state"``, or ``"both"`` when some
        pieces (sessions, or what a gap of the input leaves of them) found none in ``y_init``.
    """

    y: np.ndarray
    stopped_at: int | None
    started_from: str


def layout_of(model: NARXModel) -> Layout:
    """Return the channel layout of a model's own signals."""
    return Layout.of(model.outputs, model.inputs, model.phi, model.origin)


def program_of(model: NARXModel) -> kernels.Program:
    """Return the model's equations as integers and coefficients.

    Within an equation the terms stand by number of factors (see `kernels.Program`), and in each group those
    of the newest outputs last: in a free run the other terms are summed while the last output is still
    being computed.
    """
    n_channels = len(model.channels)
    table = model.library.table(model.channels)
    steps = table.channels - table.lags * n_channels
    n_factors = (table.factors >= 0).sum(axis=1)
    group = np.where((n_factors >= 1) & (n_factors <= 3), n_factors - 1, 3)
    inputs = set(model.inputs)
    newest = [
        min((v.lag for v in term.variables if v.signal not in inputs), default=np.inf)
        for term in model.library
    ]
    order = np.lexsort((-np.array(newest), group))
    equation_start, group_start, factor_start, factor_step, coefficients = [0], [], [0], [], []
    for column in model.parameters.T:
        used = order[column[order] != 0.0]
        group_start.append(equation_start[-1] + np.searchsorted(group[used], np.arange(4)))
        for t in used:
            factor_step.extend(steps[table.factors[t, : n_factors[t]]])
            factor_start.append(len(factor_step))
            coefficients.append(column[t])
        equation_start.append(len(coefficients))
    return kernels.Program(
        np.array(equation_start, dtype=np.int64),
        np.array(group_start, dtype=np.int64).reshape(-1, 4),
        np.array(factor_start, dtype=np.int64),
        np.array(factor_step, dtype=np.int64),
        np.array(coefficients, dtype=float),
    )


def stepped_phis(layout: Layout) -> list[Phi]:
    """Return the phi regressors that the free-run kernel steps itself: those of outputs, but no functions."""
    return [p for p in layout.phi if layout.depends_on_output(p) and not isinstance(p, FunctionPhi)]


def phi_program_of(layout: Layout) -> kernels.PhiProgram:
    """Return the phi regressors that a free run computes as it goes: those of outputs."""
    channels = layout.channels
    inside = stepped_phis(layout)
    width = max((p.kernel_parameters.size for p in inside), default=1)
    parameters = np.zeros((len(inside), width))
    for row, phi in zip(parameters, inside, strict=True):
        row[: phi.kernel_parameters.size] = phi.kernel_parameters
    sources = np.array([channels.index(p.signal) for p in inside], dtype=np.int64)
    return kernels.PhiProgram(
        np.array([p.kind for p in inside], dtype=np.int64),
        sources,
        np.array([channels.index(str(p.name)) for p in inside], dtype=np.int64),
        layout.origin[sources],
        parameters,
    )


def free_run(model: NARXModel, X, y_init=None, *, sessions=None, bound: float = np.inf) -> FreeRun:
    """Simulate a model from an initial condition and the input alone.

    Parameters
    ----------
    model : NARXModel
        The model.
    X : array-like of shape (n_samples, n_inputs)
        Inputs, in their units. NaN marks gaps; the simulation starts anew after each.
    y_init : array-like of shape (n_init,), (n_init, n_outputs), or as long as ``X``, default=None
        Measured outputs whose first ``max_lag`` samples are the initial condition. As long as ``X``: those
        of each session. A single value where the model needs no more: one output, a longest lag of 1. Where
        they are not given or hold NaN (and everywhere with None) the simulation starts from the model's
        steady state for the first input; ``started_from`` says so.
    sessions : array-like of shape (n_samples,), default=None
        One label a sample; where it changes, the simulation starts anew.
    bound : float, default=inf
        Largest deviation of an output from the operating point before the run counts as divergent;
        positive. The end of the finite range counts in any case.

    Returns
    -------
    FreeRun
        Outputs of shape (n_samples, n_outputs), and how the run ended.

    Raises
    ------
    ValueError
        If ``X`` or ``y_init`` does not fit the model, ``y_init`` is shorter than the longest lag or has
        too few samples for several sessions, or ``bound`` is not positive.

    Warns
    -----
    DivergenceWarning
        If an output leaves the finite range; says at which sample.

    Examples
    --------
    >>> from narx_sklearn.model import NARXModel, free_run
    >>> model = NARXModel.from_equations("0.5*y[k-1] + u[k-1]")
    >>> free_run(model, [1.0, 1.0, 0.0, 0.0], y_init=[0.0]).y.ravel().tolist()
    [0.0, 1.0, 1.5, 0.75]
    """
    X = _model_inputs(model, X)
    initial = _initial_outputs(model, y_init, X.shape[0])
    pieces = session_slices(sessions, X.shape[0])
    if initial is not None and initial.shape[0] < X.shape[0] and len(pieces) > 1:
        raise ValueError(
            f"y_init has {initial.shape[0]} samples for {len(pieces)} sessions; pass the measured outputs "
            f"of all {X.shape[0]} samples, of which the first {model.max_lag} of each session are used."
        )
    layout, program, bound = layout_of(model), program_of(model), _finite_bound(bound)
    y = np.empty((X.shape[0], len(model.outputs)))
    if not all_finite(X):
        finite = finite_rows(X)
        y[~finite] = np.nan
        pieces = finite_slices(pieces, finite)
    stopped_at = None
    given = []
    for piece in pieces:
        start = None if initial is None else initial[piece][: model.max_lag]
        n_needed = min(model.max_lag, piece.stop - piece.start)
        if start is not None and (len(start) < n_needed or not np.isfinite(start).all()):
            start = None
        given.append(start is not None)
        if start is None:
            rest = steady_state(model, X[piece.start])
            end = _run_from_rest(layout, program, model.max_lag, X[piece], rest, y[piece], bound)
        else:
            y[piece][: len(start)] = start
            end = _simulate(layout, program, X[piece], y[piece], len(start), bound)
        if end < piece.stop - piece.start:
            y[piece][end:] = np.nan
            stopped_at = piece.start + end if stopped_at is None else stopped_at
    if stopped_at is not None:
        warnings.warn(
            f"The free run left the finite range at sample {stopped_at}; it is NaN from there to the end of "
            "its session. The model is unstable for this input or initial condition.",
            DivergenceWarning,
            stacklevel=2,
        )
    started_from = "steady state" if not any(given) else "y_init" if all(given) else "both"
    return FreeRun(y, stopped_at, started_from)


def _run_from_rest(
    layout: Layout,
    program: kernels.Program,
    depth: int,
    X: np.ndarray,
    rest: np.ndarray,
    y: np.ndarray,
    bound: float,
) -> int:
    """Simulate as if the first input and the outputs ``rest`` had been held before; as `_simulate`."""
    held = np.concatenate([np.repeat(X[:1], depth, axis=0), X])
    longer = np.empty((held.shape[0], y.shape[1]))
    longer[:depth] = rest
    end = _simulate(layout, program, held, longer, depth, bound)
    y[:] = longer[depth:]
    return end - depth


def _simulate(
    layout: Layout, program: kernels.Program, X: np.ndarray, y: np.ndarray, first: int, bound: float
) -> int:
    """Simulate rows ``first`` and on, writing ``y``; return the row at which it stopped (none: n_samples)."""
    flat, state, phis = simulation_state(layout, X, y, first)
    functions = [
        (layout.channels.index(str(p.name)), p)
        for p in layout.phi
        if isinstance(p, FunctionPhi) and layout.depends_on_output(p)
    ]
    n_channels = len(layout.channels)
    stop = X.shape[0]
    if not functions:
        end = kernels.free_run(flat, n_channels, first, stop, program, phis, state, bound)
    else:
        end = _run_with_functions(flat, layout, functions, first, stop, program, phis, state, bound)
    simulated = flat.reshape(-1, n_channels)[first:end, : y.shape[1]]
    np.add(simulated, layout.origin[: y.shape[1]], out=y[first:end])
    return end


def simulation_state(layout: Layout, X: np.ndarray, y: np.ndarray, first: int):
    """Return flattened channels, phi states and phi program for a run from row ``first``.

    Rows of ``y`` before ``first`` are the initial condition; later ones are not read. Before the first
    sample signals are held.
    """
    n_outputs, n_signals = len(layout.outputs), len(layout.outputs) + len(layout.inputs)
    data = np.zeros((X.shape[0], len(layout.channels)))
    data[:first, :n_outputs] = y[:first]
    data[:, n_outputs:n_signals] = X
    for i, phi in enumerate(layout.phi):
        known = first if layout.depends_on_output(phi) else X.shape[0]
        signals = dict.fromkeys(variable.signal for variable in phi.arguments)
        sources = [data[:known, layout.channels.index(signal)] for signal in signals]
        if known:
            data[:known, n_signals + i] = phi.run(*sources)
    stepped = stepped_phis(layout)
    state = np.zeros((len(stepped), kernels.STATE_SIZE))
    for p, phi in enumerate(stepped):
        _, state[p] = phi.run_with_state(np.ascontiguousarray(y[:first, layout.outputs.index(phi.signal)]))
    shift_and_scale(layout, data)
    return data.reshape(-1), state, phi_program_of(layout)


def _run_with_functions(flat, layout, functions, first, stop, program, phis, state, bound):
    """Free run sample by sample, calling the user's Python functions of outputs after each."""
    n_channels = len(layout.channels)
    rows = flat.reshape(-1, n_channels)
    for k in range(first, stop):
        end = kernels.free_run(flat, n_channels, k, k + 1, program, phis, state, bound)
        if end == k:
            return k
        for channel, phi in functions:
            arguments = []
            for variable in phi.of:
                source = layout.channels.index(variable.signal)
                row = max(k - variable.lag, 0)
                arguments.append(rows[row : row + 1, source] + layout.origin[source])
            rows[k, channel] = np.asarray(phi.function(*arguments), dtype=float).reshape(-1)[0]
    return stop


def predict_one_step(model: NARXModel, X, y, *, sessions=None) -> np.ndarray:
    """Predict each output from measured data up to the sample before.

    Parameters
    ----------
    model : NARXModel
        The model.
    X : array-like of shape (n_samples, n_inputs)
        Inputs.
    y : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Measured outputs; only past ones are read.
    sessions : array-like of shape (n_samples,), default=None
        One label a sample.

    Returns
    -------
    ndarray of shape (n_samples, n_outputs)
        Predictions; NaN where a lagged value is not known.

    Examples
    --------
    >>> from narx_sklearn.model import NARXModel, predict_one_step
    >>> model = NARXModel.from_equations("0.5*y[k-1] + u[k-1]")
    >>> predict_one_step(model, [1.0, 1.0, 0.0], [0.0, 2.0, 4.0]).ravel().tolist()
    [nan, 1.0, 2.0]
    """
    check_indexes(X, y)
    X, y = _model_inputs(model, X), _model_outputs(model, y)
    check_same_length(X=X, y=y)
    layout = layout_of(model)
    recording = lay_out(layout, X, y, sessions)
    table = model.library.table(model.channels)
    rows = recording.rows(table.channels, table.lags)
    predictions = np.full(y.shape, np.nan)
    kernels.one_step_rows(
        recording.data.reshape(-1), len(model.channels), rows, program_of(model), predictions
    )
    return _add_origin(predictions, layout)


def _add_origin(predictions: np.ndarray, layout: Layout) -> np.ndarray:
    origin = layout.origin[: predictions.shape[1]]
    return predictions + origin if origin.any() else predictions


def predict_k_steps(
    model: NARXModel, X, y, steps: int, *, sessions=None, bound: float = np.inf
) -> np.ndarray:
    """Predict each output from measured outputs up to ``steps`` samples before, by simulation since.

    Parameters
    ----------
    model : NARXModel
        The model.
    X : array-like of shape (n_samples, n_inputs)
        Inputs.
    y : array-like of shape (n_samples,) or (n_samples, n_outputs)
        Measured outputs.
    steps : int
        Prediction horizon in samples; 1 gives `predict_one_step`.
    sessions : array-like of shape (n_samples,), default=None
        One label a sample.
    bound : float, default=inf
        Largest deviation from the operating point before a simulation counts as divergent; positive.

    Returns
    -------
    ndarray of shape (n_samples, n_outputs)
        Predictions; NaN where the past is not known or the simulation diverged.

    Examples
    --------
    >>> from narx_sklearn.model import NARXModel, predict_k_steps
    >>> model = NARXModel.from_equations("0.5*y[k-1] + u[k-1]")
    >>> predict_k_steps(model, [1.0, 1.0, 0.0], [0.0, 2.0, 4.0], steps=2).ravel().tolist()
    [nan, nan, 1.5]
    """
    if not isinstance(steps, int | np.integer) or steps < 1:
        raise ValueError(f"steps must be a positive integer, got {steps!r}.")
    if steps == 1:
        return predict_one_step(model, X, y, sessions=sessions)
    layout = layout_of(model)
    for phi in layout.phi:
        if isinstance(phi, FunctionPhi) and layout.depends_on_output(phi):
            raise ValueError(
                f"{phi.name} is a Python function of an output, for which k-step prediction is not compiled; "
                "use the free run or one-step prediction."
            )
    check_indexes(X, y)
    X, y = _model_inputs(model, X), _model_outputs(model, y)
    check_same_length(X=X, y=y)
    recording = lay_out(layout, X, y, sessions)
    depth = max(model.max_lag, 1)
    phis = phi_program_of(layout)
    rows = recording.rows(*_measured_variables(model, layout, phis, steps))
    rows = rows[rows - steps + 1 - depth >= recording.session_start[rows]]
    predictions = np.full(y.shape, np.nan)
    kernels.k_steps(
        recording.data.reshape(-1),
        len(layout.channels),
        rows,
        recording.session_start,
        int(steps),
        depth,
        program_of(model),
        phis,
        _finite_bound(bound),
        predictions,
    )
    return _add_origin(predictions, layout)


def _measured_variables(model: NARXModel, layout: Layout, phis: kernels.PhiProgram, steps: int):
    """Return channels and lags of all measured values that a simulation of ``steps`` samples reads."""
    n_outputs = len(layout.outputs)
    source = dict(zip(phis.channels.tolist(), phis.sources.tolist(), strict=True))
    table = model.library.table(layout.channels)
    read = set()
    for channel, lag in zip(table.channels.tolist(), table.lags.tolist(), strict=True):
        for back in range(lag, lag + steps):
            if back >= steps or not (channel < n_outputs or channel in source):
                read.add((channel, back))
            elif channel in source:  # stepped inside the run; its first step looks one sample back
                read.add((source[channel], steps))
    channels, lags = zip(*sorted(read), strict=True) if read else ((), ())
    return np.array(channels, dtype=np.int64), np.array(lags, dtype=np.int64)


def steady_state(model: NARXModel, u) -> np.ndarray:
    """Return the outputs at which the model rests for a constant input.

    Of several stable fixed points (Def. 2.3) the one nearest to the operating point is returned; where the
    model rests anywhere (a continuum), or nowhere, the operating point itself.

    Parameters
    ----------
    model : NARXModel
        The model.
    u : array-like of shape (n_inputs,)
        Constant inputs.

    Returns
    -------
    ndarray of shape (n_outputs,)

    Raises
    ------
    ValueError
        If ``u`` does not hold one finite value for each input.

    Examples
    --------
    >>> from narx_sklearn.model import NARXModel, steady_state
    >>> steady_state(NARXModel.from_equations("0.5*y[k-1] + u[k-1]"), [1.0]).tolist()
    [2.0]
    """
    u = np.asarray(u, dtype=float).reshape(-1)
    if u.shape != (len(model.inputs),) or not np.all(np.isfinite(u)):
        raise ValueError(
            f"u must hold one finite value for each of the inputs {list(model.inputs)}, got {u}."
        )
    depth = max(model.max_lag, 1)
    origin = np.array([model.origin.get(output, 0.0) for output in model.outputs])
    if len(model.outputs) == 1 and not model._output_phis:
        point = _scalar_steady_state(model, u)
        return origin if point is None else origin + point
    layout, program = layout_of(model), program_of(model)
    for steps in SETTLING_STEPS:
        X = np.repeat(u[None], depth + steps, axis=0)
        y = np.repeat(origin[None], depth + steps, axis=0)
        if _simulate(layout, program, X, y, depth, LARGEST) < X.shape[0]:
            return origin
        if np.allclose(y[-1], y[-2], rtol=1e-9, atol=1e-12 * np.abs(y[-1]).max()):
            return y[-1]
    return origin


def _scalar_steady_state(model: NARXModel, u: np.ndarray) -> float | None:
    """Return the stable fixed point nearest to zero deviation, None if there is none."""
    levels = dict(zip(model.inputs, u, strict=True))
    output = model.outputs[0]
    resting = {}
    for phi in model.phi:
        sources = [np.full(2, levels[s]) for s in dict.fromkeys(v.signal for v in phi.arguments)]
        resting[phi.name] = float(phi.run(*sources)[-1])
    constant = {
        v: resting.get(v.signal, levels.get(v.signal, 0.0) - model.origin.get(v.signal, 0.0))
        for v in model.library.variables
        if v.signal != output
    }
    side = model.equation().substitute(constant)
    lags = sorted({v.lag for v in side.variables})
    balance = np.zeros(max(side.degree, 1) + 1)
    for term, value in side.items:
        balance[term.degree] += value
    balance[1] -= 1.0
    if not lags:
        return balance[0]
    roots = np.polynomial.polynomial.polyroots(np.trim_zeros(balance, "b")) if balance.any() else np.array([])
    real = roots[np.abs(roots.imag) <= 1e-9 * np.maximum(1.0, np.abs(roots))].real
    stable = []
    for point in real:
        at = dict.fromkeys(side.variables, point)
        slopes = np.zeros(max(lags))
        for variable in side.variables:
            slopes[variable.lag - 1] += side.derivative(variable)(at)
        if np.abs(np.roots([1.0, *-slopes])).max(initial=0.0) < 1.0:
            stable.append(float(point))
    return min(stable, key=abs) if stable else None


def _finite_bound(bound: float) -> float:
    if not bound > 0:
        raise ValueError(f"bound must be positive, got {bound!r}; it is the largest deviation allowed.")
    return min(float(bound), LARGEST)


def _model_inputs(model: NARXModel, X) -> np.ndarray:
    check_inputs_given(X, model.inputs)
    X = as_signals(X, "X")
    if X.shape[1] != len(model.inputs):
        raise ValueError(
            f"X has {X.shape[1]} columns, the model has the {len(model.inputs)} inputs {list(model.inputs)}."
        )
    return X


def _model_outputs(model: NARXModel, y, name: str = "y") -> np.ndarray:
    y = as_signals(y, name)
    if y.shape[1] != len(model.outputs):
        raise ValueError(
            f"{name} has {y.shape[1]} columns, the model has the {len(model.outputs)} outputs "
            f"{list(model.outputs)}."
        )
    return y


def _initial_outputs(model: NARXModel, y_init, n_samples: int) -> np.ndarray | None:
    if y_init is None:
        return None
    if not model.max_lag:
        return np.zeros((n_samples, len(model.outputs)))
    if not hasattr(y_init, "columns") and np.asarray(y_init).ndim == 0:
        if model.max_lag * len(model.outputs) > 1:
            shape = model.max_lag if len(model.outputs) == 1 else (model.max_lag, len(model.outputs))
            raise ValueError(
                f"y_init is the single value {y_init!r}, but the model needs the last {model.max_lag} "
                f"outputs (longest lag of its terms). Pass at least {model.max_lag * len(model.outputs)} "
                f"values, as with np.full({shape}, {y_init!r}) where it has been held."
            )
        y_init = np.reshape(y_init, 1)
    initial = _model_outputs(model, y_init, "y_init")
    if initial.shape[0] < model.max_lag:
        raise ValueError(
            f"y_init has {initial.shape[0]} samples, but the model needs the last {model.max_lag} outputs "
            f"(longest lag of its terms). Pass at least {model.max_lag} values."
        )
    return initial

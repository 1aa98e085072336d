"""A NARX model as a simulator: a map whose states are lagged outputs and inputs."""

from collections import Counter
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from narx_sklearn.discrepancy.simulators.equations import compiled_lines
from narx_sklearn.discrepancy.simulators.linearise import steady_state
from narx_sklearn.discrepancy.simulators.ode import check_period, describe
from narx_sklearn.discrepancy.simulators.simulator import Parameter, Signal, Simulator
from narx_sklearn.model import FunctionPhi, NARXModel, Phi, Term, Variable
from narx_sklearn.model import steady_state as model_steady_state
from narx_sklearn.model.kernels import PLAY, STATE_SIZE, phi_run, phi_value


class NARXSimulator(Simulator):
    """Simulate a NARX model sample by sample, so that physics can be added to it.

    The model is a map ``x[k+1] = f(x[k], u[k], p)`` (2.12): its states are the lagged outputs, whose initial
    values are free, and the lagged inputs and the memories of phi regressors, which follow from what was
    measured. Its parameters are the coefficients of its terms. The output is ``y[k]``, the newest of the
    lagged outputs; where a term reads ``u[k]`` (delay 0) it is computed from states that end at ``y[k-1]``.

    Parameters
    ----------
    model : NARXModel
        The model; hand-written, published or fitted.
    dt : float, default=None
        Sampling period, s. None takes the model's own.

    Raises
    ------
    TypeError
        If ``model`` is no `NARXModel`.
    ValueError
        If the sampling period is not known, or differs from the model's.

    Notes
    -----
    With delay 0 what acts at a state port reaches the output one sample later than with delay 1, for the
    output is then computed before the state is stepped.

    Examples
    --------
    >>> from narx_sklearn.discrepancy import NARXSimulator
    >>> from narx_sklearn.model import NARXModel
    >>> sim = NARXSimulator(NARXModel.from_equations("0.5*y[k-1] + u[k-1]"), dt=0.1)
    >>> sim.simulate([0.0, 1.0, 1.0, 0.0]).ravel().tolist()
    [0.0, 0.0, 1.0, 1.5]
    """

    discrete = True

    def __init__(self, model: NARXModel, dt: float | None = None):
        if not isinstance(model, NARXModel):
            raise TypeError(
                f"model must be a NARXModel, got {type(model).__name__}; of an estimator pass its model_."
            )
        known = model.sampling_period
        if dt is None and known is None:
            raise ValueError("The model has no sampling_period; pass dt, the sampling period in seconds.")
        self.dt = check_period(known if dt is None else dt)
        if known is not None and not np.isclose(self.dt, known):
            raise ValueError(f"dt is {self.dt:g} s, but the model's sampling_period is {known:g} s.")
        self.structure = model
        self.states = _layout(model).signals
        self.inputs = tuple(Signal(name, model.units.get(name, "")) for name in model.inputs)
        self.outputs = tuple(Signal(name, model.units.get(name, "")) for name in model.outputs)
        self.parameters = tuple(_parameters(model))

    @property
    def model(self) -> NARXModel:
        """The model with the present parameter values; effects are not part of it."""
        parameters = np.array(self.structure.parameters)
        parameters.T[parameters.T != 0] = self.nominal
        return self.structure.with_parameters(parameters)

    @property
    def free_states(self):
        """Which initial states are unknown: the lagged outputs."""
        return _layout(self.structure).free

    def known_states(self, u, y, samples, began=None):
        """Return the states at the given samples, from what was measured before them.

        Parameters
        ----------
        u : ndarray of shape (n_samples, n_inputs)
            Measured inputs.
        y : ndarray of shape (n_samples, n_outputs)
            Measured outputs.
        samples : ndarray of shape (n,)
            Where the states are wanted.
        began : ndarray of shape (n,), default=None
            First sample of the session of each; before it signals are held. None: one session.

        Returns
        -------
        ndarray of shape (n, n_states)
        """
        samples = np.asarray(samples, dtype=np.int64)
        began = np.zeros(samples.size, dtype=np.int64) if began is None else np.asarray(began)
        return _layout(self.structure).measured(u, y, samples, began)

    def steady_state(self, u, p=None) -> np.ndarray:
        """Return states at which the model rests under constant inputs ``u``, or raise a ValueError."""
        return steady_state(self, np.atleast_1d(np.asarray(u, dtype=float)), p)

    def _initial_states(self, u, windows):
        model, layout = self.model, _layout(self.structure)
        start = np.empty((windows.count, len(self.states)))
        for w, first in enumerate(windows.first):
            rest = model_steady_state(model, u[first])[None]
            start[w] = layout.measured(u[first : first + 1], rest, np.zeros(1, int), np.zeros(1, int))[0]
        return start

    def _equations(self):
        return _equations_of(_Structure(self.structure))

    def __repr__(self) -> str:
        return describe(self, f"NARXSimulator of {self.structure!r}, dt={self.dt:g} s")


class _Structure:
    """A model as a key: equal where the terms and the phi regressors are, whatever the coefficients."""

    def __init__(self, model: NARXModel):
        self.model = model
        pattern = (np.asarray(model.parameters) != 0).tobytes()
        origin = tuple(sorted(model.origin.items()))
        self.key = (model.library.terms, pattern, model.outputs, model.inputs, model.phi, origin)

    def __eq__(self, other):
        return self.key == other.key

    def __hash__(self):
        return hash(self.key)


class _Memory(NamedTuple):
    """A phi regressor with a memory of its own: where its memory and its past values stand."""

    phi: Phi
    start: int  # of its memory among the states
    size: int
    past: tuple[int, ...]  # states that hold its values of ages 1, 2, ...


class _Layout(NamedTuple):
    """Which state is what.

    The age of a value counts back from the newest that a step may read: of outputs ``y[k-1]`` has age 0; of
    inputs ``u[k]`` has age 0 where a term reads it (delay 0), else ``u[k-1]``.
    """

    model: NARXModel
    feeds_through: bool
    lagged: dict[tuple[str, int], int]  # (signal, age) -> state
    memories: dict[str, _Memory]
    signals: tuple[Signal, ...]

    @property
    def free(self) -> np.ndarray:
        """Which states are outputs."""
        outputs = [index for (signal, _), index in self.lagged.items() if signal in self.model.outputs]
        free = np.zeros(len(self.signals), dtype=bool)
        free[outputs] = True
        return free

    def age(self, signal: str, lag: int) -> int:
        """Return how old a lagged value is."""
        return lag if signal in self.model.inputs and self.feeds_through else lag - 1

    def lag(self, signal: str, age: int) -> int:
        """Return by how many samples a value of some age lies before the state's own sample."""
        return age + (self.feeds_through and signal not in self.model.inputs)

    def measured(self, u, y, samples, began) -> np.ndarray:
        """Return the states at samples, from measurements; signals are held before a session's begin."""
        columns = {name: y[:, i] for i, name in enumerate(self.model.outputs)}
        columns |= {name: u[:, i] for i, name in enumerate(self.model.inputs)}
        x = np.empty((samples.size, len(self.signals)))
        for (signal, age), index in self.lagged.items():
            lag = self.lag(signal, age)
            x[:, index] = columns[signal][np.maximum(samples - lag, began)]
        for memory in self.memories.values():
            self._remembered(memory, columns[memory.phi.signal], samples, began, x)
        return x

    def _remembered(self, memory: _Memory, source, samples, began, x) -> None:
        """Write a phi regressor's memory and past values at samples into the states ``x``."""
        phi = memory.phi
        # a step takes in the value of age 0, so all older ones are in already
        age_1 = self.lag(phi.signal, 1)
        for session in np.unique(began):
            state = np.zeros(STATE_SIZE)
            done = int(session)
            recent: list[float] = []
            chosen = np.flatnonzero(began == session)
            for i in chosen[np.argsort(samples[chosen], kind="stable")]:
                # at least one: held before it began
                stop = max(int(samples[i]) - age_1 + 1, int(session) + 1)
                stretch = np.nan_to_num(np.ascontiguousarray(source[done:stop]))
                if stretch.size:
                    values = np.empty(stretch.size)
                    phi_run(phi.kind, phi.kernel_parameters, stretch, state, values)
                    recent = [*recent, *values][-len(memory.past) - 1 :]
                    done = stop
                x[i, memory.start : memory.start + memory.size] = state[: memory.size]
                for age, index in enumerate(memory.past, start=1):
                    x[i, index] = recent[max(len(recent) - age, 0)]


@lru_cache(maxsize=64)
def _layout(model: NARXModel) -> _Layout:
    """Return the states of a model."""
    feeds_through = any(lag == 0 for _, lag in _reads(model))
    layout = _Layout(model, feeds_through, {}, {}, ())
    oldest = dict.fromkeys((*model.outputs, *model.inputs), 0)
    for signal, lag in _reads(model):
        oldest[signal] = max(oldest[signal], layout.age(signal, lag))
    signals: list[Signal] = []
    for signal, longest in oldest.items():
        is_input = signal in model.inputs
        for age in range(1 if is_input else 0, longest + 1):
            layout.lagged[signal, age] = len(signals)
            signals.append(
                Signal(str(Variable(signal, layout.lag(signal, age))), model.units.get(signal, ""))
            )
    for phi in model.phi:
        lags = [v.lag for v in model.library.variables if v.signal == phi.name]
        if not phi.has_memory or not lags:
            continue
        size = 1 if phi.kind == PLAY else STATE_SIZE
        start = len(signals)
        signals += [Signal(f"{phi.name} memory {i + 1}", "") for i in range(size)]
        ages = range(1, layout.age(phi.signal, max(lags)) + 1)
        past = tuple(range(len(signals), len(signals) + len(ages)))
        signals += [Signal(f"{phi.name} before {age}", "") for age in ages]
        layout.memories[str(phi.name)] = _Memory(phi, start, size, past)
    return layout._replace(signals=tuple(signals))


def _reads(model: NARXModel):
    """Yield (signal, lag) of every output and input that a step reads, through phi regressors too."""
    phis = {str(phi.name): phi for phi in model.phi}
    for variable in model.library.variables:
        if variable.signal not in phis:
            yield variable.signal, variable.lag
            continue
        for argument in phis[variable.signal].arguments:
            yield argument.signal, argument.lag + variable.lag


def _parameters(model: NARXModel):
    """Yield the coefficients that are not zero, output by output."""
    for output, column in zip(model.outputs, model.parameters.T, strict=True):
        for term, value in zip(model.library, column, strict=True):
            if value != 0:
                name = str(term) if len(model.outputs) == 1 else f"{output}: {term}"
                yield Parameter(name, _unit(model, output, term), float(value))


def _unit(model: NARXModel, output: str, term: Term) -> str:
    """Return the unit of a coefficient, empty where a unit is not known or nothing is left of it."""
    powers = Counter({model.units.get(output, ""): 1})
    for variable, exponent in term.factors:
        powers[model.units.get(variable.signal, "")] -= exponent
    if "" in powers:
        return ""
    above, below = (
        "*".join(
            f"{_bracketed(unit)}^{abs(n)}" if abs(n) > 1 else unit
            for unit, n in powers.items()
            if n * sign > 0
        )
        for sign in (1, -1)
    )
    return f"{above or 1}/{_bracketed(below)}" if below else above


def _bracketed(unit: str) -> str:
    return f"({unit})" if any(mark in unit for mark in "*/ ") else unit


@lru_cache(maxsize=64)
def _equations_of(structure: _Structure):
    """Return the compiled step and output of a model, from lines made of its terms."""
    layout = _layout(structure.model)
    source = _Source(layout)
    return tuple(
        compiled_lines(lines, source.values, source.functions, f"The NARX model's {title}")
        for title, lines in (("step", source.step()), ("output", source.output()))
    )


class _Source:
    """Writes a model's step and output as Python source over ``x``, ``u``, ``p`` and ``written``."""

    def __init__(self, layout: _Layout):
        self.layout = layout
        self.model = layout.model
        self.phis = {str(phi.name): phi for phi in self.model.phi}
        self.values: dict[str, object] = {"phi_value": phi_value, "zeros": np.zeros}
        self.functions: dict[str, Callable] = {}

    def step(self) -> list[str]:
        """Return the lines that write the next states."""
        layout, model = self.layout, self.model
        lines = self._right_hand_sides()
        for (signal, age), index in layout.lagged.items():
            if signal in model.outputs and age == 0:
                value = f"y_{model.outputs.index(signal)}"
            else:
                value = self._value(signal, age - 1)
            lines.append(f"written[{index}] = {value}")
        for name, memory in layout.memories.items():
            lines.append(f"written[{memory.start}:{memory.start + memory.size}] = memory_{name}")
            newest = [f"new_{name}", *(f"x[{index}]" for index in memory.past)]
            lines += [
                f"written[{index}] = {value}" for index, value in zip(memory.past, newest, strict=False)
            ]
        return lines

    def output(self) -> list[str]:
        """Return the lines that write the outputs."""
        n = range(len(self.model.outputs))
        if self.layout.feeds_through:
            return [*self._right_hand_sides(), *(f"written[{i}] = y_{i}" for i in n)]
        return [f"written[{i}] = {self._value(self.model.outputs[i], 0)}" for i in n]

    def _right_hand_sides(self) -> list[str]:
        """Return lines that compute the phi regressors and ``y_0``, ``y_1``, ... at the new sample."""
        lines = ["nothing = zeros(1)"] if self.phis else []
        for name, memory in self.layout.memories.items():
            phi = memory.phi
            now = self._value(phi.signal, 0)
            lines.append(f"memory_{name} = x[{memory.start}:{memory.start + memory.size}].copy()")
            # an operator with memory does not read the sample before
            arguments = f"{phi.kind}, {self._constant(phi)}, {now}, {now}, memory_{name}"
            lines.append(f"new_{name} = phi_value({arguments})")
        p = 0
        for i, (output, column) in enumerate(zip(self.model.outputs, self.model.parameters.T, strict=True)):
            summands = [repr(self.model.origin.get(output, 0.0))]
            for term, value in zip(self.model.library, column, strict=True):
                if value != 0:
                    factors = [self._variable(v) for v in term.expanded]
                    summands.append("*".join([f"p[{p}]", *factors]))
                    p += 1
            lines.append(f"y_{i} = {' + '.join(summands)}")
        return lines

    def _variable(self, variable: Variable) -> str:
        """Return a factor of a term: a signal's deviation from the operating point, or a phi regressor."""
        if variable.signal in self.phis:
            return self._phi(self.phis[variable.signal], variable.lag)
        value = self._value(variable.signal, self.layout.age(variable.signal, variable.lag))
        origin = self.model.origin.get(variable.signal, 0.0)
        return f"({value} - {origin!r})" if origin else value

    def _value(self, signal: str, age: int) -> str:
        """Return a signal as measured, of some age."""
        if age == 0 and signal in self.model.inputs:
            return f"u[{self.model.inputs.index(signal)}]"
        return f"x[{self.layout.lagged[signal, age]}]"

    def _phi(self, phi: Phi, lag: int) -> str:
        """Return the value of a phi regressor ``lag`` samples ago."""
        name = str(phi.name)
        if isinstance(phi, FunctionPhi):
            self.functions[f"function_{name}"] = phi.function
            arguments = (self._value(v.signal, self.layout.age(v.signal, v.lag + lag)) for v in phi.arguments)
            return f"function_{name}({', '.join(arguments)})"
        age = self.layout.age(phi.signal, lag)
        if phi.has_memory:
            return f"new_{name}" if age == 0 else f"x[{self.layout.memories[name].past[age - 1]}]"
        now, before = self._value(phi.signal, age), self._value(phi.signal, age + 1)
        return f"phi_value({phi.kind}, {self._constant(phi)}, {now}, {before}, nothing)"

    def _constant(self, phi: Phi) -> str:
        """Return the name under which a phi regressor's numbers are known to the source."""
        name = f"numbers_{phi.name}"
        self.values[name] = np.ascontiguousarray(phi.kernel_parameters, dtype=float)
        return name
